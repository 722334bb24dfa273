use std::sync::{Arc, LazyLock};

use clerestory_relight::Tone;
use clerestory_transport::bake::{Bake, BakeConfig, BakeJob, Passes};
use clerestory_transport::camera::Film;
use clerestory_transport::emitters::SkyRequest;
use clerestory_transport::import;
use clerestory_transport::irradiance::IrradianceRows;
use clerestory_transport::lamps::{FreeLamp, LampShape, LampUnit, PreparedLamps};
use clerestory_transport::light::{LightRig, LightSetting};
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::sensors::SensorGrid;
use clerestory_transport::sky::{SkyForm, SkySetting};
use glam::Vec3;
use serde_json::{Value, json};

use super::*;
use crate::cli::relight::Relighter;
use crate::export::{ExportOptions, Picture};
use crate::illuminance::{AddedLux, LuxFigures, of_grid, seen_irradiance};
use crate::look::sky::{remade, typed};
use crate::look::{Look, Units};
use crate::marks::Marks;
use crate::support::ROOM;

const FILM: Film = Film { width: 32, height: 24 };

/// The closed room of the process tests with three lamps: left, right, and a dim one at the back.
static ROOM_BAKED: LazyLock<Bake> = LazyLock::new(|| {
    let scene = prepared();
    let camera = scene.scene.cameras[0].clone();
    // As it was sampled: grain tells two lights apart, and what is found is held against what went in to 3 %.
    let config = BakeConfig { spp: 16, tolerance_db: 60.0, denoise: false, ..BakeConfig::default() };
    let irradiance = vec![IrradianceRows::Pixels, IrradianceRows::Grid(table())];
    let job = BakeJob { scene, camera, film: FILM, config, passes: Passes::FinalOnly, irradiance };
    job.run(|_| std::ops::ControlFlow::Continue(())).unwrap().unwrap()
});

fn prepared() -> Arc<PreparedScene> {
    let mut gltf: Value = serde_json::from_str(ROOM).unwrap();
    for (name, x, z, light) in [("right", 0.8, 0.3, 0), ("back", 0.0, -0.8, 1)] {
        let lamp =
            json!({"name": name, "translation": [x, 0.5, z], "extensions": {"KHR_lights_punctual": {"light": light}}});
        let nodes = gltf["nodes"].as_array_mut().unwrap();
        nodes.push(lamp);
        let number = nodes.len() - 1;
        gltf["scenes"][0]["nodes"].as_array_mut().unwrap().push(json!(number));
    }
    let lights = gltf["extensions"]["KHR_lights_punctual"]["lights"].as_array_mut().unwrap();
    lights.push(json!({"type": "point", "intensity": 1.0, "color": [1.0, 0.8, 0.6]}));
    let scene = import::load_bytes("room", &serde_json::to_vec(&gltf).unwrap()).unwrap().scene;
    Arc::new(PreparedScene::new(scene, &[]).unwrap().0)
}

/// Sensors in the middle of the room.
fn table() -> SensorGrid {
    let (origin, u_edge, v_edge) = (Vec3::new(-0.3, 0.0, -0.3), 0.6 * Vec3::X, 0.6 * Vec3::Z);
    SensorGrid { name: "table".into(), origin, u_edge, v_edge, normal: Vec3::Y, size: [4, 3], left_out: vec![0] }
}

fn at(rig: LightRig) -> Scene {
    Scene { bake: ROOM_BAKED.clone(), rig, lamps: Vec::new(), seen: None }
}

fn wish(place: Place, target: Target) -> Wish {
    Wish { name: "here".into(), place, target, weight: 1.0 }
}

fn corner() -> Place {
    Place::Marks(Arc::new(Marks::rect(FILM, [[0.0, 0.0], [12.0, 12.0]])))
}

fn of(wishes: Vec<Wish>) -> Request {
    Request { wishes, ..Request::default() }
}

