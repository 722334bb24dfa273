//! The evaluation of the method that Clerestory builds on, redone with all that has come since.

mod columns;
mod conference;
mod lights;
mod noise;
mod open;
mod plain;
mod ratios;

use anyhow::Result;
use clerestory_nystrom::rivals::{Core, DMatrix, Method, MethodError, approximate};
use clerestory_transport::camera::Film;
use rayon::prelude::*;

use super::desk::Desk;
use super::methods::dense::Picture;
use super::reference::Sampling;

/// The four scenes of `assets/scenes`, one for each kind of light transport.
const SCENES: [&str; 4] = ["diffuse", "reflections", "caustics", "mixed"];
const SEED: u64 = 1;

/// Algorithms 1 to 4 with the core that suits them best, a transform of the entries, the best there is, and ours.
const METHODS: [Method; 7] = [
    Method::Alg1(Core::PseudoInverse { rcond: 1e-2 }),
    Method::Alg2(Core::PseudoInverse { rcond: 1e-2 }),
    Method::Alg3(Core::PseudoInverse { rcond: 1e-2 }),
    Method::Alg4(Core::PseudoInverse { rcond: 1e-2 }),
    Method::KERNEL,
    Method::Svd,
    Method::Projected,
];

/// One experiment after the other.
///
/// # Errors
/// If a scene cannot be loaded or baked.
pub fn write(desk: &Desk) -> Result<String> {
    let mut measured = columns::write(desk)?;
    measured += &ratios::write(desk)?;
    measured += &noise::write(desk)?;
    measured += &plain::write(desk)?;
    measured += &conference::write(desk)?;
    measured += &open::write(desk)?;
    Ok(format!(
        "## The method's own evaluation, redone\n\n\
         Pictures under {} lights on the panel, of different color, position and size: PSNR is the mean over them, each exposed to four times the median\n\
         luminance of its reference and clipped at white. Seed {SEED}. {}\n{measured}",
        lights::count(),
        desk.load_words(),
    ))
}

/// What all samples of a scene have in common.
fn sampling(desk: &Desk, spp: u32) -> Sampling {
    let film = desk.choose(Film { width: 32, height: 32 }, Film { width: 64, height: 48 });
    Sampling { film, step: 1, bounces: None, spp }
}

/// What a method makes of all blocks at a rank, and how many numbers it stores.
fn approximated(
    picture: &Picture,
    blocks: &[DMatrix<f32>],
    method: Method,
    rank: usize,
) -> Result<(Picture, usize), MethodError> {
    let found = blocks.par_iter().map(|block| approximate(method, block, rank, SEED)).collect::<Result<Vec<_>, _>>()?;
    let dense: Vec<DMatrix<f32>> = found.iter().map(|found| found.to_dense()).collect();
    Ok((picture.with_blocks(&dense), found.iter().map(|found| found.n_values()).sum()))
}
