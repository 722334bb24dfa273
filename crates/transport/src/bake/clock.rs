//! How far a bake is, and how long it will take.
//!
//! The running pass is judged by its own blocks, so that a preview, which costs what no number of samples tells, never
//! enters. Passes to come are judged by the last pass that took samples, where theirs are not many more.

/// Share of a pass after which its own speed is believed: the first blocks lie together, and may be unlike the others.
const BELIEVED_FROM: f32 = 0.05;
/// How many times the samples of a pass those of one may be that is judged by it. A part of the time of a block does not grow with its
/// samples, and many blocks are exact enough before they took all: a few samples would tell many times what a long pass takes.
const JUDGED_TO: u32 = 4;

/// Judges how far a bake is. It has no clock of its own: whoever calls says how many seconds have passed.
pub(super) struct Clock {
    passes: Vec<Pass>,
    /// Blocks that must be there before the speed of a pass means something: one per thread, for they arrive together.
    n_threads: usize,
    running: usize,
    started_secs: f32,
    /// When its last block came.
    last_secs: f32,
    /// Of a block in the last pass that took samples and has ended.
    of_ended: Option<Pace>,
}

/// What a block of a pass took.
#[derive(Clone, Copy)]
struct Pace {
    /// Samples per half.
    samples: u32,
    secs: f32,
}

impl Pace {
    /// Seconds of a block with so many samples; none with many more.
    fn secs_at(self, samples: u32) -> Option<f32> {
        let is_judged = samples <= self.samples.saturating_mul(JUDGED_TO);
        is_judged.then(|| self.secs * samples as f32 / self.samples as f32)
    }
}

/// A pass of the bake.
struct Pass {
    /// Samples per half; `None` is a preview.
    samples: Option<u32>,
    n_blocks: usize,
    /// Blocks that are there from the start.
    n_given: usize,
    /// Blocks that came since.
    n_done: usize,
}

impl Pass {
    fn new(samples: Option<u32>, n_blocks: usize, n_given: usize) -> Pass {
        Pass { samples, n_blocks, n_given: n_given.min(n_blocks), n_done: 0 }
    }

    fn n_to_do(&self) -> usize {
        self.n_blocks - self.n_given
    }

    fn n_left(&self) -> usize {
        self.n_to_do().saturating_sub(self.n_done)
    }

    /// What a block counts for in the share that is done: of a preview, a single one.
    fn weight(&self) -> f32 {
        self.samples.map_or(1.0, |samples| samples as f32)
    }
}

impl Clock {
    /// Before the first pass. `samples` has one entry per pass; `n_given` blocks of the last one are there already.
    pub fn new(samples: &[Option<u32>], n_blocks: usize, n_given: usize, n_threads: usize) -> Clock {
        let last = samples.len().saturating_sub(1);
        let given = |nth: usize| if nth == last { n_given } else { 0 };
        let passes = samples.iter().enumerate().map(|(nth, &samples)| Pass::new(samples, n_blocks, given(nth)));
        let passes = passes.collect();
        Clock { passes, n_threads, running: 0, started_secs: 0.0, last_secs: 0.0, of_ended: None }
    }

    /// One more pass, and its number.
    pub fn add_pass(&mut self, samples: Option<u32>, n_blocks: usize, n_given: usize) -> usize {
        self.passes.push(Pass::new(samples, n_blocks, n_given));
        self.passes.len() - 1
    }

    /// The blocks of a pass begin; the pass before has ended. What is prepared in between counts for neither.
    pub fn start_pass(&mut self, pass: usize, now_secs: f32) {
        if let (Some(samples), Some(secs)) = (self.passes[self.running].samples, self.secs_per_block()) {
            self.of_ended = Some(Pace { samples, secs });
        }
        if pass != self.running {
            // What it left out is not to be done.
            let ended = &mut self.passes[self.running];
            ended.n_done = ended.n_to_do();
        }
        (self.running, self.started_secs) = (pass, now_secs);
    }

