//! Pictures out of the window: files with what was chosen about them, and the clipboard.

use std::collections::BTreeMap;
use std::path::Path;

use clerestory::app::App;
use clerestory::compare::read_exr;
use clerestory::export::layers::LayerSet;
use clerestory::export::options::Region;
use clerestory::session::{BakeState, Source};
use clerestory_transport::bake::BakeConfig;
use eframe::egui::{Event, Key, Modifiers, OutputCommand, vec2};
use egui_kittest::kittest::{NodeT, Queryable};
use exr::meta::MetaData;
use exr::meta::attribute::SampleType;
use exr::prelude::{Compression, ReadChannels, ReadLayers};
use serde_json::json;

use crate::desk::{
    Window, ask_for, baked, baked_larger, click, drag, open_with, quick, room, save_as, wait, wait_until,
};

#[test]
fn an_exr_gets_the_layers_and_the_part_that_were_chosen() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.png");
    let mut window = baked_larger();
    ask_for(&mut window, "Export…", &path);
    click(&mut window, "OpenEXR");
    let hint = window.get_by_label_contains("exposure and tone are not applied").rect();
    let copy = window.get_by_label("Copy picture").rect();
    assert!(!hint.intersects(copy), "what the file is can be read whole: {hint} {copy}");
    click(&mut window, "Half");
    click(&mut window, "Layers");
    click(&mut window, "By light");
    assert_eq!(window.state().export_options().layers, LayerSet::Lights);
    assert!(window.get_by_label("Illuminance layer").accesskit_node().is_disabled(), "none was baked");
    click(&mut window, "Region");
    window.get_by_label("Region left").set_value_accesskit(60.0);
    window.run_steps(3);
    window.get_by_label_contains("does not lie within the picture of 64 × 48");
    assert!(window.get_by_label("Save").accesskit_node().is_disabled());
    window.get_by_label("Region width").set_value_accesskit(4.0);
    window.run_steps(3);
    click(&mut window, "Save");
    let path = path.with_extension("exr");
    wait(&mut window, |_| path.exists());
    let header = MetaData::read_from_file(&path, true).unwrap().headers.remove(0);
    let names: Vec<String> = header.channels.list.iter().map(|channel| channel.name.to_string()).collect();
    assert_eq!(names, ["B", "G", "R", "lamp.B", "lamp.G", "lamp.R", "panel.B", "panel.G", "panel.R"]);
    assert_eq!(header.own_attributes.layer_position.0, 60);
    assert_eq!(header.shared_attributes.display_window.size.0, 64);
    let part = read_exr(&path).unwrap();
    assert_eq!((part.width, part.height), (4, 48));
    click(&mut window, "Export…");
    let suggested = window.get_by_label("Path").accesskit_node().value();
    assert_eq!(suggested.as_deref(), Some("room.exr"), "the kind that was written last");
}

#[test]
fn a_kind_that_is_chosen_without_a_name_takes_the_one_that_was_suggested() {
    let mut window = baked();
    click(&mut window, "Export…");
    for (kind, name) in [("OpenEXR", "room.exr"), ("PNG", "room.png")] {
        window.get_by_label("Path").set_text_value_accesskit("");
        window.run_steps(3);
        click(&mut window, kind);
        let path = window.get_by_label("Path").accesskit_node().value();
        assert_eq!(path.as_deref(), Some(name));
    }
}

#[test]
fn with_large_letters_the_question_about_a_picture_fits_the_window() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = baked();
    ask_for(&mut window, "Export…", &folder.path().join("room.exr"));
    // The least window, with letters of twice the size.
    window.set_size(vec2(900.0, 600.0) / 2.0);
    window.run_steps(6);
    let whole = window.ctx.content_rect();
    for label in ["Path", "Browse…", "Save", "Cancel"] {
        let place = window.get_by_label(label).rect();
        assert!(whole.contains_rect(place), "{label} at {place} of {whole}");
    }
}

