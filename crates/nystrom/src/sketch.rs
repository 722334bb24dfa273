//! The landmark rows' span: how many landmarks a block needs, and what all rows are in that span.

use crate::{
    compress::{CompressConfig, Tolerance},
    dense::{Dense, dot, eigen, extend_basis, product},
    landmarks::{Candidates, choose_from},
    means::Means,
    random::Random,
    split::Split,
};

/// Landmark bundles of the first round; each further round doubles them.
const N_FIRST: usize = 8;
/// Rank that is enough without landmarks: smaller matrices are decomposed as they are.
const SMALL: usize = 24;
/// Relative energy that single precision cannot tell from zero.
const ROUNDING: f64 = 2e-7;

/// What a block is decomposed from.
pub(crate) enum Sketch {
    /// Coefficients of all rows of each half in the landmarks' span (rows × basis); rows that are no landmark.
    Landmarks { a: Dense<f32>, b: Dense<f32>, is_other: Vec<bool> },
    /// All columns: few columns, or landmarks that would be most of the block.
    Columns,
    /// All training rows: fewer of them than columns.
    Rows,
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
/// What is left is the product of both halves' rests, so noise does not count. The held-out rows are not asked.
pub(crate) fn sketch(
    means: &Means,
    split: &Split,
    bundle_len: usize,
    tolerance: Tolerance,
    config: &CompressConfig,
    rng: &mut Random,
) -> Sketch {
    let n_cols = means.mean.n_cols;
    let whole = if n_cols <= split.training.len() * bundle_len { Sketch::Columns } else { Sketch::Rows };
    if n_cols.min(split.training.len() * bundle_len) <= SMALL {
        return whole;
    }
    let mut growth = Growth::new(means, split, bundle_len);
    let goal = 0.5 * allowed(means, tolerance) * n_cols as f64;
    let widest = 2 * rank_limit(config, tolerance) + SMALL;
    let mut target = N_FIRST;
    loop {
        if 2 * target > split.training.len() || target * bundle_len >= n_cols {
            return whole;
        }
        let before = growth.rest();
        let grown = growth.add(target, config, rng);
        let rest = growth.rest();
        let within = rest <= goal * growth.n_others() as f64 || rest <= growth.least_rest();
        let stuck = target > N_FIRST && rest > 0.97 * before;
        if !grown || within || stuck || growth.basis.n_rows >= widest {
            return growth.finish();
        }
        target *= 2;
    }
}

/// The landmarks so far.
struct Growth<'a> {
    means: &'a Means,
    split: &'a Split,
    bundle_len: usize,
    landmarks: Vec<usize>,
    is_other: Vec<bool>,
    basis: Dense<f32>,
    coefficients: [Vec<Dense<f32>>; 2],
    /// Energy of each row outside the basis: ⟨a⊥, b⊥⟩.
    rest: Vec<f64>,
}

impl<'a> Growth<'a> {
    fn new(means: &'a Means, split: &'a Split, bundle_len: usize) -> Self {
        Self {
            means,
            split,
            bundle_len,
            landmarks: Vec::new(),
            is_other: split.is_training.clone(),
            basis: Dense::zeros(0, means.mean.n_cols),
            coefficients: [Vec::new(), Vec::new()],
            rest: means.cross.clone(),
        }
    }

    fn n_others(&self) -> usize {
        self.is_other.iter().filter(|other| **other).count()
    }

    fn sum_of_others(&self, value: impl Fn(usize) -> f64) -> f64 {
        (0..self.is_other.len()).filter(|&row| self.is_other[row]).map(value).sum()
    }

    /// Energy of the other rows outside the basis.
    fn rest(&self) -> f64 {
        self.sum_of_others(|row| self.rest[row])
    }

