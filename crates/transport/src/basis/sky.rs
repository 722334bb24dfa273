//! Coefficients of the sky: its map resampled to patches, as it is turned.

use glam::Vec3;

use super::{LightBasis, LightSource, SourceKind};
use crate::light::{LightRig, LightSetting};
use crate::sky::{Dome, SkyLight};

/// Angle in radians, a quarter of its radius, by which a sun may have moved and still have its own column.
const SAME_SUN_RAD: f32 = 1e-3;

impl LightBasis {
    /// The sky under a rig: the rig's own, else the baked one as the rig turns it.
    pub fn sky_light(&self, rig: &LightRig) -> Option<SkyLight> {
        match &rig.sky {
            Some(setting) => setting.light(self.sky.as_ref()),
            None => self.sky.clone(),
        }
    }

    /// Whether the sun of a sky stands where this basis has a column for it.
    pub fn keeps_its_sun(&self, light: &SkyLight) -> bool {
        let at = light.sun_direction();
        let own = self.sources.iter().find_map(|source| match source.kind {
            SourceKind::Sun { direction } => Some(direction),
            _ => None,
        });
        at.zip(own).is_some_and(|(a, b)| (a - b).length() < SAME_SUN_RAD)
    }

    /// Coefficients of the patches and of what the camera sees. A sun without a column of its own shines from its patch.
    pub(super) fn project_dome(&self, rig: &LightRig, setting: LightSetting, divisions: u32, columns: &mut [[f32; 3]]) {
        let Some(light) = self.sky_light(rig) else { return columns.fill([0.0; 3]) };
        let dome = Dome::new(divisions);
        let factor = setting.emission(Vec3::ONE, light.intensity);
        for (column, mean) in columns.iter_mut().zip(dome.means(&light.map, light.turn())) {
            *column = (Vec3::from(mean) * factor).to_array();
        }
        if let Some((sun, direction)) = light.sun.zip(light.sun_direction()).filter(|_| !self.keeps_its_sun(&light)) {
            let patch = dome.patch(direction);
            let radiance = sun.color * sun.illuminance_lx / dome.solid_angle(patch);
            let column = &mut columns[patch as usize];
            *column = (Vec3::from(*column) + radiance * factor).to_array();
        }
        if let Some(seen) = columns.last_mut() {
            *seen = factor.to_array();
        }
    }

    /// Coefficient of the sun's own column: dark where the sun of the rig stands elsewhere.
    pub(super) fn project_sun(&self, rig: &LightRig, setting: LightSetting, source: &LightSource) -> Vec3 {
        // In a picture that is traced the sky is that of the scene.
        if rig.sky.is_none() || self.sources.iter().any(|s| s.kind == SourceKind::Sky) {
            return setting.emission(source.color, source.strength);
        }
        let light = self.sky_light(rig).filter(|light| self.keeps_its_sun(light));
        let Some((light, sun)) = light.and_then(|light| light.sun.map(|sun| (light, sun))) else { return Vec3::ZERO };
        setting.emission(sun.color, sun.illuminance_lx * light.intensity)
    }
}
