//! The panel of lights: a list, a mixer or a table of the same lights, sorted into groups, and an editor of what is
//! selected.

mod board;
mod columns;
mod editor;
mod fader;
mod group_row;
pub mod groups;
mod list;
pub(super) mod listed;
mod mix;
pub(super) mod names;
mod row;
pub mod scale;
mod selection;
pub mod solo;
mod table;

use std::collections::{BTreeMap, BTreeSet};

use clerestory_transport::basis::LightBasis;
use eframe::egui::{
    self, Align, ComboBox, Event, Key, KeyboardShortcut, Layout, Modifiers, Panel, RichText, TextEdit, Ui,
};
use serde::{Deserialize, Serialize};

use super::lamps::{LampChoice, LampState, Pick, add_button, missing_ui};
use super::number::Number;
use super::shortcuts::{ALL_LIGHTS, hears_keys, presses};
use crate::action::Action;
use crate::look::Look;
pub use groups::{ADDED, take_in, with_groups};
use groups::{GroupBy, Item, arranged};
pub(crate) use listed::source_words;
use listed::{Listed, Profiles, listed};
use mix::Mix;
use names::Renaming;
use scale::{IDEAL_EFFICACY, Scale};
use selection::Selection;
pub use solo::{heard, letters_menu, solo_banner_ui};
use table::Sorting;

/// How the lights are laid out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum LightsView {
    /// A row each.
    #[default]
    List,
    /// A vertical fader each.
    Board,
    /// A line of numbers each.
    Table,
}

impl LightsView {
    /// Width of the panel that shows it, points.
    pub fn width(self) -> f32 {
        match self {
            LightsView::List => 404.0,
            LightsView::Board => 600.0,
            LightsView::Table => 712.0,
        }
    }
}

/// How a person likes the panel; it outlasts scenes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LightsLayout {
    /// List, board or table.
    pub view: LightsView,
    /// By what lights are sorted.
    pub group_by: GroupBy,
    /// In what intensities are told.
    pub scale: Scale,
    /// Lumen per watt, where they are told in watts.
    pub efficacy: f32,
}

impl Default for LightsLayout {
    fn default() -> LightsLayout {
        let (view, group_by, scale) = (LightsView::default(), GroupBy::default(), Scale::default());
        LightsLayout { view, group_by, scale, efficacy: IDEAL_EFFICACY }
    }
}

/// What the panel remembers and no look holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LightsState {
    /// How it is laid out.
    pub layout: LightsLayout,
    /// Part of the names to show.
    pub filter: String,
    /// Keys of the lights that alone are heard.
    pub solo: BTreeSet<String>,
    /// Keys of lamps in the place of lights of the scene, and of those, when solo was last brought in step.
    stand_ins: BTreeMap<String, String>,
    /// Panel and spot that were touched last.
    pub spot: Option<(String, usize)>,
    /// The free lamps.
    pub lamps: LampState,
    /// Key of the light that was chosen in the picture: the panel selects it and shows it.
    pub chosen: Option<String>,
    /// Key of the light whose name is under the pointer, until the picture has shown it.
    pub pointed: Option<String>,
    chosen_before: Option<String>,
    selection: Selection,
    /// Key of the light whose name has the keyboard, and of the one whose name gets it.
    focused: Option<String>,
    focus_next: Option<String>,
    /// The chosen lamp of the frame before.
    lamp_before: Option<String>,
    collapsed: BTreeSet<String>,
    renaming: Renaming,
    sorting: Option<Sorting>,
    /// Keys of the lines of the table as they were sorted last.
    lines: Vec<String>,
    scroll_to: Option<String>,
    profiles: Profiles,
}

/// Room for the button that clears the filter, points.
const CLEAR: f32 = 34.0;

impl LightsState {
    /// For a scene that was just opened, laid out as before.
    pub fn new(layout: LightsLayout) -> LightsState {
        LightsState { layout, ..LightsState::default() }
    }

    /// Files of measured lamps are read again where they are asked.
    pub fn forget_profiles(&mut self) {
        self.profiles.clear();
    }

    /// Whether a light is selected in the list.
    pub fn is_selected(&self, key: &str) -> bool {
        self.selection.has(key)
    }

    /// Selects some lights, whatever was selected before.
    pub fn select(&mut self, keys: Vec<String>) {
        self.selection.set_all(keys);
        self.choose_lamp(None);
    }

    /// Chooses a lamp of the picture, or none, from within the panel, after what is selected changed. What is selected alone
    /// is the chosen light of the picture, too.
    fn choose_lamp(&mut self, key: Option<String>) {
        self.chosen = self.selection.single().map(str::to_owned);
        self.lamps.chosen = key;
        (self.chosen_before, self.lamp_before) = (self.chosen.clone(), self.lamps.chosen.clone());
    }

