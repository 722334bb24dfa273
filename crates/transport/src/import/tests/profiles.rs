use std::ops::ControlFlow;

use glam::Vec3;
use serde_json::{Value, json};

use super::fixture::Fixture;
use crate::camera::{Camera, Film};
use crate::emitters::{Lighting, punctual_falloff};
use crate::import::Imported;
use crate::lamp_units::{LUMENS_PER_WATT, assume_unitless};
use crate::light::LightRig;
use crate::photometry::{AssignError, PhotometricProfile, assign};
use crate::prepared::PreparedScene;
use crate::scene::{PunctualKind, Scene};
use crate::trace::{TraceConfig, trace};

/// 400 cd along the aim; across it 100 cd along X, 200 cd along Y, 300 cd along −X.
const LAMP: &str =
    "IESNA:LM-63-2002\nTILT=NONE\n1 -1 2 3 3 1 2 0 0 0\n1 1 9\n0 90 180\n0 90 180\n200 50 0 200 100 0 200 150 0\n";

/// A file with one node that has a profile and whatever else is given.
fn lit(uri: &str, instance: Value, node: Value) -> Imported {
    let mut fixture = Fixture::new();
    fixture.root["extensions"] = json!({"EXT_lights_ies": {"lights": [{"uri": uri}]},
        "KHR_lights_punctual": {"lights": [{"type": "spot", "intensity": 5, "color": [0.5, 1, 1], "spot": {}},
            {"type": "directional"}]}});
    let mut fixture = fixture.node(node);
    fixture.root["nodes"][0]["extensions"]["EXT_lights_ies"] = instance;
    fixture.root["extensionsUsed"] = json!(["EXT_lights_ies"]);
    fixture.load()
}

fn data() -> String {
    format!("data:application/x-ies-lm-63,{LAMP}")
}

/// Candela of the scene's only lamp towards a direction, as the matrix and the file's own light have it.
fn candela(scene: &Scene, toward: Vec3) -> Vec3 {
    let (lighting, _) = Lighting::new(scene, &[]).expect("lights");
    let coefficients = lighting.basis.project(&LightRig::default());
    assert_eq!(coefficients.len(), 1);
    Vec3::from(coefficients[0]) * punctual_falloff(&scene.punctual[0], &scene.profiles, toward)
}

#[test]
fn what_is_mended_in_a_profile_is_told() {
    let noisy = data().replace("200 100 0", "200 100 -1");
    let imported = lit(&noisy, json!({"light": 0}), json!({}));
    assert!(matches!(&imported.report.warnings[..], [one] if one.starts_with("light profile 0: 1 intensities")));
}

#[test]
fn profiles_shine_with_their_candela_as_their_node_turns_them() {
    let turned = json!({"rotation": [-std::f32::consts::FRAC_1_SQRT_2, 0, 0, std::f32::consts::FRAC_1_SQRT_2]});
    let imported = lit(&data(), json!({"light": 0, "multiplier": 0.5, "color": [1, 0.5, 2]}), turned);
    assert!(imported.report.unsupported.is_empty(), "{:?}", imported.report);
    // One channel is more than 1.
    assert!(matches!(&imported.report.warnings[..], [one] if one.contains("color")), "{:?}", imported.report);
    let color = Vec3::new(1.0, 0.5, 1.0);
    // The node's −Z is the world's −Y, its +Y the world's −Z.
    for (toward, known) in
        [(Vec3::NEG_Y, 200.0), (Vec3::X, 50.0), (Vec3::NEG_Z, 100.0), (Vec3::NEG_X, 150.0), (Vec3::Y, 0.0)]
    {
        let got = candela(&imported.scene, toward);
        assert!(got.distance(known * color) < 0.1, "towards {toward}: {got}, not {known}");
    }
    let mirrored = lit(&data(), json!({"light": 0}), json!({"scale": [-1, 1, 1]}));
    assert!(candela(&mirrored.scene, Vec3::X).distance(Vec3::splat(300.0)) < 0.1);
}

#[test]
fn a_floor_under_a_measured_lamp_is_as_bright_as_the_law_of_distance_says() {
    let corner = [[-50.0, 0.0, -50.0], [-50.0, 0.0, 50.0], [50.0, 0.0, 50.0], [50.0, 0.0, -50.0]];
    let mut fixture = Fixture::mesh(&[0, 1, 2, 0, 2, 3].map(|i: usize| corner[i])).material(json!({
        "pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 1], "metallicFactor": 0},
        "extensions": {"KHR_materials_specular": {"specularFactor": 0}}}));
    fixture.root["extensions"] = json!({"EXT_lights_ies": {"lights": [{"uri": data()}]}});
    let down = [-std::f32::consts::FRAC_1_SQRT_2, 0.0, 0.0, std::f32::consts::FRAC_1_SQRT_2];
    fixture.root["nodes"] = json!([{"mesh": 0}, {"translation": [0, 2, 0], "rotation": down,
        "extensions": {"EXT_lights_ies": {"light": 0}}}]);
    fixture.root["scenes"][0]["nodes"] = json!([0, 1]);
    let (scene, _) = PreparedScene::new(fixture.load().scene, &[]).expect("a lit scene");
    let coefficients = scene.lighting.basis.project(&LightRig::default());
    // At 45° from the aim the profile is the mean of its 400 cd and what it has across.
    for (x, z, candela) in
        [(2.0, 0.0, 250.0), (-2.0, 0.0, 350.0), (0.0, 2.0, 300.0), (0.0, -2.0, 300.0), (0.0, 0.0, 400.0)]
    {
        let target = Vec3::new(x, 0.0, z);
        let camera = Camera::look_at("low", target + Vec3::new(1.0, 3.0, 2.0), target, 1e-4, 1.0);
        let config = TraceConfig { spp: 4, bounces: Some(0), seed: 1 };
        let film = Film { width: 1, height: 1 };
        let picture = trace(&scene, &camera, film, &coefficients, &config, &|_| ControlFlow::Continue(()));
        let radiance = picture.expect("nobody stopped it")[0][1];
        let distance = target.distance(2.0 * Vec3::Y);
        let known = 0.5 / std::f32::consts::PI * candela * (2.0 / distance) / (distance * distance);
        assert!((radiance / known - 1.0).abs() < 2e-3, "at {target}: {radiance} nit, not {known}");
    }
}

