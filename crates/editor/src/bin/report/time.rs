//! Error against time: ours, the matrix without compression, a render per light, a render per look; and the first seconds.

mod pays;
mod runs;
pub mod seconds;
mod table;

use anyhow::{Result, ensure};
use clerestory_transport::bake::BakeConfig;
use clerestory_transport::camera::Film;
use clerestory_transport::emitters::PanelRequest;
use clerestory_transport::prepared::PreparedScene;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::desk::Desk;
use super::fit::{spread_words, tenths, to_tenths};
use super::goal::gains_words;
use super::plot::{Axis, Panel, Scale, Series};
use super::scenes;

/// Names of the sections of scenes in which light comes by mirrors and glass, of those that lie elsewhere, and of the first seconds.
const EVEN: &str = "time";
pub const MIRRORS: &str = "time-mirrors";
pub const MIXED: &str = "time-mixed";
pub const OTHERS: &str = "time-others";
pub const LIVING_ROOM: &str = "time-living-room";
pub const SECONDS: &str = "first-seconds";
/// What their headings end with, so that none stands twice on the page.
const OF_MIRRORS: &str = ", by mirrors and glass";
const OF_MIXED: &str = ", with all kinds of surfaces";
const OF_OTHERS: &str = ", in scenes of others";
const OF_LIVING_ROOM: &str = ", in a living room under its sky";

/// A scene of the method's evaluation: its name, and the samples per pixel of each half of its reference. Single lights are the noisier the
/// more of their light comes by mirrors and glass.
type Own = (&'static str, u32);

const EVENLY_LIT: [Own; 2] = [("gallery", runs::REFERENCE_SPP), ("diffuse", runs::REFERENCE_SPP)];
/// These are sections of their own, as with the samples of their references they take longer than those together.
const BY_MIRRORS: [Own; 2] = [("reflections", 512), ("caustics", 1024)];
const ALL_SURFACES: [Own; 1] = [("mixed", 1024)];

/// What a scene is given that its file has not.
#[derive(Clone, Copy)]
enum Given {
    Nothing,
    /// A lamp is divided into texels, so that spots can be set on it.
    Panel(&'static str),
    /// The map of its sky.
    Sky(&'static str),
}

/// A scene that lies elsewhere: its name and its file.
type Elsewhere = (&'static str, &'static str, Given);

/// One lamp in the middle of the first is divided. Each further panel takes some minutes of renders of its spots, and no section takes more
/// than half an hour.
const REAL: [Elsewhere; 2] = [
    ("conference", "scenes/conference.glb", Given::Panel("light_07")),
    ("staircase2", "scenes/bitterli-staircase2.glb", Given::Nothing),
];
/// Texels along a side of it, the fewest that a panel may have.
const TEXELS: u32 = 4;
/// It takes longer than the others together, and no section takes more than half an hour.
const UNDER_A_SKY: [Elsewhere; 1] =
    [("living-room", "scenes/bitterli-living-room.glb", Given::Sky("env/bitterli-living-room-sky19.exr"))];

/// Errors that times are told for, in dB; the greatest is what a bake is asked for that is told nothing.
const TARGETS_DB: [f64; 3] = [30.0, 35.0, 40.0];

/// A scene that is measured.
pub(super) struct Subject {
    pub(super) name: &'static str,
    path: PathBuf,
    sky: Option<PathBuf>,
    /// The lamp that is divided into [`TEXELS`], which its file does not ask for.
    panel: Option<&'static str>,
    pub(super) film: Film,
    /// Of its pixels across and down, every so manyth is compared.
    pub(super) step: u32,
    /// Samples per pixel of each half of its reference, unless in a hurry.
    pub(super) reference_spp: u32,
    /// Repeats where few samples are taken.
    pub(super) n_seeds: usize,
}

impl Subject {
    /// What it is read from.
    fn files(&self) -> Vec<&Path> {
        std::iter::once(&self.path).chain(&self.sky).map(PathBuf::as_path).collect()
    }
}

/// Ways to an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum Way {
    Default,
    Fast,
    Exact,
    Dense,
    Renders,
    Plain,
}

impl Way {
    const ALL: [Way; 6] = [Way::Default, Way::Fast, Way::Exact, Way::Dense, Way::Renders, Way::Plain];

    fn name(self) -> &'static str {
        match self {
            Way::Default => "ours, by default",
            Way::Fast => "ours, indirect light shared",
            Way::Exact => "ours, traced, not denoised",
            Way::Dense => "matrix, not compressed",
            Way::Renders => "a render per light",
            Way::Plain => "a render of one look",
        }
    }
}

/// Which of all ways makes one look alone.
const PLAIN: usize = 5;

/// What a way has reached after some time.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Point {
    pub(super) way: Way,
    pub(super) seed: u64,
    /// Samples per pixel; those of the preview are none of a number.
    pub(super) spp: Option<u32>,
    pub(super) cpu_secs: f64,
    /// Errors in dB: of single lights (median over columns), of spots on a panel, of all lights as in the file.
    pub(super) db: [Option<f64>; 3],
}

