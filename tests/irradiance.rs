//! Lux through the command line: of what a picture shows, and at the points of sensor grids.

use std::f32::consts::PI;

use clerestory::compare::read_exr;
use exr::prelude::read_first_flat_layer_from_file;
use glam::Vec3;
use serde_json::{Value, json};

use crate::pipeline::Desk;
use crate::support::{Mean, SceneFile, Shape, two_lamps_and_a_panel};

/// Distance of the wall from the lamp, meters.
const DISTANCE: f32 = 2.0;
const CANDELA: f32 = 7.0;
const ALBEDO: f32 = 0.8;

/// A wall of 9 m × 9 m, and a lamp and a camera in the same place before it.
fn wall() -> SceneFile {
    let wall = Shape::quad(Vec3::new(-4.5, -4.5, -DISTANCE), Vec3::X * 9.0, Vec3::Y * 9.0);
    SceneFile::default()
        .surface("wall", &wall, SceneFile::lambert([ALBEDO; 3], [0.0; 3]))
        .point_lamp("lamp", Vec3::ZERO, [1.0; 3], CANDELA)
        .camera("beside", Vec3::ZERO, 0.8)
}

fn desk(name: &str, file: &SceneFile) -> Desk {
    let desk = Desk::new();
    std::fs::write(desk.path(name), file.glb()).unwrap();
    desk
}

/// Candela times cosine over squared distance.
fn known_lux(point: Vec3) -> f32 {
    CANDELA * DISTANCE / point.length().powi(3)
}

/// Points and lux of a table, all of one grid.
fn table(desk: &Desk, name: &str, grid: &str) -> Vec<(Vec3, f32)> {
    let text = std::fs::read_to_string(desk.path(name)).unwrap();
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some("grid,x,y,z,lux"));
    let rows = lines.map(|line| line.split(',').collect::<Vec<_>>()).filter(|fields| fields[0] == grid);
    let number = |field: &str| field.parse::<f32>().unwrap();
    rows.map(|f| (Vec3::new(number(f[1]), number(f[2]), number(f[3])), number(f[4]))).collect()
}

#[test]
fn sensors_on_a_wall_read_candela_times_cosine_over_squared_distance() {
    let desk = desk("wall.glb", &wall());
    let bake = desk.json("bake @wall.glb -o @wall.transport --sensors wall=9x5 --size 16x12 --spp 4");
    assert_eq!(bake["irradiance"][0]["name"], "wall", "{bake}");
    let read = desk.json("sensors @wall.transport -o @wall.csv");
    let points = table(&desk, "wall.csv", "wall");
    assert_eq!(points.len(), 45);
    for (point, lux) in &points {
        let known = known_lux(*point);
        assert!((lux - known).abs() < 2e-3 * known, "{lux} lx at {point}, not {known}");
    }
    let lux: Vec<f64> = points.iter().map(|(point, _)| f64::from(known_lux(*point))).collect();
    let (least, most) = (lux.iter().copied().fold(f64::MAX, f64::min), lux.iter().copied().fold(0.0, f64::max));
    let mean = lux.iter().sum::<f64>() / 45.0;
    let grid = &read["grids"][0];
    assert_eq!((&grid["size"], &grid["points"]), (&json!([9, 5]), &json!(45)));
    let shares = [("uniformity", least / mean), ("diversity", least / most)];
    let figures = [("average_lux", mean), ("minimum_lux", least), ("maximum_lux", most)].into_iter().chain(shares);
    for (name, known) in figures {
        assert!((grid[name].as_f64().unwrap() - known).abs() < 3e-3 * known, "{name} of {grid} is not {known}");
    }
    let said = desk.run("sensors @wall.transport").stdout;
    assert!(said.starts_with("wall: average 0.") && said.contains("U0") && said.contains(" fc"), "{said}");
}

