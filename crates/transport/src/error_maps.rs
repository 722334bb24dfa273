//! Errors block by block: where a bake is less exact than it is in the mean, and why.
//!
//! All rows of a block are sampled and projected, so what its chosen rows miss and what its rank leaves out are one layer, which
//! the half that had no part in the fit tells; the factors keep no more than that.

use std::sync::Arc;

use clerestory_nystrom::{BlockError, BlockFactors};
use serde::Serialize;

use crate::bake::Bake;
use crate::figures::BEST_DB;

/// A layer of the error: one value per block in dB below the columns' peaks, row by row from the top left; none where a
/// block is not there, or where nothing tells of noise.
pub type Layer = Vec<Option<f32>>;

/// Which part of the error of a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErrorLayer {
    /// What ranks and rounding leave out, as the half tells that had no part in the fit.
    Truncation,
    /// Sampling noise that stays in the factors, as both halves tell.
    Sampling,
    /// Sampling noise of the entries before compression.
    Noise,
    /// Truncation and sampling together.
    Total,
}

impl ErrorLayer {
    /// Mean square per entry.
    fn of(self, error: &BlockError) -> f32 {
        match self {
            ErrorLayer::Truncation => error.truncation.max(0.0),
            ErrorLayer::Sampling => error.sampling,
            ErrorLayer::Noise => error.noise,
            ErrorLayer::Total => error.truncation.max(0.0) + error.sampling,
        }
    }

    /// Whether it takes samples to know it: pictures that were taken tell nothing of their own noise.
    pub fn is_of_noise(self) -> bool {
        matches!(self, ErrorLayer::Sampling | ErrorLayer::Noise)
    }
}

/// The layers of a bake's error, each as a map of its blocks.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ErrorMaps {
    /// Blocks across.
    pub width: u32,
    /// Blocks down.
    pub height: u32,
    /// See [`ErrorLayer::Truncation`].
    pub truncation: Layer,
    /// See [`ErrorLayer::Sampling`].
    pub sampling: Layer,
    /// See [`ErrorLayer::Noise`].
    pub noise: Layer,
    /// See [`ErrorLayer::Total`].
    pub total: Layer,
}

/// What a map of blocks tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BlockMap {
    /// Rank, summed over the groups of columns.
    Rank,
    /// A layer of the error, dB below the columns' peaks.
    Error(ErrorLayer),
    /// Samples per pixel that were taken, the mean over the columns where some were taken over from an earlier bake.
    Samples,
}

/// How a layer is spread over the blocks, in dB.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Spread {
    /// The worst block.
    pub worst: f32,
    /// A tenth of the blocks is worse.
    pub tenth: f32,
    /// Half of the blocks is worse.
    pub median: f32,
}

/// The spread of every layer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct BlockErrorDb {
    /// See [`ErrorMaps`].
    pub truncation: Spread,
    /// See [`ErrorMaps`].
    pub sampling: Spread,
    /// See [`ErrorMaps`].
    pub noise: Spread,
    /// See [`ErrorMaps`].
    pub total: Spread,
}

impl Bake {
    /// The errors of all blocks of the picture, over all columns of the scene's own lights, each entry counting alike.
    pub fn error_maps(&self) -> ErrorMaps {
        let partition = self.header.partition();
        let layer = |layer: ErrorLayer| self.block_map(BlockMap::Error(layer));
        ErrorMaps {
            width: partition.tiles_x(),
            height: partition.tiles_y(),
            truncation: layer(ErrorLayer::Truncation),
            sampling: layer(ErrorLayer::Sampling),
            noise: layer(ErrorLayer::Noise),
            total: layer(ErrorLayer::Total),
        }
    }

    /// One value per block of the picture, row by row from the top left; none where a block is not there.
    pub fn block_map(&self, what: BlockMap) -> Layer {
        let value = |block_idx: usize| {
            let samples = self.samples(block_idx)?;
            match what {
                BlockMap::Rank => Some(self.rank(block_idx) as f32),
                BlockMap::Samples => Some(samples as f32),
                BlockMap::Error(layer) => self.block_db(block_idx, layer),
            }
        };
        (0..self.header.partition().n_blocks()).map(value).collect()
    }

    fn block_db(&self, block_idx: usize, layer: ErrorLayer) -> Option<f32> {
        if layer.is_of_noise() && self.header.basis.is_measured() {
            return None;
        }
        let of_group = |blocks: &[Option<Arc<BlockFactors>>], n_cols: u32| {
            let block = blocks[block_idx].as_ref()?;
            Some([f64::from(layer.of(&block.error)) * f64::from(n_cols), f64::from(n_cols)])
        };
        let groups = self.groups_of_lights().iter().filter_map(|group| of_group(&group.blocks, group.n_cols));
        let [sum, n_cols] = groups.reduce(|a, b| [a[0] + b[0], a[1] + b[1]])?;
        let db = -10.0 * (sum / n_cols).max(0.0).log10();
        Some((db as f32).min(BEST_DB))
    }
}

impl ErrorMaps {
    /// The spread of every layer over the blocks that are there.
    pub fn spread(&self) -> BlockErrorDb {
        BlockErrorDb {
            truncation: Spread::new(&self.truncation),
            sampling: Spread::new(&self.sampling),
            noise: Spread::new(&self.noise),
            total: Spread::new(&self.total),
        }
    }
}

impl Spread {
    /// Over the values that are there.
    pub(crate) fn new(layer: &Layer) -> Spread {
        let mut there: Vec<f32> = layer.iter().flatten().copied().collect();
        there.sort_by(f32::total_cmp);
        let at = |share: f64| there.get((there.len() as f64 * share) as usize).copied().unwrap_or(BEST_DB);
        Spread { worst: at(0.0), tenth: at(0.1), median: at(0.5) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spread_tells_the_worst_first_and_passes_over_what_is_not_there() {
        let layer: Layer = (0..20).rev().map(|db| (db != 3).then_some(db as f32)).chain([None]).collect();
        assert_eq!(Spread::new(&layer), Spread { worst: 0.0, tenth: 1.0, median: 10.0 });
        assert_eq!(Spread::new(&vec![None]).worst, BEST_DB);
    }
}