/// Classes of light in the order of the page, with their title and the name of their plot.
const CHAPTERS: [(usize, &str, &str); 3] =
    [(0, "Single lights", "single"), (2, "All lights of the file", "full"), (1, "Spots on a panel", "spots")];
const CLASSES: [&str; 3] = ["single lights", "spots on a panel", "all lights of the file"];

/// One scene's measurements.
struct Measured {
    n_cols: usize,
    points: Vec<Point>,
    /// By class of light, the dB at which the reference ends.
    ends: [Option<f64>; 3],
}

impl Measured {
    /// (CPU seconds, dB) of a way and a class of light. A render of one single light costs its part of a render per light.
    fn curve(&self, way: Way, class: usize) -> Vec<[f64; 2]> {
        let (way, part) = match (way, class) {
            (Way::Plain, 0) => (Way::Renders, 1.0 / self.n_cols.max(1) as f64),
            _ => (way, 1.0),
        };
        let of_way = self.points.iter().filter(|point| point.way == way && point.seed == runs::SEEDS[0]);
        of_way.filter_map(|point| Some([part * point.cpu_secs, point.db[class]?])).collect()
    }

    /// Whether the reference ends before an error, so that it cannot judge who reaches it.
    fn is_beyond(&self, target_db: f64, class: usize) -> bool {
        self.ends[class].is_some_and(|end| end < target_db)
    }
}

/// Measures the gallery, and the scene of the method's evaluation that is as evenly lit.
///
/// # Errors
/// If a scene cannot be loaded or baked, or this system does not tell the CPU time of a process.
pub fn write(desk: &Desk) -> Result<String> {
    measured(desk, (EVEN, ""), own(desk, &EVENLY_LIT))
}

/// Measures those in which single lights come by mirrors and glass.
///
/// # Errors
/// As [`write()`].
pub fn write_mirrors(desk: &Desk) -> Result<String> {
    measured(desk, (MIRRORS, OF_MIRRORS), own(desk, &BY_MIRRORS))
}

/// Measures the one that has all of it.
///
/// # Errors
/// As [`write()`].
pub fn write_mixed(desk: &Desk) -> Result<String> {
    measured(desk, (MIXED, OF_MIXED), own(desk, &ALL_SURFACES))
}

/// Measures the scenes of others that are at hand.
///
/// # Errors
/// As [`write()`].
pub fn write_others(desk: &Desk) -> Result<String> {
    measured(desk, (OTHERS, OF_OTHERS), others(desk, &REAL))
}

/// Measures the one under a sky.
///
/// # Errors
/// As [`write()`].
pub fn write_living_room(desk: &Desk) -> Result<String> {
    measured(desk, (LIVING_ROOM, OF_LIVING_ROOM), others(desk, &UNDER_A_SKY))
}

/// Whether there are any: without them the page keeps what was measured elsewhere.
pub fn has_others(desk: &Desk) -> bool {
    !others(desk, &REAL).is_empty()
}

