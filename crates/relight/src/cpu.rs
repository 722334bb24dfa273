//! Relighting on the CPU: the twin that defines the answer, and the one that runs where there is no real GPU.
//!
//! A row of tiles is one run of the output, so rows of tiles go to threads and nothing is shared. Every group keeps its
//! own radiance and the `z` of its blocks: a slider that touches one group leaves the others' factors unread, columns
//! that did not change are not projected again, and a block whose `z` did not move is not expanded. The answer depends on frame and coefficients alone, not on what was
//! asked before nor on the number of threads.

mod expand;
mod kernel;
mod project;

use std::sync::Arc;

use rayon::prelude::*;

use crate::frame::{Frame, Radiance};
use crate::relight::{Relight, RelightError, RelightStats, check_coefficients, check_layer, is_dark, is_same_layer};
use expand::{Place, expand_block};
use kernel::Kernel;
use project::{Partials, Planes};

/// Relights with all cores.
#[derive(Debug)]
pub struct CpuRelighter {
    frame: Frame,
    kernel: Kernel,
    rows: Vec<TileRow>,
    /// Coefficients that the cached radiance of each group stands for; none before a group was first lit.
    cached: Vec<Option<Vec<[f32; 3]>>>,
    /// Added to every picture.
    layer: Option<Arc<Radiance>>,
    stats: RelightStats,
}

/// What is kept of one row of tiles, per group.
#[derive(Debug)]
struct TileRow(Vec<GroupRow>);

/// What is kept of one row of tiles of one group.
#[derive(Clone, Debug)]
struct GroupRow {
    /// Pixels of this row of tiles, row by row over the whole width; empty before the group was first lit.
    radiance: Vec<[f32; 3]>,
    tiles: Vec<Tile>,
}

/// What is kept of one tile of one group.
#[derive(Clone, Debug, Default)]
struct Tile {
    /// What it was expanded from; none where it must be expanded.
    z: Option<Vec<f32>>,
    /// What `z` is the sum of, under the coefficients that are cached.
    partials: Partials,
}

/// One group's part in one relight.
struct GroupInput {
    planes: Planes,
    state: GroupState,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum GroupState {
    Dark,
    Unchanged,
    Changed,
}

impl CpuRelighter {
    /// Takes a frame; its blocks are shared, not copied.
    ///
    /// # Errors
    /// A frame that does not fit together.
    pub fn new(frame: &Frame) -> Result<Self, RelightError> {
        Self::with_kernel(frame, Kernel::detect())
    }

    fn with_kernel(frame: &Frame, kernel: Kernel) -> Result<Self, RelightError> {
        frame.check()?;
        let partition = frame.partition();
        let tiles = vec![Tile::default(); partition.tiles_x() as usize];
        let group_row = GroupRow { radiance: Vec::new(), tiles };
        let tile_row = || TileRow(vec![group_row.clone(); frame.groups.len()]);
        Ok(Self {
            frame: frame.clone(),
            kernel,
            rows: (0..partition.tiles_y()).map(|_| tile_row()).collect(),
            cached: vec![None; frame.groups.len()],
            layer: None,
            stats: RelightStats::default(),
        })
    }

    fn input(&self, group: usize, x: &[[f32; 3]]) -> GroupInput {
        let state = match &self.cached[group] {
            _ if is_dark(x) => GroupState::Dark,
            Some(cached) if cached == x => GroupState::Unchanged,
            _ => GroupState::Changed,
        };
        GroupInput { planes: Planes::new(x, self.cached[group].as_deref()), state }
    }
}

impl Relight for CpuRelighter {
    fn update(&mut self, frame: &Frame, changed: &[(usize, usize)]) -> Result<(), RelightError> {
        if !self.frame.same_shape(frame) {
            *self = Self::with_kernel(frame, self.kernel)?;
            return Ok(());
        }
        self.frame.take_blocks(frame, changed)?;
        let tiles_x = frame.partition().tiles_x() as usize;
        for &(group, block) in changed {
            let tile = &mut self.rows[block / tiles_x].0[group].tiles[block % tiles_x];
            tile.z = None;
            tile.partials.forget();
        }
        Ok(())
    }

