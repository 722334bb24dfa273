//! Least squares within bounds: the `x` that minimizes `Σ w (a·x − b)²` with every unknown between its own bounds.
//!
//! Rows are added one by one into the normal equations, so that their number does not matter. What is left is a convex
//! quadratic program of a few hundred unknowns. Sweeps over the coordinates, each at its best between its bounds, come near
//! the answer; the active-set method of \[Lawson1974, ch. 23\], with upper bounds as well as lower ones \[Stark1995\], takes it
//! from there and ends where the conditions of Karush, Kuhn and Tucker hold.
//!
//! **Decision.** The unknowns are scaled so that the diagonal is 1, and the diagonal then gets `TIE` on top, pulling to the
//! start. Columns that are alike, or zero, therefore have one answer, the nearest to the start. **Refused:** an orthogonal
//! decomposition of the rows themselves, which is exact for worse conditioned columns, but needs all rows at once.

use nalgebra::{Cholesky, DMatrix, DVector};
use thiserror::Error;

/// What the scaled diagonal gets on top of 1.
const TIE: f64 = 1e-9;
/// Sweeps over the coordinates before the active set is asked.
const SWEEPS: usize = 64;
/// Gradient in scaled unknowns, relative to the largest term in it, that counts as none.
const LEVEL: f64 = 1e-10;

/// Why there is no answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum BoundedError {
    /// The bounds leave nothing, or start and bounds are not as many as unknowns.
    #[error(
        "the bounds of unknown {0} leave no number, or there are none; give a lower bound that is not above the upper"
    )]
    Bounds(usize),
    /// Rows that are not finite, or of magnitudes that double precision does not hold together.
    #[error("the equations are not finite; check them for infinite numbers and weights")]
    NotFinite,
}

/// Weighted equations in a number of unknowns, as their normal equations.
#[derive(Clone, Debug)]
pub struct BoundedLeastSquares {
    n: usize,
    /// Row-major, n × n; the lower triangle counts.
    gram: Vec<f64>,
    rhs: Vec<f64>,
    square: f64,
}

impl BoundedLeastSquares {
    /// No equations yet, in `n` unknowns.
    pub fn new(n: usize) -> Self {
        Self { n, gram: vec![0.0; n * n], rhs: vec![0.0; n], square: 0.0 }
    }

    /// Number of unknowns.
    pub fn n_unknowns(&self) -> usize {
        self.n
    }

    /// Adds `weight · (Σ a·x − b)²`, the row given by its entries in ascending order of unknowns, each once.
    pub fn add(&mut self, row: &[(usize, f64)], b: f64, weight: f64) {
        for (nth, &(i, a)) in row.iter().enumerate() {
            let scaled = weight * a;
            for &(j, other) in &row[..=nth] {
                self.gram[i * self.n + j] += scaled * other;
            }
            self.rhs[i] += scaled * b;
        }
        self.square += weight * b * b;
    }

    /// `Σ w (a·x − b)²`.
    pub fn misfit(&self, x: &[f64]) -> f64 {
        let product = |i: usize| (0..self.n).map(|j| self.at(i, j) * x[j]).sum::<f64>();
        let sum: f64 = (0..self.n).map(|i| x[i] * (product(i) - 2.0 * self.rhs[i])).sum();
        (sum + self.square).max(0.0)
    }

    /// Half of the derivative of the misfit by each unknown.
    pub fn gradient(&self, x: &[f64]) -> Vec<f64> {
        (0..self.n).map(|i| (0..self.n).map(|j| self.at(i, j) * x[j]).sum::<f64>() - self.rhs[i]).collect()
    }

    /// The unknowns that minimize the misfit between their bounds `[lower, upper]`; bounds may be infinite. Where the equations
    /// leave a choice, the answer is the nearest to `start`.
    ///
    /// # Errors
    /// See [`BoundedError`].
    pub fn solve(&self, start: &[f64], bounds: &[[f64; 2]]) -> Result<Vec<f64>, BoundedError> {
        for i in 0..self.n {
            let sound = bounds
                .get(i)
                .is_some_and(|[low, high]| low <= high && *low < f64::INFINITY && *high > f64::NEG_INFINITY);
            if !sound || !start.get(i).is_some_and(|x| x.is_finite()) {
                return Err(BoundedError::Bounds(i));
            }
        }
        if !self.gram.iter().chain(&self.rhs).all(|x| x.is_finite()) {
            return Err(BoundedError::NotFinite);
        }
        let scale: Vec<f64> =
            (0..self.n).map(|i| self.at(i, i)).map(|d| if d > 0.0 { d.sqrt() } else { 1.0 }).collect();
        let mut scaled = Scaled::new(self, &scale, start, bounds);
        (0..SWEEPS).for_each(|_| scaled.sweep());
        scaled.finish()?;
        // Back in the caller's units a bound is met to the last bit.
        let unscaled = |i: usize| match scaled.state[i] {
            State::Lower => bounds[i][0],
            State::Upper => bounds[i][1],
            State::Free => (scaled.x[i] / scale[i]).clamp(bounds[i][0], bounds[i][1]),
        };
        Ok((0..self.n).map(unscaled).collect())
    }

