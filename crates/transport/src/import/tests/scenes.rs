use glam::Vec3;
use serde_json::json;

use super::fixture::Fixture;
use crate::camera::Camera;
use crate::fingerprint::fingerprint;
use crate::import::uri::Locator;
use crate::import::{Choice, import};
use crate::scene::PunctualKind;
use crate::stop::Stop;

#[test]
fn lamps_shine_along_minus_z_of_their_node() {
    let mut fixture = Fixture::new();
    fixture.root["extensions"] = json!({"KHR_lights_punctual": {"lights": [
        {"type": "spot", "intensity": 300, "color": [1, 0.5, 0.25], "range": 4, "spot": {}}, {"type": "point"},
        {"type": "directional"}, {"type": "laser"}]}});
    let lit = |light: usize| json!({"extensions": {"KHR_lights_punctual": {"light": light}}});
    fixture.root["nodes"] = json!([lit(0), lit(1), lit(2), lit(3), lit(9)]);
    fixture.root["nodes"][0]["name"] = json!("desk");
    fixture.root["nodes"][0]["translation"] = json!([1, 2, 3]);
    fixture.root["nodes"][0]["rotation"] =
        json!([-std::f32::consts::FRAC_1_SQRT_2, 0, 0, std::f32::consts::FRAC_1_SQRT_2]);
    fixture.root["scenes"][0]["nodes"] = json!([4, 3, 2, 1, 0]);
    let imported = fixture.load();
    let [spot, point, directional] = &imported.scene.punctual[..] else { panic!("three known lamps") };
    assert_eq!(spot.kind, PunctualKind::Spot { inner_rad: 0.0, outer_rad: std::f32::consts::FRAC_PI_4 });
    assert!(spot.direction.distance(Vec3::NEG_Y) < 1e-6, "{}", spot.direction);
    assert_eq!((spot.position, spot.intensity), (Vec3::new(1.0, 2.0, 3.0), 300.0));
    assert_eq!((point.kind, point.intensity, point.color), (PunctualKind::Point, 1.0, Vec3::ONE));
    assert_eq!((directional.kind, directional.direction), (PunctualKind::Directional, Vec3::NEG_Z));
    assert_eq!(imported.scene.nodes[spot.node as usize].name.as_deref(), Some("desk"));
    assert!(imported.scene.nodes.is_sorted_by_key(|node| node.index));
    assert_eq!(imported.report.warnings.len(), 2, "{:?}", imported.report.warnings);
    // By its key in looks.
    assert!(imported.report.unsupported[0].starts_with("lamp \"desk\": its range"));
}

#[test]
fn cones_of_spots_that_are_out_of_range_are_told() {
    let right_angle = std::f32::consts::FRAC_PI_2;
    for (inner, outer, used, n_told) in [
        (0.25, 0.5, [0.25, 0.5], 0),
        (0.5, 0.5, [0.5, 0.5], 0),
        (0.0, 1.571, [0.0, right_angle], 0),
        (0.0, 3.0, [0.0, right_angle], 1),
        (0.5, 0.25, [0.25, 0.25], 1),
    ] {
        let mut fixture = Fixture::new();
        let spot = json!({"innerConeAngle": inner, "outerConeAngle": outer});
        fixture.root["extensions"] =
            json!({"KHR_lights_punctual": {"lights": [{"type": "spot", "name": "wide", "spot": spot}]}});
        let imported = fixture.node(json!({"extensions": {"KHR_lights_punctual": {"light": 0}}})).load();
        let [inner_rad, outer_rad] = used;
        assert_eq!(imported.scene.punctual[0].kind, PunctualKind::Spot { inner_rad, outer_rad });
        let told = imported.report.warnings;
        assert!(told.len() == n_told && told.iter().all(|words| words.contains("lamp \"wide\": its cone")), "{told:?}");
    }
}