#[test]
fn an_exr_is_compressed_as_it_was_chosen() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = baked();
    let mut written = |choice: &str, name: &str| {
        let path = folder.path().join(name);
        ask_for(&mut window, "Export…", &path);
        click(&mut window, "Compression");
        click(&mut window, choice);
        click(&mut window, "Float");
        click(&mut window, "Save");
        wait(&mut window, |_| path.exists());
        let header = MetaData::read_from_file(&path, true).unwrap().headers.remove(0);
        (header.compression, header.channels.list[0].sample_type)
    };
    assert_eq!(written("PIZ", "piz.exr"), (Compression::PIZ, SampleType::F32));
    let (compression, samples) = written("DWAA (lossy)", "dwaa.exr");
    assert!(matches!(compression, Compression::DWAA(_)), "{compression:?}");
    assert_eq!(samples, SampleType::F16, "it knows halves alone");
}

/// Numbers of an EXR by the names of its channels.
fn channels(path: &std::path::Path) -> BTreeMap<String, Vec<f32>> {
    let image = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer();
    let image = image.all_attributes().from_file(path).unwrap();
    let channels = image.layer_data.channel_data.list.into_iter();
    channels.map(|channel| (channel.name.to_string(), channel.sample_data.values_as_f32().collect())).collect()
}

#[test]
fn each_lamp_that_was_added_has_a_layer_of_its_own_and_all_add_up_to_the_picture() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.exr");
    let source = Source::Bytes { name: "room.gltf".into(), bytes: room() };
    // With patches, so that lamps light the room by way of its surfaces, too.
    let mut window = open_with(source, BakeConfig { patches: 64, ..quick() }, None);
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
    for kind in ["Point", "Sphere"] {
        click(&mut window, "Add lamp");
        click(&mut window, kind);
        wait(&mut window, App::is_settled);
    }
    ask_for(&mut window, "Export…", &path);
    click(&mut window, "Layers");
    click(&mut window, "By light");
    click(&mut window, "Save");
    wait(&mut window, |_| path.exists());
    let channels = channels(&path);
    let names = ["Point lamp 1", "Sphere lamp 1", "lamp", "panel"];
    let found: Vec<&str> = channels.keys().filter_map(|name| name.strip_suffix(".G")).collect();
    assert_eq!(found, names);
    let lights = names.map(|name| &channels[&format!("{name}.G")]);
    for (light, name) in lights.iter().zip(names) {
        assert!(light.iter().any(|g| *g > 1e-3), "{name} lights something");
    }
    let whole = &channels["G"];
    let brightest = whole.iter().fold(0.0f32, |most, g| most.max(*g));
    for (idx, green) in whole.iter().enumerate() {
        let sum: f32 = lights.iter().map(|light| light[idx]).sum();
        assert!((sum - green).abs() < 1e-4 * brightest, "{sum} {green} at {idx}");
    }
}

#[test]
fn a_png_of_a_smaller_size_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.png");
    let mut window = baked_larger();
    ask_for(&mut window, "Export…", &path);
    click(&mut window, "16 bits");
    window.get_by_label("Width of the file").set_value_accesskit(32.0);
    window.run_steps(3);
    click(&mut window, "Save");
    wait(&mut window, |_| path.exists());
    let picture = image::open(&path).unwrap();
    assert_eq!((picture.width(), picture.height(), picture.color()), (32, 24, image::ColorType::Rgb16));
    window.run_steps(4);
    window.get_by_label_contains("Saved");
    assert!(window.query_by_label_contains("Writing").is_none(), "it is over");
}

#[test]
fn a_name_alone_goes_beside_the_scene_and_the_dialog_says_where() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("room.gltf");
    std::fs::write(&scene, room()).unwrap();
    let mut window = open_with(Source::File(scene), quick(), None);
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
    click(&mut window, "Export…");
    window.get_by_label(&format!("In {}", folder.path().display()));
    click(&mut window, "Save");
    wait(&mut window, |_| folder.path().join("room.png").exists());
    click(&mut window, "Export…");
    assert_eq!(window.get_by_label("Path").accesskit_node().value().as_deref(), Some("room-2.png"), "it replaces none");
    window.get_by_label("Path").set_text_value_accesskit(&folder.path().join("b.png").display().to_string());
    window.run_steps(3);
    assert!(window.query_by_label(&format!("In {}", folder.path().display())).is_none(), "the path tells it");
}

