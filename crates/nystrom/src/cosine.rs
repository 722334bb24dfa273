//! Orthonormal cosine transforms of what lies on a grid: neighbors are alike, so most of the energy comes to lie in few
//! coefficients \[Ahmed1974\]. Being orthonormal, the transform leaves every sum of squares as it is.
//!
//! Cosines of even number are mirrored in the middle of the axis, those of odd number change their sign there. So the sums
//! and the differences of places that lie equally far from the middle are transformed apart, which takes half of the products.

use std::f64::consts::PI;

use crate::small_product::SmallProduct;

/// The transforms of all lengths up to some longest one.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Cosines {
    by_len: Vec<[Parity; 2]>,
}

/// The cosines of even or of odd number over the first half of an axis, whose middle counts to the even ones.
#[derive(Clone, Debug, Default, PartialEq)]
struct Parity {
    /// Number of cosines, and of places.
    len: usize,
    /// Row-major, cosine × place.
    forward: Vec<f32>,
    /// Row-major, place × cosine.
    inverse: Vec<f32>,
}

/// Numbers side by side that are worked on at a time.
const CHUNK: usize = 128;
/// Lines that are worked on at a time where the numbers of each lie side by side.
const LINES: usize = 16;

/// From values to coefficients, or back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Direction {
    Forward,
    Inverse,
}

/// What goes through the cosines of one parity, and what comes out.
#[derive(Default)]
struct Passing {
    before: Vec<f32>,
    after: Vec<f32>,
    nonzero: Vec<usize>,
}

