//! Whole matrices over few bundles as matrices over many: each bundle of a large raster is told by some of a small one.
//!
//! Rows of a large block are sums of rows of a few small ones. The right factors of these, each once, are its own, one below the other: nothing
//! is projected, and no entry of either matrix is ever made.

use std::collections::BTreeMap;
use std::sync::Arc;

use half::{f16, slice::HalfFloatSliceExt};
use rayon::prelude::*;

use crate::factors::{BlockError, BlockFactors};
use crate::low_rank::BlockLowRank;
use crate::matrix::SparseEntry;
use crate::partition::Partition;

/// A bundle of a small raster that tells one of a large one, each of so many rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Teller<const ROWS: usize> {
    /// Its number.
    pub bundle: u32,
    /// What its rows are multiplied by, their sparse entries aside.
    pub factors: [f32; ROWS],
    /// What these are multiplied by.
    pub sparse: [f32; ROWS],
}

/// Which bundles of a small raster tell those of a large one.
pub trait Tellers<const ROWS: usize>: Sync {
    /// Appends those that tell a bundle. Where there are none, its rows are zero.
    fn tell(&self, bundle: u32, out: &mut Vec<Teller<ROWS>>);
    /// Appends columns of a group with what is known of them, and added to the rows of a bundle.
    fn own(&self, _bundle: u32, _group: usize, _out: &mut Vec<(u32, [f32; ROWS])>) {}
}

/// Matrices of the same small raster as matrices of a large one. A block that is told by one that is not there is not there either, and
/// errors are those of the blocks that tell: what the large raster has that the small one does not is not among them. `None` if `goes_on`
/// said no.
pub fn enlarged<const ROWS: usize>(
    groups: &[BlockLowRank],
    to: &Partition,
    tellers: &impl Tellers<ROWS>,
    goes_on: &(dyn Fn() -> bool + Sync),
) -> Option<Vec<BlockLowRank>> {
    let of_block = |block_idx: usize| {
        let mut bundles = Vec::new();
        to.bundles(block_idx, &mut bundles);
        let told = goes_on()
            .then(|| bundles.iter().map(|bundle| listed(|out| tellers.tell(*bundle, out))).collect::<Vec<_>>())?;
        let block = |(nth, group): (usize, &BlockLowRank)| {
            let own = bundles.iter().map(|bundle| listed(|out| tellers.own(*bundle, nth, out)));
            block(group, &told, own.collect()).map(Arc::new)
        };
        Some(groups.iter().enumerate().map(block).collect::<Vec<_>>())
    };
    let blocks: Option<Vec<_>> = (0..to.n_blocks()).into_par_iter().map(of_block).collect();
    let blocks = blocks?;
    let group = |(nth, group): (usize, &BlockLowRank)| BlockLowRank {
        partition: to.clone(),
        blocks: blocks.iter().map(|block| block[nth].clone()).collect(),
        ..*group
    };
    Some(groups.iter().enumerate().map(group).collect())
}

fn listed<T>(list: impl FnOnce(&mut Vec<T>)) -> Vec<T> {
    let mut listed = Vec::new();
    list(&mut listed);
    listed
}

/// A small block that tells.
struct Source<'a> {
    block: &'a BlockFactors,
    /// Its left factor times its scales, row-major, rows × rank.
    left: Vec<f32>,
    /// Where its components stand among those of the large block.
    first: usize,
}

impl<'a> Source<'a> {
    fn new(block: &'a BlockFactors, first: usize) -> Self {
        let mut left = vec![0.0; block.left.len()];
        block.left.convert_to_f32_slice(&mut left);
        for row in left.chunks_exact_mut((block.rank as usize).max(1)) {
            row.iter_mut().zip(&block.scale).for_each(|(x, scale)| *x *= scale);
        }
        Source { block, left, first }
    }

    /// The entries of a row that no low rank holds.
    fn sparse(&self, row: usize) -> impl Iterator<Item = &SparseEntry> {
        let first = self.block.sparse.partition_point(|entry| (entry.row as usize) < row);
        self.block.sparse[first..].iter().take_while(move |entry| entry.row as usize == row)
    }
}

