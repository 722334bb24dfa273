//! What is written looks the same when it is opened again.

use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use clerestory_transport::import;
use clerestory_transport::lamps::{FreeLamp, LampShape, LampUnit, PreparedLamps};
use clerestory_transport::light::{LightGroup, LightRig, LightSetting, PanelSpot};
use clerestory_transport::scene::PunctualKind;
use glam::Vec3;
use serde_json::{Value, json};
use tempfile::TempDir;

use super::*;
use crate::support::{ROOM, prepared_room};

fn open(path: &Path) -> PreparedScene {
    PreparedScene::new(import::load(path).unwrap().scene, &[]).unwrap().0
}

/// Files of the repository, and of others where they are at hand.
fn files() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut folders = vec![root.join("assets/scenes")];
    if let Some(shared) = std::env::var_os("CLERESTORY_SHARED") {
        let conformance = std::fs::read_dir(Path::new(&shared).join("conformance")).unwrap();
        folders.extend(conformance.map(|entry| entry.unwrap().path()).filter(|path| path.is_dir()));
    }
    let files = folders.iter().flat_map(|folder| std::fs::read_dir(folder).unwrap()).map(|entry| entry.unwrap().path());
    let is_scene = |path: &PathBuf| path.extension().is_some_and(|e| e == "glb" || e == "gltf");
    let mut files: Vec<PathBuf> = files.filter(is_scene).collect();
    files.sort();
    files
}

/// Scenes of all files that have lights of their own, with a setting for each of these.
static WITH_LIGHTS: LazyLock<Vec<(PathBuf, PreparedScene, Look)>> = LazyLock::new(|| {
    let opened = |file: PathBuf| {
        let (scene, _) = PreparedScene::new(import::load(&file).ok()?.scene, &[]).ok()?;
        let mut look = set_all(&scene);
        look.lights.lights.retain(|key, _| key != "sky" && key != "unlit");
        (!look.lights.lights.is_empty()).then_some((file, scene, look))
    };
    files().into_iter().filter_map(opened).collect()
});

fn save(file: &Path, scene: &PreparedScene, look: &Look, out: &Path) -> Vec<String> {
    let bytes = std::fs::read(file).unwrap();
    Lit { bytes: &bytes, folder: file.parent(), scene, look }.save(out).unwrap()
}

/// JSON and the rest of a file.
fn parts(path: &Path) -> (Value, Vec<(u32, Vec<u8>)>) {
    let bytes = std::fs::read(path).unwrap();
    let Container { json, chunks } = Container::split(&bytes).unwrap();
    let chunks = chunks.into_iter().map(|(kind, content)| (kind, content.to_vec())).collect();
    (serde_json::from_slice(json).unwrap(), chunks)
}

#[test]
fn a_scene_whose_lights_are_as_they_were_is_written_as_it_was() {
    let mut n_files = 0;
    for file in files() {
        let Ok(imported) = import::load(&file) else { continue };
        let Ok((scene, _)) = PreparedScene::new(imported.scene, &[]) else { continue };
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join(file.file_name().unwrap());
        assert_eq!(save(&file, &scene, &Look::default(), &out), Vec::<String>::new());
        assert_eq!(parts(&out), parts(&file), "{}", file.display());
        n_files += 1;
    }
    assert!(n_files >= 5, "{n_files} files");
}

#[test]
fn light_beyond_all_numbers_is_refused() {
    let scene = prepared_room();
    let mut look = Look::default();
    look.lights.lights.insert("lamp".into(), LightSetting { intensity: f32::MAX, ..LightSetting::default() });
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.glb");
    let lit = Lit { bytes: ROOM.as_bytes(), folder: None, scene: &scene, look: &look };
    let said = lit.save(&out).unwrap_err().to_string();
    assert!(said.contains("the light of `lamp` is no finite number"), "{said}");
    assert!(!out.exists());
}

/// A setting for each light, none like the other.
fn set_all(scene: &PreparedScene) -> Look {
    let mut look = Look::default();
    for (nth, source) in scene.lighting.basis.sources.iter().enumerate() {
        let level = 0.25 + (nth % 5) as f32;
        let (color, kelvin) = match nth % 3 {
            0 => (Some([0.2, 1.5, 0.7]), None),
            1 => (None, Some(2200.0 + 100.0 * nth as f32)),
            _ => (None, None),
        };
        look.lights.lights.insert(source.key.clone(), LightSetting { intensity: level, color, kelvin, muted: false });
    }
    look
}

