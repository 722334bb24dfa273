//! A camera for a scene that has none: inside a room, outside an object.
//!
//! A point is inside a room if most rays from it end on surfaces that face it; inside a solid they end on backs, and in
//! the open they end nowhere, or far away. Backs of double-sided surfaces tell neither: such a space must be most of the
//! scene. Points are tried where triangles are many, as a ground or a sky around a house has few. Among those at eye
//! height over a floor the one with the longest view is taken, which lands in a corner and looks along the diagonal.

use std::f32::consts::{PI, TAU};

use glam::Vec3;
use rayon::prelude::*;

use super::cameras::DEFAULT_ASPECT;
use crate::bvh::{Bvh, Ray};
use crate::camera::Camera;
use crate::scene::{Material, Mesh};
use crate::stop::Stop;

/// Eye height in meters over the floor.
const EYE_HEIGHT_M: f32 = 1.6;

/// Vertical angle of view indoors, radians.
const INDOOR_YFOV_RAD: f32 = PI / 3.0;

/// Vertical angle of view of an object, radians.
const OBJECT_YFOV_RAD: f32 = PI / 4.5;

/// Candidates along each horizontal side of a core box.
const GRID: usize = 9;

/// Compass directions that are looked in.
const N_DIRECTIONS: usize = 24;

/// Fewest of them that end on something: between many objects more lead out than through the windows of a room.
const MIN_DIRECTIONS_CLOSED: usize = 16;

/// Heights over distance at which a view is judged.
const SLOPES: [f32; 3] = [-0.3, 0.0, 0.2];

/// Smallest height and width of a scene that could be a room, meters.
const MIN_ROOM_M: f32 = 1.8;

/// Shares of the corners of triangles beyond either side of a core box, in the order in which the boxes are searched: the
/// ground is more than a hundredth of a house that has few triangles.
const OUTLYING: [f32; 2] = [0.01, 0.1];

/// A scene this many times as large as its first core box is mostly surroundings: the box is shown instead.
const SURROUNDED: f32 = 3.0;

/// Smallest share of all rays that hit something, and of those the smallest that hit a front.
const MIN_ENCLOSED: f32 = 0.75;

/// Smallest longest view of a room whose surfaces do not face its inside, as a share of the diagonal of the scene.
const MIN_SHARE_OF_SCENE: f32 = 0.5;

/// Rooms higher than this, in meters, are in other units: the eye is at 0.4 of their height.
const MAX_ROOM_HEIGHT_M: f32 = 60.0;

/// A camera, if there is anything to see, and somebody who wants to.
pub(super) fn make(mesh: &Mesh, materials: &[Material], stop: &Stop) -> Option<Camera> {
    let bounds = mesh.bounds()?;
    let boxes = OUTLYING.map(|share| core_box(mesh, share));
    let inside = indoors(mesh, materials, &boxes, stop);
    stop.check().ok()?;
    Some(inside.unwrap_or_else(|| {
        let surrounded = diagonal(bounds) > SURROUNDED * diagonal(boxes[0]);
        outdoors(if surrounded { boxes[0] } else { bounds })
    }))
}

/// A three-quarter view from outside that holds the bounding sphere.
fn outdoors((lo, hi): Corners) -> Camera {
    let center = 0.5 * (lo + hi);
    let radius = (0.5 * (hi - lo).length()).max(1e-6);
    let distance = 1.05 * radius / (0.5 * OBJECT_YFOV_RAD).sin();
    let eye = center + Vec3::new(0.6, 0.45, 0.8).normalize() * distance;
    Camera::look_at("made: outside", eye, center, OBJECT_YFOV_RAD, DEFAULT_ASPECT)
}

/// Lowest and highest corner of a box, meters.
type Corners = (Vec3, Vec3);

fn diagonal((lo, hi): Corners) -> f32 {
    (hi - lo).length()
}

/// The box of the corners of triangles but for a share beyond each of its sides.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a place in a list, and at most 2²⁶ triangles"
)]
fn core_box(mesh: &Mesh, outlying: f32) -> Corners {
    let quantile = |axis: usize, share: f32| {
        let mut values: Vec<f32> = mesh.triangles.iter().flatten().map(|&v| mesh.positions[v as usize][axis]).collect();
        #[expect(clippy::arithmetic_side_effects, reason = "a scene has triangles")]
        let place = ((values.len() - 1) as f32 * share).round() as usize;
        *values.select_nth_unstable_by(place, f32::total_cmp).1
    };
    let corner = |share: f32| Vec3::new(quantile(0, share), quantile(1, share), quantile(2, share));
    (corner(outlying), corner(1.0 - outlying))
}

/// The best view from within a room in the first box that has one, `None` if there is no room.
fn indoors(mesh: &Mesh, materials: &[Material], boxes: &[Corners], stop: &Stop) -> Option<Camera> {
    let could_hold_a_room = |&&(lo, hi): &&Corners| (hi - lo).min_element() >= MIN_ROOM_M;
    boxes.iter().find(could_hold_a_room)?;
    let room = Room::new(mesh, materials, diagonal(boxes[0]), stop)?;
    let best = boxes.iter().filter(could_hold_a_room).find_map(|&corners| best_view(&room, corners))?;
    Some(Camera::look_at("made: inside", best.eye, best.eye + best.forward, INDOOR_YFOV_RAD, DEFAULT_ASPECT))
}

