//! Laws of blocks whose noise stands in the way of what is asked: their columns are divided by it before they are found.

use std::sync::Arc;

use nalgebra::DMatrix;
use proptest::{
    prelude::*,
    strategy::ValueTree,
    test_runner::{RngAlgorithm, TestRng, TestRunner},
};

use super::{
    properties::{Recipe, quick, recipes, singular},
    stability::distance,
};
use crate::{
    means::Means,
    random::Random,
    stress::{Case, FLOOR},
    unpacked::Unpacked,
    *,
};

/// The factors of a case within a mean square error per entry, all columns together kept as they were sampled.
fn found(case: &Case, asked: f32, max_rank: u32, smooths: bool) -> Unpacked {
    found_with(NoisyColumns::default(), case, asked, max_rank, smooths)
}

/// The same, and what becomes of columns that are noisier than others.
fn found_with(noisy_columns: NoisyColumns, case: &Case, asked: f32, max_rank: u32, smooths: bool) -> Unpacked {
    let (n_rows, n_cols) = case.truth.shape();
    let rows = case.halves.each_ref().map(|half| half.transpose().iter().copied().collect::<Vec<f32>>());
    let halves = rows.each_ref().map(Vec::as_slice);
    let samples = BlockSamples { halves, sparse: [&[]; 2], n_cols, bundle_len: case.bundle_len, n_samples: [1; 2] };
    let tolerance = Tolerance::AbsoluteMeanSquare(asked);
    let group = ColumnGroup { columns: 0..n_cols, tolerance, preserved: vec![1.0; n_cols], share: 1.0, apart: 0.0 };
    let n_bundles = (n_rows / case.bundle_len) as u32;
    let partition = Partition { width: n_bundles, height: 1, tile: n_bundles };
    let columns = vec![ColumnRun::Grid { width: n_cols as u32, height: 1 }];
    let smoothing = smooths.then(|| Arc::new(Smoothing::new(partition, case.bundle_len, vec![columns])));
    let groups = vec![group.clone()];
    let config = CompressConfig { groups, max_rank, smoothing, noisy_columns, ..CompressConfig::default() };
    compress::unpacked(&samples, &group, &config, 0, &mut Means::default()).unwrap()
}

/// What is asked of samples with noise of this standard deviation: far more than they can give.
fn asked(noise: f32) -> f32 {
    1e-4 * noise * noise
}

/// Columns of one signal.
fn recipe(seed: u64) -> Recipe {
    Recipe { n_bundles: 24, bundle_len: 2, n_cols: 32, decay: 0.6, seed }
}

/// Squared distance from the truth that is told.
fn told(case: &Case, factors: &Unpacked) -> f64 {
    factors.error() * case.truth.len() as f64 * factors.unit * factors.unit
}

#[test]
fn full_rank_is_as_exact_as_the_samples() {
    let mut rng = Random::new([91, 0]);
    for (n_rows, n_cols, bundle_len) in [(30, 50, 3), (120, 40, 3), (90, 3, 1), (48, 1, 3), (6, 200, 2), (240, 60, 3)] {
        let truth = DMatrix::from_fn(n_rows, n_cols, |_, _| rng.normal());
        let halves = [(); 2].map(|()| truth.map(|x| x + 1e-5 * rng.normal()));
        let case = Case { name: "full rank", truth, halves, bundle_len, rank: n_cols };
        let error = distance(&case, &found(&case, 0.0, 96, false));
        let allowed = 2.0 * case.distance(&case.mean()) + FLOOR * case.norm();
        assert!(error <= allowed, "{n_rows} × {n_cols}: {error}, {allowed} is allowed");
    }
}

