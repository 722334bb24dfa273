//! What all methods make of the same samples of some blocks of a scene that is baked.

use std::path::Path;
use std::time::Duration;

use anyhow::Result;
use clerestory_nystrom::Partition;
use clerestory_nystrom::rivals::Method;
use serde::{Deserialize, Serialize};

use super::worst_words;
use crate::desk::Desk;
use crate::fit::listed;
use crate::methods::dense::TILE;
use crate::targets::at_tolerance::{FILM, every};
use crate::targets::traced::{Asked, HEAD, Limits, MOST_RANK, RIVAL_RANK, Row, Singular, Traced, rows, with_matrix_of};
use crate::targets::{rconds, rconds_words};

/// Every so manyth block is traced, as in the ratios at 40 dB.
const STEP: usize = 47;
/// Samples of each half, and seconds of the clock.
const FIRST: u32 = 16;
const MOST: [u32; 2] = [16, 1024];
const SECS: [u64; 2] = [4, 120];
/// Of the walks.
const WALK_SEED: u64 = 1;
/// Of k-means; what draws otherwise has the first.
const SEEDS: &[u64] = &[1, 2, 3];

/// What was found of a scene.
#[derive(Serialize, Deserialize)]
pub(super) struct Beside {
    n_blocks: usize,
    /// Blocks whose samples or time ran out, and the samples of a pixel that were allowed at the end.
    n_open: usize,
    most_spp: u32,
    /// Samples of a pixel, mean and most.
    spp: [f64; 2],
    /// Thresholds that Algorithm 4 was tried with, and seeds of its k-means.
    rconds: Vec<f64>,
    seeds: Vec<u64>,
    rows: Vec<Row>,
}

/// Traces some blocks of a scene, whose panel has so many texels along a side, to a tolerance, and asks all methods.
///
/// # Errors
/// If the scene cannot be loaded, or ours finds no factors.
pub(super) fn measured(desk: &Desk, (name, path): (&str, &Path), (side, tolerance_db): (u32, f64)) -> Result<Beside> {
    let partition = Partition { width: FILM.width, height: FILM.height, tile: TILE as u32 };
    let blocks = every(&partition, desk.choose(8 * STEP, STEP));
    let time = Duration::from_secs(desk.choose(SECS[0], SECS[1]));
    let limits = Limits { first: FIRST, most: desk.choose(MOST[0], MOST[1]), time };
    desk.say(&format!("tracing blocks of {name} to {tolerance_db} dB"));
    let traced = with_matrix_of(path, side, (FILM, WALK_SEED), |matrix| {
        Traced::new(matrix, (&partition, &blocks), tolerance_db, limits)
    })?;
    let (rconds, seeds) = (rconds(desk), &SEEDS[..desk.choose(1, SEEDS.len())]);
    let asked = Asked { tolerance_db, rconds, seeds, others: &[Method::RowId], rival_rank: RIVAL_RANK };
    let singular = Singular::new(&traced, MOST_RANK)?;
    let (rows, _) = rows(desk, (name, &traced), &singular, &asked)?;
    let (n_blocks, n_open, most_spp) = (traced.blocks.len(), traced.n_open, 2 * traced.most);
    let (rconds, seeds) = (rconds.to_vec(), seeds.to_vec());
    Ok(Beside { n_blocks, n_open, most_spp, spp: traced.spp(), rconds, seeds, rows })
}

impl Beside {
    /// A chapter.
    pub(super) fn text(&self, name: &str, tolerance_db: f64) -> String {
        let Beside { n_blocks, n_open, most_spp, spp: [mean, most], rconds, seeds, rows } = self;
        let ours = rows.first().and_then(Row::middle);
        let worst = ours.map_or("none".into(), |found| worst_words(found.worst_db, tolerance_db));
        let row = |row: &Row| format!("| {}", row.cells(*n_blocks, tolerance_db));
        format!(
            "\n### All methods on blocks of `{name}`\n\n\
             {n_blocks} blocks all over the picture, traced as a bake traces them to {tolerance_db} dB, with twice as many samples again and again until both halves call each other's enough or the time is over: {mean:.0} samples\n\
             per pixel in the mean, {most:.0} at most, of {most_spp} that were allowed at the end; {n_open} blocks took all of them. All methods get the same samples, walks of seed {WALK_SEED}, and are measured and packed as in the ratios at 40 dB of the\n\
             section [Targets](#targets). Algorithm 4 has that threshold of {} that suits it best, and where more than one is told the seeds {} of k-means, median (least…greatest). Worst block of ours, in dB: {worst}.\n\n\
             | {HEAD}|---|---|---|---|---|---|---|---|\n{}",
            rconds_words(rconds),
            listed(seeds),
            rows.iter().map(row).collect::<String>(),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::targets::traced::Found;

    #[test]
    fn all_methods_have_a_row_and_the_worst_block_of_ours_is_judged() {
        let found = |ratio: f64, worst_db: f64| Found {
            db: 35.1,
            worst_db,
            n_enough: 15,
            mean_rank: 2.0,
            block_bytes: 500.0,
            ratio,
            multiply_adds: [9.0, 5.0],
        };
        let row = |name: &str, found: Found| Row::of(name, vec![found]);
        let rows = vec![row("projected", found(900.0, 30.9)), row("svd", found(40.0, 33.0))];
        let (rconds, seeds) = (vec![1e-2], vec![1]);
        let beside = Beside { n_blocks: 16, n_open: 1, most_spp: 2048, spp: [99.6, 2048.0], rconds, seeds, rows };
        let told = beside.text("a hall", 35.0);
        assert!(told.contains("100 samples\nper pixel in the mean, 2048 at most, of 2048 that were allowed"), "{told}");
        assert!(
            told.contains("threshold of 0.01 that suits it best, and where more than one is told the seeds 1 of"),
            "{told}"
        );
        assert!(told.contains("Worst block of ours, in dB: 30.9, missed."), "{told}");
        let last = "| `svd` | 35.1 | 33.0 | 15 of 16 | 2.00 | 500 | 40× | 9 / 5 |\n";
        assert!(told.contains("\n| `projected` | 35.1 | 30.9 |") && told.ends_with(last), "{told}");
    }
}
