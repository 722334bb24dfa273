//! What a sitting costs: from opening a file to an exported picture, as a time line.

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result};
use clerestory::session::glimpse;
use clerestory_nystrom::BlockLowRank;
use clerestory_relight::{
    CpuRelighter, DeviceChoice, DisplayParams, Frame, Gpu, GpuRelighter, Radiance, Relight, encode,
};
use clerestory_transport::bake::focus::Focus;
use clerestory_transport::bake::{Bake, BakeConfig, BakeEvent, BakeJob, Indirect, Passes};
use clerestory_transport::camera::Film;
use clerestory_transport::light::{LightRig, LightSetting};
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::{archive, import};
use serde::{Deserialize, Serialize};

use super::desk::{Desk, clerestory};
use super::fit::{spread_words, tenths};
use super::plot::{Axis, Panel, Scale, Series};
use super::reference::{Reference, Sampling};
use super::under_way::{OF_WINDOW, Pass, run_until};

/// Error, as the program tells it itself, at which a designer goes on.
const TARGET_DB: f32 = 35.0;
/// Names of the stages that end in a picture of the bake: a first look, the preview, and what is told to have 35 dB.
const TO_LOOK: &str = "first look";
const TO_PREVIEW: &str = "first preview";
const TO_TARGET: &str = "refined until 35 dB are told, or the time is up";
/// Longest that is refined, seconds; on a machine that is lent for minutes, and else.
const PATIENCE_SECS: [u64; 2] = [20, 60];

/// How a section sits.
#[derive(Clone, Copy)]
struct Manner<'a> {
    section: &'a str,
    plot: &'a str,
    /// Sittings with each scene.
    turns: u64,
    /// How its light is baked, and the words behind the name of the scene.
    lights: &'a [(Indirect, &'static str)],
    patience_secs: u64,
    /// Devices beside the CPU.
    choice: DeviceChoice,
    errors: Errors,
}

/// Which errors are there: what the program tells of itself, or also what is measured beside references.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Errors {
    Told,
    Measured,
}

/// What there was at a moment.
#[derive(Clone, Copy, Serialize, Deserialize)]
struct Reached {
    /// Seconds from opening.
    secs: f64,
    told_db: f64,
    /// Where errors are measured.
    measured_db: Option<f64>,
}

/// Stages with the seconds from opening at which they began and ended.
#[derive(Serialize, Deserialize)]
struct Sitting {
    stages: Vec<(String, [f64; 2])>,
    /// At the end of each pass that came to it, the preview first.
    passes: Vec<Reached>,
    /// When it was left, which may hold blocks of a pass more than the last one that told its error.
    left: Reached,
    /// Devices with their drivers.
    devices: Vec<String>,
}

/// Time lines and tables of sittings, and the devices that took part.
struct Sat {
    text: String,
    devices: String,
}

/// A time line and a table.
///
/// # Errors
/// If a scene cannot be baked, or a device fails.
pub fn write(desk: &Desk) -> Result<String> {
    let (film, turns, patience_secs) = (film_of(desk), desk.choose(1, 3), PATIENCE_SECS[1]);
    let (choice, errors) = (DeviceChoice::Any, Errors::Measured);
    let lights = &OF_WINDOW;
    let manner = Manner { section: "sitting", plot: "sitting", turns, lights, patience_secs, choice, errors };
    let Sat { text, devices } = sat(desk, manner)?;
    Ok(format!(
        "## What a sitting costs\n\n\
         {} × {} pixels, baked in the passes of a window (a first look, a preview, a sixteenth of the samples, then all of them) at its quality *Final*, which is what `clerestory bake` does that is told nothing, and once more with\n\
         indirect light shared; seconds by the clock, median (least…greatest) of {turns} sittings, of seeds 1 to {turns}: how long a stage takes, and when it is over, counted from opening the file. A bake is left\n\
         when a pass tells {TARGET_DB} dB at its end, and {patience_secs} s after it began at the latest: blocks that the pass under way has reached then stand beside those of the pass before. A window keeps a core to itself, and starts with *Draft* on fewer than eight; here all of them bake.\n\
         Told is what the program says of itself at the end of a pass: the mean over all entries, below the columns' peaks. Measured is the median over columns, as of single lights in Error against\n\
         time, with references of {} samples per pixel: a few lights that are worse than the others weigh in what is told and not in what is measured. A drag is one light set\n\
         anew, relit and brought to the display. Devices: {devices}. {}\n{text}",
        film.width,
        film.height,
        reference_spp(desk),
        desk.load_words(),
    ))
}