#[test]
fn a_file_that_is_there_is_not_replaced_before_somebody_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let [picture, look] = ["a.png", "other.look"].map(|name| folder.path().join(name));
    let mut window = baked();
    let holds = |path: &Path, bytes: &[u8]| std::fs::read(path).is_ok_and(|now| now == bytes);
    for (label, path) in [("Export…", &picture), ("Save look…", &look)] {
        std::fs::write(path, b"precious").unwrap();
        // The ending is added to what is typed.
        ask_for(&mut window, label, &path.with_extension(if label == "Export…" { "" } else { "look" }));
        window.get_by_label("A file of this name is there; saving asks whether to replace it");
        click(&mut window, "Save");
        window.get_by_label("Replace the file?");
        click(&mut window, "Choose another name");
        assert!(window.query_by_label("Replace the file?").is_none() && holds(path, b"precious"));
        window.get_by_label("Path").focus();
        window.run_steps(2);
        window.key_press(Key::Enter);
        window.run_steps(4);
        window.get_by_label("Replace the file?");
        // Enter keeps the file, too.
        window.key_press(Key::Enter);
        window.run_steps(4);
        assert!(window.query_by_label("Replace the file?").is_none() && holds(path, b"precious"));
        click(&mut window, "Save");
        click(&mut window, "Replace");
        wait(&mut window, |_| !holds(path, b"precious"));
        window.run_steps(4);
        assert!(window.query_by_label("Path").is_none());
    }
    // The look's own file is its own.
    click(&mut window, "Mute lamp");
    window.key_press_modifiers(Modifiers::COMMAND | Modifiers::SHIFT, Key::S);
    window.run_steps(3);
    click(&mut window, "Save");
    assert!(window.query_by_label("Path").is_none() && std::fs::read_to_string(&look).unwrap().contains("muted"));
}

#[test]
fn a_place_that_cannot_be_had_is_told_in_the_dialog_and_what_was_typed_stays() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("renders/a.png");
    let mut window = baked();
    save_as(&mut window, "Export…", &path);
    window.get_by_label_contains("renders does not exist; create it first");
    assert_eq!(window.get_by_label("Path").accesskit_node().value().unwrap(), path.display().to_string());
    std::fs::create_dir(folder.path().join("renders")).unwrap();
    click(&mut window, "Save");
    wait(&mut window, |_| path.exists());
    assert!(window.query_by_label("Path").is_none());
    ask_for(&mut window, "Open look…", &folder.path().join("none.look"));
    click(&mut window, "Open");
    window.get_by_label_contains("none.look; check the path");
    window.get_by_label("Path");
}

#[test]
fn pictures_that_are_black_although_lights_are_on_are_told_whatever_they_are_written_to() {
    let folder = tempfile::tempdir().unwrap();
    let mut gltf: serde_json::Value = serde_json::from_slice(&room()).unwrap();
    // The lamp hangs outside of the room.
    gltf["nodes"][1]["translation"] = json!([9, 9, 9]);
    let source = Source::Bytes { name: "room.gltf".into(), bytes: serde_json::to_vec(&gltf).unwrap() };
    let mut window = open_with(source, quick(), None);
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
    click(&mut window, "Mute panel");
    click(&mut window, "Mute lamp");
    save_as(&mut window, "Export…", &folder.path().join("off.png"));
    wait_until(&mut window, |window| window.query_by_label_contains("Saved").is_some());
    assert!(window.query_by_label_contains("is black").is_none(), "without a light nothing else was to be expected");
    click(&mut window, "Mute lamp");
    click(&mut window, "Keep look");
    click(&mut window, "Timeline");
    click(&mut window, "Add key");
    click(&mut window, "Look");
    let asked = [
        ("Export…", "a.png", "the picture is black: no light reaches what the camera sees"),
        ("Export frames…", "f_#.exr", "frame 0 is black: no light"),
        ("Contact sheet…", "sheet.png", "the picture of Look is black: no light"),
    ];
    for (label, name, words) in asked {
        save_as(&mut window, label, &folder.path().join(name));
        wait_until(&mut window, |window| window.query_by_label_contains(words).is_some());
    }
}

