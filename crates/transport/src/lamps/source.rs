//! Lamps of the file that become movable.

use glam::Vec3;

use super::{FreeLamp, LampShape, LampUnit};
use crate::basis::LightSource;
use crate::light::LightSetting;
use crate::scene::{PunctualKind, PunctualLight};

impl FreeLamp {
    /// A lamp that shines as a light of the file does under a setting, to take its place: `key` is its new name, for the
    /// light of the file stays, muted. `None` for a lamp with a measured distribution, which lies in the file of the scene.
    pub fn from_source(
        key: &str,
        source: &LightSource,
        light: &PunctualLight,
        setting: LightSetting,
    ) -> Option<FreeLamp> {
        if light.profile.is_some() {
            return None;
        }
        let (shape, unit) = match light.kind {
            PunctualKind::Point => (LampShape::Point, LampUnit::Candela),
            PunctualKind::Spot { inner_rad, outer_rad } => {
                (LampShape::Spot { inner_rad, outer_rad }, LampUnit::Candela)
            }
            PunctualKind::Directional => (LampShape::Directional { radius_rad: light.radius_rad }, LampUnit::Lux),
        };
        // The setting multiplies, and replaces the color of the file where it has one of its own.
        let own = setting.color.or((source.color != Vec3::ONE).then(|| source.color.to_array()));
        let setting = LightSetting { color: own.filter(|_| setting.kelvin.is_none()), ..setting };
        let aim = light.position + light.direction;
        Some(FreeLamp {
            key: key.to_owned(),
            shape,
            position: light.position,
            aim,
            strength: source.strength,
            unit,
            setting,
            turn_rad: 0.0,
            replaces: Some(source.key.clone()),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::basis::SourceKind;
    use crate::lamps::PreparedLamps;
    use crate::origin::LightOrigin;

    fn light(kind: PunctualKind) -> PunctualLight {
        PunctualLight {
            node: 0,
            kind,
            position: Vec3::new(1.0, 2.0, 3.0),
            direction: Vec3::new(0.6, -0.8, 0.0),
            across: [Vec3::X, Vec3::Y],
            profile: None,
            color: Vec3::new(1.0, 0.5, 0.25),
            intensity: 40.0,
            radius_rad: 0.0,
        }
    }

    #[test]
    fn a_movable_lamp_shines_as_the_light_of_the_file() {
        let settings = [
            LightSetting::default(),
            LightSetting { intensity: 2.0, kelvin: Some(3000.0), ..LightSetting::default() },
            LightSetting { color: Some([0.0, 1.0, 0.0]), ..LightSetting::default() },
        ];
        for kind in
            [PunctualKind::Point, PunctualKind::Spot { inner_rad: 0.2, outer_rad: 0.5 }, PunctualKind::Directional]
        {
            let light = light(kind);
            let (color, strength, columns) = (light.color, light.intensity, 0..1);
            let source = LightSource {
                key: "l".into(),
                kind: SourceKind::from(kind),
                columns,
                color,
                strength,
                origin: LightOrigin::default(),
            };
            for setting in settings {
                let lamp = FreeLamp::from_source("l again", &source, &light, setting).expect("no distribution");
                let (lamps, warnings) = PreparedLamps::new(&[lamp], None).expect("a lamp that makes sense");
                assert!(warnings.is_empty(), "{warnings:?}");
                let (found, expected) = (lamps.lamps()[0].emission, setting.emission(source.color, source.strength));
                assert!(found.distance(expected) < 1e-4, "{kind:?}: {found} is not {expected}");
            }
        }
    }

    #[test]
    fn a_measured_distribution_stays_where_it_is() {
        let light = PunctualLight { profile: Some(0), ..light(PunctualKind::Point) };
        let kind = SourceKind::Point;
        let source = LightSource::plain("l", kind, 0..1);
        assert!(FreeLamp::from_source("m", &source, &light, LightSetting::default()).is_none());
    }
}
