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
        drop(sink);
        if !self.stops() {
            (self.guide.delivered)(block);
        }
    }

    fn fail(&self, place: usize, error: CompressError) {
        self.stopping.store(true, Ordering::Relaxed);
        let mut sink = self.sink.lock().unwrap_or_else(PoisonError::into_inner);
        if sink.error.as_ref().is_none_or(|(earliest, _)| place < *earliest) {
            sink.error = Some((place, error));
        }
    }

    /// Samples a block and compresses it; `None` if told to stop.
    fn block(&self, block: u32, scratch: &mut Scratch) -> Result<Option<Vec<BlockFactors>>, CompressError> {
        self.partition.bundles(block as usize, &mut scratch.bundles);
        let SamplePlan { min, max, .. } = self.config.samples;
        let has_colors = min <= 1 && max > 1 && parts::has_colors(self.matrix, &scratch.bundles);
        let n_parts = if has_colors { 2 } else { 1 };
        let (parts, place) = (&mut scratch.parts[..n_parts], (self.partition, block));
        parts::start(parts, place, &scratch.bundles, self.bundle_size());
        let mut is_done = [false; 2];
        if has_colors {
            for part in parts.iter_mut() {
                if self.sample(0..1, part).is_break() {
                    return Ok(None);
                }
            }
            is_done = self.look_across(block, scratch)?;
        }
        for nth in (0..n_parts).filter(|nth| !is_done[*nth]) {
            let taken = u32::from(has_colors);
            if self.go_on(block, (nth, taken), scratch)?.is_break() {
                return Ok(None);
            }
        }
        self.compress(block, n_parts, scratch)
    }

    /// Entries of a bundle.
    fn bundle_size(&self) -> usize {
        self.matrix.bundle_len() * self.matrix.n_cols()
    }

    /// What is looked at of two samplings of a part.
    fn asked<'s>(&self, part: &Part, rows: [&'s [f32]; 2], [a, b]: &'s mut [Vec<f32>; 2]) -> [&'s [f32]; 2] {
        [part.asked(rows[0], self.bundle_size(), a), part.asked(rows[1], self.bundle_size(), b)]
    }

    /// Which color has seen enough after one sample of each half, as the other one tells. Nobody judges what is kept apart: whoever
    /// meets that says no.
    fn look_across(&self, block: u32, scratch: &mut Scratch) -> Result<[bool; 2], CompressError> {
        let mut is_done = [false; 2];
        let parts = scratch.parts.iter().enumerate();
        for (color, part) in parts.filter(|(_, part)| part.halves.iter().all(|half| half.sparse().is_empty())) {
            let first = part.halves.each_ref().map(|half| half.parts().0[1]);
            let samples = self.samples(self.asked(part, first, &mut scratch.some), [&[], &[]], [1; 2]);
            is_done[1 - color] = Judge::default().is_content(&samples, 1.0, self.config, block, &mut scratch.means)?;
        }
        Ok(is_done)
    }

    /// Samples a part that has some samples, twice as much each time, until each half calls the other's samples enough.
    fn go_on(
        &self,
        block: u32,
        (nth, mut taken): (usize, u32),
        scratch: &mut Scratch,
    ) -> Result<ControlFlow<()>, CompressError> {
        let SamplePlan { min, max, .. } = self.config.samples;
        let mut judges = [Judge::default(), Judge::default()];
        if taken == 0 {
            taken = min.max(1).min(max);
            // The first samples come in two parts as well, each of them half of the samples.
            for samples in [0..taken / 2, taken / 2..taken] {
                if self.sample(samples, &mut scratch.parts[nth]).is_break() {
                    return Ok(ControlFlow::Break(()));
                }
            }
        }
        while taken < max {
            self.look(block, &mut judges, nth, scratch)?;
            if !scratch.parts[nth].halves.iter().any(Sums::open) {
                break;
            }
            let target = taken.saturating_mul(2).min(max);
            if self.sample(taken..target, &mut scratch.parts[nth]).is_break() {
                return Ok(ControlFlow::Break(()));
            }
            taken = target;
        }
        Ok(ControlFlow::Continue(()))
    }

    /// Adds samples, batch by batch. Where nobody looks at them any more, halves that are closed get none.
    fn sample(&self, samples: Range<u32>, part: &mut Part) -> ControlFlow<()> {
        for sums in &mut part.halves {
            sums.join();
            sums.keep(&mut part.kept);
        }
        let is_last = samples.end == self.config.samples.max;
        let mut first = samples.start;
        while first < samples.end {
            let last = first.saturating_add(self.config.samples.batch).min(samples.end);
            for (half, sums) in [Half::A, Half::B].into_iter().zip(&mut part.halves) {
                if self.stops() {
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
            content[half] = judges[half].is_content(&samples, 0.5, self.config, block, &mut scratch.means)?;
        }
        for half in [0, 1].into_iter().filter(|&half| content[half]) {
            scratch.parts[nth].halves[1 - half].close();
        }
        Ok(())
    }

    /// Compresses what was sampled; `None` if told to stop.
    fn compress(
        &self,
        block: u32,
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
            let wanted = !self.stops();
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
