//! Real bakes of the scenes of the method's evaluation, and one of as many columns as a panel may have.

mod beside;

use std::path::{Path, PathBuf};

use anyhow::Result;
use clerestory_transport::camera::Film;
use serde::{Deserialize, Serialize};

use super::WORST_BELOW_DB;
use crate::desk::{Desk, clerestory, number};
use crate::fit::{hundredths, spread_words, tenths};
use crate::goal::Goal;

/// The ratio that is aimed at.
#[derive(Clone, Copy)]
enum Aim {
    /// With 256 columns: 200 on the scene of those so marked that has the least, 300 on the others.
    OfKinds,
    Least(f64),
    /// As much as it gets.
    Open,
}

/// A scene, texels along a side of its panel, what it is asked for in dB, most samples per pixel, and the ratio that is aimed at.
struct Subject {
    scene: &'static str,
    side: u32,
    tolerance_db: f64,
    /// In a quick report and in a full one: so many that two cores take less than half an hour for all of them.
    spp: [&'static str; 2],
    aim: Aim,
}

const SUBJECTS: [Subject; 6] = [
    Subject { scene: "diffuse", side: 16, tolerance_db: 40.0, spp: ["16", "128"], aim: Aim::OfKinds },
    Subject { scene: "reflections", side: 16, tolerance_db: 40.0, spp: ["16", "32"], aim: Aim::OfKinds },
    Subject { scene: "caustics", side: 16, tolerance_db: 40.0, spp: ["16", "32"], aim: Aim::OfKinds },
    Subject { scene: "mixed", side: 16, tolerance_db: 40.0, spp: ["16", "32"], aim: Aim::OfKinds },
    Subject { scene: "diffuse", side: 64, tolerance_db: 40.0, spp: ["4", "16"], aim: Aim::Least(1500.0) },
    Subject { scene: "conference-panel", side: 16, tolerance_db: 35.0, spp: ["4", "128"], aim: Aim::Open },
];

/// Seeds of the bakes with few samples that tell how far bakes lie apart, those of panels of so many texels along a side; all others have
/// the first.
const SEEDS: [&str; 3] = ["0", "1", "2"];
const REPEATED_SPP: &str = "4";
const REPEATED_SIDE: u32 = 16;

/// What a bake told.
#[derive(Serialize, Deserialize)]
struct Baked {
    ratio: f64,
    file_bytes: f64,
    mean_rank: f64,
    max_rank: f64,
    /// Truncation, sampling, both.
    error_db: [f64; 3],
    worst_block_db: f64,
    secs: f64,
}

/// A table of all bakes, each a part that is kept when the section is interrupted.
///
/// # Errors
/// If a scene cannot be baked.
pub fn write(desk: &Desk) -> Result<String> {
    let Film { width, height } = desk.choose(Film { width: 96, height: 72 }, Film { width: 512, height: 384 });
    let size = format!("{width}x{height}");
    let mut all = Vec::new();
    for subject in &SUBJECTS {
        let Some(path) = subject.path(desk) else { continue };
        let part = format!("{}-{}", subject.scene, subject.n_cols());
        let how = (subject.spp(desk), SEEDS[0]);
        all.push((subject, desk.part("target-bakes", &part, || subject.baked(desk, &path, &size, how))?));
    }
    let repeats = repeats(desk, &size)?;
    let beside = beside(desk)?;
    let of_kinds = all.iter().filter(|(subject, _)| matches!(subject.aim, Aim::OfKinds));
    let least = of_kinds.map(|(_, baked)| baked.ratio).fold(f64::INFINITY, f64::min);
    let rows: String = all.iter().map(|(subject, baked)| subject.row(subject.spp(desk), baked, least)).collect();
    Ok(format!(
        "## Bakes beside the targets\n\n\
         Whole bakes of {} pixels from the command line, with the light between surfaces traced and the panel divided into so many\n\
         columns. Blocks stop once they are exact enough, at the latest after the samples that are given: where these do not suffice, the error says so, and the ratio\n\
         is that of what was reached, and its aim is not tested here, but on blocks with as many samples as two cores take in some minutes (section Targets, ratios at 40 dB). Errors as the bake tells them, from what two halves of the samples agree about: truncation / sampling / total, and the total of its worst\n\
         block, which is aimed at no more than {WORST_BELOW_DB} dB below what was asked for, whether the samples suffice or not. Seconds by the clock; each row is one bake, of seed {}; how far seeds lie apart is told below. A picture of each light by itself, in 32-bit floats as other renderers write them, is the dense matrix: {:.0} MB for 64 lights. {}\n\n\
         | scene | columns | asked for | samples | rank mean / max | MB | dense / file | aimed at | error dB | worst block, dB | s |\n\
         |---|---|---|---|---|---|---|---|---|---|---|\n{rows}\n\
         ### Bakes with other seeds\n\n\
         The same bakes of {} columns with {REPEATED_SPP} samples per pixel at most, median (least…greatest) of the seeds {}. Errors in dB as these bakes tell them: in all, and of the worst block.\n\n\
         | scene | mean rank | dense / file | error dB | worst block, dB | s |\n\
         |---|---|---|---|---|---|\n{repeats}{beside}",
        size.replace('x', " × "),
        SEEDS[0],
        64.0 * 12e-6 * f64::from(width) * f64::from(height),
        desk.load_words(),
        REPEATED_SIDE * REPEATED_SIDE,
        SEEDS.join(", "),
    ))
}

/// All methods on blocks of the scenes whose ratio is as small as it gets, each scene a part as well.
fn beside(desk: &Desk) -> Result<String> {
    let mut text = String::new();
    for subject in SUBJECTS.iter().filter(|subject| matches!(subject.aim, Aim::Open)) {
        let Some(path) = subject.path(desk) else { continue };
        let Subject { scene, side, tolerance_db, .. } = *subject;
        let measure = || beside::measured(desk, (scene, &path), (side, tolerance_db));
        let found = desk.part("target-bakes", &format!("{scene}, all methods"), measure)?;
        text += &found.text(scene, tolerance_db);
    }
    Ok(text)
}

/// The error of the worst block, and whether it keeps what is aimed at.
fn worst_words(worst_db: f64, tolerance_db: f64) -> String {
    format!("{worst_db:.1}, {}", Goal::Least(tolerance_db - WORST_BELOW_DB).word(worst_db))
}

/// A table of the bakes with few samples, each a part as well.
fn repeats(desk: &Desk, size: &str) -> Result<String> {
    let mut rows = String::new();
    for subject in SUBJECTS.iter().filter(|subject| subject.side == REPEATED_SIDE) {
        let Some(path) = subject.path(desk) else { continue };
        let mut found: Vec<Baked> = Vec::new();
        for seed in SEEDS {
            let part = format!("{}-{}, seed {seed}", subject.scene, subject.n_cols());
            let how = (REPEATED_SPP, seed);
            found.push(desk.part("target-bakes", &part, || subject.baked(desk, &path, size, how))?);
        }
        rows += &subject.repeated(&found);
    }
    Ok(rows)
}

impl Subject {
    fn n_cols(&self) -> u32 {
        self.side * self.side
    }

