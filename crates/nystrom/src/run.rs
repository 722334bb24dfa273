//! One call of `compress`: who takes which block, how long it is sampled, who is told.

use std::{
    ops::{ControlFlow, Range},
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
};

use crate::{
    compress::{BlockSamples, CompressConfig, CompressError, Guide, SamplePlan, compress_group},
    factors::BlockFactors,
    matrix::{Half, SampledMatrix, SparseEntry},
    means::Means,
    partition::Partition,
    steer::Judge,
    sums::Sums,
};

/// The state that all threads of one call share.
pub(crate) struct Run<'a, M, F> {
    matrix: &'a M,
    partition: &'a Partition,
    blocks: &'a [u32],
    guide: Guide<'a>,
    config: &'a CompressConfig,
    left: Mutex<Vec<u32>>,
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
    halves: [Sums; 2],
    /// The sums that count of a half that was closed before the other one.
    kept: Vec<f32>,
    means: Means,
}

impl<'a, M, F> Run<'a, M, F>
where
    M: SampledMatrix,
    F: FnMut(u32, Vec<BlockFactors>) -> ControlFlow<()> + Send,
{
    pub(crate) fn new(
        (matrix, partition): (&'a M, &'a Partition),
        blocks: &'a [u32],
        guide: Guide<'a>,
        config: &'a CompressConfig,
        on_block: F,
    ) -> Self {
        let sink = Mutex::new(Sink { on_block, error: None });
        let left = Mutex::new(blocks.to_vec());
        Self { matrix, partition, blocks, guide, config, left, stopping: AtomicBool::new(false), sink }
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
            let Some(block) = self.next() else { return };
            match self.block(block, &mut scratch) {
                Ok(None) => return,
                Ok(Some(factors)) => self.deliver(block, factors),
                Err(error) => self.fail(self.blocks.iter().position(|b| *b == block).unwrap_or(0), error),
            }
        }
    }

    /// Takes the next block.
    fn next(&self) -> Option<u32> {
        let mut left = self.left.lock().unwrap_or_else(PoisonError::into_inner);
        if left.is_empty() {
            return None;
        }
        let place = (self.guide.order)(&left).min(left.len() - 1);
        Some(left.remove(place))
    }

    fn stops(&self) -> bool {
        let stops = self.stopping.load(Ordering::Relaxed) || !(self.guide.goes_on)();
        if stops {
            self.stopping.store(true, Ordering::Relaxed);
        }
        stops
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

    /// Samples a block, twice as much each time, until each half calls the other's samples enough; `None` if told to stop.
    fn block(&self, block: u32, scratch: &mut Scratch) -> Result<Option<Vec<BlockFactors>>, CompressError> {
        self.partition.bundles(block as usize, &mut scratch.bundles);
        let n_entries = scratch.bundles.len() * self.matrix.bundle_len() * self.matrix.n_cols();
        scratch.halves.iter_mut().for_each(|sums| sums.start(n_entries));
        let SamplePlan { min, max, .. } = self.config.samples;
        let mut judges = [Judge::default(), Judge::default()];
        let mut taken = min.max(1).min(max);
        // The first samples come in two parts as well, each of them half of the samples.
        if self.sample(0..taken / 2, scratch).is_break() || self.sample(taken / 2..taken, scratch).is_break() {
            return Ok(None);
        }
        while taken < max {
            self.look(block, &mut judges, scratch)?;
            if !scratch.halves.iter().any(Sums::open) {
                break;
            }
            let target = taken.saturating_mul(2).min(max);
            if self.sample(taken..target, scratch).is_break() {
                return Ok(None);
            }
            taken = target;
        }
        self.compress(block, scratch)
    }

    /// Adds samples, batch by batch. Where nobody looks at them any more, halves that are closed get none.
    fn sample(&self, samples: Range<u32>, scratch: &mut Scratch) -> ControlFlow<()> {
        for sums in &mut scratch.halves {
            sums.join();
            sums.keep(&mut scratch.kept);
        }
        let is_last = samples.end == self.config.samples.max;
        let mut first = samples.start;
        while first < samples.end {
            let last = first.saturating_add(self.config.samples.batch).min(samples.end);
            for (half, sums) in [Half::A, Half::B].into_iter().zip(&mut scratch.halves) {
                if self.stops() {
                    return ControlFlow::Break(());
                }
                if sums.open() || !is_last {
                    sums.add(self.matrix, &scratch.bundles, first..last, half);
                }
            }
            first = last;
        }
        ControlFlow::Continue(())
    }

    /// Closes each half whose other half has seen enough.
    fn look(&self, block: u32, judges: &mut [Judge; 2], scratch: &mut Scratch) -> Result<(), CompressError> {
        let open = scratch.halves.each_ref().map(Sums::open);
        let mut content = [false; 2];
        for half in [0, 1].into_iter().filter(|half| open[1 - half]) {
            let (halves, n_samples) = scratch.halves[half].parts();
            let parts = self.samples(halves, [&[], &[]], n_samples);
            content[half] = judges[half].is_content(&parts, self.config, block, &mut scratch.means)?;
        }
        for half in [0, 1].into_iter().filter(|&half| content[half]) {
            scratch.halves[1 - half].close();
        }
        Ok(())
    }

    /// Compresses what was sampled; `None` if told to stop.
    fn compress(&self, block: u32, scratch: &mut Scratch) -> Result<Option<Vec<BlockFactors>>, CompressError> {
        scratch.halves.iter_mut().for_each(Sums::join);
        let [(a, n_a), (b, n_b)] = scratch.halves.each_ref().map(|sums| sums.counted(&scratch.kept));
        let samples = self.samples([a, b], scratch.halves.each_ref().map(Sums::sparse), [n_a, n_b]);
        let group = |group| {
            let wanted = !self.stops();
            wanted.then(|| compress_group(&samples, group, self.config, block, &mut scratch.means)).transpose()
        };
        self.config.groups.iter().map(group).collect()
    }

    fn samples<'s>(
        &self,
        halves: [&'s [f32]; 2],
        sparse: [&'s [SparseEntry]; 2],
        n_samples: [u32; 2],
    ) -> BlockSamples<'s> {
        let (n_cols, bundle_len) = (self.matrix.n_cols(), self.matrix.bundle_len());
        BlockSamples { halves, sparse, n_cols, bundle_len, n_samples }
    }
}