#[test]
fn a_lamp_beyond_all_numbers_is_left_out_and_reported() {
    let mut fixture = Fixture::new();
    fixture.root["extensions"] = json!({"KHR_lights_punctual": {"lights": [
        {"type": "point", "intensity": 1e30, "color": [1e30, 1, 1]}]}});
    fixture.root["nodes"] = json!([{"extensions": {"KHR_lights_punctual": {"light": 0}}}]);
    fixture.root["scenes"][0]["nodes"] = json!([0]);
    let imported = fixture.load();
    assert!(imported.scene.punctual.is_empty());
    let told = &imported.report.warnings;
    assert!(told.iter().any(|words| words.contains("is out of range")), "{told:?}");
}

#[test]
fn nodes_know_what_stands_above_them_and_what_they_are_instances_of() {
    let mut fixture = Fixture::triangle();
    fixture.root["extensions"] = json!({"KHR_lights_punctual": {"lights": [{"type": "point", "name": "Bulb"}]}});
    let lit = json!({"name": "left", "extensions": {"KHR_lights_punctual": {"light": 0}}});
    fixture.root["nodes"] = json!([{"name": "Hall", "children": [1]}, {"children": [2, 3]}, lit, {"mesh": 0}]);
    let scene = fixture.load().scene;
    let [lamp, mesh] = scene.nodes.as_slice() else { panic!("two nodes carry something: {:?}", scene.nodes) };
    assert_eq!(scene.names_above(lamp), ["Hall", "node:1"]);
    assert_eq!(mesh.parent, lamp.parent);
    assert_eq!((lamp.lamp.as_deref(), lamp.mesh.as_deref()), (Some("Bulb"), None));
    assert_eq!((mesh.lamp.as_deref(), mesh.mesh.as_deref()), (None, Some("mesh:0")));
}

#[test]
fn a_long_chain_of_nodes_keeps_every_name_once() {
    let mut fixture = Fixture::triangle();
    let n_nodes = 5000;
    let mut nodes: Vec<_> = (1..n_nodes).map(|i| json!({"mesh": 0, "children": [i]})).collect();
    nodes.push(json!({"mesh": 0}));
    fixture.root["nodes"] = json!(nodes);
    let scene = fixture.load().scene;
    assert_eq!((scene.nodes.len(), scene.ancestors.len()), (n_nodes, n_nodes - 1));
    let above = scene.names_above(scene.nodes.last().expect("nodes"));
    assert_eq!((above.len(), above[0].as_str(), above[63].as_str()), (64, "node:4935", "node:4998"));
    assert_eq!(scene.names_above(&scene.nodes[2]), ["node:0", "node:1"]);
}

#[test]
fn a_scale_of_0_turns_neither_lamps_nor_cameras() {
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let shining = json!({"KHR_lights_punctual": {"light": 0}});
    let down = json!([-half, 0, 0, half]);
    let mut fixture = Fixture::triangle();
    fixture.root["cameras"] = json!([{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 1}}]);
    fixture.root["extensions"] = json!({"KHR_lights_punctual": {"lights": [{"type": "spot", "spot": {}}]}});
    fixture.root["nodes"] = json!([
        {"scale": [0, 0, 0], "rotation": down, "extensions": shining, "camera": 0},
        {"scale": [0, 0, 0], "children": [2]}, {"rotation": down, "extensions": shining, "camera": 0},
        {"scale": [1, 1, 0], "rotation": down, "extensions": shining, "camera": 0},
        {"matrix": [2, 0, 0, 0, 0, 0, -2, 0, 0, 0, 0, 0, 0, 0, 0, 1], "extensions": shining, "camera": 0},
        {"matrix": [0, 0, 0, 0, 0, 0, -2, 0, 0, 3, 0, 0, 0, 0, 0, 1], "extensions": shining, "camera": 0},
        {"mesh": 0}]);
    fixture.root["scenes"][0]["nodes"] = json!([0, 1, 3, 4, 5, 6]);
    let scene = fixture.load().scene;
    assert_eq!((scene.punctual.len(), scene.cameras.len()), (5, 5));
    for (lamp, camera) in scene.punctual.iter().zip(&scene.cameras) {
        assert!(lamp.direction.distance(Vec3::NEG_Y) < 1e-6, "{lamp:?}");
        assert!(lamp.across[0].distance(Vec3::X) < 1e-6 && lamp.across[1].distance(Vec3::NEG_Z) < 1e-6, "{lamp:?}");
        let back = camera.world_from_camera.z_axis.truncate();
        assert!(back.distance(Vec3::Y) < 1e-6, "{camera:?}");
    }
}

