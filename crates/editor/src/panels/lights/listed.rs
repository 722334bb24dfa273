//! What the panel lists: the lights of the scene and the free lamps alike.

use std::collections::BTreeMap;
use std::path::Path;

use clerestory_transport::basis::{LightBasis, LightSource, SourceKind};
use clerestory_transport::import::read_profile;
use clerestory_transport::lamps::{FreeLamp, LampShape, LampUnit};
use clerestory_transport::light::{LightSetting, PanelSpot, luminance};
use glam::Vec3;

use crate::look::Look;
use crate::panels::color::KelvinChoice;
use crate::panels::lamps;

/// What is known of measured lamps, by the path of their file.
pub(super) type Profiles = BTreeMap<String, Measured>;

/// What the file of a measured lamp tells; nothing where it cannot be read.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::panels) struct Measured {
    lumens_per_candela: Option<f32>,
    watts: Option<f32>,
}

/// A light of the panel.
#[derive(Clone, Debug)]
pub(in crate::panels) struct Listed<'a> {
    /// Its key in looks.
    pub key: String,
    /// What it is called.
    pub name: String,
    /// What it is.
    pub light: LightOf<'a>,
    /// Spots of a panel, as they are set or as its file marks them; none where all of it shines.
    pub spots: Option<Vec<PanelSpot>>,
}

/// Where a light comes from.
#[derive(Clone, Debug)]
pub(in crate::panels) enum LightOf<'a> {
    /// From the scene.
    Scene(&'a LightSource),
    /// From the look: the lamp, and what a file tells of it.
    Look(FreeLamp, Measured),
}

/// All lights, free lamps first.
pub(super) fn listed<'a>(basis: &'a LightBasis, look: &Look, profiles: &mut Profiles) -> Vec<Listed<'a>> {
    let lamps = look.lights.lamps.iter().map(|lamp| Listed {
        key: lamp.key.clone(),
        name: look.name_of(&lamp.key).to_owned(),
        light: LightOf::Look(lamp.clone(), measured(lamp, profiles)),
        spots: None,
    });
    let is_panel = |source: &LightSource| matches!(source.kind, SourceKind::Panel { .. });
    let sources = basis.sources.iter().map(|source| Listed {
        key: source.key.clone(),
        name: look.name_of(&source.key).to_owned(),
        light: LightOf::Scene(source),
        spots: basis.spots_of(&look.lights, &source.key).filter(|_| is_panel(source)).cloned(),
    });
    lamps.chain(sources).collect()
}

/// Reads the file of a measured lamp once.
fn measured(lamp: &FreeLamp, profiles: &mut Profiles) -> Measured {
    let LampShape::Profile { file } = &lamp.shape else { return Measured::default() };
    let read = || {
        let one = FreeLamp { strength: 1.0, unit: LampUnit::Candela, ..lamp.clone() };
        let watts = read_profile(Path::new(file)).ok().and_then(|profile| profile.watts());
        Measured { lumens_per_candela: one.strength_in(LampUnit::Lumen), watts }
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
            LightOf::Look(lamp, _) => (!lamp.shape.is_parallel()).then_some(lamp.position),
            LightOf::Scene(source) => source.origin.position,
        }
    }

    /// How much of its light there is under a setting, muted or not; `None` where that does not follow from what it is.
    pub fn amount(&self, setting: &LightSetting, unit: LampUnit) -> Option<f32> {
        match &self.light {
            LightOf::Scene(source) => match (&self.spots, unit) {
                (Some(spots), LampUnit::Lumen) => source.lumens_of_spots(setting, spots),
                (Some(spots), LampUnit::Candela) => source.candela_of_panel(source.lumens_of_spots(setting, spots)?),
                _ => source.amount(setting, unit),
            },
            LightOf::Look(lamp, measured) => {
                let strength = match (lamp.unit, unit, measured.lumens_per_candela) {
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

    /// Electrical power in watt that its profile states.
    pub fn watts(&self) -> Option<f32> {
        let watts = match &self.light {
            LightOf::Scene(source) => source.origin.watts,
            LightOf::Look(_, measured) => measured.watts,
        };
        watts.filter(|watts| *watts > 0.0)
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
        // Those above the horizon, as they are chosen by.
        SourceKind::Dome { divisions } => format!("Sky of {} patches", 144 * divisions * divisions + 1),
        SourceKind::Sun { .. } => "Sun".into(),
        SourceKind::Constant => "Unlit surfaces".into(),
        SourceKind::Image => "Picture taken under this light".into(),
    }
}

#[cfg(test)]
mod tests {
    use std::f32::consts::PI;

    use clerestory_transport::origin::LightOrigin;

    use super::*;
    use crate::panels::lights::scale::Scale;
    use crate::schedule::Schedule;

    #[test]
    fn watts_are_those_of_the_profile_where_it_states_some() {
        let bare = LightOrigin { lumens: Some(4.0), ..LightOrigin::default() };
        let stated = LightOrigin { watts: Some(17.0), ..bare.clone() };
        for (origin, watts) in [(bare, 2.0), (stated, 17.0)] {
            let source = LightSource { origin, strength: 50.0, ..LightSource::plain("l", SourceKind::Point, 0..1) };
            let basis = LightBasis::new(vec![source]);
            let lights = listed(&basis, &Look::default(), &mut Profiles::new());
            let measure = Scale::Watt.measure(&lights[0], &LightSetting::default(), 100.0);
            assert!((measure.number(1.0) - watts).abs() < 1e-3, "{measure:?}");
        }
    }

    #[test]
    fn the_flux_of_a_panel_is_what_its_spots_leave_of_it_here_and_in_the_schedule() {
        // A square that sends 2 lm for each nit from its front: π times its area.
        let kind = SourceKind::Panel { resolution: 8, size_m: [(2.0 / PI).sqrt(); 2] };
        let origin = LightOrigin { lumens: Some(2.0), ..LightOrigin::default() };
        let source = LightSource { origin, strength: 50.0, ..LightSource::plain("panel", kind, 0..64) };
        let mut basis = LightBasis::new(vec![source]);
        let mut look = Look::default();
        let lumens = |basis: &LightBasis, look: &Look| {
            let lights = listed(basis, look, &mut Profiles::new());
            let amount = |unit| lights[0].amount(&LightSetting::default(), unit).unwrap();
            let schedule = Schedule::new(basis, None, look, None, None);
            let [lumen, candela] = [LampUnit::Lumen, LampUnit::Candela].map(amount);
            assert!((PI * candela - lumen).abs() < 1e-3, "{candela} cd");
            assert!((schedule.luminaires[0].lumen.unwrap() - f64::from(lumen)).abs() < 1e-3, "{schedule:?}");
            lumen
        };
        assert!((lumens(&basis, &look) - 100.0).abs() < 1e-3);
        let spot = PanelSpot { position: [0.5; 2], radius: 0.25, color: None, intensity: 1.0 };
        basis.spots.insert("panel".into(), vec![spot]);
        let of_file = lumens(&basis, &look);
        assert!(of_file > 10.0 && of_file < 40.0, "a fifth of it, about: {of_file}");
        look.lights.panels.insert("panel".into(), vec![PanelSpot { intensity: 2.0, ..spot }]);
        assert!((lumens(&basis, &look) - 2.0 * of_file).abs() < 1e-3);
    }
}
