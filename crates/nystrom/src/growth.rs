//! Landmarks as they are found, and what they leave of the other rows.

use std::ops::Range;

use crate::{
    basis::extend_basis,
    compress::CompressConfig,
    dense::{Dense, add_scaled, dot, eigen},
    landmarks::{Candidates, choose_from},
    means::Means,
    product::{coefficients, product},
    random::Random,
    sketch::Sketch,
};

/// Share of what was there up to which subtracting in single precision tells what is left.
const ROUNDING: f64 = 2e-7;
/// Share of the block's energy that single precision does not hold.
const NOTHING: f64 = 1e-14;
/// Share of what is left that a missed bundle must hold to be added by itself.
const MISSED_SHARE: f64 = 1.0 / 32.0;
/// Missed bundles that are added at a time.
const N_MISSED: usize = 4;

/// The landmarks so far.
pub(crate) struct Growth<'a> {
    means: &'a Means,
    bundle_len: usize,
    is_other: Vec<bool>,
    pub(crate) basis: Dense<f32>,
    coefficients: [Vec<Dense<f32>>; 2],
    /// Energy of each row outside the basis: ⟨a⊥, b⊥⟩.
    rest: Vec<f64>,
    /// Energy of all rows when the rest was last measured rather than found by subtracting.
    measured: f64,
}

impl<'a> Growth<'a> {
    pub(crate) fn new(means: &'a Means, bundle_len: usize) -> Self {
        Self {
            means,
            bundle_len,
            is_other: vec![true; means.mean.n_rows],
            basis: Dense::zeros(0, means.mean.n_cols),
            coefficients: [Vec::new(), Vec::new()],
            rest: means.cross.clone(),
            measured: means.cross.iter().sum(),
        }
    }

    pub(crate) fn n_others(&self) -> usize {
        self.is_other.iter().filter(|other| **other).count()
    }

    fn sum_of_others(&self, value: impl Fn(usize) -> f64) -> f64 {
        (0..self.is_other.len()).filter(|&row| self.is_other[row]).map(value).sum()
    }

    /// Energy of the other rows outside the basis.
    pub(crate) fn rest(&self) -> f64 {
        self.sum_of_others(|row| self.rest[row])
    }

    /// The same, measured anew where subtracting left no digits of it (below zero it left none), unless it drowns in noise or so
    /// little is enough.
    pub(crate) fn known_rest(&mut self, enough: f64) -> f64 {
        let rest = self.rest();
        if rest.max(enough).max(self.noise_of_rest()) > ROUNDING * self.measured.abs() {
            return rest;
        }
        let n_rows = self.means.mean.n_rows;
        let [a, b] = [(&self.means.a, &self.coefficients[0]), (&self.means.b, &self.coefficients[1])].map(
            |(half, coefficients)| {
                let mut outside = half.clone();
                let inside = product(Dense::side_by_side(coefficients, n_rows).view(), self.basis.view());
                add_scaled(&mut outside.data, -1.0, &inside.data);
                outside
            },
        );
        self.rest = (0..n_rows).map(|row| f64::from(dot(a.row(row), b.row(row)))).collect();
        self.measured = self.rest.iter().sum();
        self.rest()
    }

    /// What more landmarks would not tell: nothing, the spread of the product of two independent noises, and the share of
    /// each component that the landmarks' own noise turns out of the span (the refinement turns it back; weak components
    /// lose more than the mean one, hence the factor).
    pub(crate) fn least_rest(&self) -> f64 {
        let noise = self.sum_of_others(|row| self.means.noise[row]);
        let turned = if noise > 0.0 { self.n_components() as f64 * noise / self.basis.n_rows as f64 } else { 0.0 };
        (NOTHING * self.means.cross.iter().sum::<f64>()).max(self.noise_of_rest()).max(3.0 * turned)
    }

    /// Two standard deviations of the product of two independent noises.
    fn noise_of_rest(&self) -> f64 {
        let n_cols = self.means.mean.n_cols as f64;
        2.0 * self.sum_of_others(|row| (2.0 * self.means.noise[row]).powi(2) / n_cols).sqrt()
    }

    /// Components in the span that stand out of the noise.
    fn n_components(&self) -> usize {
        let n_rows = self.means.mean.n_rows;
        let [a, b] =
            self.coefficients.each_ref().map(|parts| Dense::side_by_side(parts, n_rows).masked(&self.is_other));
        let noise: f64 = a.data.iter().zip(&b.data).map(|(x, y)| f64::from(0.5 * (x - y)).powi(2)).sum();
        let mean = a.mean_with(&b).to_f64();
        let floor = 3.0 * noise / self.basis.n_rows as f64;
        eigen(&product(mean.t(), mean.view())).0.iter().filter(|value| **value > floor).count()
    }

