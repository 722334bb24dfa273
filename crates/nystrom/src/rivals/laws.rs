//! What must hold of every method, on matrices whose singular values are known.

use nalgebra::DMatrix;

use super::*;
use crate::{BlockFactors, BlockSamples, ColumnGroup, CompressConfig, Tolerance, compress_block};

/// Random singular vectors and the singular values `decay^r`.
fn spectrum<S: Real>(n_rows: usize, n_cols: usize, decay: f64, seed: u64) -> DMatrix<S> {
    let mut rng = Random::new([seed, 77]);
    let rank = n_rows.min(n_cols);
    let mut basis = |len| decompose::orthonormal(&DMatrix::from_fn(len, rank, |_, _| f64::from(rng.normal())));
    let (mut left, right) = (basis(n_rows), basis(n_cols));
    left.column_iter_mut().enumerate().for_each(|(r, mut column)| column *= decay.powi(r as i32));
    (left * right.transpose()).map(S::nearest)
}

/// The Frobenius norm of what an approximation leaves.
fn error<S: Real>(matrix: &DMatrix<S>, found: &Approximation<S>) -> f64 {
    (matrix.map(Real::to_f64) - found.to_dense().map(Real::to_f64)).norm()
}

fn found<S: Real>(method: Method, matrix: &DMatrix<S>, rank: usize, seed: u64) -> Approximation<S> {
    approximate(method, matrix, rank, seed).unwrap_or_else(|e| panic!("{method} at rank {rank}, seed {seed}: {e}"))
}

/// Cores that drop or damp hardly anything, so that rounding is all that is left.
fn undamped() -> Vec<Method> {
    let cores = [
        Core::Inverse,
        Core::PseudoInverse { rcond: 1e-12 },
        Core::Tikhonov { lambda: 1e-12 },
        Core::Qr,
        Core::Projection,
    ];
    let others = [Method::Kernel { gamma: Some(1.0), rcond: 1e-12 }, Method::Svd, Method::RowId, Method::DeimCur];
    let more = [Method::AcaPartial, Method::AcaFull, Method::GeneralizedNystrom, Method::Projected];
    let algorithms = [Method::Alg1, Method::Alg2, Method::Alg3, Method::Alg4];
    let crosses = cores.into_iter().flat_map(|core| algorithms.map(|algorithm| algorithm(core)));
    crosses.chain(others).chain(more).collect()
}

fn exact_at_full_rank<S: Real>(tolerance: f64) {
    for (n_rows, n_cols) in [(24, 10), (10, 24), (12, 12), (1, 9), (9, 1), (1, 1)] {
        let matrix = spectrum::<S>(n_rows, n_cols, 0.9, 1);
        for method in undamped() {
            // Packed factors hold eleven bits.
            let tolerance = if method == Method::Projected { 1e-3 } else { tolerance };
            let error = error(&matrix, &found(method, &matrix, 100, 3)) / matrix.norm().to_f64();
            assert!(error < tolerance, "{method}, {n_rows} × {n_cols}: {error}");
        }
    }
}

#[test]
fn full_rank_is_exact() {
    exact_at_full_rank::<f64>(1e-9);
    exact_at_full_rank::<f32>(1e-3);
}

#[test]
fn a_matrix_of_rank_five_is_exact_at_five() {
    let matrix = spectrum::<f64>(60, 40, 0.8, 2);
    let truth = found(Method::Svd, &matrix, 5, 0).to_dense();
    for method in undamped() {
        let tolerance = if method == Method::Projected { 1e-3 } else { 1e-9 };
        let error = error(&truth, &found(method, &truth, 5, 4)) / truth.norm();
        assert!(error < tolerance, "{method}: {error}");
    }
}

