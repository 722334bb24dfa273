//! The lights: daylight, panel, pendants, track spots, washer, strips and lamps. Intensities in nit and candela.

use glam::{Quat, Vec3, vec3};

use super::furniture::{BENCH, TABLE, TABLE_TOP_M};
use super::pictures::{HUNG_Z, LARGE, LARGE_SIZE_M};
use super::room::{OPENING_Y, OPENING_Z, REVEAL_M};
use super::sculpture::KNOT;
use super::{HIGH, LOW, Stage, facing};
use crate::glb::{Node, Spot};
use crate::material::{Material, tint};
use crate::mesh::Mesh;
use crate::shapes::{block, cylinder, lathe, picture, quad, rounded_block, sphere};

pub fn build(stage: &mut Stage) {
    daylight(stage);
    ceiling_panel(stage);
    pendants(stage);
    track(stage);
    wall_washer(stage);
    cove(stage);
    bench_light(stage);
    floor_lamp(stage);
    desk_lamp(stage);
    porch_light(stage);
}

/// Three panes of sky behind the mullions.
fn daylight(stage: &mut Stage) {
    let sky = stage.document.material(Material::emitter("sky", 700.0, 7500.0));
    let width = (OPENING_Z.1 - OPENING_Z.0) / 3.0;
    let height = OPENING_Y.1 - OPENING_Y.0;
    let pane = picture(Vec3::ZERO, vec3(0.0, 0.0, -width), vec3(0.0, height, 0.0));
    let mesh = stage.document.mesh("clerestory pane", &[(pane, sky)]);
    for i in 0_u8..3 {
        let place = vec3(LOW.x - REVEAL_M, OPENING_Y.0, OPENING_Z.0 + width * f32::from(i + 1));
        stage.place(&format!("clerestory {}", i + 1), mesh, place, Quat::IDENTITY);
    }
}

/// A luminous panel of 1.6 m × 1.6 m in a slim frame, hung below the beams.
fn ceiling_panel(stage: &mut Stage) {
    const HALF_M: f32 = 0.8;
    const RIM_M: f32 = 0.03;
    let light = stage.document.material(Material::emitter("panel light", 400.0, 4000.0));
    let (outer, thick) = (HALF_M + RIM_M, 0.06);
    let bar = |low: (f32, f32), high: (f32, f32)| block(vec3(low.0, -0.004, low.1), vec3(high.0, thick, high.1));
    let rod = |x: f32, z: f32| cylinder(0.005, HIGH.y - 3.34 - thick, 8).at(x, thick, z);
    let housing = Mesh::join([
        bar((-outer, -outer), (outer, -HALF_M)),
        bar((-outer, HALF_M), (outer, outer)),
        bar((-outer, -HALF_M), (-HALF_M, HALF_M)),
        bar((HALF_M, -HALF_M), (outer, HALF_M)),
        block(vec3(-HALF_M, 0.01, -HALF_M), vec3(HALF_M, thick, HALF_M)),
    ]);
    let rods = Mesh::join([rod(-0.7, -0.7), rod(0.7, -0.7), rod(-0.7, 0.7), rod(0.7, 0.7)]);
    let mesh = stage.document.mesh("panel housing", &[(Mesh::join([housing, rods]), stage.materials.black)]);
    let place = vec3(0.35, 3.34, -1.5);
    stage.place("panel housing", mesh, place, Quat::IDENTITY);
    let face = picture(vec3(-HALF_M, 0.0, -HALF_M), vec3(2.0 * HALF_M, 0.0, 0.0), vec3(0.0, 0.0, 2.0 * HALF_M));
    let mesh = stage.document.panel_mesh("ceiling panel", &[(face, light)]);
    let name = "ceiling panel".to_owned();
    stage.document.node(Node { name, translation: place, mesh: Some(mesh), panel: Some(16), ..Node::default() });
}

