//! Looks from files and into them. They are read beside the window: a look may name a large map of the sky.

use std::path::{Path, PathBuf};

use eframe::egui::Context;

use super::App;
use crate::action::FileTask;
use crate::look::{Look, OnDisk, named_scene};
use crate::panels::dialogs::{ReplaceAnswer, replace_ui};
use crate::panels::messages::Holds;
use crate::session::Wake;
use crate::session::aside::Aside;
use crate::words::in_words;

/// A look, what is odd about it, and how its file stood.
type Read = Result<(Look, Vec<String>, OnDisk), String>;

/// What a look is read for.
#[derive(Clone, Copy)]
enum Purpose {
    /// It takes the place of the present one.
    Open,
    /// Its looks come behind those that there are.
    Add,
}

/// A look, and how it stands to a file.
#[derive(Clone)]
pub(super) struct Standing {
    look: Look,
    saved: Look,
    path: Option<PathBuf>,
    on_disk: Option<OnDisk>,
}

/// Looks that are being read, and the file of the one that is edited.
pub(super) struct LookFiles {
    wake: Wake,
    reading: Aside<(PathBuf, Purpose, Read)>,
    /// How the file of the look stood when it was last read or written here.
    pub(super) on_disk: Option<OnDisk>,
    /// Where the look goes if somebody says that what another program wrote there may be lost.
    conflict: Option<PathBuf>,
    /// Of each look that was opened or recovered what stood before it, and itself: undo leads back over it.
    opened: Vec<[Standing; 2]>,
}

impl LookFiles {
    pub fn new(wake: Wake) -> LookFiles {
        LookFiles { wake, reading: Aside::default(), on_disk: None, conflict: None, opened: Vec::new() }
    }

    /// Another scene is open, with a look of its own: one that is still being read was for the scene before.
    pub(super) fn forget(&mut self) {
        self.reading = Aside::default();
        self.on_disk = None;
        self.opened.clear();
    }

    /// Whether it asks if a file that was changed is to be replaced.
    pub fn waits_for_an_answer(&self) -> bool {
        self.conflict.is_some()
    }
}

impl App {
    /// Whether a look is being read.
    pub fn is_reading_look(&self) -> bool {
        self.look_files.reading.is_busy()
    }

    pub(super) fn open_look(&mut self, path: PathBuf) {
        self.read_look(path, Purpose::Open);
    }

    /// Adds the looks of a file to those that there are.
    pub(super) fn add_looks(&mut self, path: PathBuf) {
        self.read_look(path, Purpose::Add);
    }

    fn read_look(&mut self, path: PathBuf, purpose: Purpose) {
        if self.look_files.reading.is_busy() {
            return self.complain("another look is still being read; try again in a moment");
        }
        let started = self.look_files.reading.start("read look", &self.look_files.wake, move || {
            let read = Look::load_as_it_stands(&path).map_err(|error| in_words(&error));
            (path, purpose, read)
        });
        if let Err(words) = started {
            self.complain(words);
        }
    }

    /// Takes in a look that was read.
    pub(super) fn follow_look_files(&mut self) {
        match self.look_files.reading.take() {
            Some(Ok((path, Purpose::Open, Ok(read)))) => self.take_look_of_file(path, read),
            Some(Ok((path, Purpose::Add, Ok((look, warnings, _))))) => self.add_looks_of_file(&path, look, warnings),
            Some(Ok((_, _, Err(words))) | Err(words)) => self.complain(words),
            None => {}
        }
    }

    fn take_look_of_file(&mut self, path: PathBuf, (mut look, mut warnings, on_disk): (Look, Vec<String>, OnDisk)) {
        let mut is_whole = warnings.is_empty();
        if let Some(basis) = self.session.basis() {
            warnings.extend(look.unheeded(basis));
            let n_lamps = |look: &Look| look.rigs().map(|rig| rig.lamps.len()).sum::<usize>();
            let n_before = n_lamps(&look);
            warnings.extend(look.leave_out_taken(basis));
            is_whole &= n_lamps(&look) == n_before;
        }
        look.scene = std::mem::take(&mut look.scene).or(&self.look.scene);
        self.daylight.stop();
        self.let_go();
        // A moment of the timeline, and a key that is chosen there, are of the look before.
        self.looks.player.stop();
        self.looks.player.let_go();
        let before = self.standing();
        self.as_one_step(|app| app.look = look.clone());
        warnings.extend(self.heed_choice());
        let words = format!("Opened {}", path.display());
        let rest =
            if is_whole { "" } else { "; saving asks for another file, since what was left out is in this one alone" };
        let problem = format!("{}: {}{rest}", path.display(), warnings.join(", "));
        self.remember(path.clone());
        let file = is_whole.then_some((path, on_disk));
        self.saved_look = look;
        (self.look_path, self.look_files.on_disk) = file.unzip();
        self.has_taken_place_of(before);
        if warnings.is_empty() { self.say(words) } else { self.complain_of_scene(Holds::InScene, problem) }
    }

