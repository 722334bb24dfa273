//! What stands behind the letters of a row, in columns that the rows of lights and of groups share.

use eframe::egui::{Align, Layout, Rect, Sense, Ui, UiBuilder, Vec2, pos2, vec2};

use super::mix::Mix;
use super::row::{HEIGHT, NUMBER};

/// How far the names of a group's lights are set in; the triangle of the group stands there.
pub(super) const INDENT: f32 = 14.0;
/// Width of the swatch of a color.
const SWATCH: f32 = 28.0;
const SPACING: f32 = 6.0;
/// Part of what letters, number and color leave of a row that the fader takes; the name has the rest.
const FADER: f32 = 0.4;
/// Room that name and fader need side by side; with less the fader has a line of its own.
const BESIDE: f32 = 176.0;
/// Height of a fader in a line of its own.
const BELOW: f32 = 17.0;

/// What stands in a row behind its letters.
pub(super) enum Part {
    /// Its width in points.
    Name(f32),
    /// Its size in points.
    Fader(Vec2),
    Number,
    Color,
}

/// Has the parts of a row drawn, each in its column.
pub(super) fn columns_ui(ui: &mut Ui, mix: &mut Mix, mut add: impl FnMut(&mut Ui, &mut Mix, Part)) {
    let room = ui.available_width() - SWATCH - NUMBER - 2.0 * SPACING;
    let is_beside = room >= BESIDE;
    let height = if is_beside { HEIGHT } else { HEIGHT + BELOW };
    let (whole, _) = ui.allocate_exact_size(vec2(ui.available_width(), height), Sense::hover());
    let line = |from: f32, width: f32| Rect::from_min_size(pos2(from, whole.top()), vec2(width, HEIGHT));
    let (name, fader) = if is_beside {
        let fader = (FADER * room).round();
        (line(whole.left(), room - fader - SPACING), line(whole.left() + room - fader, fader))
    } else {
        let below = Rect::from_min_max(pos2(whole.left(), whole.top() + HEIGHT), whole.right_bottom());
        (line(whole.left(), room), below)
    };
    let number = line(whole.left() + room + SPACING, NUMBER);
    let color = line(whole.right() - SWATCH, SWATCH);
    let parts = [
        (name, Part::Name(name.width())),
        (fader, Part::Fader(fader.size())),
        (number, Part::Number),
        (color, Part::Color),
    ];
    for (rect, part) in parts {
        let place = UiBuilder::new().max_rect(rect).layout(Layout::left_to_right(Align::Center));
        // A child does not widen the row, whatever it holds.
        add(&mut ui.new_child(place), mix, part);
    }
}
