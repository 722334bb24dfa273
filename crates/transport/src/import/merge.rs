//! Many meshes into one: attributes that only some of them have are filled up.

use glam::{Vec2, Vec4};

use crate::scene::Mesh;

/// Adds a mesh to another; false if vertex indices would overflow.
#[expect(clippy::cast_possible_truncation, reason = "at most 2³¹ vertices are read")]
pub(super) fn append(all: &mut Mesh, part: Mesh) -> bool {
    let offset = all.positions.len();
    let end = offset.checked_add(part.positions.len());
    if end.is_none_or(|end| u32::try_from(end).is_err()) {
        return false;
    }
    #[expect(clippy::arithmetic_side_effects, reason = "vertices of the part end where all do, which fits")]
    let triangles = part.triangles.into_iter().map(|triangle| triangle.map(|v| v + offset as u32));
    all.triangles.extend(triangles);
    all.triangle_material.extend(part.triangle_material);
    all.triangle_node.extend(part.triangle_node);
    extend_padded(&mut all.tangents, part.tangents, offset);
    for (all, part) in all.uvs.iter_mut().zip(part.uvs) {
        extend_padded(all, part, offset);
    }
    extend_padded(&mut all.colors, part.colors, offset);
    all.normals.extend(part.normals);
    all.positions.extend(part.positions);
    true
}

/// What a vertex has that its file gives no value for.
trait Absent: Copy {
    const ABSENT: Self;
}

impl Absent for Vec2 {
    const ABSENT: Self = Vec2::ZERO;
}

impl Absent for Vec4 {
    /// White as a color; a tangent of no meaning, for a vertex whose material has no normal map.
    const ABSENT: Self = Vec4::ONE;
}

/// Adds values that start at vertex `offset`, filling up what is missing before them.
fn extend_padded<T: Absent>(all: &mut Vec<T>, part: Vec<T>, offset: usize) {
    if !part.is_empty() {
        all.resize(offset, T::ABSENT);
        all.extend(part);
    }
}

/// Fills up the attributes that some vertices have, so that all arrays are as long as `positions`.
pub(super) fn pad_attributes(mesh: &mut Mesh) {
    fn pad<T: Absent>(values: &mut Vec<T>, n_vertices: usize) {
        if !values.is_empty() {
            values.resize(n_vertices, T::ABSENT);
        }
    }
    let n_vertices = mesh.positions.len();
    pad(&mut mesh.tangents, n_vertices);
    mesh.uvs.iter_mut().for_each(|uvs| pad(uvs, n_vertices));
    pad(&mut mesh.colors, n_vertices);
}
