//! The compressed form of one block: `left · diag(scale) · right + sparse`.

use half::{f16, slice::HalfFloatSliceExt};

use crate::matrix::SparseEntry;

/// Mean squares per entry of a block, its sparse part aside. Single precision ends about where errors of 1e±19 do: a greater one is told
/// as its greatest number, a far lesser one as 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BlockError {
    /// What the chosen rank leaves out whatever the noise does: the product of what two fits, each to one half of the
    /// samples, miss of their halves (so that noise does not count; a single block's figure can be negative). Of a block that was
    /// [smoothed](crate::Smoothing) that of the smoothed halves, never negative, and what its weights are expected to lose. Of columns
    /// that are [kept as they were sampled](crate::CompressConfig::verbatim) nothing, until they are packed.
    pub truncation: f32,
    /// Sampling noise that stays in the factors, that which turned the bases included: a quarter of the squared difference
    /// of the two fits; without fits a quarter of that of the halves. Where nothing was smoothed or [denoised](crate::Denoiser), it
    /// is together with `truncation` an unbiased figure for the mean of the two fits.
    pub sampling: f32,
    /// Sampling noise of the entries as they were sampled, before compression.
    pub noise: f32,
}

impl BlockError {
    /// Whether all three are finite. A map of errors would show what is no number as no error at all.
    pub(crate) fn is_finite(&self) -> bool {
        [self.truncation, self.sampling, self.noise].into_iter().all(f32::is_finite)
    }

    /// Standard deviation of `truncation + sampling` of a block of so many entries that was neither smoothed nor
    /// [denoised](crate::Denoiser), when the noise is another one. Their sum is right in the mean and no bound: it is the inner
    /// product of what two fits leave of their halves, an error e that they have in common and noise. With s the variance of the noise
    /// of an entry of the mean, each half has noise of 2s, so the variance of that product is `4s²` per entry and `4s‖e‖²`.
    pub fn deviation(&self, n_entries: usize) -> f64 {
        let told = f64::from(self.truncation) + f64::from(self.sampling);
        deviation(f64::from(self.noise), told, n_entries as f64)
    }
}

/// The same in double precision: noise and what is told are mean squares per entry.
pub(crate) fn deviation(noise: f64, told: f64, n_entries: f64) -> f64 {
    2.0 * (noise * (noise + told.max(0.0)) / n_entries.max(1.0)).sqrt()
}

/// Octaves by which the largest number of a component lies above 1 as a half: rows far below one that is very large keep eleven bits, and
/// noise in the same scale may still be greater than what it is the noise of.
const ROOM: i32 = 8;
/// Power of two of the greatest scale whose product with such a number single precision holds, unless that rounds up to 2^(ROOM + 1).
const GREATEST_SCALE: i32 = f32::MAX_EXP - 1 - ROOM;

/// One block of a matrix, compressed: `left · diag(scale) · right + sparse`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BlockFactors {
    /// Rows of the block.
    pub n_rows: u32,
    /// Columns of the block's group.
    pub n_cols: u32,
    /// Rank; 0 is an all-zero block.
    pub rank: u32,
    /// Row-major, rows × rank.
    pub left: Vec<f16>,
    /// One per component, a power of two; 0 where that is less than single precision holds.
    pub scale: Vec<f32>,
    /// Row-major, rank × columns.
    pub right: Vec<f16>,
    /// Row-major, rows × rank, in the scale of `left`: half of what the two halves of the samples differ by, noise like that of
    /// `left`. Empty where it is not known.
    pub doubt: Vec<f16>,
    /// Mean square error per entry of each column, truncation and sampling together, its sparse part aside: their mean is that of the block
    /// as it was compressed. Empty where it is not known.
    pub column_errors: Vec<f32>,
    /// Entries that no low rank holds, sorted by row, then column; each once.
    pub sparse: Vec<SparseEntry>,
    /// Samples per row that the factors are the mean of, both halves together.
    pub n_samples: u32,
    /// What was measured.
    pub error: BlockError,
}

