//! Free lamps: relit pictures against traced ones, through the command line; and no jump while a lamp moves.

use clerestory::compare::read_exr;
use clerestory_relight::{CpuRelighter, Radiance, Relight};
use clerestory_transport::bake::BakeConfig;
use clerestory_transport::camera::Film;
use clerestory_transport::lamps::{FreeLamp, LampShape, LampUnit, PreparedLamps};
use clerestory_transport::light::{LightRig, LightSetting};
use clerestory_transport::visible::{VisibleConfig, VisiblePoints};
use glam::Vec3;
use serde_json::{Value, json};

use crate::pipeline::Desk;
use crate::support::{SceneFile, Shape, baked, frame, prepare, two_lamps_and_a_panel};

const VIEW: &str = "--size 48x32";

/// A desk with a look of that name under which the room's own lights are dark and some lamps shine.
fn lit_by(name: &str, lamps: &Value) -> Desk {
    let desk = Desk::new();
    let dark = json!({ "muted": true });
    let look = json!({ "clerestory": 1, "lights": { "warm": dark, "cool": dark, "panel": dark }, "lamps": lamps });
    std::fs::write(desk.path(name), look.to_string()).unwrap();
    desk
}

fn two_lamps() -> Value {
    json!([
        { "key": "bulb", "type": "point", "position": [-0.4, 0.2, 0.3], "strength": 12, "unit": "lm", "kelvin": 3000 },
        { "key": "tube", "type": "rectangle", "position": [0.4, 0.8, 0.1], "aim": [0.3, -1, 0], "size_m": [0.5, 0.1],
          "strength": 20, "unit": "lm" },
    ])
}

#[test]
fn a_picture_with_free_lamps_is_the_traced_one() {
    let desk = lit_by("a.look", &two_lamps());
    desk.json(&format!("bake @room.glb -o @room.transport {VIEW} --spp 128 --patches 512"));
    let relit = desk
        .json("relight @room.transport --look @a.look --scene @room.glb -o @relit.exr --layers lights --device cpu");
    assert_eq!((&relit["layers"], &relit["warnings"]), (&json!(5), &json!([])));
    desk.json(&format!("trace @room.glb --look @a.look -o @traced.exr {VIEW} --spp 512"));
    let compared = desk.json("compare @relit.exr @traced.exr");
    println!("{compared}");
    assert!(compared["relative_l2"].as_f64().unwrap() < 0.05, "{compared}");
    assert!(compared["psnr_db"].as_f64().unwrap() > 35.0, "{compared}");
    for bias in compared["mean_bias"].as_array().unwrap() {
        assert!(bias.as_f64().unwrap().abs() < 0.02, "{compared}");
    }
    // A render makes columns of the lamps.
    desk.json(&format!("render @room.glb --look @a.look -o @rendered.exr {VIEW} --spp 256 --device cpu"));
    let compared = desk.json("compare @rendered.exr @traced.exr");
    assert!(compared["psnr_db"].as_f64().unwrap() > 28.0, "{compared}");
    for bias in compared["mean_bias"].as_array().unwrap() {
        assert!(bias.as_f64().unwrap().abs() < 0.02, "{compared}");
    }
}

/// A distribution file: candela at 0, 30, 60 and 90 degrees from the axis, on one side and on the other.
fn measured(one: &str, other: &str) -> String {
    format!(
        "IESNA:LM-63-2002\n[TEST] by hand\nTILT=NONE\n1 1000 1.0 4 3 1 2 0 0 0\n1.0 1.0 10\n0 30 60 90\n0 90 180\n\
         {one}\n400 300 100 50\n{other}\n"
    )
}

