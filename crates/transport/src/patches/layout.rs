//! Where patches lie and how large they are: who gets the light that reaches a place.
//!
//! A picture takes the light of a place from the patches around it, by weights that change smoothly. By the same weights light that
//! reaches the place is given to them, over the area that each of them stands for, so that pictures show neither more nor less of it.

use std::f32::consts::PI;
use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;

use super::nearest::{Center, Nearest, SHARING};
use super::{GOLDEN_ANGLE, PatchSample};
use crate::bvh::Ray;
use crate::path::through_glass;
use crate::prepared::{PreparedScene, SurfaceHit};
use crate::sampler::Sampler;
use crate::slabs::IN_A_ROW;
use crate::streams::Stream;

/// Light that leaves a lamp along a ray.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Beam {
    /// On the lamp, world space in meters.
    pub origin: Vec3,
    /// Unit vector.
    pub direction: Vec3,
    /// Lumen per channel.
    pub flux: Vec3,
    /// It carries no more than what would light a surface that faces it as at this distance, m.
    pub least_m: f32,
}

/// The patches of a scene as receivers of light.
#[derive(Debug, PartialEq)]
pub(crate) struct Layout {
    pub(super) nearest: Arc<Nearest>,
    /// Patch by patch.
    extents: Vec<Extent>,
}

/// How large a patch is, and what it does with light that grazes it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Extent {
    radius_m: f32,
    /// How far its samples lie above or below its plane at most, m.
    relief_m: f32,
    grazing: f32,
    /// The area that it stands for, m².
    area_m2: f32,
}

/// A patch never counts as smaller than this share of a disk of its radius.
const LEAST_SHARE: f32 = 0.1;
/// Radii within which a patch stands for all that is nearest to it, and beyond which it stands for nothing.
const REACH: [f32; 2] = [2.0, 3.0];
/// A place counts in full up to the relief of a patch and this share of its radius above or below its plane, and not at all
/// twice as far: what looks the same way beyond a board or a wall is no part of it.
const SLAB: f32 = 0.05;
/// A place of which at least this share lies within the reach of patches gives them all of its light.
const COVERED: f32 = 0.25;
/// Rays from above each sample of a patch that tell its area.
const PROBES: u32 = 64;
/// Stream of random numbers that nobody else uses, that of beams, and that of what is seen of them.
const AREA_STREAM: u64 = Stream::PatchAreas.first();
const BEAM_STREAM: u64 = Stream::PatchBeams.first();
const SIGHT_STREAM: u64 = Stream::PatchSight.first();

/// 0 up to the first bound, 1 from the second, smooth in between.
pub(super) fn smoothly([from, to]: [f32; 2], x: f32) -> f32 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Radii of a patch from a lamp: nearer than the first, its light is found by rays from the lamp alone, farther than the second by
/// its samples alone.
pub(super) const APART: [f32; 2] = [2.0, 4.0];

/// Share of a lamp's light that a patch finds by its samples.
pub(super) fn far_share(apart_m: f32, radius_m: f32) -> f32 {
    if radius_m > 0.0 { smoothly(APART, apart_m / radius_m) } else { 1.0 }
}

impl Layout {
    /// Measures the patches: samples patch by patch, and the first of each.
    pub(super) fn measured(
        scene: &PreparedScene,
        nearest: Arc<Nearest>,
        (samples, first): (&[PatchSample], &[u32]),
    ) -> Layout {
        let mut layout = Layout::new(nearest, (samples, first), &[]);
        let area = |(patch, w): (usize, &[u32])| {
            let own = &samples[w[0] as usize..w[1] as usize];
            let mut sampler = Sampler::new(0, AREA_STREAM, patch as u32);
            let areas = own.iter().enumerate().map(|(nth, sample)| {
                layout.area_from(scene, patch as u32, (sample, nth as f32 / own.len() as f32), &mut sampler)
            });
            areas.sum::<f32>() / own.len() as f32
        };
        let areas: Vec<f32> = first.par_windows(2).enumerate().map(area).collect();
        for (extent, area) in layout.extents.iter_mut().zip(areas) {
            extent.area_m2 = area.max(LEAST_SHARE * PI * extent.radius_m * extent.radius_m);
        }
        layout
    }

    /// Patches whose areas are known, m².
    pub(super) fn new(nearest: Arc<Nearest>, (samples, first): (&[PatchSample], &[u32]), areas_m2: &[f32]) -> Layout {
        let extent = |(patch, w): (usize, &[u32])| {
            let own = &samples[w[0] as usize..w[1] as usize];
            let grazing = own.iter().map(|sample| sample.grazing).sum::<f32>() / own.len() as f32;
            let (radius_m, center) = (own[0].patch_radius_m(), &nearest.centers()[patch]);
            let relief_m = own.iter().map(|sample| center.height(sample.position).abs()).fold(0.0, f32::max);
            Extent { radius_m, relief_m, grazing, area_m2: areas_m2.get(patch).copied().unwrap_or(0.0) }
        };
        let extents = first.windows(2).enumerate().map(extent).collect();
        Layout { nearest, extents }
    }

