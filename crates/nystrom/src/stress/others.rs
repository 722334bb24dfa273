//! What other methods make of the cases.

use nalgebra::DMatrix;

use super::Case;
use crate::{
    landmarks::Selection,
    random::Random,
    rivals::{Method, MethodError, Real, approximate, landmarks},
};

/// Distance from the truth of what a method makes of the mean of both halves, all in the numbers `S`; infinite if an entry of it is
/// no number.
///
/// [`Method::Projected`] gives the same in both: samples come in single precision, in which its factors are computed as well (sums,
/// Gram matrices and eigenvalues in double), and both are rounded to eleven bits. So ours is asked once, in single precision, and
/// held against an optimum in double.
///
/// # Errors
/// What the method says.
pub fn rival<S: Real>(case: &Case, method: Method, seed: u64) -> Result<f64, MethodError> {
    let matrix: DMatrix<S> = case.mean().map(S::nearest);
    let approximation = approximate(method, &matrix, case.rank, seed)?;
    Ok(case.distance(&approximation.to_dense().map(S::to_f64)))
}

/// Condition of the intersection of as many rows as columns that an algorithm chooses with a seed, in double precision: the largest
/// singular value over the least, infinite where that is zero.
pub fn condition(case: &Case, selection: Selection, seed: u64) -> f64 {
    let mean = case.mean();
    let largest = mean.amax();
    let count = case.rank.min(mean.nrows()).min(mean.ncols());
    // Squares of the entries are compared in the choice: they must be in range.
    let matrix = if largest > 0.0 { mean / largest } else { mean };
    let chosen = landmarks(&matrix, selection, count, &mut Random::new([seed, 0]));
    let values = matrix.select_rows(&chosen.bundles).select_columns(&chosen.columns).singular_values();
    let (greatest, least) = (values.max(), values.min());
    if least > 0.0 { greatest / least } else { f64::INFINITY }
}
