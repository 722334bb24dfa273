//! What a scene is warned of that would be dark, cut away or coarse without a word.

use clerestory_transport::import;
use clerestory_transport::prepared::PreparedScene;
use glam::Vec3;
use serde_json::json;

use crate::support::{SceneFile, Shape};

fn prepared(file: &SceneFile) -> (PreparedScene, Vec<String>) {
    let scene = import::load_bytes("house", &file.glb()).unwrap().scene;
    PreparedScene::new(scene, &[]).unwrap()
}

/// A floor at a place with a lamp above, seen from above its middle.
fn stage(at: Vec3) -> SceneFile {
    let matte = SceneFile::lambert([0.5; 3], [0.0; 3]);
    let floor = Shape::quad(Vec3::new(-2.0, 0.0, 2.0), Vec3::X * 4.0, Vec3::NEG_Z * 4.0).moved(at);
    SceneFile::default().surface("floor", &floor, matte).point_lamp("lamp", at + Vec3::Y, [1.0; 3], 100.0).camera(
        "front",
        at + Vec3::new(0.0, 0.5, 3.0),
        1.0,
    )
}

#[test]
fn a_lamp_in_a_closed_bulb_is_named_with_the_bulb() {
    let matte = SceneFile::lambert([0.5; 3], [0.0; 3]);
    let bulb = Shape::hollow_sphere(0.1, 8).moved(Vec3::Y);
    let (_, warnings) = prepared(&stage(Vec3::ZERO).surface("bulb", &bulb, matte.clone()));
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    assert!(warnings[0].starts_with("light `lamp` is closed in by `bulb`"), "{warnings:?}");
    // Beside it, in half of it, and in a room the lamp shines.
    let beside = stage(Vec3::ZERO).surface("bulb", &bulb.clone().moved(Vec3::X * 0.2), matte.clone());
    let mut half = bulb;
    half.corners.truncate(half.corners.len() / 2);
    let half = stage(Vec3::ZERO).surface("bulb", &half, matte.clone());
    let room = stage(Vec3::ZERO).surface("room", &Shape::room(Vec3::splat(2.5)), matte);
    for file in [beside, half, room] {
        assert_eq!(prepared(&file).1, Vec::<String>::new());
    }
}

#[test]
fn a_camera_behind_a_wall_is_told_that_it_looks_at_its_back() {
    let matte = SceneFile::lambert([0.5; 3], [0.0; 3]);
    let wall = Shape::quad(Vec3::new(-2.0, 0.0, 2.0), Vec3::X * 4.0, Vec3::Y * 3.0);
    let told = |file: &SceneFile| {
        let (scene, _) = prepared(file);
        scene.warn_of_backs(&scene.scene.cameras[0])
    };
    let behind = stage(Vec3::ZERO).surface("wall", &wall.clone().turned(), matte.clone());
    let words = told(&behind).unwrap();
    assert!(words.starts_with("the camera `front` looks at the back of `wall`"), "{words}");
    assert_eq!(told(&stage(Vec3::ZERO).surface("wall", &wall.clone(), matte.clone())), None);
    let (mut both, mut unlit) = (matte.clone(), matte);
    both["doubleSided"] = true.into();
    unlit["extensions"] = json!({"KHR_materials_unlit": {}});
    for material in [both, unlit] {
        assert_eq!(told(&stage(Vec3::ZERO).surface("wall", &wall.clone().turned(), material)), None);
    }
}

#[test]
fn a_scene_in_coordinates_of_a_country_is_told_to_come_nearer() {
    let (_, warnings) = prepared(&stage(Vec3::new(3.5e6, 100.0, 5.8e6)));
    let words = warnings.iter().find(|words| words.contains("km from the origin")).unwrap();
    assert!(
        words.contains("6774 km") && words.contains("0.50 m apart") && words.contains("(-3500000, -100, -5800000)"),
        "{words}"
    );
    for near in [Vec3::ZERO, Vec3::X * 9e3] {
        assert!(prepared(&stage(near)).1.is_empty());
    }
}
