//! The few vector operations that traversal needs, once portable and once for AVX2.
//!
//! All arithmetic rounds after every operation (nothing is fused), so the two give the same bits: same boxes, same hits.
#![expect(unsafe_code, reason = "vector intrinsics; `Portable` is the safe twin with the same results")]

use std::ops::{Add, Div, Mul, Sub};

/// An array of three, item by item. Unlike `array::map` this is code in place at every level of optimization, as it must be
/// for vectors to stay in registers.
macro_rules! three {
    (|$i:ident| $item:expr) => {
        [
            {
                let $i = 0;
                $item
            },
            {
                let $i = 1;
                $item
            },
            {
                let $i = 2;
                $item
            },
        ]
    };
}

pub(super) use three;

/// `N` numbers that are worked on at once.
pub(super) trait Lanes<const N: usize>:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// Lane i holds `values[i]`.
    fn load(values: &[f32; N]) -> Self;
    /// Every lane holds `value`.
    fn splat(value: f32) -> Self;
    /// The lanes as an array.
    fn store(self) -> [f32; N];
    /// The smaller of the two; `other` where either is NaN.
    fn min(self, other: Self) -> Self;
    /// The greater of the two; `other` where either is NaN.
    fn max(self, other: Self) -> Self;
    /// Bit i set where lane i is at most that of `other`; never for NaN.
    fn at_most(self, other: Self) -> u32;
    /// Bit i set where lane i is below that of `other`; never for NaN.
    fn below(self, other: Self) -> u32;
}

/// Lanes as a plain array; the compiler vectorizes it as far as the target's baseline goes.
#[derive(Clone, Copy)]
pub(super) struct Portable<const N: usize>([f32; N]);

macro_rules! portable_operator {
    ($trait:ident, $method:ident, $operator:tt) => {
        impl<const N: usize> $trait for Portable<N> {
            type Output = Self;
            #[inline(always)]
            fn $method(mut self, other: Self) -> Self {
                for (own, other) in self.0.iter_mut().zip(other.0) {
                    *own $operator other;
                }
                self
            }
        }
    };
}

portable_operator!(Add, add, +=);
portable_operator!(Sub, sub, -=);
portable_operator!(Mul, mul, *=);
portable_operator!(Div, div, /=);

impl<const N: usize> Lanes<N> for Portable<N> {
    #[inline(always)]
    fn load(values: &[f32; N]) -> Self {
        Portable(*values)
    }

    #[inline(always)]
    fn splat(value: f32) -> Self {
        Portable([value; N])
    }

    #[inline(always)]
    fn store(self) -> [f32; N] {
        self.0
    }

    #[inline(always)]
    fn min(mut self, other: Self) -> Self {
        for (own, other) in self.0.iter_mut().zip(other.0) {
            *own = if *own < other { *own } else { other };
        }
        self
    }

    #[inline(always)]
    fn max(mut self, other: Self) -> Self {
        for (own, other) in self.0.iter_mut().zip(other.0) {
            *own = if *own > other { *own } else { other };
        }
        self
    }

    #[inline(always)]
    fn at_most(self, other: Self) -> u32 {
        let mut mask = 0;
        for i in 0..N {
            mask |= u32::from(self.0[i] <= other.0[i]) << i;
        }
        mask
    }

    #[inline(always)]
    fn below(self, other: Self) -> u32 {
        let mut mask = 0;
        for i in 0..N {
            mask |= u32::from(self.0[i] < other.0[i]) << i;
        }
        mask
    }
}

/// Lanes in vector registers of x86-64. Only code behind `#[target_feature(enable = "avx2")]` makes values of these types.
#[cfg(target_arch = "x86_64")]
pub(super) mod x86 {
    use std::arch::x86_64::*;
    use std::ops::{Add, Div, Mul, Sub};

    use super::Lanes;

    /// Four lanes.
    #[derive(Clone, Copy)]
    pub(in crate::bvh) struct Lanes4(__m128);

    /// Eight lanes.
    #[derive(Clone, Copy)]
    pub(in crate::bvh) struct Lanes8(__m256);

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
        ($lanes:ident, $n:literal, $load:ident, $splat:ident, $store:ident, $min:ident, $max:ident, $at_most:expr, $below:expr) => {
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
        |a, b| _mm_movemask_ps(_mm_cmplt_ps(a, b))
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
        |a, b| _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(a, b))
    );
}
