//! Project: `z = scale · right · x`, one RGB triple per component of a block.
//!
//! Columns come in segments. What each segment adds is kept, so that a change of one light reads the columns of its own
//! segment alone, and `z` is always the sum over all segments in their order: the same number whichever way a slider took.

use clerestory_nystrom::BlockFactors;

use super::kernel::{Kernel, Stream};
use super::quad::{QUAD, Quad};

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
    /// All segments.
    all: Vec<usize>,
    /// Segments to project again where their sums are kept.
    changed: Vec<usize>,
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
        let segments = changed_cols.chunks(SEGMENT).enumerate();
        let changed = segments.filter(|(_, cols)| cols.contains(&true)).map(|(segment, _)| segment).collect();
        Self { x, stride, all: (0..lit.len()).collect(), lit, changed, changed_cols }
    }

    /// Coefficient of a column in a channel.
    pub(super) fn at(&self, channel: usize, col: usize) -> f32 {
        self.x[channel * self.stride + col]
    }

    /// Coefficients of a segment, channel by channel, in whole lanes.
    #[inline]
    pub(super) fn segment(&self, segment: usize) -> [&[[f32; LANES]]; 3] {
        let (first, last) = (segment * SEGMENT, self.stride.min((segment + 1) * SEGMENT));
        std::array::from_fn(|channel| self.x[channel * self.stride..][first..last].as_chunks().0)
    }

    /// Which lanes of a segment hold any coefficient, from the first up.
    #[inline]
    pub(super) fn lit(&self, segment: usize) -> Lit {
        Lit(self.lit[segment])
    }

    /// Whether any of the block's sparse entries carries a coefficient that is another than before.
    pub(super) fn moves_sparse(&self, factors: Option<&BlockFactors>) -> bool {
        factors.is_some_and(|f| f.sparse.iter().any(|entry| self.changed_cols[entry.col as usize]))
    }

    /// Columns of a segment that are read.
    fn n_lit_cols(&self, segment: usize) -> usize {
        let n_cols = self.changed_cols.len() - segment * SEGMENT;
        self.lit(segment).map(|lanes| LANES.min(n_cols - lanes * LANES)).sum()
    }
}

/// Numbers of the bits that are set.
#[derive(Clone, Copy)]
pub(super) struct Lit(u8);

impl Iterator for Lit {
    type Item = usize;

    #[inline(always)]
    fn next(&mut self) -> Option<usize> {
        let next = (self.0 != 0).then_some(self.0.trailing_zeros() as usize);
        self.0 &= self.0.wrapping_sub(1);
        next
    }
}

/// What the segments of a block's columns add to `z`, kept from one relight to the next.
#[derive(Clone, Debug, Default)]
pub(super) struct Partials {
    /// Segments × quads, without `scale`; empty where nothing is kept.
    sums: Vec<Quad>,
}

impl Partials {
    /// Appends the block's `z` to `z`, rank rounded up to whole quads; returns the bytes of factors read. A missing block has
    /// rank 0. `next` is the block that comes next.
    pub(super) fn project(
        &mut self,
        kernel: Kernel,
        (factors, next): (Option<&BlockFactors>, Option<&BlockFactors>),
        planes: &Planes,
        z: &mut Vec<Quad>,
    ) -> u64 {
        let Some(factors) = factors else { return 0 };
        let (rank, n_segments) = (factors.rank as usize, planes.all.len());
        let n_quads = rank.div_ceil(QUAD);
        let first = z.len();
        z.resize(first + n_quads, Quad::default());
        if rank == 0 || n_segments == 0 {
            return 0;
        }
        let z = &mut z[first..];
        let next = next.map_or(&[][..], |next| &next.right);
        let right = (Stream { halves: &factors.right, next }, factors.n_cols as usize);
        let segments = if n_segments == 1 {
            // The sum is one segment, which is projected whenever anything changed.
            kernel.project(right, planes, &planes.all, |quad, _, sums| z[quad] = sums);
            &planes.all
        } else {
            let is_kept = self.sums.len() == n_segments * n_quads;
            let segments = if is_kept { &planes.changed } else { &planes.all };
            self.sums.resize(n_segments * n_quads, Quad::default());
            let sums = &mut self.sums;
            kernel.project(right, planes, segments, |quad, segment, values| sums[segment * n_quads + quad] = values);

            // In the order of the segments, whatever was projected just now.
            for sums in sums.chunks_exact(n_quads) {
                z.iter_mut().zip(sums).for_each(|(z, sum)| *z = z.plus(sum));
            }
            segments
        };
        for (z, scale) in z.iter_mut().zip(factors.scale.chunks(QUAD)) {
            *z = z.times(&Quad::from_rgb(std::array::from_fn(|k| [scale.get(k).copied().unwrap_or(0.0); 3])));
        }
        let n_cols: usize = segments.iter().map(|segment| planes.n_lit_cols(*segment)).sum();
        (2 * rank * n_cols) as u64
    }
}
