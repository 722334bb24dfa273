//! What the tests of the window share: a tiny room with a lamp and a panel, opened and baked; clicks and drags.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clerestory::app::{App, Start};
use clerestory::bake_cache::BakeCache;
use clerestory::session::{BakeSettings, BakeState, Source};
use clerestory::theme::ACCENT;
use clerestory_transport::bake::BakeConfig;
use clerestory_transport::camera::Film;
use eframe::egui::{
    DroppedFile, Event, Key, Modifiers, PointerButton, Pos2, Rect, Role, Shape, Vec2, ViewportCommand, ViewportEvent,
    vec2,
};
use egui_kittest::kittest::{NodeT, Queryable};
use egui_kittest::{Harness, HarnessBuilder, Node};
use glam::Vec3;
use serde_json::{Value, json};

pub type Window = Harness<'static, App>;

/// Of a picture that only has to be there.
pub const SMALL: Film = Film { width: 32, height: 24 };
/// Of one whose pixels or blocks are counted, or whose bake is not to end at once.
pub const LARGER: Film = Film { width: 64, height: 48 };

/// The closed room of the process tests, with a panel of 4 × 4 texels under its ceiling.
pub fn room() -> Vec<u8> {
    let mut gltf: Value = serde_json::from_str(include_str!("../room.gltf")).unwrap();
    let push = |list: &mut Value, item: Value| {
        let list = list.as_array_mut().unwrap();
        list.push(item);
        list.len() - 1
    };
    // The fourth quad of the box faces down: placed in view, it is the panel.
    let quad = json!({"bufferView": 1, "byteOffset": 36, "componentType": 5123, "count": 6, "type": "SCALAR"});
    let indices = push(&mut gltf["accessors"], quad);
    let material = push(&mut gltf["materials"], json!({"emissiveFactor": [1, 0.9, 0.8]}));
    let primitive = json!({"attributes": {"POSITION": 0}, "indices": indices, "material": material});
    let mesh = push(&mut gltf["meshes"], json!({"primitives": [primitive]}));
    let panel = json!({"name": "panel", "mesh": mesh, "scale": [0.4, 0.2, 0.4], "translation": [0, 0.2, -0.5],
        "extras": {"clerestory": {"panel": 4}}});
    let node = push(&mut gltf["nodes"], panel);
    push(&mut gltf["scenes"][0]["nodes"], json!(node));
    serde_json::to_vec(&gltf).unwrap()
}

pub fn open(source: Source) -> Window {
    open_small(source, quick())
}

/// Opened and baked as asked, in few pixels.
pub fn open_small(source: Source, config: BakeConfig) -> Window {
    open_in(Harness::builder(), source, (SMALL, config), None)
}

/// Opened and baked in more of them.
pub fn open_larger(source: Source) -> Window {
    open_with(source, quick(), None)
}

/// Baked in no time.
pub fn quick() -> BakeConfig {
    BakeConfig { spp: 4, tolerance_db: 20.0, ..BakeConfig::default() }
}

/// The same as asked, with a folder of the user's for unsaved looks and finished bakes.
pub fn open_with(source: Source, config: BakeConfig, home: Option<&Path>) -> Window {
    open_by(Harness::builder(), source, config, home)
}

/// The same in a window that is being built, with a graphics device of its own for one.
pub fn open_by(builder: HarnessBuilder<App>, source: Source, config: BakeConfig, home: Option<&Path>) -> Window {
    open_in(builder, source, (LARGER, config), home)
}

fn open_in(
    builder: HarnessBuilder<App>,
    source: Source,
    (film, config): (Film, BakeConfig),
    home: Option<&Path>,
) -> Window {
    let settings = BakeSettings { camera_idx: 0, film, config, illuminance: false, work_plane: None };
    let unsaved = home.map(|home| home.join("unsaved"));
    let cache = home.map(|home| BakeCache::new(home.join("bakes"), 1 << 24));
    let start = Start { unsaved, cache, ..Start::alone(source, Some(settings)) };
    builder.with_size(vec2(1440.0, 900.0)).build_eframe(|cc| App::new(cc, start).unwrap())
}

/// The room, baked, with its first picture.
pub fn baked() -> Window {
    shown(open(Source::Bytes { name: "room.gltf".into(), bytes: room() }))
}

/// The same in more pixels.
pub fn baked_larger() -> Window {
    shown(open_larger(Source::Bytes { name: "room.gltf".into(), bytes: room() }))
}

/// Once it is baked and has its first picture.
fn shown(mut window: Window) -> Window {
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
    window
}

