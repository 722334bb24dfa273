//! The free lamps of a look, from JSON and back, and the profiles that they name.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::{Result, anyhow, bail};
use clerestory_transport::basis::LightBasis;
use clerestory_transport::import::read_profile;
use clerestory_transport::lamps::{FreeLamp, LampShape, LampUnit, half_turn};
use glam::Vec3;
use serde_json::{Map, Value};

use super::parse::{INTENSITY, Reader};
use super::write::{member, setting_members, value};
use super::{Look, groups};

/// Farthest from the origin along each axis, meters.
pub const FARTHEST_M: f32 = 1e6;
/// World-space coordinates in meters.
const PLACE_M: std::ops::RangeInclusive<f64> = -FARTHEST_M as f64..=FARTHEST_M as f64;
/// Sides and radii in meters; 0 is a lamp without size.
const SIZE_M: std::ops::RangeInclusive<f64> = 0.0..=1e4;
/// Half angles of a cone.
const CONE_DEG: std::ops::RangeInclusive<f64> = 0.0..=90.0;
/// Under which parallel light is seen, from rim to rim.
const ANGLE_DEG: std::ops::RangeInclusive<f64> = 0.0..=90.0;
/// Turns about the aim.
const TURN_DEG: std::ops::RangeInclusive<f64> = -360.0..=360.0;
/// Strongest in whatever unit.
pub const MOST_STRENGTH: f32 = 1e9;
/// Lamps of one look.
pub const MAX_LAMPS: usize = 1000;
/// Members that every lamp has.
const COMMON: [&str; 10] =
    ["key", "type", "position", "strength", "unit", "intensity", "color", "kelvin", "muted", "replaces"];

/// Names of the types in files.
pub const TYPES: [&str; 7] = ["point", "spot", "rectangle", "disk", "sphere", "directional", "ies"];

/// Where a lamp that shines all around is said to aim, so that equal lamps are equal.
pub fn below(position: Vec3) -> Vec3 {
    within_reach(position - Vec3::Y)
}

/// The nearest place that a file holds.
pub fn within_reach(place: Vec3) -> Vec3 {
    place.clamp(Vec3::splat(-FARTHEST_M), Vec3::splat(FARTHEST_M))
}

/// Whether a file holds such a lamp: it is neither farther away nor stronger than is read.
pub fn fits(lamp: &FreeLamp) -> bool {
    let mut places = [lamp.position, lamp.aim].into_iter().flat_map(|place| place.to_array());
    places.all(|meters| PLACE_M.contains(&f64::from(meters))) && lamp.strength <= MOST_STRENGTH
}

impl Look {
    /// Whether a file holds so many more lamps.
    pub fn has_room_for_lamps(&self, n_more: usize) -> bool {
        self.lights.lamps.len().saturating_add(n_more) <= MAX_LAMPS
    }

    /// Takes a free lamp out, with its places in groups, and unless looks that were kept have it still with its name and as one that is held:
    /// a later lamp may have its key. Answers what it was called.
    pub fn remove_lamp(&mut self, key: &str) -> String {
        self.lights.lamps.retain(|lamp| lamp.key != key);
        groups::leave(&mut self.lights, key);
        let name = self.name_of(key).to_owned();
        if !self.rigs().any(|rig| rig.lamps.iter().any(|lamp| lamp.key == key)) {
            self.names.remove(key);
            self.wishes.held.remove(key);
        }
        name
    }

    /// Leaves out the lamps that are called as lights of a scene. Answers a sentence for each that looks have which were kept alone; of
    /// those of the present look [`Look::unheeded`] tells.
    pub fn leave_out_taken(&mut self, basis: &LightBasis) -> Vec<String> {
        let words = self.taken_in_kept(basis, "it is left out there");
        self.rigs_mut().for_each(|rig| rig.lamps.retain(|lamp| basis.source(&lamp.key).is_none()));
        words
    }

