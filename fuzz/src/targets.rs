//! One function for each kind of file. A refusal is fine; what is accepted must make sense.

use std::ops::ControlFlow;
use std::path::Path;

use clerestory_nystrom::BlockLowRank;
use clerestory_transport::archive;
use clerestory_transport::camera::Film;
use clerestory_transport::import::stack::decode_picture;
use clerestory_transport::import::{Imported, decode_sky, load_bytes};
use clerestory_transport::light::LightRig;
use clerestory_transport::photometry::PhotometricProfile;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::scene::Scene;
use clerestory_transport::trace::{TraceConfig, trace};

/// Scenes up to so many triangles are also looked at.
const MAX_TRACED: usize = 2000;

/// A glTF or GLB: imported, prepared for rays, and seen in a few pixels.
pub fn gltf(bytes: &[u8]) {
    let Ok(Imported { scene, .. }) = load_bytes("fuzz.glb", bytes) else { return };
    check_scene(&scene);
    if scene.mesh.triangles.is_empty() || scene.mesh.triangles.len() > MAX_TRACED {
        return;
    }
    let Ok((prepared, _)) = PreparedScene::new(scene, &[]) else { return };
    let Some(camera) = prepared.scene.cameras.first().cloned() else { return };
    let coefficients = prepared.lighting.basis.project(&LightRig::default());
    let (film, config) = (Film { width: 4, height: 3 }, TraceConfig { spp: 1, bounces: Some(3), seed: 1 });
    let go_on = |_| ControlFlow::Continue(());
    assert!(trace(&prepared, &camera, film, &coefficients, &config, &go_on).is_some(), "nobody asked to stop");
}

fn check_scene(scene: &Scene) {
    let mesh = &scene.mesh;
    let n = mesh.positions.len();
    assert!(mesh.triangles.iter().flatten().all(|&v| (v as usize) < n), "a corner that does not exist");
    assert!(mesh.triangle_material.iter().all(|&m| (m as usize) < scene.materials.len()), "a material of none");
    assert!(mesh.triangle_node.iter().all(|&node| (node as usize) < scene.nodes.len()), "a triangle of no node");
    assert!(mesh.normals.len() == n && mesh.normals.iter().all(|normal| normal.is_finite()), "a normal is missing");
    let used = mesh.triangles.iter().flatten().map(|&v| mesh.positions[v as usize]);
    assert!(used.into_iter().all(|position| position.is_finite()), "a corner that is nowhere");
    for lamp in &scene.punctual {
        assert!(lamp.position.is_finite() && lamp.intensity.is_finite() && lamp.color.is_finite(), "{lamp:?}");
    }
    for camera in &scene.cameras {
        assert!(camera.world_from_camera.is_finite() && camera.yfov_rad.is_finite(), "{camera:?}");
    }
}

/// A stream of meshopt: the first bytes choose how it is read.
pub fn meshopt(bytes: &[u8]) {
    let Some((&[kind, stride, low, high], stream)) = bytes.split_first_chunk::<4>() else { return };
    let modes = ["ATTRIBUTES", "TRIANGLES", "INDICES"];
    let filters = ["NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL", "COLOR"];
    let (mode, filter) = (modes[usize::from(kind) % 3], filters[usize::from(kind / 3) % 5]);
    let (stride, count) = (u32::from(stride), u32::from(low) | u32::from(high) << 8);
    let length = stream.len();
    let json = format!(
        r#"{{"asset": {{"version": "2.0"}}, "scenes": [{{"nodes": [0]}}], "nodes": [{{"mesh": 0}}],
        "meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0}}, "indices": 1}}]}}],
        "accessors": [{{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": {count}}},
            {{"bufferView": 0, "componentType": 5125, "type": "SCALAR", "count": {count}}}],
        "buffers": [{{"byteLength": {length}}}], "bufferViews": [{{"buffer": 0, "byteLength": {length}, "extensions":
            {{"EXT_meshopt_compression": {{"buffer": 0, "byteLength": {length}, "byteStride": {stride}, "count": {count},
            "mode": "{mode}", "filter": "{filter}"}}}}}}]}}"#
    );
    if let Ok(imported) = load_bytes("fuzz.glb", &glb(json.as_bytes(), stream)) {
        check_scene(&imported.scene);
    }
}

/// A GLB of both chunks.
pub fn glb(json: &[u8], bin: &[u8]) -> Vec<u8> {
    let mut out = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
    for (kind, payload, fill) in [(b"JSON", json, b' '), (b"BIN\0", bin, 0)] {
        let padded = payload.len().next_multiple_of(4);
        out.extend((padded as u32).to_le_bytes());
        out.extend(kind);
        out.extend(payload);
        out.resize(out.len() + padded - payload.len(), fill);
    }
    let length = out.len() as u32;
    out[8..12].copy_from_slice(&length.to_le_bytes());
    out
}

/// IES and EULUMDAT.
pub fn photometry(bytes: &[u8]) {
    for name in ["fuzz.ies", "fuzz.ldt"] {
        let Ok(profile) = PhotometricProfile::parse(bytes, name) else { continue };
        assert!(profile.max_candela() > 0.0 && profile.max_candela().is_finite(), "{}", profile.max_candela());
        for direction in [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [-0.3, 0.5, 0.1], [0.0, -1e-30, 0.0]] {
            let candela = profile.candela(direction.into());
            assert!(candela >= 0.0 && candela <= 1.001 * profile.max_candela(), "{candela} towards {direction:?}");
        }
        assert!(profile.flux_lm().is_finite(), "{}", profile.flux_lm());
    }
}

/// Radiance and OpenEXR maps.
pub fn sky(bytes: &[u8]) {
    let Ok((map, _)) = decode_sky("fuzz", bytes) else { return };
    assert!(map.pixels().iter().flatten().all(|value| value.is_finite() && *value >= 0.0), "no radiance");
    if map.pixels().len() < 10_000 {
        let stored = map.storable();
        assert!(stored.pixels().iter().flatten().all(|value| value.is_finite()), "cannot be stored");
    }
}

/// A picture of a measured stack.
pub fn picture(bytes: &[u8]) {
    let Ok(picture) = decode_picture(bytes) else { return };
    let [width, height] = picture.size;
    assert_eq!(picture.pixels.len(), width as usize * height as usize, "a picture of another size");
}

/// A `.transport` file: read, measured and multiplied.
pub fn archive(bytes: &[u8]) {
    let Ok(bake) = archive::decode(bytes, Path::new("fuzz.transport")) else { return };
    let _ = (bake.figures(), bake.irradiance_figures());
    if bake.header.width as usize * bake.header.height as usize > 10_000 {
        return;
    }
    let rig = LightRig::default();
    let apply = |groups: &[BlockLowRank], coefficients: Vec<Vec<[f32; 3]>>| {
        for (group, coefficients) in groups.iter().zip(coefficients) {
            let red: Vec<f32> = coefficients.iter().map(|rgb| rgb[0]).collect();
            assert_eq!(group.apply(&red).len(), group.n_rows(), "a row is missing");
        }
    };
    apply(&bake.groups_under(&rig), bake.header.coefficients(&rig));
    for (set, groups) in bake.irradiance.iter().enumerate() {
        apply(groups, bake.header.irradiance_coefficients(set, &rig));
    }
}
