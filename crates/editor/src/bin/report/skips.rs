//! Skips: work that a scene does not need, and what a bake costs that does it all the same.

mod again;

use std::ops::ControlFlow;
use std::sync::Arc;

use anyhow::{Context, Result};
use clerestory_transport::bake::{Bake, BakeConfig, BakeJob, Passes};
use clerestory_transport::camera::Film;
use clerestory_transport::emitters::SkyRequest;
use clerestory_transport::figures::Skipped;
use clerestory_transport::import;
use clerestory_transport::light::LightRig;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::skips::{Skip, Skips};
use clerestory_transport::sky::{Environment, SkyForm, SkyLight};

use super::desk::Desk;
use super::matrix::process_cpu_secs;

/// Tolerance in dB, one that many blocks can reach.
const TOLERANCE_DB: f32 = 12.0;
/// Times that each bake is measured; the shortest counts.
const TRIES: usize = 2;

/// Scenes of `assets/scenes`, and whether a uniform sky of patches stands over them.
const SCENES: [(&str, bool); 2] = [("gallery", false), ("diffuse", true)];

/// One bake with what it took.
struct Run {
    load_secs: f64,
    bake_secs: f64,
    skipped: Skipped,
    /// RGB under the light of the file.
    picture: Vec<f32>,
}

/// Bakes two scenes with every skip, without each one, and without any.
///
/// # Errors
/// If a scene cannot be baked, or this system does not tell the CPU time of a process.
pub fn write(desk: &Desk) -> Result<String> {
    let film = desk.choose(Film { width: 32, height: 32 }, Film { width: 256, height: 192 });
    let spp = desk.choose(16, 64);
    let mut tables = String::new();
    for (name, under_sky) in SCENES {
        tables += &scene(desk, (name, under_sky), film, spp)?;
    }
    tables += &again::table(desk, SCENES[0].0, film, spp)?;
    Ok(format!(
        "## Work that is skipped\n\n\
         Bakes of {} × {} pixels with at most {spp} samples each, asked for {TOLERANCE_DB} dB, indirect light traced, no preview: with all\n\
         skips, with each one off alone, and with all off. Times are CPU seconds (user and system) of the whole process, the lesser of\n\
         {TRIES} tries: differences of a quarter say nothing. The last column holds the picture under the\n\
         light of the file against that with all skips: 10·log10(pk² / mean Δ²), pk the 99.5 percentile. Where random numbers\n\
         differ it shows their noise, which the row with another seed tells. {}\n{tables}",
        film.width,
        film.height,
        desk.load_words(),
    ))
}

fn scene(desk: &Desk, (name, under_sky): (&str, bool), film: Film, spp: u32) -> Result<String> {
    let bake = |what: &str, skips: Skips, seed: u64| {
        desk.say(&format!("baking {name} {what}"));
        run(
            desk,
            (name, under_sky),
            film,
            BakeConfig { spp, tolerance_db: TOLERANCE_DB, seed, ..Default::default() },
            skips,
        )
    };
    let reference = bake("with all skips", Skips::default(), 1)?;
    let mut rows = row("all skips", &reference, &reference);
    rows += &row("all skips, another seed", &bake("with another seed", Skips::default(), 2)?, &reference);
    // Without an earlier bake at hand there is nothing to take over: that has a table of its own.
    for skip in Skip::ALL.into_iter().filter(|skip| *skip != Skip::Reuse) {
        let what = format!("without {}", skip.name());
        rows += &row(&what, &bake(&what, Skips::default().without(skip), 1)?, &reference);
    }
    rows += &row("without any", &bake("without any skip", Skips::none(), 1)?, &reference);
    let sky = if under_sky { " under a uniform sky of patches" } else { "" };
    Ok(format!(
        "\n### {name}{sky}\n\n{}\n\n\
         | skips | loading, CPU s | bake, CPU s | against all skips | picture dB |\n|---|---|---|---|---|\n{rows}",
        found(&reference.skipped),
    ))
}

/// The shortest of some tries; everything else of them is the same.
fn run(desk: &Desk, scene: (&str, bool), film: Film, config: BakeConfig, skips: Skips) -> Result<Run> {
    let mut best = attempt(desk, scene, film, config.clone(), skips)?;
    for _ in 1..TRIES {
        let next = attempt(desk, scene, film, config.clone(), skips)?;
        best.load_secs = best.load_secs.min(next.load_secs);
        best.bake_secs = best.bake_secs.min(next.bake_secs);
    }
    Ok(best)
}

