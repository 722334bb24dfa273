//! How long a bake takes once its time is up: noise is taken out of the picture, and its factors become few bytes.

use std::time::{Duration, Instant};

use rayon::prelude::*;

use super::estimate::{most_tried, spread};
use super::{Bake, Deadline, Run};

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

    /// What the end takes of the picture there is; `None` if nobody wants it any more.
    fn try_ending(&mut self) -> Option<Duration> {
        // What pixels show is looked at once, and stays.
        let likenesses = if self.is_denoised(true) { Some(self.likenesses()?) } else { None };
        let partition = self.header.partition();
        let n_blocks = partition.n_blocks();
        let blocks = spread(n_blocks, most_tried());
        let groups = &self.matrices[0];
        let begun = Instant::now();
        if let Some(denoiser) = likenesses.as_ref().map(|likenesses| likenesses.denoiser(self.job)) {
            let known = |group: usize, block_idx: usize| groups[group].blocks[block_idx].clone();
            blocks.par_iter().for_each(|&block| drop(denoiser.block(block as usize, known)));
        }
        let mut some = self.header.empty_groups();
        for (some, all) in some.iter_mut().zip(groups) {
            blocks.iter().for_each(|&block| some.blocks[block as usize].clone_from(&all.blocks[block as usize]));
        }
        Bake::packing(self.header.clone(), vec![some], self.focus)?;
        let of_all = n_blocks as f32 / blocks.len().max(1) as f32;
        Some(begun.elapsed().mul_f32(of_all))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_is_up_as_long_before_as_the_end_takes() {
        let hour = Duration::from_secs(3600);
        let mut deadline = Deadline::new(Instant::now() + hour);
        assert!(deadline.strike(1).is_continue());
        deadline.ending = 2 * hour;
        assert!(deadline.strike(0).is_continue() && !deadline.has_struck, "there is no picture yet");
        assert!(deadline.strike(1).is_break() && deadline.has_struck);
    }
}
