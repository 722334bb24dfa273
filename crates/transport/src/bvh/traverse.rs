//! One ray through the tree: nearest first for the closest hit, any order for any hit.

use super::build::Tree;
use super::lanes::Lanes;
use super::node::{BLOCK, Child, Node, WIDTH};
use super::ray::{BoxRay, TriangleRay};
use super::stack::{Room, Stack, entry, unpack};
use super::{Hit, Ray};

/// The closest hit within the ray's interval.
#[inline(always)]
pub(super) fn closest<W: Lanes<WIDTH>, Q: Lanes<BLOCK>>(tree: &Tree, ray: &Ray, room: Room) -> Option<Hit> {
    let (box_ray, triangle_ray) = (BoxRay::<W>::new(ray), TriangleRay::<Q>::new(ray));
    // No id is below 0, so that a first hit is closer than `t_max`, not as far.
    let mut hit = Hit { t: ray.t_max, u: 0.0, v: 0.0, triangle: 0 };
    let mut stack = Stack::new(room);
    stack.push(entry(0.0, Child::node(0)));
    while let Some(top) = stack.pop() {
        let (near, mut child) = unpack(top);
        if near > hit.t {
            continue;
        }
        while !child.is_block() {
            let node = &tree.nodes[child.index()];
            let (entered, near) = box_ray.enter(node, hit.t);
            match nearest(node, entered, near, &mut stack) {
                Some(next) => child = next,
                None => break,
            }
        }
        if child.is_block() {
            triangle_ray.closest(&tree.blocks[child.index()], &mut hit);
        }
    }
    (hit.t < ray.t_max).then_some(hit)
}

/// The nearest of the entered children; the others go on the stack, nearest on top.
#[inline(always)]
fn nearest<W: Lanes<WIDTH>>(node: &Node, entered: u32, near: W, stack: &mut Stack) -> Option<Child> {
    if entered == 0 {
        return None;
    }
    let first = entered.trailing_zeros() as usize;
    let mut others = entered & (entered - 1);
    if others == 0 {
        return Some(node.children[first]);
    }
    let near = near.store();
    let mut nearest = entry(near[first], node.children[first]);
    let floor = stack.len();
    while others != 0 {
        let slot = others.trailing_zeros() as usize;
        others &= others - 1;
        let other = entry(near[slot], node.children[slot]);
        stack.insert(nearest.max(other), floor);
        nearest = nearest.min(other);
    }
    Some(unpack(nearest).1)
}

/// Whether anything is hit within the ray's interval.
#[inline(always)]
pub(super) fn occluded<W: Lanes<WIDTH>, Q: Lanes<BLOCK>>(tree: &Tree, ray: &Ray, room: Room) -> bool {
    let (box_ray, triangle_ray) = (BoxRay::<W>::new(ray), TriangleRay::<Q>::new(ray));
    let mut stack = Stack::new(room);
    stack.push(entry(0.0, Child::node(0)));
    while let Some(top) = stack.pop() {
        let mut child = unpack(top).1;
        while !child.is_block() {
            let node = &tree.nodes[child.index()];
            let (entered, _) = box_ray.enter(node, ray.t_max);
            match any(node, entered, &mut stack) {
                Some(next) => child = next,
                None => break,
            }
        }
        if child.is_block() && triangle_ray.hits(&tree.blocks[child.index()], ray.t_max) {
            return true;
        }
    }
    false
}

/// Any of the entered children; the others go on the stack.
#[inline(always)]
pub(super) fn any(node: &Node, mut entered: u32, stack: &mut Stack) -> Option<Child> {
    if entered == 0 {
        return None;
    }
    loop {
        let child = node.children[entered.trailing_zeros() as usize];
        entered &= entered - 1;
        if entered == 0 {
            return Some(child);
        }
        stack.push(entry(0.0, child));
    }
}
