//! The list of lights: a row each, as on a mixer.

use std::collections::BTreeSet;

use clerestory_transport::basis::{LightBasis, LightSource, SourceKind};
use clerestory_transport::light::{LightRig, LightSetting};
use eframe::egui::{
    self, Button, Color32, DragValue, Label, RichText, ScrollArea, Sense, Slider, SliderClamping, TextEdit, Ui,
};

use super::color::{KelvinChoice, Tint, tint_ui};
use super::lamps::{LampChoice, LampState, add_button, lamps_ui, missing_ui};
use super::spots::spots_ui;
use crate::action::Action;
use crate::look::Look;
use crate::theme;

/// What the list remembers and no look holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LightsState {
    /// Part of the names to show.
    pub filter: String,
    /// Keys of the lights that alone are heard.
    pub solo: BTreeSet<String>,
    /// Key of the light that was chosen in the picture; its row is marked.
    pub chosen: Option<String>,
    /// Panel and spot that were touched last.
    pub spot: Option<(String, usize)>,
    /// The free lamps.
    pub lamps: LampState,
}

/// Lists up to this long need no filter.
const FILTER_FROM: usize = 10;
/// Texels a side of a panel that is chosen in the window.
const PANEL_RESOLUTIONS: [u32; 3] = [8, 16, 32];
/// Upper end of the intensity slider, times the file; numbers may go beyond.
const SLIDER_MAX: f32 = 10.0;
/// Upper end of the intensity in numbers.
const INTENSITY_MAX: f32 = 1e6;

/// The lights as they are seen: while any is soloed, all others are dark.
pub fn heard(basis: &LightBasis, rig: &LightRig, solo: &BTreeSet<String>) -> LightRig {
    let mut rig = rig.clone();
    let is_solo = |key: &str| solo.contains(key);
    if basis.sources.iter().any(|source| is_solo(&source.key)) || rig.lamps.iter().any(|lamp| is_solo(&lamp.key)) {
        for source in basis.sources.iter().filter(|source| !is_solo(&source.key)) {
            rig.lights.entry(source.key.clone()).or_default().muted = true;
        }
        for key in solo {
            if let Some(setting) = rig.lights.get_mut(key) {
                setting.muted = false;
            }
        }
        for lamp in &mut rig.lamps {
            lamp.setting.muted = !is_solo(&lamp.key);
        }
    }
    rig
}

/// Draws the list.
pub fn lights_ui(
    ui: &mut Ui,
    basis: &LightBasis,
    look: &mut Look,
    state: &mut LightsState,
    lamps: &LampChoice,
    actions: &mut Vec<Action>,
) {
    let sources: Vec<&LightSource> = basis.sources.iter().filter(|s| s.kind != SourceKind::Constant).collect();
    heading_ui(ui, state, lamps, actions);
    if sources.len() + look.lights.lamps.len() > FILTER_FROM {
        let edit = TextEdit::singleline(&mut state.filter).hint_text("Filter by name").desired_width(f32::INFINITY);
        ui.add(edit).accessible_name("Filter lights");
    } else {
        state.filter.clear();
    }
    let filter = state.filter.to_lowercase();
    ScrollArea::vertical().id_salt("lights").auto_shrink([false, false]).show(ui, |ui| {
        missing_ui(ui, lamps, actions);
        let is_taken = |key: &str| basis.source(key).is_some();
        let remembered = (&mut state.lamps, &mut state.solo);
        let mut n_listed = lamps_ui(ui, &mut look.lights, remembered, (&is_taken, &filter), actions);
        for source in sources.iter().filter(|s| s.key.to_lowercase().contains(&filter)) {
            light_ui(ui, source, look, state, actions);
            n_listed += 1;
        }
        if n_listed == 0 {
            let words = if sources.is_empty() { "No lights in this scene" } else { "No light has this in its name" };
            ui.label(RichText::new(words).weak());
        }
        ui.add_space(8.0);
        if look.lights != LightRig::default() && ui.button("Reset all lights").clicked() {
            look.lights = LightRig::default();
        }
    });
}

/// The heading; while a light is soloed it says so, beside the title, so that no row moves under the pointer.
fn heading_ui(ui: &mut Ui, state: &mut LightsState, lamps: &LampChoice, actions: &mut Vec<Action>) {
    ui.add_space(4.0);
    ui.horizontal(|ui| {
        ui.label(RichText::new("Lights").heading().strong());
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            add_button(ui, lamps, actions);
            if state.solo.is_empty() {
                return;
            }
            let names: Vec<&str> = state.solo.iter().map(String::as_str).collect();
            let button = Button::new(RichText::new("Clear solo").color(theme::ON_ACCENT)).fill(theme::ACCENT).small();
            if ui.add(button).on_hover_text(format!("Only these are lit: {}", names.join(", "))).clicked() {
                state.solo.clear();
            }
        });
    });
    ui.separator();
}

