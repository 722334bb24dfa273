//! A compressed matrix as few bytes: what remains of each block's factors after a cosine transform, rounded to a common step
//! and entropy-coded.
//!
//! A block's left factors are functions on its tile, its right factors often functions on a grid of columns: smooth for the
//! most part. Orthogonal components are transformed along the rows and columns of their grids \[Ahmed1974\], rounded so that the
//! error asked for is just met, and coded \[Duda2013\] with tables that the whole matrix shares, each coefficient under the
//! magnitude of its known neighbors. One product (that with [`PackPlan::preserved`]) is kept apart, to a share of itself. Blocks can
//! be read alone, and each bears a checksum. Bundles of zeros stay zeros, however coarse the step.
//!
//! **Decision.** Bytes on disk are not bytes in memory: [`PackedMatrix::unpack`] gives factors in `f16`. **Refused:** vectors of few
//! bits that could be used as they lie; they take three to six times the room.

// What is read here was written by strangers, so no integer may wrap in silence.
#![cfg_attr(not(test), deny(clippy::arithmetic_side_effects))]

mod block;
mod bytes;
mod coder;
mod entries;
mod kept;
mod layout;
mod orthogonal;
mod planes;
mod product;
mod quantize;
mod tables;
#[cfg(test)]
mod tests;
mod zeros;

use std::sync::Arc;

use half::f16;
use rayon::prelude::*;

use self::{
    block::{Common, N_TABLES, Parts, RoundedBlock},
    bytes::TOO_LARGE,
    coder::{Counter, Decoder, Encoder},
    kept::{Kept, Plain, product_with},
    layout::{Layout, border_weight},
    orthogonal::{both, energy, squared_difference},
    quantize::{Coefficients, Rounded, quarters_between, restore, step_of},
    tables::Tables,
    zeros::ZeroBundles,
};
use crate::{
    codec::CodecError,
    compress::{strength_to_store, tightness},
    dense::Dense,
    factors::BlockFactors,
    level::NOISE,
    low_rank::BlockLowRank,
    product::product,
    random::Random,
};

pub use layout::ColumnRun;
pub use product::PackedProduct;

/// Share of a block's own error, or of what is allowed, that storing may add where sampling has used up all of it.
const LEAST_SHARE: f64 = 0.07;
/// How much worse than allowed a single block may be stored: 4 dB.
const WORST_BLOCK: f64 = 2.5;
/// Share of a block's mean square that is lost where factors are rounded to 16 bits, with room: less cannot be asked for.
const OF_HALVES: f64 = 1.0 / (1 << 22) as f64;
/// Octaves in quarters that such a block may be finer than the others.
const FINEST: i32 = -60;
/// Blocks with components that tell how fine the common step and the tables are.
const N_TELLING: usize = 1024;
/// Steps of the search for the common step, each half as wide as the one before.
const N_HALVINGS: usize = 14;
/// Corrections of that step, and about the power of the error that it goes with.
const N_CORRECTIONS: usize = 3;
const STEP_PER_ERROR: f64 = 0.6;
/// A step of 0 would give nothing back.
const LEAST_STEP: f32 = f32::from_bits(1);

/// How a matrix is packed.
#[derive(Clone, Debug, PartialEq)]
pub struct PackPlan {
    /// How the columns lie.
    pub columns: Vec<ColumnRun>,
    /// Mean square error per entry at which the matrix aims, in all: truncation, sampling and packing.
    pub allowed: f32,
    /// As [`CompressConfig::strong`](crate::CompressConfig::strong): weaker blocks are stored more finely.
    pub strong: f32,
    /// As [`ColumnGroup::apart`](crate::ColumnGroup::apart): a block is stored as finely as the weakest column that it holds asks for.
    pub apart: f32,
    /// One weight per column: the product with these weights is kept to a share of itself, or of its noise, whatever is
    /// allowed. Empty, or not as many as there are columns: no product is.
    pub preserved: Vec<f32>,
}