impl Cosines {
    /// Transforms of the lengths asked for.
    pub(crate) fn new(lens: impl IntoIterator<Item = u32>) -> Self {
        let mut by_len = Vec::new();
        for len in lens {
            let len = len as usize;
            by_len.resize(by_len.len().max(len + 1), <[Parity; 2]>::default());
            by_len[len] = [0, 1].map(|odd| Parity::new(len, odd));
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
        let (parities, mut passing) = (&self.by_len[n], <[Passing; 2]>::default());
        if inner == 1 {
            for lines in values.chunks_mut(LINES * n) {
                pass_lines(parities, lines, n, direction, &mut passing);
            }
            return;
        }
        for slab in values.chunks_exact_mut(n * inner) {
            for first in (0..inner).step_by(CHUNK) {
                let last = inner.min(first + CHUNK);
                let mut rows: Vec<&mut [f32]> = slab.chunks_exact_mut(inner).map(|row| &mut row[first..last]).collect();
                pass_rows(parities, &mut rows, direction, &mut passing);
            }
        }
    }

    /// Transforms planes of width × height that follow each other.
    pub(crate) fn planes(&self, values: &mut [f32], [width, height]: [u32; 2], direction: Direction) {
        self.along(values, width, 1, direction);
        self.along(values, height, width as usize, direction);
    }
}

impl Parity {
    /// The cosines of numbers 2 k + `odd` of an axis.
    fn new(axis: usize, odd: usize) -> Self {
        let (len, n) = ((axis + 1 - odd) / 2, axis as f64);
        let entry = |k: usize, i: usize| {
            let norm = if k == 0 { (1.0 / n).sqrt() } else { (2.0 / n).sqrt() };
            (norm * (PI * (i as f64 + 0.5) * k as f64 / n).cos()) as f32
        };
        let forward = (0..len * len).map(|at| entry(2 * (at / len) + odd, at % len)).collect();
        let inverse = (0..len * len).map(|at| entry(2 * (at % len) + odd, at / len)).collect();
        Parity { len, forward, inverse }
    }
}

/// Transforms lines that lie across rows of equal length.
fn pass_rows(parities: &[Parity; 2], rows: &mut [&mut [f32]], direction: Direction, [even, odd]: &mut [Passing; 2]) {
    let n_cols = rows[0].len();
    for (passing, parity) in [&mut *even, &mut *odd].into_iter().zip(parities) {
        passing.resize(parity.len * n_cols);
    }
    if direction == Direction::Forward {
        fold_rows(rows, &mut even.before, &mut odd.before);
    } else {
        for (row, even) in rows.iter().step_by(2).zip(even.before.chunks_exact_mut(n_cols)) {
            even.copy_from_slice(row);
        }
        for (row, odd) in rows.iter().skip(1).step_by(2).zip(odd.before.chunks_exact_mut(n_cols)) {
            odd.copy_from_slice(row);
        }
    }
    for (passing, parity) in [&mut *even, &mut *odd].into_iter().zip(parities) {
        let is_nonzero = |i: &usize| passing.before[i * n_cols..][..n_cols].iter().any(|x| *x != 0.0);
        // Most cosines of a file are 0, many of them side by side.
        passing.nonzero.clear();
        passing.nonzero.extend((0..parity.len).filter(is_nonzero));
        let left = if direction == Direction::Forward { &parity.forward } else { &parity.inverse };
        let (right, nonzero) = (&passing.before, &passing.nonzero);
        SmallProduct { left, right, n_inner: parity.len, nonzero, n_cols }.write(&mut passing.after);
    }
    if direction == Direction::Inverse {
        return unfold_rows(&even.after, &odd.after, rows);
    }
    for (row, even) in rows.iter_mut().step_by(2).zip(even.after.chunks_exact(n_cols)) {
        row.copy_from_slice(even);
    }
    for (row, odd) in rows.iter_mut().skip(1).step_by(2).zip(odd.after.chunks_exact(n_cols)) {
        row.copy_from_slice(odd);
    }
}

/// Sums and differences of rows that lie equally far from the middle one.
fn fold_rows(rows: &[&mut [f32]], even: &mut [f32], odd: &mut [f32]) {
    let (n, n_cols) = (rows.len(), rows[0].len());
    for (i, (even, odd)) in even.chunks_exact_mut(n_cols).zip(odd.chunks_exact_mut(n_cols)).enumerate() {
        for ((even, odd), (x, y)) in even.iter_mut().zip(odd).zip(rows[i].iter().zip(rows[n - 1 - i].iter())) {
            (*even, *odd) = (x + y, x - y);
        }
    }
    if n % 2 == 1 {
        even[n / 2 * n_cols..].copy_from_slice(rows[n / 2]);
    }
}

/// The rows of sums and differences.
fn unfold_rows(even: &[f32], odd: &[f32], rows: &mut [&mut [f32]]) {
    let (n, n_cols) = (rows.len(), rows[0].len());
    for (i, (even, odd)) in even.chunks_exact(n_cols).zip(odd.chunks_exact(n_cols)).enumerate() {
        let (first, last) = rows.split_at_mut(n - 1 - i);
        for ((x, y), (even, odd)) in first[i].iter_mut().zip(last[0].iter_mut()).zip(even.iter().zip(odd)) {
            (*x, *y) = (even + odd, even - odd);
        }
    }
    if n % 2 == 1 {
        rows[n / 2].copy_from_slice(&even[n / 2 * n_cols..]);
    }
}

/// Transforms lines of n numbers that follow each other.
fn pass_lines(
    parities: &[Parity; 2],
    lines: &mut [f32],
    n: usize,
    direction: Direction,
    [even, odd]: &mut [Passing; 2],
) {
    let n_lines = lines.len() / n;
    for (passing, parity) in [&mut *even, &mut *odd].into_iter().zip(parities) {
        passing.resize(parity.len * n_lines);
    }
    let (of_even, of_odd) = (parities[0].len, parities[1].len);
    let halves = even.before.chunks_exact_mut(of_even).zip(odd.before.chunks_exact_mut(of_odd));
    for (line, (even, odd)) in lines.chunks_exact(n).zip(halves) {
        if direction == Direction::Forward { fold(line, even, odd) } else { deal(line, even, odd) }
    }
    for (passing, parity) in [&mut *even, &mut *odd].into_iter().zip(parities) {
        let is_nonzero = |i: &usize| passing.before.iter().skip(*i).step_by(parity.len).any(|x| *x != 0.0);
        passing.nonzero.clear();
        passing.nonzero.extend((0..parity.len).filter(is_nonzero));
        let right = if direction == Direction::Forward { &parity.inverse } else { &parity.forward };
        let (left, nonzero) = (&passing.before, &passing.nonzero);
        SmallProduct { left, right, n_inner: parity.len, nonzero, n_cols: parity.len }.write(&mut passing.after);
    }
    let halves = even.after.chunks_exact(of_even).zip(odd.after.chunks_exact(of_odd));
    for (line, (even, odd)) in lines.chunks_exact_mut(n).zip(halves) {
        if direction == Direction::Forward { collect(even, odd, line) } else { unfold(even, odd, line) }
    }
}

/// Sums and differences of numbers that lie equally far from the middle one.
fn fold(line: &[f32], even: &mut [f32], odd: &mut [f32]) {
    let (first, last) = line.split_at(even.len());
    even.copy_from_slice(first);
    for ((even, odd), y) in even.iter_mut().zip(odd).zip(last.iter().rev()) {
        (*even, *odd) = (*even + y, *even - y);
    }
}

/// The line of sums and differences.
fn unfold(even: &[f32], odd: &[f32], line: &mut [f32]) {
    let (first, last) = line.split_at_mut(even.len());
    first.copy_from_slice(even);
    for ((x, y), odd) in first.iter_mut().zip(last.iter_mut().rev()).zip(odd) {
        (*x, *y) = (*x + odd, *x - odd);
    }
}

/// The numbers at even and at odd places.
fn deal(line: &[f32], even: &mut [f32], odd: &mut [f32]) {
    even.iter_mut().zip(line.iter().step_by(2)).for_each(|(even, x)| *even = *x);
    odd.iter_mut().zip(line.iter().skip(1).step_by(2)).for_each(|(odd, x)| *odd = *x);
}

/// The line whose numbers at even and at odd places these are.
fn collect(even: &[f32], odd: &[f32], line: &mut [f32]) {
    line.iter_mut().step_by(2).zip(even).for_each(|(x, even)| *x = *even);
    line.iter_mut().skip(1).step_by(2).zip(odd).for_each(|(x, odd)| *x = *odd);
}

impl Passing {
    fn resize(&mut self, len: usize) {
        self.before.resize(len, 0.0);
        self.after.resize(len, 0.0);
    }
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
    fn coefficients_are_products_with_cosines() {
        let mut rng = Random::new([3, 2]);
        for (n, inner) in [(2, 1), (3, 1), (16, 1), (9, 5), (16, 130), (32, 32)] {
            let values: Vec<f32> = (0..n * inner).map(|_| rng.normal()).collect();
            let mut changed = values.clone();
            Cosines::new([n as u32]).along(&mut changed, n as u32, inner, Direction::Forward);
            for (k, line) in (0..n).flat_map(|k| (0..inner).map(move |line| (k, line))) {
                let norm = if k == 0 { (1.0 / n as f64).sqrt() } else { (2.0 / n as f64).sqrt() };
                let cosine = |i: usize| norm * (PI * (i as f64 + 0.5) * k as f64 / n as f64).cos();
                let want: f64 = (0..n).map(|i| cosine(i) * f64::from(values[i * inner + line])).sum();
                let got = f64::from(changed[k * inner + line]);
                assert!((got - want).abs() < 1e-5, "{n} {inner}, cosine {k}: {got} {want}");
            }
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