/// One sitting with each scene and the devices of a kind, with less patience and without references, as parts of a section.
///
/// # Errors
/// As [`write()`].
pub fn once(desk: &Desk, section: &str, choice: DeviceChoice) -> Result<String> {
    let (film, plot, [patience_secs, usual_secs]) = (film_of(desk), format!("{section}-sitting"), PATIENCE_SECS);
    let (lights, errors) = (&OF_WINDOW[..1], Errors::Told);
    let manner = Manner { section, plot: &plot, turns: 1, lights, patience_secs, choice, errors };
    let Sat { text, devices } = sat(desk, manner)?;
    Ok(format!(
        "{} × {} pixels, one sitting of seed 1 with each scene, in the passes of a window at its quality *Final*, refined until a pass tells {TARGET_DB} dB, and left after {patience_secs} s instead of {usual_secs} s. The dB are those that the program tells of itself;\n\
         none are measured, since the references would have to be made for it. Devices: {devices}.\n{text}",
        film.width, film.height,
    ))
}

fn film_of(desk: &Desk) -> Film {
    desk.choose(Film { width: 64, height: 48 }, Film { width: 512, height: 384 })
}

/// Sits with one scene after the other; each sitting is a part of the section.
fn sat(desk: &Desk, manner: Manner<'_>) -> Result<Sat> {
    let own = |name: &str| Some(desk.root.join(format!("assets/scenes/{name}.glb")));
    let scenes = [
        ("diffuse", own("diffuse")),
        ("gallery", own("gallery")),
        ("conference", desk.shared("scenes/conference.glb")),
    ];
    let (mut panels, mut devices) = (Vec::new(), Vec::new());
    let (mut rows, mut passes) = (String::new(), String::new());
    for (name, path) in scenes.into_iter().take(desk.choose(1, 3)) {
        let Some(path) = path else { continue };
        for &(indirect, how) in manner.lights {
            let (name, mut sittings) = (format!("{name}{how}"), Vec::new());
            for turn in 0..manner.turns {
                sittings.push(desk.part(manner.section, &format!("sitting-{name}-{turn}"), || {
                    desk.say(&format!("a sitting with {name}, turn {}", turn + 1));
                    sitting(desk, &path, (indirect, turn), manner)
                })?);
            }
            let Some(first) = sittings.first() else { continue };
            rows += &stage_rows(&name, &sittings, manner.errors);
            passes += &pass_rows(&name, &sittings, manner.errors);
            devices.clone_from(&first.devices);
            panels.push(panel(&name, first));
        }
    }
    let text = format!(
        "{}\n{}{rows}\nThe passes of these sittings, as far as they came to their end:\n\n{}{passes}",
        desk.plot(manner.plot, "the first sitting with each scene as a time line", &panels)?,
        header(["scene", "stage", "s", "over after, s"], manner.errors),
        header(["scene", "pass", "over after, s", "dB told"], manner.errors),
    );
    Ok(Sat { text, devices: if devices.is_empty() { "none".into() } else { devices.join("; ") } })
}

/// What errors are measured beside, where they are.
fn reference(desk: &Desk, path: &Path, scene: &PreparedScene, errors: Errors) -> Result<Option<Reference>> {
    match errors {
        Errors::Told => Ok(None),
        Errors::Measured => {
            desk.say("measuring its errors");
            Ok(Some(Reference::new(desk, &[path], scene, sampling(desk, film_of(desk)))?))
        }
    }
}

/// Samples per pixel of each half of a reference, and which pixels are compared, as in Error against time, which may have the very same.
fn sampling(desk: &Desk, film: Film) -> Sampling {
    Sampling { film, step: desk.choose(1, 4), bounces: None, spp: reference_spp(desk) }
}

fn reference_spp(desk: &Desk) -> u32 {
    desk.choose(16, 64)
}

