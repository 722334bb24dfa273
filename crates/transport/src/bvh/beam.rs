//! The segments of a beam against boxes and triangles, all at once.
//!
//! With ζ the length along the longest axis, a beam covers slopes [s₀, s₁] on each of the other two; it meets a box where
//! s₁ζ ≥ lower and s₀ζ ≤ upper for some ζ inside. Triangles get the very arithmetic of single rays, so that both see the same.

use super::fan::{Beam, HALVES, half_of};
use super::lanes::{Lanes, three};
use super::node::{BLOCK, Block, FAR_SLACK, Node, WIDTH};
use super::packet::Nearest;
use super::ray::{corners_of, row_of};
use super::triangle::{Edges, Shear, component};

/// Factor on the far side of a box where a beam has to meet all boxes that single rays meet with their own slack: more than
/// all roundings of both together.
const MEMBERS_SLACK: f32 = 1.0 + 1.0 / (1 << 18) as f32;

/// Numbers between two.
#[derive(Clone, Copy)]
pub(super) struct Interval {
    from: f32,
    to: f32,
}

impl Interval {
    #[inline(always)]
    /// The least that holds all values.
    pub fn of(values: &[[f32; WIDTH]; HALVES]) -> Interval {
        let both = |pick: fn(f32, f32) -> f32| {
            let mut lanes: [f32; WIDTH] = std::array::from_fn(|i| pick(values[0][i], values[1][i]));
            for step in [4, 2, 1] {
                for i in 0..step {
                    lanes[i] = pick(lanes[i], lanes[i + step]);
                }
            }
            lanes[0]
        };
        Interval { from: both(|a, b| if a < b { a } else { b }), to: both(|a, b| if a > b { a } else { b }) }
    }

    #[inline(always)]
    fn splat<Q: Lanes<BLOCK>>(self) -> [Q; 2] {
        [Q::splat(self.from), Q::splat(self.to)]
    }

    /// From one end to the other.
    #[inline(always)]
    pub fn width(self) -> f32 {
        self.to - self.from
    }

    /// The upper end.
    #[inline(always)]
    pub fn most(self) -> f32 {
        self.to
    }

    #[inline(always)]
    /// With the sense turned round.
    pub fn negated(self) -> Interval {
        Interval { from: -self.to, to: -self.from }
    }
}

/// One of the two planes of a slab as bounds on ζ.
#[derive(Clone, Copy)]
struct Bound<W> {
    row: usize,
    factor: W,
}

/// Slopes of the beam against the slabs of an axis.
#[derive(Clone, Copy)]
struct Slab<W> {
    origin: W,
    enter: Bound<W>,
    leave: Bound<W>,
    /// Slopes of both signs: the beam widens past either plane and never leaves.
    straddles: bool,
}

impl<W: Lanes<WIDTH>> Slab<W> {
    #[inline(always)]
    fn new(beam: &Beam, i: usize, slopes: Interval) -> Self {
        let (lower, upper) = (beam.axes[i], beam.axes[i] + 3);
        let origin = component(beam.origin, beam.axes[i]);
        let slopes = if beam.backward { slopes.negated() } else { slopes };
        let bound = |row, factor: f32| Bound { row, factor: W::splat(factor) };
        let (per_from, per_to) = (1.0 / slopes.from.abs(), 1.0 / slopes.to.abs());
        let (enter, leave, straddles) = if slopes.from > 0.0 {
            (bound(lower, per_to), bound(upper, per_from), false)
        } else if slopes.to < 0.0 {
            (bound(upper, -per_from), bound(lower, -per_to), false)
        } else {
            (bound(lower, per_to), bound(upper, -per_from), true)
        };
        Slab { origin: W::splat(origin), enter, leave, straddles }
    }

    #[inline(always)]
    fn at(&self, node: &Node, bound: Bound<W>) -> W {
        (W::load(row_of(node, bound.row)) - self.origin) * bound.factor
    }
}

/// A beam against eight boxes.
pub(super) struct BoxBeam<W> {
    near_row: usize,
    far_row: usize,
    origin: W,
    sense: W,
    nearest: W,
    farthest: W,
    slabs: [Slab<W>; 2],
}

impl<W: Lanes<WIDTH>> BoxBeam<W> {
    #[inline(always)]
    pub fn new(beam: &Beam, slopes: [Interval; 2]) -> Self {
        let axis = beam.axes[0];
        let lengths = beam.lengths();
        BoxBeam {
            near_row: if beam.backward { axis + 3 } else { axis },
            far_row: if beam.backward { axis } else { axis + 3 },
            origin: W::splat(component(beam.origin, axis)),
            sense: W::splat(if beam.backward { -1.0 } else { 1.0 }),
            nearest: W::splat(lengths.from * beam.t_min),
            farthest: W::splat(lengths.to * beam.t_max),
            slabs: [Slab::new(beam, 1, slopes[0]), Slab::new(beam, 2, slopes[1])],
        }
    }

