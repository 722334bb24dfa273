//! The projected core: from the landmarks' span to `left · right`, with a rank that both halves vouch for.
//!
//! The landmark rows only say where to look. Their span V is met with all rows of both halves (coefficients M·Vᵀ, never an
//! inverse of the intersection W); one further step from these coefficients back to the columns gives each half its own
//! leading singular vectors, as in a randomized decomposition \[Halko2011\]. A component of one half is kept only while the
//! *other*, independent half confirms it; the mean of both halves has half the variance, so a component pays as soon as its
//! squared signal exceeds half of its noise: `3 · uᵀ B v > σ`.

use std::ops::Range;

use crate::{
    compress::{CompressConfig, Tolerance},
    dense::{Dense, eigen, product},
    factors::{BlockError, BlockFactors},
    means::Means,
    random::Random,
    sketch::{Sketch, allowed, rank_limit, sketch},
    split::Split,
};

/// Components that the refinement may carry beyond those confirmed so far.
const OVERSAMPLING: usize = 4;

/// Would more samples bring a block closer to its tolerance?
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// The tolerance is met (or rank alone is in the way).
    Enough,
    /// Noise is in the way.
    MoreSamples,
}

/// Compresses one group of columns of a block.
pub(crate) fn factor(
    means: &Means,
    bundle_len: usize,
    tolerance: Tolerance,
    config: &CompressConfig,
    mut rng: Random,
) -> (BlockFactors, Verdict) {
    let (n_rows, n_cols) = (means.mean.n_rows, means.mean.n_cols);
    let split = Split::new(n_rows / bundle_len, bundle_len, config.held_out, &mut rng);
    let limit = rank_limit(config, tolerance).min(n_rows).min(n_cols);
    let goal = allowed(means, tolerance);
    let basis = if means.mean.data.iter().all(|&x| x == 0.0) || limit == 0 {
        Dense::zeros(0, n_cols)
    } else {
        let sketch = sketch(means, &split, bundle_len, tolerance, config, &mut rng);
        basis(means, &split, &sketch, goal, limit)
    };
    let kept = Kept::new(means, &split, &basis, goal, tolerance);
    let right = &basis.data[..kept.rank * n_cols];
    let mut left = kept.mean.data.clone();
    left.iter_mut().for_each(|x| *x = (f64::from(*x) * means.unit) as f32);
    let mut factors = BlockFactors::from_f32(&left, right, n_rows, n_cols, kept.rank);
    factors.error = kept.error(means, &split, &basis, &factors);
    (factors, kept.verdict(means, goal, tolerance, limit))
}

/// Orthonormal right basis of the mean, at most as many rows as both halves confirm, largest component first.
fn basis(means: &Means, split: &Split, sketch: &Sketch, goal: f64, limit: usize) -> Dense<f32> {
    // Row-side ranges of each half and of the mean, then each range met with both halves.
    let (of_a, of_b, of_mean) = match sketch {
        Sketch::Rows => {
            let [a, b, mean] = [&means.a, &means.b, &means.mean].map(|m| m.gather_rows(split.training_rows()));
            ((a.clone(), b.clone()), (b, a), mean)
        }
        Sketch::Columns => refined(means, split, &means.a, &means.b, &split.is_training, goal, limit),
        Sketch::Landmarks { a, b, is_other } => refined(means, split, a, b, is_other, goal, limit),
    };
    let confirmed = confirmed_by_rows(&of_a.0, &of_a.1).max(confirmed_by_rows(&of_b.0, &of_b.1));
    let (values, vectors) = eigen(&product(of_mean.to_f64().view(), of_mean.to_f64().t()));
    let rank = confirmed.min(limit).min(values.len());
    let mut basis = product(vectors.first_cols(rank).t(), of_mean.to_f64().view());
    for (r, value) in values.iter().enumerate().take(rank) {
        basis.row_mut(r).iter_mut().for_each(|x| *x /= value.sqrt());
    }
    basis.to_f32()
}

/// What a range of one half makes of both halves: (own, other), each range × columns.
type Pair = (Dense<f32>, Dense<f32>);

