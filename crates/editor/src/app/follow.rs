//! Keeps the picture in step with look and matrix: asks for a new one whenever either changed, shows the newest.

mod device;

use std::collections::BTreeSet;
use std::sync::Arc;

use anyhow::Result;
use clerestory_relight::{DisplayParams, Frame, Radiance};
use clerestory_transport::light::LightRig;
use eframe::egui::{Context, TextureHandle, TextureId, TextureOptions};
use eframe::egui_wgpu::RenderState;

use super::lamplight::Lamplight;
use super::rest::Rest;
use super::sky::SkyLayer;
use crate::legend::Legend;
use crate::look::{Display, Look, Quantity, Units};
use crate::panels::lights::heard;
use crate::picture::{Changed, DeviceWish, GpuPainter};
use crate::session::lamps::LampLight;
use crate::session::worker::{Order, Relit, Wanted, Worker};
use crate::session::{Session, Shown, Wake};

/// What the last picture was asked for.
#[derive(Clone, Debug, PartialEq)]
struct Asked {
    rig: LightRig,
    display: Display,
    /// The light of free lamps, by its order and address.
    layer: Option<(u64, usize)>,
    /// Number of the sky that is seen.
    sky: u64,
}

/// How long lights rest before the exposure is metered again, seconds.
const HOLD_SECS: f64 = 0.6;

/// An exposure that stays as it is.
#[derive(Clone, Copy)]
struct Hold {
    ev: f32,
    /// When it ends, unless something is dragged still; seconds of the window.
    until: f64,
}

/// Asks for pictures and keeps the newest.
pub(super) struct Follower {
    worker: Worker,
    gpu: Option<GpuPainter>,
    wish: DeviceWish,
    /// Lasts while the graphics device has failed and the CPU does its work.
    rest: Rest,
    /// It works again, and nobody was told yet.
    is_back: bool,
    /// The worker metered another exposure or scale than the graphics device shows.
    metering_moved: bool,
    asked: Option<Asked>,
    sky: SkyLayer,
    lamplight: Lamplight,
    texture: Option<TextureHandle>,
    gpu_picture: Option<(TextureId, [u32; 2])>,
    shown: DisplayParams,
    /// Lasts while lights are set by hand: what they do would be metered away.
    hold: Option<Hold>,
    metered_ev: f32,
    millis: Option<f32>,
    n_pictures: u64,
    n_orders: u64,
    last_answered: u64,
    /// The first order whose picture counts.
    oldest: u64,
}

impl Follower {
    pub fn new(state: Option<&RenderState>, wake: Wake) -> Result<Follower> {
        Ok(Follower {
            worker: Worker::start(wake.clone())?,
            gpu: state.map(GpuPainter::new),
            wish: DeviceWish::Auto,
            rest: Rest::default(),
            is_back: false,
            metering_moved: false,
            asked: None,
            sky: SkyLayer::new(wake.clone())?,
            lamplight: Lamplight::new(wake)?,
            texture: None,
            gpu_picture: None,
            shown: DisplayParams::default(),
            hold: None,
            metered_ev: 0.0,
            millis: None,
            n_pictures: 0,
            n_orders: 0,
            last_answered: 0,
            oldest: 0,
        })
    }

    pub fn n_pictures(&self) -> u64 {
        self.n_pictures
    }

    /// Keeps the exposure that is shown until the lights have rested for a moment.
    pub fn hold_exposure(&mut self, ctx: &Context) {
        let ev = self.hold.map_or(self.shown.exposure_ev, |hold| hold.ev);
        let until = ctx.input(|input| input.time) + HOLD_SECS;
        self.hold = Some(Hold { ev, until }).filter(|_| self.asked.is_some());
    }

    /// Meters at once.
    pub fn release_exposure(&mut self) {
        self.hold = None;
    }

