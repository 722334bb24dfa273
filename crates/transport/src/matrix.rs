//! The transport matrix as something that can be sampled: rows are channels of pixels, columns are lights.
//!
//! Columns are scaled so that the 99.5 percentile of each is about 1 ([`TransportMatrix::column_scale`]): a dim or far lamp
//! is then as exact, relative to its own light, as a bright one. Coefficients are divided by the same scale.

mod hand_out;
mod reuse;

use std::ops::Range;
use std::sync::Arc;

use clerestory_nystrom::{Half, SampledMatrix, SparseEntry};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::bake::focus::Focus;
use crate::camera::{Camera, Film};
use crate::empty::EmptyPixels;
use crate::irradiance::IrradianceRows;
use crate::light::{LightRig, luminance};
use crate::path::{Deposit, Gathering, Integrator, Scratch};
use crate::plan::MatrixPlan;
use crate::prepared::PreparedScene;
use crate::sampler::Sampler;
use crate::sky::SkyPicks;
use crate::streams::Stream;

/// Rows per pixel: red, green, blue.
pub const CHANNELS: usize = 3;

/// A scene's light transport to a camera, sampled by path tracing.
pub struct TransportMatrix<'a> {
    pub(crate) integrator: Integrator<'a, MatrixPlan>,
    pub(crate) camera: Camera,
    pub(crate) film: Film,
    pub(crate) seed: u64,
    column_scale: Vec<f32>,
    /// What the rows are if not the radiance of the pixels.
    irradiance: Option<&'a IrradianceRows>,
    /// Pixels whose rays meet nothing.
    empty: Option<Arc<EmptyPixels>>,
}

/// Streams of random numbers of rows of irradiance, which no pixel and no node uses: of pixels and of grids.
const IRRADIANCE_STREAMS: [u64; 2] = [Stream::PixelIrradiance.first(), Stream::GridIrradiance.first()];

/// Pixels that measure how bright each column is, about; the samples of each half, most where columns are few; and the entries that they may
/// hold together.
const PILOT_PIXELS: usize = 2048;
const PILOT_SAMPLES: u32 = 4;
const SAMPLED_COLUMNS: usize = 256;
const PILOT_ENTRIES: usize = 1 << 24;
/// Pilots draw numbers of their own: the samples of a bake do not depend on its scale.
const PILOT_SEED: u64 = 7 << 60;
/// Pixels that tell how many connections are left to roulette.
const WEAK_PIXELS: usize = 128;
/// Part of a column's entries that may be brighter than its peak.
pub(crate) const PEAK_QUANTILE: f32 = 0.995;
/// Share of the median peak below which a column is not measured against its own where its light comes by rare walks: it would cost more
/// than all others.
const DIMMEST: f32 = 0.125;
/// A column comes by rare walks where the geometric mean of two halves has less than this share of their mean: 0.15 where it does, 0.47 and
/// more where it does not.
const RARE: f32 = 0.27;

/// What a small picture tells of a column.
#[derive(Clone, Copy)]
struct Brightness {
    /// The 99.5 percentile (where that is dark, the brightest entry or the mean).
    peak: f32,
    mean: f32,
    /// What two halves have in common: the mean of their geometric mean.
    common: f32,
}

impl<'a> TransportMatrix<'a> {
    /// With columns as they are, before their scale is known.
    pub fn new(
        scene: &'a PreparedScene,
        plan: &'a MatrixPlan,
        camera: Camera,
        film: Film,
        bounces: Option<u32>,
        seed: u64,
    ) -> Self {
        let column_scale = vec![1.0; scene.lighting.basis.n_cols()];
        let integrator = Integrator::new(scene, plan, bounces);
        TransportMatrix { integrator, camera, film, seed, column_scale, irradiance: None, empty: None }
    }

    /// Traces no rays for some pixels, which see nothing.
    pub(crate) fn with_empty_pixels(self, empty: Option<Arc<EmptyPixels>>) -> Self {
        TransportMatrix { empty, ..self }
    }

    /// For somebody who may leave.
    pub(crate) fn watched(self, focus: &'a Focus) -> Self {
        TransportMatrix { integrator: self.integrator.watched(focus), ..self }
    }

    /// Sees pixels at their centers alone.
    pub(crate) fn of_centers(self) -> Self {
        TransportMatrix { integrator: self.integrator.of_centers(), ..self }
    }

    /// Sends no walks to mirrors and glass: sooner, and noisier.
    pub(crate) fn unguided(self) -> Self {
        TransportMatrix { integrator: self.integrator.unguided(), ..self }
    }

