//! Which rows and columns speak for a block: four ways to choose, three of them by k-means, and a variant of one.
//!
//! Rows are chosen in whole bundles. Later rounds weigh each bundle by what the landmarks so far leave of it, so that a lone
//! odd row is found.

use crate::{dense::Dense, kmeans::representatives, random::Random, rivals::Real};

/// How landmarks are chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Selection {
    /// Random rows; columns by k-means over them.
    Alg1,
    /// Random columns; rows by k-means over them.
    Alg2,
    /// Random rows and random columns.
    Alg3,
    /// Random columns, half of the rows by k-means over them, all columns by k-means over these rows, and the other rows by
    /// k-means over those; the first columns are no landmarks.
    #[default]
    Alg4,
    /// The same with columns of both rounds: half of the columns at random, half of the rows by k-means over them, the other columns by
    /// k-means over these rows, and the other rows by k-means over those.
    Alg4Union,
}

/// The landmarks of a block.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Landmarks {
    /// Bundles, counted within the block; each once.
    pub bundles: Vec<usize>,
    /// Columns; each once.
    pub columns: Vec<usize>,
}

/// A block whose landmarks are sought.
#[derive(Clone, Copy)]
pub struct Candidates<'a, T = f32> {
    /// Row-major, rows × columns.
    pub values: &'a [T],
    /// Number of columns.
    pub n_cols: usize,
    /// Rows per bundle.
    pub bundle_len: usize,
    /// Bundles that may be chosen, counted within the block.
    pub bundles: &'a [usize],
    /// One per member of `bundles`; 0 is never chosen.
    pub weights: &'a [f32],
}

/// Random columns with which row clusters are first told apart.
const N_FIRST_COLUMNS: usize = 16;

/// Chooses at most `n_bundles` bundles and `n_columns` columns. The same key gives the same choice.
pub fn choose<T: Real>(
    candidates: &Candidates<'_, T>,
    selection: Selection,
    n_bundles: usize,
    n_columns: usize,
    key: [u64; 2],
) -> Landmarks {
    choose_from(candidates, selection, n_bundles, n_columns, &mut Random::new(key))
}

pub(crate) fn choose_from<T: Real>(
    candidates: &Candidates<'_, T>,
    selection: Selection,
    n_bundles: usize,
    n_columns: usize,
    rng: &mut Random,
) -> Landmarks {
    let all_columns: Vec<usize> = (0..candidates.n_cols).collect();
    match selection {
        Selection::Alg1 => {
            let bundles = candidates.random_bundles(n_bundles, rng);
            let columns = candidates.columns_by_means(&bundles, &[], n_columns, rng);
            Landmarks { bundles, columns }
        }
        Selection::Alg2 => {
            let columns = rng.choose(&all_columns, n_columns);
            let bundles = candidates.bundles_by_means(&columns, n_bundles, rng);
            Landmarks { bundles, columns }
        }
        Selection::Alg3 => {
            let bundles = candidates.random_bundles(n_bundles, rng);
            Landmarks { bundles, columns: rng.choose(&all_columns, n_columns) }
        }
        Selection::Alg4 => candidates.alternate(n_bundles, n_columns, rng),
        Selection::Alg4Union => candidates.alternate_united(n_bundles, n_columns, rng),
    }
}

