//! What methods make of traced blocks, packed as a bake is, as rows of a table.

use std::sync::Arc;

use anyhow::{Context, Result};
use clerestory_nystrom::rivals::{Core, Method};
use clerestory_nystrom::{BlockError, BlockFactors, BlockLowRank, CompressConfig, PackedMatrix, compress_block};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::singular::Singular;
use super::{Block, Traced, allowed, compression, grid};
use crate::desk::Desk;
use crate::fit::{hundredths, median, tenths, wholes};
use crate::methods::dense::{CHANNELS, TILE};
use crate::targets::coded::{multiply_adds, pack_plan, written_and_read};
use crate::targets::judged::decibels;
use crate::targets::{SLACK_DB, merit, order};

/// Share of a tolerance up to which a block counts as exact enough: bakes stop there, since a fit to a half is a little worse.
const ENOUGH: f64 = 1.05;
/// Rows of a block, which no rank is above; and the greatest rank of rivals as bakes have it: most would take minutes for a block of noise.
pub const MOST_RANK: u32 = (CHANNELS * TILE * TILE) as u32;
pub const RIVAL_RANK: u32 = 96;

/// What a method made of all blocks, packed and read again, as far as both halves of the samples tell.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Found {
    /// Error over all blocks, and that of the worst.
    pub db: f64,
    /// See there.
    pub worst_db: f64,
    /// Blocks that were as exact as asked before they were packed.
    pub n_enough: usize,
    /// Mean rank over the blocks.
    pub mean_rank: f64,
    /// Bytes of a block.
    pub block_bytes: f64,
    /// The dense matrix in single precision over all bytes, of a whole picture whose blocks are like these.
    pub ratio: f64,
    /// Multiplications per pixel and picture as unpacked, and in cosines.
    pub multiply_adds: [f64; 2],
}

impl Traced {
    /// What a method makes of the blocks with a seed.
    ///
    /// # Errors
    /// If it finds no factors.
    pub fn found(&self, (method, seed): (Method, u64), most_rank: u32, tolerance_db: f64) -> Result<Found> {
        let asked = compression(&self.partition, self.n_cols, tolerance_db, self.share);
        let config = CompressConfig { method, seed, max_rank: most_rank, ..asked };
        let factors = |block: &Block| -> Result<BlockFactors> {
            let mut found = compress_block(&block.samples(self.n_cols), &config, block.block_idx)?;
            found.pop().context("one group of columns has one result")
        };
        self.packed(self.blocks.par_iter().map(factors).collect::<Result<Vec<_>>>()?, tolerance_db)
    }

    /// Packs factors of the blocks, reads them again, and tells what became of them.
    pub(super) fn packed(&self, factors: Vec<BlockFactors>, tolerance_db: f64) -> Result<Found> {
        let allowed = allowed(tolerance_db);
        let told = |error: &BlockError| f64::from(error.truncation + error.sampling);
        let is_enough = |factors: &&BlockFactors| told(&factors.error) <= ENOUGH * f64::from(allowed);
        let n_enough = factors.iter().filter(is_enough).count();
        let mut matrix = BlockLowRank::new(self.partition.clone(), CHANNELS as u32, self.n_cols as u32);
        for (block, factors) in self.blocks.iter().zip(factors) {
            matrix.blocks[block.block_idx as usize] = Some(Arc::new(factors));
        }
        let packed = PackedMatrix::pack(&matrix, &pack_plan(vec![grid(self.n_cols)], self.n_cols, allowed));
        let (n_bytes, read) = written_and_read(&packed)?;
        // What lies around the blocks is about as much for each of the picture, there or not.
        let around = (n_bytes - packed.n_bytes()) as f64 / self.partition.n_blocks() as f64;
        let block_bytes = packed.block_bytes() as f64 / self.blocks.len() as f64 + around;
        let once = (packed.n_bytes() - packed.block_bytes()) as f64;
        let dense_bytes = (CHANNELS * TILE * TILE * self.n_cols * size_of::<f32>()) as f64;
        // No error is told as less than nothing.
        let db = |mean_square: f64| decibels(mean_square.max(1e-12));
        Ok(Found {
            db: db(told(&read.mean_error())),
            worst_db: db(read.blocks.iter().flatten().map(|block| told(&block.error)).fold(0.0, f64::max)),
            n_enough,
            mean_rank: f64::from(read.mean_rank()),
            block_bytes,
            ratio: ratio_of_frame(self.frame_blocks, dense_bytes, block_bytes, once),
            multiply_adds: multiply_adds(&packed, &read, self.blocks.len() * TILE * TILE)?,
        })
    }
}

