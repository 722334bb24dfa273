//! The sky in the window: read from files beside it, baked, and played over a day.

use std::path::Path;

use clerestory_transport::basis::LightBasis;
use clerestory_transport::emitters::SkyRequest;
use clerestory_transport::sky::{SkyForm, SkySetting, SunPlace, SunSetting};
use eframe::egui::{Context, Panel, ScrollArea, Ui};

use super::App;
use crate::look::sky;
use crate::panels::sky::{NEW_SUN, SkyState, SkyView, sky_ui};
use crate::session::Wake;
use crate::session::aside::Aside;

/// Hours of the day that pass in a second while it plays.
const HOURS_PER_SEC: f64 = 1.0;
/// Longest time between two pictures that the play takes as such, seconds.
const LONGEST_STEP_SECS: f32 = 0.2;
/// Part of the panel of lights that the sky may take.
const MOST_HEIGHT: f32 = 0.62;

/// A sky that was read, and what is odd about it.
type Read = Result<(SkySetting, Vec<String>), String>;

/// What the window knows of the sky and no look holds.
pub(super) struct Daylight {
    wake: Wake,
    reading: Aside<Read>,
    /// Whether what is being read is still wanted.
    is_wanted: bool,
    state: SkyState,
    /// Whether the day played in the frame before.
    was_playing: bool,
}

impl Daylight {
    pub fn new(wake: Wake) -> Daylight {
        let (reading, state) = (Aside::default(), SkyState::default());
        Daylight { wake, reading, is_wanted: false, state, was_playing: false }
    }

    /// Another scene is open.
    pub fn forget(&mut self) {
        (self.is_wanted, self.state, self.was_playing) = (false, SkyState::default(), false);
    }

    /// Has the dome painted again.
    pub fn forget_picture(&mut self) {
        self.state.forget_picture();
    }

    /// Whether the hours pass.
    pub fn is_playing(&self) -> bool {
        self.state.playing.is_some()
    }

    /// Stays at the hour that it is.
    pub fn stop(&mut self) {
        self.state.playing = None;
    }
}

impl App {
    /// The sky below the lights.
    pub(super) fn sky_ui(&mut self, ui: &mut Ui, basis: &LightBasis) {
        if basis.is_measured() {
            return;
        }
        let view = SkyView {
            basis,
            can_bake: self.session.opened.as_ref().is_some_and(|opened| opened.scene.is_some()),
            is_reading: self.daylight.reading.is_busy() && self.daylight.is_wanted,
        };
        let most = MOST_HEIGHT * ui.available_height();
        let frame = eframe::egui::Frame::NONE.inner_margin(eframe::egui::Margin::symmetric(0, 4));
        Panel::bottom("sky").frame(frame).show(ui, |ui| {
            ScrollArea::vertical()
                .id_salt("sky")
                .max_height(most)
                .min_scrolled_height(most)
                .auto_shrink([false, true])
                .show(ui, |ui| {
                    sky_ui(ui, &view, &mut self.look.lights, &mut self.daylight.state, &mut self.actions);
                });
        });
    }

    /// Lights the scene by a map, once it is read; turn and intensity stay.
    pub(super) fn use_sky(&mut self, path: &Path) {
        if self.daylight.reading.is_busy() {
            self.complain("another sky is being read; wait for it");
            return;
        }
        let path = std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
        self.say(format!("Reading {}", path.display()));
        self.daylight.is_wanted = true;
        let read = move || read_sky(&path);
        let started = self.daylight.reading.start("read sky", &self.daylight.wake, read);
        if let Err(words) = started {
            self.complain(words);
        }
    }

    fn take_sky(&mut self, read: Read) {
        match read {
            Ok((mut sky, odd)) => {
                let before = self.look.lights.sky.take().unwrap_or_default();
                (sky.rotation_deg, sky.intensity) = (before.rotation_deg, before.intensity);
                self.look.lights.sky = Some(before).filter(|before| *before != SkySetting::default());
                self.say(format!("Sky {}", sky.name()));
                self.as_one_step(|app| app.look.lights.sky = Some(sky));
                if !odd.is_empty() {
                    self.complain(odd.join(", "));
                }
            }
            Err(words) => self.complain(words),
        }
    }

    /// Prepares and bakes the scene anew under the sky as it is set; a scene without any gets sun and clear sky.
    pub(super) fn bake_with_sky(&mut self, divisions: u32) {
        let Some(basis) = self.session.basis().cloned() else { return };
        if basis.sky_light(&self.look.lights).is_none() {
            let turned = self.look.lights.sky.clone().unwrap_or_default();
            let wanted = SkySetting { sun: Some(NEW_SUN), ..turned };
            match sky::remade(&SkySetting::default(), wanted) {
                Ok(sky) => self.as_one_step(|app| app.look.lights.sky = Some(sky)),
                Err(error) => return self.complain(error.to_string()),
            }
        }
        if let Some(light) = basis.sky_light(&self.look.lights) {
            self.say("Baking the scene under its sky");
            self.session.choose_sky(SkyRequest { light, form: SkyForm::Patches(divisions) });
        }
    }

    /// Takes in a sky that was read, and lets the hours pass.
    pub(super) fn advance_daylight(&mut self, ctx: &Context) {
        if let Some(read) = self.daylight.reading.take()
            && std::mem::take(&mut self.daylight.is_wanted)
        {
            self.take_sky(read.and_then(|read| read));
        }
        if self.daylight.is_playing() != self.daylight.was_playing {
            // From the first picture to the last it is one step.
            self.daylight.was_playing = self.daylight.is_playing();
            self.undoer.add_undo(&self.look);
        }
        let Some(hour) = &mut self.daylight.state.playing else { return };
        *hour += HOURS_PER_SEC * f64::from(ctx.input(|input| input.stable_dt).min(LONGEST_STEP_SECS));
        let hour = *hour;
        match self.look.lights.sky.as_ref().and_then(|sky| at_hour(sky, hour)) {
            Some(sky) => {
                self.look.lights.sky = Some(sky);
                ctx.request_repaint();
            }
            None => self.daylight.stop(),
        }
    }
}

/// The sky at an hour of its day, to the minute; `None` where its sun does not stand by time.
fn at_hour(sky: &SkySetting, hour: f64) -> Option<SkySetting> {
    let sun = sky.sun?;
    let SunPlace::Time { mut time, north_deg } = sun.place else { return None };
    time.hour = (60.0 * hour).round().rem_euclid(24.0 * 60.0) / 60.0;
    let sun = SunSetting { place: SunPlace::Time { time, north_deg }, ..sun };
    sky::remade(sky, SkySetting { sun: Some(sun), ..sky.clone() }).ok()
}

/// Reads a map, and makes of it what relighting needs.
fn read_sky(path: &Path) -> Read {
    let mut sky = SkySetting { file: Some(path.display().to_string()), ..SkySetting::default() };
    let odd = sky::load(&mut sky, Path::new("")).map_err(|error| format!("{error:#}"))?;
    // What is made of a map once is kept with it; of a large one that takes a while.
    sky.map.iter().for_each(|map| {
        map.level_irradiance();
    });
    Ok((sky, odd))
}
