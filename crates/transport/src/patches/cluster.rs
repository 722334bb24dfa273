//! Points of surfaces that walks met, divided into patches.
//!
//! The patch that costs most is divided first: its importance to the picture times the spread of its points in space and
//! of their normals. So patches are small where much of the picture's light comes from, and where surfaces bend.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use glam::Vec3;
use rayon::prelude::*;

use super::PatchSample;
use super::nearest::Center;

/// A point of a surface that a walk met.
#[derive(Clone, Copy, Debug)]
pub(super) struct Met {
    /// A rounding step above the surface.
    pub position: Vec3,
    /// Unit normal on the side that was met.
    pub normal: Vec3,
    /// How much the picture takes of the light there.
    pub weight: f32,
    /// See [`PatchSample::grazing`].
    pub grazing: f32,
}

/// Points of a patch at which irradiance is asked for, at most.
const SAMPLES: usize = 4;

/// Of so many patches one is there to divide others at walls.
const AT_WALLS: usize = 8;
/// Points of a patch that look out for each other.
const LOOKOUTS: usize = 8;

/// Whether one of two points of a patch is seen from above the other one, given its radius in meters.
pub(super) type Sight<'a> = &'a (dyn Fn(&Met, &Met, f32) -> bool + Sync);

/// Points that stay together.
struct Cluster {
    /// Range of the points' order.
    range: std::ops::Range<usize>,
    cost: f32,
    /// Axis of the greatest spread: 0 to 2 in space, 3 to 5 of normals; and the mean along it.
    axis: usize,
    mean: f32,
}

impl PartialEq for Cluster {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Cluster {}

impl PartialOrd for Cluster {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Cluster {
    fn cmp(&self, other: &Self) -> Ordering {
        self.cost.total_cmp(&other.cost).then(other.range.start.cmp(&self.range.start))
    }
}

/// At most `most` patches: their middles, their samples patch by patch, and the first sample of each. A right angle between
/// normals counts as √2 times `reach_m`.
pub(super) fn cluster(
    met: &[Met],
    most: usize,
    reach_m: f32,
    sight: Sight<'_>,
) -> (Vec<Center>, Vec<PatchSample>, Vec<u32>) {
    let mut clusters =
        Clusters { met, reach_m, order: (0..met.len() as u32).collect(), open: BinaryHeap::new(), done: Vec::new() };
    if !met.is_empty() {
        clusters.open(0..met.len());
    }
    clusters.divide(most - most / AT_WALLS);
    clusters.part(most, sight);
    clusters.divide(most);
    let Clusters { order, open, done, .. } = clusters;
    let mut ranges: Vec<_> = open.into_iter().chain(done).map(|cluster| cluster.range).collect();
    ranges.sort_by_key(|range| range.start);
    let (mut centers, mut samples, mut first) = (Vec::new(), Vec::new(), vec![0]);
    for range in ranges {
        let points = &order[range];
        centers.push(center(met, points));
        samples.extend(chosen(met, points, radius_m(met, points)));
        first.push(samples.len() as u32);
    }
    (centers, samples, first)
}

/// Points on their way into patches.
struct Clusters<'a> {
    met: &'a [Met],
    reach_m: f32,
    order: Vec<u32>,
    open: BinaryHeap<Cluster>,
    /// Those that cannot be divided.
    done: Vec<Cluster>,
}

impl Clusters<'_> {
    fn n(&self) -> usize {
        self.open.len() + self.done.len()
    }

    fn open(&mut self, range: std::ops::Range<usize>) {
        self.open.push(Cluster::of(self.met, &self.order, range, self.reach_m));
    }

    /// Divides the widest ones until there are so many.
    fn divide(&mut self, most: usize) {
        while self.n() < most {
            let Some(widest) = self.open.pop() else { break };
            let points = &mut self.order[widest.range.clone()];
            let along = |&point: &u32| coordinate(&self.met[point as usize], widest.axis, self.reach_m);
            points.sort_unstable_by(|a, b| along(a).total_cmp(&along(b)).then(a.cmp(b)));
            let n_low = points.partition_point(|point| along(point) < widest.mean);
            if n_low == 0 || n_low == points.len() {
                self.done.push(widest);
                continue;
            }
            let middle = widest.range.start + n_low;
            self.open(widest.range.start..middle);
            self.open(middle..widest.range.end);
        }
    }

