//! How many bits of a block's factors are kept: halves as they come, or bytes where the block's own error hides what that
//! rounds off.
//!
//! A vector of bytes has a scale of its own, which joins that of its component, so kernels meet whole numbers. Components come the
//! strongest first, so it is those from some place on that are bytes: kernels read two runs of components, not one kind after
//! the other. Columns that a bake keeps apart come in their own order until it is packed: what may be bytes before a strong one
//! stays halves.

use clerestory_nystrom::BlockFactors;
use half::f16;

/// What relighters keep of factors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Precision {
    /// Halves, as they come: for what is written to files.
    #[default]
    Halves,
    /// Bytes where rounding adds no more than [`SHARE`] of a block's own error, halves elsewhere: for what is looked at. A block
    /// whose error nobody measured stays as it comes.
    ByError,
}

/// Part of the mean square error of a block that rounding to bytes may add.
pub const SHARE: f64 = 1.0 / 32.0;

/// Largest magnitude of a byte.
const LARGEST: f32 = 127.0;

/// Components that lie together in a word or a register: pairs of left factors, quads of right ones.
const TOGETHER: [usize; 2] = [2, 4];

/// What is kept of one block.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Kept {
    pub left: Side,
    pub right: Side,
    /// One per component, the steps of its bytes included.
    pub scale: Vec<f32>,
}

/// What is kept of one factor.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Side {
    /// Components that are halves, from the first on; a whole number of pairs or quads, or all.
    pub n_halves: usize,
    /// Of each component that is bytes what 1 stands for.
    steps: Vec<f32>,
}

impl Side {
    /// An entry of a component that is bytes.
    pub(crate) fn byte(&self, component: usize, entry: f16) -> i8 {
        let step = self.steps[component - self.n_halves];
        if step > 0.0 { (entry.to_f32() / step).round() as i8 } else { 0 }
    }

    /// What 1 stands for in a component.
    fn step(&self, component: usize) -> f32 {
        component.checked_sub(self.n_halves).map_or(1.0, |byte| self.steps[byte])
    }
}

/// One column of the left factor, or one row of the right.
#[derive(Clone, Copy, Debug, Default)]
struct Vector {
    largest: f32,
    mean_square: f64,
}

impl Vector {
    fn add(&mut self, entry: f16, len: usize) {
        let entry = entry.to_f32();
        self.largest = self.largest.max(entry.abs());
        self.mean_square += f64::from(entry * entry) / len as f64;
    }

    /// Mean square of what rounding to bytes takes off, where all parts of a step are as likely.
    fn rounding(&self) -> f64 {
        f64::from(self.largest / LARGEST).powi(2) / 12.0
    }
}

impl Precision {
    /// What is kept of a block.
    pub(crate) fn keep(self, factors: &BlockFactors) -> Kept {
        let own = f64::from(factors.error.truncation.max(0.0) + factors.error.sampling.max(0.0));
        if self == Self::Halves || own == 0.0 || factors.rank == 0 {
            let all = || Side { n_halves: factors.rank as usize, steps: Vec::new() };
            return Kept { left: all(), right: all(), scale: factors.scale.clone() };
        }
        let vectors = vectors(factors);
        // What is rounded off one factor comes out multiplied by the other; either may add half.
        let added = |side: usize| {
            let rounded = vectors[side].iter().zip(&vectors[1 - side]).zip(&factors.scale);
            let error = |((own, other), scale): ((&Vector, &Vector), &f32)| {
                own.rounding() * other.mean_square * f64::from(*scale).powi(2)
            };
            rounded.map(error).collect::<Vec<f64>>()
        };
        let [left, right] = [0, 1].map(|side| {
            let n_halves = first_that_may(&added(side), 0.5 * SHARE * own).next_multiple_of(TOGETHER[side]);
            let n_halves = n_halves.min(factors.rank as usize);
            Side { n_halves, steps: vectors[side][n_halves..].iter().map(|vector| vector.largest / LARGEST).collect() }
        });
        let scale = |(k, scale): (usize, &f32)| scale * left.step(k) * right.step(k);
        let scale = factors.scale.iter().enumerate().map(scale).collect();
        Kept { left, right, scale }
    }
}

/// The first component from which on all together add no more than is `allowed`.
fn first_that_may(added: &[f64], allowed: f64) -> usize {
    let mut sum = 0.0;
    let fits = |added: &&f64| {
        sum += **added;
        sum <= allowed
    };
    added.len() - added.iter().rev().take_while(fits).count()
}