/// A block of a group, by what tells each of its bundles and what is known of it.
fn block<const ROWS: usize>(
    small: &BlockLowRank,
    told: &[Vec<Teller<ROWS>>],
    own: Vec<Vec<(u32, [f32; ROWS])>>,
) -> Option<BlockFactors> {
    assert_eq!(small.bundle_len as usize, ROWS, "rows of a bundle");
    let place = |bundle: u32| small.partition.place(bundle).expect("who tells lies in the small raster");
    let (mut sources, mut right) = (BTreeMap::<usize, Source>::new(), Vec::<f16>::new());
    let n_cols = small.n_cols as usize;
    for teller in told.iter().flatten() {
        let (block_idx, _) = place(teller.bundle);
        if sources.contains_key(&block_idx) {
            continue;
        }
        let block = small.blocks[block_idx].as_deref()?;
        let known = sources.values().find(|source| source.block.right == block.right).map(|source| source.first);
        let first = known.unwrap_or_else(|| {
            let first = right.len() / n_cols.max(1);
            right.extend_from_slice(&block.right);
            first
        });
        sources.insert(block_idx, Source::new(block, first));
    }
    let (rank, n_rows) = (right.len() / n_cols.max(1), told.len() * ROWS);
    let (mut left, mut sparse) = (vec![0.0f32; n_rows * rank], BTreeMap::<(u32, u32), f32>::new());
    for (nth, tellers) in told.iter().enumerate() {
        for teller in tellers {
            let (block_idx, bundle) = place(teller.bundle);
            let source = &sources[&block_idx];
            let n_own = source.block.rank as usize;
            for (row, (factor, of_sparse)) in teller.factors.iter().zip(&teller.sparse).enumerate() {
                let (from, to) = (bundle as usize * ROWS + row, nth * ROWS + row);
                let out = &mut left[to * rank + source.first..][..n_own];
                let own = &source.left[from * n_own..][..n_own];
                out.iter_mut().zip(own).for_each(|(out, x)| *out += factor * x);
                for entry in source.sparse(from).filter(|_| *of_sparse != 0.0) {
                    *sparse.entry((to as u32, entry.col)).or_default() += of_sparse * entry.value;
                }
            }
        }
    }
    for (nth, (col, values)) in
        own.into_iter().enumerate().flat_map(|(nth, own)| own.into_iter().map(move |own| (nth, own)))
    {
        for (row, value) in values.into_iter().enumerate() {
            *sparse.entry(((nth * ROWS + row) as u32, col)).or_default() += value;
        }
    }
    let sparse = sparse.into_iter().map(|((row, col), value)| SparseEntry { row, col, value }).collect();
    let (n_samples, error) = (sources.values().map(|source| source.block.n_samples).min(), mean_error(&sources));
    let (n_rows, n_cols, rank) = (n_rows as u32, small.n_cols, rank as u32);
    let n_samples = n_samples.unwrap_or(0);
    let factors = BlockFactors { n_rows, n_cols, rank, right, sparse, n_samples, error, ..BlockFactors::default() };
    Some(factors.with_left(&left))
}

