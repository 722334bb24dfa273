//! What a sitting costs: from opening a file to an exported picture, as a time line.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use clerestory_nystrom::BlockLowRank;
use clerestory_relight::{
    CpuRelighter, DeviceChoice, DisplayParams, Frame, Gpu, GpuRelighter, Radiance, Relight, encode,
};
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
use super::under_way::{Pass, run_until};

/// Error, as the program tells it itself, at which a designer goes on.
const TARGET_DB: f32 = 35.0;
/// Names of the stages that end in a picture whose error is told: the preview, and 35 dB.
const TO_PREVIEW: &str = "first preview";
const TO_TARGET: &str = "35 dB told, or given up";
/// Longest that is waited for it, seconds.
const PATIENCE_SECS: u64 = 60;

/// Stages with the seconds from opening at which they began and ended.
#[derive(Serialize, Deserialize)]
struct Sitting {
    stages: Vec<(String, [f64; 2])>,
    /// Of each pass that came to its end, the preview first: when, seconds from opening, and the dB told and measured.
    passes: Vec<[f64; 3]>,
    /// The dB of what there was in the end, which may hold blocks of a pass more, told by the last pass and measured.
    left_db: [f64; 2],
    /// Devices with their drivers.
    devices: Vec<String>,
}

/// A time line and a table.
///
/// # Errors
/// If a scene cannot be baked, or a device fails.
pub fn write(desk: &Desk) -> Result<String> {
    let film = desk.choose(Film { width: 64, height: 48 }, Film { width: 512, height: 384 });
    let own = |name: &str| Some(desk.root.join(format!("assets/scenes/{name}.glb")));
    let scenes = [
        ("diffuse", own("diffuse")),
        ("gallery", own("gallery")),
        ("conference", desk.shared("scenes/conference.glb")),
    ];
    let (turns, mut panels, mut devices) = (desk.choose(1, 3), Vec::new(), Vec::new());
    let (mut rows, mut passes) = (String::new(), String::new());
    for (name, path) in scenes.into_iter().take(desk.choose(1, 3)) {
        let Some(path) = path else { continue };
        let mut sittings = Vec::new();
        for turn in 0..turns {
            sittings.push(desk.part("sitting", &format!("{name}-{turn}"), || {
                desk.say(&format!("a sitting with {name}, turn {}", turn + 1));
                sitting(desk, &path, film, turn)
            })?);
        }
        let Some(first) = sittings.first() else { continue };
        rows += &stage_rows(name, &sittings);
        passes += &pass_rows(name, &sittings);
        devices.clone_from(&first.devices);
        panels.push(panel(name, first));
    }
    Ok(format!(
        "## What a sitting costs\n\n\
         {} × {} pixels, indirect light shared, seconds by the clock, median (least…greatest) of {turns} sittings, of seeds 1 to {turns}: how long a stage takes, and when it is\n\
         over, counted from opening the file. It is refined pass by pass until a pass tells {TARGET_DB} dB at its end, after {PATIENCE_SECS} s at the latest, where it is given up in the midst of a pass.\n\
         Told is what the program says of itself at the end of a pass: the mean over all entries, below the columns' peaks. Measured is the median over columns, as of single lights in Error against\n\
         time, with references of {} samples per pixel: a few lights that are worse than the others weigh in what is told and not in what is measured. A drag is one light set\n\
         anew, relit and brought to the display. Devices: {}. {}\n{}\n| scene | stage | s | over after, s | dB measured |\n|---|---|---|---|---|\n{rows}\n\
         The passes of these sittings, as far as they came to their end:\n\n\
         | scene | pass | over after, s | dB told | dB measured |\n|---|---|---|---|---|\n{passes}",
        film.width,
        film.height,
        reference_spp(desk),
        if devices.is_empty() { "none".into() } else { devices.join("; ") },
        desk.load_words(),
        desk.plot("sitting", "the first sitting with each scene as a time line", &panels)?,
    ))
}

/// Samples per pixel of each half of a reference, and which pixels are compared, as in Error against time, which may have the very same.
fn sampling(desk: &Desk, film: Film) -> Sampling {
    Sampling { film, step: desk.choose(1, 4), bounces: None, spp: reference_spp(desk) }
}

fn reference_spp(desk: &Desk) -> u32 {
    desk.choose(16, 64)
}

fn stage_rows(name: &str, sittings: &[Sitting]) -> String {
    let stages = sittings.first().map_or(&[][..], |first| first.stages.as_slice());
    let row = |(nth, (stage, _)): (usize, &(String, [f64; 2]))| {
        let of = |what: fn([f64; 2]) -> f64| -> Vec<f64> {
            sittings.iter().filter_map(|sitting| Some(what(sitting.stages.get(nth)?.1))).collect()
        };
        let (told, measured) = match stage.as_str() {
            TO_PREVIEW => (String::new(), of_passes(sittings, 0, 2)),
            TO_TARGET => {
                let of = |which: usize| sittings.iter().map(|sitting| sitting.left_db[which]).collect::<Vec<f64>>();
                (format!(": {} dB told", tenths(of(0))), of(1))
            }
            _ => (String::new(), Vec::new()),
        };
        format!(
            "| {name} | {stage}{told} | {} | {} | {} |\n",
            spread_words(of(|[from, to]| to - from)),
            spread_words(of(|[_, to]| to)),
            if measured.is_empty() { String::new() } else { tenths(measured) },
        )
    };
    stages.iter().enumerate().map(row).collect()
}

/// One of the numbers of a pass, of those sittings that came to its end.
fn of_passes(sittings: &[Sitting], pass: usize, which: usize) -> Vec<f64> {
    sittings.iter().filter_map(|sitting| Some(sitting.passes.get(pass)?[which])).collect()
}

