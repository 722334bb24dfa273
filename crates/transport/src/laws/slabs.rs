//! Light through solid panes: shifted, dimmed and spread as Snell and Fresnel have it, whichever way a walk finds its lamp.

use std::f64::consts::PI;

use glam::{Quat, Vec2, Vec3, Vec4};

use super::stage::{Stage, lambert, pane, quad, room, textured, tint};
use super::walks::{Even, Mean, Walks, assert_same_mean, file_light};
use crate::bvh::Ray;
use crate::camera::{Camera, Film};
use crate::emitters::SkyRequest;
use crate::lamps::tests::lamp;
use crate::lamps::{FreeLamp, Lacking, LampShape, PreparedLamps};
use crate::patches::PatchSample;
use crate::plan::{Density, MatrixPlan};
use crate::prepared::PreparedScene;
use crate::sampler::{Sampler, uniform_sphere};
use crate::scene::{AlphaMode, Encoding, Finish, Material, PunctualKind};
use crate::sky::{Environment, SkyForm, SkyLight, Sun};
use crate::slabs::{IN_A_ROW, hidden};

pub(super) const ALBEDO: f32 = 0.5;
pub(super) const IOR: f64 = 1.5;
/// Heights of the slab's faces and of the lights over the floor, m.
const SLAB: [f32; 2] = [0.75, 1.0];
pub(super) const HEIGHT: f32 = 1.5;

/// A floor seen at one point, below everything.
pub(super) fn floor(material: Material) -> Stage {
    let camera = Camera::look_at("eye", Vec3::new(0.0, 0.4, 0.6), Vec3::ZERO, 1e-3, 1.0);
    // So small that next to no light comes back to it.
    let corners = quad(Vec3::new(-0.01, 0.0, -0.01), Vec3::Z * 0.02, Vec3::X * 0.02);
    Stage::new(camera).surface("floor", &corners, material)
}

/// Smooth glass with an inside.
pub(crate) fn glass() -> Material {
    Material { thickness: 1.0, ..pane() }
}

/// A closed box whose fronts look outwards.
pub(crate) fn block(center: Vec3, half: Vec3, turn: Quat) -> Vec<Vec3> {
    room(half).into_iter().rev().map(|corner| center + turn * corner).collect()
}

fn level_slab() -> Vec<Vec3> {
    let [low, high] = SLAB;
    block(Vec3::Y * (0.5 * (low + high)), Vec3::new(8.0, 0.5 * (high - low), 8.0), Quat::IDENTITY)
}

/// Distance aside, from the floor to the lights, of light that leaves the floor at an angle.
fn aside(theta: f64) -> f64 {
    let thickness = f64::from(SLAB[1] - SLAB[0]);
    let within = (theta.sin() / IOR).asin();
    (f64::from(HEIGHT) - thickness) * theta.tan() + thickness * within.tan()
}

/// Share that both faces let pass.
pub(super) fn passed(theta: f64) -> f64 {
    let within = (theta.sin() / IOR).asin();
    let (cos, cos_within) = (theta.cos(), within.cos());
    let s = (cos - IOR * cos_within) / (cos + IOR * cos_within);
    let p = (IOR * cos - cos_within) / (IOR * cos + cos_within);
    let one_face = 1.0 - 0.5 * (s * s + p * p);
    one_face * one_face
}

pub(super) fn seen(scene: &PreparedScene, bounces: Option<u32>) -> Mean {
    let plan = Even { n_cols: 1, rate: 1.0, splits: 1 };
    Mean::of(&Walks::of_one_pixel(1000, bounces).streams(scene, &plan, &file_light(scene)))
}

#[test]
fn a_lamp_behind_a_slab_sends_what_passes_into_its_rings() {
    for theta in [0.0, 0.3, 0.9, 1.3f64] {
        let lamp = Vec3::new(aside(theta) as f32, HEIGHT, 0.0);
        let stage = floor(lambert(ALBEDO, 0.0)).surface("slab", &level_slab(), glass());
        let scene = stage.lamp("lamp", lamp, 7.0).prepared();
        // Seen from the lamp: the solid angle between two cones over the area of the ring that they light.
        let [a, b] = [(theta - 1e-4).max(0.0), theta + 1e-4];
        let per_area = 2.0 * (a.cos() - b.cos()) / (aside(b).powi(2) - aside(a).powi(2));
        let expected = 7.0 * passed(theta) * per_area * f64::from(ALBEDO) / PI;
        seen(&scene, Some(2)).assert_is(expected, 1e-4, &format!("at {theta} rad"));
        // Two faces are two surfaces that scatter.
        assert_eq!(seen(&scene, Some(1)).value, 0.0);
    }
}

