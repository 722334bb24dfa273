//! Lamps moved and aimed by the pointer: along an axis, in a plane, over surfaces. Mathematics without a window.

use clerestory_transport::bvh::Ray;
use clerestory_transport::camera::{Camera, Film};
use clerestory_transport::lamps::{FreeLamp, LampShape};
use clerestory_transport::prepared::{PreparedScene, SurfaceHit};
use clerestory_transport::sampler::Sampler;
use eframe::egui::{Pos2, Rect, vec2};
use glam::{Vec2, Vec3};

use crate::look::lamps::{FARTHEST_M, below, within_reach};

/// The world's axes, by index.
pub const AXES: [Vec3; 3] = [Vec3::X, Vec3::Y, Vec3::Z];
/// Names of the axes.
pub const AXIS_NAMES: [&str; 3] = ["X", "Y", "Z"];
/// How far from the camera a drag may carry a lamp, in diameters of the scene, or in its distance where it is farther off than one.
const FARTHEST: f32 = 10.0;
/// How far ahead of a lamp of the file its aim lies at most, in diameters of the scene.
const AHEAD: f32 = 0.3;
/// Least sine between a ray and an axis or plane along which it drags.
const LEAST_SINE: f32 = 0.03;
/// Pointer travel that counts while Shift is held.
const FINE: f32 = 0.1;

/// A picture, and what is seen in it.
#[derive(Clone, Copy)]
pub struct Sight<'a> {
    /// The scene.
    pub scene: &'a PreparedScene,
    /// Where it is seen from.
    pub camera: &'a Camera,
    /// Size of the picture in pixels.
    pub film: Film,
    /// Where the picture is drawn, points.
    pub image: Rect,
}

/// A place on a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// World space, meters.
    pub position: Vec3,
    /// Unit normal towards the viewer.
    pub normal: Vec3,
}

impl Sight<'_> {
    /// Unit direction from the camera through a place on the screen.
    pub fn direction(&self, at: Pos2) -> Vec3 {
        let px = (at - self.image.min) / self.image.size() * vec2(self.film.width as f32, self.film.height as f32);
        self.camera.direction(self.film, Vec2::new(px.x, px.y))
    }

    /// Where a point is seen, in points; `None` behind the camera.
    pub fn seen_at(&self, point: Vec3) -> Option<Pos2> {
        let px = self.camera.project(self.film, point)?;
        let scale = vec2(self.image.width() / self.film.width as f32, self.image.height() / self.film.height as f32);
        Some(self.image.min + vec2(px.x, px.y) * scale)
    }

    /// Meters at the depth of a point that take up one point of the screen; `None` behind the camera.
    pub fn meters_per_point(&self, point: Vec3) -> Option<f32> {
        let depth = -self.camera.world_from_camera.inverse().transform_point3(point).z;
        let meters = 2.0 * depth * (0.5 * self.camera.yfov_rad).tan() / self.image.height();
        (depth > 1e-6).then_some(meters)
    }

    /// The surface that is seen at a place on the screen, through panes.
    pub fn surface(&self, at: Pos2) -> Option<Surface> {
        surface_behind_glass(self.scene, self.camera.position(), self.direction(at))
    }

    /// Unit direction into the picture.
    fn forward(&self) -> Vec3 {
        -self.camera.world_from_camera.z_axis.truncate()
    }

    /// Whether a drag of what is at `from` may lead to a point.
    fn is_near(&self, point: Vec3, from: Vec3) -> bool {
        let eye = self.camera.position();
        point.is_finite() && point.distance(eye) < FARTHEST * self.scene.diameter().max(from.distance(eye))
    }

    /// How far along an axis through a point the pointer is, meters; `None` where one looks along it.
    fn along_axis(&self, point: Vec3, axis: Vec3, at: Pos2) -> Option<f32> {
        nearest_on_axis(point, axis, self.camera.position(), self.direction(at))
            .filter(|along| self.is_near(point + axis * along, point))
    }

    /// Where the pointer is on a plane; `None` where one looks along it.
    fn on_plane(&self, point: Vec3, normal: Vec3, at: Pos2) -> Option<Vec3> {
        meet_plane(point, normal, self.camera.position(), self.direction(at))
            .filter(|place| self.is_near(*place, point))
    }
}

/// The first surface along a ray, its normal towards where the ray comes from.
pub fn surface_along(scene: &PreparedScene, origin: Vec3, direction: Vec3) -> Option<Surface> {
    let ray = Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY };
    scene.closest_seen(&ray, &mut Sampler::new(0, 0, 0)).map(|hit| facing(&hit, direction))
}

