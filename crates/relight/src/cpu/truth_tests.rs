//! Every kernel that runs here against sums in double precision, at every rank and at odd sizes, into outputs that are no numbers.

use super::tests::{assert_near, dense};
use super::*;
use crate::packing::tests::{falling, frame_in_halves};
use crate::synthetic::{Ranks, Recipe};

fn recipe(rank: u32) -> Recipe {
    let n_cols = vec![1 + 47 * (rank % 7), 1 + rank % 3];
    let (width, height) = (17 + rank % 5, 1 + rank % 23);
    let (rank, n_sparse, seed) = (Ranks::Fixed(rank), rank % 5, 70 + u64::from(rank));
    Recipe { width, height, n_cols, tile: 16, rank, n_sparse, is_positive: false, truncation: 0.0, seed }
}

/// Into a picture of the right size whose pixels are no numbers, so that one which is forgotten is found.
fn relit(relighter: &mut CpuRelighter, x: &[Vec<[f32; 3]>]) -> Vec<[f32; 3]> {
    let mut out = Radiance::new(relighter.frame.width, relighter.frame.height);
    out.pixels.fill([f32::NAN; 3]);
    relighter.relight(x, &mut out).unwrap();
    out.pixels
}

#[test]
fn every_kernel_equals_the_dense_matrix_at_every_rank() {
    for rank in 0..=64 {
        let recipe = recipe(rank);
        let (frame, x) = (recipe.frame(), recipe.coefficients(u64::from(rank)));
        let expected = dense(&frame, &x);
        for kernel in Kernel::all() {
            let mut relighter = CpuRelighter::with_kernel(&frame, kernel, Precision::Halves).unwrap();
            assert_near(&relit(&mut relighter, &x), &expected, 3e-6);
        }
    }
}

#[test]
fn every_kernel_reads_bytes_as_the_whole_numbers_that_they_are() {
    for rank in [1, 2, 3, 4, 5, 7, 8, 11, 16, 33, 64] {
        let recipe = Recipe { width: 70, height: 41, ..recipe(rank) };
        let (frame, x) = (falling(&recipe), recipe.coefficients(u64::from(rank)));
        let expected = dense(&frame_in_halves(&frame), &x);
        for kernel in Kernel::all() {
            let mut relighter = CpuRelighter::with_kernel(&frame, kernel, Precision::ByError).unwrap();
            assert_near(&relit(&mut relighter, &x), &expected, 3e-6);
            let mut halves = CpuRelighter::with_kernel(&frame, kernel, Precision::Halves).unwrap();
            relit(&mut halves, &x);
            let [few, many] = [relighter.stats().n_bytes, halves.stats().n_bytes];
            assert!(10 * few < 9 * many && 2 * few > many, "rank {rank}: {few} bytes instead of {many}");
        }
    }
}

#[test]
fn what_moves_as_a_whole_again_and_again_equals_a_fresh_picture_by_every_kernel() {
    for (kernel, precision) in Kernel::all().into_iter().flat_map(|k| [(k, Precision::Halves), (k, Precision::ByError)])
    {
        for rank in [0, 1, 2, 3, 5, 31] {
            let recipe = Recipe { n_cols: vec![300, 20], n_sparse: 2, ..recipe(rank) };
            let frame = falling(&recipe);
            let mut relighter = CpuRelighter::with_kernel(&frame, kernel, precision).unwrap();
            let mut x = recipe.coefficients(1);
            for step in 0..12 {
                // One group, both, one column, and the same again.
                match step % 6 {
                    0..=2 => x[0].clone_from(&recipe.coefficients(step)[0]),
                    3 => x = recipe.coefficients(step),
                    4 => x[1][7] = [step as f32, 0.5, 0.25],
                    _ => {}
                }
                let fresh = relit(&mut CpuRelighter::with_kernel(&frame, kernel, precision).unwrap(), &x);
                assert_eq!(relit(&mut relighter, &x), fresh, "{kernel:?}, rank {rank}, step {step}");
            }
        }
    }
}

#[test]
fn columns_without_light_are_not_read() {
    let recipe = Recipe { n_cols: vec![300], n_sparse: 0, ..recipe(9) };
    let frame = recipe.frame();
    let n_left: u64 = frame.groups[0].blocks.iter().flatten().map(|block| 2 * block.left.len() as u64).sum();
    let n_blocks = frame.partition().n_blocks() as u64;
    for kernel in Kernel::all() {
        let mut relighter = CpuRelighter::with_kernel(&frame, kernel, Precision::Halves).unwrap();
        // Sixteen columns lie together, and of the last segment twelve are left.
        for (cols, n_read) in [([3, 15], 16), ([3, 16], 32), ([200, 299], 28)] {
            let mut x = vec![vec![[0.0; 3]; 300]];
            cols.iter().for_each(|col| x[0][*col] = [0.5, 1.0, 2.0]);
            relighter.cached = vec![None];
            assert_near(&relit(&mut relighter, &x), &dense(&frame, &x), 3e-6);
            assert_eq!(relighter.stats().n_bytes, n_left + n_blocks * 9 * 2 * n_read, "{kernel:?}, {cols:?}");
        }
    }
}
