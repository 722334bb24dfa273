//! Free lamps as nodes of the file. Those with a body become shining surfaces.

use std::f32::consts::{FRAC_PI_2, PI, TAU};
use std::path::Path;

use anyhow::{Context, Result};
use clerestory_transport::lamps::{FreeLamp, LEAST_CONE_RAD, LampShape, PreparedLamps, least_size_m};
use clerestory_transport::light::LightRig;
use clerestory_transport::photometry::PhotometricProfile;
use clerestory_transport::prepared::PreparedScene;
use glam::{Mat3, Quat, Vec3};
use serde_json::{Value, json};

use super::lights::color_and_strength;
use super::muted::{Part, darken, switched_on};
use super::raw::{Document, LAMPS, PROFILES, whole};
use super::shared::Shared;

/// Corners of a disk, and of a sphere from pole to pole; around it has twice as many.
const DISK_CORNERS: u16 = 64;
const SPHERE_RINGS: u16 = 16;
/// By how much a cone of 90° may be off, radians.
const ROUNDED: f32 = 1e-3;

/// Adds a node for each lamp of a rig.
pub(super) fn write(
    document: &mut Document,
    scene: &PreparedScene,
    rig: &LightRig,
    warnings: &mut Vec<String>,
) -> Result<()> {
    let (lamps, on) = (rig.lit_lamps(), switched_on(rig).lit_lamps());
    let lamps = lamps.iter().zip(&on).filter(|(lamp, _)| scene.lighting.basis.source(&lamp.key).is_none());
    for (lamp, on) in lamps {
        let [as_set, on] = [light_of(lamp, scene)?, light_of(on, scene)?];
        let is_off = as_set == Vec3::ZERO && on != Vec3::ZERO;
        let light = if is_off { on } else { as_set };
        let (node, part) = match &lamp.shape {
            LampShape::Rectangle { .. } | LampShape::Disk { .. } | LampShape::Sphere { .. } if light == Vec3::ZERO => {
                warnings.push(format!("`{}` has a body and no strength, so it is not written", lamp.key));
                continue;
            }
            LampShape::Rectangle { .. } | LampShape::Disk { .. } | LampShape::Sphere { .. } => {
                (body(document, lamp, least_size_m(scene), light), Part::Surfaces)
            }
            LampShape::Profile { file } => {
                let file = Path::new(file);
                if file.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("ldt")) {
                    warnings.push(format!(
                        "`{}` has a EULUMDAT file, which other programs may not read there: glTF asks for IES",
                        lamp.key
                    ));
                }
                let (node, most_cd) = measured(document, lamp, light, file)?;
                (node, Part::Lamp(Some(most_cd)))
            }
            LampShape::Point | LampShape::Spot { .. } | LampShape::Directional { .. } => {
                warnings.extend(lost(lamp));
                (punctual(document, lamp, light), Part::Lamp(None))
            }
        };
        let node = document.push("nodes", &node);
        place(document, node)?;
        if is_off {
            darken(document, &mut Shared::default(), node, part)?;
        }
    }
    Ok(())
}

/// What glTF has no place for of a lamp without a body, in words.
fn lost(lamp: &FreeLamp) -> Option<String> {
    let key = &lamp.key;
    match lamp.shape {
        LampShape::Spot { outer_rad, .. } if outer_rad > FRAC_PI_2 + ROUNDED => {
            Some(format!("`{key}` has a cone of more than 90°, which glTF has no place for: its light ends there"))
        }
        _ => lamp.shape.has_soft_shadows().then(|| without_angle(key)),
    }
}

/// That a directional lamp loses its size.
pub(super) fn without_angle(key: &str) -> String {
    format!("`{key}` has an angle, which glTF has no place for: its shadows are sharp there")
}

/// What a lamp sends at most, channel by channel.
fn light_of(lamp: &FreeLamp, scene: &PreparedScene) -> Result<Vec3> {
    let prepared = PreparedLamps::new(std::slice::from_ref(lamp), None)?.0.in_scene(scene);
    Ok(prepared.emission(&lamp.key).unwrap_or(Vec3::ZERO))
}

/// Puts a node into the scene that is shown.
fn place(document: &mut Document, node: usize) -> Result<()> {
    let n_scenes = document.len("scenes");
    let idx = document.read("scene").and_then(whole).filter(|idx| *idx < n_scenes).unwrap_or(0);
    let mut scene = document.item("scenes", idx).context("the file names no scene that a lamp could be put in")?;
    let nodes: Vec<f64> = scene.read("nodes").unwrap_or_default();
    let mut nodes: Vec<usize> = nodes.into_iter().filter_map(whole).collect();
    nodes.push(node);
    scene.set("nodes", &nodes);
    document.put("scenes", idx, &scene);
    Ok(())
}

/// A node at a lamp that shines along its −Z.
fn node(lamp: &FreeLamp, members: Value) -> Value {
    let [right, up, ahead] = lamp.frame();
    let rotation = Quat::from_mat3(&Mat3::from_cols(right, up, -ahead)).normalize();
    let mut node =
        json!({ "name": lamp.key, "translation": lamp.position.to_array(), "rotation": rotation.to_array() });
    if let (Some(node), Value::Object(members)) = (node.as_object_mut(), members) {
        node.extend(members);
    }
    node
}

