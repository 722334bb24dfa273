//! KHR_lights_punctual.

use std::f32::consts::{FRAC_PI_2, FRAC_PI_4};

use glam::{DMat4, DVec3, Vec3};

use super::document::{Document, Light, called};
use super::report::Notes;
use crate::scene::{PunctualKind, PunctualLight};

/// The lamp of a node, if it has one that is known. `node_idx` is the index into `Scene::nodes`.
pub(super) fn lamp(
    document: &Document,
    index: usize,
    world_from_node: DMat4,
    node_idx: u32,
    notes: &mut Notes,
) -> Option<PunctualLight> {
    let Some(light) = document.extensions.lights.lights.get(index) else {
        notes.warn(format!("lamp {index} does not exist: it is left out"));
        return None;
    };
    let name = called("lamp", index, light.name.as_ref());
    let Some(kind) = kind(light) else {
        notes.warn(format!("{name}: its type {:?} is not known: it is left out", light.kind));
        return None;
    };
    if light.range.is_some() {
        notes.unsupported(format!("{name}: its range is ignored, light falls off with the square of the distance"));
    }
    if light.extensions.contains_key("EXT_lights_ies") {
        notes.unsupported(format!("{name}: its measured distribution (IES) is ignored"));
    }
    let color = Vec3::from(light.color.unwrap_or([1.0; 3]));
    let intensity = light.intensity.unwrap_or(1.0);
    let sane = |x: f32| x.is_finite() && x >= 0.0;
    if !(sane(intensity) && color.to_array().into_iter().all(sane)) {
        notes.warn(format!("{name}: its color {color} times intensity {intensity} is out of range: it is left out"));
        return None;
    }
    let position = world_from_node.w_axis.truncate();
    let direction = -world_from_node.z_axis.truncate();
    let direction = direction.try_normalize().unwrap_or(DVec3::NEG_Z).as_vec3();
    Some(PunctualLight { node: node_idx, kind, position: position.as_vec3(), direction, color, intensity })
}

fn kind(light: &Light) -> Option<PunctualKind> {
    match light.kind.as_str() {
        "point" => Some(PunctualKind::Point),
        "directional" => Some(PunctualKind::Directional),
        "spot" => {
            let angle = |value: Option<f32>, default: f32| value.filter(|x| x.is_finite()).unwrap_or(default);
            let outer_rad = angle(light.spot.outer_cone_angle, FRAC_PI_4).clamp(1e-3, FRAC_PI_2);
            let inner_rad = angle(light.spot.inner_cone_angle, 0.0).clamp(0.0, outer_rad);
            Some(PunctualKind::Spot { inner_rad, outer_rad })
        }
        _ => None,
    }
}
