//! One row of tiles: how it is brought up to date, and what is kept of its radiance.

use super::expand::{Place, Scratch, Source, Write};
use super::kernel::Left;
use super::project::{Sums, project};
use super::quad::Quad;
use super::store::{Store, Tile};
use super::{GroupInput, GroupState, Step};
use crate::relight::RelightStats;
use clerestory_nystrom::SparseEntry;

/// What is kept of one row of tiles, per group.
#[derive(Debug)]
pub(super) struct TileRow(pub Vec<GroupRow>);

/// What is kept of one row of tiles of one group.
#[derive(Clone, Debug)]
pub(super) struct GroupRow {
    /// None before the group was first lit.
    store: Option<Store>,
    /// Tiles whose block is another than that of the store.
    stale: Vec<bool>,
    /// Pixels of this row of tiles, row by row over the whole width; empty before the group was first lit.
    radiance: Vec<[f32; 3]>,
    /// Whether `radiance` is what the tiles expand to.
    is_kept: bool,
    /// Whether no tile stayed what it was at the last change; the first picture is none.
    moved_whole: bool,
    /// Whether every segment of columns changed the last time.
    changed_whole: bool,
}

/// Room that tiles use one after the other.
#[derive(Default)]
struct Room {
    z: Vec<Quad>,
    /// Sums over all segments, where those of each are not kept.
    total: Vec<Quad>,
    /// Of each tile of the row whether it must be expanded.
    moves: Vec<bool>,
    /// Group after group, of each tile the most by which its radiance misses the coefficients, nit.
    behind: Vec<f32>,
    scratch: Scratch,
}

/// One row of tiles of one group, and the light on it.
struct Job<'a> {
    step: &'a Step<'a>,
    group: usize,
    row_idx: usize,
    input: &'a GroupInput,
}

impl TileRow {
    /// Before anything is lit.
    pub(super) fn new(n_groups: usize, n_tiles: usize) -> Self {
        let row = GroupRow {
            store: None,
            stale: vec![false; n_tiles],
            radiance: Vec::new(),
            is_kept: false,
            moved_whole: false,
            changed_whole: false,
        };
        Self(vec![row; n_groups])
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
        for (group_row, input) in self.0.iter().zip(inputs) {
            group_row.put_behind(input.state, &mut room.behind);
        }
        for (group, (group_row, input)) in self.0.iter_mut().zip(inputs).enumerate() {
            if input.state == GroupState::Dark {
                stats.n_skipped += group_row.stale.len();
                continue;
            }
            group_row.relight(&Job { step, group, row_idx, input }, &mut room, (pixels, write), &mut stats);
            write = Write::Add;
        }
        if write == Write::Set {
            pixels.fill([0.0; 3]);
        }
        stats
    }
}

impl GroupRow {
    /// The block of a tile is another.
    pub(super) fn replace(&mut self, tile: usize) {
        self.stale[tile] = true;
    }

    /// Appends by how much each tile of the group is behind; a dark group is in no picture.
    fn put_behind(&self, state: GroupState, behind: &mut Vec<f32>) {
        match &self.store {
            Some(store) if state != GroupState::Dark => behind.extend(store.tiles.iter().map(|tile| tile.behind)),
            _ => behind.resize(behind.len() + self.stale.len(), 0.0),
        }
    }

    /// Where all of a row moves, and moved the last time, too, it goes straight into the picture: what will move again is not
    /// worth keeping. Otherwise it is kept, and the picture takes a copy.
    fn relight(
        &mut self,
        job: &Job,
        room: &mut Room,
        (pixels, write): (&mut [[f32; 3]], Write),
        stats: &mut RelightStats,
    ) {
        let older = self.store.take();
        let mut store = match older {
            Some(store) if !self.stale.contains(&true) => store,
            older => {
                let older = older.as_ref().map(|store| (store, &self.stale[..]));
                Store::new((job.step.frame, job.step.precision), (job.group, job.row_idx), older)
            }
        };
        self.stale.fill(false);

        let is_changed_whole = job.input.state == GroupState::Changed && job.input.planes.are_all_changed();
        let sums = if is_changed_whole && self.changed_whole { Sums::AddedUp } else { Sums::Kept };
        if job.input.state == GroupState::Changed {
            self.changed_whole = is_changed_whole;
        }
        let is_whole = job.project(&mut store, sums, room, stats);
        if is_whole && self.moved_whole {
            self.is_kept = false;
            (0..store.tiles.len()).for_each(|tile| job.expand(&store, tile, &mut room.scratch, (pixels, write), stats));
            self.store = Some(store);
            return;
        }
        if job.input.state == GroupState::Changed {
            self.moved_whole = is_whole && !self.radiance.is_empty();
        }
        self.radiance.resize(pixels.len(), [0.0; 3]);
        for (tile, moves) in room.moves.iter().enumerate() {
            if *moves || !self.is_kept {
                job.expand(&store, tile, &mut room.scratch, (&mut self.radiance, Write::Set), stats);
            } else {
                stats.skip(store.tiles[tile].behind);
            }
        }
        self.is_kept = true;
        match write {
            Write::Set => pixels.copy_from_slice(&self.radiance),
            Write::Add => super::add(&self.radiance, pixels),
        }
        self.store = Some(store);
    }
}

