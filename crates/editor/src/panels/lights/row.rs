//! A light in the list: a row with name, mute, solo, fader, number and color.

use clerestory_transport::basis::SourceKind;
use eframe::egui::{
    self, Align, Button, Color32, Id, Label, Layout, Popup, Rect, Response, RichText, Sense, Shape, Ui, UiBuilder,
    Vec2, pos2, vec2,
};

use super::columns::{Part, columns_ui};
use super::fader::{More, fader_ui};
use super::listed::{LightOf, Listed};
use super::mix::Mix;
use super::names::renaming_ui;
use super::scale::{Measure, Scale, Shown, number_ui};
use super::solo;
use crate::action::Action;
use crate::panels::color::{Tint, tint_ui};
use crate::panels::lamps::{Unmovable, details_ui, lamp_menu, make_movable_ui};
use crate::panels::menu::context_menu;
use crate::panels::spots::spots_ui;
use crate::theme;

/// Height of a row in points.
pub(super) const HEIGHT: f32 = 24.0;
/// Under which the height of the row that was drawn last is kept.
const ROW: &str = "row of a light";
/// Width of a number with its unit.
pub(super) const NUMBER: f32 = 62.0;
/// Width of the mark in front of what differs from the file.
pub(super) const MARK: f32 = 8.0;
/// What the mark of a light says.
pub(super) const DIFFERS: &str = "Differs from the file";
/// Texels a side of a panel that is chosen in the window.
const PANEL_RESOLUTIONS: [u32; 3] = [8, 16, 32];

/// Draws the row of a light and what unfolds below it.
pub(super) fn row_ui(ui: &mut Ui, mix: &mut Mix, light: &Listed, indent: f32) {
    let key = light.key.as_str();
    let id = ui.scope_id().with(("light", key));
    keyed_ui(ui, id, |ui| {
        let background = ui.painter().add(Shape::Noop);
        let row = ui.horizontal(|ui| {
            ui.spacing_mut().item_spacing.x = 5.0;
            mark_ui(ui, mix.differs(light), DIFFERS);
            letters_ui(ui, mix, &light.name, &[key.to_owned()]);
            columns_ui(ui, mix, |ui, mix, part| match part {
                Part::Color => color_ui(ui, mix, light),
                Part::Name(width) => {
                    ui.add_space(indent);
                    name_ui(ui, mix, light, width - indent);
                }
                Part::Number => set_ui(ui, mix, light, |ui, measure, intensity| {
                    number_ui(ui, &light.name, (measure, Shown::WithUnit), intensity, NUMBER);
                }),
                Part::Fader(size) => set_ui(ui, mix, light, |ui, _, intensity| {
                    fader_ui(ui, &format!("{} intensity", light.name), (size, More::Right), intensity);
                }),
            });
        });
        let rect = row.response.rect;
        ui.data_mut(|data| data.insert_temp(Id::unique(ROW), rect.height()));
        if mix.state.selection.has(key) {
            let fill = ui.visuals().selection.bg_fill.gamma_multiply(0.55);
            ui.painter().set(background, Shape::rect_filled(rect.expand2(vec2(2.0, 1.0)), 3.0, fill));
        }
        if mix.state.scroll_to.as_deref() == Some(key) {
            mix.state.scroll_to = None;
            ui.scroll_to_rect(rect, Some(Align::Center));
        }
        below_ui(ui, mix, light);
    });
}

/// A part of the panel with an id of its own, that of a light or a group: what has the keyboard there, or is open, stays so while rows
/// move, as they do when lights are sorted, added and folded.
pub(super) fn keyed_ui<R>(ui: &mut Ui, id: Id, add: impl FnOnce(&mut Ui) -> R) -> R {
    ui.scope_builder(UiBuilder::new().scope_id(id), add).inner
}

/// Room for a dot where something is not as in the file.
pub(super) fn mark_ui(ui: &mut Ui, is_on: bool, tip: &str) {
    let (_, place) = ui.allocate_exact_size(vec2(MARK, HEIGHT - 2.0), Sense::hover());
    if is_on {
        dot_ui(ui, place, tip);
    }
}

/// The dot, in some place.
pub(super) fn dot_ui(ui: &Ui, place: Response, tip: &str) {
    ui.painter().circle_filled(pos2(place.rect.left() + 3.0, place.rect.center().y), 2.6, theme::ACCENT);
    place.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, tip));
    place.on_hover_text(tip);
}

/// Solo and mute of one light or of many.
pub(super) fn letters_ui(ui: &mut Ui, mix: &mut Mix, name: &str, keys: &[String]) {
    let is_solo = !keys.is_empty() && keys.iter().all(|key| mix.state.solo.contains(key));
    let letter = letter_ui(ui, "S", is_solo, theme::ACCENT).on_hover_text("Solo");
    if letter.accessible_name(format!("Solo {name}")).clicked() {
        solo::toggle(&mut mix.state.solo, keys);
    }
    let is_muted = !keys.is_empty() && keys.iter().all(|key| mix.look.lights.own_setting(key).muted);
    let letter = letter_ui(ui, "M", is_muted, theme::ALERT).on_hover_text("Mute");
    if letter.accessible_name(format!("Mute {name}")).clicked() {
        solo::toggle_mute(&mut mix.look.lights, keys);
    }
}

