//! The picture: which part of it is shown, spots and lamps that are dragged in it, and what is measured there.

pub mod compare;
pub mod flight;
pub mod gizmo;
pub mod handles;
pub mod isolux;
pub mod lamps;
pub mod marking;
pub mod names;
pub mod orbit;
pub mod placing;
pub mod probe;
pub mod zoom;

use clerestory_transport::camera::{Camera, Film};
use clerestory_transport::prepared::PreparedScene;
use eframe::egui::{
    self, Color32, CursorIcon, PointerButton, Rect, Response, RichText, Sense, TextureId, Ui, pos2, vec2,
};

use crate::action::{Action, FileTask};
use crate::isolux::{Isoline, Isolux};
use crate::legend::Legend;
use crate::look::Look;
use crate::panels::arrows::{FINE, arrows};
use crate::panels::heat::Overlay;
use crate::panels::lights::LightsState;
use crate::panels::spots::key_step;
use crate::session::{BakeState, Stage};
use crate::theme;
use compare::{Compared, Way};
use gizmo::Sight;
use handles::{Grab, PanelPicker};
use marking::{Marking, marking_ui};
use probe::{Grid, Probes, Readings};
use zoom::Zoom;

/// What is shown.
pub struct Viewed<'a> {
    /// The picture and its size in pixels.
    pub picture: Option<(TextureId, [u32; 2])>,
    /// Where opening stands.
    pub stage: &'a Stage,
    /// Where the bake stands.
    pub bake: &'a BakeState,
    /// Whether the picture is a first look with few pixels.
    pub is_glimpse: bool,
    /// Scene and camera of the picture, where they are known.
    pub scene: Option<(&'a PreparedScene, &'a Camera)>,
    /// What its colors mean, where they are false.
    pub legend: Option<Legend>,
    /// Lines of equal illuminance in it.
    pub isolines: &'a [Isoline],
    /// What it is compared with.
    pub compared: Option<Compared>,
    /// A map of colors over it.
    pub overlay: Option<Overlay>,
    /// What was measured in it.
    pub readings: &'a Readings,
}

/// How it is looked at.
#[derive(Clone, Debug, Default)]
pub struct ViewState {
    /// Which part is shown, and how large.
    pub zoom: Zoom,
    /// Where is measured.
    pub probes: Probes,
    /// What the pointer holds.
    grab: Option<Grab>,
    /// Way of the divider of a comparison from the middle, in widths of the picture.
    divider: f32,
    /// What is marked, and how.
    pub marking: Marking,
}

