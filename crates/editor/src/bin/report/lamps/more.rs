//! Lamps with a body or a cone, and lamps whose light mirrors and glass throw on, against traced pictures of the same lamps.

use std::sync::Arc;

use anyhow::{Context, Result};
use clerestory_transport::bake::BakeConfig;
use clerestory_transport::camera::Film;
use clerestory_transport::lamps::{Lacking, LampShape};
use clerestory_transport::patches::DEFAULT_PATCHES;

use super::drawn::{MOST_REDRAWN, Moved};
use super::live::View;
use super::places::Place;
use super::spent::bake;
use super::tables::{decibels, percent};
use super::{BAKE_SPP, Case, LUMEN, TRACED_SPP, Traced, WIDTHS, prepared};
use crate::desk::Desk;

/// Its name.
pub const NAME: &str = "lamps-more";
/// Places of each kind of lamp.
const N_PLACES: usize = 3;
/// Distance of the places from surfaces: no body reaches into one.
const CLEAR_M: f32 = 0.35;

/// Scenes, and kinds of lamps in each. A point has no caustics in traced pictures either, bodies have.
fn scenes() -> [(&'static str, Vec<LampShape>); 3] {
    let broad = vec![LampShape::Rectangle { size_m: [0.6, 0.3] }, LampShape::Spot { inner_rad: 0.3, outer_rad: 0.6 }];
    let round = vec![LampShape::Point, LampShape::Disk { radius_m: 0.1 }, LampShape::Sphere { radius_m: 0.1 }];
    [("gallery", broad), ("caustics", round.clone()), ("reflections", round)]
}

/// A table of scenes and kinds of lamps.
///
/// # Errors
/// A scene that cannot be read, or a bake that fails.
pub fn write(desk: &Desk) -> Result<String> {
    let (mut rows, mut drowned) = (String::new(), Vec::new());
    for (name, shapes) in scenes() {
        let case = Case { name, path: desk.root.join(format!("assets/scenes/{name}.glb")), sky: None };
        desk.say(&format!("lamps of more kinds in {name}"));
        let (of_scene, n_drowned): (String, usize) = desk.part(NAME, name, || {
            measure(desk, &case, &shapes).with_context(|| format!("cannot move lamps in {name}"))
        })?;
        rows += &of_scene;
        drowned.push(format!("{n_drowned} in {name}"));
    }
    let (spp, traced_spp) = (desk.choose(64, BAKE_SPP[0]), desk.choose(TRACED_SPP[0], TRACED_SPP[1]));
    Ok(format!(
        "## More kinds of lamps, and their caustics\n\n\
         Lamps of {LUMEN} lm that aim down, a rectangle of 0.6 × 0.3 m, a spot of 0.6 rad from its axis to its rim, a disk and a sphere of 0.1 m radius, at places that keep {CLEAR_M} m from every surface, drawn as in the section \
         `lamps`: the same for all kinds but where light drowned in noise, in which case another place was drawn, {MOST_REDRAWN} times a kind at most ({} of all kinds). Pictures {} pixels wide, {DEFAULT_PATCHES} patches, {spp} samples per pixel; everything else is measured as in `lamps`, against two traced \
         pictures of {traced_spp} samples per pixel each. A cell has the figures of all places, one after the other. *Onto mirrors and glass* is the share of the lamp's light that the program names, whose caustics are not carried. \
         Traced pictures have them where a lamp has a body; beside a point, which throws none there either, the rows of bodies show how much light is missing (energy) and how far off that leaves the indirect light (L2). {}\n\n\
         | scene | lamp | onto mirrors and glass | noise | energy | L2 | without worst | PSNR | alone |\n|---|---|---|---|---|---|---|---|---|\n{rows}",
        drowned.join(", "),
        WIDTHS[0],
        desk.load_words(),
    ))
}

/// Rows of a scene, and how many of its places drowned.
fn measure(desk: &Desk, case: &Case, shapes: &[LampShape]) -> Result<(String, usize)> {
    let (scene, camera) = prepared(&case.path, None)?;
    let (scene, film) = (Arc::new(scene), Film::of_width(WIDTHS[0], &camera));
    let (n_places, n_samples) = desk.choose((1, TRACED_SPP[0]), (N_PLACES, TRACED_SPP[1]));
    let view = View { scene: &scene, camera: &camera, film, n_samples };
    let moved = Moved { shapes: shapes.to_vec(), n_places, clear_m: CLEAR_M };
    let traced = Traced::find(case, view, &moved, Vec::new())?;
    let spp = desk.choose(64, BAKE_SPP[0]);
    let config = BakeConfig { spp, patches: DEFAULT_PATCHES, ..BakeConfig::default() };
    let (bake, _) = bake(&scene, &camera, film, config)?;
    let places = traced.places(&scene, &bake)?;
    let told = |shape: &LampShape| {
        let both = traced.drawn.iter().zip(&places).filter(|(drawn, _)| drawn.kind == shape.name());
        let lacking = both.map(|(drawn, place)| {
            let named = drawn.lamp.lacking(&scene);
            (named.first().map(|(_, lacking)| *lacking).unwrap_or_default(), *place)
        });
        row(case.name, shape.name(), &lacking.collect::<Vec<_>>())
    };
    Ok((shapes.iter().map(told).collect(), traced.n_drowned))
}

/// A row of the places of a kind of lamp.
fn row(scene: &str, kind: &str, places: &[(Lacking, Place)]) -> String {
    let cell = |of: &dyn Fn(&Lacking, &Place) -> String| {
        let words: Vec<String> = places.iter().map(|(lacking, place)| of(lacking, place)).collect();
        if words.is_empty() { "—".to_owned() } else { words.join(", ") }
    };
    format!(
        "| {scene} | {kind} | {} | {} | {} | {} | {} | {} | {} |\n",
        cell(&|lacking, _| format!("{:.0} %", 100.0 * lacking.caustic)),
        cell(&|_, place| percent(place.noise)),
        cell(&|_, place| format!("{:.3}", place.energy)),
        cell(&|_, place| percent(place.l2[0])),
        cell(&|_, place| percent(place.l2[1])),
        cell(&|_, place| decibels(place.psnr_db[0])),
        cell(&|_, place| decibels(place.lamp_psnr_db)),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_has_the_figures_of_all_places_of_a_kind() {
        let place = Place {
            number: 1,
            height_m: 0.5,
            l2: [0.2, 0.1],
            noise: 0.05,
            energy: 0.875,
            in_worst: None,
            psnr_db: [40.0, 50.0],
            lamp_psnr_db: 30.0,
        };
        let lacking = Lacking { caustic: 0.17, mirrored: 0.0 };
        let other = Place { energy: 1.0, ..place };
        let expected = "| room | disk | 17 %, 0 % | 5.0 %, 5.0 % | 0.875, 1.000 | 20.0 %, 20.0 % | 10.0 %, 10.0 % | \
            40.0 dB, 40.0 dB | 30.0 dB, 30.0 dB |\n";
        assert_eq!(row("room", "disk", &[(lacking, place), (Lacking::default(), other)]), expected);
        assert_eq!(row("room", "disk", &[]), "| room | disk | — | — | — | — | — | — | — |\n");
    }
}