impl<T: Real> Candidates<'_, T> {
    /// Algorithm 4: rows and columns in turn, two rounds; the rows of both are united.
    fn alternate(&self, n_bundles: usize, n_columns: usize, rng: &mut Random) -> Landmarks {
        let all_columns: Vec<usize> = (0..self.n_cols).collect();
        let first_columns = rng.choose(&all_columns, N_FIRST_COLUMNS.max(n_columns / 2));
        let bundles = self.bundles_by_means(&first_columns, n_bundles.div_ceil(2), rng);
        let columns = self.columns_by_means(&bundles, &[], n_columns, rng);
        Landmarks { bundles: self.with_others(bundles, &columns, n_bundles, rng), columns }
    }

    /// Algorithm 4 with the columns of both rounds united as well, in the same numbers.
    fn alternate_united(&self, n_bundles: usize, n_columns: usize, rng: &mut Random) -> Landmarks {
        let all_columns: Vec<usize> = (0..self.n_cols).collect();
        let mut columns = rng.choose(&all_columns, n_columns.div_ceil(2));
        let bundles = self.bundles_by_means(&columns, n_bundles.div_ceil(2), rng);
        let others = self.columns_by_means(&bundles, &columns, n_columns - columns.len(), rng);
        let bundles = self.with_others(bundles, &others, n_bundles, rng);
        columns.extend(others);
        Landmarks { bundles, columns }
    }

    /// Bundles, and as many more by k-means over some columns as are missing.
    fn with_others(
        &self,
        mut bundles: Vec<usize>,
        columns: &[usize],
        n_bundles: usize,
        rng: &mut Random,
    ) -> Vec<usize> {
        let rest: Vec<usize> = (0..self.bundles.len()).filter(|&i| !bundles.contains(&self.bundles[i])).collect();
        let rest_bundles: Vec<usize> = rest.iter().map(|&i| self.bundles[i]).collect();
        let rest_weights: Vec<f32> = rest.iter().map(|&i| self.weights[i]).collect();
        let others = Candidates { bundles: &rest_bundles, weights: &rest_weights, ..*self };
        bundles.extend(others.bundles_by_means(columns, n_bundles - bundles.len(), rng));
        bundles
    }

    fn random_bundles(&self, count: usize, rng: &mut Random) -> Vec<usize> {
        let pool = self.bundles.iter().zip(self.weights).filter(|(_, weight)| **weight > 0.0);
        rng.choose(&pool.map(|(&bundle, _)| bundle).collect::<Vec<_>>(), count)
    }

    /// Clusters bundles by what all their rows hold in some columns.
    fn bundles_by_means(&self, columns: &[usize], count: usize, rng: &mut Random) -> Vec<usize> {
        let mut data = Vec::with_capacity(self.bundles.len() * self.bundle_len * columns.len());
        for row in self.bundles.iter().flat_map(|&bundle| bundle * self.bundle_len..(bundle + 1) * self.bundle_len) {
            let values = &self.values[row * self.n_cols..][..self.n_cols];
            data.extend(columns.iter().map(|&col| values[col]));
        }
        let points = Dense { n_rows: self.bundles.len(), n_cols: self.bundle_len * columns.len(), data };
        representatives(&points, self.weights, count, rng).into_iter().map(|i| self.bundles[i]).collect()
    }

    /// Clusters columns by what they hold in all rows of some bundles; those that are known are not chosen again.
    fn columns_by_means(&self, bundles: &[usize], known: &[usize], count: usize, rng: &mut Random) -> Vec<usize> {
        let rows: Vec<usize> =
            bundles.iter().flat_map(|&bundle| bundle * self.bundle_len..(bundle + 1) * self.bundle_len).collect();
        let mut data = Vec::with_capacity(self.n_cols * rows.len());
        for col in 0..self.n_cols {
            data.extend(rows.iter().map(|row| self.values[row * self.n_cols + col]));
        }
        let points = Dense { n_rows: self.n_cols, n_cols: rows.len(), data };
        let mut weights = vec![1.0; self.n_cols];
        known.iter().for_each(|&col| weights[col] = 0.0);
        representatives(&points, &weights, count, rng)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_algorithm_chooses_different_bundles_and_columns_among_the_candidates() {
        let mut rng = Random::new([8, 8]);
        let values: Vec<f32> = (0..60 * 3 * 40).map(|_| rng.normal()).collect();
        let bundles: Vec<usize> = (0..60).filter(|i| i % 7 != 0).collect();
        let mut weights = vec![1.0; bundles.len()];
        weights[0] = 0.0;
        let candidates =
            Candidates { values: &values, n_cols: 40, bundle_len: 3, bundles: &bundles, weights: &weights };
        let algorithms = [Selection::Alg1, Selection::Alg2, Selection::Alg3, Selection::Alg4, Selection::Alg4Union];
        for selection in algorithms {
            let Landmarks { bundles: mut chosen, mut columns } = choose(&candidates, selection, 8, 12, [1, 2]);
            assert!(chosen.len() == 8 && columns.len() == 12, "{selection:?}: {chosen:?} {columns:?}");
            assert!(chosen.iter().all(|i| i % 7 != 0 && *i != bundles[0]), "{selection:?}: {chosen:?}");
            chosen.sort_unstable();
            columns.sort_unstable();
            chosen.dedup();
            columns.dedup();
            assert!(chosen.len() == 8 && columns.len() == 12, "{selection:?}: {chosen:?} {columns:?}");
        }
    }
}