#[test]
fn a_camera_without_an_angle_of_view_has_one_of_50_degrees() {
    for perspective in [json!({}), json!({"yfov": 0}), json!({"yfov": -0.5}), json!({"yfov": 0.001})] {
        let mut fixture = Fixture::triangle().node(json!({"camera": 0}));
        fixture.root["cameras"] = json!([{"type": "perspective", "perspective": perspective}]);
        let imported = fixture.load();
        let expected: f32 = if perspective["yfov"] == 0.001 { 0.01 } else { 50.0_f32.to_radians() };
        assert!((imported.scene.cameras[0].yfov_rad - expected).abs() < 1e-6, "{perspective}");
        assert_eq!(imported.report.warnings.len(), 1, "{perspective}");
    }
}

#[test]
fn panels_come_from_extras() {
    let panel = |asked| Fixture::triangle().node(json!({"extras": {"clerestory": {"panel": asked}}})).load();
    assert_eq!(panel(json!(32)).scene.nodes[0].panel, Some(32));
    assert_eq!(panel(json!(16.0)).scene.nodes[0].panel, Some(16));
    for asked in [json!(3), json!(65), json!(16.5), json!(-4), json!("many")] {
        let imported = panel(asked);
        assert_eq!(imported.scene.nodes[0].panel, None);
        assert_eq!(imported.report.warnings.len(), 1);
    }
}

#[test]
fn a_panel_without_a_mesh_is_named() {
    let mut fixture = Fixture::triangle();
    fixture.root["nodes"] =
        json!([{"name": "group", "extras": {"clerestory": {"panel": 8}}, "children": [1]}, {"mesh": 0}]);
    let imported = fixture.load();
    assert!(imported.report.warnings[0].contains("\"group\""), "{:?}", imported.report.warnings);
}

#[test]
fn a_camera_that_was_made_is_told() {
    let mut fixture = Fixture::triangle();
    let imported = fixture.load();
    assert!(imported.report.made_camera && imported.scene.cameras.len() == 1);
    fixture = Fixture::triangle().node(json!({"camera": 0}));
    fixture.root["cameras"] = json!([{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 1}}]);
    let imported = fixture.load();
    assert!(!imported.report.made_camera && imported.scene.cameras.len() == 1);
}

