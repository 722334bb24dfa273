//! A generated interior of evenly fine triangles: a hall with fluted columns, bowls on the floor and wavy walls.

use std::f32::consts::{PI, TAU};

use clerestory_transport::camera::Camera;
use glam::Vec3;

/// Half length, height and half width in meters.
const HALF_LENGTH: f32 = 12.0;
const HEIGHT: f32 = 6.0;
const HALF_WIDTH: f32 = 8.0;

/// A surface over (u, v) in 0…1 and how many cells it has along both for every ten of the coarsest.
struct Patch {
    cells: [usize; 2],
    at: Box<dyn Fn(f32, f32) -> Vec3>,
}

/// The camera in the hall, between its rows of columns.
pub fn camera() -> Camera {
    Camera::look_at("hall", Vec3::new(-11.0, 1.7, -3.0), Vec3::new(4.0, 1.4, 2.0), 1.1, 4.0 / 3.0)
}

/// About that many triangles.
pub fn triangles(n_wanted: usize) -> Vec<[Vec3; 3]> {
    let patches = patches();
    let n_coarse: usize = patches.iter().map(|patch| 2 * patch.cells[0] * patch.cells[1]).sum();
    let finer = (n_wanted as f64 / n_coarse as f64).sqrt();
    let mut triangles = Vec::new();
    for patch in &patches {
        let [n, m] = patch.cells.map(|cells| ((cells as f64 * finer).round() as usize).max(1));
        let point = |i: usize, j: usize| (patch.at)(i as f32 / n as f32, j as f32 / m as f32);
        for (i, j) in (0..n).flat_map(|i| (0..m).map(move |j| (i, j))) {
            let [a, b, c, d] = [point(i, j), point(i + 1, j), point(i + 1, j + 1), point(i, j + 1)];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    triangles
}

fn patches() -> Vec<Patch> {
    let mut patches = walls();
    for (nth, side) in (0..6).flat_map(|nth| [-1.0, 1.0].map(|side| (nth, side))) {
        patches.push(column(Vec3::new(-10.0 + 4.0 * nth as f32, 0.0, 5.0 * side)));
    }
    for nth in 0..40 {
        // The golden ratio spreads them without any two alike.
        let (along, across) = ((nth as f32 * 0.618_034).fract(), (nth as f32 + 0.5) / 40.0);
        let place = Vec3::new((along - 0.5) * 20.0, 0.0, (across - 0.5) * 13.0);
        patches.push(bowl(place, 0.2 + 0.3 * (nth as f32 * 0.381_966).fract()));
    }
    patches
}

fn walls() -> Vec<Patch> {
    let wave = |x: f32, y: f32| 0.02 * (9.0 * x).sin() * (7.0 * y).cos();
    let (x, z) = (|u: f32| (2.0 * u - 1.0) * HALF_LENGTH, |v: f32| (2.0 * v - 1.0) * HALF_WIDTH);
    let level =
        |y: f32| Patch { cells: [24, 16], at: Box::new(move |u, v| Vec3::new(x(u), y + wave(x(u), z(v)), z(v))) };
    let long = |side: f32| Patch {
        cells: [24, 6],
        at: Box::new(move |u, v| Vec3::new(x(u), v * HEIGHT, side * HALF_WIDTH + wave(x(u), v * HEIGHT))),
    };
    let short = |side: f32| Patch {
        cells: [16, 6],
        at: Box::new(move |u, v| Vec3::new(side * HALF_LENGTH + wave(z(u), v * HEIGHT), v * HEIGHT, z(u))),
    };
    vec![level(0.0), level(HEIGHT), long(-1.0), long(1.0), short(-1.0), short(1.0)]
}

fn column(foot: Vec3) -> Patch {
    let at = move |u: f32, v: f32| {
        let radius = 0.4 + 0.03 * (TAU * u * 16.0).cos() - 0.08 * v;
        foot + Vec3::new(radius * (TAU * u).cos(), v * HEIGHT, radius * (TAU * u).sin())
    };
    Patch { cells: [16, 12], at: Box::new(at) }
}

fn bowl(foot: Vec3, radius: f32) -> Patch {
    let at = move |u: f32, v: f32| {
        let (angle, polar) = (TAU * u, PI * (0.3 + 0.7 * v));
        let outward = Vec3::new(polar.sin() * angle.cos(), polar.cos(), polar.sin() * angle.sin());
        foot + Vec3::Y * radius + outward * radius
    };
    Patch { cells: [10, 7], at: Box::new(at) }
}
