//! A room of twenty lights: how long a relit frame takes, and how it looks beside the full matrix.

mod frames;

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result};
use clerestory::compare::white_level;
use clerestory_relight::DeviceChoice;
use clerestory_transport::bake::{Bake, BakeConfig, BakeJob, Passes};
use clerestory_transport::camera::Film;
use clerestory_transport::light::{LightRig, LightSetting};
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::trace::TraceConfig;

use self::frames::{Bakes, Frames, Racers, alone};
use super::SEED;
use super::lights::told_psnr_db;
use crate::desk::Desk;
use crate::errors::psnr_db;
use crate::methods::dense::Picture;
use crate::methods::planes::Planes;
use crate::prints::{averaged, difference, jpeg_below};
use crate::reference::uncompressed;
use crate::rendered::rendered;
use crate::scenes;

/// The name of its section, apart from that of the other experiments: together they take more than half an hour where devices are software.
pub const NAME: &str = "paper-room";

const FRAMES: usize = 25;
const AMPLIFIED: f32 = 10.0;
/// What the bake is asked for, that of a bake that is told nothing.
const TOLERANCE_DB: f32 = 40.0;
/// The room, in a folder that not everybody has.
const ROOM: &str = "scenes/conference.glb";
/// Of both pictures that the last frame is held against.
const TRACE_SEEDS: [u64; 2] = [SEED + 1, SEED + 2];

/// Whether the room is at hand.
pub fn has_room(desk: &Desk) -> bool {
    desk.shared(ROOM).is_some()
}

/// A sentence, a table and a sheet of pictures.
///
/// # Errors
/// If the scene is not there or cannot be baked, or a device fails.
pub fn write(desk: &Desk) -> Result<String> {
    let path = desk.shared(ROOM).context("the conference room is not at hand: set CLERESTORY_SHARED")?;
    let (text, sheet): (String, Vec<u8>) = desk.part(NAME, "conference", || measured(desk, &path))?;
    let words = "the conference room: full matrix, ours as by default, ours not denoised, and ten times the difference of that from the full matrix";
    Ok(text + &desk.show("paper-conference.jpg", words, &sheet)?)
}

/// The same frames by ours alone, on the CPU and on each device of a kind, as a part of another section.
///
/// # Errors
/// If the scene cannot be baked, or a device fails.
pub fn on_devices(desk: &Desk, section: &str, choice: DeviceChoice) -> Result<String> {
    let Some(path) = desk.shared(ROOM) else { return Ok(String::new()) };
    desk.part::<String>(section, "conference", || {
        let ((film, spp), scene) = (size(desk), Arc::new(scenes::prepared(&path, None)?));
        let bakes = both(desk, &job(&scene, film, spp))?;
        desk.say("relighting it");
        let table = alone(&bakes, &rigs(&scene), choice)?;
        Ok(format!(
            "`conference`, {} columns, {} × {} pixels, {spp} samples of each (seed {SEED}), asked for {TOLERANCE_DB} dB: denoised, as by default, and with `--no-denoise`; all lights change their strength and color in each of\n\
             {FRAMES} frames, after one that does not count, first of the one, then of the other. Milliseconds by the clock, median (least…greatest): on the CPU until the radiance is there, on a device until the picture\n\
             for the display is, waited for. The full matrix is left out.\n\n{table}",
            scene.lighting.basis.n_cols(),
            film.width,
            film.height,
        ))
    })
}