/// The head of a table, with a column of what is measured where that is done.
fn header(cells: [&str; 4], errors: Errors) -> String {
    let line = match errors {
        Errors::Told => "|---|---|---|---|\n",
        Errors::Measured => "|---|---|---|---|---|\n",
    };
    row(cells.map(String::from), "dB measured".into(), errors) + line
}

/// A row of such a table.
fn row(cells: [String; 4], measured: String, errors: Errors) -> String {
    let cells = cells.join(" | ");
    match errors {
        Errors::Told => format!("| {cells} |\n"),
        Errors::Measured => format!("| {cells} | {measured} |\n"),
    }
}

fn stage_rows(name: &str, sittings: &[Sitting], errors: Errors) -> String {
    let stages = sittings.first().map_or(&[][..], |first| first.stages.as_slice());
    let stage_row = |(nth, (stage, _)): (usize, &(String, [f64; 2]))| {
        let of = |what: fn([f64; 2]) -> f64| -> Vec<f64> {
            sittings.iter().filter_map(|sitting| Some(what(sitting.stages.get(nth)?.1))).collect()
        };
        let (told, measured) = match stage.as_str() {
            TO_PREVIEW => (String::new(), of_passes(sittings, 0, |reached| reached.measured_db)),
            TO_TARGET => {
                let told = sittings.iter().map(|sitting| sitting.left.told_db).collect();
                let measured = sittings.iter().filter_map(|sitting| sitting.left.measured_db).collect();
                (format!(": {} dB told", tenths(told)), measured)
            }
            _ => (String::new(), Vec::new()),
        };
        let (taken, over) = (spread_words(of(|[from, to]| to - from)), spread_words(of(|[_, to]| to)));
        row([name.to_string(), format!("{stage}{told}"), taken, over], measured_words(measured), errors)
    };
    stages.iter().enumerate().map(stage_row).collect()
}

/// Nothing where nothing is measured.
fn measured_words(measured: Vec<f64>) -> String {
    if measured.is_empty() { String::new() } else { tenths(measured) }
}

/// One of the numbers of a pass, of those sittings that came to its end.
fn of_passes(sittings: &[Sitting], pass: usize, which: fn(&Reached) -> Option<f64>) -> Vec<f64> {
    sittings.iter().filter_map(|sitting| which(sitting.passes.get(pass)?)).collect()
}

fn pass_rows(name: &str, sittings: &[Sitting], errors: Errors) -> String {
    let n_passes = sittings.iter().map(|sitting| sitting.passes.len()).max().unwrap_or(0);
    let pass_row = |pass: usize| {
        let secs = of_passes(sittings, pass, |reached| Some(reached.secs));
        let told = of_passes(sittings, pass, |reached| Some(reached.told_db));
        let measured = of_passes(sittings, pass, |reached| reached.measured_db);
        let what = if pass == 0 { "preview".into() } else { pass.to_string() };
        let n = match secs.len() {
            n if n < sittings.len() => format!(", {n} of {} sittings", sittings.len()),
            _ => String::new(),
        };
        let cells = [name.to_string(), format!("{what}{n}"), spread_words(secs), tenths(told)];
        row(cells, measured_words(measured), errors)
    };
    (0..n_passes).map(pass_row).collect()
}