    /// Areas of the patches, m².
    pub fn areas_m2(&self) -> impl Iterator<Item = f32> {
        self.extents.iter().map(|extent| extent.area_m2)
    }

    /// Whether a lamp, `apart` from each place so many meters, throws light on patches that [`Layout::receive`] counts.
    pub fn is_close(&self, apart: impl Fn(Vec3) -> f32) -> bool {
        let mut patches = self.nearest.centers().iter().zip(&self.extents);
        patches.any(|(center, extent)| apart(center.position) < (APART[1] + REACH[1]) * extent.radius_m)
    }

    /// Adds the irradiance of beams, past so many slabs at most, to that of patches, as far as these are too near to the lamp, `apart`
    /// from each place so many meters, for their samples to find it. Patches that see nothing of what is above a place get none of its
    /// light: they lie behind a wall, or the lamp within a body.
    pub fn receive<'a>(
        &self,
        scene: &PreparedScene,
        (beams, most_slabs): (&[Beam], usize),
        apart: impl Fn(Vec3) -> f32 + Sync,
        samples_of: impl Fn(u32) -> &'a [PatchSample] + Sync,
        irradiance: &mut [Vec3],
    ) {
        hide(scene, &self.nearest, &samples_of);
        let land = |(nth, beam): (usize, &Beam)| {
            let ray = Ray { origin: beam.origin, direction: beam.direction, t_min: 0.0, t_max: f32::INFINITY };
            let mut sampler = Sampler::new(0, BEAM_STREAM, nth as u32);
            let (hit, passed) = first_broad(scene, &ray, most_slabs, &mut sampler)?;
            let normal = scene.smooth_normal(&hit, beam.direction);
            // Nothing dims the light of a body: its least distance is zero.
            let dimmed = (hit.position.distance(beam.origin) / beam.least_m).min(1.0).powi(2);
            let flux = passed * beam.flux * dimmed;
            let (cos, apart_m) = (-beam.direction.dot(normal), apart(hit.position));
            let outward = hit.outward(-beam.direction);
            let shares = self.around(hit.position, normal).map(|(patch, share)| {
                let far = far_share(apart_m, self.extents[patch as usize].radius_m);
                (patch, share * (1.0 - far))
            });
            if shares.iter().all(|(_, near)| *near <= 0.0) {
                return None;
            }
            Some(shares.map(|(patch, near)| {
                if near <= 0.0 || !self.is_seen(scene, (hit.origin(outward), outward), patch) {
                    return (patch, Vec3::ZERO);
                }
                let Extent { grazing, area_m2, .. } = self.extents[patch as usize];
                (patch, flux * (near * super::response::response(grazing, cos.max(0.0)) / area_m2))
            }))
        };
        let landed: Vec<[(u32, Vec3); SHARING]> =
            beams.par_iter().enumerate().with_min_len(32).filter_map(land).collect();
        for (patch, light) in landed.into_iter().flatten().filter(|(_, light)| light.is_finite()) {
            irradiance[patch as usize] += light;
        }
    }

    /// Whether what is above a place, `(origin of rays, outward)`, is seen from above a patch.
    fn is_seen(&self, scene: &PreparedScene, place: (Vec3, Vec3), patch: u32) -> bool {
        let (radius_m, mut sampler) = (self.extents[patch as usize].radius_m, Sampler::new(0, SIGHT_STREAM, patch));
        let from = above(scene, place, radius_m, &mut sampler);
        self.nearest.eyes(patch).iter().any(|eye| see_each_other(scene, from, *eye))
    }

    /// The patches that stand for a place, and their shares of its light: together 1 but where no patch reaches.
    fn around(&self, position: Vec3, normal: Vec3) -> [(u32, f32); SHARING] {
        let (patches, weights) = self.nearest.weights(position, normal);
        let whole = weights.iter().sum::<f32>();
        let mut shares = std::array::from_fn(|i| {
            let (patch, center) = (patches[i], &self.nearest.centers()[patches[i] as usize]);
            (patch, weights[i] / whole * self.within_reach(patch, center, position, normal))
        });
        let covered: f32 = shares.iter().map(|(_, share)| share).sum();
        if covered.is_nan() {
            return patches.map(|patch| (patch, 0.0));
        }
        shares.iter_mut().for_each(|(_, share)| *share /= covered.max(COVERED));
        shares
    }

    fn within_reach(&self, patch: u32, center: &Center, position: Vec3, normal: Vec3) -> f32 {
        let Extent { radius_m, relief_m, .. } = self.extents[patch as usize];
        if radius_m <= 0.0 {
            return 0.0;
        }
        // What looks another way is no part of it.
        let facing = smoothly([0.0, 0.5], normal.dot(center.normal));
        let slab_m = relief_m + SLAB * radius_m;
        let beside = smoothly([slab_m, 2.0 * slab_m], center.height(position).abs());
        facing * (1.0 - beside) * (1.0 - smoothly(REACH, position.distance(center.position) / radius_m))
    }

    /// The area that a patch stands for as far as it is seen from above one of its samples: a disk around its middle is thrown on the
    /// surfaces below. `turn` sets the probes of samples apart.
    fn area_from(
        &self,
        scene: &PreparedScene,
        patch: u32,
        (sample, turn): (&PatchSample, f32),
        sampler: &mut Sampler,
    ) -> f32 {
        let (center, radius_m) = (self.nearest.centers()[patch as usize], self.extents[patch as usize].radius_m);
        if radius_m <= 0.0 {
            return 0.0;
        }
        let eye = above(scene, (sample.position, sample.normal), radius_m, sampler);
        let middle = center.position + center.normal * center.height(sample.position);
        let (tangent, bitangent) = center.normal.any_orthonormal_pair();
        let reach_m = REACH[1] * radius_m;
        let probe = |nth: u32| {
            let (sin, cos) = (GOLDEN_ANGLE * (nth as f32 + turn)).sin_cos();
            let aside = reach_m * ((nth as f32 + 0.5) / PROBES as f32).sqrt();
            let target = middle + (tangent * cos + bitangent * sin) * aside;
            let distance = target.distance(eye);
            let direction = (target - eye) / distance;
            let cos = -direction.dot(center.normal);
            if cos.is_nan() || cos <= 0.0 {
                return 0.0;
            }
            let ray = Ray { origin: eye, direction, t_min: 0.0, t_max: f32::INFINITY };
            let Some((hit, _)) = first_broad(scene, &ray, IN_A_ROW, sampler) else { return 0.0 };
            let normal = scene.smooth_normal(&hit, direction);
            // Out of its reach it has no share, whoever else is around.
            if self.within_reach(patch, &center, hit.position, normal) == 0.0 {
                return 0.0;
            }
            let shares = self.around(hit.position, normal);
            let share = shares.iter().find(|(other, _)| *other == patch).map_or(0.0, |(_, share)| *share);
            // What is seen edge on would count without bound.
            let tilt = cos / direction.dot(hit.normal).abs().max(0.05);
            share * tilt * (hit.position.distance(eye) / distance).powi(2)
        };
        (0..PROBES).map(probe).sum::<f32>() * PI * reach_m * reach_m / PROBES as f32
    }
}

