//! Factors are never further from the truth than what was sampled, as far as two halves can tell.

use std::sync::Arc;

use rayon::prelude::*;

use crate::{random::Random, *};

const SIDE: usize = 8;
const BUNDLE: usize = 3;
const N_ROWS: usize = BUNDLE * SIDE * SIDE;
const N_COLS: usize = SIDE * SIDE;
const N_RECIPES: u64 = 400;

/// A matrix that is smooth but for peaks, one in each row of some, each in a column of its own.
#[derive(Clone, Copy)]
struct Recipe {
    /// Height of the peaks over what is smooth.
    peak: f32,
    /// Share of the rows that have one.
    share: f64,
    /// Standard deviation of a half's noise.
    noise: f32,
    /// Share of a half's entries that are rare large samples, and how large those are.
    rare: (f64, f32),
    seed: u64,
}

/// So many of them, those with high peaks and rare large samples among them.
fn recipes(n: u64) -> impl Iterator<Item = Recipe> {
    (0..n).map(|seed| {
        let rng = &mut Random::new([seed, 80]);
        let mut up_to = |most: f64| most * rng.unit();
        let (peak, share, noise) = (up_to(12.0) as f32, up_to(1.0), 0.02 + up_to(1.5) as f32);
        Recipe { peak, share, noise, rare: (up_to(0.003), up_to(30.0) as f32), seed }
    })
}

impl Recipe {
    fn truth(&self) -> Vec<f32> {
        let rng = &mut Random::new([self.seed, 81]);
        let columns = rng.choose(&(0..N_COLS).collect::<Vec<_>>(), N_COLS);
        let has_peak: Vec<bool> = (0..SIDE * SIDE).map(|_| rng.unit() < self.share).collect();
        let entry = |at: usize| {
            let (bundle, col) = (at / N_COLS / BUNDLE, at % N_COLS);
            let (x, y) = ((bundle % SIDE) as f32, (bundle / SIDE) as f32);
            let (u, v) = ((col % SIDE) as f32, (col / SIDE) as f32);
            let smooth = 1.0 / (1.0 + 0.05 * ((x - u).powi(2) + (y - v).powi(2)));
            smooth + if has_peak[bundle] && columns[bundle] == col { self.peak } else { 0.0 }
        };
        (0..N_ROWS * N_COLS).map(entry).collect()
    }

    fn half(&self, truth: &[f32], which: u64) -> Vec<f32> {
        let rng = &mut Random::new([self.seed, 82 + which]);
        let mut entry = |x: &f32| {
            let rare = if rng.unit() < self.rare.0 { self.rare.1 } else { 0.0 };
            x + self.noise * rng.normal() + rare
        };
        truth.iter().map(&mut entry).collect()
    }
}

fn compressed([a, b]: [&[f32]; 2], preserved: Vec<f32>) -> BlockFactors {
    let grid = vec![ColumnRun::Grid { width: SIDE as u32, height: SIDE as u32 }];
    let partition = Partition { width: SIDE as u32, height: SIDE as u32, tile: SIDE as u32 };
    let tolerance = Tolerance::AbsoluteMeanSquare(1e-4);
    let group = ColumnGroup { columns: 0..N_COLS, tolerance, preserved, share: 1.0, apart: 0.0 };
    let smoothing = Some(Arc::new(Smoothing::new(partition, BUNDLE, vec![grid])));
    let config = CompressConfig { groups: vec![group], smoothing, ..CompressConfig::default() };
    let samples =
        BlockSamples { halves: [a, b], sparse: [&[]; 2], n_cols: N_COLS, bundle_len: BUNDLE, n_samples: [1; 2] };
    compress_block(&samples, &config, 0).unwrap().remove(0)
}

fn distance(values: &[f32], truth: &[f32]) -> f64 {
    values.iter().zip(truth).map(|(x, t)| f64::from(x - t).powi(2)).sum()
}

/// Squared distance to the truth over that of the samples' mean, of all recipes: of the factors, and of their rows' sums.
fn over_sampled() -> Vec<[f64; 2]> {
    let ratio = |recipe: Recipe| {
        let truth = recipe.truth();
        let [a, b] = [0, 1].map(|which| recipe.half(&truth, which));
        let sampled: Vec<f32> = a.iter().zip(&b).map(|(a, b)| 0.5 * (a + b)).collect();
        let found = compressed([&a, &b], vec![1.0; N_COLS]).dense();
        let sums = |values: &[f32]| values.chunks_exact(N_COLS).map(|row| row.iter().sum()).collect::<Vec<f32>>();
        let of_sums = distance(&sums(&found), &sums(&truth)) / distance(&sums(&sampled), &sums(&truth));
        [distance(&found, &truth) / distance(&sampled, &truth), of_sums]
    };
    recipes(N_RECIPES).collect::<Vec<_>>().into_par_iter().map(ratio).collect()
}

#[test]
fn factors_are_never_worse_than_what_was_sampled() {
    let ratios = over_sampled();
    let n_worse = ratios.iter().filter(|ratio| ratio[0] > 1.0).count();
    let worst = ratios.iter().map(|ratio| ratio[0]).fold(0.0, f64::max);
    assert!(n_worse == 0, "{n_worse} are worse, one {worst} times");
    // Under all columns together it is what was sampled, but for sixteen bits.
    let of_sums = ratios.iter().map(|ratio| ratio[1]).fold(0.0, f64::max);
    assert!(of_sums < 1.02, "{of_sums}");
}

/// Smooth columns, in a few of which there are rare samples that are far larger than all else: what is quiet is not dropped for them.
#[test]
fn most_columns_are_never_worse_than_what_was_sampled() {
    let median = |seed: u64| {
        let rng = &mut Random::new([seed, 83]);
        let slopes: Vec<[f32; 2]> = (0..N_COLS).map(|_| [rng.unit() as f32, rng.unit() as f32]).collect();
        let entry = |at: usize| {
            let (bundle, col) = (at / N_COLS / BUNDLE, at % N_COLS);
            let [x, y] = [bundle % SIDE, bundle / SIDE].map(|place| place as f32 / SIDE as f32);
            0.5 + slopes[col][0] * x + slopes[col][1] * y * x
        };
        let truth: Vec<f32> = (0..N_ROWS * N_COLS).map(entry).collect();
        let mut sample = |at: usize, x: &f32| {
            let rare = if (at % N_COLS).is_multiple_of(32) && rng.unit() < 0.02 { 60.0 } else { 0.0 };
            x + rare + 0.2 * rng.normal()
        };
        let [a, b] = [(); 2].map(|()| truth.iter().enumerate().map(|(at, x)| sample(at, x)).collect::<Vec<f32>>());
        let sampled: Vec<f32> = a.iter().zip(&b).map(|(a, b)| 0.5 * (a + b)).collect();
        let found = compressed([&a, &b], vec![1.0; N_COLS]).dense();
        let column =
            |values: &[f32], col: usize| -> Vec<f32> { values.iter().skip(col).step_by(N_COLS).copied().collect() };
        let squares = |values: &[f32], col: usize| distance(&column(values, col), &column(&truth, col));
        let mut ratios: Vec<f64> = (0..N_COLS).map(|col| squares(&found, col) / squares(&sampled, col)).collect();
        ratios.sort_by(f64::total_cmp);
        ratios[N_COLS / 2]
    };
    let medians: Vec<f64> = (0..40).into_par_iter().map(median).collect();
    assert!(medians.iter().all(|median| *median < 1.0), "{medians:?}");
    assert!(medians.iter().sum::<f64>() < 0.4 * 40.0, "{medians:?}");
}
