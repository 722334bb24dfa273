//! Laws of patches: lamps that no bake knew light a scene by way of its surfaces as if they had been in its file.

use std::f32::consts::PI;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::{Arc, LazyLock};

use clerestory_nystrom::{BlockFactors, BlockLowRank, Half, SampledMatrix};
use glam::Vec3;
use rayon::prelude::*;

use super::stage::{Stage, lambert, quad, room};
use crate::archive;
use crate::arriving::ArrivingPoints;
use crate::bake::focus::Focus;
use crate::bake::{Bake, BakeConfig, BakeJob, Passes};
use crate::camera::{Camera, Film};
use crate::empty::EmptyPixels;
use crate::irradiance::IrradianceRows;
use crate::lamps::tests::{ONE_SIDED, lamp};
use crate::lamps::{FreeLamp, LampShape, PreparedLamps};
use crate::light::LightRig;
use crate::matrix::CHANNELS;
use crate::patches::{NARROW_ALPHA, PatchMatrix, PatchSample, Request, learn};
use crate::path::{Integrator, NoLights};
use crate::prepared::PreparedScene;
use crate::scene::Material;
use crate::slabs::IN_A_ROW;
use crate::trace::{TraceConfig, trace};
use crate::visible::{VisibleConfig, VisiblePoints};

pub(super) const FILM: Film = Film { width: 32, height: 24 };
const HALF: Vec3 = Vec3::new(2.0, 1.2, 1.5);

fn camera() -> Camera {
    Camera::look_at("eye", Vec3::new(1.7, 0.3, 1.2), Vec3::new(-1.5, -0.4, -0.8), 1.2, 4.0 / 3.0)
}

/// Walls of one albedo; their own lamp shines in a corner.
fn walled(corners: &[Vec3], albedo: f32) -> Stage {
    Stage::new(camera()).surface("walls", corners, lambert(albedo, 0.0)).lamp("own", Vec3::new(1.5, 1.0, -1.2), 1.0)
}

/// A closed room.
pub(super) fn furnace(albedo: f32) -> Stage {
    walled(&room(HALF), albedo)
}

/// A room with a red wall, a table, and a glossy plate.
pub(super) fn furnished() -> Stage {
    with_furniture(furnace(0.6))
}

/// The same without its ceiling.
fn courtyard() -> Stage {
    let (corners, is_low) = (room(HALF), |corner: &Vec3| corner.y < 0.9 * HALF.y);
    let low: Vec<Vec3> = corners.chunks_exact(6).filter(|quad| quad.iter().any(is_low)).flatten().copied().collect();
    with_furniture(walled(&low, 0.6))
}

fn with_furniture(stage: Stage) -> Stage {
    let red = Material { base_color: Vec3::new(0.8, 0.1, 0.05).extend(1.0), ..lambert(0.5, 0.0) };
    let glossy = Material { base_color: Vec3::new(0.8, 0.7, 0.6).extend(1.0), roughness: 0.4, ..Material::default() };
    stage
        .surface("red", &quad(Vec3::new(-1.99, -1.2, -1.5), Vec3::Y * 2.4, Vec3::Z * 3.0), red)
        .surface("table", &quad(Vec3::new(-0.9, -0.5, -0.6), Vec3::Z * 1.2, Vec3::X * 1.4), lambert(0.7, 0.0))
        .surface("below", &quad(Vec3::new(-0.9, -0.52, -0.6), Vec3::X * 1.4, Vec3::Z * 1.2), lambert(0.7, 0.0))
        .surface("glossy", &quad(Vec3::new(-0.5, -1.1, 0.8), Vec3::X, Vec3::Y * 0.8), glossy)
}

fn job(scene: &Arc<PreparedScene>, spp: u32, patches: u32) -> BakeJob {
    let config = BakeConfig { spp, seed: 5, patches, ..BakeConfig::default() };
    let (passes, irradiance) = (Passes::FinalOnly, Vec::new());
    BakeJob { scene: scene.clone(), camera: scene.scene.cameras[0].clone(), film: FILM, config, passes, irradiance }
}