/// Whether no wall hides places from each other, each so high above its surface.
pub(super) fn are_in_sight(scene: &PreparedScene, places: [(Vec3, Vec3); 2], height_m: f32) -> bool {
    let mut sampler = Sampler::new(0, SIGHT_STREAM, 0);
    let [from, to] = places.map(|place| above(scene, place, height_m, &mut sampler));
    see_each_other(scene, from, to)
}

fn see_each_other(scene: &PreparedScene, from: Vec3, to: Vec3) -> bool {
    scene.transmittance(from, to) != Vec3::ZERO
}

/// Looks which patches are hidden from those around them, if nobody has yet.
pub(super) fn hide<'a>(scene: &PreparedScene, nearest: &Nearest, samples_of: impl Fn(u32) -> &'a [PatchSample] + Sync) {
    if nearest.knows_hidden() {
        return;
    }
    let eyes_of = |patch: u32| -> Vec<Vec3> {
        let mut sampler = Sampler::new(0, SIGHT_STREAM, patch);
        let eye = |at: &PatchSample| above(scene, (at.position, at.normal), at.patch_radius_m(), &mut sampler);
        samples_of(patch).iter().map(eye).collect()
    };
    let eyes = (0..nearest.centers().len() as u32).into_par_iter().map(eyes_of).collect();
    nearest.hide(eyes, |from, to| see_each_other(scene, from, to));
}

/// The place so high above another one, along a unit vector, or half as high as the next surface.
fn above(scene: &PreparedScene, (place, up): (Vec3, Vec3), height_m: f32, sampler: &mut Sampler) -> Vec3 {
    let ray = Ray { origin: place, direction: up, t_min: 0.0, t_max: 2.0 * height_m };
    let free = scene.closest(&ray, sampler).map_or(ray.t_max, |hit| hit.t);
    place + up * (0.5 * free)
}

/// The first surface along a ray that scatters broadly, and what of the light passes clear panes before it and so many slabs at most,
/// which shift it; `None` where light ends elsewhere.
fn first_broad(
    scene: &PreparedScene,
    ray: &Ray,
    most_slabs: usize,
    sampler: &mut Sampler,
) -> Option<(SurfaceHit, Vec3)> {
    let (mut ray, mut passed) = (*ray, Vec3::ONE);
    for _ in 0..=most_slabs {
        let (hit, through_panes) = scene.closest_behind_panes(&ray, sampler)?;
        passed *= through_panes;
        if passed == Vec3::ZERO {
            return None;
        }
        let Some(route) = scene.slabs.route_through(hit.triangle, ray.origin, ray.direction) else {
            return scene.bsdf(&hit, -ray.direction).has_smooth_lobes().then_some((hit, passed));
        };
        // The way to the glass is known to be free.
        let start = (ray.origin, hit.origin(hit.outward(-ray.direction)));
        let emerged = through_glass(scene, start, Vec3::ZERO, &route)?;
        passed *= emerged.passed;
        ray.origin = emerged.from;
    }
    None
}