#[test]
fn light_from_afar_passes_slabs_of_any_tilt() {
    for (theta, tilt) in [(0.0, 0.0f32), (0.6, 0.0), (0.4, 0.5)] {
        let down = Vec3::new(-(theta as f32).sin(), -(theta as f32).cos(), 0.0);
        let slab = block(Vec3::Y * 3.0, Vec3::new(8.0, 0.125, 8.0), Quat::from_rotation_z(tilt));
        let level = block(Vec3::Y * 12.0, Vec3::new(16.0, 0.125, 16.0), Quat::IDENTITY);
        let stage = floor(lambert(ALBEDO, 0.0)).surface("tilted", &slab, glass()).surface("level", &level, glass());
        let scene = stage.distant("sun", down, 9.0).prepared();
        assert_eq!(scene.slabs.len(), 2);
        let on_tilted = theta + f64::from(tilt);
        let expected = 9.0 * theta.cos() * passed(theta) * passed(on_tilted) * f64::from(ALBEDO) / PI;
        seen(&scene, Some(4)).assert_is(expected, 1e-4, &format!("at {theta} rad, tilted by {tilt}"));
    }
}

#[test]
fn every_plan_finds_the_light_of_a_square_behind_a_slab() {
    const HALF: f64 = 1.2;
    let corner = Vec3::new(-1.2, HEIGHT, -1.2);
    let stage = floor(lambert(ALBEDO, 0.0)).surface("slab", &level_slab(), glass());
    let scene = stage.surface("light", &quad(corner, Vec3::X * 2.4, Vec3::Z * 2.4), lambert(0.0, 5.0)).prepared();
    // By directions from the floor: each goes up, and meets the square or does not.
    let (n, mut sum) = (2000, 0.0);
    for i in 0..n {
        let theta = (f64::from(i) + 0.5) / f64::from(n) * 0.5 * PI;
        let away = aside(theta);
        // The share of a circle that is within a square.
        let corner = if away <= HALF { 0.0 } else { (HALF / away).acos() };
        let share = (1.0 - corner / (0.25 * PI)).max(0.0);
        sum += share * passed(theta) * theta.cos() * theta.sin();
    }
    let expected = 5.0 * f64::from(ALBEDO) / PI * 2.0 * PI * sum * 0.5 * PI / f64::from(n);
    let weights = file_light(&scene);
    let walks = |streams| Walks { spp: 8, ..Walks::of_one_pixel(streams, Some(2)) };
    for (rate, streams) in [(0.0, 200_000), (1.0, 40_000), (16.0, 4800)] {
        let plan = Even { n_cols: 1, rate, splits: 1 };
        let what = format!("{rate} picks of each column");
        walks(streams).assert_mean(&scene, &plan, &weights, (expected, 2.5e-3), &what);
    }
    let matrix = MatrixPlan::new(&scene.lighting, Density::Full);
    walks(40_000).assert_mean(&scene, &matrix, &weights, (expected, 2.5e-3), "the plan of a matrix");
}

/// A tilted window with two tinted slabs over a floor.
fn glazed(floor_material: Material) -> Stage {
    let turn = Quat::from_rotation_z(0.4) * Quat::from_rotation_x(0.3);
    let out = turn * Vec3::Y;
    let center = Vec3::new(-0.1, 0.9, 0.1);
    let tinted = Material { attenuation_distance: 0.2, attenuation_color: Vec3::splat(0.6), ..glass() };
    let green = Material { base_color: Vec4::new(0.5, 0.9, 0.5, 1.0), ior: 1.7, ..glass() };
    floor(floor_material).surface("inner", &block(center, Vec3::new(0.6, 0.04, 0.6), turn), tinted).surface(
        "outer",
        &block(center + out * 0.25, Vec3::new(0.6, 0.06, 0.6), turn),
        green,
    )
}

