//! Where a camera stands and looks, in the numbers that people set: yaw, pitch, roll.

use glam::{Mat3, Mat4, Vec3};

use super::Camera;

/// Place and direction of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// World space, meters.
    pub position: Vec3,
    /// Compass direction in radians: 0 looks along −Z, a quarter turn along +X, as azimuths of the sun do.
    pub yaw_rad: f32,
    /// Radians above the horizon.
    pub pitch_rad: f32,
    /// Radians by which the camera leans to its left.
    pub roll_rad: f32,
}

/// Sine of the pitch from which on a camera counts as looking straight up or down.
const STRAIGHT: f32 = 0.999_99;

impl Pose {
    /// That of a camera. One that looks straight up or down has no roll.
    pub fn of(camera: &Camera) -> Pose {
        let [right, up, back] = [0, 1, 2].map(|axis| camera.world_from_camera.col(axis).truncate());
        let forward = -back;
        let pitch_rad = forward.y.clamp(-1.0, 1.0).asin();
        let position = camera.position();
        if forward.y.abs() > STRAIGHT {
            return Pose { position, yaw_rad: right.z.atan2(right.x), pitch_rad, roll_rad: 0.0 };
        }
        let yaw_rad = forward.x.atan2(-forward.z);
        let level = Vec3::new(yaw_rad.cos(), 0.0, yaw_rad.sin());
        let roll_rad = (-up.dot(level)).atan2(right.dot(level));
        Pose { position, yaw_rad, pitch_rad, roll_rad }
    }

    /// Camera to world.
    pub fn world_from_camera(&self) -> Mat4 {
        let turn = Mat3::from_rotation_y(-self.yaw_rad)
            * Mat3::from_rotation_x(self.pitch_rad)
            * Mat3::from_rotation_z(self.roll_rad);
        Mat4::from_translation(self.position) * Mat4::from_mat3(turn)
    }
}

impl Camera {
    /// The same camera elsewhere.
    pub fn posed(&self, pose: &Pose) -> Camera {
        Camera { world_from_camera: pose.world_from_camera(), ..self.clone() }
    }

    /// The same place seen with a level camera: what was in the middle stays there by shift, and verticals stand upright. One that
    /// looks too steeply for that stays as it is.
    pub fn upright(&self) -> Camera {
        let half_height = (0.5 * self.yfov_rad).tan();
        let half_width = half_height * self.aspect;
        let level = self.posed(&Pose { pitch_rad: 0.0, roll_rad: 0.0, ..Pose::of(self) });
        // Where the middle of the picture lies, as the level camera has it.
        let middle = Vec3::new(2.0 * self.shift[0] * half_width, 2.0 * self.shift[1] * half_height, -1.0);
        let middle = self.world_from_camera.transform_vector3(middle);
        let middle = level.world_from_camera.inverse().transform_vector3(middle);
        let shift = [middle.x / half_width, middle.y / half_height].map(|aside| aside / (-2.0 * middle.z));
        let is_within = shift.iter().all(|part| part.abs() <= Camera::MOST_SHIFT);
        let is_steep = middle.y.atan2(-middle.z).abs() > STEEPEST_RAD;
        if is_within && !is_steep { Camera { shift, ..level } } else { self.clone() }
    }
}

/// Steepest view that a shift can stand in for, radians.
const STEEPEST_RAD: f32 = 1.2;

#[cfg(test)]
mod tests {
    use glam::Vec2;

    use super::*;
    use crate::camera::Film;

