//! Free lamps in the list of lights: a row each, and what the chosen one is like.

use clerestory_transport::lamps::{FreeLamp, LampShape, LampUnit};
use clerestory_transport::light::{LightRig, luminance};
use eframe::egui::{self, Button, Color32, ComboBox, Grid, Label, Modifiers, Pos2, RichText, Ui};
use glam::Vec3;

use super::lights::listed::Listed;
use super::lights::names::{Renaming, name_field_ui};
use super::number::{Number, before_drag, step_m};
use crate::action::{Action, FileTask};
use crate::look::Look;
use crate::look::lamps::{FARTHEST_M, MOST_STRENGTH};
use crate::viewport::gizmo::{AimWhileMoving, Drag, move_to};

/// What is remembered of free lamps and no look holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LampState {
    /// Key of the lamp that was touched last.
    pub chosen: Option<String>,
    /// The light that a click in the picture was for, until the list has taken it over.
    pub picked: Option<(String, Pick)>,
    /// Whether the next click in the picture says what it is to light.
    pub aiming: bool,
    /// What moving does to the aim.
    pub aim_while_moving: AimWhileMoving,
    /// The lamp that is being dragged in the picture, and where the pointer was seen last.
    pub drag: Option<Drag>,
    /// Where the pointer was seen last while it drags.
    pub dragged_to: Option<Pos2>,
    /// Lamps that are selected together with the one that is dragged and go along with it, as they were.
    pub carried: Vec<FreeLamp>,
    /// Where the chosen lamp was pulled out of the file, before it is held.
    pub pulled_at: Option<Pos2>,
    /// What stood before that, while it is held.
    pub pulled: Option<Pulled>,
    /// Where the menu of the picture was opened.
    pub menu_at: Option<Pos2>,
    /// Diagonal of the scene in which lamps stand, m, where it is known.
    pub extent_m: Option<f32>,
    /// A name that is being typed.
    naming: Renaming,
}

/// What stood before a lamp was pulled out of the file.
#[derive(Clone, Debug, PartialEq)]
pub struct Pulled {
    /// The lights.
    pub lights: LightRig,
    /// Key of the free lamp that was chosen.
    pub chosen: Option<String>,
}

/// What a click on a light of the picture does to what is selected.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Pick {
    /// This light alone is selected from then on.
    #[default]
    Alone,
    /// It is selected as well.
    Another,
}

impl Pick {
    /// With Shift, Ctrl or ⌘ a click adds, as in the list.
    pub fn of(modifiers: Modifiers) -> Pick {
        if modifiers.shift || modifiers.command { Pick::Another } else { Pick::Alone }
    }
}

impl LampState {
    /// Whether a lamp is the chosen one.
    pub fn is_chosen(&self, key: &str) -> bool {
        self.chosen.as_deref() == Some(key)
    }

    /// Whether a lamp is dragged in the picture, or about to be.
    pub fn is_in_hand(&self) -> bool {
        self.drag.is_some() || self.pulled_at.is_some()
    }

    /// Lets go of what is dragged in the picture: it stays where it is.
    pub fn let_go(&mut self) {
        (self.drag, self.dragged_to, self.pulled_at, self.pulled) = (None, None, None, None);
        self.carried.clear();
    }
}

/// What can be done with lamps in what is open.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LampChoice {
    /// Everything.
    Ready,
    /// A bake was opened whose scene was not found.
    NeedsScene {
        /// Name of the scene.
        name: String,
        /// Why it was not found, in words.
        why: String,
    },
    /// Its scene is being read.
    Waiting,
    /// There is no scene: the pictures were taken.
    Never,
}

/// Most digits behind the point of a strength.
const MOST_DECIMALS: f32 = 8.0;

/// Shapes as they are added, with what they are called and what they are.
const SHAPES: [(&str, &str, LampShape); 6] = [
    ("Point", "As bright in all directions, from one point", LampShape::Point),
    ("Spot", "A cone of light with a soft rim", LampShape::Spot { inner_rad: 0.35, outer_rad: 0.6 }),
    ("Rectangle", "A panel that shines to one side", LampShape::Rectangle { size_m: [0.6, 0.6] }),
    ("Disk", "A round panel that shines to one side", LampShape::Disk { radius_m: 0.15 }),
    ("Sphere", "A globe that shines all around", LampShape::Sphere { radius_m: 0.1 }),
    ("Directional", "Parallel light from far away", LampShape::Directional { radius_rad: 0.0 }),
];

