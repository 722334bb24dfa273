//! One point of every lamp, sixteen points of the picture: scattering, light, and whether the way is free.

use glam::{Vec2, Vec3};

use super::Band;
use super::point::{Point, Special};
use crate::clearance::is_told_apart;
use crate::lamps::{BodyPoint, Lit, PreparedLamp, PreparedLamps, Through, Way, lattice};
use crate::light::luminance;
use crate::path::{Emerged, through_glass};
use crate::prepared::PreparedScene;
use crate::sampler::Sampler;
use crate::stop::Halt;
use crate::streams::Stream;

/// Points that are shaded together, as many as a fan has.
pub(super) const GROUP: usize = 16;
/// Stream of random numbers that nobody else uses.
const STREAM: u64 = Stream::LampPoints.first();

/// What light is computed with.
pub(super) struct Shading<'a> {
    scene: &'a PreparedScene,
    lamps: &'a PreparedLamps,
    far: f32,
}

/// A way through slabs as far as behind the last one.
struct LastLeg {
    /// The member of a group to which the way leads.
    nth: usize,
    /// From the glass to the lamp, or far toward it.
    from: Vec3,
    to: Vec3,
    /// How far off the glass it begins, m.
    lifted_m: f32,
    /// Share of light that comes through the glass.
    passed: Vec3,
    /// What the lamp sends along the way.
    lit: Lit,
}

/// Shadow rays of a group to a point that they share.
struct Fan {
    n: usize,
    places: [Vec3; GROUP],
    values: [Vec3; GROUP],
    pixels: [u32; GROUP],
}

