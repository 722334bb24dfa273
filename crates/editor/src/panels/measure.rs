//! Measure: what is marked in the picture, and how much light arrives there.

use eframe::egui::{Button, Grid, RichText, Ui};
use serde::{Deserialize, Serialize};

use super::number::{Number, number_of, step_m};
use crate::action::{Action, FileTask};
use crate::illuminance::{FOOT_CANDLE_LX, LuxFigures, lux_words, share_words};
use crate::legend::number_words;
use crate::look::scene::{HEIGHT_M, PlaneChoice, SPACING_M};
use crate::marks::Kin;
use crate::schedule::ScheduleBy;
use crate::theme::{self, Fold};
use crate::viewport::marking::{Marking, Tool};

/// What there is to say about the light that arrives.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeasureView<'a> {
    /// Illuminance of what is marked.
    pub marked: Option<LuxFigures>,
    /// Of each sensor grid of the bake, with its name.
    pub grids: &'a [(String, LuxFigures)],
    /// Whether the light that arrives at the pixels was baked.
    pub has_illuminance: bool,
    /// Its error, dB below the peaks of the lights in lux; none while a bake is not done.
    pub lux_error_db: Option<f32>,
    /// How it can be had.
    pub lux_bake: LuxBake,
    /// Whether lamps that were added shine, of which these figures count no more than the direct light.
    pub counts_direct_only: bool,
    /// What the pixel that was clicked on last shows.
    pub surface: Option<&'a str>,
    /// Whether another look is seen beside the lights as they are now, of which the figures are.
    pub is_compared: bool,
    /// Why something could not be measured, in words.
    pub problem: Option<&'a str>,
    /// Whether surfaces can be told apart.
    pub has_scene: bool,
    /// Name of the object that is marked, if it was clicked on.
    pub floor: Option<&'a str>,
    /// Whether the scene has the object that the work plane stands on.
    pub has_floor: bool,
    /// The floor that powers are divided by where nobody types its area.
    pub known_floor: Option<KnownFloor>,
    /// What of the look is of another view than the one that is shown, for people.
    pub elsewhere: Option<String>,
    /// Diagonal of the scene, m, where it is known.
    pub extent_m: Option<f32>,
}

/// A floor whose area in m² is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum KnownFloor {
    /// Of the object that is marked.
    Marked(f64),
    /// Of the whole scene.
    OfScene(f64),
}

impl KnownFloor {
    /// In m².
    pub fn area_m2(self) -> f64 {
        match self {
            KnownFloor::Marked(area) | KnownFloor::OfScene(area) => area,
        }
    }

    fn words(self) -> String {
        let whose = if matches!(self, KnownFloor::Marked(_)) { "marked" } else { "of the scene" };
        format!("{whose} {} m²", number_words(self.area_m2() as f32))
    }
}

/// How the light that arrives can be had, where it is not there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LuxBake {
    /// There is no scene to bake it of.
    #[default]
    Never,
    /// The pictures were taken, which tell nothing of it.
    Taken,
    /// By a bake that can be started here.
    Ready,
    /// By the bake that runs.
    Underway,
}

/// What can be set here.
pub struct MeasureState<'a> {
    /// Whether the area of the floor is told.
    pub asks_for_floor: &'a mut bool,
    /// What is marked, and how.
    pub marking: &'a mut Marking,
    /// The schedule of luminaires.
    pub schedule: &'a mut ScheduleState,
    /// A level grid of sensors that the next bake has.
    pub work_plane: &'a mut Option<PlaneChoice>,
}

/// What is set for the schedule of luminaires. It outlasts the program, but for the floor of one scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ScheduleState {
    /// What has a row of its own.
    pub by: ScheduleBy,
    /// Lumen per watt of every lamp that tells no watts; 0 leaves these unknown.
    pub efficacy_lm_w: f64,
    /// Floor area in m²; 0 is that of the floor that is known.
    #[serde(skip)]
    pub floor_m2: f64,
}

const LUX_ERROR_HINT: &str = "Error of the illuminance at the pixels, below the peaks of the lights there: more is better. \
                              The bar at the bottom tells that of the picture; more samples make both more exact";