    /// A row of the table; `least` is the least ratio of those of [`Aim::OfKinds`].
    fn row(&self, spp: &str, baked: &Baked, least: f64) -> String {
        let Subject { scene, tolerance_db, .. } = self;
        let [truncation, sampling, total] = baked.error_db;
        format!(
            "| {scene} | {} | {tolerance_db} | {spp} | {:.2} / {:.0} | {:.2} | {:.0}× | {} | {truncation:.1} / {sampling:.1} / {total:.1} | {} | {:.0} |\n",
            self.n_cols(),
            baked.mean_rank,
            baked.max_rank,
            baked.file_bytes / 1e6,
            baked.ratio,
            self.verdict(baked, least),
            worst_words(baked.worst_block_db, *tolerance_db),
            baked.secs,
        )
    }

    /// A row of the table of repeats.
    fn repeated(&self, found: &[Baked]) -> String {
        let all = |value: fn(&Baked) -> f64| -> Vec<f64> { found.iter().map(value).collect() };
        format!(
            "| {} | {} | {}× | {} | {} | {} |\n",
            self.scene,
            hundredths(all(|baked| baked.mean_rank)),
            spread_words(all(|baked| baked.ratio)),
            tenths(all(|baked| baked.error_db[2])),
            tenths(all(|baked| baked.worst_block_db)),
            spread_words(all(|baked| baked.secs)),
        )
    }

