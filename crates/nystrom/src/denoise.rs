//! Noise taken out of whole matrices: bundles that lie near each other and are alike tell each other what they are.
//!
//! Truncation removes noise that the columns do not have in common, a block at a time; what lies in the leading components
//! stays, and under the light that is asked for most that is all of it. Here each left factor is held against means over
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
//! smoothing would harm, a sharp shadow say, stays as it was sampled.
//!
//! **Decision.** Weights of neighbors never depend on samples: means over bright and dark ones alike keep the light that is there.
//! **Refused:** weights that fall where a sample stands out; they make rare bright light darker than it is.

#[cfg(test)]
mod tests;

use std::{array, sync::Arc};

use half::f16;
use rayon::prelude::*;

use crate::{
    dense::Dense,
    factors::{BlockError, BlockFactors},
    low_rank::BlockLowRank,
    partition::Partition,
    product::product,
};

/// Which bundles are expected to be alike.
pub trait Likeness: Sync {
    /// How alike the rows of two bundles are expected to be, from 0 to 1; nothing that samples decide.
    fn likeness(&self, bundle: u32, other: u32) -> f32;
    /// What each row of a bundle is divided by before it is held against others, above 0: rows may be alike but for a factor.
    fn gains(&self, bundle: u32) -> &[f32];
}

/// Bundles around one, to each side, that small, middle and large means are made of.
const REACHES: [u32; 3] = [2, 4, 8];
/// Places across and down that the largest mean is made of.
const SPAN: usize = 2 * REACHES[2] as usize + 1;
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
                    let mut around = Surroundings::new(&block, &directions[group], alike, self.bundle_len);
                    for other_idx in self.partition.around(block_idx) {
                        if let Some(other) = known(group, other_idx) {
                            let place = (self.partition.rect(other_idx), other_idx == block_idx);
                            around.bring(place, &other, &directions[group]);
                        }
                    }
                    around.smoothed(&block)
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

/// The bundles of a tile, and those around it that they are held against.
struct Alike {
    /// First column, first row, width and height of the tile.
    tile: [u32; 4],
    /// The same of all that is within reach.
    window: [u32; 4],
    /// Bundles of the tile × places across and down around each; 0 beyond the grid.
    weights: Vec<f32>,
    /// What rows are divided by, bundles of the window × bundle length.
    gains: Vec<f32>,
}

impl Alike {
    fn new(partition: &Partition, block_idx: usize, likeness: &impl Likeness) -> Self {
        let tile = partition.rect(block_idx);
        let [x0, y0, width, height] = tile;
        let reach = REACHES[2];
        let (left, top) = (x0.saturating_sub(reach), y0.saturating_sub(reach));
        let (right, bottom) = ((x0 + width + reach).min(partition.width), (y0 + height + reach).min(partition.height));
        let window = [left, top, right - left, bottom - top];
        let mut weights = Vec::with_capacity((width * height) as usize * SPAN * SPAN);
        for (y, x) in (y0..y0 + height).flat_map(|y| (x0..x0 + width).map(move |x| (y, x))) {
            let bundle = y * partition.width + x;
            for (down, across) in (0..SPAN as u32).flat_map(|down| (0..SPAN as u32).map(move |across| (down, across))) {
                let (other_x, other_y) = ((x + across).wrapping_sub(reach), (y + down).wrapping_sub(reach));
                let is_there = other_x < partition.width && other_y < partition.height;
                let other = || other_y * partition.width + other_x;
                let weight = if is_there { likeness.likeness(bundle, other()) } else { 0.0 };
                weights.push(if weight > LEAST_LIKENESS { weight } else { 0.0 });
            }
        }
        let bundles = (top..bottom).flat_map(|y| (left..right).map(move |x| y * partition.width + x));
        let gains = bundles.flat_map(|bundle| likeness.gains(bundle).iter().copied()).collect();
        Alike { tile, window, weights, gains }
    }

    /// Place in the window of a place in the tile, moved across and down from the first that is within reach of it; it may lie
    /// beyond the grid.
    fn in_window(&self, [x, y]: [usize; 2], [across, down]: [usize; 2]) -> usize {
        let ([x0, y0, ..], [left, top, width, _]) = (self.tile, self.window);
        let reach = REACHES[2] as usize;
        let (column, row) = ((x0 - left) as usize + x + across, (y0 - top) as usize + y + down);
        (row.wrapping_sub(reach)).wrapping_mul(width as usize).wrapping_add(column.wrapping_sub(reach))
    }
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