fn mean_error(sources: &BTreeMap<usize, Source>) -> BlockError {
    let mean = |of: fn(&BlockError) -> f32| {
        sources.values().map(|source| of(&source.block.error)).sum::<f32>() / sources.len().max(1) as f32
    };
    BlockError { truncation: mean(|e| e.truncation), sampling: mean(|e| e.sampling), noise: mean(|e| e.noise) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    fn teller(bundle: u32, factors: [f32; 2]) -> Teller<2> {
        Teller { bundle, factors, sparse: [1.5, 0.0] }
    }

    const SMALL: Partition = Partition { width: 5, height: 3, tile: 2 };
    const LARGE: Partition = Partition { width: 10, height: 6, tile: 4 };
    const N_COLS: usize = 4;

    /// Each bundle is told by the one in its place, doubled, and by the one to the right of it; none in the first line.
    struct Beside;

    impl Tellers<2> for Beside {
        fn tell(&self, bundle: u32, out: &mut Vec<Teller<2>>) {
            let (x, y) = (bundle % LARGE.width / 2, bundle / LARGE.width / 2);
            if y > 0 {
                let right = (x + 1).min(SMALL.width - 1);
                out.extend([teller(y * SMALL.width + x, [2.0, 3.0]), teller(y * SMALL.width + right, [0.5, 0.0])]);
            }
        }

        fn own(&self, bundle: u32, group: usize, out: &mut Vec<(u32, [f32; 2])>) {
            out.extend((bundle % 7 == 3).then_some((1, [group as f32 + 0.5, -4.0])));
        }
    }

    /// Blocks of ranks of their own, some with the same right factor, with an entry that no low rank holds.
    fn small() -> BlockLowRank {
        let mut matrix = BlockLowRank::new(SMALL, 2, N_COLS as u32);
        for block_idx in 0..SMALL.n_blocks() {
            let [_, _, width, height] = SMALL.rect(block_idx);
            let (n_rows, rank) = ((2 * width * height) as usize, block_idx % 3);
            let [mut left, mut right] = [Random::new([block_idx as u64, 0]), Random::new([rank as u64, 1])];
            let left: Vec<f32> = (0..n_rows * rank).map(|_| left.normal()).collect();
            let right: Vec<f32> = (0..rank * N_COLS).map(|_| right.normal()).collect();
            let mut factors = BlockFactors::from_f32(&left, &right, n_rows, N_COLS, rank);
            factors.sparse.push(SparseEntry { row: 1, col: 2, value: 5.0 });
            factors.error.sampling = 0.5;
            factors.n_samples = 2 + block_idx as u32;
            matrix.blocks[block_idx] = Some(Arc::new(factors));
        }
        matrix
    }

    #[test]
    fn rows_are_the_sums_of_those_that_tell_them() {
        let small = small();
        let large = enlarged(std::slice::from_ref(&small), &LARGE, &Beside, &|| true).unwrap().swap_remove(0);
        let mut dense = small.clone();
        dense.blocks.iter_mut().flatten().for_each(|block| Arc::make_mut(block).sparse.clear());
        for col in 0..N_COLS {
            let mut one = [0.0; N_COLS];
            one[col] = 1.0;
            let (all, dense, got) = (small.apply(&one), dense.apply(&one), large.apply(&one));
            for bundle in 0..LARGE.width * LARGE.height {
                let told = listed(|out| Beside.tell(bundle, out));
                let own = listed(|out| Beside.own(bundle, 0, out));
                for row in 0..2 {
                    let part = |teller: &Teller<2>| {
                        let from = 2 * teller.bundle as usize + row;
                        teller.factors[row] * dense[from] + teller.sparse[row] * (all[from] - dense[from])
                    };
                    let own: f32 = own.iter().filter(|(of, _)| *of == col as u32).map(|(_, own)| own[row]).sum();
                    let (want, got) = (told.iter().map(part).sum::<f32>() + own, got[2 * bundle as usize + row]);
                    assert!((got - want).abs() < 0.02, "{bundle}, {row}, {col}: {got} {want}");
                }
            }
        }
    }

    #[test]
    fn right_factors_that_are_alike_count_once() {
        let large = enlarged(&[small()], &LARGE, &Beside, &|| true).unwrap().swap_remove(0);
        // All small blocks together have three right factors, of ranks 0, 1 and 2.
        assert!(large.max_rank() <= 3, "{}", large.max_rank());
        assert!(large.blocks.iter().flatten().all(|block| block.error.sampling <= 0.5 && block.doubt.is_empty()));
    }

    #[test]
    fn what_is_missing_stays_missing_and_nobody_waits_for_what_nobody_wants() {
        let mut small = small();
        *small.blocks.last_mut().unwrap() = None;
        let large = enlarged(std::slice::from_ref(&small), &LARGE, &Beside, &|| true).unwrap().swap_remove(0);
        assert!(large.blocks.last().unwrap().is_none() && large.blocks[0].is_some());
        assert!(enlarged(&[small], &LARGE, &Beside, &|| false).is_none());
    }

    #[test]
    fn a_bundle_has_its_place_in_its_block() {
        let mut bundles = Vec::new();
        for block in 0..SMALL.n_blocks() {
            SMALL.bundles(block, &mut bundles);
            for (nth, bundle) in bundles.iter().enumerate() {
                assert_eq!(SMALL.place(*bundle), Some((block, nth as u32)));
            }
        }
        assert_eq!(SMALL.place(SMALL.width * SMALL.height), None);
    }
}
