//! What holds the window's content: where a window loses its graphics device, the next one goes on with everything that was open.
//!
//! A window whose device is gone cannot draw any more, and its host cannot give it another. So it is closed, and a new one is opened
//! with the same content: looks, bakes under way and the way back stay as they are, and only pictures on the device are made again.

use std::cell::RefCell;
use std::fmt::{self, Display, Formatter};
use std::rc::Rc;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, anyhow};
use eframe::egui::{self, Context, Ui, ViewportCommand};
use eframe::{CreationContext, NativeOptions, Storage, wgpu};

use super::{App, Start};
use crate::platform;

/// For soaks: the device is lost every so many seconds.
const LOSS_VARIABLE: &str = "CLERESTORY_LOSE_DEVICE";
/// So many losses within [`TOO_SOON`] are a driver that does not work.
const MAX_LOSSES: usize = 5;
const TOO_SOON: Duration = Duration::from_secs(60);
/// Until a window that was not on the screen yet is looked at again.
const SOON: Duration = Duration::from_millis(100);

/// The window was there, and cannot go on.
#[derive(Debug)]
pub struct WindowLost;

impl Display for WindowLost {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(
            "the window lost its graphics device: update the driver, or start again with another one \
             (VK_ICD_FILENAMES); lights that were not saved are offered at the next start",
        )
    }
}

/// What a window whose device was lost leaves to the next one.
type Left = Rc<RefCell<Option<(App, Context)>>>;

/// Opens one window after the other, until one is closed that has its device.
///
/// # Errors
/// If there is no display or no graphics driver; [`WindowLost`] if there was a window, but its device is lost again and again.
pub(super) fn run_windows(options: impl Fn() -> NativeOptions, start: Start) -> Result<()> {
    let every = loss_every(std::env::var(LOSS_VARIABLE).ok())?;
    platform::return_freed_memory();
    let left = Left::default();
    let (mut start, mut lost_at) = (Some(start), Vec::new());
    loop {
        let (app, ctx) = left.take().unzip();
        let (next, started) = (left.clone(), start.take());
        let create: eframe::AppCreator<'_> = Box::new(move |cc| {
            let app = match (app, started) {
                (Some(app), _) => app.moved_to(cc),
                (None, Some(start)) => App::new(cc, start)?,
                (None, None) => Err("a window leaves its content to the next one")?,
            };
            Ok(Box::new(Host::new(app, cc, every, next)))
        });
        let result = eframe::run_native_ext("clerestory", options(), ctx, create).map_err(|error| anyhow!("{error}"));
        if lost_at.is_empty() {
            result?
        } else {
            result.context(WindowLost)?
        }
        if left.borrow().is_none() {
            return Ok(());
        }
        lost_at.push(Instant::now());
        if is_hopeless(&lost_at) {
            return Err(anyhow!("that was the {}th time within a minute", MAX_LOSSES).context(WindowLost));
        }
    }
}

/// Whether the last losses came too soon after each other.
fn is_hopeless(lost_at: &[Instant]) -> bool {
    lost_at.len().checked_sub(MAX_LOSSES).is_some_and(|first| lost_at[first].elapsed() < TOO_SOON)
}

fn loss_every(variable: Option<String>) -> Result<Option<Duration>> {
    let Some(text) = variable.filter(|text| !text.is_empty()) else { return Ok(None) };
    let secs = text.parse().ok().filter(|secs: &f64| *secs > 0.0);
    let every = secs.and_then(|secs| Duration::try_from_secs_f64(secs).ok());
    every.map(Some).with_context(|| format!("{LOSS_VARIABLE} is `{text}`; write a number of seconds"))
}

/// The content of one window.
struct Host {
    /// None once it was left to the next window.
    app: Option<App>,
    device: Option<wgpu::Device>,
    /// When the device is lost on purpose.
    lose_at: Option<Instant>,
    ctx: Context,
    /// Whether the window is still to get the keyboard.
    wants_keyboard: bool,
    is_leaving: bool,
    left: Left,
}

impl Host {
    fn new(app: App, cc: &CreationContext<'_>, every: Option<Duration>, left: Left) -> Host {
        let device = cc.wgpu_render_state.as_ref().map(|state| state.device.clone());
        let lose_at = every.map(|every| Instant::now() + every);
        Host {
            app: Some(app),
            device,
            lose_at,
            ctx: cc.egui_ctx.clone(),
            wants_keyboard: true,
            is_leaving: false,
            left,
        }
    }

