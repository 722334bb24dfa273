//! Memory of the program: what the status bar tells of it, and that what was freed goes back to the system.

use std::time::Duration;

use eframe::egui::Context;

use super::App;
use crate::platform::{resident_bytes, trim_freed_memory};

/// Time between two questions, seconds.
const EVERY_SECS: f64 = 2.0;
/// Growth from which on what was freed is worth looking for: a twentieth, and this many bytes.
const GROWTH_BYTES: u64 = 8 << 20;

/// How often freed memory is given back after something was replaced.
const TIMES_OWED: u8 = 3;

/// Memory in use.
pub(super) struct MemoryWatch {
    bytes: Option<u64>,
    /// When it was asked for, seconds.
    asked_at: f64,
    /// The least since freed memory was given back; `None` right after that.
    least: Option<u64>,
    /// Whether the window was asked to come back, since it drew too soon after the last question.
    comes_back: bool,
    /// What was open when it was asked for last.
    open: Open,
    /// How many times freed memory is still to be given back: what was replaced is let go of by several threads, one after another.
    n_owed: u8,
}

/// What is open, as far as memory goes: pictures that became whole so far, number of views, and whether a bake runs.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
struct Open(u64, usize, bool);

impl MemoryWatch {
    pub(super) fn new() -> Self {
        Self { bytes: None, asked_at: f64::MIN, least: None, comes_back: false, open: Open::default(), n_owed: 0 }
    }

    /// What the last question was answered, bytes.
    pub(super) fn bytes(&self) -> Option<u64> {
        self.bytes
    }

    /// Something else is open now. What was before may have left freed memory behind, whatever else has taken some since.
    fn has_opened(&mut self, open: Open) {
        if std::mem::replace(&mut self.open, open) != open {
            self.n_owed = TIMES_OWED;
        }
    }

    /// Takes an answer. Whether so much came since that freed memory may be among it.
    fn has_grown(&mut self, bytes: Option<u64>) -> bool {
        self.bytes = bytes;
        let Some(bytes) = bytes else { return false };
        let least = self.least.map_or(bytes, |least| least.min(bytes));
        self.least = Some(least);
        bytes > least + least / 20 + GROWTH_BYTES
    }
}

impl App {
    /// Asks the system now and then, while something is drawn anyway, and once more when all has come to rest. A bake takes and frees memory all the time, so what it
    /// leaves is given back at its end.
    pub(super) fn ask_memory(&mut self, ctx: &Context) {
        let now = ctx.input(|input| input.time);
        let since = now - self.memory.asked_at;
        if since <= EVERY_SECS {
            if !std::mem::replace(&mut self.memory.comes_back, true) {
                ctx.request_repaint_after(Duration::from_secs_f64(EVERY_SECS - since.max(0.0) + 0.1));
            }
            return;
        }
        (self.memory.asked_at, self.memory.comes_back) = (now, false);
        let is_running = self.session.bake.is_running();
        self.memory.has_opened(Open(self.session.n_whole, self.session.views().len(), is_running));
        let has_grown = self.memory.has_grown(resident_bytes());
        if (has_grown || self.memory.n_owed > 0) && !is_running {
            self.memory.n_owed = self.memory.n_owed.saturating_sub(1);
            if self.memory.n_owed > 0 {
                ctx.request_repaint_after(Duration::from_secs_f64(EVERY_SECS + 0.1));
            }
            self.memory.least = None;
            // It takes some milliseconds. Without a thread it is tried again when there is more.
            _ = std::thread::Builder::new().name("trim".into()).spawn(trim_freed_memory);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn growth_is_told_from_the_least_since_the_last_time() {
        let mut watch = MemoryWatch::new();
        let mut grew = |megabytes: u64| watch.has_grown(Some(megabytes << 20));
        assert_eq!([300, 310, 200, 215, 225].map(&mut grew), [false, false, false, false, true]);
        watch.least = None;
        assert!(!watch.has_grown(Some(500 << 20)) && !watch.has_grown(None));
        assert_eq!((watch.bytes(), watch.least), (None, Some(500 << 20)));
    }

    #[test]
    fn what_was_replaced_is_given_back_whatever_came_since() {
        let mut watch = MemoryWatch::new();
        watch.has_opened(Open::default());
        assert_eq!(watch.n_owed, 0);
        watch.has_opened(Open(1, 1, false));
        assert_eq!(watch.n_owed, TIMES_OWED);
        watch.n_owed = 0;
        watch.has_opened(Open(1, 1, false));
        assert_eq!(watch.n_owed, 0);
    }
}
