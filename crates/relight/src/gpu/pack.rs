//! Brings runs of blocks into the form the shaders read, cut where a device's buffers end.

use clerestory_nystrom::{BlockFactors, BlockLowRank};
use half::f16;
use rayon::prelude::*;
use std::ops::Range;

use super::chunk::ChunkLimits;
use crate::layout::{Block, SEGMENT, SparseTerm};
use crate::packing::{Kept, Precision};
use crate::relight::RelightError;

/// A block, and what is kept of it.
#[derive(Debug)]
pub(super) struct Item<'a> {
    factors: &'a BlockFactors,
    kept: Kept,
    rect: [u32; 4],
}

/// Blocks of a run, by all cores; none where there is nothing.
pub(super) fn items(low_rank: &BlockLowRank, run: Range<usize>, precision: Precision) -> Vec<Option<Item<'_>>> {
    let item = |block_idx: usize| {
        let factors = low_rank.blocks[block_idx].as_deref()?;
        let is_empty = factors.rank == 0 && factors.sparse.is_empty();
        let rect = low_rank.partition.rect(block_idx);
        (!is_empty).then(|| Item { factors, kept: precision.keep(factors), rect })
    };
    run.into_par_iter().map(item).collect()
}

impl Item<'_> {
    /// Words of the left factor: pairs of halves and fours of bytes, pixel by pixel.
    fn n_left(&self) -> u64 {
        let n_halves = self.kept.left.n_halves as u32;
        let n_pixels = u64::from(self.factors.n_rows) / 3;
        3 * n_pixels * u64::from(n_halves.div_ceil(2) + (self.factors.rank - n_halves).div_ceil(4))
    }

    /// Words of the right factor: the same, row by row.
    fn n_right(&self) -> u64 {
        let (n_halves, n_cols) = (self.kept.right.n_halves as u64, u64::from(self.factors.n_cols));
        n_halves * n_cols.div_ceil(2) + (u64::from(self.factors.rank) - n_halves) * n_cols.div_ceil(4)
    }

    /// Components of `z`, those included that fill the last word of the left factor.
    fn n_components(&self) -> u32 {
        let n_halves = self.kept.left.n_halves as u32;
        n_halves.next_multiple_of(2) + (self.factors.rank - n_halves).next_multiple_of(4)
    }
}

