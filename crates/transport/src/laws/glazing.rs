//! Light through several solid panes: beside each other, at an angle, in a row, far from the origin and as files round them.

use std::f32::consts::{FRAC_PI_4, FRAC_PI_6};
use std::f64::consts::{FRAC_1_SQRT_2, PI};

use glam::{Quat, Vec3};

use super::slabs::{ALBEDO, HEIGHT, IOR, block, floor, glass, passed, seen};
use super::stage::{Stage, lambert, quad};
use super::walks::{Even, Mean, Walks, assert_same_mean, file_light};
use crate::camera::Film;
use crate::plan::{Density, MatrixPlan};
use crate::prepared::PreparedScene;
use crate::sampler::Sampler;
use crate::scene::{PunctualKind, Scene};
use crate::slabs::{Slabs, hidden};

/// Turns of walls about the vertical.
const TURNS: [f32; 3] = [FRAC_PI_6, FRAC_PI_4, 3.0 * FRAC_PI_4];

/// A floor before a wall at a distance of 1 m that is turned, with panes in it from some places to others along it.
fn wall(turn: Quat, panes: &[[f32; 2]]) -> Stage {
    panes.iter().fold(floor(lambert(ALBEDO, 0.0)), |stage, &[lo, hi]| {
        let center = Vec3::new(0.5 * (lo + hi), 1.0, -1.0);
        let corners = block(turn * center, Vec3::new(0.5 * (hi - lo), 1.0, 0.006), turn);
        stage.surface("pane", &corners, glass())
    })
}

/// A light behind the wall.
type Light = fn(Stage, Vec3) -> Scene;

const LIGHTS: [(&str, Light); 4] = [
    ("a point", |stage, at| stage.lamp("lamp", at, 7.0).into_scene()),
    ("a spot", |stage, at| {
        let mut scene = stage.lamp("lamp", at, 7.0).into_scene();
        scene.punctual[0].kind = PunctualKind::Spot { inner_rad: 0.1, outer_rad: 0.4 };
        scene.punctual[0].direction = -at.normalize();
        scene
    }),
    ("a sun", |stage, at| stage.distant("sun", -at, 9.0).into_scene()),
    ("a sun with a size", |stage, at| {
        let mut scene = stage.distant("sun", -at, 9.0).into_scene();
        scene.set_sun_radius(0.005);
        scene
    }),
];

fn ready(scene: Scene) -> PreparedScene {
    PreparedScene::new(scene, &[]).expect("a stage has valid lights").0
}

#[test]
fn two_panes_beside_each_other_pass_what_one_of_double_width_passes() {
    // Each turn with each light, at one half of the places or the other.
    let half = |nth: usize| [[-1.4, 0.8], [-0.6, 2.3]][nth % 2];
    let ways = TURNS.iter().enumerate();
    let ways = ways.flat_map(|(i, angle)| LIGHTS.iter().enumerate().map(move |(j, light)| (*angle, light, i + j)));
    for (angle, &(what, light), nth) in ways {
        let turn = Quat::from_rotation_y(angle);
        for x in half(nth) {
            let at = turn * Vec3::new(x, HEIGHT, -2.5);
            let of = |panes: &[[f32; 2]]| {
                let scene = ready(light(wall(turn, panes), at));
                assert_eq!(scene.slabs.len(), panes.len());
                seen(&scene, Some(2))
            };
            let (one, two) = (of(&[[-1.0, 1.0]]), of(&[[-1.0, 0.0], [0.0, 1.0]]));
            let what = format!("{what} at {x} behind a wall turned by {angle}");
            assert!(one.value > 0.0 && one.error < 0.05 * one.value, "{what}: {one:?}");
            let allowed = 4.0 * one.error.hypot(two.error) + 1e-4 * one.value;
            assert!((one.value - two.value).abs() < allowed, "{what}: {two:?} for {one:?}");
        }
    }
}

#[test]
fn a_pane_beside_the_way_takes_nothing() {
    // A door ajar: the way crosses its box along the axes, and its plane, but not the door.
    let door = block(Vec3::new(0.7, 1.0, -1.75), Vec3::new(0.5, 1.0, 0.006), Quat::from_rotation_y(FRAC_PI_4));
    for (what, light) in LIGHTS {
        let bare = || wall(Quat::IDENTITY, &[[-1.0, 1.0]]);
        let of = |stage: Stage| ready(light(stage, Vec3::new(0.5, HEIGHT, -2.5)));
        let scene = of(bare().surface("door", &door, glass()));
        assert_eq!(scene.slabs.len(), 2);
        let (with, without) = (seen(&scene, Some(2)), seen(&of(bare()), Some(2)));
        let allowed = 4.0 * without.error.hypot(with.error) + 1e-4 * without.value;
        assert!(without.value > 0.0, "{what}: {without:?}");
        assert!((without.value - with.value).abs() < allowed, "{what}: {with:?} for {without:?}");
    }
}

