//! Bench on its rug, reading table with books, vase and glass ball, and the plant.

use glam::{Quat, Vec3, vec3};

use super::Stage;
use crate::material::{Material, Sides};
use crate::mesh::Mesh;
use crate::shapes::{block, cylinder, lathe, leaf, picture, rounded_block, sphere};
use crate::textures::{self, random};

/// Where the reading table stands and how high its top is, in meters.
pub const TABLE: Vec3 = vec3(-1.75, 0.0, -1.3);
pub const TABLE_TOP_M: f32 = 0.75;
/// Where the bench stands.
pub const BENCH: Vec3 = vec3(0.75, 0.0, -0.7);

pub fn build(stage: &mut Stage) {
    rug(stage);
    bench(stage);
    table(stage);
    books(stage);
    glassware(stage);
    plant(stage);
}

/// A woven rug below the bench.
fn rug(stage: &mut Stage) {
    const HALF_M: Vec3 = vec3(1.15, 0.0, 1.6);
    const THICK_M: f32 = 0.012;
    let weave = stage.document.texture(textures::rug());
    let weave = Material { texture: Some(weave), ..Material::plain("wool", Vec3::ONE, 0.95) };
    let weave = stage.document.material(weave);
    let top =
        picture(vec3(-HALF_M.x, THICK_M, HALF_M.z), vec3(2.0 * HALF_M.x, 0.0, 0.0), vec3(0.0, 0.0, -2.0 * HALF_M.z));
    let edge = block(-HALF_M, vec3(HALF_M.x, THICK_M - 0.001, HALF_M.z));
    let mesh = stage.document.mesh("rug", &[(top, weave), (edge, stage.materials.stone)]);
    stage.place("rug", mesh, BENCH, Quat::IDENTITY);
}

fn bench(stage: &mut Stage) {
    let cushion = |z: f32| rounded_block(vec3(0.56, 0.13, 0.625), 0.035).tiled(4.0).at(0.0, 0.415, z);
    let cushions = Mesh::join([cushion(-0.63), cushion(0.0), cushion(0.63)]);
    let base = rounded_block(vec3(0.52, 0.06, 1.86), 0.008).at(0.0, 0.32, 0.0);
    let leg = |x: f32, z: f32| block(vec3(x - 0.015, 0.0, z - 0.015), vec3(x + 0.015, 0.3, z + 0.015));
    let frame = Mesh::join([leg(-0.2, -0.85), leg(0.2, -0.85), leg(-0.2, 0.85), leg(0.2, 0.85)]);
    let m = &stage.materials;
    let mesh = stage.document.mesh("bench", &[(cushions, m.leather), (base, m.oak), (frame, m.black)]);
    stage.place("bench", mesh, BENCH, Quat::IDENTITY);
}

fn table(stage: &mut Stage) {
    let top = rounded_block(vec3(0.82, 0.04, 2.5), 0.012).at(0.0, TABLE_TOP_M - 0.02, 0.0);
    // A trestle at each end: two uprights and a foot.
    let trestle = |z: f32| {
        let bar =
            |low: (f32, f32), high: (f32, f32)| block(vec3(low.0, low.1, z - 0.02), vec3(high.0, high.1, z + 0.02));
        Mesh::join([
            bar((-0.33, 0.0), (-0.29, 0.71)),
            bar((0.29, 0.0), (0.33, 0.71)),
            bar((-0.33, 0.0), (0.33, 0.03)),
            bar((-0.33, 0.68), (0.33, 0.71)),
        ])
    };
    let legs = Mesh::join([trestle(-1.0), trestle(1.0)]);
    let m = &stage.materials;
    let mesh = stage.document.mesh("reading table", &[(top, m.oak), (legs, m.black)]);
    stage.place("reading table", mesh, TABLE, Quat::IDENTITY);
}

