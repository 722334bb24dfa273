//! How far a compressed picture is from the truth: in all, block by block, and across the borders of blocks.

use clerestory_nystrom::rivals::DMatrix;
use clerestory_nystrom::{BlockLowRank, Partition};
use rayon::prelude::*;

use crate::errors::Sum;
use crate::methods::dense::{CHANNELS, Picture, TILE};

/// Errors, the peak of the truth being 1.
pub struct Judged {
    /// Mean square of each block.
    blocks: Vec<f64>,
    /// Mean square of the noise that is left in the mean of two truths, of each block; 0 beside one truth.
    noise: Vec<f64>,
    /// What each block says of itself.
    told: Vec<f64>,
    /// Root mean square of the step of the error from one pixel to the next: across borders of blocks over within. Not a number where
    /// noise of the truths is all that there is.
    pub seams: f64,
}

/// Decibels below the peak.
pub fn decibels(mean_square: f64) -> f64 {
    -10.0 * mean_square.log10()
}

impl Judged {
    /// Every entry is compared.
    pub fn new(truth: &Picture, found: &BlockLowRank) -> Judged {
        Judged::beside(truth, truth.unpacked(found), found)
    }

    /// The same of entries that another storage of the same factors has.
    pub fn beside(truth: &Picture, entries: Picture, found: &BlockLowRank) -> Judged {
        let mut errors = entries;
        errors.values.iter_mut().zip(&truth.values).for_each(|(error, x)| *error = x - *error);
        let told = found.blocks.iter().flatten().map(|block| block.error);
        let told = told.map(|error| f64::from(error.truncation + error.sampling)).collect();
        Judged::of_errors([&errors, &errors], &found.partition, told)
    }

    /// Of samples as they are, of which nobody tells an error.
    pub fn of_samples(truth: &Picture, mut entries: Picture) -> Judged {
        entries.values.iter_mut().zip(&truth.values).for_each(|(entry, x)| *entry = x - *entry);
        Judged::of_errors([&entries, &entries], &truth.partition(), Vec::new())
    }

    /// Of the differences to two truths whose noise is their own, which does not count, and what blocks tell of their errors; a truth
    /// without noise is given twice.
    pub fn of_errors([a, b]: [&Picture; 2], partition: &Partition, told: Vec<f64>) -> Judged {
        let of_block = |block_idx: usize| {
            let [a, b] = [a, b].map(|errors| errors.block_rows(partition, block_idx));
            let (mut product, mut noise) = (0.0, 0.0);
            for (a, b) in a.iter().zip(&b) {
                let (a, b) = (f64::from(*a), f64::from(*b));
                product += a * b;
                noise += 0.25 * (a - b).powi(2);
            }
            (product / a.len() as f64, noise / a.len() as f64)
        };
        let (blocks, noise) = (0..partition.n_blocks()).map(of_block).unzip();
        Judged { blocks, noise, told, seams: seams([a, b]) }
    }

    /// Mean square over all entries.
    pub fn mean_square(&self) -> f64 {
        self.blocks.iter().sum::<f64>() / self.blocks.len() as f64
    }

    /// Error of the worst block in dB.
    pub fn worst_db(&self) -> f64 {
        decibels(self.blocks.iter().copied().fold(0.0, f64::max))
    }

    /// Blocks that are farther from the truth than they are in another.
    pub fn n_farther(&self, than: &Judged) -> usize {
        self.blocks.iter().zip(&than.blocks).filter(|(own, other)| own > other).count()
    }

    /// Share of the blocks whose error is told to between 0.8 and 1.25 of it, of those of which it is known.
    pub fn told_well(&self) -> f64 {
        let [well, known, _] = self.n_told();
        well as f64 / known as f64
    }

    /// Blocks whose error is told to between 0.8 and 1.25 of it, those of which it is known, since it is no less than the noise of the
    /// truths, and all.
    pub fn n_told(&self) -> [usize; 3] {
        let all = self.told.iter().enumerate().filter(|(block_idx, _)| self.is_known(*block_idx));
        let known: Vec<f64> = all.map(|(block_idx, told)| (told.max(0.0) / self.blocks[block_idx]).sqrt()).collect();
        let well = known.iter().filter(|ratio| (0.8..=1.25).contains(*ratio));
        [well.count(), known.len(), self.blocks.len()]
    }

    /// How many of some blocks there are of which the error is known, as in [`Judged::n_told`], and the greatest mean square of these; 0 of
    /// none.
    pub fn worst_known(&self, blocks: &[usize]) -> (usize, f64) {
        let known = blocks.iter().filter(|block_idx| self.is_known(**block_idx));
        known.fold((0, 0.0), |(n, worst), &block_idx| (n + 1, f64::max(worst, self.blocks[block_idx])))
    }

    fn is_known(&self, block_idx: usize) -> bool {
        self.blocks[block_idx] >= self.noise[block_idx]
    }
}

