//! What smoothing promises.

use std::sync::Arc;

use super::*;
use crate::{
    compress::{CompressConfig, Tolerance, compress_block},
    factors::BlockFactors,
};

const WIDTH: usize = 16;
const N_ROWS: usize = 3 * WIDTH * WIDTH;
const N_COLS: usize = 64 + 5;

/// A smooth bump for every column of a grid, times uneven rows with a sharp edge, and five more columns.
fn signal() -> Vec<f32> {
    let entry = |at: usize| {
        let (row, col) = (at / N_COLS, at % N_COLS);
        let (x, y, nth) = ((row / 3 % WIDTH) as f32, (row / 3 / WIDTH) as f32, (row % 3) as f32);
        let ground = if x < 5.0 { 1.0 } else { 0.4 } * (1.0 + 0.2 * nth);
        let (u, v) = ((col % 8) as f32, (col / 8) as f32);
        if col < 64 { ground / (1.0 + 0.02 * ((x - 2.0 * u).powi(2) + (y - 2.0 * v).powi(2))) } else { ground * u }
    };
    (0..N_ROWS * N_COLS).map(entry).collect()
}

fn noisy(values: &[f32], noise: f32, seed: u64) -> Vec<f32> {
    let mut rng = Random::new([60, seed]);
    values.iter().map(|x| x + noise * rng.normal()).collect()
}

fn smoothing() -> Smoothing {
    let partition = Partition { width: 32, height: 16, tile: 16 };
    Smoothing::new(partition, 3, vec![vec![ColumnRun::Grid { width: 8, height: 8 }, ColumnRun::List(5)]])
}

fn compressed(halves: [&[f32]; 2], smoothing: Option<Smoothing>, preserved: Vec<f32>) -> BlockFactors {
    let samples = BlockSamples { halves, sparse: [&[]; 2], n_cols: N_COLS, bundle_len: 3, n_samples: [1; 2] };
    let group = ColumnGroup {
        columns: 0..N_COLS,
        tolerance: Tolerance::AbsoluteMeanSquare(1e-4),
        preserved,
        share: 1.0,
        apart: 0.0,
    };
    let smoothing = smoothing.map(Arc::new);
    let config = CompressConfig { groups: vec![group], smoothing, ..CompressConfig::default() };
    compress_block(&samples, &config, 1).unwrap().swap_remove(0)
}

fn mean_square(factors: &BlockFactors, truth: &[f32]) -> f64 {
    let squares = factors.dense().into_iter().zip(truth).map(|(x, t)| f64::from(x - t).powi(2));
    squares.sum::<f64>() / truth.len() as f64
}

#[test]
fn noise_goes_and_what_both_halves_know_stays() {
    let truth = signal();
    let [a, b] = [1, 2].map(|seed| noisy(&truth, 0.5, seed));
    let errors = [None, Some(smoothing())].map(|smoothing| {
        let factors = compressed([&a, &b], smoothing, Vec::new());
        let told = f64::from(factors.error.truncation + factors.error.sampling);
        let error = mean_square(&factors, &truth);
        assert!((0.7..1.4).contains(&(told / error)), "{told} {error}");
        error
    });
    assert!(errors[1] < 0.35 * errors[0], "{errors:?}");
}

#[test]
fn where_nothing_is_smooth_nothing_is_lost() {
    // Random rows times random columns: neighbors have nothing to do with each other.
    let mut rng = Random::new([61, 0]);
    let mut values = |count: usize| (0..count).map(|_| rng.normal()).collect::<Vec<f32>>();
    let (left, right) = (values(2 * N_ROWS), values(2 * N_COLS));
    let truth = BlockFactors::from_f32(&left, &right, N_ROWS, N_COLS, 2).dense();
    let [a, b] = [1, 2].map(|seed| noisy(&truth, 0.5, seed));
    let errors = [None, Some(smoothing())].map(|s| mean_square(&compressed([&a, &b], s, Vec::new()), &truth));
    assert!(errors[1] <= 1.02 * errors[0], "{errors:?}");
}

#[test]
fn without_noise_factors_are_the_same_bit_by_bit() {
    let truth = signal();
    let [with, without] = [Some(smoothing()), None].map(|s| compressed([&truth; 2], s, vec![1.0; N_COLS]));
    assert_eq!(with, without);
}

#[test]
fn the_preserved_product_comes_out_as_it_was_sampled() {
    let truth = signal();
    let [a, b] = [1, 2].map(|seed| noisy(&truth, 0.5, seed));
    let product = compressed([&a, &b], Some(smoothing()), vec![1.0; N_COLS]).apply(&[1.0; N_COLS]);
    for (row, got) in product.into_iter().enumerate() {
        let sampled: f32 = (0..N_COLS).map(|col| 0.5 * (a[row * N_COLS + col] + b[row * N_COLS + col])).sum();
        assert!((got - sampled).abs() < 0.02 * sampled.abs().max(5.0), "{row}: {got} {sampled}");
    }
}

#[test]
fn what_no_sample_found_anything_for_stays_zero() {
    let is_empty = |at: usize| at / N_COLS / 3 % WIDTH + at / N_COLS / 3 / WIDTH < 9;
    let half = |seed: u64| -> Vec<f32> {
        let values = noisy(&signal(), 0.5, seed).into_iter().enumerate();
        values.map(|(at, x)| if is_empty(at) { 0.0 } else { x }).collect()
    };
    let [a, b] = [1, 2].map(half);
    let [plain, smooth] = [None, Some(smoothing())].map(|smoothing| compressed([&a, &b], smoothing, Vec::new()));
    assert!(smooth != plain, "nothing was smoothed");
    assert!(smooth.dense().iter().enumerate().all(|(at, x)| !is_empty(at) || *x == 0.0));
}

#[test]
fn a_smoothing_for_another_matrix_is_refused() {
    let truth = signal();
    let samples =
        BlockSamples { halves: [&truth; 2], sparse: [&[]; 2], n_cols: N_COLS, bundle_len: 3, n_samples: [1; 2] };
    let group = |n: usize| ColumnGroup {
        columns: 0..n,
        tolerance: Tolerance::AbsoluteMeanSquare(1.0),
        preserved: Vec::new(),
        share: 1.0,
        apart: 0.0,
    };
    for (block_idx, bundle_len, n) in [(2, 3, N_COLS), (0, 1, N_COLS), (0, 3, N_COLS - 1)] {
        let config = CompressConfig {
            groups: vec![group(n)],
            smoothing: Some(Arc::new(smoothing())),
            ..CompressConfig::default()
        };
        let samples = BlockSamples { bundle_len, ..samples };
        assert!(matches!(compress_block(&samples, &config, block_idx), Err(CompressError::Config(_))));
    }
}
