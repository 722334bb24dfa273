//! Looks from files and into them. They are read beside the window: a look may name a large map of the sky.

use std::path::PathBuf;

use super::App;
use crate::action::FileTask;
use crate::look::Look;
use crate::session::Wake;
use crate::session::aside::Aside;

/// A look, and what is odd about it.
type Read = Result<(Look, Vec<String>), String>;

/// Looks that are being read.
pub(super) struct LookFiles {
    wake: Wake,
    reading: Aside<(PathBuf, Read)>,
}

impl LookFiles {
    pub fn new(wake: Wake) -> LookFiles {
        LookFiles { wake, reading: Aside::default() }
    }
}

impl App {
    /// Whether a look is being read.
    pub fn is_reading_look(&self) -> bool {
        self.look_files.reading.is_busy()
    }

    pub(super) fn open_look(&mut self, path: PathBuf) {
        if self.look_files.reading.is_busy() {
            return self.complain("another look is still being read; try again in a moment");
        }
        let started = self.look_files.reading.start("read look", &self.look_files.wake, move || {
            let read = Look::load_readable(&path).map_err(|error| format!("{error:#}"));
            (path, read)
        });
        if let Err(words) = started {
            self.complain(words);
        }
    }

    /// Takes in a look that was read.
    pub(super) fn follow_look_files(&mut self) {
        match self.look_files.reading.take() {
            Some(Ok((path, Ok(read)))) => self.take_look_of_file(path, read),
            Some(Ok((_, Err(words))) | Err(words)) => self.complain(words),
            None => {}
        }
    }

    fn take_look_of_file(&mut self, path: PathBuf, (mut look, mut warnings): (Look, Vec<String>)) {
        if let Some(basis) = self.session.basis() {
            warnings.extend(look.unheeded(basis));
            for rig in look.rigs_mut() {
                rig.lamps.retain(|lamp| basis.source(&lamp.key).is_none());
            }
        }
        let words = format!("Opened {}", path.display());
        let problem = format!("{}: {}", path.display(), warnings.join(", "));
        self.as_one_step(|app| app.look = look.clone());
        (self.saved_look, self.look_path) = (look, Some(path));
        if warnings.is_empty() { self.say(words) } else { self.complain(problem) }
    }

    pub(super) fn save_look(&mut self, path: PathBuf) {
        match self.look.save(&path) {
            Ok(()) => {
                self.say(format!("Saved {}", path.display()));
                (self.saved_look, self.look_path) = (self.look.clone(), Some(path));
                self.actions.extend(self.after_saving.take());
            }
            Err(error) => self.complain(format!("{error:#}")),
        }
    }

    pub(super) fn save_look_again(&mut self) {
        match self.look_path.clone() {
            Some(path) => self.save_look(path),
            None => self.ask(FileTask::SaveLook),
        }
    }
}
