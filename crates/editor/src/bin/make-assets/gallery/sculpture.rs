//! The chrome knot on its plinth.

use glam::{Quat, Vec3, vec3};

use super::Stage;
use crate::shapes::{rounded_block, torus_knot};

/// Center of the knot.
pub const KNOT: Vec3 = vec3(1.62, 1.38, -2.75);

pub fn build(stage: &mut Stage) {
    let plinth = rounded_block(vec3(0.42, 1.0, 0.42), 0.006);
    let plinth = stage.document.mesh("plinth", &[(plinth, stage.materials.white)]);
    stage.place("plinth", plinth, vec3(KNOT.x, 0.5, KNOT.z), Quat::from_rotation_y(0.35));
    let knot = torus_knot(2.0, 3.0, 0.32, 0.062);
    let knot = stage.document.mesh("chrome knot", &[(knot, stage.materials.chrome)]);
    stage.place("chrome knot", knot, KNOT, Quat::from_rotation_y(0.3));
}
