//! Orthonormal cosine transforms of what lies on a grid: neighbors are alike, so most of the energy comes to lie in few
//! coefficients \[Ahmed1974\]. Being orthonormal, the transform leaves every sum of squares as it is.

use std::f64::consts::PI;

/// The transforms of all lengths up to some longest one.
#[derive(Clone, Debug)]
pub(super) struct Cosines {
    /// Of length n at n: row-major, coefficient × place.
    by_len: Vec<Vec<f32>>,
}

/// From values to coefficients, or back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Direction {
    Forward,
    Inverse,
}

impl Cosines {
    /// Transforms of the lengths asked for.
    pub(super) fn new(lens: impl IntoIterator<Item = u32>) -> Self {
        let mut by_len = Vec::new();
        for len in lens {
            let len = len as usize;
            by_len.resize(by_len.len().max(len + 1), Vec::new());
            if by_len[len].is_empty() {
                by_len[len] = cosines(len);
            }
        }
        Self { by_len }
    }

    /// Transforms along one axis: element i of line (a, b) is at `a · i_max · inner + i · inner + b`, where `inner` is the
    /// product of the lengths of the axes behind.
    pub(super) fn along(&self, values: &mut [f32], len: u32, inner: usize, direction: Direction) {
        let n = len as usize;
        if n < 2 || values.is_empty() {
            return;
        }
        let matrix = &self.by_len[n];
        let mut out = vec![0.0; n * inner];
        for slab in values.chunks_exact_mut(n * inner) {
            out.fill(0.0);
            match direction {
                Direction::Forward => forward(matrix, slab, &mut out, inner),
                Direction::Inverse => inverse(matrix, slab, &mut out, inner),
            }
            slab.copy_from_slice(&out);
        }
    }

    /// Transforms planes of width × height that follow each other.
    pub(super) fn planes(&self, values: &mut [f32], [width, height]: [u32; 2], direction: Direction) {
        self.along(values, width, 1, direction);
        self.along(values, height, width as usize, direction);
    }
}

/// `out[k] += matrix[k][i] · slab[i]`, `inner` elements at once.
fn forward(matrix: &[f32], slab: &[f32], out: &mut [f32], inner: usize) {
    let n = slab.len() / inner;
    for (out, row) in out.chunks_exact_mut(inner).zip(matrix.chunks_exact(n)) {
        for (slab, weight) in slab.chunks_exact(inner).zip(row) {
            out.iter_mut().zip(slab).for_each(|(out, x)| *out += weight * x);
        }
    }
}

/// `out[i] += matrix[k][i] · slab[k]`, in the order of k. Most coefficients of a file are 0: they are passed over.
fn inverse(matrix: &[f32], slab: &[f32], out: &mut [f32], inner: usize) {
    let n = slab.len() / inner;
    for (slab, row) in slab.chunks_exact(inner).zip(matrix.chunks_exact(n)) {
        match slab {
            [x] if *x != 0.0 => out.iter_mut().zip(row).for_each(|(out, weight)| *out += weight * x),
            slab if slab.iter().any(|x| *x != 0.0) => {
                for (out, weight) in out.chunks_exact_mut(inner).zip(row) {
                    out.iter_mut().zip(slab).for_each(|(out, x)| *out += weight * x);
                }
            }
            _ => {}
        }
    }
}

fn cosines(len: usize) -> Vec<f32> {
    let n = len as f64;
    let entry = |k: usize, i: usize| {
        let norm = if k == 0 { (1.0 / n).sqrt() } else { (2.0 / n).sqrt() };
        norm * (PI * (i as f64 + 0.5) * k as f64 / n).cos()
    };
    (0..len * len).map(|at| entry(at / len, at % len) as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn the_inverse_gives_the_values_back_and_energy_stays() {
        let mut rng = Random::new([3, 1]);
        for [width, height] in [[1, 1], [16, 16], [7, 5], [1, 9], [64, 2]] {
            let cosines = Cosines::new([width, height]);
            let values: Vec<f32> = (0..3 * width * height).map(|_| rng.normal()).collect();
            let mut changed = values.clone();
            cosines.planes(&mut changed, [width, height], Direction::Forward);
            let energy = |x: &[f32]| x.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>();
            assert!((energy(&changed) / energy(&values) - 1.0).abs() < 1e-5);
            cosines.planes(&mut changed, [width, height], Direction::Inverse);
            assert!(changed.iter().zip(&values).all(|(a, b)| (a - b).abs() < 1e-5), "{width} {height}");
        }
    }

    #[test]
    fn what_is_even_becomes_a_single_coefficient() {
        let mut values = vec![2.0; 12];
        Cosines::new([4, 3]).planes(&mut values, [4, 3], Direction::Forward);
        assert!((values[0] - 2.0 * 12f32.sqrt()).abs() < 1e-5);
        assert!(values[1..].iter().all(|x| x.abs() < 1e-5), "{values:?}");
    }
}