#[test]
fn names_with_dots_and_signs_are_taken_as_they_are_and_frames_get_their_ending() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("room#1.gltf"), room()).unwrap();
    let mut window = open_with(Source::File(at("room#1.gltf")), quick(), None);
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
    let typed = |window: &Window| window.get_by_label("Path").accesskit_node().value().unwrap();
    let type_path = |window: &mut Window, path: &str| {
        window.get_by_label("Path").set_text_value_accesskit(path);
        window.run_steps(3);
    };
    let can_save = |window: &Window| !window.get_by_label("Save").accesskit_node().is_disabled();
    click(&mut window, "Keep look");
    click(&mut window, "Timeline");
    click(&mut window, "Add key");
    click(&mut window, "Look");
    window.get_by_label("Frames per second").set_value_accesskit(23.976);
    window.run_steps(3);
    click(&mut window, "Export frames…");
    window.get_by_label("1 at 23.976 fps");
    assert_eq!((typed(&window).as_str(), can_save(&window)), ("room-1_####.png", true), "one place for digits");
    std::fs::write(at("f_07.png"), b"precious").unwrap();
    type_path(&mut window, "f_##");
    window.get_by_label("Files of these names are there; saving asks whether to replace them");
    type_path(&mut window, "v1.2_##");
    window.get_by_label_contains("end the name in .exr or .png");
    assert!(!can_save(&window));
    click(&mut window, "OpenEXR");
    assert_eq!((typed(&window).as_str(), can_save(&window)), ("v1.2_##.exr", true));
    click(&mut window, "PNG");
    assert_eq!(typed(&window), "v1.2_##.png");
    type_path(&mut window, "g_##");
    click(&mut window, "Save");
    wait(&mut window, |app| app.session().frames().is_none() && at("g_00.png").exists());

    for (label, number) in [("Frames per second", 240.0), ("Time of the key", 86_400.0)] {
        window.get_by_label(label).set_value_accesskit(number);
        window.run_steps(3);
    }
    click(&mut window, "Export frames…");
    window.get_by_label_contains("20736001 frames are more than the 1000000 that a sequence may have");
    assert!(!can_save(&window));
    click(&mut window, "Cancel");

    std::fs::write(at("room#2.png"), b"precious").unwrap();
    ask_for(&mut window, "Export…", &at("room#2"));
    click(&mut window, "Save");
    window.get_by_label("room#2.png is there. Saving replaces what it holds");
}

#[test]
fn a_region_is_taken_from_what_is_marked_or_in_sight() {
    let mut window = baked_larger();
    let region = |window: &Window| window.state().export_options().region;
    click(&mut window, "Export…");
    for label in ["As marked", "As shown"] {
        assert!(window.get_by_label(label).accesskit_node().is_disabled(), "{label}: nothing is");
    }
    click(&mut window, "Cancel");
    click(&mut window, "Measure");
    click(&mut window, "Rectangle");
    let area = window.get_by_label("Picture").rect();
    let scale = ((area.width() - 28.0) / 64.0).min((area.height() - 28.0) / 48.0);
    let at = |x: f32, y: f32| area.center() + vec2(x - 32.0, y - 24.0) * scale;
    drag(&mut window, at(16.1, 8.1), at(47.9, 39.9));
    click(&mut window, "Export…");
    click(&mut window, "As marked");
    assert_eq!(region(&window), Some(Region { x: 16, y: 8, width: 32, height: 32 }));
    window.get_by_label("Width of the file").set_value_accesskit(32.0);
    window.run_steps(3);
    click(&mut window, "As marked");
    assert_eq!(region(&window), Some(Region { x: 8, y: 4, width: 16, height: 16 }), "in pixels of the file");
    click(&mut window, "Cancel");

    // A region that fills the picture's area is what is in sight, and what is above and below.
    window.key_down(Key::Z);
    drag(&mut window, at(20.0, 12.0), at(44.0, 30.0));
    window.key_up(Key::Z);
    window.run_steps(3);
    click(&mut window, "Export…");
    click(&mut window, "As shown");
    let shown = region(&window).unwrap();
    let twice_the_middle = [2 * shown.x + shown.width, 2 * shown.y + shown.height];
    assert!(twice_the_middle[0].abs_diff(32) <= 1 && twice_the_middle[1].abs_diff(21) <= 1, "{shown:?}");
    assert!((12..=18).contains(&shown.width) && (9..=18).contains(&shown.height), "{shown:?}");
    assert!(!window.get_by_label("Save").accesskit_node().is_disabled());
}

