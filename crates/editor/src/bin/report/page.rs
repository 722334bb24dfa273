//! The page as a map from sections to their text, so that a section can be written without the others.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::Path;

use anyhow::{Context, Result};

/// Texts of sections by name.
#[derive(Debug, Default, PartialEq)]
pub struct Page {
    sections: BTreeMap<String, String>,
}

const HEAD: &str = "# Benchmarks\n\n\
    Every figure on this page was measured and written by the command that its section names, but for tables of others that a section\n\
    quotes, which say whose they are. Times depend on the machine; figures of a section come from one run, or, where it tells of an interruption, from several of one program on one machine. Each section tells how long it took, and a run of all of them at the end of the page what they took together; `--quick`\n\
    measures less of them, and aims at under five minutes on two cores. The yardstick that a section\n\
    tells is work that no change of this program touches: all threads at once deflate a MiB each with a library, the median of five rounds.\n\
    Where it differs, the machine was faster or slower, and seconds of such sections are not to be compared. Sections that tell none are\n\
    older than it.\n\n\
    Seven experiments: error against time; the method's own evaluation; growth; what nobody beats, in bytes and in time to\n\
    relight; ablations, with the work that is skipped; what a sitting costs; and every method on matrices on which methods fail, which\n\
    has a page of its own: [stability](stability.md). The other sections measure one part of the program each.\n\
    A section that was not written yet is not there, also where this head names it.\n\n\
    Which way is ahead stands below each table of [Error against time](#error-against-time), after how many looks a bake has paid in\n\
    [Where a bake pays for itself](#where-a-bake-pays-for-itself), and again in the sections behind them for scenes with mirrors and glass,\n\
    for scenes of others, and under a sky; which methods no other one beats, in [What nobody beats](#what-nobody-beats).\n\n\
    What is aimed at stands in the text of a section, and *kept* or *missed* beside what was measured. Why something is missed stands\n\
    there, too, or on the page of the decision that it names, as far as that is known.\n\n\
    Scenes of `assets/scenes` are always measured. Others, and the matrices `mixed` and `reflect`, lie in a folder that\n\
    `CLERESTORY_SHARED` names (`scenes/*.glb`, `references/*.glb`, `env/*`, `matrices/*.npz`); without it their rows are left out, and\n\
    sections of theirs alone stay as they were, as that of a graphics card does where there is none. Both\n\
    matrices are of a room of 128 × 96 pixels and 256 texels that another program traced; the file of `mixed` holds two noisy halves of\n\
    it, too. What bakes are held against is made once and kept, with a checksum, in the user's cache, or in the folder that\n\
    `CLERESTORY_REPORT_CACHE` names; a section that found it there tells how long it had taken to make. Cycles and Mitsuba are asked\n\
    by `scripts/peers.py`, which needs a Python with NumPy and one of both (`pip install numpy bpy mitsuba`). `CLERESTORY_PYTHON` names\n\
    that Python, else `python3` is asked: `CLERESTORY_PYTHON=venv/bin/python cargo run --release -p clerestory --bin report -- peers`.\n\
    Where it has no renderer, or the files are not there, the report says so, and the section stays as it was.\n";

fn start(name: &str) -> String {
    format!("<!-- section {name} -->")
}

fn end(name: &str) -> String {
    format!("<!-- end of {name} -->")
}

impl Page {
    /// The page of a file; an empty one where there is no file yet.
    ///
    /// # Errors
    /// If it cannot be read, or as [`Page::parse`]: what is not understood is not written over.
    pub fn read(path: &Path) -> Result<Page> {
        match std::fs::read_to_string(path) {
            Ok(text) => Page::parse(&text).with_context(|| format!("cannot add to {}", path.display())),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(Page::default()),
            Err(error) => Err(error).with_context(|| format!("cannot read {}", path.display())),
        }
    }

    /// What lies between the marks of a page; text outside of them is the head, which is always the same.
    ///
    /// # Errors
    /// If a section has lost the mark at its end, or the end of that at its start: its text would be lost, too.
    pub fn parse(text: &str) -> Result<Page> {
        let mut sections = BTreeMap::new();
        for part in text.split("<!-- section ").skip(1) {
            let (name, rest) = part.split_once(" -->").context("a section has lost the end of its mark, `-->`")?;
            let lost = || format!("the section {name} has lost its last line, `{}`: put it back", end(name));
            let (body, _) = rest.split_once(&end(name)).with_context(lost)?;
            sections.insert(name.to_string(), body.trim().to_string());
        }
        Ok(Page { sections })
    }

    /// Replaces the text of a section.
    pub fn put(&mut self, name: &str, text: String) {
        self.sections.insert(name.to_string(), text);
    }

    /// The page with its sections in the order of `names`; those that have no text are left out.
    pub fn text<'a>(&self, names: impl Iterator<Item = &'a str>) -> String {
        let mut page = HEAD.to_string();
        for (name, text) in names.filter_map(|name| Some((name, self.sections.get(name)?))) {
            page += &format!("\n{}\n{text}\n{}\n", start(name), end(name));
        }
        page
    }
}

/// A page that is written by hand but for a section, with another text there; `None` if it has no such section.
pub fn replaced(page: &str, name: &str, text: &str) -> Option<String> {
    let (before, rest) = page.split_once(&start(name))?;
    let (_, after) = rest.split_once(&end(name))?;
    Some(format!("{before}{}\n{text}\n{}{after}", start(name), end(name)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_section_of_a_page_written_by_hand_is_replaced() {
        let page = "# By hand\n\n<!-- section a -->\nold\n<!-- end of a -->\n\nmore\n";
        assert_eq!(replaced(page, "a", "new"), Some(page.replace("old", "new")));
        assert_eq!(replaced(page, "b", "new"), None);
    }

    #[test]
    fn a_page_that_is_not_understood_is_no_empty_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("benchmarks.md");
        assert_eq!(Page::read(&path).unwrap(), Page::default(), "there is none yet");
        let mut page = Page::default();
        page.put("bakes", "## Bakes".into());
        let text = page.text(["bakes"].into_iter());
        std::fs::write(&path, &text).unwrap();
        assert_eq!(Page::read(&path).unwrap(), page);
        std::fs::write(&path, text.replace("<!-- end of bakes -->", "")).unwrap();
        let told = format!("{:#}", Page::read(&path).unwrap_err());
        assert!(told.contains("benchmarks.md") && told.contains("the section bakes has lost its last line"), "{told}");
        std::fs::write(&path, b"# Benchmarks \xff").unwrap();
        assert!(format!("{:#}", Page::read(&path).unwrap_err()).starts_with("cannot read"), "no text");
    }

    #[test]
    fn a_section_is_replaced_and_the_others_stay() {
        let mut page = Page::default();
        page.put("rays", "## Rays\n\n| a | b |".into());
        page.put("bakes", "## Bakes\n\n1 dB".into());
        let written = page.text(["bakes", "matrix", "rays"].into_iter());
        let mut again = Page::parse(&written).unwrap();
        assert_eq!(again, page);
        again.put("bakes", "## Bakes\n\n2 dB".into());
        let rewritten = again.text(["bakes", "matrix", "rays"].into_iter());
        assert_eq!(rewritten, written.replace("1 dB", "2 dB"));
        assert!(rewritten.find("2 dB") < rewritten.find("## Rays"), "{rewritten}");
    }
}
