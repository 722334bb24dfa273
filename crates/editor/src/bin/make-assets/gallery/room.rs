//! Shell of the gallery: floor, walls with the window reveal, slats, ceiling with beams, door, glass screen.

use glam::{Quat, Vec3, vec3};

use super::{HIGH, LOW, Stage};
use crate::material::Material;
use crate::mesh::Mesh;
use crate::shapes::{block, cylinder, quad, rounded_block};

/// The clerestory: extent along z and y of the opening in the wall x = −3, and depth of its reveal, in meters.
pub const OPENING_Z: (f32, f32) = (-3.6, 1.8);
pub const OPENING_Y: (f32, f32) = (2.62, 3.5);
pub const REVEAL_M: f32 = 0.3;

/// Meters that a tile of the plaster's and of the floor's texture covers.
const PLASTER_TILE_M: f32 = 1.5;
const FLOOR_TILE_M: f32 = 2.4;

pub fn build(stage: &mut Stage) {
    shell(stage);
    beams(stage);
    slats(stage);
    mullions(stage);
    door(stage);
    screen(stage);
}

fn shell(stage: &mut Stage) {
    let size = HIGH - LOW;
    let (across, up, along) = (vec3(size.x, 0.0, 0.0), vec3(0.0, size.y, 0.0), vec3(0.0, 0.0, size.z));
    let floor = quad(vec3(LOW.x, LOW.y, HIGH.z), across, -along).tiled(1.0 / FLOOR_TILE_M);
    let ceiling = quad(vec3(LOW.x, HIGH.y, LOW.z), across, along);
    let walls = Mesh::join([
        quad(vec3(HIGH.x, LOW.y, HIGH.z), -across, up),
        quad(vec3(HIGH.x, LOW.y, LOW.z), along, up),
        window_wall(),
    ]);
    let walls = walls.tiled(1.0 / PLASTER_TILE_M);
    let back = quad(LOW, across, up).tiled(1.0 / PLASTER_TILE_M);
    let matte = stage.document.material(Material::plain("ceiling paint", vec3(0.82, 0.815, 0.8), 0.9));
    let m = &stage.materials;
    let parts = [(floor, m.floor), (walls, m.plaster), (back, m.accent), (ceiling, matte), (skirting(), m.white)];
    let mesh = stage.document.mesh("shell", &parts);
    stage.place("shell", mesh, Vec3::ZERO, Quat::IDENTITY);
}

/// The wall x = −3 as nine fields without the middle one, and the four sides of the reveal.
fn window_wall() -> Mesh {
    let z = [LOW.z, OPENING_Z.0, OPENING_Z.1, HIGH.z];
    let y = [LOW.y, OPENING_Y.0, OPENING_Y.1, HIGH.y];
    let fields = (0..9).filter(|field| *field != 4).map(|field| {
        let (i, j) = (field % 3, field / 3);
        quad(vec3(LOW.x, y[j], z[i + 1]), vec3(0.0, 0.0, z[i] - z[i + 1]), vec3(0.0, y[j + 1] - y[j], 0.0))
    });
    let corner = |y: f32, z: f32| vec3(LOW.x, y, z);
    let outward = vec3(-REVEAL_M, 0.0, 0.0);
    let (width, height) = (vec3(0.0, 0.0, OPENING_Z.1 - OPENING_Z.0), vec3(0.0, OPENING_Y.1 - OPENING_Y.0, 0.0));
    let reveal = [
        quad(corner(OPENING_Y.0, OPENING_Z.0), outward, width),
        quad(corner(OPENING_Y.1, OPENING_Z.0), width, outward),
        quad(corner(OPENING_Y.0, OPENING_Z.0), height, outward),
        quad(corner(OPENING_Y.0, OPENING_Z.1), outward, height),
    ];
    Mesh::join(fields.chain(reveal))
}

fn skirting() -> Mesh {
    const HEIGHT_M: f32 = 0.09;
    const DEPTH_M: f32 = 0.015;
    let (low, high) = (LOW - 0.01, HIGH + 0.01);
    Mesh::join([
        block(vec3(low.x, low.y, low.z), vec3(LOW.x + DEPTH_M, HEIGHT_M, high.z)),
        block(vec3(HIGH.x - DEPTH_M, low.y, low.z), vec3(high.x, HEIGHT_M, high.z)),
        block(vec3(-1.68, low.y, low.z), vec3(high.x, HEIGHT_M, LOW.z + DEPTH_M)),
        block(vec3(low.x, low.y, HIGH.z - DEPTH_M), vec3(high.x, HEIGHT_M, high.z)),
    ])
}

fn beams(stage: &mut Stage) {
    let beam = block(vec3(LOW.x - 0.02, 3.7, -0.07), vec3(HIGH.x + 0.02, HIGH.y + 0.02, 0.07));
    let mesh = stage.document.mesh("beam", &[(beam, stage.materials.white)]);
    for i in 0_u8..6 {
        let z = -3.75 + 1.5 * f32::from(i);
        stage.place(&format!("beam {}", i + 1), mesh, vec3(0.0, 0.0, z), Quat::IDENTITY);
    }
}

