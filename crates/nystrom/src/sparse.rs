//! Entries that no low rank holds: collected as they come, then sorted, merged and averaged.
//!
//! A half may have other samples than the other one: what counts is the mean of both halves' means.

use std::ops::Range;

use crate::matrix::SparseEntry;

/// Entries of one group of columns, each once, the mean of both halves' means; column counted from the group's first.
pub(crate) fn sparse_part(
    halves: [&[SparseEntry]; 2],
    columns: &Range<usize>,
    n_samples: [u32; 2],
) -> Vec<SparseEntry> {
    let mut out = Vec::new();
    for (entries, n_samples) in halves.into_iter().zip(n_samples) {
        let inside = entries.iter().filter(|entry| columns.contains(&(entry.col as usize)));
        let mut sums: Vec<SparseEntry> =
            inside.map(|entry| SparseEntry { col: entry.col - columns.start as u32, ..*entry }).collect();
        merge(&mut sums);
        let scale = 0.5 / f64::from(n_samples);
        sums.iter_mut().for_each(|entry| entry.value = (f64::from(entry.value) * scale) as f32);
        out.append(&mut sums);
    }
    merge(&mut out);
    out.retain(|entry| entry.value != 0.0);
    out
}

/// Sorts by row, then column, and adds up entries of the same place (in the order in which they came).
pub(crate) fn merge(entries: &mut Vec<SparseEntry>) {
    entries.sort_by_key(|entry| (entry.row, entry.col));
    let mut merged: Vec<SparseEntry> = Vec::with_capacity(entries.len());
    for same in entries.chunk_by(|x, y| (x.row, x.col) == (y.row, y.col)) {
        let value = same.iter().map(|entry| f64::from(entry.value)).sum::<f64>() as f32;
        merged.push(SparseEntry { value, ..same[0] });
    }
    *entries = merged;
}
