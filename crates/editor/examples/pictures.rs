//! Makes the pictures of README.md and docs/guide.md: the real window on the built-in scene, drawn without a display.
//!
//! `cargo run --release -p clerestory --example pictures -- [FOLDER [SPP]]` writes into `docs` with 64 samples per pixel.

#![expect(clippy::print_stdout, reason = "a command that says what it wrote")]

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, bail};
use clerestory::app::{App, Start};
use clerestory::session::{BakeSettings, BakeState, Source};
use clerestory_transport::bake::{BakeConfig, Indirect};
use clerestory_transport::camera::Film;
use eframe::egui::accesskit::Role;
use eframe::egui::{Key, Pos2, pos2, vec2};
use egui_kittest::kittest::{NodeT, Queryable};
use egui_kittest::{Harness, Node};
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder};

const FILM: Film = Film { width: 640, height: 360 };
/// The smaller one whose illuminance is baked.
const MEASURED: Film = Film { width: 480, height: 270 };
const SPP: u32 = 64;
/// Of JPEG: letters stay clean, and a picture stays below 400 kB.
const QUALITY: u8 = 92;
/// Longest wait for a bake.
const PATIENCE: Duration = Duration::from_secs(3600);

type Window = Harness<'static, App>;

fn main() -> Result<()> {
    let mut args = std::env::args_os().skip(1);
    let folder = args.next().map_or_else(|| PathBuf::from("docs"), PathBuf::from);
    let spp = match args.next().map(|text| text.to_string_lossy().parse()) {
        Some(spp) => spp.context("the samples per pixel are a number")?,
        None => SPP,
    };
    println!("baking the built-in scene with {spp} samples per pixel, which takes minutes");
    of_looks(&mut baked(FILM, spp, false)?, &folder)?;
    println!("baking it smaller, with its illuminance");
    of_lux(&mut baked(MEASURED, spp / 2, true)?, &folder)
}

/// The window once the built-in scene is baked.
fn baked(film: Film, spp: u32, illuminance: bool) -> Result<Window> {
    let config = BakeConfig { spp: spp.max(1), indirect: Indirect::Shared, ..BakeConfig::default() };
    let settings = BakeSettings { camera_idx: 0, film, config, illuminance, work_plane: None };
    let start = Start::alone(Source::BuiltIn, Some(settings));
    let mut window: Window = Harness::builder()
        .with_size(vec2(1440.0, 900.0))
        .build_eframe(|cc| App::new(cc, start).expect("the system gives threads"));
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled())?;
    Ok(window)
}

/// Looks, lights and error.
fn of_looks(window: &mut Window, folder: &Path) -> Result<()> {
    click(window, "Keep look")?;
    click(window, "Presets")?;
    click(window, "All four")?;
    click(window, "Look Look")?;
    rest(window)?;
    shoot(window, &folder.join("editor.jpg"))?;

    let middle = window.get_by_label("Picture").rect().center() + vec2(60.0, 40.0);
    click_at(window, middle);
    rest(window)?;
    shoot(window, &folder.join("light-here.jpg"))?;
    window.key_press(Key::Escape);

    click(window, "Look Dusk")?;
    click(window, "Board")?;
    rest(window)?;
    shoot(window, &folder.join("board.jpg"))?;

    click(window, "List")?;
    click(window, "Look Look")?;
    click(window, "Compare")?;
    rest(window)?;
    shoot(window, &folder.join("compare.jpg"))?;
    click(window, "Compare")?;

    click(window, "Timeline")?;
    for look in ["Day", "Dusk", "Night"] {
        click(window, "Add key")?;
        click(window, look)?;
    }
    // A little past the second key.
    let ruler = window.get_by_label("Timeline ruler").rect();
    let key = window.get_by_label_contains("Key 2: ").rect().center();
    click_at(window, pos2(key.x + 20.0, ruler.top() + 8.0));
    rest(window)?;
    shoot(window, &folder.join("timeline.jpg"))?;
    click(window, "Back to the lights")?;
    click(window, "Timeline")?;

    reach(window, "Heat map")?;
    let is_choice = |node: &Node<'_>| node.accesskit_node().role() != Role::Label;
    window.get_all_by_label("Total error").find(is_choice).context("the heat map has no error")?.click();
    rest(window)?;
    shoot(window, &folder.join("heat.jpg"))
}

