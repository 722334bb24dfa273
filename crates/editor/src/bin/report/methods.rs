//! The methods of the field on the same matrices: error, size and time at equal rank.

pub mod dense;
mod npz;
pub mod own;
pub mod planes;

use std::time::Instant;

use anyhow::{Context, Result};
use clerestory_nystrom::rivals::{Core, DMatrix, Method, MethodError, Real, approximate};
use clerestory_transport::camera::Film;

use self::dense::{Picture, squared_error};
use super::desk::Desk;
use super::errors::decibels;
use super::fit::{listed, tenths};
use super::kept::checksum;
use super::reference::Sampling;

const RANKS: [usize; 3] = [4, 16, 32];
/// Rank at which size, time and single precision are told, and which of the ranks it is.
const TOLD: usize = RANKS[NTH_TOLD];
const NTH_TOLD: usize = 1;
const SEED: u64 = 1;
/// What methods that choose by chance are repeated with; all methods are, in turn, for the time they take.
const SEEDS: [u64; 3] = [SEED, 2, 3];

/// Measures the shared matrices, where they are at hand, and one of ours.
///
/// # Errors
/// If a matrix cannot be read or sampled.
pub fn write(desk: &Desk) -> Result<String> {
    let names: &[&str] = desk.choose(&["mixed"], &["mixed", "reflect"]);
    let checksums = checksums(desk, names)?;
    let tables = tables(desk)?;
    Ok(format!(
        "## Methods\n\n\
         Every method of `clerestory_nystrom::rivals` at equal rank: k rows and columns, crosses or components. The error is told for single\n\
         texels, 10·log10(pk² / mean ΔT²) over all entries, pk the median over columns of their 99.5 percentile; nothing is clipped.\n\
         Left, blocks of 16 × 16 pixels, each by itself{}; right, the whole picture{} as one matrix. Numbers stored, milliseconds\n\
         and the error in single precision are means per block at rank {TOLD}; the other errors are in double precision, but for `projected`,\n\
         which is single precision by itself, its factors rounded to eleven bits. Columns of a square panel are in the order of Morton's curve,\n\
         which matters to compressed sensing alone. \"Singular\": the intersection of the chosen rows and columns of a block had no inverse; where one has no answer,\n\
         numbers, ratio and time are \"—\".\n\
         {}; all methods in turn, one seed after the other. {checksums}{}\n{tables}",
        desk.choose(", every sixth of them (of the scene of `assets` every other one)", ""),
        desk.choose(", thinned to every fourth pixel across and down,", ""),
        desk.choose(
            format!("Seed {SEED}"),
            format!("Median (least…greatest) of the seeds {} where they differ", listed(&SEEDS))
        ),
        desk.load_words(),
    ))
}

/// Checksums of the files of shared matrices, a sentence; nothing where none is at hand.
///
/// # Errors
/// If one cannot be read.
pub fn checksums(desk: &Desk, names: &[&str]) -> Result<String> {
    let mut told = Vec::new();
    for name in names {
        let Some(path) = desk.shared(&format!("matrices/{name}.npz")) else { continue };
        let bytes = std::fs::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
        told.push(format!("`{name}.npz` {}", checksum(&bytes)));
    }
    Ok(if told.is_empty() { String::new() } else { format!("Checksums (CRC-32): {}. ", told.join(", ")) })
}

/// One table after the other.
fn tables(desk: &Desk) -> Result<String> {
    let mut text = String::new();
    let names: &[&str] = desk.choose(&["mixed"], &["mixed", "reflect"]);
    for name in names {
        let Some(path) = desk.shared(&format!("matrices/{name}.npz")) else { continue };
        let picture = Picture::shared(&path, "T")?.in_z_order();
        let title = format!("`{name}` (see the head of this page)");
        text += &desk.part("methods", name, || Ok(section(desk, &title, &picture, desk.choose(6, 1))))?;
    }
    let (film, spp) = desk.choose((Film { width: 32, height: 32 }, 64), (Film { width: 64, height: 48 }, 256));
    let scenes: &[&str] = desk.choose(&["diffuse"], &["diffuse", "mixed"]);
    for name in scenes {
        let sampling = Sampling { film, step: 1, bounces: None, spp };
        let path = desk.root.join(format!("assets/scenes/{name}.glb"));
        let (picture, noise) = own::mean_and_noise(&own::halves(desk, &path, None, (sampling, SEED))?);
        let picture = picture.in_z_order();
        let noise_db = decibels(picture.peak(), noise);
        let title =
            format!("`assets/scenes/{name}.glb`, {spp} samples per pixel and half, {noise_db:.1} dB above its noise");
        text +=
            &desk.part("methods", &format!("own-{name}"), || Ok(section(desk, &title, &picture, desk.choose(2, 1))))?;
    }
    Ok(text)
}

