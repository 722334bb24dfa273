//! What a method makes of a matrix.

use nalgebra::DMatrix;

use super::real::{Real, scaled};

/// A matrix in fewer numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct Approximation<S: Real> {
    parts: Parts<S>,
    n_values: usize,
}

#[derive(Clone, Debug, PartialEq)]
enum Parts<S: Real> {
    /// `left · right`.
    Product { left: DMatrix<S>, right: DMatrix<S> },
    /// Entry by entry the root of `left · right`, times 2^exponent.
    Root { left: DMatrix<S>, right: DMatrix<S>, gamma: S, exponent: i32 },
}

impl<S: Real> Approximation<S> {
    /// `left · right`, rows × rank and rank × columns.
    pub(super) fn product(left: DMatrix<S>, right: DMatrix<S>) -> Self {
        Self { n_values: left.len() + right.len(), parts: Parts::Product { left, right } }
    }

    /// A product one factor of which is known without being stored, or stored in fewer numbers than it has entries.
    pub(super) fn sparse_product(left: DMatrix<S>, right: DMatrix<S>, n_values: usize) -> Self {
        Self { n_values, parts: Parts::Product { left, right } }
    }

    /// A product to whose entries the inverse of `x ↦ x^gamma` is applied.
    pub(super) fn root(left: DMatrix<S>, right: DMatrix<S>, gamma: S) -> Self {
        Self { n_values: left.len() + right.len() + 1, parts: Parts::Root { left, right, gamma, exponent: 0 } }
    }

    /// The same times a power of two.
    pub(super) fn times_power_of_two(mut self, by: i32) -> Self {
        match &mut self.parts {
            Parts::Product { left, .. } => left.apply(|x| *x = scaled(*x, by)),
            Parts::Root { exponent, .. } => *exponent += by,
        }
        self
    }

    /// All entries.
    pub fn to_dense(&self) -> DMatrix<S> {
        match &self.parts {
            Parts::Product { left, right } => left * right,
            Parts::Root { left, right, gamma, exponent } => {
                (left * right).map(|x| scaled(signed_power(x, S::one() / *gamma), *exponent))
            }
        }
    }

    /// Factors no wider than the lesser side of the matrix: its own, or else all entries and a unit matrix.
    pub fn into_factors(self) -> (DMatrix<S>, DMatrix<S>) {
        match self.parts {
            Parts::Product { left, right } if left.ncols() <= left.nrows().min(right.ncols()) => (left, right),
            _ => in_full(self.to_dense()),
        }
    }

    /// How many numbers are stored. For a sparse factor, value and place count as two.
    pub fn n_values(&self) -> usize {
        self.n_values
    }

    /// Rows × rank and rank × columns, the product of which is [`Approximation::to_dense`]; `None` where no product of
    /// factors gives the entries, so that the product with a vector takes all entries.
    pub fn factors(&self) -> Option<(&DMatrix<S>, &DMatrix<S>)> {
        match &self.parts {
            Parts::Product { left, right } => Some((left, right)),
            Parts::Root { .. } => None,
        }
    }
}

/// All entries as one factor, the other being the unit matrix of the lesser side.
fn in_full<S: Real>(dense: DMatrix<S>) -> (DMatrix<S>, DMatrix<S>) {
    match dense.shape() {
        (n_rows, n_cols) if n_cols <= n_rows => (dense, DMatrix::identity(n_cols, n_cols)),
        (n_rows, _) => (DMatrix::identity(n_rows, n_rows), dense),
    }
}

/// `x^power` of the magnitude, with the sign of x.
pub(super) fn signed_power<S: Real>(x: S, power: S) -> S {
    if x == S::zero() { x } else { x.abs().powf(power).copysign(x) }
}
