//! The picture: which part of it is shown, spots and lamps that are dragged in it, and what is measured there.

pub mod compare;
pub mod flight;
pub mod gizmo;
pub mod handles;
pub mod isolux;
mod keyed;
pub mod lamps;
pub mod marking;
pub mod names;
pub mod orbit;
pub mod placing;
pub mod probe;
pub mod zoom;

use clerestory_transport::basis::LightBasis;
use clerestory_transport::camera::{Camera, Film};
use clerestory_transport::prepared::PreparedScene;
use eframe::egui::{
    self, Color32, CursorIcon, Key, PointerButton, Pos2, Rect, Response, RichText, Sense, TextureId, Ui, pos2, vec2,
};

use crate::action::{Action, FileTask};
use crate::isolux::{Isoline, Isolux};
use crate::legend::{Corner, Legend};
use crate::look::Look;
use crate::panels::arrows::{FINE, arrows};
use crate::panels::heat::Overlay;
use crate::panels::lamps::add_menu;
use crate::panels::lights::LightsState;
use crate::panels::menu::{context_menu, is_asked};
use crate::panels::shortcuts::hears_keys;
use crate::panels::spots::key_step;
use crate::session::{BakeState, Stage};
use crate::theme;
use compare::{Compared, Way};
use gizmo::Sight;
use handles::{Grab, PanelPicker};
use marking::{Marking, marking_ui};
use orbit::Navigation;
use probe::{Grid, Plate, Probes, Readings};
use zoom::Zoom;

/// What is shown.
pub struct Viewed<'a> {
    /// The picture and its size in pixels.
    pub picture: Option<(TextureId, [u32; 2])>,
    /// Where opening stands.
    pub stage: &'a Stage,
    /// Where the bake stands.
    pub bake: &'a BakeState,
    /// Whether the picture is a first look, traced at few pixels.
    pub is_glimpse: bool,
    /// Scene and camera of the picture, where they are known and lights can be dragged in it.
    pub scene: Option<(&'a PreparedScene, &'a Camera)>,
    /// The lights that the picture is made of: a scene may have others by now.
    pub baked: Option<&'a LightBasis>,
    /// Side of a comparison on which they can, 0 without one.
    pub handled: usize,
    /// Whose gestures move it.
    pub navigation: Navigation,
    /// What its colors mean, where they are false, and those of what is seen on the right of a comparison.
    pub legends: [Option<Legend>; 2],
    /// Lines of equal illuminance in it.
    pub isolines: &'a [Isoline],
    /// What it is compared with.
    pub compared: Option<Compared>,
    /// A map of colors over it.
    pub overlay: Option<Overlay>,
    /// What was measured in it, on the left and on the right of a comparison; without one on the left.
    pub readings: &'a [Readings; 2],
}

impl Viewed<'_> {
    /// What is seen on the left and on the right of a comparison.
    fn names(&self) -> Option<&[String; 2]> {
        self.compared.as_ref().map(|compared| &compared.names)
    }
}

/// Of the picture, and of what is seen beside it.
const NAMES: [&str; 2] = ["Picture", "Picture on the right"];

/// How it is looked at.
#[derive(Clone, Debug, Default)]
pub struct ViewState {
    /// Which part is shown, and how large.
    pub zoom: Zoom,
    /// Where is measured.
    pub probes: Probes,
    /// What the pointer holds.
    grab: Option<Grab>,
    /// Whether arrow keys move the spot that was pressed last: for as long as the picture keeps the keyboard.
    nudges_spot: bool,
    /// Way of the divider of a comparison from the middle, in widths of the picture.
    divider: f32,
    /// What is marked, and how.
    pub marking: Marking,
    /// The part of the picture that is in sight, as shares of its width and height; none where that is all or nothing of it.
    pub seen: Option<[[f32; 2]; 2]>,
}