/// Holds what every light sends against what it sends in the file that was written.
#[track_caller]
fn assert_same_light(before: &PreparedScene, look: &Look, after: &PreparedScene) {
    let (was, is) = (&before.lighting.basis, &after.lighting.basis);
    let (lit, written) = (was.project(&look.lights), is.project(&is.file_rig()));
    for source in &was.sources {
        let expected = &lit[source.columns.start as usize..source.columns.end as usize];
        let Some(found) = is.source(&source.key) else {
            assert!(expected.iter().flatten().all(|v| *v == 0.0), "`{}` is gone", source.key);
            continue;
        };
        let found = &written[found.columns.start as usize..found.columns.end as usize];
        assert_eq!(expected.len(), found.len(), "{}", source.key);
        for (a, b) in expected.iter().zip(found) {
            let off = (Vec3::from(*a) - Vec3::from(*b)).abs().max_element();
            assert!(off <= 1e-4 * Vec3::from(*a).max_element(), "`{}` sends {b:?} and not {a:?}", source.key);
        }
    }
}

#[test]
fn every_light_of_every_scene_sends_what_it_was_set_to() {
    let mut n_lights = 0;
    for (file, scene, look) in &*WITH_LIGHTS {
        let folder = tempfile::tempdir().unwrap();
        for name in ["out.glb", "out.gltf"] {
            let out = folder.path().join(name);
            save(file, scene, look, &out);
            assert_same_light(scene, look, &open(&out));
        }
        n_lights += look.lights.lights.len();
    }
    assert!(n_lights >= 20, "{n_lights} lights");
}

/// Two nodes share a mesh that shines, two a lamp; a third node uses the same material.
fn shared() -> Vec<u8> {
    let mut gltf: Value = serde_json::from_str(ROOM).unwrap();
    let push = |list: &mut Value, item: Value| {
        let list = list.as_array_mut().unwrap();
        list.push(item);
        list.len() - 1
    };
    let quad = json!({"bufferView": 1, "byteOffset": 36, "componentType": 5123, "count": 6, "type": "SCALAR"});
    let indices = push(&mut gltf["accessors"], quad);
    let material = push(&mut gltf["materials"], json!({"emissiveFactor": [1, 0.9, 0.8], "extras": {"kept": [1.50]}}));
    for primitives in 1..=2 {
        let primitive = json!({"attributes": {"POSITION": 0}, "indices": indices, "material": material});
        push(&mut gltf["meshes"], json!({"primitives": vec![primitive; primitives]}));
    }
    let [first, second] = [gltf["meshes"].as_array().unwrap().len() - 2, gltf["meshes"].as_array().unwrap().len() - 1];
    for (name, mesh) in [("a", first), ("b", first), ("c", second), ("panel", first)] {
        let x = f32::from(name.as_bytes()[0] % 5) * 0.1;
        let mut node = json!({"name": name, "mesh": mesh, "scale": [0.1, 0.1, 0.1], "translation": [x, 0.2, -0.5]});
        if name == "panel" {
            node["extras"] = json!({"clerestory": {"panel": 4}, "other": 1});
        }
        let node = push(&mut gltf["nodes"], node);
        push(&mut gltf["scenes"][0]["nodes"], json!(node));
    }
    let lamp = gltf["nodes"].as_array().unwrap().iter().find(|node| node["extensions"].is_object()).unwrap().clone();
    let twin = push(&mut gltf["nodes"], json!({"name": "twin", "extensions": lamp["extensions"]}));
    push(&mut gltf["scenes"][0]["nodes"], json!(twin));
    serde_json::to_vec(&gltf).unwrap()
}

#[test]
fn what_several_nodes_share_is_copied_and_muted_lights_are_dark() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("in.gltf"), folder.path().join("out.gltf"));
    std::fs::write(&file, shared()).unwrap();
    let scene = open(&file);
    let mut look = Look::default();
    let set = |look: &mut Look, key: &str, setting| look.lights.lights.insert(key.into(), setting);
    set(&mut look, "a", LightSetting { intensity: 3.0, ..LightSetting::default() });
    set(&mut look, "c", LightSetting { color: Some([0.0, 0.5, 2.0]), ..LightSetting::default() });
    set(&mut look, "lamp", LightSetting { muted: true, ..LightSetting::default() });
    set(&mut look, "panel", LightSetting { intensity: 0.5, kelvin: Some(3000.0), ..LightSetting::default() });
    let spot = PanelSpot { position: [0.3, 0.6], radius: 0.4, color: None, intensity: 2.0 };
    look.lights.panels.insert("panel".into(), vec![spot, PanelSpot { color: Some([1.0, 0.0, 0.2]), ..spot }]);
    assert_eq!(save(&file, &scene, &look, &out), Vec::<String>::new());
    let again = open(&out);
    assert_same_light(&scene, &look, &again);
    let (before, after) = (parts(&file).0, parts(&out).0);
    // `b` and `twin` were not touched, and so are what they share with others.
    assert_eq!(after["materials"][1], before["materials"][1]);
    let lamps = &after["extensions"]["KHR_lights_punctual"]["lights"];
    assert_eq!((lamps.as_array().unwrap().len(), &lamps[1]["intensity"]), (2, &json!(0.0)));
    let copies = after["materials"].as_array().unwrap().len() - before["materials"].as_array().unwrap().len();
    assert_eq!(copies, 3);
    assert!(after["materials"].as_array().unwrap().iter().skip(1).all(|m| m["extras"]["kept"][0] == 1.5));
    assert_eq!(after["nodes"][5]["extras"]["other"].clone(), before["nodes"][5]["extras"]["other"].clone());
    // Written once more, it is the same again.
    let (third, last) = (folder.path().join("third.gltf"), open(&out));
    save(&out, &last, &Look::of_file(&last.lighting.basis), &third);
    assert_eq!(parts(&third), parts(&out));
}

