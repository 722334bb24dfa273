//! Textures: images fetched and decoded in parallel, samplers, and a checkerboard where an image cannot be had.

use std::borrow::Cow;
use std::io::Cursor;
use std::sync::Arc;

use image::{ImageReader, Limits};
use rayon::prelude::*;
use serde_json::Value;

use super::container::Buffers;
use super::document::{self, Document, called};
use super::report::Notes;
use super::uri::Locator;
use crate::scene::{Filter, Image, Texture, Wrap};

/// Longest side of an image in texels.
const MAX_SIDE: u32 = 16_384;

/// Most bytes that decoding one image may take.
const MAX_DECODE_BYTES: u64 = 2 << 30;

/// Decodes the images of some textures, given by their indices in the file, each image once.
pub(super) fn decode(
    document: &Document,
    textures: &[usize],
    buffers: &Buffers,
    locator: &Locator,
    notes: &mut Notes,
) -> Vec<Texture> {
    let sources: Vec<Result<usize, String>> = textures.iter().map(|&texture| source_of(document, texture)).collect();
    let mut wanted: Vec<usize> = sources.iter().filter_map(|source| source.as_ref().ok().copied()).collect();
    wanted.sort_unstable();
    wanted.dedup();
    let images: Vec<Result<Image, String>> =
        wanted.par_iter().map(|&index| decode_image(document, index, buffers, locator)).collect();

    let placeholder = Arc::new(checkerboard());
    let decoded: Vec<Arc<Image>> = images
        .into_iter()
        .zip(&wanted)
        .map(|(image, &index)| match image {
            Ok(image) => Arc::new(image),
            Err(reason) => {
                let name = document.images.get(index).and_then(|image| image.name.as_ref());
                notes.warn(format!("{}: {reason}: a checkerboard is shown", called("image", index, name)));
                Arc::clone(&placeholder)
            }
        })
        .collect();
    let mut image_of = |source: Result<usize, String>| match source {
        Ok(source) => Arc::clone(&decoded[wanted.binary_search(&source).expect("every source is wanted")]),
        Err(reason) => {
            notes.warn(format!("{reason}: a checkerboard is shown"));
            Arc::clone(&placeholder)
        }
    };
    textures
        .iter()
        .zip(sources)
        .map(|(&texture, source)| {
            let (wrap, filter) = sampler_of(document, texture);
            Texture { image: image_of(source), wrap, filter }
        })
        .collect()
}

/// The image of a texture: its plain source, else that of the WebP or Basis extension.
fn source_of(document: &Document, index: usize) -> Result<usize, String> {
    let texture = document.textures.get(index).ok_or_else(|| format!("texture {index} does not exist"))?;
    let extended = |name: &str| texture.extensions.get(name)?.get("source").and_then(Value::as_u64);
    let alternatives = ["EXT_texture_webp", "KHR_texture_basisu", "MSFT_texture_dds", "EXT_texture_avif"];
    texture
        .source
        .or_else(|| alternatives.iter().find_map(|name| extended(name)).map(|source| source as usize))
        .ok_or_else(|| format!("texture {index} has no image"))
}

fn decode_image(document: &Document, index: usize, buffers: &Buffers, locator: &Locator) -> Result<Image, String> {
    let source = document.images.get(index).ok_or("it does not exist")?;
    let bytes = fetch(source, buffers, locator)?;
    if bytes.starts_with(b"\xABKTX") {
        return Err("KTX2 cannot be read (export it as PNG or JPEG)".to_owned());
    }
    let mut reader = ImageReader::new(Cursor::new(&bytes))
        .with_guessed_format()
        .map_err(|error| format!("it cannot be read ({error})"))?;
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE);
    limits.max_image_height = Some(MAX_SIDE);
    limits.max_alloc = Some(MAX_DECODE_BYTES);
    reader.limits(limits);
    let pixels = reader.decode().map_err(|error| format!("it cannot be decoded ({error})"))?.into_rgba8();
    let (width, height) = pixels.dimensions();
    if width == 0 || height == 0 {
        return Err("it is empty".to_owned());
    }
    Ok(Image { width, height, texels: pixels.into_raw().as_chunks::<4>().0.to_vec() })
}

fn fetch<'a>(source: &document::Image, buffers: &'a Buffers, locator: &Locator) -> Result<Cow<'a, [u8]>, String> {
    match (&source.uri, source.buffer_view) {
        (Some(uri), _) => locator.fetch(uri).map(Cow::Owned),
        (None, Some(view)) => buffers.view(view).map(|(bytes, _)| Cow::Borrowed(bytes)),
        (None, None) => Err("it names no bytes".to_owned()),
    }
}

fn sampler_of(document: &Document, texture: usize) -> ([Wrap; 2], Filter) {
    let texture = document.textures.get(texture);
    let Some(sampler) = texture.and_then(|texture| texture.sampler).and_then(|index| document.samplers.get(index))
    else {
        return ([Wrap::Repeat; 2], Filter::Linear);
    };
    let wrap = |code: Option<u32>| match code {
        Some(33_071) => Wrap::Clamp,
        Some(33_648) => Wrap::Mirror,
        _ => Wrap::Repeat,
    };
    let filter = if sampler.mag_filter == Some(9728) { Filter::Nearest } else { Filter::Linear };
    ([wrap(sampler.wrap_s), wrap(sampler.wrap_t)], filter)
}

/// Magenta and gray, 8 × 8: nobody mistakes it for a design.
fn checkerboard() -> Image {
    let texel = |i: usize| if (i % 8 + i / 8).is_multiple_of(2) { [255, 0, 255, 255] } else { [96, 96, 96, 255] };
    Image { width: 8, height: 8, texels: (0..64).map(texel).collect() }
}
