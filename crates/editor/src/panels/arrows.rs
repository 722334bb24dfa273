//! Arrow keys for what has the focus.

use eframe::egui::{EventFilter, Key, Response, Ui, Vec2, vec2};

/// What a step is of, with Shift.
pub const FINE: f32 = 0.1;

/// Steps to the right and down that arrow keys ask of what has the focus; it keeps the focus meanwhile.
pub fn arrows(ui: &Ui, response: &Response) -> Vec2 {
    if !response.has_focus() {
        return Vec2::ZERO;
    }
    let filter = EventFilter { horizontal_arrows: true, vertical_arrows: true, ..EventFilter::default() };
    ui.memory_mut(|memory| memory.set_focus_lock_filter(response.id, filter));
    let presses = |key| ui.input(|input| input.num_presses(key) as f32);
    vec2(presses(Key::ArrowRight) - presses(Key::ArrowLeft), presses(Key::ArrowDown) - presses(Key::ArrowUp))
}
