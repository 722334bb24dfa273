//! A graphics device that fails under the window's hands, refuses what is asked of it, or has no memory left.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use clerestory::app::{App, Start};
use clerestory::session::{BakeSettings, BakeState, Source};
use clerestory_relight::gpu::DeviceMemory;
use clerestory_transport::archive;
use clerestory_transport::bake::{Bake, BakeConfig, BakeJob, Passes};
use clerestory_transport::camera::Film;
use clerestory_transport::import;
use clerestory_transport::prepared::PreparedScene;
use eframe::egui::{DroppedFile, Pos2, pos2, vec2};
use eframe::egui_wgpu::{RenderState, RendererOptions, WgpuSetup};
use eframe::wgpu;
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use egui_kittest::wgpu::{WgpuTestRenderer, create_render_state, default_wgpu_setup};

const ROOM: &[u8] = include_bytes!("room.gltf");

type Window = Harness<'static, App>;

/// Steps until something is so. Pictures and bakes come from threads, so this takes real time.
#[track_caller]
fn wait(window: &mut Window, until: impl Fn(&Window) -> bool) {
    for _ in 0..40_000 {
        window.step();
        if until(window) {
            window.run_steps(2);
            return;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    panic!("it never came about; the bake: {:?}", window.state().session().bake);
}

/// The baked room, relit on a device of the test's.
fn relit_on(state: &RenderState) -> Window {
    let mut window = baked_on(state);
    choose_device(&mut window);
    wait(&mut window, is_on_device);
    window
}

fn is_on_device(window: &Window) -> bool {
    // Whatever its name is.
    window.query_by_label_contains("Relight: ").is_some() && !is_on_cpu(window)
}

fn is_on_cpu(window: &Window) -> bool {
    window.query_by_label_contains("Relight: CPU").is_some()
}

/// The same, relit on the CPU.
fn baked_on(state: &RenderState) -> Window {
    let config = BakeConfig { spp: 4, tolerance_db: 20.0, ..BakeConfig::default() };
    let settings = BakeSettings {
        camera_idx: 0,
        film: Film { width: 64, height: 48 },
        config,
        illuminance: false,
        work_plane: None,
    };
    let room = Source::Bytes { name: "room.gltf".into(), bytes: ROOM.to_vec() };
    let start = Start::alone(room, Some(settings));
    let renderer = WgpuTestRenderer::from_render_state(state.clone());
    let mut window: Window = Harness::builder()
        .with_size(vec2(1440.0, 900.0))
        .renderer(renderer)
        .build_eframe(|cc| App::new(cc, start).expect("the system gives threads"));
    let is_done = |window: &Window| {
        let app = window.state();
        app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled()
    };
    wait(&mut window, is_done);
    window
}

/// The test's device is none of hardware, so it must be asked for.
fn choose_device(window: &mut Window) {
    window.get_by_label_contains("Relight: CPU").click();
    window.run_steps(3);
    window.get_by_label("Graphics device").click();
    window.run_steps(3);
}

fn add_lamp(window: &mut Window) {
    window.get_by_label("Add lamp").click();
    window.run_steps(3);
    window.get_by_label("Point").click();
}

/// Takes the fader of the room's lamp in hand; where it is for a share of its length.
fn take_fader(window: &mut Window) -> impl Fn(f32) -> Pos2 + use<> {
    let slider = window.get_by_label("lamp intensity").rect();
    let at = move |share: f32| pos2(slider.left() + share * slider.width(), slider.center().y);
    window.drag_at(at(0.6));
    window.hover_at(at(0.7));
    window.run_steps(2);
    at
}

#[test]
fn a_device_lost_in_mid_drag_leaves_the_picture_to_the_cpu_and_is_told() {
    let state = create_render_state(default_wgpu_setup(), RendererOptions::PREDICTABLE);
    let mut window = relit_on(&state);

    // The device lights lamps that are added, too.
    add_lamp(&mut window);
    wait(&mut window, |window| window.state().is_settled() && window.state().look().lights.lamps.len() == 1);

    let at = take_fader(&mut window);
    let (n_before, ev_before) = (window.state().n_pictures(), window.state().shown_ev());
    assert!(is_on_device(&window), "it still works");

    state.device.destroy();
    window.hover_at(at(0.9));
    // A picture of the device's may still be under way and come first.
    wait(&mut window, |window| is_on_cpu(window) && window.state().n_pictures() > n_before);
    assert!(window.query_by_label_contains("The CPU goes on: the graphics device failed").is_some(), "and why");
    window.drop_at(at(0.9));
    window.run_steps(3);
    assert!(window.state().look().lights.lights["lamp"].intensity > 2.0, "the drag went on");
    // Held while the hand was on the fader, metered by the CPU now.
    wait(&mut window, |window| window.state().shown_ev() < ev_before - 0.1);
    wait(&mut window, |window| window.state().is_settled());
    assert!(window.query_by_label_contains("the CPU lights the lamps").is_none(), "they have a CPU's view now");
}

#[test]
fn another_window_goes_on_with_a_device_of_its_own_and_all_that_was_open() {
    let state = create_render_state(default_wgpu_setup(), RendererOptions::PREDICTABLE);
    let mut window = relit_on(&state);
    let at = take_fader(&mut window);
    window.drop_at(at(0.9));
    wait(&mut window, |window| window.state().is_settled());
    let intensity = |window: &Window| window.state().look().lights.lights.get("lamp").map_or(1.0, |set| set.intensity);
    let (chosen, n_before) = (intensity(&window), window.state().n_pictures());
    state.device.destroy();
    let app = window.into_state();

    let state = create_render_state(default_wgpu_setup(), RendererOptions::PREDICTABLE);
    let mut window: Window = Harness::builder()
        .with_size(vec2(1440.0, 900.0))
        .renderer(WgpuTestRenderer::from_render_state(state))
        .build_eframe(|cc| app.moved_to(cc));
    wait(&mut window, |window| window.state().n_pictures() > n_before && window.state().is_settled());
    assert!(is_on_device(&window), "the device that was asked for relights again");
    assert!(!window.state().graphics().unwrap().is_lost());
    assert!(window.query_by_label_contains("this window goes on with another one").is_some());
    assert_eq!(window.state().session().bake, BakeState::Done, "nothing is baked again");
    assert_eq!(intensity(&window), chosen);

    // What was drawn for the old window is drawn for this one, and the way back is still there.
    let picture = window.render().unwrap();
    let middle = picture.get_pixel(picture.width() / 2, picture.height() / 2).0;
    assert!(middle[..3].iter().any(|v| *v > 20), "{middle:?}");
    let n_before = window.state().n_pictures();
    window.get_by_label("Undo").click();
    window.run_steps(3);
    assert!(intensity(&window) != chosen);
    wait(&mut window, |window| window.state().n_pictures() > n_before && window.state().is_settled());
    assert!(is_on_device(&window));
}

#[test]
fn a_device_without_memory_leaves_the_picture_to_the_cpu_and_takes_it_up_again() {
    let state = create_render_state(default_wgpu_setup(), RendererOptions::PREDICTABLE);
    let mut window = relit_on(&state);
    let told = "The CPU goes on: the graphics device is out of memory";
    assert!(window.query_by_label_contains("on the device").is_some(), "what it takes of the device");

    // In the middle of a drag the light of a new lamp asks for memory that is not there.
    let at = take_fader(&mut window);
    window.state().graphics().unwrap().set_memory(DeviceMemory::Exhausted);
    window.hover_at(at(0.8));
    window.run_steps(3);
    assert!(!is_on_cpu(&window), "light that moves needs none");
    window.drop_at(at(0.8));
    add_lamp(&mut window);
    wait(&mut window, |window| is_on_cpu(window) && window.query_by_label_contains(told).is_some());
    assert!(window.query_by_label_contains("on the device").is_none());
    let n_before = window.state().n_pictures();
    wait(&mut window, |window| window.state().n_pictures() > n_before && window.state().is_settled());

    // Tried again in vain, and then not.
    let intensity = |window: &Window| window.state().look().lights.lights["lamp"].intensity;
    let before = intensity(&window);
    window.run_steps(20);
    let at = take_fader(&mut window);
    wait(&mut window, |window| is_on_cpu(window) && window.query_by_label_contains(told).is_some());
    window.state().graphics().unwrap().set_memory(DeviceMemory::Available);
    for turn in 0..400 {
        window.hover_at(at(0.5 + 0.3 * (turn % 2) as f32));
        window.run_steps(2);
        if !is_on_cpu(&window) {
            break;
        }
    }
    assert!(!is_on_cpu(&window) && window.query_by_label_contains("The graphics device relights again").is_some());
    window.drop_at(at(0.3));
    window.run_steps(3);
    assert!(intensity(&window) < before, "the drag went on");
    assert!(!window.state().graphics().unwrap().is_lost());
}

#[test]
fn a_device_that_refuses_a_frame_leaves_it_to_the_cpu_and_takes_a_smaller_one() {
    let mut setup = default_wgpu_setup();
    let WgpuSetup::CreateNew(new) = &mut setup else { panic!("the test makes its own device") };
    new.device_descriptor = Arc::new(|adapter| {
        let required_limits = wgpu::Limits { max_storage_buffer_binding_size: 40_000, ..adapter.limits() };
        wgpu::DeviceDescriptor { required_limits, ..Default::default() }
    });
    let state = create_render_state(setup, RendererOptions::PREDICTABLE);
    let mut window = baked_on(&state);
    choose_device(&mut window);
    let told = "The CPU goes on: the frame's radiance takes 49152, the graphics device allows 40000";
    wait(&mut window, |window| window.query_by_label_contains(told).is_some());
    assert!(is_on_cpu(&window));
    wait(&mut window, |window| window.state().is_settled());

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.transport");
    archive::write(&small_bake(), &path).unwrap();
    window.input_mut().dropped_files.push(Arc::new(Dropped(path)));
    wait(&mut window, is_on_device);
    let small = |window: &Window| window.state().session().shown.as_ref().is_some_and(|s| s.header.width == 32);
    assert!(small(&window), "the smaller frame is on the device");
}

/// A file on its way into the window.
#[derive(Debug)]
struct Dropped(PathBuf);

impl DroppedFile for Dropped {
    fn path(&self) -> &Path {
        &self.0
    }

    fn bytes(&self) -> Result<Vec<u8>, String> {
        std::fs::read(&self.0).map_err(|error| error.to_string())
    }
}

/// The room in a picture that a narrow device takes.
fn small_bake() -> Bake {
    let scene = import::load_bytes("room.gltf", ROOM).expect("the room is valid").scene;
    let scene = Arc::new(PreparedScene::new(scene, &[]).expect("the room is valid").0);
    let (camera, film) = (scene.scene.cameras[0].clone(), Film { width: 32, height: 24 });
    let config = BakeConfig { spp: 1, tolerance_db: 10.0, ..BakeConfig::default() };
    let job = BakeJob { scene, camera, film, config, passes: Passes::FinalOnly, irradiance: Vec::new() };
    let baked = job.run(|_| std::ops::ControlFlow::Continue(())).expect("the room can be baked");
    baked.expect("nobody stopped it")
}
