//! A panel of as many texels as a bake may have.

use std::time::Duration;

use anyhow::{Context, Result};
use clerestory_nystrom::Partition;
use clerestory_nystrom::rivals::{Core, Method};

use super::at_tolerance::{FILM, SHORT, every, is_short, verdict, words};
use super::coded::{Coded, Subject};
use super::traced::{Asked, Found, HEAD, Limits, MOST_RANK, RIVAL_RANK, Row, Singular, Traced, rows, with_matrix};
use super::{Goals, RCONDS, Told, cells, rconds_words, soft};
use crate::desk::Desk;
use crate::fit::listed;
use crate::methods::dense::TILE;

/// Tolerances in dB: the ratio is aimed at with the first, multiply-adds with the second.
const TOLERANCES_DB: [f64; 2] = [40.0, 45.0];
/// Ratio and multiply-adds that are aimed at.
const RATIO: f64 = 1500.0;
const MULTIPLY_ADDS: f64 = 64.0;
/// What others claim for very many texels, and between which tolerances, in dB, it is looked for how often.
const CLAIMED: f64 = 4000.0;
const BETWEEN_DB: [f64; 2] = [10.0, 52.0];
const N_HALVINGS: i32 = 6;
/// Every so manyth block that all methods get: of the sharp matrix, and of the bake.
const STEPS: [usize; 2] = [7, 61];
/// Seeds of k-means, and of the walks of the bake.
const SEEDS: &[u64] = &[0, 1, 2];
const WALK_SEED: u64 = 1;
/// Samples of each half of the bake, and seconds of the clock.
const FIRST: u32 = 8;
const MOST: [u32; 2] = [8, 256];
const SECS: [u64; 2] = [4, 120];
/// Head of a table of what is so many times smaller.
const CLAIMED_HEAD: &str =
    "| method | asked for | dB | worst block | dense / bytes | mean rank |\n|---|---|---|---|---|---|\n";

/// Texels along a side of the panel.
fn side(desk: &Desk) -> u32 {
    desk.choose(32, 64)
}

/// Points behind balls: the hardest shadows that there are.
pub(super) fn sharp(desk: &Desk) -> Result<Told> {
    let side = side(desk) as usize;
    let subject = Subject::new(soft::picture(128, 96, side), None);
    let n_cols = side * side;
    let (mut all_rows, mut goals) = (String::new(), Goals::default());
    let frame = Partition { width: FILM.width, height: FILM.height, tile: TILE as u32 };
    let blocks = every(&subject.truth.partition(), desk.choose(4 * STEPS[0], STEPS[0]));
    let traced = Traced::of_picture(&subject.truth, &blocks, frame.n_blocks());
    let singular = Singular::new(&traced, MOST_RANK)?;
    let tried = &RCONDS[..desk.choose(1, 2)];
    let (mut some_rows, mut rconds) = (String::new(), tried.to_vec());
    for (target_db, seeds) in TOLERANCES_DB.into_iter().zip(seeds(desk)) {
        desk.say(&format!("{n_cols} columns, sharp shadows, at {target_db} dB"));
        let coded = subject.coded(Method::Projected, target_db)?;
        all_rows += &format!("| {target_db} dB {}\n", cells(&subject, target_db, &coded));
        // Without noise no rank is in the way.
        let (others, rival_rank) = (&[Method::RowId], MOST_RANK);
        let asked = Asked { tolerance_db: target_db, rconds: &rconds, seeds, others, rival_rank };
        let (found, rcond) = rows(desk, ("sharp shadows", &traced), &singular, &asked)?;
        rconds = vec![rcond];
        some_rows += &table_rows(&found, traced.blocks.len(), target_db);
        sharp_goals(&mut goals, (&coded, &found), n_cols, target_db);
    }
    let claimed = claimed(desk, ("sharp shadows", &traced), &singular)?;
    goals.rows.push(claimed_goal("sharp shadows", n_cols, &claimed));
    let shared = 128 * n_cols * 2;
    let dense = subject.truth.values.len() * 4;
    let text = format!(
        "\n### {n_cols} columns, sharp shadows\n\n\
         A floor and a wall of colored squares under a panel of {side} × {side} texels with three balls between, direct light, 128 × 96 pixels; texels are\n\
         points, so that all shadows are sharp: harder than any bake, which the goal is about. A right basis of 128\n\
         vectors that all blocks share, in 16-bit floats, would by itself be one {:.0}th of the dense matrix.\n\n{}{all_rows}\n\
         All methods on every {}th of its blocks, {} of them; dense / bytes as of {} × {} pixels of such blocks, whose direction and tables are in each file once. Median (least…greatest)\n\
         of the seeds {} of k-means where more than one is told. Of the thresholds {} Algorithm 4 has that which suits it best at {} dB.\n\n\
         | asked for | {HEAD}|---|---|---|---|---|---|---|---|---|\n{some_rows}\n\
         The same blocks, asked for the most dB (found to within {:.1}) with which a file is {CLAIMED} times smaller:\n\n{CLAIMED_HEAD}{}",
        dense as f64 / shared as f64,
        super::HEAD.replacen("method", "asked for", 1),
        desk.choose(4 * STEPS[0], STEPS[0]),
        traced.blocks.len(),
        FILM.width,
        FILM.height,
        listed(seeds(desk)[0]),
        rconds_words(tried),
        TOLERANCES_DB[0],
        found_within_db(desk),
        claimed_rows(&claimed),
    );
    Ok((text, goals))
}

