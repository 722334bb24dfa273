//! Relighting against what memory can do: all columns, one light, display alone.

mod device;

use std::time::Instant;

use anyhow::{Context, Result};
use clerestory_relight::bandwidth::ReadProbe;
use clerestory_relight::synthetic::{Ranks, Recipe};
use clerestory_relight::{
    CpuRelighter, DeviceChoice, DisplayParams, Gpu, Precision, Radiance, Relight, RelightError, encode,
};

use super::desk::{Desk, cpu_name};

/// Width, height, columns, rank, and how many bytes an entry of the factors takes.
type Job = [u32; 5];

const QUICK: [Job; 2] = [[256, 192, 256, 4, 2], [256, 192, 256, 4, 1]];
const FULL: [Job; 11] = [
    [512, 384, 256, 4, 2],
    [1024, 768, 256, 4, 2],
    [1024, 768, 256, 8, 2],
    [1024, 768, 256, 8, 1],
    [1024, 768, 1024, 8, 2],
    [1024, 768, 1024, 8, 1],
    [1920, 1080, 1024, 4, 2],
    [1920, 1080, 1024, 8, 2],
    [1920, 1080, 1024, 8, 1],
    [1920, 1080, 1024, 16, 2],
    [1920, 1080, 1024, 16, 1],
];
/// Pixels of the largest job for a device that is none.
const SOFTWARE_PIXELS: u32 = 1024 * 768;
/// Turns of each job, in a hurry and else; the probe of memory is read once in each, so that other work on the machine meets both.
const TURNS: [usize; 2] = [2, 12];
/// Seeds of the coefficients of a turn, more than it has steps.
const SEEDS_OF_TURN: usize = 100;
/// Bytes of the probe of memory, far more than caches hold.
const PROBE_BYTES: usize = 1 << 30;
/// The same on a device, which is asked for twice as many.
const DEVICE_PROBE_BYTES: u64 = 256 << 20;
/// Pictures that a device is handed in a row before anybody waits, where it is one of hardware and where it is none.
const IN_A_ROW: [usize; 2] = [16, 2];
/// Bytes of a pixel's radiance, and of its bytes for the display.
const RADIANCE_BYTES: u64 = 12;
const DEVICE_RADIANCE_BYTES: u64 = 16;
const SHOWN_BYTES: u64 = 4;
/// Relights of one kind in a row on the CPU, of which the last counts.
const REPEATS: usize = 3;

/// Relights synthetic frames on the CPU and on every device there is.
///
/// # Errors
/// If a device fails.
pub fn write(desk: &Desk) -> Result<String> {
    let (mut measured, n_turns) = (tables(desk, "relight", DeviceChoice::Any)?, turns(desk));
    if Gpu::all_headless(DeviceChoice::Any).is_empty() {
        measured += "\nNo graphics adapter was there.\n";
    }
    Ok(format!(
        "## Relighting\n\n\
         Synthetic frames of one group of columns, tiles of 16 × 16, the same rank everywhere, random factors of seed {}, coefficients of the seeds from {SEEDS_OF_TURN} times the turn on. Least…greatest of\n\
         {n_turns} turns, shares by the least: all coefficients new, one light of them new, and display alone (AgX, exposure changed). Megabytes that must move: factors that are\n\
         read (16-bit floats, or bytes with a scale per vector), and the radiance that is written; on a device it is read again, and what is shown is written. On the CPU each but display alone, which is done once, is done {REPEATS} times in a row, as in a drag, and the last is timed.\n\
         The share is that of what the same memory did in the same turns: read by all threads on the CPU, of far more than caches hold; copied by a kernel on a device. What moves\n\
         little comes from caches, faster than memory is: the last two columns hold it against reading as many bytes again and again.\n\n\
         On a device, *by its clock* is what the device itself notes between the begin of the first stage and the end of the last (project, expand and display are parts of it; sums of segments\n\
         are the rest), and the bandwidth of its copies is noted in the same way in the same turns: that share is the one that counts. *Waited for* is one picture from outside, handing over\n\
         and waiting included; *in a row* is a picture of {} (of {} where there is no hardware) that are handed over before anybody waits, against copies timed from outside. {}\n{measured}",
        Recipe::default().seed,
        IN_A_ROW[0],
        IN_A_ROW[1],
        desk.load_words(),
    ))
}

/// A table of the CPU and one of each device of a kind, as parts of a section.
///
/// # Errors
/// If a device fails.
pub fn tables(desk: &Desk, section: &str, choice: DeviceChoice) -> Result<String> {
    let jobs = desk.choose(&QUICK[..], &FULL[..]);
    let mut measured: String = desk.part(section, "relight-cpu", || on_cpu(desk, jobs))?;
    for (nth, gpu) in Gpu::all_headless(choice).iter().enumerate() {
        let part = format!("relight-device-{nth}");
        measured += &desk.part::<String>(section, &part, || device::table(desk, gpu, jobs))?;
    }
    Ok(measured)
}

fn turns(desk: &Desk) -> usize {
    desk.choose(TURNS[0], TURNS[1])
}

/// The least and the greatest of some seconds.
#[derive(Clone, Copy)]
struct Ends([f64; 2]);

impl Ends {
    const OF_NONE: Ends = Ends([f64::INFINITY, 0.0]);

    fn take(&mut self, secs: f64) {
        self.0 = [self.0[0].min(secs), self.0[1].max(secs)];
    }

    fn least(self) -> f64 {
        self.0[0]
    }

