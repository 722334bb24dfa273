//! One block as bytes: counts and errors, the components' coefficients, the sparse entries.

use std::ops::Range;

use half::bf16;

use super::{
    coder::{Decoder, Sink},
    entries::{self, Entries},
    kept::{self, Kept, Plain},
    layout::Layout,
    planes::{self, Shape},
    quantize::{MAX_QUARTERS, Rounded, restore, step_of},
    zeros::ZeroBundles,
};
use crate::{
    factors::{BlockError, BlockFactors},
    matrix::SparseEntry,
};

/// Tables of numbers, after those of coefficients.
#[derive(Clone, Copy)]
enum Of {
    Samples,
    Rank,
    Step,
    Size,
    Kept,
}

const N_NUMBERS: usize = 5;
/// Tables of a matrix.
pub(super) const N_TABLES: usize = planes::N_TABLES + N_NUMBERS + entries::N_TABLES;
/// Kind of the planes of the kept product.
const KEPT: usize = 6;

#[expect(clippy::arithmetic_side_effects, reason = "constants")]
fn table(of: Of) -> usize {
    planes::N_TABLES + of as usize
}

fn entries_of(layout: &Layout) -> Entries {
    Entries { first_table: planes::N_TABLES + N_NUMBERS, bundle_len: layout.bundle_len }
}

/// A block, rounded; what is stored of it.
pub(super) struct RoundedBlock<'a> {
    /// Octaves of its step over that of the matrix, in quarters.
    pub(super) quarters: i32,
    pub(super) components: Vec<Rounded>,
    pub(super) kept: Option<Kept>,
    /// Which bundles are zero, if any are beside others; `None` in a matrix that does not tell.
    pub(super) zeros: Option<Option<ZeroBundles>>,
    pub(super) block_idx: usize,
    /// The block as it was: its sparse entries and counts are taken from it.
    pub(super) factors: &'a BlockFactors,
    /// Errors to be stored.
    pub(super) error: BlockError,
}

impl RoundedBlock<'_> {
    #[expect(clippy::arithmetic_side_effects, reason = "sizes are within the quarters that a component may have")]
    pub(super) fn write(&self, layout: &Layout, out: &mut impl Sink) {
        let block_idx = self.block_idx;
        out.number(table(Of::Samples), self.factors.n_samples);
        for error in [self.error.truncation, self.error.sampling, self.error.noise] {
            // A number beyond the greatest of `bf16` would be infinite, and what is no number would not be read again.
            let greatest = bf16::MAX.to_f32();
            let error = if error.is_nan() { greatest } else { error.clamp(-greatest, greatest) };
            out.bits(u32::from(bf16::from_f32(error).to_bits()), 16);
        }
        out.number(table(Of::Rank), self.components.len() as u32);
        if !self.components.is_empty() {
            out.signed(table(Of::Step), self.quarters);
        }
        let mut size = 0;
        for (i, component) in self.components.iter().enumerate() {
            out.signed(table(Of::Size), component.size - size);
            size = component.size;
            write_rows(&component.left, row_planes(block_idx, layout, usize::from(i > 0)), out);
            for (shape, range) in column_runs(layout, i) {
                shape.write(&component.right[range], None, out);
            }
        }
        out.bits(u32::from(self.kept.is_some()), 1);
        if let Some(kept) = &self.kept {
            out.signed(table(Of::Kept), kept.quarters);
            write_rows(&kept.planes, row_planes(block_idx, layout, KEPT), out);
        }
        if let Some(zeros) = &self.zeros {
            let [width, _] = layout.tile(block_idx);
            out.bits(u32::from(zeros.is_some()), 1);
            if let Some(zeros) = zeros {
                zeros.write(width as usize, out);
            }
        }
        entries_of(layout).write(&self.factors.sparse, out);
    }
}

fn write_rows(values: &[i32], planes: impl Iterator<Item = Place>, out: &mut impl Sink) {
    for (nth, (shape, range)) in planes.enumerate() {
        let first = (nth > 0).then(|| &values[..range.len()]);
        shape.write(&values[range], first, out);
    }
}

fn read_rows(planes: impl Iterator<Item = Place>, input: &mut Decoder<'_>) -> Vec<i32> {
    let mut values = Vec::new();
    for (nth, (shape, range)) in planes.enumerate() {
        let plane = shape.read((nth > 0).then(|| &values[..range.len()]), input);
        values.extend(plane);
    }
    values
}

/// A plane, and where its values lie.
type Place = (Shape, Range<usize>);

/// Planes of the row transform. What they belong to is 0 for the first component, 1 for the others, or [`KEPT`].
#[expect(clippy::arithmetic_side_effects, reason = "`Layout::is_sound` holds of everything that is read")]
fn row_planes(block_idx: usize, layout: &Layout, of: usize) -> impl Iterator<Item = Place> {
    let [width, height] = layout.tile(block_idx).map(|side| side as usize);
    let n = width * height;
    (0..layout.bundle_len as usize).map(move |nth| {
        let kind = of + if of == KEPT { usize::from(nth > 0) } else { 2 * usize::from(nth > 0) };
        (Shape { kind, width, height }, nth * n..(nth + 1) * n)
    })
}

/// Runs of columns.
#[expect(clippy::arithmetic_side_effects, reason = "`Layout::is_sound` holds of everything that is read")]
fn column_runs(layout: &Layout, component: usize) -> impl Iterator<Item = Place> {
    let mut first = 0;
    layout.columns.iter().map(move |run| {
        let [width, height] = run.size().map(|side| side as usize);
        let range = first..first + width * height;
        first = range.end;
        (Shape { kind: 4 + usize::from(component > 0), width, height }, range)
    })
}

