//! Errors in decibels: of values below a peak, and of the columns of a matrix.

use clerestory::compare::white_level;
use clerestory_relight::Radiance;
use serde::{Deserialize, Serialize};

use super::fit::{median, tenths};

/// Part of a column's entries that may be brighter than its peak.
const PEAK_QUANTILE: f64 = 0.995;
/// Best error that is told.
pub const BEST_DB: f64 = 120.0;

/// The 99.5 percentile; 0 of nothing.
pub fn quantile(mut values: Vec<f64>) -> f64 {
    let Some(last) = values.len().checked_sub(1) else { return 0.0 };
    *values.select_nth_unstable_by((last as f64 * PEAK_QUANTILE) as usize, f64::total_cmp).1
}

/// A mean square in dB below a peak; minus infinity where one of both is no number.
pub fn decibels(peak: f64, mean_square: f64) -> f64 {
    let db = 10.0 * (peak * peak / mean_square.max(f64::MIN_POSITIVE)).log10();
    // Of a number and what is none `min` and `max` take the number: it would pass for no error at all.
    if db.is_nan() || mean_square.is_nan() { f64::NEG_INFINITY } else { db.min(BEST_DB) }
}

/// A sum, that of the squares, and how many went into it.
#[derive(Clone, Copy, Default)]
pub struct Sum {
    sum: f64,
    squares: f64,
    n: f64,
}

impl Sum {
    /// One more.
    pub fn add(&mut self, value: f64) {
        self.sum += value;
        self.squares += value * value;
        self.n += 1.0;
    }

    /// One more for a pixel, the mean of what its three channels have: these are not independent of each other, pixels are.
    pub fn add_pixel(&mut self, channels: [f64; 3]) {
        self.add(channels.iter().sum::<f64>() / 3.0);
    }

    /// That of pixels, given the value of each entry, three channels a pixel.
    pub fn of_pixels(n_entries: usize, value: impl Fn(usize) -> f64) -> Sum {
        let mut sum = Sum::default();
        (0..n_entries / 3).for_each(|pixel| sum.add_pixel([0, 1, 2].map(|channel| value(3 * pixel + channel))));
        sum
    }

    /// The mean, or its standard error where that is greater: what is known of something that is not negative, but that its estimates
    /// scatter around. Infinity where one of them is no number.
    pub fn mean_at_least_known(&self) -> f64 {
        let mean = self.mean();
        if mean.is_nan() { f64::INFINITY } else { mean.max(self.standard_error()) }
    }

    /// Whether the standard error is the greater of both.
    pub fn is_noise(&self) -> bool {
        self.mean() < self.standard_error()
    }

    fn standard_error(&self) -> f64 {
        let n = self.n.max(1.0);
        (self.squares / n - self.mean().powi(2)).max(0.0).sqrt() / n.sqrt()
    }

    /// 0 of nothing.
    pub fn mean(&self) -> f64 {
        self.sum / self.n.max(1.0)
    }
}

/// An error in dB as it is told.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Told {
    /// Below the peak.
    pub db: f64,
    /// Whether it is its standard error: then the truth is no worse than that, and nobody knows by how much it is better.
    pub is_bound: bool,
}

/// Errors of repeats, median (least…greatest), a bound where one of them is one; “—” of none.
pub fn told_words(repeats: &[Told]) -> String {
    if repeats.is_empty() {
        return "—".into();
    }
    let words = tenths(repeats.iter().map(|told| told.db).collect());
    if repeats.iter().any(|told| told.is_bound) { format!("≥ {words}") } else { words }
}

/// The error of a picture beside two whose noise is their own, given x, a and b of each channel of its pixels: the mean of
/// (x − a)(x − b) below the square of the 99.5 percentile of a and b, told as no less than its standard error over the pixels.
/// `None` of no pixels.
pub fn told_beside_two(pixels: impl Iterator<Item = [[f64; 3]; 3]>) -> Option<Told> {
    let (mut both, mut sum) = (Vec::new(), Sum::default());
    for channels in pixels {
        both.extend(channels.map(|[_, a, b]| 0.5 * (a + b)));
        sum.add_pixel(channels.map(|[x, a, b]| (x - a) * (x - b)));
    }
    let told = || Told { db: decibels(quantile(both), sum.mean_at_least_known()), is_bound: sum.is_noise() };
    (sum.n > 0.0).then(told)
}

