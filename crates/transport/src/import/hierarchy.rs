//! Which nodes are shown, and where they stand.

use std::collections::BTreeSet;

use glam::{DMat3, DMat4, DQuat, DVec3};
use gltf::json::{Node, Root, Scene};
use serde_json::Value;

use super::accessor::{Integers, Reader};
use super::document::called;
use super::report::Notes;

/// A node of the displayed scene with its world transform.
#[derive(Clone, Debug)]
pub(super) struct PlacedNode {
    /// Index in the file.
    pub index: usize,
    /// Neither it nor a node above it is hidden by KHR_node_visibility; a hidden node still carries its camera.
    pub visible: bool,
    /// Index in the file of the node above it.
    pub parent: Option<usize>,
    pub world_from_node: DMat4,
    /// How it is turned in the world by the nodes down to it, whatever their scales.
    pub turn: DMat3,
}

impl PlacedNode {
    /// Its z axis in the world, and another one that is made square to it, unit vectors. A scale of 0 takes an axis, not how it is turned.
    pub fn back_and(&self, other: usize) -> [DVec3; 2] {
        let back = self.world_from_node.z_axis.truncate().try_normalize().unwrap_or(self.turn.z_axis);
        let across = |axis: DVec3| (axis - back * back.dot(axis)).try_normalize();
        let side = across(self.world_from_node.col(other).truncate()).or_else(|| across(self.turn.col(other)));
        [back, side.unwrap_or_else(|| back.any_orthonormal_vector())]
    }
}

/// What a node takes from the one above it.
#[derive(Clone, Copy)]
struct Above {
    parent: Option<usize>,
    visible: bool,
    world_from_parent: DMat4,
    turn: DMat3,
}

impl Above {
    const WORLD: Above =
        Above { parent: None, visible: true, world_from_parent: DMat4::IDENTITY, turn: DMat3::IDENTITY };
}

/// Nodes of the displayed scene in file order, each once.
pub(super) fn place(document: &Root, notes: &mut Notes) -> Vec<PlacedNode> {
    let mut visited = vec![false; document.nodes.len()];
    let mut placed = Vec::new();
    let mut pending: Vec<(usize, Above)> =
        roots(document, notes).into_iter().rev().map(|root| (root, Above::WORLD)).collect();
    while let Some((index, above)) = pending.pop() {
        let Some(node) = document.nodes.get(index) else {
            notes.warn(format!("node {index} does not exist: it is left out"));
            continue;
        };
        let name = called("node", index, node.name.as_ref());
        if std::mem::replace(&mut visited[index], true) {
            // A scene may name what stands below others, too.
            if above.parent.is_some() {
                notes.warn(format!("{name} has two parents or is its own ancestor: it is shown once"));
            }
            continue;
        }
        let world_from_node = above.world_from_parent * local_transform(node);
        // In single precision too, as lamps and vertices are.
        if !world_from_node.as_mat4().is_finite() {
            notes.warn(format!("{name} has a transform that is not finite: it is left out with all below it"));
            continue;
        }
        let (visible, turn) = (above.visible && is_visible(node), above.turn * local_turn(node));
        placed.push(PlacedNode { index, visible, parent: above.parent, world_from_node, turn });
        let below = Above { parent: Some(index), visible, world_from_parent: world_from_node, turn };
        let children = node.children.iter().flatten().rev();
        pending.extend(children.map(|child| (child.value(), below)));
    }
    placed.sort_by_key(|node| node.index);
    placed
}

/// KHR_node_visibility, without the nodes above.
fn is_visible(node: &Node) -> bool {
    let extension = node.extensions.as_ref().and_then(|all| all.others.get("KHR_node_visibility")?.get("visible"));
    extension.and_then(Value::as_bool).unwrap_or(true)
}

/// Roots of the scene that the file asks for, else of its first one, else all nodes that are no child.
fn roots(document: &Root, notes: &mut Notes) -> Vec<usize> {
    let asked = document.scene.and_then(|index| {
        if index.value() >= document.scenes.len() {
            notes.warn(format!("scene {index} does not exist: what the file has besides is shown"));
        }
        document.get(index)
    });
    let is_child = children(document);
    if let Some(scene) = asked.or(document.scenes.first()) {
        note_other_scenes(document, scene, notes);
        // A file may name all its nodes here: those below others come last, to stand where these put them.
        let named = scene.nodes.iter().map(|node| node.value());
        let (below, above): (Vec<usize>, Vec<usize>) = named.partition(|index| is_child.get(*index) == Some(&true));
        return [above, below].concat();
    }
    (0..is_child.len()).filter(|&index| !is_child[index]).collect()
}

/// Whether each node stands below another one.
fn children(document: &Root) -> Vec<bool> {
    let mut is_child = vec![false; document.nodes.len()];
    for child in document.nodes.iter().flat_map(|node| node.children.iter().flatten()) {
        if let Some(flag) = is_child.get_mut(child.value()) {
            *flag = true;
        }
    }
    is_child
}