/// A matrix, or one group of its columns, as bytes.
#[derive(Clone, Debug)]
pub struct PackedMatrix {
    layout: Layout,
    tables: Tables,
    /// Step of the coefficients; 0 where no block has any.
    step: f32,
    /// The direction whose product is kept, of length 1; empty if there is none.
    direction: Vec<f32>,
    /// Whether each block says which of its bundles are zero, if any.
    tells_zeros: bool,
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
        let telling = telling(matrix);
        let unrounded = telling.par_iter().filter_map(|&block_idx| packer.unrounded(block_idx));
        let unrounded: Vec<Unrounded<'_>> = unrounded.collect();
        let step = packer.common_step(&unrounded).or_else(|| packer.least_step()).unwrap_or(0.0);
        let told: Vec<RoundedBlock<'_>> = unrounded.par_iter().map(|block| packer.rounded(block, step)).collect();
        let tables = packer.tables(&told);
        let bytes = |block: &RoundedBlock<'_>| -> Arc<[u8]> {
            let mut out = Encoder::new(&tables);
            block.write(&layout, &mut out);
            out.finish().into()
        };
        let block = |block_idx: usize| match telling.binary_search(&block_idx) {
            Ok(nth) => Some(bytes(&told[nth])),
            Err(_) => packer.unrounded(block_idx).map(|block| bytes(&packer.rounded(&block, step))),
        };
        let blocks =
            (0..matrix.blocks.len()).into_par_iter().map(|block_idx| block(block_idx).unwrap_or_default()).collect();
        let (direction, tells_zeros) = (packer.direction, packer.tells_zeros);
        Self { tables, step, direction, tells_zeros, blocks, layout }
    }

    /// Of so many blocks, those with components that [`pack`](Self::pack) holds unpacked and packed at the same time, at most.
    pub fn n_telling(n_blocks: usize) -> usize {
        n_blocks.min(N_TELLING)
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
        Ok(BlockLowRank { partition: self.layout.partition.clone(), bundle_len, n_cols, blocks })
    }

    fn unpack_block(&self, block_idx: usize, bytes: &[u8]) -> Result<Arc<BlockFactors>, CodecError> {
        let factors = self.read_block(block_idx, bytes).and_then(|parts| parts.factors(block_idx, &self.layout));
        factors.map(Arc::new).ok_or(CodecError::Malformed("the coefficients of a block"))
    }

    fn read_block(&self, block_idx: usize, bytes: &[u8]) -> Option<Parts> {
        let mut input = Decoder::new(&self.tables, bytes);
        let Self { step, ref direction, tells_zeros, .. } = *self;
        block::read(block_idx, &self.layout, Common { step, direction, tells_zeros }, &mut input)
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
            let rank = rank.ok_or(CodecError::Malformed("the rank or the errors of a block"))?;
            // One more may be needed for the kept product.
            let n_values = self.layout.n_rows(block_idx).checked_add(self.layout.n_cols()).ok_or(TOO_LARGE)?;
            rank.checked_add(1).and_then(|rank| rank.checked_mul(2)?.checked_mul(n_values as u64)).ok_or(TOO_LARGE)
        };
        let sum = |a: u64, b: u64| a.checked_add(b).ok_or(TOO_LARGE);
        self.blocks.par_iter().enumerate().map(of_block).try_reduce(|| 0, sum)
    }

    /// Whether some blocks have bundles that are zero in every column beside others, which they tell: they stay zero exactly. Programs
    /// from before that cannot read such a matrix.
    pub fn tells_zeros(&self) -> bool {
        self.tells_zeros
    }

    /// Bytes of all blocks and tables, those that [`encode`](Self::encode) puts around them aside.
    #[expect(clippy::arithmetic_side_effects, reason = "bytes that lie in memory")]
    pub fn n_bytes(&self) -> usize {
        4 * self.direction.len() + self.tables.encode().len() + self.block_bytes()
    }

    /// Bytes of its blocks alone.
    pub fn block_bytes(&self) -> usize {
        self.blocks.iter().map(|bytes| bytes.len()).sum()
    }
}

