//! A case by all that a matrix goes through before it is used: a tolerance in place of a rank, a product that is kept, smoothing,
//! noise taken out between bundles, and bytes.

use std::sync::Arc;

use nalgebra::DMatrix;

use super::{Case, row_major, samples};
use crate::{
    codec::CodecError,
    compress::{ColumnGroup, CompressConfig, CompressError, Tolerance, compress_block},
    denoise::{Denoiser, Likeness},
    factors::{BlockFactors, power_of_two},
    low_rank::BlockLowRank,
    packed::{ColumnRun, PackPlan, PackedMatrix},
    partition::Partition,
    smooth::Smoothing,
};

/// Distance from the truth that is asked for, as a share of the norm: 30 dB.
pub const ASKED: f64 = 0.031_622_776_6;
/// Root mean square from which on a block is no weak one, over that of the case: half of the tolerance is left to it.
const STRONG: f64 = 2.0;

/// What becomes of a case, step by step. All are distances from the truth if nothing else is said.
#[derive(Clone, Debug, PartialEq)]
pub struct Stored {
    /// What is asked for.
    pub asked: f64,
    /// Components of the factors.
    pub rank: u32,
    /// Of the factors, their numbers rounded to eleven bits.
    pub error: f64,
    /// What the two halves tell of `error`.
    pub told: f64,
    /// After noise was taken out between bundles, all of which are said to be alike.
    pub denoised: f64,
    /// After it was packed, written, read and unpacked.
    pub unpacked: f64,
    /// Distance between the matrices before and after packing, as the packed one tells it.
    pub added: f64,
    /// Bytes that were written.
    pub n_bytes: usize,
}

/// Why a case does not get to its end.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum StoredError {
    /// It is not compressed.
    #[error(transparent)]
    Compress(#[from] CompressError),
    /// What was written cannot be read.
    #[error(transparent)]
    Codec(#[from] CodecError),
}

/// Every bundle is said to be like every other.
struct AllAlike(Vec<f32>);

impl Likeness for AllAlike {
    fn likeness(&self, _: u32, _: u32, out: &mut [f32]) {
        out.fill(1.0);
    }

    fn gains(&self, _: u32) -> &[f32] {
        &self.0
    }
}

/// Compresses a case to [`ASKED`] as one block, takes noise out of it, and packs and unpacks it. Before that it is brought to a
/// largest entry of about 1, as tolerances are mean squares, which in single precision end where entries of 1e±19 do.
///
/// # Errors
/// Samples that are not finite; bytes that do not come back.
pub fn stored(case: &Case) -> Result<Stored, StoredError> {
    let (case, unit) = &scaled(case);
    let (n_cols, entries) = (case.truth.ncols(), case.truth.len() as f64);
    let bundle_len = case.bundle_len as u32;
    let partition = partition((case.truth.nrows() / case.bundle_len) as u32);
    let [width, height] = sides(n_cols as u32);
    let (columns, preserved) = (vec![ColumnRun::Grid { width, height }], vec![1.0; n_cols]);
    let asked = ASKED * case.norm();
    let (allowed, strong) = ((asked * asked / entries) as f32, (STRONG * case.norm() / entries.sqrt()) as f32);
    let tolerance = Tolerance::AbsoluteMeanSquare(allowed);
    let group = ColumnGroup { columns: 0..n_cols, tolerance, preserved: preserved.clone(), share: 1.0, apart: 0.0 };
    let smoothing = Smoothing::new(partition.clone(), case.bundle_len, vec![columns.clone()]);
    let config = CompressConfig {
        groups: vec![group],
        strong,
        smoothing: Some(Arc::new(smoothing)),
        ..CompressConfig::default()
    };

    let halves = case.halves.each_ref().map(row_major);
    let mut sampled = BlockLowRank::new(partition.clone(), bundle_len, n_cols as u32);
    sampled.blocks[0] = compress_block(&samples(case, &halves), &config, 0)?.pop().map(Arc::new);
    let likeness = AllAlike(vec![1.0; case.bundle_len]);
    let denoiser = Denoiser {
        partition: &partition,
        bundle_len: case.bundle_len,
        preserved: vec![&preserved],
        likeness: &likeness,
    };
    let denoised = denoiser.all(std::slice::from_ref(&sampled), &|| true).expect("nobody says no").remove(0);
    let plan = PackPlan { columns: columns.clone(), allowed, strong, apart: 0.0, preserved: preserved.clone() };
    let mut bytes = Vec::new();
    PackedMatrix::pack(&denoised, &plan).encode(&mut bytes);
    let unpacked = PackedMatrix::decode(&bytes, partition.clone(), bundle_len, columns)?.0.unpack()?;

    let told =
        |matrix: &BlockLowRank| matrix.blocks.iter().flatten().map(|block| block.error).next().unwrap_or_default();
    let root = |mean_square: f32| (f64::from(mean_square).max(0.0) * entries).sqrt() * unit;
    let [error, of_denoised, of_unpacked] =
        [&sampled, &denoised, &unpacked].map(|matrix| distance(case, matrix) * unit);
    Ok(Stored {
        asked: asked * unit,
        rank: sampled.max_rank(),
        error,
        told: root(told(&sampled).truncation + told(&sampled).sampling),
        denoised: of_denoised,
        unpacked: of_unpacked,
        added: root(told(&unpacked).truncation - told(&denoised).truncation),
        n_bytes: bytes.len(),
    })
}

/// The case with its largest sample between 1 and 2, and the power of two by which it was divided.
fn scaled(case: &Case) -> (Case, f64) {
    let largest = case.halves.iter().flat_map(|half| half.iter()).fold(0.0f32, |largest, x| largest.max(x.abs()));
    let unit = if largest > 0.0 { power_of_two(f64::from(largest).log2().floor() as i32) } else { 1.0 };
    let divided = |matrix: &DMatrix<f32>| matrix.map(|x| (f64::from(x) / unit) as f32);
    let case = Case { truth: divided(&case.truth), halves: case.halves.each_ref().map(divided), ..case.clone() };
    (case, unit)
}

fn distance(case: &Case, matrix: &BlockLowRank) -> f64 {
    let dense: Vec<f32> = matrix.blocks.iter().flatten().flat_map(|block| BlockFactors::dense(block)).collect();
    let (n_rows, n_cols) = case.truth.shape();
    case.distance(&DMatrix::from_row_iterator(n_rows, n_cols, dense.into_iter().map(f64::from)))
}

/// One tile, as square as so many bundles can lie.
fn partition(n_bundles: u32) -> Partition {
    let [width, height] = sides(n_bundles);
    Partition { width, height, tile: width }
}

/// The most square grid of so many places, as wide as it is high or wider.
fn sides(n: u32) -> [u32; 2] {
    let height = (1..=n).take_while(|height| height * height <= n).filter(|height| n.is_multiple_of(*height)).last();
    let height = height.unwrap_or(1);
    [n / height, height]
}
