//! The cases themselves, generated from a seed.

use nalgebra::DMatrix;

use super::Case;
use crate::random::Random;

/// Rows and columns of a case whose shape does not matter: enough for landmarks to be a choice, few enough for a full
/// decomposition per method.
const SHAPE: (usize, usize) = (96, 64);
/// Rank that is asked for where it does not matter.
const RANK: usize = 12;

/// All cases that have an answer. The same seed gives the same numbers.
pub fn cases(seed: u64) -> Vec<Case> {
    let rng = &mut Random::new([seed, 0x57]);
    let mut cases = alike(rng);
    cases.extend(empty(rng));
    cases.extend(spectra(rng));
    cases.extend(scales(rng));
    cases.extend(shapes(rng));
    cases.extend(noises(rng));
    cases
}

/// Cases that have no answer: each has one sample, in one of its halves, that is no number. Its row and column stand beside.
pub fn refused(seed: u64) -> Vec<(Case, [usize; 2])> {
    let rng = &mut Random::new([seed, 0x58]);
    let odd = [("not a number", f32::NAN), ("infinity", f32::INFINITY), ("minus infinity", f32::NEG_INFINITY)];
    let refused = odd.map(|(name, odd)| {
        let mut case = exact(name, smooth(SHAPE, rng), RANK);
        let at = [rng.below(SHAPE.0), rng.below(SHAPE.1)];
        case.halves[rng.below(2)][(at[0], at[1])] = odd;
        (case, at)
    });
    refused.into()
}

/// A case without noise, rows in bundles of three where they can be.
fn exact(name: &'static str, matrix: DMatrix<f64>, rank: usize) -> Case {
    let truth = matrix.map(|x| x as f32);
    let bundle_len = if truth.nrows().is_multiple_of(3) { 3 } else { 1 };
    Case { name, halves: [truth.clone(), truth.clone()], truth, bundle_len, rank }
}

fn normal((n_rows, n_cols): (usize, usize), rng: &mut Random) -> DMatrix<f64> {
    DMatrix::from_fn(n_rows, n_cols, |_, _| f64::from(rng.normal()))
}

/// Singular values fall by 0.7 from one to the next; entries are about 1.
fn smooth((n_rows, n_cols): (usize, usize), rng: &mut Random) -> DMatrix<f64> {
    let rank = n_rows.min(n_cols).min(40);
    let mut left = normal((n_rows, rank), rng);
    left.column_iter_mut().enumerate().for_each(|(r, mut column)| column *= 0.7f64.powi(r as i32));
    left * normal((rank, n_cols), rng)
}

/// Rows and columns that are alike, or nearly so.
fn alike(rng: &mut Random) -> Vec<Case> {
    let clean = smooth(SHAPE, rng);
    let rows = DMatrix::from_fn(SHAPE.0, SHAPE.1, |row, col| clean[(row % 24, col)]);
    let cols = DMatrix::from_fn(SHAPE.0, SHAPE.1, |row, col| clean[(row, col / 4)]);
    let both = DMatrix::from_fn(SHAPE.0, SHAPE.1, |row, col| clean[(row / 4, col % 16)]);
    let first = clean.row(0).into_owned();
    let rests = normal(SHAPE, rng) * 1e-6;
    let nearly =
        DMatrix::from_fn(SHAPE.0, SHAPE.1, |row, col| first[col] * (1.0 + (row % 7) as f64) + rests[(row, col)]);
    vec![
        exact("decaying spectrum", clean, RANK),
        exact("rows four times", rows, RANK),
        exact("columns four times", cols, RANK),
        exact("rows and columns four times", both, RANK),
        exact("rows parallel but for 1e-6", nearly, RANK),
    ]
}

/// Rows, columns, whole blocks of zeros.
fn empty(rng: &mut Random) -> Vec<Case> {
    let clean = smooth(SHAPE, rng);
    let kept: Vec<bool> = (0..SHAPE.0).map(|_| rng.unit() < 0.4).collect();
    let rows = DMatrix::from_fn(SHAPE.0, SHAPE.1, |row, col| if kept[row] { clean[(row, col)] } else { 0.0 });
    let cols = DMatrix::from_fn(SHAPE.0, SHAPE.1, |row, col| if col % 5 < 2 { clean[(row, col)] } else { 0.0 });
    let lone_row = DMatrix::from_fn(SHAPE.0, SHAPE.1, |row, col| if row == 71 { clean[(row, col)] } else { 0.0 });
    let mut entry = DMatrix::zeros(SHAPE.0, SHAPE.1);
    entry[(rng.below(SHAPE.0), rng.below(SHAPE.1))] = 3.0;
    vec![
        exact("three in five rows zero", rows, RANK),
        exact("three in five columns zero", cols, RANK),
        exact("one row", lone_row, RANK),
        exact("one entry", entry, RANK),
        exact("all zero", DMatrix::zeros(SHAPE.0, SHAPE.1), RANK),
    ]
}

