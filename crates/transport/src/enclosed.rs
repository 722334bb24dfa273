//! Lamps in closed opaque bodies, a bulb, a shade or a housing: drawn for programs without shadows, they light nothing here.

use std::collections::BTreeMap;
use std::f32::consts::TAU;

use glam::Vec3;

use crate::bvh::Ray;
use crate::emitters::Emitter;
use crate::prepared::PreparedScene;
use crate::sampler::Sampler;
use crate::scene::{PunctualKind, PunctualLight};

/// Directions that are looked into from a lamp.
const DIRECTIONS: u32 = 64;
/// How far off its walls may be: m, and share of the diagonal of the scene. What is larger is a room.
const MOST_M: f32 = 2.0;
const MOST_OF_EXTENT: f32 = 0.15;

/// A warning for each lamp that is closed in, with the node around it.
pub(crate) fn warnings(scene: &PreparedScene) -> Vec<String> {
    let lamps = scene.lighting.emitters.iter().zip(&scene.lighting.basis.sources);
    let words = lamps.filter_map(|(emitter, source)| {
        let Emitter::Punctual(light) = emitter else { return None };
        let node = around(scene, light)?;
        Some(format!(
            "light `{}` is closed in by `{}`, so that it lights nothing around: make that glass or leave it open, or put the lamp \
             outside of it",
            source.key,
            scene.scene.node_name(node)
        ))
    });
    words.collect()
}

/// The node of most of the walls that stand around a lamp close by; `None` if a ray comes out, or comes far.
fn around(scene: &PreparedScene, light: &PunctualLight) -> Option<u32> {
    if light.kind == PunctualKind::Directional || light.intensity <= 0.0 {
        return None;
    }
    let most_m = MOST_M.min(MOST_OF_EXTENT * scene.extent());
    let mut nodes: BTreeMap<u32, u32> = BTreeMap::new();
    for nth in 0..DIRECTIONS {
        let ray = Ray { origin: light.position, direction: spiral(nth), t_min: 0.0, t_max: most_m };
        let hit = scene.closest(&ray, &mut Sampler::new(0, u64::from(nth), 0))?;
        if !scene.is_wall(hit.triangle) {
            return None;
        }
        *nodes.entry(scene.scene.mesh.triangle_node[hit.triangle as usize]).or_default() += 1;
    }
    nodes.into_iter().max_by_key(|(_, n_hits)| *n_hits).map(|(node, _)| node)
}

/// One of some directions all around, evenly spread.
fn spiral(nth: u32) -> Vec3 {
    const GOLDEN: f32 = 0.618_034;
    let y = 1.0 - (2.0 * nth as f32 + 1.0) / DIRECTIONS as f32;
    let (sin, cos) = (TAU * GOLDEN * nth as f32).sin_cos();
    Vec3::new(cos, 0.0, sin) * (1.0 - y * y).sqrt() + Vec3::Y * y
}
