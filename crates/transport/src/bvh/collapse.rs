//! From two children a node to eight, at the least expected cost \[Ylitie2017\].
//!
//! `cost[n][i]` is the cheapest way to hold the subtree of `n` in at most i trees, each a block or a wide node. Blocks of a
//! few triangles cost the same whether full or not, as all lanes are tested at once.

use obvhs::bvh2::Bvh2;

use super::node::{BLOCK, WIDTH};

/// Cost of a block of triangles relative to that of a node.
const BLOCK_COST: f32 = 0.5;
/// At most this many trees come from one side of a node.
const MOST_TREES: usize = WIDTH - 1;

/// How each subtree of a binary tree is best held.
pub(super) struct Collapse<'a> {
    tree: &'a Bvh2,
    choices: Vec<Choice>,
}

#[derive(Clone, Copy, Default)]
struct Choice {
    /// `from_left[i - 1]`: of i trees, how many hold the left side; 0: one tree fewer is as good.
    from_left: [u8; WIDTH],
    /// Triangles of the subtree, at most one more than fit a block.
    n_triangles: u8,
    /// A single tree is a block.
    is_block: bool,
}

/// Expected cost with at most 1, 2, … trees.
type Costs = [f32; MOST_TREES];

impl<'a> Collapse<'a> {
    /// Finds the best way for every subtree. The leaves of `tree` hold a triangle each.
    pub fn new(tree: &'a Bvh2) -> Self {
        let mut collapse = Collapse { tree, choices: vec![Choice::default(); tree.nodes.len()] };
        let mut costs = vec![Costs::default(); tree.nodes.len()];
        let root_area = tree.nodes[0].aabb().half_area().max(f32::MIN_POSITIVE);
        for &node in parents_first(tree).iter().rev() {
            let area = tree.nodes[node].aabb().half_area() / root_area;
            costs[node] = collapse.decide(node, area, &costs);
        }
        collapse
    }

    fn decide(&mut self, node: usize, area: f32, costs: &[Costs]) -> Costs {
        if self.tree.nodes[node].is_leaf() {
            self.choices[node] = Choice { n_triangles: 1, is_block: true, ..Choice::default() };
            return [BLOCK_COST * area; MOST_TREES];
        }
        let (left, right) = self.children(node);
        let mut choice = Choice::default();
        let n_triangles = self.choices[left].n_triangles + self.choices[right].n_triangles;
        choice.n_triangles = n_triangles.min(BLOCK as u8 + 1);

        // One tree: a block, or a node over the best eight.
        let mut own = Costs::default();
        let (over_eight, from_left) = distribute(&costs[left], &costs[right], WIDTH);
        choice.from_left[WIDTH - 1] = from_left;
        let as_block = if usize::from(n_triangles) <= BLOCK { BLOCK_COST * area } else { f32::INFINITY };
        choice.is_block = as_block <= area + over_eight;
        own[0] = if choice.is_block { as_block } else { area + over_eight };

        // More trees: shared out between the sides, where that is better than one tree fewer.
        for n_trees in 2..WIDTH {
            let (cost, from_left) = distribute(&costs[left], &costs[right], n_trees);
            let shared = cost < own[n_trees - 2];
            choice.from_left[n_trees - 1] = if shared { from_left } else { 0 };
            own[n_trees - 1] = if shared { cost } else { own[n_trees - 2] };
        }
        self.choices[node] = choice;
        own
    }

    /// The roots that a wide node over this subtree holds, at most eight.
    pub fn under(&self, node: usize) -> Vec<usize> {
        let mut roots = Vec::with_capacity(WIDTH);
        if self.tree.nodes[node].is_leaf() {
            roots.push(node);
        } else {
            self.share(node, WIDTH, &mut roots);
        }
        roots
    }

    /// The triangles of a subtree that is best a block, as indices into what the binary tree was built of.
    pub fn block(&self, node: usize) -> Option<Vec<u32>> {
        self.choices[node].is_block.then(|| {
            let mut triangles = Vec::with_capacity(BLOCK);
            self.gather(node, &mut triangles);
            triangles
        })
    }

    fn share(&self, node: usize, n_trees: usize, roots: &mut Vec<usize>) {
        let from_left = usize::from(self.choices[node].from_left[n_trees - 1]);
        let (left, right) = self.children(node);
        self.collect(left, from_left, roots);
        self.collect(right, n_trees - from_left, roots);
    }

    fn collect(&self, node: usize, most: usize, roots: &mut Vec<usize>) {
        let useful = (2..=most).rev().find(|&n_trees| self.choices[node].from_left[n_trees - 1] != 0);
        match useful {
            Some(n_trees) => self.share(node, n_trees, roots),
            None => roots.push(node),
        }
    }

    fn gather(&self, node: usize, triangles: &mut Vec<u32>) {
        if self.tree.nodes[node].is_leaf() {
            triangles.push(self.tree.primitive_indices[self.tree.nodes[node].first_index as usize]);
        } else {
            let (left, right) = self.children(node);
            self.gather(left, triangles);
            self.gather(right, triangles);
        }
    }

    fn children(&self, node: usize) -> (usize, usize) {
        children(self.tree, node)
    }
}

fn children(tree: &Bvh2, node: usize) -> (usize, usize) {
    let left = tree.nodes[node].first_index as usize;
    (left, left + 1)
}

/// The cheapest way to hold two sides in `n_trees` trees, and how many of them are the left side's.
fn distribute(left: &Costs, right: &Costs, n_trees: usize) -> (f32, u8) {
    let mut best = (f32::INFINITY, 1);
    for from_left in 1..n_trees {
        let cost = left[from_left - 1] + right[n_trees - from_left - 1];
        if cost < best.0 {
            best = (cost, from_left as u8);
        }
    }
    best
}

/// All nodes, each before those under it.
fn parents_first(tree: &Bvh2) -> Vec<usize> {
    let mut order = Vec::with_capacity(tree.nodes.len());
    let mut pending = vec![0];
    while let Some(node) = pending.pop() {
        order.push(node);
        if !tree.nodes[node].is_leaf() {
            let (left, right) = children(tree, node);
            pending.extend([right, left]);
        }
    }
    order
}