/// The same for who looks through panes: what is behind them, or the first of them where nothing is.
pub fn surface_behind_glass(scene: &PreparedScene, origin: Vec3, direction: Vec3) -> Option<Surface> {
    let ray = Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY };
    scene.closest_behind_glass(&ray, &mut Sampler::new(0, 0, 0)).map(|hit| facing(&hit, direction))
}

fn facing(hit: &SurfaceHit, direction: Vec3) -> Surface {
    let normal = if hit.normal.dot(direction) > 0.0 { -hit.normal } else { hit.normal };
    Surface { position: hit.position, normal }
}

/// What of a distance away from a surface lies before the next one, m.
pub fn free_m(scene: &PreparedScene, surface: &Surface, away: Vec3, wanted_m: f32) -> f32 {
    let clear = 1e-3 * wanted_m + 1e-6 * surface.position.abs().max_element();
    let next = surface_along(scene, surface.position + surface.normal * clear, away);
    next.map_or(wanted_m, |next| next.position.distance(surface.position).min(wanted_m))
}

/// The place so far before a surface, but at most half way to the next one.
fn before(scene: &PreparedScene, surface: &Surface, standoff_m: f32) -> Vec3 {
    surface.position + surface.normal * (0.5 * free_m(scene, surface, surface.normal, 2.0 * standoff_m))
}

/// How far along an axis the point is that is nearest to a ray, in units of the axis; `None` where they are all but parallel, or where
/// that is behind the ray, as beyond the point at which the axis vanishes.
pub fn nearest_on_axis(point: Vec3, axis: Vec3, origin: Vec3, direction: Vec3) -> Option<f32> {
    let across = axis.cross(direction);
    let square = across.length_squared();
    if square < LEAST_SINE * LEAST_SINE * axis.length_squared() * direction.length_squared() {
        return None;
    }
    let away = origin - point;
    let is_ahead = away.cross(axis).dot(across) > 0.0;
    is_ahead.then(|| away.cross(direction).dot(across) / square)
}

/// Where a ray meets a plane in front of it; `None` where it all but runs along the plane.
pub fn meet_plane(point: Vec3, normal: Vec3, origin: Vec3, direction: Vec3) -> Option<Vec3> {
    let along = direction.dot(normal);
    let t = (point - origin).dot(normal) / along;
    (along.abs() > LEAST_SINE && t > 0.0).then(|| origin + direction * t)
}

/// How large things are that are seen from `distance_m` and would be a room: 1 where that is a distance in a room.
pub fn scale_of(distance_m: f32) -> f32 {
    let [near, far] = [1.0, 10.0];
    (distance_m / distance_m.clamp(near, far)).max(1e-6)
}

/// How far the middle of a lamp stays from the surface that it is put on, meters: its own size, and a hand's breadth seen
/// from `distance_m`.
pub fn standoff_m(shape: &LampShape, distance_m: f32) -> f32 {
    let body = if let LampShape::Sphere { radius_m } = shape { *radius_m } else { 0.0 };
    let scale = scale_of(distance_m);
    body + (0.04 * distance_m).clamp(0.02 * scale, 0.3 * scale)
}

/// What happens to the aim when a lamp is moved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AimWhileMoving {
    /// It goes along, so that the lamp keeps its direction.
    #[default]
    GoesAlong,
    /// It stays, so that the lamp keeps its target.
    Stays,
}

/// Puts a lamp somewhere else, no farther than a look holds.
pub fn move_to(lamp: &mut FreeLamp, position: Vec3, aim: AimWhileMoving) {
    let mut position = within_reach(position);
    if !lamp.shape.is_aimed() {
        lamp.aim = below(position);
    } else if aim == AimWhileMoving::GoesAlong {
        // What comes to its limit first stops the other one, so that the lamp keeps its direction.
        let [first, last] = [lamp.position.min(lamp.aim), lamp.position.max(lamp.aim)];
        let farthest = Vec3::splat(FARTHEST_M);
        let asked = position - lamp.position;
        let way = asked.max(-farthest - first).min(farthest - last);
        if way != asked {
            position = within_reach(lamp.position + way);
        }
        lamp.aim = within_reach(lamp.aim + way);
    } else {
        lamp.point(position, lamp.aim);
    }
    lamp.position = position;
}

/// Aims a lamp at a place, or at the nearest one that a look holds.
pub fn aim_at(lamp: &mut FreeLamp, aim: Vec3) {
    lamp.point(lamp.position, within_reach(aim));
}

/// What of a lamp is dragged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// The lamp along an axis.
    Axis(usize),
    /// The lamp in the plane across an axis.
    Plane(usize),
    /// The lamp over surfaces; in the plane of the screen while Alt is held.
    Body,
    /// The point that it shines at, over surfaces.
    Aim,
}

