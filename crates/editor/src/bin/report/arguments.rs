//! What can be typed.

use std::path::PathBuf;

use clap::Parser;
use clap::builder::PossibleValuesParser;

use super::{growth, section_names};

const AFTER_HELP: &str = "Example: report --quick --into target/report\n         \
    or: report time growth\n         \
    or: report\n\
    As `report` type `cargo run --release -p clerestory --bin report --`.\n\n\
    A section that was interrupted goes on where it was once the same program is asked for it on the same machine.\n\n\
    Environment:\n  \
    CLERESTORY_SHARED        Folder with scenes, skies and matrices of others, which are left out without it\n  \
    CLERESTORY_REPORT_CACHE  Folder for references and for parts of interrupted sections, else one of the user's cache\n  \
    CLERESTORY_PYTHON        Python with Cycles or Mitsuba for the section `peers`, else `python3`\n\n\
    Exit codes: 0, all was measured and written; 1, a section could not be measured or written, but those before it were; 2, the command\n\
    line makes no sense.";

/// Measures what Clerestory does, and writes pages and plots of it, section by section: `benchmarks.md`, and parts of `reliability.md` and
/// `stability.md`.
#[derive(Parser)]
#[command(name = "report", version, after_help = AFTER_HELP)]
pub struct Arguments {
    /// What is measured; all that can be measured here if left out.
    #[arg(value_name = "SECTION", value_parser = PossibleValuesParser::new(section_names()))]
    pub sections: Vec<String>,
    /// Measure less: small pictures, few samples, and without a SECTION some of them; aims at under five minutes on two cores.
    #[arg(long)]
    pub quick: bool,
    /// Folder that receives pages and plots, made where it is not there; `docs` if left out.
    #[arg(long, value_name = "DIR")]
    pub into: Option<PathBuf>,
    /// One bake of the section `growth`, which measures each in a process of its own.
    #[arg(long = growth::ONE, value_name = "BENCH", hide = true, exclusive = true)]
    pub grow: Option<String>,
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_help_has_all_sections_examples_and_exit_codes() {
        // Without a width nothing is wrapped.
        let help = Arguments::command().term_width(0).render_long_help().to_string();
        let words = ["Example: report --quick", "--into <DIR>", "CLERESTORY_SHARED", "Exit codes: 0,"];
        for words in section_names().chain(words) {
            assert!(help.contains(words), "{words} is not in: {help}");
        }
        assert!(!help.contains(&format!("--{}", growth::ONE)), "people do not ask for one bake: {help}");
    }

    #[test]
    fn what_makes_no_sense_ends_with_2_and_a_question_for_help_with_0() {
        let code = |args: &[&str]| {
            let args = std::iter::once("report").chain(args.iter().copied());
            Arguments::try_parse_from(args).err().map(|error| error.exit_code())
        };
        let questions = [&["--help"][..], &["-h"], &["--version"]];
        assert_eq!(questions.map(code), [Some(0); 3]);
        let senseless = [&["no-such-section"][..], &["--fast"], &["-q"], &["--into"], &["--into", "--quick"]];
        assert_eq!(senseless.map(code), [Some(2); 5]);
        let one = format!("--{}", growth::ONE);
        let all = [&[][..], &["--quick", "--into", "pages", "time", "growth"], &[one.as_str(), "{}"]];
        assert_eq!(all.map(code), [None; 3]);
    }
}
