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
use crate::fit::{digits, median, spread, spread_words};
use crate::goal::Goal;
use crate::matrix::{NO_TOLERANCE_DB, baked, divided, process_cpu_secs};
use crate::rendered::rendered;

const TURNS: u64 = 3;
/// Scene whose panel is divided otherwise, too, and its texels along a side.
const DIVIDED: (&str, [u32; 2]) = ("diffuse", [4, 8]);
/// What the paper calls practically the same: how many times as long a bake takes, generously.
const PAPER_TIMES: f64 = 1.25;

/// What was measured of a scene.
struct Row {
    name: String,
    n_cols: usize,
    /// CPU seconds with each seed.
    bake: Vec<f64>,
    picture: Vec<f64>,
}

/// A table over the scenes.
///
/// # Errors
/// If a scene cannot be baked, or this system does not tell the CPU time of a process.
pub(super) fn write(desk: &Desk) -> Result<String> {
    let film = desk.choose(Film { width: 64, height: 48 }, Film { width: 192, height: 144 });
    let spp = desk.choose(4, 16);
    let own = SCENES[..desk.choose(1, SCENES.len())].iter();
    let own = own.map(|name| (*name, Some(desk.root.join(format!("assets/scenes/{name}.glb"))), None));
    let (name, sides) = DIVIDED;
    let coarser = sides.map(|side| (name, Some(desk.root.join(format!("assets/scenes/{name}.glb"))), Some(side)));
    let real = [("conference", desk.shared("scenes/conference.glb"), None)];
    let mut rows = Vec::new();
    for (name, path, side) in coarser.into_iter().chain(own).chain(real) {
        let Some(path) = path else { continue };
        let part = side.map_or(format!("plain-{name}"), |side| format!("plain-{name}-{side}"));
        let (n_cols, secs): (usize, Vec<[f64; 2]>) = desk.part("paper", &part, || {
            let scene = import::load(&path).with_context(|| format!("cannot load {}", path.display()))?.scene;
            let panels = side.map(|side| divided(&scene, side)).transpose()?;
            let scene = Arc::new(PreparedScene::new(scene, panels.as_slice())?.0);
            let n_cols = scene.lighting.basis.n_cols();
            desk.say(&format!("{name}: all {n_cols} columns, and one picture"));
            Ok((n_cols, (0..TURNS).map(|turn| both(&scene, film, spp, SEED + turn)).collect::<Result<_>>()?))
        })?;
        let [bake, picture] = [0, 1].map(|which| secs.iter().map(|secs| secs[which]).collect());
        rows.push(Row { name: name.into(), n_cols, bake, picture });
    }
    Ok(format!(
        "\n### All columns against one picture\n\n\
         CPU seconds of a bake of all columns, its indirect light traced, compression and denoising included, and of one path-traced picture under the light of the file,\n\
         both with {spp} samples per pixel of {} × {}; median (least…greatest) of the seeds {SEED} to {}, in turn.\n\n{}\n\n\
         | scene | columns | bake, CPU s | picture, CPU s | ratio | practically the same, as the paper |\n|---|---|---|---|---|---|\n{}",
        film.width,
        film.height,
        SEED + TURNS - 1,
        beside_the_paper(&rows),
        rows.iter().map(Row::text).collect::<String>(),
    ))
}

impl Row {
    fn ratio(&self) -> f64 {
        spread(&self.bake)[1] / spread(&self.picture)[1]
    }

    fn text(&self) -> String {
        let [bake, picture] = [&self.bake, &self.picture].map(|secs| spread_words(secs.clone()));
        let word = Goal::Most(PAPER_TIMES).word(self.ratio());
        format!("| {} | {} | {bake} | {picture} | {}× | {word} |\n", self.name, self.n_cols, digits(self.ratio()))
    }
}

/// What the paper says of it, whether ours reaches that, and what it costs where it does not.
fn beside_the_paper(rows: &[Row]) -> String {
    let ratios: Vec<f64> = rows.iter().map(Row::ratio).collect();
    let n_missed = ratios.iter().filter(|ratio| **ratio > PAPER_TIMES).count();
    let [least, _, greatest] = spread(&ratios).map(digits);
    let reached = match (n_missed, rows.len()) {
        (0, n_rows) => format!("Ours reaches that in all {n_rows} rows"),
        (n_missed, n_rows) => format!("Ours does not reach that in {n_missed} of {n_rows} rows"),
    };
    let mut divided: Vec<&Row> = rows.iter().filter(|row| row.name == DIVIDED.0).collect();
    divided.sort_by_key(|row| row.n_cols);
    let told = |what: &dyn Fn(&Row) -> String| divided.iter().map(|row| what(row)).collect::<Vec<_>>().join(", ");
    let secs = |secs: &[f64]| median(secs).map_or("—".into(), digits);
    let grows = divided.windows(2).all(|pair| pair[0].ratio() < pair[1].ratio());
    let why = if grows {
        "what is seen is connected to every column, so that the bake grows with them"
    } else {
        "it is not the number of columns that costs"
    };
    format!(
        "The paper calls both practically the same, here no more than {PAPER_TIMES} times as long. {reached}: a bake takes {least} to {greatest} times as \
         long as a picture, as {why}: on `{}` with {} columns of the same panel it takes {} CPU s, the picture {}.",
        DIVIDED.0,
        told(&|row| row.n_cols.to_string()),
        told(&|row| secs(&row.bake)),
        told(&|row| secs(&row.picture)),
    )
}

/// CPU seconds of a bake and of a picture.
fn both(scene: &Arc<PreparedScene>, film: Film, spp: u32, seed: u64) -> Result<[f64; 2]> {
    let config = BakeConfig { spp, tolerance_db: NO_TOLERANCE_DB, seed, ..BakeConfig::default() };
    let bake = baked(scene, film, config)?.0;
    let light = scene.lighting.basis.project(&LightRig::default());
    let config = TraceConfig { spp, bounces: None, seed };
    let begun = process_cpu_secs()?;
    rendered(scene, film, &light, &config)?;
    Ok([bake, process_cpu_secs()? - begun])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bake_that_takes_longer_than_the_paper_says_is_told_to_miss_it() {
        let row = |name: &str, n_cols: usize, bake: f64| Row {
            name: name.into(),
            n_cols,
            bake: vec![bake; 3],
            picture: vec![2.0; 3],
        };
        let rows = [row(DIVIDED.0, 64, 12.0), row(DIVIDED.0, 16, 2.2), row("conference", 20, 8.0)];
        assert!(rows[0].text().ends_with(" | 6.0× | missed |\n"), "{}", rows[0].text());
        assert!(rows[1].text().ends_with(" | 1.1× | kept |\n"), "{}", rows[1].text());
        let words = beside_the_paper(&rows);
        assert!(words.contains("does not reach that in 2 of 3 rows: a bake takes 1.1 to 6.0 times"), "{words}");
        assert!(words.ends_with(
            "on `diffuse` with 16, 64 columns of the same panel it takes 2.2, 12 CPU s, the picture 2.0, 2.0."
        ));
        assert!(words.contains("the bake grows with them"), "{words}");
        let even = [row(DIVIDED.0, 64, 2.0), row(DIVIDED.0, 16, 2.2)];
        assert!(beside_the_paper(&even).contains("Ours reaches that"), "{}", beside_the_paper(&even));
    }
}
