//! However lights are sampled and walks are ended, the mean is that of the plainest walk.

use std::sync::LazyLock;

use clerestory_nystrom::{Half, SampledMatrix};
use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;

use super::stage::{Stage, lambert, pane, quad, room, textured, veil};
use super::walks::{Always, Even, Mean, Walks, assert_same_mean, file_light};
use crate::camera::{Camera, Film};
use crate::matrix::{CHANNELS, PEAK_QUANTILE, TransportMatrix};
use crate::path::{LightPlan, Vertex};
use crate::plan::{Density, MatrixPlan, PicturePlan};
use crate::prepared::PreparedScene;
use crate::scene::{AlphaMode, Encoding, Material};

const FILM: Film = Film { width: 16, height: 12 };
/// Largest standard error of a difference of means, relative to the mean: four of them, 1 %, are what a test accepts.
const SHARP: f64 = 2.5e-3;

/// The lights of a room.
struct Lights {
    panel: Vec<Vec3>,
    resolution: u32,
    /// Near the ceiling one that is there, and one that is half there.
    light: Vec<Vec3>,
    veil: Vec<Vec3>,
    /// A sign with holes and a pattern: corner, and sides along z and y.
    sign: (Vec3, [f32; 2]),
}

/// A room with a panel, a window pane before it, a glossy and a mirroring plate, a ceiling light, one that is half there, and a sign.
fn lit_room(lights: Lights, look_at: Vec3, gloss: f32) -> PreparedScene {
    let camera = Camera::look_at("eye", Vec3::new(1.7, 0.3, 1.2), look_at, 1.2, 4.0 / 3.0);
    let metal = |roughness| Material { base_color: Vec4::new(0.8, 0.7, 0.6, 1.0), roughness, ..Material::default() };
    let window = quad(Vec3::new(-1.2, -1.15, -1.1), Vec3::Y * 1.2, Vec3::Z * 1.4);
    let sign = Material {
        emissive_texture: textured(Encoding::Srgb),
        base_color_texture: textured(Encoding::Srgb),
        alpha: AlphaMode::Mask { cutoff: 0.5 },
        ..lambert(0.0, 3.0)
    };
    let texels = [[255, 255, 0, 255], [90, 90, 90, 255], [200, 200, 200, 255], [255, 255, 255, 0]];
    let (corner, [along, up]) = lights.sign;
    Stage::new(camera)
        .surface("walls", &room(Vec3::new(2.0, 1.2, 1.5)), lambert(0.6, 0.0))
        .panel("panel", &lights.panel, 4.0, lights.resolution)
        .surface("pane", &window, pane())
        .surface("glossy", &quad(Vec3::new(-0.8, -1.1, -1.0), Vec3::Z, Vec3::X), metal(gloss))
        .surface("mirror", &quad(Vec3::new(-1.0, -0.8, -1.49), Vec3::X * 1.5, Vec3::Y), metal(0.0))
        .surface("light", &lights.light, lambert(0.0, 3.0))
        .surface("veil", &lights.veil, veil(3.0))
        .surface("sign", &quad(corner, Vec3::Z * along, Vec3::Y * up), sign)
        .with_texture(texels, |place| Vec2::new((place.z - corner.z) / along, (place.y - corner.y) / up))
        .prepared()
}

/// Small lights, a panel close to two walls among them.
fn room_with_everything() -> PreparedScene {
    let lights = Lights {
        panel: quad(Vec3::new(-1.9, -1.1, -1.4), Vec3::Y * 1.2, Vec3::Z * 1.4),
        resolution: 6,
        light: quad(Vec3::new(0.2, 1.15, -0.5), Vec3::X * 0.8, Vec3::Z * 0.8),
        veil: quad(Vec3::new(-1.0, 1.1, 0.3), Vec3::X * 0.8, Vec3::Z * 0.8),
        sign: (Vec3::new(1.95, -0.5, -1.1), [0.9, 0.9]),
    };
    lit_room(lights, Vec3::new(-1.5, -0.4, -0.8), 0.35)
}