impl ViewState {
    /// Lets go of what the pointer holds: it stays where it is.
    pub fn let_go(&mut self) {
        self.grab = None;
        self.marking.let_go();
    }
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
    let areas = compare::areas(whole, viewed.compared.as_ref());
    let Some((texture, [width, height])) = viewed.picture else {
        // Where its button comes up is not seen here.
        state.let_go();
        words_ui(ui, areas[0], viewed, actions);
        return;
    };
    let size = vec2(width as f32, height as f32);
    state.zoom.heed_size(size, ui.pixels_per_point());
    let responses: Vec<Response> = areas.iter().zip(NAMES).map(|(area, name)| picture_of(ui, *area, name)).collect();
    put_back(ui, &mut state.grab, look);
    if hears_keys(ui) && ui.input(|input| input.modifiers.is_none() && input.key_pressed(Key::F6)) {
        responses[0].request_focus();
    }
    state.nudges_spot &= ui.memory(|memory| responses.iter().any(|response| memory.has_focus(response.id)));
    for response in &responses {
        zoom::navigate(ui, response, (&mut state.zoom, &mut state.grab), size, viewed.navigation);
    }
    let images: Vec<Rect> = areas.iter().map(|area| state.zoom.image_rect(*area, size)).collect();
    let (response, area, image) = (&responses[0], areas[0], images[0]);
    state.seen = zoom::part_seen(area, image);
    let painter = ui.painter_at(area);
    painter.image(texture, image, Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0)), Color32::WHITE);
    if let Some(overlay) = viewed.overlay {
        overlay.paint(&painter, image);
    } else if viewed.legends[0].is_some_and(|legend| legend.isolux != Isolux::Off) && viewed.compared.is_none() {
        isolux::isolux_ui(ui, viewed.isolines, (area, image), [width, height]);
    }
    let seen_from = compared_ui(ui, viewed, (&areas, &images), state.divider);
    let handled = handled_picture(viewed, &responses, seen_from[0]);
    let film = Film { width, height };
    let is_free = touch_ui(ui, (&responses, handled), (film, &images), viewed, state, (look, lights), actions);
    if let Some(compared) = &viewed.compared {
        compare::sides_ui(ui, compared, (&areas, &images), &mut state.divider);
    }
    responses.iter().for_each(|response| zoom::paint_region(ui, response, state.grab.as_ref()));
    let plates = responses.iter().enumerate().map(|(nth, picture)| {
        let grid = Grid { image: images[nth], size: [width, height] };
        let is_keyed = responses[nth].has_focus() && !state.nudges_spot;
        Plate { picture, grid, names: viewed.names(), right_from: seen_from[nth], nth, is_keyed }
    });
    let plates: Vec<Plate> = plates.collect();
    probe::follow(ui, &plates, &mut state.probes, is_free);
    probe::readings_ui(ui, &plates, viewed.readings, &mut state.probes, (look, lights));
    if let Some(words) = viewed.overlay.and_then(|overlay| overlay.hovered_words()) {
        let under = responses.iter().find(|response| response.hovered()).unwrap_or(response);
        probe::block_ui(ui, under, &words);
    }
    match viewed.overlay {
        Some(overlay) => overlay.bar.ui(ui, area, Corner::Right),
        None => legends_ui(ui, viewed, &areas),
    }
    let is_coarse = viewed.is_glimpse && viewed.bake.is_running();
    if is_coarse || matches!(viewed.stage, Stage::Loading(_)) || *viewed.bake == BakeState::Preparing {
        busy_corner(ui, area, &busy_words(viewed));
    }
}

/// Says what the colors of the picture mean; of a comparison those of each side, above its name.
fn legends_ui(ui: &Ui, viewed: &Viewed, areas: &[Rect]) {
    let [first, second] = viewed.legends;
    let (Some(left), Some(right)) = (areas.first(), areas.last()) else { return };
    if viewed.compared.is_none() {
        first.iter().for_each(|legend| legend.ui(ui, *left, Corner::Right));
        return;
    }
    let above = |area: &Rect| area.with_max_y(area.bottom() - compare::NAME_HEIGHT);
    first.iter().for_each(|legend| legend.ui(ui, above(left), Corner::Left));
    second.iter().for_each(|legend| legend.ui(ui, above(right), Corner::Right));
}

fn picture_of(ui: &mut Ui, area: Rect, name: &str) -> Response {
    let response = ui.allocate_rect(area, Sense::click_and_drag());
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, name));
    response
}

/// Number of the picture in which lights can be dragged, and the part of it where they are seen as they are now; `divider_x` parts
/// the sides of one picture, points across.
fn handled_picture(viewed: &Viewed, responses: &[Response], divider_x: f32) -> (usize, Rect) {
    let nth = viewed.handled.min(responses.len() - 1);
    let part = match viewed.compared.as_ref().map(|compared| compared.way) {
        Some(Way::Wipe) if viewed.handled == 0 => Rect::everything_left_of(divider_x),
        Some(Way::Wipe) => Rect::everything_right_of(divider_x),
        Some(Way::SideBySide) | None => Rect::EVERYTHING,
    };
    (nth, responses[nth].rect.intersect(part))
}

