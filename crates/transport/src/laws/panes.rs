//! Light through clear panes: as much as the interface lets pass, whichever way a walk finds its lamp.

use std::f64::consts::PI;

use glam::{DVec3, Vec2, Vec3};

use super::stage::{Stage, lambert, pane, quad, textured, tint, veil};
use super::walks::{Even, Mean, Walks, assert_same_mean, file_light};
use crate::camera::Camera;
use crate::plan::{Density, MatrixPlan, PicturePlan};
use crate::prepared::PreparedScene;
use crate::scene::{AlphaMode, Encoding, Material};

const ALBEDO: f32 = 0.5;
const RADIANCE: f32 = 5.0;
/// Height of the lights over the floor in meters, half side of the square one.
const HEIGHT: f32 = 1.5;
const HALF: f32 = 1.2;
/// Largest standard error of a mean, relative to it: four of them, 1 %, are what a test accepts.
const SHARP: f64 = 2.5e-3;

/// A floor seen at one point below all panes.
fn floor() -> Stage {
    let camera = Camera::look_at("eye", Vec3::new(0.0, 0.4, 0.6), Vec3::ZERO, 1e-3, 1.0);
    Stage::new(camera).surface("floor", &level(0.0, 10.0, 1.0), lambert(ALBEDO, 0.0))
}

/// A square at a height whose front looks up (1) or down (−1).
fn level(height: f32, half: f32, up: f32) -> Vec<Vec3> {
    quad(Vec3::new(-half, height, -half * up), Vec3::Z * (2.0 * half * up), Vec3::X * (2.0 * half))
}

/// Radiance of the floor's point under the square light, by quadrature: `passed` of the light per cosine.
fn under_the_square(passed: impl Fn(f64) -> f64) -> f64 {
    const N: u32 = 600;
    let side = 2.0 * f64::from(HALF) / f64::from(N);
    let at = |i: u32| (f64::from(i) + 0.5) * side - f64::from(HALF);
    let cell = |(i, j): (u32, u32)| {
        let to_light = DVec3::new(at(i), f64::from(HEIGHT), at(j));
        let cos = to_light.normalize().y;
        cos * cos / to_light.length_squared() * passed(cos) * side * side
    };
    let integral: f64 = (0..N).flat_map(|i| (0..N).map(move |j| (i, j))).map(cell).sum();
    f64::from(RADIANCE * ALBEDO) / PI * integral
}

/// Share that one thin wall of index 1.5 lets pass: its interface counts once \[Schlick1994\].
fn glass_passes(cos: f64) -> f64 {
    0.96 * (1.0 - (1.0 - cos).powi(5))
}

#[track_caller]
fn assert_every_plan_finds(scene: &PreparedScene, expected: f64, bounces: Option<u32>) {
    let weights = file_light(scene);
    let walks = |streams| Walks { spp: 16, ..Walks::of_one_pixel(streams, bounces) };
    let n_cols = weights.len() as u32;
    for (rate, splits, streams) in [(0.0, 1, 100_000), (0.5, 1, 20_000), (1.0, 3, 8000), (16.0, 1, 2400)] {
        let plan = Even { n_cols, rate, splits };
        let what = format!("{rate} picks of each column, {splits} walks on");
        walks(streams).assert_mean(scene, &plan, &weights, (expected, SHARP), &what);
    }
    let matrix = MatrixPlan::new(&scene.lighting, Density::Full);
    walks(10_000).assert_mean(scene, &matrix, &weights, (expected, SHARP), "the plan of a matrix");
    let coefficients: Vec<[f32; 3]> = weights.iter().map(|&w| [w; 3]).collect();
    let picture = PicturePlan::new(&scene.lighting, &coefficients, scene.diameter());
    walks(10_000).assert_mean(scene, &picture, &weights, (expected, SHARP), "the plan of a picture");
}

#[test]
fn a_lamp_right_above_glass_loses_four_percent() {
    let scene = floor().surface("pane", &level(0.8, 5.0, 1.0), pane()).lamp("lamp", Vec3::Y * HEIGHT, 7.0).prepared();
    let plan = Even { n_cols: 1, rate: 1.0, splits: 1 };
    // Without bounces: what the pane throws back to the floor is not direct light.
    let seen = Mean::of(&Walks::of_one_pixel(1000, Some(0)).streams(&scene, &plan, &file_light(&scene)));
    let free = 7.0 / f64::from(HEIGHT * HEIGHT) * f64::from(ALBEDO) / PI;
    seen.assert_is(0.96 * free, 1e-5, "one crossing");
}

#[test]
fn every_pane_on_the_way_takes_its_own_share() {
    let two = floor().surface("low", &level(0.7, 5.0, 1.0), pane()).surface("high", &level(0.9, 5.0, -1.0), tint(0.3));
    let scene = two.lamp("lamp", Vec3::Y * HEIGHT, 7.0).prepared();
    let plan = Even { n_cols: 1, rate: 1.0, splits: 1 };
    let seen = Mean::of(&Walks::of_one_pixel(1000, Some(0)).streams(&scene, &plan, &file_light(&scene)));
    let free = 7.0 / f64::from(HEIGHT * HEIGHT) * f64::from(ALBEDO) / PI;
    seen.assert_is(0.3 * 0.96 * free, 1e-5, "glass and film");
}

