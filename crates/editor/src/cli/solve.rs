//! `clerestory solve`: the lights that come closest to wishes, as a look.

use std::borrow::Cow;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Result, ensure};
use clerestory_relight::Radiance;
use clerestory_transport::bake::Bake;
use clerestory_transport::camera::Film;
use clerestory_transport::prepared::PreparedScene;
use glam::Vec3;
use serde_json::json;

use super::args::SolveArgs;
use super::bake::merge;
use super::console::{Answer, Console};
use super::lamps::{Arriving, DEFAULT_SAMPLES, LampLight, open};
use super::view::{files_of_look, load_bake, load_look, or_of_file, spare_files, spare_scene, warn_of_unknown_lights};
use crate::look::{Look, Units, is_look, named_scene};
use crate::marks::{Framing, Seen};
use crate::output::{PendingFile, is_same_file, spare_inputs, spare_others};
use crate::solve::kept::{Here, Pictures};
use crate::solve::parse::{self, Surroundings};
use crate::solve::{
    AtPixel, Freedom, LampColumn, Place, Request, Scene, TargetPicture, Wish, at_point, may_change, solve,
};
use crate::words::in_words;

pub(super) fn run(args: &SolveArgs, console: &mut Console) -> Result<Answer> {
    let mut look = load_look(args.look.as_deref(), console)?;
    let text = args.wishes.as_deref().map(parse::text_of).transpose()?;
    let wishes = args.wishes.as_deref().zip(text.as_deref());
    spare(args, wishes, &look)?;
    let folder = args.look.as_deref().and_then(Path::parent).unwrap_or(Path::new(""));
    let place = PendingFile::create(&args.output)?;
    let bake = load_bake(&args.transport)?;
    look = or_of_file(look, args.look.as_deref(), &bake.header.basis);
    warn_of_unknown_lights(&bake.header.basis, &look, console);
    let lamps = lamps(args, &bake, &look, console)?;
    look.resolve(folder);
    let scene = args.scene.as_deref().map(|path| open(&bake.header, path, console)).transpose()?;
    let film = Film { width: bake.header.width, height: bake.header.height };
    let camera = scene.as_ref().map(|(_, camera)| camera.clone()).or_else(|| bake.header.view.clone());
    let scene = scene.map(|(scene, camera)| {
        let seen = Arc::new(Seen::new(&scene, &camera, film));
        (scene, seen)
    });
    let wished = if wishes.is_some() || args.picture.is_some() {
        wished(args, wishes, &bake, scene.as_ref())?
    } else {
        wished_in(&look, &bake, Framing { film, camera }, &lamps, console)?
    };
    let request = as_typed(wished, args)?;
    let seen = scene.map(|(_, seen)| seen);
    let solved = solve(&Scene { bake, rig: look.lights.clone(), lamps, seen }, &request)?;
    console.warn_all(solved.notes.iter().map(|note| look.renamed(note)));
    look.lights = solved.rig.clone();
    let scene = args.scene.clone().or_else(|| named_scene(args.look.as_deref()?));
    place.commit(|writer| Ok(writer.write_all(look.json_for(&args.output, scene.as_deref()).as_bytes())?))?;
    let output = args.output.display().to_string();
    let mut json = json!({ "output": output, "warnings": console.warnings() });
    merge(&mut json, solved.json());
    Ok(Answer { json, words: format!("{}\n{output}", solved.words(&look)) })
}

/// Refuses an output that would overwrite what is read. The look itself may become what was found, but nothing that it names.
fn spare(args: &SolveArgs, wishes: Option<(&Path, &str)>, look: &Look) -> Result<()> {
    let output = args.output.as_path();
    let inputs =
        [("transport", Some(&args.transport)), ("wishes", args.wishes.as_ref()), ("picture", args.picture.as_ref())];
    spare_inputs(output, inputs.into_iter().filter_map(|(what, path)| Some((what, path?.as_path()))))?;
    args.scene.iter().try_for_each(|scene| spare_scene(output, scene))?;
    spare_files(output, &files_of_look(args.look.as_deref(), look))?;
    let of_wishes = wishes.map(|(path, text)| parse::pictures(path, text)).transpose()?.unwrap_or_default();
    spare_inputs(output, of_wishes.iter().map(|file| ("picture", file.as_path())))?;
    // The look may be called as its user likes.
    match &args.look {
        Some(look) if is_same_file(output, look) => Ok(()),
        _ => spare_others(output, &["look"], is_look),
    }
}

