//! Lamps of other kinds than points, and lamps whose light mirrors and glass throw on, against traced pictures of the same lamps.

use std::sync::Arc;

use anyhow::{Context, Result};
use clerestory_transport::bake::{Bake, BakeConfig};
use clerestory_transport::camera::Film;
use clerestory_transport::lamps::{Lacking, LampShape};
use clerestory_transport::patches::DEFAULT_PATCHES;
use serde::{Deserialize, Serialize};

use super::drawn::{Drawn, MOST_REDRAWN, Moved};
use super::live::View;
use super::places::Place;
use super::spent::bake;
use super::tables::{Goals, decibels, percent};
use super::{BAKE_SPP, Case, Change, LUMEN, QUICK, TRACED_SPP, Traced, USUAL, WIDTHS, profile, sun};
use crate::desk::Desk;

/// Names of the sections: together they take more than half an hour.
pub const NAME: &str = "lamps-more";
pub const CAUSTICS: &str = "lamps-caustics";
/// Places of each kind of lamp.
const N_PLACES: usize = 3;
/// Distance of the places from surfaces: no body reaches into one.
const CLEAR_M: f32 = 0.35;
/// The kind of lamp that is looked at with more patches.
const SPOT: &str = "spot";
/// Patches and samples per pixel of further bakes, in which spots tell whether patches are too coarse for them.
const FINER: [[u32; 2]; 2] = [[4 * DEFAULT_PATCHES, BAKE_SPP[0]], [4 * DEFAULT_PATCHES, 2 * BAKE_SPP[0]]];

/// What is told of a scene.
#[derive(Default, Serialize, Deserialize)]
struct Told {
    /// A row for each kind of lamp.
    rows: String,
    /// The same as scene and lamp, with what goals are set for.
    goals: Vec<(String, Goals)>,
    /// Places that drowned.
    n_drowned: usize,
    /// A row for each bake in which spots are looked at.
    spots: String,
}

/// Rooms, and kinds of lamps in each.
fn rooms(desk: &Desk) -> Result<Vec<(Case, Vec<LampShape>)>> {
    let measured = profile(desk.file("lamp.ies"))?;
    let (rectangle, disk) = (LampShape::Rectangle { size_m: [0.6, 0.3] }, LampShape::Disk { radius_m: 0.1 });
    let spot = LampShape::Spot { inner_rad: 0.3, outer_rad: 0.6 };
    Ok(vec![
        (case(desk, "gallery", "gallery", None), vec![rectangle, spot, disk, measured]),
        (case(desk, "gallery with glass", "gallery", Some(sun::glaze)), vec![sun::SUN]),
    ])
}

/// Scenes of glass and mirrors. A point has no caustics in traced pictures either, bodies have.
fn mirrors(desk: &Desk) -> Vec<(Case, Vec<LampShape>)> {
    let round = vec![LampShape::Point, LampShape::Disk { radius_m: 0.1 }, LampShape::Sphere { radius_m: 0.1 }];
    ["caustics", "reflections"].map(|name| (case(desk, name, name, None), round.clone())).into()
}

fn case(desk: &Desk, name: &'static str, file: &str, change: Option<Change>) -> Case {
    Case { name, path: desk.root.join(format!("assets/scenes/{file}.glb")), sky: None, change }
}

