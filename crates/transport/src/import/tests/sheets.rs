use glam::{Vec3, Vec4};
use serde_json::{Value, json};

use super::fixture::Fixture;
use crate::import::Imported;
use crate::laws::stage::{quad, room};

fn floats(corners: &[Vec3]) -> Vec<[f32; 3]> {
    corners.iter().map(Vec3::to_array).collect()
}

/// A closed box whose fronts look outwards.
fn solid() -> Vec<Vec3> {
    room(Vec3::ONE).into_iter().rev().collect()
}

/// Halves the red of what goes as far as it is thick.
fn glass() -> Value {
    json!({"pbrMetallicRoughness": {"baseColorFactor": [1, 0.5, 1, 1], "metallicFactor": 0, "roughnessFactor": 0},
        "extensions": {"KHR_materials_transmission": {"transmissionFactor": 1}, "KHR_materials_volume":
            {"thicknessFactor": 0.1, "attenuationDistance": 0.1, "attenuationColor": [0.5, 1, 1]}}})
}

fn load(corners: &[Vec3]) -> Imported {
    Fixture::mesh(&floats(corners)).material(glass()).node(json!({"name": "window"})).load()
}

#[test]
fn thick_glass_on_a_sheet_that_encloses_nothing_is_shown_as_thin_glass() {
    let Imported { scene, report } = load(&quad(Vec3::ZERO, Vec3::X, Vec3::Y));
    let [line] = &report.unsupported[..] else { panic!("{:?}", report.unsupported) };
    assert!(line.contains("node \"window\"") && line.contains("thin glass"), "{line}");
    let [material] = &scene.materials[..] else { panic!("{} materials", scene.materials.len()) };
    assert_eq!((material.thickness, material.attenuation_distance), (0.0, f32::INFINITY));
    assert!(material.base_color.distance(Vec4::new(0.5, 0.5, 1.0, 1.0)) < 1e-6, "{}", material.base_color);
    assert!(material.is_clear_pane());
}

#[test]
fn what_is_closed_stays_thick_and_so_does_the_surface_of_water() {
    let without_an_end = &solid()[6..];
    let water = quad(Vec3::ZERO, Vec3::Z, Vec3::X);
    for (corners, name) in [(&solid()[..], "a box"), (without_an_end, "a box without an end"), (&water[..], "water")] {
        let Imported { scene, report } = load(corners);
        assert_eq!((scene.materials[0].thickness, report.unsupported.len()), (0.1, 0), "{name}");
    }
}

#[test]
fn a_box_of_two_nodes_and_materials_is_closed() {
    let (corners, mut fixture) = (solid(), Fixture::new());
    let meshes = [&corners[..18], &corners[18..]].map(|half| {
        let positions = fixture.floats("VEC3", floats(half).as_flattened());
        json!({"primitives": [{"attributes": {"POSITION": positions}, "material": positions}]})
    });
    fixture.root["meshes"] = json!(meshes);
    fixture.root["materials"] = json!([glass(), glass()]);
    fixture.root["nodes"] = json!([{"mesh": 0, "children": [1]}, {"mesh": 1}]);
    let Imported { scene, report } = fixture.load();
    assert_eq!(report.unsupported, [""; 0]);
    assert!(scene.materials.iter().all(|material| material.thickness == 0.1));
}

#[test]
fn a_solid_keeps_the_material_that_it_shares_with_a_sheet() {
    let sheet: Vec<Vec3> = quad(Vec3::X * 5.0, Vec3::X, Vec3::Y);
    let Imported { scene, report } = load(&[solid(), sheet].concat());
    assert_eq!((scene.materials.len(), report.unsupported.len()), (2, 1));
    let thickness = |triangle: usize| scene.materials[scene.mesh.triangle_material[triangle] as usize].thickness;
    assert!((0..12).all(|triangle| thickness(triangle) == 0.1) && thickness(12) == 0.0 && thickness(13) == 0.0);
}
