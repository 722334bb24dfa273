//! This crate's own method as one of many: `compress_block`, told every entry twice.

use nalgebra::DMatrix;

use super::{Approximation, real::Real};
use crate::{
    compress::{
        BlockSamples, ColumnGroup, CompressConfig, CompressError, Tolerance, check_samples, compress_block, unpacked,
    },
    means::Means,
};

/// Both halves are the matrix, as samples without noise are. It computes in `f32`, its eigenvalues in `f64`, and its
/// factors are packed, whatever the matrix's numbers are.
pub(super) fn projected<S: Real>(matrix: &DMatrix<S>, rank: usize, seed: u64) -> Approximation<S> {
    let (n_rows, n_cols) = matrix.shape();
    let row_major: Vec<f32> = matrix.transpose().iter().map(|x| x.to_f64() as f32).collect();
    let samples = BlockSamples { halves: [&row_major; 2], sparse: [&[]; 2], n_cols, bundle_len: 1, n_samples: [1; 2] };
    let tolerance = Tolerance::Rank(rank as u32);
    let groups = vec![ColumnGroup { columns: 0..n_cols, tolerance, preserved: Vec::new(), share: 1.0, apart: 0.0 }];
    let config = CompressConfig { groups, max_rank: rank as u32, seed, ..CompressConfig::default() };
    let found = compress_block(&samples, &config, 0).expect("whole rows of finite samples").swap_remove(0);
    let rank = found.rank as usize;
    let number = |x: f32| S::nearest(f64::from(x));
    let left = DMatrix::from_fn(n_rows, rank, |i, r| number(found.left[i * rank + r].to_f32() * found.scale[r]));
    let right = DMatrix::from_fn(rank, n_cols, |r, j| number(found.right[r * n_cols + j].to_f32()));
    Approximation::product(left, right)
}

/// This crate's own factors of a block as they were computed, in single precision: what
/// [`compress_block`](crate::compress_block()) rounds to 16 bits. One result per group of the config, without the entries that no low
/// rank holds.
///
/// # Errors
/// As [`compress_block`](crate::compress_block()).
pub fn unrounded(
    samples: &BlockSamples<'_>,
    config: &CompressConfig,
    block_idx: u32,
) -> Result<Vec<Approximation<f32>>, CompressError> {
    check_samples(samples, config, block_idx)?;
    let mut means = Means::default();
    let group = |group: &ColumnGroup| -> Result<Approximation<f32>, CompressError> {
        let found = unpacked(samples, group, config, block_idx, &mut means)?;
        let (left, right) = (&found.left, &found.right);
        let scaled: Vec<f32> = left.data.iter().map(|&x| (f64::from(x) * found.unit) as f32).collect();
        let left = DMatrix::from_row_slice(left.n_rows, left.n_cols, &scaled);
        Ok(Approximation::product(left, DMatrix::from_row_slice(right.n_rows, right.n_cols, &right.data)))
    };
    config.groups.iter().map(group).collect()
}
