//! All blocks of a matrix, compressed.

use std::sync::Arc;

use rayon::prelude::*;

use crate::{
    factors::{BlockError, BlockFactors},
    partition::Partition,
};

/// A whole matrix (or one group of its columns), block by block. A block that is not there yet is `None` and counts as zero.
#[derive(Clone, Debug, PartialEq)]
pub struct BlockLowRank {
    /// Which rows belong to which block.
    pub partition: Partition,
    /// Rows per bundle of the partition.
    pub bundle_len: u32,
    /// Number of columns.
    pub n_cols: u32,
    /// One per block of the partition.
    pub blocks: Vec<Option<Arc<BlockFactors>>>,
}

impl BlockLowRank {
    /// A matrix none of whose blocks is there yet.
    pub fn new(partition: Partition, bundle_len: u32, n_cols: u32) -> Self {
        let blocks = vec![None; partition.n_blocks()];
        Self { partition, bundle_len, n_cols, blocks }
    }

    /// Some of the columns, in the order given; see [`BlockFactors::with_columns`].
    #[must_use]
    pub fn with_columns(&self, columns: &[u32]) -> Self {
        let of_block =
            |block: &Option<Arc<BlockFactors>>| block.as_ref().map(|block| Arc::new(block.with_columns(columns)));
        let blocks = self.blocks.par_iter().map(of_block).collect();
        Self { partition: self.partition.clone(), bundle_len: self.bundle_len, n_cols: columns.len() as u32, blocks }
    }

    /// Number of rows.
    pub fn n_rows(&self) -> usize {
        self.partition.width as usize * self.partition.height as usize * self.bundle_len as usize
    }

    /// Memory that the factors take, in bytes.
    pub fn n_bytes(&self) -> usize {
        self.present().map(BlockFactors::n_bytes).sum()
    }

    /// Memory that the dense matrix would take in single precision, in bytes.
    pub fn dense_bytes(&self) -> usize {
        self.n_rows() * self.n_cols as usize * size_of::<f32>()
    }

    /// Mean rank of the blocks that are there; 0 if there are none.
    pub fn mean_rank(&self) -> f32 {
        let n_present = self.present().count();
        if n_present == 0 { 0.0 } else { self.present().map(|block| block.rank as f32).sum::<f32>() / n_present as f32 }
    }

    /// Greatest rank of a block.
    pub fn max_rank(&self) -> u32 {
        self.present().map(|block| block.rank).max().unwrap_or(0)
    }

    /// Errors per entry over the blocks that are there, each weighing as many entries as it has.
    pub fn mean_error(&self) -> BlockError {
        let entries = |block: &BlockFactors| f64::from(block.n_rows) * f64::from(block.n_cols);
        let total: f64 = self.present().map(entries).sum();
        let mean = |error: fn(&BlockError) -> f32| {
            let sum: f64 = self.present().map(|block| entries(block) * f64::from(error(&block.error))).sum();
            (sum / total.max(1.0)) as f32
        };
        BlockError { truncation: mean(|e| e.truncation), sampling: mean(|e| e.sampling), noise: mean(|e| e.noise) }
    }

    /// Mean square error per entry of each column over the blocks that are there, see [`BlockFactors::column_errors`]; `None` if there are
    /// none, or one does not tell.
    pub fn column_errors(&self) -> Option<Vec<f64>> {
        let (mut sums, mut n_rows) = (vec![0.0; self.n_cols as usize], 0.0);
        for block in self.present() {
            if block.column_errors.len() != sums.len() {
                return None;
            }
            let rows = f64::from(block.n_rows);
            sums.iter_mut().zip(&block.column_errors).for_each(|(sum, error)| *sum += rows * f64::from(*error));
            n_rows += rows;
        }
        (n_rows > 0.0).then(|| sums.iter().map(|sum| sum / n_rows).collect())
    }

    /// The product with a vector of one value per column: one value per row, in the order of the matrix.
    pub fn apply(&self, x: &[f32]) -> Vec<f32> {
        assert!(x.len() == self.n_cols as usize, "{} coefficients for {} columns", x.len(), self.n_cols);
        let of_block = |block: &Option<Arc<BlockFactors>>| block.as_ref().map(|block| block.apply(x));
        let products: Vec<Option<Vec<f32>>> = self.blocks.par_iter().map(of_block).collect();
        let mut out = vec![0.0; self.n_rows()];
        let (mut bundles, bundle_len) = (Vec::new(), self.bundle_len as usize);
        for (block_idx, product) in products.iter().enumerate() {
            let Some(product) = product else { continue };
            self.partition.bundles(block_idx, &mut bundles);
            for (&bundle, values) in bundles.iter().zip(product.chunks(bundle_len)) {
                out[bundle as usize * bundle_len..][..values.len()].copy_from_slice(values);
            }
        }
        out
    }

    fn present(&self) -> impl Iterator<Item = &BlockFactors> {
        self.blocks.iter().flatten().map(Arc::as_ref)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_come_in_the_order_of_the_matrix() {
        // Three by two bundles of two rows, tiles of two bundles: the second tile is one bundle wide.
        let partition = Partition { width: 3, height: 2, tile: 2 };
        let mut matrix = BlockLowRank::new(partition, 2, 1);
        assert_eq!((matrix.n_rows(), matrix.dense_bytes(), matrix.blocks.len()), (12, 48, 2));
        let rows: Vec<f32> = vec![0.0, 1.0, 2.0, 3.0, 6.0, 7.0, 8.0, 9.0];
        matrix.blocks[0] = Some(Arc::new(BlockFactors::from_f32(&rows, &[1.0], 8, 1, 1)));
        let mut second = BlockFactors::from_f32(&[4.0, 5.0, 10.0, 11.0], &[1.0], 4, 1, 1);
        second.error.noise = 3.0;
        matrix.blocks[1] = Some(Arc::new(second));
        let doubled: Vec<f32> = (0..12).map(|i| 2.0 * i as f32).collect();
        assert_eq!(matrix.apply(&[2.0]), doubled);
        assert_eq!((matrix.mean_rank(), matrix.max_rank(), matrix.mean_error().noise), (1.0, 1, 1.0));
        assert_eq!(matrix.column_errors(), None, "one block tells, the other does not");
        for (block, error) in matrix.blocks.iter_mut().flatten().zip([1.0, 4.0]) {
            Arc::make_mut(block).column_errors = vec![error];
        }
        assert_eq!(matrix.column_errors(), Some(vec![2.0]), "each counts as many rows as it has");
        matrix.blocks[0] = None;
        assert_eq!(matrix.apply(&[1.0]), [0.0, 0.0, 0.0, 0.0, 4.0, 5.0, 0.0, 0.0, 0.0, 0.0, 10.0, 11.0]);
        assert_eq!(
            BlockLowRank::new(Partition { width: 1, height: 1, tile: 4 }, 1, 1).mean_error(),
            BlockError::default()
        );
    }
}
