//! A large file: how long it takes to load, beside reading its bytes.

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use clerestory::platform::memory_bytes;
use clerestory_nystrom::{ColumnRun, PackPlan, PackedMatrix};
use clerestory_relight::synthetic::{Ranks, Recipe};
use clerestory_transport::archive;
use clerestory_transport::bake::{Bake, BakeConfig, BakeHeader, BakeJob, Passes};
use clerestory_transport::camera::Film;
use clerestory_transport::import;
use clerestory_transport::prepared::PreparedScene;

use crate::desk::Desk;
use crate::fit::median;
use crate::goal::Goal;

/// Bytes that the file is to have, about.
const BYTES: [f64; 2] = [1e6, 100e6];
/// Pixels across, and the rows of a first file that tells how many bytes a row takes.
const WIDTH: u32 = 2560;
const FIRST_HEIGHT: u32 = 64;
/// Texels along a side of the panel, and the largest rank of a block; ranks are spread evenly, eight in the mean, as `mixed` has at 45 dB.
const SIDE: u32 = 16;
const RANK: u32 = 16;
/// Share of the mean square of the entries that packing may lose, 40 dB.
const LOST: f64 = 1e-4;
/// Times that all of it is measured, in turn.
const TURNS: [usize; 2] = [1, 5];
/// What counts as about the time of reading.
const ABOUT: f64 = 1.5;

/// Seconds of one turn.
struct Secs {
    /// Its bytes alone.
    read: f64,
    /// As the window loads it.
    load: f64,
    /// Factors from bytes that are in memory and were checked.
    unpack: f64,
}

impl Secs {
    /// What loading takes beside reading and factors.
    fn all_else(&self) -> f64 {
        self.load - self.read - self.unpack
    }
}

/// The median of a figure of every turn.
fn middle(turns: &[Secs], value: fn(&Secs) -> f64) -> f64 {
    median(&turns.iter().map(value).collect::<Vec<_>>()).unwrap_or(f64::NAN)
}

/// A table of a file that is made, measured and removed.
///
/// # Errors
/// If it cannot be written or read.
pub fn write(desk: &Desk) -> Result<String> {
    desk.say("making a large file");
    let (header, path) = (small_header(desk)?, desk.file("large.transport"));
    let path = Path::new(&path);
    let first = written(&header, FIRST_HEIGHT, path)?;
    let height = height_of(desk.choose(BYTES[0], BYTES[1]), first);
    let bytes = written(&header, height, path)?;
    desk.say("loading it");
    let turns = (0..desk.choose(TURNS[0], TURNS[1])).map(|_| turn(path)).collect::<Result<Vec<Secs>>>()?;
    std::fs::remove_file(path).with_context(|| format!("cannot remove {}", path.display()))?;
    let middle = |value: fn(&Secs) -> f64| middle(&turns, value);
    let (read, load, unpack) = (middle(|secs| secs.read), middle(|secs| secs.load), middle(|secs| secs.unpack));
    let ratio = middle(|secs| secs.load / secs.read);
    Ok(format!(
        "\n### A large file\n\n\
         {WIDTH} × {height} pixels under a panel of {SIDE} × {SIDE} texels, random factors of seed {} and rank 0 to {RANK}, packed to lose 40 dB less than they hold; written, measured, and removed.\n\
         Reading its bytes, which the system still holds in its cache, loading it as the window does, and of that making factors of bytes that are in memory, in turn, median of {} by the clock. Loading also checks every byte and reads the header; the factors, decoded and taken out of\n\
         their cosines, are what relighting multiplies with. Aimed at: about the time of reading, {ABOUT} times at most.\n\n\
         | file | reading | loading | of that, factors | all else | loading over reading |\n|---|---|---|---|---|---|\n\
         | {:.1} MB | {read:.3} s | {load:.2} s | {unpack:.2} s | {:.2} s | {ratio:.1}, {} |\n",
        Recipe::default().seed,
        turns.len(),
        bytes / 1e6,
        middle(Secs::all_else),
        Goal::Most(ABOUT).word(ratio),
    ))
}

