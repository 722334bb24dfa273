//! The yardstick: nothing of the same rank is nearer \[Eckart1936\].

use nalgebra::DMatrix;

use super::{Approximation, MethodError, decompose::right_singular, real::Real};

/// All rows projected onto the leading right singular vectors, or all columns onto the left ones, whichever are shorter.
pub(super) fn svd<S: Real>(matrix: &DMatrix<S>, rank: usize) -> Result<Approximation<S>, MethodError> {
    if matrix.ncols() <= matrix.nrows() {
        let mut basis = right_singular(matrix)?.vectors;
        basis.resize_horizontally_mut(rank.min(basis.ncols()), S::zero());
        return Ok(Approximation::product(matrix * &basis, basis.transpose()));
    }
    let mut basis = right_singular(&matrix.transpose())?.vectors;
    basis.resize_horizontally_mut(rank.min(basis.ncols()), S::zero());
    let right = basis.tr_mul(matrix);
    Ok(Approximation::product(basis, right))
}