/// Tells of scenes with nodes that the shown one does not have: lamps and furniture may be among them.
fn note_other_scenes(document: &Root, shown: &Scene, notes: &mut Notes) {
    if document.scenes.len() < 2 {
        return;
    }
    let own: BTreeSet<usize> = shown.nodes.iter().map(|node| node.value()).collect();
    for (index, scene) in document.scenes.iter().enumerate() {
        if scene.nodes.iter().any(|node| !own.contains(&node.value())) {
            let name = called("scene", index, scene.name.as_ref());
            notes.unsupported(format!("{name}: only one scene of a file is shown: it is left out"));
        }
    }
}

/// The node's matrix, or its translation · rotation · scale.
fn local_transform(node: &Node) -> DMat4 {
    if let Some(matrix) = &node.matrix {
        return DMat4::from_cols_array(&matrix.map(f64::from));
    }
    trs(node.translation, node.rotation.map(|rotation| rotation.0), node.scale)
}

/// How a node is turned, whatever its scale; of a matrix as far as its axes tell.
fn local_turn(node: &Node) -> DMat3 {
    let Some(matrix) = &node.matrix else { return DMat3::from_quat(unit(node.rotation.map(|rotation| rotation.0))) };
    let linear = DMat3::from_mat4(DMat4::from_cols_array(&matrix.map(f64::from)));
    let DMat3 { x_axis: x, y_axis: y, z_axis: z } = linear;
    let z = z.try_normalize().or_else(|| x.cross(y).try_normalize()).unwrap_or(DVec3::Z);
    let across = |axis: DVec3| (axis - z * z.dot(axis)).try_normalize();
    let x = across(x).or_else(|| Some(across(y)?.cross(z))).unwrap_or_else(|| z.any_orthonormal_vector());
    DMat3::from_cols(x, z.cross(x), z)
}

/// No turn where nothing says about what; what is not finite stays so.
fn unit(rotation: Option<[f32; 4]>) -> DQuat {
    let quaternion = rotation.map(|rotation| DQuat::from_array(rotation.map(f64::from)));
    quaternion.filter(|q| q.length_squared() != 0.0).map_or(DQuat::IDENTITY, DQuat::normalize)
}

fn trs(translation: Option<[f32; 3]>, rotation: Option<[f32; 4]>, scale: Option<[f32; 3]>) -> DMat4 {
    DMat4::from_scale_rotation_translation(
        scale.map_or(DVec3::ONE, |s| s.map(f64::from).into()),
        unit(rotation),
        translation.map_or(DVec3::ZERO, |t| t.map(f64::from).into()),
    )
}

/// How many values each of the accessors of EXT_mesh_gpu_instancing says that it has.
fn counts(reader: &Reader, instancing: &Value) -> impl Iterator<Item = u64> {
    let attributes = instancing.get("attributes");
    let index = move |name: &str| attributes?.get(name)?.as_u64();
    let accessors = ["TRANSLATION", "ROTATION", "SCALE"].into_iter().filter_map(index);
    accessors.map(move |index| usize::try_from(index).map_or(0, |index| reader.n_elements(index)))
}

/// Most instances that EXT_mesh_gpu_instancing can ask for; 1 where nothing says where they stand.
pub(super) fn n_instances(reader: &Reader, instancing: &Value) -> u64 {
    counts(reader, instancing).min().unwrap_or(1)
}

/// What its longest accessor has, where others have less.
pub(super) fn n_instances_of_longest(reader: &Reader, instancing: &Value) -> Option<u64> {
    counts(reader, instancing).max().filter(|most| *most > n_instances(reader, instancing))
}

/// Transforms of EXT_mesh_gpu_instancing within the node, or the reason why they cannot be read. Where nothing says where they stand
/// all instances are in one place, and one is all that is seen of them.
pub(super) fn instances(reader: &Reader, instancing: &Value) -> Result<Vec<DMat4>, String> {
    let attributes = instancing.get("attributes");
    let accessor = |name: &str| usize::try_from(attributes?.get(name)?.as_u64()?).ok();
    let translations = accessor("TRANSLATION").map(|a| reader.floats::<3>(a, Integers::AsDeclared)).transpose()?;
    let rotations = accessor("ROTATION").map(|a| reader.floats::<4>(a, Integers::Normalized)).transpose()?;
    let scales = accessor("SCALE").map(|a| reader.floats::<3>(a, Integers::AsDeclared)).transpose()?;
    let counts = [translations.as_ref().map(Vec::len), rotations.as_ref().map(Vec::len), scales.as_ref().map(Vec::len)];
    let Some(n_instances) = counts.into_iter().flatten().min() else { return Ok(vec![DMat4::IDENTITY]) };
    Ok((0..n_instances)
        .map(|i| {
            trs(translations.as_ref().map(|t| t[i]), rotations.as_ref().map(|r| r[i]), scales.as_ref().map(|s| s[i]))
        })
        .collect())
}
