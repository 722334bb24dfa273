//! Where the picture is seen from: baked views, cameras of the file, bookmarks, and the numbers of the view.

use clerestory_transport::camera::{Camera, Film, Pose};
use eframe::egui::{self, Button, ComboBox, Grid, Key, RichText, TextEdit, Ui};

use super::number::{Number, step_m};
use crate::action::Action;
use crate::look::bookmarks::has_room;
use crate::look::numbered_name;
use crate::session::views::{ViewEntry, sees_alike};
use crate::sizes::bytes_words;
use crate::theme::{self, Fold};
use crate::viewport::flight::Habits;
use crate::viewport::orbit::Navigation;

/// What the section shows.
pub struct CameraView<'a> {
    /// Cameras of the file.
    pub cameras: &'a [Camera],
    /// Views that are baked.
    pub views: &'a [ViewEntry],
    /// Shape of the picture.
    pub film: Film,
    /// Whether the camera is in hand.
    pub is_moving: bool,
    /// Diagonal of the scene, m, where it is known.
    pub extent_m: Option<f32>,
}

/// What the section sets.
pub struct CameraEdit<'a> {
    /// The present view; none without a scene.
    pub camera: Option<&'a mut Camera>,
    /// Views to come back to.
    pub bookmarks: &'a mut Vec<Camera>,
    /// How the camera is moved.
    pub habits: &'a mut Habits,
}

/// Where a camera may be put along an axis, meters: as far as a look keeps it.
const PLACE_M: std::ops::RangeInclusive<f32> = -1e6..=1e6;
/// Width of the film that a focal length is told for, millimeters.
const FILM_MM: f32 = 36.0;
/// Said where a look holds as many bookmarks as it can.
const FULL: &str = "There are as many bookmarks as a look holds; remove one first";
/// Field of view, degrees.
const FOV_DEG: std::ops::RangeInclusive<f32> = 1.0..=170.0;

/// Draws it.
pub fn camera_ui(ui: &mut Ui, view: &CameraView, edit: CameraEdit, actions: &mut Vec<Action>) {
    theme::folding(ui, "Camera", Fold::Open, |ui| {
        let Some(camera) = edit.camera else {
            ui.label(RichText::new("Open a scene to look around in it; a bake alone has one view").weak());
            return;
        };
        mode_ui(ui, view, camera, actions);
        choice_ui(ui, view, camera, edit.bookmarks, actions);
        views_ui(ui, view.views, actions);
        egui::CollapsingHeader::new("Numbers").id_salt("view numbers").show(ui, |ui| numbers_ui(ui, camera, view));
        egui::CollapsingHeader::new("Navigation").id_salt("habits").show(ui, |ui| habits_ui(ui, edit.habits));
    });
}

/// Takes the camera in hand, and levels it.
fn mode_ui(ui: &mut Ui, view: &CameraView, camera: &mut Camera, actions: &mut Vec<Action>) {
    ui.horizontal_wrapped(|ui| {
        let toggle = Button::new("Move camera").selected(view.is_moving);
        let hint =
            "Look for another view in a quick preview, C\nA new view needs a bake of its own; looks and lights stay";
        if ui.add(toggle).on_hover_text(hint).clicked() {
            actions.push(Action::ToggleCamera);
        }
        let hint = "Levels the camera and shifts the lens instead, so that vertical edges are vertical in the picture";
        if ui.button("Straighten verticals").on_hover_text(hint).clicked() {
            *camera = camera.upright();
        }
    });
}

/// Cameras of the file and bookmarks.
fn choice_ui(ui: &mut Ui, view: &CameraView, camera: &Camera, bookmarks: &mut Vec<Camera>, actions: &mut Vec<Action>) {
    row_ui(ui, |ui| {
        let button = ui.add_enabled(has_room(bookmarks), Button::new("Bookmark"));
        if button.on_hover_text("Keep this view in the look").on_disabled_hover_text(FULL).clicked() {
            let is_taken = |name: &str| view.cameras.iter().chain(&*bookmarks).any(|known| known.name == name);
            let name = numbered_name("Bookmark", is_taken);
            bookmarks.push(Camera { name: name.clone(), ..camera.clone() });
            // It is seen that the view is kept, and can be renamed at once.
            actions.push(Action::NameView(name));
        }
        known_ui(ui, view.cameras, camera, bookmarks, actions);
    });
    let Some(idx) = bookmarks.iter().position(|other| other == camera) else { return };
    row_ui(ui, |ui| {
        let is_over = ui.button("Remove").on_hover_text("Give this bookmark up").clicked();
        if let Some(name) = bookmark_name_ui(ui, (view.cameras, bookmarks), idx) {
            bookmarks[idx].name.clone_from(&name);
            actions.push(Action::NameView(name));
        }
        if is_over {
            bookmarks.remove(idx);
        }
    });
}

