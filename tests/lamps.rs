//! Free lamps: relit pictures against traced ones, through the command line; and no jump while a lamp moves.

use std::sync::{Arc, LazyLock};

use clerestory::compare::read_exr;
use clerestory::look::Look;
use clerestory_relight::{CpuRelighter, Radiance, Relight};
use clerestory_transport::bake::{Bake, BakeConfig};
use clerestory_transport::camera::Film;
use clerestory_transport::emitters::Emitter;
use clerestory_transport::lamps::{FreeLamp, LampShape, LampUnit, PreparedLamps};
use clerestory_transport::light::{LightRig, LightSetting};
use clerestory_transport::prepared::PreparedScene;
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
fn a_muted_lamp_with_the_key_of_a_light_of_the_scene_changes_nothing() {
    let desk = Desk::new();
    desk.json("bake @room.glb -o @room.transport --size 8x6 --spp 1 --work-plane 0.5:0.4");
    let lamp = |key: &str, muted: bool| {
        let position = [0.0, 0.5, 0.0];
        json!({ "key": key, "type": "point", "position": position, "strength": 5, "unit": "lm", "muted": muted })
    };
    let cases = [("plain", json!([lamp("bulb", false)])), ("odd", json!([lamp("bulb", false), lamp("warm", true)]))];
    let [plain, odd] = cases.map(|(name, lamps)| {
        let timeline = json!({ "keys": [{ "time": 0, "look": "Day" }] });
        let kept = json!([{ "name": "Day", "lamps": lamps }]);
        let look = json!({ "clerestory": 1, "lamps": lamps, "looks": kept, "timeline": timeline });
        std::fs::write(desk.path(&format!("{name}.look")), look.to_string()).unwrap();
        let relight = format!("relight @room.transport --look @{name}.look --scene @room.glb --device cpu");
        desk.json(&format!("{relight} -o @{name}.exr"));
        desk.json(&format!("{relight} -o @{name}_#.exr"));
        desk.json(&format!("trace @room.glb --look @{name}.look -o @{name}-traced.exr --size 8x6 --spp 1"));
        let read = desk.json(&format!("sensors @room.transport --look @{name}.look --scene @room.glb"));
        let sum = |file: &str| read_exr(&desk.path(file)).unwrap().pixels.as_flattened().iter().sum::<f32>();
        let pictures = [".exr", "_0.exr", "-traced.exr"].map(|end| sum(&format!("{name}{end}")));
        (pictures, read["grids"][0]["average_lux"].as_f64().unwrap())
    });
    for (plain, odd) in plain.0.into_iter().zip(odd.0) {
        assert!(plain > 0.0 && (odd - plain).abs() < 1e-3 * plain, "{odd} is not {plain}");
    }
    assert!(plain.1 > 0.0 && (odd.1 - plain.1).abs() < 1e-3 * plain.1, "{} is not {}", odd.1, plain.1);
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

const MUTED: LightSetting = LightSetting { intensity: 1.0, color: None, kelvin: None, muted: true };

/// Makes a light of a baked file movable, while the others are set as told. Answers how the picture after that differs.
fn exchanged(desk: &Desk, file: &str, scene: &PreparedScene, key: &str, others: LightSetting) -> Value {
    let (sources, emitters) = (&scene.lighting.basis.sources, &scene.lighting.emitters);
    let lamp = sources.iter().zip(emitters).find_map(|(source, emitter)| match emitter {
        Emitter::Punctual(light) if source.key == key => Some((source, light)),
        _ => None,
    });
    let (source, light) = lamp.unwrap();
    let mut before = Look::default();
    for other in sources.iter().filter(|other| other.key != key) {
        before.lights.lights.insert(other.key.clone(), others);
    }
    let mut after = before.clone();
    after.lights.lights.insert(key.into(), MUTED);
    after.lights.lamps.push(FreeLamp::from_source("moved", source, light, LightSetting::default()).unwrap());
    let [before, after] = [("before", before), ("after", after)].map(|(name, look)| {
        std::fs::write(desk.path(&format!("{name}.look")), look.to_json()).unwrap();
        let relight = format!("relight @{file}.transport --look @{name}.look --scene @{file}.glb");
        desk.json(&format!("{relight} -o @{name}.exr --device cpu"));
        read_exr(&desk.path(&format!("{name}.exr"))).unwrap().pixels
    });
    assert_ne!(before, after, "{key} was exchanged");
    let compared = desk.json("compare @after.exr @before.exr");
    println!("{key}: {compared}");
    compared
}

#[test]
fn a_light_of_the_file_that_became_movable_leaves_the_picture_as_it_was() {
    let desk = Desk::new();
    desk.json(&format!("bake @room.glb -o @room.transport {VIEW} --spp 256 --tolerance 50 --patches 1024"));
    let scene = prepare(&two_lamps_and_a_panel().glb());
    let compared = exchanged(&desk, "room", &scene, "warm", LightSetting::default());
    assert!(compared["psnr_db"].as_f64().unwrap() > 40.0, "{compared}");
}

/// A yard with a block, and a lamp of each kind that a file can have.
fn three_lamps() -> SceneFile {
    let wall = || SceneFile::lambert([0.7, 0.6, 0.5], [0.0; 3]);
    let floor = Shape::quad(Vec3::new(-1.0, -1.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0);
    let back = Shape::quad(Vec3::NEG_ONE, Vec3::X * 2.0, Vec3::Y * 2.0);
    let left = Shape::quad(Vec3::new(-1.0, -1.0, 1.0), Vec3::NEG_Z * 2.0, Vec3::Y * 2.0);
    let right = Shape::quad(Vec3::new(1.0, -1.0, -1.0), Vec3::Z * 2.0, Vec3::Y * 2.0);
    let block = Shape::room(Vec3::splat(0.25)).turned().moved(Vec3::new(0.3, -0.75, -0.3));
    let spot = json!({ "type": "spot", "intensity": 2.0, "spot": { "innerConeAngle": 0.6, "outerConeAngle": 1.0 } });
    let distant = json!({ "type": "directional", "intensity": 3.0 });
    SceneFile::default()
        .surface("floor", &floor, wall())
        .surface("back", &back, wall())
        .surface("left", &left, wall())
        .surface("right", &right, wall())
        .surface("block", &block, SceneFile::lambert([0.3, 0.5, 0.7], [0.0; 3]))
        .point_lamp("bulb", Vec3::new(-0.5, 0.3, 0.2), [1.0, 0.7, 0.4], 1.5)
        .aimed_lamp("spot", [Vec3::new(0.5, 0.6, 0.6), Vec3::new(0.0, -0.6, -0.8)], spot)
        .aimed_lamp("distant", [Vec3::new(0.4, 1.5, 0.7), Vec3::ZERO], distant)
        .camera("door", Vec3::new(0.0, 0.0, 0.95), 1.1)
}

#[test]
fn each_kind_of_lamp_that_became_movable_leaves_the_picture_of_it_alone_as_it_was() {
    let (desk, glb) = (Desk::new(), three_lamps().glb());
    std::fs::write(desk.path("yard.glb"), &glb).unwrap();
    desk.json(&format!("bake @yard.glb -o @yard.transport {VIEW} --spp 256 --tolerance 50 --patches 1024"));
    let scene = prepare(&glb);
    for key in ["bulb", "spot", "distant"] {
        let compared = exchanged(&desk, "yard", &scene, key, MUTED);
        assert!(compared["psnr_db"].as_f64().unwrap() >= 40.0, "{key}: {compared}");
    }
}

const FRAME: Film = Film { width: 32, height: 24 };

/// A room and its bake with patches, made once for all tests.
static BAKED: LazyLock<(Arc<PreparedScene>, Bake)> = LazyLock::new(|| {
    let scene = prepare(&two_lamps_and_a_panel().glb());
    let bake = baked(&scene, FRAME, BakeConfig { spp: 32, patches: 256, ..BakeConfig::default() });
    (scene, bake)
});

/// The same, and what its pixels see.
struct Baked {
    scene: &'static PreparedScene,
    bake: &'static Bake,
    relighter: CpuRelighter,
    points: VisiblePoints,
}

impl Baked {
    fn new() -> Baked {
        let (scene, bake) = &*BAKED;
        let narrow_alpha = bake.header.patches.as_ref().unwrap().narrow_alpha();
        let config = VisibleConfig { samples: 8, narrow_alpha, ..VisibleConfig::default() };
        let points = VisiblePoints::new(scene, &scene.scene.cameras[0], FRAME, config, &|| false).unwrap();
        let relighter = CpuRelighter::new(&frame(bake)).unwrap();
        Baked { scene, bake, relighter, points }
    }

    /// What the light of lamps becomes on its further way.
    fn indirect(&mut self, lamps: &PreparedLamps) -> Vec<f32> {
        let header = &self.bake.header;
        let mut coefficients = header.coefficients(&LightRig::default());
        coefficients.iter_mut().flatten().for_each(|rgb| *rgb = [0.0; 3]);
        let (patches, bounces) = (header.patches.as_ref().unwrap(), header.config.bounces);
        *coefficients.last_mut().unwrap() = lamps.light_on_patches(self.scene, patches, bounces);
        let mut indirect = Radiance::default();
        self.relighter.relight(&coefficients, &mut indirect).unwrap();
        indirect.pixels.into_flattened()
    }

    /// The mean of the first passes of their direct light.
    fn direct(&self, lamps: &PreparedLamps, n_passes: u32) -> Vec<f32> {
        let mut direct = vec![0.0; 3 * FRAME.n_pixels()];
        for pass in 0..n_passes {
            let picture = self.points.direct(self.scene, lamps, pass, &|| false).unwrap();
            direct.iter_mut().zip(picture.as_flattened()).for_each(|(sum, value)| *sum += value / n_passes as f32);
        }
        direct
    }
}

/// A lamp at a place that shines towards another.
fn placed(shape: LampShape, [position, aim]: [Vec3; 2]) -> PreparedLamps {
    let (unit, setting) = (LampUnit::Lumen, LightSetting::default());
    let (key, strength, turn_rad, replaces) = ("l".into(), 20.0, 0.0, None);
    let lamp = FreeLamp { key, shape, position, aim, strength, unit, setting, turn_rad, replaces };
    PreparedLamps::new(&[lamp], None).unwrap().0
}

/// The largest steps from one picture of a path to the next.
#[derive(Debug)]
struct Steps {
    /// Of a whole picture, as a share of it.
    whole: f32,
    /// Of a pixel, as a share of the brightest one that most pictures have.
    pixel: f32,
    /// The same of a pixel that is lit before and after.
    lit: f32,
}

impl Steps {
    fn of(frames: &[Vec<f32>]) -> Steps {
        let mut peaks: Vec<f32> = frames.iter().map(|frame| frame.iter().copied().fold(0.0, f32::max)).collect();
        peaks.sort_by(f32::total_cmp);
        let peak = peaks[peaks.len() / 2];
        let size = |values: &[f32]| values.iter().map(|value| value * value).sum::<f32>().sqrt();
        let mut most = Steps { whole: 0.0, pixel: 0.0, lit: 0.0 };
        for pair in frames.windows(2) {
            let values = || pair[0].iter().zip(&pair[1]);
            let steps: Vec<f32> = values().map(|(before, after)| (after - before).abs()).collect();
            most.whole = most.whole.max(size(&steps) / size(&pair[0]));
            for (step, (before, after)) in steps.iter().zip(values()) {
                most.pixel = most.pixel.max(step / peak);
                if *before > 0.0 && *after > 0.0 {
                    most.lit = most.lit.max(step / peak);
                }
            }
        }
        most
    }
}

#[test]
fn while_a_lamp_moves_continuously_the_picture_moves_continuously() {
    let mut room = Baked::new();
    // Across the room, over the block and close by the wall, half a centimeter a frame.
    let frame = |nth: u32| {
        let x = 0.005 * nth as f32 - 0.75;
        let position = Vec3::new(x, -0.2 + 0.1 * (3.0 * x).sin(), -0.3);
        let lamps = placed(LampShape::Disk { radius_m: 0.1 }, [position, position - Vec3::Y]);
        (room.indirect(&lamps), room.direct(&lamps, 32))
    };
    let (indirect, direct): (Vec<_>, Vec<_>) = (0..300).map(frame).unzip();
    for (frames, most, what) in [(indirect, 0.05, "indirect"), (direct, 0.15, "direct")] {
        let steps = Steps::of(&frames);
        println!("{what}: {steps:.4?}");
        assert!(steps.whole < most, "{what}: {steps:.4?}");
    }
}

#[test]
fn what_a_drag_shows_moves_as_the_lamp_does() {
    let mut room = Baked::new();
    for shape in [
        LampShape::Point,
        LampShape::Spot { inner_rad: 0.3, outer_rad: 0.7 },
        LampShape::Rectangle { size_m: [0.3, 0.2] },
        LampShape::Sphere { radius_m: 0.1 },
    ] {
        // Above what the eye sees, as a body is brighter than all that it lights; half a centimeter a frame.
        let frame = |nth: u32| {
            let x = 0.005 * nth as f32 - 0.75;
            let position = Vec3::new(x, 0.65 + 0.05 * (3.0 * x).sin(), 0.5);
            let lamps = placed(shape.clone(), [position, position - Vec3::Y - Vec3::Z]);
            (room.indirect(&lamps), room.direct(&lamps, 1))
        };
        let (indirect, direct): (Vec<Vec<f32>>, Vec<Vec<f32>>) = (0..150).map(frame).unzip();
        let sum = |(a, b): (&Vec<f32>, &Vec<f32>)| a.iter().zip(b).map(|(a, b)| a + b).collect::<Vec<f32>>();
        let both: Vec<Vec<f32>> = indirect.iter().zip(&direct).map(sum).collect();
        assert!(both.iter().flatten().all(|value| value.is_finite()), "{shape:?}");
        let [indirect, direct, both] = [indirect, direct, both].map(|frames| Steps::of(&frames));
        println!("{shape:?}: indirect {indirect:.4?}, direct {direct:.4?}, both {both:.4?}");
        // Light that comes by way of surfaces has no edges.
        assert!(indirect.whole < 0.05 && indirect.pixel < 0.1, "{shape:?}, indirect: {indirect:.4?}");
        // A pass has the same random numbers in each frame: what is lit before and after follows distance and angle alone. Where the edge
        // of a shadow comes by, all light of a pixel comes or goes, but no more than that, and of few pixels at once.
        assert!(direct.lit < 0.1 && direct.pixel < 1.5, "{shape:?}, direct: {direct:.4?}");
        assert!(direct.whole < 0.15, "{shape:?}, direct: {direct:.4?}");
        assert!(both.pixel < 1.5 && both.whole < 0.15, "{shape:?}, both: {both:.4?}");
    }
}
