//! Light that pixels share is off by as much as is told.

use std::ops::ControlFlow;

use clerestory_nystrom::{Half, SampledMatrix};
use glam::Vec3;
use rayon::prelude::*;

use super::stage::{Stage, lambert, quad, room};
use crate::cache::CachePlan;
use crate::camera::{Camera, Film};
use crate::matrix::{CHANNELS, TransportMatrix};
use crate::nodes::{NodePlan, Nodes};
use crate::plan::{Density, MatrixPlan};
use crate::prepared::PreparedScene;
use crate::shared::SharedMatrix;

const FILM: Film = Film { width: 32, height: 24 };
/// Samples per pixel of each half that the truth is taken from.
const SPP: u32 = 128;
/// Tolerance of a bake that lets the told bias take all its samples.
const EXACT_DB: f32 = 80.0;
/// What the light of nodes and cells is multiplied by. In so small a room sharing itself is off by less than a few hundred traced pixels can
/// tell; half as much light again is not.
const TOO_BRIGHT: f32 = 1.5;

fn lit_room() -> PreparedScene {
    let camera = Camera::look_at("door", Vec3::new(0.2, 0.1, 0.9), Vec3::new(0.0, -0.3, -1.0), 1.1, 4.0 / 3.0);
    Stage::new(camera)
        .surface("walls", &room(Vec3::ONE), lambert(0.6, 0.0))
        .surface("shelf", &quad(Vec3::new(0.1, -0.4, -0.9), Vec3::Z * 0.6, Vec3::X * 0.8), lambert(0.4, 0.0))
        .panel("panel", &quad(Vec3::new(-0.5, 0.98, -0.5), Vec3::X * 0.9, Vec3::Z * 0.9), 3.0, 4)
        .prepared()
}

/// A matrix whose pixels share light, as a bake has it but for what that light is multiplied by.
fn shared<'a>(matrix: &'a TransportMatrix<'a>, brighter: f32) -> SharedMatrix<'a> {
    let cache = CachePlan { walks: 16, places_per_cell: 2 };
    let plan = NodePlan { walks: 64, outshines: 4.0, cache };
    let nodes = Nodes::gather(matrix, plan, || ControlFlow::Continue(())).expect("nobody stops it");
    SharedMatrix { matrix, nodes: nodes.scaled(&vec![brighter; matrix.column_scale().len()]) }
}

/// All rows of both halves.
fn halves(matrix: &impl SampledMatrix) -> [Vec<f32>; 2] {
    [Half::A, Half::B].map(|half| {
        let mut rows: Vec<f32> = vec![0.0; matrix.n_rows() * matrix.n_cols()];
        rows.par_chunks_exact_mut(CHANNELS * matrix.n_cols()).enumerate().for_each(|(pixel, rows)| {
            matrix.add_rows(&[pixel as u32], 0..SPP, half, rows, &mut Vec::new());
            rows.iter_mut().for_each(|value| *value /= SPP as f32);
        });
        rows
    })
}

fn db(mean_square: f64) -> f64 {
    -10.0 * mean_square.log10()
}

#[test]
fn the_told_bias_of_shared_light_is_that_of_all_pixels_beside_traced_ones() {
    let scene = lit_room();
    let plan = MatrixPlan::new(&scene.lighting, Density::Full);
    let [own, other] =
        [1, 2].map(|seed| TransportMatrix::new(&scene, &plan, scene.scene.cameras[0].clone(), FILM, None, seed));
    let too_bright = shared(&own, TOO_BRIGHT);
    // Samples of the truth are others than those of the pixels that tell: noise of the halves cancels in both.
    let (found, truth) = (halves(&too_bright), halves(&other));
    let off = |half: usize| found[half].iter().zip(&truth[half]).map(|(found, truth)| f64::from(found - truth));
    let mean_square = off(0).zip(off(1)).map(|(a, b)| a * b).sum::<f64>() / found[0].len() as f64;
    let (told, plain) = (too_bright.bias(EXACT_DB), shared(&own, 1.0).bias(EXACT_DB));
    let [is, told, plain] = [mean_square, f64::from(told), f64::from(plain)].map(db);
    assert!(plain > told + 6.0, "without what was put in {plain:.1} dB are told, with it {told:.1} dB");
    assert!((told - is).abs() < 3.0, "told {told:.1} dB, are {is:.1} dB; {plain:.1} dB without what was put in");
}
