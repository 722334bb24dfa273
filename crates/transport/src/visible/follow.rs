//! From a pixel to the surfaces that it sees: straight on, in mirrors, and through clear panes and smooth glass.

use glam::Vec3;

use super::point::{Point, Special};
use crate::bvh::Ray;
use crate::prepared::{PreparedScene, SurfaceHit};
use crate::sampler::Sampler;

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

impl Trail {
    pub fn from_camera(origin: Vec3, direction: Vec3) -> Trail {
        Trail { origin, direction, throughput: Vec3::ONE, extinction: Vec3::ZERO, depth: 0 }
    }

    fn ray(&self) -> Ray {
        Ray { origin: self.origin, direction: self.direction, t_min: 0.0, t_max: f32::INFINITY }
    }
}

impl Found {
    /// Follows a ray of the camera. Returns how far it is to the first surface, m; infinite if there is none.
    pub fn follow(&mut self, scene: &PreparedScene, first: Trail, pixel: u32, sampler: &mut Sampler) -> f32 {
        let (mut reach, mut waiting, mut n_parts) = (f32::INFINITY, vec![first], 0);
        while let Some(mut trail) = waiting.pop() {
            let hit = scene.closest(&trail.ray(), sampler);
            let free = hit.as_ref().map_or(f32::INFINITY, |hit| hit.t);
            (n_parts, self.n_rays) = (n_parts + 1, self.n_rays + 1);
            if trail.depth == 0 {
                reach = free;
            } else {
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
                self.meet(scene, &trail, &hit, pixel, sampler, &mut waiting);
            } else {
                self.meet(scene, &trail, &hit, pixel, sampler, &mut Vec::new());
            }
        }
        reach
    }

    /// Takes a surface, and notes where a viewer looks on from there.
    fn meet(
        &mut self,
        scene: &PreparedScene,
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
        if bsdf.has_smooth_lobes() {
            let behind = scene.extinction_behind(hit.triangle, back);
            let (seen, extinction) = ((pixel, trail.throughput), [trail.extinction, behind]);
            self.points.push(Point::new(scene, (hit, &looks, &bsdf), wo, seen, extinction, &mut self.specials));
        }
        if trail.depth >= MOST_SURFACES {
            return;
        }
        for lobe in bsdf.deltas() {
            let mut throughput = trail.throughput * lobe.share;
            let carried = throughput.max_element();
            if carried < CARRIES {
                if sampler.next_1d() * CARRIES >= carried {
                    continue;
                }
                throughput *= CARRIES / carried;
            }
            let inside = lobe.wi.dot(hit.normal) < 0.0;
            let origin = hit.origin(if inside { -hit.normal } else { hit.normal });
            let extinction =
                if lobe.transmitted { scene.extinction_behind(hit.triangle, !inside) } else { trail.extinction };
            waiting.push(Trail { origin, direction: lobe.wi, throughput, extinction, depth: trail.depth + 1 });
        }
    }
}