#[test]
fn colors_with_an_alpha_too_much_are_written_as_they_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("in.gltf"), folder.path().join("out.gltf"));
    let mut gltf: Value = serde_json::from_slice(&shared()).unwrap();
    let shining = gltf["materials"].as_array_mut().unwrap().last_mut().unwrap();
    shining["emissiveFactor"] = json!([1, 0.9, 0.8, 1]);
    gltf["extensions"]["KHR_lights_punctual"]["lights"][0]["color"] = json!([1, 0.5, 0.25, 1]);
    std::fs::write(&file, gltf.to_string()).unwrap();
    let scene = open(&file);
    for muted in [false, true] {
        let mut look = Look::default();
        for key in ["a", "c", "lamp"] {
            look.lights.lights.insert(key.into(), LightSetting { intensity: 3.0, muted, ..LightSetting::default() });
        }
        assert_eq!(save(&file, &scene, &look, &out), Vec::<String>::new());
        assert_same_light(&scene, &look, &open(&out));
    }
}

#[test]
fn a_directional_lamp_with_a_size_is_written_as_it_is_set() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("in.gltf"), folder.path().join("out.gltf"));
    std::fs::write(&file, ROOM.replace("\"point\"", "\"directional\"")).unwrap();
    let mut scene = import::load(&file).unwrap().scene;
    assert_eq!(scene.set_sun_radius(0.01), 1);
    let scene = PreparedScene::new(scene, &[]).unwrap().0;
    let mut look = Look::default();
    let dim = LightSetting { intensity: 0.5, color: Some([1.0, 0.5, 0.25]), ..LightSetting::default() };
    for muted in [false, true] {
        look.lights.lights.insert("lamp".into(), LightSetting { muted, ..dim });
        let told = save(&file, &scene, &look, &out);
        assert!(told.len() == 1 && told[0].contains("`lamp` has an angle"), "{told:?}");
        let again = open(&out);
        assert_same_light(&scene, &look, &again);
        assert_eq!(again.lighting.basis.muted.contains("lamp"), muted);
    }
}

/// All lights are off, each in one of the ways there are.
fn turned_off(scene: &PreparedScene, look: &Look) -> Look {
    let mut off = look.clone();
    let keys = scene.lighting.basis.sources.iter().map(|source| source.key.clone());
    let (by_group, by_hand): (Vec<_>, Vec<_>) = keys.enumerate().partition(|(nth, _)| nth % 4 == 3);
    let group = LightGroup { lights: by_group.into_iter().map(|(_, key)| key).collect(), intensity: 1.0, muted: true };
    off.lights.groups.insert("off".into(), group);
    for (_, key) in by_hand {
        off.lights.lights.entry(key).or_default().muted = true;
    }
    off
}

