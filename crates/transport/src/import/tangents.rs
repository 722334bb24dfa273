//! Tangent frames for normal maps.
//!
//! Per-triangle UV gradients, summed over each vertex with the corner's angle as weight and made orthogonal to the
//! shading normal: what MikkTSpace does, short of its welding. A vertex between a mirrored and an unmirrored part of the
//! UV map is split, because no single frame serves both.

use glam::{Vec2, Vec3, Vec4};

use crate::scene::{Mesh, TextureRef};

/// Length up to which a unit vector has no direction across another one: what rounding makes of parallel ones is less.
const LEAST_ACROSS: f32 = 1e-3;

/// Tangents of a file made unit and orthogonal to the normals. Those without a direction across their normal are computed; and how many
/// of them there are.
pub(super) fn completed(mesh: &Mesh, given: &[Vec4], normal_map: TextureRef) -> (Vec<Vec4>, usize) {
    let own = |(tangent, &normal): (&Vec4, &Vec3)| Some(across(normal, tangent.truncate())?.extend(tangent.w));
    let own: Vec<Option<Vec4>> = given.iter().zip(&mesh.normals).map(own).collect();
    let n_computed = own.iter().filter(|tangent| tangent.is_none()).count();
    if n_computed == 0 {
        return (own.into_iter().flatten().collect(), 0);
    }
    let computed = of_vertices(mesh, &frames(mesh, normal_map));
    (own.into_iter().zip(computed).map(|(own, computed)| own.unwrap_or(computed)).collect(), n_computed)
}

/// Computes the tangents of a mesh in world space for one normal map.
pub(super) fn compute(mesh: &mut Mesh, normal_map: TextureRef) {
    let frames = frames(mesh, normal_map);
    split_mirrored(mesh, &frames);
    mesh.tangents = of_vertices(mesh, &frames);
}

fn frames(mesh: &Mesh, normal_map: TextureRef) -> Vec<Frame> {
    mesh.triangles.iter().map(|&triangle| frame(mesh, triangle, normal_map)).collect()
}

/// Tangents of vertices by the frames of their triangles.
fn of_vertices(mesh: &Mesh, frames: &[Frame]) -> Vec<Vec4> {
    let mut sums = vec![Vec4::ZERO; mesh.positions.len()];
    for (triangle, frame) in mesh.triangles.iter().zip(frames) {
        for (corner, &v) in triangle.iter().enumerate() {
            let weighted = frame.tangent * corner_angle(mesh, *triangle, corner);
            let sum = &mut sums[v as usize];
            *sum = (sum.truncate() + weighted).extend(frame.handedness);
        }
    }
    let unused_is_right_handed = |sum: Vec4| if sum.w == 0.0 { 1.0 } else { sum.w };
    sums.into_iter()
        .zip(&mesh.normals)
        .map(|(sum, &normal)| orthogonal_to(normal, sum.truncate()).extend(unused_is_right_handed(sum)))
        .collect()
}

/// Direction in which u grows over a triangle, and whether the image's up lies to the left of it (1) or to the right (−1).
#[derive(Clone, Copy)]
struct Frame {
    tangent: Vec3,
    handedness: f32,
}

fn frame(mesh: &Mesh, triangle: [u32; 3], normal_map: TextureRef) -> Frame {
    let uvs = &mesh.uvs[usize::from(normal_map.uv_set.min(1))];
    if uvs.is_empty() {
        return Frame { tangent: Vec3::ZERO, handedness: 1.0 };
    }
    let [a, b, c] = triangle.map(|v| mesh.positions[v as usize]);
    let [ua, ub, uc]: [Vec2; 3] = triangle.map(|v| normal_map.transform.transform_point2(uvs[v as usize]));
    let (e1, e2, d1, d2) = (b - a, c - a, ub - ua, uc - ua);
    let uv_area = d1.perp_dot(d2);
    // Normal maps have +Y up in the image while glTF's v runs down it, so the bitangent goes against v.
    let tangent = ((e1 * d2.y - e2 * d1.y) * uv_area.signum()).normalize_or_zero();
    let bitangent = (e1 * d2.x - e2 * d1.x) * uv_area.signum();
    let normal = triangle.iter().map(|&v| mesh.normals[v as usize]).sum::<Vec3>();
    let left_handed = normal.cross(tangent).dot(bitangent) < 0.0;
    Frame { tangent, handedness: if left_handed { -1.0 } else { 1.0 } }
}

/// Gives the triangles of the rarer handedness at a vertex a copy of it.
#[expect(clippy::cast_possible_truncation, reason = "at most 2³¹ vertices are read")]
fn split_mirrored(mesh: &mut Mesh, frames: &[Frame]) {
    let mut first: Vec<f32> = vec![0.0; mesh.positions.len()];
    let mut twins = vec![u32::MAX; mesh.positions.len()];
    for (t, frame) in frames.iter().enumerate() {
        for corner in 0..3 {
            let v = mesh.triangles[t][corner] as usize;
            if first[v] == 0.0 {
                first[v] = frame.handedness;
            }
            if first[v] == frame.handedness {
                continue;
            }
            if twins[v] == u32::MAX {
                twins[v] = mesh.positions.len() as u32;
                duplicate_vertex(mesh, v);
            }
            mesh.triangles[t][corner] = twins[v];
        }
    }
}

fn duplicate_vertex(mesh: &mut Mesh, v: usize) {
    mesh.positions.push(mesh.positions[v]);
    mesh.normals.push(mesh.normals[v]);
    for uvs in mesh.uvs.iter_mut().filter(|uvs| !uvs.is_empty()) {
        uvs.push(uvs[v]);
    }
    if !mesh.colors.is_empty() {
        mesh.colors.push(mesh.colors[v]);
    }
}

fn corner_angle(mesh: &Mesh, triangle: [u32; 3], corner: usize) -> f32 {
    #[expect(clippy::arithmetic_side_effects, reason = "two numbers below 3")]
    let at = |i: usize| mesh.positions[triangle[(corner + i) % 3] as usize];
    let cosine = (at(1) - at(0)).normalize_or_zero().dot((at(2) - at(0)).normalize_or_zero());
    cosine.clamp(-1.0, 1.0).acos()
}

/// The part of a unit vector that is orthogonal to the unit normal, unit; `None` where hardly anything is left.
fn across(normal: Vec3, direction: Vec3) -> Option<Vec3> {
    let across = direction - normal * normal.dot(direction);
    (across.length() > LEAST_ACROSS).then(|| across.normalize())
}

/// The part of a direction that is orthogonal to the unit normal, unit; any such direction if nothing is left.
fn orthogonal_to(normal: Vec3, direction: Vec3) -> Vec3 {
    (direction - normal * normal.dot(direction)).try_normalize().unwrap_or_else(|| normal.any_orthonormal_vector())
}
