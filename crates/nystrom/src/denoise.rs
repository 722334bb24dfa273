//! Noise taken out of whole matrices: bundles that lie near each other and are alike tell each other what they are.
//!
//! Truncation removes noise that the columns do not have in common, a block at a time; what lies in the leading components
//! stays, and in the product that is asked for most that is all of it. Here each left factor is held against means over
//! bundles around it, across the borders of blocks, each weighed by how alike somebody expects it to be
//! \[Eisemann2004, Petschnigg2004\]. The coefficients of a neighbor are brought into the basis of the block by the product of
//! both right factors, so that no entry of the matrix is ever made.
//!
//! How far each component is smoothed is decided by what the halves A and B tell. Let m be the mean of both and d half of their
//! difference, noise like that of m; then for any linear smoother F that knows nothing of the noise
//!
//! ```text
//! E ‖F m − signal‖² = E [ ‖F m − m‖² + 2 ⟨F d, d⟩ − ‖d‖² ]
//! ```
//! \[Stein1981\], whatever noise the rows have in common. Of the mixtures of m itself and three means, of small, middle and large reach,
//! the one with the least of that is taken, for each component of each block: three numbers that 768 rows decide. One that
//! smoothing would harm, a sharp edge say, stays as it was sampled.
//!
//! **Decision.** Weights of neighbors never depend on samples: means over great and small ones alike keep the sum that is there.
//! **Refused:** weights that fall where a sample stands out; they make less of what is rare and great.

mod around;
#[cfg(test)]
mod tests;

use std::{array, ops::Range, sync::Arc};

use half::{f16, slice::HalfFloatSliceExt};
use rayon::prelude::*;

use around::{Alike, CACHE_LINE, Line, Means, Planes};

use crate::{
    dense::Dense,
    factors::{BlockError, BlockFactors},
    low_rank::BlockLowRank,
    partition::Partition,
    product::product,
};

/// Which bundles are expected to be alike.
pub trait Likeness: Sync {
    /// How alike the rows of a bundle and of each of some others, from the first on one after the other, are expected to be, from 0 to 1;
    /// nothing that samples decide.
    fn likeness(&self, bundle: u32, first: u32, out: &mut [f32]);
    /// What each row of a bundle is divided by before it is held against others, above 0: rows may be alike but for a factor.
    fn gains(&self, bundle: u32) -> &[f32];
    /// Whether a bundle is known to be of nothing at all. Where its samples are zero, too, it tells others nothing and stays zero.
    fn is_void(&self, _bundle: u32) -> bool {
        false
    }
}

/// Bundles around one, to each side, that small, middle and large means are made of.
const REACHES: [u32; 3] = [2, 4, 8];
/// What is mixed: the coefficients as they are, and the means.
const N_MIXED: usize = 1 + REACHES.len();

/// Likeness that counts as none: a bundle is not held against so different ones.
const LEAST_LIKENESS: f32 = 1e-3;
/// Rounds in which weights of a mixture are exchanged at most.
const ROUNDS: usize = 64;

/// Takes noise out of blocks of groups of columns over the same rows.
#[derive(Clone, Debug)]
pub struct Denoiser<'a, L> {
    /// How rows form blocks.
    pub partition: &'a Partition,
    /// Rows of a bundle.
    pub bundle_len: usize,
    /// For each group one weight per column, as in [`ColumnGroup`](crate::ColumnGroup): their product is smoothed for itself.
    pub preserved: Vec<&'a [f32]>,
    /// Which bundles are alike.
    pub likeness: &'a L,
}

