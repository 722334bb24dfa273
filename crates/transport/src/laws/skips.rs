//! What is skipped changes no picture: exactly where random numbers stay the same, else in the mean.

use std::sync::Arc;

use glam::{Quat, Vec3, Vec4};

use super::pictures;
use super::stage::{Stage, lambert, pane, quad, room};
use super::walks::{Mean, Walks, assert_same_mean, file_light};
use crate::bake::{Bake, BakeConfig, Indirect};
use crate::camera::{Camera, Film};
use crate::emitters::SkyRequest;
use crate::empty::EmptyPixels;
use crate::light::LightRig;
use crate::matrix::{CHANNELS, TransportMatrix};
use crate::path::LightPlan;
use crate::plan::{Density, MatrixPlan};
use crate::prepared::PreparedScene;
use crate::reach::dark_sources;
use crate::scene::{AlphaMode, Material, PunctualKind, Scene};
use crate::skips::{Skip, Skips};
use crate::sky::{Environment, SkyForm, SkyLight};

const FILM: Film = Film { width: 48, height: 32 };
const HALF: Vec3 = Vec3::new(1.0, 0.8, 1.2);
/// Largest standard error of a difference of means, relative to the mean: four of them, 1 %, are what a test accepts.
const SHARP: f64 = 2.5e-3;
/// Share of the light that walls scatter where means are compared: the less of it goes on, the less noise there is.
const DIM: f32 = 0.2;

fn inside() -> Camera {
    Camera::look_at("inside", Vec3::new(0.3, 0.1, 0.9), Vec3::new(-0.2, -0.3, -1.0), 1.1, 1.5)
}

fn prepared(scene: &Scene, form: Option<SkyForm>, skips: Skips) -> PreparedScene {
    let light = SkyLight::new("even", Environment::from_fn(8, 4, |_| Vec3::ONE));
    let sky = form.map(|form| SkyRequest { light, form });
    PreparedScene::with_skips(scene.clone(), &[], sky.as_ref(), skips).expect("a stage has valid lights").0
}

/// With all skips, and with one off.
fn pair(scene: &Scene, form: Option<SkyForm>, skip: Skip) -> [PreparedScene; 2] {
    [Skips::default(), Skips::default().without(skip)].map(|skips| prepared(scene, form, skips))
}

/// Green radiance under the light of the file.
fn traced(scene: &PreparedScene, spp: u32, seed: u64) -> Vec<f64> {
    traced_under(scene, &file_light(scene), (spp, seed))
}

/// The same under one weight per column.
fn traced_under(scene: &PreparedScene, weights: &[f32], samples: (u32, u64)) -> Vec<f64> {
    let coefficients: Vec<[f32; 3]> = weights.iter().map(|&w| [w; 3]).collect();
    pictures::traced(scene, FILM, &coefficients, samples)
}

/// The light of the file in two parts: of the sources that are not connected to, and of the others.
fn parted(scene: &PreparedScene, dark: &[u32]) -> [Vec<f32>; 2] {
    let (mut of_dark, mut of_others) = (file_light(scene), file_light(scene));
    for (source, light) in (0..).zip(&scene.lighting.basis.sources) {
        let off = if dark.contains(&source) { &mut of_others } else { &mut of_dark };
        off[light.columns.start as usize..light.columns.end as usize].fill(0.0);
    }
    [of_dark, of_others]
}

/// Asserts that a picture without connections to dark lights is exact: by themselves they are black, and without them the
/// picture is the same to the last bit.
fn assert_dark_lights_bring_nothing([with, without]: [&PreparedScene; 2], what: &str) {
    let dark = dark_sources(with, with.scene.cameras[0].position());
    let [of_dark, of_others] = parted(without, &dark);
    assert!(of_dark.iter().any(|weight| *weight > 0.0), "{what}: dark lights are on");
    let lit = traced_under(without, &of_dark, (16, 1)).iter().filter(|value| **value != 0.0).count();
    assert_eq!(lit, 0, "{what}: pixels that dark lights reach");
    assert!(traced(with, 16, 1) == traced_under(without, &of_others, (16, 1)), "{what}: a picture of all other lights");
}

