//! Which patches stand for a point of a surface.

use glam::Vec3;

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

/// A k-d tree over the middles of patches. \[Bentley1975\]
#[derive(Debug, PartialEq)]
pub(super) struct Nearest {
    centers: Vec<Center>,
    /// Patches in the order of the tree: the middle of each range splits it.
    order: Vec<u32>,
    /// Axis of each split, at the place of its middle.
    axes: Vec<u8>,
    /// Distance that a right angle between normals counts as, over the square root of two, m.
    reach_m: f32,
}

/// The nearest patches so far, and their squared distances.
struct Found {
    n: usize,
    patches: [u32; SHARING + 1],
    squared: [f32; SHARING + 1],
}

impl Nearest {
    /// A right angle between normals counts as √2 times `reach_m`.
    pub fn new(centers: Vec<Center>, reach_m: f32) -> Nearest {
        let mut order: Vec<u32> = (0..centers.len() as u32).collect();
        let mut axes = vec![0; centers.len()];
        split(&centers, &mut order, &mut axes);
        Nearest { centers, order, axes, reach_m }
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
        (!self.order.is_empty()).then_some(patches[0])
    }

    /// The patches around a point, the nearest first, and the weights by which one of them is drawn.
    pub fn weights(&self, position: Vec3, normal: Vec3) -> ([u32; SHARING], [f32; SHARING]) {
        let found = self.found(position, normal);
        // Weights fall to zero where another patch becomes the farthest.
        let limit = found.squared[SHARING];
        let weight = |squared: f32| if limit.is_finite() { (1.0 - squared / limit).max(0.0).powi(2) } else { 1.0 };
        let weights = std::array::from_fn(|i| if i < found.n { weight(found.squared[i]) } else { 0.0 });
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

    fn found(&self, position: Vec3, normal: Vec3) -> Found {
        let mut found = Found { n: 0, patches: [0; SHARING + 1], squared: [f32::INFINITY; SHARING + 1] };
        self.search(0..self.order.len(), position, normal, &mut found);
        found
    }

    fn search(&self, range: std::ops::Range<usize>, position: Vec3, normal: Vec3, found: &mut Found) {
        if range.is_empty() {
            return;
        }
        let middle = range.start + range.len() / 2;
        let patch = self.order[middle];
        let center = &self.centers[patch as usize];
        let apart = position.distance_squared(center.position);
        // Surfaces that look another way receive other light.
        found.offer(patch, apart + self.reach_m * self.reach_m * normal.distance_squared(center.normal));
        let axis = usize::from(self.axes[middle]);
        let off = position[axis] - center.position[axis];
        let (near, far) = if off < 0.0 {
            (range.start..middle, middle + 1..range.end)
        } else {
            (middle + 1..range.end, range.start..middle)
        };
        self.search(near, position, normal, found);
        if off * off < found.squared[SHARING] {
            self.search(far, position, normal, found);
        }
    }
}

impl Found {
    fn offer(&mut self, patch: u32, squared: f32) {
        if squared >= self.squared[SHARING] {
            return;
        }
        let mut at = SHARING;
        while at > 0 && self.squared[at - 1] > squared {
            (self.patches[at], self.squared[at]) = (self.patches[at - 1], self.squared[at - 1]);
            at -= 1;
        }
        (self.patches[at], self.squared[at]) = (patch, squared);
        self.n = (self.n + 1).min(SHARING + 1);
    }
}

/// Puts the middle of a range where it belongs along the longest side, and does the same on both of its sides.
fn split(centers: &[Center], order: &mut [u32], axes: &mut [u8]) {
    if order.len() < 2 {
        return;
    }
    let position = |patch: &u32| centers[*patch as usize].position;
    let low = order.iter().map(position).fold(Vec3::INFINITY, Vec3::min);
    let high = order.iter().map(position).fold(Vec3::NEG_INFINITY, Vec3::max);
    let axis = (high - low).max_position();
    let middle = order.len() / 2;
    order.select_nth_unstable_by(middle, |a, b| position(a)[axis].total_cmp(&position(b)[axis]).then(a.cmp(b)));
    axes[middle] = axis as u8;
    let (low, high) = order.split_at_mut(middle);
    let (low_axes, high_axes) = axes.split_at_mut(middle);
    split(centers, low, low_axes);
    split(centers, &mut high[1..], &mut high_axes[1..]);
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
        let all = centers(300);
        let nearest = Nearest::new(all.clone(), 0.3);
        for probe in centers(1200).into_iter().skip(300) {
            let squared = |c: &Center| {
                probe.position.distance_squared(c.position) + 0.09 * probe.normal.distance_squared(c.normal)
            };
            let mut expected: Vec<u32> = (0..300).collect();
            expected.sort_by(|a, b| squared(&all[*a as usize]).total_cmp(&squared(&all[*b as usize])));
            let mut found = Found { n: 0, patches: [0; SHARING + 1], squared: [f32::INFINITY; SHARING + 1] };
            nearest.search(0..300, probe.position, probe.normal, &mut found);
            assert_eq!(found.patches[..], expected[..SHARING + 1]);
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
}
