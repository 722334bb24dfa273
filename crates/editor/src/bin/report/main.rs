//! The one command that writes `docs/benchmarks.md`, and the measured part of `docs/reliability.md`: it measures, and writes
//! down what it measured, section by section.
//! `cargo run --release -p clerestory --bin report -- [--quick] [SECTION]…`
//!
//! Without a section it runs all of them; the text of those that are not run stays as it is. Scenes of `assets/scenes` are
//! measured always, those of the folder named by `CLERESTORY_SHARED` where it exists.

mod bakes;
mod cases;
mod desk;
mod kills;
mod matrix;
mod methods;
mod page;
mod rays;
mod reference;
mod skips;

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result};

use desk::Desk;
use page::Page;

/// A part of the page that is measured and written by itself.
struct Section {
    name: &'static str,
    write: fn(&Desk) -> Result<String>,
}

/// The section that has a page of its own.
const RELIABILITY: &str = "reliability";

/// In the order of the page.
const SECTIONS: [Section; 5] = [
    Section { name: "bakes", write: bakes::write },
    Section { name: "skips", write: skips::write },
    Section { name: "matrix", write: matrix::write },
    Section { name: "methods", write: methods::write },
    Section { name: "rays", write: rays::write },
];

fn main() -> ExitCode {
    let (flags, names): (Vec<String>, Vec<String>) = std::env::args().skip(1).partition(|arg| arg.starts_with("--"));
    match report(&flags, &names) {
        Ok(path) => {
            complain(&format!("wrote {}", path.display()));
            ExitCode::SUCCESS
        }
        Err(error) => {
            complain(&format!("report: {error:#}"));
            ExitCode::FAILURE
        }
    }
}

#[expect(clippy::print_stderr, reason = "this binary speaks to people")]
fn complain(words: &str) {
    eprintln!("{words}");
}

fn report(flags: &[String], names: &[String]) -> Result<PathBuf> {
    let known = || SECTIONS.iter().map(|section| section.name).chain([RELIABILITY]);
    if let Some(flag) = flags.iter().find(|flag| *flag != "--quick") {
        anyhow::bail!("no option `{flag}`; there is --quick");
    }
    if let Some(name) = names.iter().find(|name| !known().any(|known| known == name.as_str())) {
        anyhow::bail!("no section `{name}`; there are: {}", known().collect::<Vec<_>>().join(", "));
    }
    let desk = Desk::new(!flags.is_empty())?;
    let out = desk.root.join("docs/benchmarks.md");
    if names.is_empty() || names.iter().any(|name| name == RELIABILITY) {
        let path = desk.root.join("docs/reliability.md");
        let text = kills::write(&desk).with_context(|| format!("cannot measure the section {RELIABILITY}"))?;
        let page = std::fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
        let page =
            page::replaced(&page, RELIABILITY, text.trim_end()).context("docs/reliability.md has lost its marks")?;
        std::fs::write(&path, page).with_context(|| format!("cannot write {}", path.display()))?;
        complain(&format!("wrote {}", path.display()));
    }
    for section in SECTIONS.iter().filter(|section| names.is_empty() || names.iter().any(|name| name == section.name)) {
        let text = (section.write)(&desk).with_context(|| format!("cannot measure the section {}", section.name))?;
        // Section by section, so that a later one that fails costs nothing of an earlier one.
        let text = format!("{}\n\n{}", desk.provenance(section.name), text.trim_end());
        let mut page = Page::parse(&std::fs::read_to_string(&out).unwrap_or_default());
        page.put(section.name, text);
        std::fs::write(&out, page.text(known())).with_context(|| format!("cannot write {}", out.display()))?;
    }
    Ok(out)
}
