//! The dome of patches: Tregenza's 145 above the horizon, each divided as \[Reinhart2006\] does, and their mirror image
//! below it, undivided.

use std::f64::consts::{FRAC_PI_2, TAU};

use glam::{Vec2, Vec3};

use super::environment::uv_of;
use super::{Environment, Turn};

/// Divisions of the side of a Tregenza patch that are offered: 145, 577 and 2305 patches above the horizon.
pub const DOME_DIVISIONS: [u32; 3] = [1, 2, 4];

/// Patches of each of Tregenza's seven rows from the horizon up; a cap of half a row's height closes the dome.
/// \[Tregenza1987\]
const ROW_PATCHES: [u32; 7] = [30, 30, 24, 24, 18, 12, 6];

/// A row of patches.
#[derive(Clone, Copy, Debug)]
struct Band {
    /// Sines of the elevations between which it lies, the lower one first.
    sines: [f64; 2],
    /// Index of its first patch.
    first: u32,
    /// Patches around.
    n: u32,
}

/// Patches that tile all directions. They are counted from the nadir up, around by `u` of a map.
#[derive(Clone, Debug)]
pub struct Dome {
    bands: Vec<Band>,
}

/// Columns of a sky with a dome of that many divisions: its patches, one for the map as it was baked, and one for what the
/// camera sees.
pub fn dome_columns(divisions: u32) -> u32 {
    // The product of a number from an untrusted file saturates far above any real one.
    144u32.saturating_mul(divisions.saturating_mul(divisions)).saturating_add(1 + 145 + 2)
}

impl Dome {
    /// With 144 · divisions² + 1 patches above the horizon and 145 below.
    pub fn new(divisions: u32) -> Dome {
        let mut dome = Dome { bands: Vec::new() };
        for (sines, n) in rows(1).into_iter().rev() {
            dome.push([-sines[1], -sines[0]], n);
        }
        for (sines, n) in rows(divisions) {
            dome.push(sines, n);
        }
        dome
    }

    fn push(&mut self, sines: [f64; 2], n: u32) {
        self.bands.push(Band { sines, first: self.n_patches(), n });
    }

    /// Number of patches.
    pub fn n_patches(&self) -> u32 {
        self.bands.last().map_or(0, |band| band.first + band.n)
    }

    fn band_of(&self, patch: u32) -> &Band {
        &self.bands[self.bands.partition_point(|band| band.first <= patch) - 1]
    }

    /// Solid angle of a patch.
    pub fn solid_angle(&self, patch: u32) -> f32 {
        let band = self.band_of(patch);
        ((band.sines[1] - band.sines[0]) * TAU / f64::from(band.n)) as f32
    }

    /// Sines of the elevations between which a patch lies, the lower one first, and its edges around as shares of the circle.
    pub(super) fn edges(&self, patch: u32) -> ([f64; 2], [f64; 2]) {
        let band = self.band_of(patch);
        let nth = patch - band.first;
        (band.sines, [nth, nth + 1].map(|edge| f64::from(edge) / f64::from(band.n)))
    }

    /// The patch that a unit direction lies in.
    pub fn patch(&self, direction: Vec3) -> u32 {
        self.place(direction).0
    }

    /// The patch that a unit direction lies in, and where in it, 0…1: what [`Dome::direction`] makes a direction of.
    pub fn place(&self, direction: Vec3) -> (u32, Vec2) {
        let above = self.bands.partition_point(|band| band.sines[0] <= f64::from(direction.y));
        let band = &self.bands[above.max(1) - 1];
        let around = uv_of(direction).x * band.n as f32;
        let nth = (around as u32).min(band.n - 1);
        let up = (f64::from(direction.y) - band.sines[0]) / (band.sines[1] - band.sines[0]);
        (band.first + nth, Vec2::new(around - nth as f32, up as f32))
    }

