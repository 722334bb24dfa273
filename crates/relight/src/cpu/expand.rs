//! Expand: `radiance = left · z + sparse · x` over the pixels of one block.

use clerestory_nystrom::BlockFactors;

use super::kernel::{Kernel, PATTERN};
use super::left::{Left, RUN};
use super::project::{LANES, Planes};

/// Where a tile lies in its row of tiles, in pixels.
#[derive(Clone, Copy)]
pub(super) struct Place {
    pub x: usize,
    pub width: usize,
    pub height: usize,
    /// Pixels from one row to the next.
    pub stride: usize,
}

/// Room that blocks use one after the other.
#[derive(Default)]
pub(super) struct Scratch {
    /// Rank × [`PATTERN`]: `z` of one component as rows meet it.
    patterns: Vec<f32>,
    /// Rows of the block, rounded up to whole runs.
    rows: Vec<f32>,
}

/// Writes the pixels of one block into its row of tiles; returns the bytes of factors read. A missing block is black.
/// `left` are the left factors of the block, where it has any.
pub(super) fn expand_block(
    kernel: Kernel,
    (factors, left): (Option<&BlockFactors>, Option<&Left>),
    z: &[f32],
    planes: &Planes,
    place: Place,
    scratch: &mut Scratch,
    row: &mut [[f32; 3]],
) -> u64 {
    let lit = left.filter(|_| z.iter().any(|v| *v != 0.0));
    if let Some(left) = lit {
        scratch.expand(kernel, left, z);
    }
    for y in 0..place.height {
        let first = y * place.stride + place.x;
        let pixels = &mut row[first..first + place.width];
        match lit {
            Some(_) => {
                pixels.as_flattened_mut().copy_from_slice(&scratch.rows[3 * y * place.width..][..3 * place.width])
            }
            None => pixels.fill([0.0; 3]),
        }
    }
    for entry in factors.map_or(&[][..], |f| &f.sparse) {
        let (pixel, channel) = (entry.row as usize / 3, entry.row as usize % 3);
        let at = pixel / place.width * place.stride + place.x + pixel % place.width;
        row[at][channel] += entry.value * planes.at(channel, entry.col as usize);
    }
    let n_sparse = factors.map_or(0, |f| f.sparse.len());
    (2 * lit.map_or(0, |left| left.n_rows * left.rank) + 12 * n_sparse) as u64
}

impl Scratch {
    /// `rows = left · z`.
    fn expand(&mut self, kernel: Kernel, left: &Left, z: &[f32]) {
        let stride = left.rank.next_multiple_of(LANES);
        self.patterns.clear();
        for k in 0..left.rank {
            let rgb = [z[k], z[stride + k], z[2 * stride + k]];
            self.patterns.extend_from_slice(&std::array::from_fn::<f32, PATTERN, _>(|row| rgb[row % 3]));
        }
        self.rows.resize(left.n_rows.next_multiple_of(RUN), 0.0);
        kernel.expand(&left.halves, &self.patterns, &mut self.rows);
    }
}