#[test]
fn the_picture_is_copied_as_it_is_seen() {
    let mut window = baked_larger();
    let copied = |window: &mut Window| {
        for _ in 0..2000 {
            window.step();
            let commands = &window.output().platform_output.commands;
            let picture = commands.iter().find_map(|command| match command {
                OutputCommand::CopyImage(picture) => Some(picture.clone()),
                _ => None,
            });
            if let Some(picture) = picture {
                return picture;
            }
            std::thread::sleep(std::time::Duration::from_millis(2));
        }
        panic!("nothing was copied");
    };
    window.event(Event::Copy);
    let lit = copied(&mut window);
    assert_eq!(lit.size, [64, 48]);
    assert!(lit.pixels.iter().any(|pixel| pixel.r() > 60));
    window.get_by_label_contains("Copied the picture, 64 × 48");
    click(&mut window, "Auto");
    click(&mut window, "Mute lamp");
    click(&mut window, "Mute panel");
    window.event(Event::Copy);
    assert!(copied(&mut window).pixels.iter().all(|pixel| pixel.r() == 0), "no light, and exposure stays");
}

/// Runs a command line in this process; what it answers, as JSON.
#[track_caller]
fn answer(line: &[&str]) -> serde_json::Value {
    let (mut stdout, mut stderr) = (Vec::new(), Vec::new());
    let line = ["clerestory"].iter().chain(line).chain(&["--json"]);
    let code = clerestory::cli::run(line, &mut stdout, &mut stderr);
    assert_eq!(code, std::process::ExitCode::SUCCESS, "{}", String::from_utf8_lossy(&stderr));
    serde_json::from_slice(&stdout).unwrap()
}

#[test]
fn the_command_line_writes_groups_parts_and_a_sheet_of_looks() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    std::fs::write(at("room.gltf"), room()).unwrap();
    let (scene, bake) = (at("room.gltf"), at("room.transport"));
    let size = ["--size", "64x48", "--spp", "4", "--tolerance", "20"];
    let estimate = answer(&[&["bake", &scene, "--estimate"], &size[..]].concat());
    answer(&[&["bake", &scene, "-o", &bake, "--memory", "64GB"], &size[..]].concat());
    let (told, is) = (estimate["file_bytes"].as_f64().unwrap(), std::fs::metadata(&bake).unwrap().len() as f64);
    assert!((told - is).abs() < 0.1 * is, "{told} {is}");

    let exr = at("part.exr");
    let line = ["relight", &bake, "-o", &exr, "--layers", "groups", "--bits", "16", "--compression", "piz"];
    let told = answer(&[&line[..], &["--width", "32", "--region", "8,4,16,12"]].concat());
    assert_eq!((&told["width"], &told["height"], &told["layers"]), (&16.into(), &12.into(), &2.into()));
    let header = MetaData::read_from_file(&exr, true).unwrap().headers.remove(0);
    let names: Vec<String> = header.channels.list.iter().map(|channel| channel.name.to_string()).collect();
    assert_eq!(names, ["B", "G", "R", "lamps.B", "lamps.G", "lamps.R", "panels.B", "panels.G", "panels.R"]);
    assert_eq!((header.layer_size.0, header.shared_attributes.display_window.size.0), (16, 32));
    let colors = header.shared_attributes.chromaticities.expect("primaries are told");
    assert_eq!((colors.red.0, colors.green.1, colors.white.0), (0.64, 0.6, 0.3127));
    let interop = exr::prelude::AttributeValue::Text("lin_rec709_scene".into());
    let told = &header.own_attributes.other;
    assert!(told.values().any(|value| *value == interop), "the space by its name");

    let shots = json!({"clerestory": 1, "looks": [{"name": "A"}], "timeline": {"keys": [{"time": 0, "look": "A"}]}});
    std::fs::write(at("shots.look"), shots.to_string()).unwrap();
    let (frames, shots) = (at("frame_#.png"), at("shots.look"));
    let line = ["relight", &bake, "--look", &shots, "-o", &frames, "--width", "32", "--region", "8,4,16,12"];
    let told = answer(&line);
    assert_eq!((&told["frames"], &told["width"], &told["height"]), (&1.into(), &16.into(), &12.into()), "{told}");
    assert_eq!(image::image_dimensions(at("frame_0.png")).unwrap(), (16, 12));

    for (name, intensity) in [("dim", 0.2), ("bright", 3.0), ("as it is", 1.0)] {
        let look = format!(r#"{{"clerestory": 1, "lights": {{"lamp": {{"intensity": {intensity}}}}}}}"#);
        std::fs::write(at(&format!("{name}.look")), look).unwrap();
    }
    let looks = ["dim", "bright", "as it is"].map(|name| at(&format!("{name}.look")));
    let sheet = at("looks.png");
    let line = ["relight", &bake, "-o", &sheet, "--contact-sheet", &looks[0], &looks[1], &looks[2]];
    let told = answer(&line);
    assert_eq!(told["looks"][2]["name"], "as it is");
    let sheet = image::open(&sheet).unwrap();
    assert!(sheet.width() > 2 * 64 && sheet.width() < 3 * 64, "two across: {}", sheet.width());
}

