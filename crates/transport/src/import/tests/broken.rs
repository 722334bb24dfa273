use serde_json::{Value, json};

use super::fixture::Fixture;
use crate::import::{ImportError, load_bytes};
use crate::scene::Material;

/// A file that uses everything that has an index in it.
fn rich() -> Fixture {
    let mut fixture = Fixture::triangle();
    let floats = fixture.floats("VEC3", &[0.5; 9]);
    let colors = fixture.floats("VEC4", &[0.5; 12]);
    let uvs = fixture.floats("VEC2", &[0.5; 6]);
    let indices = fixture.accessor("SCALAR", 5121, 3, &[0, 1, 2]);
    let places = fixture.view(&[1]);
    fixture.root["accessors"][floats]["sparse"] = json!({"count": 1,
        "indices": {"bufferView": places, "componentType": 5121}, "values": {"bufferView": 0, "byteOffset": 0}});
    fixture.root["bufferViews"][0]["byteStride"] = json!(12);
    fixture.root["images"] = json!([{"bufferView": 0}]);
    fixture.root["samplers"] = json!([{"wrapS": 33071}]);
    fixture.root["textures"] = json!([{"source": 0, "sampler": 0}]);
    fixture.root["cameras"] = json!([{"type": "perspective", "perspective": {"yfov": 1.0, "aspectRatio": 1.0}}]);
    fixture.root["extensions"] = json!({"KHR_lights_punctual": {"lights": [
        {"type": "spot", "color": [1, 1, 1], "intensity": 1.0, "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.2}}]}});
    fixture.root["nodes"] = json!([{"children": [1], "camera": 0}, {"mesh": 0, "scale": [1, 1, 1], "weights": [1.0],
        "rotation": [0, 0, 0, 1], "translation": [0, 0, 0],
        "extensions": {"KHR_lights_punctual": {"light": 0}, "EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 0}}}}]);
    fixture.root["meshes"][0]["primitives"][0] = json!({"indices": indices, "mode": 4, "material": 0,
        "attributes": {"POSITION": 0, "NORMAL": floats, "COLOR_0": colors, "TEXCOORD_0": uvs, "TANGENT": colors},
        "targets": [{"POSITION": floats}]});
    let texture = json!({"index": 0, "texCoord": 0, "scale": 1.0,
        "extensions": {"KHR_texture_transform": {"offset": [0, 0], "rotation": 0.5, "scale": [1, 1], "texCoord": 0}}});
    fixture.root["materials"] = json!([{"normalTexture": texture, "emissiveTexture": texture, "alphaCutoff": 0.5,
        "emissiveFactor": [1, 1, 1], "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 1], "roughnessFactor": 0.5},
        "extensions": {"KHR_materials_ior": {"ior": 1.5}, "KHR_materials_emissive_strength": {"emissiveStrength": 2.0}}}]);
    fixture
}

/// Every number below a value, as a path of keys.
fn numbers(value: &Value, path: &str, found: &mut Vec<String>) {
    match value {
        Value::Number(_) => found.push(path.to_owned()),
        Value::Array(items) => {
            items.iter().enumerate().for_each(|(i, item)| numbers(item, &format!("{path}/{i}"), found));
        }
        Value::Object(members) => {
            members.iter().for_each(|(key, item)| numbers(item, &format!("{path}/{key}"), found));
        }
        _ => {}
    }
}

#[test]
fn no_single_wrong_number_brings_it_down() {
    assert_eq!(rich().load().scene.mesh.triangles.len(), 3, "the sound file loads");
    let mut paths = Vec::new();
    numbers(&rich().root, "", &mut paths);
    assert!(paths.len() > 100, "{}", paths.len());
    let wrong =
        [json!(-1), json!(1), json!(7), json!(255), json!(1u64 << 32), json!(u64::MAX), json!(1e38), json!(0.5)];
    for path in &paths {
        for value in &wrong {
            let mut fixture = rich();
            *fixture.root.pointer_mut(path).expect("a path that was found") = value.clone();
            if let Err(error) = load_bytes("wrong.gltf", &fixture.json()) {
                assert!(error.to_string().contains("wrong.gltf"), "{error}");
            }
        }
    }
}

#[test]
fn no_truncation_brings_it_down() {
    let glb = rich().glb();
    for length in 0..glb.len() {
        if let Ok(imported) = load_bytes("cut.glb", &glb[..length]) {
            assert!(!imported.report.warnings.is_empty(), "{length} of {} bytes load without a word", glb.len());
        }
    }
}

#[test]
fn compressed_geometry_is_refused_with_a_remedy() {
    let mut fixture = Fixture::triangle();
    fixture.root["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]);
    let error = load_bytes("tight.glb", &fixture.glb()).expect_err("refused");
    assert!(matches!(error, ImportError::Extension { .. }));
    let text = error.to_string();
    for part in ["Draco", "tight.glb", "export it again", "gltf-transform copy"] {
        assert!(text.contains(part), "{text}");
    }
}

#[test]
fn a_broken_compressed_view_costs_its_mesh_alone() {
    // Indices 0, 1, 2 as differences from the one before.
    let stream = [0xD1, 0, 4, 4, 0, 0, 0, 0];
    for (first, n_triangles) in [(0xD1, 2), (0xD0, 1)] {
        let mut fixture = Fixture::triangle();
        let compressed = fixture.view(&[&[first], &stream[1..]].concat());
        let indices = fixture.accessor("SCALAR", 5123, 3, &[0; 6]);
        let offset = fixture.root["bufferViews"][compressed]["byteOffset"].clone();
        let view = fixture.root["accessors"][indices]["bufferView"].as_u64().expect("a view") as usize;
        fixture.root["bufferViews"][view] = json!({"buffer": 1, "byteLength": 6, "extensions": {"KHR_meshopt_compression":
            {"buffer": 0, "byteOffset": offset, "byteLength": 8, "byteStride": 2, "count": 3, "mode": "INDICES"}}});
        let mut second = fixture.primitive().clone();
        second["indices"] = json!(indices);
        fixture.root["meshes"][0]["primitives"].as_array_mut().expect("primitives").push(second);
        fixture.root["buffers"] = json!([{}, {"byteLength": 6}]);
        fixture.root["extensionsRequired"] = json!(["KHR_meshopt_compression"]);
        let imported = load_bytes("tight.glb", &fixture.glb()).expect("a loadable file");
        assert_eq!(imported.scene.mesh.triangles.len(), n_triangles);
        let told = imported.report.warnings.iter().any(|line| line.contains("cannot be decompressed"));
        assert_eq!(told, n_triangles == 1, "{:?}", imported.report.warnings);
    }
}

#[test]
fn what_is_not_read_may_be_anything() {
    let mut fixture = Fixture::triangle();
    fixture.root["animations"] = json!([{"channels": [{"target": {"path": "pointer"}}]}]);
    fixture.root["skins"] = json!([7]);
    fixture.root["cameras"] = json!([{"type": "fisheye"}]);
    fixture.root["samplers"] = json!([{"minFilter": "soft", "wrapS": 1}]);
    fixture.root["accessors"][0]["min"] = json!("none");
    fixture.root["materials"] = json!([{"occlusionTexture": 3, "alphaMode": "DITHER"}]);
    fixture.root["scenes"] = json!([{"nodes": [0]}, {"name": "empty"}]);
    let imported = fixture.load();
    assert_eq!(imported.scene.mesh.triangles.len(), 1);
    assert!(imported.report.unsupported[0].contains("1 animations"), "{:?}", imported.report.unsupported);
}

#[test]
fn scenes_that_are_not_shown_are_named() {
    let mut fixture = Fixture::triangle();
    fixture.root["nodes"] = json!([{"mesh": 0}, {"mesh": 0}]);
    fixture.root["scenes"] =
        json!([{"nodes": [1, 0]}, {"name": "Day", "nodes": [1]}, {"name": "Night", "nodes": [0]}, {}]);
    fixture.root["scene"] = json!(2);
    let imported = fixture.load();
    assert_eq!(imported.scene.mesh.triangles.len(), 1);
    let [first, second] = &imported.report.unsupported[..] else { panic!("{:?}", imported.report.unsupported) };
    assert!(first.starts_with("scene 0: ") && second.starts_with("scene \"Day\": "), "{first}, {second}");
}

#[test]
fn the_element_at_fault_is_named() {
    let mut fixture = Fixture::triangle();
    fixture.root["materials"] = json!([{}, {"doubleSided": "yes"}]);
    let error = load_bytes("torn.gltf", &fixture.json()).expect_err("refused");
    assert!(error.to_string().contains("materials[1]"), "{error}");
    let mut fixture = Fixture::triangle();
    fixture.root["extensions"] =
        json!({"KHR_lights_punctual": {"lights": [{"type": "point"}, {"type": "spot", "intensity": "100"}]}});
    let error = load_bytes("torn.gltf", &fixture.json()).expect_err("refused").to_string();
    assert!(error.contains("extensions.KHR_lights_punctual.lights[1]: invalid type: string"), "{error}");
    let mut fixture = Fixture::triangle();
    fixture.root["scene"] = json!("first");
    let error = load_bytes("torn.gltf", &fixture.json()).expect_err("refused").to_string();
    assert!(error.contains(": scene: invalid type"), "{error}");
}

#[test]
fn members_that_are_null_are_read_as_left_out() {
    let mut fixture = Fixture::triangle().material(json!({
        "doubleSided": null, "alphaMode": null, "emissiveFactor": null, "extras": {"theirs": null},
        "pbrMetallicRoughness": {"metallicFactor": null, "baseColorTexture": null},
        "extensions": {
            "KHR_materials_volume": {"thicknessFactor": 1, "attenuationDistance": null},
            "KHR_materials_transmission": {"transmissionFactor": 1}, "KHR_materials_ior": {"ior": null},
            "KHR_materials_emissive_strength": {"emissiveStrength": null},
            "KHR_materials_clearcoat": {"clearcoatFactor": 1, "clearcoatRoughnessFactor": null},
        },
    }));
    fixture.root["extensions"] =
        json!({"KHR_lights_punctual": {"lights": [{"type": "point", "color": null, "range": null}]}});
    fixture.root["nodes"][0]["extensions"] = json!({"KHR_lights_punctual": {"light": 0}});
    for key in ["samplers", "textures", "skins", "animations", "extensionsUsed", "scene"] {
        fixture.root[key] = Value::Null;
    }
    for key in ["mode", "indices", "targets"] {
        fixture.primitive()[key] = Value::Null;
    }
    fixture.root["accessors"][0]["normalized"] = Value::Null;
    let imported = fixture.load();
    assert_eq!(imported.report.warnings, Vec::<String>::new());
    let (material, plain) = (&imported.scene.materials[0], Material::default());
    assert_eq!((material.thickness, material.attenuation_distance), (1.0, f32::INFINITY));
    assert_eq!((material.metallic, material.ior, material.alpha), (plain.metallic, plain.ior, plain.alpha));
    assert_eq!(material.finish.as_ref().map(|finish| finish.clearcoat), Some(1.0));
    assert_eq!((imported.scene.punctual.len(), imported.scene.mesh.triangles.len()), (1, 1));
    let mut fixture = Fixture::triangle();
    fixture.root["nodes"] = json!([null]);
    assert!(load_bytes("torn.gltf", &fixture.json()).is_err(), "a list has no gaps");
}

#[test]
fn indices_of_minus_one_and_textures_without_an_index_are_read_as_left_out() {
    let mut fixture = shows(&png_of(1, 1));
    let material = &mut fixture.root["materials"][0];
    material["normalTexture"] = json!({"index": -1, "scale": 1});
    material["emissiveTexture"] = json!({"index": null, "texCoord": 0});
    material["extensions"] = json!({
        "KHR_materials_transmission": {"transmissionFactor": 1, "transmissionTexture": {"index": -1.0}},
        "KHR_materials_clearcoat": {"clearcoatFactor": 1, "clearcoatTexture": {}},
    });
    fixture.root["images"][0]["uri"] = json!("");
    fixture.root["textures"] = json!([{"source": 0, "sampler": -1}, {"source": -1}]);
    fixture.root["samplers"] = json!([{"magFilter": -1, "minFilter": -1}]);
    fixture.root["scene"] = json!(-1);
    for key in ["mode", "indices"] {
        fixture.primitive()[key] = json!(-1);
    }
    let nothing = json!({"KHR_lights_punctual": {"light": -1}});
    let imported = fixture.node(json!({"camera": -1, "skin": -1, "extensions": nothing})).load();
    assert_eq!(imported.report.warnings, Vec::<String>::new());
    let (scene, mut material) = (&imported.scene, imported.scene.materials[0].clone());
    assert_eq!(material.texture_slots().into_iter().flatten().count(), 1, "{material:?}");
    assert_eq!(material.finish.as_ref().map(|finish| finish.clearcoat), Some(1.0));
    assert_eq!(scene.textures[0].image.texels, [[9, 8, 7, 255]]);
    assert_eq!((scene.mesh.triangles.len(), scene.punctual.len()), (1, 0));
}

#[test]
fn a_file_that_states_no_version_is_told_so() {
    for text in [r#"{"nodes": []}"#, r#"{"asset": {"version": 2.0}}"#, r#"{"asset": {"version": null}}"#] {
        let error = load_bytes("none.gltf", text.as_bytes()).expect_err("refused");
        assert!(matches!(error, ImportError::NoVersion { .. }), "{error}");
    }
}

#[test]
fn chunks_of_a_kind_that_is_not_known_are_passed_over() {
    let chunk = |kind: &[u8; 4], bytes: &[u8]| [&(bytes.len() as u32).to_le_bytes(), &kind[..], bytes].concat();
    let glb = |chunks: &[Vec<u8>]| {
        let chunks = chunks.concat();
        [&b"glTF\x02\0\0\0"[..], &(chunks.len() as u32 + 12).to_le_bytes(), &chunks].concat()
    };
    let (json, other) = (chunk(b"JSON", &Fixture::triangle().json()), chunk(b"XTRA", b"four"));
    let imported = load_bytes("a.glb", &glb(&[json.clone(), other.clone()])).expect("a loadable file");
    assert_eq!(imported.scene.mesh.triangles.len(), 1);
    // The binary chunk counts behind it, too.
    let whole = Fixture::triangle().glb();
    let length = u32::from_le_bytes(whole[12..16].try_into().expect("four bytes")) as usize;
    let (head, bin) = whole[12..].split_at(8 + length);
    let parted = glb(&[head.to_vec(), other.clone(), other.clone(), bin.to_vec()]);
    let imported = load_bytes("a.glb", &parted).expect("a loadable file");
    assert_eq!((imported.scene.mesh.triangles.len(), imported.report.warnings), (1, Vec::new()));
    let error = load_bytes("a.glb", &glb(&[other, json])).expect_err("JSON comes first").to_string();
    assert!(error.contains("unknown type"), "{error}");
}

#[test]
fn gltf_1_is_named() {
    let error = load_bytes("old.gltf", br#"{"asset": {"version": "1.0"}, "nodes": {"a": {}}}"#).expect_err("refused");
    assert!(matches!(error, ImportError::Version { .. }), "{error}");
}

#[test]
fn a_file_for_newer_readers_alone_is_refused_in_words() {
    let load = |asset: serde_json::Value| {
        let mut fixture = Fixture::triangle();
        fixture.root["asset"] = asset;
        load_bytes("new.gltf", &fixture.json())
    };
    for min_version in ["2.1", "3.0", "2", "new"] {
        let error = load(json!({"version": "2.1", "minVersion": min_version})).expect_err("refused");
        assert!(matches!(error, ImportError::MinVersion { .. }), "{error}");
        assert!(error.to_string().contains(min_version) && error.to_string().contains("export it again"), "{error}");
    }
    for asset in [json!({"version": "2.1"}), json!({"version": "2.1", "minVersion": "2.0"})] {
        assert_eq!(load(asset).expect("readable as 2.0").scene.mesh.triangles.len(), 1);
    }
}

#[test]
fn an_unknown_extension_that_is_required_is_told_apart() {
    let mut fixture = Fixture::triangle();
    fixture.root["extensionsUsed"] = json!(["ACME_wish", "ACME_need"]);
    fixture.root["extensionsRequired"] = json!(["ACME_need"]);
    let imported = fixture.load();
    assert_eq!(imported.scene.mesh.triangles.len(), 1);
    let [need, wish] = &imported.report.unsupported[..] else { panic!("{:?}", imported.report.unsupported) };
    assert!(need.starts_with("ACME_need") && need.contains("requires"), "{need}");
    assert!(wish.starts_with("ACME_wish") && !wish.contains("requires"), "{wish}");
}

#[test]
fn a_missing_buffer_is_named() {
    let mut fixture = Fixture::triangle();
    fixture.root["buffers"] = json!([{"byteLength": 36, "uri": "there%20is%20none.bin"}]);
    let bytes = serde_json::to_vec(&fixture.root).expect("plain JSON");
    let error = load_bytes("alone.gltf", &bytes).expect_err("refused").to_string();
    for part in ["there is none.bin", "beside it", "export it again as .glb"] {
        assert!(error.contains(part), "{error}");
    }
}

#[test]
fn a_missing_buffer_without_geometry_costs_what_lies_in_it_alone() {
    let mut fixture = shows(&png_of(1, 1));
    let view = fixture.root["images"][0]["bufferView"].as_u64().expect("a view") as usize;
    fixture.root["bufferViews"][view] = json!({"buffer": 1, "byteLength": 9});
    fixture.root["buffers"] = json!([{}, {"byteLength": 9, "uri": "maps.bin"}]);
    let imported = fixture.load();
    assert_eq!(imported.scene.mesh.triangles.len(), 1);
    let [buffer, image] = &imported.report.warnings[..] else { panic!("{:?}", imported.report.warnings) };
    assert!(buffer.starts_with("buffer 1: ") && buffer.contains("maps.bin"), "{buffer}");
    assert!(image.contains("a checkerboard is shown"), "{image}");
}

#[test]
fn cycles_shared_children_and_long_chains_end() {
    let mut fixture = Fixture::triangle();
    fixture.root["nodes"] = json!([{"mesh": 0, "children": [1, 1]}, {"mesh": 0, "children": [0]}]);
    let imported = fixture.load();
    assert_eq!(imported.scene.mesh.triangles.len(), 2);
    assert_eq!(imported.report.warnings.len(), 2);

    let mut fixture = Fixture::triangle();
    let n_nodes = 100_000;
    let mut nodes: Vec<Value> = (1..n_nodes).map(|i| json!({"children": [i]})).collect();
    nodes.push(json!({"mesh": 0}));
    fixture.root["nodes"] = json!(nodes);
    assert_eq!(fixture.load().scene.mesh.triangles.len(), 1);
}

#[test]
fn what_a_few_words_multiply_is_refused_before_it_is_made() {
    // 16 million vertices that the file does not give, many times over: by nodes, and by instances.
    let mut nodes = Fixture::triangle();
    nodes.root["accessors"][0] = json!({"componentType": 5126, "type": "VEC3", "count": 1 << 24});
    let mut instances = Fixture::triangle();
    let zeros = json!({"componentType": 5126, "type": "VEC3", "count": 1 << 24});
    instances.root["accessors"] = json!([instances.root["accessors"][0], zeros]);
    nodes.root["nodes"] = json!(vec![json!({"mesh": 0}); 100]);
    nodes.root["scenes"] = json!([{"nodes": (0..100).collect::<Vec<_>>()}]);
    instances.root["nodes"] = json!(vec![
        json!({"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 1}}}});
        100
    ]);
    instances.root["scenes"] = nodes.root["scenes"].clone();
    // Where a file is small, a single such node is too much.
    let mut one = Fixture::triangle();
    one.root["accessors"] = instances.root["accessors"].clone();
    one.root["nodes"] = json!([instances.root["nodes"][0]]);
    for fixture in [nodes, instances, one] {
        let error = load_bytes("flood.gltf", &fixture.json()).unwrap_err();
        assert!(matches!(error, ImportError::TooMuch { .. }), "{error}");
        assert!(error.to_string().contains("triangles: leave out copies"), "{error}");
    }
}

#[test]
fn a_transform_beyond_single_precision_is_not_finite() {
    let mut fixture = Fixture::triangle();
    fixture.root["nodes"] =
        json!([{"children": [1], "scale": [1e30, 1e30, 1e30]}, {"mesh": 0, "scale": [1e30, 1e30, 1e30]}]);
    let report = fixture.load().report;
    assert!(report.warnings.iter().any(|line| line.contains("not finite")), "{:?}", report.warnings);
}

/// A PNG that says it is of that size, and has the pixels of a single one.
fn png_of(width: u32, height: u32) -> Vec<u8> {
    let mut bytes = Vec::new();
    let image = image::RgbaImage::from_pixel(1, 1, image::Rgba([9, 8, 7, 255]));
    image.write_to(&mut std::io::Cursor::new(&mut bytes), image::ImageFormat::Png).expect("a PNG");
    bytes[16..20].copy_from_slice(&width.to_be_bytes());
    bytes[20..24].copy_from_slice(&height.to_be_bytes());
    // The checksum of a chunk is of its name and contents.
    let checksum = bytes[12..29].iter().fold(!0_u32, |sum, byte| {
        (0..8).fold(sum ^ u32::from(*byte), |sum, _| (sum >> 1) ^ (0xEDB8_8320 & (sum & 1).wrapping_neg()))
    });
    bytes[29..33].copy_from_slice(&(!checksum).to_be_bytes());
    bytes
}

/// A triangle that shows an image.
fn shows(image: &[u8]) -> Fixture {
    let mut fixture = Fixture::triangle().placed();
    let view = fixture.view(image);
    fixture.root["images"] = json!([{"bufferView": view, "mimeType": "image/png"}]);
    fixture.root["textures"] = json!([{"source": 0}]);
    fixture.material(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}))
}

#[test]
fn an_image_that_claims_to_be_huge_is_replaced_before_memory_is_asked_for() {
    let sound = shows(&png_of(1, 1)).load();
    assert_eq!(sound.scene.textures[0].image.texels, [[9, 8, 7, 255]]);
    assert_eq!(sound.report.warnings, Vec::<String>::new());
    for [width, height] in [[16_385, 1], [1, 20_000], [60_000, 60_000], [u32::MAX / 2, u32::MAX / 2], [0, 0]] {
        let imported = shows(&png_of(width, height)).load();
        let warnings = &imported.report.warnings;
        assert!(
            warnings.iter().any(|line| line.contains("a checkerboard is shown")),
            "{width} × {height}: {warnings:?}"
        );
        assert_eq!(imported.scene.textures[0].image.width, 8, "{width} × {height}");
    }
}

#[test]
fn whole_numbers_may_be_written_with_a_fraction_of_zero() {
    let mut fixture = Fixture::triangle().node(json!({"mesh": 0.0}));
    let (n_bytes, places) = (36.0, fixture.floats("VEC3", &[0.0, 0.0, 0.0, 5.0, 0.0, 0.0]) as f64);
    fixture.root["accessors"][0]["count"] = json!(3.0);
    fixture.root["accessors"][0]["componentType"] = json!(5126.0);
    fixture.root["bufferViews"][0]["byteLength"] = json!(n_bytes);
    let instancing = json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": places}}});
    let imported = fixture.node(json!({"extensions": instancing})).load();
    assert_eq!((imported.scene.mesh.triangles.len(), imported.report.warnings.len()), (2, 0));
    let mut fixture = Fixture::triangle();
    fixture.root["accessors"][0]["count"] = json!(2.5);
    let error = load_bytes("half.gltf", &fixture.json()).expect_err("no count").to_string();
    assert!(error.contains("accessors[0]") && error.contains("2.5"), "{error}");
}

#[test]
fn a_chunk_of_json_may_be_filled_up_with_zeros() {
    let glb = Fixture::triangle().glb();
    let length = u32::from_le_bytes(glb[12..16].try_into().expect("four bytes")) as usize;
    for fill in [&b"\0\0\0\0"[..], b" \0\0\0", b"\0\0 \0 \0\0\0"] {
        let mut filled = [&glb[..20 + length], fill, &glb[20 + length..]].concat();
        for (at, value) in [(8, glb.len() + fill.len()), (12, length + fill.len())] {
            filled[at..at + 4].copy_from_slice(&(value as u32).to_le_bytes());
        }
        assert_eq!(load_bytes("filled.glb", &filled).expect("sound").scene.mesh.triangles.len(), 1, "{fill:?}");
    }
}

#[test]
fn files_of_other_kinds_are_told_with_a_remedy() {
    for (bytes, kind, remedy) in [
        (&b"PK\x03\x04\x14\0"[..], "archive", "unpack"),
        (b"\x1F\x8B\x08", "gzip", "unpack"),
        (b"Kaydara FBX Binary  \0", "FBX", "export it as glTF"),
        (b"PXR-USDC\0", "USD", "export it as glTF"),
        (b"\xFF\xFE\xFF\x0ES\0k\0e\0t\0c\0h\0U\0p\0 \0M\0o\0d\0e\0l\0", "SketchUp", "export it as glTF"),
        (b"3D Geometry File Format        4\x01\0\0\0", "Rhino", "export it as glTF"),
        (b"\xD0\xCF\x11\xE0\xA1\xB1\x1A\xE1\0\0", "Revit", "as FBX and that as glTF"),
        (b"ISO-10303-21;\nHEADER;\n", "IFC", "convert it to glTF"),
        (b"CLERTRAN\x01\0\0\0", "transport", "name the scene"),
        (b"version https://git-lfs.github.com/spec/v1\noid", "Git LFS", "git lfs pull"),
        (b"", "an empty file", "download it again"),
        (b" \r\n", "an empty file", "download it again"),
        (b"\n<!DOCTYPE html><html>", "HTML", "download"),
    ] {
        let error = load_bytes("room.glb", bytes).expect_err("refused");
        assert!(matches!(error, ImportError::Kind { .. }), "{error}");
        let text = error.to_string();
        assert!(text.starts_with("room.glb is a") && text.contains(kind) && text.contains(remedy), "{text}");
    }
}

#[test]
fn names_in_another_encoding_are_told_and_hinder_nothing() {
    let mut text = Fixture::triangle().node(json!({"name": "T@r"})).json();
    let at = text.windows(3).position(|three| three == b"T@r").expect("the name");
    // Latin 1.
    text[at + 1] = 0xFC;
    let imported = load_bytes("old.gltf", &text).expect("sound but for a letter");
    assert_eq!(imported.scene.nodes[0].name.as_deref(), Some("T\u{FFFD}r"));
    assert!(imported.report.warnings[0].contains("UTF-8"), "{:?}", imported.report.warnings);
}

#[test]
fn names_are_told_on_one_line_and_of_long_ones_the_beginning() {
    let (long, beginning) = ("ä".repeat(70_000), format!("{}\"…", "ä".repeat(120)));
    let plain = "24\" \\ Ku\u{308}che";
    let quoted = format!("{plain}\"");
    for (name, told) in
        [("North\r\nwall", "North  wall\""), (plain, quoted.as_str()), (long.as_str(), beginning.as_str())]
    {
        let mut fixture = Fixture::triangle().node(json!({"name": name}));
        fixture.primitive()["mode"] = json!(0);
        let report = fixture.load().report;
        assert_eq!(report.unsupported, [format!("node \"{told}: points and lines are left out")]);
    }
}

#[test]
fn a_list_with_a_number_that_is_none_is_left_out_and_named() {
    let mut fixture = Fixture::triangle().node(json!({"translation": [null, 1, 2], "scale": [2, 2, 2]}));
    fixture.root["accessors"][0]["min"] = json!([null, 0, 0]);
    let imported = fixture.load();
    assert_eq!(imported.scene.mesh.corners(0)[1], glam::Vec3::X * 2.0);
    let [line] = &imported.report.warnings[..] else { panic!("{:?}", imported.report.warnings) };
    assert!(line.starts_with("`translation` holds null"), "{line}");
}

#[test]
fn nesting_without_end_is_refused_in_words() {
    for (open, close) in [("[", "]"), ("{\"a\":", "}")] {
        let nested = format!("{}0{}", open.repeat(200_000), close.repeat(200_000));
        let text = format!(r#"{{"asset": {{"version": "2.0"}}, "extras": {nested}}}"#);
        let error = load_bytes("deep.gltf", text.as_bytes()).expect_err("refused");
        assert!(error.to_string().contains("deep.gltf") && error.to_string().contains("recursion"), "{error}");
    }
}

#[test]
fn compressed_views_that_are_too_much_together_are_left_out_before_they_are_decoded() {
    // Each of a gibibyte is possible; the third is one too many, and its mesh alone is left out.
    let mut fixture = Fixture::triangle();
    let stream = fixture.view(&[0; 1 << 20]);
    let offset = fixture.root["bufferViews"][stream]["byteOffset"].clone();
    for _ in 0..3 {
        let view = json!({"buffer": 1, "byteLength": 12, "extensions": {"EXT_meshopt_compression": {"buffer": 0,
            "byteOffset": offset, "byteLength": 1 << 20, "byteStride": 256, "count": 1 << 22, "mode": "ATTRIBUTES"}}});
        fixture.root["bufferViews"].as_array_mut().expect("views").push(view);
    }
    let last = fixture.root["bufferViews"].as_array().expect("views").len() - 1;
    let position = json!({"bufferView": last, "componentType": 5126, "count": 3, "type": "VEC3"});
    fixture.root["accessors"].as_array_mut().expect("accessors").push(position);
    fixture.root["meshes"][0]["primitives"]
        .as_array_mut()
        .expect("primitives")
        .push(json!({"attributes": {"POSITION": 1}}));
    let mut glb = fixture;
    glb.root["buffers"] = json!([{}, {"byteLength": 12}]);
    let imported = load_bytes("flood.glb", &glb.glb()).expect("the other mesh is sound");
    assert_eq!(imported.scene.mesh.triangles.len(), 1);
    let warnings = &imported.report.warnings;
    assert!(warnings.iter().any(|line| line.contains("all views together have more than")), "{warnings:?}");
}