/// Mean illuminance over the corner, relit.
fn lux(bake: &Bake, rig: &LightRig) -> f64 {
    let picture = seen_irradiance(bake, rig, &AddedLux::default()).unwrap();
    mean(&picture.pixels, 12)
}

/// Mean luminance of the corner, relit.
fn nit(bake: &Bake, rig: &LightRig) -> f64 {
    let picture = Relighter::new(bake, rig, None).unwrap().relight(&bake.header.coefficients(rig)).unwrap();
    mean(&picture.pixels, 12)
}

fn mean(pixels: &[[f32; 3]], side: usize) -> f64 {
    let pixels = (0..side).flat_map(|y| (0..side).map(move |x| pixels[y * 32 + x]));
    let sum: f64 = pixels.map(|rgb| rows::luminance(rgb.map(f64::from))).sum();
    sum / (side * side) as f64
}

#[test]
fn a_wish_for_lux_is_what_the_relit_picture_then_has() {
    let scene = at(LightRig::default());
    let before = lux(&scene.bake, &scene.rig);
    for times in [0.25, 3.0] {
        let wanted = times * before;
        let solved = solve(&scene, &of(vec![wish(corner(), Target::Illuminance(wanted))])).unwrap();
        let (told, relit) = (&solved.outcomes[0], lux(&scene.bake, &solved.rig));
        assert!(
            (told.before / before - 1.0).abs() < 1e-3 && (told.reached / relit - 1.0).abs() < 1e-3,
            "{told:?} {relit}"
        );
        assert!(told.is_met && (relit / wanted - 1.0).abs() < 0.02, "{relit} of {wanted}");
        assert!(solved.misfit < 0.02 && solved.changes.len() == 3);
    }
}

#[test]
fn wishes_for_luminance_and_for_times_as_bright_are_met_together() {
    let scene = at(LightRig::default());
    let right = Place::Marks(Arc::new(Marks::rect(FILM, [[20.0, 0.0], [32.0, 24.0]])));
    let wanted = 1.5 * nit(&scene.bake, &scene.rig);
    let wishes = vec![wish(corner(), Target::Luminance(wanted)), wish(right, Target::Times(1.2))];
    let solved = solve(&scene, &of(wishes)).unwrap();
    assert!((nit(&scene.bake, &solved.rig) / wanted - 1.0).abs() < 0.02);
    assert!(solved.outcomes.iter().all(|outcome| outcome.is_met), "{}", solved.words(&Look::default()));
    assert!((solved.outcomes[1].wanted / solved.outcomes[1].before - 1.2).abs() < 1e-9);
}

#[test]
fn a_wish_for_sensors_counts_a_free_lamp_at_each_of_them() {
    let mut scene = at(LightRig::default());
    let setting = LightSetting { intensity: 2.0, ..LightSetting::default() };
    let (position, aim) = (Vec3::new(0.2, 0.6, 0.1), Vec3::ZERO);
    let (shape, unit) = (LampShape::Point, LampUnit::Candela);
    scene.rig.lamps = vec![FreeLamp {
        key: "new".into(),
        shape,
        position,
        aim,
        strength: 3.0,
        unit,
        setting,
        turn_rad: 0.0,
        replaces: None,
    }];
    let stage = prepared();
    let lit = |rig: &LightRig| PreparedLamps::new(&rig.lit_lamps(), None).unwrap().0;
    let dark: AtPixel = Arc::new(|_| Vec3::ZERO);
    let at_point = at_point(stage.clone(), lit(&scene.rig), None);
    scene.lamps =
        vec![LampColumn { key: "new".into(), direct: dark, arriving: None, at_point, of_patches: Vec::new() }];
    let (set, grid) = scene.bake.grids().next().unwrap();
    let lux = |rig: &LightRig| {
        let added = AddedLux::of_lamps(&scene.bake, stage.clone(), lit(rig));
        let points = of_grid(&scene.bake, (set, grid), (rig, &added)).unwrap();
        LuxFigures::of(points.iter().map(|(_, lux)| (f64::from(*lux), 1.0))).average
    };
    let before = lux(&scene.rig);
    let request = Request {
        lights: Some(vec!["new".into()]),
        ..of(vec![wish(Place::Grid(set), Target::Illuminance(1.5 * before))])
    };
    let solved = solve(&scene, &request).unwrap();
    let told = &solved.outcomes[0];
    assert!((told.before / before - 1.0).abs() < 1e-3, "{} {before}", told.before);
    assert!(told.is_met && (lux(&solved.rig) / told.reached - 1.0).abs() < 1e-3, "{}", solved.words(&Look::default()));
    assert!(solved.rig.own_setting("new").intensity > 2.0);
}