/// The table of one matrix.
fn section(desk: &Desk, title: &str, picture: &Picture, step: usize) -> String {
    let (peak, blocks) = (picture.peak(), picture.blocks::<f64>(step));
    let single = picture.blocks::<f32>(step);
    let whole = picture.thinned::<f64>(desk.choose(4, 1));
    let Picture { width, height, n_cols, .. } = *picture;
    let mut text = format!(
        "\n### {title}\n\n{width} × {height} pixels, {n_cols} columns, {} blocks measured.\n\n\
         | method | rank 4 | 16 | 32 | 16, single precision | numbers stored | dense / stored | ms | relights | whole: rank 4 | 16 | 32 |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|\n",
        blocks.len()
    );
    let methods = methods(desk);
    let mut found: Vec<Repeats> = methods.iter().map(|_| Repeats::default()).collect();
    for &seed in &SEEDS[..desk.choose(1, SEEDS.len())] {
        for (&method, found) in methods.iter().zip(&mut found) {
            desk.say(&format!("{method} on {title}, seed {seed}"));
            for (nth, rank) in RANKS.into_iter().enumerate() {
                found.by_block[nth].push(Measured::new(method, &blocks, (rank, seed)));
                found.whole[nth].push(Measured::new(method, std::slice::from_ref(&whole), (rank, seed)));
            }
            found.in_single.push(Measured::new(method, &single, (TOLD, seed)));
        }
    }
    for (method, found) in methods.iter().zip(&found) {
        text += &format!(
            "| `{method}` | {} | {} | {} | {} | {} | {} |\n",
            found.by_block.each_ref().map(|of_rank| words(of_rank, peak)).join(" | "),
            words(&found.in_single, peak),
            size_words(&found.by_block[NTH_TOLD], blocks.len()),
            millis_words(&found.in_single, blocks.len()),
            if method.has_factors() { "yes" } else { "**no**" },
            found.whole.each_ref().map(|of_rank| words(of_rank, peak)).join(" | "),
        );
    }
    text
}

/// What one method made of a picture with each seed: at each rank in blocks and as a whole, and in single precision.
#[derive(Default)]
struct Repeats {
    by_block: [Vec<Measured>; RANKS.len()],
    whole: [Vec<Measured>; RANKS.len()],
    in_single: Vec<Measured>,
}

/// All of them, in a hurry some.
pub fn methods(desk: &Desk) -> Vec<Method> {
    desk.choose(some(), all())
}

/// All that bakes can be made by; the pseudo-inverse also with the threshold that suits it best.
fn all() -> Vec<Method> {
    coarser().into_iter().chain(Method::every()).collect()
}

/// Of most algorithms no other core than that.
fn some() -> Vec<Method> {
    let others = Method::ALL.into_iter().filter(|method| method.is_by_itself());
    coarser().into_iter().chain(Core::ALL.map(Method::Alg4)).chain(others).collect()
}

/// Every algorithm that takes a core, with the pseudo-inverse and the threshold that suits it best.
fn coarser() -> [Method; 5] {
    let algorithms = [Method::Alg1, Method::Alg2, Method::Alg3, Method::Alg4, Method::Alg4Union];
    algorithms.map(|algorithm| algorithm(Core::PseudoInverse { rcond: 1e-2 }))
}

/// One method at one rank on some matrices.
#[derive(Default)]
struct Measured {
    squared_error: f64,
    n_entries: f64,
    n_values: f64,
    secs: f64,
    failures: Vec<MethodError>,
}

impl Measured {
    fn new<S: Real>(method: Method, matrices: &[DMatrix<S>], (rank, seed): (usize, u64)) -> Measured {
        let mut measured = Measured::default();
        for matrix in matrices {
            let begun = Instant::now();
            let result = approximate(method, matrix, rank, seed);
            measured.secs += begun.elapsed().as_secs_f64();
            measured.n_entries += matrix.len() as f64;
            match result {
                Ok(found) => {
                    measured.squared_error += squared_error(matrix, &found.to_dense());
                    measured.n_values += found.n_values() as f64;
                }
                Err(error) => measured.failures.push(error),
            }
        }
        measured
    }