/// The wishes of the file, with its text, and of the command line.
fn wished(
    args: &SolveArgs,
    wishes: Option<(&Path, &str)>,
    bake: &Bake,
    scene: Option<&(PreparedScene, Arc<Seen>)>,
) -> Result<Request> {
    let surroundings = Surroundings { bake, seen: scene.map(|(scene, seen)| (scene, seen.as_ref())) };
    let mut request = match wishes {
        Some((path, text)) => parse::read(path, text, &surroundings)?,
        None => Request::default(),
    };
    if let Some(path) = &args.picture {
        let target = parse::picture(path, args.exposure, args.tone)?;
        let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        request.wishes.push(Wish { name, place: Place::Whole, target, weight: 1.0 });
    }
    Ok(request)
}

/// The wishes of the look, as far as they fit the bake; why others do not is told.
fn wished_in(
    look: &Look,
    bake: &Bake,
    framing: Framing,
    lamps: &[LampColumn],
    console: &mut Console,
) -> Result<Request> {
    let read = |file: &str| TargetPicture::read(Path::new(file)).map(Arc::new).map_err(|error| in_words(&error));
    let pictures: Pictures = look.wishes.files().map(|file| (file.to_owned(), read(file))).collect();
    let here = Here {
        framing: Some(framing),
        grids: bake.grids().map(|(set, grid)| (set, grid.name.clone())).collect(),
        units: Units::of(&bake.header.basis),
        has_illuminance: bake.pixel_irradiance().is_some(),
        pictures: Cow::Owned(pictures),
    };
    for entry in &look.wishes.list {
        if let Some(why) = here.misfit(entry) {
            console.warn(&format!("the wish `{}` is left out: {why}", entry.name));
        }
    }
    let is_lamp = |key: &str| lamps.iter().any(|lamp| lamp.key == key);
    Ok(here.request(&look.wishes, &may_change(&bake.header.basis, &look.lights, is_lamp)))
}

/// The same with what was typed.
fn as_typed(mut request: Request, args: &SolveArgs) -> Result<Request> {
    if !args.lights.is_empty() {
        request.lights = Some(args.lights.clone());
    }
    request.bounds = args.factor.unwrap_or(request.bounds);
    request.freedom = args.colors.map_or(request.freedom, |most_saturation| Freedom::Color { most_saturation });
    request.keep = args.keep.unwrap_or(request.keep);
    request.pull = args.pull.unwrap_or(request.pull);
    parse::check(&request)?;
    ensure!(
        !request.wishes.is_empty(),
        "there is nothing to solve for; name a file with --wishes, a picture with --match, or a --look with wishes for this view"
    );
    Ok(request)
}

/// The light of the look's lamps, where the scene is named.
fn lamps(args: &SolveArgs, bake: &Bake, look: &Look, console: &mut Console) -> Result<Vec<LampColumn>> {
    let Some(scene) = args.scene.as_deref() else {
        if !look.lights.shining_lamps().is_empty() {
            console.warn("the look has lamps of its own, whose light no wish counts; name the scene with --scene");
        }
        return Ok(Vec::new());
    };
    let quality = (Arriving::of(bake, true), DEFAULT_SAMPLES);
    let lights = LampLight::of(bake, look, (args.look.as_deref(), Some(scene)), quality, console)?;
    let column = |light: LampLight| LampColumn {
        key: light.key,
        of_patches: light.of_patches.into_iter().map(Vec3::from).collect(),
        direct: at_pixel(light.direct),
        arriving: light.arriving.map(at_pixel),
        at_point: at_point(light.scene, light.prepared, bake.header.config.bounces),
    };
    Ok(lights.into_iter().map(column).collect())
}

/// A picture as something that can be asked pixel by pixel.
fn at_pixel(picture: Radiance) -> AtPixel {
    Arc::new(move |pixel| picture.pixels.get(pixel as usize).map_or(Vec3::ZERO, |rgb| Vec3::from(*rgb)))
}
