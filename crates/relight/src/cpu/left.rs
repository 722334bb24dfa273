//! Left factors as expand reads them: one stream from front to back, whatever the rank.
//!
//! Row-major factors of low rank fill a vector register with the ends of rows and need sums across its lanes; a component
//! after the other would be read at as many places as there are components, which memory is slow at. So rows come in runs
//! of [`RUN`], and of a run component after component: every lane counts and every byte lies behind the last one.

use clerestory_nystrom::BlockFactors;
use half::f16;

use super::quad::{QUAD, Quad};
use super::store::Stream;
use crate::packing::Side;

/// Rows of a run: sixteen pixels.
pub(super) const RUN: usize = 48;

/// Appends the left factor of a block, of halves and of bytes runs × components × [`RUN`] (the last run ends in zeros), and of each of
/// its quads the largest magnitudes per channel, in steps where they are bytes.
pub(super) fn append(factors: &BlockFactors, kept: &Side, left: &mut Stream, largest: &mut Vec<Quad>) {
    let (rank, n_rows) = (factors.rank as usize, factors.n_rows as usize);
    let (n_halves, n_bytes) = (kept.n_halves, rank - kept.n_halves);
    let padded = n_rows.next_multiple_of(RUN);
    let firsts = [left.halves.len(), left.bytes.len()];
    left.halves.resize(firsts[0] + padded * n_halves, f16::ZERO);
    left.bytes.resize(firsts[1] + padded * n_bytes, 0);
    let (halves, bytes) = (&mut left.halves[firsts[0]..], &mut left.bytes[firsts[1]..]);
    let mut most = vec![[[0.0; 3]; QUAD]; rank.div_ceil(QUAD)];
    for (row, components) in factors.left.chunks_exact(rank.max(1)).enumerate() {
        let (run, at) = (row / RUN * RUN, row % RUN);
        for (k, (entry, most)) in components.iter().zip(most.as_flattened_mut()).enumerate() {
            let magnitude = if let Some(k_byte) = k.checked_sub(n_halves) {
                let byte = kept.byte(k, *entry);
                bytes[run * n_bytes + k_byte * RUN + at] = byte;
                f32::from(byte).abs()
            } else {
                halves[run * n_halves + k * RUN + at] = *entry;
                entry.to_f32().abs()
            };
            let most: &mut f32 = &mut most[row % 3];
            *most = most.max(magnitude);
        }
    }
    largest.extend(most.into_iter().map(Quad::from_rgb));
}

/// Most by which any channel of any pixel of a block changes from one `z` to another.
pub(super) fn most_change(largest: &[Quad], from: &[Quad], to: &[Quad]) -> f32 {
    let mut most = Quad::default();
    for ((from, to), largest) in from.iter().zip(to).zip(largest) {
        for (most, ((from, to), largest)) in most.0.iter_mut().zip(from.0.iter().zip(&to.0).zip(&largest.0)) {
            *most += largest * (from - to).abs();
        }
    }
    most.0.chunks_exact(QUAD).map(|channel| channel.iter().sum::<f32>()).fold(0.0, f32::max)
}