#[test]
fn a_way_is_bent_into_a_pane_that_it_misses_straight_on() {
    let pane = block(Vec3::new(3.0, 1.8, 0.0), Vec3::new(3.0, 0.1, 3.0), Quat::IDENTITY);
    let slabs = floor(lambert(ALBEDO, 0.0)).surface("pane", &pane, glass()).prepared().slabs;
    // At 73° outside of the glass and 40° in it, which is entered 5.51 m further on, while the straight way comes to its middle
    // after 5.40 m.
    let route = |x: f32| slabs.route(Vec3::X * x, Vec3::new(x + 6.0, 2.0, 0.0));
    assert!(route(-5.3).is_some());
    assert!(route(-5.47).is_some_and(|route| (route.direction.x / route.direction.y - 3.242).abs() < 1e-2));
    assert!(route(-5.55).is_none());
}

/// Two slabs of a thickness at a right angle, which a way up and to the right meets at 45° one after the other.
const THICKNESS: f32 = 0.1;

fn corner(stage: Stage) -> Stage {
    let level = block(Vec3::new(0.2, 0.6, 0.0), Vec3::new(0.6, 0.5 * THICKNESS, 1.0), Quat::IDENTITY);
    let upright = block(Vec3::new(1.0, 1.4, 0.0), Vec3::new(0.5 * THICKNESS, 0.7, 1.0), Quat::IDENTITY);
    stage.surface("level", &level, glass()).surface("upright", &upright, glass())
}

#[test]
fn a_lamp_behind_panes_at_a_right_angle_sends_what_passes_both() {
    const TO: f64 = 1.6;
    let lamp = Vec3::new(TO as f32, TO as f32, 0.0);
    let scene = corner(floor(lambert(ALBEDO, 0.0))).lamp("lamp", lamp, 7.0).prepared();
    assert_eq!(scene.slabs.len(), 2);
    // Both shift the way alike, so that it goes straight to the lamp in the end: 45° outside of the glass.
    let thickness = f64::from(THICKNESS);
    let cos_within = (1.0 - 0.5 / (IOR * IOR)).sqrt();
    let tan_within = FRAC_1_SQRT_2 / IOR / cos_within;
    let air = (TO - thickness * (1.0 + tan_within)) / FRAC_1_SQRT_2;
    let across = air + 2.0 * thickness / (IOR * cos_within);
    let along = air + thickness / (IOR * cos_within.powi(3));
    let expected = 7.0 * passed(0.25 * PI).powi(2) / (across * along) * FRAC_1_SQRT_2 * f64::from(ALBEDO) / PI;
    seen(&scene, Some(4)).assert_is(expected, 1e-4, "two slabs");
    assert_eq!(seen(&scene, Some(3)).value, 0.0);
}

#[test]
fn panes_at_an_angle_have_the_mean_of_walks_that_connect_to_nothing() {
    let lit = corner(floor(lambert(ALBEDO, 0.0)))
        .panel("panel", &quad(Vec3::new(1.3, 1.0, -0.4), Vec3::Z * 0.8, Vec3::Y * 1.0), 3.0, 4)
        .surface("lamp", &quad(Vec3::new(1.5, 1.6, 0.1), Vec3::Z * 0.4, Vec3::new(-0.2, 0.4, 0.0)), lambert(0.0, 8.0));
    let scene = lit.prepared();
    let weights = file_light(&scene);
    let film = Film { width: 1, height: 1 };
    let walks = |spp, seed| Walks { film, streams: 6000, spp, bounces: Some(6), seed };
    let even = |rate, splits| Even { n_cols: weights.len() as u32, rate, splits };
    let plain = walks(60, 1).streams(&scene, &even(0.0, 1), &weights);
    assert_same_mean(&walks(2, 2).streams(&scene, &even(1.0, 2), &weights), &plain, 0.04, "one pick of each column");
    let plan = MatrixPlan::new(&scene.lighting, Density::Full);
    assert_same_mean(&walks(2, 3).streams(&scene, &plan, &weights), &plain, 0.04, "the plan of a matrix");
    // Brute force finds light there at all.
    assert!(Mean::of(&plain).value > 0.0);
}

/// A floor under so many level panes.
fn pile(n: u32) -> Stage {
    (0..n).fold(floor(lambert(ALBEDO, 0.0)), |stage, nth| {
        let center = Vec3::Y * (0.5 + 0.08 * nth as f32);
        stage.surface("pane", &block(center, Vec3::new(40.0, 0.01, 40.0), Quat::IDENTITY), glass())
    })
}

