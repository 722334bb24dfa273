//! A room of twenty lights: how long a relit frame takes, and how it looks beside the full matrix.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result};
use clerestory::compare::compare;
use clerestory_relight::{CpuRelighter, DeviceChoice, Frame, Gpu, GpuRelighter, Radiance, Relight};
use clerestory_transport::bake::{Bake, BakeConfig, BakeJob, Passes};
use clerestory_transport::camera::Film;
use clerestory_transport::import;
use clerestory_transport::light::{LightRig, LightSetting};
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::trace::TraceConfig;

use super::SEED;
use crate::desk::Desk;
use crate::fit::spread_words;
use crate::methods::dense::Picture;
use crate::prints::{difference, jpeg, thinned};
use crate::reference::uncompressed;
use crate::rendered::rendered;

const FRAMES: usize = 25;
const AMPLIFIED: f32 = 10.0;
/// What the bake is asked for, that of a bake that is told nothing.
const TOLERANCE_DB: f32 = 40.0;

/// A sentence, a table and a sheet of pictures.
///
/// # Errors
/// If the scene cannot be baked, or a device fails.
pub(super) fn write(desk: &Desk) -> Result<String> {
    let Some(path) = desk.shared("scenes/conference.glb") else { return Ok(String::new()) };
    let (film, baked_spp) = desk.choose((Film { width: 128, height: 96 }, 4), (Film { width: 1024, height: 768 }, 64));
    desk.say("baking the conference room");
    let scene = import::load(&path).with_context(|| format!("cannot load {}", path.display()))?.scene;
    let scene = Arc::new(PreparedScene::new(scene, &[])?.0);
    let camera = scene.scene.cameras[0].clone();
    let (tolerance_db, denoise) = (TOLERANCE_DB, false);
    let config = BakeConfig { spp: baked_spp, tolerance_db, denoise, seed: SEED, ..BakeConfig::default() };
    let job = BakeJob { scene: scene.clone(), camera, film, config, passes: Passes::FinalOnly, irradiance: Vec::new() };
    let header = job.header()?;
    let baked = |denoise: bool| {
        let job = BakeJob { config: BakeConfig { denoise, ..job.config.clone() }, ..job.clone() };
        job.run(|_| ControlFlow::Continue(()))?.context("nobody stops a bake of the report")
    };
    let bake = baked(false)?;
    let frame = Frame { width: film.width, height: film.height, groups: bake.groups.clone() };
    desk.say("baking it once more, denoised");
    let clean = baked(true)?;

    desk.say("sampling its full matrix");
    let pixels: Vec<u32> = (0..film.n_pixels() as u32).collect();
    let (width, height) = (film.width as usize, film.height as usize);
    let n_cols = header.basis.n_cols();
    let dense = Picture { width, height, n_cols, values: uncompressed(&job, &header, &pixels) };

    let rigs: Vec<LightRig> = (0..FRAMES).map(|nth| rig(&scene, nth)).collect();
    let (mut rows, mut shown, mut full) = (String::new(), Radiance::default(), Radiance::default());
    let mut times =
        vec![("ours on the CPU".to_string(), Vec::new()), ("full matrix on the CPU".to_string(), Vec::new())];
    let mut cpu = CpuRelighter::new(&frame)?;
    let mut psnr = 0.0;
    for rig in &rigs {
        times[0].1.push(millis(|| Ok(cpu.relight(&bake.header.coefficients(rig), &mut shown)?))?);
        let light = scene.lighting.basis.project(rig);
        times[1].1.push(millis(|| {
            full = dense.relit(&light);
            Ok(())
        })?);
        psnr += compare(&shown, &full)?.psnr_db.unwrap_or(f64::INFINITY) / FRAMES as f64;
    }
    for gpu in &Gpu::all_headless(DeviceChoice::Any) {
        let secs = on_device(gpu, &frame, &bake, &rigs)?;
        times.push((format!("ours on {}", gpu.description()), secs));
    }
    let spp = desk.choose(16, 256);
    let traced = traced(desk, &scene, film, (rigs.last().context("there are frames")?, spp))?;
    let mut denoised = Radiance::default();
    let last = rigs.last().context("there are frames")?;
    CpuRelighter::new(&Frame { groups: clean.groups.clone(), ..frame })?
        .relight(&clean.header.coefficients(last), &mut denoised)?;
    let beside =
        |picture: &Radiance| Ok::<_, anyhow::Error>(compare(picture, &traced)?.psnr_db.unwrap_or(f64::INFINITY));
    let [of_ours, of_full, of_denoised] = [beside(&shown)?, beside(&full)?, beside(&denoised)?];
    for (what, millis) in times {
        rows += &format!("| {what} | {} |\n", spread_words(millis));
    }
    let apart = difference(&shown, &full, AMPLIFIED);
    let pictures = [("full matrix", full), ("ours", shown), ("difference, ten times", apart)];
    let small = pictures.map(|(name, picture)| (name, thinned(&picture, desk.choose(1, 4))));
    Ok(format!(
        "\n### A room of twenty lights\n\n\
         `conference`, {n_cols} columns, {} × {} pixels, {baked_spp} samples of each; all lights change their strength and color in each of {FRAMES} frames. Milliseconds by the\n\
         clock, median (least…greatest). Both matrices are of the same samples, ours asked for {TOLERANCE_DB} dB and not denoised; the mean PSNR of the frames against the full\n\
         matrix ({:.0} MB; ours: {:.1} MB in memory) is {psnr:.1} dB, noise that ours did not keep included. Against a path-traced picture of {spp} samples, whose noise counts,\n\
         too, the last frame of ours has {of_ours:.1} dB, that of the full matrix {of_full:.1} dB, and that of the same bake denoised, as bakes are by default, {of_denoised:.1} dB.\n\n| what | ms per frame |\n|---|---|\n{rows}{}",
        film.width,
        film.height,
        (4 * dense.values.len()) as f64 / 1e6,
        bake.figures().bytes as f64 / 1e6,
        desk.show(
            "paper-conference.jpg",
            "the conference room: full matrix, ours, ten times the difference",
            &jpeg(&small)?
        )?,
    ))
}