    /// A sentence for each lamp that looks have which were kept alone, and that is called as a light of a scene whose file has changed. It
    /// stays where it is, and is left out where the look is opened.
    pub fn taken_since(&self, basis: &LightBasis) -> Vec<String> {
        self.taken_in_kept(basis, "give the light another one, or the lamp is left out when this look is opened")
    }

    /// The sentences, each with what becomes of the lamp.
    fn taken_in_kept(&self, basis: &LightBasis, outcome: &str) -> Vec<String> {
        let own: BTreeSet<&str> = self.lights.lamps.iter().map(|lamp| lamp.key.as_str()).collect();
        let kept = self.snapshots.iter().flat_map(|kept| &kept.lights.lamps).map(|lamp| lamp.key.as_str());
        let taken: BTreeSet<&str> = kept.filter(|key| !own.contains(key) && basis.source(key).is_some()).collect();
        let words = |key: &str| {
            format!("looks that were kept have a lamp `{key}`, but a light of the scene has this name; {outcome}")
        };
        taken.into_iter().map(|key| self.renamed(&words(key))).collect()
    }
}

/// Names the profile of a lamp, if it has one, from the root; it lies relative to `folder`.
pub fn root(lamp: &mut FreeLamp, folder: &Path) {
    if let LampShape::Profile { file } = &mut lamp.shape {
        let path = folder.join(&*file);
        *file = std::path::absolute(&path).unwrap_or(path).display().to_string();
    }
}

/// Makes paths of profiles absolute; they lie relative to `folder`. Leaves out lamps whose profile cannot be used, with a
/// sentence for each.
pub fn resolve(lamps: &mut Vec<FreeLamp>, folder: &Path) -> Vec<String> {
    let mut warnings = Vec::new();
    lamps.retain_mut(|lamp| {
        root(lamp, folder);
        let LampShape::Profile { file } = &lamp.shape else { return true };
        let path = Path::new(file);
        match read_profile(path) {
            Ok(_) => true,
            Err(why) => {
                warnings.push(format!("{}: {why}; the lamp `{}` is left out", path.display(), lamp.key));
                false
            }
        }
    });
    warnings
}

/// The same lamps with paths relative to `folder` where their profiles lie in it, so that the folder can be moved.
pub fn relative(lamps: &[FreeLamp], folder: &Path) -> Vec<FreeLamp> {
    let folder: PathBuf = std::path::absolute(folder).unwrap_or_else(|_| folder.into());
    let mut lamps = lamps.to_vec();
    for lamp in &mut lamps {
        if let LampShape::Profile { file } = &mut lamp.shape
            && let Ok(within) = Path::new(&*file).strip_prefix(&folder)
        {
            *file = within.display().to_string();
        }
    }
    lamps
}