    /// The exposure that is held. The end of a hold that waits for it only is what wakes the window.
    fn held_ev(&mut self, ctx: &Context) -> Option<f32> {
        let hold = self.hold?;
        let (now, is_pressed) = ctx.input(|input| (input.time, input.pointer.any_down()));
        if !is_pressed && now >= hold.until {
            self.hold = None;
        } else if !is_pressed {
            ctx.request_repaint_after(std::time::Duration::from_secs_f64(hold.until - now));
        }
        self.hold.map(|hold| hold.ev)
    }

    /// Whether the last order was answered, the exposure is metered, and lamps that stand still are as smooth as they get.
    pub fn is_idle(&self) -> bool {
        self.is_answered() && self.hold.is_none() && self.lamplight.is_idle() && self.sky.is_idle()
    }

    /// Whether the last order was answered.
    pub fn is_answered(&self) -> bool {
        self.n_orders == self.last_answered
    }

    /// The light of free lamps that is shown.
    pub fn lamp_light(&self) -> Option<&LampLight> {
        self.lamplight.light()
    }

    /// The same once it gets no smoother, and belongs to the lamps as they are.
    pub fn final_lamp_light(&self) -> Option<&LampLight> {
        self.lamplight.light().filter(|_| self.lamplight.is_idle())
    }

    /// Whether it is known what the free lamps of a lighting bring.
    pub fn knows_lamps(&self, rig: &LightRig) -> bool {
        self.lamplight.is_known(rig)
    }

    /// Has the light of free lamps traced anew: a file that one of them names is another one.
    pub fn read_lamps_again(&mut self) {
        self.lamplight.forget_view();
    }

    /// The lighting that is shown.
    pub fn rig(&self) -> Option<&LightRig> {
        self.asked.as_ref().map(|asked| &asked.rig)
    }

    /// The light of free lamps that is part of the picture of a bake.
    pub fn shown_lamp_light(&self, shown: &Shown) -> Option<&LampLight> {
        self.lamplight.light().filter(|light| is_as_large(light, shown))
    }

    pub fn shown_ev(&self) -> f32 {
        self.shown.exposure_ev
    }

    /// What the colors of the picture mean, where they are false.
    pub fn legend(&self, units: Units) -> Option<Legend> {
        Legend::of(&self.asked.as_ref()?.display, &self.shown, units)
    }

    pub fn metered_ev(&self) -> f32 {
        self.metered_ev
    }

    pub fn millis(&self) -> Option<f32> {
        self.millis
    }

    /// No picture of the last scene is left.
    pub fn forget(&mut self) {
        (self.texture, self.gpu_picture, self.millis) = (None, None, None);
        // One that is under way comes too late.
        self.oldest = self.n_orders + 1;
        // What was too large for the graphics device may not be so any more.
        self.rest = Rest::default();
        self.start_over();
    }

    fn start_over(&mut self) {
        (self.asked, self.hold) = (None, None);
        if let Some(gpu) = &mut self.gpu {
            gpu.forget();
        }
    }

    /// The newest picture and its size in pixels.
    pub fn picture(&self) -> Option<(TextureId, [u32; 2])> {
        let of_worker = self.texture.as_ref().map(|t| (t.id(), t.size().map(|side| side as u32)));
        if self.uses_gpu() { self.gpu_picture.or(of_worker) } else { of_worker }
    }

