//! Decompositions that all methods share: triangles, orthonormal bases, singular values.
//!
//! Accuracy comes before speed: Householder triangles, Gram–Schmidt twice \[Giraud2005\], one-sided Jacobi rotations on a
//! pivoted triangle \[Drmac2008\]. None of them squares the condition number.

use nalgebra::DMatrix;

use super::{MethodError, real::Real};
use crate::dense::dot;

/// Sweeps of Jacobi rotations; a pivoted triangle takes four to eight.
const MAX_SWEEPS: usize = 60;

/// Singular values, largest first, and the right singular vectors as columns: columns of the matrix × at most its lesser side.
/// Values that rounding cannot tell from zero are left out.
pub(super) struct RightSingular<S: Real> {
    pub(super) values: Vec<S>,
    pub(super) vectors: DMatrix<S>,
}

/// R of a QR decomposition, made of slabs of rows so that tall matrices are read once \[Demmel2012\].
pub(super) fn triangle<S: Real>(matrix: &DMatrix<S>) -> DMatrix<S> {
    let (n_rows, n_cols) = matrix.shape();
    let slab = (3 * n_cols).max(64);
    let mut r = DMatrix::zeros(0, n_cols);
    for first in (0..n_rows).step_by(slab) {
        let taken = slab.min(n_rows - first);
        let mut stacked = DMatrix::zeros(r.nrows() + taken, n_cols);
        stacked.rows_mut(0, r.nrows()).copy_from(&r);
        stacked.rows_mut(r.nrows(), taken).copy_from(&matrix.rows(first, taken));
        r = stacked.qr().unpack_r();
    }
    r
}

/// The right half of a singular value decomposition.
///
/// # Errors
/// If the rotations do not come to an end.
pub(super) fn right_singular<S: Real>(matrix: &DMatrix<S>) -> Result<RightSingular<S>, MethodError> {
    let pivoted = triangle(matrix).col_piv_qr();
    let mut r = pivoted.r();
    pivoted.p().inv_permute_columns(&mut r);
    // R Pᵀ = W Σ Vᵀ, so that the columns of P Rᵀ, turned until they are orthogonal, are V Σ.
    let mut columns = r.transpose();
    let len = columns.nrows();
    let norms = rotate_until_orthogonal(&mut columns, len)?;
    let order = largest_first(&norms);
    let mut vectors = columns.select_columns(&order);
    let values: Vec<S> = order.iter().map(|&i| norms[i]).collect();
    vectors.column_iter_mut().zip(&values).for_each(|(mut vector, &norm)| vector /= norm);
    Ok(RightSingular { values, vectors })
}

/// `left · diag(values) · rightᵀ`, largest values first; those that rounding cannot tell from zero are left out.
pub(super) struct Singular<S: Real> {
    pub(super) left: DMatrix<S>,
    pub(super) values: Vec<S>,
    pub(super) right: DMatrix<S>,
}

/// The whole singular value decomposition of a small matrix. Both sides come of the same rotations, so that an inverse made of
/// them is that of a matrix close by.
///
/// # Errors
/// If the rotations do not come to an end.
pub(super) fn singular<S: Real>(matrix: &DMatrix<S>) -> Result<Singular<S>, MethodError> {
    let (n_rows, n_cols) = matrix.shape();
    // What turns the columns of the matrix turns those of the unit matrix below it as well: A J = U Σ, and J is V.
    let mut columns = matrix.clone().resize_vertically(n_rows + n_cols, S::zero());
    columns.rows_mut(n_rows, n_cols).fill_with_identity();
    let norms = rotate_until_orthogonal(&mut columns, n_rows)?;
    let order = largest_first(&norms);
    let columns = columns.select_columns(&order);
    let values: Vec<S> = order.iter().map(|&i| norms[i]).collect();
    let mut left = columns.rows(0, n_rows).into_owned();
    left.column_iter_mut().zip(&values).for_each(|(mut vector, &norm)| vector /= norm);
    Ok(Singular { left, values, right: columns.rows(n_rows, n_cols).into_owned() })
}

/// The columns that are more than rounding, largest norm first.
fn largest_first<S: Real>(norms: &[S]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..norms.len()).collect();
    order.sort_by(|&i, &j| norms[j].to_f64().total_cmp(&norms[i].to_f64()));
    let largest = order.first().map_or(S::zero(), |&i| norms[i]);
    order.retain(|&i| norms[i] > S::EPSILON * largest);
    order
}

