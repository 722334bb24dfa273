//! The bar at the top: files, undo, theme.

use std::path::{Path, PathBuf};

use eframe::egui::{self, Button, ThemePreference, Ui};

use super::shortcuts;
use super::sight::keep_in_sight;
use crate::action::{Action, FileTask, Side, opened};
use egui::gui_zoom::kb_shortcuts::{ZOOM_IN, ZOOM_OUT};

/// What the toolbar needs to know.
pub struct ToolbarState<'a> {
    /// Whether there is something to take back.
    pub can_undo: bool,
    /// Whether something was taken back.
    pub can_redo: bool,
    /// Whether there is a picture.
    pub has_picture: bool,
    /// Whether the panels are hidden.
    pub is_bare: bool,
    /// Whether the panel of lights and that of settings are seen.
    pub panels_seen: [bool; 2],
    /// Whether the look differs from its file.
    pub is_unsaved: bool,
    /// That file, if it has one.
    pub look_file: Option<&'a Path>,
    /// Scenes and looks of lately, newest first.
    pub recent: &'a [PathBuf],
}

/// Width in points that all buttons have room in.
const WIDE: f32 = 970.0;
/// Points more where the look has a file that it goes back to.
const WITH_FILE: f32 = 36.0;
/// Points of the window that a menu of many lines leaves free; more of them are scrolled.
const BESIDE_MENU: f32 = 60.0;

/// Draws it.
pub fn toolbar_ui(ui: &mut Ui, state: &ToolbarState, actions: &mut Vec<Action>) {
    // Large letters or a small window: in several rows.
    if ui.available_width() < WIDE + if state.look_file.is_some() { WITH_FILE } else { 0.0 } {
        ui.horizontal_wrapped(|ui| {
            look_buttons(ui, state, actions);
            window_buttons(ui, actions);
            panel_buttons(ui, state, actions);
        });
        return;
    }
    ui.horizontal(|ui| {
        look_buttons(ui, state, actions);
        let layout = egui::Layout::right_to_left(egui::Align::Center);
        ui.with_layout(layout, |ui| {
            window_buttons(ui, actions);
            ui.menu_button("Panels", |ui| panel_buttons(ui, state, actions));
        });
    });
}

/// Files, undo and redo.
fn look_buttons(ui: &mut Ui, state: &ToolbarState, actions: &mut Vec<Action>) {
    file_buttons(ui, state, actions);
    ui.separator();
    let rows = [
        (state.can_undo, "Undo", "Nothing was changed yet", &shortcuts::UNDO, Action::Undo),
        (state.can_redo, "Redo", "Nothing was undone", &shortcuts::REDO, Action::Redo),
    ];
    for (enabled, label, why, keys, action) in rows {
        let hint = ui.ctx().format_shortcut(keys);
        let button = ui.add_enabled(enabled, Button::new(label)).on_hover_text(hint);
        if button.on_disabled_hover_text(why).clicked() {
            actions.push(action);
        }
    }
}

/// What is about the window.
fn window_buttons(ui: &mut Ui, actions: &mut Vec<Action>) {
    if ui.button("Shortcuts").on_hover_text("F1").clicked() {
        actions.push(Action::ToggleShortcuts);
    }
    ui.menu_button("Theme", theme_menu);
    ui.menu_button("Text size", size_menu);
}

/// Which panels there are: in a small window at hand, since it has room for one of them.
fn panel_buttons(ui: &mut Ui, state: &ToolbarState, actions: &mut Vec<Action>) {
    let [lights, settings] = state.panels_seen;
    let rows = [
        (lights, "Lights panel", &shortcuts::LIGHTS_PANEL, Action::TogglePanel(Side::Lights)),
        (settings, "Settings panel", &shortcuts::SETTINGS_PANEL, Action::TogglePanel(Side::Settings)),
        (state.is_bare, "Picture only", &shortcuts::PANELS, Action::TogglePanels),
    ];
    for (is_on, name, keys, action) in rows {
        let button = ui.add(Button::selectable(is_on, name));
        if button.on_hover_text(ui.ctx().format_shortcut(keys)).clicked() {
            actions.push(action);
            ui.close();
        }
    }
}