#[test]
fn lights_that_are_off_keep_what_they_are_in_every_scene() {
    let mut n_lights = 0;
    for (file, scene, look) in &*WITH_LIGHTS {
        let (folder, off) = (tempfile::tempdir().unwrap(), turned_off(scene, look));
        let out = folder.path().join("out.glb");
        save(file, scene, &off, &out);
        let again = open(&out);
        let basis = &again.lighting.basis;
        let lit = (basis.project(&LightRig::default()), scene.lighting.basis.project(&look.lights));
        for source in scene.lighting.basis.sources.iter().filter(|source| source.key != "sky" && source.key != "unlit")
        {
            assert!(basis.file_rig().setting(&source.key).muted, "`{}` of {}", source.key, file.display());
            let found = &basis.source(&source.key).unwrap().columns;
            for (new, old) in found.clone().zip(source.columns.clone()) {
                let [new, old] = [Vec3::from(lit.0[new as usize]), Vec3::from(lit.1[old as usize])];
                let off = (new - old).abs().max_element();
                assert!(off <= 1e-4 * old.max_element(), "`{}` sends {new} and not {old}", source.key);
            }
            n_lights += 1;
        }
        // Others find them dark.
        let written = parts(&out).0;
        let lamps = written["extensions"]["KHR_lights_punctual"]["lights"].as_array().into_iter().flatten();
        assert!(lamps.filter(|lamp| lamp["intensity"] != 0.0).count() == 0, "{}", file.display());
    }
    assert!(n_lights >= 20, "{n_lights} lights");
}

#[test]
fn a_muted_panel_keeps_its_spots_and_is_turned_on_in_the_file_again() {
    let folder = tempfile::tempdir().unwrap();
    let [file, dark, lit] = ["in.gltf", "dark.gltf", "lit.gltf"].map(|name| folder.path().join(name));
    std::fs::write(&file, shared()).unwrap();
    let scene = open(&file);
    let mut look = Look::default();
    let setting = LightSetting { intensity: 0.5, kelvin: Some(3000.0), ..LightSetting::default() };
    look.lights.lights.insert("panel".into(), setting);
    let spot = PanelSpot { position: [0.3, 0.6], radius: 0.4, color: None, intensity: 2.0 };
    look.lights.panels.insert("panel".into(), vec![spot, PanelSpot { color: Some([1.0, 0.0, 0.2]), ..spot }]);
    let mut off = look.clone();
    // A fader that is all the way down is no loss either.
    off.lights.lights.insert("lamp".into(), LightSetting { intensity: 0.0, ..LightSetting::default() });
    off.lights.lights.insert("panel".into(), LightSetting { muted: true, ..setting });
    assert_eq!(save(&file, &scene, &off, &dark), Vec::<String>::new());
    let again = open(&dark);
    assert_same_light(&scene, &off, &again);
    assert_eq!(again.lighting.basis.muted, ["lamp".to_owned(), "panel".to_owned()].into());
    // Turned on, and written so, nothing tells that it was ever off.
    save(&dark, &again, &Look::default(), &lit);
    let last = open(&lit);
    assert_same_light(&scene, &look, &last);
    assert!(last.lighting.basis.muted.is_empty());
    let nodes = parts(&lit).0["nodes"].to_string();
    assert!(!nodes.contains("muted"), "{nodes}");
}

#[test]
fn spots_brighter_than_a_file_holds_are_told_and_read_again() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("in.gltf"), folder.path().join("out.gltf"));
    std::fs::write(&file, shared()).unwrap();
    let scene = open(&file);
    let mut look = Look::default();
    // What a spot with a color of its own does not take over of this, it has to make up for.
    let dim = LightSetting { color: Some([0.25; 3]), ..LightSetting::default() };
    look.lights.lights.insert("panel".into(), dim);
    let most = PanelSpot::MOST_INTENSITY;
    let spot = PanelSpot { position: [0.3, 0.6], radius: 0.4, color: Some([1.0, 0.0, 0.2]), intensity: most };
    look.lights.panels.insert("panel".into(), vec![spot]);
    let told = save(&file, &scene, &look, &out);
    assert!(told.len() == 1 && told[0].contains("`panel`"), "{told:?}");
    assert_eq!(open(&out).lighting.basis.spots["panel"], vec![spot]);
}

#[test]
fn free_lamps_become_nodes_that_shine_alike() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("in.gltf"), folder.path().join("out.glb"));
    std::fs::write(&file, ROOM).unwrap();
    let ies = "IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 3 1 1 2 0 0 0\n1 1 10\n0 45 90\n0\n100 50 0\n";
    std::fs::write(folder.path().join("x.ies"), ies).unwrap();
    let profile = folder.path().join("x.ies").display().to_string();
    let scene = open(&file);
    let (aim, position) = (Vec3::new(0.3, -0.4, -0.6), Vec3::new(0.1, 0.4, -0.2));
    let setting = LightSetting { kelvin: Some(3000.0), intensity: 2.0, ..LightSetting::default() };
    let lamp = |shape: LampShape| {
        let unit = if shape.is_parallel() { LampUnit::Lux } else { LampUnit::Lumen };
        FreeLamp {
            key: shape.name().to_owned(),
            shape,
            position,
            aim,
            strength: 300.0,
            unit,
            setting,
            turn_rad: 0.4,
            replaces: None,
        }
    };
    let mut look = Look::default();
    look.lights.lamps = vec![
        lamp(LampShape::Point),
        lamp(LampShape::Spot { inner_rad: 0.2, outer_rad: 0.5 }),
        lamp(LampShape::Directional { radius_rad: 0.0 }),
        lamp(LampShape::Profile { file: profile }),
        lamp(LampShape::Rectangle { size_m: [0.3, 0.2] }),
        lamp(LampShape::Disk { radius_m: 0.1 }),
        lamp(LampShape::Sphere { radius_m: 0.1 }),
    ];
    // Muted or not, their light is in the file.
    for muted in [true, false] {
        look.lights.lamps.iter_mut().for_each(|lamp| lamp.setting.muted = muted);
        assert_eq!(save(&file, &scene, &look, &out), Vec::<String>::new());
        look.lights.lamps.iter_mut().for_each(|lamp| lamp.setting.muted = false);
        hold_free_lamps(&look, &open(&out), muted);
    }
    // The light of the file is what it was.
    assert_same_light(&scene, &Look::default(), &open(&out));
}

