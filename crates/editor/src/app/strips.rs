//! Lines over the picture: a welcome for who is new, and a file that has changed on disk.

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use eframe::egui::{Context, Ui};

use super::App;
use super::scenes::Reloading;
use crate::action::Action;
use crate::panels::strip::strip_ui;
use crate::session::Source;

/// Seconds between two looks at the file, while something is drawn anyway.
const LOOK_EVERY_SECS: f64 = 1.0;

const WELCOME: &str =
    "Drag lights in the picture, or sliders on the left. Drop a glTF file here, or press Open…, to light your own room";

/// When a file was written last, and its length.
type Stamp = (Option<SystemTime>, u64);

/// The file that is open, as it was when it was opened.
#[derive(Default)]
pub(super) struct Watched {
    file: Option<(PathBuf, Stamp)>,
    looked_at: f64,
    has_changed: bool,
}

fn stamp(path: &Path) -> Option<Stamp> {
    let meta = std::fs::metadata(path).ok()?;
    meta.is_file().then(|| (meta.modified().ok(), meta.len()))
}

impl App {
    /// Starts to watch what was opened.
    pub(super) fn watch_opened(&mut self) {
        let path = self.session.opened.as_ref().and_then(|opened| opened.path.clone());
        let file = path.and_then(|path| stamp(&path).map(|stamp| (path, stamp)));
        self.watched = Watched { file, ..Watched::default() };
    }

    /// Looks now and then whether the file that is open was written since; nothing is drawn for that alone.
    pub(super) fn watch_file(&mut self, ctx: &Context) {
        let now = ctx.input(|input| input.time);
        let Some((path, opened)) = &self.watched.file else { return };
        if now - self.watched.looked_at < LOOK_EVERY_SECS {
            return;
        }
        self.watched.looked_at = now;
        // One that is gone is being written, or will be.
        self.watched.has_changed = stamp(path).is_some_and(|found| found != *opened);
    }

    /// Opens the same file again; what is set stays, light by light, as their names are.
    pub(super) fn reload(&mut self) {
        if let Some((path, _)) = self.watched.file.clone() {
            let of_file = self.session.cameras().get(self.settings.camera_idx);
            let camera = self.camera.camera.clone().filter(|camera| Some(camera) != of_file);
            self.reloading = Some(Reloading { camera });
            self.watched.has_changed = false;
            self.session.reopen(Source::File(path));
        }
    }

    /// What is to be told over the picture.
    pub(super) fn strips_ui(&mut self, ui: &mut Ui) {
        if self.is_new_here && strip_ui(ui, "welcome", WELCOME, &["Got it"]).is_some() {
            self.is_new_here = false;
        }
        let Some((path, _)) = self.watched.file.as_ref().filter(|_| self.watched.has_changed) else { return };
        let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        let words = format!("{name} has changed on disk");
        match strip_ui(ui, "changed", &words, &["Reload", "Keep what is open"]) {
            Some(0) => self.actions.push(Action::Reload),
            Some(_) => self.watch_opened(),
            None => {}
        }
    }
}