/// A column that the strong ones drown has as small a part of itself missing as they have, where columns are looked at one by one.
#[test]
fn a_weak_column_lacks_no_more_of_itself_than_strong_ones_where_columns_are_apart() {
    let (n_rows, n_cols) = (96, 4);
    let mut rng = Random::new([94, 0]);
    let strengths = [1.0f32, 1.0, 1.0, 0.01];
    let truth: Vec<f32> = (0..n_rows * n_cols).map(|at| strengths[at % n_cols] * (1.0 + 0.5 * rng.normal())).collect();
    let samples = BlockSamples { halves: [&truth; 2], sparse: [&[]; 2], n_cols, bundle_len: 3, n_samples: [1; 2] };
    let missing = |apart: f32| {
        let tolerance = Tolerance::AbsoluteMeanSquare(1e-3);
        let group = ColumnGroup { columns: 0..n_cols, tolerance, preserved: Vec::new(), share: 1.0, apart };
        let config = CompressConfig { groups: vec![group], ..CompressConfig::default() };
        let factors = compress_block(&samples, &config, 0).unwrap().remove(0);
        let sums =
            factors.dense().chunks_exact(n_cols).zip(truth.chunks_exact(n_cols)).fold([0.0; 2], |sums, (x, y)| {
                let [missing, all] = [x[n_cols - 1] - y[n_cols - 1], y[n_cols - 1]].map(|x| f64::from(x).powi(2));
                [sums[0] + missing, sums[1] + all]
            });
        (sums[0] / sums[1]).sqrt()
    };
    let [together, apart] = [0.0, 0.5].map(missing);
    assert!(together > 0.3 && apart < 0.15, "{together} {apart}");
}

/// Each entry has a tenth of itself as noise, so that noises of columns are up to 2^40 apart and some have none.
#[test]
fn singular_matrices_survive_noise_that_grows_with_their_columns() {
    let mut runner = TestRunner::new_with_rng(quick(1), TestRng::from_seed(RngAlgorithm::ChaCha, &[75; 32]));
    let mut rng = Random::new([92, 0]);
    for _ in 0..200 {
        let tree = singular().new_tree(&mut runner).expect("nothing is rejected");
        // A simpler matrix, which a failure is brought down to, takes the first of them.
        let noises: Vec<f32> = (0..2 * tree.current().truth.len()).map(|_| rng.normal()).collect();
        let survives = TestRunner::new(quick(200)).run_one(tree, |mut case| {
            let entries = case.halves.iter_mut().flat_map(|half| half.iter_mut());
            entries.zip(&noises).for_each(|(x, noise)| *x += 0.1 * *x * noise);
            let allowed = 0.25 * case.norm() + case.distance(&case.mean());
            for smooths in [false, true] {
                let factors = found(&case, 0.0, 96, smooths);
                let error = distance(&case, &factors);
                prop_assert!(error <= allowed, "{smooths}: {error}, {allowed} is allowed");
                prop_assert!(told(&case, &factors).is_finite() && factors.packing.is_finite(), "{smooths}");
            }
            Ok(())
        });
        survives.unwrap_or_else(|error| panic!("{error}"));
    }
}

#[test]
fn what_is_told_holds_for_99_in_100_seeds_where_noise_is_in_the_way() {
    // Alike in all columns, and four times as much in each eighth.
    for (noise, of_some) in [(0.05f32, 1.0f32), (0.3, 1.0), (0.1, 4.0)] {
        let noises: Vec<f32> = (0..32).map(|col| if col % 8 == 0 { noise * of_some } else { noise }).collect();
        let most = f64::from(noise * of_some).powi(2);
        let of_products: f64 = noises.iter().map(|noise| 48.0 * f64::from(*noise).powi(4)).sum();
        let (mut held, mut n_asked, mut all_told, mut all_errors) = (0, 0, 0.0, 0.0);
        for seed in 0..1000 {
            let recipe = recipe(seed);
            let mut case = recipe.case(recipe.truth(), 0);
            let rng = &mut Random::new([seed, 93]);
            for half in &mut case.halves {
                for (mut column, noise) in half.column_iter_mut().zip(&noises) {
                    column.iter_mut().for_each(|x| *x += noise * rng.normal());
                }
            }
            let factors = found(&case, asked(noise), 96, false);
            let (error, told) = (distance(&case, &factors).powi(2), told(&case, &factors));
            // Both halves have that noise, and an error that they have in common beside it: see `BlockError::deviation`.
            let doubt = (of_products + 2.0 * most * told.max(0.0)).sqrt();
            held += u32::from(error <= told + 3.0 * doubt);
            n_asked += u32::from(told > f64::from(asked(noise)) * case.truth.len() as f64);
            all_told += told;
            all_errors += error;
        }
        let ratio = all_told / all_errors;
        eprintln!("noise {noise}, {of_some} times in some: {held} of 1000 hold, {ratio} in the mean");
        assert!(n_asked >= 950, "noise {noise}: only {n_asked} of 1000 have more noise than asked");
        assert!(held >= 990, "noise {noise}, {of_some} times in some: {held} of 1000 hold");
        assert!((0.85..1.3).contains(&ratio), "noise {noise}, {of_some} times in some: told {ratio} times the error");
    }
}