    /// Divides those that lie on both sides of a wall, the widest first, until there are so many.
    fn part(&mut self, most: usize, sight: Sight<'_>) {
        let clusters = std::mem::take(&mut self.open).into_sorted_vec();
        let beyond = |cluster: &Cluster| beyond_wall(self.met, &self.order[cluster.range.clone()], sight);
        let beyond: Vec<Option<Vec<bool>>> = clusters.par_iter().map(beyond).collect();
        let mut left = most.saturating_sub(clusters.len() + self.done.len());
        for (cluster, beyond) in clusters.into_iter().zip(beyond).rev() {
            let Some(beyond) = beyond.filter(|_| left > 0) else {
                self.open.push(cluster);
                continue;
            };
            let points = &mut self.order[cluster.range.clone()];
            let on = |side: bool| {
                points.iter().zip(&beyond).filter(move |(_, beyond)| **beyond == side).map(|(point, _)| *point)
            };
            let sorted: Vec<u32> = on(false).chain(on(true)).collect();
            let middle = cluster.range.start + on(false).count();
            points.copy_from_slice(&sorted);
            self.open(cluster.range.start..middle);
            self.open(middle..cluster.range.end);
            left -= 1;
        }
    }
}

/// Which points of a patch the others do not see, neither straight nor by way of points between them; `None` where all do.
fn beyond_wall(met: &[Met], points: &[u32], sight: Sight<'_>) -> Option<Vec<bool>> {
    let (n, radius_m) = (points.len().min(LOOKOUTS), radius_m(met, points));
    let lookouts: Vec<&Met> = (0..n).map(|nth| &met[points[nth * points.len() / n] as usize]).collect();
    let (mut seen, mut left) = (vec![false; n], vec![0]);
    seen[0] = true;
    while let Some(from) = left.pop() {
        for to in 0..n {
            if !seen[to] && sight(lookouts[from], lookouts[to], radius_m) {
                seen[to] = true;
                left.push(to);
            }
        }
    }
    if seen.iter().all(|seen| *seen) {
        return None;
    }
    let is_beyond = |&point: &u32| {
        let point = &met[point as usize];
        let mut nearest: Vec<usize> = (0..n).collect();
        let apart = |&nth: &usize| lookouts[nth].position.distance_squared(point.position);
        nearest.sort_by(|a, b| apart(a).total_cmp(&apart(b)));
        let by = nearest.iter().find(|nth| sight(lookouts[**nth], point, radius_m)).unwrap_or(&nearest[0]);
        !seen[*by]
    };
    let beyond: Vec<bool> = points.iter().map(is_beyond).collect();
    (beyond.contains(&true) && beyond.contains(&false)).then_some(beyond)
}

fn coordinate(met: &Met, axis: usize, reach_m: f32) -> f32 {
    if axis < 3 { met.position[axis] } else { reach_m * met.normal[axis - 3] }
}

impl Cluster {
    fn of(met: &[Met], order: &[u32], range: std::ops::Range<usize>, reach_m: f32) -> Cluster {
        let points = || order[range.clone()].iter().map(|&point| &met[point as usize]);
        let total: f64 = points().map(|met| f64::from(met.weight)).sum();
        let spread = |axis: usize| {
            let [mut sum, mut squares] = [0.0f64; 2];
            for met in points() {
                let (x, weight) = (f64::from(coordinate(met, axis, reach_m)), f64::from(met.weight));
                sum += weight * x;
                squares += weight * x * x;
            }
            let mean = sum / total;
            ((squares / total - mean * mean).max(0.0), mean)
        };
        let spreads: [(f64, f64); 6] = std::array::from_fn(spread);
        let axis = (0..6).max_by(|&a, &b| spreads[a].0.total_cmp(&spreads[b].0)).unwrap_or(0);
        let variance: f64 = spreads.iter().map(|(variance, _)| variance).sum();
        Cluster { range, cost: (total * variance) as f32, axis, mean: spreads[axis].1 as f32 }
    }
}

fn center(met: &[Met], points: &[u32]) -> Center {
    let (mut position, mut normal, mut total) = (Vec3::ZERO, Vec3::ZERO, 0.0);
    for met in points.iter().map(|&point| &met[point as usize]) {
        position += met.position * met.weight;
        normal += met.normal * met.weight;
        total += met.weight;
    }
    let first = met[points[0] as usize];
    Center { position: position / total, normal: normal.normalize_or(first.normal) }
}

