//! What a scene that was opened or found brings along, and the bake that follows.

use clerestory_transport::bake::Passes;
use eframe::egui::util::undoer::Undoer;

use super::App;
use crate::look::Look;
use crate::panels::lights::LightsState;
use crate::panels::looks::LooksState;
use crate::viewport::ViewState;

impl App {
    pub(super) fn scene_opened(&mut self) {
        let keeps_look = std::mem::take(&mut self.keeps_look);
        if !keeps_look {
            let look = self.session.basis().map_or_else(Look::default, Look::of_file);
            (self.look, self.saved_look, self.look_path) = (look.clone(), look, None);
            self.look_files.on_disk = None;
            self.undoer = Undoer::default();
        }
        (self.export.width_px, self.export.region) = (None, None);
        self.watch_opened();
        self.remember_opened();
        self.lights = LightsState::new(self.lights.layout);
        self.view = ViewState::default();
        self.camera.put_down();
        self.camera.camera = self.session.cameras().get(self.settings.camera_idx).cloned();
        self.follower.forget();
        self.prints.forget();
        self.looks = LooksState::default();
        self.solving.forget();
        self.daylight.forget();
        self.say(self.session.opened.as_ref().map_or(String::new(), |opened| format!("Opened {}", opened.name)));
        if let (None, Some(camera)) = (&self.fixed_settings, self.session.cameras().first()) {
            let own = self.habits.settings(Some(camera));
            if keeps_look {
                (self.settings.camera_idx, self.settings.film) = (own.camera_idx, own.film);
            } else {
                self.settings = own;
            }
        }
        self.take_up();
        if let (true, Some(basis)) = (keeps_look, self.session.basis()) {
            let lost = self.look.unheeded(basis);
            if !lost.is_empty() {
                self.complain(format!("Opened again: {}", lost.join(", ")));
            }
        }
        self.start_bake();
    }

    /// The bake that was opened is one of its scene from now on, baked as it was.
    pub(super) fn scene_of_bake_found(&mut self) {
        self.adopt_view();
        if let (None, Some(settings)) = (&self.fixed_settings, self.session.settings_of_shown()) {
            self.settings = settings;
        }
    }

    /// Starts what somebody asked for.
    pub(super) fn bake_as_asked(&mut self) {
        match self.session.opened.as_ref() {
            Some(opened) if opened.scene.is_some() || opened.stack.is_some() => self.start_bake(),
            _ => self.complain("a bake alone cannot be baked again; open its scene"),
        }
    }

    pub(super) fn start_bake(&mut self) {
        let is_stack = self.session.opened.as_ref().is_some_and(|opened| opened.stack.is_some());
        let settings = if is_stack { &self.stack_settings } else { &self.settings };
        let camera = self.camera.camera.clone().filter(|_| !is_stack);
        self.session.start_bake(settings, camera, Passes::Progressive);
        self.camera.put_down();
    }
}
