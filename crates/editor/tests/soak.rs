//! A monkey over the whole window: seeded clicks, drags, keys, words and files, with an eye on panics and on memory.
//!
//! `CLERESTORY_SOAK_SECS` lets it go on for as long as that; `CLERESTORY_SOAK_SEED` gives it other ideas.

#![expect(clippy::unwrap_used, reason = "a panic is how a test fails")]

#[expect(dead_code, reason = "what the other tests of the window need")]
#[path = "window/desk.rs"]
mod desk;

use std::alloc::System;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use cap::Cap;
use clerestory::session::{BakeState, Source};
use desk::{Dropped, Window, open_by, quick, room, wait};
use eframe::egui::accesskit::Role;
use eframe::egui::{
    Event, Key, Modifiers, MouseWheelSource, MouseWheelUnit, PointerButton, Pos2, TouchPhase, pos2, vec2,
};
use eframe::egui_wgpu::{RenderState, RendererOptions};
use egui_kittest::Harness;
use egui_kittest::kittest::{By, NodeT, Queryable};
use egui_kittest::wgpu::{WgpuTestRenderer, create_render_state, default_wgpu_setup};

/// Inputs of an episode; after each the window is closed and opened again.
const INPUTS: u32 = 150;
/// Episodes without `CLERESTORY_SOAK_SECS`.
const EPISODES: u32 = 5;
/// Of so many episodes one has a graphics device, which is lost in the middle; the next one finds another.
const WITH_DEVICE: u32 = 3;
/// Episodes until caches, pools and fonts are what they stay.
const WARM: u32 = 2;
/// Growth of the process from then on that is no leak: a tenth, and caches.
const GROWTH: f64 = 1.1;
const SLACK_BYTES: f64 = 5e5;

/// Counts what is allocated and not freed: what the system counts depends on when an allocator gives memory back.
#[global_allocator]
static ALLOCATED: Cap<System> = Cap::new(System, usize::MAX);

const KEYS: [Key; 16] = [
    Key::Z,
    Key::Y,
    Key::S,
    Key::O,
    Key::E,
    Key::B,
    Key::F,
    Key::D,
    Key::F1,
    Key::Delete,
    Key::Escape,
    Key::Enter,
    Key::Tab,
    Key::ArrowRight,
    Key::ArrowDown,
    Key::G,
];
const MODIFIERS: [Modifiers; 4] =
    [Modifiers::NONE, Modifiers::COMMAND, Modifiers::SHIFT, Modifiers::COMMAND.plus(Modifiers::SHIFT)];
/// Small numbers, so that no bake takes a day; words, and nonsense.
const WORDS: [&str; 8] = ["0", "1", "-3", "48", "2700", "nan", "lämp", "../../x.look"];

/// Draws from a seed.
struct Monkey {
    state: u64,
    files: Vec<PathBuf>,
}

impl Monkey {
    fn below(&mut self, n: usize) -> usize {
        // SplitMix64.
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.state ^ (self.state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) % n as u64) as usize
    }

    fn one_of<T: Copy>(&mut self, of: &[T]) -> T {
        of[self.below(of.len())]
    }

    fn place(&mut self) -> Pos2 {
        pos2(self.below(1440) as f32, self.below(900) as f32)
    }

    /// The middle of something that can be used, wherever it is.
    fn widget(&mut self, window: &Window) -> Pos2 {
        let is_usable = |role: Role| {
            use Role::{Button, CheckBox, ComboBox, MenuItem, RadioButton, Slider, SpinButton, TextInput};
            matches!(role, Button | CheckBox | ComboBox | MenuItem | RadioButton | Slider | SpinButton | TextInput)
        };
        let all = window.query_all(By::new().recursive(true));
        let usable: Vec<Pos2> =
            all.filter(|node| is_usable(node.accesskit_node().role())).map(|node| node.rect().center()).collect();
        if usable.is_empty() { self.place() } else { self.one_of(&usable) }
    }

    fn button(&mut self, window: &mut Window, at: Pos2, button: PointerButton, pressed: bool) {
        let modifiers = self.one_of(&MODIFIERS);
        window.event(Event::PointerMoved(at));
        window.event(Event::PointerButton { pos: at, button, pressed, modifiers });
        window.step();
    }

    fn act(&mut self, window: &mut Window) {
        match self.below(20) {
            0..=8 => {
                let at = self.widget(window);
                let button = if self.below(8) == 0 { PointerButton::Secondary } else { PointerButton::Primary };
                self.button(window, at, button, true);
                self.button(window, at, button, false);
            }
            9..=12 => {
                let (from, to) = (if self.below(2) == 0 { self.widget(window) } else { self.place() }, self.place());
                let button = self.one_of(&[PointerButton::Primary, PointerButton::Primary, PointerButton::Middle]);
                self.button(window, from, button, true);
                for step in 1..=3 {
                    window.event(Event::PointerMoved(from + (to - from) * (step as f32 / 3.0)));
                    window.step();
                }
                self.button(window, to, button, false);
            }
            13 | 14 => {
                let (at, modifiers) = (self.place(), self.one_of(&MODIFIERS));
                let delta = vec2(0.0, self.below(401) as f32 - 200.0);
                window.event(Event::PointerMoved(at));
                let (unit, phase) = (MouseWheelUnit::Point, TouchPhase::Move);
                window.event(Event::MouseWheel { unit, delta, phase, modifiers, source: MouseWheelSource::Unknown });
                window.step();
            }
            15 | 16 => {
                let (modifiers, key) = (self.one_of(&MODIFIERS), self.one_of(&KEYS));
                window.key_press_modifiers(modifiers, key);
                window.step();
            }
            17 | 18 => {
                window.event(Event::Text(self.one_of(&WORDS).into()));
                window.step();
            }
            _ => {
                let which = self.below(self.files.len());
                let file = self.files[which].clone();
                window.input_mut().dropped_files.push(Arc::new(Dropped(file)));
                window.step();
            }
        }
        window.step();
    }
}

