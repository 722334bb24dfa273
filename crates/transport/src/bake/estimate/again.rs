//! What a bake will take that takes columns over from an earlier one: only the rest is tried.

use std::sync::Arc;
use std::time::{Duration, Instant};

use clerestory_nystrom::{BlockLowRank, PackPlan, PackedMatrix};

use super::{BakeEstimate, Sizes, most_tried, n_there, spread, thread_bytes, try_blocks};
use crate::archive::header_len;
use crate::bake::clock::Clock;
use crate::bake::focus::Focus;
use crate::bake::reuse::Reuse;
use crate::bake::{BakeError, BakeJob, Density, Run};

impl BakeJob {
    /// As [`BakeJob::estimate`] for [`BakeJob::run_reusing`].
    ///
    /// # Errors
    /// As [`BakeJob::run`].
    pub fn estimate_reusing(
        &self,
        reuse: &Reuse,
        budget: Duration,
        focus: &Focus,
    ) -> Result<Option<BakeEstimate>, BakeError> {
        let rest = match reuse.rest_of(self.clone()) {
            _ if reuse.n_added_rows() > 0 => reuse.regrouped(self.clone()).estimate_rows(reuse, budget, focus)?,
            Some(rest) => rest.estimate(budget, focus)?,
            None => Some(BakeEstimate::default()),
        };
        Ok(rest.map(|rest| rest.beside(reuse.kept_bytes())))
    }

    /// Of the rows of irradiance that the earlier bake lacks, without what it has.
    fn estimate_rows(&self, reuse: &Reuse, budget: Duration, focus: &Focus) -> Result<Option<BakeEstimate>, BakeError> {
        let begun = Instant::now();
        let header = Arc::new(reuse.header_with_rows(self, focus)?);
        let mut secs = begun.elapsed().as_secs_f32();
        let plan = self.plan(Density::Full, &header);
        let (matrix, empty) = self.scaled_matrix(&plan, &header, focus);
        let (passes, partitions) = (self.irradiance_samples(), header.partitions());
        let mut run = Run::new(self, &matrix, &header, (focus, empty), passes.len() as u32 - 1);
        let (n_of_picture, n_threads) = (partitions[0].n_blocks(), rayon::current_num_threads());
        let mut clock = Clock::new(&passes[passes.len() - 1..], n_of_picture, n_of_picture, n_threads);
        let mut of_irradiance = header.irradiance_passes(&passes, &vec![0; header.irradiance.len()], &mut clock);
        of_irradiance.retain(|own| reuse.adds(own.set));
        for own in &of_irradiance {
            let n_blocks = partitions[1 + own.set].n_blocks();
            let blocks = spread(n_blocks, most_tried());
            let tried =
                try_blocks(budget, focus, |mut on_event| run.irradiance(own, &blocks, &mut clock, &mut on_event));
            let Some(watch) = tried? else { return Ok(None) };
            secs += watch.secs_for(n_blocks, self.scales());
        }
        let (plans, mut sizes, mut tried) = (header.pack_plans(), Sizes::default(), [0, 0]);
        for matrix in (1..partitions.len()).filter(|matrix| reuse.adds(matrix - 1)) {
            let (groups, begun) = (&run.matrices[matrix], Instant::now());
            let pack = |(group, plan): (&BlockLowRank, &PackPlan)| PackedMatrix::pack(group, plan);
            let packed: Vec<PackedMatrix> = groups.iter().zip(&plans[matrix]).map(pack).collect();
            let factor = sizes.add(groups, &packed, &partitions[matrix]);
            secs += begun.elapsed().as_secs_f32() * factor as f32;
            tried[0] += partitions[matrix].n_blocks();
            tried[1] += groups.first().map_or(0, n_there);
        }
        let thread_bytes = thread_bytes(header.basis.n_cols(), header.tile);
        let shared_bytes = self.shared_bytes().max(run.shared_bytes);
        let memory = |n_threads: u64| sizes.memory(n_threads * thread_bytes + shared_bytes);
        Ok(Some(BakeEstimate {
            secs,
            preview_secs: 0.0,
            memory_bytes: memory(n_threads as u64),
            least_memory_bytes: memory(1),
            thread_bytes,
            ending_bytes: sizes.memory(0),
            result_bytes: sizes.factors + sizes.packed,
            file_bytes: sizes.packed + header_len(&header),
            n_blocks: tried[0],
            n_tried: tried[1],
        }))
    }
}

impl BakeEstimate {
    /// With what is there already: bytes of factors in memory, and packed.
    fn beside(self, [factors, packed]: [u64; 2]) -> BakeEstimate {
        let kept = factors + packed;
        BakeEstimate {
            memory_bytes: self.memory_bytes + kept,
            least_memory_bytes: self.least_memory_bytes + kept,
            ending_bytes: self.ending_bytes + kept,
            result_bytes: self.result_bytes + kept,
            file_bytes: self.file_bytes + packed,
            ..self
        }
    }
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;

    use super::*;
    use crate::bake::Bake;
    use crate::bake::floor::job;
    use crate::camera::Film;
    use crate::irradiance::IrradianceRows;

    const LONG: Duration = Duration::from_secs(600);

    fn run(job: &BakeJob) -> Bake {
        job.clone().run(|_| ControlFlow::Continue(())).unwrap().unwrap()
    }

    #[test]
    fn of_a_bake_that_is_there_only_the_irradiance_is_counted() {
        let job = job(Film { width: 64, height: 48 });
        let picture = run(&job);
        let with_lux = BakeJob { irradiance: vec![IrradianceRows::Pixels], ..job };
        let reuse = with_lux.reuse(&picture).unwrap();
        let of_rest = with_lux.estimate_reusing(&reuse, LONG, &Focus::default()).unwrap().unwrap();
        let of_all = with_lux.estimate(LONG, &Focus::default()).unwrap().unwrap();
        assert_eq!((of_rest.n_blocks, of_rest.n_tried), (12, 12));
        assert!(of_rest.secs > 0.0 && of_rest.preview_secs == 0.0, "{of_rest:?}");
        assert!(of_rest.secs < of_all.secs, "{} of {} seconds", of_rest.secs, of_all.secs);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.transport");
        crate::archive::write(&run(&with_lux), &path).unwrap();
        let file = std::fs::metadata(&path).unwrap().len() as f64;
        let off = (of_rest.file_bytes as f64 - file).abs() / file;
        assert!(off < 0.1, "{} bytes, not {file}", of_rest.file_bytes);
        // Whoever leaves gets none.
        let focus = Focus::default();
        focus.leave();
        assert_eq!(with_lux.estimate_reusing(&reuse, LONG, &focus).unwrap(), None);
    }

    #[test]
    fn what_is_there_already_takes_no_time() {
        let job = job(Film { width: 32, height: 32 });
        let bake = run(&job);
        let reuse = job.reuse(&bake).unwrap();
        let estimate = job.estimate_reusing(&reuse, LONG, &Focus::default()).unwrap().unwrap();
        assert_eq!((estimate.secs, estimate.n_blocks), (0.0, 0));
        assert!(estimate.result_bytes > 0 && estimate.file_bytes > 0, "{estimate:?}");
    }
}
