//! The generated hall as a scene: of so many triangles, under a panel of so many texels.

use std::sync::Arc;

use anyhow::Result;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::scene::{Material, Mesh, Scene, SceneNode};
use glam::{Vec3, Vec4};

use super::hall;

/// Half sides of the panel and its height in meters; radiance in nit.
const PANEL: [f32; 3] = [6.0, 4.0, 5.8];
const RADIANCE: f32 = 100.0;
/// Of everything that is no panel.
const ALBEDO: f32 = 0.6;

/// About that many triangles, and `side` × `side` columns.
///
/// # Errors
/// If the panel has a number of texels that no panel may have.
pub(super) fn prepared(n_triangles: usize, side: u32) -> Result<Arc<PreparedScene>> {
    let mut mesh = Mesh::default();
    hall::triangles(n_triangles).into_iter().for_each(|corners| add(&mut mesh, corners, 0));
    let [half_length, half_width, height] = PANEL;
    let corner = |u: f32, v: f32| Vec3::new(u * half_length, height, v * half_width);
    // Counter-clockwise seen from below.
    let [a, b, c, d] = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
    add(&mut mesh, [a, b, c], 1);
    add(&mut mesh, [a, c, d], 1);
    let base_color = Vec4::new(ALBEDO, ALBEDO, ALBEDO, 1.0);
    let wall = Material { base_color, metallic: 0.0, specular: 0.0, double_sided: true, ..Material::default() };
    let lamp = Material { emissive: Vec3::ONE, emissive_strength: RADIANCE, base_color: Vec4::W, ..wall.clone() };
    let lamp = Material { double_sided: false, ..lamp };
    let node = |index: u32, name: &str, panel: Option<u32>| SceneNode {
        index,
        name: Some(name.into()),
        panel,
        ..SceneNode::default()
    };
    let scene = Scene {
        name: "generated hall".into(),
        mesh,
        materials: vec![wall, lamp],
        nodes: vec![node(0, "hall", None), node(1, "panel", Some(side))],
        cameras: vec![hall::camera()],
        ..Scene::default()
    };
    Ok(Arc::new(PreparedScene::new(scene, &[])?.0))
}

/// A triangle with vertices of its own; material and node have the same number.
fn add(mesh: &mut Mesh, corners: [Vec3; 3], material: u32) {
    let first = mesh.positions.len() as u32;
    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or(Vec3::Y);
    mesh.positions.extend(corners);
    mesh.normals.extend([normal; 3]);
    mesh.triangles.push([first, first + 1, first + 2]);
    mesh.triangle_material.push(material);
    mesh.triangle_node.push(material);
}

#[cfg(test)]
mod tests {
    use clerestory_transport::bake::BakeConfig;
    use clerestory_transport::camera::Film;

    use super::*;
    use crate::matrix::baked;
    use crate::rendered::as_in_file;

    #[test]
    fn the_hall_has_a_column_for_each_texel_and_light_below_them() {
        let scene = prepared(1000, 4).unwrap();
        assert_eq!(scene.lighting.basis.n_cols(), 16);
        let (_, panel) = scene.lighting.panels().next().expect("a panel");
        assert!(panel.normal.y < -0.99, "it shines down");
        let n = scene.scene.mesh.triangles.len();
        assert!((500..2000).contains(&n), "{n} triangles");
    }

    #[test]
    fn most_of_what_the_camera_sees_is_lit_by_the_panel_itself() {
        let scene = prepared(1000, 1).unwrap();
        let config = BakeConfig { spp: 4, bounces: Some(0), ..BakeConfig::default() };
        let (_, bake) = baked(&scene, Film { width: 32, height: 24 }, config).unwrap();
        let picture = as_in_file(&bake);
        let n_lit = picture.chunks_exact(3).filter(|rgb| rgb[1] > 0.0).count();
        assert!(n_lit > 32 * 24 / 2, "{n_lit}");
    }
}
