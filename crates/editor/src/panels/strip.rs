//! A line over the picture that tells something and offers what can be done about it.

use eframe::egui::{self, Button, Panel, RichText, Ui};

use crate::theme;

/// Draws it above what follows; answers which of the buttons was clicked. The first one is what most people will want.
pub fn strip_ui(ui: &mut Ui, id: &'static str, words: &str, buttons: &[&str]) -> Option<usize> {
    let frame = egui::Frame::side_top_panel(ui.style()).inner_margin(egui::Margin::symmetric(14, 6));
    let strip = Panel::top(id).frame(frame).show_separator_line(false).show(ui, |ui| {
        ui.horizontal_wrapped(|ui| {
            ui.label(RichText::new(words).color(theme::accent_text(ui)));
            let clicked = |(nth, name): (usize, &&str)| {
                let button = if nth == 0 {
                    Button::new(RichText::new(*name).color(theme::ON_ACCENT)).fill(theme::ACCENT)
                } else {
                    Button::new(*name)
                };
                ui.add(button).clicked().then_some(nth)
            };
            buttons.iter().enumerate().filter_map(clicked).last()
        })
        .inner
    });
    strip.inner
}
