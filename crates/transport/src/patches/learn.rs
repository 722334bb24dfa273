//! From a scene and a camera to patches and their columns.

use std::f32::consts::FRAC_1_PI;
use std::sync::Arc;

use glam::{Vec2, Vec3};
use half::bf16;
use rayon::prelude::*;

use super::cluster::{Met, cluster};
use super::exchange::{Exchange, Row};
use super::layout::{self, Layout};
use super::modes::Modes;
use super::nearest::Nearest;
use super::response::grazing;
use super::trials::{Trial, irradiance};
use super::{Body, PatchSample, Patches};
use crate::bake::focus::Focus;
use crate::camera::{Camera, Film};
use crate::light::luminance;
use crate::path::{Integrator, NoLights, Onward};
use crate::prepared::PreparedScene;
use crate::sampler::Sampler;
use crate::streams::Stream;

/// Light on patches, for each column: numbers of eight significant bits, whose rounding is 56 dB below the light and of another sign
/// from patch to patch. The table is read from far away, a row of it for each walk.
#[derive(Debug)]
pub(crate) struct Table {
    pub n_columns: usize,
    /// See [`Request::narrow_alpha`].
    pub narrow_alpha: f32,
    pub(super) nearest: Arc<Nearest>,
    /// Patches × columns: irradiance straight from lamps.
    pub straight: Vec<bf16>,
    /// Patches × channels × columns: all irradiance.
    pub all: Vec<bf16>,
}

/// What is asked for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Request {
    pub n_patches: u32,
    pub bounces: Option<u32>,
    pub seed: u64,
    /// Lobes of the first surface of a pixel up to this width α do not show light straight from lamps: it is found anew.
    pub narrow_alpha: f32,
}

/// Lamps that are learned from: for each patch, fewest, and most.
const LEARNED_PER_PATCH: f32 = 0.5;
const LEARNED: [usize; 2] = [64, 1536];
/// Lamps that tell how well the columns do.
const HELD_OUT: usize = 64;
/// Pixels whose walks find patches, and walks of each, for each patch asked for.
const SCOUTS: usize = 2048;
const POINTS_PER_PATCH: usize = 16;
/// Surfaces that such a walk meets.
const DEPTH: u32 = 4;
/// Pixels that the pictures of the lamps have, their samples and walks of each.
const PIXELS: usize = 2048;
const PIXEL_SAMPLES: u32 = 32;
const PIXEL_SPLITS: u32 = 8;
/// Share of what is seen that a right angle between normals counts as.
const REACH: f32 = 0.1;
/// Share of that distance within which a lamp's light grows no more.
const NEAR: f32 = 0.03;
/// Least radius of a patch in distances to those around it; where patches are even it is half a distance.
const LEAST_SPACING: f32 = 0.25;
/// Streams of random numbers that nobody else uses.
const SCOUT_STREAM: u64 = Stream::PatchScouts.first();
const EXCHANGE_STREAM: u64 = Stream::PatchExchange.first();
const PIXEL_STREAM: u64 = Stream::PatchPixels.first();
const TRIAL_STREAM: u64 = Stream::PatchTrials.first();

/// What walks of the camera met.
#[derive(Default)]
struct Scouted {
    met: Vec<Met>,
    /// Stretches of open space that they passed.
    stretches: Vec<[Vec3; 2]>,
}

