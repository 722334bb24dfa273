//! A closed room is dark inside, however bright the world around it.

use glam::{Quat, Vec3};

use super::stage::{Stage, lambert, quad, room};
use crate::camera::{Camera, Film};
use crate::path::{Deposit, Integrator, Scratch};
use crate::plan::{Density, MatrixPlan};
use crate::prepared::PreparedScene;
use crate::sampler::Sampler;

/// How much light came in.
#[derive(Default)]
struct Leaks {
    n: u32,
}

impl Deposit for Leaks {
    fn scattered(&mut self, _: u32, value: Vec3) {
        self.n += u32::from(value != Vec3::ZERO);
    }

    fn seen(&mut self, column: u32, value: Vec3) {
        self.scattered(column, value);
    }
}

/// Distance from an edge in meters.
const BESIDE: f32 = 1e-5;
const HALF: Vec3 = Vec3::new(1.0, 0.7, 1.3);

fn turned(corners: Vec<Vec3>, rotation: Quat) -> Vec<Vec3> {
    corners.into_iter().map(|corner| rotation * corner).collect()
}

fn closed_room(rotation: Quat) -> Stage {
    let camera = Camera::look_at("inside", Vec3::new(0.1, 0.05, 0.2), Vec3::new(1.0, -0.7, -1.0), 1.8, 1.0);
    Stage::new(camera).surface("walls", &turned(room(HALF), rotation), lambert(0.8, 0.0))
}

/// A lamp, an emitter and a panel all around.
fn in_a_bright_world(stage: Stage) -> PreparedScene {
    stage
        .lamp("above", Vec3::new(0.3, 4.0, -0.2), 1e4)
        .lamp("beside", Vec3::new(-5.0, 0.1, 0.4), 1e4)
        .surface("light", &quad(Vec3::new(3.0, -2.0, -2.0), Vec3::Z * 4.0, Vec3::Y * 4.0), lambert(0.0, 1e3))
        .panel("panel", &quad(Vec3::new(-2.0, -2.0, -3.0), Vec3::X * 4.0, Vec3::Y * 4.0), 1e3, 4)
        .prepared()
}

/// Light found by camera rays everywhere, and by rays that aim a hundredth of a millimeter beside the edges of the walls.
fn leaks(scene: &PreparedScene, rotation: Quat) -> [u32; 2] {
    const FILM: Film = Film { width: 64, height: 64 };
    let plan = MatrixPlan::new(&scene.lighting, Density::Full);
    let integrator = Integrator::new(scene, &plan, None);
    let (mut anywhere, mut scratch) = (Leaks::default(), Scratch::default());
    let camera = &scene.scene.cameras[0];
    for index in 0..FILM.n_pixels() as u32 * 4 {
        let pixel = [index % FILM.width, index / FILM.width % FILM.height];
        let sampler = Sampler::new(1, index.into(), 0);
        integrator.sample_pixel(camera, FILM, pixel, sampler, &mut scratch, &mut anywhere);
    }
    let (mut seams, walls) = (Leaks::default(), turned(room(HALF), rotation));
    for index in 0..20_000 {
        let mut sampler = Sampler::new(2, index, 0);
        let [along, which] = sampler.next_2d();
        let first = (which * (walls.len() / 3) as f32) as usize * 3;
        let [from, to, inner] = [0, 1, 2].map(|corner| walls[first + (index as usize + corner) % 3]);
        let target = from.lerp(to, along);
        let target = target + (inner - target).normalize() * BESIDE;
        let ray = (camera.position(), target - camera.position());
        integrator.sample_direct(ray, &mut sampler, &mut scratch, &mut seams);
    }
    [anywhere.n, seams.n]
}

#[test]
fn no_lamp_outside_lights_a_closed_room() {
    for rotation in [Quat::IDENTITY, Quat::from_rotation_x(0.7) * Quat::from_rotation_y(0.3)] {
        let scene = in_a_bright_world(closed_room(rotation));
        assert_eq!(leaks(&scene, rotation), [0, 0], "deposits by random rays and at edges, {rotation}");
    }
}

#[test]
fn no_sky_is_seen_from_a_closed_room() {
    let rotation = Quat::from_rotation_z(0.4);
    let scene = closed_room(rotation).prepared();
    assert_eq!(scene.lighting.basis.n_cols(), 1, "a scene without lights has a sky");
    assert_eq!(leaks(&scene, rotation), [0, 0]);
}
