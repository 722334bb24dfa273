//! JSON to look, by hand: every complaint names its key, and unknown keys are reported instead of refused.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

use anyhow::{Context, Result, anyhow, bail};
use clerestory_transport::light::{LightRig, LightSetting, PanelSpot};
use serde_json::{Map, Value};

use super::marked::MOST_MARKED;
use super::place::{self, Step};
use super::{Display, LOOK_VERSION, Look, damage, repeated};
use crate::words::unmarked;

/// Multipliers of a lamp.
pub(super) const INTENSITY: RangeInclusive<f64> = 0.0..=PanelSpot::MOST_INTENSITY as f64;
/// Channels of a linear color.
const CHANNEL: RangeInclusive<f64> = 0.0..=PanelSpot::MOST_CHANNEL as f64;
/// Correlated color temperature.
const KELVIN: RangeInclusive<f64> = 500.0..=100_000.0;
/// Panel coordinates; a spot may stand beside its panel.
const POSITION: RangeInclusive<f64> = -PanelSpot::MOST_AWAY as f64..=PanelSpot::MOST_AWAY as f64;
/// Radius of a spot in shorter sides of its panel.
const RADIUS: RangeInclusive<f64> = 0.0..=PanelSpot::MOST_RADIUS as f64;

/// Members that say how a scene is lit and shown, of a look and of each of its snapshots.
pub(super) const LIGHTING: [&str; 6] = ["lights", "panels", "sky", "lamps", "groups", "display"];

/// Other members of a look.
const MEMBERS: [&str; 11] =
    ["clerestory", "scene_file", "names", "looks", "on", "timeline", "scene", "bookmarks", "wishes", "marks", "probes"];

/// What happens at a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum OnFault {
    /// The whole look is refused.
    Refuse,
    /// The member is left out with a warning.
    LeaveOut,
}

/// A place in the document, and what was noticed on the way.
pub(super) struct Reader<'a> {
    warnings: &'a mut Vec<String>,
    steps: Vec<Step>,
    text: &'a str,
    on_fault: OnFault,
}

/// Reads a look; see [`Look::from_json`] and [`Look::recover`].
pub(super) fn look(json: &str, on_fault: OnFault) -> Result<(Look, Vec<String>)> {
    let json = unmarked(json);
    let mut warnings = Vec::new();
    let recovered;
    let (text, value) = match serde_json::from_str::<Value>(json) {
        Ok(value) => (json, value),
        Err(error) if on_fault == OnFault::LeaveOut => {
            warnings.push(format!("the look is damaged ({error}); what stands before is read"));
            let closed = damage::readable(json, &error);
            let (closed, value) = closed.with_context(|| format!("nothing of it can be read ({error})"))?;
            recovered = closed;
            (recovered.as_str(), value)
        }
        Err(error) => return Err(error).context("it is not JSON; see the example in docs/cli.md"),
    };
    warnings.extend(repeated::warnings(text));
    let mut reader = Reader { warnings: &mut warnings, steps: Vec::new(), text, on_fault };
    let document = reader.object(&value)?;
    check_version(document, &mut reader)?;
    reader.report_unknown(document, &[&MEMBERS[..], &LIGHTING[..]].concat());
    // Who opens the look by itself asks for it.
    reader.optional(document, "scene_file", |reader, value| reader.text(value))?;
    let (lights, display) = reader.lighting(document)?;
    let snapshots = reader.optional(document, "looks", |reader, value| reader.snapshots(value))?.unwrap_or_default();
    let kept: Vec<&str> = snapshots.iter().map(|snapshot| snapshot.name.as_str()).collect();
    let known = kept.iter().map(|name| (*name, (*name).to_owned()));
    let on = reader.optional(document, "on", |reader, value| reader.by_name(value, known))?.flatten();
    let timeline = reader.optional(document, "timeline", |reader, value| reader.timeline(value, &kept))?;
    let timeline = timeline.unwrap_or_default();
    let names = reader.entries(document, "names", |reader, value| reader.text(value))?;
    let bookmarks =
        reader.optional(document, "bookmarks", |reader, value| reader.bookmarks(value))?.unwrap_or_default();
    let wishes = reader.optional(document, "wishes", |reader, value| reader.wishes(value))?.unwrap_or_default();
    let marks = reader.optional(document, "marks", |reader, value| reader.marked(value, &mut MOST_MARKED.clone()))?;
    let probes = reader.optional(document, "probes", |reader, value| reader.probes(value))?.unwrap_or_default();
    let scene = reader.optional(document, "scene", |reader, value| reader.scene_choice(value))?.unwrap_or_default();
    Ok((Look { lights, names, display, snapshots, on, timeline, scene, bookmarks, wishes, marks, probes }, warnings))
}

