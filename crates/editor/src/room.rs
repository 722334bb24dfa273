//! How much memory a bake takes beside its scene, and on how many threads it stays within what there is.

use clerestory_transport::bake::BakeJob;
use clerestory_transport::bake::estimate::BakeEstimate;

/// Memory that a bake takes beside its scene, bytes.
#[derive(Clone, Copy, Debug)]
pub struct Needs {
    one_thread: u64,
    each_further: u64,
    /// Threads on which blocks of it were tried, and what it takes on those.
    tried: Option<(usize, u64)>,
}

impl Needs {
    /// What is sure before any block was tried.
    pub fn at_least(job: &BakeJob) -> Needs {
        let each_further = job.thread_bytes();
        Needs { one_thread: each_further + job.shared_bytes(), each_further, tried: None }
    }

    /// What blocks tell that were tried on so many threads.
    pub fn estimated(estimate: &BakeEstimate, n_threads: usize) -> Needs {
        Needs {
            one_thread: estimate.least_memory_bytes,
            each_further: estimate.thread_bytes,
            tried: Some((n_threads, estimate.memory_bytes)),
        }
    }

    /// On a single thread.
    pub fn least_bytes(self) -> u64 {
        self.one_thread
    }

    /// The most threads, of so many, on which it takes no more than some bytes; `None` if a single one takes more.
    pub fn threads_within(self, bytes: u64, most: usize) -> Option<usize> {
        let further = bytes.checked_sub(self.one_thread)? / self.each_further.max(1);
        let counted = usize::try_from(further).unwrap_or(usize::MAX).saturating_add(1);
        // What is taken at the end can outweigh the threads, which counting one by one does not see.
        let tried = self.tried.filter(|(_, taken)| *taken <= bytes).map_or(0, |(n_threads, _)| n_threads);
        Some(counted.max(tried).min(most))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bake_takes_as_many_threads_as_fit() {
        let needs = Needs { one_thread: 3_000_000_000, each_further: 500_000_000, tried: None };
        let threads = [9_000_000_000, 4_100_000_000, 3_000_000_000, 2_900_000_000].map(|n| needs.threads_within(n, 7));
        assert_eq!(threads, [Some(7), Some(3), Some(1), None]);
        assert_eq!(Needs { each_further: 0, ..needs }.threads_within(u64::MAX, 7), Some(7));
    }

    #[test]
    fn what_was_tried_and_fits_needs_no_counting() {
        // Packing at the end takes 3 GB on any number of threads, and five take no more than that.
        let needs = Needs { one_thread: 3_000_000_000, each_further: 500_000_000, tried: Some((5, 3_100_000_000)) };
        let threads = [3_000_000_000, 3_100_000_000, 6_000_000_000].map(|n| needs.threads_within(n, 8));
        assert_eq!(threads, [Some(1), Some(5), Some(7)]);
        assert_eq!(needs.threads_within(3_100_000_000, 2), Some(2));
    }
}
