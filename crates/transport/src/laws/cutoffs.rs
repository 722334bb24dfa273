//! A mask whose alpha is exactly its cutoff is there everywhere, though vertices of other meshes have colors.

use glam::Vec3;

use super::stage::{Stage, lambert, quad};
use crate::bvh::Ray;
use crate::camera::Camera;
use crate::sampler::Sampler;
use crate::scene::{AlphaMode, Material};

#[test]
fn a_mask_at_its_cutoff_has_no_holes() {
    for alpha in [0.5, 1.0] {
        let base = lambert(0.8, 0.0);
        let material = Material { base_color: base.base_color.truncate().extend(alpha), ..base };
        let mask = Material { alpha: AlphaMode::Mask { cutoff: alpha }, ..material };
        let camera = Camera::look_at("above", Vec3::Z, Vec3::NEG_Z, 1.0, 1.0);
        let corners = quad(Vec3::ZERO, Vec3::X, Vec3::Y);
        let scene = Stage::new(camera).surface("mask", &corners, mask).with_white_vertices().prepared();
        for index in 0..20_000 {
            let mut sampler = Sampler::new(3, 0, index);
            let [x, y] = sampler.next_2d().map(|u| 0.01 + 0.98 * u);
            let origin = Vec3::new(x, y, 1.0);
            let ray = Ray { origin, direction: Vec3::NEG_Z, t_min: 0.0, t_max: f32::INFINITY };
            assert!(scene.closest(&ray, &mut sampler).is_some(), "a hole at ({x}, {y}), alpha {alpha}");
        }
    }
}
