//! One group of columns of a sampled block: the means of both halves, brought to a common scale, and what rows tell.

use std::ops::Range;

use crate::{dense::Dense, factors::power_of_two};

/// The means of two halves over some columns; every value is to be multiplied by `unit`.
#[derive(Default)]
pub(crate) struct Means {
    /// First half, rows × columns.
    pub(crate) a: Dense<f32>,
    /// Second half, rows × columns.
    pub(crate) b: Dense<f32>,
    /// Mean of both halves, rows × columns.
    pub(crate) mean: Dense<f32>,
    /// A power of two.
    pub(crate) unit: f64,
    /// Sum over each row of the product of the halves: its energy, free of the bias of noise.
    pub(crate) cross: Vec<f64>,
    /// Sum over each row of the squared half difference: the energy of the noise of the mean.
    pub(crate) noise: Vec<f64>,
}

impl Means {
    /// Takes over some columns of the sums of both halves.
    ///
    /// # Errors
    /// The first row with a value that is not finite.
    pub(crate) fn fill(
        &mut self,
        halves: [&[f32]; 2],
        n_cols: usize,
        columns: &Range<usize>,
        n_samples: u32,
    ) -> Result<(), usize> {
        let n_rows = halves[0].len() / n_cols;
        let mut largest = 0.0f32;
        for row in 0..n_rows {
            for half in halves {
                let values = &half[row * n_cols..][columns.clone()];
                if !values.iter().fold(0.0, |sum, x| sum + x * 0.0).is_finite() {
                    return Err(row);
                }
                largest = values.iter().fold(largest, |largest, x| largest.max(x.abs()));
            }
        }
        let exponent = if largest > 0.0 { f64::from(largest).log2().floor() as i32 } else { 0 };
        let scale = power_of_two(-exponent) / f64::from(n_samples);
        self.unit = power_of_two(exponent);
        self.scale_rows(halves, n_cols, columns, scale as f32, scale);
        Ok(())
    }

    fn scale_rows(&mut self, halves: [&[f32]; 2], n_cols: usize, columns: &Range<usize>, scale: f32, exact: f64) {
        let n_rows = halves[0].len() / n_cols;
        // A scale beyond the range of `f32` (sums near its limits) is applied in two steps.
        let (first, second) = if scale.is_normal() { (scale, 1.0) } else { (exact.sqrt() as f32, exact.sqrt() as f32) };
        for dense in [&mut self.a, &mut self.b, &mut self.mean] {
            (dense.n_rows, dense.n_cols) = (n_rows, columns.len());
            dense.data.resize(n_rows * columns.len(), 0.0);
        }
        self.cross.clear();
        self.noise.clear();
        for row in 0..n_rows {
            let [a, b] = halves.map(|half| &half[row * n_cols..][columns.clone()]);
            let (out_a, out_b, out_mean) = (self.a.row_mut(row), self.b.row_mut(row), self.mean.row_mut(row));
            let (mut cross, mut noise) = ([0.0f32; 8], [0.0f32; 8]);
            for i in 0..a.len() {
                let (x, y) = (a[i] * first * second, b[i] * first * second);
                (out_a[i], out_b[i], out_mean[i]) = (x, y, 0.5 * (x + y));
                cross[i % 8] += x * y;
                noise[i % 8] += 0.25 * (x - y) * (x - y);
            }
            self.cross.push(cross.iter().map(|&x| f64::from(x)).sum());
            self.noise.push(noise.iter().map(|&x| f64::from(x)).sum());
        }
    }

    /// Number of entries.
    pub(crate) fn n_entries(&self) -> f64 {
        (self.mean.n_rows * self.mean.n_cols) as f64
    }
}
