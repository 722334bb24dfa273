//! Irradiance, where its value is known by hand.

use std::f32::consts::{FRAC_1_PI, PI};
use std::ops::ControlFlow;
use std::sync::Arc;

use clerestory_nystrom::{BlockLowRank, Half, SampledMatrix};
use glam::{Vec2, Vec3, Vec4};

use super::stage::{Stage, lambert, pane, quad, room, tint};
use super::walks::{Mean, assert_same_mean, file_light};
use crate::archive::{self, Restart};
use crate::bake::{Bake, BakeConfig, BakeEvent, BakeJob, Indirect, Passes};
use crate::camera::{Camera, Film};
use crate::figures::error_db;
use crate::irradiance::IrradianceRows;
use crate::lamps::tests::lamp;
use crate::lamps::{Body, FreeLamp, LampShape, PreparedLamps};
use crate::light::{LightRig, LightSetting};
use crate::matrix::{CHANNELS, TransportMatrix};
use crate::plan::{Density, MatrixPlan};
use crate::prepared::PreparedScene;
use crate::scene::Material;
use crate::sensors::{IrradianceRequest, NodeGrid, OfFile, SensorGrid, WorkPlane};

const FILM: Film = Film { width: 20, height: 18 };

fn above() -> Camera {
    Camera::look_at("above", Vec3::Y * 3.0, Vec3::ZERO, 0.7, 4.0 / 3.0)
}

