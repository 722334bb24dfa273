//! Directional lamps with a size: their shadows have the penumbra of a disk.

use std::f64::consts::PI;

use glam::Vec3;

use super::stage::{Stage, lambert, quad};
use super::walks::{Even, Walks, assert_same_mean, file_light};
use crate::camera::{Camera, Film};
use crate::lamps::{FreeLamp, PreparedLamps, lattice};
use crate::light::LightSetting;
use crate::plan::{Density, MatrixPlan, PicturePlan};
use crate::prepared::PreparedScene;
use crate::scene::Material;

const LUX: f32 = 100.0;
const ALBEDO: f32 = 0.6;
/// Height of the roof over the floor, m.
const HEIGHT: f32 = 2.0;

/// A floor under a black roof that ends at x = 0, a sun above, and a camera that sees but one point of the floor.
fn under_a_roof(x: f32, radius_rad: f32) -> PreparedScene {
    let place = Vec3::X * x;
    let camera = Camera::look_at("eye", place + Vec3::new(0.3, 0.5, 1.0), place, 1e-4, 1.0);
    let black = Material { double_sided: true, ..lambert(0.0, 0.0) };
    let mut scene = Stage::new(camera)
        .surface("floor", &quad(Vec3::new(-9.0, 0.0, 9.0), Vec3::X * 18.0, Vec3::NEG_Z * 18.0), lambert(ALBEDO, 0.0))
        .surface("roof", &quad(Vec3::new(-9.0, HEIGHT, 9.0), Vec3::X * 9.0, Vec3::NEG_Z * 18.0), black)
        .distant("sun", Vec3::NEG_Y, LUX)
        .into_scene();
    assert_eq!(scene.set_sun_radius(radius_rad), 1);
    PreparedScene::new(scene, &[]).expect("a stage has valid lights").0
}

/// Share of a disk that a chord at `q` radii from its middle leaves on the side beyond it.
fn beyond_chord(q: f64) -> f64 {
    let q = q.clamp(-1.0, 1.0);
    0.5 - (q.asin() + q * (1.0 - q * q).sqrt()) / PI
}

/// Share of the sun's light that comes past the roof to a place on the floor.
fn share_past_the_roof(x: f32, radius: f32) -> f64 {
    // The roof ends at the slope −x / HEIGHT as seen from there: directions beyond it reach the floor.
    let slope = f64::from(-x / HEIGHT);
    beyond_chord(slope / (1.0 + slope * slope).sqrt() / f64::from(radius).sin())
}

#[test]
fn the_penumbra_of_a_sun_is_that_of_a_disk() {
    let radius = 0.05f32;
    for x in [-0.2, -0.07, -0.03, 0.0, 0.05, 0.08, 0.2] {
        let scene = under_a_roof(x, radius);
        let expected = f64::from(ALBEDO * LUX) / PI * share_past_the_roof(x, radius);
        let weights = file_light(&scene);
        let plan = MatrixPlan::new(&scene.lighting, Density::Full);
        let values = Walks::of_one_pixel(40_000, Some(0)).streams(&scene, &plan, &weights);
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let full = f64::from(ALBEDO * LUX) / PI;
        assert!((mean - expected).abs() < 0.006 * full, "x {x}: {mean} for {expected} of {full}");
    }
}

#[test]
fn a_sun_with_a_size_that_became_movable_has_its_penumbra_and_its_lux() {
    let (radius, n) = (0.05f32, 4096);
    for x in [-0.2, -0.07, -0.03, 0.0, 0.05, 0.08, 0.2] {
        let scene = under_a_roof(x, radius);
        let source = scene.lighting.basis.source("sun").expect("the sun");
        let light = scene.scene.lamp_called("sun").expect("the sun is a lamp of the file");
        let free = FreeLamp::from_source("movable", source, light, LightSetting::default()).expect("no distribution");
        let lamps = PreparedLamps::new(&[free], None).expect("a lamp that makes sense").0;
        let (sun, place) = (&lamps.lamps()[0], Vec3::new(x, 1e-3, 0.0));
        let lux = |nth: u32| {
            let lit = sun.lamp.lit(place, lattice(nth), scene.far()).expect("it shines everywhere");
            scene.transmittance(place, lit.target).x * sun.emission.x * lit.factor * lit.wi.y
        };
        let share = (0..n).map(lux).sum::<f32>() / (n as f32 * LUX);
        let expected = share_past_the_roof(x, radius);
        assert!((f64::from(share) - expected).abs() < 0.01, "x {x}: {share} of the light for {expected}");
    }
}

#[test]
fn a_large_sun_is_the_same_whether_walks_meet_it_or_connect_to_it() {
    let scene = under_a_roof(0.1, 0.4);
    let weights = file_light(&scene);
    let film = Film { width: 1, height: 1 };
    let walks = |spp, seed| Walks { film, streams: 400_000, spp, bounces: Some(1), seed };
    let met = walks(16, 1).streams(&scene, &Even { n_cols: 1, rate: 0.0, splits: 1 }, &weights);
    let by = |found: Vec<f64>, what: &str| assert_same_mean(&found, &met, 2.5e-3, what);
    by(walks(4, 2).streams(&scene, &Even { n_cols: 1, rate: 1.0, splits: 1 }, &weights), "one connection");
    let picture = PicturePlan::new(&scene.lighting, &[[weights[0]; 3]], scene.diameter());
    by(walks(4, 3).streams(&scene, &picture, &weights), "the plan of a picture");
}

#[test]
fn a_sun_with_a_size_sends_the_same_lux_and_is_seen_in_mirrors() {
    for radius in [0.0, 0.01, 0.3, 1.2] {
        let scene = under_a_roof(8.0, radius);
        let weights = file_light(&scene);
        let plan = MatrixPlan::new(&scene.lighting, Density::Full);
        let expected = f64::from(ALBEDO * LUX) / PI;
        let values = Walks::of_one_pixel(40_000, Some(0)).streams(&scene, &plan, &weights);
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        // Far from the roof a small part of the largest disk is behind it.
        assert!(
            (mean / expected - 1.0).abs() < if radius > 1.0 { 0.12 } else { 2e-3 },
            "{radius}: {mean} for {expected}"
        );
    }
    let silver = Material { metallic: 1.0, roughness: 0.0, ..Material::default() };
    let camera = Camera::look_at("eye", Vec3::Y * 3.0, Vec3::ZERO, 1e-4, 1.0);
    let mirror = Stage::new(camera).surface(
        "mirror",
        &quad(Vec3::new(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0),
        silver,
    );
    let mut scene = mirror.distant("sun", Vec3::NEG_Y, LUX).into_scene();
    scene.set_sun_radius(0.1);
    let scene = PreparedScene::new(scene, &[]).expect("a stage has valid lights").0;
    let weights = file_light(&scene);
    let plan = MatrixPlan::new(&scene.lighting, Density::Full);
    let values = Walks::of_one_pixel(64, Some(2)).streams(&scene, &plan, &weights);
    let radiance = f64::from(LUX) / (PI * f64::from(0.1f32).sin().powi(2));
    assert!(values.iter().all(|value| (value / radiance - 1.0).abs() < 1e-4), "{} for {radiance}", values[0]);
}
