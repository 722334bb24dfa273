//! From a pixel to the surfaces that it sees: straight on, in mirrors, and through clear panes and smooth glass; and on from
//! there to what narrow lobes show.

use glam::Vec3;

use super::point::{Point, Special};
use crate::bvh::Ray;
use crate::prepared::{PreparedScene, SurfaceHit};
use crate::sampler::Sampler;
use crate::slabs::most_in_a_row;

/// A way that a viewer looks along.
#[derive(Clone, Copy, Debug)]
pub(super) struct Trail {
    pub origin: Vec3,
    pub direction: Vec3,
    pub throughput: Vec3,
    /// Extinction of the solid that it is in, 1/m.
    pub extinction: Vec3,
    /// Surfaces before it.
    depth: u32,
    /// Those of them that count as bounces: all but clear panes that it went straight through.
    turns: u32,
    /// Whether a narrow lobe has turned it: what it finds is light that was scattered once more.
    is_scattered: bool,
}

/// A part of a way that is free up to a distance, beyond the first one of a pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Segment {
    pub pixel: u32,
    pub trail: Trail,
    /// In m; infinite where nothing is met.
    pub reach: f32,
}

/// What the pixels of a part of the film see.
#[derive(Default)]
pub(super) struct Found {
    pub points: Vec<Point>,
    /// Points that narrow lobes of other points show.
    pub shown: Vec<Point>,
    pub specials: Vec<Special>,
    pub segments: Vec<Segment>,
    /// Rays that were followed.
    pub n_rays: u64,
}

/// Most surfaces that a way meets one after the other.
const MOST_SURFACES: u32 = 16;
/// Most parts of ways that one sample of a pixel is followed along.
const MOST_PARTS: u32 = 64;
/// What a way has to carry to be followed for certain; of those that carry less, as many are followed as their share, and
/// each carries this much.
const CARRIES: f32 = 0.02;
/// The same of ways that a narrow lobe has turned, as a coat does with some 4 % of the light of every pixel of a floor.
const SHOWS: f32 = 0.1;

impl Trail {
    pub fn from_camera(origin: Vec3, direction: Vec3) -> Trail {
        Trail {
            origin,
            direction,
            throughput: Vec3::ONE,
            extinction: Vec3::ZERO,
            depth: 0,
            turns: 0,
            is_scattered: false,
        }
    }

    /// The next surface on the way.
    fn next_surface(&self, scene: &PreparedScene, sampler: &mut Sampler) -> Option<SurfaceHit> {
        let ray = Ray { origin: self.origin, direction: self.direction, t_min: 0.0, t_max: f32::INFINITY };
        if self.is_scattered { scene.closest(&ray, sampler) } else { scene.closest_seen(&ray, sampler) }
    }
}

impl Found {
    /// Memory of all of it, bytes.
    pub fn n_bytes(&self) -> usize {
        (self.points.capacity() + self.shown.capacity()) * size_of::<Point>()
            + self.specials.capacity() * size_of::<Special>()
            + self.segments.capacity() * size_of::<Segment>()
    }

    /// Follows a ray of the camera from the first surface that it meets, if it does, and one direction of each surface's lobes
    /// that are not wider than `narrow_alpha`; only so far as light is scattered or bent `bounces` times after the first.
    pub fn follow(
        &mut self,
        (scene, narrow_alpha, bounces): (&PreparedScene, f32, u32),
        (first, met): (Trail, Option<SurfaceHit>),
        pixel: u32,
        mut sampler: Sampler,
    ) {
        let (sampler, mut known) = (&mut sampler, Some(met));
        let (mut waiting, mut n_parts) = (vec![first], 0);
        while let Some(mut trail) = waiting.pop() {
            let hit = known.take().unwrap_or_else(|| trail.next_surface(scene, sampler));
            let free = hit.as_ref().map_or(f32::INFINITY, |hit| hit.t);
            (n_parts, self.n_rays) = (n_parts + 1, self.n_rays + 1);
            if trail.depth > 0 && !trail.is_scattered {
                self.segments.push(Segment { pixel, trail, reach: free });
            }
            let Some(hit) = hit else { continue };
            if scene.material(hit.triangle).unlit {
                continue;
            }
            if trail.extinction != Vec3::ZERO {
                trail.throughput *= (-trail.extinction * hit.t).exp();
            }
            if n_parts + (waiting.len() as u32) < MOST_PARTS {
                self.meet((scene, narrow_alpha, bounces), &trail, &hit, pixel, sampler, &mut waiting);
            } else {
                self.meet((scene, 0.0, bounces), &trail, &hit, pixel, sampler, &mut Vec::new());
            }
        }
    }

