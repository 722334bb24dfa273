//! The evaluation of the method that Clerestory builds on, redone with all that has come since.

mod beside;
mod columns;
mod components;
pub mod conference;
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
use super::fit::{listed, median, tenths};
use super::methods::dense::Picture;
use super::reference::Sampling;

/// The four scenes of `assets/scenes`, one for each kind of light transport.
const SCENES: [&str; 4] = ["diffuse", "reflections", "caustics", "mixed"];
/// Of the samples, where no other is told.
pub const SEED: u64 = 1;
/// What methods that choose by chance are repeated with, on the same matrix.
const SEEDS: [u64; 3] = [SEED, 2, 3];

/// Singular values of the intersection up to this share of the largest are dropped.
const RCOND: f64 = 1e-2;
/// Algorithms 1 to 4 with the pseudo-inverse of the intersection, the core of Nyström's method, where weak values are dropped; the last one
/// with the projection onto its rows as well, as others suit it better; a transform of the entries, the best there is, and ours.
const METHODS: [Method; 8] = [
    Method::Alg1(Core::PseudoInverse { rcond: RCOND }),
    Method::Alg2(Core::PseudoInverse { rcond: RCOND }),
    Method::Alg3(Core::PseudoInverse { rcond: RCOND }),
    Method::Alg4(Core::PseudoInverse { rcond: RCOND }),
    Method::Alg4(Core::Projection),
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
    measured += &open::write(desk)?;
    Ok(format!(
        "## The method's own evaluation, redone\n\n\
         Pictures under {} lights on the panel, of different color, position and size: PSNR is the mean over them, each exposed to four times the median\n\
         luminance of its reference and clipped at white. Matrices are sampled with seed {SEED} where no other is told; methods that choose rows and columns\n\
         by chance have {}. {}\n{measured}",
        lights::count(),
        desk.choose(
            format!("seed {SEED}"),
            format!(
                "the seeds {} on the same matrix, told as median (least…greatest) where they differ",
                listed(&SEEDS)
            )
        ),
        desk.load_words(),
    ))
}

/// What all samples of a scene have in common.
pub fn sampling(desk: &Desk, spp: u32) -> Sampling {
    let film = desk.choose(Film { width: 32, height: 32 }, Film { width: 64, height: 48 });
    Sampling { film, step: 1, bounces: None, spp }
}

/// What a method makes of all blocks at a rank, and how many numbers it stores.
fn approximated(
    picture: &Picture,
    blocks: &[DMatrix<f32>],
    method: Method,
    (rank, seed): (usize, u64),
) -> Result<(Picture, usize), MethodError> {
    let found = blocks.par_iter().map(|block| approximate(method, block, rank, seed)).collect::<Result<Vec<_>, _>>()?;
    let dense: Vec<DMatrix<f32>> = found.iter().map(|found| found.to_dense()).collect();
    Ok((picture.with_blocks(&dense), found.iter().map(|found| found.n_values()).sum()))
}

/// Decibels with each seed; `None` where a method had no answer with one of them.
type Repeats = Option<Vec<f64>>;

/// What is measured with each seed, or with one of them where chance has no part in it.
fn repeated(desk: &Desk, method: Method, measure: impl FnMut(u64) -> Option<f64>) -> Repeats {
    let n_seeds = if method == Method::Svd { 1 } else { desk.choose(1, SEEDS.len()) };
    SEEDS[..n_seeds].iter().copied().map(measure).collect()
}

/// Median (least…greatest), or one figure where all of them round to it.
fn told(repeats: &Repeats) -> String {
    let Some(found) = repeats else { return "singular".into() };
    let differ = found.iter().any(|db| format!("{db:.1}") != format!("{:.1}", found[0]));
    tenths(if differ { found.clone() } else { found.iter().take(1).copied().collect() })
}

/// What a plot shows of them.
fn middle(repeats: &Repeats) -> Option<f64> {
    median(repeats.as_ref()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn algorithm_4_stands_with_the_core_of_nystroms_method_and_with_one_that_suits_it_better() {
        let matrix = DMatrix::<f64>::from_fn(60, 40, |i, j| 1.0 / (1 + i + j) as f64 + ((7 * i + 11 * j) % 13) as f64);
        let of_fourth = METHODS.into_iter().filter(|method| matches!(method, Method::Alg4(_)));
        let error = |method| (approximate(method, &matrix, 8, SEED).unwrap().to_dense() - &matrix).norm();
        let errors: Vec<f64> = of_fourth.map(error).collect();
        assert!(errors.len() == 2 && errors[1] <= 1.000_001 * errors[0], "{errors:?}");
    }

    #[test]
    fn repeats_are_told_with_their_ends_where_they_differ() {
        let words = |repeats: &[f64]| told(&Some(repeats.to_vec()));
        assert_eq!(words(&[21.34, 20.0, 24.7]), "21.3 (20.0…24.7)");
        assert_eq!(words(&[21.34, 21.31, 21.28]), "21.3");
        assert_eq!((told(&None), middle(&None)), ("singular".into(), None));
        assert_eq!(middle(&Some(vec![3.0, 1.0, 2.0])), Some(2.0));
    }
}
