//! The samples of a bake taken in other ways.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result};
use clerestory_transport::bake::{BakeConfig, Indirect};
use clerestory_transport::camera::Film;
use clerestory_transport::import;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::skips::{Skip, Skips};
use serde::{Deserialize, Serialize};

use crate::desk::Desk;
use crate::fit::{hundredths, spread_words, tenths_known};
use crate::matrix::{NO_TOLERANCE_DB, baked};
use crate::reference::{Reference, Sampling};

const SCENES: [&str; 3] = ["gallery", "mixed", "reflections"];
/// Seeds, of all ways in turn; in a hurry one.
const TURNS: u64 = 3;

/// What is done otherwise: how it is baked, the skips, and what becomes of the scene.
type Way = (&'static str, fn(BakeConfig) -> BakeConfig, Skips, fn(PreparedScene) -> PreparedScene);

/// Bakes whose samples are taken in one way, seed by seed.
#[derive(Default, Serialize, Deserialize)]
struct Taken {
    secs: Vec<f64>,
    dbs: Vec<Option<f64>>,
    /// By what sharing light is off as the bake tells it, in dB; where it is shared.
    biases: Vec<Option<f64>>,
    /// Light of all columns together over that of the reference, lamps that are seen left out.
    lights: Vec<f64>,
}

fn ways() -> [Way; 10] {
    let all = Skips::default();
    let same: fn(PreparedScene) -> PreparedScene = |scene| scene;
    let as_it_is: fn(BakeConfig) -> BakeConfig = |config| config;
    let undenoised: fn(BakeConfig) -> BakeConfig = |config| BakeConfig { denoise: false, ..config };
    let shared: fn(BakeConfig) -> BakeConfig = |config| BakeConfig { indirect: Indirect::Shared, ..config };
    [
        ("as a bake does it", as_it_is, all, same),
        ("noise of pixels left as it is", undenoised, all, same),
        ("no walks sent toward mirrors and glass", as_it_is, all, PreparedScene::without_guides),
        ("no walks shared from and to coated surfaces", as_it_is, all, PreparedScene::with_lone_coats),
        ("weak later connections all made", as_it_is, all.without(Skip::WeakLight), same),
        ("samples of a pixel independent of each other", as_it_is, all, PreparedScene::with_lone_samples),
        ("one light a vertex, not all at the first", as_it_is, all, PreparedScene::with_lone_connections),
        ("lobes that a material has not are asked too", as_it_is, all.without(Skip::Lobes), same),
        ("indirect light shared between pixels, with its clamp", shared, all, same),
        ("the same without its clamp", shared, all, PreparedScene::without_clamp),
    ]
}

/// A table: time, error and bias of bakes whose samples are all taken.
///
/// # Errors
/// If a scene cannot be baked, or this system does not tell the CPU time of a process.
pub(super) fn write(desk: &Desk) -> Result<String> {
    let (film, spp) = desk.choose((Film { width: 48, height: 36 }, 4), (Film { width: 192, height: 144 }, 16));
    let sampling = Sampling { film, step: desk.choose(1, 2), bounces: None, spp: desk.choose(16, 128) };
    let turns = desk.choose(1, TURNS);
    let mut rows = String::new();
    for name in &SCENES[..desk.choose(1, SCENES.len())] {
        let path = desk.root.join(format!("assets/scenes/{name}.glb"));
        let taken: Vec<Taken> = desk.part("ablations", &format!("samples-{name}"), || {
            measured(desk, (*name, path.as_path()), (sampling, spp), turns)
        })?;
        rows.extend(ways().iter().zip(&taken).map(|((what, ..), taken)| row(name, what, taken)));
    }
    Ok(format!(
        "\n### Samples\n\n\
         Bakes of {} × {} pixels whose blocks take all of {spp} samples per pixel: CPU seconds and the error of single lights (median)\n\
         in dB as in the section Error against time; by what sharing light is off as the bake tells it (`error_db.bias`), and the light of all columns\n\
         together over that of the reference, pixels that show it left out as of the error, which is less than 1 where light is cut off; all median (least…greatest) of {turns} seeds in turn. Shared light has a clamp of\n\
         fireflies, four times the median of the nodes around: `--fast` alone has it, and beside it stands what it takes. Samples that are independent of each\n\
         other take the place of an Owen-scrambled sequence (walks that go on from one first vertex are stratified together in both). With one light a vertex the\n\
         first vertex asks for one of all lights and later ones for one of each group; second vertices that pixels share ask for all in both.\n\n\
         | scene | what | CPU s | dB | bias of sharing, dB | light |\n|---|---|---|---|---|---|\n{rows}",
        film.width, film.height,
    ))
}

/// All ways of a scene, in their order.
fn measured(
    desk: &Desk,
    (name, path): (&str, &Path),
    (sampling, spp): (Sampling, u32),
    turns: u64,
) -> Result<Vec<Taken>> {
    let load = |skips: Skips, prepare: fn(PreparedScene) -> PreparedScene| -> Result<Arc<PreparedScene>> {
        let scene = import::load_with(path, skips).with_context(|| format!("cannot load {}", path.display()))?;
        Ok(Arc::new(prepare(PreparedScene::with_skips(scene.scene, &[], None, skips)?.0)))
    };
    let reference = Reference::new(desk, &[path], &*load(Skips::default(), |scene| scene)?, sampling)?;
    let all_light = reference.light(&reference.mean());
    let mut measured: Vec<Taken> = ways().iter().map(|_| Taken::default()).collect();
    for seed in 1..=turns {
        for ((what, configured, skips, prepare), taken) in ways().iter().zip(&mut measured) {
            desk.say(&format!("{name}: {what}, seed {seed}"));
            let tolerance_db = NO_TOLERANCE_DB;
            let config = configured(BakeConfig { spp, tolerance_db, seed, ..BakeConfig::default() });
            let (cpu_secs, bake) = baked(&load(*skips, *prepare)?, sampling.film, config)?;
            let rows = reference.rows_of(&bake.header, &bake.groups);
            taken.secs.push(cpu_secs);
            taken.dbs.push(reference.errors(&rows).median_db());
            taken.biases.push(bake.figures().error_db.bias.map(f64::from));
            taken.lights.push(reference.light(&rows) / all_light);
        }
    }
    Ok(measured)
}

fn row(name: &str, what: &str, taken: &Taken) -> String {
    format!(
        "| {name} | {what} | {} | {} | {} | {} |\n",
        spread_words(taken.secs.clone()),
        tenths_known(&taken.dbs),
        tenths_known(&taken.biases),
        hundredths(taken.lights.clone()),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_tells_the_bias_where_light_is_shared() {
        let taken = |bias: Option<f64>| Taken {
            secs: vec![2.0, 4.0, 3.0],
            dbs: vec![Some(30.0); 3],
            biases: vec![bias; 3],
            lights: vec![0.98, 0.99, 1.0],
        };
        let told = "| a hall | traced | 3.0 (2.0…4.0) | 30.0 (30.0…30.0) | — | 0.99 (0.98…1.00) |\n";
        assert_eq!(row("a hall", "traced", &taken(None)), told);
        let shared = row("a hall", "shared", &taken(Some(41.26)));
        assert!(shared.contains("| 30.0 (30.0…30.0) | 41.3 (41.3…41.3) |"), "{shared}");
    }
}
