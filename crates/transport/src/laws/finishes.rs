//! Surfaces with a finish: however their lights are sampled, the mean is that of the plainest walk.

use glam::{Vec3, Vec4};

use super::stage::{Stage, lambert, quad, room};
use super::walks::{Even, Walks, assert_same_mean, file_light};
use crate::camera::{Camera, Film};
use crate::plan::{Density, MatrixPlan};
use crate::prepared::PreparedScene;
use crate::scene::{Finish, Material};

const FILM: Film = Film { width: 16, height: 12 };
/// Largest standard error of a difference of means, relative to the mean: four of them, 1 %, are what a test accepts.
const SHARP: f64 = 2.5e-3;

fn finished(material: Material, finish: Finish) -> Material {
    Material { finish: Some(Box::new(finish)), ..material }
}

fn leaf(share: f32) -> Finish {
    Finish { diffuse_transmission: share, ..Finish::default() }
}

/// A room with a lamp behind a leaf, a lacquered and a brushed plate, an iridescent pane and a wall of velvet. Its lights are so large
/// that walks alone find them often.
fn room_with_finishes() -> PreparedScene {
    let camera = Camera::look_at("eye", Vec3::new(1.7, 0.3, 1.2), Vec3::new(-0.6, -1.0, -0.6), 1.2, 4.0 / 3.0);
    let across = |corner: Vec3| quad(corner, Vec3::Y * 1.2, Vec3::Z * 1.4);
    let metal = Material { base_color: Vec4::new(0.8, 0.7, 0.6, 1.0), roughness: 0.4, ..Material::default() };
    let lacquer = Finish { clearcoat: 1.0, clearcoat_roughness: 0.4, ..Finish::default() };
    let mirror = Finish { clearcoat: 1.0, ..Finish::default() };
    let brushed = Finish { anisotropy: 0.7, iridescence: 0.5, ..Finish::default() };
    let velvet = Finish { sheen_color: Vec3::splat(0.8), sheen_roughness: 0.4, ..Finish::default() };
    let pane = Material { metallic: 0.0, roughness: 0.0, transmission: 0.8, ..Material::default() };
    Stage::new(camera)
        .surface("walls", &room(Vec3::new(2.0, 1.2, 1.5)), finished(lambert(0.5, 0.0), velvet))
        .panel("panel", &quad(Vec3::new(-1.9, -0.85, -1.2), Vec3::Y * 1.8, Vec3::Z * 2.4), 4.0, 4)
        .surface("leaf", &across(Vec3::new(-1.2, -1.15, -1.1)), finished(lambert(0.6, 0.0), leaf(0.5)))
        .surface("pane", &across(Vec3::new(-0.9, -1.15, 0.0)), finished(pane, Finish { iridescence: 1.0, ..leaf(0.5) }))
        .surface("lacquer", &quad(Vec3::new(-0.8, -1.1, -1.0), Vec3::Z, Vec3::X), finished(lambert(0.4, 0.0), lacquer))
        .surface("brushed", &quad(Vec3::new(-1.0, -0.8, -1.49), Vec3::X, Vec3::Y), finished(metal, brushed))
        .surface("glazed", &quad(Vec3::new(0.2, -0.8, -1.49), Vec3::X, Vec3::Y), finished(lambert(0.4, 0.0), mirror))
        .surface("light", &quad(Vec3::new(-1.0, 1.15, -1.2), Vec3::X * 2.8, Vec3::Z * 2.4), lambert(0.0, 3.0))
        .prepared()
}

/// A light inside a solid of wax that takes light away.
fn candle() -> PreparedScene {
    let camera = Camera::look_at("eye", Vec3::new(0.0, 0.5, 2.0), Vec3::ZERO, 0.4, 4.0 / 3.0);
    let outwards: Vec<Vec3> = room(Vec3::splat(0.5)).into_iter().rev().collect();
    let wax = Material { thickness: 1.0, attenuation_distance: 0.4, ..lambert(0.5, 0.0) };
    let wax = Material { attenuation_color: Vec3::splat(0.5), ..wax };
    Stage::new(camera)
        .surface("wax", &outwards, finished(wax, leaf(0.7)))
        .surface("flame", &quad(Vec3::new(-0.4, -0.4, 0.0), Vec3::X * 0.8, Vec3::Y * 0.8), lambert(0.0, 3.0))
        .prepared()
}

fn walks(spp: u32, seed: u64) -> Walks {
    Walks { film: FILM, streams: 9600, spp, bounces: Some(3), seed }
}

#[test]
fn finishes_have_the_mean_of_plain_walks() {
    let scene = room_with_finishes();
    let weights = file_light(&scene);
    let plain = walks(96, 1).plain(&scene, &weights);
    let n_cols = weights.len() as u32;
    let even = Even { n_cols, rate: 1.0, splits: 2 };
    assert_same_mean(&walks(12, 2).streams(&scene, &even, &weights), &plain, SHARP, "one pick of each column");
    let plan = MatrixPlan::new(&scene.lighting, Density::Full);
    assert_same_mean(&walks(12, 3).streams(&scene, &plan, &weights), &plain, SHARP, "the plan of a matrix");
}

#[test]
fn connections_through_a_solid_are_attenuated_as_walks_are() {
    let scene = candle();
    let weights = file_light(&scene);
    let by = |rate, spp, seed| {
        walks(spp, seed).streams(&scene, &Even { n_cols: weights.len() as u32, rate, splits: 1 }, &weights)
    };
    assert_same_mean(&by(1.0, 48, 2), &by(0.0, 128, 1), SHARP, "walks alone or connections");
}