#[test]
fn nothing_is_nearer_than_the_singular_value_decomposition() {
    for (n_rows, n_cols) in [(80, 50), (50, 80)] {
        let matrix = spectrum::<f64>(n_rows, n_cols, 0.7, 5);
        for rank in [1, 4, 16] {
            let tail = (rank..50).map(|r| 0.49f64.powi(r as i32)).sum::<f64>().sqrt();
            let best = error(&matrix, &found(Method::Svd, &matrix, rank, 0));
            assert!((best / tail - 1.0).abs() < 1e-6, "rank {rank}: {best}, expected {tail}");
            for method in Method::every() {
                let error = error(&matrix, &found(method, &matrix, rank, 6));
                assert!(error > 0.999_999 * best, "{method}, rank {rank}: {error} < {best}");
            }
        }
    }
}

#[test]
fn the_best_core_for_the_same_rows_and_columns_is_the_best() {
    for seed in 0..10 {
        let matrix = spectrum::<f64>(60, 40, 0.75, seed);
        for algorithm in [Method::Alg1, Method::Alg2, Method::Alg3, Method::Alg4, Method::Alg4Union] {
            let of = |core| error(&matrix, &found(algorithm(core), &matrix, 8, seed));
            let (projection, qr) = (of(Core::Projection), of(Core::Qr));
            assert!(projection <= qr * 1.000_001, "{projection} > {qr}");
            for core in [Core::Inverse, Core::ALL[1], Core::ALL[2]] {
                assert!(qr <= of(core) * 1.000_001, "{core}: {qr} > {}", of(core));
            }
        }
    }
}

#[test]
fn chosen_rows_stay_within_the_bound_of_strong_rank_revealing() {
    for (seed, decay) in [(1, 0.5), (2, 0.8), (3, 0.95)] {
        let matrix = spectrum::<f64>(90, 30, decay, seed);
        for k in [1, 5, 12] {
            let id = found(Method::RowId, &matrix, k, 0);
            let largest = id.factors().map_or(0.0, |(left, _)| left.amax());
            let f = interpolative::BOUND;
            assert!(largest <= f, "{largest}");
            let bound = (1.0 + f * f * (k * (90 - k)) as f64).sqrt() * decay.powi(k as i32);
            let rest = matrix.clone() - id.to_dense();
            let spectral = decompose::right_singular(&rest).unwrap().values[0];
            assert!(spectral <= bound, "{spectral} > {bound}");
        }
    }
}

/// Kahan's matrix misleads pivoting; exchanges put that right.
#[test]
fn exchanges_find_the_rows_that_pivoting_misses() {
    let (n, c) = (40, 0.3f64);
    let s = (1.0 - c * c).sqrt();
    let entry = |i: usize, j: usize| s.powi(i as i32) * if i == j { 1.0 } else { -c };
    // A little more on the diagonal, so that rounding does not break ties.
    let kahan = DMatrix::from_fn(n, n, |i, j| if i <= j { entry(i, j) * (1.0 - 1e-9 * j as f64) } else { 0.0 });
    let matrix = kahan.transpose();
    let pivots = decompose::pivoted(&kahan, n - 1);
    let plain = pivots.rest.iter().fold(0.0, |most: f64, &x| most.max(x));
    let id = found(Method::RowId, &matrix, n - 1, 0);
    let strong = error(&matrix, &id);
    assert!(strong < 0.2 * plain, "{strong}, by pivoting alone {plain}");
}

#[test]
fn two_sketches_stay_within_their_expectation() {
    let matrix = spectrum::<f64>(120, 70, 0.7, 8);
    let (k, l, r) = (12.0, 18.0, 6);
    let mean = (0..40).map(|seed| error(&matrix, &found(Method::GeneralizedNystrom, &matrix, 12, seed))).sum::<f64>();
    let tail = (r..70).map(|i| 0.49f64.powi(i)).sum::<f64>().sqrt();
    // [Nakatsukasa2020, theorem 3.3]
    let bound = (1.0f64 + k / (l - k - 1.0)).sqrt() * (1.0 + f64::from(r) / (k - f64::from(r) - 1.0)).sqrt() * tail;
    assert!(mean / 40.0 < bound, "{} > {bound}", mean / 40.0);
}

