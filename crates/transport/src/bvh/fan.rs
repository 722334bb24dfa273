//! Up to sixteen segments from one point, together through the tree: a node costs what it costs a single ray.
//!
//! Segments with the same longest axis and the same sense along it form a beam; a fan onto a lamp or a panel is mostly one.

use glam::Vec3;

use super::beam::{BoxBeam, BoxMembers, Interval, TriangleBeam};
use super::build::Tree;
use super::lanes::{Lanes, three};
use super::node::{BLOCK, Child, WIDTH};
use super::stack::{Room, Stack, entry, unpack};
use super::traverse::{self, any};
use super::triangle::Shear;
use super::{Ray, SHORTEST, not_negative};

/// Segments of a fan.
pub(super) const FAN: usize = 16;
/// Registers of a fan.
pub(super) const HALVES: usize = FAN / WIDTH;

/// Slopes from which on a beam asks its members about each box: wider ones meet boxes that none of their members meets.
const WIDE: f32 = 0.12;
/// Nodes after which a beam gives up: among many small triangles it meets what none of its members does that are not blocked yet.
const LONG: u32 = 16;
/// Fewest segments that are worth a beam.
pub(super) const FEWEST: u32 = 3;

/// Segments from one point.
pub(super) struct Fan {
    pub origin: Vec3,
    /// From the origin to the targets: axis × segment.
    pub directions: [[f32; FAN]; 3],
    pub asked: u16,
    pub t_min: f32,
    t_max: f32,
}

/// Those segments of a fan that go along the same axis, the same way.
pub(super) struct Beam {
    pub origin: Vec3,
    /// Axis × segment, longest axis first; lanes that are not members repeat one.
    pub directions: [[f32; FAN]; 3],
    pub axes: [usize; 3],
    /// Against the longest axis.
    pub backward: bool,
    pub members: u16,
    pub t_min: f32,
    pub t_max: f32,
}

/// Segments by what their directions are like; bit i is segment i.
pub(super) struct Kinds {
    /// Finite and not vanishing.
    pub can_be_followed: u16,
    /// By longest axis.
    longest: [u16; 3],
    /// By axis, those that go against it.
    backward: [u16; 3],
}

impl Fan {
    /// Segments to the targets whose bits are set in `asked`, for t between the two.
    #[inline(always)]
    pub fn new(origin: Vec3, targets: &[Vec3; FAN], asked: u16, ends: [f32; 2]) -> Fan {
        let mut along = *targets;
        for target in &mut along {
            *target -= origin;
        }
        Fan::along(origin, &along, asked, ends)
    }

    /// Segments along the directions whose bits are set in `asked`, for t between the two.
    #[inline(always)]
    pub fn along(origin: Vec3, along: &[Vec3; FAN], asked: u16, [t_min, t_max]: [f32; 2]) -> Fan {
        let mut directions = [[0.0; FAN]; 3];
        for (segment, direction) in along.iter().enumerate() {
            directions[0][segment] = direction.x;
            directions[1][segment] = direction.y;
            directions[2][segment] = direction.z;
        }
        Fan { origin, directions, asked, t_min: not_negative(t_min), t_max }
    }

    /// The direction of a segment.
    #[inline(always)]
    pub fn direction(&self, segment: usize) -> Vec3 {
        let [x, y, z] = &self.directions;
        Vec3::new(x[segment], y[segment], z[segment])
    }

    /// The segments that hit something.
    #[inline(always)]
    pub fn occluded<W: Lanes<WIDTH>, Q: Lanes<BLOCK>>(&self, tree: &Tree, mut room: Room) -> u16 {
        let kinds = self.kinds::<W>();
        let mut pending = self.asked & kinds.can_be_followed;
        let mut occluded = 0;
        while pending != 0 {
            let beam = self.beam(&kinds, pending);
            let [found, undecided] = beam.occluded::<W, Q>(tree, room.lent());
            occluded |= found | self.one_by_one::<W, Q>(undecided, tree, &mut room);
            pending &= !beam.members;
        }
        occluded
    }

    /// The members that hit something, each followed by itself.
    #[inline(always)]
    fn one_by_one<W: Lanes<WIDTH>, Q: Lanes<BLOCK>>(&self, members: u16, tree: &Tree, room: &mut Room) -> u16 {
        let mut occluded = 0;
        let mut pending = members;
        while pending != 0 {
            let segment = pending.trailing_zeros() as usize;
            pending &= pending - 1;
            let direction = self.direction(segment);
            let ray = Ray { origin: self.origin, direction, t_min: self.t_min, t_max: self.t_max };
            occluded |= u16::from(traverse::occluded::<W, Q>(tree, &ray, room.lent())) << segment;
        }
        occluded
    }

