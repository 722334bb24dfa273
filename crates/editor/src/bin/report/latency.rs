//! From an event of the pointer to the picture, through the editor as it is, without a window.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use clerestory::app::{App, Start};
use clerestory::headless::GALLERY;
use clerestory::session::{Source, Stage};
use clerestory_relight::synthetic::{Ranks, Recipe};
use clerestory_relight::{DeviceChoice, DisplayParams, Gpu, GpuRelighter};
use clerestory_transport::archive;
use clerestory_transport::bake::{Bake, BakeConfig, BakeJob, Passes};
use clerestory_transport::camera::Film;
use clerestory_transport::emitters::PanelRequest;
use clerestory_transport::import;
use clerestory_transport::prepared::PreparedScene;
use eframe::egui::{self, Event, PointerButton, Pos2, RawInput, Rect, pos2, vec2};

use super::desk::{Desk, load_words};

/// Texels along each side of the panel.
const TEXELS: u32 = 32;
/// Largest rank of a block; they are spread evenly.
const RANK: u32 = 9;
/// Events of one drag.
const EVENTS: [usize; 2] = [60, 400];
/// Seconds for opening the file and for each picture, after which something is wrong.
const PATIENCE: Duration = Duration::from_secs(120);

/// Drags a slider of one lamp and times the pictures.
///
/// # Errors
/// If the scene cannot be prepared, or a picture does not come.
pub fn write(desk: &Desk) -> Result<String> {
    let n_events = desk.choose(EVENTS[0], EVENTS[1]);
    let mut rows = String::new();
    let mut n_lamps = 0;
    for film in [Film { width: 1024, height: 768 }, Film { width: 1920, height: 1080 }] {
        desk.say(&format!("dragging a slider at {}×{}", film.width, film.height));
        let bake = synthetic_bake(film)?;
        n_lamps = bake.header.basis.sources.len() - 1;
        let path = PathBuf::from(desk.file("latency.transport"));
        archive::write(&bake, &path)?;
        let mut window = Window::open(path)?;
        let (whole, frames) = window.drag(n_events)?;
        let size = format!("{}×{}", film.width, film.height);
        rows += &format!("| {size} | event to picture, relit on the CPU | {} |\n", quantiles(whole));
        rows += &format!("| {size} | of that, drawing one frame of the window | {} |\n", quantiles(frames));
        for gpu in Gpu::all_headless(DeviceChoice::Any) {
            let submitted = quantiles(submissions(&gpu, &bake, n_events)?);
            rows += &format!("| {size} | submitting to {} | {submitted} |\n", gpu.description());
        }
    }
    Ok(format!(
        "## Latency\n\n\
         One slider dragged, {n_events} events, each sent when the picture of the one before is there. {n_lamps} lamps and a panel of {TEXELS} × {TEXELS} texels, blocks of\n\
         rank 0 to {RANK} with random factors, so that every block moves and none is left out for being unseen. From the event to the end of the frame that\n\
         draws its picture, triangles of the interface made; milliseconds on {} threads. Where a graphics device relights, drawing a frame and submitting are all\n\
         that the CPU does; submitting to one without hardware also waits for cores that it keeps busy. {}\n\n\
         | size | what | median | 99th percentile |\n|---|---|---|---|\n{rows}",
        rayon::current_num_threads(),
        load_words(),
    ))
}

/// The lights of the gallery over blocks that no scene has.
fn synthetic_bake(film: Film) -> Result<Bake> {
    let scene = import::load_bytes("gallery", GALLERY)?.scene;
    let panel = PanelRequest { node: "ceiling panel".into(), resolution: TEXELS };
    let (scene, _) = PreparedScene::new(scene, &[panel])?;
    let camera = scene.scene.cameras.first().cloned().context("the gallery has no camera")?;
    let config = BakeConfig { spp: 1, tolerance_db: 10.0, ..BakeConfig::default() };
    let tiny = Film { width: 16, height: 16 };
    let scene = Arc::new(scene);
    let job = BakeJob { scene, camera, film: tiny, config, passes: Passes::FinalOnly, irradiance: Vec::new() };
    let baked = job.run(|_| std::ops::ControlFlow::Continue(()))?.context("nobody stopped it")?;
    let mut header = (*baked.header).clone();
    (header.width, header.height) = (film.width, film.height);
    let recipe = Recipe {
        width: film.width,
        height: film.height,
        tile: header.tile,
        n_cols: header.basis.groups.iter().map(|group| group.columns.len() as u32).collect(),
        rank: Ranks::Spread(RANK),
        n_sparse: 0,
        is_positive: true,
        ..Recipe::default()
    };
    Ok(Bake { header: Arc::new(header), groups: recipe.frame().groups, irradiance: Vec::new(), packed: None })
}

/// Seconds of the CPU until a device has its commands.
fn submissions(gpu: &Gpu, bake: &Bake, n_events: usize) -> Result<Vec<f64>> {
    let film = Film { width: bake.header.width, height: bake.header.height };
    let frame = clerestory_relight::Frame { width: film.width, height: film.height, groups: bake.groups.clone() };
    let mut relighter = GpuRelighter::new(gpu, &frame)?;
    let mut rig = clerestory_transport::light::LightRig::default();
    let key = bake.header.basis.sources[0].key.clone();
    let mut secs = Vec::new();
    for turn in 0..n_events {
        rig.lights.entry(key.clone()).or_default().intensity = 1.0 + turn as f32 / n_events as f32;
        let start = Instant::now();
        relighter.relight_to_texture(&bake.header.coefficients(&rig), &DisplayParams::default())?;
        secs.push(start.elapsed().as_secs_f64());
        gpu.wait()?;
    }
    Ok(secs)
}

