//! Every method of the field, behind one interface: a matrix and a rank go in, an approximation comes out.
//!
//! They are here to be compared with: on the same matrix, in the same numbers (`f32` or `f64`), with the same seed. A method gets the
//! whole matrix, whatever it would look at by itself, so nothing here says what a method costs where entries are dear. What it
//! does with bad matrices is left as its authors have it; only the matrix's overall scale is taken out first (by a power of two, which
//! changes no digit), and infinities are refused.
//!
//! ```
//! use clerestory_nystrom::rivals::{DMatrix, Method, approximate};
//!
//! // Hilbert's matrix: its singular values fall by a factor of about thirty each.
//! let hilbert = DMatrix::from_fn(40, 30, |i, j| 1.0 / (i + j + 1) as f64);
//! let error = |name: &str, rank| -> Result<f64, Box<dyn std::error::Error>> {
//!     let method: Method = name.parse()?;
//!     Ok((&hilbert - approximate(method, &hilbert, rank, 1)?.to_dense()).norm())
//! };
//! // Nothing of rank 6 is nearer than the singular value decomposition [Eckart1936] …
//! let best = error("svd", 6)?;
//! // … but complete pivoting comes close, and so do six chosen rows onto which all others are projected.
//! assert!(best < error("aca-full", 6)? && error("aca-full", 6)? < 20.0 * best);
//! assert!(best < error("alg4:projection", 6)? && error("alg4:projection", 6)? < 100.0 * best);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod aca;
mod approximation;
pub(crate) mod block;
mod cross;
mod decompose;
mod deim;
mod generalized;
mod interpolative;
mod kernel;
#[cfg(test)]
mod laws;
mod names;
mod ours;
mod real;
mod sensing;
mod svd;

pub use nalgebra::DMatrix;

pub use approximation::Approximation;
pub(crate) use cross::landmarks;
#[cfg(test)]
pub(crate) use cross::with_core;
pub use names::UnknownMethod;
pub use ours::unrounded;
pub use real::Real;

use crate::{landmarks::Selection, random::Random};
use real::scaled;

/// What stands between chosen columns C and chosen rows R, whose intersection is W.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Core {
    /// `C · W⁻¹ · R` \[Drineas2005\].
    Inverse,
    /// `C · W⁺ · R`; singular values of W up to `rcond` of the largest count as zero.
    PseudoInverse {
        /// Share of the largest singular value.
        rcond: f64,
    },
    /// `C · (WᵀW + λ²)⁻¹Wᵀ · R`, with λ as a share of the largest singular value \[Tikhonov1963\].
    Tikhonov {
        /// Share of the largest singular value.
        lambda: f64,
    },
    /// `C · (C⁺ A R⁺) · R`, by orthonormal bases of C and R: the best core for both \[Stewart1999\].
    Qr,
    /// `A · R⁺ · R`: the rows alone.
    Projection,
}

/// A way to approximate a matrix by one of low rank.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum Method {
    /// Random rows; columns by k-means over them.
    Alg1(Core),
    /// Random columns; rows by k-means over them.
    Alg2(Core),
    /// Random rows and random columns.
    Alg3(Core),
    /// Rows and columns by k-means in turn; rows of two rounds, united.
    Alg4(Core),
    /// The same with columns of both rounds, the random ones among them. [`Method::ALL`] leaves it out.
    Alg4Union(Core),
    /// Nyström's method after a power of every entry \[Wang2009\]; rows and columns as in Algorithm 4.
    Kernel {
        /// The power; found from the chosen rows and columns where it is not given.
        gamma: Option<f64>,
        /// Singular values of the intersection in powers up to this share of the largest count as zero.
        rcond: f64,
    },
    /// The best there is: leading singular vectors \[Eckart1936\].
    Svd,
    /// Rows, and all rows as combinations of them: the interpolative decomposition \[Cheng2005\] by strong rank-revealing QR
    /// \[Gu1996\].
    RowId,
    /// Rows and columns by discrete empirical interpolation of the singular vectors \[Sorensen2016\].
    DeimCur,
    /// Adaptive cross approximation with partial pivoting \[Bebendorf2000\].
    AcaPartial,
    /// Adaptive cross approximation with full pivoting.
    AcaFull,
    /// Two Gaussian sketches, the left one half as wide again \[Nakatsukasa2020\].
    GeneralizedNystrom,
    /// Every row by itself from random measurements of it, sparse in Haar's basis \[Peers2009\], \[Sen2009\].
    CompressedSensing,
    /// This crate's own: [`crate::compress()`] with all rows as samples, its result in `f16`. Asked for a rank
    /// and not for a tolerance, it takes landmarks for a good deal more than that.
    #[default]
    Projected,
}

