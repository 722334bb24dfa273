//! The ratio at a tolerance: blocks of the scenes of the method's evaluation, with as many samples as some minutes allow.

use std::time::Duration;

use anyhow::{Context, Result};
use clerestory_nystrom::Partition;
use clerestory_nystrom::rivals::Method;
use clerestory_transport::camera::Film;
use serde::{Deserialize, Serialize};

use super::traced::{Asked, Found, HEAD, Limits, MOST_RANK, RIVAL_RANK, Row, Singular, Traced, rows, with_matrix};
use super::{Goals, SLACK_DB, Told, rconds, rconds_words};
use crate::desk::Desk;
use crate::fit::{listed, wholes};
use crate::methods::dense::TILE;

pub const FILM: Film = Film { width: 512, height: 384 };
const SIDE: u32 = 16;
const TOLERANCE_DB: f64 = 40.0;
/// Every so manyth block is traced: a number that leads to all parts of rows of 32 blocks.
const STEP: usize = 47;
/// Samples of each half, and seconds of the clock for a scene.
const FIRST: u32 = 16;
const MOST: [u32; 2] = [16, 2048];
const SECS: [u64; 2] = [4, 180];
/// Scenes, and seeds of the walks: more than one where a tolerance takes few of them.
const SCENES: [(&str, &[u64]); 4] =
    [("diffuse", &[1, 2, 3]), ("reflections", &[1]), ("caustics", &[1]), ("mixed", &[1])];
/// Seeds of k-means where those of the walks do not vary.
const SEEDS: &[u64] = &[1, 2, 3];
/// Ratios that are aimed at: on the scene that has the least, and on the others.
const AIMS: [f64; 2] = [200.0, 300.0];

/// What was found of a scene.
#[derive(Serialize, Deserialize)]
struct OfScene {
    name: String,
    n_blocks: usize,
    /// Blocks whose samples or time ran out, and the samples of a pixel that were allowed at the end.
    n_open: usize,
    most_spp: u32,
    /// Samples of a pixel, mean and most, with each seed.
    spp: [Vec<f64>; 2],
    rows: Vec<Row>,
}

impl OfScene {
    fn ours(&self) -> Option<&Found> {
        self.rows.first().and_then(Row::middle)
    }
}

/// A chapter, and rows of the table of targets; each scene is a part.
///
/// # Errors
/// If a scene cannot be loaded.
pub(super) fn write(desk: &Desk) -> Result<Told> {
    let mut scenes: Vec<OfScene> = Vec::new();
    for (name, seeds) in SCENES.into_iter().take(desk.choose(1, SCENES.len())) {
        let seeds = &seeds[..desk.choose(1, seeds.len())];
        scenes.push(desk.part("targets", &format!("{name} at 40 dB"), || of_scene(desk, name, seeds))?);
    }
    let n_blocks = scenes.iter().map(|scene| scene.n_blocks).max().unwrap_or(0);
    let mut text = format!(
        "\n### Ratios at {TOLERANCE_DB} dB\n\n\
         Every {}th block of {} × {} pixels, {n_blocks} of them all over the picture, {} columns, traced as a bake traces them, with twice as many samples again and again until both halves call\n\
         each other's enough for {TOLERANCE_DB} dB, at most {} per pixel, and no more once half of {} s is over. All methods get the same samples, and are packed as a bake is; the noise of neighbors is not\n\
         taken out. Errors as both halves tell them, of ours and of others alike; the ratio is that of a whole picture of such blocks, what a file has once counted whole (its header aside); it is tested where no more than {SLACK_DB} dB are lacking. `svd` is the best there is\n\
         at equal rank of what was sampled: like the others it knows no noise from signal. Algorithm 4 has that threshold of {} that suits it best; ranks of it and of `row-id` end at {RIVAL_RANK}, as in bakes. Median (least…greatest)\n\
         of the seeds {} of the walks where more than one is told with ours, else of k-means; samples that were allowed at the end, and the blocks that took all of them, are the most of these seeds.\n\n\
         | scene | {HEAD}|---|---|---|---|---|---|---|---|---|\n",
        step(desk),
        FILM.width,
        FILM.height,
        SIDE * SIDE,
        2 * desk.choose(MOST[0], MOST[1]),
        desk.choose(SECS[0], SECS[1]),
        rconds_words(rconds(desk)),
        listed(&SEEDS[..desk.choose(1, SEEDS.len())]),
    );
    for scene in &scenes {
        let row = |row: &Row| format!("| {} | {}", scene.name, row.cells(scene.n_blocks, TOLERANCE_DB));
        text += &scene.rows.iter().map(row).collect::<String>();
    }
    text += "\n| scene | samples per pixel, mean | most | allowed at the end | blocks that took all of them |\n|---|---|---|---|---|\n";
    for OfScene { name, n_blocks, n_open, most_spp, spp: [mean, most], .. } in &scenes {
        let [mean, most] = [mean, most].map(|all| wholes(all.clone()));
        text += &format!("| {name} | {mean} | {most} | {most_spp} | {n_open} of {n_blocks} |\n");
    }
    Ok((text, goals(&scenes)?))
}

