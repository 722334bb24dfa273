//! Direct light of free lamps: by formula, and against walks that meet the same lamps as lights of the scene.

use std::f32::consts::PI;
use std::ops::ControlFlow;

use glam::{Quat, Vec2, Vec4};

use super::*;
use crate::bvh::Ray;
use crate::lamps::tests::ONE_SIDED;
use crate::lamps::{Body, FreeLamp, LampShape, LampUnit};
use crate::laws::slabs::{block, glass};
use crate::laws::stage::{Stage, lambert, pane, quad};
use crate::light::{LightRig, LightSetting};
use crate::prepared::SurfaceHit;
use crate::scene::{AlphaMode, Material};
use crate::trace::{TraceConfig, trace};

const FILM: Film = Film { width: 48, height: 32 };
const WIDE: Film = Film { width: 48, height: 16 };
const SIXTEEN: VisibleConfig = VisibleConfig { samples: 16, seed: 0, first: 0, narrow_alpha: 0.0, bounces: None };
/// Side of the blocks of pixels whose means are compared.
const BLOCK: u32 = 8;
const ALBEDO: f32 = 0.5;

fn never() -> bool {
    false
}

fn lamp(shape: LampShape, position: Vec3, strength: f32, unit: LampUnit) -> FreeLamp {
    let aim = position - Vec3::Y + Vec3::X * 0.2;
    FreeLamp {
        key: "free".into(),
        shape,
        position,
        aim,
        strength,
        unit,
        setting: LightSetting::default(),
        turn_rad: 0.0,
        replaces: None,
    }
}

fn prepared(lamps: &[FreeLamp]) -> PreparedLamps {
    PreparedLamps::new(lamps, None).expect("lamps that make sense").0
}

/// A floor, a wall behind it and a box that throws a shadow, seen from the front.
fn room() -> Stage {
    let camera = Camera::look_at("eye", Vec3::new(0.0, 1.2, 3.0), Vec3::new(0.0, 0.6, 0.0), 0.8, 1.5);
    let floor = quad(Vec3::new(-3.0, 0.0, 3.0), Vec3::X * 6.0, Vec3::NEG_Z * 6.0);
    let wall = quad(Vec3::new(-3.0, 0.0, -1.5), Vec3::X * 6.0, Vec3::Y * 4.0);
    let shade = quad(Vec3::new(-0.3, 0.5, 0.3), Vec3::X * 0.6, Vec3::NEG_Z * 0.6);
    let glossy = Material { metallic: 0.0, roughness: 0.3, ..Material::default() };
    Stage::new(camera).surface("floor", &floor, lambert(ALBEDO, 0.0)).surface("wall", &wall, glossy).surface(
        "shade",
        &shade,
        Material { double_sided: true, ..lambert(0.7, 0.0) },
    )
}

/// Mean over passes, each sample of a pixel in its turn.
fn live(scene: &PreparedScene, lamps: &PreparedLamps, film: Film, n_passes: u32, seed: u64) -> Vec<[f32; 3]> {
    live_by(scene, lamps, film, n_passes, VisibleConfig { seed, ..SIXTEEN })
}

/// The same with samples as told.
fn live_by(
    scene: &PreparedScene,
    lamps: &PreparedLamps,
    film: Film,
    n_passes: u32,
    config: VisibleConfig,
) -> Vec<[f32; 3]> {
    let points = VisiblePoints::new(scene, &scene.scene.cameras[0], film, config, &never).expect("nobody stops it");
    let mut sum = vec![[0.0; 3]; film.n_pixels()];
    for pass in 0..n_passes {
        let picture = points.direct(scene, lamps, pass, &never).expect("nobody stops it");
        for (sum, rgb) in sum.iter_mut().zip(picture) {
            (0..3).for_each(|c| sum[c] += rgb[c] / n_passes as f32);
        }
    }
    sum
}

/// The same by walks.
fn walked(scene: &PreparedScene, film: Film, bounces: u32, spp: u32, seed: u64) -> Vec<[f32; 3]> {
    let mut coefficients = scene.lighting.basis.project(&LightRig::default());
    // A stage without lights of its own has a sky, which is another matter.
    for source in scene.lighting.basis.sources.iter().filter(|source| source.key != "free") {
        coefficients[source.columns.start as usize..source.columns.end as usize].fill([0.0; 3]);
    }
    let config = TraceConfig { spp, bounces: Some(bounces), seed };
    let camera = &scene.scene.cameras[0];
    trace(scene, camera, film, &coefficients, &config, &|_| ControlFlow::Continue(())).expect("nobody stops it")
}

