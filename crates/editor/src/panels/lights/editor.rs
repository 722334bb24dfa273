//! The editor of what is selected: one light or many, changed relatively or set to one value.

use std::collections::BTreeSet;

use clerestory_transport::light::LightSetting;
use eframe::egui::{Align, Layout, RichText, ScrollArea, Ui};

use super::LightsView;
use super::fader::{STEP_EV, stepped};
use super::listed::{LightOf, Listed};
use super::mix::Mix;
use super::row;
use super::scale::{Measure, Shown, number_ui};
use crate::panels::color::{KelvinChoice, Tint, kelvin_field_ui, tint_ui};
use crate::panels::number::{Number, before_drag};
use crate::panels::sight::keep_in_sight;

/// Stops that a change may be.
const MOST_EV: f64 = 20.0;
/// Part of the height of the window that the details of a light may take.
const DETAILS: f32 = 0.3;
/// Width of the words in front of the fields.
const WORDS: f32 = 72.0;

/// Indices of the selected lights, in the order of the list.
fn selected(mix: &Mix) -> Vec<usize> {
    (0..mix.lights.len()).filter(|idx| mix.state.selection.has(&mix.lights[*idx].key)).collect()
}

/// Draws the editor, if anything is selected.
pub(super) fn editor_ui(ui: &mut Ui, mix: &mut Mix) {
    let selected = selected(mix);
    if selected.is_empty() {
        return;
    }
    let keys = mix.keys(&selected);
    // What is typed for some lights is never taken for others.
    ui.push_id(&keys, |ui| of_selected_ui(ui, mix, &selected, &keys));
}

fn of_selected_ui(ui: &mut Ui, mix: &mut Mix, selected: &[usize], keys: &[String]) {
    ui.add_space(2.0);
    heading_ui(ui, mix, selected, keys);
    ui.horizontal(|ui| {
        words_ui(ui, "Change by");
        offset_ui(ui, mix, keys);
    });
    // In a narrow panel what has no room goes on in another line.
    ui.horizontal_wrapped(|ui| {
        words_ui(ui, "Set to");
        absolute_ui(ui, mix, selected);
        color_ui(ui, mix, selected);
    });
    // The list has it below the row.
    if let ([one], true) = (selected, mix.state.layout.view != LightsView::List) {
        let (lights, most) = (mix.lights, DETAILS * ui.ctx().content_rect().height());
        let area = ScrollArea::vertical().id_salt("details").max_height(most);
        area.show(ui, |ui| {
            row::below_ui(ui, mix, &lights[*one]);
            keep_in_sight(ui, "details");
        });
    }
    ui.add_space(2.0);
}

fn words_ui(ui: &mut Ui, words: &str) {
    ui.allocate_ui_with_layout([WORDS, row::HEIGHT - 2.0].into(), Layout::left_to_right(Align::Center), |ui| {
        ui.set_min_width(WORDS);
        ui.label(RichText::new(words).weak());
    });
}

fn heading_ui(ui: &mut Ui, mix: &mut Mix, selected: &[usize], keys: &[String]) {
    ui.horizontal(|ui| {
        row::letters_ui(ui, mix, "selected lights", keys);
        let title = match selected {
            [one] => mix.lights[*one].name.clone(),
            many => format!("{} lights selected", many.len()),
        };
        let shown: BTreeSet<usize> = mix.items.iter().flat_map(|item| item.lights().iter().copied()).collect();
        let n_hidden = selected.iter().filter(|idx| !shown.contains(idx)).count();
        let title = if n_hidden > 0 { format!("{title}, {n_hidden} not shown") } else { title };
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            let close = ui.button("×").on_hover_text("Select nothing");
            if close.accessible_name("Select nothing").clicked() {
                mix.state.selection.clear();
                mix.state.choose_lamp(None);
            }
            let reset = ui.button("Reset").on_hover_text("As in the file");
            if reset.accessible_name("Reset selected lights").clicked() {
                keys.iter().for_each(|key| mix.reset(key));
            }
            if let [one] = selected {
                let (light, lights) = (&mix.lights[*one], mix.lights);
                let more = ui.menu_button("More", |ui| row::menu_ui(ui, mix, &lights[*one])).response;
                more.accessible_name(format!("More for {}", light.name));
            }
            ui.with_layout(Layout::left_to_right(Align::Center), |ui| {
                ui.add(eframe::egui::Label::new(RichText::new(title).strong()).truncate());
            });
        });
    });
}

/// All of some lights so many stops brighter: their ratios stay.
pub(super) fn offset(mix: &mut Mix, keys: &[String], stops: f32) {
    for key in keys {
        let was = mix.look.lights.own_setting(key);
        set_offset(mix, key, was, stops);
    }
}