impl Reader<'_> {
    /// The member `lamps`.
    pub(super) fn lamps(&mut self, value: &Value) -> Result<Vec<FreeLamp>> {
        let list = self.array(value)?;
        if list.len() > MAX_LAMPS {
            bail!("`{}` has {} lamps; a look holds {MAX_LAMPS} at most", self.name(), list.len());
        }
        let mut lamps: Vec<FreeLamp> = Vec::new();
        for (idx, value) in list.iter().enumerate() {
            let lamp = self.part(idx, |reader| reader.lamp(value, &lamps))?;
            lamps.extend(lamp.flatten());
        }
        Ok(lamps)
    }

    /// A lamp; none, and a warning, if its type is not known.
    fn lamp(&mut self, value: &Value, others: &[FreeLamp]) -> Result<Option<FreeLamp>> {
        let object = self.object(value)?;
        let key = self.optional(object, "key", |r, v| r.text(v))?.ok_or_else(|| self.lacks("key"))?;
        if key.is_empty() || others.iter().any(|other| other.key == key) {
            bail!("`{}.key` is `{key}`; give each lamp a name of its own", self.name());
        }
        if object.get("type").is_none_or(Value::is_null) {
            return Err(self.lacks("type"));
        }
        let types = TYPES.map(|name| (name, name));
        let Some(kind) = self.optional(object, "type", |r, v| r.by_name(v, types))?.flatten() else { return Ok(None) };
        let (shape, own) = self.shape(object, kind)?;
        let aim: &[&str] = if shape.is_aimed() { &["aim"] } else { &[] };
        let turn: &[&str] = if shape.is_turnable() { &["turn_deg"] } else { &[] };
        self.report_unknown(object, &[&COMMON, own, aim, turn].concat());
        let position = self.place(object, "position")?;
        let aim = if shape.is_aimed() { self.place(object, "aim")? } else { below(position) };
        let turn =
            if shape.is_turnable() { self.optional(object, "turn_deg", |r, v| r.radians(v, &TURN_DEG))? } else { None };
        let strength = self.optional(object, "strength", |r, v| r.number(v, &INTENSITY))?;
        let unit = self.optional(object, "unit", |r, v| r.unit(v, &shape))?;
        Ok(Some(FreeLamp {
            key,
            position,
            aim,
            strength: strength.ok_or_else(|| self.lacks("strength"))?,
            unit: unit.unwrap_or(shape.units()[0]),
            setting: self.setting_members(object)?,
            turn_rad: turn.map_or(0.0, half_turn),
            replaces: self.optional(object, "replaces", |r, v| r.text(v))?,
            shape,
        }))
    }

    /// The shape of a type, and the members that it has of its own.
    fn shape(&mut self, object: &Map<String, Value>, kind: &str) -> Result<(LampShape, &'static [&'static str])> {
        Ok(match kind {
            "spot" => {
                let inner_rad = self.optional(object, "inner_deg", |r, v| r.radians(v, &CONE_DEG))?.unwrap_or(0.0);
                let outer = self.optional(object, "outer_deg", |r, v| r.radians(v, &CONE_DEG))?;
                let outer_rad = outer.ok_or_else(|| self.lacks("outer_deg"))?;
                if inner_rad > outer_rad {
                    bail!("`{}.inner_deg` must be `outer_deg` at most", self.name());
                }
                (LampShape::Spot { inner_rad, outer_rad }, &["inner_deg", "outer_deg"])
            }
            "rectangle" => {
                let size_m = self.optional(object, "size_m", |r, v| r.numbers(v, &SIZE_M))?;
                (LampShape::Rectangle { size_m: size_m.ok_or_else(|| self.lacks("size_m"))? }, &["size_m"])
            }
            "disk" => (LampShape::Disk { radius_m: self.radius(object)? }, &["radius_m"]),
            "sphere" => (LampShape::Sphere { radius_m: self.radius(object)? }, &["radius_m"]),
            "directional" => {
                let angle = self.optional(object, "angle_deg", |r, v| r.radians(v, &ANGLE_DEG))?;
                (LampShape::Directional { radius_rad: 0.5 * angle.unwrap_or(0.0) }, &["angle_deg"])
            }
            "ies" => {
                let file = self.optional(object, "file", |r, v| r.text(v))?.filter(|file| !file.is_empty());
                (LampShape::Profile { file: file.ok_or_else(|| self.lacks("file"))? }, &["file"])
            }
            _ => (LampShape::Point, &[]),
        })
    }

    fn radius(&mut self, object: &Map<String, Value>) -> Result<f32> {
        self.optional(object, "radius_m", |r, v| r.number(v, &SIZE_M))?.ok_or_else(|| self.lacks("radius_m"))
    }

    fn place(&mut self, object: &Map<String, Value>, key: &str) -> Result<Vec3> {
        let place = self.optional(object, key, |r, v| r.numbers(v, &PLACE_M))?;
        place.map(Vec3::from).ok_or_else(|| self.lacks(key))
    }

    fn unit(&self, value: &Value, shape: &LampShape) -> Result<LampUnit> {
        let found = shape.units().iter().copied().find(|unit| value.as_str() == Some(unit.name()));
        found.ok_or_else(|| {
            let known: Vec<&str> = shape.units().iter().map(|unit| unit.name()).collect();
            anyhow!("`{}` of a lamp `{}` must be {}, not {value}", self.name(), shape.name(), known.join(" or "))
        })
    }

    #[expect(clippy::cast_possible_truncation, reason = "angles, as exact as a lamp keeps them")]
    fn radians(&self, value: &Value, range_deg: &std::ops::RangeInclusive<f64>) -> Result<f32> {
        self.number(value, range_deg)?;
        Ok(value.as_f64().unwrap_or_default().to_radians() as f32)
    }

    fn lacks(&self, key: &str) -> anyhow::Error {
        anyhow!("`{}.{key}` is missing: the lamp needs it", self.name())
    }
}

