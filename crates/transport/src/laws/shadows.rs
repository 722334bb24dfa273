//! A flat surface does not shadow itself, however large, thin or tilted it is, and wherever it lies.

use glam::{EulerRot, Quat, Vec3};

use super::stage::{Stage, lambert, quad};
use crate::bvh::Ray;
use crate::camera::Camera;
use crate::prepared::PreparedScene;
use crate::sampler::Sampler;

/// Connections from one point.
const FAN: usize = 16;
const POINTS: u32 = 64;
const TURNS: u64 = 12;

/// A rectangle with its middle at `place`, and what turns it.
fn rectangle(side: f32, slenderness: f32, rotation: Quat, place: Vec3) -> PreparedScene {
    let (u, v) = (rotation * Vec3::X * side, rotation * Vec3::NEG_Z * side / slenderness);
    let camera = Camera::look_at("anywhere", Vec3::ONE, Vec3::NEG_ONE, 1.0, 1.0);
    Stage::new(camera).surface("sheet", &quad(place - 0.5 * (u + v), u, v), lambert(0.5, 0.0)).prepared()
}

/// Connections from points of a sheet to either side that the sheet itself blocks, of all.
fn blocked(side: f32, slenderness: f32, place: Vec3, turn: u64) -> [u32; 2] {
    let mut turns = Sampler::new(7, turn, 0);
    let ([x, y], [z, _]) = (turns.next_2d(), turns.next_2d());
    let rotation = Quat::from_euler(EulerRot::XYZ, 6.0 * x, 6.0 * y, 6.0 * z);
    let scene = rectangle(side, slenderness, rotation, place);
    let (mut n_blocked, mut n) = (0, 0);
    for index in 0..POINTS {
        let mut sampler = Sampler::new(8, turn, index);
        let ([s, t], [height, tilt]) = (sampler.next_2d(), sampler.next_2d());
        // Most points are near the middle: at the origin of coordinates they are small and the corners are not.
        let [s, t] = [s, t].map(|u| (2.0 * u - 1.0).powi(5) / 2.0);
        let point = place + rotation * Vec3::new(s * side, 0.0, t * side / slenderness);
        let from = point + rotation * Vec3::new(tilt, 1.0, 0.3) * side * (0.01 + height);
        let ray = Ray { origin: from, direction: point - from, t_min: 0.0, t_max: f32::INFINITY };
        let Some(hit) = scene.closest(&ray, &mut sampler) else { continue };
        for face in [hit.normal, -hit.normal] {
            let targets = std::array::from_fn(|_| {
                let ([cos, turn], [reach, _]) = (sampler.next_2d(), sampler.next_2d());
                let (cos, (sin, along)) = (0.02 + 0.98 * cos, (std::f32::consts::TAU * turn).sin_cos());
                let (tangent, bitangent) = face.any_orthonormal_pair();
                let across = (tangent * along + bitangent * sin) * (1.0 - cos * cos).max(0.0).sqrt();
                hit.position + (across + face * cos) * side * 10.0_f32.powf(-3.0 * reach)
            });
            let mut passed = [Vec3::ZERO; FAN];
            scene.transmittance16(hit.origin(face), &targets, FAN, &mut passed);
            n_blocked += passed.iter().filter(|share| **share != Vec3::ONE).count() as u32;
            n += FAN as u32;
        }
    }
    [n_blocked, n]
}

#[test]
fn no_flat_surface_shadows_itself() {
    for place in [Vec3::ZERO, Vec3::new(10.0, 3.0, -7.0)] {
        for side in [0.1, 10.0, 400.0] {
            for slenderness in [1.0, 8.0, 60.0] {
                let counts = (0..TURNS).map(|turn| blocked(side, slenderness, place, turn));
                let [n_blocked, n] = counts.fold([0, 0], |sum, count| [sum[0] + count[0], sum[1] + count[1]]);
                assert!(n > 10_000, "only {n} connections");
                assert_eq!(n_blocked, 0, "of {n} from a sheet of {side} m, {slenderness} times as long, at {place}");
            }
        }
    }
}

#[test]
fn no_flat_surface_shadows_itself_far_from_the_origin() {
    let (near, far) = (Vec3::new(1e3, -1e3, 1e3), Vec3::new(-2e4, 3.0, 1e4));
    // Farther out for their size the corners of a sheet are not in one plane any more.
    for (place, side) in [(near, 10.0), (near, 400.0), (far, 400.0)] {
        let counts = (0..TURNS).map(|turn| blocked(side, 8.0, place, turn));
        let [n_blocked, n] = counts.fold([0, 0], |sum, count| [sum[0] + count[0], sum[1] + count[1]]);
        assert!(n > 10_000, "only {n} connections");
        assert_eq!(n_blocked, 0, "of {n} from a sheet of {side} m at {place}");
    }
}

#[test]
fn far_from_the_origin_rays_begin_as_near_their_surface_as_rounding_allows() {
    for meters in [0.0, 1e2, 1e3, 1e4] {
        let place = Vec3::new(meters, -meters, meters);
        let scene = rectangle(2.0, 1.0, Quat::from_rotation_x(0.3), place);
        let ray = Ray { origin: place + Vec3::Y, direction: Vec3::NEG_Y, t_min: 0.0, t_max: f32::INFINITY };
        let hit = scene.closest(&ray, &mut Sampler::new(1, 1, 1)).expect("the sheet lies below");
        let away = (hit.origin(hit.normal) - hit.position).length();
        let steps = 16.0 * f32::EPSILON * meters;
        assert!(away > 0.0 && away <= 1e-4 + steps, "{away} m, {meters} m from the origin");
    }
}

#[test]
fn no_light_shadows_itself_far_from_the_origin() {
    for meters in [0.0, 1e3, 1e4] {
        let (place, rotation) = (Vec3::new(meters, -meters, meters), Quat::from_euler(EulerRot::XYZ, 0.6, 0.4, 0.2));
        let (corner, u, v) = (place, rotation * Vec3::X, rotation * Vec3::NEG_Z);
        let camera = Camera::look_at("anywhere", Vec3::ONE, Vec3::NEG_ONE, 1.0, 1.0);
        let scene = Stage::new(camera).surface("light", &quad(corner, u, v), lambert(0.0, 1.0)).prepared();
        let (mut n_dark, mut n) = (0, 0);
        for index in 0..4096 {
            let mut sampler = Sampler::new(9, index, 0);
            let ([s, t], [x, z], height) = (sampler.next_2d(), sampler.next_2d(), sampler.next_1d());
            let target = corner + u * s + v * t;
            let side = if index % 2 == 0 { 1.0 } else { -1.0 };
            let from = place + rotation * Vec3::new(x, side * (0.3 + height), -z);
            let dark = scene.transmittance(from, target) != Vec3::ONE;
            let mut passed = [Vec3::ZERO; FAN];
            scene.transmittance16(from, &[target; FAN], FAN, &mut passed);
            assert_eq!(passed.iter().filter(|share| **share != Vec3::ONE).count(), if dark { FAN } else { 0 });
            n_dark += u32::from(dark);
            n += 1;
        }
        assert_eq!(n_dark, 0, "of {n} connections with a light {meters} m from the origin");
    }
}
