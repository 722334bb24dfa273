//! What taking noise out between bundles promises.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicU32, Ordering};

use super::*;
use crate::compress::{ColumnGroup, CompressConfig, SamplePlan, Tolerance, compress};
use crate::matrix::{Half, SampledMatrix, SparseEntry};
use crate::random::Random;

const SIDE: u32 = 48;
const N_COLS: usize = 12;
/// Rows of a bundle, each of a magnitude of its own.
const GAINS: [f32; 2] = [1.0, 0.25];

/// A field that changes slowly, with a wall in the middle behind which all is different, and noise.
struct Field {
    noise: f32,
    /// Whether a stripe of bundles is another thing than those around, which nobody tells.
    has_secret: bool,
}

fn partition() -> Partition {
    Partition { width: SIDE, height: SIDE, tile: 16 }
}

impl Field {
    fn truth(&self, bundle: u32, row: usize, col: usize) -> f32 {
        let (x, y) = ((bundle % SIDE) as f32, (bundle / SIDE) as f32);
        let wall = if x < 24.0 { 1.0 } else { 3.0 };
        let slope = 1.0 + 0.3 * (0.03 * x * (1.0 + col as f32 / 12.0)).sin() + 0.2 * (0.04 * y).cos();
        let secret = if self.has_secret && y as u32 % 6 == 3 { 4.0 } else { 1.0 };
        GAINS[row] * wall * slope * secret
    }

    fn error(&self, matrix: &BlockLowRank) -> f64 {
        let mut sum = 0.0;
        let mut bundles = Vec::new();
        for (block_idx, block) in matrix.blocks.iter().enumerate() {
            partition().bundles(block_idx, &mut bundles);
            for (at, x) in block.as_ref().unwrap().dense().iter().enumerate() {
                let (row, col) = (at / N_COLS, at % N_COLS);
                sum += f64::from(x - self.truth(bundles[row / 2], row % 2, col)).powi(2);
            }
        }
        sum / (matrix.n_rows() * N_COLS) as f64
    }

    fn compressed(&self) -> BlockLowRank {
        let mut matrix = BlockLowRank::new(partition(), 2, N_COLS as u32);
        let tolerance = Tolerance::AbsoluteMeanSquare(1e-4);
        let group = ColumnGroup { columns: 0..N_COLS, tolerance, preserved: vec![1.0; N_COLS], share: 1.0, apart: 0.0 };
        let samples = SamplePlan { batch: 2, min: 2, max: 2 };
        let config = CompressConfig { groups: vec![group], samples, ..CompressConfig::default() };
        let blocks: Vec<u32> = (0..9).collect();
        let flow = compress(self, &partition(), &blocks, &config, |block, mut factors| {
            matrix.blocks[block as usize] = factors.pop().map(Arc::new);
            ControlFlow::Continue(())
        });
        assert_eq!(flow, Ok(ControlFlow::Continue(())));
        matrix
    }
}

impl SampledMatrix for Field {
    fn n_rows(&self) -> usize {
        (SIDE * SIDE) as usize * 2
    }

    fn n_cols(&self) -> usize {
        N_COLS
    }

    fn bundle_len(&self) -> usize {
        2
    }

    fn add_rows(
        &self,
        bundles: &[u32],
        samples: std::ops::Range<u32>,
        half: Half,
        out: &mut [f32],
        _: &mut Vec<SparseEntry>,
    ) {
        for (&bundle, rows) in bundles.iter().zip(out.chunks_mut(2 * N_COLS)) {
            for sample in samples.clone() {
                let mut rng = Random::new([u64::from(bundle), u64::from(sample) * 2 + u64::from(half == Half::B)]);
                // Half of the noise is common to all columns, as that of a sample is.
                let common = rng.normal();
                for (at, x) in rows.iter_mut().enumerate() {
                    let noise = self.noise * GAINS[at / N_COLS] * (common + rng.normal());
                    *x += self.truth(bundle, at / N_COLS, at % N_COLS) + noise;
                }
            }
        }
    }
}

/// Bundles are alike on either side of the wall.
struct Sides;

impl Likeness for Sides {
    fn likeness(&self, bundle: u32, first: u32, out: &mut [f32]) {
        let likeness = |other: u32| f32::from(u8::from((bundle % SIDE < 24) == (other % SIDE < 24)));
        (first..).zip(out).for_each(|(other, out)| *out = likeness(other));
    }

