//! The projected core: from the landmarks' span to `left · right`, with a rank that both halves vouch for.
//!
//! The landmark rows only say where to look. Their span V is met with all rows of both halves (coefficients M·Vᵀ, never an
//! inverse of the intersection W); one further step from these coefficients back to the columns gives each half, and the mean
//! of both, its own leading singular vectors, as in a randomized decomposition \[Halko2011\]. The factors are the mean's own,
//! so nothing is lost in them; the halves' own fits say how many components pay, and how far off they are (`measure`).
//! While a block is sampled, the two parts of one half take the place of the halves, and what they say steers the other half.

use std::array;

use crate::{
    basis::extend_basis,
    compress::{ColumnGroup, CompressConfig, Tolerance, tightness},
    dense::{Dense, eigen},
    fit::Fit,
    level::Level,
    means::Means,
    measure::{Measured, PACKING, ROUNDING, held_out, least_agreement},
    preserve::{preserve, product_noise},
    product::{coefficients, combinations, power_step, product},
    random::Random,
    sketch::{Sketch, allowed, rank_limit, sketch},
    spectrum::right_vectors,
    unpacked::Unpacked,
    vector::WIDE,
};

/// Components that the refinement may carry beyond those that seem to pay.
const OVERSAMPLING: usize = 4;
/// Dimensions of a span from which on it is narrowed before it is decomposed.
const MANY: usize = 48;
/// Widths that are tried for it, over its own.
const WIDTHS: [f64; 2] = [0.4, 0.6];
/// Share of the mean-square goal that narrowing may lose.
const NARROWING: f64 = 0.125;

/// What is asked of a group of columns of a block.
#[derive(Clone, Copy)]
pub(crate) struct Asked<'a> {
    pub(crate) group: &'a ColumnGroup,
    /// What is asked of the rank, see [`Tolerance::tightened`].
    pub(crate) tolerance: Tolerance,
    /// Rows per bundle.
    pub(crate) bundle_len: usize,
    pub(crate) config: &'a CompressConfig,
}

/// Compresses one group of columns of a block.
pub(crate) fn factor(means: &Means, asked: Asked<'_>, rng: Random) -> Unpacked {
    let Asked { group: ColumnGroup { preserved, .. }, tolerance, bundle_len, config } = asked;
    let [of_a, of_b, mut of_mean] = fitted(means, bundle_len, tolerance, config, rng);
    let measured = measured(means, [&of_a, &of_b], tolerance, config);
    of_mean.keep(measured.rank);
    let (mut left, mut doubt) = (of_mean.mean(), of_mean.doubt());
    let added = preserve(means, &mut of_mean, [&mut left, &mut doubt], preserved, allowed(means, tolerance), None);
    Unpacked {
        left,
        doubt,
        right: of_mean.basis,
        unit: means.unit,
        truncation: measured.truncation + added[0],
        sampling: measured.sampling + added[1],
        noise: means.noise_per_entry(),
        packing: measured.packing,
    }
}

/// The same found in divided columns, where noise is in the way or columns are looked at one by one; and the held-out error in these.
pub(crate) fn factor_levelled((means, level): (&Means, &Level), asked: Asked<'_>, rng: Random) -> (Unpacked, f64) {
    let Asked { group, tolerance, bundle_len, config } = asked;
    let mut fits: [Fit; 3] = fitted(&level.means, bundle_len, tolerance, config, rng);
    let measured = measured(&level.means, [&fits[0], &fits[1]], tolerance, config);
    fits.iter_mut().for_each(|fit| _ = fit.keep(measured.rank));
    let factors = multiplied((means, level), &fits, [&means.a, &means.b], (group, tolerance));
    (factors, measured.truncation + measured.sampling)
}