/// [`told_beside_two`] of the pixels of pictures that are not left out.
pub fn pixels_beside_two(x: &Radiance, [a, b]: [&Radiance; 2], is_left_out: &[bool]) -> Option<Told> {
    let pixels = (0..x.pixels.len()).filter(|&nth| !is_left_out[nth]);
    let entry = |nth: usize, channel: usize| [x, a, b].map(|picture| f64::from(picture.pixels[nth][channel]));
    told_beside_two(pixels.map(|nth| [0, 1, 2].map(|channel| entry(nth, channel))))
}

/// The dB of [`pixels_beside_two`] where none is left out.
pub fn pictures_beside_two(x: &Radiance, traced: [&Radiance; 2]) -> Option<f64> {
    pixels_beside_two(x, traced, &vec![false; x.pixels.len()]).map(|told| told.db)
}

/// PSNR in dB of a picture x beside two pictures a and b whose noise is their own: all exposed to four times the median luminance of the
/// mean of a and b and clipped at white, the mean of (x − a)(x − b), told as no less than its standard error over the pixels; 0, the
/// worst, of one with values that are no numbers.
pub fn psnr_db(x: &Radiance, [a, b]: [&Radiance; 2]) -> f64 {
    let pair = |(a, b): (&[f32; 3], &[f32; 3])| std::array::from_fn(|c| 0.5 * (a[c] + b[c]));
    let both = Radiance { pixels: a.pixels.iter().zip(&b.pixels).map(pair).collect(), ..*a };
    let white = white_level(&both);
    let shown = |value: f32| (f64::from(value) / white).clamp(0.0, 1.0);
    let mut sum = Sum::default();
    for ((x, a), b) in x.pixels.iter().zip(&a.pixels).zip(&b.pixels) {
        sum.add_pixel([0, 1, 2].map(|channel| {
            let [x, a, b] = [x, a, b].map(|pixel| shown(pixel[channel]));
            (x - a) * (x - b)
        }));
    }
    if has_nan(x) { 0.0 } else { decibels(1.0, sum.mean_at_least_known()) }
}

/// Whether values of a picture are no numbers. Sums of them would pass for no error at all.
pub fn has_nan(picture: &Radiance) -> bool {
    picture.pixels.iter().flatten().any(|value| value.is_nan())
}

/// Errors of the columns that light anything, as mean squares over the squares of their peaks; none less than its standard error.
#[derive(Default)]
pub struct ColumnErrors {
    /// Without and with the entries where the light itself is seen.
    pub squares: Vec<[f64; 2]>,
    /// Of each, whether the first is its standard error.
    pub are_bounds: Vec<bool>,
}

impl ColumnErrors {
    fn db(&self, which: usize) -> impl Iterator<Item = f64> {
        self.squares.iter().map(move |squares| decibels(1.0, squares[which]))
    }

    /// Median over columns; `None` of none.
    pub fn median_db(&self) -> Option<f64> {
        median(&self.squares.iter().map(|squares| squares[0]).collect::<Vec<_>>()).map(|square| decibels(1.0, square))
    }

    /// Mean over columns.
    pub fn mean_db(&self) -> f64 {
        self.db(0).sum::<f64>() / self.squares.len().max(1) as f64
    }

    /// Of the worst column.
    pub fn worst_db(&self) -> f64 {
        self.db(0).fold(f64::INFINITY, f64::min)
    }

    /// Whether those of more than half of the columns are their standard errors.
    pub fn is_mostly_bound(&self) -> bool {
        2 * self.are_bounds.iter().filter(|is_bound| **is_bound).count() > self.are_bounds.len()
    }

    /// Whether that of the worst column is its standard error.
    pub fn is_worst_bound(&self) -> bool {
        self.worst().is_some_and(|worst| self.are_bounds[worst])
    }

    /// Which of the columns is the worst; `None` of none.
    pub fn worst(&self) -> Option<usize> {
        (0..self.squares.len()).max_by(|&i, &j| self.squares[i][0].total_cmp(&self.squares[j][0]))
    }

    /// Mean over columns, lights that are seen included.
    pub fn mean_db_with_seen(&self) -> f64 {
        self.db(1).sum::<f64>() / self.squares.len().max(1) as f64
    }

