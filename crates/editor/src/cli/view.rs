//! From what was typed to what can be traced: scene, camera, film and look.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use clerestory_relight::Radiance;
use clerestory_transport::archive;
use clerestory_transport::bake::Bake;
use clerestory_transport::basis::LightBasis;
use clerestory_transport::camera::{Camera, Film};
use clerestory_transport::emitters::{Lighting, LightingError, PanelRequest, SkyRequest};
use clerestory_transport::import::{self, Choice, Imported};
use clerestory_transport::lamp_units::{LampUnits, assume_unitless};
use clerestory_transport::lamps::LampShape;
use clerestory_transport::light::LightRig;
use clerestory_transport::photometry::assign;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::scene::{FacetScattering, Scene};
use clerestory_transport::sky::{SkyForm, SkySetting};
use clerestory_transport::stop::Stop;

use super::args::{IesRequest, ViewArgs};
use super::console::Console;
use crate::action::is_transport;
use crate::black::{black_words, is_black};
use crate::look::scene::SceneChoice;
use crate::look::{Look, named_scene, sky};
use crate::output::spare_inputs;
use crate::platform::memory_bytes;

/// Width of a picture whose size was not given.
const DEFAULT_WIDTH_PX: u32 = 960;

/// One picture of one scene.
pub(crate) struct View {
    pub scene: Arc<PreparedScene>,
    pub camera: Camera,
    pub film: Film,
}

/// Loads a scene and says what was left behind; all of it is kept for the answer.
pub(crate) fn load_scene(path: &Path, choice: &Choice, console: &mut Console) -> Result<Imported> {
    let imported = import_scene(path, choice)?;
    console.warn_all(unsupported_words(&imported, path));
    console.warn_all(fault_words(&imported, path));
    Ok(imported)
}

/// Reads a bake that this machine has memory for.
pub(super) fn load_bake(path: &Path) -> Result<Bake> {
    archive::read_within(memory_bytes(), path).with_context(|| format!("cannot read the transport {}", path.display()))
}

/// Loads a scene.
pub(super) fn import_scene(path: &Path, choice: &Choice) -> Result<Imported> {
    import::load_chosen(path, choice, &Stop::default())
        .with_context(|| format!("cannot load the scene {}", path.display()))
}

/// What of a scene is not shown.
pub(super) fn unsupported_words(imported: &Imported, path: &Path) -> Vec<String> {
    let words = |what: &String| format!("{}: not supported and left out: {what}", path.display());
    imported.report.unsupported.iter().map(words).collect()
}

/// What is wrong with a scene, and what was made up for it.
pub(super) fn fault_words(imported: &Imported, path: &Path) -> Vec<String> {
    let made = imported.report.made_camera.then_some("it has no perspective camera; one was made");
    let faults = imported.report.warnings.iter().map(String::as_str).chain(made);
    faults.map(|what| format!("{}: {what}", path.display())).collect()
}

/// The files that a view reads beside its scene.
pub(super) fn inputs_of(args: &ViewArgs) -> impl Iterator<Item = (&'static str, &Path)> {
    let sky = args.sky.as_ref().and_then(|sky| sky.file.as_deref());
    let measured = args.ies.iter().map(|request| ("measured distribution", request.file.as_path()));
    sky.map(|file| ("sky", Path::new(file))).into_iter().chain(measured)
}

/// Refuses an output that would overwrite a scene or a file that it names.
pub(crate) fn spare_scene(output: &Path, scene: &Path) -> Result<()> {
    spare_scene_by_all(&[output], scene)
}

/// The same of several outputs, for which the scene is read once.
pub(crate) fn spare_scene_by_all<P: AsRef<Path>>(outputs: &[P], scene: &Path) -> Result<()> {
    let outputs = || outputs.iter().map(AsRef::as_ref);
    outputs().try_for_each(|output| spare_inputs(output, [("scene", scene)]))?;
    // Where nothing is, nothing is overwritten, and the scene need not be read for that.
    let mut existing = outputs().filter(|output| output.exists()).peekable();
    if existing.peek().is_none() {
        return Ok(());
    }
    let files = files_of_scene(scene);
    existing.try_for_each(|output| spare_files(output, &files))
}

/// The files that a scene names, and what they are called.
pub(super) fn files_of_scene(scene: &Path) -> Vec<(&'static str, PathBuf)> {
    import::named_files(scene).into_iter().map(|file| ("file of the scene", file)).collect()
}

/// Refuses an output that would overwrite a look or a file that it names.
pub(crate) fn spare_look(output: &Path, path: Option<&Path>, look: &Look) -> Result<()> {
    let Some(path) = path else { return Ok(()) };
    spare_inputs(output, [("look", path)])?;
    spare_files(output, &files_of_look(Some(path), look))
}

