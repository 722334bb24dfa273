//! Which bundles may teach, and which only examine.

use crate::random::Random;

/// Bundles and rows of a block: held out for the examination, or for training.
pub(crate) struct Split {
    /// Bundles that may become landmarks, in ascending order.
    pub(crate) training: Vec<usize>,
    /// Rows of the held-out bundles, in ascending order.
    pub(crate) held_out_rows: Vec<usize>,
    /// One per row: may it teach?
    pub(crate) is_training: Vec<bool>,
}

/// Blocks of fewer bundles hold none out.
const LEAST_BUNDLES: usize = 16;

impl Split {
    /// Holds out a random share of the bundles, at least two where there are enough.
    pub(crate) fn new(n_bundles: usize, bundle_len: usize, share: f32, rng: &mut Random) -> Self {
        let count = ((share * n_bundles as f32).round() as usize).max(2).min(n_bundles / 4);
        let count = if n_bundles < LEAST_BUNDLES || share <= 0.0 { 0 } else { count };
        let all: Vec<usize> = (0..n_bundles).collect();
        let mut held_out = rng.choose(&all, count);
        held_out.sort_unstable();
        let training: Vec<usize> = all.into_iter().filter(|bundle| held_out.binary_search(bundle).is_err()).collect();
        let rows = |bundle: usize| bundle * bundle_len..(bundle + 1) * bundle_len;
        let mut is_training = vec![false; n_bundles * bundle_len];
        training.iter().flat_map(|&bundle| rows(bundle)).for_each(|row| is_training[row] = true);
        Self { training, held_out_rows: held_out.into_iter().flat_map(rows).collect(), is_training }
    }

    /// Rows that may teach.
    pub(crate) fn training_rows(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.is_training.len()).filter(|&row| self.is_training[row])
    }

    /// Sum over the rows that may teach.
    pub(crate) fn training_sum(&self, per_row: &[f64]) -> f64 {
        self.training_rows().map(|row| per_row[row]).sum()
    }
}
