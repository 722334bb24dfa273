//! A compressed matrix as few bytes: what remains of each block's factors after a cosine transform, rounded to a common step
//! and entropy-coded.
//!
//! A block's left factors are pictures of its tile, its right factors often pictures of a grid of columns: smooth for the
//! most part. Orthogonal components are transformed along the rows and columns of their grids \[Ahmed1974\], rounded so that the
//! error asked for is just met, and coded \[Duda2013\] with tables that the whole matrix shares, each coefficient under the
//! magnitude of its known neighbors. One product (that with [`PackPlan::preserved`]) is kept apart, to a share of itself. Blocks can
//! be read alone, and each bears a checksum.
//!
//! **Decision.** Bytes on disk are not bytes in memory: [`PackedMatrix::unpack`] gives factors in `f16`. **Refused:** vectors of few
//! bits that could be used as they lie; they take three to six times the room.

mod block;
mod bytes;
mod coder;
mod cosine;
mod entries;
mod kept;
mod layout;
mod orthogonal;
mod planes;
mod quantize;
mod tables;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use rayon::prelude::*;

use self::{
    block::{N_TABLES, RoundedBlock},
    coder::{Counter, Decoder, Encoder},
    kept::Kept,
    layout::Layout,
    orthogonal::{product_with, squared_difference},
    quantize::{Coefficients, Rounded, quarters_between, restore, step_of},
    tables::Tables,
};
use crate::{codec::CodecError, compress::shade, factors::BlockFactors, low_rank::BlockLowRank, partition::Partition};

pub use layout::ColumnRun;

/// Share of a block's own error, or of what is allowed, that storing may add where sampling has used up all of it.
const LEAST_SHARE: f64 = 0.07;
/// How much worse than allowed a single block may be stored: 4 dB.
const WORST_BLOCK: f64 = 2.5;
/// Octaves in quarters that such a block may be finer than the others.
const FINEST: i32 = -60;
/// Blocks that tell how fine the common step and the tables are.
const N_TELLING: usize = 1024;
/// Steps of the search for the common step, each half as wide as the one before.
const N_HALVINGS: usize = 14;
/// Corrections of that step, and about the power of the error that it goes with.
const N_CORRECTIONS: usize = 2;
const STEP_PER_ERROR: f64 = 0.6;

/// How a matrix is packed.
#[derive(Clone, Debug, PartialEq)]
pub struct PackPlan {
    /// How the columns lie.
    pub columns: Vec<ColumnRun>,
    /// Mean square error per entry at which the matrix aims, in all: truncation, sampling and packing.
    pub allowed: f32,
    /// As [`CompressConfig::bright`](crate::CompressConfig::bright): darker blocks are stored more finely.
    pub bright: f32,
    /// One weight per column: the product with these weights is kept to a share of itself, or of its noise, whatever is
    /// allowed. Empty: no product is.
    pub preserved: Vec<f32>,
}

/// A matrix, or one group of its columns, as bytes.
#[derive(Clone, Debug)]
pub struct PackedMatrix {
    layout: Layout,
    partition: Partition,
    tables: Tables,
    /// Step of the coefficients; 0 where no block has any.
    step: f32,
    /// The direction whose product is kept, of length 1; empty if there is none.
    direction: Vec<f32>,
    /// One per block of the partition; a block that is not there has no bytes.
    blocks: Vec<Arc<[u8]>>,
}

impl PackedMatrix {
    /// Packs what is there of a matrix. The errors that blocks bear grow by what packing costs them.
    pub fn pack(matrix: &BlockLowRank, plan: &PackPlan) -> Self {
        let layout = Layout::new(matrix.partition.clone(), matrix.bundle_len, plan.columns.clone());
        assert!(
            layout.n_cols() == matrix.n_cols as usize,
            "a plan for {} columns cannot pack {}",
            layout.n_cols(),
            matrix.n_cols
        );
        let packer = Packer::new(matrix, &layout, plan);
        let step = packer.common_step();
        let tables = packer.tables(step);
        let block = |block_idx: usize| -> Arc<[u8]> {
            match packer.rounded(block_idx, step) {
                Some(rounded) => {
                    let mut out = Encoder::new(&tables);
                    rounded.write(block_idx, &layout, &mut out);
                    out.finish().into()
                }
                None => Arc::new([]),
            }
        };
        let blocks = (0..matrix.blocks.len()).into_par_iter().map(block).collect();
        Self { partition: matrix.partition.clone(), tables, step, direction: packer.direction, blocks, layout }
    }

