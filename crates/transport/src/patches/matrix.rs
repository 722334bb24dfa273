//! The columns of patches as a matrix that can be sampled: from the first surface of a pixel one look at what the patches
//! around it send, whose light between each other is known.

use std::f32::consts::PI;
use std::ops::Range;
use std::sync::Arc;

use clerestory_nystrom::{Half, SampledMatrix, SparseEntry};
use half::bf16;

use super::exchange::{Row, Share};
use super::learn::{Table, ray};
use super::vector::{AT_ONCE, add_rows, single};
use crate::camera::{Camera, Film};
use crate::empty::EmptyPixels;
use crate::irradiance::IrradianceRows;
use crate::matrix::CHANNELS;
use crate::path::{Integrator, Landing, NoLights};
use crate::sampler::Sampler;
use crate::streams::Stream;

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
const STREAM: u64 = Stream::PatchRows.first();
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

    /// Takes what a sample of a row shows of patches.
    fn take_sample(&self, pixel: u32, mut sampler: Sampler, row: &mut Row) {
        let mut land = |landing: &Landing<'_>, sampler: &mut Sampler| row.land(&self.table.nearest, landing, sampler);
        let receiver = match self.irradiance {
            None => {
                let ray = ray(&self.camera, self.film, pixel, &mut sampler);
                let splits = (SPLITS, self.table.narrow_alpha);
                self.integrator.land_from_camera(ray, splits, &mut sampler, &mut land);
                return;
            }
            Some(IrradianceRows::Pixels) => {
                let ray = ray(&self.camera, self.film, pixel, &mut sampler);
                self.integrator.seen_receiver(ray, &mut sampler)
            }
            Some(IrradianceRows::Grid(grid)) => grid.receiver(pixel),
        };
        let Some(receiver) = receiver else { return };
        for split in 0..SPLITS {
            let mut own = sampler.fork(split, SPLITS);
            let from = (receiver.origin(self.integrator.scene()), receiver.normal);
            self.integrator.land_from_surface(from, 0, &mut own, &mut land);
        }
    }

    /// What the sums of shares are divided by: irradiance over π is radiance, and what arrives is π times the mean over walks
    /// whose density has the cosine.
    fn divisor(&self) -> f32 {
        if self.irradiance.is_none() { PI } else { SPLITS as f32 }
    }
}

impl Table {
    /// Adds what somebody takes of the light of all columns; `out` is channels × columns.
    fn add(&self, row: &Row, out: &mut [f32]) {
        let n_cols = self.n_columns;
        for (channel, out) in out.chunks_exact_mut(n_cols).enumerate() {
            add_weighted(out, &row.known, |share| {
                let nth = CHANNELS * share.patch as usize + channel;
                (share.weight[channel], &self.all[n_cols * nth..][..n_cols])
            });
            add_weighted(out, &row.straight, |share| {
                (share.weight[channel], &self.straight[n_cols * share.patch as usize..][..n_cols])
            });
        }
    }
}

/// Adds rows of a table, given the weight and the row of each share.
fn add_weighted<'t>(out: &mut [f32], shares: &[Share], of: impl Fn(&Share) -> (f32, &'t [bf16])) {
    let (together, rest) = shares.as_chunks::<AT_ONCE>();
    for shares in together {
        add_rows(out, shares.each_ref().map(&of));
    }
    for share in rest {
        let (weight, light) = of(share);
        out.iter_mut().zip(light).for_each(|(out, light)| *out += weight * single(*light));
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
        let mut row = Row::default();
        for (&pixel, out) in bundles.iter().zip(out.chunks_exact_mut(CHANNELS * self.n_cols())) {
            if self.is_empty(pixel) {
                continue;
            }
            let stream = self.stream() + u64::from(pixel) * 2 + u64::from(half == Half::B);
            row.clear();
            for sample in samples.clone() {
                self.take_sample(pixel, Sampler::new(self.seed, stream, sample), &mut row);
            }
            row.finish(self.divisor());
            self.table.add(&row, out);
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::patches::learn::halved;
    use crate::patches::nearest::Nearest;
    use crate::sampler::uniform_hash;

    const PATCHES: u32 = 7;
    const COLUMNS: usize = 21;

    fn numbers(n: usize, key: u64) -> Vec<f32> {
        (0..n as u64).map(|nth| uniform_hash(key + nth) - 0.5).collect()
    }

    #[test]
    fn shares_that_are_joined_first_bring_what_each_of_them_does() {
        let (straight, all) = (PATCHES as usize * COLUMNS, CHANNELS * PATCHES as usize * COLUMNS);
        let table = Table {
            n_columns: COLUMNS,
            narrow_alpha: 0.0,
            nearest: Arc::new(Nearest::new(Vec::new(), 1.0)),
            straight: halved(&numbers(straight, 1000)),
            all: halved(&numbers(all, 2000)),
        };
        // From none to many more than there are patches.
        for n in [0, 1, 3, 4, 5, 8, 40] {
            let share = |key: u64| Share {
                patch: (uniform_hash(key) * PATCHES as f32) as u32,
                weight: Vec3::from_slice(&numbers(3, key + 1)),
            };
            let mut row = Row {
                known: (0..n).map(|k| share(10 * k)).collect(),
                straight: (0..n / 2).map(|k| share(20 * k + 5)).collect(),
            };
            let mut expected = numbers(CHANNELS * COLUMNS, 3000);
            let mut found = expected.clone();
            for (at, sum) in expected.iter_mut().enumerate() {
                let (channel, column) = (at / COLUMNS, at % COLUMNS);
                let of = |share: &Share| (share.patch as usize, share.weight[channel] / PI);
                for (patch, weight) in row.known.iter().map(of) {
                    *sum += weight * single(table.all[(CHANNELS * patch + channel) * COLUMNS + column]);
                }
                for (patch, weight) in row.straight.iter().map(of) {
                    *sum += weight * single(table.straight[patch * COLUMNS + column]);
                }
            }
            row.finish(PI);
            assert!(row.known.len() <= PATCHES as usize);
            table.add(&row, &mut found);
            let off = found.iter().zip(&expected).map(|(x, y)| (x - y).abs()).fold(0.0, f32::max);
            assert!(off < 1e-5, "{n} shares: off by {off}");
        }
    }
}