/// Whether the one under a sky is at hand.
pub fn has_living_room(desk: &Desk) -> bool {
    !others(desk, &UNDER_A_SKY).is_empty()
}

/// The tables and plots of some scenes; `of` is what their headings end with.
fn measured(desk: &Desk, (section, of): (&str, &str), subjects: Vec<Subject>) -> Result<String> {
    ensure!(!subjects.is_empty(), "its scenes lie in the folder that CLERESTORY_SHARED names, and are not there");
    let measured = |subject: Subject| {
        let measured = runs::measure(desk, section, &subject)?;
        Ok::<_, anyhow::Error>((subject, measured))
    };
    let scenes = subjects.into_iter().map(measured).collect::<Result<Vec<_>>>()?;
    let mut text = format!("## Error against time{of}\n\n{}{}\n", opening(section), desk.load_words());
    let mut missing = Vec::new();
    for (class, what, file) in CHAPTERS {
        let panels = scenes.iter().map(|(subject, measured)| panel(subject, measured, class));
        let panels: Vec<Panel> = panels.filter(|panel| !panel.series.is_empty()).collect();
        if panels.is_empty() {
            missing.push(CLASSES[class]);
            continue;
        }
        text += &format!("\n### {what}{of}\n");
        text +=
            &desk.plot(&format!("{section}-{file}"), &format!("{what}: error against CPU time, by scene"), &panels)?;
        text += &table::words(&scenes, class);
    }
    if !missing.is_empty() {
        text += &format!("\nThe scenes of this section have no {}.\n", missing.join(" and no "));
    }
    text += &scenes.iter().map(|(subject, measured)| of_panel(subject, measured)).collect::<String>();
    text += &ends(&scenes, |subject| runs::reference_spp(desk, subject), of);
    text += &repeats(&scenes, of);
    text += &beside_samples(scenes.iter().map(|(subject, measured)| (subject.name, measured)));
    text += &pays::table(&scenes, of);
    Ok(text)
}

/// Which lamp of a scene was divided, or why there are no spots in it; nothing where its file has a panel.
fn of_panel(subject: &Subject, measured: &Measured) -> String {
    let Subject { name, panel, sky, .. } = subject;
    match (panel, sky, measured.ends[1]) {
        (Some(lamp), ..) => format!(
            "\nThe lamp `{lamp}` of `{name}` is divided into {TEXELS} × {TEXELS} texels here, so that spots can be set on it, which its file does not ask for; each texel is a single light, as each of its other lamps.\n"
        ),
        (None, Some(_), None) => {
            format!(
                "\nNo spots can be set in `{name}`: it is lit by its sky alone, and no surface of it shines that could be a panel.\n"
            )
        }
        (None, None, None) => {
            format!("\nThere are no spots in `{name}`: none of its lamps is a panel, as its file has them.\n")
        }
        (None, _, Some(_)) => String::new(),
    }
}

/// What is measured, and how; told once.
fn opening(section: &str) -> String {
    if section != EVEN {
        return "Measured as in the section [Error against time](#error-against-time), which tells what stands for what. ".into();
    }
    format!(
        "CPU seconds (user and system), without loading the scene and building its hierarchy, against the error in dB, of six ways. Ours by\n\
         default: what `clerestory bake` makes with growing numbers of samples (`--spp`) and no other option, so that its light is traced and\n\
         denoised and blocks are done at {asked_db} dB; with {default} samples, where these do not take too long, it is the bake that nothing is said of.\n\
         Ours with indirect light shared, as with `--fast`, and traced but not denoised, as with `--no-denoise`, both taking all samples. The very\n\
         samples of the latter without compression: the full matrix. A path-traced render per light, all of them. And one render of the look in\n\
         question, which no light can be changed in afterwards. Renders and the full matrix are not denoised; what a denoiser of pictures would make of them is not\n\
         measured. The first point of each of ours is its preview; its seconds are not among those of the\n\
         points that follow.\n\n\
         Where a render per light would take too long for all lights, {some} of them are rendered, evenly spaced over the columns: the seconds\n\
         are theirs times the number of lights over {some}, and the error is that of single lights alone, the median over these. A render of one\n\
         single light costs its part of a render per light.\n\n\
         The error is the mean of (x − a)(x − b), a and b two references that are kept between runs and whose samples stand below, under the\n\
         square of the reference's 99.5 percentile, told as no less than its standard error over the pixels; nothing is clipped, and pixels that show the light\n\
         itself, or lie beside one that does, are left out. Of single lights: the median over all columns, each below its own peak. Spots: three\n\
         of them on the first panel, one after the other, and the mean of their dB and, of a render of one look, of their seconds.\n\n\
         Of each number of samples all ways are measured one after the other; further points of shared light or of light that is not denoised,\n\
         whichever is ahead, come last, until it has {further} dB of single lights. Seed 1, of a render per light another one for each; how far repeats lie apart is told below. The\n\
         references have seeds of their own. ",
        asked_db = BakeConfig::default().tolerance_db,
        default = BakeConfig::default().spp,
        some = runs::SOME,
        further = runs::FURTHER_DB,
    )
}