#[test]
fn a_moved_lamp_with_a_measured_distribution_is_the_traced_one() {
    let lamp = json!([{ "key": "washer", "type": "ies", "file": "washer.ies", "position": [-0.3, 0.5, 0.2],
        "aim": [0.2, -1, -0.4], "strength": 8, "unit": "cd" }]);
    let desk = lit_by("a.look", &lamp);
    std::fs::write(desk.path("washer.ies"), measured("400 900 200 0", "400 100 0 0")).unwrap();
    desk.json(&format!("bake @room.glb -o @room.transport {VIEW} --spp 64 --patches 256"));
    let shown = |command: &str| {
        desk.json(&format!("{command} --look @a.look -o @shown.exr"));
        read_exr(&desk.path("shown.exr")).unwrap().pixels.into_flattened()
    };
    let relight = "relight @room.transport --scene @room.glb --device cpu";
    let relit = shown(relight);
    let [a, b] = [1, 2].map(|seed| shown(&format!("trace @room.glb {VIEW} --spp 256 --seed {seed}")));
    // The same light with both sides exchanged.
    std::fs::write(desk.path("washer.ies"), measured("400 100 0 0", "400 900 200 0")).unwrap();
    let turned = shown(relight);
    // Noise of two traced pictures is independent: what their errors share is that of the relit one.
    let products = |x: &[f32], y: &[f32]| x.iter().zip(y).map(|(x, y)| f64::from(x * y)).sum::<f64>();
    let off = |picture: &[f32]| {
        let from = |traced: &[f32]| picture.iter().zip(traced).map(|(x, y)| x - y).collect::<Vec<f32>>();
        products(&from(&a), &from(&b)).max(0.0).sqrt() / products(&a, &b).sqrt()
    };
    let light = |picture: &[f32]| picture.iter().map(|x| f64::from(*x)).sum::<f64>();
    let energy = 2.0 * light(&relit) / (light(&a) + light(&b));
    println!("off {:.4}, energy {energy:.4}; turned {:.4}", off(&relit), off(&turned));
    assert!(off(&relit) < 0.05 && (energy - 1.0).abs() < 0.02, "{} {energy}", off(&relit));
    assert!(off(&turned) > 0.2, "the test would not see which way it is turned");
}

#[test]
fn without_patches_a_picture_shows_direct_light_and_says_so() {
    let desk = lit_by("a.look", &two_lamps());
    desk.json(&format!("bake @room.glb -o @room.transport {VIEW} --spp 8"));
    let relit = desk.json("relight @room.transport --look @a.look --scene @room.glb -o @relit.exr --device cpu");
    let warnings = relit["warnings"].to_string();
    assert!(warnings.contains("--patches"), "{warnings}");
    desk.json(&format!("trace @room.glb --look @a.look -o @traced.exr {VIEW} --spp 512 --bounces 0"));
    let psnr_db = || desk.json("compare @relit.exr @traced.exr")["psnr_db"].as_f64().unwrap();
    let as_asked = psnr_db();
    assert!(as_asked > 35.0, "{as_asked}");
    let with_samples = |n: u32| {
        desk.json(&format!(
            "relight @room.transport --look @a.look --scene @room.glb -o @relit.exr --device cpu --lamp-samples {n}"
        ));
        psnr_db()
    };
    let (one, six, some) = (with_samples(1), with_samples(6), with_samples(32));
    assert!(one + 2.0 < six && six < some && some == as_asked, "{one} {six} {some} {as_asked}");
}