/// What is done to marks, lamps and spots in the pictures. Answers whether a click is about none of them.
fn touch_ui(
    ui: &mut Ui,
    (responses, (handled, part)): (&[Response], (usize, Rect)),
    (film, images): (Film, &[Rect]),
    viewed: &Viewed,
    state: &mut ViewState,
    (look, lights): (&mut Look, &mut LightsState),
    actions: &mut Vec<Action>,
) -> bool {
    // While the pointer marks, which it does in the first picture, lamps, spots and probes wait.
    let is_marking = state.grab.is_none() && marking_ui(ui, &responses[0], images[0], film, &mut state.marking);
    // So they do, unless one is in hand, where a drag is to be the rectangle that is zoomed to.
    let is_in_hand = lights.lamps.is_in_hand() || matches!(state.grab, Some(Grab::Spot(_)));
    let waits = is_marking || (state.zoom.awaits_drag(ui) && !is_in_hand);
    let mut is_free = !is_marking;
    for (nth, response) in responses.iter().enumerate().skip(usize::from(is_marking)) {
        match viewed.scene.filter(|_| nth == handled && !waits) {
            Some((scene, camera)) => {
                let sight = Sight { scene, camera, film, image: images[nth] };
                let seen = response.clone().with_new_rect(part);
                is_free &= handles_ui(ui, &seen, (&sight, viewed.baked), state, (look, lights), actions);
            }
            None => {
                grab_picture(response, state);
                let grid = Grid { image: images[nth], size: [film.width, film.height] };
                let px = asked_at(response, lights).and_then(|at| grid.pixel(at));
                context_menu(response, |ui| view_menu(ui, px, &mut state.probes, actions));
            }
        }
    }
    is_free
}

/// What is done to lamps and spots in a picture, which are seen in the rectangle of its response. Answers whether a click is about none
/// of them.
fn handles_ui(
    ui: &mut Ui,
    response: &Response,
    (sight, baked): (&Sight, Option<&LightBasis>),
    state: &mut ViewState,
    (look, lights): (&mut Look, &mut LightsState),
    actions: &mut Vec<Action>,
) -> bool {
    let Sight { scene, camera, film, image } = *sight;
    let picker = PanelPicker { scene, camera, film, image, baked };
    let pointed = lights.pointed.take();
    let mut is_free = !lamps::lamps_ui(ui, response, sight, look, lights, actions);
    if !lights.lamps.aiming && lights.lamps.drag.is_none() {
        is_free &= !names::marks_ui(ui, response, (sight, baked), look, lights, actions);
        if lights.lamps.pulled_at.is_none() {
            drag_spots(ui, response, &picker, state, look, &mut lights.spot);
        }
        names::surface_hint(ui, response, sight, look);
        names::selected_ui(ui, response, sight, look, (lights, pointed.as_deref()));
    }
    menu_ui(response, sight, &picker, &mut state.probes, (look, lights), actions);
    picker.paint(&ui.painter_at(response.rect), look, lights.spot.as_ref());
    is_free
}

/// The menu of a picture with handles: what can be added where it was asked for, the spot that is there, and what each picture has.
fn menu_ui(
    picture: &Response,
    sight: &Sight,
    picker: &PanelPicker,
    probes: &mut Probes,
    (look, lights): (&mut Look, &mut LightsState),
    actions: &mut Vec<Action>,
) {
    let at = asked_at(picture, lights);
    let grid = Grid { image: sight.image, size: [sight.film.width, sight.film.height] };
    // Beside the picture nobody sees what is added.
    let is_in_picture = at.is_none_or(|at| sight.image.contains(at));
    context_menu(picture, |ui| {
        if is_in_picture {
            let px = at.map(|at| lamps::film_px(sight, at));
            ui.menu_button("Add lamp here", |ui| add_menu(ui, px, actions));
        }
        if let Some(at) = at {
            picker.menu_ui(ui, at, look, &mut lights.spot);
        }
        if is_in_picture {
            ui.separator();
        }
        view_menu(ui, at.and_then(|at| grid.pixel(at)), probes, actions);
    });
}

/// Where the menu of a picture was asked for; by the keyboard nowhere, it is about the middle of the view then.
fn asked_at(picture: &Response, lights: &mut LightsState) -> Option<Pos2> {
    if picture.secondary_clicked() {
        lights.lamps.menu_at = picture.interact_pointer_pos();
    } else if is_asked(picture) {
        lights.lamps.menu_at = None;
    }
    lights.lamps.menu_at
}

