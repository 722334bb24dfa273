//! From samples to factors: block after block, in parallel, each sampled only until its tolerance is met.

use std::{
    ops::{ControlFlow, Range},
    sync::Arc,
};

use crate::{
    column_errors::column_errors,
    factors::BlockFactors,
    landmarks::Selection,
    level::Level,
    matrix::{SampledMatrix, SparseEntry},
    means::Means,
    partition::Partition,
    project::{Asked, factor, factor_levelled},
    random::Random,
    rivals::{self, Method, MethodError},
    run::Run,
    sketch::allowed,
    smooth::Smoothing,
    sparse::sparse_part,
    unpacked::Unpacked,
};

/// How much a block may differ from the matrix.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Tolerance {
    /// Mean square error per entry of a block, truncation and sampling together.
    AbsoluteMeanSquare(f32),
    /// Root of the error's energy over root of the block's energy.
    RelativeFrobenius(f32),
    /// At most this rank, and as many samples as the plan allows, unless samples do not differ at all. One component more where the
    /// preserved product needs it, see [`ColumnGroup::preserved`].
    Rank(u32),
}

/// How many times what is allowed the noise of samples is that only divided columns are looked at.
const HOPELESS: f64 = 8.0;

/// Least share of a tolerance that is left to a weak block: 12 dB tighter.
const TIGHTEST: f64 = 1.0 / 16.0;

/// Share of an absolute tolerance that is left to a block whose entries have some mean square. An error that is nothing
/// beside the largest entries of a matrix may be all there is in a weak block, so half of the distance in dB is made up for.
pub fn tightness(mean_square: f64, strong: f32) -> f64 {
    if strong > 0.0 { (mean_square.max(0.0).sqrt() / f64::from(strong)).clamp(TIGHTEST, 1.0) } else { 1.0 }
}

/// How weak a column may be in a block and still have its own share of what is allowed, see [`ColumnGroup::apart`]: 42 dB.
const WEAKEST: f64 = 1.0 / 128.0;

/// How strong a column is in a block where it has some mean square: its root mean square over that from which on an absolute tolerance
/// is taken as it is, at most 1.
pub(crate) fn strength(mean_square: f64, strong: f32) -> f64 {
    if strong > 0.0 { (mean_square.max(0.0).sqrt() / f64::from(strong)).clamp(WEAKEST, 1.0) } else { 1.0 }
}

/// The same of a column that is stored: beyond the reach of [`strength`] it asks for the less the weaker it is, and for nothing where it holds
/// nothing.
pub(crate) fn strength_to_store(mean_square: f64, strong: f32) -> f64 {
    let own = mean_square.max(0.0).sqrt() / f64::from(strong).max(f64::MIN_POSITIVE);
    if own < WEAKEST { (WEAKEST * WEAKEST / own.max(f64::MIN_POSITIVE)).min(1.0) } else { own.min(1.0) }
}

/// Columns that are compressed together.
#[derive(Clone, Debug, PartialEq)]
pub struct ColumnGroup {
    /// Columns of the matrix.
    pub columns: Range<usize>,
    /// What is asked of each block.
    pub tolerance: Tolerance,
    /// One weight per column: the product with these weights comes out as it was sampled, whatever the rank. Where the components
    /// hold too little of it, that takes one more, beyond any greatest rank. Its noise is no part of what ranks leave out: under an absolute
    /// tolerance a block is sampled until that too is as far as asked below the product at the peaks, 1, of all columns. Empty: none.
    pub preserved: Vec<f32>,
    /// Share of an absolute tolerance that truncation may take, 0…1: little where one column alone may be asked for, since the
    /// mean over many that hold nothing in a block hides what that one lacks. Samples are asked for by the whole.
    pub share: f32,
    /// Where columns are looked at one by one: root mean square of a column in a block from which on an absolute tolerance is taken as
    /// it is. Of a weaker one, down to 42 dB below that, the block may lack as much less as it is weaker, however strong the others
    /// are: they hide no error of a product that they are not in. 0: columns are looked at together, see [`CompressConfig::strong`].
    pub apart: f32,
}

/// How many samples each row gets, per half: `min`, then twice as many, until the tolerance is met.
///
/// What one half's samples say decides how many the *other* half takes: the number of samples then knows nothing of the
/// values they have, and the mean of each half is free of bias, however rare and large a sample may be. A half's single
/// sample does not tell how noisy it is; but where [colors are
/// independent](crate::SampledMatrix::colors_are_independent), every other bundle of a block tells it of those between.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SamplePlan {
    /// Samples that are taken at a time.
    pub batch: u32,
    /// Samples before the first look at the tolerance. A single one can be looked at only where colors are independent; else the
    /// second is taken too.
    pub min: u32,
    /// Samples at most: from 1 to 2³¹ − 1.
    pub max: u32,
}

