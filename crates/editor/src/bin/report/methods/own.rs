//! A matrix of ours, sampled whole.

use std::path::Path;

use anyhow::{Context, Result};
use clerestory_nystrom::{Half, SampledMatrix};
use clerestory_transport::camera::Film;
use clerestory_transport::import;
use clerestory_transport::matrix::{CHANNELS, TransportMatrix};
use clerestory_transport::plan::{Density, MatrixPlan};
use clerestory_transport::prepared::PreparedScene;
use rayon::prelude::*;

use super::dense::Picture;

/// The mean of two halves of `spp` samples per pixel each, lights that are seen left out, and its noise as a mean square per entry.
///
/// # Errors
/// If the scene cannot be loaded.
pub fn sampled(path: &Path, film: Film, spp: u32) -> Result<(Picture, f64)> {
    let imported = import::load(path).with_context(|| format!("cannot load the scene {}", path.display()))?;
    let scene = PreparedScene::new(imported.scene, &[])?.0;
    let plan = MatrixPlan::new(&scene.lighting, Density::Full);
    let matrix = TransportMatrix::new(&scene, &plan, scene.scene.cameras[0].clone(), film, None, 1);
    let n_cols = matrix.n_cols();
    let [mut values, other] = [Half::A, Half::B].map(|half| {
        let mut rows = vec![0.0; matrix.n_rows() * n_cols];
        rows.par_chunks_mut(CHANNELS * n_cols).enumerate().for_each(|(pixel, rows)| {
            matrix.add_rows(&[pixel as u32], 0..spp, half, rows, &mut Vec::new());
            rows.iter_mut().for_each(|value| *value /= spp as f32);
        });
        rows
    });
    let difference = |(a, b): (&f32, &f32)| (f64::from(*a) - f64::from(*b)).powi(2);
    let noise = values.iter().zip(&other).map(difference).sum::<f64>() / (4 * values.len()) as f64;
    values.iter_mut().zip(&other).for_each(|(value, other)| *value = 0.5 * (*value + other));
    let (width, height) = (film.width as usize, film.height as usize);
    Ok((Picture { width, height, n_cols, values }.in_z_order(), noise))
}