/// The text, and the bytes of the sheet.
fn measured(desk: &Desk, path: &Path) -> Result<(String, Vec<u8>)> {
    let ((film, spp), scene) = (size(desk), Arc::new(scenes::prepared(path, None)?));
    let job = job(&scene, film, spp);
    let bakes = both(desk, &job)?;
    desk.say("sampling its full matrix");
    let header = job.header()?;
    let pixels: Vec<u32> = (0..film.n_pixels() as u32).collect();
    let (width, height, n_cols) = (film.width as usize, film.height as usize, header.basis.n_cols());
    let dense = Planes::new(&Picture { width, height, n_cols, values: uncompressed(&job, &header, &pixels) });

    let rigs = rigs(&scene);
    let racers = Racers { basis: &scene.lighting.basis, bakes: &bakes, dense: &dense };
    let Frames { table, psnr_db: [of_frames, of_plain_frames], shown: [shown, plain], full } =
        racers.race(desk, &rigs)?;
    let last = rigs.last().context("there are frames")?;

    desk.say("tracing its last frame");
    let (light, trace_spp) = (scene.lighting.basis.project(last), desk.choose(8, 64));
    let traced = |seed: u64| rendered(&scene, film, &light, &TraceConfig { spp: trace_spp, bounces: None, seed });
    let [a, b] = TRACE_SEEDS.map(traced);
    let (a, b) = (a?, b?);
    let [of_ours, of_full, of_plain] = [&shown, &full, &plain].map(|picture| psnr_db(picture, [&a, &b]));
    let of_trace = told_psnr_db(&a, &b)?;
    let side = desk.choose(1, 4);
    let (apart, white) = (difference(&plain, &full, AMPLIFIED), white_level(&full) as f32);
    let pictures = [
        ("full matrix", full),
        ("ours, as by default", shown),
        ("ours, not denoised", plain),
        ("difference of that, × 10", apart),
    ];
    let text = format!(
        "## A room of twenty lights\n\n\
         An experiment of [the method's own evaluation](#the-methods-own-evaluation-redone), measured by itself. {}\n\n\
         `conference`, {n_cols} columns, {} × {} pixels, {spp} samples of each (seed {SEED}); all lights change their strength and color in each of {FRAMES} frames, all of which every way makes\n\
         in turn after one that does not count. All matrices are of the same samples, but that blocks of ours take no more once they reach the {TOLERANCE_DB} dB that are asked for. Ours as by default is denoised and\n\
         keeps its lamps apart ([decision 0056](decisions/0056-lamps-are-kept-apart-in-files-too.md)); with `--no-denoise` a rank takes the noise out. The mean PSNR of the frames against the\n\
         full matrix is {of_frames:.1} dB by default and {of_plain_frames:.1} dB with `--no-denoise`, noise of the full matrix that ours did not keep included. Beside two path-traced pictures of {trace_spp} samples each (seeds {} and {}), whose noise does not\n\
         count (errors are told as no less than their standard errors), the last frame of ours has {of_ours:.1} dB by default and {of_plain:.1} dB with `--no-denoise`, that of the full matrix {of_full:.1} dB; the two\n\
         beside each other have {of_trace:.1} dB. Below, each pixel is the mean of {side} × {side}, and all pictures are exposed to four times the median luminance of the full matrix.\n\n{table}",
        desk.load_words(),
        film.width,
        film.height,
        TRACE_SEEDS[0],
        TRACE_SEEDS[1],
    );
    Ok((text, jpeg_below(white, &pictures.map(|(name, picture)| (name, averaged(&picture, side))))?))
}

/// Of the picture, and samples of each pixel.
fn size(desk: &Desk) -> (Film, u32) {
    desk.choose((Film { width: 128, height: 96 }, 4), (Film { width: 1024, height: 768 }, 32))
}

fn job(scene: &Arc<PreparedScene>, film: Film, spp: u32) -> BakeJob {
    let (tolerance_db, seed) = (TOLERANCE_DB, SEED);
    let config = BakeConfig { spp, tolerance_db, seed, ..BakeConfig::default() };
    let (scene, camera) = (scene.clone(), scene.scene.cameras[0].clone());
    BakeJob { scene, camera, film, config, passes: Passes::FinalOnly, irradiance: Vec::new() }
}

/// What is baked as by default, and the same without taking noise out.
fn both(desk: &Desk, job: &BakeJob) -> Result<Bakes> {
    desk.say("baking the conference room");
    let by_default = baked(job, true)?;
    desk.say("baking it once more, not denoised");
    Ok([("as by default", by_default), ("`--no-denoise`", baked(job, false)?)])
}

fn baked(job: &BakeJob, denoise: bool) -> Result<Bake> {
    let job = BakeJob { config: BakeConfig { denoise, ..job.config.clone() }, ..job.clone() };
    job.run(|_| ControlFlow::Continue(()))?.context("nobody stops a bake of the report")
}

/// One to get ready with, then that of each frame.
fn rigs(scene: &PreparedScene) -> Vec<LightRig> {
    (0..=FRAMES).map(|nth| rig(scene, nth)).collect()
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_bake_is_that_of_somebody_who_asks_for_nothing() {
        let folder = std::env::temp_dir().join(format!("clerestory-conference-{}", std::process::id()));
        let desk = Desk::new(true, Some(&folder)).unwrap();
        let scene = Arc::new(scenes::prepared(&desk.root.join("assets/scenes/diffuse.glb"), None).unwrap());
        let bakes = both(&desk, &job(&scene, Film { width: 16, height: 12 }, 2)).unwrap();
        let usual = BakeConfig { spp: 2, seed: SEED, ..BakeConfig::default() };
        let undenoised = BakeConfig { denoise: false, ..usual.clone() };
        assert_eq!(bakes.map(|(_, bake)| bake.header.config.clone()), [usual, undenoised]);
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
