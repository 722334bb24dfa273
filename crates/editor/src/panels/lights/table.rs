//! The lights as a table: everything about each in a line of its own. Letters and names stay in view while the numbers scroll sideways.

use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet};

use clerestory_transport::lamps::LampUnit;
use eframe::egui::{
    Align, Button, FontSelection, Grid, Id, Label, Layout, Popup, Rect, RichText, ScrollArea, Sense, TextStyle, Ui,
    UiBuilder, WidgetText, pos2, vec2,
};

use super::list::{LONG_FROM, end_ui};
use super::listed::Listed;
use super::mix::Mix;
use super::row;
use super::scale::{Shown, digits, number_ui};
use crate::panels::color::{Tint, kelvin_field_ui};
use crate::panels::sight::keep_in_sight;

/// A column that the lines can be sorted by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Column {
    Name,
    Kind,
    Value,
    Kelvin,
    Lumen,
}

/// By which column the lines are sorted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Sorting {
    column: Column,
    descends: bool,
}

/// Titles of the columns behind the name, what they tell, and by what they sort.
const COLUMNS: [(&str, &str, Option<Column>); 7] = [
    ("Value", "In the unit beside it, without masters of groups; click to sort", Some(Column::Value)),
    ("Unit", "Chosen above, else that of the file", None),
    ("Color", "That of the file, another one, or a color temperature", None),
    ("Kelvin", "Color temperature, K; click to sort", Some(Column::Kelvin)),
    ("lm", "Luminous flux with masters of groups, lumen; click to sort", Some(Column::Lumen)),
    ("Kind", "Click to sort", Some(Column::Kind)),
    ("Position", "X, Y and Z in meters", None),
];

/// Width of the mark, and of solo and mute.
const LETTERS: f32 = 59.0;
/// Least and greatest width of the names, and the part of the room that they take at most.
const NAME: [f32; 2] = [60.0, 104.0];
const NAME_PART: f32 = 0.5;
/// Height of a line.
const LINE: f32 = row::HEIGHT - 2.0;
/// Between columns, and between lines.
const SPACING: [f32; 2] = [10.0, 3.0];

/// Draws the table.
pub(super) fn table_ui(ui: &mut Ui, mix: &mut Mix) {
    let lines = lines(ui, mix);
    mix.order = mix.keys(&lines);
    let is_long = lines.len() > LONG_FROM;
    let kinds = if is_long { kind_width(ui, mix) } else { 0.0 };
    let names = name_width(ui, mix, &lines);
    ScrollArea::both().id_salt("table").auto_shrink([false, false]).show(ui, |ui| {
        let fixed = Fixed { seen: ui.clip_rect(), width: LETTERS + names };
        Grid::new("lights").spacing(SPACING).min_col_width(20.0).show(ui, |ui| {
            ui.set_clip_rect(fixed.beside());
            fixed.show(ui, None, |ui| {
                ui.spacing_mut().item_spacing.x = 0.0;
                ui.add_space(LETTERS);
                title_ui(ui, mix, "Name", "Click to sort", Some(Column::Name));
            });
            for (title, tip, column) in COLUMNS {
                ui.scope(|ui| {
                    ui.set_min_width(if column == Some(Column::Kind) { kinds } else { 0.0 });
                    title_ui(ui, mix, title, tip, column);
                });
            }
            ui.end_row();
            let lights = mix.lights;
            for (nth, light) in lines.into_iter().map(|idx| &lights[idx]).enumerate() {
                let top = ui.cursor().top();
                let is_wanted = mix.state.scroll_to.take_if(|key| *key == light.key).is_some();
                if is_wanted {
                    fixed.scroll_to(ui, top);
                }
                if is_long && !is_wanted && !fixed.sees(top) {
                    ui.allocate_space(vec2(0.0, LINE));
                } else {
                    line_ui(ui, mix, light, (&fixed, nth));
                }
                ui.end_row();
            }
        });
        end_ui(ui, mix);
        keep_in_sight(ui, "table");
    });
}