/// The best view from a grid of points in a box.
fn best_view(room: &Room, (lo, hi): Corners) -> Option<View> {
    let size = hi - lo;
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
    views.into_iter().flatten().max_by(|a, b| a.score.total_cmp(&b.score))
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
    /// Diagonal of the first core box, meters.
    extent: f32,
    stop: &'a Stop,
}

impl<'a> Room<'a> {
    #[expect(clippy::cast_possible_truncation, reason = "a place in a list, and at most 2²⁶ triangles")]
    fn new(mesh: &'a Mesh, materials: &'a [Material], extent: f32, stop: &'a Stop) -> Option<Self> {
        let ids: Vec<u32> = (0..mesh.triangles.len() as u32).collect();
        let corners: Vec<[Vec3; 3]> = ids.iter().map(|&id| mesh.corners(id)).collect();
        let bvh = Bvh::build_until(&corners, &ids, stop).ok()?;
        Some(Room { bvh, mesh, materials, extent, stop })
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
        self.stop.check().ok()?;
        let (depth, _) = self.cast(point, Vec3::NEG_Y)?;
        let floor = point.y - depth;
        let ceiling = self.cast(point, Vec3::Y).map_or(f32::INFINITY, |(height, _)| point.y + height);
        let height = ceiling - floor;
        if height < MIN_ROOM_M {
            return None;
        }
        let above_floor =
            if height > MAX_ROOM_HEIGHT_M { 0.4 * height.min(self.extent) } else { EYE_HEIGHT_M.min(0.6 * height) };
        let eye = point.with_y(floor + above_floor);
        let enclosure = self.enclosure(eye)?;
        let angle = |i: usize| TAU * i as f32 / N_DIRECTIONS as f32;
        let hits: Vec<f32> = (0..N_DIRECTIONS).filter_map(|i| self.sight(eye, angle(i), 0.0)).collect();
        if hits.len() < MIN_DIRECTIONS_CLOSED {
            return None;
        }
        // An open window is no obstacle, and nothing to look at.
        let nearest = hits.iter().copied().fold(f32::INFINITY, f32::min);
        let longest = hits.into_iter().fold(0.0, f32::max);
        let small = enclosure == Enclosure::ByBacks && longest < MIN_SHARE_OF_SCENE * self.extent;
        if small || nearest < (0.03 * self.extent).min(0.4) {
            return None;
        }
        // A picture of 16:9 and 60° is about ±45° wide and ±30° high: three directions to each side, and as many heights.
        // The longest of them alone would choose a view through a keyhole.
        let seen = |i: usize| {
            let lengths = SLOPES.into_iter().filter_map(|slope| self.sight(eye, angle(i), slope));
            lengths.map(f32::sqrt).sum::<f32>()
        };
        let seen: Vec<f32> = (0..N_DIRECTIONS).map(seen).collect();
        #[expect(clippy::arithmetic_side_effects, reason = "indices below twice `N_DIRECTIONS`")]
        let (direction, score) = (0..N_DIRECTIONS)
            .map(|i| (i, (0..7).map(|k| seen[(i + N_DIRECTIONS + k - 3) % N_DIRECTIONS]).sum::<f32>()))
            .max_by(|a, b| a.1.total_cmp(&b.1))?;
        let forward = Vec3::new(angle(direction).cos(), -0.12, angle(direction).sin()).normalize();
        Some(View { eye, forward, score })
    }

    /// Free length in a compass direction and a slope in meters, `None` if it leads out of the scene.
    fn sight(&self, eye: Vec3, angle: f32, slope: f32) -> Option<f32> {
        let direction = Vec3::new(angle.cos(), slope, angle.sin()).normalize();
        self.cast(eye, direction).map(|(distance, _)| distance).filter(|&distance| distance <= self.extent)
    }

    /// What most rays end on, over a Fibonacci sphere of directions; `None` in the open and inside a solid.
    #[expect(clippy::arithmetic_side_effects, reason = "at most `N_RAYS` in all")]
    fn enclosure(&self, eye: Vec3) -> Option<Enclosure> {
        const N_RAYS: usize = 64;
        let golden_angle = PI * (3.0 - 5.0_f32.sqrt());
        let sides: Vec<Side> = (0..N_RAYS)
            .filter_map(|i| {
                let y = 1.0 - 2.0 * (i as f32 + 0.5) / N_RAYS as f32;
                let (sin, cos) = (golden_angle * i as f32).sin_cos();
                let across = (1.0 - y * y).sqrt();
                self.cast(eye, Vec3::new(cos * across, y, sin * across))
            })
            .filter(|&(distance, _)| distance <= self.extent)
            .map(|(_, side)| side)
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