    /// A block of the running pass is there: 0…1 over all passes, and seconds left once they can be judged.
    pub fn block_done(&mut self, now_secs: f32) -> (f32, Option<f32>) {
        self.passes[self.running].n_done += 1;
        self.last_secs = now_secs;
        (self.done(), self.secs_left())
    }

    /// 0…1 over all passes.
    pub fn done(&self) -> f32 {
        let done: f32 = self.passes.iter().map(|p| p.weight() * (p.n_given + p.n_done) as f32).sum();
        let all: f32 = self.passes.iter().map(|p| p.weight() * p.n_blocks as f32).sum();
        (done / all.max(f32::MIN_POSITIVE)).min(1.0)
    }

    /// Measured in the running pass.
    fn secs_per_block(&self) -> Option<f32> {
        let n_done = self.passes[self.running].n_done;
        (n_done > 0).then(|| (self.last_secs - self.started_secs) / n_done as f32)
    }

    fn secs_left(&self) -> Option<f32> {
        let pass = &self.passes[self.running];
        let n_to_do = pass.n_to_do();
        let enough = self.n_threads.max((BELIEVED_FROM * n_to_do as f32).ceil() as usize).min(n_to_do);
        let measured = self.secs_per_block().filter(|_| pass.n_done >= enough);
        let expected = || self.of_ended?.secs_at(pass.samples?);
        let secs_per_block = measured.or_else(expected)?;
        let this_pass = pass.n_left() as f32 * secs_per_block;

        // What was itself judged by a pass that ended judges none of yet more samples.
        let own = measured.zip(pass.samples).map(|(secs, samples)| Pace { samples, secs });
        let pace = own.or(self.of_ended);
        let others = self.passes.iter().enumerate().filter(|(nth, p)| *nth != self.running && p.n_left() > 0);
        let later: Option<f32> = others.map(|(_, p)| Some(p.n_left() as f32 * pace?.secs_at(p.samples?)?)).sum();
        Some(this_pass + later?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs a pass at a steady pace; what is left after each of its blocks.
    fn run(clock: &mut Clock, pass: usize, now_secs: &mut f32, n_blocks: usize, secs: f32) -> Vec<Option<f32>> {
        clock.start_pass(pass, *now_secs);
        let mut left = Vec::new();
        for _ in 0..n_blocks {
            *now_secs += secs;
            left.push(clock.block_done(*now_secs).1);
        }
        left
    }

    #[track_caller]
    fn assert_near(left: Option<f32>, known: f32) {
        let left = left.expect("time can be judged here");
        assert!((left - known).abs() < 1e-3 * known.max(1.0), "{left} s left, not {known} s");
    }

    #[test]
    fn the_time_of_a_preview_never_enters_the_passes_after_it() {
        let mut now_secs = 0.0;
        let mut clock = Clock::new(&[None, Some(16), Some(64)], 10, 0, 1);
        let preview = run(&mut clock, 0, &mut now_secs, 10, 30.0);
        assert!(preview.iter().all(Option::is_none), "nothing tells yet what a sample costs: {preview:?}");
        let coarse = run(&mut clock, 1, &mut now_secs, 10, 0.5);
        assert_near(coarse[0], 9.0 * 0.5 + 10.0 * 2.0);
        assert_near(coarse[9], 10.0 * 2.0);
        now_secs += 50.0;
        clock.start_pass(2, now_secs);
        assert_near(clock.of_ended.map(|pace| pace.secs), 0.5);
        // Blocks that are exact enough before all samples are taken make the last pass faster than expected.
        let last = run(&mut clock, 2, &mut now_secs, 10, 1.5);
        assert_near(last[0], 9.0 * 1.5);
        assert_near(last[9], 0.0);
    }

    #[test]
    fn a_pass_of_few_samples_foretells_none_of_many() {
        let mut now_secs = 0.0;
        let mut clock = Clock::new(&[None, Some(4), Some(64)], 100, 0, 1);
        run(&mut clock, 0, &mut now_secs, 100, 0.1);
        let coarse = run(&mut clock, 1, &mut now_secs, 100, 0.5);
        assert!(coarse.iter().all(Option::is_none), "800 s would be foretold: {coarse:?}");
        let last = run(&mut clock, 2, &mut now_secs, 100, 1.0);
        assert_eq!(last[..4], [None; 4], "the first blocks tell little of the others");
        assert_near(last[4], 95.0);
    }

    #[test]
    fn a_pass_that_is_judged_by_another_one_judges_none() {
        let mut now_secs = 0.0;
        let mut clock = Clock::new(&[Some(4), Some(16), Some(64)], 100, 0, 1);
        let first = run(&mut clock, 0, &mut now_secs, 100, 0.5);
        assert!(first.iter().all(Option::is_none), "of 64 samples 4 tell nothing: {first:?}");
        let second = run(&mut clock, 1, &mut now_secs, 100, 1.0);
        assert_eq!(second[..4], [None; 4], "what 4 samples tell of 16 tells nothing of 64");
        assert_near(second[4], 95.0 * 1.0 + 100.0 * 4.0);
    }

    #[test]
    fn a_pass_is_expected_to_cost_by_its_samples_until_its_own_blocks_tell() {
        let mut now_secs = 0.0;
        let mut clock = Clock::new(&[Some(16), Some(64)], 8, 0, 4);
        let coarse = run(&mut clock, 0, &mut now_secs, 8, 0.25);
        assert_eq!(coarse[..3], [None; 3], "blocks of four threads arrive together");
        assert_near(coarse[3], 4.0 * 0.25 + 8.0 * 1.0);
        let last = run(&mut clock, 1, &mut now_secs, 8, 0.5);
        assert_near(last[0], 7.0 * 1.0);
        assert_near(last[3], 4.0 * 0.5);
    }

    #[test]
    fn a_bake_that_is_taken_up_counts_only_what_is_left() {
        let mut clock = Clock::new(&[Some(64)], 10, 6, 1);
        clock.start_pass(0, 100.0);
        let (done, left) = clock.block_done(102.0);
        assert!((done - 0.7).abs() < 1e-6, "{done}");
        assert_near(left, 3.0 * 2.0);
        assert!(Clock::new(&[Some(64)], 10, 10, 1).done() > 0.999, "all of it was there");
    }

    #[test]
    fn passes_may_come_in_another_order_than_they_were_told_of() {
        let mut now_secs = 0.0;
        let mut clock = Clock::new(&[None, Some(8)], 10, 0, 1);
        let [sensors, preview] = [clock.add_pass(Some(8), 4, 0), clock.add_pass(None, 10, 0)];
        run(&mut clock, 0, &mut now_secs, 10, 1.0);
        run(&mut clock, preview, &mut now_secs, 7, 1.0);
        let left = run(&mut clock, sensors, &mut now_secs, 4, 2.0);
        assert_near(left[3], 10.0 * 2.0);
        let left = run(&mut clock, 1, &mut now_secs, 10, 4.0);
        assert_near(left[9], 0.0);
        assert!(clock.done() > 0.999, "what the preview left out does not count");
    }

    #[test]
    fn the_share_that_is_done_grows_to_one() {
        let mut clock = Clock::new(&[None, Some(2), Some(32)], 5, 0, 2);
        let (mut now_secs, mut before) = (0.0, 0.0);
        for pass in 0..3 {
            clock.start_pass(pass, now_secs);
            for _ in 0..5 {
                now_secs += 1.0;
                let (done, _) = clock.block_done(now_secs);
                assert!(done > before, "{done} after {before}");
                before = done;
            }
        }
        assert!((before - 1.0).abs() < 1e-6, "{before}");
    }
}