/// Radius of a disk whose points lie as far from their middle as those of a patch do.
fn radius_m(met: &[Met], points: &[u32]) -> f32 {
    let center = center(met, points).position;
    let (mut squares, mut total) = (0.0, 0.0);
    for met in points.iter().map(|&point| &met[point as usize]) {
        squares += met.weight * met.position.distance_squared(center);
        total += met.weight;
    }
    (2.0 * squares / total).sqrt()
}

/// Points at even steps of importance along a patch of some radius; each stands for as much as the others.
fn chosen(met: &[Met], points: &[u32], radius_m: f32) -> impl Iterator<Item = PatchSample> {
    let total: f32 = points.iter().map(|&point| met[point as usize].weight).sum();
    let n = points.len().min(SAMPLES);
    let (mut picked, mut sum) = (Vec::with_capacity(n), 0.0);
    for &point in points {
        let met = &met[point as usize];
        sum += met.weight;
        if picked.len() < n && sum >= total * (picked.len() as f32 + 0.5) / n as f32 {
            picked.push(*met);
        }
    }
    if picked.is_empty() {
        picked.push(met[points[0] as usize]);
    }
    let (weight, radius_m) = (1.0 / picked.len() as f32, radius_m / (picked.len() as f32).sqrt());
    let sample = move |met: Met| {
        let Met { position, normal, grazing, .. } = met;
        PatchSample { position, normal, weight, radius_m, grazing }
    };
    picked.into_iter().map(sample)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampler::uniform_hash;

    /// Points on both sides of a square of 2 m.
    fn sheet(n: u64) -> Vec<Met> {
        let point = |i: u64| {
            let at = |key: u64| 2.0 * uniform_hash(i * 4 + key) - 1.0;
            let normal = if i.is_multiple_of(2) { Vec3::Y } else { Vec3::NEG_Y };
            // The left half matters four times as much.
            let x = at(0);
            Met { position: Vec3::new(x, 0.0, at(1)), normal, weight: if x < 0.0 { 4.0 } else { 1.0 }, grazing: 0.0 }
        };
        (0..n).map(point).collect()
    }

    #[test]
    fn a_patch_has_one_side_and_is_small_where_it_matters() {
        let met = sheet(20_000);
        let (centers, samples, first) = cluster(&met, 200, 1.0, &|_, _, _| true);
        assert_eq!((centers.len(), first.len(), first[200] as usize), (200, 201, samples.len()));
        for (center, w) in centers.iter().zip(first.windows(2)) {
            let own = &samples[w[0] as usize..w[1] as usize];
            assert!(own.iter().all(|sample| sample.normal.dot(center.normal) > 0.999));
            assert!((own.iter().map(|sample| sample.weight).sum::<f32>() - 1.0).abs() < 1e-6);
        }
        let left = centers.iter().filter(|center| center.position.x < 0.0).count();
        assert!((115..=145).contains(&left), "{left} of 200 on the side that matters");
    }

    #[test]
    fn points_that_coincide_are_one_patch() {
        let met = vec![Met { position: Vec3::ONE, normal: Vec3::X, weight: 1.0, grazing: 0.0 }; 50];
        let (centers, samples, _) = cluster(&met, 16, 1.0, &|_, _, _| true);
        assert_eq!((centers.len(), samples.len()), (1, SAMPLES));
        assert_eq!(cluster(&[], 16, 1.0, &|_, _, _| true).0.len(), 0);
    }

    #[test]
    fn no_patch_lies_on_both_sides_of_a_wall() {
        let met: Vec<Met> = sheet(8000).into_iter().filter(|met| met.normal == Vec3::Y).collect();
        let wall = |a: &Met, b: &Met, _: f32| (a.position.x < 0.013) == (b.position.x < 0.013);
        let n_across = |sight: Sight<'_>| {
            let (_, samples, first) = cluster(&met, 200, 1.0, sight);
            assert_eq!(first.len(), 201);
            let is_across = |w: &&[u32]| {
                let mut own = samples[w[0] as usize..w[1] as usize].iter().map(|sample| sample.position.x < 0.013);
                own.next().is_some_and(|first| own.any(|other| other != first))
            };
            first.windows(2).filter(is_across).count()
        };
        assert!(n_across(&|_, _, _| true) > 2);
        assert_eq!(n_across(&wall), 0);
    }
}
