//! `clerestory relight` and `clerestory render`: factors times coefficients, into a file.

use std::time::Instant;

use anyhow::{Context, Result, bail};
use clerestory_relight::{CpuRelighter, DeviceChoice, Frame, Gpu, GpuRelighter, Radiance, Relight, RelightError};
use clerestory_transport::bake::{Bake, BakeJob, Passes};
use clerestory_transport::basis::LightBasis;
use clerestory_transport::irradiance::IrradianceRows;
use clerestory_transport::light::LightRig;
use indicatif::ProgressBar;
use serde_json::{Value, json};

use super::args::{Device, Layers, RelightArgs, RelightOptions, RenderArgs};
use super::bake::{baked, job, merge, run_with_progress};
use super::console::{Answer, Console, duration_words};
use super::interrupt::{discarded, writing};
use super::lamps::{self, Arriving, DIRECT_LUX, LampLight};
use super::sequence::sequence;
use super::view::{
    inputs_of, load_bake, load_look, open_view, or_of_file, requested_sky, spare_look, spare_scene, warn_of_black,
    warn_of_no_sky, warn_of_unknown_lights,
};
use super::{picture, sheet::sheet};
use crate::export::layers::LayerSet;
use crate::export::{ExportOptions, ImageFormat, LightLayer, Picture};
use crate::illuminance::{AddedLux, seen_irradiance};
use crate::look::{Look, Units};
use crate::output::{PendingFile, spare_inputs};
use crate::platform::may_have_gpu;

pub(super) fn relight(args: &RelightArgs, console: &mut Console) -> Result<Answer> {
    if args.contact_sheet.is_empty() && args.frames.are_meant(&args.options.output) {
        return sequence(args, console);
    }
    writing(Some(args.options.output.as_path()), console, |console| one_file(args, console))
}

/// A picture, or a sheet of several.
fn one_file(args: &RelightArgs, console: &mut Console) -> Result<Answer> {
    spare_inputs(&args.options.output, [("transport", args.transport.as_path())])?;
    args.scene.iter().try_for_each(|scene| spare_scene(&args.options.output, scene))?;
    if !args.contact_sheet.is_empty() {
        return sheet(args, console);
    }
    let mut target = Target::new(&args.options, console)?;
    let bake = load_bake(&args.transport)?;
    target.options.window([bake.header.width, bake.header.height])?;
    target.look = chosen(&target.document, &args.options, &bake.header.basis, console)?;
    let paths = (args.options.look.as_deref(), args.scene.as_deref());
    lamps::warn_of_no_lamps([&target.look.lights], lamps::options_of_lamps(args), console);
    let measures = target.options.irradiance || target.look.shows_irradiance(target.format);
    let quality = (Arriving::of(&bake, measures), args.lamp_samples);
    let lamps = LampLight::of(&bake, &target.look, paths, quality, console)?;
    target.finish(&bake, &lamps, &args.options, console)
}

pub(super) fn render(args: &RenderArgs, console: &mut Console) -> Result<Answer> {
    spare_scene(&args.relight.output, &args.scene)?;
    spare_inputs(&args.relight.output, inputs_of(&args.bake.view))?;
    let interrupt = console.interrupt.heeded()?;
    let (kept, quiet) = (|| discarded(&args.relight.output), ProgressBar::hidden());
    let mut target = interrupt.watched(&quiet, &kept, || Target::new(&args.relight, console))?;
    let asked = args.bake.view.as_in(&target.document);
    let mut view = interrupt.watched(&quiet, &kept, || {
        let form = args.bake.sky_form(&target.document);
        let sky = requested_sky(&asked, target.look.lights.sky.as_ref(), form, console)?;
        warn_of_no_sky(sky.as_ref(), args.bake.sky_patches, console);
        open_view(&args.scene, &asked, sky.as_ref(), console)
    })?;
    target.options.window([view.film.width, view.film.height])?;
    // The sky was mixed with what was typed, not with what is baked of both.
    let sky = target.look.lights.sky.take();
    target.look = chosen(&target.document, &args.relight, &view.scene.lighting.basis, console)?;
    target.look.lights.sky = sky;
    target.told = Some(target.look.clone());
    // Nothing is kept of this bake, so that its lamps need not be movable.
    lamps::install(&mut view, &mut target.look.lights, args.relight.look.as_deref(), console)?;
    let asked = target.options.irradiance || target.look.shows_irradiance(target.format);
    let irradiance = if asked { vec![IrradianceRows::Pixels] } else { Vec::new() };
    let job = BakeJob { irradiance, ..job(view, &args.bake, Passes::FinalOnly) };
    let (bake, times) = run_with_progress(console, &args.bake, &kept, |on_event| job.run(on_event))
        .with_context(|| format!("cannot bake {}", args.scene.display()))?;
    let mut answer = baked(&bake, times, &args.bake, console)?;
    let finish = || target.finish(&bake, &[], &args.relight, console);
    let relit = interrupt.watched(&quiet, &kept, finish)?;
    merge(&mut answer.json, relit.json);
    answer.words = format!("{}\n{}", answer.words, relit.words);
    Ok(answer)
}