    /// A left factor (or its noise) for these rows.
    fn coefficients(&self, block: &BlockFactors, left: &[f16]) -> Dense<f32> {
        let n_cols = self.rows.n_rows;
        let value = |(i, x): (usize, &f16)| x.to_f32() * block.scale[i % n_cols] * self.lengths[i % n_cols];
        Dense { n_rows: block.n_rows as usize, n_cols, data: left.iter().enumerate().map(value).collect() }
    }
}

/// All that is within reach of a block, in the block's own basis and divided by gains.
struct Surroundings<'a> {
    alike: &'a Alike,
    basis: Basis,
    bundle_len: usize,
    /// Window bundles × rows of a bundle × (mean, noise) × (components, preserved product).
    values: Vec<f32>,
    /// Which window bundles are known.
    known: Vec<bool>,
}

impl<'a> Surroundings<'a> {
    /// Nothing is known yet.
    fn new(own: &BlockFactors, preserved: &[f32], alike: &'a Alike, bundle_len: usize) -> Self {
        let n_window = (alike.window[2] * alike.window[3]) as usize;
        let n_values = bundle_len * 2 * (own.rank as usize + 1);
        let (values, known) = (vec![0.0; n_window * n_values], vec![false; n_window]);
        Surroundings { alike, basis: Basis::of(own, preserved), bundle_len, values, known }
    }

    fn rank(&self) -> usize {
        self.basis.rows.n_rows
    }

    /// Values of a bundle of the window.
    fn n_values(&self) -> usize {
        self.bundle_len * 2 * (self.rank() + 1)
    }