/// Draws it.
pub fn measure_ui(ui: &mut Ui, state: MeasureState, view: &MeasureView, actions: &mut Vec<Action>) {
    let MeasureState { asks_for_floor, marking, schedule, work_plane } = state;
    theme::folding(ui, "Measure", Fold::Closed, |ui| {
        tools_ui(ui, marking, view.has_scene);
        if let Some(surface) = view.surface {
            ui.label(RichText::new(surface).weak());
        }
        if let Some(words) = &view.elsewhere {
            let tip = "It stays in the look, and is back when that view is shown";
            ui.label(RichText::new(words).color(ui.visuals().warn_fg_color)).on_hover_text(tip);
        }
        match (&view.marked, view.has_illuminance) {
            (Some(figures), _) => {
                figures_ui(ui, "marked", figures);
                preliminary_ui(ui, view.lux_bake);
            }
            (None, false) => missing_ui(ui, view.lux_bake, actions),
            (None, true) if marking.marks().is_none() => {
                ui.label(RichText::new("Mark a part of the picture to read its illuminance").weak());
            }
            (None, true) => {
                ui.spinner();
            }
        }
        if let Some(db) = view.lux_error_db {
            ui.label(RichText::new(format!("Illuminance: {db:.1} dB")).weak()).on_hover_text(LUX_ERROR_HINT);
        }
        if view.is_compared && (view.marked.is_some() || !view.grids.is_empty()) {
            ui.label(RichText::new("Under the lights as they are now").weak())
                .on_hover_text("Whatever is compared in the picture; take a look over to read it");
        }
        if let Some(problem) = view.problem {
            ui.colored_label(ui.visuals().error_fg_color, problem);
        }
        for (name, figures) in view.grids {
            ui.add_space(4.0);
            ui.label(RichText::new(name).strong()).on_hover_text("A sensor grid of the bake");
            figures_ui(ui, name, figures);
        }
        if !view.grids.is_empty() {
            let hint = "A table of all points of these sensor grids: place in m, and lux";
            if ui.button("Save values…").on_hover_text(hint).clicked() {
                actions.push(Action::Ask(FileTask::SaveValues));
            }
        }
        if view.counts_direct_only && (view.marked.is_some() || !view.grids.is_empty()) {
            ui.label(RichText::new("Of added lamps only the direct light counts").weak())
                .on_hover_text("Bake with “Movable lamps” and “Illuminance” on to count what surfaces make of it");
        }
        if !matches!(view.lux_bake, LuxBake::Never | LuxBake::Taken) {
            ui.add_space(6.0);
            work_plane_ui(ui, work_plane, view, actions);
        }
        ui.add_space(6.0);
        *asks_for_floor = true;
        schedule_ui(ui, schedule, view, actions);
    });
}

/// The tools that mark, and what they leave.
pub fn tools_ui(ui: &mut Ui, marking: &mut Marking, has_scene: bool) {
    ui.horizontal_wrapped(|ui| {
        let tools = [
            (Tool::Rectangle, "Rectangle", "Mark a rectangle of the picture, a click marks one pixel"),
            (Tool::Brush, "Brush", "Paint over a part of the picture"),
            (Tool::Surface, "Surface", "Mark the surface that is clicked on"),
        ];
        for (tool, name, hint) in tools {
            let is_on = marking.tool == Some(tool);
            let enabled = tool != Tool::Surface || has_scene;
            let button = ui.add_enabled(enabled, Button::new(name).selected(is_on)).on_hover_text(hint);
            if button.on_disabled_hover_text("Needs the scene of this bake").clicked() {
                marking.tool = (!is_on).then_some(tool);
            }
        }
        let clear = ui.add_enabled(marking.marks().is_some(), Button::new("Clear")).on_hover_text("Mark nothing");
        if clear.on_disabled_hover_text("Nothing is marked").clicked() {
            marking.marks = None;
        }
    });
    match marking.tool {
        Some(Tool::Surface) => {
            ui.horizontal(|ui| {
                ui.radio_value(&mut marking.kin, Kin::Node, "Same object").on_hover_text("The node that is clicked on");
                ui.radio_value(&mut marking.kin, Kin::Material, "Same material")
                    .on_hover_text("Everything of the material that is clicked on");
            });
        }
        Some(Tool::Brush) => {
            ui.horizontal(|ui| {
                let label = ui.label("Radius");
                let radius = Number::new(&mut marking.radius_px).range(0.0..=500.0).speed(0.2);
                let words = |px: f64, _| if px > 0.0 { format!("{px:.0} px") } else { "fitting".into() };
                ui.add(radius.words(words).read(|text| number_of(text, " px")))
                    .labelled_by(label.id)
                    .on_hover_text("Of the brush, in pixels of the picture");
            });
        }
        _ => {}
    }
}