    /// A unit direction in a patch, uniform over its solid angle; `u` in [0, 1)².
    pub fn direction(&self, patch: u32, u: Vec2) -> Vec3 {
        let band = self.band_of(patch);
        let y = (band.sines[0] + (band.sines[1] - band.sines[0]) * f64::from(u.y)) as f32;
        let around = ((patch - band.first) as f32 + u.x) / band.n as f32;
        let (sin, cos) = (std::f32::consts::TAU * (around - 0.5)).sin_cos();
        let r = (1.0 - y * y).max(0.0).sqrt();
        Vec3::new(r * cos, y, r * sin)
    }

    /// Mean radiance of a map over each patch. Pixels and patches are both boxes in azimuth and sine of elevation, so
    /// their overlaps are exact and no light is lost, however the map is turned.
    pub fn means(&self, map: &Environment, turn: Turn) -> Vec<[f32; 3]> {
        let mut means = vec![[0.0; 3]; self.n_patches() as usize];
        for row in &map.coarse().rows {
            for band in &self.bands {
                let shared = band.sines[1].min(row.sines[1]) - band.sines[0].max(row.sines[0]);
                if shared > 0.0 {
                    let share = shared / (band.sines[1] - band.sines[0]);
                    band.add_row(&row.cells, f64::from(turn.share), share, &mut means);
                }
            }
        }
        means.into_iter().map(|mean| mean.map(|v| v as f32)).collect()
    }
}

impl Band {
    /// Adds a row of pixels that fills a share of the band's height.
    fn add_row(&self, pixels: &[[f32; 3]], turned: f64, share: f64, means: &mut [[f64; 3]]) {
        let width = pixels.len() as f64;
        for nth in 0..self.n {
            let edge = |nth: u32| (f64::from(nth) / f64::from(self.n) + turned) * width;
            let (start, end) = (edge(nth), edge(nth + 1));
            let mean = &mut means[(self.first + nth) as usize];
            for column in start.floor() as u64..end.ceil() as u64 {
                let covered = end.min(column as f64 + 1.0) - start.max(column as f64);
                let weight = covered.max(0.0) / (end - start) * share;
                let pixel = pixels[column as usize % pixels.len()];
                mean.iter_mut().zip(pixel).for_each(|(mean, v)| *mean += weight * f64::from(v));
            }
        }
    }
}

