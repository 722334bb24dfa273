//! The camera in hand: a quick picture of what it would see, and the gestures that move it.

use clerestory_transport::camera::{Camera, Film};
use clerestory_transport::prepared::PreparedScene;
use eframe::egui::{
    self, Button, Color32, CursorIcon, Event, InputState, Key, MouseWheelUnit, PointerButton, Rect, Response, RichText,
    Sense, TextureId, Ui, pos2, vec2,
};

use super::gizmo::surface_along;
use super::orbit::{Flight, Navigation, Turn, middle};
use super::zoom::Zoom;
use crate::action::Action;
use crate::panels::shortcuts::{escapes, hears_keys};
use crate::theme;

/// Share of the scene's diameter that one walks in a second.
const WALK_PER_SEC: f32 = 0.12;
/// Points of a line of a wheel that counts in lines.
const POINTS_PER_LINE: f32 = 40.0;
/// How much faster with Shift.
const RUN: f32 = 3.0;
/// Width of the buttons beside what is said and of what is around all of it, and least width of the words, points.
const BESIDE_WORDS: f32 = 230.0;
const LEAST_WORDS: f32 = 60.0;
/// Keys that walk, and where to: right, up, ahead.
const KEYS: [(Key, [f32; 3]); 6] = [
    (Key::D, [1.0, 0.0, 0.0]),
    (Key::A, [-1.0, 0.0, 0.0]),
    (Key::E, [0.0, 1.0, 0.0]),
    (Key::Q, [0.0, -1.0, 0.0]),
    (Key::W, [0.0, 0.0, 1.0]),
    (Key::S, [0.0, 0.0, -1.0]),
];

/// How the camera is moved; remembered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Habits {
    /// Whose gestures.
    pub navigation: Navigation,
    /// Whether W, A, S and D walk.
    pub walks: bool,
}

/// What is shown of a camera in hand.
pub struct FlightView<'a> {
    /// The scene.
    pub scene: &'a PreparedScene,
    /// What the camera sees: the quick picture, or the baked one where it is of this camera.
    pub picture: Option<TextureId>,
    /// Whether it is the baked one.
    pub is_baked: bool,
    /// Shape of the picture to bake.
    pub film: Film,
    /// How it is moved.
    pub habits: Habits,
    /// Whether a bake runs.
    pub is_baking: bool,
}

/// Draws it and moves the camera.
pub fn flight_ui(ui: &mut Ui, view: &FlightView, zoom: &Zoom, flight: &mut Flight, actions: &mut Vec<Action>) {
    let area = ui.available_rect_before_wrap();
    let response = ui.allocate_rect(area, Sense::click_and_drag());
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, "View of the camera"));
    let size = vec2(view.film.width as f32, view.film.height as f32);
    let image = zoom.image_rect(area, size);
    let painter = ui.painter_at(area);
    painter.rect_filled(area, 0.0, theme::SURROUND);
    if let Some(picture) = view.picture {
        painter.image(picture, image, Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0)), Color32::WHITE);
    }
    painter.rect_stroke(image, 0.0, egui::Stroke::new(2.0, theme::ACCENT), egui::StrokeKind::Outside);
    drags(ui, &response, view, flight, image.height());
    scrolls(ui, &response, view, flight, image.height());
    if view.habits.walks {
        walk(ui, view.scene, flight);
    }
    if escapes(ui) {
        actions.push(Action::LeaveCamera);
    }
    banner_ui(ui, area, view, actions);
}

fn drags(ui: &Ui, response: &Response, view: &FlightView, flight: &mut Flight, height: f32) {
    if response.drag_started() {
        look_ahead(view.scene, flight);
    }
    let keys = ui.input(|input| input.modifiers);
    for button in [PointerButton::Primary, PointerButton::Middle, PointerButton::Secondary] {
        let turn = view.habits.navigation.of_drag(button, keys);
        if let Some(turn) = turn.filter(|_| response.dragged_by(button) && response.drag_delta() != egui::Vec2::ZERO) {
            flight.moved(turn, response.drag_delta(), height);
            ui.ctx().set_cursor_icon(CursorIcon::Grabbing);
        }
    }
    // The wheel counts by what is in the middle then.
    if response.drag_stopped() {
        look_ahead(view.scene, flight);
    }
}

/// Finds how far away that is which lies in the middle now, if anything does.
fn look_ahead(scene: &PreparedScene, flight: &mut Flight) {
    flight.pivot_m = pivot_m(scene, &flight.camera, flight.film).unwrap_or(flight.pivot_m);
}

fn scrolls(ui: &Ui, response: &Response, view: &FlightView, flight: &mut Flight, height: f32) {
    if !response.hovered() {
        return;
    }
    let (pinch, turn) = ui.input(|input| (input.zoom_delta(), view.habits.navigation.of_scroll(input.modifiers)));
    let scroll = ui.input(|input| if turn == Turn::Pan { both_ways(input) } else { input.smooth_scroll_delta() });
    if scroll != egui::Vec2::ZERO {
        flight.scrolled(turn, scroll, height);
    }
    if pinch != 1.0 {
        flight.dolly(1.0 / pinch);
    }
}

