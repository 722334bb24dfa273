//! What a bake is held against: rows of the dense matrix, sampled twice, without compression and without skips between walks.

use std::cell::OnceCell;
use std::path::Path;

use anyhow::{Context, Result};
use clerestory_nystrom::{BlockFactors, BlockLowRank, Half, Partition, SampledMatrix};
use clerestory_transport::bake::{BakeHeader, BakeJob};
use clerestory_transport::camera::Film;
use clerestory_transport::matrix::{CHANNELS, TransportMatrix};
use clerestory_transport::plan::{Density, MatrixPlan};
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::skips::Skips;
use rayon::prelude::*;

use super::desk::Desk;
use super::errors::{ColumnErrors, Sum, Told, quantile, told_beside_two};
use super::kept::checksum;
use super::methods::dense::TILE;

/// Samples of each pixel around one that is compared: whether a light is seen there.
const NEAR_SAMPLES: u32 = 4;
/// The same of each pixel of a whole picture.
const LOOKS: u32 = 8;
/// Of the references, which no bake has.
const SEED: u64 = 0x5EED;
/// Samples of pixels that are taken before they are written down, about: a minute's work or less.
const PIECE: u64 = 1_000_000;
/// To be raised when the same file, settings and seed give other numbers: when another scene is read from the file, when rays,
/// materials, lights or random numbers change, or when what is kept is laid out otherwise. All references are then sampled anew. A
/// version of the program that changes none of this leaves it as it is; a test samples a few pixels and says when it is due.
const TRACER: u32 = 2;

/// What is sampled, and how well.
#[derive(Clone, Copy)]
pub struct Sampling {
    /// The picture.
    pub film: Film,
    /// Every so manyth pixel across and down is sampled; the others are like them.
    pub step: u32,
    /// Scattering events beyond the first.
    pub bounces: Option<u32>,
    /// Samples per pixel of each half.
    pub spp: u32,
}

/// A matrix sampled twice, independently of each other and of every bake of the report.
pub struct Reference {
    n_cols: usize,
    /// Those that are sampled.
    pixels: Vec<u32>,
    /// Row-major, channels of these pixels × columns, radiance per unit of light.
    halves: [Vec<f32>; 2],
    /// Whether the camera saw the light of a column in a pixel or in one beside it, by pixel × column.
    seen: Vec<bool>,
    /// The 99.5 percentile of each column's entries, those where its light is seen aside.
    peaks: Vec<f64>,
}

/// Rows of a bake at some pixels, a row per channel, radiance per unit of light; `row` writes one of a block.
pub fn rows_of(
    pixels: &[u32],
    (header, groups): (&BakeHeader, &[BlockLowRank]),
    row: impl Fn(&BlockFactors, usize, &mut [f32]),
) -> Vec<f32> {
    let (partition, n_cols) = (header.partition(), header.basis.n_cols());
    let mut place = vec![u32::MAX; (header.width * header.height) as usize];
    pixels.iter().enumerate().for_each(|(nth, &pixel)| place[pixel as usize] = nth as u32);
    let (mut rows, mut bundles) = (vec![0.0; pixels.len() * CHANNELS * n_cols], Vec::new());
    for (group, columns) in groups.iter().zip(&header.basis.groups) {
        let columns = columns.columns.start as usize..columns.columns.end as usize;
        for (block_idx, block) in group.blocks.iter().enumerate() {
            let Some(block) = block else { continue };
            partition.bundles(block_idx, &mut bundles);
            for (nth, &pixel) in bundles.iter().enumerate().filter(|(_, pixel)| place[**pixel as usize] != u32::MAX) {
                for channel in 0..CHANNELS {
                    let at = place[pixel as usize] as usize * CHANNELS + channel;
                    row(block, nth * CHANNELS + channel, &mut rows[at * n_cols..][columns.clone()]);
                }
            }
        }
    }
    for row in rows.chunks_exact_mut(n_cols) {
        row.iter_mut().zip(&header.column_scale).for_each(|(value, scale)| *value /= scale);
    }
    rows
}