#[test]
fn what_cannot_be_is_told_with_what_can() {
    let scene = at(LightRig::default());
    let before = lux(&scene.bake, &scene.rig);
    let request = Request { bounds: [0.0, 2.0], ..of(vec![wish(corner(), Target::Illuminance(50.0 * before))]) };
    let solved = solve(&scene, &request).unwrap();
    let told = &solved.outcomes[0];
    assert!(!told.is_met && told.remark.as_ref().unwrap().contains("cannot be reached"), "{told:?}");
    assert!((told.reached / (2.0 * before) - 1.0).abs() < 1e-3, "{told:?} against {before}");
    assert!(solved.changes.iter().all(|change| change.at_bound == Some(1)));
    // A light that stays sets the least there is.
    let request = Request { lights: Some(vec!["back".into()]), ..of(vec![wish(corner(), Target::Illuminance(0.0))]) };
    let solved = solve(&scene, &request).unwrap();
    assert!(solved.outcomes[0].remark.as_ref().unwrap().contains("whatever these lights do"), "{:?}", solved.outcomes);
    assert_eq!(solved.rig.lights.keys().collect::<Vec<_>>(), ["back"]);
}

#[test]
fn a_picture_under_other_lights_is_matched_whatever_its_size_and_exposure() {
    let scene = at(LightRig::default());
    let mut secret = LightRig::default();
    for (key, intensity) in [("lamp", 0.4), ("right", 1.6), ("back", 3.0)] {
        secret.lights.insert(key.into(), LightSetting { intensity, ..LightSetting::default() });
    }
    let picture =
        Relighter::new(&scene.bake, &secret, None).unwrap().relight(&scene.bake.header.coefficients(&secret)).unwrap();
    // Twice as large, an eighth as bright, with something in front that is not in the scene.
    let large = |y: usize, x: usize| {
        let is_chair = (30..46).contains(&y) && (10..22).contains(&x);
        if is_chair { [0.9, 0.0, 0.3] } else { picture.pixels[y / 2 * 32 + x / 2].map(|v| v / 8.0) }
    };
    let pixels = (0..48).flat_map(|y| (0..64).map(move |x| (y, x))).map(|(y, x)| large(y, x)).collect();
    let target = Arc::new(TargetPicture::of("photo", [64, 48], pixels));
    let ratio = |rig: &LightRig, a: &str, b: &str| rig.lights[a].intensity / rig.lights[b].intensity;
    let solved =
        solve(&scene, &of(vec![wish(Place::Whole, Target::Picture(target.clone(), Exposure::Ev(-3.0)))])).unwrap();
    for (key, setting) in &secret.lights {
        let found = solved.rig.lights[key].intensity;
        assert!((found / setting.intensity - 1.0).abs() < 0.05, "{key}: {found} is not {}", setting.intensity);
    }
    // Without the exposure only what lights are to each other can be told.
    let solved = solve(&scene, &of(vec![wish(Place::Whole, Target::Picture(target, Exposure::Free))])).unwrap();
    for (a, b) in [("lamp", "right"), ("back", "right")] {
        let (found, wanted) = (ratio(&solved.rig, a, b), ratio(&secret, a, b));
        assert!((found / wanted - 1.0).abs() < 0.05, "{a} over {b}: {found} is not {wanted}");
    }
    assert!(solved.outcomes[0].reached < 5.0 && solved.outcomes[0].before > 10.0, "{:?}", solved.outcomes);
}

