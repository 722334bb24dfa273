//! What a bake makes of a time that it has: noisy blocks come first, and so much is kept of the time as the end takes, in which noise is
//! taken out of the picture and its factors become few bytes.

use std::time::{Duration, Instant};

use clerestory_nystrom::{BlockLowRank, Partition};
use rayon::prelude::*;

use super::estimate::{most_tried, sizes, spread};
use super::{Deadline, Run};

/// What is kept for the end over what trying it took: blocks that are under way when time is up are waited for.
const LATE: f32 = 1.1;

impl Run<'_> {
    /// Where a bake has to end at a time, tries the end on a few blocks of the whole picture that there is now, and keeps so much of
    /// the time for it. Whether somebody still wants the bake.
    pub(super) fn foresees_its_end(&mut self) -> bool {
        let is_late = |deadline: &Deadline| deadline.left() <= deadline.ending;
        if self.deadline.as_ref().is_none_or(is_late) {
            return !self.focus.is_left();
        }
        let Some(ending) = self.try_ending() else { return false };
        if let Some(deadline) = &mut self.deadline {
            deadline.ending = ending;
        }
        true
    }

    /// Sorts blocks of a pass that may be cut short: the least exact places first.
    pub(super) fn noisy_first(&self, blocks: &mut [u32]) {
        let partition = self.header.partition();
        let groups = &self.matrices[0];
        let error_of = |block_idx: usize| -> f32 {
            let of_group = |group: &BlockLowRank| {
                let block = group.blocks[block_idx].as_ref()?;
                Some((block.error.truncation.max(0.0) + block.error.sampling) * block.n_cols as f32)
            };
            groups.iter().filter_map(of_group).sum()
        };
        let errors: Vec<f32> = (0..partition.n_blocks()).map(error_of).collect();
        by_errors_around(&partition, &errors, blocks);
    }

    /// What the end takes of the picture there is; `None` if nobody wants it any more.
    fn try_ending(&mut self) -> Option<Duration> {
        // What pixels show is looked at once, and stays.
        let likenesses = if self.is_denoised(true) { Some(self.likenesses()?) } else { None };
        let partition = self.header.partition();
        let n_blocks = partition.n_blocks();
        let blocks = spread(n_blocks, most_tried());
        let of_all = n_blocks as f32 / blocks.len().max(1) as f32;
        let groups = &self.matrices[0];
        let begun = Instant::now();
        if let Some(denoiser) = likenesses.as_ref().map(|likenesses| likenesses.denoiser(self.job)) {
            let known = |group: usize, block_idx: usize| groups[group].blocks[block_idx].clone();
            blocks.par_iter().for_each(|&block| drop(denoiser.block(block as usize, known)));
        }
        let denoising_secs = begun.elapsed().as_secs_f32() * of_all;
        let mut some = self.header.empty_groups();
        for (some, all) in some.iter_mut().zip(groups) {
            blocks.iter().for_each(|&block| some.blocks[block as usize].clone_from(&all.blocks[block as usize]));
        }
        let (packing_secs, _) = sizes(self.header, &[some], &[partition], self.focus)?;
        Some(Duration::from_secs_f32(LATE * (denoising_secs + packing_secs)))
    }
}

/// Sorts blocks by the mean error of those around them, the greatest first. A block's own error has no say: blocks that happened to miss
/// rare light look exact, and would stay as they are.
fn by_errors_around(partition: &Partition, errors: &[f32], blocks: &mut [u32]) {
    let around = |block_idx: usize| {
        let others = partition.around(block_idx).filter(|&near| near != block_idx).map(|near| errors[near]);
        let (sum, n) = others.fold((0.0, 0), |(sum, n), error| (sum + error, n + 1));
        sum / n.max(1) as f32
    };
    let means: Vec<f32> = (0..partition.n_blocks()).map(around).collect();
    blocks.sort_by(|&a, &b| means[b as usize].total_cmp(&means[a as usize]));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_beside_the_least_exact_one_come_first_and_the_others_stay_in_order() {
        let partition = Partition { width: 80, height: 16, tile: 16 };
        let mut blocks = [2, 4, 1, 3, 0];
        by_errors_around(&partition, &[0.0, 0.0, 9.0, 0.0, 1.0], &mut blocks);
        // 3 has 5 beside it, 1 has 4.5; all others have nothing.
        assert_eq!(blocks, [3, 1, 2, 4, 0]);
    }

    #[test]
    fn time_is_up_as_long_before_as_the_end_takes() {
        let hour = Duration::from_secs(3600);
        let mut deadline = Deadline::new(Instant::now() + hour, 0);
        assert!(deadline.strike(1).is_continue());
        deadline.ending = 2 * hour;
        assert!(deadline.strike(0).is_continue() && !deadline.has_struck, "there is no picture yet");
        assert!(deadline.strike(1).is_break() && deadline.has_struck);
    }

    #[test]
    fn passes_that_are_made_whatever_the_time_is_are_not_cut_short() {
        let mut deadline = Deadline::new(Instant::now(), 1);
        assert!(deadline.strike(1).is_continue() && !deadline.has_struck);
        assert!(deadline.strike(2).is_break() && deadline.has_struck);
    }
}
