//! Materials in use, and the primitives of every node with theirs.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use glam::DMat4;
use gltf::json::mesh::{Mode, MorphTarget};
use gltf::json::validation::Checked;
use gltf::json::{self, Node, Root};
use rayon::prelude::*;
use serde_json::Value;

use super::ImportError;
use super::accessor::Reader;
use super::document::called;
use super::geometry::{self, Built, FEW, Job};
use super::hierarchy::{self, PlacedNode};
use super::material::{Converter, UsedTexture};
use super::report::Notes;
use super::skins::{Skeletons, Skin};
use super::variants::Variant;
use crate::scene::{Material, Scene};

/// Who uses a material.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Uses {
    /// Nobody but one node.
    Here,
    /// Others too.
    Elsewhere,
}

/// Index into `Scene::materials` for each material of the file, and for primitives that name none.
pub(super) struct MaterialSlots {
    variant: Variant,
    of_file: Vec<Option<u32>>,
    default: u32,
    /// What stands in for a material at a node whose muted surfaces have it, by both indices.
    lit: HashMap<(u32, u32), u32>,
}

impl MaterialSlots {
    /// As the file has it.
    pub(super) fn of(&self, primitive: &json::mesh::Primitive) -> u32 {
        let material = self.variant.material(primitive);
        material.and_then(|index| self.of_file.get(index.value()).copied().flatten()).unwrap_or(self.default)
    }

    /// As it is shown at a node.
    fn at_node(&self, node_idx: u32, primitive: &json::mesh::Primitive) -> u32 {
        let slot = self.of(primitive);
        self.lit.get(&(node_idx, slot)).copied().unwrap_or(slot)
    }

    /// Whether a primitive has the material that it has without variants.
    pub(super) fn is_own(&self, primitive: &json::mesh::Primitive) -> bool {
        self.variant.material(primitive) == primitive.material
    }

    /// How many primitives of visible nodes have each.
    pub(super) fn n_uses(&self, document: &Root, placed: &[PlacedNode]) -> HashMap<u32, usize> {
        let visible = placed.iter().filter(|node| node.visible);
        let meshes = visible.filter_map(|node| document.get(document.nodes[node.index].mesh?));
        let mut n_uses = HashMap::<u32, usize>::new();
        for primitive in meshes.flat_map(|mesh| &mesh.primitives) {
            let n_uses = n_uses.entry(self.of(primitive)).or_default();
            *n_uses = n_uses.saturating_add(1);
        }
        n_uses
    }

    /// Puts a material in place of another one at a node.
    #[expect(clippy::cast_possible_truncation, reason = "no more materials than bytes of the file, at most 2³²")]
    pub(super) fn light_up(&mut self, scene: &mut Scene, at: (u32, u32), lit: Material, uses: Uses) {
        if uses == Uses::Here {
            scene.materials[at.1 as usize] = lit;
        } else {
            self.lit.insert(at, scene.materials.len() as u32);
            scene.materials.push(lit);
        }
    }
}

/// Converts the materials in use, the default one first if any primitive needs it; also the textures that they use.
#[expect(clippy::cast_possible_truncation, reason = "no more materials than bytes of the file, at most 2³²")]
pub(super) fn add_materials(
    scene: &mut Scene,
    document: &Root,
    placed: &[PlacedNode],
    variant: Variant,
    notes: &mut Notes,
) -> (MaterialSlots, Vec<UsedTexture>) {
    let visible = placed.iter().filter(|node| node.visible);
    let meshes = visible.filter_map(|node| document.get(document.nodes[node.index].mesh?));
    let mut used = vec![false; document.materials.len()];
    let mut needs_default = false;
    for primitive in meshes.flat_map(|mesh| &mesh.primitives) {
        match variant.material(primitive).map(|index| (index, used.get_mut(index.value()))) {
            Some((_, Some(used))) => *used = true,
            Some((index, None)) => {
                notes.warn(format!("material {index} does not exist: the default material is shown"));
                needs_default = true;
            }
            None => needs_default = true,
        }
    }
    if needs_default {
        scene.materials.push(Material::default());
    }
    let mut converter = Converter { document, notes, textures: Vec::new() };
    let mut of_file = Vec::with_capacity(used.len());
    for (index, used) in used.into_iter().enumerate() {
        of_file.push(used.then_some(scene.materials.len() as u32));
        if used {
            scene.materials.push(converter.convert(index));
        }
    }
    (MaterialSlots { variant, of_file, default: 0, lit: HashMap::new() }, converter.textures)
}

