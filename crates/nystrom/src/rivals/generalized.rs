//! Generalized Nyström \[Nakatsukasa2020\]: `A X · (Yᵀ A X)⁺ · Yᵀ A` from two Gaussian sketches, in the form that is stable.

use nalgebra::DMatrix;

use super::{
    Approximation, MethodError,
    decompose::{Pivoted, pivoted},
    real::Real,
};
use crate::random::Random;

/// The second sketch is wider by this factor, as the author advises.
const OVERSAMPLING: f64 = 1.5;

pub(super) fn generalized_nystrom<S: Real>(
    matrix: &DMatrix<S>,
    rank: usize,
    rng: &mut Random,
) -> Result<Approximation<S>, MethodError> {
    let (n_rows, n_cols) = matrix.shape();
    let wider = ((OVERSAMPLING * rank as f64).ceil() as usize).min(n_rows);
    let mut gaussian = |rows, cols| DMatrix::from_fn(rows, cols, |_, _| S::nearest(f64::from(rng.normal())));
    let range = matrix * gaussian(n_cols, rank);
    let y = gaussian(wider, n_rows);
    // The inverse is never formed: Yᵀ A X = Q T, and T⁻¹ goes to the left, Qᵀ to the right. Columns that rounding cannot tell
    // from combinations of the others fall out before.
    let core = &y * &range;
    let Pivoted { basis: q, pivots, .. } = pivoted(&core, rank);
    let triangle = q.tr_mul(&core.select_columns(&pivots));
    let left = triangle.transpose().lu().solve(&range.select_columns(&pivots).transpose());
    let left = left.ok_or(MethodError::Singular { size: pivots.len() })?.transpose();
    Ok(Approximation::product(left, q.tr_mul(&(y * matrix))))
}
