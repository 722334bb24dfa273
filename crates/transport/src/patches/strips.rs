//! Sums of rows of a table, strip of columns by strip: a strip is so narrow that all of its rows stay close to the processor
//! while one sum after another asks for some of them, and that the sums themselves stay in registers.

use rayon::prelude::*;

pub(super) use super::vector::Link;
use super::vector::{STRIP, sums};

/// A table whose columns lie in strips, the last of which is filled up with zeros.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Strips {
    n_cols: usize,
    /// Strip by strip: its rows.
    strips: Vec<Vec<[f32; STRIP]>>,
}

impl Strips {
    /// A table of zeros.
    pub fn zeros(n_rows: usize, n_cols: usize) -> Strips {
        Strips { n_cols, strips: vec![vec![[0.0; STRIP]; n_rows]; n_cols.div_ceil(STRIP)] }
    }

    /// A table that is given row by row.
    pub fn of(table: &[f32], n_cols: usize) -> Strips {
        let strip = |nth: usize| -> Vec<[f32; STRIP]> {
            let from = nth * STRIP;
            let len = STRIP.min(n_cols - from);
            let part = |row: &[f32]| {
                let mut part = [0.0; STRIP];
                part[..len].copy_from_slice(&row[from..from + len]);
                part
            };
            table.chunks_exact(n_cols).map(part).collect()
        };
        Strips { n_cols, strips: (0..n_cols.div_ceil(STRIP)).into_par_iter().map(strip).collect() }
    }

    /// The table row by row.
    pub fn row_major(&self) -> Vec<f32> {
        let n_rows = self.strips.first().map_or(0, Vec::len);
        let mut out = vec![0.0; n_rows * self.n_cols];
        out.par_chunks_mut(self.n_cols.max(1)).enumerate().for_each(|(row, out)| {
            for (out, strip) in out.chunks_mut(STRIP).zip(&self.strips) {
                out.copy_from_slice(&strip[row][..out.len()]);
            }
        });
        out
    }

    /// These rows, each with a sum of rows of a table added to it; the table has as many columns.
    pub fn plus(&self, links: &[Vec<Link>], table: &Strips) -> Strips {
        let strips = self.strips.par_iter().zip(&table.strips);
        let strips = strips.map(|(base, table)| sums(base, links, table)).collect();
        Strips { n_cols: self.n_cols, strips }
    }

    /// Adds what changed, so many times more.
    pub fn extrapolate(&mut self, before: &Strips, times: f32) {
        self.strips.par_iter_mut().zip(&before.strips).for_each(|(strip, before)| {
            let numbers = strip.as_flattened_mut().iter_mut().zip(before.as_flattened());
            numbers.for_each(|(x, before)| *x += times * (*x - before));
        });
    }

    /// Sum of the sizes of differences.
    pub fn distance(&self, other: &Strips) -> f64 {
        let part = |(a, b): (&Vec<[f32; STRIP]>, &Vec<[f32; STRIP]>)| {
            let mut sums = [0.0f64; STRIP];
            for (a, b) in a.iter().zip(b) {
                (0..STRIP).for_each(|k| sums[k] += f64::from((a[k] - b[k]).abs()));
            }
            sums.iter().sum::<f64>()
        };
        // Summed in order, so that threads do not change it.
        self.strips.par_iter().zip(&other.strips).map(part).collect::<Vec<f64>>().iter().sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::patches::vector::tests::numbers;
    use crate::sampler::uniform_hash;

    #[test]
    fn a_table_comes_back_from_its_strips() {
        for n_cols in [1, 15, 16, 17, 50] {
            let table = numbers(7 * n_cols, 1);
            assert_eq!(Strips::of(&table, n_cols).row_major(), table);
            assert_eq!(Strips::zeros(7, n_cols).row_major(), vec![0.0; 7 * n_cols]);
        }
    }

    #[test]
    fn sums_of_rows_are_those_that_are_taken_one_by_one() {
        let (n_rows, n_cols) = (30, 21);
        let (base, table) = (numbers(3 * n_cols, 1000), numbers(n_rows * n_cols, 2000));
        let link = |nth: u64| ((uniform_hash(2 * nth) * n_rows as f32) as u32, uniform_hash(2 * nth + 1) - 0.5);
        let links: Vec<Vec<Link>> = [0, 1, 50].map(|n| (0..n).map(link).collect::<Vec<Link>>()).to_vec();
        let found = Strips::of(&base, n_cols).plus(&links, &Strips::of(&table, n_cols)).row_major();
        for (at, found) in found.iter().enumerate() {
            let (row, column) = (at / n_cols, at % n_cols);
            let term = |&(of, weight): &Link| weight * table[of as usize * n_cols + column];
            let expected = base[at] + links[row].iter().map(term).sum::<f32>();
            assert!((found - expected).abs() < 1e-5, "{found} for {expected}");
        }
    }

    #[test]
    fn distances_are_sums_of_differences_and_what_changed_goes_on() {
        let (a, b) = (numbers(5 * 21, 1), numbers(5 * 21, 500));
        let (mut now, before) = (Strips::of(&a, 21), Strips::of(&b, 21));
        let expected: f64 = a.iter().zip(&b).map(|(a, b)| f64::from((a - b).abs())).sum();
        assert!((now.distance(&before) - expected).abs() < 1e-9 * expected);
        now.extrapolate(&before, 0.5);
        let expected: Vec<f32> = a.iter().zip(&b).map(|(a, b)| a + 0.5 * (a - b)).collect();
        assert_eq!(now.row_major(), expected);
    }
}
