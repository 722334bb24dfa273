//! Exposure, white balance, tone curve, and false color.

use clerestory_relight::display::{Dither, Metering, Spacing, Tone, WhitePoint};
use eframe::egui::{self, Slider, SliderClamping, Ui};

use super::measure::{LuxBake, missing_ui, preliminary_ui};
use super::number::{Number, Spelling, before_drag, slider_ui};
use crate::action::Action;
use crate::isolux::Isolux;
use crate::legend::Legend;
use crate::look::display::{COMPENSATION_EV, DISPLAY_KELVIN, PERCENT_DEFAULT, WHITE_DUV, WHITE_KELVIN};
use crate::look::{Display, FalseColor, Quantity, Units};
use crate::theme::{self, Fold};

/// What the panel is told beside the look.
#[derive(Clone, Copy, Debug)]
pub struct DisplayView {
    /// Exposure of the picture, EV.
    pub shown_ev: f32,
    /// Exposure that suited it when it was last metered, EV.
    pub metered_ev: f32,
    /// What its colors mean, where they are false.
    pub legend: Option<Legend>,
    /// What its numbers count.
    pub units: Units,
    /// Whether the light that arrives at its pixels was baked.
    pub has_illuminance: bool,
    /// How it can be had.
    pub lux_bake: LuxBake,
}

/// A choice with its name and its hint.
type Named<T> = (T, &'static str, &'static str);

const TONES: [Named<Tone>; 5] = [
    (
        Tone::Agx,
        "AgX",
        "Troy Sobotka's AgX, base contrast for Rec. 709 in Wrensch's small form: long shoulder, bright colors fade to white like film",
    ),
    (Tone::Aces, "ACES", "Stephen Hill's fit to the RRT and ODT of ACES: strong contrast, 0.18 is shown as 0.106"),
    (Tone::Neutral, "Neutral", "Khronos PBR neutral: true colors, short shoulder"),
    (Tone::Reinhard, "Reinhard", "Reinhard's extended curve by luminance: hues stay, white is two stops above 1"),
    (Tone::Linear, "Linear", "No curve, bright parts clip"),
];
/// Name of a tone curve.
pub fn tone_name(tone: Tone) -> &'static str {
    TONES.iter().find(|(known, ..)| *known == tone).map_or("", |(_, name, _)| name)
}

const METERINGS: [Named<Metering>; 3] = [
    (Metering::Auto, "Median", "Four times the median luminance is shown as 1"),
    (Metering::LogAverage, "Log average", "The log-average luminance is shown as middle gray, 0.18"),
    (
        Metering::Percentile(PERCENT_DEFAULT),
        "Percentile",
        "What this percentage of the pixels stays below is shown as 1",
    ),
];
const SPACINGS: [Named<Spacing>; 2] = [
    (Spacing::Log, "Logarithmic", "Equal ratios of light are equally far apart, as eyes judge them"),
    (Spacing::Linear, "Even", "Equal differences of light are equally far apart"),
];
const QUANTITIES: [Named<Option<Quantity>>; 3] = [
    (None, "Off", "The picture"),
    (Some(Quantity::Luminance), "Luminance", "Light that is seen, cd/m²"),
    (Some(Quantity::Illuminance), "Illuminance", "Light that arrives at the surfaces seen, lx"),
];
const LINES: [Named<Isolux>; 3] = [
    (Isolux::Off, "Off", "Colors alone"),
    (Isolux::Lux, "Lux", "Lines at 100, 200, 300, 500, 750, 1000 lx and so on, each with its value"),
    (Isolux::FootCandles, "Foot-candles", "Lines at 5, 10, 20, 30, 50, 75, 100 fc and so on, each with its value"),
];
/// Most that a look holds, and stops on either side of the exposure that suits the picture.
const MOST_EV: f32 = 60.0;
const EV_SPAN: f32 = 6.0;

/// Draws it.
pub fn display_ui(ui: &mut Ui, display: &mut Display, view: &DisplayView, actions: &mut Vec<Action>) {
    theme::folding(ui, "Display", Fold::Open, |ui| content_ui(ui, display, view, actions));
}

