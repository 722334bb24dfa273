//! A small bake for tests: a floor under a sky in patches.

use std::sync::Arc;

use glam::Vec3;

use super::{BakeConfig, BakeJob, Passes};
use crate::camera::{Camera, Film};
use crate::emitters::SkyRequest;
use crate::prepared::PreparedScene;
use crate::scene::{Material, Mesh, Scene};
use crate::sky::{Environment, SkyForm, SkyLight};

/// A floor under a sky in patches.
pub(super) fn job(film: Film) -> BakeJob {
    let light = SkyLight::new("uniform", Environment::uniform(Vec3::ONE));
    let sky = SkyRequest { light, form: SkyForm::Patches(1) };
    let corner = |x: f32, z: f32| Vec3::new(x, 0.0, z);
    let mesh = Mesh {
        positions: vec![corner(-9.0, -9.0), corner(-9.0, 9.0), corner(9.0, 9.0), corner(9.0, -9.0)],
        normals: vec![Vec3::Y; 4],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        triangle_material: vec![0; 2],
        triangle_node: vec![0; 2],
        ..Mesh::default()
    };
    let scene = Scene { mesh, materials: vec![Material::default()], ..Scene::default() };
    let (scene, _) = PreparedScene::with_sky(scene, &[], Some(&sky)).unwrap();
    let camera = Camera::look_at("above", Vec3::new(0.0, 6.0, 5.0), Vec3::ZERO, 1.0, 4.0 / 3.0);
    let config = BakeConfig { spp: 8, tolerance_db: 24.0, ..BakeConfig::default() };
    let (scene, passes) = (Arc::new(scene), Passes::PreviewAndFinal);
    BakeJob { scene, camera, film, config, passes, irradiance: Vec::new() }
}