#[test]
fn crosses_reproduce_what_they_took() {
    let matrix = spectrum::<f64>(40, 30, 0.9, 9);
    for method in [Method::AcaFull, Method::AcaPartial] {
        let rest = matrix.clone() - found(method, &matrix, 7, 1).to_dense();
        let is_zero = |norm: f64| norm < 1e-12;
        assert!(rest.row_iter().filter(|row| is_zero(row.norm())).count() == 7, "{method}");
        assert!(rest.column_iter().filter(|column| is_zero(column.norm())).count() == 7, "{method}");
    }
}

#[test]
fn the_kernel_finds_the_power_that_lowers_the_rank() {
    // Of rank five; the fourth roots of the entries are of rank two.
    let matrix = DMatrix::from_fn(50, 40, |i, j| ((i + 1) as f64 + 0.7 * (j * j % 37) as f64).powi(4));
    let [kernel, best] = [Method::KERNEL, Method::Svd].map(|method| error(&matrix, &found(method, &matrix, 4, 1)));
    assert!(kernel < 1e-6 * best, "{kernel}, {best}");
}

#[test]
fn sparse_rows_are_found_from_few_measurements() {
    let haar = sensing::haar::<f64>(48);
    let unit = &haar * haar.transpose();
    assert!((unit - DMatrix::identity(48, 48)).amax() < 1e-12);
    let mut rng = Random::new([1, 2]);
    let mut coefficients = DMatrix::zeros(200, 48);
    for row in 0..200 {
        (0..2).for_each(|_| coefficients[(row, rng.below(48))] = 1.0 + rng.unit());
    }
    let matrix = coefficients * haar;
    let found = found(Method::CompressedSensing, &matrix, 24, 3);
    assert!(error(&matrix, &found) < 1e-9 * matrix.norm());
    assert!(found.n_values() <= 800, "{}", found.n_values());
}

#[test]
fn factors_are_as_many_numbers_as_they_say() {
    let matrix = spectrum::<f64>(40, 30, 0.8, 12);
    for method in Method::every() {
        let found = found(method, &matrix, 6, 1);
        assert_eq!(found.factors().is_some(), method.has_factors(), "{method}");
        assert!(found.n_values() <= 6 * 70 + 40, "{method}: {}", found.n_values());
        if let Some((left, right)) = found.factors() {
            assert_eq!(left * right, found.to_dense());
            let stored = left.len() + right.len();
            assert!(method == Method::CompressedSensing || found.n_values() == stored, "{method}");
        }
    }
}

#[test]
fn a_seed_decides_everything() {
    let matrix = spectrum::<f32>(60, 40, 0.8, 13);
    for method in Method::every() {
        assert_eq!(found(method, &matrix, 6, 1), found(method, &matrix, 6, 1), "{method}");
    }
    assert_ne!(found(Method::AcaPartial, &matrix, 6, 1), found(Method::AcaPartial, &matrix, 6, 2));
}

#[test]
fn a_power_of_two_changes_no_digit() {
    let matrix = spectrum::<f32>(60, 40, 0.8, 14);
    for method in Method::every() {
        let one = found(method, &matrix, 6, 1).to_dense();
        for power in [100, -80] {
            let other = found(method, &matrix.map(|x| scaled(x, power)), 6, 1).to_dense();
            // What lies below the least normal number has fewer digits.
            let differs = one.iter().zip(&other).any(|(&x, &y)| scaled(x, power) != y && x.abs() > 1e-12);
            assert!(!differs, "{method} times 2^{power}");
        }
    }
}

fn bad_matrices() -> Vec<(&'static str, DMatrix<f64>)> {
    let good = spectrum::<f64>(30, 20, 0.7, 15);
    let mut zero_rows = good.clone();
    (0..30).filter(|row| row % 5 != 1).for_each(|row| zero_rows.row_mut(row).fill(0.0));
    let mut one_entry = DMatrix::zeros(30, 20);
    one_entry[(17, 3)] = 2.0;
    let twice = DMatrix::from_fn(30, 20, |i, j| good[(i / 2, j / 2)]);
    vec![
        ("zeros", DMatrix::zeros(30, 20)),
        ("one entry", one_entry),
        ("zero rows", zero_rows.clone()),
        ("zero columns", zero_rows.transpose()),
        ("every row and column twice", twice),
        ("one row", good.rows(0, 1).into_owned()),
        ("one column", good.columns(0, 1).into_owned()),
        ("no row", DMatrix::zeros(0, 20)),
        ("no column", DMatrix::zeros(30, 0)),
        ("denormals", good.map(|x| x * 1e-312)),
        ("large", good.map(|x| x * 1e307)),
        ("unlike rows", DMatrix::from_fn(30, 20, |i, j| good[(i, j)] * 10f64.powi(i as i32 - 15))),
    ]
}

