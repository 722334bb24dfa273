//! Budgets: what a bake is said to take, and what it takes.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use serde_json::Value;

use super::desk::{Desk, number, program};

/// A scene, the size of its picture, and further options.
type Case = (&'static str, &'static str, &'static [&'static str]);

const CASES: [Case; 7] = [
    ("scenes/conference.glb", "96x72", &[]),
    ("scenes/sponza-dabrovic.glb", "96x72", &[]),
    ("assets/scenes/gallery.glb", "48x36", &[]),
    ("scenes/bitterli-staircase2.glb", "96x72", &[]),
    ("scenes/bitterli-classroom.glb", "96x72", &[]),
    ("assets/scenes/diffuse.glb", "320x240", &[]),
    ("scenes/conference.glb", "96x72", &["--patches", "256"]),
];
const SEED: &str = "1";
/// How often the memory of a bake is asked for.
const POLL: Duration = Duration::from_millis(2);

/// Estimates bakes, bakes, and compares.
///
/// # Errors
/// If a scene cannot be baked, or the system does not tell the memory of a process.
pub fn write(desk: &Desk) -> Result<String> {
    let mut rows = String::new();
    for (nth, case) in CASES.iter().take(desk.choose(3, CASES.len())).enumerate() {
        let own = Some(desk.root.join(case.0)).filter(|path| path.exists());
        let Some(scene) = own.or_else(|| desk.shared(case.0)) else { continue };
        rows += &desk.part::<String>("budgets", &nth.to_string(), || row(desk, case, &scene))?;
    }
    Ok(format!(
        "What `bake --estimate` says against what the bake takes, with 16 samples of a pixel (seed {SEED}): the greatest resident set of the process,\n\
         reading the scene included, and the seconds from the start of the bake. {}\n\n{}\n\n\
         | scene | picture | MB said | taken | off | s said | taken | off | file, off |\n|---|---|---|---|---|---|---|---|---|\n{rows}",
        desk.load_words(),
        desk.provenance("budgets")?,
    ))
}

fn row(desk: &Desk, (_, size, more): &Case, scene: &Path) -> Result<String> {
    let name = scene.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    desk.say(&format!("budget of {name}"));
    let scene = scene.display().to_string();
    let (output, more) = (desk.file("budget.transport"), more.join(" "));
    let with = |first: &[&str]| -> Vec<String> {
        let common = [&scene, "--size", size, "--spp", "16", "--seed", SEED, "--json"].map(String::from);
        first.iter().copied().chain(more.split_whitespace()).map(String::from).chain(common).collect()
    };
    let (said, _) = run(&with(&["bake", "--estimate"]))?;
    let (took, peak_bytes) = run(&with(&["bake", "--fresh", "-o", &output]))?;
    let (said_secs, secs) = (number(&said, "/secs"), number(&took, "/bake_secs"));
    let (said_bytes, bytes) = (number(&said, "/peak_bytes"), peak_bytes as f64);
    let file = std::fs::metadata(&output)?.len() as f64;
    let said_file = number(&said, "/file_bytes");
    let off = |said: f64, is: f64| 100.0 * (said / is - 1.0);
    Ok(format!(
        "| {} | {size} | {:.0} | {:.0} | {:+.0} % | {said_secs:.1} | {secs:.1} | {:+.0} % | {:+.0} % |\n",
        [name.as_str(), &more].join(" ").trim_end(),
        said_bytes / 1e6,
        bytes / 1e6,
        off(said_bytes, bytes),
        off(said_secs, secs),
        off(said_file, file),
    ))
}

/// Runs the command line in a process of its own: what it answers, and the most memory that it took, bytes.
fn run(args: &[String]) -> Result<(Value, u64)> {
    let mut command = Command::new(program()?);
    let begun = Instant::now();
    let mut child = command.args(args).stdout(Stdio::piped()).stderr(Stdio::null()).stdin(Stdio::null()).spawn()?;
    let mut peak_bytes = 0;
    while child.try_wait()?.is_none() {
        peak_bytes = clerestory::platform::peak_bytes_of(child.id()).unwrap_or(0).max(peak_bytes);
        std::thread::sleep(POLL);
    }
    let output = child.wait_with_output()?;
    ensure!(output.status.success(), "{args:?} failed after {:.1} s", begun.elapsed().as_secs_f64());
    ensure!(peak_bytes > 0, "the system does not tell the memory of a process");
    let answer = serde_json::from_slice(&output.stdout).context("the answer is not JSON")?;
    Ok((answer, peak_bytes))
}