    /// Takes the keyboard, at first and with each press, where no window manager gives it.
    fn take_keyboard(&mut self, ctx: &Context, frame: &eframe::Frame) {
        let (has_it, is_pressed) = ctx.input(|input| (input.focused, input.pointer.any_pressed()));
        self.wants_keyboard = !has_it && (self.wants_keyboard || is_pressed);
        if !self.wants_keyboard {
            return;
        }
        match platform::give_keyboard(frame) {
            Some(false) => ctx.request_repaint_after(SOON),
            Some(true) | None => self.wants_keyboard = false,
        }
    }

    fn lose_as_asked(&mut self, ctx: &Context) {
        let Some(at) = self.lose_at else { return };
        match at.checked_duration_since(Instant::now()) {
            Some(soon) => ctx.request_repaint_after(soon),
            None => {
                self.device.iter().for_each(wgpu::Device::destroy);
                self.lose_at = None;
            }
        }
    }
}

impl eframe::App for Host {
    fn logic(&mut self, ctx: &Context, frame: &mut eframe::Frame) {
        self.lose_as_asked(ctx);
        self.take_keyboard(ctx, frame);
        let Some(app) = &mut self.app else { return };
        if !self.is_leaving && app.follower.is_device_lost() {
            self.is_leaving = true;
            app.device_was_lost();
            ctx.send_viewport_cmd(ViewportCommand::Close);
        }
        // What is closed now is no window that a person closes, so nothing is asked.
        if !self.is_leaving {
            app.logic(ctx, frame);
        }
    }

    fn ui(&mut self, ui: &mut Ui, frame: &mut eframe::Frame) {
        if let Some(app) = self.app.as_mut().filter(|_| !self.is_leaving) {
            app.ui(ui, frame);
        }
    }

    fn save(&mut self, storage: &mut dyn Storage) {
        self.app.iter_mut().for_each(|app| app.save(storage));
    }

    fn clear_color(&self, visuals: &egui::Visuals) -> [f32; 4] {
        visuals.panel_fill.to_normalized_gamma_f32()
    }

    fn on_exit(&mut self) {
        if self.is_leaving {
            self.left.replace(self.app.take().map(|app| (app, self.ctx.clone())));
        }
        self.app.iter_mut().for_each(|app| app.on_exit());
    }
}

impl App {
    /// The window is about to be closed for want of a device: what was not saved is kept at once.
    fn device_was_lost(&mut self) {
        self.keep_unsaved_now();
        self.pulse.iter_mut().for_each(|pulse| pulse.say_now("the graphics device was lost"));
    }

    /// Goes on in another window; what was on the device of the last one is made again.
    pub fn moved_to(mut self, cc: &CreationContext<'_>) -> App {
        let ctx = &cc.egui_ctx;
        // Letters and textures that were kept for the last window are not in this one.
        ctx.set_glyph_rasterizers(Vec::new());
        ctx.memory_mut(|memory| memory.caches = egui::cache::CacheStorage::default());
        self.follower.move_to(cc.wgpu_render_state.as_ref());
        self.prints.forget();
        self.camera.forget_picture();
        self.daylight.forget_picture();
        self.heat.forget();
        self.title.clear();
        self.pulse.iter_mut().for_each(|pulse| pulse.say_now("another window goes on"));
        self.say("The graphics device was lost; this window goes on with another one");
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_losses_that_follow_each_other_at_once_end_the_program() {
        let now = Instant::now();
        let old = now - TOO_SOON - Duration::from_secs(1);
        assert!(!is_hopeless(&[]));
        assert!(!is_hopeless(&[now; MAX_LOSSES - 1]));
        assert!(is_hopeless(&[now; MAX_LOSSES]));
        assert!(!is_hopeless(&[old, now, now, now, now]) && is_hopeless(&[old, now, now, now, now, now]));
    }

    #[test]
    fn losses_are_asked_for_in_seconds() {
        assert_eq!(loss_every(None).unwrap(), None);
        assert_eq!(loss_every(Some(String::new())).unwrap(), None);
        assert_eq!(loss_every(Some("1.5".into())).unwrap(), Some(Duration::from_millis(1500)));
        for bad in ["0", "-1", "often", "nan", "1e300"] {
            assert!(loss_every(Some(bad.into())).unwrap_err().to_string().contains(LOSS_VARIABLE), "{bad}");
        }
    }
}