fn baked(scene: &Arc<PreparedScene>, spp: u32, patches: u32) -> Bake {
    job(scene, spp, patches).run(|_| ControlFlow::Continue(())).expect("the job is valid").expect("nobody stops it")
}

/// The furnished room and a bake of it with 512 patches, made once for all laws that look at its patches alone.
pub(super) fn furnished_and_baked() -> &'static (Arc<PreparedScene>, Bake) {
    static BAKED: LazyLock<(Arc<PreparedScene>, Bake)> = LazyLock::new(|| {
        let scene = Arc::new(furnished().prepared());
        let bake = baked(&scene, 16, 512);
        (scene, bake)
    });
    &BAKED
}

/// Irradiance of a lamp of 1 cd, at most as that 1 cm away.
fn lit(scene: &PreparedScene, lamp: Vec3) -> impl Fn(&PatchSample) -> Vec3 + Sync {
    move |&sample| {
        let PatchSample { position, normal, .. } = sample;
        let to_lamp = lamp - position;
        let cos = to_lamp.normalize_or_zero().dot(normal);
        let light = cos / to_lamp.length_squared().max(1e-4) * sample.response(cos.max(0.0));
        if cos > 0.0 { scene.transmittance(position, lamp) * light } else { Vec3::ZERO }
    }
}

/// The picture of irradiance on patches, red, green, blue of each pixel.
fn by_patches(bake: &Bake, irradiance: &(dyn Fn(&PatchSample) -> Vec3 + Sync)) -> Vec<f32> {
    applied(bake, bake.groups.last().expect("a group of patches"), irradiance)
}

/// What arrives of it at each pixel.
fn arriving_by_patches(bake: &Bake, irradiance: &(dyn Fn(&PatchSample) -> Vec3 + Sync)) -> Vec<f32> {
    applied(bake, bake.irradiance[0].last().expect("a group of patches"), irradiance)
}

fn applied(bake: &Bake, group: &BlockLowRank, irradiance: &(dyn Fn(&PatchSample) -> Vec3 + Sync)) -> Vec<f32> {
    let coefficients =
        bake.header.coefficients_with(&LightRig::default(), irradiance).pop().expect("a group of patches");
    multiplied(group, &coefficients)
}

/// The picture of a lamp by way of patches, as it is shown.
fn by_lamp(scene: &PreparedScene, bake: &Bake, lamp: FreeLamp, folder: Option<&Path>) -> Vec<f32> {
    let (lamps, _) = PreparedLamps::new(&[lamp], folder).expect("a lamp that makes sense");
    let patches = bake.header.patches.as_ref().expect("patches");
    let coefficients = lamps.light_on_patches(scene, patches, bake.header.config.bounces);
    multiplied(bake.groups.last().expect("a group of patches"), &coefficients)
}

fn multiplied(group: &BlockLowRank, coefficients: &[[f32; 3]]) -> Vec<f32> {
    let channels = [0, 1, 2].map(|c| group.apply(&coefficients.iter().map(|rgb| rgb[c]).collect::<Vec<_>>()));
    (0..channels[0].len()).map(|row| channels[row % 3][row]).collect()
}

