//! Solving for light: what a designer wants to see, and the lights that come closest.
//!
//! A picture is linear in its lights, and so is every mean over a part of it: a wish about a mean is one linear equation in the
//! intensities of the lights. The wishes, a gentle wish to keep the rest, and a gentler pull to the present setting make a least-squares
//! problem within bounds ([`clerestory_nystrom::bounded`]).

mod fit;
pub mod kept;
mod lights;
pub mod parse;
mod picture;
pub mod report;
mod rows;
pub mod wish;

use std::sync::Arc;

use anyhow::{Result, ensure};
use clerestory_transport::bake::Bake;
use clerestory_transport::light::LightRig;

use crate::marks::Seen;
pub use lights::{AtPixel, LampColumn, at_point, may_change};
pub use picture::TargetPicture;
pub use report::{Change, Outcome, Solution};
pub use wish::{Exposure, Freedom, Place, Request, Target, Wish};

/// What is solved: a bake under a lighting.
pub struct Scene {
    /// The bake.
    pub bake: Bake,
    /// How its lights are set.
    pub rig: LightRig,
    /// The light of free lamps that shine, as they are set.
    pub lamps: Vec<LampColumn>,
    /// What its pixels see, where the scene is at hand; means are then taken over areas of surface.
    pub seen: Option<Arc<Seen>>,
}

/// Finds the lights that come closest to the wishes.
///
/// # Errors
/// Wishes for what the bake does not hold, lights that it does not have, and what leaves nothing to find, in words.
pub fn solve(scene: &Scene, request: &Request) -> Result<Solution> {
    ensure!(!request.wishes.is_empty(), "there is nothing to solve for; add a wish");
    let unknowns = lights::unknowns(scene, request)?;
    ensure!(!unknowns.is_empty(), "no light may change; choose one that is not muted");
    let rows = rows::Rows::new(scene, &unknowns);
    fit::fit(scene, request, &unknowns, &rows)
}

#[cfg(test)]
mod tests;
