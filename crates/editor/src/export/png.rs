//! Display-encoded PNG in sRGB, which it says in the chunks that readers of any age know.

use anyhow::Result;
use clerestory_relight::display::encode16;
use clerestory_relight::{DisplayParams, Radiance, encode};
use image::codecs::png::PngEncoder;
use image::{DynamicImage, ImageBuffer, Rgb, RgbImage};

use super::options::PngDepth;
use crate::legend::Legend;

/// sRGB chunk (perceptual intent) and the gAMA chunk that goes with it, both with their checksums [PNG3, 11.3.2].
const SRGB_CHUNKS: [u8; 29] = [
    0, 0, 0, 1, b's', b'R', b'G', b'B', 0, 0xAE, 0xCE, 0x1C, 0xE9, //
    0, 0, 0, 4, b'g', b'A', b'M', b'A', 0, 0, 0xB1, 0x8F, 0x0B, 0xFC, 0x61, 0x05,
];
/// Bytes of the signature and the IHDR chunk.
const HEADER_LEN: usize = 33;
/// Sixteen bits for each step of eight: 255 becomes 65535.
const STEP: u16 = 257;

/// Radiance as it is shown, with its legend on the right where its colors are false.
pub(super) fn shown(radiance: &Radiance, params: &DisplayParams, legend: Option<Legend>) -> RgbImage {
    let rgb = encode(radiance, params).chunks_exact(4).flat_map(|rgba| [rgba[0], rgba[1], rgba[2]]).collect();
    let picture = RgbImage::from_raw(radiance.width, radiance.height, rgb).expect("three bytes per pixel");
    match legend {
        Some(legend) => legend.beside(&picture),
        None => picture,
    }
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
        (PngDepth::Sixteen, Some(_)) => {
            let sheet = shown(radiance, params, legend);
            let mut deep_sheet = ImageBuffer::from_fn(sheet.width(), sheet.height(), |x, y| {
                Rgb(sheet.get_pixel(x, y).0.map(|byte| u16::from(byte) * STEP))
            });
            image::imageops::replace(&mut deep_sheet, &deep(), 0, 0);
            deep_sheet.into()
        }
    }
}

/// The file of a display-encoded picture.
///
/// # Errors
/// If the encoder refuses its size.
pub fn png_bytes(picture: &DynamicImage) -> Result<Vec<u8>> {
    let mut png = Vec::new();
    picture.write_with_encoder(PngEncoder::new(&mut png))?;
    png.splice(HEADER_LEN..HEADER_LEN, SRGB_CHUNKS);
    Ok(png)
}
