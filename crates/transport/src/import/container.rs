//! GLB chunks, buffers and buffer views: from a file to slices of bytes whose bounds hold.

use std::borrow::Cow;

use gltf::binary::{self, ChunkType, Glb};
use gltf::json::Root;
use gltf::json::buffer::View;
use gltf::json::mesh::MorphTarget;
use rayon::prelude::*;

use super::ImportError;
use super::document::size;
use super::meshopt::Compressed;
use super::report::Notes;
use super::uri::Locator;
use crate::stop::Stop;

const GLB_MAGIC: &[u8; 4] = b"glTF";
const GLB_HEADER_BYTES: u32 = 12;

/// JSON text and, for a GLB, its binary chunk.
#[derive(Debug)]
pub(super) struct Container<'a> {
    pub json: Cow<'a, [u8]>,
    pub bin: Option<Cow<'a, [u8]>>,
}

/// First bytes of files that are taken for scenes, what they are, and what to do about it.
const OTHERS: &[(&[u8], &str, &str)] = &[
    (
        b"PK\x03\x04",
        "an archive (ZIP or USDZ)",
        "unpack it and open what is in it; export a .usdz as glTF, with Blender say",
    ),
    (b"\x1F\x8B", "a gzip archive", "unpack it first"),
    (b"Kaydara FBX Binary", "an FBX file", "export it as glTF, with Blender say"),
    (b"BLENDER", "a Blender file", "export it as glTF there"),
    (b"PXR-USDC", "a USD file", "export it as glTF, with Blender say"),
    (b"#usda", "a USD file", "export it as glTF, with Blender say"),
    (b"\xFF\xFE\xFF\x0ES\0k\0e\0t\0c\0h\0U\0p\0", "a SketchUp file", "export it as glTF there"),
    (b"3D Geometry File Format", "a Rhino file", "export it as glTF there"),
    (
        b"\xD0\xCF\x11\xE0\xA1\xB1\x1A\xE1",
        "a compound file (Revit's .rvt, 3ds Max's .max)",
        "export it as glTF there, or as FBX and that as glTF, with Blender say",
    ),
    (b"ISO-10303-21", "a STEP or IFC file", "convert it to glTF, with IfcConvert or FreeCAD say"),
    (b"CLERTRAN", "a baked transport", "name the scene that it was baked from"),
    (b"version https://git-lfs", "a stub of Git LFS", "fetch the file itself by `git lfs pull`"),
    (b"<", "a page or document (HTML or XML)", "download the file itself, or export the scene as glTF"),
];

/// Splits a file into its chunks; a JSON glTF is one chunk.
pub(super) fn split<'a>(name: &str, bytes: &'a [u8]) -> Result<Container<'a>, ImportError> {
    if let Some(&(_, kind, remedy)) = OTHERS.iter().find(|(magic, ..)| bytes.trim_ascii_start().starts_with(magic)) {
        return Err(ImportError::Kind { name: name.to_owned(), kind, remedy });
    }
    if bytes.trim_ascii().is_empty() {
        let (kind, remedy) = ("an empty file", "export or download it again");
        return Err(ImportError::Kind { name: name.to_owned(), kind, remedy });
    }
    if !bytes.starts_with(GLB_MAGIC) {
        return Ok(Container { json: bytes.into(), bin: None });
    }
    let broken = |reason: String| ImportError::Container { name: name.to_owned(), reason };
    let announced = bytes.get(8..12).map(|four| u32::from_le_bytes(four.try_into().expect("four bytes were sliced")));
    // The crate subtracts the header from the length before it looks at either.
    let length = announced.filter(|&length| length >= GLB_HEADER_BYTES);
    let length = length.ok_or_else(|| broken("it ends within its header".to_owned()))? as usize;
    let n_bytes = bytes.len();
    let bytes = &bytes[..length.min(n_bytes)];
    match Glb::from_slice(bytes) {
        Ok(Glb { json, bin, .. }) => Ok(Container { json, bin }),
        Err(gltf::Error::Binary(binary::Error::Version(version))) => {
            Err(ImportError::Version { name: name.to_owned(), version: version.to_string() })
        }
        Err(gltf::Error::Binary(binary::Error::UnknownChunkType(_))) if let Some(known) = known_chunks(bytes) => {
            Ok(known)
        }
        Err(gltf::Error::Binary(error)) => Err(broken(in_words(&error, length, n_bytes))),
        Err(error) => Err(broken(error.to_string())),
    }
}

