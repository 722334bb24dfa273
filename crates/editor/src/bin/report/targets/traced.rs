//! Blocks of a matrix, sampled until they are as exact as asked, as a bake samples them. Their samples stay, so that every method
//! gets the same.

mod rows;
mod singular;

use std::collections::BTreeMap;
use std::ops::{ControlFlow, Range};
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use clerestory_nystrom::{
    BlockSamples, ColumnGroup, ColumnRun, CompressConfig, Half, Partition, SamplePlan, SampledMatrix, Smoothing,
    SparseEntry, Tolerance, compress,
};
use clerestory_transport::camera::Film;
use clerestory_transport::import;
use clerestory_transport::matrix::TransportMatrix;
use clerestory_transport::plan::{Density, MatrixPlan};
use clerestory_transport::prepared::PreparedScene;

pub use self::rows::{Asked, Found, HEAD, MOST_RANK, RIVAL_RANK, Row, rows};
pub use self::singular::Singular;
use super::coded::{BRIGHT, SHARE_OF_RANKS};
use crate::desk::Desk;
use crate::matrix::divided;
use crate::methods::dense::{CHANNELS, Picture};

/// Samples of each half before the first look, as bakes that trace all light have it.
const FIRST_LOOK: u32 = 4;

/// Some blocks of a picture whose columns are the texels of a square panel.
pub struct Traced {
    /// All blocks of the picture that these are some of.
    partition: Partition,
    /// Columns.
    pub n_cols: usize,
    /// In the order of their pixels.
    pub blocks: Vec<Block>,
    /// Samples of each half that a block could have at most.
    pub most: u32,
    /// Blocks that took all of them.
    pub n_open: usize,
    /// Blocks of the picture that a file is told for.
    frame_blocks: usize,
    /// What of a tolerance is left to the ranks.
    share: f32,
    /// Whether both halves are the matrix itself.
    is_exact: bool,
}

/// The samples of a block.
pub struct Block {
    block_idx: u32,
    /// Sums, row-major, rows × columns.
    halves: [Vec<f32>; 2],
    sparse: [Vec<SparseEntry>; 2],
    /// Samples of a row in each half.
    pub n_samples: [u32; 2],
}

/// How long blocks are sampled.
#[derive(Clone, Copy)]
pub struct Limits {
    /// Samples of each half that a block may have at first, and at most; powers of two, at least 4.
    pub first: u32,
    /// See there.
    pub most: u32,
    /// About so long for all of them: twice as many samples are allowed only while half of it is left.
    pub time: Duration,
}

