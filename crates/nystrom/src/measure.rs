//! How many components pay, and how far the factors are from the truth.
//!
//! Each half is fitted by itself: `F = A·V·Vᵀ` with V of A alone, `G = B·W·Wᵀ` with W of B alone, both of the rank that the
//! factors keep. What a fit misses is then held against what the other, independent one misses:
//!
//! ```text
//! truncation = ⟨A − F, B − G⟩    sampling = ¼ ‖F − G‖²    truncation + sampling = mean ‖T − (F + G)/2‖²
//! ```
//! The first has the expectation ‖T − mean F‖² (what is lost whatever the noise does), the second is the variance of (F + G)/2,
//! noise that turned the bases included; the third holds for noise of any kind, because noise enters no product with itself.
//! The factors themselves are fitted to the mean of both halves. To first order in the noise they equal (F + G)/2; components
//! so weak that one half does not find them are found better in the mean, so the figure errs on the cautious side.

use crate::{
    dense::Dense,
    fit::{Fit, front},
    means::Means,
    product::product,
};

/// Mean square of the rounding of both factors to the eleven bits of `f16`, relative to the kept energy: of each a twelfth of
/// the squared step, 2⁻¹⁰, over the mean square of numbers from 1 to 2.
pub(crate) const PACKING: f64 = 6.8e-8;
/// Share of what is there up to which a difference of energies in single precision has hardly a digit left.
pub(crate) const ROUNDING: f64 = 1e-6;

/// What the two independent fits tell about the factors of their mean.
pub(crate) struct Measured {
    /// Components that are kept.
    pub(crate) rank: usize,
    /// Mean square per entry that the rank leaves out.
    pub(crate) truncation: f64,
    /// Mean square per entry of the noise that stays.
    pub(crate) sampling: f64,
    /// Mean square per entry of the rounding of packed factors.
    pub(crate) packing: f64,
}

/// What two fits have in common, component by component, each in the order in which it keeps them.
struct Pair<'a> {
    /// Whether both fits are one and the same, see [`Means::is_exact`].
    is_one: bool,
    fits: [&'a Fit; 2],
    /// Those first that the other half confirms.
    orders: [Vec<usize>; 2],
    /// ⟨A v, B v⟩ of each component.
    shared: [Vec<f64>; 2],
    /// Energy of each component.
    own: [Vec<f64>; 2],
    /// ⟨component of A's fit, component of B's fit⟩
    between: Dense<f64>,
}

impl Measured {
    /// The components that pay, at most `limit`; with a goal no more than bring the truncation within half of it.
    pub(crate) fn new(means: &Means, of_a: &Fit, of_b: &Fit, limit: usize, goal: Option<f64>) -> Self {
        let agreement = least_agreement(means, of_a.n_landmarks);
        let pair = Pair::new(means, of_a, of_b, agreement);
        let mut rank = pair.n_confirmed(agreement).min(limit);
        let left_out = pair.left_out(means);
        let half_of_goal = goal.map(|goal| 0.5 * goal * means.n_entries());
        while rank > 0 && half_of_goal.is_some_and(|half| left_out(rank - 1) <= half) {
            rank -= 1;
        }
        let fitted = pair.fitted(rank);
        let per_entry = 1.0 / means.n_entries();
        Self {
            rank,
            truncation: left_out(rank) * per_entry,
            sampling: 0.25 * pair.difference(rank, fitted) * per_entry,
            packing: PACKING * 0.5 * fitted * per_entry,
        }
    }
}

/// `⟨A − F, B − G⟩` and `¼ ‖F − G‖²`, entry by entry, so that F and G may be fits to something else than A and B.
pub(crate) fn held_out([a, b]: [&Dense<f32>; 2], [f, g]: &[Dense<f32>; 2]) -> [f64; 2] {
    let mut sums = [0.0; 2];
    for row in 0..a.n_rows {
        let rows = a.row(row).iter().zip(b.row(row)).zip(f.row(row).iter().zip(g.row(row)));
        for ((a, b), (f, g)) in rows {
            sums[0] += f64::from((a - f) * (b - g));
            sums[1] += 0.25 * f64::from((f - g) * (f - g));
        }
    }
    sums
}

impl<'a> Pair<'a> {
    fn new(means: &Means, of_a: &'a Fit, of_b: &'a Fit, agreement: f64) -> Self {
        let left = product(of_a.a.to_f64().t(), of_b.b.to_f64().view());
        let right = product(of_a.basis.to_f64().view(), of_b.basis.to_f64().t());
        let between = Dense { data: left.data.iter().zip(&right.data).map(|(x, y)| x * y).collect(), ..left };
        let ([own_a, _], [_, own_b]) = (of_a.own(), of_b.own());
        let (shared, own) = ([of_a.shared(), of_b.shared()], [own_a, own_b]);
        let orders = [0, 1].map(|i| front(own[i].len(), |r| shared[i][r] > agreement * own[i][r]));
        Self { is_one: means.is_exact(), fits: [of_a, of_b], orders, shared, own, between }
    }