#[test]
fn cells_are_held_against_a_picture_pixel_by_pixel_where_areas_are_known_too() {
    let mut scene = at(LightRig::default());
    let stage = prepared();
    scene.seen = Some(Arc::new(Seen::new(&stage, &stage.scene.cameras[0], FILM)));
    let unknowns = lights::unknowns(&scene, &Request::default()).unwrap();
    let rows = rows::Rows::new(&scene, &unknowns);
    let coefficients = scene.bake.header.coefficients(&scene.rig);
    let picture = Relighter::new(&scene.bake, &scene.rig, None).unwrap().relight(&coefficients).unwrap();
    // At the rim of the picture walls are nearer, and seen at a flatter angle, than in its middle.
    let left: Vec<u32> = (0..24).flat_map(|y| (0..4).map(move |x| 32 * y + x)).collect();
    let parts = [left, (0..32 * 24).collect()];
    for (pixels, row) in parts.iter().zip(rows.radiances(&parts).unwrap()) {
        let shares: f64 = row.shares.iter().map(|share| rows::luminance(*share)).sum();
        let told = rows::luminance(row.fixed) + shares;
        let shown = |pixel: &u32| rows::luminance(picture.pixels[*pixel as usize].map(f64::from));
        let shown = pixels.iter().map(shown).sum::<f64>() / pixels.len() as f64;
        assert!((told / shown - 1.0).abs() < 1e-3, "{told} is not {shown}");
    }
}

/// The room without ceiling, front and back, baked under a sun that stands elsewhere now.
fn under_a_moved_sun() -> Scene {
    let gltf = ROOM.replace("\"count\": 36", "\"count\": 18");
    let imported = import::load_bytes("court", gltf.as_bytes()).unwrap();
    let sky = |place: &str| remade(&SkySetting::default(), typed(place).unwrap()).unwrap();
    let request = SkyRequest { light: sky("sun:200,50").light(None).unwrap(), form: SkyForm::Patches(1) };
    let scene = Arc::new(PreparedScene::with_sky(imported.scene, &[], Some(&request)).unwrap().0);
    let camera = scene.scene.cameras[0].clone();
    let config = BakeConfig { spp: 8, tolerance_db: 60.0, ..BakeConfig::default() };
    let irradiance = vec![IrradianceRows::Pixels];
    let job = BakeJob { scene, camera, film: FILM, config, passes: Passes::FinalOnly, irradiance };
    let bake = job.run(|_| std::ops::ControlFlow::Continue(())).unwrap().unwrap();
    Scene { bake, rig: LightRig { sky: Some(sky("sun:170,50")), ..LightRig::default() }, lamps: Vec::new(), seen: None }
}

