//! A ray as boxes and blocks of triangles want it.
#![expect(unsafe_code, reason = "rows of a node and a block are picked by axis, always one of three")]

use super::lanes::{Lanes, three};
use super::node::{BLOCK, Block, FAR_SLACK, Node, WIDTH};
use super::triangle::{Edges, Shear, axes_of, component};
use super::{Hit, Ray, not_negative};

/// A ray against eight boxes.
pub(super) struct BoxRay<W> {
    origin: [W; 3],
    reciprocal: [W; 3],
    /// The same, with the slack of far sides: rounding never loses a triangle inside a box.
    far_reciprocal: [W; 3],
    t_min: W,
    /// Row of the plane that the ray meets first, by axis; the other lies three rows away.
    near_rows: [usize; 3],
    far_rows: [usize; 3],
}

impl<W: Lanes<WIDTH>> BoxRay<W> {
    #[inline(always)]
    pub fn new(ray: &Ray) -> Self {
        let (origin, reciprocal) = (ray.origin.to_array(), (1.0 / ray.direction).to_array());
        let near_rows = three!(|axis| axis + 3 * usize::from(reciprocal[axis].is_sign_negative()));
        BoxRay {
            origin: three!(|axis| W::splat(origin[axis])),
            reciprocal: three!(|axis| W::splat(reciprocal[axis])),
            far_reciprocal: three!(|axis| W::splat(reciprocal[axis] * FAR_SLACK)),
            t_min: W::splat(not_negative(ray.t_min)),
            near_rows,
            far_rows: three!(|axis| 2 * axis + 3 - near_rows[axis]),
        }
    }

    /// The boxes that the ray enters before `t_max`, and where. A ray within a plane of a box (NaN) meets that plane's slab.
    #[inline(always)]
    pub fn enter(&self, node: &Node, t_max: f32) -> (u32, W) {
        let (mut near, mut far) = (self.t_min, W::splat(t_max * FAR_SLACK));
        for axis in 0..3 {
            let origin = self.origin[axis];
            near = ((W::load(row_of(node, self.near_rows[axis])) - origin) * self.reciprocal[axis]).max(near);
            far = ((W::load(row_of(node, self.far_rows[axis])) - origin) * self.far_reciprocal[axis]).min(far);
        }
        (near.at_most(far), near)
    }
}

/// The planes in a row of a node: lower x, y, z, upper x, y, z.
#[inline(always)]
pub(super) fn row_of(node: &Node, row: usize) -> &[f32; WIDTH] {
    debug_assert!(row < 6);
    // SAFETY: rows are made of an axis, below three, and of nothing or three.
    unsafe { node.planes.get_unchecked(row) }
}

/// The corners of four triangles: vertex, then axis in the order of `axes`, both relative to `origin`.
#[inline(always)]
pub(super) fn corners_of<Q: Lanes<BLOCK>>(block: &Block, axes: [usize; 3], origin: [Q; 3]) -> [[Q; 3]; 3] {
    three!(|vertex| three!(|i| Q::load(coordinates_of(block, vertex, axes[i])) - origin[i]))
}

/// The coordinates of a vertex of four triangles.
#[inline(always)]
fn coordinates_of(block: &Block, vertex: usize, axis: usize) -> &[f32; BLOCK] {
    debug_assert!(axis < 3);
    // SAFETY: axes come from `axes_of` and are below three.
    unsafe { block.vertices[vertex].get_unchecked(axis) }
}

/// A ray against four triangles.
pub(super) struct TriangleRay<Q> {
    axes: [usize; 3],
    /// In the order of `axes`.
    origin: [Q; 3],
    shear: Shear<Q>,
    t_min: Q,
}

impl<Q: Lanes<BLOCK>> TriangleRay<Q> {
    #[inline(always)]
    pub fn new(ray: &Ray) -> Self {
        let axes = axes_of(ray.direction);
        TriangleRay {
            axes,
            origin: three!(|i| Q::splat(component(ray.origin, axes[i]))),
            shear: Shear::new(three!(|i| Q::splat(component(ray.direction, axes[i])))),
            t_min: Q::splat(not_negative(ray.t_min)),
        }
    }

    /// Whether any triangle of the block is hit before `t_max`.
    #[inline(always)]
    pub fn hits(&self, block: &Block, t_max: f32) -> bool {
        let edges = self.edges(block);
        let inside = edges.inside();
        inside != 0 && inside & self.between(edges.parameter(&self.shear), t_max) != 0
    }

    /// Replaces `hit` by a closer one; of several at the same distance, the smallest id stays.
    #[inline(always)]
    pub fn closest(&self, block: &Block, hit: &mut Hit) {
        let edges = self.edges(block);
        let inside = edges.inside();
        if inside == 0 {
            return;
        }
        let parameter = edges.parameter(&self.shear);
        let mut candidates = inside & self.t_min.below(parameter) & parameter.at_most(Q::splat(hit.t));
        let parameter = parameter.store();
        while candidates != 0 {
            let lane = candidates.trailing_zeros() as usize;
            candidates &= candidates - 1;
            let (t, triangle) = (parameter[lane], block.ids[lane]);
            if t < hit.t || (t == hit.t && triangle < hit.triangle) {
                let [_, u, v] = edges.weights;
                let sum = edges.sum();
                *hit = Hit { t, u: (u / sum).store()[lane], v: (v / sum).store()[lane], triangle };
            }
        }
    }

    #[inline(always)]
    fn between(&self, parameter: Q, t_max: f32) -> u32 {
        self.t_min.below(parameter) & parameter.below(Q::splat(t_max))
    }

    #[inline(always)]
    fn edges(&self, block: &Block) -> Edges<Q> {
        Edges::new(corners_of(block, self.axes, self.origin), &self.shear)
    }
}