#[test]
fn the_size_that_is_told_is_that_of_the_file_with_its_legend() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    std::fs::write(at("room.gltf"), room()).unwrap();
    std::fs::write(at("a.look"), r#"{"clerestory": 1, "display": {"false_color": {}}}"#).unwrap();
    let (scene, look, png) = (at("room.gltf"), at("a.look"), at("a.png"));
    for command in ["trace", "render"] {
        let told = answer(&[command, &scene, "--look", &look, "-o", &png, "--size", "32x24", "--spp", "2"]);
        let (width, height) = image::image_dimensions(&png).unwrap();
        assert!(width > 32 && height == 48, "{width} × {height}");
        assert_eq!([&told["width"], &told["height"]], [&json!(width), &json!(height)], "{command}");
    }
}

#[test]
fn the_command_line_bakes_the_panels_that_a_look_makes() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let mut gltf: serde_json::Value = serde_json::from_slice(&room()).unwrap();
    for node in gltf["nodes"].as_array_mut().unwrap() {
        node.as_object_mut().unwrap().remove("extras");
    }
    std::fs::write(at("room.gltf"), gltf.to_string()).unwrap();
    let spots = json!({ "panel": [{ "position": [0.5, 0.5], "radius": 0.2 }] });
    let choice = json!({ "panels": { "panel": 6, "gone": 8 }, "units": "unitless" });
    std::fs::write(at("a.look"), json!({ "clerestory": 1, "panels": spots, "scene": choice }).to_string()).unwrap();
    let (scene, look) = (at("room.gltf"), at("a.look"));
    let size = ["--size", "16x12", "--spp", "2"];
    let columns = |told: &serde_json::Value| told["columns"].as_u64();
    let told = |told: &serde_json::Value| told["warnings"].to_string();
    let plain = answer(&[&["bake", &scene, "-o", &at("plain.transport")], &size[..]].concat());
    let made = answer(&[&["bake", &scene, "--look", &look, "-o", &at("made.transport")], &size[..]].concat());
    assert_eq!(columns(&made), columns(&plain).map(|n| n + 35), "a rectangle is now 6 × 6 texels");
    assert!(told(&made).contains("`gone` a panel") && !told(&made).contains("not baked"), "{made}");
    // What is typed wins over the look, and lamps are counted as it says.
    let typed = ["bake", &scene, "--look", &look, "--panel", "panel=4", "-o", &at("typed.transport")];
    assert_eq!(columns(&answer(&[&typed[..], &size[..]].concat())), columns(&plain).map(|n| n + 15));
    let lit = |transport: &str| {
        answer(&["relight", &at(transport), "-o", &at("a.exr")]);
        let picture = read_exr(at("a.exr").as_ref()).unwrap();
        picture.pixels.iter().map(|rgb| rgb[1]).sum::<f32>()
    };
    assert!(lit("made.transport") > 100.0 * lit("plain.transport"), "watts are 683 times as much");
    for command in ["render", "trace"] {
        let out = at("b.png");
        let all = answer(&[&[command, &scene, "--look", &look, "-o", &out], &size[..]].concat());
        assert!(told(&all).contains("`gone`") && !told(&all).contains("which is no panel"), "{command}: {all}");
        assert!(!told(&all).contains("not baked"), "{command}: {all}");
    }
    let relit = answer(&["relight", &at("plain.transport"), "--look", &look, "-o", &at("a.exr")]);
    assert!(told(&relit).contains("a panel of 6 × 6 texels, which was not baked"), "{relit}");
}

