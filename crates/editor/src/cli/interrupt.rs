//! Ctrl-C, termination and the end of the terminal: the first asks a long command to end in good order. A second Ctrl-C or termination
//! ends it at once; the end of a terminal never does, since shell and kernel both tell of it.
//!
//! Until a command begins its long work, and in commands that write nothing, a signal ends the process as ever: there is nothing
//! to keep and nothing to take away.

use std::fmt;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use anyhow::{Context, Result};
use clerestory_transport::archive::beside::discard;
use indicatif::ProgressBar;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

use super::console::Console;

/// How often a signal is looked for.
const POLL: Duration = Duration::from_millis(20);
/// How long a command may take to end by itself, so that it ends at once for a person; a block under way can take longer, and is
/// lost either way.
const GRACE: Duration = Duration::from_millis(120);
/// Exit code of a process that a signal ended, less the signal, as shells count.
const SIGNAL_BASE: u8 = 128;

/// What may ask a command to end.
#[derive(Clone, Debug)]
pub struct Interrupt {
    listens: bool,
    /// The signal that came, 0 for none.
    signal: Arc<AtomicUsize>,
    /// Set by the first Ctrl-C or termination: the next one ends the process.
    again: Arc<AtomicBool>,
}

/// A command that a signal ended.
#[derive(Debug)]
pub(super) struct Stopped {
    signal: usize,
    kept: String,
}

impl fmt::Display for Stopped {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "stopped: {}", self.kept)
    }
}

impl std::error::Error for Stopped {}

impl Stopped {
    /// 130 after Ctrl-C, 143 after a termination, 129 after the end of the terminal.
    pub fn exit_code(&self) -> u8 {
        SIGNAL_BASE.saturating_add(u8::try_from(self.signal).unwrap_or(0))
    }
}

/// The signal that the terminal has gone, where it is known that who started the program did not have it ignored.
fn hangup() -> Option<i32> {
    #[cfg(unix)]
    {
        use crate::platform::ignores_hangups;
        (ignores_hangups() == Some(false)).then_some(signal_hook::consts::SIGHUP)
    }
    #[cfg(not(unix))]
    None
}

/// What commands leave behind that write only at their end.
pub(crate) fn nothing_kept() -> String {
    "nothing was written".into()
}

/// The same, with what was begun of a file taken away that will not come to be.
pub(super) fn discarded(output: &Path) -> String {
    discard(output);
    nothing_kept()
}

/// Does the work of a command that writes its file, if any, at the end: a signal ends it, and nothing of the file stays.
pub(super) fn writing<T>(
    output: Option<&Path>,
    console: &mut Console,
    work: impl FnOnce(&mut Console) -> Result<T>,
) -> Result<T> {
    let interrupt = console.interrupt.heeded()?;
    let kept = || output.map_or_else(nothing_kept, discarded);
    interrupt.watched(&ProgressBar::hidden(), &kept, || work(console))
}

impl Interrupt {
    /// Nobody interrupts: for a command that runs inside of another program.
    pub fn never() -> Interrupt {
        Interrupt { listens: false, signal: Arc::default(), again: Arc::default() }
    }

    /// The signals of this process, once a command heeds them.
    pub fn of_process() -> Interrupt {
        Interrupt { listens: true, ..Interrupt::never() }
    }

    /// From here on the first signal is kept for [`Interrupt::came`], and a second Ctrl-C or termination ends the process.
    pub(crate) fn heeded(&mut self) -> Result<Interrupt> {
        if std::mem::take(&mut self.listens) {
            let problem = "cannot listen to Ctrl-C";
            let kept = |signal: i32| flag::register_usize(signal, self.signal.clone(), signal.unsigned_abs() as usize);
            for signal in [SIGINT, SIGTERM] {
                let code = i32::from(SIGNAL_BASE) + signal;
                // In this order: a signal finds what the one before it has set.
                flag::register_conditional_shutdown(signal, code, self.again.clone())
                    .and_then(|_| flag::register(signal, self.again.clone()))
                    .and_then(|_| kept(signal))
                    .context(problem)?;
            }
            if let Some(signal) = hangup() {
                kept(signal).context(problem)?;
            }
        }
        Ok(self.clone())
    }

    /// Whether the command shall end.
    pub(crate) fn came(&self) -> bool {
        self.signal.load(Ordering::Relaxed) != 0
    }

    /// The end of a command that heeded it.
    pub(crate) fn stopped(&self, kept: String) -> anyhow::Error {
        Stopped { signal: self.signal.load(Ordering::Relaxed), kept }.into()
    }

    /// Does long work; ends the process if the work does not end soon after a signal.
    pub(super) fn watched<T>(
        &self,
        bar: &ProgressBar,
        kept: &(dyn Fn() -> String + Sync),
        work: impl FnOnce() -> T,
    ) -> T {
        let (working, ended) = channel::<()>();
        std::thread::scope(|scope| {
            scope.spawn(move || {
                while ended.recv_timeout(POLL) == Err(RecvTimeoutError::Timeout) {
                    if self.came() && ended.recv_timeout(GRACE) == Err(RecvTimeoutError::Timeout) {
                        bar.finish_and_clear();
                        let stopped = Stopped { signal: self.signal.load(Ordering::Relaxed), kept: kept() };
                        let _ = writeln!(std::io::stderr(), "{stopped}");
                        std::process::exit(stopped.exit_code().into());
                    }
                }
            });
            let result = work();
            // Dropped by a panic too, so that the watch always ends.
            drop(working);
            result
        })
    }
}

#[cfg(test)]
mod tests {
    use clerestory_transport::archive::beside::temporary;

    use super::*;

    #[test]
    fn of_a_file_that_will_not_come_to_be_nothing_stays() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let (begun, _file) = temporary(&path).unwrap();
        assert_eq!(discarded(&path), nothing_kept());
        assert!(!begun.exists());
    }

    #[test]
    fn work_that_nobody_interrupts_ends_by_itself() {
        let mut interrupt = Interrupt::never();
        let heeded = interrupt.heeded().unwrap();
        assert_eq!(heeded.watched(&ProgressBar::hidden(), &nothing_kept, || 7), 7);
        assert!(!heeded.came());
    }

    #[test]
    fn exit_codes_are_those_that_shells_expect() {
        let interrupt = Interrupt::never();
        for (signal, code) in [(SIGINT, 130), (SIGTERM, 143)] {
            interrupt.signal.store(signal as usize, Ordering::Relaxed);
            let error = interrupt.stopped("nothing".into()).context("cannot bake");
            assert_eq!(error.downcast_ref::<Stopped>().map(Stopped::exit_code), Some(code));
        }
    }
}
