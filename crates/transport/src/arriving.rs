//! Where the light that arrives at what each pixel sees is measured, kept, so that lamps which come and go count at once.
//!
//! These are the points of [`IrradianceRows::Pixels`](crate::irradiance::IrradianceRows::Pixels), one of each pixel: the mean
//! over several such samples is the direct part of what a bake holds of the lights of a scene.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::camera::{Camera, Film};
use crate::lamps::PreparedLamps;
use crate::path::{Integrator, NoLights};
use crate::prepared::PreparedScene;
use crate::sampler::Sampler;
use crate::stop::Halt;
use crate::streams::Stream;

/// One point of each pixel, and which side of it counts.
pub struct ArrivingPoints {
    /// Row by row; a pixel that sees no such surface has none.
    points: Vec<Option<(Vec3, Vec3)>>,
}

/// Bytes that each pixel takes.
pub const POINT_BYTES: usize = size_of::<Option<(Vec3, Vec3)>>();
/// Stream of random numbers that nobody else uses.
const STREAM: u64 = Stream::Arriving.first();
/// Pixels between two looks at whether somebody wants to leave.
const AT_ONCE: usize = 1024;

impl ArrivingPoints {
    /// Looks through a random point of every pixel, another one for each `sample`; `None` when `stop` asked to.
    pub fn new(
        scene: &PreparedScene,
        camera: &Camera,
        film: Film,
        sample: u32,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Option<ArrivingPoints> {
        let integrator = Integrator::new(scene, &NoLights, None);
        let look = |pixel: usize| {
            let mut sampler = Sampler::new(0, STREAM + pixel as u64, sample);
            let corner = Vec2::new((pixel % film.width as usize) as f32, (pixel / film.width as usize) as f32);
            let direction = camera.direction(film, corner + Vec2::from(sampler.next_2d()));
            let receiver = integrator.seen_receiver((camera.position(), direction), &mut sampler);
            receiver.map(|receiver| (receiver.origin(scene), receiver.normal))
        };
        let points = whole(film.n_pixels(), stop, look)?;
        Some(ArrivingPoints { points })
    }

    /// What lamps send straight to each point with so many bounces, as [`PreparedLamps::irradiance`] has them but by fewer points of each
    /// lamp, lux per channel, row by row from the top left; `None` when `stop` asked to.
    pub fn irradiance(
        &self,
        scene: &PreparedScene,
        lamps: &PreparedLamps,
        bounces: Option<u32>,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Option<Vec<[f32; 3]>> {
        whole(self.points.len(), stop, |pixel| {
            let lux = |place| lamps.rough_irradiance(scene, place, bounces);
            self.points[pixel].map_or(Vec3::ZERO, lux).to_array()
        })
    }
}

/// Something for each pixel, on all threads; `None` when `stop` asked to.
fn whole<T: Send>(
    n_pixels: usize,
    stop: &(dyn Fn() -> bool + Sync),
    of_pixel: impl Fn(usize) -> T + Sync,
) -> Option<Vec<T>> {
    let halt = Halt::new(stop);
    let chunk = |first: usize| {
        if halt.is_called() {
            return Vec::new();
        }
        (first..n_pixels.min(first + AT_ONCE)).map(&of_pixel).collect()
    };
    let chunks: Vec<Vec<T>> = (0..n_pixels).into_par_iter().step_by(AT_ONCE).map(chunk).collect();
    (!halt.was_called()).then(|| chunks.into_iter().flatten().collect())
}
