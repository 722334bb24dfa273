//! Factors in the form of a singular value decomposition, whoever made them: what is stored of each component is then worth
//! its singular value, and no product of two components is stored twice.

use half::{f16, slice::HalfFloatSliceExt};

use crate::{
    dense::{Dense, eigen},
    factors::BlockFactors,
    product::product,
};

/// `weights · left · right` with orthogonal columns and orthonormal rows, largest first.
#[derive(Clone, Debug)]
pub(super) struct Orthogonal {
    /// One per component: the norm of its column of `left`.
    pub(super) singular: Vec<f64>,
    /// Components × rows: the columns of `left`, one after the other.
    pub(super) left: Dense<f32>,
    /// Components × columns.
    pub(super) right: Dense<f32>,
}

impl Orthogonal {
    /// `weights` has one number per row.
    pub(super) fn new(factors: &BlockFactors, weights: &[f32]) -> Self {
        let (mut left, right) = both(factors);
        (0..left.n_rows).for_each(|row| left.row_mut(row).iter_mut().for_each(|x| *x *= f64::from(weights[row])));

        // Rows first: right = basis of its span, and left takes what turns the one into the other.
        let (basis, to_basis) = orthonormal_rows(&right);
        let left = product(left.view(), to_basis.view());
        // Then columns, by the small Gram matrix; the same rotation turns the rows.
        let (energies, turn) = eigen(&product(left.t(), left.view()));
        Self {
            singular: energies.iter().map(|energy| energy.sqrt()).collect(),
            left: product(turn.t(), left.t()).to_f32(),
            right: product(turn.t(), basis.view()).to_f32(),
        }
    }
}

/// `left · diag(scale)` and `right` in double precision.
pub(super) fn both(factors: &BlockFactors) -> (Dense<f64>, Dense<f64>) {
    let (m, n, k) = (factors.n_rows as usize, factors.n_cols as usize, factors.rank as usize);
    let wide = |halves: &[f16]| {
        let mut values = vec![0.0; halves.len()];
        halves.convert_to_f64_slice(&mut values);
        values
    };
    let (mut left, right) = (wide(&factors.left), wide(&factors.right));
    for row in left.chunks_exact_mut(k.max(1)) {
        row.iter_mut().zip(&factors.scale).for_each(|(x, scale)| *x *= f64::from(*scale));
    }
    (Dense { n_rows: m, n_cols: k, data: left }, Dense { n_rows: k, n_cols: n, data: right })
}

/// Squared difference of two blocks of one size over all entries, sparse ones aside; the first one comes with its [`energy`].
pub(super) fn squared_difference((a, energy_a): (&BlockFactors, f64), b: &BlockFactors) -> f64 {
    let [a, b] = [both(a), both(b)];
    (energy_a + inner_product(&b, &b) - 2.0 * inner_product(&a, &b)).max(0.0)
}

/// Sum of the squared entries of a block, sparse ones aside.
pub(super) fn energy(factors: &BlockFactors) -> f64 {
    let both = both(factors);
    inner_product(&both, &both)
}

/// ⟨L R, M S⟩ = ⟨Lᵀ M, R Sᵀ⟩: only matrices of ranks are multiplied.
fn inner_product((l, r): &(Dense<f64>, Dense<f64>), (m, s): &(Dense<f64>, Dense<f64>)) -> f64 {
    let (lefts, rights) = (product(l.t(), m.view()), product(r.view(), s.t()));
    lefts.data.iter().zip(&rights.data).map(|(x, y)| x * y).sum()
}

/// An orthonormal basis of the span of some rows (basis × columns), and what gives the rows back: rows × basis.
fn orthonormal_rows(rows: &Dense<f64>) -> (Dense<f64>, Dense<f64>) {
    let (energies, vectors) = eigen(&product(rows.view(), rows.t()));
    let mut basis = product(vectors.t(), rows.view());
    let mut back = vectors;
    for (i, energy) in energies.iter().enumerate() {
        let norm = energy.sqrt();
        basis.row_mut(i).iter_mut().for_each(|x| *x /= norm);
        (0..back.n_rows).for_each(|row| back.row_mut(row)[i] *= norm);
    }
    (basis, back)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn the_product_stays_and_components_are_orthogonal() {
        let mut rng = Random::new([31, 0]);
        let (m, n, k) = (20, 15, 5);
        let mut values = |count: usize| (0..count).map(|_| rng.normal()).collect::<Vec<f32>>();
        let (mut left, mut right) = (values(m * k), values(k * n));
        // The last component repeats the first, and the fourth is nothing.
        right.copy_within(0..n, 4 * n);
        (0..m).for_each(|row| left[row * k + 3] = 0.0);
        let factors = BlockFactors::from_f32(&left, &right, m, n, k);
        let orthogonal = Orthogonal::new(&factors, &[1.0; 20]);
        assert_eq!(orthogonal.singular.len(), 3);
        assert!(orthogonal.singular.is_sorted_by(|a, b| a >= b));
        let gram = |x: &Dense<f32>| product(x.to_f64().view(), x.to_f64().t());
        let (left, right) = (gram(&orthogonal.left), gram(&orthogonal.right));
        for i in 0..3 {
            for j in 0..3 {
                let sigma = if i == j { orthogonal.singular[i] } else { 0.0 };
                assert!((left.row(i)[j] - sigma * sigma).abs() < 1e-4);
                assert!((right.row(i)[j] - f64::from(i == j)).abs() < 1e-5);
            }
        }
        let back = product(orthogonal.left.to_f64().t(), orthogonal.right.to_f64().view());
        for (row, got) in back.data.chunks(n).enumerate() {
            got.iter().enumerate().for_each(|(col, x)| assert!((x - f64::from(factors.entry(row, col))).abs() < 1e-5));
        }
    }

    #[test]
    fn the_difference_of_two_blocks_is_that_of_their_entries() {
        let mut rng = Random::new([32, 0]);
        let mut block = |k: usize| {
            let mut values = |count: usize| (0..count).map(|_| rng.normal()).collect::<Vec<f32>>();
            BlockFactors::from_f32(&values(12 * k), &values(k * 9), 12, 9, k)
        };
        let (a, b, none) = (block(3), block(2), block(0));
        let dense = |x: &BlockFactors, y: &BlockFactors| -> f64 {
            x.dense().iter().zip(y.dense()).map(|(x, y)| f64::from(x - y).powi(2)).sum()
        };
        for (x, y) in [(&a, &b), (&a, &none), (&none, &none)] {
            let (got, want) = (squared_difference((x, energy(x)), y), dense(x, y));
            assert!((got - want).abs() <= 1e-5 * want, "{got} {want}");
        }
        assert!(squared_difference((&a, energy(&a)), &a) < 1e-10);
    }

    #[test]
    fn nothing_has_no_components() {
        let zero = BlockFactors::from_f32(&[0.0; 6], &[0.0; 4], 3, 2, 2);
        assert!(Orthogonal::new(&zero, &[1.0; 3]).singular.is_empty());
        assert!(Orthogonal::new(&BlockFactors::default(), &[]).singular.is_empty());
    }
}
