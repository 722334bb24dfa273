//! Lines over the picture: a welcome for who is new, and a file that has changed on disk.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use clerestory_transport::lamps::LampShape;
use eframe::egui::{Context, Ui};

use super::App;
use super::scenes::Reloading;
use crate::action::Action;
use crate::panels::strip::strip_ui;
use crate::session::Source;
use crate::session::aside::Aside;

/// Seconds between two looks at the files, while something is drawn anyway.
const LOOK_EVERY_SECS: f64 = 1.0;

const WELCOME: &str =
    "Drag lights in the picture, or sliders on the left. Drop a glTF file here, or press Open…, to light your own room";

/// When a file was written last, and its length; none of one that is not there.
type Stamp = Option<(Option<SystemTime>, u64)>;

/// What the picture is made of, as it was when it was opened.
#[derive(Default)]
pub(super) struct Watched {
    /// The scene, first, and the files beside it.
    files: Vec<(PathBuf, Stamp)>,
    /// The map of the sky of the look, the profiles of its lamps, and pictures that its wishes match.
    of_look: Vec<(PathBuf, Stamp)>,
    looking: Aside<Option<PathBuf>>,
    looked_at: f64,
    changed: Option<PathBuf>,
    /// The scene as it was read, whatever of it was kept open since.
    read: Option<(PathBuf, Stamp)>,
}

fn stamp(path: &Path) -> Stamp {
    let meta = std::fs::metadata(path).ok()?;
    meta.is_file().then(|| (meta.modified().ok(), meta.len()))
}

fn stamped(path: PathBuf) -> (PathBuf, Stamp) {
    let stamp = stamp(&path);
    (path, stamp)
}

/// The first of some files that was written since. One that is gone is being written, or will be.
fn changed(files: &[(PathBuf, Stamp)]) -> Option<PathBuf> {
    let is_other = |(path, old): &&(PathBuf, Stamp)| stamp(path).is_some_and(|now| Some(now) != *old);
    files.iter().find(is_other).map(|(path, _)| path.clone())
}

impl App {
    /// Starts to watch what was opened. What the look names is read again with it, but for the map of its sky, which is known as it was read.
    pub(super) fn watch_opened(&mut self) {
        let opened = self.session.opened.as_ref();
        let path = opened.and_then(|opened| opened.path.clone()).filter(|path| path.is_file());
        let beside = opened.into_iter().flat_map(|opened| opened.files.iter().cloned());
        let read = path.map(stamped);
        let files = read.iter().cloned().chain(beside.map(stamped)).collect();
        let (sky, mut of_look) = (self.sky_file(), std::mem::take(&mut self.watched.of_look));
        of_look.retain(|(path, _)| Some(path) == sky.as_ref());
        self.watched = Watched { files, of_look, read, ..Watched::default() };
        self.watch_look();
    }

    /// What is open stays although it was written since: the next time is told, and what else was written. Files of a scene go together.
    fn keep_opened(&mut self) {
        let Watched { files, of_look, looking, changed, .. } = &mut self.watched;
        let kept = changed.take();
        // A look that is under way knows it as it stood.
        *looking = Aside::default();
        let renew = |known: &mut (PathBuf, Stamp)| *known = stamped(known.0.clone());
        match of_look.iter_mut().find(|(path, _)| Some(path) == kept.as_ref()) {
            Some(known) => renew(known),
            None => files.iter_mut().for_each(renew),
        }
    }

    /// Whether the file of the scene holds another one than is open.
    pub(super) fn is_scene_rewritten(&self) -> bool {
        changed(self.watched.read.as_slice()).is_some()
    }

    /// The map of the sky that the look names.
    fn sky_file(&self) -> Option<PathBuf> {
        let file = self.look.lights.sky.as_ref()?.file.as_ref().filter(|file| *file != "uniform")?;
        Some(file.into())
    }

    /// Watches what the look names from now on; what it named before is known as it was read.
    fn watch_look(&mut self) {
        let profiles = self.look.lights.lamps.iter().filter_map(|lamp| match &lamp.shape {
            LampShape::Profile { file } => Some(PathBuf::from(file)),
            _ => None,
        });
        let pictures = self.look.wishes.files().map(PathBuf::from);
        let named: BTreeSet<PathBuf> = self.sky_file().into_iter().chain(profiles).chain(pictures).collect();
        let of_look = &mut self.watched.of_look;
        of_look.retain(|(path, _)| named.contains(path));
        let is_known = |path: &PathBuf| of_look.iter().any(|(known, _)| known == path);
        let new: Vec<_> = named.iter().filter(|path| !is_known(path)).cloned().map(stamped).collect();
        of_look.extend(new);
    }