/// JSON of a lamp on one line.
pub(super) fn json(lamp: &FreeLamp) -> String {
    let mut members = vec![
        format!("\"key\": {}", value(&lamp.key)),
        member("type", lamp.shape.name()),
        member("position", &lamp.position.to_array()),
    ];
    if lamp.shape.is_aimed() {
        members.push(member("aim", &lamp.aim.to_array()));
    }
    match &lamp.shape {
        LampShape::Spot { inner_rad, outer_rad } => {
            members.push(member("inner_deg", &degrees(*inner_rad)));
            members.push(member("outer_deg", &degrees(*outer_rad)));
        }
        LampShape::Rectangle { size_m } => members.push(member("size_m", size_m)),
        LampShape::Disk { radius_m } | LampShape::Sphere { radius_m } => members.push(member("radius_m", radius_m)),
        LampShape::Profile { file } => members.push(format!("\"file\": {}", value(file))),
        LampShape::Directional { radius_rad } if *radius_rad > 0.0 => {
            members.push(member("angle_deg", &degrees(2.0 * *radius_rad)));
        }
        LampShape::Point | LampShape::Directional { .. } => {}
    }
    if lamp.shape.is_turnable() && lamp.turn_rad != 0.0 {
        members.push(member("turn_deg", &degrees(lamp.turn_rad)));
    }
    members.push(member("strength", &lamp.strength));
    members.push(member("unit", lamp.unit.name()));
    members.extend(setting_members(&lamp.setting));
    members.extend(lamp.replaces.iter().map(|key| format!("\"replaces\": {}", value(key))));
    format!("{{ {} }}", members.join(", "))
}

/// Degrees with the fewest decimals that are read as these radians again.
#[expect(clippy::cast_possible_truncation, reason = "angles, as exact as a lamp keeps them")]
fn degrees(rad: f32) -> f64 {
    let exact = f64::from(rad).to_degrees();
    let mut rounded = (0..9).map(|digits| {
        let scale = 10f64.powi(digits);
        (exact * scale).round() / scale
    });
    rounded.find(|degrees| degrees.to_radians() as f32 == rad).unwrap_or(exact)
}

#[cfg(test)]
mod tests {
    use std::f32::consts::PI;

    use clerestory_transport::basis::{LightSource, SourceKind};
    use clerestory_transport::lamps::PreparedLamps;
    use clerestory_transport::light::LightSetting;

    use super::*;
    use crate::look::Look;
    use crate::look::fade::fade;

    fn lamp(key: &str, shape: LampShape) -> FreeLamp {
        let position = Vec3::new(1.5, 2.25, -0.1);
        let aim = if shape.is_aimed() { Vec3::new(0.1, 0.0, 3.0) } else { below(position) };
        let (unit, setting) = (shape.units()[0], LightSetting::default());
        FreeLamp {
            key: key.into(),
            shape,
            position,
            aim,
            strength: 800.0,
            unit,
            setting,
            turn_rad: 0.0,
            replaces: None,
        }
    }

