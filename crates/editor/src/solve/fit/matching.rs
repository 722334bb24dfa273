//! Matching a picture: cell by cell, whatever its exposure, and whatever in it is not in the scene.
//!
//! Cells are weighed by how well they fit, and solved again, until that changes little: iteratively reweighted least squares
//! \[Holland1977\] with Cauchy's weights, whose scale is the median miss. Cells that no lights can match, such as a chair that is not in the
//! scene, end with next to no weight. An exposure that is not known is the factor that suits the present answer best, found
//! in the same rounds.

use anyhow::{Context, Result};
use clerestory_nystrom::BoundedLeastSquares;
use clerestory_transport::camera::Film;

use super::super::picture::Mean;
use super::super::report::Outcome;
use super::super::rows::luminance;
use super::{Cell, DARK, Exposure, Layout, Target, Wish};

/// Rounds of weighing and solving.
const MOST_ROUNDS: usize = 24;
/// Change of an unknown, of its size, that ends them.
const SETTLED: f64 = 1e-4;
/// Light below this counts as this: the least that single precision holds in full.
const LEAST: f64 = f32::MIN_POSITIVE as f64;
/// Cauchy's weights halve at so many standard deviations: 95 % as good as least squares where misses are normal.
const CAUCHY: f64 = 2.385;
/// Standard deviation over median miss of normal misses.
const SIGMA_PER_MEDIAN: f64 = 1.4826;
/// Misses that count as none, over what is wanted: the noise of a bake is no reason to trust a cell less.
const LEAST_SIGMA: f64 = 0.02;

/// A picture to be matched by all cells.
#[derive(Clone)]
pub(super) struct Matching {
    means: Vec<Mean>,
    /// One over what a miss is measured by, in units of the picture.
    per_size: Vec<f64>,
    /// Whether it has no light at all, so that nothing can be told over it.
    is_black: bool,
    is_free: bool,
    /// Nit per unit of the picture.
    nit: f64,
    /// By cell and channel.
    trust: Vec<[f64; 3]>,
    weight: f64,
}

impl Matching {
    pub fn new(wish: &Wish, film: Film, cells: &[Cell], layout: &Layout) -> Option<Matching> {
        let Target::Picture(picture, exposure) = &wish.target else { return None };
        let means: Vec<Mean> = cells.iter().map(|cell| picture.mean(film, cell.rect)).collect();
        // Less than no light, which photographs have for noise, is none.
        let wanted: Vec<f64> = means.iter().map(|mean| luminance(mean.rgb).max(0.0)).collect();
        let level = wanted.iter().sum::<f64>() / wanted.len().max(1) as f64;
        let is_black = level < LEAST;
        let per_size = wanted.iter().map(|wanted| 1.0 / (wanted + DARK * level).max(LEAST)).collect();
        let (nit, is_free) = match exposure {
            // Black is black however it was exposed.
            _ if is_black => (1.0, false),
            Exposure::Ev(ev) => ((-ev).exp2(), false),
            Exposure::Free => {
                let now: Vec<f64> =
                    cells.iter().map(|cell| luminance(layout.value(&cell.row, &layout.start))).collect();
                let ratio = median(now) / median(wanted).max(LEAST);
                (if ratio > 0.0 && ratio.is_finite() { ratio } else { 1.0 }, true)
            }
        };
        let trust = vec![[1.0; 3]; means.len()];
        Some(Matching { means, per_size, is_black, is_free, nit, trust, weight: wish.weight })
    }

    fn add(&self, problem: &mut BoundedLeastSquares, cells: &[Cell], layout: &Layout) {
        for (idx, cell) in cells.iter().enumerate() {
            let per_size = self.per_size[idx] / self.nit;
            for c in 0..3 {
                let weight = self.weight * self.trust[idx][c] * per_size * per_size / (3 * cells.len()) as f64;
                if weight > 0.0 {
                    let b = self.nit * self.means[idx].rgb[c] - cell.row.fixed[c];
                    problem.add(&layout.channel(&cell.row, c), b, weight);
                }
            }
        }
    }

