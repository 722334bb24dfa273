//! Light that surfaces receive, known beforehand for cells of space: where a walk that gathers indirect light may end.
//!
//! A cell holds points that look the same way. For each cell the light of all columns is found once: what arrives straight
//! from the lamps at a few of its points, and what a few walks bring from other cells, solved for all cells together by
//! sweeps. Whoever asks sees a surface as one of the same mean light as its cell: right enough where it is seen by a broad
//! lobe from a distance of some cells, and refused elsewhere. Both halves have light of their own, so that its noise is seen.

mod cells;
mod solve;

use std::ops::ControlFlow;

use clerestory_nystrom::Half;
use glam::Vec3;
use rayon::prelude::*;

use crate::matrix::{CHANNELS, RowDeposit, TransportMatrix, add_weighted, scale_columns};
use crate::path::{Deposit, KnownAt, Onto, Scratch};
use crate::sampler::Sampler;
use crate::streams::Stream;

pub(crate) use cells::Place;
use cells::{Cells, Scout};

/// How a cache is filled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct CachePlan {
    /// Walks of a cell, for each half.
    pub walks: u32,
    /// Places to gather light at for each cell.
    pub places_per_cell: usize,
}

/// Cells with their light.
pub(crate) struct LightCache {
    cells: Cells,
    n_cols: usize,
    /// Of each half: cell by cell three rows of all columns, mean radiance weighed by the cosine.
    light: [Vec<f32>; 2],
}

/// Walks from each place that look for cells.
const SCOUTS: u32 = 2;
/// Times that new cells look for further ones.
const GENERATIONS: u32 = 2;
/// Most memory of the light.
const MOST_BYTES: usize = 1 << 28;
/// Fewest cells, where as many are met, and most.
const CELLS: [usize; 2] = [512, 6144];
/// Stream of random numbers that neither pixels nor nodes use.
const STREAM: u64 = Stream::CacheScouts.first();

impl LightCache {
    /// Fills a cache with what walks from the given places meet; `None` if `on_part` says stop.
    pub(crate) fn fill(
        matrix: &TransportMatrix<'_>,
        places: &[Place],
        plan: CachePlan,
        mut on_part: impl FnMut() -> ControlFlow<()>,
    ) -> Option<LightCache> {
        let mut go_on = || on_part().is_continue().then_some(());
        let n_cols = matrix.column_scale().len();
        let affordable = (MOST_BYTES / (2 * CHANNELS * n_cols * 4)).min(CELLS[1]);
        let most = (places.len() / plan.places_per_cell).min(affordable).max(CELLS[0]);
        let mut found = scout(matrix, places, STREAM);
        let mut cells = Cells::fit(&found, most);
        for generation in 1..=u64::from(GENERATIONS) {
            let first_new = cells.add(&found, 2 * most);
            let new: Vec<Place> = cells.places().skip(first_new).collect();
            go_on()?;
            found = scout(matrix, &new, STREAM + (generation << 32));
        }
        cells.add(&found, 2 * most);
        go_on()?;
        let of_a = solve::light(matrix, &cells, Half::A, plan);
        go_on()?;
        let light = [of_a, solve::light(matrix, &cells, Half::B, plan)];
        Some(LightCache { cells, n_cols, light })
    }

    /// Memory of the light, bytes.
    pub(crate) fn n_bytes(&self) -> usize {
        self.light.iter().map(|light| size_of_val(light.as_slice())).sum()
    }

    /// Multiplies each column of the light by a factor of its own.
    pub(crate) fn scale(&mut self, factors: &[f32]) {
        self.light.iter_mut().for_each(|light| scale_columns(light, factors));
    }

    /// Adds the light of a cell to three rows, times a weight per channel.
    fn add(&self, cell: u32, half: Half, weight: Vec3, rows: &mut [f32]) {
        let len = CHANNELS * self.n_cols;
        let light = &self.light[usize::from(half == Half::B)][cell as usize * len..][..len];
        add_weighted(rows, light, weight);
    }
}

/// What walks from some places meet, in the order of the places.
fn scout(matrix: &TransportMatrix<'_>, places: &[Place], stream: u64) -> Vec<Place> {
    let search = |scratch: &mut Scratch, (nth, (hit, normal)): (usize, &Place)| {
        let mut scout = Scout::default();
        for walk in 0..SCOUTS {
            let mut sampler = Sampler::new(matrix.seed, stream + nth as u64, walk);
            matrix.integrator.gather_indirect((hit, *normal, Onto::Point), &mut sampler, scratch, &mut scout);
        }
        scout.found
    };
    let found: Vec<_> = places.par_iter().enumerate().map_init(Scratch::default, search).collect();
    found.into_iter().flatten().collect()
}

/// Deposits to the rows of a pixel or node; walks end where the cache knows the light.
pub(crate) struct CachedDeposit<'a, 'b> {
    pub(crate) inner: RowDeposit<'a>,
    pub(crate) cache: &'b LightCache,
    pub(crate) half: Half,
}

impl Deposit for CachedDeposit<'_, '_> {
    const KNOWS: bool = true;

    #[inline]
    fn scattered(&mut self, column: u32, value: Vec3) {
        self.inner.scattered(column, value);
    }

    fn seen(&mut self, column: u32, value: Vec3) {
        self.inner.seen(column, value);
    }

    fn known(&mut self, at: &KnownAt<'_>) -> bool {
        let Some(cell) = self.cache.cells.find(at) else { return false };
        self.cache.add(cell, self.half, at.weight, self.inner.rows());
        true
    }
}