    fn relight(&mut self, coefficients: &[Vec<[f32; 3]>], out: &mut Radiance) -> Result<(), RelightError> {
        check_coefficients(&self.frame, coefficients)?;
        out.resize(self.frame.width, self.frame.height);
        let inputs: Vec<_> = coefficients.iter().enumerate().map(|(group, x)| self.input(group, x)).collect();

        // A row of tiles is a run of whole pixel rows, so threads never share an output.
        let partition = self.frame.partition();
        let row_len = (partition.tile as usize).min(self.frame.height as usize) * self.frame.width as usize;
        let (frame, kernel, layer) = (&self.frame, self.kernel, self.layer.as_deref());
        self.stats = (self.rows.par_iter_mut(), out.pixels.par_chunks_mut(row_len))
            .into_par_iter()
            .enumerate()
            .map(|(row_idx, (row, pixels))| {
                let stats = relight_row(frame, kernel, row_idx, row, &inputs, pixels);
                if let Some(layer) = layer {
                    add(&layer.pixels[row_idx * row_len..][..pixels.len()], pixels);
                }
                stats
            })
            .reduce(RelightStats::default, RelightStats::merged);

        // A dark group keeps its last picture: switching a lamp off and on again reads no factor.
        for (group, input) in inputs.iter().enumerate() {
            match input.state {
                GroupState::Dark => self.stats.n_dark_groups += 1,
                GroupState::Unchanged => {}
                GroupState::Changed => self.cached[group] = Some(coefficients[group].clone()),
            }
        }
        Ok(())
    }

    fn set_layer(&mut self, layer: Option<&Arc<Radiance>>) -> Result<(), RelightError> {
        if let Some(layer) = layer.filter(|layer| !is_same_layer(Some(layer), self.layer.as_ref())) {
            check_layer(&self.frame, layer)?;
        }
        self.layer = layer.cloned();
        Ok(())
    }

    fn stats(&self) -> RelightStats {
        self.stats
    }
}

/// Brings every lit group of a row of tiles up to date and sums them into `pixels`.
fn relight_row(
    frame: &Frame,
    kernel: Kernel,
    row_idx: usize,
    row: &mut TileRow,
    inputs: &[GroupInput],
    pixels: &mut [[f32; 3]],
) -> RelightStats {
    let mut stats = RelightStats::default();
    let mut n_lit = 0;
    for (group, (group_row, input)) in row.0.iter_mut().zip(inputs).enumerate() {
        if input.state == GroupState::Dark {
            stats.n_skipped += group_row.tiles.len();
            continue;
        }
        stats = stats.merged(relight_group(frame, kernel, (group, row_idx), group_row, input, pixels.len()));
        if n_lit == 0 {
            pixels.copy_from_slice(&group_row.radiance);
        } else {
            add(&group_row.radiance, pixels);
        }
        n_lit += 1;
    }
    if n_lit == 0 {
        pixels.fill([0.0; 3]);
    }
    stats
}

/// Projects and expands the blocks of one group in one row of tiles, where something moved.
fn relight_group(
    frame: &Frame,
    kernel: Kernel,
    (group, row_idx): (usize, usize),
    row: &mut GroupRow,
    input: &GroupInput,
    n_pixels: usize,
) -> RelightStats {
    let mut stats = RelightStats::default();
    let partition = &frame.groups[group].partition;
    row.radiance.resize(n_pixels, [0.0; 3]);
    let mut z_new = Vec::new();
    for (tile_idx, tile) in row.tiles.iter_mut().enumerate() {
        if tile.z.is_some() && input.state == GroupState::Unchanged {
            stats.n_skipped += 1;
            continue;
        }

        // The same `z` expands to the same pixels, unless sparse entries carry another coefficient past it.
        let block_idx = row_idx * partition.tiles_x() as usize + tile_idx;
        let factors = frame.block(group, block_idx).map(|block| &**block);
        stats.n_bytes += tile.partials.project(kernel, factors, &input.planes, &mut z_new);
        if tile.z.as_ref() == Some(&z_new) && !input.planes.moves_sparse(factors) {
            stats.n_skipped += 1;
            continue;
        }

        let [x, _, width, height] = partition.rect(block_idx);
        let place =
            Place { x: x as usize, width: width as usize, height: height as usize, stride: frame.width as usize };
        let n_bytes = expand_block(kernel, factors, &z_new, &input.planes, place, &mut row.radiance);
        stats.n_bytes += n_bytes;
        if n_bytes > 0 {
            stats.n_expanded += 1;
        } else {
            stats.n_skipped += 1;
        }
        std::mem::swap(tile.z.get_or_insert_default(), &mut z_new);
    }
    stats
}

fn add(from: &[[f32; 3]], to: &mut [[f32; 3]]) {
    for (to, from) in to.as_flattened_mut().iter_mut().zip(from.as_flattened()) {
        *to += from;
    }
}

#[cfg(test)]
mod tests;
