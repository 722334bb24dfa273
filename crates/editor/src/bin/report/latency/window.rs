//! The window as it is, in the hands of a program.

use std::path::Path;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use clerestory::app::{App, Start};
use clerestory::platform;
use clerestory::session::{Source, Stage};
use eframe::egui::accesskit::{self, Role};
use eframe::egui::{self, Event, PointerButton, Pos2, RawInput, Rect, pos2, vec2};

use super::painter::Painter;

/// Seconds for opening the file and for each picture, after which something is wrong.
const PATIENCE: Duration = Duration::from_secs(120);
/// Pixels of the window.
const SIZE: [u32; 2] = [1440, 900];

/// The editor without a window around it.
pub(super) struct Window {
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
    /// Draws on a device, where that relights.
    painter: Option<Painter>,
}

/// What a drag took.
pub(super) struct Drag {
    /// Seconds from each event to its picture.
    pub whole: Vec<f64>,
    /// Seconds of each frame on the way.
    pub frames: Vec<f64>,
    /// CPU seconds of the window's thread for each picture; none where the system does not tell.
    pub work: Vec<f64>,
}

impl Window {
    /// Opens a bake, to be relit on the CPU or by the painter's device.
    pub fn open(path: &Path, painter: Option<Painter>) -> Result<Window> {
        let ctx = egui::Context::default();
        let (wake, woken) = channel();
        ctx.set_request_repaint_callback(move |info| {
            // Nobody listens any more once the window is gone.
            let _ = wake.send(Instant::now() + info.delay.min(PATIENCE));
        });
        let mut creation = eframe::CreationContext::_new_kittest(ctx.clone());
        creation.wgpu_render_state = painter.as_ref().map(|painter| painter.state.clone());
        let app = App::new(&creation, Start::alone(Source::File(path.to_path_buf()), None))?;
        let frame = eframe::Frame::_new_kittest();
        let (due, begun) = (Instant::now(), Instant::now());
        let mut window = Window { ctx, app, frame, woken, due, begun, slider: Rect::NOTHING, painter };
        window.draw_until(Vec::new(), |app| app.n_pictures() > 0 && app.is_settled())?;
        // A device of hardware relights from the start.
        let asks =
            |window: &mut Window| window.painter.is_some() && window.find(Role::Button, "Relight: CPU").is_some();
        if asks(&mut window) {
            window.click(Role::Button, "Relight: CPU")?;
            window.click(Role::RadioButton, "Graphics device")?;
            window.draw_until(Vec::new(), App::is_settled)?;
            if asks(&mut window) {
                bail!("the device does not relight");
            }
        }
        window.slider = window.find(Role::Slider, " intensity").context("no lamp has a slider")?;
        Ok(window)
    }

    /// The first part of the window of such a role whose name has some words in it.
    fn find(&mut self, role: Role, words: &str) -> Option<Rect> {
        self.ctx.enable_accesskit();
        let output = self.draw(Vec::new());
        self.ctx.disable_accesskit();
        let nodes = output.platform_output.accesskit_update?.nodes;
        let is_it =
            |node: &accesskit::Node| node.role() == role && node.label().is_some_and(|name| name.contains(words));
        let bounds = nodes.iter().find(|(_, node)| is_it(node)).and_then(|(_, node)| node.bounds())?;
        let at = |x: f64, y: f64| pos2(x as f32, y as f32);
        Some(Rect::from_min_max(at(bounds.x0, bounds.y0), at(bounds.x1, bounds.y1)))
    }

    fn click(&mut self, role: Role, words: &str) -> Result<()> {
        let at = self.find(role, words).with_context(|| format!("nothing is called {words}"))?.center();
        for events in [vec![Event::PointerMoved(at)], vec![button(at, true)], vec![button(at, false)], Vec::new()] {
            self.draw(events);
        }
        Ok(())
    }

    /// One frame, from its events to the triangles of the interface.
    fn draw(&mut self, events: Vec<Event>) -> egui::FullOutput {
        let screen_rect = Some(Rect::from_min_size(Pos2::ZERO, vec2(SIZE[0] as f32, SIZE[1] as f32)));
        let time = Some(self.begun.elapsed().as_secs_f64());
        let input = RawInput { screen_rect, time, events, focused: true, ..RawInput::default() };
        let (app, frame) = (&mut self.app, &mut self.frame);
        let mut output = self.ctx.run_ui(input, |ui| {
            let ctx = ui.ctx().clone();
            eframe::App::logic(app, &ctx, frame);
            eframe::App::ui(app, ui, frame);
        });
        let shapes = std::mem::take(&mut output.shapes);
        let triangles = self.ctx.tessellate(shapes, output.pixels_per_point);
        if let Some(painter) = &self.painter {
            painter.paint(&triangles, &output.textures_delta, SIZE);
        }
        std::hint::black_box(triangles);
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

    /// Drags the slider.
    pub fn drag(&mut self, n_events: usize) -> Result<Drag> {
        let at = |share: f32| self.slider.left_center() + vec2((0.1 + 0.8 * share) * self.slider.width(), 0.0);
        let places: Vec<Pos2> = (0..n_events).map(|i| at(0.5 - 0.5 * (0.4 * i as f32).cos())).collect();
        self.draw_until(vec![Event::PointerMoved(places[0]), button(places[0], true)], App::is_answered)?;
        let (mut whole, mut frames) = (Vec::new(), Vec::new());
        let mut work = Vec::new();
        for place in &places[1..] {
            let (n_before, before) = (self.app.n_pictures(), self.app.look().clone());
            let (worked_before, start) = (worked(), Instant::now());
            let drawn = self.draw_until(vec![Event::PointerMoved(*place)], |app| {
                (app.n_pictures() > n_before && app.is_answered()) || *app.look() == before
            })?;
            if *self.app.look() != before {
                whole.push(start.elapsed().as_secs_f64());
                frames.extend(drawn);
                work.extend(worked_before.zip(worked()).map(|(before, now)| (now - before).as_secs_f64()));
            }
            // What the device still does is no part of the next event.
            self.painter.iter().try_for_each(|painter| painter.gpu().wait())?;
        }
        if whole.len() < n_events / 2 {
            bail!("the slider moved {} times under {n_events} events", whole.len());
        }
        Ok(Drag { whole, frames, work })
    }
}

/// What this thread has worked. The system counts it up when a thread rests.
fn worked() -> Option<Duration> {
    std::thread::sleep(Duration::from_micros(100));
    platform::thread_times().map(|times| times.ran)
}

fn button(pos: Pos2, pressed: bool) -> Event {
    Event::PointerButton { pos, button: PointerButton::Primary, pressed, modifiers: egui::Modifiers::default() }
}
