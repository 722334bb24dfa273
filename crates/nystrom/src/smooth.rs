//! Noise taken out of blocks that are noisier than asked, where rows and columns that lie beside each other are alike.
//!
//! Truncation alone cannot do this: its components hold the noise of all rows and columns. A cosine transform along the grids
//! of both \[Ahmed1974\] brings together what is smooth, and leaves noise everywhere. Coefficients of like frequencies form
//! a band; in each, the halves A and B tell the noise of their mean, `¼ Σ (A − B)²`, and the band is multiplied with the share
//! of its energy that is none \[Wiener1949\]. Both halves get the same weights, which leaves them independent but for as many
//! numbers as there are bands. What a sharp edge needs keeps its weight, because both halves agree about it.
//!
//! **Decision.** One linear map of the whole block before anything is decomposed. **Refused:** weights for the components of
//! a decomposition; noise has turned the weaker ones by then, so that even the best weights are worse
//! (`docs/decisions/0055-components-are-kept-or-dropped.md`).

#[cfg(test)]
mod tests;

use crate::{
    compress::{BlockSamples, ColumnGroup, CompressError},
    cosine::{Cosines, Direction},
    dense::Dense,
    fit::Fit,
    level::Level,
    means::Means,
    measure::held_out,
    packed::ColumnRun,
    partition::Partition,
    project::{Asked, fitted, measured, multiplied},
    random::Random,
    unpacked::Unpacked,
};

/// Sums of horizontal and vertical frequency at which the next band begins; from the last on it is all one band.
const BAND_EDGES: [usize; 12] = [1, 2, 3, 4, 6, 9, 14, 22, 34, 54, 86, 136];
const N_BANDS: usize = BAND_EDGES.len() + 1;
/// How many standard deviations of a band's noise, about, count as noise too.
const CAUTION: f64 = 1.0;
const OTHER: &str = "the smoothing was made for another partition, other bundles or other groups of columns";

/// How rows and columns of a matrix lie beside each other.
#[derive(Clone, Debug, PartialEq)]
pub struct Smoothing {
    partition: Partition,
    bundle_len: usize,
    /// Of each group of columns.
    groups: Vec<Vec<ColumnRun>>,
    cosines: Cosines,
}

impl Smoothing {
    /// Bundles of some rows lie as the partition has them, and the columns of each group of a
    /// [`CompressConfig`](crate::CompressConfig) in runs, from its first to its last.
    pub fn new(partition: Partition, bundle_len: usize, groups: Vec<Vec<ColumnRun>>) -> Self {
        let Partition { width, height, tile } = partition;
        let of_rows = [width, height].into_iter().flat_map(|side| [side.min(tile), side % tile]);
        let of_columns = groups.iter().flatten().flat_map(|run| match run {
            ColumnRun::List(_) => [1, 1],
            ColumnRun::Grid { width, height } => [*width, *height],
        });
        let cosines = Cosines::new(of_rows.chain(of_columns).chain([bundle_len as u32]));
        Self { partition, bundle_len, groups, cosines }
    }

    /// # Errors
    /// Groups or a partition that this was not made for.
    pub(crate) fn check(
        &self,
        partition: &Partition,
        bundle_len: usize,
        groups: &[ColumnGroup],
    ) -> Result<(), CompressError> {
        let fits = self.partition == *partition && self.bundle_len == bundle_len && self.fits(groups);
        if fits { Ok(()) } else { Err(CompressError::Config(OTHER.into())) }
    }

    /// # Errors
    /// Groups or a block that this was not made for.
    pub(crate) fn check_block(
        &self,
        samples: &BlockSamples<'_>,
        block_idx: u32,
        groups: &[ColumnGroup],
    ) -> Result<(), CompressError> {
        let is_block = (block_idx as usize) < self.partition.n_blocks();
        let n_bundles = |[_, _, width, height]: [u32; 4]| width as usize * height as usize;
        let n_rows = || n_bundles(self.partition.rect(block_idx as usize)) * self.bundle_len;
        let fits = samples.bundle_len == self.bundle_len && self.fits(groups);
        let fits = fits && is_block && n_rows() * samples.n_cols == samples.halves[0].len();
        if fits { Ok(()) } else { Err(CompressError::Config(OTHER.into())) }
    }

    fn fits(&self, groups: &[ColumnGroup]) -> bool {
        let n_cols = |runs: &Vec<ColumnRun>| runs.iter().map(|run| run.n_cols() as usize).sum::<usize>();
        self.groups.iter().map(n_cols).eq(groups.iter().map(|group| group.columns.len()))
    }

    /// How a group of columns of a block is smoothed.
    pub(crate) fn of_block(&self, block_idx: u32, group: usize) -> Smoother<'_> {
        let [_, _, width, height] = self.partition.rect(block_idx as usize);
        Smoother { smoothing: self, tile: [width, height], runs: &self.groups[group] }
    }
}