/// The lights as their lines stand. While something of them is dragged or typed they stay as they are, so that no line moves away below the hand.
fn lines(ui: &Ui, mix: &mut Mix) -> Vec<usize> {
    let mut lines: Vec<usize> = mix.items.iter().flat_map(|item| item.lights().iter().copied()).collect();
    let Some(sorting) = mix.state.sorting else { return lines };
    let is_in_hand =
        ui.input(|input| input.pointer.any_down()) || ui.ctx().text_edit_focused() || Popup::is_any_open(ui.ctx());
    if is_in_hand {
        let key = |idx: &usize| mix.lights[*idx].key.as_str();
        let before: BTreeMap<&str, usize> = mix.state.lines.iter().map(String::as_str).zip(0..).collect();
        if before.len() == lines.len() && lines.iter().all(|idx| before.contains_key(key(idx))) {
            lines.sort_by_key(|idx| before[key(idx)]);
            return lines;
        }
    }
    lines.sort_by(|a, b| {
        let order = order(mix, sorting.column, &mix.lights[*a], &mix.lights[*b]);
        if sorting.descends { order.reverse() } else { order }
    });
    mix.state.lines = mix.keys(&lines);
    lines
}

/// Width of the longest kind, so that the columns stay where they are while lines come into view.
fn kind_width(ui: &Ui, mix: &Mix) -> f32 {
    let kinds: BTreeSet<String> = mix.lights.iter().map(Listed::kind_words).collect();
    kinds.into_iter().map(|kind| text_width(ui, RichText::new(kind))).fold(0.0, f32::max)
}

fn text_width(ui: &Ui, text: RichText) -> f32 {
    let text = WidgetText::from(text);
    text.into_galley(ui, None, f32::INFINITY, FontSelection::Style(TextStyle::Body)).size().x
}

/// Width of the longest name, within reason.
fn name_width(ui: &Ui, mix: &Mix, lines: &[usize]) -> f32 {
    let width = |idx: &usize| text_width(ui, RichText::new(&mix.lights[*idx].name).strong());
    let longest = lines.iter().map(width).fold(NAME[0], f32::max);
    longest.ceil().min(NAME[1]).min((NAME_PART * ui.available_width() - LETTERS).max(NAME[0]))
}

/// The column that stays at the left edge of what is seen, whatever is scrolled behind it.
struct Fixed {
    /// What is seen of the table.
    seen: Rect,
    width: f32,
}

impl Fixed {
    /// What is seen of the other columns.
    fn beside(&self) -> Rect {
        Rect::from_min_max(pos2(self.seen.left() + self.width + SPACING[0], self.seen.top()), self.seen.max)
    }

    /// Whether a line from there on down would be seen.
    fn sees(&self, top: f32) -> bool {
        self.seen.y_range().contains(top) || self.seen.y_range().contains(top + LINE)
    }

    /// Brings the line at a height into view; sideways the table stays where it is.
    fn scroll_to(&self, ui: &Ui, top: f32) {
        let line = Rect::from_x_y_ranges(self.seen.x_range(), top..=top + LINE);
        ui.scroll_to_rect(line, Some(Align::Center));
    }

    /// Draws a cell of it; every other line lies on a ground of its own, by its number. What is in it belongs to `line`, wherever that stands.
    fn show(&self, ui: &mut Ui, line: Option<(usize, Id)>, add: impl FnOnce(&mut Ui)) {
        let (place, _) = ui.allocate_exact_size(vec2(self.width, LINE), Sense::hover());
        let cell = Rect::from_min_size(pos2(self.seen.left(), place.top()), place.size());
        if line.is_some_and(|(nth, _)| nth % 2 == 0) {
            let line = Rect::from_x_y_ranges(self.seen.x_range(), cell.y_range()).expand2(vec2(0.0, 0.5 * SPACING[1]));
            ui.painter().with_clip_rect(self.seen).rect_filled(line, 2.0, ui.visuals().faint_bg_color);
        }
        let place = UiBuilder::new().max_rect(cell).layout(Layout::left_to_right(Align::Center));
        let mut cell = ui.new_child(line.iter().fold(place, |place, (_, id)| place.scope_id(id.with("name"))));
        cell.set_clip_rect(self.seen);
        add(&mut cell);
    }
}