/// The kinds to choose from; `at_px` on the film, else in the middle of the view.
pub fn add_menu(ui: &mut Ui, at_px: Option<[f32; 2]>, actions: &mut Vec<Action>) {
    for (name, hint, shape) in SHAPES {
        if ui.button(name).on_hover_text(hint).clicked() {
            actions.push(Action::AddLamp { shape, at_px });
            ui.close();
        }
    }
    if ui.button("IES or LDT…").on_hover_text("A lamp with the measured distribution of a file").clicked() {
        actions.push(Action::AskProfile { at_px });
        ui.close();
    }
}

/// Why no free lamp can take the place of one of the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unmovable {
    /// Its distribution lies in the file.
    Measured,
    /// One shines there already.
    Replaced,
}

/// The entries of a menu that make a free lamp of one of the file, in its place or beside it.
pub fn make_movable_ui(ui: &mut Ui, key: &str, unmovable: Option<Unmovable>, actions: &mut Vec<Action>) {
    let button = ui.add_enabled(unmovable.is_none(), Button::new("Make movable"));
    let button = button.on_hover_text("Mutes it, and puts a free lamp of the same light in its place");
    let is_measured = unmovable == Some(Unmovable::Measured);
    let why = if is_measured {
        "Its measured distribution lies in the file of the scene: mute it, and add one with “IES or LDT…”"
    } else {
        "A movable lamp shines in its place already"
    };
    if button.on_disabled_hover_text(why).clicked() {
        actions.push(Action::MakeMovable(key.to_owned()));
        ui.close();
    }
    let button = ui.add_enabled(!is_measured, Button::new("Duplicate"));
    let button = button.on_hover_text("Adds a movable lamp of the same light, and leaves this one as it is");
    let why = "Its measured distribution lies in the file of the scene: add one with “IES or LDT…”";
    if button.on_disabled_hover_text(why).clicked() {
        actions.push(Action::CopyLamp(key.to_owned()));
        ui.close();
    }
}

/// What can be done with a lamp.
pub fn lamp_menu(ui: &mut Ui, lamp: &FreeLamp, state: &mut LampState, actions: &mut Vec<Action>) {
    let mut chosen = |ui: &mut Ui, name: &str, action: Option<Action>| {
        let clicked = ui.button(name).clicked();
        if clicked {
            state.chosen = Some(lamp.key.clone());
            actions.extend(action);
            ui.close();
        }
        clicked
    };
    let aims = lamp.shape.is_aimed() && chosen(ui, "Aim at…", None);
    chosen(ui, "Duplicate", Some(Action::DuplicateLamp));
    if !lamp.shape.is_parallel() {
        chosen(ui, "Give it a profile…", Some(Action::AskProfileFor(lamp.key.clone())));
    }
    chosen(ui, "Delete", Some(Action::DeleteLamp));
    state.aiming |= aims;
}

/// Says why lamps cannot be placed, and what helps.
pub fn missing_ui(ui: &mut Ui, choice: &LampChoice, actions: &mut Vec<Action>) {
    match choice {
        LampChoice::NeedsScene { name, why } => {
            ui.label(RichText::new(format!("Movable lamps need the scene of this bake, {name}: {why}")).weak());
            if ui.button("Choose the scene…").clicked() {
                actions.push(Action::Ask(FileTask::FindScene));
            }
        }
        LampChoice::Waiting => {
            ui.label(RichText::new("Reading the scene of this bake").weak());
        }
        LampChoice::Ready | LampChoice::Never => {}
    }
}