/// Dense over packed bytes of so many blocks, from those of one, dense and packed, and those that a file has once.
fn ratio_of_frame(n_blocks: usize, dense: f64, packed: f64, once: f64) -> f64 {
    n_blocks as f64 * dense / (n_blocks as f64 * packed + once)
}

/// A method, and what it made with each seed.
#[derive(Clone, Serialize, Deserialize)]
pub struct Row {
    /// The method in words.
    pub name: String,
    /// One for each seed; none where it failed.
    pub found: Vec<Found>,
    /// What went wrong.
    failure: String,
}

/// What methods are asked for.
pub struct Asked<'a> {
    /// The tolerance.
    pub tolerance_db: f64,
    /// Thresholds of the pseudo-inverse that Algorithm 4 is tried with.
    pub rconds: &'a [f64],
    /// Seeds of k-means; the first of them is that of all others.
    pub seeds: &'a [u64],
    /// The others of the field, beside the best there is and Algorithm 4.
    pub others: &'a [Method],
    /// Greatest rank of Algorithm 4 and the others.
    pub rival_rank: u32,
}

/// A row of ours, of the best there is, of Algorithm 4 with the threshold that suits it best, and of the others; and that threshold.
///
/// # Errors
/// If ours finds no factors.
pub fn rows(
    desk: &Desk,
    (name, traced): (&str, &Traced),
    singular: &Singular,
    asked: &Asked<'_>,
) -> Result<(Vec<Row>, f64)> {
    let (tolerance_db, first, rival_rank) = (asked.tolerance_db, asked.seeds[0], asked.rival_rank);
    let say = |method: Method| desk.say(&format!("{method} on traced blocks of {name} at {tolerance_db} dB"));
    say(Method::Projected);
    let ours = traced.found((Method::Projected, first), MOST_RANK, tolerance_db)?;
    say(Method::Svd);
    let mut rows =
        vec![Row::new(Method::Projected, [Ok(ours)]), Row::new(Method::Svd, [singular.found(traced, tolerance_db)])];
    let fourth = |rcond: f64, seeds: &[u64]| {
        let method = Method::Alg4(Core::PseudoInverse { rcond });
        say(method);
        Row::new(method, seeds.iter().map(|&seed| traced.found((method, seed), rival_rank, tolerance_db)))
    };
    let mut tried: Vec<(f64, Row)> = asked.rconds.iter().map(|&rcond| (rcond, fourth(rcond, &[first]))).collect();
    tried.sort_by(|(_, a), (_, b)| order(b.merit(tolerance_db), a.merit(tolerance_db)));
    let (rcond, mut best) = tried.swap_remove(0);
    if !best.found.is_empty() && asked.seeds.len() > 1 {
        best.extend(fourth(rcond, &asked.seeds[1..]));
    }
    rows.push(best);
    for &method in asked.others {
        say(method);
        rows.push(Row::new(method, [traced.found((method, first), rival_rank, tolerance_db)]));
    }
    Ok((rows, rcond))
}

/// Head of a table of rows, behind the cells that come first.
pub const HEAD: &str = "method | dB | worst block | as exact as asked, within 5 % | mean rank | bytes of a block | dense / bytes | multiply-adds |\n";

impl Row {
    fn new(method: Method, results: impl IntoIterator<Item = Result<Found>>) -> Row {
        let (found, failure) = match results.into_iter().collect::<Result<Vec<_>>>() {
            Ok(found) => (found, String::new()),
            Err(error) => (Vec::new(), format!("{error:#}")),
        };
        Row { name: method.to_string(), found, failure }
    }

    /// The same with what other seeds brought.
    pub fn extend(&mut self, other: Row) {
        self.found.extend(other.found);
        self.failure += &other.failure;
    }