    /// Whether a pixel of the picture, not a point of a grid, is known to see nothing.
    pub(crate) fn is_empty_pixel(&self, pixel: u32) -> bool {
        let is_picture = !matches!(self.irradiance, Some(IrradianceRows::Grid(_)));
        is_picture && self.empty.as_ref().is_some_and(|empty| empty.contains(pixel as usize))
    }

    /// Share of the later connections that carry light and are left to roulette, in a few pixels.
    pub(crate) fn weak_connections(&self) -> f32 {
        let (n_cols, n_pixels) = (self.n_cols(), self.film.n_pixels());
        let n_pilots = n_pixels.clamp(1, WEAK_PIXELS);
        let pilot = |nth: usize| {
            let (mut rows, mut scratch) = (vec![0.0; CHANNELS * n_cols], Scratch::default());
            let mut deposit = RowDeposit::new(&mut rows, n_cols, &self.column_scale);
            self.deposit_pixel((nth * n_pixels / n_pilots) as u32, 0..1, 2, &mut scratch, &mut deposit);
            scratch.later
        };
        let sum = |a: [u64; 2], b: [u64; 2]| [a[0] + b[0], a[1] + b[1]];
        let [asked, left_out] = (0..n_pilots).into_par_iter().map(pilot).reduce(|| [0; 2], sum);
        left_out as f32 / asked.max(1) as f32
    }

    /// The same columns over rows of irradiance.
    pub(crate) fn of_irradiance(self, rows: &'a IrradianceRows) -> Self {
        TransportMatrix { film: rows.film(self.film), irradiance: Some(rows), ..self }
    }

    /// What each column of the scene's transport is multiplied by.
    pub fn column_scale(&self) -> &[f32] {
        &self.column_scale
    }

    /// Sets the scale of the columns.
    pub fn set_column_scale(&mut self, column_scale: Vec<f32>) {
        assert_eq!(column_scale.len(), self.n_cols(), "one scale per column");
        self.column_scale = column_scale;
    }

    /// Measures the brightness of each column on a small picture of its own: one over its 99.5 percentile, and the mean over
    /// pixels of each patch of the sky. A dim column that two halves disagree about is scaled to an eighth of the median column's peak, both
    /// under the light of the file; one that they agree about keeps its own, however dim.
    ///
    /// Patches of the sky share one scale: they shine together, and most of them light few pixels through a window, so
    /// that a percentile of their own would be next to nothing.
    pub fn measure_columns(self) -> (Vec<f32>, Vec<f32>) {
        let lighting = &self.integrator.scene().lighting;
        let measured = self.measure_brightness();
        let mut peaks: Vec<f32> = measured.iter().map(|column| column.peak).collect();
        let is_rare = |common: f32, mean: f32| common <= RARE * mean;
        let mut rare: Vec<bool> = measured.iter().map(|column| is_rare(column.common, column.mean)).collect();
        let patches = SkyPicks::new(lighting);
        let peak = |column: &u32| f64::from(peaks[*column as usize]);
        let of_patches = || patches.columns().iter().map(|&column| measured[column as usize]);
        let reach = of_patches().map(|column| column.mean).collect();
        // The mean of the peaks, each weighed by its square: that of the patches that shine in.
        let moment = |power: i32| patches.columns().iter().map(|column| peak(column).powi(power)).sum::<f64>();
        let shared = (moment(3) / moment(2).max(f64::MIN_POSITIVE)) as f32;
        let all_rare = is_rare(of_patches().map(|c| c.common).sum(), of_patches().map(|c| c.mean).sum());
        patches.columns().iter().for_each(|&column| {
            (peaks[column as usize], rare[column as usize]) = (shared, all_rare);
        });
        let light = lighting.basis.project(&LightRig::default());
        let light: Vec<f32> = light.into_iter().map(|rgb| luminance(Vec3::from(rgb))).collect();
        (scale_of_peaks(&peaks, &light, &rare), reach)
    }