#[test]
fn a_free_lamp_that_its_group_turns_down_keeps_what_it_is_set_to_itself() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("in.gltf"), folder.path().join("out.gltf"));
    std::fs::write(&file, ROOM).unwrap();
    let scene = open(&file);
    let mut look = Look::default();
    look.lights.lamps = vec![free("bulb", LampShape::Point)];
    look.lights.lamps[0].setting.intensity = 0.25;
    let dark = LightGroup { lights: ["bulb".to_owned()].into(), intensity: 0.0, muted: false };
    let mut down = look.clone();
    down.lights.groups.insert("desks".into(), dark);
    assert_eq!(save(&file, &scene, &down, &out), Vec::<String>::new());
    hold_free_lamps(&look, &open(&out), true);
}

/// A lamp of a look in the room.
fn free(key: &str, shape: LampShape) -> FreeLamp {
    FreeLamp {
        key: key.into(),
        shape,
        position: Vec3::new(0.1, 0.4, -0.2),
        aim: Vec3::new(0.3, -0.4, -0.6),
        strength: 300.0,
        unit: LampUnit::Lumen,
        setting: LightSetting::default(),
        turn_rad: 0.4,
        replaces: None,
    }
}

#[test]
fn places_that_are_written_with_a_fraction_of_zero_are_found() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("in.gltf"), folder.path().join("out.gltf"));
    let mut gltf: Value = serde_json::from_str(ROOM).unwrap();
    gltf["scene"] = json!(0.0);
    gltf["scenes"][0]["nodes"] = json!([0.0, 1.0, 2.0]);
    gltf["nodes"][1]["extensions"]["KHR_lights_punctual"]["light"] = json!(0.0);
    std::fs::write(&file, gltf.to_string()).unwrap();
    let scene = open(&file);
    let mut look = Look::default();
    look.lights.lights.insert("lamp".into(), LightSetting { intensity: 0.5, ..LightSetting::default() });
    look.lights.lamps = vec![free("added", LampShape::Point)];
    assert_eq!(save(&file, &scene, &look, &out), Vec::<String>::new());
    let again = open(&out);
    assert_same_light(&scene, &look, &again);
    assert!(again.lighting.basis.source("added").is_some() && again.scene.mesh.triangles.len() == 12);
}

#[test]
fn a_spot_wider_than_gltf_has_them_is_told_and_ends_at_90_degrees() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("in.gltf"), folder.path().join("out.glb"));
    std::fs::write(&file, ROOM).unwrap();
    let mut look = Look::default();
    look.lights.lamps = [("wide", 2.0), ("right", std::f32::consts::FRAC_PI_2)]
        .map(|(key, outer_rad)| free(key, LampShape::Spot { inner_rad: 0.2, outer_rad }))
        .into();
    let told = save(&file, &open(&file), &look, &out);
    assert!(told.len() == 1 && told[0].contains("`wide` has a cone"), "{told:?}");
    let again = import::load(&out).unwrap();
    assert!(again.report.warnings.is_empty(), "{:?}", again.report);
    let ends = PunctualKind::Spot { inner_rad: 0.2, outer_rad: std::f32::consts::FRAC_PI_2 };
    assert!(again.scene.punctual.iter().filter(|lamp| lamp.kind == ends).count() == 2, "{:?}", again.scene.punctual);
}