/// Opal globes on brass stems above the reading table.
fn pendants(stage: &mut Stage) {
    const RADIUS_M: f32 = 0.12;
    let opal = stage.document.material(Material::emitter("opal glass", 2200.0, 2900.0));
    let globe = sphere(RADIUS_M, 32);
    let cap = lathe(&[(0.0, 0.09), (0.055, 0.09), (0.075, 0.097), (0.05, 0.14), (0.012, 0.15), (0.0, 0.15)], 32);
    let stem = cylinder(0.006, 1.75, 12).at(0.0, 0.13, 0.0);
    let rose = cylinder(0.06, 0.03, 32).at(0.0, 1.87, 0.0);
    let brass = Mesh::join([cap, stem, rose]);
    let mesh = stage.document.mesh("pendant", &[(globe, opal), (brass, stage.materials.brass)]);
    for i in 0_u8..3 {
        let z = TABLE.z + 0.8 * (f32::from(i) - 1.0);
        stage.place(&format!("pendant {}", i + 1), mesh, vec3(TABLE.x, 2.1, z), Quat::IDENTITY);
    }
}

/// A rail below the beams with four spots: three on the picture wall, one on the sculpture.
fn track(stage: &mut Stage) {
    const X: f32 = 1.75;
    const HEIGHT_M: f32 = 3.55;
    let rail = block(vec3(X - 0.018, 3.665, -3.9), vec3(X + 0.018, 3.70, 2.3));
    let rail = stage.document.mesh("track", &[(rail, stage.materials.black)]);
    stage.place("track", rail, Vec3::ZERO, Quat::IDENTITY);
    // The lamp sits just before the open end of a can that lies behind it.
    let can = lathe(&[(0.036, 0.03), (0.042, 0.0), (0.042, 0.17), (0.0, 0.17)], 32);
    let lens = cylinder(0.037, 0.01, 32).at(0.0, 0.03, 0.0);
    let can = Mesh::join([can, lens]).turned(Quat::from_rotation_x(std::f32::consts::FRAC_PI_2)).at(0.0, 0.0, 0.012);
    let can = stage.document.mesh("spot can", &[(can, stage.materials.black)]);
    let stem = cylinder(0.008, 3.67 - HEIGHT_M, 12);
    let stem = stage.document.mesh("spot stem", &[(stem, stage.materials.black)]);
    let picture = |z: f32| (vec3(X, HEIGHT_M, z), vec3(HIGH.x, 1.62, z));
    let knot = (vec3(X, HEIGHT_M, -0.6), KNOT);
    let aims = [picture(HUNG_Z[0]), picture(HUNG_Z[1]), picture(HUNG_Z[2]), knot];
    for (i, (place, target)) in (1..).zip(aims) {
        let rotation = facing(target - place);
        let back = rotation * vec3(0.0, 0.0, 0.1);
        stage.place(&format!("spot {i} stem"), stem, place + back, Quat::IDENTITY);
        // glTF wants colors of at most 1: the strongest channel goes into the intensity.
        let (warm, strongest) = (tint(3500.0), tint(3500.0).max_element());
        let spot = Spot { color: warm / strongest, candela: 3000.0 * strongest, inner_rad: 0.14, outer_rad: 0.36 };
        let (mesh, spot) = (Some(can), Some(spot));
        let name = format!("spot {i}");
        stage.document.node(Node { name, translation: place, rotation, mesh, spot, ..Node::default() });
    }
}

/// A slim profile above the large picture that shines down the wall.
fn wall_washer(stage: &mut Stage) {
    let light = stage.document.material(Material::emitter("washer light", 11000.0, 3200.0));
    let half = LARGE_SIZE_M.0 / 2.0;
    let face = picture(vec3(-half, 0.0, -0.02), vec3(2.0 * half, 0.0, 0.0), vec3(0.0, 0.0, 0.04));
    let housing = block(vec3(-half - 0.02, 0.004, -0.028), vec3(half + 0.02, 0.05, 0.028));
    let arm = |x: f32| block(vec3(x - 0.01, 0.02, -0.38), vec3(x + 0.01, 0.04, 0.0));
    let tilt = Quat::from_rotation_x(0.5);
    let metal = Mesh::join([housing.turned(tilt), arm(-half * 0.8), arm(half * 0.8)]);
    let mesh = stage.document.mesh("wall washer", &[(face.turned(tilt), light), (metal, stage.materials.black)]);
    stage.place("wall washer", mesh, vec3(LARGE.x, 3.05, LOW.z + 0.36), Quat::IDENTITY);
}