    fn at(&self, i: usize, j: usize) -> f64 {
        if i >= j { self.gram[i * self.n + j] } else { self.gram[j * self.n + i] }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Free,
    Lower,
    Upper,
}

/// The problem in unknowns whose diagonal is 1 + [`TIE`].
struct Scaled {
    gram: DMatrix<f64>,
    rhs: DVector<f64>,
    low: Vec<f64>,
    high: Vec<f64>,
    x: DVector<f64>,
    state: Vec<State>,
    /// Gradient that counts as none.
    level: f64,
}

impl Scaled {
    fn new(of: &BoundedLeastSquares, scale: &[f64], start: &[f64], bounds: &[[f64; 2]]) -> Self {
        let n = of.n;
        let gram = DMatrix::from_fn(n, n, |i, j| of.at(i, j) / (scale[i] * scale[j]) + if i == j { TIE } else { 0.0 });
        let rhs = DVector::from_fn(n, |i, _| of.rhs[i] / scale[i] + TIE * start[i] * scale[i]);
        let side = |which: usize| (0..n).map(|i| bounds[i][which] * scale[i]).collect::<Vec<f64>>();
        let (low, high) = (side(0), side(1));
        let x = DVector::from_fn(n, |i, _| (start[i] * scale[i]).clamp(low[i], high[i]));
        let level = LEVEL * rhs.amax().max(f64::MIN_POSITIVE);
        let mut scaled = Self { gram, rhs, low, high, x, state: vec![State::Free; n], level };
        (0..n).for_each(|i| scaled.state[i] = scaled.place(i));
        scaled
    }

    /// At which bound an unknown is.
    fn place(&self, i: usize) -> State {
        match self.x[i] {
            x if x <= self.low[i] => State::Lower,
            x if x >= self.high[i] => State::Upper,
            _ => State::Free,
        }
    }

    /// Every unknown in turn at its best while the others stay.
    fn sweep(&mut self) {
        for i in 0..self.x.len() {
            let rest = self.gram.column(i).dot(&self.x) - self.gram[(i, i)] * self.x[i];
            self.x[i] = ((self.rhs[i] - rest) / self.gram[(i, i)]).clamp(self.low[i], self.high[i]);
            self.state[i] = self.place(i);
        }
    }

    /// The active-set method: solves for what is free, stops at the first bound in the way, frees what the gradient pulls from
    /// its bound. The misfit falls with every unknown that is freed, so no set comes twice; once it no longer does, what is left
    /// is rounding.
    fn finish(&mut self) -> Result<(), BoundedError> {
        let mut least = f64::INFINITY;
        loop {
            self.settle()?;
            let product = &self.gram * &self.x;
            let misfit = 0.5 * self.x.dot(&product) - self.x.dot(&self.rhs);
            if misfit >= least {
                return Ok(());
            }
            least = misfit;
            let gradient = product - &self.rhs;
            let pull = |i: usize| match self.state[i] {
                State::Lower if self.high[i] > self.low[i] => -gradient[i],
                State::Upper if self.high[i] > self.low[i] => gradient[i],
                _ => 0.0,
            };
            let most = (0..self.x.len()).max_by(|&i, &j| pull(i).total_cmp(&pull(j)));
            match most.filter(|&i| pull(i) > self.level) {
                Some(i) => self.state[i] = State::Free,
                None => return Ok(()),
            }
        }
    }

