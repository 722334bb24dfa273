//! Textures: images fetched and decoded in parallel, samplers, and a checkerboard where an image cannot be had.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, PoisonError};

use gltf::json::texture::{MagFilter, WrappingMode};
use gltf::json::validation::Checked;
use gltf::json::{self, Root};
use image::{DynamicImage, ImageDecoder, ImageError, ImageReader, Limits, RgbaImage, imageops};
use rayon::prelude::*;

use super::container::Buffers;
use super::document::{called, shown};
use super::jpeg;
use super::material::UsedTexture;
use super::report::Notes;
use super::uri::{Locator, file_of};
use crate::scene::{Filter, Image, Texture, Wrap};
use crate::stop::Stop;

/// Longest side of an image in texels.
const MAX_SIDE: u32 = 16_384;

/// What the JSON model has where a texture names no source.
const NO_SOURCE: usize = u32::MAX as usize;

/// Most bytes that decoding one image may take.
const MAX_DECODE_BYTES: u64 = 2 << 30;

/// Texels that all images of a file together may keep, 2 GiB of them: beyond that the largest are halved until they fit.
const MAX_TEXELS: u64 = 1 << 29;

/// Images of more texels than this are decoded one after another.
const LARGE_TEXELS: u64 = 1 << 26;

/// How much of the images may be in memory.
struct Room {
    /// Longest side that an image keeps.
    side: u32,
    /// Held while a large one is decoded.
    large: Mutex<()>,
}

/// Textures of a scene.
pub(super) struct Decoded {
    /// With a checkerboard for an image that cannot be had.
    pub textures: Vec<Texture>,
    /// Those of them.
    pub missing: BTreeSet<u32>,
}

/// Decodes the images of some textures, each image once. `shown` are the places of those that are a base color.
pub(super) fn decode(
    document: &Root,
    textures: &[UsedTexture],
    shown: &BTreeSet<u32>,
    buffers: &Buffers,
    locator: &Locator,
    notes: &mut Notes,
) -> Decoded {
    let sources: Vec<Vec<usize>> = textures.iter().map(|texture| sources_of(document, texture.index)).collect();
    let mut wanted: Vec<&Vec<usize>> = sources.iter().collect();
    wanted.sort_unstable();
    wanted.dedup();
    let seen: BTreeSet<&Vec<usize>> =
        (0..).zip(&sources).filter(|(place, _)| shown.contains(place)).map(|(_, sources)| sources).collect();
    let instead = |sources: &Vec<usize>| if seen.contains(sources) { CHECKERBOARD } else { LEFT_OUT };
    let sizes: Vec<Option<[u32; 2]>> = wanted
        .par_iter()
        .map(|sources| sources.iter().find_map(|&index| size_of(document, index, buffers, locator)))
        .collect();
    let of_sources = |sources: &Vec<usize>| wanted.binary_search(&sources).expect("every source is wanted");
    // A map of gloss is an image of its own, whoever else shows what it is made of.
    let of_gloss = textures.iter().zip(&sources).filter(|(used, _)| used.glossiness.is_some());
    let kept = sizes.iter().copied().chain(of_gloss.map(|(_, sources)| sizes[of_sources(sources)]));
    let kept: Vec<[u32; 2]> = kept.flatten().collect();
    let room = Room { side: side_within(&kept, MAX_TEXELS), large: Mutex::default() };
    let first_readable = |sources: &&Vec<usize>| {
        let mut notes = Notes::default();
        for (&index, next) in sources.iter().zip(1..) {
            match decode_image(document, index, buffers, locator, &room) {
                Ok(image) => return (Some(Arc::new(image)), notes),
                Err(fault) => {
                    let next = sources.get(next).map(|&next| format!("{} is shown", name_of(document, next)));
                    let instead = next.unwrap_or_else(|| instead(sources).to_owned());
                    notes.warn(format!("{fault}: {instead}"));
                }
            }
        }
        (None, notes)
    };
    let n_smaller = sizes.iter().flatten().filter(|&&size| shrunk(size, room.side) != size).count();
    if n_smaller > 0 {
        notes.warn(format!(
            "{n_smaller} images are shown smaller, with sides of at most {} texels: all images of the file together have more than {MAX_TEXELS}",
            room.side
        ));
    }
    let decoded: Vec<(Option<Arc<Image>>, Notes)> = wanted.par_iter().map(first_readable).collect();
    let mut images = Vec::with_capacity(decoded.len());
    for (image, lines) in decoded {
        notes.absorb(lines);
        images.push(image);
    }
    let (placeholder, mut missing) = (Arc::new(checkerboard()), BTreeSet::new());
    let texture = |((place, &used), sources): ((u32, &UsedTexture), &Vec<usize>)| {
        if sources.is_empty() {
            notes.warn(format!("texture {} has no image: {}", used.index, instead(sources)));
        }
        let image = &images[of_sources(sources)];
        if image.is_none() {
            missing.insert(place);
        }
        let (wrap, filter) = sampler_of(document, used.index);
        let image = image.as_ref().unwrap_or(&placeholder);
        let image = used.glossiness.map_or_else(|| Arc::clone(image), |factor| Arc::new(roughness_of(image, factor)));
        Texture { image, wrap, filter }
    };
    let textures = (0..).zip(textures).zip(&sources).map(texture).collect();
    Decoded { textures, missing }
}

