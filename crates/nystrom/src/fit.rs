//! Orthonormal bases, and what both halves of a block are in them.

use crate::{
    dense::{Dense, eigen},
    level::Level,
    product::product,
};

/// An orthonormal right basis, and both halves' coefficients in it.
#[derive(Clone)]
pub(crate) struct Fit {
    /// Components × columns.
    pub(crate) basis: Dense<f32>,
    /// First half, rows × components.
    pub(crate) a: Dense<f32>,
    /// Second half, rows × components.
    pub(crate) b: Dense<f32>,
    /// Landmark rows, of both halves' mean, from which the basis was found; 0 if it was found from one half alone.
    pub(crate) n_landmarks: usize,
}

impl Fit {
    /// Mean of both halves' coefficients.
    pub(crate) fn mean(&self) -> Dense<f32> {
        self.a.mean_with(&self.b)
    }

    /// Half of what the coefficients of both halves differ by: noise like that of their mean.
    pub(crate) fn doubt(&self) -> Dense<f32> {
        let data = self.a.data.iter().zip(&self.b.data).map(|(x, y)| 0.5 * (x - y)).collect();
        Dense { data, ..self.a }
    }

    /// Every entry, of one half's coefficients or other ones.
    pub(crate) fn of(&self, coefficients: &Dense<f32>) -> Dense<f32> {
        product(coefficients.view(), self.basis.view())
    }

    /// The fit of divided columns as one of the columns themselves, whose basis is orthonormal again, the largest component of the mean
    /// first.
    pub(crate) fn multiplied(&self, level: &Level) -> Fit {
        let wide = level.multiplied(&self.basis).to_f64();
        let (values, vectors) = eigen(&product(wide.view(), wide.t()));
        let scaled = |power: f64| {
            let scale = |(i, x): (usize, &f64)| x * values[i % values.len()].powf(power);
            Dense { data: vectors.data.iter().enumerate().map(scale).collect(), ..vectors }
        };
        let (root, inverse) = (scaled(0.5), scaled(-0.5));
        let met = product(self.mean().to_f64().view(), root.view());
        let (_, turn) = eigen(&product(met.t(), met.view()));
        let coefficients = product(root.view(), turn.view());
        let turned = |half: &Dense<f32>| product(half.to_f64().view(), coefficients.view()).to_f32();
        let basis = product(product(inverse.view(), turn.view()).t(), wide.view()).to_f32();
        Fit { basis, a: turned(&self.a), b: turned(&self.b), n_landmarks: self.n_landmarks }
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
    pub(crate) fn shared(&self) -> Vec<f64> {
        products_by_column(&self.a, &self.b)
    }

    /// ‖A v‖² and ‖B v‖² of each component v.
    pub(crate) fn own(&self) -> [Vec<f64>; 2] {
        [&self.a, &self.b].map(|half| products_by_column(half, half))
    }
}

/// Indices below `count`, those that fulfill a condition first; their order is kept otherwise.
pub(crate) fn front(count: usize, is_first: impl Fn(usize) -> bool) -> Vec<usize> {
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
