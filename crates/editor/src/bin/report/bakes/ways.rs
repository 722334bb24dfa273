//! Indirect light shared between pixels beside traced light, in every scene that is at hand.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result};
use clerestory_transport::bake::{BakeConfig, Indirect};
use clerestory_transport::camera::Film;
use clerestory_transport::import;
use clerestory_transport::light::LightRig;
use clerestory_transport::prepared::PreparedScene;
use serde::{Deserialize, Serialize};

use crate::desk::Desk;
use crate::errors::{Told, told_words};
use crate::fit::{listed, median, spread, spread_words, tenths};
use crate::matrix::{NO_TOLERANCE_DB, baked};
use crate::reference::{Reference, Sampling};

/// Samples per pixel of the bakes, all of which are taken.
const SPP: u32 = 16;
/// The first for all; the others tell of shared light, which is the cheaper in most scenes, how far bakes lie apart.
const SEEDS: [u64; 3] = [1, 2, 3];

/// How indirect light is found, and whether pixels that show the same surface tell each other: `--fast`, the default, and `--no-denoise`.
const WAYS: [(Indirect, bool); 3] = [(Indirect::Shared, true), (Indirect::Traced, true), (Indirect::Traced, false)];

/// A table of the scenes of `assets/scenes` and of the shared data, and what it says.
///
/// # Errors
/// If a scene cannot be read or baked, or this system does not tell the CPU time of a process.
pub fn write(desk: &Desk) -> Result<String> {
    let (film, step) = desk.choose((Film { width: 32, height: 24 }, 1), (Film { width: 256, height: 192 }, 4));
    let sampling = Sampling { film, step, bounces: None, spp: desk.choose(8, 64) };
    let mut measured = Vec::new();
    for path in scenes(desk)? {
        let name = path.file_stem().map_or("scene".into(), |stem| stem.to_string_lossy().into_owned());
        let part = format!("{name}, all ways");
        measured.push(desk.part("bakes", &part, || measure(desk, &name, &path, sampling))?);
    }
    Ok(format!(
        "\n### Shared beside traced\n\n\
         Every scene, {} × {} pixels, {SPP} samples per pixel, indirect light shared between pixels (`--fast`) or traced, both denoised as by default, and traced as `--no-denoise` does; a scene without light under the even sky that it is given, one column.\n\
         CPU seconds (user and system) of the bake alone. Errors in dB as in the section Matrix, beside two references of {} samples per pixel each: of single lights, median over columns and the worst of them;\n\
         of all lights of the file. Where the standard error is greater than the error, it is what is told, after \"≥\": of the median where that holds of the column in the middle. Told bias is `error_db.bias`, what the bake itself says of sharing, no better than its own standard error.\n\
         With shared light, median (least…greatest) of the seeds {}; traced, one bake of seed {} each.\n\n\
         {}\n\n\
         | scene | columns | shared, CPU s | median | worst | all lights | told bias | traced, CPU s | median | worst | all lights | traced, not denoised, CPU s | median | worst | all lights |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n{}",
        film.width,
        film.height,
        sampling.spp,
        listed(&SEEDS[..n_seeds(desk)]),
        SEEDS[0],
        verdict(&measured),
        measured.iter().map(|scene| scene.row.as_str()).collect::<String>(),
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

/// A scene baked in all ways.
#[derive(Serialize, Deserialize)]
struct Measured {
    name: String,
    /// Of the table.
    row: String,
    shared: Point,
    /// As by default.
    traced: Point,
}

/// Medians of the bakes of one way.
#[derive(Clone, Copy, Serialize, Deserialize)]
struct Point {
    secs: f64,
    /// Of single lights, median and worst, and of all lights.
    errors: [Option<Told>; 3],
    bias_db: Option<f64>,
}

impl Measured {
    /// By how many dB shared light is nearer to the references than traced light that had as many CPU seconds; `None` where a standard error
    /// could decide.
    fn lead_db(&self, which: usize) -> Option<f64> {
        let (shared, traced) = (self.shared.errors[which]?, self.traced.errors[which]?);
        // Noise falls as seconds grow.
        let lead = shared.db - (traced.db + 10.0 * (self.shared.secs / self.traced.secs).log10());
        let farther = if lead > 0.0 { traced } else { shared };
        (lead.is_finite() && !farther.is_bound).then_some(lead)
    }
}

fn measure(desk: &Desk, name: &str, path: &Path, sampling: Sampling) -> Result<Measured> {
    let imported = import::load(path).with_context(|| format!("cannot load the scene {}", path.display()))?;
    let scene = Arc::new(PreparedScene::new(imported.scene, &[])?.0);
    desk.say(&format!("{name}: all ways"));
    let reference = Reference::new(desk, &[path], &scene, sampling)?;
    let [shared, traced, plain] = WAYS.map(|(indirect, denoise)| {
        let seeds = if indirect == Indirect::Shared { &SEEDS[..n_seeds(desk)] } else { &SEEDS[..1] };
        let config = BakeConfig { spp: SPP, tolerance_db: NO_TOLERANCE_DB, indirect, denoise, ..BakeConfig::default() };
        Bakes::new(&scene, (&reference, sampling.film), &config, seeds)
    });
    let (shared, traced, plain) = (shared?, traced?, plain?);
    let bias: String = if shared.bias_db.is_empty() { "—".into() } else { tenths(shared.bias_db.clone()) };
    let row = format!(
        "| {name} | {} | {} | {bias} | {} | {} |\n",
        scene.lighting.basis.n_cols(),
        shared.cells(),
        traced.cells(),
        plain.cells(),
    );
    Ok(Measured { name: name.into(), row, shared: shared.middle(), traced: traced.middle() })
}

/// Bakes of one way.
#[derive(Default)]
struct Bakes {
    secs: Vec<f64>,
    /// Of single lights, median and worst, and of all lights.
    errors: [Vec<Told>; 3],
    bias_db: Vec<f64>,
}

impl Bakes {
    fn new(
        scene: &Arc<PreparedScene>,
        (reference, film): (&Reference, Film),
        config: &BakeConfig,
        seeds: &[u64],
    ) -> Result<Bakes> {
        let light = scene.lighting.basis.project(&LightRig::default());
        let mut bakes = Bakes::default();
        for &seed in seeds {
            let (secs, bake) = baked(scene, film, BakeConfig { seed, ..config.clone() })?;
            let rows = reference.rows_of(&bake.header, &bake.groups);
            let all = reference.picture_told(&light, &reference.relit(&rows, &light));
            let [median, worst] = reference.errors(&rows).median_and_worst().map_or([None; 2], |both| both.map(Some));
            bakes.secs.push(secs);
            bakes.errors.iter_mut().zip([median, worst, all]).for_each(|(errors, told)| errors.extend(told));
            bakes.bias_db.extend(bake.figures().error_db.bias.map(f64::from));
        }
        Ok(bakes)
    }

    fn cells(&self) -> String {
        let errors = self.errors.each_ref().map(|told| told_words(told));
        format!("{} | {}", spread_words(self.secs.clone()), errors.join(" | "))
    }

    fn middle(&self) -> Point {
        let told = |repeats: &Vec<Told>| {
            let db = median(&repeats.iter().map(|told| told.db).collect::<Vec<_>>())?;
            let is_bound = repeats.iter().any(|told| told.is_bound);
            db.is_finite().then_some(Told { db, is_bound })
        };
        Point { secs: spread(&self.secs)[1], errors: self.errors.each_ref().map(told), bias_db: median(&self.bias_db) }
    }
}

/// In how many scenes shared light is nearer per CPU second, and what its bias keeps it from.
fn verdict(scenes: &[Measured]) -> String {
    let n = scenes.len();
    let words = ["the median column", "the worst column", "all lights"].into_iter().enumerate().map(|(which, by)| {
        let leads = || scenes.iter().filter_map(move |scene| Some((scene.lead_db(which)?, &scene.name)));
        let most = leads().min_by(|a, b| a.0.total_cmp(&b.0)).filter(|(lead, _)| *lead < 0.0);
        let (ahead, behind) =
            (leads().filter(|(lead, _)| *lead > 0.0).count(), leads().filter(|(lead, _)| *lead < 0.0).count());
        let by_most = most.map_or(String::new(), |(lead, name)| format!(" (by {:.1} dB at most, {name})", -lead));
        format!("by {by} nearer in {ahead} and farther in {behind}{by_most}")
    });
    let words = words.collect::<Vec<_>>().join("; ");
    let asked_db = f64::from(BakeConfig::default().tolerance_db);
    let kept_from: Vec<&str> = scenes
        .iter()
        .filter(|scene| scene.shared.bias_db.is_some_and(|db| db < asked_db))
        .map(|scene| scene.name.as_str())
        .collect();
    let named = if kept_from.is_empty() { String::new() } else { format!(" ({})", kept_from.join(", ")) };
    format!(
        "Of {n} scenes, beside traced light as by default that has as many CPU seconds (its noise falls as they grow, and its dB are taken to those of shared light), shared light is {words}. \
         Where a standard error could decide, a scene counts for neither. In {} of them{named} the told bias alone keeps shared light from the {asked_db} dB that a bake is asked for by default, \
         however many samples it takes; traced light has no such end. [Decision 0006](decisions/0006-indirect-light-is-traced-unless-sharing-is-asked-for.md) tells what that says of the default.",
        kept_from.len(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene(name: &str, [shared, traced]: [(f64, f64, bool); 2], bias_db: f64) -> Measured {
        let point = |(secs, db, is_bound): (f64, f64, bool), bias_db: Option<f64>| Point {
            secs,
            errors: [Some(Told { db, is_bound }), Some(Told { db: db - 5.0, is_bound: false }), None],
            bias_db,
        };
        let (shared, traced) = (point(shared, Some(bias_db)), point(traced, None));
        Measured { name: name.into(), row: String::new(), shared, traced }
    }

    #[test]
    fn the_verdict_counts_scenes_at_the_same_cpu_seconds() {
        let scenes = [
            // As exact in a tenth of the time: 10 dB ahead.
            scene("hall", [(1.0, 30.0, false), (10.0, 30.0, false)], 45.0),
            // 3 dB nearer in ten times the time: 7 dB behind.
            scene("room", [(10.0, 33.0, false), (1.0, 30.0, false)], 35.0),
            // Farther, but nobody knows whether it is.
            scene("cave", [(1.0, 20.0, true), (1.0, 30.0, false)], 50.0),
        ];
        assert_eq!(scenes[2].lead_db(0), None);
        let leads = [0, 1].map(|scene| scenes[scene].lead_db(0).expect("no bound"));
        assert!((leads[0] - 10.0).abs() < 1e-9 && (leads[1] + 7.0).abs() < 1e-9, "{leads:?}");
        let told = verdict(&scenes);
        assert!(
            told.contains("by the median column nearer in 1 and farther in 1 (by 7.0 dB at most, room);"),
            "{told}"
        );
        assert!(
            told.contains("by the worst column nearer in 1 and farther in 2 (by 10.0 dB at most, cave);"),
            "{told}"
        );
        assert!(told.contains("by all lights nearer in 0 and farther in 0. Where"), "{told}");
        assert!(told.contains("In 1 of them (room) the told bias alone keeps shared light from the 40 dB"), "{told}");
    }
}
