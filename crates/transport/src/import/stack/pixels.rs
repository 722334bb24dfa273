//! Pictures as linear numbers: OpenEXR and Radiance as they are, PNG and JPEG through the curve of sRGB \[IEC61966-2-1\].

use std::io::{BufRead, Cursor, Seek, SeekFrom};

use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageReader, Limits};

use super::MAX_PIXELS;
use crate::camera::Film;
use crate::import::files::{check_pixels, guarded, of_file, of_image};
use crate::import::jpeg;
use crate::import::openexr::{self, Threads, Wanted};
use crate::import::radiance::{self, RadiancePicture};
use crate::texture::srgb_to_linear;

/// Most bytes that decoding one picture may take beside its pixels.
const MAX_DECODE_BYTES: u64 = 1 << 30;

/// A picture in memory.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Linear red, green and blue, row by row from the top left.
    pub pixels: Vec<[f32; 3]>,
    /// Whether the values of the file were display-encoded.
    pub was_encoded: bool,
    /// What is odd about its colors, in words.
    pub remark: Option<String>,
}

impl Picture {
    /// Refuses a picture with pixels of which no sum has a value.
    ///
    /// # Errors
    /// How many of them are infinite or no numbers, and where the first one is, in words.
    pub fn check_finite(&self) -> Result<(), String> {
        let is_finite = |pixel: &[f32; 3]| pixel.iter().all(|value| value.is_finite());
        let Some(first) = self.pixels.iter().position(|pixel| !is_finite(pixel)) else { return Ok(()) };
        let n_bad = self.pixels.iter().filter(|pixel| !is_finite(pixel)).count();
        let width = self.size[0] as usize;
        #[expect(clippy::arithmetic_side_effects, reason = "a picture with pixels is wider than 0")]
        let (x, y) = (first % width, first / width);
        Err(format!(
            "{n_bad} of its pixels are infinite or no numbers, the first of them at ({x}, {y}) from the top left; \
             no sum with them has a value"
        ))
    }
}

/// The kinds of picture, told by their first bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    OpenExr,
    Radiance,
    Encoded,
}

fn kind_of(start: &[u8]) -> Result<Kind, String> {
    match start {
        [0x76, 0x2f, 0x31, 0x01, ..] => Ok(Kind::OpenExr),
        [b'#', b'?', ..] => Ok(Kind::Radiance),
        [0x89, b'P', b'N', b'G', ..] | [0xff, 0xd8, 0xff, ..] => Ok(Kind::Encoded),
        _ => Err("it is neither OpenEXR, Radiance, PNG nor JPEG, whatever its name says".into()),
    }
}

/// Width and height from the head of a file of so many bytes.
pub(super) fn size(mut file: impl BufRead + Seek, n_bytes: u64) -> Result<[u32; 2], String> {
    let start = file.fill_buf().map_err(|e| of_file(&e))?;
    let kind = kind_of(start)?;
    file.seek(SeekFrom::Start(0)).map_err(|e| of_file(&e))?;
    let size = guarded(|| match kind {
        Kind::OpenExr => openexr::windows(file, &|size| check_size(size, u64::MAX)).map(|windows| windows.shown),
        Kind::Radiance => radiance::size(file),
        Kind::Encoded => {
            let reader = ImageReader::new(file).with_guessed_format().map_err(|e| of_file(&e))?;
            let mut decoder = reader.into_decoder().map_err(of_image)?;
            let ((width, height), held) = (decoder.dimensions(), decoder.orientation().map_err(of_image)?);
            Ok(if is_on_its_side(held) { [height, width] } else { [width, height] })
        }
    })?;
    check_size(size, n_bytes)?;
    Ok(size)
}

/// Decodes a picture; every size is checked before anything is allocated for it.
///
/// # Errors
/// What is wrong with it, in words.
pub fn decode_picture(bytes: &[u8]) -> Result<Picture, String> {
    jpeg::check_whole(bytes)?;
    size(Cursor::new(bytes), bytes.len() as u64)?;
    guarded(|| match kind_of(bytes)? {
        Kind::OpenExr => {
            // Pictures of a stack are read side by side.
            let check = |size| check_size(size, u64::MAX);
            let openexr::ExrPicture { size, pixels, remark, .. } =
                openexr::decode(bytes, Wanted::Shown, Threads::One, &check)?;
            Ok(Picture { size, pixels, was_encoded: false, remark })
        }
        Kind::Radiance => {
            let RadiancePicture { size, pixels, remark, .. } = radiance::decode(bytes, |_| Ok(()))?;
            Ok(Picture { size, pixels, was_encoded: false, remark })
        }
        Kind::Encoded => decode_encoded(bytes),
    })
}

