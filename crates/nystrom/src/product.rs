//! Products of matrices: general ones, and those of a whole block with a basis of a few vectors.
//!
//! nalgebra multiplies strided views without a copy, so that a transpose costs nothing; that is for what is small.
//! A block is read where it lies and only once: general libraries copy it into panels first, which costs more than the
//! product with so few vectors.

use std::{array, ops::Range};

use nalgebra::{DMatrixViewMut, RealField};

use crate::{
    dense::{Dense, View, add_scaled, dot},
    vector::{LANES, TALL, WIDE, add_combinations, scalar_products},
};

/// `rows · basisᵀ`: the coefficients of each row in a basis of row vectors.
pub(crate) fn coefficients(rows: &Dense<f32>, basis: &Dense<f32>) -> Dense<f32> {
    assert!(rows.n_cols == basis.n_cols, "rows of {} and {} columns", rows.n_cols, basis.n_cols);
    let mut out = Dense::zeros(rows.n_rows, basis.n_rows);
    for columns in few_at_a_time(basis.n_rows) {
        match columns.len() {
            ..=LANES => few_coefficients::<LANES>(rows, basis, columns, &mut out),
            _ => few_coefficients::<WIDE>(rows, basis, columns, &mut out),
        }
    }
    out
}

fn few_coefficients<const N: usize>(
    rows: &Dense<f32>,
    basis: &Dense<f32>,
    columns: Range<usize>,
    out: &mut Dense<f32>,
) {
    let vectors = side_by_side::<N>(basis, &columns);
    for row in (0..rows.n_rows).step_by(TALL) {
        let products = scalar_products(tile(rows, row), &vectors);
        for (row, products) in (row..rows.n_rows).zip(&products) {
            out.row_mut(row)[columns.clone()].copy_from_slice(&products[..columns.len()]);
        }
    }
}

/// `weightsᵀ · rows`: one combination of all rows per column of the weights.
pub(crate) fn combinations(weights: &Dense<f32>, rows: &Dense<f32>) -> Dense<f32> {
    assert!(weights.n_rows == rows.n_rows, "{} weights for {} rows", weights.n_rows, rows.n_rows);
    let mut out = Dense::zeros(weights.n_cols, rows.n_cols);
    for columns in few_at_a_time(weights.n_cols) {
        match columns.len() {
            ..=LANES => few_combinations::<LANES>(weights, rows, columns, &mut out),
            _ => few_combinations::<WIDE>(weights, rows, columns, &mut out),
        }
    }
    out
}

fn few_combinations<const N: usize>(
    weights: &Dense<f32>,
    rows: &Dense<f32>,
    columns: Range<usize>,
    out: &mut Dense<f32>,
) {
    let mut sums = vec![[0.0; N]; rows.n_cols];
    for row in (0..rows.n_rows).step_by(TALL) {
        let mut of_tile = [[0.0; N]; TALL];
        for (row, of_row) in (row..rows.n_rows).zip(&mut of_tile) {
            of_row[..columns.len()].copy_from_slice(&weights.row(row)[columns.clone()]);
        }
        add_combinations(&of_tile, tile(rows, row), &mut sums);
    }
    put(&sums, [1.0; N], columns, out);
}

/// `C⁺ᵀ · rows` where C are the rows' coefficients in a basis and C⁺ is C with columns of norm 1: a step of a power iteration,
/// for which the rows are read but once.
pub(crate) fn power_step(rows: &Dense<f32>, basis: &Dense<f32>) -> Dense<f32> {
    assert!(rows.n_cols == basis.n_cols, "rows of {} and {} columns", rows.n_cols, basis.n_cols);
    let mut out = Dense::zeros(basis.n_rows, rows.n_cols);
    for columns in few_at_a_time(basis.n_rows) {
        match columns.len() {
            ..=LANES => few_power_steps::<LANES>(rows, basis, columns, &mut out),
            _ => few_power_steps::<WIDE>(rows, basis, columns, &mut out),
        }
    }
    out
}

fn few_power_steps<const N: usize>(rows: &Dense<f32>, basis: &Dense<f32>, columns: Range<usize>, out: &mut Dense<f32>) {
    let vectors = side_by_side::<N>(basis, &columns);
    let mut energies = [0.0; N];
    let mut sums = vec![[0.0; N]; rows.n_cols];
    for row in (0..rows.n_rows).step_by(TALL) {
        let mut products = scalar_products(tile(rows, row), &vectors);
        products[TALL.min(rows.n_rows - row)..].fill([0.0; N]);
        for products in &products {
            energies.iter_mut().zip(products).for_each(|(energy, x)| *energy += x * x);
        }
        add_combinations(&products, tile(rows, row), &mut sums);
    }
    put(&sums, energies.map(|energy| if energy > 0.0 { 1.0 / energy.sqrt() } else { 0.0 }), columns, out);
}

/// As many vectors as are worked on at a time.
fn few_at_a_time(n_vectors: usize) -> impl Iterator<Item = Range<usize>> {
    (0..n_vectors).step_by(WIDE).map(move |first| first..n_vectors.min(first + WIDE))
}

/// Some vectors of a basis with their entries side by side, and zeros.
fn side_by_side<const N: usize>(basis: &Dense<f32>, vectors: &Range<usize>) -> Vec<[f32; N]> {
    let mut out = vec![[0.0; N]; basis.n_cols];
    for (v, row) in vectors.clone().enumerate() {
        out.iter_mut().zip(basis.row(row)).for_each(|(to, &x)| to[v] = x);
    }
    out
}

