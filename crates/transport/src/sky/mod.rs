//! The sky: pictures of all directions, an analytic sun and sky, and the patches that carry either in a matrix.
//!
//! Directions are those of the scene, +Y up. A map's center is +X: `u = atan2(z, x) / 2π + ½`, `v = 0` is up. North is −Z
//! and east is +X, so that a plan seen from above has north on top; azimuths run from north over east.
//!
//! In a picture that is traced ([`SkyForm::Whole`]) the map is one light, sampled by its own brightness. In a matrix
//! ([`SkyForm::Patches`]) it is a column per patch of a dome, so that it can be turned and exchanged afterwards, and one
//! column more that says where the camera sees it, so that it is shown sharply and not in patches.

mod analytic;
mod averaged;
mod backdrop;
mod coarse;
mod codec;
mod dome;
mod emitter;
mod environment;
mod patch_sampler;
mod picks;
mod sampler;
mod setting;
mod sun;

use std::sync::Arc;

use glam::Vec3;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::light::luminance;

pub(crate) use averaged::{Averaged, size_within};

pub use analytic::{DEFAULT_TURBIDITY, analytic_sky, sun_illuminance, sun_tint};
pub use backdrop::Backdrop;
pub use dome::{DOME_DIVISIONS, Dome, dome_columns};
pub use emitter::{DomeEmitter, MapEmitter, SunEmitter};
pub use environment::{Cleaned, Environment};
pub use picks::{SkyPicks, Unseen};
pub use sampler::MapSampler;
pub use setting::{SkySetting, SunPlace, SunSetting};
pub use sun::{SUN_RADIUS_RAD, SunPosition, SunTime, n_days, sun_direction, sun_solid_angle};

/// Why there is no sky.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SkyError {
    /// The file cannot be read.
    #[error("cannot read the sky {path}: {source}; check the path")]
    Read {
        /// Which file.
        path: String,
        /// What the system says.
        source: std::io::Error,
    },
    /// The file holds no picture that is known.
    #[error("cannot use the sky {path}: {reason}; give an equirectangular .hdr or .exr with R, G and B")]
    Decode {
        /// Which file.
        path: String,
        /// What is wrong.
        reason: String,
    },
    /// An empty or absurdly large picture.
    #[error(
        "a sky of {width}×{height} pixels cannot be used; give at most {} pixels, such as 8192×4096",
        Environment::MAX_PIXELS
    )]
    Size {
        /// Pixels around.
        width: usize,
        /// Pixels from zenith to nadir.
        height: usize,
    },
    /// A setting out of range.
    #[error("{0}")]
    Setting(String),
}

/// How a sky enters the columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SkyForm {
    /// One column, the map as it is: for a picture.
    Whole,
    /// A column per patch of a dome with that many divisions of each of Tregenza's patches: for a matrix.
    Patches(u32),
}

/// A sun, before the sky is turned.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sun {
    /// Unit vector towards it.
    pub direction: Vec3,
    /// Illuminance in lux on a surface that faces it.
    pub illuminance_lx: f32,
    /// Linear Rec. 709 at luminance 1.
    pub color: Vec3,
}

/// A sky that lights a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SkyLight {
    /// For people: a file name, `uniform`, or a sun.
    pub name: String,
    /// By how much it is turned about +Y, in degrees, counter-clockwise seen from above: +X goes to −Z.
    pub rotation_deg: f32,
    /// Multiplies map and sun.
    pub intensity: f32,
    /// Beside the map.
    pub sun: Option<Sun>,
    /// Radiance in nit; kept beside the header of a file.
    #[serde(skip)]
    pub map: Arc<Environment>,
}

impl SkyLight {
    /// A map, not turned.
    pub fn new(name: &str, map: Environment) -> SkyLight {
        SkyLight { name: name.into(), rotation_deg: 0.0, intensity: 1.0, sun: None, map: Arc::new(map) }
    }

    /// Whether all its numbers are.
    pub(crate) fn is_finite(&self) -> bool {
        let sun = self
            .sun
            .is_none_or(|sun| sun.direction.is_normalized() && sun.illuminance_lx.is_finite() && sun.color.is_finite());
        sun && self.rotation_deg.is_finite() && self.intensity.is_finite()
    }

    /// How it is turned.
    pub fn turn(&self) -> Turn {
        Turn::new(self.rotation_deg)
    }

    /// Unit vector towards its sun, as turned.
    pub fn sun_direction(&self) -> Option<Vec3> {
        self.sun.map(|sun| self.turn().world_from_sky(sun.direction))
    }

    /// Illuminance in lux on a level surface under a free sky: by the map, and by the sun.
    pub fn level_lx(&self) -> [f32; 2] {
        let of_sun = |sun: Sun| sun.illuminance_lx * luminance(sun.color) * sun.direction.y.max(0.0);
        [luminance(self.map.level_irradiance()), self.sun.map_or(0.0, of_sun)].map(|lux| lux * self.intensity)
    }

    /// The same with a map that a file keeps: bounded in size and rounded as it is stored, so that a bake and its file
    /// know one and the same sky.
    #[must_use]
    pub fn storable(mut self) -> SkyLight {
        self.map = Arc::new(self.map.storable());
        self
    }
}

/// A turn about +Y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn {
    sin: f32,
    cos: f32,
    /// As a share of a whole turn, 0…1.
    pub share: f32,
}

impl Turn {
    /// By an angle in degrees, counter-clockwise seen from above.
    pub fn new(rotation_deg: f32) -> Turn {
        let share = (f64::from(rotation_deg) / 360.0).rem_euclid(1.0);
        let (sin, cos) = (share * std::f64::consts::TAU).sin_cos();
        Turn { sin: sin as f32, cos: cos as f32, share: share as f32 }
    }

    /// From the map to the scene.
    pub fn world_from_sky(&self, d: Vec3) -> Vec3 {
        Vec3::new(d.x * self.cos + d.z * self.sin, d.y, d.z * self.cos - d.x * self.sin)
    }

    /// From the scene to the map.
    pub fn sky_from_world(&self, d: Vec3) -> Vec3 {
        Vec3::new(d.x * self.cos - d.z * self.sin, d.y, d.z * self.cos + d.x * self.sin)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quarter_turn_brings_x_to_minus_z_and_back() {
        let turn = Turn::new(90.0);
        assert!((turn.world_from_sky(Vec3::X) - Vec3::NEG_Z).length() < 1e-6);
        let d = Vec3::new(0.3, -0.5, 0.7).normalize();
        assert!((Turn::new(-223.0).sky_from_world(Turn::new(-223.0).world_from_sky(d)) - d).length() < 1e-6);
    }
}
