//! The few vector operations that traversal needs, once portable and once for AVX2.
//!
//! All arithmetic rounds after every operation (nothing is fused), so the two give the same bits: same boxes, same hits.

#[cfg(target_arch = "x86_64")]
pub(super) mod x86;

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
    /// Lane i is that of `other` where bit i of `lanes` is set.
    fn replaced(self, other: Self, lanes: u32) -> Self;
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

    #[inline(always)]
    fn replaced(mut self, other: Self, lanes: u32) -> Self {
        for i in 0..N {
            self.0[i] = if lanes >> i & 1 == 1 { other.0[i] } else { self.0[i] };
        }
        self
    }
}