/// Sines and counts of the rows above the horizon, from there up.
fn rows(divisions: u32) -> Vec<([f64; 2], u32)> {
    let n_rows = 7 * divisions;
    let height = FRAC_PI_2 / (f64::from(n_rows) + 0.5);
    let sine = |row: u32| if row > n_rows { 1.0 } else { (height * f64::from(row)).sin() };
    let count = |row: u32| ROW_PATCHES.get((row / divisions) as usize).map_or(1, |n| n * divisions);
    (0..=n_rows).map(|row| ([sine(row), sine(row + 1)], count(row))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampler::Sampler;

    #[test]
    fn patches_are_counted_as_reinhart_does_and_tile_the_sphere() {
        for (divisions, n) in DOME_DIVISIONS.into_iter().zip([145, 577, 2305]) {
            let dome = Dome::new(divisions);
            assert_eq!(dome.n_patches(), n + 145);
            assert_eq!(dome_columns(divisions), dome.n_patches() + 2);
            let total: f64 = (0..dome.n_patches()).map(|p| f64::from(dome.solid_angle(p))).sum();
            assert!((total - 2.0 * TAU).abs() < 1e-4, "{total}");
        }
    }

    #[test]
    fn every_direction_lies_in_the_patch_that_made_it() {
        for divisions in DOME_DIVISIONS {
            let dome = Dome::new(divisions);
            for patch in 0..dome.n_patches() {
                for u in [[0.001, 0.001], [0.999, 0.001], [0.5, 0.5], [0.001, 0.999], [0.999, 0.999]] {
                    let d = dome.direction(patch, Vec2::from(u));
                    assert!((d.length() - 1.0).abs() < 1e-5);
                    let (found, within) = dome.place(d);
                    assert_eq!(found, patch, "{divisions} {u:?}");
                    assert!((within - Vec2::from(u)).abs().max_element() < 0.01, "{divisions} {u:?}: {within}");
                }
            }
            assert_eq!(dome.patch(Vec3::Y), dome.n_patches() - 1);
            assert_eq!(dome.patch(Vec3::NEG_Y), 0);
        }
    }

    #[test]
    fn uniform_directions_reach_patches_by_their_solid_angle() {
        let (dome, n) = (Dome::new(1), 200_000);
        let mut counts = vec![0.0; dome.n_patches() as usize];
        for index in 0..n {
            let [u, v] = Sampler::new(5, index, 0).next_2d();
            let y = 1.0 - 2.0 * u;
            let (sin, cos) = (std::f32::consts::TAU * v).sin_cos();
            let r = (1.0 - y * y).sqrt();
            counts[dome.patch(Vec3::new(r * cos, y, r * sin)) as usize] += 1.0;
        }
        let chi_square: f64 = (0..dome.n_patches())
            .map(|patch| {
                let expected = n as f64 * f64::from(dome.solid_angle(patch)) / (2.0 * TAU);
                (counts[patch as usize] - expected).powi(2) / expected
            })
            .sum();
        let freedom = f64::from(dome.n_patches()) - 1.0;
        assert!(chi_square < freedom + 5.0 * (2.0 * freedom).sqrt(), "{chi_square}");
    }

    #[test]
    fn directions_of_a_patch_are_uniform_over_it() {
        // The mean of the sine of the elevation over a patch is the middle of its sines.
        let (dome, n) = (Dome::new(1), 4096);
        for patch in [0, 3, 150, 289] {
            let mean: f32 =
                (0..n).map(|i| dome.direction(patch, Vec2::from(Sampler::new(1, 2, i).next_2d())).y / n as f32).sum();
            let [low, high] = dome.band_of(patch).sines;
            assert!((f64::from(mean) - 0.5 * (low + high)).abs() < 1e-3 * (high - low).max(0.05), "{patch}: {mean}");
        }
    }

    #[test]
    fn no_light_of_a_map_is_lost_in_patches_however_it_is_turned() {
        let map = Environment::from_fn(50, 24, |d| (d * 3.0).exp() + Vec3::new(0.0, 1.0, 5.0));
        let cells = map.cell_means();
        let flux: f64 = (0..50 * 24).map(|i| f64::from(cells[i][1]) * map.solid_angle(i / 50)).sum();
        for (divisions, rotation) in [(1, 0.0), (1, 33.0), (2, -170.5), (4, 359.0)] {
            let dome = Dome::new(divisions);
            let means = dome.means(&map, Turn::new(rotation));
            let sum: f64 = means.iter().zip(0..).map(|(m, p)| f64::from(m[1]) * f64::from(dome.solid_angle(p))).sum();
            assert!((sum / flux - 1.0).abs() < 1e-5, "{divisions} {rotation}: {sum} of {flux}");
        }
        let flat = Dome::new(2).means(&Environment::uniform(Vec3::new(1.0, 2.0, 3.0)), Turn::new(17.0));
        assert!(flat.iter().all(|m| (Vec3::from(*m) - Vec3::new(1.0, 2.0, 3.0)).abs().max_element() < 1e-5));
    }

    #[test]
    fn a_turned_map_is_the_map_seen_from_a_turned_direction() {
        let map = Environment::from_fn(256, 128, |d| Vec3::splat(2.0 + d.x + 0.5 * d.z * d.y));
        let (dome, turn) = (Dome::new(2), Turn::new(40.0));
        let means = dome.means(&map, turn);
        // The caps lie around their middle, other patches beside it.
        for patch in (1..dome.n_patches() - 1).step_by(37) {
            let d = dome.direction(patch, Vec2::splat(0.5));
            let seen = map.radiance(turn.sky_from_world(d)).x;
            assert!((means[patch as usize][0] - seen).abs() < 0.03, "{patch}: {} {seen}", means[patch as usize][0]);
        }
    }
}
