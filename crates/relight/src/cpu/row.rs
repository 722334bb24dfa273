//! One row of tiles: what is kept of it from one picture to the next, and how it is brought up to date.

use super::expand::{Place, Scratch, Source, Write};
use super::left::Left;
use super::project::Partials;
use super::quad::Quad;
use super::{GroupInput, GroupState, Step};
use crate::relight::RelightStats;

/// What is kept of one row of tiles, per group.
#[derive(Debug)]
pub(super) struct TileRow(pub Vec<GroupRow>);

/// What is kept of one row of tiles of one group.
#[derive(Clone, Debug)]
pub(super) struct GroupRow {
    pub tiles: Vec<Tile>,
    /// Pixels of this row of tiles, row by row over the whole width; empty before the group was first lit.
    radiance: Vec<[f32; 3]>,
    /// Whether `radiance` is what the tiles expand to.
    is_kept: bool,
    /// Whether no tile stayed what it was at the last change; the first picture is none.
    moved_whole: bool,
}

/// What is kept of one tile of one group.
#[derive(Clone, Debug, Default)]
pub(super) struct Tile {
    /// What it was expanded from; none where it must be expanded.
    z: Option<Vec<Quad>>,
    /// What `z` is the sum of, under the coefficients that are cached.
    partials: Partials,
    /// Left factors of its block; none before it was first expanded.
    left: Option<Left>,
    /// Most by which any channel of its radiance misses the coefficients that are cached, nit.
    behind: f32,
}

/// Room that tiles use one after the other.
#[derive(Default)]
struct Room {
    z: Vec<Quad>,
    /// Of each tile of the row whether it must be expanded.
    moves: Vec<bool>,
    scratch: Scratch,
}

impl TileRow {
    /// Before anything is lit.
    pub(super) fn new(n_groups: usize, n_tiles: usize) -> Self {
        let tiles = vec![Tile::default(); n_tiles];
        Self(vec![GroupRow { tiles, radiance: Vec::new(), is_kept: false, moved_whole: false }; n_groups])
    }

    /// Brings every lit group up to date and sums them into `pixels`.
    pub(super) fn relight(
        &mut self,
        step: &Step,
        row_idx: usize,
        inputs: &[GroupInput],
        pixels: &mut [[f32; 3]],
    ) -> RelightStats {
        let mut stats = RelightStats::default();
        let mut room = Room::default();
        let mut write = Write::Set;
        for (group, (group_row, input)) in self.0.iter_mut().zip(inputs).enumerate() {
            if input.state == GroupState::Dark {
                stats.n_skipped += group_row.tiles.len();
                continue;
            }
            group_row.relight(step, (group, row_idx), input, &mut room, (pixels, write), &mut stats);
            write = Write::Add;
        }
        if write == Write::Set {
            pixels.fill([0.0; 3]);
        }
        stats
    }
}

impl GroupRow {
    /// Where all of a row moves, and moved the last time, too, it goes straight into the picture: what will move again is not
    /// worth keeping, and keeping it would move more bytes than a block of rank 8 has. Otherwise it is kept, and the picture takes a copy.
    fn relight(
        &mut self,
        step: &Step,
        (group, row_idx): (usize, usize),
        input: &GroupInput,
        room: &mut Room,
        (pixels, write): (&mut [[f32; 3]], Write),
        stats: &mut RelightStats,
    ) {
        let is_whole = self.project(step, (group, row_idx), input, room, stats);
        if is_whole && self.moved_whole {
            self.is_kept = false;
            (0..self.tiles.len()).for_each(|tile| {
                self.expand(step, (group, row_idx, tile), input, &mut room.scratch, (pixels, write), stats)
            });
            return;
        }
        if input.state == GroupState::Changed {
            self.moved_whole = is_whole && !self.radiance.is_empty();
        }
        let mut radiance = std::mem::take(&mut self.radiance);
        radiance.resize(pixels.len(), [0.0; 3]);
        for tile in 0..self.tiles.len() {
            if room.moves[tile] || !self.is_kept {
                let into = (&mut radiance[..], Write::Set);
                self.expand(step, (group, row_idx, tile), input, &mut room.scratch, into, stats);
            } else {
                stats.skip(self.tiles[tile].behind);
            }
        }
        self.is_kept = true;
        match write {
            Write::Set => pixels.copy_from_slice(&radiance),
            Write::Add => super::add(&radiance, pixels),
        }
        self.radiance = radiance;
    }