fn figures_ui(ui: &mut Ui, salt: &str, figures: &LuxFigures) {
    Grid::new(("lux", salt)).num_columns(2).spacing([10.0, 3.0]).show(ui, |ui| {
        let both = |lux: f64| format!("{} lx   {} fc", lux_words(lux), lux_words(lux / FOOT_CANDLE_LX));
        let mut rows =
            vec![("Average", both(figures.average), "Mean illuminance, by area of surface where the scene is known")];
        if figures.points > 1 {
            rows.push(("Minimum", both(figures.minimum), "Least illuminance"));
            rows.push(("Maximum", both(figures.maximum), "Largest illuminance"));
            rows.push(("U0", share_words(figures.uniformity()), "Uniformity, minimum over average"));
            rows.push(("Ud", share_words(figures.diversity()), "Uniformity, minimum over maximum"));
            rows.push(("Points", figures.points.to_string(), "Pixels or sensors that count"));
        }
        if let Some(area) = figures.area_m2 {
            rows.push(("Area", format!("{} m²", number_words(area as f32)), "Of the surface, as far as it is seen"));
        }
        for (name, value, hint) in rows {
            ui.label(RichText::new(name).weak()).on_hover_text(hint);
            ui.label(value);
            ui.end_row();
        }
    });
}

/// Says that lux are not final, while they are not.
pub fn preliminary_ui(ui: &mut Ui, lux_bake: LuxBake) {
    if lux_bake == LuxBake::Underway {
        ui.label(RichText::new("As far as the bake is").weak())
            .on_hover_text("A preview first, coarse and smoothed; with all samples at the end of the bake");
    }
}

/// What to do where no illuminance was baked.
pub fn missing_ui(ui: &mut Ui, lux_bake: LuxBake, actions: &mut Vec<Action>) {
    if lux_bake == LuxBake::Underway {
        let words = RichText::new("Illuminance comes right behind the preview of this bake").weak();
        ui.label(words).on_hover_text("The preview of the picture is first");
        return;
    }
    if lux_bake == LuxBake::Taken {
        ui.label(RichText::new("Pictures that were taken tell no illuminance").weak());
        return;
    }
    ui.label(RichText::new("This bake holds no illuminance").weak());
    let button = ui.add_enabled(lux_bake == LuxBake::Ready, Button::new("Bake with illuminance"));
    let button = button.on_hover_text("Bakes again, with the light that arrives at each pixel, in lux");
    if button.on_disabled_hover_text("Open the scene, or bake it with --irradiance").clicked() {
        actions.push(Action::BakeIlluminance);
    }
}

/// Height of a work plane at first, meters: that of a desk.
const DESK_M: f32 = 0.75;
/// Of the diagonal of a scene a desk is no higher: else the scene is a model, a tenth or a hundredth of what it shows.
const DESK_OF_EXTENT: f32 = 0.25;

fn desk_m(extent_m: Option<f32>) -> f32 {
    let mut models = (0..6).map(|power| DESK_M / 10f32.powi(power));
    let fits = |desk_m: &f32| extent_m.is_none_or(|extent_m| *desk_m <= DESK_OF_EXTENT * extent_m);
    models.find(fits).unwrap_or(DESK_M)
}

/// A level grid of sensors over a floor.
fn work_plane_ui(ui: &mut Ui, plane: &mut Option<PlaneChoice>, view: &MeasureView, actions: &mut Vec<Action>) {
    let (speed, digits) = step_m(0.01, 3, view.extent_m);
    let mut is_wanted = plane.is_some();
    let hint = "A level grid of sensors above a floor, baked with the illuminance: average, minimum and uniformity";
    if ui.checkbox(&mut is_wanted, "Work plane").on_hover_text(hint).changed() {
        let floor = view.floor.map(str::to_owned);
        *plane = is_wanted.then_some(PlaneChoice { height_m: desk_m(view.extent_m), spacing_m: None, floor });
    }
    let Some(plane) = plane else { return };
    Grid::new("work plane").num_columns(2).spacing([10.0, 5.0]).show(ui, |ui| {
        let label = ui.label("Height");
        let height = Number::new(&mut plane.height_m).range(HEIGHT_M).speed(speed).max_decimals(digits).suffix(" m");
        ui.add(height).labelled_by(label.id).on_hover_text("Above the floor");
        ui.end_row();
        let label = ui.label("Spacing");
        let mut spacing = plane.spacing_m.unwrap_or(0.0);
        let words = |m: f64, _| if m > 0.0 { format!("{} m", number_words(m as f32)) } else { "EN 12464-1".into() };
        let drag = Number::new(&mut spacing)
            .range(0.0..=*SPACING_M.end())
            .speed(speed)
            .words(words)
            .read(|text| number_of(text, " m"));
        let hint = "Between points; at 0 it is as EN 12464-1 asks for the size of the floor";
        if ui.add(drag).labelled_by(label.id).on_hover_text(hint).changed() {
            plane.spacing_m = (spacing > 0.0).then_some(spacing.max(*SPACING_M.start() as f32));
        }
        ui.end_row();
        ui.label("Floor");
        match &plane.floor {
            None => ui.label("of the whole scene"),
            Some(name) if view.has_floor => ui.label(name),
            Some(name) => {
                let words = RichText::new(format!("{name} is not in this scene")).color(ui.visuals().warn_fg_color);
                ui.label(words).on_hover_text("Nothing is baked on it; choose another floor")
            }
        };
        ui.end_row();
    });
    ui.horizontal_wrapped(|ui| {
        let choose = ui.add_enabled(view.floor.is_some(), Button::new("Stand on what is marked"));
        let choose = choose.on_hover_text("The surfaces of the marked object that face up are the floor");
        let choose = choose.on_disabled_hover_text("Mark a floor with the tool Surface first");
        if let (true, Some(name)) = (choose.clicked(), view.floor) {
            plane.floor = Some(name.to_owned());
        }
        if plane.floor.is_some() && ui.button("Whole scene").on_hover_text("Over the plan of all surfaces").clicked() {
            plane.floor = None;
        }
        let bake = ui.button("Bake work plane").on_hover_text("Bakes again, with illuminance and this grid");
        if bake.clicked() {
            actions.push(Action::BakeIlluminance);
        }
    });
}

