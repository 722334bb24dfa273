//! glTF in, EXR out, through the command line in process.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clerestory::compare::read_exr;
use clerestory_transport::archive;
use clerestory_transport::camera::Film;
use clerestory_transport::import;
use serde_json::{Value, json};

use crate::support::{Mean, SceneFile, Shape, two_lamps_and_a_panel};

/// A folder of its own for every test, with a scene in it.
pub struct Desk(tempfile::TempDir);

/// What a command said.
pub struct Said {
    pub code: ExitCode,
    pub stdout: String,
    pub stderr: String,
}

impl Desk {
    pub fn new() -> Desk {
        let desk = Desk(tempfile::tempdir().unwrap());
        std::fs::write(desk.path("room.glb"), two_lamps_and_a_panel().glb()).unwrap();
        desk
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Runs a command line; words that name files of the desk (`@room.glb`, `lamp=@lamp.ies`) become their paths.
    pub fn run(&self, line: &str) -> Said {
        let words = line.split_whitespace().map(|word| match word.split_once('@') {
            Some((before, name)) => format!("{before}{}", self.path(name).display()).into(),
            None => word.into(),
        });
        let (mut stdout, mut stderr) = (Vec::new(), Vec::new());
        let args = std::iter::once("clerestory".into()).chain(words);
        let code = clerestory::cli::run::<std::ffi::OsString>(args, &mut stdout, &mut stderr);
        Said { code, stdout: String::from_utf8(stdout).unwrap(), stderr: String::from_utf8(stderr).unwrap() }
    }

    #[track_caller]
    pub fn json(&self, line: &str) -> Value {
        let said = self.run(&format!("{line} --json"));
        assert_eq!(said.code, ExitCode::SUCCESS, "{line}: {}", said.stderr);
        serde_json::from_str(&said.stdout).unwrap_or_else(|error| panic!("{line}: {error}: {}", said.stdout))
    }

    #[track_caller]
    pub fn fails(&self, line: &str, code: u8, words: &str) {
        let said = self.run(line);
        assert_eq!(said.code, ExitCode::from(code), "{line}: {}", said.stderr);
        assert!(said.stderr.contains(words), "{line} should say {words:?}, but says: {}", said.stderr);
        assert_eq!(said.stdout, "", "{line}");
    }

    fn names(&self) -> Vec<String> {
        let mut names: Vec<String> = std::fs::read_dir(self.0.path())
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }
}

const VIEW: &str = "--size 48x32 --spp 32";

#[test]
fn a_scene_becomes_a_picture_that_agrees_with_the_reference() {
    let desk = Desk::new();
    let look = json!({
        "clerestory": 1, "lights": { "warm": { "intensity": 0.5, "kelvin": 4000 } },
        "panels": { "panel": [{ "position": [0.3, 0.5], "radius": 0.25, "intensity": 2.0 }] },
    });
    std::fs::write(desk.path("a.look"), look.to_string()).unwrap();
    let bake = desk.json(&format!("bake @room.glb -o @room.transport {VIEW}"));
    assert!(bake["bake_secs"].as_f64().unwrap() >= 0.0 && bake["preview_secs"].as_f64().unwrap() > 0.0, "{bake}");
    assert_eq!(bake["device"], "cpu");
    let relit = desk.json("relight @room.transport --look @a.look -o @relit.exr --layers lights --device cpu");
    assert_eq!((&relit["device"], &relit["layers"]), (&json!("cpu"), &json!(3)));
    desk.json(&format!("trace @room.glb --look @a.look -o @traced.exr {VIEW} --spp 128").replace("--spp 32 ", ""));

    let compared = desk.json("compare @relit.exr @traced.exr");
    assert!(compared["relative_l2"].as_f64().unwrap() < 0.15, "{compared}");
    assert!(compared["psnr_db"].as_f64().unwrap() > 24.0, "{compared}");
    for bias in compared["mean_bias"].as_array().unwrap() {
        assert!(bias.as_f64().unwrap().abs() < 0.03, "{compared}");
    }
}

/// A map of 16 × 8 pixels in flat Radiance encoding: 2 nit where z is positive, else 1 nit.
fn half_and_half() -> Vec<u8> {
    let mut bytes = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8 +X 16\n".to_vec();
    (0..8 * 16).for_each(|i| bytes.extend([128, 128, 128, if i % 16 < 8 { 129 } else { 130 }]));
    bytes
}

#[test]
fn a_sky_is_baked_turned_and_told() {
    let desk = Desk::new();
    let top = Shape::quad(glam::Vec3::new(-1.0, 0.0, 1.0), glam::Vec3::X * 2.0, glam::Vec3::NEG_Z * 2.0);
    let table = SceneFile::default().surface("top", &top, SceneFile::lambert([0.8; 3], [0.0; 3]));
    let table = table.camera("front", glam::Vec3::new(0.0, 0.6, 2.0), 0.9);
    std::fs::write(desk.path("table.glb"), table.glb()).unwrap();
    std::fs::write(desk.path("day.hdr"), half_and_half()).unwrap();
    let look = |sky: Value| std::fs::write(desk.path("a.look"), json!({ "clerestory": 1, "sky": sky }).to_string());

    desk.json(&format!("bake @table.glb -o @a.transport --sky @day.hdr {VIEW}"));
    let info = desk.json("info @a.transport");
    assert!(info["sky"]["name"].as_str().unwrap().ends_with("day.hdr"), "{info}");
    assert_eq!((&info["lights"], &info["columns"]), (&json!(["sky"]), &json!(292)));
    // Relit from the archive alone, and by a file beside the look.
    for sky in [json!({ "rotation_deg": 120, "intensity": 2 }), json!({ "file": "day.hdr", "rotation_deg": -70 })] {
        look(sky).unwrap();
        desk.json("relight @a.transport --look @a.look -o @relit.exr --device cpu");
        desk.json(&format!("trace @table.glb --sky @day.hdr --look @a.look -o @traced.exr {VIEW}"));
        let compared = desk.json("compare @relit.exr @traced.exr");
        for bias in compared["mean_bias"].as_array().unwrap() {
            assert!(bias.as_f64().unwrap().abs() < 0.02, "{compared}");
        }
    }
    look(json!({ "sun": { "azimuth_deg": 200, "elevation_deg": 50 } })).unwrap();
    assert_eq!(desk.json("info @a.look")["sky"]["sun"]["azimuth_deg"], json!(200.0));
    let relit = desk.json("relight @a.transport --look @a.look -o @sunny.exr --device cpu");
    assert_eq!(relit["warnings"], json!([]));
    desk.json(&format!("render @table.glb --look @a.look -o @sunny.png --device cpu {VIEW}"));

    desk.json(&format!("bake @room.glb -o @room.transport {VIEW} --bounces 0"));
    let relit = desk.json("relight @room.transport --look @a.look -o @room.exr --device cpu");
    assert!(relit["warnings"][0].as_str().unwrap().contains("sky"), "{relit}");
    desk.fails("trace @table.glb --sky @none.hdr -o @x.exr", 1, "none.hdr");
    desk.fails("trace @table.glb --sky sun:1 -o @x.exr", 2, "sun:AZIMUTH,ELEVATION");
}

#[test]
fn info_says_what_is_in_scene_transport_and_look() {
    let desk = Desk::new();
    let scene = desk.json("info @room.glb");
    assert_eq!(scene["lights"], json!(["warm", "cool", "panel"]));
    assert_eq!((&scene["nodes"], &scene["cameras"], &scene["triangles"]), (&json!(6), &json!(1), &json!(26)));
    assert!(scene["unsupported"].as_array().unwrap().is_empty(), "{scene}");

    desk.json("bake @room.glb -o @room.transport --size 20x18 --spp 4");
    let transport = desk.json("info @room.transport");
    assert_eq!((&transport["pixels"], &transport["columns"]), (&json!(360), &json!(18)));
    assert_eq!(transport["dense_bytes"], json!(360 * 18 * 3 * 4));
    for name in ["blocks", "mean_rank", "max_rank", "bytes", "file_bytes", "ratio"] {
        assert!(transport[name].as_f64().unwrap() > 0.0, "{name} of {transport}");
    }
    for name in ["truncation", "sampling", "noise", "total"] {
        assert!(transport["error_db"][name].as_f64().is_some(), "{name} of {transport}");
    }
    assert!(transport["skipped"].is_object());

    std::fs::write(desk.path("a.look"), r#"{"clerestory": 1, "lights": {"warm": {"muted": true}}, "x": 1}"#).unwrap();
    let look = desk.json("info @a.look");
    assert_eq!(look["lights"]["warm"]["muted"], json!(true));
    assert!(look["warnings"][0].as_str().unwrap().contains("`x`"));
}

#[test]
fn render_is_bake_and_relight_in_one_go() {
    let desk = Desk::new();
    desk.json(&format!("bake @room.glb -o @room.transport {VIEW}"));
    desk.json("relight @room.transport -o @two.exr --device cpu");
    desk.json(&format!("render @room.glb -o @one.exr {VIEW} --device cpu"));
    assert_eq!(read_exr(&desk.path("one.exr")).unwrap(), read_exr(&desk.path("two.exr")).unwrap());
    let png = desk.json(&format!("render @room.glb -o @one.png {VIEW}"));
    assert!(png["exposure_ev"].as_f64().unwrap().is_finite());
    assert_eq!(image::open(desk.path("one.png")).unwrap().width(), 48);
}

#[test]
fn the_same_bake_gives_the_same_bytes() {
    let desk = Desk::new();
    for (name, threads) in [("a", 1), ("b", 2)] {
        desk.json(&format!("bake @room.glb -o @{name}.transport --size 40x24 --spp 8 --threads {threads}"));
    }
    desk.json("bake @room.glb -o @c.transport --size 40x24 --spp 8 --seed 1");
    let bytes = ["a", "b", "c"].map(|name| std::fs::read(desk.path(&format!("{name}.transport"))).unwrap());
    assert!(bytes[0] == bytes[1], "the number of threads shows in the file");
    assert!(bytes[0] != bytes[2], "the seed does nothing");
    assert_eq!(desk.names(), ["a.transport", "b.transport", "c.transport", "room.glb"]);
}

#[test]
fn how_a_bake_was_asked_for_stands_in_its_file() {
    let desk = Desk::new();
    let config = |rest: &str| {
        desk.json(&format!("bake @room.glb -o @a.transport --fresh --size 20x18 --spp 4 {rest}"));
        let transport = desk.json("info @a.transport");
        let config = &transport["config"];
        (transport["blocks"].clone(), ["denoise", "smooth", "block"].map(|name| config[name].clone()))
    };
    let usual = config("");
    assert_eq!(usual.1, [json!(true), Value::Null, Value::Null]);
    assert_eq!(config("--no-denoise").1, [json!(false), Value::Null, Value::Null]);
    assert_eq!(config("--exact").1, [json!(false), json!(false), Value::Null]);
    let (blocks, config) = config("--block 8");
    assert_eq!(config, [json!(true), Value::Null, json!(8)]);
    assert_eq!((usual.0.as_u64(), blocks.as_u64()), (Some(4), Some(9)));
}

/// The singular value decomposition of the samples as they are, beside what is baked by default: noise is taken out of that, the
/// samples are the same.
#[test]
fn the_yardstick_shows_the_picture_that_ours_shows() {
    let desk = Desk::new();
    for (name, how) in [("ours", ""), ("yardstick", "--method svd --exact")] {
        desk.json(&format!("bake @room.glb -o @{name}.transport --size 32x32 --spp 64 {how}"));
        desk.json(&format!("relight @{name}.transport -o @{name}.exr --device cpu"));
    }
    let config = &desk.json("info @yardstick.transport")["config"];
    let told = ["method", "denoise", "smooth"].map(|name| config[name].clone());
    assert_eq!(told, [json!("svd"), json!(false), json!(false)]);
    let compared = desk.json("compare @yardstick.exr @ours.exr");
    assert!(compared["relative_l2"].as_f64().unwrap() < 0.2, "{compared}");
    for bias in compared["mean_bias"].as_array().unwrap() {
        assert!(bias.as_f64().unwrap().abs() < 0.05, "{compared}");
    }
}

#[test]
fn compare_refuses_other_sizes_and_finds_no_difference_in_equals() {
    let desk = Desk::new();
    desk.json("trace @room.glb -o @small.exr --size 8x6 --spp 1");
    desk.json("trace @room.glb -o @large.exr --size 8x7 --spp 1");
    let same = desk.json("compare @small.exr @small.exr");
    assert_eq!((&same["relative_l2"], &same["psnr_db"]), (&json!(0.0), &Value::Null));
    desk.fails("compare @small.exr @large.exr", 1, "sizes differ");
    desk.json("bake @room.glb -o @a.transport --size 16x8 --spp 1");
    desk.json("relight @a.transport -o @left.exr --region 0,0,8,8");
    desk.json("relight @a.transport -o @right.exr --region 8,0,8,8");
    desk.fails("compare @left.exr @right.exr", 1, "different regions");
    assert_eq!(desk.json("compare @left.exr @left.exr")["relative_l2"], 0.0);
}

#[test]
fn a_picture_that_is_black_although_lights_are_on_is_told() {
    let desk = Desk::new();
    let walls = Shape::room(glam::Vec3::splat(2.0));
    let file = SceneFile::default().surface("room", &walls, SceneFile::lambert([0.5; 3], [0.0; 3]));
    let file = file.point_lamp("L", glam::Vec3::splat(9.0), [1.0; 3], 100.0).camera("eye", glam::Vec3::ZERO, 0.8);
    std::fs::write(desk.path("dark.glb"), file.glb()).unwrap();
    std::fs::write(desk.path("off.look"), r#"{"clerestory": 1, "lights": {"L": {"muted": true}}}"#).unwrap();
    let is_told = |line: &str| desk.json(line)["warnings"].to_string().contains("the picture is black");
    assert!(is_told("trace @dark.glb -o @a.exr --size 8x6 --spp 1"));
    assert!(is_told("bake @dark.glb -o @a.transport --size 8x6 --spp 2"));
    assert!(is_told("relight @a.transport -o @a.exr"));
    assert!(!is_told("relight @a.transport --look @off.look -o @a.exr"));
    assert!(!is_told("render @room.glb -o @a.exr --size 8x6 --spp 2"));
    let lamp = json!({ "key": "Desk", "type": "point", "position": [0, 0, 0], "strength": 800, "muted": true });
    let muted = json!({ "clerestory": 1, "lights": { "L": { "muted": true } }, "lamps": [lamp] });
    std::fs::write(desk.path("lamp.look"), muted.to_string()).unwrap();
    assert!(!is_told("relight @a.transport --look @lamp.look --scene @dark.glb -o @a.exr"), "the lamp is off, too");

    let looks = json!([{ "name": "On" }, { "name": "Off", "lights": { "L": { "muted": true } } }]);
    let keys = json!([{ "time": 0, "look": "Off", "ease": "hold" }, { "time": 1, "look": "On" }]);
    let shots = json!({ "clerestory": 1, "looks": looks, "timeline": { "fps": 2, "keys": keys } });
    std::fs::write(desk.path("shots.look"), shots.to_string()).unwrap();
    let told = |line: &str| desk.json(line)["warnings"].to_string();
    let of_frames = told("relight @a.transport --look @shots.look -o @f_#.png");
    assert!(of_frames.contains("frame 2 is black: no light reaches what the camera sees"), "{of_frames}");
    let of_frames = told("relight @a.transport --look @shots.look --frames 1..4 -o @f_#.png");
    assert!(of_frames.contains("3 of 4 frames, from frame 2 on, are black"), "{of_frames}");
    std::fs::write(desk.path("on.look"), r#"{"clerestory": 1}"#).unwrap();
    let of_sheet = told("relight @a.transport --contact-sheet @on.look @off.look -o @sheet#1.png");
    assert!(of_sheet.contains("the picture of `on` is black") && !of_sheet.contains("`off`"), "{of_sheet}");
    assert!(desk.path("sheet#1.png").exists(), "a sheet is one file, whatever it is called");
}

#[test]
fn a_transport_that_cannot_be_read_is_told_with_its_path() {
    let desk = Desk::new();
    std::fs::create_dir(desk.path("folder.transport")).unwrap();
    for name in ["none", "folder"] {
        for command in [
            "relight @X.transport -o @a.exr",
            "sensors @X.transport",
            "bake @room.glb -o @b.transport --reuse @X.transport",
        ] {
            desk.fails(&command.replace('X', name), 1, "check the path");
        }
    }
    desk.fails("info @none.transport", 1, "check the path");
}

#[test]
fn info_of_a_look_tells_its_lamps() {
    let desk = Desk::new();
    let lamp = r#"{"key": "Desk", "type": "spot", "position": [0, 2, 0], "aim": [0, 0, 0], "outer_deg": 30, "strength": 800, "muted": true}"#;
    std::fs::write(desk.path("a.look"), format!(r#"{{"clerestory": 1, "lamps": [{lamp}]}}"#)).unwrap();
    let words = desk.run("info @a.look").stdout;
    assert!(words.contains("\nlamps     Desk (spot, 800 lm, off)\n"), "{words}");
    std::fs::write(desk.path("sky"), "#?RGBE\n\n-Y 1 +X 2\n").unwrap();
    desk.fails("info @sky", 1, "is a picture");
}

#[test]
fn scenes_without_surfaces_have_information_but_no_picture() {
    let desk = Desk::new();
    std::fs::write(desk.path("empty.gltf"), r#"{"asset": {"version": "2.0"}}"#).unwrap();
    let info = desk.json("info @empty.gltf");
    assert_eq!((&info["triangles"], &info["cameras"]), (&json!(0), &json!(0)));
    for command in ["bake @empty.gltf -o @a.transport", "trace @empty.gltf -o @a.exr", "render @empty.gltf -o @a.exr"] {
        desk.fails(command, 1, "no triangles");
    }
    assert_eq!(desk.names(), ["empty.gltf", "room.glb"], "a failed command leaves files behind");
}

#[test]
fn a_scene_without_a_camera_is_seen_anyway() {
    let desk = Desk::new();
    let room = Shape::room(glam::Vec3::splat(2.0));
    let file = SceneFile::default().surface("room", &room, SceneFile::lambert([0.5; 3], [0.5; 3]));
    std::fs::write(desk.path("blind.glb"), file.glb()).unwrap();
    desk.json("trace @blind.glb -o @a.exr --size 16x12 --spp 16");
    // Inside the closed room every pixel is 1, so the camera must stand inside.
    let picture = read_exr(&desk.path("a.exr")).unwrap();
    let mean = picture.pixels.iter().map(|rgb| rgb[0]).sum::<f32>() / picture.pixels.len() as f32;
    assert!((mean - 1.0).abs() < 0.1, "{mean}");
}

#[test]
fn what_cannot_be_done_is_said_in_words() {
    let desk = Desk::new();
    desk.fails("bake @none.glb -o @a.transport", 1, "none.glb");
    desk.fails("bake @room.glb -o @none/a.transport", 1, "does not exist");
    desk.fails("bake @room.glb -o @a.transport --camera Balcony", 1, "`door`");
    desk.fails("bake @room.glb -o @a.transport --panel Nowhere=8", 1, "Nowhere");
    desk.fails("trace @room.glb -o @a.jpg", 1, ".exr or .png");
    desk.fails("relight @room.glb -o @a.exr", 1, "not a .transport file");
    desk.fails("relight @room.transport -o @a.png --layers lights", 1, "layers");
    desk.fails("info @none.glb", 1, "none.glb");
    desk.fails("bake @room.glb", 2, "--output");
    desk.fails("bake @room.glb -o @a.transport --spp 0", 2, "--spp");
    desk.fails("paint", 2, "`paint` is neither a command nor a file");
    desk.fails("bake @room.glb -o @a.transport --panel panel=8 --panel panel=16", 2, "twice");
    desk.fails("trace @room.glb -o @a.exr --panel panel=8 --panel node:2=16", 1, "twice");
    std::fs::write(desk.path("a.look"), r#"{"clerestory": 1, "lights": {"warm": {"intensity": "much"}}}"#).unwrap();
    desk.fails("trace @room.glb --look @a.look -o @a.exr", 1, "`lights.warm.intensity`");
    assert_eq!(desk.names(), ["a.look", "room.glb"], "a failed command leaves files behind");
}

#[test]
fn no_output_takes_the_place_of_an_input() {
    let desk = Desk::new();
    std::fs::write(desk.path("lamp.ies"), IES).unwrap();
    std::fs::write(desk.path("day.hdr"), half_and_half()).unwrap();
    std::fs::write(desk.path("a.look"), r#"{"clerestory": 1, "sky": {"file": "sky.exr"}}"#).unwrap();
    desk.json("trace @room.glb -o @sky.exr --size 8x4 --spp 1");
    desk.json("bake @room.glb -o @room.transport --size 8x6 --spp 1");
    for (from, to) in [
        ("room.glb", "scene.exr"),
        ("room.glb", "b.part"),
        ("room.transport", "t.exr"),
        ("room.transport", "t.csv"),
        ("lamp.ies", "i.exr"),
    ] {
        std::fs::copy(desk.path(from), desk.path(to)).unwrap();
    }
    std::fs::copy(desk.path("a.look"), desk.path("look.exr")).unwrap();
    std::fs::copy(desk.path("day.hdr"), desk.path("day.exr")).unwrap();
    #[cfg(unix)]
    std::os::unix::fs::symlink(desk.path("room.glb"), desk.path("link.transport")).unwrap();
    #[cfg(not(unix))]
    std::fs::hard_link(desk.path("room.glb"), desk.path("link.transport")).unwrap();
    let contents = || desk.names().into_iter().map(|n| (std::fs::read(desk.path(&n)).unwrap(), n)).collect::<Vec<_>>();
    let before = contents();
    for (line, what) in [
        ("bake @room.glb -o @room.glb", "the scene"),
        ("bake @room.glb -o @link.transport", "the scene"),
        ("bake @b.part -o @b", "the scene"),
        ("bake @room.glb --ies warm=@lamp.ies -o @lamp.ies", "the measured distribution"),
        ("bake @room.glb --sky @day.hdr -o @day.hdr", "the sky"),
        ("trace @scene.exr -o @scene.exr", "the scene"),
        ("trace @room.glb --look @look.exr -o @look.exr", "the look"),
        ("trace @room.glb --look @a.look -o @sky.exr", "the sky"),
        ("render @scene.exr -o @scene.exr", "the scene"),
        ("render @room.glb --ies warm=@i.exr -o @i.exr", "the measured distribution"),
        ("relight @t.exr -o @t.exr --device cpu", "the transport"),
        ("relight @room.transport --look @look.exr -o @look.exr --device cpu", "the look"),
        ("sensors @t.csv -o @t.csv", "the transport"),
    ] {
        desk.fails(line, 1, &format!("would overwrite {what} "));
    }
    assert!(contents() == before, "a refused command writes");
}

#[test]
fn info_tells_what_the_file_has_and_what_was_made_up() {
    let desk = Desk::new();
    let room = Shape::room(glam::Vec3::splat(2.0));
    let file = SceneFile::default().surface("room", &room, SceneFile::lambert([0.5; 3], [0.0; 3]));
    let file = file.point_lamp("lamp", glam::Vec3::ZERO, [1.0; 3], 7.0).with_range(3.0);
    std::fs::write(desk.path("blind.glb"), file.glb()).unwrap();
    let info = desk.json("info @blind.glb");
    assert_eq!((&info["cameras"], &info["camera_names"]), (&json!(0), &json!([])));
    let [left_out] = &info["unsupported"].as_array().unwrap()[..] else { panic!("{info}") };
    assert!(left_out.as_str().unwrap().starts_with("lamp \"lamp\": its range"), "{info}");
    let [made] = &info["warnings"].as_array().unwrap()[..] else { panic!("{info}") };
    assert!(made.as_str().unwrap().contains("one was made"), "{info}");
    let said = desk.run("info @blind.glb");
    assert!(said.stderr.contains("its range is ignored"), "{}", said.stderr);

    desk.json("trace @blind.glb -o @a.exr --size 8x6 --spp 1");
    desk.fails("info @a.exr", 1, "is a picture");
    std::fs::copy(desk.path("a.exr"), desk.path("a.dat")).unwrap();
    desk.fails("info @a.dat", 1, "is a picture");
}

#[test]
fn a_look_that_does_nothing_is_told_why() {
    let desk = Desk::new();
    let unlit = json!({ "pbrMetallicRoughness": {}, "extensions": { "KHR_materials_unlit": {} } });
    let sign = Shape::quad(glam::vec3(-0.5, -0.5, -1.0), glam::Vec3::X, glam::Vec3::Y);
    let file = SceneFile::default().surface("sign", &sign, unlit);
    let file = file.point_lamp("lamp", glam::Vec3::ZERO, [1.0; 3], 7.0).camera("front", glam::Vec3::ZERO, 0.9);
    std::fs::write(desk.path("sign.glb"), file.glb()).unwrap();
    let look = json!({
        "clerestory": 1, "lights": { "unlit": { "muted": true }, "none": {} }, "panels": { "lamp": [] },
    });
    std::fs::write(desk.path("a.look"), look.to_string()).unwrap();
    let traced = desk.json("trace @sign.glb --look @a.look -o @a.exr --size 8x6 --spp 4");
    let warnings = traced["warnings"].to_string();
    for sentence in ["spots on `lamp`, which is no panel", "`none`, which this scene does not have"] {
        assert!(warnings.contains(sentence), "{sentence} is not in {warnings}");
    }
    let middle = read_exr(&desk.path("a.exr")).unwrap().pixels[3 * 8 + 4];
    assert_eq!(middle, [0.0; 3], "what is unlit can be muted as well");
}

/// A luminaire that shines three times as bright along its aim as at 60°.
const IES: &str = "IESNA:LM-63-2002\n[TEST] by hand\nTILT=NONE\n\
    1 1000 1.0 3 1 1 2 0 0 0\n1.0 1.0 10\n0 60 90\n0\n900 300 100\n";
/// Reflectance of the wall that it shines at.
const ALBEDO: f32 = 0.8;
/// Distance of that wall from the lamp and the camera, meters.
const DISTANCE: f32 = 2.0;

/// A lamp of 7 cd at the origin that aims along −Z at a wall, and a camera in the same place.
fn wall_washer() -> SceneFile {
    let wall = Shape::quad(glam::vec3(-9.0, -9.0, -DISTANCE), glam::Vec3::X * 18.0, glam::Vec3::Y * 18.0);
    SceneFile::default()
        .surface("wall", &wall, SceneFile::lambert([ALBEDO; 3], [0.0; 3]))
        .point_lamp("lamp", glam::Vec3::ZERO, [1.0; 3], 7.0)
        .camera("beside", glam::Vec3::ZERO, 1.8)
}

/// Radiance of the wall at an angle from the aim: I · cos θ / d² · albedo / π, with d = distance / cos θ.
fn wall_radiance(theta: f32) -> f32 {
    let degrees = theta.to_degrees();
    let candela = if degrees < 60.0 { 900.0 - 10.0 * degrees } else { 300.0 - (degrees - 60.0) * 200.0 / 30.0 };
    candela * theta.cos().powi(3) / (DISTANCE * DISTANCE) * ALBEDO / std::f32::consts::PI
}

#[test]
fn a_lamp_takes_the_distribution_of_an_ies_file() {
    let desk = Desk::new();
    let glb = wall_washer().glb();
    std::fs::write(desk.path("wall.glb"), &glb).unwrap();
    std::fs::write(desk.path("lamp.ies"), IES).unwrap();
    desk.json("trace @wall.glb --ies lamp=@lamp.ies -o @a.exr --size 32x24 --spp 64");
    let picture = read_exr(&desk.path("a.exr")).unwrap();

    let camera = &import::load_bytes("wall", &glb).unwrap().scene.cameras[0];
    let known = |pixel: usize| {
        const GRID: usize = 16;
        let radiance = (0..GRID * GRID).map(|i| {
            let within = (glam::vec2((i % GRID) as f32, (i / GRID) as f32) + 0.5) / GRID as f32;
            let at = glam::vec2((pixel % 32) as f32, (pixel / 32) as f32) + within;
            let direction = camera.direction(Film { width: 32, height: 24 }, at);
            wall_radiance(direction.normalize().dot(glam::Vec3::NEG_Z).acos())
        });
        radiance.sum::<f32>() / (GRID * GRID) as f32
    };
    let ratios: Vec<f64> = picture.pixels.iter().enumerate().map(|(i, rgb)| f64::from(rgb[1] / known(i))).collect();
    Mean::of(ratios.iter().copied()).assert_is(1.0, 1e-3, 1e-3);
    for (pixel, ratio) in ratios.iter().enumerate() {
        assert!((ratio - 1.0).abs() < 0.05, "pixel {pixel} is {ratio} times what it should be");
    }
}

#[test]
fn a_distribution_that_cannot_be_given_is_told_with_file_and_line() {
    let desk = Desk::new();
    std::fs::write(desk.path("good.ies"), IES).unwrap();
    std::fs::write(desk.path("bad.ies"), IES.replace("0 60 90", "0 60 50")).unwrap();
    std::fs::create_dir(desk.path("folder.ies")).unwrap();
    for command in ["bake @room.glb -o @a.transport", "trace @room.glb -o @a.exr", "render @room.glb -o @a.exr"] {
        let bad = desk.path("bad.ies");
        desk.fails(&format!("{command} --ies warm=@bad.ies"), 1, &format!("line 6 of {}", bad.display()));
        desk.fails(&format!("{command} --ies panel=@good.ies"), 1, "warm, cool");
        desk.fails(&format!("{command} --ies warm=@none.ies"), 1, "none.ies");
        desk.fails(&format!("{command} --ies warm=@folder.ies"), 1, "it is no regular file");
        desk.fails(&format!("{command} --ies warm=@good.ies --ies warm=@good.ies"), 1, "twice");
        desk.fails(&format!("{command} --ies warm"), 2, "KEY=FILE");
    }
    assert_eq!(desk.names(), ["bad.ies", "folder.ies", "good.ies", "room.glb"], "a failed command leaves files behind");
}

#[test]
fn lamps_without_units_are_683_times_as_bright_and_measured_ones_stay() {
    let desk = Desk::new();
    std::fs::write(desk.path("wall.glb"), wall_washer().glb()).unwrap();
    std::fs::write(desk.path("lamp.ies"), IES).unwrap();
    let mean = |options: &str| {
        desk.json(&format!("trace @wall.glb {options} -o @a.exr --size 12x9 --spp 4"));
        let pixels = read_exr(&desk.path("a.exr")).unwrap().pixels;
        pixels.iter().map(|rgb| f64::from(rgb[0])).sum::<f64>()
    };
    let (plain, unitless) = (mean(""), mean("--unitless"));
    assert!((unitless / plain / 683.0 - 1.0).abs() < 1e-4, "{plain} became {unitless}");
    assert_eq!(mean("--ies lamp=@lamp.ies"), mean("--ies lamp=@lamp.ies --unitless"));
}

#[test]
fn a_bake_with_other_lamps_has_another_fingerprint() {
    let desk = Desk::new();
    std::fs::write(desk.path("lamp.ies"), IES).unwrap();
    let fingerprint = |options: &str| {
        desk.json(&format!("bake @room.glb -o @a.transport --size 16x16 --spp 2 {options}"));
        archive::read(&desk.path("a.transport")).unwrap().header.fingerprint.clone()
    };
    let all = ["", "--unitless", "--ies warm=@lamp.ies", "--ies warm=@lamp.ies --unitless"].map(fingerprint);
    for (nth, one) in all.iter().enumerate() {
        assert!(!all[..nth].contains(one), "{all:?}");
    }
}

#[test]
fn a_look_for_another_scene_is_reported_and_ignored() {
    let desk = Desk::new();
    std::fs::write(desk.path("a.look"), r#"{"clerestory": 1, "lights": {"Chandelier": {"muted": true}}}"#).unwrap();
    let said = desk.run("trace @room.glb --look @a.look -o @a.exr --size 8x6 --spp 1");
    assert_eq!(said.code, ExitCode::SUCCESS);
    assert!(said.stderr.contains("`Chandelier`"), "{}", said.stderr);
}

#[test]
fn every_command_has_help_with_an_example() {
    let desk = Desk::new();
    for command in ["", "bake", "relight", "render", "trace", "compare", "info", "sensors"] {
        let said = desk.run(&format!("{command} --help"));
        assert_eq!(said.code, ExitCode::SUCCESS, "{command}");
        assert!(said.stdout.contains(&format!("Example: clerestory {command}")), "{command}: {}", said.stdout);
    }
}

#[test]
fn damaged_transport_files_are_refused() {
    let desk = Desk::new();
    desk.json("bake @room.glb -o @room.transport --size 20x18 --spp 4");
    let whole = std::fs::read(desk.path("room.transport")).unwrap();
    let damaged = |name: &str, bytes: &[u8]| {
        std::fs::write(desk.path(name), bytes).unwrap();
        let said = desk.run(&format!("info @{name}"));
        assert_eq!(said.code, ExitCode::from(1), "{name} was believed");
        assert!(said.stderr.starts_with("error: "), "{}", said.stderr);
    };
    for cut in [0, 4, 12, 100, whole.len() / 2, whole.len() - 1] {
        damaged(&format!("cut{cut}.transport"), &whole[..cut]);
    }
    for at in (0..whole.len()).step_by(whole.len() / 40) {
        let mut bytes = whole.clone();
        bytes[at] ^= 0x40;
        damaged(&format!("flip{at}.transport"), &bytes);
    }
    assert!(Path::new(&desk.path("room.transport")).exists());
}
