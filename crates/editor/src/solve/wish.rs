//! What is wanted, where, and what may change for it.

use std::sync::Arc;

use super::TargetPicture;
use crate::look::{Quantity, Units};
use crate::marks::Marks;

/// Something that a designer wants to see.
#[derive(Clone, Debug)]
pub struct Wish {
    /// For people.
    pub name: String,
    /// Where.
    pub place: Place,
    /// What.
    pub target: Target,
    /// How much it counts beside the others; 1 is usual.
    pub weight: f64,
}

/// Where something is wanted.
#[derive(Clone, Debug)]
pub enum Place {
    /// In the whole picture.
    Whole,
    /// On average over marked pixels.
    Marks(Arc<Marks>),
    /// On average over a sensor grid: the number of its matrix of irradiance.
    Grid(usize),
}

/// What is wanted of a place.
#[derive(Clone, Debug)]
pub enum Target {
    /// Mean illuminance in lux.
    Illuminance(f64),
    /// Mean luminance in cd/m².
    Luminance(f64),
    /// So many times the mean luminance that it has now; of a sensor grid, the illuminance.
    Times(f64),
    /// As it is now, cell by cell.
    Keep,
    /// Like a picture, cell by cell.
    Picture(Arc<TargetPicture>, Exposure),
}

/// How the numbers of a picture become nit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Exposure {
    /// By the factor that suits best.
    Free,
    /// As a picture that is exposed so: nit times 2^EV are its numbers.
    Ev(f64),
}

/// What of a light may change.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Freedom {
    /// Its intensity.
    Intensity,
    /// Its intensity and its color, up to a saturation of 0 (white) to 1 (any color): one minus the least channel over the largest.
    Color {
        /// 0…1.
        most_saturation: f64,
    },
}

/// Wishes, and what may change for them.
#[derive(Clone, Debug)]
pub struct Request {
    /// What is wanted.
    pub wishes: Vec<Wish>,
    /// Keys of the lights that may change; `None` for all that are not muted.
    pub lights: Option<Vec<String>>,
    /// Least and largest intensity, times the file.
    pub bounds: [f64; 2],
    /// What of them may change.
    pub freedom: Freedom,
    /// What a light that doubles costs: of as many wishes missed by so much. It makes the answer unique. Where lights end at more than
    /// twice what they were, by their shares of what is wished for, it is divided by half of that.
    pub pull: f64,
    /// What it costs in all if the rest of the picture changes by its own measure, beside 1 for a wish.
    pub keep: f64,
}

impl Default for Request {
    fn default() -> Self {
        Request {
            wishes: Vec::new(),
            lights: None,
            bounds: [0.0, 100.0],
            freedom: Freedom::Intensity,
            pull: 1e-3,
            keep: 1e-3,
        }
    }
}

impl Target {
    /// Unit of what is wanted, for people, of a picture that counts in `units`.
    pub fn unit(&self, units: Units) -> &'static str {
        match self {
            Target::Illuminance(_) => Quantity::Illuminance.unit(),
            Target::Luminance(_) | Target::Times(_) => Quantity::Luminance.unit_in(units),
            Target::Keep | Target::Picture(..) => "% off",
        }
    }
}
