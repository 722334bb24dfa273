//! Named snapshots of the look: kept, taken over, renamed, put in order; and which of them is on.

use std::collections::BTreeSet;

use anyhow::{Result, anyhow, bail};
use clerestory_transport::light::LightRig;
use serde_json::Value;

use super::parse::Reader;
use super::write::{lighting_members, value};
use super::{Display, Look};

/// Snapshots of one document.
const MAX_SNAPSHOTS: usize = 500;

/// A look with a name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Snapshot {
    /// No other snapshot of the document has it.
    pub name: String,
    /// Settings by lamp, and spots by panel.
    pub lights: LightRig,
    /// How radiance becomes a picture.
    pub display: Display,
}

impl Snapshot {
    /// The snapshot as a document of its own.
    pub fn look(&self) -> Look {
        Look { lights: self.lights.clone(), display: self.display, ..Look::default() }
    }
}

/// How the present look stands to the snapshot that it came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// It came from another one, or from none.
    Off,
    /// It is as it was kept.
    On,
    /// It came from there and was changed since.
    Changed,
}

impl Look {
    /// What is lit now, without snapshots and timeline.
    pub fn present(&self) -> Look {
        let (lights, names) = (self.lights.clone(), self.names.clone());
        Look { lights, names, display: self.display, ..Look::default() }
    }

    /// The snapshot of that name.
    pub fn snapshot(&self, name: &str) -> Option<&Snapshot> {
        self.snapshots.iter().find(|snapshot| snapshot.name == name)
    }

    /// The snapshot of that name as a document of its own.
    ///
    /// # Errors
    /// Names those that there are.
    pub fn named(&self, name: &str) -> Result<Look> {
        let known: Vec<String> = self.snapshots.iter().map(|snapshot| format!("`{}`", snapshot.name)).collect();
        let known = if known.is_empty() { "it has none".into() } else { format!("it has {}", known.join(", ")) };
        let found = self.snapshot(name).map(Snapshot::look);
        found.ok_or_else(|| anyhow!("the look has no snapshot `{name}`; {known}"))
    }

    /// How the present look stands to a snapshot.
    pub fn mark(&self, snapshot: &Snapshot) -> Mark {
        match self.on.as_deref() == Some(&snapshot.name) {
            false => Mark::Off,
            true if (&self.lights, &self.display) == (&snapshot.lights, &snapshot.display) => Mark::On,
            true => Mark::Changed,
        }
    }

    /// Whether a file holds so many more snapshots.
    pub fn has_room(&self, n_more: usize) -> bool {
        self.snapshots.len().saturating_add(n_more) <= MAX_SNAPSHOTS
    }

    /// Keeps the present look under a new name that begins with `stem`.
    pub fn keep(&mut self, stem: &str) {
        let present = Snapshot { name: String::new(), lights: self.lights.clone(), display: self.display };
        self.add(stem, present);
    }

    /// Adds a snapshot under a name that begins with `stem`, and marks it as the one that is on.
    pub fn add(&mut self, stem: &str, snapshot: Snapshot) {
        let name = self.free_name(stem);
        self.on = Some(name.clone());
        self.snapshots.push(Snapshot { name, ..snapshot });
    }

    /// Adds the looks of another document behind those that there are, each under a free name; what it has now is one of them, called
    /// `stem`, unless it was kept. What is lit, what it is called and what is on stays: lamps of two documents may share a key. Answers how
    /// many came; none where a file does not hold them all.
    pub fn add_all(&mut self, other: Look, stem: &str) -> Option<usize> {
        let present = Snapshot { name: stem.to_owned(), lights: other.lights, display: other.display };
        let is_kept = |kept: &Snapshot| (&kept.lights, &kept.display) == (&present.lights, &present.display);
        let is_new = !other.snapshots.iter().any(is_kept);
        let added: Vec<Snapshot> = other.snapshots.into_iter().chain(is_new.then_some(present)).collect();
        let n_added = added.len();
        if !self.has_room(n_added) {
            return None;
        }
        let own_lamps: BTreeSet<String> =
            self.rigs().flat_map(|rig| rig.lamps.iter().map(|lamp| lamp.key.clone())).collect();
        for snapshot in added {
            let name = self.free_name(&snapshot.name);
            self.snapshots.push(Snapshot { name, ..snapshot });
        }
        for (key, name) in other.names.into_iter().filter(|(key, _)| !own_lamps.contains(key)) {
            self.names.entry(key).or_insert(name);
        }
        Some(n_added)
    }

    /// Lights the scene as a snapshot says.
    pub fn take(&mut self, idx: usize) {
        let Some(snapshot) = self.snapshots.get(idx) else { return };
        (self.lights, self.display) = (snapshot.lights.clone(), snapshot.display);
        self.on = Some(snapshot.name.clone());
    }

    /// Makes a snapshot what the present look is.
    pub fn update(&mut self, idx: usize) {
        let Some(snapshot) = self.snapshots.get_mut(idx) else { return };
        (snapshot.lights, snapshot.display) = (self.lights.clone(), self.display);
        self.on = Some(snapshot.name.clone());
    }

