//! Laws that hold on any matrix: proptest makes them up, and makes those that break a law as small as they can be.

use nalgebra::DMatrix;
use proptest::{
    collection::vec,
    prelude::*,
    sample::Index,
    strategy::ValueTree,
    test_runner::{RngAlgorithm, TestRng, TestRunner},
};

use super::decaying;
use crate::{
    random::Random,
    stress::{Case, FLOOR, Ours, ours},
};

pub(super) fn quick(cases: u32) -> ProptestConfig {
    // Nothing is written beside the sources: a failure prints what it takes to repeat it.
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
}

/// A matrix that is made of few numbers, so that it can be made simpler.
#[derive(Clone, Copy, Debug)]
pub(super) struct Recipe {
    pub(super) n_bundles: usize,
    pub(super) bundle_len: usize,
    pub(super) n_cols: usize,
    /// Each singular value over the one before.
    pub(super) decay: f32,
    pub(super) seed: u64,
}

pub(super) fn recipes() -> impl Strategy<Value = Recipe> {
    (1usize..40, 1usize..4, 1usize..80, 0.3f32..1.0, 0u64..1000)
        .prop_map(|(n_bundles, bundle_len, n_cols, decay, seed)| Recipe { n_bundles, bundle_len, n_cols, decay, seed })
}

impl Recipe {
    fn n_rows(&self) -> usize {
        self.n_bundles * self.bundle_len
    }

    fn lesser_side(&self) -> usize {
        self.n_rows().min(self.n_cols)
    }

    pub(super) fn truth(&self) -> DMatrix<f32> {
        let rng = &mut Random::new([self.seed, 71]);
        let dense = decaying(self.n_rows(), self.n_cols, self.lesser_side(), self.decay, rng);
        DMatrix::from_row_slice(self.n_rows(), self.n_cols, &dense.data)
    }

    pub(super) fn case(&self, truth: DMatrix<f32>, rank: usize) -> Case {
        Case { name: "made up", halves: [truth.clone(), truth.clone()], truth, bundle_len: self.bundle_len, rank }
    }

    /// A noise of this standard deviation on each half.
    pub(super) fn noisy(&self, truth: DMatrix<f32>, rank: usize, noise: f32) -> Case {
        let rng = &mut Random::new([self.seed, 72]);
        let mut case = self.case(truth, rank);
        case.halves.iter_mut().flat_map(|half| half.iter_mut()).for_each(|x| *x += noise * rng.normal());
        case
    }

    /// The same with bundles and columns in another order.
    pub(super) fn shuffled(&self, case: &Case) -> Case {
        let rng = &mut Random::new([self.seed, 73]);
        let mut shuffled = |n: usize| rng.choose(&(0..n).collect::<Vec<_>>(), n);
        let (bundles, cols) = (shuffled(self.n_bundles), shuffled(self.n_cols));
        let members = |bundle: usize| bundle * self.bundle_len..(bundle + 1) * self.bundle_len;
        let rows: Vec<usize> = bundles.into_iter().flat_map(members).collect();
        let permuted = |matrix: &DMatrix<f32>| matrix.select_rows(&rows).select_columns(&cols);
        Case { truth: permuted(&case.truth), halves: case.halves.each_ref().map(permuted), ..case.clone() }
    }
}

fn answer(case: &Case) -> Ours {
    ours(case).unwrap()
}

/// What becomes of a row or a column.
#[derive(Clone, Debug)]
enum Fate {
    Itself,
    Zero,
    /// A copy of some row times a power of two.
    Copy(Index, i32),
}

fn fates() -> impl Strategy<Value = Fate> {
    prop_oneof![
        Just(Fate::Itself),
        Just(Fate::Zero),
        (any::<Index>(), -20i32..20).prop_map(|(of, exponent)| Fate::Copy(of, exponent)),
    ]
}

/// Rows by their fates; those that no fate is told of stay.
fn fated(matrix: &DMatrix<f32>, fates: &[Fate]) -> DMatrix<f32> {
    DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |row, col| match fates.get(row) {
        None | Some(Fate::Itself) => matrix[(row, col)],
        Some(Fate::Zero) => 0.0,
        Some(Fate::Copy(of, exponent)) => matrix[(of.index(matrix.nrows()), col)] * 2f32.powi(*exponent),
    })
}

/// A matrix with rows and columns that are zero or copies of others, and a rank.
pub(super) fn singular() -> impl Strategy<Value = Case> {
    (recipes(), vec(fates(), 0..60), vec(fates(), 0..60), 1usize..24).prop_map(|(recipe, rows, cols, rank)| {
        let truth = fated(&fated(&recipe.truth(), &rows).transpose(), &cols).transpose();
        recipe.case(truth, rank)
    })
}

