//! Whether blocks of bakes tell their errors, whether any that the tolerance ended is far off, and whether their borders show: beside two
//! references, whose noise does not count.

use std::sync::Arc;

use anyhow::{Context, Result};
use clerestory_transport::bake::{Bake, BakeConfig};
use clerestory_transport::error_maps::BlockMap;
use clerestory_transport::import;
use clerestory_transport::prepared::PreparedScene;
use serde::{Deserialize, Serialize};

use super::judged::{Judged, decibels, is_noise};
use super::{Goals, Told, WORST_BELOW_DB};
use crate::desk::Desk;
use crate::fit::{hundredths, listed, median, tenths_known};
use crate::matrix::{NO_TOLERANCE_DB, baked};
use crate::methods::dense::Picture;
use crate::methods::own;
use crate::paper;

const SCENES: [&str; 4] = ["diffuse", "reflections", "caustics", "mixed"];
/// Samples per pixel at most, a power of two from 8 on, and what is asked for in dB; all samples are taken where nothing is.
type Way = (u32, Option<f32>);
const WAYS: [Way; 2] = [(16, None), (64, Some(35.0))];
/// Of bakes; the references, which are those of the section Noise, have the one before. In a hurry the first alone.
const SEEDS: &[u64] = &[paper::SEED + 1, paper::SEED + 2, paper::SEED + 3];
/// Share of the blocks that should tell their error, in percent, and what steps at borders may be of those within.
const TOLD: f64 = 90.0;
const SEAMS: f64 = 1.2;
const HIDDEN: &str = "less than the noise of the references";
/// Blocks whose error is known, without which nothing is said of how well errors are told, and no worst block is called kept.
const LEAST_KNOWN: usize = 12;
/// Below these dB seams are never called kept: noise within blocks, which steps at borders are held against, would see to that.
const LEAST_DB: f64 = 25.0;

/// What was found of a bake.
#[derive(Serialize, Deserialize)]
struct Found {
    /// Of the whole picture; `None` where the noise of the references is all that there is.
    db: Option<f64>,
    /// Whether that error is less than its standard error.
    is_noise: bool,
    /// As [`Judged::n_told`] has it.
    n_told: [usize; 3],
    /// As [`Judged`] has it; `None` as there.
    seams: Option<f64>,
    ended: Ended,
}

/// Blocks that the tolerance ended, not the number of samples.
#[derive(Clone, Copy, Default, Serialize, Deserialize)]
struct Ended {
    n: usize,
    /// Those of which the error is known, as [`Judged::n_told`] has it.
    n_known: usize,
    /// Mean square error of the worst of these.
    worst: f64,
}

/// A chapter, and rows of the table of targets; each scene is a part.
///
/// # Errors
/// If a scene cannot be sampled or baked.
pub(super) fn write(desk: &Desk) -> Result<Told> {
    let reference_spp = desk.choose(32, 256);
    let (mut rows, mut goals) = (String::new(), Goals::default());
    for name in SCENES.into_iter().take(desk.choose(1, SCENES.len())) {
        let part = || of_scene(desk, name, reference_spp);
        let found: Vec<Vec<Found>> = desk.part("targets", &format!("bakes of {name}"), part)?;
        rows += &WAYS.into_iter().zip(&found).map(|(way, found)| row(name, way, found)).collect::<String>();
        add_goals(&mut goals, name, &found);
    }
    let film = paper::sampling(desk, reference_spp).film;
    let text = format!(
        "\n### Errors and seams of bakes\n\n\
         Bakes of {} × {} pixels and 256 columns as they are made by default, noise taken out between pixels included, with the seeds {}: all samples taken, or blocks done\n\
         once they are as exact as asked. They are held against two references of {reference_spp} samples per pixel each (both halves of seed {}), neither compressed nor denoised. A block's error is the mean of (x − a)(x − b) over its entries, and steps of it\n\
         from pixel to pixel are multiplied alike, so that noise of the references does not count; each column in the scale that bakes tell their errors in, lights that are seen left out. Told: blocks of all seeds that tell their error to between\n\
         0.8 and 1.25 of it, root mean square, of those whose error is known; hidden are those whose error is less than the noise of the mean of both references, the mean of (a − b)² / 4. dB and seams are of all\n\
         blocks, median (least…greatest) of the seeds; \"—\" where noise of the references is all that there is: where an error is less than its standard error over the pixels, or steps are less than nothing. How well errors are told is judged where {LEAST_KNOWN} blocks of a scene are known, and seams\n\
         by each way of which they are known; below {LEAST_DB} dB they can be missed, but not kept, as noise within blocks is what steps at borders are held against.\n\
         Worst: the error in dB of the worst block of all seeds that the tolerance ended and whose error is known, and of how many that it ended it is known; aimed at is no more than {WORST_BELOW_DB} dB below what was asked for. The tolerance ended a block where neither half took\n\
         all of its samples: halves that go on take twice as many at each look, so that such a block took no more than half of all. A single block can miss that aim; it is called kept only where {LEAST_KNOWN} are known.\n\n\
         | scene | samples | asked for | dB | worst | told | hidden | seams |\n|---|---|---|---|---|---|---|---|\n{rows}",
        film.width,
        film.height,
        listed(seeds(desk)),
        paper::SEED,
    );
    Ok((text, goals))
}

