//! Free lamps of a look on the command line: as lights of a scene that is traced, or added to a picture that was baked.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use clerestory_relight::Radiance;
use clerestory_transport::arriving::ArrivingPoints;
use clerestory_transport::bake::{Bake, BakeHeader};
use clerestory_transport::camera::{Camera, Film};
use clerestory_transport::import::Choice;
use clerestory_transport::lamps::{FreeLamp, KeptProfiles, Lacking, LampWarning, PreparedLamps};
use clerestory_transport::light::LightRig;
use clerestory_transport::patches::Patches;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::scene::Scene;
use clerestory_transport::visible::{VisibleConfig, VisiblePoints};

use super::args::RelightArgs;
use super::console::Console;
use super::view::{View, import_scene, load_scene};
use crate::illuminance::AddedLux;
use crate::look::Look;
use crate::look::fade::NEW;
use crate::session::{as_baked, what_differs};
use crate::words::lacking_words;

/// Samples of a pixel that are kept at once; others take their place until there were enough.
const SAMPLES: u32 = 4;
/// Passes of each.
const ROUNDS: u32 = 2;
/// Samples of a pixel where nothing is said: what makes a soft shadow smooth.
pub(super) const DEFAULT_SAMPLES: u32 = 32;

/// The lamps of a look that shine, in a scene.
pub(super) fn prepared(
    lamps: &[FreeLamp],
    look: Option<&Path>,
    scene: &PreparedScene,
    console: &mut Console,
) -> Result<PreparedLamps> {
    let folder = look.and_then(Path::parent);
    let (lamps, warnings) = PreparedLamps::new(lamps, folder).with_context(|| cannot_shine(lamps))?;
    console.warn_all(warnings);
    Ok(lamps.in_scene(scene))
}

/// What stands before why a lamp cannot shine. A moment of a timeline may have lamps that are called otherwise than in its file.
fn cannot_shine(lamps: &[FreeLamp]) -> String {
    let is_mixed = lamps.iter().any(|lamp| lamp.key.ends_with(NEW));
    let names = if is_mixed { format!(" (`{NEW}` behind a name: of the look that comes up)") } else { String::new() };
    format!("the look has a lamp that cannot shine{names}")
}

/// What is to know of lamps that shine, such as that one aims at itself; their files are named from the root. Of those that cannot shine is
/// told elsewhere.
pub(super) fn warn_of_remarks(lamps: &[FreeLamp], console: &mut Console) {
    let mut kept = KeptProfiles::default();
    for (_, warnings) in lamps.iter().filter_map(|lamp| PreparedLamps::of(lamp, &mut kept).ok()) {
        console.warn_all(warnings.into_iter().map(LampWarning::into_words));
    }
}

/// Options that were typed and are about lamps of looks.
pub(super) fn options_of_lamps(args: &RelightArgs) -> impl Iterator<Item = &'static str> {
    let all = [("--scene", args.scene.is_some()), ("--lamp-samples", args.lamp_samples != DEFAULT_SAMPLES)];
    all.into_iter().filter_map(|(option, is_typed)| is_typed.then_some(option))
}

/// Says so where options were typed for lamps of looks that have none.
pub(super) fn warn_of_no_lamps<'a>(
    rigs: impl IntoIterator<Item = &'a LightRig>,
    typed: impl IntoIterator<Item = &'static str>,
    console: &mut Console,
) {
    if rigs.into_iter().any(|rig| !rig.lamps.is_empty()) {
        return;
    }
    for option in typed {
        console.warn(&format!("{option} changes nothing: the look has no lamps of its own"));
    }
}

/// Makes the lamps of a rig lights of a scene that nobody else has yet, in columns of their own; the rig has them no more.
pub(super) fn install(view: &mut View, rig: &mut LightRig, path: Option<&Path>, console: &mut Console) -> Result<()> {
    if rig.lamps.is_empty() {
        return Ok(());
    }
    let scene = Arc::get_mut(&mut view.scene).context("the scene is in use")?;
    let lamps = prepared(&rig.take_lamps(), path, scene, console)?;
    // What is set of a light that the scene does not have is ignored, and sets no lamp that is called so.
    rig.lights.retain(|key, _| scene.lighting.basis.source(key).is_some());
    lamps.install(scene).context("the look cannot light the scene")
}

