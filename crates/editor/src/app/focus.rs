//! What a person attends to: where in the picture the pointer rests.

use eframe::egui::Context;

use super::App;

/// How long the pointer must be still to count as resting, seconds.
const RESTS_SECS: f32 = 0.25;

impl App {
    /// A bake that runs refines first what the pointer rests on.
    pub(super) fn look_there(&mut self, ctx: &Context) {
        if !self.session.bake.is_running() {
            return;
        }
        let still_secs = ctx.input(|input| input.pointer.time_since_last_movement());
        match self.view.probes.hover {
            None => self.session.attend(None),
            Some(pixel) if still_secs >= RESTS_SECS => self.session.attend(Some(pixel)),
            Some(_) => {}
        }
    }
}
