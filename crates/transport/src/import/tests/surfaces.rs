use std::io::Cursor;
use std::sync::Arc;

use glam::{Vec2, Vec3, Vec4};
use serde_json::{Value, json};

use super::fixture::Fixture;
use crate::basis::SourceKind;
use crate::emitters::Lighting;
use crate::import::load;
use crate::scene::{AlphaMode, Encoding, Filter, Material, TextureRef, Wrap};

/// A 2 × 1 PNG: red, then green.
fn png() -> Vec<u8> {
    let pixels = image::RgbaImage::from_raw(2, 1, vec![255, 0, 0, 255, 0, 255, 0, 255]).expect("two pixels");
    let mut out = Cursor::new(Vec::new());
    pixels.write_to(&mut out, image::ImageFormat::Png).expect("memory takes it");
    out.into_inner()
}

/// A triangle and the first texture, of an image.
fn with_image(image: Value) -> Fixture {
    let mut fixture = Fixture::triangle().placed();
    fixture.root["images"] = json!([image]);
    fixture.root["textures"] = json!([{"source": 0}]);
    fixture
}

#[test]
fn textures_without_coordinates_that_place_them_are_told() {
    let load = |fixture: Fixture, set: u32| {
        let map = json!({"index": 0, "texCoord": set});
        let fixture = fixture.material(json!({"emissiveFactor": [1, 1, 1], "emissiveTexture": map}));
        fixture.node(json!({"name": "sign"})).load().report.warnings
    };
    let image = || with_image(json!({"uri": format!("data:image/png,{}", escaped(&png()))}));
    let mut bare = image();
    bare.primitive()["attributes"] = json!({"POSITION": 0});
    let told = load(bare, 0);
    assert!(matches!(&told[..], [one] if one.contains("\"sign\"") && one.contains("coordinates 0")), "{told:?}");
    let told = load(image(), 1);
    assert!(matches!(&told[..], [one] if one.contains("coordinates 1")), "{told:?}");
    assert_eq!(load(image(), 0), Vec::<String>::new());
}

#[test]
fn highlights_stretched_along_coordinates_that_are_not_there_are_told() {
    let told = |fixture: Fixture| {
        let brushed = json!({"extensions": {"KHR_materials_anisotropy": {"anisotropyStrength": 0.5}}});
        fixture.material(brushed).node(json!({"name": "pan"})).load().report.warnings
    };
    let lines = told(Fixture::triangle());
    assert!(matches!(&lines[..], [one] if one.contains("\"pan\"") && one.contains("coordinates 0")), "{lines:?}");
    assert_eq!(told(Fixture::triangle().placed()), Vec::<String>::new());
    let mut with_tangents = Fixture::triangle();
    let normals = with_tangents.floats("VEC3", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    let tangents = with_tangents.floats("VEC4", &[1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0]);
    with_tangents.primitive()["attributes"]["NORMAL"] = json!(normals);
    with_tangents.primitive()["attributes"]["TANGENT"] = json!(tangents);
    assert_eq!(told(with_tangents), Vec::<String>::new());
}

/// Bytes for a data URI.
fn escaped(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("%{byte:02X}")).collect()
}

#[test]
fn a_primitive_without_material_has_the_default_one() {
    let scene = Fixture::triangle().load().scene;
    assert_eq!(scene.materials, vec![Material::default()]);
    assert_eq!(scene.mesh.triangle_material, vec![0]);
}

