//! How long the window keeps people waiting. With `CLERESTORY_PULSE=FILE` every frame is timed, for soaks of the window as it is:
//! `tests/soak-window` reads the file.

use std::fs::File;
use std::io::Write;
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};

use crate::platform::{self, ThreadTimes};

/// Names the file that frames are told to; it is written anew.
pub const VARIABLE: &str = "CLERESTORY_PULSE";
/// What a person takes for a stall.
const STALL: Duration = Duration::from_millis(100);
/// How often frames are counted up.
const COUNTED_EVERY: Duration = Duration::from_secs(10);

/// Times frames from the first line of the program to its last, without what the graphics driver does with them.
pub struct Pulse {
    file: File,
    began: Instant,
    counted: Instant,
    n_frames: u64,
    n_stalls: u64,
    slowest: Duration,
    frame: Option<Frame>,
}

/// A frame that has begun.
struct Frame {
    at: Instant,
    /// What the thread had done until then.
    times: Option<ThreadTimes>,
}

impl Pulse {
    /// The file that the environment names, if it names one.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn of_environment() -> Result<Option<Pulse>> {
        std::env::var_os(VARIABLE).map(|path| Pulse::new(Path::new(&path))).transpose()
    }

    fn new(path: &Path) -> Result<Pulse> {
        let file = File::create(path)
            .with_context(|| format!("cannot write {}, which {VARIABLE} asks for", path.display()))?;
        let (now, slowest) = (Instant::now(), Duration::ZERO);
        Ok(Pulse { file, began: now, counted: now, n_frames: 0, n_stalls: 0, slowest, frame: None })
    }

    /// A frame begins.
    pub fn begin(&mut self) {
        self.frame = Some(Frame { at: Instant::now(), times: platform::thread_times() });
    }

    /// It ends.
    pub fn end(&mut self) {
        let Some(frame) = self.frame.take() else { return };
        let lasted = frame.at.elapsed();
        let times = frame.times.zip(platform::thread_times());
        self.count(lasted, times.map(|(a, b)| ThreadTimes { ran: b.ran - a.ran, waited: b.waited - a.waited }));
    }

    /// Counts a frame; a machine with other work than ours makes it wait for a core, which is told apart. What is neither that nor
    /// work of its own is a wait for another thread or for the system.
    fn count(&mut self, lasted: Duration, times: Option<ThreadTimes>) {
        let own = lasted.saturating_sub(times.map(|times| times.waited).unwrap_or_default());
        self.n_frames += 1;
        self.slowest = self.slowest.max(own);
        let secs = self.began.elapsed().as_secs_f32();
        if own > STALL {
            self.n_stalls += 1;
            let ran = times.map(|times| format!(", at work for {} ms", times.ran.as_millis())).unwrap_or_default();
            self.say(&format!("{secs:.1} s: stall of {} ms in {} ms{ran}", own.as_millis(), lasted.as_millis()));
        }
        if self.counted.elapsed() >= COUNTED_EVERY {
            let megabytes = platform::resident_bytes().unwrap_or_default() >> 20;
            let (n_frames, n_stalls, slowest) = (self.n_frames, self.n_stalls, self.slowest.as_millis());
            self.say(&format!(
                "{secs:.0} s: {n_frames} frames, {n_stalls} stalls, slowest {slowest} ms, {megabytes} MB"
            ));
            self.counted = Instant::now();
        }
    }

    /// Tells something that happened.
    pub fn say_now(&mut self, what: &str) {
        let secs = self.began.elapsed().as_secs_f32();
        // The frame in which it happened never ends.
        self.frame = None;
        self.say(&format!("{secs:.1} s: {what}"));
    }

    fn say(&mut self, line: &str) {
        // Somebody who asks for a log and takes its disk away does without.
        let _ = writeln!(self.file, "{line}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stall_is_told_and_waiting_for_a_core_is_none() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("pulse");
        let mut pulse = Pulse::new(&path).unwrap();
        let ms = Duration::from_millis;
        for (lasted, times) in [(16, None), (140, Some((80, 60))), (140, Some((50, 20))), (101, None)] {
            pulse.count(ms(lasted), times.map(|(ran, waited)| ThreadTimes { ran: ms(ran), waited: ms(waited) }));
        }
        pulse.counted -= COUNTED_EVERY;
        pulse.begin();
        pulse.end();
        let lines = std::fs::read_to_string(&path).unwrap();
        let [first, second, third] = lines.lines().collect::<Vec<_>>()[..] else { panic!("{lines}") };
        assert!(
            first.ends_with("stall of 120 ms in 140 ms, at work for 50 ms")
                && second.ends_with("stall of 101 ms in 101 ms"),
            "{lines}"
        );
        assert!(third.contains(": 5 frames, 2 stalls, slowest 120 ms, "), "{lines}");
    }
}