impl Reference {
    /// Samples a scene that was read from some files, or takes what was sampled by an earlier run.
    ///
    /// # Errors
    /// If the files cannot be read or it cannot be kept.
    pub fn new(desk: &Desk, files: &[&Path], scene: &PreparedScene, sampling: Sampling) -> Result<Reference> {
        let Sampling { film, step, .. } = sampling;
        let key = format!("dense rows of each {step}th pixel: {}", key_of(files, scene, sampling, SEED)?);
        let pixels = every(film, step);
        let (n_cols, n_pixels) = (scene.lighting.basis.n_cols(), pixels.len());
        let pieces = in_pieces(&pixels, sampling.spp);
        let plan = OnceCell::new();
        let piece = |nth: usize| {
            desk.say(&format!("sampling the reference, part {} of {}", nth + 1, pieces.len()));
            Ok(sampled(scene, plan.get_or_init(|| plainest_plan(scene, sampling, SEED)), sampling, pieces[nth]))
        };
        let values = desk.in_pieces(&key, pieces.len(), piece, joined)?;
        let (halves, seen) = values.split_at(2 * n_pixels * CHANNELS * n_cols);
        let (a, b) = halves.split_at(n_pixels * CHANNELS * n_cols);
        let seen = seen.iter().map(|&seen| seen > 0.0).collect();
        let halves = [a.to_vec(), b.to_vec()];
        let mut reference = Reference { n_cols, pixels, halves, seen, peaks: Vec::new() };
        reference.peaks = (0..n_cols).into_par_iter().map(|column| reference.peak(column)).collect();
        Ok(reference)
    }

    /// The pixels that are compared.
    pub fn pixels(&self) -> &[u32] {
        &self.pixels
    }

    fn n_rows(&self) -> usize {
        self.pixels.len() * CHANNELS
    }

    fn is_seen(&self, row: usize, column: usize) -> bool {
        self.seen[row / CHANNELS * self.n_cols + column]
    }

    fn both(&self, row: usize, column: usize) -> [f64; 2] {
        [0, 1].map(|half| f64::from(self.halves[half][row * self.n_cols + column]))
    }

    fn peak(&self, column: usize) -> f64 {
        let rows = (0..self.n_rows()).filter(|&row| !self.is_seen(row, column));
        quantile(rows.map(|row| self.both(row, column).iter().sum::<f64>() / 2.0).collect())
    }

    /// The mean of both halves, laid out as they are.
    pub fn mean(&self) -> Vec<f32> {
        let [a, b] = &self.halves;
        a.iter().zip(b).map(|(a, b)| 0.5 * (a + b)).collect()
    }

    /// The rows of a bake that are compared, as the reference has them.
    pub fn rows_of(&self, header: &BakeHeader, groups: &[BlockLowRank]) -> Vec<f32> {
        rows_of(&self.pixels, (header, groups), BlockFactors::row)
    }

    /// The error of every column of rows that are laid out as the reference's.
    pub fn errors(&self, rows: &[f32]) -> ColumnErrors {
        self.errors_of(rows, &(0..self.n_cols).collect::<Vec<_>>())
    }

    /// The same of some columns alone.
    pub fn errors_of(&self, rows: &[f32], columns: &[usize]) -> ColumnErrors {
        let column = |&column: &usize| {
            let (mut sums, peak) = ([Sum::default(); 2], self.peaks[column]);
            for first in (0..self.n_rows()).step_by(CHANNELS) {
                let errors = [0, 1, 2].map(|channel| {
                    let row = first + channel;
                    let (x, [a, b]) = (f64::from(rows[row * self.n_cols + column]), self.both(row, column));
                    (x - a) * (x - b)
                });
                sums[1].add_pixel(errors);
                if !self.is_seen(first, column) {
                    sums[0].add_pixel(errors);
                }
            }
            let squares = sums.map(|sum| sum.mean_at_least_known() / (peak * peak));
            self.is_lit(column).then_some((squares, sums[0].is_noise()))
        };
        let errors: Vec<([f64; 2], bool)> = columns.par_iter().filter_map(column).collect();
        let (squares, are_bounds) = errors.into_iter().unzip();
        ColumnErrors { squares, are_bounds }
    }

