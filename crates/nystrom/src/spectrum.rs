//! Leading eigenvalues of symmetric matrices, and right singular vectors of wide ones.

use nalgebra::{DMatrix, SymmetricEigen};

use crate::{
    dense::{Dense, View, eigen},
    product::product,
    random::Random,
};

/// Rows of a matrix from which on its leading pairs are found by iteration.
const LARGE: usize = 512;
/// Vectors that are iterated beyond those that are asked for: a share of these, and some.
const SPARE: (f64, usize) = (0.125, 8);
/// Steps of the iteration.
const STEPS: usize = 3;

/// The largest eigenvalues of a symmetric matrix (row-major, n × n), at most `most` of them, largest first, and their unit
/// vectors: row-major, one vector of n entries after the other.
fn largest_eigenpairs(n: usize, matrix: &[f64], most: usize) -> (Vec<f64>, Vec<f64>) {
    assert_eq!(matrix.len(), n * n, "a matrix of {n} × {n}");
    let eigen = SymmetricEigen::new(DMatrix::from_row_slice(n, n, matrix));
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]).then(a.cmp(&b)));
    order.truncate(most);
    let values = order.iter().map(|&at| eigen.eigenvalues[at]).collect();
    let vectors = order.iter().flat_map(|&at| eigen.eigenvectors.column(at).iter().copied().collect::<Vec<_>>());
    (values, vectors.collect())
}

/// About the largest eigenvalues of a symmetric positive matrix (row-major, n × n), at most `most` of them, largest first, and
/// their unit vectors: row-major, one vector of n entries after the other.
///
/// Of a small matrix they are exact. Of a large one the last of many need not be the very largest: they are values and vectors of
/// the matrix within a space that holds nearly all that as many pairs can hold, found by a power iteration from random vectors
/// \[Halko2011\]. Whatever the space, what the matrix makes of one of them is orthogonal to the others. Pairs below `1e-7` of
/// the largest are left out there.
pub fn leading_pairs(n: usize, matrix: &[f64], most: usize) -> (Vec<f64>, Vec<f64>) {
    assert_eq!(matrix.len(), n * n, "a matrix of {n} × {n}");
    let width = most + (SPARE.0 * most as f64) as usize + SPARE.1;
    if n < LARGE || 2 * width > n {
        return largest_eigenpairs(n, matrix, most);
    }
    let matrix = View { data: matrix, n_rows: n, n_cols: n, row_stride: n, col_stride: 1 };
    let mut rng = Random::new([n as u64, most as u64]);
    let data = (0..width * n).map(|_| rng.unit() - 0.5).collect();
    let mut vectors = Dense { n_rows: width, n_cols: n, data };
    for _ in 0..STEPS {
        vectors = right_vectors(&product(vectors.view(), matrix));
    }
    let met = product(vectors.view(), matrix);
    let (mut values, turns) = eigen(&product(met.view(), vectors.t()));
    values.truncate(most);
    (values, product(turns.first_cols(most).t(), vectors.view()).data)
}

/// Right singular vectors of a wide matrix, as rows, largest first.
pub(crate) fn right_vectors(wide: &Dense<f64>) -> Dense<f64> {
    let (values, vectors) = eigen(&product(wide.view(), wide.t()));
    let mut basis = product(vectors.t(), wide.view());
    for (r, value) in values.iter().enumerate() {
        basis.row_mut(r).iter_mut().for_each(|x| *x /= value.sqrt());
    }
    basis
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A matrix whose eigenvectors are cosines, of some eigenvalues.
    fn of_cosines(n: usize, values: &[f64]) -> Vec<f64> {
        let cosine = |k: usize, i: usize| {
            let square: f64 = if k == 0 { 1.0 } else { 2.0 };
            (square / n as f64).sqrt() * (std::f64::consts::PI * k as f64 * (i as f64 + 0.5) / n as f64).cos()
        };
        let rows = |weight: fn(f64) -> f64| {
            let row = |k: usize| (0..n).map(move |i| weight(values[k]) * cosine(k, i));
            Dense { n_rows: values.len(), n_cols: n, data: (0..values.len()).flat_map(row).collect::<Vec<f64>>() }
        };
        product(rows(|_| 1.0).t(), rows(|value| value).view()).data
    }

    #[test]
    fn leading_pairs_hold_nearly_what_the_largest_do() {
        let (n, most) = (LARGE, 64);
        let known: Vec<f64> = (1..=n).map(|k| (k as f64).powi(-2)).collect();
        let matrix = of_cosines(n, &known);
        let (values, vectors) = leading_pairs(n, &matrix, most);
        assert_eq!((values.len(), vectors.len()), (most, most * n));
        for (found, known) in values.iter().zip(&known).take(most / 4) {
            assert!((found / known - 1.0).abs() < 1e-3, "{found} for {known}");
        }
        let left = |values: &[f64]| known.iter().sum::<f64>() - values.iter().sum::<f64>();
        let (ours, least) = (left(&values), left(&known[..most]));
        assert!(ours >= 0.999 * least && ours < 1.05 * least, "{ours} is left, {least} at least");
        // Within what they span they are the pairs of the matrix.
        let vectors = Dense { n_rows: most, n_cols: n, data: vectors };
        let matrix = Dense { n_rows: n, n_cols: n, data: matrix };
        let met = product(product(vectors.view(), matrix.view()).view(), vectors.t());
        for (at, found) in met.data.iter().enumerate() {
            let expected = if at / most == at % most { values[at / most] } else { 0.0 };
            assert!((found - expected).abs() < 1e-10, "{found} for {expected}");
        }
    }

    #[test]
    fn leading_pairs_of_a_matrix_of_low_rank_are_all_that_it_has() {
        let known: Vec<f64> = (1..=20).map(|k| (k as f64).powi(-2)).collect();
        let (values, _) = leading_pairs(LARGE, &of_cosines(LARGE, &known), 64);
        assert_eq!(values.len(), known.len());
        for (found, known) in values.iter().zip(&known) {
            assert!((found / known - 1.0).abs() < 1e-9, "{found} for {known}");
        }
    }

    #[test]
    fn pairs_come_largest_first_and_give_the_matrix_back() {
        let matrix = [2.0, 1.0, 0.0, 1.0, 2.0, 0.0, 0.0, 0.0, 5.0];
        let (values, vectors) = largest_eigenpairs(3, &matrix, 2);
        assert!((values[0] - 5.0).abs() < 1e-12 && (values[1] - 3.0).abs() < 1e-12, "{values:?}");
        let (values, vectors_all) = largest_eigenpairs(3, &matrix, 3);
        assert_eq!(vectors, vectors_all[..6]);
        for (at, x) in matrix.iter().enumerate() {
            let back: f64 = (0..3).map(|k| values[k] * vectors_all[3 * k + at / 3] * vectors_all[3 * k + at % 3]).sum();
            assert!((back - x).abs() < 1e-12, "{back} for {x}");
        }
    }
}
