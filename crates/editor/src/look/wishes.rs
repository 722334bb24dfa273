//! What a designer wished for, as a look keeps it: by names and marks, so that it can be asked of another bake as well. What of
//! it can be solved where, [`crate::solve::kept`] says.

use std::collections::BTreeSet;
use std::ops::RangeInclusive;
use std::path::Path;

use anyhow::{Result, anyhow, bail, ensure};
use clerestory_relight::Tone;
use serde_json::{Map, Value};

use super::marked::{self, MOST_MARKED};
use super::parse::Reader;
use super::write::{member, value};
use crate::marks::Marked;
use crate::solve::Request;

/// Wishes of one document.
const MOST_WISHES: usize = 500;
/// Lux, cd/m² and multiples.
const AMOUNT: RangeInclusive<f64> = 0.0..=1e9;
/// How much a wish counts.
const WEIGHT: RangeInclusive<f64> = 0.0..=1e9;
const FACTOR: RangeInclusive<f64> = 0.0..=1e6;
const KEEP: RangeInclusive<f64> = 0.0..=1e3;
const EXPOSURE_EV: RangeInclusive<f64> = -60.0..=60.0;

/// Tone curves that a picture may have been made with.
pub const CURVES: [Tone; 5] = [Tone::Linear, Tone::Agx, Tone::Aces, Tone::Neutral, Tone::Reinhard];

/// Wishes, and what may change for them.
#[derive(Clone, Debug, PartialEq)]
pub struct Wishes {
    /// One after the other.
    pub list: Vec<Entry>,
    /// Keys of lights that may not change.
    pub held: BTreeSet<String>,
    /// Least and largest intensity, times the file.
    pub bounds: [f64; 2],
    /// Most saturation of colors that may change; none where they stay.
    pub colors: Option<f64>,
    /// How much the rest of the picture is kept; see [`Request::keep`].
    pub keep: f64,
}

/// A wish.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// For people.
    pub name: String,
    /// Where.
    pub place: Where,
    /// What.
    pub wanted: Wanted,
    /// How much it counts beside the others; 1 is usual.
    pub weight: f64,
}

/// Where something is wanted.
#[derive(Clone, Debug, PartialEq)]
pub enum Where {
    /// In the whole picture.
    Whole,
    /// Where it was marked.
    Marked(Marked),
    /// On the sensors of a name.
    Sensors(String),
}

/// What is wanted of a place.
#[derive(Clone, Debug, PartialEq)]
pub enum Wanted {
    /// Mean illuminance, lux.
    Lux(f64),
    /// Mean luminance, cd/m².
    Luminance(f64),
    /// So many times what it has now.
    Times(f64),
    /// As it is now.
    Keep,
    /// Like a picture.
    Match {
        /// Its file.
        file: String,
        /// The tone curve that it was made with; as the file says where none is given.
        tone: Option<Tone>,
        /// How it was exposed, EV; found where none is given.
        exposure_ev: Option<f64>,
    },
}

impl Entry {
    /// Pixels that it marks.
    pub fn n_marked(&self) -> usize {
        match &self.place {
            Where::Marked(marked) => marked.marks.pixels().len(),
            Where::Whole | Where::Sensors(_) => 0,
        }
    }
}

impl Default for Wishes {
    fn default() -> Self {
        let usual = Request::default();
        let (list, held) = (Vec::new(), BTreeSet::new());
        Wishes { list, held, bounds: usual.bounds, colors: None, keep: usual.keep }
    }
}

impl Wishes {
    /// Whether a file holds one more.
    pub fn has_room(&self) -> bool {
        self.list.len() < MOST_WISHES
    }

    /// The same of one that marks so many pixels.
    pub fn has_room_for(&self, n_marked: usize) -> bool {
        self.has_room() && n_marked <= self.n_left()
    }

    /// Pixels that a file can mark beside these.
    pub fn n_left(&self) -> usize {
        MOST_MARKED.saturating_sub(self.list.iter().map(Entry::n_marked).sum())
    }

    /// One more wish; its name tells it from the others.
    pub fn push(&mut self, name: &str, place: Where, wanted: Wanted) {
        let is_taken = |name: &str| self.list.iter().any(|entry| entry.name == name);
        let numbered = || (2..).map(|n: u64| format!("{name} {n}")).find(|name| !is_taken(name));
        let own = Some(name.to_owned()).filter(|name| !is_taken(name)).or_else(numbered).unwrap_or_default();
        self.list.push(Entry { name: own, place, wanted, weight: 1.0 });
    }

