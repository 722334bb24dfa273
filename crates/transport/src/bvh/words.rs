//! The tree as plain words, for rays on a device.

use super::Bvh;
use super::build::Tree;

/// Nodes of 14 rows (the planes of eight boxes as bits of f32, lower x, y, z, then upper ones, two rows each; then the children), and
/// blocks of 10 rows (corner × axis of four triangles as bits of f32, then their ids). Children with the highest bit set are blocks.
#[derive(Clone, Debug, Default)]
pub struct TreeWords {
    /// The root is the first.
    pub nodes: Vec<[u32; 4]>,
    /// Ids of vacant triangles are [`u32::MAX`].
    pub blocks: Vec<[u32; 4]>,
    /// Where the root of a second tree is.
    pub second: Option<u32>,
    /// Solid panes that bend light: a row for all of them, two for each node of a tree around them, eight for each pane, three for each
    /// triangle of their faces.
    pub slabs: Vec<[u32; 4]>,
}

/// Rows of a node and of a block.
const NODE_ROWS: usize = 14;
const BLOCK_ROWS: usize = 10;
/// Planes of vacant boxes: devices need not know infinity.
const FAR_OUT: f32 = 1e20;

impl TreeWords {
    /// One tree or two in one.
    pub(crate) fn new(first: &Bvh, second: Option<&Bvh>) -> TreeWords {
        let mut words = TreeWords::default();
        words.push(&first.tree);
        if let Some(second) = second {
            words.second = Some((words.nodes.len() / NODE_ROWS) as u32);
            words.push(&second.tree);
        }
        words
    }

    fn push(&mut self, tree: &Tree) {
        let (n_nodes, n_blocks) = (self.nodes.len() / NODE_ROWS, self.blocks.len() / BLOCK_ROWS);
        for node in &tree.nodes {
            let planes = node.planes.as_flattened().as_chunks::<4>().0;
            self.nodes.extend(planes.iter().map(|row| row.map(|plane| plane.clamp(-FAR_OUT, FAR_OUT).to_bits())));
            let children =
                node.children.map(|child| child.bits() + if child.is_block() { n_blocks } else { n_nodes } as u32);
            self.nodes.extend(children.as_chunks::<4>().0);
        }
        for block in &tree.blocks {
            let corners = block.vertices.as_flattened().iter();
            self.blocks.extend(corners.map(|row| row.map(|x| if x.is_nan() { 0 } else { x.to_bits() })));
            self.blocks.push(block.ids);
        }
    }
}
