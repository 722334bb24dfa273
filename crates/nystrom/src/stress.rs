//! Matrices on which low-rank approximations fail, and how far each method gets there.
//!
//! A [`Case`] has a truth, two halves that were sampled of it, and a rank. What the rank allows at best is known: the truncated
//! decomposition of the mean of both halves, in double precision, at the rank up to that of the case which comes closest to the
//! *truth* (with noise a smaller rank is often better; the optimum may choose it with knowledge that no method has).
//! Whatever is said of an error is said of its Frobenius norm, in double precision.
//!
//! ```
//! use clerestory_nystrom::stress;
//!
//! let case = stress::cases(7).into_iter().find(|case| case.name == "Hilbert").ok_or("no such case")?;
//! let ours = stress::ours(&case)?;
//! assert!(ours.error <= case.allowed());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod cases;
mod others;
mod stored;

use nalgebra::{DMatrix, SVD};

use crate::{
    compress::{BlockSamples, ColumnGroup, CompressConfig, CompressError, Tolerance, unpacked},
    dense::Dense,
    factors::deviation,
    means::Means,
    product::product,
};

pub use cases::{cases, refused};
pub use others::{condition, rival};
pub use stored::{ASKED, Stored, StoredError, stored};

/// A matrix, how it was sampled, and what is asked of an approximation.
#[derive(Clone, Debug)]
pub struct Case {
    /// What is hard about it.
    pub name: &'static str,
    /// The matrix without noise.
    pub truth: DMatrix<f32>,
    /// Two independent samples of it; equal where there is no noise.
    pub halves: [DMatrix<f32>; 2],
    /// Rows that are chosen together.
    pub bundle_len: usize,
    /// Greatest rank of an approximation; may be more than there are rows or columns.
    pub rank: usize,
}

/// What [`compress`](crate::compress()) makes of a case that it is told the rank of; [`Stored`] is what comes of a tolerance.
#[derive(Clone, Debug, PartialEq)]
pub struct Ours {
    /// Components that were kept.
    pub rank: usize,
    /// Distance from the truth of the factors as they were computed.
    pub error: f64,
    /// The same after they were packed as [`BlockFactors`](crate::BlockFactors), whose numbers have eleven bits.
    pub packed_error: f64,
    /// What the two halves tell of `error`, without knowing the truth; an unbiased square of it may come out below zero and then
    /// counts as zero.
    pub told: f64,
    /// Standard deviation of the square of `told` when the noise is another one, see
    /// [`BlockError::deviation`](crate::BlockError::deviation).
    pub doubt: f64,
    /// Left factor, row-major, rows × rank, over the unit.
    pub left: Vec<f32>,
    /// Right factor, row-major, rank × columns.
    pub right: Vec<f32>,
    /// A power of two.
    pub unit: f64,
}

/// Share of the norm that single precision does not hold.
pub const FLOOR: f64 = 1e-6;

impl Case {
    /// What a method that knows no halves is given: their mean, in double precision.
    pub fn mean(&self) -> DMatrix<f64> {
        self.halves[0].zip_map(&self.halves[1], |a, b| 0.5 * (f64::from(a) + f64::from(b)))
    }

    /// Norm of the truth; where that is zero, of what was sampled of it.
    pub fn norm(&self) -> f64 {
        if self.is_zero() { self.mean().norm() } else { self.truth.map(f64::from).norm() }
    }

    fn is_zero(&self) -> bool {
        self.truth.iter().all(|&x| x == 0.0)
    }

    /// Distance of an approximation from the truth; infinite where it has entries that are no numbers.
    pub fn distance(&self, approximation: &DMatrix<f64>) -> f64 {
        let square = |(truth, x): (&f32, &f64)| (f64::from(*truth) - x).powi(2);
        let distance = self.truth.iter().zip(approximation.iter()).map(square).sum::<f64>().sqrt();
        if distance.is_finite() { distance } else { f64::INFINITY }
    }

    /// What is asked of this crate's own factors before they are packed: twice the distance of the best approximation, and a
    /// millionth of the norm for numbers in single precision.
    pub fn allowed(&self) -> f64 {
        self.allowed_beside(self.optimum())
    }

    /// The same where the distance of the best approximation is known.
    pub fn allowed_beside(&self, optimum: f64) -> f64 {
        2.0 * optimum + FLOOR * self.norm()
    }

    /// Distance of the best approximation from the truth. Rank 0 counts unless it is the truth: who has to answer with a
    /// number to noise alone, of which nobody says that it is noise, is not asked for less than rank 1.
    pub fn optimum(&self) -> f64 {
        let svd = SVD::new(self.mean(), true, true);
        let (u, vt) = (svd.u.expect("was asked for"), svd.v_t.expect("was asked for"));
        let mut kept = DMatrix::zeros(self.truth.nrows(), self.truth.ncols());
        let mut least = if self.is_zero() { f64::INFINITY } else { self.norm() };
        for r in 0..self.rank.min(svd.singular_values.len()) {
            kept.ger(svd.singular_values[r], &u.column(r), &vt.row(r).transpose(), 1.0);
            least = least.min(self.distance(&kept));
        }
        least
    }
}

/// Compresses a case to its rank.
///
/// # Errors
/// Samples that are not finite.
pub fn ours(case: &Case) -> Result<Ours, CompressError> {
    let (n_rows, n_cols) = case.truth.shape();
    let halves = case.halves.each_ref().map(row_major);
    let samples = samples(case, &halves);
    let tolerance = Tolerance::Rank(case.rank as u32);
    let group = ColumnGroup { columns: 0..n_cols, tolerance, preserved: Vec::new(), share: 1.0, apart: 0.0 };
    let config = CompressConfig { max_rank: case.rank as u32, ..CompressConfig::default() };
    let factors = unpacked(&samples, &group, &config, 0, &mut Means::default())?;
    let wide = |matrix: &Dense<f32>| matrix.to_f64();
    let dense = product(wide(&factors.left).view(), wide(&factors.right).view());
    let dense = DMatrix::from_row_iterator(n_rows, n_cols, dense.data.iter().map(|x| x * factors.unit));
    let packed = factors.packed().dense();
    let packed = DMatrix::from_row_iterator(n_rows, n_cols, packed.into_iter().map(f64::from));
    let entries = (n_rows * n_cols) as f64;
    let told = (factors.truncation + factors.sampling).max(0.0) * entries;
    let doubt = entries * deviation(factors.noise, told / entries, entries);
    Ok(Ours {
        rank: factors.left.n_cols,
        error: case.distance(&dense),
        packed_error: case.distance(&packed),
        told: told.sqrt() * factors.unit,
        doubt: doubt * factors.unit * factors.unit,
        left: factors.left.data,
        right: factors.right.data,
        unit: factors.unit,
    })
}

/// One sample of each row and half.
fn samples<'a>(case: &Case, halves: &'a [Vec<f32>; 2]) -> BlockSamples<'a> {
    BlockSamples {
        halves: halves.each_ref().map(Vec::as_slice),
        sparse: [&[]; 2],
        n_cols: case.truth.ncols(),
        bundle_len: case.bundle_len,
        n_samples: [1; 2],
    }
}

fn row_major(matrix: &DMatrix<f32>) -> Vec<f32> {
    matrix.transpose().iter().copied().collect()
}
