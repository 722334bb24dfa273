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
use crate::packing::{Kept, Precision};

/// Factors of a row of tiles, and the sums that they gave last.
#[derive(Clone, Debug)]
pub(super) struct Store {
    pub tiles: Vec<Tile>,
    /// Tile after tile, runs × components × [`RUN`]; the last run of a tile ends in zeros.
    left: Stream,
    /// Segment after segment, tile after tile, quad after quad, lanes after lanes, of each the components of the quad; columns that do
    /// not fill their lanes end in zeros. Memory is read from front to back, in one stream.
    pub right: Stream,
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

/// Factors from front to back, those that are halves and those that are bytes.
#[derive(Clone, Debug, Default)]
pub(super) struct Stream {
    pub halves: Vec<f16>,
    pub bytes: Vec<i8>,
}

/// Where a share lies in a [`Stream`], or how long it is: of halves, and of bytes.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Share {
    pub halves: usize,
    pub bytes: usize,
}

impl Share {
    pub(super) fn plus(self, other: Self) -> Self {
        Self { halves: self.halves + other.halves, bytes: self.bytes + other.bytes }
    }

    pub(super) fn times(self, factor: usize) -> Self {
        Self { halves: self.halves * factor, bytes: self.bytes * factor }
    }

    /// Both kinds.
    pub(super) fn all(self) -> usize {
        self.halves + self.bytes
    }

    /// Memory of so many entries, bytes.
    pub(super) fn n_bytes(self) -> usize {
        2 * self.halves + self.bytes
    }
}

impl Stream {
    /// From a place on.
    pub(super) fn from(&self, first: Share) -> (&[f16], &[i8]) {
        (&self.halves[first.halves..], &self.bytes[first.bytes..])
    }
}

