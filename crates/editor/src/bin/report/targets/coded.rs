//! A picture's matrix as the bytes of a file, by any method, and how far they are from the truth.

use std::sync::Arc;
use std::time::Instant;

use anyhow::{Result, ensure};
use clerestory_nystrom::rivals::{Method, unrounded};
use clerestory_nystrom::{
    BlockFactors, BlockLowRank, BlockSamples, ColumnGroup, ColumnRun, CompressConfig, NoisyColumns, PackPlan,
    PackedMatrix, Partition, Selection, Smoothing, Tolerance, compress_block,
};

use super::judged::{Judged, Spectrum};
use super::shared_right::SharedRight;
use crate::methods::dense::{CHANNELS, Picture, TILE};

/// As bakes have it: darker blocks are held to less.
pub const BRIGHT: f32 = 0.25;
/// What a bake of pictures leaves to the ranks; packing takes the rest of its tolerance.
pub const SHARE_OF_RANKS: f32 = 0.5;

/// A matrix whose brightest light is 1, and what is known of it.
pub struct Subject {
    /// What the results are held against.
    pub truth: Picture,
    /// What is compressed: two halves, one and the same where there is no noise.
    halves: Option<[Picture; 2]>,
    /// The truth's singular values.
    pub spectrum: Spectrum,
}

/// How factors are kept.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Storage {
    /// Packed, as files have them.
    Packed,
    /// Packed in a right basis that all blocks share.
    SharedRight,
    /// In 16-bit numbers, as they lie in memory.
    SixteenBits,
    /// In single precision, as they were computed: of our own method alone.
    Single,
}

/// How a matrix becomes bytes: what a bake does, or something else in its place.
#[derive(Clone, Copy)]
pub struct Coding {
    /// What makes factors.
    pub method: Method,
    /// How landmarks are chosen.
    pub selection: Selection,
    /// Side of a block in pixels.
    pub tile: usize,
    /// Whether it is told both halves, else their mean twice: then it knows of no noise.
    pub halves: bool,
    /// Whether noise is taken out of what is smooth.
    pub smooths: bool,
    /// What becomes of columns that are noisier than others.
    pub noisy_columns: NoisyColumns,
    /// How factors are kept.
    pub storage: Storage,
    /// Whether packing knows that columns are texels of a square, else it transforms none of them.
    pub grid: bool,
    /// Of what is chosen by chance.
    pub seed: u64,
}

impl Default for Coding {
    fn default() -> Self {
        let (method, selection, seed) = (Method::Projected, Selection::default(), CompressConfig::default().seed);
        Coding {
            method,
            selection,
            tile: TILE,
            halves: true,
            smooths: true,
            noisy_columns: NoisyColumns::default(),
            storage: Storage::Packed,
            grid: true,
            seed,
        }
    }
}

/// What became of it.
pub struct Coded {
    /// Bytes of the file's part over those of the dense matrix in single precision.
    pub ratio: f64,
    /// Mean rank over the blocks.
    pub mean_rank: f64,
    /// Multiplications per pixel and picture, three channels of light on all columns: with factors as they are unpacked, and
    /// with right factors in cosines, zeros left out. Of no use where a right basis is shared.
    pub multiply_adds: [f64; 2],
    /// Milliseconds per block: factors, then bytes.
    pub millis: [f64; 2],
    /// What is read back.
    pub matrix: BlockLowRank,
    /// Its errors.
    pub judged: Judged,
}

impl Subject {
    /// Brings the hardest light there is to 1.
    pub fn new(mut truth: Picture, mut halves: Option<[Picture; 2]>) -> Subject {
        let unit = (1.0 / truth.peak()) as f32;
        let pictures = halves.iter_mut().flatten().chain([&mut truth]);
        pictures.for_each(|picture| picture.values.iter_mut().for_each(|value| *value *= unit));
        let spectrum = Spectrum::new(&truth);
        Subject { truth, halves, spectrum }
    }

    /// The mean of what is compressed.
    pub fn sampled(&self) -> Picture {
        let [a, b] = self.halves.as_ref().map_or([&self.truth; 2], |halves| halves.each_ref());
        let values = a.values.iter().zip(&b.values).map(|(a, b)| 0.5 * (a + b)).collect();
        Picture { values, ..self.truth }
    }

    /// Compresses to a tolerance, packs, and reads what was packed.
    ///
    /// # Errors
    /// If the method finds no factors.
    pub fn coded(&self, method: Method, target_db: f64) -> Result<Coded> {
        self.coded_as(Coding { method, ..Coding::default() }, target_db)
    }

