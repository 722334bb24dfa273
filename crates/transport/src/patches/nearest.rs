//! Which patches stand for a point of a surface.

use std::sync::OnceLock;

use glam::Vec3;
use rayon::prelude::*;

/// Patches that share a point.
pub(super) const SHARING: usize = 4;

/// Middle of a patch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Center {
    pub position: Vec3,
    /// Unit normal.
    pub normal: Vec3,
}

impl Center {
    /// How far a place is above its plane, m.
    pub fn height(&self, place: Vec3) -> f32 {
        (place - self.position).dot(self.normal)
    }
}

/// Patches of a leaf at most: they are looked at together.
const LEAF: usize = 8;
/// Leaves of the patches that are known to be nearest to each patch.
const AROUND: usize = 4;
/// Above one by more than the roundings of three distances.
const ROUNDED_UP: f32 = 1.0 + 1e-5;
/// Coordinates of a point: where it is, and its normal times the reach.
const DIMENSIONS: usize = 6;

/// Patches around one that may be hidden from it, itself included.
const NEIGHBORS: usize = 17;
/// Least cosine between normals of patches that may share a point.
const ALIKE: f32 = 0.5;

/// A k-d tree over the middles of patches and their normals, all of whose leaves are equally deep. \[Bentley1975\]
#[derive(Debug)]
pub(super) struct Nearest {
    centers: Vec<Center>,
    /// From the root, level by level: below the one at `i` are those at `2i + 1` and `2i + 2`.
    splits: Vec<Split>,
    /// The level below the last one of splits.
    leaves: Vec<Leaf>,
    /// Of each patch.
    around: Vec<Around>,
    /// Once somebody has looked.
    sight: OnceLock<Sight>,
    /// Distance that a right angle between normals counts as, over the square root of two, m.
    reach_m: f32,
}

/// All else follows from these, but for who sees whom, which no file holds.
impl PartialEq for Nearest {
    fn eq(&self, other: &Self) -> bool {
        (&self.centers, self.reach_m) == (&other.centers, other.reach_m)
    }
}

/// Who sees whom.
#[derive(Debug)]
struct Sight {
    /// Of each patch the places above it that look around.
    eyes: Vec<Vec<Vec3>>,
    /// Of each patch those around it that a wall hides.
    hidden: Vec<Vec<u32>>,
}

/// Where a part of the tree is divided.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Split {
    /// Which coordinate divides it.
    axis: u8,
    /// None below it in the first half, none above it in the second.
    at: f32,
}

/// Patches side by side; what is not filled lies infinitely far away.
#[derive(Clone, Debug, PartialEq)]
struct Leaf {
    /// Axis × patch.
    positions: [[f32; LEAF]; 3],
    normals: [[f32; LEAF]; 3],
    patches: [u32; LEAF],
}

/// The patches nearest to a patch, itself included, and how far away the first of each leaf is, m.
#[derive(Clone, Debug, PartialEq)]
struct Around {
    leaves: [Leaf; AROUND],
    from_m: [f32; AROUND],
}

/// The nearest patches so far, and their squared distances.
struct Found<const N: usize> {
    n: usize,
    patches: [u32; N],
    squared: [f32; N],
}

impl Nearest {
    /// A right angle between normals counts as √2 times `reach_m`.
    pub fn new(centers: Vec<Center>, reach_m: f32) -> Nearest {
        let mut order: Vec<u32> = (0..centers.len() as u32).collect();
        let n_leaves = centers.len().div_ceil(LEAF).next_power_of_two();
        let (splits, leaves) = (vec![Split::default(); n_leaves - 1], vec![Leaf::EMPTY; n_leaves]);
        let mut nearest = Nearest { centers, splits, leaves, around: Vec::new(), sight: OnceLock::new(), reach_m };
        nearest.divide(0, &mut order);
        nearest.around = nearest.centers.par_iter().map(|center| nearest.around(center)).collect();
        nearest
    }

