//! What a look makes of a scene before it is baked: panels of emissive rectangles, the units of its lamps, a sky in patches, and a level
//! grid of sensors.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

use anyhow::{Result, anyhow};
use clerestory_transport::basis::{LightBasis, SourceKind};
use clerestory_transport::emitters::PANEL_RESOLUTION;
use clerestory_transport::lamp_units::LampUnits;
use clerestory_transport::scene::{Scene, SceneNode};
use clerestory_transport::sensors::WorkPlane;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::Look;
use super::parse::Reader;
use super::write::{member, value};

/// Names of the units in files.
const UNITS: [(&str, LampUnits); 2] = [("photometric", LampUnits::Photometric), ("unitless", LampUnits::Unitless)];
/// Patches of the sky in files, the ground's counted as one, and their divisions.
const SKY_PATCHES: [(u64, u32); 3] = [(145, 1), (577, 2), (2305, 4)];
/// Texels along each side of a panel.
const TEXELS: RangeInclusive<u32> = PANEL_RESOLUTION;
/// Heights of a work plane above its floor.
pub const HEIGHT_M: RangeInclusive<f64> = 0.0..=1e4;
/// Distances of its points.
pub const SPACING_M: RangeInclusive<f64> = 1e-3..=1e4;

/// What is chosen about a scene; what it leaves out is as it is.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneChoice {
    /// Texels along each side of panels, by the key of their light.
    pub panels: BTreeMap<String, u32>,
    /// How the lamps of the file are counted.
    pub units: Option<LampUnits>,
    /// Divisions of the patches of a sky with columns of its own.
    pub sky: Option<u32>,
    /// A level grid of sensors that is baked with the illuminance.
    pub work_plane: Option<PlaneChoice>,
}

/// A level grid of sensors that looks up.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlaneChoice {
    /// Meters above the floor.
    pub height_m: f32,
    /// Meters between points; none is as EN 12464-1 spaces them.
    pub spacing_m: Option<f32>,
    /// Name of the node whose surface is the floor, or `node:INDEX`; none is the floor of the whole scene.
    pub floor: Option<String>,
}

impl PlaneChoice {
    /// The plane in a scene; none where that has no such floor. Where several nodes share its name it rather stays on the one of that
    /// number.
    pub fn on(&self, scene: &Scene, last: Option<u32>) -> Option<WorkPlane> {
        let PlaneChoice { height_m, spacing_m, floor } = self;
        let find = |name: &String| {
            let is_it = |node: &SceneNode| node.is_named(name);
            let stays = last.filter(|node| scene.nodes.get(*node as usize).is_some_and(is_it));
            stays.or_else(|| scene.nodes.iter().position(is_it).and_then(|node| u32::try_from(node).ok()))
        };
        let node = floor.as_ref().map(find);
        (node != Some(None)).then(|| WorkPlane { height_m: *height_m, spacing_m: *spacing_m, floor: node.flatten() })
    }
}

impl SceneChoice {
    /// Takes over from another choice what this one leaves out.
    pub fn or(mut self, other: &SceneChoice) -> SceneChoice {
        for (node, resolution) in &other.panels {
            self.panels.entry(node.clone()).or_insert(*resolution);
        }
        let work_plane = self.work_plane.or_else(|| other.work_plane.clone());
        SceneChoice { units: self.units.or(other.units), sky: self.sky.or(other.sky), work_plane, ..self }
    }

    /// What of it makes another scene.
    pub fn made(&self) -> SceneChoice {
        SceneChoice { work_plane: None, ..self.clone() }
    }
}

impl Look {
    /// Says that a scene has not the floor on which the work plane of the look stands.
    pub fn missing_floor(&self, scene: &Scene) -> Option<String> {
        let plane = self.scene.work_plane.as_ref()?;
        let floor = plane.floor.as_ref().filter(|_| plane.on(scene, None).is_none())?;
        Some(format!("the look has a work plane on `{floor}`, which this scene does not have; choose another floor"))
    }

    /// A sentence for each panel of the look that a bake has not, or in other texels, with what to do about it.
    pub fn unbaked(&self, basis: &LightBasis) -> Vec<String> {
        let lacks = |(node, m): &(&String, &u32)| {
            let kind = basis.source(node).map(|source| source.kind);
            kind.is_some_and(|kind| !matches!(kind, SourceKind::Panel { resolution, .. } if resolution == **m))
        };
        let words = |(node, m): (&String, &u32)| {
            let name = self.name_of(node);
            format!(
                "the look makes `{name}` a panel of {m} × {m} texels, which was not baked; bake the scene again, on the command line with --look, or --panel \"{node}={m}\""
            )
        };
        self.scene.panels.iter().filter(lacks).map(words).collect()
    }
}

