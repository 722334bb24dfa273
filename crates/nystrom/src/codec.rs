//! Factors to bytes and back: little-endian, with a version in front and a checksum behind.
//!
//! ```text
//! magic "CNBF" · version u16 · parts u16: 1 noise of the left factor, 2 errors of columns · rows, columns, rank, sparse entries, samples u32 · truncation, sampling, noise f32 ·
//! scale f32 × rank · left f16 × rows·rank · right f16 × rank·columns · noise of left f16 × rows·rank, if it is there ·
//! errors of columns f32 × columns, if they are there · (row u32, column u32, value f32) × sparse · FNV-1a u64
//! ```
//! Bytes are not trusted: sizes are held against the bytes that are there before anything is allocated.

// What is read here was written by strangers, so no integer may wrap in silence.
#![cfg_attr(not(test), deny(clippy::arithmetic_side_effects))]

use std::ops::RangeInclusive;

use half::f16;

use crate::{
    factors::{BlockError, BlockFactors},
    matrix::SparseEntry,
};

const MAGIC: [u8; 4] = *b"CNBF";
const VERSION: u16 = 3;
/// Versions that are read: the first had no noise of the left factor, the second no errors of columns.
const READABLE: RangeInclusive<u16> = 1..=VERSION;
/// Magic, version, five counts, three errors.
const HEADER_LEN: usize = 8 + 5 * 4 + 3 * 4;
const CHECKSUM_LEN: usize = 8;
/// Parts that a block may have or lack.
const DOUBT: u16 = 1;
const COLUMN_ERRORS: u16 = 2;
/// Bytes of the smallest block: rank 0 without a sparse part.
pub const MIN_BLOCK_BYTES: usize = HEADER_LEN + CHECKSUM_LEN;
/// Rows or columns that a block may have.
const MAX_SIDE: u32 = 1 << 24;

/// Why bytes are no factors.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CodecError {
    /// The bytes end too early.
    #[error("a block ends after {present} of {needed} bytes; the file was cut off")]
    Truncated {
        /// Bytes that a block of this size takes, as far as is known.
        needed: u64,
        /// Bytes that are there.
        present: usize,
    },
    /// The bytes do not begin like a block.
    #[error("these bytes are no block of factors")]
    Magic,
    /// A version that is not known.
    #[error("blocks of version {0} are not known; a newer program wrote them")]
    Version(u16),
    /// The checksum does not fit the bytes.
    #[error("a block is damaged: its checksum does not fit")]
    Checksum,
    /// The checksum fits, the content does not.
    #[error("a block is malformed: {0}")]
    Malformed(&'static str),
}

/// Appends a block.
pub fn encode_block(block: &BlockFactors, out: &mut Vec<u8>) {
    let start = out.len();
    out.extend(MAGIC);
    out.extend(VERSION.to_le_bytes());
    let part = |is_there: bool, bit: u16| if is_there { bit } else { 0 };
    let parts = part(!block.doubt.is_empty(), DOUBT) | part(!block.column_errors.is_empty(), COLUMN_ERRORS);
    out.extend(parts.to_le_bytes());
    for count in [block.n_rows, block.n_cols, block.rank, block.sparse.len() as u32, block.n_samples] {
        out.extend(count.to_le_bytes());
    }
    for error in [block.error.truncation, block.error.sampling, block.error.noise] {
        out.extend(error.to_le_bytes());
    }
    out.extend(block.scale.iter().flat_map(|x| x.to_le_bytes()));
    out.extend(block.left.iter().flat_map(|x| x.to_le_bytes()));
    out.extend(block.right.iter().flat_map(|x| x.to_le_bytes()));
    out.extend(block.doubt.iter().flat_map(|x| x.to_le_bytes()));
    out.extend(block.column_errors.iter().flat_map(|x| x.to_le_bytes()));
    for entry in &block.sparse {
        out.extend(entry.row.to_le_bytes());
        out.extend(entry.col.to_le_bytes());
        out.extend(entry.value.to_le_bytes());
    }
    out.extend(checksum(&out[start..]).to_le_bytes());
}

