//! A camera that is moved by hand: around a point, across the view, nearer, and on foot. Mathematics without a window.

use clerestory_transport::camera::{Camera, Film, Pose};
use eframe::egui::{Modifiers, PointerButton, Vec2 as Travel};
use glam::{Vec2, Vec3};
use serde::{Deserialize, Serialize};

use crate::look::lamps::within_reach;

/// What a gesture does to the camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// On the spot, so that what was under the pointer stays there.
    Look,
    /// Around the point that it looks at.
    Orbit,
    /// Across the view.
    Pan,
    /// Nearer or farther.
    Dolly,
}

/// Whose habits the gestures follow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Navigation {
    /// The middle button turns, with Shift it moves, with Ctrl and with the wheel it comes nearer.
    #[default]
    Blender,
    /// With Alt the left button turns, the middle one moves, the right one comes nearer.
    AltMouse,
    /// Two fingers turn, with Shift they move, with Ctrl or apart they come nearer.
    Trackpad,
}

impl Navigation {
    /// All of them, with their names and what they mean.
    pub const ALL: [(Navigation, &'static str, &'static str); 3] = [
        (Navigation::Blender, "Blender", "Middle drag turns, with Shift it moves; the wheel comes nearer"),
        (
            Navigation::AltMouse,
            "Alt + mouse",
            "Alt + left drag turns, Alt + middle drag moves, Alt + right drag comes nearer",
        ),
        (Navigation::Trackpad, "Trackpad", "Two fingers turn, with Shift they move; a pinch comes nearer"),
    ];

    /// What is said to who has just taken the camera in hand.
    pub fn in_hand(self) -> &'static str {
        match self {
            Navigation::Blender | Navigation::AltMouse => {
                "Camera: drag to look around, Shift + drag to move, wheel to come nearer"
            }
            Navigation::Trackpad => "Camera: two fingers turn it, with Shift they move it, a pinch comes nearer",
        }
    }

    /// What a drag with a button means. Without keys the left one looks around in all of them: inside a room there is often no
    /// place to stand behind what is turned around.
    pub fn of_drag(self, button: PointerButton, keys: Modifiers) -> Option<Turn> {
        match (self, button) {
            (Navigation::AltMouse, PointerButton::Middle) if keys.alt => Some(Turn::Pan),
            (Navigation::AltMouse, PointerButton::Secondary) if keys.alt => Some(Turn::Dolly),
            (_, PointerButton::Middle) if keys.command => Some(Turn::Dolly),
            (_, PointerButton::Primary | PointerButton::Middle) if keys.shift => Some(Turn::Pan),
            (Navigation::AltMouse, PointerButton::Primary) if keys.alt => Some(Turn::Orbit),
            (_, PointerButton::Primary) => Some(Turn::Look),
            (_, PointerButton::Middle) => Some(Turn::Orbit),
            _ => None,
        }
    }

    /// What scrolling means.
    pub fn of_scroll(self, keys: Modifiers) -> Turn {
        match self {
            Navigation::Trackpad if keys.shift => Turn::Pan,
            Navigation::Trackpad => Turn::Orbit,
            _ => Turn::Dolly,
        }
    }
}

/// Radians per point of a drag.
const TURN_PER_POINT: f32 = 0.006;
/// Nearer, per point.
const DOLLY_PER_POINT: f32 = 0.005;
/// Of that, the part of points that are scrolled: a notch of a wheel, 40 points, comes nearer by an eighth.
const DOLLY_OF_SCROLL: f32 = 2.0 / 3.0;
/// Steepest pitch, radians: at the pole left and right would change sides.
const STEEPEST: f32 = 1.55;
/// Distance to what is looked at below which one goes on through it: meters, and of the scene where that is small.
const NEAREST_M: f32 = 0.5;
const NEAREST_OF_SCENE: f32 = 0.05;

/// A camera, and how far the point is that it turns around.
#[derive(Clone, Debug, PartialEq)]
pub struct Flight {
    /// Where it is.
    pub camera: Camera,
    /// Meters along its axis.
    pub pivot_m: f32,
    /// Of those the fewest that a step nearer counts by.
    pub nearest_m: f32,
    /// Shape of the picture, in whose middle that point is.
    pub film: Film,
}

