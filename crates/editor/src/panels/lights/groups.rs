//! Groups that the lights of a scene form by themselves.

use std::collections::{BTreeMap, BTreeSet};

use clerestory_transport::basis::{LightBasis, LightSource, SourceKind};
use clerestory_transport::light::{LightGroup, LightRig};
use serde::{Deserialize, Serialize};

use super::listed::{LightOf, Listed};
use crate::look::Look;
use crate::look::groups::{SEPARATOR, enter, own_name};

/// By what lights are sorted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum GroupBy {
    /// By place, and those that stand alone by their numbered names.
    #[default]
    Automatic,
    /// All in a row.
    Nothing,
    /// By the node of the file that they stand below.
    Place,
    /// By their names without the number at the end.
    Name,
    /// By the mesh or lamp of the file that they are instances of.
    Model,
    /// By their material.
    Material,
    /// By what they are.
    Kind,
}

impl GroupBy {
    /// All of them, in the order of the menu.
    pub const ALL: [GroupBy; 7] = [
        GroupBy::Automatic,
        GroupBy::Place,
        GroupBy::Name,
        GroupBy::Model,
        GroupBy::Material,
        GroupBy::Kind,
        GroupBy::Nothing,
    ];

    /// For the menu.
    pub fn name(self) -> &'static str {
        match self {
            GroupBy::Automatic => "Automatic",
            GroupBy::Nothing => "Nothing",
            GroupBy::Place => "Place",
            GroupBy::Name => "Name",
            GroupBy::Model => "Instance",
            GroupBy::Material => "Material",
            GroupBy::Kind => "Kind",
        }
    }

    /// What it does.
    pub fn words(self) -> &'static str {
        match self {
            GroupBy::Automatic => "By place, and lights that stand alone by their numbered names",
            GroupBy::Nothing => "All lights in one list",
            GroupBy::Place => "Lights below one node of the file",
            GroupBy::Name => "Lights whose names differ by a number at the end",
            GroupBy::Model => "Instances of one mesh or one lamp of the file",
            GroupBy::Material => "Surfaces of one material",
            GroupBy::Kind => "Point lamps, spot lamps, surfaces, panels, sky",
        }
    }
}

/// Lights that belong together.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Group {
    /// Its key in looks: by what it was made, and of what.
    pub key: String,
    /// What it is called.
    pub name: String,
    /// Indices of its lights in the list.
    pub lights: Vec<usize>,
}

/// A line of the panel.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Item {
    /// A light by itself, by its index in the list.
    Light(usize),
    /// Two lights or more.
    Group(Group),
}

impl Item {
    /// Indices of its lights.
    pub fn lights(&self) -> &[usize] {
        match self {
            Item::Light(idx) => std::slice::from_ref(idx),
            Item::Group(group) => &group.lights,
        }
    }
}

/// Sorts lights into groups, which stand where the first of their lights stands. One light makes no group.
pub(super) fn arranged(lights: &[Listed], by: GroupBy, look: &Look) -> Vec<Item> {
    let keys: Vec<Option<String>> = match by {
        GroupBy::Nothing => vec![None; lights.len()],
        _ => {
            let places = places(lights);
            lights.iter().map(|light| group_key(light, by, &places)).collect()
        }
    };
    let mut members: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    for (idx, key) in keys.iter().enumerate() {
        if let Some(key) = key {
            members.entry(key).or_default().push(idx);
        }
    }
    let mut items = Vec::new();
    for (idx, key) in keys.iter().enumerate() {
        match key.as_deref().map(|key| (key, &members[key])) {
            Some((key, lights)) if lights.len() > 1 => {
                if lights[0] == idx {
                    let name = look.names.get(key).cloned().unwrap_or_else(|| own_name(key).to_owned());
                    items.push(Item::Group(Group { key: key.to_owned(), name, lights: lights.clone() }));
                }
            }
            _ => items.push(Item::Light(idx)),
        }
    }
    items
}

/// How many lights stand below each place, by the path of its nodes.
fn places(lights: &[Listed]) -> BTreeMap<String, usize> {
    let mut places = BTreeMap::new();
    for light in lights {
        if let LightOf::Scene(source) = &light.light {
            for depth in 1..=source.origin.parents.len() {
                *places.entry(source.origin.parents[..depth].join(SEPARATOR)).or_default() += 1;
            }
        }
    }
    places
}

/// The group of a light; sky and free lamps keep to themselves however the others are sorted.
fn group_key(light: &Listed, by: GroupBy, places: &BTreeMap<String, usize>) -> Option<String> {
    let LightOf::Scene(source) = &light.light else { return Some(ADDED.into()) };
    let origin = &source.origin;
    match (source.kind, by) {
        (SourceKind::Sky | SourceKind::Dome { .. } | SourceKind::Sun { .. }, _) => Some("kind:Sky".into()),
        (_, GroupBy::Place) => place_key(light, places),
        (_, GroupBy::Name) => name_key(&light.key),
        (_, GroupBy::Automatic) => place_key(light, places).or_else(|| name_key(&light.key)),
        (_, GroupBy::Model) => origin.model.as_ref().map(|model| format!("instance:{model}")),
        (_, GroupBy::Material) => origin.material.as_ref().map(|material| format!("material:{material}")),
        (kind, GroupBy::Kind) => Some(format!("kind:{}", kind_name(kind))),
        (_, GroupBy::Nothing) => None,
    }
}

