//! Directions of a patch of the dome in proportion to the luminance of a map in it.

use std::f64::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use super::sampler::pick;
use super::{Dome, Environment, Turn};
use crate::light::luminance;

/// A density over the azimuths and polar angles of a patch: the luminance of the bilinear map, exactly.
///
/// The patch is cut into boxes along the lines between the centers of pixels. Within a box the luminance is bilinear in both
/// angles, so that a box is picked by its mean and a place in it by solving two quadratic equations; however small a sun is,
/// all of its samples count alike.
#[derive(Clone, Debug)]
pub struct PatchSampler {
    /// Edges in rows of the map, the upper one first.
    rows: [f64; 2],
    /// Edges in columns of the map, as it is turned; whole numbers are the centers of pixels.
    columns: [f64; 2],
    /// Summed light of the strips between rows.
    down: Vec<f32>,
    /// Summed light of the boxes of each strip, within their strip.
    across: Vec<f32>,
    /// Luminance, integrated over azimuth and polar angle, nit · rad².
    total: f32,
    brightest: f32,
}

impl PatchSampler {
    /// For a patch under a map as it is turned.
    pub fn new(map: &Environment, turn: Turn, dome: &Dome, patch: u32) -> PatchSampler {
        let (sines, around) = dome.edges(patch);
        let [width, height] = sides(map);
        let rows = [sines[1], sines[0]].map(|sine| sine.clamp(-1.0, 1.0).acos() / PI * height);
        let columns = around.map(|share| (share + f64::from(turn.share)) * width - 0.5);
        let (mut down, mut across) = (Vec::new(), Vec::new());
        let (mut total, mut brightest) = (0.0, 0.0f32);
        for strip in 0..n_strips(rows) {
            let high = strip_of(rows, strip);
            let mut sum = 0.0;
            for place in 0..n_strips(columns) {
                let wide = strip_of(columns, place);
                let corners = corners(map, high, wide);
                brightest = corners.as_flattened().iter().copied().fold(brightest, f32::max);
                let mean = 0.25 * corners.as_flattened().iter().map(|&at| f64::from(at)).sum::<f64>();
                sum += mean * (wide[1] - wide[0]);
                across.push(sum as f32);
            }
            total += sum * (high[1] - high[0]);
            down.push(total as f32);
        }
        let total = (total * (TAU / width) * (PI / height)) as f32;
        PatchSampler { rows, columns, down, across, total, brightest }
    }

    /// Greatest luminance in the patch, nit.
    pub fn brightest(&self) -> f32 {
        self.brightest
    }

    /// (u, v) in the map of a direction of the patch; `u` in [0, 1)². The patch must not be black.
    pub fn sample(&self, map: &Environment, u: Vec2) -> Vec2 {
        let (strip, down) = pick(&self.down, u.x);
        let n_places = self.across.len() / self.down.len();
        let (place, across) = pick(&self.across[strip * n_places..][..n_places], u.y);
        let (high, wide) = (strip_of(self.rows, strip), strip_of(self.columns, place));
        let [[a, b], [c, d]] = corners(map, high, wide);
        let down = along(a + b, c + d, down);
        let across = along(a + (c - a) * down, b + (d - b) * down, across);
        let at = |[start, end]: [f64; 2], part: f32| start + (end - start) * f64::from(part);
        let [width, height] = sides(map);
        let turns = (at(wide, across) + 0.5) / width;
        Vec2::new((turns - turns.floor()) as f32, (at(high, down) / height) as f32)
    }

    /// Solid-angle density of a unit direction of the patch in which the map has some luminance, nit.
    pub fn pdf(&self, direction: Vec3, luminance: f32) -> f32 {
        let sine = direction.x.hypot(direction.z).max(f32::EPSILON);
        luminance / (self.total * sine)
    }
}

/// Columns around a map, and rows from the zenith to the nadir.
fn sides(map: &Environment) -> [f64; 2] {
    [map.width() as f64, (map.height() - 1).max(1) as f64]
}

/// Strips between whole numbers that a stretch is cut into.
fn n_strips([start, end]: [f64; 2]) -> usize {
    ((end.ceil() - start.floor()) as usize).max(1)
}

/// Edges of one of them.
fn strip_of([start, end]: [f64; 2], nth: usize) -> [f64; 2] {
    let line = start.floor() + nth as f64;
    [line.max(start), (line + 1.0).min(end)]
}

/// Luminance at the corners of a box between neighboring centers of pixels: the upper two first, each from the left.
fn corners(map: &Environment, rows: [f64; 2], columns: [f64; 2]) -> [[f32; 2]; 2] {
    let (row, column) = (rows[0].floor(), columns[0].floor());
    let (width, last) = (map.width(), map.height() - 1);
    let left = column.rem_euclid(width as f64) as usize % width;
    let right = if left + 1 == width { 0 } else { left + 1 };
    let parts = columns.map(|at| (at - column) as f32);
    let across = |row: usize| {
        let pixels = &map.pixels()[row.min(last) * width..][..width];
        let [a, b] = [left, right].map(|column| luminance(Vec3::from(pixels[column])));
        parts.map(|part| a + (b - a) * part)
    };
    let (upper, lower) = (across(row as usize), across(row as usize + 1));
    rows.map(|at| (at - row) as f32).map(|part| [0, 1].map(|side| upper[side] + (lower[side] - upper[side]) * part))
}