    /// Gives a snapshot another name; keys of the timeline follow.
    ///
    /// # Errors
    /// If another snapshot has that name, or it is empty.
    pub fn rename(&mut self, idx: usize, name: &str) -> Result<()> {
        let name = name.trim();
        if name.is_empty() {
            bail!("a look needs a name");
        }
        if self.snapshots.iter().enumerate().any(|(other, snapshot)| other != idx && snapshot.name == name) {
            bail!("another look is called `{name}`; choose another name");
        }
        let Some(snapshot) = self.snapshots.get_mut(idx) else { return Ok(()) };
        let old = std::mem::replace(&mut snapshot.name, name.to_owned());
        let keys = self.timeline.keys.iter_mut().map(|key| &mut key.look);
        for mention in keys.chain(&mut self.on).filter(|mention| **mention == old) {
            name.clone_into(mention);
        }
        Ok(())
    }

    /// Adds a copy of a snapshot behind it.
    pub fn duplicate(&mut self, idx: usize) {
        let Some(snapshot) = self.snapshots.get(idx) else { return };
        let stem = snapshot.name.trim_end_matches(|c: char| c.is_ascii_digit()).trim_end();
        let stem = if stem.is_empty() { snapshot.name.as_str() } else { stem };
        let copy = Snapshot { name: self.free_name(stem), ..snapshot.clone() };
        self.snapshots.insert(idx.saturating_add(1), copy);
    }

    /// Takes a snapshot away, and its keys of the timeline.
    pub fn delete(&mut self, idx: usize) {
        if idx >= self.snapshots.len() {
            return;
        }
        let name = self.snapshots.remove(idx).name;
        self.timeline.keys.retain(|key| key.look != name);
        self.on = self.on.take().filter(|on| *on != name);
    }

    /// Puts a snapshot in another place of the row.
    pub fn reorder(&mut self, from: usize, to: usize) {
        if from < self.snapshots.len() && to < self.snapshots.len() {
            let snapshot = self.snapshots.remove(from);
            self.snapshots.insert(to, snapshot);
        }
    }

    /// A name that no snapshot has: the stem itself, else with a number.
    fn free_name(&self, stem: &str) -> String {
        let numbered = (2..).map(|n| format!("{stem} {n}"));
        let mut names = std::iter::once(stem.to_owned()).filter(|name| !name.is_empty()).chain(numbered);
        names.find(|name| self.snapshot(name).is_none()).expect("numbers do not end")
    }

    /// The lightings of the document: the present one and those of all snapshots.
    pub fn rigs(&self) -> impl Iterator<Item = &LightRig> {
        std::iter::once(&self.lights).chain(self.snapshots.iter().map(|snapshot| &snapshot.lights))
    }

    /// The same, to change them.
    pub fn rigs_mut(&mut self) -> impl Iterator<Item = &mut LightRig> {
        std::iter::once(&mut self.lights).chain(self.snapshots.iter_mut().map(|snapshot| &mut snapshot.lights))
    }
}

impl Reader<'_> {
    /// The member `looks`.
    pub(super) fn snapshots(&mut self, value: &Value) -> Result<Vec<Snapshot>> {
        let list = self.array(value)?;
        if list.len() > MAX_SNAPSHOTS {
            bail!("`{}` has {} looks; a document holds {MAX_SNAPSHOTS} at most", self.name(), list.len());
        }
        let mut snapshots: Vec<Snapshot> = Vec::new();
        for (idx, value) in list.iter().enumerate() {
            snapshots.extend(self.part(idx, |reader| reader.snapshot(value, &snapshots))?);
        }
        Ok(snapshots)
    }

    fn snapshot(&mut self, value: &Value, others: &[Snapshot]) -> Result<Snapshot> {
        let object = self.object(value)?;
        self.report_unknown(object, &[&["name"], &super::parse::LIGHTING[..]].concat());
        let name = self.optional(object, "name", |r, v| r.text(v))?.unwrap_or_default();
        if name.is_empty() || others.iter().any(|other| other.name == name) {
            bail!("`{}.name` is `{name}`; give each look a name of its own", self.name());
        }
        let (lights, display) = self.lighting(object)?;
        Ok(Snapshot { name, lights, display })
    }
}

/// JSON of a snapshot, from the second line on behind `indent`.
pub(super) fn json(snapshot: &Snapshot, indent: &str) -> String {
    let deeper = format!("{indent}  ");
    let mut members = vec![format!("{deeper}\"name\": {}", value(&snapshot.name))];
    members.extend(lighting_members(&snapshot.lights, &snapshot.display, &deeper));
    format!("{{\n{}\n{indent}}}", members.join(",\n"))
}

#[cfg(test)]
mod tests {
    use clerestory_transport::lamps::{FreeLamp, LampShape, LampUnit};
    use clerestory_transport::light::LightSetting;
    use glam::Vec3;

    use super::super::timeline::{Ease, Key};
    use super::*;

    fn lit(intensity: f32) -> Look {
        let mut look = Look::default();
        look.lights.lights.insert("lamp".into(), LightSetting { intensity, ..LightSetting::default() });
        look
    }