/// Whether a picture is as wide as its file is high: its camera was held so.
fn is_on_its_side(held: Orientation) -> bool {
    use Orientation::{Rotate90, Rotate90FlipH, Rotate270, Rotate270FlipH};
    matches!(held, Rotate90 | Rotate90FlipH | Rotate270 | Rotate270FlipH)
}

/// Within what a stack may hold, and what so many bytes may.
fn check_size([width, height]: [u32; 2], n_bytes: u64) -> Result<(), String> {
    #[expect(clippy::arithmetic_side_effects, reason = "a product of two 32-bit numbers")]
    let n_pixels = u64::from(width) * u64::from(height);
    match () {
        () if n_pixels == 0 => Err("it is empty".into()),
        () if width.max(height) > Film::MAX_SIDE || n_pixels > MAX_PIXELS => Err(format!(
            "its {width} × {height} pixels are too many, at most {MAX_PIXELS} in all and {} to a side",
            Film::MAX_SIDE
        )),
        () => check_pixels([width, height], n_bytes),
    }
}

/// PNG and JPEG of 8 or 16 bits, upright however the camera was held; what is transparent keeps its color.
fn decode_encoded(bytes: &[u8]) -> Result<Picture, String> {
    let mut reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(|e| of_file(&e))?;
    let mut limits = Limits::default();
    limits.max_alloc = Some(MAX_DECODE_BYTES);
    reader.limits(limits.clone());
    let mut decoder = reader.into_decoder().map_err(of_image)?;
    limits.reserve(decoder.total_bytes()).map_err(of_image)?;
    decoder.set_limits(limits).map_err(of_image)?;
    let held = decoder.orientation().map_err(of_image)?;
    let mut picture = DynamicImage::from_decoder(decoder).map_err(of_image)?;
    picture.apply_orientation(held);
    let size = [picture.width(), picture.height()];
    let pixels = match picture {
        DynamicImage::ImageLuma16(_)
        | DynamicImage::ImageLumaA16(_)
        | DynamicImage::ImageRgb16(_)
        | DynamicImage::ImageRgba16(_) => {
            let curve = curve(u16::MAX);
            picture.into_rgb16().pixels().map(|rgb| rgb.0.map(|code| curve[usize::from(code)])).collect()
        }
        _ => {
            let curve = curve(u16::from(u8::MAX));
            picture.into_rgb8().pixels().map(|rgb| rgb.0.map(|code| curve[usize::from(code)])).collect()
        }
    };
    Ok(Picture { size, pixels, was_encoded: true, remark: None })
}

/// Linear light of each code up to the greatest, which is 1.
#[expect(clippy::cast_possible_truncation, reason = "bytes of at most `MAX_PIXELS` pixels; colors in single precision")]
fn curve(greatest: u16) -> Vec<f32> {
    (0..=greatest).map(|code| srgb_to_linear(f64::from(code) / f64::from(greatest)) as f32).collect()
}

#[cfg(test)]
mod tests {
    use image::{ImageBuffer, ImageFormat, Luma, Rgb, Rgba};

    use super::*;