/// The same before a panel and a lamp.
fn double_window(floor_material: Material) -> PreparedScene {
    glazed(floor_material)
        .panel("panel", &quad(Vec3::new(-0.9, 1.9, -0.8), Vec3::X * 1.2, Vec3::Z * 1.6), 3.0, 4)
        .surface("lamp", &quad(Vec3::new(0.4, 1.8, -0.2), Vec3::X * 0.3, Vec3::Z * 0.4), lambert(0.0, 8.0))
        .prepared()
}

#[test]
fn windows_have_the_mean_of_walks_that_connect_to_nothing() {
    let glossy = Material { roughness: 0.3, specular: 1.0, ..lambert(ALBEDO, 0.0) };
    for material in [lambert(ALBEDO, 0.0), glossy] {
        let scene = double_window(material);
        assert_eq!(scene.slabs.len(), 2);
        let weights = file_light(&scene);
        let camera = Film { width: 1, height: 1 };
        let walks = |spp, seed| Walks { film: camera, streams: 6000, spp, bounces: Some(6), seed };
        let even = |rate, splits| Even { n_cols: weights.len() as u32, rate, splits };
        let plain = walks(60, 1).streams(&scene, &even(0.0, 1), &weights);
        assert_same_mean(
            &walks(2, 2).streams(&scene, &even(1.0, 2), &weights),
            &plain,
            0.04,
            "one pick of each column",
        );
        let plan = MatrixPlan::new(&scene.lighting, Density::Full);
        assert_same_mean(&walks(2, 3).streams(&scene, &plan, &weights), &plain, 0.04, "the plan of a matrix");
    }
}

/// Points of a cube around the windows.
fn around(case: u64) -> [Vec3; 2] {
    let mut sampler = Sampler::new(11, case, 0);
    [0, 1].map(|_| {
        let ([x, y], z) = (sampler.next_2d(), sampler.next_1d());
        Vec3::new(4.0 * x - 2.0, 4.0 * y - 1.0, 4.0 * z - 2.0)
    })
}

#[test]
fn a_way_is_bent_between_straight_on_and_all_of_it_in_air() {
    let slabs = double_window(lambert(ALBEDO, 0.0)).slabs;
    let mut n_bent = 0;
    for [from, to] in (0..10_000).map(around) {
        let Some(way) = slabs.way(from, to) else { continue };
        let Some(route) = slabs.bent(&way) else { continue };
        let [straight, steep] = slabs.bounds(&way).unwrap().map(Vec3::normalize);
        let least = straight.dot(steep) - 1e-5;
        let (a, b) = (straight.dot(route.direction), steep.dot(route.direction));
        assert!(a >= least && b >= least, "{from} to {to}: {a}, {b}, {least}");
        assert!(straight.dot((to - from).normalize()) > 1.0 - 1e-5);
        n_bent += 1;
    }
    assert!(n_bent > 100, "{n_bent}");
}

#[test]
fn no_way_leads_through_slabs_that_are_beside() {
    let slabs = double_window(lambert(ALBEDO, 0.0)).slabs;
    let mut n = [0; 2];
    for (case, [middle, center]) in (0..10_000).map(|case| (case, around(case))) {
        let mut sampler = Sampler::new(12, case, 0);
        let ([x, y], z, [u, v], w) = (sampler.next_2d(), sampler.next_1d(), sampler.next_2d(), sampler.next_1d());
        let half = 0.4 * Vec3::new(x, y, z);
        let from = middle + half * (2.0 * Vec3::new(u, v, w) - 1.0);
        let radius = 0.3 * sampler.next_1d();
        let to = center + uniform_sphere(sampler.next_2d()) * radius * sampler.next_1d();
        let are_beside = slabs.are_beside((middle, half), (center, radius));
        assert!(!are_beside || slabs.route(from, to).is_none(), "{from} to {to}");
        n[usize::from(are_beside)] += 1;
    }
    assert!(n[0] > 100 && n[1] > 100, "{n:?}");
}

