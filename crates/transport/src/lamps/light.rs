//! What a lamp sends to a point, and how a point on it is chosen.

use std::sync::Arc;

use glam::{Vec2, Vec3};

use super::body::{Body, BodyPoint, in_cone};
use super::rectangle::SeenRectangle;
use crate::emitters::punctual_falloff;
use crate::photometry::PhotometricProfile;
use crate::scene::PunctualLight;
use crate::slabs::{Route, Slabs};

/// A free lamp at emission 1: 1 cd along the axis, 1 lx or 1 nit.
#[derive(Clone, Debug)]
pub struct Lamp {
    pub(crate) form: Form,
}

/// Where the light of a lamp comes from.
#[derive(Clone, Debug)]
pub(crate) enum Form {
    /// From a point, m.
    Point {
        /// Place, aim and falloff.
        light: PunctualLight,
        /// What takes the place of the falloff.
        profile: Option<Arc<PhotometricProfile>>,
        /// Radius of a beam that carries as much, at a distance of 1 m, and no more than that.
        spread: f32,
    },
    /// From a disk infinitely far away.
    Distant {
        /// Along which its middle shines, a unit vector.
        direction: Vec3,
        /// Of the angle from its middle to its rim; 0 of a point.
        one_minus_cos: f32,
    },
    /// From a body.
    Body(Body),
}

/// A point of a lamp as seen from somewhere.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lit {
    /// World space, m.
    pub target: Vec3,
    /// Unit direction towards it.
    pub wi: Vec3,
    /// Radiance at emission 1 over the density of the sample per solid angle; of a lamp without size its irradiance on a
    /// surface that faces it.
    pub factor: f32,
    /// One over the density per solid angle, 0 for a lamp that no walk meets: one without size, and parallel light.
    pub spread_sr: f32,
}

/// A way to a point of a lamp through the slabs in between.
#[derive(Clone, Copy)]
pub(crate) struct Way {
    pub route: Route,
    /// Where it ends, m; `None` for light from far away.
    pub end: Option<Vec3>,
}

/// What is to know of the light that comes to a place through slabs.
#[derive(Default)]
pub(crate) struct Through {
    /// The first one on the way.
    pub first: Option<u32>,
    /// `None` where it carries nothing whatever lies on it.
    pub way: Option<Way>,
}

/// A lamp without size has this one next to it: closer than that it is not brighter, m.
const POINT_RADIUS_M: f32 = 0.01;
/// The same at most, over a distance beyond all surfaces: in a model of centimeters everything is closer than one.
const POINT_OF_FAR: f32 = 1e-3;
/// Bodies within so many of their radii are sampled by the angle that they fill.
pub(super) const NEAR: f32 = 3.0;
/// Bodies further away than so many of their radii are small, and so is a disk far away that is seen under no wider angle.
const SMALL: f32 = 8.0;

impl Lamp {
    /// A point with uniform density over a body; `far` is a distance beyond all surfaces, m.
    pub(crate) fn lit(&self, position: Vec3, u: Vec2, far: f32) -> Option<Lit> {
        match &self.form {
            Form::Point { .. } => self.lit_from(&self.point(u)?, position, far),
            Form::Distant { direction, one_minus_cos } => {
                let wi = towards_disk(*direction, *one_minus_cos, u);
                // A surface that faces the middle gets 1 lx: the disk's mean cosine is ½ (1 + cos).
                let factor = 2.0 / (2.0 - *one_minus_cos);
                Some(Lit { target: position + wi * far, wi, factor, spread_sr: 0.0 })
            }
            Form::Body(body) => lit_by(&body.sample(u), body.area(), position),
        }
    }

    /// The same with a density that suits what is close to a body: its sum stays within what the body can send.
    pub(crate) fn lit_well(&self, position: Vec3, u: Vec2, far: f32) -> Option<Lit> {
        match &self.form {
            Form::Body(Body::Sphere { center, radius }) => lit_by_sphere(*center, *radius, position, u),
            Form::Body(body) if self.is_near(position) => lit_by_plate(body, position, u),
            _ => self.lit(position, u, far),
        }
    }

    /// The same by points in strata of the unit square: those of a disk stay strata of its area as long as they are far enough apart for that.
    pub(crate) fn lit_by_strata(&self, position: Vec3, u: Vec2, far: f32) -> Option<Lit> {
        match &self.form {
            Form::Body(Body::Disk { .. }) if !self.is_body_within(1.0, position) => self.lit(position, u, far),
            _ => self.lit_well(position, u, far),
        }
    }

