//! The strip below the picture: looks that were kept, each with its picture.

pub mod cards;
pub mod mix;
pub mod timeline;

use clerestory_transport::basis::LightBasis;
use eframe::egui::{self, Button, RichText, Stroke, TextureId, Ui, Vec2};

use crate::action::{Action, FileTask};
use crate::look::Look;
use crate::look::presets::Preset;
use crate::panels::sight::keep_in_sight;
use crate::theme;
use cards::card_ui;
use mix::{Compare, Fade, Side, compare_ui, fade_ui};
use timeline::{Player, timeline_ui};

/// What the strip remembers and no look holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LooksState {
    /// Looks that are compared in the picture.
    pub compare: Option<Compare>,
    /// Looks of which one becomes the other.
    pub fade: Option<Fade>,
    /// Whether the timeline is open.
    pub timeline: bool,
    /// What it shows.
    pub player: Player,
    /// Snapshot that is being renamed, and what was typed so far.
    pub(super) renaming: Option<(usize, String)>,
    /// Name of the snapshot that is being dragged to another place.
    pub(super) dragged: Option<String>,
    /// Snapshots that there were when they were drawn last.
    n_drawn: usize,
    /// Whether there are more of them than then.
    pub(super) has_more: bool,
    /// What went wrong with the last name, in words.
    pub(super) problem: Option<String>,
}

impl LooksState {
    /// A snapshot has another name: what is compared and faded stays.
    fn follow_name(&mut self, old: &str, new: &str) {
        let sides = self.compare.iter_mut().flat_map(|compare| &mut compare.sides).filter_map(Side::name_mut);
        let ends = self.fade.iter_mut().flat_map(|fade| &mut fade.ends);
        for mention in sides.chain(ends).filter(|mention| *mention == old) {
            new.clone_into(mention);
        }
    }

    /// A card that is dragged stays where it is.
    pub fn let_go(&mut self) {
        self.dragged = None;
    }

    /// One look took the place of another: what is compared and faded stays where no more than a name is new.
    pub fn follow_names(&mut self, before: &Look, after: &Look) {
        let pairs = before.snapshots.iter().zip(&after.snapshots);
        for (old, new) in pairs.filter(|(old, new)| (&old.lights, &old.display) == (&new.lights, &new.display)) {
            if after.snapshot(&old.name).is_none() && before.snapshot(&new.name).is_none() {
                self.follow_name(&old.name, &new.name);
            }
        }
    }
}

/// Said where a document holds as many looks as it can.
const FULL: &str = "There are as many looks as a file holds; delete one first";
/// Said where something is to be written that is not there yet.
const NO_PICTURE: &str = "There is no picture yet";
const NO_SCENE: &str = "No scene is open yet";
/// Letters of a name that a row has room for.
const MOST_LETTERS: usize = 40;

/// A name as a row shows it: on one line, without its end where it is long.
pub fn in_row(name: &str) -> String {
    let cut = name.char_indices().nth(MOST_LETTERS).map(|(end, _)| format!("{}…", name[..end].trim_end()));
    cut.unwrap_or_else(|| name.to_owned()).replace(char::is_control, " ")
}

/// What the strip needs to know.
pub struct LooksView<'a> {
    /// The lights of the scene, for presets and cross-fades.
    pub basis: Option<&'a LightBasis>,
    /// The pictures of the snapshots as far as they are there: texture and size in pixels.
    pub thumbnail: &'a dyn Fn(&str) -> Option<(TextureId, Vec2)>,
    /// Frames of a sequence that are written, and how many it has, while one is under way.
    pub frames: Option<(u32, u32)>,
    /// Whether there is a picture whose frames could be written.
    pub can_export: bool,
    /// Whether a scene is open that could be written with its lights.
    pub is_scene: bool,
}