/// Mean luminance of each block.
fn blocks(picture: &[[f32; 3]], film: Film) -> Vec<f64> {
    let mut means = Vec::new();
    for (top, left) in (0..film.height / BLOCK).flat_map(|y| (0..film.width / BLOCK).map(move |x| (y, x))) {
        let pixels = (0..BLOCK * BLOCK).map(|i| (top * BLOCK + i / BLOCK) * film.width + left * BLOCK + i % BLOCK);
        let sum: f64 = pixels.map(|at| picture[at as usize].iter().map(|&c| f64::from(c)).sum::<f64>()).sum();
        means.push(sum / f64::from(3 * BLOCK * BLOCK));
    }
    means
}

/// Holds the blocks of live pictures against those of walks: means of several of each, and what they scatter.
#[track_caller]
fn assert_same(of_live: &[Vec<f64>], of_walks: &[Vec<f64>], what: &str) {
    let mean = |runs: &[Vec<f64>], at: usize| runs.iter().map(|run| run[at]).sum::<f64>() / runs.len() as f64;
    let variance = |runs: &[Vec<f64>], at: usize| {
        let mean = mean(runs, at);
        let n = runs.len() as f64;
        runs.iter().map(|run| (run[at] - mean).powi(2)).sum::<f64>() / (n - 1.0) / n
    };
    let n_blocks = of_live[0].len();
    let brightest = (0..n_blocks).map(|at| mean(of_walks, at)).fold(0.0, f64::max);
    assert!(brightest > 0.0, "{what}: nothing is lit");
    let (mut worst, mut square) = (0.0_f64, 0.0);
    for at in 0..n_blocks {
        let difference = mean(of_live, at) - mean(of_walks, at);
        // Of four runs the scatter is known by a factor of two or so; a little of the mean stands for its least.
        let error = (variance(of_live, at) + variance(of_walks, at) + (2e-3 * mean(of_walks, at)).powi(2)).sqrt();
        let z = difference / error.max(1e-6 * brightest);
        (worst, square) = (worst.max(z.abs()), square + z * z);
    }
    let spread = (square / n_blocks as f64).sqrt();
    println!("{what}: worst z {worst:.2}, spread {spread:.2} of {n_blocks} blocks, brightest {brightest:.4}");
    assert!(worst < 6.0 && spread < 2.0, "{what}: worst z {worst:.2}, spread {spread:.2}");
}

/// Live pictures of the scene against walks, of the same lamps.
#[track_caller]
fn compare(stage: impl Fn() -> Stage, lamps: &[FreeLamp], bounces: u32, spp: u32, what: &str) {
    compare_by((FILM, SIXTEEN), stage, lamps, (bounces, spp), what);
}

/// The same of another film and with samples as told.
#[track_caller]
fn compare_by(
    (film, config): (Film, VisibleConfig),
    stage: impl Fn() -> Stage,
    lamps: &[FreeLamp],
    (bounces, spp): (u32, u32),
    what: &str,
) {
    let (scene, lamps) = (stage().prepared(), prepared(lamps));
    let mut lit = stage().prepared();
    lamps.install(&mut lit).expect("names of their own");
    let live = |seed| live_by(&scene, &lamps, film, 64, VisibleConfig { seed, ..config });
    let of_live: Vec<_> = (0..4).map(|seed| blocks(&live(seed), film)).collect();
    let of_walks: Vec<_> = (0..4).map(|seed| blocks(&walked(&lit, film, bounces, spp, seed), film)).collect();
    assert_same(&of_live, &of_walks, what);
}

fn shapes() -> [FreeLamp; 6] {
    let above = Vec3::new(0.3, 1.7, 0.2);
    [
        lamp(LampShape::Point, above, 100.0, LampUnit::Lumen),
        lamp(LampShape::Spot { inner_rad: 0.3, outer_rad: 0.7 }, above, 100.0, LampUnit::Lumen),
        lamp(LampShape::Directional { radius_rad: 0.0 }, above, 100.0, LampUnit::Lux),
        lamp(LampShape::Rectangle { size_m: [0.6, 0.3] }, above, 100.0, LampUnit::Lumen),
        lamp(LampShape::Disk { radius_m: 0.25 }, above, 100.0, LampUnit::Lumen),
        lamp(LampShape::Sphere { radius_m: 0.2 }, above, 100.0, LampUnit::Lumen),
    ]
}

#[test]
fn direct_light_is_that_of_walks_which_end_at_the_first_surface() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("one-sided.ies");
    std::fs::write(&file, ONE_SIDED).expect("the folder can be written");
    let shape = LampShape::Profile { file: file.display().to_string() };
    let measured = lamp(shape, Vec3::new(0.3, 1.7, 0.2), 100.0, LampUnit::Lumen);
    let soft = FreeLamp { shape: LampShape::Directional { radius_rad: 0.15 }, ..shapes()[2].clone() };
    for lamp in shapes().into_iter().chain([FreeLamp { turn_rad: 0.5, ..measured }, soft]) {
        compare(room, std::slice::from_ref(&lamp), 0, 256, &format!("{:?}", lamp.shape));
    }
}

