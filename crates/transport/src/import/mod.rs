//! glTF 2.0 import: a file into a [`Scene`], with a report in words of what it holds that is not shown.
//!
//! Every index and every range of bytes is looked up, never trusted, so that a broken file ends in an error or a line of
//! the report. What is missing in part (an image, a material, one primitive) is replaced or left out; refused is only a file
//! whose container, JSON or buffer of geometry cannot be had, whose geometry must be decompressed by Draco, or that would fill the memory.

// What is read here was written by strangers, so no integer may wrap in silence.
#![cfg_attr(not(test), deny(clippy::arithmetic_side_effects))]
#![cfg_attr(not(test), deny(clippy::cast_possible_truncation, clippy::cast_sign_loss))]

mod accessor;
mod assemble;
mod cameras;
mod channels;
mod container;
mod dark;
mod document;
mod environment;
mod extensions;
mod files;
mod finish;
mod geometry;
mod hierarchy;
mod idle;
mod images;
mod jpeg;
mod lamps;
mod material;
mod merge;
mod meshopt;
mod missing;
mod muted;
mod names;
mod opaque;
mod openexr;
mod placement;
mod primaries;
mod profiles;
mod radiance;
mod raster;
mod report;
mod sensors;
mod skins;
mod spots;
pub mod stack;
mod tangents;
#[cfg(test)]
mod tests;
mod uri;
mod variants;
mod viewpoint;

use std::path::{Path, PathBuf};

use accessor::Reader;
use container::Buffers;
use document::{Document, called};
use gltf::json::extensions::scene::khr_lights_punctual::Light;
use gltf::json::{Node, Root};
use hierarchy::PlacedNode;
use names::Names;
use profiles::Profiles;
use report::Notes;
use sensors::Sensors;
use uri::{Locator, uris};
use variants::Variant;

pub use document::legible;
pub use environment::{decode_sky, load_sky};
pub use openexr::{ExrPicture, read_exr};
pub use profiles::{SUBSTITUTE_CD, read_profile};
pub use report::ImportReport;
pub use uri::named_file;

use crate::basis::KeyMaker;
use crate::camera::Camera;
use crate::emitters::lamp_keys;
use crate::scene::{Scene, SceneNode};
use crate::skips::{Skip, Skips};
use crate::stop::{Stop, Stopped};

/// Why a file could not be loaded at all.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImportError {
    /// The file itself cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// Which file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The GLB chunks make no sense.
    #[error("{name} is not a readable GLB file: {reason}")]
    Container {
        /// Which file.
        name: String,
        /// What is wrong.
        reason: String,
    },
    /// Something else altogether.
    #[error("{name} is {kind} and no glTF: {remedy}")]
    Kind {
        /// Which file.
        name: String,
        /// What it is.
        kind: &'static str,
        /// What to do about it.
        remedy: &'static str,
    },
    /// The JSON is broken or of another shape than glTF's.
    #[error("{name} is not valid glTF: {source}")]
    Json {
        /// Which file.
        name: String,
        /// Where and what.
        source: serde_json::Error,
    },
    /// No version of glTF, as of JSON that is something else.
    #[error(
        "{name} states no version of glTF (`asset.version` is no text): give a glTF file, or export it again as glTF 2.0"
    )]
    NoVersion {
        /// Which file.
        name: String,
    },
    /// Another version of glTF.
    #[error("{name} is glTF version {version:?}, only version 2 can be read: export it again as glTF 2.0")]
    Version {
        /// Which file.
        name: String,
        /// Version that it states.
        version: String,
    },
    /// A newer version of glTF is needed to read it.
    #[error("{name} needs a reader of glTF {min_version}, this is one of 2.0: export it again as glTF 2.0")]
    MinVersion {
        /// Which file.
        name: String,
        /// Least version that it asks for.
        min_version: String,
    },
    /// Its geometry is encoded in a way that cannot be decoded.
    #[error("{name} requires {extension}, which is not supported: {remedy}")]
    Extension {
        /// Which file.
        name: String,
        /// glTF extension.
        extension: String,
        /// What to do about it.
        remedy: String,
    },
    /// It has no such variant.
    #[error("{name} has no variant called `{wanted}`; there are: {known}")]
    Variant {
        /// Which file.
        name: String,
        /// What was asked for.
        wanted: String,
        /// The variants of the file.
        known: String,
    },
    /// It would fill the memory.
    #[error("{name} would have more than {most} {what}: leave out copies, or simplify its meshes")]
    TooMuch {
        /// Which file.
        name: String,
        /// What there is too much of.
        what: &'static str,
        /// Most that is allowed.
        most: u64,
    },
    /// Somebody asked for that.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// A buffer that geometry or images need is not there.
    #[error(
        "buffer {index} of {name} cannot be had: {reason}; put all its files beside it, or export it again as .glb"
    )]
    Buffer {
        /// Which file.
        name: String,
        /// Index of the buffer.
        index: usize,
        /// What is wrong.
        reason: String,
    },
}