impl<L: Likeness> Denoiser<'_, L> {
    /// The factors of a block in each group, with less noise; their sampling error is what the halves tell of what is left. A block
    /// whose noise is not known stays as it is. `known` hands out the block of a group as it was sampled, this one or one
    /// [around it](Partition::around), if it is there.
    pub fn block(
        &self,
        block_idx: usize,
        known: impl Fn(usize, usize) -> Option<Arc<BlockFactors>>,
    ) -> Vec<Option<Arc<BlockFactors>>> {
        let own: Vec<_> = (0..self.preserved.len()).map(|group| known(group, block_idx)).collect();
        let directions: Vec<Vec<f32>> = self.preserved.iter().map(|preserved| direction(preserved)).collect();
        let noisy = own.iter().flatten().any(|block| is_noisy(block));
        let alike = noisy.then(|| Alike::new(self.partition, block_idx, self.likeness));
        let of_group = |(group, block): (usize, Option<Arc<BlockFactors>>)| {
            let block = block?;
            let smoothed = match &alike {
                Some(alike) if is_noisy(&block) => {
                    let guide = (alike, self.likeness);
                    let mut around = Surroundings::new(&block, &directions[group], guide, self.bundle_len);
                    for other_idx in self.partition.around(block_idx) {
                        if let Some(other) = known(group, other_idx) {
                            around.bring((self.partition, other_idx), &other, &directions[group]);
                        }
                    }
                    let mut own = Vec::new();
                    self.partition.bundles(block_idx, &mut own);
                    around.smoothed(&block, &own)
                }
                _ => None,
            };
            Some(Arc::new(smoothed.unwrap_or_else(|| BlockFactors { doubt: Vec::new(), ..(*block).clone() })))
        };
        own.into_iter().enumerate().map(of_group).collect()
    }

    /// All blocks of all groups. `None` if `goes_on` said no. The same factors give the same result on any number of threads.
    pub fn all(&self, groups: &[BlockLowRank], goes_on: &(dyn Fn() -> bool + Sync)) -> Option<Vec<BlockLowRank>> {
        assert_eq!(groups.len(), self.preserved.len(), "one set of weights per group");
        let known = |group: usize, block_idx: usize| groups[group].blocks[block_idx].clone();
        let of_block = |block_idx: usize| goes_on().then(|| self.block(block_idx, known));
        let blocks: Option<Vec<_>> = (0..self.partition.n_blocks()).into_par_iter().map(of_block).collect();
        let blocks = blocks?;
        let group = |(nth, group): (usize, &BlockLowRank)| BlockLowRank {
            partition: group.partition.clone(),
            blocks: blocks.iter().map(|block| block[nth].clone()).collect(),
            ..*group
        };
        Some(groups.iter().enumerate().map(group).collect())
    }
}

/// A vector of length 1, or of zeros where there is none: weights may be of any size.
fn direction(weights: &[f32]) -> Vec<f32> {
    let norm = weights.iter().map(|&x| f64::from(x).powi(2)).sum::<f64>().sqrt();
    let scale = if norm > 0.0 && norm.is_finite() { 1.0 / norm } else { 0.0 };
    weights.iter().map(|&x| (f64::from(x) * scale) as f32).collect()
}

/// Whether something is known of a block's noise, and there is some.
fn is_noisy(block: &BlockFactors) -> bool {
    block.rank > 0 && block.doubt.iter().any(|x| x.to_f32() != 0.0)
}

/// A block's right factor with rows of length 1, and what they were divided by.
struct Basis {
    rows: Dense<f32>,
    lengths: Vec<f32>,
    /// The preserved product of each row.
    along: Vec<f32>,
}

impl Basis {
    fn of(block: &BlockFactors, preserved: &[f32]) -> Self {
        let (n_rows, n_cols) = (block.rank as usize, block.n_cols as usize);
        let mut rows = Dense { n_rows, n_cols, data: block.right.iter().map(|x| x.to_f32()).collect::<Vec<f32>>() };
        let (mut lengths, mut along) = (Vec::with_capacity(n_rows), Vec::with_capacity(n_rows));
        for row in 0..n_rows {
            let row = rows.row_mut(row);
            let length = row.iter().map(|x| x * x).sum::<f32>().sqrt().max(f32::MIN_POSITIVE);
            row.iter_mut().for_each(|x| *x /= length);
            along.push(row.iter().zip(preserved).map(|(x, weight)| x * weight).sum());
            lengths.push(length);
        }
        Basis { rows, lengths, along }
    }

