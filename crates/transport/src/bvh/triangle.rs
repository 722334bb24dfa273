//! The watertight intersection of rays and triangles \[Woop2013\].
//!
//! Vertices are sheared so that the ray becomes an axis; then signs of edge functions decide. The two products of an edge
//! function must round alike: the neighbor across the edge then computes its exact negative, and no ray slips between.

use glam::Vec3;

use super::lanes::{Lanes, three};

/// The axis along which a direction is longest, then the other two.
#[inline(always)]
pub(super) fn axes_of(direction: Vec3) -> [usize; 3] {
    let size = direction.abs();
    if size.x > size.y && size.x > size.z {
        [0, 1, 2]
    } else if size.y > size.z {
        [1, 2, 0]
    } else {
        [2, 0, 1]
    }
}

/// A component of a vector, looked up rather than branched to: which it is changes from ray to ray.
#[inline(always)]
pub(super) fn component(vector: Vec3, axis: usize) -> f32 {
    vector.to_array()[axis]
}

/// What turns directions into the longest axis, in the order of [`axes_of`].
#[derive(Clone, Copy)]
pub(super) struct Shear<V> {
    /// Direction over its longest component, on the other two axes.
    pub slopes: [V; 2],
    /// Reciprocal of the longest component: the ray's parameter per length along that axis.
    pub per_length: V,
}

impl<V> Shear<V> {
    /// From the components of directions, the longest first.
    #[inline(always)]
    pub fn new<const N: usize>(direction: [V; 3]) -> Self
    where
        V: Lanes<N>,
    {
        let per_length = V::splat(1.0) / direction[0];
        Shear { slopes: [direction[1] * per_length, direction[2] * per_length], per_length }
    }
}

/// Edge functions of triangles as rays see them.
pub(super) struct Edges<V> {
    /// Weight of each vertex, times the sum of them.
    pub weights: [V; 3],
    /// Of each vertex, along the longest axis from the ray's origin.
    lengths: [V; 3],
}

impl<V> Edges<V> {
    /// `corners` relative to the origins of the rays: vertex, then axis in the order of [`axes_of`].
    #[inline(always)]
    pub fn new<const N: usize>(corners: [[V; 3]; 3], shear: &Shear<V>) -> Self
    where
        V: Lanes<N>,
    {
        let [x, y] = shear.slopes;
        let [a, b, c] = three!(|i| [corners[i][1] - x * corners[i][0], corners[i][2] - y * corners[i][0]]);
        Edges {
            weights: [c[0] * b[1] - c[1] * b[0], a[0] * c[1] - a[1] * c[0], b[0] * a[1] - b[1] * a[0]],
            lengths: [corners[0][0], corners[1][0], corners[2][0]],
        }
    }

    /// Lanes whose line meets the triangle; edges belong to both neighbors.
    #[inline(always)]
    pub fn inside<const N: usize>(&self) -> u32
    where
        V: Lanes<N>,
    {
        let [u, v, w] = self.weights;
        let zero = V::splat(0.0);
        zero.at_most(u.min(v).min(w)) | u.max(v).max(w).at_most(zero)
    }

    /// Sum of the weights. Zero where a triangle is seen edge on.
    #[inline(always)]
    pub fn sum<const N: usize>(&self) -> V
    where
        V: Lanes<N>,
    {
        self.weights[0] + self.weights[1] + self.weights[2]
    }

    /// The ray's parameter at the plane of the triangle; NaN where it is seen edge on.
    #[inline(always)]
    pub fn parameter<const N: usize>(&self, shear: &Shear<V>) -> V
    where
        V: Lanes<N>,
    {
        let ([u, v, w], [a, b, c]) = (self.weights, self.lengths);
        (u * a + v * b + w * c) / self.sum() * shear.per_length
    }
}
