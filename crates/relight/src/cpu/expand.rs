//! Expand: `radiance = left · z + sparse · x` over the pixels of one block.

use super::kernel::{Kernel, Left, PATTERN};
use super::left::RUN;
use super::prefetch::prefetch;
use super::project::Planes;
use super::quad::{QUAD, Quad};
use clerestory_nystrom::SparseEntry;

/// Where a tile lies in its row of tiles, in pixels.
#[derive(Clone, Copy)]
pub(super) struct Place {
    pub x: usize,
    pub width: usize,
    pub height: usize,
    /// Pixels from one row to the next.
    pub stride: usize,
}

/// What becomes of what a pixel was before.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Write {
    Set,
    Add,
}

/// One block as expand reads it; without components and sparse entries it is black.
pub(super) struct Source<'a> {
    pub left: Left<'a>,
    pub z: &'a [Quad],
    pub sparse: &'a [SparseEntry],
    pub planes: &'a Planes,
}

/// Room that blocks use one after the other.
#[derive(Default)]
pub(super) struct Scratch {
    /// One per component: `z` as rows meet it.
    patterns: Vec<[f32; PATTERN]>,
    /// Rows of the block, rounded up to whole runs.
    rows: Vec<f32>,
}

impl Scratch {
    /// Writes the pixels of one block into its row of tiles; returns the bytes of factors read.
    pub(super) fn expand(
        &mut self,
        kernel: Kernel,
        source: &Source,
        (place, write): (Place, Write),
        row: &mut [[f32; 3]],
    ) -> u64 {
        let n_rows = 3 * place.width * place.height;
        let is_lit = source.z.iter().any(|z| *z != Quad::default());
        if !is_lit && source.sparse.is_empty() && write == Write::Add {
            return 0;
        }
        // The pixels of the next tile are written next, and memory reads a line before it is written.
        let ends = (0..place.height).map(|y| y * place.stride + place.x + place.width);
        ends.filter_map(|end| row.get(end..end + place.width)).for_each(prefetch);
        self.rows.resize(n_rows.next_multiple_of(RUN), 0.0);
        if is_lit {
            let pattern = |k: usize| pattern(source.z[k / QUAD].rgb(k % QUAD));
            self.patterns.clear();
            self.patterns.extend((0..source.left.n.all()).map(pattern));
            kernel.expand(&source.left, &self.patterns, &mut self.rows);
        } else {
            self.rows.fill(0.0);
        }
        for entry in source.sparse {
            self.rows[entry.row as usize] += entry.value * source.planes.at(entry.row as usize % 3, entry.col as usize);
        }

        for (y, from) in self.rows[..n_rows].chunks_exact(3 * place.width).enumerate() {
            let to = row[y * place.stride + place.x..][..place.width].as_flattened_mut();
            match write {
                Write::Set => to.copy_from_slice(from),
                Write::Add => to.iter_mut().zip(from).for_each(|(to, from)| *to += from),
            }
        }
        let n_left = if is_lit { n_rows * source.left.n.n_bytes() } else { 0 };
        (n_left + size_of_val(source.sparse)) as u64
    }
}

fn pattern(rgb: [f32; 3]) -> [f32; PATTERN] {
    std::array::from_fn(|row| rgb[row % 3])
}