/// The innermost place that more than one light stands below.
fn place_key(light: &Listed, places: &BTreeMap<String, usize>) -> Option<String> {
    let LightOf::Scene(source) = &light.light else { return None };
    let parents = &source.origin.parents;
    let mut paths = (1..=parents.len()).rev().map(|depth| parents[..depth].join(SEPARATOR));
    let shared = paths.find(|path| places.get(path).is_some_and(|n_lights| *n_lights > 1));
    shared.map(|path| format!("place:{path}"))
}

/// The name of a light without its number.
fn name_key(key: &str) -> Option<String> {
    let stem = key.trim_end_matches(|c: char| c.is_ascii_digit() || " ._-#:".contains(c));
    (!stem.is_empty()).then(|| format!("name:{stem}"))
}

/// The group of lamps that no file has.
pub const ADDED: &str = "kind:Added lamps";

fn kind_name(kind: SourceKind) -> &'static str {
    match kind {
        SourceKind::Point => "Point lamps",
        SourceKind::Spot => "Spot lamps",
        SourceKind::Directional => "Directional lamps",
        SourceKind::Emitter => "Emissive surfaces",
        SourceKind::Panel { .. } => "Panels",
        SourceKind::Sky | SourceKind::Dome { .. } | SourceKind::Sun { .. } => "Sky",
        SourceKind::Constant => "Unlit surfaces",
        SourceKind::Image => "Pictures",
    }
}

/// A group as the look has it; without an entry all of it is as its lights are.
pub(super) fn master(look: &Look, group: &Group, lights: &[Listed]) -> LightGroup {
    let (intensity, muted) =
        look.lights.groups.get(&group.key).map_or((1.0, false), |entry| (entry.intensity, entry.muted));
    let lights = group.lights.iter().map(|idx| lights[*idx].key.clone()).collect();
    LightGroup { lights, intensity, muted }
}

/// Keeps what a group was set to. What changes nothing leaves no trace.
pub(super) fn set_master(look: &mut Look, key: &str, master: LightGroup) {
    if master.intensity == 1.0 && !master.muted {
        look.lights.groups.remove(key);
    } else {
        look.lights.groups.insert(key.to_owned(), master);
    }
}

/// A look with an entry for every group that the panel shows, so that files tell the light apart as the panel does. The sky and free
/// lamps keep the layers that they have without.
pub fn with_groups(basis: &LightBasis, mut look: Look, by: GroupBy) -> Look {
    let lights: Vec<Listed> = basis.sources.iter().filter(|source| !is_sky(source.kind)).map(nameless).collect();
    for item in arranged(&lights, by, &look) {
        if let Item::Group(group) = item {
            let master = master(&look, &group, &lights);
            look.lights.groups.entry(group.key).or_insert(master);
        }
    }
    look
}

/// Lights that are new in a scene come under the masters of the groups that they belong to, however the panel is sorted.
pub fn take_in(rig: &mut LightRig, basis: &LightBasis, known: &BTreeSet<String>) {
    let lights: Vec<Listed> = basis.sources.iter().map(nameless).collect();
    let places = places(&lights);
    for light in lights.iter().filter(|light| !known.contains(&light.key)) {
        for group in GroupBy::ALL.into_iter().filter_map(|by| group_key(light, by, &places)) {
            enter(rig, &group, &light.key);
        }
    }
}

fn nameless(source: &LightSource) -> Listed<'_> {
    Listed { key: source.key.clone(), name: String::new(), light: LightOf::Scene(source), spots: None }
}

fn is_sky(kind: SourceKind) -> bool {
    matches!(kind, SourceKind::Sky | SourceKind::Dome { .. } | SourceKind::Sun { .. })
}

#[cfg(test)]
mod tests {
    use clerestory_transport::origin::LightOrigin;
    use glam::Vec3;

    use super::*;
    use crate::export::layers::LayerSet;

    fn source(key: &str, kind: SourceKind, parents: &[&str], model: &str) -> LightSource {
        let parents = parents.iter().map(|name| (*name).to_owned()).collect();
        let (model, material) = (Some(model.to_owned()), Some("Glow".to_owned()));
        let origin = LightOrigin { parents, model, material, ..LightOrigin::default() };
        LightSource { key: key.into(), kind, columns: 0..1, color: Vec3::ONE, strength: 1.0, origin }
    }

