//! A camera for a scene that has none: inside a room, outside an object.
//!
//! A point is inside a room if most rays from it end on surfaces that face it; inside a solid they end on backs, and in
//! the open they end nowhere. Backs of double-sided surfaces tell neither: such a space must be most of the scene. Among points at eye height over a floor the one with the longest view is taken, which lands
//! in a corner and looks along the diagonal.

use std::f32::consts::{PI, TAU};

use glam::Vec3;
use rayon::prelude::*;

use super::cameras::DEFAULT_ASPECT;
use crate::bvh::{Bvh, Ray};
use crate::camera::Camera;
use crate::scene::{Material, Mesh};

/// Eye height in meters over the floor.
const EYE_HEIGHT_M: f32 = 1.6;

/// Vertical angle of view indoors, radians.
const INDOOR_YFOV_RAD: f32 = PI / 3.0;

/// Vertical angle of view of an object, radians.
const OBJECT_YFOV_RAD: f32 = PI / 4.5;

/// Candidates along each horizontal side of the core box.
const GRID: usize = 9;

/// Smallest height and width of a scene that could be a room, meters.
const MIN_ROOM_M: f32 = 1.8;

/// Share of the corners of triangles beyond either side of the core box.
const OUTLYING: f32 = 0.01;

/// Smallest share of all rays that hit something, and of those the smallest that hit a front.
const MIN_ENCLOSED: f32 = 0.75;

/// Smallest longest view of a room whose surfaces do not face its inside, as a share of the diagonal of the scene.
const MIN_SHARE_OF_SCENE: f32 = 0.5;

/// Rooms higher than this, in meters, are in other units: the eye is at 0.4 of their height.
const MAX_ROOM_HEIGHT_M: f32 = 60.0;

/// A camera, if there is anything to see.
pub(super) fn make(mesh: &Mesh, materials: &[Material]) -> Option<Camera> {
    let (lo, hi) = mesh.bounds()?;
    Some(indoors(mesh, materials).unwrap_or_else(|| outdoors(lo, hi)))
}

/// A three-quarter view from outside that holds the bounding sphere.
fn outdoors(lo: Vec3, hi: Vec3) -> Camera {
    let center = 0.5 * (lo + hi);
    let radius = (0.5 * (hi - lo).length()).max(1e-6);
    let distance = 1.05 * radius / (0.5 * OBJECT_YFOV_RAD).sin();
    let eye = center + Vec3::new(0.6, 0.45, 0.8).normalize() * distance;
    Camera::look_at("made: outside", eye, center, OBJECT_YFOV_RAD, DEFAULT_ASPECT)
}

/// The box of most corners of triangles: a ground or a sky around a house has few, but is all of its bounds.
fn core_box(mesh: &Mesh) -> (Vec3, Vec3) {
    let quantile = |axis: usize, share: f32| {
        let mut values: Vec<f32> = mesh.triangles.iter().flatten().map(|&v| mesh.positions[v as usize][axis]).collect();
        let place = ((values.len() - 1) as f32 * share).round() as usize;
        *values.select_nth_unstable_by(place, f32::total_cmp).1
    };
    let corner = |share: f32| Vec3::new(quantile(0, share), quantile(1, share), quantile(2, share));
    (corner(OUTLYING), corner(1.0 - OUTLYING))
}

/// The best view from within a room, `None` if there is no room.
fn indoors(mesh: &Mesh, materials: &[Material]) -> Option<Camera> {
    let (lo, hi) = core_box(mesh);
    let size = hi - lo;
    if size.min_element() < MIN_ROOM_M {
        return None;
    }
    let room = Room::new(mesh, materials, size.length());
    let heights = [lo.y + EYE_HEIGHT_M.min(0.5 * size.y), 0.5 * (lo.y + hi.y)];
    let candidates: Vec<Vec3> = heights
        .into_iter()
        .flat_map(|y| (0..GRID * GRID).map(move |i| (y, i % GRID, i / GRID)))
        .map(|(y, i, j)| {
            let along = |k: usize| (k as f32 + 0.5) / GRID as f32;
            Vec3::new(lo.x + size.x * along(i), y, lo.z + size.z * along(j))
        })
        .collect();
    let views: Vec<Option<View>> = candidates.par_iter().map(|&candidate| room.view_from(candidate)).collect();
    let best = views.into_iter().flatten().max_by(|a, b| a.score.total_cmp(&b.score))?;
    Some(Camera::look_at("made: inside", best.eye, best.eye + best.forward, INDOOR_YFOV_RAD, DEFAULT_ASPECT))
}

/// A possible camera; a higher score sees more.
struct View {
    eye: Vec3,
    forward: Vec3,
    score: f32,
}

/// Answers rays through the scene.
struct Room<'a> {
    bvh: Bvh,
    mesh: &'a Mesh,
    materials: &'a [Material],
    /// Diagonal of the core box, meters.
    extent: f32,
}

