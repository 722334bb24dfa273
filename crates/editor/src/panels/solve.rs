//! Solve for light: wishes for parts of the picture, the lights that may change for them, and what came of it.

use clerestory_relight::Tone;
use eframe::egui::{
    self, Button, Checkbox, CollapsingHeader, Grid, RichText, ScrollArea, Slider, SliderClamping, Ui, vec2,
};

use super::display::tone_name;
use super::measure::{LuxBake, missing_ui, tools_ui};
use super::menu::context_menu;
use super::number::{Number, Spelling, before_drag, number_of, slider_ui};
use super::sight::keep_in_sight;
use crate::action::{Action, FileTask};
use crate::illuminance::FOOT_CANDLE_LX;
use crate::look::wishes::{CURVES, Entry, Wanted, Where, Wishes};
use crate::look::{Look, Units};
use crate::marks::Marked;
use crate::solve::kept::Here;
use crate::solve::{Exposure, Solution};
use crate::theme::{self, Fold};
use crate::viewport::marking::Marking;

/// What a new wish is about.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kind {
    /// Illuminance.
    #[default]
    Lux,
    /// Luminance.
    Luminance,
    /// A multiple of the present luminance.
    Times,
    /// No change.
    Keep,
}

/// Said where a look holds as many wishes as it can.
const FULL: &str = "There are as many wishes as a look holds; remove one first";
/// Said where a wish cannot have what is marked for its place.
const NOT_TO_BE_MOVED: &str = "Mark another part of the picture first, no larger than a look holds";

/// Kinds with their name, unit, a value to start with, and a hint. The unit of luminance is that of the picture.
const KINDS: [(Kind, &str, &str, f64, &str); 4] = [
    (Kind::Lux, "Illuminance", " lx", 500.0, "Mean of the light that arrives"),
    (Kind::Luminance, "Luminance", "", 100.0, "Mean of the light that is seen"),
    (Kind::Times, "Times as bright", "×", 2.0, "Mean of the light that is seen, times what it is now"),
    (Kind::Keep, "Keep", "", 0.0, "What is marked stays as it is"),
];

/// What the next wish is, and what came of those of the look.
#[derive(Clone, Debug)]
pub struct SolveState {
    kind: Kind,
    value: f64,
    /// What was found, and waits to be taken over.
    pub solution: Option<Solution>,
    /// Whether it is still to be scrolled to.
    pub is_news: bool,
    /// Whether the picture shows it meanwhile.
    pub is_previewed: bool,
    /// Why nothing was found, in words.
    pub problem: Option<String>,
}

impl Default for SolveState {
    fn default() -> Self {
        let (kind, value) = (Kind::default(), KINDS[0].3);
        SolveState { kind, value, solution: None, is_news: false, is_previewed: true, problem: None }
    }
}

/// Saturation that colors may change up to where nobody says.
const USUAL_SATURATION: f64 = 0.5;

/// What the panel needs to know.
pub struct SolveView<'a> {
    /// What lights are called.
    pub look: &'a Look,
    /// Keys of all lights that are not muted; asked for where they are to be seen, as there may be many.
    pub lights: &'a dyn Fn() -> Vec<String>,
    /// What a solution that was asked for waits for.
    pub busy: Option<&'static str>,
    /// Whether what was found is for other wishes than there are now.
    pub is_outdated: bool,
    /// Whether a solo darkens lights: what they bring is not known then.
    pub is_soloed: bool,
    /// What wishes are about.
    pub here: Here<'a>,
    /// How illuminance can be had, where it is not there.
    pub lux_bake: LuxBake,
    /// Whether surfaces can be told apart.
    pub has_scene: bool,
    /// What is marked, for people.
    pub marked: Option<&'a str>,
}

impl SolveState {
    fn wanted(&self) -> Wanted {
        match self.kind {
            Kind::Lux => Wanted::Lux(self.value),
            Kind::Luminance => Wanted::Luminance(self.value),
            Kind::Times => Wanted::Times(self.value),
            Kind::Keep => Wanted::Keep,
        }
    }
}