    fn gains(&self, _: u32) -> &[f32] {
        &GAINS
    }
}

fn denoiser(partition: &Partition) -> Denoiser<'_, Sides> {
    Denoiser { partition, bundle_len: 2, preserved: vec![&[1.0; N_COLS]], likeness: &Sides }
}

fn denoised(matrix: &BlockLowRank) -> BlockLowRank {
    denoiser(&partition()).all(std::slice::from_ref(matrix), &|| true).unwrap().remove(0)
}

fn told(matrix: &BlockLowRank) -> f64 {
    let error = matrix.mean_error();
    f64::from(error.truncation) + f64::from(error.sampling)
}

#[test]
fn noise_falls_by_more_than_twelve_decibels_and_what_is_left_is_told() {
    let field = Field { noise: 0.5, has_secret: false };
    let raw = field.compressed();
    let smooth = denoised(&raw);
    let (before, after) = (field.error(&raw), field.error(&smooth));
    assert!(after < before / 16.0, "{before} {after}");
    assert!((0.8..1.25).contains(&(told(&raw) / before)), "{} {before}", told(&raw));
    assert!((0.8..2.2).contains(&(told(&smooth) / after)), "{} {after}", told(&smooth));
    assert!(smooth.blocks.iter().flatten().all(|block| block.doubt.is_empty()));
    let mean = smooth.column_errors().unwrap().iter().sum::<f64>() / N_COLS as f64;
    assert!((0.8..1.25).contains(&(mean / told(&smooth))), "{mean} in the mean over columns, {} in all", told(&smooth));
}

#[test]
fn the_preserved_product_is_smoothed_and_keeps_its_mean() {
    let field = Field { noise: 0.5, has_secret: false };
    let raw = field.compressed();
    let [before, after] = [&raw, &denoised(&raw)].map(|matrix| matrix.apply(&[1.0; N_COLS]));
    let truth: Vec<f32> = (0..before.len())
        .map(|row| (0..N_COLS).map(|col| field.truth(row as u32 / 2, row % 2, col)).sum::<f32>())
        .collect();
    let error = |x: &[f32]| x.iter().zip(&truth).map(|(x, t)| f64::from(x - t).powi(2)).sum::<f64>();
    assert!(error(&after) < error(&before) / 16.0, "{} {}", error(&before), error(&after));
    let mean = |x: &[f32]| x.iter().map(|x| f64::from(*x)).sum::<f64>();
    assert!((mean(&after) / mean(&before) - 1.0).abs() < 2e-3, "{} {}", mean(&before), mean(&after));
}

#[test]
fn preserved_weights_of_any_size_give_the_same_factors() {
    let raw = Field { noise: 0.5, has_secret: false }.compressed();
    let by = |size: f32| {
        let weights = [size; N_COLS];
        let partition = partition();
        let denoiser = Denoiser { preserved: vec![&weights], ..denoiser(&partition) };
        denoiser.all(std::slice::from_ref(&raw), &|| true).unwrap().remove(0).blocks
    };
    for size in [1e-30, 1e30] {
        assert_eq!(by(size), by(1.0), "{size:e}");
    }
}

#[test]
fn what_nobody_told_of_stays_where_it_stands_out_of_the_noise() {
    let field = Field { noise: 0.1, has_secret: true };
    let raw = field.compressed();
    let smooth = denoised(&raw);
    assert!(field.error(&smooth) < 1.02 * field.error(&raw), "{} {}", field.error(&raw), field.error(&smooth));
}

#[test]
fn without_noise_nothing_changes() {
    let field = Field { noise: 0.0, has_secret: false };
    let raw = field.compressed();
    for (raw, smooth) in raw.blocks.iter().zip(&denoised(&raw).blocks) {
        let (raw, smooth) = (raw.as_deref().unwrap(), smooth.as_deref().unwrap());
        assert_eq!((&raw.left, &raw.right, &raw.scale), (&smooth.left, &smooth.right, &smooth.scale));
        assert_eq!(raw.error, smooth.error);
    }
}