fn file_buttons(ui: &mut Ui, state: &ToolbarState, actions: &mut Vec<Action>) {
    let keys = |keys: &egui::KeyboardShortcut| ui.ctx().format_shortcut(keys);
    let [open, save, save_as, export] =
        [&shortcuts::OPEN, &shortcuts::SAVE, &shortcuts::SAVE_AS, &shortcuts::EXPORT].map(keys);
    let look_hint = format!("Light what is open by a .look file, {}", keys(&shortcuts::OPEN_LOOK));
    if ui.button("Open…").on_hover_text(format!("Open a glTF scene or a finished bake, {open}")).clicked() {
        actions.push(Action::Ask(FileTask::OpenScene));
    }
    let hint = "Open a folder with a picture for each light, as a light stage takes them";
    if ui.button("Open pictures…").on_hover_text(hint).clicked() {
        actions.push(Action::Ask(FileTask::OpenPictures));
    }
    ui.menu_button("Recent", |ui| recent_menu(ui, state.recent, actions));
    ui.separator();
    if ui.button("Open look…").on_hover_text(look_hint).clicked() {
        actions.push(Action::Ask(FileTask::OpenLook));
    }
    // Without a file it asks for one.
    let (words, hint) = match state.look_file {
        Some(file) => ("Save look", format!("Save the look in {}, {save}", file.display())),
        None => ("Save look…", format!("Save the look in a file, {save}")),
    };
    let response = ui.button(words).on_hover_text(hint);
    if response.clicked() {
        actions.push(Action::SaveLookAgain);
    }
    if state.is_unsaved {
        let dot = response.rect.right_top() + egui::vec2(-4.0, 4.0);
        ui.painter().circle_filled(dot, 2.5, crate::theme::ACCENT);
    }
    if state.look_file.is_some() {
        let button = ui.button("As…").on_hover_text(format!("Save the look in another file, {save_as}"));
        if button.accessible_name("Save look as…").clicked() {
            actions.push(Action::Ask(FileTask::SaveLook));
        }
    }
    let button = ui.add_enabled(state.has_picture, Button::new("Export…"));
    let hint =
        format!("Write the picture as PNG or linear EXR, {export}\nThe scene itself: “Save as glTF…” beside the looks");
    let button = button.on_hover_text(hint);
    if button.on_disabled_hover_text("There is no picture yet").clicked() {
        actions.push(Action::Ask(FileTask::Export));
    }
}

fn recent_menu(ui: &mut Ui, recent: &[PathBuf], actions: &mut Vec<Action>) {
    let most = (ui.ctx().content_rect().height() - BESIDE_MENU).max(BESIDE_MENU);
    egui::ScrollArea::vertical().max_height(most).show(ui, |ui| {
        for path in recent {
            if ui.button(recent_name(path, recent)).on_hover_text(path.display().to_string()).clicked() {
                actions.push(opened(path.clone()));
                ui.close();
            }
        }
        if !recent.is_empty() {
            ui.separator();
        }
        if ui.button("Built-in gallery").clicked() {
            actions.push(Action::OpenBuiltIn);
            ui.close();
        }
        keep_in_sight(ui, "recent files");
    });
}

/// A file's name, with its folder where another one is called so.
fn recent_name(path: &Path, recent: &[PathBuf]) -> String {
    let name = path.file_name().map_or_else(|| path.display().to_string(), |name| name.display().to_string());
    let is_alone = recent.iter().filter(|other| other.file_name() == path.file_name()).count() < 2;
    match path.parent().and_then(Path::file_name).filter(|_| !is_alone) {
        Some(folder) => format!("{name} in {}", folder.display()),
        None => name,
    }
}

/// Sizes of everything in the window, of the size that the system asks for.
const SIZES_PERCENT: [u16; 5] = [100, 125, 150, 175, 200];

fn size_menu(ui: &mut Ui) {
    let current = ui.ctx().zoom_factor();
    for percent in SIZES_PERCENT {
        let factor = f32::from(percent) / 100.0;
        if ui.radio((current - factor).abs() < 1e-3, format!("{percent} %")).clicked() {
            ui.ctx().set_zoom_factor(factor);
            ui.close();
        }
    }
    ui.separator();
    let [larger, smaller] = [ZOOM_IN, ZOOM_OUT].map(|keys| ui.ctx().format_shortcut(&keys));
    ui.weak(format!("{larger} and {smaller}"));
}

fn theme_menu(ui: &mut Ui) {
    let current = ui.ctx().options(|options| options.theme_preference);
    let choices = [
        (ThemePreference::Dark, "Dark"),
        (ThemePreference::Light, "Light"),
        (ThemePreference::System, "As the system"),
    ];
    for (theme, name) in choices {
        if ui.radio(current == theme, name).clicked() {
            ui.ctx().set_theme(theme);
            ui.close();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_one_name_are_told_by_their_folders() {
        let recent = ["/hall/scene.gltf", "/shop/scene.gltf", "/shop/room.glb"].map(PathBuf::from);
        let names = recent.each_ref().map(|path| recent_name(path, &recent));
        assert_eq!(names, ["scene.gltf in hall", "scene.gltf in shop", "room.glb"]);
    }
}
