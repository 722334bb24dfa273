//! A bake against a transport matrix that another renderer made, one picture per texel. Needs the shared data.

use std::sync::Arc;

use clerestory_nystrom::{Half, SampledMatrix};
use rayon::prelude::*;

use super::{at_hand, pictures};
use crate::bake::{Bake, BakeConfig};
use crate::camera::Film;
use crate::import;
use crate::matrix::{CHANNELS, TransportMatrix};
use crate::plan::{Density, MatrixPlan};
use crate::prepared::PreparedScene;

const FILM: Film = Film { width: 64, height: 48 };
const N_LIGHTS: usize = 64;
/// Radiance of each texel in the reference, its samples per pixel, and the relative noise of a pixel, from its README.
const RADIANCE: f32 = 8.0;
const REFERENCE_SPP: f64 = 512.0;
const REFERENCE_NOISE: f64 = 0.02;
/// Scattering events beyond the first in the reference.
const BOUNCES: Option<u32> = Some(6);
/// Our samples of each of two halves.
const SPP: u32 = 80;
const TILE: usize = 8;
/// Largest difference of a column's mean beyond noise, four standard errors.
const MEAN_TOLERANCE: f64 = 3e-3;
/// A block is off where it differs by more standard errors than this, and this share of them must not be.
const Z_MAX: f64 = 3.5;
const SHARE: f64 = 0.995;
/// Root mean square of z: normal values of that much have as many beyond `Z_MAX` as `SHARE` leaves.
const MOST_SPREAD: f64 = 1.25;
/// Least of it where all noise is told and no more: half of what it ought to be, so that blocks could be off by twice as much. What
/// ranks leave out of a bake is told as more than it is.
const LEAST_SPREAD: f64 = 0.5;

/// The array of that name in an uncompressed NPZ file: what its header says, and its bytes.
fn npz_array<'a>(npz: &'a [u8], name: &str) -> (&'a str, &'a [u8]) {
    let u16_at = |at: usize| u16::from_le_bytes([npz[at], npz[at + 1]]) as usize;
    let mut at = 0;
    while npz[at..].starts_with(b"PK\x03\x04") {
        let (method, n_name, n_extra) = (u16_at(at + 8), u16_at(at + 26), u16_at(at + 28));
        assert_eq!(method, 0, "the archive is not compressed");
        let extra = at + 30 + n_name;
        let short = u32::from_le_bytes(npz[at + 18..at + 22].try_into().expect("four bytes"));
        // Sizes that do not fit stand in the extra field, after its tag, its length and the uncompressed size.
        let size = if short == u32::MAX {
            u64::from_le_bytes(npz[extra + 12..extra + 20].try_into().expect("eight bytes")) as usize
        } else {
            short as usize
        };
        let start = extra + n_extra;
        if npz[at + 30..extra] == *format!("{name}.npy").as_bytes() {
            let array = &npz[start..start + size];
            assert!(array.starts_with(b"\x93NUMPY\x01"), "{name} is an array");
            let header = 10 + usize::from(u16::from_le_bytes([array[8], array[9]]));
            return (std::str::from_utf8(&array[10..header]).expect("the header is text"), &array[header..]);
        }
        at = start + size;
    }
    panic!("no array {name}");
}

/// Column by column the rows of its picture at radiance 1, in the order of the scene's columns.
fn reference(npz: &[u8], scene: &PreparedScene) -> Vec<Vec<f64>> {
    let (header, names) = npz_array(npz, "lights");
    assert!(header.contains("'<U9'") && header.contains("(64,)"), "{header}");
    let name = |bytes: &[u8]| -> String {
        let letters = bytes.chunks_exact(4).map(|c| u32::from_le_bytes([c[0], c[1], c[2], c[3]]));
        letters.filter_map(char::from_u32).filter(|&c| c != '\0').collect()
    };
    let names: Vec<String> = names.chunks_exact(4 * 9).map(name).collect();
    let (header, values) = npz_array(npz, "images");
    assert!(header.contains("'<f4'") && header.contains("(64, 48, 64, 3)"), "{header}");
    let values: Vec<f32> = values.chunks_exact(4).map(|c| f32::from_le_bytes([c[0], c[1], c[2], c[3]])).collect();
    let images: Vec<&[f32]> = values.chunks_exact(CHANNELS * FILM.n_pixels()).collect();
    assert_eq!((names.len(), images.len(), scene.lighting.basis.n_cols()), (N_LIGHTS, N_LIGHTS, N_LIGHTS));
    let column = |key: &str| {
        let image = names.iter().position(|name| name == key).expect("the reference has every light of the scene");
        images[image].iter().map(|&v| f64::from(v / RADIANCE)).collect()
    };
    scene.lighting.basis.sources.iter().map(|source| column(&source.key)).collect()
}

