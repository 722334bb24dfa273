//! All columns against one plain picture at equal samples.

use std::sync::Arc;

use anyhow::{Context, Result};
use clerestory_transport::bake::BakeConfig;
use clerestory_transport::camera::Film;
use clerestory_transport::import;
use clerestory_transport::light::LightRig;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::trace::TraceConfig;

use super::{SCENES, SEED};
use crate::desk::Desk;
use crate::fit::{digits, spread_words};
use crate::matrix::{baked, process_cpu_secs};
use crate::rendered::rendered;

const TURNS: u64 = 3;

/// A table over the scenes.
///
/// # Errors
/// If a scene cannot be baked, or this system does not tell the CPU time of a process.
pub(super) fn write(desk: &Desk) -> Result<String> {
    let film = desk.choose(Film { width: 64, height: 48 }, Film { width: 256, height: 192 });
    let spp = desk.choose(4, 16);
    let own = SCENES[..desk.choose(1, 4)]
        .iter()
        .map(|name| (*name, Some(desk.root.join(format!("assets/scenes/{name}.glb")))));
    let real = [("conference", desk.shared("scenes/conference.glb"))];
    let mut rows = String::new();
    for (name, path) in own.chain(real) {
        let Some(path) = path else { continue };
        let (n_cols, secs): (usize, Vec<[f64; 2]>) = desk.part("paper", &format!("plain-{name}"), || {
            let imported = import::load(&path).with_context(|| format!("cannot load {}", path.display()))?;
            let scene = Arc::new(PreparedScene::new(imported.scene, &[])?.0);
            desk.say(&format!("{name}: all columns, and one picture"));
            Ok((
                scene.lighting.basis.n_cols(),
                (0..TURNS).map(|turn| both(&scene, film, spp, SEED + turn)).collect::<Result<_>>()?,
            ))
        })?;
        let [bake, picture] = [0, 1].map(|which| secs.iter().map(|secs| secs[which]).collect::<Vec<f64>>());
        let ratio = crate::fit::spread(&bake)[1] / crate::fit::spread(&picture)[1];
        rows += &format!(
            "| {name} | {n_cols} | {} | {} | {}× |\n",
            spread_words(bake),
            spread_words(picture),
            digits(ratio)
        );
    }
    Ok(format!(
        "\n### All columns against one picture\n\n\
         CPU seconds of a bake of all columns, its indirect light traced, compression and denoising included, and of one path-traced picture under the light of the file,\n\
         both with {spp} samples per pixel of {} × {}; median (least…greatest) of {TURNS} seeds, in turn.\n\n\
         | scene | columns | bake, CPU s | picture, CPU s | ratio |\n|---|---|---|---|---|\n{rows}",
        film.width, film.height,
    ))
}

/// CPU seconds of a bake and of a picture.
fn both(scene: &Arc<PreparedScene>, film: Film, spp: u32, seed: u64) -> Result<[f64; 2]> {
    // A tolerance out of reach: every block takes all its samples.
    let config = BakeConfig { spp, tolerance_db: 80.0, seed, ..BakeConfig::default() };
    let bake = baked(scene, film, config)?.0;
    let light = scene.lighting.basis.project(&LightRig::default());
    let config = TraceConfig { spp, bounces: None, seed };
    let begun = process_cpu_secs()?;
    rendered(scene, film, &light, &config)?;
    Ok([bake, process_cpu_secs()? - begun])
}
