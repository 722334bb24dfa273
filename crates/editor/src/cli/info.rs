//! `clerestory info`: what is in a scene, a transport file, a look, or a folder of pictures.

use std::io::Read;
use std::path::Path;

use anyhow::{Context, Result, bail};
use clerestory_relight::Precision;
use clerestory_relight::gpu::device_bytes;
use clerestory_transport::basis::{LightBasis, LightSource};
use clerestory_transport::bsdf::{FurnaceLoss, furnace_loss};
use clerestory_transport::camera::{Camera, Film};
use clerestory_transport::emitters::Lighting;
use clerestory_transport::import::{Choice, Imported};
use clerestory_transport::lamps::FreeLamp;
use clerestory_transport::light::LightRig;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::scene::{Material, Scene};
use clerestory_transport::skips::Spared;
use serde_json::{Value, json};

use super::args::InfoArgs;
use super::bake::{figure_words, irradiance_words, merge, open_stack};
use super::console::{Answer, Console};
use super::relight::frame_of;
use super::view::{fault_words, import_scene, load_bake, unsupported_words};
use crate::action::is_transport;
use crate::legend::number_words;
use crate::look::Look;
use crate::sizes::bytes_words;

/// First bytes of pictures: OpenEXR, PNG, JPEG, Radiance.
const PICTURES: [&[u8]; 4] = [b"\x76\x2f\x31\x01", b"\x89PNG", b"\xff\xd8\xff", b"#?"];

/// Most triangles of a scene that is prepared as for tracing, and most cameras that are looked through.
const MOST_TRIANGLES: usize = 10_000_000;
const MOST_CAMERAS: usize = 32;

/// The kinds of file that this program knows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum FileKind {
    Scene,
    Transport,
    Look,
    /// A folder of them.
    Pictures,
}

pub(super) fn info(args: &InfoArgs, console: &mut Console) -> Result<Answer> {
    let (path, variant) = (args.file.as_path(), args.variant.as_deref());
    let kind = if path.is_dir() { FileKind::Pictures } else { file_kind(path)? };
    if variant.is_some() && kind != FileKind::Scene {
        bail!("--variant is for scenes (.gltf, .glb), and {} is none", path.display());
    }
    if args.block_errors && kind != FileKind::Transport {
        bail!("--block-errors is for transports, and {} is none", path.display());
    }
    match kind {
        FileKind::Pictures => stack(path, console),
        FileKind::Scene => scene(path, variant, console),
        FileKind::Transport => transport(args),
        FileKind::Look => look(path, console),
    }
}

/// By its name, else by its first bytes.
fn file_kind(path: &Path) -> Result<FileKind> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    match extension.as_deref() {
        Some("gltf" | "glb") => return Ok(FileKind::Scene),
        Some("transport") => return Ok(FileKind::Transport),
        Some("look") => return Ok(FileKind::Look),
        Some("part") => bail!(
            "{} is a bake that has not ended; run the same `clerestory bake` command again to finish it",
            path.display()
        ),
        _ => {}
    }
    let mut start = Vec::new();
    let file = std::fs::File::open(path).with_context(|| format!("cannot read {}: check the path", path.display()))?;
    let read = file.take(1 << 20).read_to_end(&mut start);
    read.with_context(|| format!("cannot read {}: give a file", path.display()))?;
    let holds = |text: &[u8]| start.windows(text.len()).any(|window| window == text);
    match () {
        () if PICTURES.iter().any(|magic| start.starts_with(magic)) => {
            bail!("{} is a picture; info takes a scene (.gltf, .glb), a .transport or a .look", path.display())
        }
        () if start.starts_with(b"glTF") || holds(b"\"asset\"") => Ok(FileKind::Scene),
        () if is_transport(path) => Ok(FileKind::Transport),
        () if holds(b"\"clerestory\"") => Ok(FileKind::Look),
        () => bail!("{} is no scene (.gltf, .glb), no .transport and no .look", path.display()),
    }
}

