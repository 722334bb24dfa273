//! What a bake will take, told before it is made: a few blocks all over the picture are baked as the bake would, and counted
//! for all of them.
//!
//! Blocks stop when they are exact enough, so that no formula tells their samples, their ranks or their bytes; blocks of the
//! same picture do. What a bake does once (the scale of its columns, nodes of shared light, patches) is done once here as well.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::{Duration, Instant};

use clerestory_nystrom::{BlockLowRank, PackedMatrix, Partition};
use serde::Serialize;

use super::clock::Clock;
use super::focus::Focus;
use super::{Bake, BakeError, BakeEvent, BakeJob, Indirect, Passes, Run};
use crate::archive::header_len;
use crate::irradiance::IrradianceRows;
use crate::matrix::CHANNELS;
use crate::nodes::Nodes;

mod again;

/// Blocks that are tried, and at least so many for each thread.
const BLOCKS: usize = 48;
const BLOCKS_PER_THREAD: usize = 3;
/// Sums of the samples of a block that a thread holds at once, with what makes factors of them, whatever their rank: both parts of
/// both halves and what is kept of them, the means, those of divided columns, and what is smoothed.
const COPIES: u64 = 19;

/// Coefficients of a block that are held while it is packed, first as they are and then rounded, over its factors in memory.
const PACKING: f64 = 4.0;

/// What a bake will take.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct BakeEstimate {
    /// From start to end, seconds, on as many threads as estimated.
    pub secs: f32,
    /// Until the first whole picture, seconds; 0 if no preview is made.
    pub preview_secs: f32,
    /// Most memory at a time beside the scene, bytes, on as many threads as estimated.
    pub memory_bytes: u64,
    /// The same on a single thread, and what each further thread adds at most.
    pub least_memory_bytes: u64,
    /// See there.
    pub thread_bytes: u64,
    /// Of that what is taken at the end, when blocks are packed.
    pub ending_bytes: u64,
    /// Memory of the result, bytes.
    pub result_bytes: u64,
    /// The file, bytes.
    pub file_bytes: u64,
    /// Blocks of the picture.
    pub n_blocks: usize,
    /// Blocks that were tried.
    pub n_tried: usize,
}

/// Blocks of a matrix that are tried, at most.
pub(super) fn most_tried() -> usize {
    BLOCKS.max(BLOCKS_PER_THREAD * rayon::current_num_threads())
}

/// Some blocks all over a picture, in an order that covers it evenly from the first one on.
pub(super) fn spread(n_blocks: usize, most: usize) -> Vec<u32> {
    const GOLDEN: f64 = 0.618_033_988_749_895;
    let mut taken = vec![false; n_blocks];
    let places =
        (0..4 * most.max(n_blocks)).map(|nth| ((0.5 + nth as f64 * GOLDEN).fract() * n_blocks as f64) as usize);
    let fresh = places.filter(|&place| !std::mem::replace(&mut taken[place.min(n_blocks - 1)], true));
    fresh.take(most).map(|place| place as u32).collect()
}

/// When the blocks of a pass came.
struct Watch {
    started: Instant,
    /// When the last word before the first block was said, and when the last block came; seconds.
    prepared_secs: f32,
    last_secs: f32,
    n_done: usize,
}

impl Watch {
    fn new() -> Watch {
        Watch { started: Instant::now(), prepared_secs: 0.0, last_secs: 0.0, n_done: 0 }
    }

    fn hear(&mut self, event: &BakeEvent) {
        let now = self.started.elapsed().as_secs_f32();
        match event {
            BakeEvent::BlockDone { .. } | BakeEvent::IrradianceDone { .. } => {
                (self.n_done, self.last_secs) = (self.n_done + 1, now);
            }
            BakeEvent::Progress { .. } if self.n_done == 0 => self.prepared_secs = now,
            _ => {}
        }
    }

    /// Seconds for a number of blocks. Those that the other threads were at when the last one came are half done.
    fn secs_for(&self, n_blocks: usize, scales: Scales) -> f32 {
        let under_way = (rayon::current_num_threads() as f32 - 1.0) / 2.0;
        let of_blocks = |secs: f32| secs * n_blocks as f32 / (self.n_done as f32 + under_way).max(1.0);
        match scales {
            Scales::Blocks => self.prepared_secs + of_blocks(self.last_secs - self.prepared_secs),
            Scales::Everything => of_blocks(self.last_secs),
        }
    }
}

/// What of a pass takes longer for more blocks.
#[derive(Clone, Copy)]
enum Scales {
    /// What comes before them is for the whole picture.
    Blocks,
    /// All of it.
    Everything,
}

