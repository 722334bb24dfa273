//! Looks in time: which snapshot is to be seen when, and how one becomes the next.

use std::ops::RangeInclusive;

use anyhow::{Result, anyhow};
use clerestory_transport::basis::LightBasis;
use serde_json::Value;

use super::Look;
use super::fade::fade;
use super::parse::Reader;
use super::snapshot::Snapshot;
use super::write::{member, value};

/// Times of keys, seconds; a day is more than anybody waits for.
pub const SECS: RangeInclusive<f64> = 0.0..=86_400.0;
/// Frames of a second.
pub const FPS: RangeInclusive<f64> = 1.0..=240.0;
/// Frames of a second where nothing else is said.
const DEFAULT_FPS: f32 = 24.0;

/// Keys in the order of their times.
#[derive(Clone, Debug, PartialEq)]
pub struct Timeline {
    /// Frames of a second.
    pub fps: f32,
    /// Sorted by time; two of one time are a cut.
    pub keys: Vec<Key>,
}

/// A snapshot at a time.
#[derive(Clone, Debug, PartialEq)]
pub struct Key {
    /// When, seconds from the start.
    pub secs: f32,
    /// Name of the snapshot.
    pub look: String,
    /// How it becomes the next one.
    pub ease: Ease,
}

/// How a look becomes the next one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Ease {
    /// Slowly, then fast, then slowly.
    #[default]
    Smooth,
    /// Evenly.
    Linear,
    /// It stays, and cuts to the next one at its time.
    Hold,
}

impl Ease {
    /// All of them, with their names in files and for people.
    pub const ALL: [(Ease, &'static str, &'static str); 3] =
        [(Ease::Smooth, "smooth", "Smooth"), (Ease::Linear, "linear", "Linear"), (Ease::Hold, "hold", "Hold")];

    /// Name for people.
    pub fn words(self) -> &'static str {
        Ease::ALL.iter().find(|(ease, ..)| *ease == self).map_or("", |(.., words)| words)
    }

    /// Share of the next look when a share `t` of the time to it has passed, both 0…1.
    pub fn share(self, t: f32) -> f32 {
        match self {
            Ease::Smooth => t * t * (3.0 - 2.0 * t),
            Ease::Linear => t,
            Ease::Hold => 0.0,
        }
    }
}

impl Default for Timeline {
    fn default() -> Timeline {
        Timeline { fps: DEFAULT_FPS, keys: Vec::new() }
    }
}

/// The nearest time at which a key may be.
#[expect(clippy::cast_possible_truncation, reason = "the ends of a day are whole seconds")]
fn within_day(secs: f32) -> f32 {
    secs.clamp(*SECS.start() as f32, *SECS.end() as f32)
}

impl Timeline {
    /// When the last key is, seconds.
    pub fn end_secs(&self) -> f32 {
        self.keys.last().map_or(0.0, |key| key.secs)
    }

    /// Frames from the first to the last key, both included; none without keys.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a cast of a float ends at the greatest number, and starts at 0"
    )]
    pub fn n_frames(&self) -> u32 {
        if self.keys.is_empty() { 0 } else { ((self.end_secs() * self.fps).round() as u32).saturating_add(1) }
    }

    /// Adds a key and keeps the order; answers where it stands. One that is at the same time, to a tenth of a frame, gives way.
    pub fn add(&mut self, key: Key) -> usize {
        let key = Key { secs: within_day(key.secs), ..key };
        let near = 0.1 / self.fps;
        self.keys.retain(|other| (other.secs - key.secs).abs() > near);
        let idx = self.keys.partition_point(|other| other.secs <= key.secs);
        self.keys.insert(idx, key);
        idx
    }

    /// Puts a key at another time; answers where it stands then.
    pub fn move_to(&mut self, idx: usize, secs: f32) -> usize {
        if idx >= self.keys.len() {
            return idx;
        }
        let secs = within_day(secs);
        let key = Key { secs, ..self.keys.remove(idx) };
        let idx = self.keys.partition_point(|other| other.secs <= secs);
        self.keys.insert(idx, key);
        idx
    }

    /// The keys before and after a time, and the share of the second; one key, twice, before the first and after the last.
    fn around(&self, secs: f32) -> Option<(&Key, &Key, f32)> {
        let next = self.keys.partition_point(|key| key.secs <= secs);
        let before = self.keys.get(next.saturating_sub(1))?;
        let after = self.keys.get(next).filter(|_| next > 0).unwrap_or(before);
        let span = after.secs - before.secs;
        let t = if span > 0.0 { ((secs - before.secs) / span).clamp(0.0, 1.0) } else { 0.0 };
        Some((before, after, before.ease.share(t)))
    }
}

