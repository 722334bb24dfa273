//! Images that nothing samples are not decoded, and no picture shows it.

use std::io::Cursor;
use std::ops::ControlFlow;

use serde_json::json;

use super::fixture::Fixture;
use crate::camera::Film;
use crate::import::{Imported, load_bytes_with};
use crate::light::LightRig;
use crate::prepared::PreparedScene;
use crate::skips::{Skip, Skips};
use crate::trace::{TraceConfig, trace};

fn png(side: u32, color: [u8; 4]) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    let pixels = image::RgbaImage::from_pixel(side, side, image::Rgba(color));
    pixels.write_to(&mut out, image::ImageFormat::Png).expect("memory takes it");
    out.into_inner()
}

/// A shining square with a texture for everything; those of transmission, metal and sheen are multiplied by 0, and the last
/// image belongs to nothing.
fn textured() -> Vec<u8> {
    let corner = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]];
    let mut fixture = Fixture::mesh(&[0, 1, 2, 0, 2, 3].map(|i: usize| corner[i]));
    let images = [[0, 200, 0, 255], [9, 9, 9, 9], [250, 120, 30, 255], [8, 8, 8, 8], [7, 7, 7, 7], [6, 6, 6, 6]];
    let views = (1..).zip(images).map(|(side, color)| fixture.view(&png(side, color)));
    let views: Vec<_> = views.map(|view| json!({"bufferView": view, "mimeType": "image/png"})).collect();
    fixture.root["images"] = json!(views);
    fixture.root["textures"] = (0..images.len()).map(|source| json!({"source": source})).collect();
    let fixture = fixture.material(json!({
        "pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 0, "baseColorTexture": {"index": 2},
            "metallicRoughnessTexture": {"index": 1}},
        "emissiveFactor": [0.5, 0.5, 0.5], "emissiveTexture": {"index": 0},
        "extensions": {
            "KHR_materials_transmission": {"transmissionFactor": 0, "transmissionTexture": {"index": 3}},
            "KHR_materials_sheen": {"sheenColorFactor": [0, 0, 0], "sheenColorTexture": {"index": 4}},
            "KHR_materials_clearcoat": {"clearcoatFactor": 0.5}},
    }));
    fixture.json()
}

fn picture(imported: Imported) -> Vec<[f32; 3]> {
    let (scene, _) = PreparedScene::new(imported.scene, &[]).expect("valid lights");
    let coefficients = scene.lighting.basis.project(&LightRig::default());
    let config = TraceConfig { spp: 4, bounces: None, seed: 1 };
    let (film, go_on) = (Film { width: 8, height: 6 }, |_| ControlFlow::Continue(()));
    trace(&scene, &scene.scene.cameras[0], film, &coefficients, &config, &go_on).expect("nobody stops it")
}

#[test]
fn textures_that_are_multiplied_by_zero_are_not_decoded_and_nothing_changes() {
    let [with, without] = [Skips::default(), Skips::default().without(Skip::IdleTextures)]
        .map(|skips| load_bytes_with("test.gltf", &textured(), skips).expect("a loadable file"));
    assert_eq!((with.scene.textures.len(), without.scene.textures.len()), (2, 4));
    let colors: Vec<[u8; 4]> = with.scene.textures.iter().map(|texture| texture.image.texels[0]).collect();
    let material = &with.scene.materials[0];
    let of = |slot: Option<crate::scene::TextureRef>| slot.map(|texture| colors[texture.texture as usize]);
    assert_eq!(of(material.base_color_texture), Some([250, 120, 30, 255]));
    assert_eq!(of(material.emissive_texture), Some([0, 200, 0, 255]));
    assert!(material.metallic_roughness_texture.is_none() && material.transmission_texture.is_none());
    assert_eq!((with.scene.idle_images, without.scene.idle_images), (4, 0));
    assert_eq!(with.scene.idle_bytes, 4 * (4 + 16 + 25 + 36));
    let [a, b] = [with, without].map(picture);
    assert!(a == b && a.iter().any(|rgb| rgb[1] > rgb[2]), "{a:?}");
}
