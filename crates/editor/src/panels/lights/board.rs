//! The lights as a mixer: a strip each with a vertical fader, and a master in front of each group.

use eframe::egui::{Align, Button, Frame, Label, Layout, Margin, RichText, ScrollArea, Sense, Ui, vec2};

use super::fader::{More, fader_ui};
use super::group_row;
use super::groups::{Group, Item, master, set_master};
use super::listed::Listed;
use super::mix::Mix;
use super::row;
use super::scale::{Shown, number_ui};
use crate::theme;

/// Width of a strip in points.
const STRIP: f32 = 62.0;
/// What stands above and below the fader.
const REST: f32 = 132.0;
/// Shortest and longest fader.
const FADER: [f32; 2] = [90.0, 320.0];

/// Draws the strips.
pub(super) fn board_ui(ui: &mut Ui, mix: &mut Mix) {
    let height = (ui.available_height() - REST).clamp(FADER[0], FADER[1]);
    ScrollArea::horizontal().id_salt("board").auto_shrink([false, false]).show(ui, |ui| {
        ui.horizontal_top(|ui| {
            ui.spacing_mut().item_spacing.x = 4.0;
            for item in mix.items {
                match item {
                    Item::Light(idx) => light_strip_ui(ui, mix, &mix.lights[*idx], height),
                    Item::Group(group) => {
                        group_strip_ui(ui, mix, group, height);
                        if !mix.state.collapsed.contains(&group.key) {
                            for idx in &group.lights {
                                light_strip_ui(ui, mix, &mix.lights[*idx], height);
                            }
                        }
                    }
                }
            }
        });
    });
}

fn strip_ui(ui: &mut Ui, fill: eframe::egui::Color32, add: impl FnOnce(&mut Ui)) {
    Frame::new().fill(fill).corner_radius(4.0).inner_margin(Margin::symmetric(3, 5)).show(ui, |ui| {
        ui.allocate_ui_with_layout(vec2(STRIP, 0.0), Layout::top_down(Align::Center), |ui| {
            ui.set_width(STRIP);
            ui.spacing_mut().item_spacing.y = 4.0;
            add(ui);
        });
    });
}

/// A name of two lines at most, so that all strips are as high.
fn name_ui(ui: &mut Ui, text: RichText) -> eframe::egui::Response {
    let layout = Layout::top_down(Align::Center);
    let size = vec2(STRIP, 32.0);
    let name = ui.allocate_ui_with_layout(size, layout, |ui| {
        ui.set_min_size(size);
        ui.set_max_height(size.y);
        ui.add(Label::new(text.small()).truncate().sense(Sense::click()).selectable(false))
    });
    name.inner
}

fn light_strip_ui(ui: &mut Ui, mix: &mut Mix, light: &Listed, height: f32) {
    let is_selected = mix.state.selection.has(&light.key);
    let selection = ui.visuals().selection.bg_fill.gamma_multiply(0.55);
    let fill = if is_selected { selection } else { ui.visuals().faint_bg_color };
    ui.push_id(("strip", light.key.as_str()), |ui| {
        strip_ui(ui, fill, |ui| {
            let text = row::name_text(ui, mix, light);
            let name = name_ui(ui, text);
            row::light_response(ui, mix, light, name);
            let mut setting = mix.setting(light);
            let size = vec2(30.0, height);
            fader_ui(ui, &format!("{} intensity", light.name), (size, More::Up), &mut setting.intensity);
            let measure = mix.measure(light, &setting);
            number_ui(ui, &light.name, (measure, Shown::WithUnit), &mut setting.intensity, STRIP);
            if setting != mix.setting(light) {
                mix.look.lights.set(&light.key, setting);
            }
            ui.horizontal(|ui| {
                ui.spacing_mut().item_spacing.x = 4.0;
                ui.add_space(0.5 * (STRIP - 46.0));
                row::letters_ui(ui, mix, &light.name, std::slice::from_ref(&light.key));
            });
            row::color_ui(ui, mix, light);
        });
    });
}

fn group_strip_ui(ui: &mut Ui, mix: &mut Mix, group: &Group, height: f32) {
    let fill = ui.visuals().widgets.inactive.weak_bg_fill.gamma_multiply(0.5);
    ui.push_id(("group strip", group.key.as_str()), |ui| {
        strip_ui(ui, fill, |ui| {
            let name = name_ui(ui, RichText::new(&group.name).strong().color(theme::accent_text(ui)));
            group_row::group_response(ui, mix, group, name);
            let mut own = master(mix.look, group, mix.lights);
            let before = own.intensity;
            let size = vec2(30.0, height);
            fader_ui(ui, &format!("Group {} intensity", group.name), (size, More::Up), &mut own.intensity);
            let measure = mix.state.layout.scale.of_group();
            let label = format!("Group {}", group.name);
            number_ui(ui, &label, (measure, Shown::WithUnit), &mut own.intensity, STRIP);
            if own.intensity != before {
                set_master(mix.look, &group.key, own);
            }
            ui.horizontal(|ui| {
                ui.spacing_mut().item_spacing.x = 4.0;
                ui.add_space(0.5 * (STRIP - 46.0));
                group_row::letters_ui(ui, mix, group);
            });
            let is_open = !mix.state.collapsed.contains(&group.key);
            let words = if is_open { "Collapse" } else { "Expand" };
            let height = ui.spacing().interact_size.y;
            let button = Button::new(RichText::new(format!("{} lights", group.lights.len())).small());
            let button = ui.add(button.min_size(vec2(0.0, height))).on_hover_text(words);
            if button.accessible_name(format!("{words} {}", group.name)).clicked() {
                group_row::fold(mix, group, !is_open);
            }
        });
    });
}