fn punctual(document: &mut Document, lamp: &FreeLamp, light: Vec3) -> Value {
    let (color, intensity) = color_and_strength(light);
    let mut own = json!({ "name": lamp.key, "color": color, "intensity": intensity, "type": "point" });
    match lamp.shape {
        LampShape::Spot { inner_rad, outer_rad } => {
            own["type"] = "spot".into();
            let outer_rad = outer_rad.clamp(LEAST_CONE_RAD, FRAC_PI_2);
            // glTF asks for less than the outer angle, and for a right angle at most: in single precision that is a little more.
            let inner_rad = inner_rad.min(outer_rad.next_down());
            let outer_rad = f64::from(outer_rad).min(std::f64::consts::FRAC_PI_2);
            own["spot"] = json!({ "innerConeAngle": inner_rad, "outerConeAngle": outer_rad });
        }
        LampShape::Directional { .. } => own["type"] = "directional".into(),
        _ => {}
    }
    document.uses(LAMPS);
    let idx = document.push(LAMPS, &own);
    node(lamp, json!({ "extensions": { LAMPS: { "light": idx } } }))
}

/// A lamp with a measured distribution, which goes into the file, and the most that this sends, candela.
fn measured(document: &mut Document, lamp: &FreeLamp, light: Vec3, file: &Path) -> Result<(Value, f32)> {
    let name = file.display().to_string();
    let bytes = std::fs::read(file).with_context(|| format!("cannot read the profile {name} of `{}`", lamp.key))?;
    let most = PhotometricProfile::parse(&bytes, &name)?.max_candela();
    let (color, candela) = color_and_strength(light);
    document.uses(PROFILES);
    let uri = data_uri(&bytes);
    // By the name of the file it is known what the data is.
    let file_name = file.file_name().unwrap_or(file.as_os_str()).to_string_lossy();
    let idx = document.push(PROFILES, &json!({ "name": file_name, "uri": uri }));
    let instance = json!({ "light": idx, "multiplier": candela / most.max(f32::MIN_POSITIVE), "color": color });
    Ok((node(lamp, json!({ "extensions": { PROFILES: instance } })), most))
}

/// A black surface that shines, of the area that the lamp has: what is smaller than `least_m` shines from that size.
fn body(document: &mut Document, lamp: &FreeLamp, least_m: f32, light: Vec3) -> Value {
    let (corners, normals, indices) = match lamp.shape {
        LampShape::Rectangle { size_m } => rectangle(size_m.map(|side| side.max(least_m))),
        LampShape::Disk { radius_m } => disk(radius_m.max(0.5 * least_m)),
        LampShape::Sphere { radius_m } => sphere(radius_m.max(0.5 * least_m)),
        _ => return Value::Null,
    };
    let (color, strength) = color_and_strength(light);
    document.uses("KHR_materials_emissive_strength");
    document.uses("KHR_materials_specular");
    let material = document.push(
        "materials",
        &json!({
            "name": lamp.key, "emissiveFactor": color,
            "pbrMetallicRoughness": { "baseColorFactor": [0, 0, 0, 1], "metallicFactor": 0 },
            "extensions": {
                "KHR_materials_emissive_strength": { "emissiveStrength": strength },
                "KHR_materials_specular": { "specularFactor": 0 },
            },
        }),
    );
    let mesh = mesh(document, lamp, (&corners, &normals, &indices), material);
    node(lamp, json!({ "mesh": mesh }))
}

fn mesh(
    document: &mut Document,
    lamp: &FreeLamp,
    (corners, normals, indices): (&[Vec3], &[Vec3], &[u16]),
    material: usize,
) -> usize {
    let floats =
        |values: &[Vec3]| -> Vec<u8> { values.iter().flat_map(|v| v.to_array()).flat_map(f32::to_le_bytes).collect() };
    let parts = [floats(corners), floats(normals), indices.iter().flat_map(|idx| idx.to_le_bytes()).collect()];
    let bytes = parts.concat();
    let buffer = document.push("buffers", &json!({ "byteLength": bytes.len(), "uri": data_uri(&bytes) }));
    let mut start = 0;
    let views = parts.each_ref().map(|part| {
        let view = json!({ "buffer": buffer, "byteOffset": start, "byteLength": part.len() });
        start += part.len();
        document.push("bufferViews", &view)
    });
    let bound = |fold: fn(Vec3, Vec3) -> Vec3| corners.iter().copied().reduce(fold).unwrap_or_default().to_array();
    let (low, high) = (bound(Vec3::min), bound(Vec3::max));
    let mut accessor = |view: usize, count: usize, kind: (&str, u32), bounds: Option<[[f32; 3]; 2]>| {
        let mut accessor = json!({ "bufferView": view, "componentType": kind.1, "count": count, "type": kind.0 });
        if let Some([low, high]) = bounds {
            (accessor["min"], accessor["max"]) = (json!(low), json!(high));
        }
        document.push("accessors", &accessor)
    };
    let position = accessor(views[0], corners.len(), ("VEC3", 5126), Some([low, high]));
    let normal = accessor(views[1], normals.len(), ("VEC3", 5126), None);
    let index = accessor(views[2], indices.len(), ("SCALAR", 5123), None);
    let primitive =
        json!({ "attributes": { "POSITION": position, "NORMAL": normal }, "indices": index, "material": material });
    document.push("meshes", &json!({ "name": lamp.key, "primitives": [primitive] }))
}