/// Refuses an output that would overwrite one of some files.
pub(crate) fn spare_files(output: &Path, files: &[(&'static str, PathBuf)]) -> Result<()> {
    spare_inputs(output, files.iter().map(|(what, file)| (*what, file.as_path())))
}

/// The files that a look names, and what they are called: its scene, its skies, what its lamps are measured by, and pictures to match.
pub(crate) fn files_of_look(path: Option<&Path>, look: &Look) -> Vec<(&'static str, PathBuf)> {
    // A bake that the look was saved with may be made anew under it.
    let scene = path.and_then(named_scene).filter(|scene| !is_transport(scene));
    let folder = path.and_then(Path::parent).unwrap_or(Path::new(""));
    let skies = look.rigs().filter_map(|rig| rig.sky.as_ref()?.file.as_deref());
    let skies = skies.map(|file| ("sky", folder.join(file)));
    let lamps = look.rigs().flat_map(|rig| &rig.lamps);
    let profiles = lamps.filter_map(|lamp| match &lamp.shape {
        LampShape::Profile { file } => Some(("measured distribution", folder.join(file))),
        _ => None,
    });
    let pictures = look.wishes.files().map(|file| ("picture", folder.join(file)));
    scene.map(|scene| ("scene", scene)).into_iter().chain(skies).chain(profiles).chain(pictures).collect()
}

/// Opens a scene for tracing under a sky, if any.
pub(crate) fn open_view(path: &Path, args: &ViewArgs, sky: Option<&SkyRequest>, console: &mut Console) -> Result<View> {
    let imported = load_scene(path, &args.import_choice(), console)?;
    prepare_view(imported, &path.display().to_string(), args, sky, console)
}

/// The sky that was typed, with what a look says of it: the look's own wins, else it turns and dims the typed one.
pub(crate) fn requested_sky(
    args: &ViewArgs,
    look: Option<&SkySetting>,
    form: SkyForm,
    console: &mut Console,
) -> Result<Option<SkyRequest>> {
    let mut typed = args.sky.clone();
    match &mut typed {
        Some(_) if look.is_some_and(SkySetting::names_a_sky) => {
            console.warn("--sky is left out: the look has a sky of its own, which counts");
        }
        Some(typed) => console.warn_all(sky::load(typed, Path::new("")).context("cannot use --sky")?),
        None => {}
    }
    let typed = typed.and_then(|typed| typed.light(None));
    let light = look.map_or_else(|| typed.clone(), |look| look.light(typed.as_ref()));
    Ok(light.map(|light| SkyRequest { light, form }))
}

/// Says so where a sky that is not there was asked for in patches.
pub(super) fn warn_of_no_sky(sky: Option<&SkyRequest>, patches: Option<SkyForm>, console: &mut Console) {
    if sky.is_none() && patches.is_some() {
        console.warn("--sky-patches changes nothing: there is no sky; name one with --sky or in the look");
    }
}

/// Chooses camera and film and builds what tracing needs.
pub(crate) fn prepare_view(
    imported: Imported,
    name: &str,
    args: &ViewArgs,
    sky: Option<&SkyRequest>,
    console: &mut Console,
) -> Result<View> {
    let mut scene = imported.scene;
    if scene.mesh.triangles.is_empty() {
        bail!("{name} has no triangles, so there is nothing to see; give a scene with surfaces");
    }
    change_lamps(&mut scene, args, console)?;
    if args.no_energy_compensation {
        scene.set_facet_scattering(FacetScattering::Single);
    }
    let camera = pick_camera(&scene.cameras, args.camera.as_deref()).with_context(|| format!("cannot see {name}"))?;
    let mut camera = args.viewpoint.map_or_else(|| camera.clone(), |viewpoint| viewpoint.camera(camera));
    camera.shift = args.shift.unwrap_or(camera.shift);
    let film = args.size.unwrap_or_else(|| Film::of_width(DEFAULT_WIDTH_PX, &camera));
    let panels = panels(&scene, &args.panels, &args.of_look, console);
    let (scene, warnings) = PreparedScene::with_skips(scene, &panels, sky, args.skips())
        .with_context(|| format!("cannot prepare the scene {name}"))?;
    console.warn_all(warnings);
    console.warn_all(scene.warn_of_backs(&camera));
    Ok(View { scene: Arc::new(scene), camera, film })
}

/// The panels that were typed, and those that the look makes of other lights. What it cannot make of this scene is told and left
/// out: it may be a look of another one.
pub(super) fn panels(
    scene: &Scene,
    typed: &[PanelRequest],
    of_look: &SceneChoice,
    console: &mut Console,
) -> Vec<PanelRequest> {
    let mut panels = typed.to_vec();
    for (node, resolution) in &of_look.panels {
        panels.push(PanelRequest { node: node.clone(), resolution: *resolution });
        let Err(error) = Lighting::new(scene, &panels) else { continue };
        panels.pop();
        match error {
            // What is typed wins; what no light is called is told with all that the look sets without effect.
            LightingError::Twice { .. } | LightingError::UnknownPanelNode { .. } => {}
            error => console.warn(&format!("a panel of the look is left out: {error}")),
        }
    }
    panels
}

/// Takes the numbers of lamps as watts where that was typed or the look does so.
pub(super) fn count_in_watts(
    scene: &mut Scene,
    is_typed: bool,
    units_of_look: Option<LampUnits>,
    console: &mut Console,
) {
    let is_asked = is_typed || units_of_look == Some(LampUnits::Unitless);
    if is_asked && assume_unitless(scene) == 0 {
        let what = if is_typed { "--unitless" } else { "counting lamps in watts, as the look does," };
        console.warn(&format!("{what} changes nothing: no lamp of the scene counts in candela or lux of its own"));
    }
}

/// What was asked for about the lamps of the file.
fn change_lamps(scene: &mut Scene, args: &ViewArgs, console: &mut Console) -> Result<()> {
    let radius_rad = args.sun_size.map(|degrees| (0.5 * degrees).to_radians());
    if radius_rad.is_some_and(|radius_rad| scene.set_sun_radius(radius_rad) == 0) {
        console.warn("--sun-size changes nothing: no lamp of the scene is directional");
    }
    for (nth, request) in args.ies.iter().enumerate() {
        let IesRequest { key, file } = request;
        if args.ies[..nth].iter().any(|other| other.key == *key) {
            bail!("--ies names the lamp `{key}` twice; give it one file");
        }
        assign_profile(scene, request, console)
            .with_context(|| format!("cannot give `{key}` the distribution of {}", file.display()))?;
    }
    // Whose light comes from a profile counts in candela already.
    count_in_watts(scene, args.unitless, args.of_look.units, console);
    Ok(())
}

fn assign_profile(scene: &mut Scene, request: &IesRequest, console: &mut Console) -> Result<()> {
    let name = request.file.display().to_string();
    let profile = import::read_profile(&request.file).map_err(anyhow::Error::msg)?;
    console.warn_all(profile.remarks().iter().map(|remark| format!("{name}: {remark}")));
    Ok(assign(scene, &request.key, profile, 1.0)?)
}

/// The camera of that name, else of that number, else the first.
fn pick_camera<'a>(cameras: &'a [Camera], wanted: Option<&str>) -> Result<&'a Camera> {
    let Some(first) = cameras.first() else {
        bail!("it has no camera and none could be made; add a perspective camera");
    };
    let Some(wanted) = wanted else {
        return Ok(first);
    };
    let by_number = || wanted.parse::<usize>().ok().and_then(|n| cameras.get(n));
    Camera::named(cameras, wanted).or_else(by_number).with_context(|| {
        let known: Vec<String> = cameras.iter().enumerate().map(|(n, c)| format!("{n} `{}`", c.name)).collect();
        format!("no camera is called or numbered `{wanted}`; there are: {}", known.join(", "))
    })
}

