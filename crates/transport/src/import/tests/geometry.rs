use glam::{Vec2, Vec3, Vec4};
use serde_json::json;

use super::fixture::Fixture;
use crate::scene::Mesh;
use crate::sensors::SensorGrid;

/// Unit geometric normals, one per triangle.
fn geometric_normals(mesh: &Mesh) -> Vec<Vec3> {
    (0..mesh.triangles.len() as u32).map(|t| mesh.area_normal(t).normalize()).collect()
}

#[test]
fn json_and_glb_load_the_same() {
    let json = Fixture::triangle().load().scene;
    let glb = crate::import::load_bytes("test.glb", &Fixture::triangle().glb()).expect("a loadable file").scene;
    assert_eq!(json.mesh.positions, glb.mesh.positions);
    assert_eq!(json.mesh.triangles, vec![[0, 1, 2]]);
    assert_eq!(json.mesh.positions[1], Vec3::X);
}

#[test]
fn of_vertices_that_primitives_share_each_takes_its_own() {
    let positions: Vec<[f32; 3]> = (0..90).map(|i| [i as f32, (i * i) as f32, 0.0]).collect();
    let shared = |corners: [u8; 3]| {
        let mut fixture = Fixture::mesh(&positions);
        let uvs = fixture.floats("VEC2", &(0..180).map(|i| i as f32).collect::<Vec<_>>());
        let indices = fixture.accessor("SCALAR", 5121, 3, &corners);
        let moved: Vec<u8> = [7.0_f32, 8.0, 9.0, 0.0, 0.0, 0.0].iter().flat_map(|x| x.to_le_bytes()).collect();
        let (places, values) = (fixture.view(&[31, 70]), fixture.view(&moved));
        fixture.root["accessors"][0]["sparse"] = json!({"count": 2,
            "indices": {"bufferView": places, "componentType": 5121}, "values": {"bufferView": values}});
        fixture.primitive()["indices"] = json!(indices);
        fixture.primitive()["attributes"]["TEXCOORD_0"] = json!(uvs);
        fixture.load()
    };
    let mesh = shared([32, 30, 31]).scene.mesh;
    assert_eq!(mesh.positions.len(), 3);
    assert_eq!(mesh.corners(0), [[32.0, 1024.0, 0.0], [30.0, 900.0, 0.0], [7.0, 8.0, 9.0]].map(Vec3::from));
    let uvs = mesh.triangles[0].map(|v| mesh.uvs[0][v as usize]);
    assert_eq!(uvs, [[64.0, 65.0], [60.0, 61.0], [62.0, 63.0]].map(Vec2::from));
    let imported = shared([32, 30, 90]);
    assert!(imported.scene.mesh.triangles.is_empty());
    assert!(imported.report.warnings[0].contains("vertices that do not exist"), "{:?}", imported.report.warnings);
}

#[test]
fn a_list_of_vertices_is_not_counted_for_each_primitive_that_shares_it() {
    // Sixteen million vertices, of which the file gives three.
    let mut fixture = Fixture::triangle();
    let places = fixture.view(&[0, 1, 2]);
    let indices = fixture.accessor("SCALAR", 5121, 3, &[0, 1, 2]);
    fixture.root["accessors"][0] = json!({"componentType": 5126, "type": "VEC3", "count": 1 << 24,
        "sparse": {"count": 3, "indices": {"bufferView": places, "componentType": 5121}, "values": {"bufferView": 0}}});
    fixture.primitive()["indices"] = json!(indices);
    let primitive = fixture.primitive().clone();
    fixture.root["meshes"][0]["primitives"] = json!(vec![primitive; 200]);
    let mesh = fixture.load().scene.mesh;
    assert_eq!((mesh.triangles.len(), mesh.positions.len()), (200, 600));
    assert_eq!(mesh.corners(199), [Vec3::ZERO, Vec3::X, Vec3::Y]);
}

#[test]
fn a_mirrored_node_keeps_its_front() {
    let scene = Fixture::triangle().node(json!({"scale": [-1, 1, 1]})).load().scene;
    assert_eq!(geometric_normals(&scene.mesh), vec![Vec3::Z]);
    assert_eq!(scene.mesh.normals[0], Vec3::Z);
    assert!(scene.mesh.positions.contains(&Vec3::NEG_X));
}