/// What a lamp brings to a baked picture.
pub(super) struct LampLight {
    /// Name of the lamp.
    pub key: String,
    /// Its direct light, and its body where it is seen, nit.
    pub direct: Radiance,
    /// What comes straight to the surfaces that pixels see, lux; where it was asked for.
    pub arriving: Option<Radiance>,
    /// Coefficients of the patches of the bake; none without patches.
    pub of_patches: Vec<[f32; 3]>,
    /// The lamp alone, and where it shines.
    pub prepared: PreparedLamps,
    pub scene: Arc<PreparedScene>,
}

/// Whether the light that arrives at what pixels see is found as well.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Arriving {
    /// Nobody asks.
    Left,
    /// It goes with the irradiance of the bake.
    Measured,
}

impl Arriving {
    /// What is asked for of a bake: where it holds no irradiance, nothing can be.
    pub fn of(bake: &Bake, is_asked: bool) -> Arriving {
        if is_asked && bake.pixel_irradiance().is_some() { Arriving::Measured } else { Arriving::Left }
    }
}

/// What is said where irradiance has no columns of patches.
pub(super) const DIRECT_LUX: &str = "the irradiance counts the light of the look's lamps where it falls, not what surfaces make \
    of it; bake the scene again with --patches 4096 for that";

/// What lamps add to the light that arrives.
pub(super) fn added_lux(lamps: &[LampLight]) -> AddedLux {
    let mut added = AddedLux::default();
    let Some((first, others)) = lamps.split_first() else { return added };
    added.of_patches.clone_from(&first.of_patches);
    let mut straight = first.arriving.clone();
    for lamp in others {
        let more = lamp.of_patches.iter().flatten();
        added.of_patches.as_flattened_mut().iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
        if let (Some(sum), Some(more)) = (&mut straight, &lamp.arriving) {
            sum.add(more);
        }
    }
    added.straight = straight.map(Arc::new);
    added
}

impl LampLight {
    /// Of each lamp of a look that is on, whose picture was baked from a scene.
    pub fn of(
        bake: &Bake,
        look: &Look,
        (path, scene): (Option<&Path>, Option<&Path>),
        (arriving, n_samples): (Arriving, u32),
        console: &mut Console,
    ) -> Result<Vec<LampLight>> {
        let lamps = look.lights.shining_lamps();
        let Some((scene, camera)) = stage(bake, &lamps, scene, console)? else { return Ok(Vec::new()) };
        warn_of_lacking(&lamps, path, &scene, console);
        let scene = Arc::new(scene);
        let alone = |lamp: &FreeLamp| prepared(std::slice::from_ref(lamp), path, &scene, &mut *console);
        let each: Vec<PreparedLamps> = lamps.iter().map(alone).collect::<Result<_>>()?;
        let film = Film { width: bake.header.width, height: bake.header.height };
        let narrow_alpha = bake.header.patches.as_ref().map_or(0.0, Patches::narrow_alpha);
        let bounces = bake.header.config.bounces;
        let direct = direct(&scene, &camera, (film, narrow_alpha, bounces), &each, n_samples);
        let of_patches = |lamps: &PreparedLamps| {
            let patches = bake.header.patches.as_ref();
            patches.map_or_else(Vec::new, |patches| lamps.light_on_patches(&scene, patches, bounces))
        };
        let measured = match arriving {
            Arriving::Left => vec![None; each.len()],
            Arriving::Measured => {
                arriving_light(&scene, &camera, (film, bounces), &each).into_iter().map(Some).collect()
            }
        };
        let lights = lamps.iter().zip(each).zip(direct).zip(measured);
        type Of<'a> = (((&'a FreeLamp, PreparedLamps), Radiance), Option<Radiance>);
        let light = |(((lamp, prepared), direct), arriving): Of| LampLight {
            key: lamp.key.clone(),
            direct,
            arriving,
            of_patches: of_patches(&prepared),
            prepared,
            scene: scene.clone(),
        };
        Ok(lights.map(light).collect())
    }
}

