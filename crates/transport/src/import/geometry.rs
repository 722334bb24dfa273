//! One primitive of one node: from accessors to world-space triangles.
//!
//! The order matters: unusable triangles go first, so that no vertex of theirs is looked at again; then the vertices that
//! are left are gathered (split per triangle where the file has no normals), placed in the world, and given normals and
//! tangents where theirs are missing.

use glam::{DMat4, Vec2, Vec3, Vec4};
use gltf::Semantic;
use gltf::json::mesh::{self, Primitive};
use gltf::json::validation::Checked;
use gltf::json::{Accessor, Index};

use super::accessor::{Integers, Reader};
use super::placement::Placement;
use super::report::Notes;
use super::skins::{self, Bones};
use super::tangents;
use crate::scene::{Mesh, TextureRef};
use crate::stop::Stop;

/// A primitive to be read and where it goes.
pub(super) struct Job<'a> {
    pub primitive: &'a Primitive,
    /// Weights of the morph targets.
    pub weights: &'a [f32],
    pub world_from_mesh: DMat4,
    /// World from mesh for each joint that vertices may hang on, in place of `world_from_mesh`.
    pub joints: Option<&'a [DMat4]>,
    /// Index into `Scene::materials`.
    pub material: u32,
    /// Index into `Scene::nodes`.
    pub node: u32,
    /// Texture that the material's tangents follow: without one no tangents are kept.
    pub tangent_map: Option<TextureRef>,
    /// Whether each set of texture coordinates places textures of the material.
    pub uv_sets: [bool; 2],
    /// Name for report lines.
    pub name: &'a str,
}

/// What became of a primitive.
#[derive(Default)]
pub(super) struct Built {
    pub mesh: Mesh,
    pub notes: Notes,
    pub n_degenerate_triangles: usize,
}

/// Reads a primitive; what cannot be used is left out with a line in `notes`.
pub(super) fn build(reader: &Reader, job: &Job) -> Built {
    let mut built = Built::default();
    match Vertices::read(reader, job, &mut built.notes) {
        Ok(Some((vertices, triangles))) => assemble(job, vertices, triangles, &mut built, reader.stop),
        Ok(None) => {}
        Err(reason) => built.notes.warn(format!("{}: {reason}: this part of it is left out", job.name)),
    }
    built
}

/// Vertices and the triangles over them.
type Surface = (Vertices, Vec<[u32; 3]>);

/// Vertex attributes as the file has them; absent ones are empty.
#[derive(Default)]
struct Vertices {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    tangents: Vec<Vec4>,
    uvs: [Vec<Vec2>; 2],
    colors: Vec<Vec4>,
    /// The first and the second four joints of each; without a skin there are none.
    bones: [Vec<Bones>; 2],
}

impl Vertices {
    /// Attributes and triangles of a primitive, `None` if it has no surface.
    fn read(reader: &Reader, job: &Job, notes: &mut Notes) -> Result<Option<Surface>, String> {
        let mode = Mode::of(job.primitive.mode)?;
        if mode == Mode::WithoutSurface {
            notes.unsupported(format!("{}: points and lines are left out", job.name));
            return Ok(None);
        }
        let Some(position) = attribute(job.primitive, Semantic::Positions) else {
            return Err("it has no vertex positions".to_owned());
        };
        if is_draco(job.primitive) && !reader.has_bytes(position) {
            return Err(
                "it is there in Draco compression only, which `gltf-transform copy IN.glb OUT.glb` undoes".to_owned()
            );
        }
        let corners = job.primitive.indices.map(|index| reader.indices(index.value())).transpose()?;
        let picked = corners.as_deref().and_then(|corners| picked(corners, reader.n_elements(position)));
        let reader = &Reader { picked: picked.as_deref(), ..*reader };
        let mut vertices =
            Vertices { positions: to_vec3(reader.floats(position, Integers::AsDeclared)?), ..Vertices::default() };
        let n_vertices = vertices.positions.len();
        let corners = match (corners, &picked) {
            (Some(corners), Some(picked)) => renumbered(&corners, picked),
            (Some(corners), None) => corners,
            (None, _) => (0..u32::try_from(n_vertices).map_err(|_| "it has too many vertices".to_owned())?).collect(),
        };
        vertices.read_attributes(reader, job, notes);
        vertices.morph(reader, job, notes);
        if let Some(joints) = job.joints {
            match skins::bones(reader, job.primitive, n_vertices, joints.len()) {
                Ok(bones) => {
                    vertices.bones = bones;
                    if attribute(job.primitive, Semantic::Joints(2)).is_some() {
                        notes.unsupported(format!("{}: joints of a vertex beyond the eighth are ignored", job.name));
                    }
                }
                Err(reason) => skins::ignored(job.name, &reason, notes),
            }
        }
        let triangles = usable_triangles(mode.triangles(&corners), &vertices.positions, job.name, notes);
        Ok((!triangles.is_empty()).then_some((vertices, triangles)))
    }