/// Works with the matrix of a scene of the method's evaluation, its panel of `side` × `side` texels, from its first camera; columns are
/// scaled as a bake scales them.
///
/// # Errors
/// If the scene cannot be loaded or has other lights than a panel, or the work fails.
pub fn with_matrix<T>(
    desk: &Desk,
    (name, side): (&str, u32),
    (film, seed): (Film, u64),
    work: impl FnOnce(&TransportMatrix<'_>) -> Result<T>,
) -> Result<T> {
    with_matrix_of(&desk.root.join(format!("assets/scenes/{name}.glb")), side, (film, seed), work)
}

/// The same of a scene that may lie elsewhere.
///
/// # Errors
/// As [`with_matrix`].
pub fn with_matrix_of<T>(
    path: &Path,
    side: u32,
    (film, seed): (Film, u64),
    work: impl FnOnce(&TransportMatrix<'_>) -> Result<T>,
) -> Result<T> {
    let imported = import::load(path).with_context(|| format!("cannot load the scene {}", path.display()))?;
    let panel = divided(&imported.scene, side)?;
    let scene = PreparedScene::new(imported.scene, &[panel])?.0;
    let new_plan = || MatrixPlan::new(&scene.lighting, Density::Full);
    let pilots = new_plan();
    let new = |plan| TransportMatrix::new(&scene, plan, scene.scene.cameras[0].clone(), film, None, seed);
    let (column_scale, sky_reach) = new(&pilots).measure_columns();
    let plan = new_plan().fitted(&column_scale, &sky_reach, scene.skips);
    let mut matrix = new(&plan);
    matrix.set_column_scale(column_scale);
    let is_square = matrix.n_cols() == (side * side) as usize;
    ensure!(is_square, "{} has other columns than those of a square panel", path.display());
    work(&matrix)
}

/// Columns that are the texels of a square panel.
pub fn grid(n_cols: usize) -> ColumnRun {
    let side = n_cols.isqrt() as u32;
    ColumnRun::Grid { width: side, height: side }
}

/// Mean square error of a tolerance, the peak being 1.
fn allowed(tolerance_db: f64) -> f32 {
    10f64.powf(-tolerance_db / 10.0) as f32
}

/// What a bake asks of its blocks; a share of the tolerance is left to the ranks.
pub fn compression(partition: &Partition, n_cols: usize, tolerance_db: f64, share: f32) -> CompressConfig {
    let group = ColumnGroup {
        columns: 0..n_cols,
        tolerance: Tolerance::AbsoluteMeanSquare(share * allowed(tolerance_db)),
        preserved: vec![1.0; n_cols],
        share: 1.0,
        apart: 0.0,
    };
    let smoothing = Smoothing::new(partition.clone(), CHANNELS, vec![vec![grid(n_cols)]]);
    CompressConfig {
        groups: vec![group],
        max_rank: MOST_RANK,
        strong: BRIGHT,
        smoothing: Some(Arc::new(smoothing)),
        ..CompressConfig::default()
    }
}

impl Traced {
    /// Samples some blocks until both halves call each other's samples enough for a tolerance, or time or samples run out. All samples
    /// that were traced count, those of a half that waited for the other one, too.
    ///
    /// # Errors
    /// If a sample is not finite.
    pub fn new<M: SampledMatrix>(
        matrix: &M,
        (partition, blocks): (&Partition, &[u32]),
        tolerance_db: f64,
        limits: Limits,
    ) -> Result<Traced> {
        let (recorded, n_cols) = (Recorded::new(matrix), matrix.n_cols());
        let asked = compression(partition, n_cols, tolerance_db, 1.0);
        let (begun, mut open, mut most) = (Instant::now(), blocks.to_vec(), limits.first);
        loop {
            // One batch for each doubling, so that a block that goes on finds its samples again.
            let samples = SamplePlan { batch: most, min: FIRST_LOOK, max: most };
            let config = CompressConfig { samples, ..asked.clone() };
            let flow = compress(&recorded, partition, &open, &config, |_, _| ControlFlow::Continue(()))?;
            ensure!(flow.is_continue(), "nobody stops these blocks");
            open.retain(|&block_idx| recorded.took_all(first_bundle(partition, block_idx), most));
            if open.is_empty() || most >= limits.most || begun.elapsed() * 2 > limits.time {
                break;
            }
            most *= 2;
        }
        Ok(Traced {
            partition: partition.clone(),
            n_cols,
            blocks: recorded.into_blocks(partition, blocks),
            most,
            n_open: open.len(),
            frame_blocks: partition.n_blocks(),
            share: 1.0,
            is_exact: false,
        })
    }

    /// Some blocks of a matrix without noise; a file is told for a picture of so many blocks.
    pub fn of_picture(picture: &Picture, blocks: &[u32], frame_blocks: usize) -> Traced {
        let partition = picture.partition();
        let block = |&block_idx: &u32| {
            let rows = picture.block_rows(&partition, block_idx as usize);
            Block { block_idx, halves: [rows.clone(), rows], sparse: [Vec::new(), Vec::new()], n_samples: [1; 2] }
        };
        Traced {
            blocks: blocks.iter().map(block).collect(),
            n_cols: picture.n_cols,
            partition,
            most: 1,
            n_open: 0,
            frame_blocks,
            share: SHARE_OF_RANKS,
            is_exact: true,
        }
    }

    /// Samples of a pixel, both halves together: in the mean, and at most.
    pub fn spp(&self) -> [f64; 2] {
        let all = self.blocks.iter().map(|block| f64::from(block.n_samples.iter().sum::<u32>()));
        [all.clone().sum::<f64>() / self.blocks.len() as f64, all.fold(0.0, f64::max)]
    }
}

impl Block {
    fn samples(&self, n_cols: usize) -> BlockSamples<'_> {
        BlockSamples {
            halves: self.halves.each_ref().map(Vec::as_slice),
            sparse: self.sparse.each_ref().map(Vec::as_slice),
            n_cols,
            bundle_len: CHANNELS,
            n_samples: self.n_samples,
        }
    }

    /// Entries that no low rank holds, each once, sorted by row and column: the mean of both halves' means.
    fn kept_apart(&self) -> Vec<SparseEntry> {
        let mut means = BTreeMap::<(u32, u32), f64>::new();
        for (entries, n_samples) in self.sparse.iter().zip(self.n_samples) {
            for entry in entries {
                *means.entry((entry.row, entry.col)).or_default() +=
                    0.5 * f64::from(entry.value) / f64::from(n_samples);
            }
        }
        let entry = |((row, col), value): ((u32, u32), f64)| SparseEntry { row, col, value: value as f32 };
        means.into_iter().map(entry).filter(|entry| entry.value != 0.0).collect()
    }
}

fn first_bundle(partition: &Partition, block_idx: u32) -> u32 {
    let [x, y, ..] = partition.rect(block_idx as usize);
    y * partition.width + x
}

/// Which samples: the first bundle of their block, half 0 or 1, the first of them and the one behind the last.
type Question = (u32, usize, u32, u32);

/// A matrix that remembers what it answered.
struct Recorded<'a, M> {
    matrix: &'a M,
    answers: Mutex<BTreeMap<Question, Arc<Answer>>>,
}

