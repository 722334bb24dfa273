//! Pictures as linear numbers: OpenEXR and Radiance as they are, PNG and JPEG through the curve of sRGB \[IEC61966-2-1\].

use std::io::{self, BufRead, Cursor, Seek, SeekFrom};
use std::panic::{AssertUnwindSafe, catch_unwind};

use exr::image::read::specific_channels::ReadSpecificChannel;
use exr::meta::header::Header;
use exr::prelude::{MetaData, ReadChannels, ReadLayers, Vec2};
use image::codecs::hdr::HdrDecoder;
use image::{DynamicImage, ImageDecoder, ImageReader, Limits};

use super::MAX_PIXELS;
use crate::camera::Film;

/// More pixels than a byte of a compressed file stands for.
const MAX_PIXELS_PER_BYTE: u64 = 1 << 14;
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
        Kind::OpenExr => Ok(exr_layer(&exr_headers(file)?)?.size),
        Kind::Radiance => Ok(HdrDecoder::new(file).map_err(of_image)?.dimensions().into()),
        Kind::Encoded => {
            let reader = ImageReader::new(file).with_guessed_format().map_err(|e| of_file(&e))?;
            Ok(reader.into_dimensions().map_err(of_image)?.into())
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
    let size = size(Cursor::new(bytes), bytes.len() as u64)?;
    guarded(|| match kind_of(bytes)? {
        Kind::OpenExr => decode_exr(bytes),
        Kind::Radiance => decode_hdr(bytes, size),
        Kind::Encoded => decode_encoded(bytes),
    })
}

/// A fault of a decoder is a fault of the file.
fn guarded<T>(decode: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(decode)).unwrap_or_else(|_| Err("its decoder failed".into()))
}

/// What a decoder says of a picture.
fn of_image(error: image::ImageError) -> String {
    match error {
        image::ImageError::IoError(error) => of_file(&error),
        error => error.to_string(),
    }
}

/// What a decoder says of an OpenEXR.
fn of_exr(error: exr::error::Error) -> String {
    match error {
        exr::error::Error::Io(error) => of_file(&error),
        error => error.to_string(),
    }
}

fn of_file(error: &io::Error) -> String {
    if error.kind() == io::ErrorKind::UnexpectedEof { "it is cut off".into() } else { error.to_string() }
}

fn check_size([width, height]: [u32; 2], n_bytes: u64) -> Result<(), String> {
    let n_pixels = u64::from(width) * u64::from(height);
    match () {
        () if n_pixels == 0 => Err("it is empty".into()),
        () if width.max(height) > Film::MAX_SIDE || n_pixels > MAX_PIXELS => Err(format!(
            "its {width} × {height} pixels are too many, at most {MAX_PIXELS} in all and {} to a side",
            Film::MAX_SIDE
        )),
        () if n_pixels > n_bytes.saturating_mul(MAX_PIXELS_PER_BYTE) => {
            Err(format!("{width} × {height} pixels cannot be in {n_bytes} bytes"))
        }
        () => Ok(()),
    }
}

/// Radiance, in the unit that its head tells: values are stored times all its `EXPOSURE`.
fn decode_hdr(bytes: &[u8], size: [u32; 2]) -> Result<Picture, String> {
    let decoder = HdrDecoder::new(Cursor::new(bytes)).map_err(of_image)?;
    let exposure = decoder.metadata().exposure.unwrap_or(1.0);
    if !(exposure.is_finite() && exposure > 0.0) {
        return Err(format!("its head tells an exposure of {exposure}"));
    }
    let mut raw = vec![0u8; decoder.total_bytes() as usize];
    decoder.read_image(&mut raw).map_err(of_image)?;
    let value = |b: &[u8]| f32::from_ne_bytes([b[0], b[1], b[2], b[3]]) / exposure;
    let pixels = raw.chunks_exact(12).map(|b| [value(b), value(&b[4..]), value(&b[8..])]).collect();
    Ok(Picture { size, pixels, was_encoded: false })
}

/// PNG and JPEG of 8 or 16 bits; what is transparent keeps its color.
fn decode_encoded(bytes: &[u8]) -> Result<Picture, String> {
    let mut reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(|e| of_file(&e))?;
    let mut limits = Limits::default();
    limits.max_alloc = Some(MAX_DECODE_BYTES);
    reader.limits(limits);
    let picture = reader.decode().map_err(of_image)?;
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
    Ok(Picture { size, pixels, was_encoded: true })
}

/// Linear light of each code up to the greatest, which is 1.
fn curve(greatest: u16) -> Vec<f32> {
    let linear = |code: u16| {
        let encoded = f64::from(code) / f64::from(greatest);
        if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
    };
    (0..=greatest).map(|code| linear(code) as f32).collect()
}