/// What narrow lobes show of the light of a lamp of 1 cd, which patches leave out.
fn shown_by_lobes(scene: &PreparedScene, place: Vec3) -> Vec<f32> {
    let free = FreeLamp { position: place, ..lamp(LampShape::Point) };
    let (lamps, _) = PreparedLamps::new(&[free], None).expect("a lamp that makes sense");
    let samples = 256;
    let picture = |narrow_alpha| {
        let config = VisibleConfig { samples, narrow_alpha, ..VisibleConfig::default() };
        let points = VisiblePoints::new(scene, &scene.scene.cameras[0], FILM, config, &|| false).expect("not stopped");
        let mut sum = vec![0.0; 3 * FILM.n_pixels()];
        for pass in 0..samples {
            let picture = points.direct(scene, &lamps, pass, &|| false).expect("not stopped");
            sum.iter_mut().zip(picture.as_flattened()).for_each(|(sum, x)| *sum += x / samples as f32);
        }
        sum
    };
    picture(NARROW_ALPHA).iter().zip(picture(0.0)).map(|(all, direct)| all - direct).collect()
}

/// The picture of a lamp of 1 cd by columns of patches that leave out what lobes of some width show.
fn by_columns(scene: &Arc<PreparedScene>, lamp: Vec3, narrow_alpha: f32) -> Vec<f32> {
    let focus = Focus::default();
    let camera = scene.scene.cameras[0].clone();
    let request = Request { n_patches: 512, bounces: None, seed: 5, narrow_alpha };
    let patches = learn(scene, &camera, FILM, request, &focus).expect("the room has patches");
    let table = patches.table().expect("patches that were just learned");
    let integrator = Integrator::new(scene, &NoLights, None);
    let matrix = PatchMatrix { integrator, camera, film: FILM, seed: 7, table, irradiance: None, empty: None };
    let coefficients = patches.coefficients(&lit(scene, lamp));
    let (n_samples, pixels) = (256, 0..FILM.n_pixels() as u32);
    let row = |pixel: u32| {
        let mut rows = vec![0.0; CHANNELS * matrix.n_cols()];
        matrix.add_rows(&[pixel], 0..n_samples, Half::A, &mut rows, &mut Vec::new());
        let channel = |(c, row): (usize, &[f32])| {
            row.iter().zip(&coefficients).map(|(x, rgb)| x * rgb[c]).sum::<f32>() / n_samples as f32
        };
        rows.chunks_exact(matrix.n_cols()).enumerate().map(channel).collect::<Vec<f32>>()
    };
    pixels.into_par_iter().flat_map_iter(row).collect()
}

/// Light of the lamp `moved` of a scene that was scattered more than once.
fn indirect(scene: &PreparedScene, spp: u32) -> Vec<f32> {
    let basis = &scene.lighting.basis;
    let mut coefficients = vec![[0.0; 3]; basis.n_cols()];
    coefficients[basis.source("moved").expect("the lamp").columns.start as usize] = [1.0; 3];
    let picture = |bounces| {
        let config = TraceConfig { spp, bounces, seed: 3 };
        let pixels =
            trace(scene, &scene.scene.cameras[0], FILM, &coefficients, &config, &|_| ControlFlow::Continue(()));
        pixels.expect("nobody stops it").into_iter().flatten().collect::<Vec<f32>>()
    };
    picture(None).iter().zip(picture(Some(0))).map(|(all, direct)| all - direct).collect()
}

/// Root of the energy of a difference over that of the first, and the sum of the second over that of the first.
fn difference(expected: &[f32], found: &[f32]) -> (f64, f64) {
    let pairs = || expected.iter().zip(found).map(|(a, b)| (f64::from(*a), f64::from(*b)));
    let energy: f64 = pairs().map(|(a, _)| a * a).sum();
    let off: f64 = pairs().map(|(a, b)| (a - b).powi(2)).sum();
    ((off / energy).sqrt(), pairs().map(|(_, b)| b).sum::<f64>() / pairs().map(|(a, _)| a).sum::<f64>())
}

#[test]
fn a_closed_room_of_even_light_is_as_bright_as_its_albedo_says() {
    // The brighter its walls, the more bounces count.
    for albedo in [0.6, 0.9] {
        let bake = baked(&Arc::new(furnace(albedo).prepared()), 32, 512);
        // All surfaces receive 1 straight, a/(1 − a) from each other, and send a/π of what they receive.
        let expected = albedo / PI * albedo / (1.0 - albedo);
        let found = by_patches(&bake, &|_| Vec3::ONE);
        let (off, share) = difference(&vec![expected; found.len()], &found);
        assert!(off < 0.03 && (share - 1.0).abs() < 0.01, "albedo {albedo}: off by {off:.3}, {share:.3} of the light");
    }
}