fn title_ui(ui: &mut Ui, mix: &mut Mix, title: &str, tip: &str, column: Option<Column>) {
    let Some(column) = column else {
        ui.label(RichText::new(title).weak()).on_hover_text(tip);
        return;
    };
    let sorting = mix.state.sorting.filter(|sorting| sorting.column == column);
    let arrow = sorting.map_or("", |sorting| if sorting.descends { ", down" } else { ", up" });
    let button = Button::new(RichText::new(format!("{title}{arrow}")).weak()).frame(false);
    let button = ui.add(button).on_hover_text(tip);
    if button.accessible_name(format!("Sort by {}", title.to_lowercase())).clicked() {
        // Up, down, and as in the list again.
        mix.state.sorting = match sorting {
            None => Some(Sorting { column, descends: false }),
            Some(sorting) if !sorting.descends => Some(Sorting { column, descends: true }),
            Some(_) => None,
        };
    }
}

/// What is told first of two lights; lights without a number come last.
fn order(mix: &Mix, column: Column, a: &Listed, b: &Listed) -> Ordering {
    let by = |number: &dyn Fn(&Listed) -> Option<f64>| match (number(a), number(b)) {
        (Some(a), Some(b)) => a.total_cmp(&b),
        (a, b) => b.is_some().cmp(&a.is_some()),
    };
    match column {
        Column::Name => a.name.to_lowercase().cmp(&b.name.to_lowercase()),
        Column::Kind => a.kind_words().cmp(&b.kind_words()),
        Column::Value => by(&|light| {
            let setting = mix.setting(light);
            Some(mix.measure(light, &setting).number(setting.intensity))
        }),
        Column::Kelvin => by(&|light| mix.setting(light).kelvin.map(f64::from)),
        Column::Lumen => by(&|light| lumens(mix, light)),
    }
}

/// Luminous flux as it leaves the light, masters included.
fn lumens(mix: &Mix, light: &Listed) -> Option<f64> {
    let setting = mix.look.lights.setting(&light.key);
    let lumens = light.amount(&setting, LampUnit::Lumen).map(f64::from)?;
    Some(if setting.muted { 0.0 } else { lumens })
}

fn name_ui(ui: &mut Ui, mix: &mut Mix, light: &Listed) {
    let width = ui.available_width();
    if row::renamed_ui(ui, mix, light, vec2(width, LINE)) {
        return;
    }
    let mut text = row::name_text(ui, mix, light);
    if mix.state.selection.has(&light.key) {
        text = text.background_color(ui.visuals().selection.bg_fill);
    }
    let name = row::name_label_ui(ui, text, width);
    row::light_response(ui, mix, light, name);
}

fn line_ui(ui: &mut Ui, mix: &mut Mix, light: &Listed, (fixed, nth): (&Fixed, usize)) {
    let line = ui.scope_id().with(("line", light.key.as_str()));
    fixed.show(ui, Some((nth, line)), |ui| {
        ui.spacing_mut().item_spacing.x = 3.0;
        row::mark_ui(ui, mix.differs(light), row::DIFFERS);
        row::letters_ui(ui, mix, &light.name, std::slice::from_ref(&light.key));
        name_ui(ui, mix, light);
    });
    let mut setting = mix.setting(light);
    let measure = mix.measure(light, &setting);
    row::keyed_ui(ui, line.with("value"), |ui| {
        number_ui(ui, &light.name, (measure, Shown::Bare), &mut setting.intensity, row::NUMBER)
    });
    ui.label(RichText::new(measure.unit()).weak());
    if setting != mix.setting(light) {
        mix.look.lights.set(&light.key, setting);
    }
    row::keyed_ui(ui, line.with("color"), |ui| row::color_ui(ui, mix, light));
    let setting = mix.setting(light);
    let mut tint = Tint { color: setting.color, kelvin: setting.kelvin };
    if row::keyed_ui(ui, line.with("kelvin"), |ui| kelvin_field_ui(ui, &light.name, &mut tint, false)) {
        mix.set_tint(light, tint);
    }
    ui.label(lumens(mix, light).map_or("–".into(), digits));
    ui.add(Label::new(light.kind_words()).extend());
    let place = |at: glam::Vec3| format!("{:.2}, {:.2}, {:.2}", at.x, at.y, at.z);
    ui.add(Label::new(light.position().map_or("–".into(), place)).extend());
}
