//! The lights as a mixer: a strip each with a vertical fader, and a master in front of each group. Strips that find no room in a row stand in
//! further ones below it.

use std::sync::Arc;

use eframe::egui::{
    Align, Button, FontSelection, Frame, Label, Layout, Margin, Rect, Response, RichText, ScrollArea, Sense, Ui,
    WidgetText, vec2,
};

use super::fader::{More, fader_ui};
use super::group_row;
use super::groups::{Group, Item, master, set_master};
use super::list::{LONG_FROM, end_ui};
use super::listed::Listed;
use super::mix::Mix;
use super::row;
use super::scale::{Shown, number_ui};
use crate::panels::sight::keep_in_sight;
use crate::theme;

/// Least and greatest width of what a strip holds, points.
const STRIP: [f32; 2] = [62.0, 84.0];
/// Between its edge and what it holds.
const MARGIN: Margin = Margin::symmetric(3, 5);
/// Between strips, and between their rows.
const GAP: f32 = 4.0;
/// Height of a name: two lines.
const NAME: f32 = 32.0;
/// What stands above and below the fader, margins and gaps included.
const REST: f32 = 132.0;
/// Shortest and longest fader. A shorter one cannot be set by hand.
const FADER: [f32; 2] = [110.0, 320.0];

/// What stands on the board.
#[derive(Clone, Copy)]
enum Strip<'a> {
    Light(&'a Listed<'a>),
    Master(&'a Group),
}

/// How large the strips are.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Sizes {
    /// Strips of a row.
    per_row: usize,
    /// Width of what a strip holds, points.
    strip: f32,
    /// Length of a fader, points.
    fader: f32,
}

impl Sizes {
    /// For so many strips in some room. They fill it as long as they need not scroll.
    fn fitting(n_strips: usize, room: eframe::egui::Vec2) -> Sizes {
        let margins = MARGIN.sum().x;
        let outer = STRIP[0] + margins + GAP;
        let per_row = (((room.x + GAP) / outer).floor() as usize).clamp(1, n_strips.max(1));
        let n_rows = n_strips.div_ceil(per_row).max(1);
        // Whole points: what is rounded up on the screen would be wider than the room.
        let width = ((room.x + GAP) / per_row as f32 - GAP - margins).floor();
        let height = (room.y + GAP) / n_rows as f32 - GAP - REST;
        Sizes { per_row, strip: width.clamp(STRIP[0], STRIP[1]), fader: height.clamp(FADER[0], FADER[1]) }
    }
}

/// Draws the strips.
pub(super) fn board_ui(ui: &mut Ui, mix: &mut Mix) {
    let (items, lights, collapsed) = (mix.items, mix.lights, &mix.state.collapsed);
    let mut strips = Vec::new();
    for item in items {
        let members = match item {
            Item::Light(idx) => std::slice::from_ref(idx),
            Item::Group(group) => {
                strips.push(Strip::Master(group));
                if collapsed.contains(&group.key) { &[] } else { group.lights.as_slice() }
            }
        };
        strips.extend(members.iter().map(|idx| Strip::Light(&lights[*idx])));
    }
    let beside_bar = ui.available_size() - vec2(ui.spacing().scroll.allocated_width(), 0.0);
    let sizes = Sizes::fitting(strips.len(), beside_bar);
    let is_long = strips.len() > LONG_FROM;
    ScrollArea::vertical().id_salt("board").auto_shrink([false, false]).show(ui, |ui| {
        ui.spacing_mut().item_spacing.y = GAP;
        for row in strips.chunks(sizes.per_row) {
            let place = Rect::from_min_size(ui.cursor().min, vec2(ui.available_width(), sizes.fader + REST));
            let is_wanted = |strip: &Strip| match strip {
                Strip::Light(light) => mix.state.scroll_to.as_deref() == Some(light.key.as_str()),
                Strip::Master(_) => false,
            };
            if is_long && !ui.is_rect_visible(place) && !row.iter().any(is_wanted) {
                ui.allocate_space(place.size());
                continue;
            }
            ui.horizontal_top(|ui| {
                ui.spacing_mut().item_spacing.x = GAP;
                for strip in row {
                    match strip {
                        Strip::Light(light) => light_strip_ui(ui, mix, light, sizes),
                        Strip::Master(group) => group_strip_ui(ui, mix, group, sizes),
                    }
                }
            });
        }
        end_ui(ui, mix);
        keep_in_sight(ui, "board");
    });
}

fn strip_ui(ui: &mut Ui, fill: eframe::egui::Color32, sizes: Sizes, add: impl FnOnce(&mut Ui)) -> Rect {
    let strip = Frame::new().fill(fill).corner_radius(4.0).inner_margin(MARGIN).show(ui, |ui| {
        let layout = Layout::top_down(Align::Center);
        ui.allocate_ui_with_layout(vec2(sizes.strip, 0.0), layout, |ui| {
            ui.set_width(sizes.strip);
            ui.spacing_mut().item_spacing.y = 4.0;
            add(ui);
        });
    });
    strip.response.rect
}

/// A name of two lines at most, so that all strips are as high.
fn name_ui(ui: &mut Ui, text: RichText, width: f32) -> Response {
    let text = WidgetText::from(text.small());
    let mut job = Arc::unwrap_or_clone(text.into_layout_job(ui.style(), FontSelection::Default, Align::Center));
    job.wrap.max_rows = 2;
    let size = vec2(width, NAME);
    let name = ui.allocate_ui_with_layout(size, Layout::top_down(Align::Center), |ui| {
        ui.set_min_size(size);
        ui.set_max_height(size.y);
        ui.add(Label::new(job).wrap().sense(Sense::click()).selectable(false))
    });
    name.inner
}

