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

/// Samples of a pixel whose first rays go together.
const TOGETHER: usize = 16;

/// A sum of radiance under given coefficients.
#[derive(Clone, Copy)]
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
            let (at, mut total) = ([x as u32, y as u32], glam::DVec3::ZERO);
            for first in (0..config.spp).step_by(TOGETHER) {
                let n = TOGETHER.min((config.spp - first) as usize);
                let mut samplers = [Sampler::new(config.seed, index as u64, first); TOGETHER];
                for (nth, sampler) in (1..).zip(&mut samplers[1..n]) {
                    *sampler = Sampler::new(config.seed, index as u64, first + nth);
                }
                let mut deposits = [PictureDeposit { coefficients, sum: Vec3::ZERO }; TOGETHER];
                let (samplers, deposits) = (&mut samplers[..n], &mut deposits[..n]);
                if is_empty {
                    for (sampler, deposit) in samplers.iter().zip(deposits.iter_mut()) {
                        integrator.sample_empty_pixel(camera, film, at, *sampler, deposit);
                    }
                } else {
                    integrator.sample_pixel16(camera, film, at, samplers, scratch, deposits);
                }
                for deposit in deposits.iter() {
                    total += deposit.sum.as_dvec3();
                }
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

#[cfg(test)]
mod tests {
    use glam::Vec4;

    use super::*;
    use crate::laws::stage::{Stage, lambert, quad};
    use crate::light::LightRig;
    use crate::scene::{AlphaMode, Material};

    #[test]
    fn samples_that_are_traced_together_make_the_picture_of_each_alone() {
        let camera = Camera::look_at("eye", Vec3::new(0.0, 1.2, 3.0), Vec3::new(0.0, 0.6, 0.0), 0.8, 1.5);
        let floor = quad(Vec3::new(-3.0, 0.0, 3.0), Vec3::X * 6.0, Vec3::NEG_Z * 6.0);
        let sheet = quad(Vec3::new(-0.8, 0.2, 0.9), Vec3::X * 1.2, Vec3::Y * 1.2);
        let leaf = Material { base_color: Vec4::new(0.4, 0.6, 0.2, 0.5), alpha: AlphaMode::Blend, ..lambert(0.5, 0.0) };
        let stage = Stage::new(camera).surface("floor", &floor, lambert(0.5, 0.0)).surface("leaf", &sheet, leaf);
        let scene = stage.lamp("lamp", Vec3::new(0.0, 2.0, 0.5), 100.0).prepared();
        let (camera, film) = (&scene.scene.cameras[0], Film { width: 12, height: 8 });
        let coefficients = scene.lighting.basis.project(&LightRig::default());
        let config = TraceConfig { spp: 19, bounces: Some(2), seed: 5 };
        let go_on = |_| ControlFlow::Continue(());
        let picture = trace(&scene, camera, film, &coefficients, &config, &go_on).expect("nobody stops it");

        let plan = PicturePlan::new(&scene.lighting, &lit(&scene, camera, &coefficients), scene.diameter());
        let integrator = Integrator::new(&scene, &plan, config.bounces);
        let mut scratch = Scratch::default();
        for (index, pixel) in picture.iter().enumerate() {
            let (at, mut total) = ([index as u32 % film.width, index as u32 / film.width], glam::DVec3::ZERO);
            for sample in 0..config.spp {
                let mut deposit = PictureDeposit { coefficients: &coefficients, sum: Vec3::ZERO };
                let sampler = Sampler::new(config.seed, index as u64, sample);
                integrator.sample_pixel(camera, film, at, sampler, &mut scratch, &mut deposit);
                total += deposit.sum.as_dvec3();
            }
            assert_eq!(*pixel, (total / f64::from(config.spp)).as_vec3().to_array(), "pixel {index}");
        }
        assert!(picture.as_flattened().iter().any(|&value| value > 0.0), "something is lit");
    }
}