    /// What more landmarks would not tell: rounding, the spread of the product of two independent noises, and the share of
    /// each component that the landmarks' own noise turns out of the span (the refinement turns it back; weak components
    /// lose more than the mean one, hence the factor).
    fn least_rest(&self) -> f64 {
        let n_cols = self.means.mean.n_cols as f64;
        let noise = self.sum_of_others(|row| self.means.noise[row]);
        let variance = self.sum_of_others(|row| (2.0 * self.means.noise[row]).powi(2) / n_cols);
        let turned = if noise > 0.0 { self.n_components() as f64 * noise / self.basis.n_rows as f64 } else { 0.0 };
        (ROUNDING * self.sum_of_others(|row| self.means.cross[row])).max(2.0 * variance.sqrt()).max(3.0 * turned)
    }

    /// Components in the span that stand out of the noise.
    fn n_components(&self) -> usize {
        let n_rows = self.means.mean.n_rows;
        let [mut mean, b] =
            self.coefficients.each_ref().map(|parts| Dense::side_by_side(parts, n_rows).masked(&self.is_other));
        let noise: f64 = mean.data.iter().zip(&b.data).map(|(x, y)| f64::from(0.5 * (x - y)).powi(2)).sum();
        mean.data.iter_mut().zip(&b.data).for_each(|(x, y)| *x = 0.5 * (*x + y));
        let mean = mean.to_f64();
        let floor = 3.0 * noise / self.basis.n_rows as f64;
        eigen(&product(mean.t(), mean.view())).0.iter().filter(|value| **value > floor).count()
    }

    /// Adds landmarks up to `target`; false if there is nothing to add.
    fn add(&mut self, target: usize, config: &CompressConfig, rng: &mut Random) -> bool {
        let bundles: Vec<usize> =
            self.split.training.iter().copied().filter(|bundle| !self.landmarks.contains(bundle)).collect();
        let weights: Vec<f32> = bundles.iter().map(|&bundle| self.weight(bundle)).collect();
        let mean = &self.means.mean;
        let candidates = Candidates {
            values: &mean.data,
            n_cols: mean.n_cols,
            bundle_len: self.bundle_len,
            bundles: &bundles,
            weights: &weights,
        };
        let n_columns = 16.max(target).min(mean.n_cols);
        let count = target - self.landmarks.len();
        let chosen = choose_from(&candidates, config.selection, count, n_columns, rng).bundles;
        let n_before = self.basis.n_rows;
        let rows: Vec<usize> =
            chosen.iter().flat_map(|bundle| bundle * self.bundle_len..(bundle + 1) * self.bundle_len).collect();
        rows.iter().for_each(|&row| self.is_other[row] = false);
        self.landmarks.extend(chosen);
        extend_basis(&mut self.basis, mean.gather_rows(rows.into_iter()));
        self.project(n_before);
        self.basis.n_rows > n_before
    }

    /// Chance of a bundle: all alike at first, then what the basis leaves of it.
    fn weight(&self, bundle: usize) -> f32 {
        let rows = bundle * self.bundle_len..(bundle + 1) * self.bundle_len;
        if self.landmarks.is_empty() {
            let empty = rows.clone().all(|row| self.means.mean.row(row).iter().all(|&x| x == 0.0));
            return if empty { 0.0 } else { 1.0 };
        }
        rows.map(|row| self.rest[row]).sum::<f64>().max(0.0) as f32
    }

    /// Coefficients of all rows of both halves in the new part of the basis.
    fn project(&mut self, n_before: usize) {
        let new = self.basis.gather_rows(n_before..self.basis.n_rows);
        let [a, b] = [&self.means.a, &self.means.b].map(|half| product(half.view(), new.t()));
        for (row, rest) in self.rest.iter_mut().enumerate() {
            *rest -= f64::from(dot(a.row(row), b.row(row)));
        }
        self.coefficients[0].push(a);
        self.coefficients[1].push(b);
    }

    fn finish(self) -> Sketch {
        let n_rows = self.means.mean.n_rows;
        let [a, b] = self.coefficients.map(|parts| Dense::side_by_side(&parts, n_rows));
        Sketch::Landmarks { a, b, is_other: self.is_other }
    }
}