/// Where lamps that shine are to be added to a baked picture: the scene of the bake and its camera; none without lamps.
pub(super) fn stage(
    bake: &Bake,
    lamps: &[FreeLamp],
    scene: Option<&Path>,
    console: &mut Console,
) -> Result<Option<(PreparedScene, Camera)>> {
    if lamps.is_empty() {
        return Ok(None);
    }
    if bake.header.basis.is_measured() {
        bail!("the look has lamps, but the bake is of pictures, which no lamp can light; bake a scene instead");
    }
    let Some(scene) = scene else {
        bail!("the look has lamps, which light the surfaces of the scene; name the scene that was baked with --scene");
    };
    if let Some(lamp) = lamps.iter().find(|lamp| bake.header.basis.source(&lamp.key).is_some()) {
        bail!("a light of the scene is called `{}`, as a lamp of the look is; give the lamp another key", lamp.key);
    }
    if bake.header.patches.is_none() {
        console.warn(
            "the transport has no patches, so the light of the look's lamps is shown where it falls, not what surfaces make \
             of it; bake the scene with --patches 4096 for that",
        );
    }
    open(&bake.header, scene, console).map(Some)
}

/// Names lamps of whose light mirrors, glass, panes and coats throw on a part that is missing in pictures of a scene, with the most that it
/// is of those of one name; the look lies there. What is wrong with a lamp is told elsewhere.
pub(crate) fn warn_of_lacking(lamps: &[FreeLamp], look: Option<&Path>, scene: &PreparedScene, console: &mut Console) {
    let folder = look.and_then(Path::parent);
    let able = |lamp: &FreeLamp| PreparedLamps::able(std::slice::from_ref(lamp), folder).0;
    let mut most: BTreeMap<String, Lacking> = BTreeMap::new();
    for (key, found) in lamps.iter().flat_map(|lamp| able(lamp).in_scene(scene).lacking(scene)) {
        let share = most.entry(key).or_default();
        share.caustic = share.caustic.max(found.caustic);
        share.mirrored = share.mirrored.max(found.mirrored);
    }
    console.warn_all(most.iter().flat_map(|(key, lacking)| lacking_words(key, lacking)).flatten());
}

/// Direct light of each of some lamps.
fn direct(
    scene: &PreparedScene,
    camera: &Camera,
    (film, narrow_alpha, bounces): (Film, f32, Option<u32>),
    lamps: &[PreparedLamps],
    n_samples: u32,
) -> Vec<Radiance> {
    let Film { width, height } = film;
    let mut sums = vec![Radiance { width, height, pixels: vec![[0.0; 3]; film.n_pixels()] }; lamps.len()];
    for first in (0..n_samples).step_by(SAMPLES as usize) {
        let samples = SAMPLES.min(n_samples - first);
        let config = VisibleConfig { samples, first, narrow_alpha, bounces, ..VisibleConfig::default() };
        let Some(points) = VisiblePoints::new(scene, camera, film, config, &|| false) else { continue };
        for (sum, lamps) in sums.iter_mut().zip(lamps) {
            for picture in (0..samples * ROUNDS).filter_map(|pass| points.direct(scene, lamps, pass, &|| false)) {
                for (pixel, rgb) in sum.pixels.iter_mut().zip(picture) {
                    (0..3).for_each(|c| pixel[c] += rgb[c] / (n_samples * ROUNDS) as f32);
                }
            }
        }
    }
    sums
}

