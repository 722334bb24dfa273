//! The interpolative decomposition of the rows \[Cheng2005\], by a strong rank-revealing QR factorization \[Gu1996\].
//!
//! Some rows, and all rows as combinations of them, with no coefficient above `f`. The error of rank k is at most
//! `√(1 + f²k(n − k)) σₖ₊₁` for n rows.

use nalgebra::DMatrix;

use super::{
    Approximation, MethodError,
    decompose::{Pivoted, orthonormal, pivoted},
    real::Real,
};

/// What coefficients are bounded by: f of the paper.
pub(super) const BOUND: f64 = 2.0;

pub(super) fn row_id<S: Real>(matrix: &DMatrix<S>, rank: usize) -> Result<Approximation<S>, MethodError> {
    let Pivoted { pivots: mut rows, basis, rest } = pivoted(&matrix.transpose(), rank);
    let mut found = Interpolation::new(matrix, &rows, basis, rest)?;
    // Each exchange at least doubles the volume of the rows, and pivoting started within n^(k/2) of the largest.
    let most = rows.len() * (matrix.nrows() as f64).log2().ceil() as usize;
    for _ in 0..most {
        let Some((place, row)) = found.exchange(&rows) else { break };
        rows[place] = row;
        let basis = orthonormal_in_order(&matrix.select_rows(&rows));
        let rest = rest_of(matrix, &basis);
        found = Interpolation::new(matrix, &rows, basis, rest)?;
    }
    Ok(Approximation::product(found.coefficients, matrix.select_rows(&rows)))
}

/// All rows in terms of the chosen ones.
struct Interpolation<S: Real> {
    /// Rows × chosen rows.
    coefficients: DMatrix<S>,
    /// Norm of what the chosen rows leave of each row.
    rest: Vec<S>,
    /// Norm of each row of the inverse of R₁₁: how little would be missed without a chosen row.
    inverse_norms: Vec<S>,
}

impl<S: Real> Interpolation<S> {
    fn new(matrix: &DMatrix<S>, rows: &[usize], basis: DMatrix<S>, rest: Vec<S>) -> Result<Self, MethodError> {
        let in_basis = matrix * basis;
        // R₁₁ᵀ of the paper.
        let chosen = in_basis.select_rows(rows);
        let inverse = chosen.clone().try_inverse().ok_or(MethodError::Singular { size: rows.len() })?;
        let inverse_norms = inverse.column_iter().map(|column| column.norm()).collect();
        let mut coefficients = in_basis * inverse;
        // The chosen rows are themselves, to the last digit.
        for (place, &row) in rows.iter().enumerate() {
            coefficients.row_mut(row).fill(S::zero());
            coefficients[(row, place)] = S::one();
        }
        Ok(Self { coefficients, rest, inverse_norms })
    }

    /// The exchange of a chosen row for another that makes the volume of the chosen rows grow most, if by more than the bound.
    fn exchange(&self, rows: &[usize]) -> Option<(usize, usize)> {
        let bound = S::nearest(BOUND * BOUND);
        let mut best = (bound, None);
        for (place, &inverse_norm) in self.inverse_norms.iter().enumerate() {
            for (row, (&coefficient, &rest)) in self.coefficients.column(place).iter().zip(&self.rest).enumerate() {
                let growth = coefficient * coefficient + rest * rest * inverse_norm * inverse_norm;
                if growth > best.0 && !rows.contains(&row) {
                    best = (growth, Some((place, row)));
                }
            }
        }
        best.1
    }
}

/// Norm of what a basis leaves of each row.
fn rest_of<S: Real>(matrix: &DMatrix<S>, basis: &DMatrix<S>) -> Vec<S> {
    let rest = matrix - matrix * basis * basis.transpose();
    rest.row_iter().map(|row| row.norm()).collect()
}

fn orthonormal_in_order<S: Real>(rows: &DMatrix<S>) -> DMatrix<S> {
    orthonormal(&rows.transpose())
}
