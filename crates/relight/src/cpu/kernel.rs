//! The two inner products, plain, for AVX2 with F16C and for AVX-512.
//!
//! Left and right factors are read once per picture, so the work is converting f16 at the speed of memory.
#![cfg_attr(
    target_arch = "x86_64",
    expect(unsafe_code, reason = "f16 conversion and FMA behind run-time detection; `plain` is the safe twin")
)]

use half::{f16, slice::HalfFloatSliceExt};

use super::left::RUN;
use super::project::{LANES, Planes};

/// Floats of one component of `z` as the rows of a run meet it: red, green, blue, red, … as far as the vectors of AVX-512
/// reach that start at the three places where a vector may start.
pub(super) const PATTERN: usize = 32;

/// Which instructions the inner products use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kernel {
    /// Portable.
    Plain,
    /// AVX2, FMA and F16C; made only by [`Kernel::detect`].
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// The same and AVX-512F, which expand uses; made only by [`Kernel::detect`].
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl Kernel {
    /// The fastest that this machine runs.
    pub(super) fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") && is_x86_feature_detected!("f16c") {
            return if is_x86_feature_detected!("avx512f") { Self::Avx512 } else { Self::Avx2 };
        }
        Self::Plain
    }

    /// Sum over the columns of each of `segments` of `right[component][col] · x[channel][col]`: `put` takes component, segment
    /// and the sum per channel. `right` is row-major, components × `n_cols`; without columns there is nothing to put.
    pub(super) fn project(
        self,
        right: &[f16],
        n_cols: usize,
        planes: &Planes,
        segments: &[usize],
        mut put: impl FnMut(usize, usize, [f32; 3]),
    ) {
        if n_cols == 0 {
            return;
        }
        let mut n_done = 0;
        #[cfg(target_arch = "x86_64")]
        if self != Self::Plain {
            let (pairs, rest) = right.split_at(right.len() / (2 * n_cols) * 2 * n_cols);
            for rows in pairs.chunks_exact(2 * n_cols) {
                // SAFETY: both variants exist only where `detect` found the three features.
                unsafe { avx2::project::<2>(rows, n_cols, planes, segments, |c, s, sums| put(n_done + c, s, sums)) };
                n_done += 2;
            }
            for row in rest.chunks_exact(n_cols) {
                // SAFETY: as above.
                unsafe { avx2::project::<1>(row, n_cols, planes, segments, |_, s, sums| put(n_done, s, sums)) };
                n_done += 1;
            }
        }
        for (component, row) in right.chunks_exact(n_cols).enumerate().skip(n_done) {
            for &segment in segments {
                put(component, segment, plain::project(row, planes, planes.active(segment)));
            }
        }
    }

    /// `out[row] = Σ left[row][k] · z[k][row % 3]`. `left` is runs × rank × [`RUN`], `patterns` rank × [`PATTERN`], `out` as
    /// long as the runs together; without components it is all zeros.
    pub(super) fn expand(self, left: &[f16], patterns: &[f32], out: &mut [f32]) {
        let rank = patterns.len() / PATTERN;
        assert!(
            left.len() == out.len() * rank && out.len().is_multiple_of(RUN),
            "left factors of rank {rank} fit the rows"
        );
        if rank == 0 {
            return out.fill(0.0);
        }
        let patterns = patterns.as_chunks().0;
        match self {
            Self::Plain => plain::expand(left, patterns, out),
            // SAFETY: this variant exists only where `detect` found the three features.
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => unsafe { avx2::expand(left, patterns, out) },
            // SAFETY: this variant exists only where `detect` found AVX-512F, too.
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => unsafe { avx512::expand(left, patterns, out) },
        }
    }
}

mod plain {
    use super::*;

    pub(super) fn project(row: &[f16], planes: &Planes, active: &[usize]) -> [f32; 3] {
        let mut sums = [[0.0; LANES]; 3];
        for &col in active {
            add_lanes(&row[col..row.len().min(col + LANES)], col, planes, &mut sums);
        }
        sums.map(|lanes| lanes.iter().sum())
    }