/// What the menu of each picture has: a probe at a pixel, and how the picture is looked at.
fn view_menu(ui: &mut Ui, px: Option<[u32; 2]>, probes: &mut Probes, actions: &mut Vec<Action>) {
    if let Some(px) = px
        && ui.button("Pin a probe here").on_hover_text("P at the pointer").clicked()
    {
        probes.pin(px);
        ui.close();
    }
    let ways = [
        ("Show the whole picture", "F, or a double-click", Action::FitPicture),
        ("Show it pixel by pixel", "1", Action::OneToOne),
        ("Zoom to a rectangle", "Drag it in the picture, or leave it by Esc; Z + drag", Action::ZoomToRegion),
    ];
    for (words, keys, action) in ways {
        if ui.button(words).on_hover_text(keys).clicked() {
            actions.push(action);
            ui.close();
        }
    }
}

/// Where there are no handles, a press takes the picture, and a double-click shows all of it.
fn grab_picture(response: &Response, state: &mut ViewState) {
    if state.grab.is_none() && response.drag_started_by(PointerButton::Primary) {
        state.grab = Some(Grab::Picture);
    }
    if response.double_clicked() {
        state.zoom.fit();
    }
}

/// Draws what the picture is compared with. Answers from where on in each picture the side on the right is seen, points across.
fn compared_ui(ui: &Ui, viewed: &Viewed, (areas, images): (&[Rect], &[Rect]), divider: f32) -> [f32; 2] {
    match (&viewed.compared, areas, images) {
        (Some(compared), [_, right], [_, image]) => {
            compare::beside(ui, (compared, viewed.overlay), *right, *image);
            [f32::INFINITY, f32::NEG_INFINITY]
        }
        (Some(compared), [area, ..], [image, ..]) => {
            [compare::behind(ui, (compared, viewed.overlay), *area, *image, divider), f32::INFINITY]
        }
        _ => [f32::INFINITY; 2],
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
        let press = ui.input(|input| input.pointer.press_origin()).filter(|at| response.rect.contains(*at));
        state.grab = Some(press.and_then(|at| picker.grab(at, look)).map_or(Grab::Picture, Grab::Spot));
    }
    if let Some(Grab::Spot(held)) = &mut state.grab {
        if let Some(at) = response.interact_pointer_pos() {
            let speed = if ui.input(|input| input.modifiers.shift) { FINE } else { 1.0 };
            picker.drag(held, at, speed, look);
        }
        *chosen = Some((held.panel.clone(), held.idx));
        response.request_focus();
        state.nudges_spot = true;
        ui.ctx().set_cursor_icon(CursorIcon::Grabbing);
    }
    nudge_spot(ui, response, picker, look, chosen.as_ref().filter(|_| state.nudges_spot));
    if response.double_clicked() {
        let at = response.interact_pointer_pos().filter(|at| response.rect.contains(*at));
        match at.and_then(|at| picker.add(at, look)) {
            Some(added) => *chosen = Some(added),
            None => state.zoom.fit(),
        }
    }
    let idle = state.grab.is_none();
    let hovered = response.hover_pos().filter(|at| idle && response.rect.contains(*at));
    if let Some(hint) = hovered.and_then(|at| picker.hint(at, look)) {
        ui.ctx().set_cursor_icon(CursorIcon::Grab);
        lamps::hint(ui, response.rect, &hint);
    }
}

/// Esc puts a spot that is dragged back; before anything else, as the toolkit ends the drag by that key.
fn put_back(ui: &Ui, grab: &mut Option<Grab>, look: &mut Look) {
    if ui.input(|input| input.key_pressed(Key::Escape))
        && let Some(Grab::Spot(held)) = grab.take_if(|grab| matches!(grab, Grab::Spot(_)))
    {
        held.put_back(look);
    }
}

/// Arrow keys move the chosen spot while the picture has the focus that a press on a spot gave it.
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
    fn nothing_is_held_of_a_picture_that_is_gone() {
        let mut state = ViewState { grab: Some(Grab::Picture), ..ViewState::default() };
        let viewed = Viewed {
            picture: None,
            stage: &Stage::Ready,
            bake: &BakeState::Preparing,
            is_glimpse: false,
            scene: None,
            baked: None,
            handled: 0,
            navigation: Navigation::default(),
            legends: [None; 2],
            isolines: &[],
            compared: None,
            overlay: None,
            readings: &Default::default(),
        };
        let (mut look, mut lights, mut actions) = (Look::default(), LightsState::default(), Vec::new());
        _ = egui::Context::default().run_ui(egui::RawInput::default(), |ui| {
            viewport_ui(ui, &viewed, &mut state, &mut look, &mut lights, &mut actions);
        });
        assert_eq!(state.grab, None);
    }

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
