//! One right basis that all blocks share, in place of right factors of their own: tried, not used (decision 0040).

use std::sync::Arc;

use anyhow::Result;
use clerestory_nystrom::rivals::DMatrix;
use clerestory_nystrom::{BlockFactors, BlockLowRank, ColumnRun, PackPlan, PackedMatrix};

use crate::fronts::block_factors;

/// What the basis may leave of what is allowed.
const OF_ALLOWED: f64 = 0.25;

/// A matrix whose blocks share a right basis.
pub struct SharedRight {
    packed: PackedMatrix,
    /// Columns × vectors.
    basis: DMatrix<f64>,
}

impl SharedRight {
    /// Packs a matrix in as few shared vectors as leave little of what the plan allows.
    pub fn pack(matrix: &BlockLowRank, plan: &PackPlan) -> SharedRight {
        let basis = basis(matrix, OF_ALLOWED * f64::from(plan.allowed));
        let (n_cols, len) = basis.shape();
        let narrow = in_columns(matrix, len, |right| right * &basis * unit(&basis));
        let ones = DMatrix::from_element(1, n_cols, 1.0);
        let plan = PackPlan {
            columns: vec![ColumnRun::List(len as u32)],
            allowed: (1.0 - OF_ALLOWED) as f32 * plan.allowed,
            preserved: (ones * &basis).iter().map(|&x| x as f32).collect(),
            ..*plan
        };
        SharedRight { packed: PackedMatrix::pack(&narrow, &plan), basis }
    }

    /// Bytes of the blocks as a file has them, and of the basis: one an entry and four a vector.
    pub fn n_bytes(&self) -> usize {
        let mut bytes = Vec::new();
        self.packed.encode(&mut bytes);
        bytes.len() + (self.basis.nrows() + size_of::<f32>()) * self.basis.ncols()
    }

    /// The matrix, each block with a right factor of its own again.
    ///
    /// # Errors
    /// If what was packed cannot be read.
    pub fn unpack(&self) -> Result<BlockLowRank> {
        let (basis, unit) = (&self.basis, unit(&self.basis));
        let restored = |coefficients: &DMatrix<f64>| coefficients * basis.transpose() / unit;
        Ok(in_columns(&self.packed.unpack()?, basis.nrows(), restored))
    }
}

/// What keeps mean squares per entry as they are where vectors take the place of columns.
fn unit(basis: &DMatrix<f64>) -> f64 {
    (basis.ncols() as f64 / basis.nrows() as f64).sqrt()
}

/// The leading right singular vectors of all blocks together, in columns, each rounded to 255 steps: as few as leave a mean
/// square error per entry.
fn basis(matrix: &BlockLowRank, mean_square: f64) -> DMatrix<f64> {
    let n_cols = matrix.n_cols as usize;
    let (mut gram, mut n_entries) = (DMatrix::zeros(n_cols, n_cols), 0);
    for block in matrix.blocks.iter().flatten() {
        let (left, right) = factors(block);
        gram += right.transpose() * left.tr_mul(&left) * right;
        n_entries += left.nrows() * n_cols;
    }
    let eigen = gram.symmetric_eigen();
    let mut order: Vec<usize> = (0..n_cols).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
    let mut left = mean_square * n_entries as f64;
    let n_dropped = order.iter().take_while(|&&i| {
        left -= eigen.eigenvalues[i].max(0.0);
        left >= 0.0
    });
    let n_dropped = n_dropped.count().min(n_cols.saturating_sub(1));
    order.drain(..n_dropped);
    let mut basis = eigen.eigenvectors.select_columns(order.iter().rev());
    for mut vector in basis.column_iter_mut() {
        let step = vector.amax() / 127.0;
        vector.apply(|x| *x = (*x / step).round() * step);
    }
    basis
}

/// Each block with another right factor, of so many columns.
fn in_columns(matrix: &BlockLowRank, n_cols: usize, change: impl Fn(&DMatrix<f64>) -> DMatrix<f64>) -> BlockLowRank {
    let changed = |block: &Arc<BlockFactors>| {
        let (left, right) = factors(block);
        let [left, right] = [left, change(&right)].map(|factor| factor.map(|x| x as f32));
        let changed = block_factors(&left, &right);
        Arc::new(BlockFactors { error: block.error, n_samples: block.n_samples, ..changed })
    };
    BlockLowRank {
        partition: matrix.partition.clone(),
        n_cols: n_cols as u32,
        blocks: matrix.blocks.iter().map(|block| block.as_ref().map(changed)).collect(),
        ..*matrix
    }
}

/// Rows × rank, the scale in it, and rank × columns.
fn factors(block: &BlockFactors) -> (DMatrix<f64>, DMatrix<f64>) {
    let [n_rows, rank, n_cols] = [block.n_rows, block.rank, block.n_cols].map(|count| count as usize);
    let left = |row: usize, r: usize| f64::from(block.left[row * rank + r].to_f32()) * f64::from(block.scale[r]);
    let right = |r: usize, col: usize| f64::from(block.right[r * n_cols + col].to_f32());
    (DMatrix::from_fn(n_rows, rank, left), DMatrix::from_fn(rank, n_cols, right))
}

#[cfg(test)]
mod tests {
    use crate::targets::coded::{Coding, Storage, Subject};
    use crate::targets::judged::decibels;
    use crate::targets::soft;

    #[test]
    fn a_shared_basis_keeps_what_is_asked_for_and_counts_its_own_bytes() {
        let subject = Subject::new(soft::picture(32, 32, 8), None);
        let coded = |storage: Storage| {
            let coded = subject.coded_as(Coding { storage, grid: false, ..Coding::default() }, 35.0).unwrap();
            (decibels(coded.judged.mean_square()), coded.ratio)
        };
        let [(own_db, own), (shared_db, shared)] = [Storage::Packed, Storage::SharedRight].map(coded);
        assert!((33.0..40.0).contains(&own_db) && (33.0..40.0).contains(&shared_db), "{own_db} {shared_db}");
        // Four blocks of 64 columns: the basis alone takes some hundred bytes.
        assert!(shared < own && shared > 0.2 * own, "{own} {shared}");
    }
}
