//! What the numbers of punctual lamps in a file mean.
//!
//! glTF counts them in candela and lux, but not every exporter does. Blender's “Unitless” mode writes watts per steradian and
//! watts per square meter: what its standard mode writes, without the 683 lumen per watt. Other exporters write plain
//! numbers of that order. One factor for all kinds of lamps keeps what the file says about one lamp against another.

use crate::scene::{PunctualLight, Scene};

/// Luminous efficacy that Blender and glTF take for all light, lumen per watt.
pub const LUMENS_PER_WATT: f32 = 683.0;

/// How the lamps of a file are counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LampUnits {
    /// Candela, and lux for directional lamps, as glTF has it.
    #[default]
    Photometric,
    /// Numbers of the order of watts per steradian, and per square meter for directional lamps.
    Unitless,
}

/// Makes candela and lux of lamps without units: 1 becomes 683. Lamps with a measured distribution are in candela already, and so are
/// those that shine instead of one that cannot be had. Answers how many lamps that were.
pub fn assume_unitless(scene: &mut Scene) -> usize {
    let Scene { punctual, substitute_lamps, .. } = scene;
    let counts = |lamp: &PunctualLight| lamp.profile.is_none() && !substitute_lamps.contains(&lamp.node);
    let lamps = punctual.iter_mut().filter(|lamp| counts(lamp));
    lamps.map(|lamp| lamp.intensity = (lamp.intensity * LUMENS_PER_WATT).min(f32::MAX)).count()
}
