//! A map whose pixels are averaged down as they come, so that only the smaller one is ever held.
//!
//! A pixel of the smaller map is the mean of the larger one over the solid angle that it stands for: the light of the whole
//! sphere stays what it was, and so do the directions that it comes from.

// What is read here was written by strangers, so no integer may wrap in silence.
#![cfg_attr(not(test), deny(clippy::arithmetic_side_effects))]
#![cfg_attr(not(test), deny(clippy::cast_possible_truncation, clippy::cast_sign_loss))]

use half::f16;

use super::environment::{Cleaned, Environment, believed, row_sines};

/// The largest width and height of the same shape with so many pixels at most; those that fit stay.
#[expect(
    clippy::arithmetic_side_effects,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "sides that shrink, and no fewer rows than one"
)]
pub(crate) fn size_within([width, height]: [usize; 2], max_pixels: usize) -> [usize; 2] {
    let ratio = (width as f64 * height as f64 / max_pixels as f64).sqrt();
    if ratio <= 1.0 {
        return [width, height];
    }
    let rows = ((height as f64 / ratio) as usize).clamp(1, max_pixels);
    let columns = ((width as f64 / ratio) as usize).clamp(1, max_pixels / rows);
    [columns, rows]
}

/// Where a row or a column of the larger map lies in the smaller one.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Reach {
    /// The first row or column of the smaller one that it has a part in.
    first: usize,
    /// Which part of that it fills, and of the next.
    parts: [f32; 2],
}

/// A map that comes pixel by pixel.
#[derive(Debug)]
pub(crate) struct Averaged {
    width: usize,
    height: usize,
    columns: Vec<Reach>,
    rows: Vec<Reach>,
    /// Row-major, as far as they have come.
    means: Vec<[f32; 3]>,
    /// Which part of each mean is infinite; empty as long as nothing is.
    infinite: Vec<[f32; 3]>,
    /// Brightest finite channel, no darker than the largest number of half precision.
    brightest: f32,
    cleaned: Cleaned,
}

impl Averaged {
    /// From one width and height to another, neither of which is larger. Pixels that never come are black.
    #[expect(clippy::arithmetic_side_effects, reason = "pixels of a map that is held in memory")]
    pub(crate) fn new(from: [usize; 2], to: [usize; 2]) -> Averaged {
        let [width, height] = to;
        Averaged {
            width,
            height,
            columns: columns(from[0], width),
            rows: rows(from[1], height),
            means: vec![[0.0; 3]; width * height],
            infinite: Vec::new(),
            brightest: f16::MAX.to_f32(),
            cleaned: Cleaned::default(),
        }
    }

    /// Takes the pixel of a column and a row of the larger map, once.
    pub(crate) fn put(&mut self, x: usize, y: usize, rgb: [f32; 3]) {
        self.cleaned.count(rgb);
        self.brightest = rgb.into_iter().filter(|v| v.is_finite()).fold(self.brightest, f32::max);
        let (column, row) = (self.columns[x], self.rows[y]);
        if rgb.contains(&f32::INFINITY) {
            self.infinite.resize(self.means.len(), [0.0; 3]);
            let is_infinite = rgb.map(|v| if v == f32::INFINITY { 1.0 } else { 0.0 });
            spread(&mut self.infinite, self.width, (column, row), is_infinite);
        }
        let finite = rgb.map(|v| if v.is_finite() { believed(v) } else { 0.0 });
        spread(&mut self.means, self.width, (column, row), finite);
    }

    /// The smaller map, and how many pixels of the larger one were not as they can be: as in [`Environment::new`].
    pub(crate) fn finish(self) -> (Environment, Cleaned) {
        let Averaged { width, height, mut means, infinite, brightest, cleaned, .. } = self;
        let brightest = believed(brightest);
        for (mean, part) in means.as_flattened_mut().iter_mut().zip(infinite.as_flattened()) {
            *mean += part * brightest;
        }
        (Environment::of_clean(width, height, means), cleaned)
    }
}

/// Adds a pixel to those of the smaller map that it has a part in, at most two by two.
#[expect(clippy::arithmetic_side_effects, reason = "places in a map in memory")]
fn spread(map: &mut [[f32; 3]], width: usize, (column, row): (Reach, Reach), rgb: [f32; 3]) {
    for (dy, down) in row.parts.into_iter().enumerate() {
        for (dx, across) in column.parts.into_iter().enumerate() {
            let part = down * across;
            if part > 0.0 {
                let mean = &mut map[(row.first + dy) * width + column.first + dx];
                (0..3).for_each(|c| mean[c] += part * rgb[c]);
            }
        }
    }
}

/// Columns are equally wide: their edges are counted in parts of a column, a whole number of them each.
#[expect(
    clippy::arithmetic_side_effects,
    clippy::cast_possible_truncation,
    reason = "products of two sides of maps, whose pixels fit in memory; parts in single precision"
)]
fn columns(from: usize, to: usize) -> Vec<Reach> {
    let of = |x: usize| {
        let (start, end) = (x * to, (x + 1) * to);
        let first = start / from;
        let edge = (first + 1) * from;
        let part = |n: usize| (n as f64 / from as f64) as f32;
        Reach { first, parts: [part(end.min(edge) - start), part(end.saturating_sub(edge))] }
    };
    (0..from).map(of).collect()
}