/// Blocks all over a matrix that tell how fine it is to be stored, in order: some of those with components, and as large a share
/// of the empty ones, which need nothing of what is allowed; all of them where few have any. At random: a stride would
/// meet the same tiles of each row again and again.
#[expect(clippy::arithmetic_side_effects, reason = "counts of blocks that lie in memory")]
fn telling(matrix: &BlockLowRank) -> Vec<usize> {
    let rank = |block_idx: usize| matrix.blocks[block_idx].as_ref().map(|block| block.rank);
    let there = (0..matrix.blocks.len()).filter(|&block_idx| rank(block_idx).is_some());
    let (filled, empty): (Vec<usize>, Vec<usize>) = there.partition(|&block_idx| rank(block_idx) > Some(0));
    let share = |of: &[usize]| (of.len() * N_TELLING).div_ceil(filled.len().max(N_TELLING));
    let mut rng = Random::new([filled.len() as u64, 0]);
    let mut telling = rng.choose(&filled, share(&filled));
    telling.extend(rng.choose(&empty, share(&empty)));
    telling.sort_unstable();
    telling
}

/// How strong the weakest column is that a block holds. What is mostly error is not stored finely for its weakness, and columns beyond the
/// reach of [`strength_to_store`] count the less the weaker they are; 1 where it holds none.
fn weakest(left: &Dense<f64>, right: &Dense<f64>, errors: &[f32], strong: f32) -> f64 {
    let gram = product(left.t(), left.view());
    let energies = product(gram.view(), right.view());
    let of_column = |col: usize| -> f64 {
        let energy = (0..right.n_rows).map(|r| right.row(r)[col] * energies.row(r)[col]).sum::<f64>();
        let error = errors.get(col).map_or(0.0, |error| f64::from(*error));
        strength_to_store((energy / left.n_rows.max(1) as f64).max(NOISE * error), strong)
    };
    (0..right.n_cols).map(of_column).fold(1.0, f64::min)
}

/// A matrix that is being packed.
struct Packer<'a> {
    matrix: &'a BlockLowRank,
    layout: &'a Layout,
    plan: &'a PackPlan,
    /// See [`PackedMatrix`].
    direction: Vec<f32>,
    /// See [`PackedMatrix`].
    tells_zeros: bool,
    /// Of each block which of its bundles are zero, and stay so.
    zeros: Vec<Option<ZeroBundles>>,
    /// See [`border_weight`].
    border_weight: f32,
}

/// A block that is being packed.
struct Unrounded<'a> {
    block_idx: usize,
    factors: &'a BlockFactors,
    /// Sum of the squares of what the factors hold.
    energy: f64,
    coefficients: Coefficients,
    /// Its product with the direction.
    kept: Vec<f64>,
    /// Mean square error that truncation and sampling have left in it.
    own_error: f64,
    /// Share of what is allowed that is left to it for its being weak.
    tightness: f64,
    /// Mean square error at which it aims.
    allowed: f64,
}

/// Which columns are not zero everywhere; the others have no part in any product, and get none of what is given back to the kept one.
fn nonzero_columns(matrix: &BlockLowRank, n_cols: usize) -> Vec<bool> {
    let mut nonzero = vec![false; n_cols];
    for factors in matrix.blocks.iter().flatten() {
        if nonzero.iter().all(|is_nonzero| *is_nonzero) {
            break;
        }
        for row in factors.right.chunks_exact(n_cols.max(1)) {
            nonzero.iter_mut().zip(row).for_each(|(is_nonzero, x)| *is_nonzero |= *x != f16::ZERO);
        }
    }
    nonzero
}

