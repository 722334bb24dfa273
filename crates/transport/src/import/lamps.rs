//! KHR_lights_punctual.

use std::f32::consts::{FRAC_PI_2, FRAC_PI_4};

use glam::Vec3;
use gltf::json::extensions::scene::khr_lights_punctual::{Light, Type};
use gltf::json::validation::Checked;
use gltf::json::{Index, Root};

use super::document::called;
use super::hierarchy::PlacedNode;
use super::report::Notes;
use crate::scene::{PunctualKind, PunctualLight};

/// The lamp of a node, if it has one that is known. `node_idx` is the index into `Scene::nodes`.
pub(super) fn lamp(
    document: &Root,
    index: Index<Light>,
    placed: &PlacedNode,
    node_idx: u32,
    notes: &mut Notes,
) -> Option<PunctualLight> {
    let Some(light) = document.get(index) else {
        notes.warn(format!("lamp {index} does not exist: it is left out"));
        return None;
    };
    let name = called("lamp", index.value(), light.name.as_ref());
    let Some(kind) = kind(light, &name, notes) else {
        notes.warn(format!("{name}: its type is not known: it is left out"));
        return None;
    };
    let color = Vec3::from(light.color);
    let intensity = light.intensity;
    let sane = |x: f32| x.is_finite() && x >= 0.0;
    let factors = color.to_array().into_iter().chain([intensity]);
    if !(factors.chain((color * intensity).to_array()).all(sane)) {
        notes.warn(format!("{name}: its color {color} times intensity {intensity} is out of range: it is left out"));
        return None;
    }
    Some(PunctualLight { kind, color, intensity, ..white_point(placed, node_idx) })
}

/// A white point lamp of 1 candela at a node.
pub(super) fn white_point(placed: &PlacedNode, node_idx: u32) -> PunctualLight {
    let (world_from_node, [back, x]) = (&placed.world_from_node, placed.back_and(0));
    // A mirrored node mirrors the distribution of its lamp.
    let y = back.cross(x);
    let y = if world_from_node.y_axis.truncate().dot(y) < 0.0 { -y } else { y };
    PunctualLight {
        node: node_idx,
        kind: PunctualKind::Point,
        position: world_from_node.w_axis.truncate().as_vec3(),
        direction: -back.as_vec3(),
        across: [x.as_vec3(), y.as_vec3()],
        profile: None,
        color: Vec3::ONE,
        intensity: 1.0,
        radius_rad: 0.0,
    }
}

/// By how much angles of a cone may be off as they are written, radians.
const ROUNDED: f32 = 1e-3;

fn kind(light: &Light, name: &str, notes: &mut Notes) -> Option<PunctualKind> {
    let Checked::Valid(kind) = light.type_ else { return None };
    Some(match kind {
        Type::Point => PunctualKind::Point,
        Type::Directional => PunctualKind::Directional,
        Type::Spot => {
            let (inner, outer) =
                light.spot.as_ref().map_or((0.0, FRAC_PI_4), |spot| (spot.inner_cone_angle, spot.outer_cone_angle));
            let angle = |value: f32, default: f32| if value.is_finite() { value } else { default };
            let outer_rad = angle(outer, FRAC_PI_4).clamp(1e-3, FRAC_PI_2);
            let inner_rad = angle(inner, 0.0).clamp(0.0, outer_rad);
            if (inner_rad - inner).abs().max((outer_rad - outer).abs()) > ROUNDED {
                let [asked, used] = [[inner, outer], [inner_rad, outer_rad]].map(|cone| cone.map(f32::to_degrees));
                notes.warn(format!(
                    "{name}: its cone of full light up to {:.1}° and none from {:.1}° on is out of range: {:.1}° and {:.1}° are used",
                    asked[0], asked[1], used[0], used[1]
                ));
            }
            PunctualKind::Spot { inner_rad, outer_rad }
        }
    })
}
