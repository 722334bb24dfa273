//! Light within a solid that attenuates: water, and what lies in it.

use glam::{Vec2, Vec3};

use super::stage::{Stage, lambert, pane, quad, room, tint};
use super::walks::{Even, Mean, Walks, assert_same_mean, file_light};
use crate::camera::{Camera, Film};
use crate::path::{Deposit, Integrator, KnownAt, NoLights, Onto, Scratch};
use crate::plan::{Density, MatrixPlan};
use crate::sampler::Sampler;
use crate::scene::Material;

const FILM: Film = Film { width: 16, height: 12 };
/// Largest standard error of a difference of means, relative to the mean: four of them, 4 %, are what a test accepts.
const SHARP: f64 = 0.01;
/// Length after which the water leaves half of the light, m.
const HALVED_M: f32 = 0.4;
/// Where a camera looks straight down.
const BELOW: Vec3 = Vec3::new(0.05, 0.0, 0.03);

/// Share of light that the water leaves over a length, m.
fn kept(length_m: f64) -> f64 {
    0.5f64.powf(length_m / f64::from(HALVED_M))
}

/// Water that bends nothing, so that what it keeps is known.
fn water() -> Material {
    let attenuation_color = Vec3::splat(0.5);
    Material { ior: 1.0, thickness: 1.0, attenuation_color, attenuation_distance: HALVED_M, ..pane() }
}

/// A box around the origin whose fronts look outward.
fn block(half: f32) -> Vec<Vec3> {
    room(Vec3::splat(half)).into_iter().rev().collect()
}

/// A square in the water at a height, whose front looks up.
fn level(height: f32) -> Vec<Vec3> {
    quad(Vec3::new(-0.4, height, 0.4), Vec3::X * 0.8, Vec3::NEG_Z * 0.8)
}

/// A meter of water, seen along a line straight down.
fn tank() -> Stage {
    let camera = Camera::look_at("above", BELOW + Vec3::Y * 2.0, BELOW, 1e-3, 1.0);
    Stage::new(camera).surface("water", &block(0.5), water())
}

/// A ground, a wall and a light that stand in water, seen from above.
fn basin() -> Stage {
    let camera = Camera::look_at("eye", Vec3::new(0.0, 2.0, 0.3), Vec3::new(0.0, -0.4, 0.0), 0.2, 4.0 / 3.0);
    Stage::new(camera)
        .surface("water", &block(0.5), water())
        .surface("ground", &level(-0.4), lambert(0.6, 0.0))
        .surface("wall", &quad(Vec3::new(-0.4, -0.39, -0.4), Vec3::X * 0.8, Vec3::Y * 0.7), lambert(0.8, 0.0))
        .surface("light", &quad(Vec3::new(-0.42, -0.35, -0.35), Vec3::Y * 0.6, Vec3::Z * 0.7), lambert(0.0, 3.0))
}

fn walks(bounces: Option<u32>, spp: u32, seed: u64) -> Walks {
    Walks { film: FILM, streams: 9600, spp, bounces, seed }
}

#[track_caller]
fn assert_is(values: &[f64], expected: f64, what: &str) {
    let value = Mean::of(values).value;
    assert!((value - expected).abs() < 1e-3 * expected, "{what}: {value}, not {expected}");
}

#[test]
fn what_bounds_no_solid_leaves_light_in_the_water_around_it() {
    let light = quad(Vec3::new(-2.0, -1.0, 2.0), Vec3::X * 4.0, Vec3::NEG_Z * 4.0);
    let lit = || tank().surface("light", &light, lambert(0.0, 5.0));
    let nothing = Material { thickness: 1.0, ..tint(1.0) };
    for (what, stage) in [
        ("water alone", lit()),
        ("a film", lit().surface("film", &level(0.2), tint(1.0))),
        ("a solid that neither bends nor attenuates", lit().surface("nothing", &block(0.2), nothing)),
    ] {
        let scene = stage.prepared();
        let weights = file_light(&scene);
        let plan = Even { n_cols: weights.len() as u32, rate: 1.0, splits: 1 };
        assert_is(&Walks::of_one_pixel(16, Some(4)).streams(&scene, &plan, &weights), 5.0 * kept(1.0), what);
    }
}