    /// The column that one of [`Reference::errors`] is of: columns that light nothing have none.
    pub fn column_of(&self, nth: usize) -> Option<usize> {
        (0..self.n_cols).filter(|&column| self.is_lit(column)).nth(nth)
    }

    /// Whether a column lights anything; one whose peak is no number is not left out.
    fn is_lit(&self, column: usize) -> bool {
        self.peaks[column] > 0.0 || self.peaks[column].is_nan()
    }

    /// The light of all columns together in rows that are laid out as the reference's, but for the entries that are left out of its
    /// errors: a lamp that is seen outshines all that it lights.
    pub fn light(&self, rows: &[f32]) -> f64 {
        let of_row = |(row, entries): (usize, &[f32])| -> f64 {
            let lit = entries.iter().enumerate().filter(|(column, _)| !self.is_seen(row, *column));
            lit.map(|(_, value)| f64::from(*value)).sum()
        };
        rows.chunks_exact(self.n_cols).enumerate().map(of_row).sum()
    }

    /// The picture that rows make under a coefficient per column and channel, as far as it is compared.
    pub fn relit(&self, rows: &[f32], light: &[[f32; 3]]) -> Vec<f32> {
        let row = |(row, entries): (usize, &[f32])| {
            entries.iter().zip(light).map(|(entry, light)| entry * light[row % CHANNELS]).sum()
        };
        rows.par_chunks_exact(self.n_cols).enumerate().map(row).collect()
    }

    /// The error of a picture under a light, what it has of the compared pixels; pixels that show a light that is lit, or lie
    /// beside one, are left out. As [`told_beside_two`] tells it.
    pub fn picture_told(&self, light: &[[f32; 3]], picture: &[f32]) -> Option<Told> {
        let [a, b] = self.halves.each_ref().map(|half| self.relit(half, light));
        let lit: Vec<usize> = (0..self.n_cols).filter(|&column| light[column] != [0.0; 3]).collect();
        let is_left_out = |row: usize| lit.iter().any(|&column| self.is_seen(row, column));
        let firsts = (0..self.n_rows()).step_by(CHANNELS).filter(|&row| !is_left_out(row));
        let entry = |row: usize| [picture[row], a[row], b[row]].map(f64::from);
        told_beside_two(firsts.map(|first| [0, 1, 2].map(|channel| entry(first + channel))))
    }

    /// The same in dB alone.
    pub fn picture_db(&self, light: &[[f32; 3]], picture: &[f32]) -> Option<f64> {
        self.picture_told(light, picture).map(|told| told.db)
    }
}

/// All that samples depend on, for [`super::kept::Kept::numbers`]: the bytes of the files that a scene was read from, its lights with
/// their columns, the size, the samples with their seed, and the [`TRACER`]. The view is that of the file's first camera.
///
/// # Errors
/// If a file cannot be read.
pub fn key_of(files: &[&Path], scene: &PreparedScene, sampling: Sampling, seed: u64) -> Result<String> {
    let Sampling { film: Film { width, height }, bounces, spp, .. } = sampling;
    let contents = |path: &&Path| -> Result<String> {
        let bytes = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
        Ok(checksum(&bytes))
    };
    let files = files.iter().map(contents).collect::<Result<Vec<_>>>()?;
    let lights = serde_json::to_vec(&(&scene.lighting.basis, scene.skips))?;
    Ok(format!(
        "files {}, lights {}, {width} × {height} pixels, {spp} samples in each half, bounces {bounces:?}, seed {seed}, tracer {TRACER}",
        files.join(" and "),
        checksum(&lights),
    ))
}

