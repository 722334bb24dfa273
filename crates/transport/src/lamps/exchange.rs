//! The strength of a lamp in another unit.

use std::path::Path;

use super::body::Body;
use super::units::native_strength;
use super::{FreeLamp, LampShape, LampUnit};
use crate::import::read_profile;

impl FreeLamp {
    /// What its strength has to be in another unit so that it shines as it does; `None` where it cannot have that unit, and
    /// for a lamp whose profile cannot be read.
    pub fn strength_in(&self, unit: LampUnit) -> Option<f32> {
        let profile = match &self.shape {
            LampShape::Profile { file } => Some(read_profile(Path::new(file)).ok()?),
            _ => None,
        };
        let body = Body::of(self);
        let native =
            |lamp: &FreeLamp| native_strength(lamp, body.as_ref().map(|(b, a)| (b, *a)), profile.as_ref()).ok();
        let per_unit = native(&FreeLamp { strength: 1.0, unit, ..self.clone() })?;
        let strength = (native(self)? / per_unit) as f32;
        strength.is_finite().then_some(strength)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lamps::tests::lamp;

    #[test]
    fn a_lamp_in_another_unit_shines_alike_and_returns() {
        let point = FreeLamp { strength: 100.0, ..lamp(LampShape::Point) };
        let lumen = point.strength_in(LampUnit::Lumen).unwrap();
        assert!((lumen / (400.0 * std::f32::consts::PI) - 1.0).abs() < 1e-6, "{lumen}");
        let back = FreeLamp { strength: lumen, unit: LampUnit::Lumen, ..point.clone() };
        assert!((back.strength_in(LampUnit::Candela).unwrap() - 100.0).abs() < 1e-4);
        assert_eq!(point.strength_in(LampUnit::Nit), None);
        let disk = FreeLamp { strength: 50.0, unit: LampUnit::Nit, ..lamp(LampShape::Disk { radius_m: 2.0 }) };
        let candela = disk.strength_in(LampUnit::Candela).unwrap();
        assert!((candela / (50.0 * 4.0 * std::f32::consts::PI) - 1.0).abs() < 1e-5, "{candela}");
        assert_eq!(lamp(LampShape::Directional { radius_rad: 0.0 }).strength_in(LampUnit::Lumen), None);
    }
}