    /// Adds `count` landmarks by k-means; false if there is nothing to add.
    pub(crate) fn add_by_means(&mut self, count: usize, config: &CompressConfig, rng: &mut Random) -> bool {
        let bundles = self.other_bundles();
        let weights: Vec<f32> = bundles.iter().map(|&bundle| self.weight(bundle)).collect();
        let mean = &self.means.mean;
        let candidates = Candidates {
            values: &mean.data,
            n_cols: mean.n_cols,
            bundle_len: self.bundle_len,
            bundles: &bundles,
            weights: &weights,
        };
        let n_columns = 16.max(count).min(mean.n_cols);
        let chosen = choose_from(&candidates, config.selection, count, n_columns, rng).bundles;
        self.add(chosen)
    }

    /// Adds the bundles of which most is left, if that is more than their noise and more than the tolerance leaves to all:
    /// a lone odd row is found here, whatever k-means made of it. False if there is none.
    pub(crate) fn add_missed(&mut self, goal: f64) -> bool {
        let total = self.rest();
        if total <= goal * self.n_others() as f64 {
            return false;
        }
        // Four standard deviations of the product of two independent noises, but never less than the noise itself, which a
        // component of its own would keep.
        let doubt = (8.0 / (self.means.mean.n_cols as f64).sqrt()).max(1.0);
        let sum = |values: &[f64], bundle: usize| self.rows(bundle).map(|row| values[row]).sum::<f64>();
        let mut missed: Vec<(f64, usize)> = self.other_bundles().into_iter().map(|b| (sum(&self.rest, b), b)).collect();
        let stands_out =
            |rest: f64, bundle| rest > MISSED_SHARE * total.abs() && rest > doubt * sum(&self.means.noise, bundle);
        missed.retain(|&(rest, bundle)| stands_out(rest, bundle));
        missed.sort_by(|x, y| y.0.total_cmp(&x.0).then(x.1.cmp(&y.1)));
        self.add(missed.into_iter().take(N_MISSED).map(|(_, bundle)| bundle).collect())
    }

    fn rows(&self, bundle: usize) -> Range<usize> {
        bundle * self.bundle_len..(bundle + 1) * self.bundle_len
    }

    /// Bundles that are no landmark.
    fn other_bundles(&self) -> Vec<usize> {
        (0..self.is_other.len() / self.bundle_len).filter(|bundle| self.is_other[bundle * self.bundle_len]).collect()
    }

    /// Adds landmarks; false if they add nothing to the span.
    fn add(&mut self, chosen: Vec<usize>) -> bool {
        let n_before = self.basis.n_rows;
        let rows: Vec<usize> = chosen.iter().flat_map(|&bundle| self.rows(bundle)).collect();
        rows.iter().for_each(|&row| self.is_other[row] = false);
        extend_basis(&mut self.basis, self.means.mean.gather_rows(rows.into_iter()));
        self.project(n_before);
        self.basis.n_rows > n_before
    }

    /// Chance of a bundle: all alike at first, then what the basis leaves of it.
    fn weight(&self, bundle: usize) -> f32 {
        let rows = self.rows(bundle);
        if self.basis.n_rows == 0 {
            let empty = rows.clone().all(|row| self.means.mean.row(row).iter().all(|&x| x == 0.0));
            return if empty { 0.0 } else { 1.0 };
        }
        rows.map(|row| self.rest[row]).sum::<f64>().max(0.0) as f32
    }

    /// Coefficients of all rows of both halves in the new part of the basis.
    fn project(&mut self, n_before: usize) {
        let new = self.basis.gather_rows(n_before..self.basis.n_rows);
        let a = coefficients(&self.means.a, &new);
        let b = if self.means.is_exact() { a.clone() } else { coefficients(&self.means.b, &new) };
        for (row, rest) in self.rest.iter_mut().enumerate() {
            *rest -= f64::from(dot(a.row(row), b.row(row)));
        }
        self.coefficients[0].push(a);
        self.coefficients[1].push(b);
    }

    pub(crate) fn finish(self) -> Sketch {
        let n_rows = self.means.mean.n_rows;
        let [a, b] = self.coefficients.map(|parts| Dense::side_by_side(&parts, n_rows));
        Sketch::Landmarks { a, b }
    }
}