/// Every so manyth pixel across and down, from the middle of the first such square on.
fn every(film: Film, step: u32) -> Vec<u32> {
    let side = |end: u32| (step / 2..end).step_by(step as usize);
    side(film.height).flat_map(|y| side(film.width).map(move |x| y * film.width + x)).collect()
}

/// Some pixels after the others, as many as take [`PIECE`] samples in both halves.
fn in_pieces(pixels: &[u32], spp: u32) -> Vec<&[u32]> {
    let n_pieces = (pixels.len() as u64 * 2 * u64::from(spp)).div_ceil(PIECE).max(1) as usize;
    pixels.chunks(pixels.len().div_ceil(n_pieces).max(1)).collect()
}

/// What [`sampled()`] has of all pixels, from what it has of some after the others.
fn joined(pieces: &[Vec<f32>]) -> Vec<f32> {
    let mut all = Vec::with_capacity(pieces.iter().map(Vec::len).sum());
    let half = |piece: &[f32]| piece.len() / (2 * CHANNELS + 1) * CHANNELS;
    for nth in 0..2 {
        pieces.iter().for_each(|piece| all.extend_from_slice(&piece[nth * half(piece)..][..half(piece)]));
    }
    pieces.iter().for_each(|piece| all.extend_from_slice(&piece[2 * half(piece)..]));
    all
}

/// Two halves, then for each pixel and column 1 where its light is seen, else 0. Each pixel walks for itself.
fn sampled(scene: &PreparedScene, plan: &MatrixPlan, sampling: Sampling, pixels: &[u32]) -> Vec<f32> {
    let Sampling { film, bounces, spp, .. } = sampling;
    let matrix = TransportMatrix::new(scene, plan, scene.scene.cameras[0].clone(), film, bounces, SEED);
    let (n_cols, mut seen) = (matrix.n_cols(), vec![0.0; pixels.len() * matrix.n_cols()]);
    let mut values = Vec::with_capacity((2 * CHANNELS + 1) * seen.len());
    for half in [Half::A, Half::B] {
        let (rows, sparse) = lone_rows(&matrix, pixels, spp, half);
        values.extend(rows);
        sparse.into_iter().for_each(|at| seen[at] = 1.0);
    }
    let near = |(nth, seen): (usize, &mut [f32])| {
        let mut scratch = vec![0.0; CHANNELS * n_cols];
        for pixel in around(film, pixels[nth]) {
            let mut sparse = Vec::new();
            matrix.add_rows(&[pixel], 0..NEAR_SAMPLES, Half::A, &mut scratch, &mut sparse);
            sparse.iter().for_each(|entry| seen[entry.col as usize] = 1.0);
        }
    };
    seen.par_chunks_mut(n_cols).enumerate().for_each(near);
    values.extend(seen);
    values
}

/// Which pixels of a picture show a light that is lit, straight or by mirrors and glass, or lie beside one that does, as far as a few
/// samples of each find it; a coefficient per column.
pub fn near_seen_light(scene: &PreparedScene, film: Film, light: &[[f32; 3]]) -> Vec<bool> {
    let plan = plainest_plan(scene, Sampling { film, step: 1, bounces: None, spp: LOOKS }, SEED);
    let matrix = TransportMatrix::new(scene, &plan, scene.scene.cameras[0].clone(), film, None, SEED);
    let partition = Partition { width: film.width, height: film.height, tile: TILE as u32 };
    let of_block = |block_idx: usize| {
        let (mut bundles, mut sparse) = (Vec::new(), Vec::new());
        partition.bundles(block_idx, &mut bundles);
        let mut rows = vec![0.0; bundles.len() * CHANNELS * matrix.n_cols()];
        matrix.add_rows(&bundles, 0..LOOKS, Half::A, &mut rows, &mut sparse);
        sparse.retain(|entry| light[entry.col as usize] != [0.0; 3]);
        sparse.into_iter().map(|entry| bundles[entry.row as usize / CHANNELS]).collect::<Vec<u32>>()
    };
    let seen: Vec<u32> = (0..partition.n_blocks()).into_par_iter().flat_map_iter(of_block).collect();
    let mut near = vec![false; film.n_pixels()];
    for pixel in seen {
        near[pixel as usize] = true;
        around(film, pixel).for_each(|beside| near[beside as usize] = true);
    }
    near
}