#[test]
fn a_mirrored_quad_keeps_its_first_edge() {
    for indices in [[0, 1, 2, 0, 2, 3], [0, 1, 3, 3, 1, 2]] {
        for scale in [[1, 1, 1], [-1, 1, 1], [1, -1, 1]] {
            let mut fixture = Fixture::mesh(&[[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
            let corners = fixture.accessor("SCALAR", 5121, 6, &indices);
            fixture.primitive()["indices"] = json!(corners);
            let mesh = fixture.node(json!({"scale": scale})).load().scene.mesh;
            let grid = SensorGrid::on_quad("desk", &[mesh.corners(0), mesh.corners(1)], [3, 1]).unwrap();
            let edges = [grid.u_edge, grid.v_edge].map(Vec3::length);
            assert_eq!((edges, grid.normal), ([2.0, 1.0], Vec3::Z), "{indices:?} {scale:?}");
        }
    }
}

#[test]
fn normals_follow_the_inverse_transpose() {
    let mut fixture = Fixture::triangle();
    let diagonal = [1.0, 1.0, 0.0];
    let normal = fixture.floats("VEC3", &diagonal.repeat(3));
    fixture.primitive()["attributes"]["NORMAL"] = json!(normal);
    let scene = fixture.node(json!({"scale": [2, 1, 1]})).load().scene;
    let expected = Vec3::new(0.5, 1.0, 0.0).normalize();
    assert!(scene.mesh.normals[0].distance(expected) < 1e-6, "{}", scene.mesh.normals[0]);
}

#[test]
fn transforms_of_parents_apply_from_the_outside_in() {
    let mut fixture = Fixture::triangle();
    let half = std::f32::consts::FRAC_1_SQRT_2;
    fixture.root["nodes"] = json!([
        // Twice a unit quaternion: a quarter turn about +Z all the same.
        {"children": [1], "translation": [10, 0, 0], "rotation": [0, 0, 2.0 * half, 2.0 * half]},
        {"mesh": 0, "matrix": [1,0,0,0, 0,1,0,0, 0,0,1,0, 1,0,0,1]},
    ]);
    let scene = fixture.load().scene;
    assert!(scene.mesh.positions[0].distance(Vec3::new(10.0, 1.0, 0.0)) < 1e-6, "{}", scene.mesh.positions[0]);
    assert_eq!((scene.nodes.len(), scene.nodes[0].index), (1, 1));
}

#[test]
fn strips_and_fans_face_one_way() {
    let quad = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]];
    let ring = [quad[0], quad[1], quad[3], quad[2]];
    for (mode, corners) in [(5, quad), (6, ring)] {
        let mut fixture = Fixture::mesh(&corners);
        fixture.primitive()["mode"] = json!(mode);
        let scene = fixture.load().scene;
        assert_eq!(geometric_normals(&scene.mesh), vec![Vec3::Z; 2], "mode {mode}");
        let area: f32 = (0..2).map(|t| scene.mesh.area_normal(t).length()).sum();
        assert_eq!(area, 2.0, "mode {mode}");
    }
}

#[test]
fn indices_of_every_width_agree() {
    let u16s: Vec<u8> = [2_u16, 0, 1].iter().flat_map(|i| i.to_le_bytes()).collect();
    let u32s: Vec<u8> = [2_u32, 0, 1].iter().flat_map(|i| i.to_le_bytes()).collect();
    for (component_type, bytes) in [(5121, vec![2_u8, 0, 1]), (5123, u16s), (5125, u32s)] {
        let mut fixture = Fixture::triangle();
        let indices = fixture.accessor("SCALAR", component_type, 3, &bytes);
        fixture.primitive()["indices"] = json!(indices);
        let mesh = fixture.load().scene.mesh;
        assert_eq!(mesh.corners(0), [Vec3::Y, Vec3::ZERO, Vec3::X], "{component_type}");
    }
}

#[test]
fn missing_normals_are_flat() {
    let mut fixture = Fixture::mesh(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    let indices = fixture.accessor("SCALAR", 5121, 6, &[0, 1, 2, 0, 2, 3]);
    fixture.primitive()["indices"] = json!(indices);
    let mesh = fixture.load().scene.mesh;
    assert_eq!(mesh.positions.len(), 6);
    for (t, normal) in geometric_normals(&mesh).into_iter().enumerate() {
        assert!(mesh.triangles[t].iter().all(|&v| mesh.normals[v as usize].distance(normal) < 1e-6));
    }
}

#[test]
fn quantized_and_normalized_attributes_are_read() {
    let mut fixture = Fixture::triangle();
    let positions: Vec<u8> = [0_i16, 0, 0, 0, 7, 0, 0, 0, 0, -7, 0, 0].iter().flat_map(|i| i.to_le_bytes()).collect();
    let position = fixture.accessor("VEC3", 5122, 3, &positions);
    let view = fixture.root["accessors"][position]["bufferView"].as_u64().expect("an index") as usize;
    fixture.root["bufferViews"][view]["byteStride"] = json!(8);
    let color = fixture.accessor("VEC3", 5121, 3, &[255, 0, 51, 0, 0, 0, 255, 255, 255]);
    fixture.root["accessors"][color]["normalized"] = json!(true);
    let uv = fixture.accessor("VEC2", 5123, 3, &[255, 255, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    fixture.root["accessors"][uv]["normalized"] = json!(true);
    fixture.primitive()["attributes"] = json!({"POSITION": position, "COLOR_0": color, "TEXCOORD_1": uv});
    let mesh = fixture.load().scene.mesh;
    assert_eq!(mesh.positions, vec![Vec3::ZERO, Vec3::X * 7.0, Vec3::NEG_Y * 7.0]);
    assert_eq!(mesh.colors[0], Vec4::new(1.0, 0.0, 0.2, 1.0));
    assert!(mesh.uvs[0].is_empty());
    assert_eq!(mesh.uvs[1][0], Vec2::X);
}

#[test]
fn vertex_colors_are_held_to_what_gltf_allows() {
    let mut fixture = Fixture::triangle();
    let color = fixture.floats("VEC4", &[2.0, 0.5, -1.0, 3.0].repeat(3));
    fixture.primitive()["attributes"]["COLOR_0"] = json!(color);
    let mesh = fixture.load().scene.mesh;
    assert_eq!(mesh.colors, vec![Vec4::new(1.0, 0.5, 0.0, 1.0); 3]);
}

#[test]
fn texture_coordinates_and_colors_that_are_no_numbers_are_told() {
    let mut fixture = Fixture::triangle();
    let uv = fixture.floats("VEC2", &[0.5, f32::NAN, 0.5, 0.25, f32::INFINITY, 0.0]);
    let color = fixture.floats("VEC3", &[0.5, 0.5, 0.5, 0.5, f32::NAN, 0.5, 0.5, 0.5, 0.5]);
    fixture.primitive()["attributes"] = json!({"POSITION": 0, "TEXCOORD_0": uv, "COLOR_0": color});
    let imported = fixture.load();
    let mesh = &imported.scene.mesh;
    assert_eq!(mesh.uvs[0], vec![Vec2::ZERO, Vec2::new(0.5, 0.25), Vec2::ZERO]);
    let gray = Vec4::new(0.5, 0.5, 0.5, 1.0);
    assert_eq!(mesh.colors, vec![gray, Vec4::ONE, gray]);
    let [line] = &imported.report.warnings[..] else { panic!("{:?}", imported.report.warnings) };
    assert!(line.contains("3 texture coordinates and colors are not finite"), "{line}");
}

#[test]
fn sparse_elements_lie_over_dense_ones() {
    let mut fixture = Fixture::triangle();
    let places = fixture.view(&[1]);
    let values = fixture.view(&[3.0_f32, 0.0, 0.0].iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>());
    fixture.root["accessors"][0]["sparse"] = json!({"count": 1,
        "indices": {"bufferView": places, "componentType": 5121}, "values": {"bufferView": values}});
    assert_eq!(fixture.load().scene.mesh.positions, vec![Vec3::ZERO, Vec3::X * 3.0, Vec3::Y]);
}

#[test]
fn unusable_vertices_and_triangles_are_left_out() {
    let nan = f32::NAN;
    let mut corners = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    corners.extend([[nan, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    corners.extend([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]);
    let mut fixture = Fixture::mesh(&corners);
    let indices = fixture.accessor("SCALAR", 5121, 12, &[0, 1, 2, 3, 4, 5, 6, 7, 8, 0, 1, 99]);
    fixture.primitive()["indices"] = json!(indices);
    let imported = fixture.load();
    assert_eq!(imported.scene.mesh.triangles.len(), 1);
    assert!(imported.scene.mesh.positions.iter().all(|p| p.is_finite()));
    assert_eq!(imported.report.n_degenerate_triangles, 1);
    let text = imported.report.warnings.join("\n");
    assert!(text.contains("not finite") && text.contains("do not exist"), "{text}");
}

#[test]
fn normals_without_direction_are_replaced() {
    let mut fixture = Fixture::triangle();
    let normal = fixture.floats("VEC3", &[0.0, 0.0, 0.0, f32::NAN, 0.0, 0.0, 1.0, 0.0, 0.0]);
    fixture.primitive()["attributes"]["NORMAL"] = json!(normal);
    let imported = fixture.load();
    assert_eq!(imported.scene.mesh.normals, vec![Vec3::Z, Vec3::Z, Vec3::X]);
    assert_eq!(imported.report.warnings.len(), 1);
}

/// A quad over (0,0)…(1,1) with the image upright on it, and a normal map.
fn normal_mapped_quad(uvs: &[f32; 8]) -> Fixture {
    let mut fixture = Fixture::mesh(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
    let indices = fixture.accessor("SCALAR", 5121, 6, &[0, 1, 2, 0, 2, 3]);
    let normal = fixture.floats("VEC3", &[0.0, 0.0, 1.0].repeat(4));
    let uv = fixture.floats("VEC2", uvs);
    fixture.primitive()["indices"] = json!(indices);
    fixture.primitive()["attributes"]["NORMAL"] = json!(normal);
    fixture.primitive()["attributes"]["TEXCOORD_0"] = json!(uv);
    fixture.root["textures"] = json!([{}]);
    fixture.material(json!({"normalTexture": {"index": 0}}))
}

#[test]
fn tangents_follow_u_and_bitangents_the_images_up() {
    let upright = normal_mapped_quad(&[0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0]).load().scene.mesh;
    assert!(
        upright.tangents.iter().all(|t| t.distance(Vec4::new(1.0, 0.0, 0.0, 1.0)) < 1e-6),
        "{:?}",
        upright.tangents
    );
    let mirrored = normal_mapped_quad(&[1.0, 1.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0]).load().scene.mesh;
    assert!(mirrored.tangents.iter().all(|t| t.distance(Vec4::new(-1.0, 0.0, 0.0, -1.0)) < 1e-6));
}

#[test]
fn given_and_computed_tangents_agree_under_a_mirror() {
    let uvs = [0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0];
    let computed = normal_mapped_quad(&uvs).node(json!({"scale": [-2, 1, 1]})).load().scene.mesh;
    let mut fixture = normal_mapped_quad(&uvs);
    let tangent = fixture.floats("VEC4", &[1.0, 0.0, 0.0, 1.0].repeat(4));
    fixture.primitive()["attributes"]["TANGENT"] = json!(tangent);
    let given = fixture.node(json!({"scale": [-2, 1, 1]})).load().scene.mesh;
    assert_eq!(given.tangents, computed.tangents);
    assert_eq!(given.tangents[0], Vec4::new(-1.0, 0.0, 0.0, -1.0));
}

#[test]
fn tangents_without_direction_are_computed() {
    let mut fixture = normal_mapped_quad(&[0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0]);
    let [given, none] = [[0.6, 0.8, 0.0, 1.0], [0.0; 4]];
    // As exporters write them of a normal that lies along X, say.
    let along_the_normal = [1e-6, 0.0, 1.0, -1.0];
    let tangent = fixture.floats("VEC4", [given, none, along_the_normal, given].as_flattened());
    fixture.primitive()["attributes"]["TANGENT"] = json!(tangent);
    let imported = fixture.load();
    let [given, computed] = [Vec4::from(given), Vec4::new(1.0, 0.0, 0.0, 1.0)];
    for (tangent, expected) in imported.scene.mesh.tangents.iter().zip([given, computed, computed, given]) {
        assert!(tangent.distance(expected) < 1e-5, "{:?}", imported.scene.mesh.tangents);
    }
    let told = imported.report.warnings.iter().filter(|line| line.contains("2 tangents have no direction"));
    assert_eq!(told.count(), 1, "{:?}", imported.report.warnings);
}

#[test]
fn morph_targets_move_by_their_default_weights() {
    let mut fixture = Fixture::triangle();
    let delta = fixture.floats("VEC3", &[0.0, 0.0, 2.0].repeat(3));
    fixture.primitive()["targets"] = json!([{"POSITION": delta}]);
    fixture.root["meshes"][0]["weights"] = json!([1.0]);
    let mesh = fixture.node(json!({"weights": [0.5]})).load().scene.mesh;
    assert!(mesh.positions.iter().all(|p| p.z == 1.0), "{:?}", mesh.positions);
}

#[test]
fn morph_targets_turn_tangents_and_keep_their_handedness() {
    let mut fixture = normal_mapped_quad(&[0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0]);
    let tangent = fixture.floats("VEC4", &[1.0, 0.0, 0.0, -1.0].repeat(4));
    // From +X to +Y.
    let delta = fixture.floats("VEC3", &[-2.0, 2.0, 0.0].repeat(4));
    fixture.primitive()["attributes"]["TANGENT"] = json!(tangent);
    fixture.primitive()["targets"] = json!([{"TANGENT": delta}]);
    fixture.root["meshes"][0]["weights"] = json!([0.5]);
    let mesh = fixture.load().scene.mesh;
    let turned = Vec4::new(0.0, 1.0, 0.0, -1.0);
    assert!(mesh.tangents.iter().all(|tangent| tangent.distance(turned) < 1e-6), "{:?}", mesh.tangents);
}

#[test]
fn a_morph_target_that_is_not_as_long_as_its_mesh_is_told_and_moves_nothing() {
    let mut fixture = Fixture::triangle();
    let delta = fixture.floats("VEC3", &[0.0, 0.0, 2.0].repeat(2));
    fixture.primitive()["targets"] = json!([{"POSITION": delta}]);
    fixture.root["meshes"][0]["weights"] = json!([1.0]);
    let imported = fixture.load();
    assert!(imported.scene.mesh.positions.iter().all(|p| p.z == 0.0), "{:?}", imported.scene.mesh.positions);
    let [line] = &imported.report.warnings[..] else { panic!("{:?}", imported.report.warnings) };
    assert!(line.contains("2 displacements for 3 vertices"), "{line}");
}

#[test]
fn displaced_texture_coordinates_and_colors_are_told_where_they_have_weight() {
    let told = |key: &str, of_mesh: f32, of_node: f32| {
        let mut fixture = Fixture::triangle();
        let delta = fixture.floats("VEC3", &[0.5; 9]);
        fixture.primitive()["targets"] = json!([{"POSITION": delta}, {key: delta}]);
        fixture.root["meshes"][0]["name"] = json!("face");
        fixture.root["meshes"][0]["weights"] = json!([1.0, of_mesh]);
        fixture.node(json!({"weights": [1.0, of_node]})).load().report.unsupported
    };
    for key in ["TEXCOORD_0", "COLOR_0"] {
        for [of_mesh, of_node] in [[0.5, 0.0], [0.0, 0.5]] {
            let told = told(key, of_mesh, of_node);
            assert!(matches!(&told[..], [one] if one.contains("\"face\"") && one.contains("colors")), "{told:?}");
        }
        assert_eq!(told(key, 0.0, 0.0), Vec::<String>::new());
    }
    assert_eq!(told("NORMAL", 1.0, 1.0), Vec::<String>::new());
}

#[test]
fn attributes_that_some_primitives_lack_are_filled_up() {
    let mut fixture = Fixture::triangle();
    let color = fixture.floats("VEC4", &[0.5, 0.25, 0.0, 1.0].repeat(3));
    let plain = fixture.primitive().clone();
    let mut colored = plain.clone();
    colored["attributes"]["COLOR_0"] = json!(color);
    fixture.root["meshes"][0]["primitives"] = json!([plain, colored, plain]);
    let mesh = fixture.load().scene.mesh;
    assert_eq!(mesh.colors.len(), mesh.positions.len());
    assert_eq!(
        (mesh.colors[0], mesh.colors[3], mesh.colors[8]),
        (Vec4::ONE, Vec4::new(0.5, 0.25, 0.0, 1.0), Vec4::ONE)
    );
}
