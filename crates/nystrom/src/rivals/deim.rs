//! Rows and columns where the leading singular vectors are largest: DEIM-CUR \[Sorensen2016\].

use nalgebra::DMatrix;

use super::{
    Approximation, Core, MethodError,
    cross::with_core,
    decompose::right_singular,
    real::{Real, largest},
};

/// `C · (C⁺ A R⁺) · R` with rows and columns by discrete empirical interpolation.
pub(super) fn deim_cur<S: Real>(matrix: &DMatrix<S>, rank: usize) -> Result<Approximation<S>, MethodError> {
    let tall = matrix.ncols() <= matrix.nrows();
    let found = right_singular(&if tall { matrix.clone() } else { matrix.transpose() })?;
    let rank = rank.min(found.values.len());
    let right = found.vectors.columns(0, rank).into_owned();
    let mut left = if tall { matrix * &right } else { matrix.tr_mul(&right) };
    left.column_iter_mut().zip(&found.values).for_each(|(mut vector, &value)| vector /= value);
    let (of_rows, of_columns) = if tall { (left, right) } else { (right, left) };
    let (left, right) = with_core(matrix, &points(of_rows), &points(of_columns), Core::Qr)?;
    Ok(Approximation::product(left, right))
}

/// One point per vector: where what the vectors before it do not interpolate is largest. That is elimination with pivoting.
fn points<S: Real>(mut vectors: DMatrix<S>) -> Vec<usize> {
    let mut points = Vec::new();
    for j in 0..vectors.ncols() {
        let Some(point) = largest(vectors.column(j).iter().copied(), |_| true) else { break };
        let pivot = vectors.column(j) / vectors[(point, j)];
        for mut later in vectors.columns_range_mut(j + 1..).column_iter_mut() {
            let value = later[point];
            later.axpy(-value, &pivot, S::one());
            later[point] = S::zero();
        }
        points.push(point);
    }
    points
}
