//! Indirect light shared between pixels beside traced light, in every scene that is at hand.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result};
use clerestory_transport::bake::{BakeConfig, Indirect};
use clerestory_transport::camera::Film;
use clerestory_transport::import;
use clerestory_transport::light::LightRig;
use clerestory_transport::prepared::PreparedScene;

use crate::desk::Desk;
use crate::errors::{Told, told_words};
use crate::fit::spread_words;
use crate::matrix::baked;
use crate::reference::{Reference, Sampling};

/// Samples per pixel of the bakes, out of reach of their tolerance.
const SPP: u32 = 16;
const NO_TOLERANCE_DB: f32 = 80.0;
/// The first for all; the others tell of shared light, which is the cheaper in most scenes, how far bakes lie apart.
const SEEDS: [u64; 3] = [1, 2, 3];

/// A table of the scenes of `assets/scenes` and of the shared data.
///
/// # Errors
/// If a scene cannot be read or baked, or this system does not tell the CPU time of a process.
pub fn write(desk: &Desk) -> Result<String> {
    let (film, step) = desk.choose((Film { width: 32, height: 24 }, 1), (Film { width: 256, height: 192 }, 4));
    let sampling = Sampling { film, step, bounces: None, spp: desk.choose(8, 64) };
    let mut rows = String::new();
    for path in scenes(desk)? {
        let name = path.file_stem().map_or("scene".into(), |stem| stem.to_string_lossy().into_owned());
        rows += &desk.part("bakes", &format!("{name}, both ways"), || row(desk, &name, &path, sampling))?;
    }
    Ok(format!(
        "\n### Shared beside traced\n\n\
         Every scene, {} × {} pixels, {SPP} samples per pixel, indirect light shared between pixels and denoised, or traced as `--no-denoise` does; a scene without light under the even sky that it is given, one column.\n\
         CPU seconds (user and system) of the bake alone. Errors in dB as in the section Matrix, beside two references of {} samples per pixel each: of single lights, median over columns and the worst of them;\n\
         of all lights of the file. Where the standard error is greater than the error, it is what is told, after \"≥\": of the median where that holds of the column in the middle.\n\
         With shared light, median (least…greatest) of the seeds {}; traced, one bake of seed {}.\n\n\
         | scene | columns | shared, CPU s | median | worst | all lights | traced, CPU s | median | worst | all lights |\n\
         |---|---|---|---|---|---|---|---|---|---|\n{rows}",
        film.width,
        film.height,
        sampling.spp,
        SEEDS[..n_seeds(desk)].iter().map(u64::to_string).collect::<Vec<_>>().join(", "),
        SEEDS[0],
    ))
}

fn n_seeds(desk: &Desk) -> usize {
    desk.choose(1, SEEDS.len())
}

/// Files of the scenes, by name; in a hurry one of them.
fn scenes(desk: &Desk) -> Result<Vec<PathBuf>> {
    let folders = [Some(desk.root.join("assets/scenes")), desk.shared("scenes")];
    let mut files = Vec::new();
    for folder in folders.into_iter().flatten() {
        let listed = std::fs::read_dir(&folder).with_context(|| format!("cannot list {}", folder.display()))?;
        let mut found: Vec<PathBuf> = listed.map(|entry| Ok(entry?.path())).collect::<Result<_>>()?;
        found.retain(|path| path.extension().is_some_and(|ending| ending == "glb"));
        found.sort();
        files.extend(found);
    }
    files.truncate(desk.choose(1, usize::MAX));
    Ok(files)
}

fn row(desk: &Desk, name: &str, path: &Path, sampling: Sampling) -> Result<String> {
    let imported = import::load(path).with_context(|| format!("cannot load the scene {}", path.display()))?;
    let scene = Arc::new(PreparedScene::new(imported.scene, &[])?.0);
    desk.say(&format!("{name}: both ways"));
    let reference = Reference::new(desk, &[path], &scene, sampling)?;
    let light = scene.lighting.basis.project(&LightRig::default());
    let mut row = format!("| {name} | {} |", scene.lighting.basis.n_cols());
    for indirect in [Indirect::Shared, Indirect::Traced] {
        let denoise = indirect == Indirect::Shared;
        let n_seeds = if denoise { n_seeds(desk) } else { 1 };
        // Of single lights, median and worst, and of all lights.
        let (mut all_secs, mut errors): (Vec<f64>, [Vec<Told>; 3]) = Default::default();
        for &seed in &SEEDS[..n_seeds] {
            let (spp, tolerance_db) = (SPP, NO_TOLERANCE_DB);
            let config = BakeConfig { spp, tolerance_db, seed, indirect, denoise, ..BakeConfig::default() };
            let (secs, bake) = baked(&scene, sampling.film, config)?;
            let rows = reference.rows_of(&bake.header, &bake.groups);
            let all = reference.picture_told(&light, &reference.relit(&rows, &light));
            let [median, worst] = reference.errors(&rows).median_and_worst().map_or([None; 2], |both| both.map(Some));
            all_secs.push(secs);
            errors.iter_mut().zip([median, worst, all]).for_each(|(errors, told)| errors.extend(told));
        }
        row += &format!(" {} | {} |", spread_words(all_secs), errors.map(|told| told_words(&told)).join(" | "));
    }
    Ok(row + "\n")
}