impl<'a> Shading<'a> {
    pub fn new(scene: &'a PreparedScene, lamps: &'a PreparedLamps) -> Shading<'a> {
        Shading { scene, lamps, far: scene.far() }
    }

    /// Adds the light of all lamps to those pixels of a band that are wanted, until it is halted; the band begins with the one of
    /// number `first`. Returns the number of shadow rays.
    pub fn shade(
        &self,
        band: &Band,
        (first, seed, [sample, round]): (u32, u64, [u32; 2]),
        (is_wanted, halt): (impl Fn(u32) -> bool, &Halt),
        pixels: &mut [Vec3],
    ) -> u64 {
        let (points, specials) = (&band.found.points, band.found.specials.as_slice());
        let mut n_rays = 0;
        for (tile, ends) in band.tiles.windows(2).enumerate() {
            if halt.is_called() {
                break;
            }
            for (nth, group) in points[ends[0] as usize..ends[1] as usize].chunks(GROUP).enumerate() {
                if !group.iter().any(|point| is_wanted(point.pixel)) {
                    continue;
                }
                for (lamp_idx, lamp) in self.lamps.lamps().iter().enumerate() {
                    let shift = shift((first, tile), lamp_idx, (seed, [sample, round]));
                    let u = (shift + hammersley(nth as u32)).fract();
                    n_rays += self.shade_group((group, specials), (lamp, u), (first, &is_wanted), pixels);
                }
            }
        }
        n_rays
    }

    fn shade_group(
        &self,
        (group, specials): (&[Point], &[Special]),
        (lamp, u): (&PreparedLamp, Vec2),
        (first, is_wanted): (u32, &impl Fn(u32) -> bool),
        pixels: &mut [Vec3],
    ) -> u64 {
        let shared = lamp.lamp.point(u).filter(|_| !lamp.lamp.is_ball());
        let mut fan = Fan { n: 0, places: [Vec3::ZERO; GROUP], values: [Vec3::ZERO; GROUP], pixels: [0; GROUP] };
        let (mut n_rays, mut legs): (u64, Vec<LastLeg>) = (0, Vec::new());
        let is_beside_slabs = self.scene.slabs.is_empty() || lamp.lamp.is_beside(&self.scene.slabs, around(group));
        for (nth, point) in group.iter().enumerate().filter(|(_, point)| is_wanted(point.pixel)) {
            let at = (point.pixel - first) as usize;
            let (slabs, from) = (&self.scene.slabs, (point.position, self.far));
            let may_send = |wi| point.may_send(point.normal(), wi);
            let through = || lamp.lamp.through(slabs, from, spread(u, nth), may_send);
            let Through { first: slab, way } = if is_beside_slabs { Through::default() } else { through() };
            let way = way.filter(|way| way.route.slabs().len() <= point.most_slabs());
            let sent = way.and_then(|way| Some((self.sent_along(point, lamp, spread(u, nth), &way)?, way)));
            if let Some((lit, way)) = sent {
                n_rays += 1;
                legs.extend(self.last_leg((nth, point, specials), lit, &way));
            }
            let shared = shared.as_ref().filter(|_| !lamp.lamp.is_near(point.position));
            let lit = match shared {
                Some(shared) => lamp.lamp.lit_from(shared, point.position, self.far),
                None => lamp.lamp.lit_well(point.position, spread(u, nth), self.far),
            };
            let Some(lit) = lit else { continue };
            if slab.is_some_and(|slab| slabs.is_in_between(slab, [point.position, lit.target])) {
                continue;
            }
            let ng = point.normal();
            let Some(value) = self.arriving((point, specials), ng, lamp, &lit) else { continue };
            n_rays += 1;
            let is_above = lit.wi.dot(ng) > 0.0;
            let side = if is_above { ng } else { -ng };
            let origin = point.origin(self.scene, side);
            let lifted_m = (origin - point.position).dot(side);
            if is_above && shared.is_some() && is_told_apart(lifted_m, origin.distance(lit.target)) {
                fan.push(origin, value, at as u32);
            } else {
                pixels[at] += value * self.scene.transmittance(origin, lit.target);
            }
        }
        if let Some(BodyPoint { position, .. }) = shared.filter(|_| fan.n > 0) {
            fan.flush(self.scene, position, pixels);
        }
        self.add_free((group, specials), lamp, &legs, (first, pixels));
        n_rays
    }

    /// What a point with its normal sends to its pixel if nothing is in the way; `None` where that is nothing.
    #[inline]
    fn arriving(
        &self,
        (point, specials): (&Point, &[Special]),
        ng: Vec3,
        lamp: &PreparedLamp,
        lit: &Lit,
    ) -> Option<Vec3> {
        let value = self.scattered((point, specials), ng, lamp, lit)?;
        match point.special(specials) {
            Some(special) if !lamp.lamp.is_beyond() => {
                Some(value * (-special.extinction_towards(ng, lit.wi) * lit.target.distance(point.position)).exp())
            }
            _ => Some(value),
        }
    }

    /// What a point sends to its pixel of light that nothing dims.
    #[inline]
    fn scattered(
        &self,
        (point, specials): (&Point, &[Special]),
        ng: Vec3,
        lamp: &PreparedLamp,
        lit: &Lit,
    ) -> Option<Vec3> {
        if !point.may_send(ng, lit.wi) {
            return None;
        }
        let value = point.throughput * point.lit(self.scene, specials, ng, lit.wi) * lamp.emission * lit.factor;
        (luminance(value) > 0.0).then_some(value)
    }

    /// What a lamp sends along a way; `None` where it sends none there, or the point none to its pixel.
    fn sent_along(&self, point: &Point, lamp: &PreparedLamp, u: Vec2, way: &Way) -> Option<Lit> {
        let lit = lamp.lamp.lit_along(way, point.position, u, self.far)?;
        point.may_send(point.normal(), lit.wi).then_some(lit)
    }

    /// The last leg of a way to a point; `None` where something is in the way before.
    fn last_leg(&self, (nth, point, specials): (usize, &Point, &[Special]), lit: Lit, way: &Way) -> Option<LastLeg> {
        let (route, ng) = (&way.route, point.normal());
        let extinction =
            point.special(specials).map_or(Vec3::ZERO, |special| special.extinction_towards(ng, route.direction));
        let outward = if route.direction.dot(ng) > 0.0 { ng } else { -ng };
        let start = (point.position, point.origin(self.scene, outward));
        let Emerged { passed, at, from, lifted_m } = through_glass(self.scene, start, extinction, route)?;
        let to = way.end.unwrap_or(at + route.direction * self.far);
        Some(LastLeg { nth, from, to, lifted_m, passed, lit })
    }

    /// Adds the light of those ways to points of a group whose last leg is free.
    fn add_free(
        &self,
        (group, specials): (&[Point], &[Special]),
        lamp: &PreparedLamp,
        legs: &[LastLeg],
        (first, pixels): (u32, &mut [Vec3]),
    ) {
        for (leg, free) in legs.iter().zip(self.behind_glass(lamp, legs)) {
            let (point, passed) = (&group[leg.nth], leg.passed * free);
            // Half of the ways are not free: that costs less to know than what the surface scatters.
            if passed == Vec3::ZERO {
                continue;
            }
            if let Some(value) = self.scattered((point, specials), point.normal(), lamp, &leg.lit) {
                pixels[(point.pixel - first) as usize] += passed * value;
            }
        }
    }

    /// Share of light that passes along each of some last legs.
    fn behind_glass(&self, lamp: &PreparedLamp, legs: &[LastLeg]) -> [Vec3; GROUP] {
        let mut passed = [Vec3::ZERO; GROUP];
        let is_told = |leg: &LastLeg| is_told_apart(leg.lifted_m, leg.from.distance(leg.to));
        let is_fan = || !lamp.lamp.has_size() && !lamp.lamp.is_beyond() && legs.iter().all(is_told);
        if let Some(leg) = legs.first().filter(|_| is_fan()) {
            // All end at the same point.
            let mut places = [Vec3::ZERO; GROUP];
            places.iter_mut().zip(legs).for_each(|(place, leg)| *place = leg.from);
            self.scene.transmittance_from16(leg.to, &places, legs.len(), &mut passed);
        } else {
            let of_leg = |leg: &LastLeg| self.scene.transmittance(leg.from, leg.to);
            passed.iter_mut().zip(legs).for_each(|(passed, leg)| *passed = of_leg(leg));
        }
        passed
    }
}

