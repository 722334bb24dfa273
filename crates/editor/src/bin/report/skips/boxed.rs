//! A lamp whose light reaches nothing that is seen.

use clerestory_transport::scene::{Material, PunctualKind, PunctualLight, Scene, SceneNode};
use glam::{Vec2, Vec3, Vec4};

/// Half a side of the box in meters, and how far it stands below all else.
const HALF: f32 = 0.25;
const BELOW: f32 = 1.0;
/// Corners of a cube by the bits of x, y and z: each face counter-clockwise seen from outside.
const FACES: [[u32; 4]; 6] = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/// Adds a closed box below the scene and a point lamp of 100 cd in its middle.
pub(super) fn add_lamp(scene: &mut Scene) {
    let (low, high) = scene.mesh.bounds().unwrap_or_default();
    let center = (0.5 * (low + high)).with_y(low.y - BELOW);
    let node = scene.nodes.len() as u32;
    scene.nodes.push(SceneNode { index: node, name: Some("closed box".into()), ..SceneNode::default() });
    let material = scene.materials.len() as u32;
    scene.materials.push(Material { metallic: 0.0, specular: 0.0, double_sided: true, ..Material::default() });
    let corner = |of: u32, bit: u32| if of >> bit & 1 == 1 { HALF } else { -HALF };
    for face in FACES {
        let corners = face.map(|of| center + Vec3::new(corner(of, 0), corner(of, 1), corner(of, 2)));
        add_face(scene, corners, [material, node]);
    }
    scene.punctual.push(PunctualLight {
        node,
        kind: PunctualKind::Point,
        position: center,
        direction: Vec3::NEG_Z,
        across: [Vec3::X, Vec3::Y],
        profile: None,
        color: Vec3::ONE,
        intensity: 100.0,
        radius_rad: 0.0,
    });
}

/// Two triangles with vertices of their own, which have what the mesh's vertices have.
fn add_face(scene: &mut Scene, corners: [Vec3; 4], [material, node]: [u32; 2]) {
    let mesh = &mut scene.mesh;
    let first = mesh.positions.len() as u32;
    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
    mesh.positions.extend(corners);
    mesh.normals.extend([normal; 4]);
    if !mesh.tangents.is_empty() {
        mesh.tangents.extend([(corners[1] - corners[0]).normalize().extend(1.0); 4]);
    }
    mesh.uvs.iter_mut().filter(|uvs| !uvs.is_empty()).for_each(|uvs| uvs.extend([Vec2::ZERO; 4]));
    if !mesh.colors.is_empty() {
        mesh.colors.extend([Vec4::ONE; 4]);
    }
    mesh.triangles.extend([[0, 1, 2], [0, 2, 3]].map(|triangle| triangle.map(|v| first + v)));
    mesh.triangle_material.extend([material; 2]);
    mesh.triangle_node.extend([node; 2]);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_box_is_closed() {
        let mut scene = Scene::default();
        add_lamp(&mut scene);
        assert_eq!(scene.mesh.triangles.len(), 12);
        for triangle in 0..12 {
            let [a, b, c] = scene.mesh.corners(triangle);
            assert!((b - a).cross(c - a).dot(a - scene.punctual[0].position) > 0.0, "{triangle} faces inward");
        }
    }
}