/// The first chunk of a GLB if it is one of JSON, and the binary one if it has any: between them chunks may stand of kinds that only
/// others know.
fn known_chunks(bytes: &[u8]) -> Option<Container<'_>> {
    let mut rest = bytes.get(GLB_HEADER_BYTES as usize..)?;
    let mut chunks = std::iter::from_fn(|| {
        let (kind, content, behind) = first_chunk(rest)?;
        rest = behind;
        Some((kind, content))
    });
    let (_, json) = chunks.next().filter(|(kind, _)| *kind == b"JSON")?;
    let bin = chunks.find(|(kind, _)| *kind == b"BIN\0").map(|(_, bin)| bin.into());
    Some(Container { json: json.into(), bin })
}

/// Kind and content of the first of some chunks, and what stands behind it.
fn first_chunk(bytes: &[u8]) -> Option<(&[u8; 4], &[u8], &[u8])> {
    let (length, rest) = bytes.split_first_chunk::<4>()?;
    let (kind, rest) = rest.split_first_chunk::<4>()?;
    let (content, behind) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
    Some((kind, content, behind))
}

/// What is wrong with the chunks of a GLB that announces `length` bytes and has `n_bytes`.
fn in_words(error: &binary::Error, length: usize, n_bytes: usize) -> String {
    match error {
        binary::Error::Length { .. } => {
            format!("it announces {length} bytes and has {n_bytes}: is it downloaded in full?")
        }
        binary::Error::ChunkLength { ty: ChunkType::Json, .. } | binary::Error::ChunkType(ChunkType::Bin) => {
            "its first chunk is not a whole JSON chunk".to_owned()
        }
        binary::Error::ChunkLength { ty: ChunkType::Bin, .. } => "its binary chunk is cut short".to_owned(),
        binary::Error::ChunkType(ChunkType::Json) => "it has two JSON chunks".to_owned(),
        binary::Error::UnknownChunkType(kind) => {
            format!("it has a chunk of unknown type {:?}", kind.escape_ascii().to_string())
        }
        binary::Error::Io(_) => "it ends within the header of a chunk".to_owned(),
        other => other.to_string(),
    }
}

/// Most bytes that all compressed views of a file may become.
const MAX_DECODED_BYTES: usize = 2 << 30;

/// All buffers in memory.
pub(super) struct Buffers<'a> {
    buffers: Vec<Cow<'a, [u8]>>,
    views: &'a [View],
    /// Bytes and stride of each compressed view, `None` for the others.
    decoded: Vec<Option<Result<Decoded, String>>>,
}

/// Bytes of a view that was compressed, and of one element.
type Decoded = (Vec<u8>, usize);

impl<'a> Buffers<'a> {
    /// Fetches every buffer that a buffer view refers to. One that cannot be had and holds no geometry is empty, with a line in `notes`.
    ///
    /// # Errors
    /// When one that geometry needs cannot be had.
    pub fn fetch(
        name: &str,
        document: &'a Root,
        bin: Option<&'a [u8]>,
        locator: &Locator,
        notes: &mut Notes,
    ) -> Result<Self, ImportError> {
        let compressed: Vec<_> = document.buffer_views.iter().map(Compressed::of).collect();
        let of_geometry = views_of_geometry(document);
        let mut buffers = Vec::with_capacity(document.buffers.len());
        for (index, buffer) in document.buffers.iter().enumerate() {
            let content = match (&buffer.uri, bin) {
                (Some(uri), _) => locator.fetch(uri).map(Cow::Owned),
                (None, Some(bin)) if index == 0 => Ok(Cow::Borrowed(bin)),
                (None, _) => Err("it has neither a URI nor a binary chunk".to_owned()),
            };
            let refers = |(view, compressed): (&View, &Option<Result<Compressed, String>>)| match compressed {
                Some(Ok(compressed)) => compressed.buffer == index,
                Some(Err(_)) => false,
                None => view.buffer.value() == index,
            };
            let views = || document.buffer_views.iter().zip(&compressed);
            let is_needed = views().zip(&of_geometry).any(|(view, of_geometry)| *of_geometry && refers(view));
            match content {
                Ok(content) => {
                    if content.len() < size(buffer.byte_length) {
                        let (have, want) = (content.len(), size(buffer.byte_length));
                        notes.warn(format!(
                            "buffer {index} has {have} bytes, {want} were announced: what lies beyond is left out"
                        ));
                    }
                    buffers.push(content);
                }
                Err(reason) if is_needed => {
                    return Err(ImportError::Buffer { name: name.to_owned(), index, reason });
                }
                Err(reason) => {
                    if views().any(refers) {
                        notes.warn(format!("buffer {index}: {reason}: what lies in it is left out"));
                    }
                    buffers.push(Cow::Borrowed(&[]));
                }
            }
        }
        let decoded = decode(&buffers, compressed, &locator.stop);
        Ok(Buffers { buffers, views: &document.buffer_views, decoded })
    }

