//! Views of the backs of single-sided surfaces, which other programs leave out and which are walls here.

use std::collections::BTreeMap;

use glam::Vec2;

use crate::bvh::Ray;
use crate::camera::{Camera, Film};
use crate::prepared::PreparedScene;
use crate::sampler::Sampler;

/// Rays that look, along each side of the picture.
const SIDE: u32 = 24;
/// Share of the picture that may show backs without a word.
const TOLERATED: f32 = 0.2;

impl PreparedScene {
    /// A sentence where a considerable part of what a camera sees are backs of single-sided surfaces.
    pub fn warn_of_backs(&self, camera: &Camera) -> Option<String> {
        let film = Film { width: SIDE, height: SIDE };
        let mut nodes: BTreeMap<u32, u32> = BTreeMap::new();
        for nth in 0..SIDE * SIDE {
            let at = Vec2::new((nth % SIDE) as f32, (nth / SIDE) as f32) + 0.5;
            let direction = camera.direction(film, at);
            let ray = Ray { origin: camera.position(), direction, t_min: 0.0, t_max: f32::INFINITY };
            let Some(hit) = self.closest_seen(&ray, &mut Sampler::new(0, u64::from(nth), 0)) else { continue };
            let material = self.material(hit.triangle);
            // Unlit surfaces are seen from both sides and stop no light.
            let is_wall = !material.double_sided && material.transmission <= 0.0 && !material.unlit;
            if is_wall && hit.normal.dot(direction) > 0.0 {
                *nodes.entry(self.scene.mesh.triangle_node[hit.triangle as usize]).or_default() += 1;
            }
        }
        let share = nodes.values().sum::<u32>() as f32 / (SIDE * SIDE) as f32;
        let (node, _) = nodes.into_iter().max_by_key(|(_, n_rays)| *n_rays).filter(|_| share > TOLERATED)?;
        Some(format!(
            "the camera `{}` looks at the back of `{}`: {:.0} % of the picture are backs of single-sided surfaces, which glTF \
             viewers do not show and which stop light here; turn them round, or see them from their front",
            camera.name,
            self.scene.nodes[node as usize].key(),
            100.0 * share
        ))
    }
}
