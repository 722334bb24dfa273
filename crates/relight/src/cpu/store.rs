//! The factors of one row of tiles of one group as the kernels read them, and what is kept of them from one picture to the next.
//!
//! Blocks lie apart in memory, and memory answers the first reads of each of them late: factors that are copied into one stream
//! are read twice as fast. Right factors lie segment after segment, so that one light of many is a stream, too.

use clerestory_nystrom::{BlockFactors, Partition};
use half::f16;

use super::left::{self, RUN};
use super::project::{LANES, SEGMENT};
use super::quad::{QUAD, Quad};
use crate::frame::Frame;

/// Factors of a row of tiles, and the sums that they gave last.
#[derive(Clone, Debug)]
pub(super) struct Store {
    pub tiles: Vec<Tile>,
    /// Tile after tile, runs × rank × [`RUN`]; the last run of a tile ends in zeros.
    left: Vec<f16>,
    /// Segment after segment, tile after tile, quad after quad, lanes after lanes, of each the components of the quad; columns that do
    /// not fill their lanes end in zeros. Memory is read from front to back, in one stream.
    pub right: Vec<f16>,
    /// Columns of each segment, in whole lanes.
    pub widths: Vec<usize>,
    /// Of each quad the scales of its components.
    scales: Vec<Quad>,
    /// Of each quad the largest magnitudes in the left factor.
    largest: Vec<Quad>,
    /// Segments × quads of the row: what each adds to `z`, without scales.
    pub sums: Vec<Quad>,
    /// What tiles were expanded from.
    z: Vec<Quad>,
}

/// One tile of a row.
#[derive(Clone, Debug)]
pub(super) struct Tile {
    pub rank: usize,
    /// Its first component among those of the row.
    pub first: usize,
    /// Its first quad among those of the row.
    pub first_quad: usize,
    /// Whether its block has sparse entries: where it has none, the block itself is not looked at, which memory would answer late.
    pub has_sparse: bool,
    /// Its first half among the left factors of the row.
    first_left: usize,
    /// Whether `sums` are those of the coefficients that are cached.
    pub is_summed: bool,
    /// Whether `z` is what it was expanded from; else it must be expanded.
    pub is_shown: bool,
    /// Most by which any channel of its radiance misses the coefficients that are cached, nit.
    pub behind: f32,
}

impl Tile {
    pub(super) fn quads(&self) -> std::ops::Range<usize> {
        self.first_quad..self.first_quad + self.rank.div_ceil(QUAD)
    }
}

impl Store {
    /// Copies the factors of a row of tiles, and what an older copy knew of the tiles that are not `stale`.
    pub(super) fn new(frame: &Frame, (group, row_idx): (usize, usize), older: Option<(&Self, &[bool])>) -> Self {
        let low_rank = &frame.groups[group];
        let n_tiles = low_rank.partition.tiles_x() as usize;
        let blocks: Vec<usize> = (row_idx * n_tiles..(row_idx + 1) * n_tiles).collect();
        let factors: Vec<Option<&BlockFactors>> =
            blocks.iter().map(|block| frame.block(group, *block).map(|block| &**block)).collect();
        let tiles = tiles(&low_rank.partition, &blocks, &factors);
        let n_quads = tiles.last().map_or(0, |tile| tile.quads().end);
        let n_cols = low_rank.n_cols as usize;
        let width = |first: usize| SEGMENT.min(n_cols - first).next_multiple_of(LANES);
        let widths: Vec<usize> = (0..n_cols).step_by(SEGMENT).map(width).collect();
        let n_sums = widths.len() * n_quads;
        let mut store = Self {
            left: Vec::new(),
            right: right(&factors, &widths),
            widths,
            scales: Vec::with_capacity(n_quads),
            largest: Vec::with_capacity(n_quads),
            sums: vec![Quad::default(); n_sums],
            z: vec![Quad::default(); n_quads],
            tiles,
        };
        for factors in factors.into_iter().flatten() {
            let scale =
                |scales: &[f32]| Quad::from_rgb(std::array::from_fn(|k| [scales.get(k).copied().unwrap_or(0.0); 3]));
            store.scales.extend(factors.scale.chunks(QUAD).map(scale));
            left::append(factors, &mut store.left, &mut store.largest);
        }
        if let Some((older, stale)) = older {
            store.take_over(older, stale);
        }
        store
    }