/// A small square button with a letter that lights up.
pub(super) fn letter_ui(ui: &mut Ui, letter: &str, is_on: bool, on_color: Color32) -> Response {
    let text = RichText::new(letter).small().strong();
    let text = if is_on { text.color(theme::ON_ACCENT) } else { text.weak() };
    let mut button = Button::new(text).min_size(vec2(21.0, 21.0)).corner_radius(3);
    if is_on {
        button = button.fill(on_color);
    }
    let button = ui.scope(|ui| {
        ui.spacing_mut().button_padding = vec2(5.0, 2.0);
        ui.add(button)
    });
    ui.ctx().accesskit_node_builder(button.inner.id, |node| node.set_toggled(is_on.into()));
    button.inner
}

/// A label of a width that is clicked.
pub(super) fn name_label_ui(ui: &mut Ui, text: RichText, width: f32) -> Response {
    let size = vec2(width, ui.spacing().interact_size.y);
    let layout = Layout::left_to_right(Align::Center).with_main_justify(true).with_main_align(Align::Min);
    ui.allocate_ui_with_layout(size, layout, |ui| {
        ui.add(Label::new(text).truncate().sense(Sense::click()).selectable(false))
    })
    .inner
}

/// The text of a light's name: weak where it is dark.
pub(super) fn name_text(ui: &Ui, mix: &Mix, light: &Listed) -> RichText {
    let text = RichText::new(&light.name);
    if mix.is_dark(&light.key) {
        text.weak()
    } else if mix.state.lamps.is_chosen(&light.key) {
        text.color(theme::accent_text(ui))
    } else if mix.differs(light) {
        text.strong()
    } else {
        text
    }
}

/// The field in place of a light's name, while it gets another. Answers whether it is there.
pub(super) fn renamed_ui(ui: &mut Ui, mix: &mut Mix, light: &Listed, size: Vec2) -> bool {
    let of = (light.key.as_str(), light.key.as_str());
    renaming_ui(ui, of, size, mix.look, &mut mix.state.renaming, mix.lights)
}

fn name_ui(ui: &mut Ui, mix: &mut Mix, light: &Listed, width: f32) {
    if renamed_ui(ui, mix, light, vec2(width, HEIGHT)) {
        return;
    }
    let text = name_text(ui, mix, light);
    let name = name_label_ui(ui, text, width);
    light_response(ui, mix, light, name);
}

/// What a name does wherever it stands: it is clicked, double-clicked, has a menu, and tells of its light.
pub(super) fn light_response(ui: &Ui, mix: &mut Mix, light: &Listed, name: Response) {
    let name = name.on_hover_ui(|ui| _ = ui.label(about(mix, light)));
    if name.hovered() {
        mix.state.pointed = Some(light.key.clone());
    }
    if mix.state.focus_next.take_if(|next| *next == light.key).is_some() {
        name.request_focus();
    }
    if name.has_focus() {
        mix.state.focused = Some(light.key.clone());
        // In a menu that is open the same keys go from item to item.
        let vertical_arrows = !Popup::is_any_open(ui.ctx());
        let steps = egui::EventFilter { vertical_arrows, ..egui::EventFilter::default() };
        ui.memory_mut(|memory| memory.set_focus_lock_filter(name.id, steps));
        ui.painter().rect_stroke(name.rect, 2.0, ui.visuals().selection.stroke, egui::StrokeKind::Outside);
    }
    if name.double_clicked() {
        mix.reset(&light.key);
        mix.state.selection.set(&light.key);
    } else if name.clicked() {
        mix.click(ui, &light.key);
    }
    context_menu(&name, |ui| menu_ui(ui, mix, light));
}

/// Name, kind, what the file and what the look give it, and how to go on.
fn about(mix: &Mix, light: &Listed) -> String {
    let setting = mix.setting(light);
    let all = mix.look.lights.setting(&light.key);
    let mut words = vec![light.name.clone()];
    if light.name != light.key {
        words.push(format!("In the file: {}", light.key));
    }
    words.push(light.kind_words());
    if let LightOf::Scene(source) = &light.light
        && source.kind != SourceKind::Image
    {
        words.push(format!("{} {} in the file", source.strength, source.kind.unit()));
    }
    let scales = [Scale::Lumen, Scale::Candela, Scale::Lux, Scale::Nit, Scale::Watt];
    let efficacy = mix.state.layout.efficacy;
    let measures = scales.map(|scale| (scale, scale.measure(light, &all, efficacy)));
    let amounts: Vec<String> = measures
        .into_iter()
        .filter(|(scale, measure)| measure.unit() == scale.name())
        .map(|(_, measure)| measure.words(all.intensity))
        .collect();
    if !amounts.is_empty() {
        words.push(format!("Now {}", amounts.join(", ")));
    }
    if all.intensity != setting.intensity && setting.intensity > 0.0 {
        words.push(format!("Its groups turn it by {:.2}×", all.intensity / setting.intensity));
    }
    words.push("Double-click to reset, right-click or menu key for more".into());
    words.join("\n")
}

