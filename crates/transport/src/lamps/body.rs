//! The bodies of lamps that have a size: a rectangle, a disk, a sphere. Rays meet them, but nothing stops there.

use std::f32::consts::{FRAC_PI_4, PI, TAU};

use glam::{Vec2, Vec3};

use super::{FreeLamp, LampShape};
use crate::prepared::{PreparedScene, SHADOW_END};
use crate::sampler::uniform_sphere;

/// A surface that shines diffusely, in world space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Body {
    /// Shines to the side of its normal.
    Rectangle {
        /// Middle, m.
        center: Vec3,
        /// From the middle to the middles of two sides, at right angles.
        half: [Vec3; 2],
        /// Unit normal.
        normal: Vec3,
    },
    /// Shines to the side of its normal.
    Disk {
        /// Middle, m.
        center: Vec3,
        /// Two radii at right angles.
        radii: [Vec3; 2],
        /// Unit normal.
        normal: Vec3,
    },
    /// Shines outwards.
    Sphere {
        /// Middle, m.
        center: Vec3,
        /// In m.
        radius: f32,
    },
}

/// A point of a body.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BodyPoint {
    /// World space, m.
    pub position: Vec3,
    /// Unit normal of the shining side.
    pub normal: Vec3,
}

/// Least length of a side, and least diameter. What is smaller shines from that size with the same flux, so that a surface that
/// touches it is bright, but not without bound.
const LEAST_M: f32 = 5e-3;
/// The same at most, over a distance beyond all surfaces: in a model of centimeters a lamp is of millimeters.
const LEAST_OF_FAR: f32 = 5e-4;

/// Least length of a side of a body in a scene, and least diameter, m.
pub fn least_size_m(scene: &PreparedScene) -> f32 {
    LEAST_M.min(LEAST_OF_FAR * scene.far())
}

impl Body {
    /// The body of a lamp in a room and the area that the look gives it, m²; `None` for a lamp without size.
    pub fn of(lamp: &FreeLamp) -> Option<(Body, f64)> {
        Body::no_less(lamp, LEAST_M)
    }

    /// The same where sides and diameters are at least so long, m.
    pub fn no_less(lamp: &FreeLamp, least_m: f32) -> Option<(Body, f64)> {
        let center = lamp.position;
        let [right, up, normal] = lamp.frame();
        match lamp.shape {
            LampShape::Rectangle { size_m: [width, height] } => {
                let half = [right * (0.5 * width.max(least_m)), up * (0.5 * height.max(least_m))];
                Some((Body::Rectangle { center, half, normal }, f64::from(width) * f64::from(height)))
            }
            LampShape::Disk { radius_m } => {
                let radius = radius_m.max(0.5 * least_m);
                let area = std::f64::consts::PI * f64::from(radius_m).powi(2);
                Some((Body::Disk { center, radii: [right * radius, up * radius], normal }, area))
            }
            LampShape::Sphere { radius_m } => {
                let area = 4.0 * std::f64::consts::PI * f64::from(radius_m).powi(2);
                Some((Body::Sphere { center, radius: radius_m.max(0.5 * least_m) }, area))
            }
            _ => None,
        }
    }

    /// Area that shines, m².
    pub fn area(&self) -> f32 {
        match self {
            Body::Rectangle { half: [u, v], .. } => 4.0 * u.length() * v.length(),
            Body::Disk { radii: [u, _], .. } => PI * u.length_squared(),
            Body::Sphere { radius, .. } => 4.0 * PI * radius * radius,
        }
    }

    /// Middle and radius of a ball around it, m.
    pub fn ball(&self) -> (Vec3, f32) {
        match self {
            Body::Rectangle { center, half: [u, v], .. } => (*center, (*u + *v).length()),
            Body::Disk { center, radii: [u, _], .. } => (*center, u.length()),
            Body::Sphere { center, radius } => (*center, *radius),
        }
    }

    /// A point with uniform density over the area, for `u` uniform in [0, 1)².
    pub fn sample(&self, u: Vec2) -> BodyPoint {
        match self {
            Body::Rectangle { center, half, normal } => {
                let at = 2.0 * u - 1.0;
                BodyPoint { position: *center + half[0] * at.x + half[1] * at.y, normal: *normal }
            }
            Body::Disk { center, radii, normal } => {
                let at = concentric(u);
                BodyPoint { position: *center + radii[0] * at.x + radii[1] * at.y, normal: *normal }
            }
            Body::Sphere { center, radius } => {
                let normal = uniform_sphere(u.to_array());
                BodyPoint { position: *center + normal * *radius, normal }
            }
        }
    }

    /// Where a ray meets the shining side first, in lengths of its direction, before a surface at `t_max`, or so little behind it that
    /// shadow rays end before the surface: of one in a ceiling rounding would hide pixels.
    pub fn meet(&self, origin: Vec3, direction: Vec3, t_max: f32) -> Option<(f32, BodyPoint)> {
        let (t, normal) = match self {
            Body::Rectangle { center, half: [u, v], normal } => {
                let (t, offset) = meet_plane((*center, *normal), (origin, direction))?;
                let inside = |axis: &Vec3| offset.dot(*axis).abs() <= axis.length_squared();
                (inside(u) && inside(v)).then_some((t, *normal))?
            }
            Body::Disk { center, radii: [u, _], normal } => {
                let (t, offset) = meet_plane((*center, *normal), (origin, direction))?;
                (offset.length_squared() <= u.length_squared()).then_some((t, *normal))?
            }
            Body::Sphere { center, radius } => {
                let t = meet_sphere((*center, *radius), (origin, direction))?;
                (t, (origin + direction * t - *center).normalize_or_zero())
            }
        };
        (t > 0.0 && t * SHADOW_END < t_max).then(|| (t, BodyPoint { position: origin + direction * t, normal }))
    }
}