fn content_ui(ui: &mut Ui, display: &mut Display, view: &DisplayView, actions: &mut Vec<Action>) {
    egui::Grid::new("display").num_columns(2).spacing([10.0, 7.0]).show(ui, |ui| {
        exposure_rows(ui, display, view);
        let label = ui.label("Tone curve");
        choice_ui(ui, "tone", &mut display.tone, &TONES, label.id);
        ui.end_row();
        white_rows(ui, &mut display.white);
        dither_row(ui, &mut display.dither);
        false_color_rows(ui, &mut display.false_color, view);
    });
    match (display.quantity(), view.has_illuminance) {
        (Some(Quantity::Illuminance), true) => preliminary_ui(ui, view.lux_bake),
        (Some(Quantity::Illuminance), false) => missing_ui(ui, view.lux_bake, actions),
        _ => {}
    }
}

fn exposure_rows(ui: &mut Ui, display: &mut Display, view: &DisplayView) {
    ui.label("Exposure");
    exposure_ui(ui, display, view);
    ui.end_row();
    ui.label("");
    let mut is_auto = display.exposure_ev.is_none();
    ui.horizontal(|ui| {
        let auto = ui.checkbox(&mut is_auto, "Auto").on_hover_text("Keep the exposure that suits the picture");
        if auto.changed() {
            let kept = ((view.shown_ev * 100.0).round() / 100.0).clamp(-MOST_EV, MOST_EV);
            display.exposure_ev = if is_auto { None } else { Some(kept) };
        }
        if is_auto {
            compensation_ui(ui, &mut display.compensation_ev);
        }
    });
    ui.end_row();
    if display.exposure_ev.is_some() {
        return;
    }
    let label = ui.label("Metering");
    let percent = match display.metering {
        Metering::Percentile(percent) => percent,
        Metering::Auto | Metering::LogAverage => PERCENT_DEFAULT,
    };
    let mut choices = METERINGS;
    choices[2].0 = Metering::Percentile(percent);
    choice_ui(ui, "metering", &mut display.metering, &choices, label.id);
    ui.end_row();
    if let Metering::Percentile(percent) = &mut display.metering {
        let label = ui.label("Below white");
        let drag = Number::new(percent).range(0.0..=100.0).speed(0.1).suffix(" %");
        ui.add(drag).labelled_by(label.id).on_hover_text(METERINGS[2].2);
        ui.end_row();
    }
}

/// What is added to the exposure that suits the picture.
fn compensation_ui(ui: &mut Ui, compensation_ev: &mut f32) {
    let range = (*COMPENSATION_EV.start() as f32)..=(*COMPENSATION_EV.end() as f32);
    let drag = Number::new(compensation_ev).range(range).speed(0.02).fixed_decimals(2).suffix(" EV");
    let signed = drag.words(|ev, _| if ev == 0.0 { "±0.00".into() } else { format!("{ev:+.2}") });
    let hint = "Exposure compensation: stops (EV) that are added to the exposure that suits the picture, so that a night may be darker than a day";
    ui.add(signed).on_hover_text(hint).accessible_name("Exposure compensation");
}

fn exposure_ui(ui: &mut Ui, display: &mut Display, view: &DisplayView) {
    ui.spacing_mut().slider_width = (ui.available_width() - 78.0).max(60.0);
    let shown_ev = still_while_typed(ui, view.shown_ev);
    let mut ev = display.exposure_ev.unwrap_or(shown_ev);
    let slider = Slider::new(&mut ev, view.metered_ev - EV_SPAN..=view.metered_ev + EV_SPAN)
        .clamping(SliderClamping::Never)
        .trailing_fill(false)
        .fixed_decimals(2)
        .suffix(" EV");
    let response = slider_ui(ui, slider, Spelling::with_unit(" EV"));
    let response = response.on_hover_text("Stops (EV): one more shows everything twice as bright");
    let response = response.accessible_name("Exposure");
    if response.changed() {
        display.exposure_ev = Some(ev.clamp(-MOST_EV, MOST_EV));
    }
}

