//! While something is opened: what is changed meanwhile is not lost unasked, and what is for the new scene waits for it.

use eframe::egui::Context;

use super::App;
use crate::action::Action;
use crate::look::Look;

/// What is known of what is being opened.
#[derive(Default)]
pub(super) struct Opening {
    /// The look that may be lost for it, as it was when that was asked for.
    pub given_up: Look,
    /// What is done once it is open.
    pub held: Vec<Action>,
}

impl App {
    /// Holds back what is for a scene that is not open yet.
    pub(super) fn hold(&mut self, action: Action) -> Option<Action> {
        let is_of_look = matches!(action, Action::OpenLook(_) | Action::AddLooks(_) | Action::MatchPicture(_));
        let is_for_it = is_of_look || matches!(action, Action::UseSky(_));
        if !is_for_it || !self.awaits_scene() {
            return Some(action);
        }
        // That was said of the look that goes with the scene.
        self.may_lose_look = false;
        self.opening.held.push(action);
        None
    }

    /// Whether a scene is being opened, or will be as soon as a question is answered.
    fn awaits_scene(&self) -> bool {
        let asked = self.unsaved.iter().chain(&self.after_saving).chain(self.losing.waiting()).chain(&self.actions);
        let mut asked = asked.filter(|action| matches!(action, Action::Open(_) | Action::OpenBuiltIn));
        self.session.is_opening() || asked.next().is_some()
    }

    /// Whether something was changed since it was asked to open what is being opened, and is not saved.
    pub(super) fn would_lose_changes(&self) -> bool {
        let takes_look = self.session.is_opening() && self.reloading.is_none();
        takes_look && self.is_unsaved() && self.look != self.opening.given_up
    }

    /// Whether somebody is about to write a file: what is open goes into it, and nothing of a scene that comes meanwhile.
    pub(super) fn is_writing(&self) -> bool {
        let is_asked = self.question.as_ref().is_some_and(|question| question.task().writes());
        is_asked || self.look_files.waits_for_an_answer() || self.actions.iter().any(Action::writes)
    }

    /// Asks about what was changed meanwhile, and gives up what waits for a scene that does not come.
    pub(super) fn follow_opening(&mut self) {
        if !self.awaits_scene() {
            std::mem::take(&mut self.opening.held).into_iter().for_each(|action| self.give_up(&action));
        }
        let is_asked = self.waits_for_an_answer() || self.after_saving.is_some();
        if self.session.has_arrived() && !is_asked && self.would_lose_changes() {
            self.unsaved = Some(Action::TakeOpened);
        }
    }

    /// Says of a file that was for a scene that nothing was done with it: nobody may have named that scene now.
    fn give_up(&mut self, action: &Action) {
        if let Action::OpenLook(path) | Action::AddLooks(path) | Action::MatchPicture(path) | Action::UseSky(path) =
            action
        {
            let file = path.display();
            self.say(format!(
                "{file} was not opened, since the scene that it waited for was not; open it with another one"
            ));
        }
    }

    /// What was changed may be lost for what was read.
    pub(super) fn take_opened(&mut self, ctx: &Context) {
        self.opening.given_up = self.look.clone();
        ctx.request_repaint();
    }

    pub(super) fn cancel_opening(&mut self) {
        self.session.cancel_opening();
        self.not_opened();
    }

    /// What is open stays: so does the work that was to be recovered, and the look may have changed what is made of the scene.
    pub(super) fn not_opened(&mut self) {
        self.leave_behind();
        self.reloading = None;
        self.prepare_chosen();
    }
}
