//! What the bare command does without a display: bake, relight under three looks, write frames, say so.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clerestory_nystrom::rivals::Method;
use clerestory_transport::bake::{Bake, Passes, SIDE};
use clerestory_transport::basis::LightBasis;
use clerestory_transport::camera::Film;
use clerestory_transport::import::{self, Choice};
use serde_json::json;

use crate::action::is_look;
use crate::cli::args::{BakeOptions, ViewArgs};
use crate::cli::bake::{BakeTimes, baked, job, merge, open_stack, run_with_progress, stack_job};
use crate::cli::relight::Relighter;
use crate::cli::view::{load_scene, prepare_view, warn_of_black, warn_of_unknown_lights};
use crate::cli::{Answer, Console, nothing_kept};
use crate::export::{ExportOptions, Picture};
use crate::look::scene::SceneChoice;
use crate::look::{Look, Units};
use crate::platform::memory_bytes;

/// The built-in scene, a gallery with daylight high in the wall.
pub const GALLERY: &[u8] = include_bytes!("../../../assets/scenes/gallery.glb");

/// Looks of the built-in scene by the names of their frames.
pub const GALLERY_LOOKS: [(&str, &str); 3] = [
    ("as-designed", include_str!("../../../assets/looks/as-designed.look")),
    ("evening", include_str!("../../../assets/looks/evening.look")),
    ("exhibition", include_str!("../../../assets/looks/exhibition.look")),
];

/// Folder of the frames, in the current one.
const FOLDER: &str = "frames";
/// Width of the frames, so that they are there in a minute or two on two cores.
const WIDTH_PX: u32 = 448;
/// Light paths per pixel, for the same reason.
const SPP: u32 = 12;

/// Bakes a scene (the built-in one if none is named) and writes its frames. `reason` says why there is no window.
///
/// # Errors
/// If the scene cannot be loaded or a frame cannot be written, or a look is named instead of a scene.
pub fn run(scene: Option<&Path>, reason: &str, console: &mut Console) -> Result<Answer> {
    if let Some(look) = scene.filter(|path| is_look(path)).map(Path::display) {
        bail!(
            "{reason}, and {look} is a look, which lights a scene: name that scene, \
             `clerestory render SCENE --look {look} -o OUT.png`"
        );
    }
    let name = scene.map_or("the built-in gallery".into(), |path| path.display().to_string());
    console.note(&format!("{reason}: baking {name} and writing frames to {FOLDER}/ instead of opening the editor"));
    std::fs::create_dir_all(FOLDER)
        .with_context(|| format!("cannot create the folder {FOLDER}; run in a folder that can be written"))?;

    let (bake, times, options, looks) = match scene {
        Some(folder) if folder.is_dir() => images(folder, console)?,
        _ => scene_or_gallery(scene, &name, console)?,
    };
    let mut answer = baked(&bake, times, &options, console)?;

    let mut frames = Vec::new();
    for (look_name, look) in looks {
        frames.extend(write_frame(&bake, look_name, &look, console)?);
    }
    let frames: Vec<String> = frames.iter().map(|path| path.display().to_string()).collect();
    answer.words = format!(
        "{name} {}\n\nframes (display-encoded .png, linear .exr):\n  {}\n\n\
         With a display (DISPLAY or WAYLAND_DISPLAY set, and a Vulkan driver) this command opens the editor:\n\
         the picture live while you drag a light's intensity or color, spots on panels, exposure and tone curve,\n\
         a bake that refines in the background, undo, and export. `clerestory --help` lists what works without one.",
        answer.words,
        frames.join("\n  "),
    );
    merge(&mut answer.json, json!({ "frames": frames, "warnings": console.warnings() }));
    Ok(answer)
}

