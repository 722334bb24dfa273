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

    /// Rounds the factors. A scale or a mean square beyond the range of `f32` becomes the last one of that range.
    pub(crate) fn packed(&self) -> BlockFactors {
        let (left, right) = (&self.left, &self.right);
        let (unit, sizes) = (self.unit.log2().round() as i32, [left.n_rows, right.n_cols, left.n_cols]);
        let mut factors =
            BlockFactors::in_unit(unit, &left.data, &right.data, sizes).with_doubt(unit, &self.doubt.data, &left.data);
        let [truncation, sampling, noise] = [self.truncation + self.packing, self.sampling, self.noise]
            .map(|x| (x * self.unit * self.unit).clamp(f64::from(f32::MIN), f64::from(f32::MAX)) as f32);
        factors.error = BlockError { truncation, sampling, noise };
        factors
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::factors::power_of_two;

    #[test]
    fn no_scale_is_zero_however_small_the_unit() {
        let one = |x: f32| Dense { n_rows: 1, n_cols: 1, data: vec![x] };
        for exponent in [-149, -145, -140, -127, -120] {
            let factors = Unpacked {
                left: one(1.0),
                doubt: one(0.5),
                right: one(1.0),
                unit: power_of_two(exponent),
                truncation: 0.0,
                sampling: 0.0,
                noise: 0.0,
                packing: 0.0,
            };
            let packed = factors.packed();
            assert_eq!(packed.entry(0, 0), power_of_two(exponent) as f32, "{packed:?}");
            assert_eq!(packed.doubt[0].to_f32(), 0.5 * packed.left[0].to_f32(), "{packed:?}");
        }
    }

    #[test]
    fn no_scale_is_infinite_however_large_the_unit() {
        let one = |x: f32| Dense { n_rows: 1, n_cols: 1, data: vec![x] };
        let unit = power_of_two(127);
        let of = |x: f32| Unpacked {
            left: one(x),
            doubt: one(0.0),
            right: one(1.0),
            unit,
            truncation: 0.0,
            sampling: 0.0,
            noise: 0.0,
            packing: 0.0,
        };
        assert_eq!(of(1.5).packed().scale, [2f32.powi(119)]);
        let beyond = of(6.0).packed();
        assert!(beyond.scale == [2f32.powi(119)] && beyond.entry(0, 0).is_finite(), "{beyond:?}");
        assert_eq!(of(0.0).packed().entry(0, 0), 0.0);
    }
}
