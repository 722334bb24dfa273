//! A picture of all directions, as an equirectangular map of radiance.
//!
//! Columns are centered within their share of the circle. Rows reach from pole to pole: the first is the zenith itself, the
//! last the nadir, as Mitsuba has it, whose pictures hold ours to account; the difference to rows that are centered within
//! their share of the height is half a row at the poles and none at the horizon.

// What is read here was written by strangers, so no integer may wrap in silence.
#![cfg_attr(not(test), deny(clippy::arithmetic_side_effects))]
#![cfg_attr(not(test), deny(clippy::cast_possible_truncation, clippy::cast_sign_loss))]

use std::f32::consts::{PI, TAU};
use std::sync::{Arc, OnceLock};

use glam::{DVec3, Vec2, Vec3};
use half::f16;
use rayon::prelude::*;

use super::SkyError;
use super::coarse::Coarse;

/// Equirectangular radiance in nit, linear Rec. 709, bilinear between the centers of its pixels.
#[derive(Clone, Debug)]
pub struct Environment {
    width: usize,
    height: usize,
    /// Row-major from the zenith down.
    pixels: Vec<[f32; 3]>,
    fingerprint: u64,
    coarse: OnceLock<Arc<Coarse>>,
}

/// How many pixels of a map were not as they can be.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cleaned {
    /// With a value that is negative or no number.
    pub n_black: usize,
    /// With a value that is infinite, or brighter than any is believed.
    pub n_capped: usize,
}

impl Cleaned {
    /// Counts a pixel as it was read.
    #[expect(clippy::arithmetic_side_effects, reason = "counts of the pixels of a picture")]
    pub(super) fn count(&mut self, pixel: [f32; 3]) {
        self.n_black += usize::from(pixel.iter().any(|v| v.is_nan() || *v < 0.0));
        self.n_capped += usize::from(pixel.iter().any(|v| *v > Environment::MAX_NIT));
    }
}

/// What is taken for a channel that is not infinite.
pub(super) fn believed(channel: f32) -> f32 {
    if channel >= 0.0 { channel.min(Environment::MAX_NIT) } else { 0.0 }
}

/// The uniform sky of 1 nit.
impl Default for Environment {
    fn default() -> Self {
        Environment::uniform(Vec3::ONE)
    }
}

/// By fingerprint: maps are large and compared often.
impl PartialEq for Environment {
    fn eq(&self, other: &Self) -> bool {
        (self.width, self.height, self.fingerprint) == (other.width, other.height, other.fingerprint)
    }
}

#[expect(clippy::arithmetic_side_effects, reason = "sides and places of maps that `is_size` has let in")]
impl Environment {
    /// Most pixels that a map has; files of more are averaged down.
    pub const MAX_PIXELS: usize = 1 << 25;
    /// Brightest channel that is believed, in nit; the sun's disk has 2·10⁹.
    pub const MAX_NIT: f32 = 1e12;

    /// From pixels, row-major from the zenith down. Values that are no numbers or negative become black, those beyond
    /// [`Environment::MAX_NIT`] as bright as that, and infinite ones as bright as the brightest finite one, but no darker than
    /// the largest number of half precision, which overflowed where files come from; says how many pixels held such.
    ///
    /// # Errors
    /// [`SkyError::Size`].
    pub fn new(width: usize, height: usize, mut pixels: Vec<[f32; 3]>) -> Result<(Environment, Cleaned), SkyError> {
        if !Environment::is_size(width, height) || pixels.len() != width * height {
            return Err(SkyError::Size { width, height });
        }
        let finite = pixels.iter().flatten().copied().filter(|v| v.is_finite());
        let overflowed = finite.fold(f16::MAX.to_f32(), f32::max);
        let mut cleaned = Cleaned::default();
        for pixel in &mut pixels {
            cleaned.count(*pixel);
            *pixel = pixel.map(|v| believed(if v == f32::INFINITY { overflowed } else { v }));
        }
        Ok((Environment::of_clean(width, height, pixels), cleaned))
    }

    /// What is the same for maps that are.
    pub(crate) fn fingerprint(&self) -> u64 {
        self.fingerprint
    }