#[test]
fn cones_of_spots_are_within_what_gltf_asks_for() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("in.gltf"), folder.path().join("out.gltf"));
    std::fs::write(&file, ROOM).unwrap();
    let mut look = Look::default();
    look.lights.lamps = [("hard", 0.4), ("right", std::f32::consts::FRAC_PI_2)]
        .map(|(key, rad)| free(key, LampShape::Spot { inner_rad: rad, outer_rad: rad }))
        .into();
    assert_eq!(save(&file, &open(&file), &look, &out), Vec::<String>::new());
    let document = parts(&out).0;
    for (key, rad) in [("hard", f64::from(0.4f32)), ("right", std::f64::consts::FRAC_PI_2)] {
        let lamps = document["extensions"]["KHR_lights_punctual"]["lights"].as_array().unwrap();
        let cone = &lamps.iter().find(|lamp| lamp["name"] == key).unwrap()["spot"];
        let [inner, outer] = ["innerConeAngle", "outerConeAngle"].map(|name| cone[name].as_f64().unwrap());
        assert!(inner < outer && inner > 0.999 * outer && outer == rad, "{cone}");
    }
}

#[test]
fn a_free_lamp_of_a_eulumdat_file_comes_back_with_its_distribution() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out, profile) =
        (folder.path().join("in.gltf"), folder.path().join("out.glb"), folder.path().join("x.ldt"));
    std::fs::write(&file, ROOM).unwrap();
    // Rotationally symmetric, 1000 lm.
    let mut lines = vec!["0"; 42];
    for (line, value) in [(3, "1"), (4, "1"), (6, "3"), (24, "1"), (26, "1"), (29, "1000")] {
        lines[line - 1] = value;
    }
    lines.extend(["0", "0", "45", "90", "100", "50", "0"]);
    std::fs::write(&profile, lines.join("\n")).unwrap();
    let mut look = Look::default();
    look.lights.lamps = vec![free("measured", LampShape::Profile { file: profile.display().to_string() })];
    let told = save(&file, &open(&file), &look, &out);
    assert!(told.len() == 1 && told[0].contains("`measured` has a EULUMDAT file"), "{told:?}");
    let again = open(&out);
    hold_free_lamps(&look, &again, false);
    assert_eq!(again.lighting.basis.source("measured").unwrap().origin.profile.as_deref(), Some("x.ldt"));
}

#[test]
fn the_plain_lamp_beside_a_measured_one_follows_it_and_comes_back_from_the_dark() {
    let folder = tempfile::tempdir().unwrap();
    let [file, out, lit] = ["in.gltf", "out.gltf", "lit.gltf"].map(|name| folder.path().join(name));
    let mut gltf: Value = serde_json::from_str(ROOM).unwrap();
    let ies = "IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 3 1 1 2 0 0 0\n1 1 10\n0 45 90\n0\n100 50 0\n";
    std::fs::write(folder.path().join("x.ies"), ies).unwrap();
    gltf["extensions"]["EXT_lights_ies"] = json!({ "lights": [{ "uri": "x.ies" }] });
    gltf["extensionsUsed"] = json!(["KHR_lights_punctual", "EXT_lights_ies"]);
    gltf["extensions"]["KHR_lights_punctual"]["lights"][0]["color"] = json!([1.0, 0.5, 0.25]);
    gltf["extensions"]["KHR_lights_punctual"]["lights"][0]["intensity"] = json!(24.0);
    gltf["nodes"][1]["extensions"]["EXT_lights_ies"] = json!({ "light": 0, "color": [0.5, 1.0, 1.0] });
    std::fs::write(&file, gltf.to_string()).unwrap();
    let scene = open(&file);
    let write = |of: &Path, scene: &PreparedScene, setting: LightSetting, to: &Path| {
        let mut look = Look::default();
        look.lights.lights.insert("lamp".into(), setting);
        assert_eq!(save(of, scene, &look, to), Vec::<String>::new());
        assert_same_light(scene, &look, &open(to));
        let written = parts(to).0;
        let plain = &written["extensions"]["KHR_lights_punctual"]["lights"][0];
        (plain["color"].clone(), plain["intensity"].as_f64().unwrap(), written["nodes"][1].clone())
    };
    let on = LightSetting::default();
    // Off it is dark for all, and on again everything is as it was.
    let dark = write(&file, &scene, LightSetting { muted: true, ..on }, &out);
    assert_eq!((dark.1, &dark.2["extras"]["clerestory"]["muted"]["plain_cd"]), (0.0, &json!(24.0)));
    let again = write(&out, &open(&out), on, &lit);
    assert_eq!((again.0, again.1), (json!([1.0, 0.5, 0.25]), 24.0));
    assert_eq!(again.2["extensions"]["EXT_lights_ies"]["color"], json!([0.5, 1.0, 1.0]));
    assert!(again.2.get("extras").is_none(), "{}", again.2);
    // Dimmed or colored, the plain lamp is so, too.
    assert_eq!(write(&file, &scene, LightSetting { intensity: 0.5, ..on }, &out).1, 12.0);
    let (color, ..) = write(&file, &scene, LightSetting { color: Some([0.0, 0.5, 1.0]), ..on }, &out);
    assert_eq!(color, json!([0.0, 0.5, 1.0]));
}