/// What was chosen of a look, now that the lights are known.
fn chosen(document: &Look, options: &RelightOptions, basis: &LightBasis, console: &mut Console) -> Result<Look> {
    let look = options.choice.of(&or_of_file(document.clone(), options.look.as_deref(), basis), Some(basis))?;
    warn_of_unknown_lights(basis, &look, console);
    Ok(look)
}

/// Everything about the output that can fail before the long work.
struct Target {
    format: ImageFormat,
    place: PendingFile,
    document: Look,
    /// What was chosen of it.
    look: Look,
    /// What files tell of it, where its lamps became lights of the scene.
    told: Option<Look>,
    options: ExportOptions,
    graphics: Option<Graphics>,
}

impl Target {
    fn new(options: &RelightOptions, console: &mut Console) -> Result<Target> {
        let format = ImageFormat::of(&options.output)?;
        if options.layers.iter().any(|layer| *layer != Layers::None) && format == ImageFormat::Png {
            bail!("{} cannot hold layers; write an .exr, or leave out --layers", options.output.display());
        }
        let file = picture::options(format, options.depth, options.cut, &options.layers)?;
        let place = PendingFile::create(&options.output)?;
        let document = load_look(options.look.as_deref(), console)?;
        spare_look(&options.output, options.look.as_deref(), &document)?;
        let look = options.choice.of(&document, None)?;
        Ok(Target {
            format,
            place,
            document,
            look,
            told: None,
            options: file,
            graphics: open_graphics(options.device)?,
        })
    }

    fn finish(
        self,
        bake: &Bake,
        lamps: &[LampLight],
        options: &RelightOptions,
        console: &mut Console,
    ) -> Result<Answer> {
        let irradiance = irradiance_for(bake, &self.look, &lamps::added_lux(lamps), self.format, &self.options)?;
        let mut lit = Lit::new(bake, &self.look, lamps, self.graphics.as_ref())?;
        let look = self.told.as_ref().unwrap_or(&self.look);
        let layers = lit.layers(bake, look, lamps, self.options.layers)?;
        let has_lamps = irradiance.is_some() && !lamps.is_empty();
        if has_lamps && bake.pixel_irradiance().is_some_and(|set| !bake.header.holds_patches(&bake.irradiance[set])) {
            console.warn(DIRECT_LUX);
        }
        let Lit { radiance, relighter, relight_secs, .. } = lit;
        relighter.warn_of_refusal(console);
        warn_of_black("the picture is", &radiance, (&bake.header.basis, &self.look.lights), console);
        let irradiance = irradiance.as_ref();
        let picture =
            Picture { radiance: &radiance, layers: &layers, irradiance, look, units: Units::of(&bake.header.basis) };
        let shown = picture.write(self.place, self.format, &self.options)?;
        console.warn_all(picture.layer_remarks());
        let [width, height] = shown.size_px;
        let n_layers = layers.len() + usize::from(self.options.irradiance);
        let output = options.output.display().to_string();
        let words = format!(
            "{output}: {width}×{height}, relit in {} on the {}",
            duration_words(relight_secs),
            relighter.words(),
        );
        let mut json = json!({
            "output": output, "width": width, "height": height, "relight_secs": relight_secs,
            "exposure_ev": shown.exposure_ev, "false_color": shown.legend.map(|legend| legend.json()), "layers": n_layers,
            "warnings": console.warnings(),
        });
        merge(&mut json, relighter.json());
        Ok(Answer { json, words })
    }
}

/// A bake under a look.
pub(super) struct Lit {
    pub relighter: Relighter,
    /// What it is lit by.
    rig: LightRig,
    /// One RGB per column of each group, the light that lamps throw on patches included.
    coefficients: Vec<Vec<[f32; 3]>>,
    /// The picture, lamps included.
    pub radiance: Radiance,
    /// What the multiplication took.
    pub relight_secs: f64,
}

