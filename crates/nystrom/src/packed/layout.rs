//! How rows and columns lie beside each other, so that neighbors can be told from strangers.

use crate::{
    cosine::{Cosines, Direction},
    partition::Partition,
};

/// How much more rows at a border count than those within, and over how many bundles that fades.
#[derive(Clone, Copy)]
struct Border {
    weight: f32,
    reach: f32,
}

/// Errors of two blocks know nothing of each other, so that they differ more across a border than within. So rows there are
/// stored more finely: a part of the format.
const STORED: Border = Border { weight: 0.5, reach: 2.0 };
/// The same where components are found and chosen, at 40 dB and finer: a reader does not need to know.
const CHOSEN: Border = Border { weight: 1.7, reach: 0.6 };
/// What is allowed at 40 dB, over the root mean square from which on it is taken as it is. Where more is, borders count more: few components
/// leave out more that differs across a border.
const FINE: f64 = 0.04;
/// With which power, and up to which weight: beyond it the rank grows, and steps hardly fall.
const COARSENESS: f64 = 1.5;
const MOST_CHOSEN: f64 = 6.0;

/// How much more rows at a border count where components are chosen, by the mean square error that is allowed and the root mean square
/// from which on that is taken as it is (0 where there is none).
pub(super) fn border_weight(allowed: f32, strong: f32) -> f32 {
    let coarse = f64::from(allowed).max(0.0).sqrt() / (FINE * f64::from(strong));
    let weight =
        f64::from(CHOSEN.weight) * coarse.max(1.0).powf(COARSENESS).min(MOST_CHOSEN / f64::from(CHOSEN.weight));
    if strong > 0.0 { weight as f32 } else { CHOSEN.weight }
}

/// Columns that follow each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColumnRun {
    /// So many columns that have nothing to do with their neighbors.
    List(u32),
    /// Columns that lie on a grid, row by row: width × height. Neighbors are often alike.
    Grid {
        /// Columns of the grid.
        width: u32,
        /// Rows of the grid.
        height: u32,
    },
}

impl ColumnRun {
    /// Width and height; a list is as wide as it is long.
    pub(super) fn size(self) -> [u32; 2] {
        match self {
            ColumnRun::List(len) => [len, 1],
            ColumnRun::Grid { width, height } => [width, height],
        }
    }

    /// Number of columns.
    #[expect(clippy::arithmetic_side_effects, reason = "`Layout::is_sound` holds of everything that is read")]
    pub fn n_cols(self) -> u32 {
        let [width, height] = self.size();
        width * height
    }
}

/// The layout of a matrix, and the transforms that it calls for.
#[derive(Clone, Debug)]
pub(super) struct Layout {
    pub(super) partition: Partition,
    pub(super) bundle_len: u32,
    pub(super) columns: Vec<ColumnRun>,
    cosines: Cosines,
}

impl Layout {
    /// Whether rows and columns can be counted at all: everything below counts on that.
    pub(super) fn is_sound(partition: &Partition, bundle_len: u32, columns: &[ColumnRun]) -> bool {
        let Partition { width, height, tile } = *partition;
        let n_rows = width.min(tile).checked_mul(height.min(tile)).and_then(|n| n.checked_mul(bundle_len));
        let n_cols = columns.iter().try_fold(0u32, |sum, run| {
            let [width, height] = run.size();
            sum.checked_add(width.checked_mul(height)?)
        });
        tile > 0 && bundle_len > 0 && n_rows.is_some() && n_cols.is_some()
    }

    #[expect(clippy::arithmetic_side_effects, reason = "`Layout::is_sound` holds of everything that is read")]
    pub(super) fn new(partition: Partition, bundle_len: u32, columns: Vec<ColumnRun>) -> Self {
        let Partition { width, height, tile } = partition;
        let of_rows = [width, height].into_iter().flat_map(|side| [side.min(tile), side % tile]);
        let of_columns = columns.iter().flat_map(|run| match run {
            ColumnRun::List(_) => [1, 1],
            ColumnRun::Grid { width, height } => [*width, *height],
        });
        let cosines = Cosines::new(of_rows.chain(of_columns).chain([bundle_len]));
        Self { partition, bundle_len, columns, cosines }
    }

    /// Width and height of a block's tile in bundles.
    pub(super) fn tile(&self, block_idx: usize) -> [u32; 2] {
        let [_, _, width, height] = self.partition.rect(block_idx);
        [width, height]
    }

    /// Rows of a block.
    #[expect(clippy::arithmetic_side_effects, reason = "`Layout::is_sound` holds of everything that is read")]
    pub(super) fn n_rows(&self, block_idx: usize) -> usize {
        let [width, height] = self.tile(block_idx);
        (width * height * self.bundle_len) as usize
    }

    /// Columns of the matrix.
    pub(super) fn n_cols(&self) -> usize {
        self.columns.iter().map(|run| run.n_cols() as usize).sum()
    }

    /// What each row of a block is multiplied with where it is stored: more towards the border of its tile, where it meets
    /// another block's.
    pub(super) fn row_weights(&self, block_idx: usize) -> Vec<f32> {
        self.weights(block_idx, STORED)
    }