/// Every primitive of every node, in node order.
pub(super) fn build_geometry(
    reader: &Reader,
    scene: &Scene,
    placed: &[PlacedNode],
    indices: &[Option<u32>],
    slots: &MaterialSlots,
    skins: &[Option<Skin>],
    notes: &mut Notes,
) -> Result<Vec<Built>, ImportError> {
    let document = reader.document;
    let mut names = Vec::with_capacity(placed.len());
    for node in placed {
        names.push(called("node", node.index, document.nodes[node.index].name.as_ref()));
    }
    check_load(reader, scene, placed, indices)?;
    let skeletons = Skeletons::place(reader, skins, placed);
    let uv_sets: Vec<[bool; 2]> = scene.materials.iter().map(uv_sets).collect();
    let mut jobs = Vec::new();
    for ((placed, node_idx), name) in placed.iter().zip(indices).zip(&names) {
        let node = &document.nodes[placed.index];
        let (Some(mesh_idx), Some(node_idx), true) = (node.mesh, *node_idx, placed.visible) else { continue };
        let Some(mesh) = document.get(mesh_idx) else {
            notes.warn(format!("{name}: mesh {mesh_idx} does not exist: it is left out"));
            continue;
        };
        let weights = node.weights.as_ref().or(mesh.weights.as_ref()).map_or(&[][..], Vec::as_slice);
        let joints = skeletons.of(node, name, notes);
        let transforms = match joints {
            Some(_) => vec![placed.world_from_node],
            None => transforms(reader, node, placed, name, notes),
        };
        for world_from_mesh in transforms {
            jobs.extend(mesh.primitives.iter().map(|primitive| {
                let material = slots.at_node(node_idx, primitive);
                let tangent_map = scene.materials[material as usize].tangent_map();
                let uv_sets = uv_sets[material as usize];
                Job {
                    primitive,
                    weights,
                    world_from_mesh,
                    joints,
                    material,
                    node: node_idx,
                    tangent_map,
                    uv_sets,
                    name,
                }
            }));
        }
    }
    Ok(jobs.par_iter().map(|job| geometry::build(reader, job)).collect())
}

/// Which sets of texture coordinates place textures of a material.
fn uv_sets(material: &Material) -> [bool; 2] {
    let (mut material, mut sets) = (material.clone(), [false; 2]);
    for texture in material.texture_slots().into_iter().flatten() {
        sets[usize::from(texture.uv_set.min(1))] = true;
    }
    sets
}

/// Least bytes of JSON that place a node.
const BYTES_OF_A_NODE: u64 = 16;

/// Refuses what all nodes together would make too much of, before anything is read or multiplied.
fn check_load(
    reader: &Reader,
    scene: &Scene,
    placed: &[PlacedNode],
    indices: &[Option<u32>],
) -> Result<(), ImportError> {
    let n_bytes = reader.buffers.n_bytes().saturating_add(BYTES_OF_A_NODE.saturating_mul(placed.len() as u64));
    let most =
        Load::FEW_TRIANGLES.saturating_add(Load::TRIANGLES_OF_A_BYTE.saturating_mul(n_bytes)).min(Load::MAX_TRIANGLES);
    let mut load = Load::default();
    for (placed, _) in placed.iter().zip(indices).filter(|(placed, index)| placed.visible && index.is_some()) {
        let node = &reader.document.nodes[placed.index];
        let Some(mesh) = node.mesh.and_then(|mesh| reader.document.get(mesh)) else { continue };
        load.add(&Load::of_mesh(reader, mesh), n_copies(reader, node)).check(&scene.name, most)?;
    }
    Ok(())
}

/// What building geometry takes, at most.
#[derive(Clone, Copy, Debug, Default)]
struct Load {
    /// A primitive without any counts as one.
    triangles: u64,
    /// Elements of accessors that are read.
    elements: u64,
}

impl Load {
    const MAX_TRIANGLES: u64 = 1 << 26;
    /// What copies make of a file without bytes worth the name, and of each byte beyond: a forest has some fifty.
    const FEW_TRIANGLES: u64 = 1 << 20;
    const TRIANGLES_OF_A_BYTE: u64 = 256;
    const MAX_ELEMENTS: u64 = 1 << 31;