    fn all() -> Vec<FreeLamp> {
        let spot = LampShape::Spot { inner_rad: 0.123_456_7, outer_rad: 20f32.to_radians() };
        let setting = LightSetting { intensity: 0.1, color: Some([1.0, 0.5, 0.25]), kelvin: Some(3000.0), muted: true };
        vec![
            lamp("a point, \"quoted\"", LampShape::Point),
            FreeLamp { setting, ..lamp("Lamp 1", spot) },
            FreeLamp { unit: LampUnit::Nit, ..lamp("r", LampShape::Rectangle { size_m: [1.2, 0.3] }) },
            FreeLamp { turn_rad: -0.5 * PI, ..lamp("turned", LampShape::Rectangle { size_m: [1.2, 0.3] }) },
            lamp("d", LampShape::Disk { radius_m: 0.0 }),
            FreeLamp { unit: LampUnit::Candela, ..lamp("s", LampShape::Sphere { radius_m: 0.06 }) },
            FreeLamp {
                turn_rad: 0.0,
                replaces: Some("Sun \"A\"".into()),
                ..lamp("sun", LampShape::Directional { radius_rad: 0.0 })
            },
            lamp("soft", LampShape::Directional { radius_rad: 0.5 * (0.53f64.to_radians() as f32) }),
            lamp("track", LampShape::Profile { file: "a, b/x.ies".into() }),
        ]
    }

    #[test]
    fn every_lamp_that_is_written_comes_back_without_a_warning() {
        let mut look = Look::default();
        look.lights.lamps = all();
        let json = look.to_json();
        let (back, warnings) = Look::from_json(&json).unwrap();
        assert_eq!(back, look, "{json}");
        assert!(warnings.is_empty(), "{warnings:?}");
        assert!(json.contains("\"outer_deg\": 20.0,"), "{json}");
        assert_eq!(json.matches("\"angle_deg\": 0.53,").count(), json.matches("angle_deg").count(), "{json}");
        assert!(json.contains("angle_deg"), "{json}");
        assert_eq!(json.matches("\"turn_deg\": -90.0,").count(), json.matches("turn_deg").count(), "{json}");
        assert!(json.contains("turn_deg"), "{json}");
        let beyond = Look::from_json(&json.replace("-90.0,", "270.0,")).unwrap().0.lights.lamps;
        assert!(beyond.iter().zip(all()).all(|(lamp, own)| (lamp.turn_rad - own.turn_rad).abs() < 1e-5), "{beyond:?}");
        assert_eq!(json.matches("\"aim\"").count(), 7, "only what can be aimed has an aim: {json}");
    }

    #[test]
    fn what_fits_is_what_is_read() {
        let usual = lamp("usual", LampShape::Disk { radius_m: 0.1 });
        let far = FreeLamp { position: Vec3::new(0.0, -2e6, 0.0), ..usual.clone() };
        let strong = FreeLamp { strength: 2e9, ..usual.clone() };
        let deep = Vec3::splat(-FARTHEST_M);
        let deep = FreeLamp { position: deep, aim: below(deep), ..lamp("deep", LampShape::Point) };
        assert!(PreparedLamps::new(std::slice::from_ref(&deep), None).is_ok(), "it shines");
        for (lamp, is_read) in [(usual, true), (deep, true), (far, false), (strong, false)] {
            let mut look = Look::default();
            look.lights.lamps = vec![lamp.clone()];
            assert_eq!((fits(&lamp), Look::from_json(&look.to_json()).is_ok()), (is_read, is_read), "{lamp:?}");
        }
        assert_eq!(within_reach(Vec3::new(0.0, -2e6, 3e7)), Vec3::new(0.0, -FARTHEST_M, FARTHEST_M));
    }

