use clerestory_transport::lamps::{LampUnit, PreparedLamps};
use clerestory_transport::light::LightSetting;
use clerestory_transport::scene::Material;
use eframe::egui::{self, pos2};

use super::*;
use crate::look::Look;
use crate::support::{prepared_room, scaled_room};

fn sight(scene: &PreparedScene) -> Sight<'_> {
    let image = Rect::from_min_size(pos2(100.0, 50.0), vec2(800.0, 600.0));
    Sight { scene, camera: &scene.scene.cameras[0], film: Film { width: 64, height: 48 }, image }
}

fn lamp(position: Vec3) -> FreeLamp {
    let shape = LampShape::Spot { inner_rad: 0.2, outer_rad: 0.4 };
    let (key, setting, unit) = ("l".to_owned(), LightSetting::default(), LampUnit::Candela);
    FreeLamp {
        key,
        shape,
        position,
        aim: position - Vec3::Y,
        strength: 1.0,
        unit,
        setting,
        turn_rad: 0.0,
        replaces: None,
    }
}

fn near(a: Vec3, b: Vec3) -> bool {
    a.distance(b) < 2e-3
}

/// Takes a part where one point is seen and carries it to where another is seen, in three steps.
fn drag(part: Part, of: &FreeLamp, [from, to]: [Vec3; 2], held: Held) -> FreeLamp {
    let scene = prepared_room();
    let sight = sight(&scene);
    let (from, to) = (sight.seen_at(from).unwrap(), sight.seen_at(to).unwrap());
    let mut drag = Drag::begin(&sight, of, part, from);
    let mut lamp = of.clone();
    for _ in 0..3 {
        lamp = drag.moved(&sight, &lamp, (to - from) / 3.0, held);
    }
    assert_eq!(drag.before, *of);
    lamp
}

#[test]
fn the_nearest_point_of_an_axis_and_the_meeting_with_a_plane_are_those_of_geometry() {
    let (eye, ahead) = (Vec3::new(3.0, 1.0, 5.0), Vec3::NEG_Z);
    assert_eq!(nearest_on_axis(Vec3::ZERO, Vec3::X, eye, ahead), Some(3.0));
    assert_eq!(nearest_on_axis(Vec3::new(1.0, 0.0, 0.0), Vec3::X, eye, ahead), Some(2.0));
    assert_eq!(nearest_on_axis(Vec3::ZERO, Vec3::Z, eye, ahead), None, "one looks along it");
    assert_eq!(nearest_on_axis(Vec3::new(0.0, 0.0, 9.0), Vec3::X, eye, ahead), None, "it is behind");
    assert_eq!(meet_plane(Vec3::ZERO, Vec3::Z, eye, ahead), Some(Vec3::new(3.0, 1.0, 0.0)));
    assert_eq!(meet_plane(Vec3::new(0.0, 0.0, 9.0), Vec3::Z, eye, ahead), None, "it is behind");
    assert_eq!(meet_plane(Vec3::ZERO, Vec3::X, eye, ahead), None, "the ray runs along it");
}

#[test]
fn what_is_seen_is_where_the_pointer_is() {
    let scene = prepared_room();
    let sight = sight(&scene);
    for point in [Vec3::new(0.3, -0.2, -0.9), Vec3::new(-0.4, 0.4, 0.0)] {
        let at = sight.seen_at(point).unwrap();
        assert!((point - sight.camera.position()).normalize().distance(sight.direction(at)) < 1e-4);
        let meters = sight.meters_per_point(point).unwrap();
        let right = sight.seen_at(point + Vec3::X * (10.0 * meters)).unwrap();
        assert!(
            (right.x - at.x - 10.0).abs() < 0.05,
            "ten points to the right are ten points wide: {}",
            right.x - at.x
        );
    }
    assert_eq!(sight.seen_at(Vec3::new(0.0, 0.0, 2.0)), None);
    assert_eq!(sight.meters_per_point(Vec3::new(0.0, 0.0, 2.0)), None);
    let floor = sight.surface(sight.seen_at(Vec3::new(0.1, -1.0, -0.3)).unwrap()).unwrap();
    assert!(near(floor.position, Vec3::new(0.1, -1.0, -0.3)) && near(floor.normal, Vec3::Y), "{floor:?}");
}

