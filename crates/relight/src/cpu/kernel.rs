//! The two inner products, plain and for AVX2 with F16C.
//!
//! Left and right factors are read once per picture, so the work is converting f16 at the speed of memory. Loads of left
//! factors take whole lanes and may run into the next row of the matrix: `z` is zero there.
#![cfg_attr(
    target_arch = "x86_64",
    expect(unsafe_code, reason = "f16 conversion and FMA behind run-time detection; `plain` is the safe twin")
)]

use half::{f16, slice::HalfFloatSliceExt};

use super::project::{LANES, Planes};

/// Which instructions the inner products use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kernel {
    /// Portable.
    Plain,
    /// AVX2, FMA and F16C; made only by [`Kernel::detect`].
    #[cfg(target_arch = "x86_64")]
    Avx2,
}

impl Kernel {
    /// The fastest that this machine runs.
    pub(super) fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") && is_x86_feature_detected!("f16c") {
            return Self::Avx2;
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
        if self == Self::Avx2 {
            let (fours, rest) = right.split_at(right.len() / (4 * n_cols) * 4 * n_cols);
            for rows in fours.chunks_exact(4 * n_cols) {
                // SAFETY: this variant exists only where `detect` found the three features.
                unsafe { avx2::project::<4>(rows, n_cols, planes, segments, |c, s, sums| put(n_done + c, s, sums)) };
                n_done += 4;
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

    /// `out[pixel][channel] = Σ left[3 pixel + channel][k] · z[channel][k]`. `left` starts at the first pixel and may go
    /// on after the last; `z` is 3 × rank rounded up to whole lanes.
    pub(super) fn expand(self, left: &[f16], rank: usize, z: &[f32], out: &mut [[f32; 3]]) {
        let n_done = match self {
            Self::Plain => 0,
            #[cfg(target_arch = "x86_64")]
            // SAFETY: this variant exists only where `detect` found the three features.
            Self::Avx2 => unsafe { avx2::expand(left, rank, z, out) },
        };
        plain::expand(&left[3 * n_done * rank..], rank, z, &mut out[n_done..]);
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

    pub(super) fn expand(left: &[f16], rank: usize, z: &[f32], out: &mut [[f32; 3]]) {
        let stride = rank.next_multiple_of(LANES);
        for (pixel, rgb) in out.iter_mut().enumerate() {
            for channel in 0..3 {
                let row = &left[(3 * pixel + channel) * rank..][..rank];
                rgb[channel] = dot(row, &z[channel * stride..][..stride]);
            }
        }
    }

    fn dot(row: &[f16], z: &[f32]) -> f32 {
        let mut sums = [0.0; LANES];
        for (row, z) in row.chunks(LANES).zip(z.chunks_exact(LANES)) {
            let mut left = [0.0; LANES];
            row.convert_to_f32_slice(&mut left[..row.len()]);
            for lane in 0..LANES {
                sums[lane] += left[lane] * z[lane];
            }
        }
        sums.iter().sum()
    }
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use std::arch::x86_64::*;

    use super::*;

    /// `N` components at a time, four at most, so that a coefficient is loaded once for all of them.
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
            let mut sums = [[_mm256_setzero_ps(); 4]; 3];
            for &col in planes.active(segment) {
                let x = x.map(|x| load(&x[col..col + LANES]));
                for component in 0..N {
                    let lanes = match rows[component].get(col..col + LANES) {
                        Some(lanes) => load_f16(lanes),
                        None => load_f16_padded(&rows[component][col..]),
                    };
                    for channel in 0..3 {
                        sums[channel][component] = _mm256_fmadd_ps(lanes, x[channel], sums[channel][component]);
                    }
                }
            }
            let mut out = [[0.0; 4]; 3];
            (0..3).for_each(|channel| store(&mut out[channel], sum_rows(sums[channel])));
            (0..N).for_each(|component| put(component, segment, out.map(|channel| channel[component])));
        }
    }

    /// Does four pixels at a time, as long as whole lanes lie within `left`; returns how many pixels are done.
    #[target_feature(enable = "avx2,fma,f16c")]
    pub(super) fn expand(left: &[f16], rank: usize, z: &[f32], out: &mut [[f32; 3]]) -> usize {
        let stride = rank.next_multiple_of(LANES);
        let z = &z[..3 * stride];
        let mut n_done = 0;
        for pixels in out.as_chunks_mut::<4>().0 {
            let first = 3 * n_done * rank;
            if first + 11 * rank + stride > left.len() {
                break;
            }
            // Twelve rows make four pixels; the channel of a row is its number modulo 3.
            let rows = &left[first..first + 11 * rank + stride];
            let flat = pixels.as_flattened_mut();
            store(&mut flat[0..4], sum_rows(dots::<0>(rows, rank, z)));
            store(&mut flat[4..8], sum_rows(dots::<1>(rows, rank, z)));
            store(&mut flat[8..12], sum_rows(dots::<2>(rows, rank, z)));
            n_done += 4;
        }
        n_done
    }

    /// Lane-wise products of rows `4 · QUARTER ..` with their channel of `z`, not yet summed over the lanes.
    #[inline]
    #[target_feature(enable = "avx2,fma,f16c")]
    fn dots<const QUARTER: usize>(rows: &[f16], rank: usize, z: &[f32]) -> [__m256; 4] {
        let stride = z.len() / 3;
        assert!(
            stride.is_multiple_of(LANES) && rows.len() >= (4 * QUARTER + 3) * rank + stride,
            "lanes lie in the rows"
        );
        let mut sums = [_mm256_setzero_ps(); 4];
        for k in (0..stride).step_by(LANES) {
            for (j, sum) in sums.iter_mut().enumerate() {
                let row = 4 * QUARTER + j;
                // SAFETY: k + 8 ≤ stride and row ≤ 4 · QUARTER + 3, so the assertion keeps both ranges inside.
                let (left, z) = unsafe {
                    let left = rows.get_unchecked(row * rank + k..row * rank + k + LANES);
                    (left, z.get_unchecked(row % 3 * stride + k..row % 3 * stride + k + LANES))
                };
                *sum = _mm256_fmadd_ps(load_f16(left), load(z), *sum);
            }
        }
        sums
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
}