    #[test]
    fn a_pose_comes_back_and_its_angles_are_those_of_a_compass() {
        for (yaw, pitch, roll) in [(0.0, 0.0, 0.0), (1.0, -0.4, 0.2), (-2.8, 1.2, -1.0), (3.0, 0.1, 2.0)] {
            let pose = Pose { position: Vec3::new(1.0, 2.0, -3.0), yaw_rad: yaw, pitch_rad: pitch, roll_rad: roll };
            let camera = Camera::look_at("c", Vec3::ZERO, Vec3::X, 1.0, 1.5).posed(&pose);
            let back = Pose::of(&camera);
            for (a, b) in [(back.yaw_rad, yaw), (back.pitch_rad, pitch), (back.roll_rad, roll)] {
                assert!((a - b).abs() < 1e-4, "{back:?}");
            }
            assert_eq!(back.position, pose.position);
        }
        let east = Pose::of(&Camera::look_at("east", Vec3::ZERO, Vec3::new(1.0, 1.0, 0.0), 1.0, 1.0));
        let quarter = std::f32::consts::FRAC_PI_2;
        assert!((east.yaw_rad - quarter).abs() < 1e-6 && (east.pitch_rad - quarter / 2.0).abs() < 1e-6, "{east:?}");
        let down = Camera::look_at("down", Vec3::ZERO, Vec3::NEG_Y, 1.0, 1.0);
        let again = down.posed(&Pose::of(&down));
        let px = Vec2::new(3.0, 9.0);
        let film = Film { width: 20, height: 20 };
        assert!(again.direction(film, px).distance(down.direction(film, px)) < 1e-3);
    }

    #[test]
    fn an_upright_camera_keeps_its_middle_where_the_lens_was_shifted_or_the_camera_leaned() {
        let film = Film { width: 160, height: 90 };
        let middle = Vec2::new(80.0, 45.0);
        let posed = |pitch_rad: f32, roll_rad: f32, shift: [f32; 2]| {
            let camera = Camera::look_at("c", Vec3::ZERO, Vec3::X, 0.9, 16.0 / 9.0);
            let pose = Pose { position: Vec3::new(2.0, 1.6, 5.0), yaw_rad: 0.7, pitch_rad, roll_rad };
            Camera { shift, ..camera.posed(&pose) }
        };
        for camera in [posed(0.5, 0.0, [0.25, 0.0]), posed(-0.4, 0.0, [-0.3, 0.2]), posed(0.3, 0.4, [0.2, -0.1])] {
            let upright = camera.upright();
            assert!(Pose::of(&upright).pitch_rad.abs() < 1e-6 && Pose::of(&upright).roll_rad.abs() < 1e-6);
            let [before, after] = [&camera, &upright].map(|camera| camera.direction(film, middle));
            assert!(before.distance(after) < 1e-5, "{before} is not {after}");
        }
        // By hand: at a pitch of 30° what lies on the axis is nearer by the cosine along the level one.
        let upright = posed(30f32.to_radians(), 0.0, [0.25, 0.0]).upright();
        let expected = [0.25 / 0.866_025, 0.577_350 / (2.0 * 0.45f32.tan())];
        for (found, expected) in upright.shift.into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-5, "{found} is not {expected}");
        }
    }

    #[test]
    fn an_upright_camera_keeps_its_middle_and_stands_verticals_upright() {
        let film = Film { width: 160, height: 90 };
        let eye = Vec3::new(2.0, 1.6, 5.0);
        let tilted = Camera::look_at("up", eye, Vec3::new(0.0, 4.0, -1.0), 0.9, 16.0 / 9.0);
        let upright = tilted.upright();
        let middle = Vec2::new(80.0, 45.0);
        assert!(upright.direction(film, middle).distance(tilted.direction(film, middle)) < 1e-5);
        // The edge of a wall: by hand, a vertical line of the world is a vertical line of the picture.
        let seen = |camera: &Camera, y: f32| camera.project(film, Vec3::new(-1.0, y, -2.0)).unwrap();
        let [foot, head] = [0.0, 6.0].map(|y| seen(&upright, y));
        assert!((foot.x - head.x).abs() < 1e-3 && foot.y > head.y, "{foot} {head}");
        let [foot, head] = [0.0, 6.0].map(|y| seen(&tilted, y));
        assert!((foot.x - head.x).abs() > 1.0, "tilted, it leans: {foot} {head}");
        // Already level: nothing moves.
        assert!((upright.upright().shift[1] - upright.shift[1]).abs() < 1e-5);
        let steep = Camera::look_at("steep", eye, eye + Vec3::new(0.1, 3.0, 0.0), 0.9, 1.0);
        assert_eq!(steep.upright(), steep);
    }
}
