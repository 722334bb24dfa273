//! Work beside the look that closing the window or opening something else would lose, and the question before that.

use std::io::Write;
use std::mem::{Discriminant, discriminant};

use eframe::egui::{Context, ViewportCommand};

use super::App;
use crate::action::{Action, FileTask};
use crate::panels::dialogs::{UnsavedAnswer, frames_ui, stack_ui, stack_under_way_ui};

/// What would be lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Loss {
    /// Frames of a timeline that are not written yet: so many are there, of so many.
    Frames(u32, u32),
    /// The bake of pictures, which is in no file and in no cache.
    Stack,
    /// The same while it is made.
    StackUnderWay,
}

/// What is asked about it.
#[derive(Default)]
pub(super) struct Losing {
    /// What somebody wants done, and is asked about.
    waiting: Option<Action>,
    /// What may be done though work of these kinds is lost.
    accepted: Option<(Action, Vec<Discriminant<Loss>>)>,
}

impl Losing {
    pub fn waits_for_an_answer(&self) -> bool {
        self.waiting.is_some()
    }

    /// What is done if the answer allows it.
    pub fn waiting(&self) -> Option<&Action> {
        self.waiting.as_ref()
    }
}

impl App {
    /// What an action would lose that nobody has agreed to lose: frames go on while something else is opened.
    fn losses(&self, action: &Action) -> impl Iterator<Item = Loss> {
        let frames = self.session.frames().filter(|_| *action == Action::Quit);
        let of_frames = frames.map(|(n_written, n)| Loss::Frames(n_written, n));
        let of_stack = self.session.has_unsaved_stack().then_some(Loss::Stack);
        let under_way = self.session.is_baking_stack().then_some(Loss::StackUnderWay);
        let accepted = self.losing.accepted.as_ref().filter(|(of, _)| of == action).map_or(&[][..], |(_, kinds)| kinds);
        let losses = [of_frames, of_stack, under_way].into_iter().flatten();
        losses.filter(move |loss| !accepted.contains(&discriminant(loss)))
    }

    /// What it would lose first.
    fn loss(&self, action: &Action) -> Option<Loss> {
        self.losses(action).next()
    }

    /// Where the system ends the program without a question, a bake of pictures that is in no file is written beside them, by the name that
    /// the question about it would suggest.
    pub(super) fn keep_stack_now(&self) {
        if self.losses(&Action::Quit).any(|loss| loss == Loss::Stack)
            && let Err(words) = self.session.save_bake_now(&self.suggested(FileTask::SaveBake, ".transport"))
        {
            // The window is gone, and with it all other places for words.
            let _ = writeln!(std::io::stderr(), "clerestory: {words}");
        }
    }

    /// Whether an action waits until somebody says that work may be lost.
    pub(super) fn asks_before_loss(&mut self, action: &Action) -> bool {
        let is_asked = self.loss(action).is_some();
        if is_asked {
            self.losing.accepted = self.losing.accepted.take().filter(|(of, _)| of == action);
            self.losing.waiting = Some(action.clone());
        }
        is_asked
    }

    /// Does something that loses what is open with its look, or asks first.
    pub(super) fn unless_lost(&mut self, again: Action, job: impl FnOnce(&mut App)) {
        if !self.asks_before_loss(&again) {
            self.unless_unsaved(again, |app| {
                app.losing = Losing::default();
                job(app);
            });
        }
    }

    /// What was waiting for an answer, or for a look to be saved, is not done.
    pub(super) fn stay(&mut self) {
        (self.losing, self.after_saving, self.may_lose_look) = (Losing::default(), None, false);
    }

    /// The question, if there is one.
    pub(super) fn losing_ui(&mut self, ctx: &Context) {
        let Some(action) = self.losing.waiting.clone() else { return };
        // What would have been lost may be done meanwhile.
        let loss = self.loss(&action);
        let answer = match loss {
            Some(Loss::Frames(n_written, n)) => frames_ui(ctx, n_written, n),
            Some(Loss::Stack) => stack_ui(ctx),
            Some(Loss::StackUnderWay) => stack_under_way_ui(ctx),
            None => Some(UnsavedAnswer::Discard),
        };
        match answer {
            None => {}
            Some(UnsavedAnswer::Stay) => self.stay(),
            Some(UnsavedAnswer::Save) => {
                self.stay();
                self.ask(FileTask::SaveBake);
            }
            Some(UnsavedAnswer::Discard) => {
                // All of it goes on until nobody stays any more: what else would be lost, and whether the look is to be saved, is asked next.
                let (_, kinds) = self.losing.accepted.get_or_insert_with(|| (action.clone(), Vec::new()));
                kinds.extend(loss.map(|loss| discriminant(&loss)));
                self.losing.waiting = None;
                match action {
                    Action::Quit => ctx.send_viewport_cmd(ViewportCommand::Close),
                    action => self.actions.push(action),
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::support::room_window;

    #[test]
    fn a_look_that_was_given_up_is_unsaved_still_where_somebody_stays_for_something_else() {
        let mut window = room_window(None);
        let ctx = window.ctx.clone();
        let app = window.state_mut();
        app.look.display.exposure_ev = Some(3.0);
        // Its question was answered, and before the window closes another loss is asked about.
        app.may_lose_look = true;
        app.apply(&ctx, Action::Quit);
        assert!(app.is_unsaved());
        app.stay();
        assert!(app.is_unsaved() && !app.may_lose_look, "the next end asks for it again");
    }
}
