//! Unsaved work: kept while it changes, offered after an editor ended without asking.

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use eframe::egui::Context;

use super::App;
use crate::panels::dialogs::{RecoveryAnswer, recovery_ui};
use crate::panels::messages::Holds;
use crate::session::{Source, Stage};
use crate::unsaved::{Keeper, LeftBehind, Work};
use crate::words::in_words;

/// Keeping and recovering.
#[derive(Default)]
pub(super) struct Recovery {
    keeper: Option<Keeper>,
    /// What is still to be offered, newest first.
    left: Vec<LeftBehind>,
    /// What is taken up once its scene is open.
    taken: Option<LeftBehind>,
}

impl Recovery {
    /// Keeps in `folder`; a sentence where that cannot be.
    pub fn start(folder: Option<&Path>) -> (Recovery, Option<String>) {
        match folder.map(Keeper::start) {
            None => (Recovery::default(), None),
            Some(Ok((keeper, left))) => (Recovery { keeper: Some(keeper), left, taken: None }, None),
            Some(Err(error)) => (Recovery::default(), Some(format!("{}; save looks by hand", in_words(&error)))),
        }
    }
}

impl App {
    /// Keeps the look while it is unsaved.
    pub(super) fn keep_unsaved(&mut self, ctx: &Context) {
        let Some(mut keeper) = self.recovery.keeper.take() else { return };
        if let Some(soon) = keeper.follow(&self.look, &self.saved_look, || self.work()) {
            ctx.request_repaint_after(soon);
        }
        if let Some(problem) = keeper.problem() {
            self.complain(problem);
        }
        self.recovery.keeper = Some(keeper);
    }

    /// Keeps the look at once if it is unsaved: what comes next may fail.
    pub(super) fn keep_unsaved_now(&mut self) {
        if !self.is_unsaved() {
            return;
        }
        let work = self.work();
        if let Some(keeper) = &mut self.recovery.keeper {
            keeper.keep_now(&self.look, work);
        }
    }

    fn work(&self) -> Work {
        let look_folder = self.look_path.as_deref().and_then(Path::parent).map(Path::to_path_buf);
        let folder = look_folder.or_else(|| std::env::current_dir().ok()).unwrap_or_default();
        Work {
            scene: self.session.opened.as_ref().and_then(|opened| opened.path.clone()),
            look_path: self.look_path.clone(),
            on_disk: self.look_files.on_disk,
            folder,
            look: self.look.to_json(),
        }
    }

    /// What was left behind and is to be offered now: one after the other, once something is open and what was taken up is saved.
    pub(super) fn left_behind(&self) -> Option<&LeftBehind> {
        let is_asked = self.question.is_some() || self.unsaved.is_some() || self.losing.waits_for_an_answer();
        let is_busy = is_asked || self.recovery.taken.is_some();
        let is_open = !self.session.is_opening() && self.session.stage != Stage::Empty;
        self.recovery.left.first().filter(|_| is_open && !is_busy && !self.is_unsaved())
    }

    /// Offers it.
    pub(super) fn recovery_ui(&mut self, ctx: &Context) {
        let Some(left) = self.left_behind() else { return };
        let age = left.kept_at.and_then(|at| SystemTime::now().duration_since(at).ok());
        let Some(answer) = recovery_ui(ctx, &left.work.scene_name(), age) else { return };
        let left = self.recovery.left.remove(0);
        match answer {
            RecoveryAnswer::Recover => self.recover(left),
            RecoveryAnswer::Discard => left.forget(),
            // It stays in its slot and is offered again at the next start.
            RecoveryAnswer::Later => {}
        }
    }

    fn recover(&mut self, left: LeftBehind) {
        let open = self.session.opened.as_ref().and_then(|opened| opened.path.clone());
        let is_open = open == left.work.scene && self.session.stage == Stage::Ready;
        let source = left.work.scene.clone().map_or(Source::BuiltIn, Source::File);
        self.recovery.taken = Some(left);
        if is_open { self.take_up() } else { self.open_source(source) }
    }

    /// Puts the work that is being recovered in place, its scene being open.
    pub(super) fn take_up(&mut self) {
        // What was opened instead has nothing to do with it.
        let open = self.session.opened.as_ref().and_then(|opened| opened.path.as_ref());
        let Some(left) = self.recovery.taken.take().filter(|left| left.work.scene.as_ref() == open) else { return };
        let (look, mut warnings) = match left.work.look() {
            Ok(read) => read,
            Err(error) => return self.complain(format!("the unsaved look cannot be read: {}", in_words(&error))),
        };
        let is_whole = warnings.is_empty();
        let before = self.standing();
        self.look = look;
        // A key of the timeline that is chosen there is of the look before.
        self.looks.player.let_go();
        // What was left out is in its file alone.
        let file = left.work.look_path.clone().filter(|_| is_whole);
        (self.look_path, self.look_files.on_disk) = (file, left.work.on_disk.filter(|_| is_whole));
        self.has_taken_place_of(before);
        warnings.extend(self.heed_choice());
        match warnings.as_slice() {
            [] => self.say(format!("Recovered the look of {}", left.work.scene_name())),
            some if is_whole => {
                self.complain_of_scene(Holds::InScene, format!("Recovered: {}", some.join(", ")));
            }
            some => self.complain(format!(
                "Recovered in part, offered again at the next start; saving asks for another file: {}",
                some.join(", ")
            )),
        }
        // In the own slot before the other is given up.
        let work = self.work();
        if let Some(keeper) = &mut self.recovery.keeper {
            keeper.keep_now(&self.look, work);
        }
        // What could not be read stays in its slot: a disk may be missing.
        if is_whole {
            left.forget();
        }
    }

    /// The scene of the work could not be opened: it stays where it is and is offered at the next start.
    pub(super) fn leave_behind(&mut self) {
        self.recovery.taken = None;
    }
}

/// Folder for unsaved looks of the user who runs the program.
pub(super) fn folder() -> Option<PathBuf> {
    eframe::storage_dir("clerestory").map(|folder| folder.join("unsaved"))
}
