//! GLB chunks, buffers and buffer views: from a file to slices of bytes whose bounds hold.

use std::borrow::Cow;

use super::ImportError;
use super::document::{BufferView, Document};
use super::report::Notes;
use super::uri::Locator;

const GLB_MAGIC: &[u8; 4] = b"glTF";
const CHUNK_JSON: u32 = 0x4E4F_534A;
const CHUNK_BIN: u32 = 0x004E_4942;

/// JSON text and, for a GLB, its binary chunk.
#[derive(Debug)]
pub(super) struct Container<'a> {
    pub json: &'a [u8],
    pub bin: Option<&'a [u8]>,
}

/// Splits a file into its chunks; a JSON glTF is one chunk.
pub(super) fn split<'a>(name: &str, bytes: &'a [u8]) -> Result<Container<'a>, ImportError> {
    if !bytes.starts_with(GLB_MAGIC) {
        return Ok(Container { json: bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes), bin: None });
    }
    let broken = |reason: &str| ImportError::Container { name: name.to_owned(), reason: reason.to_owned() };
    let version = u32_at(bytes, 4).ok_or_else(|| broken("it ends within its header"))?;
    if version != 2 {
        return Err(ImportError::Version { name: name.to_owned(), version: version.to_string() });
    }
    let (kind, json, rest) = chunk_at(bytes, 12).ok_or_else(|| broken("it ends before its first chunk"))?;
    let whole = u32_at(bytes, 12).is_some_and(|length| length as usize == json.len());
    if kind != CHUNK_JSON || !whole {
        return Err(broken("its first chunk is not a whole JSON chunk"));
    }
    let bin = chunk_at(bytes, rest).filter(|&(kind, ..)| kind == CHUNK_BIN).map(|(_, bin, _)| bin);
    Ok(Container { json, bin })
}

/// Kind, payload (cut at the end of the file) and the offset of the next chunk.
fn chunk_at(bytes: &[u8], offset: usize) -> Option<(u32, &[u8], usize)> {
    let length = u32_at(bytes, offset)? as usize;
    let kind = u32_at(bytes, offset + 4)?;
    let end = (offset + 8).saturating_add(length).min(bytes.len());
    Some((kind, &bytes[offset + 8..end], end))
}

fn u32_at(bytes: &[u8], offset: usize) -> Option<u32> {
    let four = bytes.get(offset..offset.checked_add(4)?)?;
    Some(u32::from_le_bytes(four.try_into().expect("four bytes were sliced")))
}

/// All buffers in memory.
pub(super) struct Buffers<'a> {
    buffers: Vec<Cow<'a, [u8]>>,
    views: &'a [BufferView],
}

impl<'a> Buffers<'a> {
    /// Fetches every buffer that a buffer view refers to.
    ///
    /// # Errors
    /// When one of them cannot be had: without it there is no geometry.
    pub fn fetch(
        name: &str,
        document: &'a Document,
        bin: Option<&'a [u8]>,
        locator: &Locator,
        notes: &mut Notes,
    ) -> Result<Self, ImportError> {
        let mut buffers = Vec::with_capacity(document.buffers.len());
        for (index, buffer) in document.buffers.iter().enumerate() {
            let content = match (&buffer.uri, bin) {
                (Some(uri), _) => locator.fetch(uri).map(Cow::Owned),
                (None, Some(bin)) if index == 0 => Ok(Cow::Borrowed(bin)),
                (None, _) => Err("it has neither a URI nor a binary chunk".to_owned()),
            };
            let needed = document.buffer_views.iter().any(|view| view.buffer == index);
            match content {
                Ok(content) => {
                    if content.len() < buffer.byte_length {
                        let (have, want) = (content.len(), buffer.byte_length);
                        notes.warn(format!(
                            "buffer {index} has {have} bytes, {want} were announced: what lies beyond is left out"
                        ));
                    }
                    buffers.push(content);
                }
                Err(reason) if needed => {
                    return Err(ImportError::Buffer { name: name.to_owned(), index, reason });
                }
                Err(_) => buffers.push(Cow::Borrowed(&[])),
            }
        }
        Ok(Buffers { buffers, views: &document.buffer_views })
    }

    /// Bytes of a view and its stride, or a reason in words.
    pub fn view(&self, index: usize) -> Result<(&[u8], Option<usize>), String> {
        let view = self.views.get(index).ok_or_else(|| format!("buffer view {index} does not exist"))?;
        let buffer = self.buffers.get(view.buffer).ok_or_else(|| format!("buffer {} does not exist", view.buffer))?;
        let end = view.byte_offset.saturating_add(view.byte_length);
        let bytes = buffer
            .get(view.byte_offset..end)
            .ok_or_else(|| format!("buffer view {index} reaches beyond the end of its buffer"))?;
        Ok((bytes, view.byte_stride))
    }
}
