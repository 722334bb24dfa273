//! The two kinds of numbers that methods compute in.

use nalgebra::RealField;

/// `f32` or `f64`: a method computes in the numbers that it is given, and in no others.
pub trait Real: RealField + Copy + sealed::Sealed {
    /// Distance from 1 to the next number.
    const EPSILON: Self;
    /// The nearest number.
    fn nearest(x: f64) -> Self;
    /// The same number.
    fn to_f64(self) -> f64;
}

impl Real for f32 {
    const EPSILON: Self = f32::EPSILON;
    fn nearest(x: f64) -> Self {
        x as f32
    }
    fn to_f64(self) -> f64 {
        f64::from(self)
    }
}

impl Real for f64 {
    const EPSILON: Self = f64::EPSILON;
    fn nearest(x: f64) -> Self {
        x
    }
    fn to_f64(self) -> f64 {
        self
    }
}

mod sealed {
    pub trait Sealed {}
    impl Sealed for f32 {}
    impl Sealed for f64 {}
}

/// Index of the largest magnitude among the allowed ones; `None` if that is zero.
pub(super) fn largest<S: Real>(values: impl Iterator<Item = S>, allowed: impl Fn(usize) -> bool) -> Option<usize> {
    let mut best = (S::zero(), None);
    for (i, x) in values.enumerate().filter(|(i, _)| allowed(*i)) {
        if x.abs() > best.0 {
            best = (x.abs(), Some(i));
        }
    }
    best.1
}

/// `x · 2^exponent`, in two steps, as one power of two may lie beyond the range.
pub(super) fn scaled<S: Real>(x: S, exponent: i32) -> S {
    let half = exponent / 2;
    x * S::nearest(2f64.powi(half)) * S::nearest(2f64.powi(exponent - half))
}