/// Blocks of a bake with area lights and the light between surfaces, which the goal is about.
pub(super) fn baked(desk: &Desk) -> Result<Told> {
    let (side, partition) = (side(desk), Partition { width: FILM.width, height: FILM.height, tile: TILE as u32 });
    let n_cols = (side * side) as usize;
    let blocks = every(&partition, desk.choose(6 * STEPS[1], STEPS[1]));
    let time = Duration::from_secs(desk.choose(SECS[0], SECS[1]));
    let limits = Limits { first: FIRST, most: desk.choose(MOST[0], MOST[1]), time };
    let [_, finest_db] = TOLERANCES_DB;
    desk.say(&format!("tracing blocks of diffuse in {n_cols} columns to {finest_db} dB"));
    let traced = with_matrix(desk, ("diffuse", side), (FILM, WALK_SEED), |matrix| {
        Traced::new(matrix, (&partition, &blocks), finest_db, limits)
    })?;
    let singular = Singular::new(&traced, RIVAL_RANK)?;
    let (mut table, mut goals) = (String::new(), Goals::default());
    for (target_db, seeds) in TOLERANCES_DB.into_iter().zip(seeds(desk)) {
        // What suits noise best is known from the noisy halves.
        let (rconds, others, rival_rank) = (&[RCONDS[0]], &[Method::RowId], RIVAL_RANK);
        let asked = Asked { tolerance_db: target_db, rconds, seeds, others, rival_rank };
        let (found, _) = rows(desk, ("diffuse in many columns", &traced), &singular, &asked)?;
        table += &table_rows(&found, traced.blocks.len(), target_db);
        baked_goals(&mut goals, &found, n_cols, target_db)?;
    }
    let claimed = claimed(desk, ("diffuse in many columns", &traced), &singular)?;
    goals.rows.push(claimed_goal("bake of `diffuse`", n_cols, &claimed));
    let [mean, most] = traced.spp();
    let text = format!(
        "\n### {n_cols} columns, a bake\n\n\
         `diffuse.glb` with {side} × {side} texels, one block in {} of {} × {} pixels, {} of them, traced as a bake traces them to {finest_db} dB: {mean:.0} samples per pixel in the mean, {most:.0} at most, of {} that were allowed\n\
         at the end; {} blocks took all of them. Walks of seed {WALK_SEED}. All else is as in the table of ratios at 40 dB above; here the ranks of `svd` end at {RIVAL_RANK}, too, beyond which it would fit nothing but noise, and Algorithm 4 has the threshold {} and at {} dB the seeds {} of k-means, at {finest_db} dB and below the table seed {}.\n\n\
         | asked for | {HEAD}|---|---|---|---|---|---|---|---|---|\n{table}\n\
         The same samples, asked for the most dB (found to within {:.1}) with which a file is {CLAIMED} times smaller:\n\n{CLAIMED_HEAD}{}",
        desk.choose(6 * STEPS[1], STEPS[1]),
        FILM.width,
        FILM.height,
        traced.blocks.len(),
        2 * traced.most,
        traced.n_open,
        RCONDS[0],
        TOLERANCES_DB[0],
        listed(seeds(desk)[0]),
        SEEDS[0],
        found_within_db(desk),
        claimed_rows(&claimed),
    );
    Ok((text, goals))
}

/// Seeds of k-means with each tolerance: several where that costs little.
fn seeds(desk: &Desk) -> [&'static [u64]; 2] {
    [&SEEDS[..desk.choose(1, SEEDS.len())], &SEEDS[..1]]
}

fn table_rows(found: &[Row], n_blocks: usize, tolerance_db: f64) -> String {
    found.iter().map(|row| format!("| {tolerance_db} dB | {}", row.cells(n_blocks, tolerance_db))).collect()
}