/// Draws it.
pub fn solve_ui(
    ui: &mut Ui,
    (state, wishes): (&mut SolveState, &mut Wishes),
    marking: &mut Marking,
    view: &SolveView,
    actions: &mut Vec<Action>,
) {
    theme::folding(ui, "Solve for light", Fold::Closed, |ui| {
        ui.label(RichText::new("Say what you want to see, and let the lights be found").weak());
        tools_ui(ui, marking, view.has_scene);
        kind_ui(ui, state, view.here.units);
        new_wish_ui(ui, (state, wishes), marking, view, actions);
        wishes_ui(ui, wishes, marking, &view.here);
        limits_ui(ui, wishes, view);
        ui.add_space(4.0);
        run_ui(ui, wishes, view, actions);
        if let Some(problem) = &state.problem {
            ui.colored_label(ui.visuals().error_fg_color, view.look.renamed(problem));
        }
        solution_ui(ui, state, view, actions);
    });
}

/// Unit of a luminance, as it stands behind its number.
fn luminance_unit(units: Units) -> &'static str {
    match units {
        Units::Photometric => " cd/m²",
        Units::Relative => " relative",
    }
}

fn kind_ui(ui: &mut Ui, state: &mut SolveState, units: Units) {
    ui.horizontal(|ui| {
        let (_, name, unit, _, hint) = KINDS[KINDS.iter().position(|kind| kind.0 == state.kind).unwrap_or(0)];
        let combo = egui::ComboBox::from_id_salt("wish kind").selected_text(name).width(128.0);
        let before = state.kind;
        let combo = combo.show_ui(ui, |ui| {
            for (kind, name, _, _, hint) in KINDS {
                ui.selectable_value(&mut state.kind, kind, name).on_hover_text(hint);
            }
        });
        combo
            .response
            .on_hover_text(hint)
            .widget_info(|| egui::WidgetInfo::labeled(egui::Role::ComboBox, true, "Kind of wish"));
        if state.kind != before {
            state.value = KINDS[KINDS.iter().position(|kind| kind.0 == state.kind).unwrap_or(0)].3;
        }
        let unit = if state.kind == Kind::Luminance { luminance_unit(units) } else { unit };
        if state.kind != Kind::Keep {
            let speed = (0.01 * state.value).max(0.01);
            let value = Number::new(&mut state.value).range(0.0..=1e6).speed(speed).suffix(unit).max_decimals(2);
            let (value, hint) = match state.kind {
                Kind::Lux => (value.read(lux_of), format!("{hint}; {FOOT_CANDLES}")),
                _ => (value, hint.to_owned()),
            };
            ui.add(value).on_hover_text(hint).accessible_name("Wanted");
        }
    });
}

/// Said where lux are typed.
const FOOT_CANDLES: &str = "foot-candles may be typed, as “50 fc”";

/// Illuminance that was typed, in lux.
fn lux_of(text: &str) -> Option<f64> {
    number_of(text, " lx").or_else(|| number_of(text, " fc").map(|foot_candles| foot_candles * FOOT_CANDLE_LX))
}

fn new_wish_ui(
    ui: &mut Ui,
    (state, wishes): (&SolveState, &mut Wishes),
    marking: &Marking,
    view: &SolveView,
    actions: &mut Vec<Action>,
) {
    let lacks_lux = state.kind == Kind::Lux && !view.here.has_illuminance;
    if lacks_lux && view.here.grids.is_empty() {
        missing_ui(ui, view.lux_bake, actions);
    }
    ui.horizontal_wrapped(|ui| {
        let n_marked = marking.marks().map_or(0, |marks| marks.pixels().len());
        let has_room = wishes.has_room_for(n_marked);
        let can_add = marking.marks().is_some() && !lacks_lux && has_room;
        let add = ui.add_enabled(can_add, Button::new("Add wish")).on_hover_text("For what is marked in the picture");
        let why = if lacks_lux { "This bake holds no illuminance" } else { "Mark a part of the picture first" };
        if add.on_disabled_hover_text(if has_room { why } else { FULL }).clicked()
            && let Some((marks, framing)) = marking.marks().zip(view.here.framing.clone())
        {
            let place = Where::Marked(Marked { framing, marks: marks.clone() });
            wishes.push(view.marked.unwrap_or("Wish"), place, state.wanted());
        }
        for (_, name) in &view.here.grids {
            let is_kind = matches!(state.kind, Kind::Lux | Kind::Times);
            let why = if is_kind { FULL } else { "Sensors tell lux: wish for Illuminance, or Times as bright" };
            let add = ui.add_enabled(is_kind && wishes.has_room(), Button::new(format!("Add for {name}")));
            let add = add.on_hover_text("For this sensor grid of the bake");
            if add.on_disabled_hover_text(why).clicked() {
                wishes.push(name, Where::Sensors(name.clone()), state.wanted());
            }
        }
        let numbers = match view.here.units {
            Units::Photometric => "cd/m²",
            Units::Relative => "the numbers of these photographs",
        };
        let hint =
            format!("Lights that make the picture look like another one: EXR or HDR in {numbers}, or PNG or JPEG");
        let button = ui.add_enabled(wishes.has_room(), Button::new("Match picture…")).on_hover_text(hint);
        if button.on_disabled_hover_text(FULL).clicked() {
            actions.push(Action::Ask(FileTask::OpenTarget));
        }
    });
}

