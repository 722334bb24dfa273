//! How a lamp is turned: level where it can be, by a turn about its aim, and carried along while the aim moves.
//!
//! No rule that looks at the aim alone can turn a lamp without a jump somewhere. Level frames jump straight below and straight
//! above, so near there a lamp that is moved keeps its frame, and its turn changes instead.

use std::f32::consts::{PI, TAU};

use glam::{Quat, Vec3};

use super::FreeLamp;

/// Sines of the angle to the vertical: below the first a lamp that moves keeps its frame, above the second its turn.
const STEEP: [f32; 2] = [0.3, 0.6];

impl FreeLamp {
    /// Unit vectors to its right, its upper side, and where it shines; right-handed with the last one turned round.
    pub fn frame(&self) -> [Vec3; 3] {
        let [right, up, ahead] = self.level_frame();
        if self.turn_rad == 0.0 || !self.shape.is_turnable() {
            return [right, up, ahead];
        }
        let (sin, cos) = self.turn_rad.sin_cos();
        [right * cos - up * sin, up * cos + right * sin, ahead]
    }

    /// Shines from another place towards another aim. A small step turns it little, whatever it shines towards.
    pub fn point(&mut self, position: Vec3, aim: Vec3) {
        let before = self.frame();
        (self.position, self.aim) = (position, aim);
        if !self.shape.is_turnable() {
            return;
        }
        let sine = [before[2], self.frame()[2]].map(|ahead| ahead.x.hypot(ahead.z)).into_iter().fold(1.0, f32::min);
        let keeps_frame = ((STEEP[1] - sine) / (STEEP[1] - STEEP[0])).clamp(0.0, 1.0);
        self.turn_rad = half_turn(self.turn_rad + keeps_frame * half_turn(self.turn_of(&before) - self.turn_rad));
    }

    /// The turn of a lamp between two others, from the first at 0 to the second at 1: while its aim moves, it turns evenly.
    pub fn turn_between(&self, [first, second]: [&FreeLamp; 2], share: f32) -> f32 {
        if !self.shape.is_turnable() {
            return first.turn_rad;
        }
        let [from, to] = [first, second].map(|lamp| self.turn_of(&lamp.frame()));
        half_turn(from + share * half_turn(to - from))
    }

    /// Right, up and ahead, unit vectors: level to the right where it can be. A lamp that aims at itself looks down.
    fn level_frame(&self) -> [Vec3; 3] {
        let ahead = (self.aim - self.position).as_dvec3().try_normalize().map_or(Vec3::NEG_Y, |ahead| ahead.as_vec3());
        let up = if ahead.y.abs() > 0.999_999 { Vec3::NEG_Z } else { Vec3::Y };
        let right = ahead.cross(up).normalize();
        [right, right.cross(ahead), ahead]
    }

    /// The turn that has a frame where the shortest way brings it from its own direction to this lamp's.
    fn turn_of(&self, [right_there, _, ahead_there]: &[Vec3; 3]) -> f32 {
        let [right, up, ahead] = self.level_frame();
        let carried = Quat::from_rotation_arc(*ahead_there, ahead) * *right_there;
        (-carried.dot(up)).atan2(carried.dot(right))
    }
}