/// Where the middle of a picture lies, in meters for each along the axis of its camera: beside that where the lens is shifted.
pub fn middle(camera: &Camera, film: Film) -> Vec3 {
    let direction = camera.direction(film, 0.5 * Vec2::new(film.width as f32, film.height as f32));
    direction / direction.dot(-camera.world_from_camera.z_axis.truncate())
}

/// The distance below which one goes on through what is looked at, in a scene of some diagonal, meters.
pub fn nearest_m(extent_m: f32) -> f32 {
    NEAREST_M.min(NEAREST_OF_SCENE * extent_m)
}

impl Flight {
    /// Unit direction of the axis.
    pub fn forward(&self) -> Vec3 {
        -self.camera.world_from_camera.z_axis.truncate()
    }

    fn pivot(&self) -> Vec3 {
        self.camera.position() + middle(&self.camera, self.film) * self.pivot_m
    }

    /// Moves by scrolling over so many points, in a picture so many points high.
    pub fn scrolled(&mut self, turn: Turn, travel: Travel, height: f32) {
        let share = if turn == Turn::Dolly { DOLLY_OF_SCROLL } else { 1.0 };
        self.moved(turn, travel * share, height);
    }

    /// Moves by a drag over so many points, in a picture so many points high.
    pub fn moved(&mut self, turn: Turn, travel: Travel, height: f32) {
        match turn {
            Turn::Look => self.look(travel, height),
            Turn::Orbit => self.orbit(travel),
            Turn::Pan => self.pan(travel, height),
            Turn::Dolly => self.dolly((-DOLLY_PER_POINT * travel.y).exp()),
        }
    }

    fn look(&mut self, travel: Travel, height: f32) {
        let rad_per_point = 2.0 * (0.5 * self.camera.yfov_rad).tan() / height.max(1.0);
        let travel = self.level(travel);
        self.turn([-travel.x * rad_per_point, travel.y * rad_per_point]);
    }

    fn orbit(&mut self, travel: Travel) {
        let (pivot, travel) = (self.pivot(), self.level(travel));
        self.turn([travel.x * TURN_PER_POINT, -travel.y * TURN_PER_POINT]);
        self.stand_at(pivot - middle(&self.camera, self.film) * self.pivot_m);
    }

    /// The same way to the right and down as a camera sees it that does not lean.
    fn level(&self, travel: Travel) -> Travel {
        let (sin, cos) = Pose::of(&self.camera).roll_rad.sin_cos();
        Travel::new(travel.x * cos + travel.y * sin, travel.y * cos - travel.x * sin)
    }

    /// Turns on the spot by radians.
    fn turn(&mut self, [right_rad, up_rad]: [f32; 2]) {
        let pose = Pose::of(&self.camera);
        let (yaw_rad, pitch) = (pose.yaw_rad + right_rad, pose.pitch_rad + up_rad);
        // A camera that already looks more steeply may come back, not go on.
        let most = STEEPEST.max(pose.pitch_rad.abs());
        self.camera = self.camera.posed(&Pose { yaw_rad, pitch_rad: pitch.clamp(-most, most), ..pose });
    }

    fn pan(&mut self, travel: Travel, height: f32) {
        let meters_per_point = 2.0 * self.pivot_m * (0.5 * self.camera.yfov_rad).tan() / height.max(1.0);
        let [right, up] = [self.camera.world_from_camera.x_axis, self.camera.world_from_camera.y_axis];
        let step = (up.truncate() * travel.y - right.truncate() * travel.x) * meters_per_point;
        self.stand_at(self.camera.position() + step);
    }

    /// Comes nearer by a factor of the distance below 1, goes away by one above.
    pub fn dolly(&mut self, factor: f32) {
        let step = self.pivot_m.max(self.nearest_m) * (1.0 - factor);
        let from = self.camera.position();
        self.stand_at(from + self.forward() * step);
        let way = (self.camera.position() - from).dot(self.forward());
        self.pivot_m = (self.pivot_m - way).max(self.nearest_m);
    }

    /// Goes right, up and ahead by so many meters, up being that of the world.
    pub fn walk(&mut self, [right, up, ahead]: [f32; 3]) {
        let axis = self.camera.world_from_camera.x_axis.truncate();
        self.stand_at(self.camera.position() + axis * right + Vec3::Y * up + self.forward() * ahead);
    }

