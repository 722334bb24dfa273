//! The light of all cells: straight from the lamps, by walks of their own, and from each other.

use clerestory_nystrom::Half;
use glam::Vec3;
use rayon::prelude::*;

use super::CachePlan;
use super::cells::{Cells, POINTS, Place};
use crate::matrix::{CHANNELS, RowDeposit, TransportMatrix, add_weighted};
use crate::path::{Deposit, KnownAt, Onto, Scratch};
use crate::sampler::Sampler;
use crate::streams::Stream;

/// Sweeps at most, and the change of a sweep at which the rest is not worth another.
const SWEEPS: u32 = 16;
const SETTLED: f64 = 2e-3;
/// Most columns for which more than one point of a cell asks the lamps.
const FEW_COLUMNS: usize = 256;
/// The first of all cells' streams of random numbers.
const STREAM: u64 = Stream::CacheCells.first();
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
        let stream = STREAM + nth as u64 * STREAMS + u64::from(half == Half::B);
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
        matrix.integrator.gather_indirect((hit, *normal, Onto::Cell), &mut sampler, scratch, &mut deposit);
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

#[cfg(test)]
mod tests {
    use glam::{Quat, Vec2};

    use super::*;
    use crate::camera::{Camera, Film};
    use crate::laws::slabs::{block, glass};
    use crate::laws::stage::{Stage, lambert, quad, room};
    use crate::plan::{Density, MatrixPlan};

    /// Light of the only column on the surface that the camera looks at, as a cell there receives it with at most so many bounces: all
    /// of it but that of other cells, of which none is known, and what comes straight from the lamp.
    fn received(stage: Stage, bounces: u32) -> [f32; 2] {
        let scene = stage.prepared();
        let (camera, film) = (scene.scene.cameras[0].clone(), Film { width: 1, height: 1 });
        let ray = (camera.position(), camera.direction(film, Vec2::splat(0.5)));
        let plan = MatrixPlan::new(&scene.lighting, Density::Full);
        let matrix = TransportMatrix::new(&scene, &plan, camera, film, Some(bounces), 3);
        let place = matrix.integrator.gathering_surface(ray, &mut Sampler::new(1, 0, 0)).expect("it sees the floor");
        let (cells, mut scratch) = (Cells::fit(&[], 1), Scratch::default());
        let all = receipt((&matrix, &cells), (&[place], Half::A), (STREAM, 64), &mut scratch).rows;
        let mut direct = vec![0.0; CHANNELS];
        let mut deposit = RowDeposit::new(&mut direct, 1, matrix.column_scale());
        let mut sampler = Sampler::new(matrix.seed, STREAM + 2, 0);
        matrix.integrator.gather_direct((&place.0, place.1), &mut sampler, &mut scratch, &mut deposit);
        [all[1], direct[1]]
    }

    #[test]
    fn the_surface_that_sees_a_cell_counts_as_one() {
        let camera = Camera::look_at("eye", Vec3::new(0.2, 0.1, 0.9), Vec3::NEG_Y, 1.0, 1.0);
        let stage = || Stage::new(camera.clone()).surface("walls", &room(Vec3::ONE), lambert(0.6, 0.0));
        let lit = |bounces| received(stage().lamp("lamp", Vec3::new(0.1, 0.5, -0.2), 1.0), bounces);
        // A walk that scatters in the cell has come to its first bounce.
        let [all, direct] = lit(1);
        assert!(all == direct && direct > 0.0, "{all}, {direct} straight from the lamp");
        let [all, direct] = lit(2);
        assert!(all > 1.1 * direct, "{all}, {direct} straight from the lamp");
    }

    #[test]
    fn both_faces_of_a_pane_count_before_a_cell_as_elsewhere() {
        let camera = Camera::look_at("eye", Vec3::new(0.0, 0.3, 0.5), Vec3::ZERO, 1.0, 1.0);
        let floor = quad(Vec3::new(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0);
        let pane = block(Vec3::Y, Vec3::new(2.0, 0.05, 2.0), Quat::IDENTITY);
        let stage = || Stage::new(camera.clone()).surface("floor", &floor, lambert(0.6, 0.0));
        let lit = |bounces| {
            let stage = stage().surface("pane", &pane, glass()).lamp("lamp", Vec3::new(0.1, 1.5, 0.0), 1.0);
            received(stage, bounces)[1]
        };
        assert_eq!([0, 1, 2].map(lit), [0.0; 3]);
        assert!(lit(3) > 0.0);
    }
}
