//! Relighting against what memory can do: all columns, one light, display alone.

use std::time::Instant;

use anyhow::Result;
use clerestory_relight::bandwidth::{CopyProbe, ReadProbe};
use clerestory_relight::synthetic::{Ranks, Recipe};
use clerestory_relight::{
    CpuRelighter, DeviceChoice, DisplayParams, Gpu, GpuRelighter, Precision, Radiance, Relight, RelightError, encode,
};

use super::desk::{Desk, cpu_name};

/// Width, height, columns, rank, and how many bytes an entry of the factors takes.
type Job = [u32; 5];

const QUICK: [Job; 3] = [[512, 384, 256, 4, 2], [1024, 768, 256, 8, 2], [1024, 768, 256, 8, 1]];
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
/// Turns of each job; the probe of memory is read once in each, so that other work on the machine meets both.
const TURNS: usize = 12;
/// Bytes of the probe of memory, far more than caches hold.
const PROBE_BYTES: usize = 1 << 30;
/// The same on a device, which is asked for twice as many.
const DEVICE_PROBE_BYTES: u64 = 256 << 20;
/// Copies that a device makes in a row.
const COPIES: u32 = 8;
/// Bytes of a pixel's radiance, and of its bytes for the display.
const RADIANCE_BYTES: u64 = 12;
const DEVICE_RADIANCE_BYTES: u64 = 16;
const SHOWN_BYTES: u64 = 4;

/// Relights synthetic frames on the CPU and on every device there is.
///
/// # Errors
/// If a device fails.
pub fn write(desk: &Desk) -> Result<String> {
    let jobs = desk.choose(&QUICK[..], &FULL[..]);
    let mut measured = on_cpu(desk, jobs)?;
    let gpus = Gpu::all_headless(DeviceChoice::Any);
    if gpus.is_empty() {
        measured += "\nNo graphics adapter was there.\n";
    }
    for gpu in &gpus {
        measured += &on_device(desk, gpu, jobs)?;
    }
    Ok(format!(
        "## Relighting\n\n\
         Synthetic frames of one group of columns, tiles of 16 × 16, the same rank everywhere; `relight/<size>/<columns>/<rank>/<bytes of an entry>`. Best of\n\
         {TURNS} turns: all coefficients new, one light of them new, and display alone (AgX, exposure changed). Megabytes that must move: factors that are\n\
         read (16-bit floats, or bytes with a scale per vector), and the radiance that is written. The share is that of what the same memory did in the same turns: read\n\
         by all threads on the CPU, of far more than caches hold; copied by a kernel on a device. What moves little comes from caches, faster than memory\n\
         is: the last two columns hold it against reading as many bytes again and again. {}\n{measured}",
        desk.load_words(),
    ))
}

/// Best of what one job did.
struct Row {
    job: Job,
    /// Bytes that all columns, and one light, move.
    n_bytes: [u64; 2],
    /// Seconds for all columns, for one light, for display alone.
    secs: [f64; 3],
    /// Bytes per second of memory.
    memory: f64,
    /// The same where only as many bytes are read as all columns move, so that caches help both alike.
    as_many: Option<f64>,
}

impl Row {
    fn new(job: Job) -> Row {
        Row { job, n_bytes: [0; 2], secs: [f64::INFINITY; 3], memory: 0.0, as_many: None }
    }

    fn time(&mut self, what: usize, job: impl FnOnce() -> Result<(), RelightError>) -> Result<(), RelightError> {
        let start = Instant::now();
        job()?;
        self.secs[what] = self.secs[what].min(start.elapsed().as_secs_f64());
        Ok(())
    }

    fn line(&self) -> String {
        let [width, height, n_cols, rank, depth] = self.job;
        let share = |what: usize| 100.0 * self.n_bytes[what] as f64 / self.secs[what] / self.memory;
        let [all, one, display] = self.secs.map(|secs| 1e3 * secs);
        let of_as_many = self
            .as_many
            .map_or("| | |".into(), |rate| format!("| {:.1} | {:.0} % |", rate / 1e9, share(0) * self.memory / rate));
        format!(
            "| relight/{width}x{height}/{n_cols}/{rank}/{depth} | {:.0} | {all:.2} | {:.0} % | {:.1} | {one:.2} | {:.0} % | {display:.2} | {:.1} {of_as_many}\n",
            self.n_bytes[0] as f64 / 1e6,
            share(0),
            self.n_bytes[1] as f64 / 1e6,
            share(1),
            self.memory / 1e9,
        )
    }
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

/// Coefficients of a turn: all of them others than before, then one.
fn coefficients(recipe: &Recipe, turn: usize) -> [Vec<Vec<[f32; 3]>>; 2] {
    let all = recipe.coefficients(turn as u64);
    let mut one = all.clone();
    let n_cols = one[0].len();
    one[0][turn * 37 % n_cols] = [1.5, 0.25, 0.75];
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
        for turn in 0..TURNS {
            for (what, x) in coefficients(&recipe, turn).iter().enumerate() {
                row.time(what, || relighter.relight(x, &mut radiance))?;
                row.n_bytes[what] = relighter.stats().n_bytes + n_written;
            }
            row.time(2, || {
                let display = DisplayParams { exposure_ev: turn as f32, ..DisplayParams::default() };
                std::hint::black_box(encode(&radiance, &display));
                Ok(())
            })?;
            row.memory = row.memory.max(probe.bytes_per_sec(PROBE_BYTES as u64));
            let as_many = probe.bytes_per_sec(row.n_bytes[0]);
            row.as_many = Some(row.as_many.map_or(as_many, |most| most.max(as_many)));
        }
        rows.push(row);
    }
    let threads = rayon::current_num_threads();
    Ok(table(&format!("CPU, {threads} threads: {}", cpu_name()), &rows))
}

fn on_device(desk: &Desk, gpu: &Gpu, jobs: &[Job]) -> Result<String> {
    let is_small = |job: &&Job| !gpu.is_software() || job[0] * job[1] <= SOFTWARE_PIXELS;
    let probe = CopyProbe::new(gpu, DEVICE_PROBE_BYTES)?;
    let mut rows = Vec::new();
    for &job in jobs.iter().filter(is_small) {
        desk.say(&format!("relighting {job:?} on {}", gpu.description()));
        let recipe = recipe(job);
        let n_pixels = u64::from(job[0]) * u64::from(job[1]);
        let mut relighter = GpuRelighter::with_precision(gpu, &recipe.frame(), Precision::ByError)?;
        let mut row = Row::new(job);
        let mut display = DisplayParams::default();
        relighter.relight_to_texture(&recipe.coefficients(1000), &display)?;
        for turn in 0..TURNS {
            for (what, x) in coefficients(&recipe, turn).iter().enumerate() {
                row.time(what, || {
                    relighter.relight_to_texture(x, &display)?;
                    gpu.wait()
                })?;
                row.n_bytes[what] = relighter.stats().n_bytes + n_pixels * (2 * DEVICE_RADIANCE_BYTES + SHOWN_BYTES);
            }
            let [_, x] = coefficients(&recipe, turn);
            // More light would ask for blocks that were not seen before.
            display.exposure_ev -= 1e-3;
            row.time(2, || {
                relighter.relight_to_texture(&x, &display)?;
                gpu.wait()
            })?;
            row.memory = row.memory.max(probe.bytes_per_sec(COPIES)?);
        }
        rows.push(row);
    }
    Ok(table(&gpu.description(), &rows))
}
