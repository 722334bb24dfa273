//! Sparse entries: bundle by bundle and column by column, as differences to what came before. Members of a bundle often
//! have the same columns and almost the same values. Values are kept to a share of themselves.

use super::coder::{Decoder, Sink};
use crate::matrix::SparseEntry;

/// Tables, counted from the first one of this module.
#[derive(Clone, Copy)]
enum Of {
    Bundle,
    ColumnStep,
    FirstColumn,
    Members,
    Value,
    NextValue,
}

/// Tables of sparse entries.
pub(super) const N_TABLES: usize = 6;

/// Values between one power of two and the next: they are kept to one part in 740 at worst.
const PER_OCTAVE: f64 = 256.0;
/// The next one is 2^128, which no `f32` is.
const MAX_LEVEL: i32 = 128 * 256 - 1;
/// Lengths of a bundle whose members share their columns; members of longer bundles stand for themselves.
const MAX_MEMBERS: u32 = 8;

/// Writes and reads entries; `first_table` is the first one of this module.
#[derive(Clone, Copy)]
pub(super) struct Entries {
    pub first_table: usize,
    pub bundle_len: u32,
}

/// All entries of a column in a bundle.
struct Place {
    bundle: u32,
    col: u32,
    /// Bit by member.
    members: u32,
    values: Vec<f32>,
}

impl Entries {
    /// Rows that share their columns.
    fn n_members(self) -> u32 {
        if self.bundle_len <= MAX_MEMBERS { self.bundle_len } else { 1 }
    }

    /// All members of a bundle, bit by bit.
    #[expect(clippy::arithmetic_side_effects, reason = "a bundle has at most `MAX_MEMBERS` members")]
    fn all_members(self) -> u32 {
        (1 << self.n_members()) - 1
    }

    #[expect(clippy::arithmetic_side_effects, reason = "bundles have members")]
    fn places(self, entries: &[SparseEntry]) -> Vec<Place> {
        let n_members = self.n_members();
        let mut sorted: Vec<&SparseEntry> = entries.iter().filter(|entry| entry.value != 0.0).collect();
        sorted.sort_by_key(|entry| (entry.row / n_members, entry.col, entry.row));
        let mut places: Vec<Place> = Vec::new();
        for entry in sorted {
            let (bundle, member) = (entry.row / n_members, 1 << (entry.row % n_members));
            match places.last_mut() {
                Some(place) if (place.bundle, place.col) == (bundle, entry.col) => {
                    place.members |= member;
                    place.values.push(entry.value);
                }
                _ => places.push(Place { bundle, col: entry.col, members: member, values: vec![entry.value] }),
            }
        }
        places
    }

    #[expect(clippy::arithmetic_side_effects, reason = "constants")]
    fn table(self, of: Of) -> usize {
        self.first_table + of as usize
    }

    /// Entries that are 0 are left out.
    #[expect(
        clippy::arithmetic_side_effects,
        reason = "places are sorted, columns fit the block, levels are within 150 octaves"
    )]
    pub(super) fn write(self, entries: &[SparseEntry], out: &mut impl Sink) {
        let places = self.places(entries);
        out.number(self.table(Of::Bundle), places.len() as u32);
        let (mut bundle, mut col, mut first_col, mut before) = (0, 0, 0, 0);
        for (i, place) in places.iter().enumerate() {
            out.number(self.table(Of::Bundle), place.bundle - bundle);
            if i == 0 || place.bundle != bundle {
                out.signed(self.table(Of::FirstColumn), place.col as i32 - first_col);
                first_col = place.col as i32;
            } else {
                out.number(self.table(Of::ColumnStep), place.col - col - 1);
            }
            (bundle, col) = (place.bundle, place.col);
            out.number(self.table(Of::Members), place.members ^ self.all_members());
            let mut of = Of::Value;
            for value in &place.values {
                let level = level_of(*value);
                out.signed(self.table(of), level - before);
                out.bits(u32::from(*value < 0.0), 1);
                (before, of) = (level, Of::NextValue);
            }
            before = level_of(place.values[0]);
        }
    }

    /// Entries in order of row and column; `None` if they are not of a block of this size.
    pub(super) fn read(self, n_rows: u32, n_cols: u32, input: &mut Decoder<'_>) -> Option<Vec<SparseEntry>> {
        let n_members = self.n_members();
        let n_places = input.number(self.table(Of::Bundle));
        let mut entries = Vec::new();
        let (mut bundle, mut col, mut first_col, mut before) = (0u32, 0u32, 0i32, 0i32);
        for i in 0..n_places {
            let step = input.number(self.table(Of::Bundle));
            bundle = bundle.checked_add(step)?;
            if i == 0 || step > 0 {
                first_col = first_col.checked_add(input.signed(self.table(Of::FirstColumn)))?;
                col = u32::try_from(first_col).ok()?;
            } else {
                col = col.checked_add(input.number(self.table(Of::ColumnStep)))?.checked_add(1)?;
            }
            let members = input.number(self.table(Of::Members)) ^ self.all_members();
            if members == 0 || members >> n_members != 0 || col >= n_cols || input.is_lost() {
                return None;
            }
            let (mut of, mut first) = (Of::Value, None);
            for member in (0..n_members).filter(|member| members >> member & 1 == 1) {
                before = before.checked_add(input.signed(self.table(of)))?;
                let row = bundle.checked_mul(n_members)?.checked_add(member).filter(|&row| row < n_rows)?;
                let sign = if input.bits(1) == 1 { -1.0 } else { 1.0 };
                let value = sign * value_of(before)?;
                entries.push(SparseEntry { row, col, value });
                first.get_or_insert(before);
                of = Of::NextValue;
            }
            before = first?;
        }
        entries.sort_by_key(|entry| (entry.row, entry.col));
        Some(entries)
    }
}

