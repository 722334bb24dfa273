//! What a sitting costs: from opening a file to an exported picture, as a time line.

use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
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
use super::under_way::run_until;

/// Error of single lights, as the program tells it itself, at which a designer goes on.
const TARGET_DB: f32 = 35.0;
/// Name of the stage that ends there.
const TO_TARGET: &str = "35 dB, or given up";
/// Longest that is waited for it, seconds.
const PATIENCE_SECS: u64 = 60;

/// Stages with the seconds from opening at which they began and ended.
#[derive(Serialize, Deserialize)]
struct Sitting {
    stages: Vec<(String, [f64; 2])>,
    /// What the program told when it was left.
    told_db: f32,
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
    let (turns, mut rows, mut panels) = (desk.choose(1, 3), String::new(), Vec::new());
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
        for (nth, (stage, _)) in first.stages.iter().enumerate() {
            let of = |what: fn([f64; 2]) -> f64| -> Vec<f64> {
                sittings.iter().filter_map(|sitting| Some(what(sitting.stages.get(nth)?.1))).collect()
            };
            let told = match stage == TO_TARGET {
                true => format!(": {} dB", tenths(sittings.iter().map(|sitting| sitting.told_db.into()).collect())),
                false => String::new(),
            };
            rows += &format!(
                "| {name} | {stage}{told} | {} | {} |\n",
                spread_words(of(|[from, to]| to - from)),
                spread_words(of(|[_, to]| to))
            );
        }
        panels.push(panel(name, first));
    }
    Ok(format!(
        "## What a sitting costs\n\n\
         {} × {} pixels, indirect light shared, seconds by the clock, median (least…greatest) of {turns} sittings with seeds of their own: how long a stage takes, and when it is\n\
         over, counted from opening the file. The dB are what the program tells of itself, at the end of a pass, after {PATIENCE_SECS} s at the latest, where it is given up. A drag is one light set\n\
         anew, relit and brought to the display. {}\n{}\n| scene | stage | s | over after, s |\n|---|---|---|---|\n{rows}",
        film.width,
        film.height,
        desk.load_words(),
        desk.plot("sitting", "the first sitting with each scene as a time line", &panels)?,
    ))
}

fn sitting(desk: &Desk, path: &std::path::Path, film: Film, turn: u64) -> Result<Sitting> {
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
    let (mut previewed, mut told_db) = (prepared, 0.0);
    let baked = run_until(job, |event| {
        if let BakeEvent::PassDone { pass, error_db } = event {
            previewed = if *pass == 0 { Instant::now() } else { previewed };
            told_db = error_db.total;
        }
        told_db >= TARGET_DB
    })?;
    note("first preview", prepared, previewed);
    note(TO_TARGET, previewed, baked.ended);

    let frame = Frame { width: film.width, height: film.height, groups: baked.groups.clone() };
    let key = scene.lighting.basis.sources.first().map_or(String::new(), |source| source.key.clone());
    let rig = |intensity: f32| {
        let mut rig = LightRig::default();
        rig.set(&key, LightSetting { intensity, ..LightSetting::default() });
        baked.header.coefficients(&rig)
    };
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
        note(&format!("first drag on {}", gpu.description()), ready, last);
    }
    let [transport, picture] = ["sitting.transport", "sitting.png"].map(|name| desk.file(name));
    let bake = Bake { header: baked.header, groups: baked.groups, irradiance: Vec::new(), packed: None };
    archive::write(&bake, transport.as_ref())?;
    let saved = Instant::now();
    note("save the bake", last, saved);
    clerestory(&["relight", &transport, "-o", &picture, "--device", "cpu", "--json"])?;
    note("export a picture, reading the bake", saved, Instant::now());
    Ok(Sitting { stages, told_db })
}

fn panel(name: &str, sitting: &Sitting) -> Panel {
    let bar = |(nth, (stage, [from, to])): (usize, &(String, [f64; 2]))| Series {
        name: stage.clone(),
        points: vec![[*from, -(nth as f64)], [*to, -(nth as f64)]],
        is_joined: true,
    };
    Panel {
        title: format!("{name} (left at {:.0} dB)", sitting.told_db),
        x: Axis { label: "seconds from opening", scale: Scale::Linear },
        y: Axis { label: "stage after stage", scale: Scale::Order },
        series: sitting.stages.iter().enumerate().map(bar).collect(),
    }
}
