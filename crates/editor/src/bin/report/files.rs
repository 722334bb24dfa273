//! From a file to a picture: the command line as a script calls it, a process for each picture; and how long a large file takes to load.

mod loading;

use std::path::Path;
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, Result, ensure};

use super::desk::{Desk, clerestory, number, program};

/// Times that each picture is written.
const TRIES: usize = 9;
/// Most samples per pixel of the bakes, and their seed.
const SPP: &str = "4";
const SEED: &str = "1";

/// Bakes two scenes and relights their files to pictures.
///
/// # Errors
/// If a scene cannot be baked.
pub fn write(desk: &Desk) -> Result<String> {
    let size = desk.choose("192x144", "1024x768");
    let program = program()?;
    let own = Some(desk.root.join("assets/scenes/gallery.glb"));
    let scenes = [("gallery", own), ("conference-panel", desk.shared("scenes/conference-panel.glb"))];
    let mut rows = String::new();
    for (name, path) in scenes.into_iter().filter_map(|(name, path)| Some((name, path?))) {
        rows += &desk.part::<String>("files", name, || {
            desk.say(&format!("baking {name}"));
            let (scene, transport) = (path.display().to_string(), desk.file(&format!("{name}-{size}.transport")));
            let how = ["--size", size, "--spp", SPP, "--seed", SEED, "--json"];
            clerestory(&[&["bake", &scene, "-o", &transport][..], &how].concat())?;
            written(desk, &program, (name, transport.as_str()))
        })?;
    }
    let loading = desk.part::<String>("files", "loading", || loading::write(desk))?;
    Ok(format!(
        "## From a file to a picture\n\n\
         `clerestory relight FILE.transport -o PICTURE` at {} pixels on the CPU, a process of its own for each, from its start to its end: median of\n\
         {TRIES}, and least to most. Bakes of at most {SPP} samples, seed {SEED}. {}\n\n\
         | scene | transport | columns | picture | time | spread | size of the picture |\n|---|---|---|---|---|---|---|\n{rows}{loading}",
        size.replace('x', " × "),
        desk.load_words(),
    ))
}

/// The rows of a bake, each kind of picture written again and again.
fn written(desk: &Desk, program: &Path, (name, transport): (&str, &str)) -> Result<String> {
    let told = clerestory(&["info", transport, "--json"])?;
    let mut rows = String::new();
    for kind in ["exr", "png"] {
        let picture = desk.file(&format!("{name}.{kind}"));
        let mut secs = Vec::new();
        for _ in 0..TRIES {
            let begun = Instant::now();
            relight(program, [transport, &picture])?;
            secs.push(begun.elapsed().as_secs_f64());
        }
        secs.sort_by(f64::total_cmp);
        let [least, median, most] = [0, TRIES / 2, TRIES - 1].map(|nth| secs[nth]);
        let bytes = std::fs::metadata(&picture).with_context(|| format!("cannot read {picture}"))?.len();
        rows += &format!(
            "| {name} | {:.2} MB | {:.0} | {} | {median:.2} s | {least:.2} to {most:.2} s | {:.1} MB |\n",
            number(&told, "/file_bytes") / 1e6,
            number(&told, "/columns"),
            kind.to_uppercase(),
            bytes as f64 / 1e6,
        );
    }
    Ok(rows)
}

fn relight(program: &Path, [transport, picture]: [&str; 2]) -> Result<()> {
    let done = Command::new(program).args(["relight", transport, "-o", picture, "--device", "cpu", "--json"]).output();
    let done = done.with_context(|| format!("cannot start {}", program.display()))?;
    ensure!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    Ok(())
}
