//! How far a compressed picture is from the truth: in all, block by block, and across the borders of blocks.

use clerestory_nystrom::BlockLowRank;
use clerestory_nystrom::rivals::DMatrix;
use rayon::prelude::*;

use crate::methods::dense::{CHANNELS, Picture, TILE};

/// Errors, the peak of the truth being 1.
pub struct Judged {
    /// Mean square of each block.
    blocks: Vec<f64>,
    /// What each block says of itself.
    told: Vec<f64>,
    /// Root mean square of the step of the error from one pixel to the next: across borders of blocks over within.
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
        let mean_square = |block_idx: usize| {
            let rows = errors.block_rows(&found.partition, block_idx);
            rows.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>() / rows.len() as f64
        };
        let told = found.blocks.iter().flatten().map(|block| block.error);
        Judged {
            blocks: (0..found.blocks.len()).map(mean_square).collect(),
            told: told.map(|error| f64::from(error.truncation + error.sampling)).collect(),
            seams: seams(&errors),
        }
    }

    /// Mean square over all entries.
    pub fn mean_square(&self) -> f64 {
        self.blocks.iter().sum::<f64>() / self.blocks.len() as f64
    }

    /// Error of the worst block in dB.
    pub fn worst_db(&self) -> f64 {
        decibels(self.blocks.iter().copied().fold(0.0, f64::max))
    }

    /// Share of the blocks whose error is told to between 0.8 and 1.25 of it.
    pub fn told_well(&self) -> f64 {
        let both = self.told.iter().zip(&self.blocks);
        let well = both.filter(|(told, error)| (0.8..=1.25).contains(&(told.max(0.0) / *error).sqrt()));
        well.count() as f64 / self.blocks.len() as f64
    }
}

fn seams(errors: &Picture) -> f64 {
    let len = CHANNELS * errors.n_cols;
    let at = |x: usize, y: usize| &errors.values[(y * errors.width + x) * len..][..len];
    // Sum of squares and number of steps, within blocks and across borders.
    let mut steps = [[0.0f64; 2]; 2];
    for (y, x) in (0..errors.height).flat_map(|y| (0..errors.width).map(move |x| (y, x))) {
        for (to_x, to_y, place) in [(x + 1, y, x + 1), (x, y + 1, y + 1)] {
            if to_x < errors.width && to_y < errors.height {
                let squares = at(x, y).iter().zip(at(to_x, to_y)).map(|(a, b)| f64::from(a - b).powi(2));
                let step = &mut steps[usize::from(place % TILE == 0)];
                *step = [step[0] + squares.sum::<f64>(), step[1] + len as f64];
            }
        }
    }
    let [within, across] = steps.map(|[sum, count]| sum / count);
    (across / within).sqrt()
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

    #[test]
    fn a_step_at_a_border_is_a_seam() {
        let picture = |value: fn(usize) -> f32| Picture {
            width: 32,
            height: 16,
            n_cols: 1,
            values: (0..32 * 16 * 3).map(|i| value(i / 3 % 32)).collect(),
        };
        assert!(seams(&picture(|x| (x / 16) as f32)) > 1e6);
        // One of 31 steps lies across, and all are alike; there are as many steps down, which are 0.
        let even = seams(&picture(|x| x as f32));
        let within = 16.0 * 30.0 / (16.0 * 30.0 + 15.0 * 32.0);
        assert!((even - f64::sqrt(1.0 / within)).abs() < 1e-6, "{even}");
    }

    #[test]
    fn the_least_rank_drops_what_is_weakest_anywhere() {
        let spectrum = Spectrum { energies: vec![1.0, 2.0, 3.0, 10.0, 20.0, 30.0], n_blocks: 2, n_entries: 10.0 };
        assert_eq!([0.0, 0.3, 0.59, 0.6].map(|error| spectrum.least_mean_rank(error)), [3.0, 2.0, 2.0, 1.5]);
    }
}
