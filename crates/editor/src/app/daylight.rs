//! The sky in the window: read from files and made beside it, baked, and played over a day.

use std::path::{Path, PathBuf};

use clerestory_transport::bake::BakeHeader;
use clerestory_transport::basis::{LightBasis, LightSource, SourceKind};
use clerestory_transport::sky::{SkySetting, SunPlace, SunSetting};
use eframe::egui::{Context, Id, Panel, ScrollArea, Ui, UiBuilder};

use super::App;
use crate::look::{Look, sky};
use crate::panels::sight::keep_in_sight;
use crate::panels::sky::{NEW_SUN, SkyState, SkyView, sky_ui};
use crate::session::Wake;
use crate::session::aside::Aside;
use crate::words::in_words;

/// Hours of the day that pass in a second while it plays.
const HOURS_PER_SEC: f64 = 1.0;
/// Longest time between two pictures that the play takes as such, seconds.
const LONGEST_STEP_SECS: f32 = 0.2;
/// Part of the panel of lights that the sky may take.
const MOST_HEIGHT: f32 = 0.62;
/// Points of it that the lights keep for their titles and a few rows, and that the sky has for its own title at least.
const LIGHTS_LEAST: f32 = 260.0;
const SKY_LEAST: f32 = 60.0;

/// A sky that was read, and what is odd about it.
type Read = Result<(SkySetting, Vec<String>), String>;

/// What a sky is read for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Purpose {
    /// It is wanted no more.
    #[default]
    Nothing,
    /// To light the scene.
    NewSky,
    /// To show what the file of the sky holds by now.
    NewMap,
}

/// A sky that was made.
struct Made {
    /// The sky of the look that it replaces.
    over: Option<SkySetting>,
    /// What was asked for.
    asked: SkySetting,
    /// None where that cannot be, such as a sun on the 30th of February.
    sky: Option<SkySetting>,
}

/// What the window knows of the sky and no look holds.
pub(super) struct Daylight {
    wake: Wake,
    reading: Aside<Read>,
    /// What the sky that is being read is for.
    purpose: Purpose,
    making: Aside<Made>,
    state: SkyState,
    /// Whether in the frame before the day played, or the sky was being changed.
    was_changing: bool,
}

impl Daylight {
    pub fn new(wake: Wake) -> Daylight {
        let (reading, making, state) = (Aside::default(), Aside::default(), SkyState::default());
        Daylight { wake, reading, purpose: Purpose::Nothing, making, state, was_changing: false }
    }

    /// Another scene is open.
    pub fn forget(&mut self) {
        (self.purpose, self.state, self.was_changing) = (Purpose::Nothing, SkyState::default(), false);
    }

    /// Has the dome painted again.
    pub fn forget_picture(&mut self) {
        self.state.forget_picture();
    }

    /// Whether the hours pass, or a drag of the sun goes on: all of it is one step.
    pub fn is_changing(&self) -> bool {
        self.was_changing || self.state.playing.is_some() || !self.is_idle()
    }

    /// Whether the sky of the look is the one that was asked for last.
    pub fn is_idle(&self) -> bool {
        self.state.wanted.is_none()
    }

    /// Stays at the sky that it is.
    pub fn stop(&mut self) {
        (self.state.playing, self.state.wanted, self.was_changing) = (None, None, false);
    }
}

/// Whether what the sky could light was found to be closed.
fn is_sky_dark(header: &BakeHeader) -> bool {
    let source = |idx: &u32| header.basis.sources.get(*idx as usize);
    let is_dome = |source: &LightSource| matches!(source.kind, SourceKind::Dome { .. });
    header.spared.dark_sources.iter().filter_map(source).any(is_dome)
}

/// How much of the height of the panel of lights the sky may take.
fn most_height(height: f32) -> f32 {
    (MOST_HEIGHT * height).min(height - LIGHTS_LEAST).max(SKY_LEAST)
}