#[test]
fn blocks_that_are_missing_or_of_unknown_noise_stay_as_they_are() {
    let field = Field { noise: 0.5, has_secret: false };
    let mut raw = field.compressed();
    raw.blocks[0] = None;
    let unknown = BlockFactors { doubt: Vec::new(), ..(**raw.blocks[4].as_ref().unwrap()).clone() };
    raw.blocks[4] = Some(Arc::new(unknown.clone()));
    let smooth = denoised(&raw);
    assert!(smooth.blocks[0].is_none());
    assert_eq!(smooth.blocks[4].as_deref(), Some(&unknown));
    let is_finite = |block: &Arc<BlockFactors>| block.dense().iter().all(|x| x.is_finite());
    assert!(smooth.blocks.iter().flatten().all(is_finite));
    // Those that are known still help each other.
    for place in [1, 2, 3, 5, 6, 7, 8] {
        let error = smooth.blocks[place].as_ref().unwrap().error;
        assert!(error.sampling < 0.5 * error.noise, "block {place}: {error:?}");
    }
}

#[test]
fn who_does_not_want_it_any_more_gets_nothing() {
    let raw = Field { noise: 0.5, has_secret: false }.compressed();
    let asked = AtomicU32::new(0);
    let goes_on = || asked.fetch_add(1, Ordering::Relaxed) < 3;
    assert!(denoiser(&partition()).all(&[raw], &goes_on).is_none());
}

#[test]
fn pairs_find_the_least_of_a_form_over_weights() {
    // Of a single direction the best is known: 1 − ¼ on the first, ¼ on the second.
    let direction = [1.0, -3.0, 0.0, 2.0];
    let gram: [[f64; N_MIXED]; N_MIXED] = array::from_fn(|i| array::from_fn(|j| direction[i] * direction[j]));
    let found = least(&gram, &[0.0; N_MIXED]);
    let value: f64 = direction.iter().zip(found).map(|(x, w)| x * w).sum();
    assert!(value.abs() < 1e-6 && (found.iter().sum::<f64>() - 1.0).abs() < 1e-12, "{found:?}");
    assert!(found.iter().all(|&w| w >= 0.0));
    // A mean that is all wrong gets nothing.
    let gram: [[f64; N_MIXED]; N_MIXED] =
        array::from_fn(|i| array::from_fn(|j| if i == j { [1.0, 9.0, 9.0, 9.0][i] } else { 0.0 }));
    assert_eq!(least(&gram, &[10.0, -1.0, -1.0, -1.0]), [1.0, 0.0, 0.0, 0.0]);
}

/// All bundles are alike, and those of one corner are of nothing.
struct Cornered;

impl Likeness for Cornered {
    fn likeness(&self, _: u32, _: u32, out: &mut [f32]) {
        out.fill(1.0);
    }

    fn gains(&self, _: u32) -> &[f32] {
        &GAINS
    }

    fn is_void(&self, bundle: u32) -> bool {
        bundle % SIDE + bundle / SIDE < 40
    }
}

#[test]
fn nothing_is_brought_to_bundles_of_nothing() {
    let mut matrix = Field { noise: 0.5, has_secret: false }.compressed();
    let mut bundles = Vec::new();
    for (block_idx, block) in matrix.blocks.iter_mut().flatten().enumerate() {
        let block = Arc::make_mut(block);
        partition().bundles(block_idx, &mut bundles);
        let n_values = 2 * block.rank as usize;
        for values in [&mut block.left, &mut block.doubt] {
            let rows = bundles.iter().zip(values.chunks_exact_mut(n_values));
            rows.filter(|(bundle, _)| Cornered.is_void(**bundle)).for_each(|(_, rows)| rows.fill(f16::ZERO));
        }
    }
    let partition = partition();
    let denoiser =
        Denoiser { partition: &partition, bundle_len: 2, preserved: vec![&[1.0; N_COLS]], likeness: &Cornered };
    let denoised = denoiser.all(std::slice::from_ref(&matrix), &|| true).unwrap().remove(0);
    assert!(denoised != matrix);
    let x: Vec<f32> = (0..N_COLS).map(|col| 1.0 + col as f32).collect();
    for (bundle, rows) in (0..).zip(denoised.apply(&x).chunks_exact(2)) {
        let is_dark = rows.iter().all(|x| *x == 0.0);
        assert_eq!(is_dark, Cornered.is_void(bundle), "bundle {bundle}: {rows:?}");
    }
}