/// A table of 2 m × 2 m around the origin that faces up.
fn table() -> Vec<Vec3> {
    quad(Vec3::new(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0)
}

fn on_table(scene: &PreparedScene, node: &str, size: [u32; 2]) -> SensorGrid {
    let request = IrradianceRequest { nodes: vec![NodeGrid { node: node.into(), size }], ..Default::default() };
    match request.rows(scene).expect("the table is a quad").remove(0) {
        IrradianceRows::Grid(grid) => grid,
        IrradianceRows::Pixels => panic!("only a grid was asked for"),
    }
}

/// Green irradiance (radiance without `rows`) of every row under the light of the file.
fn sampled(scene: &PreparedScene, rows: Option<&IrradianceRows>, samples: u32) -> Vec<f64> {
    let plan = MatrixPlan::new(&scene.lighting, Density::Full);
    let matrix = TransportMatrix::new(scene, &plan, scene.scene.cameras[0].clone(), FILM, None, 3);
    let matrix = if let Some(rows) = rows { matrix.of_irradiance(rows) } else { matrix };
    let (n_cols, n) = (matrix.n_cols(), matrix.film.n_pixels());
    let bundles: Vec<u32> = (0..n as u32).collect();
    let (mut out, mut sparse) = (vec![0.0; n * CHANNELS * n_cols], Vec::new());
    matrix.add_rows(&bundles, 0..samples, Half::A, &mut out, &mut sparse);
    assert!(rows.is_none() || sparse.is_empty(), "irradiance is nothing that is seen");
    let weights = file_light(scene);
    let green = out.chunks_exact(CHANNELS * n_cols).map(|rows| &rows[n_cols..2 * n_cols]);
    let sum = |row: &[f32]| row.iter().zip(&weights).map(|(value, weight)| f64::from(value * weight)).sum::<f64>();
    green.map(|row| sum(row) / f64::from(samples)).collect()
}

#[test]
fn a_lamp_gives_its_candela_times_cosine_over_squared_distance() {
    let lamp = Vec3::new(0.3, 1.5, -0.2);
    let scene = Stage::new(above()).surface("table", &table(), lambert(0.5, 0.0)).lamp("lamp", lamp, 40.0).prepared();
    let grid = on_table(&scene, "table", [5, 4]);
    let lux = sampled(&scene, Some(&IrradianceRows::Grid(grid.clone())), 1);
    assert_eq!(lux.len(), 20);
    for (number, lux) in (0..).zip(lux) {
        let to_lamp = lamp - grid.point(number).expect("every point of a table is measured");
        let known = f64::from(40.0 * to_lamp.y / to_lamp.length().powi(3));
        assert!((lux - known).abs() < 1e-4 * known, "{lux} lx at point {number}, not {known}");
    }
}

#[test]
fn a_large_ground_with_a_gentle_slope_casts_no_shadow_on_sensors_that_lie_on_it() {
    // A place on it is known more exactly than rays know where it is, whose corners are 150 m away.
    let ground = quad(Vec3::new(-150.0, -0.1, 150.0), Vec3::new(300.0, 0.3, 0.0), Vec3::NEG_Z * 300.0);
    let lamp = Vec3::new(100.0, 350.0, 900.0);
    let stage = Stage::new(above()).surface("ground", &ground, lambert(0.5, 0.0)).lamp("lamp", lamp, 1e9);
    let scene = stage.prepared();
    let grid = on_table(&scene, "ground", [32, 32]);
    let lux = sampled(&scene, Some(&IrradianceRows::Grid(grid.clone())), 1);
    for (number, lux) in (0..).zip(lux) {
        let to_lamp = lamp - grid.point(number).expect("every point of the ground is measured");
        let known = f64::from(1e9 * to_lamp.dot(grid.normal) / to_lamp.length().powi(3));
        assert!((lux - known).abs() < 1e-4 * known, "{lux} lx at point {number}, not {known}");
    }
}

#[test]
fn flat_lamps_of_a_look_bring_every_point_of_a_grid_what_their_parts_send() {
    const SIDE: usize = 128;
    let scene = Stage::new(above()).surface("table", &table(), lambert(0.5, 0.0)).prepared();
    let grid = on_table(&scene, "table", [9, 7]);
    for (shape, height) in [
        (LampShape::Rectangle { size_m: [1.2, 0.06] }, 2.0),
        (LampShape::Rectangle { size_m: [0.04, 1.5] }, 1.2),
        (LampShape::Rectangle { size_m: [1.2, 0.6] }, 0.5),
        (LampShape::Disk { radius_m: 0.4 }, 0.5),
    ] {
        let free = FreeLamp { position: Vec3::Y * height, ..lamp(shape) };
        let (body, _) = Body::of(&free).expect("it has a size");
        let lamps = PreparedLamps::new(std::slice::from_ref(&free), None).expect("a lamp").0;
        let nit = f64::from(lamps.emission("lamp").expect("it shines").y);
        let middle = |cell: usize| (cell as f32 + 0.5) / SIDE as f32;
        let parts =
            (0..SIDE * SIDE).map(|cell| body.sample(Vec2::new(middle(cell % SIDE), middle(cell / SIDE))).position);
        let parts: Vec<Vec3> = parts.collect();
        for point in (0..63).map(|number| grid.point(number).expect("every point of a table is measured")) {
            // The lamp looks down on a level grid: both cosines are its height over the distance.
            let of_part = |part: &Vec3| {
                let to_part = part.as_dvec3() - point.as_dvec3();
                to_part.y.powi(2) / to_part.length_squared().powi(2)
            };
            let known = nit * f64::from(body.area()) * parts.iter().map(of_part).sum::<f64>() / (SIDE * SIDE) as f64;
            let lux = f64::from(lamps.irradiance(&scene, point, Vec3::Y, None).y);
            assert!((lux - known).abs() < 0.01 * known, "{:?}: {lux} lx at {point}, not {known}", free.shape);
        }
    }
}

#[test]
fn light_from_behind_does_not_count() {
    let scene =
        Stage::new(above()).surface("table", &table(), lambert(0.5, 0.0)).lamp("lamp", -Vec3::Y, 40.0).prepared();
    let grid = IrradianceRows::Grid(on_table(&scene, "table", [3, 3]));
    for rows in [&grid, &IrradianceRows::Pixels] {
        assert!(sampled(&scene, Some(rows), 2).iter().all(|lux| *lux == 0.0));
    }
}

#[test]
fn the_open_sky_gives_pi_times_its_radiance() {
    let scene = Stage::new(above()).surface("table", &table(), lambert(0.5, 0.0)).prepared();
    let grid = IrradianceRows::Grid(on_table(&scene, "table", [3, 3]));
    let pixels = sampled(&scene, Some(&IrradianceRows::Pixels), 2);
    let center = pixels[(FILM.height / 2 * FILM.width + FILM.width / 2) as usize];
    for lux in sampled(&scene, Some(&grid), 2).into_iter().chain([center]) {
        assert!((lux - f64::from(PI)).abs() < 1e-5, "{lux} lx under one nit");
    }
}

#[test]
fn a_furnace_gives_pi_times_its_radiance_on_walls_and_in_mid_air() {
    let camera = Camera::look_at("inside", Vec3::new(0.1, 0.0, 0.5), Vec3::NEG_Z, 1.2, 4.0 / 3.0);
    let scene = Stage::new(camera).surface("walls", &room(Vec3::new(1.0, 0.7, 1.3)), lambert(0.5, 0.5)).prepared();
    let request = IrradianceRequest {
        of_file: OfFile::All,
        work_planes: vec![WorkPlane { height_m: 0.6, spacing_m: Some(0.25), floor: None }],
        ..Default::default()
    };
    let rows = request.rows(&scene).expect("the room has a floor");
    let IrradianceRows::Grid(plane) = &rows[1] else { panic!("the work plane comes second") };
    assert_eq!((plane.size, plane.left_out.len()), ([8, 10], 0));
    assert!((plane.origin.y - -0.1).abs() < 1e-4, "0.6 m above the floor, not at {}", plane.origin.y);
    for rows in &rows {
        let lux = sampled(&scene, Some(rows), 1024);
        Mean::of(&lux).assert_is(f64::from(PI), 2.5e-3, rows.name());
    }
}

/// A room with a shelf, a lamp, and a panel.
fn lit_room() -> Arc<PreparedScene> {
    let camera = Camera::look_at("door", Vec3::new(0.2, 0.1, 0.9), Vec3::new(0.0, -0.3, -1.0), 1.1, 4.0 / 3.0);
    let stage = Stage::new(camera)
        .surface("walls", &room(Vec3::ONE), lambert(0.6, 0.0))
        .surface("shelf", &quad(Vec3::new(0.1, -0.4, -0.9), Vec3::Z * 0.6, Vec3::X * 0.8), lambert(0.6, 0.0))
        .panel("panel", &quad(Vec3::new(-0.5, 0.98, -0.5), Vec3::X * 0.9, Vec3::Z * 0.9), 3.0, 4)
        .lamp("lamp", Vec3::new(-0.6, 0.2, -0.1), 0.5);
    Arc::new(stage.prepared())
}

#[test]
fn a_diffuse_picture_is_albedo_over_pi_times_its_irradiance() {
    let scene = lit_room();
    let lux = sampled(&scene, Some(&IrradianceRows::Pixels), 48);
    let reflected: Vec<f64> = lux.iter().map(|lux| lux * f64::from(0.6 * FRAC_1_PI)).collect();
    assert_same_mean(&reflected, &sampled(&scene, None, 48), 1e-2, "the walls");
}

#[test]
fn irradiance_is_that_of_the_wall_behind_panes_and_in_mirrors() {
    // The camera looks up from behind two panes into a mirror that shows it the table from above.
    let camera = Camera::look_at("up", Vec3::new(0.0, 0.5, 0.0), Vec3::new(0.0, 3.0, 0.0), 0.01, 4.0 / 3.0);
    let mirror = Material { base_color: Vec4::splat(0.7), metallic: 1.0, roughness: 0.0, ..Material::default() };
    let sheet = |height: f32| quad(Vec3::new(-4.0, height, 4.0), Vec3::X * 8.0, Vec3::NEG_Z * 8.0);
    let stage = Stage::new(camera).surface("table", &table(), lambert(0.5, 0.0));
    let stage = stage.surface("glass", &sheet(0.9), pane()).surface("film", &sheet(1.0), tint(0.4));
    let scene = stage.surface("mirror", &sheet(2.0), mirror).lamp("lamp", Vec3::Y * 0.4, 2.0).prepared();
    // Straight below the lamp: 2 cd from 0.4 m; the mirror adds what comes back through both sheets, next to nothing.
    let lux = Mean::of(&sampled(&scene, Some(&IrradianceRows::Pixels), 4));
    assert!((lux.value - 2.0 / 0.16).abs() < 0.05 * lux.value, "{lux:?}");
}

#[test]
fn points_inside_blocks_are_left_out_of_a_work_plane() {
    let block: Vec<Vec3> = room(Vec3::splat(0.5)).chunks_exact(3).flat_map(|t| [t[0], t[2], t[1]]).collect();
    let block: Vec<Vec3> = block.into_iter().map(|corner| corner - Vec3::Y * 0.5).collect();
    let stage = Stage::new(above()).surface("walls", &room(Vec3::ONE), lambert(0.5, 0.5));
    let scene = stage.surface("block", &block, lambert(0.5, 0.0)).prepared();
    let plane = WorkPlane { height_m: 0.7, spacing_m: Some(0.5), floor: None };
    let request = IrradianceRequest { work_planes: vec![plane], ..Default::default() };
    let rows = request.rows(&scene).expect("the room has a floor");
    let IrradianceRows::Grid(grid) = &rows[0] else { panic!("only a grid was asked for") };
    assert_eq!((grid.size, &grid.left_out[..]), ([4, 4], &[5, 6, 9, 10][..]));
    let lux = sampled(&scene, Some(&rows[0]), 8);
    assert!((0..16).all(|n| (lux[n] == 0.0) == [5, 6, 9, 10].contains(&n)), "{lux:?}");
}

#[test]
fn points_that_are_left_out_make_the_others_no_more_exact() {
    let scene = lit_room();
    let left_out = (0..64).collect();
    let grid = SensorGrid { left_out, ..on_table(&scene, "shelf", [16, 8]) };
    let bake = job(&scene, vec![IrradianceRows::Grid(grid)], Indirect::Traced).run(|_| ControlFlow::Continue(()));
    let bake = bake.unwrap().unwrap();
    let (told, of_all) = (bake.irradiance_figures()[0].error_db, error_db(&bake.irradiance[0], None));
    // Half of the points have all of the error.
    let half = 10.0 * 2f32.log10();
    assert!((of_all.noise - half - told.noise).abs() < 1e-3, "{told:?} of {of_all:?}");
    assert!(told.total < of_all.total - 0.99 * half, "{told:?} of {of_all:?}");
}

/// A closed box whose fronts look outward, around the origin of a node that is moved.
fn block(half: f32, moved: Vec3) -> Vec<Vec3> {
    room(Vec3::splat(half)).chunks_exact(3).flat_map(|t| [t[0], t[2], t[1]].map(|corner| corner + moved)).collect()
}

/// Size of a work plane 0.7 m above the floor with a point every half meter, and what it leaves out.
fn work_plane(stage: Stage) -> ([u32; 2], Vec<u32>) {
    work_plane_at(0.7, stage)
}

/// The same at another height, m.
fn work_plane_at(height_m: f32, stage: Stage) -> ([u32; 2], Vec<u32>) {
    let plane = WorkPlane { height_m, spacing_m: Some(0.5), floor: None };
    let request = IrradianceRequest { work_planes: vec![plane], ..Default::default() };
    match request.rows(&stage.prepared()).expect("the room has a floor").remove(0) {
        IrradianceRows::Grid(grid) => (grid.size, grid.left_out),
        IrradianceRows::Pixels => panic!("only a grid was asked for"),
    }
}

fn double_sided() -> Material {
    Material { double_sided: true, ..lambert(0.5, 0.0) }
}

#[test]
fn points_inside_closed_bodies_are_left_out_though_all_is_double_sided() {
    let (middle, corner) = (Vec3::NEG_Y * 0.5, Vec3::splat(-0.5));
    let single = || lambert(0.5, 0.0);
    for (walls, material) in [(single(), single()), (single(), double_sided()), (double_sided(), double_sided())] {
        // On the floor, and in a corner whose three sides it shares.
        for (moved, left_out) in [(middle, [5, 6, 9, 10]), (corner, [0, 1, 4, 5])] {
            let stage = Stage::new(above()).surface("walls", &room(Vec3::ONE), walls.clone());
            let stage = stage.surface("block", &block(0.5, moved), material.clone());
            assert_eq!(work_plane(stage), ([4, 4], left_out.to_vec()), "at {moved}, {}", material.double_sided);
        }
    }
}

#[test]
fn a_work_plane_on_the_floor_leaves_out_what_stands_there_and_nothing_else() {
    // Level, and as level as files round it: half of its points are below the floor then.
    for rise in [0.0, 2e-6] {
        let floor = quad(Vec3::new(-1.0, -1.0 - 0.5 * rise, 1.0), Vec3::new(2.0, rise, 0.0), Vec3::NEG_Z * 2.0);
        for material in [lambert(0.5, 0.0), double_sided()] {
            let stage = Stage::new(above()).surface("floor", &floor, material.clone());
            let stage = stage.surface("block", &block(0.5, Vec3::NEG_Y * 0.5), material);
            assert_eq!(work_plane_at(0.0, stage), ([4, 4], vec![5, 6, 9, 10]), "a rise of {rise} m");
        }
    }
}

#[test]
fn sheets_tubs_and_bodies_inside_out_take_no_points_from_a_work_plane() {
    let level = |height: f32| quad(Vec3::new(-0.9, height, 0.9), Vec3::X * 1.8, Vec3::NEG_Z * 1.8);
    let turned = |height: f32| quad(Vec3::new(-0.9, height, 0.9), Vec3::NEG_Z * 1.8, Vec3::X * 1.8);
    let curtain = [
        quad(Vec3::new(-0.9, -0.9, 0.1), Vec3::X * 1.5, Vec3::Y),
        quad(Vec3::new(0.6, -0.9, 0.1), Vec3::NEG_Z, Vec3::Y),
    ];
    let tub: Vec<Vec3> = block(0.5, Vec3::NEG_Y * 0.5);
    let tub: Vec<Vec3> =
        tub.chunks_exact(3).filter(|t| t.iter().any(|corner| corner.y < -0.5)).flatten().copied().collect();
    let inward: Vec<Vec3> = room(Vec3::splat(0.5)).iter().map(|corner| *corner - Vec3::Y * 0.5).collect();
    for corners in [level(-0.6), turned(-0.6), level(0.2), turned(0.2), curtain.concat(), tub, inward] {
        let stage = Stage::new(above()).surface("walls", &room(Vec3::ONE), double_sided());
        assert_eq!(work_plane(stage.surface("object", &corners, double_sided())), ([4, 4], Vec::new()), "{corners:?}");
    }
}

#[test]
fn a_body_around_a_camera_or_a_lamp_is_a_room() {
    let ground = quad(Vec3::new(-2.0, -1.0, 2.0), Vec3::X * 4.0, Vec3::NEG_Z * 4.0);
    let stage = |camera| {
        let stage = Stage::new(camera).surface("ground", &ground, double_sided());
        stage.surface("body", &block(1.0, Vec3::ZERO), double_sided())
    };
    let within = Camera::look_at("inside", Vec3::new(0.1, 0.2, 0.5), Vec3::NEG_Z, 1.2, 4.0 / 3.0);
    let (size, left_out) = work_plane(stage(above()));
    assert_eq!((size, left_out.len()), ([8, 8], 16));
    for stage in [stage(within), stage(above()).lamp("lamp", Vec3::new(0.3, 0.4, 0.1), 1.0)] {
        assert_eq!(work_plane(stage), ([8, 8], Vec::new()));
    }
}

#[test]
fn a_work_plane_stands_on_the_floor_that_was_chosen() {
    let podium = quad(Vec3::new(-0.5, -0.6, 0.5), Vec3::X, Vec3::NEG_Z);
    let wedge = vec![Vec3::new(-0.9, -0.8, 0.5), Vec3::new(0.9, -0.8, 0.5), Vec3::new(0.9, -0.8, -0.5)];
    let stage = Stage::new(above()).surface("walls", &room(Vec3::ONE), lambert(0.5, 0.5));
    let stage = stage.surface("podium", &podium, lambert(0.5, 0.0)).surface("wedge", &wedge, lambert(0.5, 0.0));
    let board = quad(Vec3::new(-0.5, -0.5, 0.0), Vec3::X, Vec3::Y);
    let scene = stage.surface("board", &board, lambert(0.5, 0.0)).prepared();
    let node = |name: &str| scene.scene.nodes.iter().position(|node| node.is_named(name)).expect("it is there") as u32;
    let over = |name: &str| {
        let plane = WorkPlane { height_m: 0.4, spacing_m: Some(0.25), floor: Some(node(name)) };
        IrradianceRequest { work_planes: vec![plane], ..Default::default() }.rows(&scene)
    };
    let grid = |name: &str| match &over(name).expect("it has a floor")[..] {
        [IrradianceRows::Grid(grid)] => grid.clone(),
        other => panic!("only a grid was asked for, not {other:?}"),
    };
    let podium = grid("podium");
    assert_eq!((podium.name.as_str(), podium.size), ("work plane 0.4 m over podium", [4, 4]));
    assert!((podium.origin - Vec3::new(-0.5, -0.2, -0.5)).length() < 1e-5 && podium.left_out.is_empty(), "{podium:?}");
    // Half of its rectangle, on whose diagonal no point lies.
    let wedge = grid("wedge");
    assert_eq!((wedge.size, wedge.n_points() - wedge.left_out.len()), ([7, 4], 14));
    let error = over("board").expect_err("it stands upright").to_string();
    assert!(error.contains("`board` has no surface that faces up"), "{error}");
}

fn job(scene: &Arc<PreparedScene>, irradiance: Vec<IrradianceRows>, indirect: Indirect) -> BakeJob {
    let config = BakeConfig { spp: 12, tolerance_db: 60.0, bounces: None, seed: 5, indirect, ..BakeConfig::default() };
    let camera = scene.scene.cameras[0].clone();
    BakeJob { scene: scene.clone(), camera, film: FILM, config, passes: Passes::FinalOnly, irradiance }
}

fn all_rows(scene: &PreparedScene) -> Vec<IrradianceRows> {
    let nodes = vec![NodeGrid { node: "shelf".into(), size: [18, 17] }];
    IrradianceRequest { of_file: OfFile::All, nodes, ..Default::default() }.rows(scene).expect("the shelf is a quad")
}

/// Green lux out of the factors of a bake.
fn relit(bake: &Bake, set: usize) -> Vec<f64> {
    relit_under(bake, set, &LightRig::default())
}

/// The same under a rig.
fn relit_under(bake: &Bake, set: usize, rig: &LightRig) -> Vec<f64> {
    let coefficients = bake.header.irradiance_coefficients(set, rig);
    let mut lux = vec![0.0; bake.header.irradiance_film(set).n_pixels()];
    for (group, coefficients) in bake.irradiance[set].iter().zip(coefficients) {
        let weights: Vec<f32> = coefficients.iter().map(|rgb| rgb[1]).collect();
        let rows = group.apply(&weights);
        lux.iter_mut().zip(rows.chunks_exact(CHANNELS)).for_each(|(lux, rows)| *lux += f64::from(rows[1]));
    }
    lux
}

#[test]
fn baked_irradiance_is_what_was_sampled_and_leaves_the_picture_alone() {
    let scene = lit_room();
    let stop = |_| ControlFlow::Continue(());
    let plain = job(&scene, Vec::new(), Indirect::Traced).run(stop).unwrap().unwrap();
    for indirect in [Indirect::Traced, Indirect::Shared] {
        let bake = job(&scene, all_rows(&scene), indirect).run(stop).unwrap().unwrap();
        if indirect == Indirect::Traced {
            let same = bake.groups.iter().zip(&plain.groups).all(|(a, b)| a.blocks == b.blocks);
            assert!(same, "irradiance changes the picture");
        }
        for (set, rows) in all_rows(&scene).iter().enumerate() {
            let (lux, expected) = (relit(&bake, set), sampled(&scene, Some(rows), 16));
            let (lux, expected) = (Mean::of(&lux), Mean::of(&expected));
            assert!(
                (lux.value - expected.value).abs() < 0.02 * expected.value,
                "{}: {lux:?} {expected:?}",
                rows.name()
            );
        }
        let is_shared = indirect == Indirect::Shared;
        let biases = bake.header.irradiance.iter().map(|set| set.sharing_bias.is_some());
        assert!(biases.eq([is_shared, false]), "points of grids share nothing");
        let figures = bake.irradiance_figures();
        assert_eq!(figures[0].error_db.bias.is_some(), is_shared);
        assert_eq!((figures[1].name.as_str(), figures[1].width, figures[1].height), ("shelf", 18, 17));
        assert!(figures.iter().all(|f| f.error_db.total > 5.0 && f.bytes < f.dense_bytes), "{figures:?}");
    }
}

#[test]
fn one_lamp_of_a_grid_is_right_at_every_point_whatever_the_picture_may_lack() {
    let lamp = Vec3::new(0.3, 0.5, -0.2);
    let stage = Stage::new(above()).surface("table", &table(), lambert(0.5, 0.0));
    let scene = Arc::new(stage.distant("sun", Vec3::NEG_Y, 100.0).lamp("lamp", lamp, 40.0).prepared());
    let grid = on_table(&scene, "table", [16, 16]);
    let mut job = job(&scene, vec![IrradianceRows::Grid(grid.clone())], Indirect::Traced);
    job.config.tolerance_db = 24.0;
    let bake = job.run(|_| ControlFlow::Continue(())).unwrap().unwrap();
    let without = |key: &str| {
        let setting = LightSetting { muted: true, ..LightSetting::default() };
        let rig = LightRig { lights: [(key.to_owned(), setting)].into(), ..LightRig::default() };
        relit_under(&bake, 0, &rig)
    };
    let (of_sun, of_lamp) = (without("lamp"), without("sun"));
    let most = of_lamp.iter().copied().fold(0.0, f64::max);
    for (number, (sun, lux)) in (0..).zip(of_sun.into_iter().zip(of_lamp)) {
        assert!((sun - 100.0).abs() < 0.5, "{sun} lx of the sun at point {number}");
        let to_lamp = lamp - grid.point(number).expect("every point of a table is measured");
        let known = f64::from(40.0 * to_lamp.y / to_lamp.length().powi(3));
        assert!((lux - known).abs() < 5e-3 * most, "{lux} lx of the lamp at point {number}, not {known}");
    }
}

#[test]
fn irradiance_is_there_when_the_preview_is_and_that_of_sensors_stays() {
    let scene = lit_room();
    let wanted = |film: Film| {
        let mut job = job(&scene, all_rows(&scene), Indirect::Traced);
        (job.film, job.passes) = (film, Passes::Progressive);
        job
    };
    let film = Film { width: 40, height: 36 };
    // What came: of the picture, as a preview, and as it stays; with the set of irradiance.
    let (mut told, mut preview, mut header) = (Vec::new(), Vec::new(), None);
    let bake = wanted(film).run(|event| {
        let what = match event {
            BakeEvent::Started { header: of_bake, .. } => {
                preview = of_bake.empty_matrices().swap_remove(1);
                header = Some(of_bake);
                None
            }
            BakeEvent::BlockDone { pass, .. } => Some((0, pass == 0)),
            BakeEvent::IrradianceDone { set, block_idx, factors, is_preview } => {
                for (group, factors) in preview.iter_mut().zip(factors).filter(|_| is_preview) {
                    group.blocks[block_idx] = Some(factors);
                }
                Some((1 + set, is_preview))
            }
            _ => None,
        };
        told.extend(what.filter(|what| told.last() != Some(what)));
        ControlFlow::Continue(())
    });
    let bake = bake.unwrap().unwrap();
    assert_eq!(told, [(0, true), (1, true), (2, false), (0, false), (1, false)]);
    let early = Bake { header: header.unwrap(), irradiance: vec![preview], ..bake.clone() };
    let (early, late) = (Mean::of(&relit(&early, 0)), Mean::of(&relit(&bake, 0)));
    assert!((early.value - late.value).abs() < 0.05 * late.value, "{early:?} {late:?}");

    // Sensors that are nearly as many as the pixels wait for the picture.
    told.clear();
    let small = wanted(FILM).run(|event| {
        let what = match event {
            BakeEvent::BlockDone { pass, .. } => Some((0, pass == 0)),
            BakeEvent::IrradianceDone { set, is_preview, .. } => Some((1 + set, is_preview)),
            _ => None,
        };
        told.extend(what.filter(|what| told.last() != Some(what)));
        ControlFlow::Continue(())
    });
    assert!(small.unwrap().is_some());
    assert_eq!(told, [(0, true), (1, true), (0, false), (1, false), (2, false)]);
}

#[test]
fn a_preview_counts_what_a_mirror_throws_on_a_table_once() {
    // The lamp shines upward: its light comes to the table by way of the mirror alone.
    let camera = Camera::look_at("side", Vec3::new(0.0, 0.9, 1.3), Vec3::ZERO, 0.4, 4.0 / 3.0);
    let mirror = Material { base_color: Vec4::splat(0.9), metallic: 1.0, roughness: 0.0, ..Material::default() };
    let ceiling = quad(Vec3::new(-4.0, 2.0, -4.0), Vec3::X * 8.0, Vec3::Z * 8.0);
    let lamp = quad(Vec3::new(1.0, 1.0, -0.8), Vec3::Z * 1.6, Vec3::X * 1.6);
    let stage = Stage::new(camera).surface("table", &table(), lambert(0.5, 0.0)).surface("mirror", &ceiling, mirror);
    let scene = Arc::new(stage.surface("lamp", &lamp, lambert(0.0, 3.0)).prepared());
    assert!(scene.casters.is_some(), "the mirror throws light");
    let mut job = job(&scene, vec![IrradianceRows::Pixels], Indirect::Traced);
    (job.film, job.passes) = (Film { width: 40, height: 36 }, Passes::PreviewAndFinal);
    let mut preview = Vec::new();
    let bake = job.run(|event| {
        match event {
            BakeEvent::Started { header, .. } => preview = header.empty_irradiance().remove(0),
            BakeEvent::IrradianceDone { block_idx, factors, is_preview: true, .. } => {
                for (group, factors) in preview.iter_mut().zip(factors) {
                    group.blocks[block_idx] = Some(factors);
                }
            }
            _ => {}
        }
        ControlFlow::Continue(())
    });
    let bake = bake.unwrap().unwrap();
    let early = Bake { irradiance: vec![preview], ..bake.clone() };
    let (early, late) = (Mean::of(&relit(&early, 0)), Mean::of(&relit(&bake, 0)));
    // Nodes that outshine those around them are dimmed.
    assert!((0.75..1.2).contains(&(early.value / late.value)), "{early:?} {late:?}");
}

#[test]
fn irradiance_comes_once_more_with_less_noise_as_a_preview_and_as_it_stays() {
    let scene = lit_room();
    let film = Film { width: 64, height: 48 };
    // The preview as it came and as it is left, with the bake, and how many blocks of each were told of once more.
    let baked = |denoise: bool| {
        let mut job = job(&scene, vec![IrradianceRows::Pixels], Indirect::Traced);
        (job.film, job.passes, job.config.denoise) = (film, Passes::PreviewAndFinal, denoise);
        let (mut previews, mut n_denoised, mut stays) = (Vec::new(), [0, 0], 0);
        let bake = job.run(|event| {
            match event {
                BakeEvent::Started { header, .. } => previews = vec![header.empty_irradiance().remove(0); 2],
                BakeEvent::IrradianceDone { block_idx, factors, is_preview: true, .. } => {
                    for (group, factors) in previews.iter_mut().flatten().zip(factors.iter().cycle()) {
                        group.blocks[block_idx] = Some(factors.clone());
                    }
                }
                BakeEvent::IrradianceDone { .. } => stays = 1,
                BakeEvent::IrradianceDenoised { set, blocks } => {
                    assert_eq!(set, 0);
                    n_denoised[stays] += blocks.len();
                    for (block_idx, factors) in blocks.into_iter().filter(|_| stays == 0) {
                        for (group, factors) in previews[1].iter_mut().zip(factors) {
                            group.blocks[block_idx] = Some(factors);
                        }
                    }
                }
                _ => {}
            }
            ControlFlow::Continue(())
        });
        (bake.unwrap().unwrap(), previews, n_denoised)
    };
    let (bake, previews, n_denoised) = baked(true);
    let (plain, grainy, none) = baked(false);
    assert_eq!((n_denoised, none), ([12, 12], [0, 0]));
    assert_eq!((&grainy[0], &grainy[1]), (&previews[0], &previews[0]), "it came as it was sampled");
    let error = |rows: &[BlockLowRank], truth: &[f64]| -> f64 {
        let of_rows = Bake { irradiance: vec![rows.to_vec()], ..bake.clone() };
        relit(&of_rows, 0).iter().zip(truth).map(|(lux, truth)| (lux - truth).powi(2)).sum()
    };
    let mut exact = job(&scene, vec![IrradianceRows::Pixels], Indirect::Traced);
    (exact.film, exact.config.spp, exact.config.denoise) = (film, 128, false);
    let truth = relit(&exact.run(|_| ControlFlow::Continue(())).unwrap().unwrap(), 0);
    let [before, after] = [0, 1].map(|nth| error(&previews[nth], &truth));
    assert!(after < 0.7 * before, "preview {before:e} {after:e}");
    let [before, after] = [&plain, &bake].map(|bake| error(&bake.irradiance[0], &truth));
    assert!(after < 0.9 * before, "as it stays {before:e} {after:e}");
    let [before, after] = [&plain, &bake].map(|bake| bake.irradiance_figures()[0].error_db);
    assert!(after.sampling > before.sampling, "what is left is told: {before:?} {after:?}");
}

#[test]
fn a_bake_that_stops_amid_irradiance_is_taken_up_to_the_same_bytes() {
    let scene = lit_room();
    let folder = std::env::temp_dir().join(format!("clerestory-irradiance-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let [whole, stopped] = ["whole.transport", "stopped.transport"].map(|name| folder.join(name));
    let bake = |path, stop_after: usize| {
        let mut n_done = 0;
        let job = BakeJob { passes: Passes::Progressive, ..job(&scene, all_rows(&scene), Indirect::Shared) };
        archive::bake_to_file(job, path, Restart::Resume, |event| {
            n_done += usize::from(matches!(event, BakeEvent::IrradianceDone { is_preview: false, .. }));
            if n_done > stop_after { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        })
    };
    let finished = bake(&whole, usize::MAX).unwrap().unwrap();
    for stop_after in [0, 2, 4] {
        assert!(bake(&stopped, stop_after).unwrap().is_none(), "it should have stopped after {stop_after} blocks");
    }
    bake(&stopped, usize::MAX).unwrap().unwrap();
    let bytes = [&whole, &stopped].map(|path| std::fs::read(path).unwrap());
    assert!(bytes[0] == bytes[1], "a bake that was stopped has other bytes");

    let read = archive::read(&whole).unwrap();
    assert_eq!((read.header.as_ref(), read.irradiance.len()), (finished.header.as_ref(), 2));
    assert_eq!(relit(&read, 1), relit(&finished, 1));
    std::fs::remove_dir_all(&folder).unwrap();
}