/// Metal before a floor that is out of sight: what it shows of the floor is all that a second surface adds.
fn metal_before_a_floor(roughness: f32) -> Stage {
    let camera = Camera::look_at("eye", Vec3::new(0.0, 1.0, 2.5), Vec3::new(0.0, 1.0, 0.0), 0.5, 1.5);
    let metal = quad(Vec3::new(-3.0, -1.0, -1.0), Vec3::X * 6.0, Vec3::Y * 4.0);
    let floor = quad(Vec3::new(-3.0, 0.0, 6.0), Vec3::X * 6.0, Vec3::NEG_Z * 6.99);
    let silver = Material { metallic: 1.0, roughness, ..Material::default() };
    Stage::new(camera).surface("metal", &metal, silver).surface("floor", &floor, lambert(ALBEDO, 0.0))
}

#[test]
fn direct_light_in_a_mirror_is_that_of_walks() {
    for lamp in [&shapes()[0], &shapes()[3]] {
        let lamp = FreeLamp { aim: Vec3::new(0.0, 0.0, 1.5), position: Vec3::new(0.3, 1.6, 1.0), ..lamp.clone() };
        // The floor gets light off the mirror as well, which live pictures leave to others: only what the mirror shows
        // counts, and the walks may scatter once more there.
        let what = format!("mirror, {:?}", lamp.shape);
        compare_by((WIDE, SIXTEEN), || metal_before_a_floor(0.0), &[lamp], (1, 512), &what);
    }
}

#[test]
fn light_that_a_narrow_lobe_shows_is_that_of_walks() {
    let config = VisibleConfig { samples: 64, narrow_alpha: 0.2, ..SIXTEEN };
    for lamp in [&shapes()[0], &shapes()[3]] {
        let lamp = FreeLamp { aim: Vec3::new(0.0, 0.0, 1.0), position: Vec3::new(0.3, 1.6, 0.5), ..lamp.clone() };
        let what = format!("satin, {:?}", lamp.shape);
        compare_by((WIDE, config), || metal_before_a_floor(0.35), &[lamp], (1, 512), &what);
    }
}

#[test]
fn points_that_narrow_lobes_show_are_counted_as_memory() {
    let n_bytes = |narrow_alpha| {
        let scene = metal_before_a_floor(0.35).prepared();
        let config = VisibleConfig { samples: 1, narrow_alpha, ..SIXTEEN };
        VisiblePoints::new(&scene, &scene.scene.cameras[0], WIDE, config, &|| false).unwrap().n_bytes()
    };
    let [of_first, with_shown] = [0.0, 0.2].map(n_bytes);
    let per_pixel = |bytes: usize| bytes as f64 / WIDE.n_pixels() as f64;
    assert!((4.0..=90.0).contains(&per_pixel(of_first)), "{of_first}");
    assert!(per_pixel(with_shown) > per_pixel(of_first) + 5.0, "{with_shown} after {of_first}");
}

#[test]
fn direct_light_behind_a_clear_pane_is_that_of_walks() {
    // Nothing lies where the window's reflection could show it, and the lid over the scene is out of sight: walks that end
    // at the first surface do not follow reflections.
    let glazed = || {
        let camera = Camera::look_at("eye", Vec3::new(0.0, 1.2, 3.0), Vec3::new(0.0, 0.6, 0.0), 0.8, 1.5);
        let floor = quad(Vec3::new(-3.0, 0.0, 0.95), Vec3::X * 6.0, Vec3::NEG_Z * 2.5);
        let wall = quad(Vec3::new(-3.0, 0.0, -1.5), Vec3::X * 6.0, Vec3::Y * 4.0);
        let window = quad(Vec3::new(-2.0, -1.0, 1.0), Vec3::X * 4.0, Vec3::Y * 4.0);
        let lid = quad(Vec3::new(-2.0, 2.1, 1.0), Vec3::X * 4.0, Vec3::NEG_Z * 2.0);
        let glass = || Material { double_sided: true, ..pane() };
        Stage::new(camera)
            .surface("floor", &floor, lambert(ALBEDO, 0.0))
            .surface("wall", &wall, lambert(ALBEDO, 0.0))
            .surface("window", &window, glass())
            .surface("lid", &lid, glass())
    };
    for lamp in [&shapes()[0], &shapes()[3], &shapes()[5]] {
        let lamp = FreeLamp { position: Vec3::new(0.3, 2.6, 0.1), aim: Vec3::ZERO, ..lamp.clone() };
        compare(glazed, std::slice::from_ref(&lamp), 0, 256, &format!("pane, {:?}", lamp.shape));
    }
}

