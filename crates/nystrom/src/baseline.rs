//! What the projected core is compared with: the best possible factors, and the classic core W⁺.

use nalgebra::{DMatrix, SVD};

/// Unpacked factors, `left · right`.
#[derive(Clone, Debug, PartialEq)]
pub struct DenseFactors {
    /// Row-major, rows × rank.
    pub left: Vec<f32>,
    /// Row-major, rank × columns.
    pub right: Vec<f32>,
    /// Rank.
    pub rank: usize,
}

/// The best factors of a rank \[Eckart1936\], by a full decomposition in double precision. `matrix` is row-major, a whole
/// number of rows of `n_cols` columns.
pub fn svd(matrix: &[f32], n_cols: usize, rank: usize) -> DenseFactors {
    let svd = SVD::new(to_f64(matrix, n_cols), true, true);
    let (u, vt) = (svd.u.expect("was asked for"), svd.v_t.expect("was asked for"));
    let rank = rank.min(svd.singular_values.len());
    let left = u.columns(0, rank) * DMatrix::from_diagonal(&svd.singular_values.rows(0, rank).into_owned());
    DenseFactors { left: row_major(&left), right: row_major(&vt.rows(0, rank).into_owned()), rank }
}

/// Nyström's core \[Drineas2005\], \[Wang2009\]: `C · W⁺ · R` from whole columns C, whole rows R and their intersection W,
/// whose singular values below `rcond` of the largest are dropped. Without that it multiplies noise without bound.
pub fn core_wpinv(matrix: &[f32], n_cols: usize, rows: &[usize], cols: &[usize], rcond: f64) -> DenseFactors {
    let matrix = to_f64(matrix, n_cols);
    let (c, r) = (matrix.select_columns(cols), matrix.select_rows(rows));
    let svd = SVD::new(r.select_columns(cols), true, true);
    let (u, vt) = (svd.u.expect("was asked for"), svd.v_t.expect("was asked for"));
    let floor = rcond * svd.singular_values.max();
    let inverse = svd.singular_values.map(|sigma| if sigma > floor && sigma > 0.0 { 1.0 / sigma } else { 0.0 });
    let left = c * vt.transpose() * DMatrix::from_diagonal(&inverse) * u.transpose();
    DenseFactors { left: row_major(&left), right: row_major(&r), rank: rows.len() }
}

fn to_f64(matrix: &[f32], n_cols: usize) -> DMatrix<f64> {
    DMatrix::from_row_iterator(matrix.len() / n_cols, n_cols, matrix.iter().map(|&x| f64::from(x)))
}

fn row_major(matrix: &DMatrix<f64>) -> Vec<f32> {
    matrix.transpose().iter().map(|&x| x as f32).collect()
}
