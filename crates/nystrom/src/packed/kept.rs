//! The product that is kept: whatever rounding and rank took from it is stored for itself, far more finely.
//!
//! The product of the block with one direction p of its columns is the one that is asked for most, and it is judged relative to
//! its own size in each block, not to the peak of the matrix. So the residual of that product is a plane of its own, with a step of its own, and
//! goes back to where `left · right` holds the direction: the least change for which the product is right.

use super::{
    layout::Layout,
    quantize::{octaves, quarters_of, round_toward_zero},
};
use crate::{factors::BlockFactors, preserve::LEAST_SHARE};

/// Root mean square error of the kept product, as a share of its own root mean square in the block.
const RELATIVE_ERROR: f64 = 1.0 / 2048.0;
/// The same as a share of its sampling noise.
const SHARE_OF_NOISE: f64 = 0.25;
/// Octaves in quarters that a step may be from 1.
pub(super) const MAX_QUARTERS: i32 = 600;

/// Factors in single precision: row-major rows × rank and rank × columns.
#[derive(Clone, Debug, Default)]
pub(super) struct Plain {
    pub left: Vec<f32>,
    pub right: Vec<f32>,
    pub rank: usize,
}

/// The residual of the kept product, rounded.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Kept {
    /// Octaves of its step, in quarters.
    pub(super) quarters: i32,
    /// Planes of the row transform.
    pub(super) planes: Vec<i32>,
}

impl Kept {
    /// What `rounded` lacks of the product `wanted`, whose samples have some noise (a mean square); `None` if that is nothing.
    pub(super) fn new(
        wanted: &[f64],
        noise: f64,
        rounded: &Plain,
        direction: &[f32],
        block_idx: usize,
        layout: &Layout,
    ) -> Option<Self> {
        let got = product_with(&rounded.left, &rounded.right, rounded.rank, direction, wanted.len());
        let residual: Vec<f32> = wanted.iter().zip(&got).map(|(wanted, got)| (wanted - got) as f32).collect();
        let mean_square = wanted.iter().map(|x| x * x).sum::<f64>() / wanted.len().max(1) as f64;
        let error = (RELATIVE_ERROR * mean_square.sqrt()).max(SHARE_OF_NOISE * noise.max(0.0).sqrt());
        let quarters = quarters_of(12f64.sqrt() * error).floor();
        if !quarters.is_finite() {
            return None;
        }
        let quarters = quarters.clamp(f64::from(-MAX_QUARTERS), f64::from(MAX_QUARTERS)) as i32;
        let step = octaves(quarters) as f32;
        let planes = layout.rows_forward(&residual, block_idx);
        let planes: Vec<i32> = planes.iter().map(|x| round_toward_zero(x / step)).collect();
        planes.iter().any(|&q| q != 0).then_some(Self { quarters, planes })
    }

    /// Gives the residual back to factors.
    #[expect(clippy::arithmetic_side_effects, reason = "indices of a matrix that lies in memory")]
    pub(super) fn restore(&self, plain: &mut Plain, direction: &[f32], block_idx: usize, layout: &Layout) {
        let step = octaves(self.quarters) as f32;
        let residual = layout.rows_inverse(self.planes.iter().map(|&q| q as f32 * step).collect(), block_idx);
        let held = held(&plain.right, direction);
        let share: f64 = held.iter().map(|x| x * x).sum();
        if share >= LEAST_SHARE {
            for (row, missing) in plain.left.chunks_exact_mut(plain.rank).zip(&residual) {
                let missing = f64::from(*missing) / share;
                row.iter_mut().zip(&held).for_each(|(x, held)| *x += (missing * held) as f32);
            }
            return;
        }
        let (rank, left) = (plain.rank, std::mem::take(&mut plain.left));
        for (row, missing) in residual.into_iter().enumerate() {
            plain.left.extend(&left[row * rank..][..rank]);
            plain.left.push(missing);
        }
        plain.right.extend(direction);
        plain.rank += 1;
    }
}

impl Plain {
    /// The same in halves.
    pub(super) fn factors(&self, block_idx: usize, layout: &Layout) -> BlockFactors {
        BlockFactors::from_f32(&self.left, &self.right, layout.n_rows(block_idx), layout.n_cols(), self.rank)
    }
}

/// What each component (a row of `right`) holds of a direction.
fn held<T: Copy + Into<f64>>(right: &[T], direction: &[f32]) -> Vec<f64> {
    let rows = right.chunks_exact(direction.len().max(1));
    rows.map(|row| row.iter().zip(direction).map(|(&x, &p)| x.into() * f64::from(p)).sum()).collect()
}

/// The product of factors with a direction: one value per row.
#[expect(clippy::arithmetic_side_effects, reason = "indices of a matrix that lies in memory")]
pub(super) fn product_with<T: Copy + Into<f64>>(
    left: &[T],
    right: &[T],
    rank: usize,
    direction: &[f32],
    n_rows: usize,
) -> Vec<f64> {
    let held = held(right, direction);
    let row = |row: usize| left[row * rank..][..rank].iter().zip(&held).map(|(&x, held)| x.into() * held).sum();
    (0..n_rows).map(row).collect()
}
