//! The sky: turned, exchanged, in patches and sharp behind the picture.

use std::ops::ControlFlow;
use std::sync::Arc;

use clerestory_relight::{CpuRelighter, Frame, Radiance, Relight};
use clerestory_transport::archive;
use clerestory_transport::bake::{Bake, BakeConfig};
use clerestory_transport::camera::Film;
use clerestory_transport::emitters::SkyRequest;
use clerestory_transport::import;
use clerestory_transport::light::{LightRig, LightSetting, luminance};
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::sky::{Backdrop, Environment, SkyForm, SkyLight, SkySetting, SunSetting};
use clerestory_transport::trace::{TraceConfig, trace};
use glam::{Vec2, Vec3};

use crate::support::{Mean, SceneFile, Shape, baked, block_means};

const FILM: Film = Film { width: 48, height: 32 };

/// A white table under the open sky with a gray box on it; half of the picture looks past them.
fn table() -> SceneFile {
    let top = Shape::quad(Vec3::new(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0);
    let block = Shape::room(Vec3::splat(0.25)).turned().moved(Vec3::new(0.2, 0.25, 0.0));
    SceneFile::default()
        .surface("top", &top, SceneFile::lambert([0.8; 3], [0.0; 3]))
        .surface("block", &block, SceneFile::lambert([0.4, 0.5, 0.6], [0.0; 3]))
        .camera("front", Vec3::new(0.0, 0.6, 2.5), 0.9)
}

/// Warm from +X, blue from above: smooth enough for patches of 12°.
fn smooth() -> Environment {
    Environment::from_fn(128, 64, |d| Vec3::new(1.0 + 0.8 * d.x, 1.0 + 0.3 * d.x, 1.0 + 0.6 * d.y) * (1.0 + 0.4 * d.z))
}

fn under(file: &SceneFile, light: SkyLight, form: SkyForm) -> Arc<PreparedScene> {
    let imported = import::load_bytes("house", &file.glb()).unwrap();
    let request = SkyRequest { light, form };
    Arc::new(PreparedScene::with_sky(imported.scene, &[], Some(&request)).unwrap().0)
}

fn traced(scene: &PreparedScene, spp: u32, seed: u64) -> Vec<[f32; 3]> {
    let coefficients = scene.lighting.basis.project(&LightRig::default());
    let config = TraceConfig { spp, bounces: None, seed };
    trace(scene, &scene.scene.cameras[0], FILM, &coefficients, &config, &|_| ControlFlow::Continue(())).unwrap()
}

fn relit(bake: &Bake, rig: &LightRig) -> Vec<[f32; 3]> {
    let frame = Frame { width: bake.header.width, height: bake.header.height, groups: bake.groups_under(rig) };
    let mut radiance = Radiance::default();
    CpuRelighter::new(&frame).unwrap().relight(&bake.header.coefficients(rig), &mut radiance).unwrap();
    radiance.pixels
}

fn config(spp: u32, seed: u64) -> BakeConfig {
    BakeConfig { spp, seed, ..BakeConfig::default() }
}

fn turned(degrees: f32) -> LightRig {
    let sky = SkySetting { rotation_deg: degrees, ..SkySetting::default() };
    LightRig { sky: Some(sky), ..LightRig::default() }
}

/// Relative differences of 8 × 8 blocks, and the noise of two pictures of either kind.
fn differences(relights: [&[[f32; 3]]; 2], traces: [&[[f32; 3]]; 2], channel: usize) -> (Vec<f64>, f64) {
    let blocks = |pixels: &[[f32; 3]]| {
        let values: Vec<f64> = pixels.iter().map(|rgb| f64::from(rgb[channel])).collect();
        block_means(&values, FILM.width as usize, 8)
    };
    let (relights, traces) = (relights.map(blocks), traces.map(blocks));
    let n = traces[0].len();
    let scale = traces[0].iter().sum::<f64>() / n as f64;
    let noise = [&relights, &traces].map(|[a, b]| (0..n).map(|i| ((a[i] - b[i]) / scale).powi(2)).sum::<f64>());
    let difference = |i: usize| (relights[0][i] + relights[1][i] - traces[0][i] - traces[1][i]) / (2.0 * scale);
    ((0..n).map(difference).collect(), ((noise[0] + noise[1]) / (4.0 * n as f64)).sqrt())
}

#[test]
fn a_turned_sky_relights_as_it_traces() {
    let file = table();
    let scene = under(&file, SkyLight::new("smooth", smooth()), SkyForm::Patches(1));
    let bakes = [1, 2].map(|seed| baked(&scene, FILM, config(32, seed)));
    for degrees in [0.0, 115.0] {
        let light = SkyLight { rotation_deg: degrees, ..SkyLight::new("smooth", smooth()) };
        let exact = under(&file, light, SkyForm::Whole);
        let traces = [3, 4].map(|seed| traced(&exact, 64, seed));
        let relights = [0, 1].map(|i: usize| relit(&bakes[i], &turned(degrees)));
        for channel in 0..3 {
            let (differences, sigma) = differences([&relights[0], &relights[1]], [&traces[0], &traces[1]], channel);
            println!("{degrees}° channel {channel}: {:?}, sigma {sigma:.5}", Mean::of(differences.iter().copied()));
            // Patches of 12° average a smooth map to within half a percent.
            Mean::of(differences.iter().copied()).assert_is(0.0, 5e-3, 1e-2);
            let worst = differences.iter().map(|d| d.abs()).fold(0.0, f64::max);
            assert!(sigma < 0.02 && worst < 6.0 * sigma + 0.015, "a block is off by {worst}, its noise is {sigma}");
        }
    }
}

/// A room without its wall behind the camera.
fn open_room() -> SceneFile {
    let room = Shape::room(Vec3::ONE);
    let is_inside = |triangle: &[Vec3]| triangle.iter().any(|corner| corner.z < 0.0);
    let corners = room.corners.chunks_exact(3).filter(|triangle| is_inside(triangle)).flatten().copied().collect();
    SceneFile::default().surface("room", &Shape { corners }, SceneFile::lambert([0.7, 0.6, 0.5], [0.0; 3])).camera(
        "front",
        Vec3::new(0.0, 0.0, 0.9),
        1.1,
    )
}

#[test]
fn patches_that_no_window_shows_are_left_out_and_no_light_is_lost() {
    let scene = under(&open_room(), SkyLight::new("smooth", smooth()), SkyForm::Patches(1));
    let bakes = [1, 2].map(|seed| baked(&scene, FILM, config(32, seed)));
    let skipped = bakes[0].figures().skipped.sky_patches;
    assert!((100..250).contains(&skipped), "half of the sky is behind walls, and {skipped} patches were skipped");
    let exact = under(&open_room(), SkyLight::new("smooth", smooth()), SkyForm::Whole);
    let traces = [3, 4].map(|seed| traced(&exact, 64, seed));
    let relights = [0, 1].map(|i: usize| relit(&bakes[i], &LightRig::default()));
    let (differences, sigma) = differences([&relights[0], &relights[1]], [&traces[0], &traces[1]], 1);
    println!("{skipped} patches skipped: {:?}, sigma {sigma:.5}", Mean::of(differences.iter().copied()));
    Mean::of(differences.iter().copied()).assert_is(0.0, 5e-3, 1e-2);
    let worst = differences.iter().map(|d| d.abs()).fold(0.0, f64::max);
    assert!(sigma < 0.03 && worst < 6.0 * sigma + 0.015, "a block is off by {worst}, its noise is {sigma}");
}

#[test]
fn a_white_body_under_a_uniform_sky_of_patches_is_as_bright_as_the_sky() {
    let ball = Shape::hollow_sphere(1.0, 24).turned();
    let white = SceneFile::lambert([1.0; 3], [0.0; 3]);
    let file = SceneFile::default().surface("ball", &ball, white).camera("outside", Vec3::new(0.0, 0.0, 3.0), 0.5);
    for form in [SkyForm::Patches(1), SkyForm::Whole] {
        let sky = SkyLight::new("uniform", Environment::uniform(Vec3::new(1.0, 2.0, 3.0)));
        let scene = under(&file, sky, form);
        let pixels = match form {
            SkyForm::Whole => traced(&scene, 64, 3),
            SkyForm::Patches(_) => relit(&baked(&scene, FILM, config(64, 1)), &LightRig::default()),
        };
        for channel in 0..3 {
            let expected = f64::from(channel as u8 + 1);
            let mean = Mean::of(pixels.iter().map(|rgb| f64::from(rgb[channel])));
            mean.assert_is(expected, 5e-3 * expected, 1e-2 * expected);
        }
    }
}

#[test]
fn the_sky_behind_the_picture_is_sharp_and_another_map_takes_its_place() {
    // Stripes far finer than patches, above the table.
    let stripes = |k: f32| {
        Environment::from_fn(1024, 512, move |d| Vec3::splat(if (k * d.z.atan2(d.x)).sin() > 0.0 { 2.0 } else { 0.1 }))
    };
    let file = table();
    let scene = under(&file, SkyLight::new("a", stripes(60.0)), SkyForm::Patches(1));
    let bake = baked(&scene, FILM, config(16, 1));
    let other = SkySetting { file: Some("b".into()), map: Some(Arc::new(stripes(45.0))), ..SkySetting::default() };
    let rigs = [LightRig::default(), LightRig { sky: Some(other), ..LightRig::default() }];
    for (rig, map) in rigs.iter().zip([stripes(60.0), stripes(45.0)]) {
        let exact = traced(&under(&file, SkyLight::new("exact", map), SkyForm::Whole), 256, 5);
        let picture = relit(&bake, rig);
        let upper = 0..FILM.width as usize * 6;
        let difference = upper.clone().map(|i| f64::from((picture[i][1] - exact[i][1]).abs())).sum::<f64>();
        let contrast = upper.clone().map(|i| f64::from((exact[i][1] - 1.05).abs())).sum::<f64>();
        assert!(contrast > 0.3 * upper.len() as f64, "the stripes are there");
        // Nine samples of a pixel on either side of an edge.
        assert!(difference < 0.1 * contrast, "{difference} of {contrast}");
    }
}

#[test]
fn the_sun_has_the_illuminance_that_it_is_said_to_have() {
    // A white table of 0.8 under a sun alone: 0.8 / π · E · sin(elevation).
    let top = Shape::quad(Vec3::new(-9.0, 0.0, 9.0), Vec3::X * 18.0, Vec3::NEG_Z * 18.0);
    let file = SceneFile::default().surface("top", &top, SceneFile::lambert([0.8; 3], [0.0; 3]));
    let file = file.camera("above", Vec3::new(0.0, 0.1, 1.0), 0.5);
    let sun = SunSetting::by_angles(160.0, 30.0).sun().unwrap();
    let light = SkyLight { sun: Some(sun), ..SkyLight::new("sun", Environment::uniform(Vec3::ZERO)) };
    let expected = 0.8 / std::f32::consts::PI * sun.illuminance_lx * 30f32.to_radians().sin();
    let below = |pixels: &[[f32; 3]]| {
        let lower = &pixels[FILM.width as usize * 24..];
        lower.iter().map(|rgb| luminance(Vec3::from(*rgb)) / lower.len() as f32).sum::<f32>()
    };
    let whole = below(&traced(&under(&file, light.clone(), SkyForm::Whole), 16, 1));
    assert!((whole / expected - 1.0).abs() < 1e-2, "{whole} nit instead of {expected}");
    let scene = under(&file, light, SkyForm::Patches(1));
    let bake = baked(&scene, FILM, config(16, 1));
    let patches = below(&relit(&bake, &LightRig::default()));
    assert!((patches / expected - 1.0).abs() < 1e-2, "{patches} nit instead of {expected}");
    // Turned, it shines from its patch: its light is spread over 12° but not lost. It can be muted like a lamp.
    let turned = below(&relit(&bake, &turned(90.0)));
    assert!((turned / expected - 1.0).abs() < 0.1, "{turned} nit instead of {expected}");
    let mut dark = LightRig::default();
    dark.lights.insert("sun".into(), LightSetting { muted: true, ..LightSetting::default() });
    assert!(below(&relit(&bake, &dark)) < 1e-3 * expected);
}

/// The table baked under an even sky and a sun, a lighting that moves the sun behind the picture, and the pixel that sees it there.
fn sun_behind_the_picture() -> (Bake, LightRig, usize) {
    let even = || Environment::uniform(Vec3::splat(1000.0));
    let sun = SunSetting::by_angles(160.0, 30.0).sun().unwrap();
    let light = SkyLight { sun: Some(sun), ..SkyLight::new("sun", even()) };
    let scene = under(&table(), light, SkyForm::Patches(1));
    let [x, y] = [12u16, 3];
    let middle = Vec2::new(f32::from(x), f32::from(y)) + 0.5;
    let there = scene.scene.cameras[0].direction(FILM, middle).as_dvec3();
    let sun = SunSetting::by_angles(there.x.atan2(-there.z).to_degrees(), there.y.asin().to_degrees());
    let sky =
        SkySetting { file: Some("even".into()), map: Some(Arc::new(even())), sun: Some(sun), ..SkySetting::default() };
    let rig = LightRig { sky: Some(sky), ..LightRig::default() };
    (baked(&scene, FILM, config(8, 1)), rig, usize::from(y) * FILM.width as usize + usize::from(x))
}

#[test]
fn a_moved_sun_is_seen_and_shines_as_its_light_is_set() {
    let (bake, rig, pixel) = sun_behind_the_picture();
    let with = |key: &str, setting: LightSetting| {
        let mut rig = rig.clone();
        rig.set(key, setting);
        rig
    };
    let muted = LightSetting { muted: true, ..LightSetting::default() };
    let dimmed = with("sun", LightSetting { intensity: 0.5, ..LightSetting::default() });
    let mut no_sun = rig.clone();
    no_sun.sky.iter_mut().for_each(|sky| sky.sun = None);
    let [whole, half, without, alone] =
        [&rig, &dimmed, &with("sun", muted), &with("sky", muted)].map(|rig| relit(&bake, rig));
    assert_eq!(without, relit(&bake, &no_sun), "a muted sun is none");
    assert!(whole[pixel][1] > 1e7 && alone[pixel][1] > 1e7 && without[pixel][1] < 2e3);
    let others = whole.iter().enumerate().filter(|(idx, _)| *idx != pixel).flat_map(|(_, rgb)| rgb);
    let lit = others.copied().fold(0.0, f32::max);
    let channels = |pixels: &[[f32; 3]]| pixels.as_flattened().to_vec();
    let [whole, half, without, alone] = [whole, half, without, alone].map(|pixels| channels(&pixels));
    for (idx, all) in whole.into_iter().enumerate() {
        let off = 1e-2 * lit.max(all);
        assert!((without[idx] + alone[idx] - all).abs() < off, "{idx}: {} + {} = {all}", without[idx], alone[idx]);
        assert!((0.5 * (without[idx] + all) - half[idx]).abs() < off, "{idx}: {} of {all}", half[idx]);
    }
    let behind = |rig: &LightRig| Backdrop::new(&bake.header, rig).unwrap();
    assert!(behind(&rig).shows_the_same(&behind(&rig)) && !behind(&rig).shows_the_same(&behind(&dimmed)));
}

#[test]
fn a_bake_with_a_sky_comes_back_from_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.transport");
    let bake = baked(&under(&table(), SkyLight::new("smooth", smooth()), SkyForm::Patches(1)), FILM, config(8, 1));
    archive::write(&bake, &path).unwrap();
    let back = archive::read(&path).unwrap();
    assert_eq!(back.header, bake.header);
    let rig = turned(77.0);
    assert_eq!(relit(&back, &rig), relit(&bake, &rig));
    // A byte of the map.
    let mut bytes = std::fs::read(&path).unwrap();
    let json = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    bytes[16 + json + 500] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    assert!(archive::read(&path).unwrap_err().to_string().contains("sky"));
}