/// What becomes of an image that cannot be had, where it is a base color and where it is not.
const CHECKERBOARD: &str = "a checkerboard is shown";
const LEFT_OUT: &str = "it is left out";

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

/// Width and height of an image that can be decoded, from its first bytes.
fn size_of(document: &Root, index: usize, buffers: &Buffers, locator: &Locator) -> Option<[u32; 2]> {
    size_in(&fetch(document.images.get(index)?, buffers, locator).ok()?)
}

fn size_in(bytes: &[u8]) -> Option<[u32; 2]> {
    let (width, height) = ImageReader::new(Cursor::new(bytes)).with_guessed_format().ok()?.into_dimensions().ok()?;
    (width.max(height) <= MAX_SIDE).then_some([width, height])
}

/// The longest side, a power of two, to which images must be brought so that they have no more texels than that together.
fn side_within(sizes: &[[u32; 2]], most: u64) -> u32 {
    let texels_within = |side: u32| {
        sizes.iter().map(|&size| shrunk(size, side).map(u64::from)).fold(0_u64, |sum, [width, height]| {
            // A product of two 32-bit numbers.
            sum.saturating_add(width.saturating_mul(height))
        })
    };
    let halved = std::iter::successors(Some(MAX_SIDE), |&side| (side > 1).then_some(side / 2));
    halved.into_iter().find(|&side| texels_within(side) <= most).unwrap_or(1)
}

/// A size halved until no side is longer than that.
fn shrunk([width, height]: [u32; 2], side: u32) -> [u32; 2] {
    let halvings = (0..32).find(|&n| width.max(height) >> n <= side).unwrap_or(31);
    [(width >> halvings).max(1), (height >> halvings).max(1)]
}

/// An image in a line of the report.
fn name_of(document: &Root, index: usize) -> String {
    called("image", index, document.images.get(index).and_then(|image| image.name.as_ref()))
}

/// An image, or a line that names it and says why it cannot be had.
fn decode_image(
    document: &Root,
    index: usize,
    buffers: &Buffers,
    locator: &Locator,
    room: &Room,
) -> Result<Image, String> {
    let name = name_of(document, index);
    let source = document.images.get(index).ok_or_else(|| format!("{name}: it does not exist"))?;
    let bytes = fetch(source, buffers, locator).map_err(|reason| format!("{name}: {reason}"))?;
    decode_fetched(&bytes, room, &locator.stop).map_err(|reason| {
        // What is wrong with the bytes of a file says nothing of its name.
        let file = source.uri.as_deref().and_then(file_of);
        let file = file.map_or_else(String::new, |file| format!(" ({})", shown(&file)));
        format!("{name}{file}: {reason}")
    })
}

fn decode_fetched(bytes: &[u8], room: &Room, stop: &Stop) -> Result<Image, String> {
    if bytes.starts_with(b"\xABKTX") {
        return Err(
            "KTX2 cannot be read (export it as PNG or JPEG, or run `gltf-transform ktxdecompress IN.glb OUT.glb`)"
                .to_owned(),
        );
    }
    // A fault of a decoder in a single image must not take the whole scene with it.
    let decoded = catch_unwind(AssertUnwindSafe(|| decode_bytes(bytes, room, stop)));
    decoded.unwrap_or_else(|_| Err("it cannot be decoded (its decoder failed)".to_owned()))
}

