//! Textures: images fetched and decoded in parallel, samplers, and a checkerboard where an image cannot be had.

use std::borrow::Cow;
use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use gltf::json::texture::{MagFilter, WrappingMode};
use gltf::json::validation::Checked;
use gltf::json::{self, Root};
use image::{DynamicImage, ImageDecoder, ImageReader, Limits};
use rayon::prelude::*;

use super::container::Buffers;
use super::document::called;
use super::report::Notes;
use super::uri::Locator;
use crate::scene::{Filter, Image, Texture, Wrap};
use crate::stop::Stop;

/// Longest side of an image in texels.
const MAX_SIDE: u32 = 16_384;

/// What the JSON model has where a texture names no source.
const NO_SOURCE: usize = u32::MAX as usize;

/// Most bytes that decoding one image may take.
const MAX_DECODE_BYTES: u64 = 2 << 30;

/// Most texels of all images of a file together.
const MAX_TEXELS: u64 = 1 << 30;

/// Decodes the images of some textures, given by their indices in the file, each image once.
pub(super) fn decode(
    document: &Root,
    textures: &[usize],
    buffers: &Buffers,
    locator: &Locator,
    notes: &mut Notes,
) -> Vec<Texture> {
    let sources: Vec<Vec<usize>> = textures.iter().map(|&texture| sources_of(document, texture)).collect();
    let mut wanted: Vec<&Vec<usize>> = sources.iter().collect();
    wanted.sort_unstable();
    wanted.dedup();
    let name_of =
        |index: usize| called("image", index, document.images.get(index).and_then(|image| image.name.as_ref()));
    let placeholder = Arc::new(checkerboard());
    let n_texels_left = AtomicU64::new(MAX_TEXELS);
    let first_readable = |sources: &Vec<usize>| {
        let mut notes = Notes::default();
        for (&index, next) in sources.iter().zip(1..) {
            match decode_image(document, index, buffers, locator, &n_texels_left) {
                Ok(image) => return (Arc::new(image), notes),
                Err(reason) => {
                    let name = name_of(index);
                    let instead = sources.get(next).map_or("a checkerboard".to_owned(), |&next| name_of(next));
                    notes.warn(format!("{name}: {reason}: {instead} is shown"));
                }
            }
        }
        (Arc::clone(&placeholder), notes)
    };
    let decoded: Vec<(Arc<Image>, Notes)> = wanted.par_iter().map(|sources| first_readable(sources)).collect();
    let mut images = Vec::with_capacity(decoded.len());
    for (image, lines) in decoded {
        notes.absorb(lines);
        images.push(image);
    }
    textures
        .iter()
        .zip(&sources)
        .map(|(&texture, sources)| {
            if sources.is_empty() {
                notes.warn(format!("texture {texture} has no image: a checkerboard is shown"));
            }
            let place = wanted.binary_search(&sources).expect("every source is wanted");
            let (wrap, filter) = sampler_of(document, texture);
            Texture { image: Arc::clone(&images[place]), wrap, filter }
        })
        .collect()
}

/// The images of a texture in the order in which they are tried: its plain source, then those of extensions.
pub(super) fn sources_of(document: &Root, index: usize) -> Vec<usize> {
    let Some(texture) = document.textures.get(index) else { return Vec::new() };
    let plain = Some(texture.source.value()).filter(|&source| source != NO_SOURCE);
    let extended = |name: &&str| texture.extensions.as_ref()?.others.get(*name)?.get("source")?.as_u64();
    let alternatives = ["EXT_texture_webp", "KHR_texture_basisu", "MSFT_texture_dds", "EXT_texture_avif"];
    plain
        .into_iter()
        .chain(alternatives.iter().filter_map(extended).filter_map(|source| usize::try_from(source).ok()))
        .collect()
}

fn decode_image(
    document: &Root,
    index: usize,
    buffers: &Buffers,
    locator: &Locator,
    n_texels_left: &AtomicU64,
) -> Result<Image, String> {
    let source = document.images.get(index).ok_or("it does not exist")?;
    let bytes = fetch(source, buffers, locator)?;
    if bytes.starts_with(b"\xABKTX") {
        return Err(
            "KTX2 cannot be read (export it as PNG or JPEG, or run `gltf-transform ktxdecompress IN.glb OUT.glb`)"
                .to_owned(),
        );
    }
    // A fault of a decoder in a single image must not take the whole scene with it.
    let decoded = catch_unwind(AssertUnwindSafe(|| decode_bytes(&bytes, n_texels_left, &locator.stop)));
    decoded.unwrap_or_else(|_| Err("it cannot be decoded (its decoder failed)".to_owned()))
}