/// A table of kinds of lamps, and one of spots with more patches.
///
/// # Errors
/// A scene that cannot be read, or a bake that fails.
pub fn write(desk: &Desk) -> Result<String> {
    let tables = measured(desk, NAME, rooms(desk)?)?;
    Ok(format!(
        "## More kinds of lamps\n\n\
         Lamps of {LUMEN} lm that aim down, a rectangle of 0.6 × 0.3 m, a spot of 0.6 rad from its axis to its rim, a disk of 0.1 m radius, and a point with a measured distribution (*ies*), wide and to one side, that the report writes itself. \
         {} The gallery is closed, so that parallel light (*directional*; {} lx, half a degree from rim to rim) \
         is told of another one, whose clerestory has clear glass in place of the panes that shine: it comes through the middle of that to each place, and brings about as many lumens in. {}\n\n{}\n\
         ### Goals of more kinds of lamps\n\n{}\n\
         ### Spots with more patches\n\n\
         The spot of the gallery once more, at the same places and against the same pictures. There are about as many columns however many patches: what falls with more patches was their size, what falls with more samples noise of the bake; \
         what stays is neither. *Held out* is by how much columns differ from patches under lamps that they were not learned from.\n\n\
         | patches | samples | columns | held out | energy | L2 | without worst | PSNR | alone |\n|---|---|---|---|---|---|---|---|---|\n{}",
        tables.how,
        sun::LUX,
        desk.load_words(),
        tables.light,
        tables.goals,
        tables.spots,
    ))
}

/// A table of lamps before mirrors and glass.
///
/// # Errors
/// As [`write()`].
pub fn write_caustics(desk: &Desk) -> Result<String> {
    let tables = measured(desk, CAUSTICS, mirrors(desk))?;
    Ok(format!(
        "## Caustics of lamps that were added\n\n\
         Lamps of {LUMEN} lm, a point, and a disk that aims down and a sphere of 0.1 m radius. {} \
         Traced pictures have caustics where a lamp has a body; beside a point, which throws none there either, the rows of bodies show how much light is missing (energy) and how far off that leaves the indirect light (L2). {}\n\n{}\n\
         ### Goals of lamps before mirrors and glass\n\n{}",
        tables.how,
        desk.load_words(),
        tables.light,
        tables.goals,
    ))
}

/// What a section tells.
struct Tables {
    /// How it was measured.
    how: String,
    light: String,
    goals: String,
    /// Rows alone.
    spots: String,
}

/// Tables of scenes and kinds of lamps.
fn measured(desk: &Desk, section: &str, scenes: Vec<(Case, Vec<LampShape>)>) -> Result<Tables> {
    let (mut rows, mut spots, mut goals, mut drowned) = (String::new(), String::new(), Vec::new(), Vec::new());
    for (case, shapes) in scenes {
        let name = case.name;
        desk.say(&format!("lamps of more kinds in {name}"));
        let told: Told = desk.part(section, name, || {
            measure(desk, &case, &shapes).with_context(|| format!("cannot move lamps in {name}"))
        })?;
        rows += &told.rows;
        spots += &told.spots;
        goals.extend(told.goals);
        drowned.push(format!("{} in {name}", told.n_drowned));
    }
    let ([_, spp], traced_spp) = (desk.choose(QUICK, USUAL), desk.choose(TRACED_SPP[0], TRACED_SPP[1]));
    let how = format!(
        "They stand at places that keep {CLEAR_M} m from every surface, drawn as in the section \
         `lamps`: the same for all kinds but where light drowned in noise, in which case another place was drawn, {MOST_REDRAWN} times a kind at most ({} of all kinds). \
         Pictures {} pixels wide, {DEFAULT_PATCHES} patches, {spp} samples per pixel; everything else is measured as in `lamps`, against two traced \
         pictures of {traced_spp} samples per pixel each. A cell has the figures of all places, one after the other. *Onto mirrors and glass* is the share of the lamp's light that the program names, whose caustics are not carried.",
        drowned.join(", "),
        WIDTHS[0],
    );
    let light = format!(
        "| scene | lamp | onto mirrors and glass | noise | energy | L2 | without worst | PSNR | alone |\n|---|---|---|---|---|---|---|---|---|\n{rows}"
    );
    let goals = format!(
        "*Kept* where all places keep it, else how many do; and the median.\n\n\
         | scene | lamp | L2 ≤ 5 % | PSNR ≥ 35 dB |\n|---|---|---|---|\n{}",
        goal_rows(&goals)
    );
    Ok(Tables { how, light, goals, spots })
}