    /// Everything but positions; an attribute that cannot be read is as if it were absent.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "at most 2³¹ vertices and indices are read; two sets of coordinates"
    )]
    fn read_attributes(&mut self, reader: &Reader, job: &Job, notes: &mut Notes) {
        let accessor_of = |semantic: Semantic| attribute(job.primitive, semantic);
        let n_vertices = self.positions.len();
        let mut checked = |what: &str, result: Result<usize, String>| match result {
            Ok(count) if count == 0 || count == n_vertices => true,
            Ok(count) => {
                notes.warn(format!("{}: {count} {what} for {n_vertices} vertices: they are ignored", job.name));
                false
            }
            Err(reason) => {
                notes.warn(format!("{}: {reason}: its {what} are ignored", job.name));
                false
            }
        };
        let mut keep = |what: &str, read: Result<Vec<[f32; 3]>, String>| match checked(what, length(&read)) {
            true => read.unwrap_or_default(),
            false => Vec::new(),
        };
        self.normals = to_vec3(keep(
            "normals",
            optional(accessor_of(Semantic::Normals), |a| reader.floats(a, Integers::AsDeclared)),
        ));
        let tangents = optional(accessor_of(Semantic::Tangents), |a| reader.floats::<4>(a, Integers::AsDeclared));
        if job.tangent_map.is_some() && checked("tangents", length(&tangents)) {
            self.tangents = tangents.unwrap_or_default().into_iter().map(Vec4::from).collect();
        }
        for set in 0..self.uvs.len() {
            let uvs =
                optional(accessor_of(Semantic::TexCoords(set as u32)), |a| reader.floats::<2>(a, Integers::AsDeclared));
            if checked("texture coordinates", length(&uvs)) {
                self.uvs[set] = uvs.unwrap_or_default().into_iter().map(Vec2::from).collect();
            }
        }
        let colors = optional(accessor_of(Semantic::Colors(0)), |a| reader.colors(a));
        if checked("vertex colors", length(&colors)) {
            self.colors = colors.unwrap_or_default().into_iter().map(Vec4::from).collect();
        }
        let n_odd = self.mend_numbers();
        if n_odd > 0 {
            let odd = format!("{n_odd} texture coordinates and colors are not finite");
            notes.warn(format!("{}: {odd}: 0 and white stand for them", job.name));
        }
        for (set, _) in job.uv_sets.iter().enumerate().filter(|(_, places_textures)| **places_textures) {
            if accessor_of(Semantic::TexCoords(set as u32)).is_none() {
                notes.warn(format!(
                    "{}: it has no texture coordinates {set}, which place textures of its material: they show a single color",
                    job.name
                ));
            }
        }
        let beyond = |key: &Checked<Semantic>| matches!(key, Checked::Valid(Semantic::TexCoords(2..)));
        if job.primitive.attributes.keys().any(beyond) {
            notes.unsupported(format!("{}: texture coordinate sets beyond the second are ignored", job.name));
        }
    }

    /// Holds colors to 0 … 1 and gives texture coordinates and colors that are not finite a value; how many these are.
    fn mend_numbers(&mut self) -> usize {
        let mut n_odd = 0_usize;
        for uv in self.uvs.iter_mut().flatten().filter(|uv| !uv.is_finite()) {
            *uv = Vec2::ZERO;
            n_odd = n_odd.saturating_add(1);
        }
        for color in &mut self.colors {
            if !color.is_finite() {
                *color = Vec4::ONE;
                n_odd = n_odd.saturating_add(1);
            }
            // They end at 1 by themselves, whatever they multiply. [glTF2, §3.7.2.1]
            *color = color.clamp(Vec4::ZERO, Vec4::ONE);
        }
        n_odd
    }

    /// Adds the weighted morph targets, as the file's default weights ask. Handedness of tangents stays.
    fn morph(&mut self, reader: &Reader, job: &Job, notes: &mut Notes) {
        let n_vertices = self.positions.len();
        for (target, &weight) in job.primitive.targets.iter().flatten().zip(job.weights) {
            if weight == 0.0 || !weight.is_finite() {
                continue;
            }
            let mut read = |accessor: Option<Index<Accessor>>| -> Vec<Vec3> {
                let deltas = optional(accessor.map(|a| a.value()), |a| reader.floats::<3>(a, Integers::AsDeclared));
                let reason = match deltas {
                    Ok(deltas) if deltas.is_empty() || deltas.len() == n_vertices => {
                        return deltas.into_iter().map(|delta| weight * Vec3::from(delta)).collect();
                    }
                    Ok(deltas) => format!("{} displacements for {n_vertices} vertices", deltas.len()),
                    Err(reason) => reason,
                };
                notes.warn(format!("{}: {reason}: a morph target is ignored", job.name));
                Vec::new()
            };
            self.positions.iter_mut().zip(read(target.positions)).for_each(|(value, delta)| *value += delta);
            // What a primitive does not have cannot be displaced.
            if !self.normals.is_empty() {
                self.normals.iter_mut().zip(read(target.normals)).for_each(|(value, delta)| *value += delta);
            }
            if !self.tangents.is_empty() {
                let deltas = read(target.tangents);
                self.tangents.iter_mut().zip(deltas).for_each(|(value, delta)| *value += delta.extend(0.0));
            }
        }
    }

    /// The vertices of a list, in its order.
    fn gather(&self, list: &[u32]) -> Vertices {
        Vertices {
            positions: gathered(&self.positions, list),
            normals: gathered(&self.normals, list),
            tangents: gathered(&self.tangents, list),
            uvs: [gathered(&self.uvs[0], list), gathered(&self.uvs[1], list)],
            colors: gathered(&self.colors, list),
            bones: [gathered(&self.bones[0], list), gathered(&self.bones[1], list)],
        }
    }

    /// Brings one vertex into the world.
    fn place(&mut self, v: usize, placement: &Placement) {
        self.positions[v] = placement.position(self.positions[v]);
        if let Some(normal) = self.normals.get_mut(v) {
            *normal = placement.normal(*normal);
        }
        if let Some(tangent) = self.tangents.get_mut(v) {
            *tangent = placement.tangent(*tangent);
        }
    }
}