/// The factors of columns from fits of these divided, and their error from what the fits of both halves leave of `halves`.
pub(crate) fn multiplied(
    (means, level): (&Means, &Level),
    fits: &[Fit; 3],
    halves: [&Dense<f32>; 2],
    (group, tolerance): (&ColumnGroup, Tolerance),
) -> Unpacked {
    let [of_a, of_b] = [&fits[0], &fits[1]].map(|fit| fit.multiplied(level));
    let [truncation, sampling] =
        held_out(halves, &[of_a.of(&of_a.a), of_b.of(&of_b.b)]).map(|sum| sum / means.n_entries());
    let mut of_mean = fits[2].clone();
    let (mut left, mut doubt) = (of_mean.mean(), of_mean.doubt());
    let (direction, goal) = (level.combination(&group.preserved), allowed(means, tolerance));
    let added = preserve(&level.means, &mut of_mean, [&mut left, &mut doubt], &direction, goal, Some(level));
    let both = |sign: f32| left.data.iter().zip(&doubt.data).map(|(x, noise)| x + sign * noise).collect();
    (of_mean.a, of_mean.b) = (Dense { data: both(1.0), ..left }, Dense { data: both(-1.0), ..left });
    let of_mean = of_mean.multiplied(level);
    let left = of_mean.mean();
    Unpacked {
        doubt: of_mean.doubt(),
        right: of_mean.basis,
        unit: means.unit,
        truncation: truncation + added[0],
        sampling: sampling + added[1],
        noise: means.noise_per_entry(),
        packing: PACKING * left.inner_product(&left) / means.n_entries(),
        left,
    }
}

/// What the fits of both halves tell of the rank that a tolerance asks for.
pub(crate) fn measured(
    means: &Means,
    [of_a, of_b]: [&Fit; 2],
    tolerance: Tolerance,
    config: &CompressConfig,
) -> Measured {
    let goal = if matches!(tolerance, Tolerance::Rank(_)) { None } else { Some(allowed(means, tolerance)) };
    Measured::new(means, of_a, of_b, limit(means, config, tolerance), goal)
}

impl Tolerance {
    /// What is asked of the rank of a block: a share of the tolerance, and less where it is weak. Samples are asked for by the plain
    /// tolerance.
    pub(crate) fn tightened(self, means: &Means, strong: f32, share: f32) -> Self {
        match self {
            Tolerance::AbsoluteMeanSquare(allowed) => {
                let energy = means.cross.iter().sum::<f64>() * means.unit * means.unit;
                Tolerance::AbsoluteMeanSquare(
                    (f64::from(allowed * share) * tightness(energy / means.n_entries(), strong)) as f32,
                )
            }
            other => other,
        }
    }
}

/// The noise of the mean of two samplings over what is allowed. Without a tolerance all noise is too much.
pub(crate) fn noise_share(means: &Means, tolerance: Tolerance) -> f64 {
    let noise = means.noise_per_entry();
    let goal = allowed(means, tolerance);
    if noise == 0.0 {
        0.0
    } else if goal > 0.0 {
        noise / goal
    } else {
        f64::INFINITY
    }
}

/// The noise of the product that is preserved over what is allowed, where that is absolute; a rank and a share of the energy ask nothing
/// of it.
pub(crate) fn product_noise_share(means: &Means, preserved: &[f32], tolerance: Tolerance) -> f64 {
    if !matches!(tolerance, Tolerance::AbsoluteMeanSquare(_)) || preserved.is_empty() {
        return 0.0;
    }
    let noise = product_noise(means, preserved);
    if noise == 0.0 { 0.0 } else { noise / allowed(means, tolerance) }
}

/// The error of the factors over what is allowed, as fits to two samplings tell it, of the variance of whose mean a share is
/// remaining.
pub(crate) fn error_share(
    means: &Means,
    bundle_len: usize,
    tolerance: Tolerance,
    remaining: f64,
    config: &CompressConfig,
    rng: Random,
) -> f64 {
    let (goal, limit) = (allowed(means, tolerance), limit(means, config, tolerance));
    let [first, second] = fitted(means, bundle_len, tolerance, config, rng);
    let measured = Measured::new(means, &first, &second, limit, Some(goal));
    let sampling = remaining * measured.sampling / goal;
    // Where rank is in the way, more samples help only against noise.
    if measured.rank == limit {
        return 2.0 * sampling;
    }
    // The rank leaves out up to a half of what is allowed; what noise hides beyond that falls as noise does.
    let truncation = measured.truncation.max(0.0) / goal;
    sampling + truncation.min(0.5).max(0.5 * truncation)
}

