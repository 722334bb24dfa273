//! Every device there is against the CPU, over ranks, odd sizes and many bindings. What stages have not written is no number
//! in tests, so nothing that was forgotten passes for a zero.

use super::chunk::ChunkLimits;
use super::tests::{assert_precise_twins_agree, assert_twins_agree, gpu, n_required, relit};
use super::*;
use crate::CpuRelighter;
use crate::packing::Precision;
use crate::packing::tests::falling;
use crate::synthetic::{Ranks, Recipe};

/// All that run here, on a second driver, too, where there is one.
pub(super) fn gpus() -> Vec<Gpu> {
    let Some(first) = gpu() else { return Vec::new() };
    let others = adapters(DeviceChoice::Any).into_iter().skip(1).filter_map(|adapter| Gpu::open(&adapter).ok());
    let gpus: Vec<Gpu> = std::iter::once(first).chain(others).collect();
    assert!(gpus.len() >= n_required(), "{} of {} devices are there", gpus.len(), n_required());
    gpus
}

#[test]
fn every_device_agrees_with_the_cpu_at_every_rank() {
    for gpu in gpus() {
        for rank in [0, 1, 2, 3, 7, 8, 15, 16, 31, 33, 63, 64] {
            let (width, height) = (17 + rank % 5, 1 + rank % 19);
            let seed = 100 + u64::from(rank);
            let n_cols = vec![1 + 37 * (rank % 4), 1 + rank % 3];
            let (rank, n_sparse) = (Ranks::Fixed(rank), rank % 5);
            let recipe =
                Recipe { width, height, tile: 16, n_cols, rank, n_sparse, is_positive: false, truncation: 0.0, seed };
            let frame = recipe.frame();
            let mut relighter = GpuRelighter::new(&gpu, &frame).unwrap();
            let mut x = recipe.coefficients(seed);
            assert_twins_agree(&mut relighter, &frame, &x);
            x[0][0] = [0.25, 0.0, 3.0];
            assert_twins_agree(&mut relighter, &frame, &x);
        }
    }
}

#[test]
fn every_device_agrees_with_the_cpu_on_bytes() {
    for gpu in gpus() {
        for rank in [1, 2, 3, 5, 8, 13, 32] {
            let n_cols = vec![1 + 37 * (rank % 4), 140, 1 + rank % 3];
            let (n_sparse, seed) = (rank % 5, 100 + u64::from(rank));
            let rank = Ranks::Fixed(rank);
            let recipe = Recipe { width: 51, height: 33, n_cols, rank, n_sparse, seed, ..Recipe::default() };
            let frame = falling(&recipe);
            let limits = (ChunkLimits { n_blocks: 5, n_bytes: 1 << 20 }, Precision::ByError);
            let mut relighter = GpuRelighter::with_limits(&gpu, &frame, limits).unwrap();
            let halves = GpuRelighter::new(&gpu, &frame).unwrap().device_bytes();
            let whole = GpuRelighter::with_precision(&gpu, &frame, Precision::ByError).unwrap().device_bytes();
            assert!(whole < halves || rank == Ranks::Fixed(1), "{whole} bytes instead of {halves}");
            let mut x = recipe.coefficients(seed);
            assert_precise_twins_agree(&mut relighter, &frame, Precision::ByError, &x);
            x[1][139] = [0.25, 0.0, 3.0];
            assert_precise_twins_agree(&mut relighter, &frame, Precision::ByError, &x);
        }
    }
}

#[test]
fn every_device_agrees_with_the_cpu_over_bindings_of_any_size() {
    for gpu in gpus() {
        for (seed, n_bytes) in [(1, 8 << 10), (2, 12 << 10), (3, 40 << 10), (4, 1 << 20)] {
            for n_blocks in [1, 2, 5, 128] {
                let recipe = Recipe {
                    width: 51,
                    height: 33,
                    n_cols: vec![23, 140],
                    rank: Ranks::Mixed(12),
                    seed,
                    ..Recipe::default()
                };
                let frame = recipe.frame();
                let limits = (ChunkLimits { n_blocks, n_bytes }, Precision::Halves);
                let mut relighter = GpuRelighter::with_limits(&gpu, &frame, limits).unwrap();
                let mut x = recipe.coefficients(seed);
                assert_twins_agree(&mut relighter, &frame, &x);
                x[1][139] = [2.0, 1.0, 0.0];
                assert_twins_agree(&mut relighter, &frame, &x);
            }
        }
    }
}

#[test]
fn every_device_agrees_with_the_cpu_on_factors_of_any_scale() {
    for gpu in gpus() {
        for exponent in [-80, -40, 40, 80] {
            let recipe = Recipe { n_cols: vec![140, 3], rank: Ranks::Mixed(17), n_sparse: 0, ..Recipe::default() };
            let mut frame = recipe.frame();
            for block in frame.groups.iter_mut().flat_map(|group| group.blocks.iter_mut().flatten()) {
                std::sync::Arc::make_mut(block).scale.iter_mut().for_each(|scale| *scale *= 2f32.powi(exponent));
            }
            let mut relighter = GpuRelighter::new(&gpu, &frame).unwrap();
            let x = recipe.coefficients(9);
            let (found, expected) = (relit(&mut relighter, &x), relit(&mut CpuRelighter::new(&frame).unwrap(), &x));
            let values = || found.pixels.as_flattened().iter().zip(expected.pixels.as_flattened());
            let largest = values().fold(0f32, |most, (_, b)| most.max(b.abs()));
            assert!(largest > 2f32.powi(exponent) && largest.is_finite());
            for (a, b) in values() {
                assert!((a - b).abs() <= 1e-5 * largest, "2^{exponent}: {a} on the GPU, {b} on the CPU");
            }
        }
    }
}
