//! The best that there is of some blocks \[Eckart1936\]: found once, then cut off wherever a tolerance says.

use anyhow::Result;
use clerestory_nystrom::rivals::{DMatrix, Method, approximate};
use clerestory_nystrom::{BlockError, BlockFactors};
use rayon::prelude::*;

use super::rows::Found;
use super::{Block, Traced, allowed};
use crate::fronts::block_factors;

/// Leading singular vectors of each block.
pub struct Singular {
    blocks: Vec<OfBlock>,
}

/// Of the mean of both halves, which is what is kept, and of each half, so that the other one can judge it; the mean alone where
/// there is no noise.
struct OfBlock {
    mean: Components,
    halves: Option<[Components; 2]>,
}

/// A matrix and its components, the largest first.
struct Components {
    matrix: DMatrix<f32>,
    left: DMatrix<f32>,
    right: DMatrix<f32>,
}

impl Singular {
    /// Decomposes every block, as far as some rank.
    ///
    /// # Errors
    /// If an iteration does not end.
    pub fn new(traced: &Traced, most_rank: u32) -> Result<Singular> {
        let components = |matrix: DMatrix<f32>| -> Result<Components> {
            let (left, right) = approximate(Method::Svd, &matrix, most_rank as usize, 0)?.into_factors();
            Ok(Components { matrix, left, right })
        };
        let of_block = |block: &Block| -> Result<OfBlock> {
            let [a, b] = [0, 1].map(|half| mean_of(block, half, traced.n_cols));
            if traced.is_exact {
                return Ok(OfBlock { mean: components(a)?, halves: None });
            }
            let mean = components((&a + &b) * 0.5)?;
            Ok(OfBlock { mean, halves: Some([components(a)?, components(b)?]) })
        };
        Ok(Singular { blocks: traced.blocks.par_iter().map(of_block).collect::<Result<Vec<_>>>()? })
    }

    /// As many components of each block as a tolerance takes, packed as a bake is.
    ///
    /// # Errors
    /// If what was packed cannot be read.
    pub fn found(&self, traced: &Traced, tolerance_db: f64) -> Result<Found> {
        let goal = f64::from(traced.share * allowed(tolerance_db));
        let cut = |(of_block, block): (&OfBlock, &Block)| BlockFactors {
            sparse: block.kept_apart(),
            n_samples: block.n_samples.iter().sum(),
            ..of_block.cut(goal)
        };
        let factors: Vec<BlockFactors> = self.blocks.par_iter().zip(&traced.blocks).map(cut).collect();
        traced.packed(factors, tolerance_db)
    }
}

/// The mean of a half's samples, rows × columns.
fn mean_of(block: &Block, half: usize, n_cols: usize) -> DMatrix<f32> {
    let sums = &block.halves[half];
    DMatrix::from_row_slice(sums.len() / n_cols, n_cols, sums) / block.n_samples[half] as f32
}

impl OfBlock {
    /// As few components as leave no more than a mean square, and what the halves tell of them.
    fn cut(&self, mean_square: f64) -> BlockFactors {
        let n_entries = self.mean.matrix.len() as f64;
        let rank = self.mean.rank(mean_square * n_entries);
        let (left, right) = self.mean.factors(rank);
        let sums = match &self.halves {
            None => [squared_difference(&self.mean.matrix, &(&left * &right)), 0.0, 0.0],
            Some(halves) => told(halves, rank),
        };
        let [truncation, sampling, noise] = sums.map(|sum| (sum / n_entries) as f32);
        BlockFactors { error: BlockError { truncation, sampling, noise }, ..block_factors(&left, &right) }
    }
}

impl Components {
    /// As few as leave no more than so much energy.
    fn rank(&self, goal: f64) -> usize {
        let mut rest = energy(self.matrix.iter());
        let is_needed = |nth: &usize| {
            let is_needed = rest > goal;
            rest -= energy(self.left.column(*nth).iter()) * energy(self.right.row(*nth).iter());
            is_needed
        };
        (0..self.left.ncols()).take_while(is_needed).count()
    }

    fn factors(&self, rank: usize) -> (DMatrix<f32>, DMatrix<f32>) {
        let rank = rank.min(self.left.ncols());
        (self.left.columns(0, rank).into_owned(), self.right.rows(0, rank).into_owned())
    }
}

/// What the first components of each half miss of both halves, `⟨A − F, B − G⟩`, what they differ by, `¼ ‖F − G‖²`, and the noise of the
/// mean as it is, `¼ ‖A − B‖²`.
fn told([a, b]: &[Components; 2], rank: usize) -> [f64; 3] {
    let [f, g] = [a, b].map(|half| {
        let (left, right) = half.factors(rank);
        left * right
    });
    let mut missed = 0.0;
    for ((a, f), (b, g)) in a.matrix.iter().zip(&f).zip(b.matrix.iter().zip(&g)) {
        missed += f64::from(a - f) * f64::from(b - g);
    }
    [missed, 0.25 * squared_difference(&f, &g), 0.25 * squared_difference(&a.matrix, &b.matrix)]
}

fn energy<'a>(values: impl Iterator<Item = &'a f32>) -> f64 {
    values.map(|x| f64::from(*x).powi(2)).sum()
}

fn squared_difference(a: &DMatrix<f32>, b: &DMatrix<f32>) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::targets::soft;

    #[test]
    fn what_is_cut_off_is_what_the_method_finds_by_itself() {
        let picture = soft::picture(32, 16, 4);
        let peak = picture.peak() as f32;
        let values = picture.values.iter().map(|x| x / peak).collect();
        let traced = Traced::of_picture(&crate::methods::dense::Picture { values, ..picture }, &[0, 1], 2);
        let singular = Singular::new(&traced, 768).unwrap();
        for tolerance_db in [20.0, 40.0] {
            let cut = singular.found(&traced, tolerance_db).unwrap();
            let found = traced.found((Method::Svd, 0), 768, tolerance_db).unwrap();
            assert_eq!(cut.mean_rank, found.mean_rank, "{tolerance_db} dB");
            assert!((cut.db - found.db).abs() < 0.1 && cut.db > tolerance_db - 0.5, "{} {}", cut.db, found.db);
        }
    }
}