    /// Takes the newest picture in and asks for another if something changed. Fails with words for people.
    pub fn follow(
        &mut self,
        ctx: &Context,
        session: &mut Session,
        look: &Look,
        solo: &BTreeSet<String>,
    ) -> Result<(), String> {
        let mut problem = match self.worker.take() {
            Some(Ok(relit)) => {
                self.show(ctx, relit, look);
                None
            }
            Some(Err(words)) => Some(words),
            None => None,
        };
        let changed = session.take_changed();
        let held_ev = self.held_ev(ctx);
        // Before the first block there is nothing to see.
        let has_blocks = |shown: &&Shown| shown.frame.groups.iter().any(|g| g.blocks.iter().any(Option::is_some));
        if let Some(shown) = session.shown.as_ref().filter(has_blocks) {
            let rig = self.lamplight.follow(
                session,
                &heard(&shown.header.basis, &look.lights, solo),
                look.display.quantity(),
                self.gpu.as_ref().filter(|_| self.uses_gpu()).map(GpuPainter::gpu),
            );
            let light = self.shown_lamp_light(shown).cloned();
            let layer = light.as_ref().map(|light| (light.serial, Arc::as_ptr(&light.direct).addr()));
            let sky = self.sky.follow(shown, &rig).unwrap_or_else(|words| {
                problem = Some(words);
                u64::MAX
            });
            let asked = Asked { rig, display: showable(shown, look, held_ev), layer, sky };
            let gpu = self.gpu.as_ref().filter(|_| self.uses_gpu());
            // What a lost device was last asked for never comes, so it is asked for again, and fails.
            let gpu_waits = gpu.is_some_and(|gpu| gpu.has_waiting() || gpu.is_lost());
            let gpu_waits = std::mem::take(&mut self.metering_moved) || gpu_waits;
            if !changed.is_empty() || gpu_waits || self.asked.as_ref() != Some(&asked) {
                // Light that is seen and light that arrives are two matrices.
                let is_other = self.asked.as_ref().is_none_or(|old| old.irradiance(shown) != asked.irradiance(shown));
                let changed = if is_other { Changed::All } else { changed };
                let (frame, coefficients, layer) = match asked.irradiance(shown) {
                    Some(set) => (
                        Arc::new(shown.irradiance_frame(set)),
                        shown.irradiance_coefficients(set, &asked.rig, light.as_ref()),
                        light.and_then(|light| light.arriving),
                    ),
                    None => {
                        let mut coefficients = shown.coefficients(&asked.rig, light.as_ref());
                        let layer = self.sky.layer(shown, &mut coefficients, light.map(|light| light.direct));
                        (shown.frame.clone(), coefficients, layer)
                    }
                };
                problem = self.ask(ctx, frame, (&coefficients, layer.as_ref()), changed, &asked).err().or(problem);
                self.asked = Some(asked);
            }
        }
        problem.map_or(Ok(()), Err)
    }

    /// Has a picture made. Fails with words for people if the graphics device did, and still has it made.
    fn ask(
        &mut self,
        ctx: &Context,
        frame: Arc<Frame>,
        (coefficients, layer): (&[Vec<[f32; 3]>], Option<&Arc<Radiance>>),
        changed: Changed,
        asked: &Asked,
    ) -> Result<(), String> {
        let (mut wanted, mut failed) = (Wanted::Picture, Ok(()));
        let now = ctx.input(|input| input.time);
        self.rest.try_again(now);
        if self.uses_gpu() {
            match self.paint(ctx, &frame, changed.clone(), (coefficients, layer), asked) {
                Ok(()) => {
                    self.is_back |= self.rest != Rest::default();
                    (wanted, self.rest) = (Wanted::Metering, Rest::default());
                }
                Err(error) => {
                    self.rest.begin(now);
                    (self.gpu_picture, self.is_back) = (None, false);
                    self.gpu.iter_mut().for_each(GpuPainter::forget);
                    failed = Err(format!("The CPU goes on: {error}"));
                }
            }
        }
        // With all of it fixed there is nothing to meter while the graphics device paints.
        if wanted == Wanted::Picture || asked.display.meters() || !changed.is_empty() {
            let (coefficients, layer) = (coefficients.to_vec(), layer.cloned());
            self.n_orders += 1;
            let (display, serial) = (asked.display, self.n_orders);
            self.worker.order(Order { frame, changed, coefficients, layer, display, wanted, serial });
        }
        failed
    }