/// How a drag goes on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Held {
    /// Shift: a tenth of the way.
    pub fine: bool,
    /// Alt: freely in the plane of the screen.
    pub free: bool,
    /// What happens to the aim.
    pub aim: AimWhileMoving,
}

/// A lamp that is being dragged.
#[derive(Clone, Debug, PartialEq)]
pub struct Drag {
    /// Key of the lamp.
    pub key: String,
    /// What of it.
    pub part: Part,
    /// As it was.
    pub before: FreeLamp,
    /// Where the pointer would be without Shift; for body and aim, where they are seen.
    at: Pos2,
    /// On the axis, or on the plane, where it was taken.
    taken: Vec3,
    /// From the surface under it, meters.
    standoff_m: f32,
}

impl Drag {
    /// Takes a part of a lamp at a place on the screen.
    pub fn begin(sight: &Sight, lamp: &FreeLamp, part: Part, at: Pos2) -> Drag {
        let place = lamp.position;
        let (at, taken) = match part {
            Part::Axis(axis) => {
                let along = sight.along_axis(place, AXES[axis], at).unwrap_or(0.0);
                (at, place + AXES[axis] * along)
            }
            Part::Plane(axis) => (at, sight.on_plane(place, AXES[axis], at).unwrap_or(place)),
            // These stay under the pointer as they were taken: off its middle by as much.
            Part::Body => (sight.seen_at(place).unwrap_or(at), place),
            Part::Aim => (sight.seen_at(lamp.aim).unwrap_or(at), lamp.aim),
        };
        let usual = standoff_m(&lamp.shape, place.distance(sight.camera.position()));
        let own = sight.surface(at).map(|surface| (place - surface.position).dot(surface.normal));
        let standoff_m = own.filter(|own| (0.0..2.0 * usual).contains(own)).unwrap_or(usual);
        Drag { key: lamp.key.clone(), part, before: lamp.clone(), at, taken, standoff_m }
    }

    /// The lamp after the pointer has gone on by `travel` points.
    pub fn moved(&mut self, sight: &Sight, lamp: &FreeLamp, travel: eframe::egui::Vec2, held: Held) -> FreeLamp {
        self.at += if held.fine { travel * FINE } else { travel };
        let (mut moved, start) = (lamp.clone(), self.before.position);
        let to = match self.part {
            Part::Axis(axis) => {
                sight.along_axis(self.taken, AXES[axis], self.at).map(|along| start + AXES[axis] * along)
            }
            Part::Plane(axis) => sight.on_plane(start, AXES[axis], self.at).map(|place| start + place - self.taken),
            Part::Body if held.free => sight.on_plane(lamp.position, sight.forward(), self.at),
            Part::Body => sight.surface(self.at).map(|surface| before(sight.scene, &surface, self.standoff_m)),
            Part::Aim => {
                if let Some(aim) = self.aim(sight, lamp, held) {
                    aim_at(&mut moved, aim);
                }
                None
            }
        };
        if let Some(to) = to {
            move_to(&mut moved, to, held.aim);
        }
        moved
    }

    fn aim(&self, sight: &Sight, lamp: &FreeLamp, held: Held) -> Option<Vec3> {
        let surface = if held.free { None } else { sight.surface(self.at) };
        surface.map(|surface| surface.position).or_else(|| sight.on_plane(lamp.aim, sight.forward(), self.at))
    }
}

/// A lamp of a shape where a surface is seen, shining away from it.
pub fn put_on(mut lamp: FreeLamp, surface: Surface, eye: Vec3, scene: &PreparedScene) -> FreeLamp {
    let distance_m = surface.position.distance(eye);
    lamp.position = before(scene, &surface, standoff_m(&lamp.shape, distance_m));
    let ahead = surface.normal * scale_of(distance_m);
    lamp.aim = if lamp.shape.is_aimed() { lamp.position + ahead } else { below(lamp.position) };
    lamp
}

/// A lamp of the file, whose aim is a meter ahead of it: no farther than a part of the scene, beyond which nobody could take hold of it.
pub fn aimed_within(lamp: FreeLamp, scene: &PreparedScene) -> FreeLamp {
    // Where coordinates are large, rounding would turn what aims at something close.
    let least_m = 0.01 * lamp.position.length();
    let ahead_m = (AHEAD * scene.diameter()).max(least_m).min(1.0);
    FreeLamp { aim: lamp.position.lerp(lamp.aim, ahead_m), ..lamp }
}

#[cfg(test)]
mod tests;
