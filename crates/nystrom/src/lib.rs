//! Compresses a matrix that can only be sampled, block by block.
//!
//! Somebody implements [`SampledMatrix`]: entries are estimates, rows are asked for in bundles, and the same question gets the
//! same answer. [`compress()`] samples two independent halves of each block of a [`Partition`] until a [`Tolerance`] is met (what
//! one half sees decides when the *other* one stops, so that stopping is no bias), and hands on [`BlockFactors`]: `left · diag(scale) · right + sparse`, with a rank of each block's own and three measured errors.
//! The factors are fitted to all samples; for the figures each half is fitted by itself and examined by the other, so
//! what is *held out* is the other half. The figures are a little cautious: a fit to half of the samples is a little worse.
//! Columns that are kept as they were sampled ([`CompressConfig::verbatim`]) have no fit: their error is the noise of the halves.
//! [`BlockLowRank`] holds all blocks and multiplies; [`codec`] turns a block into bytes as it is, [`PackedMatrix`] all of them into
//! a tenth as many.
//!
//! Apart from all that, [`bounded`] finds least squares within bounds, for those who ask which vector makes a product what they wish.
//!
//! It knows neither what rows and columns mean nor where samples come from; it opens no file, prints nothing, and leaves no
//! thread behind. The dense matrix never exists as a whole: a few copies of one block per thread are all there is.
//!
//! **Decision.** The core is *projected*. Landmark rows, chosen by k-means as in the algorithms this crate grew from
//! ([`Selection`]), span the space of rows; all rows are met with an orthonormal basis of that span, and a small decomposition
//! finds the components that both halves confirm. **Refused:** the classic Nyström core `C · W⁺ · R` \[Drineas2005\], also after a
//! nonlinear map of the entries \[Wang2009\]. The intersection W of chosen rows and columns is singular as soon as two of them
//! are alike, and with noise its inverse multiplies it without bound; [`rivals`] keeps it, among all methods of the field, for comparison.
//! (The "Block-Nyström" of \[Garg2025\] averages several small approximations of one positive kernel: another method
//! of the same name.)
//!
//! ```
//! use clerestory_nystrom::*;
//! use std::ops::{ControlFlow, Range};
//!
//! /// Rank one, without noise.
//! struct Products;
//! impl SampledMatrix for Products {
//!     fn n_rows(&self) -> usize { 64 }
//!     fn n_cols(&self) -> usize { 10 }
//!     fn bundle_len(&self) -> usize { 1 }
//!     fn add_rows(&self, bundles: &[u32], samples: Range<u32>, _: Half, out: &mut [f32], _: &mut Vec<SparseEntry>) {
//!         for (row, out) in bundles.iter().zip(out.chunks_mut(10)) {
//!             out.iter_mut().enumerate().for_each(|(col, x)| *x += (samples.len() * (*row as usize + 1) * (col + 1)) as f32);
//!         }
//!     }
//! }
//!
//! let partition = Partition { width: 8, height: 8, tile: 4 };
//! let group = ColumnGroup { columns: 0..10, tolerance: Tolerance::RelativeFrobenius(1e-2), preserved: Vec::new(), share: 1.0, apart: 0.0 };
//! let config = CompressConfig { groups: vec![group], ..Default::default() };
//! let mut matrix = BlockLowRank::new(partition.clone(), 1, 10);
//! compress(&Products, &partition, &[0, 1, 2, 3], &config, |block, mut factors| {
//!     matrix.blocks[block as usize] = factors.pop().map(Into::into);
//!     ControlFlow::Continue(())
//! })?;
//! assert_eq!(matrix.max_rank(), 1);
//! assert!((matrix.apply(&[1.0; 10])[63] / (64.0 * 55.0) - 1.0).abs() < 1e-3);
//! # Ok::<(), CompressError>(())
//! ```

mod basis;
pub mod bounded;
pub mod codec;
mod column_errors;
pub mod compress;
mod cosine;
pub mod denoise;
mod dense;
pub mod enlarge;
pub mod factors;
mod fit;
mod growth;
mod kmeans;
pub mod landmarks;
#[cfg(test)]
mod laws;
mod level;
pub mod low_rank;
pub mod matrix;
mod means;
mod measure;
pub mod packed;
pub mod partition;
mod parts;
mod preserve;
mod product;
mod project;
mod random;
pub mod rivals;
mod run;
mod sketch;
mod small_product;
pub mod smooth;
mod sparse;
pub mod spectrum;
mod steer;
pub mod stress;
mod sums;
mod unpacked;
mod vector;

pub use bounded::{BoundedError, BoundedLeastSquares};
pub use codec::{CodecError, decode_block, encode_block};
pub use compress::{
    BlockSamples, ColumnGroup, CompressConfig, CompressError, Guide, NoisyColumns, SamplePlan, Tolerance, compress,
    compress_block, compress_by,
};
pub use denoise::{Denoiser, Likeness};
pub use enlarge::{Teller, Tellers, enlarged};
pub use factors::{BlockError, BlockFactors};
pub use landmarks::{Landmarks, Selection};
pub use low_rank::BlockLowRank;
pub use matrix::{Half, SampledMatrix, SparseEntry};
pub use packed::{ColumnRun, PackPlan, PackedMatrix, PackedProduct};
pub use partition::Partition;
pub use smooth::Smoothing;
