//! A group in the list: a row with a master that turns all of its lights.

use clerestory_transport::light::LightSetting;
use eframe::egui::{self, Key, Label, Response, RichText, Sense, Shape, Stroke, Ui, Vec2, vec2};

use super::columns::{INDENT, Part, columns_ui};
use super::fader::{More, fader_ui};
use super::groups::{Group, master, set_master};
use super::mix::Mix;
use super::names::renaming_ui;
use super::row::{HEIGHT, NUMBER, keyed_ui, letter_ui, mark_ui, name_label_ui};
use super::scale::{Measure, Shown, number_ui};
use super::solo;
use crate::look::groups::own_name;
use crate::look::lamps::MOST_STRENGTH;
use crate::panels::menu::context_menu;
use crate::theme;

/// Width of the number of its lights.
const COUNT: f32 = 18.0;

/// Draws the row of a group. Answers whether its lights are shown below it.
pub(super) fn group_row_ui(ui: &mut Ui, mix: &mut Mix, group: &Group) -> bool {
    let id = ui.scope_id().with(("group", group.key.as_str()));
    keyed_ui(ui, id, |ui| {
        let background = ui.painter().add(Shape::Noop);
        let row = ui.horizontal(|ui| {
            ui.spacing_mut().item_spacing.x = 5.0;
            mark_ui(ui, differs(mix, group), DIFFERS);
            letters_ui(ui, mix, group);
            columns_ui(ui, mix, |ui, mix, part| match part {
                Part::Color => {}
                Part::Name(width) => name_ui(ui, mix, group, width),
                Part::Number => set_ui(ui, mix, group, |ui, measure, intensity| {
                    number_ui(ui, &format!("Group {}", group.name), (measure, Shown::WithUnit), intensity, NUMBER);
                }),
                Part::Fader(size) => set_ui(ui, mix, group, |ui, _, intensity| {
                    fader_ui(ui, &format!("Group {} intensity", group.name), (size, More::Right), intensity);
                }),
            });
        });
        let fill = ui.visuals().faint_bg_color;
        ui.painter().set(background, Shape::rect_filled(row.response.rect.expand2(vec2(2.0, 1.0)), 3.0, fill));
    });
    !mix.state.collapsed.contains(&group.key)
}

/// What the mark of a group says.
pub(super) const DIFFERS: &str = "Something in it differs from the file";

/// Whether a group or one of its lights is not as in the file.
pub(super) fn differs(mix: &Mix, group: &Group) -> bool {
    mix.look.lights.groups.contains_key(&group.key) || group.lights.iter().any(|idx| mix.differs(&mix.lights[*idx]))
}

/// The triangle that folds and unfolds; left and right do so as well.
fn fold_ui(ui: &mut Ui, mix: &mut Mix, group: &Group) {
    let is_open = !mix.state.collapsed.contains(&group.key);
    let (rect, response) = ui.allocate_exact_size(vec2(INDENT - 5.0, HEIGHT - 2.0), Sense::click());
    let words = format!("{} {}", if is_open { "Collapse" } else { "Expand" }, group.name);
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, ui.is_enabled(), &words));
    let openness = if is_open { 1.0 } else { 0.0 };
    let icon = response.clone().with_new_rect(egui::Rect::from_center_size(rect.center(), vec2(9.0, 9.0)));
    egui::collapsing_header::paint_default_icon(ui, openness, &icon);
    if response.has_focus() {
        ui.painter().rect_stroke(rect, 2.0, Stroke::new(1.0, theme::ACCENT), egui::StrokeKind::Inside);
    }
    if response.clicked() {
        fold(mix, group, !is_open);
    }
}

/// Folds or unfolds a group.
pub(super) fn fold(mix: &mut Mix, group: &Group, is_open: bool) {
    if is_open {
        mix.state.collapsed.remove(&group.key);
    } else {
        mix.state.collapsed.insert(group.key.clone());
    }
}

/// Solo and mute of a group. Its mute is its own, so that its lights keep theirs.
pub(super) fn letters_ui(ui: &mut Ui, mix: &mut Mix, group: &Group) {
    let keys = mix.keys(&group.lights);
    let is_solo = keys.iter().all(|key| mix.state.solo.contains(key));
    let letter = letter_ui(ui, "S", is_solo, theme::ACCENT).on_hover_text("Solo all of them");
    if letter.accessible_name(format!("Solo group {}", group.name)).clicked() {
        solo::toggle(&mut mix.state.solo, &keys);
    }
    let mut own = master(mix.look, group, mix.lights);
    let letter = letter_ui(ui, "M", own.muted, theme::ALERT).on_hover_text("Mute all of them");
    if letter.accessible_name(format!("Mute group {}", group.name)).clicked() {
        own.muted = !own.muted;
        set_master(mix.look, &group.key, own);
    }
}

