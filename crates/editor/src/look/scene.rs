//! What a look makes of a scene before it is baked: panels of emissive rectangles, the units of its lamps, and a sky in patches.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

use anyhow::{Result, anyhow};
use clerestory_transport::basis::{LightBasis, SourceKind};
use clerestory_transport::emitters::PANEL_RESOLUTION;
use clerestory_transport::lamp_units::LampUnits;
use serde_json::Value;

use super::Look;
use super::parse::Reader;
use super::write::value;

/// Names of the units in files.
const UNITS: [(&str, LampUnits); 2] = [("photometric", LampUnits::Photometric), ("unitless", LampUnits::Unitless)];
/// Patches of the sky in files, the ground's counted as one, and their divisions.
const SKY_PATCHES: [(u64, u32); 3] = [(145, 1), (577, 2), (2305, 4)];
/// Texels along each side of a panel.
const TEXELS: RangeInclusive<u32> = PANEL_RESOLUTION;

/// What is chosen about a scene; what it leaves out is as it is.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneChoice {
    /// Texels along each side of panels, by the key of their light.
    pub panels: BTreeMap<String, u32>,
    /// How the lamps of the file are counted.
    pub units: Option<LampUnits>,
    /// Divisions of the patches of a sky with columns of its own.
    pub sky: Option<u32>,
}

impl SceneChoice {
    /// Takes over from another choice what this one leaves out.
    pub fn or(mut self, other: &SceneChoice) -> SceneChoice {
        for (node, resolution) in &other.panels {
            self.panels.entry(node.clone()).or_insert(*resolution);
        }
        SceneChoice { units: self.units.or(other.units), sky: self.sky.or(other.sky), ..self }
    }
}

impl Look {
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
    ];
    let members: Vec<String> = members.into_iter().flatten().collect();
    (!members.is_empty()).then(|| format!("  \"scene\": {{ {} }}", members.join(", ")))
}

impl Reader<'_> {
    /// What is chosen about the scene.
    pub(super) fn scene_choice(&mut self, value: &Value) -> Result<SceneChoice> {
        let object = self.object(value)?;
        self.report_unknown(object, &["panels", "units", "sky_patches"]);
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
        Ok(SceneChoice { panels, units, sky })
    }
}

#[cfg(test)]
mod tests {
    use clerestory_transport::basis::LightSource;
    use clerestory_transport::origin::LightOrigin;
    use glam::Vec3;

    use super::*;

    fn rich() -> Look {
        let panels = [("Ceiling, \"A\"".to_owned(), 16), ("Wall".to_owned(), 4)].into();
        Look { scene: SceneChoice { panels, units: Some(LampUnits::Unitless), sky: Some(2) }, ..Look::default() }
    }

    #[test]
    fn panels_units_and_patches_of_the_sky_come_back_with_the_look() {
        let (back, warnings) = Look::from_json(&rich().to_json()).unwrap();
        assert_eq!((back, warnings), (rich(), vec![]));
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
        ] {
            let error = format!("{:#}", Look::from_json(&json).unwrap_err());
            assert!(error.contains(words), "{words}: {error}");
            assert_eq!(Look::recover(&json).unwrap().0.scene.panels["Wall"], 4);
        }
    }

    #[test]
    fn panels_that_a_bake_has_not_are_told_with_what_to_do() {
        let source = |key: &str, kind: SourceKind| LightSource {
            key: key.into(),
            kind,
            columns: 0..1,
            color: Vec3::ONE,
            strength: 1.0,
            origin: LightOrigin::default(),
        };
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
        let open = SceneChoice { panels: [("Wall".into(), 8), ("Door".into(), 32)].into(), units: None, sky: Some(1) };
        let both = rich().scene.or(&open);
        assert_eq!((both.panels["Wall"], both.panels["Door"], both.units), (4, 32, Some(LampUnits::Unitless)));
        assert_eq!(both.sky, Some(2));
        assert_eq!(SceneChoice::default().or(&open).sky, Some(1));
        assert_eq!(open.or(&rich().scene).units, Some(LampUnits::Unitless));
    }
}
