//! Groups of lights and names of a look, from JSON and back.

use std::collections::BTreeMap;

use anyhow::{Result, anyhow};
use clerestory_transport::light::{LightGroup, LightRig};
use serde_json::Value;

use super::parse::{INTENSITY, Reader};
use super::write::{member, value};

/// Between the nodes of a place.
pub const SEPARATOR: &str = "/";

impl Reader<'_> {
    /// An entry of the member `groups`.
    pub(super) fn group(&mut self, value: &Value) -> Result<LightGroup> {
        let object = self.object(value)?;
        self.report_unknown(object, &["lights", "intensity", "muted"]);
        let keys = |reader: &mut Reader, value: &Value| {
            let list = reader.array(value)?.iter().enumerate();
            let keys = list.map(|(idx, key)| reader.part(idx, |reader| reader.text(key)));
            keys.filter_map(Result::transpose).collect()
        };
        let missing = anyhow!("`{}.lights` is missing: a group needs a list of keys", self.name());
        Ok(LightGroup {
            lights: self.optional(object, "lights", keys)?.ok_or(missing)?,
            intensity: self.optional(object, "intensity", |r, v| r.number(v, &INTENSITY))?.unwrap_or(1.0),
            muted: self.optional(object, "muted", |r, v| r.truth(v))?.unwrap_or(false),
        })
    }
}

/// The member `groups`, if there are any.
pub(super) fn member_of(groups: &BTreeMap<String, LightGroup>) -> Option<String> {
    let lines = groups.iter().map(|(key, group)| {
        let keys: Vec<String> = group.lights.iter().map(value).collect();
        let members = [
            Some(format!("\"lights\": [{}]", keys.join(", "))),
            (group.intensity != 1.0).then(|| member("intensity", &group.intensity)),
            group.muted.then(|| member("muted", &true)),
        ];
        format!("    {}: {{ {} }}", value(key), members.into_iter().flatten().collect::<Vec<_>>().join(", "))
    });
    block("groups", lines.collect())
}

/// The member `names`, if there are any.
pub(super) fn names_member(names: &BTreeMap<String, String>) -> Option<String> {
    block("names", names.iter().map(|(key, name)| format!("    {}: {}", value(key), value(name))).collect())
}

fn block(name: &str, lines: Vec<String>) -> Option<String> {
    (!lines.is_empty()).then(|| format!("  \"{name}\": {{\n{}\n  }}", lines.join(",\n")))
}

/// Puts a light into all groups that another is in.
pub fn join(rig: &mut LightRig, other: &str, key: &str) {
    for group in rig.groups.values_mut().filter(|group| group.lights.contains(other)) {
        group.lights.insert(key.to_owned());
    }
}

/// Puts a light into a group, where there is such a group.
pub fn enter(rig: &mut LightRig, group: &str, key: &str) {
    if let Some(group) = rig.groups.get_mut(group) {
        group.lights.insert(key.to_owned());
    }
}

/// Takes a light out of all groups; what is left empty goes.
pub fn leave(rig: &mut LightRig, key: &str) {
    for group in rig.groups.values_mut() {
        group.lights.remove(key);
    }
    rig.groups.retain(|_, group| !group.lights.is_empty());
}

/// What a group is called by itself: of a place its innermost node.
pub fn own_name(key: &str) -> &str {
    let (by, name) = key.split_once(':').unwrap_or(("", key));
    if by == "place" { name.rsplit(SEPARATOR).next().unwrap_or(name) } else { name }
}