/// Scenes of the method's evaluation; in a hurry no more than the last.
fn own(desk: &Desk, scenes: &'static [Own]) -> Vec<Subject> {
    let (film, step) = desk.choose((Film { width: 64, height: 48 }, 1), (Film { width: 160, height: 120 }, 2));
    let own = scenes[desk.choose(scenes.len() - 1, 0)..].iter().map(|&(name, reference_spp)| {
        let path = desk.root.join(format!("assets/scenes/{name}.glb"));
        Subject { name, path, sky: None, panel: None, film, step, reference_spp, n_seeds: runs::SEEDS.len() }
    });
    own.collect()
}

/// Those of some real scenes that are at hand; in a hurry no more than the first.
fn others(desk: &Desk, scenes: &'static [Elsewhere]) -> Vec<Subject> {
    let (film, step) = desk.choose((Film { width: 96, height: 72 }, 1), (Film { width: 512, height: 384 }, 4));
    let real = scenes[..desk.choose(1, scenes.len())].iter().filter_map(|&(name, path, given)| {
        let (path, reference_spp) = (desk.shared(path)?, runs::REFERENCE_SPP);
        let (sky, panel) = match given {
            Given::Nothing => (None, None),
            Given::Panel(lamp) => (None, Some(lamp)),
            Given::Sky(map) => (Some(desk.shared(map)?), None),
        };
        // Under a sky bakes of few samples take as long as others of many.
        let n_seeds = runs::SEEDS.len() - usize::from(sky.is_some());
        Some(Subject { name, path, sky, panel, film, step, reference_spp, n_seeds })
    });
    real.collect()
}

/// Loads a scene and makes it ready for rays.
pub(super) fn prepared(subject: &Subject) -> Result<Arc<PreparedScene>> {
    let sky = subject.sky.as_deref().map(|map| (subject.name, map));
    let request = |lamp: &str| PanelRequest { node: lamp.into(), resolution: TEXELS };
    let panel = subject.panel.map(request);
    Ok(Arc::new(scenes::with_panels(&subject.path, panel.as_slice(), sky)?))
}

fn panel(subject: &Subject, measured: &Measured, class: usize) -> Panel {
    let curve = |way: Way| Series { name: way.name().into(), points: measured.curve(way, class), is_joined: true };
    Panel {
        title: format!("{} ({} columns)", subject.name, measured.n_cols),
        x: Axis { label: "CPU seconds", scale: Scale::Log },
        y: Axis { label: "dB", scale: Scale::Linear },
        series: Way::ALL.into_iter().map(curve).filter(|series| !series.points.is_empty()).collect(),
    }
}

