//! Unlit surfaces: seen in their color, and as if they were not there for light.

use clerestory_transport::bake::BakeConfig;
use clerestory_transport::camera::Film;
use clerestory_transport::import::load_bytes;
use clerestory_transport::light::{LightRig, LightSetting};
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::trace::TraceConfig;
use glam::Vec3;
use serde_json::{Value, json};

use crate::support::{SceneFile, Shape, baked, prepare, relit, traced};

const FILM: Film = Film { width: 16, height: 12 };
const SKY_BLUE: Vec3 = Vec3::new(0.25, 0.5, 1.0);

fn unlit(color: Vec3) -> Value {
    let factor = [color.x, color.y, color.z, 1.0];
    json!({ "pbrMetallicRoughness": { "baseColorFactor": factor }, "extensions": { "KHR_materials_unlit": {} } })
}

/// A floor and a wall behind it, seen from the front, below a lamp that hangs at (0, 4, 0).
fn stage() -> SceneFile {
    let matte = SceneFile::lambert([0.5; 3], [0.0; 3]);
    let floor = Shape::quad(Vec3::new(-1.5, -1.0, 1.5), Vec3::X * 3.0, Vec3::NEG_Z * 3.0);
    let wall = Shape::quad(Vec3::new(-1.5, -1.0, -1.5), Vec3::X * 3.0, Vec3::Y * 2.0);
    SceneFile::default()
        .surface("floor", &floor, matte.clone())
        .surface("wall", &wall, matte)
        .point_lamp("lamp", Vec3::Y * 4.0, [1.0; 3], 1000.0)
        .camera("front", Vec3::Z * 1.4, 1.0)
}

fn picture(scene: &PreparedScene, rig: &LightRig) -> Vec<Vec3> {
    let config = TraceConfig { spp: 16, bounces: None, seed: 1 };
    traced(scene, rig, FILM, &config).into_iter().map(Vec3::from).collect()
}

fn strength(scene: &PreparedScene) -> f32 {
    scene.lighting.basis.source("unlit").unwrap().strength
}

#[test]
fn light_passes_a_dome_that_is_unlit_and_the_camera_sees_it() {
    let scene = prepare(&stage().surface("dome", &Shape::room(Vec3::splat(3.0)), unlit(SKY_BLUE)).glb());
    let (bare, domed) =
        (picture(&prepare(&stage().glb()), &LightRig::default()), picture(&scene, &LightRig::default()));
    let (mut lit, mut blue) = (0, 0);
    for (bare, domed) in bare.iter().zip(&domed) {
        if *bare == Vec3::ZERO {
            assert!(domed.distance(SKY_BLUE * strength(&scene)) < 1e-3 * strength(&scene), "{domed}");
            blue += 1;
        } else if bare.distance(*domed) < 1e-3 * bare.x {
            lit += 1;
        }
    }
    assert!(lit > 80 && blue > 20, "{lit} pixels are lit as without the dome, {blue} show it");
    // A bake has the same.
    let (config, n) = (BakeConfig { spp: 16, ..BakeConfig::default() }, domed.len() as f32);
    let relit = relit(&baked(&scene, FILM, config), &LightRig::default());
    let [relit, traced]: [Vec3; 2] =
        [relit.pixels.iter().map(|rgb| Vec3::from(*rgb)).sum::<Vec3>() / n, domed.iter().sum::<Vec3>() / n];
    assert!(relit.distance(traced) < 0.03 * traced.x, "{relit} {traced}");
}

#[test]
fn a_white_sign_is_as_bright_as_paper_and_a_look_changes_that() {
    let sign = Shape::quad(Vec3::new(-0.2, -0.2, 0.0), Vec3::X * 0.4, Vec3::Y * 0.4);
    let scene = prepare(&stage().surface("sign", &sign, unlit(Vec3::ONE)).glb());
    let paper = 1000.0 / 25.0 / std::f32::consts::PI;
    assert!(strength(&scene) > 0.3 * paper && strength(&scene) < 1.5 * paper, "{} for {paper}", strength(&scene));
    let middle = |setting: LightSetting| {
        let mut rig = LightRig::default();
        rig.set("unlit", setting);
        picture(&scene, &rig)[6 * 16 + 8]
    };
    let plain = middle(LightSetting::default());
    assert!(plain.distance(Vec3::splat(strength(&scene))) < 1e-3 * plain.x, "{plain}");
    let twice = middle(LightSetting { intensity: 2.0, ..LightSetting::default() });
    assert!(twice.distance(2.0 * plain) < 1e-3 * plain.x, "{twice}");
    assert_eq!(middle(LightSetting { muted: true, ..LightSetting::default() }), Vec3::ZERO);
}

#[test]
fn a_mirror_shows_a_sign_and_a_matte_wall_does_not_get_its_light() {
    let sign = Shape::quad(Vec3::new(-9.0, -9.0, 3.0), Vec3::Y * 18.0, Vec3::X * 18.0);
    let room = |wall: Value| {
        let wall_shape = Shape::quad(Vec3::new(-1.5, -1.0, -1.5), Vec3::X * 3.0, Vec3::Y * 2.0);
        let file = SceneFile::default().surface("wall", &wall_shape, wall).surface("sign", &sign, unlit(Vec3::ONE));
        let lamp = file.point_lamp("lamp", Vec3::new(0.0, 50.0, -50.0), [1.0; 3], 1.0);
        prepare(&lamp.camera("front", Vec3::Z * 1.4, 0.5).glb())
    };
    let mirror = json!({ "pbrMetallicRoughness": { "metallicFactor": 1.0, "roughnessFactor": 0.0 } });
    let scene = room(mirror);
    let seen = picture(&scene, &LightRig::default())[6 * 16 + 8];
    assert!(seen.distance(Vec3::splat(strength(&scene))) < 0.01 * strength(&scene), "{seen}");
    let matte = room(SceneFile::lambert([0.5; 3], [0.0; 3]));
    assert_eq!(picture(&matte, &LightRig::default())[6 * 16 + 8], Vec3::ZERO);
}

#[test]
fn of_a_scene_with_no_other_surfaces_it_is_told_that_no_light_changes_it() {
    let told = |with_wall: bool| {
        let wall = Shape::quad(Vec3::new(-1.5, -1.0, -1.5), Vec3::X * 3.0, Vec3::Y * 2.0);
        let scan = SceneFile::default().surface("scan", &Shape::room(Vec3::ONE), unlit(Vec3::ONE));
        let file = if with_wall { scan.surface("wall", &wall, SceneFile::lambert([0.5; 3], [0.0; 3])) } else { scan };
        let scene = load_bytes("scan", &file.glb()).unwrap().scene;
        PreparedScene::new(scene, &[]).unwrap().1.iter().any(|line| line.contains("no light changes the picture"))
    };
    assert!(told(false) && !told(true));
}