/// Lights so large that walks alone find them often enough for means within some thousandths.
fn room_with_large_lights(resolution: u32) -> PreparedScene {
    let lights = Lights {
        panel: quad(Vec3::new(-1.9, -0.85, -1.2), Vec3::Y * 1.8, Vec3::Z * 2.4),
        resolution,
        light: quad(Vec3::new(-1.5, 1.15, -1.2), Vec3::X * 2.4, Vec3::Z * 2.4),
        veil: quad(Vec3::new(1.0, 1.1, -1.2), Vec3::X * 0.7, Vec3::Z * 2.4),
        sign: (Vec3::new(1.95, -0.85, -1.3), [2.0, 1.8]),
    };
    lit_room(lights, Vec3::new(0.0, -1.2, 0.0), 0.6)
}

/// What the bake multiplies columns by.
fn column_scale(scene: &PreparedScene) -> Vec<f32> {
    let plan = MatrixPlan::new(&scene.lighting, Density::Full);
    TransportMatrix::new(scene, &plan, scene.scene.cameras[0].clone(), FILM, None, 3).measure_columns().0
}

#[test]
fn the_scale_of_columns_is_that_of_a_converged_picture() {
    let scene = room_with_everything();
    let plan = MatrixPlan::new(&scene.lighting, Density::Full);
    let film = Film { width: 96, height: 72 };
    let matrix = || TransportMatrix::new(&scene, &plan, scene.scene.cameras[0].clone(), film, None, 3);
    // Every fourth pixel each way is enough.
    let is_asked = |pixel: &u32| [pixel % film.width, pixel / film.width].iter().all(|at| at.is_multiple_of(4));
    let pixels: Vec<u32> = (0..film.n_pixels() as u32).filter(is_asked).collect();
    let (n_cols, n_samples) = (matrix().n_cols(), 256);
    let of_tile = |tile: &[u32]| {
        let mut rows = vec![0.0; tile.len() * CHANNELS * n_cols];
        matrix().add_rows(tile, 0..n_samples, Half::A, &mut rows, &mut Vec::new());
        rows
    };
    let rows: Vec<f32> = pixels.par_chunks(16).flat_map_iter(of_tile).collect();
    let peak = |column: usize| {
        let mut values: Vec<f32> = rows.iter().skip(column).step_by(n_cols).copied().collect();
        values.sort_unstable_by(f32::total_cmp);
        values[(values.len() as f32 * PEAK_QUANTILE) as usize] / n_samples as f32
    };
    let mut told: Vec<f32> = matrix().measure_columns().0.iter().enumerate().map(|(c, s)| s * peak(c)).collect();
    told.sort_unstable_by(f32::total_cmp);
    let median = told[n_cols / 2];
    assert!((0.85..1.18).contains(&median), "scaled peaks are {told:?}");
}

fn walks(thousands: u64, spp: u32, bounces: Option<u32>, seed: u64) -> Walks {
    Walks { film: FILM, streams: thousands * 960, spp, bounces, seed }
}

/// Plain walks under the light of the room with large lights, made once for all who are held against them.
fn plain_walks() -> &'static [f64] {
    static PLAIN: LazyLock<Vec<f64>> = LazyLock::new(|| {
        let scene = room_with_large_lights(6);
        walks(10, 64, Some(3), 1).plain(&scene, &file_light(&scene))
    });
    &PLAIN
}

#[test]
fn every_way_to_sample_lights_has_the_mean_of_plain_walks() {
    let scene = room_with_large_lights(6);
    let weights = file_light(&scene);
    let check = |found: Vec<f64>, what: &str| assert_same_mean(&found, plain_walks(), SHARP, what);
    let n_cols = weights.len() as u32;
    for (rate, splits, spp) in [(0.0, 1, 48), (0.25, 1, 16), (1.0, 2, 8)] {
        let found = walks(10, spp, Some(3), 2).streams(&scene, &Even { n_cols, rate, splits }, &weights);
        check(found, &format!("{rate} picks of each column, {splits} walks on"));
    }
    let coefficients: Vec<[f32; 3]> = weights.iter().map(|&w| [w; 3]).collect();
    let picture = PicturePlan::new(&scene.lighting, &coefficients, scene.diameter());
    check(walks(10, 24, Some(3), 3).streams(&scene, &picture, &weights), "the plan of a picture");
    let plan = MatrixPlan::new(&scene.lighting, Density::Full);
    check(walks(10, 8, Some(3), 4).streams(&scene, &plan, &weights), "the plan of a matrix");
    let lone = MatrixPlan::new(&scene.lighting, Density::Full).with_lone_picks();
    check(walks(10, 24, Some(3), 6).streams(&scene, &lone, &weights), "a light at a vertex");
    // A preview asks for one of four lights where there are many.
    let fine = room_with_large_lights(12);
    let preview = MatrixPlan::new(&fine.lighting, Density::Quarter);
    assert!(preview.rate(Vertex::First, 0) < 1.0, "a preview leaves out lights");
    check(walks(10, 16, Some(3), 5).streams(&fine, &preview, &file_light(&fine)), "the plan of a preview");
}

