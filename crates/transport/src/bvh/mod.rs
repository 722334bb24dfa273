//! Where rays meet triangles: a tree of boxes, eight to a node, exact at edges and corners.
//!
//! obvhs clusters the triangles into a binary tree [Meister2018a] and improves it by reinsertion [Meister2018b]; a dynamic
//! program collapses that to eight children a node [Ylitie2017]. Rays test the eight boxes of a node at once, then blocks of
//! four triangles, with edge functions that leave no gap between neighbors [Woop2013] and boxes that lose nothing to
//! rounding [Ize2013]. Light that leaks through an edge would stay in a light-transport matrix for good.
//!
//! Results depend on the triangles alone: neither on threads nor on the machine's vector instructions.

mod build;
mod collapse;
mod dispatch;
mod fan;
mod lanes;
mod node;
mod ray;
mod stack;
#[cfg(test)]
mod tests;
mod traverse;
mod triangle;

use glam::Vec3;

use build::Tree;
use dispatch::Instructions;
use fan::{Beam, FAN};
use node::{Block, Node};

/// Triangles that rays can be traced against, in world space (m).
#[derive(Clone, Debug)]
pub struct Bvh {
    tree: Tree,
    instructions: Instructions,
}

/// Points `origin + t · direction` with t strictly between `t_min` and `t_max`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// In meters.
    pub origin: Vec3,
    /// Of any length but zero; t counts in this length.
    pub direction: Vec3,
    /// Not negative. Who starts on a surface offsets the origin; no triangle is left out otherwise.
    pub t_min: f32,
    /// May be infinite.
    pub t_max: f32,
}

/// Where a ray meets a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// In lengths of the ray's direction.
    pub t: f32,
    /// Barycentric weight of vertex 1.
    pub u: f32,
    /// Barycentric weight of vertex 2.
    pub v: f32,
    /// The id that was given to [`Bvh::build`].
    pub triangle: u32,
}

/// A box along the axes (m).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aabb {
    /// Corner of least coordinates.
    pub min: Vec3,
    /// Corner of greatest coordinates.
    pub max: Vec3,
}

impl Aabb {
    /// The box around nothing: everted.
    pub const EMPTY: Aabb = Aabb { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };
}

impl Bvh {
    /// Builds the tree. `ids[i]` is what hits on `triangles[i]` report. Triangles without area, and those with corners that
    /// are not finite or beyond 10¹⁸ m, can never be hit and are left out.
    ///
    /// # Panics
    /// When the two slices differ in length.
    pub fn build(triangles: &[[Vec3; 3]], ids: &[u32]) -> Bvh {
        Bvh { tree: Tree::build(triangles, ids), instructions: Instructions::detect() }
    }

    /// The closest hit; among hits at the same t, the smallest id. None for a ray that is not finite.
    pub fn closest(&self, ray: &Ray) -> Option<Hit> {
        dispatch::closest(self.instructions, &self.tree, &traceable(ray)?)
    }

    /// Whether the ray hits anything: as [`Bvh::closest`], without looking for the closest.
    pub fn occluded(&self, ray: &Ray) -> bool {
        traceable(ray).is_some_and(|ray| dispatch::occluded(self.instructions, &self.tree, &ray))
    }

    /// Which of the segments from `origin` to the first `n` targets are free: bit i is set when [`Bvh::occluded`] is false for
    /// the ray towards `targets[i]`, with `t_min` and `t_max` as fractions of the segment. Fast when the targets are close to
    /// each other, right when they are not.
    ///
    /// # Panics
    /// When `n` is more than 16.
    pub fn visible16(&self, origin: Vec3, targets: &[Vec3; 16], n: usize, t_min: f32, t_max: f32) -> u16 {
        assert!(n <= FAN, "a fan of {n} segments where {FAN} are the most");
        let directions = targets.map(|target| target - origin);
        let towards = |direction| traceable(&Ray { origin, direction, t_min, t_max });
        let mut free = ((1_u32 << n) - 1) as u16;
        let mut pending = (0..n).filter(|&i| towards(directions[i]).is_some()).fold(0, |mask, i| mask | 1 << i);
        while pending != 0 {
            let beam = Beam::split_off(origin, [t_min, t_max], &directions, &mut pending);
            free &= !dispatch::beam_occluded(self.instructions, &self.tree, &beam);
        }
        free
    }

    /// The box around all triangles that can be hit.
    pub fn bounds(&self) -> Aabb {
        self.tree.bounds
    }

    /// Number of triangles that can be hit.
    pub fn n_triangles(&self) -> usize {
        self.tree.n_triangles
    }

    /// Memory of nodes and triangles, in bytes.
    pub fn memory_bytes(&self) -> usize {
        size_of_val::<[Node]>(&self.tree.nodes) + size_of_val::<[Block]>(&self.tree.blocks)
    }
}

/// The ray, if arithmetic can follow it.
#[inline]
fn traceable(ray: &Ray) -> Option<Ray> {
    let finite = ray.origin.is_finite() && ray.direction.is_finite();
    let longest = ray.direction.abs().max_element();
    (finite && longest >= f32::MIN_POSITIVE).then_some(Ray { t_min: not_negative(ray.t_min), ..*ray })
}

/// The number, or +0 in place of what is negative or NaN.
#[inline]
fn not_negative(number: f32) -> f32 {
    if number > 0.0 { number } else { 0.0 }
}