/// The same turn within half a turn of none, radians.
pub fn half_turn(angle: f32) -> f32 {
    if angle.abs() <= PI { angle } else { (angle + PI).rem_euclid(TAU) - PI }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lamps::LampShape;
    use crate::lamps::tests::lamp;

    /// Greatest step of the right side of a rectangle while its aim goes along a path, and where it comes to.
    fn walked(mut lamp: FreeLamp, path: impl Fn(f32) -> Vec3) -> (f32, FreeLamp) {
        let mut most = 0f32;
        lamp.point(lamp.position, path(0.0));
        for step in 1..=400 {
            let before = lamp.frame()[0];
            lamp.point(lamp.position, path(step as f32 / 400.0));
            most = most.max(lamp.frame()[0].distance(before));
        }
        (most, lamp)
    }

    #[test]
    fn an_aim_that_passes_straight_down_or_up_turns_the_lamp_no_more_than_elsewhere() {
        let rectangle = lamp(LampShape::Rectangle { size_m: [1.6, 0.05] });
        for (y, radius) in [(0.0, 1e-4), (0.0, 0.01), (0.0, 0.2), (0.0, 0.4), (2.0, 0.05), (2.0, 0.5)] {
            let around = |at: f32| Vec3::new(radius * (TAU * at).cos(), y, radius * (TAU * at).sin());
            assert!(walked(rectangle.clone(), around).0 < 0.03, "around at {radius} m");
            let over = |at: f32| Vec3::new(radius * (2.0 * at - 1.0), y, 0.1 * radius);
            assert!(walked(rectangle.clone(), over).0 < 0.03, "over it within {radius} m");
        }
        let profile = lamp(LampShape::Profile { file: "a.ies".into() });
        assert!(walked(profile, |at| Vec3::new(2.0 * at - 1.0, 0.0, 0.0)).0 < 0.03);
    }

    #[test]
    fn a_lamp_that_looks_ahead_stays_level_and_one_that_is_carried_back_returns() {
        let ahead = FreeLamp { aim: Vec3::new(1.0, 0.5, 0.0), ..lamp(LampShape::Rectangle { size_m: [0.6, 0.2] }) };
        let (_, moved) = walked(ahead, |at| Vec3::new((TAU * at).cos(), 0.5, (TAU * at).sin()));
        assert_eq!(moved.turn_rad, 0.0);
        let below = FreeLamp { turn_rad: 0.5, ..lamp(LampShape::Rectangle { size_m: [0.6, 0.2] }) };
        let mut back = below.clone();
        back.point(back.position, Vec3::new(0.3, 0.0, 0.1));
        assert!((back.turn_rad - 0.5).abs() > 0.1, "{}", back.turn_rad);
        back.point(back.position, Vec3::ZERO);
        assert!((back.turn_rad - 0.5).abs() < 1e-5, "{}", back.turn_rad);
    }

    #[test]
    fn a_turn_is_clockwise_as_the_lamp_looks_and_only_of_what_has_sides() {
        let turn_rad = 0.5 * PI;
        let rectangle = FreeLamp { turn_rad, ..lamp(LampShape::Rectangle { size_m: [0.6, 0.2] }) };
        assert!(rectangle.frame()[0].distance(Vec3::Z) < 1e-6, "from above it went from +X to +Z");
        assert!(rectangle.frame()[1].distance(rectangle.frame()[0].cross(Vec3::NEG_Y)) < 1e-6);
        let disk = FreeLamp { turn_rad, ..lamp(LampShape::Disk { radius_m: 0.2 }) };
        assert_eq!(disk.frame()[0], Vec3::X);
    }

    #[test]
    fn between_two_lamps_the_turn_is_even_and_ends_at_theirs() {
        let rectangle = lamp(LampShape::Rectangle { size_m: [1.6, 0.05] });
        let [first, second] = [(-1.0, 0.4), (1.0, -0.3)].map(|(x, turn_rad)| FreeLamp {
            aim: Vec3::new(x, 0.0, 0.05),
            turn_rad,
            ..rectangle.clone()
        });
        let at = |share: f32| {
            let mut between = FreeLamp { aim: first.aim.lerp(second.aim, share), ..first.clone() };
            between.turn_rad = between.turn_between([&first, &second], share);
            between.frame()[0]
        };
        assert!(at(0.0).distance(first.frame()[0]) < 1e-5 && at(1.0).distance(second.frame()[0]) < 1e-5);
        for step in 0..200 {
            assert!(at(step as f32 / 200.0).distance(at((step + 1) as f32 / 200.0)) < 0.04);
        }
    }
}
