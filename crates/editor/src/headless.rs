//! What the bare command does without a display: bake, relight under three looks or those of a file, write frames, say so.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use clerestory_nystrom::rivals::Method;
use clerestory_transport::bake::{Bake, BakeJob, Passes, SIDE};
use clerestory_transport::basis::LightBasis;
use clerestory_transport::camera::Film;
use clerestory_transport::import::{self, Choice};
use clerestory_transport::irradiance::IrradianceRows;
use clerestory_transport::lamps::FreeLamp;
use serde_json::json;

use crate::action::is_transport;
use crate::app::without_window;
use crate::cli::args::{BakeOptions, ViewArgs};
use crate::cli::bake::{BakeTimes, baked, job, merge, open_stack, run_stack, run_with_progress};
use crate::cli::lamps::warn_of_lacking;
use crate::cli::view::{
    files_of_look, load_look, load_scene, prepare_view, requested_sky, spare_files, spare_scene_by_all, warn_of_black,
    warn_of_unknown_lights,
};
use crate::cli::{Answer, Console, nothing_kept};
use crate::export::{ExportOptions, ImageFormat, Picture};
use crate::look::lamps::resolve;
use crate::look::scene::SceneChoice;
use crate::look::snapshot::Snapshot;
use crate::look::{Look, Units, numbered_name};
use crate::output::spare_inputs;
use crate::session::Source;
use crate::session::lamps::LampView;
use crate::stills::{Size, Stills, Subject};

/// The built-in scene, a gallery with daylight high in the wall.
pub const GALLERY: &[u8] = include_bytes!("../../../assets/scenes/gallery.glb");

/// Looks of the built-in scene by the names of their frames.
pub const GALLERY_LOOKS: [(&str, &str); 3] = [
    ("as-designed", include_str!("../../../assets/looks/as-designed.look")),
    ("evening", include_str!("../../../assets/looks/evening.look")),
    ("exhibition", include_str!("../../../assets/looks/exhibition.look")),
];

/// Three looks that make sense for any scene: as it is, all lamps warm, all lamps cool. By name and kelvin.
const PLAIN_LOOKS: [(&str, Option<f32>); 3] = [("as-designed", None), ("warm", Some(2700.0)), ("cool", Some(8000.0))];

/// Folder of the frames, in the current one.
const FOLDER: &str = "frames";
/// Width of the frames, so that they are there in a minute or two on two cores.
const WIDTH_PX: u32 = 448;
/// Light paths per pixel, for the same reason.
const SPP: u32 = 12;
/// Letters of the name of a look that its frame takes over: none is too long for a file then.
const MOST_LETTERS: usize = 60;
/// Said where lamps light frames; patches would take longer than frames are to be waited for.
const DIRECT_ONLY: &str = "frames show the light of the look's lamps where it falls, not what surfaces make of it; `bake` with \
    --patches 4096 and `relight` with --scene for that";

/// A look that is to light the frames, and where it lies.
struct LookFile {
    path: PathBuf,
    look: Look,
}