#[test]
fn a_lamp_that_no_bake_knew_lights_a_room_as_one_of_its_file_does() {
    let scene = Arc::new(furnished().prepared());
    let bake = baked(&scene, 96, 1024);
    // The columns of so few patches leave out some 10 % of a lamp's picture in the mean square.
    for place in [Vec3::new(0.3, 0.7, 0.2), Vec3::new(-1.2, -0.7, 0.3), Vec3::new(1.2, -0.2, -1.0)] {
        let expected = indirect(&furnished().lamp("moved", place, 1.0).prepared(), 512);
        let patches = by_patches(&bake, &lit(&scene, place));
        let found: Vec<f32> = patches.iter().zip(shown_by_lobes(&scene, place)).map(|(x, y)| x + y).collect();
        let (off, share) = difference(&expected, &found);
        println!("{place}: off by {off:.3}, {share:.3} of the light");
        assert!(off < 0.1 && (share - 1.0).abs() < 0.02, "{place}: off by {off:.3}, {share:.3} of the light");
    }
}

fn baked_with_irradiance(scene: &Arc<PreparedScene>, spp: u32, patches: u32) -> Bake {
    let job = BakeJob { irradiance: vec![IrradianceRows::Pixels], ..job(scene, spp, patches) };
    job.run(|_| ControlFlow::Continue(())).expect("the job is valid").expect("nobody stops it")
}

#[test]
fn in_a_closed_room_of_even_light_arrives_what_its_albedo_says() {
    for albedo in [0.6, 0.9] {
        let bake = baked_with_irradiance(&Arc::new(furnace(albedo).prepared()), 32, 512);
        assert!(bake.header.holds_patches(&bake.irradiance[0]));
        // Beside the 1 that comes straight.
        let expected = albedo / (1.0 - albedo);
        let found = arriving_by_patches(&bake, &|_| Vec3::ONE);
        let (off, share) = difference(&vec![expected; found.len()], &found);
        assert!(off < 0.03 && (share - 1.0).abs() < 0.01, "albedo {albedo}: off by {off:.3}, {share:.3} of the light");
    }
}

#[test]
fn where_nothing_comes_back_the_columns_of_patches_are_there_and_dark() {
    let bake = baked_with_irradiance(&Arc::new(furnace(0.6).prepared()), 8, 64);
    let mut groups = bake.irradiance[0].clone();
    for block in groups.last_mut().expect("a group of patches").blocks.iter_mut().flatten() {
        let BlockFactors { n_rows, n_cols, n_samples, .. } = **block;
        *block = Arc::new(BlockFactors { n_rows, n_cols, n_samples, ..BlockFactors::default() });
    }
    assert!(bake.header.holds_patches(&groups));
    assert!(!bake.header.holds_patches(&bake.header.empty_irradiance()[0]));
}

