//! Left factors as expand reads them: one stream from front to back, whatever the rank.
//!
//! Row-major factors of low rank fill a vector register with the ends of rows and need sums across its lanes; a component
//! after the other would be read at as many places as there are components, which memory is slow at. So rows come in runs
//! of [`RUN`], and of a run component after component: every lane counts and every byte lies behind the last one.

use clerestory_nystrom::BlockFactors;
use half::f16;

use super::quad::{QUAD, Quad};

/// Rows of a run: sixteen pixels.
pub(super) const RUN: usize = 48;

/// The left factors of a block.
#[derive(Clone, Debug)]
pub(super) struct Left {
    /// Runs × rank × [`RUN`]; the last run ends in zeros.
    pub halves: Vec<f16>,
    /// Rows of the block.
    pub n_rows: usize,
    /// Components.
    pub rank: usize,
    /// Of each component the largest magnitude per channel.
    largest: Vec<Quad>,
}

impl Left {
    pub(super) fn new(factors: &BlockFactors) -> Self {
        let (rank, n_rows) = (factors.rank as usize, factors.n_rows as usize);
        let mut halves = vec![f16::ZERO; n_rows.div_ceil(RUN) * RUN * rank];
        let mut largest = vec![[[0.0; 3]; QUAD]; rank.div_ceil(QUAD)];
        for (row, components) in factors.left.chunks_exact(rank.max(1)).enumerate() {
            let first = row / RUN * RUN * rank + row % RUN;
            for (k, (half, largest)) in components.iter().zip(largest.as_flattened_mut()).enumerate() {
                halves[first + k * RUN] = *half;
                let largest: &mut f32 = &mut largest[row % 3];
                *largest = largest.max(half.to_f32().abs());
            }
        }
        Self { halves, n_rows, rank, largest: largest.into_iter().map(Quad::from_rgb).collect() }
    }

    /// Most by which any channel of any pixel of the block changes from one `z` to another.
    pub(super) fn most_change(&self, from: &[Quad], to: &[Quad]) -> f32 {
        let mut most = Quad::default();
        for ((from, to), largest) in from.iter().zip(to).zip(&self.largest) {
            for (most, ((from, to), largest)) in most.0.iter_mut().zip(from.0.iter().zip(&to.0).zip(&largest.0)) {
                *most += largest * (from - to).abs();
            }
        }
        most.0.chunks_exact(QUAD).map(|channel| channel.iter().sum::<f32>()).fold(0.0, f32::max)
    }
}