    /// Whether it is known which patches are hidden from each other.
    pub fn knows_hidden(&self) -> bool {
        self.sight.get().is_some()
    }

    /// The places above a patch that look around; none where nobody has looked yet.
    pub fn eyes(&self, patch: u32) -> &[Vec3] {
        self.sight.get().map_or(&[], |sight| &sight.eyes[patch as usize])
    }

    /// Looks, from places above each patch, which patches around it, of those that look the same way, are hidden from it. They share no
    /// point: beyond a wall there is other light.
    pub fn hide(&self, eyes: Vec<Vec<Vec3>>, sees: impl Fn(Vec3, Vec3) -> bool + Sync) {
        let of = |patch: u32| &eyes[patch as usize];
        let is_seen = |a: u32, b: u32| of(a).iter().any(|&from| of(b).iter().any(|&to| sees(from, to)));
        let of_patch = |patch: usize| {
            let center = self.centers[patch];
            let found = self.sought::<NEIGHBORS>(center.position, center.normal);
            let is_hidden = |&other: &u32| {
                let is_alike = center.normal.dot(self.centers[other as usize].normal) > ALIKE;
                other as usize != patch && is_alike && !is_seen(patch as u32, other)
            };
            found.patches[..found.n].iter().copied().filter(is_hidden).collect()
        };
        let one_way: Vec<Vec<u32>> = (0..self.centers.len()).into_par_iter().map(of_patch).collect();
        let mut hidden = one_way.clone();
        for (patch, others) in one_way.iter().enumerate() {
            for &other in others {
                let back = &mut hidden[other as usize];
                if !back.contains(&(patch as u32)) {
                    back.push(patch as u32);
                }
            }
        }
        // Who looked at the same time saw the same.
        let _ = self.sight.set(Sight { eyes, hidden });
    }

    /// Divides patches in two along their longest side, and both halves in turn, from a place in the tree downward.
    fn divide(&mut self, place: usize, patches: &mut [u32]) {
        let n_splits = self.splits.len();
        if place >= n_splits {
            self.leaves[place - n_splits] = Leaf::of(&self.centers, patches);
            return;
        }
        let of = |patch: u32| {
            let Center { position, normal } = self.centers[patch as usize];
            coordinates(position, normal, self.reach_m)
        };
        let (mut low, mut high) = ([f32::INFINITY; DIMENSIONS], [f32::NEG_INFINITY; DIMENSIONS]);
        for &patch in patches.iter() {
            for (axis, x) in of(patch).into_iter().enumerate() {
                (low[axis], high[axis]) = (low[axis].min(x), high[axis].max(x));
            }
        }
        let side = |axis: usize| high[axis] - low[axis];
        let axis = (0..DIMENSIONS).max_by(|&a, &b| side(a).total_cmp(&side(b))).unwrap_or(0);
        let along = |patch: u32| of(patch)[axis];
        let middle = patches.len() / 2;
        patches.select_nth_unstable_by(middle, |&a, &b| along(a).total_cmp(&along(b)).then(a.cmp(&b)));
        let at = along(patches[middle]);
        self.splits[place] = Split { axis: axis as u8, at };
        let (low, high) = patches.split_at_mut(middle);
        self.divide(2 * place + 1, low);
        self.divide(2 * place + 2, high);
    }

    /// One of the patches around a point, drawn by `u` in 0…1 with a probability that changes smoothly with the point.
    pub fn draw(&self, position: Vec3, normal: Vec3, u: f32) -> Option<u32> {
        let (patches, weights) = self.weights(position, normal);
        let mut left = u * weights.iter().sum::<f32>();
        for (patch, weight) in patches.into_iter().zip(weights) {
            left -= weight;
            if left < 0.0 {
                return Some(patch);
            }
        }
        (!self.centers.is_empty()).then_some(patches[0])
    }

