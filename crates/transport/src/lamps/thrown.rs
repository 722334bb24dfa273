//! Light of lamps on patches of surface: asked for at samples of each patch where the lamp is far away, and thrown from the
//! lamp where it is near.
//!
//! A lamp close to a surface lights a spot that lies between the samples of a patch, or on one of them. Rays from the lamp
//! find all of it: each carries a share of its flux to where it lands. Their directions are fixed to the lamp, so that they
//! move as it does.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

use super::body::{Body, in_cone};
use super::light::{Form, Lamp, closest_m};
use super::prepared::{PreparedLamp, PreparedLamps, lattice, leaving};
use crate::emitters::punctual_falloff;
use crate::patches::{Beam, PatchSample, Patches};
use crate::photometry::PhotometricProfile;
use crate::prepared::{PreparedScene, beyond};
use crate::sampler::{cosine_around, uniform_sphere};
use crate::scene::{PunctualKind, PunctualLight};
use crate::slabs::most_in_a_row;

/// Rays from a lamp.
const BEAMS: u32 = 512;

impl PreparedLamps {
    /// One RGB coefficient per column of patches, see [`Patches::coefficients`]. Faces of solid panes before a patch count as `bounces`,
    /// of which there is no limit by `None`.
    pub fn light_on_patches(&self, scene: &PreparedScene, patches: &Patches, bounces: Option<u32>) -> Vec<[f32; 3]> {
        patches.coefficients_of(&self.irradiance_of_patches(scene, patches, bounces))
    }

    /// Mean irradiance of each patch, lux per channel, light of each direction times [`PatchSample::response`].
    pub(crate) fn irradiance_of_patches(
        &self,
        scene: &PreparedScene,
        patches: &Patches,
        bounces: Option<u32>,
    ) -> Vec<Vec3> {
        // A patch is one bounce beyond the surface that is seen.
        let most_slabs = most_in_a_row(bounces.unwrap_or(u32::MAX).saturating_sub(1));
        let Some(layout) = patches.layout() else {
            return patches.irradiance(&|at| self.light_on(scene, at, most_slabs));
        };
        let mut irradiance = patches.irradiance(&|at| self.far_light_on(scene, at, most_slabs));
        for lamp in self.lamps() {
            if layout.is_close(|place| lamp.lamp.apart_m(place)) {
                let beams = lamp.beams(scene.extent());
                let apart = |place| lamp.lamp.apart_m(place);
                let samples_of = |patch| patches.samples_of(patch);
                layout.receive(scene, (&beams, most_slabs), apart, samples_of, &mut irradiance);
            }
        }
        irradiance
    }

    /// [`PreparedLamps::light_on`] without what lamps throw on patches close by.
    fn far_light_on(&self, scene: &PreparedScene, sample: &PatchSample, most_slabs: usize) -> Vec3 {
        let share = |lamp: &PreparedLamp| sample.far_share(lamp.lamp.apart_m(sample.position));
        let lamps = self.lamps().iter().map(|lamp| (lamp, share(lamp)));
        let lit = lamps.filter(|(_, share)| *share > 0.0);
        lit.map(|(lamp, share)| lamp.light_on(scene, sample, most_slabs) * share).sum()
    }
}

impl PreparedLamp {
    /// Its light as rays into a scene of some extent, see [`PreparedScene::extent`]; none of light from far away.
    pub(super) fn beams(&self, extent: f32) -> Vec<Beam> {
        let beam = |(position, direction, flux): (Vec3, Vec3, f32), least_m: f32| {
            let origin = position + direction * leaving(position, direction, extent);
            Beam { origin, direction, flux: self.emission * flux, least_m }
        };
        match &self.lamp.form {
            Form::Point { light, profile, .. } => {
                let (rays, least_m) = (of_point(light, profile.as_deref()), closest_m(beyond(extent)));
                rays.into_iter().map(|(along, flux)| beam((light.position, along, flux), least_m)).collect()
            }
            Form::Distant { .. } => Vec::new(),
            Form::Body(body) => {
                let flux = PI * body.area() / BEAMS as f32;
                let ray = |nth: u32| {
                    let (at, along) = lattice4(nth);
                    let point = body.sample(at);
                    beam((point.position, cosine_around(point.normal, along.to_array()), flux), 0.0)
                };
                (0..BEAMS).map(ray).collect()
            }
        }
    }
}

