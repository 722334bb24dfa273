//! Where a lamp that is added hangs, and how strong it is: so that it lights the room as somebody expects who clicked there.

use std::f32::consts::PI;

use clerestory_transport::lamps::{FreeLamp, LampShape, LampUnit};
use clerestory_transport::prepared::PreparedScene;
use glam::Vec3;

use super::gizmo::{Surface, put_on, surface_along};

/// Downward part of a normal from which on a surface is a ceiling.
const CEILING: f32 = 0.7;
/// How far from the place that it lights a lamp hangs, m, and what share of the way to the next surface that takes at most.
const HANGS_M: f32 = 2.0;
const OF_ROOM: f32 = 0.85;
/// Distances for which a lamp is made strong enough, m.
const LIT_M: [f32; 2] = [0.5, 3.0];
/// Distance at which a lamp that shines all around, or into nothing, is to light things well, m.
const AROUND_M: f32 = 1.0;
/// Luminance of a surface of reflectance ½ that a new lamp lights, over what the picture shows as 1.
const BRIGHT: f32 = 0.5;
const REFLECTANCE: f32 = 0.5;
/// Fluxes that a new lamp may have, lumen.
const LUMEN: [f32; 2] = [50.0, 20_000.0];
/// Steps of fluxes within a power of ten.
const STEPS: [f32; 7] = [1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0];

/// A lamp where a surface was clicked on. On a ceiling it hangs and shines down. What shines to one side lights any other place:
/// from above a floor or a table, from before and above a wall, as a picture is lit.
pub fn placed(mut lamp: FreeLamp, surface: Surface, eye: Vec3, scene: &PreparedScene) -> FreeLamp {
    if !lamp.shape.is_aimed() || surface.normal.y < -CEILING {
        return put_on(lamp, surface, eye);
    }
    let away = (surface.normal + Vec3::Y).normalize_or(surface.normal);
    let next = surface_along(scene, surface.position + surface.normal * 0.01, away);
    let room = next.map_or(f32::INFINITY, |next| next.position.distance(surface.position));
    lamp.position = surface.position + away * HANGS_M.min(OF_ROOM * room);
    lamp.aim = surface.position;
    lamp
}

/// How strong a placed lamp is to be so that what it lights reads well in a picture of some exposure, EV: in round numbers of
/// its usual unit.
pub fn fitting_strength(lamp: &FreeLamp, exposure_ev: f32, scene: &PreparedScene) -> (f32, LampUnit) {
    let lux = BRIGHT * PI / REFLECTANCE * (-exposure_ev).exp2();
    if lamp.shape == LampShape::Directional {
        return (round(lux), LampUnit::Lux);
    }
    let ahead = lamp.frame()[2];
    let lit = surface_along(scene, lamp.position, ahead).filter(|_| lamp.shape.is_aimed());
    let distance_m = lit.map_or(AROUND_M, |lit| lit.position.distance(lamp.position).clamp(LIT_M[0], LIT_M[1]));
    let lumen = FreeLamp { strength: 1.0, unit: LampUnit::Lumen, ..lamp.clone() };
    let candela_per_lumen = lumen.strength_in(LampUnit::Candela).unwrap_or(1.0 / (4.0 * PI));
    (round((lux * distance_m * distance_m / candela_per_lumen).clamp(LUMEN[0], LUMEN[1])), LampUnit::Lumen)
}

/// The nearest step.
fn round(value: f32) -> f32 {
    let power = 10f32.powf(value.max(1e-6).log10().floor());
    let far = |step: &f32| (step * power / value).ln().abs();
    let nearest = STEPS.iter().copied().min_by(|a, b| far(a).total_cmp(&far(b)));
    nearest.map_or(value, |step| step * power)
}

#[cfg(test)]
mod tests {
    use clerestory_transport::import;
    use clerestory_transport::light::LightSetting;

    use super::*;

    fn scene() -> PreparedScene {
        let room = include_str!("../../tests/room.gltf");
        PreparedScene::new(import::load_bytes("room", room.as_bytes()).unwrap().scene, &[]).unwrap().0
    }

    fn spot() -> FreeLamp {
        let (shape, setting) = (LampShape::Spot { inner_rad: 0.35, outer_rad: 0.6 }, LightSetting::default());
        let (strength, unit) = (1.0, LampUnit::Lumen);
        FreeLamp {
            key: "spot".into(),
            shape,
            position: Vec3::ZERO,
            aim: Vec3::ZERO,
            strength,
            unit,
            setting,
            turn_rad: 0.0,
            replaces: None,
        }
    }

    #[test]
    fn a_spot_lights_the_place_that_was_clicked_and_on_the_ceiling_it_shines_down() {
        let scene = scene();
        let below = surface_along(&scene, Vec3::new(0.2, 0.0, 0.1), Vec3::NEG_Y).unwrap();
        let above = surface_along(&scene, Vec3::new(0.2, 0.0, 0.1), Vec3::Y).unwrap();
        let hung = placed(spot(), below, Vec3::ZERO, &scene);
        assert!(hung.position.y > below.position.y && hung.position.y < above.position.y, "{hung:?}");
        assert_eq!((hung.aim, hung.frame()[2]), (below.position, Vec3::NEG_Y));
        assert!(placed(spot(), above, Vec3::ZERO, &scene).frame()[2].y < -0.99);
        let wall = surface_along(&scene, Vec3::new(0.2, 0.0, 0.1), Vec3::NEG_Z).unwrap();
        let before = placed(spot(), wall, Vec3::ZERO, &scene);
        let way = (before.position - wall.position).normalize();
        assert!(way.z > 0.5 && way.y > 0.5 && before.aim == wall.position, "from before and above: {before:?}");
        let bulb = FreeLamp { shape: LampShape::Point, ..spot() };
        assert!(placed(bulb, below, Vec3::ZERO, &scene).position.y < hung.position.y, "a bulb stands where it was put");
    }

    #[test]
    fn a_lamp_is_as_strong_as_the_picture_asks() {
        let scene = scene();
        let below = surface_along(&scene, Vec3::new(0.2, 0.0, 0.1), Vec3::NEG_Y).unwrap();
        let hung = placed(spot(), below, Vec3::ZERO, &scene);
        let (strength, unit) = fitting_strength(&hung, -6.0, &scene);
        let lit = FreeLamp { strength, unit, ..hung.clone() };
        let lux = lit.strength_in(LampUnit::Candela).unwrap() / hung.position.distance(hung.aim).powi(2);
        // ½ · 64 nit of a surface that sends back half.
        let wanted = 32.0 * PI / 0.5;
        assert!(lux > wanted / 1.3 && lux < wanted * 1.3, "{lux} lx for {wanted}");
        assert!(fitting_strength(&hung, -9.0, &scene).0 > 4.0 * strength);
        assert_eq!([1234.0, 87.0, 9.6].map(round), [1500.0, 100.0, 10.0]);
    }
}