/// Some rows from a first one on; past the end the last one is repeated.
fn tile(rows: &Dense<f32>, first: usize) -> [&[f32]; TALL] {
    array::from_fn(|i| rows.row((first + i).min(rows.n_rows - 1)))
}

/// Scaled vectors whose entries lie side by side become some rows of `out`.
fn put<const N: usize>(vectors: &[[f32; N]], scales: [f32; N], rows: Range<usize>, out: &mut Dense<f32>) {
    for (v, row) in rows.enumerate() {
        out.row_mut(row).iter_mut().zip(vectors).for_each(|(to, from)| *to = scales[v] * from[v]);
    }
}

/// `a · b`.
pub(crate) fn product<T: RealField + Copy>(a: View<'_, T>, b: View<'_, T>) -> Dense<T> {
    assert!(a.n_cols == b.n_rows, "inner sizes {} and {} differ", a.n_cols, b.n_rows);
    let mut out = Dense::zeros(a.n_rows, b.n_cols);
    // Below six rows or columns the blocked product does not pay (and nalgebra would walk against the strides).
    if a.n_rows.min(a.n_cols).min(b.n_cols) < 6 {
        thin_product(a, b, &mut out);
    } else {
        let (n_rows, n_cols) = (out.n_rows, out.n_cols);
        DMatrixViewMut::from_slice_with_strides_mut(&mut out.data, n_rows, n_cols, n_cols, 1).gemm(
            T::one(),
            &a.nalgebra(),
            &b.nalgebra(),
            T::zero(),
        );
    }
    out
}

/// `a · b` where one of the sizes is small.
fn thin_product<T: RealField + Copy>(a: View<'_, T>, b: View<'_, T>, out: &mut Dense<T>) {
    if a.col_stride == 1 && b.row_stride == 1 {
        for (row, col) in (0..a.n_rows).flat_map(|row| (0..b.n_cols).map(move |col| (row, col))) {
            let left = &a.data[row * a.row_stride..][..a.n_cols];
            out.row_mut(row)[col] = dot(left, &b.data[col * b.col_stride..][..a.n_cols]);
        }
    } else if b.col_stride == 1 {
        for (inner, row) in (0..a.n_cols).flat_map(|inner| (0..a.n_rows).map(move |row| (inner, row))) {
            add_scaled(out.row_mut(row), a.at(row, inner), &b.data[inner * b.row_stride..][..b.n_cols]);
        }
    } else {
        for (row, col) in (0..a.n_rows).flat_map(|row| (0..b.n_cols).map(move |col| (row, col))) {
            out.row_mut(row)[col] =
                (0..a.n_cols).fold(T::zero(), |sum, inner| sum + a.at(row, inner) * b.at(inner, col));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{dense::tests::random, random::Random};

    #[test]
    fn products_with_a_block_agree_with_the_definition() {
        let mut rng = Random::new([1, 3]);
        for (m, n, k) in
            [(1, 1, 1), (4, 16, 8), (7, 33, 9), (50, 40, 16), (21, 5, 25), (12, 30, 60), (9, 4, 0), (0, 3, 2)]
        {
            let (rows, basis, weights) = (random(m, n, &mut rng), random(k, n, &mut rng), random(m, k, &mut rng));
            let agree = |got: Dense<f32>, want: Dense<f32>| {
                assert_eq!((got.n_rows, got.n_cols), (want.n_rows, want.n_cols));
                assert!(got.data.iter().zip(&want.data).all(|(got, want)| (got - want).abs() < 1e-4), "{m} {n} {k}");
            };
            let met = product(rows.view(), basis.t());
            agree(coefficients(&rows, &basis), met.clone());
            agree(combinations(&weights, &rows), product(weights.t(), rows.view()));
            let mut want = product(met.t(), rows.view());
            for v in 0..k {
                let norm = met.gather_cols(&[v]).data.iter().map(|x| x * x).sum::<f32>().sqrt();
                want.row_mut(v).iter_mut().for_each(|x| *x = if norm > 0.0 { *x / norm } else { 0.0 });
            }
            agree(power_step(&rows, &basis), want);
        }
    }

    #[test]
    fn thin_and_blocked_products_agree_with_the_definition() {
        let mut rng = Random::new([1, 2]);
        for (m, k, n) in [(1, 1, 1), (9, 30, 4), (3, 40, 17), (20, 31, 22), (7, 2, 9), (12, 0, 3)] {
            let (a, b) = (random(m, k, &mut rng), random(k, n, &mut rng));
            let bt = Dense {
                n_rows: n,
                n_cols: k,
                data: (0..n * k).map(|i| b.data[i % k.max(1) * n + i / k.max(1)]).collect(),
            };
            let at = Dense { n_rows: k, n_cols: m, data: (0..k * m).map(|i| a.data[i % m * k + i / m]).collect() };
            for out in [
                product(a.view(), b.view()),
                product(a.view(), bt.t()),
                product(at.t(), b.view()),
                product(at.t(), bt.t()),
            ] {
                for (row, col) in (0..m).flat_map(|row| (0..n).map(move |col| (row, col))) {
                    let want: f32 = (0..k).map(|i| a.row(row)[i] * b.row(i)[col]).sum();
                    assert!((out.row(row)[col] - want).abs() < 1e-4, "{m} {k} {n}: {} {want}", out.row(row)[col]);
                }
            }
        }
    }
}