#[test]
fn cameras_keep_rotation_and_place_alone() {
    let mut fixture = Fixture::triangle();
    fixture.root["cameras"] = json!([{"type": "perspective", "perspective": {"yfov": 0.8, "aspectRatio": 1.5, "znear": 1}},
        {"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "znear": 0, "zfar": 1}}]);
    fixture.root["nodes"] = json!([
        {"camera": 0, "name": "door", "translation": [0, 0, 5], "scale": [-3, 2, 4]}, {"camera": 1}, {"camera": 0}, {"mesh": 0}]);
    fixture.root["scenes"][0]["nodes"] = json!([0, 1, 2, 3]);
    let imported = fixture.load();
    let [door, second] = &imported.scene.cameras[..] else { panic!("two perspective cameras") };
    assert_eq!((door.name.as_str(), second.name.as_str()), ("door", "camera 2"));
    assert_eq!((door.yfov_rad, door.aspect, door.position()), (0.8, 1.5, Vec3::new(0.0, 0.0, 5.0)));
    let linear = glam::Mat3::from_mat4(door.world_from_camera);
    assert!((linear.determinant() - 1.0).abs() < 1e-6 && linear.z_axis == Vec3::Z);
    assert_eq!(imported.report.unsupported.len(), 1);
}

#[test]
fn cameras_of_one_name_are_told_apart() {
    let mut fixture = Fixture::triangle();
    let perspective = json!({"yfov": 0.8, "znear": 1});
    fixture.root["cameras"] = json!([{"type": "perspective", "name": "eye", "perspective": perspective},
        {"type": "perspective", "perspective": perspective}]);
    fixture.root["nodes"] = json!([{"camera": 0}, {"camera": 0, "name": "door", "translation": [0, 0, 5]},
        {"camera": 1, "name": "eye"}, {"camera": 1}, {"mesh": 0}]);
    fixture.root["scenes"][0]["nodes"] = json!([0, 1, 2, 3, 4]);
    let cameras = fixture.load().scene.cameras;
    let names: Vec<&str> = cameras.iter().map(|camera| camera.name.as_str()).collect();
    assert_eq!(names, ["eye", "eye#2", "eye#3", "camera 4"]);
    assert_eq!(Camera::named(&cameras, "eye#2").map(Camera::position), Some(Vec3::Z * 5.0));
}

#[test]
fn scenes_are_chosen_as_gltf_says() {
    let triangle = || {
        let mut fixture = Fixture::triangle();
        fixture.root["nodes"] =
            json!([{"mesh": 0, "name": "a", "children": [1]}, {"mesh": 0, "name": "b"}, {"mesh": 0}]);
        fixture.root["scenes"] = json!([{"nodes": [2]}, {"nodes": [0]}, {}]);
        fixture
    };
    let n_triangles = |mut fixture: Fixture, scene: serde_json::Value| {
        fixture.root["scene"] = scene;
        fixture.load().scene.mesh.triangles.len()
    };
    assert_eq!(n_triangles(triangle(), json!(1)), 2);
    assert_eq!(n_triangles(triangle(), json!(2)), 0);
    assert_eq!(n_triangles(triangle(), json!(null)), 1);
    let mut without_scenes = triangle();
    without_scenes.root["scenes"] = json!([]);
    assert_eq!(n_triangles(without_scenes, json!(null)), 3);
}

#[test]
fn a_node_that_its_scene_names_before_the_one_above_it_stands_below_that() {
    let mut fixture = Fixture::triangle();
    fixture.root["nodes"] = json!([{"mesh": 0}, {"children": [0], "translation": [5, 0, 0]}]);
    fixture.root["scenes"] = json!([{"nodes": [0, 1]}]);
    let imported = fixture.load();
    let mesh = &imported.scene.mesh;
    assert_eq!((mesh.triangles.len(), mesh.corners(0)[0]), (1, Vec3::X * 5.0));
    assert_eq!(imported.report.warnings, Vec::<String>::new());
}

#[test]
fn hidden_nodes_show_nothing_but_carry_their_cameras() {
    let mut fixture = Fixture::triangle();
    fixture.root["cameras"] = json!([{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 1}}]);
    fixture.root["extensions"] = json!({"KHR_lights_punctual": {"lights": [{"type": "point"}]},
        "KHR_materials_variants": {"variants": [{"name": "beach"}, {"name": "street"}]}});
    let visible = |visible: bool| json!({"visible": visible});
    fixture.root["nodes"] = json!([
        {"mesh": 0, "children": [1, 2], "extensions": {"KHR_node_visibility": visible(false)}},
        {"mesh": 0, "extensions": {"KHR_node_visibility": visible(true), "KHR_lights_punctual": {"light": 0}}},
        {"camera": 0, "mesh": 0}, {"mesh": 0, "extensions": {"KHR_node_visibility": visible(true)}}]);
    fixture.root["scenes"][0]["nodes"] = json!([0, 3]);
    fixture.root["extensionsUsed"] = json!(["KHR_node_visibility", "KHR_materials_variants"]);
    let imported = fixture.load();
    assert_eq!((imported.scene.mesh.triangles.len(), imported.scene.punctual.len()), (1, 0));
    assert_eq!((imported.scene.cameras.len(), imported.scene.nodes.len()), (1, 2));
    let [variants] = &imported.report.unsupported[..] else { panic!("{:?}", imported.report.unsupported) };
    assert!(variants.contains("\"beach\", \"street\""), "{variants}");
}

/// A triangle of material 0 with the variants "beach" (material 1), "street" (its own) and a nameless one (material 2).
fn varied() -> Fixture {
    let mut fixture = Fixture::triangle();
    fixture.root["extensions"] =
        json!({"KHR_materials_variants": {"variants": [{"name": "beach"}, {"name": "street"}, {}]}});
    fixture.root["extensionsUsed"] = json!(["KHR_materials_variants"]);
    let red = |x: f32| json!({"pbrMetallicRoughness": {"baseColorFactor": [x, 0, 0, 1]}});
    fixture.root["materials"] = json!([red(0.25), red(0.5), red(0.75)]);
    fixture.root["meshes"][0]["primitives"][0]["material"] = json!(0);
    fixture.root["meshes"][0]["primitives"][0]["extensions"] = json!({"KHR_materials_variants":
        {"mappings": [{"variants": [0], "material": 1}, {"variants": [9, 2], "material": 2}]}});
    fixture
}

#[test]
fn a_variant_is_shown_by_its_name_and_the_default_without_one() {
    let load = |variant: Option<&str>| {
        let choice = Choice { variant: variant.map(str::to_owned), ..Choice::default() };
        import("test.gltf", &varied().json(), &Locator::new(None, &Stop::default()), &choice)
    };
    let red = |variant: Option<&str>| {
        let imported = load(variant).unwrap();
        let scene = &imported.scene;
        let material = &scene.materials[scene.mesh.triangle_material[0] as usize];
        assert_eq!(imported.report.variants, ["beach", "street", "variant:2"]);
        (material.base_color.x, scene.materials.len(), imported.report.unsupported.len())
    };
    assert_eq!(red(None), (0.25, 1, 1));
    assert_eq!(red(Some("beach")), (0.5, 1, 0));
    assert_eq!(red(Some("street")), (0.25, 1, 0));
    assert_eq!(red(Some("variant:2")), (0.75, 1, 0));
    let error = load(Some("Beach")).unwrap_err().to_string();
    assert!(error.contains("no variant called `Beach`; there are: beach, street, variant:2"), "{error}");
    // A bake of one is not taken for that of another.
    let camera = Camera::look_at("front", Vec3::Z, Vec3::ZERO, 1.0, 1.0);
    let prints = [None, Some("beach"), Some("street"), Some("variant:2")]
        .map(|variant| fingerprint(&load(variant).unwrap().scene, &camera));
    assert!(prints[0] == prints[2] && prints[0] != prints[1] && prints[1] != prints[3], "{prints:?}");
}

#[test]
fn instances_stand_where_they_are_told() {
    let mut fixture = Fixture::triangle();
    let translations = fixture.floats("VEC3", &[0.0, 0.0, 0.0, 5.0, 0.0, 0.0]);
    let scene = fixture
        .node(json!({"extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": translations}}},
            "translation": [0, 1, 0]}))
        .load()
        .scene;
    assert_eq!(scene.mesh.triangle_node, vec![0, 0]);
    assert_eq!((scene.mesh.corners(0)[0], scene.mesh.corners(1)[0]), (Vec3::Y, Vec3::new(5.0, 1.0, 0.0)));
}