#[test]
fn extensions_reach_the_material() {
    let scene = Fixture::triangle()
        .material(json!({
            "name": "glass", "alphaMode": "MASK", "alphaCutoff": 0.25, "doubleSided": true, "emissiveFactor": [1, 0.5, 0],
            "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.2]},
            "extensions": {
                "KHR_materials_emissive_strength": {"emissiveStrength": 40}, "KHR_materials_ior": {"ior": 1.33},
                "KHR_materials_transmission": {"transmissionFactor": 0.75}, "KHR_materials_unlit": {},
                "KHR_materials_specular": {"specularFactor": 0.5, "specularColorFactor": [1, 2, 3]},
                "KHR_materials_volume": {"thicknessFactor": 0.1, "attenuationDistance": 2, "attenuationColor": [0, 1, 0]},
            },
        }))
        .load()
        .scene;
    let material = &scene.materials[0];
    assert_eq!(material.name, "glass");
    assert_eq!(material.alpha, AlphaMode::Mask { cutoff: 0.25 });
    assert_eq!(material.emitted_radiance(), Vec3::new(40.0, 20.0, 0.0));
    assert_eq!((material.ior, material.transmission, material.specular), (1.33, 0.75, 0.5));
    assert_eq!(material.specular_color, Vec3::new(1.0, 2.0, 3.0));
    assert_eq!((material.thickness, material.attenuation_distance), (0.1, 2.0));
    assert!(material.unlit && material.double_sided);
}

#[test]
fn factors_out_of_range_are_brought_back_and_reported() {
    let imported = Fixture::triangle()
        .material(json!({"pbrMetallicRoughness": {"baseColorFactor": [-1, 0.5, 2, 1], "roughnessFactor": 7}}))
        .load();
    assert_eq!(imported.scene.materials[0].base_color, Vec4::new(0.0, 0.5, 1.0, 1.0));
    assert_eq!(imported.scene.materials[0].roughness, 1.0);
    assert_eq!(imported.report.warnings.len(), 2);
}

#[test]
fn colors_with_an_alpha_too_much_or_without_theirs_are_mended_and_told() {
    let imported = Fixture::triangle()
        .material(json!({
            "emissiveFactor": [0.5, 0.25, 0, 1], "pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.25, 0.125]},
            "extensions": {
                "KHR_materials_sheen": {"sheenColorFactor": [1, 0.5, 0, 1]},
                "KHR_materials_volume": {"attenuationColor": [0, 0.5, 1]},
            },
        }))
        .load();
    let material = &imported.scene.materials[0];
    assert_eq!(material.base_color, Vec4::new(0.5, 0.25, 0.125, 1.0));
    assert_eq!(material.emissive, Vec3::new(0.5, 0.25, 0.0));
    assert_eq!(material.finish.as_ref().expect("a sheen").sheen_color, Vec3::new(1.0, 0.5, 0.0));
    assert_eq!(material.attenuation_color, Vec3::new(0.0, 0.5, 1.0));
    let [base, emission, sheen] = &imported.report.warnings[..] else { panic!("{:?}", imported.report.warnings) };
    for (line, key) in [(base, "`baseColorFactor`"), (emission, "`emissiveFactor`"), (sheen, "`sheenColorFactor`")] {
        assert!(line.starts_with(key), "{line}");
    }
}

#[test]
fn an_attenuation_distance_that_is_none_is_reported() {
    for (distance, n_warnings) in [(0.0, 1), (-1.0, 1), (0.5, 0)] {
        let volume = json!({"thicknessFactor": 1, "attenuationDistance": distance});
        let imported = Fixture::triangle().material(json!({"extensions": {"KHR_materials_volume": volume}})).load();
        let expected = if distance > 0.0 { distance } else { f32::INFINITY };
        assert_eq!(imported.scene.materials[0].attenuation_distance, expected);
        assert_eq!(imported.report.warnings.len(), n_warnings, "{:?}", imported.report.warnings);
    }
}

#[test]
fn an_emission_beyond_all_numbers_is_left_out_and_reported() {
    let imported = Fixture::triangle()
        .material(json!({
            "emissiveFactor": [1e30, 1, 0],
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 1e30}},
        }))
        .load();
    assert_eq!(imported.scene.materials[0].emitted_radiance(), Vec3::ZERO);
    assert_eq!(imported.report.warnings.len(), 1, "{:?}", imported.report.warnings);
}

