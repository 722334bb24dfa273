use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use clerestory_transport::lamps::{LampShape, LampUnit, PreparedLamps};
use clerestory_transport::light::LightSetting;
use clerestory_transport::scene::{Material, Scene};
use clerestory_transport::visible::{VisibleConfig, VisiblePoints};
use glam::Vec2;

use super::*;
use crate::support::room;

const FILM: Film = Film { width: 32, height: 24 };

pub(crate) fn view() -> Arc<LampView> {
    view_of(room())
}

fn view_of(scene: Scene) -> Arc<LampView> {
    let scene = Arc::new(PreparedScene::new(scene, &[]).unwrap().0);
    let camera = scene.scene.cameras[0].clone();
    Arc::new(LampView { scene, camera, film: FILM, patches: None, measures: true, bounces: None, device: None })
}

/// What the pixels of a view see in so many samples.
fn points(view: &LampView, samples: u32, seed: u64) -> VisiblePoints {
    let config = VisibleConfig { samples, seed, ..VisibleConfig::default() };
    VisiblePoints::new(&view.scene, &view.camera, view.film, config, &|| false).unwrap()
}

pub(crate) fn lamp(key: &str, x: f32) -> FreeLamp {
    let position = Vec3::new(x, 0.2, -0.3);
    let (shape, setting) = (LampShape::Sphere { radius_m: 0.1 }, LightSetting::default());
    let (strength, unit) = (100.0, LampUnit::Lumen);
    FreeLamp {
        key: key.into(),
        shape,
        position,
        aim: position - Vec3::Y,
        strength,
        unit,
        setting,
        turn_rad: 0.0,
        replaces: None,
    }
}

/// A worker, and how often it has asked for a repaint.
fn worker() -> (LampWorker, Arc<AtomicU32>) {
    let n_woken = Arc::new(AtomicU32::new(0));
    let own = n_woken.clone();
    let wake = move |_| {
        own.fetch_add(1, Ordering::Relaxed);
    };
    (start(Arc::new(wake)).unwrap(), n_woken)
}

