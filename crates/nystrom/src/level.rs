//! Columns brought near a common noise before noisy samples are decomposed.
//!
//! Where a few columns are far noisier than the others, what is decomposed has their noise in its leading components, and what is
//! quiet is dropped for it: then most columns would be nearer to the truth as they were sampled. Columns divided by the root of their
//! noise are found as if all were as noisy as each other \[Leeb2021\], and are multiplied again in what is found.

use crate::{dense::Dense, means::Means};

/// How many times the mean noise of all columns, and what is allowed, count as noise of each: a rare bright sample in a column says
/// little of it, and columns that are exact enough need no help. Found on four scenes, where one half to sixteen times differ little.
const SHARED: f64 = 4.0;

/// Samples whose columns have been divided.
pub(crate) struct Level {
    /// As they are then.
    pub(crate) means: Means,
    /// By what; the mean of the squares is 1.
    divisors: Vec<f32>,
}

impl Level {
    /// Divides the columns; `goal` is the mean square error per entry that is allowed.
    pub(crate) fn new(means: &Means, goal: f64) -> Self {
        let n_cols = means.mean.n_cols;
        let mut noises = vec![0.0; n_cols];
        for row in 0..means.mean.n_rows {
            let both = means.a.row(row).iter().zip(means.b.row(row));
            noises.iter_mut().zip(both).for_each(|(noise, (a, b))| *noise += 0.25 * f64::from(a - b).powi(2));
        }
        let shared = SHARED * (means.noise_per_entry() + goal);
        noises.iter_mut().for_each(|noise| *noise = *noise / means.mean.n_rows as f64 + shared);
        let mean = noises.iter().sum::<f64>() / n_cols as f64;
        let divisors: Vec<f32> =
            noises.iter().map(|noise| if mean > 0.0 { (noise / mean).sqrt() as f32 } else { 1.0 }).collect();
        let divided = |rows: &Dense<f32>| scaled(rows, |col| 1.0 / divisors[col]);
        let (a, b, mean) = (divided(&means.a), divided(&means.b), divided(&means.mean));
        let sums = |of: fn(f64, f64) -> f64| -> Vec<f64> {
            let of_row =
                |row: usize| a.row(row).iter().zip(b.row(row)).map(|(x, y)| of((*x).into(), (*y).into())).sum();
            (0..a.n_rows).map(of_row).collect()
        };
        let (cross, noise) = (sums(|x, y| x * y), sums(|x, y| 0.25 * (x - y).powi(2)));
        Self { means: Means { a, b, mean, unit: means.unit, cross, noise }, divisors }
    }

    /// The squared length of a row of divided columns once they are multiplied.
    pub(crate) fn square(&self, row: &[f64]) -> f64 {
        row.iter().zip(&self.divisors).map(|(x, divisor)| (x * f64::from(*divisor)).powi(2)).sum()
    }

    /// A combination of the columns as one of divided ones.
    pub(crate) fn combination(&self, weights: &[f32]) -> Vec<f32> {
        weights.iter().zip(&self.divisors).map(|(weight, divisor)| weight * divisor).collect()
    }

    /// Rows of divided columns as those of the columns themselves.
    pub(crate) fn multiplied(&self, rows: &Dense<f32>) -> Dense<f32> {
        scaled(rows, |col| self.divisors[col])
    }
}

fn scaled(rows: &Dense<f32>, factor: impl Fn(usize) -> f32) -> Dense<f32> {
    let mut rows = rows.clone();
    for row in 0..rows.n_rows {
        rows.row_mut(row).iter_mut().enumerate().for_each(|(col, x)| *x *= factor(col));
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn columns_are_as_noisy_as_each_other_but_for_what_they_share() {
        let mut rng = Random::new([90, 0]);
        let noises = [1.0f32, 10.0, 100.0];
        let mut half = || (0..3 * 4000).map(|i| noises[i % 3] * rng.normal()).collect::<Vec<f32>>();
        let (a, b) = (half(), half());
        let mut means = Means::default();
        means.fill([&a, &b], 3, &(0..3), [1; 2]).unwrap();
        let level = Level::new(&means, 0.0);
        let squares: f32 = level.divisors.iter().map(|x| x * x).sum();
        assert!((squares - 3.0).abs() < 1e-4, "{:?}", level.divisors);
        // The last one has nearly all of the noise, three times the mean: (4 + 3) / (4 + 0).
        let over = level.divisors[2] / level.divisors[0];
        assert!((over * over - 7.0 / 4.0).abs() < 0.05, "{:?}", level.divisors);
        let back = level.multiplied(&level.means.a);
        assert!(back.data.iter().zip(&means.a.data).all(|(x, y)| (x - y).abs() <= 1e-5 * y.abs()));
        let row = level.means.mean.row(0);
        let divided: Vec<f64> = row.iter().map(|x| f64::from(*x)).collect();
        let own: f64 = means.mean.row(0).iter().map(|x| f64::from(*x).powi(2)).sum();
        assert!((level.square(&divided) / own - 1.0).abs() < 1e-5);
        // A product with the columns is one with the divided columns.
        let weights = [0.5f32, 2.0, -1.0];
        let product = |row: &[f32], weights: &[f32]| row.iter().zip(weights).map(|(x, w)| x * w).sum::<f32>();
        let (plain, level) = (product(means.mean.row(0), &weights), product(row, &level.combination(&weights)));
        assert!((plain - level).abs() < 1e-4 * plain.abs().max(0.1), "{plain} and {level}");
    }

    #[test]
    fn columns_without_noise_stay_as_they_are() {
        let values: Vec<f32> = (0..30).map(|i| i as f32).collect();
        let mut means = Means::default();
        means.fill([&values, &values], 3, &(0..3), [1; 2]).unwrap();
        for goal in [0.0, 0.1] {
            assert_eq!(Level::new(&means, goal).divisors, [1.0; 3]);
        }
    }
}
