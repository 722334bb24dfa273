//! How much memory a bake of the window may take, and on how many threads it stays within that.

use std::time::{Duration, Instant};

use clerestory_transport::bake::BakeJob;
use clerestory_transport::bake::estimate::BakeEstimate;
use clerestory_transport::camera::Camera;

use super::estimate::Forecast;
use super::{BakeSettings, Session};
use crate::platform::{available_bytes, resident_bytes};
use crate::room::Needs;
use crate::sizes::bytes_words;

/// Part of the memory that the system has left which one job may take: the window and other programs want some, too.
const PART_OF_FREE: f64 = 0.9;
/// How long what the system said counts for what is shown: a window draws many times a second.
const SEEN_FOR: Duration = Duration::from_secs(1);

/// Memory that the system leaves to one job, bytes; `None` where it does not say.
pub(super) fn left_of_system() -> Option<u64> {
    available_bytes().map(|bytes| (PART_OF_FREE * bytes as f64) as u64)
}

/// Memory that is left for a bake, bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Room {
    /// None where neither a person nor the system says.
    bytes: Option<u64>,
}

impl Room {
    /// What is left of a limit for all of the program, and of what the system has.
    fn now(limit: Option<u64>) -> Room {
        let of_limit = limit.map(|limit| limit.saturating_sub(resident_bytes().unwrap_or(0)));
        Room { bytes: of_limit.into_iter().chain(left_of_system()).min() }
    }

    /// The most threads, of so many, on which a bake stays within the room.
    ///
    /// # Errors
    /// In words, if a single thread takes more.
    fn threads(self, needs: Needs, most: usize) -> Result<usize, String> {
        let Some(bytes) = self.bytes else { return Ok(most) };
        needs.threads_within(bytes, most).ok_or_else(|| {
            format!(
                "the bake would take about {} of memory, and {} may be taken; make the picture smaller, give panels and the sky fewer parts, \
                 or allow more memory",
                bytes_words(needs.least_bytes()),
                bytes_words(bytes)
            )
        })
    }
}

/// The room that was seen last, under which limit, and when.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RoomSeen(Option<(Instant, Option<u64>, Room)>);

impl RoomSeen {
    /// Asks again where what was seen is old, or was seen under another limit.
    fn look(&mut self, limit: Option<u64>, now: Instant, ask: impl FnOnce(Option<u64>) -> Room) {
        let is_fresh = |(at, under, _): (Instant, Option<u64>, Room)| {
            under == limit && now.saturating_duration_since(at) < SEEN_FOR
        };
        if !self.0.is_some_and(is_fresh) {
            self.0 = Some((now, limit, ask(limit)));
        }
    }

    /// What was seen; any where nobody has looked yet.
    fn room(self) -> Room {
        self.0.map_or(Room { bytes: None }, |(_, _, room)| room)
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
        let known = self.forecast_of(settings, camera.as_ref()).cloned();
        let job = self.job(settings, camera)?;
        let needs = match &known {
            Some(Forecast::Told(estimate)) => Needs::estimated(estimate, self.forecasting.n_threads),
            _ => Needs::at_least(&job),
        };
        let n_threads = Room::now(self.memory_limit).threads(needs, all_threads())?;
        Ok((job, n_threads))
    }

    /// Sees how much room there is, for [`Session::threads_foreseen`].
    pub(super) fn look_for_room(&mut self) {
        self.room_seen.look(self.memory_limit, Instant::now(), Room::now);
    }

    /// On how many threads what was foreseen would run, of how many, in the room that was seen within the last second.
    ///
    /// # Errors
    /// In words, if it does not fit at all.
    pub fn threads_foreseen(&self, estimate: &BakeEstimate) -> Result<(usize, usize), String> {
        let (needs, most) = (Needs::estimated(estimate, self.forecasting.n_threads), all_threads());
        Ok((self.room_seen.room().threads(needs, most)?, most))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_fit_is_told_in_words() {
        let estimate = BakeEstimate {
            secs: 1.0,
            preview_secs: 0.1,
            memory_bytes: 6_000_000_000,
            least_memory_bytes: 3_000_000_000,
            thread_bytes: 500_000_000,
            ending_bytes: 0,
            result_bytes: 0,
            file_bytes: 1,
            n_blocks: 1,
            n_tried: 1,
        };
        let threads = |bytes: Option<u64>| Room { bytes }.threads(Needs::estimated(&estimate, 7), 7);
        assert_eq!((threads(None), threads(Some(4_100_000_000))), (Ok(7), Ok(3)));
        let why = threads(Some(900_000_000)).unwrap_err();
        assert!(why.contains("about 3.00 GB of memory, and 900.0 MB may be taken"), "{why}");
    }

    #[test]
    fn a_limit_counts_what_the_program_holds_already() {
        let held = resident_bytes().unwrap_or(0);
        let room = Room::now(Some(held + (64 << 20)));
        assert!(room.bytes.is_some_and(|bytes| bytes < 128 << 20), "{room:?}");
        assert_eq!(Room::now(Some(0)).bytes, Some(0));
    }

    #[test]
    fn the_system_is_asked_once_a_second_and_when_the_limit_is_another() {
        let (mut seen, start) = (RoomSeen::default(), Instant::now());
        assert_eq!(seen.room(), Room { bytes: None });
        let mut n_asked = 0;
        let mut look = |limit, after_ms| {
            seen.look(limit, start + Duration::from_millis(after_ms), |limit| {
                n_asked += 1;
                Room { bytes: limit }
            });
            (n_asked, seen.room().bytes)
        };
        assert_eq!([look(None, 0), look(None, 16), look(None, 990)], [(1, None); 3]);
        assert_eq!([look(Some(7), 991), look(Some(7), 1980)], [(2, Some(7)); 2]);
        assert_eq!(look(Some(7), 2000), (3, Some(7)));
    }
}
