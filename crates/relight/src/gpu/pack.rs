//! Brings a run of blocks into the form the shaders read.

use clerestory_nystrom::{BlockFactors, BlockLowRank};
use half::f16;
use rayon::prelude::*;
use std::ops::Range;

use crate::layout::{Block, SEGMENT, SparseTerm};

/// The buffers of a chunk, before upload.
#[derive(Debug, Default)]
pub(super) struct Packed {
    /// Blocks with content; the others are left out.
    pub blocks: Vec<Block>,
    /// Pairs of f16: of each block pair by pair, channel by channel, pixel by pixel.
    pub left: Vec<u32>,
    /// Pairs of f16: of each block row by row.
    pub right: Vec<u32>,
    /// Largest magnitude of the left factor per channel, and scale; one per component, of an even number of them per block.
    pub components: Vec<[f32; 4]>,
    /// Of each block with sparse terms, where the terms of its pixels start, and where the last ends.
    pub sparse_starts: Vec<u32>,
    pub sparse_terms: Vec<SparseTerm>,
}

/// Size in bytes of the largest buffer that a run of blocks needs.
pub(super) fn largest_buffer(low_rank: &BlockLowRank, run: Range<usize>) -> u64 {
    let mut sizes = [0u64; 5];
    let n_segments = u64::from(low_rank.n_cols.div_ceil(SEGMENT));
    for f in low_rank.blocks[run].iter().flatten() {
        let (n_pixels, n_cols) = (u64::from(f.n_rows) / 3, u64::from(f.n_cols));
        let n_pairs = u64::from(f.rank).div_ceil(2);
        let n_sparse = f.sparse.len() as u64;
        let right = 4 * u64::from(f.rank) * n_cols.div_ceil(2);
        let own = [12 * n_pairs * n_pixels, right, 32 * n_pairs, 32 * n_pairs * n_segments, 8 * n_sparse];
        sizes.iter_mut().zip(own).for_each(|(size, own)| *size += own);
    }
    sizes.into_iter().max().unwrap_or(0)
}

/// Packs a run of blocks of one group.
pub(super) fn pack(low_rank: &BlockLowRank, run: Range<usize>) -> Packed {
    let mut packed = Packed::default();
    let mut with_content = Vec::new();
    for block_idx in run {
        let Some(factors) = &low_rank.blocks[block_idx] else { continue };
        if factors.rank > 0 || !factors.sparse.is_empty() {
            packed.push_entry(factors, low_rank.partition.rect(block_idx));
            with_content.push(&**factors);
        }
    }

    // The entries say where each block's share lies; left and right are most of the bytes and are filled by all cores.
    fill(&packed.blocks, &with_content, &mut packed.left, |b| b.left, pack_left);
    fill(&packed.blocks, &with_content, &mut packed.right, |b| b.right, |f, _, words| pack_right(f, words));
    packed
}

impl Packed {
    /// Appends the table entry and the small parts of a block, and makes room for the large ones.
    fn push_entry(&mut self, factors: &BlockFactors, [x, y, width, height]: [u32; 4]) {
        let n_pairs = factors.rank.div_ceil(2);
        let n_pixels = width * height;
        self.blocks.push(Block {
            rank: factors.rank,
            n_pixels,
            x,
            y,
            width,
            left: self.left.len() as u32,
            right: self.right.len() as u32,
            z: self.components.len() as u32,
            sparse: self.sparse_starts.len() as u32,
            n_sparse: factors.sparse.len() as u32,
        });
        self.left.resize(self.left.len() + (3 * n_pairs * n_pixels) as usize, 0);
        self.right.resize(self.right.len() + (factors.rank * factors.n_cols.div_ceil(2)) as usize, 0);
        self.components.extend(components(factors));
        self.components.resize(self.components.len().next_multiple_of(2), [0.0; 4]);
        if !factors.sparse.is_empty() {
            self.push_sparse(factors, n_pixels);
        }
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