/// A number that goes by itself stands still while somebody types: a field whose number is another one gives up its text.
fn still_while_typed(ui: &Ui, now: f32) -> f32 {
    let (id, is_typed) = (ui.scope_id().with("still"), ui.text_edit_focused());
    ui.data_mut(|data| {
        let (kept, was_typed) = data.get_temp(id).unwrap_or((now, false));
        // The text is taken in the frame in which the focus has gone.
        let kept = if is_typed || was_typed { kept } else { now };
        data.insert_temp(id, (kept, is_typed));
        kept
    })
}

fn white_rows(ui: &mut Ui, white: &mut Option<WhitePoint>) {
    ui.label("White");
    let mut is_balanced = white.is_some();
    let hint = "Show light of this white point as neutral (Bradford adaptation); off leaves colors exactly as they are";
    if ui.checkbox(&mut is_balanced, "Balance").on_hover_text(hint).changed() {
        *white = is_balanced.then_some(WhitePoint { kelvin: DISPLAY_KELVIN, duv: 0.0 });
    }
    ui.end_row();
    let Some(white) = white else { return };
    let label = ui.label("Temperature");
    ui.spacing_mut().slider_width = (ui.available_width() - 78.0).max(60.0);
    let kelvins = *WHITE_KELVIN.start() as f32..=*WHITE_KELVIN.end() as f32;
    // What a look says more exactly stays.
    let slider = Slider::new(&mut white.kelvin, kelvins).logarithmic(true).clamping(SliderClamping::Edits);
    let slider = slider.trailing_fill(false).fixed_decimals(0).suffix(" K");
    let slider = slider_ui(ui, slider, Spelling::with_unit(" K")).labelled_by(label.id);
    slider.on_hover_text("Color temperature of the light that is shown as neutral");
    ui.end_row();
    let label = ui.label("Tint");
    let duvs = *WHITE_DUV.start() as f32..=*WHITE_DUV.end() as f32;
    let drag = Number::new(&mut white.duv).range(duvs).speed(0.0001).fixed_decimals(4).suffix(" Duv");
    let hint = "Distance of that light from the black body in CIE 1960 uv: positive is green light, negative magenta";
    ui.add(drag).labelled_by(label.id).on_hover_text(hint);
    ui.end_row();
}

fn dither_row(ui: &mut Ui, dither: &mut Dither) {
    ui.label("");
    let mut is_dithered = *dither == Dither::Ordered;
    let hint = "Break up bands in smooth shades, in the window and in PNG files; pixel by pixel the same every time";
    if ui.checkbox(&mut is_dithered, "Dither").on_hover_text(hint).changed() {
        *dither = if is_dithered { Dither::Ordered } else { Dither::Off };
    }
    ui.end_row();
}

fn false_color_rows(ui: &mut Ui, false_color: &mut Option<FalseColor>, view: &DisplayView) {
    let label = ui.label("False color");
    let mut quantity = false_color.map(|f| f.quantity);
    // What was not baked can be chosen, too: then the panel offers to bake it.
    let mut quantities = QUANTITIES;
    if view.units == Units::Relative {
        quantities[1].2 = "Light that is seen, as it was taken";
    }
    choice_ui(ui, "false color", &mut quantity, &quantities, label.id);
    if quantity != false_color.map(|f| f.quantity) {
        // Cd/m² and lux are different numbers: a range does not go along.
        let spacing = false_color.map_or(Spacing::default(), |f| f.spacing);
        let isolux = false_color.map_or(Isolux::default(), |f| f.isolux);
        *false_color = quantity.map(|quantity| FalseColor { quantity, spacing, range: None, isolux });
    }
    ui.end_row();
    let Some(false_color) = false_color else { return };
    let label = ui.label("Scale");
    choice_ui(ui, "spacing", &mut false_color.spacing, &SPACINGS, label.id);
    ui.end_row();
    let shown = view.legend.map_or([1.0, 1000.0], |legend| [legend.scale.low, legend.scale.high]);
    ui.label("");
    let mut fits = false_color.range.is_none();
    let hint = "Keep a scale that suits the picture, from its 0.5 to its 99.5 percentile, at round numbers";
    if ui.checkbox(&mut fits, "Fit range").on_hover_text(hint).changed() {
        false_color.range = (!fits).then_some(shown);
    }
    ui.end_row();
    range_row(ui, false_color, view.units);
    if false_color.quantity == Quantity::Illuminance {
        let label = ui.label("Isolux lines");
        choice_ui(ui, "isolux", &mut false_color.isolux, &LINES, label.id);
        ui.end_row();
    }
}

