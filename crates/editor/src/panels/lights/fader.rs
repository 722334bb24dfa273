//! A fader: intensity on a scale of stops, off at its low end, with a mark at what the file says.

use eframe::egui::accesskit::{self, ActionData};
use eframe::egui::{self, EventFilter, Id, Key, Painter, Pos2, Rect, Response, Sense, Stroke, Ui, Vec2, pos2, vec2};

use crate::panels::arrows::presses;
use crate::panels::menu::context_menu;
use crate::theme;

/// Which way more is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum More {
    /// To the right.
    Right,
    /// Up, as on a mixer.
    Up,
}

/// Stops above the file at the upper end, and just above off.
const STOPS: [f32; 2] = [-7.0, 4.0];
/// Part of the way on which the light is off.
const OFF: f32 = 0.03;
/// Part of the way at which the mark of the file catches.
const CATCH: f32 = 0.015;
/// How much slower a fader goes with Shift.
const FINE: f32 = 0.1;
/// Stops of one step of the keys, and with Shift.
pub(super) const STEP_EV: f32 = 1.0 / 3.0;
const FINE_STEP_EV: f32 = 1.0 / 12.0;
/// Radius of the handle, points.
const HANDLE: f32 = 6.5;
/// What the way is, which is that of [`STOPS`], and how it is gone.
const HINT: &str = "Intensity in stops (EV): off at its low end, then from 7 below the light of the file, the mark, to 4 above it\n\
                    Shift for fine steps, arrow keys for ⅓ EV, double-click for the file's value";

/// Place of an intensity on the way from 0 to 1.
fn place(intensity: f32) -> f32 {
    place_beyond(intensity).min(1.0)
}

/// The same where the way goes on above its upper end.
fn place_beyond(intensity: f32) -> f32 {
    if intensity <= 0.0 {
        return 0.0;
    }
    let t = (intensity.log2() - STOPS[0]) / (STOPS[1] - STOPS[0]);
    OFF + (1.0 - OFF) * t.max(0.0)
}

/// Intensity at a place.
fn at_place(place: f32) -> f32 {
    if place < 0.5 * OFF {
        return 0.0;
    }
    let t = ((place - OFF) / (1.0 - OFF)).max(0.0);
    tidy((STOPS[0] + t * (STOPS[1] - STOPS[0])).exp2())
}

/// Three digits that count: more would only be noise in files.
fn tidy(intensity: f32) -> f32 {
    let unit = 10f32.powf(intensity.log10().floor() - 3.0);
    if unit > 0.0 && unit.is_finite() { (intensity / unit).round() * unit } else { intensity }
}

/// An intensity so many stops higher. A light that is off stays off.
pub(super) fn stepped(intensity: f32, stops: f32) -> f32 {
    let stepped = intensity * stops.exp2();
    // Three thirds down and up again are where they began.
    if (stepped - 1.0).abs() < 1e-4 { 1.0 } else { stepped.clamp(0.0, 1e6) }
}

/// Draws a fader of a size and does what is done to it; `changed()` tells whether the intensity is another.
pub(super) fn fader_ui(ui: &mut Ui, label: &str, (size, more): (Vec2, More), intensity: &mut f32) -> Response {
    let (rect, mut response) = ui.allocate_exact_size(size, Sense::click_and_drag());
    let (before, mut reset) = (*intensity, false);
    if let Some(to) = dragged(ui, &response, way(rect, more), *intensity) {
        *intensity = to;
    }
    if response.double_clicked() {
        *intensity = 1.0;
    }
    let steps = steps(ui, &response, more);
    if steps != 0.0 {
        let from = if *intensity > 0.0 || steps < 0.0 { *intensity } else { STOPS[0].exp2() };
        *intensity = stepped(from, steps);
    }
    let asked = ui.input(|input| {
        let asked = input.accesskit_action_requests(response.id, accesskit::Action::SetValue);
        let number = |request: &accesskit::ActionRequest| match request.data {
            Some(ActionData::NumericValue(value)) => Some(value as f32),
            _ => None,
        };
        asked.filter_map(number).last()
    });
    if let Some(asked) = asked.filter(|asked| asked.is_finite()) {
        *intensity = asked.clamp(0.0, 1e6);
    }
    if *intensity != before {
        response.mark_changed();
    }
    let value = f64::from(*intensity);
    response.widget_info(|| egui::WidgetInfo::slider(ui.is_enabled(), value, label));
    ui.ctx().accesskit_node_builder(response.id, |node| {
        node.set_min_numeric_value(0.0);
        node.set_max_numeric_value(f64::from(STOPS[1].exp2()));
        for action in [accesskit::Action::SetValue, accesskit::Action::Increment, accesskit::Action::Decrement] {
            node.add_action(action);
        }
    });
    if ui.is_rect_visible(rect) {
        paint(ui, rect, more, *intensity, &response);
    }
    context_menu(&response, |ui| {
        if ui.button("Reset to the file's value").clicked() {
            reset = true;
            ui.close();
        }
    });
    if reset && *intensity != 1.0 {
        *intensity = 1.0;
        response.mark_changed();
    }
    // The toolkit keeps a hint that is open, and lays it over a question that comes.
    if ui.memory(|memory| memory.allows_interaction(ui.layer_id())) { response.on_hover_text(HINT) } else { response }
}

/// Both ends of the way of the handle.
fn way(rect: Rect, more: More) -> [Pos2; 2] {
    match more {
        More::Right => [pos2(rect.left() + HANDLE, rect.center().y), pos2(rect.right() - HANDLE, rect.center().y)],
        More::Up => [pos2(rect.center().x, rect.bottom() - HANDLE), pos2(rect.center().x, rect.top() + HANDLE)],
    }
}

