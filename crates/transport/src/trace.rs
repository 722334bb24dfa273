//! Plain path tracing of one picture without a matrix: the reference.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use glam::Vec3;
use rayon::prelude::*;

use crate::camera::{Camera, Film};
use crate::empty::EmptyPixels;
use crate::path::{Deposit, Integrator, Scratch};
use crate::plan::PicturePlan;
use crate::prepared::PreparedScene;
use crate::reach::dark_sources;
use crate::sampler::Sampler;
use crate::skips::Skip;

/// How a picture is traced.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TraceConfig {
    /// Samples per pixel.
    pub spp: u32,
    /// Scattering events beyond the first; `None` leaves the end to roulette.
    pub bounces: Option<u32>,
    /// Same seed, same picture.
    pub seed: u64,
}

/// A sum of radiance under given coefficients.
pub(crate) struct PictureDeposit<'a> {
    pub coefficients: &'a [[f32; 3]],
    pub sum: Vec3,
}

impl Deposit for PictureDeposit<'_> {
    fn scattered(&mut self, column: u32, value: Vec3) {
        self.sum += value * Vec3::from(self.coefficients[column as usize]);
    }

    fn seen(&mut self, column: u32, value: Vec3) {
        self.scattered(column, value);
    }
}

/// Linear radiance in nit, row-major from the top left; `None` when `progress` (0…1) asked to stop.
///
/// `coefficients` holds one RGB value per column of the scene's basis.
pub fn trace(
    scene: &PreparedScene,
    camera: &Camera,
    film: Film,
    coefficients: &[[f32; 3]],
    config: &TraceConfig,
    progress: &(dyn Fn(f32) -> ControlFlow<()> + Sync),
) -> Option<Vec<[f32; 3]>> {
    assert_eq!(coefficients.len(), scene.lighting.basis.n_cols(), "one coefficient per column");
    let plan = PicturePlan::new(&scene.lighting, &lit(scene, camera, coefficients), scene.diameter());
    let look_for_empty = scene.skips.has(Skip::EmptyPixels);
    let empty = look_for_empty.then(|| EmptyPixels::find(&scene.scene.mesh, camera, film)).flatten();
    let integrator = Integrator::new(scene, &plan, config.bounces);
    let (stopped, done) = (AtomicBool::new(false), AtomicUsize::new(0));
    let mut pixels = vec![[0.0; 3]; film.n_pixels()];
    pixels.par_chunks_mut(film.width as usize).enumerate().for_each_init(Scratch::default, |scratch, (y, row)| {
        for (x, pixel) in row.iter_mut().enumerate() {
            if stopped.load(Ordering::Relaxed) {
                return;
            }
            let index = y * film.width as usize + x;
            let is_empty = empty.as_ref().is_some_and(|empty| empty.contains(index));
            // Partial sums keep the sum of many samples as exact as that of few.
            let mut total = glam::DVec3::ZERO;
            for sample in 0..config.spp {
                let mut deposit = PictureDeposit { coefficients, sum: Vec3::ZERO };
                let (sampler, at) = (Sampler::new(config.seed, index as u64, sample), [x as u32, y as u32]);
                if is_empty {
                    integrator.sample_empty_pixel(camera, film, at, sampler, &mut deposit);
                } else {
                    integrator.sample_pixel(camera, film, at, sampler, scratch, &mut deposit);
                }
                total += deposit.sum.as_dvec3();
            }
            *pixel = (total / f64::from(config.spp.max(1))).as_vec3().to_array();
        }
        let rows = done.fetch_add(1, Ordering::Relaxed) + 1;
        if progress(rows as f32 / film.height as f32).is_break() {
            stopped.store(true, Ordering::Relaxed);
        }
    });
    (!stopped.into_inner()).then_some(pixels)
}

/// The coefficients of the columns that can light what is seen.
fn lit(scene: &PreparedScene, camera: &Camera, coefficients: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let mut lit = coefficients.to_vec();
    for source in dark_sources(scene, camera.position()) {
        let columns = &scene.lighting.basis.sources[source as usize].columns;
        lit[columns.start as usize..columns.end as usize].fill([0.0; 3]);
    }
    lit
}