#[test]
fn direct_light_through_a_solid_pane_is_that_of_walks() {
    // So wide that no light comes around the glass or through its rim; two bounces are its faces, so that walks scatter once.
    let turn = Quat::from_rotation_z(0.15);
    let window = block(Vec3::new(0.0, 1.1, 0.0), Vec3::new(8.0, 0.125, 8.0), turn);
    let covered = || {
        let camera = Camera::look_at("eye", Vec3::new(0.0, 0.6, 1.2), Vec3::ZERO, 0.8, 1.5);
        let floor = quad(Vec3::new(-3.0, 0.0, 3.0), Vec3::X * 6.0, Vec3::NEG_Z * 6.0);
        let shade = quad(Vec3::new(-0.2, 0.3, 0.2), Vec3::X * 0.4, Vec3::NEG_Z * 0.4);
        let dark = Material { double_sided: true, ..lambert(0.2, 0.0) };
        Stage::new(camera).surface("floor", &floor, lambert(ALBEDO, 0.0)).surface("shade", &shade, dark).surface(
            "window",
            &window,
            glass(),
        )
    };
    for lamp in shapes() {
        let lamp = FreeLamp { position: Vec3::new(0.3, 1.9, 0.2), aim: Vec3::ZERO, ..lamp };
        compare(covered, std::slice::from_ref(&lamp), 2, 256, &format!("solid pane, {:?}", lamp.shape));
    }
}

#[test]
fn faces_of_solid_panes_and_mirrors_count_as_bounces() {
    let camera = Camera::look_at("eye", Vec3::new(0.0, 0.6, 1.2), Vec3::ZERO, 0.8, 1.5);
    let floor = quad(Vec3::new(-3.0, 0.0, 3.0), Vec3::X * 6.0, Vec3::NEG_Z * 6.0);
    let window = block(Vec3::new(0.0, 1.1, 0.0), Vec3::new(8.0, 0.125, 8.0), Quat::IDENTITY);
    let stage = Stage::new(camera).surface("floor", &floor, lambert(ALBEDO, 0.0)).surface("window", &window, glass());
    let (covered, mirrored) = (stage.prepared(), metal_before_a_floor(0.0).prepared());
    let seen = |scene: &PreparedScene, lamps: &PreparedLamps, bounces: Option<u32>| {
        live_by(scene, lamps, WIDE, 1, VisibleConfig { bounces, ..SIXTEEN })
    };
    let is_dark = |picture: &[[f32; 3]]| picture.iter().all(|rgb| *rgb == [0.0; 3]);
    for lamp in shapes() {
        let what = format!("{:?}", lamp.shape);
        let lamps = prepared(&[FreeLamp { position: Vec3::new(0.3, 1.9, 0.2), aim: Vec3::ZERO, ..lamp }]);
        let lux = |bounces| lamps.irradiance(&covered, Vec3::ZERO, Vec3::Y, bounces).y;
        let all = seen(&covered, &lamps, None);
        assert!(!is_dark(&all) && lux(None) > 0.0, "{what}");
        assert!(seen(&covered, &lamps, Some(2)) == all && lux(Some(2)) == lux(None), "{what}: two faces, two bounces");
        for few in [0, 1] {
            assert!(is_dark(&seen(&covered, &lamps, Some(few))) && lux(Some(few)) == 0.0, "{what}: {few} bounces");
        }
    }
    let lamps = prepared(&[FreeLamp { position: Vec3::new(0.3, 1.6, 1.0), ..shapes()[0].clone() }]);
    let all = seen(&mirrored, &lamps, None);
    assert!(!is_dark(&all) && seen(&mirrored, &lamps, Some(1)) == all, "the mirror is one bounce");
    assert!(is_dark(&seen(&mirrored, &lamps, Some(0))), "it shows no lit floor without one");
}

#[test]
fn a_card_behind_a_solid_pane_hides_a_point_lamp_from_each_place_by_itself() {
    let camera = Camera::look_at("eye", Vec3::new(0.0, 0.6, 1.2), Vec3::Z * 0.4, 0.6, 1.5);
    let floor = quad(Vec3::new(-3.0, 0.0, 3.0), Vec3::X * 6.0, Vec3::NEG_Z * 6.0);
    let window = block(Vec3::new(0.0, 1.1, 0.0), Vec3::new(8.0, 0.125, 8.0), Quat::from_rotation_z(0.15));
    let card = quad(Vec3::new(0.02, 1.5, 0.28), Vec3::X * 0.16, Vec3::NEG_Z * 0.16);
    let stage = Stage::new(camera).surface("floor", &floor, lambert(ALBEDO, 0.0)).surface("window", &window, glass());
    let scene = stage.surface("card", &card, lambert(0.0, 0.0)).prepared();
    let lamps = prepared(&[lamp(LampShape::Point, Vec3::new(0.1, 1.9, 0.2), 100.0, LampUnit::Lumen)]);
    let config = VisibleConfig { samples: 1, ..SIXTEEN };
    let points = VisiblePoints::new(&scene, &scene.scene.cameras[0], FILM, config, &never).expect("nobody stops it");
    let picture = points.direct(&scene, &lamps, 0, &never).expect("nobody stops it");
    let (mut n, mut n_different) = ([0; 2], 0);
    for point in points.bands.iter().flatten().flat_map(|band| &band.found.points) {
        let expected = lamps.irradiance(&scene, point.position, Vec3::Y, None).y * ALBEDO / PI;
        let found = picture[point.pixel as usize][1];
        n[usize::from(expected > 0.0)] += 1;
        n_different += usize::from((found - expected).abs() > 1e-3 * expected);
    }
    let [n_dark, n_lit] = n;
    assert!(n_dark > 100 && n_lit > 100, "{n_dark} dark, {n_lit} lit");
    assert!(n_different <= FILM.n_pixels() / 200, "{n_different} pixels");
}