/// Rows of the table of targets; ours is of all blocks, what is beside it of some.
fn sharp_goals(goals: &mut Goals, (coded, found): (&Coded, &[Row]), n_cols: usize, target_db: f64) {
    let at = format!("{n_cols} columns, sharp shadows, at {target_db} dB");
    if target_db == TOLERANCES_DB[0] {
        let ours = format!("{:.0}×{}", coded.ratio, on_theirs(found, words));
        goals.at_least(format!("dense / bytes, {at}"), RATIO, coded.ratio, ours);
        goals.beside(beside(found, words));
    }
    let [unpacked, in_cosines] = coded.multiply_adds;
    let ours = format!("{unpacked:.0} / {in_cosines:.0}{}", on_theirs(found, multiply_adds));
    goals.at_most(format!("multiply-adds, as unpacked / in cosines, {at}"), MULTIPLY_ADDS, unpacked, ours);
    goals.beside(beside(found, multiply_adds));
}

fn baked_goals(goals: &mut Goals, found: &[Row], n_cols: usize, target_db: f64) -> Result<()> {
    let ours = found.first().and_then(Row::middle).context("ours found nothing for blocks of many columns")?;
    let at = format!("{n_cols} columns, blocks of `diffuse` at {target_db} dB");
    if target_db == TOLERANCES_DB[0] {
        let verdict = verdict(ours, RATIO, target_db);
        let what = format!("dense / bytes, {at}");
        goals.rows.push([what, format!("≥ {RATIO}"), words(ours), verdict, beside(found, words)]);
        return Ok(());
    }
    // All methods are packed alike, so that others have right factors in cosines, too.
    let as_unpacked: Figure = |found| format!("{:.0}", found.multiply_adds[0]);
    let in_cosines: Figure = |found| format!("{:.0}", found.multiply_adds[1]);
    for (nth, (how, figure)) in [("as unpacked", as_unpacked), ("in cosines", in_cosines)].into_iter().enumerate() {
        goals.at_most(format!("multiply-adds {how}, {at}"), MULTIPLY_ADDS, ours.multiply_adds[nth], figure(ours));
        if is_short(ours, target_db) {
            goals.not_tested(SHORT);
        }
        goals.beside(beside(found, figure));
    }
    Ok(())
}

/// A figure of a row, in words.
type Figure = fn(&Found) -> String;

/// A figure of ours on those blocks that the others have, in words.
fn on_theirs(found: &[Row], value: Figure) -> String {
    found.first().map_or(String::new(), |ours| format!(", on the blocks of the others {}", ours.words(value)))
}

/// Figures of all methods but ours, in words.
fn beside(found: &[Row], value: Figure) -> String {
    found[1..].iter().map(|row| row.words(value)).collect::<Vec<_>>().join(", ")
}

fn multiply_adds(found: &Found) -> String {
    let [unpacked, in_cosines] = found.multiply_adds;
    format!("{unpacked:.0} / {in_cosines:.0}")
}

/// A method, and the most dB that it can be asked for where a file is as small as others claim; none where it is not at any, and why
/// where it has no answer.
type Claimed = (String, Result<Option<(f64, Found)>>);

fn n_halvings(desk: &Desk) -> i32 {
    desk.choose(2, N_HALVINGS)
}

/// By how many dB at most what is found by halving is less than it could be.
fn found_within_db(desk: &Desk) -> f64 {
    (BETWEEN_DB[1] - BETWEEN_DB[0]) * 0.5f64.powi(n_halvings(desk))
}

/// Ours, the best there is, Algorithm 4, and chosen rows.
fn claimed(desk: &Desk, (name, traced): (&str, &Traced), singular: &Singular) -> Result<Vec<Claimed>> {
    let n_halvings = n_halvings(desk);
    let mut all = Vec::new();
    let fourth = Method::Alg4(Core::PseudoInverse { rcond: RCONDS[0] });
    for method in [Method::Projected, Method::Svd, fourth, Method::RowId] {
        desk.say(&format!("{method} on {name}, {CLAIMED} times smaller"));
        let found = finest(CLAIMED, n_halvings, |tolerance_db| {
            let found = match method {
                Method::Svd => singular.found(traced, tolerance_db)?,
                Method::Projected => traced.found((method, SEEDS[0]), MOST_RANK, tolerance_db)?,
                _ => traced.found((method, SEEDS[0]), RIVAL_RANK, tolerance_db)?,
            };
            Ok((found.ratio, found))
        });
        let found = match found {
            Err(error) if method == Method::Projected => return Err(error),
            // Of others a row tells why, as where all methods are asked for a tolerance.
            found => found,
        };
        all.push((method.to_string(), found));
    }
    Ok(all)
}

/// The most dB that can be asked for with at least a ratio, which falls as they grow: by halving what is between two of them.
fn finest<T>(ratio: f64, n_halvings: i32, mut probe: impl FnMut(f64) -> Result<(f64, T)>) -> Result<Option<(f64, T)>> {
    let ([mut low, mut high], mut finest) = (BETWEEN_DB, None);
    for _ in 0..n_halvings {
        let middle = f64::midpoint(low, high);
        let (reached, found) = probe(middle)?;
        if reached >= ratio {
            (low, finest) = (middle, Some((middle, found)));
        } else {
            high = middle;
        }
    }
    Ok(finest)
}