    /// Names of the files of pictures to match.
    pub fn files(&self) -> impl Iterator<Item = &str> {
        self.list.iter().filter_map(|entry| match &entry.wanted {
            Wanted::Match { file, .. } => Some(file.as_str()),
            _ => None,
        })
    }

    fn files_mut(&mut self) -> impl Iterator<Item = &mut String> {
        self.list.iter_mut().filter_map(|entry| match &mut entry.wanted {
            Wanted::Match { file, .. } => Some(file),
            _ => None,
        })
    }

    /// Names files from the root.
    pub(super) fn resolve(&mut self, folder: &Path) {
        for file in self.files_mut() {
            let path = folder.join(&*file);
            *file = std::path::absolute(&path).unwrap_or(path).display().to_string();
        }
    }

    /// Names files relative to `folder` where they lie in it, so that the folder can be moved.
    pub(super) fn relative(&mut self, folder: &Path) {
        let folder = std::path::absolute(folder).unwrap_or_else(|_| folder.into());
        for file in self.files_mut() {
            if let Ok(within) = Path::new(&*file).strip_prefix(&folder) {
                *file = within.display().to_string();
            }
        }
    }
}

/// The member `wishes`, with what differs from none.
pub(super) fn json(wishes: &Wishes) -> Option<String> {
    let usual = Wishes::default();
    let lines: Vec<String> = wishes.list.iter().map(|entry| format!("      {}", entry_json(entry))).collect();
    let members = [
        (!lines.is_empty()).then(|| format!("\"list\": [\n{}\n    ]", lines.join(",\n"))),
        (!wishes.held.is_empty()).then(|| format!("\"held\": {}", value(&wishes.held))),
        (wishes.bounds != usual.bounds).then(|| member("factor", &wishes.bounds)),
        wishes.colors.map(|colors| member("colors", &colors)),
        (wishes.keep != usual.keep).then(|| member("keep", &wishes.keep)),
    ];
    let members: Vec<String> = members.into_iter().flatten().map(|member| format!("    {member}")).collect();
    (!members.is_empty()).then(|| format!("  \"wishes\": {{\n{}\n  }}", members.join(",\n")))
}

fn entry_json(entry: &Entry) -> String {
    let mut members = vec![format!("\"name\": {}", value(&entry.name))];
    members.extend(match &entry.place {
        Where::Whole => None,
        Where::Marked(marked) => Some(format!("\"marks\": {}", marked::json(marked))),
        Where::Sensors(name) => Some(format!("\"sensors\": {}", value(name))),
    });
    match &entry.wanted {
        Wanted::Lux(lux) => members.push(member("lux", lux)),
        Wanted::Luminance(nit) => members.push(member("cd_m2", nit)),
        Wanted::Times(times) => members.push(member("times", times)),
        Wanted::Keep => members.push(member("keep", &true)),
        Wanted::Match { file, tone, exposure_ev } => {
            members.push(format!("\"match\": {}", value(file)));
            members.extend(tone.map(|tone| member("tone", &tone)));
            members.extend(exposure_ev.map(|ev| member("exposure", &ev)));
        }
    }
    members.extend((entry.weight != 1.0).then(|| member("weight", &entry.weight)));
    format!("{{ {} }}", members.join(", "))
}