/// The member `scene`, if anything is chosen.
pub(super) fn json(choice: &SceneChoice) -> Option<String> {
    let panels = choice.panels.iter().map(|(node, resolution)| format!("{}: {resolution}", value(node)));
    let panels: Vec<String> = panels.collect();
    let units = UNITS.iter().find(|(_, units)| Some(*units) == choice.units);
    let sky = SKY_PATCHES.iter().find(|(_, divisions)| Some(*divisions) == choice.sky);
    let members = [
        (!panels.is_empty()).then(|| format!("\"panels\": {{ {} }}", panels.join(", "))),
        units.map(|(name, _)| format!("\"units\": \"{name}\"")),
        sky.map(|(patches, _)| format!("\"sky_patches\": {patches}")),
        choice.work_plane.as_ref().map(plane_json),
    ];
    let members: Vec<String> = members.into_iter().flatten().collect();
    (!members.is_empty()).then(|| format!("  \"scene\": {{ {} }}", members.join(", ")))
}

fn plane_json(plane: &PlaneChoice) -> String {
    let members = [
        Some(member("height_m", &plane.height_m)),
        plane.spacing_m.map(|spacing_m| member("spacing_m", &spacing_m)),
        plane.floor.as_ref().map(|floor| format!("\"floor\": {}", value(floor))),
    ];
    format!("\"work_plane\": {{ {} }}", members.into_iter().flatten().collect::<Vec<_>>().join(", "))
}

impl Reader<'_> {
    fn work_plane(&mut self, value: &Value) -> Result<PlaneChoice> {
        let object = self.object(value)?;
        self.report_unknown(object, &["height_m", "spacing_m", "floor"]);
        let height_m = self.optional(object, "height_m", |r, v| r.number(v, &HEIGHT_M))?;
        let missing = anyhow!("`{}.height_m` is missing: a work plane needs it", self.name());
        Ok(PlaneChoice {
            height_m: height_m.ok_or(missing)?,
            spacing_m: self.optional(object, "spacing_m", |r, v| r.number(v, &SPACING_M))?,
            floor: self.optional(object, "floor", |r, v| r.text(v))?,
        })
    }

    /// What is chosen about the scene.
    pub(super) fn scene_choice(&mut self, value: &Value) -> Result<SceneChoice> {
        let object = self.object(value)?;
        self.report_unknown(object, &["panels", "units", "sky_patches", "work_plane"]);
        let texels = |reader: &mut Reader, value: &Value| {
            let number = value.as_u64().and_then(|number| u32::try_from(number).ok());
            let (least, most) = (TEXELS.start(), TEXELS.end());
            let number = number.filter(|number| TEXELS.contains(number));
            number.ok_or_else(|| {
                anyhow!("`{}` must be a whole number from {least} to {most}, not {value}", reader.name())
            })
        };
        let panels = self.entries(object, "panels", texels)?;
        let units = self.optional(object, "units", |r, v| r.by_name(v, UNITS))?.flatten();
        let sky = self.optional(object, "sky_patches", |reader, value| {
            let known = SKY_PATCHES.iter().find(|(patches, _)| value.as_u64() == Some(*patches));
            let divisions = known.map(|(_, divisions)| *divisions);
            divisions.ok_or_else(|| anyhow!("`{}` must be 145, 577 or 2305, not {value}", reader.name()))
        })?;
        let work_plane = self.optional(object, "work_plane", |reader, value| reader.work_plane(value))?;
        Ok(SceneChoice { panels, units, sky, work_plane })
    }
}

#[cfg(test)]
mod tests {
    use clerestory_transport::basis::LightSource;

    use super::*;

    fn rich() -> Look {
        let panels = [("Ceiling, \"A\"".to_owned(), 16), ("Wall".to_owned(), 4)].into();
        let work_plane = PlaneChoice { height_m: 0.85, spacing_m: Some(0.3), floor: Some("Floor, \"2\"".to_owned()) };
        let scene =
            SceneChoice { panels, units: Some(LampUnits::Unitless), sky: Some(2), work_plane: Some(work_plane) };
        Look { scene, ..Look::default() }
    }

    #[test]
    fn panels_units_patches_of_the_sky_and_the_work_plane_come_back_with_the_look() {
        let plain = PlaneChoice { height_m: 750.0, spacing_m: Some(0.0025), floor: None };
        let scene = SceneChoice { work_plane: Some(plain), ..SceneChoice::default() };
        for look in [rich(), Look { scene, ..Look::default() }] {
            let (back, warnings) = Look::from_json(&look.to_json()).unwrap();
            assert_eq!((back, warnings), (look, vec![]));
        }
        assert!(!Look::default().to_json().contains("scene"));
    }