    /// Width over height of what [`Lamp::point`] takes points of.
    pub(crate) fn aspect(&self) -> f32 {
        match &self.form {
            Form::Body(Body::Rectangle { half: [u, v], .. }) => u.length() / v.length(),
            _ => 1.0,
        }
    }

    /// Whether a body fills so much of the view that its parts are at different distances.
    pub(crate) fn is_near(&self, position: Vec3) -> bool {
        self.is_body_within(NEAR, position)
    }

    /// Whether all of its light comes from about the same direction.
    pub(super) fn is_small_at(&self, position: Vec3) -> bool {
        match self.form {
            // The squared sine of the angle from its middle to its rim.
            Form::Distant { one_minus_cos, .. } => one_minus_cos * (2.0 - one_minus_cos) <= 1.0 / (SMALL * SMALL),
            _ => !self.is_body_within(SMALL, position),
        }
    }

    fn is_body_within(&self, radii: f32, position: Vec3) -> bool {
        let Form::Body(body) = &self.form else { return false };
        let (center, radius) = body.ball();
        center.distance_squared(position) < (radii * radius).powi(2)
    }

    /// A point that serves for many places at once; `None` for light from far away.
    pub(crate) fn point(&self, u: Vec2) -> Option<BodyPoint> {
        match &self.form {
            Form::Point { light, .. } => Some(BodyPoint { position: light.position, normal: light.direction }),
            Form::Distant { .. } => None,
            Form::Body(body) => Some(body.sample(u)),
        }
    }

    /// What a point of [`Lamp::point`] sends to a place; `far` as in [`Lamp::lit`].
    #[inline]
    pub(crate) fn lit_from(&self, point: &BodyPoint, position: Vec3, far: f32) -> Option<Lit> {
        match &self.form {
            Form::Point { light, profile, .. } => {
                let to_light = point.position - position;
                let square = to_light.length_squared();
                let wi = to_light / square.sqrt();
                let profiles = profile.as_deref().map_or(&[][..], std::slice::from_ref);
                let falloff = if wi.is_finite() { punctual_falloff(light, profiles, -wi) } else { 0.0 };
                let factor = falloff / square.max(closest_m(far).powi(2));
                (falloff > 0.0).then_some(Lit { target: point.position, wi, factor, spread_sr: 0.0 })
            }
            Form::Distant { .. } => None,
            Form::Body(body) => lit_by(point, body.area(), position),
        }
    }

    /// The way from a place to the point of the lamp that [`Lamp::point`] takes, through the slabs in between; `may_arrive` tells
    /// whether light from a direction counts at the place.
    pub(crate) fn through(
        &self,
        slabs: &Slabs,
        (position, far): (Vec3, f32),
        u: Vec2,
        may_arrive: impl Fn(Vec3) -> bool,
    ) -> Through {
        let nothing = Through::default();
        if slabs.is_empty() {
            return nothing;
        }
        if let Form::Distant { direction, one_minus_cos } = self.form {
            let wi = towards_disk(direction, one_minus_cos, u);
            let route = may_arrive(wi).then(|| slabs.route_beyond(position, wi, far)).flatten();
            let first = route.as_ref().and_then(|route| route.slabs().first().copied());
            return Through { first, way: route.map(|route| Way { route, end: None }) };
        }
        let body = self.body();
        if body.is_some_and(|body| slabs.are_beside((position, Vec3::ZERO), body.ball())) {
            return nothing;
        }
        let Some(end) = self.point(u) else { return nothing };
        let Some(way) = slabs.way(position, end.position) else { return nothing };
        // Half of the ways leave a surface or a lamp to the wrong side, which costs less to know than how they are bent.
        let may_carry = slabs.bounds(&way).is_none_or(|bounds| {
            bounds.iter().any(|wi| may_arrive(*wi))
                && (body.is_none() || bounds.iter().any(|wi| wi.dot(end.normal) < 0.0))
        });
        let route = may_carry.then(|| slabs.bent(&way)).flatten();
        Through { first: Some(way.first()), way: route.map(|route| Way { route, end: Some(end.position) }) }
    }

