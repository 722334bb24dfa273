//! What the window has to say: a stack of notifications over the picture, the newest on top, and a list of the last ones.
//!
//! What went wrong stays until somebody closes it; the rest fades. The stack lies over the picture, so that no panel moves when
//! something is said, and it stays as it is while a button of the pointer is down: nobody loses the slider that they hold.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use eframe::egui::{self, Align2, Area, Button, Context, Id, Label, Order, Rect, RichText, ScrollArea, Ui, vec2};

use super::dialogs::ago;

/// How a message is meant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MessageTone {
    /// For information.
    Calm,
    /// Something has begun: what comes of it takes its place.
    Begun,
    /// Something went wrong.
    Problem,
}

/// How long what went wrong holds, where nobody closes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Holds {
    /// As long as the window.
    Always,
    /// Until another scene is opened.
    InScene,
    /// Until the scene is read again, or another one is opened.
    UntilRead,
}

/// Something that was said.
struct Message {
    number: u64,
    words: String,
    tone: MessageTone,
    holds: Holds,
    said_at: Instant,
    /// When it was first seen, seconds of the window; none before that.
    seen_at: Option<f64>,
    /// Whether it is on the stack.
    is_open: bool,
}

/// What was said, the newest first.
#[derive(Default)]
pub struct Messages {
    kept: VecDeque<Message>,
    /// Numbers of those on the stack as it is drawn.
    drawn: Vec<u64>,
    n_said: u64,
    /// Whether the pointer was on the stack in the frame before.
    is_hovered: bool,
}

/// Messages that the list keeps, and those that the stack shows at once.
const MOST_KEPT: usize = 50;
const MOST_DRAWN: usize = 4;
/// Seconds for which a calm message is seen, of which it fades the last.
const CALM_SECS: f64 = 6.0;
const FADE_SECS: f64 = 0.4;
/// What is said again this soon was never meant to be said twice: a fault of every frame does not come back once it was closed.
const SAME: Duration = Duration::from_secs(1);
/// Width of the stack, and height of a message on it and of the list, points, at most.
const WIDTH: f32 = 420.0;
const HEIGHT: f32 = 120.0;
const LIST_HEIGHT: f32 = 320.0;
/// Points to the edges of the picture, and for the button that closes a message.
const GAP: f32 = 12.0;
const CLOSE: f32 = 28.0;

impl Messages {
    /// Says something.
    pub fn push(&mut self, words: String, tone: MessageTone) {
        let now = Instant::now();
        if let Some(last) = self.kept.front_mut().filter(|last| last.words == words && last.tone == tone) {
            if tone != MessageTone::Problem || now.duration_since(last.said_at) > SAME {
                (last.is_open, last.seen_at) = (true, None);
            }
            last.said_at = now;
            return;
        }
        self.n_said += 1;
        let number = self.n_said;
        let holds = Holds::Always;
        self.kept.push_front(Message { number, words, tone, holds, said_at: now, seen_at: None, is_open: true });
        if self.kept.len() > MOST_KEPT {
            // What went wrong stays until somebody closes it.
            let may_go = |message: &Message| !message.is_open || message.tone != MessageTone::Problem;
            let oldest = self.kept.iter().skip(1).rposition(may_go).map_or(MOST_KEPT, |nth| nth + 1);
            self.kept.remove(oldest);
        }
    }

    /// Says what went wrong with the scene that is open, or with what is for it.
    pub fn push_of_scene(&mut self, words: String, holds: Holds) {
        self.push(words, MessageTone::Problem);
        if let Some(message) = self.kept.front_mut() {
            message.holds = holds;
        }
    }

    /// The open scene was read again: what was said of it as it was goes from the stack, and stays in the list.
    pub fn scene_read(&mut self) {
        let of_before = self.kept.iter_mut().filter(|message| message.holds == Holds::UntilRead);
        of_before.for_each(|message| message.is_open = false);
    }

    /// Another scene was opened: what was said of the one before goes from the stack, and stays in the list.
    pub fn scene_left(&mut self) {
        let of_before = self.kept.iter_mut().filter(|message| message.holds != Holds::Always);
        of_before.for_each(|message| message.is_open = false);
    }

    /// What has begun is over: it goes from the stack, and stays in the list.
    pub fn end_begun(&mut self) {
        let begun = self.kept.iter_mut().filter(|message| message.tone == MessageTone::Begun);
        begun.for_each(|message| message.is_open = false);
    }

    /// What was said for information does not hold any more: it goes from the stack, and stays in the list.
    pub fn take_back(&mut self) {
        let calm = self.kept.iter_mut().filter(|message| message.tone != MessageTone::Problem);
        calm.for_each(|message| message.is_open = false);
    }