/// Median and 99th percentile in milliseconds, as two cells.
fn quantiles(mut secs: Vec<f64>) -> String {
    secs.sort_by(f64::total_cmp);
    let at = |share: f64| 1e3 * secs[((secs.len() - 1) as f64 * share).round() as usize];
    format!("{:.1} | {:.1}", at(0.5), at(0.99))
}

/// The editor without a window around it.
struct Window {
    ctx: egui::Context,
    app: App,
    frame: eframe::Frame,
    /// When somebody wants another frame.
    woken: Receiver<Instant>,
    /// When the last frame wanted another one; who asks again for that moment is not heard.
    due: Instant,
    begun: Instant,
    /// Where the slider of the first lamp is.
    slider: Rect,
}

impl Window {
    fn open(path: PathBuf) -> Result<Window> {
        let ctx = egui::Context::default();
        let (wake, woken) = channel();
        ctx.set_request_repaint_callback(move |info| {
            // Nobody listens any more once the window is gone.
            let _ = wake.send(Instant::now() + info.delay.min(PATIENCE));
        });
        ctx.enable_accesskit();
        let creation = eframe::CreationContext::_new_kittest(ctx.clone());
        let app = App::new(&creation, Start::alone(Source::File(path), None))?;
        let frame = eframe::Frame::_new_kittest();
        let mut window =
            Window { ctx, app, frame, woken, due: Instant::now(), begun: Instant::now(), slider: Rect::NOTHING };
        window.draw_until(Vec::new(), |app| app.n_pictures() > 0 && app.is_settled())?;
        let output = window.draw(Vec::new());
        let nodes = output.platform_output.accesskit_update.context("the window has no names for its parts")?.nodes;
        let is_slider = |node: &egui::accesskit::Node| {
            node.role() == egui::accesskit::Role::Slider
                && node.label().is_some_and(|name| name.ends_with(" intensity"))
        };
        let found = nodes.iter().find(|(_, node)| is_slider(node)).and_then(|(_, node)| node.bounds());
        let bounds = found.context("no lamp has a slider")?;
        let at = |x: f64, y: f64| pos2(x as f32, y as f32);
        window.slider = Rect::from_min_max(at(bounds.x0, bounds.y0), at(bounds.x1, bounds.y1));
        window.ctx.disable_accesskit();
        Ok(window)
    }

    /// One frame, from its events to the triangles of the interface.
    fn draw(&mut self, events: Vec<Event>) -> egui::FullOutput {
        let screen_rect = Some(Rect::from_min_size(Pos2::ZERO, vec2(1440.0, 900.0)));
        let time = Some(self.begun.elapsed().as_secs_f64());
        let input = RawInput { screen_rect, time, events, focused: true, ..RawInput::default() };
        let (app, frame) = (&mut self.app, &mut self.frame);
        let mut output = self.ctx.run_ui(input, |ui| {
            let ctx = ui.ctx().clone();
            eframe::App::logic(app, &ctx, frame);
            eframe::App::ui(app, ui, frame);
        });
        let shapes = std::mem::take(&mut output.shapes);
        std::hint::black_box(self.ctx.tessellate(shapes, output.pixels_per_point));
        let wanted = output.viewport_output.values().map(|viewport| viewport.repaint_delay).min();
        self.due = Instant::now() + wanted.unwrap_or(PATIENCE).min(PATIENCE);
        output
    }

    /// Draws whenever somebody asks for it until something is so; the seconds of each frame.
    fn draw_until(&mut self, mut events: Vec<Event>, until: impl Fn(&App) -> bool) -> Result<Vec<f64>> {
        let begun = Instant::now();
        let mut frames = Vec::new();
        loop {
            let start = Instant::now();
            self.draw(std::mem::take(&mut events));
            frames.push(start.elapsed().as_secs_f64());
            if until(&self.app) {
                return Ok(frames);
            }
            if let Stage::Failed(name, why) = &self.app.session().stage {
                bail!("{name} could not be opened: {why}");
            }
            if begun.elapsed() > PATIENCE {
                bail!("no picture came");
            }
            self.sleep();
        }
    }

    /// Waits until the soonest frame that anybody wants is due: the last frame itself, or somebody since.
    fn sleep(&self) {
        let mut due = self.due;
        while let Ok(wanted) = self.woken.recv_timeout(due.saturating_duration_since(Instant::now())) {
            due = due.min(wanted);
        }
    }

    /// Seconds from each event to its picture, and of each frame on the way.
    fn drag(&mut self, n_events: usize) -> Result<(Vec<f64>, Vec<f64>)> {
        let at = |share: f32| self.slider.left_center() + vec2((0.1 + 0.8 * share) * self.slider.width(), 0.0);
        let places: Vec<Pos2> = (0..n_events).map(|i| at(0.5 - 0.5 * (0.4 * i as f32).cos())).collect();
        let press = Event::PointerButton {
            pos: places[0],
            button: PointerButton::Primary,
            pressed: true,
            modifiers: egui::Modifiers::default(),
        };
        self.draw_until(vec![Event::PointerMoved(places[0]), press], App::is_answered)?;
        let (mut whole, mut frames) = (Vec::new(), Vec::new());
        for place in &places[1..] {
            let (n_before, before) = (self.app.n_pictures(), self.app.look().clone());
            let start = Instant::now();
            let drawn = self.draw_until(vec![Event::PointerMoved(*place)], |app| {
                (app.n_pictures() > n_before && app.is_answered()) || *app.look() == before
            })?;
            if *self.app.look() != before {
                whole.push(start.elapsed().as_secs_f64());
                frames.extend(drawn);
            }
        }
        if whole.len() < n_events / 2 {
            bail!("the slider moved {} times under {n_events} events", whole.len());
        }
        Ok((whole, frames))
    }
}
