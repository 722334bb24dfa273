//! Brings runs of blocks into the form the shaders read, cut where a device's buffers end.

use clerestory_nystrom::{BlockFactors, BlockLowRank};
use half::f16;
use rayon::prelude::*;
use std::ops::Range;

use super::chunk::ChunkLimits;
use crate::layout::{Block, SEGMENT, SparseTerm};
use crate::relight::RelightError;

/// What the buffers of a chunk hold, before upload.
#[derive(Debug, Default)]
pub(super) struct Packed<'a> {
    /// Blocks with content; the others are left out.
    pub blocks: Vec<Block>,
    /// Their factors.
    factors: Vec<&'a BlockFactors>,
    /// Words of left factors, which [`Self::left_parts`] packs.
    pub n_left: u64,
    /// Words of right factors, which [`Self::right_parts`] packs.
    pub n_right: u64,
    /// Largest magnitude of the left factor per channel, and scale; one per component, of an even number of them per block.
    pub components: Vec<[f32; 4]>,
    /// The block of each component.
    pub owners: Vec<u32>,
    /// Of each block with sparse terms, where the terms of its pixels start, and where the last ends.
    pub sparse_starts: Vec<u32>,
    pub sparse_terms: Vec<SparseTerm>,
}

/// Words that are packed at a time, so that little of a large frame lies in memory twice.
const PART_WORDS: u32 = 8 << 20;

/// Bytes of the buffers that a run of blocks needs: blocks, left, right, components (which are as many as `z`), partials, owners,
/// starts and terms of sparse entries.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Sizes([u64; 8]);

impl Sizes {
    fn of(factors: &BlockFactors) -> Self {
        let (n_pixels, n_cols) = (u64::from(factors.n_rows) / 3, u64::from(factors.n_cols));
        let n_pairs = u64::from(factors.rank).div_ceil(2);
        let n_sparse = factors.sparse.len() as u64;
        if n_pairs == 0 && n_sparse == 0 {
            return Self::default();
        }
        let starts = if n_sparse > 0 { 4 * (n_pixels + 1) } else { 0 };
        Self([
            size_of::<Block>() as u64,
            12 * n_pairs * n_pixels,
            4 * u64::from(factors.rank) * n_cols.div_ceil(2),
            32 * n_pairs,
            32 * n_pairs * n_cols.div_ceil(SEGMENT.into()),
            8 * n_pairs,
            starts,
            8 * n_sparse,
        ])
    }

    fn with(self, more: Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i] + more.0[i]))
    }

    pub(super) fn largest(self) -> u64 {
        self.0.into_iter().max().unwrap_or(0)
    }

    /// Bytes of all of them; the components count twice.
    fn total(self) -> u64 {
        self.0.into_iter().sum::<u64>() + self.0[3]
    }
}

/// Bytes that the factors of a group take on a device, without the edges of buffers.
pub(super) fn group_bytes(low_rank: &BlockLowRank) -> u64 {
    low_rank.blocks.iter().flatten().map(|factors| Sizes::of(factors).total()).sum()
}

/// Cuts a run of blocks where a buffer would get too large.
///
/// # Errors
/// [`RelightError::TooLarge`] where one block alone is.
pub(super) fn cut(
    low_rank: &BlockLowRank,
    run: Range<usize>,
    limits: ChunkLimits,
) -> Result<Vec<Range<usize>>, RelightError> {
    let (mut runs, mut start, mut sizes) = (Vec::new(), run.start, Sizes::default());
    for block in run.clone() {
        let own = low_rank.blocks[block].as_ref().map_or_else(Sizes::default, |factors| Sizes::of(factors));
        let (size, limit) = (own.largest(), limits.n_bytes);
        if size > limit {
            return Err(RelightError::TooLarge { what: "one block of the frame", size, limit });
        }
        if sizes.with(own).largest() > limit || block - start == limits.n_blocks {
            runs.push(start..block);
            (start, sizes) = (block, Sizes::default());
        }
        sizes = sizes.with(own);
    }
    runs.push(start..run.end);
    Ok(runs)
}

/// Packs a run of blocks of one group.
pub(super) fn pack(low_rank: &BlockLowRank, run: Range<usize>) -> Packed<'_> {
    let mut packed = Packed::default();
    for block_idx in run {
        let Some(factors) = &low_rank.blocks[block_idx] else { continue };
        if factors.rank > 0 || !factors.sparse.is_empty() {
            packed.push(factors, low_rank.partition.rect(block_idx));
        }
    }
    packed
}

impl<'a> Packed<'a> {
    /// Appends the table entry and the small parts of a block, and makes room for the large ones.
    fn push(&mut self, factors: &'a BlockFactors, [x, y, width, height]: [u32; 4]) {
        let n_pairs = factors.rank.div_ceil(2);
        let n_pixels = width * height;
        self.blocks.push(Block {
            rank: factors.rank,
            n_pixels,
            x,
            y,
            width,
            left: self.n_left as u32,
            right: self.n_right as u32,
            z: self.components.len() as u32,
            sparse: self.sparse_starts.len() as u32,
            n_sparse: factors.sparse.len() as u32,
        });
        self.n_left += 3 * u64::from(n_pairs) * u64::from(n_pixels);
        self.n_right += u64::from(factors.rank) * u64::from(factors.n_cols.div_ceil(2));
        self.owners.resize(self.owners.len() + 2 * n_pairs as usize, self.factors.len() as u32);
        self.factors.push(factors);
        self.components.extend(components(factors));
        self.components.resize(self.owners.len(), [0.0; 4]);
        if !factors.sparse.is_empty() {
            self.push_sparse(factors, n_pixels);
        }
    }