#[test]
fn two_panes_in_a_turned_wall_pass_light_of_free_lamps_as_one_of_double_width_does() {
    let turn = Quat::from_rotation_y(std::f32::consts::FRAC_PI_4);
    let behind = |panes: &[[f32; 2]]| {
        let camera = Camera::look_at("eye", turn * Vec3::new(0.0, 1.2, 0.9), Vec3::ZERO, 0.5, 1.5);
        let floor = quad(Vec3::new(-0.7, 0.0, 0.7), Vec3::X * 1.4, Vec3::NEG_Z * 1.4);
        let stage = Stage::new(camera).surface("floor", &floor, lambert(ALBEDO, 0.0));
        let wall = panes.iter().fold(stage, |stage, &[lo, hi]| {
            let (center, half) = (Vec3::new(0.5 * (lo + hi), 1.0, -1.0), Vec3::new(0.5 * (hi - lo), 1.0, 0.006));
            stage.surface("pane", &block(turn * center, half, turn), glass())
        });
        wall.prepared()
    };
    let (one, two) = (behind(&[[-1.0, 1.0]]), behind(&[[-1.0, 0.0], [0.0, 1.0]]));
    for lamp in shapes() {
        let lamp = FreeLamp { position: turn * Vec3::new(0.3, 1.5, -2.5), aim: Vec3::ZERO, ..lamp };
        let lamps = prepared(std::slice::from_ref(&lamp));
        let [one, two] = [&one, &two].map(|scene| live(scene, &lamps, FILM, 1, 0));
        let n_lit = one.iter().filter(|rgb| rgb[1] > 0.0).count();
        let differ = |(a, b): &(&[f32; 3], &[f32; 3])| (a[1] - b[1]).abs() > 0.01 * a[1];
        let n_different = one.iter().zip(&two).filter(differ).count();
        // Half of the points of a sphere face away.
        let are_alike = n_lit > FILM.n_pixels() / 4 && n_different <= FILM.n_pixels() / 50;
        assert!(are_alike, "{:?}: {n_different} of {n_lit}", lamp.shape);
    }
}

#[test]
fn a_lamp_that_lies_in_a_wall_is_seen_by_every_pixel_that_looks_at_it() {
    let scene = room().prepared();
    let (middle, radius_m) = (Vec3::new(0.0, 1.4, -1.5), 0.6);
    let camera = &scene.scene.cameras[0];
    let looks_at_it = |pixel: &u32| {
        let corner = Vec2::new((pixel % FILM.width) as f32, (pixel / FILM.width) as f32);
        let direction = camera.direction(FILM, corner + 0.5);
        let t = (middle.z - camera.position().z) / direction.z;
        (camera.position() + direction * t).distance(middle) < 0.7 * radius_m
    };
    let pixels: Vec<u32> = (0..FILM.width * FILM.height).filter(looks_at_it).collect();
    // In it, and so little behind it that shadow rays end before the wall.
    for behind_m in [0.0, 2e-4] {
        let place = middle - Vec3::Z * behind_m;
        let disk = lamp(LampShape::Disk { radius_m }, place, 100.0, LampUnit::Nit);
        let lamps = prepared(&[FreeLamp { aim: place + Vec3::Z, ..disk }]);
        let picture = live(&scene, &lamps, FILM, 4, 0);
        let n_dim = pixels.iter().filter(|pixel| picture[**pixel as usize][1] < 99.9).count();
        assert!(pixels.len() > 20 && n_dim == 0, "{n_dim} of {} pixels, {behind_m} m behind", pixels.len());
    }
}

