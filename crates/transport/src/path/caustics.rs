//! Walks that are sent toward mirrors and clear bodies, see [`crate::casters`].
//!
//! Where casters throw light on a place, some guided walks leave it beside those that its lobes send out. They carry the
//! light that comes by way of casters alone, and end where that is over. A walk that meets a caster first by chance brings
//! of this light its own share: by the densities of both, which add up as each is tried a fixed number of times, the balance
//! heuristic \[Veach1995\]. What else such a walk brings is its own.

use std::f32::consts::PI;

use glam::Vec3;

use super::{Deposit, Integrator, LightPlan, Scratch, Vertex, Walk};
use crate::bsdf::Bsdf;
use crate::casters::Guide;
use crate::prepared::SurfaceHit;
use crate::sampler::Sampler;
use crate::slabs::Passage;

/// Who else looks for the light of caustics at the place where a walk set out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Guides {
    /// Nobody.
    None,
    /// So many guided walks, as is to be expected.
    Some(f32),
    /// Somebody who brings all of it.
    All,
}

/// Guided walks of a vertex, as is to be expected: fewest and most.
const GUIDES: [f32; 2] = [0.125, 1024.0];
/// Light that the guided walks of a vertex bring together, in peaks of a column, for each of them.
const LIGHT_PER_GUIDE: f32 = 25.0;
/// The same of the first vertex of a walk, for a single one: it is met once, however many walks go on from it, and the light that is
/// expected at a place is a rough guess.
const LIGHT_OF_ONE: f32 = 0.3;

impl<P: LightPlan> Integrator<'_, P> {
    /// Sends guided walks from a vertex where light was sampled, and that is left by `splits` walks like this one.
    #[inline]
    pub(super) fn guide_walks(
        &self,
        walk: &Walk,
        splits: u32,
        at: (&SurfaceHit, &Bsdf),
        sampler: &mut Sampler,
        scratch: &mut Scratch,
        deposit: &mut impl Deposit,
    ) -> Guides {
        let Some(casters) = self.casters.filter(|casters| !casters.is_on_the_way(at.0.triangle)) else {
            return Guides::None;
        };
        let guide = casters.guide(at.0.position);
        let n = self.n_guides(walk, &guide, splits as f32 * at.1.peak_estimate() * PI);
        let value = |wi: Vec3| {
            let (f_cos, pdf) = at.1.eval(wi);
            (f_cos * splits as f32, pdf * splits as f32)
        };
        self.guide(walk, (&guide, n), (at.0, &value), sampler, scratch, deposit);
        Guides::Some(n)
    }

    /// How many guided walks leave a vertex that scatters so much of its light the way the walk came.
    pub(super) fn n_guides(&self, walk: &Walk, guide: &Guide<'_>, scattered: f32) -> f32 {
        let light = guide.light() * walk.throughput.max_element() * scattered * self.peaks;
        let at_first = if walk.sampled_at == Some(Vertex::First) { (light / LIGHT_OF_ONE).min(1.0) } else { 0.0 };
        (light / LIGHT_PER_GUIDE).max(at_first).clamp(GUIDES[0], GUIDES[1])
    }

    /// Sends guided walks, `n` as is to be expected. `value` tells of a direction what multiplies its light, and the density with which
    /// other walks take it.
    pub(super) fn guide(
        &self,
        walk: &Walk,
        (guide, n): (&Guide<'_>, f32),
        (hit, value): (&SurfaceHit, &impl Fn(Vec3) -> (Vec3, f32)),
        sampler: &mut Sampler,
        scratch: &mut Scratch,
        deposit: &mut impl Deposit,
    ) {
        let outward = hit.outward(-walk.direction);
        let [u_number, offset] = sampler.next_2d();
        let number = (n + u_number) as u32;
        for nth in 0..number {
            let mut own = sampler.fork(nth, number.next_power_of_two());
            // Neighbors aim at one part, so that they are stratified over it.
            let u_part = (nth as f32 + offset) / number as f32;
            let Some(wi) = guide.sample(u_part, own.next_2d()) else { continue };
            let (f_cos, others) = value(wi);
            if wi.dot(outward) <= 0.0 || f_cos.max_element() <= 0.0 {
                continue;
            }
            let throughput = walk.throughput * f_cos / (others + n * guide.pdf(wi));
            let origin = hit.origin(outward);
            let sent = Walk { origin, direction: wi, throughput, departed: hit.position, ..*walk };
            self.follow_caustic(sent, &mut own, scratch, deposit);
        }
        // What comes next draws numbers of its own.
        sampler.next_1d();
    }

    /// Follows a walk that was sent off to a caster as long as casters throw its light on.
    pub(super) fn follow_caustic(
        &self,
        mut walk: Walk,
        sampler: &mut Sampler,
        scratch: &mut Scratch,
        deposit: &mut impl Deposit,
    ) {
        let Some(casters) = self.casters else { return };
        walk.share = walk.throughput.max_element();
        (walk.density, walk.passed, walk.passage) = (0.0, 0.0, Passage::default());
        (walk.rival, walk.straight, walk.specular) = (walk.sampled_at, false, false);
        (walk.guides, walk.caustic_share) = (Guides::None, 1.0);
        let Some(first) = self.closest(&walk.ray(), sampler).filter(|hit| casters.has(hit.triangle)) else { return };
        let mut next = self.meet(&mut walk, first, sampler, deposit);
        while let Some(hit) = next.filter(|hit| casters.is_on_the_way(hit.triangle)) {
            if !self.go_on(&mut walk, &hit, sampler, scratch, deposit) {
                return;
            }
            next = self.arrive(&mut walk, sampler, deposit);
        }
    }

    /// Collects what a walk finds at a surface that it met, in its share if casters brought it there.
    #[inline]
    pub(super) fn share_caustic(&self, walk: &mut Walk, hit: &SurfaceHit, collect: impl FnOnce(&Walk)) {
        let guides = std::mem::replace(&mut walk.guides, Guides::None);
        if let Some(casters) = self.casters.filter(|casters| guides != Guides::None && casters.has(hit.triangle)) {
            walk.caustic_share *= match guides {
                Guides::Some(n) => {
                    let guided = casters.guide(walk.departed).pdf(walk.direction);
                    walk.density / (walk.density + n * guided)
                }
                Guides::All => 0.0,
                Guides::None => 1.0,
            };
        }
        collect(walk);
        if walk.caustic_share != 1.0 && !self.casters.is_some_and(|casters| casters.is_on_the_way(hit.triangle)) {
            walk.caustic_share = 1.0;
        }
    }
}
