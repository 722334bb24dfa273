//! The sky that a scene was baked under is as sharp as a traced one, although the matrix has patches of it.

use std::f64::consts::PI;
use std::ops::ControlFlow;
use std::sync::Arc;

use clerestory_nystrom::BlockLowRank;
use glam::Vec3;

use super::pictures;
use super::stage::{Stage, lambert, quad};
use crate::bake::{Bake, BakeConfig, BakeJob, Passes};
use crate::basis::LightBasis;
use crate::camera::{Camera, Film};
use crate::emitters::SkyRequest;
use crate::light::LightRig;
use crate::matrix::CHANNELS;
use crate::scene::Material;
use crate::sensors::{IrradianceRequest, NodeGrid};
use crate::sky::{Environment, SkyForm, SkyLight, SkySetting};

const FILM: Film = Film { width: 48, height: 32 };
const BLOCK: usize = 4;

/// A small sun in a dim sky.
fn light() -> SkyLight {
    let sun = Vec3::new(-0.5, 0.7, 0.3).normalize();
    let map = Environment::from_fn(256, 128, |d| {
        Vec3::splat(if d.dot(sun) > 0.9985 { 2e3 } else { 0.3 + (4.0 * d.x).sin().powi(2) })
    });
    SkyLight { rotation_deg: 75.0, ..SkyLight::new("sun", map) }
}

/// A floor that fills the picture, with a screen that throws a shadow.
fn stage() -> Stage {
    let camera = Camera::look_at("eye", Vec3::new(0.0, 2.5, 3.0), Vec3::new(0.0, 0.2, 0.0), 0.8, 1.5);
    Stage::new(camera)
        .surface("floor", &quad(Vec3::new(-9.0, 0.0, 9.0), Vec3::X * 18.0, Vec3::NEG_Z * 18.0), lambert(0.7, 0.0))
        .surface("screen", &quad(Vec3::new(-0.6, 0.0, 0.2), Vec3::X * 0.8, Vec3::Y * 0.9), lambert(0.5, 0.0))
}

/// A mirror that shows the sky, its sun beside the picture.
fn mirror() -> Stage {
    let camera = Camera::look_at("eye", Vec3::new(0.0, 0.5, 3.0), Vec3::new(0.0, 0.5, 0.0), 0.3, 1.5);
    let silver = Material { metallic: 1.0, roughness: 0.0, ..Material::default() };
    Stage::new(camera).surface("mirror", &quad(Vec3::new(-1.0, -0.5, 0.0), Vec3::X * 2.0, Vec3::Y * 2.0), silver)
}

/// Means over blocks of pixels.
fn blocks(pixels: &[f64]) -> Vec<f64> {
    let width = FILM.width as usize;
    let mut means = vec![0.0; pixels.len() / (BLOCK * BLOCK)];
    for (index, value) in pixels.iter().enumerate() {
        means[index / width / BLOCK * (width / BLOCK) + index % width / BLOCK] += value / (BLOCK * BLOCK) as f64;
    }
    means
}

fn traced(stage: Stage, setting: Option<&SkySetting>, seed: u64) -> Vec<f64> {
    let sky = setting.map_or_else(light, |setting| setting.light(Some(&light())).expect("a sky"));
    let scene = stage.prepared_under(&SkyRequest { light: sky, form: SkyForm::Whole });
    let coefficients = scene.lighting.basis.project(&LightRig::default());
    blocks(&pictures::traced(&scene, FILM, &coefficients, (256, seed)))
}

/// One bake for each of two seeds, whatever sky they are lit by.
fn baked(stage: fn() -> Stage) -> [Bake; 2] {
    let scene = Arc::new(stage().prepared_under(&SkyRequest { light: light(), form: SkyForm::Patches(1) }));
    [1, 2].map(|seed| {
        let config = BakeConfig { spp: 64, tolerance_db: 50.0, seed, ..BakeConfig::default() };
        pictures::baked(&scene, FILM, config)
    })
}

fn relit(bake: &Bake, setting: Option<&SkySetting>) -> Vec<f64> {
    let rig = LightRig { sky: setting.cloned(), ..LightRig::default() };
    blocks(&green(&bake.groups_under(&rig), bake.header.coefficients(&rig)))
}

/// Green light of each bundle of rows under one RGB coefficient per column and group.
fn green(groups: &[BlockLowRank], coefficients: Vec<Vec<[f32; 3]>>) -> Vec<f64> {
    let mut light = vec![0.0; groups[0].n_rows() / CHANNELS];
    for (group, coefficients) in groups.iter().zip(coefficients) {
        let green: Vec<f32> = coefficients.iter().map(|rgb| rgb[1]).collect();
        for (light, rows) in light.iter_mut().zip(group.apply(&green).chunks_exact(CHANNELS)) {
            *light += f64::from(rows[1]);
        }
    }
    light
}

/// Root of the squared difference over the squared picture, free of noise: differences of two independent pairs.
fn off(stage: fn() -> Stage, bakes: &[Bake; 2], setting: Option<&SkySetting>) -> f64 {
    let [first, second] = [0, 1].map(|nth| (relit(&bakes[nth], setting), traced(stage(), setting, 11 + nth as u64)));
    let (mut off, mut all) = (0.0, 0.0);
    for block in 0..first.0.len() {
        off += (first.0[block] - first.1[block]) * (second.0[block] - second.1[block]);
        all += first.1[block] * second.1[block];
    }
    f64::max(off, 0.0).sqrt() / all.sqrt()
}