/// Reads a look, an empty one if none is named, and reports what in it means nothing.
pub(crate) fn load_look(path: Option<&Path>, console: &mut Console) -> Result<Look> {
    let Some(path) = path else {
        return Ok(Look::default());
    };
    let (look, warnings) = Look::load(path)?;
    console.warn_all(warnings.iter().map(|warning| format!("{}: {warning}", path.display())));
    Ok(look)
}

/// Where no look was named, that of the file.
pub(crate) fn or_of_file(look: Look, path: Option<&Path>, basis: &LightBasis) -> Look {
    if path.is_some() { look } else { Look::of_file(basis) }
}

/// A warning for each light that a look sets without effect.
pub(crate) fn warn_of_unknown_lights(basis: &LightBasis, look: &Look, console: &mut Console) {
    console.warn_all(look.unheeded(basis).into_iter().chain(look.unbaked(basis)));
    if look.lights.sky.is_some() && basis.sky.is_none() {
        console.warn("the look sets the sky, but there is none to turn or exchange; name one with --sky (of the bake)");
    }
}

/// Says so where a picture is black although lights are on, such as "the picture is".
pub(crate) fn warn_of_black(
    which: &str,
    radiance: &Radiance,
    (basis, rig): (&LightBasis, &LightRig),
    console: &mut Console,
) {
    if is_black(radiance, basis, rig) {
        console.warn(&black_words(which, basis));
    }
}

/// Runs `work` on the given number of threads.
pub(crate) fn on_threads<T: Send>(threads: Option<u16>, work: impl FnOnce() -> T + Send) -> Result<T> {
    match threads {
        None => Ok(work()),
        Some(n) => {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n.into()).build();
            Ok(pool.with_context(|| format!("cannot start {n} threads; ask for fewer"))?.install(work))
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn a_camera_answers_to_its_name_before_its_number() {
        let camera = |name: &str| Camera::look_at(name, Vec3::ZERO, Vec3::X, 1.0, 1.0);
        let cameras = [camera("1"), camera("door"), camera("window")];
        let name = |wanted| pick_camera(&cameras, wanted).map(|c| c.name.clone());
        assert_eq!(name(None).unwrap(), "1");
        assert_eq!(name(Some("1")).unwrap(), "1");
        assert_eq!(name(Some("2")).unwrap(), "window");
        assert_eq!(name(Some("door")).unwrap(), "door");
        assert!(name(Some("3")).unwrap_err().to_string().contains("`window`"));
        assert!(pick_camera(&[], None).is_err());
    }
}