/// A file that is opened in a window that begins with what another one left.
pub fn open_again(path: &Path, kept: Kept) -> Window {
    let settings = BakeSettings { camera_idx: 0, film: SMALL, config: quick(), illuminance: false, work_plane: None };
    let kept: &'static Kept = Box::leak(Box::new(kept));
    let start = Start::alone(Source::File(path.into()), Some(settings));
    Harness::builder().with_size(vec2(1440.0, 900.0)).build_eframe(|cc| {
        cc.storage = Some(kept);
        App::new(cc, start).unwrap()
    })
}

/// Steps until something is so. Pictures and bakes come from threads, so this takes real time.
#[track_caller]
pub fn wait(window: &mut Window, until: impl Fn(&App) -> bool) {
    wait_until(window, |window| until(window.state()));
    window.run_steps(2);
}

/// Steps until the window shows something.
#[track_caller]
pub fn wait_until(window: &mut Window, until: impl Fn(&Window) -> bool) {
    for nth in 0..40_000 {
        window.step();
        if until(window) {
            return;
        }
        // What takes long gets the cores that looking for it would take.
        std::thread::sleep(Duration::from_millis(if nth < 50 { 2 } else { 8 }));
    }
    panic!(
        "it never came about; the bake: {:?}, the stage: {:?}",
        window.state().session().bake,
        window.state().session().stage
    );
}

/// Clicks somewhere without a drag.
pub fn click_at(window: &mut Window, at: Pos2) {
    window.hover_at(at);
    window.run_steps(2);
    window.drag_at(at);
    window.run_steps(2);
    window.drop_at(at);
    window.run_steps(4);
}

/// Takes something at one point and pulls it to another in small steps, without letting go.
pub fn pull(window: &mut Window, from: Pos2, to: Pos2) {
    window.hover_at(from);
    window.run_steps(2);
    window.drag_at(from);
    window.run_steps(2);
    for step in 1..=5 {
        window.hover_at(from + (to - from) * (step as f32 / 5.0));
        window.run_steps(2);
    }
}

/// Drags from one point to another in small steps.
pub fn drag(window: &mut Window, from: Pos2, to: Pos2) {
    pull(window, from, to);
    window.drop_at(to);
    window.run_steps(3);
}

pub fn click(window: &mut Window, label: &str) {
    window.get_by_label(label).click();
    window.run_steps(3);
}

/// Asks for the menu of what is at a place.
pub fn ask_for_menu(window: &mut Window, pos: Pos2) {
    window.hover_at(pos);
    window.run_steps(2);
    for pressed in [true, false] {
        let (button, modifiers) = (PointerButton::Secondary, Modifiers::NONE);
        window.event(Event::PointerButton { pos, button, pressed, modifiers });
        window.run_steps(1);
    }
    window.run_steps(3);
}

/// Types over what stands in a field, a key in a frame as people do, and stays in it.
pub fn type_keys(window: &mut Window, label: &str, text: &str) {
    // Words beside the field may be the same.
    let is_field = |node: &Node<'_>| node.accesskit_node().role() != Role::Label;
    window.query_all_by_label(label).find(is_field).unwrap().scroll_to_me();
    window.run_steps(8);
    let at = window.query_all_by_label(label).find(is_field).unwrap().rect().center();
    window.hover_at(at);
    window.run_steps(1);
    window.drag_at(at);
    window.drop_at(at);
    window.run_steps(2);
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.run_steps(1);
    for key in text.chars() {
        window.event(Event::Text(key.to_string()));
        window.run_steps(2);
    }
}

/// The same, and ends with Enter.
pub fn type_over(window: &mut Window, label: &str, text: &str) {
    type_keys(window, label, text);
    window.key_press(Key::Enter);
    window.run_steps(4);
}

/// Drags far to the left and back to where the drag began; answers what `seen` says on the way.
pub fn there_and_back<T>(window: &mut Window, label: &str, points: f32, seen: impl Fn(&App) -> T) -> T {
    window.get_by_label(label).scroll_to_me();
    window.run_steps(8);
    let from = window.get_by_label(label).rect().center();
    window.hover_at(from);
    window.run_steps(2);
    window.drag_at(from);
    window.run_steps(2);
    let step_to = |window: &mut Window, x: f32| {
        window.hover_at(from + vec2(x, 0.0));
        window.run_steps(2);
    };
    // What it takes to be a drag is not counted as a part of it.
    step_to(window, -8.0);
    step_to(window, -points);
    let seen = seen(window.state());
    step_to(window, -8.0);
    step_to(window, 0.0);
    window.drop_at(from);
    window.run_steps(3);
    seen
}

/// Clicks on something that may lie below what is seen of its panel.
pub fn reach(window: &mut Window, label: &str) {
    window.get_by_label(label).scroll_to_me();
    window.run_steps(8);
    click(window, label);
}

/// Clicks what asks for a file, and types its path.
pub fn ask_for(window: &mut Window, label: &str, path: &Path) {
    click(window, label);
    window.get_by_label("Path").set_text_value_accesskit(&path.display().to_string());
    window.run_steps(3);
}

