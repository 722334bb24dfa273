//! Other renderers beside ours on the same files, where a Python that has them is at hand.

use std::path::PathBuf;
use std::process::Command;
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};
use clerestory::compare::read_exr;
use clerestory_relight::Radiance;
use clerestory_transport::bake::BakeConfig;
use clerestory_transport::camera::Film;
use clerestory_transport::import;
use clerestory_transport::light::LightRig;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::trace::TraceConfig;
use serde_json::Value;

use super::desk::{Desk, number};
use super::errors::psnr_db;
use super::fit::{spread_words, tenths};
use super::matrix::{BOUNCES, NO_TOLERANCE_DB, baked, process_cpu_secs};
use super::rendered::{as_in_file, rendered};

/// Of the section.
pub const NAME: &str = "peers";
/// Environment variable with the Python that has the renderers.
const PYTHON_VARIABLE: &str = "CLERESTORY_PYTHON";
/// What they are called there, see `scripts/peers.py`.
const MODULES: [&str; 2] = ["bpy", "mitsuba"];
/// Files whose surfaces are all diffuse, so that everybody means the same.
const SCENES: [&str; 3] = ["cornell-diffuse", "bench-conf64", "bench-sponza20"];
/// Each picture is made with as many seeds.
const SEEDS: std::ops::RangeInclusive<u64> = 1..=3;

/// Why others cannot be asked here: without their rows the section stays as it is.
pub fn missing(desk: &Desk) -> Option<String> {
    lacking(&python(), SCENES.iter().any(|name| file(desk, name).is_some()))
}

fn lacking(python: &str, has_files: bool) -> Option<String> {
    if !has_files {
        return Some("its files lie in the folder that CLERESTORY_SHARED names, and are not there".into());
    }
    let has = |module: &&str| {
        let told = Command::new(python).args(["-c", &format!("import {module}")]).output();
        told.is_ok_and(|told| told.status.success())
    };
    let has_any = MODULES.iter().any(has);
    (!has_any)
        .then(|| format!("`{python}` has none of {MODULES:?}: install one, and name its Python in {PYTHON_VARIABLE}"))
}

fn python() -> String {
    std::env::var(PYTHON_VARIABLE).unwrap_or_else(|_| "python3".into())
}

fn file(desk: &Desk, name: &str) -> Option<PathBuf> {
    desk.shared(&format!("references/{name}.glb"))
}

