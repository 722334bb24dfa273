//! How finely a block is stored: one step for all coefficients of both factors, each component scaled to its worth.
//!
//! Rounding the coefficients of `left` (which carry the singular value) to multiples of a step Δ adds Δ²/12 each to the
//! squared error of the block, and so does rounding those of the unit vector `right` to multiples of Δ/σ. One step for
//! everything, in all blocks, is what the least bytes for a mean error ask for (reverse water-filling); a component whose
//! energy is not worth its multiplications is left out.

use super::{kept::Plain, layout::Layout, orthogonal::Orthogonal};
use crate::{cosine::Direction, factors::BlockFactors};

/// A component is left out where its energy, more at borders than within, is less than so many times the error of rounding
/// all its coefficients. The fewest bytes are at 0.6; here they are a fifth more, and the rank, which every product pays
/// for, a fourth less.
const LEAST_WORTH: f64 = 8.0;
/// Rounding towards zero: coefficients up to half a step and this share of it become 0, and so on. It saves more bytes
/// than it costs error.
const DEAD_ZONE: f32 = 0.1;
/// Steps between two powers of two.
const PER_OCTAVE: f64 = 4.0;
/// Octaves in quarters that steps and sizes are within.
pub(super) const MAX_QUARTERS: i32 = 400;

/// A block, weighted row by row as it is stored, in coefficients of the cosine transforms, not yet rounded.
pub(super) struct Coefficients {
    /// One per component, the most worth first.
    components: Vec<Component>,
    /// Entries of the block.
    n_entries: f64,
    /// Rows and columns together.
    n_values: f64,
}

struct Component {
    /// Singular value, borders counting as they do in the choice.
    worth: f64,
    /// Norm of `left`.
    norm: f64,
    left: Vec<f32>,
    right: Vec<f32>,
}

/// A component, rounded.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Rounded {
    /// Octaves of the norm of the left vector over the step, in quarters.
    pub(super) size: i32,
    /// Planes of the row transform.
    pub(super) left: Vec<i32>,
    /// Runs of the column transform.
    pub(super) right: Vec<i32>,
}

/// Step of the unit vector `right` of a component of some size.
pub(super) fn step_of_right(size: i32) -> f32 {
    (1.0 / octaves(size)) as f32
}

/// 2^(quarters / 4).
pub(super) fn octaves(quarters: i32) -> f64 {
    (f64::from(quarters) / PER_OCTAVE).exp2()
}

/// What [`octaves`] gives back, before it is rounded.
pub(super) fn quarters_of(octaves: f64) -> f64 {
    octaves.log2() * PER_OCTAVE
}

/// A number of quarters that can be stored.
fn stored(quarters: f64) -> i32 {
    quarters.clamp(f64::from(-MAX_QUARTERS), f64::from(MAX_QUARTERS)) as i32
}

/// The step of a block from that of the matrix.
pub(super) fn step_of(step: f32, quarters: i32) -> f32 {
    (f64::from(step) * octaves(quarters)) as f32
}

/// Quarters of an octave from one step down to another.
pub(super) fn quarters_between(step: f32, other: f64) -> i32 {
    let quarters = quarters_of(other / f64::from(step)).floor();
    if quarters.is_finite() { stored(quarters) } else { 0 }
}

impl Coefficients {
    /// `border_weight` is that of [`border_weight`](super::layout::border_weight).
    pub(super) fn new(factors: &BlockFactors, block_idx: usize, layout: &Layout, border_weight: f32) -> Self {
        let (chosen, stored) = (layout.choice_weights(block_idx, border_weight), layout.row_weights(block_idx));
        let orthogonal = Orthogonal::new(factors, &chosen);
        let component = |(i, &worth): (usize, &f64)| {
            let mut right = orthogonal.right.row(i).to_vec();
            layout.columns(&mut right, Direction::Forward);
            let rows = orthogonal.left.row(i).iter().zip(stored.iter().zip(&chosen));
            let left: Vec<f32> = rows.map(|(x, (stored, chosen))| x * stored / chosen).collect();
            let norm = left.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>().sqrt();
            let left = layout.rows_forward(&left, block_idx);
            Component { worth, norm, left, right }
        };
        Self {
            components: orthogonal.singular.iter().enumerate().map(component).collect(),
            n_entries: f64::from(factors.n_rows) * f64::from(factors.n_cols),
            n_values: f64::from(factors.n_rows) + f64::from(factors.n_cols),
        }
    }

