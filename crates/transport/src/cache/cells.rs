//! Space divided into cells, each for points that look about the same way.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use glam::Vec3;

use crate::path::{Deposit, KnownAt};
use crate::prepared::SurfaceHit;

/// A point and the unit normal on the side from which it was seen.
pub(crate) type Place = (SurfaceHit, Vec3);

/// Points that a cell keeps.
pub(super) const POINTS: usize = 4;
/// Sides of a cell that a walk must have come for the cell to stand for the point.
const AFAR: f32 = 1.0;
/// Halvings in search of the size of a cell.
const STEPS: u32 = 14;

/// Cells that somebody met.
pub(super) struct Cells {
    side: f32,
    index: HashMap<u64, u32>,
    pub(super) points: Vec<Vec<Place>>,
}

impl Cells {
    /// No cells yet, of a size at which the places found fill about `most`.
    pub(super) fn fit(found: &[Place], most: usize) -> Cells {
        let low = found.iter().fold(Vec3::INFINITY, |low, (hit, _)| low.min(hit.position));
        let high = found.iter().fold(Vec3::NEG_INFINITY, |high, (hit, _)| high.max(hit.position));
        let extent = (high - low).max_element();
        let extent = if extent.is_finite() && extent > 0.0 { extent } else { 1.0 };
        // The number of cells falls as they grow, more or less: bisection on the logarithm of the side.
        let (mut small, mut large) = (extent / 8192.0, extent);
        let mut keys = Vec::with_capacity(found.len());
        for _ in 0..STEPS {
            let side = (small * large).sqrt();
            keys.clear();
            keys.extend(found.iter().map(|place| key(place, side)));
            keys.sort_unstable();
            keys.dedup();
            *(if keys.len() > most { &mut small } else { &mut large }) = side;
        }
        Cells { side: large, index: HashMap::new(), points: Vec::new() }
    }

    /// Makes cells for what was found, up to a number of cells; the first that is new.
    pub(super) fn add(&mut self, found: &[Place], most: usize) -> usize {
        let first_new = self.points.len();
        for place in found {
            match self.index.entry(key(place, self.side)) {
                Entry::Occupied(cell) => {
                    let points = &mut self.points[*cell.get() as usize];
                    if points.len() < POINTS {
                        points.push(*place);
                    }
                }
                Entry::Vacant(slot) if self.points.len() < most => {
                    slot.insert(self.points.len() as u32);
                    self.points.push(vec![*place]);
                }
                Entry::Vacant(_) => {}
            }
        }
        first_new
    }

    /// One point of each cell.
    pub(super) fn places(&self) -> impl Iterator<Item = Place> {
        self.points.iter().map(|points| points[0])
    }

    /// The cell that stands for a surface, if it is seen broadly enough.
    #[inline]
    pub(super) fn find(&self, at: &KnownAt<'_>) -> Option<u32> {
        let reach = AFAR * self.side;
        let sharpness = (at.density * std::f32::consts::PI).max(1.0);
        if at.hit.t * at.hit.t < reach * reach * sharpness {
            return None;
        }
        self.index.get(&key(&(*at.hit, at.normal), self.side)).copied().or_else(|| self.beside(at))
    }

    /// The nearest cell beside one that nobody met, for points that look the same way.
    fn beside(&self, at: &KnownAt<'_>) -> Option<u32> {
        let within = (at.hit.position / self.side).fract_gl() - 0.5;
        let mut nearest_first = [0usize, 1, 2];
        nearest_first.sort_by(|&a, &b| within[b].abs().total_cmp(&within[a].abs()));
        let neighbor = |axis: usize| {
            let mut hit = *at.hit;
            hit.position[axis] += self.side.copysign(within[axis]);
            self.index.get(&key(&(hit, at.normal), self.side)).copied()
        };
        nearest_first.into_iter().find_map(neighbor)
    }
}

/// Of a cell: 20 bits for each axis of its place, the lowest ones wherever the scene lies, and which way it looks.
fn key((hit, normal): &Place, side: f32) -> u64 {
    const RANGE: i64 = 1 << 20;
    let of_axis = |x: f32| ((x / side).floor() as i64).rem_euclid(RANGE) as u64;
    let [x, y, z] = hit.position.to_array().map(of_axis);
    let axis = normal.abs().max_position();
    let looks = 2 * axis as u64 + u64::from(normal[axis] < 0.0);
    (x << 40 | y << 20 | z) << 3 | looks
}

/// Remembers where walks could end.
#[derive(Default)]
pub(super) struct Scout {
    pub(super) found: Vec<Place>,
}

impl Deposit for Scout {
    const KNOWS: bool = true;

    fn scattered(&mut self, _: u32, _: Vec3) {}

    fn seen(&mut self, _: u32, _: Vec3) {}

    fn known(&mut self, at: &KnownAt<'_>) -> bool {
        self.found.push((*at.hit, at.normal));
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// On the floor.
    fn place(position: Vec3) -> Place {
        let normal = Vec3::Y;
        let hit =
            SurfaceHit { triangle: 0, t: 0.0, position, barycentric: Vec3::ZERO, normal, clearance: 0.0, extent: 1.0 };
        (hit, normal)
    }

    #[test]
    fn cells_are_no_longer_than_wide_far_from_the_origin() {
        for moved in [Vec3::ZERO, Vec3::X * 3e5, Vec3::new(-4e5, 0.0, 5e5)] {
            // 64 × 64 places an eighth of a meter apart, which are told apart there.
            let at = |nth: u32| Vec3::new((nth % 64) as f32, 0.0, (nth / 64) as f32) * 0.125 + moved;
            let found: Vec<Place> = (0..64 * 64).map(|nth| place(at(nth))).collect();
            let side = Cells::fit(&found, 256).side;
            let mut cells: HashMap<u64, Vec<Vec3>> = HashMap::new();
            found.iter().for_each(|place| cells.entry(key(place, side)).or_default().push(place.0.position));
            assert!((128..=256).contains(&cells.len()), "{} cells at {moved}", cells.len());
            let lengths = cells.values().flat_map(|all| all.iter().map(move |at| at.distance(all[0])));
            let longest = lengths.fold(0.0, f32::max);
            assert!(longest < 1.5, "a cell is {longest} m long at {moved}");
        }
    }
}