/// Draws picture and handles, or says in words what is going on.
pub fn viewport_ui(
    ui: &mut Ui,
    viewed: &Viewed,
    state: &mut ViewState,
    look: &mut Look,
    lights: &mut LightsState,
    actions: &mut Vec<Action>,
) {
    let whole = ui.available_rect_before_wrap();
    ui.painter().rect_filled(whole, 0.0, theme::SURROUND);
    let area = compare::left_area(whole, viewed.compared.as_ref());
    let Some((texture, [width, height])) = viewed.picture else {
        words_ui(ui, area, viewed, actions);
        return;
    };
    let response = ui.allocate_rect(area, Sense::click_and_drag());
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, "Picture"));
    let size = vec2(width as f32, height as f32);
    state.zoom.heed_size(size, ui.pixels_per_point());
    zoom::navigate(ui, &response, (&mut state.zoom, &mut state.grab), size);
    let image = state.zoom.image_rect(area, size);
    let painter = ui.painter_at(area);
    painter.image(texture, image, Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0)), Color32::WHITE);
    if let Some(overlay) = viewed.overlay {
        overlay.paint(&painter, image);
    } else if viewed.legend.is_some_and(|legend| legend.isolux != Isolux::Off) && viewed.compared.is_none() {
        isolux::isolux_ui(ui, viewed.isolines, (area, image), [width, height]);
    }
    let marks = state.grab.is_none() && marking_ui(ui, &response, image, Film { width, height }, &mut state.marking);
    let mut is_free = !marks;
    if marks {
        // The pointer marks: lamps, spots and probes wait.
    } else if let Some((scene, camera)) = viewed.scene {
        let film = Film { width, height };
        let picker = PanelPicker { scene, camera, film, image };
        let sight = Sight { scene, camera, film, image };
        is_free = !lamps::lamps_ui(ui, &response, &sight, look, &mut lights.lamps, actions);
        if !lights.lamps.aiming && lights.lamps.drag.is_none() {
            is_free &= !names::marks_ui(ui, &response, &sight, look, lights, actions);
            if lights.lamps.pulled_at.is_none() {
                drag_spots(ui, &response, &picker, state, look, &mut lights.spot);
            }
            names::surface_hint(ui, &response, &sight, look);
        }
        picker.paint(&painter, look, lights.spot.as_ref());
    } else if state.grab.is_none() && response.drag_started_by(PointerButton::Primary) {
        state.grab = Some(Grab::Picture);
    }
    if let Some(compared) = &viewed.compared {
        let right = compare::right_area(whole, area);
        match compared.way {
            Way::SideBySide => {
                let images = [image, state.zoom.image_rect(right, size)];
                compare::beside_ui(ui, (compared, viewed.overlay), [area, right], images);
            }
            Way::Wipe => compare::wipe_ui(ui, (compared, viewed.overlay), area, image, &mut state.divider),
        }
    }
    zoom::paint_region(ui, &response, state.grab.as_ref());
    let grid = Grid { image, size: [width, height] };
    probe::follow(ui, &response, grid, &mut state.probes, is_free);
    probe::readings_ui(ui, &response, grid, viewed.readings, &mut state.probes, (look, lights));
    if let Some(words) = viewed.overlay.and_then(|overlay| overlay.hovered_words()) {
        probe::block_ui(ui, &response, &words);
    }
    match (viewed.overlay, viewed.legend) {
        (Some(overlay), _) => overlay.bar.ui(ui, area),
        (None, Some(legend)) => legend.ui(ui, area),
        (None, None) => {}
    }
    let is_coarse = viewed.is_glimpse && viewed.bake.is_running();
    if is_coarse || matches!(viewed.stage, Stage::Loading(_)) || *viewed.bake == BakeState::Preparing {
        busy_corner(ui, area, &busy_words(viewed));
    }
}

/// A press on a panel takes the spot under it, or the nearest, or makes the first one; elsewhere it takes the picture.
fn drag_spots(
    ui: &Ui,
    response: &Response,
    picker: &PanelPicker,
    state: &mut ViewState,
    look: &mut Look,
    chosen: &mut Option<(String, usize)>,
) {
    if state.grab.is_none() && response.drag_started_by(PointerButton::Primary) {
        let press = ui.input(|input| input.pointer.press_origin());
        state.grab = Some(press.and_then(|at| picker.grab(at, look)).unwrap_or(Grab::Picture));
    }
    if let Some(Grab::Spot { panel, idx }) = &state.grab {
        if let Some(at) = response.interact_pointer_pos() {
            picker.drag(panel, *idx, at, look);
        }
        *chosen = Some((panel.clone(), *idx));
        response.request_focus();
        ui.ctx().set_cursor_icon(CursorIcon::Grabbing);
    }
    nudge_spot(ui, response, picker, look, chosen.as_ref());
    if response.double_clicked() {
        match response.interact_pointer_pos().and_then(|at| picker.add(at, look)) {
            Some(added) => *chosen = Some(added),
            None => state.zoom.fit(),
        }
    }
    let idle = state.grab.is_none();
    if let Some(hint) = response.hover_pos().filter(|_| idle).and_then(|at| picker.hint(at, look)) {
        ui.ctx().set_cursor_icon(CursorIcon::Grab);
        lamps::hint(ui, response.rect, &hint);
    }
}

/// Arrow keys move the chosen spot while the picture has the focus, which a press on a spot gives it.
fn nudge_spot(ui: &Ui, response: &Response, picker: &PanelPicker, look: &mut Look, chosen: Option<&(String, usize)>) {
    let Some((panel, idx)) = chosen else { return };
    let arrows = arrows(ui, response, FINE);
    if arrows != egui::Vec2::ZERO {
        picker.nudge(panel, *idx, arrows, key_step, look);
    }
}