/// Each wish has a line for its name and one for what is wanted, so that a narrow panel has room for both.
fn wishes_ui(ui: &mut Ui, wishes: &mut Wishes, marking: &mut Marking, here: &Here) {
    let (mut gone, mut moved, n_left) = (None, None, wishes.n_left());
    for (idx, wish) in wishes.list.iter_mut().enumerate() {
        ui.push_id(idx, |ui| {
            let right_to_left = egui::Layout::right_to_left(egui::Align::Center);
            ui.allocate_ui_with_layout(vec2(ui.available_width(), ui.spacing().interact_size.y), right_to_left, |ui| {
                let remove = ui.button("×").on_hover_text("Remove this wish");
                let name = format!("Remove {}", wish.name);
                remove.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, &name));
                if remove.clicked() {
                    gone = Some(idx);
                }
                let left_to_right = egui::Layout::left_to_right(egui::Align::Center);
                if ui.with_layout(left_to_right, |ui| name_ui(ui, wish, marking, here, n_left)).inner {
                    moved = Some(idx);
                }
            });
            ui.horizontal_wrapped(|ui| wanted_ui(ui, wish, here));
            if let Some(words) = here.misfit(wish) {
                ui.label(RichText::new(words).color(ui.visuals().warn_fg_color))
                    .on_hover_text("It stays in the look, and does not count until it fits");
            }
        });
    }
    if let (Some(idx), Some(marks), Some(framing)) = (moved, marking.marks(), &here.framing) {
        wishes.list[idx].place = Where::Marked(Marked { framing: framing.clone(), marks: marks.clone() });
    }
    if let Some(gone) = gone {
        wishes.list.remove(gone);
    }
}

/// The name of a wish. A click marks its place in the picture again; answers whether what is marked is to be its place.
fn name_ui(ui: &mut Ui, wish: &Entry, marking: &mut Marking, here: &Here, n_left: usize) -> bool {
    let Where::Marked(marked) = &wish.place else {
        ui.add(egui::Label::new(&wish.name).truncate());
        return false;
    };
    let shown = here.framing.as_ref().filter(|shown| marked.framing.fits(shown));
    let is_marked = shown.is_some() && marking.marks() == Some(&marked.marks);
    let hint = if shown.is_some() { "Click to see its place in the picture" } else { "Its place is in another view" };
    let name = ui.add(Button::selectable(is_marked, &wish.name).truncate());
    let name = name.on_hover_text(format!("{hint}\nRight-click or menu key for another place"));
    if let (true, Some(shown)) = (name.clicked(), shown) {
        marking.marks = marked.on(shown);
    }
    let n_room = n_left.saturating_add(wish.n_marked());
    let can_move = !is_marked && marking.marks().is_some_and(|marks| marks.pixels().len() <= n_room);
    let mut is_moved = false;
    context_menu(&name, |ui| {
        let hint = "What is marked in the picture now becomes the place of this wish";
        let button = ui.add_enabled(can_move, Button::new("Use what is marked")).on_hover_text(hint);
        if button.on_disabled_hover_text(NOT_TO_BE_MOVED).clicked() {
            is_moved = true;
            ui.close();
        }
    });
    is_moved
}