impl BlockFactors {
    /// Packs `left · right` without a sparse part: row-major rows × rank and rank × columns.
    ///
    /// Each column of `left` and each row of `right` is divided by a power of two that brings it into the range of `f16`;
    /// `scale` gives their product back. Components that are all zero stay zero.
    pub fn from_f32(left: &[f32], right: &[f32], n_rows: usize, n_cols: usize, rank: usize) -> Self {
        Self::in_unit(0, left, right, [n_rows, n_cols, rank])
    }

    /// The same of a left factor whose values are to be multiplied by 2^unit, which by themselves may be beyond single precision.
    pub(crate) fn in_unit(unit: i32, left: &[f32], right: &[f32], [n_rows, n_cols, rank]: [usize; 3]) -> Self {
        assert!(
            left.len() == n_rows * rank && right.len() == rank * n_cols,
            "factors do not fit {n_rows} × {rank} × {n_cols}"
        );
        let mut factors = Self { n_rows: n_rows as u32, n_cols: n_cols as u32, rank: rank as u32, ..Self::default() };
        let left_exponents = exponents_of_columns(unit, left, rank);
        let largest = |row: &[f32]| row.iter().fold(0.0f32, |largest, x| largest.max(x.abs()));
        let right_exponents: Vec<i32> = right.chunks(n_cols.max(1)).map(|row| exponent(largest(row))).collect();
        factors.left = scaled_columns(left, &left_exponents);
        let rows = right.chunks(n_cols.max(1)).zip(&right_exponents);
        let rows = rows.map(|(row, exponent)| (row, power_of_two(-exponent)));
        let scaled = rows.flat_map(|(row, power)| row.iter().map(move |&x| held(f64::from(x) * power)));
        factors.right = rounded(&scaled.collect::<Vec<_>>());
        factors.scale = (0..rank).map(|r| scale(left_exponents[r] + right_exponents[r] + unit)).collect();
        factors
    }

    /// Packs the noise of `left` in the scale of that; both row-major rows × rank, in the unit that `left` was packed in. What is greater
    /// than a half holds there is told as the greatest one.
    pub(crate) fn with_doubt(mut self, unit: i32, doubt: &[f32], left: &[f32]) -> Self {
        let exponents = exponents_of_columns(unit, left, self.rank as usize);
        self.doubt = scaled_columns(doubt, &exponents);
        self
    }

    /// The same right factor and sparse part with another left factor, row-major rows × rank, for `right` as it is; its noise is
    /// not known.
    pub(crate) fn with_left(&self, left: &[f32]) -> Self {
        let exponents = exponents_of_columns(0, left, self.rank as usize);
        Self {
            left: scaled_columns(left, &exponents),
            scale: exponents.iter().map(|&exponent| scale(exponent)).collect(),
            doubt: Vec::new(),
            column_errors: self.column_errors.clone(),
            right: self.right.clone(),
            sparse: self.sparse.clone(),
            ..*self
        }
    }

    /// Whether a row is zero in every column and has no noise, its sparse part aside.
    pub(crate) fn is_zero_row(&self, row: usize) -> bool {
        let rank = self.rank as usize;
        let is_zero =
            |values: &[f16]| values.is_empty() || values[row * rank..][..rank].iter().all(|x| x.to_f32() == 0.0);
        is_zero(&self.left) && is_zero(&self.doubt)
    }

    /// One entry, its sparse part included.
    pub fn entry(&self, row: usize, col: usize) -> f32 {
        let rank = self.rank as usize;
        let product = |r: usize| {
            self.left[row * rank + r].to_f32() * self.scale[r] * self.right[r * self.n_cols as usize + col].to_f32()
        };
        let low_rank: f32 = (0..rank).map(product).sum();
        let key = (row as u32, col as u32);
        let sparse = self.sparse.binary_search_by_key(&key, |entry| (entry.row, entry.col));
        low_rank + sparse.map_or(0.0, |i| self.sparse[i].value)
    }