fn scene(path: &Path, variant: Option<&str>, console: &mut Console) -> Result<Answer> {
    let choice = Choice { variant: variant.map(str::to_owned), ..Choice::default() };
    let imported = import_scene(path, &choice)?;
    // In the answer they stand under `unsupported`.
    console.say_all(unsupported_words(&imported, path));
    console.warn_all(fault_words(&imported, path));
    let Imported { scene, report } = imported;
    let n_cameras = if report.made_camera { 0 } else { scene.cameras.len() };
    let cameras: Vec<String> = scene.cameras[..n_cameras].iter().map(|camera| camera.name.clone()).collect();
    let sensors: Vec<String> = scene.sensors.iter().map(|grid| grid.name.clone()).collect();
    let name = |material: &Material| match material.name.as_str() {
        "" => "a material without a name".to_owned(),
        name => name.to_owned(),
    };
    let named = |is_such: fn(&Material) -> bool| -> Vec<String> {
        scene.materials.iter().filter(|material| is_such(material)).map(name).collect()
    };
    let (caustic, mirroring) = (named(Material::casts_caustics), named(Material::mirrors_a_part));
    let furnace = furnace_loss(&scene);
    // Of the file: those without area are there, though no light meets them.
    let triangles = scene.mesh.triangles.len() + report.n_degenerate_triangles;
    let size_m = scene.mesh.bounds().map(|(low, high)| (high - low).to_array());
    let (basis, spared) = lights_of(scene, n_cameras, MOST_TRIANGLES, console);
    let sources = &basis.sources;
    let keys: Vec<&str> = sources.iter().map(|source| source.key.as_str()).collect();
    let json = json!({
        "triangles": triangles,
        "degenerate_triangles": report.n_degenerate_triangles,
        "size_m": size_m,
        "nodes": report.n_nodes,
        "cameras": cameras.len(),
        "camera_names": cameras,
        "lights": keys,
        "light_details": sources.iter().map(|source| light_detail(source, &basis)).collect::<Vec<_>>(),
        "sensors": sensors,
        "materials": report.n_materials,
        "caustic_materials": caustic,
        "mirroring_materials": mirroring,
        "variants": report.variants,
        "furnace_loss": furnace.map(|loss| json!({
            "materials": loss.n_materials, "at_most": loss.at_most, "without_compensation": loss.single,
        })),
        "skipped": spared.as_ref().map(|spared| skipped(spared, sources)),
        "unsupported": report.unsupported,
        "warnings": console.warnings(),
    });
    let words = format!(
        "{}: {} triangles, {} nodes, {} materials{}\ncameras  {}\nlights   {}{}{}{}{}{}{}\nnot supported  {}",
        path.display(),
        triangles,
        report.n_nodes,
        report.n_materials,
        size_m.map_or(String::new(), size_words),
        listed(&cameras),
        listed(&sources.iter().map(|source| light_words(source, &basis)).collect::<Vec<_>>()),
        line_of("sensors", &sensors),
        line_of("cast caustics, which moved and added lamps lack", &caustic),
        line_of("mirror a part of the light, which moved and added lamps lack", &mirroring),
        line_of("variants", &report.variants),
        furnace.map_or(String::new(), furnace_words),
        line_of("needless", &spared.map_or(Vec::new(), |spared| skipped_words(&spared, sources))),
        listed(&report.unsupported),
    );
    Ok(Answer { json, words })
}

/// Three sides in meters, with the digits that count.
fn size_words(sides_m: [f32; 3]) -> String {
    format!(", {} m", sides_m.map(number_words).join(" × "))
}

/// Work that a scene does not need; the lights are those that reach nothing of what its first camera sees.
fn skipped(spared: &Spared, sources: &[LightSource]) -> Value {
    let n_dark_columns: usize = dark_lights(spared, sources).map(|source| source.columns.len()).sum();
    json!({
        "diffuse_materials": spared.diffuse_materials, "random_numbers_saved_per_hit": spared.diffuse_share,
        "opaque_triangles": spared.opaque_triangles, "alpha_tests_saved_per_hit": spared.opaque_share,
        "idle_images": spared.idle_images, "idle_image_bytes": spared.idle_bytes,
        "dark_lights": dark_lights(spared, sources).map(|source| source.key.as_str()).collect::<Vec<_>>(),
        "connections_saved_per_sample": n_dark_columns,
    })
}

fn dark_lights<'s>(spared: &'s Spared, sources: &'s [LightSource]) -> impl Iterator<Item = &'s LightSource> {
    spared.dark_sources.iter().filter_map(move |&source| sources.get(source as usize))
}