impl Job<'_> {
    /// Finds the tiles in which something moves that is seen; whether those are all that have any content.
    fn project(&self, store: &mut Store, sums: Sums, room: &mut Room, stats: &mut RelightStats) -> bool {
        let (planes, n_tiles) = (&self.input.planes, store.tiles.len());
        let is_changed = self.input.state == GroupState::Changed;
        // Groups add up, and what the others miss already is not left for this one.
        let allowed = |tile_idx: usize, behind: &[f32]| {
            let groups = behind.chunks_exact(n_tiles).enumerate().filter(|(group, _)| *group != self.group);
            (self.step.tolerance - groups.map(|(_, tiles)| tiles[tile_idx]).sum::<f32>()).max(0.0)
        };
        let is_due = |tile_idx: usize, tile: &Tile| {
            is_changed || !tile.is_shown || tile.behind > allowed(tile_idx, &room.behind)
        };
        stats.n_bytes += project(store, self.step.kernel, planes, (sums, &mut room.total), is_due);
        let mut is_whole = is_changed;
        room.moves.clear();
        for tile_idx in 0..n_tiles {
            let tolerance = allowed(tile_idx, &room.behind);
            let tile = &store.tiles[tile_idx];
            let (rank, is_settled) = (tile.rank, tile.is_shown && tile.behind <= tolerance);
            // The same `z` expands to the same pixels, and nearly the same to nearly the same, unless sparse entries carry
            // another coefficient past it.
            let sparse = self.sparse(store, tile_idx);
            let total = (sums == Sums::AddedUp).then_some(&room.total[..]);
            let moves = (is_changed || !is_settled)
                && store.settle(tile_idx, (tolerance, planes.moves(sparse)), total, &mut room.z);
            room.behind[self.group * n_tiles + tile_idx] = store.tiles[tile_idx].behind;
            is_whole &= moves || (rank == 0 && sparse.is_empty());
            room.moves.push(moves);
        }
        is_whole
    }

    /// Writes the pixels of one tile.
    fn expand(
        &self,
        store: &Store,
        tile_idx: usize,
        scratch: &mut Scratch,
        (pixels, write): (&mut [[f32; 3]], Write),
        stats: &mut RelightStats,
    ) {
        let block_idx = self.block_idx(store, tile_idx);
        let [x, _, width, height] = self.step.frame.groups[self.group].partition.rect(block_idx);
        let stride = self.step.frame.width as usize;
        let place = Place { x: x as usize, width: width as usize, height: height as usize, stride };
        let tile = &store.tiles[tile_idx];
        let source = Source {
            left: Left { factors: store.left_from(tile), n: tile.left },
            z: store.z_of(tile),
            sparse: self.sparse(store, tile_idx),
            planes: &self.input.planes,
        };
        let n_bytes = scratch.expand(self.step.kernel, &source, (place, write), pixels);
        stats.n_bytes += n_bytes;
        if n_bytes > 0 {
            stats.n_expanded += 1;
        } else {
            stats.n_skipped += 1;
        }
    }

    fn sparse(&self, store: &Store, tile_idx: usize) -> &[SparseEntry] {
        if !store.tiles[tile_idx].has_sparse {
            return &[];
        }
        self.step.sparse(self.group, self.block_idx(store, tile_idx))
    }

    fn block_idx(&self, store: &Store, tile_idx: usize) -> usize {
        self.row_idx * store.tiles.len() + tile_idx
    }
}