/// A plan for walks of which nothing is skipped; how bright the columns are, by which walks are guided, is measured.
pub fn plainest_plan(scene: &PreparedScene, Sampling { film, bounces, .. }: Sampling, seed: u64) -> MatrixPlan {
    let new = || MatrixPlan::new(&scene.lighting, Density::Full);
    let plan = new();
    let matrix = TransportMatrix::new(scene, &plan, scene.scene.cameras[0].clone(), film, bounces, seed);
    let (column_scale, sky_reach) = matrix.measure_columns();
    new().fitted(&column_scale, &sky_reach, Skips::none())
}

/// The samples of a bake whose indirect light is traced, neither compressed nor denoised: mean rows of some pixels.
pub fn uncompressed(job: &BakeJob, header: &BakeHeader, pixels: &[u32]) -> Vec<f32> {
    let (lighting, config) = (&job.scene.lighting, &job.config);
    let plan = MatrixPlan::without(lighting, Density::Full, &header.spared.dark_sources);
    let plan = plan.fitted(&header.column_scale, &header.sky_reach, job.scene.skips);
    let matrix = TransportMatrix::new(&job.scene, &plan, job.camera.clone(), job.film, config.bounces, config.seed);
    let rows = |half| rows_in_blocks(&matrix, (job.film, pixels), (config.spp / 2, half), Emitters::Seen);
    let [mut rows, other] = [Half::A, Half::B].map(rows);
    rows.par_iter_mut().zip(&other).for_each(|(value, other)| *value = 0.5 * (*value + other));
    rows
}

/// Whether rows show light that the camera sees straight.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Emitters {
    Seen,
    LeftOut,
}

/// Mean rows of some pixels. All pixels are sampled, block by block as in a bake, so that they share their walks.
pub fn rows_in_blocks(
    matrix: &TransportMatrix<'_>,
    (film, pixels): (Film, &[u32]),
    (spp, half): (u32, Half),
    emitters: Emitters,
) -> Vec<f32> {
    let n_cols = matrix.n_cols();
    let len = CHANNELS * n_cols;
    let mut place = vec![usize::MAX; film.n_pixels()];
    pixels.iter().enumerate().for_each(|(nth, &pixel)| place[pixel as usize] = nth);
    let partition = Partition { width: film.width, height: film.height, tile: TILE as u32 };
    let of_block = |block_idx: usize| {
        let (mut bundles, mut sparse) = (Vec::new(), Vec::new());
        partition.bundles(block_idx, &mut bundles);
        let mut rows = vec![0.0; bundles.len() * len];
        matrix.add_rows(&bundles, 0..spp, half, &mut rows, &mut sparse);
        if emitters == Emitters::Seen {
            sparse.iter().for_each(|entry| rows[entry.row as usize * n_cols + entry.col as usize] += entry.value);
        }
        let mean = |row: &[f32]| row.iter().map(|value| value / spp as f32).collect::<Vec<f32>>();
        let wanted =
            bundles.iter().zip(rows.chunks_exact(len)).filter(|(pixel, _)| place[**pixel as usize] != usize::MAX);
        wanted.map(|(pixel, row)| (place[*pixel as usize], mean(row))).collect::<Vec<_>>()
    };
    let found: Vec<(usize, Vec<f32>)> = (0..partition.n_blocks()).into_par_iter().flat_map_iter(of_block).collect();
    let mut all = vec![0.0; pixels.len() * len];
    found.into_iter().for_each(|(nth, row)| all[nth * len..][..len].copy_from_slice(&row));
    all
}

