//! Memory of the program: what the status bar tells of it, and that what was freed goes back to the system.

use eframe::egui::Context;

use super::App;
use crate::platform::{resident_bytes, trim_freed_memory};

/// Time between two questions, seconds.
const EVERY_SECS: f64 = 2.0;
/// Growth from which on what was freed is worth looking for: a tenth, and this many bytes.
const GROWTH_BYTES: u64 = 16 << 20;

/// Memory in use.
pub(super) struct MemoryWatch {
    bytes: Option<u64>,
    /// When it was asked for, seconds.
    asked_at: f64,
    /// The least since freed memory was given back; `None` right after that.
    least: Option<u64>,
}

impl MemoryWatch {
    pub(super) fn new() -> Self {
        Self { bytes: None, asked_at: f64::MIN, least: None }
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
        bytes > least + least / 10 + GROWTH_BYTES
    }
}

impl App {
    /// Asks the system now and then, while something is drawn anyway. A bake takes and frees memory all the time, so what it
    /// leaves is given back at its end.
    pub(super) fn ask_memory(&mut self, ctx: &Context) {
        let now = ctx.input(|input| input.time);
        if now - self.memory.asked_at <= EVERY_SECS {
            return;
        }
        self.memory.asked_at = now;
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
        assert_eq!([300, 320, 200, 230, 240].map(&mut grew), [false, false, false, false, true]);
        watch.least = None;
        assert!(!watch.has_grown(Some(500 << 20)) && !watch.has_grown(None));
        assert_eq!((watch.bytes(), watch.least), (None, Some(500 << 20)));
    }
}
