//! Nyström's method on powers of the entries \[Wang2009\].
//!
//! A matrix that is not of low rank may be so after `f(x) = x^γ` (here with the sign of x). The entries are `f⁻¹(f(C) · f(W)⁺ · f(R))`, so
//! that no product of factors gives them. The authors choose γ where the chosen values have the least "rank factor", which
//! falls without end as γ → 0 and all entries → 1; here γ is the power by which the first half of the chosen rows and columns best predicts
//! the others.

use nalgebra::DMatrix;

use super::{
    Approximation, MethodError,
    approximation::signed_power,
    cross::{invert_above, landmarks, times_inverse},
    real::Real,
};
use crate::{
    landmarks::{Landmarks, Selection},
    random::Random,
};

/// Powers that are tried.
const POWERS: [f64; 6] = [1.0, 1.0 / 2.0, 1.0 / 3.0, 1.0 / 4.0, 1.0 / 6.0, 1.0 / 8.0];

pub(super) fn kernel<S: Real>(
    matrix: &DMatrix<S>,
    (gamma, rcond): (Option<f64>, S),
    rank: usize,
    rng: &mut Random,
) -> Result<Approximation<S>, MethodError> {
    let Landmarks { bundles: rows, columns } = landmarks(matrix, Selection::Alg4, rank, rng);
    let (c, r) = (matrix.select_columns(&columns), matrix.select_rows(&rows));
    let gamma = S::nearest(match gamma {
        Some(gamma) => gamma,
        None => best_power(&c, &r, &rows, &columns, rcond)?,
    });
    let (left, right) = in_powers(&c, &r, &columns, (gamma, rcond))?;
    Ok(Approximation::root(left, right, gamma))
}

/// `f(C) · f(W)⁺` and `f(R)`.
fn in_powers<S: Real>(
    c: &DMatrix<S>,
    r: &DMatrix<S>,
    columns: &[usize],
    (gamma, rcond): (S, S),
) -> Result<(DMatrix<S>, DMatrix<S>), MethodError> {
    let [c, r] = [c, r].map(|values| values.map(|x| signed_power(x, gamma)));
    Ok((times_inverse(&c, &r.select_columns(columns), |share| invert_above(share, rcond))?, r))
}

/// The power by which half of the chosen rows and columns, the other half left out, come nearest to that half.
fn best_power<S: Real>(
    c: &DMatrix<S>,
    r: &DMatrix<S>,
    rows: &[usize],
    columns: &[usize],
    rcond: S,
) -> Result<f64, MethodError> {
    let half = rows.len().div_ceil(2);
    let (c_half, r_half) = (c.columns(0, half).into_owned(), r.rows(0, half).into_owned());
    let held_out = |left: &DMatrix<S>, right: &DMatrix<S>, gamma: S| {
        let root = |x: S| signed_power(x, S::one() / gamma);
        let of_rows = left.select_rows(&rows[half..]) * right;
        let of_columns = left * right.select_columns(&columns[half..]);
        let missed_rows = of_rows.map(root) - r.rows(half, rows.len() - half);
        let missed_columns = of_columns.map(root) - c.columns(half, rows.len() - half);
        (missed_rows.norm_squared() + missed_columns.norm_squared()).to_f64()
    };
    let mut best = (f64::INFINITY, POWERS[0]);
    for power in POWERS {
        let gamma = S::nearest(power);
        let (left, right) = in_powers(&c_half, &r_half, &columns[..half], (gamma, rcond))?;
        let error = held_out(&left, &right, gamma);
        if error < best.0 {
            best = (error, power);
        }
    }
    Ok(best.1)
}