impl Look {
    /// The snapshots that the timeline has keys of; others may be kept beside them.
    pub fn seen_in_time(&self) -> impl Iterator<Item = &Snapshot> {
        self.snapshots.iter().filter(|snapshot| self.timeline.keys.iter().any(|key| key.look == snapshot.name))
    }

    /// What is lit at a time of the timeline, seconds, without snapshots and timeline; the present look where there are no keys.
    /// `basis` tells the colors that lights have in the file.
    pub fn at(&self, secs: f32, basis: Option<&LightBasis>) -> Look {
        let snapshots = self.timeline.around(secs).and_then(|(before, after, share)| {
            Some((self.snapshot(&before.look)?, self.snapshot(&after.look)?, share))
        });
        snapshots.map_or_else(|| self.present(), |(a, b, share)| fade(&a.look(), &b.look(), share, basis))
    }
}

impl Reader<'_> {
    /// The member `timeline`; keys of looks that are not in `names` are left out with a warning.
    pub(super) fn timeline(&mut self, value: &Value, names: &[&str]) -> Result<Timeline> {
        let object = self.object(value)?;
        self.report_unknown(object, &["fps", "keys"]);
        let fps = self.optional(object, "fps", |r, v| r.number(v, &FPS))?.unwrap_or(DEFAULT_FPS);
        let keys = self.optional(object, "keys", |r, v| r.keys(v, names))?.unwrap_or_default();
        Ok(Timeline { fps, keys })
    }

    fn keys(&mut self, value: &Value, names: &[&str]) -> Result<Vec<Key>> {
        let list = self.array(value)?;
        let read = list.iter().enumerate().map(|(idx, value)| self.part(idx, |reader| reader.key(value, names)));
        let mut keys: Vec<Key> = read.filter_map(|key| key.map(Option::flatten).transpose()).collect::<Result<_>>()?;
        keys.sort_by(|a, b| a.secs.total_cmp(&b.secs));
        Ok(keys)
    }

    fn key(&mut self, value: &Value, names: &[&str]) -> Result<Option<Key>> {
        let object = self.object(value)?;
        self.report_unknown(object, &["time", "look", "ease"]);
        let lacks = |r: &Reader, key: &str| anyhow!("`{}.{key}` is missing: a key needs it", r.name());
        let secs = self.optional(object, "time", |r, v| r.number(v, &SECS))?.ok_or_else(|| lacks(self, "time"))?;
        let eases = Ease::ALL.map(|(ease, name, _)| (name, ease));
        let ease = self.optional(object, "ease", |r, v| r.by_name(v, eases))?.flatten().unwrap_or_default();
        let known = names.iter().map(|name| (*name, (*name).to_owned()));
        if object.get("look").is_none_or(Value::is_null) {
            return Err(lacks(self, "look"));
        }
        let look = self.optional(object, "look", |r, v| r.by_name(v, known))?.flatten();
        Ok(look.map(|look| Key { secs, look, ease }))
    }
}

/// JSON of a timeline; none where there is nothing to say.
pub(super) fn json(timeline: &Timeline) -> Option<String> {
    let key = |key: &Key| {
        let ease = Ease::ALL.iter().find(|(ease, ..)| *ease == key.ease).filter(|(ease, ..)| *ease != Ease::default());
        let ease = ease.map_or(String::new(), |(_, name, _)| format!(", {}", member("ease", name)));
        format!("      {{ {}, \"look\": {}{ease} }}", member("time", &key.secs), value(&key.look))
    };
    let keys: Vec<String> = timeline.keys.iter().map(key).collect();
    let members = [
        (timeline.fps != DEFAULT_FPS).then(|| member("fps", &timeline.fps)),
        (!keys.is_empty()).then(|| format!("\"keys\": [\n{}\n    ]", keys.join(",\n"))),
    ];
    let members: Vec<String> = members.into_iter().flatten().collect();
    (!members.is_empty()).then(|| format!("{{ {} }}", members.join(", ")))
}