/// The level nearest to a magnitude that is not 0, of those whose magnitude is within the range of `f32`.
fn level_of(value: f32) -> i32 {
    ((f64::from(value.abs()).log2() * PER_OCTAVE).round() as i32).min(MAX_LEVEL)
}

/// The magnitude of a level; `None` beyond the range of `f32`.
fn value_of(level: i32) -> Option<f32> {
    let value = (f64::from(level) / PER_OCTAVE).exp2() as f32;
    (value.is_finite() && value > 0.0).then_some(value)
}

#[cfg(test)]
mod tests {
    use super::super::{
        coder::{Counter, Encoder},
        tables::Tables,
    };
    use super::*;
    use crate::random::Random;

    fn there_and_back(entries: &[SparseEntry], bundle_len: u32, n_rows: u32, n_cols: u32) -> Vec<SparseEntry> {
        let coder = Entries { first_table: 1, bundle_len };
        let mut counter = Counter { counts: vec![[0; 16]; 1 + N_TABLES] };
        coder.write(entries, &mut counter);
        let tables = Tables::from_counts(&counter.counts);
        let mut encoder = Encoder::new(&tables);
        coder.write(entries, &mut encoder);
        let bytes = encoder.finish();
        let mut decoder = Decoder::new(&tables, &bytes);
        let read = coder.read(n_rows, n_cols, &mut decoder).unwrap();
        assert!(decoder.is_clean());
        read
    }

    #[test]
    fn entries_come_back_to_a_share_of_themselves() {
        let mut rng = Random::new([9, 9]);
        for bundle_len in [1, 3, 40] {
            let mut entries = Vec::new();
            for at in (0..120 * 50 - 1).filter(|at| at % 17 < 2) {
                let value = rng.normal() * 10f32.powi(rng.below(60) as i32 - 30);
                entries.push(SparseEntry { row: at / 50, col: at % 50, value });
            }
            entries.push(SparseEntry { row: 119, col: 49, value: f32::MIN_POSITIVE });
            let read = there_and_back(&entries, bundle_len, 120, 50);
            assert_eq!(read.len(), entries.len());
            for (read, entry) in read.iter().zip(&entries) {
                assert_eq!((read.row, read.col), (entry.row, entry.col));
                assert!((read.value / entry.value - 1.0).abs() < 1.0 / 730.0, "{} {}", read.value, entry.value);
            }
        }
        assert!(there_and_back(&[], 3, 6, 1).is_empty());
    }

    #[test]
    fn what_came_back_stays_when_it_is_written_again() {
        let entries = [1.0, 0.37, -2e9, 1e-30, f32::MAX, f32::MIN, f32::from_bits(1)].map(|value| SparseEntry {
            row: 2,
            col: 0,
            value,
        });
        for entry in entries {
            let once = there_and_back(&[entry], 3, 6, 1);
            assert_eq!(there_and_back(&once, 3, 6, 1), once);
            assert!((once[0].value / entry.value - 1.0).abs() < 1.0 / 300.0, "{} {}", once[0].value, entry.value);
        }
    }
}