/// Draws it.
pub fn looks_ui(ui: &mut Ui, look: &mut Look, state: &mut LooksState, view: &LooksView, actions: &mut Vec<Action>) {
    bar_ui(ui, look, state, view, actions);
    if look.snapshots.is_empty() {
        *state = LooksState::default();
        return;
    }
    let n_before = std::mem::replace(&mut state.n_drawn, look.snapshots.len());
    state.has_more = state.n_drawn > n_before;
    ui.add_space(2.0);
    egui::ScrollArea::horizontal().id_salt("looks").auto_shrink([false, true]).show(ui, |ui| {
        ui.horizontal_top(|ui| {
            ui.spacing_mut().item_spacing.x = 10.0;
            let mut centers = Vec::new();
            for idx in 0..look.snapshots.len() {
                if idx < look.snapshots.len() {
                    centers.push(card_ui(ui, idx, look, state, view, actions));
                }
            }
            drop_ui(ui, look, state, &centers);
        });
        keep_in_sight(ui, "cards");
    });
    if let Some(problem) = &state.problem {
        ui.label(RichText::new(problem).color(theme::ALERT).small());
    }
    if let Some(compare) = &mut state.compare {
        compare.heal(look);
        compare_ui(ui, compare, look);
    }
    state.fade = state.fade.take().filter(|fade| fade.is_whole(look));
    if let Some(fade) = &mut state.fade {
        fade_ui(ui, fade, look, view.basis);
    }
    if state.timeline {
        timeline_ui(ui, look, &mut state.player, view, actions);
    }
    ui.add_space(2.0);
}

fn bar_ui(ui: &mut Ui, look: &mut Look, state: &mut LooksState, view: &LooksView, actions: &mut Vec<Action>) {
    ui.horizontal_wrapped(|ui| {
        ui.style_mut().wrap_mode = Some(egui::TextWrapMode::Extend);
        ui.label(RichText::new("Looks").heading().strong());
        ui.add_space(6.0);
        let hint = "Keep the lights and the display as they are now under a name";
        let keep = ui.add_enabled(look.has_room(1), Button::new("Keep look")).on_hover_text(hint);
        if keep.on_disabled_hover_text(FULL).clicked() {
            look.keep("Look");
        }
        ui.add_enabled_ui(look.has_room(1), |ui| {
            ui.menu_button("Presets", |ui| presets_menu(ui, look, view.basis, actions))
                .response
                .on_hover_text("Looks made of what the scene has, and those of another file")
                .on_disabled_hover_text(FULL);
        });
        if !look.snapshots.is_empty() {
            ui.separator();
            tools_ui(ui, look, state);
            let sheet = ui.add_enabled(view.can_export, Button::new("Contact sheet…"));
            let hint = "Write the pictures of all looks, with their names, as one PNG";
            if sheet.on_hover_text(hint).on_disabled_hover_text(NO_PICTURE).clicked() {
                actions.push(Action::Ask(FileTask::SaveSheet));
            }
        }
        let save = ui.add_enabled(view.is_scene, Button::new("Save as glTF…"));
        let hint = "Write the scene with its lights as they are, for other programs";
        if save.on_hover_text(hint).on_disabled_hover_text("Open a scene, not a bake, to write it").clicked() {
            actions.push(Action::Ask(FileTask::ExportGltf));
        }
        if look.snapshots.is_empty() {
            ui.add_space(6.0);
            ui.add(egui::Label::new(RichText::new("A click on a look that you kept brings it back").weak()).truncate());
        }
    });
}

/// What can be done with several looks, each in a row of its own.
fn tools_ui(ui: &mut Ui, look: &Look, state: &mut LooksState) {
    let compare = ui.selectable_label(state.compare.is_some(), "Compare");
    if compare.on_hover_text("See two looks at once, with a divider or side by side").clicked() {
        state.compare = if state.compare.is_some() { None } else { Compare::start(look) };
    }
    let fade = ui.selectable_label(state.fade.is_some(), "Cross-fade");
    if fade.on_hover_text("Let one look become another").clicked() {
        state.fade = if state.fade.is_some() { None } else { Fade::start(look) };
    }
    let timeline = ui.selectable_label(state.timeline, "Timeline");
    if timeline.on_hover_text("Let looks follow each other, and write them as frames").clicked() {
        state.timeline = !state.timeline;
        if !state.timeline {
            state.player.stop();
            // What is not seen is not deleted by a key.
            state.player.let_go();
        }
    }
}

