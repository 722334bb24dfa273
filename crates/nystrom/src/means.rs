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
    /// Takes over some columns of the sums of both halves, each of so many samples.
    ///
    /// # Errors
    /// Row and column (both of `halves`) of a value that is not finite: the first row that has one.
    pub(crate) fn fill(
        &mut self,
        halves: [&[f32]; 2],
        n_cols: usize,
        columns: &Range<usize>,
        n_samples: [u32; 2],
    ) -> Result<(), [usize; 2]> {
        let mut largest = 0.0f32;
        for row in 0..halves[0].len() / n_cols {
            for half in halves {
                let values = &half[row * n_cols..][columns.clone()];
                largest = largest.max(greatest_magnitude(values).map_err(|col| [row, columns.start + col])?);
            }
        }
        let exponent = if largest > 0.0 { f64::from(largest).log2().floor() as i32 } else { 0 };
        let scales = n_samples.map(|n_samples| power_of_two(-exponent) / f64::from(n_samples));
        self.unit = power_of_two(exponent);
        self.scale_rows(halves, n_cols, columns, scales);
        Ok(())
    }

    fn scale_rows(&mut self, halves: [&[f32]; 2], n_cols: usize, columns: &Range<usize>, scales: [f64; 2]) {
        let n_rows = halves[0].len() / n_cols;
        let [scale_a, scale_b] = scales.map(in_two_steps);
        for dense in [&mut self.a, &mut self.b, &mut self.mean] {
            (dense.n_rows, dense.n_cols) = (n_rows, columns.len());
            dense.data.resize(n_rows * columns.len(), 0.0);
        }
        self.cross.clear();
        self.noise.clear();
        for row in 0..n_rows {
            let [a, b] = halves.map(|half| &half[row * n_cols..][columns.clone()]);
            let (out_a, out_b) = (self.a.row_mut(row), self.b.row_mut(row));
            let (mut cross, mut noise) = ([0.0f32; 8], [0.0f32; 8]);
            let mut eight = |a: &[f32; 8], b: &[f32; 8]| {
                let (x, y) = (a.map(|x| x * scale_a[0] * scale_a[1]), b.map(|x| x * scale_b[0] * scale_b[1]));
                for lane in 0..8 {
                    cross[lane] += x[lane] * y[lane];
                    noise[lane] += 0.25 * (x[lane] - y[lane]) * (x[lane] - y[lane]);
                }
                (x, y)
            };
            let ((a, a_rest), (b, b_rest)) = (a.as_chunks(), b.as_chunks());
            let (out_a, out_a_rest) = out_a.as_chunks_mut();
            let (out_b, out_b_rest) = out_b.as_chunks_mut();
            for (((a, b), out_a), out_b) in a.iter().zip(b).zip(out_a).zip(out_b) {
                (*out_a, *out_b) = eight(a, b);
            }
            let (x, y) = eight(&padded(a_rest), &padded(b_rest));
            out_a_rest.copy_from_slice(&x[..a_rest.len()]);
            out_b_rest.copy_from_slice(&y[..a_rest.len()]);
            for (out, (a, b)) in self.mean.row_mut(row).iter_mut().zip(self.a.row(row).iter().zip(self.b.row(row))) {
                *out = 0.5 * (a + b);
            }
            self.cross.push(cross.iter().map(|&x| f64::from(x)).sum());
            self.noise.push(noise.iter().map(|&x| f64::from(x)).sum());
        }
    }

    /// Whether the halves are one and the same, up to what rounding hides: then so is all that is found in them.
    pub(crate) fn is_exact(&self) -> bool {
        self.noise.iter().all(|&noise| noise == 0.0)
    }

    /// Mean square per entry of the noise of the mean.
    pub(crate) fn noise_per_entry(&self) -> f64 {
        self.noise.iter().sum::<f64>() / self.n_entries()
    }

    /// Number of entries.
    pub(crate) fn n_entries(&self) -> f64 {
        (self.mean.n_rows * self.mean.n_cols) as f64
    }
}

/// Two factors of a scale: one beyond the range of `f32` (sums near its limits) is applied in two steps, the first of which is
/// a power of two and rounds nothing.
fn in_two_steps(scale: f64) -> [f32; 2] {
    if (scale as f32).is_normal() {
        return [scale as f32, 1.0];
    }
    let first = power_of_two((0.5 * scale.log2()) as i32);
    [first as f32, (scale / first) as f32]
}

/// # Errors
/// The place of the first value that is not finite.
fn greatest_magnitude(values: &[f32]) -> Result<f32, usize> {
    // As unsigned numbers, magnitudes keep their order, and whatever is not finite comes last.
    let bits = values.iter().fold(0, |greatest, x| (x.to_bits() & 0x7fff_ffff).max(greatest));
    let greatest = f32::from_bits(bits);
    if greatest.is_finite() { Ok(greatest) } else { Err(values.iter().take_while(|x| x.is_finite()).count()) }
}

/// Less than eight values, and zeros.
fn padded(values: &[f32]) -> [f32; 8] {
    let mut out = [0.0; 8];
    out[..values.len()].copy_from_slice(values);
    out
}