/// Spectra from one singular value to all alike, and matrices that textbooks fear.
fn spectra(rng: &mut Random) -> Vec<Case> {
    let (rows, cols) = SHAPE;
    let thin = |rank: usize, rng: &mut Random| normal((rows, rank), rng) * normal((rank, cols), rng);
    let steps = DMatrix::from_fn(rows, cols, |row, col| if row * cols < col * rows { 1.0 } else { 0.0 });
    let nodes: Vec<f64> = (0..rows).map(|i| 2.0 * i as f64 / (rows - 1) as f64 - 1.0).collect();
    // [Kahan1966]: pivoting by columns sees no reason to pivot, and the last column hides the least singular value.
    let (sine, cosine) = (0.285f64.sin(), 0.285f64.cos());
    let kahan = DMatrix::from_fn(cols, cols, |row, col| {
        sine.powi(row as i32)
            * if row == col {
                1.0
            } else if row < col {
                -cosine
            } else {
                0.0
            }
    });
    vec![
        exact("rank 1", thin(1, rng), RANK),
        exact("rank 3", thin(3, rng), RANK),
        exact("full rank, twelve asked for", normal(SHAPE, rng), RANK),
        exact("full rank, all asked for", normal((48, 32), rng), 32),
        exact("rank 1 and a tail of 4e-6, all asked for", thin(1, rng) + normal(SHAPE, rng) * 4e-6, cols),
        exact("identity", DMatrix::identity(rows, cols), RANK),
        exact("triangle of ones", steps, RANK),
        exact("Hilbert", DMatrix::from_fn(rows, cols, |row, col| 1.0 / (row + col + 1) as f64), RANK),
        exact("Vandermonde", DMatrix::from_fn(rows, cols, |row, col| nodes[row].powi(col as i32)), RANK),
        exact("Kahan", kahan, RANK),
    ]
}

/// Rows, columns and whole matrices of very different magnitude.
fn scales(rng: &mut Random) -> Vec<Case> {
    let clean = smooth(SHAPE, rng);
    let mut decades = |n: usize| -> Vec<f64> { (0..n).map(|_| 10f64.powf(24.0 * rng.unit() - 12.0)).collect() };
    let (of_row, of_col) = (decades(SHAPE.0), decades(SHAPE.1));
    let scaled = |scale: &dyn Fn(usize, usize) -> f64| {
        DMatrix::from_fn(SHAPE.0, SHAPE.1, |row, col| clean[(row, col)] * scale(row, col))
    };
    let every_other = |row: usize, col: usize| if (row + col).is_multiple_of(2) { 1.0f64 } else { 1e-40 };
    let mut spike = clean.clone();
    spike[(50, 20)] += 1e6;
    vec![
        exact("row scales 1e±12", scaled(&|row, _| of_row[row]), RANK),
        exact("column scales 1e±12", scaled(&|_, col| of_col[col]), RANK),
        exact("row and column scales 1e±12", scaled(&|row, col| of_row[row] * of_col[col]), RANK),
        exact("row scales 1e±12, all asked for", scaled(&|row, _| of_row[row]), SHAPE.1),
        exact("scale 1e30", scaled(&|_, _| 1e30), RANK),
        exact("scale 1e-30", scaled(&|_, _| 1e-30), RANK),
        exact("denormal numbers", scaled(&|_, _| 1e-40), RANK),
        exact("every other entry denormal", scaled(&every_other), RANK),
        exact("one entry of 1e6", spike, RANK),
    ]
}

/// Shapes at the limits.
fn shapes(rng: &mut Random) -> Vec<Case> {
    vec![
        exact("1 × 1", normal((1, 1), rng), 1),
        exact("one row of 200", normal((1, 200), rng), RANK),
        exact("one column of 200", normal((200, 1), rng), RANK),
        exact("more landmarks than rows", normal((10, 64), rng), 32),
        exact("more landmarks than columns", normal((96, 5), rng), 32),
        exact("48 × 4096", smooth((48, 4096), rng), RANK),
        exact("1536 × 40", smooth((1536, 40), rng), RANK),
    ]
}

/// Noise of each entry of each half, in parts of the signal's.
fn noises(rng: &mut Random) -> Vec<Case> {
    let levels = [
        ("noise 1e-6", 1e-6),
        ("noise 1e-4", 1e-4),
        ("noise 0.01", 0.01),
        ("noise 0.1", 0.1),
        ("noise 1", 1.0),
        ("noise 10", 10.0),
    ];
    let mut cases: Vec<Case> =
        levels.map(|(name, level)| noisy(exact(name, smooth(SHAPE, rng), RANK), level, rng)).into();
    let mut one_sided = noisy(exact("1e6 in one entry of one half", smooth(SHAPE, rng), RANK), 0.1, rng);
    one_sided.halves[0][(50, 20)] += 1e6;
    cases.push(one_sided);
    cases.push(noisy(exact("noise alone", DMatrix::zeros(SHAPE.0, SHAPE.1), RANK), 1.0, rng));
    cases
}

fn noisy(mut case: Case, level: f64, rng: &mut Random) -> Case {
    let entries = case.truth.len() as f64;
    let signal = if case.norm() > 0.0 { case.norm() / entries.sqrt() } else { 1.0 };
    for half in &mut case.halves {
        half.iter_mut().for_each(|x| *x = (f64::from(*x) + level * signal * f64::from(rng.normal())) as f32);
    }
    case
}