/// What becomes of columns that are noisier than others where the samples of a block do not suffice for its tolerance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NoisyColumns {
    /// All are divided by their noise before the block is decomposed, so that a few noisy ones do not drown the others.
    #[default]
    Divided,
    /// They are decomposed as they were sampled, for comparison.
    AsSampled,
}

/// What is asked of [`compress`].
#[derive(Clone, Debug, PartialEq)]
pub struct CompressConfig {
    /// One result per group and block.
    pub groups: Vec<ColumnGroup>,
    /// Samples per row and half.
    pub samples: SamplePlan,
    /// How landmarks are chosen.
    pub selection: Selection,
    /// What makes factors of the samples; all but [`Method::Projected`] are there for comparison.
    pub method: Method,
    /// Greatest rank of a block, aside from the component that a preserved product may need, see [`ColumnGroup::preserved`].
    pub max_rank: u32,
    /// Root mean square of the entries of a block from which on an absolute tolerance is taken as it is; weaker blocks get the
    /// rank that a tighter one asks for, see [`tightness`]. 0: none does.
    pub strong: f32,
    /// How rows and columns lie, where noise may be taken out of what is smooth: done with blocks whose error would otherwise
    /// be greater than asked, if the halves tell that it helps. With or without it such blocks are found in columns that are
    /// divided by their noise, see [`NoisyColumns`]; tolerances of a rank alone ask for neither. Without
    /// it a block that samples do not suffice for may be farther from the matrix than the mean of its samples is: what is held
    /// against what is smoothing and none, never the samples themselves.
    pub smoothing: Option<Arc<Smoothing>>,
    /// What becomes of columns that are noisier than others in such blocks.
    pub noisy_columns: NoisyColumns,
    /// Groups of no more columns than that are kept as they were sampled, noise and all, each column a component of its own, if their
    /// columns are looked at [one by one](ColumnGroup::apart): for columns whose noise is taken out afterwards. 0: none is.
    pub verbatim: usize,
    /// The same seed gives the same factors.
    pub seed: u64,
}

impl Default for CompressConfig {
    fn default() -> Self {
        Self {
            groups: Vec::new(),
            samples: SamplePlan { batch: 16, min: 16, max: 64 },
            selection: Selection::Alg4,
            method: Method::Projected,
            max_rank: 96,
            strong: 0.0,
            smoothing: None,
            noisy_columns: NoisyColumns::default(),
            verbatim: 0,
            seed: 0,
        }
    }
}

/// Why a matrix could not be compressed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CompressError {
    /// A sample is infinite or not a number.
    #[error(
        "row {row}, column {col} of block {block} has a sample that is not finite; the matrix must return finite estimates"
    )]
    NonFinite {
        /// Block.
        block: u32,
        /// Row, counted from the first row of the block.
        row: u32,
        /// Column of the matrix.
        col: u32,
    },
    /// The method that was asked for found no factors.
    #[error("block {block} has no factors by the method `{method}`: {source}")]
    Method {
        /// Block.
        block: u32,
        /// Name of the method.
        method: String,
        /// What stood in the way.
        source: MethodError,
    },
    /// The request does not fit the matrix.
    #[error("cannot compress: {0}")]
    Config(String),
}

/// The sums of all samples of a block.
#[derive(Clone, Copy, Debug)]
pub struct BlockSamples<'a> {
    /// Sums of the two halves, row-major, rows × columns of the matrix.
    pub halves: [&'a [f32]; 2],
    /// Entries that no low rank holds, sums of the two halves; row counted within the block, column within the matrix.
    pub sparse: [&'a [SparseEntry]; 2],
    /// Columns of the matrix.
    pub n_cols: usize,
    /// Rows per bundle.
    pub bundle_len: usize,
    /// Samples of each row in the two halves.
    pub n_samples: [u32; 2],
}

/// Compresses some blocks of a matrix, in the order given, on as many threads as the current rayon pool has.
///
/// `on_block` gets one [`BlockFactors`] per group as soon as a block is done, one call at a time, in any order; it must not
/// wait for the same pool. [`ControlFlow::Break`] stops soon, after at most a batch of samples or the factors of a group, and is handed
/// back. The same matrix, config and seed give the same factors on any number of threads.
///
/// # Errors
/// A config that does not fit the matrix, samples that are not finite, or a method that finds no factors.
pub fn compress<M: SampledMatrix>(
    matrix: &M,
    partition: &Partition,
    blocks: &[u32],
    config: &CompressConfig,
    on_block: impl FnMut(u32, Vec<BlockFactors>) -> ControlFlow<()> + Send,
) -> Result<ControlFlow<()>, CompressError> {
    compress_by(Guide::default(), matrix, partition, blocks, config, on_block)
}

/// What somebody outside says while blocks are compressed.
#[derive(Clone, Copy)]
pub struct Guide<'a> {
    /// Is given the blocks that nobody has taken yet and says at which place among them the next one stands. The factors are the
    /// same in any order.
    pub order: &'a (dyn Fn(&[u32]) -> usize + Sync),
    /// Whether anybody wants the blocks; asked often, by several threads at once. A no ends the run within blocks, whatever others hear.
    pub goes_on: &'a (dyn Fn() -> bool + Sync),
    /// Is told of each block after `on_block`, by the thread that worked on it and while others go on: for work that blocks call for.
    pub delivered: &'a (dyn Fn(u32) + Sync),
}

