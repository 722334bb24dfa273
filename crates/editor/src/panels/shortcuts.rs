//! Keys: which there are, what they do, and the window that lists them.

use std::iter::repeat_n;

use eframe::egui::gui_zoom::kb_shortcuts::{ZOOM_IN, ZOOM_OUT, ZOOM_RESET};
use eframe::egui::os::OperatingSystem;
use eframe::egui::text_selection::LabelSelectionState;
use eframe::egui::{self, Context, Event, Key, KeyboardShortcut, Modifiers, Popup, Ui};

use super::looks::cards::{WITH_KEY, take_keys as look_keys};
use super::menu::{MENU, are_keys_listed, was_open};
use super::number::give_up;
use crate::action::{Action, FileTask, Side};
use crate::viewport::orbit::Navigation;

const fn command(key: Key) -> KeyboardShortcut {
    KeyboardShortcut::new(Modifiers::COMMAND, key)
}

/// Takes back the last edit.
pub const UNDO: KeyboardShortcut = command(Key::Z);
/// Does again what was taken back.
pub const REDO: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND.plus(Modifiers::SHIFT), Key::Z);
const REDO_TOO: KeyboardShortcut = command(Key::Y);
/// Opens a scene or a bake.
pub const OPEN: KeyboardShortcut = command(Key::O);
/// Opens a look.
pub const OPEN_LOOK: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND.plus(Modifiers::SHIFT), Key::O);
/// Saves the look.
pub const SAVE: KeyboardShortcut = command(Key::S);
/// Saves the look in another file.
pub const SAVE_AS: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND.plus(Modifiers::SHIFT), Key::S);
/// Writes the picture.
pub const EXPORT: KeyboardShortcut = command(Key::E);
const COPY: KeyboardShortcut = command(Key::C);
const BAKE: KeyboardShortcut = command(Key::B);
const PLAY: KeyboardShortcut = KeyboardShortcut::new(Modifiers::NONE, Key::L);
const FIT: KeyboardShortcut = KeyboardShortcut::new(Modifiers::NONE, Key::F);
const FIT_TOO: KeyboardShortcut = KeyboardShortcut::new(Modifiers::NONE, Key::Home);
const ONE_TO_ONE: KeyboardShortcut = KeyboardShortcut::new(Modifiers::NONE, Key::Num1);
/// Hides all panels, or shows them again.
pub const PANELS: KeyboardShortcut = KeyboardShortcut::new(Modifiers::NONE, Key::H);
/// Closes the panel of lights, or opens it.
pub const LIGHTS_PANEL: KeyboardShortcut = KeyboardShortcut::new(Modifiers::NONE, Key::T);
/// Closes the panel of display, camera and bake, or opens it.
pub const SETTINGS_PANEL: KeyboardShortcut = KeyboardShortcut::new(Modifiers::NONE, Key::N);
const CAMERA: KeyboardShortcut = KeyboardShortcut::new(Modifiers::NONE, Key::C);
const VIEW_BEFORE: KeyboardShortcut = KeyboardShortcut::new(Modifiers::NONE, Key::PageUp);
const VIEW_AFTER: KeyboardShortcut = KeyboardShortcut::new(Modifiers::NONE, Key::PageDown);
const DELETE: KeyboardShortcut = KeyboardShortcut::new(Modifiers::NONE, Key::Delete);
const DELETE_TOO: KeyboardShortcut = KeyboardShortcut::new(Modifiers::NONE, Key::Backspace);
/// Copies the chosen lamp.
pub const DUPLICATE: KeyboardShortcut = command(Key::D);
/// Selects all lights that are listed.
pub const ALL_LIGHTS: KeyboardShortcut = command(Key::A);
const AIM: KeyboardShortcut = KeyboardShortcut::new(Modifiers::NONE, Key::A);
const HELP: KeyboardShortcut = KeyboardShortcut::new(Modifiers::NONE, Key::F1);
const CLOSE: KeyboardShortcut = command(Key::Q);

/// Fills the screen with the window; a Mac has another use for F11.
pub fn full_screen(ctx: &Context) -> KeyboardShortcut {
    match ctx.os() {
        OperatingSystem::Mac => KeyboardShortcut::new(Modifiers::COMMAND.plus(Modifiers::CTRL), Key::F),
        _ => KeyboardShortcut::new(Modifiers::NONE, Key::F11),
    }
}