fn baked(scene: PreparedScene, spp: u32, tolerance_db: f32) -> Bake {
    pictures::baked(&Arc::new(scene), FILM, BakeConfig { spp, tolerance_db, ..BakeConfig::default() })
}

/// Side of blocks whose means are independent of each other.
const SIDE: usize = 8;

/// A bake as exact as its samples, in such blocks, pixel by pixel as they were sampled.
fn baked_sharply(scene: &PreparedScene, spp: u32) -> Bake {
    let config = BakeConfig { spp, tolerance_db: 60.0, block: SIDE as u32, denoise: false, ..BakeConfig::default() };
    pictures::baked(&Arc::new(scene.clone()), FILM, config)
}

/// Green radiance of a bake under the light of the file, mean by mean over 8 × 8 pixels. That picture is not truncated.
fn relit(bake: &Bake) -> Vec<f64> {
    let across = FILM.width as usize / SIDE;
    let mut means = vec![0.0; FILM.n_pixels() / (SIDE * SIDE)];
    for (group, coefficients) in bake.groups.iter().zip(bake.header.coefficients(&LightRig::default())) {
        let green: Vec<f32> = coefficients.iter().map(|rgb| rgb[1]).collect();
        for (pixel, rows) in group.apply(&green).chunks_exact(CHANNELS).enumerate() {
            let (x, y) = (pixel % FILM.width as usize / SIDE, pixel / FILM.width as usize / SIDE);
            means[y * across + x] += f64::from(rows[1]) / (SIDE * SIDE) as f64;
        }
    }
    means
}

/// A box on a table, and nothing around it.
fn in_the_open() -> Scene {
    let camera = Camera::look_at("aside", Vec3::new(0.4, 0.9, 3.0), Vec3::new(0.0, 0.4, 0.0), 0.9, 1.5);
    let top = quad(Vec3::new(-1.0, 0.0, 0.8), Vec3::X * 2.0, Vec3::NEG_Z * 1.6);
    Stage::new(camera)
        .surface("table", &top, lambert(0.7, 0.0))
        .surface("leaf", &quad(Vec3::new(-0.3, 0.1, 0.0), Vec3::X * 0.6, Vec3::Y * 0.7), lambert(0.5, 0.0))
        .lamp("lamp", Vec3::new(0.5, 1.5, 1.0), 3.0)
        .prepared()
        .scene
}

#[test]
fn pixels_that_see_nothing_are_the_same_without_rays() {
    for form in [None, Some(SkyForm::Whole), Some(SkyForm::Patches(1))] {
        let [with, without] = pair(&in_the_open(), form, Skip::EmptyPixels);
        assert!(traced(&with, 4, 3) == traced(&without, 4, 3), "{form:?}");
        let [with, without] = [with, without].map(|scene| baked(scene, 8, 30.0));
        let blocks = |bake: &Bake| bake.groups.iter().flat_map(|g| g.blocks.clone()).collect::<Vec<_>>();
        assert!(blocks(&with) == blocks(&without), "{form:?}");
        let n_empty = with.figures().skipped.empty_pixels;
        assert!(n_empty > FILM.n_pixels() / 4 && without.figures().skipped.empty_pixels == 0, "{n_empty}");
    }
}

#[test]
fn no_pixel_is_called_empty_that_a_ray_of_it_finds_full() {
    let (mut rng, film) = (crate::sampler::Sampler::new(5, 1, 0), Film { width: 40, height: 30 });
    let mut n_empty = 0;
    for _ in 0..200 {
        let mut point = |size: f32| {
            let ([x, y], z) = (rng.next_2d(), rng.next_1d());
            (Vec3::new(x, y, z) - 0.5) * size
        };
        // Some triangles lie around the camera, some far away, some partly behind it.
        let (center, eye) = (point(4.0), point(4.0));
        let corners = [point(1.5) + center, point(1.5) + center, point(8.0)];
        let shift = [point(1.5).x, point(1.5).y];
        let stage = Stage::new(Camera { shift, ..Camera::look_at("any", eye, point(4.0), 1.2, 1.3) });
        let scene = stage.surface("triangle", &corners, lambert(0.5, 0.0)).prepared();
        let Some(empty) = EmptyPixels::find(&scene.scene.mesh, &scene.scene.cameras[0], film) else { continue };
        n_empty += empty.count();
        for pixel in (0..film.n_pixels()).filter(|&pixel| empty.contains(pixel)) {
            let corner = glam::Vec2::new((pixel % 40) as f32, (pixel / 40) as f32);
            for within in [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::ONE, Vec3::splat(0.5)] {
                let direction = scene.scene.cameras[0].direction(film, corner + within.truncate());
                let ray = crate::bvh::Ray { origin: eye, direction, t_min: 0.0, t_max: f32::INFINITY };
                assert!(scene.closest(&ray, &mut rng.clone()).is_none(), "{corners:?} from {eye} at {corner}");
            }
        }
    }
    assert!(n_empty > 10_000, "{n_empty} of 240,000");
}

