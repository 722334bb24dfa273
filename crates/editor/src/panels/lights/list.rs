//! The lights in a list, a row each, and the masters that it does not show.

use eframe::egui::{RichText, ScrollArea, Ui};

use super::LightsView;
use super::columns::INDENT;
use super::groups::Item;
use super::mix::Mix;
use super::{group_row, row};
use crate::look::groups::own_name;
use crate::panels::sight::keep_in_sight;

/// Lists from this long draw only the rows that are seen.
pub(super) const LONG_FROM: usize = 300;

/// Draws the list.
pub(super) fn list_ui(ui: &mut Ui, mix: &mut Mix) {
    let is_long = mix.lights.len() > LONG_FROM;
    ScrollArea::vertical().id_salt("lights").auto_shrink([false, false]).show(ui, |ui| {
        for item in mix.items {
            match item {
                Item::Light(idx) => light_ui(ui, mix, *idx, 0.0, is_long),
                Item::Group(group) => {
                    if group_row::group_row_ui(ui, mix, group) {
                        for idx in &group.lights {
                            light_ui(ui, mix, *idx, INDENT, is_long);
                        }
                    }
                }
            }
        }
        end_ui(ui, mix);
        keep_in_sight(ui, "list");
    });
}

/// What stands below all lights, in whatever way they are laid out.
pub(super) fn end_ui(ui: &mut Ui, mix: &mut Mix) {
    ui.add_space(8.0);
    other_masters_ui(ui, mix);
    let tip = "Back to what the file says; added lamps go, and another sky. Undo brings all of it back";
    if mix.look.lights != *mix.file && ui.button("Reset all lights").on_hover_text(tip).clicked() {
        mix.reset_all();
    }
}

fn light_ui(ui: &mut Ui, mix: &mut Mix, idx: usize, indent: f32, is_long: bool) {
    let light = &mix.lights[idx];
    let is_wanted = mix.state.scroll_to.as_deref() == Some(&light.key);
    if is_wanted || !row::passes_over(ui, is_long) {
        row::row_ui(ui, mix, light, indent);
    }
}

/// Masters of groups that are not shown as the lights are sorted now still turn them: they are named here. The table shows none.
fn other_masters_ui(ui: &mut Ui, mix: &mut Mix) {
    let has_masters = mix.state.layout.view != LightsView::Table;
    let is_in = |key: &String| mix.items.iter().any(|item| matches!(item, Item::Group(group) if group.key == *key));
    let others: Vec<String> =
        mix.look.lights.groups.keys().filter(|key| !(has_masters && is_in(key))).cloned().collect();
    for key in others {
        let group = &mix.look.lights.groups[&key];
        let does = if group.muted { "mutes".to_owned() } else { format!("turns by {:.2}×", group.intensity) };
        let name = mix.look.names.get(&key).map_or_else(|| own_name(&key), String::as_str).to_owned();
        let words = format!("{name} {does} {} lights", group.lights.len());
        let tip = "The master of a group that is not shown here";
        ui.horizontal(|ui| {
            ui.label(RichText::new(words).weak()).on_hover_text(tip);
            if ui.small_button("Reset").accessible_name(format!("Reset master {name}")).clicked() {
                mix.look.lights.groups.remove(&key);
            }
        });
    }
}