/// One tile of a row.
#[derive(Clone, Debug)]
pub(super) struct Tile {
    pub rank: usize,
    /// Its components in the left factor.
    pub left: Share,
    /// Its components in the right factor.
    pub right: Share,
    /// Those of the tiles before it.
    pub first_right: Share,
    /// Its first quad among those of the row.
    pub first_quad: usize,
    /// Whether its block has sparse entries: where it has none, the block itself is not looked at, which memory would answer late.
    pub has_sparse: bool,
    /// Its first entries among the left factors of the row.
    first_left: Share,
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
    pub(super) fn new(
        (frame, precision): (&Frame, Precision),
        (group, row_idx): (usize, usize),
        older: Option<(&Self, &[bool])>,
    ) -> Self {
        let low_rank = &frame.groups[group];
        let n_tiles = low_rank.partition.tiles_x() as usize;
        let blocks: Vec<usize> = (row_idx * n_tiles..(row_idx + 1) * n_tiles).collect();
        let kept = |block: &usize| frame.block(group, *block).map(|block| (&**block, precision.keep(block)));
        let factors: Vec<Option<(&BlockFactors, Kept)>> = blocks.iter().map(kept).collect();
        let tiles = tiles(&low_rank.partition, &blocks, &factors);
        let n_quads = tiles.last().map_or(0, |tile| tile.quads().end);
        let n_cols = low_rank.n_cols as usize;
        let width = |first: usize| SEGMENT.min(n_cols - first).next_multiple_of(LANES);
        let widths: Vec<usize> = (0..n_cols).step_by(SEGMENT).map(width).collect();
        let n_sums = widths.len() * n_quads;
        let mut store = Self {
            left: Stream::default(),
            right: right(&factors, &widths),
            widths,
            scales: Vec::with_capacity(n_quads),
            largest: Vec::with_capacity(n_quads),
            sums: vec![Quad::default(); n_sums],
            z: vec![Quad::default(); n_quads],
            tiles,
        };
        for (factors, kept) in factors.into_iter().flatten() {
            let scale =
                |scales: &[f32]| Quad::from_rgb(std::array::from_fn(|k| [scales.get(k).copied().unwrap_or(0.0); 3]));
            store.scales.extend(kept.scale.chunks(QUAD).map(scale));
            left::append(factors, &kept.left, &mut store.left, &mut store.largest);
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
    pub(super) fn left_from(&self, tile: &Tile) -> (&[f16], &[i8]) {
        self.left.from(tile.first_left)
    }

    /// What a tile was expanded from.
    pub(super) fn z_of(&self, tile: &Tile) -> &[Quad] {
        &self.z[tile.quads()]
    }

    /// Brings `z` of a tile to what its sums give, or what they were added up to, unless its radiance would change by no more than
    /// `tolerance`, nit, and nothing else `moves` there; whether it must be expanded.
    pub(super) fn settle(
        &mut self,
        tile_idx: usize,
        (tolerance, moves): (f32, bool),
        total: Option<&[Quad]>,
        fresh: &mut Vec<Quad>,
    ) -> bool {
        let tile = &mut self.tiles[tile_idx];
        fresh.clear();
        if let Some(total) = total {
            fresh.extend_from_slice(&total[tile.quads()]);
        } else {
            fresh.resize(tile.quads().len(), Quad::default());
            // In the order of the segments, whatever was projected just now.
            for sums in self.sums.chunks_exact(self.z.len().max(1)) {
                fresh.iter_mut().zip(&sums[tile.quads()]).for_each(|(z, sum)| *z = z.plus(sum));
            }
        }
        fresh.iter_mut().zip(&self.scales[tile.quads()]).for_each(|(z, scale)| *z = z.times(scale));

        let shown = &mut self.z[tile.quads()];
        let is_same = shown == fresh;
        let behind = match (is_same, tolerance > 0.0) {
            (true, _) => 0.0,
            (false, true) => left::most_change(&self.largest[tile.quads()], shown, fresh),
            // Nothing is left out where nothing may be.
            (false, false) => f32::MAX,
        };
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
fn tiles(partition: &Partition, blocks: &[usize], factors: &[Option<(&BlockFactors, Kept)>]) -> Vec<Tile> {
    let (mut first_right, mut first_quad, mut first_left) = (Share::default(), 0, Share::default());
    let of_block = |(block, factors): (&usize, &Option<(&BlockFactors, Kept)>)| {
        let [_, _, width, height] = partition.rect(*block);
        let n_rows = 3 * width as usize * height as usize;
        let rank = factors.as_ref().map_or(0, |(factors, _)| factors.rank as usize);
        let share = |n_halves: usize| Share { halves: n_halves, bytes: rank - n_halves };
        let left = factors.as_ref().map_or(Share::default(), |(_, kept)| share(kept.left.n_halves));
        let right = factors.as_ref().map_or(Share::default(), |(_, kept)| share(kept.right.n_halves));
        let has_sparse = factors.as_ref().is_some_and(|(factors, _)| !factors.sparse.is_empty());
        let (is_summed, is_shown, behind) = (false, false, 0.0);
        let tile =
            Tile { rank, left, right, first_right, first_quad, has_sparse, first_left, is_summed, is_shown, behind };
        first_right = first_right.plus(right);
        first_quad += rank.div_ceil(QUAD);
        first_left = first_left.plus(left.times(n_rows.next_multiple_of(RUN)));
        tile
    };
    blocks.iter().zip(factors).map(of_block).collect()
}

/// Right factors of a row of tiles.
fn right(factors: &[Option<(&BlockFactors, Kept)>], widths: &[usize]) -> Stream {
    let count = |n: fn(&BlockFactors, &Kept) -> usize| -> usize {
        factors.iter().flatten().map(|(factors, kept)| n(factors, kept)).sum::<usize>() * widths.iter().sum::<usize>()
    };
    let mut right = Stream {
        halves: Vec::with_capacity(count(|_, kept| kept.right.n_halves)),
        bytes: Vec::with_capacity(count(|factors, kept| factors.rank as usize - kept.right.n_halves)),
    };
    for (segment, width) in widths.iter().enumerate() {
        for (factors, kept) in factors.iter().flatten() {
            let n_cols = factors.n_cols as usize;
            let (rows, side) = (|k: usize| &factors.right[k * n_cols..][..n_cols], &kept.right);
            // Quads of halves first; no quad holds both.
            for quad in (0..factors.rank as usize).step_by(QUAD) {
                let components = quad..(quad + QUAD).min(factors.rank as usize);
                for first in (0..*width).step_by(LANES) {
                    for k in components.clone() {
                        let cols = rows(k).iter().skip(segment * SEGMENT + first).take(LANES);
                        if k < side.n_halves {
                            let len = right.halves.len() + LANES;
                            right.halves.extend(cols);
                            right.halves.resize(len, f16::ZERO);
                        } else {
                            let len = right.bytes.len() + LANES;
                            right.bytes.extend(cols.map(|entry| side.byte(k, *entry)));
                            right.bytes.resize(len, 0);
                        }
                    }
                }
            }
        }
    }
    right
}