fn step(desk: &Desk) -> usize {
    desk.choose(8 * STEP, STEP)
}

/// Traces a scene with each seed and asks all methods.
fn of_scene(desk: &Desk, name: &str, seeds: &[u64]) -> Result<OfScene> {
    let partition = Partition { width: FILM.width, height: FILM.height, tile: TILE as u32 };
    let blocks = every(&partition, step(desk));
    let time = Duration::from_secs(desk.choose(SECS[0], SECS[1]));
    let limits = Limits { first: FIRST, most: desk.choose(MOST[0], MOST[1]), time };
    let mut all: Option<OfScene> = None;
    let mut rconds = rconds(desk).to_vec();
    for &seed in seeds {
        desk.say(&format!("tracing blocks of {name} to {TOLERANCE_DB} dB, seed {seed}"));
        let traced = with_matrix(desk, (name, SIDE), (FILM, seed), |matrix| {
            Traced::new(matrix, (&partition, &blocks), TOLERANCE_DB, limits)
        })?;
        let by_seed = [seed];
        let seeds = if seeds.len() > 1 || desk.quick { &by_seed[..] } else { SEEDS };
        let asked = Asked {
            tolerance_db: TOLERANCE_DB,
            rconds: &rconds,
            seeds,
            others: &[Method::RowId],
            rival_rank: RIVAL_RANK,
        };
        let singular = Singular::new(&traced, MOST_RANK)?;
        let (rows, rcond) = rows(desk, (name, &traced), &singular, &asked)?;
        rconds = vec![rcond];
        let spp = traced.spp();
        match &mut all {
            None => {
                all = Some(OfScene {
                    name: name.into(),
                    n_blocks: traced.blocks.len(),
                    n_open: traced.n_open,
                    most_spp: 2 * traced.most,
                    spp: spp.map(|value| vec![value]),
                    rows,
                });
            }
            Some(all) => {
                all.n_open = all.n_open.max(traced.n_open);
                all.most_spp = all.most_spp.max(2 * traced.most);
                all.spp.iter_mut().zip(spp).for_each(|(all, value)| all.push(value));
                all.rows.iter_mut().zip(rows).for_each(|(all, row)| all.extend(row));
            }
        }
    }
    all.context("a scene is traced with at least one seed")
}

/// Every so manyth block of a picture, the first after half of that.
pub fn every(partition: &Partition, step: usize) -> Vec<u32> {
    (step / 2..partition.n_blocks()).step_by(step).map(|block_idx| block_idx as u32).collect()
}

