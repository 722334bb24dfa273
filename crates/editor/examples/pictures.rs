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
use eframe::egui::{Key, Pos2, pos2, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder};

const FILM: Film = Film { width: 640, height: 360 };
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
    let config = BakeConfig { spp, indirect: Indirect::Shared, ..BakeConfig::default() };
    let settings = BakeSettings { camera_idx: 0, film: FILM, config, illuminance: false, work_plane: None };
    println!("baking the built-in scene with {spp} samples per pixel, which takes minutes");
    let start = Start::alone(Source::BuiltIn, Some(settings));
    let mut window: Window = Harness::builder()
        .with_size(vec2(1440.0, 900.0))
        .build_eframe(|cc| App::new(cc, start).expect("the system gives threads"));
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled())?;

    click(&mut window, "Keep look")?;
    click(&mut window, "Presets")?;
    click(&mut window, "All four")?;
    click(&mut window, "Look Look")?;
    rest(&mut window)?;
    shoot(&mut window, &folder.join("editor.jpg"))?;

    let middle = window.get_by_label("Picture").rect().center() + vec2(60.0, 40.0);
    click_at(&mut window, middle);
    rest(&mut window)?;
    shoot(&mut window, &folder.join("light-here.jpg"))?;
    window.key_press(Key::Escape);

    click(&mut window, "Look Dusk")?;
    click(&mut window, "Board")?;
    rest(&mut window)?;
    shoot(&mut window, &folder.join("board.jpg"))?;

    click(&mut window, "List")?;
    click(&mut window, "Look Look")?;
    click(&mut window, "Compare")?;
    rest(&mut window)?;
    shoot(&mut window, &folder.join("compare.jpg"))
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