    /// The patches around a point, the nearest first, and the weights by which one of them is drawn: those that are hidden from the nearest
    /// have none.
    pub fn weights(&self, position: Vec3, normal: Vec3) -> ([u32; SHARING], [f32; SHARING]) {
        let found = self.found(position, normal);
        // Weights fall to zero where another patch becomes the farthest.
        let limit = found.squared[SHARING];
        let weight = |squared: f32| if limit.is_finite() { (1.0 - squared / limit).max(0.0).powi(2) } else { 1.0 };
        let hidden = self.sight.get().and_then(|sight| sight.hidden.get(found.patches[0] as usize));
        let hidden = hidden.map_or(&[][..], Vec::as_slice);
        let has_part = |i: usize| i < found.n && !hidden.contains(&found.patches[i]);
        let weights = std::array::from_fn(|i| if has_part(i) { weight(found.squared[i]) } else { 0.0 });
        (std::array::from_fn(|i| found.patches[i]), weights)
    }

    /// Middles of the patches.
    pub fn centers(&self) -> &[Center] {
        &self.centers
    }

    /// Distance from the middle of a patch to the last of those around it that share its light; infinite where there are so few.
    pub fn spacing_m(&self, patch: usize) -> f32 {
        let Center { position, normal } = self.centers[patch];
        self.found(position, normal).squared[SHARING].sqrt()
    }

    fn around(&self, center: &Center) -> Around {
        let found = self.sought::<{ AROUND * LEAF }>(center.position, center.normal);
        let mut leaves = found.patches[..found.n].chunks(LEAF).map(|patches| Leaf::of(&self.centers, patches));
        Around {
            leaves: std::array::from_fn(|_| leaves.next().unwrap_or(Leaf::EMPTY)),
            from_m: std::array::from_fn(|i| found.squared[i * LEAF].sqrt()),
        }
    }

    /// The patches nearest to a point. Those of the leaf that it falls into tell one that is near, and what is nearest to that is known.
    fn found(&self, position: Vec3, normal: Vec3) -> Found<{ SHARING + 1 }> {
        let (mut place, at) = (0, coordinates(position, normal, self.reach_m));
        while let Some(split) = self.splits.get(place) {
            place = 2 * place + if at[usize::from(split.axis)] < split.at { 1 } else { 2 };
        }
        let leaf = &self.leaves[place - self.splits.len()];
        let squared = self.squared_distances(position, normal, leaf);
        let first = (1..LEAF).fold(0, |first, i| if squared[i] < squared[first] { i } else { first });
        if let Some(around) = self.around.get(leaf.patches[first] as usize) {
            let apart_m = squared[first].sqrt();
            let mut found = Found::new();
            for (leaf, from_m) in around.leaves.iter().zip(around.from_m) {
                // What is farther from that patch than both together is farther than the farthest one found.
                if from_m > (apart_m + found.squared[SHARING].sqrt()) * ROUNDED_UP {
                    return found;
                }
                found.offer_all(leaf, &self.squared_distances(position, normal, leaf));
            }
            if self.centers.len() <= AROUND * LEAF {
                return found;
            }
        }
        self.sought(position, normal)
    }

    /// The patches nearest to a point, sought in the whole tree.
    fn sought<const N: usize>(&self, position: Vec3, normal: Vec3) -> Found<N> {
        let (at, off) = (coordinates(position, normal, self.reach_m), [0.0; DIMENSIONS]);
        let mut search = Search { tree: self, position, normal, at, off, found: Found::new() };
        search.visit(0, 0.0);
        search.found
    }

    #[inline(always)]
    fn squared_distances(&self, position: Vec3, normal: Vec3, leaf: &Leaf) -> [f32; LEAF] {
        let mut squared = apart(position, &leaf.positions);
        // Surfaces that look another way receive other light.
        let (turned, reach_squared) = (apart(normal, &leaf.normals), self.reach_m * self.reach_m);
        squared.iter_mut().zip(turned).for_each(|(squared, turned)| *squared += reach_squared * turned);
        squared
    }
}

