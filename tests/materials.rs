//! What of a file's materials is chosen on the command line: variants and energy compensation.

use clerestory::compare::read_exr;
use clerestory_transport::archive;
use serde_json::json;

use crate::pipeline::Desk;

/// A square seen head on: white metal of roughness 1 by default and as "white", a matte black as "black".
const SQUARE: &str = r#"{"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1]}],
    "extensionsUsed": ["KHR_materials_variants", "KHR_materials_specular"],
    "extensions": {"KHR_materials_variants": {"variants": [{"name": "black"}, {"name": "white"}]}},
    "materials": [{"name": "metal"}, {"name": "black", "extensions": {"KHR_materials_specular": {"specularFactor": 0}},
        "pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1], "metallicFactor": 0}}],
    "cameras": [{"type": "perspective", "perspective": {"yfov": 0.1, "aspectRatio": 1, "znear": 0.1}}],
    "nodes": [{"mesh": 0}, {"camera": 0, "translation": [0, 0, 3]}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0, "extensions":
        {"KHR_materials_variants": {"mappings": [{"variants": [0], "material": 1}, {"variants": [1], "material": 0}]}}}]}],
    "accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
        {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"}],
    "bufferViews": [{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 12}],
    "buffers": [{"byteLength": 60, "uri": "data:application/octet-stream;base64,AACAvwAAgL8AAAAAAACAPwAAgL8AAAAAAACAPwAAgD8AAAAAAACAvwAAgD8AAAAAAAABAAIAAAACAAMA"}]}"#;

fn desk() -> Desk {
    let desk = Desk::new();
    std::fs::write(desk.path("square.gltf"), SQUARE).unwrap();
    desk
}

#[test]
fn info_lists_variants_and_what_rough_metal_loses() {
    let desk = desk();
    let info = desk.json("info @square.gltf");
    assert_eq!(info["variants"], json!(["black", "white"]));
    let furnace = &info["furnace_loss"];
    assert!(furnace["materials"] == json!(1) && furnace["at_most"].as_f64().unwrap() < 0.011, "{furnace}");
    assert!((furnace["without_compensation"].as_f64().unwrap() - 0.69).abs() < 0.02, "{furnace}");
    let words = desk.run("info @square.gltf").stdout;
    assert!(words.contains("variants  black, white") && words.contains("without energy compensation"), "{words}");
    assert_eq!(desk.json("info @square.gltf --variant black")["furnace_loss"], json!(null));
    desk.fails("info @square.gltf --variant red", 1, "there are: black, white");
    desk.fails("info @room.glb --variant red", 1, "there are: none");
}

#[test]
fn a_variant_is_traced_by_its_name_and_white_metal_returns_all_light() {
    let desk = desk();
    let mean = |options: &str| {
        desk.json(&format!("trace @square.gltf {options} -o @a.exr --size 8x8 --spp 64 --bounces 1 --sky uniform"));
        let pixels = read_exr(&desk.path("a.exr")).unwrap().pixels;
        pixels.iter().map(|rgb| f64::from(rgb[0])).sum::<f64>() / pixels.len() as f64
    };
    let plain = mean("");
    assert!((plain - 1.0).abs() < 0.02, "{plain}");
    assert!(mean("--variant black") < 0.01);
    assert_eq!(mean("--variant white"), plain);
    let once = mean("--no-energy-compensation");
    assert!((once - 0.31).abs() < 0.02, "{once}");
}

#[test]
fn bakes_of_variants_and_without_compensation_are_told_apart_and_find_their_scene() {
    let desk = desk();
    let lamp =
        r#"{"clerestory": 1, "lamps": [{"key": "bulb", "type": "point", "position": [0, 0, 1], "strength": 1}]}"#;
    std::fs::write(desk.path("lamp.look"), lamp).unwrap();
    let prints = ["", "--variant black", "--no-energy-compensation"].map(|options| {
        desk.json(&format!("bake @square.gltf -o @a.transport --size 8x8 --spp 4 {options}"));
        desk.json("relight @a.transport --scene @square.gltf --look @lamp.look -o @a.exr");
        archive::read(&desk.path("a.transport")).unwrap().header.fingerprint.clone()
    });
    assert!(prints[0] != prints[1] && prints[1] != prints[2] && prints[0] != prints[2], "{prints:?}");
    let sun = desk.run("trace @room.glb --sun-size 0.5 -o @a.exr --size 4x4 --spp 1");
    assert!(sun.stderr.contains("--sun-size changes nothing"), "{}", sun.stderr);
}