    /// One row (one value per column), its sparse part included; `out` is overwritten.
    pub fn row(&self, row: usize, out: &mut [f32]) {
        self.low_rank_row(row, out);
        let first = self.sparse.partition_point(|entry| (entry.row as usize) < row);
        for entry in self.sparse[first..].iter().take_while(|entry| entry.row as usize == row) {
            out[entry.col as usize] += entry.value;
        }
    }

    /// One row without its sparse part; `out` is overwritten.
    pub fn low_rank_row(&self, row: usize, out: &mut [f32]) {
        let (rank, n_cols) = (self.rank as usize, self.n_cols as usize);
        out.fill(0.0);
        for r in 0..rank {
            let left = self.left[row * rank + r].to_f32() * self.scale[r];
            for (out, right) in out.iter_mut().zip(&self.right[r * n_cols..][..n_cols]) {
                *out += left * right.to_f32();
            }
        }
    }

    /// The product with a vector of one value per column: one value per row.
    pub fn apply(&self, x: &[f32]) -> Vec<f32> {
        let (rank, n_cols) = (self.rank as usize, self.n_cols as usize);
        assert!(x.len() == n_cols, "a vector of {} values does not fit {n_cols} columns", x.len());
        let inner = |r: usize| -> f32 {
            let right = &self.right[r * n_cols..][..n_cols];
            self.scale[r] * right.iter().zip(x).map(|(right, x)| right.to_f32() * x).sum::<f32>()
        };
        let inner: Vec<f32> = (0..rank).map(inner).collect();
        let low_rank = |row: usize| {
            let left = &self.left[row * rank..][..rank];
            left.iter().zip(&inner).map(|(left, inner)| left.to_f32() * inner).sum()
        };
        let mut out: Vec<f32> = (0..self.n_rows as usize).map(low_rank).collect();
        for entry in &self.sparse {
            out[entry.row as usize] += entry.value * x[entry.col as usize];
        }
        out
    }

    /// All entries, row-major, rows × columns.
    pub fn dense(&self) -> Vec<f32> {
        let mut out = vec![0.0; self.n_rows as usize * self.n_cols as usize];
        for (row, out) in out.chunks_mut((self.n_cols as usize).max(1)).enumerate() {
            self.row(row, out);
        }
        out
    }

    /// Some of the columns, each once, in the order given: what is left of each entry is the same.
    #[must_use]
    pub fn with_columns(&self, columns: &[u32]) -> Self {
        let n_cols = self.n_cols as usize;
        let rows = (0..self.rank as usize).map(|r| &self.right[r * n_cols..][..n_cols]);
        let right = rows.flat_map(|row| columns.iter().map(|&col| row[col as usize])).collect();
        let column_errors = columns.iter().filter_map(|&col| self.column_errors.get(col as usize).copied()).collect();
        let place = |entry: &SparseEntry| columns.iter().position(|&col| col == entry.col);
        let moved = |entry: &SparseEntry| Some(SparseEntry { col: place(entry)? as u32, ..*entry });
        let mut sparse: Vec<SparseEntry> = self.sparse.iter().filter_map(moved).collect();
        sparse.sort_by_key(|entry| (entry.row, entry.col));
        Self { n_cols: columns.len() as u32, right, column_errors, sparse, ..self.clone() }
    }

    /// Columns whose entries are all zero.
    pub fn n_zero_columns(&self) -> usize {
        let n_cols = self.n_cols as usize;
        let mut is_held = vec![false; n_cols];
        for row in self.right.chunks(n_cols.max(1)) {
            is_held.iter_mut().zip(row).for_each(|(held, x)| *held |= x.to_f32() != 0.0);
        }
        self.sparse.iter().for_each(|entry| is_held[entry.col as usize] = true);
        is_held.into_iter().filter(|held| !held).count()
    }

