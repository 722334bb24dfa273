//! Thick glass on open sheets, as files for rasterizers have it: what enters never leaves. It is shown as thin glass.

use std::collections::{BTreeSet, HashMap};

use glam::Vec3;

use super::document::called;
use super::report::Notes;
use crate::scene::{Material, Scene};

/// Length of the sum of the triangles' areas along their normals, over the sum of their lengths, above which they are a sheet: nothing
/// of a closed body, all of a flat sheet.
const OPEN: f32 = 0.5;
/// Cosine of the steepest sheet that looks up: what lies below the surface of water is its inside.
const LEVEL: f32 = 0.7;

/// Makes thick glass thin on sheets that enclose nothing, with a line for each node.
pub(super) fn make_thin(scene: &mut Scene, notes: &mut Notes) {
    let sheets = sheets(scene);
    let mut is_sheet = vec![false; scene.mesh.triangles.len()];
    sheets.iter().for_each(|&triangle| is_sheet[triangle as usize] = true);
    let (mut twins, mut nodes) = (HashMap::new(), BTreeSet::new());
    for &triangle in &sheets {
        let material = scene.mesh.triangle_material[triangle as usize];
        let twin = *twins.entry(material).or_insert_with(|| thin_twin(scene, material, &is_sheet));
        scene.mesh.triangle_material[triangle as usize] = twin;
        nodes.insert(scene.mesh.triangle_node[triangle as usize]);
    }
    for node in nodes.into_iter().map(|node| &scene.nodes[node as usize]) {
        let name = called("node", node.index as usize, node.name.as_ref());
        notes.unsupported(format!("{name}: its glass has a thickness but encloses nothing: it is shown as thin glass"));
    }
}

/// Triangles of thick glass on open sheets that do not look up.
fn sheets(scene: &Scene) -> Vec<u32> {
    let mesh = &scene.mesh;
    let is_thick = |material: &Material| !material.unlit && material.transmission > 0.0 && material.thickness > 0.0;
    let thick: Vec<bool> = scene.materials.iter().map(is_thick).collect();
    let glass = mesh.triangle_material.iter().zip(0..).filter(|(material, _)| thick[**material as usize]);
    let glass: Vec<u32> = glass.map(|(_, triangle)| triangle).collect();
    let is_sheet = |body: &Vec<u32>| {
        let areas = || body.iter().map(|&triangle| mesh.area_normal(triangle));
        let (sum, total) = (areas().sum::<Vec3>(), areas().map(Vec3::length).sum::<f32>());
        sum.length() > OPEN * total && sum.y < LEVEL * sum.length()
    };
    // Whatever closes a body, be it of another node or material, hangs together with it.
    mesh.bodies(&glass, |_| ()).into_iter().filter(is_sheet).flatten().collect()
}

/// A material made thin: in its place, if only sheets have it.
#[expect(clippy::cast_possible_truncation, reason = "twice as many materials as the file has, which fit by far")]
fn thin_twin(scene: &mut Scene, material: u32, is_sheet: &[bool]) -> u32 {
    let twin = thin(&scene.materials[material as usize]);
    let mut users = scene.mesh.triangle_material.iter().zip(is_sheet).filter(|(own, _)| **own == material);
    if users.all(|(_, is_sheet)| *is_sheet) {
        scene.materials[material as usize] = twin;
        return material;
    }
    scene.materials.push(twin);
    scene.materials.len().saturating_sub(1) as u32
}

/// The same without an inside, tinted once by as much of it as the file says.
fn thin(material: &Material) -> Material {
    let passed = material.attenuation_color.powf(material.thickness / material.attenuation_distance);
    Material {
        base_color: material.base_color * passed.extend(1.0),
        thickness: 0.0,
        attenuation_color: Vec3::ONE,
        attenuation_distance: f32::INFINITY,
        ..material.clone()
    }
}