    /// What is aimed at, and whether it is kept.
    fn verdict(&self, baked: &Baked, least: f64) -> String {
        let aim = match self.aim {
            Aim::OfKinds if baked.ratio <= least => 200.0,
            Aim::OfKinds => 300.0,
            Aim::Least(aim) => aim,
            Aim::Open => return "as small as it gets".into(),
        };
        let [.., total] = baked.error_db;
        let is_tested = total >= self.tolerance_db;
        let word = if is_tested { Goal::Least(aim).word(baked.ratio) } else { "not tested: short of the dB" };
        format!("≥ {aim}×, {word}")
    }

    fn spp(&self, desk: &Desk) -> &'static str {
        let [quick, full] = self.spp;
        desk.choose(quick, full)
    }

    /// Its file; none of a real scene that is not at hand.
    fn path(&self, desk: &Desk) -> Option<PathBuf> {
        let own = desk.root.join(format!("assets/scenes/{}.glb", self.scene));
        Some(own).filter(|path| path.exists()).or_else(|| desk.shared(&format!("scenes/{}.glb", self.scene)))
    }

    fn baked(&self, desk: &Desk, path: &Path, size: &str, (spp, seed): (&str, &str)) -> Result<Baked> {
        let Subject { scene, side, tolerance_db, .. } = self;
        desk.say(&format!("baking {scene} with a panel of {side} × {side} texels, {spp} samples, seed {seed}"));
        let (path, tolerance) = (path.display().to_string(), tolerance_db.to_string());
        let (transport, panel) = (desk.file("targets.transport"), format!("panel={side}"));
        let line = ["bake", &path, "-o", &transport, "--fresh", "--size", size, "--spp", spp, "--seed", seed, "--json"];
        let line: Vec<&str> = line.into_iter().chain(["--tolerance", &tolerance, "--panel", &panel]).collect();
        let told = clerestory(&line)?;
        Ok(Baked {
            ratio: number(&told, "/ratio"),
            file_bytes: number(&told, "/file_bytes"),
            mean_rank: number(&told, "/mean_rank"),
            max_rank: number(&told, "/max_rank"),
            error_db: ["truncation", "sampling", "total"].map(|layer| number(&told, &format!("/error_db/{layer}"))),
            worst_block_db: number(&told, "/block_error_db/total/worst"),
            secs: number(&told, "/bake_secs"),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_aim_is_kept_or_missed_by_what_reached_its_error_alone() {
        let baked = |ratio: f64, total: f64| Baked {
            ratio,
            file_bytes: 1e6,
            mean_rank: 4.0,
            max_rank: 9.0,
            error_db: [50.0, 50.0, total],
            worst_block_db: 30.0,
            secs: 10.0,
        };
        let [of_kinds, .., many, open] = &SUBJECTS;
        assert_eq!(of_kinds.verdict(&baked(250.0, 40.1), 250.0), "≥ 200×, kept");
        assert_eq!(of_kinds.verdict(&baked(250.0, 40.1), 220.0), "≥ 300×, missed");
        assert_eq!(of_kinds.verdict(&baked(900.0, 39.0), 220.0), "≥ 300×, not tested: short of the dB");
        assert_eq!(many.verdict(&baked(1500.0, 40.0), 220.0), "≥ 1500×, kept");
        assert_eq!(open.verdict(&baked(2.0, 9.0), 2.0), "as small as it gets");
        let row = of_kinds.row("32", &Baked { worst_block_db: 36.0, ..baked(250.0, 40.1) }, 250.0);
        assert!(row.ends_with(" / 40.1 | 36.0, kept | 10 |\n"), "{row}");
        assert!(of_kinds.row("32", &baked(250.0, 40.1), 250.0).contains(" | 30.0, missed | "));
        let told = of_kinds.repeated(&[baked(250.0, 40.1), baked(260.0, 39.0), baked(240.0, 40.0)]);
        let words =
            "| diffuse | 4.00 (4.00…4.00) | 250 (240…260)× | 40.0 (39.0…40.1) | 30.0 (30.0…30.0) | 10 (10…10) |\n";
        assert_eq!(told, words);
    }
}
