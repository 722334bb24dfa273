//! Growth: what a bake takes as pictures, lights, triangles, bounces and threads grow.

#[path = "../../../../transport/examples/ray_rates/hall.rs"]
mod hall;
mod room;
pub mod threads;

use std::ops::ControlFlow;
use std::process::Command;
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use clerestory::platform::{peak_bytes, resident_bytes};
use clerestory_transport::bake::{BakeConfig, BakeJob, Passes};
use clerestory_transport::camera::Film;
use clerestory_transport::prepared::PreparedScene;
use serde::{Deserialize, Serialize};

use super::desk::Desk;
use super::fit::{cpu_words, exponent, median};
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
}

/// What one bake took, again and again.
#[derive(Serialize, Deserialize)]
struct Cost {
    /// What grows.
    at: f64,
    prepare_secs: Vec<f64>,
    bake_secs: Vec<f64>,
    /// Most memory of the process at a time, beyond what it had when the scene was prepared; none where the system does not tell.
    peak_bytes: Option<f64>,
    file_bytes: f64,
    /// What the bake tells of itself.
    error_db: f64,
}

/// Times that a bake is measured, in a hurry and else, as long as all of them together took no more than so many seconds before.
const TURNS: [usize; 2] = [1, 3];
const PATIENCE_SECS: f64 = 30.0;
/// CPU seconds from which on a point is fitted: they are counted in hundredths.
const LEAST_SECS: f64 = 0.05;
/// Fewer points tell of no power law.
const LEAST_POINTS: usize = 3;

/// Something that grows: its name, its values, and how it changes the bench.
type Growth = (&'static str, &'static [u32], fn(&mut Bench, u32) -> f64);

const QUICK: [Growth; 5] = [
    ("pixels", &[64, 128, 256], pixels),
    ("columns", &[4, 8, 16], columns),
    ("triangles", &[1_000, 10_000, 100_000], triangles),
    ("bounces", &[0, 1, 2, 4], bounces),
    ("threads", &[1, 2, 4], on_threads),
];
const FULL: [Growth; 5] = [
    ("pixels", &[292, 576, 1152, 2304, 3264], pixels),
    ("columns", &[4, 8, 16, 32, 64], columns),
    ("triangles", &[1_000, 10_000, 100_000, 1_000_000, 5_000_000], triangles),
    ("bounces", &[0, 1, 2, 4, 8, 16], bounces),
    ("threads", &[1, 2, 4, 8, 16], on_threads),
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
    let bench = Bench { triangles: 100_000, side: 8, size, spp: desk.choose(4, 8), bounces: None, threads: None };
    let (mut rows, mut panels, turns) = (String::new(), Vec::new(), desk.choose(TURNS[0], TURNS[1]));
    for (what, values, set) in desk.choose(QUICK, FULL) {
        let mut costs = Vec::new();
        for &value in values {
            costs.push(desk.part("growth", &format!("{what}-{value}"), || {
                desk.say(&format!("baking with {what} set by {value}"));
                let mut bench = bench;
                let at = set(&mut bench, value);
                let mut cost = Cost { at, ..in_own_process(bench)? };
                let taken = |cost: &Cost| cost.prepare_secs.iter().chain(&cost.bake_secs).sum::<f64>();
                while cost.bake_secs.len() < turns && taken(&cost) <= PATIENCE_SECS {
                    let again = in_own_process(bench)?;
                    cost.prepare_secs.extend(again.prepare_secs);
                    cost.bake_secs.extend(again.bake_secs);
                }
                Ok(cost)
            })?);
        }
        rows += &table_rows(what, &costs);
        panels.push(panel(what, &costs));
    }
    let mut text = format!(
        "## Growth\n\n\
         A generated hall of {} triangles under a panel of 8 × 8 texels, {} × {} pixels, {} samples of each, indirect light traced, roulette alone ends\n\
         paths; then one thing after the other grows (with the pixels, 16 columns and 2 samples; threads beyond those of the machine share its cores). CPU seconds of preparing the scene (hierarchy, lights) and\n\
         of the bake, each in a process of its own, median (least…greatest) of {turns} where they took no more than {PATIENCE_SECS} s together, else once; memory is the most that it had beyond the prepared scene; bytes are those of the file, the error is what the bake tells of itself (truncation and sampling): where it grows, what is kept of noise shrinks, and with it the file. The exponent e of the\n\
         power law y ∝ xᵉ is fitted by least squares of the logarithms to so many points: left out are no bounces at all, and CPU seconds below {LEAST_SECS}, as they are counted in hundredths. Seed 1. {}\n",
        bench.triangles,
        size[0],
        size[1],
        bench.spp,
        desk.load_words(),
    );
    text += &desk.plot(
        "growth",
        "CPU seconds of a bake as pixels, columns, triangles, bounces and threads grow",
        &panels,
    )?;
    text += &format!(
        "\n| what grows | | preparing, CPU s | bake, CPU s | memory, MB | file, kB | error, dB |\n|---|---|---|---|---|---|---|\n{rows}"
    );
    text += &threads::write(desk, "growth")?;
    Ok(text)
}

/// What the report is asked in the process that bakes one bench: its memory and its time are those of this bake alone.
pub const ONE: &str = "--grow";

fn in_own_process(bench: Bench) -> Result<Cost> {
    let told = Command::new(std::env::current_exe()?).arg(ONE).arg(serde_json::to_string(&bench)?).output()?;
    ensure!(told.status.success(), "a bake failed: {}", String::from_utf8_lossy(&told.stderr));
    serde_json::from_slice(&told.stdout).context("a bake of its own process told no JSON")
}