/// Share of the light that the walls of a furnace scatter, and their radiance.
const FURNACE: (f32, f32) = (0.5, 0.5);

/// A closed room all of whose walls emit and scatter alike; one of them is a panel. Wherever a ray ends, it sees
/// E · (1 + ρ + ρ² + …).
fn furnace() -> PreparedScene {
    let camera = Camera::look_at("eye", Vec3::new(0.3, 0.1, -0.4), Vec3::new(-0.5, -0.4, 1.0), 1.2, 4.0 / 3.0);
    let corners = room(Vec3::new(1.0, 0.7, 1.3));
    let (walls, last) = corners.split_at(corners.len() - 6);
    let (albedo, radiance) = FURNACE;
    let stage = Stage::new(camera).surface("walls", walls, lambert(albedo, radiance));
    stage.surface("panel", last, lambert(albedo, radiance)).with_panel(Some(4)).prepared()
}

/// Asserts that light that was scattered in the furnace has the sum of its series; what is seen itself is known.
#[track_caller]
fn assert_scatters(found: &[f64], bounces: Option<i32>, what: &str) {
    let (albedo, radiance) = (f64::from(FURNACE.0), f64::from(FURNACE.1));
    let rest = bounces.map_or(0.0, |bounces| albedo.powi(bounces + 1));
    let expected = radiance * albedo * (1.0 - rest) / (1.0 - albedo);
    let scattered: Vec<f64> = found.iter().map(|found| found - radiance).collect();
    Mean::of(&scattered).assert_is(expected, SHARP, what);
}

#[test]
fn every_way_to_sample_lights_finds_the_light_of_a_furnace() {
    let scene = furnace();
    let weights = file_light(&scene);
    let n_cols = weights.len() as u32;
    assert_eq!(n_cols, 17, "the walls, and sixteen texels");
    let plain = walks(1, 1, Some(3), 1).plain(&scene, &weights);
    assert_scatters(&plain, Some(3), "walks alone");
    assert!(Mean::of(&plain).error < 1e-5, "every wall shines alike");
    for (rate, splits, spp) in [(0.0, 1, 24), (0.25, 1, 24), (1.0, 2, 16)] {
        let found = walks(10, spp, Some(3), 2).streams(&scene, &Even { n_cols, rate, splits }, &weights);
        assert_scatters(&found, Some(3), &format!("{rate} picks of each column, {splits} walks on"));
    }
    let coefficients: Vec<[f32; 3]> = weights.iter().map(|&w| [w; 3]).collect();
    let picture = PicturePlan::new(&scene.lighting, &coefficients, scene.diameter());
    assert_scatters(&walks(10, 24, Some(3), 3).streams(&scene, &picture, &weights), Some(3), "the plan of a picture");
    let plan = || MatrixPlan::new(&scene.lighting, Density::Full);
    assert_scatters(&walks(10, 16, Some(3), 4).streams(&scene, &plan(), &weights), Some(3), "the plan of a matrix");
    let lone = plan().with_lone_picks();
    assert_scatters(&walks(10, 24, Some(3), 5).streams(&scene, &lone, &weights), Some(3), "a light at a vertex");
}

#[test]
fn roulette_keeps_the_light_of_a_furnace() {
    let scene = furnace();
    let weights = file_light(&scene);
    let coefficients: Vec<[f32; 3]> = weights.iter().map(|&w| [w; 3]).collect();
    let picture = PicturePlan::new(&scene.lighting, &coefficients, scene.diameter());
    assert_scatters(&walks(10, 24, None, 1).streams(&scene, &picture, &weights), None, "the plan of a picture");
    let plan = || MatrixPlan::new(&scene.lighting, Density::Full);
    assert_scatters(&walks(10, 16, None, 2).streams(&scene, &plan(), &weights), None, "the plan of a matrix");
    let roulette = plan().with_roulette(&column_scale(&scene));
    let found = walks(10, 24, None, 3).streams(&scene, &roulette, &weights);
    assert_scatters(&found, None, "connections left to roulette");
}