#[test]
fn a_diffuse_surface_without_its_lobes_scatters_as_with_them() {
    let scene = Stage::new(inside()).surface("walls", &room(HALF), lambert(DIM, 0.0)).lamp("lamp", Vec3::ZERO, 1.0);
    let [with, without] = pair(&scene.prepared().scene, None, Skip::Lobes);
    assert!(with.spared().diffuse_materials == 1 && without.spared().diffuse_materials == 0);
    assert!(with.spared().diffuse_share == 1.0 && without.spared().diffuse_share == 0.0);
    let ray = crate::bvh::Ray { origin: Vec3::ZERO, direction: Vec3::NEG_Y, t_min: 0.0, t_max: 9.0 };
    let hit = with.closest(&ray, &mut crate::sampler::Sampler::new(0, 0, 0)).expect("the floor");
    for (wo, wi) in [(Vec3::Y, Vec3::new(0.6, 0.8, 0.0)), (Vec3::new(0.0, 0.1, 0.995), Vec3::Y)] {
        let [(plain, plain_pdf), (layered, pdf)] = [&with, &without].map(|scene| scene.bsdf(&hit, wo).eval(wi));
        assert!((plain - layered).abs().max_element() < 1e-6 && (plain_pdf - pdf).abs() < 1e-6, "{plain} {layered}");
    }
    let [a, b] = [&with, &without].map(|scene| traced(scene, 64, 1));
    assert_same_mean(&a, &b, SHARP, "the picture with all lobes");
    let [saved, none] = [with, without].map(|scene| baked(scene, 4, 20.0).figures().skipped.random_numbers_saved);
    // Blocks may stop before the last of four samples.
    let per_pixel = saved / FILM.n_pixels() as f64;
    assert!((1.0..=4.0).contains(&per_pixel) && none == 0.0, "{per_pixel}");
}

#[test]
fn opaque_surfaces_are_there_whether_or_not_they_are_asked() {
    let leaf = Material { base_color: Vec4::new(0.4, 0.6, 0.2, 0.5), alpha: AlphaMode::Blend, ..lambert(0.5, 0.0) };
    let stage = Stage::new(inside())
        .surface("walls", &room(HALF), lambert(0.6, 0.0))
        .surface("leaf", &quad(Vec3::new(-0.5, -0.5, -0.4), Vec3::X, Vec3::Y), leaf)
        .surface("pane", &quad(Vec3::new(-0.9, -0.2, 0.0), Vec3::X * 0.5, Vec3::Y * 0.5), pane())
        .lamp("lamp", Vec3::new(0.2, 0.5, -0.8), 1.0);
    let [with, without] = pair(&stage.prepared().scene, None, Skip::Alpha);
    assert!(with.spared().opaque_triangles == 12 && without.spared().opaque_triangles == 0);
    // The walls have 23.68 m², the leaf 1 and the pane a quarter.
    let share = with.spared().opaque_share;
    assert!((share - 23.68 / 24.93).abs() < 1e-3 && without.spared().opaque_share == 0.0, "{share}");
    // The same rays; only where two triangles meet may rounding choose the other one.
    let [a, b] = [&with, &without].map(|scene| traced(scene, 2, 1));
    let differing = a.iter().zip(&b).filter(|(a, b)| (*a - *b).abs() > 1e-4 * b.abs()).count();
    assert!(differing * 50 < a.len(), "{differing} of {} pixels differ", a.len());
    let [a, b] = [&with, &without].map(|scene| traced(scene, 16, 2));
    assert_same_mean(&a, &b, SHARP, "the picture with alpha asked everywhere");
    let [saved, none] = [with, without].map(|scene| baked(scene, 4, 20.0).figures().skipped.alpha_tests_saved);
    let most = (4.0 * FILM.n_pixels() as f64 * f64::from(share)).round();
    assert!((0.9 * FILM.n_pixels() as f64..=most).contains(&saved) && none == 0.0, "{saved}, {most} at most");
}