/// Rows of a scene, and how many of its places drowned.
fn measure(desk: &Desk, case: &Case, shapes: &[LampShape]) -> Result<Told> {
    let (scene, camera) = case.prepared()?;
    let (scene, film) = (Arc::new(scene), Film::of_width(WIDTHS[0], &camera));
    let (n_places, n_samples) = desk.choose((1, TRACED_SPP[0]), (N_PLACES, TRACED_SPP[1]));
    let view = View { scene: &scene, camera: &camera, film, n_samples };
    let moved = Moved { shapes: shapes.to_vec(), n_places, clear_m: CLEAR_M, lamp: sun::to_place };
    let traced = Traced::find(case, view, &moved, Vec::new())?;
    let baked = |[patches, spp]: [u32; 2]| -> Result<(Bake, Vec<Place>)> {
        let (bake, _) = bake(&scene, &camera, film, BakeConfig { spp, patches, ..BakeConfig::default() })?;
        let places = traced.places(&scene, &bake)?;
        Ok((bake, places))
    };
    let [patches, spp] = desk.choose(QUICK, USUAL);
    let (bake, places) = baked([patches, spp])?;
    let mut told = Told { n_drowned: traced.n_drowned, ..Told::default() };
    for kind in shapes.iter().map(LampShape::name) {
        let (lacking, places): (Vec<Lacking>, Vec<Place>) = of_kind(&traced.drawn, &places, kind)
            .map(|(drawn, place)| {
                let named = drawn.lamp.lacking(&scene);
                (named.first().map(|(_, lacking)| *lacking).unwrap_or_default(), *place)
            })
            .unzip();
        told.rows += &row((case.name, kind), &lacking, &places);
        told.goals.push((format!("{} | {kind}", case.name), Goals::of(&places, Vec::new())));
    }
    if shapes.iter().any(|shape| shape.name() == SPOT) {
        let spots = |places: &[Place]| -> Vec<Place> {
            of_kind(&traced.drawn, places, SPOT).map(|(_, place)| *place).collect()
        };
        told.spots = spot_row(&bake, spp, &spots(&places))?;
        for &[patches, spp] in desk.choose(&FINER[..0], &FINER[..]) {
            let (bake, places) = baked([patches, spp])?;
            told.spots += &spot_row(&bake, spp, &spots(&places))?;
        }
    }
    Ok(told)
}

/// Lamps of a kind, each with its place.
fn of_kind<'a>(
    drawn: &'a [Drawn],
    places: &'a [Place],
    kind: &'a str,
) -> impl Iterator<Item = (&'a Drawn, &'a Place)> + 'a {
    drawn.iter().zip(places).filter(move |(drawn, _)| drawn.kind == kind)
}

/// A row of the places of a kind of lamp.
fn row((scene, kind): (&str, &str), lacking: &[Lacking], places: &[Place]) -> String {
    format!(
        "| {scene} | {kind} | {} | {} | {} |\n",
        cell(lacking, |lacking| format!("{:.0} %", 100.0 * lacking.caustic)),
        cell(places, |place| percent(place.noise)),
        figures(places),
    )
}

/// Cells of energy, of L2 with and without the worst pixels, and of PSNR of the whole picture and of the lamp alone.
fn figures(places: &[Place]) -> String {
    let cells = [
        cell(places, |place| format!("{:.3}", place.energy)),
        cell(places, |place| percent(place.l2[0])),
        cell(places, |place| percent(place.l2[1])),
        cell(places, |place| decibels(place.psnr_db[0])),
        cell(places, |place| decibels(place.lamp_psnr_db)),
    ];
    cells.join(" | ")
}

/// A row of spots in a bake with some samples per pixel.
fn spot_row(bake: &Bake, spp: u32, places: &[Place]) -> Result<String> {
    let patches = bake.header.patches.as_ref().context("no patches")?;
    let (n_patches, n_columns) = (patches.n_patches(), patches.n_columns());
    let held_out = percent(patches.held_out_error().into());
    Ok(format!("| {n_patches} | {spp} | {n_columns} | {held_out} | {} |\n", figures(places)))
}