    fn take_over(&mut self, older: &Self, stale: &[bool]) {
        let (n_quads, n_before) = (self.z.len(), older.z.len());
        for ((tile, before), _) in self.tiles.iter_mut().zip(&older.tiles).zip(stale).filter(|(_, stale)| !**stale) {
            (tile.is_summed, tile.is_shown, tile.behind) = (before.is_summed, before.is_shown, before.behind);
            self.z[tile.quads()].copy_from_slice(&older.z[before.quads()]);
            for segment in 0..self.widths.len() {
                let from = &older.sums[segment * n_before..][before.quads()];
                self.sums[segment * n_quads..][tile.quads()].copy_from_slice(from);
            }
        }
    }

    /// Left factors from that of a tile on.
    pub(super) fn left_from(&self, tile: &Tile) -> &[f16] {
        &self.left[tile.first_left..]
    }

    /// What a tile was expanded from.
    pub(super) fn z_of(&self, tile: &Tile) -> &[Quad] {
        &self.z[tile.quads()]
    }

    /// Brings `z` of a tile to what its sums give, unless its radiance would change by no more than `tolerance`, nit, and nothing else
    /// `moves` there; whether it must be expanded.
    pub(super) fn settle(&mut self, tile_idx: usize, tolerance: f32, moves: bool, fresh: &mut Vec<Quad>) -> bool {
        let tile = &mut self.tiles[tile_idx];
        fresh.clear();
        fresh.resize(tile.quads().len(), Quad::default());
        // In the order of the segments, whatever was projected just now.
        for sums in self.sums.chunks_exact(self.z.len().max(1)) {
            fresh.iter_mut().zip(&sums[tile.quads()]).for_each(|(z, sum)| *z = z.plus(sum));
        }
        fresh.iter_mut().zip(&self.scales[tile.quads()]).for_each(|(z, scale)| *z = z.times(scale));

        let shown = &mut self.z[tile.quads()];
        let is_same = shown == fresh;
        let behind = left::most_change(&self.largest[tile.quads()], shown, fresh);
        if tile.is_shown && !moves && (is_same || (behind > 0.0 && behind <= tolerance)) {
            tile.behind = behind;
            return false;
        }
        shown.copy_from_slice(fresh);
        (tile.is_shown, tile.behind) = (true, 0.0);
        true
    }
}

/// Where the tiles of a row lie in its streams.
fn tiles(partition: &Partition, blocks: &[usize], factors: &[Option<&BlockFactors>]) -> Vec<Tile> {
    let (mut first, mut first_quad, mut first_left) = (0, 0, 0);
    let of_block = |(block, factors): (&usize, &Option<&BlockFactors>)| {
        let [_, _, width, height] = partition.rect(*block);
        let n_rows = 3 * width as usize * height as usize;
        let rank = factors.map_or(0, |factors| factors.rank as usize);
        let at = (first, first_quad, first_left);
        first += rank;
        first_quad += rank.div_ceil(QUAD);
        first_left += n_rows.next_multiple_of(RUN) * rank;
        let (first, first_quad, first_left) = at;
        let has_sparse = factors.is_some_and(|factors| !factors.sparse.is_empty());
        Tile { rank, first, first_quad, has_sparse, first_left, is_summed: false, is_shown: false, behind: 0.0 }
    };
    blocks.iter().zip(factors).map(of_block).collect()
}

/// Right factors of a row of tiles.
fn right(factors: &[Option<&BlockFactors>], widths: &[usize]) -> Vec<f16> {
    let n_components: usize = factors.iter().flatten().map(|factors| factors.rank as usize).sum();
    let mut right = Vec::with_capacity(n_components * widths.iter().sum::<usize>());
    for (segment, width) in widths.iter().enumerate() {
        for factors in factors.iter().flatten() {
            for rows in factors.right.chunks(QUAD * factors.n_cols as usize) {
                for first in (0..*width).step_by(LANES) {
                    for row in rows.chunks_exact(factors.n_cols as usize) {
                        let cols = row.iter().skip(segment * SEGMENT + first).take(LANES);
                        let len = right.len() + LANES;
                        right.extend(cols);
                        right.resize(len, f16::ZERO);
                    }
                }
            }
        }
    }
    right
}