    /// The factors of all blocks.
    ///
    /// # Errors
    /// Bytes that no packer wrote.
    pub fn unpack(&self) -> Result<BlockLowRank, CodecError> {
        let block = |(block_idx, bytes): (usize, &Arc<[u8]>)| match bytes.len() {
            0 => Ok(None),
            _ => self.unpack_block(block_idx, bytes).map(Some),
        };
        let blocks = self.blocks.par_iter().enumerate().map(block).collect::<Result<_, _>>()?;
        let (bundle_len, n_cols) = (self.layout.bundle_len, self.layout.n_cols() as u32);
        Ok(BlockLowRank { partition: self.partition.clone(), bundle_len, n_cols, blocks })
    }

    fn unpack_block(&self, block_idx: usize, bytes: &[u8]) -> Result<Arc<BlockFactors>, CodecError> {
        let mut input = Decoder::new(&self.tables, bytes);
        let factors = block::read(block_idx, &self.layout, (self.step, &self.direction), &mut input);
        factors.map(Arc::new).ok_or(CodecError::Malformed("the coefficients of a block"))
    }

    /// Memory that the unpacked factors take at most, in bytes, as the blocks say it themselves; sparse entries aside, which take
    /// at most some hundred times their bytes.
    ///
    /// # Errors
    /// Bytes that no packer wrote.
    pub fn unpacked_bytes(&self) -> Result<u64, CodecError> {
        let of_block = |(block_idx, bytes): (usize, &Arc<[u8]>)| {
            if bytes.is_empty() {
                return Ok(0);
            }
            let mut input = Decoder::new(&self.tables, bytes);
            let rank = block::read_rank(block_idx, &self.layout, &mut input).map(|(_, rank)| u64::from(rank));
            let rank = rank.ok_or(CodecError::Malformed("the rank of a block"))?;
            // One more may be needed for the kept product.
            Ok((rank + 1) * 2 * (self.layout.n_rows(block_idx) + self.layout.n_cols()) as u64)
        };
        self.blocks.par_iter().enumerate().map(of_block).sum()
    }

    /// Bytes of all blocks and tables, those that [`encode`](Self::encode) puts around them aside.
    pub fn n_bytes(&self) -> usize {
        4 * self.direction.len()
            + self.tables.encode().len()
            + self.blocks.iter().map(|bytes| bytes.len()).sum::<usize>()
    }
}

/// A matrix that is being packed.
struct Packer<'a> {
    matrix: &'a BlockLowRank,
    layout: &'a Layout,
    plan: &'a PackPlan,
    /// See [`PackedMatrix`].
    direction: Vec<f32>,
}

impl<'a> Packer<'a> {
    fn new(matrix: &'a BlockLowRank, layout: &'a Layout, plan: &'a PackPlan) -> Self {
        let norm = plan.preserved.iter().map(|&x| f64::from(x).powi(2)).sum::<f64>().sqrt();
        let is_direction = norm > 0.0 && norm.is_finite() && plan.preserved.len() == layout.n_cols();
        let unit = |x: &f32| (f64::from(*x) / norm) as f32;
        let direction = if is_direction { plan.preserved.iter().map(unit).collect() } else { Vec::new() };
        Self { matrix, layout, plan, direction }
    }

    /// Blocks all over the matrix, at most [`N_TELLING`].
    fn telling(&self) -> impl ParallelIterator<Item = usize> {
        let n_blocks = self.matrix.blocks.len();
        (0..n_blocks).into_par_iter().step_by(n_blocks.div_ceil(N_TELLING).max(1))
    }

    fn coefficients(&self, block_idx: usize) -> Option<(&'a BlockFactors, Coefficients)> {
        let factors = self.matrix.blocks[block_idx].as_deref()?;
        Some((factors, Coefficients::new(factors, block_idx, self.layout)))
    }

    /// Mean square error at which a block aims.
    fn allowed(&self, block: &Coefficients) -> f64 {
        f64::from(self.plan.allowed) * shade(block.mean_square(), self.plan.bright)
    }

    /// Quarters of an octave by which a block's step is finer for its being dark: as much as what is allowed is less.
    fn quarters(&self, block: &Coefficients) -> i32 {
        quarters_between(1.0, shade(block.mean_square(), self.plan.bright).sqrt())
    }

    /// Mean square error that packing a block may add.
    fn budget(&self, factors: &BlockFactors, block: &Coefficients) -> f64 {
        let allowed = self.allowed(block);
        (allowed - own_error(factors)).max(LEAST_SHARE * allowed)
    }