#[test]
fn what_a_moved_sun_brings_goes_with_that_sun_alone() {
    let mut scene = under_a_moved_sun();
    let turned = |intensity| LightSetting { intensity, ..LightSetting::default() };
    scene.rig.set("sun", turned(0.5));
    let request = Request { lights: Some(vec!["sky".into(), "sun".into()]), ..Request::default() };
    let unknowns = lights::unknowns(&scene, &request).unwrap();
    let rows = rows::Rows::new(&scene, &unknowns);
    let pixels: Vec<u32> = (0..12).flat_map(|y| (0..12).map(move |x| 32 * y + x)).collect();
    let (seen, arriving) = (rows.radiance(&pixels).unwrap(), rows.irradiance(&pixels).unwrap());
    assert!([&seen, &arriving].iter().all(|row| row.shares.iter().all(|share| rows::luminance(*share) > 1.0)));
    for (sky, sun) in [(1.0, 0.5), (3.0, 0.1), (0.1, 2.0)] {
        let mut rig = scene.rig.clone();
        rig.set("sky", turned(sky));
        rig.set("sun", turned(sun));
        let told = |row: &rows::Row| -> f64 {
            let of = |(unknown, share): (&lights::Unknown, &[f64; 3])| {
                f64::from(rig.setting(&unknown.key).intensity) * rows::luminance(*share)
            };
            rows::luminance(row.fixed) + unknowns.iter().zip(&row.shares).map(of).sum::<f64>()
        };
        for (told, relit) in [(told(&seen), nit(&scene.bake, &rig)), (told(&arriving), lux(&scene.bake, &rig))] {
            assert!((told / relit - 1.0).abs() < 1e-2, "{told} is not {relit} at {sky} and {sun}");
        }
    }
}

#[test]
fn large_factors_are_found_as_small_ones_are() {
    let scene = at(LightRig::default());
    for planted in [[27.2, 0.0, 99.3], [1000.0, 0.0, 3650.0]] {
        let most: f32 = planted[2];
        let mut secret = LightRig::default();
        for (key, intensity) in ["lamp", "right", "back"].into_iter().zip(planted) {
            secret.lights.insert(key.into(), LightSetting { intensity, ..LightSetting::default() });
        }
        let coefficients = scene.bake.header.coefficients(&secret);
        let picture = Relighter::new(&scene.bake, &secret, None).unwrap().relight(&coefficients).unwrap();
        let target = Arc::new(TargetPicture::of("bright", [32, 24], picture.pixels));
        let wishes = vec![wish(Place::Whole, Target::Picture(target, Exposure::Ev(0.0)))];
        let solved = solve(&scene, &Request { bounds: [0.0, 1e6], ..of(wishes) }).unwrap();
        for (key, setting) in &secret.lights {
            let (found, planted) = (solved.rig.lights[key].intensity, setting.intensity);
            assert!((found - planted).abs() <= 0.01 * planted + 2e-3 * most, "{key}: {found} is not {planted}");
        }
    }
    // And so it is of a mean.
    let wanted = 5000.0 * lux(&scene.bake, &scene.rig);
    let wishes = vec![wish(corner(), Target::Illuminance(wanted))];
    let solved = solve(&scene, &Request { bounds: [0.0, 1e6], keep: 0.0, ..of(wishes) }).unwrap();
    assert!((solved.outcomes[0].reached / wanted - 1.0).abs() < 1e-3, "{:?}", solved.outcomes);
}

#[test]
fn a_black_picture_is_met_by_darkness_and_told_in_words() {
    let scene = at(LightRig::default());
    for pixel in [[0.0; 3], [-1.0; 3]] {
        let target = Arc::new(TargetPicture::of("night", [32, 24], vec![pixel; 32 * 24]));
        let solved = solve(&scene, &of(vec![wish(Place::Whole, Target::Picture(target, Exposure::Ev(0.0)))])).unwrap();
        assert!(solved.changes.iter().all(|change| change.after.intensity < 1e-6), "{:?}", solved.changes);
        let told = &solved.outcomes[0];
        assert!(
            told.is_met && (told.before - 100.0).abs() < 1e-9 && told.reached < 1e-3 && solved.misfit < 1e-5,
            "{told:?}"
        );
        assert!(told.words().contains("it is black"), "{}", told.words());
    }
}