impl<'a> Packer<'a> {
    fn new(matrix: &'a BlockLowRank, layout: &'a Layout, plan: &'a PackPlan) -> Self {
        let nonzero = nonzero_columns(matrix, layout.n_cols());
        let weigh = |(&x, &is_nonzero): (&f32, &bool)| if is_nonzero { f64::from(x) } else { 0.0 };
        let preserved: Vec<f64> = plan.preserved.iter().zip(&nonzero).map(weigh).collect();
        let norm = preserved.iter().map(|x| x.powi(2)).sum::<f64>().sqrt();
        let is_direction = norm > 0.0 && norm.is_finite() && plan.preserved.len() == layout.n_cols();
        let unit = |x: &f64| (x / norm) as f32;
        let direction = if is_direction { preserved.iter().map(unit).collect() } else { Vec::new() };
        let zeros = |factors: &Option<Arc<BlockFactors>>| ZeroBundles::of(factors.as_deref()?, layout);
        let zeros: Vec<_> = matrix.blocks.par_iter().map(zeros).collect();
        let tells_zeros = zeros.iter().any(Option::is_some);
        Self {
            matrix,
            layout,
            plan,
            direction,
            tells_zeros,
            zeros,
            border_weight: border_weight(plan.allowed, plan.strong),
        }
    }