#[test]
fn a_look_changes_what_sensors_read() {
    let desk = desk("wall.glb", &wall());
    desk.json("bake @wall.glb -o @wall.transport --sensors wall=3x3 --size 16x12 --spp 2");
    let look = json!({ "clerestory": 1, "lights": { "lamp": { "intensity": 2.0, "color": [1.0, 0.0, 0.0] } } });
    std::fs::write(desk.path("red.look"), look.to_string()).unwrap();
    let average = |line: &str| desk.json(line)["grids"][0]["average_lux"].as_f64().unwrap();
    let ratio = average("sensors @wall.transport --look @red.look") / average("sensors @wall.transport");
    assert!((ratio - 2.0 * 0.2126).abs() < 1e-4, "lux is luminance of RGB irradiance: {ratio}");
    // Lamps of the look are no columns of the bake: the sensors do not count them, and say so.
    let bulb = json!({ "key": "bulb", "type": "point", "position": [0, 0, 0.5], "strength": 100, "unit": "lm" });
    std::fs::write(desk.path("bulb.look"), json!({ "clerestory": 1, "lamps": [bulb] }).to_string()).unwrap();
    let read = desk.json("sensors @wall.transport --look @bulb.look");
    assert!(read["warnings"][0].as_str().is_some_and(|words| words.contains("do not count")), "{read}");
}