impl BakeJob {
    /// Tries a few blocks on the threads of the current pool, for about as long as `budget` beside what is done once. `None` if
    /// nobody wants it any more.
    ///
    /// # Errors
    /// As [`BakeJob::run`].
    pub fn estimate(&self, budget: Duration, focus: &Focus) -> Result<Option<BakeEstimate>, BakeError> {
        let begun = Instant::now();
        let Some(header) = self.header_toward(focus)?.map(Arc::new) else { return Ok(None) };
        let mut secs = begun.elapsed().as_secs_f32();
        let partitions = header.partitions();
        let plan = self.plan(super::Density::Full, &header);
        let (matrix, empty) = self.scaled_matrix(&plan, &header, focus);
        let passes = self.pass_samples(true);
        let last = passes.len() as u32 - 1;
        let header = &header;
        let mut run = Run::new(self, &matrix, header, (focus, empty), last);
        let n_tried = most_tried();
        let mut clock = Clock::new(&passes, partitions[0].n_blocks(), 0, rayon::current_num_threads());
        let of_irradiance = header.irradiance_passes(&passes, &vec![0; header.irradiance.len()], &mut clock);

        let (mut preview_secs, mut sampled) = (0.0, 0);
        for (nth, &samples) in passes.iter().enumerate() {
            let is_last = nth as u32 == last;
            // A block of an earlier pass must not stand for one of the last that was not tried.
            run.matrices[0] = header.empty_groups();
            let (partition, scales) = (&partitions[0], if is_last { self.scales() } else { Scales::Blocks });
            let blocks = spread(partition.n_blocks(), n_tried);
            let tried = try_blocks(budget, focus, |mut on_event| {
                run.pass(nth as u32, samples, &blocks, &mut clock, &mut on_event)
            });
            let Some(watch) = tried? else { return Ok(None) };
            secs += watch.secs_for(partition.n_blocks(), scales);
            let n_there = run.matrices[0].first().map_or(0, n_there);
            sampled = run.sampled_bytes() * partition.n_blocks() as u64 / n_there.max(1) as u64;
            let Some([once, blocks]) = run.try_end(is_last) else { return Ok(None) };
            let denoising = blocks * partition.n_blocks() as f32 / n_there.max(1) as f32;
            secs += once + denoising;
            if nth == 0 && samples.is_none() {
                preview_secs = secs;
            }
            for own in of_irradiance.iter().filter(|own| own.follows == nth as u32) {
                let partition = &partitions[1 + own.set];
                let blocks = spread(partition.n_blocks(), n_tried);
                let mut preview = run.empty_preview(own);
                let tried = try_blocks(budget, focus, |mut on_event| {
                    run.trace_irradiance(own, &blocks, &mut preview, &mut clock, &mut on_event)
                });
                let Some(watch) = tried? else { return Ok(None) };
                secs += watch.secs_for(partition.n_blocks(), self.scales());
                // Noise leaves what arrives at pixels as it leaves the picture.
                let has_neighbors = header.irradiance[own.set].rows == IrradianceRows::Pixels;
                secs += if has_neighbors { denoising } else { 0.0 };
            }
        }
        let Some((packing_secs, sizes)) = sizes(header, &run.matrices, &partitions, focus) else { return Ok(None) };
        let sizes = Sizes { sampled, guides: run.guides.as_ref().map_or(0, |guides| guides.n_bytes() as u64), ..sizes };
        let thread_bytes = thread_bytes(header.basis.n_cols(), self.config.block);
        let shared_bytes = self.shared_bytes().max(run.shared_bytes);
        let memory = |n_threads: u64| sizes.memory(n_threads * thread_bytes + shared_bytes);
        Ok(Some(BakeEstimate {
            secs: secs + packing_secs,
            preview_secs,
            memory_bytes: memory(rayon::current_num_threads() as u64),
            least_memory_bytes: memory(1),
            thread_bytes,
            ending_bytes: sizes.memory(0),
            result_bytes: sizes.factors + sizes.packed,
            file_bytes: sizes.packed + sizes.header,
            n_blocks: partitions[0].n_blocks(),
            n_tried: run.matrices[0].first().map_or(0, n_there),
        }))
    }

    /// Of the last pass: patches are traced for its blocks before them, everything else that comes first is for all of them.
    fn scales(&self) -> Scales {
        if self.config.patches > 0 { Scales::Everything } else { Scales::Blocks }
    }