    fn names(look: &Look) -> Vec<&str> {
        look.snapshots.iter().map(|snapshot| snapshot.name.as_str()).collect()
    }

    #[test]
    fn a_look_that_was_kept_is_on_until_it_is_changed() {
        let mut look = lit(2.0);
        look.keep("Day");
        assert_eq!(look.mark(&look.snapshots[0]), Mark::On);
        look.lights = lit(3.0).lights;
        assert_eq!(look.mark(&look.snapshots[0]), Mark::Changed);
        look.keep("Day");
        assert_eq!(names(&look), ["Day", "Day 2"]);
        assert_eq!((look.mark(&look.snapshots[0]), look.mark(&look.snapshots[1])), (Mark::Off, Mark::On));
        look.take(0);
        assert_eq!((look.lights.lights["lamp"].intensity, look.on.as_deref()), (2.0, Some("Day")));
        look.lights = lit(5.0).lights;
        look.update(0);
        assert_eq!((look.named("Day").unwrap().lights, look.mark(&look.snapshots[0])), (lit(5.0).lights, Mark::On));
        assert!(look.named("Night").unwrap_err().to_string().contains("`Day`, `Day 2`"));
    }

    #[test]
    fn keys_of_the_timeline_follow_a_name_and_go_with_it() {
        let mut look = lit(1.5);
        look.keep("A");
        look.keep("B");
        for (secs, name) in [(0.0, "A"), (1.0, "B"), (2.0, "A")] {
            look.timeline.keys.push(Key { secs, look: name.into(), ease: Ease::Smooth });
        }
        look.take(0);
        look.rename(0, " Dawn ").unwrap();
        assert_eq!((names(&look), look.on.as_deref()), (vec!["Dawn", "B"], Some("Dawn")));
        assert_eq!(look.timeline.keys.iter().filter(|key| key.look == "Dawn").count(), 2);
        assert!(look.rename(1, "Dawn").is_err() && look.rename(1, " ").is_err());
        look.duplicate(0);
        assert_eq!(names(&look), ["Dawn", "Dawn 2", "B"]);
        look.reorder(2, 0);
        assert_eq!(names(&look), ["B", "Dawn", "Dawn 2"]);
        look.delete(1);
        assert_eq!((names(&look), look.on.as_deref(), look.timeline.keys.len()), (vec!["B", "Dawn 2"], None, 1));
    }

    #[test]
    fn looks_of_another_document_come_behind_under_free_names() {
        let (mut look, mut other) = (lit(1.5), lit(2.5));
        look.keep("Day");
        other.keep("Day");
        other.names.insert("lamp".into(), "Desk".into());
        let before = (look.lights.clone(), look.on.clone());
        assert_eq!(look.add_all(other.clone(), "evening"), Some(1), "its present look was kept");
        other.lights = lit(3.5).lights;
        assert_eq!(look.add_all(other.clone(), "evening"), Some(2));
        assert_eq!(names(&look), ["Day", "Day 2", "Day 3", "evening"]);
        assert_eq!((look.snapshots[3].lights.lights["lamp"].intensity, look.name_of("lamp")), (3.5, "Desk"));
        assert_eq!((look.lights.clone(), look.on.clone()), before);
        while look.has_room(2) {
            look.keep("Look");
        }
        let n = look.snapshots.len();
        assert_eq!((look.add_all(other, "evening"), look.snapshots.len()), (None, n), "all or none");
    }

    #[test]
    fn a_lamp_keeps_its_name_where_another_document_calls_one_of_that_key_otherwise() {
        let lamp = |key: &str| FreeLamp {
            key: key.into(),
            shape: LampShape::Point,
            position: Vec3::ZERO,
            aim: Vec3::ZERO,
            strength: 1.0,
            unit: LampUnit::Lumen,
            setting: LightSetting::default(),
            turn_rad: 0.0,
            replaces: None,
        };
        let (mut look, mut other) = (Look::default(), Look::default());
        look.lights.lamps.push(lamp("Point lamp 1"));
        other.lights.lamps.extend(["Point lamp 1", "Point lamp 2"].map(lamp));
        other.names.extend(["1", "2"].map(|nth| (format!("Point lamp {nth}"), format!("Globe {nth}"))));
        assert_eq!(look.add_all(other, "evening"), Some(1));
        assert_eq!(["Point lamp 1", "Point lamp 2"].map(|key| look.name_of(key)), ["Point lamp 1", "Globe 2"]);
    }

    #[test]
    fn a_copy_of_a_number_has_a_name_and_there_are_as_many_looks_as_a_file_holds() {
        let mut look = lit(1.5);
        look.keep("2024");
        look.duplicate(0);
        assert_eq!(names(&look), ["2024", "2024 2"]);
        while look.has_room(1) {
            look.keep("Look");
        }
        let (again, warnings) = Look::from_json(&look.to_json()).unwrap();
        assert_eq!((again.snapshots.len(), warnings.len()), (look.snapshots.len(), 0));
        look.keep("Look");
        assert!(Look::from_json(&look.to_json()).is_err());
    }
}
