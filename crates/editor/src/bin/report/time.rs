//! Error against time: ours, the matrix without compression, a render per light, a render per look; and the first seconds.

mod runs;
pub mod seconds;

use anyhow::{Context, Result};
use clerestory_transport::camera::Film;
use clerestory_transport::emitters::SkyRequest;
use clerestory_transport::import::{self, load_sky};
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::sky::{SkyForm, SkyLight};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::desk::Desk;
use super::fit::{secs_between, secs_words, spread, spread_words, tenths};
use super::goal::gains_words;
use super::plot::{Axis, Panel, Scale, Series};

/// Names of the sections of scenes that lie elsewhere, and of the first seconds.
pub const OTHERS: &str = "time-others";
pub const LIVING_ROOM: &str = "time-living-room";
pub const SECONDS: &str = "first-seconds";
/// What the headings of both end with, so that none stands twice on the page.
const OF_OTHERS: &str = ", in scenes of others";
const OF_LIVING_ROOM: &str = ", in a living room under its sky";

/// A scene that lies elsewhere: its name, its file, and the map of its sky.
type Elsewhere = (&'static str, &'static str, Option<&'static str>);

const REAL: [Elsewhere; 2] =
    [("conference", "scenes/conference.glb", None), ("staircase2", "scenes/bitterli-staircase2.glb", None)];
/// It takes longer than the others together, and no section takes more than half an hour.
const UNDER_A_SKY: [Elsewhere; 1] =
    [("living-room", "scenes/bitterli-living-room.glb", Some("env/bitterli-living-room-sky19.exr"))];

/// Errors that times are told for, in dB.
const TARGETS_DB: [f64; 2] = [30.0, 35.0];

/// A scene that is measured.
pub(super) struct Subject {
    pub(super) name: &'static str,
    path: PathBuf,
    sky: Option<PathBuf>,
    pub(super) film: Film,
    /// Of its pixels across and down, every so manyth is compared.
    pub(super) step: u32,
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
    Fast,
    Exact,
    Dense,
    Renders,
    Plain,
}

impl Way {
    const ALL: [Way; 5] = [Way::Fast, Way::Exact, Way::Dense, Way::Renders, Way::Plain];

    fn name(self) -> &'static str {
        match self {
            Way::Fast => "ours, indirect light shared",
            Way::Exact => "ours, indirect light traced",
            Way::Dense => "matrix, not compressed",
            Way::Renders => "a render per light",
            Way::Plain => "a render of one look",
        }
    }
}

/// Which of all ways makes one look alone.
const PLAIN: usize = 4;

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
/// What is told of a class that no scene of a section has.
const NOT_THERE: &str = "\nNot measured: the scenes of this section have none.\n";

/// One scene's measurements.
#[derive(Serialize, Deserialize)]
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
}