/// Everything about a lamp in numbers. None of `lights` may be called the same.
pub(super) fn details_ui(
    ui: &mut Ui,
    key: &str,
    look: &mut Look,
    state: &mut LampState,
    lights: &[Listed],
    actions: &mut Vec<Action>,
) {
    let Some(idx) = look.lights.lamps.iter().position(|lamp| lamp.key == key) else { return };
    ui.horizontal(|ui| {
        ui.add_space(50.0);
        ui.vertical(|ui| {
            Grid::new("lamp").num_columns(2).spacing([10.0, 4.0]).show(ui, |ui| {
                ui.label(RichText::new("Name").weak());
                ui.scope(|ui| {
                    ui.set_max_width(150.0);
                    name_field_ui(ui, (key, key), look, &mut state.naming, lights);
                });
                ui.end_row();
                let name = look.name_of(key).to_owned();
                let lamp = &mut look.lights.lamps[idx];
                strength_ui(ui, &name, lamp);
                shape_ui(ui, &name, lamp, state.extent_m);
                place_ui(ui, &name, lamp, state);
            });
            buttons_ui(ui, &look.lights.lamps[idx], state, actions);
            ui.add_space(4.0);
        });
    });
}

fn buttons_ui(ui: &mut Ui, lamp: &FreeLamp, state: &mut LampState, actions: &mut Vec<Action>) {
    ui.horizontal(|ui| {
        if lamp.shape.is_aimed() {
            let hint = "Click in the picture what it is to light, A";
            let aim = ui.add(Button::new("Aim at…").selected(state.aiming)).on_hover_text(hint);
            if aim.clicked() {
                state.aiming = !state.aiming;
            }
        }
        if ui.button("Duplicate").on_hover_text(ui.ctx().format_shortcut(&super::shortcuts::DUPLICATE)).clicked() {
            actions.push(Action::DuplicateLamp);
        }
        if ui.button("Delete").on_hover_text("Del").clicked() {
            actions.push(Action::DeleteLamp);
        }
    });
}

fn strength_ui(ui: &mut Ui, name: &str, lamp: &mut FreeLamp) {
    // The row above tells what the fader makes of it.
    ui.label(RichText::new("Strength at 1×").weak());
    ui.horizontal(|ui| {
        let (strength, decimals) = (f64::from(lamp.strength), decimals(lamp.strength));
        let speed = if strength > 0.0 { 0.01 * strength } else { 0.01 };
        let number = Number::new(&mut lamp.strength).range(0.0..=MOST_STRENGTH).speed(speed).max_decimals(decimals);
        let tip = format!(
            "Multiplied by the fader; in {} where the lamp is white: a color lets a part of each channel through",
            lamp.unit.name()
        );
        ui.add(number).on_hover_text(tip).accessible_name(format!("{name} strength"));
        let (before, mut unit) = (lamp.unit, lamp.unit);
        let combo = ComboBox::from_id_salt("unit").width(56.0).selected_text(unit.name()).show_ui(ui, |ui| {
            for one in lamp.shape.units() {
                let fits = *one == before || strength_within(lamp, *one).is_some();
                let item = ui.add_enabled_ui(fits, |ui| ui.selectable_value(&mut unit, *one, one.name())).inner;
                item.on_disabled_hover_text("It would take another strength than a lamp can have, 0 to 10⁹");
            }
        });
        combo.response.accessible_name(format!("{name} unit")).on_hover_text("The light stays as it is");
        if unit != before
            && let Some(strength) = strength_within(lamp, unit)
        {
            (lamp.strength, lamp.unit) = (strength, unit);
        }
    });
    ui.end_row();
}

/// Digits behind the point of a strength: two, and of what is less than 1 as many as tell three that count.
fn decimals(strength: f32) -> usize {
    if strength > 0.0 { (2.0 - strength.log10().floor()).clamp(2.0, MOST_DECIMALS) as usize } else { 2 }
}

/// The strength of a lamp in another unit, if it can be set.
fn strength_within(lamp: &FreeLamp, unit: LampUnit) -> Option<f32> {
    lamp.strength_in(unit).filter(|strength| (0.0..=MOST_STRENGTH).contains(strength))
}