    pub(super) fn n_entries(&self) -> f64 {
        self.n_entries
    }

    /// Mean square of the entries, each weighted as its row.
    pub(super) fn mean_square(&self) -> f64 {
        let energy: f64 = self.components.iter().map(|component| component.norm.powi(2)).sum();
        energy / self.n_entries.max(1.0)
    }

    /// The step at which all components together would have some mean square error per entry, were no coefficient 0.
    pub(super) fn step_for(&self, mean_square: f64) -> f64 {
        (12.0 * mean_square * self.n_entries / (self.components.len() as f64 * self.n_values)).sqrt()
    }

    /// Rounds for a step; components that are not worth it are left out.
    pub(super) fn round(&self, step: f32) -> Vec<Rounded> {
        self.kept(step).map(|component| component.round(step)).collect()
    }

    /// Weighted mean square error per entry for a step, as if components were orthogonal in that weight: near the plain one.
    pub(super) fn error(&self, step: f32) -> f64 {
        let change = |component: &Component| component.error(step) - component.norm.powi(2);
        (self.mean_square() + self.kept(step).map(change).sum::<f64>() / self.n_entries.max(1.0)).max(0.0)
    }

    fn kept(&self, step: f32) -> impl Iterator<Item = &Component> {
        let least = LEAST_WORTH * f64::from(step).powi(2) / 12.0 * self.n_values;
        self.components.iter().filter(move |component| component.worth.powi(2) > least)
    }
}

impl Component {
    fn size(&self, step: f32) -> i32 {
        stored(quarters_of(self.norm / f64::from(step)).round())
    }

    fn round(&self, step: f32) -> Rounded {
        let size = self.size(step);
        let rounded = |values: &[f32], step: f32| values.iter().map(|x| round_toward_zero(x / step)).collect();
        Rounded { size, left: rounded(&self.left, step), right: rounded(&self.right, step_of_right(size)) }
    }

    fn error(&self, step: f32) -> f64 {
        let of_right = squared_rounding(&self.right, step_of_right(self.size(step)));
        squared_rounding(&self.left, step) + self.norm.powi(2) * of_right
    }
}

/// Squared error of rounding, in eight partial sums.
fn squared_rounding(values: &[f32], step: f32) -> f64 {
    let error = |x: f32| f64::from(x.abs() - round_toward_zero(x.abs() / step) as f32 * step);
    let (eights, rest) = values.as_chunks::<8>();
    let mut sums = [0.0; 8];
    for eight in eights {
        for lane in 0..8 {
            sums[lane] += error(eight[lane]).powi(2);
        }
    }
    sums.iter().sum::<f64>() + rest.iter().map(|&x| error(x).powi(2)).sum::<f64>()
}

/// The nearest whole number, or the one nearer to zero in its dead zone.
#[expect(clippy::arithmetic_side_effects, reason = "a magnitude is not negative")]
pub(super) fn round_toward_zero(x: f32) -> i32 {
    // The cast cuts off, and so does what is too large for it.
    let magnitude = (x.abs() + 0.5 - DEAD_ZONE) as i32;
    if x < 0.0 { -magnitude } else { magnitude }
}

/// Factors from what was rounded.
#[expect(
    clippy::arithmetic_side_effects,
    reason = "`Layout::is_sound` holds of everything that is read, and ranks are at most as large"
)]
pub(super) fn restore(components: &[Rounded], step: f32, block_idx: usize, layout: &Layout) -> Plain {
    let (m, n, k) = (layout.n_rows(block_idx), layout.n_cols(), components.len());
    let (mut left, mut right) = (vec![0.0; m * k], Vec::with_capacity(k * n));
    let weights = layout.row_weights(block_idx);
    for (i, component) in components.iter().enumerate() {
        let of_right = step_of_right(component.size);
        let planes = component.left.iter().map(|&q| q as f32 * step).collect();
        for (row, x) in layout.rows_inverse(planes, block_idx).into_iter().enumerate() {
            left[row * k + i] = x / weights[row];
        }
        let first = right.len();
        right.extend(component.right.iter().map(|&q| q as f32 * of_right));
        layout.columns(&mut right[first..], Direction::Inverse);
    }
    Plain { left, right, rank: k }
}