impl App {
    /// The sky below the lights.
    pub(super) fn sky_ui(&mut self, ui: &mut Ui, basis: &LightBasis) {
        if basis.is_measured() {
            return;
        }
        let view = SkyView {
            basis,
            is_shut_out: self.session.shown.as_ref().is_some_and(|shown| is_sky_dark(&shown.header)),
            can_bake: self.session.has_scene(),
            is_reading: self.daylight.reading.is_busy() && self.daylight.purpose != Purpose::Nothing,
        };
        let most = most_height(ui.available_height());
        let frame = eframe::egui::Frame::NONE.inner_margin(eframe::egui::Margin::symmetric(0, 4));
        Panel::bottom("sky").frame(frame).show(ui, |ui| {
            ScrollArea::vertical()
                .id_salt("sky")
                .max_height(most)
                .min_scrolled_height(most)
                .auto_shrink([false, true])
                .show(ui, |ui| {
                    // Folded or not in all views of the lights alike, each of which has a panel of its own.
                    let alike = UiBuilder::new().scope_id(Id::unique("sky of all views"));
                    ui.scope_builder(alike, |ui| {
                        sky_ui(ui, &view, &mut self.look.lights, &mut self.daylight.state, &mut self.actions);
                    });
                    keep_in_sight(ui, "sky");
                });
        });
    }

    /// Lights the scene by a map, once it is read; turn and intensity stay.
    pub(super) fn use_sky(&mut self, path: &Path) {
        let path = std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
        if self.start_reading(path.clone(), Purpose::NewSky) {
            self.say(format!("Reading {}", path.display()));
        }
    }

    /// Reads the map of the look's sky again, which another program wrote; what is set of the sky stays.
    pub(super) fn read_sky_again(&mut self) {
        if let Some(file) = self.look.lights.sky.as_ref().and_then(|sky| sky.file.clone()) {
            self.start_reading(file.into(), Purpose::NewMap);
        }
    }

    /// Answers whether a sky is being read now; complains where it is not.
    fn start_reading(&mut self, path: PathBuf, purpose: Purpose) -> bool {
        if self.daylight.reading.is_busy() {
            self.complain("another sky is being read; wait for it");
            return false;
        }
        let started = self.daylight.reading.start("read sky", &self.daylight.wake, move || read_sky(&path));
        match started {
            Ok(()) => self.daylight.purpose = purpose,
            Err(words) => self.complain(words),
        }
        self.daylight.reading.is_busy()
    }

    /// Takes in a sky that was read, if it is wanted still.
    fn take_read_sky(&mut self) {
        let Some(read) = self.daylight.reading.take() else { return };
        let read = read.and_then(|read| read);
        match std::mem::take(&mut self.daylight.purpose) {
            Purpose::Nothing => {}
            Purpose::NewSky => self.take_sky(read),
            Purpose::NewMap => self.take_map(read),
        }
    }

    /// Shows a map that was read again, in looks that were kept as well. What was set of the sky meanwhile stays, and so does a sky that
    /// shows another file by now. The look is as saved as it was: it names the file.
    fn take_map(&mut self, read: Read) {
        match read {
            Ok((read, odd)) => {
                let is_it = |sky: &SkySetting| sky.file == read.file;
                if !self.look.lights.sky.as_ref().is_some_and(is_it) {
                    return;
                }
                let renew = |sky: &mut SkySetting| {
                    if is_it(sky) {
                        sky.map = read.map.clone();
                    }
                };
                self.say(format!("Sky {}", read.name()));
                self.daylight.state.wanted.iter_mut().for_each(renew);
                self.as_one_step(|app| skies(&mut app.look).for_each(renew));
                skies(&mut self.saved_look).for_each(renew);
                if !odd.is_empty() {
                    self.complain(odd.join(", "));
                }
            }
            Err(words) => self.complain(words),
        }
    }

    fn take_sky(&mut self, read: Read) {
        match read {
            Ok((mut sky, mut odd)) => {
                let as_baked = self.sky_as_baked();
                let before = self.look.lights.sky.take().unwrap_or_else(|| as_baked.clone());
                (sky.rotation_deg, sky.intensity) = (before.rotation_deg, before.intensity);
                // A sun beside a map stays beside the next one.
                if before.file.as_deref().is_some_and(|file| file != "uniform") {
                    sky.sun = sky.sun.or(before.sun);
                }
                self.look.lights.sky = Some(before).filter(|before| *before != as_baked);
                self.say(format!("Sky {}", sky.name()));
                self.as_one_step(|app| app.look.lights.sky = Some(sky));
                odd.extend(self.missing_sky());
                if !odd.is_empty() {
                    self.complain(odd.join(", "));
                }
            }
            Err(words) => self.complain(words),
        }
    }

