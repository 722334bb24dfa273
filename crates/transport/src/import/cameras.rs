//! Cameras of the file.

use glam::{DMat4, Mat4};
use gltf::json::{self, Index, Root};

use super::document::called;
use super::hierarchy::PlacedNode;
use super::report::Notes;
use crate::camera::Camera;

/// Vertical angles of view beyond these, in radians, show nothing useful.
const YFOV_RANGE_RAD: (f32, f32) = (0.01, 3.0);

/// Vertical angle of view where the file gives none that is one, radians: 50°.
const DEFAULT_YFOV_RAD: f32 = 0.872_664_6;

/// Width over height if the file leaves it open.
pub(super) const DEFAULT_ASPECT: f32 = 16.0 / 9.0;

/// The camera of a node, if it is a perspective one. `number` counts from 1, for cameras without a name.
pub(super) fn camera(
    document: &Root,
    index: Index<json::Camera>,
    placed: &PlacedNode,
    node_name: Option<&String>,
    number: usize,
    notes: &mut Notes,
) -> Option<Camera> {
    let Some(source) = document.get(index) else {
        notes.warn(format!("camera {index} does not exist: it is left out"));
        return None;
    };
    let line_name = called("camera", index.value(), source.name.as_ref().or(node_name));
    let Some(perspective) = &source.perspective else {
        notes.unsupported(format!("{line_name}: only perspective cameras are shown: it is left out"));
        return None;
    };
    let yfov_rad = match perspective.yfov {
        angle if angle > 0.0 && angle.is_finite() => angle.clamp(YFOV_RANGE_RAD.0, YFOV_RANGE_RAD.1),
        _ => DEFAULT_YFOV_RAD,
    };
    if yfov_rad != perspective.yfov {
        notes.warn(format!("{line_name}: its angle of view {} is out of range: {yfov_rad} is used", perspective.yfov));
    }
    let aspect = perspective.aspect_ratio.filter(|a| a.is_finite() && *a > 0.0).unwrap_or(DEFAULT_ASPECT);
    let named = |name: &&String| !name.is_empty();
    let name = source.name.as_ref().filter(named).or(node_name.filter(named));
    Some(Camera {
        name: name.cloned().unwrap_or_else(|| format!("camera {number}")),
        world_from_camera: rigid(placed),
        yfov_rad,
        aspect,
        shift: [0.0; 2],
    })
}

/// Rotation and translation alone: glTF lets no scale or shear of a node reach its camera.
fn rigid(placed: &PlacedNode) -> Mat4 {
    let [back, up] = placed.back_and(1);
    let right = up.cross(back);
    let eye = placed.world_from_node.w_axis.truncate();
    DMat4::from_cols(right.extend(0.0), up.extend(0.0), back.extend(0.0), eye.extend(1.0)).as_mat4()
}
