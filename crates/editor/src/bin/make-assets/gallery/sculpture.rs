//! The bronze knot and the clay vessels on their plinths.

use glam::{Quat, Vec3, vec3};

use super::Stage;
use crate::shapes::{lathe, rounded_block, torus_knot};

/// Center of the knot.
pub const KNOT: Vec3 = vec3(1.62, 1.38, -2.75);

pub fn build(stage: &mut Stage) {
    knot(stage);
    vessels(stage);
}

fn knot(stage: &mut Stage) {
    let plinth = rounded_block(vec3(0.42, 1.0, 0.42), 0.006);
    let plinth = stage.document.mesh("plinth", &[(plinth, stage.materials.white)]);
    stage.place("plinth", plinth, vec3(KNOT.x, 0.5, KNOT.z), Quat::from_rotation_y(0.35));
    let knot = torus_knot(2.0, 3.0, 0.32, 0.062);
    let knot = stage.document.mesh("bronze knot", &[(knot, stage.materials.bronze)]);
    stage.place("bronze knot", knot, KNOT, Quat::from_rotation_y(0.3));
}

/// A tall amphora and a bowl on a low plinth.
fn vessels(stage: &mut Stage) {
    const TOP_M: f32 = 0.32;
    let plinth = rounded_block(vec3(0.95, TOP_M, 0.5), 0.006).at(0.0, TOP_M / 2.0, 0.0);
    let amphora = [
        (0.0, 0.0),
        (0.075, 0.0),
        (0.11, 0.08),
        (0.15, 0.2),
        (0.16, 0.27),
        (0.148, 0.34),
        (0.105, 0.41),
        (0.06, 0.455),
        (0.05, 0.5),
        (0.056, 0.54),
        (0.072, 0.56),
        (0.066, 0.56),
        (0.042, 0.5),
        (0.0, 0.49),
    ];
    let bowl = [
        (0.0, 0.0),
        (0.06, 0.0),
        (0.065, 0.02),
        (0.13, 0.075),
        (0.165, 0.14),
        (0.158, 0.14),
        (0.12, 0.08),
        (0.0, 0.03),
    ];
    let clay = lathe(&bowl, 56).at(0.24, TOP_M, 0.04);
    let glazed = lathe(&amphora, 56).at(-0.2, TOP_M, -0.02);
    let m = &stage.materials;
    let mesh = stage.document.mesh("vessels", &[(plinth, m.white), (glazed, m.glaze), (clay, m.stone)]);
    stage.place("vessels", mesh, vec3(-0.62, 0.0, -3.95), Quat::IDENTITY);
}
