//! The one command that writes `docs/benchmarks.md`: bakes scenes, relights them, holds them against path tracing, and
//! writes down what it measured. `cargo run --release -p clerestory --bin report -- [--quick]`
//!
//! Scenes of `assets/scenes` always; those of the folder named by `CLERESTORY_SHARED` where it exists.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use serde_json::Value;

/// One bake that is measured.
struct Case {
    path: PathBuf,
    size: &'static str,
    spp: &'static str,
    tolerance: &'static str,
}

/// Samples per pixel of the path-traced pictures that bakes are held against.
const REFERENCE_SPP: [&str; 2] = ["1024", "64"];

fn main() -> ExitCode {
    let quick = std::env::args().any(|arg| arg == "--quick");
    match report(quick) {
        Ok(path) => {
            complain(&format!("wrote {}", path.display()));
            ExitCode::SUCCESS
        }
        Err(error) => {
            complain(&format!("report: {error:#}"));
            ExitCode::FAILURE
        }
    }
}

#[expect(clippy::print_stderr, reason = "this binary speaks to people")]
fn complain(words: &str) {
    eprintln!("{words}");
}

fn report(quick: bool) -> Result<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize()?;
    let scratch = std::env::temp_dir().join(format!("clerestory-report-{}", std::process::id()));
    std::fs::create_dir_all(&scratch)?;
    let cases = cases(&root, quick);
    let mut rows = String::new();
    for case in &cases {
        complain(&format!("{} …", case.path.display()));
        rows += &measure(case, &scratch, REFERENCE_SPP[usize::from(quick)])?;
    }
    std::fs::remove_dir_all(&scratch)?;
    let out = root.join("docs/benchmarks.md");
    std::fs::write(&out, page(&rows, quick))?;
    Ok(out)
}

fn cases(root: &Path, quick: bool) -> Vec<Case> {
    let (size, spp) = if quick { ("192x144", "16") } else { ("512x384", "128") };
    let mut cases: Vec<Case> = ["gallery", "diffuse", "reflections", "caustics", "mixed"]
        .iter()
        .map(|name| Case { path: root.join(format!("assets/scenes/{name}.glb")), size, spp, tolerance: "40" })
        .collect();
    if let Some(shared) = std::env::var_os("CLERESTORY_SHARED") {
        let scenes = Path::new(&shared).join("scenes");
        for name in ["conference", "conference-panel", "bitterli-staircase2"] {
            cases.push(Case { path: scenes.join(format!("{name}.glb")), size, spp, tolerance: "40" });
        }
    }
    cases.retain(|case| case.path.exists());
    cases
}

/// Bakes, relights, traces and compares one scene; returns a row of the table.
fn measure(case: &Case, scratch: &Path, reference_spp: &str) -> Result<String> {
    let name = case.path.file_stem().and_then(|s| s.to_str()).unwrap_or("scene").to_string();
    let file = |ending: &str| scratch.join(format!("{name}.{ending}")).display().to_string();
    let (scene, transport) = (case.path.display().to_string(), file("transport"));
    let sized = ["--size", case.size, "--json"];
    let mut bake = vec!["bake", &scene, "-o", &transport, "--spp", case.spp, "--tolerance", case.tolerance];
    bake.extend(sized);
    let baked = clerestory(&bake)?;
    let (relit, traced) = (file("relight.exr"), file("trace.exr"));
    clerestory(&["relight", &transport, "-o", &relit, "--device", "cpu", "--json"])?;
    let mut trace = vec!["trace", &scene, "-o", &traced, "--spp", reference_spp, "--seed", "7"];
    trace.extend(sized);
    clerestory(&trace)?;
    let compared = clerestory(&["compare", &relit, &traced, "--json"])?;
    let told = clerestory(&["info", &transport, "--json"])?;
    let number = |value: &Value, key: &str| value.pointer(key).and_then(Value::as_f64).unwrap_or(f64::NAN);
    let mut row = String::new();
    writeln!(
        row,
        "| {name} | {} | {:.0} | {:.1} | {:.1} | {:.2} / {:.0} | {:.1} | {:.0}× | {:.1} / {:.1} / {:.1} | {:.1} |",
        case.size.replace('x', "×"),
        number(&told, "/columns"),
        number(&baked, "/preview_secs"),
        number(&baked, "/bake_secs"),
        number(&told, "/mean_rank"),
        number(&told, "/max_rank"),
        number(&told, "/bytes") / 1e6,
        number(&told, "/ratio"),
        number(&told, "/error_db/truncation"),
        number(&told, "/error_db/sampling"),
        number(&told, "/error_db/total"),
        number(&compared, "/psnr_db"),
    )?;
    Ok(row)
}

/// Runs the command line in this process and reads the JSON that it prints.
fn clerestory(args: &[&str]) -> Result<Value> {
    let (mut out, mut err) = (Vec::new(), Vec::new());
    let args = std::iter::once("clerestory").chain(args.iter().copied()).map(String::from);
    let code = clerestory::cli::run(args, &mut out, &mut err);
    if code != ExitCode::SUCCESS {
        bail!("{}", String::from_utf8_lossy(&err));
    }
    serde_json::from_slice(&out).with_context(|| format!("not JSON: {}", String::from_utf8_lossy(&out)))
}

fn page(rows: &str, quick: bool) -> String {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let command = if quick { "report -- --quick" } else { "report" };
    format!(
        "# Benchmarks\n\n\
         Written by `cargo run --release -p clerestory --bin {command}` on {threads} threads. Times are of one run and depend on the\n\
         machine; figures of one table come from one run.\n\n\
         ## Bakes\n\n\
         At most {} samples per pixel, asked for 40 dB. Times in seconds, from the start of the command: to the preview (a whole\n\
         picture with all columns) and to the end. Errors in dB, measured on held-out entries: truncation / sampling / total. The\n\
         last column holds the relit picture (all lights as in the file) against a path-traced one of {} samples, whose own noise counts.\n\n\
         | scene | size | columns | preview | bake | rank mean / max | MB | dense / file | error dB | PSNR against trace |\n\
         |---|---|---|---|---|---|---|---|---|---|\n{rows}",
        if quick { "16" } else { "128" },
        REFERENCE_SPP[usize::from(quick)],
    )
}