impl<'a> Room<'a> {
    fn new(mesh: &'a Mesh, materials: &'a [Material], extent: f32) -> Self {
        let ids: Vec<u32> = (0..mesh.triangles.len() as u32).collect();
        let corners: Vec<[Vec3; 3]> = ids.iter().map(|&id| mesh.corners(id)).collect();
        Room { bvh: Bvh::build(&corners, &ids), mesh, materials, extent }
    }

    /// Distance to the first surface, and which side it shows.
    fn cast(&self, origin: Vec3, direction: Vec3) -> Option<(f32, Side)> {
        let hit = self.bvh.closest(&Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY })?;
        let material = self.materials.get(self.mesh.triangle_material[hit.triangle as usize] as usize);
        let side = if self.mesh.area_normal(hit.triangle).dot(direction) < 0.0 {
            Side::Front
        } else if material.is_some_and(|material| material.double_sided) {
            Side::DoubleSidedBack
        } else {
            Side::Back
        };
        Some((hit.t, side))
    }

    /// The best direction from above the floor below a point, `None` unless the point is in a room with space around.
    fn view_from(&self, point: Vec3) -> Option<View> {
        let (depth, _) = self.cast(point, Vec3::NEG_Y)?;
        let floor = point.y - depth;
        let ceiling = self.cast(point, Vec3::Y).map_or(f32::INFINITY, |(height, _)| point.y + height);
        let height = ceiling - floor;
        let above_floor =
            if height > MAX_ROOM_HEIGHT_M { 0.4 * height.min(self.extent) } else { EYE_HEIGHT_M.min(0.6 * height) };
        let eye = point.with_y(floor + above_floor);
        let enclosure = self.enclosure(eye)?;
        const N_DIRECTIONS: usize = 24;
        let around: Vec<f32> =
            (0..N_DIRECTIONS).map(|i| self.sight(eye, TAU * i as f32 / N_DIRECTIONS as f32)).collect();
        let nearest = around.iter().copied().fold(f32::INFINITY, f32::min);
        let longest = around.iter().copied().fold(0.0, f32::max);
        let small = enclosure == Enclosure::ByBacks && longest < MIN_SHARE_OF_SCENE * self.extent;
        if small || nearest < (0.03 * self.extent).min(0.4) {
            return None;
        }
        // A picture of 16:9 and 60° is about ±45° wide: three directions to each side. The longest of them alone would
        // choose a view through a keyhole.
        let (direction, score) = (0..N_DIRECTIONS)
            .map(|i| {
                let within = |k: usize| around[(i + N_DIRECTIONS + k - 3) % N_DIRECTIONS];
                (i, (0..7).map(|k| within(k).sqrt()).sum::<f32>())
            })
            .max_by(|a, b| a.1.total_cmp(&b.1))?;
        let angle = TAU * direction as f32 / N_DIRECTIONS as f32;
        let forward = Vec3::new(angle.cos(), -0.12, angle.sin()).normalize();
        Some(View { eye, forward, score })
    }

    /// Free length along the horizon, at most the extent of the scene.
    fn sight(&self, eye: Vec3, angle: f32) -> f32 {
        let direction = Vec3::new(angle.cos(), 0.0, angle.sin());
        self.cast(eye, direction).map_or(0.0, |(distance, _)| distance.min(self.extent))
    }

    /// What most rays end on, over a Fibonacci sphere of directions; `None` in the open and inside a solid.
    fn enclosure(&self, eye: Vec3) -> Option<Enclosure> {
        const N_RAYS: usize = 64;
        let golden_angle = PI * (3.0 - 5.0_f32.sqrt());
        let sides: Vec<Side> = (0..N_RAYS)
            .filter_map(|i| {
                let y = 1.0 - 2.0 * (i as f32 + 0.5) / N_RAYS as f32;
                let (sin, cos) = (golden_angle * i as f32).sin_cos();
                let across = (1.0 - y * y).sqrt();
                self.cast(eye, Vec3::new(cos * across, y, sin * across)).map(|(_, side)| side)
            })
            .collect();
        let n_of = |side: Side| sides.iter().filter(|&&other| other == side).count();
        let most = MIN_ENCLOSED * sides.len() as f32;
        let n_fronts = n_of(Side::Front);
        if (sides.len() as f32) < MIN_ENCLOSED * N_RAYS as f32
            || ((n_fronts + n_of(Side::DoubleSidedBack)) as f32) < most
        {
            return None;
        }
        Some(if n_fronts as f32 >= most { Enclosure::ByFronts } else { Enclosure::ByBacks })
    }
}

/// Which side of a surface a ray meets.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Side {
    Front,
    DoubleSidedBack,
    Back,
}

/// What the surfaces around a point say about it.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Enclosure {
    /// They face it: a room.
    ByFronts,
    /// Their backs face it, but can be seen: a room or the inside of an object.
    ByBacks,
}