#[test]
fn what_may_be_seen_through_and_never_is_is_opaque() {
    let alpha = |mode: &str, alpha: f32, texel: u8, vertex: f32| {
        let pixel = image::RgbaImage::from_pixel(1, 1, image::Rgba([9, 9, 9, texel]));
        let mut bytes = Cursor::new(Vec::new());
        pixel.write_to(&mut bytes, image::ImageFormat::Png).expect("memory takes it");
        let mut fixture = Fixture::triangle();
        let view = fixture.view(bytes.get_ref());
        fixture.root["images"] = json!([{"bufferView": view}]);
        fixture.root["textures"] = json!([{"source": 0}]);
        let colors = fixture.floats("VEC4", &[1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, vertex, 1.0, 1.0, 1.0, 1.0]);
        fixture.primitive()["attributes"]["COLOR_0"] = json!(colors);
        let pbr = json!({"baseColorFactor": [1, 1, 1, alpha], "baseColorTexture": {"index": 0}});
        let scene = fixture.material(json!({"alphaMode": mode, "pbrMetallicRoughness": pbr})).load().scene;
        scene.materials[0].alpha
    };
    assert_eq!(alpha("BLEND", 1.0, 255, 1.0), AlphaMode::Opaque);
    assert_eq!(alpha("MASK", 0.75, 255, 1.0), AlphaMode::Opaque);
    for [factor, texel, vertex] in [[0.5, 255.0, 1.0], [1.0, 254.0, 1.0], [1.0, 255.0, 0.5]] {
        assert_eq!(alpha("BLEND", factor, texel as u8, vertex), AlphaMode::Blend, "{factor} {texel} {vertex}");
    }
    assert_eq!(alpha("MASK", 0.75, 128, 1.0), AlphaMode::Mask { cutoff: 0.5 });
}

#[test]
fn a_map_of_gloss_becomes_one_of_roughness_and_its_colors_those_of_the_reflection() {
    let load = |map: Option<&[u8]>| {
        let mut fixture = Fixture::triangle();
        let view = fixture.view(map.unwrap_or_default());
        fixture.root["images"] = json!([{"bufferView": view}]);
        fixture.root["textures"] = json!([{"source": 0}]);
        fixture.material(json!({"extensions": {"KHR_materials_pbrSpecularGlossiness": {"glossinessFactor": 0.5,
            "specularGlossinessTexture": {"index": 0, "texCoord": 1}}}}))
    };
    let pixel = image::RgbaImage::from_pixel(1, 1, image::Rgba([250, 120, 30, 64]));
    let mut bytes = Cursor::new(Vec::new());
    pixel.write_to(&mut bytes, image::ImageFormat::Png).expect("memory takes it");
    let scene = load(Some(bytes.get_ref())).load().scene;
    let material = &scene.materials[0];
    let of = |map: Option<TextureRef>| {
        let map = map.expect("a map");
        (scene.textures[map.texture as usize].image.texels[0], map.uv_set, map.encoding)
    };
    // 255 − ½ · 64
    assert_eq!(of(material.metallic_roughness_texture), ([0, 223, 0, 255], 1, Encoding::Linear));
    assert_eq!(of(material.specular_color_texture), ([250, 120, 30, 64], 1, Encoding::Srgb));
    assert_eq!((material.roughness, material.metallic, material.specular_color), (1.0, 0.0, Vec3::ONE));
    // Without its map it is no mirror.
    let scene = load(None).load().scene;
    let material = &scene.materials[0];
    assert_eq!((material.roughness, material.metallic, material.ior), (1.0, 0.0, 1.5));
    assert!(material.metallic_roughness_texture.is_none() && material.specular_color_texture.is_none());
}

