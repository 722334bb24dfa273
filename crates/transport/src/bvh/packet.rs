//! Up to sixteen rays from one point, together through the tree, to the closest hit of each.
//!
//! A beam of them, as of a fan, opens the boxes that it meets nearest first, up to the farthest that any member still looks. Each
//! answer is that of a ray by itself: a member takes hits of those blocks alone whose boxes it enters by the numbers of single rays.
//! Of these the closest is what a single ray finds, unless it lies before its own box, as rounding may have it, and another one
//! lies between the two: there a single ray finds what it comes to first. Such members, and those with hits at the same distance,
//! are followed again by themselves.

use glam::Vec3;

use super::beam::{BoxBeam, BoxMembers, Interval, TriangleBeam};
use super::build::Tree;
use super::fan::{Beam, FAN, FEWEST, Fan, HALVES, half_of, slopes_of};
use super::lanes::Lanes;
#[cfg(test)]
use super::lanes::Portable;
use super::node::{BLOCK, Child, Node, WIDTH};
use super::stack::{Room, Stack, entry, unpack};
use super::{Hit, Ray, traverse};

/// Slopes from which on rays go by themselves: boxes that the beam meets are mostly met by few of them.
const WIDE: f32 = 0.12;
/// Nodes after which a beam gives up: its members have parted.
const LONG: u32 = 64;
/// Most nodes of a tree whose children are numbered in 32 bits.
const MOST_NODES: usize = 1 << 29;
/// Factor on the distance up to which members look: hits that lie before their own boxes are to be met.
const BEYOND: f32 = 1.0 + 1.0 / (1 << 10) as f32;

/// Rays from one point, and how far each of them goes.
pub(super) struct Packet {
    rays: Fan,
    t_max: [f32; FAN],
}

/// The closest hits of a beam's members so far.
pub(super) struct Nearest<W> {
    /// Of the hit, the end of the ray where there is none, and 0 for lanes that are no members.
    t: [W; HALVES],
    /// The same, or where the box of the hit begins, if that is farther.
    limit: [W; HALVES],
    u: [W; HALVES],
    v: [W; HALVES],
    triangles: [u32; FAN],
    /// Members that hit something.
    hit: u16,
    /// Members with hits so close to each other that the order of boxes may decide.
    undecided: u16,
}

impl Packet {
    /// Rays along the directions whose bits are set in `asked`, for t from `t_min` to what each has.
    #[inline(always)]
    pub fn new(origin: Vec3, directions: &[Vec3; FAN], asked: u16, t_min: f32, t_max: &[f32; FAN]) -> Packet {
        Packet { rays: Fan::along(origin, directions, asked, [t_min, f32::INFINITY]), t_max: *t_max }
    }

    /// The closest hit of each ray.
    #[inline(always)]
    pub fn closest<W: Lanes<WIDTH>, Q: Lanes<BLOCK>>(&self, tree: &Tree, mut room: Room) -> [Option<Hit>; FAN] {
        let kinds = self.rays.kinds::<W>();
        let mut pending = self.rays.asked & kinds.can_be_followed & self.open::<W>();
        let mut hits = [None; FAN];
        while pending != 0 {
            let beam = self.rays.beam(&kinds, pending);
            let undecided = self.together::<W, Q>(&beam, tree, room.lent(), &mut hits);
            self.one_by_one::<W, Q>(undecided, tree, &mut room, &mut hits);
            pending &= !beam.members;
        }
        hits
    }

    /// Rays that end beyond where they begin; not those that end at NaN.
    #[inline(always)]
    fn open<W: Lanes<WIDTH>>(&self) -> u16 {
        let t_min = W::splat(self.rays.t_min);
        let of_half = |half: usize| t_min.below(W::load(half_of(&self.t_max, half)));
        (of_half(0) | of_half(1) << WIDTH) as u16
    }

    #[inline(always)]
    fn ray(&self, nth: usize) -> Ray {
        let Fan { origin, t_min, .. } = self.rays;
        Ray { origin, direction: self.rays.direction(nth), t_min, t_max: self.t_max[nth] }
    }

