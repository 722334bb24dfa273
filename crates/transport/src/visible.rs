//! What each pixel sees, kept, so that lamps which come and go light it at once.
//!
//! Every sample of a pixel is followed in mirrors, through clear panes and smooth glass to the surfaces that scatter
//! broadly. These are kept in 64 bytes each, so that the direct light of a lamp is a product of scattering, the lamp's light and
//! a shadow ray. A pass shades one sample of every pixel with one point of every lamp: a whole picture. The mean of passes
//! has soft shadows and smooth edges.
//!
//! Shadow rays run from the lamp to sixteen neighbors at once; which point of a lamp they share differs from neighbor to
//! neighbor of their own pixels, so that a soft shadow is dithered \[Keller2001\].
//!
//! What counts is light that was scattered broadly once, or not at all: the body of a lamp where it is seen. Where patches leave it
//! out, so does light that was scattered once more, by a narrow lobe of the first surface: one direction of each sample.

mod bodies;
mod first;
mod follow;
mod point;
mod shade;
mod words;

use std::sync::atomic::{AtomicU64, Ordering};

use glam::Vec3;
use rayon::prelude::*;

use self::follow::{Found, Trail};
pub use self::words::SampleWords;
use crate::camera::{Camera, Film};
use crate::lamps::PreparedLamps;
use crate::prepared::PreparedScene;
use crate::sampler::Sampler;
use crate::stop::Halt;
use crate::streams::Stream;

/// How pixels are looked at.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VisibleConfig {
    /// Samples of each pixel, at least 1: passes take them in turn.
    pub samples: u32,
    /// Same seed, same samples.
    pub seed: u64,
    /// Number of the first sample: those of one seed are stratified together, whoever looks at them.
    pub first: u32,
    /// Widest lobe α whose direction is followed to the next surface, whose light straight from lamps then counts as well:
    /// what patches leave out, [`crate::patches::Patches::narrow_alpha`]. 0 for none.
    pub narrow_alpha: f32,
    /// Most bounces of what counts, as [`BakeConfig::bounces`](crate::bake::BakeConfig::bounces) has them: mirrors and faces of solid glass
    /// before a surface, and between it and a lamp, are some. `None` for no limit.
    pub bounces: Option<u32>,
}

/// The surfaces that a camera sees.
pub struct VisiblePoints {
    camera: Camera,
    film: Film,
    config: VisibleConfig,
    /// Sample × band of the film.
    bands: Vec<Vec<Band>>,
    n_rays: AtomicU64,
}

/// What some rows of pixels see in one of their samples.
struct Band {
    found: Found,
    /// Where the points of each tile begin, and the number of points.
    tiles: Vec<u32>,
    /// Distance to the first surface, m, by pixel of the band.
    reach: Vec<f32>,
}

/// Rows of a band and side of a tile, pixels.
const TILE: u32 = 16;
/// Streams of random numbers that nobody else uses.
const STREAM: u64 = Stream::Visible.first();