/// Which layer of a file is read, and what of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct ExrLayer {
    /// The picture: the display window.
    size: [u32; 2],
    /// Where the stored pixels begin in it.
    offset: [i64; 2],
    is_gray: bool,
}

fn exr_headers(file: impl BufRead + Seek) -> Result<Vec<Header>, String> {
    Ok(MetaData::read_from_buffered(file, false).map_err(of_exr)?.headers.into_vec())
}

/// The first layer with channels R, G and B, else with Y alone.
fn exr_layer(headers: &[Header]) -> Result<ExrLayer, String> {
    let has = |header: &Header, name: &str| header.channels.list.iter().any(|channel| channel.name == *name);
    let in_color = |header: &&Header| !header.deep && ["R", "G", "B"].into_iter().all(|name| has(header, name));
    let in_gray = |header: &&Header| !header.deep && has(header, "Y");
    let colored = headers.iter().find(in_color);
    let Some(header) = colored.or_else(|| headers.iter().find(in_gray)) else {
        let names: Vec<String> =
            headers.iter().flat_map(|header| &header.channels.list).take(12).map(|c| c.name.to_string()).collect();
        return Err(format!("it has neither channels R, G and B nor Y, but {}", names.join(", ")));
    };
    let is_gray = colored.is_none();
    if is_gray && has(header, "RY") {
        return Err("it holds luminance and chroma apart; save it with channels R, G and B".into());
    }
    let (stored, shown) = (header.layer_size, header.shared_attributes.display_window);
    for size in [stored, shown.size] {
        let side = |side: usize| u32::try_from(side).unwrap_or(u32::MAX);
        check_size([side(size.width()), side(size.height())], u64::MAX)?;
    }
    let at = header.own_attributes.layer_position;
    let offset = |stored: i32, shown: i32| i64::from(stored) - i64::from(shown);
    Ok(ExrLayer {
        size: [shown.size.width() as u32, shown.size.height() as u32],
        offset: [offset(at.x(), shown.position.x()), offset(at.y(), shown.position.y())],
        is_gray,
    })
}

/// The pixels of a display window; those that the file does not store are black.
struct Canvas {
    layer: ExrLayer,
    pixels: Vec<[f32; 3]>,
}

impl Canvas {
    fn new(layer: ExrLayer) -> Canvas {
        Canvas { layer, pixels: vec![[0.0; 3]; layer.size[0] as usize * layer.size[1] as usize] }
    }

    fn set(&mut self, at: Vec2<usize>, pixel: [f32; 3]) {
        let ExrLayer { size: [width, height], offset, .. } = self.layer;
        let (x, y) = (at.x() as i64 + offset[0], at.y() as i64 + offset[1]);
        if (0..i64::from(width)).contains(&x) && (0..i64::from(height)).contains(&y) {
            self.pixels[y as usize * width as usize + x as usize] = pixel;
        }
    }
}

fn decode_exr(bytes: &[u8]) -> Result<Picture, String> {
    let layer = exr_layer(&exr_headers(Cursor::new(bytes))?)?;
    let levels = exr::prelude::read().no_deep_data().largest_resolution_level();
    // Other channels are passed over, however many there are. Pictures are read side by side, not each by many threads.
    let canvas = if layer.is_gray {
        let gray = |canvas: &mut Canvas, at: Vec2<usize>, (y,): (f32,)| canvas.set(at, [y; 3]);
        let channels = levels.specific_channels().required("Y").collect_pixels(|_, _| Canvas::new(layer), gray);
        let image = channels.first_valid_layer().all_attributes().non_parallel().from_buffered(Cursor::new(bytes));
        image.map_err(of_exr)?.layer_data.channel_data.pixels
    } else {
        let color = |canvas: &mut Canvas, at: Vec2<usize>, (r, g, b): (f32, f32, f32)| canvas.set(at, [r, g, b]);
        let channels = levels.rgb_channels(|_, _| Canvas::new(layer), color);
        let image = channels.first_valid_layer().all_attributes().non_parallel().from_buffered(Cursor::new(bytes));
        image.map_err(of_exr)?.layer_data.channel_data.pixels
    };
    Ok(Picture { size: layer.size, pixels: canvas.pixels, was_encoded: false })
}

#[cfg(test)]
mod tests {
    use exr::prelude::{
        AnyChannel, AnyChannels, Encoding, FlatSamples, Image, IntegerBounds, Layer, LayerAttributes, WritableImage,
        f16,
    };
    use image::{ImageBuffer, ImageFormat, Luma, Rgb, Rgba};

    use super::*;