/// A light so many stops brighter than it was.
fn set_offset(mix: &mut Mix, key: &str, was: LightSetting, stops: f32) {
    mix.look.lights.set(key, LightSetting { intensity: stepped(was.intensity, stops), ..was });
}

fn offset_ui(ui: &mut Ui, mix: &mut Mix, keys: &[String]) {
    let tip = "Their ratios stay; a light that is off stays off";
    if ui.button("−⅓").on_hover_text("A third of a stop darker, [").accessible_name("Darker by ⅓ EV").clicked() {
        offset(mix, keys, -STEP_EV);
    }
    let id = ui.scope_id().with("offset");
    let mut stops: f64 = ui.data(|data| data.get_temp(id)).unwrap_or(0.0);
    let settings: Vec<LightSetting> = keys.iter().map(|key| mix.look.lights.own_setting(key)).collect();
    let now = (stops, settings);
    let number = Number::new(&mut stops).range(-MOST_EV..=MOST_EV).speed(0.02).suffix(" EV");
    let number = number.words(|stops, _| format!("{stops:+.2}"));
    let field = ui.add_sized([76.0, 22.0], number).on_hover_text(tip).accessible_name("Change selected lights by EV");
    let (from, settings) = before_drag(ui, &field, now);
    if field.changed() {
        for (key, setting) in keys.iter().zip(settings) {
            set_offset(mix, key, setting, (stops - from) as f32);
        }
    }
    // The next change begins at 0 again.
    let kept = if field.dragged() || field.has_focus() { stops } else { 0.0 };
    ui.data_mut(|data| data.insert_temp(id, kept));
    if ui.button("+⅓").on_hover_text("A third of a stop brighter, ]").accessible_name("Brighter by ⅓ EV").clicked()
    {
        offset(mix, keys, STEP_EV);
    }
}

/// The number that all of them get.
fn absolute_ui(ui: &mut Ui, mix: &mut Mix, selected: &[usize]) {
    let settings: Vec<LightSetting> = selected.iter().map(|idx| mix.setting(&mix.lights[*idx])).collect();
    let lights = || selected.iter().map(|idx| &mix.lights[*idx]).zip(&settings);
    let mut measures: Vec<Measure> = lights().map(|(light, setting)| mix.measure(light, setting)).collect();
    // Lights that are counted in several units have only factors in common.
    if measures.iter().any(|measure| measure.unit() != measures[0].unit()) {
        measures.fill(mix.state.layout.scale.of_group());
    }
    let numbers: Vec<f64> = measures.iter().zip(&settings).map(|(m, setting)| m.number(setting.intensity)).collect();
    let is_mixed = numbers.iter().any(|number| (number - numbers[0]).abs() > 1e-4 * numbers[0].abs());
    let shown = if is_mixed { Shown::Mixed } else { Shown::WithUnit };
    let mut intensity = settings[0].intensity;
    let field = number_ui(ui, "Selected lights", (measures[0], shown), &mut intensity, 76.0);
    if field.on_hover_text(format!("All of them, in {}", measures[0].unit())).changed() {
        let number = measures[0].number(intensity);
        for ((idx, measure), setting) in selected.iter().zip(&measures).zip(&settings) {
            let setting = LightSetting { intensity: measure.intensity(number), ..*setting };
            mix.look.lights.set(&mix.lights[*idx].key, setting);
        }
    }
}

/// The color and the color temperature that all of them get.
fn color_ui(ui: &mut Ui, mix: &mut Mix, selected: &[usize]) {
    let all = mix.lights;
    let lights: Vec<&Listed> = selected.iter().map(|idx| &all[*idx]).collect();
    let tint_of = |light: &Listed| {
        let setting = mix.setting(light);
        Tint { color: setting.color, kelvin: setting.kelvin }
    };
    let first = tint_of(lights[0]);
    let is_mixed = lights.iter().any(|light| tint_of(light) != first || light.own_color() != lights[0].own_color());
    let is_free = lights.iter().all(|light| matches!(light.light, LightOf::Look(..)));
    let choice = if is_free { KelvinChoice::OfferedOnWhite } else { KelvinChoice::Offered };
    let mut tint = first;
    let mut is_set = tint_ui(ui, "Selected lights", &mut tint, lights[0].own_color(), choice);
    let kelvins = lights.iter().any(|light| tint_of(light).kelvin != first.kelvin);
    is_set |= kelvin_field_ui(ui, "Selected lights", &mut tint, kelvins);
    if is_mixed {
        ui.label(RichText::new("mixed").weak().small()).on_hover_text("Their colors differ");
    }
    if is_set {
        for light in lights {
            mix.set_tint(light, tint);
        }
    }
}