/// A ledge along the top of the picture wall with a strip that shines up to the ceiling.
fn cove(stage: &mut Stage) {
    let light = stage.document.material(Material::emitter("cove light", 2500.0, 2900.0));
    let ledge = Mesh::join([
        block(vec3(2.84, 3.40, LOW.z - 0.01), vec3(HIGH.x + 0.01, 3.42, HIGH.z + 0.01)),
        block(vec3(2.84, 3.42, LOW.z - 0.01), vec3(2.855, 3.47, HIGH.z + 0.01)),
    ]);
    let length = HIGH.z - LOW.z - 0.4;
    let strip = quad(vec3(2.9, 3.43, HIGH.z - 0.2), vec3(0.05, 0.0, 0.0), vec3(0.0, 0.0, -length));
    let mesh = stage.document.mesh("cove", &[(strip, light), (ledge, stage.materials.white)]);
    stage.place("cove", mesh, Vec3::ZERO, Quat::IDENTITY);
}

/// A strip under the bench.
fn bench_light(stage: &mut Stage) {
    let light = stage.document.material(Material::emitter("bench light", 700.0, 2700.0));
    let strip = quad(vec3(-0.06, 0.285, -0.85), vec3(0.12, 0.0, 0.0), vec3(0.0, 0.0, 1.7));
    let mesh = stage.document.mesh("bench light", &[(strip, light)]);
    stage.place("bench light", mesh, BENCH, Quat::IDENTITY);
}

/// A standing lamp with a linen shade that glows.
fn floor_lamp(stage: &mut Stage) {
    let linen = stage.document.material(Material::emitter("linen shade", 1300.0, 2700.0));
    let shade = lathe(&[(0.19, 1.38), (0.15, 1.68)], 48);
    let foot = lathe(&[(0.0, 0.0), (0.14, 0.0), (0.145, 0.012), (0.13, 0.02), (0.012, 0.03), (0.0, 0.03)], 48);
    let pole = cylinder(0.009, 1.56, 16);
    let lids = Mesh::join([
        lathe(&[(0.0, 1.40), (0.186, 1.40), (0.186, 1.405), (0.0, 1.405)], 48),
        lathe(&[(0.0, 1.66), (0.1515, 1.66), (0.1515, 1.665), (0.0, 1.665)], 48),
    ]);
    let m = &stage.materials;
    let parts = [(shade, linen), (Mesh::join([foot, pole]), m.brass), (lids, m.white)];
    let mesh = stage.document.mesh("floor lamp", &parts);
    stage.place("floor lamp", mesh, vec3(2.5, 0.0, -4.05), Quat::IDENTITY);
}

/// A mushroom of opal glass on the reading table.
fn desk_lamp(stage: &mut Stage) {
    let opal = stage.document.material(Material::emitter("desk lamp opal", 2500.0, 2700.0));
    let dome = lathe(&[(0.13, 0.22), (0.128, 0.25), (0.11, 0.295), (0.075, 0.325), (0.035, 0.34), (0.0, 0.343)], 40);
    let brass = lathe(
        &[(0.0, 0.0), (0.075, 0.0), (0.075, 0.012), (0.012, 0.022), (0.012, 0.218), (0.128, 0.22), (0.0, 0.224)],
        40,
    );
    let mesh = stage.document.mesh("desk lamp", &[(dome, opal), (brass, stage.materials.brass)]);
    stage.place("desk lamp", mesh, TABLE + vec3(-0.12, TABLE_TOP_M, -0.95), Quat::IDENTITY);
}

/// A wall light in the porch behind the glass screen.
fn porch_light(stage: &mut Stage) {
    let opal = stage.document.material(Material::emitter("porch opal", 2200.0, 2900.0));
    let tube = rounded_block(vec3(0.07, 0.42, 0.07), 0.034);
    let plate = block(vec3(-0.05, -0.06, -0.06), vec3(-0.03, 0.06, 0.06));
    let mesh = stage.document.mesh("porch light", &[(tube, opal), (plate, stage.materials.brass)]);
    stage.place("porch light", mesh, vec3(LOW.x + 0.05, 1.75, -3.85), Quat::IDENTITY);
}