/// The noise of each eighth column is four times that of the others.
#[test]
fn columns_are_decomposed_as_they_were_sampled_where_that_is_asked_for() {
    let recipe = recipe(7);
    let mut case = recipe.noisy(recipe.truth(), 0, 0.1);
    let rng = &mut Random::new([7, 94]);
    for half in &mut case.halves {
        for mut column in half.column_iter_mut().step_by(8) {
            column.iter_mut().for_each(|x| *x += 0.4 * rng.normal());
        }
    }
    let of = |noisy_columns| found_with(noisy_columns, &case, asked(0.1), 96, false);
    let [divided, as_sampled] = [NoisyColumns::Divided, NoisyColumns::AsSampled].map(of);
    assert_eq!(divided.right.data, found(&case, asked(0.1), 96, false).right.data, "the default");
    assert_ne!(divided.right.data, as_sampled.right.data);
    let error = distance(&case, &as_sampled);
    assert!(error < case.distance(&case.mean()), "{error}: not even as near as the samples");
}

#[test]
fn the_order_of_rows_and_columns_hardly_matters_where_noise_is_in_the_way() {
    for seed in 0..30 {
        let recipe = recipe(seed);
        let case = recipe.noisy(recipe.truth(), 0, 0.1);
        let other = recipe.shuffled(&case);
        let [one, two] = [&case, &other].map(|case| distance(case, &found(case, asked(0.1), 96, false)));
        assert!((one - two).abs() <= 0.25 * one.max(two), "seed {seed}: {one} and {two}");
    }
}

/// Of so many rows and columns, and falling so slowly, that six components are far greater than a twentieth of noise.
fn standing_out() -> impl Strategy<Value = Recipe> {
    (20usize..40, 2usize..4, 32usize..64, 0.6f32..0.75, 0u64..1000)
        .prop_map(|(n_bundles, bundle_len, n_cols, decay, seed)| Recipe { n_bundles, bundle_len, n_cols, decay, seed })
}

proptest! {
    #![proptest_config(quick(20))]

    #[test]
    fn more_components_are_never_worse_as_long_as_they_stand_out_of_the_noise(recipe in standing_out()) {
        let case = recipe.noisy(recipe.truth(), 0, 0.05);
        let errors: Vec<f64> =
            (1..=6).map(|max_rank| distance(&case, &found(&case, asked(0.05), max_rank, false))).collect();
        prop_assert!(errors.is_sorted_by(|fewer, more| more < fewer), "{errors:?}");
    }
}

proptest! {
    #![proptest_config(quick(60))]

    #[test]
    fn powers_of_two_change_no_digit_where_noise_is_in_the_way(
        recipe in recipes(), noise in 0.02f32..0.3, share in prop_oneof![Just(0f32), Just(1f32)],
        smooths in any::<bool>(), exponent in -40i32..=40,
    ) {
        let case = recipe.noisy(recipe.truth(), 0, noise);
        let scale = 2f32.powi(exponent);
        let scaled = |matrix: &DMatrix<f32>| matrix * scale;
        let other = Case { truth: scaled(&case.truth), halves: case.halves.each_ref().map(scaled), ..case.clone() };
        let asked = share * asked(noise);
        let one = found(&case, asked, 96, smooths);
        let two = found(&other, asked * scale * scale, 96, smooths);
        prop_assert_eq!(two.unit, one.unit * f64::from(scale));
        prop_assert_eq!(two.left.data, one.left.data);
        prop_assert_eq!(two.doubt.data, one.doubt.data);
        prop_assert_eq!(two.right.data, one.right.data);
        let errors = |of: [f64; 4]| of.map(f64::to_bits);
        prop_assert_eq!(
            errors([two.truncation, two.sampling, two.noise, two.packing]),
            errors([one.truncation, one.sampling, one.noise, one.packing])
        );
    }
}
