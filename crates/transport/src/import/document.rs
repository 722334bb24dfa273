//! The JSON of a file as `gltf::json::Root`, which the rest of the import reads.
//!
//! That model is stricter than the files that people have: it refuses scenes without `nodes`, animations of kinds that it
//! does not know, members that are `null`, as exporters write what they leave out, and counts written as 24.0. So the JSON is
//! mended first. Nothing is validated: every index must be looked up with `get`.

use std::borrow::Cow;
use std::collections::BTreeSet;

use gltf::json::material::NormalTexture;
use gltf::json::texture::Info;
use gltf::json::validation::USize64;
use gltf::json::{Root, texture};
use serde::Deserialize;
use serde::de::Error as _;
use serde_json::{Map, Number, Value, json};

use super::ImportError;
use super::report::Notes;
use super::skins::Skin;

/// A file's JSON.
pub(super) struct Document {
    /// What is read of it.
    pub root: Root,
    /// Animations, which are not read.
    pub n_animations: usize,
    /// Its skins; `None` for one of another shape than glTF's.
    pub skins: Vec<Option<Skin>>,
}

/// Members that are not read as part of the model, so that nothing odd in them matters: path from the root through all arrays, and name.
const UNREAD: &[(&[&str], &str)] = &[
    (&[], "animations"),
    (&[], "skins"),
    (&["accessors"], "max"),
    (&["accessors"], "min"),
    (&["bufferViews"], "target"),
    (&["cameras"], "orthographic"),
    (&["cameras", "perspective"], "zfar"),
    (&["cameras", "perspective"], "znear"),
    (&["images"], "mimeType"),
    (&["materials"], "occlusionTexture"),
    (&["samplers"], "minFilter"),
];

/// Members that the model demands: path from the root through all arrays, name, and the JSON that stands in.
const DEMANDED: &[(&[&str], &str, &str)] = &[
    (&["accessors"], "componentType", "0"),
    (&["accessors"], "count", "0"),
    (&["accessors"], "type", "\"\""),
    (&["bufferViews"], "buffer", "0"),
    (&["bufferViews"], "byteLength", "0"),
    (&["cameras"], "type", "\"\""),
    (&["cameras", "perspective"], "yfov", "0"),
    (&["cameras", "perspective"], "znear", "0"),
    (&["extensions", "KHR_lights_punctual"], "lights", "[]"),
    (&["extensions", "KHR_lights_punctual", "lights"], "type", "\"\""),
    (&["meshes"], "primitives", "[]"),
    (&["meshes", "primitives"], "attributes", "{}"),
    (&["scenes"], "nodes", "[]"),
];

/// Members that hold an index or the number of a choice, of which some programs write −1 where there is none.
const NUMBERED: &[&str] = &[
    "bufferView",
    "camera",
    "index",
    "indices",
    "inverseBindMatrices",
    "light",
    "magFilter",
    "material",
    "mesh",
    "mode",
    "sampler",
    "scene",
    "skin",
    "source",
    "texCoord",
    "wrapS",
    "wrapT",
];

/// The extension that has lamps.
const LAMPS: &str = "KHR_lights_punctual";

/// Colors of materials and lamps, and how many numbers each has.
const COLORS: &[(&str, usize)] = &[
    ("attenuationColor", 3),
    ("baseColorFactor", 4),
    ("color", 3),
    ("diffuseFactor", 4),
    ("diffuseTransmissionColorFactor", 3),
    ("emissiveFactor", 3),
    ("sheenColorFactor", 3),
    ("specularColorFactor", 3),
    ("specularFactor", 3),
];

/// The text of a document without a mark before it and padding behind it; letters that cannot be read are replaced.
pub fn legible(text: &[u8]) -> Cow<'_, str> {
    let mut text = text.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(text);
    while let [head @ .., 0 | b' '] = text {
        text = head;
    }
    String::from_utf8_lossy(text)
}

