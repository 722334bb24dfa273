//! EXT_meshopt_compression and KHR_meshopt_compression: buffer views that are decoded before anything reads them.
//!
//! Written from the appendices of the two specifications. Every count is held against the length of the stream before
//! memory is asked for, and a stream must end exactly where its tail begins.

mod attributes;
mod filters;
mod indices;
#[cfg(test)]
mod tests;

use gltf::json::buffer::View;
use serde::Deserialize;

/// Names of the extensions; the bitstreams are the same but for a newer version, which both are read in.
pub(super) const NAMES: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// Most that one byte of a stream decodes to: a block of 256 elements of 4 bytes of which only a control byte is stored.
const MAX_RATIO: usize = 1024;

/// What the extension says of a buffer view.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Compressed {
    /// Buffer with the stream.
    pub buffer: usize,
    #[serde(default)]
    pub byte_offset: usize,
    pub byte_length: usize,
    /// Bytes of an element.
    pub byte_stride: usize,
    /// Elements.
    pub count: usize,
    mode: Mode,
    #[serde(default)]
    filter: Filter,
}

#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "UPPERCASE")]
enum Mode {
    Attributes,
    Triangles,
    Indices,
}

#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "UPPERCASE")]
enum Filter {
    #[default]
    None,
    Octahedral,
    Quaternion,
    Exponential,
    Color,
}

impl Compressed {
    /// What a view says, `None` for one that is not compressed.
    pub fn of(view: &View) -> Option<Result<Compressed, String>> {
        let extensions = view.extensions.as_ref()?;
        let value = NAMES.iter().find_map(|name| extensions.others.get(*name))?;
        Some(Compressed::deserialize(value).map_err(|error| error.to_string()).and_then(Compressed::checked))
    }

    fn checked(self) -> Result<Compressed, String> {
        let stride = self.byte_stride;
        let stride_fits = match self.mode {
            Mode::Attributes => (4..=256).contains(&stride) && stride.is_multiple_of(4),
            Mode::Triangles | Mode::Indices => matches!(stride, 2 | 4),
        };
        let filter_fits = match self.filter {
            Filter::None => true,
            _ if self.mode != Mode::Attributes => false,
            Filter::Octahedral | Filter::Color => matches!(stride, 4 | 8),
            Filter::Quaternion => stride == 8,
            Filter::Exponential => true,
        };
        if !stride_fits || !filter_fits {
            return Err(format!("elements of {stride} bytes do not go with its mode and filter"));
        }
        if self.mode == Mode::Triangles && !self.count.is_multiple_of(3) {
            return Err(format!("{} indices are not whole triangles", self.count));
        }
        let decoded = self.count.checked_mul(stride);
        let most = self.byte_length.saturating_mul(MAX_RATIO);
        decoded.filter(|&decoded| decoded <= most).map(|_| ()).ok_or_else(|| {
            format!("{} elements of {stride} bytes cannot be in {} bytes", self.count, self.byte_length)
        })?;
        Ok(self)
    }

    /// Bytes after decoding.
    #[expect(clippy::arithmetic_side_effects, reason = "`Compressed::checked` has multiplied them")]
    pub fn n_bytes(&self) -> usize {
        self.count * self.byte_stride
    }

    /// Decodes a stream of `byte_length` bytes.
    pub fn decode(&self, stream: &[u8]) -> Result<Vec<u8>, String> {
        match self.mode {
            Mode::Attributes => {
                let mut bytes = attributes::decode(stream, self.count, self.byte_stride)?;
                match self.filter {
                    Filter::None => {}
                    Filter::Octahedral => filters::octahedral(&mut bytes, self.byte_stride),
                    Filter::Quaternion => filters::quaternion(&mut bytes),
                    Filter::Exponential => filters::exponential(&mut bytes),
                    Filter::Color => filters::color(&mut bytes, self.byte_stride),
                }
                Ok(bytes)
            }
            Mode::Triangles => indices::triangles(stream, self.count, self.byte_stride),
            Mode::Indices => indices::sequence(stream, self.count, self.byte_stride),
        }
    }
}

/// A stream that ends is an error, whatever is read.
struct Stream<'a> {
    rest: &'a [u8],
}

impl<'a> Stream<'a> {
    fn take(&mut self, n: usize) -> Result<&'a [u8], String> {
        let (taken, rest) = self.rest.split_at_checked(n).ok_or("its stream ends too early")?;
        self.rest = rest;
        Ok(taken)
    }

    fn byte(&mut self) -> Result<u8, String> {
        Ok(self.take(1)?[0])
    }

    /// Seven bits a byte, the least significant first, at most five bytes.
    fn varint(&mut self) -> Result<u32, String> {
        let mut value = 0;
        for shift in [0, 7, 14, 21, 28] {
            let byte = self.byte()?;
            value |= u32::from(byte & 0x7F) << shift;
            if byte < 0x80 {
                return Ok(value);
            }
        }
        Err("its stream holds a number of more than five bytes".to_owned())
    }

    fn end(&self) -> Result<(), String> {
        match self.rest.len() {
            0 => Ok(()),
            n => Err(format!("its stream has {n} bytes too many")),
        }
    }
}

/// The signed number that a code with its sign in the lowest bit stands for.
fn unzigzag(code: u32) -> u32 {
    (code >> 1) ^ (code & 1).wrapping_neg()
}