    /// Median over columns and the worst of them, each a bound where it is that of a column that is one; `None` of none.
    pub fn median_and_worst(&self) -> Option<[Told; 2]> {
        let mut order: Vec<usize> = (0..self.squares.len()).collect();
        order.sort_by(|&i, &j| self.squares[i][0].total_cmp(&self.squares[j][0]));
        let (worst, n) = (*order.last()?, order.len());
        let is_bound = [order[(n - 1) / 2], order[n / 2]].iter().any(|&column| self.are_bounds[column]);
        let median = Told { db: self.median_db()?, is_bound };
        Some([median, Told { db: self.worst_db(), is_bound: self.are_bounds[worst] }])
    }

    /// Of the worst column, lights that are seen included.
    pub fn worst_db_with_seen(&self) -> f64 {
        self.db(1).fold(f64::INFINITY, f64::min)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_is_told_as_no_less_than_its_standard_error() {
        let mean = |values: &[f64]| {
            let mut sum = Sum::default();
            values.iter().for_each(|&value| sum.add(value));
            (sum.mean(), sum.mean_at_least_known())
        };
        assert_eq!(mean(&[0.25; 16]), (0.25, 0.25));
        // Scattered around less than nothing: 2 over the root of 16.
        let scattered: Vec<f64> = (0..16).map(|i| if i % 2 == 0 { 1.0 } else { -3.0 }).collect();
        assert_eq!(mean(&scattered), (-1.0, 0.5));
    }

    #[test]
    fn what_is_no_number_is_no_small_error() {
        let mut sum = Sum::default();
        [0.1, f64::NAN].into_iter().for_each(|value| sum.add(value));
        assert_eq!((sum.mean_at_least_known(), sum.is_noise()), (f64::INFINITY, false));
        let dbs =
            [[1.0, f64::NAN], [1.0, f64::INFINITY], [f64::NAN, 1e-3]].map(|[peak, square]| decibels(peak, square));
        assert_eq!(dbs, [f64::NEG_INFINITY; 3]);
        assert_eq!(decibels(1.0, 0.0), BEST_DB);
        let squares = [1e-3, f64::NAN, 1e-2].map(|square| [square; 2]).to_vec();
        let errors = ColumnErrors { squares, are_bounds: vec![false; 3] };
        assert_eq!((errors.worst(), errors.worst_db()), (Some(1), f64::NEG_INFINITY));
    }

    #[test]
    fn channels_of_a_pixel_are_no_samples_of_their_own() {
        // Gray, the truth 1, both references off by a tenth in patterns of their own: 0.01 over the root of 16 pixels.
        let value = |pixel: usize, bit: usize| if pixel >> bit & 1 == 0 { 1.1 } else { 0.9 };
        let told = told_beside_two((0..16).map(|pixel| [[1.0, value(pixel, 0), value(pixel, 1)]; 3])).expect("pixels");
        assert!(told.is_bound && (told.db - decibels(1.1, 0.01 / 4.0)).abs() < 1e-6, "{told:?}");
    }

    #[test]
    fn repeats_of_which_one_is_a_bound_are_told_as_one() {
        let told = |db: f64, is_bound: bool| Told { db, is_bound };
        assert_eq!(told_words(&[told(30.0, false), told(31.5, false), told(29.0, false)]), "30.0 (29.0…31.5)");
        assert_eq!(told_words(&[told(30.0, false), told(31.0, true)]), "≥ 30.5 (30.0…31.0)");
        assert_eq!([vec![told(30.0, true)], Vec::new()].map(|repeats| told_words(&repeats)), ["≥ 30.0", "—"]);
    }

    #[test]
    fn pixels_left_out_do_not_count_and_a_standard_error_is_marked() {
        // Each tenth pixel shows a lamp.
        let is_lamp: Vec<bool> = (0..100).map(|nth| nth % 10 == 0).collect();
        let picture = |of: fn(usize) -> f32| Radiance {
            width: 100,
            height: 1,
            pixels: (0..100).map(|nth| [if nth % 10 == 0 { 1000.0 } else { of(nth) }; 3]).collect(),
        };
        let (truth, off) = (picture(|_| 1.0), picture(|_| 1.1));
        let told = pixels_beside_two(&off, [&truth, &truth], &is_lamp).expect("pixels");
        assert_eq!(told_words(&[told]), "20.0");
        let a = picture(|nth| if nth % 2 == 0 { 1.1 } else { 0.9 });
        let b = picture(|nth| if nth % 4 < 2 { 1.1 } else { 0.9 });
        let told = pixels_beside_two(&truth, [&a, &b], &is_lamp).expect("pixels");
        assert!(told.is_bound && told_words(&[told]).starts_with("≥ "), "{told:?}");
        assert_eq!(pixels_beside_two(&truth, [&a, &b], &[true; 100]), None);
    }

    #[test]
    fn the_median_and_the_worst_column_are_bounds_where_theirs_are() {
        let squares = [1e-4, 1e-2, 1e-3].map(|square| [square; 2]).to_vec();
        let of = |are_bounds: [bool; 3]| {
            let errors = ColumnErrors { squares: squares.clone(), are_bounds: are_bounds.to_vec() };
            assert_eq!(errors.worst(), Some(1));
            assert_eq!((errors.is_mostly_bound(), errors.is_worst_bound()), (false, are_bounds[1]));
            let all = ColumnErrors { squares: squares.clone(), are_bounds: vec![true, are_bounds[1], true] };
            assert!(all.is_mostly_bound());
            errors.median_and_worst().expect("columns").map(|told| told_words(&[told]))
        };
        assert_eq!(of([true, false, false]), ["30.0", "20.0"]);
        assert_eq!(of([false, true, false]), ["30.0", "≥ 20.0"]);
        assert_eq!(of([false, false, true]), ["≥ 30.0", "20.0"]);
        assert!(ColumnErrors::default().median_and_worst().is_none());
    }

    #[test]
    fn noise_of_the_references_drops_out_and_white_is_clipped() {
        // The truth is 1 everywhere, so white is 4; both references are off by ±0.5 in patterns of their own.
        let picture = |value: &dyn Fn(usize) -> f32| Radiance {
            width: 4096,
            height: 1,
            pixels: (0..4096).map(|i| [value(i); 3]).collect(),
        };
        let noisy = |bit: usize| picture(&|i: usize| if i >> bit & 1 == 0 { 0.5 } else { 1.5 });
        let (a, b) = (noisy(0), noisy(1));
        let off = psnr_db(&picture(&|_| 1.4), [&a, &b]);
        assert!((off - 20.0).abs() < 1e-3, "a tenth of white: {off}");
        let exact = psnr_db(&picture(&|_| 1.0), [&a, &b]);
        // What is left is how well it is known: (1/8)² over the root of all pixels.
        assert!((exact - 10.0 * (64.0 * f64::sqrt(4096.0)).log10()).abs() < 1e-3, "{exact}");
        let ends = [4.0, 40.0].map(|value| psnr_db(&picture(&|_| value), [&a, &b]));
        assert_eq!(ends[0], ends[1], "white is white");
        let with_nan = picture(&|i: usize| if i == 7 { f32::NAN } else { 1.0 });
        assert_eq!(psnr_db(&with_nan, [&a, &b]), 0.0, "no number is as bad as can be");
    }

    #[test]
    fn noise_of_two_references_does_not_count() {
        let picture = |of: fn(usize) -> f32| Radiance {
            width: 100,
            height: 1,
            pixels: (0..100).map(|nth| [of(nth); 3]).collect(),
        };
        let truth = picture(|_| 1.0);
        // Both are off by a tenth, each in half of its pixels either way, and independently.
        let a = picture(|nth| if nth % 2 == 0 { 1.1 } else { 0.9 });
        let b = picture(|nth| if nth % 4 < 2 { 1.1 } else { 0.9 });
        let off = picture(|_| 1.2);
        let reference = [a, b];
        // White is 4: 0.05 off is 26 dB.
        assert!(
            (psnr_db(&off, [&reference[0], &reference[1]]) - 26.0).abs() < 0.3,
            "{}",
            psnr_db(&off, [&reference[0], &reference[1]])
        );
        assert!(
            psnr_db(&truth, [&reference[0], &reference[1]]) > 40.0,
            "{}",
            psnr_db(&truth, [&reference[0], &reference[1]])
        );
    }
}