/// The greatest rank that the factors may have.
pub(crate) fn limit(means: &Means, config: &CompressConfig, tolerance: Tolerance) -> usize {
    rank_limit(config, tolerance).min(means.mean.n_rows).min(means.mean.n_cols)
}

/// The fits of both halves and, where three are asked for, of their mean.
pub(crate) fn fitted<const N: usize>(
    means: &Means,
    bundle_len: usize,
    tolerance: Tolerance,
    config: &CompressConfig,
    mut rng: Random,
) -> [Fit; N] {
    let limit = limit(means, config, tolerance);
    if means.mean.data.iter().all(|&x| x == 0.0) || limit == 0 {
        return fits(means, array::from_fn(|_| Dense::zeros(0, means.mean.n_cols)), 0);
    }
    let sketch = sketch(means, bundle_len, tolerance, config, &mut rng);
    fits(means, bases(means, &sketch, allowed(means, tolerance), limit, &mut rng), sketch.n_landmarks())
}

/// Orthonormal right bases of A, of B and of their mean, largest component first, a little wider than what seems to pay.
fn bases<const N: usize>(means: &Means, sketch: &Sketch, goal: f64, limit: usize, rng: &mut Random) -> [Dense<f32>; N] {
    let n_landmarks = sketch.n_landmarks();
    match sketch {
        Sketch::Rows if means.is_exact() => {
            let basis = principal(&means.a.to_f64());
            array::from_fn(|_| basis.clone())
        }
        Sketch::Rows => array::from_fn(|i| principal(&[&means.a, &means.b, &means.mean][i].to_f64())),
        Sketch::Columns => refined(means, [&means.a, &means.b], 0, goal, limit),
        Sketch::Landmarks { a, b } => match narrowed(means, [a, b], goal, rng) {
            Some([a, b]) => refined(means, [&a, &b], n_landmarks, goal, limit),
            None => refined(means, [a, b], n_landmarks, goal, limit),
        },
    }
}

/// Coefficients of both halves in a narrower span, if that holds practically all that they have in common: what a span costs
/// grows with the third power of its dimensions. Steps of a power iteration from random vectors find it \[Halko2011\].
fn narrowed(means: &Means, [a, b]: [&Dense<f32>; 2], goal: f64, rng: &mut Random) -> Option<[Dense<f32>; 2]> {
    let (n_wide, enough) = (a.n_cols, NARROWING * goal * means.n_entries());
    let mut lost = a.inner_product(b);
    if n_wide < MANY || enough < ROUNDING * lost {
        return None;
    }
    let mean = (!means.is_exact()).then(|| a.mean_with(b));
    let mut basis = Dense::zeros(0, n_wide);
    let mut found: [Vec<Dense<f32>>; 2] = Default::default();
    for width in WIDTHS.map(|width| (width * n_wide as f64) as usize).map(|width| width.next_multiple_of(WIDE)) {
        let n_before = basis.n_rows;
        let data = (n_before * n_wide..width * n_wide).map(|_| rng.unit() as f32 - 0.5).collect();
        let start = Dense { n_rows: width - n_before, n_cols: n_wide, data };
        extend_basis(&mut basis, power_step(mean.as_ref().unwrap_or(a), &start));
        let new = basis.gather_rows(n_before..basis.n_rows);
        let of_a = coefficients(a, &new);
        let of_b = if mean.is_some() { coefficients(b, &new) } else { of_a.clone() };
        lost -= of_a.inner_product(&of_b);
        found[0].push(of_a);
        found[1].push(of_b);
        if lost <= enough {
            return Some(found.map(|parts| Dense::side_by_side(&parts, a.n_rows)));
        }
    }
    None
}

