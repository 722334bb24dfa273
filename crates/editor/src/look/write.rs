//! Look to JSON: one lamp or spot per line, only what differs from the scene.

use clerestory_transport::light::{LightSetting, PanelSpot};
use serde::Serialize;

use super::{LOOK_VERSION, Look};

/// Readable JSON; see [`Look::to_json`].
pub(super) fn json(look: &Look) -> String {
    let mut members = vec![format!("  \"clerestory\": {LOOK_VERSION}")];
    let changed = look.lights.lights.iter().filter(|(_, setting)| **setting != LightSetting::default());
    let lights: Vec<String> = changed.map(|(key, s)| format!("    {}: {}", value(key), setting(s))).collect();
    if !lights.is_empty() {
        members.push(format!("  \"lights\": {{\n{}\n  }}", lights.join(",\n")));
    }
    let panels = look.lights.panels.iter().map(|(key, s)| format!("    {}: {}", value(key), spots(s)));
    let panels: Vec<String> = panels.collect();
    if !panels.is_empty() {
        members.push(format!("  \"panels\": {{\n{}\n  }}", panels.join(",\n")));
    }
    let sky = look.lights.sky.as_ref().map(super::sky::members).unwrap_or_default();
    if !sky.is_empty() {
        members.push(format!("  \"sky\": {{ {} }}", sky.join(", ")));
    }
    let lamps: Vec<String> = look.lights.lamps.iter().map(|lamp| format!("    {}", super::lamps::json(lamp))).collect();
    if !lamps.is_empty() {
        members.push(format!("  \"lamps\": [\n{}\n  ]", lamps.join(",\n")));
    }
    members.extend(super::groups::member_of(&look.lights.groups));
    members.extend(super::groups::names_member(&look.names));
    let display = super::display::members(&look.display);
    if !display.is_empty() {
        members.push(format!("  \"display\": {{ {} }}", display.join(", ")));
    }
    format!("{{\n{}\n}}\n", members.join(",\n"))
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

fn spots(spots: &[PanelSpot]) -> String {
    if spots.is_empty() {
        return "[]".into();
    }
    let lines: Vec<String> = spots.iter().map(|s| format!("      {}", spot(s))).collect();
    format!("[\n{}\n    ]", lines.join(",\n"))
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