#[test]
fn eight_panes_in_a_row_pass_light_and_more_are_named() {
    let none: [String; 0] = [];
    for n in [7, 8] {
        let scene = pile(n).lamp("lamp", Vec3::Y * HEIGHT, 7.0).prepared();
        let glass = 0.02 * f64::from(n);
        let depth = f64::from(HEIGHT) - glass + glass / IOR;
        let expected = 7.0 * passed(0.0).powi(n as i32) / (depth * depth) * f64::from(ALBEDO) / PI;
        seen(&scene, Some(2 * n)).assert_is(expected, 1e-4, &format!("{n} panes"));
        assert_eq!(hidden::warnings(&scene), none);
    }
    let scene = pile(9).lamp("lamp", Vec3::Y * HEIGHT, 7.0).prepared();
    assert_eq!(seen(&scene, Some(20)).value, 0.0);
    let named = hidden::warnings(&scene);
    assert!(named.len() == 1 && named[0].contains("into smooth glass") && named[0].contains("8 in a row"), "{named:?}");
}

/// Places on both sides of a wall at z = 0, 20 m wide and high.
fn before_and_behind(case: u64) -> [Vec3; 2] {
    let mut sampler = Sampler::new(13, case, 0);
    [1.0, -1.0].map(|side| {
        let ([x, y], z) = (sampler.next_2d(), sampler.next_1d());
        Vec3::new(14.0 * x - 7.0, 14.0 * y - 7.0, side * (0.5 + 2.0 * z))
    })
}

#[test]
fn a_front_of_many_panes_bends_light_as_one_does() {
    let turn = Quat::from_rotation_y(0.6) * Quat::from_rotation_x(0.2);
    let side = |n: usize| {
        let (width, mid) = (20.0 / n as f32, 0.5 * (n as f32 - 1.0));
        let places = (0..n * n).map(move |i| Vec3::new((i % n) as f32 - mid, (i / n) as f32 - mid, 0.0) * width);
        let stage = places.fold(floor(lambert(ALBEDO, 0.0)), |stage, place| {
            let half = Vec3::new(0.5 * width, 0.5 * width, 0.004);
            stage.surface("pane", &block(turn * place, half, turn), glass())
        });
        stage.prepared().slabs
    };
    let (one, many) = (side(1), side(20));
    assert_eq!((one.len(), many.len()), (1, 400));
    for [from, to] in (0..2000).map(|case| before_and_behind(case).map(|place| turn * place)) {
        let route = one.route(from, to).expect("the wall is between both");
        let found = many.route(from, to).expect("and made of panes");
        assert_eq!(found.slabs().len(), 1);
        assert!(found.direction.distance(route.direction) < 1e-4, "{from} to {to}");
        assert!((found.closeness / route.closeness - 1.0).abs() < 1e-4, "{from} to {to}");
    }
}

/// Turned panes, about as wide as they are said to be, 8 mm thick, at a distance from the origin.
fn turned(width: f32, distance: f32) -> impl Iterator<Item = Scene> {
    (0..20).map(move |case| {
        let angle = 0.37 + 0.31 * case as f32;
        let turn = Quat::from_rotation_y(angle) * Quat::from_rotation_x(0.2 * angle);
        let center = Vec3::new(0.77, 0.1, -0.63) * distance;
        let corners = block(center, Vec3::new(0.4 * width, 0.5 * width, 0.004), turn);
        floor(lambert(ALBEDO, 0.0)).surface("pane", &corners, glass()).into_scene()
    })
}

fn assert_slabs(scenes: impl Iterator<Item = Scene>, what: &str) {
    for (case, scene) in scenes.enumerate() {
        assert_eq!(Slabs::find(&scene).len(), 1, "{what}, {case}");
    }
}

#[test]
fn turned_panes_far_away_and_as_files_round_them_are_slabs() {
    for (width, distance) in [(1.5, 250.0), (0.35, 60.0), (1.0, 900.0)] {
        assert_slabs(turned(width, distance), &format!("{width} m at {distance} m"));
    }
    let with_normals = |mut scene: Scene| {
        scene.mesh.normals.iter_mut().for_each(|normal| *normal = ((*normal * 127.0).round() / 127.0).normalize());
        scene
    };
    assert_slabs(turned(1.2, 3.0).map(with_normals), "normals of eight bits");
    let with_places = |mut scene: Scene| {
        let step = 30.0 / 16384.0;
        scene.mesh.positions.iter_mut().for_each(|place| *place = (*place / step).round() * step);
        let mesh = &mut scene.mesh;
        for [a, b, c] in mesh.triangles.clone() {
            let [p, q, r] = [a, b, c].map(|v| mesh.positions[v as usize]);
            let normal = (q - p).cross(r - p).normalize();
            for vertex in [a, b, c] {
                mesh.normals[vertex as usize] = normal;
            }
        }
        scene
    };
    assert_slabs(turned(1.5, 10.0).map(with_places), "places of fourteen bits across 30 m");
}
