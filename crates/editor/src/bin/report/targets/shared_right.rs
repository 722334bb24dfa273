//! One right basis that all blocks share, in place of right factors of their own: tried, not used (decision 0040).

use std::sync::Arc;

use anyhow::Result;
use clerestory_nystrom::rivals::DMatrix;
use clerestory_nystrom::{BlockFactors, BlockLowRank, ColumnRun, PackPlan, PackedMatrix};

/// What the basis may leave of what is allowed.
const OF_ALLOWED: f64 = 0.25;

/// Packs a matrix in as few shared vectors as leave little of what the plan allows, and reads it back: with the bytes of both,
/// one an entry of the basis and four a vector.
///
/// # Errors
/// If what was packed cannot be read.
pub fn packed(matrix: &BlockLowRank, plan: &PackPlan) -> Result<(BlockLowRank, usize)> {
    let n_cols = matrix.n_cols as usize;
    let basis = basis(matrix, OF_ALLOWED * f64::from(plan.allowed));
    let len = basis.ncols();
    // Mean squares per entry stay what they are.
    let unit = (len as f64 / n_cols as f64).sqrt();
    let narrow = in_columns(matrix, len, |right| right * &basis * unit);
    let ones = DMatrix::from_element(1, n_cols, 1.0);
    let plan = PackPlan {
        columns: vec![ColumnRun::List(len as u32)],
        allowed: (1.0 - OF_ALLOWED) as f32 * plan.allowed,
        preserved: (ones * &basis).iter().map(|&x| x as f32).collect(),
        ..*plan
    };
    let packed = PackedMatrix::pack(&narrow, &plan);
    let mut bytes = Vec::new();
    packed.encode(&mut bytes);
    let read = in_columns(&packed.unpack()?, n_cols, |coefficients| coefficients * basis.transpose() / unit);
    Ok((read, bytes.len() + (n_cols + size_of::<f32>()) * len))
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
        let right = change(&right);
        let rows = |matrix: &DMatrix<f64>| matrix.transpose().iter().map(|&x| x as f32).collect::<Vec<_>>();
        let changed = BlockFactors::from_f32(&rows(&left), &rows(&right), left.nrows(), n_cols, left.ncols());
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
