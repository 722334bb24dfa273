//! Display-encoded PNG in sRGB, which it says in the chunks that readers of any age know.

// What is read here was written by strangers, so no integer may wrap in silence.
#![cfg_attr(not(test), deny(clippy::arithmetic_side_effects))]
#![cfg_attr(not(test), deny(clippy::cast_possible_truncation, clippy::cast_sign_loss))]

use anyhow::Result;
use clerestory_relight::display::{WhitePoint, encode16};
use clerestory_relight::{DisplayParams, Radiance, Tone, encode};
use flate2::Crc;
use image::codecs::png::PngEncoder;
use image::{DynamicImage, ImageBuffer, Rgb, RgbImage, RgbaImage};
use serde::{Deserialize, Serialize};

use super::options::PngDepth;
use crate::isolux::{self, Isolux};
use crate::legend::{Legend, scale_of};
use crate::look::Quantity;

/// sRGB chunk (perceptual intent) and the gAMA chunk that goes with it, both with their checksums [PNG3, 11.3.2].
const SRGB_CHUNKS: [u8; 29] = [
    0, 0, 0, 1, b's', b'R', b'G', b'B', 0, 0xAE, 0xCE, 0x1C, 0xE9, //
    0, 0, 0, 4, b'g', b'A', b'M', b'A', 0, 0, 0xB1, 0x8F, 0x0B, 0xFC, 0x61, 0x05,
];
/// Name of a chunk of text, and what its first words are here.
const TEXT: &[u8] = b"tEXt";
const KEYWORD: &[u8] = b"Clerestory display\0";
/// Bytes of the signature, and of it and the IHDR chunk.
const SIGNATURE_LEN: usize = 8;
const HEADER_LEN: usize = 33;
/// Bytes of a chunk beside those that it names: their number, its name and its checksum.
const CHUNK_LEN: usize = 12;
/// Sixteen bits for each step of eight: 255 becomes 65535.
const STEP: u16 = 257;

/// Radiance as it is shown, with its legend on the right where its colors are false.
pub(super) fn shown(radiance: &Radiance, params: &DisplayParams, legend: Option<Legend>) -> RgbImage {
    let rgb = encode(radiance, params).chunks_exact(4).flat_map(|rgba| [rgba[0], rgba[1], rgba[2]]).collect();
    let mut picture = RgbImage::from_raw(radiance.width, radiance.height, rgb).expect("three bytes per pixel");
    let Some(legend) = legend else { return picture };
    if let Some(lines) = isolux_sheet(radiance, legend) {
        isolux::lay_over(&lines, &mut picture);
    }
    legend.beside(&picture)
}

/// Isolux lines of a picture of irradiance, where its legend has them.
fn isolux_sheet(irradiance: &Radiance, legend: Legend) -> Option<RgbaImage> {
    let is_lined = legend.isolux != Isolux::Off && legend.quantity == Quantity::Illuminance;
    let size = [irradiance.width, irradiance.height];
    is_lined.then(|| isolux::draw(&legend.isolux.lines(irradiance), size, scale_of(irradiance.height)))
}

/// The same at some depth; of a legend the words stay as coarse as they are.
pub(super) fn shown_at(
    depth: PngDepth,
    radiance: &Radiance,
    params: &DisplayParams,
    legend: Option<Legend>,
) -> DynamicImage {
    let deep = || {
        let samples = encode16(radiance, params);
        let picture: ImageBuffer<Rgb<u16>, Vec<u16>> =
            ImageBuffer::from_raw(radiance.width, radiance.height, samples).expect("three numbers per pixel");
        picture
    };
    match (depth, legend) {
        (PngDepth::Eight, _) => shown(radiance, params, legend).into(),
        (PngDepth::Sixteen, None) => deep().into(),
        (PngDepth::Sixteen, Some(legend)) => {
            let mut picture = deep();
            if let Some(lines) = isolux_sheet(radiance, legend) {
                isolux::lay_over_deep(&lines, &mut picture);
            }
            let sheet = shown(radiance, params, Some(legend));
            let mut deep_sheet = ImageBuffer::from_fn(sheet.width(), sheet.height(), |x, y| {
                Rgb(sheet.get_pixel(x, y).0.map(|byte| u16::from(byte) * STEP))
            });
            image::imageops::replace(&mut deep_sheet, &picture, 0, 0);
            deep_sheet.into()
        }
    }
}

/// What a PNG says of how it was shown, so that light can be told from it again.
#[derive(Serialize, Deserialize)]
struct ShownBy {
    tone: Tone,
    exposure_ev: f32,
    /// Kelvin and distance from the Planckian locus of what is shown as neutral.
    white: Option<[f32; 2]>,
}

/// A tEXt chunk that says how the picture was shown \[PNG3, 11.3.3\].
fn told(params: &DisplayParams) -> Result<Vec<u8>> {
    let white = params.white.map(|white| [white.kelvin, white.duv]);
    let shown = ShownBy { tone: params.tone, exposure_ev: params.exposure_ev, white };
    let mut body = [TEXT, KEYWORD].concat();
    body.extend(serde_json::to_vec(&shown)?);
    let mut crc = Crc::new();
    crc.update(&body);
    let n_bytes = u32::try_from(body.len().saturating_sub(TEXT.len()))?;
    Ok([&n_bytes.to_be_bytes()[..], &body, &crc.sum().to_be_bytes()].concat())
}

/// How a PNG of this program was shown; `None` for any other file, and for false color.
pub fn shown_by(png: &[u8]) -> Option<DisplayParams> {
    let mut at = SIGNATURE_LEN;
    loop {
        let (length, rest) = png.get(at..)?.split_first_chunk::<4>()?;
        let n_bytes = usize::try_from(u32::from_be_bytes(*length)).ok()?;
        // The name of the chunk comes before its bytes, its checksum after them.
        let body = rest.get(..n_bytes.checked_add(TEXT.len())?)?;
        if let Some(text) = body.strip_prefix(TEXT).and_then(|text| text.strip_prefix(KEYWORD)) {
            let ShownBy { tone, exposure_ev, white } = serde_json::from_slice(text).ok()?;
            let is_sane = exposure_ev.abs() <= 60.0 && white.is_none_or(|white| white.iter().all(|v| v.is_finite()));
            let white = white.map(|[kelvin, duv]| WhitePoint { kelvin, duv });
            return is_sane.then(|| DisplayParams { tone, exposure_ev, white, ..DisplayParams::default() });
        }
        // Text stands before the pixels.
        if body.starts_with(b"IDAT") {
            return None;
        }
        at = n_bytes.checked_add(CHUNK_LEN)?.checked_add(at)?;
    }
}

/// The file of a display-encoded picture; `params` say how it was shown, where light can be told from it again.
///
/// # Errors
/// If the encoder refuses its size.
pub fn png_bytes(picture: &DynamicImage, params: Option<&DisplayParams>) -> Result<Vec<u8>> {
    let mut png = Vec::new();
    picture.write_with_encoder(PngEncoder::new(&mut png))?;
    let told = params.map(told).transpose()?.unwrap_or_default();
    png.splice(HEADER_LEN..HEADER_LEN, SRGB_CHUNKS.into_iter().chain(told));
    Ok(png)
}
