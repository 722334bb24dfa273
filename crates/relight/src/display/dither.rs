//! Dithering: what rounding to a byte takes from one pixel, its neighbors get, so that smooth walls show no bands.
//!
//! The threshold is a point of the R2 lattice \[Roberts2018\], which spreads thresholds over neighbors almost as evenly as
//! blue noise does. It is made of integers alone: pixel by pixel the same on every device, in every run.

/// Threshold of a pixel in 1/256 of a byte, 0 … 255; the same for its three channels.
pub(super) fn threshold(x: u32, y: u32) -> u32 {
    let at = x.wrapping_mul(3_242_174_889).wrapping_add(y.wrapping_mul(2_447_445_413)) >> 23;
    // Up and down again, so that there is no edge where the lattice wraps around.
    if at < 256 { at } else { 511 - at }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thresholds_are_uniform_in_every_small_neighborhood() {
        for (x_0, y_0) in [(0, 0), (17, 5), (1000, 3000)] {
            let block = (0..8).flat_map(|y| (0..8).map(move |x| threshold(x_0 + x, y_0 + y)));
            let mean = block.sum::<u32>() as f32 / 64.0;
            assert!((mean - 127.5).abs() < 6.0, "mean {mean} at {x_0}, {y_0}");
        }
        let mut counts = [0u32; 16];
        (0..64).for_each(|y| (0..64).for_each(|x| counts[threshold(x, y) as usize / 16] += 1));
        assert!(counts.iter().all(|n| (248..=264).contains(n)), "{counts:?}");
    }
}