    /// A left factor (or its noise) for these rows, of the bundles of some lines one after the other.
    fn coefficients(&self, block: &BlockFactors, left: &[f16], lines: &[Line], bundle_len: usize) -> Dense<f32> {
        let n_cols = self.rows.n_rows;
        let scales: Vec<f32> = block.scale.iter().zip(&self.lengths).map(|(scale, length)| scale * length).collect();
        let n_rows = lines.iter().map(|line| line.nth.len() * bundle_len).sum();
        let mut data = vec![0.0; n_rows * n_cols];
        let mut rest = data.as_mut_slice();
        // What is zero has neither rank nor noise.
        for line in lines.iter().filter(|_| n_cols > 0) {
            let (first, len) = (line.nth.start * bundle_len * n_cols, line.nth.len() * bundle_len * n_cols);
            let (out, after) = rest.split_at_mut(len);
            left[first..][..len].convert_to_f32_slice(out);
            out.chunks_exact_mut(n_cols).for_each(|row| row.iter_mut().zip(&scales).for_each(|(x, scale)| *x *= scale));
            rest = after;
        }
        Dense { n_rows, n_cols, data }
    }
}

/// All that is within reach of a block, in the block's own basis and divided by gains.
struct Surroundings<'a, L> {
    alike: &'a Alike,
    basis: Basis,
    bundle_len: usize,
    likeness: &'a L,
    /// Of each bundle its rows × (mean, noise) × (components, preserved product).
    planes: Planes,
}

impl<'a, L: Likeness> Surroundings<'a, L> {
    /// Nothing is known yet.
    fn new(own: &BlockFactors, preserved: &[f32], (alike, likeness): (&'a Alike, &'a L), bundle_len: usize) -> Self {
        let planes = Planes::new(&alike.window, bundle_len * 2 * (own.rank as usize + 1));
        Surroundings { alike, basis: Basis::of(own, preserved), bundle_len, likeness, planes }
    }

    fn rank(&self) -> usize {
        self.basis.rows.n_rows
    }

    /// Brings what is within reach of a block around, or of the block itself, into the basis.
    fn bring(&mut self, (partition, block_idx): (&Partition, usize), other: &BlockFactors, preserved: &[f32]) {
        // What is zero is known, what has factors without noise is not.
        if other.rank > 0 && other.doubt.len() != other.left.len() {
            return;
        }
        let theirs = Basis::of(other, preserved);
        let turn = (theirs.rows != self.basis.rows).then(|| product(theirs.rows.view(), self.basis.rows.t()));
        let lines = self.alike.window.lines(partition.rect(block_idx), partition.width);
        for (part, left) in [&other.left, &other.doubt].into_iter().enumerate() {
            let coefficients = self.without_gains(theirs.coefficients(other, left, &lines, self.bundle_len), &lines);
            let along = |row: &[f32]| row.iter().zip(&theirs.along).map(|(c, x)| c * x).sum();
            let preserved: Vec<f32> = (0..coefficients.n_rows).map(|row| along(coefficients.row(row))).collect();
            let preserved = Dense { n_rows: preserved.len(), n_cols: 1, data: preserved };
            let turned = turn.as_ref().map(|turn| product(coefficients.view(), turn.view()));
            let turned = turned.as_ref().unwrap_or(&coefficients);
            for row in 0..self.bundle_len {
                let value = (2 * row + part) * (self.rank() + 1);
                self.tell(value, &lines, (turned, row));
                self.tell(value + self.rank(), &lines, (&preserved, row));
            }
        }
        for line in &lines {
            let known = (line.bundle..).zip(line.nth.clone()).map(|(bundle, nth)| {
                let rows = nth * self.bundle_len..(nth + 1) * self.bundle_len;
                !is_nothing(self.likeness, bundle, other, rows)
            });
            self.planes.set_known(line.place, known);
        }
    }

    /// The rows of bundles, line by line, each divided by its gain.
    fn without_gains(&self, mut rows: Dense<f32>, lines: &[Line]) -> Dense<f32> {
        let bundles = lines.iter().flat_map(|line| (line.bundle..).take(line.nth.len()));
        let gains = bundles.flat_map(|bundle| self.likeness.gains(bundle));
        for (row, gain) in gains.enumerate() {
            rows.row_mut(row).iter_mut().for_each(|x| *x /= gain);
        }
        rows
    }

    /// Values of each bundle from one on, line by line: one of its rows, a cache line of it at a time.
    fn tell(&mut self, value: usize, lines: &[Line], (rows, row): (&Dense<f32>, usize)) {
        for first in (0..rows.n_cols).step_by(CACHE_LINE) {
            let columns = row * rows.n_cols + first..row * rows.n_cols + rows.n_cols.min(first + CACHE_LINE);
            let mut bundles = rows.data.chunks_exact(self.bundle_len * rows.n_cols);
            for line in lines {
                let bundles = bundles.by_ref().take(line.nth.len());
                self.planes.set(value + first, line.place, bundles.map(|bundle| &bundle[columns.clone()]));
            }
        }
    }