#[test]
fn a_point_lamp_over_a_floor_follows_cosine_and_inverse_square() {
    let camera = Camera::look_at("eye", Vec3::new(0.0, 3.0, 0.0), Vec3::ZERO, 0.6, 1.0);
    let floor = quad(Vec3::new(-3.0, 0.0, 3.0), Vec3::X * 6.0, Vec3::NEG_Z * 6.0);
    let scene = Stage::new(camera.clone()).surface("floor", &floor, lambert(ALBEDO, 0.0)).prepared();
    let (at, candela) = (Vec3::new(0.2, 1.5, -0.1), 40.0);
    let lamps = prepared(&[lamp(LampShape::Point, at, candela, LampUnit::Candela)]);
    let film = Film { width: 9, height: 9 };
    let picture = live(&scene, &lamps, film, 64, 1);
    for (x, y) in [(4, 4), (0, 0), (8, 2)] {
        // The mean over a pixel is close to its middle.
        let direction = camera.direction(film, Vec2::new(x as f32 + 0.5, y as f32 + 0.5));
        let place = camera.position() - direction * (camera.position().y / direction.y);
        let to_lamp = at - place;
        let expected = candela * ALBEDO / PI * to_lamp.normalize().y / to_lamp.length_squared();
        let found = picture[(y * 9 + x) as usize][0];
        assert!((found / expected - 1.0).abs() < 0.01, "({x}, {y}): {found} is not {expected}");
    }
}

#[test]
fn a_model_of_centimeters_is_lit_as_the_room_is() {
    let mut model = room().into_scene();
    model.mesh.positions.iter_mut().for_each(|position| *position *= 0.01);
    let camera = &mut model.cameras[0];
    camera.world_from_camera.w_axis = (0.01 * camera.position()).extend(1.0);
    let (large, small) = (room().prepared(), PreparedScene::new(model, &[]).expect("it has no panels").0);
    for shape in [LampShape::Point, LampShape::Spot { inner_rad: 0.3, outer_rad: 0.7 }] {
        let light = |scene: &PreparedScene, scale: f32| {
            let (place, candela) = (Vec3::new(0.6, 0.05, 1.0) * scale, 100.0 * scale * scale);
            let lamps = prepared(&[lamp(shape.clone(), place, candela, LampUnit::Candela)]);
            live(scene, &lamps, FILM, 16, 0).as_flattened().iter().sum::<f32>()
        };
        let (found, expected) = (light(&small, 0.01), light(&large, 1.0));
        assert!((found / expected - 1.0).abs() < 0.01, "{shape:?}: {found} is not {expected}");
    }
}

#[test]
fn lamps_far_away_light_a_floor_as_cosine_and_inverse_square_have_it() {
    let camera = Camera::look_at("eye", Vec3::new(0.0, 0.8, 0.0), Vec3::ZERO, 1.0, 1.0);
    let floor = quad(Vec3::new(-2.0, 0.0, 2.0), Vec3::X * 4.0, Vec3::NEG_Z * 4.0);
    let pane = block(Vec3::Y, Vec3::new(8.0, 0.01, 8.0), Quat::IDENTITY);
    let stage = || Stage::new(camera.clone()).surface("floor", &floor, lambert(ALBEDO, 0.0));
    // Each face of the pane mirrors 4 % of what comes straight at it.
    let scenes = [(stage().prepared(), 1.0), (stage().surface("pane", &pane, glass()).prepared(), 0.96 * 0.96)];
    let film = Film { width: 16, height: 16 };
    for shape in [LampShape::Point, LampShape::Rectangle { size_m: [1.0; 2] }, LampShape::Disk { radius_m: 0.5 }] {
        for (meters, aside) in [(200.0, 1.0), (1e3, 0.0), (1e3, 1.0), (5e4, 1.0)] {
            let at = Vec3::new(aside * meters, meters, 0.0);
            let candela = 100.0 * meters * meters;
            let lamps =
                prepared(&[FreeLamp { aim: Vec3::ZERO, ..lamp(shape.clone(), at, candela, LampUnit::Candela) }]);
            let lux = candela * at.normalize().y / at.length_squared();
            for (scene, passed) in scenes.iter().filter(|(_, passed)| *passed == 1.0 || aside == 0.0) {
                let picture = live(scene, &lamps, film, 4, 1);
                let expected = lux * ALBEDO / PI * passed;
                let mean = picture.iter().map(|rgb| rgb[1]).sum::<f32>() / film.n_pixels() as f32;
                let what = format!("{shape:?} {meters} m up, {passed} of it passed");
                assert!((mean / expected - 1.0).abs() < 5e-3, "{what}: {mean} is not {expected}");
                let n_dark = picture.iter().filter(|rgb| rgb[1] < 0.9 * expected).count();
                assert_eq!(n_dark, 0, "{what}: pixels in the shadow of their own floor");
            }
        }
    }
}