/// The name of a bookmark; answers with another one once it is typed. None but its own view may have it.
fn bookmark_name_ui(ui: &mut Ui, (cameras, bookmarks): (&[Camera], &[Camera]), idx: usize) -> Option<String> {
    let now = &bookmarks[idx].name;
    let id = ui.scope_id().with("bookmark name");
    let mut name = ui.data(|data| data.get_temp(id)).unwrap_or_else(|| now.clone());
    let edit = ui.add(TextEdit::singleline(&mut name).desired_width(ui.available_width() - 12.0));
    let edit = edit.accessible_name("Name of the bookmark");
    let wanted = name.trim().to_owned();
    let others = bookmarks.iter().enumerate().filter(|(other, _)| *other != idx).map(|(_, bookmark)| bookmark);
    let is_free = cameras.iter().chain(others).all(|view| view.name != wanted);
    if edit.has_focus() {
        if !is_free {
            edit.show_tooltip_text("Another view has this name");
        }
        ui.data_mut(|data| data.insert_temp(id, name));
        return None;
    }
    ui.data_mut(|data| data.remove_temp::<String>(id));
    // Assistive technology sets it without the focus.
    let is_wanted = edit.changed() || (edit.lost_focus() && !ui.input(|input| input.key_pressed(Key::Escape)));
    (is_wanted && is_free && !wanted.is_empty() && wanted != *now).then_some(wanted)
}

/// A row that is filled from the right, so that what comes last takes the room that is left.
fn row_ui(ui: &mut Ui, content: impl FnOnce(&mut Ui)) {
    let size = egui::vec2(ui.available_width(), ui.spacing().interact_size.y);
    ui.allocate_ui_with_layout(size, egui::Layout::right_to_left(egui::Align::Center), content);
}

/// The views that there are to choose from.
fn known_ui(ui: &mut Ui, cameras: &[Camera], camera: &Camera, bookmarks: &[Camera], actions: &mut Vec<Action>) {
    let known = || cameras.iter().chain(bookmarks);
    let own = known().find(|known| *known == camera).or_else(|| known().find(|known| sees_alike(known, camera)));
    let name = own.map_or("Free view", |known| known.name.as_str());
    let width = ui.available_width().max(40.0);
    let combo = ComboBox::from_id_salt("cameras").width(width).truncate().selected_text(name);
    let response = combo.show_ui(ui, |ui| {
        for (idx, known) in cameras.iter().chain(bookmarks).enumerate() {
            if idx > 0 && idx == cameras.len() {
                ui.separator();
            }
            if ui.selectable_label(known == camera, &known.name).clicked() {
                actions.push(Action::LookFrom(Box::new(known.clone())));
            }
        }
    });
    response.response.on_hover_text("Cameras of the file, and bookmarks").accessible_name("View");
}

/// Views that are baked: a click shows one at once.
fn views_ui(ui: &mut Ui, views: &[ViewEntry], actions: &mut Vec<Action>) {
    if views.len() < 2 {
        return;
    }
    let total: usize = views.iter().filter_map(|view| view.bytes).sum();
    ui.add_space(2.0);
    ui.label(RichText::new(format!("{} baked views, {} in memory", views.len(), bytes_words(total as u64))).weak());
    for view in views {
        row_ui(ui, |ui| view_ui(ui, view, actions));
        // Views of one camera are told apart by it.
        ui.label(RichText::new(size_words(view)).weak().small());
    }
}

/// Size and memory of a view, which is not counted at once.
fn size_words(view: &ViewEntry) -> String {
    let size = format!("{} × {}", view.film.width, view.film.height);
    view.bytes.map_or(size.clone(), |n| format!("{size}, {} in memory", bytes_words(n as u64)))
}

fn view_ui(ui: &mut Ui, view: &ViewEntry, actions: &mut Vec<Action>) {
    let can_go = !view.is_shown && !view.is_baking;
    let close = ui.add_enabled(can_go, Button::new("×").small());
    let close = close.on_hover_text("Free its memory").accessible_name(format!("Forget view {}", view.name));
    if close.on_disabled_hover_text("The view that is shown stays, and the one that is baked").clicked() {
        actions.push(Action::ForgetView(view.id));
    }
    let figures = match (view.is_baking, view.is_done, view.error_db) {
        (true, ..) => "baking".into(),
        (_, true, Some(db)) => format!("{db:.1} dB"),
        (_, true, None) => String::new(),
        (_, false, Some(db)) => format!("{db:.1} dB, stopped"),
        (_, false, None) => "stopped".into(),
    };
    ui.label(RichText::new(figures).weak());
    ui.with_layout(egui::Layout::left_to_right(egui::Align::Center), |ui| {
        let row = ui.add(Button::selectable(view.is_shown, &view.name).truncate());
        if row.on_hover_text(size_words(view)).accessible_name(format!("Show view {}", view.name)).clicked() {
            actions.push(Action::ShowView(view.id));
        }
    });
}

