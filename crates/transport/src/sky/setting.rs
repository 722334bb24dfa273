//! What a designer sets of the sky.

use std::sync::Arc;

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::{
    DEFAULT_TURBIDITY, Environment, SkyError, SkyLight, Sun, SunPosition, SunTime, analytic_sky, sun_direction,
    sun_illuminance, sun_tint,
};

/// The sky of a rig. What names neither a file nor a sun keeps the map of the bake and only turns and dims it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SkySetting {
    /// Equirectangular .hdr or .exr, or `uniform` for 1 nit everywhere.
    pub file: Option<String>,
    /// Turn about +Y in degrees, counter-clockwise seen from above.
    pub rotation_deg: f32,
    /// Multiplies map and sun.
    pub intensity: f32,
    /// A sun; without `file` its analytic sky comes with it.
    pub sun: Option<SunSetting>,
    /// What `file` or the model shows, once it was loaded.
    #[serde(skip)]
    pub map: Option<Arc<Environment>>,
}

/// A sun.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SunSetting {
    /// Where it stands.
    pub place: SunPlace,
    /// Haze: 2 is very clear, 10 hazy.
    pub turbidity: f32,
    /// Multiplies the sun alone.
    pub intensity: f32,
}

/// Where a sun stands.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum SunPlace {
    /// By angle, degrees.
    Angles {
        /// From north (−Z) over east (+X).
        azimuth_deg: f64,
        /// Above the horizon.
        elevation_deg: f64,
    },
    /// By place and moment.
    Time {
        /// Place and moment.
        time: SunTime,
        /// Azimuth of north in the scene: 0 is −Z, 90 is +X.
        north_deg: f64,
    },
}

impl Default for SkySetting {
    fn default() -> Self {
        SkySetting { file: None, rotation_deg: 0.0, intensity: 1.0, sun: None, map: None }
    }
}

impl SunSetting {
    /// A sun by angle in clear air.
    pub fn by_angles(azimuth_deg: f64, elevation_deg: f64) -> SunSetting {
        let place = SunPlace::Angles { azimuth_deg, elevation_deg };
        SunSetting { place, turbidity: DEFAULT_TURBIDITY, intensity: 1.0 }
    }

    /// Where it stands in the scene.
    ///
    /// # Errors
    /// A date, time or place that does not exist.
    pub fn position(&self) -> Result<SunPosition, SkyError> {
        match self.place {
            SunPlace::Angles { azimuth_deg, elevation_deg } => Ok(SunPosition { azimuth_deg, elevation_deg }),
            SunPlace::Time { time, north_deg } => {
                time.check()?;
                let position = time.position();
                Ok(SunPosition { azimuth_deg: (position.azimuth_deg + north_deg).rem_euclid(360.0), ..position })
            }
        }
    }

    /// The sun itself; dark below the horizon.
    ///
    /// # Errors
    /// As [`SunSetting::position`].
    pub fn sun(&self) -> Result<Sun, SkyError> {
        let direction = sun_direction(self.position()?);
        Ok(Sun {
            direction,
            illuminance_lx: sun_illuminance(direction, self.turbidity) * self.intensity,
            color: sun_tint(direction, self.turbidity),
        })
    }
}

impl SkySetting {
    /// Fills `map` where the setting names one: `read` loads a file by its name.
    ///
    /// # Errors
    /// What `read` says, or a sun that does not exist.
    pub fn load<E: From<SkyError>>(&mut self, read: impl FnOnce(&str) -> Result<Arc<Environment>, E>) -> Result<(), E> {
        let sun = self.sun.map(|sun| sun.sun()).transpose()?;
        self.map = match (self.file.as_deref(), self.sun, sun) {
            (Some("uniform"), ..) => Some(Environment::uniform(Vec3::ONE).into()),
            (Some(file), ..) => Some(read(file)?),
            (None, Some(setting), Some(sun)) => Some(analytic_sky(sun.direction, setting.turbidity).into()),
            (None, ..) => None,
        };
        Ok(())
    }

    /// Whether it names a sky of its own and does not only turn and dim another.
    pub fn names_a_sky(&self) -> bool {
        self.file.is_some() || self.sun.is_some()
    }

    /// The sky it describes, by way of the one that was there; `None` if it names none and none was there.
    pub fn light(&self, baked: Option<&SkyLight>) -> Option<SkyLight> {
        let (rotation_deg, intensity) = (self.rotation_deg, self.intensity);
        match &self.map {
            Some(map) => {
                // A setting is loaded before it is used, and only one that exists can be loaded.
                let sun = self.sun.and_then(|sun| sun.sun().ok()).filter(|sun| sun.illuminance_lx > 0.0);
                Some(SkyLight { name: self.name(), rotation_deg, intensity, sun, map: map.clone() })
            }
            None => baked.map(|baked| SkyLight { rotation_deg, intensity, ..baked.clone() }),
        }
    }

    /// For people.
    pub fn name(&self) -> String {
        match (&self.file, self.sun.map(|sun| sun.position())) {
            (Some(file), _) => file.clone(),
            (None, Some(Ok(SunPosition { azimuth_deg, elevation_deg }))) => {
                format!("sun:{azimuth_deg:.6},{elevation_deg:.6}")
            }
            (None, _) => "as baked".into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn load(setting: &mut SkySetting) {
        setting.load::<SkyError>(|_| Ok(Environment::uniform(Vec3::splat(2.0)).into())).unwrap();
    }

    #[test]
    fn a_setting_without_a_sky_of_its_own_turns_and_dims_the_baked_one() {
        let mut setting = SkySetting { rotation_deg: 30.0, intensity: 0.5, ..SkySetting::default() };
        load(&mut setting);
        assert!(!setting.names_a_sky() && setting.light(None).is_none());
        let baked = SkyLight::new("day.hdr", Environment::uniform(Vec3::splat(7.0)));
        let light = setting.light(Some(&baked)).unwrap();
        assert_eq!((light.rotation_deg, light.intensity, light.name.as_str()), (30.0, 0.5, "day.hdr"));
        assert_eq!(light.map, baked.map);
    }

    #[test]
    fn a_file_replaces_the_map_and_a_sun_alone_brings_its_own() {
        let mut file = SkySetting { file: Some("a.hdr".into()), ..SkySetting::default() };
        load(&mut file);
        assert_eq!(file.light(None).unwrap().map.pixels(), [[2.0; 3]]);
        let mut sun = SkySetting { sun: Some(SunSetting::by_angles(90.0, 45.0)), ..SkySetting::default() };
        load(&mut sun);
        let light = sun.light(None).unwrap();
        assert!(light.map.width() > 100 && light.sun.unwrap().illuminance_lx > 5e4);
        let mut night = SkySetting { sun: Some(SunSetting::by_angles(90.0, -5.0)), ..SkySetting::default() };
        load(&mut night);
        assert_eq!(night.light(None).unwrap().sun, None);
    }
}
