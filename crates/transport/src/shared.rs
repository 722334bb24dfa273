//! A transport matrix whose pixels share the indirect light of diffuse surfaces.
//!
//! Each sample of a pixel is its own as far as emitters, mirrors, glass and coats go; what other surfaces send to a diffuse
//! base comes from the nodes around it (see `nodes`), or from a walk of its own where none lies on the same surface. The
//! nodes smooth the indirect light over a few pixels, and cells (see `cache`) the light behind it: a bias that no number of
//! samples removes, small where light changes little over the distance of two nodes. A few hundred pixels are traced as
//! well, and tell how large it is.

use std::ops::Range;

use clerestory_nystrom::{Half, SampledMatrix, SparseEntry};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::bvh::Ray;
use crate::cache::CachedDeposit;
use crate::matrix::{CHANNELS, RowDeposit, TransportMatrix};
use crate::nodes::Nodes;
use crate::path::{Deposit, KnownAt, Onto, Scratch};
use crate::sampler::{Sampler, uniform_hash};
use crate::streams::Stream;

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
        let matrix = self.matrix;
        let n_cols = matrix.n_cols();
        let mut sampler = matrix.sampler(pixel, half, sample);
        let (film_px, ray) = matrix.sample_ray(pixel, &mut sampler);
        let inner = RowDeposit::new(rows, n_cols, matrix.column_scale()).with_first_row(first_row);
        let mut deposit = CachedDeposit { inner, cache: &self.nodes.cache, half };
        if matrix.is_empty_pixel(pixel) {
            matrix.pass_by(ray, &mut deposit);
            return deposit.inner.into_sparse();
        }
        let gathering = matrix.sample_direct(ray, &mut sampler, scratch, &mut deposit);
        let sparse = deposit.inner.into_sparse();
        if let Some(at) = gathering
            && !self.nodes.add(film_px, &at, half, rows)
        {
            let inner = RowDeposit::new(rows, n_cols, matrix.column_scale());
            let inner = CachedDeposit { inner, cache: &self.nodes.cache, half };
            let mut deposit = Weighted { inner, weight: at.albedo };
            matrix.integrator.gather_indirect((&at.hit, at.normal, Onto::Pixel), &mut sampler, scratch, &mut deposit);
        }
        sparse
    }
}

/// One in so many pixels tells what a block sees; no divisor of its side, so that they lie in no line.
const EVERY_FEW: usize = 5;

impl SharedMatrix<'_> {
    /// Whether the surface in the middle of a pixel, if there is one, is matte and lies in no caustic.
    fn is_calm(&self, pixel: u32) -> bool {
        let film = self.matrix.film;
        let center = Vec2::new((pixel % film.width) as f32, (pixel / film.width) as f32) + 0.5;
        let (origin, direction) = self.matrix.ray(center);
        let ray = Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY };
        // Only whether surfaces with alpha are there is left to chance.
        let mut sampler = Sampler::new(self.matrix.seed, MIDDLE_STREAM + u64::from(pixel), 0);
        let (integrator, scene) = (&self.matrix.integrator, self.matrix.integrator.scene());
        scene
            .closest_seen(&ray, &mut sampler)
            .is_none_or(|hit| scene.material(hit.triangle).is_matte() && !integrator.has_caustics_at(hit.position))
    }
}

/// Streams of random numbers of the middles of pixels, which nobody else uses.
const MIDDLE_STREAM: u64 = Stream::Middles.first();

/// Pixels that tell what sharing changes, and their samples for each half: fewest, and most.
const PROBES: usize = 256;
const PROBE_SAMPLES: [u32; 2] = [16, 64];
/// Tolerance up to which the fewest samples tell enough.
const ROUGH_DB: f32 = 32.0;

impl SharedMatrix<'_> {
    /// The mean square, over all entries of a few hundred pixels, by which sharing is off: the product of what both halves
    /// differ by from traced samples of their own, in which no noise counts. At least its own standard error.
    pub(crate) fn bias(&self, tolerance_db: f32) -> f32 {
        let [fewest, most] = PROBE_SAMPLES;
        let samples =
            (fewest as f32 * 10f32.powf(0.1 * (tolerance_db - ROUGH_DB))).clamp(fewest as f32, most as f32) as u32;
        let n_pixels = self.matrix.film.n_pixels();
        let n_probes = n_pixels.min(PROBES);
        let probe = |nth: usize| {
            let jitter = f64::from(uniform_hash(self.matrix.seed ^ (nth as u64) << 20));
            let pixel = ((nth as f64 + jitter) * n_pixels as f64 / n_probes as f64) as usize;
            self.probe(pixel.min(n_pixels - 1) as u32, samples)
        };
        let probes: Vec<f64> = (0..n_probes).into_par_iter().map(probe).collect();
        let n = n_probes as f64;
        let mean = probes.iter().sum::<f64>() / n;
        let variance = probes.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
        mean.max((variance / n).sqrt()) as f32
    }

    /// Both sample the same points of a pixel, so that what they have in common does not differ.
    fn probe(&self, pixel: u32, samples: u32) -> f64 {
        let n_entries = self.bundle_len() * self.n_cols();
        let differences = [Half::A, Half::B].map(|half| {
            let [mut shared, mut traced] = [vec![0.0; n_entries], vec![0.0; n_entries]];
            self.add_rows(&[pixel], 0..samples, half, &mut shared, &mut Vec::new());
            self.matrix.add_rows(&[pixel], 0..samples, half, &mut traced, &mut Vec::new());
            shared.iter_mut().zip(&traced).for_each(|(x, traced)| *x = (*x - traced) / samples as f32);
            shared
        });
        let [a, b] = &differences;
        a.iter().zip(b).map(|(a, b)| f64::from(a * b)).sum::<f64>() / n_entries as f64
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

    /// What pixels have in common, nodes and cells, is the same for any number of samples. Where there are coats, metal, glass or
    /// caustics, a pixel follows walks of its own, and a bright one that is rare is told apart by its own samples alone.
    fn colors_are_independent(&self, bundles: &[u32]) -> bool {
        let colors_judge = self.matrix.integrator.scene().colors_judge;
        colors_judge && bundles.iter().step_by(EVERY_FEW).all(|&pixel| self.is_calm(pixel))
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
