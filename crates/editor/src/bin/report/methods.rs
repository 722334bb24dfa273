//! The methods of the field on the same matrices: error, size and time at equal rank.

pub mod dense;
mod npz;
pub mod own;

use std::time::Instant;

use anyhow::Result;
use clerestory_nystrom::rivals::{Core, DMatrix, Method, MethodError, Real, approximate};
use clerestory_transport::camera::Film;

use self::dense::{Picture, squared_error};
use super::desk::Desk;
use super::errors::decibels;
use super::reference::Sampling;

const RANKS: [usize; 3] = [4, 16, 32];
/// Rank at which size, time and single precision are told.
const TOLD: usize = 16;
const SEED: u64 = 1;

/// Measures the shared matrices, where they are at hand, and one of ours.
///
/// # Errors
/// If a matrix cannot be read or sampled.
pub fn write(desk: &Desk) -> Result<String> {
    let tables = tables(desk)?;
    Ok(format!(
        "## Methods\n\n\
         Every method of `clerestory_nystrom::rivals` at equal rank: k rows and columns, crosses or components. The error is told for single\n\
         texels, 10·log10(pk² / mean ΔT²) over all entries, pk the median over columns of their 99.5 percentile; nothing is clipped.\n\
         Left, blocks of 16 × 16 pixels, each by itself{}; right, the whole picture{} as one matrix. Numbers stored, milliseconds\n\
         and the error in single precision are means per block at rank {TOLD}; the other errors are in double precision, but for `projected`,\n\
         which is single precision by itself, its factors rounded to eleven bits. Columns of a square panel are in the order of Morton's curve,\n\
         which matters to compressed sensing alone. \"Singular\": the intersection of the chosen rows and columns of a block had no inverse. {}\n{tables}",
        desk.choose(", every sixth of them", ""),
        desk.choose(", thinned to every fourth pixel across and down,", ""),
        desk.load_words(),
    ))
}

/// One table after the other.
fn tables(desk: &Desk) -> Result<String> {
    let mut text = String::new();
    let names: &[&str] = desk.choose(&["mixed"], &["mixed", "reflect"]);
    for name in names {
        let Some(path) = desk.shared(&format!("matrices/{name}.npz")) else { continue };
        let picture = Picture::shared(&path, "T")?.in_z_order();
        text += &section(desk, &format!("`{name}` of the shared matrices"), &picture, desk.choose(6, 1));
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
        text += &section(desk, &title, &picture, desk.choose(2, 1));
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
    for method in methods(desk) {
        desk.say(&format!("{method} on {title}"));
        let [first, told, last] = RANKS.map(|rank| Measured::new(method, &blocks, rank));
        let in_single = Measured::new(method, &single, TOLD);
        let of_whole = RANKS.map(|rank| Measured::new(method, std::slice::from_ref(&whole), rank).words(peak));
        text += &format!(
            "| `{method}` | {} | {} | {} | {} | {:.0} | {:.0}× | {:.1} | {} | {} |\n",
            first.words(peak),
            told.words(peak),
            last.words(peak),
            in_single.words(peak),
            told.n_values / blocks.len() as f64,
            told.n_entries / told.n_values.max(1.0),
            in_single.secs * 1e3 / blocks.len() as f64,
            if method.has_factors() { "yes" } else { "**no**" },
            of_whole.join(" | "),
        );
    }
    text
}

/// All of them; the pseudo-inverse also with the threshold that suits it best.
pub fn methods(desk: &Desk) -> Vec<Method> {
    let coarser = Core::PseudoInverse { rcond: 1e-2 };
    let algorithms = [Method::Alg1, Method::Alg2, Method::Alg3, Method::Alg4];
    if !desk.quick {
        return algorithms.map(|algorithm| algorithm(coarser)).into_iter().chain(Method::ALL).collect();
    }
    let others = Method::ALL.into_iter().filter(|method| method.is_by_itself());
    let fourth = Core::ALL.map(Method::Alg4);
    algorithms.map(|algorithm| algorithm(coarser)).into_iter().chain(fourth).chain(others).collect()
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
    fn new<S: Real>(method: Method, matrices: &[DMatrix<S>], rank: usize) -> Measured {
        let mut measured = Measured::default();
        for matrix in matrices {
            let begun = Instant::now();
            let result = approximate(method, matrix, rank, SEED);
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
    fn words(&self, peak: f64) -> String {
        match self.failures.first() {
            Some(MethodError::Singular { .. }) => "singular".into(),
            Some(error) => error.to_string(),
            None => format!("{:.1}", decibels(peak, self.squared_error / self.n_entries)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_told_in_decibels_and_failures_in_words() {
        let matrix = DMatrix::from_fn(40, 30, |i, j| 1.0 / (1 + i + j) as f64);
        let best = Measured::new(Method::Svd, std::slice::from_ref(&matrix), 4);
        let expected = matrix.clone() - approximate(Method::Svd, &matrix, 4, SEED).unwrap().to_dense();
        let expected = -10.0 * (expected.norm_squared() / 1200.0).log10();
        assert_eq!(best.words(1.0), format!("{expected:.1}"));
        assert_eq!((best.n_values, best.n_entries), (280.0, 1200.0));
        let singular = DMatrix::from_element(40, 30, 1.0);
        assert_eq!(Measured::new(Method::Alg3(Core::Inverse), &[singular], 4).words(1.0), "singular");
    }
}
