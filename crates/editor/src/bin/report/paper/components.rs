//! The leading components of decomposed blocks, which nothing of the same rank comes nearer than: as numbers, and packed as ours.

use std::sync::Arc;

use anyhow::{Context, Result};
use clerestory_nystrom::rivals::{Approximation, DMatrix, Method, MethodError, approximate};
use clerestory_nystrom::{BlockLowRank, ColumnRun, PackPlan, PackedMatrix};
use rayon::prelude::*;

use super::SEED;
use crate::fronts::block_factors;
use crate::methods::dense::{CHANNELS, Picture};
use crate::targets::coded::written_and_read;

/// Dark blocks may err as much as bright ones, which takes fewer bytes than what bakes hold them to.
const BRIGHT: f32 = 0.0;
/// Part of the error that is left to the ranks; packing takes the rest.
const SHARE_OF_RANKS: f64 = 0.5;

/// All components of each block of a picture, strongest first.
pub(super) struct Components {
    blocks: Vec<Approximation<f32>>,
}

impl Components {
    /// Decomposes every block.
    ///
    /// # Errors
    /// If the rotations do not come to an end.
    pub(super) fn new(blocks: &[DMatrix<f32>]) -> Result<Components, MethodError> {
        let all = |block: &DMatrix<f32>| approximate(Method::Svd, block, block.nrows().min(block.ncols()), SEED);
        Ok(Components { blocks: blocks.par_iter().map(all).collect::<Result<_, _>>()? })
    }

    /// Left and right of each block.
    fn factors(&self) -> impl Iterator<Item = Result<(&DMatrix<f32>, &DMatrix<f32>)>> {
        self.blocks.iter().map(|block| block.factors().context("components are factors"))
    }

    /// As many of each block, and how many numbers that are.
    pub(super) fn leading(&self, picture: &Picture, rank: usize) -> Result<(Picture, usize)> {
        let (mut dense, mut n_values) = (Vec::new(), 0);
        for factors in self.factors() {
            let (left, right) = factors?;
            let rank = rank.min(left.ncols());
            dense.push(left.columns(0, rank) * right.rows(0, rank));
            n_values += rank * (left.nrows() + right.ncols());
        }
        Ok((picture.with_blocks(&dense), n_values))
    }

    /// As many of each block as bring it within a mean square error, packed as a file has it: the bytes, and what is read back.
    ///
    /// # Errors
    /// If they cannot be packed or read back.
    pub(super) fn packed(&self, picture: &Picture, allowed: f64) -> Result<(usize, BlockLowRank)> {
        let mut matrix = BlockLowRank::new(picture.partition(), CHANNELS as u32, picture.n_cols as u32);
        for (block, factors) in matrix.blocks.iter_mut().zip(self.factors()) {
            let (left, right) = factors?;
            let (energies, n_entries) = (energies((left, right)), (left.nrows() * right.ncols()) as f64);
            let rank = rank(&energies, SHARE_OF_RANKS * allowed * n_entries);
            let mut kept = block_factors(&left.columns(0, rank).into_owned(), &right.rows(0, rank).into_owned());
            // What the rank has used up of what is allowed.
            kept.error.truncation = (energies[rank..].iter().sum::<f64>() / n_entries) as f32;
            *block = Some(Arc::new(kept));
        }
        let side = picture.n_cols.isqrt() as u32;
        let columns = vec![ColumnRun::Grid { width: side, height: side }];
        let preserved = vec![1.0; picture.n_cols];
        let packed = PackedMatrix::pack(
            &matrix,
            &PackPlan { columns, allowed: allowed as f32, strong: BRIGHT, apart: 0.0, preserved },
        );
        written_and_read(&packed)
    }
}

/// Squared singular values: one side is orthonormal.
fn energies((left, right): (&DMatrix<f32>, &DMatrix<f32>)) -> Vec<f64> {
    let pairs = left.column_iter().zip(right.row_iter());
    pairs.map(|(left, right)| f64::from(left.norm_squared()) * f64::from(right.norm_squared())).collect()
}

/// How many components are kept, strongest first, so that the energies of the others sum to no more.
fn rank(energies: &[f64], most: f64) -> usize {
    let mut left_out = 0.0;
    let is_left_out = |energy: &&f64| {
        left_out += **energy;
        left_out <= most
    };
    energies.len() - energies.iter().rev().take_while(is_left_out).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::targets::soft;

    #[test]
    fn the_weakest_components_are_left_out() {
        assert_eq!([0.5, 1.0, 2.9, 3.0, 40.0].map(|most| rank(&[30.0, 2.0, 1.0], most)), [3, 2, 2, 1, 0]);
    }

    #[test]
    fn packed_components_keep_to_what_is_allowed_in_fewer_bytes() {
        let picture = soft::picture(32, 16, 8);
        let peak = picture.peak();
        let picture = Picture { values: picture.values.iter().map(|x| x / peak as f32).collect(), ..picture };
        let components = Components::new(&picture.blocks(1)).unwrap();
        let (found, n_values) = components.leading(&picture, 64).unwrap();
        let square = |found: &Picture| {
            let squares = found.values.iter().zip(&picture.values).map(|(x, y)| f64::from(x - y).powi(2));
            squares.sum::<f64>() / picture.values.len() as f64
        };
        assert!(n_values > 0 && square(&found) < 1e-9, "{} {:e}", n_values, square(&found));
        let [coarse, fine] = [1e-3, 1e-4].map(|allowed| {
            let (bytes, matrix) = components.packed(&picture, allowed).unwrap();
            let square = square(&picture.unpacked(&matrix));
            // Two small blocks tell little of a common step.
            assert!((0.3 * allowed..2.0 * allowed).contains(&square), "{square:e} of {allowed:e}");
            bytes
        });
        assert!(coarse < fine && fine < 4 * picture.values.len(), "{coarse} {fine}");
    }
}