fn skipped_words(spared: &Spared, sources: &[LightSource]) -> Vec<String> {
    let counted = [
        (spared.diffuse_materials, "coats of", "materials that are diffuse alone"),
        (spared.opaque_triangles, "the alpha of", "triangles"),
        (spared.idle_images, "the texels of", "images that nothing samples"),
    ];
    let mut words: Vec<String> = counted
        .into_iter()
        .filter(|(count, ..)| *count > 0)
        .map(|(count, what, whose)| format!("{what} {count} {whose}"))
        .collect();
    let dark: Vec<&str> = dark_lights(spared, sources).map(|source| source.key.as_str()).collect();
    if !dark.is_empty() {
        words.push(format!("the light of {}, of which the first camera sees nothing", dark.join(", ")));
    }
    words
}

/// The lights of a scene and what work it does not need, and warnings of what in it would be dark or cut away. Of more triangles than
/// so many only the lights are told: the rest takes all that tracing takes.
fn lights_of(
    scene: Scene,
    n_cameras: usize,
    most_triangles: usize,
    console: &mut Console,
) -> (LightBasis, Option<Spared>) {
    let lights = if scene.mesh.triangles.len() > most_triangles {
        Lighting::new(&scene, &[]).map(|(lighting, mut warnings)| {
            warnings.push(format!(
                "of more than {most_triangles} triangles it is not looked for lamps that are closed in, for views of backs, nor for \
                 how bright unlit surfaces are: `trace` and `bake` tell of that"
            ));
            (lighting.basis, None, warnings)
        })
    } else {
        PreparedScene::new(scene, &[]).map(|(prepared, mut warnings)| {
            let cameras = prepared.scene.cameras.iter().take(n_cameras.min(MOST_CAMERAS));
            warnings.extend(cameras.filter_map(|camera| prepared.warn_of_backs(camera)));
            let eye = prepared.scene.cameras.first().map(Camera::position);
            let spared = eye.map_or_else(|| prepared.spared(), |eye| prepared.spared_from(eye));
            (prepared.lighting.basis, Some(spared), warnings)
        })
    };
    match lights {
        Ok((basis, spared, warnings)) => {
            console.warn_all(warnings);
            (basis, spared)
        }
        // A light that cannot be made a column is a warning here: the file itself is what was asked about.
        Err(error) => {
            console.warn(&error.to_string());
            (LightBasis::default(), None)
        }
    }
}

/// A line on what rough metals and glasses lose that ought to lose nothing.
fn furnace_words(loss: FurnaceLoss) -> String {
    let percent = |share: f32| 100.0 * share;
    format!(
        "\nrough metals and glasses  {}, which in a white furnace lose {:.1} % at most ({:.1} % without energy compensation)",
        loss.n_materials,
        percent(loss.at_most),
        percent(loss.single)
    )
}

fn light_detail(source: &LightSource, basis: &LightBasis) -> Value {
    json!({
        "key": source.key, "kind": source.kind, "columns": source.columns.len(),
        "color": source.color.to_array(), "strength": source.strength, "unit": source.kind.unit(),
        "muted": basis.muted.contains(&source.key),
    })
}

fn light_words(source: &LightSource, basis: &LightBasis) -> String {
    let columns = match source.columns.len() {
        1 => String::new(),
        n => format!(", {n} columns"),
    };
    let off = if basis.muted.contains(&source.key) { ", off" } else { "" };
    format!("{} ({} {}{columns}{off})", source.key, source.strength, source.kind.unit())
}

/// A line for people, if there is anything in it.
fn line_of(title: &str, items: &[impl AsRef<str>]) -> String {
    if items.is_empty() { String::new() } else { format!("\n{title}  {}", listed(items)) }
}

/// A list for people.
fn listed(items: &[impl AsRef<str>]) -> String {
    if items.is_empty() { "none".into() } else { items.iter().map(AsRef::as_ref).collect::<Vec<_>>().join(", ") }
}

fn stack(folder: &Path, console: &mut Console) -> Result<Answer> {
    let stack = open_stack(folder, console)?;
    let keys: Vec<&str> = stack.images.iter().map(|image| image.key.as_str()).collect();
    let Film { width, height } = stack.film;
    let words =
        format!("{}: {} pictures, {width}×{height}\nlights      {}", folder.display(), keys.len(), listed(&keys));
    let (passed_over, warnings) = (&stack.passed_over, console.warnings());
    let json = json!({
        "pictures": keys.len(), "width": width, "height": height, "lights": keys, "passed_over": passed_over,
        "warnings": warnings,
    });
    Ok(Answer { json, words })
}