/// A triangle with instances by some accessors.
fn instanced(mut fixture: Fixture, attributes: &[(&str, &str, &[f32])]) -> Fixture {
    let accessors =
        attributes.iter().map(|(name, shape, values)| ((*name).to_owned(), json!(fixture.floats(shape, values))));
    let attributes: serde_json::Map<_, _> = accessors.collect();
    fixture.node(json!({"name": "many", "extensions": {"EXT_mesh_gpu_instancing": {"attributes": attributes}}}))
}

#[test]
fn instances_that_shine_are_told_to_be_one_light() {
    let places: (_, _, &[f32]) = ("TRANSLATION", "VEC3", &[0.0, 0.0, 0.0, 5.0, 0.0, 0.0]);
    for (factor, told) in [(json!([1, 1, 1]), 1), (json!([0, 0, 0]), 0)] {
        let fixture = Fixture::triangle().material(json!({"emissiveFactor": factor}));
        let report = instanced(fixture, &[places]).load().report;
        assert_eq!(report.unsupported.len(), told, "{:?}", report.unsupported);
        assert!(report.unsupported.iter().all(|line| line.starts_with("node \"many\": its 2 instances are one light")));
    }
}

#[test]
fn instances_without_a_place_of_their_own_are_seen_as_one() {
    let imported = instanced(Fixture::triangle(), &[("_ID", "SCALAR", &[1.0, 2.0, 3.0])]).load();
    assert_eq!(imported.scene.mesh.triangles.len(), 1);
    let places: (_, _, &[f32]) = ("TRANSLATION", "VEC3", &[0.0; 6]);
    let colored = instanced(Fixture::triangle(), &[places, ("_COLOR_0", "VEC3", &[0.5; 6])]).load();
    assert_eq!(colored.scene.mesh.triangles.len(), 2);
    assert!(colored.report.unsupported[0].contains("colors of their own"), "{:?}", colored.report.unsupported);
}

