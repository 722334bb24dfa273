//! Walks that neighboring pixels share. \[Bekaert2002\]
//!
//! Where a walk goes on from the first surface of a pixel and meets a diffuse one, what leaves the place that it met is the
//! same in all directions. So it is worth as much to the pixels around, if their own first surfaces see the place. Of a
//! coated surface that holds for all but a little of the diffuse base ([`Bsdf::matte`]); that little and the coat are for the
//! walk's own pixel alone.
//! Each place is weighed by the sum of the densities with which all of these pixels would have found it, the balance
//! heuristic \[Veach1995\]: the mean stays what it is, and no pixel gets more from a place than from a walk of its own.
//!
//! Only surfaces that camera and walk reach straight take part; all other walks are followed for their own pixel alone.

use glam::Vec3;

use super::{Deposit, Integrator, LightPlan, Rivals, Scratch, Vertex, Walk};
use crate::bsdf::Bsdf;
use crate::prepared::{PreparedScene, SurfaceHit};
use crate::sampler::Sampler;
use crate::scene::Material;

/// The first surface of a pixel's walk, after lights were sampled there.
pub(crate) struct Start {
    /// Whom its light is for.
    pub place: usize,
    /// What came of the camera's light so far.
    throughput: Vec3,
    /// The walk that came, one of several that go on.
    walk: Walk,
    hit: SurfaceHit,
    bsdf: Bsdf,
    /// Where light to it ends.
    origin: Vec3,
    sampler: Sampler,
}

/// Where a walk met the next surface.
pub(crate) struct Meeting {
    /// Number of the start that the walk left.
    pub start: usize,
    walk: Walk,
    hit: SurfaceHit,
    bsdf: Bsdf,
    /// What all starts see alike.
    matte: Bsdf,
    sampler: Sampler,
}

/// Whether coated surfaces are worth the rays by which they share a walk: where a walk collects the light of several lamps.
pub(super) fn coats_share(scene: &PreparedScene, plan: &impl LightPlan) -> bool {
    scene.coats_share && plan.splits() > 1
}

/// Walks that leave a first surface. Where all surfaces are plain, one is enough: those of the neighbors are worth more.
pub(super) fn scouts(scene: &PreparedScene, plan: &impl LightPlan) -> u32 {
    if scene.scene.materials.iter().all(Material::is_plainly_diffuse) { 1 } else { plan.splits() }
}

/// Rays that are asked for together.
const FAN: usize = 16;
/// How much more than for one pixel a connection has to carry that many pixels share before roulette may leave it out: its
/// noise is in all of them.
const SHARED_WORTH: f32 = 3.0;