    /// Goes to the best place for the free unknowns, along straight lines within the bounds.
    fn settle(&mut self) -> Result<(), BoundedError> {
        loop {
            let free: Vec<usize> = (0..self.x.len()).filter(|&i| self.state[i] == State::Free).collect();
            if free.is_empty() {
                return Ok(());
            }
            let goal = self.goal(&free)?;
            let share = |(k, &i): (usize, &usize)| {
                let (from, to) = (self.x[i], goal[k]);
                let bound = if to < from { self.low[i] } else { self.high[i] };
                let is_inside = (self.low[i]..=self.high[i]).contains(&to);
                (if is_inside { 1.0 } else { ((bound - from) / (to - from)).clamp(0.0, 1.0) }, is_inside, k)
            };
            let nearest = free
                .iter()
                .enumerate()
                .map(share)
                .filter(|(_, is_inside, _)| !is_inside)
                .min_by(|a, b| a.0.total_cmp(&b.0));
            let Some((way, _, hit)) = nearest else {
                free.iter().enumerate().for_each(|(k, &i)| self.x[i] = goal[k]);
                return Ok(());
            };
            free.iter().enumerate().for_each(|(k, &i)| self.x[i] += way * (goal[k] - self.x[i]));
            // The one in the way is at its bound whatever rounding says.
            let i = free[hit];
            let is_low = goal[hit] < self.low[i];
            (self.x[i], self.state[i]) =
                if is_low { (self.low[i], State::Lower) } else { (self.high[i], State::Upper) };
        }
    }