    /// Pairs of f16, of each block pair by pair, channel by channel, pixel by pixel; with the position of each part.
    pub(super) fn left_parts(&self) -> impl Iterator<Item = (u32, Vec<u32>)> {
        self.parts(self.n_left, |block| block.left, pack_left)
    }

    /// Pairs of f16, of each block row by row; with the position of each part.
    pub(super) fn right_parts(&self) -> impl Iterator<Item = (u32, Vec<u32>)> {
        self.parts(self.n_right, |block| block.right, |factors, _, words| pack_right(factors, words))
    }

    /// Some blocks after the other, each by all cores. Entries say where each block's share lies.
    fn parts(
        &self,
        n_words: u64,
        start: impl Fn(&Block) -> u32,
        pack_block: impl Fn(&BlockFactors, usize, &mut [u32]) + Sync,
    ) -> impl Iterator<Item = (u32, Vec<u32>)> {
        let mut first = 0;
        std::iter::from_fn(move || {
            let from = start(self.blocks.get(first)?);
            let within = |block: &Block| start(block) - from < PART_WORDS;
            let n_blocks = self.blocks[first..].iter().take_while(|block| within(block)).count();
            let end = self.blocks.get(first + n_blocks).map_or(n_words, |next| start(next).into());
            let mut words = vec![0; (end - u64::from(from)) as usize];
            let run = first..first + n_blocks;
            fill(&self.blocks[run.clone()], &self.factors[run], &mut words, &start, &pack_block);
            first += n_blocks;
            Some((from, words))
        })
    }

    fn push_sparse(&mut self, factors: &BlockFactors, n_pixels: u32) {
        // Entries are sorted by row, and so by pixel.
        let mut entries = factors.sparse.iter().peekable();
        for pixel in 0..n_pixels {
            self.sparse_starts.push(self.sparse_terms.len() as u32);
            while let Some(entry) = entries.next_if(|entry| entry.row / 3 == pixel) {
                let col_channel = entry.col | (entry.row % 3) << 30;
                self.sparse_terms.push(SparseTerm { col_channel, value: entry.value });
            }
        }
        self.sparse_starts.push(self.sparse_terms.len() as u32);
    }
}

/// Largest magnitude of the left factor per channel, and scale, of each component.
fn components(factors: &BlockFactors) -> Vec<[f32; 4]> {
    let rank = factors.rank as usize;
    let mut components: Vec<[f32; 4]> = factors.scale.iter().map(|scale| [0.0, 0.0, 0.0, *scale]).collect();
    for (row, left) in factors.left.chunks_exact(rank.max(1)).enumerate() {
        for (component, left) in components.iter_mut().zip(left) {
            component[row % 3] = component[row % 3].max(left.to_f32().abs());
        }
    }
    components
}

/// Cuts `words` at the blocks' positions and lets `pack_block` fill each share.
fn fill(
    blocks: &[Block],
    factors: &[&BlockFactors],
    mut words: &mut [u32],
    start: impl Fn(&Block) -> u32,
    pack_block: impl Fn(&BlockFactors, usize, &mut [u32]) + Sync,
) {
    let mut shares = Vec::with_capacity(blocks.len());
    for (i, block) in blocks.iter().enumerate() {
        let len = blocks.get(i + 1).map_or(words.len(), |next| (start(next) - start(block)) as usize);
        let (share, rest) = words.split_at_mut(len);
        shares.push((factors[i], block.n_pixels as usize, share));
        words = rest;
    }
    shares.into_par_iter().for_each(|(factors, n_pixels, share)| pack_block(factors, n_pixels, share));
}

fn pack_left(factors: &BlockFactors, n_pixels: usize, words: &mut [u32]) {
    let rank = factors.rank as usize;
    for (plane, words) in words.chunks_exact_mut(n_pixels).enumerate() {
        let (pair, channel) = (plane / 3, plane % 3);
        for (pixel, word) in words.iter_mut().enumerate() {
            let row = &factors.left[(3 * pixel + channel) * rank..][..rank];
            *word = word_of(row[2 * pair], row.get(2 * pair + 1));
        }
    }
}

fn pack_right(factors: &BlockFactors, words: &mut [u32]) {
    let n_cols = factors.n_cols as usize;
    // A group without columns has no words; the length of a run may still not be 0.
    let rows = words.chunks_exact_mut(n_cols.div_ceil(2).max(1)).zip(factors.right.chunks_exact(n_cols.max(1)));
    for (words, row) in rows {
        for (word, pair) in words.iter_mut().zip(row.chunks(2)) {
            *word = word_of(pair[0], pair.get(1));
        }
    }
}

/// The first half in the lower bits, as `unpack2x16float` takes it.
fn word_of(first: f16, second: Option<&f16>) -> u32 {
    u32::from(first.to_bits()) | u32::from(second.map_or(0, |h| h.to_bits())) << 16
}
