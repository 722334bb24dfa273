//! How bright unlit surfaces are where no look sets it: glTF gives them a color and no unit, so they are shown as white paper of that
//! color would be in the light of the file.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::basis::SourceKind;
use crate::camera::{Camera, Film};
use crate::matrix::median;
use crate::path::{Integrator, Scratch};
use crate::plan::PicturePlan;
use crate::prepared::PreparedScene;
use crate::sampler::Sampler;
use crate::streams::Stream;
use crate::trace::PictureDeposit;

/// Places of the picture where paper is held, along each side of it, and samples of each.
const PLACES: u32 = 8;
const SAMPLES: u32 = 64;
/// Width that the picture is taken to have: enough for its height to be nearly that of the camera's shape.
const WIDTH_PX: u32 = 960;
/// Stream of random numbers that nobody else uses.
const STREAM: u64 = Stream::Unlit.first();

/// Said of a scan with its light baked in.
const NO_OTHERS: &str = "; there are no other surfaces, so that no light changes the picture: export it with lit materials, without KHR_materials_unlit";

/// Gives unlit surfaces their strength, and tells it; `None` where there are none.
pub(crate) fn brighten(scene: &mut PreparedScene) -> Option<String> {
    let sources = scene.lighting.basis.sources.iter();
    let idx = sources.enumerate().find(|(_, source)| source.kind == SourceKind::Constant)?.0;
    let camera = scene.scene.cameras.first().cloned();
    let nit = camera.and_then(|camera| paper_nit(scene, &camera)).unwrap_or(1.0);
    let alone = if scene.scene.materials.iter().all(|material| material.unlit) { NO_OTHERS } else { "" };
    let source = &mut scene.lighting.basis.sources[idx];
    source.strength = nit;
    let key = &source.key;
    Some(format!(
        "unlit surfaces are seen, and light passes them; a white one has {nit} nit, as paper has in the light of the file: \
         a look sets more or less with the light `{key}`{alone}"
    ))
}

/// Luminance of white paper where the light of the file is neither strong nor weak in a picture, in two digits; `None` where there
/// is none.
fn paper_nit(scene: &PreparedScene, camera: &Camera) -> Option<f32> {
    let film = Film::of_width(WIDTH_PX, camera);
    let place_px = Vec2::new(film.width as f32, film.height as f32) / PLACES as f32;
    let basis = &scene.lighting.basis;
    let coefficients = basis.project(&basis.file_rig());
    let plan = PicturePlan::new(&scene.lighting, &coefficients, scene.diameter());
    let integrator = Integrator::new(scene, &plan, None);
    let lux = |scratch: &mut Scratch, place: u32| {
        let corner = Vec2::new((place % PLACES) as f32, (place / PLACES) as f32);
        let (mut deposit, mut n_found) = (PictureDeposit { coefficients: &coefficients, sum: Vec3::ZERO }, 0u32);
        for nth in 0..SAMPLES {
            let mut sampler = Sampler::new(0, STREAM + u64::from(place), nth);
            let at_px = (corner + Vec2::from(sampler.next_2d())) * place_px;
            let ray = (camera.position(), camera.direction(film, at_px));
            if let Some(receiver) = integrator.seen_receiver(ray, &mut sampler) {
                integrator.sample_irradiance(&receiver, &mut sampler, scratch, &mut deposit);
                n_found += 1;
            }
        }
        crate::light::luminance(deposit.sum) / n_found.max(1) as f32
    };
    let places = (0..PLACES * PLACES).into_par_iter();
    let lux: Vec<f32> = places.map_init(Scratch::default, lux).filter(|lux| *lux > 0.0 && lux.is_finite()).collect();
    Some(rounded(median(lux.into_iter())? / PI))
}

/// In two digits.
fn rounded(value: f32) -> f32 {
    format!("{value:.1e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::laws::stage::{Stage, lambert, quad};
    use crate::scene::Material;

    #[test]
    fn paper_is_held_all_over_a_wide_picture() {
        // A black wall of which the middle quarter of the picture faces parallel light of 1000 lx, and the rest, bent forward by 60° on
        // either side, has half of it: 500 lx / π = 159 nit.
        let camera = Camera::look_at("eye", Vec3::ZERO, Vec3::NEG_Z, 2.0 * 0.25_f32.atan(), 4.0);
        let (up, slope) = (Vec3::Y * 2.0, 3.0_f32.sqrt());
        let middle = quad(Vec3::new(-0.25, -1.0, -1.0), Vec3::X * 0.5, up);
        let right = quad(Vec3::new(0.25, -1.0, -1.0), Vec3::new(1.0, 0.0, slope), up);
        let left = quad(Vec3::new(-1.25, -1.0, slope - 1.0), Vec3::new(1.0, 0.0, -slope), up);
        let sign = quad(Vec3::Z * 5.0, Vec3::X * 0.1, Vec3::Y * 0.1);
        let scene = Stage::new(camera)
            .surface("wall", &[middle, right, left].concat(), lambert(0.0, 0.0))
            .surface("sign", &sign, Material { unlit: true, ..lambert(0.5, 0.0) })
            .distant("sun", Vec3::NEG_Z, 1000.0)
            .prepared();
        assert_eq!(scene.lighting.basis.source("unlit").expect("there is a sign").strength, 160.0);
    }
}