/// Where a press or a drag takes the handle: one on the handle takes hold of it where it is, one beside it brings it to the pointer;
/// with Shift a tenth of the way, from where it is. Other buttons do nothing.
fn dragged(ui: &Ui, response: &Response, [low, high]: [Pos2; 2], intensity: f32) -> Option<f32> {
    let pointer = response.interact_pointer_pos()?;
    let is_primary = |pointer: &egui::PointerState| pointer.primary_down() || pointer.primary_released();
    if !ui.input(|input| is_primary(&input.pointer)) {
        return None;
    }
    let way = (high - low).length().max(1.0);
    let along = |v: Vec2| v.dot(high - low) / way.powi(2);
    let at = along(pointer - low);
    let fine = ui.input(|input| input.modifiers.shift);
    let moved = along(ui.input(|input| input.pointer.delta()));
    // How far the handle is from the pointer, nothing where it was brought there; and how far up it may go.
    let id: Id = response.id.with("apart");
    let is_new = ui.input(|input| input.pointer.primary_pressed());
    let is_held = fine || (place(intensity) - at).abs() * way <= HANDLE;
    let [apart, most] = match ui.data(|data| data.get_temp::<[f32; 2]>(id)).filter(|_| !is_new) {
        Some([apart, most]) => [apart - if fine { (1.0 - FINE) * moved } else { 0.0 }, most],
        None if is_held => [place_beyond(intensity) - at, place_beyond(intensity).max(1.0)],
        None => [0.0, 1.0],
    };
    ui.data_mut(|data| data.insert_temp(id, [apart, most]));
    // What is held and rests stays as it is, to the last digit.
    if is_held && is_new || apart != 0.0 && moved == 0.0 {
        return None;
    }
    let to = at + apart;
    Some(if !fine && (to - place(1.0)).abs() < CATCH { 1.0 } else { at_place(to.min(most)) })
}

/// Stops that keys and assistive technology ask for.
fn steps(ui: &Ui, response: &Response, more: More) -> f32 {
    let mut n_steps = ui.input(|input| {
        input.num_accesskit_action_requests(response.id, accesskit::Action::Increment) as f32
            - input.num_accesskit_action_requests(response.id, accesskit::Action::Decrement) as f32
    });
    if response.has_focus() {
        let (horizontal_arrows, vertical_arrows) = (more == More::Right, more == More::Up);
        let filter = EventFilter { horizontal_arrows, vertical_arrows, ..EventFilter::default() };
        ui.memory_mut(|memory| memory.set_focus_lock_filter(response.id, filter));
        let [down, up] = match more {
            More::Right => [Key::ArrowLeft, Key::ArrowRight],
            More::Up => [Key::ArrowDown, Key::ArrowUp],
        };
        n_steps += presses(ui, up, FINE_STEP_EV / STEP_EV) - presses(ui, down, FINE_STEP_EV / STEP_EV);
    }
    n_steps * STEP_EV
}

fn paint(ui: &Ui, rect: Rect, more: More, intensity: f32, response: &Response) {
    let [low, high] = way(rect, more);
    let at = |t: f32| low + (high - low) * t;
    let (painter, visuals) = (ui.painter(), ui.style().interact(response));
    let handle = at(place(intensity));
    let file = at(place(1.0));
    let across = if more == More::Right { vec2(0.0, 5.0) } else { vec2(9.0, 0.0) };
    rail(painter, [low, high], ui.visuals().widgets.inactive.bg_fill);
    let is_changed = intensity != 1.0;
    let fill = if is_changed { theme::ACCENT } else { ui.visuals().widgets.hovered.bg_fill };
    rail(painter, [low, handle], fill);
    painter.line_segment([file - across, file + across], Stroke::new(1.0, ui.visuals().weak_text_color()));
    let stroke = if response.has_focus() { Stroke::new(2.0, theme::ACCENT) } else { visuals.fg_stroke };
    match more {
        More::Right => _ = painter.circle(handle, HANDLE, visuals.bg_fill, stroke),
        More::Up => {
            let cap = Rect::from_center_size(handle, vec2(22.0, 2.0 * HANDLE - 1.0));
            painter.rect(cap, 3.0, visuals.bg_fill, stroke, egui::StrokeKind::Inside);
            painter.line_segment(
                [cap.left_center() + vec2(4.0, 0.0), cap.right_center() - vec2(4.0, 0.0)],
                visuals.fg_stroke,
            );
        }
    }
}

fn rail(painter: &Painter, ends: [Pos2; 2], color: egui::Color32) {
    let rect = Rect::from_two_pos(ends[0], ends[1]).expand(2.0);
    painter.rect_filled(rect, 2.0, color);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_and_its_intensity_are_told_from_each_other() {
        for intensity in [0.0, 0.01, 0.125, 0.5, 1.0, 2.0, 16.0] {
            let back = at_place(place(intensity));
            assert!((back - intensity).abs() <= 2e-3 * intensity, "{intensity}: {back}");
        }
        assert_eq!((at_place(0.0), at_place(1.0), place(1e9)), (0.0, 16.0, 1.0));
        assert!((at_place(place_beyond(100.0)) - 100.0).abs() < 0.2, "it goes on above");
    }

    #[test]
    fn thirds_of_stops_come_back_to_where_they_began() {
        let up = (0..3).fold(1.0, |intensity, _| stepped(intensity, STEP_EV));
        assert!((up - 2.0).abs() < 1e-4);
        assert_eq!((0..3).fold(up, |intensity, _| stepped(intensity, -STEP_EV)), 1.0);
        assert_eq!(stepped(0.0, 5.0), 0.0);
    }
}