/// A closed room, turned so that no wall lies along an axis, with a lamp in it.
fn closed_room(albedo: f32, hole: bool) -> Stage {
    let turn = Quat::from_rotation_y(0.4) * Quat::from_rotation_x(0.2);
    let mut corners: Vec<Vec3> = room(HALF).into_iter().map(|corner| turn * corner).collect();
    if hole {
        corners.truncate(corners.len() - 3);
    }
    Stage::new(inside())
        .surface("walls", &corners, lambert(albedo, 0.0))
        .surface("table", &quad(Vec3::new(-0.4, -0.4, -0.4), Vec3::Z * 0.6, Vec3::X * 0.6), lambert(albedo, 0.0))
        .lamp("lamp", Vec3::new(0.2, 0.4, -0.2), 1.0)
}

fn keys(scene: &PreparedScene, sources: &[u32]) -> Vec<String> {
    sources.iter().map(|&source| scene.lighting.basis.sources[source as usize].key.clone()).collect()
}

fn dark(scene: &PreparedScene) -> Vec<String> {
    keys(scene, &dark_sources(scene, scene.scene.cameras[0].position()))
}

#[test]
fn the_sky_over_a_closed_room_is_not_connected_to_and_nothing_changes() {
    let mut scene = closed_room(DIM, false).prepared().scene;
    // As bright as the sky, so that connections to that take no more than half from it.
    scene.punctual[0].intensity = 30.0;
    for form in [SkyForm::Whole, SkyForm::Patches(1)] {
        let [with, without] = pair(&scene, Some(form), Skip::ClosedSky);
        assert_eq!((dark(&with), dark(&without)), (vec!["sky".to_owned()], vec![]), "{form:?}");
        assert_dark_lights_bring_nothing([&with, &without], &format!("{form:?}"));
        let [a, b] = [&with, &without].map(|scene| traced(scene, 64, 1));
        assert_same_mean(&a, &b, SHARP, &format!("a picture under a closed roof, {form:?}"));
        let weights = file_light(&with);
        let walks = |spp, seed| Walks { film: FILM, streams: 3072, spp, bounces: None, seed };
        let dark = dark_sources(&with, with.scene.cameras[0].position());
        let plan = MatrixPlan::without(&with.lighting, Density::Full, &dark);
        let all = MatrixPlan::new(&without.lighting, Density::Full);
        let [of_dark, _] = parted(&without, &dark);
        let lit = walks(1, 3).streams(&without, &all, &of_dark).iter().filter(|value| **value != 0.0).count();
        assert_eq!(lit, 0, "walks that the sky reaches, {form:?}");
        let [a, b] = [walks(32, 3).streams(&with, &plan, &weights), walks(16, 4).streams(&without, &all, &weights)];
        assert_same_mean(&a, &b, SHARP, &format!("a matrix under a closed roof, {form:?}"));
    }
}

#[test]
fn of_a_sky_connections_to_its_patches_are_saved_and_no_others() {
    let scene = prepared(&closed_room(DIM, false).prepared().scene, Some(SkyForm::Patches(1)), Skips::default());
    let skipped = baked(scene, 4, 20.0).figures().skipped;
    // All four samples are taken. Its map and what is seen of it have a column each, too.
    let n_patches = skipped.closed_sky_columns - 2;
    assert_eq!((n_patches, skipped.connections_saved), (290, 4.0 * 290.0 * FILM.n_pixels() as f64));
}