#[test]
fn a_measured_lamp_without_its_file_or_with_numbers_out_of_range_is_written_as_it_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let [file, out, lit] = ["in.gltf", "out.gltf", "lit.gltf"].map(|name| folder.path().join(name));
    let ies = "IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 3 1 1 2 0 0 0\n1 1 10\n0 45 90\n0\n100 50 0\n";
    std::fs::write(folder.path().join("x.ies"), ies).unwrap();
    let out_of_range = json!({ "light": 0, "multiplier": -1, "color": [1.0, 0.5, 2.0] });
    for (uri, instance) in [("absent.ies", json!({ "light": 0, "multiplier": 0.5 })), ("x.ies", out_of_range)] {
        let mut gltf: Value = serde_json::from_str(ROOM).unwrap();
        gltf["extensions"]["EXT_lights_ies"] = json!({ "lights": [{ "uri": uri }] });
        gltf["extensionsUsed"] = json!(["KHR_lights_punctual", "EXT_lights_ies"]);
        gltf["nodes"][1]["extensions"] = json!({ "EXT_lights_ies": instance });
        std::fs::write(&file, gltf.to_string()).unwrap();
        let scene = open(&file);
        let write = |of: &Path, setting: LightSetting, to: &Path| {
            let mut look = Look::default();
            look.lights.lights.insert("lamp".into(), setting);
            assert_eq!(save(of, &open(of), &look, to), Vec::<String>::new());
            assert_same_light(&scene, &look, &open(to));
        };
        let on = LightSetting::default();
        write(&file, LightSetting { intensity: 0.25, ..on }, &out);
        write(&file, LightSetting { color: Some([0.2, 1.0, 0.4]), ..on }, &out);
        write(&file, LightSetting { muted: true, ..on }, &out);
        let dark = parts(&out).0["nodes"][1]["extensions"]["EXT_lights_ies"]["multiplier"].as_f64();
        assert_eq!(dark, Some(0.0), "others find it dark");
        write(&out, on, &lit);
    }
}

/// Holds the lights of a file against the free lamps that they were.
#[track_caller]
fn hold_free_lamps(look: &Look, again: &PreparedScene, muted: bool) {
    let basis = &again.lighting.basis;
    let light = basis.project(&Look::default().lights);
    for lamp in &look.lights.lamps {
        let source = basis.source(&lamp.key).unwrap();
        assert_eq!(basis.muted.contains(&lamp.key), muted, "{lamp:?}");
        let expected = PreparedLamps::new(std::slice::from_ref(lamp), None).unwrap().0.emission(&lamp.key).unwrap();
        let found = Vec3::from(light[source.columns.start as usize]);
        assert!((found - expected).abs().max_element() < 1e-3 * expected.max_element(), "{found} {lamp:?}");
        let node = again.scene.nodes.iter().position(|node| node.name.as_ref() == Some(&lamp.key)).unwrap();
        if let Some(punctual) = again.scene.punctual.iter().find(|light| light.node as usize == node) {
            let ahead = (lamp.aim - lamp.position).normalize();
            assert!(punctual.position.distance(lamp.position) < 1e-5 && punctual.direction.distance(ahead) < 1e-5);
            let measured = matches!(lamp.shape, LampShape::Profile { .. });
            assert_eq!(punctual.profile.is_some(), measured);
            assert!(!measured || punctual.across[0].distance(lamp.frame()[0]) < 1e-5, "it is turned as it was");
        } else {
            let mesh = &again.scene.mesh;
            let own = (0..mesh.triangles.len()).filter(|t| mesh.triangle_node[*t] as usize == node);
            let toward: Vec3 = own.map(|t| mesh.area_normal(t as u32)).sum();
            let flat = !matches!(lamp.shape, LampShape::Sphere { .. });
            assert!(!flat || toward.normalize().distance((lamp.aim - lamp.position).normalize()) < 1e-4, "{lamp:?}");
            if let LampShape::Rectangle { size_m: [width, _] } = lamp.shape {
                let own = (0..mesh.triangles.len()).filter(|t| mesh.triangle_node[*t] as usize == node);
                let mut corners = own.flat_map(|t| mesh.corners(t as u32));
                let aside = |corner: Vec3| (corner - lamp.position).dot(lamp.frame()[0]).abs();
                assert!(corners.all(|corner| (aside(corner) - 0.5 * width).abs() < 1e-5), "it is turned as it was");
            }
        }
    }
}