/// How near to the truth errors can be told, and the samples of the references.
fn ends(scenes: &[(Subject, Measured)], samples: impl Fn(&Subject) -> u32, of: &str) -> String {
    let mut text = format!(
        "\n### Where the references end{of}\n\n\
         dB that the mean of both references would be told to have, by its standard error alone: about as far as errors can be told where the noise is even. Where it is a few bright samples, which hardly ever stand in the same entry of both, what is nearer to the truth than their mean is told as better than this.\n\n\
         | scene | samples per pixel of each of both | {} |\n|---|---|---|---|---|\n",
        CHAPTERS.map(|(class, ..)| CLASSES[class]).join(" | "),
    );
    for (subject, measured) in scenes {
        let cells = CHAPTERS.map(|(class, ..)| measured.ends[class].map_or("—".into(), |db| format!("{db:.1}")));
        text += &format!("| {} | {} | {} |\n", subject.name, samples(subject), cells.join(" | "));
    }
    text
}

/// How far bakes and renders of few samples lie apart that differ by their seed alone.
fn repeats(scenes: &[(Subject, Measured)], of: &str) -> String {
    let ways: Vec<&str> = Way::ALL.iter().map(|way| way.name()).collect();
    let mut text = format!(
        "\n### Repeats{of}\n\n\
         CPU seconds and dB with {} samples per pixel, median (least…greatest) of {} seeds, of a render per light one; dB of single lights, of a render of one look those of all lights of the file.\n\n\
         | scene | {} |\n|---|{}\n",
        runs::REPEATED_SPP,
        scenes.iter().map(|(subject, _)| subject.n_seeds).max().unwrap_or(0),
        ways.join(" | "),
        "---|".repeat(ways.len()),
    );
    for (subject, measured) in scenes {
        let cell = |way: Way| {
            let class = if way == Way::Plain { 2 } else { 0 };
            let points =
                measured.points.iter().filter(|point| point.way == way && point.spp == Some(runs::REPEATED_SPP));
            let (secs, db): (Vec<f64>, Vec<f64>) =
                points.filter_map(|point| Some((point.cpu_secs, point.db[class]?))).unzip();
            if secs.is_empty() { "—".into() } else { format!("{} s, {} dB", spread_words(secs), tenths(db)) }
        };
        text += &format!("| {} | {} |\n", subject.name, Way::ALL.map(cell).join(" | "));
    }
    text
}