fn claimed_rows(claimed: &[Claimed]) -> String {
    let row = |(name, found): &Claimed| match found {
        Err(error) => format!("| `{name}` | {error:#} | | | | |\n"),
        Ok(None) => format!("| `{name}` | at no tolerance | | | | |\n"),
        Ok(Some((asked_db, found))) => format!(
            "| `{name}` | {asked_db:.1} dB | {:.1} | {:.1} | {:.0}× | {:.2} |\n",
            found.db, found.worst_db, found.ratio, found.mean_rank
        ),
    };
    claimed.iter().map(row).collect()
}

/// A figure of the table of targets without a verdict: nothing was aimed at.
fn claimed_goal(of: &str, n_cols: usize, claimed: &[Claimed]) -> [String; 5] {
    let words = |found: &Result<Option<(f64, Found)>>| match found {
        Ok(Some((_, found))) => format!("{:.1}", found.db),
        Ok(None) | Err(_) => "none".into(),
    };
    let beside: Vec<String> = claimed[1..].iter().map(|(name, found)| format!("`{name}` {}", words(found))).collect();
    let what = format!("dB where a file is {CLAIMED} times smaller, as others claim, {n_cols} columns, {of}");
    [what, "—".into(), words(&claimed[0].1), "—".into(), beside.join(", ")]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn multiplications_as_unpacked_and_in_cosines_are_beside_their_like() {
        let found = |multiply_adds: [f64; 2]| {
            let (db, worst_db, mean_rank, block_bytes) = (45.0, 42.0, 2.0, 500.0);
            vec![Found { db, worst_db, n_enough: 1, mean_rank, block_bytes, ratio: 900.0, multiply_adds }]
        };
        let rows = [Row::of("projected", found([90.0, 50.0])), Row::of("svd", found([80.0, 40.0]))];
        let mut goals = Goals::default();
        baked_goals(&mut goals, &rows, 4096, 45.0).unwrap();
        let told: Vec<[&str; 3]> = goals.rows.iter().map(|row| [2, 3, 4].map(|cell| row[cell].as_str())).collect();
        assert_eq!(told, [["90", "**missed**", "`svd` 80"], ["50", "kept", "`svd` 40"]]);
        let rows = [Row::of("projected", vec![Found { db: 44.4, ..found([50.0, 40.0]).remove(0) }])];
        let mut goals = Goals::default();
        baked_goals(&mut goals, &rows, 4096, 45.0).unwrap();
        assert!(goals.rows.iter().all(|row| row[3] == "not tested: short of the dB"), "{:?}", goals.rows);
    }

    #[test]
    fn a_method_without_an_answer_is_told_beside_the_claim() {
        let (db, worst_db, mean_rank, block_bytes, multiply_adds) = (30.0, 27.0, 2.0, 500.0, [9.0, 5.0]);
        let found = Found { db, worst_db, n_enough: 1, mean_rank, block_bytes, ratio: 4010.0, multiply_adds };
        let claimed: [Claimed; 3] = [
            ("projected".into(), Ok(Some((31.0, found)))),
            ("svd".into(), Ok(None)),
            ("row-id".into(), Err(anyhow::anyhow!("no inverse"))),
        ];
        let rows = "| `projected` | 31.0 dB | 30.0 | 27.0 | 4010× | 2.00 |\n\
            | `svd` | at no tolerance | | | | |\n| `row-id` | no inverse | | | | |\n";
        assert_eq!(claimed_rows(&claimed), rows);
        let [_, _, ours, _, beside] = claimed_goal("sharp shadows", 4096, &claimed);
        assert_eq!([ours.as_str(), beside.as_str()], ["30.0", "`svd` none, `row-id` none"]);
    }

    #[test]
    fn the_finest_tolerance_that_leaves_a_file_small_enough_is_found() {
        // A tenth of the ratio for each 20 dB: 4000 at 27.96 dB.
        let mut asked = Vec::new();
        let found = finest(4000.0, 8, |db| {
            asked.push(db);
            let ratio = 10f64.powf(5.0 - db / 20.0);
            Ok((ratio, ratio))
        });
        let (db, ratio) = found.unwrap().unwrap();
        assert!((27.7..=27.96).contains(&db) && ratio >= 4000.0, "{db} {ratio}");
        assert_eq!((asked.len(), asked[0]), (8, 31.0));
        assert!(finest(4000.0, 4, |_| Ok((3999.0, ()))).unwrap().is_none());
    }
}