    /// Whether it is known that nothing of it comes through slabs to the places of a box, middle and half of its sides.
    pub(crate) fn is_beside(&self, slabs: &Slabs, places: (Vec3, Vec3)) -> bool {
        let ball = match &self.form {
            Form::Point { light, .. } => (light.position, 0.0),
            Form::Body(body) => body.ball(),
            Form::Distant { .. } => return false,
        };
        slabs.are_beside(places, ball)
    }

    /// What the point at the end of a way sends to the place where it begins.
    pub(crate) fn lit_along(&self, way: &Way, position: Vec3, u: Vec2, far: f32) -> Option<Lit> {
        self.lit(way.end.map_or(position, |end| way.route.eye(end)), u, far)
    }

    /// The body, if there is one to be seen.
    pub(crate) fn body(&self) -> Option<&Body> {
        match &self.form {
            Form::Body(body) => Some(body),
            _ => None,
        }
    }

    /// Whether it is seen under an angle, so that its light comes from more than one direction.
    pub(crate) fn has_size(&self) -> bool {
        match self.form {
            Form::Point { .. } => false,
            Form::Distant { one_minus_cos, .. } => one_minus_cos > 0.0,
            Form::Body(_) => true,
        }
    }

    /// Whether its body is a sphere: what of it is seen differs from place to place.
    pub(crate) fn is_ball(&self) -> bool {
        matches!(self.form, Form::Body(Body::Sphere { .. }))
    }

    /// Whether it shines from infinitely far away.
    pub(crate) fn is_beyond(&self) -> bool {
        matches!(self.form, Form::Distant { .. })
    }
}

/// Closer than that to a lamp without size it is not brighter, given a distance beyond all surfaces, m.
pub(super) fn closest_m(far: f32) -> f32 {
    POINT_RADIUS_M.min(POINT_OF_FAR * far)
}

/// Towards a disk infinitely far away, all of its directions alike, given along which its middle shines.
fn towards_disk(direction: Vec3, one_minus_cos: f32, u: Vec2) -> Vec3 {
    // The difference has no negative zeros, so that a device chooses the same sides around it.
    in_cone(Vec3::ZERO - direction, one_minus_cos, u).0
}

/// A point that was chosen evenly from an area.
#[inline]
fn lit_by(point: &BodyPoint, area: f32, position: Vec3) -> Option<Lit> {
    let to_light = point.position - position;
    let closeness = 1.0 / to_light.length_squared();
    let wi = to_light * closeness.sqrt();
    let spread_sr = -wi.dot(point.normal) * area * closeness;
    (spread_sr > 0.0 && spread_sr.is_finite()).then_some(Lit {
        target: point.position,
        wi,
        factor: spread_sr,
        spread_sr,
    })
}

/// A sphere by the cone that it fills: nothing from within.
fn lit_by_sphere(center: Vec3, radius: f32, position: Vec3, u: Vec2) -> Option<Lit> {
    let to_center = center - position;
    let square = to_center.length_squared();
    let sin_square = radius * radius / square;
    if sin_square >= 1.0 || !sin_square.is_finite() {
        return None;
    }
    // 1 − cos without the cancellation of a small angle.
    let one_minus_cos = sin_square / (1.0 + (1.0 - sin_square).sqrt());
    let (wi, spread_sr) = in_cone(to_center / square.sqrt(), one_minus_cos, u);
    // At the rim the ray may just miss: its closest point is the same there.
    let along = wi.dot(to_center);
    let depth = (radius * radius - (square - along * along)).max(0.0).sqrt();
    Some(Lit { target: position + wi * (along - depth), wi, factor: spread_sr, spread_sr })
}

/// A flat body by the angle that its rectangle fills: a disk lets what is beside it go dark.
fn lit_by_plate(body: &Body, position: Vec3, u: Vec2) -> Option<Lit> {
    let (center, [x, y], normal) = match body {
        Body::Rectangle { center, half, normal } => (*center, *half, *normal),
        Body::Disk { center, radii, normal } => (*center, *radii, *normal),
        Body::Sphere { .. } => return None,
    };
    let height = (position - center).dot(normal);
    if height <= 0.0 {
        return None;
    }
    let seen = SeenRectangle::new(center, [x, y], normal, position)?;
    let target = seen.sample(u);
    if matches!(body, Body::Disk { .. }) && target.distance_squared(center) > x.length_squared() {
        return None;
    }
    let wi = (target - position).normalize_or_zero();
    (wi.dot(normal) < 0.0).then_some(Lit { target, wi, factor: seen.solid_angle, spread_sr: seen.solid_angle })
}

