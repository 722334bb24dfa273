//! Drags, which end before another look comes: what is remembered of one, to go on and to be put back, is of the look in which it began.

use eframe::egui::{Context, PointerState};

use super::App;
use crate::action::Action;

impl App {
    /// What was asked for and is due. Another look waits, with what was asked for after it, for the next frame where something is dragged: that
    /// ends in this one, and stays where it is.
    pub(super) fn due(&mut self, ctx: &Context) -> Vec<Action> {
        let is_other = |action: &Action| matches!(action, Action::TakeLook(_) | Action::Undo | Action::Redo);
        let first = self.actions.iter().position(is_other).filter(|_| is_dragging(ctx));
        let Some(first) = first else { return std::mem::take(&mut self.actions) };
        ctx.stop_dragging();
        self.let_go();
        self.looks.let_go();
        let later = self.actions.split_off(first);
        std::mem::replace(&mut self.actions, later)
    }

    /// Lets go of what the pointer holds in the picture: it stays where it is.
    pub(super) fn let_go(&mut self) {
        self.lights.lamps.let_go();
        self.view.let_go();
    }
}

/// Whether something is dragged, or pressed in a way that may become a drag.
fn is_dragging(ctx: &Context) -> bool {
    let may_be_drag = |pointer: &PointerState| pointer.any_down() && pointer.could_any_button_be_click();
    ctx.dragged_id().is_some() || ctx.input(|input| may_be_drag(&input.pointer))
}