fn seeds(desk: &Desk) -> &'static [u64] {
    &SEEDS[..desk.choose(1, SEEDS.len())]
}

/// Bakes of a scene in each way, one with each seed.
fn of_scene(desk: &Desk, name: &str, reference_spp: u32) -> Result<Vec<Vec<Found>>> {
    let path = desk.root.join(format!("assets/scenes/{name}.glb"));
    let sampling = paper::sampling(desk, reference_spp);
    let references = own::halves(desk, &path, None, (sampling, paper::SEED))?;
    let imported = import::load(&path).with_context(|| format!("cannot load the scene {}", path.display()))?;
    let scene = Arc::new(PreparedScene::new(imported.scene, &[])?.0);
    let bake = |(spp, asked_db): Way, seed: u64| -> Result<Found> {
        desk.say(&format!("baking {name} with {spp} samples per pixel, seed {seed}"));
        let tolerance_db = asked_db.unwrap_or(NO_TOLERANCE_DB);
        let config = BakeConfig { spp, tolerance_db, seed, ..BakeConfig::default() };
        Ok(Found::new(&baked(&scene, sampling.film, config)?.1, &references))
    };
    let with_seeds = |way: Way| seeds(desk).iter().map(|&seed| bake(way, seed)).collect::<Result<Vec<Found>>>();
    WAYS.into_iter().map(with_seeds).collect()
}

impl Found {
    fn new(bake: &Bake, references: &[Picture; 2]) -> Found {
        let (entries, header) = (own::scattered(bake), &bake.header);
        let [a, b] = references.each_ref().map(|reference| differences(&entries, reference, &header.column_scale));
        let told = bake.error_maps().total;
        let told = told.into_iter().map(|db| db.map_or(0.0, |db| 10f64.powf(-0.1 * f64::from(db)))).collect();
        let judged = Judged::of_errors([&a, &b], &header.partition(), told);
        let ended = ended_by_tolerance(bake);
        let (n_known, worst) = judged.worst_known(&ended);
        Found {
            db: Some(judged.mean_square()).filter(|square| *square > 0.0).map(decibels),
            is_noise: is_noise([&a, &b]),
            n_told: judged.n_told(),
            seams: Some(judged.seams).filter(|seams| seams.is_finite()),
            ended: Ended { n: ended.len(), n_known, worst },
        }
    }
}

/// Blocks of which neither half took all of its samples. Halves take twice as many at each look: that both ended before adds up to no more
/// than all of one, while one that went on to the end has these alone.
fn ended_by_tolerance(bake: &Bake) -> Vec<usize> {
    let of_half = (bake.header.config.spp / 2) as f32;
    let samples = bake.block_map(BlockMap::Samples).into_iter().enumerate();
    samples.filter(|(_, samples)| samples.is_some_and(|n| n <= of_half)).map(|(block_idx, _)| block_idx).collect()
}

impl Ended {
    /// Of all bakes of a way.
    fn of(found: &[Found]) -> Ended {
        found.iter().fold(Ended::default(), |sum, Found { ended, .. }| Ended {
            n: sum.n + ended.n,
            n_known: sum.n_known + ended.n_known,
            worst: sum.worst.max(ended.worst),
        })
    }