impl Lamp {
    /// Distance of a place from the lamp, m, and so much more as the lamp is broad: within its breadth light changes slowly. Of a
    /// narrow beam the radius there, within which all of its light lands. Infinite for light from far away.
    fn apart_m(&self, place: Vec3) -> f32 {
        match &self.form {
            Form::Point { light, spread, .. } => light.position.distance(place) * spread,
            Form::Distant { .. } => f32::INFINITY,
            Form::Body(body) => body.distance(place) + body.breadth(),
        }
    }
}

impl Body {
    /// Distance of a place from the surface of a plate, or from what a sphere fills, m.
    fn distance(&self, place: Vec3) -> f32 {
        match self {
            Body::Rectangle { center, half, .. } => {
                let offset = place - *center;
                let aside = half.map(|axis| axis * (offset.dot(axis) / axis.length_squared()).clamp(-1.0, 1.0));
                (offset - aside[0] - aside[1]).length()
            }
            Body::Disk { center, radii, normal } => {
                let height = (place - *center).dot(*normal);
                let aside = (place - *center - *normal * height).length() - radii[0].length();
                Vec2::new(aside.max(0.0), height).length()
            }
            Body::Sphere { center, radius } => (place.distance(*center) - radius).max(0.0),
        }
    }

    /// Half of its shorter side, or its radius, m.
    fn breadth(&self) -> f32 {
        match self {
            Body::Rectangle { half, .. } => half[0].length().min(half[1].length()),
            Body::Disk { radii, .. } => radii[0].length(),
            Body::Sphere { radius, .. } => *radius,
        }
    }
}

/// Directions from a lamp without size, and the flux of each at 1 cd along its axis.
fn of_point(light: &PunctualLight, profile: Option<&PhotometricProfile>) -> Vec<(Vec3, f32)> {
    if let Some(profile) = profile {
        let [x, y] = light.across;
        let rays = profile.rays(BEAMS, |nth| lattice(nth).to_array()).into_iter();
        return rays.map(|(of, flux)| (x * of.x + y * of.y - light.direction * of.z, flux)).collect();
    }
    let ray = |nth: u32| {
        let (along, solid_angle) = match light.kind {
            PunctualKind::Spot { outer_rad, .. } => {
                in_cone(light.direction, 2.0 * (0.5 * outer_rad).sin().powi(2), lattice(nth))
            }
            _ => (uniform_sphere(lattice(nth).to_array()), 4.0 * PI),
        };
        (along, punctual_falloff(light, &[], along) * solid_angle / BEAMS as f32)
    };
    (0..BEAMS).map(ray).filter(|(_, flux)| *flux > 0.0).collect()
}