/// Vertices are picked where there are more than so many times the corners.
pub(super) const FEW: u64 = 2;

/// The vertices that corners use, where these are few of all: many primitives may share one list of vertices.
fn picked(corners: &[u32], n_vertices: u64) -> Option<Vec<u32>> {
    if (corners.len() as u64).saturating_mul(FEW) >= n_vertices {
        return None;
    }
    let mut picked: Vec<u32> = corners.iter().copied().filter(|&v| u64::from(v) < n_vertices).collect();
    picked.sort_unstable();
    picked.dedup();
    Some(picked)
}

/// Corners by the places of their vertices among those that were picked; of those that do not exist by one that does not either.
#[expect(clippy::cast_possible_truncation, reason = "there are no more vertices than corners, at most 2³¹")]
fn renumbered(corners: &[u32], picked: &[u32]) -> Vec<u32> {
    corners.iter().map(|v| picked.binary_search(v).map_or(u32::MAX, |place| place as u32)).collect()
}

/// Accessor of an attribute.
pub(super) fn attribute(primitive: &Primitive, semantic: Semantic) -> Option<usize> {
    primitive.attributes.get(&Checked::Valid(semantic)).map(|accessor| accessor.value())
}

fn is_draco(primitive: &Primitive) -> bool {
    primitive.extensions.as_ref().is_some_and(|all| all.others.contains_key("KHR_draco_mesh_compression"))
}

fn gathered<T: Copy>(values: &[T], list: &[u32]) -> Vec<T> {
    if values.is_empty() { Vec::new() } else { list.iter().map(|&v| values[v as usize]).collect() }
}

fn optional<T>(accessor: Option<usize>, read: impl Fn(usize) -> Result<Vec<T>, String>) -> Result<Vec<T>, String> {
    accessor.map_or_else(|| Ok(Vec::new()), read)
}

fn length<T>(read: &Result<Vec<T>, String>) -> Result<usize, String> {
    read.as_ref().map(Vec::len).map_err(Clone::clone)
}

fn to_vec3(values: Vec<[f32; 3]>) -> Vec<Vec3> {
    values.into_iter().map(Vec3::from).collect()
}

/// How corners make triangles.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Mode {
    Triangles,
    Strip,
    Fan,
    WithoutSurface,
}