    #[inline(always)]
    pub fn kinds<W: Lanes<WIDTH>>(&self) -> Kinds {
        let (zero, largest, shortest) = (W::splat(0.0), W::splat(f32::MAX), W::splat(SHORTEST));
        let mut kinds = Kinds { can_be_followed: 0, longest: [0; 3], backward: [0; 3] };
        for half in 0..HALVES {
            let direction = three!(|axis| W::load(half_of(&self.directions[axis], half)));
            let [x, y, z] = three!(|axis| direction[axis].max(zero - direction[axis]));
            let finite = x.at_most(largest) & y.at_most(largest) & z.at_most(largest);
            let followed = finite & shortest.at_most(x.max(y).max(z));
            let along_x = y.below(x) & z.below(x);
            let along_y = z.below(y) & !along_x;
            let shift = half * WIDTH;
            kinds.can_be_followed |= (followed << shift) as u16;
            kinds.longest[0] |= (along_x << shift) as u16;
            kinds.longest[1] |= (along_y << shift) as u16;
            for (backward, components) in kinds.backward.iter_mut().zip(direction) {
                *backward |= (components.below(zero) << shift) as u16;
            }
        }
        kinds.longest[2] = !(kinds.longest[0] | kinds.longest[1]);
        kinds
    }

    /// The first of `pending` and all that go its way.
    #[inline(always)]
    pub fn beam(&self, kinds: &Kinds, pending: u16) -> Beam {
        let first = pending.trailing_zeros() as usize;
        let has_first = |kind: u16| kind >> first & 1 == 1;
        let axes = match kinds.longest.map(has_first) {
            [true, _, _] => [0, 1, 2],
            [_, true, _] => [1, 2, 0],
            _ => [2, 0, 1],
        };
        let backward = has_first(kinds.backward[axes[0]]);
        let same_way = if backward { kinds.backward[axes[0]] } else { !kinds.backward[axes[0]] };
        let members = pending & kinds.longest[axes[0]] & same_way;
        let mut directions = three!(|i| self.directions[axes[i]]);
        let mut strangers = !members;
        while strangers != 0 {
            let stranger = strangers.trailing_zeros() as usize;
            strangers &= strangers - 1;
            for components in &mut directions {
                components[stranger] = components[first];
            }
        }
        Beam { origin: self.origin, directions, axes, backward, members, t_min: self.t_min, t_max: self.t_max }
    }
}

impl Beam {
    /// The members that hit something, and those for which a beam is not worth it.
    #[inline(always)]
    fn occluded<W: Lanes<WIDTH>, Q: Lanes<BLOCK>>(&self, tree: &Tree, room: Room) -> [u16; 2] {
        if self.members.count_ones() < FEWEST {
            return [0, self.members];
        }
        let shears = self.shears::<W>();
        let slopes = slopes_of(&shears);
        let is_wide = slopes[0].width().max(slopes[1].width()) > WIDE;
        let members = if is_wide { BoxMembers::<W>::new(self) } else { None };
        if is_wide && members.is_none() {
            return [0, self.members];
        }
        let mut n_nodes = 0;
        let boxes = BoxBeam::<W>::new(self, slopes);
        let triangles = TriangleBeam::<W, Q>::new(self, slopes, shears);
        let mut free = self.members;
        let mut stack = Stack::new(room);
        stack.push(entry(0.0, Child::node(0)));
        while let Some(top) = stack.pop() {
            let mut child = unpack(top).1;
            while !child.is_block() {
                let node = &tree.nodes[child.index()];
                n_nodes += 1;
                if n_nodes > LONG {
                    return [self.members & !free, free];
                }
                let mut entered = boxes.enter(node);
                if let Some(members) = &members {
                    entered = members.confirm(node, entered, free);
                }
                match any(node, entered, &mut stack) {
                    Some(next) => child = next,
                    None => break,
                }
            }
            if child.is_block() {
                free &= !triangles.hits(&tree.blocks[child.index()], free);
                if free == 0 {
                    break;
                }
            }
        }
        [self.members & !free, 0]
    }

    #[inline(always)]
    pub fn shears<W: Lanes<WIDTH>>(&self) -> [Shear<W>; HALVES] {
        let direction = |half| three!(|i| W::load(half_of(&self.directions[i], half)));
        [Shear::new(direction(0)), Shear::new(direction(1))]
    }

    /// The shortest and the longest member along the longest axis.
    #[inline(always)]
    pub fn lengths(&self) -> Interval {
        let [low, high] = [0, 1].map(|half| half_of(&self.directions[0], half));
        let signed = Interval::of(&[*low, *high]);
        if self.backward { signed.negated() } else { signed }
    }
}

/// Least and greatest slopes on the other two axes.
#[inline(always)]
pub(super) fn slopes_of<W: Lanes<WIDTH>>(shears: &[Shear<W>; HALVES]) -> [Interval; 2] {
    let of_axis = |i: usize| Interval::of(&[shears[0].slopes[i].store(), shears[1].slopes[i].store()]);
    [of_axis(0), of_axis(1)]
}

#[inline(always)]
pub(super) fn half_of(values: &[f32; FAN], half: usize) -> &[f32; WIDTH] {
    values[half * WIDTH..][..WIDTH].try_into().expect("two halves make a fan")
}