fn coordinates(position: Vec3, normal: Vec3, reach_m: f32) -> [f32; DIMENSIONS] {
    let normal = normal * reach_m;
    [position.x, position.y, position.z, normal.x, normal.y, normal.z]
}

/// Looks for the patches nearest to a point.
struct Search<'a, const N: usize> {
    tree: &'a Nearest,
    position: Vec3,
    normal: Vec3,
    at: [f32; DIMENSIONS],
    /// How far away, along each coordinate, the part of the tree is that is being visited.
    off: [f32; DIMENSIONS],
    found: Found<N>,
}

impl<const N: usize> Search<'_, N> {
    /// Looks at a part of the tree, whose squared distance is at least `squared`.
    fn visit(&mut self, place: usize, squared: f32) {
        let tree = self.tree;
        let Some(split) = tree.splits.get(place) else {
            let leaf = &tree.leaves[place - tree.splits.len()];
            return self.found.offer_all(leaf, &tree.squared_distances(self.position, self.normal, leaf));
        };
        let axis = usize::from(split.axis);
        let off = self.at[axis] - split.at;
        let (first, second) = (2 * place + 1, 2 * place + 2);
        let (near, far) = if off < 0.0 { (first, second) } else { (second, first) };
        self.visit(near, squared);
        // What lies beyond the split is at least so far away along its axis [Arya1993].
        let before = self.off[axis];
        let beyond = squared - before * before + off * off;
        if beyond < self.found.squared[N - 1] {
            self.off[axis] = off;
            self.visit(far, beyond);
            self.off[axis] = before;
        }
    }
}

/// Squared distances of a point from all of a leaf.
#[inline(always)]
fn apart(from: Vec3, to: &[[f32; LEAF]; 3]) -> [f32; LEAF] {
    let mut squared = [0.0; LEAF];
    for (from, to) in from.to_array().into_iter().zip(to) {
        for (squared, to) in squared.iter_mut().zip(to) {
            let off = from - to;
            *squared += off * off;
        }
    }
    squared
}

impl Leaf {
    const EMPTY: Leaf = Leaf { positions: [[f32::INFINITY; LEAF]; 3], normals: [[0.0; LEAF]; 3], patches: [0; LEAF] };

    fn of(centers: &[Center], patches: &[u32]) -> Leaf {
        let mut leaf = Leaf::EMPTY;
        for (i, &patch) in patches.iter().enumerate() {
            let Center { position, normal } = centers[patch as usize];
            for axis in 0..3 {
                (leaf.positions[axis][i], leaf.normals[axis][i]) = (position[axis], normal[axis]);
            }
            leaf.patches[i] = patch;
        }
        leaf
    }
}

impl<const N: usize> Found<N> {
    fn new() -> Self {
        Found { n: 0, patches: [0; N], squared: [f32::INFINITY; N] }
    }

    /// Takes those of a leaf that are nearer than the farthest so far, which of most leaves is none.
    #[inline(always)]
    fn offer_all(&mut self, leaf: &Leaf, squared: &[f32; LEAF]) {
        let farthest = self.squared[N - 1];
        let mut nearer = squared.iter().enumerate().fold(0_u32, |all, (i, &x)| all | u32::from(x < farthest) << i);
        while nearer != 0 {
            let i = nearer.trailing_zeros() as usize;
            nearer &= nearer - 1;
            if squared[i] < self.squared[N - 1] {
                self.insert(leaf.patches[i], squared[i]);
            }
        }
    }

