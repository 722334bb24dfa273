//! Guided walks change the noise of caustics and nothing else.

use glam::{Vec3, Vec4};

use super::stage::{Stage, lambert, quad, room};
use super::walks::{Mean, Walks, assert_same_mean, file_light};
use crate::camera::{Camera, Film};
use crate::matrix::TransportMatrix;
use crate::plan::{Density, MatrixPlan};
use crate::prepared::PreparedScene;
use crate::scene::Material;

const FILM: Film = Film { width: 16, height: 12 };
const MIRROR: f32 = 0.0;

/// The corners of a box, counter-clockwise seen from outside.
fn block(low: Vec3, high: Vec3) -> Vec<Vec3> {
    let side = high - low;
    let [x, y, z] = [Vec3::X * side.x, Vec3::Y * side.y, Vec3::Z * side.z];
    let faces = [quad(low, y, x), quad(low, z, y), quad(low, x, z)];
    let opposite = [quad(high, -x, -y), quad(high, -y, -z), quad(high, -z, -x)];
    faces.into_iter().chain(opposite).flatten().collect()
}

/// A camera that looks at the floor of a room with a panel under its ceiling, beside which stands something small.
fn room_beside(name: &str, corners: &[Vec3], material: Material) -> PreparedScene {
    let camera = Camera::look_at("eye", Vec3::new(1.7, 0.3, 1.2), Vec3::new(-0.3, -1.2, 0.0), 0.9, 4.0 / 3.0);
    Stage::new(camera)
        .surface("walls", &room(Vec3::new(2.0, 1.2, 1.5)), lambert(0.6, 0.0))
        .panel("panel", &quad(Vec3::new(-0.6, 1.15, -0.5), Vec3::X * 0.8, Vec3::Z * 0.8), 4.0, 6)
        .surface(name, corners, material)
        .prepared()
}

fn metal(roughness: f32) -> Material {
    Material { base_color: Vec4::new(0.9, 0.9, 0.9, 1.0), roughness, double_sided: true, ..Material::default() }
}

fn glass() -> Material {
    let base_color = Vec4::ONE;
    Material { base_color, metallic: 0.0, transmission: 1.0, roughness: 0.0, thickness: 0.1, ..Material::default() }
}

fn small_mirror(roughness: f32) -> PreparedScene {
    // It leans, so that it throws the panel's light on the floor before it.
    let corners = quad(Vec3::new(-1.2, -1.0, -0.2), Vec3::Z * 0.4, Vec3::new(-0.2, 0.35, 0.0));
    room_beside("mirror", &corners, metal(roughness))
}

fn small_block() -> PreparedScene {
    // Not a slab: its sides are seen, too.
    let corners = block(Vec3::new(-0.4, -1.1, -0.2), Vec3::new(-0.1, -0.7, 0.2));
    room_beside("block", &corners, glass())
}

fn fitted_plan(scene: &PreparedScene) -> MatrixPlan {
    let plan = MatrixPlan::new(&scene.lighting, Density::Full);
    let scale = TransportMatrix::new(scene, &plan, scene.scene.cameras[0].clone(), FILM, None, 3).measure_columns().0;
    MatrixPlan::new(&scene.lighting, Density::Full).with_roulette(&scale)
}

fn streams(scene: &PreparedScene, weights: &[f32], (seed, spp): (u64, u32)) -> Vec<f64> {
    let walks = Walks { film: FILM, streams: 9600, spp, bounces: None, seed };
    walks.streams(scene, &fitted_plan(scene), weights)
}

#[test]
fn guided_walks_keep_the_mean() {
    for (scene, what) in
        [(small_mirror(MIRROR), "a mirror"), (small_mirror(0.25), "rough metal"), (small_block(), "glass")]
    {
        assert!(scene.casters.is_some(), "{what} throws light");
        let weights = file_light(&scene);
        let guided = streams(&scene, &weights, (1, 4));
        let unguided = streams(&scene.without_guides(), &weights, (2, 24));
        assert_same_mean(&guided, &unguided, 1e-2, what);
    }
}

#[test]
fn guided_walks_take_two_thirds_of_the_variance_out_of_caustics() {
    // Of a single texel, two runs against each other.
    let noise = |scene: &PreparedScene| {
        let n_cols = scene.lighting.basis.n_cols();
        let weights: Vec<f32> = (0..n_cols).map(|column| f32::from(column == n_cols / 2)).collect();
        let [a, b] = [1, 2].map(|seed| streams(scene, &weights, (seed, 4)));
        Mean::of(&a.iter().zip(&b).map(|(a, b)| a - b).collect::<Vec<f64>>()).error
    };
    let scene = small_mirror(MIRROR);
    let guided = noise(&scene);
    let unguided = noise(&scene.without_guides());
    assert!(guided < 0.55 * unguided, "{guided} beside {unguided}");
}

#[test]
fn scenes_that_throw_no_light_have_no_guides() {
    let floor = quad(Vec3::new(-2.0, -1.2, 1.5), Vec3::X * 4.0, Vec3::Z * -3.0);
    let camera = || Camera::look_at("eye", Vec3::Y, Vec3::ZERO, 0.9, 4.0 / 3.0);
    let diffuse = room_beside("shelf", &floor, lambert(0.5, 0.0));
    assert!(diffuse.casters.is_none(), "nothing of it throws light");
    // A walk never meets a lamp without size.
    let mirror = quad(Vec3::new(-1.2, -1.0, -0.2), Vec3::Z * 0.4, Vec3::new(-0.2, 0.35, 0.0));
    let lamp = Stage::new(camera()).surface("floor", &floor, lambert(0.5, 0.0)).surface("mirror", &mirror, metal(0.0));
    let lamp = lamp.lamp("lamp", Vec3::Y * 2.0, 100.0).prepared();
    assert!(lamp.casters.is_none(), "its light cannot be met");
}
