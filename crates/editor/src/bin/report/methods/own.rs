//! Matrices of ours, sampled whole.

use std::path::Path;

use anyhow::{Context, Result};
use clerestory_nystrom::{BlockFactors, Half};
use clerestory_transport::bake::Bake;
use clerestory_transport::import;
use clerestory_transport::matrix::TransportMatrix;
use clerestory_transport::prepared::PreparedScene;

use super::dense::Picture;
use crate::desk::Desk;
use crate::matrix::divided;
use crate::reference::{Emitters, Sampling, key_of, plainest_plan, rows_in_blocks, rows_of};

/// Two halves of a scene's matrix of so many samples per pixel each, lights that are seen left out; its panel in `side` × `side`
/// texels, else as the file has it. Kept between runs.
///
/// # Errors
/// If the scene cannot be loaded or has no panel to divide.
pub fn halves(desk: &Desk, path: &Path, side: Option<u32>, (sampling, seed): (Sampling, u64)) -> Result<[Picture; 2]> {
    let imported = import::load(path).with_context(|| format!("cannot load the scene {}", path.display()))?;
    let panels = match side {
        None => Vec::new(),
        Some(side) => vec![divided(&imported.scene, side)?],
    };
    let scene = PreparedScene::new(imported.scene, &panels)?.0;
    let n_cols = scene.lighting.basis.n_cols();
    let key = format!("both halves without lights that are seen: {}", key_of(&[path], &scene, sampling, seed)?);
    let values = desk.numbers(&key, || {
        desk.say(&format!("sampling {n_cols} columns of {} with {} samples", scene.scene.name, sampling.spp));
        Ok(sampled_halves(&scene, sampling, seed).concat())
    })?;
    let (width, height) = (sampling.film.width as usize, sampling.film.height as usize);
    let half = |values: &[f32]| Picture { width, height, n_cols, values: values.to_vec() };
    let (a, b) = values.split_at(values.len() / 2);
    Ok([half(a), half(b)])
}

fn sampled_halves(scene: &PreparedScene, sampling: Sampling, seed: u64) -> [Vec<f32>; 2] {
    let Sampling { film, bounces, spp, .. } = sampling;
    let plan = plainest_plan(scene, sampling, seed);
    let matrix = TransportMatrix::new(scene, &plan, scene.scene.cameras[0].clone(), film, bounces, seed);
    let pixels: Vec<u32> = (0..film.n_pixels() as u32).collect();
    [Half::A, Half::B].map(|half| rows_in_blocks(&matrix, (film, &pixels), (spp, half), Emitters::LeftOut))
}

/// All entries of a bake, radiance per unit of light, without the lights that are seen.
pub fn scattered(bake: &Bake) -> Picture {
    let header = &bake.header;
    let (width, height, n_cols) = (header.width as usize, header.height as usize, header.basis.n_cols());
    let pixels: Vec<u32> = (0..header.width * header.height).collect();
    let values = rows_of(&pixels, (header, &bake.groups), BlockFactors::low_rank_row);
    Picture { width, height, n_cols, values }
}

/// The mean of both halves, and its noise as a mean square per entry.
pub fn mean_and_noise([a, b]: &[Picture; 2]) -> (Picture, f64) {
    let difference = |(a, b): (&f32, &f32)| (f64::from(*a) - f64::from(*b)).powi(2);
    let noise = a.values.iter().zip(&b.values).map(difference).sum::<f64>() / (4 * a.values.len()) as f64;
    let values = a.values.iter().zip(&b.values).map(|(a, b)| 0.5 * (a + b)).collect();
    (Picture { values, ..*a }, noise)
}
