//! Frames made from a seed, for tests and benchmarks: every shape that a bake can produce, and no light in them.

use clerestory_nystrom::{BlockError, BlockFactors, BlockLowRank, Partition, SparseEntry};
use half::f16;
use rayon::prelude::*;
use std::sync::Arc;

use crate::frame::Frame;

/// What a synthetic frame looks like.
#[derive(Clone, Debug)]
pub struct Recipe {
    /// Pixels per row.
    pub width: u32,
    /// Rows of pixels.
    pub height: u32,
    /// Side of a tile in pixels.
    pub tile: u32,
    /// Columns of each group.
    pub n_cols: Vec<u32>,
    /// Ranks of the blocks.
    pub rank: Ranks,
    /// Sparse entries per block, at most.
    pub n_sparse: u32,
    /// Whether no factor is negative, so that all radiance is light.
    pub is_positive: bool,
    /// Mean square error that every block says it has; 0 says that none was measured.
    pub truncation: f32,
    /// Same seed, same frame.
    pub seed: u64,
}

/// Ranks of the blocks of a synthetic frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ranks {
    /// The same rank everywhere.
    Fixed(u32),
    /// Between 0 and the given rank.
    Spread(u32),
    /// Between 0 and the given rank, and some blocks that are not there yet.
    Mixed(u32),
}

impl Default for Recipe {
    fn default() -> Self {
        let (n_cols, rank) = (vec![19, 1], Ranks::Mixed(40));
        Self { width: 37, height: 23, tile: 8, n_cols, rank, n_sparse: 3, is_positive: false, truncation: 0.0, seed: 1 }
    }
}

impl Recipe {
    /// The frame.
    pub fn frame(&self) -> Frame {
        let partition = Partition { width: self.width, height: self.height, tile: self.tile };
        let group = |(group, &n_cols): (usize, &u32)| {
            let blocks =
                (0..partition.n_blocks()).into_par_iter().map(|block| self.block(&partition, group, block, n_cols));
            BlockLowRank { partition: partition.clone(), bundle_len: 3, n_cols, blocks: blocks.collect() }
        };
        Frame { width: self.width, height: self.height, groups: self.n_cols.iter().enumerate().map(group).collect() }
    }

    /// Coefficients between 0 and 1 for every column.
    pub fn coefficients(&self, seed: u64) -> Vec<Vec<[f32; 3]>> {
        let mut random = Random(seed);
        let mut rgb = || [(); 3].map(|()| 0.5 + 0.5 * random.signed());
        self.n_cols.iter().map(|n| (0..*n).map(|_| rgb()).collect()).collect()
    }

    fn block(&self, partition: &Partition, group: usize, block: usize, n_cols: u32) -> Option<Arc<BlockFactors>> {
        let mut random = Random(self.seed ^ ((group as u64) << 48) ^ ((block as u64) << 16));
        let [_, _, w, h] = partition.rect(block);
        let n_rows = 3 * w * h;
        let rank = match self.rank {
            Ranks::Fixed(rank) => rank,
            Ranks::Mixed(_) if random.below(8) == 0 => return None,
            Ranks::Spread(rank) | Ranks::Mixed(rank) => random.below(rank + 1),
        };
        let entry = |value: f32| f16::from_f32(if self.is_positive { value.abs() } else { value });
        let mut halves = |n: u32| (0..n).map(|_| entry(random.signed())).collect::<Vec<_>>();
        let (left, right) = (halves(n_rows * rank), halves(rank * n_cols));
        let scale = (0..rank).map(|_| 2f32.powi(random.below(7) as i32 - 3)).collect();
        let n_sparse = random.below(self.n_sparse + 1);
        let mut sparse: Vec<_> = (0..n_sparse)
            .map(|_| SparseEntry {
                row: random.below(n_rows),
                col: random.below(n_cols),
                value: 50.0 * random.signed(),
            })
            .collect();
        sparse.sort_by_key(|entry| (entry.row, entry.col));
        sparse.dedup_by_key(|entry| (entry.row, entry.col));
        let error = BlockError { truncation: self.truncation, ..BlockError::default() };
        Some(Arc::new(BlockFactors {
            n_rows,
            n_cols,
            rank,
            left,
            scale,
            right,
            sparse,
            n_samples: 0,
            error,
            ..BlockFactors::default()
        }))
    }
}

/// SplitMix64 \[Steele2014\].
#[derive(Clone, Debug)]
pub(crate) struct Random(pub u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub(crate) fn signed(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1u64 << 23) as f32 - 1.0
    }

    pub(crate) fn below(&mut self, n: u32) -> u32 {
        (self.next() % u64::from(n)) as u32
    }
}
