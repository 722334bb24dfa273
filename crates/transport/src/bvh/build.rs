//! Builds the tree: obvhs clusters triangles into a binary one, which is then collapsed to eight children a node.

use std::collections::HashMap;

use glam::{Vec3, Vec3A};
use obvhs::aabb::Aabb as BuilderAabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use rayon::prelude::*;

use super::Aabb;
use super::collapse::Collapse;
use super::node::{Block, Child, Node};
use crate::stop::{Stop, Stopped};

/// Clusters are matched over the full search distance from the first level on: merging the lowest levels blindly, as the
/// builder's own presets do, multiplies the work per ray on scenes of evenly sized triangles.
const BLIND_LEVELS: usize = 0;
/// Share of the nodes that are tried elsewhere in the tree, per pass.
const REINSERTED: f32 = 0.1;
/// Each odd number is a pass over that part of the share, as the optimizer has them by itself: one by one, a stop is seen between.
const PASSES: std::ops::Range<u16> = 1..32;
/// Beyond this coordinate (m) the areas of boxes leave the range of `f32`.
const FARTHEST: f32 = 1e18;

/// Most equal boxes that the builder gets. It pairs boxes that are each other's nearest; among equals these are two a pass, so
/// that its time is quadratic and its tree a chain.
const MAX_EQUAL: usize = 1000;
/// Most by which the others grow, relative to their longest side.
const MOST_GROWTH: f32 = 1e-3;

/// A tree without the code that walks it.
#[derive(Clone, Debug)]
pub(super) struct Tree {
    /// The root is the first.
    pub nodes: Vec<Node>,
    pub blocks: Vec<Block>,
    pub bounds: Aabb,
    pub n_triangles: usize,
    /// Levels of nodes.
    pub depth: usize,
}

impl Tree {
    /// Builds the tree of those triangles that have an area and finite corners.
    pub fn build(triangles: &[[Vec3; 3]], ids: &[u32], stop: &Stop) -> Result<Tree, Stopped> {
        assert_eq!(triangles.len(), ids.len(), "one id for each triangle");
        let kept: Vec<u32> =
            (0..).zip(triangles).filter(|(_, triangle)| can_be_hit(triangle)).map(|(index, _)| index).collect();
        let mut tree = Tree {
            nodes: vec![Node::vacant()],
            blocks: Vec::new(),
            bounds: Aabb::EMPTY,
            n_triangles: kept.len(),
            depth: 1,
        };
        if kept.is_empty() {
            return Ok(tree);
        }
        stop.check()?;
        let mut boxes: Vec<BuilderAabb> = kept.iter().map(|&index| box_of(&triangles[index as usize])).collect();
        tell_apart(&mut boxes);
        stop.check()?;
        let binary = build_binary(&boxes, stop)?;
        drop(boxes);
        tree.bounds = bounds_of(&binary, 0);
        let collapse = Collapse::new(&binary);
        stop.check()?;
        tree.emit(&binary, &collapse, |triangle| {
            let index = kept[triangle as usize] as usize;
            (&triangles[index], ids[index])
        });
        Ok(tree)
    }

    /// Writes the wide nodes, siblings side by side, and the blocks under them.
    fn emit<'t>(&mut self, binary: &Bvh2, collapse: &Collapse, triangle: impl Fn(u32) -> (&'t [Vec3; 3], u32)) {
        let mut pending = vec![(0, 0, 1)];
        while let Some((root, wide, depth)) = pending.pop() {
            self.depth = self.depth.max(depth);
            for (slot, child) in collapse.under(root).into_iter().enumerate() {
                let target = if let Some(held) = collapse.block(child) {
                    let mut block = Block::vacant();
                    for (lane, index) in held.into_iter().enumerate() {
                        let (corners, id) = triangle(index);
                        block.fill(lane, corners, id);
                    }
                    self.blocks.push(block);
                    Child::block(self.blocks.len() - 1)
                } else {
                    self.nodes.push(Node::vacant());
                    pending.push((child, self.nodes.len() - 1, depth + 1));
                    Child::node(self.nodes.len() - 1)
                };
                self.nodes[wide].fill(slot, bounds_of(binary, child), target);
            }
        }
        self.nodes.shrink_to_fit();
        self.blocks.shrink_to_fit();
    }
}

fn build_binary(boxes: &[BuilderAabb], stop: &Stop) -> Result<Bvh2, Stopped> {
    let order = (0..boxes.len() as u32).collect();
    let mut binary = PlocBuilder::with_capacity(boxes.len()).build(
        PlocSearchDistance::Low,
        boxes,
        order,
        SortPrecision::U64,
        BLIND_LEVELS,
    );
    let mut optimizer = ReinsertionOptimizer::default();
    for divisor in PASSES.step_by(2) {
        stop.check()?;
        optimizer.run(&mut binary, REINSERTED, Some(vec![1.0 / divisor as f32]));
    }
    stop.check()?;
    Ok(binary)
}

/// Grows boxes that many others equal, each by another amount, about its center.
fn tell_apart(boxes: &mut [BuilderAabb]) {
    let hashes: Vec<u64> = boxes.par_iter().map(hash_of).collect();
    let mut sorted = hashes.clone();
    sorted.par_sort_unstable();
    // In nearly all scenes that is all: a run of equal ones is found without counting any.
    if sorted.iter().zip(sorted.iter().skip(MAX_EQUAL)).all(|(one, other)| one != other) {
        return;
    }
    let mut n_equal: HashMap<u64, usize> = HashMap::new();
    for (bounds, hash) in boxes.iter_mut().zip(hashes) {
        let nth = n_equal.entry(hash).or_insert(0);
        *nth += 1;
        if *nth > MAX_EQUAL {
            // Multiples of the golden ratio: near ones differ.
            let share = ((*nth as u32).wrapping_mul(0x9E37_79B9) >> 8) as f32 / 16_777_216.0;
            let longest = (bounds.max - bounds.min).max_element();
            let resolvable = 64.0 * f32::EPSILON * bounds.min.abs().max(bounds.max.abs()).max_element();
            let growth = Vec3A::splat(share * (MOST_GROWTH * longest + resolvable));
            (bounds.min, bounds.max) = (bounds.min - growth, bounds.max + growth);
        }
    }
}

fn hash_of(bounds: &BuilderAabb) -> u64 {
    [bounds.min.to_array(), bounds.max.to_array()].as_flattened().iter().fold(0, |hash: u64, side| {
        (hash ^ u64::from(side.to_bits())).wrapping_mul(0x9E37_79B9_7F4A_7C15).rotate_left(29)
    })
}

/// Whether a triangle has an area and corners that arithmetic can hold.
fn can_be_hit(triangle: &[Vec3; 3]) -> bool {
    let finite = triangle.iter().all(|corner| corner.abs().max_element() <= FARTHEST && !corner.is_nan());
    let [a, b, c] = triangle.map(Vec3::as_dvec3);
    finite && (b - a).cross(c - a).length_squared() > 0.0
}

fn box_of(triangle: &[Vec3; 3]) -> BuilderAabb {
    let [a, b, c] = *triangle;
    BuilderAabb::new(a.min(b).min(c).into(), a.max(b).max(c).into())
}

fn bounds_of(binary: &Bvh2, node: usize) -> Aabb {
    let bounds = binary.nodes[node].aabb();
    Aabb { min: bounds.min.into(), max: bounds.max.into() }
}
