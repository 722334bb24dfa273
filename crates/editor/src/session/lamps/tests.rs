use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use clerestory_transport::import;
use clerestory_transport::lamps::{LampShape, LampUnit};
use clerestory_transport::light::LightSetting;

use super::*;

fn view() -> Arc<LampView> {
    let scene = import::load_bytes("room.gltf", include_bytes!("../../../tests/room.gltf")).unwrap().scene;
    let scene = Arc::new(PreparedScene::new(scene, &[]).unwrap().0);
    let camera = scene.scene.cameras[0].clone();
    Arc::new(LampView {
        scene,
        camera,
        film: Film { width: 32, height: 24 },
        patches: None,
        measures: true,
        device: None,
    })
}

fn lamp(key: &str, x: f32) -> FreeLamp {
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

#[test]
fn a_lamp_that_moves_on_and_on_is_seen_on_its_way() {
    let (view, (worker, _)) = (view(), worker());
    let mut seen = 0;
    for serial in 1..2000 {
        let lamps = vec![lamp("a", 0.3 - 0.0003 * serial as f32)];
        worker.order(LampOrder { view: view.clone(), lamps, shows_arriving: false, serial });
        seen += u32::from(worker.take().is_some());
        if seen > 3 {
            return;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    panic!("{seen} pictures of a lamp that moved");
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