#[test]
fn bad_matrices_harm_none_but_the_plain_inverse() {
    for (name, matrix) in bad_matrices() {
        for method in Method::every() {
            for rank in [0, 1, 7, 1000] {
                let result = approximate(method, &matrix, rank, 5);
                let is_inverse = matches!(
                    method,
                    Method::Alg1(Core::Inverse)
                        | Method::Alg2(Core::Inverse)
                        | Method::Alg3(Core::Inverse)
                        | Method::Alg4(Core::Inverse)
                        | Method::Alg4Union(Core::Inverse)
                );
                match result {
                    Ok(found) => {
                        let dense = found.to_dense();
                        assert_eq!(dense.shape(), matrix.shape(), "{method}: {name}");
                        let finite = dense.iter().all(|x| x.is_finite());
                        assert!(finite || is_inverse || matches!(name, "large"), "{method}, rank {rank}: {name}");
                    }
                    Err(error) => assert!(is_inverse, "{method}, rank {rank}: {name}: {error}"),
                }
            }
        }
    }
}

#[test]
fn what_is_not_finite_is_named() {
    let mut matrix = spectrum::<f32>(30, 20, 0.7, 16);
    matrix[(4, 7)] = f32::NEG_INFINITY;
    for method in Method::every() {
        assert_eq!(approximate(method, &matrix, 3, 0), Err(MethodError::NonFinite { row: 4, col: 7 }));
    }
}

/// The same choice of rows and columns, and a matrix that single precision cannot invert.
#[test]
fn single_precision_is_what_it_says() {
    let hilbert = |i: usize, j: usize| 1.0 / (i + j + 1) as f64;
    let double = DMatrix::from_fn(40, 30, hilbert);
    let single = double.map(|x| x as f32);
    let relative = |error: f64| error / double.norm();
    let [in_single, in_double] = [
        relative(error(&single, &found(Method::Svd, &single, 12, 0))),
        relative(error(&double, &found(Method::Svd, &double, 12, 0))),
    ];
    assert!(in_double < 1e-11 && in_single > 1e-8 && in_single < 1e-5, "{in_single}, {in_double}");
}

/// One block from the sums of two halves of one sample each.
fn compressed(halves: [&DMatrix<f64>; 2], method: Method, tolerance: Tolerance) -> BlockFactors {
    let sums = halves.map(|half| half.transpose().iter().map(|&x| x as f32).collect::<Vec<_>>());
    let n_cols = halves[0].ncols();
    let samples =
        BlockSamples { halves: [&sums[0], &sums[1]], sparse: [&[]; 2], n_cols, bundle_len: 3, n_samples: [1; 2] };
    let groups = vec![ColumnGroup { columns: 0..n_cols, tolerance, preserved: Vec::new(), share: 1.0, apart: 0.0 }];
    let config = CompressConfig { groups, method, ..CompressConfig::default() };
    compress_block(&samples, &config, 0).unwrap().swap_remove(0)
}

fn dense(factors: &BlockFactors) -> DMatrix<f64> {
    DMatrix::from_row_slice(factors.n_rows as usize, factors.n_cols as usize, &factors.dense()).cast()
}

