//! From a scene and a camera to patches, and to the combinations of their light that the columns are pictures of.
//!
//! Let T be what a few pixels take of the irradiance of all patches, by all ways, and Φ the irradiance that some hundred
//! lamps throw on the patches. The pictures TΦ have the singular values Σ, and few of them matter. With V the strongest
//! right vectors, the columns are the pictures of the mixtures R = ΦV, and the coefficients of any light e are those by
//! which these pictures come nearest to that of e in the few pixels, Q = (TR)⁺T. So what the columns leave out of a light is
//! what the pixels do not notice: the balanced truncation of a linear system. \[Rowley2005\]

use std::f32::consts::FRAC_1_PI;
use std::sync::Arc;

use clerestory_nystrom::spectrum::largest_eigenpairs;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::cluster::{Met, cluster};
use super::codec::rounded;
use super::exchange::{Exchange, Row, Tint, taken};
use super::nearest::Nearest;
use super::trials::{Trial, irradiance};
use super::{Body, Patches};
use crate::camera::{Camera, Film};
use crate::light::luminance;
use crate::matrix::CHANNELS;
use crate::path::{Integrator, NoLights, Onward};
use crate::prepared::PreparedScene;
use crate::sampler::Sampler;

/// Light on patches, for each column.
#[derive(Debug)]
pub(crate) struct Table {
    pub n_columns: usize,
    pub(super) nearest: Nearest,
    /// Patches × columns: irradiance straight from lamps.
    pub straight: Vec<f32>,
    /// Patches × channels × columns: all irradiance.
    pub all: Vec<f32>,
}

/// What is asked for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Request {
    pub n_patches: u32,
    pub bounces: Option<u32>,
    pub seed: u64,
}

/// Columns at most.
const COLUMNS: usize = 192;
/// Lamps that are learned from, and others that tell how well.
const LEARNED: usize = 512;
const HELD_OUT: usize = 64;
/// Pixels whose walks find patches, and walks of each, for each patch asked for.
const SCOUTS: usize = 2048;
const POINTS_PER_PATCH: usize = 16;
/// Surfaces that such a walk meets.
const DEPTH: u32 = 4;
/// Pixels that the pictures of the lamps have, their samples and walks of each.
const PIXELS: usize = 1536;
const PIXEL_SAMPLES: u32 = 32;
const PIXEL_SPLITS: u32 = 8;
/// Share of what is seen that a right angle between normals counts as.
const REACH: f32 = 0.1;
/// Share of that distance within which a lamp's light grows no more.
const NEAR: f32 = 0.03;
/// Share of the greatest eigenvalue below which there is nothing but rounding.
const FAINTEST: f64 = 1e-9;
/// Streams of random numbers that nobody else uses.
const SCOUT_STREAM: u64 = 10 << 58;
const EXCHANGE_STREAM: u64 = 11 << 58;
const PIXEL_STREAM: u64 = 12 << 58;
const TRIAL_STREAM: u64 = 13 << 58;

/// What walks of the camera met.
#[derive(Default)]
struct Scouted {
    met: Vec<Met>,
    /// Stretches of open space that they passed.
    stretches: Vec<[Vec3; 2]>,
}