/// A loaded file.
#[derive(Clone, Debug)]
pub struct Imported {
    /// What to render.
    pub scene: Scene,
    /// What to tell people.
    pub report: ImportReport,
}

/// What of a file is loaded.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Choice {
    /// Images that nothing samples are decoded unless these have [`Skip::IdleTextures`].
    pub skips: Skips,
    /// Variant of its materials \[glTF2, KHR_materials_variants\] by its name; what the file shows by default where there is none.
    pub variant: Option<String>,
}

impl From<Skips> for Choice {
    fn from(skips: Skips) -> Choice {
        Choice { skips, variant: None }
    }
}

/// Largest file that is opened; a GLB cannot be longer.
const MAX_FILE_BYTES: u64 = 4 << 30;

/// Loads a `.glb` or `.gltf` file with the files that it refers to.
///
/// # Errors
/// When the file, its JSON or a buffer cannot be read, or geometry is compressed.
pub fn load(path: &Path) -> Result<Imported, ImportError> {
    load_with(path, Skips::default())
}

/// The same; images that nothing samples are decoded unless `skips` has [`Skip::IdleTextures`].
///
/// # Errors
/// As [`load`].
pub fn load_with(path: &Path, skips: Skips) -> Result<Imported, ImportError> {
    load_chosen(path, &skips.into(), &Stop::default())
}

/// The same as [`load_with`], if nobody asks for a stop meanwhile.
///
/// # Errors
/// As [`load`], and [`ImportError::Stopped`].
pub fn load_until(path: &Path, skips: Skips, stop: &Stop) -> Result<Imported, ImportError> {
    load_chosen(path, &skips.into(), stop)
}

/// The same of a choice of the file.
///
/// # Errors
/// As [`load_until`], and [`ImportError::Variant`].
pub fn load_chosen(path: &Path, choice: &Choice, stop: &Stop) -> Result<Imported, ImportError> {
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
    let locator = Locator::new(Some(path.parent().unwrap_or(Path::new(""))), stop);
    let bytes = files::read_until(path, MAX_FILE_BYTES, stop)
        .map_err(|source| ImportError::Read { path: path.to_owned(), source });
    unless_stopped(bytes.and_then(|bytes| import(&name, &bytes, &locator, choice)), stop)
}

/// Files that a `.glb` or `.gltf` names in its folder or below and that are there, read by a load or not. Of what is no such file none:
/// whoever loads it says why.
pub fn named_files(path: &Path) -> Vec<PathBuf> {
    let Ok(bytes) = files::read_at_most(path, MAX_FILE_BYTES) else { return Vec::new() };
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
    let Ok(container) = container::split(&name, &bytes) else { return Vec::new() };
    let folder = path.parent().unwrap_or(Path::new(""));
    uris(&legible(&container.json)).iter().filter_map(|uri| Some(named_file(folder, uri)?.0)).collect()
}

/// Loads a GLB, or a JSON glTF with data URIs, from memory.
///
/// # Errors
/// As [`load`]; a reference to another file counts as missing.
pub fn load_bytes(name: &str, bytes: &[u8]) -> Result<Imported, ImportError> {
    load_bytes_with(name, bytes, Skips::default())
}

/// The same as [`load_with`] from memory.
///
/// # Errors
/// As [`load_bytes`].
pub fn load_bytes_with(name: &str, bytes: &[u8], skips: Skips) -> Result<Imported, ImportError> {
    load_bytes_until(name, bytes, skips, &Stop::default())
}

/// The same as [`load_until`] from memory.
///
/// # Errors
/// As [`load_bytes`], and [`ImportError::Stopped`].
pub fn load_bytes_until(name: &str, bytes: &[u8], skips: Skips, stop: &Stop) -> Result<Imported, ImportError> {
    unless_stopped(import(name, bytes, &Locator::new(None, stop), &skips.into()), stop)
}

/// What was read; whatever a stop left of it or said of it counts for nothing.
fn unless_stopped(read: Result<Imported, ImportError>, stop: &Stop) -> Result<Imported, ImportError> {
    stop.check()?;
    read
}