#[test]
fn an_arrow_moves_along_its_axis_by_what_the_pointer_moves_on_it() {
    let of = lamp(Vec3::new(0.1, 0.2, -0.4));
    for (axis, along) in AXES.into_iter().enumerate() {
        // Taken at the tip of the arrow, away from the lamp: it does not jump there.
        let tip = of.position + along * 0.2;
        let moved = drag(Part::Axis(axis), &of, [tip, tip + along * 0.15], Held::default());
        assert!(near(moved.position, of.position + along * 0.15), "{}", moved.position);
        let aside = moved.position - of.position;
        assert!((aside - along * aside.dot(along)).length() < 1e-6, "not off the axis: {aside}");
        assert!(near(moved.aim - moved.position, of.aim - of.position), "it keeps its direction");
    }
}

#[test]
fn an_arrow_that_is_dragged_beyond_where_its_axis_vanishes_leaves_the_lamp_before_the_camera() {
    let of = lamp(Vec3::new(0.3, 0.0, -0.4));
    // Into the depth, then over the middle of the view, where all that leads there vanishes.
    let moved = drag(Part::Axis(2), &of, [of.position, Vec3::new(-0.3, 0.0, -0.4)], Held::default());
    assert!(moved.position.z < of.position.z, "{}", moved.position);
}

#[test]
fn a_square_moves_across_its_axis() {
    let of = lamp(Vec3::new(0.1, -0.3, -0.4));
    for (axis, way) in [(0, Vec3::new(0.0, 0.1, 0.1)), (1, Vec3::new(0.1, 0.0, -0.2)), (2, Vec3::new(-0.2, 0.1, 0.0))] {
        let at = of.position + Vec3::splat(0.05) * (Vec3::ONE - AXES[axis]);
        let moved = drag(Part::Plane(axis), &of, [at, at + way], Held::default());
        assert!(near(moved.position, of.position + way), "{axis}: {}", moved.position);
    }
}

#[test]
fn a_lamp_that_is_seen_from_many_diameters_away_moves_as_from_close_by() {
    let scene = prepared_room();
    let camera = Camera::look_at("far", Vec3::new(0.0, 0.0, 60.0), Vec3::ZERO, 0.05, 4.0 / 3.0);
    let sight = Sight { camera: &camera, ..sight(&scene) };
    let of = lamp(Vec3::new(0.1, 0.2, -0.4));
    let to = of.position + Vec3::X * 0.3;
    let (from, at) = (sight.seen_at(of.position).unwrap(), sight.seen_at(to).unwrap());
    for part in [Part::Axis(0), Part::Plane(2)] {
        let mut drag = Drag::begin(&sight, &of, part, from);
        let moved = drag.moved(&sight, &of, at - from, Held::default());
        assert!(near(moved.position, to), "{part:?}: {}", moved.position);
    }
}

#[test]
fn with_shift_it_goes_a_tenth_of_the_way() {
    let of = lamp(Vec3::new(0.0, 0.0, -0.4));
    let ways = [of.position, of.position + Vec3::X * 0.4];
    let moved = drag(Part::Axis(0), &of, ways, Held { fine: true, ..Held::default() });
    assert!(near(moved.position, of.position + Vec3::X * 0.04), "{}", moved.position);
}

#[test]
fn the_lamp_itself_goes_over_surfaces_and_with_alt_in_the_plane_of_the_screen() {
    let of = lamp(Vec3::new(0.0, 0.0, -0.4));
    let floor = Vec3::new(0.3, -1.0, -0.2);
    let moved = drag(Part::Body, &of, [of.position, floor], Held::default());
    let off = moved.position - floor;
    assert!(off.y > 0.01 && off.y < 0.31 && off.x.abs() < 2e-3 && off.z.abs() < 2e-3, "{off}");

    let to = Vec3::new(0.2, 0.1, -0.4);
    let free = Held { free: true, ..Held::default() };
    let moved = drag(Part::Body, &of, [of.position, to], free);
    assert!(near(moved.position, to), "{}", moved.position);

    // A lamp that is close to a wall keeps its distance, so that it does not jump.
    let close = lamp(Vec3::new(0.0, -0.97, -0.4));
    let moved = drag(Part::Body, &close, [close.position, floor], Held::default());
    assert!((moved.position.y + 0.97).abs() < 2e-3, "{}", moved.position);
}