    /// The closest hit of each of `members`, followed by itself.
    #[inline(always)]
    fn one_by_one<W: Lanes<WIDTH>, Q: Lanes<BLOCK>>(
        &self,
        members: u16,
        tree: &Tree,
        room: &mut Room,
        hits: &mut [Option<Hit>; FAN],
    ) {
        let mut pending = members;
        while pending != 0 {
            let nth = pending.trailing_zeros() as usize;
            pending &= pending - 1;
            hits[nth] = traverse::closest::<W, Q>(tree, &self.ray(nth), room.lent());
        }
    }

    /// The closest hits of the members of a beam but for those that it returns, which go by themselves.
    #[inline(always)]
    fn together<W: Lanes<WIDTH>, Q: Lanes<BLOCK>>(
        &self,
        beam: &Beam,
        tree: &Tree,
        room: Room,
        hits: &mut [Option<Hit>; FAN],
    ) -> u16 {
        if beam.members.count_ones() < FEWEST || tree.nodes.len() > MOST_NODES {
            return beam.members;
        }
        let shears = beam.shears::<W>();
        let slopes = slopes_of(&shears);
        if slopes[0].width().max(slopes[1].width()) > WIDE {
            return beam.members;
        }
        let Some(members) = BoxMembers::<W>::new(beam) else { return beam.members };
        let boxes = BoxBeam::<W>::new(beam, slopes);
        let triangles = TriangleBeam::<W, Q>::new(beam, slopes, shears);
        let lengths = lengths_of::<W>(beam);
        let mut found = Nearest::<W>::new(beam.members, &self.t_max);
        let mut farthest = found.farthest(&lengths);
        let (mut n_nodes, mut opened) = (0, 0);
        let mut stack = Stack::new(room);
        loop {
            // What a node holds, nearest first.
            n_nodes += 1;
            if n_nodes > LONG {
                return beam.members;
            }
            let (entered, near) = boxes.enter_until(&tree.nodes[opened], farthest);
            push(opened, entered, near, &mut stack);

            // Blocks, up to the next node.
            opened = loop {
                let Some(top) = stack.pop() else { return found.tell(hits) };
                let (near, place) = unpack(top);
                if near > farthest {
                    continue;
                }
                let (node, slot) = at(tree, place);
                let child = node.children[slot];
                if !child.is_block() {
                    break child.index();
                }
                let [near, far] = members.span(node, slot);
                let entered = [found.enters(0, near[0], far[0]), found.enters(1, near[1], far[1])];
                if entered[0] | entered[1] != 0 {
                    triangles.closest(&tree.blocks[child.index()], (entered, near), &mut found);
                    farthest = found.farthest(&lengths);
                }
            };
        }
    }
}

#[cfg(test)]
impl Packet {
    /// How many of the rays go by themselves.
    pub fn n_alone(&self, tree: &Tree) -> u32 {
        super::stack::with_room(tree.depth, |mut room| {
            let kinds = self.rays.kinds::<Portable<WIDTH>>();
            let (mut pending, mut n_alone, mut hits) = (self.rays.asked & kinds.can_be_followed, 0, [None; FAN]);
            while pending != 0 {
                let beam = self.rays.beam(&kinds, pending);
                let alone = self.together::<Portable<WIDTH>, Portable<BLOCK>>(&beam, tree, room.lent(), &mut hits);
                n_alone += alone.count_ones();
                pending &= !beam.members;
            }
            n_alone
        })
    }
}

/// Lengths of the members along the longest axis.
#[inline(always)]
fn lengths_of<W: Lanes<WIDTH>>(beam: &Beam) -> [W; HALVES] {
    let sense = W::splat(if beam.backward { -1.0 } else { 1.0 });
    let of_half = |half: usize| W::load(half_of(&beam.directions[0], half)) * sense;
    [of_half(0), of_half(1)]
}