    /// Goes there, or to the nearest place that a look holds.
    fn stand_at(&mut self, position: Vec3) {
        if position.is_finite() {
            self.camera.world_from_camera.w_axis = within_reach(position).extend(1.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use eframe::egui::vec2;

    use super::*;
    use crate::look::Look;

    const FILM: Film = Film { width: 160, height: 120 };

    fn flight() -> Flight {
        let camera = Camera::look_at("c", Vec3::new(1.0, 1.5, 4.0), Vec3::new(0.0, 1.0, 0.0), 0.9, 4.0 / 3.0);
        Flight { camera, pivot_m: 4.0, nearest_m: nearest_m(20.0), film: FILM }
    }

    #[test]
    fn what_is_turned_around_stays_in_the_middle_at_its_distance() {
        let mut flight = flight();
        let pivot = flight.pivot();
        flight.moved(Turn::Orbit, vec2(90.0, -40.0), 600.0);
        assert!((flight.camera.position().distance(pivot) - 4.0).abs() < 1e-4);
        let seen = flight.camera.project(FILM, pivot).unwrap();
        assert!((seen - glam::Vec2::new(80.0, 60.0)).length() < 1e-2, "{seen}");
        // Drawn to the right, the camera goes to the left around it; it never goes over the pole.
        let before = super::tests::flight().camera;
        let way = flight.camera.position() - before.position();
        assert!(way.dot(before.world_from_camera.x_axis.truncate()) < 0.0, "{way}");
        flight.moved(Turn::Orbit, vec2(0.0, -9000.0), 600.0);
        assert!((Pose::of(&flight.camera).pitch_rad - STEEPEST).abs() < 1e-3);
    }

    #[test]
    fn with_a_shifted_lens_it_is_turned_around_what_is_in_the_middle_of_the_picture() {
        let mut flight = flight();
        flight.camera.shift = [-0.2, 0.4];
        let pivot = flight.camera.position() + middle(&flight.camera, FILM) * flight.pivot_m;
        let before = flight.camera.position().distance(pivot);
        flight.moved(Turn::Orbit, vec2(90.0, -40.0), 600.0);
        let seen = flight.camera.project(FILM, pivot).unwrap();
        assert!((seen - Vec2::new(80.0, 60.0)).length() < 1e-2, "{seen}");
        assert!((flight.camera.position().distance(pivot) - before).abs() < 1e-4);
    }

    #[test]
    fn what_is_moved_across_stays_under_the_pointer() {
        let mut flight = flight();
        let pivot = flight.pivot();
        let before = flight.camera.project(FILM, pivot).unwrap();
        flight.moved(Turn::Pan, vec2(12.0, 7.0), FILM.height as f32);
        let after = flight.camera.project(FILM, pivot).unwrap();
        assert!((after - before - glam::Vec2::new(12.0, 7.0)).length() < 1e-2, "{before} {after}");
    }

    #[test]
    fn coming_nearer_halves_the_distance_and_goes_on_through() {
        let mut flight = flight();
        let pivot = flight.pivot();
        flight.dolly(0.5);
        assert!((flight.camera.position().distance(pivot) - 2.0).abs() < 1e-4 && (flight.pivot_m - 2.0).abs() < 1e-4);
        for _ in 0..40 {
            flight.dolly(0.5);
        }
        assert!((pivot - flight.camera.position()).dot(flight.forward()) < 0.0, "it has passed");
        assert_eq!(flight.pivot_m, NEAREST_M);
    }

    #[test]
    fn in_a_model_of_centimeters_a_step_nearer_is_a_part_of_it() {
        let camera = Camera::look_at("c", Vec3::new(0.0, 0.0, 0.1), Vec3::ZERO, 0.9, 1.0);
        let mut flight = Flight { camera, pivot_m: 0.1, nearest_m: nearest_m(0.05), film: FILM };
        flight.scrolled(Turn::Dolly, vec2(0.0, 40.0), 600.0);
        assert!((flight.camera.position().z - 0.0875).abs() < 1e-3, "{}", flight.camera.position());
        assert!((flight.pivot_m - flight.camera.position().z).abs() < 1e-6, "{}", flight.pivot_m);
    }

    #[test]
    fn who_goes_away_stays_where_a_look_holds_the_view_and_can_come_back() {
        let mut flight = flight();
        for _ in 0..1000 {
            flight.dolly(1.5);
        }
        let far = flight.camera.position().z;
        let look = Look { bookmarks: vec![flight.camera.clone()], ..Look::default() };
        let (back, warnings) = Look::from_json(&look.to_json()).unwrap();
        assert_eq!((back.bookmarks, warnings.len()), (look.bookmarks, 0), "{far} m");
        flight.dolly(0.5);
        assert!(flight.camera.position().z < 0.9 * far, "{} m", flight.camera.position().z);
    }

    #[test]
    fn a_notch_of_a_wheel_comes_nearer_by_an_eighth() {
        let mut flight = flight();
        let before = flight.pivot_m;
        flight.scrolled(Turn::Dolly, vec2(0.0, 40.0), 600.0);
        assert!((flight.pivot_m / before - 0.875).abs() < 1e-2, "{} of {before}", flight.pivot_m);
    }

    #[test]
    fn who_looks_around_stays_and_what_is_under_the_pointer_follows_it() {
        let mut flight = flight();
        let (eye, thing) = (flight.camera.position(), Vec3::new(0.1, 1.1, 0.0));
        let before = flight.camera.project(FILM, thing).unwrap();
        flight.moved(Turn::Look, vec2(6.0, 4.0), FILM.height as f32);
        let after = flight.camera.project(FILM, thing).unwrap();
        assert_eq!(flight.camera.position(), eye);
        assert!((after - before - glam::Vec2::new(6.0, 4.0)).length() < 0.5, "{before} {after}");
    }

    #[test]
    fn what_is_under_the_pointer_follows_it_where_the_camera_leans_as_well() {
        for roll_rad in [-1.2, 0.7, 3.0] {
            let mut flight = flight();
            flight.camera = flight.camera.posed(&Pose { roll_rad, ..Pose::of(&flight.camera) });
            let thing = Vec3::new(0.1, 1.1, 0.0);
            let before = flight.camera.project(FILM, thing).unwrap();
            flight.moved(Turn::Look, vec2(6.0, 4.0), FILM.height as f32);
            let way = flight.camera.project(FILM, thing).unwrap() - before;
            assert!((way - Vec2::new(6.0, 4.0)).length() < 0.6, "{way} at {roll_rad}");
            assert!((Pose::of(&flight.camera).roll_rad - roll_rad).abs() < 1e-4);
            // Around a point, what lies before that goes with the pointer, too.
            let near = flight.camera.position() + 0.5 * (flight.pivot() - flight.camera.position());
            flight.moved(Turn::Orbit, vec2(20.0, 10.0), FILM.height as f32);
            let way = flight.camera.project(FILM, near).unwrap() - Vec2::new(80.0, 60.0);
            assert!(way.normalize().dot(Vec2::new(2.0, 1.0).normalize()) > 0.95, "{way} at {roll_rad}");
        }
    }

    #[test]
    fn each_habit_has_its_gestures() {
        let (none, alt, shift) = (Modifiers::NONE, Modifiers::ALT, Modifiers::SHIFT);
        let blender = Navigation::Blender;
        assert_eq!(blender.of_drag(PointerButton::Middle, none), Some(Turn::Orbit));
        assert_eq!(blender.of_drag(PointerButton::Middle, shift), Some(Turn::Pan));
        assert_eq!(blender.of_drag(PointerButton::Middle, Modifiers::COMMAND), Some(Turn::Dolly));
        assert_eq!(blender.of_drag(PointerButton::Primary, none), Some(Turn::Look));
        assert_eq!(blender.of_drag(PointerButton::Secondary, none), None);
        let maya = Navigation::AltMouse;
        let all = [PointerButton::Primary, PointerButton::Middle, PointerButton::Secondary];
        assert_eq!(all.map(|button| maya.of_drag(button, alt)), [Turn::Orbit, Turn::Pan, Turn::Dolly].map(Some));
        assert_eq!(Navigation::Trackpad.of_scroll(none), Turn::Orbit);
        assert_eq!(Navigation::Trackpad.of_scroll(shift), Turn::Pan);
        assert_eq!(blender.of_scroll(none), Turn::Dolly);
    }
}
