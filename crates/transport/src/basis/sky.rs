//! Coefficients of the sky: its map resampled to patches, as it is turned.

use std::f64::consts::PI;

use glam::Vec3;

use super::{LightBasis, LightSource, SourceKind};
use crate::light::{LightRig, LightSetting};
use crate::sky::{Dome, SkyLight, SkySetting};

/// Angle in radians, a quarter of its radius, by which a sun may have moved and still have its own column.
const SAME_SUN_RAD: f32 = 1e-3;
/// Variance over squared mean up to which a sky is the same everywhere.
const EVEN: f64 = 1e-9;

impl LightBasis {
    /// The sky under a rig: the rig's own, else the baked one as the rig turns it.
    pub fn sky_light(&self, rig: &LightRig) -> Option<SkyLight> {
        match &rig.sky {
            Some(setting) => setting.light(self.sky.as_ref()),
            None => self.sky.clone(),
        }
    }

    /// The baked sky as a rig would say it that names none: turned and dimmed as it was baked.
    pub fn sky_as_baked(&self) -> SkySetting {
        let baked = self.sky.as_ref().map(|sky| (sky.rotation_deg, sky.intensity));
        let (rotation_deg, intensity) = baked.unwrap_or((0.0, 1.0));
        SkySetting { rotation_deg, intensity, ..SkySetting::default() }
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
        let (patches, of_map) = columns.split_at_mut(dome.n_patches() as usize);
        for (column, mean) in patches.iter_mut().zip(dome.means(&light.map, light.turn())) {
            *column = mean;
        }
        // Bakes of earlier programs have no column of their map.
        if let ([whole, _], Some(baked)) = (of_map, &self.sky) {
            let is_as_baked = (&light.map, light.turn()) == (&baked.map, baked.turn());
            let means = if is_as_baked { patches.to_vec() } else { dome.means(&baked.map, baked.turn()) };
            *whole = take_out(&dome, patches, &means);
        }
        columns.iter_mut().for_each(|column| *column = (Vec3::from(*column) * factor).to_array());
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

/// How much of a sky, by its means over patches, is the baked one as it was baked; that part is taken out of the patches. All
/// of it where nothing but the strength differs or a veil lies over both, and the less the less the two are alike: by the slope
/// of one over the other, times the square of their correlation, each channel by itself.
fn take_out(dome: &Dome, patches: &mut [[f32; 3]], baked: &[[f32; 3]]) -> [f32; 3] {
    let shares: Vec<f64> = (0..dome.n_patches()).map(|p| f64::from(dome.solid_angle(p)) / (4.0 * PI)).collect();
    std::array::from_fn(|channel| {
        let of = |means: &[[f32; 3]]| means.iter().map(|mean| f64::from(mean[channel])).collect::<Vec<_>>();
        let [own, old] = [of(patches), of(baked)];
        let product = |a: &[f64], b: &[f64]| shares.iter().zip(a).zip(b).map(|((s, a), b)| s * a * b).sum::<f64>();
        let ones = vec![1.0; shares.len()];
        let [mean, mean_of_old] = [product(&own, &ones), product(&old, &ones)];
        let between = product(&own, &old) - mean * mean_of_old;
        let [of_own, of_old] = [product(&own, &own) - mean * mean, product(&old, &old) - mean_of_old * mean_of_old];
        let share = if of_old <= EVEN * mean_of_old * mean_of_old {
            // A sky that is the same everywhere is in every other one.
            if mean_of_old > 0.0 { own.iter().copied().fold(f64::INFINITY, f64::min) / mean_of_old } else { 0.0 }
        } else if between > 0.0 {
            between / of_old * (between / of_own * (between / of_old))
        } else {
            0.0
        };
        patches.iter_mut().zip(baked).for_each(|(own, old)| own[channel] -= share as f32 * old[channel]);
        share as f32
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sky::Environment;

    fn means(map: &Environment, rotation_deg: f32) -> Vec<[f32; 3]> {
        Dome::new(1).means(map, crate::sky::Turn::new(rotation_deg))
    }

    /// A bright spot in a sky that is bluer above.
    fn day() -> Environment {
        let spot = Vec3::new(1.0, 0.7, 0.0).normalize();
        Environment::from_fn(128, 64, |d| {
            Vec3::new(1.0, 1.2, 1.5 + d.y) + if d.dot(spot) > 0.99 { Vec3::splat(200.0) } else { Vec3::ZERO }
        })
    }

    #[track_caller]
    fn assert_whole(own: &[[f32; 3]], baked: &[[f32; 3]], share: f32) {
        let (mut patches, brightest) = (own.to_vec(), own.iter().flatten().copied().fold(0.0, f32::max));
        let taken = take_out(&Dome::new(1), &mut patches, baked);
        assert!(taken.iter().all(|taken| (taken - share).abs() < 1e-4 * share), "{taken:?}");
        assert!(patches.iter().flatten().all(|rest| rest.abs() < 1e-4 * brightest));
    }

    #[test]
    fn of_the_baked_sky_all_is_taken_out_however_bright() {
        let baked = means(&day(), 20.0);
        assert_whole(&baked, &baked, 1.0);
        let brighter: Vec<[f32; 3]> = baked.iter().map(|mean| mean.map(|x| 3.0 * x)).collect();
        assert_whole(&brighter, &baked, 3.0);
        let even = means(&Environment::uniform(Vec3::ONE), 0.0);
        assert_whole(&even, &even, 1.0);
        let black = vec![[0.0; 3]; baked.len()];
        assert_eq!(take_out(&Dome::new(1), &mut black.clone(), &baked), [0.0; 3]);
        assert_eq!(take_out(&Dome::new(1), &mut baked.clone(), &black), [0.0; 3]);
    }

    #[test]
    fn light_is_moved_from_patches_to_the_map_and_never_lost() {
        let (baked, dome) = (means(&day(), 0.0), Dome::new(1));
        let mut before = f32::INFINITY;
        for rotation in [0.0, 2.0, 5.0, 8.0, 12.0, 90.0] {
            let own = means(&day(), rotation);
            let mut patches = own.clone();
            let share = take_out(&dome, &mut patches, &baked);
            for ((own, rest), baked) in own.iter().zip(&patches).zip(&baked) {
                for channel in 0..3 {
                    assert!((rest[channel] + share[channel] * baked[channel] - own[channel]).abs() < 1e-3);
                }
            }
            assert!(share[0] <= before + 1e-6, "{rotation}: {share:?} after {before}");
            before = share[0];
        }
        assert!(before < 0.01, "a spot that stands elsewhere has nothing of the baked one: {before}");
    }
}