/// Reads the JSON of a file; blanks and zeros that fill a chunk up may follow it, and a byte order mark may stand before it.
///
/// # Errors
/// When it is not JSON, of no version or another one than 2 or for readers of a newer one, or of another shape than glTF's; the place is named.
pub(super) fn read(name: &str, text: &[u8], notes: &mut Notes) -> Result<Document, ImportError> {
    let broken = |source| ImportError::Json { name: name.to_owned(), source };
    let text = legible(text);
    if matches!(text, Cow::Owned(_)) {
        notes.warn("its text is not all UTF-8: letters of names that cannot be read are shown as \u{FFFD}".to_owned());
    }
    let mut value: Value = serde_json::from_str(&text).map_err(broken)?;
    let mut broken_lists = BTreeSet::new();
    tidy(&mut value, &mut broken_lists);
    for key in broken_lists {
        notes
            .warn(format!("`{key}` holds null where a number belongs, as of one that is none: it is read as left out"));
    }
    let Some(version) = value.pointer("/asset/version").and_then(Value::as_str) else {
        return Err(ImportError::NoVersion { name: name.to_owned() });
    };
    if version.split('.').next() != Some("2") {
        return Err(ImportError::Version { name: name.to_owned(), version: version.to_owned() });
    }
    if let Some(min_version) = value.pointer("/asset/minVersion").and_then(Value::as_str)
        && !is_readable(min_version)
    {
        return Err(ImportError::MinVersion { name: name.to_owned(), min_version: min_version.to_owned() });
    }
    let items = |key: &str| value.get(key).and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    let n_animations = items("animations").len();
    let skins = items("skins").iter().map(|skin| Skin::deserialize(skin).ok()).collect();
    note_lost_displacements(&value, notes);
    mend(&mut value);
    mend_colors(&mut value, notes);
    let root = Root::deserialize(&value).map_err(|error| broken(located(&value, error)))?;
    Ok(Document { root, n_animations, skins })
}

/// Whether a reader of glTF 2.0 may read what asks for a version at least.
fn is_readable(min_version: &str) -> bool {
    let parts = min_version.split_once('.').map(|(major, minor)| (major.parse::<u32>(), minor.parse::<u32>()));
    matches!(parts, Some((Ok(major), Ok(minor))) if (major, minor) <= (2, 0))
}

/// Takes members that say nothing from all objects but extras, and lists of numbers with a `null` among them, which it names. Writes
/// whole numbers as such.
fn tidy(value: &mut Value, broken_lists: &mut BTreeSet<String>) {
    match value {
        Value::Array(items) => items.iter_mut().for_each(|item| tidy(item, broken_lists)),
        Value::Object(members) => {
            members.retain(|key, member| {
                let is_broken = key != "extras" && is_broken_list(member);
                // Bounds of accessors are read by nobody.
                if is_broken && !["min", "max"].contains(&key.as_str()) {
                    broken_lists.insert(key.clone());
                }
                !is_broken && !says_nothing(key, member)
            });
            let read = members.iter_mut().filter(|(key, _)| *key != "extras");
            read.for_each(|(_, member)| tidy(member, broken_lists));
        }
        Value::Number(number) => {
            if let Some(whole) = whole(number) {
                *number = whole.into();
            }
        }
        _ => {}
    }
}

/// Whether a member is there and yet says nothing in glTF: `null`, an index of −1, an empty address.
fn says_nothing(key: &str, member: &Value) -> bool {
    let is_no_index = || NUMBERED.contains(&key) && member.as_f64() == Some(-1.0);
    member.is_null() || is_no_index() || (key == "uri" && member.as_str() == Some(""))
}

/// Whether of a list of numbers some are none.
fn is_broken_list(value: &Value) -> bool {
    let items = value.as_array().map_or(&[][..], Vec::as_slice);
    items.len() > 1 && items.iter().any(Value::is_null) && items.iter().all(|item| item.is_null() || item.is_number())
}

/// What a number such as 24.0 counts: JSON knows no difference to 24.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "whole, and within the range in which all whole numbers are"
)]
fn whole(number: &Number) -> Option<u64> {
    let float = number.as_f64().filter(|_| number.is_f64())?;
    (float.fract() == 0.0 && (0.0..=MOST_WHOLE).contains(&float)).then_some(float as u64)
}