#[test]
fn the_command_line_bakes_the_sky_in_the_patches_of_a_look() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    std::fs::write(at("room.gltf"), room()).unwrap();
    let look = json!({ "clerestory": 1, "sky": { "file": "uniform" }, "scene": { "sky_patches": 577 } });
    std::fs::write(at("a.look"), look.to_string()).unwrap();
    let (scene, look) = (at("room.gltf"), at("a.look"));
    let columns = |command: &str, out: &str, more: &[&str]| {
        let line = [command, &scene, "--look", &look, "-o", &at(out), "--size", "16x12", "--spp", "1"];
        answer(&[&line, more].concat())["columns"].as_u64().unwrap()
    };
    let few = columns("bake", "few.transport", &["--sky-patches", "145"]);
    assert_eq!(columns("bake", "a.transport", &[]), few + 577 - 145);
    assert_eq!(columns("render", "a.png", &[]), few + 577 - 145);
}

#[test]
fn a_scene_is_written_with_its_lamps_as_its_look_counts_them() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let [scene, look, out] = [at("room.gltf"), at("a.look"), at("lit.gltf")];
    std::fs::write(&scene, room()).unwrap();
    let written = |document: &serde_json::Value, more: &[&str]| {
        std::fs::write(&look, document.to_string()).unwrap();
        answer(&[&["export-gltf", &scene, "--look", &look, "-o", &out], more].concat());
        std::fs::read_to_string(&out).unwrap()
    };
    let plain = json!({ "clerestory": 1 });
    let typed = written(&plain, &["--unitless"]);
    assert_eq!(written(&json!({ "clerestory": 1, "scene": { "units": "unitless" } }), &[]), typed);
    assert!(written(&plain, &[]) != typed);
}

#[test]
fn a_lamp_that_is_off_is_written_dark_and_comes_back_muted() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let [scene, out, exr] = [at("room.gltf"), at("night.gltf"), at("night.exr")];
    std::fs::write(&scene, room()).unwrap();
    std::fs::write(
        at("off.look"),
        r#"{"clerestory": 1, "lights": {"lamp": {"muted": true}, "panel": {"muted": true}}}"#,
    )
    .unwrap();
    std::fs::write(at("on.look"), r#"{"clerestory": 1}"#).unwrap();
    let told = answer(&["export-gltf", &scene, "--look", &at("off.look"), "-o", &out]);
    assert_eq!(told["warnings"], json!([]));
    let written: serde_json::Value = serde_json::from_slice(&std::fs::read(&out).unwrap()).unwrap();
    assert_eq!(written["extensions"]["KHR_lights_punctual"]["lights"][0]["intensity"], 0.0);
    assert_eq!(written["nodes"][1]["extras"]["clerestory"]["muted"]["lamp"]["strength"], 3.0);
    let lights = answer(&["info", &out])["light_details"].clone();
    assert_eq!([&lights[0]["muted"], &lights[1]["muted"]], [true, true], "{lights}");
    assert_eq!(answer(&["info", &scene])["light_details"][0]["muted"], false);
    let mut words = Vec::new();
    clerestory::cli::run(["clerestory", "info", &out], &mut words, &mut Vec::new());
    let words = String::from_utf8_lossy(&words).into_owned();
    assert!(words.contains("lamp (3 cd, off)"), "{words}");
    // The look of the file has both off, a look that says nothing about them both on.
    let seen = |look: &[&str]| {
        answer(&[&["trace", &out, "-o", &exr, "--size", "8x6", "--spp", "1"], look].concat());
        channels(exr.as_ref())["G"].iter().sum::<f32>()
    };
    assert_eq!(seen(&[]), 0.0);
    assert!(seen(&["--look", &at("on.look")]) > 0.0);
}

