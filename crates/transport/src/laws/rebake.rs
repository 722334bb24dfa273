//! A bake that takes columns over from an earlier one is the bake of its scene.

use std::ops::ControlFlow;
use std::sync::{Arc, LazyLock};

use clerestory_nystrom::BlockFactors;
use glam::{Affine2, Vec3};

use super::stage::{Stage, lambert, pane, quad, room};
use super::walks::assert_same_mean;
use crate::archive::{self, Restart};
use crate::bake::focus::Focus;
use crate::bake::reuse::{NothingKept, Reuse};
use crate::bake::{Bake, BakeConfig, BakeEvent, BakeHeader, BakeJob, HalfDone, Indirect, Passes};
use crate::basis::LightSource;
use crate::camera::{Camera, Film};
use crate::error_maps::BlockMap;
use crate::fingerprint::digest;
use crate::irradiance::IrradianceRows;
use crate::light::LightRig;
use crate::matrix::CHANNELS;
use crate::prepared::PreparedScene;
use crate::scene::{AlphaMode, Encoding, Filter, Image, Scene, Texture, TextureRef, Wrap};
use crate::sensors::{IrradianceRequest, OfFile, SensorGrid, WorkPlane};
use crate::skips::{Skip, Skips};

const FILM: Film = Film { width: 48, height: 32 };
/// Largest standard error of a difference of means, relative to the mean: four of them, 1 %, are what a test accepts.
const SHARP: f64 = 2.5e-3;

/// A room with a panel, a shining quad and two lamps; `change` is what was done to the file.
fn scene(change: impl FnOnce(&mut Scene)) -> Scene {
    let camera = Camera::look_at("inside", Vec3::new(0.3, 0.1, 0.9), Vec3::new(-0.2, -0.3, -1.0), 1.1, 1.5);
    let stage = Stage::new(camera)
        .surface("walls", &room(Vec3::new(1.0, 0.8, 1.2)), lambert(0.6, 0.0))
        .surface("table", &quad(Vec3::new(-0.4, -0.4, -0.4), Vec3::Z * 0.6, Vec3::X * 0.6), lambert(0.5, 0.0))
        .surface("pane", &quad(Vec3::new(-0.9, -0.2, 0.0), Vec3::X * 0.5, Vec3::Y * 0.5), pane())
        .surface("strip", &quad(Vec3::new(0.6, 0.6, -1.0), Vec3::X * 0.3, Vec3::Z * 0.3), lambert(0.1, 4.0))
        .panel("panel", &quad(Vec3::new(-0.5, 0.75, -0.5), Vec3::X * 0.6, Vec3::Z * 0.6), 3.0, 4)
        .lamp("left", Vec3::new(-0.6, 0.5, 0.2), 1.0)
        .lamp("right", Vec3::new(0.7, 0.3, -0.6), 2.0);
    let mut scene = stage.prepared().scene;
    change(&mut scene);
    scene
}

fn add_lamp(scene: &mut Scene) {
    let mut node = scene.nodes[scene.punctual[0].node as usize].clone();
    (node.index, node.name) = (scene.nodes.len() as u32, Some("new".into()));
    let mut lamp = scene.punctual[0].clone();
    (lamp.node, lamp.position, lamp.intensity) = (node.index, Vec3::new(0.1, -0.1, -0.9), 0.5);
    scene.nodes.push(node);
    scene.punctual.push(lamp);
}

fn job(scene: Scene) -> BakeJob {
    job_with(scene, Skips::default())
}

fn job_with(scene: Scene, skips: Skips) -> BakeJob {
    let scene = PreparedScene::with_skips(scene, &[], None, skips).expect("a stage has valid lights").0;
    let camera = scene.scene.cameras[0].clone();
    let config = BakeConfig { spp: 32, tolerance_db: 50.0, ..BakeConfig::default() };
    let (passes, irradiance) = (Passes::FinalOnly, vec![IrradianceRows::Pixels]);
    BakeJob { scene: Arc::new(scene), camera, film: FILM, config, passes, irradiance }
}

/// The job of a scene whose walls scatter little, with many samples and in blocks that are independent of each other.
fn sharp_job(change: fn(&mut Scene)) -> BakeJob {
    let dim = |scene: &mut Scene| {
        scene.materials[0].base_color = Vec3::splat(0.2).extend(1.0);
        change(scene);
    };
    let mut job = job(scene(dim));
    job.config = BakeConfig { spp: 128, block: 8, denoise: false, ..job.config.clone() };
    job.irradiance.clear();
    job
}

fn other_strengths(scene: &mut Scene) {
    (scene.punctual[0].intensity, scene.punctual[0].color) = (7.0, Vec3::new(1.0, 0.5, 0.2));
    let (strip, left) = (3, scene.punctual[0].node as usize);
    scene.materials[strip].emissive_strength = 11.7;
    scene.materials[strip].emissive = Vec3::new(0.3, 0.9, 0.4);
    scene.nodes[left].name = Some("renamed".into());
}