/// The rank that a block says it has, with what is told before it; `None` where no honest block has them.
pub(super) fn read_rank(block_idx: usize, layout: &Layout, input: &mut Decoder<'_>) -> Option<(BlockFactors, u32)> {
    let mut factors = BlockFactors { n_samples: input.number(table(Of::Samples)), ..BlockFactors::default() };
    let [truncation, sampling, noise] = [(); 3].map(|()| bf16::from_bits(input.bits(16) as u16).to_f32());
    factors.error = BlockError { truncation, sampling, noise };
    let rank = input.number(table(Of::Rank));
    let most = layout.n_rows(block_idx).min(layout.n_cols());
    let is_honest = rank as usize <= most && factors.error.is_finite();
    (is_honest && !input.is_lost()).then_some((factors, rank))
}

/// A block as it was read.
pub(super) struct Parts {
    /// Counts and errors.
    about: BlockFactors,
    pub(super) components: Vec<Rounded>,
    /// Its factors, the kept product included.
    pub(super) plain: Plain,
    pub(super) sparse: Vec<SparseEntry>,
}

impl Parts {
    /// The factors; `None` where they are beyond the range of numbers.
    pub(super) fn factors(self, block_idx: usize, layout: &Layout) -> Option<BlockFactors> {
        let factors = self.plain.factors(block_idx, layout);
        let is_finite = factors.scale.iter().all(|x| x.is_finite())
            && factors.left.iter().chain(&factors.right).all(|x| x.is_finite());
        let (n_samples, error) = (self.about.n_samples, self.about.error);
        is_finite.then_some(BlockFactors { sparse: self.sparse, n_samples, error, ..factors })
    }
}

/// What all blocks of a matrix have in common, see [`PackedMatrix`](super::PackedMatrix).
#[derive(Clone, Copy)]
pub(super) struct Common<'a> {
    pub(super) step: f32,
    pub(super) direction: &'a [f32],
    pub(super) tells_zeros: bool,
}

/// Reads a block; `None` if no encoder wrote it.
pub(super) fn read(
    block_idx: usize,
    layout: &Layout,
    Common { step, direction, tells_zeros }: Common<'_>,
    input: &mut Decoder<'_>,
) -> Option<Parts> {
    let (about, rank) = read_rank(block_idx, layout, input)?;
    let within = |quarters: i32| (-MAX_QUARTERS..=MAX_QUARTERS).contains(&quarters).then_some(quarters);
    let quarters = if rank > 0 { within(input.signed(table(Of::Step)))? } else { 0 };
    let mut components = Vec::new();
    let mut size = 0i32;
    for i in 0..rank as usize {
        size = within(size.checked_add(input.signed(table(Of::Size)))?)?;
        let left = read_rows(row_planes(block_idx, layout, usize::from(i > 0)), input);
        let mut right = Vec::new();
        for (shape, _) in column_runs(layout, i) {
            right.extend(shape.read(None, input));
        }
        if input.is_lost() {
            return None;
        }
        components.push(Rounded { size, left, right });
    }
    let kept = if input.bits(1) == 1 {
        let quarters = input.signed(table(Of::Kept));
        let is_honest = (-kept::MAX_QUARTERS..=kept::MAX_QUARTERS).contains(&quarters) && !direction.is_empty();
        let planes = is_honest.then(|| read_rows(row_planes(block_idx, layout, KEPT), input))?;
        Some(Kept { quarters, planes })
    } else {
        None
    };
    let has_zeros = tells_zeros && input.bits(1) == 1;
    let zeros = if has_zeros { Some(ZeroBundles::read(layout.tile(block_idx), input)?) } else { None };
    let sparse = entries_of(layout).read(layout.n_rows(block_idx) as u32, layout.n_cols() as u32, input)?;
    if !input.is_clean() {
        return None;
    }
    let mut plain = restore(&components, step_of(step, quarters), block_idx, layout);
    if let Some(kept) = kept {
        kept.restore(&mut plain, direction, block_idx, layout);
    }
    if let Some(zeros) = zeros {
        zeros.clear(&mut plain);
    }
    Some(Parts { about, components, plain, sparse })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        packed::{ColumnRun, coder::Encoder, tables::Tables},
        partition::Partition,
    };

    #[test]
    fn errors_that_are_no_numbers_are_of_no_encoder() {
        let layout = Layout::new(Partition { width: 2, height: 2, tile: 2 }, 1, vec![ColumnRun::List(1)]);
        let tables = Tables::from_counts(&[[1; 16]; N_TABLES]);
        let is_read = |errors: [f32; 3]| {
            let mut out = Encoder::new(&tables);
            out.number(table(Of::Samples), 64);
            errors.into_iter().for_each(|error| out.bits(u32::from(bf16::from_f32(error).to_bits()), 16));
            out.number(table(Of::Rank), 0);
            let bytes = out.finish();
            read_rank(0, &layout, &mut Decoder::new(&tables, &bytes)).is_some()
        };
        assert!(is_read([-1e-9, 0.5, 2.0]), "what is left out may seem less than nothing");
        for error in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for nth in 0..3 {
                let mut errors = [0.5; 3];
                errors[nth] = error;
                assert!(!is_read(errors), "{errors:?}");
            }
        }
    }
}