/// Puts the entered children of a node on the stack, nearest on top: by node and slot, since the box of a block is asked for again.
#[inline(always)]
fn push<W: Lanes<WIDTH>>(node: usize, entered: u32, near: W, stack: &mut Stack) {
    let (near, floor, mut pending) = (near.store(), stack.len(), entered);
    while pending != 0 {
        let slot = pending.trailing_zeros() as usize;
        pending &= pending - 1;
        stack.insert(entry(near[slot], Child::from_bits((node * WIDTH + slot) as u32)), floor);
    }
}

/// The node and the slot of an entry that [`push`] made.
#[inline(always)]
fn at(tree: &Tree, place: Child) -> (&Node, usize) {
    let place = place.bits() as usize;
    (&tree.nodes[place / WIDTH], place % WIDTH)
}

#[inline(always)]
fn stored<W: Lanes<WIDTH>>(halves: &[W; HALVES]) -> [[f32; WIDTH]; HALVES] {
    [halves[0].store(), halves[1].store()]
}

impl<W: Lanes<WIDTH>> Nearest<W> {
    #[inline(always)]
    fn new(members: u16, t_max: &[f32; FAN]) -> Self {
        let mut ends = [0.0; FAN];
        for (nth, end) in ends.iter_mut().enumerate() {
            if members >> nth & 1 == 1 {
                *end = t_max[nth];
            }
        }
        let ends = [W::load(half_of(&ends, 0)), W::load(half_of(&ends, 1))];
        let nothing = [W::splat(0.0); HALVES];
        Nearest { t: ends, limit: ends, u: nothing, v: nothing, triangles: [0; FAN], hit: 0, undecided: 0 }
    }

    /// How far along the longest axis any member still looks.
    #[inline(always)]
    fn farthest(&self, lengths: &[W; HALVES]) -> f32 {
        let [low, high] = [self.limit[0] * lengths[0], self.limit[1] * lengths[1]];
        Interval::of(&[low.store(), high.store()]).most() * BEYOND
    }

    /// The members of a half that enter a box before what they have hit.
    #[inline(always)]
    fn enters(&self, half: usize, near: W, far: W) -> u32 {
        near.at_most(far) & near.at_most(self.limit[half] * W::splat(BEYOND))
    }

    /// The members of a half for which a hit at `t` matters.
    #[inline(always)]
    pub fn in_reach(&self, half: usize, t: W) -> u32 {
        t.at_most(self.limit[half])
    }

    /// Takes hits on a triangle, where they are closer: t and where its box begins, and the barycentric weights of vertices 1 and 2.
    #[inline(always)]
    pub fn take(&mut self, (half, candidates): (usize, u32), [t, near]: [W; 2], [u, v]: [W; 2], triangle: u32) {
        let shift = half * WIDTH;
        let closer = candidates & t.below(self.t[half]);
        // Not closer but before where the box of the closest begins; or closer than one that lies before where its own box begins.
        let too_close = (candidates & !closer) | (closer & self.t[half].at_most(near));
        self.undecided |= (too_close << shift) as u16;
        self.hit |= (closer << shift) as u16;
        self.t[half] = self.t[half].replaced(t, closer);
        self.limit[half] = self.limit[half].replaced(near.max(t), closer);
        self.u[half] = self.u[half].replaced(u, closer);
        self.v[half] = self.v[half].replaced(v, closer);
        let mut pending = closer;
        while pending != 0 {
            let lane = pending.trailing_zeros() as usize;
            pending &= pending - 1;
            self.triangles[shift + lane] = triangle;
        }
    }

    /// Writes the hits that are certain; the members that have to go by themselves.
    #[inline(always)]
    fn tell(&self, hits: &mut [Option<Hit>; FAN]) -> u16 {
        let (t, u, v) = (stored(&self.t), stored(&self.u), stored(&self.v));
        let mut pending = self.hit & !self.undecided;
        while pending != 0 {
            let nth = pending.trailing_zeros() as usize;
            pending &= pending - 1;
            let of = |halves: &[[f32; WIDTH]; HALVES]| halves[nth / WIDTH][nth % WIDTH];
            hits[nth] = Some(Hit { t: of(&t), u: of(&u), v: of(&v), triangle: self.triangles[nth] });
        }
        self.undecided
    }
}