#[test]
fn a_room_with_the_least_hole_keeps_its_sky() {
    let open = prepared(&closed_room(0.6, true).prepared().scene, Some(SkyForm::Whole), Skips::default());
    assert!(dark(&open).is_empty(), "half a wall is missing");
    // A window of clear glass, and one that is there by half.
    for window in [pane(), Material { alpha: AlphaMode::Blend, ..lambert(0.5, 0.0) }] {
        let corners = room(HALF);
        let (walls, rest) = corners.split_at(corners.len() - 6);
        let stage = Stage::new(inside()).surface("walls", walls, lambert(0.6, 0.0)).surface("window", rest, window);
        let lit = stage.lamp("lamp", Vec3::ZERO, 1.0).prepared().scene;
        assert!(dark(&prepared(&lit, Some(SkyForm::Patches(1)), Skips::default())).is_empty());
    }
    // A hole so small that no random walk finds it.
    let mut corners = room(HALF);
    corners[0] *= 1.000_001;
    let stage = Stage::new(inside()).surface("walls", &corners, lambert(0.6, 0.0)).lamp("lamp", Vec3::ZERO, 1.0);
    assert!(dark(&prepared(&stage.prepared().scene, Some(SkyForm::Whole), Skips::default())).is_empty());
    // A camera outside sees the sky.
    let outside = Camera::look_at("outside", Vec3::new(0.0, 0.3, 5.0), Vec3::ZERO, 1.0, 1.5);
    let stage = Stage::new(outside).surface("walls", &room(HALF), lambert(0.6, 0.0)).lamp("lamp", Vec3::ZERO, 1.0);
    let scene = prepared(&stage.prepared().scene, Some(SkyForm::Whole), Skips::default());
    assert_eq!(dark(&scene), ["lamp"], "the walls keep the lamp in");
}

/// Lamps that reach nothing, each for a reason of its own, and others that only nearly do.
fn with_dark_lamps() -> Scene {
    let away = quad(Vec3::new(-0.3, 2.0, -0.3), Vec3::Z * 0.5, Vec3::X * 0.5);
    let mut scene = closed_room(DIM, false)
        .panel("other room", &quad(Vec3::new(4.0, -1.0, -1.0), Vec3::Y * 2.0, Vec3::Z * 2.0), 1.0, 4)
        .surface("away", &away, lambert(0.0, 5.0))
        .panel("panel", &quad(Vec3::new(-0.2, 0.45, -0.3), Vec3::X * 0.4, Vec3::Z * 0.4), 3.0, 4)
        .lamp("next door", Vec3::new(-3.0, 0.2, 0.1), 5.0)
        .lamp("never on", Vec3::new(0.1, 0.2, 0.1), 0.0)
        .lamp("aside", Vec3::new(0.0, 0.3, 0.1), 5.0)
        .lamp("spot", Vec3::new(0.1, 0.3, 0.0), 5.0)
        .prepared()
        .scene;
    let spot = PunctualKind::Spot { inner_rad: 0.2, outer_rad: 0.4 };
    for lamp in scene.punctual.iter_mut().rev().take(2) {
        lamp.kind = spot;
    }
    // Most of the light is that of the lamp in the middle: spots are noisy.
    scene.punctual[0].intensity = 8.0;
    scene
}

#[test]
fn lamps_that_reach_nothing_are_not_connected_to_and_nothing_changes() {
    let scene = with_dark_lamps();
    let [with, without] = pair(&scene, None, Skip::DarkLamps);
    assert_eq!(dark(&with), ["away", "next door", "never on", "other room"]);
    assert!(dark(&without).is_empty());
    assert_dark_lights_bring_nothing([&with, &without], "lamps next door");
    let [a, b] = [&with, &without].map(|scene| traced(scene, 128, 1));
    assert_same_mean(&a, &b, SHARP, "a picture without the lamps next door");
    let [with, without] = [with, without].map(|scene| baked_sharply(&scene, 64));
    assert_eq!(with.figures().skipped.dark_lamp_columns, 19, "three lamps and a panel of sixteen texels");
    assert!(with.figures().skipped.connections_saved > 64.0 * FILM.n_pixels() as f64);
    let [a, b] = [&with, &without].map(relit);
    assert_same_mean(&a, &b, SHARP, "a bake without the lamps next door");
}