/// Pushes what the keys that were pressed ask for. Keys that a text field wants stay with it; while a question waits for its answer they
/// are for the question, while the list of keys is open they are there to be read about, and those that act on what is chosen or seen are
/// for nothing while a menu is open.
pub fn take_keys(ctx: &Context, waits: bool, actions: &mut Vec<Action>) {
    if waits {
        let is_asked = presses(ctx, &HELP) % 2 == 1;
        if is_asked || (!ctx.text_edit_focused() && asks_for_help(ctx)) {
            actions.push(Action::ToggleShortcuts);
        }
        return;
    }
    take_copy(ctx, actions);
    let mut take = |shortcut: &KeyboardShortcut, counts: Presses, action: Action| {
        let n_presses = presses(ctx, shortcut);
        let n_times = match counts {
            Presses::Once => n_presses.min(1),
            Presses::Each => n_presses,
            Presses::Toggle => n_presses % 2,
        };
        actions.extend(repeat_n(action, n_times));
    };
    take(&HELP, Presses::Toggle, Action::ToggleShortcuts);
    // The longer ones first: a plain Ctrl+S also matches Ctrl+Shift+S.
    take(&OPEN_LOOK, Presses::Once, Action::Ask(FileTask::OpenLook));
    take(&OPEN, Presses::Once, Action::Ask(FileTask::OpenScene));
    take(&SAVE_AS, Presses::Once, Action::Ask(FileTask::SaveLook));
    take(&SAVE, Presses::Once, Action::SaveLookAgain);
    take(&EXPORT, Presses::Once, Action::Ask(FileTask::Export));
    take(&BAKE, Presses::Once, Action::BakeByKey);
    take(&CLOSE, Presses::Once, Action::CloseWindow);
    take(&full_screen(ctx), Presses::Toggle, Action::ToggleFullScreen);
    if ctx.text_edit_focused() {
        return;
    }
    take(&REDO, Presses::Each, Action::Redo);
    take(&UNDO, Presses::Each, Action::Undo);
    take(&REDO_TOO, Presses::Each, Action::Redo);
    (0..WITH_KEY).for_each(|idx| take(&look_keys(idx), Presses::Once, Action::TakeLook(idx)));
    // What lies behind an open menu or picker stays as it is.
    if Popup::is_any_open(ctx) {
        return;
    }
    take(&PLAY, Presses::Toggle, Action::PlayTimeline);
    take(&FIT, Presses::Once, Action::FitPicture);
    take(&FIT_TOO, Presses::Once, Action::FitPicture);
    take(&ONE_TO_ONE, Presses::Once, Action::OneToOne);
    take(&PANELS, Presses::Toggle, Action::TogglePanels);
    take(&LIGHTS_PANEL, Presses::Toggle, Action::TogglePanel(Side::Lights));
    take(&SETTINGS_PANEL, Presses::Toggle, Action::TogglePanel(Side::Settings));
    take(&CAMERA, Presses::Toggle, Action::ToggleCamera);
    take(&VIEW_BEFORE, Presses::Each, Action::StepView(-1));
    take(&VIEW_AFTER, Presses::Each, Action::StepView(1));
    take(&DELETE, Presses::Once, Action::DeleteChosen);
    take(&DELETE_TOO, Presses::Once, Action::DeleteChosen);
    take(&DUPLICATE, Presses::Each, Action::DuplicateLamp);
    take(&AIM, Presses::Toggle, Action::AimLamp);
    if asks_for_help(ctx) {
        actions.push(Action::ToggleShortcuts);
    }
}

/// What becomes of a key that was pressed several times since the last frame, as happens where frames take long.
#[derive(Clone, Copy)]
enum Presses {
    /// Once is enough.
    Once,
    /// Each press counts.
    Each,
    /// Two presses leave all as it was.
    Toggle,
}

/// How often keys were pressed since the last frame; nothing else hears them.
pub fn presses(ctx: &Context, shortcut: &KeyboardShortcut) -> usize {
    ctx.input_mut(|input| input.count_and_consume_key(shortcut.modifiers, shortcut.logical_key))
}