/// What each of some lamps sends straight to the surfaces that pixels see, lux.
fn arriving_light(
    scene: &PreparedScene,
    camera: &Camera,
    (film, bounces): (Film, Option<u32>),
    lamps: &[PreparedLamps],
) -> Vec<Radiance> {
    let n_samples = SAMPLES * ROUNDS;
    let mut sums = vec![Radiance::new(film.width, film.height); lamps.len()];
    for points in (0..n_samples).filter_map(|nth| ArrivingPoints::new(scene, camera, film, nth, &|| false)) {
        for (sum, lamps) in sums.iter_mut().zip(lamps) {
            let pass = points.irradiance(scene, lamps, bounces, &|| false).unwrap_or_default();
            let pairs = sum.pixels.as_flattened_mut().iter_mut().zip(pass.as_flattened());
            pairs.for_each(|(sum, lux)| *sum += lux / n_samples as f32);
        }
    }
    sums
}

/// The scene of a bake and its camera. Its own lights may be others by now: lamps of a look need its surfaces alone.
pub(super) fn open(header: &BakeHeader, path: &Path, console: &mut Console) -> Result<(PreparedScene, Camera)> {
    let imported = load_scene(path, &header.skips.into(), console)?;
    let baked_of = |mut scene: Scene| as_baked(header, &mut scene).map(|(camera, _)| (scene, camera));
    let mut found = baked_of(imported.scene);
    for variant in imported.report.variants {
        if found.is_none() {
            let choice = Choice { skips: header.skips, variant: Some(variant) };
            found = baked_of(import_scene(path, &choice)?.scene);
        }
    }
    let Some((scene, camera)) = found else {
        bail!(
            "{} is not the scene that was baked: {}; name the same file, or bake again",
            path.display(),
            what_differs(header)
        );
    };
    let (scene, _) = PreparedScene::with_skips(scene, &[], None, header.skips)
        .with_context(|| format!("cannot prepare the scene {}", path.display()))?;
    Ok((scene, camera))
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use super::*;
    use crate::cli::interrupt::Interrupt;
    use crate::look::fade::fade;
    use crate::support::prepared_room;

    #[test]
    fn a_setting_of_no_light_of_the_scene_sets_no_lamp_that_is_called_so() {
        let scene = Arc::new(prepared_room());
        let (camera, film) = (scene.scene.cameras[0].clone(), Film { width: 4, height: 3 });
        let mut view = View { scene, camera, film };
        let json = r#"{"clerestory": 1, "lights": {"bulb": {"muted": true}, "lamp": {"intensity": 2}},
            "lamps": [{"key": "bulb", "type": "point", "position": [0, 0.2, 0], "strength": 5, "unit": "cd"}]}"#;
        let mut rig = Look::from_json(json).unwrap().0.lights;
        let (mut stdout, mut stderr) = (Vec::new(), Vec::new());
        let mut console = Console::new(Instant::now(), &mut stdout, &mut stderr, Interrupt::never());
        install(&mut view, &mut rig, None, &mut console).unwrap();
        let basis = &view.scene.lighting.basis;
        let lit = basis.project(&rig)[basis.source("bulb").unwrap().columns.start as usize];
        assert!(lit.iter().all(|candela| (candela - 5.0).abs() < 1e-4), "as `relight` adds it: {lit:?}");
        assert_eq!(rig.setting("lamp").intensity, 2.0);
    }

    #[test]
    fn a_lamp_that_two_looks_have_is_told_to_be_of_the_one_that_comes_up() {
        let of = |kind: &str| {
            let lamp = r#"{"key": "L", KIND, "position": [0, 1, 0], "strength": 5}"#.replace("KIND", kind);
            Look::from_json(&format!("{{\"clerestory\": 1, \"lamps\": [{lamp}]}}")).unwrap().0
        };
        let [bulb, gone] = [of(r#""type": "point""#), of(r#""type": "ies", "file": "gone.ies", "aim": [0, 0, 0]"#)];
        let words = |look: &Look| cannot_shine(&look.lights.lamps);
        assert!(words(&fade(&bulb, &gone, 0.5, None)).contains("of the look that comes up"));
        assert_eq!(words(&gone), "the look has a lamp that cannot shine");
    }
}