fn schedule_ui(ui: &mut Ui, schedule: &mut ScheduleState, view: &MeasureView, actions: &mut Vec<Action>) {
    Grid::new("schedule").num_columns(2).spacing([10.0, 5.0]).show(ui, |ui| {
        ui.label("Schedule");
        ui.radio_value(&mut schedule.by, ScheduleBy::Lamp, "Per lamp").on_hover_text("A row for every lamp");
        ui.end_row();
        ui.label("");
        ui.radio_value(&mut schedule.by, ScheduleBy::Type, "Per type")
            .on_hover_text("A row for lamps of one kind, distribution, flux, power and color, with how many there are");
        ui.end_row();
        let label = ui.label("Efficacy");
        let efficacy =
            Number::new(&mut schedule.efficacy_lm_w).range(0.0..=400.0).speed(0.5).max_decimals(1).words(
                |lm_w, _| if lm_w > 0.0 { format!("{} lm/W", number_words(lm_w as f32)) } else { "none".into() },
            );
        ui.add(efficacy.read(|text| number_of(text, " lm/W"))).labelled_by(label.id).on_hover_text(
            "For lamps whose photometric file states no watts: theirs are lumen over this; without it they stay empty",
        );
        ui.end_row();
        let label = ui.label("Floor area");
        let known = view.known_floor;
        let floor = Number::new(&mut schedule.floor_m2).range(0.0..=1e6).speed(0.1);
        let words = move |area: f64, _: std::ops::RangeInclusive<usize>| match known {
            _ if area > 0.0 => format!("{} m²", number_words(area as f32)),
            Some(known) => known.words(),
            None => "none".into(),
        };
        ui.add(floor.words(words).read(|text| number_of(text, " m²")))
            .labelled_by(label.id)
            .on_hover_text(
                "For W/m² in the schedule; at 0 it is the floor of the object that was marked with Surface, else that of the scene",
            );
        ui.end_row();
    });
    let save = ui
        .button("Save schedule…")
        .on_hover_text("A table of all lamps, or of their types: lumen, watt, lm/W, place, aim, color, and W/m²");
    if save.clicked() {
        actions.push(Action::Ask(FileTask::SaveSchedule));
    }
}

#[cfg(test)]
mod tests {
    use eframe::egui::Role;
    use egui_kittest::Harness;
    use egui_kittest::kittest::{NodeT, Queryable};

    use super::*;

    #[test]
    fn a_work_plane_is_as_high_as_a_desk_in_a_model_as_well() {
        let found = [f32::INFINITY, 300.0, 3.5, 0.05].map(|extent_m| desk_m(Some(extent_m)));
        assert!(found[..3] == [DESK_M; 3] && (found[3] - 0.0075).abs() < 1e-6, "{found:?}");
    }

    #[test]
    fn a_brush_that_suits_the_picture_has_no_pixels_to_tell() {
        for (radius_px, words) in [(0.0, "fitting"), (12.0, "12 px")] {
            let mut marking = Marking::default();
            (marking.tool, marking.radius_px) = (Some(Tool::Brush), radius_px);
            let mut window = Harness::new_ui(|ui| tools_ui(ui, &mut marking, true));
            window.run_steps(2);
            let told = window.get_by_role_and_label(Role::SpinButton, "Radius").accesskit_node().value();
            assert_eq!(told.as_deref(), Some(words));
        }
    }
}
