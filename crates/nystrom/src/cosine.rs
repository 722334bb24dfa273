//! Orthonormal cosine transforms of what lies on a grid: neighbors are alike, so most of the energy comes to lie in few
//! coefficients \[Ahmed1974\]. Being orthonormal, the transform leaves every sum of squares as it is.

use std::f64::consts::PI;

/// The transforms of all lengths up to some longest one.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Cosines {
    by_len: Vec<Matrix>,
}

/// One transform, row-major: coefficient × place, and place × coefficient.
#[derive(Clone, Debug, Default, PartialEq)]
struct Matrix {
    forward: Vec<f32>,
    inverse: Vec<f32>,
}

/// Values that are worked on at a time.
const CHUNK: usize = 128;

/// From values to coefficients, or back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Direction {
    Forward,
    Inverse,
}

impl Cosines {
    /// Transforms of the lengths asked for.
    pub(crate) fn new(lens: impl IntoIterator<Item = u32>) -> Self {
        let mut by_len = Vec::new();
        for len in lens {
            let len = len as usize;
            by_len.resize(by_len.len().max(len + 1), Matrix::default());
            if by_len[len].forward.is_empty() {
                let forward = cosines(len);
                let inverse = (0..len * len).map(|at| forward[at % len * len + at / len]).collect();
                by_len[len] = Matrix { forward, inverse };
            }
        }
        Self { by_len }
    }

    /// Transforms along one axis: element i of line (a, b) is at `a · i_max · inner + i · inner + b`, where `inner` is the
    /// product of the lengths of the axes behind.
    pub(crate) fn along(&self, values: &mut [f32], len: u32, inner: usize, direction: Direction) {
        let n = len as usize;
        if n < 2 || values.is_empty() {
            return;
        }
        let Matrix { forward, inverse } = &self.by_len[n];
        // Column `from` of the matrix that is applied is row `from` of its transpose.
        let (matrix, columns) = match direction {
            Direction::Forward => (forward, inverse),
            Direction::Inverse => (inverse, forward),
        };
        let (mut out, mut lit) = (vec![0.0; n * CHUNK.min(inner)], Vec::new());
        for slab in values.chunks_exact_mut(n * inner) {
            if inner == 1 {
                out.fill(0.0);
                for (x, column) in slab.iter().zip(columns.chunks_exact(n)).filter(|(x, _)| **x != 0.0) {
                    out.iter_mut().zip(column).for_each(|(out, weight)| *out += weight * x);
                }
                slab.copy_from_slice(&out);
                continue;
            }
            for first in (0..inner).step_by(CHUNK) {
                let len = CHUNK.min(inner - first);
                // Most cosines of a file are 0, many of them side by side.
                let is_lit = |from: &usize| slab[from * inner + first..][..len].iter().any(|x| *x != 0.0);
                lit.clear();
                lit.extend((0..n).filter(is_lit));
                for (out, weights) in out.chunks_exact_mut(len).zip(matrix.chunks_exact(n)) {
                    out.fill(0.0);
                    for &from in &lit {
                        let (slab, weight) = (&slab[from * inner + first..][..len], weights[from]);
                        out.iter_mut().zip(slab).for_each(|(out, x)| *out += weight * x);
                    }
                }
                for (to, out) in out.chunks_exact(len).take(n).enumerate() {
                    slab[to * inner + first..][..len].copy_from_slice(out);
                }
            }
        }
    }

    /// Transforms planes of width × height that follow each other.
    pub(crate) fn planes(&self, values: &mut [f32], [width, height]: [u32; 2], direction: Direction) {
        self.along(values, width, 1, direction);
        self.along(values, height, width as usize, direction);
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