#[test]
fn a_uniform_sky_in_patches_gives_pi_times_its_radiance() {
    let ground = Shape::quad(Vec3::new(-2.0, 0.0, 2.0), Vec3::X * 4.0, Vec3::NEG_Z * 4.0);
    let file = SceneFile::default().surface("ground", &ground, SceneFile::lambert([0.5; 3], [0.0; 3]));
    let desk = desk("ground.glb", &file.camera("front", Vec3::new(0.0, 1.0, 3.0), 0.9));
    desk.json("bake @ground.glb -o @g.transport --sky uniform --sensors ground=4x4 --size 16x12 --spp 64");
    std::fs::write(desk.path("bright.look"), r#"{"clerestory": 1, "sky": {"intensity": 3.0}}"#).unwrap();
    for (look, nit) in [("", 1.0), ("--look @bright.look", 3.0)] {
        let read = desk.json(&format!("sensors @g.transport {look}"));
        for name in ["average_lux", "minimum_lux", "maximum_lux"] {
            let ratio = read["grids"][0][name].as_f64().unwrap() / (nit * f64::from(PI));
            assert!((ratio - 1.0).abs() < 0.02, "{name} is {ratio} times what it should be");
        }
    }
}

/// A channel of an EXR.
fn channel(desk: &Desk, name: &str, channel: &str) -> Vec<f32> {
    let layer = read_first_flat_layer_from_file(desk.path(name)).unwrap().layer_data;
    let found = layer.channel_data.list.iter().find(|c| c.name.to_string() == channel);
    found.unwrap_or_else(|| panic!("{name} has no {channel}")).sample_data.values_as_f32().collect()
}

#[test]
fn the_irradiance_layer_times_albedo_over_pi_is_the_picture() {
    let desk = desk("wall.glb", &wall());
    desk.json("bake @wall.glb -o @wall.transport --irradiance --size 32x24 --spp 32");
    let relit = desk.json("relight @wall.transport -o @lux.exr --layers irradiance --device cpu");
    assert_eq!(relit["layers"], 1, "{relit}");
    let picture = read_exr(&desk.path("lux.exr")).unwrap();
    let lux = channel(&desk, "lux.exr", "irradiance.G");
    let ratios = picture.pixels.iter().zip(&lux).map(|(rgb, lux)| f64::from(rgb[1] / (lux * ALBEDO / PI)));
    Mean::of(ratios).assert_is(1.0, 1e-3, 1e-3);
    // The middle of the picture looks straight at the wall.
    let middle = lux[12 * 32 + 16];
    assert!((middle / known_lux(Vec3::NEG_Z * DISTANCE) - 1.0).abs() < 0.01, "{middle}");
    desk.json("render @wall.glb -o @rendered.exr --layers irradiance --size 32x24 --spp 32 --device cpu");
    assert_eq!(channel(&desk, "rendered.exr", "irradiance.G"), lux, "render bakes what its layers need");
}

#[test]
fn a_node_that_is_a_sensor_neither_blocks_nor_scatters_nor_shines() {
    let tray = Shape::quad(Vec3::new(-0.5, 0.0, 0.5), Vec3::X, Vec3::NEG_Z);
    let desk = desk("plain.glb", &two_lamps_and_a_panel());
    std::fs::write(desk.path("tray.glb"), two_lamps_and_a_panel().sensors("tray", &tray, [4, 3]).glb()).unwrap();
    for scene in ["plain", "tray"] {
        desk.json(&format!("trace @{scene}.glb -o @{scene}.exr --size 24x16 --spp 4"));
    }
    assert_eq!(read_exr(&desk.path("plain.exr")).unwrap(), read_exr(&desk.path("tray.exr")).unwrap());
    let info = desk.json("info @tray.glb");
    assert_eq!((&info["sensors"], &info["lights"]), (&json!(["tray"]), &json!(["warm", "cool", "panel"])));
    assert_eq!(info["warnings"], json!([]));

    // Measured only where asked for; a size that is typed counts more than that of the file.
    const BAKE: &str = "--size 16x12 --spp 8 --fresh";
    let sizes = |options: &str| -> Vec<Value> {
        desk.json(&format!("bake @tray.glb -o @a.transport {BAKE} {options}"));
        let sets = desk.json("info @a.transport")["irradiance"].as_array().unwrap().clone();
        sets.iter().map(|set| json!([set["name"], set["width"], set["height"]])).collect()
    };
    assert_eq!(sizes(""), Vec::<Value>::new());
    assert_eq!(sizes("--irradiance"), [json!(["pixels", 16, 12]), json!(["tray", 4, 3])]);
    assert_eq!(sizes("--sensors tray=2x2"), [json!(["tray", 2, 2])]);
    let all = sizes("--irradiance --sensors tray=5x5 --work-plane 0.75:0.25");
    assert_eq!(all[1..], [json!(["tray", 5, 5]), json!(["work plane 0.75 m", 8, 8])]);
    let read = desk.json("sensors @a.transport -o @a.csv");
    // The block on the floor is 0.5 m wide, 0.5 m high and stands on it: the plane passes above.
    assert_eq!((&read["grids"][0]["points"], &read["grids"][1]["points"]), (&json!(25), &json!(64)));
    assert!(table(&desk, "a.csv", "work plane 0.75 m").iter().all(|(point, _)| (point.y - -0.25).abs() < 1e-3));
    for grid in read["grids"].as_array().unwrap() {
        let [least, mean, most] =
            ["minimum_lux", "average_lux", "maximum_lux"].map(|name| grid[name].as_f64().unwrap());
        assert!(0.0 < least && least < mean && mean < most, "{grid}");
    }
}

#[test]
fn irradiance_has_the_same_bytes_on_any_number_of_threads() {
    let desk = Desk::new();
    const BAKE: &str = "--irradiance --work-plane 0.5:0.1 --size 40x24 --spp 8";
    for threads in [1, 3] {
        desk.json(&format!("bake @room.glb -o @{threads}.transport {BAKE} --threads {threads}"));
    }
    let [one, three] = ["1.transport", "3.transport"].map(|name| std::fs::read(desk.path(name)).unwrap());
    assert!(one == three, "threads change the bytes");
    for cut in [one.len() / 2, one.len() - 1] {
        std::fs::write(desk.path("cut.transport"), &one[..cut]).unwrap();
        desk.fails("sensors @cut.transport", 1, "damaged");
    }
}

#[test]
fn what_was_not_measured_is_said_with_the_option_that_measures_it() {
    let desk = desk("wall.glb", &wall());
    desk.json("bake @wall.glb -o @wall.transport --size 8x6 --spp 2");
    desk.fails("sensors @wall.transport -o @a.csv", 1, "--sensors NODE=WxH or --work-plane HEIGHT");
    desk.fails("relight @wall.transport -o @a.exr --layers irradiance --device cpu", 1, "--irradiance");
    desk.fails("relight @wall.transport -o @a.png --layers irradiance", 1, "layers");
    desk.fails("bake @wall.glb -o @a.transport --sensors Nowhere=4x4", 1, "there are: wall");
    desk.fails("bake @room.glb -o @a.transport --sensors room=4x4", 1, "not a single quad");
    desk.fails("bake @wall.glb -o @a.transport --sensors wall=4x4 --sensors wall=2x2", 1, "twice");
    desk.fails("bake @wall.glb -o @a.transport --sensors wall=4096x4096", 1, "points");
    desk.fails("bake @wall.glb -o @a.transport --work-plane 1", 1, "no work plane");
    desk.fails("bake @wall.glb -o @a.transport --work-plane tall", 2, "HEIGHT:SPACING");
    assert!(!desk.path("a.transport").exists() && !desk.path("a.csv").exists(), "a failed command leaves files behind");
}