    #[test]
    fn what_is_no_choice_is_told_with_its_place() {
        let json = rich().to_json();
        for (json, words) in [
            (json.replacen("16", "3", 1), "`scene.panels.Ceiling, \"A\"` must be a whole number from 4 to 64"),
            (json.replacen("16", "1e9", 1), "`scene.panels"),
            (json.replacen("\"unitless\"", "3", 1), "`scene.units`"),
            (json.replacen("577", "578", 1), "`scene.sky_patches` must be 145, 577 or 2305, not 578"),
            (json.replacen("0.85", "-1", 1), "`scene.work_plane.height_m` must be a number from 0 to 100"),
            (json.replacen("0.3", "0", 1), "`scene.work_plane.spacing_m`"),
            (json.replacen("height_m", "high", 1), "`scene.work_plane.height_m` is missing"),
        ] {
            let error = format!("{:#}", Look::from_json(&json).unwrap_err());
            assert!(error.contains(words), "{words}: {error}");
            assert_eq!(Look::recover(&json).unwrap().0.scene.panels["Wall"], 4);
        }
    }

    #[test]
    fn a_work_plane_stands_on_the_node_of_its_name_wherever_that_comes() {
        let node =
            |index, name: Option<&str>| SceneNode { index, name: name.map(str::to_owned), ..SceneNode::default() };
        let nodes = vec![node(4, Some("Plane")), node(7, None), node(9, Some("Plane"))];
        let scene = Scene { nodes, ..Scene::default() };
        let plane =
            |floor: Option<&str>| PlaneChoice { height_m: 0.75, spacing_m: None, floor: floor.map(str::to_owned) };
        let floor = |name, last| plane(Some(name)).on(&scene, last).map(|plane| plane.floor);
        assert_eq!(plane(None).on(&scene, Some(1)).map(|plane| plane.floor), Some(None));
        assert_eq!(
            [None, Some(0), Some(2), Some(1), Some(8)].map(|last| floor("Plane", last)),
            [Some(Some(0)), Some(Some(0)), Some(Some(2)), Some(Some(0)), Some(Some(0))]
        );
        assert_eq!(["node:7", "node:9", "Door"].map(|name| floor(name, None)), [Some(Some(1)), Some(Some(2)), None]);
        let scene_choice = SceneChoice { work_plane: Some(plane(Some("Door"))), ..SceneChoice::default() };
        let look = Look { scene: scene_choice, ..Look::default() };
        assert!(look.missing_floor(&scene).is_some_and(|words| words.contains("on `Door`")));
        assert_eq!(rich().scene.made(), SceneChoice { work_plane: None, ..rich().scene });
    }

    #[test]
    fn panels_that_a_bake_has_not_are_told_with_what_to_do() {
        let source = |key: &str, kind: SourceKind| LightSource::plain(key, kind, 0..1);
        let panel = |resolution| SourceKind::Panel { resolution, size_m: [1.0; 2] };
        let sources = vec![source("Wall", panel(4)), source("Door", panel(4)), source("Ceiling", SourceKind::Emitter)];
        let panels =
            ["Wall", "Door", "Ceiling", "Window"].map(|key| (key.to_owned(), if key == "Wall" { 4 } else { 8 }));
        let mut look =
            Look { scene: SceneChoice { panels: panels.into(), ..SceneChoice::default() }, ..Look::default() };
        look.lights.panels.insert("Ceiling".into(), vec![]);
        let basis = LightBasis::new(sources);
        let words = look.unbaked(&basis);
        assert!(words.len() == 2 && words[0].contains("--panel \"Ceiling=8\""), "{words:?}");
        assert!(words[1].contains("`Door` a panel of 8 × 8 texels"), "{words:?}");
        let words = look.unheeded(&basis);
        assert!(words.len() == 1 && words[0].contains("makes `Window` a panel"), "{words:?}");
    }

    #[test]
    fn what_a_look_leaves_out_is_taken_over() {
        let panels = [("Wall".into(), 8), ("Door".into(), 32)].into();
        let open = SceneChoice { panels, units: None, sky: Some(1), work_plane: None };
        let both = rich().scene.or(&open);
        assert_eq!(both.work_plane, rich().scene.work_plane);
        assert_eq!(open.clone().or(&rich().scene).work_plane, rich().scene.work_plane);
        assert_eq!((both.panels["Wall"], both.panels["Door"], both.units), (4, 32, Some(LampUnits::Unitless)));
        assert_eq!(both.sky, Some(2));
        assert_eq!(SceneChoice::default().or(&open).sky, Some(1));
        assert_eq!(open.or(&rich().scene).units, Some(LampUnits::Unitless));
    }
}
