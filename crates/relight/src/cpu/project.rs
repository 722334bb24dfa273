//! Project: `z = scale · right · x`, one RGB triple per component of a block.

use clerestory_nystrom::BlockFactors;

use super::kernel::Kernel;

/// Columns that are looked at together; one vector register of f32.
pub(super) const LANES: usize = 8;

/// The coefficients of one group, channel by channel, padded with zeros to whole lanes.
pub(super) struct Planes {
    /// 3 × `stride`.
    pub x: Vec<f32>,
    /// Columns rounded up to whole lanes.
    pub stride: usize,
    /// First columns of those lanes that hold any coefficient; the rest add exact zeros and are left out.
    pub active: Vec<usize>,
}

impl Planes {
    pub(super) fn new(coefficients: &[[f32; 3]]) -> Self {
        let stride = coefficients.len().next_multiple_of(LANES);
        let mut x = vec![0.0; 3 * stride];
        for (col, rgb) in coefficients.iter().enumerate() {
            for channel in 0..3 {
                x[channel * stride + col] = rgb[channel];
            }
        }
        let lit = |col: &usize| !super::is_dark(&coefficients[*col..coefficients.len().min(col + LANES)]);
        Self { x, stride, active: (0..stride).step_by(LANES).filter(lit).collect() }
    }

    /// Coefficient of a column in a channel.
    pub(super) fn at(&self, channel: usize, col: usize) -> f32 {
        self.x[channel * self.stride + col]
    }
}

/// Fills `z` with 3 × rank (rank rounded up to whole lanes, padded with zeros), channel by channel; returns the bytes
/// of factors read. A missing block has rank 0.
pub(super) fn project_block(kernel: Kernel, factors: Option<&BlockFactors>, planes: &Planes, z: &mut Vec<f32>) -> u64 {
    z.clear();
    let Some(factors) = factors else { return 0 };
    let rank = factors.rank as usize;
    let stride = rank.next_multiple_of(LANES);
    z.resize(3 * stride, 0.0);
    kernel.project(&factors.right, factors.n_cols as usize, planes, |component, sums| {
        for channel in 0..3 {
            z[channel * stride + component] = factors.scale[component] * sums[channel];
        }
    });
    (rank * planes.active.len() * LANES.min(factors.n_cols as usize) * 2) as u64
}