/// Whether keys are for what is drawn there: neither for a text nor for a question, a menu, a picker or the list of keys in front of it.
pub fn hears_keys(ui: &Ui) -> bool {
    let is_behind = Popup::is_any_open(ui.ctx()) || !ui.memory(|memory| memory.allows_interaction(ui.layer_id()));
    !ui.text_edit_focused() && !is_behind && !are_keys_listed(ui.ctx())
}

/// Whether Escape was pressed and is for what is drawn there, and for no menu or list that it closes, nor for a text that it gives up.
pub fn escapes(ui: &Ui) -> bool {
    hears_keys(ui) && !was_open(ui.ctx()) && ui.input(|input| input.key_pressed(Key::Escape))
}

/// Whether a question mark was typed: where it lies, and with which keys it is made, each keyboard has for itself.
fn asks_for_help(ctx: &Context) -> bool {
    ctx.input(|input| input.events.iter().any(|event| matches!(event, Event::Text(text) if text == "?")))
}

/// The toolkit makes an event of the keys that copy; words that are marked go before the picture.
fn take_copy(ctx: &Context, actions: &mut Vec<Action>) {
    let has_words = ctx.with_plugin(|selection: &mut LabelSelectionState| selection.has_selection()) == Some(true);
    if !has_words && !ctx.text_edit_focused() && ctx.input(|input| input.events.contains(&Event::Copy)) {
        actions.push(Action::CopyImage);
    }
}

/// Points of the window above and below the list: its title and some air.
const AROUND: f32 = 96.0;
/// Points of the window that are left beside both columns of the list: margins, the gap between them and the scroll bar.
const BESIDE: f32 = 96.0;
/// Shares of the rest that keys, and what they do, take at most; longer words go on in the next line.
const SHARES: [f32; 2] = [0.4, 0.6];

/// Closes the list, where it is open, before a question below it hears the same key; what is typed there is given up by it.
pub fn close_by_key(ctx: &Context, open: &mut bool) {
    if *open && ctx.input_mut(|input| input.consume_key(Modifiers::NONE, Key::Escape)) {
        *open = false;
        give_up(ctx);
    }
}

/// The list of keys and gestures; it scrolls where the window is lower than it. It lies over a question that waits for an answer.
pub fn shortcuts_ui(ctx: &Context, open: &mut bool) {
    let room = ctx.content_rect().size();
    let most = (room.y - AROUND).max(AROUND);
    let widths = SHARES.map(|share| share * (room.x - BESIDE).max(BESIDE));
    egui::Window::new("Keyboard and mouse")
        .open(open)
        .collapsible(false)
        .resizable(false)
        .order(egui::Order::Foreground)
        .anchor(egui::Align2::CENTER_CENTER, egui::Vec2::ZERO)
        .show(ctx, |ui| {
            egui::ScrollArea::vertical().max_height(most).min_scrolled_height(most).show(ui, |ui| {
                egui::Grid::new("shortcuts").num_columns(2).spacing([28.0, 7.0]).show(ui, |ui| {
                    for (keys, what) in rows(ctx) {
                        let words = [egui::RichText::new(keys).strong(), egui::RichText::new(what)];
                        words.into_iter().zip(widths).for_each(|(words, width)| words_ui(ui, words, width));
                        ui.end_row();
                    }
                });
            });
        });
}

/// Words of a cell of a grid, in several lines where they are wider.
fn words_ui(ui: &mut Ui, words: egui::RichText, width: f32) {
    ui.vertical(|ui| {
        ui.set_max_width(width);
        ui.label(words);
    });
}