impl<P: LightPlan> Integrator<'_, P> {
    /// A walk up to the first surface where lights are sampled, if its light can be shared; others are followed to their end.
    pub(crate) fn set_out(
        &self,
        (origin, direction): (Vec3, Vec3),
        place: usize,
        mut sampler: Sampler,
        scratch: &mut Scratch,
        deposit: &mut impl Deposit,
    ) -> Option<Start> {
        let mut walk = Walk::from_camera(origin, direction);
        while walk.sampled_at.is_none() {
            let hit = self.arrive(&mut walk, &mut sampler, deposit)?;
            let bsdf = self.scene.bsdf(&hit, -walk.direction);
            let is_straight = walk.n_hits == 1 && walk.extinction == Vec3::ZERO;
            let shares = bsdf.has_smooth_lobes() && (self.coats_share || bsdf.is_diffuse());
            if is_straight && shares && !self.is_spent(&walk) {
                let throughput = walk.throughput;
                self.connect_first(&mut walk, self.scouts, (&hit, &bsdf), &mut sampler, scratch, deposit);
                walk.guides = self.guide_walks(&walk, self.scouts, (&hit, &bsdf), &mut sampler, scratch, deposit);
                let origin = hit.origin(bsdf.geometric_normal());
                return Some(Start { place, throughput, walk, hit, bsdf, origin, sampler });
            }
            if !self.go_on_from(&mut walk, (&hit, &bsdf), &mut sampler, scratch, deposit) {
                return None;
            }
        }
        self.follow(walk, &mut sampler, scratch, deposit);
        None
    }

    /// The walks that leave a start, up to the next surface. Those whose light cannot be shared are followed to their end; of
    /// the others one is enough, that of a number drawn beforehand, for all that would have come.
    pub(crate) fn explore(
        &self,
        (number, start): (usize, &Start),
        scratch: &mut Scratch,
        deposit: &mut impl Deposit,
    ) -> Option<Meeting> {
        let (mut meeting, mut sampler) = (None, start.sampler);
        let chosen = if self.scouts > 1 { (sampler.next_1d() * self.scouts as f32) as u32 } else { 0 };
        for nth in 0..self.scouts {
            let (mut walk, mut sampler) = (start.walk, sampler.fork(nth, self.scouts));
            if !self.scatter(&mut walk, &start.hit, &start.bsdf, self.scouts, &mut sampler) {
                continue;
            }
            let Some(hit) = self.arrive(&mut walk, &mut sampler, deposit) else { continue };
            let bsdf = self.scene.bsdf(&hit, -walk.direction);
            let Some(matte) = self.matte(start, &walk, (&hit, &bsdf)) else {
                if self.go_on_from(&mut walk, (&hit, &bsdf), &mut sampler, scratch, deposit) {
                    self.follow(walk, &mut sampler, scratch, deposit);
                }
                continue;
            };
            if nth == chosen {
                walk.throughput *= self.scouts as f32;
                walk.share *= self.scouts as f32;
                meeting = Some(Meeting { start: number, walk, hit, bsdf, matte, sampler });
            }
        }
        meeting
    }

    /// What all starts see alike of a surface that a walk met straight; `None` if others could not have met it so.
    fn matte(&self, start: &Start, walk: &Walk, (hit, bsdf): (&SurfaceHit, &Bsdf)) -> Option<Bsdf> {
        let has_density = walk.density > 0.0;
        let reflects = walk.direction.dot(start.bsdf.geometric_normal()) > 0.0;
        let throws = self.casters.is_some_and(|casters| casters.is_on_the_way(hit.triangle));
        let shares = has_density && reflects && !throws && (self.coats_share || bsdf.is_diffuse());
        // A pane that is met at the end of all bounces lets the walk pass, and scatters nothing.
        if shares && !self.is_spent(walk) { bsdf.matte() } else { None }
    }

    /// What each start gets of the radiance that leaves a meeting; false where its own start does not see it freely, so that
    /// it is for that alone.
    pub(crate) fn share(&self, meeting: &Meeting, starts: &[Start], shares: &mut Vec<Vec3>) -> bool {
        let origin = meeting.hit.origin(meeting.bsdf.geometric_normal());
        let (mut total, mut own_sees) = (0.0, false);
        shares.clear();
        shares.resize(starts.len(), Vec3::ZERO);
        for (nth, (starts, shares)) in starts.chunks(FAN).zip(shares.chunks_mut(FAN)).enumerate() {
            let (mut targets, mut asked, mut densities, mut n) = ([Vec3::ZERO; FAN], [0; FAN], [0.0; FAN], 0);
            for (slot, start) in starts.iter().enumerate() {
                let Some((value, density)) = reached(start, meeting) else { continue };
                (targets[n], asked[n], densities[n]) = (start.origin, slot, density);
                shares[slot] = value;
                n += 1;
            }
            let seen = if n > 0 { self.scene.sees16(origin, &targets, n) } else { 0 };
            for i in 0..n {
                // What lies behind a pane, however clear, is found by walks through the pane, which are not shared.
                if seen >> i & 1 == 1 {
                    total += densities[i];
                    own_sees |= nth * FAN + asked[i] == meeting.start;
                } else {
                    shares[asked[i]] = Vec3::ZERO;
                }
            }
        }
        shares.iter_mut().for_each(|share| *share /= total);
        own_sees
    }

    /// Follows the walk of a meeting for its own start alone.
    pub(crate) fn follow_alone(&self, meeting: Meeting, scratch: &mut Scratch, deposit: &mut impl Deposit) {
        let Meeting { mut walk, hit, bsdf, mut sampler, .. } = meeting;
        if self.go_on_from(&mut walk, (&hit, &bsdf), &mut sampler, scratch, deposit) {
            self.follow(walk, &mut sampler, scratch, deposit);
        }
    }

    /// Follows the walk of a meeting with all that only its own start sees of the surface.
    pub(crate) fn follow_rest(&self, meeting: &Meeting, scratch: &mut Scratch, deposit: &mut impl Deposit) {
        let Meeting { hit, bsdf, matte, sampler, .. } = meeting;
        let mut walk = meeting.walk;
        let Some(rest) = bsdf.without(matte, -walk.direction) else { return };
        let mut sampler = sampler.fork(1, 2);
        if self.go_on_from(&mut walk, (hit, &rest), &mut sampler, scratch, deposit) {
            self.follow(walk, &mut sampler, scratch, deposit);
        }
    }

    /// Follows the walk of a meeting: deposits the radiance that leaves it, as far as all starts see it alike, times the factor
    /// that is returned.
    pub(crate) fn follow_shared(&self, mut meeting: Meeting, scratch: &mut Scratch, deposit: &mut impl Deposit) -> f32 {
        // As bright as for its own start, so that roulette ends the same walks.
        let factor = SHARED_WORTH * meeting.walk.throughput.max_element();
        meeting.walk.throughput = Vec3::splat(factor);
        meeting.walk.share *= SHARED_WORTH;
        let Meeting { mut walk, hit, matte: bsdf, sampler, .. } = meeting;
        let mut sampler = if bsdf.is_diffuse() { sampler } else { sampler.fork(0, 2) };
        // So many pixels depend on this one that all lights are asked.
        let vertex = Vertex::Close;
        self.connect(&walk, (vertex, Rivals::All { splits: 1 }), (&hit, &bsdf), &mut sampler, scratch, deposit);
        walk.sampled_at = Some(vertex);
        walk.guides = self.guide_walks(&walk, 1, (&hit, &bsdf), &mut sampler, scratch, deposit);
        if self.scatter(&mut walk, &hit, &bsdf, 1, &mut sampler) {
            self.follow(walk, &mut sampler, scratch, deposit);
        }
        factor
    }
}

/// What a start makes of the radiance of a meeting per unit of area there, and the density per area with which its walks
/// find it; `None` where it faces away.
#[inline]
fn reached(start: &Start, meeting: &Meeting) -> Option<(Vec3, f32)> {
    let away = meeting.hit.position - start.hit.position;
    let closeness = 1.0 / away.length_squared();
    let wi = away * closeness.sqrt();
    let per_area = -meeting.bsdf.geometric_normal().dot(wi) * closeness;
    let seen = meeting.matte.seen_share(-wi);
    if per_area <= 0.0 || seen <= 0.0 || wi.dot(start.bsdf.geometric_normal()) <= 0.0 {
        return None;
    }
    let (f_cos, pdf) = start.bsdf.eval(wi);
    let density = pdf * per_area;
    (density > 0.0 && density.is_finite()).then(|| (start.throughput * f_cos * (per_area * seen), density))
}