    /// The boxes that the beam meets, and perhaps some beside it.
    #[inline(always)]
    pub fn enter(&self, node: &Node) -> u32 {
        let [near, far] = self.span(node, self.farthest);
        near.at_most(far * W::splat(FAR_SLACK))
    }

    /// The boxes that a member may meet within a length along the longest axis, and the length at which it does at the least.
    #[inline(always)]
    pub fn enter_until(&self, node: &Node, farthest: f32) -> (u32, W) {
        let [near, far] = self.span(node, W::splat(farthest));
        (near.at_most(far * W::splat(MEMBERS_SLACK)), near)
    }

    /// Lengths along the longest axis between which the beam is within each box.
    #[inline(always)]
    fn span(&self, node: &Node, farthest: W) -> [W; 2] {
        let mut near = ((W::load(row_of(node, self.near_row)) - self.origin) * self.sense).max(self.nearest);
        let mut far = ((W::load(row_of(node, self.far_row)) - self.origin) * self.sense).min(farthest);
        for slab in &self.slabs {
            near = slab.at(node, slab.enter).max(near);
            let leave = slab.at(node, slab.leave);
            if slab.straddles {
                near = leave.max(near);
            } else {
                far = leave.min(far);
            }
        }
        [near, far]
    }
}

/// The members of a beam, each by itself, against one box.
pub(super) struct BoxMembers<W> {
    /// In the order of the axes of the beam.
    axes: [usize; 3],
    origin: [f32; 3],
    reciprocals: [[W; HALVES]; 3],
    /// The same, with the slack of far sides.
    far_reciprocals: [[W; HALVES]; 3],
    t_min: W,
    t_max: W,
}

impl<W: Lanes<WIDTH>> BoxMembers<W> {
    /// `None` where a member runs within a plane of boxes: it takes a ray to do that right.
    #[inline(always)]
    pub fn new(beam: &Beam) -> Option<Self> {
        let mut reciprocals = [[W::splat(1.0); HALVES]; 3];
        let mut far_reciprocals = reciprocals;
        let (largest, zero, slack) = (W::splat(f32::MAX), W::splat(0.0), W::splat(FAR_SLACK));
        let mut finite = (1 << WIDTH) - 1;
        // Loops, as closures of iterators would not be compiled for the vectors of the machine.
        for i in 0..3 {
            for half in 0..HALVES {
                let reciprocal = W::splat(1.0) / W::load(half_of(&beam.directions[i], half));
                finite &= reciprocal.max(zero - reciprocal).at_most(largest);
                (reciprocals[i][half], far_reciprocals[i][half]) = (reciprocal, reciprocal * slack);
            }
        }
        if finite != (1 << WIDTH) - 1 {
            return None;
        }
        Some(BoxMembers {
            axes: beam.axes,
            origin: three!(|i| component(beam.origin, beam.axes[i])),
            reciprocals,
            far_reciprocals,
            t_min: W::splat(beam.t_min),
            t_max: W::splat(beam.t_max),
        })
    }

    /// Where each member enters a box and where it leaves it: the very numbers of single rays.
    #[inline(always)]
    pub fn span(&self, node: &Node, slot: usize) -> [[W; HALVES]; 2] {
        let mut near = [self.t_min; HALVES];
        let mut far = [W::splat(f32::INFINITY); HALVES];
        for i in 0..3 {
            let lower = W::splat(row_of(node, self.axes[i])[slot] - self.origin[i]);
            let upper = W::splat(row_of(node, self.axes[i] + 3)[slot] - self.origin[i]);
            for half in 0..HALVES {
                let (reciprocal, far_reciprocal) = (self.reciprocals[i][half], self.far_reciprocals[i][half]);
                near[half] = (lower * reciprocal).min(upper * reciprocal).max(near[half]);
                far[half] = (lower * far_reciprocal).max(upper * far_reciprocal).min(far[half]);
            }
        }
        [near, far]
    }

    /// Those of the `entered` boxes that one of the members in `free` meets, with the slack that single rays grant.
    #[inline(always)]
    pub fn confirm(&self, node: &Node, entered: u32, free: u16) -> u32 {
        let (mut confirmed, mut pending) = (0, entered);
        while pending != 0 {
            let slot = pending.trailing_zeros() as usize;
            pending &= pending - 1;
            let mut near = [self.t_min; HALVES];
            let mut far = [self.t_max; HALVES];
            for i in 0..3 {
                let lower = W::splat(row_of(node, self.axes[i])[slot] - self.origin[i]);
                let upper = W::splat(row_of(node, self.axes[i] + 3)[slot] - self.origin[i]);
                for half in 0..HALVES {
                    let (a, b) = (lower * self.reciprocals[i][half], upper * self.reciprocals[i][half]);
                    near[half] = a.min(b).max(near[half]);
                    far[half] = a.max(b).min(far[half]);
                }
            }
            let slack = W::splat(FAR_SLACK);
            let met = near[0].at_most(far[0] * slack) | near[1].at_most(far[1] * slack) << WIDTH;
            confirmed |= u32::from(met as u16 & free != 0) << slot;
        }
        confirmed
    }
}

