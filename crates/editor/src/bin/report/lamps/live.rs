//! The live light of lamps with as many samples as a reference has.

use anyhow::{Context, Result};
use clerestory_transport::camera::{Camera, Film};
use clerestory_transport::lamps::PreparedLamps;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::visible::{VisibleConfig, VisiblePoints};
use rayon::prelude::*;

/// Samples of a pixel that are kept at once.
const CHUNK: u32 = 64;

/// What is looked at, and with how many samples of a pixel.
#[derive(Clone, Copy)]
pub struct View<'a> {
    pub scene: &'a PreparedScene,
    pub camera: &'a Camera,
    pub film: Film,
    pub n_samples: u32,
}

impl View<'_> {
    /// The light of each of some lamps, nit; all of them at the same points.
    ///
    /// # Errors
    /// None that is known: only who asks for a stop gets no light.
    pub fn live(&self, lamps: &[&PreparedLamps], seed: u64, narrow_alpha: f32) -> Result<Vec<Vec<f32>>> {
        let firsts: Vec<u32> = (0..self.n_samples).step_by(CHUNK as usize).collect();
        let config = |first: u32| VisibleConfig { seed, narrow_alpha, first, ..VisibleConfig::default() };
        let chunk = |first: &u32| self.chunk(lamps, config(*first));
        let chunks: Vec<Vec<Vec<f64>>> = firsts.par_iter().map(chunk).collect::<Result<_>>()?;
        let mean = |nth: usize| {
            let of_pixel = |at: usize| chunks.iter().map(|chunk| chunk[nth][at]).sum::<f64>();
            (0..3 * self.film.n_pixels()).map(|at| (of_pixel(at) / f64::from(self.n_samples)) as f32).collect()
        };
        Ok((0..lamps.len()).map(mean).collect())
    }

    /// The sum over the samples from `first` on, of each lamp.
    fn chunk(&self, lamps: &[&PreparedLamps], config: VisibleConfig) -> Result<Vec<Vec<f64>>> {
        let samples = CHUNK.min(self.n_samples - config.first);
        let config = VisibleConfig { samples, ..config };
        let points = VisiblePoints::new(self.scene, self.camera, self.film, config, &|| false);
        let points = points.context("nobody stopped it")?;
        let of_lamp = |lamps: &&PreparedLamps| {
            let mut sum = vec![0.0; 3 * self.film.n_pixels()];
            for pass in 0..samples {
                let picture = points.direct(self.scene, lamps, pass, &|| false).context("nobody stopped it")?;
                sum.iter_mut().zip(picture.as_flattened()).for_each(|(sum, value)| *sum += f64::from(*value));
            }
            Ok(sum)
        };
        lamps.iter().map(of_lamp).collect()
    }
}

#[cfg(test)]
mod tests {
    use clerestory::headless::GALLERY;
    use clerestory_transport::import;
    use clerestory_transport::lamps::LampShape;
    use glam::Vec3;

    use super::super::lamp;
    use super::*;

    #[test]
    fn samples_in_chunks_are_those_of_one_look() {
        let scene = import::load_bytes("gallery.glb", GALLERY).unwrap().scene;
        let scene = PreparedScene::new(scene, &[]).unwrap().0;
        let (camera, film) = (&scene.scene.cameras[0], Film { width: 8, height: 6 });
        let ahead = camera.position() + camera.direction(film, glam::Vec2::new(4.0, 3.0));
        let lamp = |at: Vec3| PreparedLamps::new(&[lamp(LampShape::Point, at)], None).unwrap().0;
        let (lamps, n_samples) = ([lamp(ahead), lamp(ahead + 0.5 * Vec3::Y)], CHUNK + 8);
        let view = View { scene: &scene, camera, film, n_samples };
        let found = view.live(&[&lamps[0], &lamps[1]], 5, 0.1).unwrap();
        let config = VisibleConfig { samples: n_samples, seed: 5, narrow_alpha: 0.1, ..VisibleConfig::default() };
        let points = VisiblePoints::new(&scene, camera, film, config, &|| false).unwrap();
        for (lamp, found) in lamps.iter().zip(found) {
            let mut sum = vec![0.0f32; found.len()];
            for pass in 0..n_samples {
                let picture = points.direct(&scene, lamp, pass, &|| false).unwrap();
                sum.iter_mut().zip(picture.as_flattened()).for_each(|(sum, value)| *sum += value);
            }
            assert!(sum.iter().any(|value| *value > 0.0));
            for (sum, found) in sum.iter().zip(found) {
                let mean = sum / n_samples as f32;
                assert!((mean - found).abs() <= 1e-4 * mean, "{found} is not {mean}");
            }
        }
    }
}