    fn words(&self) -> String {
        let Ended { n, n_known, worst } = self;
        let db = if *n_known > 0 { format!("{:.1}", decibels(*worst)) } else { "—".into() };
        format!("{db}, {n_known} of {n}")
    }
}

/// Entries less those of a reference, times the scale of their columns.
fn differences(entries: &Picture, reference: &Picture, column_scale: &[f32]) -> Picture {
    let mut values = entries.values.clone();
    let rows = values.chunks_exact_mut(entries.n_cols).zip(reference.values.chunks_exact(entries.n_cols));
    for (row, reference) in rows {
        row.iter_mut().zip(reference).zip(column_scale).for_each(|((x, a), scale)| *x = (*x - a) * scale);
    }
    Picture { values, ..*entries }
}

/// Blocks of some bakes: those that tell their error well, those of which it is known, and all.
fn n_told<'a>(found: impl Iterator<Item = &'a Found>) -> [usize; 3] {
    found.fold([0; 3], |sum: [usize; 3], found| std::array::from_fn(|nth| sum[nth] + found.n_told[nth]))
}

fn dbs(found: &[Found]) -> Vec<Option<f64>> {
    found.iter().map(|found| found.db).collect()
}

/// Of those that are more than their standard errors.
fn known_dbs(found: &[Found]) -> Vec<Option<f64>> {
    found.iter().map(|found| found.db.filter(|_| !found.is_noise)).collect()
}

/// Seams of some bakes; `None` where one of them is not known.
fn seams(found: &[Found]) -> Option<Vec<f64>> {
    found.iter().map(|found| found.seams).collect()
}

/// Median seams of the bakes of a way, and whether they say something; `None` where they are not known.
fn judged_seams(found: &[Found]) -> Option<(f64, bool)> {
    let seams = median(&seams(found)?)?;
    let db = dbs(found).into_iter().collect::<Option<Vec<f64>>>().and_then(|dbs| median(&dbs));
    // Errors that are not known are less than the noise of the references.
    Some((seams, seams > SEAMS || db.is_none_or(|db| db >= LEAST_DB)))
}

/// Bakes of one way, with all seeds.
fn row(name: &str, (spp, asked_db): Way, found: &[Found]) -> String {
    let [well, known, all] = n_told(found.iter());
    format!(
        "| {name} | {spp} | {} | {} | {} | {well} of {known} | {} of {all} | {} |\n",
        asked_db.map_or("all samples".into(), |db| format!("{db} dB")),
        tenths_known(&known_dbs(found)),
        asked_db.map_or("—".into(), |_| Ended::of(found).words()),
        all - known,
        seams(found).map_or("—".into(), hundredths),
    )
}

/// What is judged of a scene: blocks of all its bakes together, seams in that of the ways of which they are known that has the greatest, and
/// the worst block where dB were asked for.
fn add_goals(goals: &mut Goals, name: &str, ways: &[Vec<Found>]) {
    let what = format!("errors that the halves tell to 0.8 … 1.25, %, bakes of `{name}`");
    let [well, known, _] = n_told(ways.iter().flatten());
    let share = 100.0 * well as f64 / known as f64;
    let words = format!("{share:.1}, {well} of {known}");
    match known {
        0 => goals.figure(what, HIDDEN, "—".into()),
        1..LEAST_KNOWN => goals.figure(what, "too few blocks are known", words),
        _ => goals.at_least(what, TOLD, share, words),
    }
    let what = format!("seams, bakes of `{name}`");
    let of_ways: Vec<(f64, bool)> = ways.iter().filter_map(|found| judged_seams(found)).collect();
    let words = of_ways.iter().map(|(seams, _)| format!("{seams:.2}")).collect::<Vec<_>>().join(", ");
    let judged = of_ways.iter().filter(|(_, says)| *says).map(|(seams, _)| *seams);
    match judged.reduce(f64::max) {
        Some(greatest) => goals.at_most(what, SEAMS, greatest, words),
        None if of_ways.is_empty() => goals.figure(what, HIDDEN, "—".into()),
        None => goals.figure(what, "too noisy to judge", words),
    }
    for ((_, asked_db), found) in WAYS.into_iter().zip(ways) {
        if let Some(asked_db) = asked_db {
            add_worst(goals, (name, f64::from(asked_db)), Ended::of(found));
        }
    }
}

