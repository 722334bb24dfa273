//! The landmark rows' span: how many landmarks a block needs, and what all rows are in that span.

use crate::{
    compress::{CompressConfig, Tolerance},
    dense::Dense,
    growth::Growth,
    means::Means,
    random::Random,
};

/// Landmark bundles of the first round; each further round doubles them.
const N_FIRST: usize = 4;
/// Rank that is enough without landmarks: smaller matrices are decomposed as they are.
const SMALL: usize = 24;

/// Share of what was left before above which it falls slowly.
const SLOW: f64 = 0.97;
/// How many times what more landmarks would not tell is more than noise and rounding, however slowly it falls.
const FAR: f64 = 10.0;

/// How often missed bundles are added after each choice by k-means.
const N_MISSED_ROUNDS: usize = 4;

/// What a block is decomposed from.
pub(crate) enum Sketch {
    /// Coefficients of all rows of each half in the landmarks' span, rows × basis.
    Landmarks { a: Dense<f32>, b: Dense<f32> },
    /// All columns: few columns, or landmarks that would be most of the block.
    Columns,
    /// All rows: fewer of them than columns.
    Rows,
}

impl Sketch {
    /// Dimensions of the span that both halves begin in; 0 if each begins in its own.
    pub(crate) fn n_landmarks(&self) -> usize {
        if let Sketch::Landmarks { a, .. } = self { a.n_cols } else { 0 }
    }
}

/// Mean-square goal of a block in the scaled units of [`Means`].
pub(crate) fn allowed(means: &Means, tolerance: Tolerance) -> f64 {
    match tolerance {
        Tolerance::AbsoluteMeanSquare(allowed) => f64::from(allowed) / (means.unit * means.unit),
        Tolerance::RelativeFrobenius(relative) => {
            let energy: f64 = means.cross.iter().sum();
            f64::from(relative) * f64::from(relative) * energy.max(0.0) / means.n_entries()
        }
        Tolerance::Rank(_) => 0.0,
    }
}

/// The greatest rank that may be kept.
pub(crate) fn rank_limit(config: &CompressConfig, tolerance: Tolerance) -> usize {
    match tolerance {
        Tolerance::Rank(rank) => rank.min(config.max_rank) as usize,
        _ => config.max_rank as usize,
    }
}

/// Landmarks are added until what they leave of the other rows is within the truncation share of the tolerance.
///
/// Each round is the papers' alternation, then what it missed. What is left is the product of both halves' rests, so noise
/// does not count. It is found by subtracting what landmarks tell; where hardly a digit of that is left, by measuring it.
/// What falls slowly near the noise is noise; far above it the spectrum is flat, and there is more to be found.
pub(crate) fn sketch(
    means: &Means,
    bundle_len: usize,
    tolerance: Tolerance,
    config: &CompressConfig,
    rng: &mut Random,
) -> Sketch {
    let (n_rows, n_cols) = (means.mean.n_rows, means.mean.n_cols);
    let whole = if n_cols <= n_rows { Sketch::Columns } else { Sketch::Rows };
    if n_cols.min(n_rows) <= SMALL {
        return whole;
    }
    let mut growth = Growth::new(means, bundle_len);
    let goal = 0.5 * allowed(means, tolerance) * n_cols as f64;
    let widest = 2 * rank_limit(config, tolerance) + SMALL;
    let mut target = N_FIRST;
    loop {
        if 2 * target * bundle_len > n_rows || target * bundle_len >= n_cols {
            return whole;
        }
        let before = growth.rest();
        let grown = growth.add_by_means(if target == N_FIRST { target } else { target / 2 }, config, rng);
        (0..N_MISSED_ROUNDS).take_while(|_| growth.add_missed(goal)).for_each(drop);
        let enough = goal * growth.n_others() as f64;
        let rest = growth.known_rest(enough);
        let least = if rest <= enough { f64::INFINITY } else { growth.least_rest() };
        let stuck = target > N_FIRST && rest > SLOW * before && rest <= FAR * least;
        if !grown || rest <= least || stuck || growth.basis.n_rows >= widest {
            return growth.finish();
        }
        target *= 2;
    }
}