    fn encoded(picture: impl Into<DynamicImage>, format: ImageFormat) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        picture.into().write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    }

    #[test]
    fn the_curve_of_srgb_is_taken_off_eight_and_sixteen_bits() {
        // IEC 61966-2-1 by hand: a code in the linear part, one beyond it, and the ends.
        let known = |code: f64| if code <= 0.04045 { code / 12.92 } else { ((code + 0.055) / 1.055).powf(2.4) };
        let eight = ImageBuffer::from_pixel(1, 1, Rgb([8u8, 128, 255]));
        let sixteen = ImageBuffer::from_pixel(1, 1, Rgb([2056u16, 32896, 65535]));
        let expected = [8.0 / 255.0, 128.0 / 255.0, 1.0].map(|code| known(code) as f32);
        assert!((expected[0] - 0.002_428).abs() < 1e-6 && (expected[1] - 0.215_861).abs() < 1e-6, "{expected:?}");
        for bytes in [encoded(eight, ImageFormat::Png), encoded(sixteen, ImageFormat::Png)] {
            let picture = decode_picture(&bytes).unwrap();
            assert!(picture.was_encoded);
            for (value, expected) in picture.pixels[0].into_iter().zip(expected) {
                assert!((value - expected).abs() <= 1e-7 * expected, "{:?} {expected:?}", picture.pixels);
            }
        }
    }

    #[test]
    fn gray_and_transparent_pictures_have_three_channels() {
        let gray = ImageBuffer::from_pixel(3, 2, Luma([255u8]));
        let deep = ImageBuffer::from_pixel(3, 2, Luma([65535u16]));
        let clear = ImageBuffer::from_pixel(3, 2, Rgba([255u8, 255, 255, 0]));
        let jpeg = encoded(ImageBuffer::from_pixel(3, 2, Rgb([255u8; 3])), ImageFormat::Jpeg);
        let png = |picture: DynamicImage| encoded(picture, ImageFormat::Png);
        for bytes in [png(gray.into()), png(deep.into()), png(clear.into()), jpeg] {
            let picture = decode_picture(&bytes).unwrap();
            assert_eq!((picture.size, picture.pixels), ([3, 2], vec![[1.0; 3]; 6]));
        }
    }

    /// A JPEG that says how its camera was held, by the number that Exif has for it.
    fn held(jpeg: &[u8], orientation: u8) -> Vec<u8> {
        let segment = [&[0xffu8, 0xe1, 0, 34][..], &b"Exif\0\0"[..]].concat();
        let one_entry = [b'I', b'I', 42, 0, 8, 0, 0, 0, 1, 0, 0x12, 0x01, 3, 0, 1, 0, 0, 0, orientation];
        [&jpeg[..2], &segment[..], &one_entry[..], &[0u8; 7][..], &jpeg[2..]].concat()
    }

    #[test]
    fn a_picture_stands_upright_however_its_camera_was_held() {
        let lying = ImageBuffer::from_fn(16, 8, |x, _| Rgb([if x < 8 { 255u8 } else { 0 }; 3]));
        let jpeg = encoded(lying, ImageFormat::Jpeg);
        let cases = [
            (1, [16, 8], [2, 4]),
            (2, [16, 8], [13, 4]),
            (3, [16, 8], [13, 4]),
            (6, [8, 16], [4, 2]),
            (8, [8, 16], [4, 13]),
        ];
        for (orientation, [width, height], [x, y]) in cases {
            let bytes = held(&jpeg, orientation);
            let picture = decode_picture(&bytes).unwrap();
            let told = size(Cursor::new(&bytes), bytes.len() as u64).unwrap();
            assert_eq!((picture.size, told), ([width, height], [width, height]), "{orientation}");
            let at = |x: u32, y: u32| picture.pixels[(y * width + x) as usize][0];
            let [white, black] = [at(x, y), at(width - 1 - x, height - 1 - y)];
            assert!(white > 0.9 && black < 0.1, "{orientation}: {white} {black}");
        }
    }

    /// Pixels of 1, 2 and 4 in flat Radiance encoding: mantissa · 2^(exponent − 136).
    fn hdr(head: &str) -> Vec<u8> {
        let mut bytes = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n{head}\n-Y 2 +X 4\n").into_bytes();
        (0..8).for_each(|_| bytes.extend([32, 64, 128, 131]));
        bytes
    }

    #[test]
    fn radiance_is_divided_by_its_exposure_and_color_correction() {
        for (head, factors) in [
            ("", [1.0; 3]),
            ("EXPOSURE=2\nEXPOSURE=4\n", [0.125; 3]),
            ("EXPOSURE=2\nCOLORCORR=2 1 0.5\nCOLORCORR=1 1 2\n", [0.25, 0.5, 0.5]),
        ] {
            let picture = decode_picture(&hdr(head)).unwrap();
            for ((value, expected), factor) in picture.pixels[7].into_iter().zip([1.0, 2.0, 4.0]).zip(factors) {
                assert!((value - factor * expected).abs() < 0.02 * factor * expected, "{:?}", picture.pixels[7]);
            }
            let of_others = [b"#?RGBE", &hdr(head)["#?RADIANCE".len()..]].concat();
            assert_eq!(decode_picture(&of_others).unwrap(), picture);
        }
    }

    #[test]
    fn pictures_that_are_none_are_refused_in_words() {
        let hdr_of = |size: &str| String::from_utf8_lossy(&hdr("")[..60]).replace("-Y 2 +X 4", size);
        let (huge, wide) = (hdr_of("-Y 60000 +X 60000"), hdr_of("-Y 8000 +X 8000"));
        let png = encoded(ImageBuffer::from_pixel(64, 64, Rgb([7u8; 3])), ImageFormat::Png);
        let jpeg = encoded(ImageBuffer::from_pixel(64, 64, Rgb([7u8; 3])), ImageFormat::Jpeg);
        let cases: [(&[u8], &str); 10] = [
            (b"GIF89a", "neither OpenEXR"),
            (b"", "neither OpenEXR"),
            (huge.as_bytes(), "too many"),
            (wide.as_bytes(), "cannot be in"),
            (&hdr("EXPOSURE=0\n"), "exposure of 0"),
            (&hdr("COLORCORR=1 -1 1\n"), "color correction of 1 -1 1"),
            (&hdr("")[..70], "it is cut off"),
            (&png[..png.len() - 30], "it is cut off"),
            (&png[..20], "it is cut off"),
            (&jpeg[..jpeg.len() - 20], "it is cut off"),
        ];
        for (bytes, words) in cases {
            let said = decode_picture(bytes).expect_err(words);
            assert!(said.contains(words), "{said} should say {words:?}");
        }
    }
}
