//! Walks that look for surfaces which lamps could light: what a picture would take of the irradiance there.
//!
//! A walk starts at the camera, or at a surface, and asks no lamp. From the first surface with a broad lobe on it reports
//! each further one that it came to by a broad lobe at least once, together with what the start takes of its light.

use glam::Vec3;

use super::{Deposit, Integrator, LightPlan, Pick, Vertex, Walk, sampled};
use crate::bsdf::{Bsdf, BsdfSample, ScatterKind, Shares};
use crate::prepared::SurfaceHit;
use crate::sampler::{Sampler, cosine_around};

/// A surface that a walk met beyond the first.
pub(crate) struct Landing<'a> {
    /// Where.
    pub hit: &'a SurfaceHit,
    /// Where the walk came from straight.
    pub from: Vec3,
    /// Unit normal on the side that the walk came from, without normal map.
    pub normal: Vec3,
    /// What came of the start's light so far.
    pub throughput: Vec3,
    /// The share of that in which the light that the surface scatters straight from lamps is found anew elsewhere: a narrow
    /// lobe of the first surface shows it, see [`crate::visible`].
    pub anew: Vec3,
    /// What the surface sends back of the light it receives.
    pub shares: Shares,
}

/// How a walk goes on from a landing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Onward {
    /// By all lobes: nothing is known of the light that arrives.
    All,
    /// By all lobes but the diffuse base, and nowhere where all are broad: their light is known.
    Narrow,
}

/// Share of a walk that a narrow lobe of its first broad surface sends on, if mirrors and clear glass alone came before; those that
/// come later show what it shows. What is scattered a second time counts no more.
fn found_anew((walk, before): (&Walk, Vec3), bsdf: &Bsdf, sample: &BsdfSample, narrow_alpha: f32) -> Vec3 {
    match sample.kind {
        ScatterKind::Smooth if walk.specular && bsdf.has_narrow_lobe(narrow_alpha) => {
            let whole = sample.weight * sample.pdf;
            let share = bsdf.eval_narrow(sample.wi, narrow_alpha) / whole.max(Vec3::splat(f32::MIN_POSITIVE));
            share.min(Vec3::ONE)
        }
        ScatterKind::Smooth => Vec3::ZERO,
        ScatterKind::Delta | ScatterKind::Through => before,
    }
}

/// Connects to nothing.
pub(crate) struct NoLights;

impl LightPlan for NoLights {
    fn later(&self, _: Vec3, _: impl FnOnce() -> f32) -> Vertex {
        Vertex::Later
    }

    fn pick(&self, _: Vertex, _: &mut Sampler, picks: &mut Vec<Pick>) {
        picks.clear();
    }

    fn rate(&self, _: Vertex, _: u32) -> f32 {
        0.0
    }

    fn splits(&self) -> u32 {
        1
    }

    fn worth(&self, _: u32) -> f32 {
        f32::INFINITY
    }
}

/// Takes no light.
struct Blind;

impl Deposit for Blind {
    fn scattered(&mut self, _: u32, _: Vec3) {}

    fn seen(&mut self, _: u32, _: Vec3) {}
}

impl<P: LightPlan> Integrator<'_, P> {
    /// One walk of the camera, which goes on as `splits` walks (a power of two) from the first surface with a broad lobe.
    /// Lobes of the first surface are narrow up to a width of `narrow_alpha`.
    pub(crate) fn land_from_camera(
        &self,
        (origin, direction): (Vec3, Vec3),
        (splits, narrow_alpha): (u32, f32),
        sampler: &mut Sampler,
        land: &mut impl FnMut(&Landing<'_>, &mut Sampler) -> Onward,
    ) {
        let mut walk = Walk::from_camera(origin, direction);
        while let Some(hit) = self.arrive(&mut walk, sampler, &mut Blind) {
            let bsdf = self.scene.bsdf(&hit, -walk.direction);
            if !bsdf.has_smooth_lobes() || self.is_spent(&walk) {
                if !self.scatter(&mut walk, &hit, &bsdf, 1, sampler) {
                    return;
                }
                continue;
            }
            walk.throughput /= splits as f32;
            walk.share /= splits as f32;
            for split in 0..splits {
                let (mut branch, mut own) = (walk, sampler.fork(split, splits));
                let mut anew = Vec3::ZERO;
                if self.turn_off((&mut branch, &mut anew), (&hit, &bsdf), (splits, narrow_alpha), &mut own) {
                    self.land(branch, (anew, narrow_alpha), &mut own, land);
                }
            }
            return;
        }
    }

    /// One walk from a surface, in a direction with density cosθ/π around its normal; `n_before` surfaces lie between that and the
    /// camera.
    pub(crate) fn land_from_surface(
        &self,
        (origin, normal): (Vec3, Vec3),
        n_before: u32,
        sampler: &mut Sampler,
        land: &mut impl FnMut(&Landing<'_>, &mut Sampler) -> Onward,
    ) {
        let mut walk = Walk::from_camera(origin, cosine_around(normal, sampler.next_2d()));
        (walk.n_hits, walk.n_before, walk.specular, walk.straight) = (1, n_before, false, false);
        self.land(walk, (Vec3::ZERO, 0.0), sampler, land);
    }

    fn land(
        &self,
        mut walk: Walk,
        (mut anew, narrow_alpha): (Vec3, f32),
        sampler: &mut Sampler,
        land: &mut impl FnMut(&Landing<'_>, &mut Sampler) -> Onward,
    ) {
        while let Some(hit) = self.arrive(&mut walk, sampler, &mut Blind) {
            let bsdf = self.scene.bsdf(&hit, -walk.direction);
            let mut onward = Onward::All;
            let shares = bsdf.shares();
            // What mirrors and clear glass alone show has its direct light anew, see [`crate::visible`].
            if bsdf.has_smooth_lobes() && !self.is_spent(&walk) && !walk.specular {
                let normal = self.scene.smooth_normal(&hit, walk.direction);
                let (from, throughput) = (walk.origin, walk.throughput);
                onward = land(&Landing { hit: &hit, from, normal, throughput, anew, shares }, sampler);
            }
            let goes_on = match onward {
                Onward::All => self.turn_off((&mut walk, &mut anew), (&hit, &bsdf), (1, narrow_alpha), sampler),
                Onward::Narrow if shares.is_all => false,
                Onward::Narrow => {
                    let sample = bsdf.sample_coat(sampler.next_1d(), sampler.next_2d());
                    sample.is_some_and(|sample| {
                        anew = found_anew((&walk, anew), &bsdf, &sample, narrow_alpha);
                        self.leave(&mut walk, &hit, &sample, 1)
                    })
                }
            };
            if !goes_on {
                return;
            }
        }
    }

    /// [`Integrator::scatter`], and what is found anew of the light where the walk gets to.
    fn turn_off(
        &self,
        (walk, anew): (&mut Walk, &mut Vec3),
        (hit, bsdf): (&SurfaceHit, &Bsdf),
        (splits, narrow_alpha): (u32, f32),
        sampler: &mut Sampler,
    ) -> bool {
        let Some(sample) = sampled(bsdf, sampler) else { return false };
        *anew = found_anew((walk, *anew), bsdf, &sample, narrow_alpha);
        self.leave(walk, hit, &sample, splits)
    }
}