/// What the buffers of a chunk hold, before upload.
#[derive(Debug, Default)]
pub(super) struct Packed<'a> {
    /// Blocks with content; the others are left out.
    pub blocks: Vec<Block>,
    items: Vec<&'a Item<'a>>,
    /// Words of left factors, which [`Self::left_parts`] packs.
    pub n_left: u64,
    /// Words of right factors, which [`Self::right_parts`] packs.
    pub n_right: u64,
    /// Largest magnitude of the left factor per channel, and scale; one per component, and some that fill words.
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
    fn of(item: &Item) -> Self {
        let (n_pixels, n_cols) = (u64::from(item.factors.n_rows) / 3, u64::from(item.factors.n_cols));
        let n_components = u64::from(item.n_components());
        let n_sparse = item.factors.sparse.len() as u64;
        let starts = if n_sparse > 0 { 4 * (n_pixels + 1) } else { 0 };
        Self([
            size_of::<Block>() as u64,
            4 * item.n_left(),
            4 * item.n_right(),
            16 * n_components,
            16 * n_components * n_cols.div_ceil(SEGMENT.into()),
            4 * n_components,
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
pub(super) fn group_bytes(low_rank: &BlockLowRank, precision: Precision) -> u64 {
    let items = items(low_rank, 0..low_rank.blocks.len(), precision);
    items.iter().flatten().map(|item| Sizes::of(item).total()).sum()
}

/// Cuts a run of blocks, of which `items` are the first, where a buffer would get too large.
///
/// # Errors
/// [`RelightError::TooLarge`] where one block alone is.
pub(super) fn cut(
    items: &[Option<Item>],
    run: Range<usize>,
    limits: ChunkLimits,
) -> Result<Vec<Range<usize>>, RelightError> {
    let (mut runs, mut start, mut sizes) = (Vec::new(), run.start, Sizes::default());
    for (block, item) in run.clone().zip(items) {
        let own = item.as_ref().map_or_else(Sizes::default, Sizes::of);
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

/// Packs blocks of one group.
pub(super) fn pack<'a>(items: &'a [Option<Item<'a>>]) -> Packed<'a> {
    let mut packed = Packed::default();
    items.iter().flatten().for_each(|item| packed.push(item));
    packed
}

impl<'a> Packed<'a> {
    /// Appends the table entry and the small parts of a block, and makes room for the large ones.
    fn push(&mut self, item: &'a Item<'a>) {
        let (factors, [x, y, width, height]) = (item.factors, item.rect);
        let (n_pixels, n_components) = (width * height, item.n_components());
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
            n_components,
            left_halves: item.kept.left.n_halves as u32,
            right_halves: item.kept.right.n_halves as u32,
        });
        self.n_left += item.n_left();
        self.n_right += item.n_right();
        self.owners.resize(self.owners.len() + n_components as usize, self.items.len() as u32);
        self.items.push(item);
        self.components.extend(components(item));
        self.components.resize(self.owners.len(), [0.0; 4]);
        if !factors.sparse.is_empty() {
            self.push_sparse(factors, n_pixels);
        }
    }

    /// Pairs of f16 and fours of bytes, of each block word by word, channel by channel, pixel by pixel; with the position of each part.
    pub(super) fn left_parts(&self) -> impl Iterator<Item = (u32, Vec<u32>)> {
        self.parts(self.n_left, |block| block.left, pack_left)
    }

    /// Pairs of f16 and fours of bytes, of each block row by row; with the position of each part.
    pub(super) fn right_parts(&self) -> impl Iterator<Item = (u32, Vec<u32>)> {
        self.parts(self.n_right, |block| block.right, |item, _, words| pack_right(item, words))
    }

    /// Some blocks after the other, each by all cores. Entries say where each block's share lies.
    fn parts(
        &self,
        n_words: u64,
        start: impl Fn(&Block) -> u32,
        pack_block: impl Fn(&Item, usize, &mut [u32]) + Sync,
    ) -> impl Iterator<Item = (u32, Vec<u32>)> {
        let mut first = 0;
        std::iter::from_fn(move || {
            let from = start(self.blocks.get(first)?);
            let within = |block: &Block| start(block) - from < PART_WORDS;
            let n_blocks = self.blocks[first..].iter().take_while(|block| within(block)).count();
            let end = self.blocks.get(first + n_blocks).map_or(n_words, |next| start(next).into());
            let mut words = vec![0; (end - u64::from(from)) as usize];
            let run = first..first + n_blocks;
            fill(&self.blocks[run.clone()], &self.items[run], &mut words, &start, &pack_block);
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

/// Largest magnitude of the left factor per channel, and scale, of each component; in steps where they are bytes.
fn components(item: &Item) -> Vec<[f32; 4]> {
    let (rank, kept) = (item.factors.rank as usize, &item.kept);
    let mut components: Vec<[f32; 4]> = kept.scale.iter().map(|scale| [0.0, 0.0, 0.0, *scale]).collect();
    for (row, left) in item.factors.left.chunks_exact(rank.max(1)).enumerate() {
        for (k, (component, left)) in components.iter_mut().zip(left).enumerate() {
            let is_half = k < kept.left.n_halves;
            let entry = if is_half { left.to_f32() } else { f32::from(kept.left.byte(k, *left)) };
            component[row % 3] = component[row % 3].max(entry.abs());
        }
    }
    components
}

/// Cuts `words` at the blocks' positions and lets `pack_block` fill each share.
fn fill(
    blocks: &[Block],
    items: &[&Item],
    mut words: &mut [u32],
    start: impl Fn(&Block) -> u32,
    pack_block: impl Fn(&Item, usize, &mut [u32]) + Sync,
) {
    let mut shares = Vec::with_capacity(blocks.len());
    for (i, block) in blocks.iter().enumerate() {
        let len = blocks.get(i + 1).map_or(words.len(), |next| (start(next) - start(block)) as usize);
        let (share, rest) = words.split_at_mut(len);
        shares.push((items[i], block.n_pixels as usize, share));
        words = rest;
    }
    shares.into_par_iter().for_each(|(item, n_pixels, share)| pack_block(item, n_pixels, share));
}

fn pack_left(item: &Item, n_pixels: usize, words: &mut [u32]) {
    let (rank, side) = (item.factors.rank as usize, &item.kept.left);
    let (of_halves, of_bytes) = words.split_at_mut(3 * n_pixels * side.n_halves.div_ceil(2));
    let row = |plane: usize, pixel: usize| &item.factors.left[(3 * pixel + plane % 3) * rank..][..rank];
    for (plane, words) in of_halves.chunks_exact_mut(n_pixels).enumerate() {
        let k = plane / 3 * 2;
        for (pixel, word) in words.iter_mut().enumerate() {
            let row = row(plane, pixel);
            *word = word_of(row[k], row.get(k + 1));
        }
    }
    for (plane, words) in of_bytes.chunks_exact_mut(n_pixels).enumerate() {
        let k = side.n_halves + plane / 3 * 4;
        for (pixel, word) in words.iter_mut().enumerate() {
            let row = row(plane, pixel);
            *word = word_of_bytes(|i| row.get(k + i).map_or(0, |entry| side.byte(k + i, *entry)));
        }
    }
}

fn pack_right(item: &Item, words: &mut [u32]) {
    let (n_cols, side) = (item.factors.n_cols as usize, &item.kept.right);
    // A group without columns has no words; the length of a run may still not be 0.
    let [per_half, per_byte] = [n_cols.div_ceil(2).max(1), n_cols.div_ceil(4).max(1)];
    let (of_halves, of_bytes) = words.split_at_mut(side.n_halves * n_cols.div_ceil(2));
    let mut rows = item.factors.right.chunks_exact(n_cols.max(1));
    for (words, row) in of_halves.chunks_exact_mut(per_half).zip(rows.by_ref()) {
        for (word, pair) in words.iter_mut().zip(row.chunks(2)) {
            *word = word_of(pair[0], pair.get(1));
        }
    }
    for ((k, words), row) in (side.n_halves..).zip(of_bytes.chunks_exact_mut(per_byte)).zip(rows) {
        for (word, four) in words.iter_mut().zip(row.chunks(4)) {
            *word = word_of_bytes(|i| four.get(i).map_or(0, |entry| side.byte(k, *entry)));
        }
    }
}

/// Four bytes, the first the lowest, as `signed_bytes` in `blocks.wgsl` takes them.
fn word_of_bytes(byte: impl Fn(usize) -> i8) -> u32 {
    u32::from_le_bytes(std::array::from_fn(|i| byte(i).cast_unsigned()))
}

/// The first half in the lower bits, as `unpack2x16float` takes it.
fn word_of(first: f16, second: Option<&f16>) -> u32 {
    u32::from(first.to_bits()) | u32::from(second.map_or(0, |h| h.to_bits())) << 16
}