/// Refuses what a newer program wrote, and what is no look at all.
fn check_version(document: &Map<String, Value>, reader: &mut Reader) -> Result<()> {
    let Some(version) = document.get("clerestory") else {
        let known = LIGHTING.iter().chain(&["looks", "names"]);
        if !document.is_empty() && !known.clone().any(|key| document.contains_key(*key)) {
            let known: Vec<&str> = known.copied().collect();
            bail!("it is no look: it has none of `clerestory`, `{}`", known.join("`, `"));
        }
        reader.warnings.push(format!("the look does not say `\"clerestory\": {LOOK_VERSION}`; read as that version"));
        return Ok(());
    };
    // 1.0 is the same number as 1.
    let version = version.as_f64().filter(|v| *v >= 1.0 && v.fract() == 0.0);
    let version = version.ok_or_else(|| anyhow!("`clerestory` must be the version number {LOOK_VERSION}"))?;
    if version > LOOK_VERSION as f64 {
        bail!(
            "it was written by a newer clerestory (look version {version}, this program knows {LOOK_VERSION}); update this program"
        );
    }
    Ok(())
}

impl Reader<'_> {
    /// How a scene is lit and shown; see [`LIGHTING`].
    pub(super) fn lighting(&mut self, object: &Map<String, Value>) -> Result<(LightRig, Display)> {
        let lights = LightRig {
            lights: self.entries(object, "lights", |reader, value| reader.setting(value))?,
            panels: self.entries(object, "panels", |reader, value| reader.spots(value))?,
            sky: self.optional(object, "sky", |reader, value| reader.sky(value))?,
            lamps: self.optional(object, "lamps", |reader, value| reader.lamps(value))?.unwrap_or_default(),
            groups: self.entries(object, "groups", |reader, value| reader.group(value))?,
        };
        let display = match object.get("display") {
            Some(value) => self.part("display", |reader| reader.display(value))?.unwrap_or_default(),
            None => Display::default(),
        };
        Ok((lights, display))
    }

    /// Reads something one step deeper, so that complaints carry the whole path, and the line and column.
    fn at<T>(&mut self, step: impl Into<Step>, read: impl FnOnce(&mut Reader) -> Result<T>) -> Result<T> {
        let step = step.into();
        let steps = [self.steps.as_slice(), &[step]].concat();
        let (text, on_fault) = (self.text, self.on_fault);
        let mut deeper = Reader { warnings: self.warnings, steps, text, on_fault };
        read(&mut deeper).map_err(|error| place::located(error, text, &deeper.steps))
    }

    /// The same; `None` where a fault was left out.
    pub(super) fn part<T>(
        &mut self,
        step: impl Into<Step>,
        read: impl FnOnce(&mut Reader) -> Result<T>,
    ) -> Result<Option<T>> {
        match (self.at(step, read), self.on_fault) {
            (Err(error), OnFault::LeaveOut) => {
                self.warnings.push(format!("{error:#}; it is left out"));
                Ok(None)
            }
            (result, _) => result.map(Some),
        }
    }

    /// The name of this place for people.
    pub(super) fn name(&self) -> String {
        if self.steps.is_empty() { "the look".into() } else { place::path(&self.steps) }
    }

    pub(super) fn object<'v>(&self, value: &'v Value) -> Result<&'v Map<String, Value>> {
        value.as_object().ok_or_else(|| anyhow!("`{}` must be an object {{…}}", self.name()))
    }

    pub(super) fn array<'v>(&self, value: &'v Value) -> Result<&'v Vec<Value>> {
        value.as_array().ok_or_else(|| anyhow!("`{}` must be a list […]", self.name()))
    }

    pub(super) fn report_unknown(&mut self, object: &Map<String, Value>, known: &[&str]) {
        for key in object.keys().filter(|key| !known.contains(&key.as_str())) {
            let place = place::path(&[self.steps.as_slice(), &[Step::from(key.as_str())]].concat());
            self.warnings.push(format!("the look has an unknown key `{place}`; it is ignored"));
        }
    }

    /// All entries of an object of the document, by key; empty if it is left out.
    pub(super) fn entries<T>(
        &mut self,
        document: &Map<String, Value>,
        name: &str,
        read: impl Fn(&mut Reader, &Value) -> Result<T>,
    ) -> Result<BTreeMap<String, T>> {
        let Some(value) = document.get(name) else {
            return Ok(BTreeMap::new());
        };
        let entries = self.part(name, |reader| {
            let mut entries = BTreeMap::new();
            for (key, value) in reader.object(value)? {
                if let Some(entry) = reader.part(key.as_str(), |r| read(r, value))? {
                    entries.insert(key.clone(), entry);
                }
            }
            Ok(entries)
        })?;
        Ok(entries.unwrap_or_default())
    }

    #[expect(clippy::cast_possible_truncation, reason = "its range was looked at: it stays finite")]
    pub(super) fn number(&self, value: &Value, range: &RangeInclusive<f64>) -> Result<f32> {
        let number = value.as_f64().filter(|number| range.contains(number));
        let number = number.ok_or_else(|| {
            anyhow!("`{}` must be a number from {} to {}, not {value}", self.name(), range.start(), range.end())
        })?;
        Ok(number as f32)
    }

    pub(super) fn numbers<const N: usize>(&mut self, value: &Value, range: &RangeInclusive<f64>) -> Result<[f32; N]> {
        let list = self.array(value)?;
        if list.len() != N {
            bail!("`{}` must be a list of {N} numbers, not {}", self.name(), list.len());
        }
        let mut numbers = [0.0; N];
        for (idx, value) in list.iter().enumerate() {
            numbers[idx] = self.number(value, range)?;
        }
        Ok(numbers)
    }

    /// A value that may be left out or `null`.
    pub(super) fn optional<T>(
        &mut self,
        object: &Map<String, Value>,
        key: &str,
        read: impl FnOnce(&mut Reader, &Value) -> Result<T>,
    ) -> Result<Option<T>> {
        match object.get(key) {
            None | Some(Value::Null) => Ok(None),
            Some(value) => self.part(key, |reader| read(reader, value)),
        }
    }

    fn setting(&mut self, value: &Value) -> Result<LightSetting> {
        let object = self.object(value)?;
        self.report_unknown(object, &["intensity", "color", "kelvin", "muted"]);
        self.setting_members(object)
    }

    /// What is set of a lamp, among other members.
    pub(super) fn setting_members(&mut self, object: &Map<String, Value>) -> Result<LightSetting> {
        Ok(LightSetting {
            intensity: self.optional(object, "intensity", |r, v| r.number(v, &INTENSITY))?.unwrap_or(1.0),
            color: self.optional(object, "color", |r, v| r.numbers(v, &CHANNEL))?,
            kelvin: self.optional(object, "kelvin", |r, v| r.number(v, &KELVIN))?,
            muted: self.optional(object, "muted", |r, v| r.truth(v))?.unwrap_or(false),
        })
    }

    pub(super) fn truth(&self, value: &Value) -> Result<bool> {
        value.as_bool().ok_or_else(|| anyhow!("`{}` must be true or false, not {value}", self.name()))
    }

    fn spots(&mut self, value: &Value) -> Result<Vec<PanelSpot>> {
        let list = self.array(value)?;
        let spots = list.iter().enumerate().map(|(idx, value)| self.part(idx, |reader| reader.spot(value)));
        spots.filter_map(Result::transpose).collect()
    }

    fn spot(&mut self, value: &Value) -> Result<PanelSpot> {
        let object = self.object(value)?;
        self.report_unknown(object, &["position", "radius", "color", "intensity"]);
        let missing = |reader: &Reader, key: &str| anyhow!("`{}.{key}` is missing: a spot needs it", reader.name());
        let position = self.optional(object, "position", |r, v| r.numbers(v, &POSITION))?;
        let radius = self.optional(object, "radius", |r, v| r.number(v, &RADIUS))?;
        Ok(PanelSpot {
            position: position.ok_or_else(|| missing(self, "position"))?,
            radius: radius.ok_or_else(|| missing(self, "radius"))?,
            color: self.optional(object, "color", |r, v| r.numbers(v, &CHANNEL))?,
            intensity: self.optional(object, "intensity", |r, v| r.number(v, &INTENSITY))?.unwrap_or(1.0),
        })
    }

    /// A value by its name in files; none, and a warning, if there is none of that name.
    pub(super) fn one_of<T: Copy + serde::Serialize>(&mut self, value: &Value, all: &[T]) -> Result<Option<T>> {
        let names: Vec<(String, T)> = all
            .iter()
            .map(|one| Ok((serde_json::from_value(serde_json::to_value(one)?)?, *one)))
            .collect::<Result<_>>()?;
        self.by_name(value, names)
    }

    /// A value by its name; none, and a warning, if there is none of that name.
    pub(super) fn by_name<T>(
        &mut self,
        value: &Value,
        names: impl IntoIterator<Item = (impl AsRef<str>, T)>,
    ) -> Result<Option<T>> {
        let wanted =
            value.as_str().ok_or_else(|| anyhow!("`{}` must be a name in quotes, not {value}", self.name()))?;
        let mut known = Vec::new();
        for (name, one) in names {
            if name.as_ref() == wanted {
                return Ok(Some(one));
            }
            known.push(format!("`{}`", name.as_ref()));
        }
        let sentence =
            format!("the look sets `{}` to `{wanted}`; known are {}; it is ignored", self.name(), known.join(", "));
        self.warnings.push(sentence);
        Ok(None)
    }
}
