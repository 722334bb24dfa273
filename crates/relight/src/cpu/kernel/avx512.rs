//! Sixteen lanes at a time.
#![expect(unsafe_code, reason = "conversion and FMA behind run-time detection; `plain` is the safe twin")]

use std::arch::x86_64::*;

use super::*;

/// Entries in one register, as floats.
pub(in crate::cpu) trait Load: Copy {
    /// # Safety
    /// Callers are compiled for the features of this function.
    unsafe fn load(from: &[Self; 16]) -> __m512;
}

impl Load for f16 {
    #[inline]
    #[target_feature(enable = "avx512f")]
    unsafe fn load(from: &[Self; 16]) -> __m512 {
        // SAFETY: `from` holds 16 × 2 bytes, the load takes 32 and needs no alignment.
        _mm512_cvtph_ps(unsafe { _mm256_loadu_si256(from.as_ptr().cast()) })
    }
}

impl Load for i8 {
    #[inline]
    #[target_feature(enable = "avx512f")]
    unsafe fn load(from: &[Self; 16]) -> __m512 {
        // SAFETY: `from` holds 16 bytes, which is what the load takes; it needs no alignment.
        _mm512_cvtepi32_ps(_mm512_cvtepi8_epi32(unsafe { _mm_loadu_si128(from.as_ptr().cast()) }))
    }
}

/// All rows of the factor against all channels, so that a coefficient is loaded once for four components and a half once for
/// three channels: twelve sums at a time.
#[target_feature(enable = "avx512f")]
pub(super) fn project<T: Load, const N: usize>(rows: Rows<T, N>, later: Rows<T, N>, cols: &Cols) -> Quad {
    let x = cols.x;
    // Loops, not closures: sums whose address is taken would live in memory.
    let mut sums = [[_mm512_setzero_ps(); QUAD]; 3];
    for lanes in cols.lit {
        later.get(lanes).into_iter().for_each(|later| prefetch(later));
        let x = [load(&x[0][lanes]), load(&x[1][lanes]), load(&x[2][lanes])];
        for component in 0..N {
            // SAFETY: this function is compiled for the same features.
            let right = unsafe { T::load(&rows[lanes][component]) };
            for channel in 0..3 {
                sums[channel][component] = _mm512_fmadd_ps(right, x[channel], sums[channel][component]);
            }
        }
    }
    sum_lanes(sums)
}

/// Sums over the lanes of each of twelve vectors.
#[inline]
#[target_feature(enable = "avx512f")]
fn sum_lanes([r, g, b]: [[__m512; QUAD]; 3]) -> Quad {
    // Quarter by quarter: of two channels the quarters 0 and 2 of each, and 1 and 3, and so on with what remains.
    let (r, g, b) = (transposed_sum(r), transposed_sum(g), transposed_sum(b));
    let zero = _mm512_setzero_ps();
    let rg = _mm512_add_ps(_mm512_shuffle_f32x4::<0b10_00_10_00>(r, g), _mm512_shuffle_f32x4::<0b11_01_11_01>(r, g));
    let b0 =
        _mm512_add_ps(_mm512_shuffle_f32x4::<0b10_00_10_00>(b, zero), _mm512_shuffle_f32x4::<0b11_01_11_01>(b, zero));
    let rgb0 =
        _mm512_add_ps(_mm512_shuffle_f32x4::<0b10_00_10_00>(rg, b0), _mm512_shuffle_f32x4::<0b11_01_11_01>(rg, b0));
    let mut quad = Quad::default();
    store(&mut quad.0, rgb0);
    quad
}

/// In each quarter the sums over that quarter of the four vectors.
#[inline]
#[target_feature(enable = "avx512f")]
fn transposed_sum([a, b, c, d]: [__m512; QUAD]) -> __m512 {
    let ab = _mm512_add_ps(_mm512_unpacklo_ps(a, b), _mm512_unpackhi_ps(a, b));
    let cd = _mm512_add_ps(_mm512_unpacklo_ps(c, d), _mm512_unpackhi_ps(c, d));
    let (ab, cd) = (_mm512_castps_pd(ab), _mm512_castps_pd(cd));
    let (low, high) = (_mm512_unpacklo_pd(ab, cd), _mm512_unpackhi_pd(ab, cd));
    _mm512_add_ps(_mm512_castpd_ps(low), _mm512_castpd_ps(high))
}

/// A run at a time, in three registers.
#[target_feature(enable = "avx512f")]
pub(super) fn expand<T: Load>(left: &[T], later: &[T], patterns: &[[f32; PATTERN]], (write, out): (Write, &mut [f32])) {
    let mut later = later.as_chunks::<RUN>().0.iter();
    let runs = left.chunks_exact(patterns.len() * RUN).zip(out.as_chunks_mut::<RUN>().0);
    for (left, out) in runs {
        let mut sums = match write {
            Write::Set => [_mm512_setzero_ps(); RUN / LANES],
            Write::Add => [load_run(out, 0), load_run(out, 1), load_run(out, 2)],
        };
        for (left, z) in left.as_chunks::<RUN>().0.iter().zip(patterns) {
            later.next().into_iter().for_each(|later| prefetch(later));
            // Row 32 meets the same channel as row 8.
            let z = [load_at(z, 0), load_at(z, 16), load_at(z, 8)];
            for (i, left) in left.as_chunks().0.iter().enumerate() {
                // SAFETY: as in `project`.
                sums[i] = _mm512_fmadd_ps(unsafe { T::load(left) }, z[i], sums[i]);
            }
        }
        for (sum, out) in sums.into_iter().zip(out.as_chunks_mut().0) {
            store(out, sum);
        }
    }
}

#[inline]
#[target_feature(enable = "avx512f")]
fn load(from: &[f32; LANES]) -> __m512 {
    // SAFETY: `from` holds 16 × 4 bytes, the load takes 64 and needs no alignment.
    unsafe { _mm512_loadu_ps(from.as_ptr()) }
}

#[inline]
#[target_feature(enable = "avx512f")]
fn load_run(run: &[f32; RUN], third: usize) -> __m512 {
    load(&run.as_chunks().0[third])
}

#[inline]
#[target_feature(enable = "avx512f")]
fn load_at(from: &[f32; PATTERN], first: usize) -> __m512 {
    load(from[first..].first_chunk().expect("a pattern reaches 16 floats behind any of its starts"))
}

#[inline]
#[target_feature(enable = "avx512f")]
fn store(to: &mut [f32; LANES], value: __m512) {
    // SAFETY: `to` holds 16 × 4 bytes, the store writes 64 and needs no alignment.
    unsafe { _mm512_storeu_ps(to.as_mut_ptr(), value) }
}