    /// Brings the stack up to date; before anything is drawn.
    pub fn follow(&mut self, ctx: &Context) {
        let (now, is_held) = ctx.input(|input| (input.time, input.pointer.any_down()));
        if !is_held {
            self.settle(ctx, now);
        }
    }

    /// Draws the stack into the lower left corner of the picture.
    pub fn stack_ui(&mut self, ctx: &Context, picture: Rect) {
        let now = ctx.input(|input| input.time);
        if self.drawn.is_empty() {
            self.is_hovered = false;
            return;
        }
        let width = WIDTH.min(picture.width() - 2.0 * GAP).max(80.0);
        let area = Area::new(Id::unique("messages")).order(Order::Middle).constrain_to(picture);
        let area = area.pivot(Align2::LEFT_BOTTOM).fixed_pos(picture.left_bottom() + vec2(GAP, -GAP));
        let drawn = self.drawn.clone();
        let stack = area.show(ctx, |ui| {
            ui.set_width(width);
            for message in self.kept.iter_mut().filter(|message| message.is_open && drawn.contains(&message.number)) {
                message.ui(ui, width, now);
            }
            let n_more = self.kept.iter().filter(|message| message.is_open).count().saturating_sub(MOST_DRAWN);
            if n_more > 0 {
                let words = format!("{n_more} more under Messages");
                egui::Frame::popup(ui.style()).show(ui, |ui| ui.label(RichText::new(words).weak()));
            }
        });
        self.drawn.retain(|number| self.kept.iter().any(|message| message.number == *number && message.is_open));
        self.is_hovered = stack.response.contains_pointer();
    }

    /// Takes what was said since onto the stack, and from it what has faded.
    fn settle(&mut self, ctx: &Context, now: f64) {
        let mut next: Option<f64> = None;
        for message in self.kept.iter_mut().filter(|message| message.is_open) {
            let seen_at = *message.seen_at.get_or_insert(now);
            if message.tone == MessageTone::Problem {
                continue;
            }
            // Whoever points at the stack is reading.
            if self.is_hovered {
                message.seen_at = Some(now);
            }
            let left = CALM_SECS - (now - seen_at);
            message.is_open = left > 0.0 || self.is_hovered;
            if message.is_open {
                next = Some(next.map_or(left, |next| next.min(left)));
            }
        }
        let open = self.kept.iter().filter(|message| message.is_open);
        self.drawn = open.map(|message| message.number).take(MOST_DRAWN).collect();
        match next {
            Some(left) if left > FADE_SECS => ctx.request_repaint_after(Duration::from_secs_f64(left - FADE_SECS)),
            Some(_) => ctx.request_repaint(),
            None => {}
        }
    }

    /// What was said last, and a button with the list of what was said before.
    pub fn bar_ui(&self, ui: &mut Ui) {
        let has_problem = self.kept.iter().any(|message| message.is_open && message.tone == MessageTone::Problem);
        let name = RichText::new("Messages");
        let name = if has_problem { name.color(ui.visuals().error_fg_color) } else { name };
        // Entries of menus are stretched to its width, which would tear the words apart.
        let left = egui::Layout::top_down(egui::Align::Min);
        ui.menu_button(name, |ui| ui.with_layout(left, |ui| self.list_ui(ui)))
            .response
            .on_hover_text("What was said lately");
        let Some(last) = self.kept.front() else { return };
        let text = last.text(ui);
        if self.drawn.contains(&last.number) {
            // The stack tells it to screen readers, once.
            let galley = egui::WidgetText::from(text).into_galley(
                ui,
                Some(egui::TextWrapMode::Truncate),
                ui.available_width(),
                egui::TextStyle::Body,
            );
            let (place, _) = ui.allocate_exact_size(galley.size(), egui::Sense::hover());
            ui.painter().galley(place.min, galley, ui.visuals().text_color());
        } else {
            ui.add(Label::new(text).truncate()).on_hover_text(&last.words);
        }
    }

    fn list_ui(&self, ui: &mut Ui) {
        ui.set_width(WIDTH);
        if self.kept.is_empty() {
            ui.label(RichText::new("Nothing was said yet").weak());
        }
        ScrollArea::vertical().max_height(LIST_HEIGHT).show(ui, |ui| {
            for message in &self.kept {
                ui.label(RichText::new(ago(message.said_at.elapsed())).weak().small());
                ui.add(Label::new(message.text(ui)).wrap());
                ui.add_space(4.0);
            }
        });
    }
}

impl Message {
    fn text(&self, ui: &Ui) -> RichText {
        match self.tone {
            MessageTone::Calm | MessageTone::Begun => RichText::new(&self.words).weak(),
            MessageTone::Problem => RichText::new(&self.words).color(ui.visuals().error_fg_color),
        }
    }