/// Two steps from the coefficients of all rows back to the columns. Each half's basis is made of its own rows alone: the
/// landmarks, which both have in common, only say where to begin, and what their noise brought fades with each step.
fn refined<const N: usize>(
    means: &Means,
    halves: [&Dense<f32>; 2],
    n_landmarks: usize,
    goal: f64,
    limit: usize,
) -> [Dense<f32>; N] {
    let worth = |half: &Eigen, cross: &Dense<f64>| {
        worth(half, cross, least_agreement(means, n_landmarks), 0.125 * goal * means.n_entries())
    };
    let width = |worth: usize| (worth + OVERSAMPLING).min(limit + OVERSAMPLING);
    if means.is_exact() {
        let own = halves[0].to_f64();
        let gram = product(own.t(), own.view());
        let half = eigen(&gram);
        let basis = stepped(&own, &half, width(worth(&half, &gram)), &means.a);
        return array::from_fn(|_| basis.clone());
    }
    let [a, b] = halves.map(Dense::to_f64);
    let cross = product(a.t(), b.view());
    let grams = [&a, &b].map(|half| product(half.t(), half.view()));
    let [half_a, half_b] = grams.each_ref().map(eigen);
    let width = width(worth(&half_a, &cross).max(worth(&half_b, &cross)));
    let mean;
    let mut all = vec![(&a, half_a, &means.a), (&b, half_b, &means.b)];
    if N > all.len() {
        mean = a.mean_with(&b);
        all.push((&mean, eigen(&mean_gram(&grams, &cross)), &means.mean));
    }
    array::from_fn(|i| stepped(all[i].0, &all[i].1, width, all[i].2))
}

/// The two steps of one half, or of the mean, from its coefficients.
fn stepped(own: &Dense<f64>, half: &Eigen, width: usize, rows: &Dense<f32>) -> Dense<f32> {
    let once = principal(&combinations(&range(own, half, width), rows).to_f64());
    principal(&power_step(rows, &once).to_f64())
}

/// The Gram matrix of the mean of two halves, from theirs and the one between them.
fn mean_gram([a, b]: &[Dense<f64>; 2], cross: &Dense<f64>) -> Dense<f64> {
    let k = cross.n_rows;
    let entry = |i: usize| 0.25 * (a.data[i] + b.data[i] + cross.data[i] + cross.data[i % k * k + i / k]);
    Dense { n_rows: k, n_cols: k, data: (0..k * k).map(entry).collect() }
}

/// Eigenvalues of a Gram matrix and their vectors, largest first.
type Eigen = (Vec<f64>, Dense<f64>);

/// How many leading components of a half the other one may confirm, up to those that leave no more than `enough`.
fn worth((values, vectors): &Eigen, cross: &Dense<f64>, agreement: f64, enough: f64) -> usize {
    let signals = signals(vectors, cross);
    let mut left: f64 = signals.iter().map(|signal| signal.max(0.0)).sum();
    let needed = signals.iter().position(|signal| {
        let within = left <= enough;
        left -= signal.max(0.0);
        within
    });
    let confirmed = signals.iter().zip(values).filter(|(signal, value)| **signal > agreement * **value).count();
    confirmed.min(needed.unwrap_or(signals.len()))
}

/// Leading left singular vectors, rows × at most `width`.
fn range(coefficients: &Dense<f64>, (values, vectors): &Eigen, width: usize) -> Dense<f32> {
    let mut range = product(coefficients.view(), vectors.first_cols(width).view());
    for row in 0..range.n_rows {
        range.row_mut(row).iter_mut().zip(values).for_each(|(x, value)| *x /= value.sqrt());
    }
    range.to_f32()
}

/// Right singular vectors of a wide matrix, as rows, largest first.
fn principal(wide: &Dense<f64>) -> Dense<f32> {
    right_vectors(wide).to_f32()
}

/// What both halves hold in common of each component: vᵀ AᵀB v.
fn signals(vectors: &Dense<f64>, cross: &Dense<f64>) -> Vec<f64> {
    let crossed = product(cross.view(), vectors.view());
    (0..vectors.n_cols).map(|r| (0..vectors.n_rows).map(|i| vectors.row(i)[r] * crossed.row(i)[r]).sum()).collect()
}

