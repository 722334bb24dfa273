//! Colors of a chessboard that judge each other, in bakes with shared light that end where they are exact enough.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result};
use clerestory_transport::bake::{BakeConfig, Indirect};
use clerestory_transport::camera::Film;
use clerestory_transport::import;
use clerestory_transport::prepared::PreparedScene;
use serde::{Deserialize, Serialize};

use crate::desk::Desk;
use crate::fit::{hundredths, spread_words, tenths, tenths_known};
use crate::matrix::baked;
use crate::reference::{Reference, Sampling};

/// What is asked for, in dB.
const TOLERANCE_DB: f32 = 30.0;
/// Of `assets/scenes`, and of others where they are at hand: most of their surfaces are matte.
const OWN: &str = "diffuse";
const OTHERS: [&str; 2] = ["bench-conf64", "bench-sponza20"];
const SEEDS: u64 = 3;

/// Bakes of a scene that are judged in one way.
#[derive(Default, Serialize, Deserialize)]
struct Judged {
    secs: Vec<f64>,
    /// Mean samples per pixel.
    samples: Vec<f64>,
    dbs: Vec<Option<f64>>,
}

/// What judges, and what becomes of the scene for it.
type Way = (&'static str, fn(PreparedScene) -> PreparedScene);

/// A table: time, samples and error with the colors and without.
///
/// # Errors
/// If a scene cannot be baked, or this system does not tell the CPU time of a process.
pub(super) fn write(desk: &Desk) -> Result<String> {
    let (film, spp) = desk.choose((Film { width: 48, height: 36 }, 4), (Film { width: 192, height: 144 }, 64));
    let sampling = Sampling { film, step: desk.choose(4, 2), bounces: None, spp: desk.choose(4, 128) };
    let seeds = desk.choose(1, SEEDS);
    let ways: [Way; 2] = [
        ("colors judge each other, as in bakes", |scene| scene),
        ("halves of all pixels judge each other", PreparedScene::without_colors),
    ];
    let own = Some((OWN, desk.root.join(format!("assets/scenes/{OWN}.glb"))));
    let others = OTHERS.iter().filter_map(|name| Some((*name, desk.shared(&format!("references/{name}.glb"))?)));
    let mut rows = String::new();
    for (name, path) in own.into_iter().chain(others.filter(|_| !desk.quick)) {
        let measured: Vec<Judged> = desk
            .part("ablations", &format!("judging-{name}"), || measured(desk, &path, (sampling, spp), (&ways, seeds)))?;
        for ((what, _), judged) in ways.iter().zip(&measured) {
            rows += &row(name, what, judged, &measured[0]);
        }
    }
    Ok(format!(
        "\n### What ends the samples\n\n\
         Bakes of {} × {} pixels, asked for {TOLERANCE_DB} dB with at most {spp} samples per pixel, indirect light shared between pixels: blocks of matte surfaces\n\
         are looked at after one sample of each half, where the colors of a chessboard judge each other ([decision 0035](decisions/0035-colors-of-a-chessboard-judge-each-other.md)), or\n\
         after two, where each half of all pixels judges the other. CPU seconds, their ratio of each seed, mean samples per pixel, and the error of single\n\
         lights (median) in dB as in the section Error against time; median (least…greatest) of {seeds} seeds in turn.\n\n\
         | scene | what | CPU s | times as long | samples | dB |\n|---|---|---|---|---|---|\n{rows}",
        film.width, film.height,
    ))
}

fn measured(
    desk: &Desk,
    path: &Path,
    (sampling, spp): (Sampling, u32),
    (ways, seeds): (&[Way], u64),
) -> Result<Vec<Judged>> {
    let scene = import::load(path).with_context(|| format!("cannot load {}", path.display()))?.scene;
    let scene = PreparedScene::new(scene, &[])?.0;
    let reference = Reference::new(desk, &[path], &scene, sampling)?;
    let scenes: Vec<Arc<PreparedScene>> = ways.iter().map(|(_, prepare)| Arc::new(prepare(scene.clone()))).collect();
    let mut measured: Vec<Judged> = ways.iter().map(|_| Judged::default()).collect();
    for seed in 1..=seeds {
        for (((what, _), scene), judged) in ways.iter().zip(&scenes).zip(&mut measured) {
            desk.say(&format!("{}: {what}, seed {seed}", path.display()));
            let (tolerance_db, indirect) = (TOLERANCE_DB, Indirect::Shared);
            let config = BakeConfig { spp, tolerance_db, seed, indirect, ..BakeConfig::default() };
            let (secs, bake) = baked(scene, sampling.film, config)?;
            judged.secs.push(secs);
            judged.samples.push(f64::from(spp) * (1.0 - f64::from(bake.figures().skipped.samples_saved)));
            judged.dbs.push(reference.errors(&reference.rows_of(&bake.header, &bake.groups)).median_db());
        }
    }
    Ok(measured)
}

fn row(name: &str, what: &str, judged: &Judged, usual: &Judged) -> String {
    let ratios = judged.secs.iter().zip(&usual.secs).map(|(secs, usual)| secs / usual);
    format!(
        "| {name} | {what} | {} | {}× | {} | {} |\n",
        spread_words(judged.secs.clone()),
        hundredths(ratios.collect()),
        tenths(judged.samples.clone()),
        tenths_known(&judged.dbs),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_tells_how_many_times_as_long_each_seed_took() {
        let judged = |secs: [f64; 3], samples: f64, db: f64| Judged {
            secs: secs.to_vec(),
            samples: vec![samples; 3],
            dbs: vec![Some(db); 3],
        };
        let usual = judged([2.0, 3.0, 4.0], 2.5, 30.0);
        let told = "| a hall | halves | 3.6 (3.0…4.0) | 1.20 (1.00…1.50)× | 4.0 (4.0…4.0) | 31.0 (31.0…31.0) |\n";
        assert_eq!(row("a hall", "halves", &judged([3.0, 3.6, 4.0], 4.0, 31.0), &usual), told);
    }
}
