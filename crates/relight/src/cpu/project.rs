//! Project: `z = scale · right · x`, one RGB triple per component of a block.
//!
//! Columns come in segments. What each segment adds is kept, so that a change of one light reads the columns of its own
//! segment alone, and `z` is always the sum over all segments in their order: the same number whichever way a slider took.

use clerestory_nystrom::BlockFactors;

use super::kernel::Kernel;

/// Columns that are looked at together; one vector register of f32.
pub(super) const LANES: usize = 8;

/// Columns whose sum is kept. A row of a right factor spans two cache lines over them, and fewer would be fetched anyway.
pub(super) const SEGMENT: usize = 64;

/// The coefficients of one group, channel by channel, padded with zeros to whole lanes.
pub(super) struct Planes {
    /// 3 × `stride`.
    pub x: Vec<f32>,
    /// Columns rounded up to whole lanes.
    pub stride: usize,
    /// Of each segment the first columns of those lanes that hold any coefficient; the rest add exact zeros.
    active: Vec<Vec<usize>>,
    /// Segments to project again where their sums are kept.
    changed: Vec<usize>,
    /// Columns whose coefficient is another than before; all where there was none.
    changed_cols: Vec<bool>,
}

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
        let lit = |col: &usize| !super::is_dark(&coefficients[*col..coefficients.len().min(col + LANES)]);
        let lanes = |start| (start..stride.min(start + SEGMENT)).step_by(LANES).filter(lit).collect();
        let active: Vec<Vec<usize>> = (0..stride).step_by(SEGMENT).map(lanes).collect();
        let is_other = |(col, rgb): (usize, &[f32; 3])| before.is_none_or(|before| before[col] != *rgb);
        let changed_cols: Vec<bool> = coefficients.iter().enumerate().map(is_other).collect();
        let segments = changed_cols.chunks(SEGMENT).enumerate();
        let changed = segments.filter(|(_, cols)| cols.contains(&true)).map(|(segment, _)| segment).collect();
        Self { x, stride, active, changed, changed_cols }
    }

    /// Coefficient of a column in a channel.
    pub(super) fn at(&self, channel: usize, col: usize) -> f32 {
        self.x[channel * self.stride + col]
    }

    /// First columns of the lanes of a segment that hold any coefficient.
    pub(super) fn active(&self, segment: usize) -> &[usize] {
        &self.active[segment]
    }

    /// Whether any of the block's sparse entries carries a coefficient that is another than before.
    pub(super) fn moves_sparse(&self, factors: Option<&BlockFactors>) -> bool {
        factors.is_some_and(|f| f.sparse.iter().any(|entry| self.changed_cols[entry.col as usize]))
    }
}

/// What the segments of a block's columns add to `z`, kept from one relight to the next.
#[derive(Clone, Debug, Default)]
pub(super) struct Partials {
    /// Segments × 3 × rank rounded up to whole lanes, without `scale`; empty where nothing is kept.
    sums: Vec<f32>,
}

impl Partials {
    /// Fills `z` with 3 × rank (rank rounded up to whole lanes, padded with zeros), channel by channel; returns the bytes
    /// of factors read. A missing block has rank 0.
    pub(super) fn project(
        &mut self,
        kernel: Kernel,
        factors: Option<&BlockFactors>,
        planes: &Planes,
        z: &mut Vec<f32>,
    ) -> u64 {
        z.clear();
        let Some(factors) = factors else { return 0 };
        let (rank, n_segments) = (factors.rank as usize, planes.active.len());
        let stride = rank.next_multiple_of(LANES);
        z.resize(3 * stride, 0.0);
        if rank == 0 || n_segments == 0 {
            return 0;
        }
        let all: Vec<usize>;
        let segments = if self.sums.len() == n_segments * 3 * stride && n_segments > 1 {
            &planes.changed
        } else {
            self.sums.clear();
            self.sums.resize(n_segments * 3 * stride, 0.0);
            all = (0..n_segments).collect();
            &all
        };
        let sums = &mut self.sums;
        kernel.project(&factors.right, factors.n_cols as usize, planes, segments, |component, segment, values| {
            for channel in 0..3 {
                sums[(3 * segment + channel) * stride + component] = values[channel];
            }
        });

        // In the order of the segments, whatever was projected just now.
        for sums in sums.chunks_exact(3 * stride) {
            z.iter_mut().zip(sums).for_each(|(z, sum)| *z += sum);
        }
        for z in z.chunks_exact_mut(stride) {
            z.iter_mut().zip(&factors.scale).for_each(|(z, scale)| *z *= scale);
        }
        let n_lanes: usize = segments.iter().map(|segment| planes.active(*segment).len()).sum();
        (rank * n_lanes * LANES.min(factors.n_cols as usize) * 2) as u64
    }
}