/// A path-traced picture under other lights.
fn traced(desk: &Desk, scene: &PreparedScene, film: Film, (rig, spp): (&LightRig, u32)) -> Result<Radiance> {
    desk.say("tracing its last frame");
    let light = scene.lighting.basis.project(rig);
    let config = TraceConfig { spp, bounces: None, seed: SEED + 1 };
    rendered(scene, film, &light, &config)
}

/// All lights other than before.
fn rig(scene: &PreparedScene, nth: usize) -> LightRig {
    let share = |light: usize, step: f64| ((nth + 1) as f64 * (light + 1) as f64 * step).fract() as f32;
    let mut rig = LightRig::default();
    for (light, source) in scene.lighting.basis.sources.iter().enumerate() {
        let color = [0.618_033_989, 0.754_877_666, 0.569_840_291].map(|step| 0.3 + 0.7 * share(light, step));
        let setting = LightSetting {
            intensity: 2.0 * share(light, 0.414_213_562),
            color: Some(color),
            ..LightSetting::default()
        };
        rig.set(&source.key, setting);
    }
    rig
}

fn millis(work: impl FnOnce() -> Result<()>) -> Result<f64> {
    let begun = Instant::now();
    work()?;
    Ok(1e3 * begun.elapsed().as_secs_f64())
}

fn on_device(gpu: &Gpu, frame: &Frame, bake: &Bake, rigs: &[LightRig]) -> Result<Vec<f64>> {
    let (mut relighter, display) = (GpuRelighter::new(gpu, frame)?, clerestory_relight::DisplayParams::default());
    let time = |rig: &LightRig| {
        millis(|| {
            relighter.relight_to_texture(&bake.header.coefficients(rig), &display)?;
            Ok(gpu.wait()?)
        })
    };
    rigs.iter().map(time).collect()
}