/// Points that were scrolled, as they came: with Shift the toolkit makes all of it a way to the side.
fn both_ways(input: &InputState) -> egui::Vec2 {
    let points = |event: &Event| match event {
        Event::MouseWheel { unit: MouseWheelUnit::Point, delta, .. } => *delta,
        Event::MouseWheel { delta, .. } => *delta * POINTS_PER_LINE,
        _ => egui::Vec2::ZERO,
    };
    input.events.iter().map(points).fold(egui::Vec2::ZERO, |sum, delta| sum + delta)
}

fn walk(ui: &Ui, scene: &PreparedScene, flight: &mut Flight) {
    if !hears_keys(ui) {
        return;
    }
    let (held, dt, runs) = ui.input(|input| {
        let held = KEYS.iter().filter(|(key, _)| input.key_down(*key) && !input.modifiers.command);
        let sum = held.fold([0.0f32; 3], |sum, (_, step)| [sum[0] + step[0], sum[1] + step[1], sum[2] + step[2]]);
        (sum, input.stable_dt.min(0.1), input.modifiers.shift)
    });
    if held != [0.0; 3] {
        let step = WALK_PER_SEC * scene.diameter() * dt * if runs { RUN } else { 1.0 };
        flight.walk(held.map(|way| way * step));
        look_ahead(scene, flight);
        ui.ctx().request_repaint();
    }
}

/// Distance along the axis to what is in the middle of the picture.
pub fn pivot_m(scene: &PreparedScene, camera: &Camera, film: Film) -> Option<f32> {
    let middle = middle(camera, film);
    let surface = surface_along(scene, camera.position(), middle.normalize())?;
    Some(surface.position.distance(camera.position()) / middle.length()).filter(|distance| *distance > 1e-3)
}

/// Says plainly what is seen, and what to do about it.
fn banner_ui(ui: &mut Ui, area: Rect, view: &FlightView, actions: &mut Vec<Action>) {
    let words = match (view.is_baked, view.is_baking) {
        (true, _) => view.habits.navigation.in_hand(),
        (false, true) => "Preview of a new view. A bake is running; baking this view ends it",
        (false, false) => "Preview of a new view. Its light needs a new bake",
    };
    let place = Rect::from_center_size(area.center_top() + vec2(0.0, 30.0), vec2(area.width().min(640.0), 40.0));
    let builder = egui::UiBuilder::new().max_rect(place).layout(egui::Layout::top_down(egui::Align::Center));
    // In a narrow picture the buttons stay in sight.
    let most = (area.width() - BESIDE_WORDS).max(LEAST_WORDS);
    ui.scope_builder(builder, |ui| {
        egui::Frame::window(ui.style()).inner_margin(egui::Margin::symmetric(12, 6)).show(ui, |ui| {
            ui.horizontal(|ui| {
                ui.scope(|ui| {
                    ui.set_max_width(most);
                    ui.add(egui::Label::new(RichText::new(words).strong()).truncate());
                });
                if !view.is_baked {
                    let bake = Button::new(RichText::new("Bake this view").color(theme::ON_ACCENT)).fill(theme::ACCENT);
                    if ui.add(bake).on_hover_text("Looks and lights stay as they are").clicked() {
                        actions.push(Action::StartBake);
                    }
                }
                let back = if view.is_baked { "Done" } else { "Back" };
                if ui.button(back).on_hover_text("Esc, to the baked picture").clicked() {
                    actions.push(Action::LeaveCamera);
                }
            });
        });
    });
}

#[cfg(test)]
mod tests {
    use egui_kittest::Harness;

    use super::*;
    use crate::support::{prepared_room, pull};
    use crate::viewport::orbit::nearest_m;

    #[test]
    fn who_has_looked_around_comes_nearer_to_what_is_in_the_middle_now() {
        let (scene, film) = (prepared_room(), Film { width: 64, height: 48 });
        let habits = Habits::default();
        let view = FlightView { scene: &scene, picture: None, is_baked: true, film, habits, is_baking: false };
        let camera = scene.scene.cameras[0].clone();
        let flight = Flight { camera, pivot_m: 1.9, nearest_m: nearest_m(scene.extent()), film };
        let in_hand = |ui: &mut Ui, flight: &mut Flight| {
            flight_ui(ui, &view, &Zoom::default(), flight, &mut Vec::new());
        };
        let mut window = Harness::builder().with_size(vec2(600.0, 400.0)).build_ui_state(in_hand, flight);
        let (from, to) = (pos2(150.0, 250.0), pos2(450.0, 250.0));
        pull(&mut window, from, to);
        window.drop_at(to);
        window.run_steps(3);
        let flight = window.state();
        let ahead = pivot_m(&scene, &flight.camera, film).unwrap();
        assert!(ahead < 1.6 && (flight.pivot_m - ahead).abs() < 1e-3, "{} for {ahead}", flight.pivot_m);
    }

    #[test]
    fn how_far_the_middle_of_the_picture_is_counts_along_the_axis() {
        let (scene, film) = (prepared_room(), Film { width: 64, height: 48 });
        let level = scene.scene.cameras[0].clone();
        assert!((pivot_m(&scene, &level, film).unwrap() - 1.9).abs() < 1e-3);
        // Up by the lens: in the middle is the ceiling, half a meter away as the axis goes.
        let height = 2.0 * (0.5 * level.yfov_rad).tan();
        let up = Camera { shift: [0.0, (1.0 - level.position().y) / (0.5 * height)], ..level };
        let found = pivot_m(&scene, &up, film).unwrap();
        assert!((found - 0.5).abs() < 1e-3, "{found}");
    }
}