fn transport(args: &InfoArgs) -> Result<Answer> {
    let path = args.file.as_path();
    let bake = load_bake(path)?;
    let header = &bake.header;
    let figures = serde_json::to_value(bake.figures()).context("the figures of a bake always have a JSON form")?;
    let irradiance = bake.irradiance_figures();
    let keys: Vec<&str> = header.basis.sources.iter().map(|source| source.key.as_str()).collect();
    let muted: Vec<&str> = keys.iter().copied().filter(|key| header.basis.muted.contains(*key)).collect();
    let sky = header.basis.sky.as_ref().map_or("none", |sky| sky.name.as_str());
    let measured = header.basis.is_measured();
    let frame = frame_of(&bake, &LightRig::default());
    let [on_device, in_window] =
        [Precision::Halves, Precision::ByError].map(|precision| device_bytes(&frame, precision));
    let what = match measured {
        true => format!("pictures in {}", header.scene),
        false => format!("{} seen by {}", header.scene, header.camera),
    };
    let words = format!(
        "{}: {what}, {}×{}\nlights      {}{}\nsky         {sky}\ndevice      {} of a graphics device while it relights, {} in the window\n{}{}",
        path.display(),
        header.width,
        header.height,
        listed(&keys),
        line_of("off         ", &muted),
        bytes_words(on_device),
        bytes_words(in_window),
        figure_words(&figures, &header.basis),
        irradiance_words(&irradiance),
    );
    let mut json = figures;
    let about = json!({
        "scene": header.scene, "camera": header.camera, "measured": measured, "width": header.width, "height": header.height,
        "device_bytes": on_device, "window_device_bytes": in_window, "irradiance": irradiance, "lights": keys,
        "muted": muted, "config": header.config, "sky": header.basis.sky,
    });
    merge(&mut json, about);
    if args.block_errors {
        json["block_errors"] = json!(bake.error_maps());
    }
    Ok(Answer { json, words })
}

fn lamp_words(lamp: &FreeLamp) -> String {
    let FreeLamp { key, shape, strength, unit, setting, .. } = lamp;
    let off = if setting.muted { ", off" } else { "" };
    format!("{key} ({}, {} {}{off})", shape.name(), strength * setting.intensity, unit.name())
}