/// Column by column the rows of one half, sampled as a bake samples them but not compressed; NaN where the camera sees
/// the texel itself: at its rim a few pixels are far noisier than all others.
fn sampled(scene: &PreparedScene, half: Half) -> Vec<Vec<f64>> {
    let plan = MatrixPlan::new(&scene.lighting, Density::Full);
    let matrix = TransportMatrix::new(scene, &plan, scene.scene.cameras[0].clone(), FILM, BOUNCES, 1);
    let mut rows = vec![0.0; CHANNELS * FILM.n_pixels() * N_LIGHTS];
    rows.par_chunks_exact_mut(CHANNELS * N_LIGHTS).enumerate().for_each(|(pixel, rows)| {
        let mut sparse = Vec::new();
        matrix.add_rows(&[pixel as u32], 0..SPP, half, rows, &mut sparse);
        for entry in sparse {
            rows[entry.row as usize * N_LIGHTS + entry.col as usize] = f32::NAN;
        }
    });
    let column = |c: usize| rows.iter().skip(c).step_by(N_LIGHTS).map(|&v| f64::from(v) / f64::from(SPP)).collect();
    (0..N_LIGHTS).map(column).collect()
}

fn baked(scene: &Arc<PreparedScene>) -> Bake {
    let config = BakeConfig { spp: 2 * SPP, tolerance_db: 60.0, bounces: BOUNCES, seed: 2, ..BakeConfig::default() };
    pictures::baked(scene, FILM, config)
}

/// Whether a pixel or one beside it shows a texel itself.
fn shows_lights(halves: &[Vec<Vec<f64>>; 2]) -> Vec<bool> {
    let (width, height) = (FILM.width as usize, FILM.height as usize);
    let lit = |x: usize, y: usize| halves.iter().flatten().any(|rows| rows[(y * width + x) * CHANNELS].is_nan());
    let near = |at: usize, end: usize| at.saturating_sub(1)..(at + 2).min(end);
    let shows = |x: usize, y: usize| near(y, height).any(|y| near(x, width).any(|x| lit(x, y)));
    (0..width * height).map(|pixel| shows(pixel % width, pixel / width)).collect()
}

/// Mean square over the entries of the columns by which ranks are off, of the block of a bake in which each tile lies.
fn truncated(bake: &Bake) -> Vec<f64> {
    let (group, width) = (&bake.groups[0], FILM.width as usize / TILE);
    let (side, across) = (group.partition.tile as usize, group.partition.tiles_x() as usize);
    let of_tile = |tile: usize| {
        let block = tile / width * TILE / side * across + tile % width * TILE / side;
        f64::from(group.blocks[block].as_ref().expect("a bake is whole").error.truncation.max(0.0))
    };
    (0..FILM.n_pixels() / (TILE * TILE)).map(of_tile).collect()
}

/// Sums over tiles of pixels.
fn of_tiles(pixels: &[f64]) -> Vec<f64> {
    let width = FILM.width as usize;
    let mut sums = vec![0.0; pixels.len() / (TILE * TILE)];
    for (index, value) in pixels.iter().enumerate() {
        sums[index / width / TILE * (width / TILE) + index % width / TILE] += value;
    }
    sums
}

/// One channel of a column against its reference, as it is sampled and as it is baked; 0 in pixels that are left out.
struct Channel {
    /// Of the mean of two halves, and of a bake's factors.
    differences: [Vec<f64>; 2],
    /// Variance of each pixel's difference, by noise.
    variance: Vec<f64>,
    /// Mean of the reference over pixels.
    mean: f64,
}

impl Channel {
    /// Of rows of two halves, of the reference and of a bake.
    fn new(rows: [&[f64]; 4], left_out: &[bool], channel: usize) -> Channel {
        let n_pixels = FILM.n_pixels();
        let zeros = || vec![0.0; n_pixels];
        let mut found = Channel { differences: [zeros(), zeros()], variance: zeros(), mean: 0.0 };
        for pixel in (0..n_pixels).filter(|&pixel| !left_out[pixel]) {
            let [a, b, reference, baked] = rows.map(|rows| rows[pixel * CHANNELS + channel]);
            let own = (a - b).powi(2) / 4.0;
            let theirs = (own * f64::from(2 * SPP) / REFERENCE_SPP).max((REFERENCE_NOISE * reference).powi(2));
            found.variance[pixel] = own + theirs;
            found.differences[0][pixel] = 0.5 * (a + b) - reference;
            found.differences[1][pixel] = baked - reference;
            found.mean += reference / n_pixels as f64;
        }
        found
    }

