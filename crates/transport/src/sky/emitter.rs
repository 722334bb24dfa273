//! The sky as light: directions to sample, and what arrives from one.

use std::sync::Arc;

use glam::{Vec2, Vec3};

use super::{Dome, Environment, MapSampler, SUN_RADIUS_RAD, SkyLight, Turn, sun_solid_angle};

/// A map as it is, one column.
#[derive(Clone, Debug)]
pub struct MapEmitter {
    map: Arc<Environment>,
    sampler: Arc<MapSampler>,
    turn: Turn,
}

impl MapEmitter {
    /// Of a sky as it is turned; its intensity is the column's.
    pub fn new(light: &SkyLight) -> MapEmitter {
        let sampler = Arc::new(MapSampler::new(&light.map));
        MapEmitter { map: light.map.clone(), sampler, turn: light.turn() }
    }

    /// Radiance from a unit direction, nit.
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        self.map.radiance(self.turn.sky_from_world(direction))
    }

    /// Solid-angle density of a unit direction.
    pub fn pdf(&self, direction: Vec3) -> f32 {
        self.sampler.pdf(self.turn.sky_from_world(direction))
    }

    /// A unit direction and its solid-angle density.
    pub fn sample(&self, u: Vec2) -> (Vec3, f32) {
        let (direction, pdf) = self.sampler.sample(u);
        (self.turn.world_from_sky(direction), pdf)
    }

    /// Mean luminance over all directions, nit.
    pub fn mean_luminance(&self) -> f32 {
        self.sampler.mean_luminance()
    }
}

/// Patches of 1 nit, one column each, and after them the column of what the camera sees.
#[derive(Clone, Debug)]
pub struct DomeEmitter {
    /// The patches.
    pub dome: Dome,
}

/// A disk of 1 lx, one column.
#[derive(Clone, Copy, Debug)]
pub struct SunEmitter {
    /// Unit vector towards its middle.
    pub direction: Vec3,
}

impl SunEmitter {
    /// Its radiance in nit.
    pub fn radiance() -> f32 {
        (1.0 / sun_solid_angle()) as f32
    }

    /// Whether a unit direction meets the disk.
    pub fn contains(&self, direction: Vec3) -> bool {
        // The chord is exact where the cosine of so small an angle is not.
        let chord = 2.0 * (0.5 * SUN_RADIUS_RAD).sin();
        (direction - self.direction).length_squared() <= (chord * chord) as f32
    }

    /// A unit direction, uniform over the disk.
    pub fn sample(&self, u: Vec2) -> Vec3 {
        let below_one = u.x * (1.0 - SUN_RADIUS_RAD.cos()) as f32;
        let sin = (below_one * (2.0 - below_one)).sqrt();
        let (sin_phi, cos_phi) = (std::f32::consts::TAU * u.y).sin_cos();
        let (tangent, bitangent) = self.direction.any_orthonormal_pair();
        tangent * (sin * cos_phi) + bitangent * (sin * sin_phi) + self.direction * (1.0 - below_one)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampler::Sampler;

    #[test]
    fn directions_of_the_sun_fill_its_disk_evenly() {
        let sun = SunEmitter { direction: Vec3::new(0.3, 0.8, -0.5).normalize() };
        let (n, mut inner) = (4096, 0);
        for i in 0..n {
            let d = sun.sample(Vec2::from(Sampler::new(1, 1, i).next_2d()));
            let angle = f64::from((d - sun.direction).length());
            assert!(angle <= SUN_RADIUS_RAD * 1.001, "{angle}");
            inner += u32::from(angle < SUN_RADIUS_RAD / 2.0);
        }
        assert!((f64::from(inner) / f64::from(n) - 0.25).abs() < 0.01, "a quarter of the area: {inner}");
        let beside = sun.direction.any_orthonormal_vector();
        let at = |radii: f32| (sun.direction + beside * (radii * SUN_RADIUS_RAD as f32)).normalize();
        assert!(sun.contains(at(0.99)) && !sun.contains(at(1.01)));
    }

    #[test]
    fn a_turned_map_is_sampled_where_it_shines() {
        let map = Environment::from_fn(64, 32, |d| Vec3::splat(if d.dot(Vec3::X) > 0.9 { 50.0 } else { 0.1 }));
        let light = SkyLight { rotation_deg: 90.0, ..SkyLight::new("spot", map) };
        let emitter = MapEmitter::new(&light);
        assert!(emitter.radiance(Vec3::NEG_Z).x > 40.0 && emitter.radiance(Vec3::X).x < 1.0);
        let samples: Vec<_> = (0..100).map(|i| emitter.sample(Vec2::from(Sampler::new(2, 3, i).next_2d()))).collect();
        assert!(samples.iter().filter(|(d, _)| d.dot(Vec3::NEG_Z) > 0.8).count() > 85);
        // Rounding may carry a sample over the edge of its pixel.
        assert!(samples.iter().filter(|(d, pdf)| emitter.pdf(*d) == *pdf).count() > 95);
    }
}
