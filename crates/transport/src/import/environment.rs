//! Equirectangular .hdr and .exr files into maps of the sky.

use std::io::Cursor;
use std::path::Path;

use exr::image::read::specific_channels::ReadSpecificChannel;
use exr::prelude::{MetaData, ReadChannels, ReadLayers, Vec2};
use image::ImageDecoder;
use image::codecs::hdr::HdrDecoder;

use super::channels::{self, Channels};
use super::files::{guarded, read_at_most};
use crate::sky::{Cleaned, Environment, SkyError};

/// Largest file that is read.
const MAX_FILE_BYTES: u64 = 1 << 30;

/// Reads a map of the sky, and says in words what is odd about it.
///
/// # Errors
/// A file that cannot be read, is neither .hdr nor .exr, or is too large.
pub fn load_sky(path: &Path) -> Result<(Environment, Vec<String>), SkyError> {
    let name = path.display().to_string();
    let read = |source| SkyError::Read { path: name.clone(), source };
    let bytes = read_at_most(path, MAX_FILE_BYTES).map_err(read)?;
    decode_sky(&name, &bytes)
}

/// The same from memory; `name` is for people.
///
/// # Errors
/// As [`load_sky`].
pub fn decode_sky(name: &str, bytes: &[u8]) -> Result<(Environment, Vec<String>), SkyError> {
    let refuse = |reason: String| SkyError::Decode { path: name.into(), reason };
    let (width, height, pixels) = match () {
        () if bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]) => guarded(|| decode_exr(bytes)).map_err(refuse)?,
        () if bytes.starts_with(b"#?") => guarded(|| decode_hdr(bytes)).map_err(refuse)?,
        () => return Err(refuse("it is neither Radiance nor OpenEXR".into())),
    };
    let (map, Cleaned { n_black, n_capped }) = Environment::new(width, height, pixels)?;
    let mut warnings = Vec::new();
    if n_black > 0 {
        warnings.push(format!("{name}: {n_black} pixels were negative or no numbers; they are black there"));
    }
    if n_capped > 0 {
        warnings.push(format!(
            "{name}: {n_capped} pixels were brighter than the file could hold; a sun among them is darker than it was"
        ));
    }
    if Some(width) != height.checked_mul(2) {
        warnings
            .push(format!("{name}: {width}×{height} pixels are not twice as wide as high; shown as equirectangular"));
    }
    Ok((map, warnings))
}

type Decoded = Result<(usize, usize, Vec<[f32; 3]>), String>;

/// More pixels than a byte of a compressed file stands for.
const MAX_PIXELS_PER_BYTE: usize = 1024;

#[expect(clippy::arithmetic_side_effects, reason = "`is_size` holds where they are multiplied")]
fn too_large(width: usize, height: usize, n_bytes: usize) -> Option<String> {
    match Environment::is_size(width, height) {
        false => Some(SkyError::Size { width, height }.to_string()),
        true if width * height > n_bytes.saturating_mul(MAX_PIXELS_PER_BYTE) => {
            Some(format!("{width}×{height} pixels cannot be in {n_bytes} bytes"))
        }
        true => None,
    }
}

fn decode_hdr(bytes: &[u8]) -> Decoded {
    // Strictly its head would begin with `#?RADIANCE`; `#?RGBE` is as common.
    let decoder = HdrDecoder::new_nonstrict(Cursor::new(bytes)).map_err(|e| e.to_string())?;
    let (width, height) = decoder.dimensions();
    let (width, height) = (width as usize, height as usize);
    if let Some(problem) = too_large(width, height, bytes.len()) {
        return Err(problem);
    }
    #[expect(clippy::arithmetic_side_effects, reason = "not too large")]
    let mut raw = vec![0u8; width * height * 12];
    decoder.read_image(&mut raw).map_err(|e| e.to_string())?;
    let value = |b: &[u8]| f32::from_ne_bytes([b[0], b[1], b[2], b[3]]);
    let pixels = raw.chunks_exact(12).map(|b| [value(b), value(&b[4..]), value(&b[8..])]).collect();
    Ok((width, height, pixels))
}