    /// The coarsest step for which the telling blocks together stay within their budgets.
    fn common_step(&self) -> f32 {
        let with_place = |block_idx| self.coefficients(block_idx).map(|(factors, block)| (block_idx, factors, block));
        let blocks: Vec<_> = self.telling().filter_map(with_place).collect();
        let budget: f64 =
            blocks.iter().map(|(_, factors, block)| self.budget(factors, block) * block.n_entries()).sum();
        let n_entries: f64 = blocks.iter().map(|(.., block)| block.n_entries()).sum();
        let first = blocks.iter().map(|(.., block)| block.step_for(budget / n_entries)).filter(|step| step.is_finite());
        let (Some(least), Some(most)) = (first.clone().reduce(f64::min), first.reduce(f64::max)) else { return 0.0 };
        // One after the other, so that sums do not depend on the threads.
        let sum = |errors: Vec<f64>| errors.into_iter().sum::<f64>();
        // Coefficients that round to 0 err less than a step's worth: the true step may be much coarser.
        let (mut low, mut high) = (0.5 * least, 256.0 * most);
        for _ in 0..N_HALVINGS {
            let middle = (low * high).sqrt();
            let error = |(_, factors, block): &(usize, &BlockFactors, Coefficients)| {
                let step = step_of(middle as f32, self.quarters(block));
                block.error(step).min(self.most(factors, block)) * block.n_entries()
            };
            *(if sum(blocks.par_iter().map(error).collect()) > budget { &mut high } else { &mut low }) = middle;
        }
        // That was the weighted error; the plain one is a little less.
        let mut step = low;
        for _ in 0..N_CORRECTIONS {
            let error = |(block_idx, factors, block): &(usize, &BlockFactors, Coefficients)| {
                let step = step_of(step as f32, self.quarters(block));
                let (.., error) = self.round(*block_idx, factors, block, step);
                error.min(self.most(factors, block)) * block.n_entries()
            };
            let error = sum(blocks.par_iter().map(error).collect());
            if error > 0.0 {
                step *= (budget / error).powf(STEP_PER_ERROR).clamp(0.5, 2.0);
            }
        }
        step as f32
    }

    /// Most mean square error that packing a block may add.
    fn most(&self, factors: &BlockFactors, block: &Coefficients) -> f64 {
        let own = own_error(factors);
        let worst = WORST_BLOCK * self.allowed(block) - own;
        worst.max(self.budget(factors, block)).max(LEAST_SHARE * own)
    }

    /// A block for a step, and the mean square error that this adds.
    fn round(
        &self,
        block_idx: usize,
        factors: &BlockFactors,
        block: &Coefficients,
        step: f32,
    ) -> (Vec<Rounded>, Option<Kept>, f64) {
        let (components, direction) = (block.round(step), &self.direction);
        let kept = if direction.is_empty() {
            None
        } else {
            let rounded = restore(&components, step, block_idx, self.layout);
            let wanted = product_with(factors, direction);
            Kept::new(&wanted, f64::from(factors.error.noise), &rounded, direction, block_idx, self.layout)
        };
        let restored = block::factors(&components, kept.as_ref(), (step, direction), block_idx, self.layout);
        let error = squared_difference(factors, &restored) / block.n_entries().max(1.0);
        (components, kept, error)
    }

    /// A block for the common step: coarser where its own error drowns the step's, finer where it would be far too bad.
    fn rounded(&self, block_idx: usize, step: f32) -> Option<RoundedBlock<'a>> {
        let (factors, block) = self.coefficients(block_idx)?;
        let (own, most) = (own_error(factors), self.most(factors, &block));
        let mut quarters = self.quarters(&block);
        if own > self.allowed(&block) {
            quarters = quarters_between(step, block.step_for(LEAST_SHARE * own)).max(quarters);
        }
        let (mut components, mut kept, mut added) = self.round(block_idx, factors, &block, step_of(step, quarters));
        while added > most && quarters > FINEST {
            quarters -= 1;
            (components, kept, added) = self.round(block_idx, factors, &block, step_of(step, quarters));
        }
        let mut error = factors.error;
        error.truncation += added as f32;
        Some(RoundedBlock { quarters, components, kept, factors, error })
    }

    /// Tables that fit the telling blocks.
    fn tables(&self, step: f32) -> Tables {
        let none = || Counter { counts: vec![[0; 16]; N_TABLES] };
        let count = |mut counter: Counter, block_idx: usize| {
            if let Some(rounded) = self.rounded(block_idx, step) {
                rounded.write(block_idx, self.layout, &mut counter);
            }
            counter
        };
        let both = |mut a: Counter, b: Counter| {
            a.counts.as_flattened_mut().iter_mut().zip(b.counts.as_flattened()).for_each(|(a, b)| *a += b);
            a
        };
        Tables::from_counts(&self.telling().fold(none, count).reduce(none, both).counts)
    }
}

/// What truncation and sampling have left in a block.
fn own_error(factors: &BlockFactors) -> f64 {
    f64::from(factors.error.truncation.max(0.0) + factors.error.sampling.max(0.0))
}