fn attempt(desk: &Desk, (name, under_sky): (&str, bool), film: Film, config: BakeConfig, skips: Skips) -> Result<Run> {
    let path = desk.root.join(format!("assets/scenes/{name}.glb"));
    let started = process_cpu_secs()?;
    let scene = import::load_with(&path, skips).with_context(|| format!("cannot load {}", path.display()))?.scene;
    let light = SkyLight::new("uniform", Environment::from_fn(16, 8, |_| glam::Vec3::ONE));
    let sky = under_sky.then_some(SkyRequest { light, form: SkyForm::Patches(1) });
    let scene = Arc::new(PreparedScene::with_skips(scene, &[], sky.as_ref(), skips)?.0);
    let loaded = process_cpu_secs()?;
    let camera = scene.scene.cameras[0].clone();
    let job = BakeJob { scene, camera, film, config, passes: Passes::FinalOnly, irradiance: Vec::new() };
    let bake = job.run(|_| ControlFlow::Continue(()))?.context("nobody stops a bake of the report")?;
    let bake_secs = process_cpu_secs()? - loaded;
    Ok(Run { load_secs: loaded - started, bake_secs, skipped: bake.figures().skipped, picture: picture(&bake) })
}

/// RGB of a bake under the light of the file.
pub fn picture(bake: &Bake) -> Vec<f32> {
    let rig = LightRig::default();
    let mut picture = vec![0.0; 3 * bake.header.width as usize * bake.header.height as usize];
    for (group, coefficients) in bake.groups_under(&rig).iter().zip(bake.header.coefficients(&rig)) {
        for channel in 0..3 {
            let light: Vec<f32> = coefficients.iter().map(|rgb| rgb[channel]).collect();
            let rows = group.apply(&light);
            picture.iter_mut().zip(rows).skip(channel).step_by(3).for_each(|(out, value)| *out += value);
        }
    }
    picture
}

fn row(what: &str, run: &Run, reference: &Run) -> String {
    let ratio = run.bake_secs / reference.bake_secs;
    let db = psnr_db(&run.picture, &reference.picture).map_or("the same".into(), |db| format!("{db:.1}"));
    format!("| {what} | {:.2} | {:.2} | {ratio:.2}× | {db} |\n", run.load_secs, run.bake_secs)
}

/// What a bake tells that it found needless.
fn found(skipped: &Skipped) -> String {
    format!(
        "Found: {:.0} % of the samples in {} converged blocks, {} dark blocks and {} columns that are dark in a block; {} columns of the sky and {} of lamps that light nothing \
         ({:.1} million connections), {} unseen patches, {:.0} % of later connections weak; {} empty pixels; {} diffuse materials, \
         {} opaque triangles; {} images ({:.1} MB of texels).",
        100.0 * skipped.samples_saved,
        skipped.converged_blocks,
        skipped.dark_blocks,
        skipped.dark_columns,
        skipped.closed_sky_columns,
        skipped.dark_lamp_columns,
        skipped.connections_saved / 1e6,
        skipped.sky_patches,
        100.0 * skipped.weak_connections,
        skipped.empty_pixels,
        skipped.diffuse_materials,
        skipped.opaque_triangles,
        skipped.idle_images,
        skipped.idle_image_bytes as f64 / 1e6,
    )
}

/// Decibels by which a picture lies below the 99.5 percentile of another, `None` where they are the same.
fn psnr_db(picture: &[f32], reference: &[f32]) -> Option<f64> {
    let mut sorted = reference.to_vec();
    sorted.sort_by(f32::total_cmp);
    let peak = f64::from(*sorted.get(sorted.len() * 995 / 1000)?);
    let square = |(a, b): (&f32, &f32)| f64::from(a - b).powi(2);
    let mean = picture.iter().zip(reference).map(square).sum::<f64>() / reference.len() as f64;
    (mean > 0.0).then(|| 10.0 * (peak * peak / mean).log10())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_is_the_same_as_itself_and_forty_decibels_from_one_that_is_off_by_a_hundredth() {
        let reference: Vec<f32> = (0..1000).map(|i| if i < 900 { 0.5 } else { 2.0 }).collect();
        let off: Vec<f32> = reference.iter().map(|x| x + 0.02).collect();
        assert_eq!(psnr_db(&reference, &reference), None);
        assert!((psnr_db(&off, &reference).expect("they differ") - 40.0).abs() < 1e-3);
    }
}
