//! Packed matrices to bytes and back: little-endian, tables first, then block after block, each with a checksum.
//!
//! ```text
//! step f32, negative where blocks tell of zeros · length of the direction u32 · direction f32 · length of the tables u32 · tables · FNV-1a u64 over all that, then for each block length u32 · bytes · FNV-1a u32 over both
//! ```

use std::sync::Arc;

use super::{ColumnRun, PackedMatrix, block::N_TABLES, layout::Layout, tables::Tables};
use crate::{
    codec::{CodecError, checksum},
    partition::Partition,
};

/// Rows and columns of a matrix that no memory holds.
pub(super) const TOO_LARGE: CodecError = CodecError::Malformed("the size of a matrix");
const TABLES_CHECKSUM_LEN: usize = 8;
/// Length and checksum of a block.
const AROUND_LEN: usize = 8;

impl PackedMatrix {
    /// Appends the matrix.
    pub fn encode(&self, out: &mut Vec<u8>) {
        let start = out.len();
        let tables = self.tables.encode();
        let step = if self.tells_zeros { -self.step } else { self.step };
        out.extend(step.to_le_bytes());
        out.extend((self.direction.len() as u32).to_le_bytes());
        out.extend(self.direction.iter().flat_map(|x| x.to_le_bytes()));
        out.extend((tables.len() as u32).to_le_bytes());
        out.extend(tables);
        out.extend(checksum(&out[start..]).to_le_bytes());
        for block in &self.blocks {
            let start = out.len();
            out.extend((block.len() as u32).to_le_bytes());
            out.extend(&block[..]);
            out.extend(short_checksum(&out[start..]).to_le_bytes());
        }
    }

    /// Reads a matrix at the start of `bytes`, and says how many bytes it took. Every checksum is verified; nothing is
    /// allocated that is not there.
    ///
    /// # Errors
    /// Bytes that are cut off, damaged, or of no packer.
    pub fn decode(
        bytes: &[u8],
        partition: Partition,
        bundle_len: u32,
        columns: Vec<ColumnRun>,
    ) -> Result<(Self, usize), CodecError> {
        let mut reader = Reader { bytes, at: 0 };
        let [a, b, c, d] = reader.array()?;
        let step = f32::from_le_bytes([a, b, c, d]);
        let direction_len = reader.len()?;
        let direction = reader.take(direction_len.saturating_mul(size_of::<f32>()))?;
        let tables_len = reader.len()?;
        let tables = reader.take(tables_len)?;
        let sum = checksum(&bytes[..reader.at]);
        if reader.array::<TABLES_CHECKSUM_LEN>()? != sum.to_le_bytes() {
            return Err(CodecError::Checksum);
        }
        let tables = Tables::decode(tables, N_TABLES).ok_or(CodecError::Malformed("the tables of a matrix"))?;
        if !step.is_finite() {
            return Err(CodecError::Malformed("the step of a matrix"));
        }
        let direction: Vec<f32> = direction.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
        if !Layout::is_sound(&partition, bundle_len, &columns) {
            return Err(TOO_LARGE);
        }
        let layout = Layout::new(partition, bundle_len, columns);
        let fits = direction.is_empty() || direction.len() == layout.n_cols();
        if !fits || direction.iter().any(|x| !x.is_finite()) {
            return Err(CodecError::Malformed("the direction of a matrix"));
        }
        let n_blocks = layout.partition.n_blocks();
        if n_blocks.saturating_mul(AROUND_LEN) > bytes[reader.at..].len() {
            return Err(reader.truncated(n_blocks.saturating_mul(AROUND_LEN)));
        }
        let blocks = (0..n_blocks).map(|_| reader.block()).collect::<Result<_, _>>()?;
        let (step, tells_zeros) = (step.abs(), step.is_sign_negative());
        Ok((Self { layout, tables, step, direction, tells_zeros, blocks }, reader.at))
    }
}

struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    fn truncated(&self, missing: usize) -> CodecError {
        let needed = self.at.saturating_add(missing) as u64;
        CodecError::Truncated { needed, present: self.bytes.len() }
    }

    fn take(&mut self, len: usize) -> Result<&'a [u8], CodecError> {
        let end = self.at.checked_add(len).ok_or_else(|| self.truncated(len))?;
        let taken = self.bytes.get(self.at..end).ok_or_else(|| self.truncated(len))?;
        self.at = end;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], CodecError> {
        let taken = self.take(N)?;
        Ok(std::array::from_fn(|i| taken[i]))
    }

    fn len(&mut self) -> Result<usize, CodecError> {
        Ok(u32::from_le_bytes(self.array()?) as usize)
    }

    fn block(&mut self) -> Result<Arc<[u8]>, CodecError> {
        let start = self.at;
        let len = self.len()?;
        let block = self.take(len)?;
        let sum = short_checksum(&self.bytes[start..self.at]);
        if self.array()? == sum.to_le_bytes() { Ok(block.into()) } else { Err(CodecError::Checksum) }
    }
}

/// FNV-1a of 32 bits: a single changed byte never goes unseen.
fn short_checksum(bytes: &[u8]) -> u32 {
    bytes.iter().fold(0x811c_9dc5, |hash, &byte| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193))
}