fn lower_a_lamp(scene: &mut Scene) {
    scene.punctual[0].position.y -= 0.4;
}

fn baked(job: BakeJob) -> Bake {
    job.run(|_| ControlFlow::Continue(())).expect("the job is valid").expect("nobody stops it")
}

/// The bake of the room as it is, made once for all laws.
fn room_baked() -> &'static Bake {
    static BAKED: LazyLock<Bake> = LazyLock::new(|| baked(job(scene(|_| {}))));
    &BAKED
}

/// The bake of a job with what an earlier one has, and how many of its columns were traced.
fn rebaked(job: BakeJob, earlier: &Bake) -> (Bake, usize) {
    let reuse = job.reuse(earlier).expect("something is the same");
    let n_traced = reuse.n_traced_columns();
    assert_eq!(reuse.n_kept_columns() + n_traced, job.scene.lighting.basis.n_cols());
    let bake = job.run_reusing(&reuse, &Focus::default(), None, |_| ControlFlow::Continue(()));
    (bake.expect("the job is valid").expect("nobody stops it"), n_traced)
}

/// One column of a matrix, 0 being the picture, at unit light.
fn column(bake: &Bake, matrix: usize, key: &str) -> Vec<f32> {
    let LightSource { columns, .. } = bake.header.basis.source(key).expect("the light is there");
    let (groups, scale) = match matrix {
        0 => (&bake.groups, &bake.header.column_scale),
        _ => (&bake.irradiance[matrix - 1], &bake.header.irradiance[matrix - 1].column_scale),
    };
    let place = bake.header.basis.groups.iter().position(|group| group.columns.contains(&columns.start));
    let place = place.expect("every column has a group");
    let start = bake.header.basis.groups[place].columns.start;
    let unit: Vec<f32> = (0..groups[place].n_cols)
        .map(|col| if columns.contains(&(start + col)) { 1.0 / scale[(start + col) as usize] } else { 0.0 })
        .collect();
    groups[place].apply(&unit)
}

/// Green light under the file's own lights, mean by mean over 8 × 8 pixels.
fn means(bake: &Bake, key: Option<&str>) -> Vec<f64> {
    let rows: Vec<f32> = match key {
        Some(key) => column(bake, 0, key),
        None => {
            let mut sum = vec![0.0; CHANNELS * FILM.n_pixels()];
            for (group, light) in bake.groups.iter().zip(bake.header.coefficients(&LightRig::default())) {
                let green: Vec<f32> = light.iter().map(|rgb| rgb[1]).collect();
                sum.iter_mut().zip(group.apply(&green)).for_each(|(sum, value)| *sum += value);
            }
            sum
        }
    };
    let mut means = vec![0.0; FILM.n_pixels() / 64];
    for (pixel, rgb) in rows.chunks_exact(CHANNELS).enumerate() {
        let (x, y) = (pixel % FILM.width as usize / 8, pixel / FILM.width as usize / 8);
        means[y * (FILM.width as usize / 8) + x] += f64::from(rgb[1]) / 64.0;
    }
    means
}

fn bytes_of(bake: &Bake) -> Vec<u8> {
    let folder = tempfile::tempdir().expect("there is room");
    let path = folder.path().join("a.transport");
    archive::write(bake, &path).expect("it can be written");
    std::fs::read(path).expect("it was just written")
}

const OLD: [&str; 4] = ["strip", "left", "right", "panel"];

#[test]
fn a_new_lamp_is_traced_alone_and_the_other_columns_stay_to_the_last_bit() {
    let earlier = room_baked();
    let (again, n_traced) = rebaked(job(scene(add_lamp)), earlier);
    assert_eq!(n_traced, 1);
    let skipped = again.figures().skipped;
    assert_eq!(skipped.reused_columns, 19);
    let per_column = skipped.reused_connections_saved / 19.0 / FILM.n_pixels() as f64;
    assert!((1.0..=32.0).contains(&per_column), "up to 32 samples of a pixel: {skipped:?}");
    assert_eq!(earlier.figures().skipped.reused_connections_saved, 0.0);
    assert_eq!(again.header.column_error.len(), again.header.basis.n_cols(), "errors of old and new columns");
    for key in OLD {
        assert!((0..2).all(|matrix| column(&again, matrix, key) == column(earlier, matrix, key)), "{key}");
    }
    for (kept, before) in again.groups.iter().zip(&earlier.groups) {
        assert!(kept.blocks == before.blocks, "its factors are the same");
    }
    // It is a bake as any other: its file comes back, and serves the next one.
    let read = archive::decode(&bytes_of(&again), std::path::Path::new("a.transport")).expect("it is whole");
    assert!(read.header == again.header && bytes_of(&read) == bytes_of(&again));
    let (third, n_traced) = rebaked(job(scene(add_lamp)), &read);
    assert!(n_traced == 0 && column(&third, 0, "new") == column(&again, 0, "new"));
}