/// The grids of one group of columns of one block.
#[derive(Clone, Copy)]
pub(crate) struct Smoother<'a> {
    smoothing: &'a Smoothing,
    /// Bundles across and down.
    tile: [u32; 2],
    runs: &'a [ColumnRun],
}

/// Noise of the mean, energy of the mean, number of coefficients.
type Band = [f64; 3];

impl Smoother<'_> {
    /// The factors of a smoothed block, if its held-out error in divided columns beats another one: fits to one smoothed half
    /// examined by the other half as it was sampled. That is unbiased, and in one block mostly noise where much was smoothed away.
    /// So what the factors *tell* is what their rank leaves of the smoothed halves, and what weights are expected to lose of a
    /// signal, `w (1 − w)` of the noise of their band.
    pub(crate) fn factor(
        self,
        (means, level): (&Means, &Level),
        to_beat: f64,
        Asked { group, tolerance, config, .. }: Asked<'_>,
        rng: Random,
    ) -> Option<Unpacked> {
        let [a, b] = [&level.means.a, &level.means.b].map(|half| self.forward(half));
        let (mut smooth, lost) = self.smoothed(&a, &b, means.unit);
        let mut fits: [Fit; 3] = fitted(&smooth, self.smoothing.bundle_len, tolerance, config, rng);
        let rank = measured(&smooth, [&fits[0], &fits[1]], tolerance, config).rank;
        fits.iter_mut().for_each(|fit| _ = fit.keep(rank));
        let [of_a, of_b, _] = &fits;
        let held_out_error = held_out([&a, &b], &[of_a.of(&of_a.a), of_b.of(&of_b.b)]).iter().sum::<f64>();
        let is_nearer = held_out_error / means.n_entries() < to_beat;
        if !is_nearer {
            return None;
        }
        // As many copies of a block as are needed, and no more, are what a thread takes.
        drop([a, b]);

        let fits = fits.map(|fit| self.back(fit));
        let halves = [&mut smooth.a, &mut smooth.b].map(|half| {
            self.transform(half, Direction::Inverse);
            level.multiplied(half)
        });
        let mut factors = multiplied((means, level), &fits, halves.each_ref(), (group, tolerance));
        let lost = lost * means.noise_per_entry() / level.means.noise_per_entry().max(f64::MIN_POSITIVE);
        factors.truncation = factors.truncation.max(0.0) + lost / means.n_entries();
        clear_unlit(&mut factors, means, self.smoothing.bundle_len);
        Some(factors)
    }

    /// Both halves and their mean, each band multiplied with the share of its energy that is no noise, and the energy that
    /// this is expected to lose of the signal.
    fn smoothed(self, a: &Dense<f32>, b: &Dense<f32>, unit: f64) -> (Means, f64) {
        let (of_rows, of_cols) = (self.bands_of_rows(), self.bands_of_columns());
        let n_across = of_cols.iter().max().map_or(0, |last| last + 1);
        let mut bands: Vec<Band> = vec![[0.0; 3]; self.smoothing.bundle_len * N_BANDS * n_across];
        for (band, bands) in bands.chunks_exact_mut(n_across).enumerate() {
            let rows = of_rows.iter().enumerate().filter(|(_, of_row)| **of_row == band);
            add_rows(rows.map(|(row, _)| [a.row(row), b.row(row)]), &of_cols, bands);
        }
        let weights: Vec<f32> = bands.iter().map(|&band| weight(band) as f32).collect();
        let mean = Dense::zeros(a.n_rows, a.n_cols);
        let mut smooth = Means { a: a.clone(), b: b.clone(), mean, unit, ..Means::default() };
        for (row, first) in of_rows.iter().map(|band| band * n_across).enumerate() {
            let (a, b) = (smooth.a.row_mut(row), smooth.b.row_mut(row));
            let (mut cross, mut noise) = (0.0, 0.0);
            for (((a, b), mean), col) in a.iter_mut().zip(b).zip(smooth.mean.row_mut(row)).zip(&of_cols) {
                let weight = weights[first + col];
                (*a, *b) = (*a * weight, *b * weight);
                *mean = 0.5 * (*a + *b);
                cross += f64::from(*a) * f64::from(*b);
                noise += 0.25 * f64::from(*a - *b).powi(2);
            }
            smooth.cross.push(cross);
            smooth.noise.push(noise);
        }
        let lost = bands.iter().map(|&band| weight(band) * (1.0 - weight(band)) * band[0]).sum();
        (smooth, lost)
    }

    /// Band of each row of the transformed block.
    fn bands_of_rows(self) -> Vec<usize> {
        let len = self.smoothing.bundle_len;
        let n_rows = self.tile[0] as usize * self.tile[1] as usize * len;
        let band = |row: usize| row % len * N_BANDS + band_of(row / len, self.tile[0] as usize);
        (0..n_rows).map(band).collect()
    }

    /// Band of each column of the transformed block. Columns of a list are bands by themselves.
    fn bands_of_columns(self) -> Vec<usize> {
        let (mut bands, mut first) = (Vec::new(), 0);
        for run in self.runs {
            let n_cols = run.n_cols() as usize;
            match *run {
                ColumnRun::List(_) => bands.extend(first..first + n_cols),
                ColumnRun::Grid { width, .. } => bands.extend((0..n_cols).map(|i| first + band_of(i, width as usize))),
            }
            first = bands.iter().max().map_or(0, |last| last + 1);
        }
        bands
    }

    /// The block in coefficients of the cosines of rows (members of a bundle, across, down) and columns.
    fn forward(self, half: &Dense<f32>) -> Dense<f32> {
        let mut out = half.clone();
        self.transform(&mut out, Direction::Forward);
        out
    }

    /// Transforms all rows and columns.
    fn transform(self, half: &mut Dense<f32>, direction: Direction) {
        self.rows(&mut half.data, half.n_cols, direction);
        (0..half.n_rows).for_each(|row| self.columns(half.row_mut(row), direction));
    }

    /// A fit of the transformed block as one of the block itself.
    fn back(self, mut fit: Fit) -> Fit {
        (0..fit.basis.n_rows).for_each(|row| self.columns(fit.basis.row_mut(row), Direction::Inverse));
        for half in [&mut fit.a, &mut fit.b] {
            self.rows(&mut half.data, half.n_cols, Direction::Inverse);
        }
        fit
    }

    /// Transforms the rows of a row-major matrix.
    fn rows(self, values: &mut [f32], n_cols: usize, direction: Direction) {
        let [width, height] = self.tile;
        let Smoothing { bundle_len, cosines, .. } = self.smoothing;
        cosines.along(values, *bundle_len as u32, n_cols, direction);
        cosines.along(values, width, bundle_len * n_cols, direction);
        cosines.along(values, height, width as usize * bundle_len * n_cols, direction);
    }

    /// Transforms one row.
    fn columns(self, row: &mut [f32], direction: Direction) {
        let mut rest = row;
        for run in self.runs {
            let (own, others) = rest.split_at_mut(run.n_cols() as usize);
            if let ColumnRun::Grid { width, height } = *run {
                self.smoothing.cosines.planes(own, [width, height], direction);
            }
            rest = others;
        }
    }
}

