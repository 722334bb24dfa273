//! The lights as a table: everything about each in a line of its own.

use std::cmp::Ordering;

use clerestory_transport::lamps::LampUnit;
use clerestory_transport::light::LightSetting;
use eframe::egui::{Button, Grid, Label, RichText, ScrollArea, Sense, Ui};

use super::listed::Listed;
use super::mix::Mix;
use super::row;
use super::scale::{Shown, digits, number_ui};
use crate::panels::color::{Tint, kelvin_field_ui};

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

/// Titles of the columns, what they tell, and by what they sort.
const COLUMNS: [(&str, &str, Option<Column>); 9] = [
    ("", "", None),
    ("Name", "Click to sort", Some(Column::Name)),
    ("Kind", "Click to sort", Some(Column::Kind)),
    ("Value", "In the unit beside it, without masters of groups; click to sort", Some(Column::Value)),
    ("Unit", "Chosen above, else that of the file", None),
    ("Color", "", None),
    ("Kelvin", "Color temperature, K; click to sort", Some(Column::Kelvin)),
    ("lm", "Luminous flux with masters of groups, lumen; click to sort", Some(Column::Lumen)),
    ("Position", "X, Y and Z in meters", None),
];

/// Draws the table.
pub(super) fn table_ui(ui: &mut Ui, mix: &mut Mix) {
    let mut lines: Vec<usize> = mix.items.iter().flat_map(|item| item.lights().iter().copied()).collect();
    if let Some(sorting) = mix.state.sorting {
        lines.sort_by(|a, b| {
            let order = order(mix, sorting.column, &mix.lights[*a], &mix.lights[*b]);
            if sorting.descends { order.reverse() } else { order }
        });
    }
    ScrollArea::both().id_salt("table").auto_shrink([false, false]).show(ui, |ui| {
        Grid::new("lights").striped(true).spacing([10.0, 3.0]).min_col_width(20.0).show(ui, |ui| {
            for (title, tip, column) in COLUMNS {
                title_ui(ui, mix, title, tip, column);
            }
            ui.end_row();
            for idx in lines {
                line_ui(ui, mix, &mix.lights[idx]);
                ui.end_row();
            }
        });
    });
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

fn line_ui(ui: &mut Ui, mix: &mut Mix, light: &Listed) {
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 3.0;
        row::mark_ui(ui, mix.differs(light), "Differs from the file");
        row::letters_ui(ui, mix, &light.name, std::slice::from_ref(&light.key));
    });
    let mut text = row::name_text(ui, mix, light);
    if mix.state.selection.has(&light.key) {
        text = text.background_color(ui.visuals().selection.bg_fill);
    }
    let name = ui.add(Label::new(text).extend().sense(Sense::click()).selectable(false));
    row::light_response(ui, mix, light, name);
    ui.add(Label::new(light.kind_words()).extend());
    let mut setting = mix.setting(light);
    let measure = mix.measure(light, &setting);
    number_ui(ui, &light.name, (measure, Shown::Bare), &mut setting.intensity, row::NUMBER);
    ui.label(RichText::new(measure.unit()).weak());
    if setting != mix.setting(light) {
        mix.look.lights.set(&light.key, setting);
    }
    row::color_ui(ui, mix, light);
    let setting = mix.setting(light);
    let mut tint = Tint { color: setting.color, kelvin: setting.kelvin };
    if kelvin_field_ui(ui, &light.name, &mut tint, false) {
        mix.look.lights.set(&light.key, LightSetting { color: tint.color, kelvin: tint.kelvin, ..setting });
    }
    ui.label(lumens(mix, light).map_or("–".into(), digits));
    let place = |at: glam::Vec3| format!("{:.2}, {:.2}, {:.2}", at.x, at.y, at.z);
    ui.add(Label::new(light.position().map_or("–".into(), place)).extend());
}