    /// The block's bundles as they are and as the three means have them, gains multiplied again.
    fn means(&self, own: &[u32]) -> Means {
        let (mut means, per_row) = (self.planes.means(self.alike), 2 * (self.rank() + 1));
        for row in 0..self.bundle_len {
            let gains: Vec<f32> = own.iter().map(|bundle| self.likeness.gains(*bundle)[row]).collect();
            for (mean, value) in (0..N_MIXED).flat_map(|mean| (0..per_row).map(move |value| (mean, value))) {
                let plane = means.plane_mut(mean, row * per_row + value);
                plane.iter_mut().zip(&gains).for_each(|(x, gain)| *x *= gain);
            }
        }
        means
    }

    /// The block with the mixtures that leave the least error; `None` where numbers are beyond single precision.
    fn smoothed(&self, block: &BlockFactors, own: &[u32]) -> Option<BlockFactors> {
        let means = self.means(own);
        let (rank, n_rows, len) = (self.rank(), block.n_rows as usize, self.bundle_len);
        let value = |row: usize, component: usize| row * 2 * (rank + 1) + component;
        let (mut left, mut preserved, mut mixed) = (vec![0.0; n_rows * rank], vec![0.0; n_rows], Vec::new());
        let mut mixture = |component: usize| {
            let of_row = |row: usize| [value(row, component), value(row, component) + rank + 1];
            let mixture = Mixture::of(&means, (0..len).map(of_row));
            for row in 0..len {
                means.mix(value(row, component), mixture.weights, &mut mixed);
                let rows = (row..n_rows).step_by(len);
                if component < rank {
                    rows.zip(&mixed).for_each(|(row, x)| left[row * rank + component] = *x);
                } else {
                    rows.zip(&mixed).for_each(|(row, x)| preserved[row] = *x);
                }
            }
            mixture
        };
        let mixtures: Vec<Mixture> = (0..=rank).map(&mut mixture).collect();
        let along = &self.basis.along;
        let square: f32 = along.iter().map(|x| x * x).sum();
        let mut moved = 0.0;
        for (left, preserved) in left.chunks_exact_mut(rank).zip(&preserved) {
            let product: f32 = left.iter().zip(along).map(|(x, along)| x * along).sum();
            let lacks = if square > 0.0 { (preserved - product) / square } else { 0.0 };
            let parts = left.iter_mut().zip(along).zip(&self.basis.lengths);
            parts.for_each(|((x, along), length)| *x = (*x + lacks * along) / length);
            moved += f64::from(lacks) * f64::from(lacks) * f64::from(square);
        }
        for (nth, bundle) in own.iter().enumerate() {
            let rows = nth * self.bundle_len..(nth + 1) * self.bundle_len;
            if is_nothing(self.likeness, *bundle, block, rows.clone()) {
                left[rows.start * rank..rows.end * rank].fill(0.0);
            }
        }
        let sum = |of: fn(&Mixture) -> f64| mixtures[..rank].iter().map(of).sum::<f64>();
        let n_entries = f64::from(block.n_rows) * f64::from(block.n_cols);
        let less = (sum(|mixture| mixture.before) - sum(Mixture::error) - moved) / n_entries;
        let least = sum(|mixture| mixture.noise) / n_entries;
        let sampling = (f64::from(block.error.sampling) - less).max(least) as f32;
        left.iter().all(|x| x.is_finite()).then(|| {
            let error = BlockError { sampling, ..block.error };
            let column_errors = self.column_errors(block, &mixtures[..rank], moved / n_entries);
            BlockFactors { error, column_errors, ..block.with_left(&left) }
        })
    }
}

impl<L> Surroundings<'_, L> {
    /// What is left of the error of each column, each component counting as much as the column has of it; the product that is put
    /// back moves all alike by some mean square.
    fn column_errors(&self, block: &BlockFactors, mixtures: &[Mixture], moved: f64) -> Vec<f32> {
        let sum = |col: usize, of: fn(&Mixture) -> f64| {
            let parts = mixtures.iter().enumerate();
            let squares = parts.map(|(r, mixture)| of(mixture) * f64::from(self.basis.rows.row(r)[col]).powi(2));
            squares.sum::<f64>() / f64::from(block.n_rows)
        };
        let left = |(col, before): (usize, &f32)| {
            let less = sum(col, |mixture| mixture.before - mixture.error()) - moved;
            (f64::from(*before) - less).max(sum(col, |mixture| mixture.noise)) as f32
        };
        block.column_errors.iter().enumerate().map(left).collect()
    }
}

