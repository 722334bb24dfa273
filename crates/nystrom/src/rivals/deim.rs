//! Rows and columns where the leading singular vectors are largest: DEIM-CUR \[Sorensen2016\].

use nalgebra::DMatrix;

use super::{
    Approximation, Core, MethodError,
    cross::with_core,
    decompose::right_singular,
    real::{Real, largest},
};

/// `C · (C⁺ A R⁺) · R` with rows and columns by discrete empirical interpolation.
pub(super) fn deim_cur<S: Real>(matrix: &DMatrix<S>, rank: usize) -> Result<Approximation<S>, MethodError> {
    let tall = matrix.ncols() <= matrix.nrows();
    let found = right_singular(&if tall { matrix.clone() } else { matrix.transpose() })?;
    let rank = rank.min(found.values.len());
    let right = found.vectors.columns(0, rank).into_owned();
    let mut left = if tall { matrix * &right } else { matrix.tr_mul(&right) };
    left.column_iter_mut().zip(&found.values).for_each(|(mut vector, &value)| vector /= value);
    let (of_rows, of_columns) = if tall { (left, right) } else { (right, left) };
    let (left, right) = with_core(matrix, &points(of_rows), &points(of_columns), Core::Qr)?;
    Ok(Approximation::product(left, right))
}

/// One point per vector: where what the vectors before it do not interpolate is largest. That is elimination with pivoting.
fn points<S: Real>(mut vectors: DMatrix<S>) -> Vec<usize> {
    let mut points = Vec::new();
    for j in 0..vectors.ncols() {
        let Some(point) = largest(vectors.column(j).iter().copied(), |_| true) else { break };
        let pivot = vectors.column(j) / vectors[(point, j)];
        for mut later in vectors.columns_range_mut(j + 1..).column_iter_mut() {
            let value = later[point];
            later.axpy(-value, &pivot, S::one());
            later[point] = S::zero();
        }
        points.push(point);
    }
    points
}

#[cfg(test)]
mod tests {
    use super::{super::decompose::orthonormal, *};
    use crate::random::Random;

    #[test]
    fn each_point_is_where_interpolation_at_the_earlier_ones_fails_most() {
        let mut rng = Random::new([21, 0]);
        let vectors = orthonormal(&DMatrix::from_fn(40, 9, |_, _| f64::from(rng.normal())));
        let points = points(vectors.clone());
        assert_eq!(points.len(), 9);
        assert_eq!(Some(points[0]), largest(vectors.column(0).iter().copied(), |_| true));
        for j in 1..9 {
            // The definition: c solves U[p, ..j] c = u_j[p], and what is left is u_j − U c.
            let (earlier, vector) = (vectors.columns(0, j).into_owned(), vectors.column(j).into_owned());
            let at_points = vector.select_rows(&points[..j]);
            let c = earlier.select_rows(&points[..j]).lu().solve(&at_points).unwrap();
            let rest = vector - earlier * c;
            assert_eq!(Some(points[j]), largest(rest.iter().copied(), |_| true), "point {j}");
        }
    }

    #[test]
    fn the_error_stays_within_the_bound_of_the_points() {
        let mut rng = Random::new([22, 0]);
        let mut basis = |n| orthonormal(&DMatrix::from_fn(n, 30, |_, _| f64::from(rng.normal())));
        let (left, right) = (basis(60), basis(30));
        let values = DMatrix::from_fn(30, 30, |i, j| if i == j { 0.6f64.powi(i as i32) } else { 0.0 });
        let matrix = &left * values * right.transpose();
        let eta = |vectors: &DMatrix<f64>| {
            let vectors = vectors.columns(0, 8).into_owned();
            let chosen = vectors.select_rows(&points(vectors.clone()));
            1.0 / chosen.singular_values().min()
        };
        let rest = matrix.clone() - deim_cur(&matrix, 8).unwrap().to_dense();
        let (error, bound) = (rest.singular_values().max(), (eta(&left) + eta(&right)) * 0.6f64.powi(8));
        assert!(error <= bound && error >= 0.6f64.powi(8) * 0.999, "{error}, {bound}");
    }
}