/// Rows are as high as the sines of the elevations between which they lie.
#[expect(
    clippy::arithmetic_side_effects,
    clippy::cast_possible_truncation,
    reason = "rows of maps in memory; parts in single precision"
)]
fn rows(from: usize, to: usize) -> Vec<Reach> {
    let mut first = 0;
    let of = |y: usize| {
        let [low, high] = row_sines(from, y);
        // Rows come from the zenith down.
        while first + 1 < to && row_sines(to, first)[0] >= high {
            first += 1;
        }
        let part = |row: usize| {
            let [bottom, top] = row_sines(to, row);
            let shared = high.min(top) - low.max(bottom);
            if row < to { (shared / (top - bottom)).clamp(0.0, 1.0) as f32 } else { 0.0 }
        };
        Reach { first, parts: [part(first), part(first + 1)] }
    };
    (0..from).map(of).collect()
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    fn averaged(from: [usize; 2], to: [usize; 2], pixels: &[[f32; 3]]) -> (Environment, Cleaned) {
        let mut averaged = Averaged::new(from, to);
        for (idx, pixel) in pixels.iter().enumerate() {
            averaged.put(idx % from[0], idx / from[0], *pixel);
        }
        averaged.finish()
    }

    /// Pixels that differ by much from each other.
    fn uneven([width, height]: [usize; 2]) -> Vec<[f32; 3]> {
        (0..width * height).map(|idx| [(idx * 37 % 101) as f32, (idx * 53 % 89) as f32, 1.0]).collect()
    }

    #[test]
    fn a_map_that_is_averaged_sends_as_much_light() {
        for (from, to) in [
            ([16, 8], [8, 4]),
            ([64, 32], [32, 16]),
            ([15, 9], [8, 4]),
            ([12, 6], [8, 4]),
            ([7, 2], [3, 1]),
            ([5, 1], [5, 1]),
            ([1, 9], [1, 8]),
        ] {
            let pixels = uneven(from);
            let (small, cleaned) = averaged(from, to, &pixels);
            assert_eq!(([small.width(), small.height()], cleaned), (to, Cleaned::default()));
            let large = Environment::new(from[0], from[1], pixels).unwrap().0;
            for (small, large) in small.light().into_iter().zip(large.light()) {
                assert!((small / large - 1.0).abs() < 1e-5, "{from:?} to {to:?}: {small} of {large}");
            }
        }
    }

    #[test]
    fn a_map_that_is_not_made_smaller_stays_as_it_is() {
        for size in [[8, 4], [7, 5], [3, 1], [1, 6], [1, 1]] {
            let (map, _) = averaged(size, size, &uneven(size));
            assert_eq!(map.pixels(), uneven(size), "{size:?}");
        }
    }

    #[test]
    fn light_stays_where_it_came_from() {
        let large = Environment::from_fn(256, 128, |d| d + 1.0);
        for to in [[128, 64], [100, 50]] {
            let (small, _) = averaged([256, 128], to, large.pixels());
            for d in [Vec3::X, Vec3::NEG_X, Vec3::new(0.3, 0.9, -0.2), Vec3::new(0.2, -0.7, 0.5)] {
                let d = d.normalize();
                let difference = small.radiance(d) - large.radiance(d);
                assert!(difference.abs().max_element() < 0.005, "{to:?} {d}: {difference}");
            }
        }
    }

    #[test]
    fn what_is_odd_is_taken_as_without_an_average_and_counted() {
        let (from, to) = ([8, 4], [4, 2]);
        let mut pixels = uneven(from);
        pixels[3] = [f32::INFINITY, 1.0, f32::NAN];
        pixels[12] = [-5.0, 2.0, f32::NEG_INFINITY];
        pixels[13] = [1e20, f32::INFINITY, 0.0];
        let (small, cleaned) = averaged(from, to, &pixels);
        let (clean, of_large) = Environment::new(from[0], from[1], pixels).unwrap();
        assert_eq!(cleaned, of_large);
        assert_eq!(cleaned, Cleaned { n_black: 2, n_capped: 2 });
        let (expected, _) = averaged(from, to, clean.pixels());
        for (value, expected) in small.pixels().as_flattened().iter().zip(expected.pixels().as_flattened()) {
            assert!((value - expected).abs() <= 1e-5 * expected, "{value} {expected}");
        }
    }

    #[test]
    fn sizes_keep_their_shape_within_the_most_pixels() {
        let most = Environment::MAX_PIXELS;
        for (size, expected) in [
            ([8192, 4096], [8192, 4096]),
            ([16384, 8192], [8192, 4096]),
            ([12288, 6144], [8192, 4096]),
            ([32768, 16384], [8192, 4096]),
            ([1 << 27, 1], [1 << 25, 1]),
            ([1, 1 << 27], [1, 1 << 25]),
        ] {
            assert_eq!(size_within(size, most), expected, "{size:?}");
        }
        for size in [[9000, 4500], [12345, 6789], [20_000, 3000]] {
            let [width, height] = size_within(size, most);
            assert!(width * height <= most && width * height > most / 100 * 99, "{width} {height}");
        }
        assert_eq!(size_within([5, 9], 1), [1, 1]);
    }
}