#[test]
fn nothing_is_left_of_a_channel_that_a_color_lacks_however_short_the_way() {
    let color = Vec3::new(0.0, 0.5, 1.0);
    let redless = Material { attenuation_color: color, attenuation_distance: 100.0, ..water() };
    let camera = Camera::look_at("above", Vec3::Y * 2.0, Vec3::ZERO, 1e-3, 1.0);
    let scene = Stage::new(camera).surface("water", &block(0.5), redless).prepared();
    let left = |length_m: f32| (-scene.extinction_behind(0, false, Vec3::ZERO) * length_m).exp();
    let of_a_millimeter = left(1e-3);
    assert!(of_a_millimeter.x == 0.0 && of_a_millimeter.z == 1.0, "{of_a_millimeter}");
    assert!((left(50.0).y - 0.5_f32.sqrt()).abs() < 1e-6);
    assert_eq!(left(0.0), Vec3::ONE);
}

#[test]
fn walks_through_a_film_in_water_are_attenuated_as_connections_are() {
    let scene = basin().surface("film", &level(-0.2), tint(1.0)).prepared();
    let weights = file_light(&scene);
    let by = |rate, spp, seed| {
        walks(Some(3), spp, seed).streams(&scene, &Even { n_cols: weights.len() as u32, rate, splits: 1 }, &weights)
    };
    assert_same_mean(&by(1.0, 12, 2), &by(0.0, 48, 1), SHARP, "walks alone or connections");
}

#[test]
fn what_water_shows_has_its_shared_light_attenuated() {
    let scene = basin().prepared();
    let (weights, plan) = (file_light(&scene), MatrixPlan::new(&scene.lighting, Density::Full));
    let traced = walks(None, 16, 1).streams(&scene, &plan, &weights);
    assert_same_mean(&walks(None, 16, 2).gathered(&scene, &plan, &weights), &traced, SHARP, "gathered and traced");
}

#[test]
fn light_that_arrives_on_the_ground_of_water_has_come_through_it() {
    let ground = || tank().surface("ground", &level(-0.4), lambert(0.0, 0.0));
    let scene = ground().lamp("lamp", BELOW, 40.0).prepared();
    let (weights, plan) = (file_light(&scene), MatrixPlan::new(&scene.lighting, Density::Full));
    let (walk, lux) = (Walks::of_one_pixel(16, None), 40.0 / 0.4f64.powi(2) * kept(0.4));
    assert_is(&walk.irradiance(&scene, &plan, &weights), lux, "traced");
    assert_is(&walk.gathered_irradiance(&scene, &plan, &weights), lux, "gathered");

    let scene = basin().prepared();
    let (weights, plan) = (file_light(&scene), MatrixPlan::new(&scene.lighting, Density::Full));
    let traced = walks(None, 16, 1).irradiance(&scene, &plan, &weights);
    let gathered = walks(None, 16, 2).gathered_irradiance(&scene, &plan, &weights);
    assert_same_mean(&gathered, &traced, SHARP, "gathered and traced in a basin");
}

/// Whether some light is known that a surface in water receives.
struct Known(bool);

impl Deposit for Known {
    const KNOWS: bool = true;

    fn scattered(&mut self, _: u32, _: Vec3) {}

    fn seen(&mut self, _: u32, _: Vec3) {}

    fn known(&mut self, at: &KnownAt<'_>) -> bool {
        self.0 |= at.hit.position.abs().max_element() < 0.49;
        true
    }
}

#[test]
fn no_walk_ends_in_a_cell_within_water() {
    // A white wall behind the water, from the middle of which walks go into it.
    let back = quad(Vec3::new(-1.0, -1.0, -0.6), Vec3::X * 2.0, Vec3::Y * 2.0);
    let scene = basin().surface("back", &back, lambert(0.8, 0.0)).prepared();
    let integrator = Integrator::new(&scene, &NoLights, None);
    let at = scene.point_of(scene.scene.mesh.triangles.len() as u32 - 2, Vec2::new(0.05, 0.45));
    let (mut known, mut scratch) = (Known(false), Scratch::default());
    for walk in 0..512 {
        let mut sampler = Sampler::new(2, 0, walk);
        integrator.gather_indirect((&at, Vec3::Z, Onto::Point), &mut sampler, &mut scratch, &mut known);
    }
    assert!(!known.0, "a surface within water was asked for its light");
}