fn busy_words(viewed: &Viewed) -> String {
    match (viewed.stage, viewed.bake) {
        (Stage::Loading(name), _) => format!("Opening {name}"),
        _ if viewed.is_glimpse && viewed.picture.is_some() => "A first look: sharper in a moment".into(),
        (_, BakeState::Preparing) => "Measuring the lights".into(),
        (_, BakeState::Running { .. }) => "Baking the first picture".into(),
        _ => "Preparing the picture".into(),
    }
}

/// A small sign that something new is on its way, on a dark ground: the picture may be bright there.
fn busy_corner(ui: &mut Ui, area: Rect, words: &str) {
    let place = Rect::from_min_size(area.left_top() + vec2(8.0, 8.0), vec2(280.0, 30.0));
    let ground = egui::Frame::NONE.fill(Color32::from_black_alpha(185)).corner_radius(4).inner_margin(5);
    ui.scope_builder(egui::UiBuilder::new().max_rect(place), |ui| {
        ui.horizontal(|ui| {
            ground.show(ui, |ui| {
                theme::busy(ui, 16.0);
                ui.label(RichText::new(words).color(Color32::from_gray(220)));
            });
        });
    });
}

/// What to see while there is no picture.
fn words_ui(ui: &mut Ui, area: Rect, viewed: &Viewed, actions: &mut Vec<Action>) {
    let bright = Color32::from_gray(225);
    let dim = Color32::from_gray(150);
    let place = Rect::from_center_size(area.center(), vec2((area.width() - 40.0).min(520.0), 150.0));
    ui.allocate_rect(area, Sense::hover());
    ui.scope_builder(
        egui::UiBuilder::new().max_rect(place).layout(egui::Layout::top_down(egui::Align::Center)),
        |ui| {
            let title = |ui: &mut Ui, words: &str| {
                ui.label(RichText::new(words).size(18.0).color(bright));
                ui.add_space(6.0);
            };
            let open = |ui: &mut Ui, actions: &mut Vec<Action>| {
                ui.add_space(10.0);
                if ui.button("Open another scene…").clicked() {
                    actions.push(Action::Ask(FileTask::OpenScene));
                }
            };
            match (viewed.stage, viewed.bake) {
                (Stage::Empty, _) => {
                    title(ui, "Nothing is open");
                    ui.label(RichText::new("Drop a glTF file or a folder of pictures here").color(dim));
                    open(ui, actions);
                }
                (Stage::Failed(name, why), _) => {
                    title(ui, &format!("Could not open {name}"));
                    ui.label(RichText::new(why).color(dim));
                    open(ui, actions);
                }
                (Stage::Ready, BakeState::Failed(why)) => {
                    title(ui, "The bake failed");
                    ui.label(RichText::new(why).color(dim));
                    open(ui, actions);
                }
                (Stage::Ready, BakeState::Idle | BakeState::Stopped) => {
                    title(ui, "No picture yet");
                    ui.label(RichText::new("Start the bake").color(dim));
                }
                _ => {
                    theme::busy(ui, 30.0);
                    ui.add_space(10.0);
                    ui.label(RichText::new(busy_words(viewed)).size(15.0).color(bright));
                }
            }
        },
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_on_its_way_can_be_read_over_a_bright_picture() {
        let area = Rect::from_min_size(pos2(0.0, 0.0), vec2(640.0, 480.0));
        let input = egui::RawInput { screen_rect: Some(area), ..egui::RawInput::default() };
        let output = egui::Context::default().run_ui(input, |ui| busy_corner(ui, area, "on its way"));
        let shapes = || output.shapes.iter().map(|clipped| &clipped.shape);
        let words = shapes().find_map(|shape| match shape {
            egui::Shape::Text(text) => Some(text.visual_bounding_rect()),
            _ => None,
        });
        let words = words.expect("words are drawn");
        let is_ground = |shape: &egui::Shape| match shape {
            egui::Shape::Rect(rect) => rect.rect.contains_rect(words) && rect.fill.a() > 150,
            _ => false,
        };
        assert!(shapes().any(is_ground), "{words}");
    }
}