/// Finds the patches of a scene that a camera sees; `None` where no walk meets a second surface.
pub(crate) fn learn(scene: &PreparedScene, camera: &Camera, film: Film, request: Request) -> Option<Patches> {
    let integrator = Integrator::new(scene, &NoLights, request.bounces);
    let Scouted { met, stretches } = scout(&integrator, (camera, film), request);
    if met.is_empty() {
        return None;
    }
    let low = met.iter().fold(Vec3::INFINITY, |low, met| low.min(met.position));
    let high = met.iter().fold(Vec3::NEG_INFINITY, |high, met| high.max(met.position));
    let reach_m = REACH * (high - low).length().max(f32::MIN_POSITIVE);
    let (centers, samples, first) = cluster(&met, request.n_patches as usize, reach_m);
    let nearest = Nearest::new(centers, reach_m);
    let origins: Vec<Vec<(Vec3, Vec3)>> = first
        .windows(2)
        .map(|w| samples[w[0] as usize..w[1] as usize].iter().map(|s| (s.position, s.normal)).collect())
        .collect();
    let exchange = Exchange::find(&integrator, &nearest, &origins, (request.seed, EXCHANGE_STREAM));
    let pixels = pixel_rows(&integrator, (camera, film), &nearest, request.seed);
    let trials: Vec<Trial> = (0..(LEARNED + HELD_OUT) as u32)
        .map(|nth| Trial::draw(&stretches, &met, &mut Sampler::new(request.seed, TRIAL_STREAM, nth)))
        .collect();
    let near_m = NEAR * reach_m;
    let of_lamps = irradiance(scene, &trials, (&samples, &first), near_m);
    let modes = Modes::find(&exchange, &pixels, of_lamps, trials.len())?;
    let table = Table { n_columns: modes.n_columns, nearest, all: modes.all(&exchange), straight: modes.mixtures };
    let body = Body { samples, first, shares: modes.shares, table: Some(table) };
    Some(Patches {
        n_patches: body.first.len() as u32 - 1,
        n_samples: body.samples.len() as u32,
        n_columns: modes.n_columns as u32,
        held_out_error: modes.held_out_error,
        body: Arc::new(body),
    })
}

/// Follows walks of the camera beyond the first surface.
fn scout(integrator: &Integrator<'_, NoLights>, (camera, film): (&Camera, Film), request: Request) -> Scouted {
    let n_pixels = film.n_pixels();
    let n_scouts = n_pixels.min(SCOUTS);
    let n_walks = (POINTS_PER_PATCH * request.n_patches as usize).div_ceil(2 * n_scouts).max(1) as u32;
    let follow = |nth: usize| {
        let mut scouted = Scouted::default();
        let pixel = (nth * n_pixels / n_scouts) as u32;
        for walk in 0..n_walks {
            let mut sampler = Sampler::new(request.seed, SCOUT_STREAM + u64::from(pixel), walk);
            let ray = ray(camera, film, pixel, &mut sampler);
            let mut depth = 0;
            integrator.land_from_camera(ray, 1, &mut sampler, &mut |landing, _| {
                depth += 1;
                let albedo = landing.shares.base + landing.shares.narrow + landing.shares.behind;
                let weight = luminance(landing.throughput * albedo);
                if depth <= DEPTH && weight > 0.0 && weight.is_finite() {
                    let outward = landing.hit.outward(landing.normal);
                    let position = landing.hit.origin(outward);
                    scouted.met.push(Met { position, normal: landing.normal, weight });
                    scouted.stretches.push([landing.from, position]);
                }
                Onward::All
            });
        }
        scouted
    };
    let parts: Vec<Scouted> = (0..n_scouts).into_par_iter().map(follow).collect();
    let mut all = Scouted::default();
    for mut part in parts {
        all.met.append(&mut part.met);
        all.stretches.append(&mut part.stretches);
    }
    all
}

/// A random point of a pixel, as a ray of the camera.
fn ray(camera: &Camera, film: Film, pixel: u32, sampler: &mut Sampler) -> (Vec3, Vec3) {
    let corner = Vec2::new((pixel % film.width) as f32, (pixel / film.width) as f32);
    (camera.position(), camera.direction(film, corner + Vec2::from(sampler.next_2d())))
}

/// What some pixels take of the light of patches.
fn pixel_rows(
    integrator: &Integrator<'_, NoLights>,
    (camera, film): (&Camera, Film),
    nearest: &Nearest,
    seed: u64,
) -> Vec<Row> {
    let n_pixels = film.n_pixels();
    let n_rows = n_pixels.min(PIXELS);
    let of_pixel = |nth: usize| {
        let (mut row, pixel) = (Row::default(), (nth * n_pixels / n_rows) as u32);
        for sample in 0..PIXEL_SAMPLES {
            let mut sampler = Sampler::new(seed, PIXEL_STREAM + u64::from(pixel), sample);
            let ray = ray(camera, film, pixel, &mut sampler);
            integrator.land_from_camera(ray, PIXEL_SPLITS, &mut sampler, &mut |landing, sampler| {
                row.land(nearest, landing, sampler)
            });
        }
        // A sum over samples of the camera, of means over their walks; and irradiance over π is radiance.
        row.finish(PIXEL_SAMPLES as f32 / FRAC_1_PI);
        row
    };
    (0..n_rows).into_par_iter().map(of_pixel).collect()
}