/// The same, and saves.
pub fn save_as(window: &mut Window, label: &str, path: &Path) {
    ask_for(window, label, path);
    click(window, "Save");
}

/// Writes another model to the place of the open one, and reloads it once that is offered.
pub fn replace_and_reload(window: &mut Window, path: &Path, gltf: &Value) {
    std::fs::write(path, serde_json::to_vec(gltf).unwrap()).unwrap();
    for _ in 0..200 {
        window.step();
        if window.query_by_label("room.gltf has changed on disk").is_some() {
            break;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    click(window, "Reload");
}

/// Whether something says a part of this once the pointer rests on it.
pub fn hints(window: &mut Window, label: &str, part: &str) -> bool {
    window.get_by_label(label).scroll_to_me();
    window.run_steps(8);
    let at = window.get_by_label(label).rect().center();
    window.hover_at(at);
    window.run_steps(60);
    window.query_all_by_label_contains(part).next().is_some()
}

/// Whether a widget is framed as what has the keyboard.
pub fn is_framed(window: &Window, label: &str) -> bool {
    let place = window.get_by_label(label).rect();
    window.output().shapes.iter().any(|clipped| match &clipped.shape {
        Shape::Rect(frame) => frame.stroke.color == ACCENT && (frame.rect.center() - place.center()).length() < 0.5,
        _ => false,
    })
}

/// Where a point of the room is on the screen.
pub fn on_screen(window: &Window, point: Vec3) -> Pos2 {
    let area: Rect = window.get_by_label("Picture").rect();
    let shown = window.state().session().shown.as_ref().unwrap();
    let film = Film { width: shown.header.width, height: shown.header.height };
    let px = shown.camera.as_ref().unwrap().project(film, point).unwrap();
    let size = vec2(film.width as f32, film.height as f32);
    let room = area.size() - Vec2::splat(28.0);
    let scale = (room.x / size.x).min(room.y / size.y);
    area.center() + (vec2(px.x, px.y) - size / 2.0) * scale
}

/// Whether the window asked the system for something in the frame before.
pub fn sends(window: &Window, wanted: &ViewportCommand) -> bool {
    window.output().viewport_output.values().any(|output| output.commands.contains(wanted))
}

/// Has the system ask the window to close; answers whether it does.
pub fn ask_to_close(window: &mut Window) -> bool {
    let input = window.input_mut();
    let id = input.viewport_id;
    input.viewports.entry(id).or_default().events.push(ViewportEvent::Close);
    window.step();
    let closes = !sends(window, &ViewportCommand::CancelClose);
    window.run_steps(2);
    closes
}

/// Presses the key that closes the window, which the system then asks it to; answers whether it closes.
pub fn quit_by_key(window: &mut Window) -> bool {
    let (key, modifiers) = (Key::Q, Modifiers::COMMAND);
    let event = Event::Key { key, physical_key: None, pressed: true, repeat: false, modifiers };
    window.input_mut().events.push(event);
    // A field that is typed into takes its text first.
    let is_heard = (0..4).any(|_| {
        window.step();
        sends(window, &ViewportCommand::Close)
    });
    assert!(is_heard, "the key closes nothing");
    ask_to_close(window)
}

/// Sixteen pictures of noise in a folder: their bake takes its time.
pub fn noisy_stage() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for light in 0..16u32 {
        let noise = |x: u32, y: u32| {
            let bits = (x + 800 * y + 480_000 * light).wrapping_mul(0x9e37_79b9);
            image::Luma([(bits ^ (bits >> 15)).wrapping_mul(0x85eb_ca6b).to_be_bytes()[0]])
        };
        image::GrayImage::from_fn(800, 600, noise).save(folder.path().join(format!("{light}.png"))).unwrap();
    }
    folder
}

/// A file on its way into the window.
#[derive(Debug)]
pub struct Dropped(pub PathBuf);

impl DroppedFile for Dropped {
    fn path(&self) -> &Path {
        &self.0
    }

    fn bytes(&self) -> Result<Vec<u8>, String> {
        std::fs::read(&self.0).map_err(|error| error.to_string())
    }
}

/// What a window leaves for the next one.
#[derive(Default)]
pub struct Kept(pub HashMap<String, String>);

impl Kept {
    /// What a window would leave if it were closed now.
    pub fn by(window: &mut Window) -> Kept {
        let mut kept = Kept::default();
        eframe::App::save(window.state_mut(), &mut kept);
        kept
    }
}

impl eframe::Storage for Kept {
    fn get_string(&self, key: &str) -> Option<String> {
        self.0.get(key).cloned()
    }

    fn set_string(&mut self, key: &str, value: String) {
        self.0.insert(key.into(), value);
    }

    fn remove_string(&mut self, key: &str) {
        self.0.remove(key);
    }

    fn flush(&mut self) {}
}
