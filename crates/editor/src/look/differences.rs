//! Which members of a look differ from those of another one: what was edited.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::Value;

use super::Look;

/// Longest list of numbers of which each is a thing of its own, as those of a place are.
const MOST_APART: usize = 3;
/// End of the path of a color, which is one thing: who picks one may change any of its channels.
const COLOR: &str = ".color";

/// Members of a light of the scene.
const SETTINGS: [&str; 4] = ["intensity", "color", "kelvin", "muted"];

impl Look {
    /// Paths of the members that differ, by the names that they have in files, such as `lights.Spot.intensity` or
    /// `lamps.0.position.1`.
    pub fn differences(&self, other: &Look) -> BTreeSet<String> {
        let [own, others] = [self.apart_from(other), other.apart_from(self)].map(|look| members_in_file(&look));
        let mut paths = BTreeSet::new();
        collect([Some(&own), Some(&others)], "", &mut paths);
        paths
    }

    /// What an edit was about that leads here from another look, in words: a light, by what it is called there or else here, and what of
    /// it, or a part of the look, and how many more there are.
    pub fn edit_words(&self, other: &Look) -> Option<String> {
        let apart = self.lamps_apart(other);
        let is_of_lamp = |path: &str, keys: &BTreeSet<&str>| {
            path.starts_with("lamps.")
                || path.starts_with("wishes.held")
                || path.strip_prefix("names.").is_some_and(|key| keys.contains(key))
        };
        let paths = self.differences(other);
        // Where lamps came or went, those behind them have other numbers.
        let others = paths.iter().filter(|path| !apart.as_ref().is_some_and(|keys| is_of_lamp(path, keys)));
        let mut things: BTreeSet<String> = others.map(|path| self.thing_words(path)).collect();
        match &apart {
            Some(keys) if keys.is_empty() => _ = things.insert("lamps".into()),
            Some(keys) => things.extend(keys.iter().map(|key| format!("`{key}`"))),
            None => {}
        }
        let first = things.first()?;
        let names = self.names.iter().chain(&other.names).map(|(key, name)| (key.clone(), name.clone()));
        let first = Look { names: names.collect(), ..Look::default() }.renamed(first);
        Some(match things.len().saturating_sub(1) {
            0 => first,
            n_more => format!("{first} and {n_more} more"),
        })
    }

    fn thing_words(&self, path: &str) -> String {
        let (part, rest) = path.split_once('.').unwrap_or((path, ""));
        match part {
            "lights" => {
                let parted = rest.rsplit_once('.').filter(|(_, member)| SETTINGS.contains(member));
                parted.map_or_else(|| format!("`{rest}`"), |(key, member)| format!("`{key}`, {member}"))
            }
            "lamps" => self.lamp_words(rest),
            "panels" => "spots".into(),
            "on" => "looks".into(),
            part => part.to_owned(),
        }
    }

    /// The lamp of a number, and what of it.
    fn lamp_words(&self, path: &str) -> String {
        let mut parts = path.split('.');
        let lamp = parts.next().and_then(|nth| self.lights.lamps.get(nth.parse::<usize>().ok()?));
        match (lamp, parts.next()) {
            (Some(lamp), Some(member)) => format!("`{}`, {}", lamp.key, member.replace('_', " ")),
            _ => "lamps".into(),
        }
    }

    /// Keys of the lamps that came or went; `None` where there are as many as before.
    fn lamps_apart<'a>(&'a self, other: &'a Look) -> Option<BTreeSet<&'a str>> {
        let keys = |look: &'a Look| look.lights.lamps.iter().map(|lamp| lamp.key.as_str()).collect::<BTreeSet<_>>();
        let n_lamps = [self, other].map(|look| look.lights.lamps.len());
        let [longer, shorter] = if n_lamps[0] > n_lamps[1] { [self, other] } else { [other, self] };
        (n_lamps[0] != n_lamps[1]).then(|| keys(longer).difference(&keys(shorter)).copied().collect())
    }

    /// Without what the other one has alike: what is large and stays is not written.
    fn apart_from(&self, other: &Look) -> Look {
        Look {
            lights: apart(&self.lights, &other.lights),
            names: apart(&self.names, &other.names),
            display: apart(&self.display, &other.display),
            snapshots: apart(&self.snapshots, &other.snapshots),
            on: apart(&self.on, &other.on),
            timeline: apart(&self.timeline, &other.timeline),
            scene: apart(&self.scene, &other.scene),
            bookmarks: apart(&self.bookmarks, &other.bookmarks),
            wishes: apart(&self.wishes, &other.wishes),
            marks: apart(&self.marks, &other.marks),
            probes: apart(&self.probes, &other.probes),
        }
    }
}

fn apart<T: Clone + Default + PartialEq>(own: &T, other: &T) -> T {
    if own == other { T::default() } else { own.clone() }
}

fn members_in_file(look: &Look) -> Value {
    serde_json::from_str(&look.to_json()).expect("a look is written as JSON")
}

fn collect([own, others]: [Option<&Value>; 2], path: &str, paths: &mut BTreeSet<String>) {
    if own == others {
        return;
    }
    let [own, others] = [own, others].map(members_of);
    let keys: BTreeSet<&String> = own.keys().chain(others.keys()).collect();
    if keys.is_empty() || path.ends_with(COLOR) {
        paths.insert(path.to_owned());
        return;
    }
    for key in keys {
        let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
        collect([own.get(key).copied(), others.get(key).copied()], &path, paths);
    }
}

