//! What the panel lists: the lights of the scene and the free lamps alike.

use std::collections::BTreeMap;

use clerestory_transport::basis::{LightBasis, LightSource, SourceKind};
use clerestory_transport::lamps::{FreeLamp, LampShape, LampUnit};
use clerestory_transport::light::{LightSetting, luminance};
use glam::Vec3;

use crate::look::Look;
use crate::panels::color::KelvinChoice;
use crate::panels::lamps;

/// Lumen of each candela of measured lamps, by the path of their file; none where it cannot be read.
pub(super) type Profiles = BTreeMap<String, Option<f32>>;

/// A light of the panel.
#[derive(Clone, Debug)]
pub(in crate::panels) struct Listed<'a> {
    /// Its key in looks.
    pub key: String,
    /// What it is called.
    pub name: String,
    /// What it is.
    pub light: LightOf<'a>,
}

/// Where a light comes from.
#[derive(Clone, Debug)]
pub(in crate::panels) enum LightOf<'a> {
    /// From the scene.
    Scene(&'a LightSource),
    /// From the look: the lamp, and lumen of each of its candela where a file tells them.
    Look(FreeLamp, Option<f32>),
}

/// All lights, free lamps first.
pub(super) fn listed<'a>(basis: &'a LightBasis, look: &Look, profiles: &mut Profiles) -> Vec<Listed<'a>> {
    let lamps = look.lights.lamps.iter().map(|lamp| Listed {
        key: lamp.key.clone(),
        name: look.name_of(&lamp.key).to_owned(),
        light: LightOf::Look(lamp.clone(), lumens_per_candela(lamp, profiles)),
    });
    let sources = basis.sources.iter().map(|source| Listed {
        key: source.key.clone(),
        name: look.name_of(&source.key).to_owned(),
        light: LightOf::Scene(source),
    });
    lamps.chain(sources).collect()
}

/// Reads the file of a measured lamp once.
fn lumens_per_candela(lamp: &FreeLamp, profiles: &mut Profiles) -> Option<f32> {
    let LampShape::Profile { file } = &lamp.shape else { return None };
    let read = || {
        let one = FreeLamp { strength: 1.0, unit: LampUnit::Candela, ..lamp.clone() };
        one.strength_in(LampUnit::Lumen)
    };
    *profiles.entry(file.clone()).or_insert_with(read)
}

impl Listed<'_> {
    /// What it is, for people.
    pub fn kind_words(&self) -> String {
        match &self.light {
            LightOf::Look(lamp, _) => lamps::kind_words(&lamp.shape).into(),
            LightOf::Scene(source) => source_words(source.kind),
        }
    }

    /// Linear Rec. 709 color without any setting.
    pub fn own_color(&self) -> Vec3 {
        match &self.light {
            LightOf::Look(..) => Vec3::ONE,
            LightOf::Scene(source) => source.color,
        }
    }

    /// What can be chosen for its color.
    pub fn kelvin_choice(&self) -> KelvinChoice {
        match self.light {
            LightOf::Look(..) => KelvinChoice::OfferedOnWhite,
            LightOf::Scene(_) => KelvinChoice::Offered,
        }
    }

    /// World-space position in meters, if it is anywhere.
    pub fn position(&self) -> Option<Vec3> {
        match &self.light {
            LightOf::Look(lamp, _) => (lamp.shape != LampShape::Directional).then_some(lamp.position),
            LightOf::Scene(source) => source.origin.position,
        }
    }

    /// How much of its light there is under a setting, muted or not; `None` where that does not follow from what it is.
    pub fn amount(&self, setting: &LightSetting, unit: LampUnit) -> Option<f32> {
        match &self.light {
            LightOf::Scene(source) => source.amount(setting, unit),
            LightOf::Look(lamp, per_candela) => {
                let strength = match (lamp.unit, unit, per_candela) {
                    (has, wanted, _) if has == wanted => Some(lamp.strength),
                    (LampUnit::Candela, LampUnit::Lumen, Some(lumens)) => Some(lamp.strength * lumens),
                    (LampUnit::Lumen, LampUnit::Candela, Some(lumens)) => Some(lamp.strength / lumens),
                    // Its file, which would say, is not read at every frame.
                    _ if matches!(lamp.shape, LampShape::Profile { .. }) => None,
                    _ => lamp.strength_in(unit),
                };
                Some(strength? * luminance(setting.tint(Vec3::ONE)) * setting.intensity)
            }
        }
    }

    /// The unit that the file counts it in, if it does.
    pub fn own_unit(&self) -> Option<LampUnit> {
        match &self.light {
            LightOf::Look(lamp, _) => Some(lamp.unit),
            LightOf::Scene(source) => {
                let units = [LampUnit::Nit, LampUnit::Lux, LampUnit::Candela];
                units.into_iter().find(|unit| source.kind.unit() == unit.name())
            }
        }
    }

    /// Whether a part of its name, or of its key, was typed; `part` is in lower case.
    pub fn is_called(&self, part: &str) -> bool {
        self.name.to_lowercase().contains(part) || self.key.to_lowercase().contains(part)
    }
}

/// What a light of the scene is, for people.
pub(crate) fn source_words(kind: SourceKind) -> String {
    match kind {
        SourceKind::Point => "Point lamp".into(),
        SourceKind::Spot => "Spot lamp".into(),
        SourceKind::Directional => "Directional lamp".into(),
        SourceKind::Emitter => "Emissive surface".into(),
        SourceKind::Panel { resolution, .. } => format!("Panel of {resolution} × {resolution} texels"),
        SourceKind::Sky => "Sky".into(),
        SourceKind::Dome { divisions } => format!("Sky of {} patches", 144 * divisions * divisions + 146),
        SourceKind::Sun { .. } => "Sun".into(),
        SourceKind::Constant => "Unlit surfaces".into(),
        SourceKind::Image => "Picture taken under this light".into(),
    }
}
