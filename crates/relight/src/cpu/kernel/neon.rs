//! Four lanes at a time.
#![expect(unsafe_code, reason = "conversion and FMA behind run-time detection; `plain` is the safe twin")]

use std::arch::aarch64::*;

use super::*;

/// Entries in one register, as floats.
pub(in crate::cpu) trait Load: Copy {
    /// # Safety
    /// Callers are compiled for the features of this function.
    unsafe fn load(from: &[Self; 4]) -> float32x4_t;
}

impl Load for f16 {
    #[inline]
    #[target_feature(enable = "neon")]
    unsafe fn load(from: &[Self; 4]) -> float32x4_t {
        // SAFETY: `from` holds 4 × 2 bytes, which is what the load takes.
        vcvt_f32_f16(vreinterpret_f16_u16(unsafe { vld1_u16(from.as_ptr().cast()) }))
    }
}

impl Load for i8 {
    #[inline]
    #[target_feature(enable = "neon")]
    unsafe fn load(from: &[Self; 4]) -> float32x4_t {
        // Four bytes are a lane of 32 bits, the first the lowest.
        let bytes = from.map(i8::cast_unsigned);
        let wide = vmovl_s8(vreinterpret_s8_u32(vdup_n_u32(u32::from_le_bytes(bytes))));
        vcvtq_f32_s32(vmovl_s16(vget_low_s16(wide)))
    }
}

/// All rows of the factor against all channels, twelve sums at a time.
#[target_feature(enable = "neon")]
pub(super) fn project<T: Load, const N: usize>(rows: Rows<T, N>, later: Rows<T, N>, cols: &Cols) -> Quad {
    let x = cols.x;
    // Loops, not closures: sums whose address is taken would live in memory.
    let mut sums = [[vdupq_n_f32(0.0); QUAD]; 3];
    for lanes in cols.lit {
        later.get(lanes).into_iter().for_each(|later| prefetch(later));
        for quarter in 0..LANES / 4 {
            let x = [
                load_quarter(&x[0][lanes], quarter),
                load_quarter(&x[1][lanes], quarter),
                load_quarter(&x[2][lanes], quarter),
            ];
            for component in 0..N {
                // SAFETY: this function is compiled for the same features.
                let right = unsafe { T::load(&rows[lanes][component].as_chunks().0[quarter]) };
                for channel in 0..3 {
                    sums[channel][component] = vfmaq_f32(sums[channel][component], right, x[channel]);
                }
            }
        }
    }
    let mut quad = Quad::default();
    for (sums, out) in sums.into_iter().zip(quad.0.as_chunks_mut::<QUAD>().0) {
        *out = [vaddvq_f32(sums[0]), vaddvq_f32(sums[1]), vaddvq_f32(sums[2]), vaddvq_f32(sums[3])];
    }
    quad
}

/// A run at a time, in twelve registers.
#[target_feature(enable = "neon")]
pub(super) fn expand<T: Load>(left: &[T], later: &[T], patterns: &[[f32; PATTERN]], (write, out): (Write, &mut [f32])) {
    let mut later = later.as_chunks::<RUN>().0.iter();
    let runs = left.chunks_exact(patterns.len() * RUN).zip(out.as_chunks_mut::<RUN>().0);
    for (left, out) in runs {
        let mut sums = [vdupq_n_f32(0.0); RUN / 4];
        if write == Write::Add {
            sums.iter_mut().zip(out.as_chunks().0).for_each(|(sum, out)| *sum = load(out));
        }
        for (left, z) in left.as_chunks::<RUN>().0.iter().zip(patterns) {
            later.next().into_iter().for_each(|later| prefetch(later));
            let z = z.as_chunks().0;
            let z = [load(&z[0]), load(&z[1]), load(&z[2])];
            for (i, left) in left.as_chunks().0.iter().enumerate() {
                // SAFETY: as in `project`.
                sums[i] = vfmaq_f32(sums[i], unsafe { T::load(left) }, z[i % 3]);
            }
        }
        for (sum, out) in sums.into_iter().zip(out.as_chunks_mut().0) {
            store(out, sum);
        }
    }
}

#[inline]
#[target_feature(enable = "neon")]
fn load_quarter(from: &[f32; LANES], quarter: usize) -> float32x4_t {
    load(&from.as_chunks().0[quarter])
}

#[inline]
#[target_feature(enable = "neon")]
fn load(from: &[f32; 4]) -> float32x4_t {
    // SAFETY: `from` holds 4 × 4 bytes, which is what the load takes.
    unsafe { vld1q_f32(from.as_ptr()) }
}

#[inline]
#[target_feature(enable = "neon")]
fn store(to: &mut [f32; 4], value: float32x4_t) {
    // SAFETY: `to` holds 4 × 4 bytes, which is what the store writes.
    unsafe { vst1q_f32(to.as_mut_ptr(), value) }
}