/// Rows of all renderers that are installed, and of ours.
///
/// # Errors
/// If there is no renderer or no file, a scene cannot be rendered, or a renderer that is installed fails.
pub fn write(desk: &Desk) -> Result<String> {
    if let Some(why) = missing(desk) {
        bail!(why);
    }
    let film = desk.choose(Film { width: 64, height: 48 }, Film { width: 192, height: 144 });
    let (samples, converged): (&[u32], u32) = desk.choose((&[4], 32), (&[16, 64], 512));
    let (mut rows, mut found) = (String::new(), Vec::new());
    for name in &SCENES[..desk.choose(1, SCENES.len())] {
        let Some(path) = file(desk, name) else { continue };
        let (of_scene, renderers): (String, Vec<String>) = desk.part(NAME, name, || {
            let scene = import::load(&path).with_context(|| format!("cannot load {}", path.display()))?.scene;
            let scene = Arc::new(PreparedScene::new(scene, &[])?.0);
            desk.say(&format!("two pictures of {name} that all are held against"));
            let reference = [1, 2].map(|beyond| traced(&scene, film, converged, SEEDS.end() + beyond));
            let [a, b] = reference;
            let reference = [a?, b?];
            let (mut rows, mut renderers) = (String::new(), Vec::new());
            for &samples in samples {
                desk.say(&format!("{name} with {samples} samples per pixel by everybody"));
                // Who rendered, in the order of the first turn, and each time the seconds and dB.
                let mut tried: Vec<(String, Vec<f64>, Vec<f64>)> = Vec::new();
                let mut add = |who: &str, secs: f64, picture: &Radiance| {
                    let db = psnr_db(picture, reference.each_ref());
                    match tried.iter_mut().find(|(known, ..)| known == who) {
                        Some((_, all_secs, all_db)) => {
                            all_secs.push(secs);
                            all_db.push(db);
                        }
                        None => tried.push((who.into(), vec![secs], vec![db])),
                    }
                };
                for seed in SEEDS {
                    for told in others(desk, &path.display().to_string(), film, (samples, seed))? {
                        let who = format!("{} {}", words(&told, "renderer"), words(&told, "version"));
                        add(&who, number(&told, "/cpu_secs"), &read_exr(words(&told, "picture").as_ref())?);
                        renderers.push(who);
                    }
                    let begun = process_cpu_secs()?;
                    let plain = traced(&scene, film, samples, seed)?;
                    add("ours, one look", process_cpu_secs()? - begun, &plain);
                    for (denoise, how) in [(false, ""), (true, ", denoised")] {
                        let config = BakeConfig {
                            spp: samples,
                            tolerance_db: NO_TOLERANCE_DB,
                            bounces: BOUNCES,
                            seed,
                            denoise,
                            ..BakeConfig::default()
                        };
                        let (secs, bake) = baked(&scene, film, config)?;
                        let begun = process_cpu_secs()?;
                        let pixels = as_in_file(&bake).as_chunks::<3>().0.to_vec();
                        let secs = secs + process_cpu_secs()? - begun;
                        let relit = Radiance { width: film.width, height: film.height, pixels };
                        let columns = scene.lighting.basis.n_cols();
                        add(&format!("ours, all columns ({columns}), relit{how}"), secs, &relit);
                    }
                }
                for (who, secs, db) in tried {
                    rows += &format!("| {name} | {who} | {samples} | {} | {} |\n", spread_words(secs), tenths(db));
                }
            }
            Ok((rows, renderers))
        })?;
        rows += &of_scene;
        found.extend(renderers);
    }
    ensure!(!found.is_empty(), "no other renderer made a picture");
    Ok(format!(
        "## Other renderers\n\n\
         The same file in `scripts/peers.py`: one picture of {} × {} pixels under all lights, {:?} bounces, CPU seconds of rendering without loading the file (those of Cycles count its hierarchy, which the call that renders builds, and those of both others that they write the picture; ours count neither, but of bakes that they are relit), and PSNR: the mean of (x − a)(x − b), a and b two pictures that\n\
         ours traced with {converged} samples per pixel each, so that their noise does not count, all exposed to four times the median luminance of their mean and clipped at white; told as no less than its standard error over the pixels. Mitsuba is vectorized where it finds LLVM and scalar where not, as the name says, its kernels compiled before; its samples are multijittered, and roulette may end its paths from depth 3 on. What others make otherwise than ours counts as their error, since ours traced what all are held against. Nobody denoises but ours where it says so. Median (least…greatest) of {} seeds, everybody in turn. {}\n\n\
         | scene | renderer | samples per pixel | CPU s | PSNR, dB |\n|---|---|---|---|---|\n{rows}",
        film.width,
        film.height,
        BOUNCES.unwrap_or(0),
        SEEDS.count(),
        desk.load_words(),
    ))
}

/// What the script prints.
fn others(desk: &Desk, scene: &str, film: Film, (samples, seed): (u32, u64)) -> Result<Vec<Value>> {
    let mut script = Command::new(python());
    script.arg(desk.root.join("scripts/peers.py")).arg(scene);
    script.args(["--size", &format!("{}x{}", film.width, film.height), "--samples", &samples.to_string()]);
    script.args(["--bounces", &BOUNCES.unwrap_or(0).to_string(), "--out", &desk.file(""), "--seed", &seed.to_string()]);
    let told = script.output().with_context(|| format!("cannot start `{}`", python()))?;
    if !told.status.success() {
        bail!("scripts/peers.py failed: {}", String::from_utf8_lossy(&told.stderr));
    }
    serde_json::from_slice(&told.stdout).context("scripts/peers.py printed no JSON")
}

fn words(told: &Value, name: &str) -> String {
    told[name].as_str().unwrap_or("unknown").into()
}

fn traced(scene: &PreparedScene, film: Film, spp: u32, seed: u64) -> Result<Radiance> {
    let light = scene.lighting.basis.project(&LightRig::default());
    rendered(scene, film, &light, &TraceConfig { spp, bounces: BOUNCES, seed })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_a_renderer_or_a_file_for_it_the_section_says_what_is_missing() {
        let of_python = lacking("no-such-python", true).unwrap();
        assert!(of_python.contains("no-such-python") && of_python.contains(PYTHON_VARIABLE), "{of_python}");
        assert!(lacking("no-such-python", false).unwrap().contains("CLERESTORY_SHARED"));
    }
}