/// How far a place is from the nearest surface of the room, m.
fn clear_m(place: Vec3) -> f32 {
    let floor = [Vec3::new(-3.0, 0.0, -3.0), Vec3::new(3.0, 0.0, 3.0)];
    let wall = [Vec3::new(-3.0, 0.0, -1.5), Vec3::new(3.0, 4.0, -1.5)];
    let shade = [Vec3::new(-0.3, 0.5, -0.3), Vec3::new(0.3, 0.5, 0.3)];
    let away = [floor, wall, shade].map(|[low, high]| place.distance(place.clamp(low, high)));
    away.into_iter().fold(f32::INFINITY, f32::min)
}

/// The most that a lamp of an emission brings to a surface that is so far from its middle at the least, lx.
fn most_lux(lamp: &FreeLamp, emission: f32, clear_m: f32) -> f32 {
    match Body::of(lamp) {
        _ if lamp.shape.is_parallel() => emission,
        // It fills half of what a surface sees where it touches it.
        Some((body, _)) => {
            let nearest_m = (clear_m - body.ball().1).max(0.0);
            emission * (body.area() / (nearest_m * nearest_m)).min(2.0 * PI)
        }
        // Closer than 1 cm a point is not brighter.
        None => emission / clear_m.max(0.01).powi(2),
    }
}

/// Holds a picture of a lamp, and the light that arrives below the middle of the room, against the most that there can be.
#[track_caller]
fn assert_no_flash(scene: &PreparedScene, lamp: &FreeLamp) {
    let lamps = prepared(std::slice::from_ref(lamp));
    let emission = lamps.emission("free").expect("it shines").x;
    let lux = 1.01 * most_lux(lamp, emission, clear_m(lamp.position));
    // A surface sends less than all of its light per steradian to where it is seen from; the body itself may be seen, too.
    let most = lux + if Body::of(lamp).is_some() { emission } else { 0.0 };
    let what = format!("{:?} at {}", lamp.shape, lamp.position);
    let picture = live(scene, &lamps, Film { width: 24, height: 16 }, 2, 3);
    for value in picture.as_flattened() {
        assert!((0.0..=most).contains(value), "{what}: {value} nit where there can be {most}");
    }
    let arriving = lamps.irradiance(scene, Vec3::ZERO, Vec3::Y, None);
    assert!(arriving.min_element() >= 0.0 && arriving.max_element() <= lux, "{what}: {arriving} lx of {lux}");
}

#[test]
fn lamps_in_bad_places_are_no_brighter_than_they_can_be() {
    let scene = room().prepared();
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("one-sided.ies");
    std::fs::write(&file, ONE_SIDED).expect("the folder can be written");
    let places = [
        Vec3::ZERO,
        Vec3::new(0.0, 0.0, -1.5),
        Vec3::new(0.0, -0.5, 0.0),
        Vec3::new(0.0, 1.2, 3.0),
        Vec3::new(0.0, 0.5, 0.0),
        Vec3::splat(1e6),
        Vec3::new(0.0, 1e-6, 0.0),
    ];
    let shapes = [
        LampShape::Point,
        LampShape::Spot { inner_rad: 0.0, outer_rad: 1e-3 },
        LampShape::Spot { inner_rad: 0.0, outer_rad: 0.0 },
        LampShape::Rectangle { size_m: [0.0, 0.0] },
        LampShape::Rectangle { size_m: [100.0, 100.0] },
        LampShape::Disk { radius_m: 0.0 },
        LampShape::Sphere { radius_m: 0.0 },
        LampShape::Sphere { radius_m: 50.0 },
        LampShape::Directional { radius_rad: 0.0 },
        LampShape::Directional { radius_rad: 0.1 },
        LampShape::Profile { file: file.display().to_string() },
    ];
    for (position, shape) in places.iter().flat_map(|place| shapes.iter().map(move |shape| (*place, shape))) {
        let unit = if shape.is_parallel() { LampUnit::Lux } else { LampUnit::Lumen };
        for aim in [position, Vec3::ZERO] {
            assert_no_flash(&scene, &FreeLamp { aim, ..lamp(shape.clone(), position, 800.0, unit) });
        }
    }
}

#[test]
fn numbers_that_are_none_are_refused_by_name() {
    let good = lamp(LampShape::Disk { radius_m: 0.1 }, Vec3::Y, 1.0, LampUnit::Lumen);
    let bad = [
        FreeLamp { strength: f32::NAN, ..good.clone() },
        FreeLamp { strength: -1.0, ..good.clone() },
        FreeLamp { position: Vec3::new(0.0, f32::INFINITY, 0.0), ..good.clone() },
        FreeLamp { aim: Vec3::NAN, ..good.clone() },
        FreeLamp { shape: LampShape::Disk { radius_m: f32::NAN }, ..good.clone() },
        FreeLamp { shape: LampShape::Sphere { radius_m: -1.0 }, ..good.clone() },
        FreeLamp { shape: LampShape::Spot { inner_rad: 0.5, outer_rad: 0.2 }, ..good.clone() },
        FreeLamp { shape: LampShape::Profile { file: "none.ies".into() }, ..good.clone() },
        FreeLamp { setting: LightSetting { color: Some([f32::NAN; 3]), ..LightSetting::default() }, ..good.clone() },
    ];
    for lamp in bad {
        let error = PreparedLamps::new(std::slice::from_ref(&lamp), None).expect_err("it makes no sense").to_string();
        assert!(error.contains("`free`"), "{lamp:?}: {error}");
    }
    assert!(PreparedLamps::new(&[good.clone(), good], None).is_err(), "two of one name");
}

