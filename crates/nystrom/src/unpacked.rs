//! Factors as they were computed, and how they are packed.

use crate::{
    dense::Dense,
    factors::{BlockError, BlockFactors},
    means::Means,
};

/// The factors of one group of columns of a block before they are packed, and mean squares per entry of their errors. Each value
/// of `left` is to be multiplied by `unit`, each error by its square: so no scale of the matrix is out of range.
pub(crate) struct Unpacked {
    /// Rows × rank.
    pub(crate) left: Dense<f32>,
    /// Rows × rank: half of what the two halves differ by in the left factor, noise like that of `left`.
    pub(crate) doubt: Dense<f32>,
    /// Rank × columns, orthonormal rows.
    pub(crate) right: Dense<f32>,
    /// A power of two.
    pub(crate) unit: f64,
    /// What the rank leaves out.
    pub(crate) truncation: f64,
    /// Noise that stays.
    pub(crate) sampling: f64,
    /// Noise that was there.
    pub(crate) noise: f64,
    /// What packing will add.
    pub(crate) packing: f64,
}

impl Unpacked {
    /// The columns themselves, each a component.
    pub(crate) fn verbatim(means: &Means) -> Self {
        let n_cols = means.mean.n_cols;
        let mut right = Dense::zeros(n_cols, n_cols);
        (0..n_cols).for_each(|col| right.row_mut(col)[col] = 1.0);
        let mut doubt = means.a.clone();
        doubt.data.iter_mut().zip(&means.b.data).for_each(|(a, b)| *a = 0.5 * (*a - b));
        let noise = means.noise_per_entry();
        let left = means.mean.clone();
        Self { left, doubt, right, unit: means.unit, truncation: 0.0, sampling: noise, noise, packing: 0.0 }
    }

    /// Mean square error in all.
    pub(crate) fn error(&self) -> f64 {
        self.truncation + self.sampling
    }

    /// Rounds the factors. A mean square beyond the range of `f32` is told as the last number of that range.
    pub(crate) fn packed(&self) -> BlockFactors {
        let (left, right) = (&self.left, &self.right);
        let mut factors = BlockFactors::from_f32(&left.data, &right.data, left.n_rows, right.n_cols, left.n_cols)
            .with_doubt(&self.doubt.data, &left.data);
        factors.scale.iter_mut().for_each(|scale| *scale = (f64::from(*scale) * self.unit) as f32);
        let [truncation, sampling, noise] = [self.truncation + self.packing, self.sampling, self.noise]
            .map(|x| (x * self.unit * self.unit).clamp(f64::from(f32::MIN), f64::from(f32::MAX)) as f32);
        factors.error = BlockError { truncation, sampling, noise };
        factors
    }
}
