//! Bounds that hold on every matrix of the stress suite.

use crate::{
    dense::Dense,
    means::Means,
    product::product,
    stress::{Case, Stored, StoredError, cases, ours, refused, stored},
    unpacked::Unpacked,
    *,
};

#[test]
fn ours_is_within_twice_the_optimum_on_every_case() {
    for (seed, case) in (0..3).flat_map(|seed| cases(seed).into_iter().map(move |case| (seed, case))) {
        let (allowed, norm) = (case.allowed(), case.norm());
        let ours_of_case = ours(&case).unwrap();
        let words = format!("{} of seed {seed}: {ours_of_case:?}", case.name);
        assert!(ours_of_case.error <= allowed, "{words}, {:.2e} is allowed", allowed / norm);
        // Eleven bits per factor and component.
        assert!(ours_of_case.packed_error <= allowed + 6e-4 * norm.max(case.mean().norm()), "{words} packed");
        assert!(ours_of_case.told.is_finite(), "{words}");
        assert_eq!(ours(&case).unwrap(), ours_of_case, "{words} is another one when asked again");
    }
}

#[test]
fn what_is_stored_of_every_case_is_what_was_asked_and_told() {
    for (seed, case) in (0..3).flat_map(|seed| cases(seed).into_iter().map(move |case| (seed, case))) {
        let of_case = stored(&case).unwrap();
        let Stored { asked, error, denoised, unpacked, added, .. } = of_case;
        let words = format!("{} of seed {seed}: {of_case:?}", case.name);
        let rounding = 6e-4 * case.norm().max(case.mean().norm());
        // Where noise stands in the way of what is asked for, no step makes it worse than what was sampled.
        let allowed = asked.max(case.distance(&case.mean()));
        assert!(error <= allowed + rounding, "{words}");
        assert!(denoised <= 1.001 * error + rounding, "{words}");
        assert!(unpacked <= denoised + 1.01 * added + rounding, "{words}");
        // Packing aims at what is asked for by a matrix of many blocks; a single one may miss it by 2 dB.
        assert!(unpacked <= 1.26 * allowed + rounding, "{words}");
        assert_eq!(stored(&case).unwrap(), of_case, "{words} is another one when asked again");
    }
}

#[test]
fn what_is_not_finite_is_named() {
    for (case, [row, col]) in refused(3) {
        let named = CompressError::NonFinite { block: 0, row: row as u32, col: col as u32 };
        assert_eq!(ours(&case), Err(named.clone()), "{}", case.name);
        assert_eq!(stored(&case), Err(StoredError::Compress(named)), "{}", case.name);
    }
}

/// Distance from the truth of factors within a relative tolerance, before they are packed.
fn within(case: &Case, tolerance: f32) -> f64 {
    let n_cols = case.truth.ncols();
    let rows = case.halves.each_ref().map(|half| half.transpose().iter().copied().collect::<Vec<f32>>());
    let halves = rows.each_ref().map(Vec::as_slice);
    let samples = BlockSamples { halves, sparse: [&[]; 2], n_cols, bundle_len: case.bundle_len, n_samples: [1; 2] };
    let tolerance = Tolerance::RelativeFrobenius(tolerance);
    let group = ColumnGroup { columns: 0..n_cols, tolerance, preserved: Vec::new(), share: 1.0, apart: 0.0 };
    let config = CompressConfig { max_rank: 1000, ..CompressConfig::default() };
    let factors = compress::unpacked(&samples, &group, &config, 0, &mut Means::default()).unwrap();
    distance(case, &factors)
}

/// Distance of factors from the truth.
pub(super) fn distance(case: &Case, factors: &Unpacked) -> f64 {
    let (n_rows, n_cols) = case.truth.shape();
    let dense: Dense<f64> = product(factors.left.to_f64().view(), factors.right.to_f64().view());
    let rows = dense.data.iter().map(|x| x * factors.unit);
    case.distance(&nalgebra::DMatrix::from_row_iterator(n_rows, n_cols, rows))
}

#[test]
fn every_tolerance_that_single_precision_holds_is_kept() {
    let without_noise = |case: &Case| case.halves[0] == case.halves[1];
    for case in cases(5).into_iter().filter(without_noise) {
        for tolerance in [0.3, 0.03, 3e-3, 3e-4, 3e-5, 3e-6] {
            let error = within(&case, tolerance);
            let allowed = f64::from(tolerance) * case.norm();
            assert!(error <= allowed, "{} to {tolerance}: {error:e}, {allowed:e} is allowed", case.name);
        }
    }
}

#[test]
fn noise_alone_is_no_more_than_one_component() {
    // Landmarks know both halves a little; what they know must not pass for a signal. The first component is kept in any doubt.
    for seed in 0..100 {
        let of_noise = |case: &Case| ["noise 10", "noise alone"].contains(&case.name);
        for case in cases(seed).into_iter().filter(of_noise) {
            let rank = ours(&case).unwrap().rank;
            assert!(rank <= 1, "{} of seed {seed}: rank {rank}", case.name);
        }
    }
}
