//! The one command that writes `docs/benchmarks.md`, and the measured parts of `docs/reliability.md` and `docs/stability.md`: it
//! measures, and writes down what it measured, section by section.
//! `cargo run --release -p clerestory --bin report -- [--quick] [--into DIR] [SECTION]…`
//!
//! Without a section it runs all of them (`hardware` where there is a graphics device of hardware, `time-others`, `time-living-room`, `paper-room`, `matrix`, `matrix-panel`, `lamps-others` and `lamps-living-room` where their scenes are, `peers` where another renderer is), in a hurry those of [`IN_A_HURRY`], which aims at under five minutes on two cores; the text of those that are not run stays as it is. Scenes of `assets/scenes` are
//! measured always, those of the folder named by `CLERESTORY_SHARED` where it exists. What bakes are held against is made once and
//! kept in the user's cache, or the folder named by `CLERESTORY_REPORT_CACHE`; so are the parts of a section that was interrupted, until
//! it is finished by the same program on the same machine. Plots and small pictures are written to `docs/plots`. With `--into` all of this is written to another
//! folder, so that a check leaves the pages as they are.

mod ablations;
mod arguments;
mod bakes;
mod budgets;
mod built;
mod cancel;
mod cases;
mod desk;
mod errors;
mod files;
mod fit;
mod fronts;
mod goal;
mod growth;
mod hardware;
mod kept;
mod kills;
mod lamps;
mod latency;
mod matrix;
mod methods;
mod page;
mod paper;
mod peers;
mod plot;
mod prints;
mod rays;
mod reference;
mod relight;
mod rendered;
mod scenes;
mod sitting;
mod skips;
mod sources;
mod stability;
mod steps;
mod targets;
mod time;
mod under_way;
mod yardstick;

use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

use anyhow::{Context, Result};
use clap::Parser;

use arguments::Arguments;
use desk::Desk;
use page::Page;
use paper::conference;

/// A part of the page that is measured and written by itself.
struct Section {
    name: &'static str,
    write: fn(&Desk) -> Result<String>,
}

/// Sections that are part of a page written by hand, `docs/PAGE.md`.
const OWN_PAGES: [(&str, Section); 4] = [
    ("reliability", Section { name: "reliability", write: kills::write }),
    ("reliability", Section { name: "cancel", write: cancel::write }),
    ("reliability", Section { name: "budgets", write: budgets::write }),
    ("stability", Section { name: "stability", write: stability::write }),
];

/// In the order of the page.
const SECTIONS: [Section; 31] = [
    Section { name: "time", write: time::write },
    Section { name: time::MIRRORS, write: time::write_mirrors },
    Section { name: time::MIXED, write: time::write_mixed },
    Section { name: time::OTHERS, write: time::write_others },
    Section { name: time::LIVING_ROOM, write: time::write_living_room },
    Section { name: time::SECONDS, write: time::seconds::write },
    Section { name: "paper", write: paper::write },
    Section { name: conference::NAME, write: conference::write },
    Section { name: "growth", write: growth::write },
    Section { name: "fronts", write: fronts::write },
    Section { name: "sitting", write: sitting::write },
    Section { name: peers::NAME, write: peers::write },
    Section { name: "ablations", write: ablations::write },
    Section { name: "bakes", write: bakes::write },
    Section { name: "skips", write: skips::write },
    Section { name: "matrix", write: matrix::write },
    Section { name: matrix::PANEL, write: matrix::write_panel },
    Section { name: "methods", write: methods::write },
    Section { name: "targets", write: targets::write },
    Section { name: "target-bakes", write: targets::baked::write },
    Section { name: "relight", write: relight::write },
    Section { name: "latency", write: latency::write },
    Section { name: hardware::NAME, write: hardware::write },
    Section { name: "files", write: files::write },
    Section { name: "rays", write: rays::write },
    Section { name: "lamps", write: lamps::write },
    Section { name: lamps::OTHERS, write: lamps::write_others },
    Section { name: lamps::LIVING_ROOM, write: lamps::write_living_room },
    Section { name: lamps::more::NAME, write: lamps::more::write },
    Section { name: lamps::more::CAUSTICS, write: lamps::more::write_caustics },
    Section { name: "steps", write: steps::write },
];