fn look(path: &Path, console: &mut Console) -> Result<Answer> {
    let (look, warnings) = Look::load(path)?;
    console.warn_all(warnings.iter().map(|warning| format!("{}: {warning}", path.display())));
    let lights: Vec<&String> = look.lights.lights.keys().collect();
    let lamps: Vec<String> = look.lights.lamps.iter().map(lamp_words).collect();
    let looks: Vec<&str> = look.snapshots.iter().map(|snapshot| snapshot.name.as_str()).collect();
    let timeline = match look.timeline.keys.len() {
        0 => "none".into(),
        n => format!(
            "{n} keys over {} s, {} frames at {} fps",
            look.timeline.end_secs(),
            look.timeline.n_frames(),
            look.timeline.fps
        ),
    };
    let panels: Vec<String> =
        look.lights.panels.iter().map(|(key, spots)| format!("{key} ({} spots)", spots.len())).collect();
    let sky = look.lights.sky.as_ref().map_or("as baked".into(), |sky| {
        format!("{}, turned {}°, intensity {}", sky.name(), sky.rotation_deg, sky.intensity)
    });
    let exposure = match (look.display.exposure_ev, look.display.compensation_ev) {
        (Some(ev), _) => format!("{ev:+} EV"),
        (None, 0.0) => "automatic".into(),
        (None, ev) => format!("automatic {ev:+} EV"),
    };
    let white = look.display.white.map_or(String::new(), |w| format!(", white {} K {:+} Duv", w.kelvin, w.duv));
    let false_color = look.display.quantity().map_or(String::new(), |q| format!(", false color of {}", q.name()));
    let tone = serde_json::to_value(look.display.tone).context("a tone curve always has a JSON form")?;
    let words = format!(
        "{}\nlights    {}\nlamps     {}\npanels    {}\nsky       {sky}\nexposure  {exposure}, tone curve {}{white}{false_color}\nlooks     {}\ntimeline  {timeline}",
        path.display(),
        listed(&lights),
        listed(&lamps),
        listed(&panels),
        tone.as_str().unwrap_or("unnamed"),
        listed(&looks),
    );
    let mut json: Value = serde_json::from_str(&look.to_json()).context("a look that was read can be written")?;
    merge(&mut json, json!({ "warnings": console.warnings() }));
    Ok(Answer { json, words })
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use clerestory_transport::scene::{Mesh, SceneNode};
    use glam::Vec3;

    use super::*;
    use crate::cli::interrupt::Interrupt;

    #[test]
    fn the_size_of_a_model_is_told_as_that_of_a_house_is() {
        let told = [[0.0312, 0.0045, 0.001], [12.5, 3.0, 240.0]].map(size_words);
        assert_eq!(told, [", 0.0312 × 0.0045 × 0.001 m", ", 12.5 × 3 × 240 m"]);
    }

    #[test]
    fn of_a_scene_with_too_many_triangles_the_lights_alone_are_told() {
        let scene = Scene {
            mesh: Mesh {
                positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
                normals: vec![Vec3::Z; 3],
                triangles: vec![[0, 1, 2]],
                triangle_material: vec![0],
                triangle_node: vec![0],
                ..Mesh::default()
            },
            materials: vec![Material { emissive: Vec3::ONE, ..Material::default() }],
            nodes: vec![SceneNode { name: Some("lamp".into()), ..SceneNode::default() }],
            ..Scene::default()
        };
        let told = |most_triangles: usize| {
            let (mut stdout, mut stderr) = (Vec::new(), Vec::new());
            let mut console = Console::new(Instant::now(), &mut stdout, &mut stderr, Interrupt::never());
            let (basis, _) = lights_of(scene.clone(), 0, most_triangles, &mut console);
            (basis, console.warnings().to_vec())
        };
        let ((all, nothing), (lights, words)) = (told(1), told(0));
        assert_eq!((all.sources.len(), nothing), (1, Vec::<String>::new()));
        assert_eq!(lights, all);
        assert!(words.len() == 1 && words[0].contains("more than 0 triangles"), "{words:?}");
    }

    #[test]
    fn a_building_of_more_than_a_million_triangles_is_looked_through() {
        let side = 709;
        let place = |i: u32| Vec3::new((i % side) as f32, 0.0, (i / side) as f32);
        let quad = |i: u32| [[i, i + side, i + side + 1], [i, i + side + 1, i + 1]];
        let triangles: Vec<[u32; 3]> = (0..side * (side - 1)).filter(|i| i % side < side - 1).flat_map(quad).collect();
        let (n_vertices, n) = ((side * side) as usize, triangles.len());
        assert!(n > 1_000_000);
        let scene = Scene {
            mesh: Mesh {
                positions: (0..side * side).map(place).collect(),
                normals: vec![Vec3::Y; n_vertices],
                triangles,
                triangle_material: vec![0; n],
                triangle_node: vec![0; n],
                ..Mesh::default()
            },
            materials: vec![Material { metallic: 0.0, specular: 0.0, ..Material::default() }],
            nodes: vec![SceneNode::default()],
            ..Scene::default()
        };
        let (mut stdout, mut stderr) = (Vec::new(), Vec::new());
        let mut console = Console::new(Instant::now(), &mut stdout, &mut stderr, Interrupt::never());
        let (basis, spared) = lights_of(scene, 0, MOST_TRIANGLES, &mut console);
        let spared = spared.expect("it is prepared");
        let keys: Vec<&str> = basis.sources.iter().map(|source| source.key.as_str()).collect();
        let told = skipped(&spared, &basis.sources);
        assert_eq!((&told["diffuse_materials"], &told["random_numbers_saved_per_hit"]), (&json!(1), &json!(1.0)));
        assert_eq!((&told["dark_lights"], &told["connections_saved_per_sample"]), (&json!([]), &json!(0)));
        assert_eq!(told["alpha_tests_saved_per_hit"], json!(1.0));
        let dark = Spared { dark_sources: vec![0], ..spared };
        assert_eq!(skipped(&dark, &basis.sources)["connections_saved_per_sample"], json!(1));
        let words = skipped_words(&dark, &basis.sources).join(", ");
        assert!(
            words.contains("coats of 1 materials") && words.contains(&format!("the light of {}", keys[0])),
            "{words}"
        );
    }
}
