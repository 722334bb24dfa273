//! Radiance pictures in the unit that their heads tell.

use std::io::Cursor;

use image::ImageDecoder;
use image::codecs::hdr::HdrDecoder;

use super::files::of_image;

/// Width, height and linear pixels, row by row from the top left. Values are stored times all `EXPOSURE` and `COLORCORR` of the
/// head, and divided by them here. Nothing is allocated before the size was checked.
///
/// # Errors
/// What is wrong with it, in words.
#[expect(clippy::cast_possible_truncation, reason = "bytes of a picture whose size was checked")]
pub(super) fn decode(
    bytes: &[u8],
    check: impl FnOnce([u32; 2]) -> Result<(), String>,
) -> Result<([u32; 2], Vec<[f32; 3]>), String> {
    // Strictly its head would begin with `#?RADIANCE`; `#?RGBE` is as common.
    let decoder = HdrDecoder::new_nonstrict(Cursor::new(bytes)).map_err(of_image)?;
    let size = decoder.dimensions().into();
    check(size)?;
    let head = decoder.metadata();
    let (exposure, (red, green, blue)) =
        (head.exposure.unwrap_or(1.0), head.color_correction.unwrap_or((1.0, 1.0, 1.0)));
    let factors = [exposure * red, exposure * green, exposure * blue];
    if !factors.iter().all(|factor| factor.is_finite() && *factor > 0.0) {
        return Err(format!(
            "its head tells an exposure of {exposure} and a color correction of {red} {green} {blue}, by which nothing can be divided"
        ));
    }
    let mut raw = vec![0u8; decoder.total_bytes() as usize];
    decoder.read_image(&mut raw).map_err(of_image)?;
    let value = |b: &[u8]| f32::from_ne_bytes([b[0], b[1], b[2], b[3]]);
    let pixel = |b: &[u8]| [value(b) / factors[0], value(&b[4..]) / factors[1], value(&b[8..]) / factors[2]];
    Ok((size, raw.chunks_exact(12).map(pixel).collect()))
}
