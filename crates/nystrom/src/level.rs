//! Columns brought near a common strength, or near a common noise, before samples are decomposed.
//!
//! Where columns are looked at one by one, a weak one must not lack what a strong one beside it hides. Divided by its strength in the
//! block it lacks as large a part of itself as the others do.
//!
//! Where a few columns are far noisier than the others, what is decomposed has their noise in its leading components, and what is
//! quiet is dropped for it: then most columns would be nearer to the truth as they were sampled. Columns divided by the root of their
//! noise are found as if all were as noisy as each other \[Leeb2021\], and are multiplied again in what is found. Both halves are
//! divided alike, which leaves them independent but for as many numbers as there are columns, and these know of no sign.

use crate::{compress::strength, dense::Dense, means::Means};

/// How many times the mean noise of all columns, and what is allowed, count as noise of each: a rare large sample in a column says
/// little of it, and columns that are exact enough need no help. Found on four matrices, where one half to sixteen times differ little.
const SHARED: f64 = 4.0;
/// How many times its noise a column's energy counts as at least where it is divided by its strength: what is mostly noise is not
/// raised to what others hold.
pub(crate) const NOISE: f64 = 4.0;

/// Samples whose columns have been divided.
pub(crate) struct Level {
    /// As they are then.
    pub(crate) means: Means,
    /// By what; of columns that are divided by their noise alone the mean of the squares is 1.
    divisors: Vec<f32>,
}

impl Level {
    /// Divides the columns by their noise; `goal` is the mean square error per entry that is allowed, none where it is below 0. What is
    /// shared keeps all divisors within √0.8 and √(columns / 5 + 1), whatever the noise. Columns that were divided before are divided
    /// once more, by the noise that they have then, and within that of what they were divided by.
    pub(crate) fn new(means: &Means, goal: f64, before: Option<&Self>) -> Self {
        let divided = before.map_or(means, |level| &level.means);
        let shared = SHARED * (divided.noise_per_entry() + goal.max(0.0));
        let noises: Vec<f64> = column_noises(divided).iter().map(|noise| noise + shared).collect();
        let mean = noises.iter().sum::<f64>() / noises.len() as f64;
        let mut divisors: Vec<f32> =
            noises.iter().map(|noise| if mean > 0.0 { (noise / mean).sqrt() as f32 } else { 1.0 }).collect();
        if let Some(before) = before {
            divisors.iter_mut().zip(&before.divisors).for_each(|(divisor, before)| *divisor *= before);
        }
        Self::by(means, divisors)
    }

    /// Divides the columns by their [`strength`]; `None` where all are strong.
    pub(crate) fn apart(means: &Means, strong: f32) -> Option<Self> {
        let to_mean_square = means.unit * means.unit;
        let strength_of = |(shared, noise): (f64, f64)| strength(shared.max(NOISE * noise) * to_mean_square, strong);
        let both = column_energies(means).into_iter().zip(column_noises(means));
        let divisors: Vec<f32> = both.map(|both| strength_of(both) as f32).collect();
        divisors.iter().any(|divisor| *divisor < 1.0).then(|| Self::by(means, divisors))
    }

    /// Columns that are left as they were sampled.
    pub(crate) fn undivided(means: &Means) -> Self {
        Self::by(means, vec![1.0; means.mean.n_cols])
    }

    fn by(means: &Means, divisors: Vec<f32>) -> Self {
        let factors: Vec<f32> = divisors.iter().map(|divisor| 1.0 / divisor).collect();
        let divided = |rows: &Dense<f32>| scaled(rows, &factors);
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
        scaled(rows, &self.divisors)
    }
}

/// Of each column the mean square that both halves agree about.
fn column_energies(means: &Means) -> Vec<f64> {
    of_columns(means, |a, b| a * b)
}

/// Of each column the mean square of the noise of the mean of both halves.
fn column_noises(means: &Means) -> Vec<f64> {
    of_columns(means, |a, b| 0.25 * (a - b).powi(2))
}

/// Of each column the mean over its rows of something of both halves.
fn of_columns(means: &Means, of: impl Fn(f64, f64) -> f64) -> Vec<f64> {
    let mut sums = vec![0.0; means.mean.n_cols];
    for row in 0..means.mean.n_rows {
        let both = means.a.row(row).iter().zip(means.b.row(row));
        sums.iter_mut().zip(both).for_each(|(sum, (a, b))| *sum += of(f64::from(*a), f64::from(*b)));
    }
    sums.iter_mut().for_each(|sum| *sum /= means.mean.n_rows as f64);
    sums
}