/// Whether a bundle is void, and its rows of a block are zero.
fn is_nothing(likeness: &impl Likeness, bundle: u32, block: &BlockFactors, mut rows: Range<usize>) -> bool {
    likeness.is_void(bundle) && rows.all(|row| block.is_zero_row(row))
}

/// How much of the coefficients as they are and of each mean makes a component, and what that leaves.
struct Mixture {
    weights: [f64; N_MIXED],
    /// Squares, over all rows: of the noise before.
    before: f64,
    /// Of the noise that stays.
    noise: f64,
    /// Of the whole error, as far as the halves tell; it may fall below 0.
    risk: f64,
    /// By how much the best of all mixtures seems better than it is: three weights, each as lucky as one of so many numbers as share
    /// the noise. \[Efron2004\]
    luck: f64,
}

impl Mixture {
    /// The best one for a component, of which each row of a bundle has a value and its noise.
    fn of(means: &Means, rows: impl Iterator<Item = [usize; 2]>) -> Self {
        let (mut gram, mut noise_gram, mut fourth) = ([[0.0; N_MIXED]; N_MIXED], [[0.0; N_MIXED]; N_MIXED], 0.0);
        for [value, noise] in rows {
            means.add_products(value, &mut gram);
            means.add_products(noise, &mut noise_gram);
            fourth += means.plane(0, noise).iter().map(|&x| f64::from(x).powi(4)).sum::<f64>();
        }
        // With w the weights: wᵀ·gram·w − 2 w·aim is the error, but for a constant.
        let aim: [f64; N_MIXED] = array::from_fn(|i| gram[i][0] - noise_gram[i][0]);
        let weights = least(&gram, &aim);
        let form = |matrix: &[[f64; N_MIXED]; N_MIXED]| -> f64 {
            let pairs = (0..N_MIXED).flat_map(|i| (0..N_MIXED).map(move |j| (i, j)));
            pairs.map(|(i, j)| weights[i] * matrix[i][j] * weights[j]).sum()
        };
        let linear: f64 = weights.iter().zip(&aim).map(|(weight, aim)| weight * aim).sum();
        let risk = form(&gram) - 2.0 * linear + gram[0][0] - noise_gram[0][0];
        let before = noise_gram[0][0];
        let luck = if before > 0.0 { 2.0 * (1.0 - weights[0]) * fourth / before } else { 0.0 };
        Mixture { weights, before, noise: form(&noise_gram), risk, luck }
    }

    /// Squared error over all rows: noise, what smoothing takes of the signal as far as it shows, and luck; none is told that is greater
    /// than without smoothing.
    fn error(&self) -> f64 {
        (self.risk.max(self.noise) + self.luck).min(self.before.max(self.risk))
    }
}

/// The weights, none below 0 and 1 in all, that minimize `wᵀ·gram·w − 2 w·aim`, from all on the first: pairs exchange as much as is best
/// until nothing changes.
fn least(gram: &[[f64; N_MIXED]; N_MIXED], aim: &[f64; N_MIXED]) -> [f64; N_MIXED] {
    let mut weights = [0.0; N_MIXED];
    weights[0] = 1.0;
    for _ in 0..ROUNDS {
        let mut most: f64 = 0.0;
        for (i, j) in (0..N_MIXED).flat_map(|i| (i + 1..N_MIXED).map(move |j| (i, j))) {
            let slope = |k: usize| aim[k] - (0..N_MIXED).map(|l| gram[k][l] * weights[l]).sum::<f64>();
            let curvature = gram[i][i] + gram[j][j] - 2.0 * gram[i][j];
            if curvature > 0.0 {
                let step = ((slope(j) - slope(i)) / curvature).clamp(-weights[j], weights[i]);
                weights[i] -= step;
                weights[j] += step;
                most = most.max(step.abs());
            }
        }
        if most < 1e-6 {
            break;
        }
    }
    weights
}
