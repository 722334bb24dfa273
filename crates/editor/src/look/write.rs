//! Look to JSON: one lamp or spot per line, only what differs from the scene.

use clerestory_transport::light::{LightRig, LightSetting, PanelSpot};
use serde::Serialize;

use super::{Display, LOOK_VERSION, Look};

/// Readable JSON; see [`Look::to_json`]. `scene_file` is the scene that it is for, where that is to be told.
pub(super) fn json(look: &Look, scene_file: Option<&str>) -> String {
    let mut members = vec![format!("  \"clerestory\": {LOOK_VERSION}")];
    members.extend(scene_file.map(|file| format!("  \"scene_file\": {}", value(file))));
    members.extend(lighting_members(&look.lights, &look.display, "  "));
    members.extend(super::groups::names_member(&look.names));
    let snapshots = look.snapshots.iter().map(|snapshot| format!("    {}", super::snapshot::json(snapshot, "    ")));
    let snapshots: Vec<String> = snapshots.collect();
    if !snapshots.is_empty() {
        members.push(format!("  \"looks\": [\n{}\n  ]", snapshots.join(",\n")));
    }
    members.extend(look.on.as_ref().map(|on| format!("  \"on\": {}", value(on))));
    members.extend(super::timeline::json(&look.timeline).map(|timeline| format!("  \"timeline\": {timeline}")));
    members.extend(super::scene::json(&look.scene));
    members.extend(super::bookmarks::json(&look.bookmarks));
    members.extend(super::wishes::json(&look.wishes));
    members.extend(look.marks.as_ref().map(|marks| format!("  \"marks\": {}", super::marked::json(marks))));
    members.extend(super::marked::probes_json(&look.probes));
    format!("{{\n{}\n}}\n", members.join(",\n"))
}

/// Members that say how a scene is lit and shown, those that differ from the scene, each line behind `indent`.
pub(super) fn lighting_members(lights: &LightRig, display: &Display, indent: &str) -> Vec<String> {
    let mut members = Vec::new();
    let changed = lights.lights.iter().filter(|(_, setting)| **setting != LightSetting::default());
    let settings: Vec<String> = changed.map(|(key, s)| format!("{indent}  {}: {}", value(key), setting(s))).collect();
    if !settings.is_empty() {
        members.push(format!("{indent}\"lights\": {{\n{}\n{indent}}}", settings.join(",\n")));
    }
    let panels = lights.panels.iter().map(|(key, s)| format!("{indent}  {}: {}", value(key), spots(s, indent)));
    let panels: Vec<String> = panels.collect();
    if !panels.is_empty() {
        members.push(format!("{indent}\"panels\": {{\n{}\n{indent}}}", panels.join(",\n")));
    }
    if let Some(sky) = lights.sky.as_ref().map(super::sky::members) {
        // One without members is not turned; without a word it would be as the bake turned it.
        let sky = if sky.is_empty() { "{}".to_owned() } else { format!("{{ {} }}", sky.join(", ")) };
        members.push(format!("{indent}\"sky\": {sky}"));
    }
    let lamps: Vec<String> =
        lights.lamps.iter().map(|lamp| format!("{indent}  {}", super::lamps::json(lamp))).collect();
    if !lamps.is_empty() {
        members.push(format!("{indent}\"lamps\": [\n{}\n{indent}]", lamps.join(",\n")));
    }
    members.extend(super::groups::member_of(&lights.groups));
    let display = super::display::members(display);
    if !display.is_empty() {
        members.push(format!("{indent}\"display\": {{ {} }}", display.join(", ")));
    }
    members
}

/// JSON of a number, text or color on one line; numbers as short as an f32 allows.
pub(super) fn value(of: &(impl Serialize + ?Sized)) -> String {
    serde_json::to_string(of).expect("numbers, texts and colors always have a JSON form")
}

pub(super) fn member(name: &str, of: &(impl Serialize + ?Sized)) -> String {
    format!("\"{name}\": {}", value(of).replace(',', ", "))
}

fn setting(setting: &LightSetting) -> String {
    format!("{{ {} }}", setting_members(setting).join(", "))
}

/// The members that differ from what the lamp has.
pub(super) fn setting_members(setting: &LightSetting) -> Vec<String> {
    let members = [
        (setting.intensity != 1.0).then(|| member("intensity", &setting.intensity)),
        setting.color.map(|color| member("color", &color)),
        setting.kelvin.map(|kelvin| member("kelvin", &kelvin)),
        setting.muted.then(|| member("muted", &true)),
    ];
    members.into_iter().flatten().collect()
}

fn spots(spots: &[PanelSpot], indent: &str) -> String {
    if spots.is_empty() {
        return "[]".into();
    }
    let lines: Vec<String> = spots.iter().map(|s| format!("{indent}    {}", spot(s))).collect();
    format!("[\n{}\n{indent}  ]", lines.join(",\n"))
}

fn spot(spot: &PanelSpot) -> String {
    let members = [
        Some(member("position", &spot.position)),
        Some(member("radius", &spot.radius)),
        spot.color.map(|color| member("color", &color)),
        (spot.intensity != 1.0).then(|| member("intensity", &spot.intensity)),
    ];
    format!("{{ {} }}", members.into_iter().flatten().collect::<Vec<_>>().join(", "))
}
