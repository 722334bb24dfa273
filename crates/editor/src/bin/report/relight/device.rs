//! Relighting on a device: by its own clock where it has one, and from outside.

use std::time::{Duration, Instant};

use anyhow::Result;
use clerestory_relight::bandwidth::{CopyProbe, CopyRates};
use clerestory_relight::gpu::StageSecs;
use clerestory_relight::synthetic::Recipe;
use clerestory_relight::{DisplayParams, Gpu, GpuRelighter, Precision, Relight, RelightError};

use super::super::desk::Desk;
use super::{
    DEVICE_PROBE_BYTES, DEVICE_RADIANCE_BYTES, Ends, IN_A_ROW, Job, SHOWN_BYTES, SOFTWARE_PIXELS, coefficients, name,
    recipe, turns,
};

/// What devices of hardware do besides: beside so much the time between stages matters little.
const LARGE: [Job; 2] = [[3840, 2160, 1024, 8, 2], [3840, 2160, 1024, 16, 2]];

/// How long a device is kept busy before it is measured: at rest it lowers its clocks.
const WARMING: Duration = Duration::from_millis(300);

/// What one job did.
struct Row {
    job: Job,
    cases: [Case; 2],
    copies: CopyRates,
}

/// All columns, or one light.
#[derive(Clone, Copy)]
struct Case {
    n_bytes: u64,
    /// What the device noted of the picture that took it the least.
    clock: Option<StageSecs>,
    /// Seconds that it noted of all pictures.
    whole: Ends,
    /// Seconds of one picture that is waited for.
    waited_for: Ends,
    /// Seconds of a picture of those in a row.
    in_a_row: Ends,
}

/// All jobs that the device is fast enough for.
///
/// # Errors
/// If the device fails.
pub fn table(desk: &Desk, gpu: &Gpu, jobs: &[Job]) -> Result<String> {
    let is_small = |job: &&Job| !gpu.is_software() || job[0] * job[1] <= SOFTWARE_PIXELS;
    let probe = CopyProbe::new(gpu, DEVICE_PROBE_BYTES)?;
    let mut lines = String::new();
    let large = if gpu.is_software() { &[] } else { desk.choose(&[][..], &LARGE) };
    for &job in jobs.iter().filter(is_small).chain(large) {
        desk.say(&format!("relighting {job:?} on {}", gpu.description()));
        lines += &measured(gpu, &probe, job, turns(desk))?.lines();
    }
    let clock = if !gpu.takes_time() {
        "This device has no clock that can be read.\n\n"
    } else if gpu.is_software() {
        "A driver without hardware may note times before it has done what they stand for (llvmpipe does on Vulkan): here what was waited for counts.\n\n"
    } else {
        ""
    };
    Ok(format!(
        "\n### {}\n\n{clock}\
         | job | what | MB | by its clock, ms | project | expand | display | copies, GB/s | share | waited for, ms | in a row, ms | copies from outside, GB/s | share |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|---|\n{lines}",
        gpu.description(),
    ))
}

fn measured(gpu: &Gpu, probe: &CopyProbe, job: Job, n_turns: usize) -> Result<Row, RelightError> {
    let recipe = recipe(job);
    let display = DisplayParams::default();
    let mut relighter = GpuRelighter::with_precision(gpu, &recipe.frame(), Precision::ByError)?;
    relighter.relight_to_texture(&recipe.coefficients(1000), &display)?;
    warm_up(gpu, &mut relighter, &recipe)?;
    let n_written = u64::from(job[0]) * u64::from(job[1]) * (2 * DEVICE_RADIANCE_BYTES + SHOWN_BYTES);
    let none = Ends::OF_NONE;
    let case = Case { n_bytes: 0, clock: None, whole: none, waited_for: none, in_a_row: none };
    let mut row = Row { job, cases: [case; 2], copies: CopyRates { from_outside: 0.0, within: None } };
    let n_in_a_row = IN_A_ROW[usize::from(gpu.is_software())];
    for turn in 0..n_turns {
        for (what, case) in row.cases.iter_mut().enumerate() {
            // The first of a turn is another kind of change than the one before.
            let drag: Vec<_> = (0..n_in_a_row + 2).map(|i| coefficients(&recipe, turn, i)[what].clone()).collect();
            relighter.relight_to_texture(&drag[0], &display)?;
            gpu.wait()?;
            relighter.start_clock();
            let start = Instant::now();
            relighter.relight_to_texture(&drag[1], &display)?;
            gpu.wait()?;
            case.waited_for.take(start.elapsed().as_secs_f64());
            case.n_bytes = relighter.stats().n_bytes + n_written;
            case.take(relighter.stage_secs()?);
            relighter.stop_clock();
            let start = Instant::now();
            for x in &drag[2..] {
                relighter.relight_to_texture(x, &display)?;
            }
            gpu.wait()?;
            case.in_a_row.take(start.elapsed().as_secs_f64() / n_in_a_row as f64);
        }
        let rates = probe.rates()?;
        row.copies.from_outside = row.copies.from_outside.max(rates.from_outside);
        row.copies.within = rates.within.map(|rate| rate.max(row.copies.within.unwrap_or(0.0)));
    }
    Ok(row)
}

/// Keeps a device of hardware busy until it runs as fast as it does while there is work.
fn warm_up(gpu: &Gpu, relighter: &mut GpuRelighter, recipe: &Recipe) -> Result<(), RelightError> {
    let begun = Instant::now();
    let drag = [1001, 1002].map(|seed| recipe.coefficients(seed));
    while !gpu.is_software() && begun.elapsed() < WARMING {
        drag.iter()
            .cycle()
            .take(IN_A_ROW[0])
            .try_for_each(|x| relighter.relight_to_texture(x, &DisplayParams::default()).map(|_| ()))?;
        gpu.wait()?;
    }
    Ok(())
}

impl Case {
    /// Keeps the picture that took the device the least.
    fn take(&mut self, clock: Option<StageSecs>) {
        let Some(clock) = clock else { return };
        self.whole.take(clock.whole);
        if self.clock.is_none_or(|best| clock.whole < best.whole) {
            self.clock = Some(clock);
        }
    }
}

impl Row {
    fn lines(&self) -> String {
        let line = |(case, what): (&Case, &str)| {
            let n_bytes = case.n_bytes as f64;
            let inside = case.clock.zip(self.copies.within).map_or("| | | | | | ".into(), |(clock, rate)| {
                let [project, expand, display] = [clock.project, clock.expand, clock.display].map(|secs| 1e3 * secs);
                format!(
                    "| {} | {project:.2} | {expand:.2} | {display:.2} | {:.1} | {:.0} % ",
                    case.whole.words(),
                    rate / 1e9,
                    100.0 * n_bytes / clock.whole / rate
                )
            });
            format!(
                "| {} | {what} | {:.1} {inside}| {} | {} | {:.1} | {:.0} % |\n",
                name(self.job),
                n_bytes / 1e6,
                case.waited_for.words(),
                case.in_a_row.words(),
                self.copies.from_outside / 1e9,
                100.0 * n_bytes / case.in_a_row.least() / self.copies.from_outside,
            )
        };
        self.cases.iter().zip(["all", "one light"]).map(line).collect()
    }
}
