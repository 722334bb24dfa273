//! The two inner products: plain, for AVX2 with F16C, for AVX-512, and for NEON.
//!
//! Left and right factors are read once per picture, so the work is converting f16 and bytes at the speed of memory.
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

use super::expand::Write;
use super::left::RUN;
use super::prefetch::prefetch;
use super::project::{Cols, LANES, SEGMENT};
use super::quad::{QUAD, Quad};
use super::store::Share;

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

/// Bytes from what is projected to what memory is asked for meanwhile, line by line: what was fastest of 2 to 64 KB.
const PROJECT_AHEAD: usize = 2 << 10;

/// The same for what is expanded.
const EXPAND_AHEAD: usize = 4 << 10;

/// Entries that are expanded, and asked for, in one go; at least one run.
const EXPAND_LEN: usize = 1024;

/// Up to four components of a right factor over one segment: lanes after lanes, of each all components.
type Rows<'a, T, const N: usize> = &'a [[[T; LANES]; N]];

fn rows<T, const N: usize>(entries: &[T]) -> Rows<'_, T, N> {
    entries.as_chunks().0.as_chunks().0
}

/// What factors are made of: halves, or bytes whose steps are in the scales.
#[cfg(target_arch = "x86_64")]
pub(super) trait Entry: plain::Convert + avx2::Load + avx512::Load {}
/// What factors are made of: halves, or bytes whose steps are in the scales.
#[cfg(target_arch = "aarch64")]
pub(super) trait Entry: plain::Convert + neon::Load {}
/// What factors are made of: halves, or bytes whose steps are in the scales.
#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
pub(super) trait Entry: plain::Convert {}

impl Entry for f16 {}
impl Entry for i8 {}

/// The left factor of a block.
#[derive(Clone, Copy)]
pub(super) struct Left<'a> {
    /// Begin with the block's runs × components × [`RUN`]; what comes behind is read next.
    pub factors: (&'a [f16], &'a [i8]),
    /// Components of both kinds; those that are halves come first.
    pub n: Share,
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

    /// Sums over the columns of one segment of `right[component][col] · x[channel][col]`, quad by quad. `right` begins with
    /// the segment of the block, quad after quad, lanes after lanes; what comes behind is read next.
    pub(super) fn project<T: Entry>(
        self,
        right: &[T],
        (n_components, n_cols): (usize, usize),
        cols: &Cols,
        sums: &mut [Quad],
    ) {
        if cols.lit.is_empty() {
            return sums.fill(Quad::default());
        }
        let len = QUAD * n_cols;
        for (quad, (entries, sums)) in right[..n_components * n_cols].chunks(len).zip(sums).enumerate() {
            let later = behind(right, quad * len + PROJECT_AHEAD / size_of::<T>(), entries.len());
            *sums = match entries.len() / n_cols {
                1 => self.project_rows::<T, 1>(rows(entries), rows(later), cols),
                2 => self.project_rows::<T, 2>(rows(entries), rows(later), cols),
                3 => self.project_rows::<T, 3>(rows(entries), rows(later), cols),
                _ => self.project_rows::<T, QUAD>(rows(entries), rows(later), cols),
            };
        }
    }

    #[inline(always)]
    fn project_rows<T: Entry, const N: usize>(self, rows: Rows<T, N>, later: Rows<T, N>, cols: &Cols) -> Quad {
        match self {
            Self::Plain => plain::project(rows, later, cols),
            // SAFETY: this and the next variants exist only where `all` found the features.
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => unsafe { avx2::project(rows, later, cols) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => unsafe { avx512::project(rows, later, cols) },
            // SAFETY: as above.
            #[cfg(target_arch = "aarch64")]
            Self::Neon => unsafe { neon::project(rows, later, cols) },
        }
    }

    /// `out[row] = Σ left[row][k] · z[k][row % 3]`. `patterns` are one per component, `out` is as long as the block's runs together.
    /// Without components it is all zeros.
    pub(super) fn expand(self, left: &Left<'_>, patterns: &[[f32; PATTERN]], out: &mut [f32]) {
        let ((halves, bytes), n) = (left.factors, left.n);
        let all = n.times(out.len());
        assert!(
            halves.len() >= all.halves && bytes.len() >= all.bytes && out.len().is_multiple_of(RUN),
            "left factors of {n:?} components fit the rows"
        );
        let rank = n.all();
        if rank == 0 {
            return out.fill(0.0);
        }
        let (of_halves, of_bytes) = patterns.split_at(n.halves);
        let n_rows = RUN * (EXPAND_LEN / (RUN * rank)).max(1);
        for (i, out) in out.chunks_mut(n_rows).enumerate() {
            self.expand_part(halves, i * n_rows, of_halves, (Write::Set, out));
            let write = if of_halves.is_empty() { Write::Set } else { Write::Add };
            self.expand_part(bytes, i * n_rows, of_bytes, (write, out));
        }
    }

    /// Those components of some rows, from `first_row` on, that are of one kind.
    #[inline(always)]
    fn expand_part<T: Entry>(
        self,
        left: &[T],
        first_row: usize,
        patterns: &[[f32; PATTERN]],
        (write, out): (Write, &mut [f32]),
    ) {
        if !patterns.is_empty() {
            let (first, len) = (first_row * patterns.len(), out.len() * patterns.len());
            self.expand_runs(
                &left[first..first + len],
                behind(left, first + EXPAND_AHEAD / size_of::<T>(), len),
                patterns,
                (write, out),
            );
        }
    }

    #[inline(always)]
    fn expand_runs<T: Entry>(self, left: &[T], later: &[T], patterns: &[[f32; PATTERN]], out: (Write, &mut [f32])) {
        match self {
            Self::Plain => plain::expand(left, later, patterns, out),
            // SAFETY: as in `project_rows`.
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => unsafe { avx2::expand(left, later, patterns, out) },
            // SAFETY: as in `project_rows`.
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => unsafe { avx512::expand(left, later, patterns, out) },
            // SAFETY: as in `project_rows`.
            #[cfg(target_arch = "aarch64")]
            Self::Neon => unsafe { neon::expand(left, later, patterns, out) },
        }
    }
}

/// So many entries from a place on, fewer where the stream ends.
fn behind<T>(stream: &[T], first: usize, len: usize) -> &[T] {
    let first = stream.len().min(first);
    &stream[first..stream.len().min(first + len)]
}