impl Reader<'_> {
    /// What is wished for, and what may change for it.
    pub(super) fn wishes(&mut self, value: &Value) -> Result<Wishes> {
        let object = self.object(value)?;
        self.report_unknown(object, &["list", "held", "factor", "colors", "keep"]);
        let usual = Wishes::default();
        let bounds = self.optional(object, "factor", |reader, value| {
            let [least, most] = <[f64; 2]>::try_from(reader.amounts(value, &FACTOR)?)
                .map_err(|_| anyhow!("`{}` must be [least, most]", reader.name()))?;
            ensure!(least <= most, "`{}` must be [least, most]", reader.name());
            Ok([least, most])
        })?;
        Ok(Wishes {
            list: self.optional(object, "list", |r, v| r.wish_list(v))?.unwrap_or_default(),
            held: self.optional(object, "held", |r, v| r.held(v))?.unwrap_or_default(),
            bounds: bounds.unwrap_or(usual.bounds),
            colors: self.optional(object, "colors", |r, v| r.amount(v, &(0.0..=1.0)))?,
            keep: self.optional(object, "keep", |r, v| r.amount(v, &KEEP))?.unwrap_or(usual.keep),
        })
    }

    fn wish_list(&mut self, value: &Value) -> Result<Vec<Entry>> {
        let list = self.array(value)?;
        ensure!(list.len() <= MOST_WISHES, "a look has at most {MOST_WISHES} wishes, not {}", list.len());
        let mut left = MOST_MARKED;
        let entries =
            list.iter().enumerate().map(|(idx, value)| self.part(idx, |reader| reader.wish(value, &mut left)));
        entries.filter_map(Result::transpose).collect()
    }

    fn wish(&mut self, value: &Value, left: &mut usize) -> Result<Entry> {
        let object = self.object(value)?;
        let known =
            ["name", "marks", "sensors", "lux", "cd_m2", "times", "keep", "match", "tone", "exposure", "weight"];
        self.report_unknown(object, &known);
        let name = self.optional(object, "name", |r, v| r.text(v))?;
        let name = name.ok_or_else(|| anyhow!("`{}.name` is missing: a wish needs it", self.name()))?;
        let marked = self.optional(object, "marks", |r, v| r.marked(v, left))?;
        let sensors = self.optional(object, "sensors", |r, v| r.text(v))?;
        let place = match (marked, sensors) {
            (Some(marked), None) => Where::Marked(marked),
            (None, Some(name)) => Where::Sensors(name),
            // Marks that could not be read must not become a wish for the whole picture.
            (None, None) if !object.contains_key("marks") && !object.contains_key("sensors") => Where::Whole,
            _ => bail!("`{}` needs one of `marks` and `sensors`, or neither for the whole picture", self.name()),
        };
        let wanted = self.wanted(object)?;
        let weight = self.optional(object, "weight", |r, v| r.amount(v, &WEIGHT))?.unwrap_or(1.0);
        Ok(Entry { name, place, wanted, weight })
    }

    fn wanted(&mut self, object: &Map<String, Value>) -> Result<Wanted> {
        let mut all = Vec::new();
        all.extend(self.optional(object, "lux", |r, v| r.amount(v, &AMOUNT))?.map(Wanted::Lux));
        all.extend(self.optional(object, "cd_m2", |r, v| r.amount(v, &AMOUNT))?.map(Wanted::Luminance));
        all.extend(self.optional(object, "times", |r, v| r.amount(v, &AMOUNT))?.map(Wanted::Times));
        let keeps = self.optional(object, "keep", |r, v| r.truth(v))?;
        all.extend(keeps.filter(|keeps| *keeps).map(|_| Wanted::Keep));
        if let Some(file) = self.optional(object, "match", |r, v| r.text(v))? {
            let tone = self.optional(object, "tone", |r, v| r.one_of(v, &CURVES))?.flatten();
            let exposure_ev = self.optional(object, "exposure", |r, v| r.amount(v, &EXPOSURE_EV))?;
            all.push(Wanted::Match { file, tone, exposure_ev });
        }
        let one = <[Wanted; 1]>::try_from(all).map(|[wanted]| wanted);
        one.map_err(|_| anyhow!("`{}` needs one of `lux`, `cd_m2`, `times`, `keep` and `match`", self.name()))
    }

    fn held(&mut self, value: &Value) -> Result<BTreeSet<String>> {
        let list = self.array(value)?.iter().enumerate();
        let keys = list.map(|(idx, key)| self.part(idx, |reader| reader.text(key)));
        keys.filter_map(Result::transpose).collect()
    }

    fn amounts(&mut self, value: &Value, range: &RangeInclusive<f64>) -> Result<Vec<f64>> {
        self.array(value)?.iter().map(|value| self.amount(value, range)).collect()
    }

    /// A number with all of its digits.
    fn amount(&self, value: &Value, range: &RangeInclusive<f64>) -> Result<f64> {
        self.number(value, range)?;
        Ok(value.as_f64().unwrap_or_default())
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use clerestory_transport::camera::Film;

    use super::*;
    use crate::look::Look;
    use crate::marks::{Framing, Marks};

    fn rich() -> Look {
        let film = Film { width: 8, height: 6 };
        let marks = Arc::new(Marks::rect(film, [[1.0, 1.0], [4.0, 3.0]]));
        let marked = Marked { framing: Framing { film, camera: None }, marks };
        let mut wishes = Wishes {
            held: ["Lamp, \"A\"".to_owned()].into(),
            bounds: [0.25, 8.0],
            colors: Some(0.3),
            keep: 0.1 + 0.2,
            ..Wishes::default()
        };
        wishes.push("Desk", Where::Marked(marked), Wanted::Lux(500.5));
        wishes.push("Floor", Where::Sensors("Floor".into()), Wanted::Times(1.0 / 3.0));
        wishes.push("Desk", Where::Whole, Wanted::Keep);
        wishes.push("Wall", Where::Whole, Wanted::Luminance(20.0));
        let plain = Wanted::Match { file: "/a/photo.png".into(), tone: None, exposure_ev: None };
        wishes.push("photo.png", Where::Whole, plain);
        let told = Wanted::Match { file: "/b/c.exr".into(), tone: Some(Tone::Agx), exposure_ev: Some(-1.5) };
        wishes.push("c.exr", Where::Whole, told);
        wishes.list[0].weight = 2.5;
        Look { wishes, ..Look::default() }
    }

    #[test]
    fn wishes_come_back_as_they_were() {
        let look = rich();
        let (back, warnings) = Look::from_json(&look.to_json()).unwrap();
        assert_eq!(back, look, "{}", look.to_json());
        assert!(warnings.is_empty(), "{warnings:?}");
        assert_eq!(look.wishes.list[2].name, "Desk 2", "names tell wishes apart");
        assert!(!Look::default().to_json().contains("wishes"));
    }

    #[test]
    fn a_file_with_as_many_wishes_as_there_is_room_for_is_read() {
        let (wish, mut look) = (rich().wishes.list[3].clone(), Look::default());
        while look.wishes.has_room() {
            look.wishes.list.push(wish.clone());
        }
        assert_eq!(Look::from_json(&look.to_json()).unwrap().0, look);
        look.wishes.list.push(wish);
        assert!(Look::from_json(&look.to_json()).is_err());
    }

    #[test]
    fn wishes_mark_no_more_pixels_than_a_file_is_read_with() {
        let film = Film { width: 1024, height: 512 };
        let marks = Arc::new(Marks::rect(film, [[0.0, 0.0], [1024.0, 512.0]]));
        let n_marked = marks.pixels().len();
        let place = Where::Marked(Marked { framing: Framing { film, camera: None }, marks });
        let mut wishes = Wishes::default();
        while wishes.has_room_for(n_marked) {
            wishes.push("Desk", place.clone(), Wanted::Keep);
        }
        assert_eq!(wishes.list.len(), MOST_MARKED / n_marked);
        assert!(wishes.has_room(), "one of the whole picture marks nothing");
    }

    #[test]
    fn pictures_are_named_beside_the_look() {
        let mut wishes = rich().wishes;
        wishes.relative(Path::new("/a"));
        assert_eq!(wishes.files().collect::<Vec<_>>(), ["photo.png", "/b/c.exr"]);
        wishes.resolve(Path::new("/a"));
        assert_eq!(wishes, rich().wishes);
    }

    #[test]
    fn a_wish_that_is_none_is_told_with_its_place_and_the_others_stay() {
        let json = rich().to_json();
        let cases = [
            (json.replacen("\"lux\": 500.5", "\"lux\": -1", 1), "`wishes.list[0].lux`"),
            (json.replacen("\"lux\"", "\"lumen\"", 1), "`wishes.list[0]` needs one of"),
            (json.replacen("\"lux\": 500.5", "\"lux\": 5, \"times\": 2", 1), "`wishes.list[0]` needs one of"),
            (json.replacen("\"runs\": [", "\"runs\": [900, ", 1), "`wishes.list[0].marks.runs`"),
            (json.replacen("\"sensors\": \"Floor\"", "\"sensors\": 3", 1), "`wishes.list[1].sensors`"),
            (json.replacen("\"name\": \"Desk\", ", "", 1), "`wishes.list[0].name` is missing"),
        ];
        for (json, words) in cases {
            let error = format!("{:#}", Look::from_json(&json).unwrap_err());
            assert!(error.contains(words), "{words}: {error}");
            let (look, warnings) = Look::recover(&json).unwrap();
            assert_eq!(look.wishes.list.len(), 5, "{words}: {warnings:?}");
        }
        let least_above_most = json.replacen("[0.25, 8.0]", "[9, 8]", 1);
        assert!(format!("{:#}", Look::from_json(&least_above_most).unwrap_err()).contains("`wishes.factor`"));
    }
}