#[cfg(test)]
mod tests {
    use clerestory_transport::light::LightSetting;

    use super::*;

    fn look() -> Look {
        let mut look = Look::default();
        for (name, intensity) in [("A", 2.0), ("B", 4.0)] {
            look.lights.lights.insert("lamp".into(), LightSetting { intensity, ..LightSetting::default() });
            look.keep(name);
        }
        look
    }

    fn level(look: &Look, secs: f32) -> f32 {
        look.at(secs, None).lights.lights["lamp"].intensity
    }

    #[test]
    fn keys_are_reached_at_their_times_and_eased_between() {
        let mut look = look();
        assert_eq!(level(&look, 7.0), 4.0, "without keys it is the present look");
        for (secs, name, ease) in [(4.0, "A", Ease::Linear), (1.0, "A", Ease::Smooth), (3.0, "B", Ease::Hold)] {
            look.timeline.add(Key { secs, look: name.into(), ease });
        }
        let seen = [0.0, 1.0, 1.5, 2.0, 3.0, 3.9, 4.0, 9.0].map(|secs| level(&look, secs));
        let smooth = 2.0 + 2.0 * (0.25f32 * 0.25 * 2.5);
        for (seen, expected) in seen.into_iter().zip([2.0, 2.0, smooth, 3.0, 4.0, 4.0, 2.0, 2.0]) {
            assert!((seen - expected).abs() < 1e-5, "{seen} is not {expected}");
        }
        assert_eq!(look.timeline.n_frames(), 97);
        assert_eq!(look.timeline.move_to(0, 3.5), 1);
        look.timeline.add(Key { secs: 3.5, look: "B".into(), ease: Ease::Linear });
        assert_eq!(look.timeline.keys.iter().map(|key| key.secs).collect::<Vec<_>>(), [3.0, 3.5, 4.0]);
        assert_eq!(look.timeline.keys[1].look, "B", "the newer one of a time stays");
    }

    #[test]
    fn keys_stay_within_what_a_file_may_say() {
        let mut look = look();
        look.timeline.add(Key { secs: 86_401.0, look: "A".into(), ease: Ease::Smooth });
        look.timeline.add(Key { secs: -1.0, look: "B".into(), ease: Ease::Smooth });
        look.timeline.move_to(0, f32::INFINITY);
        assert_eq!(look.timeline.keys.iter().map(|key| key.secs).collect::<Vec<_>>(), [86_400.0; 2]);
        assert_eq!(Look::from_json(&look.to_json()).unwrap().0, look);
    }

    #[test]
    fn a_timeline_is_written_and_read() {
        let mut look = look();
        look.timeline.fps = 25.0;
        look.timeline.add(Key { secs: 0.0, look: "A".into(), ease: Ease::Smooth });
        look.timeline.add(Key { secs: 2.5, look: "B".into(), ease: Ease::Hold });
        let (back, warnings) = Look::from_json(&look.to_json()).unwrap();
        assert_eq!((&back, warnings.len()), (&look, 0), "{}", look.to_json());
    }

    #[test]
    fn keys_without_a_look_are_told_and_faults_are_named() {
        let of = |keys: &str| {
            format!("{{\"clerestory\": 1, \"looks\": [{{\"name\": \"A\"}}],\n\"timeline\": {{\"keys\": [{keys}]}}}}")
        };
        let (look, warnings) = Look::from_json(&of("{\"time\": 1, \"look\": \"Z\"}")).unwrap();
        assert!(look.timeline.keys.is_empty() && warnings[0].contains("known are `A`"), "{warnings:?}");
        for (key, wanted) in [
            ("{\"look\": \"A\"}", "`timeline.keys[0].time` is missing"),
            ("{\"time\": 1}", "`timeline.keys[0].look` is missing"),
            ("{\"time\": 1, \"look\": null}", "`timeline.keys[0].look` is missing"),
            ("{\"time\": -1, \"look\": \"A\"}", "line 2, column 32: `timeline.keys[0].time`"),
        ] {
            let error = Look::from_json(&of(key)).unwrap_err().to_string();
            assert!(error.contains(wanted), "{key}: {error}");
        }
    }
}
