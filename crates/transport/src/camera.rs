//! The camera: which ray belongs to which point of the film.

mod pose;

use std::fmt;

use glam::{Mat4, Vec2, Vec3};
use serde::{Deserialize, Serialize};

pub use self::pose::Pose;

/// A perspective pinhole camera. It looks along its local −Z, +Y up, as in glTF.
#[derive(Clone, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// Name in the file or `camera N`.
    pub name: String,
    /// Camera to world, rotation and translation only.
    pub world_from_camera: Mat4,
    /// Vertical angle of view in radians; it stays whatever the film's aspect is.
    pub yfov_rad: f32,
    /// Width over height that the file asks for.
    pub aspect: f32,
    /// How far the middle of the picture lies to the right of the camera's axis, in widths of the picture, and above it, in
    /// heights: a level camera that looks up by its lens keeps vertical edges vertical.
    #[serde(default, skip_serializing_if = "is_centered")]
    pub shift: [f32; 2],
}

fn is_centered(shift: &[f32; 2]) -> bool {
    *shift == [0.0; 2]
}

impl fmt::Debug for Camera {
    /// Without a shift that is none: what names a bake is made of this text, and bakes are older than shifts.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Camera { name, world_from_camera, yfov_rad, aspect, shift } = self;
        let mut text = f.debug_struct("Camera");
        text.field("name", name).field("world_from_camera", world_from_camera);
        text.field("yfov_rad", yfov_rad).field("aspect", aspect);
        if !is_centered(shift) {
            text.field("shift", shift);
        }
        text.finish()
    }
}

/// Size of the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Film {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
}

impl Film {
    /// Largest side in pixels.
    pub const MAX_SIDE: u32 = 16_384;

    /// Number of pixels.
    pub fn n_pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// The film that a camera asks for at a given width.
    pub fn of_width(width: u32, camera: &Camera) -> Film {
        let height = (width as f32 / camera.aspect.clamp(0.05, 20.0)).round() as u32;
        Film { width, height: height.clamp(1, Film::MAX_SIDE) }
    }
}

impl Camera {
    /// Largest shift in widths or heights of the picture.
    pub const MOST_SHIFT: f32 = 2.0;

