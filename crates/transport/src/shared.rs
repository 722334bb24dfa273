//! A transport matrix whose pixels share the indirect light of diffuse surfaces.
//!
//! Each sample of a pixel is its own as far as emitters, mirrors, glass and coats go; what other surfaces send to a diffuse
//! base comes from the nodes around it (see `nodes`), or from a walk of its own where none lies on the same surface. The
//! nodes smooth the indirect light over a few pixels: a bias that no number of samples removes, small where light changes
//! little over the distance of two nodes.

use std::ops::Range;

use clerestory_nystrom::{Half, SampledMatrix, SparseEntry};
use glam::{Vec2, Vec3};

use crate::cache::CachedDeposit;
use crate::matrix::{CHANNELS, RowDeposit, TransportMatrix};
use crate::nodes::Nodes;
use crate::path::{Deposit, KnownAt, Scratch};
use crate::sampler::Sampler;

/// A matrix with nodes to take indirect light from.
pub(crate) struct SharedMatrix<'a> {
    pub(crate) matrix: &'a TransportMatrix<'a>,
    pub(crate) nodes: Nodes,
}

impl SharedMatrix<'_> {
    fn add_sample(
        &self,
        (pixel, sample, half): (u32, u32, Half),
        rows: &mut [f32],
        first_row: u32,
        scratch: &mut Scratch,
    ) -> Vec<SparseEntry> {
        let (matrix, integrator) = (self.matrix, &self.matrix.integrator);
        let (n_cols, film) = (matrix.n_cols(), matrix.film);
        let mut sampler = Sampler::new(matrix.seed, matrix.stream(pixel, half), sample);
        let corner = Vec2::new((pixel % film.width) as f32, (pixel / film.width) as f32);
        let film_px = corner + Vec2::from(sampler.next_2d());
        let ray = (matrix.camera.position(), matrix.camera.direction(film, film_px));
        let inner = RowDeposit::new(rows, n_cols, matrix.column_scale()).with_first_row(first_row);
        let mut deposit = CachedDeposit { inner, cache: &self.nodes.cache, half };
        let gathering = integrator.sample_direct(ray, &mut sampler, scratch, &mut deposit);
        let sparse = deposit.inner.into_sparse();
        if let Some(at) = gathering
            && !self.nodes.add(film_px, &at, half, rows)
        {
            let inner = RowDeposit::new(rows, n_cols, matrix.column_scale());
            let inner = CachedDeposit { inner, cache: &self.nodes.cache, half };
            let mut deposit = Weighted { inner, weight: at.albedo };
            integrator.gather_indirect((&at.hit, at.normal), &mut sampler, scratch, &mut deposit);
        }
        sparse
    }
}

impl SampledMatrix for SharedMatrix<'_> {
    fn n_rows(&self) -> usize {
        self.matrix.n_rows()
    }

    fn n_cols(&self) -> usize {
        self.matrix.n_cols()
    }

    fn bundle_len(&self) -> usize {
        self.matrix.bundle_len()
    }

    fn add_rows(
        &self,
        bundles: &[u32],
        samples: Range<u32>,
        half: Half,
        out: &mut [f32],
        sparse: &mut Vec<SparseEntry>,
    ) {
        let mut scratch = Scratch::default();
        for (nth, (&pixel, rows)) in bundles.iter().zip(out.chunks_exact_mut(CHANNELS * self.n_cols())).enumerate() {
            for sample in samples.clone() {
                let first_row = (nth * CHANNELS) as u32;
                sparse.append(&mut self.add_sample((pixel, sample, half), rows, first_row, &mut scratch));
            }
        }
    }
}

/// Multiplies everything by a color.
struct Weighted<D> {
    inner: D,
    weight: Vec3,
}

impl<D: Deposit> Deposit for Weighted<D> {
    const KNOWS: bool = D::KNOWS;

    fn scattered(&mut self, column: u32, value: Vec3) {
        self.inner.scattered(column, value * self.weight);
    }

    fn seen(&mut self, column: u32, value: Vec3) {
        // A gathered walk has left the first surface: nothing that it meets is seen directly.
        self.scattered(column, value);
    }

    fn known(&mut self, at: &KnownAt<'_>) -> bool {
        self.inner.known(&KnownAt { weight: at.weight * self.weight, ..*at })
    }
}