/// Where a ray meets the front of a plane, and how far from the plane's point.
fn meet_plane((center, normal): (Vec3, Vec3), (origin, direction): (Vec3, Vec3)) -> Option<(f32, Vec3)> {
    let along = direction.dot(normal);
    let t = (center - origin).dot(normal) / along;
    (along < 0.0 && t > 0.0).then(|| (t, origin + direction * t - center))
}

/// Where a ray enters a sphere, by the numbers that stay exact for small and far ones.
fn meet_sphere((center, radius): (Vec3, f32), (origin, direction): (Vec3, Vec3)) -> Option<f32> {
    let (center, origin, direction) = (center.as_dvec3(), origin.as_dvec3(), direction.as_dvec3());
    let (to_center, square) = (center - origin, direction.length_squared());
    let nearest = to_center.dot(direction) / square;
    let aside = to_center - direction * nearest;
    let inside = f64::from(radius).powi(2) - aside.length_squared();
    (inside > 0.0).then(|| (nearest - (inside / square).sqrt()) as f32)
}

/// The unit square onto the unit disk, areas and neighbors kept. \[Shirley1997\]
fn concentric(u: Vec2) -> Vec2 {
    let Vec2 { x, y } = 2.0 * u - 1.0;
    if x == 0.0 && y == 0.0 {
        return Vec2::ZERO;
    }
    let (radius, angle) =
        if x.abs() > y.abs() { (x, FRAC_PI_4 * (y / x)) } else { (y, 2.0 * FRAC_PI_4 - FRAC_PI_4 * (x / y)) };
    let (sin, cos) = angle.sin_cos();
    radius * Vec2::new(cos, sin)
}

/// A direction within a cone around an axis, all of them alike, and the solid angle; `one_minus_cos` of the half angle.
pub(super) fn in_cone(axis: Vec3, one_minus_cos: f32, u: Vec2) -> (Vec3, f32) {
    let down = one_minus_cos * u.x;
    let radius = (down * (2.0 - down)).max(0.0).sqrt();
    let (sin, cos) = (TAU * u.y).sin_cos();
    let (tangent, bitangent) = axis.any_orthonormal_pair();
    ((tangent * cos + bitangent * sin) * radius + axis * (1.0 - down), TAU * one_minus_cos)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lamps::tests::lamp;
    use crate::sampler::Sampler;

    fn bodies() -> [Body; 3] {
        let shapes = [
            LampShape::Rectangle { size_m: [0.8, 0.3] },
            LampShape::Disk { radius_m: 0.4 },
            LampShape::Sphere { radius_m: 0.3 },
        ];
        shapes.map(|shape| Body::of(&lamp(shape)).expect("it has a size").0)
    }

    #[test]
    fn a_ray_towards_a_sampled_point_meets_it_from_the_front_and_nothing_from_behind() {
        for body in bodies() {
            for case in 0..200 {
                let mut sampler = Sampler::new(3, case, 0);
                let point = body.sample(Vec2::from(sampler.next_2d()));
                let side = uniform_sphere(sampler.next_2d());
                let eye = point.position + side * 2.0;
                let met = body.meet(eye, -side, 2.1);
                let faces = side.dot(point.normal);
                if faces > 1e-2 {
                    let (t, found) = met.expect("the point itself is in front");
                    assert!((t - 2.0).abs() < 1e-3 && found.normal.distance(point.normal) < 1e-2, "{body:?} {t}");
                } else if !matches!(body, Body::Sphere { .. }) {
                    assert!(faces > -1e-2 || met.is_none(), "{body:?} from behind");
                }
                assert!(body.meet(eye, -side, 1.0).is_none(), "it lies beyond");
            }
        }
    }

    #[test]
    fn points_are_spread_evenly_over_the_area() {
        let n = 4096;
        for body in bodies() {
            let (center, radius) = body.ball();
            let points: Vec<BodyPoint> =
                (0..n).map(|i| body.sample(Vec2::from(Sampler::new(1, 2, i).next_2d()))).collect();
            let mean = points.iter().map(|p| p.position - center).sum::<Vec3>() / n as f32;
            assert!(mean.length() < 5e-3 * radius, "{body:?}: {mean}");
            assert!(points.iter().all(|p| p.position.distance(center) <= radius * 1.0001));
            // Half of a disk's area lies within √½ of its radius.
            if matches!(body, Body::Disk { .. }) {
                let near = points.iter().filter(|p| p.position.distance(center) < 0.5_f32.sqrt() * radius).count();
                assert!((near as f32 / n as f32 - 0.5).abs() < 0.01, "{near}");
            }
        }
    }

    #[test]
    fn the_solid_angle_of_a_cone_is_that_of_the_cap() {
        let (direction, solid_angle) = in_cone(Vec3::Y, 0.25, Vec2::new(1.0, 0.3));
        assert!((direction.y - 0.75).abs() < 1e-6 && direction.is_normalized());
        assert!((solid_angle - TAU * 0.25).abs() < 1e-6);
    }
}
