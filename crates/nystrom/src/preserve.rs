//! One combination of the columns that truncation leaves alone.
//!
//! Truncation drops what is weak or unsure, and what it drops is missing in every product with the factors, most visibly in
//! the one that is asked for most. So the factors take the residual of that one product: the least change for which
//! `left · right · x` is what was sampled. Least in the Frobenius norm, as long as that stays within the tolerance. Where it
//! does not, the residual is the noise of a few columns, which would drown the others if it were spread over all: there the
//! change of each column counts beside its own noise.

use crate::{dense::Dense, fit::Fit, level::Level, means::Means};

/// Least share of the product that the basis must hold to carry a change of it.
pub(crate) const LEAST_SHARE: f64 = 0.25;

/// Mean squares per entry that keeping a product adds: truncation, sampling.
pub(crate) type Added = [f64; 2];

/// Changes `left` (rows × components of `fit`, the mean's own coefficients) so that its product with `direction` equals the
/// mean's, and its noise `doubt` accordingly. A basis that hardly holds what that takes gets it as a component of its own. `goal` is the mean square error per
/// entry that is allowed, 0 where a rank is asked for. What is handed back counts in the columns themselves, where those of `means` are divided.
pub(crate) fn preserve(
    means: &Means,
    fit: &mut Fit,
    [left, doubt]: [&mut Dense<f32>; 2],
    direction: &[f32],
    goal: f64,
    level: Option<&Level>,
) -> Added {
    let direction = nonzero_part(means, direction);
    let norm = direction.iter().map(|x| x.powi(2)).sum::<f64>().sqrt();
    if norm == 0.0 || !norm.is_finite() || means.mean.data.iter().all(|&x| x == 0.0) {
        return [0.0; 2];
    }
    let unit: Vec<f64> = direction.iter().map(|x| x / norm).collect();
    let sampled = [&means.a, &means.b].map(|half| product(half, &unit));
    let mut change = Change::new(fit, &unit, unit.clone());
    let mut added = change.added(means, fit, &sampled);
    if goal > 0.0 && added.iter().sum::<f64>() > goal {
        change = Change::new(fit, &unit, beside_noise(means, &unit, goal));
        added = change.added(means, fit, &sampled);
    }
    if change.share >= LEAST_SHARE {
        change.make(means, [left, doubt], &sampled);
        return added.map(|x| x * times(level, &change.kept(fit)));
    }
    let added = append(means, fit, [&mut *left, &mut *doubt], &change);
    let last: Vec<f64> = fit.basis.row(fit.basis.n_rows - 1).iter().map(|x| f64::from(*x)).collect();
    let [truncation, sampling] = added.map(|x| x * times(level, &last));
    let change = Change::new(fit, &unit, change.row);
    let spread = change.make(means, [left, doubt], &sampled) * times(level, &change.kept(fit));
    [truncation, sampling + spread]
}

/// Noise of the product of the mean of two samplings with a direction, which stays in it whatever the rank: mean square over the square of
/// the product at the peaks, 1, of all columns that are not zero.
pub(crate) fn product_noise(means: &Means, direction: &[f32]) -> f64 {
    let direction = nonzero_part(means, direction);
    let peak: f64 = direction.iter().map(|x| x.abs()).sum();
    if peak == 0.0 || means.is_exact() {
        return 0.0;
    }
    let [a, b] = [&means.a, &means.b].map(|half| product(half, &direction));
    let squares: f64 = a.iter().zip(&b).map(|(a, b)| 0.25 * (a - b).powi(2)).sum();
    squares / (peak * peak * means.mean.n_rows as f64)
}

/// A direction without the columns that are zero in both halves, which have no part in the product and get none of its residual.
fn nonzero_part(means: &Means, direction: &[f32]) -> Vec<f64> {
    let mut is_nonzero = vec![false; direction.len()];
    for half in [&means.a, &means.b] {
        for row in half.data.chunks_exact(direction.len().max(1)) {
            is_nonzero.iter_mut().zip(row).for_each(|(is_nonzero, x)| *is_nonzero |= *x != 0.0);
        }
    }
    direction.iter().zip(is_nonzero).map(|(&x, is_nonzero)| if is_nonzero { f64::from(x) } else { 0.0 }).collect()
}

/// Of each row in both halves the product with the direction.
type Products = [Vec<f64>; 2];

/// What a row gets for each unit of the product that it lacks.
struct Change {
    /// One value per column; its product with the direction is 1.
    row: Vec<f64>,
    /// What the basis holds of it.
    held: Vec<f64>,
    /// What the basis holds of the direction.
    along: Vec<f64>,
    /// The product of both: what is left of the 1.
    share: f64,
}

