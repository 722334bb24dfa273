//! A tree of boxes around slabs, so that a way asks only those near it.

use glam::Vec3;

use super::Bounds;

/// Slabs of a leaf at most; the words of a device have room for seven.
const LEAF: usize = 4;

/// Nodes, each before all below it.
#[derive(Debug, Default)]
pub(super) struct Tree {
    pub(super) nodes: Vec<Node>,
    /// Slabs, leaf by leaf.
    pub(super) slabs: Vec<u32>,
}

#[derive(Debug)]
pub(super) struct Node {
    pub(super) bounds: Bounds,
    /// The first node that is not below.
    pub(super) next: usize,
    /// First and number of its own slabs; none of a fork.
    pub(super) first: usize,
    pub(super) n: usize,
}

impl Tree {
    /// Over slabs with these boxes.
    pub(super) fn new(boxes: &[Bounds]) -> Tree {
        let mut slabs: Vec<u32> = (0..boxes.len() as u32).collect();
        let mut nodes = Vec::new();
        if !boxes.is_empty() {
            add(&mut nodes, boxes, (&mut slabs, 0));
        }
        Tree { nodes, slabs }
    }

    /// The box around all.
    fn bounds(&self) -> Bounds {
        self.nodes.first().map_or_else(Bounds::default, |root| root.bounds)
    }

    /// Slabs whose boxes a segment may meet.
    #[inline]
    pub(super) fn each_on(&self, [from, to]: [Vec3; 2], visit: impl FnMut(u32)) {
        let span = Bounds::default().with(from).with(to);
        if self.bounds().overlaps(&span) {
            let inverse = 1.0 / (to - from);
            self.each(|bounds| bounds.overlaps(&span) && bounds.is_met(from, inverse), visit);
        }
    }

    /// Slabs of all leaves that are met, and whose forks are.
    #[inline]
    pub(super) fn each(&self, is_met: impl Fn(&Bounds) -> bool, mut visit: impl FnMut(u32)) {
        let mut at = 0;
        while let Some(node) = self.nodes.get(at) {
            if is_met(&node.bounds) {
                self.slabs[node.first..][..node.n].iter().for_each(|&slab| visit(slab));
                at += 1;
            } else {
                at = node.next;
            }
        }
    }
}

/// Adds a node over some slabs, the first of which is the `first` of all, and what is below it.
fn add(nodes: &mut Vec<Node>, boxes: &[Bounds], (slabs, first): (&mut [u32], usize)) {
    let middle = |slab: u32| boxes[slab as usize].lo + boxes[slab as usize].hi;
    let around = |all: Bounds, slab: &u32| all.with(boxes[*slab as usize].lo).with(boxes[*slab as usize].hi);
    let bounds = slabs.iter().fold(Bounds::default(), around);
    let (at, is_leaf) = (nodes.len(), slabs.len() <= LEAF);
    nodes.push(Node { bounds, next: 0, first, n: if is_leaf { slabs.len() } else { 0 } });
    if !is_leaf {
        let spread = slabs.iter().fold(Bounds::default(), |all, &slab| all.with(middle(slab)));
        let axis = (spread.hi - spread.lo).max_position();
        let half = slabs.len() / 2;
        slabs.select_nth_unstable_by(half, |&a, &b| middle(a)[axis].total_cmp(&middle(b)[axis]).then(a.cmp(&b)));
        let (low, high) = slabs.split_at_mut(half);
        add(nodes, boxes, (low, first));
        add(nodes, boxes, (high, first + half));
    }
    nodes[at].next = nodes.len();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampler::Sampler;

    #[test]
    fn each_box_on_a_segment_is_found_once_and_few_others() {
        let point = |case: u64| {
            let mut sampler = Sampler::new(5, case, 0);
            let [x, y] = sampler.next_2d();
            Vec3::new(x, y, sampler.next_1d()) * 10.0
        };
        for n in [0, 1, 4, 5, 300] {
            let boxes: Vec<Bounds> = (0..n).map(|i| Bounds::default().with(point(i)).grown(Vec3::splat(0.2))).collect();
            let tree = Tree::new(&boxes);
            let (mut n_asked, mut n_met) = (0, 0);
            for [from, to] in (0..200).map(|case| [point(1000 + 2 * case), point(1001 + 2 * case)]) {
                let mut asked = Vec::new();
                tree.each_on([from, to], |slab| asked.push(slab));
                asked.sort_unstable();
                assert!(asked.is_sorted_by(|a, b| a < b), "{asked:?}");
                let is_met = |slab: &u32| boxes[*slab as usize].is_met(from, 1.0 / (to - from));
                let met: Vec<u32> = (0..n as u32).filter(is_met).collect();
                assert!(met.iter().all(|slab| asked.contains(slab)), "{met:?} {asked:?}");
                (n_asked, n_met) = (n_asked + asked.len(), n_met + met.len());
            }
            assert!(n < 300 || (n_met > 50 && n_asked < 200 * 20), "{n_asked} {n_met}");
        }
    }
}