type Shape = (Vec<Vec3>, Vec<Vec3>, Vec<u16>);

/// Bodies shine to −Z, where their node does.
fn rectangle([width, height]: [f32; 2]) -> Shape {
    let corner = |x: f32, y: f32| Vec3::new(0.5 * x * width, 0.5 * y * height, 0.0);
    let corners = vec![corner(-1.0, -1.0), corner(-1.0, 1.0), corner(1.0, 1.0), corner(1.0, -1.0)];
    (corners, vec![Vec3::NEG_Z; 4], vec![0, 1, 2, 0, 2, 3])
}

/// A polygon of the area of the disk.
fn disk(radius: f32) -> Shape {
    let n = f32::from(DISK_CORNERS);
    let radius = radius * (TAU / (n * (TAU / n).sin())).sqrt();
    let corner = |idx: u16| {
        let (sin, cos) = (f32::from(idx) / n * TAU).sin_cos();
        Vec3::new(radius * cos, -radius * sin, 0.0)
    };
    let corners: Vec<Vec3> = (0..DISK_CORNERS).map(corner).collect();
    let indices = (1..DISK_CORNERS - 1).flat_map(|idx| [0, idx, idx + 1]).collect();
    (corners, vec![Vec3::NEG_Z; usize::from(DISK_CORNERS)], indices)
}

/// Facets of the area of the sphere.
fn sphere(radius: f32) -> Shape {
    let around = 2 * SPHERE_RINGS;
    let normal = |ring: u16, segment: u16| {
        let (sin, cos) = (f32::from(ring) / f32::from(SPHERE_RINGS) * PI).sin_cos();
        let (y, x) = (f32::from(segment) / f32::from(around) * TAU).sin_cos();
        Vec3::new(sin * x, cos, -sin * y)
    };
    let normals: Vec<Vec3> = (0..=SPHERE_RINGS).flat_map(|ring| (0..=around).map(move |s| normal(ring, s))).collect();
    let at = |ring: u16, segment: u16| ring * (around + 1) + segment;
    let mut indices = Vec::new();
    for ring in 0..SPHERE_RINGS {
        for segment in 0..around {
            let [a, b] = [at(ring, segment), at(ring, segment + 1)];
            let [c, d] = [at(ring + 1, segment), at(ring + 1, segment + 1)];
            // At the poles one of the two triangles has no area.
            indices.extend(if ring > 0 { vec![a, c, b] } else { vec![] });
            indices.extend(if ring + 1 < SPHERE_RINGS { vec![b, c, d] } else { vec![] });
        }
    }
    let area = |corners: &[u16]| {
        let [a, b, c] = [0, 1, 2].map(|i| normals[usize::from(corners[i])]);
        0.5 * (b - a).cross(c - a).length()
    };
    let scale = radius * (4.0 * PI / indices.chunks_exact(3).map(area).sum::<f32>()).sqrt();
    (normals.iter().map(|normal| *normal * scale).collect(), normals, indices)
}

fn data_uri(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut uri = String::from("data:application/octet-stream;base64,");
    for three in bytes.chunks(3) {
        let bits = three.iter().fold(0u32, |bits, byte| bits << 8 | u32::from(*byte)) << (8 * (3 - three.len()));
        for digit in 0..4 {
            let idx = (bits >> (18 - 6 * digit)) as usize & 63;
            uri.push(if digit <= three.len() { char::from(DIGITS[idx]) } else { '=' });
        }
    }
    uri
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bodies_have_the_area_of_their_lamps_and_face_where_they_shine() {
        for ((corners, normals, indices), expected) in
            [(rectangle([2.0, 0.5]), 1.0), (disk(0.3), PI * 0.09), (sphere(0.3), 4.0 * PI * 0.09)]
        {
            let mut area = 0.0;
            for triangle in indices.chunks_exact(3) {
                let [a, b, c] = [0, 1, 2].map(|i| corners[usize::from(triangle[i])]);
                let cross = (b - a).cross(c - a);
                area += 0.5 * cross.length();
                assert!(cross.dot(normals[usize::from(triangle[0])]) > 0.0, "{a} {b} {c}");
            }
            assert!((area / expected - 1.0).abs() < 1e-4, "{area} is not {expected}");
        }
    }

    #[test]
    fn data_is_written_as_base_64() {
        let of = |bytes: &[u8]| data_uri(bytes).split_once(',').map(|(_, data)| data.to_owned());
        let known = [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foob", "Zm9vYg==")];
        known.into_iter().for_each(|(text, data)| assert_eq!(of(text.as_bytes()).as_deref(), Some(data)));
    }
}
