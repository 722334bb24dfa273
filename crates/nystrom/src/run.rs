//! One call of `compress`: who takes which block, how long it is sampled, who is told.

use std::{
    ops::{ControlFlow, Range},
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, AtomicUsize, Ordering},
    },
};

use crate::{
    compress::{BlockSamples, CompressConfig, CompressError, Guide, SamplePlan, compress_group},
    factors::BlockFactors,
    matrix::{Half, SampledMatrix, SparseEntry},
    means::Means,
    partition::Partition,
    parts::{self, Part, Together},
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
    /// Place of the first block taken that has failed, `usize::MAX` if none has: those taken after it are not finished.
    failed: AtomicUsize,
    sink: Mutex<Sink<F>>,
}

/// A block that a thread has taken.
#[derive(Clone, Copy)]
struct Taken {
    block: u32,
    /// How many were taken before.
    place: usize,
}

struct Sink<F> {
    on_block: F,
    /// Of all that failed the error of the block that was taken first, and its place. Blocks taken before it were finished, so
    /// that in the same order it is the same one on any number of threads.
    error: Option<(usize, CompressError)>,
}

/// Buffers of one thread, used again for each block.
#[derive(Default)]
struct Scratch {
    bundles: Vec<u32>,
    parts: [Part; 2],
    together: Together,
    /// Some rows of two samplings.
    some: [Vec<f32>; 2],
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
        let (stopping, failed) = (AtomicBool::new(false), AtomicUsize::new(usize::MAX));
        Self { matrix, partition, blocks, guide, config, left, stopping, failed, sink }
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
        while !self.stops(usize::MAX) {
            let Some(taken) = self.next() else { return };
            match self.block(taken, &mut scratch) {
                Ok(None) => return,
                Ok(Some(factors)) => self.deliver(taken, factors),
                Err(error) => self.fail(taken.place, error),
            }
        }
    }

    /// Takes the next block.
    fn next(&self) -> Option<Taken> {
        let mut left = self.left.lock().unwrap_or_else(PoisonError::into_inner);
        if left.is_empty() {
            return None;
        }
        let next = (self.guide.order)(&left).min(left.len() - 1);
        let place = self.blocks.len() - left.len();
        Some(Taken { block: left.remove(next), place })
    }

    /// Whether nobody wants the block that was taken at a place: everybody is told to stop, or one taken earlier has failed.
    fn stops(&self, place: usize) -> bool {
        let stops = self.stopping.load(Ordering::Relaxed) || !(self.guide.goes_on)();
        if stops {
            self.stopping.store(true, Ordering::Relaxed);
        }
        stops || self.failed.load(Ordering::Relaxed) < place
    }

    fn deliver(&self, Taken { block, place }: Taken, factors: Vec<BlockFactors>) {
        let mut sink = self.sink.lock().unwrap_or_else(PoisonError::into_inner);
        if !self.stops(place) && (sink.on_block)(block, factors).is_break() {
            self.stopping.store(true, Ordering::Relaxed);
        }
        drop(sink);
        if !self.stops(place) {
            (self.guide.delivered)(block);
        }
    }

    fn fail(&self, place: usize, error: CompressError) {
        self.failed.fetch_min(place, Ordering::Relaxed);
        let mut sink = self.sink.lock().unwrap_or_else(PoisonError::into_inner);
        if sink.error.as_ref().is_none_or(|(earliest, _)| place < *earliest) {
            sink.error = Some((place, error));
        }
    }

    /// Samples a block and compresses it; `None` if told to stop.
    fn block(&self, taken: Taken, scratch: &mut Scratch) -> Result<Option<Vec<BlockFactors>>, CompressError> {
        let block = taken.block;
        self.partition.bundles(block as usize, &mut scratch.bundles);
        let SamplePlan { min, max, .. } = self.config.samples;
        let has_colors = min <= 1 && max > 1 && parts::has_colors(self.matrix, &scratch.bundles);
        let n_parts = if has_colors { 2 } else { 1 };
        let (parts, place) = (&mut scratch.parts[..n_parts], (self.partition, block));
        parts::start(parts, place, &scratch.bundles, self.bundle_size());
        let mut is_done = [false; 2];
        if has_colors {
            for part in parts.iter_mut() {
                if self.sample(taken, 0..1, part).is_break() {
                    return Ok(None);
                }
            }
            is_done = self.look_across(block, scratch)?;
        }
        for nth in (0..n_parts).filter(|nth| !is_done[*nth]) {
            if self.go_on(taken, (nth, u32::from(has_colors)), scratch)?.is_break() {
                return Ok(None);
            }
        }
        self.compress(taken, n_parts, scratch)
    }

    /// Entries of a bundle.
    fn bundle_size(&self) -> usize {
        self.matrix.bundle_len() * self.matrix.n_cols()
    }

    /// What is looked at of two samplings of a part.
    fn asked<'s>(&self, part: &Part, rows: [&'s [f32]; 2], [a, b]: &'s mut [Vec<f32>; 2]) -> [&'s [f32]; 2] {
        [part.asked(rows[0], self.bundle_size(), a), part.asked(rows[1], self.bundle_size(), b)]
    }

    /// What was said of a row that is asked of a part, as said of the row of the block.
    fn of_block(&self, part: &Part, mut error: CompressError) -> CompressError {
        if let CompressError::NonFinite { row, .. } = &mut error {
            *row = part.row_of_block(*row as usize, self.matrix.bundle_len()) as u32;
        }
        error
    }

    /// Which color has seen enough after one sample of each half, as the other one tells. Nobody judges what is kept apart: whoever
    /// meets that says no.
    fn look_across(&self, block: u32, scratch: &mut Scratch) -> Result<[bool; 2], CompressError> {
        let mut is_done = [false; 2];
        let parts = scratch.parts.iter().enumerate();
        for (color, part) in parts.filter(|(_, part)| part.halves.iter().all(|half| half.sparse().is_empty())) {
            let first = part.halves.each_ref().map(|half| half.parts().0[1]);
            let samples = self.samples(self.asked(part, first, &mut scratch.some), [&[], &[]], [1; 2]);
            let is_content = Judge::default().is_content(&samples, 1.0, self.config, block, &mut scratch.means);
            is_done[1 - color] = is_content.map_err(|error| self.of_block(part, error))?;
        }
        Ok(is_done)
    }

    /// Samples a part that has some samples, twice as much each time, until each half calls the other's samples enough.
    fn go_on(
        &self,
        taken: Taken,
        (nth, mut n_samples): (usize, u32),
        scratch: &mut Scratch,
    ) -> Result<ControlFlow<()>, CompressError> {
        let SamplePlan { min, max, .. } = self.config.samples;
        let mut judges = [Judge::default(), Judge::default()];
        if n_samples == 0 {
            n_samples = min.max(1).min(max);
            // The first samples come in two parts as well, each of them half of the samples.
            for samples in [0..n_samples / 2, n_samples / 2..n_samples] {
                if self.sample(taken, samples, &mut scratch.parts[nth]).is_break() {
                    return Ok(ControlFlow::Break(()));
                }
            }
        }
        while n_samples < max {
            self.look(taken.block, &mut judges, nth, scratch)?;
            if !scratch.parts[nth].halves.iter().any(Sums::open) {
                break;
            }
            let target = n_samples.saturating_mul(2).min(max);
            if self.sample(taken, n_samples..target, &mut scratch.parts[nth]).is_break() {
                return Ok(ControlFlow::Break(()));
            }
            n_samples = target;
        }
        Ok(ControlFlow::Continue(()))
    }

    /// Adds samples, batch by batch. Where nobody looks at them any more, halves that are closed get none.
    fn sample(&self, taken: Taken, samples: Range<u32>, part: &mut Part) -> ControlFlow<()> {
        for sums in &mut part.halves {
            sums.join();
            sums.keep(&mut part.kept);
        }
        let is_last = samples.end == self.config.samples.max;
        let mut first = samples.start;
        while first < samples.end {
            let last = first.saturating_add(self.config.samples.batch).min(samples.end);
            for (half, sums) in [Half::A, Half::B].into_iter().zip(&mut part.halves) {
                if self.stops(taken.place) {
                    return ControlFlow::Break(());
                }
                if sums.open() || !is_last {
                    sums.add(self.matrix, &part.bundles, first..last, half);
                }
            }
            first = last;
        }
        ControlFlow::Continue(())
    }

    /// Closes each half whose other half has seen enough.
    fn look(
        &self,
        block: u32,
        judges: &mut [Judge; 2],
        nth: usize,
        scratch: &mut Scratch,
    ) -> Result<(), CompressError> {
        let part = &scratch.parts[nth];
        let open = part.halves.each_ref().map(Sums::open);
        let mut content = [false; 2];
        for half in [0, 1].into_iter().filter(|half| open[1 - half]) {
            let (sums, n_samples) = part.halves[half].parts();
            let samples = self.samples(self.asked(part, sums, &mut scratch.some), [&[], &[]], n_samples);
            // The mean of both halves has half of the variance of one.
            let is_content = judges[half].is_content(&samples, 0.5, self.config, block, &mut scratch.means);
            content[half] = is_content.map_err(|error| self.of_block(part, error))?;
        }
        for half in [0, 1].into_iter().filter(|&half| content[half]) {
            scratch.parts[nth].halves[1 - half].close();
        }
        Ok(())
    }

    /// Compresses what was sampled; `None` if told to stop.
    fn compress(
        &self,
        Taken { block, place }: Taken,
        n_parts: usize,
        scratch: &mut Scratch,
    ) -> Result<Option<Vec<BlockFactors>>, CompressError> {
        let parts = &mut scratch.parts[..n_parts];
        parts.iter_mut().flat_map(|part| &mut part.halves).for_each(Sums::join);
        let counted = match parts {
            [whole] => whole.whole(),
            parts => scratch.together.bring(parts, (self.matrix.bundle_len(), self.bundle_size())),
        };
        let samples = self.samples(counted.halves, counted.sparse, counted.n_samples);
        let group = |group| {
            let compress = || {
                let factors = compress_group(&samples, group, self.config, block, &mut scratch.means)?;
                Ok(BlockFactors { n_samples: counted.mean_samples, ..factors })
            };
            let wanted = !self.stops(place);
            wanted.then(compress).transpose()
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