impl Lit {
    pub fn new(bake: &Bake, look: &Look, lamps: &[LampLight], graphics: Option<&Graphics>) -> Result<Lit> {
        let mut relighter = Relighter::new(bake, &look.lights, graphics)?;
        let mut coefficients = bake.header.coefficients(&look.lights);
        lamps.iter().for_each(|lamp| bake.header.add_of_patches(&mut coefficients, &lamp.of_patches));
        let begun = Instant::now();
        let mut radiance = relighter.relight(&coefficients)?;
        let relight_secs = begun.elapsed().as_secs_f64();
        lamps.iter().for_each(|lamp| radiance.add(&lamp.direct));
        Ok(Lit { relighter, rig: look.lights.clone(), coefficients, radiance, relight_secs })
    }

    /// Its light in parts, which a look names. That look may still have lamps that became lights of the scene, their groups counted in:
    /// how much shines is asked of the rig alone.
    fn layers(&mut self, bake: &Bake, look: &Look, lamps: &[LampLight], set: LayerSet) -> Result<Vec<LightLayer>> {
        let relighter = &mut self.relighter;
        let basis = &bake.header.basis;
        let mut layers = match basis.sun_apart(&self.rig) {
            Some(sun) => set.layers_with_sun(bake, look, &sun)?,
            None => set.layers(basis, look, &self.coefficients, |c| relighter.relight(c))?,
        };
        let keys: Vec<&str> = lamps.iter().map(|lamp| lamp.key.as_str()).collect();
        for (key, members) in set.lamp_parts(&keys, look) {
            let radiance = relighter.light_of(bake, members.into_iter().map(|idx| &lamps[idx]))?;
            set.take_in(&mut layers, LightLayer { key, radiance });
        }
        Ok(layers)
    }
}

/// The light that arrives at the pixels, where a file shows or holds it.
pub(crate) fn irradiance_for(
    bake: &Bake,
    look: &Look,
    added: &AddedLux,
    format: ImageFormat,
    options: &ExportOptions,
) -> Result<Option<Radiance>> {
    let asked = options.irradiance || look.shows_irradiance(format);
    asked.then(|| seen_irradiance(bake, &look.lights, added)).transpose()
}

/// A graphics device of the command line.
pub(crate) struct Graphics {
    pub gpu: Gpu,
    /// Whether it was asked for by name; another one leaves to the CPU what it refuses.
    pub is_asked_for: bool,
}

pub(super) fn open_graphics(device: Device) -> Result<Option<Graphics>> {
    let of = |gpu: Gpu| Graphics { gpu, is_asked_for: device == Device::Gpu };
    match device {
        Device::Cpu => Ok(None),
        Device::Gpu => {
            let gpu = Gpu::headless(DeviceChoice::Any);
            Ok(Some(of(gpu.context("--device gpu found no graphics device; use --device auto or --device cpu")?)))
        }
        Device::Auto if may_have_gpu() => Ok(Gpu::headless(DeviceChoice::Hardware).ok().map(of)),
        Device::Auto => Ok(None),
    }
}

fn refusal(device: String, error: RelightError) -> String {
    format!("{device} failed, and the CPU goes on: {error}")
}

/// The frame of a bake under a rig, as a relighter takes it. Blocks are shared but where the sky is seen.
pub(crate) fn frame_of(bake: &Bake, rig: &LightRig) -> Frame {
    Frame { width: bake.header.width, height: bake.header.height, groups: bake.groups_under(rig) }
}

/// A relighter with the name of what runs it.
pub(crate) struct Relighter {
    relight: Box<dyn Relight>,
    adapter: Option<String>,
    /// Memory that it takes of a device.
    device_bytes: Option<u64>,
    /// What the CPU goes on with where the device refuses it.
    spare: Option<Frame>,
    /// Why it did.
    refusal: Option<String>,
}

impl Relighter {
    /// On the given device, else on the CPU; the sky is that of the rig.
    pub(crate) fn new(bake: &Bake, rig: &LightRig, graphics: Option<&Graphics>) -> Result<Relighter> {
        let frame = frame_of(bake, rig);
        let Some(Graphics { gpu, is_asked_for }) = graphics else { return Relighter::on_cpu(&frame, None) };
        match GpuRelighter::new(gpu, &frame) {
            Ok(relighter) => Ok(Relighter {
                adapter: Some(gpu.description()),
                device_bytes: Some(relighter.device_bytes()),
                relight: Box::new(relighter),
                spare: (!is_asked_for).then_some(frame),
                refusal: None,
            }),
            Err(error) if !is_asked_for => Relighter::on_cpu(&frame, Some(refusal(gpu.description(), error))),
            Err(error) => Err(error.into()),
        }
    }