/// Finds the patches of a scene that a camera sees; `None` where no walk meets a second surface, or nobody wants to know any more.
pub(crate) fn learn(
    scene: &PreparedScene,
    camera: &Camera,
    film: Film,
    request: Request,
    focus: &Focus,
) -> Option<Patches> {
    let integrator = Integrator::new(scene, &NoLights, request.bounces).watched(focus);
    let Scouted { met, stretches } = scout(&integrator, (camera, film), request);
    if met.is_empty() || focus.is_left() {
        return None;
    }
    let low = met.iter().fold(Vec3::INFINITY, |low, met| low.min(met.position));
    let high = met.iter().fold(Vec3::NEG_INFINITY, |high, met| high.max(met.position));
    let reach_m = REACH * (high - low).length().max(f32::MIN_POSITIVE);
    let sight = |a: &Met, b: &Met, radius_m: f32| {
        layout::are_in_sight(scene, [a, b].map(|met| (met.position, met.normal)), radius_m)
    };
    let (centers, mut samples, first) = cluster(&met, request.n_patches as usize, reach_m, &sight);
    let nearest = Arc::new(Nearest::new(centers, reach_m));
    widen((&mut samples, &first), &nearest);
    let samples_of = |patch: u32| &samples[first[patch as usize] as usize..first[patch as usize + 1] as usize];
    layout::hide(scene, &nearest, samples_of);
    let layout = Layout::measured(scene, nearest.clone(), (&samples, &first));
    let origins: Vec<Vec<(Vec3, Vec3)>> = first
        .windows(2)
        .map(|w| samples[w[0] as usize..w[1] as usize].iter().map(|s| (s.position, s.normal)).collect())
        .collect();
    let exchange = Exchange::find(&integrator, &nearest, &origins, (request.seed, EXCHANGE_STREAM));
    let pixels = pixel_rows(&integrator, (camera, film), &nearest, request);
    if focus.is_left() {
        return None;
    }
    let n_learned = (LEARNED_PER_PATCH * request.n_patches as f32) as usize;
    let n_learned = n_learned.clamp(LEARNED[0], LEARNED[1]);
    let trials: Vec<Trial> = (0..(n_learned + HELD_OUT) as u32)
        .map(|nth| Trial::draw(&stretches, &met, &mut Sampler::new(request.seed, TRIAL_STREAM, nth)))
        .collect();
    let near_m = NEAR * reach_m;
    let of_lamps = irradiance(scene, &trials, (&samples, &first), near_m);
    let modes = Modes::find(&exchange, &pixels, of_lamps, [n_learned, trials.len()])?;
    let narrow_alpha = request.narrow_alpha;
    let table = Table {
        n_columns: modes.n_columns,
        narrow_alpha,
        nearest,
        all: halved(&modes.all(&exchange)),
        straight: halved(&modes.mixtures),
    };
    let body = Body { samples, first, shares: modes.shares, layout: Some(layout), table: Some(table) };
    Some(Patches {
        n_patches: body.first.len() as u32 - 1,
        n_samples: body.samples.len() as u32,
        n_columns: modes.n_columns as u32,
        held_out_error: modes.held_out_error,
        narrow_alpha,
        knows_grazing: true,
        reach_m,
        body: Arc::new(body),
    })
}

/// The same numbers in half of the room.
pub(super) fn halved(numbers: &[f32]) -> Vec<bf16> {
    numbers.par_iter().map(|x| bf16::from_f32(*x)).collect()
}

/// Patches of few points are smaller by these than what they stand for.
fn widen((samples, first): (&mut [PatchSample], &[u32]), nearest: &Nearest) {
    for (patch, w) in first.windows(2).enumerate() {
        let (own, spacing_m) = (&mut samples[w[0] as usize..w[1] as usize], nearest.spacing_m(patch));
        let least_m = LEAST_SPACING * spacing_m / (own.len() as f32).sqrt();
        if least_m.is_finite() {
            own.iter_mut().for_each(|sample| sample.radius_m = sample.radius_m.max(least_m));
        }
    }
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
            integrator.land_from_camera(ray, (1, request.narrow_alpha), &mut sampler, &mut |landing, _| {
                depth += 1;
                let albedo = landing.shares.base + landing.shares.narrow + landing.shares.behind;
                let weight = luminance(landing.throughput * albedo);
                if depth <= DEPTH && weight > 0.0 && weight.is_finite() {
                    let outward = landing.hit.outward(landing.normal);
                    let position = landing.hit.origin(outward);
                    let grazing = grazing(integrator.scene(), landing.hit, landing.normal);
                    scouted.met.push(Met { position, normal: landing.normal, weight, grazing });
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
pub(super) fn ray(camera: &Camera, film: Film, pixel: u32, sampler: &mut Sampler) -> (Vec3, Vec3) {
    let corner = Vec2::new((pixel % film.width) as f32, (pixel / film.width) as f32);
    (camera.position(), camera.direction(film, corner + Vec2::from(sampler.next_2d())))
}

/// What some pixels take of the light of patches.
fn pixel_rows(
    integrator: &Integrator<'_, NoLights>,
    (camera, film): (&Camera, Film),
    nearest: &Nearest,
    Request { seed, narrow_alpha, .. }: Request,
) -> Vec<Row> {
    let n_pixels = film.n_pixels();
    let n_rows = n_pixels.min(PIXELS);
    let of_pixel = |nth: usize| {
        let (mut row, pixel) = (Row::default(), (nth * n_pixels / n_rows) as u32);
        for sample in 0..PIXEL_SAMPLES {
            let mut sampler = Sampler::new(seed, PIXEL_STREAM + u64::from(pixel), sample);
            let ray = ray(camera, film, pixel, &mut sampler);
            integrator.land_from_camera(ray, (PIXEL_SPLITS, narrow_alpha), &mut sampler, &mut |landing, sampler| {
                row.land(nearest, landing, sampler)
            });
        }
        // A sum over samples of the camera, of means over their walks; and irradiance over π is radiance.
        row.finish(PIXEL_SAMPLES as f32 / FRAC_1_PI);
        row
    };
    (0..n_rows).into_par_iter().map(of_pixel).collect()
}