fn decode_bytes(bytes: &[u8], n_texels_left: &AtomicU64, stop: &Stop) -> Result<Image, String> {
    let mut reader = ImageReader::new(stop.reader(Cursor::new(bytes)))
        .with_guessed_format()
        .map_err(|error| format!("it cannot be read ({error})"))?;
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE);
    limits.max_image_height = Some(MAX_SIDE);
    limits.max_alloc = Some(MAX_DECODE_BYTES);
    reader.limits(limits.clone());
    let undecodable = |error| format!("it cannot be decoded ({error})");
    let mut decoder = reader.into_decoder().map_err(undecodable)?;
    decoder.set_limits(limits).map_err(undecodable)?;
    let (width, height) = decoder.dimensions();
    #[expect(clippy::arithmetic_side_effects, reason = "a product of two 32-bit numbers")]
    let n_texels = u64::from(width) * u64::from(height);
    if decoder.total_bytes() > MAX_DECODE_BYTES {
        return Err(format!("its {width}×{height} pixels are too large"));
    }
    let left = |left: u64| left.checked_sub(n_texels);
    if n_texels_left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, left).is_err() {
        return Err(format!("all images together have more than {MAX_TEXELS} pixels"));
    }
    let pixels = DynamicImage::from_decoder(decoder).map_err(undecodable)?.into_rgba8();
    stop.check().map_err(|stopped| stopped.to_string())?;
    let (width, height) = pixels.dimensions();
    if width == 0 || height == 0 {
        return Err("it is empty".to_owned());
    }
    Ok(Image { width, height, texels: pixels.into_raw().as_chunks::<4>().0.to_vec() })
}

/// Width and height of an image that lies in a buffer; others are not read for that.
pub(super) fn dimensions(document: &Root, index: usize, buffers: &Buffers) -> Option<[u32; 2]> {
    let view = document.images.get(index).filter(|image| image.uri.is_none())?.buffer_view?;
    let (bytes, _) = buffers.view(view.value()).ok()?;
    let (width, height) = ImageReader::new(Cursor::new(bytes)).with_guessed_format().ok()?.into_dimensions().ok()?;
    (width.max(height) <= MAX_SIDE).then_some([width, height])
}

fn fetch<'a>(source: &json::Image, buffers: &'a Buffers, locator: &Locator) -> Result<Cow<'a, [u8]>, String> {
    match (&source.uri, source.buffer_view) {
        (Some(uri), _) => locator.fetch(uri).map(Cow::Owned),
        (None, Some(view)) => buffers.view(view.value()).map(|(bytes, _)| Cow::Borrowed(bytes)),
        (None, None) => Err("it names no bytes".to_owned()),
    }
}

fn sampler_of(document: &Root, texture: usize) -> ([Wrap; 2], Filter) {
    let texture = document.textures.get(texture);
    let Some(sampler) = texture.and_then(|texture| texture.sampler).and_then(|index| document.get(index)) else {
        return ([Wrap::Repeat; 2], Filter::Linear);
    };
    let wrap = |mode: Checked<WrappingMode>| match mode {
        Checked::Valid(WrappingMode::ClampToEdge) => Wrap::Clamp,
        Checked::Valid(WrappingMode::MirroredRepeat) => Wrap::Mirror,
        Checked::Valid(WrappingMode::Repeat) | Checked::Invalid => Wrap::Repeat,
    };
    let nearest = sampler.mag_filter == Some(Checked::Valid(MagFilter::Nearest));
    let filter = if nearest { Filter::Nearest } else { Filter::Linear };
    ([wrap(sampler.wrap_s), wrap(sampler.wrap_t)], filter)
}

/// Magenta and gray, 8 × 8: nobody mistakes it for a design.
fn checkerboard() -> Image {
    #[expect(clippy::arithmetic_side_effects, reason = "there are 64")]
    let texel = |i: usize| if (i % 8 + i / 8).is_multiple_of(2) { [255, 0, 255, 255] } else { [96, 96, 96, 255] };
    Image { width: 8, height: 8, texels: (0..64).map(texel).collect() }
}
