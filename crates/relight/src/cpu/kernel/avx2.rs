//! Eight lanes at a time.
#![expect(unsafe_code, reason = "conversion and FMA behind run-time detection; `plain` is the safe twin")]

use std::arch::x86_64::*;

use super::*;

/// Entries in one register, as floats.
pub(in crate::cpu) trait Load: Copy {
    /// # Safety
    /// Callers are compiled for the features of this function.
    unsafe fn load(from: &[Self; 8]) -> __m256;
}

impl Load for f16 {
    #[inline]
    #[target_feature(enable = "avx2,fma,f16c")]
    unsafe fn load(from: &[Self; 8]) -> __m256 {
        // SAFETY: `from` holds 8 × 2 bytes, the load takes 16 and needs no alignment.
        _mm256_cvtph_ps(unsafe { _mm_loadu_si128(from.as_ptr().cast()) })
    }
}

impl Load for i8 {
    #[inline]
    #[target_feature(enable = "avx2,fma,f16c")]
    unsafe fn load(from: &[Self; 8]) -> __m256 {
        // SAFETY: `from` holds 8 bytes, which is what the load takes; it needs no alignment.
        _mm256_cvtepi32_ps(_mm256_cvtepi8_epi32(unsafe { _mm_loadl_epi64(from.as_ptr().cast()) }))
    }
}

/// All rows of the factor against all channels, twelve sums at a time.
#[target_feature(enable = "avx2,fma,f16c")]
pub(super) fn project<T: Load, const N: usize>(rows: Rows<T, N>, later: Rows<T, N>, cols: &Cols) -> Quad {
    let x = cols.x;
    // Loops, not closures: sums whose address is taken would live in memory.
    let mut sums = [[_mm256_setzero_ps(); QUAD]; 3];
    for lanes in cols.lit {
        later.get(lanes).into_iter().for_each(|later| prefetch(later));
        for half in 0..2 {
            let x = [load_half(&x[0][lanes], half), load_half(&x[1][lanes], half), load_half(&x[2][lanes], half)];
            for component in 0..N {
                // SAFETY: this function is compiled for the same features.
                let right = unsafe { T::load(&rows[lanes][component].as_chunks().0[half]) };
                for channel in 0..3 {
                    sums[channel][component] = _mm256_fmadd_ps(right, x[channel], sums[channel][component]);
                }
            }
        }
    }
    let mut quad = Quad::default();
    for (sums, out) in sums.into_iter().zip(quad.0.as_chunks_mut().0) {
        store(out, sum_lanes(sums));
    }
    quad
}

/// Sum over the lanes of each of four vectors.
#[inline]
#[target_feature(enable = "avx2,fma,f16c")]
fn sum_lanes([a, b, c, d]: [__m256; QUAD]) -> __m128 {
    let halves = _mm256_hadd_ps(_mm256_hadd_ps(a, b), _mm256_hadd_ps(c, d));
    _mm_add_ps(_mm256_castps256_ps128(halves), _mm256_extractf128_ps::<1>(halves))
}

/// A run at a time, in six registers.
#[target_feature(enable = "avx2,fma,f16c")]
pub(super) fn expand<T: Load>(left: &[T], later: &[T], patterns: &[[f32; PATTERN]], (write, out): (Write, &mut [f32])) {
    let mut later = later.as_chunks::<RUN>().0.iter();
    let runs = left.chunks_exact(patterns.len() * RUN).zip(out.as_chunks_mut::<RUN>().0);
    for (left, out) in runs {
        let mut sums = [_mm256_setzero_ps(); RUN / 8];
        if write == Write::Add {
            sums.iter_mut().zip(out.as_chunks().0).for_each(|(sum, out)| *sum = load(out));
        }
        for (left, z) in left.as_chunks::<RUN>().0.iter().zip(patterns) {
            later.next().into_iter().for_each(|later| prefetch(later));
            let z = z.as_chunks().0;
            let z = [load(&z[0]), load(&z[1]), load(&z[2])];
            for (i, left) in left.as_chunks().0.iter().enumerate() {
                // SAFETY: as in `project`.
                sums[i] = _mm256_fmadd_ps(unsafe { T::load(left) }, z[i % 3], sums[i]);
            }
        }
        for (sum, out) in sums.into_iter().zip(out.as_chunks_mut().0) {
            store_all(out, sum);
        }
    }
}

#[inline]
#[target_feature(enable = "avx2,fma,f16c")]
fn load_half(from: &[f32; LANES], half: usize) -> __m256 {
    load(&from.as_chunks().0[half])
}

#[inline]
#[target_feature(enable = "avx2,fma,f16c")]
fn load(from: &[f32; 8]) -> __m256 {
    // SAFETY: `from` holds 8 × 4 bytes, the load takes 32 and needs no alignment.
    unsafe { _mm256_loadu_ps(from.as_ptr()) }
}

#[inline]
#[target_feature(enable = "avx2,fma,f16c")]
fn store(to: &mut [f32; 4], value: __m128) {
    // SAFETY: `to` holds 4 × 4 bytes, the store writes 16 and needs no alignment.
    unsafe { _mm_storeu_ps(to.as_mut_ptr(), value) }
}

#[inline]
#[target_feature(enable = "avx2,fma,f16c")]
fn store_all(to: &mut [f32; 8], value: __m256) {
    // SAFETY: `to` holds 8 × 4 bytes, the store writes 32 and needs no alignment.
    unsafe { _mm256_storeu_ps(to.as_mut_ptr(), value) }
}