fn light_ui(ui: &mut Ui, source: &LightSource, look: &mut Look, state: &mut LightsState, actions: &mut Vec<Action>) {
    let key = &source.key;
    let before = look.lights.lights.get(key).copied().unwrap_or_default();
    let mut setting = before;
    ui.push_id(key, |ui| {
        ui.horizontal(|ui| {
            ui.spacing_mut().item_spacing.x = 5.0;
            mute_and_solo_ui(ui, key, &mut setting, &mut state.solo);
            name_ui(ui, source, &mut setting, look, state, actions);
            level_ui(ui, source, &mut setting);
        });
        if let SourceKind::Panel { size_m, .. } = source.kind {
            spots_ui(ui, source, size_m, &mut look.lights.panels, &mut state.spot);
        }
    });
    if setting != before {
        store(&mut look.lights, key, setting);
    }
}

/// What equals the scene leaves no trace, so that undoing by hand is undoing.
fn store(rig: &mut LightRig, key: &str, setting: LightSetting) {
    if setting == LightSetting::default() {
        rig.lights.remove(key);
    } else {
        rig.lights.insert(key.to_string(), setting);
    }
}

pub(super) fn mute_and_solo_ui(ui: &mut Ui, key: &str, setting: &mut LightSetting, solo: &mut BTreeSet<String>) {
    let is_solo = solo.contains(key);
    if letter_ui(ui, "S", is_solo, theme::ACCENT).accessible_name(format!("Solo {key}")).on_hover_text("Solo").clicked()
    {
        if is_solo {
            solo.remove(key);
        } else {
            solo.insert(key.to_string());
        }
    }
    let mute = letter_ui(ui, "M", setting.muted, theme::ALERT);
    if mute.accessible_name(format!("Mute {key}")).on_hover_text("Mute").clicked() {
        setting.muted = !setting.muted;
    }
}

/// A small square button with a letter that lights up.
fn letter_ui(ui: &mut Ui, letter: &str, is_on: bool, on_color: Color32) -> egui::Response {
    let text = RichText::new(letter).small().strong();
    let text = if is_on { text.color(theme::ON_ACCENT) } else { text.weak() };
    let mut button = Button::new(text).min_size(egui::vec2(21.0, 21.0)).corner_radius(3);
    if is_on {
        button = button.fill(on_color);
    }
    ui.scope(|ui| {
        ui.spacing_mut().button_padding = egui::vec2(5.0, 2.0);
        ui.add(button)
    })
    .inner
}

fn name_ui(
    ui: &mut Ui,
    source: &LightSource,
    setting: &mut LightSetting,
    look: &mut Look,
    state: &mut LightsState,
    actions: &mut Vec<Action>,
) {
    let key = &source.key;
    let is_dark = setting.muted || (!state.solo.is_empty() && !state.solo.contains(key));
    let mut text = RichText::new(key);
    if is_dark {
        text = text.weak();
    } else if *setting != LightSetting::default() || look.lights.panels.contains_key(key) {
        text = text.strong();
    }
    let is_chosen = state.chosen.as_deref() == Some(key);
    if is_chosen {
        text = text.color(theme::ACCENT);
    }
    let width = (ui.available_width() * 0.38).max(60.0);
    let size = egui::vec2(width, ui.spacing().interact_size.y);
    let layout =
        egui::Layout::left_to_right(egui::Align::Center).with_main_justify(true).with_main_align(egui::Align::Min);
    let name = ui.allocate_ui_with_layout(size, layout, |ui| {
        ui.add(Label::new(text).truncate().sense(Sense::click()).selectable(false))
    });
    if is_chosen && !name.response.rect.intersects(ui.clip_rect()) {
        name.inner.scroll_to_me(None);
    }
    let strength = match source.kind {
        SourceKind::Image => String::new(),
        kind => format!(", {} {} in the file", source.strength, kind.unit()),
    };
    let kind = kind_words(source.kind);
    let name =
        name.inner.on_hover_text(format!("{key}\n{kind}{strength}\nDouble-click to reset, right-click for more"));
    let mut reset = name.double_clicked();
    name.context_menu(|ui| {
        reset |= ui.button("Reset").clicked();
        if ui.button("Solo this alone").clicked() {
            state.solo = BTreeSet::from([key.clone()]);
        }
        let is_punctual = matches!(source.kind, SourceKind::Point | SourceKind::Spot | SourceKind::Directional);
        let hint = "Mutes it, and puts a free lamp of the same light in its place";
        if is_punctual && ui.button("Make movable").on_hover_text(hint).clicked() {
            actions.push(Action::MakeMovable(key.clone()));
            ui.close();
        }
        if source.kind == SourceKind::Emitter {
            ui.menu_button("Make it a panel", |ui| panel_menu(ui, key, actions));
        }
    });
    if reset {
        *setting = LightSetting::default();
        look.lights.panels.remove(key);
    }
}