/// A bake, what it took, how it was asked for, and the looks of its frames.
type Baked = (Bake, BakeTimes, BakeOptions, Vec<(&'static str, Look)>);

fn scene_or_gallery(scene: Option<&Path>, name: &str, console: &mut Console) -> Result<Baked> {
    let imported = match scene {
        Some(path) => load_scene(path, &Choice::default(), console)?,
        None => import::load_bytes("gallery.glb", GALLERY).context("cannot load the built-in scene")?,
    };
    let mut options = options();
    options.view.size = imported.scene.cameras.first().map(|camera| Film::of_width(WIDTH_PX, camera));
    let view = prepare_view(imported, name, &options.view, None, console)?;
    let looks = match scene {
        Some(_) => plain_looks(&view.scene.lighting.basis),
        None => gallery_looks()?,
    };
    let job = job(view, &options, Passes::FinalOnly);
    let (bake, times) = run_with_progress(console, &options, &nothing_kept, |on_event| job.run(on_event))?;
    Ok((bake, times, options, looks))
}

/// A folder of pictures, each under one light.
fn images(folder: &Path, console: &mut Console) -> Result<Baked> {
    let options = options();
    let job = stack_job(&open_stack(folder, console)?, &options);
    job.check_memory(memory_bytes())?;
    let (bake, times) = run_with_progress(console, &options, &nothing_kept, |on_event| job.run(on_event))?;
    let looks = plain_looks(&bake.header.basis);
    Ok((bake, times, options, looks))
}

fn options() -> BakeOptions {
    let view = ViewArgs {
        of_look: SceneChoice::default(),
        viewpoint: None,
        shift: None,
        camera: None,
        size: None,
        spp: SPP,
        bounces: None,
        panels: Vec::new(),
        ies: Vec::new(),
        unitless: false,
        sun_size: None,
        variant: None,
        no_energy_compensation: false,
        sky: None,
        no_skip: None,
        seed: 0,
        threads: None,
    };
    let (sky_patches, method) = (None, Method::default());
    let (tolerance, seconds) = (40.0, None);
    let (fast, exact, no_denoise) = (true, false, false);
    let (patches, block, fresh) = (0, SIDE, true);
    BakeOptions { view, sky_patches, tolerance, seconds, fast, exact, no_denoise, patches, method, block, fresh }
}

fn gallery_looks() -> Result<Vec<(&'static str, Look)>> {
    let read = |(name, json): (&'static str, &str)| {
        let (look, _) = Look::from_json(json).with_context(|| format!("the built-in look {name} is damaged"))?;
        Ok((name, look))
    };
    GALLERY_LOOKS.into_iter().map(read).collect()
}

/// Three looks that make sense for any scene: as it is, all lamps warm, all lamps cool.
fn plain_looks(basis: &LightBasis) -> Vec<(&'static str, Look)> {
    let tinted = |kelvin: f32| {
        let mut look = Look::of_file(basis);
        for source in &basis.sources {
            look.lights.lights.entry(source.key.clone()).or_default().kelvin = Some(kelvin);
        }
        look
    };
    vec![("as-designed", Look::of_file(basis)), ("warm", tinted(2700.0)), ("cool", tinted(8000.0))]
}

fn write_frame(bake: &Bake, name: &str, look: &Look, console: &mut Console) -> Result<[PathBuf; 2]> {
    warn_of_unknown_lights(&bake.header.basis, look, console);
    let radiance = Relighter::new(bake, &look.lights, None)?.relight(&bake.header.coefficients(&look.lights))?;
    warn_of_black(&format!("the picture of {name} is"), &radiance, (&bake.header.basis, &look.lights), console);
    let paths = ["png", "exr"].map(|extension| Path::new(FOLDER).join(format!("{name}.{extension}")));
    for path in &paths {
        Picture { radiance: &radiance, layers: &[], irradiance: None, look, units: Units::of(&bake.header.basis) }
            .save(path, &ExportOptions::default())?;
    }
    Ok(paths)
}

#[cfg(test)]
mod tests {
    use clerestory_transport::emitters::Lighting;

    use super::*;

    #[test]
    fn every_light_of_the_built_in_looks_exists_in_the_gallery() {
        let scene = import::load_bytes("gallery.glb", GALLERY).unwrap().scene;
        let basis = Lighting::new(&scene, &[]).unwrap().0.basis;
        assert!(basis.sources.len() >= 12, "{} lights", basis.sources.len());
        for (name, json) in GALLERY_LOOKS {
            let (look, warnings) = Look::from_json(json).unwrap();
            assert!(warnings.is_empty(), "{name}: {warnings:?}");
            assert_eq!(look.unheeded(&basis), Vec::<String>::new(), "{name}");
        }
    }
}