/// What a wish wants, and how much it counts.
fn wanted_ui(ui: &mut Ui, wish: &mut Entry, here: &Here) {
    let (name, is_lux) = (format!("{} wanted", wish.name), matches!(wish.wanted, Wanted::Lux(_)));
    let (value, unit) = match &mut wish.wanted {
        Wanted::Lux(lux) => (Some(lux), " lx"),
        Wanted::Luminance(nit) => (Some(nit), luminance_unit(here.units)),
        Wanted::Times(times) => (Some(times), "×"),
        Wanted::Keep => (None, "keep"),
        Wanted::Match { file, tone, exposure_ev } => match here.shown_with(file, *tone, *exposure_ev) {
            Some((shown, Exposure::Free)) => {
                curve_ui(ui, &wish.name, shown, tone);
                (None, "")
            }
            _ => (None, "match"),
        },
    };
    match value {
        Some(value) => {
            let speed = (0.01 * *value).max(0.01);
            let drag = Number::new(value).range(0.0..=1e6).leaves_what_is_outside().speed(speed).suffix(unit);
            let drag = drag.max_decimals(2);
            let tip = format!("What is wanted there{}{}", if unit.is_empty() { "" } else { ", in" }, unit);
            let (drag, tip) = if is_lux { (drag.read(lux_of), format!("{tip}; {FOOT_CANDLES}")) } else { (drag, tip) };
            ui.add(drag).on_hover_text(tip).accessible_name(name);
        }
        None if unit.is_empty() => {}
        None => {
            ui.label(unit);
        }
    }
    let weight = Number::new(&mut wish.weight).range(0.01..=100.0).leaves_what_is_outside();
    ui.add(weight.speed(0.02).prefix("weight "))
        .on_hover_text("How much it counts beside the others")
        .accessible_name(format!("{} weight", wish.name));
}

/// Which tone curve a picture of unknown exposure was shown with.
fn curve_ui(ui: &mut Ui, name: &str, shown: Tone, own: &mut Option<Tone>) {
    let words = |tone: Tone| if tone == Tone::Linear { "Photograph" } else { tone_name(tone) };
    let mut tone = shown;
    let combo = egui::ComboBox::from_id_salt(("curve", name)).selected_text(words(tone)).width(96.0);
    let combo = combo.show_ui(ui, |ui| {
        for known in CURVES {
            ui.selectable_value(&mut tone, known, words(known));
        }
    });
    combo
        .response
        .on_hover_text("The tone curve that the picture was made with. Its exposure is found; an EXR, or a PNG of this program, needs neither")
        .widget_info(|| egui::WidgetInfo::labeled(egui::Role::ComboBox, true, format!("{name} tone curve")));
    if tone != shown {
        *own = Some(tone);
    }
}

fn limits_ui(ui: &mut Ui, wishes: &mut Wishes, view: &SolveView) {
    let lights = (view.lights)();
    let n_free = lights.iter().filter(|key| !wishes.held.contains(*key)).count();
    let title = format!("Lights to change ({n_free} of {})", lights.len());
    CollapsingHeader::new(title).id_salt("free lights").show(ui, |ui| {
        ui.horizontal(|ui| {
            if ui.button("All").on_hover_text("All that are not muted").clicked() {
                wishes.held.clear();
            }
            if ui.button("None").on_hover_text("All of them stay as they are").clicked() {
                wishes.held = lights.iter().cloned().collect();
            }
        });
        ScrollArea::vertical().id_salt("free list").max_height(160.0).show(ui, |ui| {
            for key in &lights {
                let mut is_free = !wishes.held.contains(key);
                let name = view.look.name_of(key);
                let check = ui.add(Checkbox::new(&mut is_free, name)).accessible_name(format!("{name} may change"));
                match (check.changed(), is_free) {
                    (true, true) => drop(wishes.held.remove(key)),
                    (true, false) => drop(wishes.held.insert(key.clone())),
                    _ => {}
                }
            }
            keep_in_sight(ui, "free list");
        });
    });
    Grid::new("limits").num_columns(2).spacing([10.0, 5.0]).show(ui, |ui| {
        ui.label("Factor");
        ui.horizontal(|ui| {
            let [least, most] = &mut wishes.bounds;
            let low = Number::new(least).range(0.0..=1e6).speed(0.01).suffix("×").max_decimals(3);
            let low = ui.add(low).on_hover_text("Least intensity, times the file").accessible_name("Least factor");
            let before = before_drag(ui, &low, *most);
            if low.changed() {
                *most = before;
            }
            ui.label("to");
            let high = Number::new(most).range(0.0..=1e6).speed(0.1).suffix("×").max_decimals(3);
            ui.add(high).on_hover_text("Largest intensity, times the file").accessible_name("Largest factor");
            *most = most.max(*least);
        });
        ui.end_row();
        ui.label("Rest");
        let keep = Slider::new(&mut wishes.keep, 1e-4..=1.0).logarithmic(true).max_decimals(4);
        slider_ui(ui, keep.clamping(SliderClamping::Edits), Spelling::default())
            .on_hover_text("How much the rest of the picture is kept: left hardly, right as much as a wish counts")
            .accessible_name("Keep the rest");
        ui.end_row();
        ui.label("");
        ui.horizontal(|ui| {
            let mut may_change = wishes.colors.is_some();
            let check = ui.checkbox(&mut may_change, "Colors too");
            if check.on_hover_text("Lets the colors of lamps change, but not of the sky").changed() {
                wishes.colors = may_change.then_some(USUAL_SATURATION);
            }
            if let Some(saturation) = &mut wishes.colors {
                let saturation = Number::new(saturation).range(0.0..=1.0).speed(0.005).fixed_decimals(2);
                ui.add(saturation)
                    .on_hover_text("Most saturation: 0 is white, 1 is any color")
                    .accessible_name("Most saturation");
            }
        });
        ui.end_row();
    });
}