    /// How much an error counts in each row where the components of a block are found and chosen, at a [`border_weight`].
    pub(super) fn choice_weights(&self, block_idx: usize, weight: f32) -> Vec<f32> {
        self.weights(block_idx, Border { weight, ..CHOSEN })
    }

    #[expect(clippy::arithmetic_side_effects, reason = "`Layout::is_sound` holds of everything that is read")]
    fn weights(&self, block_idx: usize, Border { weight, reach }: Border) -> Vec<f32> {
        let [width, height] = self.tile(block_idx);
        let along = |at: u32, len: u32| 1.0 + weight * (-(at.min(len - 1 - at) as f32) / reach).exp();
        let of_bundle = |bundle: u32| along(bundle % width, width) * along(bundle / width, height);
        (0..width * height * self.bundle_len).map(|row| of_bundle(row / self.bundle_len)).collect()
    }

    /// One value per row, bundle by bundle, to one plane of coefficients per member of a bundle; the first is their mean.
    #[expect(clippy::arithmetic_side_effects, reason = "`Layout::is_sound` holds of everything that is read")]
    pub(super) fn rows_forward(&self, rows: &[f32], block_idx: usize) -> Vec<f32> {
        let (len, n_bundles) = (self.bundle_len as usize, rows.len() / self.bundle_len as usize);
        let mut planes: Vec<f32> = (0..rows.len()).map(|at| rows[at % n_bundles * len + at / n_bundles]).collect();
        self.cosines.along(&mut planes, self.bundle_len, n_bundles, Direction::Forward);
        self.cosines.planes(&mut planes, self.tile(block_idx), Direction::Forward);
        planes
    }

    /// The way back.
    #[expect(clippy::arithmetic_side_effects, reason = "`Layout::is_sound` holds of everything that is read")]
    pub(super) fn rows_inverse(&self, mut planes: Vec<f32>, block_idx: usize) -> Vec<f32> {
        let (len, n_bundles) = (self.bundle_len as usize, planes.len() / self.bundle_len as usize);
        self.cosines.planes(&mut planes, self.tile(block_idx), Direction::Inverse);
        self.cosines.along(&mut planes, self.bundle_len, n_bundles, Direction::Inverse);
        (0..planes.len()).map(|at| planes[at % len * n_bundles + at / len]).collect()
    }

    /// One value per column to coefficients, run by run, or back.
    #[expect(clippy::arithmetic_side_effects, reason = "`Layout::is_sound` holds of everything that is read")]
    pub(super) fn columns(&self, values: &mut [f32], direction: Direction) {
        let mut first = 0;
        for run in &self.columns {
            let own = &mut values[first..first + run.n_cols() as usize];
            if let ColumnRun::Grid { width, height } = *run {
                self.cosines.planes(own, [width, height], direction);
            }
            first += own.len();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn rows_and_columns_come_back() {
        let mut rng = Random::new([41, 0]);
        let partition = Partition { width: 21, height: 18, tile: 16 };
        let columns = vec![ColumnRun::List(5), ColumnRun::Grid { width: 4, height: 3 }];
        let layout = Layout::new(partition, 3, columns);
        assert_eq!((layout.n_cols(), layout.n_rows(3)), (17, 5 * 2 * 3));
        for block_idx in 0..4 {
            let rows: Vec<f32> = (0..layout.n_rows(block_idx)).map(|_| rng.normal()).collect();
            let back = layout.rows_inverse(layout.rows_forward(&rows, block_idx), block_idx);
            assert!(rows.iter().zip(&back).all(|(a, b)| (a - b).abs() < 1e-5));
        }
        let values: Vec<f32> = (0..17).map(|_| rng.normal()).collect();
        let mut changed = values.clone();
        layout.columns(&mut changed, Direction::Forward);
        assert!(changed[..5] == values[..5] && changed[5..] != values[5..]);
        layout.columns(&mut changed, Direction::Inverse);
        assert!(values.iter().zip(&changed).all(|(a, b)| (a - b).abs() < 1e-5));
    }

    #[test]
    fn a_gray_even_tile_is_one_coefficient() {
        let layout = Layout::new(Partition { width: 4, height: 2, tile: 4 }, 3, vec![ColumnRun::List(1)]);
        let planes = layout.rows_forward(&[1.0; 24], 0);
        assert!((planes[0] - 24f32.sqrt()).abs() < 1e-5 && planes[1..].iter().all(|x| x.abs() < 1e-5));
    }

    #[test]
    fn borders_count_more_the_more_is_allowed_and_alike_at_every_scale() {
        let weight = |db: f32, scale: f32| border_weight(10f32.powf(-0.1 * db) * scale * scale, 0.25 * scale);
        for (db, want) in [(60.0, 1.7), (40.0, 1.7), (35.0, 4.0), (30.0, 6.0), (10.0, 6.0)] {
            assert!((weight(db, 1.0) - want).abs() < 0.05, "{db} dB: {}", weight(db, 1.0));
            assert_eq!([2f32.powi(20), 2f32.powi(-20)].map(|scale| weight(db, scale)), [weight(db, 1.0); 2]);
        }
        assert_eq!(border_weight(1.0, 0.0), CHOSEN.weight);
    }
}
