//! `--view` and `--shift`: a place to look from that no camera of the file has.

use clerestory_transport::camera::{Camera, Pose};
use glam::Vec3;

/// Coordinates in meters.
const PLACE_M: std::ops::RangeInclusive<f32> = -1e6..=1e6;
/// Vertical angles of view.
const FOV_DEG: std::ops::RangeInclusive<f32> = 1.0..=170.0;
/// Vertical angle of view of one that is not given.
const DEFAULT_FOV_DEG: f32 = 50.0;

/// Where to look from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    /// Place and direction.
    pub pose: Pose,
    /// Vertical angle of view in radians.
    pub yfov_rad: f32,
}

impl Viewpoint {
    /// A camera there, of the aspect of another one.
    pub fn camera(&self, like: &Camera) -> Camera {
        let camera = Camera { name: "view".into(), yfov_rad: self.yfov_rad, shift: [0.0; 2], ..like.clone() };
        camera.posed(&self.pose)
    }
}

/// Numbers with commas between them.
fn numbers(text: &str) -> Option<Vec<f32>> {
    let numbers: Option<Vec<f32>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    numbers.filter(|numbers| numbers.iter().all(|number: &f32| number.is_finite()))
}

/// X,Y,Z,YAW,PITCH and, if given, FOV and ROLL.
pub(super) fn parse_view(text: &str) -> Result<Viewpoint, String> {
    let problem = || {
        "write X,Y,Z in meters, then yaw and pitch in degrees, the field of view from 1 to 170 if it is not 50, and the \
         roll, such as 1,1.6,4,0,-10,45"
            .to_owned()
    };
    let numbers = numbers(text).filter(|numbers| (5..=7).contains(&numbers.len())).ok_or_else(problem)?;
    let fov = numbers.get(5).copied().unwrap_or(DEFAULT_FOV_DEG);
    let roll = numbers.get(6).copied().unwrap_or(0.0);
    let is_sound = numbers[..3].iter().all(|meters| PLACE_M.contains(meters))
        && numbers[4].abs() <= 90.0
        && FOV_DEG.contains(&fov);
    if !is_sound {
        return Err(problem());
    }
    let pose = Pose {
        position: Vec3::from_slice(&numbers[..3]),
        yaw_rad: numbers[3].to_radians(),
        pitch_rad: numbers[4].to_radians(),
        roll_rad: roll.to_radians(),
    };
    Ok(Viewpoint { pose, yfov_rad: fov.to_radians() })
}

/// X,Y in widths and heights of the picture.
pub(super) fn parse_shift(text: &str) -> Result<[f32; 2], String> {
    let most = Camera::MOST_SHIFT;
    let sound = numbers(text).filter(|shift| shift.iter().all(|part| part.abs() <= most));
    let shift = sound.and_then(|shift| <[f32; 2]>::try_from(shift).ok());
    shift
        .ok_or_else(|| format!("write X,Y in widths and heights of the picture, from -{most} to {most}, such as 0,0.2"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::panels::camera::option_words;

    #[test]
    fn a_view_that_the_window_copied_is_the_same_view() {
        let like = Camera::look_at("c", Vec3::ZERO, Vec3::X, 0.7, 1.5);
        let camera = Camera::look_at("d", Vec3::new(1.0, 1.6, 4.0), Vec3::new(-2.0, 0.0, 1.0), 0.9, 1.5);
        let camera = Camera { shift: [0.1, -0.25], ..camera };
        let words = option_words(&camera);
        let (view, shift) = words.split_once(' ').unwrap();
        let back = parse_view(view.strip_prefix("--view=").unwrap()).unwrap().camera(&like);
        assert!((back.yfov_rad - camera.yfov_rad).abs() < 1e-5 && back.name == "view");
        assert!(back.world_from_camera.abs_diff_eq(camera.world_from_camera, 1e-4), "{back:?}");
        assert_eq!(parse_shift(shift.strip_prefix("--shift=").unwrap()).unwrap(), camera.shift);
    }

    #[test]
    fn a_view_of_a_model_of_millimeters_is_copied_as_well() {
        let camera = Camera::look_at("d", Vec3::new(1.234e-3, 5.678e-5, -2.5e-3), Vec3::ZERO, 0.9, 1.5);
        let words = option_words(&camera);
        let back = parse_view(words.strip_prefix("--view=").unwrap()).unwrap().camera(&camera);
        assert!(back.position().distance(camera.position()) < 1e-9, "{words}");
    }

    #[test]
    fn views_and_shifts_that_make_no_sense_are_refused() {
        for bad in
            ["", "1,2,3", "1,2,3,4,91", "1,2,3,4,5,0", "1,2,3,4,5,60,7,8", "nan,0,0,0,0", "1;2;3;4;5", "9e9,0,0,0,0"]
        {
            assert!(parse_view(bad).is_err(), "{bad} was accepted");
        }
        for bad in ["", "1", "0,9", "0,0,0", "inf,0"] {
            assert!(parse_shift(bad).is_err(), "{bad} was accepted");
        }
        assert_eq!(parse_view("0,1,2,30,-5").unwrap().yfov_rad, DEFAULT_FOV_DEG.to_radians());
    }
}