fn run_ui(ui: &mut Ui, wishes: &Wishes, view: &SolveView, actions: &mut Vec<Action>) {
    let can_solve = wishes.list.iter().any(|wish| view.here.misfit(wish).is_none());
    // What it waits for may be longer than the panel is wide.
    ui.horizontal_wrapped(|ui| {
        let solve = Button::new(RichText::new("Solve").color(theme::ON_ACCENT)).fill(theme::ACCENT);
        let solve = ui.add_enabled(can_solve && view.busy.is_none() && !view.is_soloed, solve);
        let solve = solve.on_hover_text("Looks for the lights that come closest");
        let why = match () {
            () if wishes.list.is_empty() => "Add a wish first",
            () if view.is_soloed => "Clear the solo first: it hides what the other lights bring",
            () if can_solve => "The lights are being looked for",
            () => "No wish fits what is shown",
        };
        if solve.on_disabled_hover_text(why).clicked() {
            actions.push(Action::Solve);
        }
        if let Some(words) = view.busy {
            ui.spinner();
            ui.label(words);
        }
    });
}

fn solution_ui(ui: &mut Ui, state: &mut SolveState, view: &SolveView, actions: &mut Vec<Action>) {
    let (Some(solution), look) = (&state.solution, view.look) else { return };
    ui.add_space(4.0);
    for outcome in &solution.outcomes {
        let tone = if outcome.is_met { ui.visuals().text_color() } else { ui.visuals().warn_fg_color };
        ui.label(RichText::new(outcome.words()).color(tone));
    }
    ui.label(RichText::new(format!("Residual {:.2} %", 100.0 * solution.misfit)).weak())
        .on_hover_text("Root mean square of how far the wishes are missed");
    if view.is_outdated {
        let words = RichText::new("The wishes have changed since; solve again").color(ui.visuals().warn_fg_color);
        ui.label(words).on_hover_text("These lights are for the wishes as they were");
    }
    let changed: Vec<_> = solution.changes.iter().filter(|change| change.is_change()).collect();
    let title = format!("{} of {} lights change", changed.len(), solution.changes.len());
    CollapsingHeader::new(title).id_salt("changes").show(ui, |ui| {
        for change in changed {
            ui.label(change.words(look.name_of(&change.key)));
        }
    });
    for note in &solution.notes {
        ui.label(RichText::new(look.renamed(note)).weak());
    }
    ui.checkbox(&mut state.is_previewed, "Preview")
        .on_hover_text("Show the picture under these lights before they are taken over");
    let answers = ui.horizontal(|ui| {
        if ui.button("Accept").on_hover_text("Take these lights over, one step of undo").clicked() {
            actions.push(Action::AcceptSolution);
        }
        if ui.button("Discard").on_hover_text("Leave the lights as they were").clicked() {
            actions.push(Action::DiscardSolution);
        }
    });
    if std::mem::take(&mut state.is_news) {
        answers.response.scroll_to_me(None);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn illuminance_is_typed_in_lux_or_foot_candles() {
        assert_eq!(["500", "500 lx", "1,5 lx"].map(lux_of), [500.0, 500.0, 1.5].map(Some));
        assert_eq!(["50 fc", "50fc"].map(lux_of), [Some(50.0 * FOOT_CANDLE_LX); 2]);
        assert_eq!(["fc", "50 cd", ""].map(lux_of), [None; 3]);
    }
}