#[test]
fn caustics_that_moved_lamps_lack_are_named_by_the_surfaces_that_cast_them() {
    let desk = lit_by("a.look", &two_lamps());
    let ball = Shape::hollow_sphere(0.2, 6).turned();
    let metal =
        |roughness: f32| json!({ "pbrMetallicRoughness": { "metallicFactor": 1, "roughnessFactor": roughness } });
    let glass = |volume: Value| {
        let extensions =
            json!({ "KHR_materials_transmission": { "transmissionFactor": 1 }, "KHR_materials_volume": volume });
        json!({ "pbrMetallicRoughness": { "metallicFactor": 0, "roughnessFactor": 0 }, "extensions": extensions })
    };
    let body = glass(json!({ "thicknessFactor": 0.1 }));
    for (name, material, casts) in [
        ("chrome", metal(0.0), true),
        ("satin", metal(0.5), false),
        ("body", body, true),
        ("pane", glass(json!({})), false),
    ] {
        let file = two_lamps_and_a_panel().surface(name, &ball, material);
        std::fs::write(desk.path("room.glb"), file.glb()).unwrap();
        let info = desk.json("info @room.glb");
        let named: Vec<&str> = info["caustic_materials"].as_array().unwrap().iter().filter_map(Value::as_str).collect();
        assert_eq!(named.len(), usize::from(casts), "{name}: {info}");
        assert_eq!(desk.run("info @room.glb").stdout.contains("cast caustics"), casts, "{name}");
        desk.json("bake @room.glb -o @room.transport --size 16x12 --spp 1 --patches 16");
        let relit = desk.json("relight @room.transport --look @a.look --scene @room.glb -o @relit.exr --device cpu");
        let told = relit["warnings"].to_string();
        for lamp in ["bulb", "tube"] {
            assert_eq!(told.contains(&format!("`{lamp}` sends ")), casts, "{name}: {told}");
        }
        assert_eq!(
            told.contains("% of its light onto mirrors and clear glass, whose caustics"),
            casts,
            "{name}: {told}"
        );
    }
}

#[test]
fn light_of_lamps_that_a_pane_mirrors_is_named_with_its_share() {
    let desk = lit_by("a.look", &two_lamps());
    let level = Shape::quad(Vec3::new(-0.95, 0.05, -0.95), Vec3::Z * 1.9, Vec3::X * 1.9);
    for (roughness, is_clear) in [(0.0, true), (0.4, false)] {
        let pane = json!({
            "pbrMetallicRoughness": { "metallicFactor": 0, "roughnessFactor": roughness },
            "extensions": { "KHR_materials_transmission": { "transmissionFactor": 1 } },
        });
        let file = two_lamps_and_a_panel().surface("pane", &level, pane);
        std::fs::write(desk.path("room.glb"), file.glb()).unwrap();
        let info = desk.json("info @room.glb");
        assert_eq!(info["mirroring_materials"].as_array().unwrap().len(), usize::from(is_clear), "{info}");
        assert_eq!(desk.run("info @room.glb").stdout.contains("mirror a part of the light, which moved"), is_clear);
        desk.json("bake @room.glb -o @room.transport --size 16x12 --spp 1 --patches 16");
        let relit = desk.json("relight @room.transport --look @a.look --scene @room.glb -o @relit.exr --device cpu");
        let told = relit["warnings"].to_string();
        for lamp in ["bulb", "tube"] {
            let words = format!("% of the light of `{lamp}` onto other surfaces, which is missing");
            assert_eq!(told.contains(&words), is_clear, "{roughness}: {told}");
        }
    }
}

#[test]
fn lamps_need_the_scene_that_was_baked() {
    let desk = lit_by("a.look", &two_lamps());
    desk.json(&format!("bake @room.glb -o @room.transport {VIEW} --spp 4"));
    desk.fails("relight @room.transport --look @a.look -o @a.exr", 1, "--scene");
    let other =
        two_lamps_and_a_panel().surface("more", &Shape::room(Vec3::splat(0.1)), SceneFile::lambert([0.5; 3], [0.0; 3]));
    std::fs::write(desk.path("other.glb"), other.glb()).unwrap();
    desk.fails(
        "relight @room.transport --look @a.look --scene @other.glb -o @a.exr",
        1,
        "is not the scene that was baked: its geometry, materials or camera differ",
    );
    let named = |key: &str, unit: &str| {
        let lamp = json!([{ "key": key, "type": "point", "position": [0, 0, 0], "strength": 1, "unit": unit }]);
        std::fs::write(desk.path("b.look"), json!({ "clerestory": 1, "lamps": lamp }).to_string()).unwrap();
    };
    named("warm", "lm");
    desk.fails("relight @room.transport --look @b.look --scene @room.glb -o @a.exr", 1, "`warm`");
    desk.fails(&format!("trace @room.glb --look @b.look -o @a.exr {VIEW} --spp 1"), 1, "`warm`");
    named("bulb", "lx");
    desk.fails(&format!("trace @room.glb --look @b.look -o @a.exr {VIEW} --spp 1"), 1, "lm or cd");
}

