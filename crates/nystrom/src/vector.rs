//! A few rows with a few vectors: scalar products and combinations, with the vector instructions of the machine.
#![cfg_attr(
    target_arch = "x86_64",
    expect(unsafe_code, reason = "AVX2 and FMA behind run-time detection; `plain` is the safe twin")
)]

/// Rows that are worked on at a time.
pub(crate) const TALL: usize = 6;
/// Numbers in a vector register.
pub(crate) const LANES: usize = 8;
/// Vectors that are worked on at a time; where few are left, [`LANES`].
pub(crate) const WIDE: usize = 2 * LANES;

/// The scalar product of each row with each vector; `vectors` has their entries side by side, at most as many as a row has.
pub(crate) fn scalar_products<const N: usize>(rows: [&[f32]; TALL], vectors: &[[f32; N]]) -> [[f32; N]; TALL] {
    assert!(rows.iter().all(|row| row.len() >= vectors.len()), "rows shorter than {}", vectors.len());
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
        // SAFETY: AVX2 and FMA were found, and the rows are long enough.
        return unsafe { avx2::scalar_products(rows, vectors) };
    }
    plain::scalar_products(rows, vectors)
}

/// Adds to each vector a combination of the rows, with one weight per row and vector; `vectors` has their entries side by
/// side, at most as many as a row has.
pub(crate) fn add_combinations<const N: usize>(
    weights: &[[f32; N]; TALL],
    rows: [&[f32]; TALL],
    vectors: &mut [[f32; N]],
) {
    assert!(rows.iter().all(|row| row.len() >= vectors.len()), "rows shorter than {}", vectors.len());
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
        // SAFETY: AVX2 and FMA were found, and the rows are long enough.
        return unsafe { avx2::add_combinations(weights, rows, vectors) };
    }
    plain::add_combinations(weights, rows, vectors);
}

mod plain {
    use super::TALL;

    pub(super) fn scalar_products<const N: usize>(rows: [&[f32]; TALL], vectors: &[[f32; N]]) -> [[f32; N]; TALL] {
        rows.map(|row| {
            let mut sums = [0.0; N];
            for (&x, vectors) in row.iter().zip(vectors) {
                sums.iter_mut().zip(vectors).for_each(|(sum, y)| *sum += x * y);
            }
            sums
        })
    }

    pub(super) fn add_combinations<const N: usize>(
        weights: &[[f32; N]; TALL],
        rows: [&[f32]; TALL],
        vectors: &mut [[f32; N]],
    ) {
        for (weights, row) in weights.iter().zip(rows) {
            for (vectors, &x) in vectors.iter_mut().zip(row) {
                vectors.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += weight * x);
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use std::arch::x86_64::{
        __m256, _mm256_fmadd_ps, _mm256_loadu_ps, _mm256_set1_ps, _mm256_setzero_ps, _mm256_storeu_ps,
    };

    use super::{LANES, TALL};

    /// # Safety
    /// No row is shorter than `vectors`.
    #[target_feature(enable = "avx2,fma")]
    pub(super) unsafe fn scalar_products<const N: usize>(
        rows: [&[f32]; TALL],
        vectors: &[[f32; N]],
    ) -> [[f32; N]; TALL] {
        let mut sums = [[_mm256_setzero_ps(); 2]; TALL];
        for (i, vectors) in vectors.iter().enumerate() {
            let [low, high] = load(vectors);
            for (sums, row) in sums.iter_mut().zip(&rows) {
                // SAFETY: the caller's promise.
                let x = _mm256_set1_ps(*unsafe { row.get_unchecked(i) });
                *sums = [_mm256_fmadd_ps(x, low, sums[0]), _mm256_fmadd_ps(x, high, sums[1])];
            }
        }
        let mut out = [[0.0; N]; TALL];
        for (out, sums) in out.iter_mut().zip(sums) {
            *out = store(sums);
        }
        out
    }

    /// # Safety
    /// No row is shorter than `vectors`.
    #[target_feature(enable = "avx2,fma")]
    pub(super) unsafe fn add_combinations<const N: usize>(
        weights: &[[f32; N]; TALL],
        rows: [&[f32]; TALL],
        vectors: &mut [[f32; N]],
    ) {
        let mut registers = [[_mm256_setzero_ps(); 2]; TALL];
        for (registers, weights) in registers.iter_mut().zip(weights) {
            *registers = load(weights);
        }
        for (i, vectors) in vectors.iter_mut().enumerate() {
            let [mut low, mut high] = load(vectors);
            for (weights, row) in registers.iter().zip(&rows) {
                // SAFETY: the caller's promise.
                let x = _mm256_set1_ps(*unsafe { row.get_unchecked(i) });
                (low, high) = (_mm256_fmadd_ps(x, weights[0], low), _mm256_fmadd_ps(x, weights[1], high));
            }
            *vectors = store([low, high]);
        }
    }

    #[target_feature(enable = "avx2")]
    fn load<const N: usize>(values: &[f32; N]) -> [__m256; 2] {
        let mut registers = [_mm256_setzero_ps(); 2];
        for (register, values) in registers.iter_mut().zip(values.as_chunks::<LANES>().0) {
            // SAFETY: an array of one register.
            *register = unsafe { _mm256_loadu_ps(values.as_ptr()) };
        }
        registers
    }

    #[target_feature(enable = "avx2")]
    fn store<const N: usize>(registers: [__m256; 2]) -> [f32; N] {
        let mut out = [0.0; N];
        for (out, register) in out.as_chunks_mut::<LANES>().0.iter_mut().zip(registers) {
            // SAFETY: an array of one register.
            unsafe { _mm256_storeu_ps(out.as_mut_ptr(), register) };
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn both_ways_agree_up_to_rounding() {
        let mut rng = Random::new([1, 4]);
        for len in [0, 1, 5, 64, 257] {
            let rows: [Vec<f32>; TALL] = std::array::from_fn(|i| (0..len + i).map(|_| rng.normal()).collect());
            let rows = rows.each_ref().map(Vec::as_slice);
            both_ways_agree::<WIDE>(rows, len, &mut rng);
            both_ways_agree::<LANES>(rows, len, &mut rng);
        }
    }

    fn both_ways_agree<const N: usize>(rows: [&[f32]; TALL], len: usize, rng: &mut Random) {
        let vectors: Vec<[f32; N]> = (0..len).map(|_| std::array::from_fn(|_| rng.normal())).collect();
        let agree = |best: &[[f32; N]], plain: &[[f32; N]]| {
            let mut pairs = best.iter().flatten().zip(plain.iter().flatten());
            assert!(pairs.all(|(x, y)| (x - y).abs() < 1e-4), "{len}");
        };
        let weights = scalar_products(rows, &vectors);
        agree(&weights, &plain::scalar_products(rows, &vectors));
        let (mut best, mut plain) = (vectors.clone(), vectors);
        add_combinations(&weights, rows, &mut best);
        plain::add_combinations(&weights, rows, &mut plain);
        agree(&best, &plain);
    }
}