#[test]
fn lamps_that_look_away_from_everything_are_found_without_walls() {
    let floor = || {
        Stage::new(inside()).surface(
            "floor",
            &quad(Vec3::new(-2.0, -1.0, -2.0), Vec3::Z * 4.0, Vec3::X * 4.0),
            lambert(0.6, 0.0),
        )
    };
    let up = quad(Vec3::new(-0.3, 0.5, -0.3), Vec3::Z * 0.5, Vec3::X * 0.5);
    let mut scene = floor().panel("up", &up, 3.0, 4).lamp("spot", Vec3::new(1.5, 0.45, 1.5), 1.0).prepared().scene;
    let mut found = |direction: Vec3, outer_rad: f32| {
        let lamp = scene.punctual.last_mut().expect("there is a lamp");
        (lamp.kind, lamp.direction) = (PunctualKind::Spot { inner_rad: 0.1, outer_rad }, direction);
        dark(&prepared(&scene, None, Skips::default()))
    };
    assert_eq!(found(Vec3::Y, 0.5), ["spot", "up"]);
    assert_eq!(found(Vec3::NEG_Y, 0.5), ["up"]);
    assert_eq!(found(Vec3::Y, 1.55), ["up"], "a cone that is nearly a half space grazes the panel");
    // From two sides it shines on the floor as well.
    let glow = Material { double_sided: true, ..lambert(0.0, 3.0) };
    assert!(dark(&floor().surface("both", &up, glow).prepared()).is_empty());
    // Something above it is enough.
    let stage = floor().panel("up", &up, 3.0, 4);
    let lid = quad(Vec3::new(5.0, 0.6, 5.0), Vec3::X, Vec3::Z);
    assert!(dark(&stage.surface("lid", &lid, lambert(0.5, 0.0)).prepared()).is_empty());
}

/// A room with a window to the sky in one wall.
fn room_with_a_window(albedo: f32) -> Scene {
    let corners = room(HALF);
    let stage = Stage::new(inside()).surface("walls", &corners[..corners.len() - 3], lambert(albedo, 0.0));
    stage.lamp("lamp", Vec3::ZERO, 0.2).prepared().scene
}

#[test]
fn patches_that_pilots_saw_nothing_of_lose_no_light() {
    let form = Some(SkyForm::Patches(1));
    let scene = prepared(&room_with_a_window(0.6), form, Skips::default());
    let plan = || MatrixPlan::new(&scene.lighting, Density::Full);
    let (scale, reach) = TransportMatrix::new(&scene, &plan(), inside(), FILM, None, 3).measure_columns();
    let n_seen = reach.iter().filter(|light| **light > 0.0).count();
    assert!(n_seen > 20 && 10 * n_seen < 6 * reach.len(), "{n_seen} of {} patches shine in", reach.len());
    // The same patches are seen through the window of a room whose walls scatter less.
    let dim = prepared(&room_with_a_window(DIM), form, Skips::default());
    let weights = file_light(&dim);
    let light = |skips: Skips, seed| {
        let walks = Walks { film: FILM, streams: 6144, spp: 16, bounces: None, seed };
        walks.streams(&dim, &plan().fitted(&scale, &reach, skips), &weights)
    };
    let all = light(Skips::default().without(Skip::UnseenPatches), 1);
    assert_same_mean(&light(Skips::default(), 2), &all, SHARP, "connections to the patches that shine in");
    let [with, without] = pair(&room_with_a_window(0.6), form, Skip::UnseenPatches);
    let [found, none] = [with, without].map(|scene| baked(scene, 4, 20.0).figures().skipped);
    assert!(found.sky_patches > 20 && none.sky_patches == 0, "{found:?}");
    let n_least = (found.sky_patches * (FILM.n_pixels() - found.empty_pixels)) as f64;
    assert!(found.connections_saved >= n_least && none.connections_saved == 0.0, "{found:?}");
}

