//! Light of forty powers of ten through every stage behind a bake: irradiance, sensors, the sky, free lamps, both kernels, solving and
//! the display. The random numbers are those of everyday light, so that only rounding may differ; the figures are printed and stand
//! in `docs/reliability.md`.

use clerestory::compare::read_exr;
use clerestory_relight::display::{self, ColorScale, DisplayParams, Metering, Spacing, Tone};
use clerestory_relight::{GpuRelighter, Radiance, Relight};
use clerestory_transport::bake::BakeConfig;
use clerestory_transport::camera::Film;
use clerestory_transport::light::{LightRig, LightSetting};
use glam::Vec3;
use serde_json::json;

use crate::pipeline::Desk;
use crate::support::{SceneFile, Shape, baked, frame, gpu, prepare, relit, two_lamps_and_a_panel};

/// What the light is multiplied with.
const LIGHTS: [f32; 4] = [1e-20, 1e-10, 1e10, 1e20];
/// Some roundings of 32 bits.
const ROUNDING: f64 = 1e-5;

/// A room with a block and a lamp.
fn room(light: f32) -> SceneFile {
    let block = Shape::room(Vec3::splat(0.25)).turned().moved(Vec3::new(0.3, -0.75, -0.3));
    SceneFile::default()
        .surface("room", &Shape::room(Vec3::ONE), SceneFile::lambert([0.7, 0.6, 0.5], [0.0; 3]))
        .surface("block", &block, SceneFile::lambert([0.3, 0.5, 0.7], [0.0; 3]))
        .point_lamp("lamp", Vec3::new(-0.6, 0.3, 0.2), [1.0, 0.7, 0.4], 1.5 * light)
        .camera("door", Vec3::new(0.0, 0.0, 0.95), 1.1)
}

/// Root mean square of the difference over that of `other`, both in units of their own light.
#[track_caller]
fn off((picture, light): (&[f32], f32), (other, unit): (&[f32], f32)) -> f64 {
    assert_eq!(picture.len(), other.len());
    let value = |x: f32, light: f32| {
        assert!(x.is_finite(), "{x}");
        f64::from(x) / f64::from(light)
    };
    let pairs = picture.iter().zip(other).map(|(x, y)| (value(*x, light), value(*y, unit)));
    let (difference, energy) = pairs.fold((0.0, 0.0), |(d, e), (x, y)| (d + (x - y).powi(2), e + y * y));
    assert!(energy > 0.0, "everyday light gives nothing");
    (difference / energy).sqrt()
}

#[track_caller]
fn pixels(desk: &Desk, name: &str) -> Vec<f32> {
    read_exr(&desk.path(name)).unwrap().pixels.into_flattened()
}

/// What a bake of such light gives: a picture, the same by the device if there is one, and what its sensors read.
struct Figures {
    pictures: Vec<Vec<f32>>,
    lux: Vec<f32>,
    solved: f64,
}

impl Figures {
    fn of(light: f32, has_gpu: bool) -> Figures {
        let desk = Desk::new();
        std::fs::write(desk.path("room.glb"), room(light).glb()).unwrap();
        desk.json(
            "bake @room.glb -o @room.transport --size 24x18 --spp 16 --seed 7 --irradiance --work-plane 0.5:0.4 --patches 32",
        );
        let devices = if has_gpu { &["cpu", "gpu"][..] } else { &["cpu"] };
        let pictures = devices.iter().map(|device| {
            desk.json(&format!("relight @room.transport -o @a.exr --device {device}"));
            pixels(&desk, "a.exr")
        });
        let pictures = pictures.collect();
        let read = desk.json("sensors @room.transport");
        let grid = &read["grids"][0];
        let lux: Vec<f32> =
            ["average_lux", "minimum_lux", "maximum_lux"].map(|name| grid[name].as_f64().unwrap() as f32).into();
        // Three times the light that there is.
        let wish = json!({ "wishes": [{ "sensors": grid["name"], "times": 3 }], "factor": [0, 50] });
        std::fs::write(desk.path("wishes.json"), wish.to_string()).unwrap();
        let solved = desk.json("solve @room.transport --wishes @wishes.json -o @solved.look");
        let solved = solved["lights"][0]["after"].as_f64().unwrap();
        // A picture for people: the exposure finds what there is to see.
        desk.json("relight @room.transport -o @a.png");
        let shown = image::open(desk.path("a.png")).unwrap().into_rgb8();
        let mean = shown.as_raw().iter().map(|byte| f64::from(*byte)).sum::<f64>() / shown.as_raw().len() as f64;
        assert!((30.0..220.0).contains(&mean), "light of {light:e} is shown as {mean}");
        Figures { pictures, lux, solved }
    }
}

#[test]
fn ranges_of_light_reach_pictures_sensors_and_wishes_alike() {
    let has_gpu = gpu().is_some();
    let everyday = Figures::of(1.0, has_gpu);
    assert!((everyday.solved - 3.0).abs() < 0.05, "{}", everyday.solved);
    for light in LIGHTS {
        let figures = Figures::of(light, has_gpu);
        let picture = figures.pictures.iter().map(|picture| off((picture, light), (&everyday.pictures[0], 1.0)));
        let (picture, lux) = (picture.fold(0.0, f64::max), off((&figures.lux, light), (&everyday.lux, 1.0)));
        println!("light of {light:e}: pictures off by {picture:.1e}, lux by {lux:.1e}, solved {:.4}", figures.solved);
        assert!(picture < ROUNDING && lux < ROUNDING, "{light}: {picture} {lux}");
        assert!((figures.solved - everyday.solved).abs() < 0.01, "{light}: {}", figures.solved);
    }
}

