//! Lamps that a designer puts into the scene, without a column of their own: movable after the bake.

mod body;
mod exchange;
mod frame;
mod install;
mod lacking;
mod light;
mod prepared;
mod rectangle;
mod source;
mod thrown;
mod units;
mod words;

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::light::LightSetting;
use crate::scene::PunctualKind;

pub use self::body::least_size_m;
pub(crate) use self::body::{Body, BodyPoint};
pub use self::frame::half_turn;
pub use self::lacking::Lacking;
pub use self::light::Lamp;
pub(crate) use self::light::{Lit, Through, Way};
pub use self::prepared::{KeptProfiles, LampError, LampWarning, PreparedLamps};
pub(crate) use self::prepared::{PreparedLamp, lattice};
pub(crate) use self::units::lumen_per_candela;
pub use self::words::LampWords;

/// A lamp of a look. It shines from `position` towards `aim`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FreeLamp {
    /// Its name in the look; no other light has it.
    pub key: String,
    /// What it is and how large.
    pub shape: LampShape,
    /// World-space center, meters.
    pub position: Vec3,
    /// World-space point that it shines at, meters. A lamp that shines all around has no use for it.
    pub aim: Vec3,
    /// Turn about the aim, clockwise as the lamp looks; at 0 its right side is level. Only a lamp with sides has use for it.
    #[serde(default, skip_serializing_if = "is_level")]
    pub turn_rad: f32,
    /// How strong it is, in `unit`, before `setting.intensity` multiplies it.
    pub strength: f32,
    /// Unit of the strength.
    pub unit: LampUnit,
    /// Color, or kelvin; white where neither is set. A muted lamp is dark.
    pub setting: LightSetting,
    /// Key of the light of the scene in whose place it shines, which is muted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub replaces: Option<String>,
}

fn is_level(turn_rad: &f32) -> bool {
    *turn_rad == 0.0
}

/// Kinds of free lamps. Angles are half angles in radians.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LampShape {
    /// A point that shines all around.
    Point,
    /// A point with a cone; glTF's falloff.
    Spot {
        /// Half angle of the full intensity.
        inner_rad: f32,
        /// Half angle where the light ends.
        outer_rad: f32,
    },
    /// A rectangle that shines to one side, diffusely.
    Rectangle {
        /// Width (level where possible) and height, meters.
        size_m: [f32; 2],
    },
    /// A disk that shines to one side, diffusely.
    Disk {
        /// Meters.
        radius_m: f32,
    },
    /// A sphere that shines diffusely.
    Sphere {
        /// Meters.
        radius_m: f32,
    },
    /// Parallel light along `aim - position`, from a disk far away.
    Directional {
        /// Angle from the middle of the disk to its rim; 0 is a point.
        radius_rad: f32,
    },
    /// A point with a measured distribution.
    Profile {
        /// Path of an IES or EULUMDAT file, as the look has it.
        file: String,
    },
}

/// Units of a lamp's strength.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum LampUnit {
    /// Lumen: luminous flux in all directions.
    #[serde(rename = "lm")]
    Lumen,
    /// Candela: luminous intensity along the axis (of a profile: its largest).
    #[serde(rename = "cd")]
    Candela,
    /// Nit: luminance of a lamp with a surface.
    #[serde(rename = "nit")]
    Nit,
    /// Lux: illuminance of parallel light on a surface that faces it.
    #[serde(rename = "lx")]
    Lux,
}

impl LampUnit {
    /// As files and people write it.
    pub fn name(self) -> &'static str {
        match self {
            LampUnit::Lumen => "lm",
            LampUnit::Candela => "cd",
            LampUnit::Nit => "nit",
            LampUnit::Lux => "lx",
        }
    }
}

/// Least outer half angle of a spot: a narrower one shines into this cone with the same strength.
pub const LEAST_CONE_RAD: f32 = 0.1 / 180.0 * std::f32::consts::PI;

impl LampShape {
    /// The kind of lamp without size that it is, if it has none.
    pub(crate) fn without_size(&self) -> PunctualKind {
        match *self {
            LampShape::Spot { inner_rad, outer_rad } => {
                PunctualKind::Spot { inner_rad, outer_rad: outer_rad.max(LEAST_CONE_RAD) }
            }
            _ => PunctualKind::Point,
        }
    }

    /// As files and people call it.
    pub fn name(&self) -> &'static str {
        match self {
            LampShape::Point => "point",
            LampShape::Spot { .. } => "spot",
            LampShape::Rectangle { .. } => "rectangle",
            LampShape::Disk { .. } => "disk",
            LampShape::Sphere { .. } => "sphere",
            LampShape::Directional { .. } => "directional",
            LampShape::Profile { .. } => "ies",
        }
    }

    /// Units in which its strength can be given, the usual one first.
    pub fn units(&self) -> &'static [LampUnit] {
        match self {
            LampShape::Point | LampShape::Spot { .. } | LampShape::Profile { .. } => {
                &[LampUnit::Lumen, LampUnit::Candela]
            }
            LampShape::Rectangle { .. } | LampShape::Disk { .. } | LampShape::Sphere { .. } => {
                &[LampUnit::Lumen, LampUnit::Candela, LampUnit::Nit]
            }
            LampShape::Directional { .. } => &[LampUnit::Lux],
        }
    }

    /// Whether its shadows are soft: it has a surface that shines, or its parallel light comes from a disk.
    pub fn has_soft_shadows(&self) -> bool {
        match *self {
            LampShape::Directional { radius_rad } => radius_rad > 0.0,
            _ => self.units().contains(&LampUnit::Nit),
        }
    }

    /// Whether it shines from nowhere in particular, along one direction.
    pub fn is_parallel(&self) -> bool {
        matches!(self, LampShape::Directional { .. })
    }

    /// Whether it matters where it is aimed at.
    pub fn is_aimed(&self) -> bool {
        !matches!(self, LampShape::Point | LampShape::Sphere { .. })
    }

    /// Whether it has sides, so that it matters how it is turned about its aim.
    pub fn is_turnable(&self) -> bool {
        matches!(self, LampShape::Rectangle { .. } | LampShape::Profile { .. })
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// 30 degrees beside its axis it sends 900 cd to its right, 500 up, 250 down and 100 to its left.
    pub(crate) const ONE_SIDED: &str = "IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 4 5 1 2 0 0 0\n1 1 10\n0 30 60 90\n\
        0 90 180 270 360\n400 900 200 0\n400 500 100 0\n400 100 0 0\n400 250 50 0\n400 900 200 0\n";

    /// A lamp at (0, 1, 0) that looks down, of 1 in a unit that it can have.
    pub(crate) fn lamp(shape: LampShape) -> FreeLamp {
        let unit = if shape.is_parallel() { LampUnit::Lux } else { LampUnit::Candela };
        let (key, setting) = ("lamp".to_owned(), LightSetting::default());
        FreeLamp {
            key,
            shape,
            position: Vec3::Y,
            aim: Vec3::ZERO,
            strength: 1.0,
            unit,
            setting,
            turn_rad: 0.0,
            replaces: None,
        }
    }
}