    /// The first camera of a name.
    pub fn named<'a>(cameras: &'a [Camera], name: &str) -> Option<&'a Camera> {
        cameras.iter().find(|camera| camera.name == name)
    }

    /// The same under another name.
    pub(crate) fn called(&self, name: &str) -> Camera {
        Camera { name: name.into(), ..self.clone() }
    }

    /// Looks from `eye` to `target`, +Y up (or −Z up when looking along Y).
    pub fn look_at(name: &str, eye: Vec3, target: Vec3, yfov_rad: f32, aspect: f32) -> Camera {
        let forward = (target - eye).normalize_or(Vec3::NEG_Z);
        let up = if forward.y.abs() > 0.999 { Vec3::NEG_Z } else { Vec3::Y };
        let right = forward.cross(up).normalize();
        let rotation = [right, right.cross(forward), -forward].map(|axis| axis.extend(0.0));
        let world_from_camera = Mat4::from_cols(rotation[0], rotation[1], rotation[2], eye.extend(1.0));
        Camera { name: name.into(), world_from_camera, yfov_rad, aspect, shift: [0.0; 2] }
    }

    /// Whether all its numbers are numbers.
    pub(crate) fn is_finite(&self) -> bool {
        let numbers = [self.yfov_rad, self.shift[0], self.shift[1]];
        self.world_from_camera.is_finite() && numbers.iter().all(|number| number.is_finite())
    }

    /// World-space position in meters.
    pub fn position(&self) -> Vec3 {
        self.world_from_camera.w_axis.truncate()
    }

    /// World-space unit direction through a point of the film; `film_px` in pixels from the top left corner.
    pub fn direction(&self, film: Film, film_px: Vec2) -> Vec3 {
        let half_height = (0.5 * self.yfov_rad).tan();
        let ndc = film_px / Vec2::new(film.width as f32, film.height as f32) * 2.0 - 1.0 + self.shift_ndc();
        let aspect = film.width as f32 / film.height as f32;
        let in_camera = Vec3::new(ndc.x * half_height * aspect, -ndc.y * half_height, -1.0);
        self.world_from_camera.transform_vector3(in_camera).normalize()
    }

    /// The shift where the picture reaches from −1 to 1, y down.
    fn shift_ndc(&self) -> Vec2 {
        Vec2::new(2.0 * self.shift[0], -2.0 * self.shift[1])
    }

    /// Where a world-space point lands on the film in pixels, `None` behind the camera.
    pub fn project(&self, film: Film, point: Vec3) -> Option<Vec2> {
        let p = self.world_from_camera.inverse().transform_point3(point);
        if p.z >= -1e-6 {
            return None;
        }
        let half_height = (0.5 * self.yfov_rad).tan();
        let aspect = film.width as f32 / film.height as f32;
        let ndc = Vec2::new(p.x / (-p.z * half_height * aspect), p.y / (p.z * half_height)) - self.shift_ndc();
        Some((ndc + 1.0) * 0.5 * Vec2::new(film.width as f32, film.height as f32))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn project_undoes_direction() {
        let camera = Camera::look_at("c", Vec3::new(1.0, 2.0, 3.0), Vec3::new(-1.0, 0.5, 0.0), 0.8, 1.5);
        let film = Film { width: 120, height: 80 };
        for shift in [[0.0, 0.0], [0.3, -0.6]] {
            let camera = Camera { shift, ..camera.clone() };
            for px in [Vec2::new(0.5, 0.5), Vec2::new(60.0, 40.0), Vec2::new(119.0, 3.0)] {
                let point = camera.position() + camera.direction(film, px) * 4.0;
                let back = camera.project(film, point).expect("in front");
                assert!((back - px).length() < 1e-2, "{px} came back as {back}");
            }
        }
    }

    #[test]
    fn a_shift_of_half_a_height_brings_the_upper_edge_to_the_middle() {
        let film = Film { width: 90, height: 60 };
        let plain = Camera::look_at("c", Vec3::ZERO, Vec3::NEG_Z, 1.0, 1.5);
        let up = Camera { shift: [0.0, 0.5], ..plain.clone() };
        let right = Camera { shift: [1.0, 0.0], ..plain.clone() };
        let seen = |camera: &Camera, x: f32, y: f32| camera.direction(film, Vec2::new(x, y));
        assert!(seen(&up, 45.0, 30.0).distance(seen(&plain, 45.0, 0.0)) < 1e-6);
        assert!(seen(&right, 0.0, 30.0).distance(seen(&plain, 90.0, 30.0)) < 1e-6);
        // By hand: the camera is level, so that points above each other are drawn above each other, however high.
        let column = [-3.0, 0.0, 2.5, 9.0].map(|y| up.project(film, Vec3::new(1.2, y, -4.0)).expect("in front").x);
        assert!(column.iter().all(|x| (x - column[0]).abs() < 1e-4), "{column:?}");
    }

    #[test]
    fn a_camera_without_shift_is_written_as_ever() {
        let camera = Camera::look_at("c", Vec3::ZERO, Vec3::NEG_Z, 1.0, 1.5);
        assert!(!format!("{camera:?}").contains("shift"));
        let json = serde_json::to_string(&camera).unwrap();
        assert!(!json.contains("shift"), "{json}");
        assert_eq!(serde_json::from_str::<Camera>(&json).unwrap(), camera);
        let shifted = Camera { shift: [0.0, 0.2], ..camera };
        assert!(format!("{shifted:?}").contains("shift"), "a bake of it has another name");
        assert_eq!(serde_json::from_str::<Camera>(&serde_json::to_string(&shifted).unwrap()).unwrap(), shifted);
    }

    #[test]
    fn pixel_zero_is_top_left() {
        let camera = Camera::look_at("c", Vec3::ZERO, Vec3::NEG_Z, 1.0, 1.0);
        let direction = camera.direction(Film { width: 64, height: 64 }, Vec2::ZERO);
        assert!(direction.x < 0.0 && direction.y > 0.0, "{direction}");
    }
}