    #[test]
    fn bad_lamps_are_refused_by_name_line_and_column() {
        let of = |members: &str| format!("{{\"clerestory\": 1, \"lamps\": [\n{{{members}}}]}}");
        let point = "\"key\": \"L\", \"type\": \"point\", \"position\": [0, 0, 0], \"strength\": 1";
        for (members, wanted) in [
            ("\"type\": \"point\"", "`lamps[0].key` is missing"),
            ("\"key\": \"\", \"type\": \"point\"", "a name of its own"),
            ("\"key\": \"L\"", "`lamps[0].type` is missing"),
            (&point.replace("\"point\"", "null"), "`lamps[0].type` is missing"),
            ("\"key\": \"L\", \"type\": \"point\", \"strength\": 1", "`lamps[0].position` is missing"),
            ("\"key\": \"L\", \"type\": \"point\", \"position\": [0, 0, 0]", "`lamps[0].strength` is missing"),
            (
                &point.replace("[0, 0, 0]", "[0, 0, 1e300]"),
                "line 2, column 43: `lamps[0].position` must be a number from",
            ),
            (&point.replace("\"strength\": 1", "\"strength\": -1"), "`lamps[0].strength` must be a number from 0"),
            (&format!("{point}, \"unit\": \"nit\""), "`lamps[0].unit` of a lamp `point` must be lm or cd, not \"nit\""),
            (&format!("{point}, \"muted\": 1"), "`lamps[0].muted` must be true or false"),
            (&point.replace("point", "spot"), "`lamps[0].outer_deg` is missing"),
            (
                &format!("{}, \"outer_deg\": 91", point.replace("point", "spot")),
                "`lamps[0].outer_deg` must be a number from 0 to 90",
            ),
            (
                &format!("{}, \"inner_deg\": 40, \"outer_deg\": 30", point.replace("point", "spot")),
                "`outer_deg` at most",
            ),
            (&format!("{}, \"outer_deg\": 30", point.replace("point", "spot")), "`lamps[0].aim` is missing"),
            (&point.replace("point", "disk"), "`lamps[0].radius_m` is missing"),
            (
                &format!(
                    "{}, \"size_m\": [1, 1], \"aim\": [0, 0, 0], \"turn_deg\": 400",
                    point.replace("point", "rectangle")
                ),
                "`lamps[0].turn_deg` must be a number from -360 to 360",
            ),
            (
                &format!("{}, \"size_m\": [1]", point.replace("point", "rectangle")),
                "`lamps[0].size_m` must be a list of 2",
            ),
            (&point.replace("point", "ies"), "`lamps[0].file` is missing"),
            (&format!("{point}}}, {{{point}"), "`lamps[1].key` is `L`"),
        ] {
            let error = format!("{:#}", Look::from_json(&of(members)).unwrap_err());
            assert!(error.contains(wanted) && error.contains("line 2, column"), "{members}: {error}");
        }
    }

