//! The one undoable document: how the lights are set and how the picture is shown. A `.look` file is this, as JSON.

// What is read here was written by strangers, so no integer may wrap in silence.
#![cfg_attr(not(test), deny(clippy::arithmetic_side_effects))]
#![cfg_attr(not(test), deny(clippy::cast_possible_truncation, clippy::cast_sign_loss))]

pub mod bookmarks;
mod damage;
mod differences;
pub mod display;
pub mod fade;
pub mod groups;
pub mod lamps;
mod marked;
mod on_disk;
mod parse;
mod place;
pub mod presets;
mod repeated;
pub mod scene;
pub mod sky;
pub mod snapshot;
pub mod timeline;
pub mod wishes;
mod write;

use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clerestory_transport::basis::{LightBasis, Unheeded};
use clerestory_transport::camera::Camera;
use clerestory_transport::lamps::FreeLamp;
use clerestory_transport::light::LightRig;
use serde_json::Value;

use crate::marks::{Marked, Probed};
use crate::output::write_whole;
use crate::words::{in_words, unmarked};
pub use display::{Display, FalseColor, Quantity, Units};
use lamps::MAX_LAMPS;
pub use on_disk::OnDisk;
use scene::SceneChoice;
use snapshot::Snapshot;
use timeline::Timeline;
use wishes::Wishes;

/// Version that this program writes and the newest that it reads.
pub const LOOK_VERSION: u64 = 1;

/// Longest file that is read.
const MAX_BYTES: u64 = 16 << 20;

/// How a scene is lit and shown. What it leaves out keeps the scene's value.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Look {
    /// Settings by lamp, and spots by panel.
    pub lights: LightRig,
    /// What lights and groups are called, by their keys; what it leaves out is called by its key.
    pub names: BTreeMap<String, String>,
    /// How radiance becomes a picture.
    pub display: Display,
    /// Looks that were kept, each under a name.
    pub snapshots: Vec<Snapshot>,
    /// Name of the one that the present look came from.
    pub on: Option<String>,
    /// Which of them is to be seen when.
    pub timeline: Timeline,
    /// What is made of the scene before it is baked.
    pub scene: SceneChoice,
    /// Views to come back to.
    pub bookmarks: Vec<Camera>,
    /// What is wished for, and what may change for it.
    pub wishes: Wishes,
    /// What is marked in the picture.
    pub marks: Option<Marked>,
    /// Probes that stay, by the view that they are in.
    pub probes: Vec<Probed>,
}

impl Look {
    /// The look that a scene is opened with: what is off in its file is muted.
    pub fn of_file(basis: &LightBasis) -> Look {
        Look { lights: basis.file_rig(), ..Look::default() }
    }

    /// Reads a look, and a sentence for each key that is not known.
    ///
    /// # Errors
    /// Names line, column and key of a value that is missing, of the wrong type or out of range.
    pub fn from_json(json: &str) -> Result<(Look, Vec<String>)> {
        parse::look(json, parse::OnFault::Refuse)
    }

    /// Reads what can be read of a damaged look, and a sentence for each fault, with its line and column.
    ///
    /// # Errors
    /// If it is no look at all, or of a newer program.
    pub fn recover(json: &str) -> Result<(Look, Vec<String>)> {
        parse::look(json, parse::OnFault::LeaveOut)
    }

    /// Readable JSON with what differs from the scene.
    pub fn to_json(&self) -> String {
        write::json(self, None)
    }

    /// What a light is called.
    pub fn name_of<'a>(&'a self, key: &'a str) -> &'a str {
        self.names.get(key).map_or(key, String::as_str)
    }

    /// A sentence that names lights by their keys, `like this`, with what they are called here.
    pub fn renamed(&self, sentence: &str) -> String {
        let parts = sentence.split('`').enumerate();
        // Every other part stands between two marks.
        let called: Vec<&str> = parts.map(|(nth, part)| if nth % 2 == 1 { self.name_of(part) } else { part }).collect();
        called.join("`")
    }

