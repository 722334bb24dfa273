//! The samples of one half of a block, in two parts: between them the half sees how noisy it is.
//!
//! The first part is all that was there at the last look, the second what came since. As samples double from look to look,
//! both are equally many.

use std::{mem, ops::Range};

use crate::{
    matrix::{Half, SampledMatrix, SparseEntry},
    sparse::merge,
};

/// Sparse entries that are collected before duplicates are merged.
const MERGE_AT: usize = 1 << 16;

/// What was sampled of one half of a block.
#[derive(Default)]
pub(crate) struct Sums {
    /// Row-major, rows × columns of the matrix; zero where there is no sample.
    parts: [Vec<f32>; 2],
    n_samples: [u32; 2],
    sparse: Vec<SparseEntry>,
    n_merged: usize,
    /// Samples that count; those of a closed half that come later only tell how noisy it is.
    n_counted: u32,
    closed: bool,
}

impl Sums {
    /// Forgets the last block.
    pub(crate) fn start(&mut self, n_entries: usize) {
        for (part, n_samples) in self.parts.iter_mut().zip(self.n_samples) {
            if n_samples > 0 {
                part.clear();
            }
            part.resize(n_entries, 0.0);
        }
        self.sparse.clear();
        (self.n_samples, self.n_merged, self.n_counted, self.closed) = ([0; 2], 0, 0, false);
    }

    /// Adds samples to the second part.
    pub(crate) fn add<M: SampledMatrix>(&mut self, matrix: &M, bundles: &[u32], samples: Range<u32>, half: Half) {
        self.n_samples[1] += samples.len() as u32;
        if self.closed {
            return matrix.add_rows(bundles, samples, half, &mut self.parts[1], &mut Vec::new());
        }
        self.n_counted += samples.len() as u32;
        matrix.add_rows(bundles, samples, half, &mut self.parts[1], &mut self.sparse);
        if self.sparse.len() > 2 * self.n_merged + MERGE_AT {
            merge(&mut self.sparse);
            self.n_merged = self.sparse.len();
        }
    }

    /// The second part becomes a part of the first.
    pub(crate) fn join(&mut self) {
        let [all, new] = &mut self.parts;
        if self.n_samples[0] == 0 {
            mem::swap(all, new);
        } else if self.n_samples[1] > 0 {
            for (all, new) in all.iter_mut().zip(new) {
                *all += *new;
                *new = 0.0;
            }
        }
        self.n_samples = [self.n_samples[0] + self.n_samples[1], 0];
    }

    /// From now on no sample counts.
    pub(crate) fn close(&mut self) {
        self.closed = true;
    }

    /// After a [`Sums::join`], before samples come that do not count: puts aside those that do.
    pub(crate) fn keep(&self, kept: &mut Vec<f32>) {
        if self.closed && self.all_count() {
            kept.clone_from(&self.parts[0]);
        }
    }

    fn all_count(&self) -> bool {
        self.n_counted == self.n_samples[0] + self.n_samples[1]
    }

    /// Do further samples count?
    pub(crate) fn open(&self) -> bool {
        !self.closed
    }

    /// Both parts, each with its number of samples.
    pub(crate) fn parts(&self) -> ([&[f32]; 2], [u32; 2]) {
        (self.parts.each_ref().map(Vec::as_slice), self.n_samples)
    }

    /// The sums of the samples that count, after a [`Sums::join`], and how many they are; `kept` is what [`Sums::keep`] put
    /// aside.
    pub(crate) fn counted<'a>(&'a self, kept: &'a [f32]) -> (&'a [f32], u32) {
        (if self.all_count() { &self.parts[0] } else { kept }, self.n_counted)
    }

    /// Sums of the sparse entries that count.
    pub(crate) fn sparse(&self) -> &[SparseEntry] {
        &self.sparse
    }
}