/// Position, angles, lens and shift.
fn numbers_ui(ui: &mut Ui, camera: &mut Camera, view: &CameraView) {
    let before = Pose::of(camera);
    let mut pose = before;
    Grid::new("view numbers").num_columns(2).spacing([10.0, 5.0]).show(ui, |ui| {
        // Each in a row of its own: the panel may be narrow.
        let axes = [("X", &mut pose.position.x), ("Y", &mut pose.position.y), ("Z", &mut pose.position.z)];
        let (speed, digits) = step_m(0.02, 2, view.extent_m);
        for (axis, meters) in axes {
            ui.label(format!("Position {axis}"));
            let number = Number::new(meters).range(PLACE_M).leaves_what_is_outside().speed(speed);
            let hint = format!("{axis} in meters; Y points up");
            ui.add(number.max_decimals(digits).suffix(" m"))
                .on_hover_text(hint)
                .accessible_name(format!("Camera {axis}"));
            ui.end_row();
        }
        let angles = [
            ("Yaw", &mut pose.yaw_rad, "0° looks along −Z, 90° along +X", -360.0..=360.0),
            ("Pitch", &mut pose.pitch_rad, "Above the horizon", -90.0..=90.0),
            ("Roll", &mut pose.roll_rad, "Leaning to the left", -180.0..=180.0),
        ];
        for (name, radians, hint, range) in angles {
            ui.label(name);
            degrees_ui(ui, radians, range).on_hover_text(hint).accessible_name(name);
            ui.end_row();
        }
        lens_ui(ui, camera, view.film);
        for (axis, idx, hint) in [("Shift X", 0, "To the right"), ("Shift Y", 1, "Up")] {
            ui.label(axis);
            let range = -Camera::MOST_SHIFT..=Camera::MOST_SHIFT;
            let number = Number::new(&mut camera.shift[idx]).speed(0.002).range(range).max_decimals(3);
            let hint = format!("{hint}, in {} of the picture", ["widths", "heights"][idx]);
            ui.add(number).on_hover_text(hint).accessible_name(axis);
            ui.end_row();
        }
    });
    if pose != before {
        *camera = camera.posed(&pose);
    }
    let hint = "Copies this view as options of the command line";
    if ui.button("Copy as options").on_hover_text(hint).clicked() {
        ui.ctx().copy_text(option_words(camera));
    }
}

fn degrees_ui(ui: &mut Ui, radians: &mut f32, range: std::ops::RangeInclusive<f32>) -> egui::Response {
    let mut degrees = radians.to_degrees();
    // Rounded first, and plus zero: there is but one zero.
    let words =
        |degrees: f64, _: std::ops::RangeInclusive<usize>| format!("{:.1}", (10.0 * degrees).round() / 10.0 + 0.0);
    let number = Number::new(&mut degrees).speed(0.2).range(range).leaves_what_is_outside().words(words).suffix("°");
    let response = ui.add(number);
    if response.changed() {
        *radians = degrees.to_radians();
    }
    response
}

/// The angle of view, and the focal length that makes it.
fn lens_ui(ui: &mut Ui, camera: &mut Camera, film: Film) {
    ui.label("Field of view");
    degrees_ui(ui, &mut camera.yfov_rad, FOV_DEG).on_hover_text("From top to bottom").accessible_name("Field of view");
    ui.end_row();
    ui.label("Focal length");
    let aspect = film.width as f32 / film.height as f32;
    let mut focal_mm = 0.5 * FILM_MM / ((0.5 * camera.yfov_rad).tan() * aspect);
    // An angle of view may have one beyond that, which its own field tells.
    let number = Number::new(&mut focal_mm).speed(0.1).range(2.0..=2000.0).leaves_what_is_outside();
    let response = ui
        .add(number.max_decimals(1).suffix(" mm"))
        .on_hover_text("On film 36 mm wide")
        .accessible_name("Focal length");
    if response.changed() {
        camera.yfov_rad = 2.0 * (0.5 * FILM_MM / (focal_mm * aspect)).atan();
    }
    ui.end_row();
}

/// How the camera is moved; remembered from one session to the next.
fn habits_ui(ui: &mut Ui, habits: &mut Habits) {
    for (navigation, name, hint) in Navigation::ALL {
        ui.radio_value(&mut habits.navigation, navigation, name).on_hover_text(hint);
    }
    let hint = "W, A, S and D walk, E and Q go up and down, Shift runs";
    ui.checkbox(&mut habits.walks, "Walk with W A S D").on_hover_text(hint);
}

/// The view as the command line takes it.
pub fn option_words(camera: &Camera) -> String {
    let Pose { position, yaw_rad, pitch_rad, roll_rad } = Pose::of(camera);
    let angles = [yaw_rad, pitch_rad, camera.yfov_rad, roll_rad].map(f32::to_degrees);
    // In a model of centimeters four digits behind the point are another place.
    let place = position.to_array().into_iter().map(|meters| meters.to_string());
    let numbers: Vec<String> = place.chain(angles.into_iter().map(|degrees| format!("{degrees:.4}"))).collect();
    let view = format!("--view={}", numbers.join(","));
    match camera.shift {
        [0.0, 0.0] => view,
        [x, y] => format!("{view} --shift={x:.5},{y:.5}"),
    }
}