    /// Takes over what was chosen in the picture: a lamp that was clicked, or a light that was asked for. Every frame, whether the panel is
    /// seen or not: keys are for what is selected.
    pub fn follow_picture(&mut self) {
        let picked = self.lamps.picked.take();
        let mut asked = self.chosen.clone().filter(|_| self.chosen != self.chosen_before);
        if self.lamps.chosen != self.lamp_before {
            match &self.lamps.chosen {
                Some(key) => asked = Some(key.clone()),
                None if self.lamp_before.as_deref().is_some_and(|key| self.selection.has(key)) => {
                    self.selection.clear()
                }
                None => {}
            }
            self.lamp_before.clone_from(&self.lamps.chosen);
        }
        let (asked, pick) = picked.map_or((asked, Pick::Alone), |(key, pick)| (Some(key), pick));
        if let Some(key) = asked {
            match pick {
                // What is dragged takes what is selected along, and all of it stays selected.
                Pick::Alone if !self.lamps.carried.is_empty() => {}
                Pick::Alone => self.selection.set(&key),
                Pick::Another => self.selection.add(&key),
            }
            (self.chosen, self.scroll_to) = (Some(key.clone()), Some(key));
        }
        self.chosen_before.clone_from(&self.chosen);
    }
}

/// Draws the panel.
pub fn lights_ui(
    ui: &mut Ui,
    basis: &LightBasis,
    look: &mut Look,
    state: &mut LightsState,
    lamps: &LampChoice,
    actions: &mut Vec<Action>,
) {
    let lights = listed(basis, look, &mut state.profiles);
    heading_ui(ui, state, lamps, actions);
    layout_ui(ui, state, lights.len());
    let items = shown(arranged(&lights, state.layout.group_by, look), &lights, &state.filter);
    unfold_for(state, &items, &lights);
    let order = order(&items, &lights, &state.collapsed);
    let file = basis.file_rig();
    let mut mix = Mix { lights: &lights, items: &items, order, look, basis, file: &file, state, actions };
    keys(ui, &mut mix);
    mix.state.focused = None;
    if lights.iter().any(|light| mix.state.selection.has(&light.key)) {
        let frame = egui::Frame::NONE.inner_margin(egui::Margin::symmetric(0, 4));
        Panel::bottom("selected lights").frame(frame).show(ui, |ui| editor::editor_ui(ui, &mut mix));
    }
    missing_ui(ui, lamps, mix.actions);
    if items.is_empty() {
        let words = if lights.is_empty() { "No lights in this scene" } else { "No light has this in its name" };
        ui.label(RichText::new(words).weak());
    }
    match mix.state.layout.view {
        LightsView::List => list::list_ui(ui, &mut mix),
        LightsView::Board => board::board_ui(ui, &mut mix),
        LightsView::Table => table::table_ui(ui, &mut mix),
    }
    // Now it is known in which order they stand, and which of them has the keyboard.
    arrow_keys(ui, &mut mix);
}

/// Title, ways to see the lights, and the menu of lamps.
fn heading_ui(ui: &mut Ui, state: &mut LightsState, lamps: &LampChoice, actions: &mut Vec<Action>) {
    ui.add_space(4.0);
    ui.horizontal(|ui| {
        ui.label(RichText::new("Lights").heading().strong());
        ui.add_space(8.0);
        // On the left, where they stay under the pointer while the panel changes its width.
        ui.scope(|ui| {
            ui.spacing_mut().item_spacing.x = 2.0;
            for (view, name, tip) in [
                (LightsView::List, "List", "A row for each light"),
                (LightsView::Board, "Board", "A mixer with a fader for each light and a master for each group"),
                (LightsView::Table, "Table", "All numbers of each light"),
            ] {
                let button = ui.selectable_label(state.layout.view == view, RichText::new(name).small());
                if button.on_hover_text(tip).clicked() {
                    state.layout.view = view;
                }
            }
        });
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| add_button(ui, lamps, actions));
    });
    ui.separator();
}

/// Search, groups and units.
fn layout_ui(ui: &mut Ui, state: &mut LightsState, n_lights: usize) {
    // One light is found without.
    if n_lights > 1 {
        filter_ui(ui, &mut state.filter);
    } else {
        state.filter.clear();
    }
    let layout = &mut state.layout;
    ui.horizontal(|ui| {
        ui.label(RichText::new("Group by").weak());
        let combo = ComboBox::from_id_salt("group by").width(84.0).selected_text(layout.group_by.name());
        let combo = combo.show_ui(ui, |ui| {
            for by in GroupBy::ALL {
                ui.selectable_value(&mut layout.group_by, by, by.name()).on_hover_text(by.words());
            }
        });
        combo.response.accessible_name("Group lights by").on_hover_text(layout.group_by.words());
        ui.label(RichText::new("Unit").weak());
        let combo = ComboBox::from_id_salt("unit").width(44.0).selected_text(layout.scale.name());
        let combo = combo.show_ui(ui, |ui| {
            for scale in Scale::ALL {
                ui.selectable_value(&mut layout.scale, scale, scale.words());
            }
        });
        let tip = "What intensities are counted in; lights that have no such amount keep the unit of their file";
        combo.response.accessible_name("Unit of intensities").on_hover_text(tip);
        if layout.scale == Scale::Watt {
            let number = Number::new(&mut layout.efficacy).range(1.0..=IDEAL_EFFICACY).speed(1.0).max_decimals(0);
            let tip = "Luminous efficacy, lm/W: 683 is what glTF and Blender count by, LED lamps have about 100";
            ui.add(number.suffix(" lm/W")).on_hover_text(tip).accessible_name("Luminous efficacy");
        }
    });
}

