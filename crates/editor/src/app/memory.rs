//! Memory of the program: what the status bar tells of it, and that what was freed goes back to the system.

use std::time::Duration;

use eframe::egui::Context;

use super::App;
use crate::platform::{resident_bytes, trim_freed_memory};

/// Time between two questions, seconds.
const EVERY_SECS: f64 = 2.0;
/// Growth from which on what was freed is worth looking for: a twentieth, and this many bytes.
const GROWTH_BYTES: u64 = 8 << 20;

/// Memory in use.
pub(super) struct MemoryWatch {
    bytes: Option<u64>,
    /// When it was asked for, seconds.
    asked_at: f64,
    /// The least since freed memory was given back; `None` right after that.
    least: Option<u64>,
    /// Whether the window was asked to come back, since it drew too soon after the last question.
    comes_back: bool,
}

impl MemoryWatch {
    pub(super) fn new() -> Self {
        Self { bytes: None, asked_at: f64::MIN, least: None, comes_back: false }
    }

    /// What the last question was answered, bytes.
    pub(super) fn bytes(&self) -> Option<u64> {
        self.bytes
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
        if self.memory.has_grown(resident_bytes()) && !self.session.bake.is_running() {
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
}