#[test]
fn the_aim_goes_over_surfaces_and_stays_where_it_is_asked_to() {
    let of = lamp(Vec3::new(0.0, 0.5, -0.4));
    let wall = Vec3::new(0.2, 0.1, -1.0);
    let aimed = drag(Part::Aim, &of, [of.aim, wall], Held::default());
    assert!(near(aimed.aim, wall) && aimed.position == of.position, "{}", aimed.aim);
    let held = Held { aim: AimWhileMoving::Stays, ..Held::default() };
    let moved = drag(Part::Axis(0), &aimed, [aimed.position, aimed.position + Vec3::X * 0.1], held);
    assert_eq!(moved.aim, aimed.aim);
}

#[test]
fn a_rectangle_whose_aim_is_dragged_around_straight_below_lights_the_floor_without_a_jump() {
    let scene = prepared_room();
    let sight = sight(&scene);
    let place = Vec3::new(0.0, 0.2, -0.4);
    let shape = LampShape::Rectangle { size_m: [0.8, 0.05] };
    let mut of = FreeLamp { shape, unit: LampUnit::Nit, ..lamp(place) };
    let around = |step: usize| {
        let (sin, cos) = (step as f32 / 60.0 * std::f32::consts::TAU).sin_cos();
        Vec3::new(place.x + 0.05 * cos, -1.0, place.z + 0.05 * sin)
    };
    of.aim = around(0);
    let lux = |of: &FreeLamp| {
        let lamps = PreparedLamps::new(std::slice::from_ref(of), None).unwrap().0;
        let places = [Vec3::new(0.5, -1.0, -0.4), Vec3::new(0.0, -1.0, 0.1), Vec3::new(0.4, -1.0, 0.0)];
        places.map(|place| lamps.irradiance(&scene, place, Vec3::Y, None).y)
    };
    let mut drag = Drag::begin(&sight, &of, Part::Aim, sight.seen_at(of.aim).unwrap());
    for step in 0..60 {
        let (before, travel) =
            (lux(&of), sight.seen_at(around(step + 1)).unwrap() - sight.seen_at(around(step)).unwrap());
        of = drag.moved(&sight, &of, travel, Held::default());
        assert!(near(of.aim, around(step + 1)), "{}", of.aim);
        for (now, before) in lux(&of).into_iter().zip(before) {
            assert!((now / before - 1.0).abs() < 0.02, "from {before} to {now} lx in step {step}");
        }
    }
}

#[test]
fn where_one_looks_along_an_axis_or_beyond_the_horizon_the_lamp_stays() {
    let scene = prepared_room();
    let sight = sight(&scene);
    // In the middle of the view one looks along Z.
    let of = lamp(Vec3::new(0.0, 0.0, -0.4));
    let center = sight.seen_at(of.position).unwrap();
    let mut along = Drag::begin(&sight, &of, Part::Axis(2), center);
    assert_eq!(along.moved(&sight, &of, vec2(0.5, 0.5), Held::default()), of);
    // Below the eye, level: upwards the plane ends at the horizon.
    let low = lamp(Vec3::new(0.0, -0.5, -0.4));
    let mut level = Drag::begin(&sight, &low, Part::Plane(1), sight.seen_at(low.position).unwrap());
    let moved = level.moved(&sight, &low, egui::vec2(0.0, -2000.0), Held::default());
    assert_eq!(moved, low);
}

