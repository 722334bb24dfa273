//! Snapshots, moments, presets and frames from the command line.

#![expect(clippy::unwrap_used, reason = "a panic is how a test fails")]

use std::path::Path;
use std::process::{Command, Output, Stdio};

use clerestory::compare::read_exr;
use clerestory_relight::Radiance;

const LOOK: &str = r#"{"clerestory": 1,
  "looks": [
    {"name": "Day", "lights": {"lamp": {"intensity": 2}}},
    {"name": "Red night", "lights": {"lamp": {"intensity": 0.5, "color": [1, 0.1, 0]}}, "display": {"exposure_ev": 1}}
  ],
  "on": "Day",
  "timeline": {"fps": 4, "keys": [{"time": 0, "look": "Day", "ease": "linear"}, {"time": 1, "look": "Red night"}]}
}"#;

/// A folder with a baked room and a look of two snapshots.
fn desk() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("room.gltf"), include_str!("room.gltf")).unwrap();
    std::fs::write(folder.path().join("shots.look"), LOOK).unwrap();
    run(folder.path(), &["bake", "room.gltf", "-o", "room.transport", "--size", "32x24", "--spp", "8"]);
    folder
}

fn output(folder: &Path, args: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_clerestory"));
    command.current_dir(folder).stdin(Stdio::null()).args(args).output().unwrap()
}

#[track_caller]
fn run(folder: &Path, args: &[&str]) -> String {
    let output = output(folder, args);
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

#[track_caller]
fn refused(folder: &Path, args: &[&str], why: &str) {
    let output = output(folder, args);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && said.contains(why), "{args:?}: {said}");
}

fn relight(folder: &Path, args: &[&str], name: &str) -> Radiance {
    run(folder, &[&["relight", "room.transport", "--device", "cpu", "-o", name], args].concat());
    read_exr(&folder.join(name)).unwrap()
}

#[test]
fn frames_go_from_one_look_to_the_other() {
    let folder = desk();
    let folder = folder.path();
    let [day, night] = [("day.exr", "Day"), ("night.exr", "Red night")]
        .map(|(file, name)| relight(folder, &["--look", "shots.look", "--name", name], file));
    assert_ne!(day, night);
    let answer = run(folder, &["relight", "room.transport", "--look", "shots.look", "-o", "f_###.exr", "--json"]);
    let answer: serde_json::Value = serde_json::from_str(&answer).unwrap();
    assert_eq!((answer["frames"].as_u64(), answer["fps"].as_f64()), (Some(5), Some(4.0)), "{answer}");
    let frame = |n: u32| read_exr(&folder.join(format!("f_{n:03}.exr"))).unwrap();
    assert_eq!((frame(0), frame(4)), (day.clone(), night.clone()));
    // Light is linear: half way it is the mean of both, to the rounding of 32-bit floats.
    let middle = frame(2);
    for (pixel, (a, b)) in middle.pixels.iter().zip(day.pixels.iter().zip(&night.pixels)) {
        for c in 0..3 {
            let mean = 0.5 * (a[c] + b[c]);
            assert!((pixel[c] - mean).abs() <= 1e-4 * mean.max(1e-3), "{pixel:?} is not the mean of {a:?} and {b:?}");
        }
    }
    assert_eq!(relight(folder, &["--look", "shots.look", "--at", "0.5"], "half.exr"), middle);
    // Part of it, at another rate.
    run(
        folder,
        &["relight", "room.transport", "--look", "shots.look", "--frames", "3..4", "--fps", "8", "-o", "g_#.png"],
    );
    let names: Vec<bool> = (2..6).map(|n| folder.join(format!("g_{n}.png")).exists()).collect();
    assert_eq!(names, [false, true, true, false]);
}

#[test]
fn frames_ask_for_no_scene_for_lamps_that_no_key_shows() {
    let folder = desk();
    let folder = folder.path();
    let mut look: serde_json::Value = serde_json::from_str(LOOK).unwrap();
    let lamp = serde_json::json!({"key": "bulb", "type": "point", "position": [0, 0.2, 0], "strength": 40});
    look["looks"].as_array_mut().unwrap().push(serde_json::json!({"name": "Party", "lamps": [lamp]}));
    let frames = ["relight", "room.transport", "--device", "cpu", "--look", "party.look", "--frames", "0..1", "-o"];
    let frames = |name: &'static str| [&frames[..], &[name]].concat();
    std::fs::write(folder.join("party.look"), look.to_string()).unwrap();
    run(folder, &frames("a_#.png"));
    look["timeline"]["keys"][1]["look"] = "Party".into();
    std::fs::write(folder.join("party.look"), look.to_string()).unwrap();
    refused(folder, &frames("b_#.png"), "name the scene that was baked with --scene");
    let spot = serde_json::json!({"type": "spot", "aim": [0, 0.2, 0], "outer_deg": 30});
    let lamp = look["looks"].as_array_mut().unwrap().last_mut().unwrap()["lamps"][0].as_object_mut().unwrap();
    lamp.extend(spot.as_object().unwrap().clone());
    std::fs::write(folder.join("party.look"), look.to_string()).unwrap();
    let told = run(folder, &[frames("c_#.png"), vec!["--scene", "room.gltf", "--json"]].concat());
    assert!(told.contains("lamp `bulb` aims at itself"), "{told}");
}