    /// By how much the means differ, sampled and baked, and the standard error of either.
    fn bias(&self) -> ([f64; 2], f64) {
        let n = self.variance.len() as f64;
        let mean = |differences: &Vec<f64>| differences.iter().sum::<f64>() / n;
        (self.differences.each_ref().map(mean), self.variance.iter().sum::<f64>().sqrt() / n)
    }

    /// z of each tile, sampled and baked. What ranks leave out (mean squares, tile by tile) may be alike in all pixels of a tile, so there its
    /// squares are not divided by their number. A bake has as many samples as both halves together.
    fn z(&self, truncated: &[f64]) -> [Vec<f64>; 2] {
        let noise = of_tiles(&self.variance);
        let n = (TILE * TILE) as f64;
        [0, 1].map(|way| {
            let tiles = of_tiles(&self.differences[way]).into_iter().zip(noise.iter().zip(truncated));
            let variance = |(noise, truncated): (&f64, &f64)| noise + way as f64 * n * n * truncated;
            tiles.map(|(sum, both)| sum / variance(both).max(f64::MIN_POSITIVE).sqrt()).collect()
        })
    }
}

#[test]
fn every_texels_column_is_that_of_another_renderer() {
    let [glb, npz] =
        ["cornell-texels.glb", "cornell-texels-matrix.npz"].map(|file| at_hand::file(&format!("references/{file}")));
    let (Some(glb), Some(npz)) = (glb, npz) else { return };
    let imported = import::load(&glb).expect("a valid scene");
    let scene = Arc::new(PreparedScene::new(imported.scene, &[]).expect("valid lights").0);
    let reference = reference(&std::fs::read(npz).expect("a readable file"), &scene);
    let halves = [Half::A, Half::B].map(|half| sampled(&scene, half));
    let (left_out, bake) = (shows_lights(&halves), baked(&scene));
    let truncated = truncated(&bake);
    let (mut z, mut worst): ([Vec<f64>; 2], [f64; 2]) = Default::default();
    // Of all columns: by how much they differ, sampled and baked, and what they are.
    let mut sums = [[0.0; 3]; CHANNELS];
    for column in 0..N_LIGHTS {
        let scale = bake.header.column_scale[column];
        let mut unit = vec![0.0; N_LIGHTS];
        unit[column] = 1.0 / scale;
        let factors: Vec<f64> = bake.groups[0].apply(&unit).into_iter().map(f64::from).collect();
        let of_column: Vec<f64> = truncated.iter().map(|square| square / f64::from(scale).powi(2)).collect();
        for (channel, sums) in sums.iter_mut().enumerate() {
            let rows = [&halves[0][column], &halves[1][column], &reference[column], &factors];
            let found = Channel::new(rows.map(Vec::as_slice), &left_out, channel);
            let ([sampled, baked], error) = found.bias();
            let (allowed, of) = (MEAN_TOLERANCE * found.mean + 4.0 * error, found.mean);
            let told = format!(
                "column {column}, channel {channel}: {sampled:+.2e} sampled, {baked:+.2e} baked of {of:.2e} ± {error:.1e}"
            );
            println!("{told}");
            assert!(sampled.abs() < allowed && baked.abs() < allowed, "{told}");
            worst = [worst[0].max(sampled.abs() / of), worst[1].max(baked.abs() / of)];
            sums.iter_mut().zip([sampled, baked, of]).for_each(|(sum, found)| *sum += found);
            z.iter_mut().zip(found.z(&of_column)).for_each(|(z, found)| z.extend(found));
        }
    }
    println!("worst means {worst:?} (sampled, baked)");
    for (channel, [sampled, baked, of]) in sums.into_iter().enumerate() {
        let [sampled, baked] = [sampled, baked].map(|off| off / of);
        let told = format!("all columns, channel {channel}: off by {sampled:+.5} sampled, {baked:+.5} baked");
        println!("{told}");
        assert!(sampled.abs().max(baked.abs()) <= MEAN_TOLERANCE, "{told}: more than {MEAN_TOLERANCE}");
    }
    for (z, way) in z.iter().zip(["sampled", "baked"]) {
        let share = z.iter().filter(|z| z.abs() <= Z_MAX).count() as f64 / z.len() as f64;
        let spread = (z.iter().map(|z| z * z).sum::<f64>() / z.len() as f64).sqrt();
        let told = format!("{way}: blocks within {share:.4}, spread of z {spread:.3}");
        println!("{told}");
        assert!(share >= SHARE, "{told}: {SHARE} of them have to be within {Z_MAX}");
        assert!(spread <= MOST_SPREAD, "{told}: more than {MOST_SPREAD}");
        assert!(way == "baked" || spread >= LEAST_SPREAD, "{told}: less than {LEAST_SPREAD}");
    }
}