#[test]
fn samples_that_know_nothing_of_each_other_have_the_mean_of_those_of_a_sequence() {
    const SAMPLES: u32 = 512;
    let scene = room_with_large_lights(4);
    let weights = file_light(&scene);
    // Pixel by pixel, each by itself.
    let pictured = |scene: &PreparedScene| -> Vec<f64> {
        let plan = MatrixPlan::new(&scene.lighting, Density::Full);
        let matrix = TransportMatrix::new(scene, &plan, scene.scene.cameras[0].clone(), FILM, Some(3), 4);
        let n_cols = matrix.n_cols();
        let of_pixel = |pixel: u32| {
            let mut rows = vec![0.0; CHANNELS * n_cols];
            matrix.add_rows(&[pixel], 0..SAMPLES, Half::A, &mut rows, &mut Vec::new());
            rows[n_cols..2 * n_cols].iter().zip(&weights).map(|(value, weight)| f64::from(value * weight)).sum::<f64>()
        };
        (0..FILM.n_pixels() as u32).into_par_iter().map(of_pixel).collect()
    };
    let (sequence, lone) = (pictured(&scene), pictured(&scene.clone().with_lone_samples()));
    assert!(sequence.iter().zip(&lone).all(|(a, b)| a != b || *a == 0.0), "they are other samples");
    assert_same_mean(&lone, &sequence, SHARP, "samples that know nothing of each other");
}

/// Lit by the sky, which no connection finds, through a roof of half a room.
fn half_a_room() -> PreparedScene {
    let camera = Camera::look_at("eye", Vec3::new(1.7, 0.3, 1.2), Vec3::new(-1.5, -0.4, -0.8), 1.2, 4.0 / 3.0);
    Stage::new(camera)
        .surface("floor", &quad(Vec3::new(-2.0, -1.0, 2.0), Vec3::X * 4.0, Vec3::Z * -4.0), lambert(0.7, 0.0))
        .surface("wall", &quad(Vec3::new(-2.0, -1.0, 2.0), Vec3::Z * -4.0, Vec3::Y * 2.0), lambert(0.5, 0.0))
        .prepared()
}