/// No block that the tolerance ended is aimed to be far off.
fn add_worst(goals: &mut Goals, (name, asked_db): (&str, f64), ended: Ended) {
    let what = format!("worst block that the tolerance ended, dB, bakes of `{name}` asked for {asked_db} dB");
    let (least_db, worst_db) = (asked_db - WORST_BELOW_DB, decibels(ended.worst));
    match ended {
        Ended { n: 0, .. } => goals.figure(what, "cannot be judged: it ended none", "—".into()),
        Ended { n_known: 0, .. } => goals.figure(what, HIDDEN, ended.words()),
        Ended { n_known, .. } if n_known < LEAST_KNOWN && worst_db >= least_db => {
            goals.figure(what, "too few blocks are known", ended.words());
        }
        _ => goals.at_least(what, least_db, worst_db, ended.words()),
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use clerestory_transport::camera::Film;

    use super::*;

    fn found(db: f64, n_told: [usize; 3], seams: Option<f64>) -> Found {
        Found { db: Some(db), is_noise: false, n_told, seams, ended: Ended::default() }
    }

    /// So many blocks that the tolerance ended, so many of which are known, the worst of them at so many dB.
    fn with_ended([n, n_known]: [usize; 2], worst_db: f64) -> Found {
        let worst = 10f64.powf(-0.1 * worst_db);
        Found { ended: Ended { n, n_known, worst }, ..found(35.0, [10, 12, 12], Some(1.1)) }
    }

    #[test]
    fn blocks_of_all_seeds_count_together_and_hidden_ones_apart() {
        let of_seeds = [found(30.0, [9, 12, 12], Some(1.1)), found(32.0, [8, 10, 12], Some(1.3))];
        let words = row("diffuse", WAYS[1], &of_seeds);
        assert_eq!(
            words,
            "| diffuse | 64 | 35 dB | 31.0 (30.0…32.0) | —, 0 of 0 | 17 of 22 | 2 of 24 | 1.20 (1.10…1.30) |\n"
        );
        let hidden = Found { db: None, is_noise: true, ..found(0.0, [0, 0, 12], None) };
        let words = row("mixed", WAYS[0], &[hidden]);
        assert_eq!(words, "| mixed | 16 | all samples | — | — | 0 of 0 | 12 of 12 | — |\n");
        let noisy = Found { is_noise: true, ..found(50.0, [0, 1, 12], None) };
        let words = row("mixed", WAYS[0], &[found(50.0, [1, 1, 12], None), noisy]);
        assert_eq!(words, "| mixed | 16 | all samples | — | — | 1 of 2 | 22 of 24 | — |\n");
        let words = row("mixed", WAYS[1], &[with_ended([12, 10], 33.0), with_ended([11, 9], 32.0)]);
        assert!(words.contains(" | 32.0, 19 of 23 | "), "{words}");
    }

    #[test]
    fn the_worst_block_that_the_tolerance_ended_is_judged_where_it_is_known() {
        let told = |found: Vec<Found>| {
            let mut goals = Goals::default();
            add_goals(&mut goals, "mixed", &[Vec::new(), found]);
            goals.rows.pop().map(|[what, goal, ours, verdict, _]| {
                assert!(what.starts_with("worst block"), "{what}");
                [goal, ours, verdict]
            })
        };
        let words = |found: Vec<Found>| told(found).expect("a row");
        let kept = words(vec![with_ended([12, 7], 33.0), with_ended([12, 5], 31.5)]);
        assert_eq!(kept, ["≥ 31", "31.5, 12 of 24", "kept"]);
        assert_eq!(words(vec![with_ended([12, 12], 30.9)]), ["≥ 31", "30.9, 12 of 12", "**missed**"]);
        // A single block misses it, but does not keep it.
        assert_eq!(words(vec![with_ended([1, 1], 30.9)]), ["≥ 31", "30.9, 1 of 1", "**missed**"]);
        assert_eq!(words(vec![with_ended([12, 11], 33.0)]), ["too few blocks are known", "33.0, 11 of 12", "—"]);
        let hidden = Found { ended: Ended { n: 12, n_known: 0, worst: 0.0 }, ..found(35.0, [10, 12, 12], None) };
        assert_eq!(words(vec![hidden]), ["less than the noise of the references", "—, 0 of 12", "—"]);
        let none = words(vec![found(35.0, [10, 12, 12], None)]);
        assert_eq!(none, ["cannot be judged: it ended none", "—", "—"]);
    }

    #[test]
    fn a_scene_is_judged_by_all_its_blocks_and_by_the_greater_seams() {
        let told = |ways: &[Vec<Found>]| {
            let mut goals = Goals::default();
            add_goals(&mut goals, "mixed", ways);
            goals.rows.into_iter().map(|[_, goal, ours, verdict, _]| [goal, ours, verdict]).collect::<Vec<_>>()
        };
        let both = [vec![found(30.0, [10, 10, 12], Some(1.1))], vec![found(35.0, [8, 10, 12], Some(1.25))]];
        let words = told(&both);
        assert_eq!(words[0], ["≥ 90", "90.0, 18 of 20", "kept"]);
        assert_eq!(words[1], ["≤ 1.2", "1.10, 1.25", "**missed**"]);
        let hidden = told(&[vec![found(60.0, [0, 0, 12], None)]]);
        let nothing = ["less than the noise of the references", "—", "—"];
        assert_eq!(hidden, [nothing, nothing]);
        // Seams of the way that is known count, and few blocks are no verdict.
        let half_hidden = told(&[vec![found(30.0, [5, 11, 12], Some(1.3))], vec![found(60.0, [0, 0, 12], None)]]);
        assert_eq!(half_hidden[0], ["too few blocks are known", "45.5, 5 of 11", "—"]);
        assert_eq!(half_hidden[1], ["≤ 1.2", "1.30", "**missed**"]);
    }

    #[test]
    fn bakes_full_of_noise_never_keep_their_seams() {
        let verdict = |db: f64, seams: f64| {
            let mut goals = Goals::default();
            add_goals(&mut goals, "mixed", &[vec![found(db, [10, 12, 12], Some(seams))]]);
            goals.rows.pop().map(|[_, goal, _, verdict, _]| [goal, verdict]).unwrap()
        };
        assert_eq!(verdict(25.0, 0.4), ["≤ 1.2", "kept"]);
        assert_eq!(verdict(14.0, 0.4), ["too noisy to judge", "—"]);
        assert_eq!(verdict(14.0, 1.3), ["≤ 1.2", "**missed**"]);
    }

    #[test]
    fn errors_of_a_bake_are_in_the_scale_that_it_tells_them_in() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/scenes/diffuse.glb");
        let scene = Arc::new(PreparedScene::new(import::load(&path).unwrap().scene, &[]).unwrap().0);
        let config = BakeConfig { spp: 2, ..BakeConfig::default() };
        let bake = baked(&scene, Film { width: 16, height: 16 }, config).unwrap().1;
        // All columns are off by a tenth of their peaks.
        let off = || {
            let mut entries = own::scattered(&bake);
            for row in entries.values.chunks_exact_mut(entries.n_cols) {
                row.iter_mut().zip(&bake.header.column_scale).for_each(|(x, scale)| *x += 0.1 / scale);
            }
            entries
        };
        let found = Found::new(&bake, &[off(), off()]);
        assert!((found.db.unwrap() - 20.0).abs() < 0.01, "{:?} dB", found.db);
        assert_eq!((found.n_told[1..].to_vec(), found.seams), (vec![1, 1], None));
        assert_eq!(found.ended.n, 0, "its block took all samples");
    }

    #[test]
    fn blocks_of_which_a_half_took_all_samples_were_not_ended_by_the_tolerance() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/scenes/diffuse.glb");
        let scene = Arc::new(PreparedScene::new(import::load(&path).unwrap().scene, &[]).unwrap().0);
        let config = BakeConfig { spp: 64, tolerance_db: 10.0, ..BakeConfig::default() };
        let mut bake = baked(&scene, Film { width: 32, height: 16 }, config).unwrap().1;
        assert_eq!(ended_by_tolerance(&bake), [0, 1], "10 dB are reached long before");
        // One half ended at its first look, the other one went on to the end.
        for group in &mut bake.groups {
            let block = group.blocks[1].as_mut().expect("a block");
            Arc::make_mut(block).n_samples = 4 + 32;
        }
        assert_eq!(ended_by_tolerance(&bake), [0]);
    }
}