    /// The best place for the free unknowns if they had no bounds.
    fn goal(&self, free: &[usize]) -> Result<DVector<f64>, BoundedError> {
        let gram = DMatrix::from_fn(free.len(), free.len(), |k, l| self.gram[(free[k], free[l])]);
        let held = |k: usize| -> f64 {
            let fixed = (0..self.x.len()).filter(|&j| self.state[j] != State::Free);
            self.rhs[free[k]] - fixed.map(|j| self.gram[(free[k], j)] * self.x[j]).sum::<f64>()
        };
        let rhs = DVector::from_fn(free.len(), |k, _| held(k));
        Cholesky::new(gram).map(|factor| factor.solve(&rhs)).ok_or(BoundedError::NotFinite)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    const WIDE: [f64; 2] = [0.0, f64::INFINITY];

    fn problem(rows: &[Vec<f64>], b: &[f64]) -> BoundedLeastSquares {
        let mut problem = BoundedLeastSquares::new(rows[0].len());
        for (row, &b) in rows.iter().zip(b) {
            problem.add(&row.iter().copied().enumerate().collect::<Vec<_>>(), b, 1.0);
        }
        problem
    }

    fn random_problem(seed: u64, n_rows: usize, n: usize) -> BoundedLeastSquares {
        let mut rng = Random::new([seed, 77]);
        let rows: Vec<Vec<f64>> = (0..n_rows).map(|_| (0..n).map(|_| f64::from(rng.normal())).collect()).collect();
        let b: Vec<f64> = (0..n_rows).map(|_| f64::from(rng.normal())).collect();
        problem(&rows, &b)
    }

    /// The least misfit over every choice of which unknowns are free and which lie at which bound.
    fn brute_force(problem: &BoundedLeastSquares, bounds: &[[f64; 2]]) -> f64 {
        let n = problem.n_unknowns();
        let mut least = f64::INFINITY;
        for code in 0..3usize.pow(n as u32) {
            let states: Vec<usize> = (0..n).map(|i| code / 3usize.pow(i as u32) % 3).collect();
            let mut x: Vec<f64> = (0..n).map(|i| if states[i] == 2 { 0.0 } else { bounds[i][states[i]] }).collect();
            let free: Vec<usize> = (0..n).filter(|&i| states[i] == 2).collect();
            let gram = DMatrix::from_fn(free.len(), free.len(), |k, l| problem.at(free[k], free[l]));
            let rhs = DVector::from_iterator(free.len(), free.iter().map(|&i| -problem.gradient(&x)[i]));
            if !free.is_empty() {
                let Some(solved) = gram.lu().solve(&rhs) else { continue };
                free.iter().enumerate().for_each(|(k, &i)| x[i] = solved[k]);
            }
            if (0..n).all(|i| (bounds[i][0] - 1e-9..=bounds[i][1] + 1e-9).contains(&x[i])) {
                least = least.min(problem.misfit(&x));
            }
        }
        least
    }

    #[test]
    fn no_choice_of_bounds_is_better() {
        for seed in 0..60 {
            let problem = random_problem(seed, 7, 5);
            let bounds: Vec<[f64; 2]> = (0..5).map(|i| [-0.1 * i as f64, 0.15 + 0.05 * i as f64]).collect();
            let x = problem.solve(&[0.0; 5], &bounds).unwrap();
            let (ours, best) = (problem.misfit(&x), brute_force(&problem, &bounds));
            assert!(ours <= best * (1.0 + 1e-7) + 1e-12, "seed {seed}: {ours} against {best}");
            assert!(ours >= best * (1.0 - 1e-7) - 1e-12, "seed {seed}: {x:?} lies outside");
        }
    }

    #[test]
    fn the_conditions_of_karush_kuhn_and_tucker_hold() {
        for (seed, n_rows, n) in [(1, 400, 120), (2, 90, 60), (3, 30, 60)] {
            let problem = random_problem(seed, n_rows, n);
            let x = problem.solve(&vec![0.0; n], &vec![WIDE; n]).unwrap();
            let gradient = problem.gradient(&x);
            let largest = gradient.iter().fold(0.0f64, |most, g| most.max(g.abs())).max(1.0);
            for (x, g) in x.iter().zip(&gradient) {
                assert!(*x >= 0.0 && *g > -1e-6 * largest, "{x} {g}");
                assert!(*x == 0.0 || g.abs() < 1e-6 * largest, "seed {seed}: slope {g} at {x}");
            }
            assert!(x.contains(&0.0) && x.iter().any(|x| *x > 0.0));
        }
    }

    #[test]
    fn what_was_mixed_is_found_again() {
        let mut rng = Random::new([5, 6]);
        let wanted: Vec<f64> = (0..40).map(|i| if i % 3 == 0 { 0.0 } else { f64::from(i) }).collect();
        let rows: Vec<Vec<f64>> = (0..200).map(|_| (0..40).map(|_| f64::from(rng.normal().abs())).collect()).collect();
        let b: Vec<f64> = rows.iter().map(|row| row.iter().zip(&wanted).map(|(a, x)| a * x).sum()).collect();
        let x = problem(&rows, &b).solve(&[1.0; 40], &[WIDE; 40]).unwrap();
        for (x, wanted) in x.iter().zip(&wanted) {
            assert!((x - wanted).abs() < 1e-4 * wanted.max(1.0), "{x} instead of {wanted}");
        }
    }

    #[test]
    fn a_small_case_by_hand() {
        // Without bounds x = (2, -1); with them the second stays at 0 and the first fits alone: (2·1 + 1·1) / 2.
        let rows = [vec![1.0, 0.0], vec![1.0, 1.0]];
        let problem = problem(&rows, &[2.0, 1.0]);
        let free = problem.solve(&[0.0; 2], &[[-9.0, 9.0]; 2]).unwrap();
        assert!((free[0] - 2.0).abs() < 1e-6 && (free[1] + 1.0).abs() < 1e-6, "{free:?}");
        let x = problem.solve(&[0.0; 2], &[WIDE; 2]).unwrap();
        assert!((x[0] - 1.5).abs() < 1e-6 && x[1] == 0.0, "{x:?}");
        assert!((problem.misfit(&x) - 0.5).abs() < 1e-6);
        assert_eq!(problem.solve(&[0.0; 2], &[[0.0, 1.0]; 2]).unwrap()[0], 1.0);
    }

    #[test]
    fn columns_that_are_alike_or_zero_have_one_answer_the_nearest_to_the_start() {
        let problem = problem(&[vec![1.0, 1.0, 0.0]], &[4.0]);
        let x = problem.solve(&[1.0, 2.0, 7.0], &[WIDE; 3]).unwrap();
        assert!((x[0] - 1.5).abs() < 1e-6 && (x[1] - 2.5).abs() < 1e-6 && (x[2] - 7.0).abs() < 1e-9, "{x:?}");
        assert!(BoundedLeastSquares::new(0).solve(&[], &[]).unwrap().is_empty());
    }

    #[test]
    fn magnitudes_do_not_matter() {
        for unit in [1e-12, 1.0, 1e12] {
            let rows = [vec![unit, 0.0], vec![unit, 1e3]];
            let x = problem(&rows, &[2.0, 5.0]).solve(&[0.0; 2], &[WIDE; 2]).unwrap();
            assert!((x[0] * unit - 2.0).abs() < 1e-6 && (x[1] * 1e3 - 3.0).abs() < 1e-6, "{unit}: {x:?}");
        }
    }

    #[test]
    fn what_has_no_answer_is_told() {
        let problem = problem(&[vec![1.0, 1.0]], &[1.0]);
        assert_eq!(problem.solve(&[0.0; 2], &[WIDE, [2.0, 1.0]]), Err(BoundedError::Bounds(1)));
        assert_eq!(problem.solve(&[0.0; 2], &[WIDE]), Err(BoundedError::Bounds(1)));
        let mut endless = BoundedLeastSquares::new(1);
        endless.add(&[(0, f64::INFINITY)], 1.0, 1.0);
        assert_eq!(endless.solve(&[0.0], &[WIDE]), Err(BoundedError::NotFinite));
    }
}