/// Upright oak slats before the lower part of the window wall, closed by a cap.
fn slats(stage: &mut Stage) {
    const PITCH_M: f32 = 0.12;
    const WIDTH_M: f32 = 0.07;
    const DEPTH_M: f32 = 0.035;
    let (from, top) = (-3.1, 2.3);
    let n_slats = 50_u8;
    let slat = |i: u8| {
        let z = from + PITCH_M * f32::from(i);
        block(vec3(LOW.x - 0.01, 0.0, z), vec3(LOW.x + DEPTH_M, top, z + WIDTH_M))
    };
    let end = from + PITCH_M * f32::from(n_slats - 1) + WIDTH_M;
    let cap = block(vec3(LOW.x - 0.01, top, from), vec3(LOW.x + DEPTH_M + 0.01, top + 0.03, end));
    let mesh = Mesh::join((0..n_slats).map(slat).chain([cap]));
    let mesh = stage.document.mesh("slat wall", &[(mesh, stage.materials.oak)]);
    stage.place("slat wall", mesh, Vec3::ZERO, Quat::IDENTITY);
}

/// Frame and two mullions before the panes, and the sill.
fn mullions(stage: &mut Stage) {
    let (low, high) = (vec3(0.0, OPENING_Y.0, OPENING_Z.0), vec3(0.0, OPENING_Y.1, OPENING_Z.1));
    let (outer, inner) = (LOW.x - REVEAL_M - 0.01, LOW.x - REVEAL_M + 0.06);
    let bar = |y: (f32, f32), z: (f32, f32)| block(vec3(outer, y.0, z.0), vec3(inner, y.1, z.1));
    let step = (high.z - low.z) / 3.0;
    let upright = |z: f32| bar((low.y, high.y), (z - 0.025, z + 0.025));
    let frame = Mesh::join([
        bar((low.y - 0.01, low.y + 0.045), (low.z, high.z)),
        bar((high.y - 0.045, high.y + 0.01), (low.z, high.z)),
        upright(low.z + 0.02),
        upright(low.z + step),
        upright(low.z + 2.0 * step),
        upright(high.z - 0.02),
    ]);
    let mesh = stage.document.mesh("clerestory frame", &[(frame, stage.materials.black)]);
    stage.place("clerestory frame", mesh, Vec3::ZERO, Quat::IDENTITY);
}

fn door(stage: &mut Stage) {
    let wall = LOW.z;
    let rail =
        |x: (f32, f32), y: (f32, f32), depth: f32| block(vec3(x.0, y.0, wall - 0.01), vec3(x.1, y.1, wall + depth));
    let frame = Mesh::join([
        rail((-2.74, -2.66), (0.0, 2.18), 0.06),
        rail((-1.76, -1.68), (0.0, 2.18), 0.06),
        rail((-2.66, -1.76), (2.1, 2.18), 0.06),
    ]);
    let leaf = rail((-2.66, -1.76), (0.006, 2.1), 0.03);
    let lever = rounded_block(vec3(0.13, 0.022, 0.022), 0.009).at(-1.9, 1.05, wall + 0.075);
    let stem = cylinder(0.01, 0.05, 16).turned(Quat::from_rotation_x(1.570_796_4)).at(-1.85, 1.05, wall + 0.028);
    let m = &stage.materials;
    let parts = [(Mesh::join([frame, leaf]), m.oak), (Mesh::join([lever, stem]), m.brass)];
    let mesh = stage.document.mesh("door", &parts);
    stage.place("door", mesh, Vec3::ZERO, Quat::IDENTITY);
}

/// A glass screen in a steel frame that makes a porch of the corner before the door.
fn screen(stage: &mut Stage) {
    const Z: f32 = -3.2;
    const HALF_M: f32 = 0.02;
    let (left, right, top) = (LOW.x, -1.4, 2.35);
    let post = |x: f32| block(vec3(x - HALF_M, 0.0, Z - HALF_M), vec3(x + HALF_M, top, Z + HALF_M));
    let beam = |y: f32| block(vec3(left, y - HALF_M, Z - HALF_M), vec3(right + HALF_M, y + HALF_M, Z + HALF_M));
    let middle = (left + right) / 2.0;
    let frame = Mesh::join([post(left + 0.015), post(middle), post(right), beam(top), beam(0.03)]);
    let pane = quad(vec3(left, 0.03, Z), vec3(right - left, 0.0, 0.0), vec3(0.0, top - 0.03, 0.0));
    let m = &stage.materials;
    let mesh = stage.document.mesh("glass screen", &[(frame, m.black), (pane, m.pane)]);
    stage.place("glass screen", mesh, Vec3::ZERO, Quat::IDENTITY);
}