    /// Memory that factors and sparse entries take, in bytes.
    pub fn n_bytes(&self) -> usize {
        2 * (self.left.len() + self.doubt.len() + self.right.len())
            + 4 * (self.scale.len() + self.column_errors.len())
            + size_of_val(self.sparse.as_slice())
    }
}

/// Powers of two that columns of a row-major matrix are divided by: their largest magnitudes come into [2^ROOM, 2^(ROOM + 1)), where
/// single precision holds what they are multiplied with again, 2^unit included.
fn exponents_of_columns(unit: i32, values: &[f32], n_cols: usize) -> Vec<i32> {
    let room = |exponent: i32| exponent - ROOM.min((exponent + unit - (f32::MIN_EXP - 1)).max(0));
    let mut largest = vec![0.0f32; n_cols];
    for row in values.chunks(n_cols.max(1)) {
        largest.iter_mut().zip(row).for_each(|(largest, x)| *largest = largest.max(x.abs()));
    }
    largest.into_iter().map(|largest| room(exponent(largest))).collect()
}

/// 2^exponent: below what single precision holds 0, above the greatest power.
fn scale(exponent: i32) -> f32 {
    power_of_two(exponent.min(GREATEST_SCALE)) as f32
}

/// A row-major matrix with each column divided by a power of two.
fn scaled_columns(values: &[f32], exponents: &[i32]) -> Vec<f16> {
    let powers: Vec<f64> = exponents.iter().map(|exponent| power_of_two(-exponent)).collect();
    let mut scaled = vec![0.0; values.len()];
    let rows = values.chunks(powers.len().max(1)).zip(scaled.chunks_mut(powers.len().max(1)));
    for (row, out) in rows {
        out.iter_mut().zip(row.iter().zip(&powers)).for_each(|(out, (x, power))| *out = held(f64::from(*x) * power));
    }
    rounded(&scaled)
}

/// The exponent of a largest magnitude: dividing by its power of two brings it into [1, 2). 0 if all are zero.
fn exponent(largest: f32) -> i32 {
    if largest > 0.0 && largest.is_finite() { f64::from(largest).log2().floor() as i32 } else { 0 }
}

/// What a half holds of a number: those beyond the greatest one are that one, and what is no finite number stays none. What single
/// precision does not hold of those that are told is far below the least of them.
fn held(x: f64) -> f32 {
    let most = f64::from(f16::MAX);
    (if x.is_finite() { x.clamp(-most, most) } else { x }) as f32
}

/// Numbers of eleven bits.
fn rounded(values: &[f32]) -> Vec<f16> {
    let mut halves = vec![f16::ZERO; values.len()];
    halves.convert_from_f32_slice(values);
    halves
}