/// Measures the scenes of the method's evaluation.
///
/// # Errors
/// If a scene cannot be loaded or baked, or this system does not tell the CPU time of a process.
pub fn write(desk: &Desk) -> Result<String> {
    measured(desk, ("time", ""), own(desk))
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
    let mut scenes = Vec::new();
    for subject in subjects {
        let mut measured: Measured = desk.part(section, subject.name, || {
            let scene = prepared(&subject)?;
            let (points, ends) = runs::measure(desk, &subject, &scene)?;
            Ok(Measured { n_cols: scene.lighting.basis.n_cols(), points, ends })
        })?;
        let curves = [Way::Fast, Way::Exact].map(|way| measured.curve(way, 0));
        measured.points.extend(desk.part::<Vec<Point>>(section, &format!("{}, further", subject.name), || {
            runs::further(desk, &subject, curves.each_ref().map(Vec::as_slice))
        })?);
        scenes.push((subject, measured));
    }
    let mut text = format!(
        "## Error against time{of}\n\n\
         CPU seconds (user and system), without loading the scene and building its hierarchy, against the error in dB: ours with growing\n\
         numbers of samples, from the preview on; the same samples without compression; a path-traced render per light, all of them; and one\n\
         render of the look in question, which no light can be changed in afterwards. The error is the mean of (x − a)(x − b), a and b two\n\
         references of {} samples per pixel each that are kept between runs, below the square of the reference's 99.5 percentile, told as no less than its standard error; nothing is\n\
         clipped, and pixels that show the light itself, or lie beside one that does, are left out. Of single lights: the median over all\n\
         columns, each below its own peak. Shared light is denoised by what its pixels show; traced light is not, as with `--no-denoise`, nor is anything else. Spots: three of them on the first panel, one after the other, and the mean of their dB and, of a render of one look, of their seconds. A render of one single light is one of a render per light. Of each number of samples all ways are measured one after the other; further points of the one of ours that is ahead come last. Seed 1; how far repeats lie apart is told below. The references have seeds of their own. {}\n",
        runs::reference_spp(desk),
        desk.load_words(),
    );
    for (class, what, file) in CHAPTERS {
        let panels = scenes.iter().map(|(subject, measured)| panel(subject, measured, class));
        let panels: Vec<Panel> = panels.filter(|panel| !panel.series.is_empty()).collect();
        text += &format!("\n### {what}{of}\n");
        if panels.is_empty() {
            text += NOT_THERE;
            continue;
        }
        text +=
            &desk.plot(&format!("{section}-{file}"), &format!("{what}: error against CPU time, by scene"), &panels)?;
        text += &table(&scenes, class);
    }
    text += &ends(&scenes, of);
    text += &repeats(&scenes, of);
    text += &beside_samples(scenes.iter().map(|(subject, measured)| (subject.name, measured.points.as_slice())));
    text += &pays(&scenes, of);
    Ok(text)
}

/// The scenes of the method's evaluation.
fn own(desk: &Desk) -> Vec<Subject> {
    let own: &[&str] = desk.choose(&["diffuse"], &["gallery", "diffuse", "reflections", "caustics", "mixed"]);
    let (film, step) = desk.choose((Film { width: 64, height: 48 }, 1), (Film { width: 160, height: 120 }, 2));
    let own = own.iter().map(|name| {
        let path = desk.root.join(format!("assets/scenes/{name}.glb"));
        Subject { name, path, sky: None, film, step }
    });
    own.collect()
}

/// Those of some real scenes that are at hand; in a hurry no more than the first.
fn others(desk: &Desk, scenes: &'static [Elsewhere]) -> Vec<Subject> {
    let (film, step) = desk.choose((Film { width: 96, height: 72 }, 1), (Film { width: 512, height: 384 }, 4));
    let real = scenes[..desk.choose(1, scenes.len())].iter().filter_map(|(name, path, sky)| {
        let sky = sky.map(|sky| desk.shared(sky));
        Some(Subject { name, path: desk.shared(path)?, sky: sky.map_or(Some(None), |sky| sky.map(Some))?, film, step })
    });
    real.collect()
}

