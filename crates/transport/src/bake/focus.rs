//! Where somebody looks while a bake runs: the blocks there come first. Which come first changes no byte of the result.

use std::sync::atomic::{AtomicU64, Ordering};

use clerestory_nystrom::Partition;

/// Nobody looks anywhere in particular.
const NOWHERE: u64 = u64::MAX;

/// A place in the picture, set by one thread and read by others.
#[derive(Debug)]
pub struct Focus(AtomicU64);

impl Default for Focus {
    fn default() -> Focus {
        Focus(AtomicU64::new(NOWHERE))
    }
}

impl Focus {
    /// Blocks near a pixel (from the top left) come first from now on, or none in particular.
    pub fn set(&self, pixel: Option<[u32; 2]>) {
        let packed = pixel.map_or(NOWHERE, |[x, y]| u64::from(x) << 32 | u64::from(y));
        self.0.store(packed, Ordering::Relaxed);
    }

    /// Where among some blocks the next one stands: the nearest to the pixel, else the first.
    pub(crate) fn next(&self, partition: &Partition, left: &[u32]) -> usize {
        let packed = self.0.load(Ordering::Relaxed);
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
    use super::*;

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