    /// Memory that each thread of a bake works in, bytes, patches for free lamps aside.
    pub fn thread_bytes(&self) -> u64 {
        thread_bytes(self.scene.lighting.basis.n_cols(), self.config.block)
    }

    /// Memory of the light that pixels share, bytes, of the preview or of the bake; nothing where neither does. It is the least: the
    /// cells behind it, which walks find, come to that.
    pub fn shared_bytes(&self) -> u64 {
        if self.passes == Passes::FinalOnly && self.config.indirect == Indirect::Traced {
            return 0;
        }
        Nodes::bytes_for(self.film, self.scene.lighting.basis.n_cols()) as u64
    }
}

/// Memory that a thread works in for some columns and blocks of some side.
fn thread_bytes(n_cols: usize, side: u32) -> u64 {
    COPIES * u64::from(side * side) * (CHANNELS * n_cols * size_of::<f32>()) as u64
}

/// Bytes of all blocks of all matrices.
#[derive(Clone, Copy, Default)]
pub(super) struct Sizes {
    /// In memory.
    factors: u64,
    /// In the file.
    packed: u64,
    /// What stands before that in the file.
    header: u64,
    /// While a group of columns is packed.
    packing: u64,
    /// Of the picture, in memory, before noise was taken out.
    sampled: u64,
    /// What pixels show.
    guides: u64,
}

impl Sizes {
    /// Counts what was tried of a matrix for all of its blocks, and says how many times that is.
    fn add(&mut self, groups: &[BlockLowRank], packed: &[PackedMatrix], partition: &Partition) -> f64 {
        let n = groups.first().map_or(0, n_there).max(1);
        let factor = partition.n_blocks() as f64 / n as f64;
        let all = |bytes: usize| (bytes as f64 * factor) as u64;
        self.factors += groups.iter().map(|group| all(group.n_bytes())).sum::<u64>();
        let whole = |group: &PackedMatrix| all(group.block_bytes()) + (group.n_bytes() - group.block_bytes()) as u64;
        self.packed += packed.iter().map(whole).sum::<u64>();
        let telling = PackedMatrix::n_telling(partition.n_blocks()) as f64 / partition.n_blocks() as f64;
        let scratch = |group: &BlockLowRank| (PACKING * telling * all(group.n_bytes()) as f64) as u64;
        self.packing = groups.iter().map(scratch).fold(self.packing, u64::max);
        factor
    }

    /// At its most while blocks are sampled, or at the end, while noise is taken out of them or they are packed.
    fn memory(self, working: u64) -> u64 {
        let sampling = self.sampled.max(self.factors) + working;
        let denoising = if self.guides > 0 { self.sampled + self.factors + self.guides } else { 0 };
        sampling.max(denoising).max(self.factors + self.packing.max(self.packed) + self.guides)
    }
}

fn n_there(group: &BlockLowRank) -> usize {
    group.blocks.iter().filter(|block| block.is_some()).count()
}

/// Packs what was tried, counted for all blocks, and the seconds that packing all of them will take.
pub(super) fn sizes(
    header: &Arc<super::BakeHeader>,
    matrices: &[Vec<BlockLowRank>],
    partitions: &[Partition],
    focus: &Focus,
) -> Option<(f32, Sizes)> {
    let begun = Instant::now();
    let bake = Bake::packing(header.clone(), matrices.to_vec(), focus)?;
    let packing_secs = begun.elapsed().as_secs_f32();
    let (mut sizes, mut most) = (Sizes { header: header_len(&bake.header), ..Sizes::default() }, 1.0f64);
    let packed = bake.packed.iter().flat_map(|matrices| matrices.iter());
    for ((groups, packed), partition) in matrices.iter().zip(packed).zip(partitions) {
        most = most.max(sizes.add(groups, packed, partition));
    }
    Some((packing_secs * most as f32, sizes))
}

/// Runs a pass until its blocks are done or the time is over; `None` if nobody wants it any more.
fn try_blocks(
    budget: Duration,
    focus: &Focus,
    run: impl FnOnce(&mut (dyn FnMut(BakeEvent) -> ControlFlow<()> + Send)) -> Result<ControlFlow<()>, BakeError>,
) -> Result<Option<Watch>, BakeError> {
    let mut watch = Watch::new();
    // Whether it broke off, the watch knows.
    let _ = run(&mut |event| {
        watch.hear(&event);
        let enough = watch.n_done >= rayon::current_num_threads() && watch.started.elapsed() > budget;
        if focus.is_left() || enough { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    })?;
    Ok((!focus.is_left()).then_some(watch))
}

#[cfg(test)]
mod tests;