/// 2^exponent for any exponent that products of two `f32` have.
pub(crate) fn power_of_two(exponent: i32) -> f64 {
    f64::from_bits(((1023 + exponent.clamp(-1022, 1023)) as u64) << 52)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::PACKING;
    use crate::random::Random;

    #[test]
    fn what_is_told_deviates_by_its_noise_and_less_over_more_entries() {
        let error = BlockError { truncation: 0.75, sampling: 0.75, noise: 0.5 };
        assert_eq!([error.deviation(4), error.deviation(16), error.deviation(0)], [1.0, 0.5, 2.0]);
        // What is left out may seem less than nothing.
        assert_eq!(BlockError { truncation: -9.0, ..error }.deviation(4), 0.5);
        assert_eq!(BlockError { noise: 0.0, ..error }.deviation(4), 0.0);
    }

    #[test]
    fn packing_keeps_eleven_bits_at_every_magnitude() {
        let mut rng = Random::new([11, 0]);
        for magnitude in [1e-40f32, 1e-30, 1e-12, 1e-6, 1.0, 3.7e5, 1e12, 1e30] {
            let left: Vec<f32> = (0..20 * 3).map(|_| rng.normal() * magnitude).collect();
            let right: Vec<f32> = (0..3 * 15).map(|_| rng.normal()).collect();
            let factors = BlockFactors::from_f32(&left, &right, 20, 15, 3);
            assert!(factors.scale.iter().all(|s| f64::from(*s).to_bits() << 12 == 0), "{:?}", factors.scale);
            for (i, got) in factors.dense().iter().enumerate() {
                let want: f32 = (0..3).map(|r| left[i / 15 * 3 + r] * right[r * 15 + i % 15]).sum();
                assert!((got - want).abs() < 1e-2 * magnitude, "{magnitude}: {got} {want}");
                assert_eq!(*got, factors.entry(i / 15, i % 15));
            }
        }
    }

    #[test]
    fn numbers_near_the_ends_of_single_precision_are_kept() {
        for x in [1e-45f32, 1e-40, 1e-38, 1e38, 3e38, 3.4e38] {
            let factors = BlockFactors::from_f32(&[x, 0.0], &[1.0], 2, 1, 1);
            for factors in [factors.with_left(&[x, 0.0]), factors] {
                let [got, zero] = [factors.entry(0, 0), factors.entry(1, 0)];
                let rounding = f64::from(x) / 2048.0;
                assert!((f64::from(got) - f64::from(x)).abs() <= rounding && zero == 0.0, "{x:e}: {factors:?}");
            }
        }
        // What no number of single precision is, is zero or large, and nothing else.
        assert_eq!(BlockFactors::from_f32(&[1e-40], &[1e-40], 1, 1, 1).entry(0, 0), 0.0);
        let beyond = BlockFactors::from_f32(&[f32::MAX, 0.0], &[f32::MAX], 2, 1, 1);
        assert!(beyond.entry(0, 0) > 1e38 && beyond.entry(1, 0) == 0.0, "{beyond:?}");
    }

    /// Orthonormal rows, row-major.
    fn orthonormal(rng: &mut Random, rank: usize, n_cols: usize) -> Vec<f32> {
        let mut rows: Vec<Vec<f64>> = Vec::new();
        for _ in 0..rank {
            let mut row: Vec<f64> = (0..n_cols).map(|_| f64::from(rng.normal())).collect();
            for _ in 0..2 {
                for other in &rows {
                    let along: f64 = row.iter().zip(other).map(|(a, b)| a * b).sum();
                    row.iter_mut().zip(other).for_each(|(a, b)| *a -= along * b);
                }
            }
            let norm = row.iter().map(|x| x * x).sum::<f64>().sqrt();
            rows.push(row.into_iter().map(|x| x / norm).collect());
        }
        rows.into_iter().flatten().map(|x| x as f32).collect()
    }

    #[test]
    fn halves_add_an_error_far_below_any_tolerance_at_every_scale_and_rank() {
        let mut rng = Random::new([13, 0]);
        let (n_rows, n_cols) = (48, 80);
        for magnitude in [1e-20f32, 1e-12, 1.0, 1e12, 1e20, 1e30, 1e-30, 1e-36] {
            for rank in [0, 1, 2, 7, 16, 33, 64] {
                // Components fall off, and rows over eight orders of magnitude.
                let fall = |i: usize| 0.8f32.powi((i % rank) as i32) * 10f32.powf(-8.0 * (i / rank % 7) as f32 / 7.0);
                let left: Vec<f32> = (0..n_rows * rank).map(|i| magnitude * fall(i) * rng.normal()).collect();
                let right = orthonormal(&mut rng, rank, n_cols);
                let factors = BlockFactors::from_f32(&left, &right, n_rows, n_cols, rank);
                let (mut kept, mut added) = (0f64, 0f64);
                for (i, got) in factors.dense().iter().enumerate() {
                    assert!(got.is_finite(), "{magnitude}, rank {rank}");
                    let term = |r| f64::from(left[i / n_cols * rank + r]) * f64::from(right[r * n_cols + i % n_cols]);
                    let want: f64 = (0..rank).map(term).sum();
                    (kept, added) = (kept + want * want, added + (f64::from(*got) - want).powi(2));
                }
                assert!(added <= 1.5e-7 * kept, "{magnitude:e}, rank {rank}: {added:e} of {kept:e}");
                // Of few numbers that is a matter of chance, which is the same at any scale: five of them will do.
                let told = PACKING * kept;
                let is_told = rank == 0 || (0.5 * told < added && added < 2.0 * told);
                assert!(is_told || !(1e-20..=1e20).contains(&magnitude), "{added:e} added, {told:e} told");
            }
        }
    }

    #[test]
    fn a_row_a_million_times_as_large_leaves_the_others_their_digits() {
        let mut rng = Random::new([14, 0]);
        let (n_rows, n_cols) = (32, 40);
        let mut left: Vec<f32> = (0..n_rows).map(|_| 1.0 + rng.unit() as f32).collect();
        left[0] *= 1e6;
        let factors = BlockFactors::from_f32(&left, &orthonormal(&mut rng, 1, n_cols), n_rows, n_cols, 1);
        for (x, half) in left.iter().zip(&factors.left) {
            let got = half.to_f32() / factors.left[0].to_f32() * left[0];
            assert!((got / x - 1.0).abs() < 1e-3, "{got} for {x}");
        }
        // Noise in the same scale may be greater than the largest row, and than any half.
        for times in [50.0f32, 1e4] {
            let doubt: Vec<f32> = left.iter().map(|x| times * x).collect();
            let packed = factors.clone().with_doubt(0, &doubt, &left).doubt;
            assert!(packed.iter().all(|x| x.is_finite()), "{times}");
        }
        // What is no number is not made one: an encoder refuses it.
        assert!(rounded(&[held(f64::INFINITY)])[0].is_infinite());
    }

    #[test]
    fn columns_that_are_taken_out_keep_their_entries() {
        let mut rng = Random::new([12, 0]);
        let mut values = |n: usize| (0..n).map(|_| rng.normal()).collect::<Vec<f32>>();
        let mut factors = BlockFactors::from_f32(&values(4 * 2), &values(2 * 5), 4, 5, 2);
        let entry = |row, col| SparseEntry { row, col, value: 7.0 };
        factors.sparse = vec![entry(1, 0), entry(1, 4), entry(2, 3)];
        factors.column_errors = vec![0.0, 1.0, 2.0, 3.0, 4.0];
        let some = factors.with_columns(&[4, 0, 2]);
        assert_eq!((some.n_cols, some.sparse.len(), some.n_zero_columns()), (3, 2, 0));
        assert_eq!(some.column_errors, [4.0, 0.0, 2.0]);
        for row in 0..4 {
            for (at, col) in [4, 0, 2].into_iter().enumerate() {
                assert_eq!(some.entry(row, at), factors.entry(row, col), "{row}, {col}");
            }
        }
    }

    #[test]
    fn sparse_entries_are_added_to_their_row_alone() {
        let mut factors = BlockFactors::from_f32(&[1.0, 2.0, 3.0], &[1.0, 0.5], 3, 2, 1);
        factors.sparse = vec![SparseEntry { row: 1, col: 0, value: 10.0 }, SparseEntry { row: 1, col: 1, value: 20.0 }];
        assert_eq!(factors.dense(), [1.0, 0.5, 12.0, 21.0, 3.0, 1.5]);
        assert_eq!([factors.entry(0, 1), factors.entry(1, 1)], [0.5, 21.0]);
        let half = BlockFactors::from_f32(&[1.0, 2.0], &[0.0, 3.0, 0.0], 2, 3, 1);
        let entry = SparseEntry { row: 1, col: 2, value: 1.0 };
        assert_eq!((half.n_zero_columns(), BlockFactors { sparse: vec![entry], ..half }.n_zero_columns()), (2, 1));
        assert_eq!(factors.n_bytes(), 2 * 5 + 4 + 24);
    }
}
