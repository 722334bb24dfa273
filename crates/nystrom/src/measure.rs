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

use crate::{dense::Dense, means::Means, product::product};

/// Mean square of the rounding of both factors to the eleven bits of `f16`, relative to the kept energy.
const PACKING: f64 = 2.2e-8;
/// Relative energy that single precision cannot tell from zero.
const ROUNDING: f64 = 1e-6;

/// An orthonormal right basis, and both halves' coefficients in it.
pub(crate) struct Fit {
    /// Components × columns.
    pub(crate) basis: Dense<f32>,
    /// First half, rows × components.
    pub(crate) a: Dense<f32>,
    /// Second half, rows × components.
    pub(crate) b: Dense<f32>,
}

impl Fit {
    /// Mean of both halves' coefficients.
    pub(crate) fn mean(&self) -> Dense<f32> {
        let data = self.a.data.iter().zip(&self.b.data).map(|(x, y)| 0.5 * (x + y)).collect();
        Dense { data, ..self.a }
    }

    /// Keeps at most `count` components: those that a single half made up come last. Returns how many are left.
    pub(crate) fn keep(&mut self, count: usize) -> usize {
        let (shared, [own_a, own_b]) = (self.shared(), self.own());
        let one_sided = |r: usize| {
            let difference = 0.25 * (own_a[r] + own_b[r] - 2.0 * shared[r]);
            difference > shared[r]
        };
        let mut order = front(self.basis.n_rows, |r| !one_sided(r));
        order.truncate(count);
        self.reorder(&order);
        order.len()
    }

    fn reorder(&mut self, order: &[usize]) {
        self.basis = self.basis.gather_rows(order.iter().copied());
        [&mut self.a, &mut self.b].into_iter().for_each(|half| *half = half.gather_cols(order));
    }

    /// ⟨A v, B v⟩ of each component v.
    fn shared(&self) -> Vec<f64> {
        products_by_column(&self.a, &self.b)
    }

    /// ‖A v‖² and ‖B v‖² of each component v.
    fn own(&self) -> [Vec<f64>; 2] {
        [&self.a, &self.b].map(|half| products_by_column(half, half))
    }
}

/// What the two independent fits tell about the factors of their mean.
pub(crate) struct Measured {
    /// Components that are kept.
    pub(crate) rank: usize,
    /// Mean square per entry that the rank leaves out.
    pub(crate) truncation: f64,
    /// Mean square per entry of the noise that stays.
    pub(crate) sampling: f64,
}

impl Measured {
    /// The components that pay, at most `limit`; with a goal no more than bring the truncation within half of it.
    pub(crate) fn new(means: &Means, of_a: &Fit, of_b: &Fit, limit: usize, goal: Option<f64>) -> Self {
        let agreement = least_agreement(means);
        let (own_a, own_b) = (&of_a.own()[0], &of_b.own()[1]);
        let (shared_a, shared_b) = (of_a.shared(), of_b.shared());
        let order_a = front(own_a.len(), |r| shared_a[r] > agreement * own_a[r]);
        let order_b = front(own_b.len(), |r| shared_b[r] > agreement * own_b[r]);
        let pays = |shared: &[f64], own: &[f64]| {
            let count = shared.iter().zip(own).filter(|(shared, own)| **shared > agreement * **own).count();
            // The first is kept whenever it is there at all, so that doubt never empties a block.
            count.max(usize::from(shared.iter().any(|shared| *shared > 0.0)))
        };
        let mut rank = pays(&shared_a, own_a).max(pays(&shared_b, own_b)).min(limit);
        // ⟨component r of A's fit, component s of B's fit⟩
        let between = {
            let left = product(of_a.a.to_f64().t(), of_b.b.to_f64().view());
            let right = product(of_a.basis.to_f64().view(), of_b.basis.to_f64().t());
            Dense { data: left.data.iter().zip(&right.data).map(|(x, y)| x * y).collect(), ..left }
        };
        let energy: f64 = means.cross.iter().sum();
        let sum =
            |order: &[usize], values: &[f64], rank: usize| order.iter().take(rank).map(|&r| values[r]).sum::<f64>();
        let common = |rank: usize| -> f64 {
            let pairs = order_a.iter().take(rank).flat_map(|&r| order_b.iter().take(rank).map(move |&s| (r, s)));
            pairs.map(|(r, s)| between.row(r)[s]).sum()
        };
        let truncation = |rank: usize| {
            let rest = energy - sum(&order_a, &shared_a, rank) - sum(&order_b, &shared_b, rank) + common(rank);
            if rest.abs() < ROUNDING * energy.abs() { 0.0 } else { rest }
        };
        let half_of_goal = goal.map(|goal| 0.5 * goal * means.n_entries());
        while rank > 0 && half_of_goal.is_some_and(|half| truncation(rank - 1) <= half) {
            rank -= 1;
        }
        let fitted = sum(&order_a, own_a, rank) + sum(&order_b, own_b, rank);
        let difference = 0.25 * (fitted - 2.0 * common(rank));
        let sampling = if difference < ROUNDING * 0.25 * fitted { 0.0 } else { difference };
        let per_entry = 1.0 / means.n_entries();
        let truncation = (truncation(rank) + PACKING * 0.5 * fitted) * per_entry;
        Self { rank, truncation, sampling: sampling * per_entry }
    }
}

/// Share of a half's component that the other half must confirm for it to pay in the mean of both.
///
/// In white noise of variance s per entry, a component of singular value x pays from `x² = y·m·s` on, where y follows from
/// the optimal hard threshold \[Gavish2014\] and m is the greater side. The halves have twice the noise, so y is half as great
/// in them, and the expected share is `(y² − β) / ((y + 1)(y + β))` with β = smaller / greater side: a third for
/// a matrix of few columns, 0.2 for a square one.
pub(crate) fn least_agreement(means: &Means) -> f64 {
    let (m, n) = (means.mean.n_rows as f64, means.mean.n_cols as f64);
    let beta = m.min(n) / m.max(n);
    let sum = beta + 1.0;
    let threshold = 2.0 * sum + 8.0 * beta / (sum + (beta * beta + 14.0 * beta + 1.0).sqrt());
    let excess = threshold - sum;
    let y = 0.25 * (excess + (excess * excess - 4.0 * beta).sqrt());
    (y * y - beta) / ((y + 1.0) * (y + beta))
}

/// Indices below `count`, those that fulfill a condition first; their order is kept otherwise.
fn front(count: usize, is_first: impl Fn(usize) -> bool) -> Vec<usize> {
    let (mut order, rest): (Vec<usize>, Vec<usize>) = (0..count).partition(|&r| is_first(r));
    order.extend(rest);
    order
}

fn products_by_column(x: &Dense<f32>, y: &Dense<f32>) -> Vec<f64> {
    let mut sums = vec![0.0; x.n_cols];
    for row in 0..x.n_rows {
        for (sum, (x, y)) in sums.iter_mut().zip(x.row(row).iter().zip(y.row(row))) {
            *sum += f64::from(*x) * f64::from(*y);
        }
    }
    sums
}