impl Mode {
    fn of(mode: Checked<mesh::Mode>) -> Result<Mode, String> {
        let Checked::Valid(mode) = mode else {
            return Err("its primitive mode is not known".to_owned());
        };
        Ok(match mode {
            mesh::Mode::Triangles => Mode::Triangles,
            mesh::Mode::TriangleStrip => Mode::Strip,
            mesh::Mode::TriangleFan => Mode::Fan,
            mesh::Mode::Points | mesh::Mode::Lines | mesh::Mode::LineLoop | mesh::Mode::LineStrip => {
                Mode::WithoutSurface
            }
        })
    }

    /// Every other triangle of a strip is turned, so that all face the same way.
    fn triangles(self, corners: &[u32]) -> Vec<[u32; 3]> {
        match self {
            Mode::Triangles => corners.as_chunks::<3>().0.to_vec(),
            Mode::Strip => corners
                .windows(3)
                .enumerate()
                .map(|(i, w)| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[0], w[2], w[1]] })
                .collect(),
            Mode::Fan => corners.windows(2).skip(1).map(|w| [w[0], w[1], corners[0]]).collect(),
            Mode::WithoutSurface => Vec::new(),
        }
    }
}

/// Triangles whose corners exist and are finite; the others are counted in `notes`.
#[expect(clippy::arithmetic_side_effects, reason = "a part of them is no more than all")]
fn usable_triangles(triangles: Vec<[u32; 3]>, positions: &[Vec3], name: &str, notes: &mut Notes) -> Vec<[u32; 3]> {
    let n_all = triangles.len();
    let exists = |triangle: &[u32; 3]| triangle.iter().all(|&v| (v as usize) < positions.len());
    let finite = |triangle: &[u32; 3]| triangle.iter().all(|&v| positions[v as usize].is_finite());
    let existing: Vec<_> = triangles.into_iter().filter(exists).collect();
    let n_existing = existing.len();
    let usable: Vec<_> = existing.into_iter().filter(finite).collect();
    if n_existing < n_all {
        notes.warn(format!(
            "{name}: {} triangles use vertices that do not exist: they are left out",
            n_all - n_existing
        ));
    }
    if usable.len() < n_existing {
        let n_infinite = n_existing - usable.len();
        notes.warn(format!("{name}: {n_infinite} triangles have corners that are not finite: they are left out"));
    }
    usable
}

/// Places vertices in the world and completes them; what a stop leaves of them is nothing.
fn assemble(job: &Job, vertices: Vertices, triangles: Vec<[u32; 3]>, built: &mut Built, stop: &Stop) {
    if stop.is_asked() {
        return;
    }
    let has_normals = !vertices.normals.is_empty();
    let (list, triangles) =
        if has_normals { compacted(&triangles, vertices.positions.len()) } else { split(&triangles) };
    let mut vertices = vertices.gather(&list);
    let mirrored = place(&mut vertices, job);

    let mut mesh = Mesh {
        positions: vertices.positions,
        normals: vertices.normals,
        tangents: Vec::new(),
        uvs: vertices.uvs,
        colors: vertices.colors,
        triangles,
        ..Mesh::default()
    };
    if mirrored {
        // Sensor grids and panels go along the first edge, which stays the one of the file.
        mesh.triangles.iter_mut().for_each(|triangle| triangle.swap(0, 1));
    }
    let n_before = mesh.triangles.len();
    let visible = mesh.triangles.iter().copied().filter(|&triangle| has_area(&mesh.positions, triangle)).collect();
    mesh.triangles = visible;
    built.n_degenerate_triangles = n_before.saturating_sub(mesh.triangles.len());
    if mesh.triangles.is_empty() || stop.is_asked() {
        return;
    }
    complete_normals(&mut mesh, has_normals, job.name, &mut built.notes);
    if stop.is_asked() {
        return;
    }
    if let Some(tangent_map) = job.tangent_map {
        // Tangents of a file belong to its normals: without these they are computed, as glTF asks.
        if has_normals && !vertices.tangents.is_empty() {
            let (completed, n_computed) = tangents::completed(&mesh, &vertices.tangents, tangent_map);
            mesh.tangents = completed;
            if n_computed > 0 {
                let lost = format!("{n_computed} tangents have no direction across their normals");
                built.notes.warn(format!("{}: {lost}: they are computed instead", job.name));
            }
        } else {
            let set = usize::from(tangent_map.uv_set.min(1));
            // Of sets that place textures it was told.
            if mesh.uvs[set].is_empty() && !job.uv_sets[set] {
                built.notes.warn(format!(
                    "{}: it has no texture coordinates {set}, along which its material stretches highlights: they are stretched any way",
                    job.name
                ));
            }
            tangents::compute(&mut mesh, tangent_map);
        }
    }
    mesh.triangle_material = vec![job.material; mesh.triangles.len()];
    mesh.triangle_node = vec![job.node; mesh.triangles.len()];
    built.mesh = mesh;
}