/// How much nearer to the truth ours is than the samples that it is made of, in dB, where the reference can tell.
fn beside_samples<'a>(scenes: impl Iterator<Item = (&'a str, &'a Measured)>) -> String {
    let mut gains: [Vec<(String, f64)>; 2] = Default::default();
    for (name, measured) in scenes {
        let points = measured.points.as_slice();
        let of = |way: Way| points.iter().filter(move |point| point.way == way);
        let pairs = of(Way::Exact).flat_map(|ours| of(Way::Dense).map(move |dense| (ours, dense)));
        for (ours, dense) in pairs.filter(|(ours, dense)| (ours.spp, ours.seed) == (dense.spp, dense.seed)) {
            let row = format!("`{name}`, {} samples, seed {}", ours.spp.unwrap_or(0), ours.seed);
            for (gains, class) in gains.iter_mut().zip([0, 2]) {
                let told = ours.db[class].zip(dense.db[class]);
                let told = told.filter(|(ours, dense)| measured.ends[class].is_none_or(|end| ours.min(*dense) < end));
                gains.extend(told.map(|(ours, dense)| (row.clone(), to_tenths(ours - dense))));
            }
        }
    }
    let [single, all] = gains.map(|gains| {
        let all: Vec<f64> = gains.iter().map(|(_, gain)| *gain).collect();
        let spread = if all.is_empty() { String::new() } else { tenths(all) + ", " };
        spread + &gains_words(&gains)
    });
    format!(
        "\nBeside the very samples that it is made of, ours with traced light, not denoised, has so many dB more, median (least…greatest) over all scenes, samples and seeds but those with which both are beyond where the reference ends, and aimed at is never less, rounded to tenths: of single lights {single}; of all lights of the file {all}. \
         What keeps it from less, and why it is not certain, stands in [decision 0041](decisions/0041-no-block-is-worse-than-its-samples.md) and [decision 0051](decisions/0051-noisy-columns-are-divided-first.md).\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(super) fn subject(name: &'static str) -> Subject {
        let film = Film { width: 4, height: 3 };
        Subject { name, path: PathBuf::new(), sky: None, panel: None, film, step: 1, reference_spp: 64, n_seeds: 3 }
    }

    pub(super) fn point(way: Way, cpu_secs: f64, db: f64) -> Point {
        Point { way, seed: 1, spp: Some(4), cpu_secs, db: [None, None, Some(db)] }
    }

    #[test]
    fn a_lamp_that_is_divided_has_a_column_for_each_texel() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/scenes/diffuse.glb");
        let as_in_file = prepared(&Subject { path: path.clone(), ..subject("diffuse") }).unwrap();
        let key = as_in_file.lighting.basis.sources[0].key.clone();
        assert_eq!(key, "panel");
        let divided = prepared(&Subject { path, panel: Some("panel"), ..subject("diffuse") }).unwrap();
        assert_eq!([&as_in_file, &divided].map(|scene| scene.lighting.basis.n_cols()), [256, 16]);
    }

    #[test]
    fn a_scene_without_spots_says_why() {
        let measured = |spots: Option<f64>| Measured { n_cols: 1, points: Vec::new(), ends: [None, spots, None] };
        assert_eq!(of_panel(&subject("hall"), &measured(Some(40.0))), "");
        let told = of_panel(&Subject { panel: Some("lamp"), ..subject("hall") }, &measured(Some(40.0)));
        assert!(told.starts_with("\nThe lamp `lamp` of `hall` is divided into 4 × 4 texels here"), "{told}");
        let told = of_panel(&Subject { sky: Some(PathBuf::new()), ..subject("hall") }, &measured(None));
        assert!(told.contains("lit by its sky alone"), "{told}");
        assert!(of_panel(&subject("hall"), &measured(None)).contains("none of its lamps is a panel"));
    }

    #[test]
    fn references_are_told_with_their_samples_and_where_they_end() {
        let measured = Measured { n_cols: 1, points: Vec::new(), ends: [Some(30.0), None, Some(45.25)] };
        let told = ends(&[(subject("hall"), measured)], |_| 1024, OF_OTHERS);
        assert!(told.starts_with("\n### Where the references end, in scenes of others\n"), "{told}");
        assert!(told.ends_with("\n| hall | 1024 | 30.0 | 45.2 | — |\n"), "{told}");
    }

    #[test]
    fn ours_is_held_against_the_very_samples_that_it_is_made_of() {
        let mut points = vec![point(Way::Fast, 1.0, 20.0)];
        points.extend([Point { db: [Some(20.0), None, Some(30.0)], ..point(Way::Exact, 9.0, 0.0) }]);
        points.extend([Point { db: [Some(19.5), None, Some(30.5)], ..point(Way::Dense, 8.0, 0.0) }]);
        let told = |ends: [Option<f64>; 3]| {
            let measured = Measured { n_cols: 1, points: points.clone(), ends };
            beside_samples([("hall", &measured)].into_iter())
        };
        let words = told([None; 3]);
        assert!(
            words.contains("aimed at is never less, rounded to tenths:"),
            "what rounds to nothing counts as kept: {words}"
        );
        assert!(words.contains("of single lights 0.5, kept: +0.5 dB at worst (`hall`, 4 samples, seed 1);"), "{words}");
        assert!(words.contains("of the file -0.5, missed: -0.5 dB at worst (`hall`, 4 samples, seed 1)."), "{words}");
        let words = told([Some(20.0), None, Some(29.0)]);
        assert!(words.contains("of single lights 0.5, kept"), "one of both is farther than the reference: {words}");
        assert!(words.contains("of the file nothing to tell."), "both are as near as the reference: {words}");
    }

    #[test]
    fn ways_are_explained_once() {
        let told = opening(EVEN);
        assert!(told.contains("with 256 samples") && told.contains("16 of them are rendered"), "{told}");
        assert!(opening(MIRRORS).contains("(#error-against-time)"));
    }
}