#[test]
fn instances_whose_transforms_are_not_as_many_are_told() {
    let places: (_, _, &[f32]) = ("TRANSLATION", "VEC3", &[0.0; 9]);
    for (scales, told) in [(&[1.0; 9][..], 0), (&[1.0; 6][..], 1)] {
        let imported = instanced(Fixture::triangle(), &[places, ("SCALE", "VEC3", scales)]).load();
        assert_eq!(imported.scene.mesh.triangles.len(), scales.len() / 3);
        let warnings = &imported.report.warnings;
        let tells = |line: &&String| line.starts_with("node \"many\": ") && line.contains("up to 3: the first 2");
        assert_eq!(warnings.iter().filter(tells).count(), told, "{warnings:?}");
    }
}

#[test]
fn instances_whose_transforms_are_not_finite_are_told() {
    let places: (_, _, &[f32]) = ("TRANSLATION", "VEC3", &[0.0, 0.0, 0.0, f32::NAN, 0.0, 0.0, 5.0, 0.0, 0.0]);
    let turns: (_, _, &[f32]) =
        ("ROTATION", "VEC4", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, f32::NAN, 0.0, 0.0, 1.0]);
    for (attributes, n_lost) in [(&[places][..], 1), (&[turns], 1), (&[places, turns], 2)] {
        let imported = instanced(Fixture::triangle(), attributes).load();
        assert_eq!(imported.scene.mesh.triangles.len(), 3 - n_lost);
        let told =
            format!("node \"many\": {n_lost} of its instances have a transform that is not finite: they are left out");
        assert_eq!(imported.report.warnings, [told]);
    }
}

/// Corners of the twelve triangles of a box, seen from outside.
fn box_corners(size: Vec3) -> Vec<[f32; 3]> {
    const FACES: [[usize; 4]; 6] = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let corner = |i: usize| (Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) * size).to_array();
    FACES.iter().flat_map(|f| [f[0], f[1], f[2], f[0], f[2], f[3]]).map(corner).collect()
}

#[test]
fn a_room_is_seen_from_inside_at_eye_height() {
    let size = Vec3::new(8.0, 3.0, 5.0);
    let mut corners = box_corners(size);
    corners.chunks_mut(3).for_each(|triangle| triangle.swap(1, 2));
    let camera = &Fixture::mesh(&corners).load().scene.cameras[0];
    let eye = camera.position();
    assert!((eye.y - 1.6).abs() < 1e-3 && eye.cmpgt(Vec3::ZERO).all() && eye.cmplt(size).all(), "{eye}");
    let forward = -camera.world_from_camera.z_axis.truncate();
    let to_center = 0.5 * size - eye;
    assert!(forward.dot(to_center) > 0.0, "from {eye} it looks {forward}, away from the room");
    assert!(eye.with_y(0.0).distance(Vec3::new(4.0, 0.0, 2.5)) > 2.0, "{eye} is no corner");
}

