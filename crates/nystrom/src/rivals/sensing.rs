//! Compressed sensing of every row \[Peers2009\], \[Sen2009\]: a few random measurements of it, from which a sparse vector of Haar
//! coefficients is found by orthogonal matching pursuit \[Tropp2007\].
//!
//! What is measured are products of the matrix with random signs, the same for all rows. Rank k stands for as many measurements
//! per row as factors of that rank have numbers per row, `k (m + n) / m`, and for half as many coefficients (each is a
//! value and a place). The right factor is the Haar basis, which nobody has to store. Unlike all other methods this one is not exact
//! at full rank: it is where the rows are sparse in the basis.

use nalgebra::{DMatrix, DVector};

use super::{
    Approximation, MethodError,
    real::{Real, largest},
};
use crate::random::Random;

pub(super) fn compressed_sensing<S: Real>(
    matrix: &DMatrix<S>,
    rank: usize,
    rng: &mut Random,
) -> Result<Approximation<S>, MethodError> {
    let (n_rows, n_cols) = matrix.shape();
    let n_measurements = (rank * (n_rows + n_cols)).div_ceil(n_rows).min(n_cols);
    let sign = |bits: u64| if bits >> 63 == 0 { S::one() } else { -S::one() };
    let patterns = DMatrix::from_fn(n_measurements, n_cols, |_, _| sign(rng.bits()));
    let haar = haar(n_cols);
    let measured = &patterns * matrix.transpose();
    let mut dictionary = patterns * haar.transpose();
    let norms: Vec<S> = dictionary.column_iter().map(|atom| atom.norm()).collect();
    // An atom that all patterns miss cannot be told from nothing; it stays zero and is never chosen.
    let sizes: Vec<S> = norms.iter().map(|&x| if x > S::zero() { x } else { S::one() }).collect();
    dictionary.column_iter_mut().zip(&sizes).for_each(|(mut atom, &size)| atom /= size);
    let mut coefficients = DMatrix::zeros(n_rows, n_cols);
    let mut n_values = 0;
    for (row, measured) in measured.column_iter().enumerate() {
        for (atom, value) in pursue(&dictionary, &measured.into_owned(), (n_measurements / 2).max(1))? {
            coefficients[(row, atom)] = value / sizes[atom];
            n_values += 2;
        }
    }
    Ok(Approximation::sparse_product(coefficients, haar, n_values))
}

/// Orthogonal matching pursuit: the atom most like what is left comes next; all chosen ones are fitted anew.
fn pursue<S: Real>(dictionary: &DMatrix<S>, signal: &DVector<S>, most: usize) -> Result<Vec<(usize, S)>, MethodError> {
    let floor = signal.norm() * S::EPSILON * S::nearest(8.0);
    let (mut rest, mut atoms) = (signal.clone(), Vec::new());
    let mut basis: Vec<DVector<S>> = Vec::new();
    while atoms.len() < most && rest.norm() > floor {
        let likeness = dictionary.tr_mul(&rest);
        let Some(atom) = largest(likeness.iter().copied(), |atom| !atoms.contains(&atom)) else { break };
        let mut direction = dictionary.column(atom).into_owned();
        for _ in 0..2 {
            for known in &basis {
                direction.axpy(-known.dot(&direction), known, S::one());
            }
        }
        // Atoms are of norm 1: one that the others make up adds nothing but rounding.
        if direction.norm() <= S::EPSILON.sqrt() {
            break;
        }
        direction.normalize_mut();
        rest.axpy(-direction.dot(&rest), &direction, S::one());
        basis.push(direction);
        atoms.push(atom);
    }
    if atoms.is_empty() {
        return Ok(Vec::new());
    }
    // The chosen atoms are Q T; what fits the signal best solves T x = Qᵀ signal.
    let q = DMatrix::from_columns(&basis);
    let triangle = q.tr_mul(&dictionary.select_columns(&atoms));
    let values = triangle.solve_upper_triangular(&q.tr_mul(signal));
    let values = values.ok_or(MethodError::Singular { size: atoms.len() })?;
    Ok(atoms.into_iter().zip(values.iter().copied()).collect())
}

/// Haar's orthonormal basis, a function per row: the mean, then differences of halves of ever shorter pieces. Pieces of odd length
/// have halves of unlike length.
pub(super) fn haar<S: Real>(n: usize) -> DMatrix<S> {
    let mut basis = DMatrix::zeros(n, n);
    basis.row_mut(0).fill(S::one() / S::nearest(n as f64).sqrt());
    let (mut next, mut pieces) = (1, Vec::from_iter(std::iter::once(0..n)));
    while let Some(piece) = pieces.pop().filter(|_| next < n) {
        let middle = piece.start + piece.len() / 2;
        let (first, second) = (piece.start..middle, middle..piece.end);
        if first.is_empty() {
            continue;
        }
        let height = |own: usize, other: usize| S::nearest((other as f64 / (own as f64 * piece.len() as f64)).sqrt());
        let (of_first, of_second) = (height(first.len(), second.len()), -height(second.len(), first.len()));
        first.clone().for_each(|col| basis[(next, col)] = of_first);
        second.clone().for_each(|col| basis[(next, col)] = of_second);
        next += 1;
        pieces.extend([first, second]);
    }
    basis
}
