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
/// Least coefficient of what the camera sees, over the lux of a sun that stands in it with a setting of its own: where the sky
/// is off, the disk is seen all the same.
const LEAST_SEEN: f32 = 1e-9;

/// What the columns of a dome shine with, as the lights are set.
pub(crate) struct DomeLight {
    /// The sky.
    pub light: SkyLight,
    /// What multiplies its map on the patches.
    pub factor: Vec3,
    /// Coefficient of what the camera sees: it multiplies all that stands behind the picture.
    pub seen: Vec3,
    /// The map behind the picture, in units of `seen`: 1 but where the sky is far dimmer than a sun in it.
    pub map: Vec3,
    /// A sun that shines without a column of its own.
    pub sun: Option<MovedSun>,
}

/// A sun that shines from its patch of the sky.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MovedSun {
    /// Unit vector towards it.
    pub direction: Vec3,
    /// Illuminance on a surface that faces it, lux per channel.
    pub lux: Vec3,
    /// The same in units of [`DomeLight::seen`].
    pub seen_lux: Vec3,
}

/// A sun that shines from the columns of the sky by a setting of its own, told apart from what else they shine with.
pub struct SunApart<'a> {
    /// The light that sets it.
    pub source: &'a LightSource,
    /// The lighting without it: every column has the light of its own source alone.
    pub without: LightRig,
    /// The lighting with it alone: all columns together are its light. Free lamps stay as they are.
    pub alone: LightRig,
}

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
        let own = self.sun_source().map(|(_, direction)| direction);
        light.sun_direction().zip(own).is_some_and(|(a, b)| (a - b).length() < SAME_SUN_RAD)
    }

    /// The sun among the lights, and where its column has it.
    fn sun_source(&self) -> Option<(&LightSource, Vec3)> {
        self.sources.iter().find_map(|source| match source.kind {
            SourceKind::Sun { direction } => Some((source, direction)),
            _ => None,
        })
    }

    /// The light of a sky of patches under a rig: a sun that moved away from its column is set as the sun among the lights, where
    /// there is one, else as the sky. `None` without a sky of patches.
    pub(crate) fn dome_light(&self, rig: &LightRig) -> Option<DomeLight> {
        let sky = self.sources.iter().find(|source| matches!(source.kind, SourceKind::Dome { .. }))?;
        let light = self.sky_light(rig)?;
        let factor = rig.light_setting(&sky.key).emission(Vec3::ONE, light.intensity);
        let moved = light.sun.zip(light.sun_direction()).filter(|_| !self.keeps_its_sun(&light));
        let mut dome = DomeLight { light, factor, seen: factor, map: Vec3::ONE, sun: None };
        let Some((sun, direction)) = moved else { return Some(dome) };
        match self.sun_source() {
            None => {
                let seen_lux = sun.color * sun.illuminance_lx;
                dome.sun = Some(MovedSun { direction, lux: seen_lux * factor, seen_lux });
            }
            Some((source, _)) => {
                let strength = sun.illuminance_lx * dome.light.intensity;
                let lux = rig.light_setting(&source.key).emission(sun.color, strength);
                if lux != Vec3::ZERO {
                    let seen = factor.max(lux * LEAST_SEEN);
                    dome.sun = Some(MovedSun { direction, lux, seen_lux: in_units(lux, seen) });
                    (dome.seen, dome.map) = (seen, in_units(factor, seen));
                }
            }
        }
        Some(dome)
    }

    /// A sun that shines from the columns of the sky and is set by itself, told apart: what asks for the light of each source by
    /// its columns takes the lighting without it, and adds it. `None` where every column has the light of its own source alone.
    pub fn sun_apart(&self, rig: &LightRig) -> Option<SunApart<'_>> {
        let (source, _) = self.sun_source()?;
        self.dome_light(rig)?.sun?;
        let mute = |rig: &mut LightRig, key: &str| rig.lights.entry(key.to_owned()).or_default().muted = true;
        let [mut without, mut alone] = [rig.clone(), rig.clone()];
        mute(&mut without, &source.key);
        self.sources.iter().filter(|other| other.key != source.key).for_each(|other| mute(&mut alone, &other.key));
        Some(SunApart { source, without, alone })
    }

    /// Coefficients of the patches and of what the camera sees. A sun without a column of its own shines from its patch.
    pub(super) fn project_dome(&self, rig: &LightRig, divisions: u32, columns: &mut [[f32; 3]]) {
        let Some(DomeLight { light, factor, seen, sun, .. }) = self.dome_light(rig) else {
            return columns.fill([0.0; 3]);
        };
        let dome = Dome::new(divisions);
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
        if let Some(MovedSun { direction, lux, .. }) = sun {
            let patch = dome.patch(direction);
            let column = &mut columns[patch as usize];
            *column = (Vec3::from(*column) + lux / dome.solid_angle(patch)).to_array();
        }
        if let Some(last) = columns.last_mut() {
            *last = seen.to_array();
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

/// Light in units of other light; nothing where that is dark.
fn in_units(light: Vec3, unit: Vec3) -> Vec3 {
    Vec3::select(unit.cmpgt(Vec3::ZERO), light / unit, Vec3::ZERO)
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
    use crate::light::{LightGroup, planckian_tint};
    use crate::sky::{Environment, Sun, dome_columns};

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

    const LUX: f32 = 8e4;
    const MUTED: LightSetting = LightSetting { intensity: 1.0, color: None, kelvin: None, muted: true };

    /// An even sky of patches with a sun, and a lighting that turns both away and halves them.
    fn turned() -> (LightBasis, LightRig) {
        let sun = Sun { direction: Vec3::new(0.0, 0.6, 0.8), illuminance_lx: LUX, color: Vec3::ONE };
        let light = SkyLight { sun: Some(sun), ..SkyLight::new("sun", Environment::uniform(Vec3::splat(100.0))) };
        let of_sky = LightSource::plain("sky", SourceKind::Dome { divisions: 1 }, 0..dome_columns(1));
        let of_sun = LightSource::plain("sun", SourceKind::Sun { direction: sun.direction }, 0..1);
        let basis = LightBasis { sky: Some(light), ..LightBasis::new(vec![of_sky, of_sun]) };
        let sky = SkySetting { rotation_deg: 90.0, intensity: 0.5, ..SkySetting::default() };
        (basis, LightRig { sky: Some(sky), ..LightRig::default() })
    }

    /// The same sky where its sun is no light of its own.
    fn with_sky_alone(basis: &LightBasis) -> LightBasis {
        let sources = vec![basis.source("sky").unwrap().clone()];
        LightBasis { sky: basis.sky.clone(), ..LightBasis::new(sources) }
    }

    /// The brightest patch: that of the sun, unless it is dark.
    fn patch(basis: &LightBasis, rig: &LightRig) -> Vec3 {
        let columns = &basis.source("sky").unwrap().columns;
        let patches = &basis.project(rig)[columns.start as usize..columns.end as usize - 2];
        patches.iter().map(|rgb| Vec3::from(*rgb)).fold(Vec3::ZERO, Vec3::max)
    }

    #[track_caller]
    fn assert_close(found: Vec3, wanted: Vec3) {
        let off = (found - wanted).abs().max_element();
        assert!(off < 1e-4 * wanted.max_element(), "{found} is not {wanted}");
    }

    #[test]
    fn a_moved_sun_shines_as_its_light_is_set() {
        let (basis, mut rig) = turned();
        let (dome, direction) = (Dome::new(1), basis.sky_light(&rig).unwrap().sun_direction().unwrap());
        let full = Vec3::splat(0.5 * LUX / dome.solid_angle(dome.patch(direction)));
        assert_close(patch(&basis, &rig), full);
        rig.set("sun", LightSetting { intensity: 0.5, ..LightSetting::default() });
        assert_close(patch(&basis, &rig), 0.5 * full);
        rig.set("sun", LightSetting { kelvin: Some(2700.0), ..LightSetting::default() });
        assert_close(patch(&basis, &rig), planckian_tint(2700.0) * full);
        rig.set("sun", LightSetting::default());
        let lights = ["sun".to_owned()].into();
        rig.groups.insert("outside".into(), LightGroup { lights, intensity: 0.25, muted: false });
        assert_close(patch(&basis, &rig), 0.25 * full);
        rig.set("sun", MUTED);
        assert!(patch(&basis, &rig).max_element() < 1e-2, "it stays dark");
        let seen = *basis.project(&rig).last().unwrap();
        assert_eq!(seen, [0.5; 3], "the sky does not");
        // Without a light of its own it goes with the sky.
        let (basis, mut rig) = (with_sky_alone(&basis), turned().1);
        assert_close(patch(&basis, &rig), full);
        rig.set("sky", LightSetting { intensity: 0.5, ..LightSetting::default() });
        assert_close(patch(&basis, &rig), 0.5 * full);
    }

    #[test]
    fn a_moved_sun_shines_from_a_sky_that_is_off() {
        let (basis, mut rig) = turned();
        let full = patch(&basis, &rig);
        rig.set("sky", MUTED);
        assert_close(patch(&basis, &rig), full);
        let columns = basis.project(&rig);
        assert_eq!(columns.iter().filter(|rgb| **rgb != [0.0; 3]).count(), 2, "its patch, and its disk");
        assert!(columns.last().unwrap().iter().all(|seen| *seen > 0.0));
        rig.set("sun", MUTED);
        assert!(basis.project(&rig).iter().all(|rgb| *rgb == [0.0; 3]));
    }

    #[test]
    fn a_moved_sun_is_told_apart_from_the_sky() {
        let (basis, mut rig) = turned();
        rig.set("sun", LightSetting { intensity: 0.1, ..LightSetting::default() });
        let sun = basis.sun_apart(&rig).unwrap();
        let [whole, without, alone] = [&rig, &sun.without, &sun.alone].map(|rig| basis.project(rig));
        let n_patches = whole.len() - 1;
        for ((whole, without), alone) in whole.iter().zip(&without).zip(&alone).take(n_patches) {
            let sum = Vec3::from(*without) + Vec3::from(*alone);
            assert!((sum - Vec3::from(*whole)).abs().max_element() <= 1e-5 * sum.abs().max_element());
        }
        assert_eq!(sun.source.key, "sun");
        assert_close(patch(&basis, &sun.alone), patch(&basis, &rig));
        assert!(patch(&basis, &sun.without).max_element() < 1e-2);
        let is_apart = |rig: &LightRig| basis.sun_apart(rig).is_some();
        assert!(!is_apart(&sun.without) && !is_apart(&LightRig::default()));
        assert!(with_sky_alone(&basis).sun_apart(&rig).is_none());
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