#[test]
fn as_much_arrives_from_a_lamp_that_no_bake_knew_as_from_one_of_its_file() {
    let scene = Arc::new(furnished().prepared());
    let (bake, camera) = (baked_with_irradiance(&scene, 96, 1024), &scene.scene.cameras[0]);
    for place in [Vec3::new(0.3, 0.7, 0.2), Vec3::new(-1.2, -0.7, 0.3)] {
        let with_lamp = Arc::new(furnished().lamp("moved", place, 1.0).prepared());
        let known = baked_with_irradiance(&with_lamp, 256, 0);
        let source = known.header.basis.source("moved").expect("the lamp").columns.start as usize;
        let mut unit = vec![0.0; known.header.basis.n_cols()];
        unit[source] = 1.0 / known.header.irradiance[0].column_scale[source];
        let expected = known.irradiance[0][0].apply(&unit);
        let lamp = FreeLamp { position: place, ..lamp(LampShape::Point) };
        let (lamps, _) = PreparedLamps::new(&[lamp], None).expect("a plain lamp");
        let straight = |at: &PatchSample| lamps.light_on(&scene, at, IN_A_ROW);
        let mut found = arriving_by_patches(&bake, &straight);
        for sample in 0..16 {
            let points = ArrivingPoints::new(&scene, camera, FILM, sample, &|| false).expect("nobody stops it");
            let direct = points.irradiance(&scene, &lamps, None, &|| false).expect("nobody stops it");
            found.iter_mut().zip(direct.as_flattened()).for_each(|(sum, lux)| *sum += lux / 16.0);
        }
        let (off, share) = difference(&expected, &found);
        assert!(off < 0.06 && (share - 1.0).abs() < 0.02, "{place}: off by {off:.3}, {share:.3} of the light");
        let (_, direct) = difference(&expected, &arriving_by_patches(&bake, &straight));
        assert!(direct > 0.1, "{direct:.3} of the light comes by way of surfaces");
    }
}

#[test]
fn what_narrow_lobes_show_is_found_once_by_patches_or_anew() {
    let bronze = Material { metallic: 1.0, roughness: 0.33, ..Material::default() };
    let panel = quad(Vec3::new(-1.6, -1.1, -1.49), Vec3::X * 2.6, Vec3::Y * 2.0);
    let scene = Arc::new(furnished().surface("bronze", &panel, bronze).prepared());
    let place = Vec3::new(0.3, 0.7, 0.2);
    let whole = by_columns(&scene, place, 0.0);
    let (rest, shown) = (by_columns(&scene, place, NARROW_ALPHA), shown_by_lobes(&scene, place));
    let both: Vec<f32> = rest.iter().zip(&shown).map(|(x, y)| x + y).collect();
    let sum = |picture: &[f32]| picture.iter().map(|x| f64::from(*x)).sum::<f64>();
    let (off, share) = difference(&whole, &both);
    let shown = sum(&shown) / sum(&whole);
    println!("off by {off:.3}, {share:.4} of the light, {shown:.4} of it shown by lobes");
    assert!(shown > 0.03, "lobes show {shown:.4} of the light, too little to tell");
    assert!((share - 1.0).abs() < 0.01, "{share:.4} of the light");
    assert!(difference(&whole, &rest).1 < 1.0 - 0.7 * shown, "patches leave it out");
    assert!(off < 0.2, "off by {off:.3}");
}

#[test]
fn a_coated_room_is_as_bright_as_it_is_traced() {
    // Coats reflect more of light that grazes them than of a lamp's light from the middle of the room.
    let coated = || Material { base_color: Vec3::splat(0.3).extend(1.0), roughness: 0.75, ..Material::default() };
    let room =
        || Stage::new(camera()).surface("walls", &room(HALF), coated()).lamp("own", Vec3::new(1.5, 1.0, -1.2), 1.0);
    let scene = Arc::new(room().prepared());
    let bake = baked(&scene, 48, 1024);
    let [mut by_angle, mut by_mean] = [0.0; 2];
    let places = [Vec3::new(0.3, 0.2, 0.2), Vec3::new(-0.4, 0.4, 0.3), Vec3::new(0.5, -0.3, -0.5)];
    for place in places {
        let expected = indirect(&room().lamp("moved", place, 1.0).prepared(), 256);
        let found = |picture: &[f32]| difference(&expected, picture).1 / places.len() as f64;
        by_angle += found(&by_patches(&bake, &lit(&scene, place)));
        let alike = |sample: &PatchSample| lit(&scene, place)(&PatchSample { grazing: 0.0, ..*sample });
        by_mean += found(&by_patches(&bake, &alike));
    }
    println!("{by_angle:.3} of the light, {by_mean:.3} if light from all directions counts alike");
    assert!((by_angle - 1.0).abs() < 0.02, "{by_angle:.3} of the light");
    assert!(by_mean > by_angle + 0.01, "{by_mean:.3} if light from all directions counts alike");
}