/// What is told of all places, one after the other.
fn cell<T>(places: &[T], of: impl Fn(&T) -> String) -> String {
    let words: Vec<String> = places.iter().map(of).collect();
    if words.is_empty() { "—".to_owned() } else { words.join(", ") }
}

/// A row for each kind of lamp, and one for all.
fn goal_rows(goals: &[(String, Goals)]) -> String {
    let mut all = Goals::default();
    goals.iter().for_each(|(_, goals)| all.add(goals));
    let rows: String = goals.iter().map(|(name, goals)| format!("| {name} | {} |\n", goals.of_light())).collect();
    format!("{rows}| all | all | {} |\n", all.of_light())
}

#[cfg(test)]
mod tests {
    use clerestory::headless::GALLERY;
    use clerestory_transport::import;
    use clerestory_transport::patches::MOST_PATCHES;
    use clerestory_transport::prepared::PreparedScene;

    use super::*;

    const PLACE: Place = Place {
        number: 1,
        height_m: 0.5,
        l2: [0.2, 0.1],
        noise: 0.05,
        energy: 0.875,
        in_worst: None,
        psnr_db: [40.0, 50.0],
        lamp_psnr_db: 30.0,
    };

    #[test]
    fn a_row_has_the_figures_of_all_places_of_a_kind() {
        let lacking = [Lacking { caustic: 0.17, mirrored: 0.0 }, Lacking::default()];
        let expected = "| room | disk | 17 %, 0 % | 5.0 %, 5.0 % | 0.875, 1.000 | 20.0 %, 20.0 % | 10.0 %, 10.0 % | \
            40.0 dB, 40.0 dB | 30.0 dB, 30.0 dB |\n";
        assert_eq!(row(("room", "disk"), &lacking, &[PLACE, Place { energy: 1.0, ..PLACE }]), expected);
        assert_eq!(row(("room", "disk"), &[], &[]), "| room | disk | — | — | — | — | — | — | — |\n");
    }

    #[test]
    fn spots_are_looked_at_with_more_patches_at_the_same_places() {
        let scene = import::load_bytes("gallery.glb", GALLERY).unwrap().scene;
        let scene = Arc::new(PreparedScene::new(scene, &[]).unwrap().0);
        let (camera, film) = (&scene.scene.cameras[0], Film { width: 8, height: 6 });
        let (bake, _) =
            bake(&scene, camera, film, BakeConfig { spp: 2, patches: 32, ..BakeConfig::default() }).unwrap();
        let row = spot_row(&bake, 2, &[PLACE, PLACE]).unwrap();
        let patches = bake.header.patches.as_ref().unwrap();
        let start = format!("| {} | 2 | {} | ", patches.n_patches(), patches.n_columns());
        assert!(row.starts_with(&start), "{row}");
        assert!(
            row.ends_with("| 0.875, 0.875 | 20.0 %, 20.0 % | 10.0 %, 10.0 % | 40.0 dB, 40.0 dB | 30.0 dB, 30.0 dB |\n")
        );
        assert!(FINER.iter().all(|[patches, _]| *patches <= MOST_PATCHES));
    }

    #[test]
    fn goals_are_counted_for_each_kind_and_for_all() {
        let other = Place { l2: [0.04, 0.03], psnr_db: [30.0, 50.0], ..PLACE };
        let of = |places: &[Place]| Goals::of(places, Vec::new());
        let goals = [("room | disk".to_owned(), of(&[PLACE])), ("room | spot".to_owned(), of(&[other, other]))];
        let expected = "| room | disk | missed: kept by 0 of 1, median 20.0 % | kept by all 1, median 40.0 dB |\n\
            | room | spot | kept by all 2, median 4.0 % | missed: kept by 0 of 2, median 30.0 dB |\n\
            | all | all | missed: kept by 2 of 3, median 4.0 % | missed: kept by 1 of 3, median 30.0 dB |\n";
        assert_eq!(goal_rows(&goals), expected);
    }
}