/// Mean rows of some pixels, each by itself, lights that are seen included, and where they are seen: places by pixel × column.
fn lone_rows(matrix: &TransportMatrix<'_>, pixels: &[u32], spp: u32, half: Half) -> (Vec<f32>, Vec<usize>) {
    let n_cols = matrix.n_cols();
    let mut rows = vec![0.0; pixels.len() * CHANNELS * n_cols];
    let of_pixel = |(nth, rows): (usize, &mut [f32])| {
        let mut sparse = Vec::new();
        matrix.add_rows(&[pixels[nth]], 0..spp, half, rows, &mut sparse);
        for entry in &sparse {
            rows[entry.row as usize * n_cols + entry.col as usize] += entry.value;
        }
        rows.iter_mut().for_each(|value| *value /= spp as f32);
        sparse.into_iter().map(|entry| nth * n_cols + entry.col as usize).collect::<Vec<_>>()
    };
    let seen = rows.par_chunks_mut(CHANNELS * n_cols).enumerate().flat_map_iter(of_pixel).collect();
    (rows, seen)
}

/// Pixels beside one, in the picture.
fn around(film: Film, pixel: u32) -> impl Iterator<Item = u32> {
    let (x, y) = (pixel % film.width, pixel / film.width);
    let near = |at: u32, end: u32| at.saturating_sub(1)..(at + 2).min(end);
    let all = near(y, film.height).flat_map(move |y| near(x, film.width).map(move |x| y * film.width + x));
    all.filter(move |other| *other != pixel)
}

#[cfg(test)]
mod tests {
    use clerestory_transport::camera::Camera;
    use clerestory_transport::emitters::SkyRequest;
    use clerestory_transport::scene::Scene;
    use clerestory_transport::sky::{Environment, SkyForm, SkyLight};
    use glam::Vec3;

    use super::*;
    use crate::errors::decibels;

    /// Nothing under an even sky.
    fn under_sky(intensity: f32) -> PreparedScene {
        let light = SkyLight { intensity, ..SkyLight::new("uniform", Environment::from_fn(16, 8, |_| Vec3::ONE)) };
        PreparedScene::with_sky(Scene::default(), &[], Some(&SkyRequest { light, form: SkyForm::Whole })).unwrap().0
    }

    /// Pixels that all see the sky, a column for each of its patches.
    fn all_sky() -> PreparedScene {
        let camera = Camera::look_at("all sky", Vec3::ZERO, Vec3::NEG_Z, 1.0, 2.0);
        let light = SkyLight::new("uniform", Environment::from_fn(16, 8, |_| Vec3::ONE));
        let sky = SkyRequest { light, form: SkyForm::Patches(1) };
        let scene = Scene { cameras: vec![camera], ..Scene::default() };
        PreparedScene::with_sky(scene, &[], Some(&sky)).unwrap().0
    }

    #[test]
    fn pieces_of_a_reference_are_together_what_is_sampled_at_once() {
        let (scene, film) = (all_sky(), Film { width: 8, height: 4 });
        let sampling = Sampling { film, step: 1, bounces: None, spp: 2 };
        let plan = plainest_plan(&scene, sampling, SEED);
        let pixels = every(film, 1);
        let of = |pixels: &[u32]| sampled(&scene, &plan, sampling, pixels);
        assert_eq!(joined(&[of(&pixels[..5]), of(&pixels[5..])]), of(&pixels));
        let pieces = in_pieces(&pixels, 40_000);
        assert_eq!(pieces.iter().map(|piece| piece.len()).collect::<Vec<_>>(), [11, 11, 10]);
        assert_eq!((pieces.concat(), in_pieces(&pixels, 1).len()), (pixels.clone(), 1));
    }