#[test]
fn ranges_of_intensities_are_multiplied_alike_by_both_kernels() {
    let scene = prepare(&two_lamps_and_a_panel().glb());
    let film = Film { width: 24, height: 18 };
    let bake = baked(&scene, film, BakeConfig { spp: 16, tolerance_db: 50.0, seed: 7, ..BakeConfig::default() });
    let everyday = relit(&bake, &LightRig::default());
    let gpu = gpu();
    let mut device = gpu.as_ref().map(|gpu| GpuRelighter::new(gpu, &frame(&bake)).unwrap());
    for intensity in [1e-30, 1e-20, 1e20, 1e30] {
        let names = ["warm", "cool", "panel"].map(String::from);
        let set = names.map(|name| (name, LightSetting { intensity, ..LightSetting::default() }));
        let rig = LightRig { lights: set.into(), ..LightRig::default() };
        let mut pictures = vec![relit(&bake, &rig)];
        if let Some(device) = &mut device {
            let mut picture = Radiance::default();
            device.relight(&bake.header.coefficients(&rig), &mut picture).unwrap();
            pictures.push(picture);
        }
        for picture in pictures {
            let off = off((picture.pixels.as_flattened(), intensity), (everyday.pixels.as_flattened(), 1.0));
            println!("intensity {intensity:e}: off by {off:.1e}");
            assert!(off < ROUNDING, "{intensity}: {off}");
        }
    }
}

#[test]
fn ranges_of_sky_and_of_free_lamps_change_no_more_than_rounding_does() {
    let desk = Desk::new();
    let dark = json!({ "muted": true });
    desk.json("bake @room.glb -o @room.transport --size 24x18 --spp 16 --seed 7 --patches 64");
    let lamp = |strength: f32| {
        let lamp = json!({ "key": "disk", "type": "disk", "position": [0.2, 0.6, 0.1], "aim": [0.2, -1, 0.1],
            "radius_m": 0.2, "strength": strength, "unit": "cd" });
        let look = json!({ "clerestory": 1, "lights": { "warm": dark, "cool": dark, "panel": dark }, "lamps": [lamp] });
        std::fs::write(desk.path("lamp.look"), look.to_string()).unwrap();
        desk.json("relight @room.transport --look @lamp.look --scene @room.glb -o @lamp.exr --device cpu");
        pixels(&desk, "lamp.exr")
    };
    let table = Shape::quad(Vec3::new(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0);
    let open = SceneFile::default().surface("table", &table, SceneFile::lambert([0.8; 3], [0.0; 3])).camera(
        "front",
        Vec3::new(0.0, 0.6, 2.5),
        0.9,
    );
    std::fs::write(desk.path("open.glb"), open.glb()).unwrap();
    desk.json("bake @open.glb -o @open.transport --size 24x18 --spp 16 --seed 7 --sky uniform");
    let sky = |intensity: f32| {
        let look = json!({ "clerestory": 1, "sky": { "intensity": intensity } });
        std::fs::write(desk.path("sky.look"), look.to_string()).unwrap();
        desk.json("relight @open.transport --look @sky.look -o @sky.exr --device cpu");
        pixels(&desk, "sky.exr")
    };
    let everyday = (lamp(1.0), sky(1.0));
    // A look takes numbers up to a billion.
    for light in [1e-20, 1e-10, 1e-5, 1e5, 1e9] {
        let lamp = off((&lamp(light), light), (&everyday.0, 1.0));
        let sky = off((&sky(light), light), (&everyday.1, 1.0));
        println!("light of {light:e}: a free lamp is off by {lamp:.1e}, a sky by {sky:.1e}");
        assert!(lamp < ROUNDING && sky < ROUNDING, "{light}: {lamp} {sky}");
    }
}

#[test]
fn ranges_of_radiance_are_shown_alike() {
    let scene = prepare(&two_lamps_and_a_panel().glb());
    let film = Film { width: 24, height: 18 };
    let picture = relit(&baked(&scene, film, BakeConfig { spp: 8, ..BakeConfig::default() }), &LightRig::default());
    let shown = |light: f32, tone: Tone, metering: Metering| {
        let pixels = picture.pixels.iter().map(|rgb| rgb.map(|x| x * light)).collect();
        let radiance = Radiance { pixels, ..picture.clone() };
        let scale = ColorScale::fitting(&radiance, Spacing::Log);
        assert!(scale.low > 0.0 && scale.low < scale.high && scale.high.is_finite(), "{light}: {scale:?}");
        let exposure_ev = metering.exposure_ev(&radiance);
        let plain = DisplayParams { tone, exposure_ev, ..DisplayParams::default() };
        let colored = DisplayParams { false_color: Some(scale), ..plain };
        [plain, colored].map(|params| display::encode(&radiance, &params))
    };
    for tone in [Tone::Linear, Tone::Agx, Tone::Aces, Tone::Neutral, Tone::Reinhard] {
        for metering in [Metering::Auto, Metering::LogAverage, Metering::Percentile(99.0)] {
            let everyday = shown(1.0, tone, metering);
            // Powers of two near 1e±20, so that a false color's round numbers are the only ones to move.
            for light in [2_f32.powi(-66), 2_f32.powi(66)] {
                let [plain, _] = shown(light, tone, metering);
                let most = plain.iter().zip(&everyday[0]).map(|(a, b)| a.abs_diff(*b)).max();
                assert!(most <= Some(1), "{tone:?} {metering:?} {light:e}: {most:?} code values");
            }
        }
    }
}