    /// The error in dB, or what went wrong.
    fn decibels(&self, peak: f64) -> Result<f64, String> {
        match self.failures.first() {
            Some(MethodError::Singular { .. }) => Err("singular".into()),
            Some(error) => Err(error.to_string()),
            None => Ok(decibels(peak, self.squared_error / self.n_entries)),
        }
    }
}

/// The errors of repeats in dB, or what went wrong with one of them.
fn words(repeats: &[Measured], peak: f64) -> String {
    let found: Result<Vec<f64>, String> = repeats.iter().map(|repeat| repeat.decibels(peak)).collect();
    let found = match found {
        Ok(found) => found,
        Err(reason) => return reason,
    };
    // One figure where all of them round to it.
    let differ = found.iter().any(|db| format!("{db:.1}") != format!("{:.1}", found[0]));
    if differ { tenths(found) } else { tenths(found[..1].to_vec()) }
}

/// Cells of the numbers stored of a block and of what they are smaller by, with the first seed; “—” where some block has no answer with one.
fn size_words(repeats: &[Measured], n_blocks: usize) -> String {
    match repeats.first() {
        Some(first) if first.failures.is_empty() => {
            format!("{:.0} | {:.0}×", first.n_values / n_blocks as f64, first.n_entries / first.n_values.max(1.0))
        }
        _ => "— | —".into(),
    }
}

/// Milliseconds of a block with each seed; “—” where some block has no answer with one of them.
fn millis_words(repeats: &[Measured], n_blocks: usize) -> String {
    if repeats.iter().any(|repeat| !repeat.failures.is_empty()) {
        return "—".into();
    }
    tenths(repeats.iter().map(|repeat| repeat.secs * 1e3 / n_blocks as f64).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_method_that_a_bake_can_be_told_has_a_row() {
        let (all, refused) = (all(), "none".parse::<Method>().unwrap_err().to_string());
        let (_, names) = refused.split_once("; there are ").unwrap();
        for name in names.split(", ") {
            let method: Method = name.parse().unwrap();
            assert!(all.contains(&method), "{name}");
        }
        assert!(some().iter().all(|method| all.contains(method)), "what is told in a hurry is told at leisure, too");
        assert!((1..all.len()).all(|nth| !all[..nth].contains(&all[nth])), "a method has one row");
    }

    #[test]
    fn errors_are_told_in_decibels_and_failures_in_words() {
        let matrix = DMatrix::from_fn(40, 30, |i, j| 1.0 / (1 + i + j) as f64);
        let measured = |method, rank| Measured::new(method, std::slice::from_ref(&matrix), (rank, SEED));
        let best = measured(Method::Svd, 4);
        let expected = matrix.clone() - approximate(Method::Svd, &matrix, 4, SEED).unwrap().to_dense();
        let expected = -10.0 * (expected.norm_squared() / 1200.0).log10();
        assert_eq!((best.n_values, best.n_entries), (280.0, 1200.0));
        let coarser = [1, 4, 2].map(|rank| measured(Method::Svd, rank));
        let [low, high] = [&coarser[0], &coarser[1]].map(|one| one.decibels(1.0).unwrap());
        assert_eq!(words(&[best, measured(Method::Svd, 4)], 1.0), format!("{expected:.1}"));
        assert!(words(&coarser, 1.0).ends_with(&format!(" ({low:.1}…{high:.1})")), "{}", words(&coarser, 1.0));
        let singular = DMatrix::from_element(40, 30, 1.0);
        assert_eq!(words(&[Measured::new(Method::Alg3(Core::Inverse), &[singular], (4, SEED))], 1.0), "singular");
    }

    #[test]
    fn size_and_time_are_told_only_where_every_block_has_an_answer() {
        let measured = |failures: Vec<MethodError>| Measured {
            squared_error: 1.0,
            n_entries: 2000.0,
            n_values: 500.0,
            secs: 0.004,
            failures,
        };
        let of_all = [measured(Vec::new())];
        assert_eq!((size_words(&of_all, 2), millis_words(&of_all, 2)), ("250 | 4×".into(), "2.0".into()));
        let matrix = DMatrix::from_element(40, 30, 1.0);
        let of_some = [Measured::new(Method::Alg3(Core::Inverse), &[matrix], (4, SEED))];
        assert_eq!((size_words(&of_some, 1), millis_words(&of_some, 1)), ("— | —".into(), "—".into()));
    }
}
