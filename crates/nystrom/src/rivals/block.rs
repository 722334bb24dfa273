//! A block of samples by a method other than this crate's own, so that whole matrices can be compared.
//!
//! Rank is what differs from [`approximate`]: it is the least that brings the factors within the tolerance of what was *sampled*,
//! found by doubling and bisection. No rival knows noise from signal, so noise above the tolerance is fitted as well. The errors
//! told are those of our own factors, with no favor: each half is fitted by itself, with that rank, and held against the
//! other. Of a method [without factors](Method::without_factors) all entries of what it makes of the block are kept.

use nalgebra::DMatrix;

use super::{Method, MethodError, approximate};
use crate::{
    compress::{CompressConfig, Tolerance},
    dense::Dense,
    factors::{BlockError, BlockFactors},
    means::Means,
    project::limit,
    sketch::allowed,
};

/// Factors of the mean of both halves.
///
/// # Errors
/// If the method finds no factors at any of the ranks that were tried.
pub(crate) fn factor(
    means: &Means,
    tolerance: Tolerance,
    config: &CompressConfig,
    seed: u64,
) -> Result<BlockFactors, MethodError> {
    let limit = limit(means, config, tolerance);
    let mean = Fitted { method: config.method, matrix: matrix_of(&means.mean), seed };
    let rank = match tolerance {
        Tolerance::Rank(_) => limit,
        _ => mean.least_rank(limit, allowed(means, tolerance) * means.n_entries())?,
    };
    let mut factors = mean.packed(rank, means.unit)?;
    let [a, b] = [&means.a, &means.b].map(|half| Fitted { matrix: matrix_of(half), ..mean });
    let [of_a, of_b] = [&a, &b].map(|half| Ok(half.packed(rank, 1.0)?.dense()));
    let [truncation, sampling] = errors([&means.a, &means.b], [of_a?, of_b?]).map(|sum| sum / means.n_entries());
    let [truncation, sampling, noise] =
        [truncation, sampling, means.noise_per_entry()].map(|x| told(x * means.unit * means.unit));
    factors.error = BlockError { truncation, sampling, noise };
    Ok(factors)
}

/// `⟨A − F, B − G⟩` and `¼ ‖F − G‖²`, as for our own factors: noise enters no product with itself.
fn errors([a, b]: [&Dense<f32>; 2], [f, g]: [Vec<f32>; 2]) -> [f64; 2] {
    let mut sums = [0.0; 2];
    for ((a, f), (b, g)) in a.data.iter().zip(&f).zip(b.data.iter().zip(&g)) {
        let [a, b, f, g] = [a, b, f, g].map(|&x| f64::from(x));
        sums[0] += (a - f) * (b - g);
        sums[1] += 0.25 * (f - g) * (f - g);
    }
    sums
}

/// A mean square in range: the greatest that there is where a method went astray.
fn told(mean_square: f64) -> f32 {
    if mean_square.is_nan() { f32::MAX } else { mean_square.clamp(f64::from(f32::MIN), f64::from(f32::MAX)) as f32 }
}

/// A matrix and how it is approximated.
struct Fitted {
    method: Method,
    matrix: DMatrix<f32>,
    seed: u64,
}

type Factors = (DMatrix<f32>, DMatrix<f32>);

impl Fitted {
    fn at(&self, rank: usize) -> Result<Factors, MethodError> {
        Ok(approximate(self.method, &self.matrix, rank, self.seed)?.into_factors())
    }

    fn packed(&self, rank: usize, unit: f64) -> Result<BlockFactors, MethodError> {
        let (left, right) = self.at(rank)?;
        let row_major = |factor: &DMatrix<f32>, unit: f64| -> Vec<f32> {
            factor.transpose().iter().map(|&x| (f64::from(x) * unit) as f32).collect()
        };
        let (n_rows, n_cols) = self.matrix.shape();
        Ok(BlockFactors::from_f32(&row_major(&left, unit), &row_major(&right, 1.0), n_rows, n_cols, left.ncols()))
    }

    /// The least rank that leaves no more energy than the goal; where none up to the limit does, the best of those tried.
    fn least_rank(&self, limit: usize, goal: f64) -> Result<usize, MethodError> {
        // What one call finds for all ranks at once is cut off instead of found again.
        let nested = matches!(self.method, Method::Svd | Method::AcaFull | Method::AcaPartial);
        let all = if nested { Some(self.at(limit)?) } else { None };
        let mut failure = None;
        let mut left_at = |rank: usize| match &all {
            Some((left, right)) => {
                let rank = rank.min(left.ncols());
                self.rest(&left.columns(0, rank).into_owned(), &right.rows(0, rank).into_owned())
            }
            None => match self.at(rank) {
                Ok((left, right)) => self.rest(&left, &right),
                Err(error) => {
                    failure = Some(error);
                    f64::INFINITY
                }
            },
        };
        let nothing = left_at(0);
        if nothing <= goal || limit == 0 {
            return Ok(0);
        }
        let (mut below, mut rank, mut best) = (0, 1, (f64::INFINITY, 0));
        loop {
            let left = left_at(rank);
            if left < best.0 {
                best = (left, rank);
            }
            if left <= goal {
                break;
            }
            if rank == limit {
                // A method without an answer is no method for this block; it is not passed off as a block of zeros.
                return failure.filter(|_| best.1 == 0).map_or(Ok(best.1), Err);
            }
            below = rank;
            rank = (2 * rank).min(limit);
        }
        while rank - below > 1 {
            let middle = rank.midpoint(below);
            if left_at(middle) <= goal { rank = middle } else { below = middle }
        }
        Ok(rank)
    }

    /// Energy of what factors leave; infinite if they are not finite.
    fn rest(&self, left: &DMatrix<f32>, right: &DMatrix<f32>) -> f64 {
        let found = left * right;
        let square = |(x, y): (&f32, &f32)| (f64::from(*x) - f64::from(*y)).powi(2);
        let sum: f64 = self.matrix.iter().zip(&found).map(square).sum();
        if sum.is_finite() { sum } else { f64::INFINITY }
    }
}

fn matrix_of(dense: &Dense<f32>) -> DMatrix<f32> {
    DMatrix::from_row_slice(dense.n_rows, dense.n_cols, &dense.data)
}