fn decode_bytes(bytes: &[u8], room: &Room, stop: &Stop) -> Result<Image, String> {
    jpeg::check_whole(bytes)?;
    let mut reader = ImageReader::new(stop.reader(Cursor::new(bytes)))
        .with_guessed_format()
        .map_err(|error| format!("it cannot be read ({error})"))?;
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE);
    limits.max_image_height = Some(MAX_SIDE);
    limits.max_alloc = Some(MAX_DECODE_BYTES);
    reader.limits(limits.clone());
    let undecodable = |error: ImageError| match error {
        ImageError::Unsupported(_) => format!("it cannot be decoded ({error}; export it as PNG or JPEG)"),
        _ => format!("it cannot be decoded ({error})"),
    };
    let mut decoder = reader.into_decoder().map_err(undecodable)?;
    decoder.set_limits(limits).map_err(undecodable)?;
    let (width, height) = decoder.dimensions();
    if decoder.total_bytes() > MAX_DECODE_BYTES {
        return Err(format!("its {width}×{height} pixels are too large"));
    }
    if width == 0 || height == 0 {
        return Err("it is empty".to_owned());
    }
    #[expect(clippy::arithmetic_side_effects, reason = "a product of two 32-bit numbers")]
    let is_large = u64::from(width) * u64::from(height) > LARGE_TEXELS;
    let _turn = is_large.then(|| room.large.lock().unwrap_or_else(PoisonError::into_inner));
    let pixels = DynamicImage::from_decoder(decoder).map_err(undecodable)?.into_rgba8();
    stop.check().map_err(|stopped| stopped.to_string())?;
    Ok(kept(pixels, room.side))
}

/// What is kept of an image: one of a single color is a single texel.
fn kept(pixels: RgbaImage, side: u32) -> Image {
    let size = <[u32; 2]>::from(pixels.dimensions());
    let is_plain = pixels.as_raw().as_chunks::<4>().0.windows(2).all(|pair| pair[0] == pair[1]);
    let [width, height] = shrunk(size, if is_plain { 1 } else { side });
    let pixels = match [width, height] == size {
        true => pixels,
        false if is_plain => RgbaImage::from_pixel(width, height, *pixels.get_pixel(0, 0)),
        false => imageops::thumbnail(&pixels, width, height),
    };
    let texels = bytemuck::allocation::try_cast_vec(pixels.into_raw());
    Image { width, height, texels: texels.unwrap_or_else(|(_, bytes)| bytes.as_chunks::<4>().0.to_vec()) }
}

/// Width and height of an image that lies in a buffer; others are not read for that.
pub(super) fn dimensions(document: &Root, index: usize, buffers: &Buffers) -> Option<[u32; 2]> {
    let view = document.images.get(index).filter(|image| image.uri.is_none())?.buffer_view?;
    size_in(buffers.view(view.value()).ok()?.0)
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

/// Roughness in G of an image whose alpha is glossiness, but for a factor.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a byte times a factor within 0 … 1")]
fn roughness_of(image: &Image, factor: f32) -> Image {
    let texel = |texel: &[u8; 4]| [0, (255.0 - factor * f32::from(texel[3])).round() as u8, 0, u8::MAX];
    Image { width: image.width, height: image.height, texels: image.texels.iter().map(texel).collect() }
}

/// Magenta and gray, 8 × 8: nobody mistakes it for a design.
fn checkerboard() -> Image {
    #[expect(clippy::arithmetic_side_effects, reason = "there are 64")]
    let texel = |i: usize| if (i % 8 + i / 8).is_multiple_of(2) { [255, 0, 255, 255] } else { [96, 96, 96, 255] };
    Image { width: 8, height: 8, texels: (0..64).map(texel).collect() }
}

#[cfg(test)]
mod tests {
    use image::Rgba;

    use super::*;

    #[test]
    fn what_is_too_much_together_is_halved_from_the_largest_on() {
        let sizes = [[4096, 4096], [2048, 1024], [64, 64]];
        let n_texels =
            |side| sizes.map(|size| shrunk(size, side)).map(|[width, height]| u64::from(width * height)).iter().sum();
        assert_eq!(side_within(&sizes, n_texels(MAX_SIDE)), MAX_SIDE);
        assert_eq!(side_within(&sizes, n_texels(4096) - 1), 2048);
        assert_eq!(side_within(&sizes, n_texels(512)), 512);
        assert_eq!(side_within(&sizes, 2), 1, "nothing is ever left out");
        assert_eq!([[4096, 1], [300, 200], [8, 8]].map(|size| shrunk(size, 64)), [[64, 1], [37, 25], [8, 8]]);
    }

    #[test]
    fn a_smaller_image_has_the_mean_of_the_larger_one_and_a_plain_one_is_one_texel() {
        let stripes =
            RgbaImage::from_fn(16, 4, |x, _| Rgba(if x % 2 == 0 { [200, 0, 40, 255] } else { [100, 0, 60, 255] }));
        let image = kept(stripes.clone(), 8);
        assert_eq!((image.width, image.height, image.texels), (8, 2, vec![[150, 0, 50, 255]; 16]));
        assert_eq!(kept(stripes, 16).texels.len(), 64);
        let plain = kept(RgbaImage::from_pixel(300, 200, Rgba([1, 2, 3, 4])), MAX_SIDE);
        assert_eq!((plain.width, plain.height, plain.texels), (1, 1, vec![[1, 2, 3, 4]]));
    }
}