/// The header of a bake of a few pixels, whose columns are the texels of one panel.
fn small_header(desk: &Desk) -> Result<BakeHeader> {
    let path = desk.root.join("assets/scenes/diffuse.glb");
    let imported = import::load(&path).with_context(|| format!("cannot load the scene {}", path.display()))?;
    let scene = Arc::new(PreparedScene::new(imported.scene, &[])?.0);
    let camera = scene.scene.cameras.first().cloned().context("the scene has no camera")?;
    let config = BakeConfig { spp: 1, tolerance_db: 10.0, ..BakeConfig::default() };
    let film = Film { width: 16, height: 16 };
    let job = BakeJob { scene, camera, film, config, passes: Passes::FinalOnly, irradiance: Vec::new() };
    let bake = job.run(|_| ControlFlow::Continue(()))?.context("nobody stops a bake of the report")?;
    let header = (*bake.header).clone();
    ensure!(
        header.basis.n_cols() == (SIDE * SIDE) as usize && header.basis.groups.len() == 1,
        "{} has other lights than a panel of {SIDE} × {SIDE} texels",
        path.display()
    );
    Ok(header)
}

/// Writes a file of so many rows of pixels; its bytes.
fn written(header: &BakeHeader, height: u32, path: &Path) -> Result<f64> {
    let n_cols = SIDE * SIDE;
    let recipe = Recipe {
        width: WIDTH,
        height,
        tile: header.tile,
        n_cols: vec![n_cols],
        rank: Ranks::Spread(RANK),
        n_sparse: 0,
        ..Recipe::default()
    };
    let groups = recipe.frame().groups;
    // The mean square of a few blocks tells what may be lost.
    let some: Vec<f32> = groups[0].blocks.iter().flatten().take(64).flat_map(|block| block.dense()).collect();
    let mean_square = some.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>() / some.len() as f64;
    let plan = PackPlan {
        columns: vec![ColumnRun::Grid { width: SIDE, height: SIDE }],
        allowed: (LOST * mean_square) as f32,
        strong: 0.0,
        apart: 0.0,
        preserved: vec![1.0; n_cols as usize],
    };
    let packed = vec![groups.iter().map(|group| PackedMatrix::pack(group, &plan)).collect()];
    let header = BakeHeader { width: WIDTH, height, ..header.clone() };
    let bake = Bake { header: Arc::new(header), groups, irradiance: Vec::new(), packed: Some(Arc::new(packed)) };
    archive::write(&bake, path)?;
    Ok(std::fs::metadata(path).with_context(|| format!("cannot read {}", path.display()))?.len() as f64)
}

/// Rows of pixels, whole blocks of 16, of a file of some bytes, if a first one with fewer rows has as many as it has.
fn height_of(bytes: f64, first_bytes: f64) -> u32 {
    let n_blocks = (bytes / first_bytes * f64::from(FIRST_HEIGHT / 16)).round().max(1.0);
    (16 * n_blocks as u32).min(Film::MAX_SIDE)
}

/// Reads, loads and unpacks once.
fn turn(path: &Path) -> Result<Secs> {
    let begun = Instant::now();
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    let read = begun.elapsed().as_secs_f64();
    drop(std::hint::black_box(bytes));
    let begun = Instant::now();
    let bake = archive::read_within(memory_bytes(), path)?;
    let load = begun.elapsed().as_secs_f64();
    let packed = bake.packed.clone().context("a file that was packed is read as packed")?;
    drop(bake);
    let begun = Instant::now();
    let groups = packed.iter().flatten().map(PackedMatrix::unpack).collect::<Result<Vec<_>, _>>()?;
    let unpack = begun.elapsed().as_secs_f64();
    // Loading keeps its factors, too: that they go again is in neither time.
    drop(std::hint::black_box(groups));
    Ok(Secs { read, load, unpack })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_told_of_turns_is_the_median_of_each_figure() {
        let secs = |[read, load, unpack]: [f64; 3]| Secs { read, load, unpack };
        let turns = [[1.0, 8.0, 2.0], [2.0, 9.0, 6.0], [4.0, 7.0, 1.0]].map(secs);
        // 5, 1 and 2; the median of loading less those of both others would be 4.
        assert_eq!((middle(&turns, Secs::all_else), middle(&turns, |secs| secs.load)), (2.0, 8.0));
    }

    #[test]
    fn a_large_file_has_as_many_rows_as_its_bytes_take() {
        assert_eq!(height_of(100e6, 1e6), 6400);
        assert_eq!(height_of(1e6, 3e6), 16);
        assert_eq!(height_of(1e12, 1e6), Film::MAX_SIDE);
    }
}
