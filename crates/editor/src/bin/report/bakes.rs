//! Bakes: how long until there is a picture, how small and how exact the result is.

mod ways;

use std::path::Path;

use anyhow::{Context, Result};
use clerestory::compare::read_exr;
use clerestory_relight::Radiance;
use clerestory_transport::camera::Film;
use clerestory_transport::import;
use clerestory_transport::light::LightRig;
use clerestory_transport::prepared::PreparedScene;
use serde_json::Value;

use super::cases::{Case, cases};
use super::desk::{Desk, clerestory, number};
use super::errors::{Told, pixels_beside_two, told_words};
use super::fit::tenths;
use super::reference::near_seen_light;

/// Tolerance in dB.
const TOLERANCE: &str = "40";
/// Seeds of the bakes: the first of all, the others of those that took no more than so many seconds with the first.
const SEEDS: [&str; 3] = ["0", "1", "2"];
const PATIENCE_SECS: f64 = 20.0;

/// Bakes scenes, relights them and holds them against path tracing.
///
/// # Errors
/// If a scene cannot be baked.
pub fn write(desk: &Desk) -> Result<String> {
    let mut rows = String::new();
    // Samples per pixel of each of both path-traced pictures that bakes are held against.
    let reference_spp = desk.choose("16", "128");
    for case in cases(desk) {
        rows += &desk.part("bakes", &case.name, || {
            desk.say(&format!("baking {}", case.name));
            measure(desk, &case, reference_spp)
        })?;
    }
    let ways = ways::write(desk)?;
    Ok(format!(
        "## Bakes\n\n\
         Asked for {TOLERANCE} dB, with as many samples per pixel at most as the table tells. Times in seconds by the clock: to the first look (a whole\n\
         picture with all columns, told by fewer pixels; of small pictures the preview) from the start of the command, so that loading the scene and building its hierarchy are counted; of the bake from when that is done, so that they are not, until the file is written. Errors in dB, as the bake tells them: truncation / sampling / total; a total below what was asked for says that the samples ran out first. What is told is the mean over all entries, each below its column's peak, so that a few lights that are worse than the others weigh in it as all others do; in a picture they have their part of the light. The\n\
         last column holds the relit picture (all lights as in the file) against two path-traced ones of {reference_spp} samples each, as in the section Error against\n\
         time: their noise does not count, pixels that show a light, or lie beside one that does, are left out, and where the standard error is greater than the error, it is what is told, after \"≥\". Each row is one bake, of seed {}; of one that took no more than {PATIENCE_SECS} s, first look, bake, total error and last column are the median (least…greatest) of the seeds {}; traced pictures have seeds 7 and 8. {}\n\n\
         | scene | size | samples | columns | first look | bake | rank mean / max | MB in the file / in memory | dense / file | error dB | dB beside two traces |\n\
         |---|---|---|---|---|---|---|---|---|---|---|\n{rows}{ways}",
        SEEDS[0],
        SEEDS[..n_seeds(desk)].join(", "),
        desk.load_words(),
    ))
}

fn n_seeds(desk: &Desk) -> usize {
    desk.choose(1, SEEDS.len())
}

/// A bake: what `bake` and `info` tell of it, and its picture under the light of the file.
struct Baked {
    baked: Value,
    told: Value,
    relit: Radiance,
}

fn baked(desk: &Desk, case: &Case, seed: &str) -> Result<Baked> {
    let (transport, relit) = (desk.file(&format!("{}-{seed}.transport", case.name)), desk.file("relight.exr"));
    let [baked, told] = case.bake(&transport, TOLERANCE, seed)?;
    clerestory(&["relight", &transport, "-o", &relit, "--device", "cpu", "--json"])?;
    Ok(Baked { baked, told, relit: read_exr(relit.as_ref())? })
}

/// Bakes, relights, traces and compares one scene; returns a row of the table.
fn measure(desk: &Desk, case: &Case, reference_spp: &str) -> Result<String> {
    let mut bakes = vec![baked(desk, case, SEEDS[0])?];
    if number(&bakes[0].baked, "/bake_secs") <= PATIENCE_SECS {
        for seed in &SEEDS[1..n_seeds(desk)] {
            bakes.push(baked(desk, case, seed)?);
        }
    }
    let scene = case.scene();
    let traced = |seed: &str| {
        let traced = desk.file(&format!("trace-{seed}.exr"));
        let how = ["--spp", reference_spp, "--seed", seed, "--size", case.size, "--json"];
        clerestory(&[&["trace", &scene, "-o", &traced][..], &how].concat())?;
        read_exr(traced.as_ref())
    };
    let (a, b) = (traced("7")?, traced("8")?);
    let is_left_out = left_out(scene.as_ref(), &bakes[0].relit)?;
    let beside: Vec<Told> =
        bakes.iter().filter_map(|bake| pixels_beside_two(&bake.relit, [&a, &b], &is_left_out)).collect();
    let secs = |at: &str| tenths(bakes.iter().map(|bake| number(&bake.baked, at)).collect());
    let told = &bakes[0].told;
    Ok(format!(
        "| {} | {} | {} | {:.0} | {} | {} | {:.2} / {:.0} | {:.2} / {:.1} | {:.0}× | {:.1} / {:.1} / {} | {} |\n",
        case.name,
        case.size.replace('x', "×"),
        case.spp,
        number(told, "/columns"),
        secs("/preview_secs"),
        secs("/bake_secs"),
        number(told, "/mean_rank"),
        number(told, "/max_rank"),
        number(told, "/file_bytes") / 1e6,
        number(told, "/bytes") / 1e6,
        number(told, "/ratio"),
        number(told, "/error_db/truncation"),
        number(told, "/error_db/sampling"),
        tenths(bakes.iter().map(|bake| number(&bake.told, "/error_db/total")).collect()),
        told_words(&beside),
    ))
}

/// Pixels of a picture of a scene under the light of its file that are compared with nothing.
fn left_out(scene: &Path, picture: &Radiance) -> Result<Vec<bool>> {
    let imported = import::load(scene).with_context(|| format!("cannot load the scene {}", scene.display()))?;
    let scene = PreparedScene::new(imported.scene, &[])?.0;
    let film = Film { width: picture.width, height: picture.height };
    Ok(near_seen_light(&scene, film, &scene.lighting.basis.project(&LightRig::default())))
}