    /// Bytes of all buffers, as they lie in the file.
    pub fn n_bytes(&self) -> u64 {
        self.buffers.iter().fold(0, |sum: u64, buffer| sum.saturating_add(buffer.len() as u64))
    }

    /// Bytes of a view and its stride, or a reason in words.
    pub fn view(&self, index: usize) -> Result<(&[u8], Option<usize>), String> {
        let view = self.views.get(index).ok_or_else(|| format!("buffer view {index} does not exist"))?;
        match self.decoded.get(index).and_then(Option::as_ref) {
            Some(Ok((bytes, stride))) => return Ok((bytes, view.byte_stride.map(|own| own.0).or(Some(*stride)))),
            // Some files carry the same bytes uncompressed, for readers that do not know the extension.
            Some(Err(reason)) if self.buffers.get(view.buffer.value()).is_none_or(|buffer| buffer.is_empty()) => {
                return Err(format!("buffer view {index} cannot be decompressed: {reason}"));
            }
            _ => {}
        }
        let buffer =
            self.buffers.get(view.buffer.value()).ok_or_else(|| format!("buffer {} does not exist", view.buffer))?;
        let start = view.byte_offset.map_or(0, size);
        let end = start.saturating_add(size(view.byte_length));
        let bytes = buffer
            .get(start..end)
            .ok_or_else(|| format!("buffer view {index} reaches beyond the end of its buffer"))?;
        Ok((bytes, view.byte_stride.map(|stride| stride.0)))
    }
}

/// Whether each buffer view holds vertices of a mesh or their indices.
fn views_of_geometry(document: &Root) -> Vec<bool> {
    let accessors = document.meshes.iter().flat_map(|mesh| &mesh.primitives).flat_map(|primitive| {
        let of_target = |target: &MorphTarget| [target.positions, target.normals, target.tangents];
        let targets = primitive.targets.iter().flatten().flat_map(of_target).flatten();
        primitive.attributes.values().copied().chain(primitive.indices).chain(targets)
    });
    let mut of_geometry = vec![false; document.buffer_views.len()];
    for accessor in accessors.filter_map(|index| document.get(index)) {
        let sparse = accessor.sparse.iter().flat_map(|sparse| [sparse.indices.buffer_view, sparse.values.buffer_view]);
        for view in accessor.buffer_view.into_iter().chain(sparse) {
            if let Some(of_geometry) = of_geometry.get_mut(view.value()) {
                *of_geometry = true;
            }
        }
    }
    of_geometry
}

/// Decodes compressed views, in parallel.
fn decode(
    buffers: &[Cow<[u8]>],
    compressed: Vec<Option<Result<Compressed, String>>>,
    stop: &Stop,
) -> Vec<Option<Result<Decoded, String>>> {
    let mut n_bytes = 0_usize;
    let mut within_limit = |compressed: Compressed| {
        n_bytes = n_bytes.saturating_add(compressed.n_bytes());
        let most = MAX_DECODED_BYTES;
        if n_bytes <= most { Ok(compressed) } else { Err(format!("all views together have more than {most} bytes")) }
    };
    let checked: Vec<_> = compressed.into_iter().map(|view| Some(view?.and_then(&mut within_limit))).collect();
    let decode_one = |view: Compressed| {
        stop.check().map_err(|stopped| stopped.to_string())?;
        let end = view.byte_offset.saturating_add(view.byte_length);
        let stream = buffers.get(view.buffer).and_then(|buffer| buffer.get(view.byte_offset..end));
        let bytes = view.decode(stream.ok_or("its stream reaches beyond the end of its buffer")?)?;
        Ok((bytes, view.byte_stride))
    };
    checked.into_par_iter().map(|view| Some(view?.and_then(decode_one))).collect()
}
