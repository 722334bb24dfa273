//! A graphics device that fails under the window's hands.

use std::time::Duration;

use clerestory::app::{App, Start};
use clerestory::session::{BakeSettings, BakeState, Source};
use clerestory_transport::bake::BakeConfig;
use clerestory_transport::camera::Film;
use eframe::egui::{pos2, vec2};
use eframe::egui_wgpu::RendererOptions;
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use egui_kittest::wgpu::{WgpuTestRenderer, create_render_state, default_wgpu_setup};

type Window = Harness<'static, App>;

/// Steps until something is so. Pictures and bakes come from threads, so this takes real time.
#[track_caller]
fn wait(window: &mut Window, until: impl Fn(&Window) -> bool) {
    for _ in 0..4000 {
        window.step();
        if until(window) {
            window.run_steps(2);
            return;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    panic!("it never came about; the bake: {:?}", window.state().session().bake);
}

#[test]
fn a_device_lost_in_mid_drag_leaves_the_picture_to_the_cpu_and_is_told() {
    let state = create_render_state(default_wgpu_setup(), RendererOptions::PREDICTABLE);
    let config = BakeConfig { spp: 4, tolerance_db: 20.0, ..BakeConfig::default() };
    let settings = BakeSettings { camera_idx: 0, film: Film { width: 64, height: 48 }, config, illuminance: false };
    let room = Source::Bytes { name: "room.gltf".into(), bytes: include_bytes!("room.gltf").to_vec() };
    let start = Start::alone(room, Some(settings));
    let renderer = WgpuTestRenderer::from_render_state(state.clone());
    let mut window: Window = Harness::builder()
        .with_size(vec2(1440.0, 900.0))
        .renderer(renderer)
        .build_eframe(|cc| App::new(cc, start).unwrap());
    let is_done = |window: &Window| {
        let app = window.state();
        app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled()
    };
    wait(&mut window, is_done);

    // The test's device is none of hardware, so it must be asked for.
    window.get_by_label_contains("Relight: CPU").click();
    window.run_steps(3);
    window.get_by_label("Graphics device").click();
    wait(&mut window, |window| window.query_by_label_contains("Relight: llvmpipe").is_some());

    // The device lights lamps that are added, too.
    window.get_by_label("Add lamp").click();
    window.run_steps(3);
    window.get_by_label("Point").click();
    wait(&mut window, |window| window.state().is_settled() && window.state().look().lights.lamps.len() == 1);

    let slider = window.get_by_label("lamp intensity").rect();
    let at = |share: f32| pos2(slider.left() + share * slider.width(), slider.center().y);
    window.drag_at(at(0.6));
    window.hover_at(at(0.7));
    window.run_steps(2);
    let (n_before, ev_before) = (window.state().n_pictures(), window.state().shown_ev());
    assert!(window.query_by_label_contains("Relight: llvmpipe").is_some(), "it still works");

    state.device.destroy();
    window.hover_at(at(0.9));
    // A picture of the device's may still be under way and come first.
    let on_cpu = |window: &Window| window.query_by_label_contains("Relight: CPU").is_some();
    wait(&mut window, |window| on_cpu(window) && window.state().n_pictures() > n_before);
    assert!(window.query_by_label_contains("The CPU goes on: the graphics device failed").is_some(), "and why");
    window.drop_at(at(0.9));
    window.run_steps(3);
    assert!(window.state().look().lights.lights["lamp"].intensity > 2.0, "the drag went on");
    // Held while the hand was on the fader, metered by the CPU now.
    wait(&mut window, |window| window.state().shown_ev() < ev_before - 0.1);
    wait(&mut window, |window| window.state().is_settled());
    assert!(window.query_by_label_contains("the CPU lights the lamps").is_none(), "they have a CPU's view now");
}
