//! Adaptive cross approximation \[Bebendorf2000\]: Gaussian elimination that stops early.
//!
//! One row and one column of what is left are taken at a time. Full pivoting looks for the largest entry of all that is left, partial
//! pivoting only for the largest of a row; it sees no more than the rows and columns that it takes, and what lies in
//! neither may escape it.

use nalgebra::{DMatrix, DVector, RowDVector};

use super::{
    Approximation,
    real::{Real, largest},
};
use crate::random::Random;

/// The crosses so far: the sum of their products is the approximation.
struct Crosses<'a, S: Real> {
    matrix: &'a DMatrix<S>,
    columns: Vec<DVector<S>>,
    rows: Vec<RowDVector<S>>,
}

/// The largest entry of all that is left comes next.
pub(super) fn full<S: Real>(matrix: &DMatrix<S>, rank: usize) -> Approximation<S> {
    let mut crosses = Crosses { matrix, columns: Vec::new(), rows: Vec::new() };
    let mut rest = matrix.clone();
    for _ in 0..rank {
        // Rounding must not bring back a row or a column that is done: they are put to zero below.
        let Some(place) = largest(rest.iter().copied(), |_| true) else { break };
        let (row, col) = (place % rest.nrows(), place / rest.nrows());
        let (column, line) = (rest.column(col).into_owned(), rest.row(row) / rest[(row, col)]);
        rest.ger(-S::one(), &column, &line.transpose(), S::one());
        rest.row_mut(row).fill(S::zero());
        rest.column_mut(col).fill(S::zero());
        crosses.push(column, line);
    }
    crosses.finish()
}

/// The largest entry of one row; the next row is where that column is largest. The first row is random, and so is the one
/// after a row of which nothing is left.
pub(super) fn partial<S: Real>(matrix: &DMatrix<S>, rank: usize, rng: &mut Random) -> Approximation<S> {
    let mut crosses = Crosses { matrix, columns: Vec::new(), rows: Vec::new() };
    let (n_rows, n_cols) = matrix.shape();
    let mut fresh = rng.choose(&(0..n_rows).collect::<Vec<_>>(), n_rows);
    let (mut row_done, mut column_done) = (vec![false; n_rows], vec![false; n_cols]);
    let mut next = fresh.pop();
    while let Some(row) = next.filter(|_| crosses.rows.len() < rank) {
        row_done[row] = true;
        let line = crosses.rest_of_row(row);
        let pivot = largest(line.iter().copied(), |col| !column_done[col]);
        next = None;
        if let Some(col) = pivot {
            column_done[col] = true;
            let column = crosses.rest_of_column(col);
            next = largest(column.iter().copied(), |row| !row_done[row]);
            let pivot = line[col];
            crosses.push(column, line / pivot);
        }
        while next.is_none_or(|row| row_done[row]) {
            next = fresh.pop();
            if next.is_none() {
                break;
            }
        }
    }
    crosses.finish()
}

impl<S: Real> Crosses<'_, S> {
    fn push(&mut self, column: DVector<S>, row: RowDVector<S>) {
        self.columns.push(column);
        self.rows.push(row);
    }

    fn rest_of_row(&self, row: usize) -> RowDVector<S> {
        let mut rest = self.matrix.row(row).into_owned();
        for (column, line) in self.columns.iter().zip(&self.rows) {
            rest -= line * column[row];
        }
        rest
    }

    fn rest_of_column(&self, col: usize) -> DVector<S> {
        let mut rest = self.matrix.column(col).into_owned();
        for (column, line) in self.columns.iter().zip(&self.rows) {
            rest.axpy(-line[col], column, S::one());
        }
        rest
    }

    fn finish(self) -> Approximation<S> {
        let (n_rows, n_cols) = self.matrix.shape();
        let left = DMatrix::from_fn(n_rows, self.columns.len(), |i, r| self.columns[r][i]);
        let right = DMatrix::from_fn(self.rows.len(), n_cols, |r, j| self.rows[r][j]);
        Approximation::product(left, right)
    }
}
