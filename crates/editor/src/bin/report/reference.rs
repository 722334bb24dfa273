//! Two independent dense samplings of a matrix, and the error of a bake against both.

use clerestory_nystrom::{Half, SampledMatrix};
use clerestory_transport::bake::Bake;
use clerestory_transport::camera::Film;
use clerestory_transport::matrix::{CHANNELS, TransportMatrix};
use clerestory_transport::plan::{Density, MatrixPlan};
use clerestory_transport::prepared::PreparedScene;
use rayon::prelude::*;

use super::matrix::BOUNCES;

/// Part of a column's entries that may be brighter than its peak.
const PEAK_QUANTILE: f64 = 0.995;
/// Best error that is told.
const BEST_DB: f64 = 120.0;

/// A matrix sampled twice, independently of each other and of every bake of the report.
pub struct Reference {
    n_cols: usize,
    /// Row-major, rows × columns, radiance per unit of light.
    halves: [Vec<f32>; 2],
    /// Whether the camera saw the light of a column in a pixel or in one beside it, by pixel × column.
    seen: Vec<bool>,
    /// The 99.5 percentile of each column's entries, those where its light is seen aside.
    peaks: Vec<f64>,
}

impl Reference {
    /// `spp` samples per pixel for each half. Walks whose weak connections are left to no roulette: the plainest plan.
    pub fn sample(scene: &PreparedScene, film: Film, spp: u32) -> Reference {
        let plan = MatrixPlan::new(&scene.lighting, Density::Full);
        let camera = scene.scene.cameras[0].clone();
        let matrix = TransportMatrix::new(scene, &plan, camera, film, BOUNCES, 0x5EED);
        let n_cols = matrix.n_cols();
        let mut seen = vec![false; film.n_pixels() * n_cols];
        let halves = [Half::A, Half::B].map(|half| {
            let mut rows = vec![0.0; matrix.n_rows() * n_cols];
            let by_pixel = rows.par_chunks_mut(CHANNELS * n_cols).zip(seen.par_chunks_mut(n_cols));
            by_pixel.enumerate().for_each(|(pixel, (rows, seen))| {
                let mut sparse = Vec::new();
                matrix.add_rows(&[pixel as u32], 0..spp, half, rows, &mut sparse);
                for entry in sparse {
                    rows[entry.row as usize * n_cols + entry.col as usize] += entry.value;
                    seen[entry.col as usize] = true;
                }
                rows.iter_mut().for_each(|value| *value /= spp as f32);
            });
            rows
        });
        let seen = widened(&seen, film, n_cols);
        let mut reference = Reference { n_cols, halves, seen, peaks: Vec::new() };
        reference.peaks = (0..n_cols).into_par_iter().map(|column| reference.peak(column)).collect();
        reference
    }

    fn n_rows(&self) -> usize {
        self.halves[0].len() / self.n_cols
    }

    fn is_seen(&self, row: usize, column: usize) -> bool {
        self.seen[row / CHANNELS * self.n_cols + column]
    }

    fn peak(&self, column: usize) -> f64 {
        let mean = |row: usize| {
            let [a, b] = [0, 1].map(|half| f64::from(self.halves[half][row * self.n_cols + column]));
            0.5 * (a + b)
        };
        let mut values: Vec<f64> = (0..self.n_rows()).filter(|&row| !self.is_seen(row, column)).map(mean).collect();
        let Some(last) = values.len().checked_sub(1) else { return 0.0 };
        *values.select_nth_unstable_by((last as f64 * PEAK_QUANTILE) as usize, f64::total_cmp).1
    }

    /// The error of every column of a bake of the same scene, film and bounces.
    pub fn errors(&self, bake: &Bake) -> ColumnErrors {
        let (partition, mut errors) = (bake.header.partition(), ColumnErrors::default());
        let mut sums = vec![[Sum::default(); 2]; self.n_cols];
        for (group, columns) in bake.groups.iter().zip(&bake.header.basis.groups) {
            let (first, width) = (columns.columns.start as usize, columns.columns.len());
            let mut pixels = Vec::new();
            for (block_idx, block) in group.blocks.iter().enumerate() {
                let Some(block) = block else { continue };
                partition.bundles(block_idx, &mut pixels);
                for (nth, baked) in block.dense().chunks_exact(width).enumerate() {
                    let row = pixels[nth / CHANNELS] as usize * CHANNELS + nth % CHANNELS;
                    for (column, &baked) in (first..).zip(baked) {
                        let baked = f64::from(baked / bake.header.column_scale[column]);
                        let [a, b] = [0, 1].map(|half| f64::from(self.halves[half][row * self.n_cols + column]));
                        let error = (baked - a) * (baked - b);
                        sums[column][1].add(error);
                        if !self.is_seen(row, column) {
                            sums[column][0].add(error);
                        }
                    }
                }
            }
        }
        for (sums, peak) in sums.iter().zip(&self.peaks).filter(|(_, peak)| **peak > 0.0) {
            let db = sums.map(|sum| (10.0 * (peak * peak / sum.mean().max(f64::MIN_POSITIVE)).log10()).min(BEST_DB));
            errors.db.push(db);
        }
        errors
    }
}

/// The same with a margin of one pixel: a sliver of light may be seen by one sample in a thousand.
fn widened(seen: &[bool], film: Film, n_cols: usize) -> Vec<bool> {
    let (width, height) = (film.width as usize, film.height as usize);
    let near = |at: usize, end: usize| at.saturating_sub(1)..(at + 2).min(end);
    let mut wide = vec![false; seen.len()];
    wide.par_chunks_mut(n_cols).enumerate().for_each(|(pixel, wide)| {
        let around = near(pixel / width, height).flat_map(|y| near(pixel % width, width).map(move |x| y * width + x));
        for other in around {
            let seen = &seen[other * n_cols..][..n_cols];
            wide.iter_mut().zip(seen).for_each(|(wide, seen)| *wide |= seen);
        }
    });
    wide
}

/// A sum and how many went into it.
#[derive(Clone, Copy, Default)]
struct Sum {
    sum: f64,
    n: f64,
}

impl Sum {
    fn add(&mut self, value: f64) {
        self.sum += value;
        self.n += 1.0;
    }

    fn mean(&self) -> f64 {
        self.sum / self.n.max(1.0)
    }
}

/// Errors of the columns that light anything, in dB below their peaks.
#[derive(Default)]
pub struct ColumnErrors {
    /// Without and with the entries where the light itself is seen.
    db: Vec<[f64; 2]>,
}

impl ColumnErrors {
    fn mean(&self, which: usize) -> f64 {
        self.db.iter().map(|db| db[which]).sum::<f64>() / self.db.len().max(1) as f64
    }

    fn worst(&self, which: usize) -> f64 {
        self.db.iter().map(|db| db[which]).fold(f64::INFINITY, f64::min)
    }

    /// Mean over columns.
    pub fn mean_db(&self) -> f64 {
        self.mean(0)
    }

    /// Of the worst column.
    pub fn worst_db(&self) -> f64 {
        self.worst(0)
    }

    /// Mean over columns, lights that are seen included.
    pub fn mean_db_with_seen(&self) -> f64 {
        self.mean(1)
    }

    /// Of the worst column, lights that are seen included.
    pub fn worst_db_with_seen(&self) -> f64 {
        self.worst(1)
    }
}