    /// How far a cell's channels are off, over its size.
    fn misses(&self, idx: usize, value: [f64; 3]) -> [f64; 3] {
        let Mean { rgb, is_clipped } = self.means[idx];
        std::array::from_fn(|c| {
            let miss = (value[c] / self.nit - rgb[c]) * self.per_size[idx];
            // What was cut off may be as bright as it likes.
            if is_clipped[c] { miss.min(0.0) } else { miss }
        })
    }

    /// Finds the exposure and the weights that suit an answer.
    fn reweigh(&mut self, cells: &[Cell], layout: &Layout, x: &[f64]) {
        let values: Vec<[f64; 3]> = cells.iter().map(|cell| layout.value(&cell.row, x)).collect();
        if self.is_free {
            let (mut both, mut own) = (0.0, 0.0);
            for (idx, value) in values.iter().enumerate() {
                for (c, value) in value.iter().enumerate() {
                    let weight = self.trust[idx][c] * self.per_size[idx] * self.per_size[idx];
                    both += weight * value * self.means[idx].rgb[c];
                    own += weight * value * value;
                }
            }
            if both > 0.0 && own > 0.0 {
                self.nit = own / both;
            }
        }
        let misses: Vec<[f64; 3]> = values.iter().enumerate().map(|(idx, value)| self.misses(idx, *value)).collect();
        let sizes = misses.iter().flatten().map(|miss| miss.abs()).collect();
        let scale = CAUCHY * (SIGMA_PER_MEDIAN * median(sizes)).max(LEAST_SIGMA);
        for (idx, misses) in misses.iter().enumerate() {
            for (c, miss) in misses.iter().enumerate() {
                let is_beyond = self.means[idx].is_clipped[c] && *miss >= 0.0;
                self.trust[idx][c] = if is_beyond { 0.0 } else { 1.0 / (1.0 + (miss / scale).powi(2)) };
            }
        }
    }

    /// Root mean square of the misses, those of what was trusted.
    fn rms(&self, cells: &[Cell], layout: &Layout, x: &[f64]) -> f64 {
        let (mut sum, mut weights) = (0.0, 0.0);
        for (idx, cell) in cells.iter().enumerate() {
            let misses = self.misses(idx, layout.value(&cell.row, x));
            for (trust, miss) in self.trust[idx].iter().zip(misses) {
                sum += trust * miss * miss;
                weights += trust;
            }
        }
        if weights > 0.0 { (sum / weights).sqrt() } else { 0.0 }
    }

    pub fn outcome(&self, wish: &Wish, cells: &[Cell], layout: &Layout, x: &[f64]) -> Outcome {
        if self.is_black {
            let light = |x: &[f64]| cells.iter().map(|cell| luminance(layout.value(&cell.row, x)).abs()).sum::<f64>();
            return Outcome::of_black(&wish.name, [light(&layout.start), light(x)]);
        }
        let (before, reached) = (self.rms(cells, layout, &layout.start), self.rms(cells, layout, x));
        let mean_trust = self.trust.iter().flatten().sum::<f64>() / (3 * self.trust.len()).max(1) as f64;
        Outcome::of_picture(&wish.name, [before, reached].map(|rms| 100.0 * rms), -self.nit.log2(), mean_trust)
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// Solves the equations and matches the pictures.
pub(super) fn solve(
    base: &BoundedLeastSquares,
    matchings: &mut [Matching],
    cells: &[Cell],
    layout: &Layout,
    bounds: &[[f64; 2]],
) -> Result<Vec<f64>> {
    let mut x = layout.start.clone();
    for _ in 0..if matchings.is_empty() { 1 } else { MOST_ROUNDS } {
        let mut problem = base.clone();
        matchings.iter().for_each(|matching| matching.add(&mut problem, cells, layout));
        let next = problem.solve(&layout.start, bounds).context("the wishes cannot be solved")?;
        let largest = next.iter().fold(1e-3, |most: f64, x| most.max(*x));
        let is_settled = x.iter().zip(&next).all(|(old, new)| (old - new).abs() <= SETTLED * largest);
        x = next;
        matchings.iter_mut().for_each(|matching| matching.reweigh(cells, layout, &x));
        if is_settled {
            break;
        }
    }
    Ok(x)
}