/// Reads the block at the start of `bytes`, and says how many bytes it took.
///
/// # Errors
/// Bytes that are cut off, damaged, of another version, or that no encoder writes.
pub fn decode_block(bytes: &[u8]) -> Result<(BlockFactors, usize), CodecError> {
    let present = bytes.len();
    let truncated = |needed: u64| CodecError::Truncated { needed, present };
    let header = bytes.get(..HEADER_LEN).ok_or(truncated((HEADER_LEN + CHECKSUM_LEN) as u64))?;
    if header[..4] != MAGIC {
        return Err(CodecError::Magic);
    }
    let version = u16::from_le_bytes([header[4], header[5]]);
    if !READABLE.contains(&version) {
        return Err(CodecError::Version(version));
    }
    let parts = u16::from_le_bytes([header[6], header[7]]);
    let known = [0, DOUBT, DOUBT | COLUMN_ERRORS][usize::from(version).saturating_sub(1)];
    if parts & !known != 0 {
        return Err(CodecError::Malformed("unknown parts"));
    }
    let has = |part: u16| u32::from(parts & part != 0);
    let (n_doubts, n_errors) = (has(DOUBT), has(COLUMN_ERRORS));
    let mut reader = Reader(&bytes[8..]);
    let [n_rows, n_cols, rank, n_sparse, n_samples] = [(); 5].map(|()| u32::from_le_bytes(reader.take()));
    if n_rows > MAX_SIDE || n_cols > MAX_SIDE || rank > MAX_SIDE {
        return Err(CodecError::Malformed("too many rows or columns"));
    }
    let (m, n, k) = (u64::from(n_rows), u64::from(n_cols), u64::from(rank));
    #[expect(clippy::arithmetic_side_effects, reason = "sides are at most 2^24, so that the sum is below 2^52")]
    let len = {
        let of_factors = 4 * k + 2 * k * ((1 + u64::from(n_doubts)) * m + n) + 4 * u64::from(n_errors) * n;
        HEADER_LEN as u64 + of_factors + 12 * u64::from(n_sparse) + CHECKSUM_LEN as u64
    };
    if len > present as u64 {
        return Err(truncated(len));
    }
    let len = len as usize;
    let Some((content, sum)) = bytes[..len].split_last_chunk::<CHECKSUM_LEN>() else {
        return Err(truncated(len as u64));
    };
    if checksum(content).to_le_bytes() != *sum {
        return Err(CodecError::Checksum);
    }
    let [truncation, sampling, noise] = [(); 3].map(|()| f32::from_le_bytes(reader.take()));
    let (m, n, k) = (n_rows as usize, n_cols as usize, rank as usize);
    #[expect(clippy::arithmetic_side_effects, reason = "so many bytes are there")]
    let (n_left, n_right, n_doubt, n_errors) = (m * k, k * n, n_doubts as usize * m * k, n_errors as usize * n);
    let block = BlockFactors {
        n_rows,
        n_cols,
        rank,
        scale: (0..k).map(|_| f32::from_le_bytes(reader.take())).collect(),
        left: (0..n_left).map(|_| f16::from_le_bytes(reader.take())).collect(),
        right: (0..n_right).map(|_| f16::from_le_bytes(reader.take())).collect(),
        doubt: (0..n_doubt).map(|_| f16::from_le_bytes(reader.take())).collect(),
        column_errors: (0..n_errors).map(|_| f32::from_le_bytes(reader.take())).collect(),
        sparse: (0..n_sparse).map(|_| reader.sparse_entry()).collect(),
        n_samples,
        error: BlockError { truncation, sampling, noise },
    };
    check(&block)?;
    Ok((block, len))
}

/// What every block fulfills that an encoder was given.
fn check(block: &BlockFactors) -> Result<(), CodecError> {
    let finite = block.scale.iter().chain(&block.column_errors).all(|x| x.is_finite())
        && block.left.iter().chain(&block.right).chain(&block.doubt).all(|x| x.is_finite())
        && block.sparse.iter().all(|entry| entry.value.is_finite())
        && block.error.is_finite();
    if !finite {
        return Err(CodecError::Malformed("a value is not finite"));
    }
    if block.sparse.iter().any(|entry| entry.row >= block.n_rows || entry.col >= block.n_cols) {
        return Err(CodecError::Malformed("a sparse entry is outside of its block"));
    }
    if !block.sparse.is_sorted_by(|x, y| (x.row, x.col) < (y.row, y.col)) {
        return Err(CodecError::Malformed("sparse entries are not in order"));
    }
    Ok(())
}

/// Bytes whose number was checked before.
struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> [u8; N] {
        let (first, rest) = self.0.split_first_chunk().expect("the length was checked");
        self.0 = rest;
        *first
    }

    fn sparse_entry(&mut self) -> SparseEntry {
        let (row, col) = (u32::from_le_bytes(self.take()), u32::from_le_bytes(self.take()));
        SparseEntry { row, col, value: f32::from_le_bytes(self.take()) }
    }
}

