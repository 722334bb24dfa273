//! Where words go: answers to stdout, warnings to stderr, progress to a terminal.

use std::collections::HashSet;
use std::io::{IsTerminal, Write};
use std::time::Instant;

use anyhow::Result;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::Value;

use super::interrupt::Interrupt;

/// What a command found out, for programs and for people.
#[derive(Clone, Debug)]
pub struct Answer {
    /// One JSON object.
    pub json: Value,
    /// Lines without the last line break.
    pub words: String,
}

/// Both output streams, and when the command began.
pub struct Console<'a> {
    /// Start of the command.
    pub started: Instant,
    stdout: &'a mut (dyn Write + Send),
    stderr: &'a mut (dyn Write + Send),
    progress: ProgressBar,
    /// What may ask long commands to end.
    pub(crate) interrupt: Interrupt,
    warnings: Vec<String>,
    /// The same, to look them up.
    said: HashSet<String>,
}

impl<'a> Console<'a> {
    /// A console without progress so far.
    pub fn new(
        started: Instant,
        stdout: &'a mut (dyn Write + Send),
        stderr: &'a mut (dyn Write + Send),
        interrupt: Interrupt,
    ) -> Self {
        let (progress, warnings, said) = (ProgressBar::hidden(), Vec::new(), HashSet::new());
        Console { started, stdout, stderr, progress, interrupt, warnings, said }
    }

    /// Prints the answer of the command.
    ///
    /// # Errors
    /// If stdout is closed or full.
    pub fn answer(&mut self, answer: &Answer, json: bool) -> Result<()> {
        if json {
            writeln!(self.stdout, "{}", answer.json)?;
        } else {
            writeln!(self.stdout, "{}", answer.words)?;
        }
        Ok(self.stdout.flush()?)
    }

    /// Says what is going on, at once.
    pub fn note(&mut self, sentence: &str) {
        let stderr = &mut *self.stderr;
        self.progress.suspend(|| drop(writeln!(stderr, "note: {sentence}")));
    }

    /// Says a warning once and keeps it for the answer.
    pub fn warn(&mut self, sentence: &str) {
        // A file can give rise to hundreds of thousands of them.
        if !self.said.insert(sentence.to_string()) {
            return;
        }
        self.warnings.push(sentence.to_string());
        let stderr = &mut *self.stderr;
        // A closed stderr must not stop a bake; the answer still holds the warning.
        self.progress.suspend(|| drop(writeln!(stderr, "warning: {sentence}")));
    }

    /// Says warnings that the answer tells elsewhere.
    pub fn say_all(&mut self, sentences: impl IntoIterator<Item = impl AsRef<str>>) {
        let stderr = &mut *self.stderr;
        self.progress.suspend(|| {
            for sentence in sentences {
                drop(writeln!(stderr, "warning: {}", sentence.as_ref()));
            }
        });
    }

    /// Says all of them; see [`Console::warn`].
    pub fn warn_all(&mut self, sentences: impl IntoIterator<Item = impl AsRef<str>>) {
        for sentence in sentences {
            self.warn(sentence.as_ref());
        }
    }

    /// Warnings so far.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Shows a bar on a terminal; nothing in a pipe.
    pub fn start_progress(&mut self, task: &'static str) -> ProgressBar {
        let target =
            if std::io::stderr().is_terminal() { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let style = ProgressStyle::with_template("{prefix:>8} {bar:40} {percent:>3} %  {msg}")
            .expect("the template is a constant that indicatif accepts");
        self.progress = ProgressBar::with_draw_target(Some(1000), target).with_style(style).with_prefix(task);
        self.progress.clone()
    }

    /// Removes the bar.
    pub fn end_progress(&mut self) {
        self.progress.finish_and_clear();
        self.progress = ProgressBar::hidden();
    }
}

/// Moves a bar to a share of the whole, 0…1.
pub fn advance(bar: &ProgressBar, share: f32) {
    bar.set_position((share.clamp(0.0, 1.0) * 1000.0) as u64);
}

/// A duration for people.
pub fn duration_words(secs: f64) -> String {
    match secs {
        s if s < 90.0 => format!("{s:.1} s"),
        s if s < 5400.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Looked up one by one they would take minutes.
    #[test]
    fn of_half_a_million_warnings_each_is_said_once() {
        let (mut stdout, mut stderr) = (Vec::new(), Vec::new());
        let mut console = Console::new(Instant::now(), &mut stdout, &mut stderr, Interrupt::never());
        let sentences = (0..500_000).chain(0..500_000).map(|nth| format!("the look sets `k{nth}`, which is not there"));
        console.warn_all(sentences);
        assert_eq!(console.warnings().len(), 500_000);
        assert_eq!(console.warnings()[1], "the look sets `k1`, which is not there");
        assert_eq!(String::from_utf8(stderr).unwrap().lines().count(), 500_000);
    }
}