impl Default for Guide<'_> {
    /// The blocks as they come, all of them.
    fn default() -> Self {
        Guide { order: &|_| 0, goes_on: &|| true, delivered: &|_| {} }
    }
}

/// The same under somebody's guidance, which may change while it runs.
///
/// # Errors
/// As [`compress`].
pub fn compress_by<M: SampledMatrix>(
    guide: Guide<'_>,
    matrix: &M,
    partition: &Partition,
    blocks: &[u32],
    config: &CompressConfig,
    on_block: impl FnMut(u32, Vec<BlockFactors>) -> ControlFlow<()> + Send,
) -> Result<ControlFlow<()>, CompressError> {
    check(matrix, partition, blocks, config)?;
    Run::new((matrix, partition), blocks, guide, config, on_block).finish()
}

/// Compresses one block from the sums of its samples: one result per group of the config.
///
/// # Errors
/// Groups beyond the columns, preserved weights that are not as many as these, halves of no rows or of different size, a smoothing made for
/// other blocks, samples that are not finite, or a method that finds no factors.
pub fn compress_block(
    samples: &BlockSamples<'_>,
    config: &CompressConfig,
    block_idx: u32,
) -> Result<Vec<BlockFactors>, CompressError> {
    check_samples(samples, config, block_idx)?;
    let mut means = Means::default();
    let group = |group| compress_group(samples, group, config, block_idx, &mut means);
    config.groups.iter().map(group).collect()
}

/// # Errors
/// Groups beyond the columns, preserved weights that are not as many as these, halves of no rows or of different size, or a smoothing made
/// for other blocks.
pub(crate) fn check_samples(
    samples: &BlockSamples<'_>,
    config: &CompressConfig,
    block_idx: u32,
) -> Result<(), CompressError> {
    check_groups(config, samples.n_cols)?;
    let [a, b] = samples.halves;
    let bundle_size = samples.n_cols * samples.bundle_len;
    let is_whole = bundle_size > 0 && !a.is_empty() && a.len() % bundle_size == 0;
    if a.len() != b.len() || !is_whole || samples.n_samples.contains(&0) {
        let words = "the halves of a block must hold samples of the same whole number of bundles, at least one";
        return Err(CompressError::Config(words.into()));
    }
    match &config.smoothing {
        Some(smoothing) => smoothing.check_block(samples, block_idx, &config.groups),
        None => Ok(()),
    }
}

/// Compresses one group of columns of a block.
pub(crate) fn compress_group(
    samples: &BlockSamples<'_>,
    group: &ColumnGroup,
    config: &CompressConfig,
    block_idx: u32,
    means: &mut Means,
) -> Result<BlockFactors, CompressError> {
    let mut factors = match config.method {
        Method::Projected => {
            let factors = unpacked(samples, group, config, block_idx, means)?;
            BlockFactors { column_errors: column_errors(means, &factors), ..factors.packed() }
        }
        method => {
            fill(means, samples, group, block_idx)?;
            let mut rng = Random::new([config.seed, u64::from(block_idx)]);
            rivals::block::factor(means, group.tolerance, config, rng.bits())
                .map_err(|source| CompressError::Method { block: block_idx, method: method.to_string(), source })?
        }
    };
    factors.n_samples = samples.n_samples.iter().sum();
    factors.sparse = sparse_part(samples.sparse, &group.columns, samples.n_samples);
    match factors.sparse.iter().find(|entry| !entry.value.is_finite()) {
        Some(entry) => {
            let col = group.columns.start as u32 + entry.col;
            Err(CompressError::NonFinite { block: block_idx, row: entry.row, col })
        }
        None => Ok(factors),
    }
}

