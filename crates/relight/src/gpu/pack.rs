//! Brings runs of blocks into the form the shaders read, cut where a device's buffers end.

use clerestory_nystrom::{BlockFactors, BlockLowRank, SparseEntry};
use half::f16;
use rayon::prelude::*;
use std::ops::Range;

use super::chunk::ChunkLimits;
use crate::layout::{AT_A_TIME, Block, COMPONENTS, SEGMENT, THREADS};
use crate::packing::{Kept, Precision};
use crate::relight::RelightError;

/// A block, and what is kept of it.
#[derive(Debug)]
pub(super) struct Item<'a> {
    factors: &'a BlockFactors,
    kept: Kept,
}

/// Blocks of a run, by all cores; none where there is nothing.
pub(super) fn items(low_rank: &BlockLowRank, run: Range<usize>, precision: Precision) -> Vec<Option<Item<'_>>> {
    let item = |block_idx: usize| {
        let factors = low_rank.blocks[block_idx].as_deref()?;
        let is_empty = factors.rank == 0 && factors.sparse.is_empty();
        (!is_empty).then(|| Item { factors, kept: precision.keep(factors) })
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

    /// Components of the right factor: halves, and bytes.
    fn n_right(&self) -> [u64; 2] {
        let n_halves = self.kept.right.n_halves as u64;
        [n_halves, u64::from(self.factors.rank) - n_halves]
    }

    /// Components of the block, those included that fill the last word of the left factor.
    fn n_components(&self) -> u32 {
        let n_halves = self.kept.left.n_halves as u32;
        n_halves.next_multiple_of(2) + (self.factors.rank - n_halves).next_multiple_of(4)
    }
}

/// Words of one component of a right factor, of halves or of bytes: as many as `project` reads at a time, again and again.
fn right_words(kind: usize, n_cols: u32) -> u64 {
    4 * u64::from(n_cols.div_ceil(AT_A_TIME[kind]))
}

/// One component of a right factor.
#[derive(Clone, Copy, Debug)]
struct Component {
    /// Among the items.
    item: u32,
    /// Within its block.
    k: u32,
    /// Place in `z`.
    z: u32,
}

/// What the buffers of a chunk hold, before upload.
#[derive(Debug, Default)]
pub(super) struct Packed<'a> {
    /// One per tile, with content or without.
    pub blocks: Vec<Block>,
    items: Vec<&'a Item<'a>>,
    /// The block of each item.
    item_blocks: Vec<u32>,
    n_cols: u32,
    /// Words of left factors, which [`Self::left_parts`] packs.
    pub n_left: u64,
    /// Components of right factors, halves and bytes, which [`Self::right_parts`] packs.
    right: [Vec<Component>; 2],
    /// Largest magnitude of the left factor per channel, and scale; one per component, and some that fill words.
    pub components: Vec<[f32; 4]>,
    /// Of each block with sparse terms, where the terms of its pixels start, and where the last ends; then its terms.
    pub sparse: Vec<u32>,
}

/// Words that are packed at a time, so that little of a large frame lies in memory twice.
const PART_WORDS: u64 = 8 << 20;

/// Bytes of the buffers that a run of blocks needs: blocks, left, right, components, partials, places of components, sparse entries.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Sizes([u64; 7]);

impl Sizes {
    /// Of a tile without content.
    const EMPTY: Self = Self([size_of::<Block>() as u64, 0, 0, 0, 0, 0, 0]);

    fn of(item: &Item) -> Self {
        let n_cols = item.factors.n_cols;
        let (n_right, n_components) = (item.n_right(), u64::from(item.n_components()));
        Self([
            size_of::<Block>() as u64,
            4 * item.n_left(),
            4 * (0..2).map(|kind| n_right[kind] * right_words(kind, n_cols)).sum::<u64>(),
            16 * n_components,
            16 * n_components * (u64::from(n_cols.div_ceil(SEGMENT)) + 2),
            4 * n_right.iter().sum::<u64>(),
            4 * n_sparse_words(item.factors),
        ])
    }

