//! Orthonormal rows, with the vector instructions of the machine.
#![cfg_attr(
    target_arch = "x86_64",
    expect(
        unsafe_code,
        reason = "AVX2 behind run-time detection; `extend_plain` is the safe twin with the same results"
    )
)]

use crate::{
    dense::{Dense, add_scaled, dot},
    product::{coefficients, product},
};

/// Adds an orthonormal basis of what the rows of `new` add to the span of the rows of `basis`.
///
/// Gram–Schmidt with pivoting, "twice is enough" \[Giraud2005\]: the largest rest is taken next, so duplicates and zero rows
/// fall out and no intersection matrix is ever inverted. Rests below `1e-6` of their own row or below `3e-7` of the largest new
/// row are rounding, and count as zero.
pub(crate) fn extend_basis(basis: &mut Dense<f32>, new: Dense<f32>) {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") {
        // SAFETY: AVX2 was found.
        return unsafe { extend_avx2(basis, new) };
    }
    extend_plain(basis, new);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn extend_avx2(basis: &mut Dense<f32>, new: Dense<f32>) {
    extend(basis, new);
}

fn extend_plain(basis: &mut Dense<f32>, new: Dense<f32>) {
    extend(basis, new);
}

#[inline(always)]
fn extend(basis: &mut Dense<f32>, mut new: Dense<f32>) {
    let whole = squares(&new);
    let floor = 1e-13 * whole.iter().fold(0.0, |largest: f32, &x| largest.max(x));
    for _ in 0..if basis.n_rows > 0 { 2 } else { 0 } {
        let inside = product(coefficients(&new, basis).view(), basis.view());
        add_scaled(&mut new.data, -1.0, &inside.data);
    }
    for _ in 0..new.n_rows {
        let rests = squares(&new).into_iter().enumerate();
        let told = rests.filter(|&(row, rest)| rest > floor.max(1e-12 * whole[row]));
        let Some((pivot, _)) = told.max_by(|x, y| x.1.total_cmp(&y.1)) else { return };
        if basis.n_rows == basis.n_cols {
            return;
        }
        let mut direction = new.row(pivot).to_vec();
        normalize(&mut direction);
        for row in 0..basis.n_rows {
            let part = dot(&direction, basis.row(row));
            add_scaled(&mut direction, -part, basis.row(row));
        }
        normalize(&mut direction);
        for row in 0..new.n_rows {
            let part = dot(&direction, new.row(row));
            add_scaled(new.row_mut(row), -part, &direction);
        }
        new.row_mut(pivot).fill(0.0);
        basis.data.extend(direction);
        basis.n_rows += 1;
    }
}

/// Energy of each row. A loop, as closures would be compiled for any machine.
#[inline(always)]
fn squares(rows: &Dense<f32>) -> Vec<f32> {
    let mut squares = vec![0.0; rows.n_rows];
    for (row, square) in squares.iter_mut().enumerate() {
        *square = dot(rows.row(row), rows.row(row));
    }
    squares
}

#[inline(always)]
fn normalize(row: &mut [f32]) {
    let scale = 1.0 / dot(row, row).sqrt();
    row.iter_mut().for_each(|x| *x *= scale);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{dense::tests::random, random::Random};

    #[test]
    fn a_basis_is_orthonormal_and_free_of_duplicates_and_zeros() {
        let mut rng = Random::new([3, 4]);
        let mut rows = random(20, 50, &mut rng);
        rows.data.copy_within(0..50, 50);
        rows.row_mut(7).fill(0.0);
        let mut basis = Dense::zeros(0, 50);
        extend_basis(&mut basis, rows.clone());
        extend_basis(&mut basis, rows.clone());
        let mut plain = Dense::zeros(0, 50);
        extend_plain(&mut plain, rows.clone());
        extend_plain(&mut plain, rows);
        assert_eq!(basis, plain);
        assert_eq!(basis.n_rows, 18);
        let gram = product(basis.view(), basis.t());
        for (i, x) in gram.data.iter().enumerate() {
            assert!((x - if i % 19 == 0 { 1.0 } else { 0.0 }).abs() < 2e-6, "{i}: {x}");
        }
    }
}
