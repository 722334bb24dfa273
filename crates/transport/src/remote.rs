//! Scenes so far from the origin that their coordinates are coarse.

use crate::scene::Scene;

/// How far off a scene may lie: m, and its own diagonals.
const FAR_M: f32 = 1e4;
const FAR_EXTENTS: f32 = 100.0;

/// A sentence about a scene that lies too far off.
pub(crate) fn warning(scene: &Scene) -> Option<String> {
    let (low, high) = scene.mesh.bounds()?;
    let middle = 0.5 * (low + high);
    let distance = middle.length();
    if distance <= FAR_M || distance <= FAR_EXTENTS * low.distance(high) {
        return None;
    }
    let largest = low.abs().max(high.abs()).max_element();
    let [x, y, z] = middle.to_array().map(|along| -along.round());
    Some(format!(
        "the scene lies {:.0} km from the origin, where coordinates are {:.2} m apart, so that shapes and shadows are not exact: \
         move it to the origin before it is exported, or move its root node by ({x}, {y}, {z}) m",
        1e-3 * distance,
        largest.next_up() - largest
    ))
}