fn books(stage: &mut Stage) {
    let covers = [
        ("linen red", vec3(0.42, 0.06, 0.045), (0.22, 0.03, 0.29), 0.12),
        ("linen ochre", vec3(0.55, 0.33, 0.07), (0.20, 0.025, 0.27), -0.09),
        ("linen blue", vec3(0.04, 0.11, 0.24), (0.17, 0.035, 0.24), 0.3),
    ];
    let mut height = TABLE_TOP_M;
    let mut parts = Vec::new();
    for (name, color, (width, thickness, length), turn) in covers {
        let cover = stage.document.material(Material::plain(name, color, 0.8));
        let book = rounded_block(vec3(width, thickness, length), 0.004).turned(Quat::from_rotation_y(turn));
        parts.push((book.at(0.0, height + thickness / 2.0, 0.0), cover));
        height += thickness;
    }
    let mesh = stage.document.mesh("books", &parts);
    stage.place("books", mesh, TABLE + vec3(0.1, 0.0, 0.62), Quat::IDENTITY);
}

fn glassware(stage: &mut Stage) {
    // Up the outside, over the lip, down the inside: one closed solid.
    let profile = [
        (0.0, 0.0),
        (0.05, 0.0),
        (0.058, 0.006),
        (0.075, 0.06),
        (0.086, 0.11),
        (0.085, 0.15),
        (0.07, 0.20),
        (0.05, 0.24),
        (0.04, 0.275),
        (0.042, 0.305),
        (0.056, 0.335),
        (0.053, 0.3375),
        (0.049, 0.335),
        (0.036, 0.305),
        (0.034, 0.275),
        (0.044, 0.24),
        (0.064, 0.20),
        (0.079, 0.15),
        (0.08, 0.11),
        (0.069, 0.06),
        (0.05, 0.025),
        (0.0, 0.02),
    ];
    let vase = stage.document.mesh("vase", &[(lathe(&profile, 56), stage.materials.solid_glass)]);
    stage.place("vase", vase, TABLE + vec3(-0.02, TABLE_TOP_M + 0.0005, -0.15), Quat::IDENTITY);
    let ball = stage.document.mesh("glass ball", &[(sphere(0.085, 64), stage.materials.solid_glass)]);
    stage.place("glass ball", ball, TABLE + vec3(0.2, TABLE_TOP_M + 0.0855, 0.2), Quat::IDENTITY);
}

/// A rubber tree in a clay pot: three stems with leaves in spirals.
fn plant(stage: &mut Stage) {
    let pot = lathe(
        &[
            (0.0, 0.0),
            (0.15, 0.0),
            (0.17, 0.02),
            (0.205, 0.36),
            (0.205, 0.38),
            (0.185, 0.38),
            (0.18, 0.33),
            (0.0, 0.33),
        ],
        48,
    );
    let stems = [(0.0, 0.0, 1.35), (0.07, 2.3, 1.05), (0.06, 4.4, 0.85)];
    let mut wood = Vec::new();
    let mut leaves = Vec::new();
    for (index, (offset, turn, height)) in (0_i32..).zip(stems) {
        let tilt = Quat::from_rotation_y(turn) * Quat::from_rotation_z(-1.6 * offset);
        wood.push(cylinder(0.011, height, 10).turned(tilt).at(0.0, 0.32, 0.0));
        let n_leaves = (height * 17.0) as i32;
        for i in 0..n_leaves {
            let chance = |seed: u32| random(i, index, seed);
            let along = 0.3 + 0.7 * (i as f32 + 0.5) / n_leaves as f32;
            let rise = 0.35 + 0.8 * along * along + 0.25 * chance(1);
            let blade = leaf(0.28 + 0.08 * chance(2) - 0.08 * along, 0.155 - 0.04 * along, 0.8 + 0.5 * chance(3));
            let around = Quat::from_rotation_y(2.4 * i as f32 + 0.5 * chance(4)) * Quat::from_rotation_z(rise);
            let foot = tilt * vec3(0.0, along * height, 0.0);
            leaves.push(blade.turned(around).at(foot.x, foot.y + 0.32, foot.z));
        }
    }
    let green = Material { sides: Sides::Both, ..Material::plain("leaf", vec3(0.055, 0.16, 0.045), 0.32) };
    let green = stage.document.material(green);
    let bark = stage.document.material(Material::plain("bark", vec3(0.16, 0.11, 0.07), 0.8));
    let parts = [(pot, stage.materials.stone), (Mesh::join(wood), bark), (Mesh::join(leaves), green)];
    let mesh = stage.document.mesh("plant", &parts);
    stage.place("plant", mesh, vec3(-2.4, 0.0, 0.45), Quat::IDENTITY);
}