    /// Whether a map of that size can be used.
    pub fn is_size(width: usize, height: usize) -> bool {
        width > 0 && height > 0 && width.checked_mul(height).is_some_and(|n| n <= Environment::MAX_PIXELS)
    }

    pub(super) fn of_clean(width: usize, height: usize, pixels: Vec<[f32; 3]>) -> Environment {
        // In rows of another length the same pixels are another map. No map that is twice as wide as high has as many pixels as a square:
        // these two, which nearly all maps are, are told from all others without a word.
        let is_usual = width == height || width == 2 * height;
        let sides = (!is_usual).then_some([width as u64, height as u64]);
        let words = pixels.iter().flatten().map(|v| u64::from(v.to_bits())).chain(sides.into_iter().flatten());
        let fingerprint = words.fold(0xcbf2_9ce4_8422_2325, |hash: u64, word| {
            let hash = (hash ^ word).wrapping_mul(0x0000_0100_0000_01B3);
            hash ^ (hash >> 29)
        });
        Environment { width, height, pixels, fingerprint, coarse: OnceLock::new() }
    }

    /// The same radiance everywhere.
    pub fn uniform(radiance: Vec3) -> Environment {
        Environment::of_clean(1, 1, vec![radiance.max(Vec3::ZERO).to_array()])
    }

    /// Sampled at the centers of its pixels.
    pub fn from_fn(width: usize, height: usize, radiance: impl Fn(Vec3) -> Vec3) -> Environment {
        let at = |idx: usize| radiance(direction_of_pixel(idx, width, height)).max(Vec3::ZERO).to_array();
        Environment::of_clean(width, height, (0..width * height).map(at).collect())
    }

    /// Pixels around.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Pixels from zenith to nadir.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Row-major from the zenith down.
    pub fn pixels(&self) -> &[[f32; 3]] {
        &self.pixels
    }

    /// Radiance in nit that arrives from a unit direction of the map.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "places in a map of at most `MAX_PIXELS` pixels"
    )]
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        let at = self.place(direction) - Vec2::new(0.5, 0.0);
        let base = at.floor();
        let part = at - base;
        // Half a pixel before the first column is the last one.
        let x = if base.x < 0.0 { self.width - 1 } else { (base.x as usize).min(self.width - 1) };
        let next = if x + 1 == self.width { 0 } else { x + 1 };
        let (y, last) = (base.y as usize, self.height - 1);
        let row = |y: usize| &self.pixels[y.min(last) * self.width..][..self.width];
        let mix = |row: &[[f32; 3]]| Vec3::from(row[x]).lerp(Vec3::from(row[next]), part.x);
        let (upper, lower) = (mix(row(y)), mix(row(y + 1)));
        upper.lerp(lower, part.y)
    }

    /// Column and row of a unit direction: a pixel's column reaches from its number to the next, its row half to
    /// either side of its number.
    pub(super) fn place(&self, direction: Vec3) -> Vec2 {
        uv_of(direction) * Vec2::new(self.width as f32, (self.height - 1) as f32)
    }

    /// Means of [`Environment::radiance`] over the area of each pixel: bright neighbors reach in by an eighth.
    pub fn cell_means(&self) -> Vec<[f32; 3]> {
        let (w, h) = (self.width, self.height);
        let mix = |before: &[f32; 3], own: &[f32; 3], after: &[f32; 3]| -> [f32; 3] {
            std::array::from_fn(|c| 0.125 * (before[c] + after[c]) + 0.75 * own[c])
        };
        let row = |y: usize| &self.pixels[y * w..(y + 1) * w];
        let mut means = vec![[0.0; 3]; w * h];
        means.par_chunks_exact_mut(w).enumerate().for_each(|(y, means)| {
            // The first and the last row are half as high, and have neighbors on one side.
            let (before, after) = (if y == 0 { 1 } else { y - 1 }, if y + 1 == h { h.max(2) - 2 } else { y + 1 });
            let rows = row(before.min(h - 1)).iter().zip(row(y)).zip(row(after));
            let down: Vec<[f32; 3]> = rows.map(|((before, own), after)| mix(before, own, after)).collect();
            for (x, mean) in means.iter_mut().enumerate() {
                let (left, right) = (if x == 0 { w - 1 } else { x - 1 }, if x + 1 == w { 0 } else { x + 1 });
                *mean = mix(&down[left], &down[x], &down[right]);
            }
        });
        means
    }

    /// As coarse as patches need it.
    pub(super) fn coarse(&self) -> &Coarse {
        self.coarse.get_or_init(|| Arc::new(Coarse::new(self)))
    }

    /// Sines of the elevations between which a row of pixels lies, the lower one first.
    pub fn row_sines(&self, row: usize) -> [f64; 2] {
        row_sines(self.height, row)
    }

    /// Irradiance in lux per channel on a level surface that sees all of the upper half.
    pub fn level_irradiance(&self) -> Vec3 {
        level_irradiance(self.coarse().rows.iter().map(|row| (row.sines, row.cells.as_slice())))
    }

    /// Solid angle of a pixel of a row.
    pub fn solid_angle(&self, row: usize) -> f64 {
        let [low, high] = self.row_sines(row);
        (high - low) * std::f64::consts::TAU / self.width as f64
    }
}

