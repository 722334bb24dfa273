//! A snapshot in the strip: its picture, its name, and whether it is on.

use anyhow::Result;
use eframe::egui::{
    self, Align2, Color32, CornerRadius, FontId, Key, PointerButton, Rect, Response, Sense, Stroke, StrokeKind,
    TextEdit, Ui, pos2, vec2,
};

use super::mix::Compare;
use super::{FULL, LooksState, LooksView, in_row};
use crate::action::Action;
use crate::look::Look;
use crate::look::snapshot::Mark;
use crate::panels::menu::context_menu;
use crate::theme;

/// Size of the picture in points.
const PICTURE: egui::Vec2 = vec2(116.0, 66.0);
/// Height of the name below it.
const NAME_HEIGHT: f32 = 20.0;
/// Snapshots that have a key of their own.
pub const WITH_KEY: usize = 9;

/// Draws a card and lets it be used; answers where its middle is from the left, points.
pub(super) fn card_ui(
    ui: &mut Ui,
    idx: usize,
    look: &mut Look,
    state: &mut LooksState,
    view: &LooksView,
    actions: &mut Vec<Action>,
) -> f32 {
    let size = PICTURE + vec2(0.0, NAME_HEIGHT);
    let (rect, response) = ui.allocate_exact_size(size, Sense::click_and_drag());
    let snapshot = &look.snapshots[idx];
    let (name, mark) = (snapshot.name.clone(), look.mark(snapshot));
    let picture = Rect::from_min_size(rect.min, PICTURE);
    response.widget_info(|| {
        egui::WidgetInfo::selected(egui::Role::Button, ui.is_enabled(), mark != Mark::Off, format!("Look {name}"))
    });
    paint(ui, &response, picture, (view.thumbnail)(&name), mark);
    let name_rect = Rect::from_min_max(pos2(rect.left(), picture.bottom() + 2.0), rect.max);
    if state.renaming.as_ref().is_some_and(|(renamed, _)| *renamed == idx) {
        rename_ui(ui, name_rect, look, state);
    } else {
        let words = format!("{}{}", in_row(&name), if mark == Mark::Changed { " •" } else { "" });
        let color = if mark == Mark::Off { ui.visuals().text_color() } else { theme::accent_text(ui) };
        let painter = ui.painter().with_clip_rect(name_rect.intersect(ui.clip_rect()));
        painter.text(name_rect.left_center(), Align2::LEFT_CENTER, words, FontId::proportional(12.5), color);
    }
    if response.drag_started_by(PointerButton::Primary) {
        state.dragged = Some(name.clone());
    }
    // One that was just kept may lie beyond the edge.
    if state.has_more && mark == Mark::On {
        response.scroll_to_me(None);
    }
    // The name is there to be renamed and dragged: a double-click on it must not relight the scene.
    let is_on_name = response.interact_pointer_pos().is_some_and(|pointer| name_rect.contains(pointer));
    let is_taken = response.clicked() && !is_on_name;
    if is_taken || (response.has_focus() && ui.input(|input| input.key_pressed(Key::Enter))) {
        actions.push(Action::TakeLook(idx));
    }
    if response.double_clicked() && is_on_name {
        state.renaming = Some((idx, name.clone()));
    }
    let hint = match mark {
        Mark::Off => "Click the picture to light the scene like this",
        Mark::On => "This look is on",
        Mark::Changed => "This look was on, and was changed since; click the picture to go back to it",
    };
    let keys = if idx < WITH_KEY { format!("\n{}", ui.ctx().format_shortcut(&take_keys(idx))) } else { String::new() };
    let response = response.on_hover_text(format!(
        "{name}\n{hint}{keys}\nDouble-click the name to rename, drag to reorder, right-click or menu key for more"
    ));
    context_menu(&response, |ui| menu(ui, idx, look, state, mark));
    rect.center().x
}

/// The keys that take over a look by its number, from 0 to 8.
pub fn take_keys(idx: usize) -> egui::KeyboardShortcut {
    const DIGITS: [Key; WITH_KEY] =
        [Key::Num1, Key::Num2, Key::Num3, Key::Num4, Key::Num5, Key::Num6, Key::Num7, Key::Num8, Key::Num9];
    egui::KeyboardShortcut::new(egui::Modifiers::COMMAND, DIGITS[idx.min(WITH_KEY - 1)])
}