    /// A sentence for each light that it sets without effect on a scene.
    pub fn unheeded(&self, basis: &LightBasis) -> Vec<String> {
        let words = |(key, why): (&str, Unheeded)| match why {
            Unheeded::Unknown => format!("the look sets `{key}`, which this scene does not have; it is ignored"),
            Unheeded::NoPanel => format!("the look puts spots on `{key}`, which is no panel; they are ignored"),
            // Lights are found by their keys, whatever they are called here.
            Unheeded::Taken => format!(
                "the look has a lamp `{key}`, whose key “{key}” is that of a light of the scene; \
                 give the lamp another key in the look's file, or the light another name in the scene's"
            ),
        };
        // Of a panel that is still to be made more is told elsewhere.
        let counts = |(key, why): &(&str, Unheeded)| *why != Unheeded::NoPanel || !self.scene.panels.contains_key(*key);
        let unknown = self.scene.panels.keys().filter(|node| basis.source(node).is_none());
        let unknown = unknown.map(|node| {
            format!("the look makes `{node}` a panel, but this scene has no light of that name; it is ignored")
        });
        let stand_ins = self.lights.lamps.iter().filter_map(|lamp| self.misplaced(lamp, basis));
        basis
            .unheeded_keys(&self.lights)
            .into_iter()
            .filter(counts)
            .map(words)
            .chain(unknown)
            .chain(stand_ins)
            .map(|words| self.renamed(&words))
            .collect()
    }

    /// A sentence on a lamp that replaces no light of a scene, or one that shines as if nothing replaced it.
    fn misplaced(&self, lamp: &FreeLamp, basis: &LightBasis) -> Option<String> {
        let (key, replaced) = (&lamp.key, lamp.replaces.as_ref()?);
        let words = format!("the lamp `{key}` of the look replaces `{replaced}`, which");
        if basis.source(replaced).is_none() {
            return Some(format!("{words} this scene does not have"));
        }
        // On the way from one look to another both may shine, each of them dimmed.
        let is_untouched = !self.lights.lights.contains_key(replaced) && !self.lights.setting(replaced).muted;
        (is_untouched && !lamp.setting.muted).then(|| {
            format!("{words} shines as in the file beside it: mute that light in the look, or leave the lamp out")
        })
    }

    /// Reads a file and the sky that it names, relative to its folder; see [`Look::from_json`].
    ///
    /// # Errors
    /// If a file cannot be read, or holds no look or no sky.
    pub fn load(path: &Path) -> Result<(Look, Vec<String>)> {
        let problem = || format!("cannot use the look {}", path.display());
        let (mut look, mut warnings) = Look::from_json(&read_text(path)?).with_context(problem)?;
        let (mut maps, folder) = (sky::Maps::default(), path.parent().unwrap_or(Path::new("")));
        for sky in look.rigs_mut().filter_map(|rig| rig.sky.as_mut()) {
            warnings.extend(maps.load(sky, folder).with_context(problem)?);
        }
        Ok((look, warnings))
    }

    /// Reads what can be read of a file, for somebody who can look at the rest; see [`Look::recover`]. A sky that cannot be
    /// had is left out too, and so is a lamp without its profile; paths of both become absolute.
    ///
    /// # Errors
    /// If the file cannot be read or is no look at all.
    pub fn load_readable(path: &Path) -> Result<(Look, Vec<String>)> {
        Look::load_as_it_stands(path).map(|(look, warnings, _)| (look, warnings))
    }

    /// The same, and how the file stood when it was read.
    ///
    /// # Errors
    /// As [`Look::load_readable`].
    pub fn load_as_it_stands(path: &Path) -> Result<(Look, Vec<String>, OnDisk)> {
        let problem = || format!("cannot use the look {}", path.display());
        let text = read_text(path)?;
        let (look, warnings) = Look::recover_in(&text, path.parent().unwrap_or(Path::new(""))).with_context(problem)?;
        Ok((look, warnings, OnDisk::of(text.as_bytes())))
    }

    /// Reads what can be read of a look whose paths are relative to `folder`; see [`Look::recover`].
    ///
    /// # Errors
    /// As [`Look::recover`].
    pub fn recover_in(json: &str, folder: &Path) -> Result<(Look, Vec<String>)> {
        let (mut look, mut warnings) = Look::recover(json)?;
        let mut maps = sky::Maps::default();
        for rig in look.rigs_mut() {
            match rig.sky.as_mut().map(|sky| maps.load(sky, folder)) {
                Some(Ok(odd)) => warnings.extend(odd),
                Some(Err(error)) => {
                    warnings.push(format!("{}; the sky of the look is left out", in_words(&error)));
                    rig.sky = None;
                }
                None => {}
            }
            rig.sky.iter_mut().for_each(|sky| sky::resolve(sky, folder));
            warnings.extend(lamps::resolve(&mut rig.lamps, folder));
        }
        look.wishes.resolve(folder);
        Ok((look, warnings))
    }

