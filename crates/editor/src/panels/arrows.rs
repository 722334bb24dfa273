//! Arrow keys for what has the focus.

use eframe::egui::{Event, EventFilter, Key, Response, Ui, Vec2, vec2};

/// What a step is of, with Shift.
pub const FINE: f32 = 0.1;

/// Steps to the right and down that arrow keys ask of what has the focus, each of those with Shift `shifted` steps; it keeps the
/// focus meanwhile.
pub fn arrows(ui: &Ui, response: &Response, shifted: f32) -> Vec2 {
    if !response.has_focus() {
        return Vec2::ZERO;
    }
    let filter = EventFilter { horizontal_arrows: true, vertical_arrows: true, ..EventFilter::default() };
    ui.memory_mut(|memory| memory.set_focus_lock_filter(response.id, filter));
    let presses = |key| presses(ui, key, shifted);
    vec2(presses(Key::ArrowRight) - presses(Key::ArrowLeft), presses(Key::ArrowDown) - presses(Key::ArrowUp))
}

/// How often a key was pressed since the last frame, each press with Shift counting `shifted` times. Shift may have been let go
/// before the frame ended, so that every press tells for itself.
pub fn presses(ui: &Ui, key: Key, shifted: f32) -> f32 {
    let count = |event: &Event| match event {
        Event::Key { key: pressed, pressed: true, modifiers, .. } if *pressed == key => {
            if modifiers.shift {
                shifted
            } else {
                1.0
            }
        }
        _ => 0.0,
    };
    ui.input(|input| input.events.iter().map(count).sum())
}
