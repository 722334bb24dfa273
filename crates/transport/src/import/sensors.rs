//! Nodes that are no surfaces but sensors: `extras: {"clerestory": {"sensors": [16, 8]}}`.

use std::collections::BTreeMap;

use glam::Vec3;
use gltf::json::{Node, Root};
use serde_json::Value;

use super::document::called;
use super::geometry::Built;
use super::hierarchy::PlacedNode;
use super::report::Notes;
use crate::scene::{Mesh, Scene};
use crate::sensors::SensorGrid;

/// What a node's extras say to us under a key.
pub(super) fn extra(node: &Node, key: &str) -> Option<Value> {
    let extras: Value = serde_json::from_str(node.extras.as_ref()?.get()).ok()?;
    extras.get("clerestory")?.get(key).cloned()
}

/// Primitives of nodes that ask to be sensors, apart from the scene's mesh.
pub(super) struct Sensors {
    /// Points along both sides by index into `Scene::nodes`.
    sizes: BTreeMap<u32, [u32; 2]>,
    parts: BTreeMap<u32, Vec<Mesh>>,
}

impl Sensors {
    /// Which nodes ask; `indices` are those of placed nodes in `Scene::nodes`.
    pub(super) fn find(document: &Root, placed: &[PlacedNode], indices: &[Option<u32>], notes: &mut Notes) -> Sensors {
        let mut sizes = BTreeMap::new();
        for (placed, node_idx) in placed.iter().zip(indices) {
            let node = &document.nodes[placed.index];
            let Some((asked, node_idx)) = extra(node, "sensors").zip(*node_idx).filter(|_| node.mesh.is_some()) else {
                continue;
            };
            match size_of(&asked) {
                Some(size) => drop(sizes.insert(node_idx, size)),
                None => notes.warn(format!(
                    "{}: sensors of {asked} are not possible (two numbers of points, 1 to {}): it is a plain surface",
                    called("node", placed.index, node.name.as_ref()),
                    SensorGrid::MAX_SIDE,
                )),
            }
        }
        Sensors { sizes, parts: BTreeMap::new() }
    }

    /// Keeps the surface of a node that asks; that of any other is handed back.
    pub(super) fn take(&mut self, built: Built) -> Option<Mesh> {
        let node = built.mesh.triangle_node.first().copied();
        match node.filter(|node| self.sizes.contains_key(node)) {
            Some(node) => {
                self.parts.entry(node).or_default().push(built.mesh);
                None
            }
            None => Some(built.mesh),
        }
    }

    /// Lays the grids; what is no rectangle stays a surface and is handed back.
    #[expect(clippy::cast_possible_truncation, reason = "at most 2²⁶ triangles are read")]
    pub(super) fn lay(self, scene: &mut Scene, notes: &mut Notes) -> Vec<Mesh> {
        let mut surfaces = Vec::new();
        for (node, parts) in self.parts {
            let corners = |mesh: &Mesh| (0..mesh.triangles.len() as u32).map(|t| mesh.corners(t)).collect::<Vec<_>>();
            let triangles: Vec<[Vec3; 3]> = parts.iter().flat_map(corners).collect();
            let name = scene.nodes[node as usize].key();
            match SensorGrid::on_quad(&name, &triangles, self.sizes[&node]) {
                Ok(grid) => scene.sensors.push(grid),
                Err(reason) => {
                    notes.warn(format!("node `{name}` asks for sensors but {reason}: it is a plain surface"));
                    surfaces.extend(parts);
                }
            }
        }
        surfaces
    }
}

fn size_of(asked: &Value) -> Option<[u32; 2]> {
    let side = |value: &Value| {
        let side = u32::try_from(value.as_u64()?).ok()?;
        (1..=SensorGrid::MAX_SIDE).contains(&side).then_some(side)
    };
    match asked.as_array()?.as_slice() {
        [across, down] => Some([side(across)?, side(down)?]),
        _ => None,
    }
}