    #[test]
    fn samples_are_those_of_the_kept_references_or_the_tracer_is_raised() {
        // Of twelve pixels, both halves with all their channels and columns together.
        const SUMS: [f32; 12] = [
            0.086635, 0.154134, 0.534905, 0.378426, 0.129171, 0.196701, 0.285811, 0.202779, 0.101618, 0.168543,
            0.372403, 0.266748,
        ];
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/scenes/diffuse.glb");
        let scene = crate::scenes::prepared(&path, None).unwrap();
        let sampling = Sampling { film: Film { width: 48, height: 36 }, step: 4, bounces: None, spp: 4 };
        let pixels: Vec<u32> = every(sampling.film, sampling.step).into_iter().step_by(9).collect();
        let values = sampled(&scene, &plainest_plan(&scene, sampling, SEED), sampling, &pixels);
        let len = CHANNELS * scene.lighting.basis.n_cols();
        let (a, rest) = values.split_at(pixels.len() * len);
        let both = a.chunks_exact(len).zip(rest.chunks_exact(len));
        let sums: Vec<f32> = both.map(|(a, b)| a.iter().chain(b).sum::<f32>()).collect();
        // Last digits of sines and powers are those of the machine, and a path that they turn elsewhere changes the sum of its pixel.
        let n_others = sums.iter().zip(SUMS).filter(|&(sum, kept)| (sum - kept).abs() > 1e-3 * kept).count();
        assert!(
            n_others <= 1,
            "kept references were sampled otherwise: raise TRACER, and expect {sums:?} from then on"
        );
    }

