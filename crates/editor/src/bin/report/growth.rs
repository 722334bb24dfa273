//! Growth: what a bake takes as pictures, lights, triangles, bounces and threads grow.

#[path = "../../../../transport/examples/ray_rates/hall.rs"]
mod hall;
mod room;
pub mod threads;

use std::ops::ControlFlow;
use std::process::Command;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use clerestory::platform::{peak_bytes, resident_bytes, trim_freed_memory};
use clerestory_transport::bake::{BakeConfig, BakeJob, Passes};
use clerestory_transport::camera::Film;
use clerestory_transport::prepared::PreparedScene;
use serde::{Deserialize, Serialize};

use super::desk::Desk;
use super::fit::{cpu_words, exponent, listed, median, spread_words, tenths};
use super::matrix::process_cpu_secs;
use super::plot::{Axis, Panel, Scale, Series};

/// What is baked where nothing else is said.
#[derive(Clone, Copy, Serialize, Deserialize)]
struct Bench {
    triangles: usize,
    /// Texels along a side of the panel, whose square is the number of columns.
    side: u32,
    /// Width and height in pixels.
    size: [u32; 2],
    spp: u32,
    bounces: Option<u32>,
    /// Those of a bake in a process of its own; as many as the machine has where none are told.
    threads: Option<usize>,
    seed: u64,
}

/// What one bake took.
#[derive(Serialize, Deserialize)]
struct Taken {
    prepare_secs: f64,
    bake_secs: f64,
    /// Seconds of the bake by the clock, those before are of all processors.
    clock_secs: f64,
    /// Memory of the prepared scene; none where the system does not tell, as of the next.
    scene_bytes: Option<f64>,
    /// Most memory of the process at a time, beyond what it had when the scene was prepared.
    peak_bytes: Option<f64>,
    file_bytes: f64,
    /// What the bake tells of itself.
    error_db: f64,
}

/// A figure of a bake, where it has it.
type Figure = fn(&Taken) -> Option<f64>;

/// What a bake took with each of its seeds.
#[derive(Serialize, Deserialize)]
struct Cost {
    /// What grows.
    at: f64,
    taken: Vec<Taken>,
}

impl Cost {
    fn all(&self, of: Figure) -> Vec<f64> {
        self.taken.iter().filter_map(of).collect()
    }
}