/// Hestenes' rotations, until the first entries of the columns are orthogonal; the norms of these at the end.
fn rotate_until_orthogonal<S: Real>(columns: &mut DMatrix<S>, n_first: usize) -> Result<Vec<S>, MethodError> {
    let (len, n) = columns.shape();
    let enough = S::EPSILON * S::nearest((n_first.max(1) as f64).sqrt());
    let norm = |column: &[S]| dot(&column[..n_first], &column[..n_first]).sqrt();
    let data = columns.as_mut_slice();
    for _ in 0..MAX_SWEEPS {
        let mut norms: Vec<S> = data.chunks(len.max(1)).map(norm).collect();
        let floor = S::EPSILON * norms.iter().fold(S::zero(), |largest, &x| largest.max(x));
        let mut rotated = false;
        for i in 0..n {
            for j in i + 1..n {
                if norms[i] <= floor || norms[j] <= floor {
                    continue;
                }
                let (before, after) = data.split_at_mut(j * len);
                let (x, y) = (&mut before[i * len..][..len], &mut after[..len]);
                // The cosine of the angle between the two, by itself in range whatever the norms are.
                let cosine = dot(&x[..n_first], &y[..n_first]) / norms[i] / norms[j];
                if cosine.abs() <= enough {
                    continue;
                }
                rotated = true;
                rotate(x, y, cosine, [norms[i], norms[j]]);
                (norms[i], norms[j]) = (norm(x), norm(y));
            }
        }
        if !rotated {
            return Ok(norms);
        }
    }
    Err(MethodError::NoConvergence { n_sweeps: MAX_SWEEPS })
}

/// Makes two columns orthogonal.
fn rotate<S: Real>(x: &mut [S], y: &mut [S], cosine: S, [norm_x, norm_y]: [S; 2]) {
    let two = S::nearest(2.0);
    let ratio = norm_y / norm_x;
    let zeta = (ratio - S::one() / ratio) / (two * cosine);
    let tangent = S::one().copysign(zeta) / (zeta.abs() + (S::one() + zeta * zeta).sqrt());
    let c = S::one() / (S::one() + tangent * tangent).sqrt();
    let s = c * tangent;
    for (x, y) in x.iter_mut().zip(y) {
        (*x, *y) = (c * *x - s * *y, s * *x + c * *y);
    }
}

/// An orthonormal basis of some columns, pivot after pivot.
pub(super) struct Pivoted<S: Real> {
    /// Length of a column × at most the limit.
    pub(super) basis: DMatrix<S>,
    /// The columns that became pivots, in their order.
    pub(super) pivots: Vec<usize>,
    /// Norm of what the basis leaves of each column.
    pub(super) rest: Vec<S>,
}

/// Gram–Schmidt with pivoting: the column of which most is left comes next, until none is left or there are `limit`.
pub(super) fn pivoted<S: Real>(columns: &DMatrix<S>, limit: usize) -> Pivoted<S> {
    let (len, n) = columns.shape();
    let mut rest = columns.clone();
    let mut norms: Vec<S> = rest.column_iter().map(|column| column.norm()).collect();
    let floor = norms.iter().fold(S::zero(), |most, &x| most.max(x)) * S::EPSILON * S::nearest(8.0);
    let (mut basis, mut pivots) = (DMatrix::zeros(len, 0), Vec::new());
    while pivots.len() < limit.min(len).min(n) {
        let most = super::real::largest(norms.iter().copied(), |_| true);
        let Some(pivot) = most.filter(|&pivot| norms[pivot] > floor) else { break };
        let mut direction = rest.column(pivot) / norms[pivot];
        let inside = basis.tr_mul(&direction);
        direction -= &basis * inside;
        direction.normalize_mut();
        for (mut column, norm) in rest.column_iter_mut().zip(&mut norms) {
            let part = direction.dot(&column);
            column.axpy(-part, &direction, S::one());
            *norm = column.norm();
        }
        norms[pivot] = S::zero();
        rest.column_mut(pivot).fill(S::zero());
        basis = basis.insert_column(pivots.len(), S::zero());
        basis.set_column(pivots.len(), &direction);
        pivots.push(pivot);
    }
    Pivoted { basis, pivots, rest: norms }
}

/// An orthonormal basis of the span of some columns; duplicates and zeros fall out.
pub(super) fn orthonormal<S: Real>(columns: &DMatrix<S>) -> DMatrix<S> {
    pivoted(columns, usize::MAX).basis
}