/// A folder of one that holds `data/a b.bin` and an empty one.
fn two_folders() -> (TempDir, [PathBuf; 2]) {
    let folder = tempfile::tempdir().unwrap();
    let [from, to] = ["from", "to"].map(|name| folder.path().join(name));
    std::fs::create_dir_all(from.join("data")).unwrap();
    std::fs::write(from.join("data/a b.bin"), b"abc").unwrap();
    std::fs::create_dir(&to).unwrap();
    (folder, [from, to])
}

#[test]
fn what_a_gltf_refers_to_comes_along_and_nothing_else_is_overwritten() {
    let (_folder, [from, to]) = two_folders();
    let file = from.join("in.gltf");
    std::fs::write(&file, r#"{"asset": {"version": "2.0"}, "buffers": [{"byteLength": 3, "uri": "data/a%20b.bin"}]}"#)
        .unwrap();
    let write = |out: &Path| {
        let bytes = std::fs::read(&file).unwrap();
        let document = Document::parse(&bytes).unwrap();
        container::save(&Container::split(&bytes).unwrap(), document, Kind::Gltf, Some(&from), out)
    };
    write(&to.join("out.gltf")).unwrap();
    assert_eq!(std::fs::read(to.join("data/a b.bin")).unwrap(), b"abc");
    write(&to.join("again.gltf")).unwrap();
    std::fs::write(to.join("data/a b.bin"), b"other").unwrap();
    let error = write(&to.join("third.gltf")).unwrap_err().to_string();
    assert!(error.contains("is there already") && !to.join("third.gltf").exists(), "{error}");
}

#[test]
fn of_a_gltf_that_cannot_be_written_nothing_stays() {
    let (_folder, [from, to]) = two_folders();
    for (folder, content) in [(&from, b"one"), (&to, b"two")] {
        std::fs::write(folder.join("a.png"), content).unwrap();
    }
    let bytes = br#"{"asset": {"version": "2.0"}, "buffers": [{"byteLength": 3, "uri": "data/a%20b.bin"}],
        "images": [{"uri": "a.png"}]}"#;
    let (source, document) = (Container::split(bytes).unwrap(), Document::parse(bytes).unwrap());
    let refused = container::save(&source, document, Kind::Gltf, Some(&from), &to.join("out.gltf"));
    assert!(refused.unwrap_err().to_string().contains("a.png is there already"));
    assert!(!to.join("data/a b.bin").exists() && !to.join("out.gltf").exists());
    assert_eq!(std::fs::read(to.join("a.png")).unwrap(), b"two");
}

#[test]
fn what_a_gltf_names_as_windows_does_comes_along() {
    let (_folder, [from, to]) = two_folders();
    let bytes = br#"{"asset": {"version": "2.0"}, "buffers": [{"byteLength": 3, "uri": "Data\\A%20b.bin"}]}"#;
    let (source, document) = (Container::split(bytes).unwrap(), Document::parse(bytes).unwrap());
    container::save(&source, document, Kind::Gltf, Some(&from), &to.join("out.gltf")).unwrap();
    assert_eq!(std::fs::read(to.join("Data/A b.bin")).unwrap(), b"abc");
}

#[test]
fn the_binary_part_is_named_as_a_uri() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("50% night.gltf");
    let source = Container { json: b"{}", chunks: vec![(0x004E_4942, &b"abc\0"[..])] };
    let document = Document::parse(br#"{"asset": {"version": "2.0"}, "buffers": [{"byteLength": 4}]}"#).unwrap();
    container::save(&source, document, Kind::Gltf, None, &out).unwrap();
    assert_eq!(parts(&out).0["buffers"][0]["uri"], "50%25%20night.bin");
    assert_eq!(std::fs::read(folder.path().join("50% night.bin")).unwrap(), b"abc\0");
}

#[test]
fn a_binary_part_that_no_buffer_is_takes_the_place_of_none() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.gltf");
    let source = Container { json: b"{}", chunks: vec![(0x004E_4942, &b"abc\0"[..])] };
    for json in [r#"{"buffers": [{"byteLength": 3, "uri": "data:,xyz"}]}"#, "{}"] {
        let document = Document::parse(json.as_bytes()).unwrap();
        container::save(&source, document, Kind::Gltf, None, &out).unwrap();
        assert_eq!(parts(&out).0, serde_json::from_str::<Value>(json).unwrap());
        assert!(!folder.path().join("out.bin").exists());
    }
}