/// A closed room with a lamp and a panel, whose walls scatter enough for later connections to count.
fn lit_by_a_panel() -> Scene {
    let panel = quad(Vec3::new(-0.2, 0.45, -0.3), Vec3::X * 0.4, Vec3::Z * 0.4);
    closed_room(0.4, false).panel("panel", &panel, 3.0, 4).prepared().scene
}

#[test]
fn walks_are_guided_alike_whether_weak_connections_are_left_to_roulette_or_not() {
    let scene = prepared(&lit_by_a_panel(), None, Skips::default());
    let plan = || MatrixPlan::new(&scene.lighting, Density::Full);
    let (scale, reach) = TransportMatrix::new(&scene, &plan(), inside(), FILM, None, 3).measure_columns();
    let [with, without] =
        [Skips::default(), Skips::default().without(Skip::WeakLight)].map(|skips| plan().fitted(&scale, &reach, skips));
    assert!(with.worth(0).is_finite() && without.worth(0).is_infinite());
    assert_eq!(with.peaks(), without.peaks());
    assert!(with.peaks().is_some() && plan().peaks().is_none());
}

#[test]
fn connections_that_carry_little_keep_their_light_under_roulette() {
    let [with, without] = pair(&lit_by_a_panel(), None, Skip::WeakLight);
    let [with, without] = [with, without].map(|scene| baked_sharply(&scene, 128));
    let [share, none] = [&with, &without].map(|bake| bake.figures().skipped.weak_connections);
    assert!(share > 0.1 && share < 1.0 && none == 0.0, "{share}");
    let [a, b] = [&with, &without].map(relit);
    assert_same_mean(&a, &b, SHARP, "a bake that asks for every connection");
}

#[test]
fn blocks_that_stop_early_have_the_mean_of_those_that_go_on() {
    let lamps = closed_room(0.6, false).lamp("other", Vec3::new(-0.4, 0.1, 0.4), 1.0).prepared().scene;
    let scenes = pair(&lamps, None, Skip::ConvergedBlocks);
    // Should blocks that came out dark seem to have less noise, they would stop sooner, and bakes of all seeds be too dark.
    let means_of = |seed: u64| {
        let [with, without] = scenes.each_ref().map(|scene| {
            let config = BakeConfig { spp: 32, tolerance_db: 20.0, seed, denoise: false, ..BakeConfig::default() };
            pictures::baked(&Arc::new(scene.clone()), FILM, config)
        });
        let [saved, none] = [&with, &without].map(|bake| bake.figures().skipped.samples_saved);
        assert!(saved > 0.2 && none == 0.0, "seed {seed}: {saved}");
        [&with, &without].map(|bake| Mean::of(&relit(bake)).value)
    };
    let means: Vec<[f64; 2]> = (0..16).map(means_of).collect();
    let [stopped, whole] = [0, 1].map(|way| means.iter().map(|both| both[way]).collect::<Vec<f64>>());
    assert_same_mean(&stopped, &whole, SHARP, "bakes that take all samples, by seeds");
}

#[test]
fn colors_that_judge_each_other_save_samples() {
    let stage = Stage::new(inside()).surface("walls", &room(HALF), lambert(0.6, 0.0));
    let scene = stage.lamp("lamp", Vec3::new(-0.3, 0.5, 0.2), 0.5).prepared();
    let config = BakeConfig { spp: 64, tolerance_db: 15.0, indirect: Indirect::Shared, ..BakeConfig::default() };
    let [with, without] = [scene.clone(), scene.without_colors()]
        .map(|scene| pictures::baked(&Arc::new(scene), FILM, config.clone()).figures().skipped.samples_saved);
    assert!(with > without, "{with} of the samples are saved, and {without} without colors");
}

#[test]
fn a_bake_tells_which_skips_were_off() {
    let scene = in_the_open();
    let bake = baked(prepared(&scene, None, Skips::none()), 2, 20.0);
    assert_eq!(bake.figures().skipped.off, Skip::ALL);
    let json = serde_json::to_value(&*baked(prepared(&scene, None, Skips::default()), 2, 20.0).header);
    let json = json.expect("a header has a JSON form");
    assert!(json.get("skips").is_none() && json["spared"]["empty_pixels"].as_u64() > Some(0));
    assert!(Mean::of(&relit(&bake)).value > 0.0);
}
