//! Project: `z = scale · right · x`, one RGB triple per component of a block.
//!
//! Columns come in segments. What each segment adds is kept, so that a change of one light reads the columns of its own
//! segment alone, and `z` is always the sum over all segments in their order: the same number whichever way a slider took.

use clerestory_nystrom::SparseEntry;

use super::kernel::Kernel;
use super::quad::{QUAD, Quad};
use super::store::{Share, Store, Tile};

/// Columns that are looked at together; one register of f32 where those are widest.
pub(super) const LANES: usize = 16;

/// Columns whose sum is kept. Fewer would make one light cheaper to project, but the sums of all segments are read for it, too, and
/// a new picture writes them all: of 1024 columns they take an eighth of what the factors take.
pub(super) const SEGMENT: usize = 128;

/// The coefficients of one group, channel by channel, padded with zeros to whole lanes.
pub(super) struct Planes {
    /// 3 × `stride`.
    x: Vec<f32>,
    /// Columns rounded up to whole lanes.
    stride: usize,
    /// Of each segment one bit for each of those lanes that hold any coefficient; the rest add exact zeros.
    lit: Vec<u8>,
    /// Of each segment whether any coefficient is another than before.
    changed: Vec<bool>,
    /// Columns whose coefficient is another than before; all where there was none.
    changed_cols: Vec<bool>,
}

const _: () = assert!(SEGMENT / LANES == 8, "a byte holds the lanes of a segment");

impl Planes {
    /// `before` are the coefficients that the kept sums stand for.
    pub(super) fn new(coefficients: &[[f32; 3]], before: Option<&[[f32; 3]]>) -> Self {
        let stride = coefficients.len().next_multiple_of(LANES);
        let mut x = vec![0.0; 3 * stride];
        for (col, rgb) in coefficients.iter().enumerate() {
            for channel in 0..3 {
                x[channel * stride + col] = rgb[channel];
            }
        }
        let bits = |cols: &[[f32; 3]]| {
            let lanes = cols.chunks(LANES).enumerate().filter(|(_, cols)| !super::is_dark(cols));
            lanes.fold(0u8, |bits, (lanes, _)| bits | 1 << lanes)
        };
        let lit: Vec<u8> = coefficients.chunks(SEGMENT).map(bits).collect();
        let is_other = |(col, rgb): (usize, &[f32; 3])| before.is_none_or(|before| before[col] != *rgb);
        let changed_cols: Vec<bool> = coefficients.iter().enumerate().map(is_other).collect();
        let changed = changed_cols.chunks(SEGMENT).map(|cols| cols.contains(&true)).collect();
        Self { x, stride, lit, changed, changed_cols }
    }

    /// Coefficient of a column in a channel.
    pub(super) fn at(&self, channel: usize, col: usize) -> f32 {
        self.x[channel * self.stride + col]
    }

    /// What the columns of a segment meet.
    fn segment(&self, segment: usize) -> Cols<'_> {
        let (first, last) = (segment * SEGMENT, self.stride.min((segment + 1) * SEGMENT));
        let x = std::array::from_fn(|channel| self.x[channel * self.stride..][first..last].as_chunks().0);
        Cols { x, lit: Lit(self.lit[segment]) }
    }

    /// Whether every segment changed.
    pub(super) fn are_all_changed(&self) -> bool {
        !self.changed.contains(&false)
    }

    /// Whether any of a block's sparse entries carries a coefficient that is another than before.
    pub(super) fn moves(&self, sparse: &[SparseEntry]) -> bool {
        sparse.iter().any(|entry| self.changed_cols[entry.col as usize])
    }

    /// Columns of a segment that are read.
    fn n_lit_cols(&self, segment: usize) -> usize {
        let n_cols = self.changed_cols.len() - segment * SEGMENT;
        Lit(self.lit[segment]).map(|lanes| LANES.min(n_cols - lanes * LANES)).sum()
    }
}

/// Coefficients of one segment.
pub(super) struct Cols<'a> {
    /// Red, green and blue, in whole lanes.
    pub x: [&'a [[f32; LANES]]; 3],
    /// Lanes that hold any.
    pub lit: Lit,
}

/// Numbers of the bits that are set.
#[derive(Clone, Copy)]
pub(super) struct Lit(u8);

impl Lit {
    /// Whether none is.
    pub(super) fn is_empty(self) -> bool {
        self.0 == 0
    }
}

impl Iterator for Lit {
    type Item = usize;

    #[inline(always)]
    fn next(&mut self) -> Option<usize> {
        let next = (self.0 != 0).then_some(self.0.trailing_zeros() as usize);
        self.0 &= self.0.wrapping_sub(1);
        next
    }
}

/// Whether the sums of segments are kept, so that the next change of a few columns reads no others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sums {
    Kept,
    /// They would be written for nothing where everything will change again.
    AddedUp,
}

/// Projects the segments of a row of tiles that changed, and all of tiles that are `due` and have no sums; returns the bytes of factors
/// read. Sums that are added up are left in `total`, one after the other in the order of the segments, so that they are the same to the last bit.
pub(super) fn project(
    store: &mut Store,
    kernel: Kernel,
    planes: &Planes,
    (sums_are, total): (Sums, &mut Vec<Quad>),
    is_due: impl Fn(usize, &Tile) -> bool,
) -> u64 {
    let Store { tiles, right, widths, sums, .. } = store;
    let n_components = tiles.last().map_or(Share::default(), |tile| tile.first_right.plus(tile.right));
    let n_quads = tiles.last().map_or(0, |tile| tile.quads().end);
    let due: Vec<bool> = tiles.iter().enumerate().map(|(i, tile)| !tile.is_summed && is_due(i, tile)).collect();
    if sums_are == Sums::AddedUp {
        total.clear();
        total.resize(n_quads, Quad::default());
    }
    let (mut first, mut n_bytes) = (Share::default(), 0);
    let mut room: Vec<Quad> = Vec::new();
    for (segment, width) in widths.iter().enumerate() {
        let cols = planes.segment(segment);
        for (tile, _) in tiles.iter().zip(&due).filter(|(_, due)| planes.changed[segment] || **due) {
            let (halves, bytes) = right.from(first.plus(tile.first_right.times(*width)));
            let sums = match sums_are {
                Sums::Kept => &mut sums[segment * n_quads..][tile.quads()],
                Sums::AddedUp => {
                    room.resize(tile.quads().len(), Quad::default());
                    &mut room[..]
                }
            };
            let (of_halves, of_bytes) = sums.split_at_mut(tile.right.halves.div_ceil(QUAD));
            kernel.project(halves, (tile.right.halves, *width), &cols, of_halves);
            kernel.project(bytes, (tile.right.bytes, *width), &cols, of_bytes);
            if sums_are == Sums::AddedUp {
                total[tile.quads()].iter_mut().zip(&*sums).for_each(|(total, sum)| *total = total.plus(sum));
            }
            n_bytes += tile.right.n_bytes() * planes.n_lit_cols(segment);
        }
        first = first.plus(n_components.times(*width));
    }
    for (tile, due) in tiles.iter_mut().zip(due) {
        // A tile that was not due and has no sums has still none.
        tile.is_summed = sums_are == Sums::Kept && (tile.is_summed || due);
    }
    n_bytes as u64
}
