//! Steps of undo: one drag is one step, and so is an edit that no pointer makes.

use eframe::egui::Context;

use super::App;

impl App {
    pub(super) fn undo(&mut self) {
        self.daylight.stop();
        if let Some(look) = self.undoer.undo(&self.look).cloned() {
            let before = std::mem::replace(&mut self.look, look);
            self.follow_file_of_look(before);
            self.messages.take_back();
            self.prepare_chosen();
            self.say("Undone");
        }
    }

    pub(super) fn redo(&mut self) {
        self.daylight.stop();
        if let Some(look) = self.undoer.redo(&self.look).cloned() {
            let before = std::mem::replace(&mut self.look, look);
            self.follow_file_of_look(before);
            self.messages.take_back();
            self.prepare_chosen();
            self.say("Done again");
        }
    }

    /// One drag is one step: while a button is down nothing is fed. What the frame does in which it comes up belongs to the drag, so
    /// the state is kept at the next one.
    pub(super) fn feed_undoer(&mut self, ctx: &Context) {
        if std::mem::take(&mut self.has_let_go) {
            self.undoer.add_undo(&self.look);
        }
        let (now, is_down, came_up) =
            ctx.input(|input| (input.time, input.pointer.any_down(), input.pointer.any_released()));
        if self.daylight.is_changing() {
            return;
        }
        if is_down {
            // What was done before is another step than what is done now.
            if ctx.input(|input| input.pointer.any_pressed()) {
                self.undoer.add_undo(&self.look);
            }
            return;
        }
        if came_up {
            self.has_let_go = true;
            ctx.request_repaint();
            return;
        }
        self.undoer.feed_state(now, &self.look);
    }

    /// What an edit that no pointer makes is: one step of undo.
    pub(super) fn as_one_step(&mut self, edit: impl FnOnce(&mut App)) {
        self.undoer.add_undo(&self.look);
        edit(self);
        self.undoer.add_undo(&self.look);
    }
}