#[test]
fn a_lamp_goes_no_farther_than_a_look_holds_and_keeps_its_direction() {
    let far = Vec3::new(0.0, 3e6, 0.0);
    let bulb = FreeLamp { shape: LampShape::Point, ..lamp(Vec3::ZERO) };
    for aim in [AimWhileMoving::GoesAlong, AimWhileMoving::Stays] {
        for mut of in [lamp(Vec3::ZERO), bulb.clone(), FreeLamp { aim: 5.0 * Vec3::Y, ..lamp(Vec3::ZERO) }] {
            let before = of.aim - of.position;
            move_to(&mut of, far, aim);
            let mut look = Look::default();
            look.lights.lamps = vec![of.clone()];
            assert!(of.position.y > 9e5 && Look::from_json(&look.to_json()).is_ok(), "{of:?}");
            let is_kept = near(of.aim - of.position, before);
            assert!(is_kept || aim == AimWhileMoving::Stays, "{of:?}");
        }
    }
    let mut of = lamp(Vec3::ZERO);
    aim_at(&mut of, far);
    assert_eq!((of.position, of.aim), (Vec3::ZERO, FARTHEST_M * Vec3::Y));
}

#[test]
fn a_lamp_is_put_before_a_surface_and_shines_away_from_it() {
    let scene = prepared_room();
    let surface = Surface { position: Vec3::Y, normal: Vec3::NEG_Y };
    let put = put_on(lamp(Vec3::ZERO), surface, Vec3::new(0.0, 0.0, 3.0), &scene);
    assert!(put.position.y < 1.0 && put.position.y > 0.6 && put.aim.y < put.position.y, "{put:?}");
    let globe = FreeLamp { shape: LampShape::Sphere { radius_m: 0.5 }, ..lamp(Vec3::ZERO) };
    let put = put_on(globe, surface, Vec3::new(0.0, 0.0, 3.0), &scene);
    assert!(put.position.y < 0.5, "all of it is in front of the surface: {}", put.position);
    assert_eq!(put.aim, below(put.position));
}

#[test]
fn in_a_model_of_centimeters_aims_lie_within_it() {
    let model = PreparedScene::new(scaled_room(0.01), &[]).unwrap().0;
    let surface = Surface { position: Vec3::Y * 0.01, normal: Vec3::NEG_Y };
    let put = put_on(lamp(Vec3::ZERO), surface, Vec3::ZERO, &model);
    assert!(put.aim.y < put.position.y && put.aim.length() < 0.01, "{put:?}");
    let of_file = lamp(Vec3::Y * 0.005);
    let before = of_file.aim - of_file.position;
    let within = aimed_within(of_file.clone(), &model);
    let way = within.aim - within.position;
    assert!(way.length() < 0.02 && near(way.normalize(), before.normalize()), "{within:?}");
    assert_eq!(aimed_within(of_file.clone(), &prepared_room()).aim, of_file.aim, "in a room it stays");
}

#[test]
fn who_aims_through_a_pane_lights_what_is_behind_it() {
    let mut scene = prepared_room().scene;
    let first = scene.mesh.positions.len() as u32;
    scene
        .mesh
        .positions
        .extend([[-0.9, -0.9], [0.9, -0.9], [0.9, 0.9], [-0.9, 0.9]].map(|[x, y]| Vec3::new(x, y, 0.1)));
    scene.mesh.normals.extend([Vec3::Z; 4]);
    scene.mesh.triangles.extend([[0, 1, 2], [0, 2, 3]].map(|corners| corners.map(|corner: u32| first + corner)));
    scene.mesh.triangle_material.extend([scene.materials.len() as u32; 2]);
    scene.mesh.triangle_node.extend([0; 2]);
    let (metallic, roughness, transmission) = (0.0, 0.0, 1.0);
    scene.materials.push(Material { metallic, roughness, transmission, double_sided: true, ..Material::default() });
    let scene = PreparedScene::new(scene, &[]).unwrap().0;
    let sight = sight(&scene);
    let (of, wall) = (lamp(Vec3::new(0.0, 0.5, -0.4)), Vec3::new(0.2, 0.1, -1.0));
    let aim_px = sight.seen_at(of.aim).unwrap();
    let mut drag = Drag::begin(&sight, &of, Part::Aim, aim_px);
    let aimed = drag.moved(&sight, &of, sight.seen_at(wall).unwrap() - aim_px, Held::default());
    assert!(near(aimed.aim, wall), "{}", aimed.aim);
    assert!(surface_along(&scene, sight.camera.position(), Vec3::NEG_Z).unwrap().position.z > 0.0, "the pane is there");
}