/// Rows of the table of targets: the scene of the least ratio is asked for less than the others.
fn goals(scenes: &[OfScene]) -> Result<Goals> {
    let ratios = scenes.iter().filter_map(OfScene::ours).map(|found| found.ratio);
    let least = ratios.fold(f64::INFINITY, f64::min);
    let mut goals = Goals::default();
    for scene in scenes {
        let found = scene.ours().with_context(|| format!("ours found nothing for the blocks of {}", scene.name))?;
        let aim = AIMS[usize::from(found.ratio > least)];
        let what = format!("dense / bytes, blocks of `{}` at {TOLERANCE_DB} dB, 256 columns", scene.name);
        let beside: Vec<String> = scene.rows[1..].iter().map(|row| row.words(words)).collect();
        let verdict = verdict(found, aim, TOLERANCE_DB);
        goals.rows.push([what, format!("≥ {aim}×"), words(found), verdict, beside.join(", ")]);
    }
    Ok(goals)
}

/// A ratio, and the error that it comes with.
pub fn words(found: &Found) -> String {
    format!("{:.0}× at {:.1} dB", found.ratio, found.db)
}

/// The verdict on what was not reached at its error.
pub const SHORT: &str = "not tested: short of the dB";

/// Whether more is lacking of a tolerance than counts for any method.
pub fn is_short(found: &Found, tolerance_db: f64) -> bool {
    found.db < tolerance_db - SLACK_DB
}

/// Whether a ratio is kept, if it is one at the tolerance, as nearly as counts for all methods.
pub fn verdict(found: &Found, aim: f64, tolerance_db: f64) -> String {
    if is_short(found, tolerance_db) {
        return SHORT.into();
    }
    if found.ratio >= aim { "kept".into() } else { "**missed**".into() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_are_all_over_the_picture() {
        let partition = Partition { width: FILM.width, height: FILM.height, tile: TILE as u32 };
        let blocks = every(&partition, STEP);
        assert_eq!(blocks.len(), 16);
        let parts = |at: fn(&Partition, u32) -> u32, n: u32| {
            let mut count = vec![0; 4];
            blocks.iter().for_each(|&block| count[(at(&partition, block) * 4 / n) as usize] += 1);
            count
        };
        assert_eq!(parts(|partition, block| block % partition.tiles_x(), 32), [4; 4]);
        assert_eq!(parts(|partition, block| block / partition.tiles_x(), 24), [4; 4]);
    }

    #[test]
    fn a_ratio_counts_only_at_its_error_and_the_least_is_asked_for_less() {
        let scene = |name: &str, ratio: f64, db: f64| {
            let found = Found {
                db,
                worst_db: db,
                n_enough: 1,
                mean_rank: 2.0,
                block_bytes: 500.0,
                ratio,
                multiply_adds: [9.0, 5.0],
            };
            let rows = vec![Row::of("projected", vec![found.clone()]), Row::of("svd", vec![found])];
            OfScene { name: name.into(), n_blocks: 1, n_open: 0, most_spp: 64, spp: [vec![32.0], vec![64.0]], rows }
        };
        let all = [scene("diffuse", 290.0, 40.1), scene("caustics", 900.0, 39.4), scene("mixed", 250.0, 39.5)];
        let found = goals(&all).unwrap();
        let told: Vec<[&str; 3]> = found.rows.iter().map(|row| [1, 2, 3].map(|cell| row[cell].as_str())).collect();
        assert_eq!(told[0], ["≥ 300×", "290× at 40.1 dB", "**missed**"]);
        assert_eq!(told[1], ["≥ 300×", "900× at 39.4 dB", "not tested: short of the dB"]);
        assert_eq!(told[2], ["≥ 200×", "250× at 39.5 dB", "kept"]);
        assert_eq!(found.rows[2][4], "`svd` 250× at 39.5 dB");
        let failed = OfScene { rows: vec![Row::of("projected", Vec::new())], ..scene("mixed", 0.0, 0.0) };
        assert!(goals(&[failed]).is_err(), "a scene that ours fails at is not left out");
    }
}