fn sitting(desk: &Desk, path: &Path, (indirect, turn): (Indirect, u64), manner: Manner<'_>) -> Result<Sitting> {
    let (film, begun) = (film_of(desk), Instant::now());
    let mut stages: Vec<(String, [f64; 2])> = Vec::new();
    let mut note = |stage: &str, from: Instant, to: Instant| {
        stages.push((stage.into(), [from, to].map(|at| at.duration_since(begun).as_secs_f64())));
    };
    let scene = import::load(path).with_context(|| format!("cannot load {}", path.display()))?.scene;
    let read = Instant::now();
    note("read the file", begun, read);
    let scene = Arc::new(PreparedScene::new(scene, &[])?.0);
    let prepared = Instant::now();
    note("prepare", read, prepared);

    let config = BakeConfig { indirect, seed: turn + 1, ..BakeConfig::default() };
    let camera = scene.scene.cameras[0].clone();
    let passes = Passes::Progressive;
    let job = BakeJob { scene: scene.clone(), camera, film, config, passes, irradiance: Vec::new() };
    if let Some(look) = glimpse::job(&job) {
        glimpse::run(look, film, &Focus::default(), |_| ControlFlow::Continue(()))?
            .context("nobody stops a first look of the report")?;
        note(TO_LOOK, prepared, Instant::now());
    }
    let (bake_began, mut told_db) = (Instant::now(), 0.0);
    let baked = run_until(job, |event| {
        if let BakeEvent::PassDone { error_db, .. } = event {
            told_db = error_db.total;
        }
        told_db >= TARGET_DB || bake_began.elapsed().as_secs() >= manner.patience_secs
    })?;
    let previewed = baked.passes.first().map_or(baked.ended, |pass| pass.ended);
    note(TO_PREVIEW, bake_began, previewed);
    note(TO_TARGET, previewed, baked.ended);

    let frame = Frame { width: film.width, height: film.height, groups: baked.groups.clone() };
    let key = scene.lighting.basis.sources.first().map_or(String::new(), |source| source.key.clone());
    let rig = |intensity: f32| {
        let mut rig = LightRig::default();
        rig.set(&key, LightSetting { intensity, ..LightSetting::default() });
        baked.header.coefficients(&rig)
    };
    let mut devices = Vec::new();
    let (mut cpu, mut shown, display) = (CpuRelighter::new(&frame)?, Radiance::default(), DisplayParams::default());
    cpu.relight(&rig(1.0), &mut shown)?;
    let ready = Instant::now();
    note("relighter on the CPU", baked.ended, ready);
    cpu.relight(&rig(0.5), &mut shown)?;
    std::hint::black_box(encode(&shown, &display));
    let mut last = Instant::now();
    note("first drag on the CPU", ready, last);
    for gpu in &Gpu::all_headless(manner.choice) {
        let (name, opened) = (short(&gpu.description(), &gpu.api()), Instant::now());
        let mut device = GpuRelighter::new(gpu, &frame)?;
        device.relight_to_texture(&rig(1.0), &display)?;
        gpu.wait()?;
        let ready = Instant::now();
        note(&format!("relighter, {name}"), opened, ready);
        device.relight_to_texture(&rig(0.5), &display)?;
        gpu.wait()?;
        last = Instant::now();
        note(&format!("first drag, {name}"), ready, last);
        devices.push(gpu.description());
    }
    let [transport, picture] = ["sitting.transport", "sitting.png"].map(|name| desk.file(name));
    let bake = Bake { header: baked.header, groups: baked.groups, irradiance: Vec::new(), packed: None };
    archive::write(&bake, transport.as_ref())?;
    let saved = Instant::now();
    note("save the bake", last, saved);
    clerestory(&["relight", &transport, "-o", &picture, "--device", "cpu", "--json"])?;
    note("export, reading the bake", saved, Instant::now());

    let reference = reference(desk, path, &scene, manner.errors)?;
    let reached = |ended: Instant, told_db: f32, groups: &[BlockLowRank]| {
        let measured = |reference: &Reference| {
            let errors = reference.errors(&reference.rows_of(&bake.header, groups));
            errors.median_db().context("no light of the scene lights anything")
        };
        let measured_db = reference.as_ref().map(measured).transpose()?;
        let secs = ended.duration_since(begun).as_secs_f64();
        Ok::<_, anyhow::Error>(Reached { secs, told_db: f64::from(told_db), measured_db })
    };
    let of_pass = |pass: &Pass| reached(pass.ended, pass.told_db, &pass.groups);
    let passes = baked.passes.iter().map(of_pass).collect::<Result<Vec<_>>>()?;
    Ok(Sitting { stages, passes, left: reached(baked.ended, told_db, &bake.groups)?, devices })
}

/// A device in a few words: its name as far as it has no parentheses, and the interface that its driver speaks.
fn short(description: &str, api: &str) -> String {
    let name = description.split(" (").next().unwrap_or(description);
    format!("{name}, {api}")
}