/// Keeps what a look can hold: from a lower to a higher value, above 0 where the scale is logarithmic. A scale of a look that no hand would
/// set stays until it is edited.
fn range_row(ui: &mut Ui, false_color: &mut FalseColor, units: Units) {
    let is_log = false_color.spacing == Spacing::Log;
    let Some([low, high]) = &mut false_color.range else { return };
    ui.label("Range");
    let row = ui.horizontal(|ui| {
        let unit = match (false_color.quantity, units) {
            (Quantity::Luminance, Units::Relative) => String::new(),
            (quantity, _) => format!(" {}", quantity.unit()),
        };
        let number = |ui: &mut Ui, value: &mut f32, name: &str| {
            let speed = f64::from(value.abs().max(1e-3)) * 0.01;
            let number =
                Number::new(value).range(0.0..=1e9).leaves_what_is_outside().speed(speed).suffix(unit.as_str());
            let hint = format!("{name}; what lies outside takes the color of the end");
            ui.add(number).on_hover_text(hint).accessible_name(name)
        };
        let from = number(ui, low, "Scale from");
        let to = number(ui, high, "Scale to");
        let before = before_drag(ui, &to, *low);
        if to.changed() {
            *low = before;
        }
        from.changed() || to.changed()
    });
    ui.end_row();
    let is_scale = *low < *high && (*low > 0.0 || !is_log);
    if row.inner || !is_scale {
        *high = high.max(1e-6);
        let least = if is_log { *high * 1e-6 } else { 0.0 };
        *low = low.clamp(least, *high * 0.999);
    }
}

fn choice_ui<T: Copy + PartialEq>(ui: &mut Ui, salt: &str, chosen: &mut T, choices: &[Named<T>], label: egui::Id) {
    let name = choices.iter().find(|choice| choice.0 == *chosen).map_or("", |choice| choice.1);
    let combo = egui::ComboBox::from_id_salt(salt).width(ui.available_width()).selected_text(name);
    let combo = combo.show_ui(ui, |ui| {
        for (value, name, hint) in choices {
            ui.selectable_value(chosen, *value, *name).on_hover_text(*hint);
        }
    });
    combo.response.labelled_by(label);
}

#[cfg(test)]
mod tests {
    use eframe::egui::{Event, Key, Modifiers, Role, vec2};
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable;

    use super::*;

    #[test]
    fn an_exposure_that_is_typed_while_the_picture_is_metered_is_taken() {
        let panel = |ui: &mut Ui, (display, shown_ev): &mut (Display, f32)| {
            let (units, lux_bake) = (Units::default(), LuxBake::default());
            let (shown_ev, metered_ev) = (*shown_ev, *shown_ev);
            let view = DisplayView { shown_ev, metered_ev, legend: None, units, has_illuminance: false, lux_bake };
            display_ui(ui, display, &view, &mut Vec::new());
        };
        let state = (Display::default(), 1.0);
        let mut window = Harness::builder().with_size(vec2(300.0, 600.0)).build_ui_state(panel, state);
        let fields = window.get_all_by_role_and_label(Role::SpinButton, "Exposure");
        let at = fields.last().unwrap().rect().center();
        window.hover_at(at);
        window.run_steps(2);
        window.drag_at(at);
        window.drop_at(at);
        window.run_steps(3);
        window.key_press_modifiers(Modifiers::COMMAND, Key::A);
        window.run_steps(1);
        for (key, shown_ev) in [("2", 1.5), (".", -3.0), ("5", 0.25)] {
            window.event(Event::Text(key.to_owned()));
            window.state_mut().1 = shown_ev;
            window.run_steps(2);
        }
        assert_eq!(window.state().0.exposure_ev, None);
        window.key_press(Key::Enter);
        window.run_steps(3);
        assert_eq!(window.state().0.exposure_ev, Some(2.5));
    }
}
