//! The panels at the sides of the picture: which of them are open, and for how many of them a window has room.

use serde::{Deserialize, Serialize};

use crate::action::Side;

/// Points of a window that has room for both and a picture.
const ROOM_FOR_BOTH: f32 = 860.0;

/// The panels that are open.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub(super) struct Sides {
    lights: bool,
    settings: bool,
    /// The one that is seen where there is room for one.
    front: Side,
}

impl Default for Sides {
    fn default() -> Sides {
        Sides { lights: true, settings: true, front: Side::Lights }
    }
}

impl Sides {
    /// Whether a panel is seen in a window so many points wide.
    pub fn shows(self, side: Side, width: f32) -> bool {
        let other = if side == Side::Lights { Side::Settings } else { Side::Lights };
        self.is_open(side) && (width >= ROOM_FOR_BOTH || self.front == side || !self.is_open(other))
    }

    /// Closes a panel that is seen, opens one that is not. Where there is room for one, the other one is behind it.
    pub fn toggle(&mut self, side: Side, width: f32) {
        let opens = !self.shows(side, width);
        match side {
            Side::Lights => self.lights = opens,
            Side::Settings => self.settings = opens,
        }
        if opens {
            self.front = side;
        }
    }

    fn is_open(self, side: Side) -> bool {
        match side {
            Side::Lights => self.lights,
            Side::Settings => self.settings,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(sides: Sides, width: f32) -> [bool; 2] {
        [Side::Lights, Side::Settings].map(|side| sides.shows(side, width))
    }

    #[test]
    fn a_wide_window_has_both_panels_and_each_opens_and_closes_for_itself() {
        let (mut sides, wide) = (Sides::default(), 1440.0);
        assert_eq!(seen(sides, wide), [true, true]);
        sides.toggle(Side::Lights, wide);
        assert_eq!(seen(sides, wide), [false, true]);
        sides.toggle(Side::Settings, wide);
        assert_eq!(seen(sides, wide), [false, false]);
        sides.toggle(Side::Lights, wide);
        assert_eq!(seen(sides, wide), [true, false]);
    }

    #[test]
    fn a_narrow_window_shows_the_one_that_was_asked_for_last() {
        let (mut sides, narrow) = (Sides::default(), 720.0);
        assert_eq!(seen(sides, narrow), [true, false]);
        sides.toggle(Side::Settings, narrow);
        assert_eq!((seen(sides, narrow), seen(sides, 1440.0)), ([false, true], [true, true]));
        sides.toggle(Side::Settings, narrow);
        assert_eq!(seen(sides, narrow), [true, false], "the one behind it is seen again");
        sides.toggle(Side::Lights, narrow);
        assert_eq!(seen(sides, narrow), [false, false]);
        sides.toggle(Side::Settings, narrow);
        assert_eq!(seen(sides, narrow), [false, true]);
    }
}
