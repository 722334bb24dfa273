//! What makes no sense on a command line, though each word of it can be read.

use std::ffi::OsString;
use std::path::Path;

use clap::error::ErrorKind;
use clap::{CommandFactory, Parser};
use clerestory_transport::emitters::PanelRequest;

use super::args::{Arguments, BakeOptions, Command};

/// Reads a command line, the program's name first.
///
/// # Errors
/// Wrong usage, or the help that was asked for.
pub(super) fn understand<T: Into<OsString> + Clone>(
    args: impl IntoIterator<Item = T>,
) -> Result<Arguments, clap::Error> {
    let arguments = Arguments::try_parse_from(args)?;
    match fault(&arguments) {
        Some((kind, sentence)) => Err(Arguments::command().error(kind, sentence)),
        None => Ok(arguments),
    }
}

fn fault(arguments: &Arguments) -> Option<(ErrorKind, String)> {
    let (panels, passed_over) = match &arguments.command {
        None => return neither_command_nor_file(arguments.scene.as_deref()?),
        Some(Command::Bake(args)) => (&args.options.view.panels, None),
        Some(Command::Render(args)) => (&args.bake.view.panels, of_kept_bakes(&args.bake)),
        Some(Command::Trace(args)) => (&args.view.panels, None),
        Some(_) => return None,
    };
    let useless = passed_over
        .map(|option| format!("{option} changes nothing of `render`, which keeps nothing of its bake; leave it out"));
    let twice = || asked_twice(panels).map(|node| format!("--panel names `{node}` twice; ask for it once"));
    Some((ErrorKind::ArgumentConflict, useless.or_else(twice)?))
}

/// An option that was typed and only means something to a bake that is kept: to start it over, or to move lamps afterwards.
fn of_kept_bakes(options: &BakeOptions) -> Option<&'static str> {
    let all = [("--fresh", options.fresh), ("--patches", options.patches > 0)];
    all.into_iter().find_map(|(option, is_typed)| is_typed.then_some(option))
}

/// A single word that is no file is more likely a slip of the finger than a scene.
fn neither_command_nor_file(word: &Path) -> Option<(ErrorKind, String)> {
    let typed = word.to_string_lossy();
    let like_a_path = typed.contains(['.', '/', '\\']) || word.exists();
    let sentence = || format!("`{typed}` is neither a command nor a file");
    (!like_a_path).then(|| (ErrorKind::InvalidSubcommand, sentence()))
}

fn asked_twice(panels: &[PanelRequest]) -> Option<&str> {
    let repeated = |(nth, panel): &(usize, &PanelRequest)| panels[..*nth].iter().any(|p| p.node == panel.node);
    panels.iter().enumerate().find(repeated).map(|(_, panel)| panel.node.as_str())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(line: &str) -> String {
        understand(line.split(' ')).expect_err(line).to_string()
    }

    #[test]
    fn a_word_that_is_no_command_is_taken_for_none() {
        let said = refused("clerestory frobnicate");
        assert!(said.contains("`frobnicate` is neither a command nor a file"), "{said}");
        for path in ["none.glb", "./none", "rooms/none"] {
            assert!(understand(["clerestory", path]).is_ok(), "{path}");
        }
        assert!(understand(["clerestory"]).is_ok());
    }

    #[test]
    fn options_that_would_be_passed_over_are_refused_with_what_they_are_at_odds_with() {
        for (line, words) in [
            ("render a.glb -o a.exr --fresh", ["--fresh", "render"]),
            ("render a.glb -o a.exr --patches 64", ["--patches", "render"]),
            ("bake a.glb --estimate --fresh", ["--estimate", "--fresh"]),
            ("bake a.glb -o a.transport --exact --no-denoise", ["--exact", "--no-denoise"]),
            ("relight a.transport -o a.png --contact-sheet a.look --name Day", ["--contact-sheet", "--name"]),
            ("relight a.transport -o a.png --contact-sheet a.look --at 1", ["--contact-sheet", "--at"]),
            ("relight a.transport -o a.png --contact-sheet a.look --preset day", ["--contact-sheet", "--preset"]),
            ("relight a.transport -o a_#.png --contact-sheet a.look --frames 0..1", ["--contact-sheet", "--frames"]),
            ("relight a.transport -o a_#.png --contact-sheet a.look --fps 24", ["--contact-sheet", "--fps"]),
        ] {
            let said = refused(&format!("clerestory {line}"));
            assert!(words.iter().all(|word| said.contains(word)), "{line}: {said}");
        }
    }

    #[test]
    fn a_panel_is_asked_for_once() {
        for command in ["bake a.glb -o a.transport", "render a.glb -o a.exr", "trace a.glb -o a.exr"] {
            let said = refused(&format!("clerestory {command} --panel P=8 --panel Q=8 --panel P=16"));
            assert!(said.contains("--panel names `P` twice"), "{said}");
            let line = format!("clerestory {command} --panel P=8 --panel P#2=8");
            assert!(understand(line.split(' ')).is_ok(), "{command}");
        }
    }
}
