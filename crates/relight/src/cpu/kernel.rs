//! The two inner products: plain, for AVX2 with F16C, for AVX-512, and for NEON.
//!
//! Left and right factors are read once per picture, so the work is converting f16 at the speed of memory.
#![cfg_attr(
    any(target_arch = "x86_64", target_arch = "aarch64"),
    expect(unsafe_code, reason = "calls of functions compiled for what was detected; `plain` is the safe twin")
)]

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
#[cfg(target_arch = "aarch64")]
mod neon;
mod plain;

use half::f16;

use super::left::RUN;
use super::prefetch::prefetch;
use super::project::{LANES, Lit, Planes, SEGMENT};
use super::quad::{QUAD, Quad};

/// Floats of one component of `z` as the rows of a run meet it: red, green, blue, red, … as far as the vectors of AVX-512
/// reach that start at the three places where a vector may start.
pub(super) const PATTERN: usize = 32;

/// Which instructions the inner products use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kernel {
    /// Portable.
    Plain,
    /// AVX2, FMA and F16C; made only by [`Kernel::all`].
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// AVX-512F; made only by [`Kernel::all`].
    #[cfg(target_arch = "x86_64")]
    Avx512,
    /// NEON, which every Arm of 64 bits has; made only by [`Kernel::all`].
    #[cfg(target_arch = "aarch64")]
    Neon,
}

/// Halves between what is multiplied and what is asked for.
const AHEAD: usize = 8192;

/// A factor of a block, and that of the block which comes next.
#[derive(Clone, Copy)]
pub(super) struct Stream<'a> {
    pub halves: &'a [f16],
    pub next: &'a [f16],
}

impl Stream<'_> {
    /// Asks for some halves of this factor, or of the next where they lie behind.
    fn ask(&self, first: usize, len: usize) {
        let (from, first) = match first.checked_sub(self.halves.len()) {
            None => (self.halves, first),
            Some(first) => (self.next, first),
        };
        if let Some(halves) = from.get(first..from.len().min(first + len)) {
            prefetch(halves);
        }
    }
}

/// Up to four rows of a right factor.
#[derive(Clone, Copy)]
struct Rows<'a> {
    halves: &'a [f16],
    n_cols: usize,
}

/// Up to four components of a right factor over one segment, and what they meet there.
struct Segment<'a, const N: usize> {
    /// The halves of each component, in whole lanes.
    right: [&'a [[f16; LANES]]; N],
    /// Red, green and blue coefficients in the same lanes.
    x: [&'a [[f32; LANES]]; 3],
    /// Lanes that hold any coefficient.
    lit: Lit,
}

impl Kernel {
    /// The fastest that this machine runs.
    pub(super) fn detect() -> Self {
        Self::all().last().copied().unwrap_or(Self::Plain)
    }

    /// Those that this machine runs, the fastest last.
    pub(super) fn all() -> Vec<Self> {
        let mut all = vec![Self::Plain];
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") && is_x86_feature_detected!("f16c") {
                all.push(Self::Avx2);
            }
            if is_x86_feature_detected!("avx512f") {
                all.push(Self::Avx512);
            }
        }
        #[cfg(target_arch = "aarch64")]
        if std::arch::is_aarch64_feature_detected!("neon") {
            all.push(Self::Neon);
        }
        all
    }

    /// Sum over the columns of each of `segments` of `right[component][col] · x[channel][col]`: `put` takes quad, segment
    /// and the sums. `right` is row-major, components × columns. Without columns there is nothing to put.
    pub(super) fn project(
        self,
        (right, n_cols): (Stream, usize),
        planes: &Planes,
        segments: &[usize],
        mut put: impl FnMut(usize, usize, Quad),
    ) {
        if n_cols == 0 {
            return;
        }
        // All of it is asked for as far ahead as memory takes to answer; of one segment, that of the next block.
        let is_whole = segments.len() == n_cols.div_ceil(SEGMENT);
        let distance = if is_whole { right.halves.len().min(AHEAD) } else { right.halves.len() };
        for (quad, rows) in right.halves.chunks(QUAD * n_cols).enumerate() {
            let first = quad * QUAD * n_cols;
            let rows = Rows { halves: rows, n_cols };
            let ahead = |at: usize, len: usize| right.ask(first + at + distance, len);
            let put = |segment, sums| put(quad, segment, sums);
            match rows.halves.len() / rows.n_cols {
                1 => self.project_rows::<1>(rows, planes, segments, ahead, put),
                2 => self.project_rows::<2>(rows, planes, segments, ahead, put),
                3 => self.project_rows::<3>(rows, planes, segments, ahead, put),
                _ => self.project_rows::<4>(rows, planes, segments, ahead, put),
            }
        }
    }

    fn project_rows<const N: usize>(
        self,
        rows: Rows,
        planes: &Planes,
        segments: &[usize],
        ahead: impl Fn(usize, usize),
        mut put: impl FnMut(usize, Quad),
    ) {
        for &segment in segments {
            let (x, lit) = (planes.segment(segment), planes.lit(segment));
            let first = segment * SEGMENT;
            let n_cols = SEGMENT.min(rows.n_cols - first);
            let cols: [&[f16]; N] = std::array::from_fn(|k| &rows.halves[k * rows.n_cols + first..][..n_cols]);
            (0..N).for_each(|k| ahead(k * rows.n_cols + first, n_cols));
            let sums = if n_cols.is_multiple_of(LANES) {
                self.project_segment(&Segment { right: cols.map(|cols| cols.as_chunks().0), x, lit })
            } else {
                // The last columns of a row do not fill their lanes, and nothing is read behind them.
                let padded = cols.map(padded);
                self.project_segment(&Segment { right: padded.each_ref().map(|cols| cols.as_chunks().0), x, lit })
            };
            put(segment, sums);
        }
    }

    #[inline(always)]
    fn project_segment<const N: usize>(self, segment: &Segment<N>) -> Quad {
        match self {
            Self::Plain => plain::project(segment),
            // SAFETY: this and the next variants exist only where `all` found the features.
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => unsafe { avx2::project(segment) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => unsafe { avx512::project(segment) },
            // SAFETY: as above.
            #[cfg(target_arch = "aarch64")]
            Self::Neon => unsafe { neon::project(segment) },
        }
    }

    /// `out[row] = Σ left[row][k] · z[k][row % 3]`. `left` is runs × rank × [`RUN`], `patterns` one per component, `out` as
    /// long as the runs together; without components it is all zeros.
    pub(super) fn expand(self, left: &[f16], patterns: &[[f32; PATTERN]], out: &mut [f32]) {
        let rank = patterns.len();
        assert!(
            left.len() == out.len() * rank && out.len().is_multiple_of(RUN),
            "left factors of rank {rank} fit the rows"
        );
        if rank == 0 {
            return out.fill(0.0);
        }
        match self {
            Self::Plain => plain::expand(left, patterns, out),
            // SAFETY: as in `project_segment`.
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => unsafe { avx2::expand(left, patterns, out) },
            // SAFETY: as in `project_segment`.
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => unsafe { avx512::expand(left, patterns, out) },
            // SAFETY: as in `project_segment`.
            #[cfg(target_arch = "aarch64")]
            Self::Neon => unsafe { neon::expand(left, patterns, out) },
        }
    }
}

fn padded(cols: &[f16]) -> [f16; SEGMENT] {
    let mut padded = [f16::ZERO; SEGMENT];
    padded[..cols.len()].copy_from_slice(cols);
    padded
}