fn import(name: &str, bytes: &[u8], locator: &Locator, choice: &Choice) -> Result<Imported, ImportError> {
    let stop = &locator.stop;
    let container = container::split(name, bytes)?;
    let mut notes = Notes::default();
    let Document { root: document, n_animations, skins } = document::read(name, &container.json, &mut notes)?;
    extensions::check(name, &document, choice.variant.is_some(), &mut notes)?;
    let variant = Variant::find(name, &document, choice.variant.as_deref())?;
    let buffers = Buffers::fetch(name, &document, container.bin.as_deref(), locator, &mut notes)?;
    stop.check()?;
    let reader = Reader { document: &document, buffers: &buffers, stop, picked: None };

    let placed = hierarchy::place(&document, &mut notes);
    let mut scene = Scene { name: name.to_owned(), ..Scene::default() };
    let mut profiles = Profiles::new(&document, &buffers, locator);
    let (indices, ranged) = add_nodes(&mut scene, &document, &placed, &mut profiles, &mut notes);
    scene.profiles = profiles.loaded;
    let muted = muted::find(&mut scene, &document, &placed, &indices, &mut notes);
    let (mut slots, mut textures) = assemble::add_materials(&mut scene, &document, &placed, variant, &mut notes);
    muted.switch_on(&mut scene, &document, &placed, &indices, &mut slots);
    if choice.skips.has(Skip::IdleTextures) {
        idle::drop_idle(&mut scene.materials, &mut textures);
        idle::count_idle(&mut scene, &document, &textures, &buffers);
    }
    let mut n_degenerate_triangles = 0;
    let mut sensors = Sensors::find(&document, &placed, &indices, &mut notes);
    let mut surfaces = Vec::new();
    for mut built in assemble::build_geometry(&reader, &scene, &placed, &indices, &slots, &skins, &mut notes)? {
        notes.absorb(std::mem::take(&mut built.notes));
        n_degenerate_triangles = built.n_degenerate_triangles.saturating_add(n_degenerate_triangles);
        surfaces.extend(sensors.take(built));
    }
    surfaces.extend(sensors.lay(&mut scene, &mut notes));
    for surface in surfaces {
        stop.check()?;
        if !merge::append(&mut scene.mesh, surface) {
            notes.warn("the scene has more than 4 billion vertices: the rest is left out".to_owned());
            break;
        }
    }
    merge::pad_attributes(&mut scene.mesh);
    stop.check()?;
    let shown = scene.materials.iter().filter_map(|material| Some(material.base_color_texture?.texture)).collect();
    let decoded = images::decode(&document, &textures, &shown, &buffers, locator, &mut notes);
    scene.textures = decoded.textures;
    scene.dark_materials = missing::leave_out(&mut scene.materials, &decoded.missing, &mut notes);
    scene.dark_materials.extend(dark::put_out(&mut scene.materials, &scene.textures));
    finish::note_layers(&scene.materials, &mut notes);
    opaque::settle(&mut scene);
    assemble::note_instances(&reader, &scene, &placed, &indices, &mut notes);
    note_ranges(&scene, &ranged, &mut notes);
    let made_camera =
        if scene.cameras.is_empty() { viewpoint::make(&scene.mesh, &scene.materials, stop) } else { None };
    // Around a scene at the edge of single precision there is no place for one.
    let made_camera = made_camera.filter(|camera| camera.world_from_camera.is_finite());
    note_motion(n_animations, &mut notes);
    let report = ImportReport {
        unsupported: notes.unsupported,
        warnings: notes.warnings,
        n_nodes: document.nodes.len(),
        n_meshes: document.meshes.len(),
        n_cameras: document.cameras.len(),
        n_materials: document.materials.len(),
        n_images: document.images.len(),
        n_punctual: AsRef::<[Light]>::as_ref(&document).len(),
        n_profiles: scene.profiles.len(),
        n_degenerate_triangles,
        variants: variants::names(&document),
        made_camera: made_camera.is_some(),
        files: locator.files(),
    };
    scene.cameras.extend(made_camera);
    Ok(Imported { scene, report })
}