/// Mixtures of lamps that columns are pictures of.
struct Modes {
    n_columns: usize,
    /// Patches × columns: irradiance of the mixtures, straight from their lamps.
    mixtures: Vec<f32>,
    /// See [`Body::shares`].
    shares: Vec<f32>,
    held_out_error: f32,
}

impl Modes {
    /// `of_lamps` is patches × lamps, the last [`HELD_OUT`] of which are not learned from; `None` where no lamp lights anything.
    fn find(exchange: &Exchange, pixels: &[Row], mut of_lamps: Vec<f32>, n_lamps: usize) -> Option<Modes> {
        let (all, sweeps) = exchange.solve(&of_lamps, Tint::Gray);
        let mut pictures = taken(pixels, [&all, &of_lamps], n_lamps, Tint::Gray);
        drop(all);
        let scale = normalize(&mut pictures, n_lamps);
        of_lamps.par_chunks_mut(n_lamps).for_each(|row| row.iter_mut().zip(&scale).for_each(|(x, s)| *x *= s));
        let lit: Vec<usize> = (0..n_lamps).filter(|&lamp| scale[lamp] > 0.0).collect();
        let (learned, held_out): (Vec<usize>, Vec<usize>) = lit.into_iter().partition(|&lamp| lamp < LEARNED);
        let n = learned.len();
        let gram = gram(&pictures, n_lamps, &learned);
        let (mut values, vectors) = largest_eigenpairs(n, &gram, COLUMNS);
        values.retain(|value| *value > FAINTEST * values_sum(&gram, n));
        let n_columns = values.len();
        if n_columns == 0 {
            return None;
        }
        // So that the coefficients of a lamp that fills the picture with light 1 have a sum of squares of about 1.
        let size = (n_columns as f64 / n as f64).sqrt();
        let mut mix = vec![0.0f32; n_lamps * n_columns];
        for (nth, &lamp) in learned.iter().enumerate() {
            for k in 0..n_columns {
                mix[lamp * n_columns + k] = (vectors[k * n + nth] * size) as f32;
            }
        }
        let mixtures = product(&of_lamps, &mix, n_columns);
        let columns = product(&pictures, &mix, n_columns);
        // The pseudoinverse of the columns: they are orthogonal, each as long as the root of its value.
        let lengths: Vec<f32> = values.iter().map(|value| (value * size * size * pixels.len() as f64) as f32).collect();
        let inverse: Vec<f32> = columns.iter().zip(lengths.iter().cycle()).map(|(x, length)| x / length).collect();
        let n_patches = of_lamps.len() / n_lamps;
        let gathered =
            |of: fn(&Row) -> &Vec<super::exchange::Share>| gather(pixels, of, &inverse, n_columns, n_patches);
        let (known, straight) = (gathered(|row| &row.known), gathered(|row| &row.straight));
        let mut shares = exchange.solve_transposed([&known, &straight], sweeps, Tint::Gray);
        rounded(&mut shares, n_columns);
        let mut modes = Modes { n_columns, mixtures, shares, held_out_error: 0.0 };
        modes.held_out_error = modes.error_of(&held_out, (&of_lamps, &pictures, n_lamps), &columns);
        Some(modes)
    }

    /// Root mean square over lamps of the relative error of their pictures.
    fn error_of(
        &self,
        lamps: &[usize],
        (of_lamps, pictures, n_lamps): (&[f32], &[f32], usize),
        columns: &[f32],
    ) -> f32 {
        let k = self.n_columns;
        let error = |&lamp: &usize| {
            let mut c = vec![0.0f32; k];
            for (row, shares) in of_lamps.chunks_exact(n_lamps).zip(self.shares.chunks_exact(k)) {
                c.iter_mut().zip(shares).for_each(|(c, share)| *c += share * row[lamp]);
            }
            let [mut off, mut whole] = [0.0f64; 2];
            for (row, columns) in pictures.chunks_exact(n_lamps).zip(columns.chunks_exact(k)) {
                let found: f32 = columns.iter().zip(&c).map(|(x, c)| x * c).sum();
                off += f64::from(found - row[lamp]).powi(2);
                whole += f64::from(row[lamp]).powi(2);
            }
            off / whole
        };
        let errors: Vec<f64> = lamps.par_iter().map(error).collect();
        (errors.iter().sum::<f64>() / errors.len().max(1) as f64).sqrt() as f32
    }