/// Files to drop: a scene, a look, pictures, and things that are none.
fn files(folder: &Path) -> Vec<PathBuf> {
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    };
    let scene = room();
    let stage = folder.join("stage");
    std::fs::create_dir(&stage).unwrap();
    for (name, gray) in [("a", 60), ("b", 120)] {
        image::GrayImage::from_pixel(16, 12, image::Luma([gray])).save(stage.join(format!("{name}.png"))).unwrap();
    }
    vec![
        write("room.gltf", &scene),
        write("half.gltf", &scene[..scene.len() / 2]),
        write("dim.look", br#"{"clerestory": 1, "lights": {"lamp": {"intensity": 0.25}}}"#),
        write("cut.look", br#"{"clerestory": 1, "lights": {"lamp": {"inten"#),
        write("nothing.transport", b"CLERTRAN"),
        stage,
        folder.join("missing.glb"),
    ]
}

/// A graphics device, software as it may be.
fn device() -> RenderState {
    create_render_state(default_wgpu_setup(), RendererOptions::PREDICTABLE)
}

/// A window with its first picture; with a device that multiplies, if one is given.
fn opened(device: Option<&RenderState>, home: &Path) -> Window {
    let source = Source::Bytes { name: "room.gltf".into(), bytes: room() };
    let builder = match device {
        Some(device) => Harness::builder().renderer(WgpuTestRenderer::from_render_state(device.clone())),
        None => Harness::builder(),
    };
    // Lights that were not saved would be asked for before a device can be chosen.
    let home = device.is_none().then_some(home);
    let mut window = open_by(builder, source, quick(), home);
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
    if device.is_some() {
        // One of software is used only where it is asked for.
        window.get_by_label_contains("Relight: CPU").click();
        window.run_steps(3);
        window.get_by_label("Graphics device").click();
        for _ in 0..2000 {
            window.step();
            if window.query_by_label_contains("Relight: CPU").is_none() {
                return window;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        panic!("the graphics device is not taken up");
    }
    window
}

#[test]
fn a_monkey_breaks_nothing_and_leaves_no_memory_behind() {
    let home = tempfile::tempdir().unwrap();
    // What it saves under a name without a folder goes here.
    std::env::set_current_dir(home.path()).unwrap();
    let number = |name| std::env::var(name).ok().and_then(|text| text.parse::<u64>().ok());
    let (secs, seed) = (number("CLERESTORY_SOAK_SECS"), number("CLERESTORY_SOAK_SEED").unwrap_or(1));
    let mut monkey = Monkey { state: seed, files: files(home.path()) };
    let (started, mut warm_bytes, mut n_episodes, mut n_lost) = (Instant::now(), 0.0, 0, 0);
    let goes_on = |n_episodes| match secs {
        Some(secs) => started.elapsed() < Duration::from_secs(secs) || n_episodes <= WARM,
        None => n_episodes < EPISODES,
    };
    while goes_on(n_episodes) {
        let device = (n_episodes % WITH_DEVICE == WITH_DEVICE - 1).then(device);
        let mut window = opened(device.as_ref(), home.path());
        for input in 0..INPUTS {
            if let Some(device) = device.as_ref().filter(|_| input == INPUTS / 2) {
                device.device.destroy();
                n_lost += 1;
            }
            let acted = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| monkey.act(&mut window)));
            assert!(acted.is_ok(), "seed {seed}: it broke at input {input} of episode {n_episodes}");
        }
        drop(window);
        n_episodes += 1;
        if n_episodes == WARM {
            warm_bytes = ALLOCATED.allocated() as f64;
        }
    }
    let n_inputs = n_episodes * INPUTS;
    println!(
        "{n_inputs} inputs in {n_episodes} windows, {n_lost} lost devices, {:.0} s",
        started.elapsed().as_secs_f32()
    );
    let bytes = ALLOCATED.allocated() as f64;
    println!("{:.1} MB after {WARM} windows, {:.1} MB at the end", warm_bytes / 1e6, bytes / 1e6);
    assert!(bytes < warm_bytes * GROWTH + SLACK_BYTES, "memory grew from {warm_bytes} to {bytes} bytes");
}