    /// Adds the looks of a file that was read; the lights, and what is made of the scene, stay as they are.
    fn add_looks_of_file(&mut self, path: &Path, mut other: Look, mut warnings: Vec<String>) {
        other.scene = self.look.scene.clone();
        if let Some(basis) = self.session.basis() {
            warnings.extend(other.unheeded(basis));
            warnings.extend(other.leave_out_taken(basis));
        }
        let stem = path.file_stem().map_or_else(|| "Look".into(), |stem| stem.to_string_lossy().into_owned());
        let mut n_added = None;
        self.as_one_step(|app| n_added = app.look.add_all(other, &stem));
        let file = path.display();
        match n_added {
            None => self.complain(format!("{file} has more looks than there is room for here; delete some first")),
            Some(_) if !warnings.is_empty() => {
                self.complain_of_scene(Holds::InScene, format!("{file}: {}", warnings.join(", ")));
            }
            Some(1) => self.say(format!("Added the look of {file}")),
            Some(n_added) => self.say(format!("Added {n_added} looks of {file}")),
        }
    }

    /// Another look, with a file of its own or none, has taken the place of what stood before.
    pub(super) fn has_taken_place_of(&mut self, before: Standing) {
        let after = self.standing();
        self.look_files.opened.push([before, after]);
    }

    pub(super) fn standing(&self) -> Standing {
        let (look, saved, path) = (self.look.clone(), self.saved_look.clone(), self.look_path.clone());
        Standing { look, saved, path, on_disk: self.look_files.on_disk }
    }

    /// Undo or redo led here from another look: where a file was opened in between, the look belongs to the other file again.
    pub(super) fn follow_file_of_look(&mut self, from: Look) {
        let now = Standing { look: from, ..self.standing() };
        let found = self.look_files.opened.iter_mut().rev().find_map(|[before, after]| {
            let (leaves, comes) = match (&before.look, &after.look) {
                (older, newer) if *newer == now.look && *older == self.look => (after, before),
                (older, newer) if *older == now.look && *newer == self.look => (before, after),
                _ => return None,
            };
            // It may have been saved since.
            *leaves = now.clone();
            Some(comes.clone())
        });
        if let Some(Standing { saved, path, on_disk, .. }) = found {
            (self.saved_look, self.look_path, self.look_files.on_disk) = (saved, path, on_disk);
        }
    }

    /// Saves, or asks first where another program changed the file meanwhile.
    pub(super) fn save_look(&mut self, path: PathBuf) {
        let known = self.look_files.on_disk.filter(|_| self.look_path.as_ref() == Some(&path));
        if known.is_some_and(|known| known.was_changed(&path)) {
            self.look_files.conflict = Some(path);
        } else {
            self.write_look(path);
        }
    }

    fn write_look(&mut self, path: PathBuf) {
        let opened = self.session.opened.as_ref().and_then(|opened| opened.path.clone());
        let own = self.look_path.as_ref().filter(|own| **own == path).and_then(|own| named_scene(own));
        let saved = self.look.save_for(&path, scene_to_name(own, opened).as_deref());
        match saved {
            Ok(on_disk) => {
                self.say(format!("Saved {}", path.display()));
                self.remember(path.clone());
                (self.saved_look, self.look_path) = (self.look.clone(), Some(path));
                self.look_files.on_disk = Some(on_disk);
                self.actions.extend(self.after_saving.take());
            }
            Err(error) => {
                // What was to follow was asked for then, not for whenever a look is saved at last.
                self.stay();
                self.complain(in_words(&error));
            }
        }
    }

    pub(super) fn look_conflict_ui(&mut self, ctx: &Context) {
        let Some(path) = &self.look_files.conflict else { return };
        let name = path.file_name().map_or_else(|| path.display().to_string(), |name| name.display().to_string());
        let Some(answer) = replace_ui(ctx, &name) else { return };
        let path = self.look_files.conflict.take();
        match answer {
            ReplaceAnswer::Elsewhere => self.ask(FileTask::SaveLook),
            ReplaceAnswer::Replace => path.into_iter().for_each(|path| self.write_look(path)),
            ReplaceAnswer::Stay => self.stay(),
        }
    }

    pub(super) fn save_look_again(&mut self) {
        let Some(path) = self.look_path.clone() else { return self.ask(FileTask::SaveLook) };
        match FileTask::SaveLook.refusal(&path) {
            None => self.save_look(path),
            Some(words) => {
                self.complain(words);
                self.ask(FileTask::SaveLook);
            }
        }
    }
}

/// The scene that a look is saved for: the open one. Where nothing with a path is open, or another one in place of that which the file
/// names and which is away, the file keeps its `own`.
fn scene_to_name(own: Option<PathBuf>, opened: Option<PathBuf>) -> Option<PathBuf> {
    own.filter(|own| opened.is_none() || !own.exists()).or(opened)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    #[test]
    fn a_look_whose_scene_is_away_is_not_bound_to_another_one() {
        let folder = tempfile::tempdir().unwrap();
        let [here, other] = ["here.glb", "other.glb"].map(|name| {
            let path = folder.path().join(name);
            std::fs::write(&path, "").unwrap();
            Some(path)
        });
        let away = Some(folder.path().join("away.glb"));
        assert_eq!(scene_to_name(away.clone(), other.clone()), away);
        assert_eq!(scene_to_name(away.clone(), None), away);
        assert_eq!(scene_to_name(here.clone(), None), here);
        assert_eq!(scene_to_name(here, other.clone()), other);
        assert_eq!(scene_to_name(None, other.clone()), other);
    }

    #[test]
    fn a_look_that_is_still_being_read_is_none_of_the_scene_that_is_opened() {
        let wake: Wake = Arc::new(|_| {});
        let mut files = LookFiles::new(wake.clone());
        let read = || ("evening.look".into(), Purpose::Open, Err("nobody waits for it".into()));
        files.reading.start("read look", &wake, read).unwrap();
        files.forget();
        assert!(!files.reading.is_busy() && files.reading.take().is_none());
    }
}