/// A room behind leaves that are half there, a pane, and an unlit sign.
fn overgrown() -> PreparedScene {
    let sheet = |[x, z]: [f32; 2]| quad(Vec3::new(x, 0.2, z), Vec3::X * 1.2, Vec3::Y * 1.2);
    let leaf = || Material { base_color: Vec4::new(0.4, 0.6, 0.2, 0.5), alpha: AlphaMode::Blend, ..lambert(0.5, 0.0) };
    let sign = Material { unlit: true, ..lambert(0.5, 0.0) };
    room()
        .surface("leaf", &sheet([-1.0, 0.6]), leaf())
        .surface("leaf before it", &sheet([-0.8, 0.9]), leaf())
        .surface("pane", &sheet([0.2, 1.0]), Material { double_sided: true, ..pane() })
        .surface("sign", &sheet([0.6, 1.2]), sign)
        .prepared()
}

#[test]
fn pixels_that_are_looked_at_together_see_what_each_sees_alone() {
    let (scene, film, [seed, sample]) = (overgrown(), Film { width: 45, height: 30 }, [7, 3]);
    let camera = &scene.scene.cameras[0];
    let mut materials = std::collections::BTreeSet::new();
    for [left, top] in [[0, 0], [16, 0], [32, 0], [0, 16], [16, 16], [32, 16]] {
        let mut firsts = Vec::new();
        first::look(&scene, (camera, film), (u64::from(seed), sample), [left, top], &mut firsts);
        for (at, first) in firsts.into_iter().enumerate() {
            let [x, y] = [left + at as u32 % TILE, top + at as u32 / TILE];
            assert_eq!(first.is_some(), x < film.width && y < film.height, "({x}, {y})");
            let Some(mut first) = first else { continue };
            let mut sampler = sampler_of(u64::from(seed), y * film.width + x, sample);
            let film_px = Vec2::new(x as f32, y as f32) + Vec2::from(sampler.next_2d());
            let (origin, direction) = (camera.position(), camera.direction(film, film_px));
            let ray = Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY };
            let alone = scene.closest_seen(&ray, &mut sampler);
            let told = |hit: &SurfaceHit| (hit.triangle, hit.t, hit.barycentric);
            assert_eq!(first.direction, direction, "({x}, {y})");
            assert_eq!(first.hit.as_ref().map(told), alone.as_ref().map(told), "({x}, {y})");
            assert_eq!(first.sampler.next_1d(), sampler.next_1d(), "random numbers after ({x}, {y})");
            materials.extend(alone.map(|hit| scene.scene.mesh.triangle_material[hit.triangle as usize]));
        }
    }
    assert!(materials.len() >= 6, "nearly all surfaces are seen: {materials:?}");
}

#[test]
fn a_pass_is_the_same_on_any_number_of_threads_and_stops_when_asked() {
    let (scene, lamps) = (room().prepared(), prepared(&shapes()[3..4]));
    let picture = |n| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().expect("threads");
        pool.install(|| live(&scene, &lamps, FILM, 3, 5))
    };
    assert_eq!(picture(1), picture(3));
    let config = VisibleConfig { samples: 1, ..VisibleConfig::default() };
    let camera = &scene.scene.cameras[0];
    assert!(VisiblePoints::new(&scene, camera, FILM, config, &|| true).is_none());
    let points = VisiblePoints::new(&scene, camera, FILM, config, &never).expect("nobody stops it");
    assert!(points.direct(&scene, &lamps, 0, &|| true).is_none());
    // Tile by tile of one band, and nobody is asked again once they said so.
    let asked_thrice = |work: &(dyn Fn(&(dyn Fn() -> bool + Sync)) -> bool + Sync)| {
        let n_asks = std::sync::atomic::AtomicU32::new(0);
        let stop = || n_asks.fetch_add(1, std::sync::atomic::Ordering::Relaxed) == 2;
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
        assert!(pool.install(|| work(&stop)) && n_asks.into_inner() == 3);
    };
    asked_thrice(&|stop| VisiblePoints::new(&scene, camera, FILM, config, stop).is_none());
    asked_thrice(&|stop| points.direct(&scene, &lamps, 0, stop).is_none());
}