fn shape_ui(ui: &mut Ui, name: &str, lamp: &mut FreeLamp, extent_m: Option<f32>) {
    let (speed, digits) = step_m(0.005, 3, extent_m);
    let meters = |ui: &mut Ui, value: &mut f32, what: &str| {
        let number = Number::new(value).range(0.0..=1e4).speed(speed).suffix(" m").max_decimals(digits);
        ui.add(number).on_hover_text(what).accessible_name(format!("{name} {}", what.to_lowercase()));
    };
    match &mut lamp.shape {
        LampShape::Spot { inner_rad, outer_rad } => {
            ui.label(RichText::new("Half angles").weak());
            ui.horizontal(|ui| {
                let mut outer = outer_rad.to_degrees();
                let mut inner = inner_rad.to_degrees();
                let number = ui.add(angle(&mut inner, outer)).on_hover_text("Of the full intensity");
                if number.accessible_name(format!("{name} inner angle")).changed() {
                    *inner_rad = inner.to_radians().min(*outer_rad);
                }
                let number = ui.add(angle(&mut outer, 90.0)).on_hover_text("Where the light ends");
                let before = before_drag(ui, &number, *inner_rad);
                if number.accessible_name(format!("{name} outer angle")).changed() {
                    *outer_rad = outer.to_radians();
                    *inner_rad = before.min(*outer_rad);
                }
            });
        }
        LampShape::Rectangle { size_m } => {
            ui.label(RichText::new("Size").weak());
            ui.horizontal(|ui| {
                meters(ui, &mut size_m[0], "Width");
                meters(ui, &mut size_m[1], "Height");
            });
        }
        LampShape::Disk { radius_m } | LampShape::Sphere { radius_m } => {
            ui.label(RichText::new("Radius").weak());
            meters(ui, radius_m, "Radius");
        }
        LampShape::Profile { file } => {
            ui.label(RichText::new("Profile").weak());
            let file_name = file.rsplit(['/', '\\']).next().unwrap_or(file);
            ui.add(Label::new(file_name).truncate()).on_hover_text(file.as_str());
        }
        LampShape::Directional { radius_rad } => {
            ui.label(RichText::new("Angle").weak());
            let mut degrees = 2.0 * radius_rad.to_degrees();
            let number = Number::new(&mut degrees).range(0.0..=90.0).speed(0.02).suffix("°").max_decimals(2);
            let hint = "Under which it is seen, from rim to rim: 0.53° is the sun, and at 0° shadows are sharp";
            if ui.add(number).on_hover_text(hint).accessible_name(format!("{name} angle")).changed() {
                *radius_rad = (0.5 * degrees).to_radians();
            }
        }
        LampShape::Point => return,
    }
    ui.end_row();
}

fn angle(degrees: &mut f32, most: f32) -> Number<'_> {
    Number::new(degrees).range(0.0..=most).speed(0.2).suffix("°").max_decimals(1)
}

fn place_ui(ui: &mut Ui, name: &str, lamp: &mut FreeLamp, state: &mut LampState) {
    let (speed, digits) = step_m(0.01, 3, state.extent_m);
    let numbers = |ui: &mut Ui, place: &mut Vec3, what: &str| {
        ui.horizontal(|ui| {
            ui.spacing_mut().item_spacing.x = 3.0;
            for (value, axis) in place.as_mut().iter_mut().zip(["X", "Y", "Z"]) {
                let number = Number::new(value).range(-FARTHEST_M..=FARTHEST_M).speed(speed).fixed_decimals(digits);
                ui.add(number)
                    .on_hover_text(format!("{axis}, meters"))
                    .accessible_name(format!("{name} {what} {axis}"));
            }
        });
    };
    ui.label(RichText::new("Position").weak());
    let mut position = lamp.position;
    numbers(ui, &mut position, "position");
    ui.end_row();
    if lamp.shape.is_aimed() {
        ui.label(RichText::new("Aim").weak());
        let mut aim = lamp.aim;
        numbers(ui, &mut aim, "aim");
        if aim != lamp.aim {
            lamp.point(lamp.position, aim);
        }
        ui.end_row();
        turn_ui(ui, name, lamp);
        ui.label("");
        let mut stays = state.aim_while_moving == AimWhileMoving::Stays;
        let hint = "A lamp that is moved keeps what it lights, else its direction";
        if ui.checkbox(&mut stays, "Keep the aim").on_hover_text(hint).changed() {
            state.aim_while_moving = if stays { AimWhileMoving::Stays } else { AimWhileMoving::GoesAlong };
        }
        ui.end_row();
    }
    if position != lamp.position {
        move_to(lamp, position, state.aim_while_moving);
    }
}