#[test]
fn one_image_is_decoded_once_for_all_its_textures() {
    let mut fixture = Fixture::triangle();
    let view = fixture.view(&png());
    fixture.root["images"] = json!([{"bufferView": view, "mimeType": "image/png"}]);
    fixture.root["samplers"] = json!([{"wrapS": 33071, "wrapT": 33648, "magFilter": 9728}]);
    fixture.root["textures"] = json!([{"source": 0, "sampler": 0}, {"source": 0}]);
    let scene = fixture
        .material(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 1, "texCoord": 1},
            "metallicRoughnessTexture": {"index": 0}}}))
        .load()
        .scene;
    let [base, rough] = [scene.materials[0].base_color_texture, scene.materials[0].metallic_roughness_texture];
    let (base, rough) = (base.expect("given"), rough.expect("given"));
    assert_eq!((base.encoding, base.uv_set, rough.encoding, rough.uv_set), (Encoding::Srgb, 1, Encoding::Linear, 0));
    let texture = &scene.textures[rough.texture as usize];
    assert_eq!((texture.wrap, texture.filter), ([Wrap::Clamp, Wrap::Mirror], Filter::Nearest));
    assert_eq!(texture.image.texels, vec![[255, 0, 0, 255], [0, 255, 0, 255]]);
    assert!(Arc::ptr_eq(&scene.textures[0].image, &scene.textures[1].image));
}

#[test]
fn an_image_that_cannot_be_had_becomes_a_checkerboard() {
    let broken =
        [json!({"uri": "nowhere.png"}), json!({"uri": "data:image/png;base64,AAAA"}), json!({"bufferView": 77})];
    for image in broken {
        let fixture = with_image(image);
        let imported = fixture.material(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})).load();
        assert_eq!(imported.scene.textures[0].image.texels[0], [255, 0, 255, 255]);
        let [line] = &imported.report.warnings[..] else { panic!("{:?}", imported.report.warnings) };
        assert!(line.contains("a checkerboard is shown"), "{line}");
    }
}

#[test]
fn an_image_that_cannot_be_decoded_is_told_with_its_file() {
    let folder = tempfile::tempdir().expect("a folder for temporary files");
    let path = folder.path().join("room.gltf");
    std::fs::write(folder.path().join("old bricks.tga"), [0; 30]).expect("a writable folder");
    for (image, told) in [
        (json!({"uri": "old%20bricks.tga"}), "image 0 (\"old bricks.tga\"): it cannot be decoded ("),
        (json!({"uri": "old bricks.tga", "name": "B"}), "image \"B\" (\"old bricks.tga\"): it cannot be decoded ("),
        (json!({"uri": "data:,bricks"}), "image 0: it cannot be decoded ("),
        (json!({"uri": "none.tga"}), "image 0: the file \"none.tga\" is missing: "),
    ] {
        let fixture = with_image(image);
        let fixture = fixture.material(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
        std::fs::write(&path, fixture.json()).expect("a writable folder");
        let report = load(&path).expect("a loadable file").report;
        let [line] = &report.warnings[..] else { panic!("{:?}", report.warnings) };
        assert!(line.starts_with(told) && line.ends_with(": a checkerboard is shown"), "{line}");
        assert_eq!(line.contains("export it as PNG or JPEG"), !line.contains("missing"), "{line}");
    }
}

#[test]
fn a_jpeg_that_is_cut_off_becomes_a_checkerboard() {
    let mut whole = Cursor::new(Vec::new());
    let image = image::RgbImage::from_fn(16, 16, |x, y| image::Rgb([(x * 16) as u8, (y * 16) as u8, 90]));
    image.write_to(&mut whole, image::ImageFormat::Jpeg).expect("memory takes it");
    let whole = whole.into_inner();
    for (bytes, n_warnings) in [(&whole[..], 0), (&whole[..whole.len() - 20], 1)] {
        let mut fixture = Fixture::triangle().placed();
        let view = fixture.view(bytes);
        fixture.root["images"] = json!([{"bufferView": view, "mimeType": "image/jpeg"}]);
        fixture.root["textures"] = json!([{"source": 0}]);
        let imported = fixture.material(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})).load();
        let warnings = &imported.report.warnings;
        assert_eq!(warnings.len(), n_warnings, "{warnings:?}");
        assert!(warnings.iter().all(|line| line.contains("it is cut off: a checkerboard is shown")), "{warnings:?}");
        assert_eq!(imported.scene.textures[0].image.width, if n_warnings == 0 { 16 } else { 8 });
    }
}

