//! A name for what a bake will hold, known before it is made.

use super::BakeJob;
use crate::fingerprint::{digest, fingerprint};

impl BakeJob {
    /// Thirty-two hexadecimal digits, the same for jobs whose bakes are the same: scene, camera, lights, sky, size, options and
    /// rows of irradiance count, the passes before the last one do not.
    pub fn key(&self) -> String {
        let basis = &self.scene.lighting.basis;
        let film = (self.film.width, self.film.height, self.config.block);
        let names = (&self.scene.scene.name, &self.camera.name);
        let rest = (names, film, &self.config, basis, &self.irradiance, self.scene.skips);
        let mut rest = serde_json::to_vec(&rest).expect("options, lights and rows always have a JSON form");
        if let Some(sky) = &basis.sky {
            rest.extend(sky.map.fingerprint().to_le_bytes());
        }
        format!("{}{:016x}", fingerprint(&self.scene.scene, &self.camera), digest(&rest))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::Vec3;

    use super::super::{BakeConfig, Passes};
    use super::*;
    use crate::camera::{Camera, Film};
    use crate::emitters::SkyRequest;
    use crate::prepared::PreparedScene;
    use crate::scene::{Material, Mesh, Scene};
    use crate::sky::{Environment, SkyForm, SkyLight};

    fn job(radiance: f32) -> BakeJob {
        let light = SkyLight::new("uniform", Environment::uniform(Vec3::splat(radiance)));
        let sky = SkyRequest { light, form: SkyForm::Whole };
        let mesh = Mesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            normals: vec![Vec3::Z; 3],
            triangles: vec![[0, 1, 2]],
            triangle_material: vec![0],
            triangle_node: vec![0],
            ..Mesh::default()
        };
        let scene = Scene { mesh, materials: vec![Material::default()], ..Scene::default() };
        let (scene, _) = PreparedScene::with_sky(scene, &[], Some(&sky)).unwrap();
        BakeJob {
            scene: Arc::new(scene),
            camera: Camera::look_at("front", Vec3::Z * 3.0, Vec3::ZERO, 1.0, 4.0 / 3.0),
            film: Film { width: 32, height: 24 },
            config: BakeConfig::default(),
            passes: Passes::FinalOnly,
            irradiance: Vec::new(),
        }
    }

    #[test]
    fn everything_that_changes_a_bake_changes_its_key_and_the_passes_do_not() {
        let plain = job(1.0);
        assert_eq!(plain.key(), job(1.0).key());
        assert_eq!(plain.key(), BakeJob { passes: Passes::Progressive, ..plain.clone() }.key());
        let camera = Camera::look_at("front", Vec3::Z * 3.001, Vec3::ZERO, 1.0, 4.0 / 3.0);
        let others = [
            job(2.0),
            BakeJob { camera, ..plain.clone() },
            BakeJob { film: Film { width: 33, height: 24 }, ..plain.clone() },
            BakeJob { config: BakeConfig { seed: 1, ..BakeConfig::default() }, ..plain.clone() },
            BakeJob { config: BakeConfig { spp: 7, ..BakeConfig::default() }, ..plain.clone() },
            BakeJob { config: BakeConfig { block: 8, ..BakeConfig::default() }, ..plain.clone() },
            BakeJob { config: BakeConfig { smooth: false, ..BakeConfig::default() }, ..plain.clone() },
        ];
        for (number, other) in others.iter().enumerate() {
            assert_ne!(plain.key(), other.key(), "{number}");
        }
    }
}