    /// How bright each column is.
    ///
    /// Few samples scatter far more than pixels do, and their percentile would tell of noise. So it is that of the geometric mean of
    /// two halves: a speck that only one of them has does not count.
    fn measure_brightness(self) -> Vec<Brightness> {
        let n_cols = self.n_cols();
        let samples = 0..((SAMPLED_COLUMNS / n_cols.max(1)) as u32).clamp(1, PILOT_SAMPLES);
        let (pilots, tiles) = self.pilots();
        let n_rows = CHANNELS * tiles.iter().map(Vec::len).sum::<usize>();
        let both = |tile: &Vec<u32>| {
            let half = |half: Half| {
                let mut rows = vec![0.0; tile.len() * CHANNELS * n_cols];
                pilots.add_rows(tile, samples.clone(), half, &mut rows, &mut Vec::new());
                rows
            };
            let (mut rows, b) = (half(Half::A), half(Half::B));
            let mut sums = vec![[0.0; 2]; n_cols];
            for (a, b) in rows.chunks_exact_mut(n_cols).zip(b.chunks_exact(n_cols)) {
                for ((a, b), [mean, common]) in a.iter_mut().zip(b).zip(&mut sums) {
                    *mean += 0.5 * (*a + b);
                    *a = a.sqrt() * b.sqrt();
                    *common += *a;
                }
            }
            (rows, sums)
        };
        let measured: Vec<(Vec<f32>, Vec<[f32; 2]>)> = tiles.par_iter().map(both).collect();
        let of_column = |column: usize| {
            let [mean, common] =
                [0, 1].map(|i| measured.iter().map(|(_, sums)| sums[column][i]).sum::<f32>() / n_rows as f32);
            let rows = measured.iter().flat_map(|(rows, _)| rows.chunks_exact(n_cols));
            let mut values: Vec<f32> = rows.map(|row| row[column]).collect();
            // A lamp that no pixel meets twice is measured by its mean.
            let [peak, mean, common] = [peak(&mut values, mean), mean, common].map(|x| x / samples.end as f32);
            Brightness { peak, mean, common }
        };
        (0..n_cols).into_par_iter().map(of_column).collect()
    }

    /// The same rows of a picture with few pixels, all of which are pilots, tile by tile; of a grid some of its points.
    fn pilots(self) -> (Self, Vec<Vec<u32>>) {
        let n_pilots = PILOT_PIXELS.min(PILOT_ENTRIES / self.n_cols().max(1)).max(1);
        let (film, step) = if matches!(self.irradiance, Some(IrradianceRows::Grid(_))) {
            (self.film, self.film.n_pixels().div_ceil(n_pilots).max(1))
        } else {
            let shrink = (n_pilots as f64 / self.film.n_pixels().max(1) as f64).sqrt().min(1.0);
            let side = |length: u32| ((f64::from(length) * shrink).round() as u32).max(1);
            (Film { width: side(self.film.width), height: side(self.film.height) }, 1)
        };
        let tiles = reuse::tiles_of(film, (0..film.n_pixels() as u32).step_by(step));
        (TransportMatrix { film, seed: self.seed ^ PILOT_SEED, empty: None, ..self }, tiles)
    }

    /// The stream of random numbers of a row's pixel or point; halves are 0 and 1, 2 tells of weak connections.
    fn stream(&self, number: u32, half: u64) -> u64 {
        let own = match self.irradiance {
            None => 0,
            Some(IrradianceRows::Pixels) => IRRADIANCE_STREAMS[0],
            Some(IrradianceRows::Grid(_)) => IRRADIANCE_STREAMS[1],
        };
        own + u64::from(number) * 4 + half
    }

    /// Random numbers of a sample of a pixel or point and half.
    pub(crate) fn sampler(&self, number: u32, half: Half, sample: u32) -> Sampler {
        self.sampler_of(number, u64::from(half == Half::B), sample)
    }

    /// The same, halves as in [`TransportMatrix::stream`].
    fn sampler_of(&self, number: u32, half: u64, sample: u32) -> Sampler {
        let (seed, stream) = (self.seed, self.stream(number, half));
        if self.integrator.scene().samples_are_stratified {
            Sampler::new(seed, stream, sample)
        } else {
            Sampler::lone(seed, stream, sample)
        }
    }

    /// One sample of the rows of a pixel without the light that other surfaces send to the first diffuse base, which is left to be
    /// gathered.
    pub(crate) fn sample_direct(
        &self,
        ray: (Vec3, Vec3),
        sampler: &mut Sampler,
        scratch: &mut Scratch,
        deposit: &mut impl Deposit,
    ) -> Option<Gathering> {
        match self.irradiance {
            None => self.integrator.sample_direct(ray, sampler, scratch, deposit),
            Some(_) => self.integrator.sample_direct_irradiance(ray, sampler, scratch, deposit),
        }
    }

    /// What a pixel shows of which the rays are known to meet nothing.
    pub(crate) fn pass_by(&self, ray: (Vec3, Vec3), deposit: &mut impl Deposit) {
        if self.irradiance.is_none() {
            self.integrator.pass_by(ray, deposit);
        }
    }