proptest! {
    #![proptest_config(quick(150))]

    #[test]
    fn full_rank_is_exact_to_six_digits(recipe in recipes()) {
        let case = recipe.case(recipe.truth(), recipe.lesser_side());
        let ours = answer(&case);
        prop_assert!(ours.error <= 1e-6 * case.norm(), "{} of {}", ours.error, case.norm());
    }

    /// Another millionth of the norm is let pass beyond what [`Case::allowed`] asks for, which every case of the stress suite keeps: rows
    /// and columns of one matrix are up to 2^40 apart here, and single precision then costs more than one once in a great while. How
    /// seldom is held by [`singular_matrices_are_within_twice_the_optimum_in_999_of_1000_cases`].
    #[test]
    fn singular_matrices_survive(case in singular()) {
        let (ours, allowed) = (answer(&case), case.allowed() + FLOOR * case.norm());
        prop_assert!(ours.error <= allowed, "{} where {allowed} is allowed", ours.error);
        prop_assert!(ours.told.is_finite() && ours.packed_error.is_finite(), "{ours:?}");
    }

    #[test]
    fn more_components_are_never_worse(recipe in recipes(), rank in 1usize..20) {
        let truth = recipe.truth();
        let [fewer, more] = [rank, rank + 1].map(|rank| answer(&recipe.case(truth.clone(), rank)).error);
        let slack = 1e-3 * fewer + 1e-6 * recipe.case(truth, rank).norm();
        prop_assert!(more <= fewer + slack, "{fewer} with {rank}, {more} with one more");
    }

    #[test]
    fn the_order_of_rows_and_columns_does_not_matter(
        recipe in recipes(), rank in 1usize..20, noise in prop_oneof![Just(0f32), 0f32..0.3],
    ) {
        let case = recipe.noisy(recipe.truth(), rank, noise);
        let other = recipe.shuffled(&case);
        let [one, two] = [&case, &other].map(answer);
        // Other landmarks are chosen. With noise, a component that hardly pays is kept in one order and dropped in the other.
        let share = if noise == 0.0 { 0.02 } else { 0.25 };
        let slack = share * one.error.max(two.error) + 1e-6 * case.norm();
        prop_assert!((one.error - two.error).abs() <= slack, "{} and {}", one.error, two.error);
    }

    #[test]
    fn powers_of_two_change_no_digit(recipe in recipes(), rank in 1usize..20, noise in 0f32..0.3, exponent in -60i32..=60) {
        let case = recipe.noisy(recipe.truth(), rank, noise);
        let scale = 2f32.powi(exponent);
        let scaled = |matrix: &DMatrix<f32>| matrix * scale;
        let other = Case { truth: scaled(&case.truth), halves: case.halves.each_ref().map(scaled), ..case.clone() };
        let [one, two] = [&case, &other].map(answer);
        let scale = f64::from(scale);
        prop_assert_eq!(
            Ours {
                error: one.error * scale,
                packed_error: one.packed_error * scale,
                told: one.told * scale,
                doubt: one.doubt * scale * scale,
                unit: one.unit * scale,
                ..one
            },
            two
        );
    }
}

/// Of 80 000 such cases none was beyond that, and 4 in 1000 were beyond twice the optimum by more than 4e-7 of the norm, the worst by
/// 9e-7: that is rounding in single precision, whichever rows are chosen. One that was beyond 1e-6 has been seen.
#[test]
fn singular_matrices_are_within_twice_the_optimum_in_999_of_1000_cases() {
    let mut runner = TestRunner::new_with_rng(quick(1), TestRng::from_seed(RngAlgorithm::ChaCha, &[74; 32]));
    let within = |case: Case| answer(&case).error <= case.allowed();
    let mut next = || singular().new_tree(&mut runner).expect("nothing is rejected").current();
    let held = (0..1000).filter(|_| within(next())).count();
    assert!(held >= 999, "{held} of 1000");
}

/// What the halves tell of the error is a random number itself, and no bound: were it one, it would be too great in the mean. It *holds*
/// where the square of the error is no more than the square of what is told and three of its standard deviations, which
/// [`BlockError::deviation`](crate::BlockError::deviation) tells, and it is of use where, over many seeds, it is right in the mean. By
/// itself it is not less than the error in about every other block; were that far fewer, it would be no figure in the middle. Of normal
/// deviations two hold in 97.7 of 100 seeds and three in 99.9: three are the fewest whole ones with which it holds in 99.
#[test]
fn what_is_told_of_the_error_holds_for_99_in_100_seeds() {
    for (noise, rank) in [(0.01, 4), (0.1, 6), (0.5, 6)] {
        let (mut held, mut held_by_itself, mut told, mut truth) = (0, 0, 0.0, 0.0);
        for seed in 0..1000 {
            let recipe = Recipe { n_bundles: 24, bundle_len: 2, n_cols: 32, decay: 0.6, seed };
            let case = recipe.noisy(recipe.truth(), rank, noise);
            let ours = answer(&case);
            held += u32::from(ours.error.powi(2) <= ours.told.powi(2) + 3.0 * ours.doubt);
            held_by_itself += u32::from(ours.error <= ours.told);
            told += ours.told.powi(2);
            truth += ours.error.powi(2);
        }
        eprintln!("noise {noise}: {held} of 1000 hold, {held_by_itself} by themselves, {} in the mean", told / truth);
        assert!(held >= 990, "noise {noise}: {held} of 1000 hold");
        assert!(held_by_itself >= 300, "noise {noise}: only {held_by_itself} of 1000 tell no less than the error");
        assert!((0.95..1.1).contains(&(told / truth)), "noise {noise}: told {told}, truth {truth}");
    }
}

/// Here the rest, found by subtracting, came out below zero by rounding, and was taken for nothing left: 16 components of 20.
#[test]
fn a_rest_below_zero_is_not_taken_for_none() {
    let recipe = Recipe { n_bundles: 38, bundle_len: 2, n_cols: 69, decay: 0.44859377, seed: 97 };
    let case = recipe.case(recipe.truth(), recipe.lesser_side());
    let ours = answer(&case);
    assert!(ours.error <= 1e-6 * case.norm(), "{} of {}", ours.error, case.norm());
}