#[test]
fn without_lamps_a_bake_with_patches_is_the_bake_without() {
    let scene = Arc::new(furnished().prepared());
    let (with, without) = (baked(&scene, 8, 64), baked(&scene, 8, 0));
    assert_eq!(with.groups.len(), without.groups.len() + 1);
    for (with, without) in with.groups.iter().zip(&without.groups) {
        assert_eq!(with.blocks, without.blocks);
    }
    let dark = with.header.coefficients(&LightRig::default()).pop().expect("a group of patches");
    assert!(dark.iter().all(|rgb| *rgb == [0.0; 3]));
    assert_eq!(with.figures().error_db, without.figures().error_db);
}

#[test]
fn patches_are_the_same_on_any_number_of_threads_and_come_back_from_a_file() {
    let scene = Arc::new(furnished().prepared());
    let pool = |n: usize| rayon::ThreadPoolBuilder::new().num_threads(n).build().expect("threads");
    // Rows of irradiance have columns of patches, too.
    let job = || BakeJob { irradiance: vec![IrradianceRows::Pixels], ..job(&scene, 8, 64) };
    let run = || job().run(|_| ControlFlow::Continue(())).expect("the job is valid").expect("nobody stops it");
    let [one, three] = [1, 3].map(|n| pool(n).install(run));
    let folder = tempfile::tempdir().unwrap();
    let files = [&one, &three].map(|bake| {
        let path = folder.path().join("a.transport");
        archive::write(bake, &path).unwrap();
        std::fs::read(path).unwrap()
    });
    assert!(files[0] == files[1], "files differ");
    let read = archive::decode(&files[0], Path::new("a.transport")).unwrap();
    assert_eq!(read.header, one.header);
    let light = lit(&scene, Vec3::new(0.3, 0.7, 0.2));
    assert_eq!(by_patches(&read, &light), by_patches(&one, &light));
    // A byte of the patches that changed is seen.
    let patches = one.header.patches.as_ref().expect("patches");
    let at = patches.samples()[0].position.x.to_le_bytes();
    let at = files[0].windows(4).position(|bytes| *bytes == at).expect("the first sample is in the file");
    let mut damaged = files[0].clone();
    damaged[at] ^= 1;
    let error = archive::decode(&damaged, Path::new("a.transport")).unwrap_err();
    assert!(error.to_string().contains("its patches"), "{error}");
}