/// What else can be done with a light.
pub(super) fn menu_ui(ui: &mut Ui, mix: &mut Mix, light: &Listed) {
    let key = &light.key;
    let is_replaced = mix.look.lights.is_replaced(key);
    let tip = if is_replaced { "As in the file; the lamp that shines in its place goes" } else { "As in the file" };
    if ui.button("Reset").on_hover_text(tip).clicked() {
        mix.reset(key);
        ui.close();
    }
    if ui.button("Solo this alone").clicked() {
        mix.state.solo = [key.clone()].into();
        ui.close();
    }
    if ui.button("Rename…").clicked() {
        mix.state.renaming = Some((key.clone(), light.name.clone()));
        mix.state.scroll_to = Some(key.clone());
        ui.close();
    }
    match &light.light {
        LightOf::Look(lamp, _) => lamp_menu(ui, lamp, &mut mix.state.lamps, mix.actions),
        LightOf::Scene(source) => {
            let is_punctual = matches!(source.kind, SourceKind::Point | SourceKind::Spot | SourceKind::Directional);
            if is_punctual {
                let measured = source.origin.profile.is_some().then_some(Unmovable::Measured);
                let unmovable = measured.or(is_replaced.then_some(Unmovable::Replaced));
                make_movable_ui(ui, key, unmovable, mix.actions);
            }
            match source.kind {
                SourceKind::Emitter => {
                    ui.menu_button("Make it a panel", |ui| panel_menu(ui, key, None, mix.actions));
                }
                // One of the file is what it is.
                SourceKind::Panel { resolution, .. } if mix.look.scene.panels.contains_key(key) => {
                    ui.menu_button("Change the panel", |ui| panel_menu(ui, key, Some(resolution), mix.actions));
                }
                _ => {}
            }
        }
    }
}

/// Resolutions of a panel but the one that it has, and the way back of one that is there.
fn panel_menu(ui: &mut Ui, key: &str, now: Option<u32>, actions: &mut Vec<Action>) {
    let others = PANEL_RESOLUTIONS.into_iter().map(Some).filter(|resolution| *resolution != now);
    for resolution in others.chain(now.map(|_| None)) {
        let words = resolution.map_or_else(|| "Back to a plain surface".to_owned(), |m| format!("{m} × {m} texels"));
        if ui.button(words).clicked() {
            actions.push(Action::ChoosePanel { node: key.to_owned(), resolution });
            ui.close();
        }
    }
    ui.label(RichText::new("Spots of light can be moved on it\nThe scene is baked again").weak().small());
}

/// Lets a widget change the intensity of a light.
fn set_ui(ui: &mut Ui, mix: &mut Mix, light: &Listed, add: impl FnOnce(&mut Ui, Measure, &mut f32)) {
    let mut setting = mix.setting(light);
    let measure = mix.measure(light, &setting);
    add(ui, measure, &mut setting.intensity);
    if setting != mix.setting(light) {
        mix.look.lights.set(&light.key, setting);
    }
}

/// The swatch of a light.
pub(super) fn color_ui(ui: &mut Ui, mix: &mut Mix, light: &Listed) {
    let setting = mix.setting(light);
    let mut tint = Tint { color: setting.color, kelvin: setting.kelvin };
    if tint_ui(ui, &light.name, &mut tint, light.own_color(), light.kelvin_choice()) {
        mix.set_tint(light, tint);
    }
}

/// What unfolds below a row, or with board and table at their foot: the spots of a panel, everything about the chosen lamp.
pub(super) fn below_ui(ui: &mut Ui, mix: &mut Mix, light: &Listed) {
    match &light.light {
        LightOf::Scene(source) => {
            if let SourceKind::Panel { resolution, size_m } = source.kind {
                let of = (*source, light.name.as_str());
                let marked = mix.basis.spots.get(&light.key).map(Vec::as_slice);
                let spots = (&mut mix.look.lights.panels, marked);
                spots_ui(ui, of, (resolution, size_m), spots, &mut mix.state.spot);
            }
        }
        LightOf::Look(lamp, _) if mix.state.lamps.is_chosen(&lamp.key) => {
            details_ui(ui, &lamp.key, mix.look, &mut mix.state.lamps, mix.lights, mix.actions);
        }
        LightOf::Look(..) => {}
    }
}

/// Whether a row that begins at the cursor would be seen; if not, only its place is kept.
pub(super) fn passes_over(ui: &mut Ui, is_long: bool) -> bool {
    // In a narrow panel each row has two lines.
    let height = ui.data(|data| data.get_temp::<f32>(Id::unique(ROW))).unwrap_or(HEIGHT);
    let rect = Rect::from_min_size(ui.cursor().min, vec2(ui.available_width(), height));
    let passes = is_long && !ui.is_rect_visible(rect);
    if passes {
        ui.allocate_space(rect.size());
    }
    passes
}