fn panel_menu(ui: &mut Ui, key: &str, actions: &mut Vec<Action>) {
    for resolution in PANEL_RESOLUTIONS {
        if ui.button(format!("{resolution} × {resolution} texels")).clicked() {
            actions.push(Action::ChoosePanel { node: key.to_string(), resolution });
            ui.close();
        }
    }
    ui.label(RichText::new("Spots of light can be moved on it\nThe scene is baked again").weak().small());
}

fn kind_words(kind: SourceKind) -> String {
    match kind {
        SourceKind::Point => "Point lamp".into(),
        SourceKind::Spot => "Spot lamp".into(),
        SourceKind::Directional => "Directional lamp".into(),
        SourceKind::Emitter => "Emissive surface".into(),
        SourceKind::Panel { resolution, .. } => format!("Panel of {resolution} × {resolution} texels"),
        SourceKind::Sky => "Sky".into(),
        SourceKind::Dome { divisions } => format!("Sky of {} patches", 144 * divisions * divisions + 146),
        SourceKind::Sun { .. } => "Sun".into(),
        SourceKind::Constant => "Unlit surfaces".into(),
        SourceKind::Image => "Picture taken under this light".into(),
    }
}

/// Slider, number and color, from the right so that they line up.
fn level_ui(ui: &mut Ui, source: &LightSource, setting: &mut LightSetting) {
    let key = &source.key;
    ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
        ui.spacing_mut().item_spacing.x = 6.0;
        let mut tint = Tint { color: setting.color, kelvin: setting.kelvin };
        if tint_ui(ui, key, &mut tint, source.color, KelvinChoice::Offered) {
            (setting.color, setting.kelvin) = (tint.color, tint.kelvin);
        }
        intensity_ui(ui, key, &mut setting.intensity);
    });
}

/// Number and slider of a factor to what the file says; laid out from right to left.
pub fn intensity_ui(ui: &mut Ui, key: &str, intensity: &mut f32) {
    let speed = (0.01 * f64::from(*intensity)).max(0.002);
    let number = DragValue::new(intensity).range(0.0..=INTENSITY_MAX).speed(speed).suffix("×");
    let number = number.custom_formatter(|factor, _| factor_words(factor));
    ui.add_sized([54.0, 22.0], number).accessible_name(format!("{key} factor"));
    ui.spacing_mut().slider_width = (ui.available_width() - 2.0).max(40.0);
    let mut level = *intensity;
    let slider = Slider::new(&mut level, 0.0..=SLIDER_MAX)
        .logarithmic(true)
        .smallest_positive(0.01)
        .clamping(SliderClamping::Never)
        .show_value(false);
    if ui.add(slider).accessible_name(format!("{key} intensity")).changed() {
        *intensity = level.clamp(0.0, INTENSITY_MAX);
    }
}

/// As many digits as are told apart, in a width that does not change under a slider that is dragged.
fn factor_words(factor: f64) -> String {
    match factor {
        f if f < 9.995 => format!("{f:.2}"),
        f if f < 99.95 => format!("{f:.1}"),
        f => format!("{f:.0}"),
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    fn basis() -> LightBasis {
        let source =
            |key: &str, kind| LightSource { key: key.into(), kind, columns: 0..1, color: Vec3::ONE, strength: 1.0 };
        LightBasis::new(vec![
            source("a", SourceKind::Point),
            source("b", SourceKind::Emitter),
            source("unlit", SourceKind::Constant),
        ])
    }

    #[test]
    fn solo_darkens_all_other_lights_and_wins_over_mute() {
        let mut rig = LightRig::default();
        rig.lights.insert("a".into(), LightSetting { muted: true, ..LightSetting::default() });
        let solo = BTreeSet::from(["a".to_string()]);
        let coefficients = basis().project(&heard(&basis(), &rig, &solo));
        assert_eq!(coefficients, [[1.0; 3], [0.0; 3], [1.0; 3]]);
        assert_eq!(heard(&basis(), &rig, &BTreeSet::new()), rig);
    }

    #[test]
    fn factors_of_any_size_have_three_digits_or_their_whole_part() {
        assert_eq!(
            [0.0, 1.0, 9.99, 9.999, 12.34, 99.96, 5000.0].map(factor_words),
            ["0.00", "1.00", "9.99", "10.0", "12.3", "100", "5000"]
        );
    }

    #[test]
    fn a_solo_that_this_scene_does_not_know_darkens_nothing() {
        let rig = LightRig::default();
        assert_eq!(heard(&basis(), &rig, &BTreeSet::from(["elsewhere".to_string()])), rig);
    }

    #[test]
    fn a_setting_like_the_file_leaves_no_trace() {
        let mut rig = LightRig::default();
        store(&mut rig, "a", LightSetting { intensity: 2.0, ..LightSetting::default() });
        assert_eq!(rig.lights.len(), 1);
        store(&mut rig, "a", LightSetting::default());
        assert_eq!(rig, LightRig::default());
    }
}