/// Members of an object and items of a list, by name and number; none of what is one thing.
fn members_of(value: Option<&Value>) -> BTreeMap<String, &Value> {
    match value {
        Some(Value::Object(members)) => members.iter().map(|(name, member)| (name.clone(), member)).collect(),
        Some(Value::Array(items)) if items.len() <= MOST_APART || items.iter().all(Value::is_object) => {
            items.iter().enumerate().map(|(nth, item)| (nth.to_string(), item)).collect()
        }
        _ => BTreeMap::new(),
    }
}

#[cfg(test)]
mod tests {
    use clerestory_transport::lamps::{FreeLamp, LampShape, LampUnit};
    use clerestory_transport::light::LightSetting;
    use glam::Vec3;

    use super::*;

    fn globe() -> FreeLamp {
        FreeLamp {
            key: "Globe 1".into(),
            shape: LampShape::Sphere { radius_m: 0.1 },
            position: Vec3::ONE,
            aim: Vec3::ZERO,
            strength: 800.0,
            unit: LampUnit::Lumen,
            setting: LightSetting::default(),
            turn_rad: 0.0,
            replaces: None,
        }
    }

    #[test]
    fn an_edit_is_told_in_words() {
        let mut look = Look::default();
        look.lights.lamps.push(globe());
        let words = |edit: fn(&mut Look)| {
            let mut other = look.clone();
            edit(&mut other);
            other.edit_words(&look).unwrap_or_default()
        };
        let brighter = LightSetting { intensity: 2.0, ..LightSetting::default() };
        assert_eq!(words(|_| {}), "");
        assert_eq!(words(|look| look.lights.lamps[0].position = Vec3::ZERO), "`Globe 1`, position");
        assert_eq!(words(|look| look.lights.lamps.clear()), "`Globe 1`");
        assert_eq!(words(|look| look.lights.lamps.push(FreeLamp { key: "New".into(), ..globe() })), "`New`");
        assert_eq!(words(|look| look.display.exposure_ev = Some(1.0)), "display");
        let mut other = look.clone();
        other.lights.set("Spot. 1", brighter);
        assert_eq!(other.edit_words(&look).as_deref(), Some("`Spot. 1`, intensity"));
        other.display.exposure_ev = Some(1.0);
        assert_eq!(look.edit_words(&other).as_deref(), Some("`Spot. 1`, intensity and 1 more"));
    }

    #[test]
    fn of_lamps_that_came_or_went_each_is_told_once() {
        let lamp = |nth: usize| FreeLamp { key: format!("Globe {nth}"), ..globe() };
        let mut look = Look::default();
        look.lights.lamps = (1..=7).map(lamp).collect();
        let mut fewer = look.clone();
        fewer.lights.lamps.retain(|lamp| ["Globe 1", "Globe 7"].contains(&lamp.key.as_str()));
        for [from, to] in [[&look, &fewer], [&fewer, &look]] {
            assert_eq!(to.edit_words(from).as_deref(), Some("`Globe 2` and 4 more"));
        }
        fewer.display.exposure_ev = Some(1.0);
        assert_eq!(look.edit_words(&fewer).as_deref(), Some("`Globe 2` and 5 more"));
    }

    #[test]
    fn lights_are_told_by_what_they_are_called() {
        let mut look = Look::default();
        look.lights.lamps.push(globe());
        look.names.insert("Globe 1".into(), "Desk".into());
        let mut other = look.clone();
        other.lights.lamps[0].setting.intensity = 2.0;
        assert_eq!(other.edit_words(&look).as_deref(), Some("`Desk`, intensity"));
        // Its name goes with it.
        let bare = Look::default();
        assert_eq!(bare.edit_words(&look).as_deref(), Some("`Desk`"));
        assert_eq!(look.edit_words(&bare).as_deref(), Some("`Desk`"));
        look.wishes.held.insert("Globe 1".into());
        assert_eq!(bare.edit_words(&look).as_deref(), Some("`Desk`"), "and so does that it is held");
    }

    #[test]
    fn what_was_edited_is_named_by_light_and_member() {
        let mut look = Look::default();
        look.lights.lamps.push(globe());
        let edited = |edit: fn(&mut Look)| {
            let mut other = look.clone();
            edit(&mut other);
            let found = other.differences(&look);
            assert_eq!(found, look.differences(&other), "whichever was first");
            Vec::from_iter(found)
        };
        assert_eq!(edited(|_| {}), [""; 0]);
        assert_eq!(edited(|look| look.lights.lamps[0].position.y = 2.0), ["lamps.0.position.1"]);
        assert_eq!(edited(|look| look.lights.lamps[0].strength = 900.0), ["lamps.0.strength"]);
        assert_eq!(
            edited(|look| look.lights.set("Spot", LightSetting { intensity: 2.0, ..LightSetting::default() })),
            ["lights.Spot.intensity"]
        );
        assert_eq!(
            edited(|look| {
                let color = Some([1.0, 0.5, 0.25]);
                look.lights.set("Desk", LightSetting { color, muted: true, ..LightSetting::default() });
            }),
            ["lights.Desk.color", "lights.Desk.muted"]
        );
        assert_eq!(edited(|look| look.display.exposure_ev = Some(1.0)), ["display.exposure_ev"]);
    }
}