/// Sines of the elevations between which a row of a map of a height lies, the lower one first.
#[expect(clippy::arithmetic_side_effects, reason = "a map has a row at least")]
pub(super) fn row_sines(height: usize, row: usize) -> [f64; 2] {
    if height == 1 {
        return [-1.0, 1.0];
    }
    let last = (height - 1) as f64;
    let sine = |edge: f64| ((edge / last).clamp(0.0, 1.0) * std::f64::consts::PI).cos();
    [sine(row as f64 + 0.5), sine(row as f64 - 0.5)]
}

/// Irradiance on a level surface of rows, each with its sines and its pixels, all of one width.
pub(super) fn level_irradiance<'a>(rows: impl Iterator<Item = ([f64; 2], &'a [[f32; 3]])>) -> Vec3 {
    let row = |([low, high], pixels): ([f64; 2], &[[f32; 3]])| {
        let [low, high] = [low, high].map(|sine| sine.max(0.0));
        let mean = pixels.iter().fold(DVec3::ZERO, |sum, p| sum + Vec3::from(*p).as_dvec3()) / pixels.len() as f64;
        mean * std::f64::consts::PI * (high * high - low * low)
    };
    rows.map(row).sum::<DVec3>().as_vec3()
}

/// Direction of the center of a pixel of a map, row-major from the zenith down.
#[expect(clippy::arithmetic_side_effects, reason = "sides and places of maps that `is_size` has let in")]
pub(super) fn direction_of_pixel(idx: usize, width: usize, height: usize) -> Vec3 {
    let u = ((idx % width) as f32 + 0.5) / width as f32;
    direction_at(Vec2::new(u, (idx / width) as f32 / (height - 1).max(1) as f32))
}

/// Unit direction at (u, v) of a map.
pub fn direction_at(uv: Vec2) -> Vec3 {
    let (sin_phi, cos_phi) = (TAU * (uv.x - 0.5)).sin_cos();
    let (sin_theta, cos_theta) = (PI * uv.y).sin_cos();
    Vec3::new(sin_theta * cos_phi, cos_theta, sin_theta * sin_phi)
}

/// (u, v) of a direction, each 0…1.
pub fn uv_of(direction: Vec3) -> Vec2 {
    let u = direction.z.atan2(direction.x) / TAU + 0.5;
    let v = direction.x.hypot(direction.z).atan2(direction.y) / PI;
    Vec2::new(u, v)
}

