//! Chosen rows and columns: the family of Algorithms 1 to 4 and a variant of the last, each with five cores.
//!
//! C are whole columns, R whole rows, W their intersection. `C · W⁻¹ · R` looks at nothing else \[Drineas2005\] and pays for it with
//! the condition of W; `Q·Qᵀ · A · V·Vᵀ`, with bases Q of C and V of R, is the best that can be made of both \[Stewart1999\]; `A · V·Vᵀ`
//! the best that can be made of the rows.

use nalgebra::DMatrix;

use super::{
    Approximation, Core, MethodError,
    decompose::{Singular, orthonormal, singular},
    real::Real,
};
use crate::{
    landmarks::{Candidates, Landmarks, Selection, choose_from},
    random::Random,
};

/// Rows and columns by one of the four algorithms or a variant of the last, as many of both, then the core.
pub(super) fn cross<S: Real>(
    matrix: &DMatrix<S>,
    selection: Selection,
    core: Core,
    rank: usize,
    rng: &mut Random,
) -> Result<Approximation<S>, MethodError> {
    let Landmarks { bundles: rows, columns } = landmarks(matrix, selection, rank, rng);
    let (left, right) = with_core(matrix, &rows, &columns, core)?;
    Ok(Approximation::product(left, right))
}

/// Rows and columns of a dense matrix; a bundle is a row.
pub(crate) fn landmarks<S: Real>(
    matrix: &DMatrix<S>,
    selection: Selection,
    count: usize,
    rng: &mut Random,
) -> Landmarks {
    let row_major = matrix.transpose();
    let rows: Vec<usize> = (0..matrix.nrows()).collect();
    let candidates = Candidates {
        values: row_major.as_slice(),
        n_cols: matrix.ncols(),
        bundle_len: 1,
        bundles: &rows,
        weights: &vec![1.0; rows.len()],
    };
    let (n_rows, n_columns) = (count.min(matrix.nrows()), count.min(matrix.ncols()));
    let mut chosen = choose_from(&candidates, selection, n_rows, n_columns, rng);
    fill(&mut chosen.bundles, n_rows, matrix.nrows(), rng);
    fill(&mut chosen.columns, n_columns, matrix.ncols(), rng);
    chosen
}

/// k-means may end with fewer clusters than it was asked for; random others take their places.
fn fill(chosen: &mut Vec<usize>, count: usize, of: usize, rng: &mut Random) {
    let others: Vec<usize> = (0..of).filter(|i| !chosen.contains(i)).collect();
    chosen.extend(rng.choose(&others, count - chosen.len()));
}

/// Left and right factor from given rows and columns.
pub(crate) fn with_core<S: Real>(
    matrix: &DMatrix<S>,
    rows: &[usize],
    columns: &[usize],
    core: Core,
) -> Result<(DMatrix<S>, DMatrix<S>), MethodError> {
    let (c, r) = (matrix.select_columns(columns), matrix.select_rows(rows));
    match core {
        Core::Projection => {
            let basis = orthonormal(&r.transpose());
            Ok((matrix * &basis, basis.transpose()))
        }
        Core::Qr => {
            let (of_columns, of_rows) = (orthonormal(&c), orthonormal(&r.transpose()));
            let core = of_columns.tr_mul(matrix) * &of_rows;
            Ok((of_columns * core, of_rows.transpose()))
        }
        Core::Inverse => {
            let w = r.select_columns(columns);
            // X · W = C, by elimination on the transpose.
            let solved = w.transpose().lu().solve(&c.transpose());
            Ok((solved.ok_or(MethodError::Singular { size: w.nrows() })?.transpose(), r))
        }
        Core::PseudoInverse { rcond } => {
            let rcond = S::nearest(rcond);
            Ok((times_inverse(&c, &r.select_columns(columns), |share| invert_above(share, rcond))?, r))
        }
        Core::Tikhonov { lambda } => {
            let lambda = S::nearest(lambda);
            let damped = |share: S| share / (share * share + lambda * lambda);
            Ok((times_inverse(&c, &r.select_columns(columns), damped)?, r))
        }
    }
}

/// The inverse of a singular value; zero where it is not above the threshold.
pub(super) fn invert_above<S: Real>(share: S, threshold: S) -> S {
    if share > threshold { S::one() / share } else { S::zero() }
}

/// `C · V · g(Σ) · Uᵀ` for `W = U Σ Vᵀ`; g is told each singular value as a share of the largest, and so is its result.
pub(super) fn times_inverse<S: Real>(
    c: &DMatrix<S>,
    w: &DMatrix<S>,
    inverse: impl Fn(S) -> S,
) -> Result<DMatrix<S>, MethodError> {
    let Singular { left, values, mut right } = singular(w)?;
    for (i, &value) in values.iter().enumerate() {
        right.column_mut(i).scale_mut(inverse(value / values[0]) / values[0]);
    }
    Ok(c * right * left.transpose())
}