/// Both halves met with all bases at once: reading the halves is what costs.
fn fits<const N: usize>(means: &Means, bases: [Dense<f32>; N], n_landmarks: usize) -> [Fit; N] {
    if means.is_exact() {
        let met = coefficients(&means.a, &bases[0]);
        return bases.map(|basis| Fit { basis, a: met.clone(), b: met.clone(), n_landmarks });
    }
    let mut all = Dense::zeros(0, means.mean.n_cols);
    for basis in &bases {
        all.data.extend_from_slice(&basis.data);
        all.n_rows += basis.n_rows;
    }
    let [with_a, with_b] = [&means.a, &means.b].map(|half| coefficients(half, &all));
    let mut first = 0;
    bases.map(|basis| {
        let columns = first..first + basis.n_rows;
        first = columns.end;
        let [a, b] = [&with_a, &with_b].map(|with| with.cols(columns.clone()));
        Fit { basis, a, b, n_landmarks }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{dense::tests::random, product::product};

    /// A dozen components, and both halves the same.
    fn exact() -> Means {
        let mut rng = Random::new([41, 0]);
        let (left, right) = (random(300, 12, &mut rng), random(12, 80, &mut rng));
        let values = product(left.view(), right.view());
        let mut means = Means::default();
        means.fill([&values.data, &values.data], 80, &(0..80), [1; 2]).unwrap();
        means
    }

    #[test]
    fn halves_that_are_the_same_are_decomposed_once_with_the_same_result() {
        let fits = |means: &Means| -> [Fit; 3] {
            let tolerance = Tolerance::RelativeFrobenius(1e-3);
            fitted(means, 3, tolerance, &CompressConfig::default(), Random::new([1, 2]))
        };
        let mut means = exact();
        assert!(means.is_exact());
        let once = fits(&means);
        means.noise[0] = f64::MIN_POSITIVE;
        assert!(!means.is_exact());
        for (once, each) in once.iter().zip(&fits(&means)) {
            assert!(once.basis.n_rows >= 12 && once.basis == each.basis, "{} components", once.basis.n_rows);
            assert!(once.a == each.a && once.b == each.b);
        }
    }

    #[test]
    fn a_span_is_narrowed_only_where_that_loses_little() {
        let (means, mut rng) = (exact(), Random::new([42, 0]));
        let (left, right) = (random(300, 12, &mut rng), random(12, 60, &mut rng));
        let mut wide = product(left.view(), right.view());
        wide.data.iter_mut().zip(random(300, 60, &mut rng).data).for_each(|(x, other)| *x += 0.01 * other);
        let [a, b] = narrowed(&means, [&wide, &wide], 1e-3, &mut rng).unwrap();
        assert!(a.n_cols == 32 && a == b, "{} dimensions", a.n_cols);
        let lost = wide.inner_product(&wide) - a.inner_product(&b);
        assert!(lost.abs() < 2.0, "{lost} of {}", wide.inner_product(&wide));
        assert!(narrowed(&means, [&wide, &wide], 0.0, &mut rng).is_none());
        let flat = random(300, 60, &mut rng);
        assert!(narrowed(&means, [&flat, &flat], 1e-3, &mut rng).is_none());
    }

    #[test]
    fn a_span_that_is_too_narrow_is_widened_for_both_halves() {
        let (mut means, mut rng) = (exact(), Random::new([43, 0]));
        means.noise[0] = f64::MIN_POSITIVE;
        // Forty components of sixty dimensions: more than the first width that is tried holds, fewer than the second.
        let wide = product(random(300, 40, &mut rng).view(), random(40, 60, &mut rng).view());
        let mut noisy = wide.clone();
        noisy.data.iter_mut().zip(random(300, 60, &mut rng).data).for_each(|(x, noise)| *x += 1e-3 * noise);
        let [a, b] = narrowed(&means, [&wide, &noisy], 1e-3, &mut rng).unwrap();
        assert!(a.n_cols == 40 && b.n_cols == 40 && a != b, "{} and {} dimensions", a.n_cols, b.n_cols);
        let lost = wide.inner_product(&noisy) - a.inner_product(&b);
        assert!(lost.abs() < 4.0, "{lost} of {}", wide.inner_product(&noisy));
    }
}