/// Each column times its factor.
fn scaled(rows: &Dense<f32>, factors: &[f32]) -> Dense<f32> {
    let mut rows = rows.clone();
    for row in 0..rows.n_rows {
        rows.row_mut(row).iter_mut().zip(factors).for_each(|(x, factor)| *x *= factor);
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        fit::Fit,
        product::{coefficients, product},
        random::Random,
    };

    /// Three columns of noise, each ten times that of the one before.
    fn noisy() -> Means {
        let mut rng = Random::new([90, 0]);
        let noises = [1.0f32, 10.0, 100.0];
        let mut half = || (0..3 * 4000).map(|i| noises[i % 3] * rng.normal()).collect::<Vec<f32>>();
        let (a, b) = (half(), half());
        let mut means = Means::default();
        means.fill([&a, &b], 3, &(0..3), [1; 2]).unwrap();
        means
    }

    #[test]
    fn columns_are_as_noisy_as_each_other_but_for_what_they_share() {
        let means = noisy();
        let level = Level::new(&means, 0.0, None);
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
    fn columns_are_divided_by_their_strength_and_noise_is_not_raised_to_it() {
        // Strong, weak, far too weak, and nothing but noise.
        let (strengths, noises) = ([2.0f32, 0.1, 1e-6, 0.0], [0.0f32, 0.0, 0.0, 0.01]);
        let mut rng = Random::new([91, 0]);
        let mut half = || (0..4 * 4000).map(|i| strengths[i % 4] + noises[i % 4] * rng.normal()).collect::<Vec<f32>>();
        let (a, b) = (half(), half());
        let mut means = Means::default();
        means.fill([&a, &b], 4, &(0..4), [1; 2]).unwrap();
        let level = Level::apart(&means, 1.0).unwrap();
        // The mean of two halves has half of the noise, as a mean square, and four times that counts.
        let expected = [1.0, 0.1, 1.0 / 128.0, 0.01 * 2f32.sqrt()];
        let is_near = |(got, want): (&f32, &f32)| (got / want - 1.0).abs() < 0.05;
        assert!(level.divisors.iter().zip(&expected).all(is_near), "{:?}", level.divisors);
        assert!(Level::apart(&means, 0.0).is_none(), "nothing is weak beside nothing");
        // Divided by their noise as well, they are still columns of the same matrix.
        let both = Level::new(&means, 0.0, Some(&level));
        let back = both.multiplied(&both.means.mean);
        assert!(back.data.iter().zip(&means.mean.data).all(|(x, y)| (x - y).abs() <= 1e-5 * y.abs()));
    }

    #[test]
    fn columns_that_are_not_divided_are_as_they_were_sampled() {
        let means = noisy();
        let level = Level::undivided(&means);
        assert_eq!(level.divisors, [1.0; 3]);
        let both = [(&level.means.a, &means.a), (&level.means.b, &means.b), (&level.means.mean, &means.mean)];
        assert!(both.iter().all(|(level, sampled)| level.data == sampled.data));
    }

    #[test]
    fn a_fit_is_the_same_matrix_when_its_columns_are_multiplied() {
        let level = Level::new(&noisy(), 0.0, None);
        for n_components in [0, 1, 2] {
            let data = [0.6, 0.0, 0.8, 0.8, 0.0, -0.6][..3 * n_components].to_vec();
            let basis = Dense { n_rows: n_components, n_cols: 3, data };
            let [a, b] = [&level.means.a, &level.means.b].map(|half| coefficients(half, &basis));
            let fit = Fit { basis, a, b, n_landmarks: 0 };
            let back = fit.multiplied(&level);
            assert_eq!([back.basis.n_rows, back.a.n_cols, back.b.n_cols], [n_components; 3]);
            for (half, of_fit) in [(&back.a, &fit.a), (&back.b, &fit.b)] {
                let (got, want) = (back.of(half), level.multiplied(&fit.of(of_fit)));
                assert!(got.data.iter().zip(&want.data).all(|(x, y)| (x - y).abs() < 1e-5), "{n_components}");
            }
            let gram = product(back.basis.view(), back.basis.t());
            let is_one = |(i, x): (usize, &f32)| (x - if i % (n_components + 1) == 0 { 1.0 } else { 0.0 }).abs() < 1e-6;
            assert!(gram.data.iter().enumerate().all(is_one), "{gram:?}");
        }
    }

    #[test]
    fn no_divisor_leaves_its_bounds_whatever_the_noise_and_the_goal() {
        // Magnitudes of columns are up to 1e30 apart, and only some have noise.
        let magnitudes = [1.0f32, 1e-30, 1e-15, 1.0, 0.0, 1e-22];
        let n_cols = magnitudes.len();
        let a: Vec<f32> = (0..40 * n_cols).map(|i| magnitudes[i % n_cols] * (1.0 + (i % 7) as f32)).collect();
        for noisy in [&[0][..], &[2, 5], &[0, 1, 2, 3, 4, 5]] {
            let differs = |i: usize| if noisy.contains(&(i % n_cols)) { 1.5 } else { 1.0 };
            let b: Vec<f32> = a.iter().enumerate().map(|(i, x)| x * differs(i)).collect();
            let mut means = Means::default();
            means.fill([&a, &b], n_cols, &(0..n_cols), [1; 2]).unwrap();
            let noise = means.noise_per_entry();
            for goal in [0.0, noise, 1e-40, 1e40] {
                let level = Level::new(&means, goal, None);
                let bounds = 0.89..(n_cols as f32 / 5.0 + 1.0).sqrt() * 1.01;
                assert!(level.divisors.iter().all(|x| bounds.contains(x)), "{noisy:?} {goal}: {:?}", level.divisors);
                assert!(level.means.mean.data.iter().all(|x| x.is_finite()));
            }
            // A goal that nothing meets is none.
            let none = Level::new(&means, 0.0, None).divisors;
            assert!([-1.1 * noise, -1.0].into_iter().all(|goal| Level::new(&means, goal, None).divisors == none));
        }
    }

    #[test]
    fn columns_without_noise_stay_as_they_are() {
        let values: Vec<f32> = (0..30).map(|i| i as f32).collect();
        let mut means = Means::default();
        means.fill([&values, &values], 3, &(0..3), [1; 2]).unwrap();
        for goal in [0.0, 0.1] {
            assert_eq!(Level::new(&means, goal, None).divisors, [1.0; 3]);
        }
    }
}
