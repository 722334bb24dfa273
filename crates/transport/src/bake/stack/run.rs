//! From the columns of a stack to its blocks, band by band.

use std::ops::{ControlFlow, Range};
use std::sync::Arc;
use std::time::Instant;

use clerestory_nystrom::{
    BlockFactors, BlockLowRank, ColumnGroup, CompressConfig, Partition, SamplePlan, Tolerance, compress,
};

use super::band::{Band, StackMatrix};
use super::{READING, StackJob, SurveyedStack};
use crate::archive::Listener;
use crate::bake::clock::Clock;
use crate::bake::focus::Focus;
use crate::bake::{BRIGHT, Bake, BakeError, BakeEvent, BakeHeader, from_the_center, mean_square, most_rank};
use crate::figures::error_db;

impl StackJob {
    fn compress_config(&self, column_scale: &[f32]) -> CompressConfig {
        // The ranks leave out half of this, and packing takes the rest of the tolerance: fewest bytes.
        let allowed = 0.5 * mean_square(self.tolerance_db);
        let all = ColumnGroup {
            columns: 0..column_scale.len(),
            tolerance: Tolerance::AbsoluteMeanSquare(allowed),
            preserved: column_scale.iter().map(|scale| 1.0 / scale).collect(),
            share: 1.0,
            apart: 0.0,
        };
        CompressConfig {
            groups: vec![all],
            samples: SamplePlan { batch: 1, min: 1, max: 1 },
            method: self.method,
            max_rank: most_rank(self.block),
            seed: self.seed,
            strong: BRIGHT,
            ..CompressConfig::default()
        }
    }
}

impl SurveyedStack {
    /// Bakes. `on_event` may ask to stop; then the result is `None`.
    ///
    /// # Errors
    /// A picture that was changed in the meantime.
    pub fn run(self, mut on_event: impl FnMut(BakeEvent) -> ControlFlow<()> + Send) -> Result<Option<Bake>, BakeError> {
        let header = Arc::new(self.header.clone());
        self.run_from(header, &[], &mut on_event)
    }

    /// Bakes with a header that was made before; blocks that are `done` already are taken as they are.
    pub(crate) fn run_from(
        self,
        header: Arc<BakeHeader>,
        done: &[(usize, Vec<Arc<BlockFactors>>)],
        on_event: Listener,
    ) -> Result<Option<Bake>, BakeError> {
        let SurveyedStack { job, digests, first, .. } = self;
        let (partition, mut groups) = (header.partition(), header.empty_groups());
        let n_blocks = partition.n_blocks();
        if on_event(BakeEvent::Started { header: header.clone(), n_blocks, n_passes: 1 }).is_break() {
            return Ok(None);
        }
        for (block_idx, factors) in done {
            groups[0].blocks[*block_idx] = factors.first().cloned();
            if on_event(BakeEvent::of_block(0, (0, *block_idx), factors.clone())).is_break() {
                return Ok(None);
            }
        }
        let clock = Clock::new(&[Some(1)], n_blocks, done.len(), rayon::current_num_threads());
        let started = Instant::now();
        let mut run = Run { job: &job, header: &header, partition, groups, clock, started, on_event: &mut *on_event };
        let mut first = Some(first);
        for rows in job.bands() {
            // Taken even where all of it is done, so that no two bands are in memory.
            let known = first.take_if(|band| band.rows == rows);
            if run.blocks(&rows).is_empty() {
                continue;
            }
            let band = match known {
                Some(band) => band,
                None => Band::read(&job.stack, rows, &digests)?,
            };
            if run.band(&band)?.is_break() {
                return Ok(None);
            }
        }
        let groups = run.groups;
        if on_event(BakeEvent::PassDone { pass: 0, error_db: error_db(&groups, None) }).is_break() {
            return Ok(None);
        }
        Ok(Bake::packing(header, vec![groups], &Focus::default()))
    }
}

/// A bake under way.
struct Run<'a> {
    job: &'a StackJob,
    header: &'a BakeHeader,
    partition: Partition,
    groups: Vec<BlockLowRank>,
    clock: Clock,
    started: Instant,
    on_event: Listener<'a>,
}

impl Run<'_> {
    /// Blocks within some rows of pixels that are not there yet.
    fn blocks(&self, rows: &Range<u32>) -> Vec<u32> {
        let mut blocks = from_the_center(&self.partition);
        let is_within = |block: u32| rows.contains(&(block / self.partition.tiles_x() * self.partition.tile));
        blocks.retain(|&block| is_within(block) && self.groups[0].blocks[block as usize].is_none());
        blocks
    }

    fn band(&mut self, band: &Band) -> Result<ControlFlow<()>, BakeError> {
        let blocks = self.blocks(&band.rows);
        let film = self.job.stack.film;
        let matrix = StackMatrix { film, column_scale: &self.header.column_scale, band };
        let config = self.job.compress_config(&self.header.column_scale);
        let partition = self.partition.clone();
        let flow =
            compress(&matrix, &partition, &blocks, &config, |block, factors| self.deliver(block as usize, factors));
        Ok(flow?)
    }

    fn deliver(&mut self, block_idx: usize, factors: Vec<BlockFactors>) -> ControlFlow<()> {
        let factors: Vec<_> = factors.into_iter().map(Arc::new).collect();
        self.groups[0].blocks[block_idx] = factors.first().cloned();
        let (done, secs_left) = self.clock.block_done(self.started.elapsed().as_secs_f32());
        (self.on_event)(BakeEvent::of_block(0, (0, block_idx), factors))?;
        (self.on_event)(BakeEvent::Progress { pass: 0, done: READING + (1.0 - READING) * done, secs_left })
    }
}
