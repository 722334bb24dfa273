//! Lanes in vector registers of x86-64. Only code behind `#[target_feature(enable = "avx2")]` makes values of these types.
#![expect(unsafe_code, reason = "vector intrinsics; `Portable` is the safe twin with the same results")]

use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Sub};

use super::Lanes;

/// Four lanes.
#[derive(Clone, Copy)]
pub(in super::super) struct Lanes4(__m128);

/// Eight lanes.
#[derive(Clone, Copy)]
pub(in super::super) struct Lanes8(__m256);

macro_rules! operator {
    ($lanes:ident, $trait:ident, $method:ident, $intrinsic:ident) => {
        impl $trait for $lanes {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                // SAFETY: values of this type exist only where AVX2 was detected.
                #[allow(unused_unsafe, reason = "the 128-bit intrinsics are safe on every x86-64")]
                unsafe {
                    $lanes($intrinsic(self.0, other.0))
                }
            }
        }
    };
}

macro_rules! lanes {
    (
        $lanes:ident, $n:literal, $load:ident, $splat:ident, $store:ident, $min:ident, $max:ident, $at_most:expr,
        $below:expr, $spread:ident, $bits:expr, $and:ident, $equal:ident, $cast:ident, $blend:ident
    ) => {
        #[allow(unused_unsafe, reason = "the 128-bit intrinsics are safe on every x86-64")]
        impl Lanes<$n> for $lanes {
            #[inline(always)]
            fn load(values: &[f32; $n]) -> Self {
                // SAFETY: the array is as long as the register; AVX2 was detected by whoever calls.
                unsafe { $lanes($load(values.as_ptr())) }
            }

            #[inline(always)]
            fn splat(value: f32) -> Self {
                // SAFETY: AVX2 was detected by whoever calls.
                unsafe { $lanes($splat(value)) }
            }

            #[inline(always)]
            fn store(self) -> [f32; $n] {
                let mut values = [0.0; $n];
                // SAFETY: the array is as long as the register; the value exists, so AVX2 was detected.
                unsafe { $store(values.as_mut_ptr(), self.0) };
                values
            }

            #[inline(always)]
            fn min(self, other: Self) -> Self {
                // SAFETY: values of this type exist only where AVX2 was detected.
                unsafe { $lanes($min(self.0, other.0)) }
            }

            #[inline(always)]
            fn max(self, other: Self) -> Self {
                // SAFETY: values of this type exist only where AVX2 was detected.
                unsafe { $lanes($max(self.0, other.0)) }
            }

            #[inline(always)]
            fn at_most(self, other: Self) -> u32 {
                // SAFETY: values of this type exist only where AVX2 was detected.
                unsafe { $at_most(self.0, other.0) as u32 }
            }

            #[inline(always)]
            fn below(self, other: Self) -> u32 {
                // SAFETY: values of this type exist only where AVX2 was detected.
                unsafe { $below(self.0, other.0) as u32 }
            }

            #[inline(always)]
            fn replaced(self, other: Self, lanes: u32) -> Self {
                // SAFETY: values of this type exist only where AVX2 was detected.
                unsafe {
                    let bits = $bits;
                    let chosen = $equal($and($spread(lanes as i32), bits), bits);
                    $lanes($blend(self.0, other.0, $cast(chosen)))
                }
            }
        }
    };
}

operator!(Lanes4, Add, add, _mm_add_ps);
operator!(Lanes4, Sub, sub, _mm_sub_ps);
operator!(Lanes4, Mul, mul, _mm_mul_ps);
operator!(Lanes4, Div, div, _mm_div_ps);
operator!(Lanes8, Add, add, _mm256_add_ps);
operator!(Lanes8, Sub, sub, _mm256_sub_ps);
operator!(Lanes8, Mul, mul, _mm256_mul_ps);
operator!(Lanes8, Div, div, _mm256_div_ps);
lanes!(
    Lanes4,
    4,
    _mm_loadu_ps,
    _mm_set1_ps,
    _mm_storeu_ps,
    _mm_min_ps,
    _mm_max_ps,
    |a, b| _mm_movemask_ps(_mm_cmple_ps(a, b)),
    |a, b| _mm_movemask_ps(_mm_cmplt_ps(a, b)),
    _mm_set1_epi32,
    _mm_setr_epi32(1, 2, 4, 8),
    _mm_and_si128,
    _mm_cmpeq_epi32,
    _mm_castsi128_ps,
    _mm_blendv_ps
);
lanes!(
    Lanes8,
    8,
    _mm256_loadu_ps,
    _mm256_set1_ps,
    _mm256_storeu_ps,
    _mm256_min_ps,
    _mm256_max_ps,
    |a, b| _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(a, b)),
    |a, b| _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(a, b)),
    _mm256_set1_epi32,
    _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128),
    _mm256_and_si256,
    _mm256_cmpeq_epi32,
    _mm256_castsi256_ps,
    _mm256_blendv_ps
);