    /// Looks now and then whether something of what is open was written since, beside the window: files may lie far off. Nothing
    /// is drawn for that alone.
    pub(super) fn watch_file(&mut self, ctx: &Context) {
        // What is being read again is told once it is there.
        if self.reloading.is_some() {
            return;
        }
        self.watch_look();
        let now = ctx.input(|input| input.time);
        let Watched { files, of_look, looking, looked_at, changed: found, .. } = &mut self.watched;
        if let Some(answer) = looking.take() {
            (*looked_at, *found) = (now, answer.ok().flatten());
        }
        if (files.is_empty() && of_look.is_empty()) || looking.is_busy() || now - *looked_at < LOOK_EVERY_SECS {
            return;
        }
        let watched: Vec<(PathBuf, Stamp)> = files.iter().chain(&*of_look).cloned().collect();
        if let Err(words) = looking.start("watch", &self.wake, move || changed(&watched)) {
            self.complain(words);
        }
    }

    /// Opens the same file again; what is set stays, light by light, as their names are. What belongs to the look is read alone: the
    /// map of a sky, the profile of a lamp, or a picture to match.
    pub(super) fn reload(&mut self) {
        let found = self.watched.changed.take();
        if let Some(known) = self.watched.of_look.iter_mut().find(|(path, _)| Some(path) == found.as_ref()) {
            *known = stamped(known.0.clone());
            let file = known.0.display().to_string();
            self.watched.looking = Aside::default();
            return if found == self.sky_file() {
                self.read_sky_again();
            } else if self.look.wishes.files().any(|own| own == file) {
                self.read_target_again(&file);
            } else {
                self.read_profiles_again();
            };
        }
        let Some(path) = self.session.opened.as_ref().and_then(|opened| opened.path.clone()) else { return };
        let of_file = self.session.cameras().get(self.settings.camera_idx);
        let camera = self.camera.camera.clone().filter(|camera| Some(camera) != of_file);
        let basis = self.session.basis();
        let lights = basis.map(|basis| basis.sources.iter().map(|source| source.key.clone()).collect());
        self.reloading = Some(Reloading { camera, lights: lights.unwrap_or_default() });
        self.session.reopen(Source::File(path));
    }

    /// What is to be told over the picture.
    pub(super) fn strips_ui(&mut self, ui: &mut Ui) {
        if self.is_new_here && strip_ui(ui, "welcome", WELCOME, &["Got it"]).is_some() {
            self.is_new_here = false;
        }
        let Some(path) = &self.watched.changed else { return };
        let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        let words = format!("{name} has changed on disk");
        match strip_ui(ui, "changed", &words, &["Reload", "Keep what is open"]) {
            Some(0) => self.actions.push(Action::Reload),
            Some(_) => self.keep_opened(),
            None => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use clerestory_transport::sky::SkySetting;
    use egui_kittest::Harness;

    use super::*;
    use crate::app::Start;
    use crate::support::ROOM;

    #[test]
    fn a_map_that_is_written_with_its_scene_is_offered_whatever_becomes_of_the_scene() {
        let folder = tempfile::tempdir().unwrap();
        let [scene, map] = ["room.gltf", "day.hdr"].map(|name| folder.path().join(name));
        let room = ROOM.as_bytes();
        std::fs::write(&scene, room).unwrap();
        std::fs::write(&map, b"a map").unwrap();
        let start = Start::alone(Source::File(scene.clone()), None);
        let mut window = Harness::builder().build_eframe(|cc| App::new(cc, start).unwrap());
        for _ in 0..20_000 {
            window.step();
            if window.state().session.opened.is_some() {
                break;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        let app = window.state_mut();
        app.look.lights.sky = Some(SkySetting { file: Some(map.display().to_string()), ..SkySetting::default() });
        app.watch_look();
        let found = |app: &App| [changed(&app.watched.files), changed(&app.watched.of_look)];
        assert_eq!(found(app), [None, None]);
        std::fs::write(&scene, [room, b"\n"].concat()).unwrap();
        std::fs::write(&map, b"another map").unwrap();
        assert_eq!(found(app), [Some(scene.clone()), Some(map.clone())]);
        // The scene is read again.
        app.watch_opened();
        assert_eq!(found(app), [None, Some(map.clone())]);
        // It is not.
        std::fs::write(&scene, room).unwrap();
        app.watched.changed = Some(scene);
        app.keep_opened();
        assert_eq!(found(app), [None, Some(map.clone())]);
        assert!(app.is_scene_rewritten());
        app.watched.changed = Some(map);
        app.keep_opened();
        assert_eq!(found(app), [None, None]);
    }
}