#[test]
fn of_other_maps_that_cannot_be_had_nothing_is_left() {
    let fixture = with_image(json!({"uri": "nowhere.png"}));
    let map = json!({"index": 0});
    let imported = fixture
        .material(json!({
            "name": "odd", "emissiveFactor": [1, 1, 1], "emissiveTexture": map, "normalTexture": map,
            "pbrMetallicRoughness": {"metallicRoughnessTexture": map},
            "extensions": {
                "KHR_materials_transmission": {"transmissionFactor": 1, "transmissionTexture": map},
                "KHR_materials_clearcoat": {"clearcoatFactor": 1, "clearcoatTexture": map}},
        }))
        .load();
    let plain = Material { name: "odd".into(), metallic: 0.0, ..Material::default() };
    assert_eq!(imported.scene.materials, [plain]);
    let [image, material] = &imported.report.warnings[..] else { panic!("{:?}", imported.report.warnings) };
    assert!(image.ends_with("it is left out"), "{image}");
    for part in ["\"odd\"", "metal and roughness, normals, emission, transmission, clear coat", "does not shine"] {
        assert!(material.contains(part), "{part}: {material}");
    }
    // It counts where repeats of a name are numbered, as it does once its map is there.
    assert_eq!(imported.scene.dark_materials.into_iter().collect::<Vec<_>>(), [0]);
}

#[test]
fn one_image_is_a_checkerboard_as_a_base_color_and_no_light_as_emission() {
    let fixture = with_image(json!({"uri": "nowhere.png"}));
    let map = json!({"index": 0});
    let material =
        json!({"emissiveFactor": [1, 1, 1], "emissiveTexture": map, "pbrMetallicRoughness": {"baseColorTexture": map}});
    let imported = fixture.material(material).load();
    let material = &imported.scene.materials[0];
    assert!(material.base_color_texture.is_some() && !material.is_emitter(), "{material:?}");
    assert!(imported.report.warnings[0].contains("a checkerboard is shown"), "{:?}", imported.report.warnings);
}

#[test]
fn a_surface_whose_map_is_black_where_it_would_shine_is_no_light() {
    let emits = |factor: [f32; 3], texels: &[[u8; 4]]| {
        let image = image::RgbaImage::from_raw(texels.len() as u32, 1, texels.concat()).expect("a row of texels");
        let mut bytes = Cursor::new(Vec::new());
        image.write_to(&mut bytes, image::ImageFormat::Png).expect("memory takes it");
        let mut fixture = Fixture::triangle().placed();
        let view = fixture.view(bytes.get_ref());
        fixture.root["images"] = json!([{"bufferView": view, "mimeType": "image/png"}]);
        fixture.root["textures"] = json!([{"source": 0}]);
        let scene = fixture.material(json!({"emissiveFactor": factor, "emissiveTexture": {"index": 0}})).load().scene;
        let (lighting, warnings) = Lighting::new(&scene, &[]).expect("lights");
        let kinds: Vec<SourceKind> = lighting.basis.sources.iter().map(|source| source.kind).collect();
        (kinds, warnings.len())
    };
    let (shines, dark) = ((vec![SourceKind::Emitter], 0), (vec![SourceKind::Sky], 1));
    assert_eq!(emits([1.0; 3], &[[0, 0, 0, 255], [0, 0, 0, 9]]), dark);
    assert_eq!(emits([1.0; 3], &[[0, 0, 0, 255], [0, 1, 0, 255]]), shines);
    assert_eq!(emits([1.0, 0.0, 0.5], &[[0, 200, 0, 255], [0, 255, 0, 255]]), dark);
}

