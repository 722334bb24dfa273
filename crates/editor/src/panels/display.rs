//! Exposure and tone curve.

use clerestory_relight::Tone;
use eframe::egui::{self, Slider, SliderClamping, Ui};

use crate::look::Display;
use crate::theme;

/// Tone curves with their names.
const TONES: [(Tone, &str, &str); 3] = [
    (Tone::Agx, "AgX", "Long shoulder, bright colors fade to white like film"),
    (Tone::Neutral, "Neutral", "True colors, short shoulder"),
    (Tone::Linear, "Linear", "No curve, bright parts clip"),
];
/// Stops on either side of the exposure that suits the picture.
const EV_SPAN: f32 = 6.0;

/// Draws it. `shown_ev` is the exposure of the picture, `metered_ev` the one that suited it when it was last metered.
pub fn display_ui(ui: &mut Ui, display: &mut Display, shown_ev: f32, metered_ev: f32) {
    theme::section(ui, "Display");
    egui::Grid::new("display").num_columns(2).spacing([10.0, 7.0]).show(ui, |ui| {
        ui.label("Exposure");
        exposure_ui(ui, display, shown_ev, metered_ev);
        ui.end_row();
        ui.label("");
        let mut is_auto = display.exposure_ev.is_none();
        let auto = ui.checkbox(&mut is_auto, "Auto").on_hover_text("Keep the exposure that suits the picture");
        if auto.changed() {
            display.exposure_ev = if is_auto { None } else { Some((shown_ev * 100.0).round() / 100.0) };
        }
        ui.end_row();
        let label = ui.label("Tone curve");
        tone_ui(ui, &mut display.tone, label.id);
        ui.end_row();
    });
}

fn exposure_ui(ui: &mut Ui, display: &mut Display, shown_ev: f32, metered_ev: f32) {
    ui.spacing_mut().slider_width = (ui.available_width() - 78.0).max(60.0);
    let mut ev = display.exposure_ev.unwrap_or(shown_ev);
    let slider = Slider::new(&mut ev, metered_ev - EV_SPAN..=metered_ev + EV_SPAN)
        .clamping(SliderClamping::Never)
        .trailing_fill(false)
        .fixed_decimals(2)
        .suffix(" EV");
    let response = ui.add(slider).accessible_name("Exposure");
    if response.changed() {
        display.exposure_ev = Some(ev.clamp(-60.0, 60.0));
    }
}

fn tone_ui(ui: &mut Ui, tone: &mut Tone, label: egui::Id) {
    let name = TONES.iter().find(|t| t.0 == *tone).map_or("", |t| t.1);
    let combo = egui::ComboBox::from_id_salt("tone").width(ui.available_width()).selected_text(name);
    let combo = combo.show_ui(ui, |ui| {
        for (value, name, hint) in TONES {
            ui.selectable_value(tone, value, name).on_hover_text(hint);
        }
    });
    combo.response.labelled_by(label);
}
