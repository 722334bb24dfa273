//! Where a lamp that is added hangs, how large and how strong it is: so that it lights the room as somebody expects who clicked
//! there. Lengths are those of a room; what is seen from closer or from farther away than that is a model of one, or a landscape.

use std::f32::consts::PI;

use clerestory_transport::camera::Camera;
use clerestory_transport::lamps::{FreeLamp, LampShape, LampUnit};
use clerestory_transport::prepared::PreparedScene;
use glam::Vec3;

use super::gizmo::{AimWhileMoving, Surface, free_m, move_to, put_on, scale_of, surface_along, surface_behind_glass};
use crate::look::lamps::MOST_STRENGTH;

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
/// How far a copy stands beside the lamp, of its distance to the camera; how many stand in a row, and how often they may stand half as
/// far from each other.
const BESIDE: f32 = 0.06;
const IN_A_ROW: u32 = 8;
const CLOSER: i32 = 8;
/// Steps of fluxes and of sizes within a power of ten.
const STEPS: [f32; 7] = [1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0];

/// A shape of a size that suits what is seen from `distance_m`.
pub fn sized(shape: LampShape, distance_m: f32) -> LampShape {
    let scale = scale_of(distance_m);
    let scaled = |size: f32| if scale == 1.0 { size } else { round(scale * size) };
    match shape {
        LampShape::Rectangle { size_m } => LampShape::Rectangle { size_m: size_m.map(scaled) },
        LampShape::Disk { radius_m } => LampShape::Disk { radius_m: scaled(radius_m) },
        LampShape::Sphere { radius_m } => LampShape::Sphere { radius_m: scaled(radius_m) },
        other => other,
    }
}

/// A lamp where a surface was clicked on. On a ceiling it hangs and shines down. What shines to one side lights any other place:
/// from above a floor or a table, from before and above a wall, as a picture is lit.
pub fn placed(mut lamp: FreeLamp, surface: Surface, eye: Vec3, scene: &PreparedScene) -> FreeLamp {
    if !lamp.shape.is_aimed() || surface.normal.y < -CEILING {
        return put_on(lamp, surface, eye, scene);
    }
    let away = (surface.normal + Vec3::Y).normalize_or(surface.normal);
    let hangs_m = HANGS_M * scale_of(surface.position.distance(eye));
    lamp.position = surface.position + away * (OF_ROOM * free_m(scene, &surface, away, hangs_m / OF_ROOM));
    lamp.aim = surface.position;
    lamp
}

/// How strong a lamp that is placed where one sees from `distance_m` is to be so that what it lights reads well in a picture of
/// some exposure, EV: in round numbers of its usual unit.
pub fn fitting_strength(lamp: &FreeLamp, exposure_ev: f32, scene: &PreparedScene, distance_m: f32) -> (f32, LampUnit) {
    let lux = BRIGHT * PI / REFLECTANCE * (-exposure_ev).exp2();
    if lamp.shape.is_parallel() {
        return (round(lux), LampUnit::Lux);
    }
    let (ahead, scale) = (lamp.frame()[2], scale_of(distance_m));
    let lit = surface_behind_glass(scene, lamp.position, ahead).filter(|_| lamp.shape.is_aimed());
    let [near, far] = LIT_M.map(|lit_m| scale * lit_m);
    let lit_m = lit.map_or(scale * AROUND_M, |lit| lit.position.distance(lamp.position).clamp(near, far));
    let lumen = FreeLamp { strength: 1.0, unit: LampUnit::Lumen, ..lamp.clone() };
    let candela_per_lumen = lumen.strength_in(LampUnit::Candela).unwrap_or(1.0 / (4.0 * PI));
    let [least, most] = LUMEN.map(|lumen| scale * scale * lumen);
    (round((lux * lit_m * lit_m / candela_per_lumen).clamp(least, most)).min(MOST_STRENGTH), LampUnit::Lumen)
}

