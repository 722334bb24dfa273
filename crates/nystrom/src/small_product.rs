//! Products of small matrices, with the vector instructions of the machine.
#![cfg_attr(
    target_arch = "x86_64",
    expect(unsafe_code, reason = "AVX2 behind run-time detection; `plain` is the safe twin with the same results")
)]

use std::ops::Range;

/// Rows that are worked on at a time.
const TALL: usize = 4;
/// Columns that are worked on at a time.
const WIDE: usize = 16;

/// `left · right`, all row-major.
#[derive(Clone, Copy)]
pub(crate) struct SmallProduct<'a> {
    /// Rows × inner size.
    pub(crate) left: &'a [f32],
    /// Inner size × columns.
    pub(crate) right: &'a [f32],
    /// Inner size.
    pub(crate) n_inner: usize,
    /// Those of the inner indices whose products are not all zero, in ascending order.
    pub(crate) nonzero: &'a [usize],
    pub(crate) n_cols: usize,
}

impl SmallProduct<'_> {
    /// Writes the product, rows × columns.
    pub(crate) fn write(self, out: &mut [f32]) {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            // SAFETY: AVX2 was found.
            return unsafe { write_avx2(self, out) };
        }
        self.write_plain(out);
    }

    fn write_plain(self, out: &mut [f32]) {
        self.write_everything(out);
    }

    #[inline(always)]
    fn write_everything(self, out: &mut [f32]) {
        let (wide, narrow) = (self.n_cols / WIDE * WIDE, self.n_cols / 8 * 8);
        self.write_columns::<WIDE>(0..wide, out);
        self.write_columns::<8>(wide..narrow, out);
        self.write_columns::<1>(narrow..self.n_cols, out);
    }

    /// Columns whose number `N` divides.
    #[inline(always)]
    fn write_columns<const N: usize>(self, columns: Range<usize>, out: &mut [f32]) {
        let n_rows = out.len() / self.n_cols;
        let tall = n_rows / TALL * TALL;
        for first in columns.step_by(N) {
            // Closures would be compiled for any machine.
            for row in (0..tall).step_by(TALL) {
                self.write_tile::<TALL, N>([row, first], out);
            }
            for row in tall..n_rows {
                self.write_tile::<1, N>([row, first], out);
            }
        }
    }

    /// `M` rows of `N` columns: few enough that sums stay in registers.
    #[inline(always)]
    fn write_tile<const M: usize, const N: usize>(self, [row, column]: [usize; 2], out: &mut [f32]) {
        let left: [&[f32]; M] = std::array::from_fn(|m| &self.left[(row + m) * self.n_inner..][..self.n_inner]);
        let mut sums = [[0.0; N]; M];
        for &inner in self.nonzero {
            let right = &self.right[inner * self.n_cols + column..][..N];
            for m in 0..M {
                let factor = left[m][inner];
                for n in 0..N {
                    sums[m][n] += factor * right[n];
                }
            }
        }
        for (m, sums) in sums.iter().enumerate() {
            out[(row + m) * self.n_cols + column..][..N].copy_from_slice(sums);
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn write_avx2(product: SmallProduct<'_>, out: &mut [f32]) {
    product.write_everything(out);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn products_agree_with_the_definition_whatever_the_instructions() {
        let mut rng = Random::new([1, 5]);
        for [n_rows, n_inner, n_cols] in [[1, 1, 1], [4, 8, 16], [5, 3, 7], [9, 16, 29], [16, 16, 128]] {
            let mut numbers = |n: usize| -> Vec<f32> { (0..n).map(|_| rng.normal()).collect() };
            let (left, mut right) = (numbers(n_rows * n_inner), numbers(n_inner * n_cols));
            let nonzero: Vec<usize> = (0..n_inner).filter(|inner| inner % 3 != 1).collect();
            let is_nonzero = |at: usize| nonzero.contains(&(at / n_cols));
            right.iter_mut().enumerate().filter(|(at, _)| !is_nonzero(*at)).for_each(|(_, x)| *x = 0.0);
            let product = SmallProduct { left: &left, right: &right, n_inner, nonzero: &nonzero, n_cols };
            let (mut fast, mut plain) = (vec![1.0; n_rows * n_cols], vec![2.0; n_rows * n_cols]);
            product.write(&mut fast);
            product.write_plain(&mut plain);
            assert_eq!(fast, plain);
            for (at, got) in plain.iter().enumerate() {
                let (row, col) = (at / n_cols, at % n_cols);
                let want: f32 = (0..n_inner).map(|i| left[row * n_inner + i] * right[i * n_cols + col]).sum();
                assert!((got - want).abs() < 1e-4, "{n_rows} {n_inner} {n_cols}: {got} {want}");
            }
        }
    }
}