    fn sources() -> Vec<LightSource> {
        vec![
            source("a", SourceKind::Point, &["Hall", "Table"], "Bulb"),
            source("b", SourceKind::Emitter, &["Hall"], "Tube"),
            source("c", SourceKind::Point, &["Hall", "Table"], "Bulb"),
            source("d", SourceKind::Point, &["Attic", "Lamp of d"], "Bulb"),
            source("e 1", SourceKind::Spot, &[], "Bulb"),
            source("e#2", SourceKind::Spot, &["Spots"], "Bulb"),
            source("sky", SourceKind::Dome { divisions: 1 }, &[], "x"),
            source("sun", SourceKind::Sun { direction: Vec3::Y }, &[], "y"),
        ]
    }

    fn names(by: GroupBy) -> Vec<(String, Vec<usize>)> {
        let sources = sources();
        let lights: Vec<Listed> = sources.iter().map(nameless).collect();
        let name = |item: Item| match item {
            Item::Light(idx) => (String::new(), vec![idx]),
            Item::Group(group) => (group.name, group.lights),
        };
        arranged(&lights, by, &Look::default()).into_iter().map(name).collect()
    }

    #[test]
    fn lights_are_sorted_by_place_instance_material_and_kind() {
        let group = |name: &str, lights: &[usize]| (name.to_owned(), lights.to_vec());
        let (alone, sky) = (|idx| group("", &[idx]), group("Sky", &[6, 7]));
        let (table, glow) = (group("Table", &[0, 2]), group("Glow", &[0, 1, 2, 3, 4, 5]));
        assert_eq!(names(GroupBy::Nothing), (0..8).map(alone).collect::<Vec<_>>());
        assert_eq!(names(GroupBy::Place), [table.clone(), alone(1), alone(3), alone(4), alone(5), sky.clone()]);
        assert_eq!(names(GroupBy::Automatic), [table, alone(1), alone(3), group("e", &[4, 5]), sky.clone()]);
        assert_eq!(names(GroupBy::Model), [group("Bulb", &[0, 2, 3, 4, 5]), alone(1), sky.clone()]);
        assert_eq!(names(GroupBy::Material), [glow, sky.clone()]);
        let kinds = [group("Point lamps", &[0, 2, 3]), alone(1), group("Spot lamps", &[4, 5]), sky];
        assert_eq!(names(GroupBy::Kind), kinds);
    }

    #[test]
    fn files_tell_light_apart_as_the_panel_does() {
        let basis = LightBasis::new(sources());
        let mut look = Look::default();
        look.names.insert("place:Hall/Table".into(), "dining".into());
        let parts = |by| -> Vec<String> {
            let look = with_groups(&basis, look.clone(), by);
            LayerSet::Groups.parts(&basis, &look).into_iter().map(|(name, _)| name).collect()
        };
        assert_eq!(parts(GroupBy::Automatic), ["dining", "surfaces", "lamps", "e", "sky"]);
        assert_eq!(parts(GroupBy::Model), ["Bulb", "surfaces", "sky"]);
        assert_eq!(parts(GroupBy::Nothing), ["lamps", "surfaces", "sky"]);

        // Masters stay as they are.
        let lights = ["e 1".to_owned(), "e#2".to_owned()].into();
        set_master(&mut look, "name:e", LightGroup { lights, intensity: 2.0, muted: false });
        let full = with_groups(&basis, look.clone(), GroupBy::Automatic);
        assert_eq!(full.lights.groups["name:e"].intensity, 2.0);
        assert_eq!(full.lights.groups.keys().collect::<Vec<_>>(), ["name:e", "place:Hall/Table"]);
    }

    #[test]
    fn lights_that_are_new_come_under_the_masters_of_their_groups() {
        let basis = LightBasis::new(sources());
        let mut rig = LightRig::default();
        let group = |key: &str| LightGroup { lights: [key.to_owned()].into(), intensity: 0.5, muted: false };
        for (name, key) in [("place:Hall/Table", "a"), ("name:e", "e 1"), ("kind:Emissive surfaces", "b")] {
            rig.groups.insert(name.into(), group(key));
        }
        let known = ["a", "b", "d", "e 1", "sky", "sun"].map(str::to_owned).into();
        take_in(&mut rig, &basis, &known);
        let lights = |name: &str| rig.groups[name].lights.iter().map(String::as_str).collect::<Vec<_>>();
        assert_eq!(lights("place:Hall/Table"), ["a", "c"]);
        assert_eq!(lights("name:e"), ["e 1", "e#2"]);
        assert_eq!(lights("kind:Emissive surfaces"), ["b"]);
        assert_eq!(rig.groups.len(), 3, "no master comes of itself");
    }

    #[test]
    fn a_master_that_changes_nothing_leaves_no_trace() {
        let mut look = Look::default();
        let lights = ["a".to_owned()].into();
        set_master(&mut look, "kind:Sky", LightGroup { lights, intensity: 2.0, muted: false });
        assert_eq!(look.lights.groups["kind:Sky"].intensity, 2.0);
        set_master(&mut look, "kind:Sky", LightGroup { lights: [].into(), intensity: 1.0, muted: false });
        assert_eq!(look, Look::default());
    }
}
