//! One call of `compress`: who takes which block, how long it is sampled, who is told.

use std::{
    ops::ControlFlow,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, AtomicUsize, Ordering},
    },
};

use crate::{
    compress::{BlockSamples, CompressConfig, CompressError, compress_group},
    factors::BlockFactors,
    matrix::{Half, SampledMatrix, SparseEntry},
    means::Means,
    partition::Partition,
    project::Verdict,
    sparse::merge,
};

/// Sparse entries that are collected before duplicates are merged.
const MERGE_AT: usize = 1 << 16;

/// The state that all threads of one call share.
pub(crate) struct Run<'a, M, F> {
    matrix: &'a M,
    partition: &'a Partition,
    blocks: &'a [u32],
    config: &'a CompressConfig,
    next: AtomicUsize,
    stopping: AtomicBool,
    sink: Mutex<Sink<F>>,
}

struct Sink<F> {
    on_block: F,
    /// The error of the earliest block in the order asked for, and its place in it.
    error: Option<(usize, CompressError)>,
}

/// Buffers of one thread, used again for each block.
#[derive(Default)]
struct Scratch {
    bundles: Vec<u32>,
    halves: [Vec<f32>; 2],
    sparse: Vec<SparseEntry>,
    merged: usize,
    means: Means,
}

impl<'a, M, F> Run<'a, M, F>
where
    M: SampledMatrix,
    F: FnMut(u32, Vec<BlockFactors>) -> ControlFlow<()> + Send,
{
    pub(crate) fn new(
        matrix: &'a M,
        partition: &'a Partition,
        blocks: &'a [u32],
        config: &'a CompressConfig,
        on_block: F,
    ) -> Self {
        let sink = Mutex::new(Sink { on_block, error: None });
        Self { matrix, partition, blocks, config, next: AtomicUsize::new(0), stopping: AtomicBool::new(false), sink }
    }

    /// Works on all threads of the pool until every block is done or somebody says stop.
    pub(crate) fn finish(self) -> Result<ControlFlow<()>, CompressError> {
        rayon::scope(|scope| {
            for _ in 0..rayon::current_num_threads().min(self.blocks.len()) {
                scope.spawn(|_| self.work());
            }
        });
        let sink = self.sink.into_inner().unwrap_or_else(PoisonError::into_inner);
        match sink.error {
            Some((_, error)) => Err(error),
            None if self.stopping.into_inner() => Ok(ControlFlow::Break(())),
            None => Ok(ControlFlow::Continue(())),
        }
    }

    fn work(&self) {
        let mut scratch = Scratch::default();
        while !self.stops() {
            let place = self.next.fetch_add(1, Ordering::Relaxed);
            let Some(&block) = self.blocks.get(place) else { return };
            match self.block(block, &mut scratch) {
                Ok(None) => return,
                Ok(Some(factors)) => self.deliver(block, factors),
                Err(error) => self.fail(place, error),
            }
        }
    }

    fn stops(&self) -> bool {
        self.stopping.load(Ordering::Relaxed)
    }

    fn deliver(&self, block: u32, factors: Vec<BlockFactors>) {
        let mut sink = self.sink.lock().unwrap_or_else(PoisonError::into_inner);
        if !self.stops() && (sink.on_block)(block, factors).is_break() {
            self.stopping.store(true, Ordering::Relaxed);
        }
    }

    fn fail(&self, place: usize, error: CompressError) {
        self.stopping.store(true, Ordering::Relaxed);
        let mut sink = self.sink.lock().unwrap_or_else(PoisonError::into_inner);
        if sink.error.as_ref().is_none_or(|(earliest, _)| place < *earliest) {
            sink.error = Some((place, error));
        }
    }

    /// Samples a block, twice as much each time, until every group is content; `None` if told to stop.
    fn block(&self, block: u32, scratch: &mut Scratch) -> Result<Option<Vec<BlockFactors>>, CompressError> {
        self.partition.bundles(block as usize, &mut scratch.bundles);
        let n_entries = scratch.bundles.len() * self.matrix.bundle_len() * self.matrix.n_cols();
        for half in &mut scratch.halves {
            half.clear();
            half.resize(n_entries, 0.0);
        }
        scratch.sparse.clear();
        scratch.merged = 0;
        let plan = self.config.samples;
        let (mut taken, mut target) = (0, plan.min.max(1).min(plan.max));
        loop {
            if self.sample(taken..target, scratch).is_break() {
                return Ok(None);
            }
            taken = target;
            if let Some(factors) = self.look(block, taken, scratch)? {
                return Ok(Some(factors));
            }
            target = taken.saturating_mul(2).min(plan.max);
        }
    }

    /// Adds samples to both halves, batch by batch.
    fn sample(&self, samples: std::ops::Range<u32>, scratch: &mut Scratch) -> ControlFlow<()> {
        let mut first = samples.start;
        while first < samples.end {
            let last = first.saturating_add(self.config.samples.batch).min(samples.end);
            for (half, sums) in [Half::A, Half::B].into_iter().zip(&mut scratch.halves) {
                if self.stops() {
                    return ControlFlow::Break(());
                }
                self.matrix.add_rows(&scratch.bundles, first..last, half, sums, &mut scratch.sparse);
            }
            if scratch.sparse.len() > 2 * scratch.merged + MERGE_AT {
                merge(&mut scratch.sparse);
                scratch.merged = scratch.sparse.len();
            }
            first = last;
        }
        ControlFlow::Continue(())
    }

    /// Compresses what was sampled; `None` if a group needs more samples and may have them.
    fn look(
        &self,
        block: u32,
        n_samples: u32,
        scratch: &mut Scratch,
    ) -> Result<Option<Vec<BlockFactors>>, CompressError> {
        let samples = BlockSamples {
            halves: [&scratch.halves[0], &scratch.halves[1]],
            sparse: &scratch.sparse,
            n_cols: self.matrix.n_cols(),
            bundle_len: self.matrix.bundle_len(),
            n_samples,
        };
        let mut all = Vec::with_capacity(self.config.groups.len());
        for group in &self.config.groups {
            let (factors, verdict) = compress_group(&samples, group, self.config, block, &mut scratch.means)?;
            if verdict == Verdict::MoreSamples && n_samples < self.config.samples.max {
                return Ok(None);
            }
            all.push(factors);
        }
        Ok(Some(all))
    }
}