/// Bakes a scene (the built-in one if none is named) and writes its frames; of a look that is named instead under what that file has,
/// and of the scene that the look was saved for, or that was open last. `reason` says why there is no window.
///
/// # Errors
/// If the scene or the look cannot be loaded, is a bake, or a frame cannot be written.
pub fn run(open: Option<&Path>, reason: &str, console: &mut Console) -> Result<Answer> {
    let (source, look) = without_window(open.map(Path::to_path_buf));
    let scene = if let Source::File(path) = source { Some(path) } else { None };
    let name = scene.as_ref().map_or("the built-in gallery".into(), |path| path.display().to_string());
    refuse_bake(scene.as_deref(), look.as_deref(), reason)?;
    let under = look.as_ref().map_or_else(String::new, |look| under_words(scene.as_deref(), look));
    console
        .note(&format!("{reason}: baking {name}{under} and writing frames to {FOLDER}/ instead of opening the editor"));
    std::fs::create_dir_all(FOLDER)
        .with_context(|| format!("cannot create the folder {FOLDER}; run in a folder that can be written"))?;

    let look = look.map(|path| read_look(path, console)).transpose()?;
    let Baked { bake, times, options, looks, view } = match scene.as_deref() {
        Some(folder) if folder.is_dir() => images(folder, look.as_ref(), console)?,
        scene => scene_or_gallery(scene, &name, look.as_ref(), console)?,
    };
    let mut answer = baked(&bake, times, &options, console)?;

    let frames = write_frames(Subject { bake, view }, &looks, console)?;
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

/// Says of what is baked already how it is lit.
fn refuse_bake(scene: Option<&Path>, look: Option<&Path>, reason: &str) -> Result<()> {
    let Some(bake) = scene.filter(|path| is_transport(path)).map(Path::display) else { return Ok(()) };
    match look.map(Path::display) {
        Some(look) => bail!(
            "{bake}, which goes with the look or was open last in the editor, is baked already; `clerestory relight {bake} --look {look} -o OUT.png` lights it"
        ),
        None => bail!(
            "{reason}, and {bake} is baked already; `clerestory relight {bake} -o OUT.png` lights it, with --look FILE.look in another way"
        ),
    }
}

/// Why a scene is the one that a look is shown with.
fn under_words(scene: Option<&Path>, look: &Path) -> String {
    let why = scene.map_or(
        "as no scene was open in the editor before",
        |_| "which goes with the look or was open last in the editor",
    );
    format!(", {why}, under {}", look.display())
}

/// Reads a look for its frames, which must not take the places of its own files.
fn read_look(path: PathBuf, console: &mut Console) -> Result<LookFile> {
    let mut look = load_look(Some(&path), console)?;
    let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
    look.rigs_mut().for_each(|rig| console.warn_all(resolve(&mut rig.lamps, &folder)));
    let mut read = files_of_look(Some(&path), &look);
    read.push(("look", path.clone()));
    let file = LookFile { path, look };
    for (name, _) in looks_of(&file) {
        frame_places(&name).iter().try_for_each(|place| spare_files(place, &read))?;
    }
    Ok(file)
}

/// The looks of a file by the names of their frames: those that were kept, and what it shows where that is none of them.
fn looks_of(LookFile { path, look: document }: &LookFile) -> Vec<(String, Look)> {
    let is_shown = |kept: &Snapshot| (&kept.lights, &kept.display) == (&document.lights, &document.display);
    let stem = path.file_stem().map_or_else(|| "look".into(), |stem| stem.to_string_lossy().into_owned());
    let present = (!document.snapshots.iter().any(is_shown)).then(|| (stem, document.present()));
    let kept = document.snapshots.iter().map(|kept| (kept.name.clone(), kept.look()));
    let mut looks: Vec<(String, Look)> = Vec::new();
    for (name, look) in present.into_iter().chain(kept) {
        let look = Look { names: document.names.clone(), scene: document.scene.clone(), ..look };
        looks.push((frame_name(&name, &looks), look));
    }
    looks
}

/// The name of a look as that of a file which no other look has, also where capital letters do not count.
fn frame_name(name: &str, others: &[(String, Look)]) -> String {
    let letter = |c: char| if c.is_alphanumeric() || " -_".contains(c) { c } else { '-' };
    let name: String = name.chars().take(MOST_LETTERS).map(letter).collect();
    let name = if name.trim().is_empty() { "look" } else { name.trim() };
    let is_taken = |name: &str| others.iter().any(|(other, _)| other.to_lowercase() == name.to_lowercase());
    if is_taken(name) { numbered_name(name, is_taken) } else { name.to_owned() }
}

/// The files of a frame: as it is shown, and its light.
fn frame_places(name: &str) -> [PathBuf; 2] {
    ["png", "exr"].map(|extension| Path::new(FOLDER).join(format!("{name}.{extension}")))
}

/// A bake, what it took, how it was asked for, the looks of its frames, and where their lamps shine.
struct Baked {
    bake: Bake,
    times: BakeTimes,
    options: BakeOptions,
    looks: Vec<(String, Look)>,
    view: Option<LampView>,
}

fn scene_or_gallery(scene: Option<&Path>, name: &str, file: Option<&LookFile>, console: &mut Console) -> Result<Baked> {
    let imported = match scene {
        Some(path) => load_scene(path, &Choice::default(), console)?,
        None => import::load_bytes("gallery.glb", GALLERY).context("cannot load the built-in scene")?,
    };
    let document = file.map_or_else(Look::default, |file| file.look.clone());
    let mut options = options();
    options.view = options.view.as_in(&document);
    options.view.size = imported.scene.cameras.first().map(|camera| Film::of_width(WIDTH_PX, camera));
    let sky = document.rigs().filter_map(|rig| rig.sky.as_ref()).find(|sky| sky.names_a_sky());
    let sky = requested_sky(&options.view, sky, options.sky_form(&document), console)?;
    let view = prepare_view(imported, name, &options.view, sky.as_ref(), console)?;
    let basis = &view.scene.lighting.basis;
    let mut looks = match (file, scene) {
        (Some(file), _) => looks_of(file),
        (None, Some(_)) => plain_looks(basis),
        (None, None) => gallery_looks()?,
    };
    let places: Vec<_> = looks.iter().flat_map(|(name, _)| frame_places(name)).collect();
    scene.iter().try_for_each(|scene| spare_scene_by_all(&places, scene))?;
    heed(basis, &mut looks, console);
    let lamps = lamps_of(&looks);
    if !lamps.is_empty() {
        console.warn(DIRECT_ONLY);
    }
    warn_of_lacking(&lamps, file.map(|file| file.path.as_path()), &view.scene, console);
    let shows_lux = looks.iter().any(|(_, look)| look.shows_irradiance(ImageFormat::Png));
    let irradiance = if shows_lux { vec![IrradianceRows::Pixels] } else { Vec::new() };
    let (scene, camera, film) = (view.scene.clone(), view.camera.clone(), view.film);
    let job = BakeJob { irradiance, ..job(view, &options, Passes::FinalOnly) };
    let (bake, times) = run_with_progress(console, &options, &nothing_kept, |on_event| job.run(on_event))?;
    let (patches, measures) = (bake.header.patches.clone(), bake.pixel_irradiance().is_some());
    let bounces = bake.header.config.bounces;
    let view = LampView { scene, camera, film, patches, measures, bounces, device: None };
    Ok(Baked { bake, times, options, looks, view: Some(view) })
}

/// A folder of pictures, each under one light.
fn images(folder: &Path, file: Option<&LookFile>, console: &mut Console) -> Result<Baked> {
    let of_file = file.map(looks_of);
    if of_file.as_ref().is_some_and(|looks| !lamps_of(looks).is_empty()) {
        let folder = folder.display();
        bail!(
            "{folder} goes with the look or was open last in the editor, and no lamp of the look can light its pictures; mute them, or open a scene"
        );
    }
    let options = options();
    let stack = open_stack(folder, console)?;
    let names: Vec<&str> = match &of_file {
        Some(looks) => looks.iter().map(|(name, _)| name.as_str()).collect(),
        None => PLAIN_LOOKS.map(|(name, _)| name).into(),
    };
    let pictures = || stack.images.iter().map(|image| ("picture", image.path.as_path()));
    names.into_iter().flat_map(frame_places).try_for_each(|place| spare_inputs(&place, pictures()))?;
    let (bake, times) =
        run_stack(&stack, &options, &nothing_kept, console, |surveyed, on_event| surveyed.run(on_event))?;
    let mut looks = of_file.unwrap_or_else(|| plain_looks(&bake.header.basis));
    heed(&bake.header.basis, &mut looks, console);
    Ok(Baked { bake, times, options, looks, view: None })
}

/// Says what of looks means nothing here; lamps that are called as lights of the scene are left out.
fn heed(basis: &LightBasis, looks: &mut [(String, Look)], console: &mut Console) {
    for (_, look) in looks {
        warn_of_unknown_lights(basis, look, console);
        look.lights.lamps.retain(|lamp| basis.source(&lamp.key).is_none());
    }
}

/// The free lamps of looks that shine.
fn lamps_of(looks: &[(String, Look)]) -> Vec<FreeLamp> {
    looks.iter().flat_map(|(_, look)| look.lights.shining_lamps()).collect()
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

fn gallery_looks() -> Result<Vec<(String, Look)>> {
    let read = |(name, json): (&'static str, &str)| {
        let (look, _) = Look::from_json(json).with_context(|| format!("the built-in look {name} is damaged"))?;
        Ok((name.to_owned(), look))
    };
    GALLERY_LOOKS.into_iter().map(read).collect()
}

/// The plain looks with the lights of a basis.
fn plain_looks(basis: &LightBasis) -> Vec<(String, Look)> {
    let tinted = |kelvin: f32| {
        let mut look = Look::of_file(basis);
        for source in &basis.sources {
            look.lights.lights.entry(source.key.clone()).or_default().kelvin = Some(kelvin);
        }
        look
    };
    let look = |kelvin: Option<f32>| kelvin.map_or_else(|| Look::of_file(basis), tinted);
    PLAIN_LOOKS.map(|(name, kelvin)| (name.to_owned(), look(kelvin))).into()
}

fn write_frames(subject: Subject, looks: &[(String, Look)], console: &mut Console) -> Result<Vec<PathBuf>> {
    let interrupt = console.interrupt.heeded()?;
    let (stop, stopped) = (|| interrupt.came(), || interrupt.stopped("frames that are there are whole".into()));
    let header = subject.bake.header.clone();
    let (basis, mut stills) = (&header.basis, Stills::new(Arc::new(subject), None));
    let mut frames = Vec::new();
    for (name, look) in looks {
        let radiance = stills.picture(look, Size::Whole, &stop)?.ok_or_else(stopped)?;
        let lux = match look.shows_irradiance(ImageFormat::Png) {
            true => stills.irradiance(look, Size::Whole, &stop)?,
            false => None,
        };
        warn_of_black(&format!("the picture of {name} is"), &radiance, (basis, &look.lights), console);
        let [png, exr] = frame_places(name);
        for (path, irradiance) in [(png, lux.as_ref()), (exr, None)] {
            let picture = Picture { radiance: &radiance, layers: &[], irradiance, look, units: Units::of(basis) };
            picture.save(&path, &ExportOptions::default())?;
            frames.push(path);
        }
    }
    Ok(frames)
}

#[cfg(test)]
mod tests {
    use clerestory_transport::emitters::Lighting;

    use super::*;

    #[test]
    fn looks_of_a_file_get_frames_of_their_own() {
        let mut look = Look::default();
        for (name, intensity) in [("Day / north", 0.5), ("day - north", 0.7), ("..", 0.9)] {
            look.lights.lights.entry("lamp".into()).or_default().intensity = intensity;
            look.keep(name);
        }
        let names = |look: &Look| -> Vec<String> {
            let file = LookFile { path: "looks/v1.2.look".into(), look: look.clone() };
            looks_of(&file).into_iter().map(|(name, _)| name).collect()
        };
        assert_eq!(names(&look), ["Day - north", "day - north 1", "--"], "what it shows was kept");
        look.lights.lights.clear();
        assert_eq!(names(&look)[0], "v1-2");
    }

    #[test]
    fn the_gallery_takes_little_of_the_program() {
        let n_bytes = std::hint::black_box(GALLERY).len();
        assert!(n_bytes < 6_000_000, "{n_bytes}");
    }

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