    fn with(self, more: Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i] + more.0[i]))
    }

    pub(super) fn largest(self) -> u64 {
        self.0.into_iter().max().unwrap_or(0)
    }

    /// Bytes of all of them.
    fn total(self) -> u64 {
        self.0.into_iter().sum::<u64>()
    }
}

/// Words of a block's sparse entries.
fn n_sparse_words(factors: &BlockFactors) -> u64 {
    if factors.sparse.is_empty() { 0 } else { u64::from(factors.n_rows) / 3 + 1 + 2 * factors.sparse.len() as u64 }
}

/// Bytes that the factors of a group take on a device, without the edges of buffers.
pub(super) fn group_bytes(low_rank: &BlockLowRank, precision: Precision) -> u64 {
    let items = items(low_rank, 0..low_rank.blocks.len(), precision);
    items.iter().map(|item| item.as_ref().map_or(Sizes::EMPTY, Sizes::of).total()).sum()
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
        let own = item.as_ref().map_or(Sizes::EMPTY, Sizes::of);
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
pub(super) fn pack<'a>(low_rank: &BlockLowRank, run: Range<usize>, items: &'a [Option<Item<'a>>]) -> Packed<'a> {
    let mut packed = Packed { n_cols: low_rank.n_cols, ..Packed::default() };
    for (tile, item) in run.zip(items) {
        let [x, y, width, height] = low_rank.partition.rect(tile);
        let empty = Block { n_pixels: width * height, x, y, width, tile: tile as u32, ..Block::default() };
        match item {
            Some(item) => packed.push(item, empty),
            None => packed.blocks.push(empty),
        }
    }
    packed
}

impl<'a> Packed<'a> {
    /// Appends the table entry and the small parts of a block, and makes room for the large ones.
    fn push(&mut self, item: &'a Item<'a>, tile: Block) {
        let (factors, z) = (item.factors, self.components.len() as u32);
        self.item_blocks.push(self.blocks.len() as u32);
        self.blocks.push(Block {
            rank: factors.rank,
            left: self.n_left as u32,
            z,
            sparse: self.sparse.len() as u32,
            n_sparse: factors.sparse.len() as u32,
            n_components: item.n_components(),
            left_halves: item.kept.left.n_halves as u32,
            ..tile
        });
        self.n_left += item.n_left();
        for k in 0..factors.rank {
            let kind = usize::from(k as usize >= item.kept.right.n_halves);
            self.right[kind].push(Component { item: self.items.len() as u32, k, z: z + k });
        }
        self.items.push(item);
        self.components.extend(components(item));
        self.components.resize((z + item.n_components()) as usize, [0.0; 4]);
        if !factors.sparse.is_empty() {
            self.push_sparse(factors, tile.n_pixels);
        }
    }

    /// Blocks with content.
    pub(super) fn n_items(&self) -> usize {
        self.items.len()
    }

    /// Components of right factors, halves and bytes.
    pub(super) fn n_right(&self) -> [u32; 2] {
        [0, 1].map(|kind| self.right[kind].len() as u32)
    }

    /// How many components of right factors are halves, how many bytes, and the place in `z` of each.
    pub(super) fn components_of(&self) -> Vec<u32> {
        self.n_right().into_iter().chain(self.right.iter().flatten().map(|component| component.z)).collect()
    }

    /// Words of right factors.
    pub(super) fn n_right_words(&self) -> u64 {
        (0..2).map(|kind| self.right[kind].len() as u64 * right_words(kind, self.n_cols)).sum()
    }

    /// Pairs of f16 and fours of bytes, of each block word by word, channel by channel, pixel by pixel; with the position of each part.
    pub(super) fn left_parts(&self) -> impl Iterator<Item = (u64, Vec<u32>)> {
        let start = |item: usize| {
            self.item_blocks.get(item).map_or(self.n_left, |block| self.blocks[*block as usize].left.into())
        };
        let mut first = 0;
        std::iter::from_fn(move || {
            let (from, begin) = (start(first), first);
            self.items.get(first)?;
            while first < self.items.len() && start(first) - from < PART_WORDS {
                first += 1;
            }
            let mut words = vec![0; (start(first) - from) as usize];
            let shares = (begin..first).map(|item| (start(item + 1) - start(item)) as usize);
            let shares = split(&mut words, shares);
            self.items[begin..first].par_iter().zip(shares).for_each(|(item, share)| pack_left(item, share));
            Some((from, words))
        })
    }

    /// Bands of components, as `project` reads them; with the position of each part.
    pub(super) fn right_parts(&self) -> impl Iterator<Item = (u64, Vec<u32>)> {
        let bands = (0..2)
            .flat_map(|kind| self.right[kind].chunks((COMPONENTS * THREADS) as usize).map(move |band| (kind, band)));
        let mut bands = bands.peekable();
        let mut position = 0;
        std::iter::from_fn(move || {
            let (mut part, mut lens) = (Vec::new(), Vec::new());
            while lens.iter().sum::<usize>() < PART_WORDS as usize
                && let Some((kind, band)) = bands.next()
            {
                lens.push(band.len() * right_words(kind, self.n_cols) as usize);
                part.push((kind, band));
            }
            let mut words = vec![0; lens.iter().sum()];
            let shares = split(&mut words, lens.into_iter());
            part.par_iter().zip(shares).for_each(|((kind, band), share)| self.pack_right(*kind, band, share));
            let from = position;
            position += words.len() as u64;
            (!part.is_empty()).then_some((from, words))
        })
    }

    /// One band: of as many columns as are read at a time component after component, and so on.
    fn pack_right(&self, kind: usize, band: &[Component], words: &mut [u32]) {
        let at_a_time = AT_A_TIME[kind] as usize;
        for (at, component) in band.iter().enumerate() {
            let (item, k) = (self.items[component.item as usize], component.k as usize);
            let n_cols = self.n_cols as usize;
            let row = &item.factors.right[k * n_cols..][..n_cols];
            for (i, cols) in row.chunks(at_a_time).enumerate() {
                let words = &mut words[4 * (i * band.len() + at)..][..4];
                for (word, entries) in words.iter_mut().zip(cols.chunks(at_a_time / 4)) {
                    *word = match kind {
                        0 => word_of(entries[0], entries.get(1)),
                        _ => word_of_bytes(|i| entries.get(i).map_or(0, |entry| item.kept.right.byte(k, *entry))),
                    };
                }
            }
        }
    }

    fn push_sparse(&mut self, factors: &BlockFactors, n_pixels: u32) {
        // Entries are sorted by row, and so by pixel.
        let mut at = self.sparse.len() as u32 + n_pixels + 1;
        let mut entries = factors.sparse.iter().peekable();
        for pixel in 0..n_pixels {
            self.sparse.push(at);
            while entries.next_if(|entry| entry.row / 3 == pixel).is_some() {
                at += 2;
            }
        }
        self.sparse.push(at);
        let words = |entry: &SparseEntry| [entry.col | (entry.row % 3) << 30, entry.value.to_bits()];
        self.sparse.extend(factors.sparse.iter().flat_map(words));
    }
}

/// Cuts `words` into shares of these lengths.
fn split(mut words: &mut [u32], lens: impl Iterator<Item = usize>) -> Vec<&mut [u32]> {
    let mut shares = Vec::new();
    for len in lens {
        let (share, rest) = words.split_at_mut(len);
        shares.push(share);
        words = rest;
    }
    shares
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

fn pack_left(item: &Item, words: &mut [u32]) {
    let (rank, side) = (item.factors.rank as usize, &item.kept.left);
    let n_pixels = item.factors.n_rows as usize / 3;
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

/// Four bytes, the first the lowest, as `signed_bytes` in `blocks.wgsl` takes them.
fn word_of_bytes(byte: impl Fn(usize) -> i8) -> u32 {
    u32::from_le_bytes(std::array::from_fn(|i| byte(i).cast_unsigned()))
}

/// The first half in the lower bits, as `unpack2x16float` takes it.
fn word_of(first: f16, second: Option<&f16>) -> u32 {
    u32::from(first.to_bits()) | u32::from(second.map_or(0, |h| h.to_bits())) << 16
}
