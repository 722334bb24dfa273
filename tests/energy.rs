//! Scenes whose radiance is known by hand. In a closed room of one albedo ρ whose walls emit E, every ray sees
//! E · (1 + ρ + ρ² + …) = E / (1 − ρ), whatever the room's shape [pbrt, integrators_test].

use std::f32::consts::PI;

use clerestory_transport::bake::BakeConfig;
use clerestory_transport::camera::Film;
use clerestory_transport::light::LightRig;
use clerestory_transport::trace::TraceConfig;
use glam::Vec3;

use crate::support::{Mean, SceneFile, Shape, baked, block_means, prepare, relit, traced};

const FILM: Film = Film { width: 32, height: 24 };
/// Largest standard error of a mean: four of them, 1 % of radiance 1, are what a test accepts.
const SHARP: f64 = 2.5e-3;

fn closed(shape: &Shape, albedo: f32, radiance: f32) -> Vec<u8> {
    let walls = SceneFile::lambert([albedo; 3], [radiance; 3]);
    SceneFile::default().surface("walls", shape, walls).camera("inside", Vec3::new(0.1, 0.05, 0.2), 1.2).glb()
}

/// Mean over pixels of one channel.
fn mean(pixels: &[[f32; 3]], channel: usize) -> Mean {
    Mean::of(pixels.iter().map(|rgb| f64::from(rgb[channel])))
}

fn trace_config(bounces: Option<u32>) -> TraceConfig {
    TraceConfig { spp: 256, bounces, seed: 11 }
}

#[test]
fn a_closed_white_furnace_has_radiance_one() {
    for (shape, albedo) in [(Shape::room(Vec3::new(1.0, 0.7, 1.3)), 0.8), (Shape::hollow_sphere(1.0, 12), 0.5)] {
        let scene = prepare(&closed(&shape, albedo, 1.0 - albedo));
        let pixels = traced(&scene, &LightRig::default(), FILM, &trace_config(None));
        for channel in 0..3 {
            mean(&pixels, channel).assert_is(1.0, 1e-4, SHARP);
        }
    }
}

#[test]
fn every_bounce_adds_its_term_of_the_series() {
    let scene = prepare(&closed(&Shape::room(Vec3::ONE), 0.5, 1.0));
    for (bounces, expected) in [(0, 1.5), (1, 1.75), (4, 1.968_75)] {
        let pixels = traced(&scene, &LightRig::default(), FILM, &trace_config(Some(bounces)));
        mean(&pixels, 0).assert_is(expected, 1e-4, SHARP);
    }
}

#[test]
fn a_lamp_in_the_middle_of_a_sphere_of_albedo_one_half_gives_radiance_one() {
    // Direct light alone is I · ρ / (π r²) = ½; the facets lie closer than the radius by up to 0.05 %.
    let walls = SceneFile::lambert([0.5; 3], [0.0; 3]);
    let file = SceneFile::default().surface("walls", &Shape::hollow_sphere(1.0, 96), walls);
    let file = file.point_lamp("lamp", Vec3::ZERO, [1.0; 3], PI).camera("inside", Vec3::new(0.0, 0.0, 0.3), 1.2);
    let pixels = traced(&prepare(&file.glb()), &LightRig::default(), FILM, &trace_config(None));
    mean(&pixels, 1).assert_is(1.0, 1e-3, SHARP);
}

#[test]
fn a_baked_furnace_has_radiance_one() {
    let scene = prepare(&closed(&Shape::hollow_sphere(1.0, 12), 0.5, 0.5));
    let bake = baked(&scene, FILM, BakeConfig { spp: 128, block: 8, ..BakeConfig::default() });
    let blue: Vec<f64> = relit(&bake, &LightRig::default()).pixels.iter().map(|rgb| f64::from(rgb[2])).collect();
    // By blocks: neighboring pixels of one share their noise.
    Mean::of(block_means(&blue, FILM.width as usize, 8)).assert_is(1.0, 1e-3, SHARP);
}

#[test]
fn a_white_wall_under_the_open_sky_is_as_bright_as_the_sky() {
    // A scene without any light gets a uniform sky of radiance 1; a convex white body hides nothing from itself.
    let ball = Shape::hollow_sphere(1.0, 24).turned();
    let white = SceneFile::lambert([1.0; 3], [0.0; 3]);
    let file = SceneFile::default().surface("ball", &ball, white).camera("outside", Vec3::new(0.0, 0.0, 3.0), 0.5);
    let scene = prepare(&file.glb());
    assert_eq!(scene.lighting.basis.n_cols(), 1, "the sky is one column");
    let sky = f64::from(scene.lighting.basis.sources[0].strength);
    let pixels = traced(&scene, &LightRig::default(), FILM, &trace_config(None));
    mean(&pixels, 0).assert_is(sky, 1e-3 * sky, 1e-3 * sky);
}
