//! The layout of the tree: wide nodes and blocks of triangles, both in structure-of-arrays order.

use std::ops::Not;

use glam::Vec3;

use super::Aabb;

/// Children of a node.
pub(super) const WIDTH: usize = 8;
/// Triangles of a block.
pub(super) const BLOCK: usize = 4;
/// Factor on the far side of a box, so that rounding never loses a triangle inside it. \[Ize2013\]
pub(super) const FAR_SLACK: f32 = 1.0 + 1.0 / (1 << 20) as f32;

/// Eight boxes and what is inside them.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(super) struct Node {
    /// Lower x, y, z, upper x, y, z of the eight boxes. A vacant box is everted, and no ray enters it.
    pub planes: [[f32; WIDTH]; 6],
    /// What the boxes hold; vacant ones are never read.
    pub children: [Child; WIDTH],
}

impl Node {
    /// A node whose boxes are all vacant.
    pub fn vacant() -> Node {
        let (lower, upper) = ([f32::INFINITY; WIDTH], [f32::NEG_INFINITY; WIDTH]);
        Node { planes: [lower, lower, lower, upper, upper, upper], children: [Child::node(0); WIDTH] }
    }

    /// Puts `child` and its box into a slot.
    pub fn fill(&mut self, slot: usize, bounds: Aabb, child: Child) {
        for axis in 0..3 {
            self.planes[axis][slot] = bounds.min[axis];
            self.planes[axis + 3][slot] = bounds.max[axis];
        }
        self.children[slot] = child;
    }
}

/// A node, or a block of triangles: index and one bit that tells which.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(transparent)]
pub(super) struct Child(u32);

const IS_BLOCK: u32 = 1 << 31;

impl Child {
    /// The node of this index.
    pub fn node(index: usize) -> Child {
        Child(small(index))
    }

    /// The block of this index.
    pub fn block(index: usize) -> Child {
        Child(small(index) | IS_BLOCK)
    }

    /// As it was given by [`Child::bits`].
    #[inline(always)]
    pub fn from_bits(bits: u32) -> Child {
        Child(bits)
    }

    /// For the traversal stack.
    #[inline(always)]
    pub fn bits(self) -> u32 {
        self.0
    }

    /// Whether triangles come next.
    #[inline(always)]
    pub fn is_block(self) -> bool {
        self.0 & IS_BLOCK != 0
    }

    /// Into the nodes or the blocks.
    #[inline(always)]
    pub fn index(self) -> usize {
        (self.0 & IS_BLOCK.not()) as usize
    }
}

fn small(index: usize) -> u32 {
    assert!(index < IS_BLOCK as usize, "a tree of {index} nodes does not fit 31 bits");
    index as u32
}

/// Up to four triangles.
#[derive(Clone, Debug)]
#[repr(C, align(32))]
pub(super) struct Block {
    /// Vertex × axis × lane, world space. Vacant lanes are NaN, and no ray hits them.
    pub vertices: [[[f32; BLOCK]; 3]; 3],
    /// What a hit reports, by lane.
    pub ids: [u32; BLOCK],
}

impl Block {
    /// A block without triangles.
    pub fn vacant() -> Block {
        Block { vertices: [[[f32::NAN; BLOCK]; 3]; 3], ids: [u32::MAX; BLOCK] }
    }

    /// Puts a triangle into a lane.
    pub fn fill(&mut self, lane: usize, triangle: &[Vec3; 3], id: u32) {
        for (of_vertex, position) in self.vertices.iter_mut().zip(triangle) {
            for (of_axis, coordinate) in of_vertex.iter_mut().zip(position.to_array()) {
                of_axis[lane] = coordinate;
            }
        }
        self.ids[lane] = id;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_fill_four_cache_lines_and_blocks_two_and_a_half() {
        assert_eq!(size_of::<Node>(), 256);
        assert_eq!(size_of::<Block>(), 160);
    }
}