/// Solo and mute side by side in the middle.
fn letters_ui(ui: &mut Ui, width: f32, add: impl FnOnce(&mut Ui)) {
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        ui.add_space(0.5 * (width - 46.0));
        add(ui);
    });
}

fn light_strip_ui(ui: &mut Ui, mix: &mut Mix, light: &Listed, sizes: Sizes) {
    let is_selected = mix.state.selection.has(&light.key);
    let selection = ui.visuals().selection.bg_fill.gamma_multiply(0.55);
    let fill = if is_selected { selection } else { ui.visuals().faint_bg_color };
    let id = ui.scope_id().with(("strip", light.key.as_str()));
    row::keyed_ui(ui, id, |ui| {
        let rect = strip_ui(ui, fill, sizes, |ui| {
            if !row::renamed_ui(ui, mix, light, vec2(sizes.strip, NAME)) {
                let text = row::name_text(ui, mix, light);
                let name = name_ui(ui, text, sizes.strip);
                row::light_response(ui, mix, light, name);
            }
            let mut setting = mix.setting(light);
            let size = vec2(30.0, sizes.fader);
            fader_ui(ui, &format!("{} intensity", light.name), (size, More::Up), &mut setting.intensity);
            let measure = mix.measure(light, &setting);
            number_ui(ui, &light.name, (measure, Shown::WithUnit), &mut setting.intensity, sizes.strip);
            if setting != mix.setting(light) {
                mix.look.lights.set(&light.key, setting);
            }
            let key = std::slice::from_ref(&light.key);
            letters_ui(ui, sizes.strip, |ui| row::letters_ui(ui, mix, &light.name, key));
            row::color_ui(ui, mix, light);
        });
        mark_ui(ui, rect, mix.differs(light), row::DIFFERS);
        if mix.state.scroll_to.as_deref() == Some(light.key.as_str()) {
            mix.state.scroll_to = None;
            ui.scroll_to_rect(rect, Some(Align::Center));
        }
    });
}

fn group_strip_ui(ui: &mut Ui, mix: &mut Mix, group: &Group, sizes: Sizes) {
    let fill = ui.visuals().widgets.inactive.weak_bg_fill.gamma_multiply(0.5);
    let id = ui.scope_id().with(("group strip", group.key.as_str()));
    row::keyed_ui(ui, id, |ui| {
        let rect = strip_ui(ui, fill, sizes, |ui| {
            if !group_row::renamed_ui(ui, mix, group, vec2(sizes.strip, NAME)) {
                let text = RichText::new(&group.name).strong().color(theme::accent_text(ui));
                let name = name_ui(ui, text, sizes.strip);
                group_row::group_response(ui, mix, group, name);
            }
            let mut own = master(mix.look, group, mix.lights);
            let before = own.intensity;
            let size = vec2(30.0, sizes.fader);
            fader_ui(ui, &format!("Group {} intensity", group.name), (size, More::Up), &mut own.intensity);
            let measure = mix.state.layout.scale.of_group();
            let label = format!("Group {}", group.name);
            number_ui(ui, &label, (measure, Shown::WithUnit), &mut own.intensity, sizes.strip);
            if own.intensity != before {
                set_master(mix.look, &group.key, own);
            }
            letters_ui(ui, sizes.strip, |ui| group_row::letters_ui(ui, mix, group));
            let is_open = !mix.state.collapsed.contains(&group.key);
            let words = if is_open { "Collapse" } else { "Expand" };
            let height = ui.spacing().interact_size.y;
            let button = Button::new(RichText::new(format!("{} lights", group.lights.len())).small());
            let button = ui.add(button.min_size(vec2(0.0, height))).on_hover_text(words);
            if button.accessible_name(format!("{words} {}", group.name)).clicked() {
                group_row::fold(mix, group, !is_open);
            }
        });
        mark_ui(ui, rect, group_row::differs(mix, group), group_row::DIFFERS);
    });
}

/// The dot in the corner of a strip in which something is not as in the file.
fn mark_ui(ui: &Ui, strip: Rect, is_on: bool, tip: &str) {
    if is_on {
        let place = Rect::from_min_size(strip.min + vec2(1.0, 1.0), vec2(row::MARK, row::MARK));
        row::dot_ui(ui, ui.interact(place, ui.scope_id().with("mark"), Sense::hover()), tip);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_fill_the_room_and_scroll_where_faders_would_be_too_short() {
        let room = vec2(576.0, 640.0);
        let wide = Sizes::fitting(8, room);
        assert_eq!((wide.per_row, wide.fader), (8, FADER[1]), "all in one row, as long as they get");
        let few = Sizes::fitting(2, room);
        assert_eq!((few.per_row, few.strip), (2, STRIP[1]), "no wider than they need");
        let two_rows = Sizes::fitting(16, room);
        assert_eq!(two_rows.per_row, 8);
        assert!(
            two_rows.fader > FADER[0] && 2.0 * (two_rows.fader + REST + GAP) <= room.y + GAP + 0.01,
            "{two_rows:?}"
        );
        let many = Sizes::fitting(100, room);
        assert_eq!(many.fader, FADER[0]);
        for n in 1..40 {
            let Sizes { per_row, strip, .. } = Sizes::fitting(n, vec2(276.0, 300.0));
            assert!(per_row as f32 * (strip + MARGIN.sum().x + GAP) - GAP <= 276.0 + 0.01, "{n}: {per_row} of {strip}");
        }
        assert_eq!(Sizes::fitting(5, vec2(10.0, 10.0)).per_row, 1);
    }
}