#[test]
fn frames_name_panels_of_the_look_that_were_not_baked() {
    let folder = desk();
    let folder = folder.path();
    let mut look: serde_json::Value = serde_json::from_str(LOOK).unwrap();
    look["names"] = serde_json::json!({"lamp": "Bulb"});
    look["scene"] = serde_json::json!({"panels": {"lamp": 8}});
    std::fs::write(folder.join("panel.look"), look.to_string()).unwrap();
    let frames = ["relight", "room.transport", "--look", "panel.look", "--frames", "0..0", "-o", "f_#.exr", "--json"];
    let told = run(folder, &frames);
    assert!(told.contains("the look makes `Bulb` a panel of 8 × 8 texels, which was not baked"), "{told}");
}

#[test]
fn frames_do_not_take_the_place_of_what_is_read() {
    let folder = desk();
    let folder = folder.path();
    let to = |output: &'static str| vec!["relight", "room.transport", "--look", "shots.look", "-o", output];
    std::fs::hard_link(folder.join("room.transport"), folder.join("f_2.exr")).unwrap();
    let before = std::fs::read(folder.join("room.transport")).unwrap();
    refused(folder, &to("f_#.exr"), "would overwrite the transport");
    assert!(std::fs::read(folder.join("room.transport")).unwrap() == before && !folder.join("f_0.exr").exists());
    refused(folder, &to("none/f_#.exr"), "does not exist");
    refused(folder, &[to("f.exr"), vec!["--frames", "0..1"]].concat(), "write # for the digits");
    refused(folder, &[to("g_#.exr"), vec!["--name", "Day"]].concat(), "leave them out to write frames");
    refused(folder, &[to("g_#.exr"), vec!["--lamp-samples", "8"]].concat(), "--lamp-samples is for one picture");
    refused(folder, &["relight", "room.transport", "-o", "take#2.png"], "# in take#2.png asks for the frames");
    refused(folder, &[to("g.exr"), vec!["--name", "Noon"]].concat(), "it has `Day`, `Red night`");
    refused(folder, &["relight", "room.transport", "-o", "g.exr", "--preset", "noon"], "dusk");
}

#[test]
fn presets_light_any_scene_and_info_lists_the_looks() {
    let folder = desk();
    let folder = folder.path();
    let mean = |picture: &Radiance, c: usize| picture.pixels.iter().map(|rgb| f64::from(rgb[c])).sum::<f64>();
    let warmth = ["day", "dusk", "night", "exhibition"].map(|preset| {
        let picture = relight(folder, &["--preset", preset], &format!("{preset}.exr"));
        mean(&picture, 0) / mean(&picture, 2)
    });
    assert!(warmth[0] < warmth[1] && warmth[1] < warmth[2], "{warmth:?}");
    let told = run(folder, &["info", "shots.look"]);
    assert!(told.contains("Day, Red night") && told.contains("2 keys over 1 s, 5 frames at 4 fps"), "{told}");
}

#[test]
fn a_rendered_picture_tells_the_lamps_that_light_it() {
    let folder = desk();
    let folder = folder.path();
    let look = r#"{"clerestory": 1, "lamps": [{"key": "my bulb", "type": "point", "position": [0, 0.2, 0], "strength": 40, "unit": "lm"}]}"#;
    std::fs::write(folder.join("bulb.look"), look).unwrap();
    let render = ["render", "room.gltf", "--look", "bulb.look", "--size", "16x12", "--spp", "2", "-o", "bulb.exr"];
    run(folder, &[&render[..], &["--device", "cpu"]].concat());
    let file = std::fs::read(folder.join("bulb.exr")).unwrap();
    assert!(file.windows(7).any(|bytes| bytes == b"my bulb"), "its attribute holds the whole look");
}