fn presets_menu(ui: &mut Ui, look: &mut Look, basis: Option<&LightBasis>, actions: &mut Vec<Action>) {
    let usable = basis.filter(|_| look.has_room(Preset::ALL.len()));
    let why = if basis.is_none() { NO_SCENE } else { FULL };
    let button = |ui: &mut Ui, words: &str, hint: &str| {
        let button = ui.add_enabled(usable.is_some(), Button::new(words)).on_hover_text(hint);
        let button = button.on_disabled_hover_text(why);
        usable.filter(|_| button.clicked())
    };
    for (preset, _, words) in Preset::ALL {
        if let Some(basis) = button(ui, words, preset.hint()) {
            add_preset(look, preset, basis);
            ui.close();
        }
    }
    ui.separator();
    if let Some(basis) = button(ui, "All four", "Day, dusk, night and exhibition; the day is on then") {
        for (preset, ..) in Preset::ALL {
            add_preset(look, preset, basis);
        }
        let first = look.snapshots.len() - Preset::ALL.len();
        look.take(first);
        ui.close();
    }
    ui.separator();
    let hint = "Add the looks of a .look file to these; the lights stay as they are";
    if ui.button("Looks of a file…").on_hover_text(hint).clicked() {
        actions.push(Action::Ask(FileTask::AddLooks));
        ui.close();
    }
}

/// Adds a preset as a snapshot and lights the scene with it.
fn add_preset(look: &mut Look, preset: Preset, basis: &LightBasis) {
    let snapshot = preset.of(basis, look);
    look.add(preset.words(), snapshot);
    look.take(look.snapshots.len() - 1);
}

/// A card that was dragged goes where it was dropped; Esc leaves it where it was. The drag of one that is gone is over.
fn drop_ui(ui: &Ui, look: &mut Look, state: &mut LooksState, centers: &[f32]) {
    if ui.input(|input| input.key_pressed(egui::Key::Escape)) {
        state.let_go();
    }
    let place_of = |name: &String| look.snapshots.iter().position(|snapshot| snapshot.name == *name);
    let Some(from) = state.dragged.as_ref().and_then(place_of) else { return state.let_go() };
    let Some(pointer) = ui.input(|input| input.pointer.latest_pos()) else { return };
    let others = centers.iter().enumerate().filter(|(idx, center)| *idx != from && **center < pointer.x);
    let to = others.count();
    ui.ctx().set_cursor_icon(egui::CursorIcon::Grabbing);
    if let [first, second, ..] = centers
        && to != from
    {
        // Before which card it lands as they stand now.
        let place = if to < from { to } else { to + 1 };
        let (row, x) = (ui.min_rect(), first + (place as f32 - 0.5) * (second - first));
        ui.painter().vline(x.max(row.left() + 1.0), row.y_range(), Stroke::new(2.0, theme::ACCENT));
    }
    let (came_up, is_down) = ui.input(|input| (input.pointer.any_released(), input.pointer.any_down()));
    if came_up || !is_down {
        state.let_go();
    }
    // One whose button came up while the strip was hidden stays.
    if came_up {
        look.reorder(from, to);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_looks_take_one_line_of_a_row_and_no_more() {
        assert_eq!(in_row("Evening, with guests"), "Evening, with guests");
        assert_eq!(in_row("a/b\nc\td"), "a/b c d");
        let long = in_row(&"é ".repeat(1 << 16));
        assert!(long.ends_with("é…") && long.chars().count() <= MOST_LETTERS + 1, "{long}");
    }
}
