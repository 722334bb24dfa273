//! The seam: a matrix that is never stored, only sampled.
//!
//! Entries are Monte Carlo estimates. A caller says which rows, which of a row's independent samples, and which of two
//! independent halves; the same question always gets the same answer. Rows that are asked for together may have noise in
//! common within a half, so that a row's answer depends on the others of its question.

use std::ops::Range;

/// One of two statistically independent sets of samples of the same matrix.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Half {
    /// The first half.
    A,
    /// The second half.
    B,
}

/// An entry that no low rank holds, kept by itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SparseEntry {
    /// Row, counted from the first row of the block it belongs to.
    pub row: u32,
    /// Column, counted from the first column of its group.
    pub col: u32,
    /// Value.
    pub value: f32,
}

/// A matrix whose rows can be sampled. Rows come in *bundles*: runs of [`SampledMatrix::bundle_len`] consecutive rows
/// that are sampled together at the cost of one.
pub trait SampledMatrix: Sync {
    /// Number of rows; a multiple of [`SampledMatrix::bundle_len`].
    fn n_rows(&self) -> usize;
    /// Number of columns.
    fn n_cols(&self) -> usize;
    /// Number of rows in a bundle, at least 1.
    fn bundle_len(&self) -> usize;
    /// Whether, within a half, what more samples take away of the noise of those of some bundles that are on white squares of a
    /// chessboard (the grid of a [`Partition`](crate::Partition)) is independent of that of those on black ones, and nowhere rare
    /// and great: then few samples may be enough, see [`SamplePlan`](crate::SamplePlan).
    fn colors_are_independent(&self, _bundles: &[u32]) -> bool {
        false
    }

    /// Adds the *sum* of the estimates `samples` of each row of `bundles` to `out`.
    ///
    /// `out` is row-major, `bundles.len() · bundle_len()` rows × `n_cols` columns, in the order of `bundles`. Entries that
    /// no low rank holds go to `sparse` instead (row counted within `out`, column within the matrix, value a part of the
    /// same sum; one entry may appear several times).
    fn add_rows(
        &self,
        bundles: &[u32],
        samples: Range<u32>,
        half: Half,
        out: &mut [f32],
        sparse: &mut Vec<SparseEntry>,
    );
}