#[test]
fn a_stopped_bake_with_patches_is_taken_up_and_ends_in_the_same_bytes() {
    let scene = Arc::new(furnished().prepared());
    let folder = tempfile::tempdir().unwrap();
    let [whole, stopped] = ["whole", "stopped"].map(|name| folder.path().join(name));
    let restart = archive::Restart::Resume;
    archive::bake_to_file(job(&scene, 8, 64), &whole, restart, |_| ControlFlow::Continue(())).unwrap().unwrap();
    let mut n_left = 2;
    let stop = |event| {
        n_left -= usize::from(matches!(event, crate::bake::BakeEvent::BlockDone { .. }));
        if n_left == 0 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    assert!(archive::bake_to_file(job(&scene, 8, 64), &stopped, restart, stop).unwrap().is_none());
    archive::bake_to_file(job(&scene, 8, 64), &stopped, restart, |_| ControlFlow::Continue(())).unwrap().unwrap();
    assert!(std::fs::read(whole).unwrap() == std::fs::read(stopped).unwrap(), "files differ");
}

fn size(frame: &[f32]) -> f64 {
    frame.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>().sqrt()
}

/// Magnitude of the largest value of a picture.
pub(super) fn peak(frame: &[f32]) -> f64 {
    frame.iter().map(|x| f64::from(x.abs())).fold(0.0, f64::max)
}

/// Holds the pictures of a lamp on its way, 0…1, against the first: the brightest, and the largest change of 128 steps, of the whole
/// picture and of a value over the brightest one.
#[track_caller]
fn assert_even(what: &str, picture: impl Fn(f32) -> Vec<f32>, [most, most_change, most_of_pixel]: [f64; 3]) {
    let frames: Vec<Vec<f32>> = (0..=128).map(|nth| picture(nth as f32 / 128.0)).collect();
    let typical = size(&frames[0]);
    let brightest = frames.iter().map(|frame| size(frame)).fold(0.0, f64::max) / typical;
    let change = |w: &[Vec<f32>]| w[0].iter().zip(&w[1]).map(|(a, b)| a - b).collect::<Vec<f32>>();
    let changes: Vec<Vec<f32>> = frames.windows(2).map(change).collect();
    let largest = changes.iter().map(|change| size(change)).fold(0.0, f64::max) / typical;
    let of_pixel = changes.iter().map(|change| peak(change)).fold(0.0, f64::max) / peak(&frames[0]);
    println!("{what}: {brightest:.2} times the light, steps of {largest:.3} of it, {of_pixel:.3} of a pixel");
    assert!(brightest < most, "{what}: a flash of {brightest:.2} times the light");
    assert!(largest < most_change, "{what}: a jump of {largest:.3} of the light");
    // Light that comes by way of surfaces spreads: no pixel has a step for itself.
    assert!(of_pixel < most_of_pixel, "{what}: a pixel that jumps by {of_pixel:.3} of the brightest");
}

#[test]
fn while_a_lamp_moves_evenly_the_picture_does() {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("one-sided.ies"), ONE_SIDED).expect("the folder can be written");
    let (scene, bake) = furnished_and_baked();
    // Down from the middle of the room to a hand above the floor, past the edge of the table.
    let [from, to] = [Vec3::new(-1.1, 0.8, 0.4), Vec3::new(-1.1, -1.1, 0.5)];
    for shape in [LampShape::Point, LampShape::Profile { file: "one-sided.ies".into() }] {
        let picture = |t: f32| {
            let position = from.lerp(to, t);
            let aim = position + Vec3::new(0.2, -1.0, -0.4);
            by_lamp(scene, bake, FreeLamp { position, aim, ..lamp(shape.clone()) }, Some(folder.path()))
        };
        assert_even(&format!("{shape:?}"), picture, [1.4, 0.06, 0.2]);
    }
}

#[test]
fn while_parallel_light_turns_evenly_the_picture_does() {
    let scene = Arc::new(courtyard().prepared());
    let bake = baked(&scene, 16, 512);
    // Across the yard, so that the edges of the walls and of the table throw their shadows over the floor; 0.5 degrees a step.
    let picture = |t: f32| {
        let (sin, cos) = (1.1 * t - 0.55).sin_cos();
        let aim = Vec3::Y + Vec3::new(sin, -cos, 0.3);
        by_lamp(&scene, &bake, FreeLamp { aim, ..lamp(LampShape::Directional { radius_rad: 0.0 }) }, None)
    };
    assert_even("parallel light", picture, [1.4, 0.06, 0.2]);
}

/// Middles of patches, and the way that the first sample of each looks.
pub(super) fn middles(mut samples: &[PatchSample]) -> Vec<(Vec3, Vec3)> {
    let mut middles = Vec::new();
    while let Some(first) = samples.first() {
        // Those of a patch share it evenly.
        let (own, others) = samples.split_at((1.0 / first.weight).round() as usize);
        let sum: Vec3 = own.iter().map(|sample| sample.position).sum();
        middles.push((sum / own.len() as f32, first.normal));
        samples = others;
    }
    middles
}