#[test]
fn every_method_brings_a_block_within_the_tolerance() {
    let matrix = spectrum::<f64>(120, 50, 0.7, 17) * 1e-3;
    let within = |factors: &BlockFactors| (dense(factors) - &matrix).norm() / matrix.norm();
    for tolerance in [0.2, 0.02] {
        let of = |method| compressed([&matrix; 2], method, Tolerance::RelativeFrobenius(tolerance));
        let best = of(Method::Svd).rank;
        // What singular values leave: 0.7^r of the whole.
        assert_eq!(best, (f64::from(tolerance).ln() / 0.7f64.ln()).ceil() as u32);
        // Half of the columns of the union are random: only cores that see all entries must get there.
        let of_union = [Core::Qr, Core::Projection].map(Method::Alg4Union);
        let all = Method::ALL.into_iter().chain(of_union);
        for method in all.filter(|method| *method != Method::CompressedSensing) {
            let found = of(method);
            assert!(found.rank >= best, "{method}: {}, best {best}", found.rank);
            let told = f64::from(found.error.truncation).sqrt() * (120.0 * 50.0f64).sqrt() / matrix.norm();
            assert!((told / within(&found) - 1.0).abs() < 0.1, "{method}: {told}, {}", within(&found));
            let tames = !matches!(method, Method::Alg3(Core::Inverse) | Method::Alg3(Core::PseudoInverse { .. }));
            assert!(!tames || within(&found) < 1.01 * f64::from(tolerance), "{method}: {}", within(&found));
        }
    }
}

#[test]
fn the_errors_told_know_noise_from_truth() {
    let truth = spectrum::<f64>(150, 60, 0.6, 18);
    let mut rng = Random::new([19, 0]);
    let (mut told, mut real) = (0.0, 0.0);
    for _ in 0..20 {
        let [a, b] = [0, 1].map(|_| truth.map(|x| x + 0.004 * f64::from(rng.normal())));
        let found = compressed([&a, &b], Method::Svd, Tolerance::Rank(5));
        told += f64::from(found.error.truncation + found.error.sampling) * truth.len() as f64;
        real += (dense(&found) - &truth).norm_squared();
    }
    assert!((told / real - 1.0).abs() < 0.15, "{told}, {real}");
}

#[test]
fn methods_without_factors_keep_all_entries_of_what_they_make() {
    for matrix in [spectrum::<f64>(96, 40, 0.7, 20), spectrum::<f64>(24, 60, 0.7, 21)] {
        for method in [Method::Kernel { gamma: Some(0.5), rcond: 1e-3 }, Method::CompressedSensing] {
            let kept = compressed([&matrix; 2], method, Tolerance::Rank(6));
            let seed = Random::new([CompressConfig::default().seed, 0]).bits();
            let made = found(method, &matrix.map(|x| x as f32), 6, seed).to_dense().cast::<f64>();
            let missed = (dense(&kept) - &made).norm() / made.norm();
            assert!(missed < 1e-3, "{method}: {missed}");
            // The errors are those of the method.
            let of_method = (&made - &matrix).norm_squared() / matrix.len() as f64;
            let told = f64::from(kept.error.truncation);
            assert!((told / of_method - 1.0).abs() < 0.01, "{method}: {told}, {of_method}");
        }
    }
}

#[test]
fn what_is_not_rounded_yet_is_off_by_less_than_eleven_bits() {
    let matrix = spectrum::<f32>(60, 40, 0.8, 9);
    let rows = matrix.transpose().as_slice().to_vec();
    let samples = BlockSamples { halves: [&rows; 2], sparse: [&[]; 2], n_cols: 40, bundle_len: 1, n_samples: [1; 2] };
    let tolerance = Tolerance::Rank(40);
    let groups = vec![ColumnGroup { columns: 0..40, tolerance, preserved: Vec::new(), share: 1.0, apart: 0.0 }];
    let config = CompressConfig { groups, ..CompressConfig::default() };
    let wide = unrounded(&samples, &config, 0).unwrap().swap_remove(0).to_dense();
    let rounded = compress_block(&samples, &config, 0).unwrap().swap_remove(0).dense();
    let [before, after] =
        [wide, DMatrix::from_row_slice(60, 40, &rounded)].map(|found| (&matrix - found).norm() / matrix.norm());
    assert!(before < 1e-5 && 1e-4 < after && after < 1e-3, "{before} {after}");
    let cut = BlockSamples { halves: [&rows[..39], &rows[..39]], ..samples };
    assert!(unrounded(&cut, &config, 0).is_err());
}