#[test]
fn lamps_that_are_muted_need_neither_scene_nor_files() {
    let desk = Desk::new();
    let lamps = json!([
        { "key": "bulb", "type": "point", "position": [0, 0.5, 0], "strength": 5, "muted": true },
        { "key": "washer", "type": "ies", "file": "gone.ies", "position": [0, 0.5, 0], "aim": [0, 0, 0], "strength": 5,
          "muted": true },
    ]);
    std::fs::write(desk.path("off.look"), json!({ "clerestory": 1, "lamps": lamps }).to_string()).unwrap();
    desk.json("bake @room.glb -o @room.transport --size 8x6 --spp 1");
    for scene in ["", "--scene @room.glb"] {
        let relit = desk.json(&format!("relight @room.transport --look @off.look {scene} -o @a.exr --device cpu"));
        assert_eq!(relit["warnings"], json!([]));
    }
    desk.json("trace @room.glb --look @off.look -o @traced.exr --size 8x6 --spp 1");
    std::fs::write(desk.path("plain.look"), r#"{"clerestory": 1}"#).unwrap();
    let relit = "relight @room.transport --look @plain.look --scene @gone.glb --lamp-samples 8 -o @a.exr --device cpu";
    let told = desk.json(relit)["warnings"].to_string();
    assert!(told.contains("--scene changes nothing") && told.contains("--lamp-samples changes nothing"), "{told}");
}

#[test]
fn lamps_light_a_bake_whose_own_lamps_have_no_units() {
    let desk = lit_by("a.look", &two_lamps());
    desk.json(&format!("bake @room.glb -o @room.transport {VIEW} --spp 4 --unitless"));
    desk.json("relight @room.transport --look @a.look --scene @room.glb -o @relit.exr --device cpu --lamp-samples 8");
    desk.json(&format!("trace @room.glb --look @a.look -o @traced.exr {VIEW} --spp 256 --bounces 0"));
    let compared = desk.json("compare @relit.exr @traced.exr");
    assert!(compared["psnr_db"].as_f64().unwrap() > 25.0, "{compared}");
}

#[test]
fn lamps_light_a_bake_whose_own_lamps_were_given_another_light() {
    let desk = lit_by("a.look", &two_lamps());
    std::fs::write(desk.path("warm.ies"), measured("400 900 200 0", "400 100 0 0")).unwrap();
    let lit = |name: &str, options: &str| {
        desk.json(&format!("bake @room.glb -o @{name}.transport {VIEW} --spp 4 {options}"));
        let relight = format!("relight @{name}.transport --look @a.look --scene @room.glb -o @{name}.exr");
        desk.json(&format!("{relight} --device cpu --lamp-samples 8"));
        read_exr(&desk.path(&format!("{name}.exr"))).unwrap().pixels
    };
    // Its own lamps are dark.
    let plain = lit("plain", "");
    assert!(plain.iter().flatten().sum::<f32>() > 0.0);
    assert_eq!(lit("measured", "--ies warm=@warm.ies"), plain);
}

#[test]
fn a_light_of_the_file_that_became_movable_leaves_the_picture_as_it_was() {
    let desk = Desk::new();
    desk.json(&format!("bake @room.glb -o @room.transport {VIEW} --spp 256 --tolerance 50 --patches 1024"));
    let scene = prepare(&two_lamps_and_a_panel().glb());
    let lighting = &scene.lighting;
    let (source, light) = lighting
        .basis
        .sources
        .iter()
        .zip(&lighting.emitters)
        .find_map(|(source, emitter)| match emitter {
            clerestory_transport::emitters::Emitter::Punctual(light) if source.key == "warm" => Some((source, light)),
            _ => None,
        })
        .unwrap();
    let lamp = FreeLamp::from_source("moved", source, light, LightSetting::default()).unwrap();
    let mut look = clerestory::look::Look::default();
    look.lights.lights.insert("warm".into(), LightSetting { muted: true, ..LightSetting::default() });
    look.lights.lamps.push(lamp);
    std::fs::write(desk.path("moved.look"), look.to_json()).unwrap();
    desk.json("relight @room.transport -o @before.exr --device cpu");
    desk.json("relight @room.transport --look @moved.look --scene @room.glb -o @after.exr --device cpu");
    let compared = desk.json("compare @after.exr @before.exr");
    println!("{compared}");
    assert!(compared["psnr_db"].as_f64().unwrap() > 40.0, "{compared}");
    let [before, after] = ["before.exr", "after.exr"].map(|name| read_exr(&desk.path(name)).unwrap());
    assert_ne!(before.pixels, after.pixels, "the lamp was exchanged");
}

#[test]
fn while_a_lamp_moves_continuously_the_picture_moves_continuously() {
    let scene = prepare(&two_lamps_and_a_panel().glb());
    let film = Film { width: 32, height: 24 };
    let bake = baked(&scene, film, BakeConfig { spp: 32, patches: 256, ..BakeConfig::default() });
    let patches = bake.header.patches.as_ref().unwrap();
    let mut relighter = CpuRelighter::new(&frame(&bake)).unwrap();
    let camera = &scene.scene.cameras[0];
    let config = VisibleConfig { samples: 8, narrow_alpha: patches.narrow_alpha(), ..VisibleConfig::default() };
    let points = VisiblePoints::new(&scene, camera, film, config, &|| false).unwrap();
    // Across the room, over the block and close by the wall, half a centimeter a frame.
    let n_frames = 300;
    let mut frames: Vec<[Vec<f32>; 2]> = Vec::new();
    for nth in 0..n_frames {
        let x = 0.005 * nth as f32 - 0.75;
        let shape = LampShape::Disk { radius_m: 0.1 };
        let position = Vec3::new(x, -0.2 + 0.1 * (3.0 * x).sin(), -0.3);
        let (unit, setting) = (LampUnit::Lumen, LightSetting::default());
        let lamp = FreeLamp {
            key: "l".into(),
            shape,
            position,
            aim: position - Vec3::Y,
            strength: 20.0,
            unit,
            setting,
            turn_rad: 0.0,
            replaces: None,
        };
        let lamps = PreparedLamps::new(&[lamp], None).unwrap().0;
        let mut coefficients = bake.header.coefficients(&LightRig::default());
        coefficients.iter_mut().flatten().for_each(|rgb| *rgb = [0.0; 3]);
        *coefficients.last_mut().unwrap() = lamps.light_on_patches(&scene, patches);
        let mut indirect = Radiance::default();
        relighter.relight(&coefficients, &mut indirect).unwrap();
        let mut direct = vec![0.0; 3 * film.n_pixels()];
        for pass in 0..32 {
            let picture = points.direct(&scene, &lamps, pass, &|| false).unwrap();
            direct.iter_mut().zip(picture.iter().flatten()).for_each(|(sum, value)| *sum += value / 32.0);
        }
        frames.push([indirect.pixels.into_iter().flatten().collect(), direct]);
    }
    for (part, most, what) in [(0, 0.05, "indirect"), (1, 0.15, "direct")] {
        let norm = |values: &mut dyn Iterator<Item = f32>| values.map(|v| f64::from(v).powi(2)).sum::<f64>().sqrt();
        let jump = |pair: &[[Vec<f32>; 2]]| {
            let [before, after] = [&pair[0][part], &pair[1][part]];
            norm(&mut before.iter().zip(after).map(|(a, b)| b - a)) / norm(&mut before.iter().copied())
        };
        let mut jumps: Vec<f64> = frames.windows(2).map(jump).collect();
        jumps.sort_by(f64::total_cmp);
        let (median, largest) = (jumps[jumps.len() / 2], jumps[jumps.len() - 1]);
        println!("{what}: median step {median:.4}, largest {largest:.4}");
        assert!(largest < most, "{what}: a step of {largest:.4} where most are {median:.4}");
    }
}