/// A beam against four triangles.
pub(super) struct TriangleBeam<W, Q> {
    axes: [usize; 3],
    origin: [Q; 3],
    /// Least and greatest slopes.
    slopes: [[Q; 2]; 2],
    shears: [Shear<W>; HALVES],
    t_min: W,
    t_max: W,
}

/// Triangles of a block, to be looked at one by one.
struct MetTriangles {
    lanes: u32,
    /// Vertex × axis × lane.
    corners: [[[f32; BLOCK]; 3]; 3],
}

impl MetTriangles {
    /// The lane of the next one, and its corners for all members.
    #[inline(always)]
    fn next<W: Lanes<WIDTH>>(&mut self) -> Option<(usize, [[W; 3]; 3])> {
        if self.lanes == 0 {
            return None;
        }
        let lane = self.lanes.trailing_zeros() as usize;
        self.lanes &= self.lanes - 1;
        Some((lane, three!(|vertex| three!(|i| W::splat(self.corners[vertex][i][lane])))))
    }
}

impl<W: Lanes<WIDTH>, Q: Lanes<BLOCK>> TriangleBeam<W, Q> {
    #[inline(always)]
    pub fn new(beam: &Beam, slopes: [Interval; 2], shears: [Shear<W>; HALVES]) -> Self {
        TriangleBeam {
            axes: beam.axes,
            origin: three!(|i| Q::splat(component(beam.origin, beam.axes[i]))),
            slopes: [slopes[0].splat(), slopes[1].splat()],
            shears,
            t_min: W::splat(beam.t_min),
            t_max: W::splat(beam.t_max),
        }
    }

    /// Those of `wanted` that hit a triangle of the block.
    #[inline(always)]
    pub fn hits(&self, block: &Block, wanted: u16) -> u16 {
        let mut hits = 0;
        let mut met = self.met(block);
        while let Some((_, corners)) = met.next() {
            for half in 0..HALVES {
                let of_half = ((1 << WIDTH) - 1) << (half * WIDTH);
                if wanted & !hits & of_half != 0 {
                    hits |= self.hits_of(half, corners) << (half * WIDTH);
                }
            }
        }
        hits & wanted
    }

    /// Takes the hits on a block's triangles that are closer, of the members that enter its box: who they are, and where.
    #[inline(always)]
    pub fn closest(&self, block: &Block, (entered, near): ([u32; HALVES], [W; HALVES]), found: &mut Nearest<W>) {
        let mut met = self.met(block);
        while let Some((lane, corners)) = met.next() {
            for half in 0..HALVES {
                self.closest_of(half, corners, (entered[half], near[half]), block.ids[lane], found);
            }
        }
    }

    /// Triangles of a block that the beam may meet.
    #[inline(always)]
    fn met(&self, block: &Block) -> MetTriangles {
        let corners = corners_of(block, self.axes, self.origin);
        let lanes = self.meets(corners);
        MetTriangles { lanes, corners: three!(|vertex| three!(|i| corners[vertex][i].store())) }
    }

    #[inline(always)]
    fn closest_of(
        &self,
        half: usize,
        corners: [[W; 3]; 3],
        (entered, near): (u32, W),
        triangle: u32,
        found: &mut Nearest<W>,
    ) {
        if entered == 0 {
            return;
        }
        let shear = &self.shears[half];
        let edges = Edges::new(corners, shear);
        let inside = edges.inside() & entered;
        if inside == 0 {
            return;
        }
        let parameter = edges.parameter(shear);
        let candidates = inside & self.t_min.below(parameter) & found.in_reach(half, parameter);
        if candidates != 0 {
            let ([_, u, v], sum) = (edges.weights, edges.sum());
            found.take((half, candidates), [parameter, near], [u / sum, v / sum], triangle);
        }
    }

    /// Triangles that do not lie to one side of the whole beam; vacant ones are met by none.
    #[inline(always)]
    fn meets(&self, corners: [[Q; 3]; 3]) -> u32 {
        let zero = Q::splat(0.0);
        let mut met = (1 << BLOCK) - 1;
        for i in 0..2 {
            let [from, to] = self.slopes[i];
            let [a, b, c] = three!(|vertex| {
                let [length, across] = [corners[vertex][0], corners[vertex][i + 1]];
                let (at_from, at_to) = (from * length, to * length);
                (across - at_from.max(at_to), across - at_from.min(at_to))
            });
            met &= a.0.min(b.0).min(c.0).at_most(zero) & zero.at_most(a.1.max(b.1).max(c.1));
        }
        met
    }

    #[inline(always)]
    fn hits_of(&self, half: usize, corners: [[W; 3]; 3]) -> u16 {
        let shear = &self.shears[half];
        let edges = Edges::new(corners, shear);
        let inside = edges.inside();
        if inside == 0 {
            return 0;
        }
        let parameter = edges.parameter(shear);
        (inside & self.t_min.below(parameter) & parameter.below(self.t_max)) as u16
    }
}