/// Of the differences to two truths: steps of both are multiplied, so that the noise of neither counts.
fn seams([a, b]: [&Picture; 2]) -> f64 {
    let len = CHANNELS * a.n_cols;
    let product = |from: usize, to: usize| -> f64 {
        let steps = |errors| {
            let both = entries_of(errors, from).iter().zip(entries_of(errors, to));
            both.map(|(from, to)| f64::from(from - to))
        };
        steps(a).zip(steps(b)).map(|(a, b)| a * b).sum()
    };
    // Sum of squares and number of steps, within blocks and across borders.
    let mut steps = [[0.0f64; 2]; 2];
    for (y, x) in (0..a.height).flat_map(|y| (0..a.width).map(move |x| (y, x))) {
        for (to_x, to_y, place) in [(x + 1, y, x + 1), (x, y + 1, y + 1)] {
            if to_x < a.width && to_y < a.height {
                let step = &mut steps[usize::from(place % TILE == 0)];
                *step = [step[0] + product(y * a.width + x, to_y * a.width + to_x), step[1] + len as f64];
            }
        }
    }
    let [within, across] = steps.map(|[sum, count]| sum / count);
    // Of two that are both less than nothing the quotient would be a number all the same.
    if within < 0.0 || across < 0.0 { f64::NAN } else { (across / within).sqrt() }
}

/// Whether the mean of the products of the differences to two truths is less than its standard error over the pixels: entries of one are
/// not independent of each other.
pub fn is_noise([a, b]: [&Picture; 2]) -> bool {
    let (len, mut sum) = (CHANNELS * a.n_cols, Sum::default());
    for (a, b) in a.values.chunks_exact(len).zip(b.values.chunks_exact(len)) {
        sum.add(a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum());
    }
    sum.is_noise()
}

/// The rows of a pixel.
fn entries_of(errors: &Picture, pixel: usize) -> &[f32] {
    let len = CHANNELS * errors.n_cols;
    &errors.values[pixel * len..][..len]
}

/// Squared singular values of all blocks together, least first.
pub struct Spectrum {
    energies: Vec<f64>,
    n_blocks: usize,
    n_entries: f64,
}

impl Spectrum {
    /// Decomposes every block.
    pub fn new(truth: &Picture) -> Spectrum {
        let partition = truth.partition();
        let of_block = |block_idx: usize| {
            let rows: Vec<f64> = truth.block_rows(&partition, block_idx).into_iter().map(f64::from).collect();
            let rows = DMatrix::from_row_slice(rows.len() / truth.n_cols, truth.n_cols, &rows);
            let gram = if rows.nrows() < rows.ncols() { &rows * rows.transpose() } else { rows.tr_mul(&rows) };
            gram.symmetric_eigenvalues().iter().map(|energy| energy.max(0.0)).collect::<Vec<_>>()
        };
        let mut energies: Vec<f64> = (0..partition.n_blocks()).into_par_iter().flat_map_iter(of_block).collect();
        energies.sort_by(f64::total_cmp);
        Spectrum { energies, n_blocks: partition.n_blocks(), n_entries: truth.values.len() as f64 }
    }

