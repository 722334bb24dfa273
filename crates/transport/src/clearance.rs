//! Where rays begin that leave a surface, so that rounding does not let them meet it again.
//!
//! Three things are rounded: the parameter of a ray at a triangle, by the size of the triangle; the sides of large neighbors in
//! the same plane, by the size of the scene; and the place itself, by its coordinates. Within a scene around the origin of
//! coordinates the last is no more than the others. Far away it is all there is, and no more than that may be granted: a
//! kilometer away, steps for the second of them would lift rays from the floor over everything that lies on it. Rays to a light end before it for the same reasons.

use glam::Vec3;

/// Rounding of a ray's parameter at a triangle as high as it is long, over its longest edge.
const CLEARANCE: f32 = f32::EPSILON;
/// Longest edge over height of a sliver beyond which no more is granted.
const SLENDEREST: f32 = 64.0;
/// Roundings of a coordinate from the corners of a triangle to the beginning of a ray: two sums on the way to the place, two on
/// the way off the surface, half a step each, and as much again.
const ROUNDINGS: f32 = 4.0;

/// How far from a triangle a ray has to begin so that it does not meet it. The intersection sees the vertices from the
/// ray's origin, so that the parameter of the plane is off by rounding steps of their distance, the longest edge at most,
/// and more so the smaller the height over that edge is: weights are differences of products of lengths.
pub(crate) fn clearance(ab: Vec3, ac: Vec3, across: Vec3) -> f32 {
    let longest = ab.length_squared().max(ac.length_squared()).max(ab.distance_squared(ac));
    let slenderness = (longest / across.length().max(f32::MIN_POSITIVE)).min(SLENDEREST);
    CLEARANCE * longest.sqrt() * slenderness
}

/// By how much a place may be off along a normal because its coordinates are larger than the scene is, m.
pub(crate) fn rounding(position: Vec3, normal: Vec3, extent: f32) -> f32 {
    let beyond = (position.abs() - extent).max(Vec3::ZERO);
    ROUNDINGS * f32::EPSILON * beyond.dot(normal.abs())
}

/// How much shorter a ray from a place to a light must be so that it does not meet the light's own surface, where rounding moves
/// the point on it because coordinates are larger than the scene is, m. Enough for light that leaves a surface at a tenth of its
/// brightness or more.
pub(crate) fn shortening(from: Vec3, extent: f32) -> f32 {
    let beyond = (from.abs() - extent).max(Vec3::ZERO);
    10.0 * ROUNDINGS * f32::EPSILON * beyond.element_sum()
}

/// Whether rays from a point so many meters away tell a place from the surface that it was lifted off. They see corners and places from
/// that point, so that a surface lies where it does but for roundings of its distance; rays from the place itself see it from nearby.
pub(crate) fn is_told_apart(lifted_m: f32, distance_m: f32) -> bool {
    SEEN * f32::EPSILON * distance_m < lifted_m
}

/// Roundings of the distance that count there: a floor at 0 loses a ten-thousandth of its light at 0.8 of them and a hundredth at 1.6.
const SEEN: f32 = 2.0;

/// A target that is so much nearer.
pub(crate) fn nearer(from: Vec3, target: Vec3, by: f32) -> Vec3 {
    if by > 0.0 { target.move_towards(from, by) } else { target }
}

/// Moves a point of a scene with a diagonal of `extent` meters by what rounding does to coordinates within it.
/// \[Wachter2019\]
pub fn offset_origin(position: Vec3, normal: Vec3, extent: f32) -> Vec3 {
    const NEAR_ZERO: f32 = 1.0 / 32.0;
    const FLOAT_SCALE: f32 = 1.0 / 65_536.0;
    const INT_SCALE: f32 = 256.0;
    let near_zero = FLOAT_SCALE.min(INT_SCALE * f32::EPSILON * extent);
    let offset = |p: f32, n: f32| {
        let steps = (INT_SCALE * n) as i32;
        if p.abs() < NEAR_ZERO {
            return p + near_zero * n;
        }
        let within = p.clamp(-extent, extent);
        let moved = f32::from_bits((within.to_bits() as i32 + if within < 0.0 { -steps } else { steps }) as u32);
        // The difference is exact, and where nothing was clamped so is the sum.
        p + (moved - within)
    };
    Vec3::new(offset(position.x, normal.x), offset(position.y, normal.y), offset(position.z, normal.z))
}