#[test]
fn a_lamp_where_none_should_be_makes_no_flash() {
    let (scene, bake) = furnished_and_baked();
    let size = |position: Vec3| {
        let picture = by_lamp(scene, bake, FreeLamp { position, ..lamp(LampShape::Point) }, None);
        assert!(picture.iter().all(|x| x.is_finite()), "{position}");
        size(&picture)
    };
    let typical = size(Vec3::new(0.3, 0.7, 0.2));
    // On points where patches are asked, in their middles, and a little above; outside, far away, and at the camera.
    let patches = bake.header.patches.as_ref().expect("patches");
    let asked = patches.samples().iter().step_by(37).map(|sample| (sample.position, sample.normal));
    let of_patches = middles(patches.samples()).into_iter().step_by(31);
    let places = asked.chain(of_patches);
    let places = places.flat_map(|(place, normal)| [0.0, 1e-6, 1e-3, 0.02].map(|above| place + normal * above));
    let brightest = places.map(size).fold(0.0, f64::max);
    println!("{:.2} times the light", brightest / typical);
    assert!(brightest < 3.0 * typical, "a flash of {:.2} times the light", brightest / typical);
    assert!(size(Vec3::new(2.5, 0.0, 0.0)) < 1e-3 * typical && size(Vec3::splat(9e5)) < 1e-3 * typical);
    size(scene.scene.cameras[0].position());
}

/// A table and a leaf in the open: most blocks have pixels that see nothing beside others.
fn in_the_open() -> Stage {
    let camera = Camera::look_at("aside", Vec3::new(0.4, 0.9, 3.0), Vec3::new(0.0, 0.4, 0.0), 0.9, 4.0 / 3.0);
    Stage::new(camera)
        .surface("table", &quad(Vec3::new(-1.0, 0.0, 0.8), Vec3::X * 2.0, Vec3::NEG_Z * 1.6), lambert(0.7, 0.0))
        .surface("leaf", &quad(Vec3::new(-0.3, 0.1, 0.0), Vec3::X * 0.6, Vec3::Y * 0.7), lambert(0.5, 0.0))
        .lamp("right", Vec3::new(0.5, 1.5, 1.0), 3.0)
        .lamp("left", Vec3::new(-0.9, 0.6, 0.5), 1.0)
}

#[test]
fn pixels_that_see_nothing_get_no_light_of_any_lamp() {
    let scene = Arc::new(in_the_open().prepared());
    let empty = EmptyPixels::find(&scene.scene.mesh, &scene.scene.cameras[0], FILM).expect("there is much of nothing");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("open.transport");
    archive::write(&baked(&scene, 16, 32), &path).unwrap();
    assert_eq!(std::fs::read(&path).unwrap()[8..12], 9u32.to_le_bytes());
    let bake = archive::read(&path).unwrap();
    let free = FreeLamp { position: Vec3::new(-0.2, 0.8, 0.6), ..lamp(LampShape::Point) };
    let own = &bake.groups[0];
    let alone = [[1.0f32, 0.0], [0.0, 1.0]].map(|of_lamps| own.apply(&of_lamps));
    for picture in alone.into_iter().chain([by_lamp(&scene, &bake, free, None)]) {
        let is_lit = |pixel: usize| picture[CHANNELS * pixel..][..CHANNELS].iter().any(|x| *x != 0.0);
        let (nothing, others): (Vec<usize>, Vec<usize>) =
            (0..FILM.n_pixels()).partition(|&pixel| empty.contains(pixel));
        let n_lit = others.iter().filter(|pixel| is_lit(**pixel)).count();
        assert!(nothing.len() > 100 && n_lit > 40, "{} and {n_lit} pixels", nothing.len());
        assert!(!nothing.iter().any(|pixel| is_lit(*pixel)), "light where nothing is");
    }
}