struct Answer {
    rows: Vec<f32>,
    sparse: Vec<SparseEntry>,
}

impl<'a, M: SampledMatrix> Recorded<'a, M> {
    fn new(matrix: &'a M) -> Self {
        Recorded { matrix, answers: Mutex::new(BTreeMap::new()) }
    }

    fn answers(&self) -> MutexGuard<'_, BTreeMap<Question, Arc<Answer>>> {
        self.answers.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether the block that begins with a bundle was asked for all samples up to an end.
    fn took_all(&self, first: u32, end: u32) -> bool {
        self.answers().keys().any(|question| question.0 == first && question.3 == end)
    }

    /// All that was answered, block by block.
    fn into_blocks(self, partition: &Partition, blocks: &[u32]) -> Vec<Block> {
        let bundle_size = self.matrix.bundle_len() * self.matrix.n_cols();
        let empty = |&block_idx: &u32| {
            let [_, _, width, height] = partition.rect(block_idx as usize);
            let len = (width * height) as usize * bundle_size;
            let halves = [vec![0.0; len], vec![0.0; len]];
            let block = Block { block_idx, halves, sparse: [Vec::new(), Vec::new()], n_samples: [0; 2] };
            (first_bundle(partition, block_idx), block)
        };
        let mut found: BTreeMap<u32, Block> = blocks.iter().map(empty).collect();
        let answers = self.answers.into_inner().unwrap_or_else(PoisonError::into_inner);
        for ((first, half, start, end), answer) in answers {
            let Some(block) = found.get_mut(&first) else { continue };
            block.halves[half].iter_mut().zip(&answer.rows).for_each(|(sum, x)| *sum += x);
            block.sparse[half].extend_from_slice(&answer.sparse);
            block.n_samples[half] += end - start;
        }
        found.into_values().collect()
    }
}