/// A lamp beside the one that it is a copy of, as a camera sees it, where none of the `others` stands: to the right if there is room,
/// else to the left, above or below, at most half way to the next surface and no farther than a look holds. Where all that is taken
/// already it stays.
pub fn beside(lamp: &FreeLamp, others: &[FreeLamp], camera: &Camera, scene: &PreparedScene) -> FreeLamp {
    let [right, up] = [camera.world_from_camera.x_axis, camera.world_from_camera.y_axis].map(|axis| axis.truncate());
    let sides = [right, -right, up, -up].map(|side| {
        let next = surface_along(scene, lamp.position, side);
        (side, next.map_or(f32::INFINITY, |next| 0.5 * next.position.distance(lamp.position)))
    });
    let usual_m = BESIDE * lamp.position.distance(camera.position());
    let copy = |place: Vec3, step_m: f32| {
        let mut copy = lamp.clone();
        move_to(&mut copy, place, AimWhileMoving::GoesAlong);
        let is_apart = |other: &FreeLamp| other.position.distance(place) > 0.5 * step_m;
        Some(copy).filter(|copy| copy.position == place && others.iter().chain([lamp]).all(is_apart))
    };
    // Where there is little room, or many copies, they stand closer.
    for step_m in (0..CLOSER).map(|closer| usual_m * 0.5f32.powi(closer)) {
        for (side, room_m) in sides {
            let away_m = (1..=IN_A_ROW).map(|nth| nth as f32 * step_m).take_while(|away_m| *away_m <= room_m);
            let mut copies = away_m.filter_map(|away_m| copy(lamp.position + side * away_m, step_m));
            if let Some(copy) = copies.next() {
                return copy;
            }
        }
    }
    lamp.clone()
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
    use clerestory_transport::light::LightSetting;

    use super::*;
    use crate::look::lamps::FARTHEST_M;
    use crate::support::{prepared_room, scaled_room};

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
        let scene = prepared_room();
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
        let scene = prepared_room();
        let below = surface_along(&scene, Vec3::new(0.2, 0.0, 0.1), Vec3::NEG_Y).unwrap();
        let hung = placed(spot(), below, Vec3::ZERO, &scene);
        let (strength, unit) = fitting_strength(&hung, -6.0, &scene, 2.0);
        let lit = FreeLamp { strength, unit, ..hung.clone() };
        let lux = lit.strength_in(LampUnit::Candela).unwrap() / hung.position.distance(hung.aim).powi(2);
        // ½ · 64 nit of a surface that sends back half.
        let wanted = 32.0 * PI / 0.5;
        assert!(lux > wanted / 1.3 && lux < wanted * 1.3, "{lux} lx for {wanted}");
        assert!(fitting_strength(&hung, -9.0, &scene, 2.0).0 > 4.0 * strength);
        assert_eq!([1234.0, 87.0, 9.6].map(round), [1500.0, 100.0, 10.0]);
    }

    #[test]
    fn in_a_model_of_a_room_lamps_are_placed_as_in_the_room() {
        let model = PreparedScene::new(scaled_room(0.01), &[]).unwrap().0;
        let globe = FreeLamp { shape: LampShape::Sphere { radius_m: 0.1 }, ..spot() };
        let shine = |scene: &PreparedScene, lamp: &FreeLamp, scale: f32, direction: Vec3| {
            let surface = surface_along(scene, Vec3::new(0.2, 0.0, 0.1) * scale, direction).unwrap();
            let distance_m = surface.position.length();
            let lamp = FreeLamp { shape: sized(lamp.shape.clone(), distance_m), ..lamp.clone() };
            let lamp = placed(lamp, surface, Vec3::ZERO, scene);
            let (strength, unit) = fitting_strength(&lamp, -6.0, scene, distance_m);
            FreeLamp { strength, unit, ..lamp }
        };
        for direction in [Vec3::Y, Vec3::NEG_Y, Vec3::NEG_Z] {
            for lamp in [spot(), globe.clone()] {
                let small = shine(&model, &lamp, 0.01, direction);
                let room = shine(&prepared_room(), &lamp, 1.0, direction);
                let what = format!("{small:?} in a model of {room:?}");
                assert!(small.position.abs().max_element() < 0.01, "{what}");
                assert!((small.position * 100.0).distance(room.position) < 0.1, "{what}");
                let ratio = room.strength / small.strength;
                assert!((5e3..2e4).contains(&ratio), "{what}: {ratio}");
                if let LampShape::Sphere { radius_m } = small.shape {
                    assert!((radius_m - 1e-3).abs() < 1e-6, "{what}");
                }
            }
        }
        assert_eq!(
            sized(LampShape::Rectangle { size_m: [0.6, 0.6] }, 3.0),
            LampShape::Rectangle { size_m: [0.6, 0.6] }
        );
        assert_eq!(sized(LampShape::Disk { radius_m: 0.15 }, 1000.0), LampShape::Disk { radius_m: 15.0 });
    }

    #[test]
    fn a_lamp_comes_no_nearer_to_the_next_surface_than_to_its_own() {
        let scene = prepared_room();
        // A nook of 4 cm under the ceiling, seen from the middle of the room.
        let ceiling = surface_along(&scene, Vec3::new(0.2, 0.96, 0.1), Vec3::Y).unwrap();
        let mut shelf = scene.scene.clone();
        let first = shelf.mesh.positions.len() as u32;
        shelf
            .mesh
            .positions
            .extend([[-0.5, -0.5], [0.5, 0.5], [0.5, -0.5], [-0.5, 0.5]].map(|[x, z]| Vec3::new(x, 0.96, z)));
        shelf.mesh.normals.extend([Vec3::Y; 4]);
        shelf.mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 3, first + 1]]);
        shelf.mesh.triangle_material.extend([0; 2]);
        shelf.mesh.triangle_node.extend([0; 2]);
        let shelf = PreparedScene::new(shelf, &[]).unwrap().0;
        let bulb = || FreeLamp { shape: LampShape::Point, ..spot() };
        assert!(placed(bulb(), ceiling, Vec3::ZERO, &scene).position.y < 0.97);
        let within = placed(bulb(), ceiling, Vec3::ZERO, &shelf).position.y;
        assert!((within - 0.98).abs() < 1e-3, "{within}");
    }

    #[test]
    fn a_copy_stands_beside_its_lamp_and_within_the_room() {
        let scene = prepared_room();
        let camera = &scene.scene.cameras[0];
        let copied = |position: Vec3| beside(&FreeLamp { position, ..spot() }, &[], camera, &scene).position - position;
        let middle = copied(Vec3::new(0.0, 0.2, -0.9));
        assert!(middle.x > 0.1 && middle.y.abs() < 1e-4, "to the right: {middle}");
        let by_the_wall = copied(Vec3::new(0.95, 0.2, -0.9));
        assert!(by_the_wall.x < -0.1, "to the left: {by_the_wall}");
    }

    #[test]
    fn many_copies_of_a_lamp_stand_apart_and_one_at_the_limit_of_places_has_its_copy_beside_it() {
        let scene = prepared_room();
        let camera = &scene.scene.cameras[0];
        let lamp = FreeLamp { position: Vec3::new(0.0, 0.2, -0.9), ..spot() };
        let mut copies = Vec::new();
        for _ in 0..40 {
            copies.push(beside(&lamp, &copies, camera, &scene));
        }
        for (nth, copy) in copies.iter().enumerate() {
            let others = copies[..nth].iter().chain([&lamp]);
            let nearest = others.map(|other| other.position.distance(copy.position)).fold(f32::INFINITY, f32::min);
            assert!(nearest > 1e-3 && copy.position.abs().max_element() < 1.0, "{nearest} m: {}", copy.position);
        }
        let far = FreeLamp { position: Vec3::new(FARTHEST_M, 0.2, -0.9), ..spot() };
        let copy = beside(&far, &[], camera, &scene);
        assert!(copy.position.x < 0.99 * FARTHEST_M && copy.position.x > 0.5 * FARTHEST_M, "{}", copy.position);
    }
}