/// FNV-1a of 64 bits: each step is one to one, so a single changed byte never goes unseen.
pub fn checksum(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    fn example(rng: &mut Random, n_rows: usize, n_cols: usize, rank: usize) -> BlockFactors {
        let mut values = |n: usize| (0..n).map(|_| rng.normal()).collect::<Vec<_>>();
        let (left, right) = (values(n_rows * rank), values(rank * n_cols));
        let mut block = BlockFactors::from_f32(&left, &right, n_rows, n_cols, rank);
        block.sparse = vec![SparseEntry { row: 0, col: 1, value: 7.5 }, SparseEntry { row: 2, col: 0, value: -1.0 }];
        block.n_samples = 32;
        block.error = BlockError { truncation: -1e-9, sampling: 0.5, noise: 2.0 };
        block
    }

    #[test]
    fn decoding_gives_back_what_was_encoded() {
        let mut rng = Random::new([21, 0]);
        let mut bytes = Vec::new();
        let mut blocks = vec![example(&mut rng, 12, 9, 3), example(&mut rng, 3, 2, 0), BlockFactors::default()];
        blocks[1].sparse.clear();
        let with_parts =
            BlockFactors { column_errors: vec![0.25; 9], doubt: blocks[0].left.clone(), ..blocks[0].clone() };
        blocks.extend([BlockFactors { doubt: Vec::new(), ..with_parts.clone() }, with_parts]);
        blocks.iter().for_each(|block| encode_block(block, &mut bytes));
        let mut rest = bytes.as_slice();
        for block in blocks {
            let (decoded, len) = decode_block(rest).unwrap();
            assert_eq!(decoded, block);
            rest = &rest[len..];
        }
        assert!(rest.is_empty());
    }

    #[test]
    fn damaged_and_cut_off_bytes_are_errors() {
        let mut bytes = Vec::new();
        encode_block(&example(&mut Random::new([22, 0]), 6, 5, 2), &mut bytes);
        for i in 0..bytes.len() {
            assert!(decode_block(&bytes[..i]).is_err(), "cut off at {i}");
            // The two bytes after the version are the checksum's alone, as all others are.
            for bit in 0..8 {
                let mut damaged = bytes.clone();
                damaged[i] ^= 1 << bit;
                assert!(decode_block(&damaged).is_err(), "bit {bit} of byte {i}");
            }
        }
    }

    /// Changes some bytes and makes the checksum fit again.
    fn forged(bytes: &[u8], at: usize, with: &[u8]) -> Vec<u8> {
        let mut forged = bytes[..bytes.len() - CHECKSUM_LEN].to_vec();
        forged[at..at + with.len()].copy_from_slice(with);
        forged.extend(checksum(&forged).to_le_bytes());
        forged
    }

    #[test]
    fn hostile_bytes_are_errors_without_great_allocations() {
        let mut bytes = Vec::new();
        encode_block(&example(&mut Random::new([23, 0]), 6, 5, 2), &mut bytes);
        assert!(decode_block(&forged(&bytes, 8, &6u32.to_le_bytes())).is_ok());
        for (count, value) in [(0, u32::MAX), (0, MAX_SIDE), (1, u32::MAX), (2, u32::MAX), (2, MAX_SIDE), (3, u32::MAX)]
        {
            assert!(decode_block(&forged(&bytes, 8 + 4 * count, &u32::to_le_bytes(value))).is_err(), "{count} {value}");
        }
        let sparse = bytes.len() - CHECKSUM_LEN - 24;
        let malformed =
            |at, with: &[u8]| matches!(decode_block(&forged(&bytes, at, with)), Err(CodecError::Malformed(_)));
        assert!(malformed(sparse, &6u32.to_le_bytes()), "row out of range");
        assert!(malformed(sparse, &5u32.to_le_bytes()), "rows out of order");
        assert!(malformed(sparse + 8, &f32::NAN.to_le_bytes()), "sparse value");
        assert!(malformed(HEADER_LEN, &f32::INFINITY.to_le_bytes()), "scale");
        for (at, what) in [(HEADER_LEN - 12, "truncation"), (HEADER_LEN - 8, "sampling"), (HEADER_LEN - 4, "noise")] {
            for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
                assert!(malformed(at, &value.to_le_bytes()), "{what} of {value}");
            }
        }
        assert!(malformed(HEADER_LEN + 8, &f16::NAN.to_le_bytes()), "left");
        assert!(matches!(decode_block(&forged(&bytes, 4, &[9, 0])), Err(CodecError::Version(9))));
        assert!(malformed(4, &[2, 0, 2, 0]) && malformed(4, &[1, 0, 1, 0]), "parts that came later");
        assert!(decode_block(&forged(&bytes, 4, &[2, 0])).is_ok(), "an older version without them");
        let mut rng = Random::new([24, 0]);
        for _ in 0..2000 {
            let noise: Vec<u8> = (0..rng.below(100)).map(|_| rng.bits() as u8).collect();
            let mut bytes = [MAGIC.as_slice(), &VERSION.to_le_bytes(), &noise].concat();
            assert!(decode_block(&noise).is_err() && decode_block(&bytes).is_err());
            bytes.truncate(rng.below(bytes.len()));
            assert!(decode_block(&bytes).is_err());
        }
    }
}