/// Scenes with the plan of how many lights they are asked for, and samples of a stream.
fn gathered_in() -> [(PreparedScene, Density, u32, &'static str); 3] {
    [
        (room_with_large_lights(4), Density::Full, 12, "a room"),
        (room_with_large_lights(12), Density::Quarter, 16, "a preview of a room"),
        (half_a_room(), Density::Full, 24, "under the sky"),
    ]
}

#[test]
fn direct_light_and_what_is_gathered_are_all_light() {
    for (scene, density, spp, name) in gathered_in() {
        let (plan, weights) = (MatrixPlan::new(&scene.lighting, density), file_light(&scene));
        let whole = walks(10, spp, Some(3), 4).streams(&scene, &plan, &weights);
        let shared = walks(10, 2 * spp, Some(3), 5).gathered(&scene, &plan, &weights);
        assert_same_mean(&shared, &whole, SHARP, name);
    }
}

#[test]
fn direct_irradiance_and_what_is_gathered_are_all_irradiance() {
    for (scene, density, spp, name) in gathered_in() {
        let (plan, weights) = (MatrixPlan::new(&scene.lighting, density), file_light(&scene));
        let whole = walks(10, spp, Some(3), 6).irradiance(&scene, &plan, &weights);
        let shared = walks(10, 2 * spp, Some(3), 7).gathered_irradiance(&scene, &plan, &weights);
        assert_same_mean(&shared, &whole, SHARP, name);
    }
}

#[test]
fn what_is_gathered_behind_a_mirror_has_no_bounce_too_many() {
    let camera = Camera::look_at("eye", Vec3::new(0.2, 0.1, 0.9), Vec3::NEG_Z, 0.5, 4.0 / 3.0);
    let silver = Material { metallic: 1.0, roughness: 0.0, ..Material::default() };
    let scene = Stage::new(camera)
        .surface("walls", &room(Vec3::ONE), lambert(0.6, 0.0))
        .surface("mirror", &quad(Vec3::new(-0.95, -0.95, -0.99), Vec3::X * 1.9, Vec3::Y * 1.9), silver)
        .surface("light", &quad(Vec3::new(-0.5, 0.98, -0.5), Vec3::X * 0.9, Vec3::Z * 0.9), lambert(0.0, 3.0))
        .prepared();
    let (plan, weights) = (MatrixPlan::new(&scene.lighting, Density::Full), file_light(&scene));
    for bounces in [1, 2] {
        let whole = walks(10, 16, Some(bounces), 4).streams(&scene, &plan, &weights);
        let shared = walks(10, 24, Some(bounces), 5).gathered(&scene, &plan, &weights);
        assert_same_mean(&shared, &whole, SHARP, &format!("{bounces} bounces"));
    }
}

#[test]
fn connections_alone_without_any_weights_have_the_mean_of_plain_walks_and_of_weighed_ones() {
    let scene = room_with_large_lights(6);
    let weights = file_light(&scene);
    let connected = walks(10, 128, Some(3), 6).connected(&scene, &weights);
    assert_same_mean(&connected, plain_walks(), SHARP, "connections alone, walks alone");
    let plan = MatrixPlan::new(&scene.lighting, Density::Full);
    let weighed = walks(10, 8, Some(3), 4).streams(&scene, &plan, &weights);
    assert_same_mean(&connected, &weighed, SHARP, "connections alone, both weighed");
}

#[test]
fn roulette_that_ends_walks_keeps_the_mean() {
    // The plain walks go on for a hundred surfaces: the rest is less than 0.6¹⁰⁰ of the light.
    let scene = room_with_large_lights(4);
    let weights = file_light(&scene);
    let plain = walks(10, 64, None, 1).plain(&scene, &weights);
    let plan = MatrixPlan::new(&scene.lighting, Density::Full);
    assert_same_mean(&walks(10, 16, None, 2).streams(&scene, &plan, &weights), &plain, SHARP, "no limit of bounces");
}

#[test]
fn connections_left_to_roulette_keep_the_mean() {
    let scene = room_with_large_lights(4);
    let plan = MatrixPlan::new(&scene.lighting, Density::Full);
    let roulette = MatrixPlan::new(&scene.lighting, Density::Full).with_roulette(&column_scale(&scene));
    let n_cols = scene.lighting.basis.n_cols() as u32;
    // The lights without texels alone, and the panel alone: together they are all.
    for shining in [0..3, 3..n_cols] {
        let weights: Vec<f32> = (0..n_cols).map(|column| f32::from(shining.contains(&column))).collect();
        // With the same random numbers, so that little but the roulette tells them apart.
        let [surely, seldom] = [&plan, &roulette].map(|plan| walks(10, 8, None, 1).streams(&scene, plan, &weights));
        assert!(surely != seldom, "roulette leaves out connections");
        assert_same_mean(&seldom, &surely, SHARP, &format!("columns {shining:?}"));
    }
}

#[test]
fn later_vertices_may_connect_to_few_columns_or_to_all() {
    let scene = room_with_large_lights(4);
    let plan = MatrixPlan::new(&scene.lighting, Density::Full);
    let weights = file_light(&scene);
    let by = |later, seed| walks(10, 12, Some(3), seed).streams(&scene, &Always { plan: &plan, later }, &weights);
    assert_same_mean(&by(Vertex::Close, 1), &by(Vertex::Later, 2), SHARP, "close or later");
}

#[test]
fn a_wall_beside_a_panel_is_close_to_it() {
    let scene = room_with_everything();
    let roulette = MatrixPlan::new(&scene.lighting, Density::Full).with_roulette(&column_scale(&scene));
    // The panel stands off its wall by 10 cm and off floor and back wall as much.
    let (beside, far) = (Vec3::new(-1.85, -1.2, -1.0), Vec3::new(1.9, 0.0, 1.4));
    assert_eq!(roulette.later(beside, || 0.2), Vertex::Close);
    assert_eq!(roulette.later(far, || 0.2), Vertex::Later);
    assert_eq!(MatrixPlan::new(&scene.lighting, Density::Full).later(beside, || 0.2), Vertex::Later);
}