/// Up to here a float has every whole number.
const MOST_WHOLE: f64 = (1_u64 << 53) as f64;

/// Tells of morph targets with weight that displace texture coordinates or colors, for which the model has no room.
fn note_lost_displacements(root: &Value, notes: &mut Notes) {
    let mut weighted = BTreeSet::new();
    let mut weigh = |mesh: usize, weights: &Value| {
        let has_weight = |weight: &Value| weight.as_f64().is_some_and(|weight| weight != 0.0);
        let targets = items_of(weights).enumerate().filter(|(_, weight)| has_weight(weight));
        weighted.extend(targets.map(|(target, _)| (mesh, target)));
    };
    items_of(&root["meshes"]).enumerate().for_each(|(index, mesh)| weigh(index, &mesh["weights"]));
    for node in items_of(&root["nodes"]) {
        if let Some(mesh) = node["mesh"].as_u64().and_then(|mesh| usize::try_from(mesh).ok()) {
            weigh(mesh, &node["weights"]);
        }
    }
    let is_lost = |key: &String| key.starts_with("TEXCOORD_") || key.starts_with("COLOR_");
    for (index, mesh) in items_of(&root["meshes"]).enumerate() {
        let loses = |(target, displaced): (usize, &Value)| {
            weighted.contains(&(index, target)) && displaced.as_object().is_some_and(|all| all.keys().any(is_lost))
        };
        if items_of(&mesh["primitives"]).any(|primitive| items_of(&primitive["targets"]).enumerate().any(loses)) {
            let name = mesh["name"].as_str().map(str::to_owned);
            let name = called("mesh", index, name.as_ref());
            notes.unsupported(format!("{name}: its morph targets leave texture coordinates and colors as they are"));
        }
    }
}

fn mend(root: &mut Value) {
    for (path, name) in UNREAD {
        each_object(root, path, &mut |members| {
            members.remove(*name);
        });
    }
    for (path, name, text) in DEMANDED {
        let stand_in: Value = serde_json::from_str(text).expect("the table holds JSON");
        each_object(root, path, &mut |members| {
            members.entry(*name).or_insert_with(|| stand_in.clone());
        });
    }
    each_object(root, &["materials"], &mut forget_uses_of_nothing);
    each_object(root, &["nodes", "extensions"], &mut |members| {
        members.retain(|key, member| key != LAMPS || member.get("light").is_some());
    });
}

/// Gives colors of materials and lamps as many numbers as glTF has for them: some programs write an alpha where there is none, or leave
/// it out.
fn mend_colors(root: &mut Value, notes: &mut Notes) {
    let mut odd = BTreeSet::new();
    let paths: [&[&str]; 2] = [&["materials"], &["extensions", LAMPS, "lights"]];
    for path in paths {
        each_object(root, path, &mut |members| fit_colors(members, &mut odd));
    }
    for key in odd {
        notes.warn(format!(
            "`{key}` holds an alpha where glTF has none, or none where it has one: that is left out, or taken for 1"
        ));
    }
}

/// The same of an object and all that is part of it; keys of those that were too long or too short.
fn fit_colors(members: &mut Map<String, Value>, odd: &mut BTreeSet<String>) {
    for (key, member) in members.iter_mut().filter(|(key, _)| *key != "extras") {
        match member {
            Value::Object(members) => fit_colors(members, odd),
            Value::Array(numbers) if matches!(numbers.len(), 3 | 4) => {
                let wanted = COLORS.iter().find(|(color, _)| key == color).map(|(_, n_numbers)| *n_numbers);
                if let Some(n_numbers) = wanted.filter(|n_numbers| *n_numbers != numbers.len()) {
                    numbers.resize(n_numbers, json!(1));
                    odd.insert(key.clone());
                }
            }
            _ => {}
        }
    }
}