    /// Names all files from the root that were named relative to `folder`.
    pub fn resolve(&mut self, folder: &Path) {
        for rig in self.rigs_mut() {
            rig.sky.iter_mut().for_each(|sky| sky::resolve(sky, folder));
            rig.lamps.iter_mut().for_each(|lamp| lamps::root(lamp, folder));
        }
        self.wishes.resolve(folder);
    }

    /// What a file at `path` holds of a look that may be for a scene: files of its own folder are named relative to that.
    pub fn json_for(&self, path: &Path, scene: Option<&Path>) -> String {
        let (mut look, folder) = (self.clone(), path.parent().unwrap_or(Path::new("")));
        for rig in look.rigs_mut() {
            rig.lamps = lamps::relative(&rig.lamps, folder);
            rig.sky.iter_mut().for_each(|sky| sky::relative(sky, folder));
        }
        look.wishes.relative(folder);
        let from_root = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.into());
        let own = from_root(path);
        let scene = scene.map(|scene| {
            let scene = from_root(scene);
            let beside = own.parent().and_then(|folder| scene.strip_prefix(folder).ok());
            beside.unwrap_or(&scene).display().to_string()
        });
        write::json(&look, scene.as_deref())
    }

    /// Writes a file, whole or not at all, and says how it stands now. Profiles of lamps and skies in its folder are named
    /// relative to it.
    ///
    /// # Errors
    /// If the file cannot be written, or would be too long or have too many lamps to be read again.
    pub fn save(&self, path: &Path) -> Result<OnDisk> {
        self.save_for(path, None)
    }

    /// The same, and names the scene that it is for, with which it is opened where nobody names another one.
    ///
    /// # Errors
    /// As [`Look::save`].
    pub fn save_for(&self, path: &Path, scene: Option<&Path>) -> Result<OnDisk> {
        let most = self.rigs().map(|rig| rig.lamps.len()).max().unwrap_or(0);
        anyhow::ensure!(
            most <= MAX_LAMPS,
            "{} would have {most} lamps in one look and could not be opened again; a look holds {MAX_LAMPS} at most: \
             delete some first, or take a cross-fade to one of its ends",
            path.display()
        );
        let json = self.json_for(path, scene);
        let is_readable = json.len() as u64 <= MAX_BYTES;
        anyhow::ensure!(is_readable, "{} would be too long to be opened again; delete looks first", path.display());
        write_whole(path, json.as_bytes())?;
        Ok(OnDisk::of(json.as_bytes()))
    }
}

/// Whether a file is a look, whatever it is called: it says so, and can be read as one.
pub fn is_look(path: &Path) -> bool {
    // Of a pipe nothing is read.
    let text = path.is_file().then(|| read_text(path).ok()).flatten();
    let says_so = |text: &str| {
        let document = serde_json::from_str::<Value>(unmarked(text));
        document.is_ok_and(|document| document.get("clerestory").is_some())
    };
    text.is_some_and(|text| says_so(&text) && Look::from_json(&text).is_ok())
}

/// The scene that the look of a file is for, from the root: where the file says so, and it is still there.
pub fn scene_of_file(path: &Path) -> Option<PathBuf> {
    named_scene(path).filter(|scene| scene.exists())
}

/// The same, there or not. Of a pipe nothing is read: whoever read it has what it gave.
pub fn named_scene(path: &Path) -> Option<PathBuf> {
    let text = path.is_file().then(|| read_text(path).ok()).flatten()?;
    let document: Value = serde_json::from_str(unmarked(&text)).ok()?;
    let scene = path.parent()?.join(document.get("scene_file")?.as_str()?);
    Some(std::path::absolute(&scene).unwrap_or(scene))
}

