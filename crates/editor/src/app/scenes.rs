//! What a scene that was opened or found brings along, and the bake that follows.

use std::collections::BTreeSet;

use clerestory_transport::bake::Passes;
use clerestory_transport::camera::Camera;

use super::undo::Steps;
use super::{App, in_brief};
use crate::look::Look;
use crate::panels::lights::{LightsState, take_in};
use crate::panels::looks::LooksState;
use crate::panels::messages::Holds;
use crate::viewport::ViewState;

/// The open file is read again: what stays as it is.
pub(super) struct Reloading {
    /// The view, where it is none of the file's.
    pub camera: Option<Camera>,
    /// Keys of the lights that were there.
    pub lights: BTreeSet<String>,
}

/// What is said of something that was opened: the first of its notes, too, and where the others are.
fn words_of(name: &str, report: &[String]) -> String {
    match report {
        [] => format!("Opened {name}"),
        [note] => format!("Opened {name}: {}", in_brief(note.clone())),
        [note, others @ ..] => {
            let (note, n_more) = (in_brief(note.clone()), others.len());
            format!("Opened {name}: {note} (and {n_more} more under “Report”, at the end of “Bake”)")
        }
    }
}

impl App {
    pub(super) fn scene_opened(&mut self) {
        let reloading = self.reloading.take();
        if reloading.is_some() {
            self.messages.scene_read();
        } else {
            self.messages.scene_left();
            let look = self.session.basis().map_or_else(Look::default, Look::of_file);
            (self.look, self.saved_look, self.look_path) = (look.clone(), look, None);
            self.look_files.forget();
            self.adopt_choice();
            self.steps = Steps::default();
        }
        (self.export.width_px, self.export.region) = (None, None);
        self.watch_opened();
        self.remember_opened();
        let mut lights = LightsState::new(self.lights.layout);
        if let Some(reloading) = &reloading {
            self.take_in(&reloading.lights);
            lights.keep_solo(&mut self.lights);
        } else {
            self.view = ViewState::default();
            self.solving.forget_floor();
        }
        self.lights = lights;
        self.camera.put_down();
        self.follower.forget();
        self.prints.forget();
        self.looks = LooksState::default();
        self.solving.forget();
        self.daylight.forget();
        self.say(self.session.opened.as_ref().map_or(String::new(), |opened| words_of(&opened.name, &opened.report)));
        if let (None, Some(camera)) = (&self.fixed_settings, self.session.cameras().first()) {
            let own = self.habits.settings(Some(camera));
            if reloading.is_none() {
                self.settings = own;
            } else if self.settings.camera_idx >= self.session.cameras().len() {
                (self.settings.camera_idx, self.settings.film) = (own.camera_idx, own.film);
            }
        }
        if let Some(words) = self.missing_floor() {
            self.complain_of_scene(Holds::UntilRead, words);
        }
        let of_file = self.session.cameras().get(self.settings.camera_idx).cloned();
        let is_reloaded = reloading.is_some();
        self.camera.camera = reloading.and_then(|reloading| reloading.camera).or(of_file);
        self.take_up();
        if let (true, Some(basis)) = (is_reloaded, self.session.basis()) {
            let mut lost = self.look.unheeded(basis);
            lost.extend(self.look.taken_since(basis));
            if !lost.is_empty() {
                self.complain_of_scene(Holds::UntilRead, format!("Opened again: {}", lost.join(", ")));
            }
        }
        if is_reloaded {
            // Undo may have led elsewhere meanwhile.
            self.prepare_chosen();
        }
        self.start_bake();
        self.actions.append(&mut self.opening.held);
    }

    /// Brings the lights that are new under the masters of the look and of its snapshots.
    fn take_in(&mut self, known: &BTreeSet<String>) {
        if let Some(basis) = self.session.basis() {
            let snapshots = self.look.snapshots.iter_mut().map(|snapshot| &mut snapshot.lights);
            snapshots.chain([&mut self.look.lights]).for_each(|rig| take_in(rig, basis, known));
        }
    }

    /// The bake that was opened is one of its scene from now on, baked as it was.
    pub(super) fn scene_of_bake_found(&mut self) {
        self.adopt_view();
        self.adopt_choice();
        if let (None, Some(settings)) = (&self.fixed_settings, self.session.settings_of_shown()) {
            self.settings = settings;
        }
    }

    /// Starts what somebody asked for.
    pub(super) fn bake_as_asked(&mut self) {
        // A look may make another scene of that of a bake.
        if self.prepare_chosen() {
            return;
        }
        match self.session.opened.as_ref() {
            Some(opened) if self.session.has_scene() || opened.stack.is_some() => self.start_bake(),
            _ => self.complain("a bake alone cannot be baked again; open its scene"),
        }
    }

    /// Does what the button of the bake panel offers, which is no start while a bake runs or can go on: a key must not throw away hours.
    pub(super) fn bake_by_key(&mut self) {
        let (settings, camera) = (&self.settings, self.camera.camera.as_ref());
        if self.session.is_baking_stack() || self.session.is_baking(settings, camera) {
            self.say("This bake runs already; “Cancel bake” stops it");
        } else if self.session.n_resumable(settings, camera) > 0 {
            self.session.resume_bake(settings, camera);
        } else {
            self.bake_as_asked();
        }
    }

    pub(super) fn start_bake(&mut self) {
        self.follow_work_plane();
        self.keep_work_plane();
        let is_stack = self.session.opened.as_ref().is_some_and(|opened| opened.stack.is_some());
        let settings = if is_stack { &self.stack_settings } else { &self.settings };
        let camera = self.camera.camera.clone().filter(|_| !is_stack);
        self.session.start_bake(settings, camera, Passes::Progressive);
        self.camera.put_down();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_note_is_said_and_how_many_more_there_are() {
        let notes = ["the scene has no light", "Left out: a", "Left out: b"].map(String::from);
        assert_eq!(words_of("hall.glb", &[]), "Opened hall.glb");
        assert_eq!(words_of("hall.glb", &notes[..1]), "Opened hall.glb: the scene has no light");
        let all = "Opened hall.glb: the scene has no light (and 2 more under “Report”, at the end of “Bake”)";
        assert_eq!(words_of("hall.glb", &notes), all);
    }
}