#[test]
fn a_bake_beyond_its_memory_is_refused_before_it_starts() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    std::fs::write(at("room.gltf"), room()).unwrap();
    let (mut stdout, mut stderr) = (Vec::new(), Vec::new());
    let line = ["clerestory", "bake", &at("room.gltf"), "-o", &at("a.transport"), "--size", "64x48", "--spp", "4"];
    let line = line.iter().chain(&["--memory", "1MB"]);
    let code = clerestory::cli::run(line, &mut stdout, &mut stderr);
    let said = String::from_utf8_lossy(&stderr);
    assert!(code != std::process::ExitCode::SUCCESS && said.contains("--memory allows"), "{said}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing was begun");
}

#[test]
fn a_part_that_is_none_of_the_picture_is_refused_before_anything_else_of_it() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    std::fs::write(at("room.gltf"), room()).unwrap();
    // A name that is taken is found out when the lamp is put into the scene, before the bake.
    let lamp = json!({ "key": "lamp", "type": "point", "position": [0, 0.2, 0], "strength": 40, "unit": "lm" });
    std::fs::write(at("a.look"), json!({ "clerestory": 1, "lamps": [lamp] }).to_string()).unwrap();
    let (scene, look, out) = (at("room.gltf"), at("a.look"), at("a.exr"));
    for (part, words) in [(["--region", "0,0,17,8"], "does not lie within"), (["--width", "17"], "bake it larger")] {
        let (mut stdout, mut stderr) = (Vec::new(), Vec::new());
        let line = ["clerestory", "render", &scene, "--look", &look, "-o", &out, "--size", "16x12", "--spp", "1"];
        let code = clerestory::cli::run(line.iter().chain(&part), &mut stdout, &mut stderr);
        let said = String::from_utf8_lossy(&stderr);
        assert!(code != std::process::ExitCode::SUCCESS && said.contains(words), "{said}");
    }
}

#[test]
fn a_typed_sky_that_gives_way_to_that_of_a_look_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    std::fs::write(at("room.gltf"), room()).unwrap();
    let is_told = |sky: serde_json::Value, more: &[&str]| {
        std::fs::write(at("a.look"), json!({ "clerestory": 1, "sky": sky }).to_string()).unwrap();
        let (scene, look, out) = (at("room.gltf"), at("a.look"), at("a.exr"));
        let line = ["trace", &scene, "--look", &look, "-o", &out, "--size", "8x6", "--spp", "1"];
        answer(&[&line[..], more].concat())["warnings"].to_string().contains("--sky is left out")
    };
    let typed = ["--sky", "uniform"];
    assert!(is_told(json!({ "file": "uniform" }), &typed));
    assert!(!is_told(json!({ "file": "uniform" }), &[]));
    assert!(!is_told(json!({ "intensity": 2 }), &typed), "it dims the typed one");
    for command in ["bake", "render"] {
        let (scene, out) = (at("room.gltf"), at(if command == "bake" { "a.transport" } else { "b.exr" }));
        let line = [command, &scene, "-o", &out, "--size", "8x6", "--spp", "1", "--sky-patches", "577"];
        assert!(answer(&line)["warnings"].to_string().contains("--sky-patches changes nothing"), "{command}");
        let under_one = answer(&[&line[..], &typed].concat())["warnings"].to_string();
        assert!(!under_one.contains("--sky-patches"), "{command}: {under_one}");
    }
}