#[test]
fn the_baked_sky_throws_the_shadows_of_a_traced_one() {
    let bakes = baked(stage);
    let as_baked = off(stage, &bakes, None);
    assert!(as_baked < 0.01, "{as_baked}");
    let brighter = SkySetting { rotation_deg: 75.0, intensity: 2.5, ..SkySetting::default() };
    let as_baked = off(stage, &bakes, Some(&brighter));
    assert!(as_baked < 0.01, "{as_baked}");
    // Turned, its shadows are those of patches.
    let turned = off(stage, &bakes, Some(&SkySetting { rotation_deg: 160.0, ..SkySetting::default() }));
    assert!(turned > 0.012 && turned < 0.2, "{turned}");
    let mirrored = off(mirror, &baked(mirror), None);
    assert!(mirrored < 0.01, "{mirrored}");
}

#[test]
fn a_basis_without_a_column_of_the_map_is_lit_by_patches_alone() {
    let scene = stage().prepared_under(&SkyRequest { light: light(), form: SkyForm::Patches(1) });
    let LightBasis { mut sources, sky, .. } = scene.lighting.basis.clone();
    let whole = scene.lighting.basis.project(&LightRig::default());
    sources.iter_mut().for_each(|source| source.columns.end -= 1);
    let earlier = LightBasis { sky, ..LightBasis::new(sources) }.project(&LightRig::default());
    assert_eq!((whole.len(), earlier.len()), (292, 291));
    assert!(whole[..290].iter().flatten().all(|patch| patch.abs() < 1e-2) && whole[290] == [1.0; 3]);
    assert!(earlier[..290].iter().flatten().all(|patch| *patch > 0.2) && earlier[290] == [1.0; 3]);
}

#[test]
fn factors_know_nothing_of_the_sky_that_the_camera_sees() {
    let scene = stage().prepared_under(&SkyRequest { light: light(), form: SkyForm::Patches(1) });
    let basis = &scene.lighting.basis;
    let preserved = basis.file_light(&vec![2.0; basis.n_cols()]);
    assert!((preserved[290] - 0.5).abs() < 1e-6 && preserved[291] == 0.0);
}

/// An open plane under a sun of one pixel, baked with a grid of 4 × 4 points, and the lux that it has everywhere.
fn plane_under_a_sun(spp: u32) -> (Bake, f64) {
    let (width, height) = (500, 300);
    let mut pixels = vec![[1e3; 3]; width * height];
    pixels[75 * width + 305] = [5e8; 3];
    let light = SkyLight::new("sun", Environment::new(width, height, pixels).unwrap().0).storable();
    let known = f64::from(light.level_lx()[0]);
    let camera = Camera::look_at("above", Vec3::Y * 3.0, Vec3::ZERO, 0.7, 1.0);
    let plane = quad(Vec3::new(-2.0, 0.0, 2.0), Vec3::X * 4.0, Vec3::NEG_Z * 4.0);
    let stage = Stage::new(camera.clone()).surface("plane", &plane, lambert(0.5, 0.0));
    let scene = Arc::new(stage.prepared_under(&SkyRequest { light, form: SkyForm::Patches(1) }));
    let nodes = vec![NodeGrid { node: "plane".into(), size: [4, 4] }];
    let irradiance = IrradianceRequest { nodes, ..Default::default() }.rows(&scene).unwrap();
    let config = BakeConfig { spp, tolerance_db: 50.0, ..BakeConfig::default() };
    let (film, passes) = (Film { width: 8, height: 8 }, Passes::FinalOnly);
    let job = BakeJob { scene, camera, film, config, passes, irradiance };
    (job.run(|_| ControlFlow::Continue(())).unwrap().unwrap(), known)
}

/// Lux at the points of its grid.
fn lux(bake: &Bake) -> Vec<f64> {
    green(&bake.irradiance[0], bake.header.irradiance_coefficients(0, &LightRig::default()))
}

#[test]
fn an_open_plane_under_a_sun_of_one_pixel_is_lit_evenly() {
    let (bake, known) = plane_under_a_sun(256);
    let rig = LightRig::default();
    let radiance = green(&bake.groups_under(&rig), bake.header.coefficients(&rig));
    let of_picture: Vec<f64> = radiance.into_iter().map(|nit| nit * PI / 0.5).collect();
    for (what, all) in [("points", lux(&bake)), ("pixels", of_picture)] {
        let off = all.iter().map(|lux| (lux / known - 1.0).abs()).fold(0.0, f64::max);
        assert!(off < 0.03, "{what} are up to {:.1} % off {known} lx: {all:?}", 100.0 * off);
    }
}

#[test]
fn a_grid_tells_how_far_the_light_of_the_file_is_off() {
    let (bake, known) = plane_under_a_sun(8);
    let lux = lux(&bake);
    let off = lux.iter().map(|lux| (lux / known - 1.0).powi(2)).sum::<f64>() / lux.len() as f64;
    let (told, found) = (f64::from(bake.irradiance_figures()[0].error_db.total), -10.0 * off.log10());
    // The mean over all columns, of which one has the noise, is some 24 dB better.
    assert!((told - found).abs() < 12.0, "{told} dB told, {found} dB found: {lux:?} lx for {known}");
}