/// What is measured and wished for.
fn of_lux(window: &mut Window, folder: &Path) -> Result<()> {
    click(window, "Measure")?;
    tool(window, "Surface")?;
    let rug = place(window, 0.5, 0.93);
    click_at(window, rug);
    wait(window, |app| app.marked_lux().is_some() && !app.is_solving())?;
    rest(window)?;
    shoot(window, &folder.join("measure.jpg"))?;
    window.key_press(Key::Escape);
    click(window, "Measure")?;

    click(window, "Solve for light")?;
    tool(window, "Rectangle")?;
    let (from, to) = (place(window, 0.36, 0.3), place(window, 0.64, 0.6));
    drag(window, from, to);
    wait(window, |app| app.marked_lux().is_some() && !app.is_solving())?;
    click(window, "Kind of wish")?;
    click(window, "Times as bright")?;
    click(window, "Add wish")?;
    reach(window, "Solve")?;
    wait(window, |app| app.solution().is_some())?;
    rest(window)?;
    shoot(window, &folder.join("solve.jpg"))
}

/// The first tool of that name: each section that marks has its own.
fn tool(window: &mut Window, name: &str) -> Result<()> {
    window.get_all_by_label(name).next().with_context(|| format!("there is no {name}"))?.click();
    window.run_steps(3);
    Ok(())
}

/// A place in the picture, as shares of its width and height.
fn place(window: &Window, x: f32, y: f32) -> Pos2 {
    let area = window.get_by_label("Picture").rect();
    let size = vec2(MEASURED.width as f32, MEASURED.height as f32);
    let room = area.size() - vec2(28.0, 28.0);
    area.center() + vec2(x - 0.5, y - 0.5) * size * (room.x / size.x).min(room.y / size.y)
}

fn drag(window: &mut Window, from: Pos2, to: Pos2) {
    window.hover_at(from);
    window.run_steps(2);
    window.drag_at(from);
    for step in 1..=8 {
        window.hover_at(from + (to - from) * (step as f32 / 8.0));
        window.run_steps(1);
    }
    window.drop_at(to);
    window.run_steps(4);
}

/// Lets threads and animations come to rest.
fn rest(window: &mut Window) -> Result<()> {
    window.run_steps(12);
    wait(window, App::is_settled)?;
    for _ in 0..100 {
        window.run_steps(1);
        std::thread::sleep(Duration::from_millis(20));
    }
    wait(window, App::is_settled)
}

fn wait(window: &mut Window, until: impl Fn(&App) -> bool) -> Result<()> {
    let begun = Instant::now();
    while begun.elapsed() < PATIENCE {
        window.step();
        if until(window.state()) {
            window.run_steps(2);
            return Ok(());
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    bail!("it never came to rest: {:?}", window.state().session().bake)
}

fn click(window: &mut Window, label: &str) -> Result<()> {
    let button = window.query_by_label(label).with_context(|| format!("the window has no one thing called {label}"))?;
    button.click();
    window.run_steps(6);
    Ok(())
}

/// Clicks on something that may lie below what is seen of its panel.
fn reach(window: &mut Window, label: &str) -> Result<()> {
    window.get_by_label(label).scroll_to_me();
    window.run_steps(8);
    click(window, label)
}

fn click_at(window: &mut Window, at: Pos2) {
    window.hover_at(at);
    window.run_steps(2);
    window.drag_at(at);
    window.drop_at(at);
    window.run_steps(4);
}

fn shoot(window: &mut Window, path: &Path) -> Result<()> {
    // The pointer is out of the way.
    window.hover_at(pos2(720.0, 880.0));
    window.run_steps(4);
    let image = window.render().map_err(|words| anyhow!("the window cannot be drawn: {words}"))?;
    let (width, height) = image.dimensions();
    let rgb: Vec<u8> = image.pixels().flat_map(|pixel| [pixel.0[0], pixel.0[1], pixel.0[2]]).collect();
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, QUALITY).write_image(&rgb, width, height, ExtendedColorType::Rgb8)?;
    std::fs::write(path, bytes).with_context(|| format!("cannot write {}", path.display()))?;
    println!("{}", path.display());
    Ok(())
}
