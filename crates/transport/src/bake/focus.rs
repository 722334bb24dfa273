//! Where somebody looks while a bake runs: the blocks there come first. Which come first changes no byte of the result.
//! Somebody who has left wants no result: walks that have not begun are not followed any more, and what is done of a block is
//! dropped.

use std::sync::atomic::{AtomicU64, Ordering};

use clerestory_nystrom::Partition;

use crate::stop::Stop;

/// Nobody looks anywhere in particular.
const NOWHERE: u64 = u64::MAX;

/// A place in the picture and whether anybody is there, set by one thread and read by others.
#[derive(Debug)]
pub struct Focus {
    /// Pixel across and down.
    place: AtomicU64,
    left: Stop,
}

impl Default for Focus {
    fn default() -> Focus {
        Focus { place: AtomicU64::new(NOWHERE), left: Stop::default() }
    }
}

impl Focus {
    /// Blocks near a pixel (from the top left) come first from now on, or none in particular.
    pub fn set(&self, pixel: Option<[u32; 2]>) {
        let packed = pixel.map_or(NOWHERE, |[x, y]| u64::from(x) << 32 | u64::from(y));
        self.place.store(packed, Ordering::Relaxed);
    }

    /// Ends the bake as soon as can be, in the middle of a block: nobody wants it any more, and nobody comes back.
    pub fn leave(&self) {
        self.left.ask();
    }

    /// Whether nobody wants the bake any more.
    #[inline]
    pub fn is_left(&self) -> bool {
        self.left.is_asked()
    }

    /// Where among some blocks the next one stands: the nearest to the pixel, else the first.
    pub(crate) fn next(&self, partition: &Partition, left: &[u32]) -> usize {
        let packed = self.place.load(Ordering::Relaxed);
        if packed == NOWHERE {
            return 0;
        }
        let (x, y) = ((packed >> 32) as i64, (packed & 0xFFFF_FFFF) as i64);
        let distance = |block: u32| {
            let [left, top, width, height] = partition.rect(block as usize).map(i64::from);
            (2 * x - 2 * left - width).pow(2) + (2 * y - 2 * top - height).pow(2)
        };
        let places = left.iter().enumerate();
        places.min_by_key(|(_, block)| distance(**block)).map_or(0, |(place, _)| place)
    }
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;

    use super::*;
    use crate::archive;
    use crate::bake::floor::job;
    use crate::bake::{Bake, BakeConfig, BakeEvent, BakeJob, HalfDone};
    use crate::camera::Film;
    use crate::irradiance::IrradianceRows;

    fn bytes(bake: &Bake) -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.transport");
        archive::write(bake, &path).unwrap();
        std::fs::read(&path).unwrap()
    }

    #[test]
    fn wherever_somebody_looks_and_whenever_it_stops_the_bytes_are_the_same() {
        let job = job(Film { width: 64, height: 48 });
        let whole = bytes(&job.clone().run(|_| ControlFlow::Continue(())).unwrap().unwrap());
        let focus = Focus::default();
        focus.set(Some([63, 47]));
        let (mut begun, mut last) = (None, 0);
        let stopped = job.clone().run_toward(&focus, None, |event| {
            match event {
                BakeEvent::Started { header, n_passes, .. } => {
                    (begun, last) = (Some(HalfDone { header, blocks: Vec::new() }), n_passes - 1);
                }
                BakeEvent::BlockDone { pass, block_idx, factors } if pass == last => {
                    begun.iter_mut().for_each(|begun| begun.blocks.push((block_idx, factors.clone())));
                }
                _ => {}
            }
            let n_done = begun.as_ref().map_or(0, |begun| begun.blocks.len());
            if n_done > rayon::current_num_threads() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        assert!(stopped.unwrap().is_none());
        let begun = begun.unwrap();
        assert!(
            begun.blocks.iter().any(|(block, _)| *block == 11),
            "the corner was looked at: {:?}",
            begun.blocks.len()
        );
        let resumed = job.run_toward(&Focus::default(), Some(begun), |_| ControlFlow::Continue(()));
        assert!(bytes(&resumed.unwrap().unwrap()) == whole);
    }

    #[test]
    fn who_leaves_hears_of_no_block_any_more_whatever_the_stage() {
        let job = BakeJob {
            config: BakeConfig { spp: 32, patches: 16, ..BakeConfig::default() },
            ..job(Film { width: 64, height: 48 })
        };
        let job = BakeJob { irradiance: vec![IrradianceRows::Pixels], ..job };
        let mut n_events = 0;
        let count = |_| {
            n_events += 1;
            ControlFlow::Continue(())
        };
        assert!(job.clone().run(count).unwrap().is_some());
        // Before the first event, and after some of each stage up to the last one. How far a bake is it tells by the clock: it may end
        // after fewer events than the one before, and who waits for more has not left.
        let mut n_left = 0;
        for stays in (0..n_events).step_by(7).chain([n_events - 1]) {
            let (focus, mut n_heard, mut n_after) = (Focus::default(), 0, 0);
            if stays == 0 {
                focus.leave();
            }
            let left = job.clone().run_toward(&focus, None, |event| {
                n_after += usize::from(focus.is_left() && !matches!(event, BakeEvent::Progress { .. }));
                n_heard += 1;
                if n_heard == stays {
                    focus.leave();
                }
                // Somebody who does not answer is not there either.
                ControlFlow::Continue(())
            });
            assert_eq!(left.unwrap().is_none(), focus.is_left(), "after {stays} of {n_events} events");
            assert_eq!(n_after, 0, "after {stays} of {n_events} events");
            n_left += usize::from(focus.is_left());
        }
        assert!(n_left >= n_events / 7, "{n_left} of {n_events} events");
    }

    #[test]
    fn the_block_under_the_place_comes_first_and_without_one_the_order_stays() {
        let partition = Partition { width: 64, height: 48, tile: 16 };
        let left = [5, 0, 11, 3];
        let focus = Focus::default();
        assert_eq!(focus.next(&partition, &left), 0);
        for (pixel, place) in [([2, 3], 1), ([63, 47], 2), ([60, 2], 3), ([20, 20], 0)] {
            focus.set(Some(pixel));
            assert_eq!(focus.next(&partition, &left), place, "{pixel:?}");
        }
        focus.set(None);
        assert_eq!(focus.next(&partition, &left), 0);
    }
}