    /// What a sky is set to where the look names none.
    fn sky_as_baked(&self) -> SkySetting {
        self.session.basis().map_or_else(SkySetting::default, LightBasis::sky_as_baked)
    }

    /// Prepares and bakes the scene anew under the sky as it is set; a scene without any gets sun and clear sky.
    pub(super) fn bake_with_sky(&mut self, divisions: u32) {
        let Some(basis) = self.session.basis() else { return };
        let mut sky = self.look.lights.sky.clone();
        if basis.sky_light(&self.look.lights).is_none() {
            let wanted = SkySetting { sun: Some(NEW_SUN), ..sky.unwrap_or_default() };
            match sky::remade(&SkySetting::default(), wanted) {
                Ok(made) => sky = Some(made),
                Err(error) => return self.complain(error.to_string()),
            }
        }
        self.choose_sky(sky, divisions);
    }

    /// Takes in a sky that was read, and lets the hours pass.
    pub(super) fn advance_daylight(&mut self, ctx: &Context) {
        self.take_made_sky(ctx);
        // What is being made is made of the sky as it is, and is lost where that is another one.
        if !self.daylight.making.is_busy() {
            self.take_read_sky();
        }
        self.play_day(ctx);
        self.make_sky();
        // From the first picture to the last it is one step.
        let is_held = self.daylight.was_changing && ctx.input(|input| input.pointer.any_down());
        let is_changing = is_held || self.daylight.state.playing.is_some() || !self.daylight.is_idle();
        if is_changing != self.daylight.was_changing {
            self.daylight.was_changing = is_changing;
            self.keep_step();
        }
    }

    fn play_day(&mut self, ctx: &Context) {
        let Daylight { state, .. } = &mut self.daylight;
        let Some(hour) = &mut state.playing else { return };
        *hour += HOURS_PER_SEC * f64::from(ctx.input(|input| input.stable_dt).min(LONGEST_STEP_SECS));
        let shown = state.wanted.as_ref().or(self.look.lights.sky.as_ref());
        match shown.and_then(|sky| at_hour(sky, *hour)) {
            Some(sky) => {
                state.wanted = Some(sky);
                ctx.request_repaint();
            }
            None => self.daylight.stop(),
        }
    }

    /// Takes over a sky that was made. Another look, or an undo, goes before it.
    fn take_made_sky(&mut self, ctx: &Context) {
        let Some(made) = self.daylight.making.take() else { return };
        let wanted = &mut self.daylight.state.wanted;
        let Made { over, asked, sky } = match made {
            Ok(made) => made,
            Err(words) => {
                *wanted = None;
                return self.complain(words);
            }
        };
        let counts = wanted.is_some() && over == self.look.lights.sky;
        if !counts || *wanted == Some(asked) {
            *wanted = None;
        }
        if let Some(sky) = sky.filter(|_| counts) {
            if self.daylight.state.playing.is_none() {
                self.follower.hold_exposure(ctx);
            }
            self.looks.player.stop();
            let as_baked = self.sky_as_baked();
            self.look.lights.sky = Some(sky).filter(|sky| *sky != as_baked);
        }
    }

    /// Has the sky made that was asked for last, unless one is being made: each takes some milliseconds.
    fn make_sky(&mut self) {
        let Daylight { making, state, wake, .. } = &mut self.daylight;
        let Some(asked) = state.wanted.clone().filter(|_| !making.is_busy()) else { return };
        let over = self.look.lights.sky.clone();
        let make = move || {
            let sky = sky::remade(&over.clone().unwrap_or_default(), asked.clone()).ok();
            Made { over, asked, sky }
        };
        if let Err(words) = making.start("make sky", wake, make) {
            state.wanted = None;
            self.complain(words);
        }
    }
}