fn paint(ui: &Ui, response: &Response, picture: Rect, thumbnail: Option<(egui::TextureId, egui::Vec2)>, mark: Mark) {
    let painter = ui.painter();
    let corner = CornerRadius::same(3);
    painter.rect_filled(picture, corner, theme::SURROUND);
    match thumbnail {
        Some((texture, size)) => {
            // Whole, with the surround beside it.
            let scale = (picture.width() / size.x).min(picture.height() / size.y);
            let shown = Rect::from_center_size(picture.center(), size * scale);
            painter.image(texture, shown, Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0)), Color32::WHITE);
        }
        None => {
            let font = FontId::proportional(11.5);
            painter.text(picture.center(), Align2::CENTER_CENTER, "…", font, Color32::from_gray(150));
        }
    }
    let stroke = match mark {
        Mark::On | Mark::Changed => Stroke::new(2.0, theme::ACCENT),
        Mark::Off if response.hovered() || response.has_focus() => Stroke::new(1.5, Color32::from_gray(150)),
        Mark::Off => Stroke::new(1.0, Color32::from_gray(62)),
    };
    // The strip ends where its first card begins.
    painter.rect_stroke(picture, corner, stroke, StrokeKind::Inside);
    if response.has_focus() {
        painter.rect_stroke(picture.shrink(2.0), corner, ui.visuals().selection.stroke, StrokeKind::Inside);
    }
}

fn rename_ui(ui: &mut Ui, rect: Rect, look: &mut Look, state: &mut LooksState) {
    let Some((idx, typed)) = &mut state.renaming else { return };
    let edit = TextEdit::singleline(typed).margin(egui::Margin::symmetric(4, 1)).desired_width(rect.width());
    let field = ui.put(rect, edit).accessible_name("Name of the look");
    if ui.input(|input| input.key_pressed(Key::Escape)) {
        (state.renaming, state.problem) = (None, None);
    } else if field.lost_focus() {
        let (idx, typed) = (*idx, typed.clone());
        state.problem = rename(look, state, idx, &typed).err().map(|error| error.to_string());
        if state.problem.is_none() || !ui.input(|input| input.key_pressed(Key::Enter)) {
            (state.renaming, state.problem) = (None, None);
        }
    } else if !field.has_focus() {
        field.request_focus();
    }
}

/// Gives a snapshot another name, and whatever of the strip is about it.
fn rename(look: &mut Look, state: &mut LooksState, idx: usize, name: &str) -> Result<()> {
    let old = look.snapshots.get(idx).map(|snapshot| snapshot.name.clone()).unwrap_or_default();
    look.rename(idx, name)?;
    if let Some(snapshot) = look.snapshots.get(idx) {
        state.follow_name(&old, &snapshot.name);
    }
    Ok(())
}

fn menu(ui: &mut Ui, idx: usize, look: &mut Look, state: &mut LooksState, mark: Mark) {
    let name = look.snapshots[idx].name.clone();
    let hint = "Keep the lights and the display as they are now in this look";
    let update = ui.add_enabled(mark != Mark::On, egui::Button::new("Update")).on_hover_text(hint);
    if update.on_disabled_hover_text("Nothing was changed since").clicked() {
        look.update(idx);
        ui.close();
    }
    if ui.button("Rename").clicked() {
        state.renaming = Some((idx, name));
        ui.close();
    }
    let duplicate = ui.add_enabled(look.has_room(1), egui::Button::new("Duplicate"));
    if duplicate.on_disabled_hover_text(FULL).clicked() {
        look.duplicate(idx);
        ui.close();
    }
    let hint = "See this look beside the lights as they are now, with a divider or side by side";
    if ui.button("Compare with now").on_hover_text(hint).clicked() {
        state.compare = Some(Compare::with_now(&look.snapshots[idx].name, state.compare.as_ref()));
        ui.close();
    }
    ui.separator();
    let last = look.snapshots.len() - 1;
    let left = ui.add_enabled(idx > 0, egui::Button::new("Move left"));
    if left.on_disabled_hover_text("It is the first one").clicked() {
        look.reorder(idx, idx - 1);
        ui.close();
    }
    let right = ui.add_enabled(idx < last, egui::Button::new("Move right"));
    if right.on_disabled_hover_text("It is the last one").clicked() {
        look.reorder(idx, idx + 1);
        ui.close();
    }
    ui.separator();
    if ui.button("Delete").clicked() {
        let n_keys = look.timeline.keys.len();
        look.delete(idx);
        // Keys of the timeline go along; which one stands where is another matter then.
        if look.timeline.keys.len() != n_keys {
            state.player.let_go();
        }
        ui.close();
    }
}