    /// Finds the tiles that something moves in that is seen, and what they are to be expanded from; whether that is all that have any
    /// content.
    fn project(
        &mut self,
        step: &Step,
        (group, row_idx): (usize, usize),
        input: &GroupInput,
        room: &mut Room,
        stats: &mut RelightStats,
    ) -> bool {
        room.moves.clear();
        let mut is_whole = true;
        let n_tiles = self.tiles.len();
        let first = row_idx * n_tiles;
        for (tile_idx, tile) in self.tiles.iter_mut().enumerate() {
            let is_near = tile.behind <= step.tolerance;
            if tile.z.is_some() && input.state == GroupState::Unchanged && is_near {
                room.moves.push(false);
                is_whole = false;
                continue;
            }

            // The same `z` expands to the same pixels, and nearly the same to nearly the same, unless sparse entries carry
            // another coefficient past it.
            let factors = step.frame.block(group, first + tile_idx).map(|block| &**block);
            room.z.clear();
            let next = (tile_idx + 1 < n_tiles).then(|| step.frame.block(group, first + tile_idx + 1)).flatten();
            let factors_then = (factors, next.map(|block| &**block));
            stats.n_bytes += tile.partials.project(step.kernel, factors_then, &input.planes, &mut room.z);
            if let Some(behind) = tile.behind_of(&room.z)
                && behind <= step.tolerance
                && !input.planes.moves_sparse(factors)
            {
                tile.behind = behind;
                room.moves.push(false);
                is_whole &= factors.is_none_or(|f| f.rank == 0 && f.sparse.is_empty());
                continue;
            }
            room.moves.push(true);
            tile.behind = 0.0;
            let z = tile.z.get_or_insert_default();
            z.clear();
            z.extend_from_slice(&room.z);
        }
        is_whole
    }

    /// Writes the pixels of one tile.
    fn expand(
        &mut self,
        step: &Step,
        (group, row_idx, tile_idx): (usize, usize, usize),
        input: &GroupInput,
        scratch: &mut Scratch,
        (pixels, write): (&mut [[f32; 3]], Write),
        stats: &mut RelightStats,
    ) {
        let partition = &step.frame.groups[group].partition;
        let block_idx = row_idx * self.tiles.len() + tile_idx;
        let [x, _, width, height] = partition.rect(block_idx);
        let stride = step.frame.width as usize;
        let place = Place { x: x as usize, width: width as usize, height: height as usize, stride };
        let factors = step.frame.block(group, block_idx).map(|block| &**block);
        let tile = &mut self.tiles[tile_idx];
        if let Some(factors) = factors.filter(|f| f.rank > 0 && tile.left.is_none()) {
            tile.left = Some(Left::new(factors));
        }
        let tile = &self.tiles[tile_idx];
        let z = tile.z.as_deref().unwrap_or_default();
        let source = Source { factors, left: tile.left.as_ref(), z, planes: &input.planes };
        let n_bytes = scratch.expand(step.kernel, &source, (place, write), pixels);
        stats.n_bytes += n_bytes;
        if n_bytes > 0 {
            stats.n_expanded += 1;
        } else {
            stats.n_skipped += 1;
        }
    }
}

impl Tile {
    /// Most by which its radiance misses what it would be under another `z`, nit; none where it has no radiance.
    fn behind_of(&self, z: &[Quad]) -> Option<f32> {
        match (&self.z, &self.left) {
            (Some(shown), _) if shown == z => Some(0.0),
            (Some(shown), Some(left)) => Some(left.most_change(shown, z)),
            _ => None,
        }
    }
}