    fn merit(&self, target_db: f64) -> [f64; 2] {
        self.found.first().map_or([-1.0, 0.0], |found| merit(found.db, found.ratio, target_db))
    }

    fn all(&self, value: fn(&Found) -> f64) -> Vec<f64> {
        self.found.iter().map(value).collect()
    }

    /// Its cells from the name on, of so many blocks that were asked for a tolerance.
    pub fn cells(&self, n_blocks: usize, tolerance_db: f64) -> String {
        if self.found.is_empty() {
            return format!("`{}` | {} | | | | | | |\n", self.name, self.failure);
        }
        let is_short = median(&self.all(|found| found.db)).is_none_or(|db| db < tolerance_db - SLACK_DB);
        let [unpacked, in_cosines] =
            [self.all(|found| found.multiply_adds[0]), self.all(|found| found.multiply_adds[1])].map(wholes);
        format!(
            "`{}` | {}{} | {} | {} of {n_blocks} | {} | {} | {}× | {unpacked} / {in_cosines} |{}\n",
            self.name,
            tenths(self.all(|found| found.db)),
            if is_short { ", short of it" } else { "" },
            tenths(self.all(|found| found.worst_db)),
            wholes(self.all(|found| found.n_enough as f64)),
            hundredths(self.all(|found| found.mean_rank)),
            wholes(self.all(|found| found.block_bytes)),
            wholes(self.all(|found| found.ratio)),
            self.failure,
        )
    }

    /// What was found with the seed that has the middle one of the ratios.
    pub fn middle(&self) -> Option<&Found> {
        let mut sorted: Vec<&Found> = self.found.iter().collect();
        sorted.sort_by(|a, b| a.ratio.total_cmp(&b.ratio));
        sorted.get(sorted.len() / 2).copied()
    }

    /// Some figures of that in words, the method before them.
    pub fn words(&self, value: fn(&Found) -> String) -> String {
        format!("`{}` {}", self.name, self.middle().map_or("none".into(), value))
    }

    /// What a test made up.
    #[cfg(test)]
    pub fn of(name: &str, found: Vec<Found>) -> Row {
        Row { name: name.into(), found, failure: String::new() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(db: f64, ratio: f64) -> Found {
        let multiply_adds = [8.0, 4.0];
        Found { db, worst_db: 30.0, n_enough: 2, mean_rank: 1.5, block_bytes: 400.0, ratio, multiply_adds }
    }

    #[test]
    fn a_table_tells_how_exact_is_exact_enough() {
        assert!(HEAD.contains(&format!(" within {:.0} % |", 100.0 * (ENOUGH - 1.0))), "{HEAD}");
    }

    #[test]
    fn what_a_file_has_once_counts_once_for_all_its_blocks() {
        assert_eq!(ratio_of_frame(100, 800.0, 4.0, 0.0), 200.0);
        assert_eq!(ratio_of_frame(100, 800.0, 4.0, 400.0), 100.0);
    }

    #[test]
    fn a_row_tells_how_far_seeds_lie_apart_and_what_is_short_of_the_tolerance() {
        let mut row = Row::new(Method::Svd, [Ok(found(40.0, 100.0))]);
        assert!(row.cells(3, 40.0).starts_with("`svd` | 40.0 | 30.0 | 2 of 3 | 1.50 | 400 | 100× | 8 / 4 |"));
        let nearly = Row::new(Method::Svd, [Ok(found(39.5, 100.0))]);
        assert!(nearly.cells(3, 40.0).starts_with("`svd` | 39.5 | "), "no more than half a decibel is lacking");
        row.extend(Row::new(Method::Svd, [Ok(found(38.0, 120.0)), Ok(found(39.0, 90.0))]));
        let cells = row.cells(3, 40.0);
        assert!(cells.starts_with("`svd` | 39.0 (38.0…40.0), short of it | "), "{cells}");
        assert!(cells.contains(" | 100 (90…120)× | "), "{cells}");
        assert_eq!(row.words(|found| format!("{:.0}×", found.ratio)), "`svd` 100×");
        let failed = Row::new(Method::Svd, [Err(anyhow::anyhow!("no end"))]);
        assert_eq!(failed.cells(3, 40.0), "`svd` | no end | | | | | | |\n");
    }
}