#[expect(clippy::arithmetic_side_effects, reason = "not too large, and pixels are within their layer")]
fn decode_exr(bytes: &[u8]) -> Decoded {
    // Sizes are known before anything is allocated for the pixels.
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(|e| e.to_string())?;
    for header in &meta.headers {
        if let Some(problem) = too_large(header.layer_size.width(), header.layer_size.height(), bytes.len()) {
            return Err(problem);
        }
    }
    let (_, channels) = channels::of_picture(&meta.headers)?;
    // Other channels are passed over, however many there are.
    let levels = exr::prelude::read().no_deep_data().largest_resolution_level().specific_channels();
    let black = |size: Vec2<usize>| (size.width(), vec![[0.0; 3]; size.area()]);
    let set = |(width, pixels): &mut (usize, Vec<[f32; 3]>), at: Vec2<usize>, pixel| {
        pixels[at.y() * *width + at.x()] = pixel;
    };
    let (size, (_, pixels)) = match channels {
        Channels::Gray(y) => {
            let channels =
                levels.required(y).collect_pixels(|size, _| black(size), move |map, at, (y,)| set(map, at, [y; 3]));
            let image = channels.first_valid_layer().all_attributes().from_buffered(Cursor::new(bytes));
            let layer = image.map_err(|e| e.to_string())?.layer_data;
            (layer.size, layer.channel_data.pixels)
        }
        Channels::Color([r, g, b]) => {
            let channels = levels.required(r).required(g).required(b);
            let channels =
                channels.collect_pixels(|size, _| black(size), move |map, at, (r, g, b)| set(map, at, [r, g, b]));
            let image = channels.first_valid_layer().all_attributes().from_buffered(Cursor::new(bytes));
            let layer = image.map_err(|e| e.to_string())?.layer_data;
            (layer.size, layer.channel_data.pixels)
        }
    };
    Ok((size.width(), size.height(), pixels))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pixels of 1, 2 and 4 nit in flat Radiance encoding: mantissa · 2^(exponent − 136).
    fn hdr() -> Vec<u8> {
        let mut bytes = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n".to_vec();
        for _ in 0..8 {
            bytes.extend([32, 64, 128, 131]);
        }
        bytes
    }

    #[test]
    fn radiance_files_are_read_in_nit() {
        let (map, warnings) = decode_sky("a.hdr", &hdr()).unwrap();
        assert_eq!((map.width(), map.height()), (4, 2));
        assert!(warnings.is_empty(), "{warnings:?}");
        for (value, expected) in map.pixels()[5].into_iter().zip([1.0, 2.0, 4.0]) {
            assert!((value - expected).abs() < 0.02 * expected, "{:?}", map.pixels()[5]);
        }
    }

    #[test]
    fn exr_files_are_read_as_they_are_written_and_broken_pixels_are_reported() {
        use exr::prelude::WritableImage;
        let value = |x: usize, y: usize| if (x, y) == (1, 1) { f32::NAN } else { (x + 10 * y) as f32 };
        let channels = exr::prelude::SpecificChannels::rgb(|at: exr::prelude::Vec2<usize>| {
            let v = value(at.x(), at.y());
            (v, 2.0 * v, 4.0 * v)
        });
        let mut bytes = Cursor::new(Vec::new());
        exr::prelude::Image::from_channels((4, 2), channels).write().to_buffered(&mut bytes).unwrap();
        let (map, warnings) = decode_sky("a.exr", bytes.get_ref()).unwrap();
        assert_eq!(map.pixels()[6], [12.0, 24.0, 48.0]);
        assert_eq!(map.pixels()[5], [0.0; 3]);
        assert!(warnings.len() == 1 && warnings[0].contains("1 pixels"), "{warnings:?}");
    }

    #[test]
    fn radiance_files_of_other_programs_are_read() {
        let (known, _) = decode_sky("a.hdr", &hdr()).unwrap();
        for signature in ["#?RGBE", "#?AUTOPANO", "#?RADIANCE 2.0"] {
            let bytes = [signature.as_bytes(), &hdr()["#?RADIANCE".len()..]].concat();
            assert!(decode_sky("a.hdr", &bytes).unwrap().0 == known, "{signature}");
        }
    }

    /// Channels by name, each of two pixels.
    fn exr(channels: &[(&str, [f32; 2])]) -> Vec<u8> {
        use exr::prelude::{AnyChannel, AnyChannels, FlatSamples, Image, WritableImage};
        let channel = |(name, values): &(&str, [f32; 2])| AnyChannel::new(*name, FlatSamples::F32(values.to_vec()));
        let mut bytes = Cursor::new(Vec::new());
        let channels = AnyChannels::sort(channels.iter().map(channel).collect());
        Image::from_channels((2, 1), channels).write().to_buffered(&mut bytes).unwrap();
        bytes.into_inner()
    }

    #[test]
    fn exr_files_in_gray_and_in_layers_are_read() {
        let color = |layer: &'static str, value: f32| {
            let of = |color: &str| -> &'static str { format!("{layer}{color}").leak() };
            [(of("R"), [value; 2]), (of("G"), [2.0 * value; 2]), (of("B"), [4.0 * value; 2])]
        };
        let blender = [color("ViewLayer.AO.", 7.0), color("ViewLayer.Combined.", 1.0), color("ViewLayer.Emit.", 9.0)];
        let plain = [color("", 1.0), color("A.", 5.0)];
        for (channels, expected) in [
            (&[("Y", [3.0; 2])][..], [3.0; 3]),
            (&blender.concat(), [1.0, 2.0, 4.0]),
            (&[&color("beauty.", 1.0)[..], &[("Z", [8.0; 2])]].concat(), [1.0, 2.0, 4.0]),
            (&plain.concat(), [1.0, 2.0, 4.0]),
        ] {
            let (map, _) = decode_sky("a.exr", &exr(channels)).unwrap();
            assert_eq!(map.pixels(), [expected; 2], "{channels:?}");
        }
        let error = decode_sky("a.exr", &exr(&[("Z", [1.0; 2])])).unwrap_err().to_string();
        assert!(error.contains("but Z"), "{error}");
    }

    #[test]
    fn a_sun_that_overflowed_is_bright_and_told_of() {
        let (map, warnings) = decode_sky("a.exr", &exr(&[("Y", [1.0, f32::INFINITY])])).unwrap();
        assert_eq!(map.pixels(), [[1.0; 3], [65504.0; 3]]);
        assert!(warnings.len() == 1 && warnings[0].contains("1 pixels were brighter"), "{warnings:?}");
    }

    #[test]
    fn files_that_are_no_skies_are_refused_in_words() {
        let hdr = hdr();
        let huge = String::from_utf8_lossy(&hdr[..hdr.len() - 32]).replace("-Y 2 +X 4", "-Y 60000 +X 60000");
        for (bytes, words) in [
            (&b"GIF89a"[..], "neither"),
            (&hdr[..hdr.len() - 20], "cannot use"),
            (&hdr[..12], "cannot use"),
            (huge.as_bytes(), "60000"),
            (&[0x76, 0x2f, 0x31, 0x01, 2, 0, 0, 0], "cannot use"),
        ] {
            let error = decode_sky("x", bytes).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
        assert!(matches!(load_sky(Path::new("/nowhere/a.hdr")), Err(SkyError::Read { .. })));
    }
}