    /// In milliseconds.
    fn words(self) -> String {
        let [least, greatest] = self.0.map(|secs| 1e3 * secs);
        format!("{least:.2}…{greatest:.2}")
    }
}

/// What one job did.
struct Row {
    job: Job,
    /// Bytes that all columns, and one light, move.
    n_bytes: [u64; 2],
    /// Seconds for all columns, for one light, for display alone.
    secs: [Ends; 3],
    /// Bytes per second of memory.
    memory: f64,
    /// The same where only as many bytes are read as all columns move, so that caches help both alike.
    as_many: f64,
}

impl Row {
    fn new(job: Job) -> Row {
        Row { job, n_bytes: [0; 2], secs: [Ends::OF_NONE; 3], memory: 0.0, as_many: 0.0 }
    }

    fn time(&mut self, what: usize, job: impl FnOnce() -> Result<(), RelightError>) -> Result<(), RelightError> {
        let start = Instant::now();
        job()?;
        self.secs[what].take(start.elapsed().as_secs_f64());
        Ok(())
    }

    fn line(&self) -> String {
        let share = |what: usize| 100.0 * self.n_bytes[what] as f64 / self.secs[what].least() / self.memory;
        let [all, one, display] = self.secs.map(Ends::words);
        format!(
            "| {} | {:.0} | {all} | {:.0} % | {:.1} | {one} | {:.0} % | {display} | {:.1} | {:.1} | {:.0} % |\n",
            name(self.job),
            self.n_bytes[0] as f64 / 1e6,
            share(0),
            self.n_bytes[1] as f64 / 1e6,
            share(1),
            self.memory / 1e9,
            self.as_many / 1e9,
            share(0) * self.memory / self.as_many,
        )
    }
}

fn name([width, height, n_cols, rank, depth]: Job) -> String {
    let entries = if depth == 1 { "bytes" } else { "16-bit floats" };
    format!("{width} × {height}, {n_cols} columns, rank {rank}, {entries}")
}

fn table(title: &str, rows: &[Row]) -> String {
    let lines: String = rows.iter().map(Row::line).collect();
    format!(
        "\n### {title}\n\n\
         | job | MB, all | ms | share | MB, one light | ms | share | display alone, ms | memory, GB/s | as many bytes, GB/s | share, all |\n\
         |---|---|---|---|---|---|---|---|---|---|---|\n{lines}"
    )
}

fn recipe([width, height, n_cols, rank, depth]: Job) -> Recipe {
    // Blocks that say they miss much are kept in bytes.
    let truncation = if depth == 1 { f32::MAX } else { 0.0 };
    Recipe {
        truncation,
        width,
        height,
        tile: 16,
        n_cols: vec![n_cols],
        rank: Ranks::Fixed(rank),
        n_sparse: 0,
        ..Recipe::default()
    }
}

/// Coefficients of a step of a turn: all of them others than before, then one.
pub fn coefficients(recipe: &Recipe, turn: usize, step: usize) -> [Vec<Vec<[f32; 3]>>; 2] {
    let all = recipe.coefficients((SEEDS_OF_TURN * turn + step) as u64);
    let mut one = recipe.coefficients((SEEDS_OF_TURN * turn) as u64);
    let n_cols = one[0].len();
    one[0][turn * 37 % n_cols] = [1.5, 0.25, 0.75 + step as f32];
    [all, one]
}

fn on_cpu(desk: &Desk, jobs: &[Job]) -> Result<String> {
    let probe = ReadProbe::new(PROBE_BYTES);
    let mut rows = Vec::new();
    for &job in jobs {
        desk.say(&format!("relighting {job:?} on the CPU"));
        let recipe = recipe(job);
        let n_written = RADIANCE_BYTES * u64::from(job[0]) * u64::from(job[1]);
        let mut relighter = CpuRelighter::with_precision(&recipe.frame(), Precision::ByError)?;
        let (mut radiance, mut row) = (Radiance::default(), Row::new(job));
        relighter.relight(&recipe.coefficients(1000), &mut radiance)?;
        for turn in 0..turns(desk) {
            for what in 0..2 {
                let drag: Vec<_> = (0..REPEATS).map(|i| coefficients(&recipe, turn, i)[what].clone()).collect();
                let (last, before) = drag.split_last().context("some repeats")?;
                before.iter().try_for_each(|x| relighter.relight(x, &mut radiance))?;
                row.time(what, || relighter.relight(last, &mut radiance))?;
                row.n_bytes[what] = relighter.stats().n_bytes + n_written;
            }
            row.time(2, || {
                let display = DisplayParams { exposure_ev: turn as f32, ..DisplayParams::default() };
                std::hint::black_box(encode(&radiance, &display));
                Ok(())
            })?;
            row.memory = row.memory.max(probe.bytes_per_sec(PROBE_BYTES as u64));
            let as_many = probe.bytes_per_sec(row.n_bytes[0]);
            row.as_many = row.as_many.max(as_many);
        }
        rows.push(row);
    }
    let threads = rayon::current_num_threads();
    Ok(table(&format!("CPU, {threads} threads: {}", cpu_name()), &rows))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_job_is_told_in_plain_words() {
        assert_eq!(name([512, 384, 256, 4, 2]), "512 × 384, 256 columns, rank 4, 16-bit floats");
        assert_eq!(name([512, 384, 256, 8, 1]), "512 × 384, 256 columns, rank 8, bytes");
    }
}