#[test]
fn lamps_of_a_look_send_through_windows_what_lamps_of_the_file_send() {
    let (place, down) = (Vec3::new(-0.3, 1.9, 0.2), Vec3::new(0.2, -1.0, 0.1));
    let window = || glazed(lambert(ALBEDO, 0.0));
    let scene = window().prepared();
    let lux = |shape: LampShape, aim: Vec3| {
        let free = FreeLamp { position: place, aim, strength: 7.0, ..lamp(shape) };
        let lamps = PreparedLamps::new(&[free], None).unwrap().0;
        let arriving = lamps.irradiance(&scene, Vec3::ZERO, Vec3::Y, None);
        let sample = PatchSample { position: Vec3::ZERO, normal: Vec3::Y, weight: 1.0, radius_m: 0.0, grazing: 0.0 };
        assert!(
            lamps.light_on(&scene, &sample, IN_A_ROW).abs_diff_eq(arriving, 1e-3 * arriving.y),
            "patches get what arrives"
        );
        f64::from(arriving.y)
    };
    let of_file = [
        (LampShape::Point, window().lamp("of the file", place, 7.0)),
        (LampShape::Directional { radius_rad: 0.0 }, window().distant("of the file", down, 7.0)),
    ];
    for (shape, stage) in of_file {
        let what = format!("{shape:?}");
        let expected = lux(shape, place + down) * f64::from(ALBEDO) / PI;
        seen(&stage.prepared(), Some(4)).assert_is(expected, 1e-3, &what);
    }
    // A small disk that faces the place shines there like a point.
    let [disk, point] = [LampShape::Disk { radius_m: 0.01 }, LampShape::Point].map(|shape| lux(shape, Vec3::ZERO));
    assert!((disk / point - 1.0).abs() < 2e-3, "{disk} lx, {point} lx");
}

#[test]
fn parallel_light_of_a_look_brings_its_lux_however_wide_its_disk_is() {
    let scene = floor(lambert(ALBEDO, 0.0)).prepared();
    for radius_rad in [0.0, 0.1, 0.4, 0.7] {
        let lamps = PreparedLamps::new(&[lamp(LampShape::Directional { radius_rad })], None).unwrap().0;
        for (normal, most) in [(Vec3::Y, 1e-3), (Vec3::new(0.6, 0.8, 0.0), 0.015)] {
            let sample = PatchSample { position: Vec3::ZERO, normal, weight: 1.0, radius_m: 0.0, grazing: 0.0 };
            let (arriving, on_patch) =
                (lamps.irradiance(&scene, Vec3::ZERO, normal, None), lamps.light_on(&scene, &sample, IN_A_ROW));
            for lux in [arriving, on_patch] {
                assert!((lux - normal.y).abs().max_element() < most, "{radius_rad}, facing {normal}: {lux}");
            }
        }
    }
}

/// What a lamp's light lacks on a stage.
fn lacking(lamp: FreeLamp, stage: Stage) -> Lacking {
    let told = PreparedLamps::new(&[lamp], None).unwrap().0.lacking(&stage.prepared());
    assert!(told.iter().all(|(key, _)| key == "lamp"), "{told:?}");
    told.first().map(|(_, lacking)| *lacking).unwrap_or_default()
}

/// Share of a lamp's light that panes and coats mirror onto other surfaces, 0 where it is not told.
fn mirrored(lamp: FreeLamp, stage: Stage) -> f32 {
    lacking(lamp, stage).mirrored
}

