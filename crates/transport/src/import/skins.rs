//! Skins: vertices that hang on joints, nodes of the file, and stand where these do. \[glTF2, §3.7.3.3\]

use std::collections::HashMap;

use glam::{DMat4, Mat4};
use gltf::Semantic;
use gltf::json::Node;
use gltf::json::mesh::Primitive;
use serde::Deserialize;

use super::accessor::{Integers, Reader};
use super::geometry::attribute;
use super::hierarchy::PlacedNode;
use super::report::Notes;

/// Most matrices of a skin: vertices name joints by 16 bits.
const MAX_JOINTS: u64 = 1 << 16;

/// A skin as the file has it.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Skin {
    joints: Vec<usize>,
    inverse_bind_matrices: Option<usize>,
}

impl Skin {
    /// World from mesh, one for each joint, for a vertex that hangs on it alone.
    fn world_from_mesh(&self, reader: &Reader, placed: &[PlacedNode]) -> Result<Vec<DMat4>, String> {
        let joint_from_mesh = self.inverse_bind_matrices.map(|accessor| matrices(reader, accessor)).transpose()?;
        if let Some(matrices) = joint_from_mesh.as_ref().filter(|matrices| matrices.len() < self.joints.len()) {
            return Err(format!("its skin has {} matrices for {} joints", matrices.len(), self.joints.len()));
        }
        if self.joints.is_empty() {
            return Err("its skin has no joints".to_owned());
        }
        let of_joint = |(nth, node): (usize, &usize)| {
            let at = placed.binary_search_by_key(node, |placed| placed.index);
            let at = at.map_err(|_| format!("node {node}, a joint of its skin, is not part of the scene"))?;
            let world_from_joint = placed[at].world_from_node;
            let world_from_mesh = joint_from_mesh.as_ref().map_or(world_from_joint, |all| world_from_joint * all[nth]);
            let is_finite = world_from_mesh.as_mat4().is_finite();
            is_finite.then_some(world_from_mesh).ok_or_else(|| format!("joint {nth} of its skin is not finite"))
        };
        self.joints.iter().enumerate().map(of_joint).collect()
    }
}

fn matrices(reader: &Reader, accessor: usize) -> Result<Vec<DMat4>, String> {
    if !reader.has_bytes(accessor) || reader.n_elements(accessor) > MAX_JOINTS {
        return Err(format!("accessor {accessor} does not hold the matrices of its skin"));
    }
    let columns = reader.floats::<16>(accessor, Integers::AsDeclared)?;
    Ok(columns.iter().map(|columns| Mat4::from_cols_array(columns).as_dmat4()).collect())
}

/// The skins of visible nodes with their joints in the world, or why they cannot be used.
pub(super) struct Skeletons(HashMap<usize, Result<Vec<DMat4>, String>>);

impl Skeletons {
    /// Joints stand as the nodes of the file say: animations are not played.
    pub fn place(reader: &Reader, skins: &[Option<Skin>], placed: &[PlacedNode]) -> Skeletons {
        let mut skeletons = HashMap::new();
        for node in placed.iter().filter(|node| node.visible).map(|node| &reader.document.nodes[node.index]) {
            let Some(skin) = node.skin.filter(|_| node.mesh.is_some()).map(|skin| skin.value()) else { continue };
            skeletons.entry(skin).or_insert_with(|| match skins.get(skin) {
                Some(Some(skin)) => skin.world_from_mesh(reader, placed),
                Some(None) => Err(format!("skin {skin} cannot be read")),
                None => Err(format!("skin {skin} does not exist")),
            });
        }
        Skeletons(skeletons)
    }

    /// World from mesh for each joint of a node's skin; `None` without one, and with a line in `notes` where it is of no use.
    pub fn of(&self, node: &Node, name: &str, notes: &mut Notes) -> Option<&[DMat4]> {
        match self.0.get(&node.skin?.value())? {
            Ok(joints) => Some(joints),
            Err(reason) => {
                ignored(name, reason, notes);
                None
            }
        }
    }
}

/// A line about a skeleton that cannot be used.
pub(super) fn ignored(name: &str, reason: &str, notes: &mut Notes) {
    notes.warn(format!("{name}: {reason}: its skeleton is ignored, it stands where its node does"));
}

/// Joints that a vertex hangs on, by their places in the skin, and how much on each; those without weight count for nothing.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bones {
    joints: [u16; 4],
    weights: [f32; 4],
}

impl Bones {
    fn pulls(&self) -> impl Iterator<Item = (usize, f64)> {
        self.joints.into_iter().map(usize::from).zip(self.weights.map(f64::from))
    }
}

/// Bones of the vertices of a primitive, the second four of each apart; every joint with weight exists.
pub(super) fn bones(
    reader: &Reader,
    primitive: &Primitive,
    n_vertices: usize,
    n_joints: usize,
) -> Result<[Vec<Bones>; 2], String> {
    let set = |set: u32| {
        let accessors = (attribute(primitive, Semantic::Joints(set)), attribute(primitive, Semantic::Weights(set)));
        let (Some(joints), Some(weights)) = accessors else { return Ok(Vec::new()) };
        let joints = reader.floats::<4>(joints, Integers::AsDeclared)?;
        let weights = reader.floats::<4>(weights, Integers::Normalized)?;
        if joints.len() != n_vertices || weights.len() != n_vertices {
            return Err(format!("{} joints and {} weights for {n_vertices} vertices", joints.len(), weights.len()));
        }
        Ok(joints.into_iter().zip(weights).map(bones_of).collect())
    };
    let sets = [set(0)?, set(1)?];
    if sets[0].is_empty() {
        return Err("its vertices name no joints".to_owned());
    }
    let hangs_beyond = |&(joint, weight): &(usize, f64)| weight > 0.0 && joint >= n_joints;
    let beyond = sets.iter().flatten().flat_map(Bones::pulls).find(hangs_beyond);
    match beyond {
        Some((joint, _)) => Err(format!("a vertex hangs on joint {joint} of {n_joints}")),
        None => Ok(sets),
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "glTF has joints in 8 or 16 bits")]
fn bones_of((joints, weights): ([f32; 4], [f32; 4])) -> Bones {
    let sane = |weight: f32| if weight.is_finite() { weight.max(0.0) } else { 0.0 };
    Bones { joints: joints.map(|joint| joint as u16), weights: weights.map(sane) }
}

/// World from mesh at a vertex: the mean of its joints by weight, and its first joint where nothing has weight.
pub(super) fn blended(bones: [Option<&Bones>; 2], joints: &[DMat4]) -> DMat4 {
    let pulls = || bones.into_iter().flatten().flat_map(Bones::pulls);
    let total: f64 = pulls().map(|(_, weight)| weight).sum();
    if total > 0.0 {
        let weighted =
            pulls().filter(|&(_, weight)| weight > 0.0).map(|(joint, weight)| joints[joint] * (weight / total));
        return weighted.fold(DMat4::ZERO, |sum, joint| sum + joint);
    }
    let first = pulls().next().and_then(|(joint, _)| joints.get(joint));
    *first.unwrap_or(&joints[0])
}
