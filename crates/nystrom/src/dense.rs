//! Row-major matrices, small and large, and how they are decomposed.
//!
//! Large matrices are `f32`; what is
//! decomposed (Gram matrices as wide as a basis) is `f64`.

use std::ops::Range;

use nalgebra::{DMatrix, DMatrixView, Dyn, RealField, SymmetricEigen};

/// A row-major matrix, rows × columns.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Dense<T> {
    pub(crate) n_rows: usize,
    pub(crate) n_cols: usize,
    pub(crate) data: Vec<T>,
}

/// A matrix somewhere inside a slice, with a stride for each direction.
#[derive(Clone, Copy)]
pub(crate) struct View<'a, T> {
    pub(crate) data: &'a [T],
    pub(crate) n_rows: usize,
    pub(crate) n_cols: usize,
    pub(crate) row_stride: usize,
    pub(crate) col_stride: usize,
}

impl<T: RealField + Copy> Dense<T> {
    /// All zeros.
    pub(crate) fn zeros(n_rows: usize, n_cols: usize) -> Self {
        Self { n_rows, n_cols, data: vec![T::zero(); n_rows * n_cols] }
    }

    /// One row.
    pub(crate) fn row(&self, row: usize) -> &[T] {
        &self.data[row * self.n_cols..][..self.n_cols]
    }

    /// One row, to be written.
    pub(crate) fn row_mut(&mut self, row: usize) -> &mut [T] {
        &mut self.data[row * self.n_cols..][..self.n_cols]
    }

    /// The matrix as it is.
    pub(crate) fn view(&self) -> View<'_, T> {
        let (n_rows, n_cols) = (self.n_rows, self.n_cols);
        View { data: &self.data, n_rows, n_cols, row_stride: n_cols, col_stride: 1 }
    }

    /// The transpose.
    pub(crate) fn t(&self) -> View<'_, T> {
        self.view().t()
    }

    /// Some rows, in the order asked for.
    pub(crate) fn gather_rows(&self, rows: impl Iterator<Item = usize>) -> Self {
        let mut out = Self { n_rows: 0, n_cols: self.n_cols, data: Vec::new() };
        for row in rows {
            out.data.extend_from_slice(self.row(row));
            out.n_rows += 1;
        }
        out
    }

    /// The first columns.
    pub(crate) fn first_cols(&self, n_cols: usize) -> Self {
        self.cols(0..n_cols.min(self.n_cols))
    }

    /// Some columns.
    pub(crate) fn cols(&self, cols: Range<usize>) -> Self {
        let mut data = Vec::with_capacity(self.n_rows * cols.len());
        (0..self.n_rows).for_each(|row| data.extend_from_slice(&self.row(row)[cols.clone()]));
        Self { n_rows: self.n_rows, n_cols: cols.len(), data }
    }

    /// Some columns, in the order asked for.
    pub(crate) fn gather_cols(&self, cols: &[usize]) -> Self {
        let data = (0..self.n_rows).flat_map(|row| cols.iter().map(move |&col| self.row(row)[col])).collect();
        Self { n_rows: self.n_rows, n_cols: cols.len(), data }
    }

    /// Puts matrices of equally many rows side by side.
    pub(crate) fn side_by_side(parts: &[Self], n_rows: usize) -> Self {
        let n_cols = parts.iter().map(|part| part.n_cols).sum();
        let mut data = Vec::with_capacity(n_rows * n_cols);
        for row in 0..n_rows {
            parts.iter().for_each(|part| data.extend_from_slice(part.row(row)));
        }
        Self { n_rows, n_cols, data }
    }

    /// Entry by entry the mean with another matrix of the same size.
    pub(crate) fn mean_with(&self, other: &Self) -> Self {
        let half: T = nalgebra::convert(0.5_f64);
        let data = self.data.iter().zip(&other.data).map(|(&x, &y)| half * (x + y)).collect();
        Self { n_rows: self.n_rows, n_cols: self.n_cols, data }
    }
}

impl Dense<f32> {
    /// Sum over all entries of the products with those of another matrix of the same size.
    pub(crate) fn inner_product(&self, other: &Self) -> f64 {
        (0..self.n_rows).map(|row| f64::from(dot(self.row(row), other.row(row)))).sum()
    }

    /// The same numbers in double precision.
    pub(crate) fn to_f64(&self) -> Dense<f64> {
        Dense { n_rows: self.n_rows, n_cols: self.n_cols, data: self.data.iter().map(|&x| f64::from(x)).collect() }
    }

