//! Relighting on the CPU: the twin that defines the answer, and the one that runs where there is no real GPU.
//!
//! A row of tiles is one run of the output, so rows of tiles go to threads and nothing is shared. Every group keeps its
//! own radiance and the `z` of its blocks: a slider that touches one group leaves the others' factors unread, columns
//! that did not change are not projected again (unless all of them changed again and again), and a block whose `z` did not move is not expanded. Factors are read from a
//! copy that is one stream per row of tiles. The answer depends on frame
//! and coefficients alone, not on what was asked before nor on the number of threads.
//!
//! For a display, blocks are left as they are, too, while no pixel of theirs would change by half a step of it: what the largest entries of their factors
//! make of all that `z` moved since the block was last expanded. So what was left out is carried, and many small steps are one large one.

mod expand;
mod kernel;
mod left;
pub(crate) mod prefetch;
mod project;
mod quad;
mod row;
mod store;

use std::sync::Arc;

use clerestory_nystrom::SparseEntry;
use rayon::prelude::*;

use crate::display::DisplayParams;
use crate::frame::{Frame, Radiance};
use crate::packing::Precision;
use crate::relight::{Relight, RelightError, RelightStats, check_coefficients, check_layer, is_dark, is_same_layer};
use kernel::Kernel;
use project::Planes;
use row::TileRow;

/// Relights with all cores.
#[derive(Debug)]
pub struct CpuRelighter {
    frame: Frame,
    kernel: Kernel,
    precision: Precision,
    rows: Vec<TileRow>,
    /// Coefficients that the cached radiance of each group stands for; none before a group was first lit.
    cached: Vec<Option<Vec<[f32; 3]>>>,
    /// Added to every picture.
    layer: Option<Arc<Radiance>>,
    stats: RelightStats,
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
        Self::with_precision(frame, Precision::Halves)
    }

    /// The same, with factors of a precision.
    ///
    /// # Errors
    /// A frame that does not fit together.
    pub fn with_precision(frame: &Frame, precision: Precision) -> Result<Self, RelightError> {
        Self::with_kernel(frame, Kernel::detect(), precision)
    }

    fn with_kernel(frame: &Frame, kernel: Kernel, precision: Precision) -> Result<Self, RelightError> {
        frame.check()?;
        let partition = frame.partition();
        let tile_row = || TileRow::new(frame.groups.len(), partition.tiles_x() as usize);
        Ok(Self {
            frame: frame.clone(),
            kernel,
            precision,
            rows: (0..partition.tiles_y()).map(|_| tile_row()).collect(),
            cached: vec![None; frame.groups.len()],
            layer: None,
            stats: RelightStats::default(),
        })
    }

    /// Relights for a display: the picture may miss the exact one by what nobody sees, half a step between two of the bytes that
    /// `display` makes of it, before they are rounded.
    ///
    /// # Errors
    /// As [`Relight::relight`].
    pub fn relight_for_display(
        &mut self,
        coefficients: &[Vec<[f32; 3]>],
        display: &DisplayParams,
        out: &mut Radiance,
    ) -> Result<(), RelightError> {
        self.relight_within(display.unseen(), coefficients, out)
    }

    /// Relights so that no channel of a pixel misses the exact answer by more than `tolerance`, nit.
    fn relight_within(
        &mut self,
        tolerance: f32,
        coefficients: &[Vec<[f32; 3]>],
        out: &mut Radiance,
    ) -> Result<(), RelightError> {
        check_coefficients(&self.frame, coefficients)?;
        out.resize(self.frame.width, self.frame.height);
        let inputs: Vec<_> = coefficients.iter().enumerate().map(|(group, x)| self.input(group, x)).collect();

        // A row of tiles is a run of whole pixel rows, so threads never share an output.
        let partition = self.frame.partition();
        let row_len = (partition.tile as usize).min(self.frame.height as usize) * self.frame.width as usize;
        let layer = self.layer.as_deref();
        let step = Step { frame: &self.frame, kernel: self.kernel, precision: self.precision, tolerance };
        self.stats = (self.rows.par_iter_mut(), out.pixels.par_chunks_mut(row_len))
            .into_par_iter()
            .enumerate()
            // Row by row, so that a thread that was held up keeps the others waiting for one row at most.
            .with_max_len(1)
            .map(|(row_idx, (row, pixels))| {
                let stats = row.relight(&step, row_idx, &inputs, pixels);
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
            *self = Self::with_kernel(frame, self.kernel, self.precision)?;
            return Ok(());
        }
        self.frame.take_blocks(frame, changed)?;
        let tiles_x = frame.partition().tiles_x() as usize;
        for &(group, block) in changed {
            self.rows[block / tiles_x].0[group].replace(block % tiles_x);
        }
        Ok(())
    }

    fn relight(&mut self, coefficients: &[Vec<[f32; 3]>], out: &mut Radiance) -> Result<(), RelightError> {
        self.relight_within(0.0, coefficients, out)
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

/// What one relight is the same for everywhere.
struct Step<'a> {
    frame: &'a Frame,
    kernel: Kernel,
    precision: Precision,
    /// Nit by which any channel of the radiance may miss the exact answer.
    tolerance: f32,
}

impl Step<'_> {
    /// Entries of a block that no low rank holds.
    fn sparse(&self, group: usize, block: usize) -> &[SparseEntry] {
        self.frame.block(group, block).map_or(&[], |factors| &factors.sparse)
    }
}

fn add(from: &[[f32; 3]], to: &mut [[f32; 3]]) {
    for (to, from) in to.as_flattened_mut().iter_mut().zip(from.as_flattened()) {
        *to += from;
    }
}

#[cfg(test)]
mod tests;
#[cfg(test)]
mod truth_tests;
#[cfg(test)]
pub(crate) mod unseen_tests;