    fn ui(&mut self, ui: &mut Ui, width: f32, now: f64) {
        let left = CALM_SECS - (now - self.seen_at.unwrap_or(now));
        let opacity = if self.tone == MessageTone::Problem { 1.0 } else { (left / FADE_SECS).clamp(0.0, 1.0) };
        egui::Frame::popup(ui.style()).show(ui, |ui| {
            ui.set_opacity(opacity as f32);
            ui.horizontal_top(|ui| {
                ui.vertical(|ui| {
                    ui.set_width(width - CLOSE - 2.0 * GAP);
                    let text = match self.tone {
                        MessageTone::Calm | MessageTone::Begun => RichText::new(&self.words),
                        MessageTone::Problem => self.text(ui),
                    };
                    ScrollArea::vertical().id_salt(self.number).max_height(HEIGHT).show(ui, |ui| {
                        ui.add(Label::new(text).wrap());
                    });
                });
                let close = ui.add(Button::new("×").small()).on_hover_text("Close this message");
                if close.accessible_name("Close message").clicked() {
                    self.is_open = false;
                }
            });
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(messages: &Messages) -> Vec<&str> {
        let open = messages.kept.iter().filter(|message| message.is_open);
        open.map(|message| message.words.as_str()).collect()
    }

    #[test]
    fn calm_words_fade_and_problems_stay() {
        let (mut messages, ctx) = (Messages::default(), Context::default());
        messages.push("saved".into(), MessageTone::Calm);
        messages.push("broken".into(), MessageTone::Problem);
        messages.settle(&ctx, 10.0);
        assert_eq!(words(&messages), ["broken", "saved"], "the newest is on top");
        messages.settle(&ctx, 10.0 + CALM_SECS - 0.1);
        assert_eq!(messages.drawn.len(), 2);
        messages.settle(&ctx, 10.0 + CALM_SECS + 0.1);
        assert_eq!(words(&messages), ["broken"]);
        messages.push("saved".into(), MessageTone::Calm);
        assert_eq!(words(&messages), ["saved", "broken"]);
        assert_eq!(messages.kept.len(), 3, "the list keeps what has faded");
    }

    #[test]
    fn what_has_begun_makes_way_for_its_end() {
        let mut messages = Messages::default();
        messages.push("writing".into(), MessageTone::Begun);
        messages.end_begun();
        messages.push("saved".into(), MessageTone::Calm);
        assert_eq!(words(&messages), ["saved"]);
        assert_eq!(messages.kept.len(), 2, "the list keeps both");
    }

    #[test]
    fn what_was_said_of_a_scene_goes_with_it() {
        let mut messages = Messages::default();
        messages.push("disk full".into(), MessageTone::Problem);
        messages.push_of_scene("odd look".into(), Holds::InScene);
        messages.push_of_scene("no lamp".into(), Holds::UntilRead);
        messages.scene_read();
        assert_eq!(words(&messages), ["odd look", "disk full"]);
        messages.push_of_scene("no panel".into(), Holds::UntilRead);
        messages.scene_left();
        assert_eq!(words(&messages), ["disk full"]);
        assert_eq!(messages.kept.len(), 4, "the list keeps them");
    }

    #[test]
    fn what_every_frame_says_stays_closed() {
        let mut messages = Messages::default();
        for _ in 0..3 {
            messages.push("no device".into(), MessageTone::Problem);
        }
        assert_eq!(messages.kept.len(), 1);
        messages.kept[0].is_open = false;
        messages.push("no device".into(), MessageTone::Problem);
        assert!(words(&messages).is_empty());
        messages.kept[0].said_at -= 2 * SAME;
        messages.push("no device".into(), MessageTone::Problem);
        assert_eq!(words(&messages), ["no device"], "a minute later it is news");
    }

    #[test]
    fn neither_stack_nor_list_grow_without_end() {
        let (mut messages, ctx) = (Messages::default(), Context::default());
        (0..200).for_each(|nth| messages.push(format!("{nth}"), MessageTone::Problem));
        messages.settle(&ctx, 0.0);
        assert_eq!((messages.kept.len(), messages.drawn.len()), (MOST_KEPT, MOST_DRAWN));
        assert_eq!(messages.kept[0].words, "199");
    }

    #[test]
    fn what_went_wrong_outlasts_any_number_of_calm_words() {
        let mut messages = Messages::default();
        messages.push("broken".into(), MessageTone::Problem);
        (0..200).for_each(|nth| messages.push(format!("{nth}"), MessageTone::Calm));
        assert_eq!((messages.kept.len(), messages.kept[0].words.as_str()), (MOST_KEPT, "199"));
        assert!(words(&messages).contains(&"broken"));
        messages.kept.iter_mut().for_each(|message| message.is_open = false);
        (200..300).for_each(|nth| messages.push(format!("{nth}"), MessageTone::Calm));
        assert!(messages.kept.iter().all(|message| message.words != "broken"));
    }
}
