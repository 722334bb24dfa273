//! Eigenvalues of small symmetric matrices, for those who choose a basis before anything is compressed.

use nalgebra::{DMatrix, SymmetricEigen};

/// The largest eigenvalues of a symmetric matrix (row-major, n × n), at most `most` of them, largest first, and their unit
/// vectors: row-major, one vector of n entries after the other.
pub fn largest_eigenpairs(n: usize, matrix: &[f64], most: usize) -> (Vec<f64>, Vec<f64>) {
    assert_eq!(matrix.len(), n * n, "a matrix of {n} × {n}");
    let eigen = SymmetricEigen::new(DMatrix::from_row_slice(n, n, matrix));
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]).then(a.cmp(&b)));
    order.truncate(most);
    let values = order.iter().map(|&at| eigen.eigenvalues[at]).collect();
    let vectors = order.iter().flat_map(|&at| eigen.eigenvectors.column(at).iter().copied().collect::<Vec<_>>());
    (values, vectors.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

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