    /// Takes a surface, and notes where a viewer looks on from there.
    fn meet(
        &mut self,
        (scene, narrow_alpha, bounces): (&PreparedScene, f32, u32),
        trail: &Trail,
        hit: &SurfaceHit,
        pixel: u32,
        sampler: &mut Sampler,
        waiting: &mut Vec<Trail>,
    ) {
        let wo = -trail.direction;
        let looks = scene.appearance(hit);
        let bsdf = scene.bsdf_of(hit, &looks, wo);
        let back = hit.normal.dot(trail.direction) >= 0.0;
        if bsdf.has_smooth_lobes() && trail.turns <= bounces {
            let behind = scene.extinction_behind(hit.triangle, back, trail.extinction);
            let most_slabs = most_in_a_row(bounces - trail.turns);
            let (seen, extinction) = ((pixel, trail.throughput, most_slabs), [trail.extinction, behind]);
            let point = Point::new(scene, (hit, &looks, &bsdf), wo, seen, extinction, &mut self.specials);
            let points = if trail.is_scattered { &mut self.shown } else { &mut self.points };
            points.push(point);
        }
        if trail.depth >= MOST_SURFACES {
            return;
        }
        let mut look =
            |wi: Vec3, share: Vec3, transmitted: bool, (turns, is_scattered): (u32, bool), sampler: &mut Sampler| {
                // Lamps are seen from the last surface that counts, nothing else.
                if turns > bounces.saturating_add(1) {
                    return;
                }
                let worth = if is_scattered { SHOWS } else { CARRIES };
                let Some(throughput) = worth_it(trail.throughput * share, worth, sampler) else { return };
                let inside = wi.dot(hit.normal) < 0.0;
                let origin = hit.origin(if inside { -hit.normal } else { hit.normal });
                let before = trail.extinction;
                let extinction =
                    if transmitted { scene.extinction_behind(hit.triangle, !inside, before) } else { before };
                let depth = trail.depth + 1;
                waiting.push(Trail { origin, direction: wi, throughput, extinction, depth, turns, is_scattered });
            };
        for lobe in bsdf.deltas() {
            let goes_on = lobe.transmitted && scene.is_clear_pane(hit.triangle);
            let turns = trail.turns + u32::from(!goes_on);
            look(lobe.wi, lobe.share, lobe.transmitted, (turns, trail.is_scattered), sampler);
        }
        if !trail.is_scattered && bsdf.has_narrow_lobe(narrow_alpha) {
            let (u_lobe, u) = (sampler.next_1d(), sampler.next_2d());
            if let Some(sample) = bsdf.sample_narrow(u_lobe, u, narrow_alpha) {
                look(sample.wi, sample.weight, sample.transmitted, (trail.turns + 1, true), sampler);
            }
        }
    }
}

/// What a way carries on if it is followed, which it is for certain where it carries as much as it is worth; `None` if it is not.
fn worth_it(throughput: Vec3, worth: f32, sampler: &mut Sampler) -> Option<Vec3> {
    let carried = throughput.max_element();
    if carried >= worth {
        return Some(throughput);
    }
    (sampler.next_1d() * worth < carried).then(|| throughput * (worth / carried))
}
