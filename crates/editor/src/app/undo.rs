//! Steps of undo: one drag is one step, and so is an edit that no pointer makes, with those of the same thing that follow at once. A step
//! is the look, the sky that the scene is baked under, and, while the camera is in hand, where that is; so a view that was left without a
//! bake comes back.

use std::collections::BTreeSet;
use std::time::Duration;

use clerestory_transport::camera::Camera;
use eframe::egui::{Context, util::undoer::Undoer};

use super::App;
use crate::look::Look;
use crate::session::ChosenSky;

/// A little longer than a state has to rest to be a step.
const RESTED: Duration = Duration::from_millis(1050);

/// What undo goes back to.
#[derive(Clone, Debug, Default, PartialEq)]
struct Step {
    look: Look,
    /// The sky that the scene is baked under.
    sky: Option<ChosenSky>,
    /// The view of a camera in hand.
    flight: Option<Camera>,
}

/// The steps, and what there was when they were asked last.
#[derive(Debug, Default)]
pub(super) struct Steps {
    undoer: Undoer<Step>,
    now: Step,
    /// What was edited last, by name.
    edited: BTreeSet<String>,
}

impl Steps {
    pub fn can_undo(&self) -> bool {
        self.undoer.has_undo(&self.now)
    }

    pub fn can_redo(&self) -> bool {
        self.undoer.has_redo(&self.now)
    }

    /// What is done to one thing after another is a step for each, however soon they follow: what stood before `look` is kept where
    /// something else was edited last, and has not rested yet. `numbers` of the view were edited, where it was not moved as a whole.
    fn part(
        &mut self,
        look: &Look,
        sky: Option<&ChosenSky>,
        flight: Option<&Camera>,
        numbers: &BTreeSet<&'static str>,
    ) {
        let mut edited = if self.now.look == *look { BTreeSet::new() } else { look.differences(&self.now.look) };
        edited.extend((self.now.sky.as_ref() != sky).then(|| "sky of the bake".to_owned()));
        if self.now.flight.as_ref() != flight {
            edited.insert(Vec::from_iter(["camera"].iter().chain(numbers).copied()).join("."));
        }
        if edited.is_empty() {
            return;
        }
        if self.undoer.is_in_flux() && edited != self.edited {
            self.undoer.add_undo(&self.now);
        }
        self.edited = edited;
    }

    /// Looks are large: one that stays is not copied.
    fn follow(&mut self, look: &Look, sky: Option<&ChosenSky>, flight: Option<&Camera>) {
        if self.now.look != *look {
            self.now.look = look.clone();
        }
        if self.now.sky.as_ref() != sky {
            self.now.sky = sky.cloned();
        }
        if self.now.flight.as_ref() != flight {
            self.now.flight = flight.cloned();
        }
    }
}

impl App {
    /// The steps, up to date.
    fn steps(&mut self) -> &mut Steps {
        let flight = self.camera.camera.as_ref().filter(|_| self.camera.is_moving);
        self.steps.part(&self.look, self.choices.sky.as_ref(), flight, &self.camera.edited);
        self.steps.follow(&self.look, self.choices.sky.as_ref(), flight);
        &mut self.steps
    }

    pub(super) fn undo(&mut self) {
        self.daylight.stop();
        let Steps { undoer, now, .. } = self.steps();
        if let Some(step) = undoer.undo(now).cloned() {
            self.go_to(step, "Undone");
        }
    }

    pub(super) fn redo(&mut self) {
        self.daylight.stop();
        let Steps { undoer, now, .. } = self.steps();
        if let Some(step) = undoer.redo(now).cloned() {
            self.go_to(step, "Redone");
        }
    }

    fn go_to(&mut self, step: Step, words: &str) {
        self.messages.take_back();
        self.let_go();
        let has_other_sky = step.sky != self.choices.sky;
        let of_sky = || has_other_sky.then(|| "sky".to_owned());
        let what = step.look.edit_words(&self.look).or_else(of_sky).unwrap_or_else(|| "camera".into());
        self.choices.sky = step.sky;
        if step.look != self.look {
            let before = std::mem::replace(&mut self.look, step.look);
            self.show_lights_again(&before);
            self.looks.follow_names(&before, &self.look);
            // Which key stands where is another matter where one came or went.
            if self.look.timeline.keys.len() != before.timeline.keys.len() {
                self.looks.player.let_go();
            }
            self.follow_bookmarks(&before);
            self.follow_file_of_look(before);
            self.prepare_chosen();
        } else if has_other_sky {
            self.prepare_chosen();
        }
        match step.flight {
            Some(camera) => self.take_in_hand(camera),
            None if self.camera.is_moving => self.put_camera_down(),
            None => {}
        }
        self.say(format!("{words}: {what}"));
    }

    /// One drag is one step: while a button is down nothing is fed. What the frame does in which it comes up belongs to the drag, so
    /// the state is kept at the next one.
    pub(super) fn feed_undoer(&mut self, ctx: &Context) {
        if std::mem::take(&mut self.ends_step) {
            self.keep_step();
        }
        let (now, is_down, came_up) =
            ctx.input(|input| (input.time, input.pointer.any_down(), input.pointer.any_released()));
        if self.daylight.is_changing() {
            return;
        }
        if is_down {
            // What was done before is another step than what is done now.
            if ctx.input(|input| input.pointer.any_pressed()) {
                self.keep_step();
                // The frame of the press takes what was typed, which is another step as well.
                self.ends_step = ctx.text_edit_focused();
            }
            return;
        }
        if came_up {
            self.ends_step = true;
            ctx.request_repaint();
            return;
        }
        let steps = self.steps();
        steps.undoer.feed_state(now, &steps.now);
        // What the wheel does to a camera is a step once it has rested, which takes a frame that nobody else asks for.
        if steps.now.flight.is_some() && steps.undoer.is_in_flux() {
            ctx.request_repaint_after(RESTED);
        }
    }

    /// Keeps what there is as a step; where it is a new one, what was undone before cannot be done again any more.
    pub(super) fn keep_step(&mut self) {
        let Steps { undoer, now, .. } = self.steps();
        // Only a state that is fed takes those away; its time counts for nothing, since it is kept at once.
        undoer.feed_state(0.0, now);
        undoer.add_undo(now);
    }

    /// What an edit that no pointer makes is: one step of undo.
    pub(super) fn as_one_step(&mut self, edit: impl FnOnce(&mut App)) {
        self.keep_step();
        let before = self.steps.now.look.clone();
        edit(self);
        self.follow_sky();
        self.show_lights_again(&before);
        self.keep_step();
    }

    /// Where lights or display were changed they are shown, and no moment of the timeline any more.
    fn show_lights_again(&mut self, before: &Look) {
        if (&self.look.lights, &self.look.display) != (&before.lights, &before.display) {
            self.looks.player.stop();
        }
    }
}