/// The first of `stem 1`, `stem 2` … that is not taken; without a stem the number alone.
pub fn numbered_name(stem: &str, is_taken: impl Fn(&str) -> bool) -> String {
    let mut names = (1..).map(|n| format!("{stem} {n}").trim_start().to_owned());
    names.find(|name| !is_taken(name)).expect("numbers do not end")
}

/// Text of a look; more than `MAX_BYTES` is none.
fn read_text(path: &Path) -> Result<String> {
    let problem = || format!("cannot read the look {}: check the path", path.display());
    let mut bytes = Vec::new();
    let file = std::fs::File::open(path).with_context(problem)?;
    file.take(MAX_BYTES + 1).read_to_end(&mut bytes).with_context(problem)?;
    anyhow::ensure!(bytes.len() as u64 <= MAX_BYTES, "{} is longer than any look", path.display());
    String::from_utf8(bytes).with_context(|| format!("cannot use the look {}: it is no text", path.display()))
}

#[cfg(test)]
mod tests {
    use clerestory_transport::light::{LightGroup, LightSetting, PanelSpot};
    use clerestory_transport::sky::{SkySetting, SunSetting};

    use super::*;

    fn rich() -> Look {
        let mut look = Look { display: Display { exposure_ev: Some(-1.25), ..Display::default() }, ..Look::default() };
        let setting = LightSetting { intensity: 0.2, color: Some([1.0, 0.1, 0.0]), kelvin: Some(3000.0), muted: true };
        look.lights.lights.insert("Pendant, \"A\"\n#2".into(), setting);
        let spot = PanelSpot { position: [0.5, -0.25], radius: 0.2, color: None, intensity: 1.5 };
        look.lights.panels.insert("Ceiling".into(), vec![spot, PanelSpot { color: Some([0.3; 3]), ..spot }]);
        look.lights.panels.insert("Dark".into(), vec![]);
        let lights = ["Ceiling".to_owned(), "Dark".to_owned()].into();
        look.lights.groups.insert("kind:Panels".into(), LightGroup { lights, intensity: 0.5, muted: true });
        look.names.insert("Dark".into(), "Wall, \"left\"".into());
        look
    }

