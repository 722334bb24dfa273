//! Fields that are typed into: what a key asks for, and the end of the window, wait until they have taken their text.

use eframe::egui::{Context, ViewportCommand};

use super::App;
use crate::action::{Action, all_dropped};
use crate::panels::number::letters_come;
use crate::panels::shortcuts::take_keys;

/// What waits.
#[derive(Default)]
pub(super) struct Typing {
    asked: Vec<Action>,
    /// Whether the window is to be closed.
    is_closing: bool,
}

impl App {
    /// What keys and dropped files ask for, once there is no text that it could be about.
    pub(super) fn asked(&mut self, ctx: &Context) -> Vec<Action> {
        let files = ctx.input(|input| input.raw.dropped_files.clone());
        let waits = self.waits_for_an_answer() || self.shortcuts;
        let asked = &mut self.typing.asked;
        match &mut self.question {
            Some(question) => files.iter().for_each(|file| question.fill_in(file.path())),
            None => asked.extend(all_dropped(files.iter().map(|file| file.path().to_path_buf()))),
        }
        take_keys(ctx, waits, asked);
        let needs_text = asked.iter().any(|action| *action != Action::ToggleShortcuts);
        if needs_text && ends_typing(ctx) { Vec::new() } else { std::mem::take(asked) }
    }

    /// Whether the window waits with its end for a text; it asks to be closed again after that.
    pub(super) fn closes_later(&mut self, ctx: &Context) -> bool {
        if std::mem::take(&mut self.typing.is_closing) {
            ctx.send_viewport_cmd(ViewportCommand::Close);
        }
        let is_asked = ctx.input(|input| input.viewport().close_requested());
        self.typing.is_closing = is_asked && ends_typing(ctx);
        if self.typing.is_closing {
            ctx.send_viewport_cmd(ViewportCommand::CancelClose);
        }
        self.typing.is_closing
    }
}

/// Whether a field is typed into; it takes its text while this frame is drawn, or the next one where letters still come.
fn ends_typing(ctx: &Context) -> bool {
    let Some(field) = ctx.memory(|memory| memory.focused()).filter(|_| ctx.text_edit_focused()) else { return false };
    if !letters_come(ctx) {
        ctx.memory_mut(|memory| memory.surrender_focus(field));
    }
    ctx.request_repaint();
    true
}
