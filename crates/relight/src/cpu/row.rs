//! One row of tiles: how it is brought up to date, and what is kept of its radiance.

use super::expand::{Place, Scratch, Source, Write};
use super::kernel::Left;
use super::project::project;
use super::quad::Quad;
use super::store::Store;
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
}

/// Room that tiles use one after the other.
#[derive(Default)]
struct Room {
    z: Vec<Quad>,
    /// Of each tile of the row whether it must be expanded.
    moves: Vec<bool>,
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
        let stale = vec![false; n_tiles];
        Self(vec![GroupRow { store: None, stale, radiance: Vec::new(), is_kept: false, moved_whole: false }; n_groups])
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

        let is_whole = job.project(&mut store, room, stats);
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
    fn project(&self, store: &mut Store, room: &mut Room, stats: &mut RelightStats) -> bool {
        let planes = &self.input.planes;
        stats.n_bytes += project(store, self.step.kernel, planes);
        let is_changed = self.input.state == GroupState::Changed;
        let mut is_whole = is_changed;
        room.moves.clear();
        for tile_idx in 0..store.tiles.len() {
            let tile = &store.tiles[tile_idx];
            let (rank, is_settled) = (tile.rank, tile.is_shown && tile.behind <= self.step.tolerance);
            // The same `z` expands to the same pixels, and nearly the same to nearly the same, unless sparse entries carry
            // another coefficient past it.
            let sparse = self.sparse(store, tile_idx);
            let moves = (is_changed || !is_settled)
                && store.settle(tile_idx, self.step.tolerance, planes.moves(sparse), &mut room.z);
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