/// Points of the unit cube of four dimensions that are far apart, as two of the unit square. \[Roberts2018\]
fn lattice4(nth: u32) -> (Vec2, Vec2) {
    const STEP: [f64; 4] = [0.856_674_883_854_502_9, 0.733_891_856_627_126, 0.628_706_721_041_4, 0.538_597_257_226_8];
    let [a, b, c, d] = STEP.map(|step| (0.5 + step * f64::from(nth)).fract() as f32);
    (Vec2::new(a, b), Vec2::new(c, d))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lamps::{FreeLamp, LampShape, LampUnit, tests::lamp};

    const PROFILE: &str =
        "IESNA:LM-63-2002\nTILT=NONE\n1 -1 2 5 1 1 2 0 0 0\n1 1 9\n0 20 40 60 90\n0\n900 700 40 5 0\n";

    #[test]
    fn beams_carry_all_light_of_a_lamp() {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("narrow.ies"), PROFILE).expect("the folder can be written");
        for (shape, spread) in [
            (LampShape::Point, 1.0..=1.0),
            (LampShape::Spot { inner_rad: 0.2, outer_rad: 0.2 }, 0.19..=0.21),
            (LampShape::Spot { inner_rad: 1.0, outer_rad: 3.0 }, 1.0..=1.0),
            (LampShape::Profile { file: "narrow.ies".into() }, 0.3..=0.7),
            (LampShape::Rectangle { size_m: [0.8, 0.3] }, 0.0..=0.0),
            (LampShape::Disk { radius_m: 0.4 }, 0.0..=0.0),
            (LampShape::Sphere { radius_m: 0.3 }, 0.0..=0.0),
        ] {
            let lamp = FreeLamp { unit: LampUnit::Lumen, strength: 100.0, ..lamp(shape) };
            let lamps = PreparedLamps::new(&[lamp], Some(folder.path())).expect("a lamp that makes sense").0;
            let prepared = &lamps.lamps()[0];
            let beams = prepared.beams(1.0);
            let flux: f32 = beams.iter().map(|beam| beam.flux.x).sum();
            assert!((flux - 100.0).abs() < 1.0, "{prepared:?} throws {flux} lm");
            assert!(beams.len() <= BEAMS as usize && beams.iter().all(|beam| beam.direction.is_normalized()));
            if let Form::Point { spread: found, .. } = prepared.lamp.form {
                assert!(spread.contains(&found), "{prepared:?} spreads to {found}");
            }
        }
    }

    #[test]
    fn a_narrow_measured_beam_keeps_its_flux_wherever_it_is_aimed() {
        const BEAM: &str =
            "IESNA:LM-63-2002\nTILT=NONE\n1 -1 1 6 1 1 2 0 0 0\n1 1 9\n0 0.5 1 1.5 2 90\n0\n9000 7000 3000 600 0 0\n";
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("beam.ies"), BEAM).expect("the folder can be written");
        for nth in 0..32 {
            let ahead = uniform_sphere(lattice(nth).to_array());
            let plain = lamp(LampShape::Profile { file: "beam.ies".into() });
            let lamp = FreeLamp { unit: LampUnit::Lumen, strength: 100.0, aim: plain.position + ahead, ..plain };
            let lamps = PreparedLamps::new(&[lamp], Some(folder.path())).expect("a lamp that makes sense").0;
            let beams = lamps.lamps()[0].beams(1.0);
            let flux: f32 = beams.iter().map(|beam| beam.flux.x).sum();
            let astray = beams.iter().filter(|beam| beam.direction.dot(ahead) < 2.1_f32.to_radians().cos()).count();
            assert!((flux - 100.0).abs() < 1.0 && astray == 0, "towards {ahead}: {flux} lm, {astray} beams astray");
        }
    }

    #[test]
    fn far_from_the_origin_beams_begin_as_near_their_lamp_as_rounding_allows() {
        for shape in [LampShape::Point, LampShape::Spot { inner_rad: 0.3, outer_rad: 0.6 }] {
            for meters in [0.0, 1e2, 1e3, 1e4] {
                let position = Vec3::new(meters, -meters, meters);
                let lamp = FreeLamp { position, aim: position - Vec3::Y, ..lamp(shape.clone()) };
                let lamps = PreparedLamps::new(&[lamp], None).expect("a lamp that makes sense").0;
                let beams = lamps.lamps()[0].beams(4.0);
                let away = beams.iter().map(|beam| beam.origin.distance(position)).fold(0.0, f32::max);
                let steps = 16.0 * f32::EPSILON * meters;
                assert!(away > 0.0 && away <= 1e-4 + steps, "{shape:?}: {away} m, {meters} m from the origin");
            }
        }
    }
}