    /// Brings what is within reach of a block around, or of the block itself, into the basis.
    fn bring(&mut self, (rect, is_own): ([u32; 4], bool), other: &BlockFactors, preserved: &[f32]) {
        // What is zero is known, what has factors without noise is not.
        if other.rank > 0 && other.doubt.len() != other.left.len() {
            return;
        }
        let theirs = Basis::of(other, preserved);
        let turn = product(theirs.rows.view(), self.basis.rows.t());
        let parts = [&other.left, &other.doubt].map(|left| {
            let coefficients = theirs.coefficients(other, left);
            let turned = if is_own { coefficients.clone() } else { product(coefficients.view(), turn.view()) };
            (coefficients, turned)
        });
        let ([x0, y0, width, height], [left, top, across, down]) = (rect, self.alike.window);
        let (rank, n_values) = (self.rank(), self.n_values());
        for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
            let (column, row) = ((x0 + x).wrapping_sub(left), (y0 + y).wrapping_sub(top));
            if column >= across || row >= down {
                continue;
            }
            let (place, bundle) = ((row * across + column) as usize, (y * width + x) as usize);
            self.known[place] = true;
            let gains = &self.alike.gains[place * self.bundle_len..][..self.bundle_len];
            let rows = self.values[place * n_values..][..n_values].chunks_exact_mut(2 * (rank + 1));
            for ((nth, out), gain) in rows.enumerate().zip(gains) {
                for ((coefficients, turned), out) in parts.iter().zip(out.chunks_exact_mut(rank + 1)) {
                    let row = bundle * self.bundle_len + nth;
                    let preserved: f32 = coefficients.row(row).iter().zip(&theirs.along).map(|(c, x)| c * x).sum();
                    out[..rank].copy_from_slice(turned.row(row));
                    out[rank] = preserved;
                    out.iter_mut().for_each(|value| *value /= gain);
                }
            }
        }
    }

    /// The block's bundles as they are and as the three means have them: bundles of the tile × values, gains multiplied again.
    fn means(&self) -> [Vec<f32>; N_MIXED] {
        let [_, _, width, height] = self.alike.tile.map(|side| side as usize);
        let (n_values, reach) = (self.n_values(), REACHES[2] as usize);
        let mut means: [Vec<f32>; N_MIXED] = array::from_fn(|_| Vec::with_capacity(width * height * n_values));
        let mut sums = vec![0.0; n_values];
        for (nth, (y, x)) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))).enumerate() {
            let weights = &self.alike.weights[nth * SPAN * SPAN..][..SPAN * SPAN];
            let own = self.alike.in_window([x, y], [reach; 2]);
            let gains = &self.alike.gains[own * self.bundle_len..][..self.bundle_len];
            let (mut total, mut within) = (0.0, 0..0);
            sums.fill(0.0);
            for (mean, of_reach) in means.iter_mut().zip([0].iter().chain(&REACHES)) {
                let inner = within;
                within = reach - *of_reach as usize..reach + *of_reach as usize + 1;
                for (down, across) in within.clone().flat_map(|down| within.clone().map(move |across| (down, across))) {
                    let weight = weights[down * SPAN + across];
                    if weight == 0.0 || (inner.contains(&down) && inner.contains(&across)) {
                        continue;
                    }
                    let place = self.alike.in_window([x, y], [across, down]);
                    if self.known[place] {
                        total += weight;
                        let values = &self.values[place * n_values..][..n_values];
                        sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
                    }
                }
                let per_row = n_values / self.bundle_len;
                mean.extend(sums.iter().enumerate().map(|(i, sum)| sum / total * gains[i / per_row]));
            }
        }
        means
    }

    /// The block with the mixtures that leave the least error; `None` where numbers are beyond single precision.
    fn smoothed(&self, block: &BlockFactors) -> Option<BlockFactors> {
        let means = self.means();
        let (rank, n_rows) = (self.rank(), block.n_rows as usize);
        let mixtures: Vec<Mixture> = (0..=rank).map(|component| Mixture::of(&means, component, rank)).collect();
        let mixed = |row: usize, component: usize| {
            let at = row * 2 * (rank + 1) + component;
            let parts = means.iter().zip(&mixtures[component].weights);
            parts.map(|(mean, weight)| mean[at] * *weight as f32).sum::<f32>()
        };
        let along = &self.basis.along;
        let square: f32 = along.iter().map(|x| x * x).sum();
        let (mut left, mut moved) = (Vec::with_capacity(n_rows * rank), 0.0);
        for row in 0..n_rows {
            let first = left.len();
            left.extend((0..rank).map(|component| mixed(row, component)));
            let product: f32 = left[first..].iter().zip(along).map(|(x, along)| x * along).sum();
            let lacks = if square > 0.0 { (mixed(row, rank) - product) / square } else { 0.0 };
            left[first..].iter_mut().zip(along).for_each(|(x, along)| *x += lacks * along);
            moved += f64::from(lacks) * f64::from(lacks) * f64::from(square);
        }
        left.iter_mut().enumerate().for_each(|(i, x)| *x /= self.basis.lengths[i % rank]);
        let sum = |of: fn(&Mixture) -> f64| mixtures[..rank].iter().map(of).sum::<f64>();
        let n_entries = f64::from(block.n_rows) * f64::from(block.n_cols);
        let less = (sum(|mixture| mixture.before) - sum(Mixture::error) - moved) / n_entries;
        let least = sum(|mixture| mixture.noise) / n_entries;
        let sampling = (f64::from(block.error.sampling) - less).max(least) as f32;
        left.iter().all(|x| x.is_finite()).then(|| {
            let error = BlockError { sampling, ..block.error };
            BlockFactors { error, ..block.with_left(&left) }
        })
    }
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
    /// The best one for a component.
    fn of(means: &[Vec<f32>; N_MIXED], component: usize, rank: usize) -> Self {
        let (mut gram, mut noise_gram) = ([[0.0; N_MIXED]; N_MIXED], [[0.0; N_MIXED]; N_MIXED]);
        let (per_row, noise_at, mut fourth) = (2 * (rank + 1), rank + 1 + component, 0.0);
        for first in (0..means[0].len()).step_by(per_row) {
            let value = |at: usize| -> [f64; N_MIXED] { array::from_fn(|i| f64::from(means[i][first + at])) };
            let (values, noises) = (value(component), value(noise_at));
            fourth += noises[0].powi(4);
            for i in 0..N_MIXED {
                for j in 0..N_MIXED {
                    gram[i][j] += values[i] * values[j];
                    noise_gram[i][j] += noises[i] * noises[j];
                }
            }
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