    fn insert(&mut self, patch: u32, squared: f32) {
        let mut at = N - 1;
        while at > 0 && self.squared[at - 1] > squared {
            (self.patches[at], self.squared[at]) = (self.patches[at - 1], self.squared[at - 1]);
            at -= 1;
        }
        (self.patches[at], self.squared[at]) = (patch, squared);
        self.n = (self.n + 1).min(N);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampler::uniform_hash;

    fn centers(n: u64) -> Vec<Center> {
        let at = |key: u64| Vec3::from_array([0, 1, 2].map(|i| uniform_hash(key * 7 + i) - 0.5));
        (0..n).map(|i| Center { position: at(i), normal: at(i + n).normalize() }).collect()
    }

    #[test]
    fn the_tree_finds_what_looking_at_all_finds() {
        // Normals that count for little, about as much as places, and for more than these.
        for (n, reach_m) in
            [(300, 0.0), (300, 0.3), (300, 3.0), (1000, 0.3), (8, 0.3), (9, 0.3), (5, 0.3), (32, 0.3), (33, 0.3)]
        {
            let all = centers(n);
            let nearest = Nearest::new(all.clone(), reach_m);
            for probe in centers(n + 300).into_iter().skip(n as usize) {
                let squared = |c: &Center| {
                    let turned = probe.normal.distance_squared(c.normal);
                    probe.position.distance_squared(c.position) + reach_m * reach_m * turned
                };
                let mut expected: Vec<u32> = (0..n as u32).collect();
                expected.sort_by(|a, b| squared(&all[*a as usize]).total_cmp(&squared(&all[*b as usize])));
                let found = nearest.found(probe.position, probe.normal);
                assert_eq!(found.patches[..], expected[..SHARING + 1], "{n} patches, {reach_m} m");
                assert_eq!(found.squared, found.patches.map(|patch| squared(&all[patch as usize])));
                let sought = nearest.sought::<7>(probe.position, probe.normal);
                assert_eq!(sought.patches[..sought.n], expected[..7.min(all.len())], "{n} patches, {reach_m} m");
            }
        }
    }

    #[test]
    fn where_fewer_patches_are_than_share_a_point_all_of_them_do() {
        for n in 0..=SHARING {
            let nearest = Nearest::new(centers(n as u64), 0.3);
            let (patches, weights) = nearest.weights(Vec3::ZERO, Vec3::Y);
            let mut sharing: Vec<u32> =
                patches.into_iter().zip(weights).filter(|(_, w)| *w > 0.0).map(|x| x.0).collect();
            sharing.sort_unstable();
            assert_eq!(sharing, (0..n as u32).collect::<Vec<_>>());
            assert_eq!(nearest.draw(Vec3::ZERO, Vec3::Y, 0.5).is_some(), n > 0);
        }
    }

    #[test]
    fn the_nearest_patch_is_drawn_most_and_the_fifth_never() {
        let all = centers(50);
        let nearest = Nearest::new(all.clone(), 0.0);
        let at = all[7].position;
        let mut counts = [0; 50];
        (0..1000).for_each(|i| counts[nearest.draw(at, Vec3::Y, (i as f32 + 0.5) / 1000.0).unwrap() as usize] += 1);
        assert_eq!(counts.iter().position(|n| n == counts.iter().max().unwrap()), Some(7));
        assert!(counts.iter().filter(|n| **n > 0).count() <= SHARING);
    }

    #[test]
    fn patches_that_are_hidden_share_no_point() {
        let nearest =
            Nearest::new((0..40).map(|i| Center { position: Vec3::X * i as f32, normal: Vec3::Y }).collect(), 1.0);
        let eyes = nearest.centers().iter().map(|center| vec![center.position]).collect();
        nearest.hide(eyes, |a, b| (a.x < 19.5) == (b.x < 19.5));
        let sharing = |x: f32| {
            let (patches, weights) = nearest.weights(Vec3::X * x, Vec3::Y);
            let mut sharing: Vec<u32> =
                patches.into_iter().zip(weights).filter(|(_, w)| *w > 0.0).map(|x| x.0).collect();
            sharing.sort_unstable();
            sharing
        };
        assert_eq!(sharing(10.3), [9, 10, 11, 12]);
        assert_eq!(sharing(19.3), [18, 19]);
        assert_eq!(sharing(19.7), [20, 21]);
    }
}
