//! The two trees behind the questions that are asked of both.

use std::time::Duration;

use clerestory_transport::bvh::{Bvh, Ray};
use glam::{Vec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh_from_tris;
use obvhs::ray::{Ray as TheirRay, RayHit};
use obvhs::rt_triangle::RtTriangle;
use obvhs::triangle::Triangle;

/// What a renderer asks.
pub trait Tree {
    /// Parameter of the closest hit, infinite without one.
    fn closest(&self, ray: &Ray) -> f32;
    /// The same for the first `n` endless rays that leave a point; the others do not count.
    fn closest16(&self, origin: Vec3, directions: &[Vec3; 16], n: usize) -> [f32; 16];
    /// Whether a ray meets nothing.
    fn is_free(&self, ray: &Ray) -> bool;
    /// Bit i is set where the segment to `targets[i]` is free up to `t_max` of it.
    fn free16(&self, origin: Vec3, targets: &[Vec3; 16], t_max: f32) -> u16;
}

/// Ours.
pub struct Ours(pub Bvh);

impl Ours {
    pub fn build(triangles: &[[Vec3; 3]]) -> Ours {
        Ours(Bvh::build(triangles, &(0..triangles.len() as u32).collect::<Vec<_>>()))
    }
}

impl Tree for Ours {
    #[inline]
    fn closest(&self, ray: &Ray) -> f32 {
        self.0.closest(ray).map_or(f32::INFINITY, |hit| hit.t)
    }

    #[inline]
    fn closest16(&self, origin: Vec3, directions: &[Vec3; 16], n: usize) -> [f32; 16] {
        let hits = self.0.closest16(origin, directions, n, 0.0, &[f32::INFINITY; 16]);
        hits.map(|hit| hit.map_or(f32::INFINITY, |hit| hit.t))
    }

    #[inline]
    fn is_free(&self, ray: &Ray) -> bool {
        !self.0.occluded(ray)
    }

    #[inline]
    fn free16(&self, origin: Vec3, targets: &[Vec3; 16], t_max: f32) -> u16 {
        self.0.visible16(origin, targets, 16, 0.0, t_max)
    }
}

/// obvhs' CWBVH, its triangles laid out as its examples advise and of its type for intersection.
pub struct Theirs {
    tree: CwBvh,
    triangles: Vec<RtTriangle>,
}

impl Theirs {
    pub fn build(triangles: &[[Vec3; 3]]) -> Theirs {
        let corners = |[v0, v1, v2]: [Vec3; 3]| Triangle { v0: v0.into(), v1: v1.into(), v2: v2.into() };
        let triangles: Vec<Triangle> = triangles.iter().copied().map(corners).collect();
        let preset = BvhBuildParams::very_slow_build();
        let tree = build_cwbvh_from_tris(&triangles, preset, &mut Duration::default());
        let in_order = tree.primitive_indices.iter().map(|&index| RtTriangle::from(&triangles[index as usize]));
        let triangles = in_order.collect();
        Theirs { tree, triangles }
    }

    #[inline]
    fn ray(ray: &Ray) -> TheirRay {
        TheirRay::new(Vec3A::from(ray.origin), Vec3A::from(ray.direction), ray.t_min, ray.t_max)
    }
}

impl Tree for Theirs {
    #[inline]
    fn closest(&self, ray: &Ray) -> f32 {
        let mut hit = RayHit::none();
        self.tree.ray_traverse(Theirs::ray(ray), &mut hit, |ray, id| self.triangles[id].intersect(ray));
        hit.t
    }

    /// It has no packets: one ray after the other.
    #[inline]
    fn closest16(&self, origin: Vec3, directions: &[Vec3; 16], n: usize) -> [f32; 16] {
        let mut found = [f32::INFINITY; 16];
        for (t, &direction) in found.iter_mut().zip(directions).take(n) {
            *t = self.closest(&Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY });
        }
        found
    }

    #[inline]
    fn is_free(&self, ray: &Ray) -> bool {
        self.tree.ray_traverse_miss(Theirs::ray(ray), |ray, id| self.triangles[id].intersect(ray))
    }

    /// It has no packets: one segment after the other.
    #[inline]
    fn free16(&self, origin: Vec3, targets: &[Vec3; 16], t_max: f32) -> u16 {
        let is_free = |target: Vec3| self.is_free(&Ray { origin, direction: target - origin, t_min: 0.0, t_max });
        targets.iter().enumerate().fold(0, |bits, (i, &target)| bits | u16::from(is_free(target)) << i)
    }
}