impl Change {
    fn new(fit: &Fit, unit: &[f64], row: Vec<f64>) -> Self {
        let in_basis = |x: &[f64]| -> Vec<f64> { (0..fit.basis.n_rows).map(|r| dot(fit.basis.row(r), x)).collect() };
        let (held, along) = (in_basis(&row), in_basis(unit));
        let share = inner(held.iter().copied(), &along);
        Self { row, held, along, share }
    }

    /// Square of the change of a row for one unit of the product.
    fn square(&self) -> f64 {
        inner(self.held.iter().copied(), &self.held) / (self.share * self.share)
    }

    /// The row that is left of it in the basis.
    fn kept(&self, fit: &Fit) -> Vec<f64> {
        let mut row = vec![0.0; fit.basis.n_cols];
        for (r, held) in self.held.iter().enumerate() {
            row.iter_mut().zip(fit.basis.row(r)).for_each(|(x, v)| *x += held * f64::from(*v));
        }
        row
    }

    /// Mean squares per entry that it adds, from the products of both halves' rows with the direction; infinite where the basis
    /// holds nothing of it.
    fn added(&self, means: &Means, fit: &Fit, [a, b]: &Products) -> Added {
        let mut added = [0.0; 2];
        for row in 0..means.mean.n_rows {
            let of_a = a[row] - dot(fit.a.row(row), &self.along);
            let of_b = b[row] - dot(fit.b.row(row), &self.along);
            added[0] += of_a * of_b;
            added[1] += 0.25 * (of_a - of_b).powi(2);
        }
        if self.share > 0.0 { added.map(|sum| sum * self.square() / means.n_entries()) } else { [0.0, f64::INFINITY] }
    }

    /// Gives all rows what they lack, and says what mean square per entry that is.
    fn make(&self, means: &Means, [left, doubt]: [&mut Dense<f32>; 2], [a, b]: &Products) -> f64 {
        let mut squares = 0.0;
        for row in 0..left.n_rows {
            let lacks = 0.5 * (a[row] + b[row]) - dot(left.row(row), &self.along);
            self.give(lacks, left.row_mut(row));
            let noise = 0.5 * (a[row] - b[row]);
            self.give(noise - dot(doubt.row(row), &self.along), doubt.row_mut(row));
            squares += lacks * lacks;
        }
        squares * self.square() / means.n_entries()
    }

    /// Changes a row of a left factor so that its product with the direction becomes as much greater.
    fn give(&self, lacks: f64, row: &mut [f32]) {
        let missing = lacks / self.share;
        row.iter_mut().zip(&self.held).for_each(|(x, held)| *x += (missing * held) as f32);
    }
}

/// The change of a row that is least when each column counts beside its noise and what is allowed anyway.
fn beside_noise(means: &Means, unit: &[f64], goal: f64) -> Vec<f64> {
    let mut squares = vec![0.0f32; unit.len()];
    for row in 0..means.mean.n_rows {
        let both = means.a.row(row).iter().zip(means.b.row(row));
        squares.iter_mut().zip(both).for_each(|(square, (a, b))| *square += (a - b) * (a - b));
    }
    let per_row = 0.25 / means.mean.n_rows as f64;
    let weighted: Vec<f64> =
        squares.iter().zip(unit).map(|(square, x)| (per_row * f64::from(*square) + goal) * x).collect();
    let product = inner(weighted.iter().copied(), unit);
    weighted.into_iter().map(|x| x / product).collect()
}

/// Adds what the basis lacks of a change as a last component, as it was sampled: what it was off before is the noise that comes
/// with it now.
fn append(means: &Means, fit: &mut Fit, [left, doubt]: [&mut Dense<f32>; 2], change: &Change) -> Added {
    let mut lacking = change.row.clone();
    for (r, held) in change.held.iter().enumerate() {
        lacking.iter_mut().zip(fit.basis.row(r)).for_each(|(x, v)| *x -= held * f64::from(*v));
    }
    let norm = inner(lacking.iter().copied(), &lacking).sqrt();
    lacking.iter_mut().for_each(|x| *x /= norm);
    let [a, b] = [&means.a, &means.b].map(|half| product(half, &lacking));
    fit.basis.data.extend(lacking.iter().map(|&x| x as f32));
    fit.basis.n_rows += 1;
    let mut added = [0.0; 2];
    for (a, b) in a.iter().zip(&b) {
        added[0] -= a * b;
        added[1] += 0.25 * (a - b).powi(2);
    }
    widen(left, a.iter().zip(&b).map(|(a, b)| 0.5 * (a + b)));
    widen(doubt, a.iter().zip(&b).map(|(a, b)| 0.5 * (a - b)));
    added.map(|sum| sum / means.n_entries())
}

