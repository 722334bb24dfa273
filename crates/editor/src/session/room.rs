//! How much memory a bake of the window may take, and on how many threads it stays within that.

use clerestory_transport::bake::BakeJob;
use clerestory_transport::bake::estimate::BakeEstimate;
use clerestory_transport::camera::Camera;

use super::estimate::Forecast;
use super::{BakeSettings, Session};
use crate::platform::{available_bytes, resident_bytes};

/// Part of the memory that the system has left which a bake may take: the window and other programs want some, too.
const PART_OF_FREE: f64 = 0.9;

/// Memory that is left for a bake, bytes.
#[derive(Clone, Copy, Debug)]
struct Room {
    /// None where neither a person nor the system says.
    bytes: Option<u64>,
}

impl Room {
    /// What is left of a limit for all of the program, and of what the system has.
    fn now(limit: Option<u64>) -> Room {
        let of_limit = limit.map(|limit| limit.saturating_sub(resident_bytes().unwrap_or(0)));
        let of_system = available_bytes().map(|bytes| (PART_OF_FREE * bytes as f64) as u64);
        Room { bytes: of_limit.into_iter().chain(of_system).min() }
    }

    /// The most threads, of so many, on which a bake stays within the room.
    ///
    /// # Errors
    /// In words, if a single thread takes more.
    fn threads(self, needs: Needs, most: usize) -> Result<usize, String> {
        let Some(bytes) = self.bytes else { return Ok(most) };
        let beside = bytes.checked_sub(needs.one_thread).ok_or_else(|| {
            format!(
                "the bake would take about {} of memory, and {} may be taken; make the picture smaller, give panels and the sky fewer parts, \
                 or allow more memory",
                megabytes(needs.one_thread),
                megabytes(bytes)
            )
        })?;
        Ok(most.min(1 + (beside / needs.each_further.max(1)) as usize))
    }
}

/// Memory that a bake takes beside its scene, bytes.
#[derive(Clone, Copy)]
struct Needs {
    one_thread: u64,
    each_further: u64,
}

impl Needs {
    /// What is sure before any block was tried.
    fn at_least(job: &BakeJob) -> Needs {
        Needs { one_thread: job.thread_bytes() + job.shared_bytes(), each_further: job.thread_bytes() }
    }

    fn estimated(estimate: &BakeEstimate) -> Needs {
        Needs { one_thread: estimate.least_memory_bytes, each_further: estimate.thread_bytes }
    }
}

fn megabytes(bytes: u64) -> String {
    match bytes as f64 / 1e6 {
        small if small < 1000.0 => format!("{small:.0} MB"),
        large => format!("{:.1} GB", large / 1e3),
    }
}

/// Threads that work beside the window: all cores but one.
pub(super) fn all_threads() -> usize {
    (std::thread::available_parallelism().map_or(1, usize::from) - 1).max(1)
}

impl Session {
    /// What would be baked with some settings, and on how many threads it may run now; what blocks that were tried took is heeded where it
    /// is known for these settings.
    ///
    /// # Errors
    /// In words, if nothing can be baked, or it does not fit at all.
    pub(super) fn fitting_job(
        &self,
        settings: &BakeSettings,
        camera: Option<Camera>,
    ) -> Result<(BakeJob, usize), String> {
        let job = self.job(settings, camera)?;
        let needs = match self.forecast_of(settings) {
            Some(Forecast::Told(estimate)) => Needs::estimated(estimate),
            _ => Needs::at_least(&job),
        };
        let n_threads = Room::now(self.memory_limit).threads(needs, all_threads())?;
        Ok((job, n_threads))
    }

    /// On how many threads what was foreseen would run, of how many.
    ///
    /// # Errors
    /// In words, if it does not fit at all.
    pub fn threads_foreseen(&self, estimate: &BakeEstimate) -> Result<(usize, usize), String> {
        let most = all_threads();
        Ok((Room::now(self.memory_limit).threads(Needs::estimated(estimate), most)?, most))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bake_takes_as_many_threads_as_fit() {
        let needs = Needs { one_thread: 3_000_000_000, each_further: 500_000_000 };
        let threads = |bytes: Option<u64>| Room { bytes }.threads(needs, 7);
        assert_eq!(threads(None), Ok(7));
        assert_eq!(threads(Some(9_000_000_000)), Ok(7));
        assert_eq!(threads(Some(4_100_000_000)), Ok(3));
        assert_eq!(threads(Some(3_000_000_000)), Ok(1));
        let why = threads(Some(900_000_000)).unwrap_err();
        assert!(why.contains("about 3.0 GB of memory, and 900 MB may be taken"), "{why}");
    }

    #[test]
    fn a_limit_counts_what_the_program_holds_already() {
        let held = resident_bytes().unwrap_or(0);
        let room = Room::now(Some(held + (64 << 20)));
        assert!(room.bytes.is_some_and(|bytes| bytes < 128 << 20), "{room:?}");
        assert_eq!(Room::now(Some(0)).bytes, Some(0));
    }
}