    fn add_lanes(right: &[f16], col: usize, planes: &Planes, sums: &mut [[f32; LANES]; 3]) {
        let mut row = [0.0; LANES];
        right.convert_to_f32_slice(&mut row[..right.len()]);
        for (channel, sums) in sums.iter_mut().enumerate() {
            let x = &planes.x[channel * planes.stride + col..][..LANES];
            for lane in 0..LANES {
                sums[lane] += row[lane] * x[lane];
            }
        }
    }

    pub(super) fn expand(left: &[f16], patterns: &[[f32; PATTERN]], out: &mut [f32]) {
        let runs = left.chunks_exact(patterns.len() * RUN).zip(out.as_chunks_mut::<RUN>().0);
        for (left, sums) in runs {
            sums.fill(0.0);
            for (left, z) in left.as_chunks::<RUN>().0.iter().zip(patterns) {
                let mut rows = [0.0; RUN];
                left.convert_to_f32_slice(&mut rows);
                for row in 0..RUN {
                    sums[row] += rows[row] * z[row % 24];
                }
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use std::arch::x86_64::*;

    use super::*;

    /// `N` components at a time, so that a coefficient is loaded once for all of them.
    #[target_feature(enable = "avx2,fma,f16c")]
    pub(super) fn project<const N: usize>(
        right: &[f16],
        n_cols: usize,
        planes: &Planes,
        segments: &[usize],
        mut put: impl FnMut(usize, usize, [f32; 3]),
    ) {
        let rows: [&[f16]; N] = std::array::from_fn(|component| &right[component * n_cols..][..n_cols]);
        let x: [&[f32]; 3] = std::array::from_fn(|channel| &planes.x[channel * planes.stride..][..planes.stride]);
        for &segment in segments {
            // Loops, not closures: sums whose address is taken would live in memory.
            let mut sums = [[_mm256_setzero_ps(); 3]; N];
            for &col in planes.active(segment) {
                let x = [load(&x[0][col..col + LANES]), load(&x[1][col..col + LANES]), load(&x[2][col..col + LANES])];
                for component in 0..N {
                    let lanes = match rows[component].get(col..col + LANES) {
                        Some(lanes) => load_f16(lanes),
                        None => load_f16_padded(&rows[component][col..]),
                    };
                    for channel in 0..3 {
                        sums[component][channel] = _mm256_fmadd_ps(lanes, x[channel], sums[component][channel]);
                    }
                }
            }
            for (component, [r, g, b]) in sums.into_iter().enumerate() {
                let mut out = [0.0; 4];
                store(&mut out, sum_rows([r, g, b, _mm256_setzero_ps()]));
                put(component, segment, [out[0], out[1], out[2]]);
            }
        }
    }

    /// A run at a time, in six registers.
    #[target_feature(enable = "avx2,fma,f16c")]
    pub(super) fn expand(left: &[f16], patterns: &[[f32; PATTERN]], out: &mut [f32]) {
        let runs = left.chunks_exact(patterns.len() * RUN).zip(out.as_chunks_mut::<RUN>().0);
        for (left, out) in runs {
            let mut sums = [_mm256_setzero_ps(); RUN / 8];
            for (left, z) in left.as_chunks::<RUN>().0.iter().zip(patterns) {
                let z = [load(&z[0..8]), load(&z[8..16]), load(&z[16..24])];
                for (i, sum) in sums.iter_mut().enumerate() {
                    *sum = _mm256_fmadd_ps(load_f16(&left[8 * i..8 * i + 8]), z[i % 3], *sum);
                }
            }
            for (i, sum) in sums.into_iter().enumerate() {
                store_all(&mut out[8 * i..8 * i + 8], sum);
            }
        }
    }

    /// Sum over the lanes of each of four vectors.
    #[inline]
    #[target_feature(enable = "avx2,fma,f16c")]
    fn sum_rows([a, b, c, d]: [__m256; 4]) -> __m128 {
        let halves = _mm256_hadd_ps(_mm256_hadd_ps(a, b), _mm256_hadd_ps(c, d));
        _mm_add_ps(_mm256_castps256_ps128(halves), _mm256_extractf128_ps::<1>(halves))
    }

    #[inline]
    #[target_feature(enable = "avx2,fma,f16c")]
    fn load_f16(from: &[f16]) -> __m256 {
        assert!(from.len() == LANES, "eight halves, not {}", from.len());
        // SAFETY: `from` holds 8 × 2 bytes, the load takes 16 and needs no alignment.
        _mm256_cvtph_ps(unsafe { _mm_loadu_si128(from.as_ptr().cast()) })
    }

    /// The last columns of a row: nothing is read behind them.
    #[inline]
    #[target_feature(enable = "avx2,fma,f16c")]
    fn load_f16_padded(from: &[f16]) -> __m256 {
        let mut padded = [f16::ZERO; LANES];
        padded[..from.len()].copy_from_slice(from);
        load_f16(&padded)
    }

    #[inline]
    #[target_feature(enable = "avx2,fma,f16c")]
    fn load(from: &[f32]) -> __m256 {
        assert!(from.len() == LANES, "eight floats, not {}", from.len());
        // SAFETY: `from` holds 8 × 4 bytes, the load takes 32 and needs no alignment.
        unsafe { _mm256_loadu_ps(from.as_ptr()) }
    }

    #[inline]
    #[target_feature(enable = "avx2,fma,f16c")]
    fn store(to: &mut [f32], value: __m128) {
        assert!(to.len() == 4, "four floats, not {}", to.len());
        // SAFETY: `to` holds 4 × 4 bytes, the store writes 16 and needs no alignment.
        unsafe { _mm_storeu_ps(to.as_mut_ptr(), value) }
    }

    #[inline]
    #[target_feature(enable = "avx2,fma,f16c")]
    fn store_all(to: &mut [f32], value: __m256) {
        assert!(to.len() == LANES, "eight floats, not {}", to.len());
        // SAFETY: `to` holds 8 × 4 bytes, the store writes 32 and needs no alignment.
        unsafe { _mm256_storeu_ps(to.as_mut_ptr(), value) }
    }
}

#[cfg(target_arch = "x86_64")]
mod avx512 {
    use std::arch::x86_64::*;

    use super::*;

    /// A run at a time, in three registers.
    #[target_feature(enable = "avx512f")]
    pub(super) fn expand(left: &[f16], patterns: &[[f32; PATTERN]], out: &mut [f32]) {
        let runs = left.chunks_exact(patterns.len() * RUN).zip(out.as_chunks_mut::<RUN>().0);
        for (left, out) in runs {
            let mut sums = [_mm512_setzero_ps(); RUN / 16];
            for (left, z) in left.as_chunks::<RUN>().0.iter().zip(patterns) {
                // Row 32 meets the same channel as row 8.
                let z = [load(&z[0..16]), load(&z[16..32]), load(&z[8..24])];
                for (i, sum) in sums.iter_mut().enumerate() {
                    *sum = _mm512_fmadd_ps(load_f16(&left[16 * i..16 * i + 16]), z[i], *sum);
                }
            }
            for (i, sum) in sums.into_iter().enumerate() {
                let out = &mut out[16 * i..16 * i + 16];
                // SAFETY: `out` holds 16 × 4 bytes, the store writes 64 and needs no alignment.
                unsafe { _mm512_storeu_ps(out.as_mut_ptr(), sum) }
            }
        }
    }

    #[inline]
    #[target_feature(enable = "avx512f")]
    fn load_f16(from: &[f16]) -> __m512 {
        assert!(from.len() == 16, "sixteen halves, not {}", from.len());
        // SAFETY: `from` holds 16 × 2 bytes, the load takes 32 and needs no alignment.
        _mm512_cvtph_ps(unsafe { _mm256_loadu_si256(from.as_ptr().cast()) })
    }

    #[inline]
    #[target_feature(enable = "avx512f")]
    fn load(from: &[f32]) -> __m512 {
        assert!(from.len() == 16, "sixteen floats, not {}", from.len());
        // SAFETY: `from` holds 16 × 4 bytes, the load takes 64 and needs no alignment.
        unsafe { _mm512_loadu_ps(from.as_ptr()) }
    }
}
