//! One combination of the columns that truncation leaves alone.
//!
//! Truncation drops what is weak or unsure, and what it drops is missing in every product with the factors, most visibly in
//! the one that is asked for most. So the left factor takes the residual of that one product: the least change (in the
//! Frobenius norm) for which `left · right · x` is what was sampled.

use crate::{dense::Dense, fit::Fit, means::Means};

/// Least share of the preserved direction that the basis must hold to carry its residual.
pub(crate) const LEAST_SHARE: f64 = 0.25;

/// Mean squares per entry that keeping a product adds: truncation, sampling.
pub(crate) type Added = [f64; 2];

/// Changes `left` (rows × components of `fit`, the mean's own coefficients) so that its product with `direction` equals the
/// mean's. A basis that hardly holds the direction gets it as a component of its own.
pub(crate) fn preserve(means: &Means, fit: &mut Fit, left: &mut Dense<f32>, direction: &[f32]) -> Added {
    let norm = direction.iter().map(|&x| f64::from(x).powi(2)).sum::<f64>().sqrt();
    if norm == 0.0 || !norm.is_finite() {
        return [0.0; 2];
    }
    let unit: Vec<f64> = direction.iter().map(|&x| f64::from(x) / norm).collect();
    let held: Vec<f64> = (0..fit.basis.n_rows).map(|r| dot(fit.basis.row(r), &unit)).collect();
    let share: f64 = held.iter().map(|x| x * x).sum();
    if share < LEAST_SHARE {
        append(means, fit, left, &unit, &held);
        return [0.0; 2];
    }
    let mut added = [0.0; 2];
    for row in 0..left.n_rows {
        let residual = |matrix: &Dense<f32>, kept: &Dense<f32>| dot(matrix.row(row), &unit) - dot(kept.row(row), &held);
        let (of_a, of_b) = (residual(&means.a, &fit.a), residual(&means.b, &fit.b));
        added[0] += of_a * of_b / share;
        added[1] += 0.25 * (of_a - of_b).powi(2) / share;
        let missing = 0.5 * (of_a + of_b) / share;
        left.row_mut(row).iter_mut().zip(&held).for_each(|(x, held)| *x += (missing * held) as f32);
    }
    added.map(|sum| sum / means.n_entries())
}

/// Adds what the basis lacks of the direction as a last component.
fn append(means: &Means, fit: &mut Fit, left: &mut Dense<f32>, unit: &[f64], held: &[f64]) {
    let mut lacking = unit.to_vec();
    for (r, held) in held.iter().enumerate() {
        lacking.iter_mut().zip(fit.basis.row(r)).for_each(|(x, v)| *x -= held * f64::from(*v));
    }
    let norm = lacking.iter().map(|x| x * x).sum::<f64>().sqrt();
    lacking.iter_mut().for_each(|x| *x /= norm);
    let column: Vec<f32> = (0..left.n_rows).map(|row| dot(means.mean.row(row), &lacking) as f32).collect();
    if column.iter().all(|&x| x == 0.0) {
        return;
    }
    fit.basis.data.extend(lacking.iter().map(|&x| x as f32));
    fit.basis.n_rows += 1;
    let mut wider = Dense::zeros(left.n_rows, left.n_cols + 1);
    for (row, own) in column.into_iter().enumerate() {
        let out = wider.row_mut(row);
        out[..left.n_cols].copy_from_slice(left.row(row));
        out[left.n_cols] = own;
    }
    *left = wider;
}

/// Scalar product, in eight partial sums.
fn dot(a: &[f32], b: &[f64]) -> f64 {
    let ((a8, a), (b8, b)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    let rest: f64 = a.iter().zip(b).map(|(a, b)| f64::from(*a) * b).sum();
    let mut sums = [0.0; 8];
    for (a, b) in a8.iter().zip(b8) {
        for lane in 0..8 {
            sums[lane] += f64::from(a[lane]) * b[lane];
        }
    }
    rest + sums.iter().sum::<f64>()
}
