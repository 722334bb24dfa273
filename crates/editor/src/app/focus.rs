//! What a person attends to: where in the picture the pointer rests, and what the program takes of the machine.

use eframe::egui::Context;

use super::App;
use crate::platform::resident_bytes;

/// How long the pointer must be still to count as resting, and between two questions about memory; seconds.
const RESTS_SECS: f32 = 0.25;
const MEMORY_EVERY_SECS: f64 = 2.0;

impl App {
    /// A bake that runs refines first what the pointer rests on.
    pub(super) fn look_there(&mut self, ctx: &Context) {
        if !self.session.bake.is_running() {
            return;
        }
        let still_secs = ctx.input(|input| input.pointer.time_since_last_movement());
        match self.view.probes.hover {
            None => self.session.focus.set(None),
            Some(pixel) if still_secs >= RESTS_SECS => self.session.focus.set(Some(pixel)),
            Some(_) => {}
        }
    }

    /// Asks the system now and then, while something is drawn anyway.
    pub(super) fn ask_memory(&mut self, ctx: &Context) {
        let now = ctx.input(|input| input.time);
        if now - self.memory.1 > MEMORY_EVERY_SECS {
            self.memory = (resident_bytes(), now);
        }
    }
}