/// Bundles that no sample of any column found anything for stay zero. What smoothing brings there from their neighbors is weight on
/// nothing; and where a product is kept, which is zero there, it would be taken from another column.
fn clear_unlit(factors: &mut Unpacked, means: &Means, bundle_len: usize) {
    let is_unlit = |row: usize| [&means.a, &means.b].iter().all(|half| half.row(row).iter().all(|x| *x == 0.0));
    for first in (0..means.mean.n_rows).step_by(bundle_len) {
        let rows = first..first + bundle_len;
        if rows.clone().all(is_unlit) {
            for row in rows {
                factors.left.row_mut(row).fill(0.0);
                factors.doubt.row_mut(row).fill(0.0);
            }
        }
    }
}

/// Adds rows of both halves to the bands of their columns.
fn add_rows<'r>(rows: impl Iterator<Item = [&'r [f32]; 2]>, of_cols: &[usize], bands: &mut [Band]) {
    let mut n_rows = 0.0;
    let mut sums = vec![[0.0; 2]; of_cols.len()];
    for [a, b] in rows {
        n_rows += 1.0;
        for ((a, b), sums) in a.iter().zip(b).zip(&mut sums) {
            let (noise, mean) = (0.5 * f64::from(a - b), 0.5 * f64::from(a + b));
            *sums = [sums[0] + noise * noise, sums[1] + mean * mean];
        }
    }
    for ([noise, energy], col) in sums.into_iter().zip(of_cols) {
        let band = &mut bands[*col];
        *band = [band[0] + noise, band[1] + energy, band[2] + n_rows];
    }
}

/// Band of a place on a grid of frequencies.
fn band_of(at: usize, width: usize) -> usize {
    let sum = at % width + at / width;
    BAND_EDGES.partition_point(|&edge| edge <= sum)
}

/// Share of a band's energy that is no noise, or a little less where few coefficients tell.
fn weight([noise, energy, count]: Band) -> f64 {
    if energy > 0.0 { (1.0 - (1.0 + CAUTION / count.sqrt()) * noise / energy).max(0.0) } else { 0.0 }
}