fn pass_rows(name: &str, sittings: &[Sitting]) -> String {
    let n_passes = sittings.iter().map(|sitting| sitting.passes.len()).max().unwrap_or(0);
    let row = |pass: usize| {
        let [secs, told, measured] = [0, 1, 2].map(|which| of_passes(sittings, pass, which));
        let what = if pass == 0 { "preview".into() } else { pass.to_string() };
        let n = match secs.len() {
            n if n < sittings.len() => format!(", {n} of {} sittings", sittings.len()),
            _ => String::new(),
        };
        format!("| {name} | {what}{n} | {} | {} | {} |\n", spread_words(secs), tenths(told), tenths(measured))
    };
    (0..n_passes).map(row).collect()
}

fn sitting(desk: &Desk, path: &Path, film: Film, turn: u64) -> Result<Sitting> {
    let begun = Instant::now();
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

    let config = BakeConfig { indirect: Indirect::Shared, seed: turn + 1, ..BakeConfig::default() };
    let passes = Passes::Until(Instant::now() + Duration::from_secs(PATIENCE_SECS));
    let camera = scene.scene.cameras[0].clone();
    let job = BakeJob { scene: scene.clone(), camera, film, config, passes, irradiance: Vec::new() };
    let mut told_db = 0.0;
    let baked = run_until(job, |event| {
        if let BakeEvent::PassDone { error_db, .. } = event {
            told_db = error_db.total;
        }
        told_db >= TARGET_DB
    })?;
    let previewed = baked.passes.first().map_or(prepared, |pass| pass.ended);
    note(TO_PREVIEW, prepared, previewed);
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
    for gpu in &Gpu::all_headless(DeviceChoice::Any) {
        let mut device = GpuRelighter::new(gpu, &frame)?;
        device.relight_to_texture(&rig(1.0), &display)?;
        gpu.wait()?;
        let ready = Instant::now();
        device.relight_to_texture(&rig(0.5), &display)?;
        gpu.wait()?;
        last = Instant::now();
        note(&format!("first drag, {}", short(&gpu.description(), &gpu.api())), ready, last);
        devices.push(gpu.description());
    }
    let [transport, picture] = ["sitting.transport", "sitting.png"].map(|name| desk.file(name));
    let bake = Bake { header: baked.header, groups: baked.groups, irradiance: Vec::new(), packed: None };
    archive::write(&bake, transport.as_ref())?;
    let saved = Instant::now();
    note("save the bake", last, saved);
    clerestory(&["relight", &transport, "-o", &picture, "--device", "cpu", "--json"])?;
    note("export, reading the bake", saved, Instant::now());

    desk.say("measuring its errors");
    let reference = Reference::new(desk, &[path], &scene, sampling(desk, film))?;
    let measured = |groups: &[BlockLowRank]| {
        let errors = reference.errors(&reference.rows_of(&bake.header, groups));
        errors.median_db().context("no light of the scene lights anything")
    };
    let of_pass = |Pass { ended, told_db, groups }: &Pass| -> Result<[f64; 3]> {
        Ok([ended.duration_since(begun).as_secs_f64(), f64::from(*told_db), measured(groups)?])
    };
    let passes = baked.passes.iter().map(of_pass).collect::<Result<Vec<_>>>()?;
    Ok(Sitting { stages, passes, left_db: [f64::from(told_db), measured(&bake.groups)?], devices })
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
    Panel {
        title: format!("{name} (left at {:.0} dB measured)", sitting.left_db[1]),
        x: Axis { label: "seconds from opening", scale: Scale::Log },
        y: Axis { label: "stage after stage", scale: Scale::Order },
        series: sitting.stages.iter().enumerate().map(bar).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_told_and_what_is_measured_stand_apart() {
        let sitting = |secs: f64, n_passes: usize| Sitting {
            stages: [(TO_PREVIEW, [0.0, 1.0]), (TO_TARGET, [1.0, secs]), ("save the bake", [secs, secs + 1.0])]
                .map(|(stage, ends)| (stage.to_string(), ends))
                .into(),
            passes: [[1.0, 12.0, 20.0], [9.0, 30.0, 35.5]][..n_passes].to_vec(),
            left_db: [30.0, 36.5],
            devices: Vec::new(),
        };
        let sittings = [sitting(60.0, 2), sitting(60.0, 2), sitting(62.0, 1)];
        let rows = stage_rows("hall", &sittings);
        assert!(rows.contains("| hall | first preview | 1.0 (1.0…1.0) | 1.0 (1.0…1.0) | 20.0 (20.0…20.0) |"), "{rows}");
        assert!(
            rows.contains("given up: 30.0 (30.0…30.0) dB told | 59 (59…61) | 60 (60…62) | 36.5 (36.5…36.5) |"),
            "{rows}"
        );
        assert!(rows.contains("| save the bake | 1.0 (1.0…1.0) | 61 (61…63) |  |"), "{rows}");
        let rows = pass_rows("hall", &sittings);
        assert!(
            rows.contains("| hall | 1, 2 of 3 sittings | 9.0 (9.0…9.0) | 30.0 (30.0…30.0) | 35.5 (35.5…35.5) |"),
            "{rows}"
        );
    }

    #[test]
    fn devices_that_differ_by_their_driver_have_names_of_their_own_which_are_short() {
        let of = |driver: &str, api: &str| short(&format!("llvmpipe (LLVM 15, 256 bits) (software, {driver})"), api);
        assert_eq!([of("Vulkan, Mesa", "vulkan"), of("Gl, Mesa", "gl")], ["llvmpipe, vulkan", "llvmpipe, gl"]);
        assert_eq!(short("NVIDIA H100 (discrete GPU, Vulkan, 570)", "vulkan"), "NVIDIA H100, vulkan");
    }
}