/// The turn about the aim, of a lamp that has sides.
fn turn_ui(ui: &mut Ui, name: &str, lamp: &mut FreeLamp) {
    if !lamp.shape.is_turnable() {
        return;
    }
    ui.label(RichText::new("Turn").weak());
    let mut degrees = lamp.turn_rad.to_degrees();
    let number = Number::new(&mut degrees).range(-180.0..=180.0).speed(0.5).suffix("°").max_decimals(1);
    let hint = "About the aim, clockwise as the lamp looks";
    if ui.add(number).on_hover_text(hint).accessible_name(format!("{name} turn")).changed() {
        lamp.turn_rad = degrees.to_radians();
    }
    ui.end_row();
}

/// What a shape is called in the window: as in the menu of `SHAPES`.
pub fn kind_words(shape: &LampShape) -> &'static str {
    match shape {
        LampShape::Point => "Point lamp",
        LampShape::Spot { .. } => "Spot lamp",
        LampShape::Rectangle { .. } => "Rectangle lamp",
        LampShape::Disk { .. } => "Disk lamp",
        LampShape::Sphere { .. } => "Sphere lamp",
        LampShape::Directional { .. } => "Directional lamp",
        LampShape::Profile { .. } => "Measured lamp",
    }
}

/// The color of a lamp, as bright as can be shown.
pub fn shown_color(lamp: &FreeLamp) -> Color32 {
    let color = lamp.setting.tint(Vec3::ONE);
    let [r, g, b] = (color / color.max_element().max(1e-6)).to_array();
    if luminance(color) > 0.0 { egui::Rgba::from_rgb(r, g, b).into() } else { Color32::BLACK }
}

/// The menu button in the heading of the list.
pub fn add_button(ui: &mut Ui, choice: &LampChoice, actions: &mut Vec<Action>) {
    if *choice == LampChoice::Never {
        return;
    }
    ui.add_enabled_ui(*choice == LampChoice::Ready, |ui| {
        let button = egui::containers::menu::MenuButton::from_button(Button::new("Add lamp"));
        button.ui(ui, |ui| add_menu(ui, None, actions)).0.on_disabled_hover_text("It takes the scene of this bake");
    });
}

#[cfg(test)]
mod tests {
    use eframe::egui::Role;
    use egui_kittest::Harness;
    use egui_kittest::kittest::{NodeT, Queryable};

    use super::*;
    use crate::support::lamp;

    #[test]
    fn the_strength_of_a_faint_lamp_is_told_by_the_digits_that_count() {
        for (strength, words) in [(0.0, "0"), (0.0025, "0.0025"), (0.5, "0.5"), (1234.5, "1234.5")] {
            let mut lamp = FreeLamp { strength, unit: LampUnit::Lumen, ..lamp("lamp") };
            let mut window =
                Harness::new_ui(|ui| _ = Grid::new("lamp").show(ui, |ui| strength_ui(ui, "lamp", &mut lamp)));
            window.run_steps(2);
            let told = window.get_by_role_and_label(Role::SpinButton, "lamp strength").accesskit_node().value();
            let told = told.expect("a number has a value").parse::<f32>().expect("digits");
            assert_eq!(told, words.parse::<f32>().expect("digits"), "{words}");
        }
    }

    #[test]
    fn in_a_model_of_centimeters_the_size_of_a_lamp_is_told_by_the_digits_that_count() {
        let shape = LampShape::Sphere { radius_m: 0.00125 };
        let mut lamp = FreeLamp { shape, unit: LampUnit::Lumen, ..lamp("lamp") };
        let mut window = Harness::new_ui(|ui| {
            Grid::new("lamp").show(ui, |ui| shape_ui(ui, "lamp", &mut lamp, Some(0.05)));
        });
        window.run_steps(2);
        let told = window.get_by_role_and_label(Role::SpinButton, "lamp radius").accesskit_node().value();
        let told = told.expect("a number has a value");
        assert!(told.contains("0.00125"), "{told}");
    }

    #[test]
    fn a_lamp_is_called_as_the_menu_calls_it() {
        for (name, _, shape) in SHAPES {
            assert_eq!(kind_words(&shape), format!("{name} lamp"));
        }
    }
}
