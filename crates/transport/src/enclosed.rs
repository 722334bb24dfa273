//! Lamps in closed opaque bodies, a bulb, a shade or a housing: drawn for programs without shadows, they light nothing here.

use std::collections::BTreeMap;
use std::f32::consts::TAU;

use glam::{Quat, Vec3};

use crate::bvh::Ray;
use crate::emitters::{Emitter, punctual_falloff};
use crate::prepared::PreparedScene;
use crate::sampler::Sampler;
use crate::scene::{PunctualKind, PunctualLight};

/// Directions that are looked into from a lamp: few tell most apart, more find narrow openings.
const DIRECTIONS: [u32; 2] = [64, 512];
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
            scene.scene.nodes[node as usize].key()
        ))
    });
    words.collect()
}

/// The node of most of the walls that stand around a lamp close by; `None` if light of it comes out, or comes far.
fn around(scene: &PreparedScene, light: &PunctualLight) -> Option<u32> {
    if light.kind == PunctualKind::Directional || light.intensity <= 0.0 {
        return None;
    }
    let [few, many] = DIRECTIONS;
    walls(scene, light, few)?;
    let nodes = walls(scene, light, many)?;
    nodes.into_iter().max_by_key(|(_, n_hits)| *n_hits).map(|(node, _)| node)
}

/// How often so many rays to where a lamp shines meet walls of each node; `None` if one meets none.
fn walls(scene: &PreparedScene, light: &PunctualLight, n_rays: u32) -> Option<BTreeMap<u32, u32>> {
    let most_m = MOST_M.min(MOST_OF_EXTENT * scene.extent());
    let mut nodes: BTreeMap<u32, u32> = BTreeMap::new();
    let shines = |toward: &Vec3| punctual_falloff(light, &scene.scene.profiles, *toward) > 0.0;
    for (nth, direction) in directions(light, n_rays).filter(shines).enumerate() {
        let ray = Ray { origin: light.position, direction, t_min: 0.0, t_max: most_m };
        let hit = scene.closest(&ray, &mut Sampler::new(0, nth as u64, 0))?;
        if !scene.is_wall(hit.triangle) {
            return None;
        }
        *nodes.entry(scene.scene.mesh.triangle_node[hit.triangle as usize]).or_default() += 1;
    }
    Some(nodes)
}

/// Directions evenly spread over the cone of a spot, and all around other lamps.
pub(crate) fn directions(light: &PunctualLight, n_rays: u32) -> impl Iterator<Item = Vec3> {
    const GOLDEN: f32 = 0.618_034;
    let (axis, end) = match light.kind {
        PunctualKind::Spot { outer_rad, .. } if light.profile.is_none() => (light.direction, outer_rad.cos()),
        _ => (Vec3::Y, -1.0),
    };
    let turn = Quat::from_rotation_arc(Vec3::Y, axis);
    (0..n_rays).map(move |nth| {
        let y = 1.0 - (1.0 - end) * (nth as f32 + 0.5) / n_rays as f32;
        let (sin, cos) = (TAU * GOLDEN * nth as f32).sin_cos();
        turn * (Vec3::new(cos, 0.0, sin) * (1.0 - y * y).max(0.0).sqrt() + Vec3::Y * y)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;
    use crate::laws::stage::{Stage, lambert, quad};

    /// A can of black walls, 1 m high and open by a square hole in its top, with a lamp on its floor, in a wide scene.
    fn can(hole_m: f32, kind: PunctualKind) -> Vec<String> {
        let (half, hole) = (0.3, 0.5 * hole_m);
        let camera = Camera::look_at("eye", Vec3::Z * 9.0, Vec3::ZERO, 1.0, 1.0);
        let mut walls = quad(Vec3::new(-half, -0.1, -half), Vec3::X * 2.0 * half, Vec3::Z * 2.0 * half);
        for turn in (0..4).map(|nth| Quat::from_rotation_y(0.25 * TAU * nth as f32)) {
            let side = quad(Vec3::new(-half, -0.1, half), Vec3::X * 2.0 * half, Vec3::Y * 1.1);
            let lid = quad(Vec3::new(-half, 1.0, hole), Vec3::X * (half + hole), Vec3::Z * (half - hole));
            walls.extend([side, lid].concat().into_iter().map(|corner| turn * corner));
        }
        let floor = quad(Vec3::new(-20.0, -1.0, -20.0), Vec3::X * 40.0, Vec3::Z * 40.0);
        let stage = Stage::new(camera).surface("can", &walls, lambert(0.0, 0.0));
        let stage = stage.surface("floor", &floor, lambert(0.5, 0.0)).lamp("lamp", Vec3::ZERO, 1.0);
        let mut scene = stage.into_scene();
        (scene.punctual[0].kind, scene.punctual[0].direction) = (kind, Vec3::Y);
        warnings(&PreparedScene::new(scene, &[]).expect("a lamp without panels").0)
    }

    #[test]
    fn a_lamp_that_shines_out_of_a_narrow_opening_is_not_closed_in() {
        let spot = PunctualKind::Spot { inner_rad: 0.02, outer_rad: 0.05 };
        for kind in [PunctualKind::Point, spot] {
            let closed = can(0.0, kind);
            assert!(closed.len() == 1 && closed[0].contains("`lamp` is closed in by `can`"), "{kind:?}: {closed:?}");
            assert_eq!(can(0.2, kind), Vec::<String>::new(), "{kind:?}");
        }
    }
}
