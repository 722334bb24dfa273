//! Small pictures of the page: several beside each other, named, as JPEG.

use anyhow::{Context, Result};
use clerestory::contact_sheet::{Print, contact_sheet};
use clerestory_relight::{DisplayParams, Radiance, encode};
use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;

/// A picture is white where it is as bright as this share of the first one's pixels is not.
const WHITE_QUANTILE: f64 = 0.98;
const QUALITY: u8 = 80;

/// Pictures as the bytes of one JPEG, all exposed alike: so that the first one is well exposed.
///
/// # Errors
/// If they cannot be encoded.
pub fn jpeg(pictures: &[(&str, Radiance)]) -> Result<Vec<u8>> {
    let mut values: Vec<f32> = pictures.first().map_or(&[][..], |(_, first)| &first.pixels).as_flattened().to_vec();
    values.sort_by(f32::total_cmp);
    let white = values.get((values.len() as f64 * WHITE_QUANTILE) as usize).copied().unwrap_or(1.0);
    jpeg_below(white, pictures)
}

/// The same with white given, as radiance.
///
/// # Errors
/// As [`jpeg`].
pub fn jpeg_below(white: f32, pictures: &[(&str, Radiance)]) -> Result<Vec<u8>> {
    let display = DisplayParams { exposure_ev: -white.max(f32::MIN_POSITIVE).log2(), ..DisplayParams::default() };
    let print = |(name, picture): &(&str, Radiance)| {
        let bytes = encode(picture, &display);
        let rgb = bytes.as_chunks::<4>().0.iter().flat_map(|[r, g, b, _]| [*r, *g, *b]).collect();
        let picture = RgbImage::from_raw(picture.width, picture.height, rgb).context("a picture has all its pixels")?;
        Ok(Print { name: (*name).into(), picture })
    };
    let sheet = contact_sheet(&pictures.iter().map(print).collect::<Result<Vec<_>>>()?);
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, QUALITY).encode_image(&sheet).context("cannot encode a small picture")?;
    Ok(bytes)
}

/// How far two pictures of one size are from each other, times a factor.
pub fn difference(a: &Radiance, b: &Radiance, factor: f32) -> Radiance {
    let pixel = |(a, b): (&[f32; 3], &[f32; 3])| std::array::from_fn(|c| factor * (a[c] - b[c]).abs());
    Radiance { pixels: a.pixels.iter().zip(&b.pixels).map(pixel).collect(), ..*a }
}

/// Each pixel the mean of `side` × `side`; what is left over at the right and below is left out.
pub fn averaged(picture: &Radiance, side: usize) -> Radiance {
    let (width, height) = (picture.width as usize / side, picture.height as usize / side);
    let mean = |nth: usize| {
        let first = nth / width * side * picture.width as usize + nth % width * side;
        let rows = (0..side).flat_map(|row| &picture.pixels[first + row * picture.width as usize..][..side]);
        let sum = rows.fold([0.0; 3], |sum: [f32; 3], rgb| std::array::from_fn(|c| sum[c] + rgb[c]));
        sum.map(|x| x / (side * side) as f32)
    };
    Radiance { width: width as u32, height: height as u32, pixels: (0..width * height).map(mean).collect() }
}

/// Each pixel as a square of `side` × `side`.
pub fn enlarged(picture: &Radiance, side: usize) -> Radiance {
    let (width, height) = (picture.width as usize * side, picture.height as usize * side);
    let at = |nth: usize| picture.pixels[nth / width / side * picture.width as usize + nth % width / side];
    Radiance { width: width as u32, height: height as u32, pixels: (0..width * height).map(at).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_reduced_to_means_and_enlarged_by_whole_pixels() {
        let picture = Radiance { width: 5, height: 2, pixels: (0..10).map(|i| [i as f32, 1.0, 2.0]).collect() };
        let small = averaged(&picture, 2);
        assert_eq!((small.width, small.height), (2, 1));
        assert_eq!(small.pixels, [[3.0, 1.0, 2.0], [5.0, 1.0, 2.0]]);
        let large = enlarged(&small, 3);
        assert_eq!((large.width, large.height), (6, 3));
        assert!((0..18).all(|nth| large.pixels[nth] == small.pixels[nth % 6 / 3]));
        assert_eq!(averaged(&large, 3).pixels, small.pixels);
    }
}