#[test]
fn a_connection_that_a_dark_lamp_saves_is_not_saved_once_more_by_its_earlier_bake() {
    let job_of = |change: fn(&mut Scene)| {
        let job = job(scene(change));
        BakeJob { irradiance: Vec::new(), config: BakeConfig { spp: 4, ..job.config.clone() }, ..job }
    };
    let turn_off: fn(&mut Scene) = |scene| scene.punctual[0].intensity = 0.0;
    let earlier = baked(job_of(turn_off));
    let (again, n_traced) = rebaked(
        job_of(|scene| {
            scene.punctual[0].intensity = 0.0;
            add_lamp(scene);
        }),
        &earlier,
    );
    let skipped = again.figures().skipped;
    assert_eq!((n_traced, skipped.reused_columns, skipped.dark_lamp_columns), (1, 19, 1));
    let reused_and_lit = skipped.reused_connections_saved / skipped.connections_saved;
    assert!((reused_and_lit - 18.0).abs() < 0.01, "{skipped:?}");
}

#[test]
fn samples_are_told_over_all_columns_whoever_traced_them() {
    let all = room_baked();
    let mut joined = all.clone();
    // Columns of a panel that took half of the samples.
    for block in joined.groups[1].blocks.iter_mut().flatten() {
        Arc::make_mut(block).n_samples /= 2;
    }
    let samples = |bake: &Bake| bake.block_map(BlockMap::Samples)[0].expect("its blocks are there");
    let [lamps, panel] = [0, 1].map(|group| all.groups[group].n_cols as f32);
    let expected = samples(all) * (lamps + 0.5 * panel) / (lamps + panel);
    assert!((samples(&joined) - expected).abs() < 1e-3, "{} is not {expected}", samples(&joined));
    let [whole, less] = [all, &joined].map(|bake| bake.figures().skipped);
    assert!(less.samples_saved > whole.samples_saved + 0.1, "{} and {}", less.samples_saved, whole.samples_saved);
    assert_eq!(less.converged_blocks, joined.groups[1].blocks.len());
}

#[test]
fn what_a_file_says_of_strength_color_and_name_needs_no_rays() {
    let earlier = room_baked();
    let (again, n_traced) = rebaked(job(scene(other_strengths)), earlier);
    assert_eq!(n_traced, 0);
    assert!(column(&again, 0, "renamed") == column(earlier, 0, "left"));
}