impl<M: SampledMatrix> SampledMatrix for Recorded<'_, M> {
    fn n_rows(&self) -> usize {
        self.matrix.n_rows()
    }

    fn n_cols(&self) -> usize {
        self.matrix.n_cols()
    }

    fn bundle_len(&self) -> usize {
        self.matrix.bundle_len()
    }

    fn add_rows(
        &self,
        bundles: &[u32],
        samples: Range<u32>,
        half: Half,
        out: &mut [f32],
        sparse: &mut Vec<SparseEntry>,
    ) {
        let question = (bundles[0], usize::from(half == Half::B), samples.start, samples.end);
        let known = self.answers().get(&question).cloned();
        let answer = known.unwrap_or_else(|| {
            let mut answer = Answer { rows: vec![0.0; out.len()], sparse: Vec::new() };
            self.matrix.add_rows(bundles, samples, half, &mut answer.rows, &mut answer.sparse);
            let answer = Arc::new(answer);
            self.answers().insert(question, answer.clone());
            answer
        });
        out.iter_mut().zip(&answer.rows).for_each(|(out, x)| *out += x);
        sparse.extend_from_slice(&answer.sparse);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering};

    use super::*;

    /// Four columns over 16 × 32 pixels, noisy in the lower block, where one entry is kept apart; counts the samples that it was asked for.
    struct Counting {
        n_asked: AtomicU32,
    }

    impl SampledMatrix for Counting {
        fn n_rows(&self) -> usize {
            CHANNELS * 16 * 32
        }

        fn n_cols(&self) -> usize {
            4
        }

        fn bundle_len(&self) -> usize {
            CHANNELS
        }

        fn add_rows(
            &self,
            bundles: &[u32],
            samples: Range<u32>,
            half: Half,
            out: &mut [f32],
            sparse: &mut Vec<SparseEntry>,
        ) {
            self.n_asked.fetch_add(samples.end - samples.start, Ordering::Relaxed);
            let is_noisy = bundles[0] > 0;
            for (place, x) in out.iter_mut().enumerate() {
                for sample in samples.clone() {
                    let key = u64::from(sample) * 2 + u64::from(half == Half::B) + 4096 * place as u64;
                    let random =
                        key.wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29).wrapping_mul(0xbf58_476d_1ce4_e5b9);
                    let noise = (random >> 40) as f32 / (1u64 << 23) as f32 - 1.0;
                    *x += 1.0 + if is_noisy { noise } else { 0.0 };
                }
            }
            if is_noisy {
                sparse.push(SparseEntry { row: 2, col: 1, value: 3.0 * samples.len() as f32 });
            }
        }
    }

    #[test]
    fn blocks_that_go_on_are_never_sampled_twice() {
        let counting = Counting { n_asked: AtomicU32::new(0) };
        let partition = Partition { width: 16, height: 32, tile: 16 };
        let limits = Limits { first: 8, most: 32, time: Duration::from_secs(3600) };
        let traced = Traced::new(&counting, (&partition, &[0, 1]), 70.0, limits).unwrap();
        let n_samples: Vec<[u32; 2]> = traced.blocks.iter().map(|block| block.n_samples).collect();
        assert_eq!((n_samples, traced.most, traced.n_open), (vec![[4; 2], [32; 2]], 32, 1));
        assert_eq!(counting.n_asked.into_inner(), 2 * (4 + 32));
        assert_eq!(traced.spp(), [36.0, 64.0]);
        // Sums of all samples, and the mean of what was kept apart.
        assert!(traced.blocks[0].halves.iter().flatten().all(|&x| x == 4.0));
        let sum: f32 = traced.blocks[1].halves[1].iter().sum();
        assert!((sum / traced.blocks[1].halves[1].len() as f32 - 32.0).abs() < 1.0, "{sum}");
        assert_eq!(traced.blocks[1].kept_apart(), [SparseEntry { row: 2, col: 1, value: 3.0 }]);
    }
}