/// The factors of a group of columns of a block, before they are packed and without a sparse part.
pub(crate) fn unpacked(
    samples: &BlockSamples<'_>,
    group: &ColumnGroup,
    config: &CompressConfig,
    block_idx: u32,
    means: &mut Means,
) -> Result<Unpacked, CompressError> {
    fill(means, samples, group, block_idx)?;
    if group.apart > 0.0 && group.columns.len() <= config.verbatim {
        return Ok(Unpacked::verbatim(means));
    }
    let rng = || Random::new([config.seed, u64::from(block_idx)]);
    let goal = allowed(means, group.tolerance);
    let is_asked = !matches!(group.tolerance, Tolerance::Rank(_)) && !means.is_exact();
    let is_hopeless = is_asked && means.noise_per_entry() > HOPELESS * goal;
    let is_apart = group.apart > 0.0 && matches!(group.tolerance, Tolerance::AbsoluteMeanSquare(_));
    let apart = if is_apart { Level::apart(means, group.apart) } else { None };
    // Columns that are divided by their strength are strong.
    let weighed = apart.as_ref().map_or(&*means, |level| &level.means);
    let tolerance = group.tolerance.tightened(weighed, config.strong, group.share);
    let asked = Asked { group, tolerance, bundle_len: samples.bundle_len, config };
    if !is_hopeless {
        let plain = match &apart {
            Some(level) => factor_levelled((means, level), asked, rng()).0,
            None => factor(means, asked, rng()),
        };
        if !is_asked || plain.error() <= goal {
            return Ok(plain);
        }
    }
    // What was divided before goes here: as many copies of a block as are needed, and no more, are what a thread takes.
    let level = match (config.noisy_columns, apart) {
        (NoisyColumns::Divided, apart) => Level::new(means, goal, apart.as_ref()),
        (NoisyColumns::AsSampled, Some(level)) => level,
        (NoisyColumns::AsSampled, None) => Level::undivided(means),
    };
    let (levelled, error) = factor_levelled((means, &level), asked, rng());
    // Where rare large samples are the noise, what is left out may seem less than nothing.
    if levelled.truncation.max(0.0) + levelled.sampling <= goal {
        return Ok(levelled);
    }
    let nth = config.groups.iter().position(|other| other.columns == group.columns);
    let (Some(smoothing), Some(nth)) = (&config.smoothing, nth) else { return Ok(levelled) };
    let smoother = smoothing.of_block(block_idx, nth);
    // Never worse than without, as far as the halves tell.
    Ok(smoother.factor((means, &level), error, asked, rng()).unwrap_or(levelled))
}

/// Takes over the columns of a group.
pub(crate) fn fill(
    means: &mut Means,
    samples: &BlockSamples<'_>,
    group: &ColumnGroup,
    block_idx: u32,
) -> Result<(), CompressError> {
    let filled = means.fill(samples.halves, samples.n_cols, &group.columns, samples.n_samples);
    filled.map_err(|[row, col]| CompressError::NonFinite { block: block_idx, row: row as u32, col: col as u32 })
}

fn check<M: SampledMatrix>(
    matrix: &M,
    partition: &Partition,
    blocks: &[u32],
    config: &CompressConfig,
) -> Result<(), CompressError> {
    let wrong = |words: String| Err(CompressError::Config(words));
    check_groups(config, matrix.n_cols())?;
    let n_bundles = partition.width as usize * partition.height as usize;
    if partition.tile == 0 {
        return wrong("the tiles of a partition need a side of 1 or more".into());
    }
    if n_bundles * matrix.bundle_len() != matrix.n_rows() {
        return wrong(format!("a partition of {n_bundles} bundles does not fit {} rows", matrix.n_rows()));
    }
    if let Some(block) = blocks.iter().find(|block| **block as usize >= partition.n_blocks()) {
        return wrong(format!("there is no block {block} among {}", partition.n_blocks()));
    }
    let SamplePlan { batch, min, max } = config.samples;
    if let Some(smoothing) = &config.smoothing {
        smoothing.check(partition, matrix.bundle_len(), &config.groups)?;
    }
    if batch == 0 || max == 0 || min > max || max > u32::MAX / 2 {
        let (needed, most) = ("a sample plan needs a batch of 1 or more, min ≤ max", u32::MAX / 2);
        return wrong(format!("{needed}, and max from 1 to {most}, not batch {batch}, min {min}, max {max}"));
    }
    Ok(())
}

fn check_groups(config: &CompressConfig, n_cols: usize) -> Result<(), CompressError> {
    let bad = |group: &&ColumnGroup| group.columns.is_empty() || group.columns.end > n_cols;
    if let Some(group) = config.groups.iter().find(bad) {
        return Err(CompressError::Config(format!("columns {:?} are not among {n_cols}", group.columns)));
    }
    let uneven = |group: &&ColumnGroup| !group.preserved.is_empty() && group.preserved.len() != group.columns.len();
    match config.groups.iter().find(uneven) {
        Some(group) => {
            let (given, asked) = (group.preserved.len(), group.columns.len());
            Err(CompressError::Config(format!("{given} preserved weights do not fit {asked} columns")))
        }
        None => Ok(()),
    }
}