/// The sky at an hour of its day, to the minute, its map still to be made; `None` where its sun does not stand by time.
fn at_hour(sky: &SkySetting, hour: f64) -> Option<SkySetting> {
    let sun = sky.sun?;
    let SunPlace::Time { mut time, north_deg } = sun.place else { return None };
    time.hour = (60.0 * hour).round().rem_euclid(24.0 * 60.0) / 60.0;
    let sun = SunSetting { place: SunPlace::Time { time, north_deg }, ..sun };
    Some(SkySetting { sun: Some(sun), ..sky.clone() })
}

/// All skies of a document.
fn skies(look: &mut Look) -> impl Iterator<Item = &mut SkySetting> {
    look.rigs_mut().filter_map(|rig| rig.sky.as_mut())
}

/// Reads a map, and makes of it what relighting needs.
fn read_sky(path: &Path) -> Read {
    let mut sky = SkySetting { file: Some(path.display().to_string()), ..SkySetting::default() };
    let odd = sky::load(&mut sky, Path::new("")).map_err(|error| in_words(&error))?;
    // What is made of a map once is kept with it; of a large one that takes a while.
    sky.map.iter().for_each(|map| {
        map.level_irradiance();
    });
    Ok((sky, odd))
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::support::room_window;

    fn write_map(path: &Path, width: usize) {
        let pixels = vec![image::Rgb([1.0f32; 3]); width * width / 2];
        let file = std::fs::File::create(path).unwrap();
        image::codecs::hdr::HdrEncoder::new(file).encode(&pixels, width, width / 2).unwrap();
    }

    /// Waits for a map that is read.
    fn wait(app: &mut App, ctx: &Context) {
        for _ in 0..20_000 {
            app.advance_daylight(ctx);
            if !app.daylight.reading.is_busy() {
                return;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        panic!("no map came");
    }

    #[test]
    fn a_map_that_is_read_again_is_in_all_looks_and_leaves_them_saved() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("day.hdr");
        let mut window = room_window(None);
        let ctx = window.ctx.clone();
        let app = window.state_mut();
        write_map(&path, 8);
        app.look.lights.sky = Some(read_sky(&path).unwrap().0);
        app.look.keep("Day");
        app.saved_look = app.look.clone();
        write_map(&path, 16);
        app.read_sky_again();
        wait(app, &ctx);
        let widths: Vec<usize> = skies(&mut app.look).filter_map(|sky| Some(sky.map.as_ref()?.width())).collect();
        assert_eq!(widths, [16, 16]);
        assert!(!app.is_unsaved());
    }

    #[test]
    fn what_is_set_of_a_sky_while_its_map_is_read_again_stays() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("day.hdr");
        let mut window = room_window(None);
        let ctx = window.ctx.clone();
        let app = window.state_mut();
        write_map(&path, 8);
        let sun = |azimuth_deg: f64| Some(SunSetting::by_angles(azimuth_deg, 40.0));
        app.look.lights.sky = Some(SkySetting { sun: sun(90.0), ..read_sky(&path).unwrap().0 });
        write_map(&path, 16);
        app.read_sky_again();
        let set =
            SkySetting { rotation_deg: 30.0, intensity: 0.5, sun: sun(200.0), ..app.look.lights.sky.clone().unwrap() };
        app.look.lights.sky = Some(set.clone());
        wait(app, &ctx);
        let now = app.look.lights.sky.clone().unwrap();
        assert_eq!(now.map.as_ref().map(|map| map.width()), Some(16));
        assert!(now == SkySetting { map: now.map.clone(), ..set });
        // A sky of another file goes before the map, and so does none.
        app.read_sky_again();
        app.look.lights.sky = None;
        wait(app, &ctx);
        assert!(app.look.lights.sky.is_none());
    }

    #[test]
    fn the_lights_keep_room_beside_the_sky_in_every_window() {
        assert_eq!(most_height(1000.0), 620.0);
        assert_eq!(most_height(600.0), 340.0);
        assert_eq!(most_height(100.0), SKY_LEAST, "its title is seen");
    }
}