    #[test]
    fn of_damaged_lamps_those_that_can_be_read_are_kept() {
        let json = r#"{"clerestory": 1, "lamps": [
            {"key": "a", "type": "point", "position": [0, 1, 0], "strength": 5, "kelvin": "warm", "aim": [0, 0, 0]},
            {"key": "b", "type": "tube", "position": [0, 1, 0], "strength": 5},
            {"key": "c", "type": "point", "position": [0, 1], "strength": 5},
            {"key": "a", "type": "point", "position": [0, 1, 0], "strength": 5}]}"#;
        let (look, warnings) = Look::recover(json).unwrap();
        let lamps = look.lights.lamps;
        assert_eq!((lamps.len(), lamps[0].key.as_str(), lamps[0].setting.kelvin), (1, "a", None));
        for words in ["`lamps[0].aim`", "`lamps[0].kelvin`", "`tube`", "`lamps[2].position`", "`lamps[3].key`"] {
            assert!(warnings.iter().any(|w| w.contains(words)), "{words} is not in {warnings:?}");
        }
    }

    #[test]
    fn a_file_with_as_many_lamps_as_there_is_room_for_is_read() {
        let mut look = Look::default();
        while look.has_room_for_lamps(1) {
            let name = format!("Lamp {}", look.lights.lamps.len());
            look.lights.lamps.push(lamp(&name, LampShape::Point));
        }
        let n_lamps = look.lights.lamps.len();
        assert_eq!(Look::from_json(&look.to_json()).unwrap().0.lights.lamps.len(), n_lamps);
        look.lights.lamps.push(lamp("One more", LampShape::Point));
        assert!(!look.has_room_for_lamps(0) && Look::from_json(&look.to_json()).is_err());
    }

    #[test]
    fn a_cross_fade_of_more_lamps_than_a_file_holds_is_not_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.look");
        let [from, to] = ["From", "To"].map(|stem| {
            let mut look = Look::default();
            let name = |idx| format!("{stem} {idx}");
            look.lights.lamps.extend((0..MAX_LAMPS / 2 + 1).map(|idx| lamp(&name(idx), LampShape::Point)));
            look
        });
        let mut mixed = fade(&from, &to, 0.5, None);
        assert!(mixed.lights.lamps.len() > MAX_LAMPS);
        let said = |look: &Look| look.save(&path).unwrap_err().to_string();
        assert!(said(&mixed).contains("holds 1000 at most") && !path.exists());
        mixed.keep("Between");
        mixed.lights = from.lights;
        assert!(said(&mixed).contains("1002 lamps in one look"), "one that was kept counts, too");
        mixed.delete(0);
        mixed.save(&path).unwrap();
        assert_eq!(Look::load(&path).unwrap().0.lights.lamps.len(), MAX_LAMPS / 2 + 1);
    }

    #[test]
    fn a_lamp_of_a_lights_name_is_told() {
        let source = LightSource::plain("Lamp 1", SourceKind::Point, 0..1);
        let mut look = Look::default();
        look.lights.lamps = all();
        look.lights.lamps.iter_mut().for_each(|lamp| lamp.replaces = None);
        let words = look.unheeded(&LightBasis::new(vec![source]));
        assert!(words.len() == 1 && words[0].contains("a lamp `Lamp 1`"), "{words:?}");
    }

    #[test]
    fn a_lamp_that_replaces_a_light_which_is_not_there_or_shines_is_told() {
        let mut look = Look::default();
        let stand_in =
            |key: &str, replaced: &str| FreeLamp { replaces: Some(replaced.into()), ..lamp(key, LampShape::Point) };
        look.lights.lamps = vec![stand_in("Moved", "Spot"), stand_in("Other", "Nope")];
        let basis = LightBasis::new(vec![LightSource::plain("Spot", SourceKind::Point, 0..1)]);
        let words = look.unheeded(&basis);
        assert!(
            words.len() == 2 && words[0].contains("`Moved` of the look replaces `Spot`, which shines"),
            "{words:?}"
        );
        assert!(words[1].contains("`Other` of the look replaces `Nope`, which this scene does not have"), "{words:?}");
        look.lights.lights.insert("Spot".into(), LightSetting { muted: true, ..LightSetting::default() });
        assert_eq!(look.unheeded(&basis), words[1..].to_vec());
    }

    #[test]
    fn a_lamp_that_is_called_otherwise_is_told_by_the_key_that_a_light_has() {
        let basis = LightBasis::new(vec![LightSource::plain("Lamp 1", SourceKind::Point, 0..1)]);
        let mut look = Look::default();
        look.lights.lamps = vec![lamp("Lamp 1", LampShape::Point)];
        look.names.insert("Lamp 1".into(), "Desk".into());
        let words = look.unheeded(&basis);
        assert!(words.len() == 1 && words[0].contains("a lamp `Desk`, whose key “Lamp 1”"), "{words:?}");
        assert!(words[0].contains("another key") && !words[0].contains("rename"), "{words:?}");
        // What is advised helps: its key in the file is another one.
        let (other, _) = Look::from_json(&look.to_json().replace("Lamp 1", "Desk lamp")).unwrap();
        assert_eq!((other.unheeded(&basis), other.lights.lamps.len()), (Vec::<String>::new(), 1));
    }

    #[test]
    fn lamps_of_kept_looks_that_have_a_lights_name_are_left_out_and_told() {
        let mut look = Look::default();
        look.lights.lamps = vec![lamp("Sun", LampShape::Point)];
        look.keep("Day");
        look.lights.lamps.extend(["Desk", "Shelf"].map(|key| lamp(key, LampShape::Point)));
        look.keep("Night");
        look.lights.lamps.truncate(1);
        let sources = [("Sun", 0..1), ("Desk", 1..2)];
        let sources = sources.map(|(key, columns)| LightSource::plain(key, SourceKind::Point, columns));
        let words = look.leave_out_taken(&LightBasis::new(sources.into()));
        assert!(words.len() == 1 && words[0].contains("have a lamp `Desk`"), "of Sun `unheeded` tells: {words:?}");
        let left: Vec<&str> = look.rigs().flat_map(|rig| &rig.lamps).map(|lamp| lamp.key.as_str()).collect();
        assert_eq!(left, ["Shelf"]);
    }

    #[test]
    fn a_lamp_that_is_deleted_keeps_its_name_in_looks_that_have_it_still() {
        let mut look = Look::default();
        look.lights.lamps = ["a", "b"].map(|key| lamp(key, LampShape::Point)).into();
        look.names.extend([("a", "Desk"), ("b", "Shelf")].map(|(key, name)| (key.to_owned(), name.to_owned())));
        look.keep("Day");
        look.snapshots[0].lights.lamps.truncate(1);
        assert_eq!(["a", "b"].map(|key| look.remove_lamp(key)), ["Desk", "Shelf"]);
        assert_eq!((look.name_of("a"), look.name_of("b")), ("Desk", "b"));
    }

    #[test]
    fn a_lamp_that_is_deleted_is_held_no_longer_unless_looks_have_it_still() {
        let mut look = Look::default();
        look.lights.lamps = ["a", "b"].map(|key| lamp(key, LampShape::Point)).into();
        look.wishes.held = ["a", "b", "of the file"].map(str::to_owned).into();
        look.keep("Day");
        look.snapshots[0].lights.lamps.truncate(1);
        ["a", "b"].into_iter().for_each(|key| _ = look.remove_lamp(key));
        let held: Vec<&str> = look.wishes.held.iter().map(String::as_str).collect();
        assert_eq!(held, ["a", "of the file"]);
    }

    #[test]
    fn profiles_lie_relative_to_the_folder_of_the_look() {
        let folder = tempfile::tempdir().unwrap();
        let elsewhere = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("ies")).unwrap();
        let ies = "IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 3 1 1 2 0 0 0\n1 1 10\n0 45 90\n0\n100 50 0\n";
        std::fs::write(folder.path().join("ies/x.ies"), ies).unwrap();
        std::fs::write(folder.path().join("spoiled.ies"), "no profile").unwrap();
        let mut look = Look::default();
        for file in ["ies/x.ies", "spoiled.ies", "none.ies"] {
            look.lights.lamps.push(lamp(file, LampShape::Profile { file: file.into() }));
        }
        let path = folder.path().join("a.look");
        look.save(&path).unwrap();
        let (opened, warnings) = Look::load_readable(&path).unwrap();
        assert_eq!((opened.lights.lamps.len(), warnings.len()), (1, 2), "{warnings:?}");
        assert!(warnings[0].contains("spoiled.ies") && warnings[1].contains("`none.ies` is left out"), "{warnings:?}");
        let LampShape::Profile { file } = &opened.lights.lamps[0].shape else { panic!("another shape") };
        assert!(Path::new(file).is_absolute() && read_profile(Path::new(file)).is_ok(), "{file}");

        opened.save(&path).unwrap();
        assert!(std::fs::read_to_string(&path).unwrap().contains("\"ies/x.ies\""));
        let away = elsewhere.path().join("a.look");
        opened.save(&away).unwrap();
        assert_eq!(Look::load_readable(&away).unwrap().0, opened, "it is found from anywhere");
    }
}