#[test]
fn a_node_with_both_kinds_of_lamp_has_one() {
    let plain = |light: usize| json!({"extensions": {"KHR_lights_punctual": {"light": light}}});
    let both = lit(&data(), json!({"light": 0, "color": [1, 0.5, 1]}), plain(0));
    assert!(candela(&both.scene, Vec3::NEG_X).distance(300.0 * Vec3::new(0.5, 0.5, 1.0)) < 0.1);
    let without = lit("absent.ies", json!({"light": 0}), plain(0));
    assert_eq!((without.scene.punctual[0].intensity, without.scene.punctual[0].profile), (5.0, None));
    assert_eq!(without.report.warnings.len(), 2, "{:?}", without.report.warnings);
    let sun = lit(&data(), json!({"light": 0}), plain(1));
    assert_eq!((sun.scene.punctual[0].kind, sun.report.warnings.len()), (PunctualKind::Directional, 1));
}

#[test]
fn a_missing_or_broken_profile_is_told_and_leaves_no_darkness() {
    let broken = data().replace("200 50", "200 fifty");
    for (uri, reason) in [("absent.ies", "absent.ies"), ("/etc/hostname", "beside"), (&broken, "line 7 of its data")] {
        let imported = lit(uri, json!({"light": 0, "multiplier": 2}), json!({}));
        assert_eq!(candela(&imported.scene, Vec3::Y), Vec3::splat(200.0));
        let lines = imported.report.warnings.join("\n");
        assert!(lines.contains(reason) && lines.contains("100 cd"), "{lines}");
    }
    for instance in
        [json!({}), json!({"light": 3}), json!({"light": "first"}), json!(7), json!({"light": 0, "multiplier": -1})]
    {
        let imported = lit(&data(), instance, json!({}));
        assert!(imported.scene.punctual[0].intensity >= 100.0);
        assert!(!imported.report.warnings.is_empty());
    }
}

#[test]
fn what_shines_instead_of_a_profile_keeps_its_candela_where_lamps_have_no_units() {
    let plain = json!({"extensions": {"KHR_lights_punctual": {"light": 0}}});
    for (node, candela) in [(json!({}), 100.0), (plain, 5.0 * LUMENS_PER_WATT)] {
        let mut scene = lit("absent.ies", json!({"light": 0}), node).scene;
        assume_unitless(&mut scene);
        assert_eq!(scene.punctual[0].intensity, candela);
    }
}

#[test]
fn profiles_come_from_buffer_views_and_are_read_once() {
    let mut fixture = Fixture::new();
    let view = fixture.view(LAMP.as_bytes());
    fixture.root["extensions"] = json!({"EXT_lights_ies": {"lights": [
        {"bufferView": view, "mimeType": "application/x-ies-lm-63", "name": "hall"}]}});
    let node = json!({"extensions": {"EXT_lights_ies": {"light": 0}}});
    fixture.root["nodes"] = json!([node, node]);
    fixture.root["scenes"][0]["nodes"] = json!([0, 1]);
    let scene = fixture.load().scene;
    assert_eq!((scene.punctual.len(), scene.profiles.len()), (2, 1));
    assert!(scene.punctual.iter().all(|lamp| lamp.profile == Some(0) && lamp.intensity == 400.0));
}

#[test]
fn a_lamp_of_a_scene_takes_a_profile_by_its_key() {
    let mut fixture = Fixture::new();
    fixture.root["extensions"] = json!({"KHR_lights_punctual": {"lights": [
        {"type": "spot", "intensity": 5, "color": [0.5, 1, 1], "spot": {}}, {"type": "directional"}]}});
    let lamp =
        |light: usize, name: &str| json!({"name": name, "extensions": {"KHR_lights_punctual": {"light": light}}});
    fixture.root["nodes"] = json!([lamp(1, "sun"), lamp(0, "desk"), lamp(0, "desk")]);
    fixture.root["scenes"][0]["nodes"] = json!([0, 1, 2]);
    let mut scene = fixture.load().scene;
    let profile = PhotometricProfile::parse(LAMP.as_bytes(), "lamp.ies").expect("valid");
    for key in ["sun", "floor"] {
        let error = assign(&mut scene, key, profile.clone(), 1.0).expect_err("no such lamp");
        assert!(
            matches!(error, AssignError::UnknownLamp { .. }) && error.to_string().contains("desk, desk#2"),
            "{error}"
        );
    }
    assign(&mut scene, "desk#2", profile, 0.25).expect("it exists");
    let [_, first, second] = &scene.punctual[..] else { panic!("three lamps") };
    assert_eq!((first.profile, first.intensity), (None, 5.0));
    assert_eq!((second.profile, second.intensity, second.color), (Some(0), 100.0, Vec3::new(0.5, 1.0, 1.0)));
    assert_eq!(punctual_falloff(second, &scene.profiles, Vec3::NEG_X), 0.75, "the profile stands in for the cone");
}