#[cfg(test)]
mod tests {
    use std::f32::consts::PI;

    use super::*;
    use crate::lamps::tests::{ONE_SIDED, lamp};
    use crate::lamps::{FreeLamp, LampShape, PreparedLamps};
    use crate::sampler::Sampler;

    fn of(shape: LampShape) -> Lamp {
        Lamp { form: Form::Body(Body::of(&lamp(shape)).expect("it has a size").0) }
    }

    /// Mean of `factor · cosθ`: the irradiance at 1 nit.
    fn irradiance(n: u32, normal: Vec3, lit: impl Fn(Vec2) -> Option<Lit>) -> f32 {
        let one =
            |i| lit(Vec2::from(Sampler::new(5, 1, i).next_2d())).map_or(0.0, |l| l.factor * l.wi.dot(normal).max(0.0));
        (0..n).map(|i| f64::from(one(i))).sum::<f64>() as f32 / n as f32
    }

    #[test]
    fn bodies_light_a_place_as_their_form_factors_say() {
        // The test lamps hang at height 1 above the origin and look down.
        let disk = of(LampShape::Disk { radius_m: 0.4 });
        let (expected, place) = (PI * 0.16 / (1.0 + 0.16), Vec3::ZERO);
        let evenly = irradiance(4096, Vec3::Y, |u| disk.lit(place, u, 1e3));
        let well = irradiance(4096, Vec3::Y, |u| disk.lit_well(place, u, 1e3));
        assert!(
            (evenly / expected - 1.0).abs() < 0.01 && (well / expected - 1.0).abs() < 0.01,
            "{evenly} {well} {expected}"
        );
        let sphere = of(LampShape::Sphere { radius_m: 0.3 });
        let expected = PI * 0.09;
        let evenly = irradiance(4096, Vec3::Y, |u| sphere.lit(place, u, 1e3));
        let well = irradiance(1024, Vec3::Y, |u| sphere.lit_well(place, u, 1e3));
        assert!(
            (evenly / expected - 1.0).abs() < 0.02 && (well / expected - 1.0).abs() < 0.005,
            "{evenly} {well} {expected}"
        );
        // A rectangle above one corner: four times ½ (a/√(1+a²) atan(b/√(1+a²)) + b/√(1+b²) atan(a/√(1+b²))), here by symmetry.
        let rectangle = of(LampShape::Rectangle { size_m: [0.8, 0.6] });
        let (a, b) = (0.4f32, 0.3f32);
        let part = |a: f32, b: f32| a / (1.0 + a * a).sqrt() * (b / (1.0 + a * a).sqrt()).atan();
        let expected = 4.0 * 0.5 * (part(a, b) + part(b, a));
        let evenly = irradiance(4096, Vec3::Y, |u| rectangle.lit(place, u, 1e3));
        let well = irradiance(1024, Vec3::Y, |u| rectangle.lit_well(place, u, 1e3));
        assert!(
            (evenly / expected - 1.0).abs() < 0.01 && (well / expected - 1.0).abs() < 0.01,
            "{evenly} {well} {expected}"
        );
    }

    #[test]
    fn a_place_that_touches_a_body_gets_no_more_than_the_body_can_send() {
        for shape in [
            LampShape::Rectangle { size_m: [0.8, 0.3] },
            LampShape::Disk { radius_m: 0.4 },
            LampShape::Sphere { radius_m: 0.3 },
        ] {
            let lamp = of(shape);
            for place in [Vec3::Y, Vec3::Y * 0.999_99, Vec3::Y * 0.7, Vec3::new(0.1, 0.999_999, 0.1), Vec3::Y * 1.1] {
                for i in 0..64 {
                    let lit = lamp.lit_well(place, Vec2::from(Sampler::new(2, 1, i).next_2d()), 1e3);
                    let factor = lit.map_or(0.0, |lit| lit.factor);
                    assert!(factor.is_finite() && factor <= 4.0 * PI, "{lamp:?} sends {factor} to {place}");
                }
            }
        }
    }