    /// One copy of a mesh.
    fn of_mesh(reader: &Reader, mesh: &json::Mesh) -> Load {
        let mut load = Load::default();
        for primitive in &mesh.primitives {
            let of = |index: usize| reader.n_elements(index);
            let attributes = primitive.attributes.values().map(|index| of(index.value()));
            let of_target = |target: &MorphTarget| [target.positions, target.normals, target.tangents];
            let targets = primitive.targets.iter().flatten().flat_map(of_target);
            let targets = targets.flatten().map(|index| of(index.value()));
            let n_vertices = attributes.clone().max().unwrap_or(0);
            let n_corners = primitive.indices.map_or(n_vertices, |index| of(index.value()));
            // Of vertices that many primitives share, each reads its own.
            let most = primitive.indices.map_or(u64::MAX, |_| n_corners.saturating_mul(FEW));
            let is_list = primitive.mode == Checked::Valid(Mode::Triangles);
            load.triangles = load.triangles.saturating_add((if is_list { n_corners / 3 } else { n_corners }).max(1));
            load.elements = attributes
                .chain(targets)
                .map(|n| n.min(most))
                .fold(load.elements.saturating_add(n_corners), u64::saturating_add);
        }
        load
    }

    fn add(&mut self, one: &Load, n_copies: u64) -> &Load {
        self.triangles = self.triangles.saturating_add(one.triangles.saturating_mul(n_copies));
        self.elements = self.elements.saturating_add(one.elements.saturating_mul(n_copies));
        self
    }

    fn check(&self, name: &str, most_triangles: u64) -> Result<(), ImportError> {
        let refuse = |what, most| Err(ImportError::TooMuch { name: name.to_owned(), what, most });
        match () {
            () if self.triangles > most_triangles => refuse("triangles", most_triangles),
            () if self.elements > Load::MAX_ELEMENTS => refuse("vertices", Load::MAX_ELEMENTS),
            () => Ok(()),
        }
    }
}

/// How often a node shows its mesh, at most.
fn n_copies(reader: &Reader, node: &Node) -> u64 {
    instancing(node).map_or(1, |instancing| hierarchy::n_instances(reader, instancing).max(1))
}

fn instancing(node: &Node) -> Option<&Value> {
    node.extensions.as_ref()?.others.get("EXT_mesh_gpu_instancing")
}

/// The node's own transform, or one per instance.
fn transforms(reader: &Reader, node: &Node, placed: &PlacedNode, name: &str, notes: &mut Notes) -> Vec<DMat4> {
    let Some(instancing) = instancing(node) else { return vec![placed.world_from_node] };
    let is_colored = |attributes: &Value| ["_COLOR_0", "COLOR_0"].iter().any(|name| attributes.get(*name).is_some());
    if instancing.get("attributes").is_some_and(is_colored) {
        notes.unsupported(format!("{name}: its instances have colors of their own, which are ignored"));
    }
    match hierarchy::instances(reader, instancing) {
        Ok(instances) => {
            let n_instances = instances.len();
            if let Some(most) = hierarchy::n_instances_of_longest(reader, instancing) {
                notes.warn(format!(
                    "{name}: translations, rotations and scales of its instances are not as many, up to {most}: the first \
                     {n_instances} are shown"
                ));
            }
            let finite: Vec<DMat4> = instances
                .into_iter()
                .map(|node_from_instance| placed.world_from_node * node_from_instance)
                .filter(|world_from_instance| world_from_instance.as_mat4().is_finite())
                .collect();
            let n_lost = n_instances.saturating_sub(finite.len());
            if n_lost > 0 {
                notes.warn(format!(
                    "{name}: {n_lost} of its instances have a transform that is not finite: they are left out"
                ));
            }
            finite
        }
        Err(reason) => {
            notes.warn(format!("{name}: {reason}: its instances are left out"));
            vec![placed.world_from_node]
        }
    }
}

/// Tells of nodes whose instances shine: they are one light.
pub(super) fn note_instances(
    reader: &Reader,
    scene: &Scene,
    placed: &[PlacedNode],
    indices: &[Option<u32>],
    notes: &mut Notes,
) {
    let mut instanced = BTreeMap::new();
    for (placed, node_idx) in placed.iter().zip(indices).filter(|(placed, _)| placed.visible) {
        let node = &reader.document.nodes[placed.index];
        let n_instances = n_copies(reader, node);
        if let Some(node_idx) = node_idx.filter(|_| n_instances > 1) {
            instanced.insert(node_idx, (called("node", placed.index, node.name.as_ref()), n_instances));
        }
    }
    if instanced.is_empty() {
        return;
    }
    let shines = |(_, material): &(&u32, &u32)| scene.materials[**material as usize].is_emitter();
    let triangles = scene.mesh.triangle_node.iter().zip(&scene.mesh.triangle_material);
    let shining: BTreeSet<u32> = triangles.filter(shines).map(|(node, _)| *node).collect();
    for (_, (name, n_instances)) in instanced.into_iter().filter(|(node_idx, _)| shining.contains(node_idx)) {
        notes.unsupported(format!(
            "{name}: its {n_instances} instances are one light, which is dimmed as a whole: \
             export them as nodes of their own to dim them one by one"
        ));
    }
}
