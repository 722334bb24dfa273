//! Where rays meet triangles: a tree of boxes, eight to a node, exact at edges and corners.
//!
//! obvhs clusters the triangles into a binary tree \[Meister2018a\] and improves it by reinsertion \[Meister2018b\]; a dynamic
//! program collapses that to eight children a node \[Ylitie2017\]. Rays test the eight boxes of a node at once, then blocks of
//! four triangles, with edge functions that leave no gap between neighbors \[Woop2013\] and boxes that lose nothing to
//! rounding \[Ize2013\]. Light that leaks through an edge would stay in a light-transport matrix for good.
//!
//! Results depend on the triangles alone: neither on threads nor on the machine's vector instructions.

mod beam;
mod build;
mod collapse;
mod dispatch;
mod fan;
mod lanes;
mod node;
mod packet;
mod ray;
mod stack;
#[cfg(test)]
mod tests;
mod traverse;
mod triangle;
mod words;

use glam::Vec3;

use build::Tree;
use dispatch::Instructions;
use fan::{FAN, Fan};
use node::{Block, Node};
use packet::Packet;
pub use words::TreeWords;

use crate::stop::{Stop, Stopped};

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
        Bvh::build_until(triangles, ids, &Stop::default()).expect("nobody else has this stop")
    }

    /// The same as [`Bvh::build`], if nobody asks for a stop meanwhile.
    ///
    /// # Errors
    /// When somebody does.
    ///
    /// # Panics
    /// As [`Bvh::build`].
    pub fn build_until(triangles: &[[Vec3; 3]], ids: &[u32], stop: &Stop) -> Result<Bvh, Stopped> {
        Ok(Bvh { tree: Tree::build(triangles, ids, stop)?, instructions: Instructions::detect() })
    }

    /// The closest hit; among hits at the same t, the smallest id. None for a ray that is not finite.
    pub fn closest(&self, ray: &Ray) -> Option<Hit> {
        if !can_be_followed(ray) {
            return None;
        }
        dispatch::closest(self.instructions, &self.tree, ray)
    }

    /// Whether the ray hits anything: as [`Bvh::closest`], without looking for the closest.
    pub fn occluded(&self, ray: &Ray) -> bool {
        can_be_followed(ray) && dispatch::occluded(self.instructions, &self.tree, ray)
    }

    /// Which of the segments from `origin` to the first `n` targets are free: bit i is set when [`Bvh::occluded`] is false for
    /// the ray towards `targets[i]`, with `t_min` and `t_max` as fractions of the segment. Fast when the targets are close to
    /// each other, right when they are not.
    ///
    /// # Panics
    /// When `n` is more than 16.
    pub fn visible16(&self, origin: Vec3, targets: &[Vec3; 16], n: usize, t_min: f32, t_max: f32) -> u16 {
        assert!(n <= FAN, "a fan of {n} segments where {FAN} are the most");
        let asked = ((1_u32 << n) - 1) as u16;
        if !origin.is_finite() {
            return asked;
        }
        let fan = Fan::new(origin, targets, asked, [t_min, t_max]);
        asked & !dispatch::fan_occluded(self.instructions, &self.tree, &fan)
    }

    /// The closest hits of the first `n` rays that leave `origin`, each up to its `t_max`: what [`Bvh::closest`] finds for each, to
    /// the bit, and among hits at the same t the one that it finds. Fast when the directions are close to each other, as those of
    /// neighboring pixels are, right when they are not.
    ///
    /// # Panics
    /// When `n` is more than 16.
    pub fn closest16(
        &self,
        origin: Vec3,
        directions: &[Vec3; 16],
        n: usize,
        t_min: f32,
        t_max: &[f32; 16],
    ) -> [Option<Hit>; 16] {
        assert!(n <= FAN, "a packet of {n} rays where {FAN} are the most");
        if !origin.is_finite() {
            return [None; FAN];
        }
        let packet = Packet::new(origin, directions, ((1_u32 << n) - 1) as u16, t_min, t_max);
        dispatch::packet_closest(self.instructions, &self.tree, &packet)
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

/// Whether arithmetic can follow a ray.
#[inline]
fn can_be_followed(ray: &Ray) -> bool {
    let finite = ray.origin.is_finite() && ray.direction.is_finite();
    finite && ray.direction.abs().max_element() >= SHORTEST
}

/// The least longest component of a direction: below it the reciprocal overflows.
const SHORTEST: f32 = f32::MIN_POSITIVE;

/// The number, or +0 in place of what is negative or NaN.
#[inline(always)]
fn not_negative(number: f32) -> f32 {
    if number > 0.0 { number } else { 0.0 }
}