    fn unrounded(&self, block_idx: usize) -> Option<Unrounded<'a>> {
        let factors = self.matrix.blocks[block_idx].as_deref()?;
        let coefficients = Coefficients::new(factors, block_idx, self.layout, self.border_weight);
        let (left, right) = both(factors);
        let kept = product_with(&left.data, &right.data, left.n_cols, &self.direction, left.n_rows);
        let own_error = f64::from(factors.error.truncation.max(0.0) + factors.error.sampling.max(0.0));
        let of_block = tightness(coefficients.mean_square(), self.plan.strong);
        let tightness = if self.plan.apart > 0.0 {
            weakest(&left, &right, &factors.column_errors, self.plan.apart).powi(2).min(of_block)
        } else {
            of_block
        };
        let allowed = (f64::from(self.plan.allowed) * tightness).max(OF_HALVES * coefficients.mean_square());
        let energy = energy(factors);
        Some(Unrounded { block_idx, factors, energy, coefficients, kept, own_error, tightness, allowed })
    }

    /// The coarsest step for which some blocks together stay within their budgets; `None` where none has components.
    fn common_step(&self, blocks: &[Unrounded<'_>]) -> Option<f32> {
        // One after the other, so that sums do not depend on the threads.
        let sum = |mean_squares: Vec<f64>| -> f64 {
            blocks.iter().zip(mean_squares).map(|(block, x)| x * block.coefficients.n_entries()).sum()
        };
        let budget = sum(blocks.iter().map(|block| block.budget()).collect());
        let per_entry = budget / sum(vec![1.0; blocks.len()]);
        let first = blocks.iter().map(|block| block.coefficients.step_for(per_entry)).filter(|step| step.is_finite());
        let (least, most) = (first.clone().reduce(f64::min)?, first.reduce(f64::max)?);
        // Coefficients that round to 0 err less than a step's worth: the true step may be much coarser.
        let (mut low, mut high) = (0.5 * least, 256.0 * most);
        for _ in 0..N_HALVINGS {
            let middle = (low * high).sqrt();
            let error = |block: &Unrounded<'_>| {
                let step = step_of(middle as f32, block.quarters());
                block.coefficients.error(step).min(block.most())
            };
            *(if sum(blocks.par_iter().map(error).collect()) > budget { &mut high } else { &mut low }) = middle;
        }
        // That was the weighted error, and components were chosen by other weights; the plain one is somewhat different.
        let mut step = low;
        for _ in 0..N_CORRECTIONS {
            let error = |block: &Unrounded<'_>| {
                let (.., error) = self.round(block, step_of(step as f32, block.quarters()));
                error.min(block.most())
            };
            let error = sum(blocks.par_iter().map(error).collect());
            if error > 0.0 {
                step *= (budget / error).powf(STEP_PER_ERROR).clamp(0.5, 2.0);
            }
        }
        Some((step as f32).max(LEAST_STEP))
    }

    /// The step that the worst allowed of every block asks for; `None` where none has components.
    fn least_step(&self) -> Option<f32> {
        let blocks = (0..self.matrix.blocks.len()).into_par_iter().filter_map(|block_idx| self.unrounded(block_idx));
        let steps = blocks.map(|block| block.coefficients.step_for(block.most())).filter(|step| step.is_finite());
        steps.reduce_with(f64::min).map(|step| (step as f32).max(LEAST_STEP))
    }

    /// A block for a step, and the mean square error that this adds.
    fn round(&self, block: &Unrounded<'_>, step: f32) -> (Vec<Rounded>, Option<Kept>, f64) {
        let Unrounded { block_idx, factors, energy, coefficients, .. } = block;
        let (components, direction) = (coefficients.round(step), &self.direction);
        let mut plain = restore(&components, step, *block_idx, self.layout);
        let clear = |plain: &mut Plain| self.zeros[*block_idx].iter().for_each(|zeros| zeros.clear(plain));
        clear(&mut plain);
        let mut kept = None;
        if !direction.is_empty() {
            let noise = f64::from(factors.error.noise);
            kept = Kept::new(&block.kept, noise, &plain, direction, *block_idx, self.layout);
        }
        if let Some(kept) = &kept {
            kept.restore(&mut plain, direction, *block_idx, self.layout);
            clear(&mut plain);
        }
        let squared = squared_difference((factors, *energy), &plain.factors(*block_idx, self.layout));
        (components, kept, squared / coefficients.n_entries().max(1.0))
    }

    /// A block for the common step: coarser where its own error drowns the step's, finer where it would be far too bad.
    fn rounded(&self, block: &Unrounded<'a>, step: f32) -> RoundedBlock<'a> {
        let mut quarters = block.quarters();
        if block.own_error > block.allowed {
            let drowned = block.coefficients.step_for(block.hidden());
            quarters = quarters_between(step, drowned).max(quarters);
        }
        let (mut components, mut kept, mut added) = self.round(block, step_of(step, quarters));
        for finer in (FINEST..quarters).rev() {
            if added <= block.most() {
                break;
            }
            let round = self.round(block, step_of(step, finer));
            // Too fine a step has more multiples than can be counted.
            if round.2 < added {
                quarters = finer;
                (components, kept, added) = round;
            }
        }
        let mut error = block.factors.error;
        error.truncation += added as f32;
        let (block_idx, factors) = (block.block_idx, block.factors);
        let zeros = self.tells_zeros.then(|| {
            let is_something = !components.is_empty() || kept.is_some();
            self.zeros[block_idx].clone().filter(|_| is_something)
        });
        RoundedBlock { quarters, components, kept, zeros, block_idx, factors, error }
    }

    /// Tables that fit some blocks.
    #[expect(clippy::arithmetic_side_effects, reason = "no symbol of a matrix that lies in memory comes 2^32 times")]
    fn tables(&self, blocks: &[RoundedBlock<'_>]) -> Tables {
        let none = || Counter { counts: vec![[0; 16]; N_TABLES] };
        let count = |mut counter: Counter, block: &RoundedBlock<'_>| {
            block.write(self.layout, &mut counter);
            counter
        };
        let sum = |mut a: Counter, b: Counter| {
            a.counts.as_flattened_mut().iter_mut().zip(b.counts.as_flattened()).for_each(|(a, b)| *a += b);
            a
        };
        Tables::from_counts(&blocks.par_iter().fold(none, count).reduce(none, sum).counts)
    }
}

impl Unrounded<'_> {
    /// Quarters of an octave by which its step is finer for its being weak: as much as what is allowed is less.
    fn quarters(&self) -> i32 {
        quarters_between(1.0, self.tightness.sqrt())
    }

    /// Mean square error that packing may add.
    fn budget(&self) -> f64 {
        (self.allowed - self.own_error).max(LEAST_SHARE * self.allowed)
    }

    /// What hides behind its own error. That may be the noise of a single column, beside which the others are still to be
    /// seen, so never more than the worst that a block may have without any noise.
    fn hidden(&self) -> f64 {
        (LEAST_SHARE * self.own_error).min(WORST_BLOCK * self.allowed)
    }

    /// The same at worst.
    fn most(&self) -> f64 {
        (WORST_BLOCK * self.allowed - self.own_error).max(self.budget()).max(self.hidden())
    }
}
