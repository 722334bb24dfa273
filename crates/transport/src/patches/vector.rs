//! Sums of weighted rows, with the vector instructions of the machine; `benches/transport.rs` times them beside their safe twins.
#![cfg_attr(
    target_arch = "x86_64",
    expect(unsafe_code, reason = "AVX2 behind run-time detection; `plain` is the safe twin with the same results")
)]

use half::bf16;

/// Rows that are added at a time: what they are added to is read and written once for all of them.
pub const AT_ONCE: usize = 4;
/// Columns of a strip.
pub const STRIP: usize = 16;

/// A row of a table, and its weight in a sum.
pub type Link = (u32, f32);

/// A number in single precision, as fast as it can be had.
#[inline(always)]
pub(super) fn single(x: bf16) -> f32 {
    f32::from_bits(u32::from(x.to_bits()) << 16)
}

/// Adds some rows to another one, each times its weight.
pub fn add_rows(out: &mut [f32], rows: [(f32, &[bf16]); AT_ONCE]) {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") {
        // SAFETY: AVX2 was found.
        return unsafe { avx2::add_rows(out, rows) };
    }
    plain::add_rows(out, rows);
}

/// These rows of a strip, each with a sum of rows of a table added to it.
pub fn sums(base: &[[f32; STRIP]], links: &[Vec<Link>], table: &[[f32; STRIP]]) -> Vec<[f32; STRIP]> {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") {
        // SAFETY: AVX2 was found.
        return unsafe { avx2::sums(base, links, table) };
    }
    plain::sums(base, links, table)
}

/// The safe twins.
pub mod plain {
    // Closures in these would be compiled for any machine, whatever calls them.

    use half::bf16;

    use super::{AT_ONCE, Link, STRIP, single};

    /// See [`super::add_rows`].
    #[inline(always)]
    pub fn add_rows(out: &mut [f32], [(a, x), (b, y), (c, z), (d, w)]: [(f32, &[bf16]); AT_ONCE]) {
        for (out, ((x, y), (z, w))) in out.iter_mut().zip(x.iter().zip(y).zip(z.iter().zip(w))) {
            *out += (a * single(*x) + b * single(*y)) + (c * single(*z) + d * single(*w));
        }
    }

    /// See [`super::sums`].
    #[inline(always)]
    pub fn sums(base: &[[f32; STRIP]], links: &[Vec<Link>], table: &[[f32; STRIP]]) -> Vec<[f32; STRIP]> {
        let mut out = base.to_vec();
        for (out, links) in out.iter_mut().zip(links) {
            let mut sums = *out;
            for &(row, weight) in links {
                let row = &table[row as usize];
                for k in 0..STRIP {
                    sums[k] += weight * row[k];
                }
            }
            *out = sums;
        }
        out
    }
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use half::bf16;

    use super::{AT_ONCE, Link, STRIP, plain};

    #[target_feature(enable = "avx2")]
    pub(super) fn add_rows(out: &mut [f32], rows: [(f32, &[bf16]); AT_ONCE]) {
        plain::add_rows(out, rows);
    }

    #[target_feature(enable = "avx2")]
    pub(super) fn sums(base: &[[f32; STRIP]], links: &[Vec<Link>], table: &[[f32; STRIP]]) -> Vec<[f32; STRIP]> {
        plain::sums(base, links, table)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::sampler::uniform_hash;

    /// Numbers around 0.
    pub fn numbers(n: usize, key: u64) -> Vec<f32> {
        (0..n as u64).map(|nth| uniform_hash(key + nth) - 0.5).collect()
    }

    #[test]
    fn numbers_of_half_the_size_are_those_of_the_library() {
        for x in numbers(1000, 1).into_iter().chain([0.0, -0.0, 1e-30, 3e38]) {
            assert_eq!(single(bf16::from_f32(x)), bf16::from_f32(x).to_f32());
            assert!((single(bf16::from_f32(x)) - x).abs() <= x.abs() / 256.0, "{x}");
        }
    }

    #[test]
    fn sums_are_the_same_whatever_the_instructions() {
        for len in [0, 1, 8, 21, 500] {
            let (table, weights) = (numbers(AT_ONCE * len, 1), numbers(AT_ONCE, 7000));
            let table: Vec<bf16> = table.into_iter().map(bf16::from_f32).collect();
            let rows = || std::array::from_fn(|k| (weights[k], &table[k * len..][..len]));
            let mut best = numbers(len, 9000);
            let mut plain = best.clone();
            add_rows(&mut best, rows());
            plain::add_rows(&mut plain, rows());
            assert_eq!(best, plain);
        }
        let strips = |n: usize, key: u64| numbers(n * STRIP, key).as_chunks::<STRIP>().0.to_vec();
        let link = |nth: u64| ((uniform_hash(2 * nth) * 30.0) as u32, uniform_hash(2 * nth + 1) - 0.5);
        let links: Vec<Vec<Link>> = [0, 1, 50].map(|n| (0..n).map(link).collect::<Vec<Link>>()).to_vec();
        let (base, table) = (strips(3, 1), strips(30, 1000));
        assert_eq!(sums(&base, &links, &table), plain::sums(&base, &links, &table));
    }
}