#[test]
fn a_house_on_a_wide_ground_is_entered_through_its_open_window() {
    let size = Vec3::new(8.0, 3.0, 5.0);
    let mut corners = box_corners(size);
    corners.chunks_mut(3).for_each(|triangle| triangle.swap(1, 2));
    // The window is the upper half of the wall at x = 8 m.
    let (low, high) = (Vec3::new(8.0, 0.0, 0.0), Vec3::new(8.0, 1.2, 5.0));
    let walls: Vec<[[f32; 3]; 3]> = corners.as_chunks::<3>().0.to_vec();
    let is_window_wall = |triangle: &[[f32; 3]; 3]| triangle.iter().all(|corner| corner[0] == 8.0);
    let mut corners: Vec<[f32; 3]> = walls.into_iter().filter(|wall| !is_window_wall(wall)).flatten().collect();
    let sill = [low, low.with_z(5.0), high, low, high, high.with_z(0.0)];
    corners.extend(sill.map(|corner| corner.to_array()));
    let ground = [[-110.0, -0.1, -110.0], [-110.0, -0.1, 110.0], [110.0, -0.1, 110.0], [110.0, -0.1, -110.0]];
    corners.extend([0, 1, 2, 0, 2, 3].map(|i: usize| ground[i]));
    let camera = &Fixture::mesh(&corners).load().scene.cameras[0];
    let eye = camera.position();
    assert!(eye.cmpgt(Vec3::ZERO).all() && eye.cmplt(size).all(), "{eye}");
}

#[test]
fn an_object_on_a_wide_ground_fills_the_picture() {
    let mut fixture = Fixture::mesh(&box_corners(Vec3::splat(3.0)));
    let mut nodes: Vec<serde_json::Value> =
        (0..60).map(|i| json!({"mesh": 0, "scale": vec![1.0 - 0.01 * i as f64; 3]})).collect();
    nodes.push(json!({"mesh": 0, "scale": [100, 0.001, 100], "translation": [-150, -0.1, -150]}));
    fixture.root["nodes"] = json!(nodes);
    fixture.root["scenes"][0]["nodes"] = json!((0..nodes.len()).collect::<Vec<_>>());
    let eye = fixture.load().scene.cameras[0].position();
    assert!(eye.length() < 15.0, "{eye}");
}

#[test]
fn many_objects_close_together_are_no_room() {
    let mut fixture = Fixture::mesh(&box_corners(Vec3::splat(2.1)));
    let place = |i: usize| [i % 5, i / 5 % 5, i / 25].map(|k| 2.9 * k as f64);
    let nodes: Vec<serde_json::Value> = (0..125).map(|i| json!({"mesh": 0, "translation": place(i)})).collect();
    fixture.root["nodes"] = json!(nodes);
    fixture.root["scenes"][0]["nodes"] = json!((0..nodes.len()).collect::<Vec<_>>());
    assert_eq!(fixture.load().scene.cameras[0].name, "made: outside");
}

#[test]
fn an_object_is_seen_whole_from_outside() {
    for material in [json!({}), json!({"doubleSided": true})] {
        let mut fixture = Fixture::mesh(&box_corners(Vec3::splat(3.0)));
        fixture.root["nodes"] = json!([{"children": [1, 2]}, {"mesh": 0}, {"mesh": 0, "translation": [12, 0, 0]}]);
        let scene = fixture.material(material).load().scene;
        let camera = &scene.cameras[0];
        let film = crate::camera::Film { width: 160, height: 90 };
        for &position in &scene.mesh.positions {
            let px = camera.project(film, position).expect("in front of it");
            assert!(px.cmpgt(glam::Vec2::ZERO).all() && px.cmplt(glam::Vec2::new(160.0, 90.0)).all(), "{px}");
        }
    }
}

#[test]
fn nothing_to_see_needs_no_camera() {
    let imported = Fixture::new().load();
    assert!(imported.scene.cameras.is_empty() && imported.scene.nodes.is_empty());
    let bare = crate::import::load_bytes("bare.gltf", br#"{"asset": {"version": "2.0"}}"#).expect("valid glTF");
    assert!(bare.scene.mesh.triangles.is_empty());
}
