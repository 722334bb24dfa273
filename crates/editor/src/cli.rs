//! The command line: same engine, no window. Every error becomes words and an exit code here and nowhere else.

pub mod args;
pub(crate) mod bake;
mod cache;
mod console;
mod estimate;
pub mod gltf;
mod info;
mod interrupt;
pub(crate) mod lamps;
pub mod looks;
pub(crate) mod picture;
pub(crate) mod relight;
mod reuse;
mod schedule;
mod sensors;
pub mod sequence;
mod sheet;
mod solve;
mod trace;
mod usage;
pub(crate) mod view;
mod viewpoint;

use std::ffi::OsString;
use std::io::Write;
use std::process::ExitCode;
use std::time::Instant;

use anyhow::{Context, Result};
use serde_json::json;

use crate::app::WindowLost;
use crate::compare::{check_parts, compare, read_part};
use crate::platform::has_display;
use crate::words::in_words;
use args::{Arguments, Command, CompareArgs};
pub use console::{Answer, Console};
pub use interrupt::Interrupt;
pub(crate) use interrupt::nothing_kept;
use interrupt::{Stopped, writing};

/// Exit code of a failed command.
const FAILED: u8 = 1;
/// Exit code of a command line that makes no sense.
const WRONG_USAGE: u8 = 2;

/// Runs a command line, the program's name first. Answers go to `stdout`, warnings and errors to `stderr`.
pub fn run<T: Into<OsString> + Clone>(
    args: impl IntoIterator<Item = T>,
    stdout: &mut (dyn Write + Send),
    stderr: &mut (dyn Write + Send),
) -> ExitCode {
    run_until(Interrupt::never(), args, stdout, stderr)
}

/// The same until somebody interrupts it.
pub fn run_until<T: Into<OsString> + Clone>(
    interrupt: Interrupt,
    args: impl IntoIterator<Item = T>,
    stdout: &mut (dyn Write + Send),
    stderr: &mut (dyn Write + Send),
) -> ExitCode {
    let started = Instant::now();
    let arguments = match usage::understand(args) {
        Ok(arguments) => arguments,
        Err(error) if error.use_stderr() => {
            let _ = write!(stderr, "{}", error.render());
            return ExitCode::from(WRONG_USAGE);
        }
        Err(help) => return finish(write!(stdout, "{}", help.render()).map_err(Into::into), stderr),
    };
    let mut console = Console::new(started, stdout, stderr, interrupt);
    let result = dispatch(&arguments, &mut console);
    finish(result, stderr)
}

fn dispatch(arguments: &Arguments, console: &mut Console) -> Result<()> {
    let Some(command) = &arguments.command else {
        return open_editor(arguments, console);
    };
    let (answer, json) = match command {
        Command::Bake(args) => (bake::bake(args, console)?, args.answer.json),
        Command::Relight(args) => (relight::relight(args, console)?, args.answer.json),
        Command::Render(args) => (relight::render(args, console)?, args.answer.json),
        Command::Trace(args) => (trace::trace(args, console)?, args.answer.json),
        Command::Sensors(args) => {
            (writing(args.output.as_deref(), console, |console| sensors::sensors(args, console))?, args.answer.json)
        }
        Command::Schedule(args) => {
            (writing(Some(&args.output), console, |console| schedule::run(args, console))?, args.answer.json)
        }
        Command::Solve(args) => {
            (writing(Some(&args.output), console, |console| solve::run(args, console))?, args.answer.json)
        }
        Command::Compare(args) => (compare_files(args)?, args.answer.json),
        Command::ExportGltf(args) => {
            (writing(Some(&args.output), console, |console| gltf::export_gltf(args, console))?, args.answer.json)
        }
        Command::Cache(args) => (cache::cache(args)?, args.answer.json),
        Command::Info(args) => (info::info(args, console)?, args.answer.json),
    };
    console.answer(&answer, json || arguments.json)
}

/// Says an error in words. A reader that went away early (`| head`) is no error.
fn finish(result: Result<()>, stderr: &mut (dyn Write + Send)) -> ExitCode {
    let Err(error) = result else {
        return ExitCode::SUCCESS;
    };
    let reader_left = |cause: &(dyn std::error::Error + 'static)| {
        cause.downcast_ref::<std::io::Error>().is_some_and(|e| e.kind() == std::io::ErrorKind::BrokenPipe)
    };
    if error.chain().any(reader_left) {
        return ExitCode::SUCCESS;
    }
    if let Some(stopped) = error.downcast_ref::<Stopped>() {
        let _ = writeln!(stderr, "{stopped}");
        return ExitCode::from(stopped.exit_code());
    }
    // The front end has nowhere left to complain when stderr itself is closed.
    let _ = writeln!(stderr, "error: {}", in_words(&error));
    ExitCode::from(FAILED)
}

fn open_editor(arguments: &Arguments, console: &mut Console) -> Result<()> {
    if let Some(scene) = &arguments.scene {
        std::fs::metadata(scene).with_context(|| format!("cannot open {}: check the path", scene.display()))?;
    }
    let reason = if has_display() {
        match crate::app::run(arguments.scene.clone()) {
            Ok(()) => return Ok(()),
            Err(error) if error.is::<WindowLost>() => return Err(error),
            Err(error) => format!("the window could not be opened ({})", in_words(&error)),
        }
    } else {
        "there is no display".to_string()
    };
    let answer = crate::headless::run(arguments.scene.as_deref(), &reason, console)?;
    console.answer(&answer, arguments.json)
}

fn compare_files(args: &CompareArgs) -> Result<Answer> {
    let ((a, of_a), (b, of_b)) = (read_part(&args.a)?, read_part(&args.b)?);
    let problem = || format!("cannot compare {} with {}", args.a.display(), args.b.display());
    check_parts(of_a, of_b).with_context(problem)?;
    let comparison = compare(&a, &b).with_context(problem)?;
    let percent = |value: Option<f64>| value.map_or("undefined".into(), |v| format!("{:+.4} %", 100.0 * v));
    let words = format!(
        "relative L2  {}\nmean bias    R {}, G {}, B {}\nPSNR         {}",
        comparison.relative_l2.map_or("undefined".into(), |v| format!("{v:.6}")),
        percent(comparison.mean_bias[0]),
        percent(comparison.mean_bias[1]),
        percent(comparison.mean_bias[2]),
        comparison.psnr_db.map_or("infinite (nothing differs)".into(), |v| format!("{v:.2} dB")),
    );
    Ok(Answer { json: json!(comparison), words })
}
