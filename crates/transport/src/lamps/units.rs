//! What the strength of a lamp means: lumen, candela, nit and lux, turned into what its kind shines with.

use std::f64::consts::PI;

use super::body::Body;
use super::{FreeLamp, LampError, LampShape, LampUnit};
use crate::emitters::spot_rise;
use crate::photometry::PhotometricProfile;
use crate::scene::PunctualKind;

/// Strength of a lamp in the unit that light is computed with: candela along the axis (of a profile: its largest), lux of
/// parallel light, nit of a body. `area_m2` is what the look gives a body, which may be less than the body has.
pub(super) fn native_strength(
    lamp: &FreeLamp,
    body: Option<(&Body, f64)>,
    profile: Option<&PhotometricProfile>,
) -> Result<f64, LampError> {
    let strength = f64::from(lamp.strength);
    let native = match (&lamp.shape, body, profile) {
        (LampShape::Directional { .. }, ..) => (lamp.unit == LampUnit::Lux).then_some(strength),
        (LampShape::Sphere { .. }, Some((body, area)), _) => {
            of_body(lamp.unit, strength, area, f64::from(body.area()), 4.0)
        }
        (_, Some((body, area)), _) => of_body(lamp.unit, strength, area, f64::from(body.area()), 1.0),
        (_, None, profile) => {
            let lumen_per_candela = lumen_per_candela(lamp.shape.without_size(), profile);
            match lamp.unit {
                LampUnit::Candela => Some(strength),
                LampUnit::Lumen => Some(strength / lumen_per_candela),
                LampUnit::Nit | LampUnit::Lux => None,
            }
        }
    };
    native.ok_or_else(|| LampError::Unit {
        key: lamp.key.clone(),
        unit: lamp.unit.name(),
        kind: lamp.shape.name(),
        known: known_units(&lamp.shape),
    })
}

/// The units of a shape, in words.
fn known_units(shape: &LampShape) -> String {
    let names: Vec<&str> = shape.units().iter().map(|unit| unit.name()).collect();
    match names.split_last() {
        Some((last, [])) => last.to_string(),
        Some((last, others)) => format!("{} or {last}", others.join(", ")),
        None => String::new(),
    }
}

/// Luminance of a diffuse body of an area that stands for one of `asked` m²: the same flux leaves it. Seen from afar it
/// shows a face of a `faces`-th of its area.
fn of_body(unit: LampUnit, strength: f64, asked: f64, area: f64, faces: f64) -> Option<f64> {
    match unit {
        LampUnit::Nit => Some(strength * asked / area),
        LampUnit::Lumen => Some(strength / (PI * area)),
        LampUnit::Candela => Some(strength * faces / area),
        LampUnit::Lux => None,
    }
}

/// Luminous flux of a lamp without size whose largest intensity is 1 cd: that of its profile, if it has one.
pub(crate) fn lumen_per_candela(kind: PunctualKind, profile: Option<&PhotometricProfile>) -> f64 {
    match (kind, profile) {
        (_, Some(profile)) => f64::from(profile.flux_lm()) / f64::from(profile.max_candela()),
        (PunctualKind::Spot { inner_rad, outer_rad }, None) => spot_lumen_per_candela(inner_rad, outer_rad),
        (PunctualKind::Point | PunctualKind::Directional, None) => 4.0 * PI,
    }
}

/// The integral of a spot's falloff over all directions.
fn spot_lumen_per_candela(inner_rad: f32, outer_rad: f32) -> f64 {
    let [rim, rise] = spot_rise(inner_rad, outer_rad).map(f64::from);
    // Rising to 1 over a part of the cone, and 1 from there to the axis.
    let rising = rise.min(rim);
    2.0 * PI * (rising.powi(3) / (3.0 * rise * rise) + (rim - rising))
}

#[cfg(test)]
mod tests {
    use std::f32::consts::{FRAC_PI_2, FRAC_PI_3};

    use glam::Vec3;

    use super::*;
    use crate::emitters::punctual_falloff;
    use crate::lamps::LEAST_CONE_RAD;
    use crate::lamps::tests::lamp;
    use crate::scene::PunctualLight;

    fn native(shape: LampShape, strength: f32, unit: LampUnit) -> Option<f64> {
        let lamp = FreeLamp { strength, unit, ..lamp(shape) };
        let body = Body::of(&lamp);
        native_strength(&lamp, body.as_ref().map(|(body, area)| (body, *area)), None).ok()
    }

