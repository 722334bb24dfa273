//! Expand: `radiance = left · z + sparse · x` over the pixels of one block.

use clerestory_nystrom::BlockFactors;

use super::kernel::Kernel;
use super::project::Planes;

/// Where a tile lies in its row of tiles, in pixels.
#[derive(Clone, Copy)]
pub(super) struct Place {
    pub x: usize,
    pub width: usize,
    pub height: usize,
    /// Pixels from one row to the next.
    pub stride: usize,
}

/// Writes the pixels of one block into its row of tiles; returns the bytes of factors read. A missing block is black.
pub(super) fn expand_block(
    kernel: Kernel,
    factors: Option<&BlockFactors>,
    z: &[f32],
    planes: &Planes,
    place: Place,
    row: &mut [[f32; 3]],
) -> u64 {
    let lit = factors.filter(|_| z.iter().any(|v| *v != 0.0));
    for y in 0..place.height {
        let first = y * place.stride + place.x;
        let pixels = &mut row[first..first + place.width];
        match lit {
            Some(f) => kernel.expand(&f.left[3 * y * place.width * f.rank as usize..], f.rank as usize, z, pixels),
            None => pixels.fill([0.0; 3]),
        }
    }
    for entry in factors.map_or(&[][..], |f| &f.sparse) {
        let (pixel, channel) = (entry.row as usize / 3, entry.row as usize % 3);
        let at = pixel / place.width * place.stride + place.x + pixel % place.width;
        row[at][channel] += entry.value * planes.at(channel, entry.col as usize);
    }
    let n_sparse = factors.map_or(0, |f| f.sparse.len());
    (2 * lit.map_or(0, |f| f.left.len()) + 12 * n_sparse) as u64
}