/// Bakes the bench that is described, and describes what it took.
///
/// # Errors
/// If the bake fails, or this system does not tell the CPU time of a process.
pub fn one(bench: &str) -> Result<String> {
    let bench: Bench = serde_json::from_str(bench).context("no description of a bake")?;
    let begun = process_cpu_secs()?;
    let scene = room::prepared(bench.triangles, bench.side)?;
    let prepared = process_cpu_secs()?;
    let before = resident_bytes().filter(|_| forget_peak());
    let bake = || job(&scene, bench).run(|_| ControlFlow::Continue(()));
    let bake = match bench.threads {
        None => bake()?,
        Some(n) => rayon::ThreadPoolBuilder::new().num_threads(n).build()?.install(bake)?,
    };
    let bake = bake.context("nobody stops a bake of the report")?;
    let bake_secs = process_cpu_secs()? - prepared;
    let peak_bytes = peak_bytes().zip(before).map(|(peak, before)| peak.saturating_sub(before) as f64);
    let file_bytes = bake.figures().file_bytes.context("a finished bake is packed")? as f64;
    let error_db = f64::from(bake.figures().error_db.total);
    let (prepare_secs, bake_secs) = (vec![prepared - begun], vec![bake_secs]);
    let cost = Cost { at: 0.0, prepare_secs, bake_secs, peak_bytes, file_bytes, error_db };
    Ok(serde_json::to_string(&cost)?)
}

fn job(scene: &Arc<PreparedScene>, bench: Bench) -> BakeJob {
    let config = BakeConfig { spp: bench.spp, bounces: bench.bounces, seed: 1, ..BakeConfig::default() };
    let [width, height] = bench.size;
    let (scene, camera, film) = (scene.clone(), scene.scene.cameras[0].clone(), Film { width, height });
    BakeJob { scene, camera, film, config, passes: Passes::FinalOnly, irradiance: Vec::new() }
}

/// Asks Linux to count the most memory from now on; whether it does.
fn forget_peak() -> bool {
    std::fs::write("/proc/self/clear_refs", "5").is_ok()
}

fn table_rows(what: &str, costs: &[Cost]) -> String {
    let row = |cost: &Cost| {
        let memory = cost.peak_bytes.map_or("—".into(), |bytes| format!("{:.1}", bytes / 1e6));
        format!(
            "| {what} | {:.0} | {} | {} | {memory} | {:.1} | {:.1} |\n",
            cost.at,
            cpu_words(cost.prepare_secs.clone()),
            cpu_words(cost.bake_secs.clone()),
            cost.file_bytes / 1e3,
            cost.error_db,
        )
    };
    let fitted =
        |of: &dyn Fn(&Cost) -> Option<f64>| exponent_words(costs.iter().filter_map(|cost| Some([cost.at, of(cost)?])));
    let rows: String = costs.iter().map(row).collect();
    rows + &format!(
        "| **{what}, exponent** | | {} | {} | {} | {} | |\n",
        fitted(&|cost| median(&cost.prepare_secs).filter(|secs| *secs >= LEAST_SECS)),
        fitted(&|cost| median(&cost.bake_secs).filter(|secs| *secs >= LEAST_SECS)),
        fitted(&|cost| cost.peak_bytes),
        fitted(&|cost| Some(cost.file_bytes)),
    )
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

fn panel(what: &'static str, costs: &[Cost]) -> Panel {
    let series = |name: &str, of: &dyn Fn(&Cost) -> f64| Series {
        name: name.into(),
        points: costs.iter().map(|cost| [cost.at, of(cost)]).collect(),
        is_joined: true,
    };
    let scale = if what == "bounces" { Scale::Linear } else { Scale::Log };
    Panel {
        title: what.into(),
        x: Axis { label: what, scale },
        y: Axis { label: "CPU seconds", scale: Scale::Log },
        series: vec![
            series("preparing", &|cost| middle(&cost.prepare_secs)),
            series("bake", &|cost| middle(&cost.bake_secs)),
        ],
    }
}

/// None is a number of no repeats.
fn middle(secs: &[f64]) -> f64 {
    median(secs).unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bake_on_more_threads_has_as_many_bytes() {
        let on = |n: u32| {
            let size = [32, 24];
            let mut bench = Bench { triangles: 1000, side: 4, size, spp: 4, bounces: Some(0), threads: None };
            assert_eq!(on_threads(&mut bench, n), f64::from(n));
            assert_eq!(bench.threads, Some(n as usize));
            let told = one(&serde_json::to_string(&bench).unwrap()).unwrap();
            serde_json::from_str::<Cost>(&told).unwrap().file_bytes
        };
        let [alone, three] = [1, 3].map(on);
        assert!(alone > 0.0 && alone == three, "{alone} {three}");
    }

    #[test]
    fn an_exponent_says_of_how_many_points_it_is_and_two_have_none() {
        let points = [[0.0, 5.0], [1.0, 2.0], [2.0, 4.0], [4.0, 8.0]];
        assert_eq!(exponent_words(points.into_iter()), "1.00 (3 points)");
        assert_eq!(exponent_words(points[..3].iter().copied()), "—");
        assert_eq!(exponent_words([[1.0, 1.0], [2.0, 0.999], [4.0, 0.999]].into_iter()), "0.00 (3 points)");
    }
}