    fn deposit_pixel(
        &self,
        pixel: u32,
        samples: Range<u32>,
        half: u64,
        scratch: &mut Scratch,
        deposit: &mut impl Deposit,
    ) {
        let at = [pixel % self.film.width, pixel / self.film.width];
        let Some(rows) = self.irradiance else {
            let is_empty = self.is_empty_pixel(pixel);
            for sample in samples {
                let sampler = self.sampler_of(pixel, half, sample);
                if is_empty {
                    self.integrator.sample_empty_pixel(&self.camera, self.film, at, sampler, deposit);
                } else {
                    self.integrator.sample_pixel(&self.camera, self.film, at, sampler, scratch, deposit);
                }
            }
            return;
        };
        if self.is_empty_pixel(pixel) {
            return;
        }
        for sample in samples {
            let mut sampler = self.sampler_of(pixel, half, sample);
            self.deposit_irradiance(rows, pixel, &mut sampler, scratch, deposit);
        }
    }

    /// A random point of a pixel, or its center where those alone are seen, and the camera's ray through it.
    pub(crate) fn sample_ray(&self, pixel: u32, sampler: &mut Sampler) -> (Vec2, (Vec3, Vec3)) {
        let corner = Vec2::new((pixel % self.film.width) as f32, (pixel / self.film.width) as f32);
        let film_px = self.integrator.film_px(corner, sampler);
        (film_px, self.ray(film_px))
    }

    /// Origin and direction of the camera's ray through a point of the film.
    pub(crate) fn ray(&self, film_px: Vec2) -> (Vec3, Vec3) {
        (self.camera.position(), self.camera.direction(self.film, film_px))
    }

    fn deposit_irradiance(
        &self,
        rows: &IrradianceRows,
        number: u32,
        sampler: &mut Sampler,
        scratch: &mut Scratch,
        deposit: &mut impl Deposit,
    ) {
        match rows {
            IrradianceRows::Pixels => {
                let (_, ray) = self.sample_ray(number, sampler);
                self.integrator.sample_seen_irradiance(ray, sampler, scratch, deposit);
            }
            IrradianceRows::Grid(grid) => {
                let Some(receiver) = grid.receiver(number) else { return };
                self.integrator.sample_irradiance(&receiver, sampler, scratch, deposit);
            }
        }
    }
}

/// One over the peak of each column; of lamps whose light in the file stays dim in the picture and is met by rare walks only, one over a
/// share of the median peak. `light` is the luminance that the file gives each column.
pub(crate) fn scale_of_peaks(peaks: &[f32], light: &[f32], is_rare: &[bool]) -> Vec<f32> {
    // What is below all normal numbers has no reciprocal in single precision.
    let lit = |p: f32| p > 0.0 && p.is_normal();
    let median_peak = median(peaks.iter().copied().filter(|&p| lit(p))).unwrap_or(1.0);
    let shown = peaks.iter().zip(light).map(|(p, l)| p * l);
    let least_shown = median(shown.filter(|&p| lit(p))).map_or(0.0, |shown| DIMMEST * shown);
    let scale = |((&peak, &light), &is_rare): ((&f32, &f32), &bool)| {
        let least = if is_rare && light > 0.0 { least_shown / light } else { 0.0 };
        let peak = if lit(peak) { peak.max(least) } else { least };
        1.0 / if lit(peak) { peak } else { median_peak }
    };
    peaks.iter().zip(light).zip(is_rare).map(scale).collect()
}

/// The 99.5 percentile of some values. Where that is dark, what is lit counts, which is less than this share: the brightest value, and no
/// less than `least`.
pub(crate) fn peak(values: &mut [f32], least: f32) -> f32 {
    let at = ((values.len() as f32 * PEAK_QUANTILE) as usize).min(values.len() - 1);
    let (_, peak, above) = values.select_nth_unstable_by(at, f32::total_cmp);
    if *peak > 0.0 { *peak } else { above.iter().copied().fold(least, f32::max) }
}

/// The middle one, of two the greater; `None` of none.
pub(crate) fn median(values: impl Iterator<Item = f32>) -> Option<f32> {
    let mut values: Vec<f32> = values.collect();
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f32::total_cmp).1)
}

impl SampledMatrix for TransportMatrix<'_> {
    fn n_rows(&self) -> usize {
        CHANNELS * self.film.n_pixels()
    }

    fn n_cols(&self) -> usize {
        self.column_scale.len()
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
        sparse: &mut Vec<SparseEntry>,
    ) {
        if self.irradiance.is_none() {
            return self.add_pixels(bundles, samples, half, out, sparse);
        }
        let (n_cols, mut scratch) = (self.n_cols(), Scratch::default());
        let half = u64::from(half == Half::B);
        for (nth, (&pixel, rows)) in bundles.iter().zip(out.chunks_exact_mut(CHANNELS * n_cols)).enumerate() {
            let first_row = (nth * CHANNELS) as u32;
            let mut deposit = RowDeposit::new(rows, n_cols, &self.column_scale).with_first_row(first_row);
            self.deposit_pixel(pixel, samples.clone(), half, &mut scratch, &mut deposit);
            sparse.append(&mut deposit.into_sparse());
        }
    }
}

