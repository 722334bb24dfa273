//! What is right where two trees differ: all triangles asked in double precision.

use clerestory_transport::bvh::Ray;
use glam::Vec3;

/// Parameter of the closest hit, infinite without one.
pub fn closest(triangles: &[[Vec3; 3]], ray: &Ray) -> f64 {
    triangles.iter().filter_map(|triangle| hit(triangle, ray)).fold(f64::INFINITY, f64::min)
}

fn hit(triangle: &[Vec3; 3], ray: &Ray) -> Option<f64> {
    let [a, b, c] = triangle.map(|corner| corner.as_dvec3());
    let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let (ab, ac, from_a) = (b - a, c - a, origin - a);
    let (across, along) = (direction.cross(ac), from_a.cross(ab));
    let determinant = ab.dot(across);
    let [u, v, t] = [from_a.dot(across), direction.dot(along), ac.dot(along)].map(|x| x / determinant);
    let is_hit = u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > f64::from(ray.t_min) && t < f64::from(ray.t_max);
    is_hit.then_some(t)
}