/// What changes a scene, and the lights that are looked at then.
type Changed<'a> = (fn(&mut Scene), &'a [&'a str]);

#[test]
fn what_is_taken_over_has_the_light_of_a_bake_from_scratch() {
    let earlier = baked(sharp_job(|_| {}));
    let changes: [Changed; 3] =
        [(add_lamp, &["new", "left"]), (other_strengths, &["renamed"]), (lower_a_lamp, &["left", "right"])];
    for (change, keys) in changes {
        let (again, full) = (rebaked(sharp_job(change), &earlier).0, baked(sharp_job(change)));
        for key in keys.iter().map(|key| Some(*key)).chain([None]) {
            let what = format!("{} of a scene with {keys:?}", key.unwrap_or("the picture"));
            assert_same_mean(&means(&again, key), &means(&full, key), SHARP, &what);
        }
    }
}

#[test]
fn a_lamp_that_is_gone_leaves_its_group_and_one_that_moved_is_traced_again() {
    let earlier = room_baked();
    let gone = |scene: &mut Scene| {
        scene.punctual.remove(0);
    };
    let (again, n_traced) = rebaked(job(scene(gone)), earlier);
    assert!(n_traced == 0 && again.header.basis.source("left").is_none());
    assert!(column(&again, 0, "panel") == column(earlier, 0, "panel"));
    // Its group was packed again: that costs a share of the error, which it tells.
    let error = |bake: &Bake| bake.figures().error_db.total;
    assert!(error(&again) > error(earlier) - 1.0, "{} after {}", error(&again), error(earlier));
    let (a, b) = (column(&again, 0, "right"), column(earlier, 0, "right"));
    let square = |values: &mut dyn Iterator<Item = f32>| values.map(|x| f64::from(x).powi(2)).sum::<f64>();
    let off = square(&mut a.iter().zip(&b).map(|(a, b)| a - b)) / square(&mut b.iter().copied());
    assert!(off < 1e-3, "packed again, it is off by {off} of its square");

    let (_, n_traced) = rebaked(job(scene(lower_a_lamp)), earlier);
    assert_eq!(n_traced, 1);
}

#[test]
fn lamps_that_had_a_rank_in_common_have_it_where_few_of_them_are_left() {
    let job_of = |change: fn(&mut Scene)| {
        let mut job = job(scene(change));
        job.config.denoise = false;
        job
    };
    let lower_all = |scene: &mut Scene| scene.punctual.iter_mut().for_each(|lamp| lamp.position.y -= 0.2);
    let earlier = baked(job_of(|_| {}));
    assert_eq!((earlier.figures().lamps_together, &earlier.header.together), (3, &None));
    let (again, n_traced) = rebaked(job_of(lower_all), &earlier);
    assert_eq!((n_traced, again.figures().lamps_together), (2, 3), "one that stayed, and two beside each other");
    // And once more, where nothing is traced.
    let (third, n_traced) = rebaked(job_of(lower_all), &again);
    assert_eq!((n_traced, third.header.together.clone()), (0, again.header.together.clone()));
}

#[test]
fn what_every_column_sees_is_never_taken_over_when_it_has_changed() {
    let earlier = room_baked();
    let why = |job: BakeJob| job.reuse(earlier).err();
    assert_eq!(why(job(scene(|_| {}))), None);
    let table = 12;
    assert_eq!(why(job(scene(|s| s.mesh.positions[3 * table].y -= 1e-4))), Some(NothingKept::Surfaces));
    assert_eq!(why(job(scene(|s| s.materials[0].base_color.x += 0.01))), Some(NothingKept::Surfaces));
    assert_eq!(why(job(scene(|s| s.materials[0].double_sided = true))), Some(NothingKept::Surfaces));
    let plain = || job(scene(|_| {}));
    let camera = Camera { yfov_rad: 1.2, ..plain().camera };
    assert_eq!(why(BakeJob { camera, ..plain() }), Some(NothingKept::View));
    assert_eq!(why(BakeJob { film: Film { width: 47, ..FILM }, ..plain() }), Some(NothingKept::View));
    let config = BakeConfig { bounces: Some(2), ..plain().config };
    assert_eq!(why(BakeJob { config, ..plain() }), Some(NothingKept::Settings));
    let dark = baked(BakeJob { irradiance: Vec::new(), ..plain() });
    assert_eq!(job(scene(add_lamp)).reuse(&dark).err(), Some(NothingKept::Irradiance));
    assert_eq!(why(job_with(scene(|_| {}), Skips::default().without(Skip::Lobes))), Some(NothingKept::Settings));
    assert_eq!(why(job_with(scene(|_| {}), Skips::default().without(Skip::Reuse))), Some(NothingKept::Off));
    let others = |s: &mut Scene| {
        s.punctual.clear();
        s.materials[3].emissive = Vec3::ZERO;
        s.materials[4].emissive = Vec3::ZERO;
    };
    assert_eq!(why(job(scene(others))), Some(NothingKept::Lights), "a uniform sky is none of them");
    let unknown = Bake { packed: None, ..earlier.clone() };
    assert_eq!(plain().reuse(&unknown).err(), Some(NothingKept::Unknown));
}

/// The same with a leaf at a place, and walls of some transparency.
fn with_leaf(at: Vec3, walls: AlphaMode) -> BakeJob {
    let job = job(scene(|scene| {
        scene.materials[0].alpha = walls;
        let mesh = &mut scene.mesh;
        let first = mesh.positions.len() as u32;
        mesh.positions.extend([at, at + 0.2 * Vec3::Z, at + 0.2 * Vec3::X]);
        mesh.normals.extend([Vec3::Y; 3]);
        mesh.triangles.push([first, first + 1, first + 2]);
        mesh.triangle_material.push(1);
        mesh.triangle_node.push(1);
    }));
    BakeJob { config: BakeConfig { spp: 4, ..job.config.clone() }, ..job }
}

#[test]
fn what_moves_behind_closed_walls_needs_no_rays_for_what_the_camera_sees() {
    let [beside, above, inside] = [Vec3::new(2.0, 0.1, 0.0), Vec3::new(0.1, 3.0, 0.2), Vec3::new(0.3, 0.2, 0.1)];
    let closed = |at: Vec3| with_leaf(at, AlphaMode::Opaque);
    let earlier = baked(closed(beside));
    let (again, n_traced) = rebaked(closed(above), &earlier);
    assert_eq!((n_traced, again.irradiance.len()), (0, 1));
    assert!(again.groups == earlier.groups && again.irradiance == earlier.irradiance);
    assert_ne!(again.header.fingerprint, earlier.header.fingerprint);
    let common = |job: &BakeJob| job.grounds().common();
    assert_eq!(common(&closed(beside)), common(&closed(above)), "a cache finds the one beside the other");

    // What comes in, or goes out, is met by light, and so are points of grids outside.
    let why = |job: BakeJob, earlier: &Bake| job.reuse(earlier).err();
    assert_eq!(why(closed(inside), &earlier), Some(NothingKept::Surfaces));
    assert_eq!(why(closed(beside), &baked(closed(inside))), Some(NothingKept::Surfaces));
    let grid = SensorGrid {
        name: "grid".into(),
        origin: Vec3::new(-0.4, -0.5, -0.4),
        u_edge: Vec3::X * 0.5,
        v_edge: Vec3::NEG_Z * 0.5,
        normal: Vec3::Y,
        size: [2, 2],
        left_out: Vec::new(),
    };
    let irradiance = vec![IrradianceRows::Pixels, IrradianceRows::Grid(grid)];
    assert_eq!(why(BakeJob { irradiance, ..closed(above) }, &earlier), Some(NothingKept::Surfaces));
    // Through walls that let light pass all of it counts.
    let open = |at: Vec3| with_leaf(at, AlphaMode::Blend);
    assert!(open(beside).grounds().seen.is_none());
    assert_eq!(why(open(above), &baked(open(beside))), Some(NothingKept::Surfaces));
}

#[test]
fn a_view_stays_what_it_is_when_its_camera_is_renamed() {
    let plain = |scene: Scene| {
        let job = job(scene);
        BakeJob { irradiance: Vec::new(), config: BakeConfig { spp: 4, ..job.config.clone() }, ..job }
    };
    let mut earlier = baked(plain(scene(|_| {})));
    let renamed = plain(scene(|s| s.cameras[0].name = "door".into()));
    let of_file = &renamed.scene.scene;
    assert_eq!(earlier.header.camera_in(of_file), Some(&renamed.camera));
    assert!(!earlier.header.is_of(of_file, &Camera { yfov_rad: 1.2, ..renamed.camera.clone() }));
    let before = plain(scene(|_| {})).camera;
    // In files of before the name counts.
    let with_name = format!("{:016x}", digest(format!("{before:?} {} {} 16", FILM.width, FILM.height).as_bytes()));
    let without = earlier.header.grounds.as_ref().expect("it was not cut short").view.clone();
    for view in [without, with_name] {
        let header = Arc::make_mut(&mut earlier.header);
        header.grounds.as_mut().expect("it was not cut short").view = view;
        let (again, n_traced) = rebaked(renamed.clone(), &earlier);
        assert_eq!((n_traced, &*again.header.camera), (0, "door"));
        assert!(again.header.is_of(of_file, &before));
    }
}

#[test]
fn a_bake_knows_its_surfaces_and_its_view_whatever_lights_them() {
    let job = job(scene(|_| {}));
    let job = BakeJob { irradiance: Vec::new(), config: BakeConfig { spp: 4, ..job.config.clone() }, ..job };
    let header = (*baked(job).header).clone();
    let lit_otherwise = scene(|s| {
        (s.punctual[0].intensity, s.punctual[1].radius_rad) = (7.0, 0.01);
        add_lamp(s);
    });
    assert_eq!(header.camera_in(&lit_otherwise), None);
    assert_eq!(header.camera_on_surfaces_of(&lit_otherwise), Some(&lit_otherwise.cameras[0]));
    let renamed = scene(|s| s.cameras[0].name = "door".into());
    assert_eq!(header.camera_on_surfaces_of(&renamed), Some(&renamed.cameras[0]));
    for other in [
        scene(|s| s.mesh.positions[0].x -= 0.1),
        scene(|s| s.materials[0].roughness *= 0.5),
        scene(|s| s.cameras[0].yfov_rad = 1.2),
    ] {
        assert_eq!(header.camera_on_surfaces_of(&other), None);
    }
    let is_as_baked =
        |change: fn(&mut Scene)| header.has_light_of(&job_with(scene(change), Skips::default()).scene, "left");
    assert!(is_as_baked(|_| {}) && is_as_baked(add_lamp) && is_as_baked(|s| s.punctual[1].intensity = 7.0));
    assert!(!is_as_baked(|s| s.punctual[0].intensity = 7.0), "its strength");
    assert!(!is_as_baked(|s| s.punctual[0].position.x += 0.1), "its place");
    assert!(
        !header.has_light_of(&job_with(scene(add_lamp), Skips::default()).scene, "new"),
        "the bake has none of that name"
    );
    let unknown = BakeHeader { grounds: None, ..header };
    assert_eq!(unknown.camera_on_surfaces_of(&lit_otherwise), None);
}

#[test]
fn rows_of_irradiance_come_to_a_bake_that_has_none_and_leave_its_picture_alone() {
    for (indirect, patches) in [(Indirect::Traced, 0), (Indirect::Shared, 24)] {
        let sensors = |job: BakeJob| {
            let work_planes = vec![WorkPlane { height_m: 0.5, spacing_m: Some(0.4), floor: None }];
            let request = IrradianceRequest { of_file: OfFile::All, nodes: Vec::new(), work_planes };
            let irradiance = request.rows(&job.scene).expect("the room has a floor");
            let config = BakeConfig { spp: 8, indirect, patches, ..job.config };
            let (film, passes) = (Film { width: 32, height: 16 }, Passes::Progressive);
            BakeJob { irradiance, config, passes, film, ..job }
        };
        let whole = baked(sensors(job(scene(|_| {}))));
        let job = sensors(job(scene(|_| {})));
        let of_picture = baked(BakeJob { irradiance: Vec::new(), ..job.clone() });
        let (added, n_traced) = rebaked(job.clone(), &of_picture);
        assert_eq!((n_traced, added.irradiance.len()), (0, 2));
        assert_eq!(added.groups, of_picture.groups);
        assert_eq!(added.irradiance, whole.irradiance, "as if they had been baked with the picture");
        assert_eq!(added.header.irradiance, whole.header.irradiance);
        assert_eq!(added.header.irradiance[0].sharing_bias.is_some(), indirect == Indirect::Shared);
        assert_eq!(added.header.sharing_bias, of_picture.header.sharing_bias);

        // The pixels alone, and then nothing, are left of both.
        for n_rows in [1, 0] {
            let fewer = BakeJob { irradiance: job.irradiance[..n_rows].to_vec(), ..job.clone() };
            let (left, n_traced) = rebaked(fewer, &added);
            assert_eq!((n_traced, left.irradiance.len()), (0, n_rows));
            assert!(left.groups == of_picture.groups && left.irradiance[..] == whole.irradiance[..n_rows]);
        }

        let reuse = job.reuse(&of_picture).expect("the picture is the same");
        assert_eq!(reuse.n_added_rows(), 2);
        let (mut header, mut blocks, mut n_picture) = (None, Vec::new(), 0);
        let n_blocks = whole.header.partition().n_blocks();
        let stopped = job.clone().run_reusing(&reuse, &Focus::default(), None, |event| {
            match event {
                BakeEvent::Started { header: of_whole, .. } => header = Some(of_whole),
                BakeEvent::BlockDone { .. } => n_picture += 1,
                BakeEvent::IrradianceDone { set: 1, block_idx, factors, is_preview: false } => {
                    blocks.push((2 * n_blocks + block_idx, factors));
                    return ControlFlow::Break(());
                }
                _ => {}
            }
            ControlFlow::Continue(())
        });
        assert!(stopped.expect("the job is valid").is_none() && n_picture == n_blocks && blocks.len() == 1);
        let folder = tempfile::tempdir().expect("there is room");
        let path = folder.path().join("added.transport");
        for stop_at in [1, n_blocks + 1, usize::MAX] {
            let mut n_told = 0;
            let go_on = |event: BakeEvent| {
                let is_block =
                    matches!(event, BakeEvent::BlockDone { .. } | BakeEvent::IrradianceDone { is_preview: false, .. });
                n_told += usize::from(is_block);
                if n_told > stop_at { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            };
            let bake = archive::rebake_to_file(job.clone(), &reuse, &path, Restart::Resume, go_on);
            assert_eq!(bake.expect("the job is valid").is_some(), stop_at == usize::MAX);
        }
        let read = archive::read(&path).expect("it is whole");
        assert_eq!(read.header, added.header);
        assert!(read.groups == added.groups && read.irradiance == added.irradiance, "in a file as well");

        let begun = HalfDone { header: header.expect("it began"), blocks };
        let resumed = job.clone().run_reusing(&reuse, &Focus::default(), Some(begun), |_| ControlFlow::Continue(()));
        let resumed = resumed.expect("the job is valid").expect("nobody stops it");
        assert_eq!(bytes_of(&resumed), bytes_of(&added));
    }
}

/// The room with its lamps alone, so that a lamp that is added has the last column, as it has in a bake that took over the others.
fn lamps(change: impl FnOnce(&mut Scene)) -> Scene {
    scene(|scene| {
        let (strip, panel) = (3, 4);
        (scene.materials[strip].emissive, scene.materials[panel].emissive) = (Vec3::ZERO, Vec3::ZERO);
        change(scene);
    })
}

#[test]
fn rows_of_irradiance_come_to_a_bake_to_which_a_lamp_was_added() {
    let dark = |scene: Scene| BakeJob { irradiance: Vec::new(), ..job(scene) };
    let (picture, n_traced) = rebaked(dark(lamps(add_lamp)), &baked(dark(lamps(|_| {}))));
    assert_eq!((n_traced, picture.header.basis.groups.len()), (1, 2), "the lamp has a group of its own");
    let again = || job(lamps(add_lamp));
    let (added, n_traced) = rebaked(again(), &picture);
    assert!(n_traced == 0 && added.groups == picture.groups);
    let whole = baked(again());
    let lux = |bake: &Bake, key: &str| column(bake, 1, key).iter().map(|lux| f64::from(*lux)).sum::<f64>();
    for key in ["left", "right", "new"] {
        // The same samples, in other groups.
        let (found, wanted) = (lux(&added, key), lux(&whole, key));
        assert!(wanted > 0.0 && (found - wanted).abs() < 0.02 * wanted, "{key}: {found} instead of {wanted}");
    }
    let folder = tempfile::tempdir().expect("there is room");
    let path = folder.path().join("a.transport");
    let reuse = again().reuse(&picture).expect("the picture is the same");
    let go_on = |_: BakeEvent| ControlFlow::Continue(());
    archive::rebake_to_file(again(), &reuse, &path, Restart::Resume, go_on).expect("it can be written");
    assert_eq!(std::fs::read(&path).expect("it was written"), bytes_of(&added));
}

#[test]
fn rows_of_irradiance_come_to_a_bake_whose_lights_stand_in_another_order_than_in_the_scene() {
    let dark = |scene: Scene| BakeJob { irradiance: Vec::new(), ..job(scene) };
    let (picture, n_traced) = rebaked(dark(scene(lower_a_lamp)), &baked(dark(scene(|_| {}))));
    assert_eq!((n_traced, &picture.header.basis.sources.last().expect("it is there").key[..]), (1, "left"));
    let again = || job(scene(lower_a_lamp));
    let (added, n_traced) = rebaked(again(), &picture);
    assert!(n_traced == 0 && added.groups == picture.groups && added.irradiance.len() == 1);
    let whole = baked(again());
    let lux = |bake: &Bake, key: &str| column(bake, 1, key).iter().map(|lux| f64::from(*lux)).sum::<f64>();
    for key in OLD {
        // Walks connect to them in another order: that is other noise, and no more.
        let (found, wanted) = (lux(&added, key), lux(&whole, key));
        assert!(wanted > 0.0 && (found - wanted).abs() < 0.02 * wanted, "{key}: {found} instead of {wanted}");
    }
}

/// What a bake of what is new told until it was stopped after so many blocks.
fn half_done(job: BakeJob, reuse: &Reuse, n_blocks: usize) -> HalfDone {
    let (mut header, mut blocks) = (None, Vec::new());
    let stopped = job.run_reusing(reuse, &Focus::default(), None, |event| {
        match event {
            BakeEvent::Started { header: of_whole, .. } => header = Some(of_whole),
            BakeEvent::BlockDone { block_idx, factors, .. } => blocks.push((block_idx, factors)),
            _ => {}
        }
        if blocks.len() == n_blocks { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    assert!(stopped.expect("the job is valid").is_none());
    HalfDone { header: header.expect("it began"), blocks }
}

#[test]
fn blocks_of_a_bake_that_took_columns_over_serve_none_that_takes_over_nothing() {
    let earlier = baked(job(lamps(|_| {})));
    let again = || job(lamps(add_lamp));
    let reuse = again().reuse(&earlier).expect("something is the same");
    let begun = half_done(again(), &reuse, 1);
    assert_eq!(begun.blocks.len(), 1);
    // The earlier bake is gone: the same lights, but in other groups.
    let whole = again().run_toward(&Focus::default(), Some(begun), |_| ControlFlow::Continue(()));
    let whole = whole.expect("the job is valid").expect("nobody stops it");
    assert_eq!(bytes_of(&whole), bytes_of(&baked(again())));
}

#[test]
fn blocks_whose_new_columns_are_in_another_scale_are_traced_again() {
    let earlier = baked(job(lamps(|_| {})));
    let again = || job(lamps(add_lamp));
    let reuse = again().reuse(&earlier).expect("something is the same");
    let HalfDone { mut header, mut blocks } = half_done(again(), &reuse, 2);
    // As of a bake that measured the new lamp beside others.
    *Arc::make_mut(&mut header).column_scale.last_mut().expect("it has a column") *= 2.0;
    for factors in blocks.iter_mut().map(|(_, factors)| factors.last_mut().expect("it has a group")) {
        Arc::make_mut(factors).scale.iter_mut().for_each(|scale| *scale *= 2.0);
    }
    let begun = HalfDone { header, blocks };
    let resumed = again().run_reusing(&reuse, &Focus::default(), Some(begun), |_| ControlFlow::Continue(()));
    let resumed = resumed.expect("the job is valid").expect("nobody stops it");
    assert_eq!(bytes_of(&resumed), bytes_of(&rebaked(again(), &earlier).0));
}

#[test]
fn who_leaves_while_columns_are_measured_hears_of_no_bake() {
    let dark = |scene: Scene| BakeJob { irradiance: Vec::new(), ..job(scene) };
    let earlier = baked(dark(lamps(|_| {})));
    let focus = Focus::default();
    focus.leave();
    for again in [job(lamps(|_| {})), dark(lamps(add_lamp))] {
        let reuse = again.reuse(&earlier).expect("something is the same");
        let left = again.run_reusing(&reuse, &focus, None, |event| panic!("{event:?}"));
        assert!(left.expect("the job is valid").is_none());
    }
}

#[test]
fn a_lamp_that_was_off_is_traced_once_it_is_on() {
    let off = |scene: &mut Scene| scene.punctual[0].intensity = 0.0;
    let earlier = baked(job(scene(off)));
    assert!(column(&earlier, 0, "left").iter().all(|x| *x == 0.0), "nobody connected to it");
    let (again, n_traced) = rebaked(job(scene(|_| {})), &earlier);
    assert!(n_traced == 1 && column(&again, 0, "left").iter().any(|x| *x > 0.0));
    // The other way round its columns are there.
    assert_eq!(rebaked(job(scene(off)), &again).1, 0);
}

#[test]
fn a_stopped_bake_of_what_is_new_goes_on_and_the_events_are_of_the_whole() {
    let earlier = room_baked();
    let again = || job(scene(add_lamp));
    let reuse = again().reuse(earlier).expect("something is the same");
    let begun = half_done(again(), &reuse, 3);
    let shape = |factors: &Vec<Arc<BlockFactors>>| factors.iter().map(|f| f.n_cols as usize).collect::<Vec<_>>();
    let groups: Vec<usize> = begun.header.basis.groups.iter().map(|group| group.columns.len()).collect();
    assert!(begun.blocks.iter().all(|(_, factors)| shape(factors) == groups));
    let (mut n_traced, mut n_told) = (0, 0);
    let resumed = again().run_reusing(&reuse, &Focus::default(), Some(begun), |event| {
        n_told += usize::from(matches!(event, BakeEvent::BlockDone { .. }));
        n_traced += usize::from(matches!(event, BakeEvent::Progress { .. }));
        ControlFlow::Continue(())
    });
    let resumed = resumed.expect("the job is valid").expect("nobody stops it");
    assert_eq!(bytes_of(&resumed), bytes_of(&rebaked(again(), earlier).0));
    assert!(n_told == 6 && n_traced < 6 + 6, "{n_told} blocks, {n_traced} of both matrices traced");
}

#[test]
fn a_file_is_baked_again_in_place_and_taken_up_where_it_stood() {
    let folder = tempfile::tempdir().expect("there is room");
    let path = folder.path().join("a.transport");
    let go_on = |_: BakeEvent| ControlFlow::Continue(());
    let earlier = archive::bake_to_file(job(scene(|_| {})), &path, Restart::Resume, go_on);
    let earlier = earlier.expect("it can be written").expect("nobody stops it");
    let again = || job(scene(add_lamp));
    let reuse = again().reuse(&earlier).expect("something is the same");
    let mut n_blocks = 0;
    let stopped = archive::rebake_to_file(again(), &reuse, &path, Restart::Resume, |event| {
        n_blocks += usize::from(matches!(event, BakeEvent::BlockDone { .. }));
        if n_blocks == 3 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    assert!(stopped.expect("it can be written").is_none() && archive::part_of(&path).exists());
    assert_eq!(archive::read(&path).expect("it is whole").header, earlier.header, "it is there until the end");
    archive::rebake_to_file(again(), &reuse, &path, Restart::Resume, go_on).expect("it can be written");
    let expected = rebaked(again(), &earlier).0;
    assert_eq!(std::fs::read(&path).expect("it was written"), bytes_of(&expected));
}

/// The room with wood on its table. The strip shines by a map of one color, or is off and has none, as an import leaves it.
fn with_map(map: Option<[u8; 4]>) -> Scene {
    let texture = |texel: [u8; 4]| {
        let image = Arc::new(Image { width: 1, height: 1, texels: vec![texel] });
        Texture { image, wrap: [Wrap::Repeat; 2], filter: Filter::Linear }
    };
    let shown =
        |texture: u32| Some(TextureRef { texture, uv_set: 0, transform: Affine2::IDENTITY, encoding: Encoding::Srgb });
    scene(|scene| {
        scene.textures = map.into_iter().chain([[180, 120, 60, 255]]).map(texture).collect();
        scene.materials[1].base_color_texture = shown(scene.textures.len() as u32 - 1);
        match map {
            Some(_) => scene.materials[3].emissive_texture = shown(0),
            None => scene.materials[3].emissive = Vec3::ZERO,
        }
    })
}

#[test]
fn of_a_light_with_another_map_its_own_columns_alone_are_traced() {
    let (red, green) = (Some([255, 0, 0, 255]), Some([0, 255, 0, 255]));
    let (shining, off) = (baked(job(with_map(red))), baked(job(with_map(None))));
    for (earlier, map, n_traced) in
        [(&shining, red, 0), (&shining, None, 0), (&off, None, 0), (&off, red, 1), (&shining, green, 1)]
    {
        let reuse = job(with_map(map)).reuse(earlier).expect("the surfaces are the same");
        assert_eq!(reuse.n_traced_columns(), n_traced, "{map:?}");
    }
    let mut other = with_map(red);
    let image = Arc::new(Image { width: 1, height: 1, texels: vec![[60, 120, 180, 255]] });
    other.textures[1].image = image;
    assert!(matches!(job(other).reuse(&shining), Err(NothingKept::Surfaces)));
}