    #[test]
    fn a_point_lamp_follows_the_inverse_square_down_to_its_own_size() {
        let prepared = PreparedLamps::new(&[lamp(LampShape::Point)], None).expect("a lamp").0;
        let point = &prepared.lamps()[0].lamp;
        let factor = |distance: f32| {
            let lit = point.lit(Vec3::new(0.0, 1.0 - distance, 0.0), Vec2::ZERO, 1e3);
            lit.map_or(0.0, |lit| lit.factor)
        };
        assert!((factor(0.5) - 4.0).abs() < 1e-4 && (factor(0.1) - 100.0).abs() < 1e-2);
        assert!((factor(1e-3) - 1e4).abs() < 1.0 && factor(0.0) == 0.0);
    }

    #[test]
    fn parallel_light_comes_from_all_of_its_disk_and_brings_its_lux() {
        for radius_rad in [0.0, 0.01, 0.3, 0.7f32] {
            let prepared = PreparedLamps::new(&[lamp(LampShape::Directional { radius_rad })], None).expect("a lamp").0;
            let sun = &prepared.lamps()[0].lamp;
            let lit = |u| sun.lit(Vec3::ZERO, u, 1e3);
            let lux = irradiance(4096, Vec3::Y, lit);
            assert!((lux - 1.0).abs() < 5e-3, "{radius_rad}: {lux}");
            let aside =
                |i| lit(Vec2::from(Sampler::new(7, 2, i).next_2d())).expect("it shines").wi.angle_between(Vec3::Y);
            let angles: Vec<f32> = (0..4096).map(aside).collect();
            assert!(angles.iter().all(|angle| *angle <= radius_rad + 1e-3), "{radius_rad}");
            let inner = angles.iter().filter(|angle| **angle < 0.5 * radius_rad).count() as f32 / 4096.0;
            let expected = (0.25 * radius_rad).sin().powi(2) / (0.5 * radius_rad).sin().powi(2);
            assert!(radius_rad < 0.1 || (inner - expected).abs() < 0.02, "{radius_rad}: {inner} of {expected}");
        }
    }

    #[test]
    fn what_is_seen_under_a_wide_angle_is_not_small_however_far_away() {
        let is_small = |shape| {
            let lamps = PreparedLamps::new(&[lamp(shape)], None).expect("a lamp").0;
            lamps.lamps()[0].lamp.is_small_at(Vec3::ZERO)
        };
        for (radius_rad, expected) in [(0.0, true), (0.12, true), (0.13, false), (0.7, false)] {
            assert_eq!(is_small(LampShape::Directional { radius_rad }), expected, "{radius_rad}");
        }
        for (radius_m, expected) in [(0.12, true), (0.13, false)] {
            assert_eq!(is_small(LampShape::Sphere { radius_m }), expected, "{radius_m}");
        }
        assert!(is_small(LampShape::Point));
    }

    #[test]
    fn a_measured_distribution_lies_as_its_lamp_is_turned() {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("one-sided.ies"), ONE_SIDED).expect("the folder can be written");
        let [right, up, down, left] = [Vec3::X, Vec3::Y, Vec3::NEG_Y, Vec3::NEG_X];
        for (ahead, turn_deg, sides) in [
            (Vec3::NEG_Z, 0.0, [right, up, down, left]),
            (Vec3::NEG_Z, 90.0, [down, right, left, up]),
            (Vec3::NEG_Y, 0.0, [right, Vec3::NEG_Z, Vec3::Z, left]),
            (Vec3::NEG_Y, 90.0, [Vec3::Z, right, left, Vec3::NEG_Z]),
        ] {
            let plain = lamp(LampShape::Profile { file: "one-sided.ies".into() });
            let of = FreeLamp { aim: plain.position + ahead, turn_rad: f32::to_radians(turn_deg), ..plain };
            let lamps = PreparedLamps::new(std::slice::from_ref(&of), Some(folder.path())).expect("a lamp").0;
            for (side, candela) in sides.into_iter().zip([900.0, 500.0, 250.0, 100.0]) {
                let place = of.position + ahead * 30f32.to_radians().cos() + side * 0.5;
                let found = lamps.lamps()[0].lamp.lit(place, Vec2::ZERO, 1e3).map_or(0.0, |lit| lit.factor);
                let what = format!("towards {ahead}, turned by {turn_deg}°, to {side}");
                assert!((found - candela / 900.0).abs() < 1e-3, "{what}: {found}");
            }
        }
    }
}