/// Why a method has no answer.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MethodError {
    /// An entry is infinite or not a number.
    #[error("row {row}, column {col} is not finite; a matrix to be approximated must hold finite numbers")]
    NonFinite {
        /// Row.
        row: usize,
        /// Column.
        col: usize,
    },
    /// The intersection of the chosen rows and columns has no inverse.
    #[error("the chosen {size} rows and columns meet in a singular matrix; take another core than the plain inverse")]
    Singular {
        /// Rows of the intersection.
        size: usize,
    },
    /// An iteration did not end.
    #[error("the singular values did not settle in {n_sweeps} sweeps; scale the rows of the matrix to like magnitudes")]
    NoConvergence {
        /// Sweeps that were made.
        n_sweeps: usize,
    },
}

/// Approximates a matrix by one of at most the given rank (chosen rows, crosses, components: whatever the method counts).
///
/// A rank beyond the lesser side counts as that. The same seed gives the same approximation.
///
/// # Errors
/// Entries that are not finite; what else a method may stumble over, see [`MethodError`].
pub fn approximate<S: Real>(
    method: Method,
    matrix: &DMatrix<S>,
    rank: usize,
    seed: u64,
) -> Result<Approximation<S>, MethodError> {
    let exponent = exponent(matrix)?;
    let (n_rows, n_cols) = matrix.shape();
    let rank = rank.min(n_rows).min(n_cols);
    let Some(exponent) = exponent.filter(|_| rank > 0) else {
        return Ok(Approximation::product(DMatrix::zeros(n_rows, 0), DMatrix::zeros(0, n_cols)));
    };
    let matrix = &matrix.map(|x| scaled(x, -exponent));
    let rng = &mut Random::new([seed, 0]);
    let found = match method {
        Method::Alg1(core) => cross::cross(matrix, Selection::Alg1, core, rank, rng)?,
        Method::Alg2(core) => cross::cross(matrix, Selection::Alg2, core, rank, rng)?,
        Method::Alg3(core) => cross::cross(matrix, Selection::Alg3, core, rank, rng)?,
        Method::Alg4(core) => cross::cross(matrix, Selection::Alg4, core, rank, rng)?,
        Method::Alg4Union(core) => cross::cross(matrix, Selection::Alg4Union, core, rank, rng)?,
        Method::Kernel { gamma, rcond } => kernel::kernel(matrix, (gamma, S::nearest(rcond)), rank, rng)?,
        Method::Svd => svd::svd(matrix, rank)?,
        Method::RowId => interpolative::row_id(matrix, rank)?,
        Method::DeimCur => deim::deim_cur(matrix, rank)?,
        Method::AcaPartial => aca::partial(matrix, rank, rng),
        Method::AcaFull => aca::full(matrix, rank),
        Method::GeneralizedNystrom => generalized::generalized_nystrom(matrix, rank, rng)?,
        Method::CompressedSensing => sensing::compressed_sensing(matrix, rank, rng)?,
        Method::Projected => ours::projected(matrix, rank, seed),
    };
    Ok(found.times_power_of_two(exponent))
}

/// Exponent of the largest magnitude, `None` if all entries are zero.
fn exponent<S: Real>(matrix: &DMatrix<S>) -> Result<Option<i32>, MethodError> {
    let mut largest = S::zero();
    for (col, column) in matrix.column_iter().enumerate() {
        for (row, x) in column.iter().enumerate() {
            if !x.is_finite() {
                return Err(MethodError::NonFinite { row, col });
            }
            largest = largest.max(x.abs());
        }
    }
    Ok((largest > S::zero()).then(|| largest.to_f64().log2().floor() as i32))
}