    /// The least mean rank over the blocks that leaves no more than a mean square error \[Eckart1936\].
    pub fn least_mean_rank(&self, mean_square: f64) -> f64 {
        let mut left = mean_square * self.n_entries;
        let dropped = self.energies.iter().take_while(|energy| {
            left -= **energy;
            left >= 0.0
        });
        (self.energies.len() - dropped.count()) as f64 / self.n_blocks as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two blocks side by side, by the place across.
    fn picture(value: fn(usize) -> f32) -> Picture {
        let values = (0..32 * 16 * 3).map(|i| value(i / 3 % 32)).collect();
        Picture { width: 32, height: 16, n_cols: 1, values }
    }

    #[test]
    fn a_step_at_a_border_is_a_seam() {
        let seams_of = |errors: &Picture| seams([errors, errors]);
        assert!(seams_of(&picture(|x| (x / 16) as f32)) > 1e6);
        // One of 31 steps lies across, and all are alike; there are as many steps down, which are 0.
        let even = seams_of(&picture(|x| x as f32));
        let within = 16.0 * 30.0 / (16.0 * 30.0 + 15.0 * 32.0);
        assert!((even - f64::sqrt(1.0 / within)).abs() < 1e-6, "{even}");
    }

    /// Two blocks beside two truths that are off by a tenth either way, each in a pattern of its own.
    fn beside_two(error: fn(usize) -> f32) -> [Picture; 2] {
        let sign = |at: usize| if at.is_multiple_of(2) { 0.1f32 } else { -0.1 };
        let noises: [&dyn Fn(usize, usize) -> f32; 2] = [&|x, y| sign(x + y), &|_, y| sign(y)];
        noises.map(|noise| Picture {
            width: 32,
            height: 16,
            n_cols: 1,
            values: (0..32 * 16 * 3).map(|i| (i / 3 % 32, i / 96)).map(|(x, y)| error(x) - noise(x, y)).collect(),
        })
    }

    #[test]
    fn noise_of_two_truths_is_no_error_and_a_block_below_it_is_not_known() {
        // The first block is off by a fifth, the second by nothing.
        let [a, b] = beside_two(|x| if x < 16 { 0.2 } else { 0.0 });
        let judged = |told: f64| Judged::of_errors([&a, &b], &a.partition(), vec![told, 1.0]);
        assert!((judged(0.04).mean_square() - 0.02).abs() < 1e-6, "{}", judged(0.04).mean_square());
        assert!((judged(0.04).worst_db() - decibels(0.04)).abs() < 1e-3);
        let told = [0.04 * 0.7 * 0.7, 0.04 * 0.9 * 0.9, 0.04 * 1.2 * 1.2, 0.04 * 1.3 * 1.3, -1.0];
        let n_well = told.map(|told| judged(told).n_told());
        assert_eq!(n_well, [[0, 1, 2], [1, 1, 2], [1, 1, 2], [0, 1, 2], [0, 1, 2]]);
        assert_eq!(judged(0.04).told_well(), 1.0);
    }

    #[test]
    fn the_worst_block_is_one_of_those_that_are_asked_for_and_known() {
        let (blocks, noise) = (vec![0.03, 0.01, 0.02, 0.01], vec![0.01, 0.0, 0.04, 0.01]);
        let judged = Judged { blocks, noise, told: Vec::new(), seams: 1.0 };
        assert_eq!(judged.worst_known(&[0, 1, 2, 3]), (3, 0.03));
        assert_eq!(judged.worst_known(&[1, 2, 3]), (2, 0.01), "the third is less than its noise");
        assert_eq!([&[2][..], &[]].map(|blocks| judged.worst_known(blocks)), [(0, 0.0); 2]);
    }

    #[test]
    fn noise_of_two_truths_is_no_seam() {
        let [a, b] = beside_two(|x| 0.01 * x as f32);
        let even = seams([&a, &b]);
        let within = 16.0 * 30.0 / (16.0 * 30.0 + 15.0 * 32.0);
        assert!((even - f64::sqrt(1.0 / within)).abs() < 1e-3, "{even}");
        assert!((seams([&a, &a]) - even).abs() > 0.1, "beside one of them it counts: {}", seams([&a, &a]));
    }

    #[test]
    fn where_noise_is_all_that_there_is_no_seam_is_known() {
        let [a, b] = [1.0f32, -1.0].map(|sign| Picture {
            width: 32,
            height: 16,
            n_cols: 1,
            values: (0..32 * 16 * 3).map(|i| sign * (i / 3 % 32) as f32).collect(),
        });
        assert!(seams([&a, &b]).is_nan(), "all steps are less than nothing: {}", seams([&a, &b]));
    }

    #[test]
    fn an_error_below_its_standard_error_over_the_pixels_is_noise() {
        // Of every two pixels the products are 4 and −3: 0.5 in the mean, known to 3.5 over the root of 512.
        let b = picture(|x| if x % 2 == 0 { 1.0 } else { -1.0 });
        let is_noise = |a: fn(usize) -> f32| is_noise([&picture(a), &b]);
        assert!(!is_noise(|x| if x % 2 == 0 { 4.0 } else { 3.0 }), "0.5 is more than 0.15");
        assert!(is_noise(|x| if x % 2 == 0 { 4.0 } else { 3.75 }), "0.125 is less than 0.17");
        assert!(is_noise(|x| if x % 2 == 0 { 1.0 } else { 2.0 }), "less than nothing");
    }

    #[test]
    fn a_block_that_is_farther_from_the_truth_than_its_samples_is_counted() {
        let truth = picture(|_| 1.0);
        let judged = |value: fn(usize) -> f32| Judged::of_samples(&truth, picture(value));
        let (even, left) = (judged(|_| 1.5), judged(|x| if x < 16 { 1.75 } else { 1.25 }));
        assert_eq!((even.mean_square(), left.mean_square()), (0.25, 0.3125));
        assert_eq!((left.n_farther(&even), even.n_farther(&left), even.n_farther(&even)), (1, 1, 0));
    }

    #[test]
    fn the_least_rank_drops_what_is_weakest_anywhere() {
        let spectrum = Spectrum { energies: vec![1.0, 2.0, 3.0, 10.0, 20.0, 30.0], n_blocks: 2, n_entries: 10.0 };
        assert_eq!([0.0, 0.3, 0.59, 0.6].map(|error| spectrum.least_mean_rank(error)), [3.0, 2.0, 2.0, 1.5]);
    }
}