#[test]
fn what_panes_and_coats_mirror_of_a_lamps_light_is_told() {
    let thin = quad(Vec3::new(-5.0, 1.0, -5.0), Vec3::Z * 10.0, Vec3::X * 10.0);
    let ceiling = quad(Vec3::new(-20.0, 3.0, -20.0), Vec3::X * 40.0, Vec3::Z * 40.0);
    let open = |corners: &[Vec3], material| floor(lambert(ALBEDO, 0.0)).surface("below", corners, material);
    let closed =
        |corners: &[Vec3], material| open(corners, material).surface("ceiling", &ceiling, lambert(ALBEDO, 0.0));
    let above = |shape| FreeLamp { position: Vec3::Y * HEIGHT, ..lamp(shape) };
    let spot = || above(LampShape::Spot { inner_rad: 0.1, outer_rad: 0.1 });
    let coat = Material { metallic: 0.0, roughness: 0.0, ..Material::default() };
    let lacquer = Finish { clearcoat: 1.0, ..Finish::default() };
    let lacquered = Material { roughness: 0.6, finish: Some(Box::new(lacquer)), ..coat.clone() };
    for material in [pane(), coat, lacquered] {
        let share = mirrored(spot(), closed(&thin, material.clone()));
        assert!((share - 0.04).abs() < 2e-3, "{share} of {material:?}");
    }
    let share = mirrored(spot(), closed(&level_slab(), glass()));
    assert!((share - 0.077).abs() < 2e-3, "{share} by both faces of a slab");
    // All around more of it grazes the pane.
    let share = mirrored(above(LampShape::Disk { radius_m: 0.1 }), closed(&thin, pane()));
    assert!((0.06..0.09).contains(&share), "{share} of the light of a disk");

    assert_eq!(mirrored(spot(), open(&thin, pane())), 0.0, "it meets nothing");
    let mirror = Material { roughness: 0.0, ..Material::default() };
    for material in [tint(0.5), Material { roughness: 0.3, ..pane() }, mirror, lambert(ALBEDO, 0.0)] {
        assert_eq!(mirrored(spot(), closed(&thin, material.clone())), 0.0, "{material:?}");
    }
}

#[test]
fn what_mirrors_and_clear_bodies_get_of_a_lamps_light_is_told() {
    let stage = |material| {
        let above = quad(Vec3::new(-1.0, 2.0, -1.0), Vec3::X * 2.0, Vec3::Z * 2.0);
        floor(lambert(ALBEDO, 0.0)).surface("above", &above, material)
    };
    let caustic =
        |shape, stage: Stage| lacking(FreeLamp { position: Vec3::Y, aim: Vec3::Y * 2.0, ..lamp(shape) }, stage).caustic;
    let mirror = |metallic, roughness| Material { metallic, roughness, ..Material::default() };
    // A square of 2 m seen from 1 m below its middle takes a sixth of all directions, like the side of a cube around the lamp.
    for (material, share) in [(mirror(1.0, 0.0), 1.0), (mirror(0.75, 0.0), 0.75), (glass(), 1.0)] {
        let found = caustic(LampShape::Point, stage(material.clone()));
        assert!((found - share / 6.0).abs() < 0.01, "{found} of {material:?}");
    }
    let spot = || LampShape::Spot { inner_rad: 0.1, outer_rad: 0.1 };
    assert!((caustic(spot(), stage(mirror(1.0, 0.0))) - 1.0).abs() < 1e-3);
    for material in [mirror(1.0, 0.2), mirror(0.0, 0.0), pane(), lambert(ALBEDO, 0.0)] {
        assert_eq!(caustic(spot(), stage(material.clone())), 0.0, "{material:?}");
    }
    // What a pane lets pass goes on to the mirror behind it.
    let between = quad(Vec3::new(-1.0, 1.5, -1.0), Vec3::X * 2.0, Vec3::Z * 2.0);
    let found = caustic(spot(), stage(mirror(1.0, 0.0)).surface("pane", &between, pane()));
    assert!((0.9..0.97).contains(&found), "{found} behind a pane");
}

#[test]
fn textures_tell_whether_a_surface_throws_a_lamps_light_on_or_mirrors_a_part() {
    let ground = quad(Vec3::new(-10.0, 0.0, -10.0), Vec3::Z * 20.0, Vec3::X * 20.0);
    let above = quad(Vec3::new(-1.0, 2.0, -1.0), Vec3::X * 2.0, Vec3::Z * 2.0);
    let told = |material: Material, [roughness, metallic]: [u8; 2]| {
        let material = Material { metallic_roughness_texture: textured(Encoding::Linear), ..material };
        let stage = floor(lambert(ALBEDO, 0.0)).surface("ground", &ground, lambert(ALBEDO, 0.0));
        let stage = stage.surface("above", &above, material);
        let stage = stage.with_texture([[0, roughness, metallic, 255]; 4], |_| Vec2::ZERO);
        let spot = LampShape::Spot { inner_rad: 0.1, outer_rad: 0.1 };
        lacking(FreeLamp { position: Vec3::Y, aim: Vec3::Y * 2.0, ..lamp(spot) }, stage)
    };
    let metal = |roughness| Material { metallic: 1.0, roughness, ..Material::default() };
    let found = told(metal(1.0), [0, 255]);
    assert!((found.caustic - 1.0).abs() < 1e-3 && found.mirrored == 0.0, "{found:?} of metal that is smooth there");
    assert_eq!(told(metal(1.0), [255, 255]), Lacking::default(), "rough metal");
    for material in [metal(0.0), Material { roughness: 1.0, ..pane() }] {
        let found = told(material.clone(), [0, 0]);
        assert!(found.caustic == 0.0 && (found.mirrored - 0.04).abs() < 2e-3, "{found:?} of {material:?}");
    }
}