/// How many times the square of a row of divided columns counts in the columns themselves.
fn times(level: Option<&Level>, row: &[f64]) -> f64 {
    let own = inner(row.iter().copied(), row);
    level.filter(|_| own > 0.0).map_or(1.0, |level| level.square(row) / own)
}

/// The product of each row with a vector.
fn product(rows: &Dense<f32>, x: &[f64]) -> Vec<f64> {
    (0..rows.n_rows).map(|row| dot(rows.row(row), x)).collect()
}

/// Adds a last column.
fn widen(matrix: &mut Dense<f32>, last: impl Iterator<Item = f64>) {
    let mut wider = Dense::zeros(matrix.n_rows, matrix.n_cols + 1);
    for (row, last) in last.enumerate() {
        let (out, own) = wider.row_mut(row).split_at_mut(matrix.n_cols);
        out.copy_from_slice(matrix.row(row));
        own[0] = last as f32;
    }
    *matrix = wider;
}

fn inner(a: impl Iterator<Item = f64>, b: &[f64]) -> f64 {
    a.zip(b).map(|(x, y)| x * y).sum()
}

/// Scalar product, in eight partial sums.
fn dot(a: &[f32], b: &[f64]) -> f64 {
    let ((a8, a), (b8, b)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    let rest: f64 = a.iter().zip(b).map(|(a, b)| f64::from(*a) * b).sum();
    let mut sums = [0.0; 8];
    for (a, b) in a8.iter().zip(b8) {
        for lane in 0..8 {
            sums[lane] += f64::from(a[lane]) * b[lane];
        }
    }
    rest + sums.iter().sum::<f64>()
}

#[cfg(test)]
mod tests {
    use crate::compress::{BlockSamples, ColumnGroup, CompressConfig, Tolerance, compress_block};
    use crate::random::Random;

    const N_ROWS: usize = 768;
    const N_COLS: usize = 16;

    /// Fifteen quiet columns of one wave, and a last one that hardly anything but rare large samples is in.
    fn halves() -> [Vec<f32>; 2] {
        let mut rng = Random::new([77, 3]);
        let mut half = || {
            let mut data = vec![0.0; N_ROWS * N_COLS];
            for (row, values) in data.as_chunks_mut::<N_COLS>().0.iter_mut().enumerate() {
                let wave = 0.1 + 0.05 * (row as f32 * 0.02).sin();
                values.iter_mut().for_each(|x| *x = wave + 0.002 * rng.normal());
                let is_large = rng.normal() > 2.5;
                values[N_COLS - 1] += if is_large { 100.0 } else { 0.0 };
            }
            data
        };
        [half(), half()]
    }

    #[test]
    fn the_noise_of_one_column_stays_in_it() {
        let [a, b] = halves();
        let samples =
            BlockSamples { halves: [&a, &b], sparse: [&[]; 2], n_cols: N_COLS, bundle_len: 3, n_samples: [1; 2] };
        let tolerance = Tolerance::AbsoluteMeanSquare(1e-4);
        let group = ColumnGroup { columns: 0..N_COLS, tolerance, preserved: vec![1.0; N_COLS], share: 1.0, apart: 0.0 };
        let config = CompressConfig { groups: vec![group], ..CompressConfig::default() };
        let factors = compress_block(&samples, &config, 0).unwrap().remove(0);
        let dense = factors.dense();
        let rows =
            || dense.as_chunks::<N_COLS>().0.iter().zip(a.as_chunks::<N_COLS>().0).zip(b.as_chunks::<N_COLS>().0);
        let mut quiet = 0.0;
        for (row, ((got, a), b)) in rows().enumerate() {
            let wave = 0.1 + 0.05 * (row as f32 * 0.02).sin();
            quiet += got[..N_COLS - 1].iter().map(|x| (x - wave).powi(2)).sum::<f32>();
            let (got, sampled) = (got.iter().sum::<f32>(), 0.5 * (a.iter().sum::<f32>() + b.iter().sum::<f32>()));
            assert!((got - sampled).abs() < 2e-3 * sampled, "row {row}: {got} where {sampled} was sampled");
        }
        let quiet = quiet / (N_ROWS * (N_COLS - 1)) as f32;
        assert!(quiet < 1e-4, "{quiet:e}");
        // What stays in the last one is told.
        assert!(factors.error.truncation + factors.error.sampling > 0.3, "{:?}", factors.error);
    }
}