    /// The same, some of it done otherwise.
    ///
    /// # Errors
    /// As [`Subject::coded`].
    pub fn coded_as(&self, coding: Coding, target_db: f64) -> Result<Coded> {
        let (allowed, n_cols) = (10f64.powf(-target_db / 10.0) as f32, self.truth.n_cols);
        let share = if self.halves.is_some() { 1.0 } else { SHARE_OF_RANKS };
        let group = ColumnGroup {
            columns: 0..n_cols,
            tolerance: Tolerance::AbsoluteMeanSquare(share * allowed),
            preserved: vec![1.0; n_cols],
            share: 1.0,
            apart: 0.0,
        };
        let side = n_cols.isqrt() as u32;
        let grid = vec![ColumnRun::Grid { width: side, height: side }];
        let partition = Partition { tile: coding.tile as u32, ..self.truth.partition() };
        let smoothing = coding.smooths.then(|| Smoothing::new(partition.clone(), CHANNELS, vec![grid.clone()]));
        let config = CompressConfig {
            groups: vec![group],
            method: coding.method,
            selection: coding.selection,
            seed: coding.seed,
            max_rank: (CHANNELS * coding.tile * coding.tile) as u32,
            strong: BRIGHT,
            smoothing: smoothing.map(Arc::new),
            noisy_columns: coding.noisy_columns,
            ..CompressConfig::default()
        };
        let begun = Instant::now();
        let matrix = self.compressed(&config, &partition, coding)?;
        let compressing = begun.elapsed().as_secs_f64();
        let columns = if coding.grid { grid } else { vec![ColumnRun::List(n_cols as u32)] };
        let plan = pack_plan(columns, n_cols, allowed);
        let begun = Instant::now();
        let packed = single_threaded(|| PackedMatrix::pack(&matrix, &plan))?;
        let mut packing = begun.elapsed().as_secs_f64();
        let (n_bytes, read) = match coding.storage {
            Storage::Packed => written_and_read(&packed)?,
            Storage::SharedRight => {
                let begun = Instant::now();
                let shared = single_threaded(|| SharedRight::pack(&matrix, &plan))?;
                packing = begun.elapsed().as_secs_f64();
                (shared.n_bytes(), shared.unpack()?)
            }
            Storage::SixteenBits => (matrix.n_bytes(), matrix.clone()),
            Storage::Single => (bytes_in_single(&matrix), matrix.clone()),
        };
        let judged = match coding.storage {
            Storage::Single => Judged::beside(&self.truth, self.in_single(&config, &partition, coding)?, &read),
            _ => Judged::new(&self.truth, &read),
        };
        Ok(Coded {
            multiply_adds: multiply_adds(&packed, &read, self.truth.width * self.truth.height)?,
            ratio: read.dense_bytes() as f64 / n_bytes as f64,
            mean_rank: f64::from(read.mean_rank()),
            millis: [compressing, packing].map(|secs| secs * 1e3 / matrix.blocks.len() as f64),
            judged,
            matrix: read,
        })
    }

    fn compressed(&self, config: &CompressConfig, partition: &Partition, coding: Coding) -> Result<BlockLowRank> {
        let mut matrix = BlockLowRank::new(partition.clone(), CHANNELS as u32, self.truth.n_cols as u32);
        for (block_idx, block) in matrix.blocks.iter_mut().enumerate() {
            let halves = self.halves_of(partition, block_idx, coding);
            *block = compress_block(&self.samples(&halves), config, block_idx as u32)?.pop().map(Arc::new);
        }
        Ok(matrix)
    }

    /// All entries of the factors that [`Subject::compressed`] rounds, as they were computed.
    fn in_single(&self, config: &CompressConfig, partition: &Partition, coding: Coding) -> Result<Picture> {
        ensure!(coding.method == Method::Projected, "`{}` has no factors in single precision here", coding.method);
        let (mut pixels, len) = (Vec::new(), CHANNELS * self.truth.n_cols);
        let mut values = vec![0.0; self.truth.values.len()];
        for block_idx in 0..partition.n_blocks() {
            let halves = self.halves_of(partition, block_idx, coding);
            partition.bundles(block_idx, &mut pixels);
            for factors in unrounded(&self.samples(&halves), config, block_idx as u32)? {
                // What nalgebra holds column by column is wanted row by row.
                let rows = factors.to_dense().transpose();
                for (rows, &pixel) in rows.as_slice().chunks_exact(len).zip(&pixels) {
                    values[pixel as usize * len..][..len].copy_from_slice(rows);
                }
            }
        }
        Ok(Picture { values, ..self.truth })
    }

    /// The rows of a block in both halves, as a coding tells them.
    fn halves_of(&self, partition: &Partition, block_idx: usize, coding: Coding) -> [Vec<f32>; 2] {
        let rows = |picture: &Picture| picture.block_rows(partition, block_idx);
        let [mut a, mut b] = match &self.halves {
            Some(halves) => halves.each_ref().map(rows),
            None => [(); 2].map(|()| rows(&self.truth)),
        };
        if !coding.halves {
            a.iter_mut().zip(&mut b).for_each(|(a, b)| {
                *a = 0.5 * (*a + *b);
                *b = *a;
            });
        }
        [a, b]
    }