#[test]
fn what_a_window_mirrors_of_parallel_light_onto_the_ground_is_told() {
    let ground = quad(Vec3::new(-10.0, 0.0, -10.0), Vec3::Z * 20.0, Vec3::X * 20.0);
    let window = quad(Vec3::new(0.0, 0.0, -10.0), Vec3::Y * 10.0, Vec3::Z * 20.0);
    let stage = floor(lambert(ALBEDO, 0.0)).surface("ground", &ground, lambert(ALBEDO, 0.0));
    let sun = lamp(LampShape::Directional { radius_rad: 0.0 });
    let sun = FreeLamp { aim: sun.position + Vec3::new(1.0, -1.0, 0.0), ..sun };
    // Half of the light that the scene gets meets the window, which mirrors 4.2 % at 45°.
    let share = mirrored(sun, stage.surface("window", &window, pane()));
    assert!((0.017..0.025).contains(&share), "{share}");
}

#[test]
fn who_looks_through_panes_sees_what_is_behind_them() {
    let ray = |direction| Ray { origin: Vec3::Y * 2.0, direction, t_min: 0.0, t_max: f32::INFINITY };
    let thin = quad(Vec3::new(-1.0, 1.5, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0);
    let solid = |material| floor(lambert(ALBEDO, 0.0)).surface("slab", &level_slab(), material);
    let height = |stage: Stage, direction| {
        let hit = stage.prepared().closest_behind_glass(&ray(direction), &mut Sampler::new(0, 0, 0));
        hit.map(|hit| hit.position.y)
    };
    assert_eq!(height(solid(glass()).surface("pane", &thin, pane()), Vec3::NEG_Y), Some(0.0));
    assert_eq!(height(solid(lambert(ALBEDO, 0.0)).surface("pane", &thin, pane()), Vec3::NEG_Y), Some(SLAB[1]));
    let aside = Vec3::new(0.3, -1.0, 0.0);
    assert_eq!(height(solid(glass()), aside), Some(SLAB[1]), "nothing is behind it");
    assert_eq!(height(solid(glass()), Vec3::Y), None);
}

#[test]
fn lamps_in_glass_of_other_shapes_are_named() {
    let hidden = |half: Vec3, lamp: Vec3, material: Material| {
        let corners = block(Vec3::Y, half, Quat::IDENTITY);
        hidden::warnings(
            &floor(lambert(ALBEDO, 0.0)).surface("body", &corners, material).lamp("bulb", lamp, 1.0).prepared(),
        )
    };
    let within = hidden(Vec3::splat(0.3), Vec3::Y, glass());
    assert!(within.len() == 1 && within[0].contains("`bulb` sends 100 %"), "{within:?}");
    let beside = hidden(Vec3::splat(0.3), Vec3::new(0.0, 1.0, 1.0), glass());
    assert!(beside.len() == 1 && beside[0].contains("into smooth glass"), "{beside:?}");
    let none: [String; 0] = [];
    assert_eq!(hidden(Vec3::new(1.0, 0.05, 1.0), Vec3::Y * 2.0, glass()), none, "a slab");
    assert_eq!(hidden(Vec3::splat(0.3), Vec3::Y, Material { roughness: 0.3, ..glass() }), none, "rough");
    // Light goes straight through what has no interface, but not where it is attenuated.
    for roughness in [0.0, 1.0] {
        let nothing = || Material { ior: 1.0, roughness, ..glass() };
        let found = hidden(Vec3::splat(0.3), Vec3::Y, Material { attenuation_distance: 0.2, ..nothing() });
        assert!(found.len() == 1 && found[0].contains("`bulb` sends 100 %"), "{found:?}");
        assert!(found[0].contains("color it and bend nothing"), "{found:?}");
        assert_eq!(hidden(Vec3::splat(0.3), Vec3::Y, nothing()), none, "nothing at all");
    }
}

#[test]
fn a_narrow_spot_into_a_block_of_glass_is_named() {
    let corners = block(Vec3::Y, Vec3::splat(0.3), Quat::IDENTITY);
    let stage = floor(lambert(ALBEDO, 0.0)).surface("body", &corners, glass()).lamp("spot", Vec3::Y * 2.0, 1.0);
    let mut scene = stage.into_scene();
    let kind = PunctualKind::Spot { inner_rad: 0.0, outer_rad: 0.01 };
    (scene.punctual[0].kind, scene.punctual[0].direction) = (kind, Vec3::new(0.01, -1.0, 0.02).normalize());
    let found = hidden::warnings(&PreparedScene::new(scene, &[]).unwrap().0);
    assert!(found.len() == 1 && found[0].contains("`spot` sends 100 %"), "{found:?}");
}

#[test]
fn a_sun_without_size_over_a_block_of_glass_is_named() {
    let stage = || {
        let corners = block(Vec3::Y, Vec3::splat(0.3), Quat::IDENTITY);
        floor(lambert(ALBEDO, 0.0)).surface("body", &corners, glass()).distant("sun", Vec3::new(0.2, -1.0, 0.1), 1.0)
    };
    let found = hidden::warnings(&stage().prepared());
    assert!(found.len() == 1 && found[0].contains("into smooth glass") && found[0].contains("--sun-size"), "{found:?}");
    let mut scene = stage().into_scene();
    scene.set_sun_radius(0.005);
    let none: [String; 0] = [];
    assert_eq!(hidden::warnings(&PreparedScene::new(scene, &[]).unwrap().0), none, "with a size");
}

#[test]
fn the_sun_of_a_sky_over_a_block_of_glass_is_named() {
    let sun = Sun { direction: Vec3::Y, illuminance_lx: 9e4, color: Vec3::ONE };
    let light = SkyLight { sun: Some(sun), ..SkyLight::new("sun", Environment::uniform(Vec3::ONE)) };
    let under = |material: Material, half: Vec3| {
        let stage = floor(lambert(ALBEDO, 0.0)).surface("body", &block(Vec3::Y, half, Quat::IDENTITY), material);
        hidden::warnings(&stage.prepared_under(&SkyRequest { light: light.clone(), form: SkyForm::Whole }))
    };
    let found = under(glass(), Vec3::splat(0.3));
    assert!(found.len() == 1 && found[0].contains("light `sun`") && found[0].contains("by chance"), "{found:?}");
    let none: [String; 0] = [];
    assert_eq!(under(glass(), Vec3::new(0.3, 0.01, 0.3)), none, "a slab");
    assert_eq!(under(Material { roughness: 0.3, ..glass() }, Vec3::splat(0.3)), none, "rough");
}

#[test]
fn glass_hides_lamps_whatever_else_is_on_it() {
    let water = quad(Vec3::new(-1.0, 1.0, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0);
    let hidden = |material: Material, green: u8| {
        let stage = floor(lambert(ALBEDO, 0.0)).surface("water", &water, material);
        let stage = stage.with_texture([[128, green, 255, 255]; 4], |_| Vec2::ZERO);
        hidden::warnings(&stage.lamp("bulb", Vec3::Y * 2.0, 1.0).prepared())
    };
    let waves = Material { normal_texture: textured(Encoding::Linear), ..glass() };
    let coat = Finish { clearcoat: 1.0, ..Finish::default() };
    let coated = Material { finish: Some(Box::new(coat)), ..glass() };
    let veiled = Material { base_color: Vec4::new(1.0, 1.0, 1.0, 0.5), alpha: AlphaMode::Blend, ..glass() };
    let texture = textured(Encoding::Linear);
    let by_texture = |metallic| Material { metallic, roughness: 1.0, metallic_roughness_texture: texture, ..glass() };
    // A square of 2 m seen from 1 m above its middle takes a sixth of all directions.
    for (material, green, percent) in
        [(waves, 128, "17 %"), (coated, 0, "17 %"), (veiled, 0, ""), (by_texture(0.0), 0, "17 %")]
    {
        let found = hidden(material, green);
        assert!(found.len() == 1 && found[0].contains(&format!("`bulb` sends {percent}")), "{percent}: {found:?}");
    }
    let none: [String; 0] = [];
    assert_eq!(hidden(by_texture(0.0), 100), none, "rough by its texture");
    assert_eq!(hidden(by_texture(1.0), 0), none, "metal by its texture");
}

#[test]
fn lamps_without_size_whose_light_mirrors_throw_on_are_named() {
    let mirror = |metallic, roughness| Material { metallic, roughness, ..Material::default() };
    let above = quad(Vec3::new(-1.0, 2.0, -1.0), Vec3::X * 2.0, Vec3::Z * 2.0);
    let scene = |material: Material| floor(lambert(ALBEDO, 0.0)).surface("mirror", &above, material);
    let named = |stage: Stage| hidden::warnings(&stage.prepared());
    let lamp = |material: Material| named(scene(material).lamp("bulb", Vec3::Y, 1.0));
    let found = lamp(mirror(1.0, 0.0));
    // A square of 2 m seen from 1 m below its middle takes a sixth of all directions, like the side of a cube around the lamp.
    assert!(found.len() == 1 && found[0].contains("onto smooth mirrors"), "{found:?}");
    assert!(found[0].contains("`bulb` sends 17 %"), "{found:?}");
    let none: [String; 0] = [];
    assert_eq!(lamp(mirror(1.0, 0.2)), none, "rough");
    assert_eq!(lamp(mirror(0.0, 0.0)), none, "a coat that gets a sixth of the light");
    let coated = named(scene(mirror(0.0, 0.0)).lamp("bulb", Vec3::Y * 1.9, 1.0));
    assert!(coated.len() == 1 && coated[0].contains("smooth coats throw on"), "{coated:?}");
    let lacquer = Finish { clearcoat: 1.0, ..Finish::default() };
    let lacquered = Material { finish: Some(Box::new(lacquer)), ..mirror(0.0, 0.6) };
    let coated = named(scene(lacquered).lamp("bulb", Vec3::Y * 1.9, 1.0));
    assert!(coated.len() == 1 && coated[0].contains("smooth coats throw on"), "{coated:?}");
    // From far away: the mirror is in the way of a part of what the scene gets; with a size walks meet the lamp.
    let sun = scene(mirror(1.0, 0.0)).distant("sun", Vec3::NEG_Y, 1.0);
    let found = named(sun);
    assert!(found.len() == 1 && found[0].contains("--sun-size"), "{found:?}");
    let mut scene = scene(mirror(1.0, 0.0)).distant("sun", Vec3::NEG_Y, 1.0).into_scene();
    scene.set_sun_radius(0.005);
    assert_eq!(hidden::warnings(&PreparedScene::new(scene, &[]).unwrap().0), none, "a sun with a size");
}

#[test]
fn only_thin_closed_bodies_of_smooth_glass_are_slabs() {
    let half = Vec3::new(1.0, 0.125, 1.0);
    let count =
        |corners: &[Vec3], material: Material| floor(glass()).surface("body", corners, material).prepared().slabs.len();
    let outwards = block(Vec3::Y, half, Quat::from_rotation_x(0.7));
    assert_eq!(count(&outwards, glass()), 1);
    let inwards: Vec<Vec3> = outwards.iter().rev().copied().collect();
    assert_eq!(count(&inwards, glass()), 0, "inside out");
    assert_eq!(count(&block(Vec3::Y, Vec3::ONE, Quat::IDENTITY), glass()), 0, "a cube");
    let mut wedge = outwards.clone();
    wedge.iter_mut().filter(|corner| corner.x > 0.0).for_each(|corner| corner.y *= 1.1);
    assert_eq!(count(&wedge, glass()), 0, "a wedge");
    assert_eq!(count(&outwards, Material { roughness: 0.3, ..glass() }), 0, "rough");
    assert_eq!(count(&outwards, pane()), 0, "without an inside");
    let open = &outwards[..6];
    assert_eq!(count(open, glass()), 0, "a single face");
}