/// A curve by its name.
type Curve = (&'static str, Figure);

const SECONDS: [Curve; 3] = [
    ("preparing, CPU", |taken| Some(taken.prepare_secs)),
    ("bake, CPU", |taken| Some(taken.bake_secs)),
    ("bake, by the clock", |taken| Some(taken.clock_secs)),
];
const MEGABYTES: [Curve; 3] = [
    ("memory of the scene", |taken| Some(taken.scene_bytes? / 1e6)),
    ("memory of the bake", |taken| Some(taken.peak_bytes? / 1e6)),
    ("bytes of the file", |taken| Some(taken.file_bytes / 1e6)),
];

/// Times that a bake is measured, in a hurry and else, as long as all of them together took no more than so many seconds before.
const TURNS: [usize; 2] = [1, 3];
const PATIENCE_SECS: f64 = 30.0;
/// Of the first bake; each further one has the next.
const SEED: u64 = 1;
/// CPU seconds from which on a point is fitted: they are counted in hundredths.
const LEAST_SECS: f64 = 0.05;
/// Fewer points tell of no power law.
const LEAST_POINTS: usize = 3;
const BOUNCES: &str = "bounces";
const THREADS: &str = "threads";

/// Something that grows: its name, its values, and how it changes the bench.
type Growth = (&'static str, &'static [u32], fn(&mut Bench, u32) -> f64);

const QUICK: [Growth; 5] = [
    ("pixels", &[64, 128, 256], pixels),
    ("columns", &[4, 8, 16], columns),
    ("triangles", &[1_000, 10_000, 100_000], triangles),
    (BOUNCES, &[0, 1, 2, 4], bounces),
    (THREADS, &[1, 2, 4], on_threads),
];
const FULL: [Growth; 5] = [
    ("pixels", &[292, 576, 1152, 2304, 3264], pixels),
    ("columns", &[4, 8, 16, 32, 64], columns),
    ("triangles", &[1_000, 10_000, 100_000, 1_000_000, 5_000_000], triangles),
    (BOUNCES, &[0, 1, 2, 4, 8, 16], bounces),
    (THREADS, &[1, 2, 4, 8, 16], on_threads),
];

fn pixels(bench: &mut Bench, width: u32) -> f64 {
    (bench.size, bench.side, bench.spp) = ([width, width * 3 / 4], 4, 2);
    f64::from(bench.size[0]) * f64::from(bench.size[1])
}

fn columns(bench: &mut Bench, side: u32) -> f64 {
    bench.side = side;
    f64::from(side * side)
}

fn triangles(bench: &mut Bench, n: u32) -> f64 {
    bench.triangles = n as usize;
    f64::from(n)
}

fn bounces(bench: &mut Bench, n: u32) -> f64 {
    bench.bounces = Some(n);
    f64::from(n)
}

fn on_threads(bench: &mut Bench, n: u32) -> f64 {
    bench.threads = Some(n as usize);
    f64::from(n)
}

/// Lets one thing after the other grow.
///
/// # Errors
/// If a bake fails, or this system does not tell the CPU time of a process.
pub fn write(desk: &Desk) -> Result<String> {
    let size = desk.choose([64, 48], [128, 96]);
    let bench =
        Bench { triangles: 100_000, side: 8, size, spp: desk.choose(4, 8), bounces: None, threads: None, seed: SEED };
    let (mut rows, mut of_time, mut of_memory) = (String::new(), Vec::new(), Vec::new());
    let n_threads = std::thread::available_parallelism().map_or(1, usize::from);
    let turns = desk.choose(TURNS[0], TURNS[1]);
    for (what, values, set) in desk.choose(QUICK, FULL) {
        let mut costs = Vec::new();
        for &value in values {
            costs.push(desk.part("growth", &format!("{what}-{value}"), || {
                desk.say(&format!("baking with {what} set by {value}"));
                let mut bench = bench;
                let at = set(&mut bench, value);
                Ok(Cost { at, taken: repeated(bench, turns)? })
            })?);
        }
        rows += &table_rows(what, &costs, n_threads);
        of_time.push(panel((what, &costs), "seconds", &SECONDS));
        of_memory.push(panel((what, &costs), "MB", &MEGABYTES));
    }
    let mut text = format!(
        "## Growth\n\n\
         A generated hall of about {} triangles under a panel of 8 × 8 texels, {} × {} pixels, {} samples of each, indirect light traced, roulette alone ends\n\
         paths; then one thing after the other grows (triangles are those that the hall is asked for, which it has to within a few in a hundred; with the pixels, 16 columns and 2 samples; threads beyond those of the machine share its cores). CPU seconds of preparing the scene (hierarchy, lights) and\n\
         of the bake, and the bake's seconds by the clock, each bake in a process of its own, median (least…greatest) of the seeds {}, fewer where those before took more than {PATIENCE_SECS} s together; of memory, bytes and errors one figure where all of them round to it.\n\
         Memory of the scene is what the process has more when it is prepared (what was freed meanwhile is given back), that of the bake the most that it had beyond this; bytes are those of the file, the error is what the bake tells of itself (truncation and sampling): where it grows, what is kept of noise shrinks, and with it the file. The exponent e of the\n\
         power law y ∝ xᵉ is fitted by least squares of the logarithms of the medians to so many points: left out are more threads than the machine has, and CPU seconds below {LEAST_SECS}, as they are counted in hundredths; of fewer than {LEAST_POINTS} points there is none, nor of bounces, of which roulette leaves ever fewer. {}\n",
        bench.triangles,
        size[0],
        size[1],
        bench.spp,
        listed(&seeds(turns)),
        desk.load_words(),
    );
    for (file, what, panels) in [("growth", "seconds", of_time), ("growth-memory", "memory and bytes", of_memory)] {
        let words = format!("{what} of a bake as pixels, columns, triangles, bounces and threads grow");
        text += &desk.plot(file, &words, &panels)?;
    }
    text += &format!("\n{HEAD}{rows}");
    text += &threads::write(desk, "growth")?;
    Ok(text)
}

const HEAD: &str = "| what grows | | preparing, CPU s | bake, CPU s | bake, s by the clock | scene, MB | bake, MB | file, kB | error, dB |\n\
    |---|---|---|---|---|---|---|---|---|\n";

fn seeds(turns: usize) -> Vec<u64> {
    (SEED..).take(turns).collect()
}

/// A bake with one seed after the other, unless those before took too long.
fn repeated(bench: Bench, turns: usize) -> Result<Vec<Taken>> {
    let (mut taken, mut secs) = (Vec::new(), 0.0);
    for seed in seeds(turns) {
        if secs > PATIENCE_SECS {
            break;
        }
        let once = in_own_process(Bench { seed, ..bench })?;
        secs += once.prepare_secs + once.bake_secs;
        taken.push(once);
    }
    Ok(taken)
}

/// The option of the report in the process that bakes one bench: its memory and its time are those of this bake alone.
pub const ONE: &str = "grow";

fn in_own_process(bench: Bench) -> Result<Taken> {
    let told =
        Command::new(std::env::current_exe()?).arg(format!("--{ONE}")).arg(serde_json::to_string(&bench)?).output()?;
    ensure!(told.status.success(), "a bake failed: {}", String::from_utf8_lossy(&told.stderr));
    serde_json::from_slice(&told.stdout).context("a bake of its own process told no JSON")
}

/// Bakes the bench that is described, and describes what it took.
///
/// # Errors
/// If the bake fails, or this system does not tell the CPU time of a process.
pub fn one(bench: &str) -> Result<String> {
    let bench: Bench = serde_json::from_str(bench).context("no description of a bake")?;
    let (begun, empty) = (process_cpu_secs()?, resident_bytes());
    let scene = room::prepared(bench.triangles, bench.side)?;
    let prepare_secs = process_cpu_secs()? - begun;
    // What was freed meanwhile is no memory of the scene, and the bake that takes it again takes it for itself.
    trim_freed_memory();
    let with_scene = resident_bytes();
    let before = with_scene.filter(|_| forget_peak());
    // Threads are started before, as those are that the scene was prepared on.
    let pool = bench.threads.map(|n| rayon::ThreadPoolBuilder::new().num_threads(n).build()).transpose()?;
    let (begun, begun_by_clock) = (process_cpu_secs()?, Instant::now());
    let bake = || job(&scene, bench).run(|_| ControlFlow::Continue(()));
    let bake = match &pool {
        None => bake()?,
        Some(pool) => pool.install(bake)?,
    };
    let bake = bake.context("nobody stops a bake of the report")?;
    let (bake_secs, clock_secs) = (process_cpu_secs()? - begun, begun_by_clock.elapsed().as_secs_f64());
    let taken = Taken {
        prepare_secs,
        bake_secs,
        clock_secs,
        scene_bytes: beyond(with_scene, empty),
        peak_bytes: beyond(peak_bytes(), before),
        file_bytes: bake.figures().file_bytes.context("a finished bake is packed")? as f64,
        error_db: f64::from(bake.figures().error_db.total),
    };
    Ok(serde_json::to_string(&taken)?)
}

/// How many bytes are more than others, where both are known.
fn beyond(bytes: Option<u64>, before: Option<u64>) -> Option<f64> {
    bytes.zip(before).map(|(bytes, before)| bytes.saturating_sub(before) as f64)
}

fn job(scene: &Arc<PreparedScene>, bench: Bench) -> BakeJob {
    let config = BakeConfig { spp: bench.spp, bounces: bench.bounces, seed: bench.seed, ..BakeConfig::default() };
    let [width, height] = bench.size;
    let (scene, camera, film) = (scene.clone(), scene.scene.cameras[0].clone(), Film { width, height });
    BakeJob { scene, camera, film, config, passes: Passes::FinalOnly, irradiance: Vec::new() }
}

/// Asks Linux to count the most memory from now on; whether it does.
fn forget_peak() -> bool {
    std::fs::write("/proc/self/clear_refs", "5").is_ok()
}

/// A row for each value of what grows, and one of the exponents, given the threads of the machine.
fn table_rows(what: &str, costs: &[Cost], n_threads: usize) -> String {
    let row = |cost: &Cost| {
        format!(
            "| {what} | {:.0} | {} | {} | {} | {} | {} | {} | {} |\n",
            cost.at,
            cpu_words(cost.all(|taken| Some(taken.prepare_secs))),
            cpu_words(cost.all(|taken| Some(taken.bake_secs))),
            spread_words(cost.all(|taken| Some(taken.clock_secs))),
            told(&cost.all(|taken| Some(taken.scene_bytes? / 1e6))),
            told(&cost.all(|taken| Some(taken.peak_bytes? / 1e6))),
            told(&cost.all(|taken| Some(taken.file_bytes / 1e3))),
            told(&cost.all(|taken| Some(taken.error_db))),
        )
    };
    let rows: String = costs.iter().map(row).collect();
    if what == BOUNCES {
        return rows;
    }
    let is_fitted = |cost: &&Cost| what != THREADS || cost.at <= n_threads as f64;
    let fitted = |of: Figure, least: f64| {
        let points = costs.iter().filter(is_fitted).filter_map(|cost| Some([cost.at, median(&cost.all(of))?]));
        exponent_words(points.filter(|[_, y]| *y >= least))
    };
    rows + &format!(
        "| **{what}, exponent** | | {} | {} | {} | {} | {} | {} | |\n",
        fitted(|taken| Some(taken.prepare_secs), LEAST_SECS),
        fitted(|taken| Some(taken.bake_secs), LEAST_SECS),
        fitted(|taken| Some(taken.clock_secs), 0.0),
        fitted(|taken| taken.scene_bytes, 0.0),
        fitted(|taken| taken.peak_bytes, 0.0),
        fitted(|taken| Some(taken.file_bytes), 0.0),
    )
}

/// Median (least…greatest) with one digit behind the point, or one figure where all of them round to it; “—” of nothing.
fn told(values: &[f64]) -> String {
    let Some(first) = values.first() else { return "—".into() };
    let differ = values.iter().any(|value| format!("{value:.1}") != format!("{first:.1}"));
    tenths(if differ { values.to_vec() } else { vec![*first] })
}

/// The exponent of the points (x, y) above zero, and how many they are.
fn exponent_words(points: impl Iterator<Item = [f64; 2]>) -> String {
    let points: Vec<[f64; 2]> = points.filter(|[x, y]| *x > 0.0 && *y > 0.0).collect();
    let words = |e: f64| {
        // What is next to nothing has no sign.
        let e = if e.abs() < 0.005 { 0.0 } else { e };
        format!("{e:.2} ({} points)", points.len())
    };
    exponent(&points).filter(|_| points.len() >= LEAST_POINTS).map_or("—".into(), words)
}

fn panel((what, costs): (&'static str, &[Cost]), label: &'static str, curves: &[Curve]) -> Panel {
    let series = |&(name, of): &Curve| Series {
        name: name.into(),
        points: costs.iter().filter_map(|cost| Some([cost.at, median(&cost.all(of))?])).collect(),
        is_joined: true,
    };
    let scale = if what == BOUNCES { Scale::Linear } else { Scale::Log };
    Panel {
        title: what.into(),
        x: Axis { label: what, scale },
        y: Axis { label, scale: Scale::Log },
        series: curves.iter().map(series).filter(|series| !series.points.is_empty()).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bake_on_more_threads_has_as_many_bytes() {
        let on = |n: u32| {
            let size = [32, 24];
            let mut bench = Bench { triangles: 1000, side: 4, size, spp: 4, bounces: Some(0), threads: None, seed: 1 };
            assert_eq!(on_threads(&mut bench, n), f64::from(n));
            assert_eq!(bench.threads, Some(n as usize));
            let told = one(&serde_json::to_string(&bench).unwrap()).unwrap();
            let taken: Taken = serde_json::from_str(&told).unwrap();
            assert_eq!(
                taken.scene_bytes.is_some(),
                resident_bytes().is_some(),
                "the scene has memory where it is told"
            );
            taken.file_bytes
        };
        let [alone, three] = [1, 3].map(on);
        assert!(alone > 0.0 && alone == three, "{alone} {three}");
    }

    /// Twice as much of what grows takes a scene of four times the memory, and a bake of as much, which differs from seed to seed.
    fn grown() -> Vec<Cost> {
        let taken = |at: f64, seed: f64| Taken {
            prepare_secs: 0.01 * at,
            bake_secs: at,
            clock_secs: 0.5 * at,
            scene_bytes: Some(1e6 * at * at),
            peak_bytes: Some(2e6 * seed),
            file_bytes: 1e3 * at,
            error_db: 30.0,
        };
        let cost = |at: f64| Cost { at, taken: [1.0, 1.25, 0.75].map(|seed| taken(at, seed)).into() };
        [1.0, 2.0, 4.0].map(cost).into()
    }

    #[test]
    fn memory_and_bytes_are_told_with_their_ends_and_exponents() {
        let rows = table_rows("triangles", &grown(), 1);
        let first = "| triangles | 1 | 0.01 (0.01…0.01) | 1.0 (1.0…1.0) | 0.50 (0.50…0.50) | 1.0 | 2.0 (1.5…2.5) | 1.0 | 30.0 |\n";
        assert!(rows.starts_with(first), "{rows}");
        let last =
            "| — | 1.00 (3 points) | 1.00 (3 points) | 2.00 (3 points) | 0.00 (3 points) | 1.00 (3 points) | |\n";
        assert!(rows.ends_with(last), "{rows}");
        assert!(!table_rows(BOUNCES, &grown(), 1).contains("exponent"), "they come to an end");
        assert_eq!((told(&[]), seeds(3)), ("—".into(), vec![1, 2, 3]));
    }

    #[test]
    fn more_threads_than_the_machine_has_are_no_points_of_a_power_law() {
        let fitted = |n_threads: usize| table_rows(THREADS, &grown(), n_threads);
        assert!(fitted(4).ends_with("| 1.00 (3 points) | |\n"), "{}", fitted(4));
        assert!(fitted(2).ends_with("| **threads, exponent** | | — | — | — | — | — | — | |\n"), "{}", fitted(2));
        assert!(fitted(2).starts_with("| threads | 1 |") && fitted(2).contains("| threads | 4 |"), "{}", fitted(2));
    }

    #[test]
    fn what_the_system_does_not_tell_is_no_curve() {
        let mut costs = grown();
        let named = |costs: &[Cost]| -> Vec<(String, Vec<[f64; 2]>)> {
            let series = panel(("triangles", costs), "MB", &MEGABYTES).series;
            series.into_iter().map(|series| (series.name, series.points)).collect()
        };
        let all = named(&costs);
        assert_eq!(all.len(), 3);
        assert_eq!(all[0], ("memory of the scene".into(), vec![[1.0, 1.0], [2.0, 4.0], [4.0, 16.0]]));
        costs.iter_mut().flat_map(|cost| &mut cost.taken).for_each(|taken| taken.scene_bytes = None);
        assert_eq!(named(&costs)[0].0, "memory of the bake");
    }

    #[test]
    fn an_exponent_says_of_how_many_points_it_is_and_two_have_none() {
        let points = [[0.0, 5.0], [1.0, 2.0], [2.0, 4.0], [4.0, 8.0]];
        assert_eq!(exponent_words(points.into_iter()), "1.00 (3 points)");
        assert_eq!(exponent_words(points[..3].iter().copied()), "—");
        assert_eq!(exponent_words([[1.0, 1.0], [2.0, 0.999], [4.0, 0.999]].into_iter()), "0.00 (3 points)");
    }
}