/// Columns of the left factor, and rows of the right.
fn vectors(factors: &BlockFactors) -> [Vec<Vector>; 2] {
    let (rank, n_rows, n_cols) = (factors.rank as usize, factors.n_rows as usize, factors.n_cols as usize);
    let mut vectors = [0, 1].map(|_| vec![Vector::default(); rank]);
    for row in factors.left.chunks_exact(rank) {
        vectors[0].iter_mut().zip(row).for_each(|(vector, entry)| vector.add(*entry, n_rows));
    }
    for (vector, row) in vectors[1].iter_mut().zip(factors.right.chunks_exact(n_cols.max(1))) {
        row.iter().for_each(|entry| vector.add(*entry, n_cols));
    }
    vectors
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::frame::Frame;
    use crate::synthetic::{Ranks, Recipe};
    use std::sync::Arc;

    /// Whose components fall off, and whose blocks have errors of many sizes: from too small for any byte to hiding all of them.
    pub(crate) fn falling(recipe: &Recipe) -> Frame {
        let mut frame = recipe.frame();
        for (i, block) in frame.groups.iter_mut().flat_map(|group| group.blocks.iter_mut().flatten()).enumerate() {
            let block = Arc::make_mut(block);
            block.scale.iter_mut().enumerate().for_each(|(k, scale)| *scale *= 0.6f32.powi(k as i32));
            block.error.truncation = 10f32.powi(2 - (i % 9) as i32);
        }
        frame
    }

    /// What is kept of a block, in halves: bytes are whole numbers that halves hold exactly.
    fn in_halves(factors: &BlockFactors) -> BlockFactors {
        let kept = Precision::ByError.keep(factors);
        let value = |side: &Side, k: usize, entry: f16| {
            if k < side.n_halves { entry } else { f16::from_f32(f32::from(side.byte(k, entry))) }
        };
        let (rank, n_cols) = (factors.rank as usize, factors.n_cols as usize);
        let left = factors.left.iter().enumerate().map(|(i, entry)| value(&kept.left, i % rank, *entry)).collect();
        let right = factors.right.iter().enumerate().map(|(i, entry)| value(&kept.right, i / n_cols, *entry)).collect();
        BlockFactors { left, right, scale: kept.scale, ..factors.clone() }
    }

    /// A frame whose halves are what is kept of another.
    pub(crate) fn frame_in_halves(frame: &Frame) -> Frame {
        let mut frame = frame.clone();
        for block in frame.groups.iter_mut().flat_map(|group| group.blocks.iter_mut().flatten()) {
            *block = Arc::new(in_halves(block));
        }
        frame
    }

    #[test]
    fn bytes_add_no_more_than_their_share_of_the_blocks_own_error() {
        let recipe = Recipe { rank: Ranks::Fixed(11), n_cols: vec![23], n_sparse: 0, ..Recipe::default() };
        let frame = falling(&recipe);
        let (mut n_bytes, mut n_halves) = (0, 0);
        for block in frame.groups[0].blocks.iter().flatten() {
            let kept = Precision::ByError.keep(block);
            let pairs = in_halves(block).dense().into_iter().zip(block.dense());
            let n_entries = f64::from(block.n_rows * block.n_cols);
            let added = pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / n_entries;
            let allowed = SHARE * f64::from(block.error.truncation);
            assert!(added <= 1.1 * allowed, "{added:e} added where {allowed:e} may be");
            for (side, together) in [&kept.left, &kept.right].into_iter().zip(TOGETHER) {
                assert!(side.n_halves == 11 || side.n_halves.is_multiple_of(together), "{}", side.n_halves);
                (n_halves, n_bytes) = (n_halves + side.n_halves, n_bytes + 11 - side.n_halves);
            }
        }
        assert!(n_bytes > 20 && n_halves > 20, "{n_bytes} bytes, {n_halves} halves");
    }

    #[test]
    fn nothing_is_rounded_where_no_error_was_measured_or_none_may_be_added() {
        let mut frame = Recipe { rank: Ranks::Fixed(5), n_sparse: 0, ..Recipe::default() }.frame();
        let block = Arc::make_mut(frame.groups[0].blocks[0].as_mut().unwrap());
        for (truncation, n_halves) in [(0.0, 5), (-1.0, 5), (f32::NAN, 5), (1e-20, 5), (1e20, 0)] {
            block.error.truncation = truncation;
            let kept = Precision::ByError.keep(block);
            assert_eq!([kept.left.n_halves, kept.right.n_halves], [n_halves; 2], "{truncation}");
        }
        block.error.truncation = 1e20;
        block.left.fill(f16::ZERO);
        assert!(in_halves(block).left.iter().all(|entry| *entry == f16::ZERO), "a vector of zeros has no step");
        assert_eq!(Precision::Halves.keep(block).scale, block.scale);
    }
}