/// Where a uniform number falls along a stretch whose density goes linearly from one value to another.
fn along(from: f32, to: f32, u: f32) -> f32 {
    let root = (from * from + (to * to - from * from) * u).max(0.0).sqrt();
    let across = u * (from + to) / (from + root);
    // Where both are next to nothing their squares are nothing.
    if across.is_finite() { across.clamp(0.0, 1.0) } else { u }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampler::Sampler;
    use crate::sky::environment::direction_at;

    /// One pixel shines in a dim map.
    fn with_a_sun(width: usize, height: usize, sun: usize) -> Environment {
        let mut pixels = vec![[0.1; 3]; width * height];
        pixels[sun] = [1e4; 3];
        Environment::new(width, height, pixels).unwrap().0
    }

    /// The patch in which a map is brightest, and its sampler.
    fn brightest(map: &Environment, turn: Turn, dome: &Dome) -> (u32, PatchSampler) {
        let samplers = (0..dome.n_patches()).map(|patch| (patch, PatchSampler::new(map, turn, dome, patch)));
        samplers.max_by(|a, b| a.1.total.total_cmp(&b.1.total)).unwrap()
    }

    #[test]
    fn the_density_of_a_patch_integrates_to_one() {
        let (dome, turn, n) = (Dome::new(1), Turn::new(33.0), 600);
        for map in [with_a_sun(90, 45, 10 * 90 + 17), with_a_sun(90, 45, 89), with_a_sun(1, 1, 0), with_a_sun(3, 2, 1)]
        {
            let (sunny, _) = brightest(&map, turn, &dome);
            for patch in [0, 20, sunny, dome.n_patches() - 1] {
                let sampler = PatchSampler::new(&map, turn, &dome, patch);
                let (sines, [left, right]) = dome.edges(patch);
                let [bottom, top] = sines.map(f64::acos);
                let middle = |nth: i32| (f64::from(nth) + 0.5) / f64::from(n);
                let density = |at: i32| {
                    let u = left + (right - left) * middle(at % n);
                    let polar = top + (bottom - top) * middle(at / n);
                    let d = direction_at(Vec2::new(u as f32, (polar / PI) as f32));
                    f64::from(sampler.pdf(d, luminance(map.radiance(turn.sky_from_world(d))))) * polar.sin()
                };
                let area = (right - left) * TAU * (bottom - top);
                let sum = (0..n * n).map(density).sum::<f64>() * area / f64::from(n * n);
                assert!((sum - 1.0).abs() < 2e-3, "{} × {}, patch {patch}: {sum}", map.width(), map.height());
            }
        }
    }

    #[test]
    fn samples_of_a_patch_lie_in_it_and_count_alike() {
        let (dome, turn) = (Dome::new(1), Turn::new(-71.0));
        for sun in [20 * 200 + 150, 20 * 200 + 199, 31 * 200, 77 * 200 + 13] {
            let map = with_a_sun(200, 100, sun);
            let (patch, sampler) = brightest(&map, turn, &dome);
            let (mut n_there, mut sum, mut most) = (0, 0.0, 0.0f64);
            let n = 4096;
            for index in 0..n {
                let uv = sampler.sample(&map, Vec2::from(Sampler::new(3, 1, index).next_2d()));
                let d = direction_at(uv);
                n_there += u32::from(dome.patch(turn.world_from_sky(d)) == patch);
                let light = luminance(map.radiance(d));
                let counts = f64::from(light / sampler.pdf(d, light));
                sum += counts / f64::from(n);
                most = most.max(counts);
            }
            // Rounding may carry a sample over the edge of its patch.
            assert!(n_there > n - 20, "{n_there} of {n}");
            let fine = 600;
            let at = |i: u32| (Vec2::new((i % fine) as f32, (i / fine) as f32) + 0.5) / fine as f32;
            let seen = |i| f64::from(luminance(map.radiance(turn.sky_from_world(dome.direction(patch, at(i))))));
            let mean = (0..fine * fine).map(seen).sum::<f64>() / f64::from(fine * fine);
            let light = mean * f64::from(dome.solid_angle(patch));
            assert!((sum / light - 1.0).abs() < 0.01, "sun at {sun}: {sum} for {light}");
            // A patch is 12° high, and the polar angle alone tells samples apart.
            assert!(most < 1.5 * light, "sun at {sun}: a sample of {most} for {light}");
        }
    }

    #[test]
    fn places_along_a_slope_are_as_dense_as_it_is_high() {
        for [from, to] in [[1.0, 1.0], [0.0, 2.0], [3.0, 0.0], [1.0, 5.0], [0.0, 0.0]] {
            for u in [0.0, 0.2, 0.5, 0.9, 1.0] {
                let at = along(from, to, u);
                let below = if from + to > 0.0 { at * (2.0 * from + (to - from) * at) / (from + to) } else { at };
                assert!((below - u).abs() < 1e-5, "{from} {to} {u}: {at}");
            }
        }
    }
}