#[test]
fn without_a_pane_the_floor_has_the_light_of_the_square() {
    let scene = floor().surface("light", &level(HEIGHT, HALF, -1.0), lambert(0.0, RADIANCE)).prepared();
    assert_every_plan_finds(&scene, under_the_square(|_| 1.0), Some(0));
}

#[test]
fn direct_light_of_a_square_passes_glass_without_any_bounce() {
    let stage = floor().surface("pane", &level(0.8, 20.0, 1.0), pane());
    let scene = stage.surface("light", &level(HEIGHT, HALF, -1.0), lambert(0.0, RADIANCE)).prepared();
    assert_every_plan_finds(&scene, under_the_square(glass_passes), Some(0));
}

#[test]
fn walks_and_connections_through_films_share_the_light_of_a_panel() {
    // Films reflect nothing and the panel is black: there is no indirect light, however many bounces are allowed.
    for bounces in [Some(0), None] {
        let stage = floor().surface("low", &level(0.6, 20.0, -1.0), tint(0.5));
        let stage = stage.surface("high", &level(0.9, 20.0, 1.0), tint(0.8));
        let scene = stage.panel("panel", &level(HEIGHT, HALF, -1.0), RADIANCE, 4).prepared();
        assert_every_plan_finds(&scene, under_the_square(|_| 0.4), bounces);
    }
}

#[test]
fn a_light_that_is_half_there_sends_half() {
    let square = level(HEIGHT, HALF, -1.0);
    let expected = 0.5 * under_the_square(|_| 1.0);
    let scene = floor().surface("light", &square, veil(RADIANCE)).prepared();
    assert_every_plan_finds(&scene, expected, Some(0));
    // Cut away on one side.
    let alpha = AlphaMode::Mask { cutoff: 0.5 };
    let cut = Material { alpha, base_color_texture: textured(Encoding::Srgb), ..lambert(0.0, RADIANCE) };
    let texels = [[0, 0, 0, 0], [0, 0, 0, 255], [0, 0, 0, 0], [0, 0, 0, 255]];
    let stage = floor().surface("light", &square, cut).with_texture(texels, |place| Vec2::splat(place.x + 0.5));
    assert_every_plan_finds(&stage.prepared(), expected, Some(0));
}

/// Before all else: glass without thickness whose roughness a texture tells, smooth where x is positive, else as rough as its green.
fn etched(stage: Stage, green: u8) -> PreparedScene {
    let glass = Material { roughness: 1.0, metallic_roughness_texture: textured(Encoding::Linear), ..pane() };
    let (rough, smooth) = ([0, green, 255, 255], [0, 0, 255, 255]);
    let stage = stage.surface("pane", &level(0.8, 5.0, 1.0), glass);
    stage.with_texture([rough, smooth, rough, smooth], |place| Vec2::splat(place.x + 0.5)).prepared()
}

#[test]
fn glass_that_its_texture_makes_smooth_lets_lamps_through() {
    let seen = |x: f32, green: u8| {
        let scene = etched(floor().lamp("lamp", Vec3::new(x, HEIGHT, 0.0), 7.0), green);
        let plan = Even { n_cols: 1, rate: 1.0, splits: 1 };
        Mean::of(&Walks::of_one_pixel(1000, Some(0)).streams(&scene, &plan, &file_light(&scene)))
    };
    let free = 7.0 / f64::from(HEIGHT * HEIGHT) * f64::from(ALBEDO) / PI;
    seen(0.0, 0).assert_is(0.96 * free, 1e-5, "one crossing");
    assert!(seen(0.5, 200).value > 0.4 * free, "where it is smooth");
    assert_eq!(seen(-0.5, 200).value, 0.0, "where it is rough");
}

#[test]
fn half_etched_glass_has_the_mean_of_walks_that_connect_to_nothing() {
    let scene = etched(floor().surface("light", &level(HEIGHT, HALF, -1.0), lambert(0.0, RADIANCE)), 120);
    let weights = file_light(&scene);
    let walks = |seed| Walks { spp: 6, seed, ..Walks::of_one_pixel(200_000, Some(2)) };
    let even = |rate| Even { n_cols: 1, rate, splits: 1 };
    let plain = walks(1).streams(&scene, &even(0.0), &weights);
    assert_same_mean(&walks(2).streams(&scene, &even(1.0), &weights), &plain, SHARP, "one pick of each column");
    let plan = MatrixPlan::new(&scene.lighting, Density::Full);
    assert_same_mean(&walks(3).streams(&scene, &plan, &weights), &plain, SHARP, "the plan of a matrix");
}