/// What `--quick` alone measures: it aims at under five minutes on two cores.
const IN_A_HURRY: [&str; 15] = [
    "time",
    time::OTHERS,
    time::SECONDS,
    "paper",
    conference::NAME,
    "growth",
    "fronts",
    "sitting",
    "ablations",
    "bakes",
    "skips",
    "matrix",
    "methods",
    "relight",
    "stability",
];
/// What a report in a hurry aims at, seconds on two cores.
const HURRY_SECS: f64 = 300.0;
/// Of the line at the end of a page whose sections were all measured in one run: in a hurry, and else.
const TOTALS: [&str; 2] = ["total", "total-full"];

fn main() -> ExitCode {
    let Arguments { sections, quick, into, grow } = Arguments::parse();
    let done = match grow {
        Some(bench) => growth::one(&bench).map(|taken| answer(&taken)),
        None => report(quick, into.as_deref(), &sections),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            complain(&format!("report: {error:#}"));
            ExitCode::FAILURE
        }
    }
}

/// Names of all sections in the order of the page, those of pages that are written by hand last.
fn section_names() -> impl Iterator<Item = &'static str> {
    SECTIONS.iter().chain(OWN_PAGES.iter().map(|(_, section)| section)).map(|section| section.name)
}

#[expect(clippy::print_stdout, reason = "the section that asked for one bake reads it")]
fn answer(taken: &str) {
    println!("{taken}");
}

#[expect(clippy::print_stderr, reason = "this binary speaks to people")]
fn complain(words: &str) {
    eprintln!("{words}");
}

fn report(quick: bool, pages: Option<&Path>, names: &[String]) -> Result<()> {
    let desk = Desk::new(quick, pages)?;
    let asked = |section: &&Section| match names {
        [] if desk.quick => IN_A_HURRY.contains(&section.name) && can_be_measured(&desk, section),
        [] => can_be_measured(&desk, section),
        names => names.iter().any(|name| name == section.name),
    };
    let begun = Instant::now();
    let (mut earlier_secs, mut done) = (0.0, Vec::new());
    let mut measured = |section: &Section| {
        desk.begin()?;
        let text = (section.write)(&desk).with_context(|| format!("cannot measure the section {}", section.name))?;
        complain(&format!("{} took {:.0} s", section.name, desk.secs()));
        earlier_secs += desk.earlier_secs();
        done.push(section.name);
        Ok::<_, anyhow::Error>(text)
    };
    for (page, section) in OWN_PAGES.iter().filter(|(_, section)| asked(&section)) {
        let (path, text) = (desk.pages.join(format!("{page}.md")), measured(section)?);
        let before = if path.exists() { path.clone() } else { desk.root.join(format!("docs/{page}.md")) };
        let page = std::fs::read_to_string(&before).with_context(|| format!("cannot read {}", before.display()))?;
        let page = page::replaced(&page, section.name, text.trim_end())
            .with_context(|| format!("{} has lost its marks", path.display()))?;
        put(&path, &page)?;
        desk.finish(section.name)?;
    }
    let path = desk.pages.join("benchmarks.md");
    // Before anything is measured for it.
    Page::read(&path)?;
    let total_mark = desk.choose(TOTALS[0], TOTALS[1]);
    let shown = || section_names().chain([total_mark]);
    for section in SECTIONS.iter().filter(asked) {
        // Section by section, so that a later one that fails costs nothing of an earlier one.
        let text = measured(section)?;
        let text = format!("{}\n\n{}", desk.provenance(section.name)?, text.trim_end());
        let mut page = Page::read(&path)?;
        page.put(section.name, text);
        put(&path, &page.text(shown()))?;
        desk.finish(section.name)?;
    }
    let secs = begun.elapsed().as_secs_f64();
    complain(&format!("all sections took {secs:.0} s in this run"));
    if names.is_empty() {
        let wanted = section_names().filter(|name| !desk.quick || IN_A_HURRY.contains(name));
        let missing: Vec<&str> = wanted.filter(|name| !done.contains(name)).collect();
        let total = total_words(desk.quick, [secs, earlier_secs], &missing);
        complain(&total);
        let mut page = Page::read(&path)?;
        page.put(total_mark, format!("*{total}*"));
        put(&path, &page.text(shown()))?;
    }
    Ok(())
}