/// Takes uses of textures that name none from a material and all that is part of it.
fn forget_uses_of_nothing(members: &mut Map<String, Value>) {
    members.retain(|key, member| !(key.ends_with("Texture") && member.is_object() && member.get("index").is_none()));
    for (_, member) in members.iter_mut().filter(|(key, _)| *key != "extras") {
        each_object(member, &[], &mut forget_uses_of_nothing);
    }
}

/// Every object at a path of keys; arrays on the way are walked through.
fn each_object(value: &mut Value, path: &[&str], change: &mut impl FnMut(&mut Map<String, Value>)) {
    match (value, path.split_first()) {
        (Value::Array(items), _) => items.iter_mut().for_each(|item| each_object(item, path, change)),
        (Value::Object(members), None) => change(members),
        (Value::Object(members), Some((first, rest))) => {
            if let Some(member) = members.get_mut(*first) {
                each_object(member, rest, change);
            }
        }
        _ => {}
    }
}

/// The error with the first part that causes one by itself, as `nodes[3]: …`.
fn located(root: &Value, error: serde_json::Error) -> serde_json::Error {
    let reason_of = |key: &str, member: Value| {
        let mut alone = json!({"asset": {"version": "2.0"}});
        alone[key] = member;
        Root::deserialize(&alone).err()
    };
    let found = root.as_object().into_iter().flatten().find_map(|(key, member)| {
        let of_items = items_of(member).enumerate().find_map(|(index, item)| {
            let reason = reason_of(key, json!([item]))?;
            Some(format!("{key}[{index}]: {reason}"))
        });
        let of_lamps = items_of(&member[LAMPS]["lights"]).enumerate().find_map(|(index, lamp)| {
            let reason = reason_of(key, json!({LAMPS: {"lights": [lamp]}}))?;
            Some(format!("{key}.{LAMPS}.lights[{index}]: {reason}"))
        });
        of_items.or(of_lamps).or_else(|| Some(format!("{key}: {}", reason_of(key, member.clone())?)))
    });
    found.map_or(error, serde_json::Error::custom)
}

fn items_of(value: &Value) -> impl Iterator<Item = &Value> {
    value.as_array().into_iter().flatten()
}

/// KHR_materials_pbrSpecularGlossiness.
#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct SpecularGlossiness {
    pub diffuse_factor: Option<[f32; 4]>,
    pub diffuse_texture: Option<Info>,
    pub glossiness_factor: Option<f32>,
    pub specular_factor: Option<[f32; 3]>,
    pub specular_glossiness_texture: Option<Info>,
}

/// A normal map as any other use of a texture, without its scale.
pub(super) fn plain_use(normal: &NormalTexture) -> Info {
    let transform = normal.extensions.as_ref().and_then(|extensions| extensions.others.get("KHR_texture_transform"));
    let texture_transform = transform.and_then(|transform| Deserialize::deserialize(transform).ok());
    let extensions = gltf::json::extensions::texture::Info { texture_transform, others: Map::new() };
    texture::Info { index: normal.index, tex_coord: normal.tex_coord, extensions: Some(extensions), extras: None }
}

/// A size in bytes or elements; what memory cannot hold is the largest one, which no buffer has.
pub(super) fn size(value: USize64) -> usize {
    usize::try_from(value.0).unwrap_or(usize::MAX)
}

/// A name for a report line: quoted if the file has one, else the index.
pub(super) fn called(kind: &str, index: usize, name: Option<&String>) -> String {
    match name.filter(|name| !name.is_empty()) {
        Some(name) => format!("{kind} {}", shown(name)),
        None => format!("{kind} {index}"),
    }
}

/// Most letters of a name that a message has.
const MOST_SHOWN: usize = 120;

/// A name in quotes as messages have it: on one line, and of a long one the beginning.
pub(super) fn shown(name: &str) -> String {
    let (beginning, more) = match name.char_indices().nth(MOST_SHOWN) {
        Some((end, _)) => (&name[..end], "…"),
        None => (name, ""),
    };
    format!("\"{}\"{more}", beginning.replace(char::is_control, " "))
}