impl VisiblePoints {
    /// Looks at every pixel; `None` when `stop` asked to, which is asked tile by tile.
    pub fn new(
        scene: &PreparedScene,
        camera: &Camera,
        film: Film,
        config: VisibleConfig,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Option<VisiblePoints> {
        let (halt, n_bands) = (Halt::new(stop), film.height.div_ceil(TILE));
        let look = |sample: u32| -> Option<Vec<Band>> {
            let look = |band| Band::look(scene, (camera, film), config, (config.first + sample, band), &halt);
            (0..n_bands).into_par_iter().map(look).collect()
        };
        let bands: Vec<Vec<Band>> = (0..config.samples.max(1)).map(look).collect::<Option<_>>()?;
        let n_rays = bands.iter().flatten().map(|band| band.found.n_rays).sum::<u64>();
        let (camera, n_rays) = (camera.clone(), AtomicU64::new(n_rays));
        Some(VisiblePoints { camera, film, config, bands, n_rays })
    }

    /// Memory of what is kept, bytes: more where mirrors, panes and narrow lobes show further surfaces.
    pub fn n_bytes(&self) -> usize {
        self.bands.iter().flatten().map(Band::n_bytes).sum()
    }

    /// Rays that were followed so far, those of the camera and to lamps.
    pub fn n_rays(&self) -> u64 {
        self.n_rays.load(Ordering::Relaxed)
    }

    /// Direct light of the lamps, and their bodies, nit per channel, row-major from the top left; `None` when `stop` asked
    /// to. Every pass is a whole picture, and passes from 0 on average to what it has to be.
    pub fn direct(
        &self,
        scene: &PreparedScene,
        lamps: &PreparedLamps,
        pass: u32,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Option<Vec<[f32; 3]>> {
        self.complete(scene, lamps, pass, vec![Vec3::ZERO; self.film.n_pixels()], |_| true, stop)
    }

    /// Adds what lacks of a pass: the light at pixels that are wanted, and the bodies at all of them.
    fn complete(
        &self,
        scene: &PreparedScene,
        lamps: &PreparedLamps,
        pass: u32,
        mut pixels: Vec<Vec3>,
        is_wanted: impl Fn(u32) -> bool + Sync,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Option<Vec<[f32; 3]>> {
        let (sample, round) = self.turn(pass);
        let (halt, rows) = (Halt::new(stop), TILE * self.film.width);
        let views = bodies::views(lamps, &self.camera, self.film);
        let bands = pixels.par_chunks_mut(rows as usize).zip(&self.bands[sample as usize]).enumerate();
        bands.for_each(|(nth, (pixels, band))| {
            let shading = shade::Shading::new(scene, lamps);
            let key = (nth as u32 * rows, self.config.seed, [self.config.first + sample, round]);
            let n_rays = shading.shade(band, key, (&is_wanted, &halt), pixels);
            self.n_rays.fetch_add(n_rays, Ordering::Relaxed);
            self.show_bodies(lamps, &views, (nth as u32, self.config.first + sample), band, pixels);
        });
        (!halt.was_called()).then(|| pixels.into_iter().map(|rgb| rgb.to_array()).collect())
    }

    /// Sample and round of a pass.
    fn turn(&self, pass: u32) -> (u32, u32) {
        let n_samples = self.bands.len() as u32;
        (pass % n_samples, pass / n_samples)
    }
}

impl Band {
    fn n_bytes(&self) -> usize {
        self.found.n_bytes() + (self.tiles.capacity() + self.reach.capacity()) * size_of::<u32>()
    }

    fn look(
        scene: &PreparedScene,
        (camera, film): (&Camera, Film),
        VisibleConfig { seed, narrow_alpha, bounces, .. }: VisibleConfig,
        (sample, band): (u32, u32),
        halt: &Halt,
    ) -> Option<Band> {
        let (top, bottom) = (band * TILE, ((band + 1) * TILE).min(film.height));
        let mut reach = vec![f32::INFINITY; (film.width * (bottom - top)) as usize];
        let (mut found, mut tiles, mut firsts) = (Found::default(), Vec::new(), Vec::new());
        for left in (0..film.width).step_by(TILE as usize) {
            if halt.is_called() {
                return None;
            }
            tiles.push(found.points.len() as u32);
            first::look(scene, (camera, film), (seed, sample), [left, top], &mut firsts);
            for [x, y] in in_tile() {
                let Some(first) = firsts[(y * TILE + x) as usize].take() else { continue };
                let pixel = (top + y) * film.width + left + x;
                let trail = Trail::from_camera(camera.position(), first.direction);
                reach[(pixel - top * film.width) as usize] = first.hit.map_or(f32::INFINITY, |hit| hit.t);
                let limits = (scene, narrow_alpha, bounces.unwrap_or(u32::MAX));
                found.follow(limits, (trail, first.hit), pixel, first.sampler);
            }
            // Neighbors see neighbors, which share fans of rays; what narrow lobes show lies elsewhere.
            found.points.append(&mut found.shown);
        }
        tiles.push(found.points.len() as u32);
        found.points.shrink_to_fit();
        found.shown = Vec::new();
        Some(Band { found, tiles, reach })
    }
}

/// Random numbers of a sample of a pixel; the first two are its place in the pixel's square.
fn sampler_of(seed: u64, pixel: u32, sample: u32) -> Sampler {
    Sampler::new(seed, STREAM + u64::from(pixel), sample)
}

/// The pixels of a tile: those whose places differ by multiples of four, then the next ones.
fn in_tile() -> impl Iterator<Item = [u32; 2]> {
    (0..16u32).flat_map(|class| (0..16u32).map(move |nth| [class % 4 + nth % 4 * 4, class / 4 + nth / 4 * 4]))
}

#[cfg(test)]
mod tests;