/// Loads a scene and makes it ready for rays.
pub(super) fn prepared(subject: &Subject) -> Result<Arc<PreparedScene>> {
    let path = &subject.path;
    let scene = import::load(path).with_context(|| format!("cannot load the scene {}", path.display()))?.scene;
    let sky = match &subject.sky {
        None => None,
        Some(path) => {
            let map = load_sky(path).with_context(|| format!("cannot load the sky {}", path.display()))?.0;
            Some(SkyRequest { light: SkyLight::new(subject.name, map), form: SkyForm::Patches(1) })
        }
    };
    Ok(Arc::new(PreparedScene::with_sky(scene, &[], sky.as_ref())?.0))
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

/// CPU seconds to the targets, the least in bold.
fn table(scenes: &[(Subject, Measured)], class: usize) -> String {
    let ways: Vec<&str> = Way::ALL.iter().map(|way| way.name()).collect();
    let mut text = format!(
        "\nCPU seconds to an error of {}, between measured points; \"<\" and \">\": it was reached before the first point, or would be after the last, which has the dB behind it; \"—\": not measured, \
         as it takes too long. The least of each row in bold, where the points tell which it is{}.\n\n| scene | size | dB | {} |\n|---|---|---|{}\n",
        CLASSES[class],
        if class == 0 { ", a render of one of the lights aside" } else { "" },
        ways.join(" | "),
        "---|".repeat(ways.len()),
    );
    let (mut ahead, mut n_rows) = ([0; Way::ALL.len()], 0);
    for (subject, measured) in scenes {
        let curves = Way::ALL.map(|way| measured.curve(way, class));
        if curves.iter().all(Vec::is_empty) {
            continue;
        }
        for target in TARGETS_DB {
            let mut secs = curves.each_ref().map(|curve| secs_between(target, curve));
            if class == 0 {
                secs[PLAIN] = None;
            }
            let soonest = soonest(secs);
            n_rows += 1;
            soonest.into_iter().for_each(|nth| ahead[nth] += 1);
            let cell = |nth: usize| match secs_words(target, &curves[nth]) {
                words if soonest == Some(nth) => format!("**{words}**"),
                words => words + &short_of(target, &curves[nth]),
            };
            let cells: Vec<String> = (0..curves.len()).map(cell).collect();
            let Film { width, height } = subject.film;
            text += &format!("| {} | {width}×{height} | {target:.0} | {} |\n", subject.name, cells.join(" | "));
        }
    }
    text + &ahead_words(ahead, n_rows)
}

/// Which way is the soonest in how many rows.
fn ahead_words(ahead: [usize; Way::ALL.len()], n_rows: usize) -> String {
    let mut ways: Vec<(usize, &str)> = ahead.into_iter().zip(Way::ALL.map(Way::name)).filter(|way| way.0 > 0).collect();
    ways.sort_by_key(|way| std::cmp::Reverse(way.0));
    let mut told: Vec<String> = ways.iter().map(|(n, name)| format!("{name} in {n}")).collect();
    told.push(format!("the points do not tell in {}", n_rows - ahead.iter().sum::<usize>()));
    format!("\nThe soonest of {n_rows} rows: {}.\n", told.join("; "))
}

/// What the last point has of an error that it does not reach; nothing where it is reached.
fn short_of(target_db: f64, curve: &[[f64; 2]]) -> String {
    match (secs_between(target_db, curve), curve.last()) {
        (Some([_, greatest]), Some([_, db])) if greatest.is_infinite() => format!(" ({db:.1} dB)"),
        _ => String::new(),
    }
}

/// Which of several certainly takes the fewest seconds, given the least and the greatest that each can take.
fn soonest<const N: usize>(secs: [Option<[f64; 2]>; N]) -> Option<usize> {
    let is_first = |&nth: &usize| {
        let mut others = secs.iter().enumerate().filter(|(other, _)| *other != nth).filter_map(|(_, secs)| *secs);
        secs[nth].is_some_and(|[_, most]| most.is_finite() && others.all(|[least, _]| most <= least))
    };
    (0..N).find(is_first)
}

/// How near to the truth errors can be told.
fn ends(scenes: &[(Subject, Measured)], of: &str) -> String {
    let mut text = format!(
        "\n### Where the references end{of}\n\n\
         dB that the mean of both references would be told to have, by its standard error alone: about as far as errors can be told where the noise is even. Where it is a few bright samples, which hardly ever stand in the same entry of both, what is nearer to the truth than their mean is told as better than this.\n\n\
         | scene | {} |\n|---|---|---|---|\n",
        CHAPTERS.map(|(class, ..)| CLASSES[class]).join(" | "),
    );
    for (subject, measured) in scenes {
        let cells = CHAPTERS.map(|(class, ..)| measured.ends[class].map_or("—".into(), |db| format!("{db:.1}")));
        text += &format!("| {} | {} |\n", subject.name, cells.join(" | "));
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
        runs::SEEDS.len(),
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

/// How much nearer to the truth ours is than the samples that it is made of, in dB.
fn beside_samples<'a>(scenes: impl Iterator<Item = (&'a str, &'a [Point])>) -> String {
    let mut gains: [Vec<(String, f64)>; 2] = Default::default();
    for (name, points) in scenes {
        let of = |way: Way| points.iter().filter(move |point| point.way == way);
        let pairs = of(Way::Exact).flat_map(|ours| of(Way::Dense).map(move |dense| (ours, dense)));
        for (ours, dense) in pairs.filter(|(ours, dense)| (ours.spp, ours.seed) == (dense.spp, dense.seed)) {
            let row = format!("`{name}`, {} samples, seed {}", ours.spp.unwrap_or(0), ours.seed);
            for (gains, class) in gains.iter_mut().zip([0, 2]) {
                let gain = ours.db[class].zip(dense.db[class]).map(|(ours, dense)| ours - dense);
                gains.extend(gain.map(|gain| (row.clone(), gain)));
            }
        }
    }
    let [single, all] = gains.map(|gains| {
        let spread = tenths(gains.iter().map(|(_, gain)| *gain).collect());
        format!("{spread}, {}", gains_words(&gains))
    });
    format!(
        "\nBeside the very samples that it is made of, ours with traced light, not denoised, has so many dB more, median (least…greatest) over all scenes, samples and seeds, and aimed at is never less: of single lights {single}; of all lights of the file {all}. \
         What keeps it from less, and why it is not certain, stands in [decision 0041](decisions/0041-no-block-is-worse-than-its-samples.md) and [decision 0051](decisions/0051-noisy-columns-are-divided-first.md).\n"
    )
}

/// After how many changes of light a bake has cost less than a render for each.
fn pays(scenes: &[(Subject, Measured)], of: &str) -> String {
    let mut text = format!(
        "\n### Where a bake pays for itself{of}\n\n\
         Looks of all lights after which the bake has cost less CPU time than a render of each at the same error; relighting itself takes\n\
         milliseconds (see Relighting) and is not counted. \"≤\" and \">\": one of the two reached the error before the first point that was measured, or\n\
         would have after the last; \"—\": nothing follows from them.\n\n\
         | scene | dB | ours, indirect light shared | ours, indirect light traced | matrix, not compressed | a render per light |\n|---|---|---|---|---|---|\n",
    );
    let mut most: [Vec<f64>; 2] = Default::default();
    for (subject, measured) in scenes {
        for target in TARGETS_DB {
            let secs = |way: Way| secs_between(target, &measured.curve(way, 2));
            for (most, way) in most.iter_mut().zip([Way::Fast, Way::Exact]) {
                most.extend(secs(way).zip(secs(Way::Plain)).and_then(|(bake, render)| most_looks(bake, render)));
            }
            let looks = |way: Way| looks_words(secs(way)?, secs(Way::Plain)?);
            let looks = |way: Way| looks(way).unwrap_or_else(|| "—".into());
            let cells = [Way::Fast, Way::Exact, Way::Dense, Way::Renders].map(looks);
            text += &format!("| {} | {target:.0} | {} |\n", subject.name, cells.join(" | "));
        }
    }
    let n_rows = TARGETS_DB.len() * scenes.len();
    let [shared, traced] = most.map(|most| {
        let [least, median, greatest] = spread(&most);
        if most.is_empty() {
            return format!("in none of {n_rows} rows");
        }
        format!("{median:.0} ({least:.0}…{greatest:.0}) in {} of {n_rows} rows", most.len())
    });
    text + &format!(
        "\nA bake of ours has paid for itself after at most so many looks, median (least…greatest) of the rows whose points tell it: {shared} with indirect light shared, {traced} with it traced.\n"
    )
}

/// The most looks that a bake costs, given the same; nothing where there is no most.
fn most_looks(bake: [f64; 2], render: [f64; 2]) -> Option<f64> {
    let looks = (bake[1] / render[0]).ceil();
    looks.is_finite().then_some(looks)
}

/// So many looks that a bake costs, given the least and the greatest seconds of the bake and of a render; nothing where all is possible.
fn looks_words(bake: [f64; 2], render: [f64; 2]) -> Option<String> {
    let [least, greatest] = [bake[0] / render[1], bake[1] / render[0]];
    match (least == greatest, greatest.is_finite(), least >= 1.0) {
        (true, ..) => Some(format!("{:.0}", greatest.ceil())),
        (_, true, _) => Some(format!("≤ {:.0}", greatest.ceil())),
        (_, _, true) => Some(format!("> {:.0}", least.floor())),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_soonest_way_is_bold_and_a_bake_pays_after_as_many_looks_as_it_costs_renders() {
        let point = |way: Way, cpu_secs: f64, db: f64| Point {
            way,
            seed: 1,
            spp: Some(4),
            cpu_secs,
            db: [None, None, Some(db)],
        };
        let points = vec![
            point(Way::Fast, 1.0, 20.0),
            point(Way::Fast, 16.0, 40.0),
            point(Way::Plain, 0.1, 20.0),
            point(Way::Plain, 1.6, 40.0),
        ];
        let film = Film { width: 4, height: 3 };
        let subject = Subject { name: "hall", path: PathBuf::new(), sky: None, film, step: 1 };
        let scenes = [(subject, Measured { n_cols: 1, points, ends: [Some(30.0), None, Some(45.25)] })];
        let told = ends(&scenes, OF_OTHERS);
        assert!(told.starts_with("\n### Where the references end, in scenes of others\n"), "{told}");
        assert!(told.ends_with("\n| hall | 30.0 | 45.2 | — |\n"), "{told}");
        let rows = table(&scenes, 2);
        assert!(rows.contains("| hall | 4×3 | 30 | 4.0 | — | — | — | **0.40** |"), "{rows}");
        assert!(
            rows.ends_with("The soonest of 2 rows: a render of one look in 2; the points do not tell in 0.\n"),
            "{rows}"
        );
        assert!(!table(&scenes, 0).contains("hall"), "no single lights were measured");
        let curve = [[1.0, 20.0], [103.0, 21.6]];
        assert_eq!([21.0, 30.0].map(|db| short_of(db, &curve)), ["", " (21.6 dB)"]);
        let mut points = scenes[0].1.points.clone();
        points.extend([Point { db: [Some(20.0), None, Some(30.0)], ..point(Way::Exact, 9.0, 0.0) }]);
        points.extend([Point { db: [Some(19.5), None, Some(30.5)], ..point(Way::Dense, 8.0, 0.0) }]);
        let words = beside_samples([("hall", points.as_slice())].into_iter());
        assert!(words.contains("of single lights 0.5, kept: +0.5 dB at worst (`hall`, 4 samples, seed 1);"), "{words}");
        assert!(words.contains("of the file -0.5, missed: -0.5 dB at worst (`hall`, 4 samples, seed 1)."), "{words}");
        let told = pays(&scenes, "");
        assert!(told.contains("| hall | 30 | 10 | — | — | — |"), "{told}");
        let words = " in 2 of 2 rows with indirect light shared, in none of 2 rows with it traced.\n";
        assert!(told.ends_with(words), "{told}");
        let endless = f64::INFINITY;
        assert_eq!(soonest([Some([4.0, 4.0]), None, Some([3.0, endless])]), None, "the last may take 3 or 300");
        assert_eq!(soonest([Some([0.0, 1.4]), Some([1.7, 1.7])]), Some(0));
        assert_eq!(soonest([Some([9.0, endless]), None]), None);
        let looks = |bake, render| looks_words(bake, render).unwrap_or_default();
        assert_eq!(looks([10.0, 10.0], [98.0, endless]), "≤ 1", "a render takes more");
        assert_eq!(looks([0.0, 1.4], [0.5, 0.5]), "≤ 3", "the first point is good enough");
        assert_eq!(looks([70.0, endless], [20.0, 20.0]), "> 3");
        assert_eq!(looks([70.0, endless], [20.0, endless]), "");
        assert_eq!(looks([7.0, endless], [20.0, 20.0]), "", "more than none says nothing");
    }
}