#[test]
fn a_png_is_matched_through_its_tone_curve() {
    let scene = at(LightRig::default());
    let mut secret = LightRig::default();
    for (key, intensity) in [("lamp", 0.5), ("right", 1.5), ("back", 2.0)] {
        secret.lights.insert(key.into(), LightSetting { intensity, ..LightSetting::default() });
    }
    let radiance =
        Relighter::new(&scene.bake, &secret, None).unwrap().relight(&scene.bake.header.coefficients(&secret)).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("evening.png");
    let look = Look { lights: secret.clone(), ..Look::default() };
    assert_eq!(look.display.tone, Tone::Agx);
    let picture =
        Picture { radiance: &radiance, layers: &[], irradiance: None, look: &look, units: Units::Photometric };
    picture.save(&path, &ExportOptions::default()).unwrap();
    let intensity = |target: Target, key: &str| {
        let rig = solve(&scene, &of(vec![wish(Place::Whole, target)])).unwrap().rig;
        rig.setting(key).intensity / rig.setting("right").intensity * 1.5
    };
    let misses = |target: &Target| {
        let miss = |(key, setting): (&String, &LightSetting)| intensity(target.clone(), key) / setting.intensity - 1.0;
        secret.lights.iter().map(miss).fold(0.0f32, |most, miss| most.max(miss.abs()))
    };
    // It says how it was shown: its numbers are nit.
    let told = parse::picture(&path, None, None).unwrap();
    assert!(matches!(&told, Target::Picture(_, Exposure::Ev(0.0))), "{told:?}");
    assert!(misses(&told) < 0.05, "{}", misses(&told));
    let said = parse::picture(&path, None, Some(Tone::Agx)).unwrap_err().to_string();
    assert!(said.contains("`tone` changes nothing"), "{said}");
    let rig = solve(&scene, &of(vec![wish(Place::Whole, told)])).unwrap().rig;
    assert!((rig.lights["right"].intensity / 1.5 - 1.0).abs() < 0.05, "{rig:?}");
    // A program that throws such words away leaves the exposure to be found, and the curve to be named.
    image::open(&path).unwrap().save(&path).unwrap();
    let named = parse::picture(&path, None, Some(Tone::Agx)).unwrap();
    assert!(misses(&named) < 0.05, "{}", misses(&named));
    let plain = parse::picture(&path, None, None).unwrap();
    assert!(misses(&plain) > 0.1, "without its curve it is another picture: {}", misses(&plain));
}

#[test]
fn what_is_kept_has_no_outcome_and_wishes_of_one_name_have_their_own_weights() {
    let scene = at(LightRig::default());
    let picture = Relighter::new(&scene.bake, &scene.rig, None)
        .unwrap()
        .relight(&scene.bake.header.coefficients(&scene.rig))
        .unwrap();
    let target = Arc::new(TargetPicture::of("photo", [32, 24], picture.pixels));
    let matched = Wish { name: "photo".into(), ..wish(Place::Whole, Target::Picture(target, Exposure::Ev(0.0))) };
    let solved = solve(&scene, &of(vec![wish(corner(), Target::Keep), matched])).unwrap();
    let names: Vec<&str> = solved.outcomes.iter().map(|outcome| outcome.name.as_str()).collect();
    assert_eq!(names, ["photo"]);
    // Two wishes for the same place, of which one cannot be: the weightier one rules, and the misfit is by its weight.
    let twice = |weights: [f64; 2]| {
        let wishes = [1.0, 3.0].into_iter().zip(weights);
        let wishes = wishes.map(|(times, weight)| Wish { weight, ..wish(corner(), Target::Times(times)) });
        solve(&scene, &of(wishes.collect())).unwrap()
    };
    let (low, high) = (twice([1e4, 1.0]), twice([1.0, 1e4]));
    assert!(low.outcomes[0].is_met && !low.outcomes[1].is_met, "{}", low.words(&Look::default()));
    assert!(high.outcomes[1].is_met && !high.outcomes[0].is_met, "{}", high.words(&Look::default()));
    assert!(low.misfit < 0.02 && high.misfit < 0.03, "{} {}", low.misfit, high.misfit);
}