    /// All irradiance of the mixtures: patches × channels × columns.
    fn all(&self, exchange: &Exchange) -> Vec<f32> {
        let k = self.n_columns;
        let mut all = vec![0.0; CHANNELS * self.mixtures.len()];
        for channel in 0..CHANNELS {
            let (solved, _) = exchange.solve(&self.mixtures, Tint::Channel(channel));
            for (out, row) in all.chunks_exact_mut(CHANNELS * k).zip(solved.chunks_exact(k)) {
                out[channel * k..(channel + 1) * k].copy_from_slice(row);
            }
        }
        all
    }
}

/// Brings each column to a root mean square of 1; what it was multiplied by, 0 where there is nothing.
fn normalize(pictures: &mut [f32], n_lamps: usize) -> Vec<f32> {
    let n_rows = pictures.len() / n_lamps;
    let mut squares = vec![0.0f64; n_lamps];
    for row in pictures.chunks_exact(n_lamps) {
        squares.iter_mut().zip(row).for_each(|(sum, x)| *sum += f64::from(*x).powi(2));
    }
    let scale = |&sum: &f64| {
        let scale = (sum / n_rows as f64).sqrt().recip() as f32;
        if scale.is_finite() { scale } else { 0.0 }
    };
    let scale: Vec<f32> = squares.iter().map(scale).collect();
    pictures.par_chunks_mut(n_lamps).for_each(|row| row.iter_mut().zip(&scale).for_each(|(x, s)| *x *= s));
    scale
}

/// Mean over pixels of the products of some lamps' pictures.
fn gram(pictures: &[f32], n_lamps: usize, lamps: &[usize]) -> Vec<f64> {
    let (n, n_rows) = (lamps.len(), pictures.len() / n_lamps);
    let columns: Vec<Vec<f32>> =
        lamps.iter().map(|&lamp| pictures.iter().skip(lamp).step_by(n_lamps).copied().collect()).collect();
    let mut gram = vec![0.0; n * n];
    gram.par_chunks_mut(n.max(1)).enumerate().for_each(|(a, row)| {
        for (b, out) in row.iter_mut().enumerate() {
            // Partial sums keep the sum exact.
            let parts = columns[a].chunks(256).zip(columns[b].chunks(256));
            let dot = |(x, y): (&[f32], &[f32])| f64::from(x.iter().zip(y).map(|(x, y)| x * y).sum::<f32>());
            *out = parts.map(dot).sum::<f64>() / n_rows as f64;
        }
    });
    gram
}

/// Sum of the eigenvalues of a matrix.
fn values_sum(gram: &[f64], n: usize) -> f64 {
    gram.iter().step_by(n + 1).sum()
}

/// Product of two row-major matrices, the second of `n_cols` columns.
fn product(a: &[f32], b: &[f32], n_cols: usize) -> Vec<f32> {
    let inner = b.len() / n_cols;
    let mut out = vec![0.0; a.len() / inner * n_cols];
    out.par_chunks_mut(n_cols).zip(a.par_chunks(inner)).for_each(|(out, a)| {
        for (a, b) in a.iter().zip(b.chunks_exact(n_cols)).filter(|(a, _)| **a != 0.0) {
            out.iter_mut().zip(b).for_each(|(out, b)| *out += a * b);
        }
    });
    out
}

/// The transpose of gray rows times a matrix of pixels × columns: patches × columns.
fn gather(
    pixels: &[Row],
    of: fn(&Row) -> &Vec<super::exchange::Share>,
    weights: &[f32],
    n_columns: usize,
    n_patches: usize,
) -> Vec<f32> {
    let mut out = vec![0.0; n_patches * n_columns];
    for (row, weights) in pixels.iter().zip(weights.chunks_exact(n_columns)) {
        for share in of(row) {
            let weight = Tint::Gray.of(share.weight);
            let out = &mut out[share.patch as usize * n_columns..][..n_columns];
            out.iter_mut().zip(weights).for_each(|(out, w)| *out += weight * w);
        }
    }
    out
}