/// The field that the names are searched by, and a way out of it.
fn filter_ui(ui: &mut Ui, filter: &mut String) {
    ui.horizontal(|ui| {
        let is_on = !filter.is_empty();
        let width = ui.available_width() - if is_on { CLEAR } else { 0.0 };
        let edit = TextEdit::singleline(filter).hint_text("Filter by name").desired_width(width);
        ui.add(edit).accessible_name("Filter lights");
        if is_on {
            let clear = ui.button("×").on_hover_text("Show all lights");
            if clear.accessible_name("Clear the filter").clicked() {
                filter.clear();
            }
        }
    });
}

/// The items with a light, or a group, of which a part of the name was typed.
fn shown(items: Vec<Item>, lights: &[Listed], filter: &str) -> Vec<Item> {
    let part = filter.trim().to_lowercase();
    if part.is_empty() {
        return items;
    }
    let is_called = |item: &Item| match item {
        Item::Light(idx) => lights[*idx].is_called(&part),
        Item::Group(group) => group.name.to_lowercase().contains(&part),
    };
    // Lights that are found in a group stand alone: its master would turn others that are not shown.
    let found = items.into_iter().flat_map(|item| match item {
        item if is_called(&item) => vec![item],
        item => item.lights().iter().map(|idx| Item::Light(*idx)).filter(is_called).collect(),
    });
    found.collect()
}

/// What is to be shown must not lie in a folded group.
fn unfold_for(state: &mut LightsState, items: &[Item], lights: &[Listed]) {
    let Some(wanted) = &state.scroll_to else { return };
    for item in items {
        if let Item::Group(group) = item
            && group.lights.iter().any(|idx| lights[*idx].key == *wanted)
        {
            state.collapsed.remove(&group.key);
        }
    }
}

/// Keys in the order in which they are shown.
fn order(items: &[Item], lights: &[Listed], collapsed: &BTreeSet<String>) -> Vec<String> {
    let is_open = |item: &&Item| match item {
        Item::Group(group) => !collapsed.contains(&group.key),
        Item::Light(_) => true,
    };
    let shown = items.iter().filter(is_open).flat_map(|item| item.lights());
    shown.map(|idx| lights[*idx].key.clone()).collect()
}

/// Arrows up and down take the selection along, with Shift they extend it: while a name has the keyboard, or nothing has it.
fn arrow_keys(ui: &Ui, mix: &mut Mix) {
    let focused = mix.state.focused.clone();
    let nothing_has_it = || ui.memory(|memory| memory.focused().is_none());
    let is_meant = focused.is_some() || !mix.state.selection.is_empty() && nothing_has_it();
    if !is_meant || !hears_keys(ui) {
        return;
    }
    let step = |event: &Event| match event {
        Event::Key { key, pressed: true, modifiers, .. } if !modifiers.alt && !modifiers.command => match key {
            Key::ArrowUp => Some((-1, *modifiers)),
            Key::ArrowDown => Some((1, *modifiers)),
            _ => None,
        },
        _ => None,
    };
    let steps: Vec<(isize, Modifiers)> = ui.input(|input| input.events.iter().filter_map(step).collect());
    let mut from = focused.clone();
    for (by, modifiers) in steps {
        // Only the first goes on from the keyboard, which follows once all are done.
        if mix.step(from.take().as_deref(), by, modifiers) && focused.is_some() {
            mix.state.focus_next.clone_from(&mix.state.scroll_to);
        }
    }
}

/// Keys that select, and change what is selected. While somebody types they are letters.
fn keys(ui: &Ui, mix: &mut Mix) {
    if !hears_keys(ui) {
        return;
    }
    if ui.input_mut(|input| input.consume_shortcut(&ALL_LIGHTS)) {
        let listed: Vec<usize> = mix.items.iter().flat_map(Item::lights).copied().collect();
        let all = mix.keys(&listed);
        mix.state.select(all);
    }
    if mix.state.selection.is_empty() {
        return;
    }
    let n_presses = |key: Key| presses(ui.ctx(), &KeyboardShortcut::new(Modifiers::NONE, key));
    let selected: Vec<String> =
        mix.lights.iter().filter(|light| mix.state.selection.has(&light.key)).map(|light| light.key.clone()).collect();
    for (key, step_ev) in [(Key::OpenBracket, -fader::STEP_EV), (Key::CloseBracket, fader::STEP_EV)] {
        (0..n_presses(key)).for_each(|_| editor::offset(mix, &selected, step_ev));
    }
    if let ([one], 1..) = (selected.as_slice(), n_presses(Key::F2)) {
        mix.state.renaming = Some((one.clone(), mix.look.name_of(one).to_owned()));
        // The field stands in its row, which may be folded away or out of sight.
        mix.state.scroll_to = Some(one.clone());
    }
}