    /// A copy in which the rows that `kept` does not name are zero.
    pub(crate) fn masked(&self, kept: &[bool]) -> Self {
        let mut out = Self::zeros(self.n_rows, self.n_cols);
        for row in (0..self.n_rows).filter(|&row| kept[row]) {
            out.row_mut(row).copy_from_slice(self.row(row));
        }
        out
    }
}

impl Dense<f64> {
    /// The same numbers in single precision.
    pub(crate) fn to_f32(&self) -> Dense<f32> {
        Dense { n_rows: self.n_rows, n_cols: self.n_cols, data: self.data.iter().map(|&x| x as f32).collect() }
    }
}

impl<'a, T: RealField + Copy> View<'a, T> {
    /// The transpose.
    pub(crate) fn t(self) -> Self {
        Self {
            n_rows: self.n_cols,
            n_cols: self.n_rows,
            row_stride: self.col_stride,
            col_stride: self.row_stride,
            ..self
        }
    }

    pub(crate) fn at(&self, row: usize, col: usize) -> T {
        self.data[row * self.row_stride + col * self.col_stride]
    }

    pub(crate) fn nalgebra(&self) -> DMatrixView<'a, T, Dyn, Dyn> {
        DMatrixView::from_slice_with_strides(self.data, self.n_rows, self.n_cols, self.row_stride, self.col_stride)
    }
}

/// Scalar product, in eight partial sums (the order of which is fixed).
#[inline(always)]
pub(crate) fn dot<T: RealField + Copy>(a: &[T], b: &[T]) -> T {
    let mut sums = [T::zero(); 8];
    let (a8, b8) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest = a8.remainder().iter().zip(b8.remainder()).fold(T::zero(), |sum, (&x, &y)| sum + x * y);
    for (x, y) in a8.zip(b8) {
        for lane in 0..8 {
            sums[lane] += x[lane] * y[lane];
        }
    }
    sums.iter().fold(rest, |sum, &x| sum + x)
}

/// `out += factor · x`.
#[inline(always)]
pub(crate) fn add_scaled<T: RealField + Copy>(out: &mut [T], factor: T, x: &[T]) {
    for (out, &x) in out.iter_mut().zip(x) {
        *out += factor * x;
    }
}

/// Eigenvalues of a symmetric matrix, largest first, and their vectors as columns. Those below `1e-14` of the largest
/// (singular values below `1e-7`, which single precision does not hold) are left out.
pub(crate) fn eigen(gram: &Dense<f64>) -> (Vec<f64>, Dense<f64>) {
    let k = gram.n_rows;
    if gram.data.iter().all(|&x| x == 0.0) {
        return (Vec::new(), Dense::zeros(k, 0));
    }
    let eigen = SymmetricEigen::new(DMatrix::from_column_slice(k, k, &gram.data));
    let mut order: Vec<usize> = (0..k).collect();
    order.sort_by(|&i, &j| eigen.eigenvalues[j].total_cmp(&eigen.eigenvalues[i]));
    let floor = 1e-14 * eigen.eigenvalues[order[0]].max(0.0);
    order.retain(|&i| eigen.eigenvalues[i] > floor);
    let values = order.iter().map(|&i| eigen.eigenvalues[i]).collect();
    let data = (0..k).flat_map(|row| order.iter().map(move |&i| (row, i))).map(|at| eigen.eigenvectors[at]).collect();
    (values, Dense { n_rows: k, n_cols: order.len(), data })
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::random::Random;

    pub(crate) fn random(n_rows: usize, n_cols: usize, rng: &mut Random) -> Dense<f32> {
        Dense { n_rows, n_cols, data: (0..n_rows * n_cols).map(|_| rng.normal()).collect() }
    }

    #[test]
    fn means_and_inner_products_agree_with_the_definition_entry_by_entry() {
        let mut rng = Random::new([2, 5]);
        let (a, b) = (random(7, 11, &mut rng), random(7, 11, &mut rng));
        let mean = a.mean_with(&b);
        let of_doubles = a.to_f64().mean_with(&b.to_f64());
        assert_eq!([mean.n_rows, mean.n_cols, of_doubles.n_rows, of_doubles.n_cols], [7, 11, 7, 11]);
        let mut sum = 0.0;
        for (i, (x, y)) in a.data.iter().zip(&b.data).enumerate() {
            assert_eq!(mean.data[i], 0.5 * (x + y));
            assert_eq!(of_doubles.data[i], 0.5 * (f64::from(*x) + f64::from(*y)));
            sum += f64::from(*x) * f64::from(*y);
        }
        assert!((a.inner_product(&b) - sum).abs() < 1e-4, "{} {sum}", a.inner_product(&b));
    }
}