#[test]
fn colors_are_found_and_stay_within_the_saturation() {
    let scene = at(LightRig::default());
    let mut secret = LightRig::default();
    let blue = LightSetting { color: Some([0.3, 0.6, 1.0]), ..LightSetting::default() };
    secret.lights.insert("right".into(), blue);
    let picture =
        Relighter::new(&scene.bake, &secret, None).unwrap().relight(&scene.bake.header.coefficients(&secret)).unwrap();
    let target = Arc::new(TargetPicture::of("blue", [32, 24], picture.pixels));
    let asked = |most_saturation| {
        let wishes = vec![wish(Place::Whole, Target::Picture(target.clone(), Exposure::Ev(0.0)))];
        let request = Request { freedom: Freedom::Color { most_saturation }, ..of(wishes) };
        let rig = solve(&scene, &request).unwrap().rig;
        let setting = rig.lights["right"];
        setting.color.unwrap().map(|c| c * setting.intensity)
    };
    for (found, wanted) in asked(1.0).into_iter().zip([0.3, 0.6, 1.0]) {
        assert!((found - wanted).abs() < 0.03, "{found} is not {wanted}");
    }
    let [r, _, b] = asked(0.4);
    assert!((1.0 - r / b - 0.4).abs() < 0.02 && b > r, "{r} {b}");
}

#[test]
fn lights_whose_color_may_change_stay_within_least_and_most_as_well() {
    let scene = at(LightRig::default());
    let before = lux(&scene.bake, &scene.rig);
    let asked = |bounds: [f64; 2], times: f64| {
        let wishes = vec![wish(corner(), Target::Illuminance(times * before))];
        let freedom = Freedom::Color { most_saturation: 0.3 };
        solve(&scene, &Request { bounds, freedom, ..of(wishes) }).unwrap()
    };
    for (bounds, times, end, words) in
        [([0.5, 2.0], 0.01, 0, "whatever these lights do"), ([0.0, 1.5], 20.0, 1, "at most")]
    {
        let solved = asked(bounds, times);
        for change in &solved.changes {
            let off = f64::from(change.after.intensity) - bounds[end];
            assert!(off.abs() < 1e-5 && change.at_bound == Some(end), "{change:?}");
        }
        let (told, relit) = (&solved.outcomes[0], lux(&scene.bake, &solved.rig));
        assert!((told.reached / relit - 1.0).abs() < 1e-3, "{told:?} {relit}");
        assert!(told.remark.as_ref().is_some_and(|remark| remark.contains(words)), "{told:?}");
    }
    // What lies between is reached, and no light goes out for it.
    let solved = asked([0.5, 2.0], 0.7);
    assert!(solved.outcomes[0].is_met, "{:?}", solved.outcomes);
    assert!(solved.changes.iter().all(|change| change.after.intensity > 0.5 - 1e-5), "{:?}", solved.changes);
}

#[test]
fn muted_lights_stay_dark_and_the_present_setting_breaks_ties() {
    let mut rig = LightRig::default();
    rig.lights.insert("lamp".into(), LightSetting { muted: true, ..LightSetting::default() });
    let scene = at(rig.clone());
    let solved = solve(&scene, &of(vec![wish(corner(), Target::Times(1.0))])).unwrap();
    assert_eq!(solved.changes.len(), 2);
    assert!(
        solved.rig.lights["lamp"].muted && !solved.changes.iter().any(Change::is_change),
        "{}",
        solved.words(&Look::default())
    );
    let refused = |lights: &[&str]| {
        let lights = Some(lights.iter().map(|key| (*key).to_owned()).collect());
        solve(&scene, &Request { lights, ..of(vec![wish(corner(), Target::Times(1.0))]) }).unwrap_err().to_string()
    };
    assert!(refused(&["lamp"]).contains("muted") && refused(&["nobody"]).contains("no light is called"));
    assert!(solve(&scene, &of(vec![])).unwrap_err().to_string().contains("add a wish"));
}