    /// How many components of either half the other one confirms.
    fn n_confirmed(&self, agreement: f64) -> usize {
        let count = |i: usize| {
            let confirmed = |(shared, own): &(&f64, &f64)| **shared > agreement * **own;
            let count = self.shared[i].iter().zip(&self.own[i]).filter(confirmed).count();
            // The first is kept whenever it is there at all, so that doubt never empties a block.
            count.max(usize::from(self.shared[i].iter().any(|shared| *shared > 0.0)))
        };
        count(0).max(count(1))
    }

    fn width(&self) -> usize {
        self.orders[0].len().max(self.orders[1].len())
    }

    /// One value of the component that a fit keeps as its r-th; 0 if it has fewer.
    fn nth(&self, values: &[Vec<f64>; 2], fit: usize, r: usize) -> f64 {
        self.orders[fit].get(r).map_or(0.0, |&at| values[fit][at])
    }

    fn between(&self, r: usize, s: usize) -> f64 {
        let at = self.orders[0].get(r).zip(self.orders[1].get(s));
        at.map_or(0.0, |(&r, &s)| self.between.row(r)[s])
    }

    /// ⟨A − F, B − G⟩ by rank. It is summed from the last component down: what the first hold would swallow it.
    fn left_out(&self, means: &Means) -> impl Fn(usize) -> f64 + use<> {
        let width = self.width();
        let mut sums = vec![0.0; width + 1];
        for r in (0..width).rev() {
            let others: f64 = (0..r).map(|s| self.between(r, s) + self.between(s, r)).sum();
            let own = self.nth(&self.shared, 0, r) + self.nth(&self.shared, 1, r);
            sums[r] = sums[r + 1] + own - self.between(r, r) - others;
        }
        let energy: f64 = means.cross.iter().sum();
        let mut outside = energy - sums[0];
        if outside.abs() < ROUNDING * energy.abs() {
            let rest_a = minus(&means.a, &self.fit(0, width));
            let rest_b = (!self.is_one).then(|| minus(&means.b, &self.fit(1, width)));
            outside = rest_a.inner_product(rest_b.as_ref().unwrap_or(&rest_a));
        }
        move |rank| outside + sums[rank.min(width)]
    }

    /// ‖F‖² + ‖G‖² of a rank.
    fn fitted(&self, rank: usize) -> f64 {
        (0..rank).map(|r| self.nth(&self.own, 0, r) + self.nth(&self.own, 1, r)).sum()
    }

    /// ‖F − G‖² of a rank; `fitted` is ‖F‖² + ‖G‖².
    fn difference(&self, rank: usize, fitted: f64) -> f64 {
        if self.is_one {
            return 0.0;
        }
        let common: f64 = (0..rank).flat_map(|r| (0..rank).map(move |s| (r, s))).map(|(r, s)| self.between(r, s)).sum();
        let difference = fitted - 2.0 * common;
        if difference.abs() >= ROUNDING * fitted {
            return difference;
        }
        let rest = minus(&self.fit(0, rank), &self.fit(1, rank));
        rest.inner_product(&rest)
    }

    /// F or G of a rank, entry by entry.
    fn fit(&self, i: usize, rank: usize) -> Dense<f32> {
        let order = &self.orders[i][..rank.min(self.orders[i].len())];
        let left = [&self.fits[0].a, &self.fits[1].b][i].gather_cols(order);
        product(left.view(), self.fits[i].basis.gather_rows(order.iter().copied()).view())
    }
}

fn minus(x: &Dense<f32>, y: &Dense<f32>) -> Dense<f32> {
    Dense { data: x.data.iter().zip(&y.data).map(|(x, y)| x - y).collect(), ..*x }
}

/// Share of a half's component that the other half must confirm for it to pay in the mean of both.
///
/// In white noise of variance s per entry, a component of singular value x pays from `x² = y·m·s` on, where y follows from
/// the optimal hard threshold \[Gavish2014\] and m is the greater side. The halves have twice the noise, so y is half as great
/// in them, and the expected share is `(y² − β) / ((y + 1)(y + β))` with β = smaller / greater side: a third for
/// a matrix of few columns, 0.2 for a square one.
///
/// Landmarks are rows of the mean, so bases that begin in their span know something of both halves. Of n columns of noise, a
/// combination of L landmark rows can be chosen that agrees with the other half's by a share in proportion to √(L/n), and it makes up
/// n in m + n of the component's energy: half of their product has to be confirmed beyond the threshold (without it, noise of
/// 96 × 64 entries passed for a second component in some seeds; with all of it, weak components of 768 × 256 were missed).
pub(crate) fn least_agreement(means: &Means, n_landmarks: usize) -> f64 {
    let (m, n) = (means.mean.n_rows as f64, means.mean.n_cols as f64);
    let beta = m.min(n) / m.max(n);
    let sum = beta + 1.0;
    let threshold = 2.0 * sum + 8.0 * beta / (sum + (beta * beta + 14.0 * beta + 1.0).sqrt());
    let excess = threshold - sum;
    let y = 0.25 * (excess + (excess * excess - 4.0 * beta).sqrt());
    let known = 0.5 * (n_landmarks as f64 * n).sqrt() / (m + n);
    (y * y - beta) / ((y + 1.0) * (y + beta)) + known
}