#[cfg(test)]
impl Environment {
    /// Of the whole sphere, per channel.
    pub(crate) fn light(&self) -> [f64; 3] {
        let of = |c: usize| {
            let pixels = self.pixels.iter().enumerate();
            pixels.map(|(idx, pixel)| f64::from(pixel[c]) * self.solid_angle(idx / self.width)).sum::<f64>()
        };
        std::array::from_fn(of)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gradient() -> Environment {
        Environment::from_fn(64, 32, |d| Vec3::new(1.0 + d.x, 1.0 + d.y, 1.0 + d.z))
    }

    #[test]
    fn the_center_of_a_map_is_plus_x_and_its_top_is_up() {
        assert!((uv_of(Vec3::X) - Vec2::new(0.5, 0.5)).length() < 1e-6);
        assert!((uv_of(Vec3::Z) - Vec2::new(0.75, 0.5)).length() < 1e-6);
        assert!(uv_of(Vec3::Y).y < 1e-6);
        for uv in [Vec2::new(0.1, 0.2), Vec2::new(0.93, 0.71)] {
            assert!((uv_of(direction_at(uv)) - uv).length() < 1e-6);
        }
    }

    #[test]
    fn the_same_pixels_in_rows_of_another_length_are_another_map() {
        let pixels: Vec<[f32; 3]> = (0..8u8).map(|nth| [f32::from(nth); 3]).collect();
        let fingerprint =
            |(width, height): (usize, usize)| Environment::of_clean(width, height, pixels.clone()).fingerprint();
        let mut found = [(8, 1), (4, 2), (2, 4), (1, 8)].map(fingerprint).to_vec();
        found.sort_unstable();
        found.dedup();
        assert_eq!(found.len(), 4, "{found:?}");
    }

    #[test]
    fn a_map_gives_back_what_it_was_made_of_across_its_seam_too() {
        let map = gradient();
        for d in [Vec3::new(-1.0, 0.1, 0.001), Vec3::new(-1.0, 0.1, -0.001), Vec3::new(0.2, -0.7, 0.5)] {
            let d = d.normalize();
            assert!((map.radiance(d) - (d + 1.0)).abs().max_element() < 0.01, "{d}: {}", map.radiance(d));
        }
    }

    #[test]
    fn broken_pixels_become_black_and_are_counted() {
        let pixels = vec![[1.0, f32::NAN, 0.5], [f32::NEG_INFINITY; 3], [-1.0, 2.0, 0.0], [0.25; 3]];
        let (map, cleaned) = Environment::new(2, 2, pixels).unwrap();
        assert_eq!(cleaned, Cleaned { n_black: 3, n_capped: 0 });
        assert_eq!(map.pixels(), [[1.0, 0.0, 0.5], [0.0; 3], [0.0, 2.0, 0.0], [0.25; 3]]);
        assert!(Environment::new(0, 2, vec![]).is_err() && Environment::new(usize::MAX, 2, vec![]).is_err());
    }

    #[test]
    fn what_overflowed_is_no_darker_than_anything_else() {
        for (brightest, overflowed) in [(3.0, 65504.0), (1e6, 1e6), (1e20, Environment::MAX_NIT)] {
            let pixels = vec![[f32::INFINITY, 1.0, 0.0], [brightest; 3]];
            let (map, cleaned) = Environment::new(2, 1, pixels).unwrap();
            assert_eq!(map.pixels()[0], [overflowed, 1.0, 0.0]);
            let n_capped = if brightest > Environment::MAX_NIT { 2 } else { 1 };
            assert_eq!(cleaned, Cleaned { n_black: 0, n_capped });
        }
    }

    #[test]
    fn a_uniform_sky_gives_pi_times_its_radiance_on_a_level_surface() {
        let expected = Vec3::new(1.0, 2.0, 3.0) * PI;
        for map in [Environment::uniform(expected / PI), Environment::from_fn(40, 31, |_| expected / PI)] {
            assert!((map.level_irradiance() - expected).abs().max_element() < 1e-4, "{}", map.level_irradiance());
        }
    }

    #[test]
    fn pixels_tile_the_sphere_and_cell_means_are_those_of_the_interpolation() {
        let map = gradient();
        let total: f64 = (0..map.height()).map(|row| map.solid_angle(row) * map.width() as f64).sum();
        assert!((total - 4.0 * std::f64::consts::PI).abs() < 1e-9);
        let (means, n) = (map.cell_means(), 32);
        for cell in [5 * 64 + 63, 16 * 64, 20 * 64 + 31] {
            let sum = (0..n * n).fold(Vec3::ZERO, |sum, i| {
                let at = Vec2::new((cell % 64) as f32, (cell / 64) as f32 - 0.5)
                    + (Vec2::new((i % n) as f32, (i / n) as f32) + 0.5) / n as f32;
                sum + map.radiance(direction_at(at / Vec2::new(64.0, 31.0)))
            });
            let difference = sum / (n * n) as f32 - Vec3::from(means[cell]);
            assert!(difference.abs().max_element() < 1e-3, "{difference}");
        }
    }
}