/// Fills nodes, lamps and cameras; for each placed node its index in `Scene::nodes`, if it carries something, and the lamps
/// of `Scene::punctual` that have a range.
#[expect(
    clippy::cast_possible_truncation,
    reason = "fewer nodes and lamps than bytes of the file, at most 2³²; the side of a panel was held against its range"
)]
fn add_nodes(
    scene: &mut Scene,
    document: &Root,
    placed: &[PlacedNode],
    profiles: &mut Profiles,
    notes: &mut Notes,
) -> (Vec<Option<u32>>, Vec<usize>) {
    let (mut indices, mut ranged) = (Vec::with_capacity(placed.len()), Vec::new());
    let (names, mut camera_names) = (Names::new(document), KeyMaker::default());
    let (ancestors, places) = names::ancestors(document, placed);
    scene.ancestors = ancestors;
    for placed in placed {
        let &PlacedNode { index, visible, parent, .. } = placed;
        let node = &document.nodes[index];
        let extensions = node.extensions.as_ref().filter(|_| visible);
        let light = extensions.and_then(|all| Some(all.khr_lights_punctual.as_ref()?.light));
        let measured = extensions.and_then(|all| all.others.get("EXT_lights_ies"));
        let has_mesh = visible && node.mesh.is_some();
        if !has_mesh && node.camera.is_none() && light.is_none() && measured.is_none() {
            if panel_side(node, index, notes).is_some() {
                let name = called("node", index, node.name.as_ref());
                notes.warn(format!("{name} asks to be a panel but shows no mesh of its own: it is none"));
            }
            indices.push(None);
            continue;
        }
        let node_idx = scene.nodes.len() as u32;
        let name = node.name.clone().filter(|name| !name.is_empty());
        let panel = panel_side(node, index, notes);
        if let Some(spots) = spots::marked(node, index, notes) {
            scene.spots.insert(node_idx, spots);
        }
        let mesh = node.mesh.filter(|_| visible);
        scene.nodes.push(SceneNode {
            index: index as u32,
            name,
            panel,
            parent: parent.and_then(|parent| places[parent]),
            mesh: mesh.and_then(|mesh| names.mesh(mesh.value())),
            lamp: light.and_then(|light| names.lamp(light.value())),
        });
        let plain = light.and_then(|light| lamps::lamp(document, light, placed, node_idx, notes));
        if plain.is_some() && light.and_then(|light| document.get(light)?.range).is_some() {
            ranged.push(scene.punctual.len());
        }
        scene.punctual.extend(match measured {
            Some(instance) => {
                let (has_plain, bare) = (plain.is_some(), lamps::white_point(placed, node_idx));
                let line_name = called("node", index, node.name.as_ref());
                let lamp = profiles.lamp(instance, plain, bare, &line_name, notes);
                if !has_plain && lamp.as_ref().is_some_and(|lamp| lamp.profile.is_none()) {
                    scene.substitute_lamps.insert(node_idx);
                }
                lamp
            }
            None => plain,
        });
        #[expect(clippy::arithmetic_side_effects, reason = "a count of cameras in memory")]
        let number = scene.cameras.len() + 1;
        let camera =
            node.camera.and_then(|camera| cameras::camera(document, camera, placed, node.name.as_ref(), number, notes));
        // Several nodes may show one camera of the file.
        let named_apart =
            |camera: Camera| Camera { name: camera_names.key(Some(&camera.name), index as u32), ..camera };
        scene.cameras.extend(camera.map(named_apart));
        indices.push(Some(node_idx));
    }
    (indices, ranged)
}

/// Lamps with a range, by their keys: those are what people find again.
fn note_ranges(scene: &Scene, ranged: &[usize], notes: &mut Notes) {
    if ranged.is_empty() {
        return;
    }
    let keys = lamp_keys(scene);
    for key in ranged.iter().filter_map(|&lamp| keys.get(lamp)) {
        notes.unsupported(format!(
            "lamp \"{key}\": its range is ignored, light falls off with the square of the distance"
        ));
    }
}

/// Texels per side of a panel.
const PANEL_SIDES: std::ops::RangeInclusive<f64> = 4.0..=64.0;

/// `extras: {"clerestory": {"panel": 32}}`.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "fewer nodes and lamps than bytes of the file, at most 2³²; the side of a panel was held against its range"
)]
fn panel_side(node: &Node, index: usize, notes: &mut Notes) -> Option<u32> {
    let asked = sensors::extra(node, "panel")?;
    // 16.0 is as whole a number as 16.
    let whole = asked.as_f64().filter(|side| side.fract() == 0.0 && PANEL_SIDES.contains(side));
    match whole {
        Some(side) => Some(side as u32),
        None => {
            let name = called("node", index, node.name.as_ref());
            notes.warn(format!(
                "{name}: a panel of {asked} texels a side is not possible (4 to 64): it is a plain light"
            ));
            None
        }
    }
}

/// What moves in the file stands still here.
fn note_motion(n_animations: usize, notes: &mut Notes) {
    if n_animations > 0 {
        notes
            .unsupported(format!("{n_animations} animations: they are not played, everything stands as the nodes say"));
    }
}