/// One step back from the coefficients of all rows to the columns: `Uᵀ A` and `Uᵀ B` for the range of A, the same for B,
/// and the mean's own.
fn refined(
    means: &Means,
    split: &Split,
    a: &Dense<f32>,
    b: &Dense<f32>,
    is_judge: &[bool],
    goal: f64,
    limit: usize,
) -> (Pair, Pair, Dense<f32>) {
    // Landmark rows chose the span and would confirm their own noise: they do not judge.
    let n_entries = is_judge.iter().filter(|judge| **judge).count() * means.mean.n_cols;
    let [judging_a, judging_b] = [a, b].map(|half| half.masked(is_judge).to_f64());
    let cross = product(judging_a.t(), judging_b.view());
    let [half_a, half_b] = [&judging_a, &judging_b].map(|half| eigen(&product(half.t(), half.view())));
    let worth = |(values, vectors): &(Vec<f64>, Dense<f64>)| {
        let signals = signals(values, vectors, &cross);
        let mut left: f64 = signals.iter().map(|s| s.1.max(0.0).powi(2)).sum();
        let enough = signals.iter().position(|signal| {
            let within = left <= 0.125 * goal * n_entries as f64;
            left -= signal.1.max(0.0).powi(2);
            within
        });
        confirmed(&signals).min(enough.unwrap_or(signals.len()))
    };
    let width = (worth(&half_a).max(worth(&half_b)) + OVERSAMPLING).min(limit + OVERSAMPLING);
    let mut mean = a.masked(&split.is_training).to_f64();
    mean.data.iter_mut().zip(&b.masked(&split.is_training).data).for_each(|(x, &y)| *x = 0.5 * (*x + f64::from(y)));
    let ranges = [
        range(&judging_a, &half_a, width),
        range(&judging_b, &half_b, width),
        range(&mean, &eigen(&product(mean.t(), mean.view())), width),
    ];
    // All three ranges meet a half at once: reading it is what costs.
    let together = Dense::side_by_side(&ranges, means.mean.n_rows);
    let [with_a, with_b] = [&means.a, &means.b].map(|half| product(together.t(), half.view()));
    let (first, second) = (ranges[0].n_cols, ranges[0].n_cols + ranges[1].n_cols);
    let rows = |of: &Dense<f32>, rows: Range<usize>| of.gather_rows(rows);
    let mut of_mean = rows(&with_a, second..with_a.n_rows);
    of_mean.data.iter_mut().zip(&with_b.data[second * with_b.n_cols..]).for_each(|(x, y)| *x = 0.5 * (*x + y));
    let of_a = (rows(&with_a, 0..first), rows(&with_b, 0..first));
    let of_b = (rows(&with_b, first..second), rows(&with_a, first..second));
    (of_a, of_b, of_mean)
}

/// Leading left singular vectors, rows × at most `width`.
fn range(coefficients: &Dense<f64>, (values, vectors): &(Vec<f64>, Dense<f64>), width: usize) -> Dense<f32> {
    let mut range = product(coefficients.view(), vectors.first_cols(width).view());
    for row in 0..range.n_rows {
        range.row_mut(row).iter_mut().zip(values).for_each(|(x, value)| *x /= value.sqrt());
    }
    range.to_f32()
}

/// (σ, uᵀ B v) of each component of A, from the eigenvectors of A's Gram matrix and the Gram matrix between A and B.
fn signals(values: &[f64], vectors: &Dense<f64>, cross: &Dense<f64>) -> Vec<(f64, f64)> {
    let crossed = product(cross.view(), vectors.view());
    let quadratic = |r: usize| (0..vectors.n_rows).map(|i| vectors.row(i)[r] * crossed.row(i)[r]).sum::<f64>();
    values.iter().enumerate().map(|(r, value)| (value.sqrt(), quadratic(r) / value.sqrt())).collect()
}

/// How many leading components the other half confirms. The first is kept whenever it is there at all, so that doubt never
/// empties a block.
fn confirmed(signals: &[(f64, f64)]) -> usize {
    let count = signals.iter().take_while(|(sigma, signal)| 3.0 * signal > *sigma).count();
    count.max(usize::from(signals.first().is_some_and(|(_, signal)| *signal > 0.0)))
}

/// [`confirmed`] for a range that met its own half and the other one.
fn confirmed_by_rows(own: &Dense<f32>, other: &Dense<f32>) -> usize {
    let (own, other) = (own.to_f64(), other.to_f64());
    let (values, vectors) = eigen(&product(own.view(), own.t()));
    confirmed(&signals(&values, &vectors, &product(other.view(), own.t())))
}

/// Coefficients of all rows in the basis, and the rank that is kept.
struct Kept {
    rank: usize,
    /// Mean of both halves, rows × rank.
    mean: Dense<f32>,
    /// Halves, rows × rank.
    halves: [Dense<f32>; 2],
    /// Estimate from the training rows, mean square per entry.
    truncation: f64,
    /// Noise that stays, mean square per entry, as measured.
    sampling: f64,
    /// Noise that turned the basis, mean square per entry.
    turning: f64,
}

