//! How fast the machine is while a section is measured: a fixed piece of work of a library, which changes of ours do not touch, so that
//! seconds of two sections, or of one section on two days, can be held against each other.

use std::io::Write;
use std::time::Instant;

use anyhow::{Context, Result};
use flate2::{Compression, write::ZlibEncoder};

use super::fit;

/// Bytes that each thread deflates.
const N_BYTES: usize = 1 << 20;
/// Of which the median is told.
const ROUNDS: usize = 5;

/// Milliseconds in which all threads, at once, deflate the same bytes.
///
/// # Errors
/// If they cannot be deflated.
pub fn millis() -> Result<f64> {
    let bytes = bytes();
    let round = |_| {
        let begun = Instant::now();
        rayon::broadcast(|_| deflated(&bytes)).into_iter().collect::<Result<Vec<Vec<u8>>>>()?;
        Ok(1e3 * begun.elapsed().as_secs_f64())
    };
    let rounds = (0..ROUNDS).map(round).collect::<Result<Vec<f64>>>()?;
    fit::median(&rounds).context("no round was made")
}

/// What was measured before a section and after it, in words.
pub fn words(before: f64, after: f64) -> String {
    format!("a yardstick took {before:.0} ms before and {after:.0} ms after")
}

fn deflated(bytes: &[u8]) -> Result<Vec<u8>> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes)?;
    Ok(encoder.finish()?)
}

/// Sixteen letters in an order that repeats itself by chance alone, always the same (a linear congruential generator).
fn bytes() -> Vec<u8> {
    let mut state = 1u32;
    let letter = |_| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        b'a' + (state >> 28) as u8
    };
    (0..N_BYTES).map(letter).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_work_is_the_same_each_time_and_is_work() {
        let (bytes, again) = (bytes(), bytes());
        assert!(bytes == again && bytes.iter().all(|letter| (b'a'..=b'p').contains(letter)));
        let len = deflated(&bytes[..N_BYTES / 16]).unwrap().len();
        // Four bits of eight are all that a letter says.
        assert!((N_BYTES / 32..N_BYTES / 24).contains(&len), "{len}");
        assert_eq!(words(51.3, 62.8), "a yardstick took 51 ms before and 63 ms after");
    }
}