    #[test]
    fn a_reference_is_named_by_what_its_files_hold_its_lights_and_how_it_is_sampled() {
        let folder = std::env::temp_dir().join(format!("clerestory-reference-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let write = |name: &str, bytes: &[u8]| {
            let path = folder.join(name);
            std::fs::write(&path, bytes).unwrap();
            path
        };
        let (room, same) = (write("room.glb", b"a room"), write("same.glb", b"a room"));
        let (hall, scene) = (write("hall.glb", b"a hall"), under_sky(1.0));
        let sampling = Sampling { film: Film { width: 8, height: 4 }, step: 2, bounces: None, spp: 4 };
        let key = |files: &[&Path], scene: &PreparedScene, sampling: Sampling, seed: u64| {
            key_of(files, scene, sampling, seed).unwrap()
        };
        let plain = key(&[room.as_path()], &scene, sampling, 1);
        assert_eq!(plain, key(&[same.as_path()], &scene, sampling, 1), "where a file lies does not matter");
        assert!(plain.ends_with(&format!("tracer {TRACER}")), "{plain}");
        let others = [
            key(&[hall.as_path()], &scene, sampling, 1),
            key(&[room.as_path(), hall.as_path()], &scene, sampling, 1),
            key(&[room.as_path()], &under_sky(2.0), sampling, 1),
            key(&[room.as_path()], &scene, sampling, 2),
            key(&[room.as_path()], &scene, Sampling { spp: 8, ..sampling }, 1),
            key(&[room.as_path()], &scene, Sampling { bounces: Some(6), ..sampling }, 1),
            key(&[room.as_path()], &scene, Sampling { film: Film { width: 4, height: 8 }, ..sampling }, 1),
        ];
        for (number, other) in others.iter().enumerate() {
            assert_ne!(&plain, other, "{number}");
        }
        assert!(key_of(&[folder.join("none.glb").as_path()], &scene, sampling, 1).is_err());
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn each_compared_pixel_stands_for_a_square_of_its_own() {
        let film = Film { width: 8, height: 4 };
        assert_eq!(every(film, 4), [18, 22]);
        assert_eq!(every(film, 1).len(), film.n_pixels());
        assert_eq!(around(film, 0).collect::<Vec<_>>(), [1, 8, 9]);
        assert_eq!(around(film, 9).count(), 8);
    }

    #[test]
    fn pixels_that_see_the_sky_and_those_beside_them_are_left_out_while_it_is_lit() {
        let scene = all_sky();
        let (film, n_cols) = (Film { width: 8, height: 4 }, scene.lighting.basis.n_cols());
        assert_eq!(near_seen_light(&scene, film, &vec![[1.0; 3]; n_cols]), [true; 32]);
        assert_eq!(near_seen_light(&scene, film, &vec![[0.0; 3]; n_cols]), [false; 32]);
    }

    #[test]
    fn lamps_that_are_seen_are_no_part_of_the_light() {
        // Two pixels of two columns; the first pixel shows the lamp of the second column.
        let rows =
            [[1.0, 1000.0], [2.0, 0.5]].map(|row| [row; 3]).into_iter().flatten().flatten().collect::<Vec<f32>>();
        let halves = [rows.clone(), rows.clone()];
        let seen = vec![false, true, false, false];
        let reference = Reference { n_cols: 2, pixels: vec![0, 1], halves, seen, peaks: vec![2.0, 0.5] };
        assert_eq!(reference.light(&rows), 3.0 * 3.5);
    }

    #[test]
    fn rows_and_references_with_what_is_no_number_are_as_bad_as_can_be() {
        let (pixels, halves) = ((0..10).collect(), [vec![2.0; 30], vec![2.0; 30]]);
        let seen = vec![false; 10];
        let mut reference = Reference { n_cols: 1, pixels, halves, seen, peaks: vec![2.0] };
        let rows = vec![2.0f32; 30];
        let mut broken = rows.clone();
        broken[7] = f32::NAN;
        let dbs = |reference: &Reference, rows: &[f32]| {
            [Some(reference.errors(rows).worst_db()), reference.picture_db(&[[1.0; 3]], rows)]
        };
        assert_eq!(dbs(&reference, &broken), [Some(f64::NEG_INFINITY); 2]);
        reference.halves[0][7] = f32::NAN;
        reference.peaks[0] = f64::NAN;
        assert_eq!(dbs(&reference, &rows), [Some(f64::NEG_INFINITY); 2]);
        assert_eq!(reference.column_of(0), Some(0), "it is not left out");
    }

    #[test]
    fn the_noise_of_the_reference_does_not_count() {
        // The truth is 2, each half is off by a half in a pattern of its own, and what is compared is off by a fifth everywhere.
        let half = |bit: usize| (0..300).map(|row| if (row / 3) >> bit & 1 == 0 { 1.5 } else { 2.5 }).collect();
        let (halves, pixels) = ([half(0), half(1)], (0..100).collect());
        let reference = Reference { n_cols: 1, pixels, halves, seen: vec![false; 100], peaks: vec![2.0] };
        let off = vec![2.2; 300];
        let errors = reference.errors(&off);
        assert!((errors.mean_db() - 20.0).abs() < 1e-4 && (errors.median_db().expect("an error") - 20.0).abs() < 1e-4);
        assert!(reference.errors_of(&off, &[]).median_db().is_none());
        // Of a picture the peak is its own: the halves are both bright in a quarter of it.
        let of_picture = reference.picture_db(&[[1.0; 3]], &off).expect("an error");
        assert!((of_picture - decibels(2.5, 0.04)).abs() < 1e-4);
        // Nothing is off: what is left is how well that is known, a quarter over the root of 100 pixels.
        let of_truth = reference.picture_db(&[[1.0; 3]], &[2.0; 300]).expect("an error");
        assert!((of_truth - decibels(2.5, 0.25 / 10.0)).abs() < 1e-4, "{of_truth}");
        let of_column = reference.errors(&[2.0; 300]);
        assert!((of_column.mean_db() - decibels(2.0, 0.25 / 10.0)).abs() < 1e-4, "{}", of_column.mean_db());
        assert_eq!(of_column.are_bounds, [true]);
    }
}
