//! Products with a packed matrix in the cosines it is stored in: right factors are mostly zeros there.
//!
//! The vector is transformed once, `⟨r, x⟩ = ⟨C r, C x⟩` for orthonormal C; each component then multiplies as many coefficients
//! as rounding has left of it, however many columns there are. Left factors are those of [`PackedMatrix::unpack`].

use std::sync::Arc;

use rayon::prelude::*;

use super::{PackedMatrix, layout::Layout, quantize::step_of_right};
use crate::{codec::CodecError, cosine::Direction, matrix::SparseEntry};

/// A packed matrix that is ready to be multiplied with.
#[derive(Clone, Debug)]
pub struct PackedProduct {
    layout: Layout,
    direction: Vec<f32>,
    blocks: Vec<Option<BlockProduct>>,
}

#[derive(Clone, Debug)]
struct BlockProduct {
    /// Row-major, rows × rank; the last column belongs to the kept direction where `right` has one component less.
    left: Vec<f32>,
    rank: usize,
    /// Of each component the coefficients that are not zero, and where they are.
    right: Vec<Vec<(u32, f32)>>,
    sparse: Vec<SparseEntry>,
}

impl PackedMatrix {
    /// Reads all blocks for products.
    ///
    /// # Errors
    /// Bytes that no packer wrote.
    pub fn product(&self) -> Result<PackedProduct, CodecError> {
        let block = |(block_idx, bytes): (usize, &Arc<[u8]>)| {
            if bytes.is_empty() {
                return Ok(None);
            }
            let parts = self.read_block(block_idx, bytes);
            let parts = parts.ok_or(CodecError::Malformed("the coefficients of a block"))?;
            let right = parts.components.iter().map(|component| {
                let step = step_of_right(component.size);
                let coefficients = (0u32..).zip(&component.right).filter(|(_, q)| **q != 0);
                coefficients.map(|(at, &q)| (at, q as f32 * step)).collect()
            });
            let right = right.collect();
            Ok(Some(BlockProduct { left: parts.plain.left, rank: parts.plain.rank, right, sparse: parts.sparse }))
        };
        let blocks = self.blocks.par_iter().enumerate().map(block).collect::<Result<_, _>>()?;
        Ok(PackedProduct { layout: self.layout.clone(), direction: self.direction.clone(), blocks })
    }
}

impl PackedProduct {
    /// The product with a vector of one value per column: one value per row, in the order of the matrix.
    #[expect(clippy::arithmetic_side_effects, reason = "`Layout::is_sound` holds of everything that is read")]
    pub fn apply(&self, x: &[f32]) -> Vec<f32> {
        assert!(x.len() == self.layout.n_cols(), "{} values for {} columns", x.len(), self.layout.n_cols());
        let mut coefficients = x.to_vec();
        self.layout.columns(&mut coefficients, Direction::Forward);
        let along: f32 = self.direction.iter().zip(x).map(|(p, x)| p * x).sum();
        let of_block = |(block_idx, block): (usize, &Option<BlockProduct>)| {
            let mut out = vec![0.0; self.layout.n_rows(block_idx)];
            block.as_ref()?.apply(x, &coefficients, along, &mut out);
            Some(out)
        };
        let products: Vec<Option<Vec<f32>>> = self.blocks.par_iter().enumerate().map(of_block).collect();
        let (mut bundles, len) = (Vec::new(), self.layout.bundle_len as usize);
        let partition = &self.layout.partition;
        let mut out = vec![0.0; partition.width as usize * partition.height as usize * len];
        for (block_idx, product) in products.iter().enumerate() {
            let Some(product) = product else { continue };
            partition.bundles(block_idx, &mut bundles);
            for (&bundle, values) in bundles.iter().zip(product.chunks(len)) {
                out[bundle as usize * len..][..len].copy_from_slice(values);
            }
        }
        out
    }

    /// Multiplications of one product with right and with left factors; those for the transform of the vector and for its
    /// part along the kept direction, once for all blocks, are left out, and so are sparse entries.
    pub fn n_multiplications(&self) -> [usize; 2] {
        let blocks = || self.blocks.iter().flatten();
        let right = blocks().flat_map(|block| &block.right).map(Vec::len).sum();
        [right, blocks().map(|block| block.left.len()).sum()]
    }
}

impl BlockProduct {
    fn apply(&self, x: &[f32], coefficients: &[f32], along: f32, out: &mut [f32]) {
        let inner = |component: &Vec<(u32, f32)>| component.iter().map(|&(at, r)| r * coefficients[at as usize]).sum();
        let mut inner: Vec<f32> = self.right.iter().map(inner).collect();
        inner.resize(self.rank, along);
        for (out, left) in out.iter_mut().zip(self.left.chunks_exact(self.rank.max(1))) {
            *out = left.iter().zip(&inner).map(|(left, inner)| left * inner).sum();
        }
        for entry in &self.sparse {
            out[entry.row as usize] += entry.value * x[entry.col as usize];
        }
    }
}