fn wait(worker: &LampWorker, until: impl Fn(&LampLight) -> bool) -> LampLight {
    for _ in 0..20_000 {
        if let Some(light) = worker.take().filter(|light| until(light)) {
            return light;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    panic!("it never came");
}

fn mean(light: &LampLight) -> f64 {
    let values = light.direct.pixels.as_flattened();
    values.iter().map(|v| f64::from(*v)).sum::<f64>() / values.len() as f64
}

#[test]
fn light_comes_gets_smooth_and_then_nothing_happens_any_more() {
    let (view, (worker, n_woken)) = (view(), worker());
    worker.order(LampOrder { view, lamps: vec![lamp("a", 0.0)], shows_arriving: false, serial: 7 });
    let first = wait(&worker, |_| true);
    assert!(first.serial == 7 && first.problems.is_empty() && mean(&first) > 0.0);
    let last = if first.is_done { first.clone() } else { wait(&worker, |light| light.is_done) };
    assert!((mean(&last) / mean(&first) - 1.0).abs() < 0.2, "the first picture is whole");
    let woken = n_woken.load(Ordering::Relaxed);
    std::thread::sleep(Duration::from_millis(300));
    assert_eq!(n_woken.load(Ordering::Relaxed), woken, "it sleeps");
}

#[test]
fn color_and_intensity_only_weigh_what_is_there() {
    let (view, (worker, _)) = (view(), worker());
    let mut lamps = vec![lamp("a", 0.3), lamp("b", -0.3)];
    worker.order(LampOrder { view: view.clone(), lamps: lamps.clone(), shows_arriving: false, serial: 1 });
    let both = wait(&worker, |light| light.is_done);
    lamps[1].setting = LightSetting { intensity: 3.0, color: Some([1.0, 0.0, 0.5]), ..LightSetting::default() };
    worker.order(LampOrder { view: view.clone(), lamps: lamps.clone(), shows_arriving: false, serial: 2 });
    // At once as smooth as it was: nothing is traced again.
    let tinted = wait(&worker, |light| light.serial == 2);
    assert!(tinted.is_done);
    worker.order(LampOrder { view, lamps: lamps[..1].to_vec(), shows_arriving: false, serial: 3 });
    let one = wait(&worker, |light| light.serial == 3);
    assert!(one.is_done);
    for ((both, tinted), one) in both.direct.pixels.iter().zip(&tinted.direct.pixels).zip(&one.direct.pixels) {
        for (c, weight) in [3.0, 0.0, 1.5].into_iter().enumerate() {
            let expected = one[c] + weight * (both[c] - one[c]);
            assert!((tinted[c] - expected).abs() <= 1e-4 * (1.0 + expected.abs()), "{tinted:?} {expected}");
        }
    }
}

/// Of how many passes a picture of one lamp is the mean.
fn n_passes(light: &LampLight) -> u32 {
    (1.0 / light.parts[0].weights[0].x).round() as u32
}

#[test]
fn a_lamp_that_moves_on_and_on_is_seen_on_its_way_and_each_picture_is_whole_and_of_one_place() {
    let (view, (worker, _)) = (view(), worker());
    let on_its_way = |serial: u64| lamp("a", 0.3 - 0.0003 * serial as f32);
    let points = points(&view, 1, 0);
    let mut seen = 0;
    for serial in 1..2000 {
        worker.order(LampOrder { view: view.clone(), lamps: vec![on_its_way(serial)], shows_arriving: false, serial });
        // One that stood for a while, as threads were late, is smoother already.
        if let Some(light) = worker.take().filter(|light| n_passes(light) == 1) {
            let (lamps, _) = PreparedLamps::new(&[on_its_way(light.serial)], None).unwrap();
            let whole = points.direct(&view.scene, &lamps, 0, &|| false).unwrap();
            let n_lit = whole.iter().filter(|rgb| rgb[1] > 0.0).count();
            assert!(n_lit > FILM.n_pixels() / 2, "{n_lit} pixels are lit");
            let differs = |(shown, own): &(&[f32; 3], &[f32; 3])| shown != own;
            let n_others = light.direct.pixels.iter().zip(&whole).filter(differs).count();
            assert!(n_others == 0, "{n_others} pixels are not of step {}", light.serial);
            seen += 1;
        }
        if seen > 3 {
            return;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    panic!("{seen} pictures of a lamp that moved");
}

/// A square card before the far wall of the room, whose left and right edges are seen in the middles of pixels.
fn with_a_card() -> Scene {
    let (mut scene, z) = (room(), -0.62);
    let camera = &scene.cameras[0];
    let right = camera.direction(FILM, Vec2::new(18.5, 12.0));
    let half = right.x / -right.z * (camera.position().z - z);
    let first = scene.mesh.positions.len() as u32;
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    scene.mesh.positions.extend(corners.map(|[x, y]| Vec3::new(half * x, 0.2 + half * y, z)));
    scene.mesh.normals.extend([Vec3::Z; 4]);
    scene.mesh.triangles.extend([[0, 1, 2], [0, 2, 3]].map(|triangle| triangle.map(|vertex| first + vertex)));
    scene.mesh.triangle_material.extend([scene.materials.len() as u32; 2]);
    scene.mesh.triangle_node.extend([0; 2]);
    scene.materials.push(Material { double_sided: true, metallic: 0.0, ..Material::default() });
    scene
}

#[test]
fn soft_shadows_and_edges_get_smooth_while_a_lamp_stands_still() {
    let view = view_of(with_a_card());
    // It shines away from the eye, so that its own rim is not seen.
    let disk = LampShape::Disk { radius_m: 0.1 };
    let lamp = FreeLamp { shape: disk, aim: Vec3::new(0.0, 0.2, -1.0), ..lamp("a", 0.0) };
    let mut bench = Bench::new(view.clone());
    bench.take(LampOrder { view: view.clone(), lamps: vec![lamp.clone()], shows_arriving: false, serial: 1 });
    bench.step(&|_, _| false);
    let first = bench.news().unwrap();
    let mut last = first.clone();
    while !bench.is_done() {
        bench.step(&|_, _| false);
        last = bench.news().unwrap_or(last);
    }

    // Many passes with other random numbers stand for the truth.
    let (points, (lamps, _)) = (points(&view, 64, 9), PreparedLamps::new(&[lamp], None).unwrap());
    let mut truth = vec![0.0f32; FILM.n_pixels()];
    for pass in 0..256 {
        let light = points.direct(&view.scene, &lamps, pass, &|| false).unwrap();
        truth.iter_mut().zip(&light).for_each(|(sum, rgb)| *sum += rgb[1] / 256.0);
    }
    // The card hides the middle of its shadow; around it there is the soft rim alone.
    let is_card = |pixel: u32| (12..20).contains(&(pixel % 32)) && (5..13).contains(&(pixel / 32));
    let off = |light: &LampLight| {
        let pixels = (0..).zip(light.direct.pixels.iter().zip(&truth)).filter(|(pixel, _)| !is_card(*pixel));
        pixels.map(|(_, (rgb, truth))| (rgb[1] - truth).powi(2)).sum::<f32>().sqrt()
    };
    let (before, after) = (off(&first), off(&last));
    assert!(after < 0.5 * before, "the shadow is off by {after}, by {before} at first");
    // Half of a pixel at the edge shows the card, and half of it the wall.
    for (y, [card, edge, wall]) in (8..11).flat_map(|y| [(y, [17, 18, 19]), (y, [14, 13, 12])]) {
        let [card, edge, wall] = [card, edge, wall].map(|x: usize| last.direct.pixels[32 * y + x][1]);
        let share = (edge - wall) / (card - wall);
        assert!((0.1..0.9).contains(&share), "{edge} is not between {card} and {wall}");
    }
}

#[test]
fn a_lamp_that_makes_no_sense_is_told_and_the_others_shine() {
    let (view, (worker, _)) = (view(), worker());
    let broken = FreeLamp { unit: LampUnit::Lux, ..lamp("broken", 0.0) };
    worker.order(LampOrder { view, lamps: vec![broken, lamp("a", 0.0)], shows_arriving: false, serial: 1 });
    let light = wait(&worker, |_| true);
    assert!(light.problems.len() == 1 && light.problems[0].contains("`broken`"), "{:?}", light.problems);
    assert!(mean(&light) > 0.0);
}

#[test]
fn a_lamp_that_moves_keeps_its_profile_until_files_are_to_be_read_again() {
    let (folder, worker) = (tempfile::tempdir().unwrap(), worker().0);
    let file = folder.path().join("even.ies");
    let even = "IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 2 1 1 2 0 0 0\n1 1 10\n0 180\n0\n100 100\n";
    std::fs::write(&file, even).unwrap();
    let shape = LampShape::Profile { file: file.display().to_string() };
    let lit = |view: &Arc<LampView>, serial: u64, x: f32| {
        let lamps = vec![FreeLamp { shape: shape.clone(), ..lamp("even", x) }];
        worker.order(LampOrder { view: view.clone(), lamps, shows_arriving: false, serial });
        wait(&worker, |light| light.serial == serial)
    };
    let first = view();
    assert!(mean(&lit(&first, 1, 0.0)) > 0.0);
    std::fs::remove_file(&file).unwrap();
    let moved = lit(&first, 2, 0.2);
    assert!(mean(&moved) > 0.0 && moved.problems.is_empty(), "{:?}", moved.problems);
    // What the window does where a file is to be read again.
    let again = lit(&Arc::new((*first).clone()), 3, 0.2);
    assert!(matches!(&again.problems[..], [words] if words.contains("even.ies")), "{:?}", again.problems);
}

#[test]
fn what_is_said_of_a_lamp_stays_while_another_one_moves() {
    let view = view();
    let flat = LampShape::Rectangle { size_m: [1.0, 0.0] };
    let dark = FreeLamp { shape: flat, unit: LampUnit::Nit, ..lamp("dark", 0.0) };
    let broken = FreeLamp { unit: LampUnit::Lux, ..lamp("broken", 0.0) };
    let disk = FreeLamp { shape: LampShape::Disk { radius_m: 0.1 }, ..lamp("own", 0.2) };
    let own = FreeLamp { aim: disk.position, ..disk };
    let mut bench = Bench::new(view.clone());
    let mut said = |x: f32, dark: &FreeLamp, serial: u64| {
        let lamps = vec![dark.clone(), broken.clone(), own.clone(), lamp("moves", x)];
        bench.take(LampOrder { view: view.clone(), lamps, shows_arriving: false, serial });
        let light = loop {
            bench.step(&|_, _| false);
            if let Some(light) = bench.news() {
                break light;
            }
        };
        (light.problems, light.remarks)
    };
    let first = said(0.0, &dark, 1);
    let are_named = first.0.len() == 2 && first.0[0].contains("`broken`") && first.0[1].contains("`dark`");
    assert!(are_named && first.1.len() == 1 && first.1[0].contains("`own`"), "{first:?}");
    assert_eq!(said(0.3, &dark, 2), first);
    let (problems, _) = said(0.3, &FreeLamp { key: "other".into(), ..dark }, 3);
    assert!(problems[1].contains("`other`"), "{problems:?}");
}
