//! The samples of a bake taken in other ways.

use std::sync::Arc;

use anyhow::{Context, Result};
use clerestory_transport::bake::{BakeConfig, Indirect};
use clerestory_transport::camera::Film;
use clerestory_transport::import;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::skips::{Skip, Skips};

use crate::desk::Desk;
use crate::fit::{spread_words, tenths_known};
use crate::matrix::{NO_TOLERANCE_DB, baked};
use crate::reference::{Reference, Sampling};

const SCENES: [&str; 3] = ["gallery", "mixed", "reflections"];
/// Seeds, of all ways in turn; in a hurry one.
const TURNS: u64 = 3;

/// What is done otherwise: how it is baked, the skips, and what becomes of the scene.
type Way = (&'static str, fn(BakeConfig) -> BakeConfig, Skips, fn(PreparedScene) -> PreparedScene);

/// A table: time and error of bakes whose samples are all taken.
///
/// # Errors
/// If a scene cannot be baked, or this system does not tell the CPU time of a process.
pub(super) fn write(desk: &Desk) -> Result<String> {
    let (film, spp) = desk.choose((Film { width: 48, height: 36 }, 4), (Film { width: 192, height: 144 }, 16));
    let sampling = Sampling { film, step: desk.choose(1, 2), bounces: None, spp: desk.choose(16, 128) };
    let (all, turns) = (Skips::default(), desk.choose(1, TURNS));
    let same: fn(PreparedScene) -> PreparedScene = |scene| scene;
    let as_it_is: fn(BakeConfig) -> BakeConfig = |config| config;
    let undenoised: fn(BakeConfig) -> BakeConfig = |config| BakeConfig { denoise: false, ..config };
    let shared: fn(BakeConfig) -> BakeConfig = |config| BakeConfig { indirect: Indirect::Shared, ..config };
    let ways: [Way; 7] = [
        ("as a bake does it", as_it_is, all, same),
        ("noise of pixels left as it is", undenoised, all, same),
        ("no walks sent toward mirrors and glass", as_it_is, all, PreparedScene::without_guides),
        ("no walks shared from and to coated surfaces", as_it_is, all, PreparedScene::with_lone_coats),
        ("weak later connections all made", as_it_is, all.without(Skip::WeakLight), same),
        ("lobes that a material has not are asked too", as_it_is, all.without(Skip::Lobes), same),
        ("indirect light shared between pixels", shared, all, same),
    ];
    let mut rows = String::new();
    for name in &SCENES[..desk.choose(1, SCENES.len())] {
        let measured: Vec<(Vec<f64>, Vec<Option<f64>>)> = desk.part("ablations", &format!("samples-{name}"), || {
            let path = desk.root.join(format!("assets/scenes/{name}.glb"));
            let load = |skips: Skips, prepare: fn(PreparedScene) -> PreparedScene| -> Result<Arc<PreparedScene>> {
                let scene =
                    import::load_with(&path, skips).with_context(|| format!("cannot load {}", path.display()))?;
                Ok(Arc::new(prepare(PreparedScene::with_skips(scene.scene, &[], None, skips)?.0)))
            };
            let reference = Reference::new(desk, &[path.as_path()], &*load(all, same)?, sampling)?;
            let mut measured = vec![(Vec::new(), Vec::new()); ways.len()];
            for seed in 1..=turns {
                for ((what, configured, skips, prepare), (secs, dbs)) in ways.iter().zip(&mut measured) {
                    desk.say(&format!("{name}: {what}, seed {seed}"));
                    let tolerance_db = NO_TOLERANCE_DB;
                    let config = configured(BakeConfig { spp, tolerance_db, seed, ..BakeConfig::default() });
                    let (cpu_secs, bake) = baked(&load(*skips, *prepare)?, film, config)?;
                    secs.push(cpu_secs);
                    dbs.push(reference.errors(&reference.rows_of(&bake.header, &bake.groups)).median_db());
                }
            }
            Ok(measured)
        })?;
        for ((what, ..), (secs, dbs)) in ways.iter().zip(measured) {
            rows += &format!("| {name} | {what} | {} | {} |\n", spread_words(secs), tenths_known(&dbs));
        }
    }
    Ok(format!(
        "\n### Samples\n\n\
         Bakes of {} × {} pixels whose blocks take all of {spp} samples per pixel: CPU seconds and the error of single lights (median)\n\
         in dB as in the section Error against time, both median (least…greatest) of {turns} seeds in turn.\n\n| scene | what | CPU s | dB |\n|---|---|---|---|\n{rows}",
        film.width, film.height,
    ))
}