    fn samples<'a>(&self, halves: &'a [Vec<f32>; 2]) -> BlockSamples<'a> {
        BlockSamples {
            halves: halves.each_ref().map(Vec::as_slice),
            sparse: [&[]; 2],
            n_cols: self.truth.n_cols,
            bundle_len: CHANNELS,
            n_samples: [1; 2],
        }
    }
}

/// How a matrix whose brightest light is 1 is packed to a mean square error: darker blocks are held to less, as in bakes.
pub fn pack_plan(columns: Vec<ColumnRun>, n_cols: usize, allowed: f32) -> PackPlan {
    PackPlan { columns, allowed, strong: BRIGHT, apart: 0.0, preserved: vec![1.0; n_cols] }
}

/// Bytes that a packed matrix takes in a file, and what is read back.
///
/// # Errors
/// If it cannot be unpacked.
pub fn written_and_read(packed: &PackedMatrix) -> Result<(usize, BlockLowRank)> {
    let mut bytes = Vec::new();
    packed.encode(&mut bytes);
    Ok((bytes.len(), packed.unpack()?))
}

/// Multiplications per pixel and picture of what was packed and of what is read back, as [`Coded::multiply_adds`] has them.
///
/// # Errors
/// If bytes cannot be read that were packed.
pub fn multiply_adds(packed: &PackedMatrix, read: &BlockLowRank, n_pixels: usize) -> Result<[f64; 2]> {
    let [in_cosines, left] = packed.product()?.n_multiplications();
    let ranks: usize = read.blocks.iter().flatten().map(|block| block.rank as usize).sum();
    let per_pixel = |right: usize| (CHANNELS * right + left) as f64 / n_pixels as f64;
    Ok([ranks * read.n_cols as usize, in_cosines].map(per_pixel))
}

/// Bytes of factors in single precision, which need no scales.
fn bytes_in_single(matrix: &BlockLowRank) -> usize {
    let n_numbers = |block: &Arc<BlockFactors>| block.left.len() + block.doubt.len() + block.right.len();
    size_of::<f32>() * matrix.blocks.iter().flatten().map(n_numbers).sum::<usize>()
}

/// Runs on one thread what would run on all.
pub fn single_threaded<T: Send>(work: impl FnOnce() -> T + Send) -> Result<T> {
    Ok(rayon::ThreadPoolBuilder::new().num_threads(1).build()?.install(work))
}

impl Picture {
    /// Blocks of 16 × 16 pixels.
    pub fn partition(&self) -> Partition {
        Partition { width: self.width as u32, height: self.height as u32, tile: TILE as u32 }
    }

    /// The same with all entries of a compressed matrix.
    pub fn unpacked(&self, matrix: &BlockLowRank) -> Picture {
        let (mut pixels, len) = (Vec::new(), CHANNELS * self.n_cols);
        let mut values = vec![0.0; self.values.len()];
        for (block_idx, factors) in matrix.blocks.iter().enumerate() {
            let Some(factors) = factors else { continue };
            matrix.partition.bundles(block_idx, &mut pixels);
            for (rows, &pixel) in factors.dense().chunks_exact(len).zip(&pixels) {
                values[pixel as usize * len..][..len].copy_from_slice(rows);
            }
        }
        Picture { values, ..*self }
    }

    /// The rows of a block, one after the other.
    pub fn block_rows(&self, partition: &Partition, block_idx: usize) -> Vec<f32> {
        let (mut pixels, len) = (Vec::new(), CHANNELS * self.n_cols);
        partition.bundles(block_idx, &mut pixels);
        pixels.iter().flat_map(|&pixel| &self.values[pixel as usize * len..][..len]).copied().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::targets::soft;

    #[test]
    fn what_is_sampled_is_the_mean_of_both_halves_in_the_scale_of_the_truth() {
        let picture = |value: f32| Picture { width: 16, height: 16, n_cols: 2, values: vec![value; 16 * 16 * 3 * 2] };
        let subject = Subject::new(picture(4.0), Some([picture(2.0), picture(8.0)]));
        assert!(subject.truth.values.iter().all(|&x| x == 1.0));
        assert!(subject.sampled().values.iter().all(|&x| x == 1.25));
        assert!(Subject::new(picture(4.0), None).sampled().values.iter().all(|&x| x == 1.0));
    }

    #[test]
    fn factors_in_single_precision_are_twice_as_many_bytes_and_nearer_to_the_truth() {
        let subject = Subject::new(soft::picture(16, 16, 4), None);
        let coded = |storage: Storage| {
            let coded = subject.coded_as(Coding { storage, ..Coding::default() }, 120.0).unwrap();
            (coded.ratio, coded.judged.mean_square(), coded.mean_rank)
        };
        let [(short_ratio, short_error, rank), (single_ratio, single_error, same)] =
            [Storage::SixteenBits, Storage::Single].map(coded);
        assert!(rank > 4.0 && rank == same, "{rank} {same}");
        assert!((1.98..=2.0).contains(&(short_ratio / single_ratio)), "{short_ratio} {single_ratio}");
        assert!(single_error < 0.5 * short_error, "{single_error:e} {short_error:e}");
    }
}