impl Kept {
    /// Keeps the least rank whose truncation is within half of the tolerance.
    fn new(means: &Means, split: &Split, basis: &Dense<f32>, goal: f64, tolerance: Tolerance) -> Self {
        let [a, b] = [&means.a, &means.b].map(|half| product(half.view(), basis.t()));
        let n_training = split.training_rows().count() as f64;
        let n_entries = n_training * means.mean.n_cols as f64;
        // A basis of the mean's own noise hides as much of it outside as one row of noise per component.
        let turning = split.training_sum(&means.noise) / n_training;
        let total = split.training_sum(&means.cross);
        let energies: Vec<f64> = (0..basis.n_rows)
            .map(|r| split.training_rows().map(|row| f64::from(a.row(row)[r]) * f64::from(b.row(row)[r])).sum())
            .collect();
        let mut rest = total - energies.iter().sum::<f64>();
        if rest.abs() < 1e-6 * total.abs() {
            rest = 0.0;
        }
        rest += basis.n_rows as f64 * turning;
        let mut rank = basis.n_rows;
        while rank > 0 && !matches!(tolerance, Tolerance::Rank(_)) {
            let without = rest + energies[rank - 1] - turning;
            if without > 0.5 * goal * n_entries {
                break;
            }
            rest = without;
            rank -= 1;
        }
        let halves = [a.first_cols(rank), b.first_cols(rank)];
        let mut mean = halves[0].clone();
        mean.data.iter_mut().zip(&halves[1].data).for_each(|(x, y)| *x = 0.5 * (*x + y));
        let differences = halves[0].data.iter().zip(&halves[1].data).map(|(x, y)| f64::from(0.5 * (x - y)).powi(2));
        let sampling = differences.sum::<f64>() / means.n_entries();
        Self { rank, mean, sampling, truncation: rest / n_entries, turning: rank as f64 * turning / n_entries, halves }
    }

    fn verdict(&self, means: &Means, goal: f64, tolerance: Tolerance, limit: usize) -> Verdict {
        let noise = means.noise.iter().sum::<f64>() / means.n_entries();
        let sampling = self.sampling + self.turning;
        let met = match tolerance {
            Tolerance::Rank(_) => noise == 0.0,
            _ if noise <= 0.5 * goal => true,
            _ if self.rank == limit => sampling <= 0.5 * goal,
            _ => self.truncation.max(0.0) + sampling <= goal,
        };
        if met { Verdict::Enough } else { Verdict::MoreSamples }
    }

    /// What was measured, in the units of the matrix.
    fn error(&self, means: &Means, split: &Split, basis: &Dense<f32>, factors: &BlockFactors) -> BlockError {
        let noise = means.noise.iter().sum::<f64>() / means.n_entries();
        let truncation =
            if split.held_out_rows.is_empty() { self.truncation } else { self.examined(means, split, basis, factors) };
        let [truncation, sampling, noise] =
            [truncation, self.sampling, noise].map(|x| (x * means.unit * means.unit) as f32);
        BlockError { truncation, sampling, noise }
    }

    /// Mean square per entry that the packed factors miss of the held-out rows, noise aside: the product of what both halves
    /// leave outside of the basis, rounding added to both.
    fn examined(&self, means: &Means, split: &Split, basis: &Dense<f32>, factors: &BlockFactors) -> f64 {
        let n_cols = means.mean.n_cols;
        let mut packed = vec![0.0; n_cols];
        let mut sum = 0.0;
        for &row in &split.held_out_rows {
            factors.low_rank_row(row, &mut packed);
            let inside = |coefficients: &Dense<f32>, col: usize| -> f32 {
                coefficients.row(row).iter().enumerate().map(|(r, c)| c * basis.data[r * n_cols + col]).sum()
            };
            let misses = packed.iter().enumerate().map(|(col, packed)| {
                let rounding = (f64::from(*packed) / means.unit) as f32 - inside(&self.mean, col);
                let [a, b] = [(&means.a, &self.halves[0]), (&means.b, &self.halves[1])]
                    .map(|(half, coefficients)| half.row(row)[col] - inside(coefficients, col) - rounding);
                f64::from(a) * f64::from(b)
            });
            sum += misses.sum::<f64>();
        }
        sum / (split.held_out_rows.len() * n_cols) as f64
    }
}