    #[test]
    fn a_look_is_told_by_what_it_holds() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("best.json");
        assert!(!is_look(&path), "it is not there");
        rich().save(&path).unwrap();
        assert!(is_look(&path));
        for other in [r#"{"wishes": [{"times": 2}]}"#, r#"{"lights": {}}"#, r#"{"clerestory": 99}"#, "PNG"] {
            std::fs::write(&path, other).unwrap();
            assert!(!is_look(&path), "{other}");
        }
    }

    #[test]
    fn a_name_is_numbered_until_it_is_free() {
        assert_eq!(numbered_name("Spot", |name| name == "Spot 1"), "Spot 2");
        assert_eq!(numbered_name("", |name| name == "1"), "2");
    }

    #[test]
    fn what_is_written_comes_back_without_a_warning() {
        for look in [Look::default(), rich()] {
            let json = look.to_json();
            let (back, warnings) = Look::from_json(&json).unwrap();
            assert_eq!(back, look, "{json}");
            assert!(warnings.is_empty(), "{warnings:?}");
        }
    }

    #[test]
    fn skies_of_one_file_share_its_map() {
        let folder = tempfile::tempdir().unwrap();
        let head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n";
        std::fs::write(folder.path().join("day.hdr"), [&head[..], &[32, 64, 128, 131, 32, 64, 128, 131]].concat())
            .unwrap();
        let json = r#"{"clerestory": 1, "sky": {"file": "day.hdr"}, "looks": [{"name": "A", "sky": {"file": "./day.hdr", "rotation_deg": 30}},
            {"name": "B", "sky": {"file": "day.hdr"}}, {"name": "C", "sky": {"file": "uniform"}}]}"#;
        let path = folder.path().join("a.look");
        std::fs::write(&path, json).unwrap();
        for (look, warnings) in [Look::load(&path).unwrap(), Look::load_readable(&path).unwrap()] {
            assert_eq!(warnings, Vec::<String>::new());
            let own = look.lights.sky.as_ref().and_then(|sky| sky.map.clone()).expect("a map");
            let maps = look.snapshots.iter().filter_map(|kept| kept.lights.sky.as_ref()?.map.as_ref());
            let shared: Vec<bool> = maps.map(|map| std::sync::Arc::ptr_eq(map, &own)).collect();
            assert_eq!(shared, [true, true, false]);
        }
    }

    #[test]
    fn numbers_survive_saving_to_the_last_bit() {
        let mut bits = 20_261_122_u64;
        let mut draw = move || {
            // The upper bits of a linear congruence are random enough here.
            bits = bits.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            bits >> 11
        };
        let mut unit = || draw() as f64 / (1_u64 << 53) as f64;
        for _ in 0..20_000 {
            let mut look = Look::default();
            let power = |share: f64| 10f64.powf(20.0 * share - 12.0) as f32;
            let setting = LightSetting { intensity: power(unit()), ..LightSetting::default() };
            look.lights.lights.insert("lamp".into(), setting);
            let mut sun = SunSetting::by_angles(360.0 * unit(), 90.0 * unit() - 0.5);
            sun.intensity = power(unit());
            look.lights.sky =
                Some(SkySetting { sun: Some(sun), rotation_deg: 360.0 * unit() as f32, ..SkySetting::default() });
            let (back, warnings) = Look::from_json(&look.to_json()).unwrap();
            assert!(back == look && warnings.is_empty(), "{} {warnings:?}", look.to_json());
        }
    }

    #[test]
    fn a_file_that_would_not_be_read_again_is_not_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.look");
        let mut look = Look::default();
        look.names.insert("lamp".into(), "x".repeat(MAX_BYTES as usize));
        let said = look.save(&path).unwrap_err().to_string();
        assert!(said.contains("too long") && !path.exists(), "{said}");
    }

    #[test]
    fn a_look_names_the_scene_that_it_was_saved_for() {
        let folder = tempfile::tempdir().unwrap();
        let [within, beside] = ["looks", "other"].map(|name| folder.path().join(name));
        for folder in [&within, &beside] {
            std::fs::create_dir(folder).unwrap();
        }
        let look_file = within.join("a.look");
        let named = |scene: &Path| {
            rich().save_for(&look_file, Some(scene)).unwrap();
            assert_eq!(Look::load(&look_file).unwrap(), (rich(), vec![]));
            scene_of_file(&look_file)
        };
        for scene in [within.join("room.glb"), beside.join("hall.glb")] {
            assert_eq!(named(&scene), None, "it is not there");
            std::fs::write(&scene, "").unwrap();
            assert_eq!(named(&scene), Some(scene));
        }
        named(&within.join("room.glb"));
        assert!(std::fs::read_to_string(&look_file).unwrap().contains("\"scene_file\": \"room.glb\""));
        rich().save(&look_file).unwrap();
        assert_eq!(scene_of_file(&look_file), None);
    }

    #[test]
    fn settings_that_change_nothing_are_left_out() {
        let mut look = Look::default();
        look.lights.lights.insert("same".into(), LightSetting::default());
        assert!(!look.to_json().contains("same"));
    }

    #[test]
    fn the_example_of_the_manual_is_read() {
        let json = r#"{"clerestory": 1, "lights": {"KEY": {"intensity": 1.0, "color": [1, 1, 1], "kelvin": 3000, "muted": false}},
            "panels": {"KEY": [{"position": [0.5, 0.5], "radius": 0.2, "color": [1, 1, 1], "intensity": 1.0}]},
            "sky": {"file": "day.hdr", "rotation_deg": 0, "intensity": 1, "sun": {"azimuth_deg": 135, "elevation_deg": 40,
            "turbidity": 3, "intensity": 1}}, "display": {"exposure_ev": 0.0, "metering": "auto", "compensation_ev": 0, "tone": "agx", "white_kelvin": 3000,
            "white_duv": 0, "dither": false, "false_color": {"quantity": "luminance", "spacing": "log", "range": [1, 1000]}},
            "lamps": [{"key": "Lamp 1", "type": "spot", "position": [0, 2.4, 0], "aim": [0, 0, 0], "inner_deg": 20, "outer_deg": 30,
            "strength": 800, "unit": "lm", "intensity": 1.0, "color": [1, 1, 1], "kelvin": 3000, "muted": false}],
            "groups": {"Desks": {"lights": ["KEY", "Lamp 1"], "intensity": 0.5, "muted": false}}, "names": {"KEY": "Desk lamp"}}"#;
        let (look, warnings) = Look::from_json(json).unwrap();
        assert!(warnings.is_empty(), "{warnings:?}");
        assert_eq!(look.lights.lights["KEY"].kelvin, Some(3000.0));
        assert_eq!(look.lights.panels["KEY"][0].radius, 0.2);
        assert_eq!(look.display.exposure_ev, Some(0.0));
        assert_eq!(look.lights.lamps[0].strength, 800.0);
        assert_eq!((look.lights.groups["Desks"].intensity, look.names["KEY"].as_str()), (0.5, "Desk lamp"));
    }

    #[test]
    fn sentences_call_lights_by_their_names() {
        let look = rich();
        assert_eq!(look.renamed("`Dark` and `Ceiling` are off"), "`Wall, \"left\"` and `Ceiling` are off");
        assert_eq!(look.renamed("it is Dark, `Dark"), "it is Dark, `Wall, \"left\"");
        assert_eq!(look.renamed(""), "");
        let of_nothing = look.unheeded(&LightBasis::new(Vec::new()));
        assert!(of_nothing.iter().any(|words| words.contains("`Wall, \"left\"`")), "{of_nothing:?}");
    }

    #[test]
    fn the_version_may_be_written_as_any_number() {
        assert!(Look::from_json(r#"{"clerestory": 1.0}"#).unwrap().1.is_empty());
        for version in ["1.5", "0", "-1", "0.0"] {
            let error = Look::from_json(&format!(r#"{{"clerestory": {version}}}"#)).unwrap_err().to_string();
            assert!(error.contains("version number 1"), "{error}");
        }
        assert!(Look::from_json(r#"{"clerestory": 2.0}"#).unwrap_err().to_string().contains("newer"));
    }

    #[test]
    fn unknown_keys_are_reported_at_every_level() {
        let json = r#"{"clerestory": 1, "a": 0, "lights": {"L": {"b": 0}}, "panels": {"P": [{"c": 0, "position": [0, 0],
            "radius": 1}]}, "display": {"d": 0}}"#;
        let (_, warnings) = Look::from_json(json).unwrap();
        assert_eq!(warnings.len(), 4, "{warnings:?}");
        for key in ["a", "lights.L.b", "panels.P[0].c", "display.d"] {
            assert!(warnings.iter().any(|w| w.contains(&format!("`{key}`"))), "{key} is not in {warnings:?}");
        }
    }

    #[test]
    fn a_fault_is_told_with_its_line_and_column() {
        for (json, place) in [
            ("{\n  \"clerestory\": 1,\n  \"lights\": {\n    \"L\": { \"muted\": 1 }\n  }\n}", "line 4, column 21"),
            (
                "{\"clerestory\": 1,\n\"display\": {\"tone\": \"se\\\"pia\", \"exposure_ev\": true}}",
                "line 2, column 47",
            ),
            ("{\"clerestory\": 1, \"lights\":\n{\"\\u004c\": {\"color\": [1, \"}\", 2]}}}", "line 2, column 22"),
            ("{\"panels\": {\"P\": [{\"position\": [0, 0],\n\"radius\": 1}, {\n\"radius\": 1}]}}", "line 2, column 15"),
            (
                "{\"clerestory\": 1, \"sky\": {\n\t\"sun\": {\"azimuth_deg\": \"é\", \"elevation_deg\": 3}}}",
                "line 2, column 25",
            ),
            ("{\"clerestory\": 1,\n\"lights\": {\"L\"}}", "line 2 column 15"),
        ] {
            let error = format!("{:#}", Look::from_json(json).unwrap_err());
            assert!(error.contains(place), "{json}: {error}");
        }
    }

    #[test]
    fn of_a_damaged_look_what_can_be_read_is_kept() {
        let json = "{\"clerestory\": 1, \"lights\": {\"A\": {\"intensity\": 2, \"muted\": 1}, \"B\": 3, \"C\": {\"kelvin\": 3000}},\n\
                    \"panels\": {\"P\": [{\"radius\": 1}, {\"position\": [0, 1], \"radius\": 1}]}, \"sky\": 7,\n\
                    \"display\": {\"exposure_ev\": 1e9, \"tone\": \"linear\"}}";
        let (look, warnings) = Look::recover(json).unwrap();
        assert_eq!(look.lights.lights["A"], LightSetting { intensity: 2.0, ..LightSetting::default() });
        assert_eq!(look.lights.lights["C"].kelvin, Some(3000.0));
        assert_eq!((look.lights.lights.len(), look.lights.panels["P"].len()), (2, 1));
        assert_eq!((look.display.exposure_ev, look.display.tone), (None, clerestory_relight::Tone::Linear));
        assert_eq!(warnings.len(), 5, "{warnings:?}");
        assert!(warnings.iter().all(|w| w.starts_with("line ") && w.ends_with("it is left out")), "{warnings:?}");
        // A fault before the place from where on nothing can be read.
        let (look, warnings) = Look::recover("{\"lights\": {\"A\": {\"muted\": 1, \"kelvin\": 3000}}, ::}").unwrap();
        assert_eq!((look.lights.lights["A"].kelvin, warnings.len()), (Some(3000.0), 3), "{warnings:?}");
        assert!(Look::recover("{\"clerestory\": 2}").is_err() && Look::recover("nothing").is_err());
    }

    #[test]
    fn a_look_that_was_cut_off_keeps_what_stands_before() {
        let json = rich().to_json();
        let json = json.trim_end();
        let (mut n_kept, mut most) = (0, 0);
        for end in json.char_indices().map(|(at, _)| at).skip(1) {
            let (look, warnings) = match Look::recover(&json[..end]) {
                Ok(read) => read,
                Err(error) => panic!("{end}: {error:#}"),
            };
            assert!(warnings.iter().any(|w| w.contains("damaged")), "{end}: {warnings:?}");
            let kept = look.lights.lights.len() + look.lights.panels.len();
            assert!(kept + 1 >= most, "less is kept of {end} bytes than of fewer");
            (n_kept, most) = (n_kept + kept, most.max(kept));
        }
        assert_eq!(most, 3);
        assert!(n_kept > 0);
    }

    #[test]
    fn bad_values_are_refused_by_name() {
        let cases = [
            (r#"{"clerestory": 2}"#, "newer"),
            (r#"{"clerestory": "1"}"#, "`clerestory`"),
            (r#"{"clerestory": 1, "lights": []}"#, "`lights`"),
            (r#"{"clerestory": 1, "lights": {"L": {"intensity": -1}}}"#, "`lights.L.intensity`"),
            (r#"{"clerestory": 1, "lights": {"L": {"intensity": 1e300}}}"#, "`lights.L.intensity`"),
            (r#"{"clerestory": 1, "lights": {"L": {"intensity": "1"}}}"#, "`lights.L.intensity`"),
            (r#"{"clerestory": 1, "lights": {"L": {"color": [1, 1]}}}"#, "`lights.L.color`"),
            (r#"{"clerestory": 1, "lights": {"L": {"kelvin": 0}}}"#, "`lights.L.kelvin`"),
            (r#"{"clerestory": 1, "lights": {"L": {"muted": 1}}}"#, "`lights.L.muted`"),
            (r#"{"clerestory": 1, "panels": {"P": [{"radius": 1}]}}"#, "`panels.P[0].position`"),
            (r#"{"clerestory": 1, "panels": {"P": [{"position": [0, 0], "radius": -1}]}}"#, "`panels.P[0].radius`"),
            (r#"{"clerestory": 1, "display": {"exposure_ev": 1e9}}"#, "`display.exposure_ev`"),
            (r#"{"clerestory": 1, "groups": {"G": {"intensity": 2}}}"#, "`groups.G.lights`"),
            (r#"{"clerestory": 1, "groups": {"G": {"lights": "a"}}}"#, "`groups.G.lights`"),
            (r#"{"clerestory": 1, "names": {"G": 3}}"#, "`names.G`"),
            (r#"{"clerestory": 1, "lights": {"L": {"intensity": NaN}}}"#, "not JSON"),
            (r#"{"asset": {"version": "2.0"}}"#, "no look"),
        ];
        for (json, wanted) in cases {
            let error = format!("{:#}", Look::from_json(json).unwrap_err());
            assert!(error.contains(wanted), "{json}: {error}");
        }
    }
}