/// Only the vertices in use, in their order: source vertices, and triangles over them.
#[expect(
    clippy::cast_possible_truncation,
    reason = "at most 2³¹ vertices and indices are read; two sets of coordinates"
)]
fn compacted(triangles: &[[u32; 3]], n_vertices: usize) -> (Vec<u32>, Vec<[u32; 3]>) {
    let mut compact = vec![u32::MAX; n_vertices];
    triangles.iter().flatten().for_each(|&v| compact[v as usize] = 0);
    let mut list = Vec::new();
    for (v, slot) in compact.iter_mut().enumerate().filter(|(_, slot)| **slot == 0) {
        *slot = list.len() as u32;
        list.push(v as u32);
    }
    (list, triangles.iter().map(|triangle| triangle.map(|v| compact[v as usize])).collect())
}

/// Three vertices of its own for each triangle, so that normals can be flat.
#[expect(
    clippy::cast_possible_truncation,
    reason = "at most 2³¹ vertices and indices are read; two sets of coordinates"
)]
fn split(triangles: &[[u32; 3]]) -> (Vec<u32>, Vec<[u32; 3]>) {
    let list = triangles.as_flattened().to_vec();
    #[expect(clippy::arithmetic_side_effects, reason = "a scene has at most 2^26 triangles")]
    let triangles = (0..triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    (list, triangles)
}

/// Brings vertices into the world; true if that mirrors most of them, so that fronts would become backs.
#[expect(clippy::arithmetic_side_effects, reason = "a count of vertices in memory")]
fn place(vertices: &mut Vertices, job: &Job) -> bool {
    let n_vertices = vertices.positions.len();
    let Some(joints) = job.joints.filter(|_| !vertices.bones[0].is_empty()) else {
        let placement = Placement::new(job.world_from_mesh);
        (0..n_vertices).for_each(|v| vertices.place(v, &placement));
        return placement.mirrors;
    };
    let mut n_mirrored = 0;
    for v in 0..n_vertices {
        let placement = Placement::new(skins::blended([vertices.bones[0].get(v), vertices.bones[1].get(v)], joints));
        vertices.place(v, &placement);
        n_mirrored += usize::from(placement.mirrors);
    }
    n_mirrored > n_vertices / 2
}

fn has_area(positions: &[Vec3], triangle: [u32; 3]) -> bool {
    let area = area_normal(positions, triangle).length_squared();
    area > 0.0 && area.is_finite()
}

/// Twice the area times the unit normal; in f32 it underflows to no area exactly where hits are undefined too.
fn area_normal(positions: &[Vec3], triangle: [u32; 3]) -> Vec3 {
    let [a, b, c] = triangle.map(|v| positions[v as usize]);
    (b - a).cross(c - a)
}

/// Geometric normals where the file has none, or none that can be normalized.
#[expect(clippy::arithmetic_side_effects, reason = "a count of vertices in memory")]
fn complete_normals(mesh: &mut Mesh, has_normals: bool, name: &str, notes: &mut Notes) {
    if !has_normals {
        mesh.normals = vec![Vec3::ZERO; mesh.positions.len()];
    }
    let usable: Vec<bool> = mesh.normals.iter().map(|normal| normal.length_squared() > 0.5).collect();
    if usable.iter().all(|&usable| usable) {
        return;
    }
    let mut geometric = vec![Vec3::ZERO; mesh.positions.len()];
    for &triangle in &mesh.triangles {
        let normal = area_normal(&mesh.positions, triangle).normalize_or_zero();
        triangle.iter().for_each(|&v| geometric[v as usize] += normal);
    }
    let mut n_replaced = 0;
    for ((normal, geometric), _) in mesh.normals.iter_mut().zip(geometric).zip(usable).filter(|(_, usable)| !usable) {
        *normal = geometric.normalize_or(Vec3::Y);
        n_replaced += usize::from(geometric != Vec3::ZERO);
    }
    if has_normals && n_replaced > 0 {
        notes.warn(format!("{name}: {n_replaced} normals have no direction: those of its triangles are used instead"));
    }
}
