//! The columns of patches as a matrix that can be sampled: from the first surface of a pixel one look at what the patches
//! around it send, whose light between each other is known.

use std::f32::consts::{FRAC_1_PI, PI};
use std::ops::Range;
use std::sync::Arc;

use clerestory_nystrom::{Half, SampledMatrix, SparseEntry};
use glam::Vec3;

use super::learn::{Table, ray};
use super::nearest::Nearest;
use crate::camera::{Camera, Film};
use crate::empty::EmptyPixels;
use crate::irradiance::IrradianceRows;
use crate::matrix::CHANNELS;
use crate::path::{Integrator, Landing, NoLights, Onward, Receiver};
use crate::sampler::Sampler;

/// The matrix of a picture whose columns are pictures of light on patches; or of the light that arrives, of the same columns.
pub(crate) struct PatchMatrix<'a> {
    pub integrator: Integrator<'a, NoLights>,
    pub camera: Camera,
    pub film: Film,
    /// What the rows are if not the radiance of the pixels.
    pub irradiance: Option<&'a IrradianceRows>,
    pub seed: u64,
    pub table: &'a Table,
    /// Pixels whose rays meet nothing.
    pub empty: Option<Arc<EmptyPixels>>,
}

/// Streams of random numbers: of pixels, of the light that arrives at them, and of that at points of grids.
const STREAM: u64 = 9 << 58;
const ARRIVING_STREAMS: [u64; 2] = [STREAM + (1 << 50), STREAM + (2 << 50)];
/// Walks that leave the first surface of a pixel's sample.
const SPLITS: u32 = 4;

impl PatchMatrix<'_> {
    /// Stream of random numbers of the first row, the first half.
    fn stream(&self) -> u64 {
        match self.irradiance {
            None => STREAM,
            Some(rows) => ARRIVING_STREAMS[usize::from(matches!(rows, IrradianceRows::Grid(_)))],
        }
    }

    /// Whether a row is known to stay dark.
    fn is_empty(&self, pixel: u32) -> bool {
        let is_picture = !matches!(self.irradiance, Some(IrradianceRows::Grid(_)));
        is_picture && self.empty.as_ref().is_some_and(|empty| empty.contains(pixel as usize))
    }

    fn add_sample(&self, pixel: u32, mut sampler: Sampler, rows: &mut [f32]) {
        let receiver = match self.irradiance {
            None => {
                let ray = ray(&self.camera, self.film, pixel, &mut sampler);
                let splits = (SPLITS, self.table.narrow_alpha);
                self.integrator.land_from_camera(ray, splits, &mut sampler, &mut |landing, sampler| {
                    self.table.add(landing, sampler.next_1d(), 1.0, rows);
                    Onward::Narrow
                });
                return;
            }
            Some(IrradianceRows::Pixels) => {
                let ray = ray(&self.camera, self.film, pixel, &mut sampler);
                self.integrator.seen_receiver(ray, &mut sampler)
            }
            Some(IrradianceRows::Grid(grid)) => {
                grid.point(pixel).map(|position| Receiver::on_plane(position, grid.normal))
            }
        };
        let Some(receiver) = receiver else { return };
        for split in 0..SPLITS {
            let mut own = sampler.fork(split, SPLITS);
            // What arrives is π times the mean over walks whose density has the cosine.
            self.integrator.land_from_surface(
                (receiver.origin(self.integrator.scene()), receiver.normal),
                &mut own,
                &mut |landing, sampler| {
                    self.table.add(landing, sampler.next_1d(), PI / SPLITS as f32, rows);
                    Onward::Narrow
                },
            );
        }
    }
}

impl Table {
    /// Adds what a landing sends of the light of all columns, times a weight.
    fn add(&self, landing: &Landing<'_>, u: f32, weight: f32, rows: &mut [f32]) {
        let n_cols = self.n_columns;
        let weight = landing.throughput * (weight * FRAC_1_PI);
        let (position, shares) = (landing.hit.position, landing.shares);
        let near = |nearest: &Nearest, normal: Vec3| nearest.draw(position, normal, u).map(|patch| patch as usize);
        if let Some(patch) = near(&self.nearest, landing.normal) {
            let all = &self.all[CHANNELS * n_cols * patch..][..CHANNELS * n_cols];
            add_scaled(rows, all, n_cols, weight * shares.base);
            let straight = shares.narrow * (Vec3::ONE - landing.anew) - shares.base * landing.anew;
            if straight != Vec3::ZERO {
                add_repeated(rows, &self.straight[n_cols * patch..][..n_cols], weight * straight);
            }
        }
        if shares.behind != Vec3::ZERO
            && let Some(patch) = near(&self.nearest, -landing.normal)
        {
            let behind = shares.behind * (Vec3::ONE - landing.anew);
            add_repeated(rows, &self.straight[n_cols * patch..][..n_cols], weight * behind);
        }
    }
}

/// Adds three rows to three others, times a weight each.
fn add_scaled(rows: &mut [f32], light: &[f32], n_cols: usize, weight: Vec3) {
    let channels = rows.chunks_exact_mut(n_cols).zip(light.chunks_exact(n_cols));
    for ((rows, light), weight) in channels.zip(weight.to_array()) {
        rows.iter_mut().zip(light).for_each(|(out, light)| *out += weight * light);
    }
}

/// Adds one row to three others, times a weight for each of these.
fn add_repeated(rows: &mut [f32], light: &[f32], weight: Vec3) {
    for (rows, weight) in rows.chunks_exact_mut(light.len()).zip(weight.to_array()) {
        rows.iter_mut().zip(light).for_each(|(out, light)| *out += weight * light);
    }
}

impl SampledMatrix for PatchMatrix<'_> {
    fn n_rows(&self) -> usize {
        CHANNELS * self.film.n_pixels()
    }

    fn n_cols(&self) -> usize {
        self.table.n_columns
    }

    fn bundle_len(&self) -> usize {
        CHANNELS
    }

    fn add_rows(
        &self,
        bundles: &[u32],
        samples: Range<u32>,
        half: Half,
        out: &mut [f32],
        _sparse: &mut Vec<SparseEntry>,
    ) {
        for (&pixel, rows) in bundles.iter().zip(out.chunks_exact_mut(CHANNELS * self.n_cols())) {
            if self.is_empty(pixel) {
                continue;
            }
            let stream = self.stream() + u64::from(pixel) * 2 + u64::from(half == Half::B);
            for sample in samples.clone() {
                self.add_sample(pixel, Sampler::new(self.seed, stream, sample), rows);
            }
        }
    }
}