    #[test]
    fn lumen_candela_and_nit_are_converted_by_the_identities_of_photometry() {
        use LampUnit::{Candela, Lumen, Lux, Nit};
        let near = |found: Option<f64>, expected: f64| {
            let found = found.expect("a unit that makes sense");
            assert!((found / expected - 1.0).abs() < 1e-5, "{found} is not {expected}");
        };
        let pi = PI;
        // 4π lumen all around are 1 candela.
        near(native(LampShape::Point, 4.0 * pi as f32, Lumen), 1.0);
        near(native(LampShape::Point, 7.0, Candela), 7.0);
        // A cone without an edge to speak of fills 2π (1 − cos 60°) = π.
        let sharp = LampShape::Spot { inner_rad: FRAC_PI_3, outer_rad: FRAC_PI_3 };
        let found = native(sharp, 100.0, Lumen).expect("lumen");
        assert!((found * pi / 100.0 - 1.0).abs() < 2e-3, "{found}");
        // cos² θ from the axis to 90°: 2π ∫ c² dc = 2π/3.
        let soft = LampShape::Spot { inner_rad: 0.0, outer_rad: FRAC_PI_2 };
        near(native(soft, 100.0, Lumen), 100.0 * 3.0 / (2.0 * pi));
        // A diffuse face: Φ = π L A, I = L A.
        let rectangle = || LampShape::Rectangle { size_m: [2.0, 0.5] };
        near(native(rectangle(), 1000.0, Lumen), 1000.0 / pi);
        near(native(rectangle(), 1000.0, Candela), 1000.0);
        near(native(rectangle(), 1000.0, Nit), 1000.0);
        let disk = || LampShape::Disk { radius_m: 0.5 };
        near(native(disk(), 1000.0, Lumen), 1000.0 / (pi * pi * 0.25));
        near(native(disk(), 1000.0, Candela), 1000.0 / (pi * 0.25));
        // A sphere: Φ = π L 4 π r², I = L π r².
        let sphere = || LampShape::Sphere { radius_m: 0.5 };
        near(native(sphere(), 1000.0, Lumen), 1000.0 / (pi * pi));
        near(native(sphere(), 1000.0, Candela), 1000.0 / (pi * 0.25));
        near(native(LampShape::Directional { radius_rad: 0.0 }, 900.0, Lux), 900.0);
    }

    #[test]
    fn spots_send_their_lumen_however_narrow_they_are() {
        for [inner, outer] in [[0.0, 0.1], [0.0, 1.0], [1.0, 1.0], [1.0, 2.5], [3.0, 3.0], [0.0, 40.0], [30.0, 90.0f32]]
        {
            let [inner_rad, outer_rad] = [inner, outer].map(f32::to_radians);
            let light = PunctualLight {
                node: 0,
                kind: PunctualKind::Spot { inner_rad, outer_rad },
                position: Vec3::ZERO,
                direction: Vec3::NEG_Y,
                across: [Vec3::X, Vec3::NEG_Z],
                profile: None,
                color: Vec3::ONE,
                intensity: 1.0,
                radius_rad: 0.0,
            };
            let n = 20_000;
            let step = f64::from(outer_rad) / f64::from(n);
            let ring = |nth: u32| {
                let angle = step * (f64::from(nth) + 0.5);
                let toward = Vec3::new(angle.sin() as f32, -angle.cos() as f32, 0.0);
                f64::from(punctual_falloff(&light, &[], toward)) * 2.0 * PI * angle.sin() * step
            };
            let (flux, expected) = ((0..n).map(ring).sum::<f64>(), lumen_per_candela(light.kind, None));
            assert!((flux / expected - 1.0).abs() < 2e-3, "{inner}° to {outer}°: {flux} lm, not {expected}");
        }
    }

    #[test]
    fn a_spot_of_no_angle_shines_into_the_least_cone() {
        let spot = |outer_rad| LampShape::Spot { inner_rad: 0.0, outer_rad };
        let [none, least] = [0.0, LEAST_CONE_RAD].map(|outer_rad| native(spot(outer_rad), 10.0, LampUnit::Lumen));
        assert!(none == least && none.is_some_and(|candela| candela > 1e5 && candela < 1e7), "{none:?} {least:?}");
    }

    #[test]
    fn units_that_make_no_sense_are_refused() {
        use LampUnit::{Candela, Lumen, Lux, Nit};
        let spot = LampShape::Spot { inner_rad: 0.1, outer_rad: 0.2 };
        let refused = [
            (LampShape::Point, Nit),
            (LampShape::Point, Lux),
            (spot, Nit),
            (LampShape::Rectangle { size_m: [1.0; 2] }, Lux),
            (LampShape::Disk { radius_m: 1.0 }, Lux),
            (LampShape::Sphere { radius_m: 1.0 }, Lux),
            (LampShape::Directional { radius_rad: 0.0 }, Lumen),
            (LampShape::Directional { radius_rad: 0.0 }, Candela),
            (LampShape::Directional { radius_rad: 0.0 }, Nit),
        ];
        for (shape, unit) in refused {
            assert!(native(shape.clone(), 1.0, unit).is_none(), "{shape:?} in {unit:?}");
        }
    }

    #[test]
    fn a_body_without_size_keeps_its_flux() {
        let small = native(LampShape::Disk { radius_m: 0.0 }, 100.0, LampUnit::Lumen).expect("lumen");
        let lamp = lamp(LampShape::Disk { radius_m: 0.0 });
        let (body, _) = Body::of(&lamp).expect("a body");
        assert!((small * PI * f64::from(body.area()) - 100.0).abs() < 1e-2);
        assert_eq!(
            native(LampShape::Disk { radius_m: 0.0 }, 100.0, LampUnit::Nit),
            Some(0.0),
            "no area sends no light"
        );
    }
}