impl Fan {
    fn push(&mut self, place: Vec3, value: Vec3, pixel: u32) {
        (self.places[self.n], self.values[self.n], self.pixels[self.n]) = (place, value, pixel);
        self.n += 1;
    }

    fn flush(&self, scene: &PreparedScene, lamp: Vec3, pixels: &mut [Vec3]) {
        let mut passed = [Vec3::ZERO; GROUP];
        scene.transmittance_from16(lamp, &self.places, self.n, &mut passed);
        for i in 0..self.n {
            pixels[self.pixels[i] as usize] += self.values[i] * passed[i];
        }
    }
}

/// Offset of the points of a lamp for the points of a tile of a band.
pub(super) fn shift((first, tile): (u32, usize), lamp_idx: usize, (seed, [sample, round]): (u64, [u32; 2])) -> Vec2 {
    let key = u64::from(first) << 12 | tile as u64;
    let random = Vec2::from(Sampler::new(seed, STREAM + (key << 8) + lamp_idx as u64, sample).next_2d());
    (random + lattice(round)).fract()
}

/// The box around some points, middle and half of its sides.
fn around(group: &[Point]) -> (Vec3, Vec3) {
    let [lo, hi] = group
        .iter()
        .fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[lo, hi], point| [lo.min(point.position), hi.max(point.position)]);
    (0.5 * (lo + hi), 0.5 * (hi - lo))
}

/// The point of a group's member that has one of its own.
fn spread(u: Vec2, nth: usize) -> Vec2 {
    (u + lattice(1 + nth as u32)).fract()
}

/// Sixteen points of the unit square, one in each elementary interval of that area.
fn hammersley(nth: u32) -> Vec2 {
    let nth = nth % 16;
    Vec2::new(nth as f32 / 16.0, (nth.reverse_bits() >> 28) as f32 / 16.0)
}