/// Multiplies each column of some rows by a factor of its own.
pub(crate) fn scale_columns(rows: &mut [f32], factors: &[f32]) {
    rows.par_chunks_exact_mut(factors.len()).for_each(|row| {
        row.iter_mut().zip(factors).for_each(|(entry, factor)| *entry *= factor);
    });
}

/// Adds three rows of all columns to three others, times a weight per channel.
pub(crate) fn add_weighted(rows: &mut [f32], light: &[f32], weight: Vec3) {
    let row_len = rows.len() / CHANNELS;
    let channels = rows.chunks_exact_mut(row_len).zip(light.chunks_exact(row_len));
    for ((rows, light), weight) in channels.zip(weight.to_array()) {
        rows.iter_mut().zip(light).for_each(|(out, light)| *out += weight * light);
    }
}

/// Adds what a walk finds to the three rows of a pixel.
pub(crate) struct RowDeposit<'a> {
    rows: &'a mut [f32],
    n_cols: usize,
    column_scale: &'a [f32],
    first_row: u32,
    sparse: Vec<SparseEntry>,
}

impl<'a> RowDeposit<'a> {
    /// For three rows of `n_cols` columns, row-major.
    pub(crate) fn new(rows: &'a mut [f32], n_cols: usize, column_scale: &'a [f32]) -> Self {
        RowDeposit { rows, n_cols, column_scale, first_row: 0, sparse: Vec::new() }
    }

    /// Entries kept apart go to rows from `first_row` on.
    pub(crate) fn with_first_row(self, first_row: u32) -> Self {
        RowDeposit { first_row, ..self }
    }

    /// The three rows.
    pub(crate) fn rows(&mut self) -> &mut [f32] {
        self.rows
    }

    /// The entries kept apart so far.
    pub(crate) fn into_sparse(self) -> Vec<SparseEntry> {
        self.sparse
    }
}

impl Deposit for RowDeposit<'_> {
    #[inline]
    fn scattered(&mut self, column: u32, value: Vec3) {
        let (column, value) = (column as usize, value * self.column_scale[column as usize]);
        self.rows[column] += value.x;
        self.rows[self.n_cols + column] += value.y;
        self.rows[2 * self.n_cols + column] += value.z;
    }

    fn seen(&mut self, column: u32, value: Vec3) {
        let value = value * self.column_scale[column as usize];
        for (channel, value) in value.to_array().into_iter().enumerate().filter(|(_, v)| *v != 0.0) {
            self.sparse.push(SparseEntry { row: self.first_row + channel as u32, col: column, value });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_scaled_to_their_peak_but_dim_and_rare_ones_to_an_eighth_of_the_median() {
        let scale = |rare: [bool; 5]| scale_of_peaks(&[2.0, 1.0, 4.0, 1.0 / 1024.0, 0.0], &[1.0; 5], &rare);
        assert_eq!(scale([true; 5]), [0.5, 1.0, 0.25, 4.0, 4.0]);
        assert_eq!(scale([false, false, false, false, true]), [0.5, 1.0, 0.25, 1024.0, 4.0]);
    }

    #[test]
    fn a_small_lamp_that_the_file_turns_up_counts_as_much_as_a_large_one() {
        let dim = 1.0 / 1024.0;
        assert_eq!(scale_of_peaks(&[1.0, 1.0, dim], &[1.0, 1.0, 1024.0], &[true; 3]), [1.0, 1.0, 1024.0]);
        // A lamp that is off in the file keeps its own peak; one that lights nothing takes the median.
        assert_eq!(scale_of_peaks(&[1.0, dim, 0.0], &[1.0, 0.0, 0.0], &[true; 3]), [1.0, 1024.0, 1.0]);
    }

    #[test]
    fn what_hardly_any_light_comes_through_has_a_scale_all_the_same() {
        // As through forty depths of black glass, and the least number there is.
        for hardly in [1e-40, f32::from_bits(1)] {
            for is_rare in [false, true] {
                let scale = scale_of_peaks(&[2.0, hardly, 1.0], &[1.0; 3], &[is_rare; 3]);
                assert!(scale.iter().all(|scale| scale.is_finite() && *scale > 0.0), "{scale:?}");
            }
            assert_eq!(scale_of_peaks(&[hardly], &[1.0], &[false]), [1.0]);
        }
    }
}