fn rows(ctx: &Context) -> Vec<(String, &'static str)> {
    let keys = |shortcut: &KeyboardShortcut| ctx.format_shortcut(shortcut);
    let words = |words: &str| words.to_string();
    let command = ctx.format_modifiers(Modifiers::COMMAND);
    let command = command.trim_end_matches('+');
    let [blender, alt_mouse, trackpad] = Navigation::ALL.map(|(_, name, hint)| (format!("Camera by {name}"), hint));
    vec![
        (keys(&OPEN), "Open a scene or a bake"),
        (keys(&OPEN_LOOK), "Open a look"),
        (keys(&SAVE), "Save the look"),
        (keys(&SAVE_AS), "Save the look under another name"),
        (keys(&EXPORT), "Export the picture"),
        (keys(&COPY), "Copy the picture"),
        (keys(&BAKE), "Start the bake, or go on with it"),
        (keys(&UNDO), "Undo"),
        (format!("{} or {}", keys(&REDO), keys(&REDO_TOO)), "Redo"),
        (format!("{} to {}", keys(&look_keys(0)), keys(&look_keys(WITH_KEY - 1))), "Take over a look by its number"),
        (words("L"), "Play the timeline, or stay"),
        (words("Arrow keys on the timeline, with Shift"), "A frame back or on, ten frames"),
        (words("F or Home"), "Show the whole picture"),
        (words("1"), "Show it pixel by pixel"),
        (words("H"), "Hide the panels, show them again"),
        (words("T, N"), "The panel of lights, the panel of settings"),
        (
            format!("{}, {}, {}", keys(&ZOOM_IN), keys(&ZOOM_OUT), keys(&ZOOM_RESET)),
            "Everything in the window larger, smaller, as large as at first",
        ),
        (words("Wheel, pinch"), "Zoom at the pointer; by Trackpad two fingers move the picture"),
        (words("Z + drag"), "Zoom to a rectangle"),
        (words("Middle drag, Space + drag"), "Move the picture"),
        (words("Click in the picture"), "Show which lights are there"),
        (words("P"), "Pin a probe at the pointer"),
        (words("Arrow keys in the picture, with Shift"), "Move the ring by a pixel, ten pixels: F6 or Tab gets there"),
        (words("Enter, P in the picture"), "Show which lights are at the ring, pin a probe there"),
        (words("C, Esc"), "Take the camera in hand, put it down"),
        (format!("{}, {}", keys(&VIEW_BEFORE), keys(&VIEW_AFTER)), "The baked view before, the one after"),
        (words("Drag with the camera in hand"), "Turn, with Shift move; the wheel comes nearer"),
        blender,
        alt_mouse,
        trackpad,
        (
            words("W A S D, Q E, with Shift"),
            "Walk with the camera in hand, down and up, faster: if chosen under Navigation",
        ),
        (words("Shift, Alt while marking"), "Add to what is marked, take away from it"),
        (words("Esc while marking"), "Put the tool down"),
        (words("Drag on a panel in the picture"), "Place or move a spot of light"),
        (words("Double-click, right-click on a panel"), "Add a spot; delete the one that is there"),
        (words("Arrow keys after a press on a spot"), "Move it by a quarter of a texel, with Shift by a tenth of that"),
        (words("Click on a lamp"), "Choose it, show its handles"),
        (words("Drag an arrow or a square"), "Move the lamp along an axis or across it"),
        (words("Drag the lamp, Alt + drag"), "Move it over surfaces, or freely; what is selected with it goes along"),
        (words("Arrow keys on a handle of a lamp, with Shift"), "Move the lamp, finely"),
        (words("Shift while dragging a lamp or a spot"), "Finer steps"),
        (words("Esc while dragging"), "Put it back: a lamp, a spot, a look, a key of the timeline"),
        (words("A, then click"), "Aim the selected lamps at what is clicked"),
        (keys(&DUPLICATE), "Duplicate the lamp"),
        (words("Del"), "Delete the lamp, or the key of the timeline, that was chosen last"),
        (format!("Click on a name, with Shift, with {command}"), "Select a light, all up to there, one more"),
        (format!("Click in the picture, with Shift or {command}"), "Select the light that shines there, or one more"),
        (keys(&ALL_LIGHTS), "Select all lights that the list has"),
        (
            words("Arrow keys up and down, with Shift"),
            "Select the light above, the one below, or one more: after a click on a name",
        ),
        (words("[ and ]"), "Selected lights a third of a stop darker, brighter"),
        (words("Arrow keys on a fader, with Shift"), "A third of a stop, a twelfth"),
        (words("Arrow keys on colors and the sky, with Shift"), "Another color, another place of the sun, finely"),
        (words("Arrow keys on the divider of a comparison"), "Move it"),
        (words("F2"), "Rename the selected light"),
        (words("Double-click on a name"), "Reset the light"),
        (words("Right-click on a name, a look, the picture"), "Its menu"),
        (format!("{} or the menu key", keys(&MENU)), "The menu of what has the focus"),
        (words("Shift while dragging a fader or a number"), "Finer steps"),
        (keys(&full_screen(ctx)), "Fill the screen, or no longer"),
        (keys(&CLOSE), "Close the window"),
        (words("F1 or ?"), "This list"),
    ]
}