    fn paint(
        &mut self,
        ctx: &Context,
        frame: &Frame,
        changed: Changed,
        light: (&[Vec<[f32; 3]>], Option<&Arc<Radiance>>),
        asked: &Asked,
    ) -> Result<(), clerestory_relight::RelightError> {
        let Some(gpu) = &mut self.gpu else { return Ok(()) };
        let started = std::time::Instant::now();
        let display = asked.display.as_metered(&self.shown);
        let now = ctx.input(|input| input.time);
        let texture = gpu.show(frame, changed, light, &display, now)?;
        self.gpu_picture = Some((texture, [frame.width, frame.height]));
        if gpu.has_waiting() {
            ctx.request_repaint_after(std::time::Duration::from_millis(450));
        }
        self.shown = display;
        self.millis = Some(1e3 * started.elapsed().as_secs_f32());
        self.n_pictures += 1;
        Ok(())
    }

    fn show(&mut self, ctx: &Context, relit: Relit, look: &Look) {
        self.last_answered = relit.serial;
        if relit.serial < self.oldest {
            return;
        }
        let mut display = relit.display;
        if look.display.quantity() == Some(Quantity::Illuminance) {
            // The light that arrives says nothing about the exposure of the light that is seen.
            display.exposure_ev = self.shown.exposure_ev;
        }
        if look.display.exposure_ev.is_none() {
            self.metered_ev = display.exposure_ev;
        }
        match (relit.image, &mut self.texture) {
            (Some(image), Some(texture)) if texture.size() == image.size => texture.set(image, TextureOptions::LINEAR),
            (Some(image), slot) => *slot = Some(ctx.load_texture("picture", image, TextureOptions::LINEAR)),
            // The metering came from here, the picture is made elsewhere: paint it again if that moved.
            (None, _) => {
                if look.display.meters() && has_moved(&display, &self.shown) {
                    self.shown.exposure_ev = display.exposure_ev;
                    self.shown.false_color = display.false_color;
                    self.metering_moved = true;
                }
                return;
            }
        }
        (self.shown, self.millis) = (display, Some(relit.millis));
        self.n_pictures += 1;
    }
}

impl Asked {
    /// The matrix of irradiance that is shown, if one is.
    fn irradiance(&self, shown: &Shown) -> Option<usize> {
        self.display.quantity().filter(|quantity| *quantity == Quantity::Illuminance).and(shown.pixel_irradiance())
    }
}

/// Whether the light of lamps is that of the picture that is shown.
pub(super) fn is_as_large(light: &LampLight, shown: &Shown) -> bool {
    (light.direct.width, light.direct.height) == (shown.header.width, shown.header.height)
}

/// The display of a look, without the false color of what was not baked, at the exposure that is held where it is metered.
fn showable(shown: &Shown, look: &Look, held_ev: Option<f32>) -> Display {
    let display = if shown.pixel_irradiance().is_some() { look.display } else { look.display.of_seen_light() };
    Display { exposure_ev: display.exposure_ev.or(held_ev), ..display }
}

/// Whether a picture metered anew would be another one.
fn has_moved(new: &DisplayParams, shown: &DisplayParams) -> bool {
    (new.exposure_ev - shown.exposure_ev).abs() > 1e-3 || new.false_color != shown.false_color
}

#[cfg(test)]
mod tests {
    use eframe::egui::{Color32, ColorImage};

    use super::*;

    #[test]
    fn a_picture_of_the_last_scene_that_comes_late_is_not_shown() {
        let mut follower = Follower::new(None, Arc::new(|_| {})).unwrap();
        let (ctx, look) = (Context::default(), Look::default());
        let relit = |serial: u64| {
            let image = Some(Arc::new(ColorImage::filled([4, 3], Color32::RED)));
            Relit { image, display: DisplayParams::default(), millis: 1.0, serial }
        };
        // It was asked for when the next scene was opened.
        follower.n_orders = 1;
        follower.forget();
        follower.show(&ctx, relit(1), &look);
        assert!(follower.picture().is_none() && follower.is_answered());
        follower.n_orders = 2;
        follower.show(&ctx, relit(2), &look);
        assert!(follower.picture().is_some_and(|(_, size)| size == [4, 3]));
    }
}