    fn on_cpu(frame: &Frame, refusal: Option<String>) -> Result<Relighter> {
        let relight = Box::new(CpuRelighter::new(frame)?);
        Ok(Relighter { relight, adapter: None, device_bytes: None, spare: None, refusal })
    }

    /// The picture under the given coefficients, one RGB per column of each group.
    pub(crate) fn relight(&mut self, coefficients: &[Vec<[f32; 3]>]) -> Result<Radiance> {
        let mut radiance = Radiance::default();
        match (self.relight.relight(coefficients, &mut radiance), self.spare.take()) {
            (Ok(_), spare) => self.spare = spare,
            (Err(error), Some(frame)) => {
                *self = Relighter::on_cpu(&frame, Some(refusal(self.adapter.take().unwrap_or_default(), error)))?;
                return self.relight(coefficients);
            }
            (Err(error), None) => return Err(error).context("cannot relight"),
        }
        Ok(radiance)
    }

    /// Says so if a device left the picture to the CPU.
    pub(super) fn warn_of_refusal(&self, console: &mut Console) {
        self.refusal.iter().for_each(|words| console.warn(words));
    }

    /// What some lamps of the look add.
    fn light_of<'a>(&mut self, bake: &Bake, lamps: impl Iterator<Item = &'a LampLight> + Clone) -> Result<Radiance> {
        let mut coefficients: Vec<Vec<[f32; 3]>> =
            bake.header.basis.groups.iter().map(|group| vec![[0.0; 3]; group.columns.len()]).collect();
        lamps.clone().for_each(|lamp| bake.header.add_of_patches(&mut coefficients, &lamp.of_patches));
        let mut radiance = self.relight(&coefficients)?;
        lamps.for_each(|lamp| radiance.add(&lamp.direct));
        Ok(radiance)
    }

    pub(super) fn words(&self) -> String {
        self.adapter.as_ref().map_or("CPU".into(), |name| format!("GPU ({name})"))
    }

    pub(super) fn json(&self) -> Value {
        let device = if self.adapter.is_some() { "gpu" } else { "cpu" };
        json!({ "device": device, "adapter": self.adapter, "device_bytes": self.device_bytes })
    }
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;
    use std::sync::Arc;

    use clerestory_relight::gpu::DeviceMemory;
    use clerestory_transport::bake::BakeConfig;
    use clerestory_transport::camera::Film;
    use clerestory_transport::emitters::{PanelRequest, SkyRequest};
    use clerestory_transport::import;
    use clerestory_transport::lamps::PreparedLamps;
    use clerestory_transport::light::{LightGroup, LightSetting};
    use clerestory_transport::prepared::PreparedScene;
    use clerestory_transport::sky::{SkyForm, SkySetting};

    use super::*;
    use crate::look::sky::{remade, typed};
    use crate::support::{ROOM, room_job};

    fn room() -> Bake {
        let config = BakeConfig { spp: 2, tolerance_db: 10.0, ..BakeConfig::default() };
        let job = room_job(Film { width: 20, height: 16 }, config);
        job.run(|_| std::ops::ControlFlow::Continue(())).unwrap().unwrap()
    }

    #[test]
    fn what_a_device_refuses_the_cpu_does_unless_the_device_was_asked_for() {
        let gpu = match Gpu::headless(DeviceChoice::Any) {
            Ok(gpu) => gpu,
            Err(error) => {
                assert!(std::env::var_os("CLERESTORY_REQUIRE_GPU").is_none(), "{error}");
                return;
            }
        };
        let (bake, rig) = (room(), LightRig::default());
        let coefficients = bake.header.coefficients(&rig);
        let wanted = Relighter::new(&bake, &rig, None).unwrap().relight(&coefficients).unwrap();
        let mut graphics = Graphics { gpu, is_asked_for: false };
        let mut on_device = Relighter::new(&bake, &rig, Some(&graphics)).unwrap();
        assert!(on_device.refusal.is_none() && on_device.adapter.is_some());
        on_device.relight(&coefficients).unwrap();
        assert!(on_device.refusal.is_none() && on_device.spare.is_some());

        graphics.gpu.set_memory(DeviceMemory::Exhausted);
        let mut refused = Relighter::new(&bake, &rig, Some(&graphics)).unwrap();
        assert_eq!(refused.relight(&coefficients).unwrap(), wanted);
        let words = refused.refusal.clone().unwrap();
        assert!(words.contains("failed, and the CPU goes on") && refused.json()["device"] == "cpu", "{words}");
        graphics.is_asked_for = true;
        assert!(Relighter::new(&bake, &rig, Some(&graphics)).is_err());
    }

    fn sky(words: &str) -> SkySetting {
        remade(&SkySetting::default(), typed(words).unwrap()).unwrap()
    }

    /// The room without its front under a sun, its ceiling a panel and its back unlit.
    fn court() -> PreparedScene {
        let mut gltf: Value = serde_json::from_str(ROOM).unwrap();
        let add = |list: &mut Value, more: Value| list.as_array_mut().unwrap().push(more);
        gltf["accessors"][1]["count"] = json!(18);
        for offset in [36, 48] {
            let indices =
                json!({"bufferView": 1, "byteOffset": offset, "componentType": 5123, "count": 6, "type": "SCALAR"});
            add(&mut gltf["accessors"], indices);
        }
        add(&mut gltf["extensionsUsed"], json!("KHR_materials_unlit"));
        add(&mut gltf["materials"], json!({"emissiveFactor": [1, 1, 1]}));
        add(&mut gltf["materials"], json!({"extensions": {"KHR_materials_unlit": {}}}));
        let face = |nth: u32| json!({"attributes": {"POSITION": 0}, "indices": 1 + nth, "material": nth});
        add(&mut gltf["meshes"], json!({"primitives": [face(1)]}));
        add(&mut gltf["meshes"][0]["primitives"], face(2));
        add(&mut gltf["nodes"], json!({"name": "panel", "mesh": 1}));
        add(&mut gltf["scenes"][0]["nodes"], json!(3));
        let scene = import::load_bytes("court.gltf", gltf.to_string().as_bytes()).unwrap().scene;
        let panel = PanelRequest { node: "panel".into(), resolution: 4 };
        let request = SkyRequest { light: sky("sun:200,50").light(None).unwrap(), form: SkyForm::Patches(1) };
        PreparedScene::with_sky(scene, &[panel], Some(&request)).unwrap().0
    }

    #[test]
    fn lamps_that_were_traced_count_once_in_layers_beside_a_moved_sun() {
        let (mut scene, film) = (court(), Film { width: 24, height: 18 });
        let lamp = r#"{"clerestory": 1, "lamps":
            [{"key": "bulb", "type": "point", "position": [0, 0.2, 0], "strength": 2e5, "unit": "cd"}]}"#;
        let mut told = Look::from_json(lamp).unwrap().0;
        told.lights.sky = Some(sky("sun:170,50"));
        told.lights.set("sun", LightSetting { intensity: 0.5, ..LightSetting::default() });
        told.lights.set("lamp", LightSetting { muted: true, ..LightSetting::default() });
        for (group, intensity, lights) in [("work", 0.25, ["bulb", "panel"]), ("rest", 3.0, ["unlit", "spare"])] {
            let lights = lights.map(String::from).into();
            told.lights.groups.insert(group.into(), LightGroup { lights, intensity, muted: false });
        }
        let mut look = told.clone();
        let (traced, _) = PreparedLamps::new(&look.lights.take_lamps(), None).unwrap();
        traced.install(&mut scene).unwrap();

        let (scene, config) = (Arc::new(scene), BakeConfig { spp: 4, tolerance_db: 30.0, ..BakeConfig::default() });
        let (camera, passes) = (scene.scene.cameras[0].clone(), Passes::FinalOnly);
        let job = BakeJob { scene: scene.clone(), camera, film, config, passes, irradiance: Vec::new() };
        let bake = job.run(|_| ControlFlow::Continue(())).unwrap().unwrap();
        let basis = &bake.header.basis;
        assert!(basis.sun_apart(&look.lights).is_some());
        assert!(["panel", "unlit"].iter().all(|key| basis.source(key).is_some()));
        let spare = LampLight {
            key: "spare".into(),
            direct: Radiance { pixels: vec![[500.0; 3]; film.n_pixels()], ..Radiance::new(film.width, film.height) },
            arriving: None,
            of_patches: Vec::new(),
            prepared: PreparedLamps::default(),
            scene,
        };
        let lamps = [spare];
        let mut lit = Lit::new(&bake, &look, &lamps, None).unwrap();
        let brightest = lit.radiance.pixels.as_flattened().iter().copied().fold(0.0, f32::max);
        for set in [LayerSet::Groups, LayerSet::Lights] {
            let layers = lit.layers(&bake, &told, &lamps, set).unwrap();
            for (idx, pixel) in lit.radiance.pixels.iter().enumerate() {
                let sum: f32 = layers.iter().map(|layer| layer.radiance.pixels[idx][1]).sum();
                assert!((sum - pixel[1]).abs() <= 1e-2 * brightest, "{set:?}: {sum} is not {}", pixel[1]);
            }
        }
    }
}