fn panel(name: &str, sitting: &Sitting) -> Panel {
    let bar = |(nth, (stage, [from, to])): (usize, &(String, [f64; 2]))| Series {
        name: stage.clone(),
        points: vec![[*from, -(nth as f64)], [*to, -(nth as f64)]],
        is_joined: true,
    };
    let (db, how) = match sitting.left.measured_db {
        Some(db) => (db, "measured"),
        None => (sitting.left.told_db, "told"),
    };
    Panel {
        title: format!("{name}, {db:.0} dB {how} when it was left"),
        x: Axis { label: "seconds from opening", scale: Scale::Log },
        y: Axis { label: "stage after stage", scale: Scale::Order },
        series: sitting.stages.iter().enumerate().map(bar).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn example(secs: f64, n_passes: usize, errors: Errors) -> Sitting {
        let reached = |secs: f64, told_db: f64, db: f64| {
            let measured_db = (errors == Errors::Measured).then_some(db);
            Reached { secs, told_db, measured_db }
        };
        Sitting {
            stages: [(TO_PREVIEW, [0.0, 1.0]), (TO_TARGET, [1.0, secs]), ("save the bake", [secs, secs + 1.0])]
                .map(|(stage, ends)| (stage.to_string(), ends))
                .into(),
            passes: [reached(1.0, 12.0, 20.0), reached(9.0, 30.0, 35.5)][..n_passes].to_vec(),
            left: reached(secs, 30.0, 36.5),
            devices: Vec::new(),
        }
    }

    #[test]
    fn what_is_told_and_what_is_measured_stand_apart() {
        let errors = Errors::Measured;
        let sittings = [(60.0, 2), (60.0, 2), (62.0, 1)].map(|(secs, n_passes)| example(secs, n_passes, errors));
        let rows = stage_rows("hall", &sittings, errors);
        assert!(rows.contains("| hall | first preview | 1.0 (1.0…1.0) | 1.0 (1.0…1.0) | 20.0 (20.0…20.0) |"), "{rows}");
        assert!(
            rows.contains("the time is up: 30.0 (30.0…30.0) dB told | 59 (59…61) | 60 (60…62) | 36.5 (36.5…36.5) |"),
            "{rows}"
        );
        assert!(rows.contains("| save the bake | 1.0 (1.0…1.0) | 61 (61…63) |  |"), "{rows}");
        let rows = pass_rows("hall", &sittings, errors);
        assert!(
            rows.contains("| hall | 1, 2 of 3 sittings | 9.0 (9.0…9.0) | 30.0 (30.0…30.0) | 35.5 (35.5…35.5) |"),
            "{rows}"
        );
    }

    #[test]
    fn where_nothing_is_measured_no_column_is_left_for_it() {
        let (errors, sittings) = (Errors::Told, [example(20.0, 2, Errors::Told)]);
        assert_eq!(header(["a", "b", "c", "d"], errors), "| a | b | c | d |\n|---|---|---|---|\n");
        let rows = stage_rows("hall", &sittings, errors);
        assert!(
            rows.contains("| hall | refined until 35 dB are told, or the time is up: 30.0 dB told | 19 | 20 |\n"),
            "{rows}"
        );
        assert_eq!(
            pass_rows("hall", &sittings, errors),
            "| hall | preview | 1.0 | 12.0 |\n| hall | 1 | 9.0 | 30.0 |\n"
        );
        assert_eq!(panel("hall", &sittings[0]).title, "hall, 30 dB told when it was left");
        // What an interrupted run has written down can be read again.
        let kept = serde_json::to_string(&sittings[0]).unwrap();
        let sitting: Sitting = serde_json::from_str(&kept).unwrap();
        assert!(sitting.left.measured_db.is_none() && sitting.passes.len() == 2, "{kept}");
    }

    #[test]
    fn devices_that_differ_by_their_driver_have_names_of_their_own_which_are_short() {
        let of = |driver: &str, api: &str| short(&format!("llvmpipe (LLVM 15, 256 bits) (software, {driver})"), api);
        assert_eq!([of("Vulkan, Mesa", "vulkan"), of("Gl, Mesa", "gl")], ["llvmpipe, vulkan", "llvmpipe, gl"]);
        assert_eq!(short("NVIDIA H100 (discrete GPU, Vulkan, 570)", "vulkan"), "NVIDIA H100, vulkan");
    }
}