#[test]
fn a_readable_twin_stands_in_for_an_unreadable_image() {
    let load = |texture: serde_json::Value| {
        let mut fixture = Fixture::triangle().placed();
        let (good, basis) = (fixture.view(&png()), fixture.view(b"\xABKTX 20\xBB\r\n\x1A\n"));
        fixture.root["images"] = json!([{"bufferView": good}, {"bufferView": basis}, {"uri": "nowhere.png"}]);
        fixture.root["textures"] = json!([texture]);
        fixture.material(json!({"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0}})).load()
    };
    let basis = json!({"KHR_texture_basisu": {"source": 1}});
    let webp = json!({"EXT_texture_webp": {"source": 0}});
    for (texture, n_warnings) in [
        (json!({"source": 0, "extensions": basis}), 0),
        (json!({"source": 2, "extensions": webp}), 1),
        (json!({"extensions": webp}), 0),
    ] {
        let imported = load(texture);
        assert_eq!(imported.scene.textures[0].image.texels[0], [255, 0, 0, 255]);
        assert_eq!(imported.report.warnings.len(), n_warnings, "{:?}", imported.report.warnings);
    }
    let imported = load(json!({"extensions": basis}));
    assert_eq!(imported.scene.textures[0].image.width, 8, "a checkerboard");
    assert!(imported.report.warnings[0].contains("KTX2"));
}

#[test]
fn kinds_of_images_that_are_not_read_are_told_alike() {
    let mut fixture = Fixture::triangle();
    let kinds = ["EXT_texture_avif", "KHR_texture_basisu", "MSFT_texture_dds"];
    fixture.root["extensionsUsed"] = json!(kinds);
    let report = fixture.load().report;
    assert_eq!(report.unsupported.len(), kinds.len(), "{:?}", report.unsupported);
    for (line, kind) in report.unsupported.iter().zip(kinds) {
        assert!(line.starts_with(kind) && line.contains("without a PNG or JPEG twin"), "{line}");
    }
}

#[test]
fn coordinate_sets_beyond_the_second_are_reported() {
    let mut fixture = Fixture::triangle();
    let uvs = fixture.floats("VEC2", &[0.5; 6]);
    fixture.primitive()["attributes"]["TEXCOORD_5"] = json!(uvs);
    fixture.root["textures"] = json!([{}]);
    let imported = fixture.material(json!({"name": "map", "emissiveTexture": {"index": 0, "texCoord": 5}})).load();
    let [used, given] = &imported.report.unsupported[..] else { panic!("{:?}", imported.report.unsupported) };
    assert!(used.contains("\"map\"") && used.contains("set 5") && given.contains("node 0"), "{used}, {given}");
}

#[test]
fn the_example_of_texture_transform_uses_the_lower_left_quadrant() {
    let mut fixture = Fixture::triangle();
    fixture.root["textures"] = json!([{}]);
    let transform =
        json!({"offset": [0, 1], "rotation": std::f32::consts::FRAC_PI_2, "scale": [0.5, 0.5], "texCoord": 1});
    let texture = json!({"index": 0, "extensions": {"KHR_texture_transform": transform}});
    let scene = fixture.material(json!({"pbrMetallicRoughness": {"baseColorTexture": texture}})).load().scene;
    let texture = scene.materials[0].base_color_texture.expect("given");
    assert_eq!(texture.uv_set, 1);
    for (uv, expected) in [(Vec2::ZERO, Vec2::Y), (Vec2::X, Vec2::new(0.0, 0.5)), (Vec2::Y, Vec2::new(0.5, 1.0))] {
        let there = texture.transform.transform_point2(uv);
        assert!(there.distance(expected) < 1e-6, "{uv} goes to {there}");
    }
}

#[test]
fn unknown_material_extensions_are_named_with_their_material() {
    let mut fixture = Fixture::triangle();
    fixture.root["extensionsUsed"] = json!(["KHR_materials_dispersion", "KHR_materials_ior"]);
    fixture.root["extensionsRequired"] = json!(["KHR_materials_dispersion"]);
    let imported = fixture.material(json!({"name": "prism", "extensions": {"KHR_materials_dispersion": {}}})).load();
    let [line] = &imported.report.unsupported[..] else { panic!("{:?}", imported.report.unsupported) };
    assert!(line.contains("KHR_materials_dispersion") && line.contains("prism"), "{line}");
}

#[test]
fn material_extensions_that_a_file_does_not_list_are_named_too() {
    let extensions = json!({"KHR_materials_dispersion": {"dispersion": 1}, "KHR_materials_sheen": {}});
    let told =
        Fixture::triangle().material(json!({"name": "prism", "extensions": extensions})).load().report.unsupported;
    assert_eq!(told, ["KHR_materials_dispersion: glass does not split colors (material \"prism\")"]);
}

#[test]
fn lights_of_extensions_that_are_not_read_are_named_as_missing() {
    for name in ["EPIC_hdri_backdrops", "EPIC_sky_spheres", "KHR_lights", "KHR_lights_common", "MOZ_hubs_components"] {
        let mut fixture = Fixture::triangle();
        fixture.root["extensionsUsed"] = json!([name]);
        let told = fixture.load().report.unsupported;
        assert!(matches!(&told[..], [one] if one.starts_with(name) && one.contains("light")), "{told:?}");
    }
}

/// A quad with texture coordinates and one texture.
fn textured() -> Fixture {
    let mut fixture = Fixture::triangle().placed();
    let view = fixture.view(&png());
    fixture.root["images"] = json!([{"bufferView": view, "mimeType": "image/png"}]);
    fixture.root["textures"] = json!([{"source": 0}]);
    fixture
}

#[test]
fn layered_extensions_reach_the_finish() {
    let mut fixture = textured();
    let extensions = json!({
        "KHR_materials_clearcoat": {"clearcoatFactor": 0.5, "clearcoatTexture": {"index": 0},
            "clearcoatRoughnessFactor": 0.25, "clearcoatNormalTexture": {"index": 0, "scale": 0.75, "texCoord": 1}},
        "KHR_materials_sheen": {"sheenColorFactor": [0.1, 0.2, 0.3], "sheenColorTexture": {"index": 0},
            "sheenRoughnessFactor": 0.625, "sheenRoughnessTexture": {"index": 0}},
        "KHR_materials_anisotropy": {"anisotropyStrength": 0.75, "anisotropyRotation": 1.5},
        "KHR_materials_iridescence": {"iridescenceFactor": 1, "iridescenceIor": 1.8,
            "iridescenceThicknessMaximum": 700, "iridescenceThicknessTexture": {"index": 0}},
        "KHR_materials_diffuse_transmission": {"diffuseTransmissionFactor": 0.25,
            "diffuseTransmissionColorFactor": [1, 0.5, 0], "diffuseTransmissionColorTexture": {"index": 0}},
    });
    fixture.root["extensionsUsed"] = json!(extensions.as_object().expect("an object").keys().collect::<Vec<_>>());
    let imported = fixture.material(json!({"extensions": extensions})).load();
    let [line] = &imported.report.unsupported[..] else { panic!("{:?}", imported.report.unsupported) };
    assert!(line.contains("clear coat and sheen differ from their extensions at grazing angles"), "{line}");
    let finish = imported.scene.materials[0].finish.as_ref().expect("a finish");
    assert_eq!((finish.clearcoat, finish.clearcoat_roughness, finish.clearcoat_normal_scale), (0.5, 0.25, 0.75));
    assert_eq!((finish.sheen_color, finish.sheen_roughness), (Vec3::new(0.1, 0.2, 0.3), 0.625));
    assert_eq!((finish.anisotropy, finish.anisotropy_rotation_rad), (0.75, 1.5));
    assert_eq!((finish.iridescence, finish.film_ior, finish.film_thickness_nm), (1.0, 1.8, [100.0, 700.0]));
    assert_eq!((finish.diffuse_transmission, finish.diffuse_transmission_color), (0.25, Vec3::new(1.0, 0.5, 0.0)));
    let encoding = |texture: Option<TextureRef>| texture.expect("given").encoding;
    assert_eq!(encoding(finish.sheen_color_texture), Encoding::Srgb);
    assert_eq!(encoding(finish.diffuse_transmission_color_texture), Encoding::Srgb);
    for linear in [finish.clearcoat_texture, finish.sheen_roughness_texture, finish.film_thickness_texture] {
        assert_eq!(encoding(linear), Encoding::Linear);
    }
    assert_eq!(finish.clearcoat_normal_texture.expect("given").uv_set, 1);
    assert!(!imported.scene.mesh.tangents.is_empty());
}

#[test]
fn what_shines_below_a_clear_coat_and_is_not_dimmed_is_told() {
    let told = |emission: Value, coat: f32| {
        let extensions = json!({"KHR_materials_clearcoat": {"clearcoatFactor": coat}});
        let material = json!({"name": "sign", "emissiveFactor": emission, "extensions": extensions});
        Fixture::triangle().material(material).load().report.unsupported
    };
    let line = "material \"sign\": what shines below its clear coat is not dimmed by it";
    assert_eq!(told(json!([1, 1, 1]), 1.0), [line]);
    assert!(told(json!([0, 0, 0]), 1.0).is_empty() && told(json!([1, 1, 1]), 0.0).is_empty());
}

#[test]
fn a_finish_that_cannot_be_seen_is_none() {
    for extension in [
        json!({"KHR_materials_clearcoat": {"clearcoatRoughnessFactor": 1, "clearcoatTexture": {"index": 0}}}),
        json!({"KHR_materials_sheen": {"sheenRoughnessFactor": 0.5}}),
        json!({"KHR_materials_iridescence": {}, "KHR_materials_anisotropy": {"anisotropyRotation": 1}}),
    ] {
        let scene = textured().material(json!({"extensions": extension})).load().scene;
        assert_eq!(scene.materials[0].finish, None);
        assert!(scene.textures.is_empty() && scene.mesh.tangents.is_empty());
    }
}

#[test]
fn a_finish_that_makes_no_sense_is_reported() {
    let broken = json!({"KHR_materials_clearcoat": {"clearcoatFactor": "much"}, "KHR_materials_sheen": 7,
        "KHR_materials_iridescence": {"iridescenceFactor": 3, "iridescenceIor": -1, "iridescenceTexture": {"index": 99}}});
    let imported = textured().material(json!({"name": "odd", "extensions": broken})).load();
    let warnings = imported.report.warnings;
    for part in ["clearcoat", "sheen", "iridescence factor", "index of refraction", "texture 99"] {
        assert!(warnings.iter().any(|line| line.contains(part) && line.contains("odd")), "{part}: {warnings:?}");
    }
    let finish = imported.scene.materials[0].finish.as_ref().expect("a film");
    assert_eq!((finish.clearcoat, finish.iridescence, finish.film_ior), (0.0, 1.0, 1.0));
}

#[test]
fn an_index_of_0_reflects_everything_as_that_of_a_surface_alone() {
    let load = |extension: &str, members: Value| {
        let imported = Fixture::triangle().material(json!({"extensions": {extension: members}})).load();
        (imported.scene.materials[0].clone(), imported.report.warnings.len())
    };
    let (mirror, n_warnings) = load("KHR_materials_ior", json!({"ior": 0}));
    assert_eq!((mirror.ior, n_warnings), (1000.0, 0));
    let (filmed, n_warnings) = load("KHR_materials_iridescence", json!({"iridescenceFactor": 1, "iridescenceIor": 0}));
    assert_eq!((filmed.finish.expect("a film").film_ior, n_warnings), (1.0, 1));
}