    fn encoded(picture: impl Into<DynamicImage>, format: ImageFormat) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        picture.into().write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    }

    fn exr(channels: Vec<AnyChannel<FlatSamples>>, size: (usize, usize), encoding: Encoding, at: [i32; 2]) -> Vec<u8> {
        let mut attributes = LayerAttributes::default();
        attributes.layer_position = Vec2(at[0], at[1]);
        let layer = Layer::new(size, attributes, encoding, AnyChannels::sort(channels.into_iter().collect()));
        let mut image = Image::from_layer(layer);
        image.attributes.display_window = IntegerBounds::new((0, 0), (4, 2));
        let mut bytes = Cursor::new(Vec::new());
        image.write().to_buffered(&mut bytes).unwrap();
        bytes.into_inner()
    }

    fn channel(name: &str, values: &[f32]) -> AnyChannel<FlatSamples> {
        AnyChannel::new(name, FlatSamples::F32(values.to_vec()))
    }

    const RAMP: [f32; 8] = [0.0, 1.0, 2.0, -3.0, 4.0, 5.5, 6.0, 1e30];

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

    #[test]
    fn exr_is_read_as_it_is_written_scanlines_and_tiles_half_and_float() {
        let half: Vec<f16> = RAMP.iter().map(|x| f16::from_f32(*x)).collect();
        for encoding in [Encoding::UNCOMPRESSED, Encoding::FAST_LOSSLESS, Encoding::SMALL_LOSSLESS] {
            let rgb = vec![
                channel("R", &RAMP),
                channel("G", &RAMP.map(|x| 0.5 * x)),
                AnyChannel::new("B", FlatSamples::F16(half.clone())),
                channel("A", &[0.5; 8]),
            ];
            let picture = decode_picture(&exr(rgb, (4, 2), encoding, [0, 0])).unwrap();
            assert_eq!((picture.size, picture.was_encoded), ([4, 2], false));
            assert_eq!(picture.pixels[5], [5.5, 2.75, 5.5]);
            assert_eq!(picture.pixels[3], [-3.0, -1.5, -3.0], "negative values stay");
        }
        let gray = decode_picture(&exr(vec![channel("Y", &RAMP)], (4, 2), Encoding::FAST_LOSSLESS, [0, 0])).unwrap();
        assert_eq!(gray.pixels[6], [6.0; 3]);
    }

    #[test]
    fn pixels_of_a_data_window_lie_where_the_display_window_has_them() {
        let cut = vec![channel("Y", &[1.0, 2.0, 3.0, 4.0])];
        let picture = decode_picture(&exr(cut, (2, 2), Encoding::UNCOMPRESSED, [3, -1])).unwrap();
        let mut expected = vec![[0.0; 3]; 8];
        expected[3] = [3.0; 3];
        assert_eq!((picture.size, picture.pixels), ([4, 2], expected));
    }

    /// Pixels of 1, 2 and 4 in flat Radiance encoding: mantissa · 2^(exponent − 136).
    fn hdr(head: &str) -> Vec<u8> {
        let mut bytes = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n{head}\n-Y 2 +X 4\n").into_bytes();
        (0..8).for_each(|_| bytes.extend([32, 64, 128, 131]));
        bytes
    }

    #[test]
    fn radiance_is_divided_by_its_exposure() {
        for (head, factor) in [("", 1.0), ("EXPOSURE=2\nEXPOSURE=4\n", 0.125)] {
            let picture = decode_picture(&hdr(head)).unwrap();
            for (value, expected) in picture.pixels[7].into_iter().zip([1.0, 2.0, 4.0]) {
                assert!((value - factor * expected).abs() < 0.02 * expected, "{:?}", picture.pixels[7]);
            }
        }
    }

    #[test]
    fn pictures_that_are_none_are_refused_in_words() {
        let chroma = exr(vec![channel("Y", &RAMP), channel("RY", &RAMP)], (4, 2), Encoding::UNCOMPRESSED, [0, 0]);
        let depth = exr(vec![channel("Z", &RAMP)], (4, 2), Encoding::UNCOMPRESSED, [0, 0]);
        let color = exr(vec![channel("Y", &RAMP)], (4, 2), Encoding::UNCOMPRESSED, [0, 0]);
        let huge = String::from_utf8_lossy(&hdr("")[..60]).replace("-Y 2 +X 4", "-Y 60000 +X 60000");
        let wide = String::from_utf8_lossy(&hdr("")[..60]).replace("-Y 2 +X 4", "-Y 8000 +X 8000");
        let none = hdr("EXPOSURE=0\n");
        let cases: [(&[u8], &str); 9] = [
            (b"GIF89a", "neither OpenEXR"),
            (b"", "neither OpenEXR"),
            (&chroma, "luminance and chroma"),
            (&depth, "but Z"),
            (&color[..color.len() - 9], "it is cut off"),
            (huge.as_bytes(), "too many"),
            (wide.as_bytes(), "cannot be in"),
            (&none, "exposure of 0"),
            (&hdr("")[..70], "it is cut off"),
        ];
        for (bytes, words) in cases {
            let said = decode_picture(bytes).expect_err(words);
            assert!(said.contains(words), "{said} should say {words:?}");
        }
    }
}