/// The field in place of a group's name, while it gets another. Answers whether it is there.
pub(super) fn renamed_ui(ui: &mut Ui, mix: &mut Mix, group: &Group, size: Vec2) -> bool {
    let of = (group.key.as_str(), own_name(&group.key));
    renaming_ui(ui, of, size, mix.look, &mut mix.state.renaming, &[])
}

/// The triangle, the name and the number of lights.
fn name_ui(ui: &mut Ui, mix: &mut Mix, group: &Group, width: f32) {
    ui.spacing_mut().item_spacing.x = 5.0;
    fold_ui(ui, mix, group);
    let width = width - INDENT;
    if renamed_ui(ui, mix, group, vec2(width, HEIGHT)) {
        return;
    }
    let text = RichText::new(&group.name).strong();
    let is_dark = group.lights.iter().all(|idx| mix.is_dark(&mix.lights[*idx].key));
    let name = name_label_ui(ui, if is_dark { text.weak() } else { text }, width - COUNT - 5.0);
    ui.add_sized(
        [COUNT, ui.available_height()],
        Label::new(RichText::new(group.lights.len().to_string()).weak().small()),
    );
    group_response(ui, mix, group, name);
}

/// What the name of a group does wherever it stands.
pub(super) fn group_response(ui: &Ui, mix: &mut Mix, group: &Group, name: Response) {
    let of = group.key.split_once(':').map_or(group.key.as_str(), |(_, of)| of);
    let name = name.on_hover_text(format!(
        "{of}\n{} lights\nClick to select them, right-click or menu key for more",
        group.lights.len()
    ));
    let keys = mix.keys(&group.lights);
    if name.has_focus() {
        ui.painter().rect_stroke(name.rect, 2.0, ui.visuals().selection.stroke, egui::StrokeKind::Outside);
        let folds = egui::EventFilter { horizontal_arrows: true, ..egui::EventFilter::default() };
        ui.memory_mut(|memory| memory.set_focus_lock_filter(name.id, folds));
        let [left, right] = ui.input(|input| [Key::ArrowLeft, Key::ArrowRight].map(|key| input.key_pressed(key)));
        if left || right {
            fold(mix, group, right);
        }
    }
    if name.clicked() {
        mix.state.selection.click_group(&keys, ui.input(|input| input.modifiers));
        mix.state.choose_lamp(None);
    }
    context_menu(&name, |ui| {
        let chosen = |ui: &mut Ui, words: &str, tip: &str| {
            let clicked = ui.button(words).on_hover_text(tip).clicked();
            if clicked {
                ui.close();
            }
            clicked
        };
        if chosen(ui, "Reset the master", "The lights keep what each is set to") {
            mix.look.lights.groups.remove(&group.key);
        }
        if chosen(ui, "Reset the group", "The master, and all its lights as in the file") {
            mix.look.lights.groups.remove(&group.key);
            keys.iter().for_each(|key| mix.reset(key));
        }
        if chosen(ui, "Solo this alone", "All other lights go dark") {
            mix.state.solo = keys.iter().cloned().collect();
        }
        if chosen(ui, "Hand the master down", "The lights take over what it does, and it goes back to 1") {
            hand_down(mix, group);
        }
        if chosen(ui, "Rename…", "A name of its own in the look") {
            mix.state.renaming = Some((group.key.clone(), group.name.clone()));
        }
    });
}

/// Gives the lights what their master does, so that nothing is seen to change.
fn hand_down(mix: &mut Mix, group: &Group) {
    // The lights that it turns: those of a look that was made elsewhere may be fewer than are shown.
    let Some(own) = mix.look.lights.groups.remove(&group.key) else { return };
    for key in &own.lights {
        let setting = mix.look.lights.own_setting(key);
        let intensity = (setting.intensity * own.intensity).min(MOST_STRENGTH);
        let muted = setting.muted || own.muted;
        mix.look.lights.set(key, LightSetting { intensity, muted, ..setting });
    }
}

/// Lets a widget change the master of a group.
fn set_ui(ui: &mut Ui, mix: &mut Mix, group: &Group, add: impl FnOnce(&mut Ui, Measure, &mut f32)) {
    let mut own = master(mix.look, group, mix.lights);
    let before = own.intensity;
    add(ui, mix.state.layout.scale.of_group(), &mut own.intensity);
    if own.intensity != before {
        set_master(mix.look, &group.key, own);
    }
}