/// What all sections took in this run and what their parts had taken before an interruption, which of them could not be measured, and in
/// a hurry a warning where that is more than is aimed at: nothing fails for it.
fn total_words(quick: bool, [secs, earlier]: [f64; 2], missing: &[&str]) -> String {
    let but = if missing.is_empty() { String::new() } else { format!(" but {}", missing.join(", ")) };
    let all = secs + earlier;
    let took = if earlier > 0.0 {
        format!("{all:.0} s, {earlier:.0} of them before an interruption")
    } else {
        format!("{all:.0} s")
    };
    if !quick {
        return format!(
            "When all sections{but} were last measured in one run, of version {}, they took {took}.",
            env!("CARGO_PKG_VERSION")
        );
    }
    let over = format!("Warning: more than the {HURRY_SECS:.0} s on two cores that `--quick` aims at.");
    let over = if all > HURRY_SECS { format!(" {over}") } else { String::new() };
    format!("All sections{but} of `--quick` took {took}.{over}")
}

/// Whether a section is measured here without being asked for: where what it needs is missing, the page keeps what it has.
fn can_be_measured(desk: &Desk, section: &Section) -> bool {
    match section.name {
        hardware::NAME => hardware::is_here(),
        time::OTHERS => time::has_others(desk),
        time::LIVING_ROOM => time::has_living_room(desk),
        lamps::OTHERS => lamps::has_others(desk),
        lamps::LIVING_ROOM => lamps::has_living_room(desk),
        conference::NAME => conference::has_room(desk),
        "matrix" => matrix::has_scenes(desk),
        matrix::PANEL => matrix::has_panel(desk),
        peers::NAME => {
            let missing = peers::missing(desk);
            missing.iter().for_each(|why| complain(&format!("the section {} stays as it is: {why}", section.name)));
            missing.is_none()
        }
        _ => true,
    }
}

fn put(path: &Path, page: &str) -> Result<()> {
    clerestory::output::write_whole(path, page.as_bytes())?;
    complain(&format!("wrote {}", path.display()));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sections_stand_once_and_those_in_a_hurry_are_among_them() {
        let own = OWN_PAGES.iter().map(|(_, section)| section.name);
        let names: Vec<&str> = SECTIONS.iter().map(|section| section.name).chain(own).collect();
        let is_once = |name: &&str| names.iter().filter(|other| *other == name).count() == 1;
        assert!(names.iter().chain(&IN_A_HURRY).all(is_once), "{names:?}");
        let of_time = ["time", time::MIRRORS, time::MIXED, time::OTHERS, time::LIVING_ROOM];
        assert_eq!(names[..of_time.len()], of_time, "the same of other scenes");
        assert!([time::MIRRORS, time::MIXED, time::LIVING_ROOM].iter().all(|name| !IN_A_HURRY.contains(name)));
        assert!(!TOTALS.iter().any(|total| names.contains(total)), "the last line is no section");
    }

    #[test]
    fn sections_none_of_whose_scenes_is_there_stay_as_they_are() {
        let folder = tempfile::tempdir().unwrap();
        let desk = Desk::new(true, Some(folder.path())).unwrap().without_shared();
        let measured: Vec<&str> = SECTIONS
            .iter()
            .filter(|section| section.name != hardware::NAME && can_be_measured(&desk, section))
            .map(|section| section.name)
            .collect();
        let of_others = [
            time::OTHERS,
            time::LIVING_ROOM,
            conference::NAME,
            peers::NAME,
            "matrix",
            matrix::PANEL,
            lamps::OTHERS,
            lamps::LIVING_ROOM,
        ];
        assert!(of_others.iter().all(|name| !measured.contains(name)), "{measured:?}");
        assert_eq!(measured.len(), SECTIONS.len() - of_others.len() - 1, "all others have scenes of their own");
        assert!(matrix::write(&desk).unwrap_err().to_string().contains("CLERESTORY_SHARED"));
    }

    #[test]
    fn a_report_tells_its_seconds_and_one_in_a_hurry_warns_of_too_many() {
        let alone = |quick: bool, secs: f64| total_words(quick, [secs, 0.0], &[]);
        assert!(alone(false, 36000.4).ends_with(" they took 36000 s."));
        assert_eq!(alone(true, 212.4), "All sections of `--quick` took 212 s.");
        assert!(alone(true, 312.0).starts_with("All sections of `--quick` took 312 s. Warning: more than the 300 s"));
    }

    #[test]
    fn seconds_before_an_interruption_and_sections_that_are_missing_are_told() {
        let told = total_words(false, [3000.0, 1600.4], &["hardware", "peers"]);
        assert!(told.starts_with("When all sections but hardware, peers were last measured in one run,"), "{told}");
        assert!(told.ends_with(" they took 4600 s, 1600 of them before an interruption."), "{told}");
        assert!(total_words(true, [200.0, 112.0], &[]).contains("Warning"), "both stretches count");
    }
}
