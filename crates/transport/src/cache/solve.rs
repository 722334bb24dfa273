//! The light of all cells: straight from the lamps, by walks of their own, and from each other.

use clerestory_nystrom::Half;
use glam::Vec3;
use rayon::prelude::*;

use super::cells::{Cells, POINTS, Place};
use super::{CachePlan, STREAM};
use crate::matrix::{CHANNELS, RowDeposit, TransportMatrix, add_weighted};
use crate::path::{Deposit, KnownAt, Onto, Scratch};
use crate::sampler::Sampler;

/// Sweeps at most, and the change of a sweep at which the rest is not worth another.
const SWEEPS: u32 = 16;
const SETTLED: f64 = 2e-3;
/// Most columns for which more than one point of a cell asks the lamps.
const FEW_COLUMNS: usize = 256;
/// Streams of a cell.
const STREAMS: u64 = 4;

/// A part of the light of another cell.
#[derive(Clone, Copy)]
struct Share {
    cell: u32,
    weight: Vec3,
}

/// What a cell receives: `rows` from lamps and by walks, the rest from other cells.
struct Receipt {
    rows: Vec<f32>,
    shares: Vec<Share>,
}

/// The light of all cells, cell by cell three rows of all columns.
pub(super) fn light(matrix: &TransportMatrix<'_>, cells: &Cells, half: Half, plan: CachePlan) -> Vec<f32> {
    let receive = |scratch: &mut Scratch, (nth, points): (usize, &Vec<Place>)| {
        let stream = STREAM + (1 << 60) + nth as u64 * STREAMS + u64::from(half == Half::B);
        receipt((matrix, cells), (points, half), (stream, plan.walks), scratch)
    };
    let receipts: Vec<Receipt> = cells.points.par_iter().enumerate().map_init(Scratch::default, receive).collect();
    let sweeps = matrix.integrator.bounces().saturating_sub(1).min(SWEEPS);
    solve(&receipts, CHANNELS * matrix.column_scale().len(), sweeps)
}

fn receipt(
    (matrix, cells): (&TransportMatrix<'_>, &Cells),
    (points, half): (&[Place], Half),
    (stream, walks): (u64, u32),
    scratch: &mut Scratch,
) -> Receipt {
    let n_cols = matrix.column_scale().len();
    // The halves ask at points of their own where there are enough.
    let own: Vec<&Place> = points.iter().skip(usize::from(half == Half::B && points.len() > 1)).step_by(2).collect();
    let n_direct = if n_cols > FEW_COLUMNS { 1 } else { (POINTS / 2).min(own.len()) };
    let mut direct = vec![0.0; CHANNELS * n_cols];
    for (nth, (hit, normal)) in own.iter().take(n_direct).enumerate() {
        let mut sampler = Sampler::new(matrix.seed, stream + 2, nth as u32);
        let mut deposit = RowDeposit::new(&mut direct, n_cols, matrix.column_scale());
        matrix.integrator.gather_direct((hit, *normal), &mut sampler, scratch, &mut deposit);
    }
    let mut rows = vec![0.0; CHANNELS * n_cols];
    let inner = RowDeposit::new(&mut rows, n_cols, matrix.column_scale());
    let mut deposit = Sharing { inner, cells, shares: Vec::new() };
    for walk in 0..walks {
        let (hit, normal) = own[walk as usize % own.len()];
        let mut sampler = Sampler::new(matrix.seed, stream, walk);
        matrix.integrator.gather_indirect((hit, *normal, Onto::Point), &mut sampler, scratch, &mut deposit);
    }
    let mut shares = deposit.shares;
    shares.iter_mut().for_each(|share| share.weight /= walks as f32);
    rows.iter_mut().zip(&direct).for_each(|(out, direct)| *out = *out / walks as f32 + direct / n_direct as f32);
    Receipt { rows, shares }
}

/// Jacobi's sweeps: light = rows + shares · light. What the last sweep leaves out is judged by how fast the changes fall.
fn solve(receipts: &[Receipt], len: usize, sweeps: u32) -> Vec<f32> {
    let mut light: Vec<f32> = receipts.iter().flat_map(|receipt| receipt.rows.iter().copied()).collect();
    let mut next = light.clone();
    let mut changed = f64::INFINITY;
    for sweep in 0..sweeps {
        next.par_chunks_mut(len).zip(receipts).for_each(|(out, receipt)| {
            out.copy_from_slice(&receipt.rows);
            for share in &receipt.shares {
                add_weighted(out, &light[share.cell as usize * len..][..len], share.weight);
            }
        });
        let total = |light: &[f32]| -> f64 {
            light.par_chunks(len).map(|l| f64::from(l.iter().sum::<f32>())).collect::<Vec<_>>().iter().sum()
        };
        let (before, after) = (total(&light), total(&next));
        std::mem::swap(&mut light, &mut next);
        let change = (after - before).abs();
        let falls = (change / changed).min(0.95);
        if change < SETTLED * after.abs() || sweep + 1 == sweeps {
            if sweeps == SWEEPS && falls.is_finite() && sweep > 0 {
                let rest = (falls / (1.0 - falls)) as f32;
                light.par_iter_mut().zip(&next).for_each(|(light, before)| *light += rest * (*light - before));
            }
            break;
        }
        changed = change;
    }
    light
}

/// Deposits to the rows of a cell; walks end at other cells, whose light is not known yet.
struct Sharing<'a, 'b> {
    inner: RowDeposit<'a>,
    cells: &'b Cells,
    shares: Vec<Share>,
}

impl Deposit for Sharing<'_, '_> {
    const KNOWS: bool = true;

    #[inline]
    fn scattered(&mut self, column: u32, value: Vec3) {
        self.inner.scattered(column, value);
    }

    fn seen(&mut self, column: u32, value: Vec3) {
        self.scattered(column, value);
    }

    fn known(&mut self, at: &KnownAt<'_>) -> bool {
        let Some(cell) = self.cells.find(at) else { return false };
        self.shares.push(Share { cell, weight: at.weight });
        true
    }
}
