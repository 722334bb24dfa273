//! OpenEXR of a measured stack: one layer, in its display window.

use std::io::{BufRead, Cursor, Seek};

use exr::image::read::specific_channels::ReadSpecificChannel;
use exr::meta::header::Header;
use exr::prelude::{MetaData, ReadChannels, ReadLayers, Vec2};

use super::pixels::{Picture, check_size, of_file};
use crate::import::channels::{self, Channels};

/// Where the picture of a file lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct ExrLayer {
    /// The picture: the display window.
    size: [u32; 2],
    /// Where the stored pixels begin in it.
    offset: [i64; 2],
}

/// Width and height from the head of a file.
pub(super) fn exr_size(file: impl BufRead + Seek) -> Result<[u32; 2], String> {
    Ok(exr_layer(&exr_headers(file)?)?.0.size)
}

fn exr_headers(file: impl BufRead + Seek) -> Result<Vec<Header>, String> {
    Ok(MetaData::read_from_buffered(file, false).map_err(of_exr)?.headers.into_vec())
}

/// The layer that is the picture, and its channels.
#[expect(clippy::cast_possible_truncation, reason = "sides and places of at most `MAX_PIXELS` pixels")]
fn exr_layer(headers: &[Header]) -> Result<(ExrLayer, Channels), String> {
    let (header, channels) = channels::of_picture(headers)?;
    let (stored, shown) = (header.layer_size, header.shared_attributes.display_window);
    for size in [stored, shown.size] {
        let side = |side: usize| u32::try_from(side).unwrap_or(u32::MAX);
        check_size([side(size.width()), side(size.height())], u64::MAX)?;
    }
    let at = header.own_attributes.layer_position;
    #[expect(clippy::arithmetic_side_effects, reason = "a difference of two 32-bit numbers")]
    let offset = |stored: i32, shown: i32| i64::from(stored) - i64::from(shown);
    let layer = ExrLayer {
        size: [shown.size.width() as u32, shown.size.height() as u32],
        offset: [offset(at.x(), shown.position.x()), offset(at.y(), shown.position.y())],
    };
    Ok((layer, channels))
}

/// The pixels of a display window; those that the file does not store are black.
struct Canvas {
    layer: ExrLayer,
    pixels: Vec<[f32; 3]>,
}

impl Canvas {
    #[expect(clippy::arithmetic_side_effects, reason = "`check_size` has multiplied them")]
    fn new(layer: ExrLayer) -> Canvas {
        Canvas { layer, pixels: vec![[0.0; 3]; layer.size[0] as usize * layer.size[1] as usize] }
    }

    #[expect(
        clippy::arithmetic_side_effects,
        reason = "places and offsets are below 2^33, and the index is within the window"
    )]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "sides and places of at most `MAX_PIXELS` pixels"
    )]
    fn set(&mut self, at: Vec2<usize>, pixel: [f32; 3]) {
        let ExrLayer { size: [width, height], offset, .. } = self.layer;
        let (x, y) = (at.x() as i64 + offset[0], at.y() as i64 + offset[1]);
        if (0..i64::from(width)).contains(&x) && (0..i64::from(height)).contains(&y) {
            self.pixels[y as usize * width as usize + x as usize] = pixel;
        }
    }
}

/// The picture, each value as it is stored.
pub(super) fn decode_exr(bytes: &[u8]) -> Result<Picture, String> {
    let (layer, channels) = exr_layer(&exr_headers(Cursor::new(bytes))?)?;
    let levels = exr::prelude::read().no_deep_data().largest_resolution_level().specific_channels();
    // Other channels are passed over, however many there are. Pictures are read side by side, not each by many threads.
    let canvas = match channels {
        Channels::Gray(y) => {
            let gray = |canvas: &mut Canvas, at: Vec2<usize>, (y,): (f32,)| canvas.set(at, [y; 3]);
            let channels = levels.required(y).collect_pixels(|_, _| Canvas::new(layer), gray);
            let image = channels.first_valid_layer().all_attributes().non_parallel().from_buffered(Cursor::new(bytes));
            image.map_err(of_exr)?.layer_data.channel_data.pixels
        }
        Channels::Color([r, g, b]) => {
            let color = |canvas: &mut Canvas, at: Vec2<usize>, (r, g, b): (f32, f32, f32)| canvas.set(at, [r, g, b]);
            let channels = levels.required(r).required(g).required(b);
            let channels = channels.collect_pixels(|_, _| Canvas::new(layer), color);
            let image = channels.first_valid_layer().all_attributes().non_parallel().from_buffered(Cursor::new(bytes));
            image.map_err(of_exr)?.layer_data.channel_data.pixels
        }
    };
    Ok(Picture { size: layer.size, pixels: canvas.pixels, was_encoded: false })
}

/// What a decoder says of an OpenEXR.
fn of_exr(error: exr::error::Error) -> String {
    match error {
        exr::error::Error::Io(error) => of_file(&error),
        exr::error::Error::Invalid(what) if what.contains("missing bytes") => "it is cut off".into(),
        error => error.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use exr::prelude::{
        AnyChannel, AnyChannels, Encoding, FlatSamples, Image, IntegerBounds, Layer, LayerAttributes, WritableImage,
        f16,
    };

    use super::super::decode_picture;
    use super::*;

    fn exr(channels: Vec<AnyChannel<FlatSamples>>, size: (usize, usize), encoding: Encoding, at: [i32; 2]) -> Vec<u8> {
        let attributes = LayerAttributes { layer_position: Vec2(at[0], at[1]), ..LayerAttributes::default() };
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
        let layered = ["View.AO.", "View.Combined.", "View.Emit."].into_iter().zip([1.0, 2.0, 3.0]);
        let of_layer = |(layer, factor): (&str, f32)| {
            ["R", "G", "B"].map(|color| channel(&format!("{layer}{color}"), &RAMP.map(|value| factor * value)))
        };
        let layered = exr(layered.flat_map(of_layer).collect(), (4, 2), Encoding::UNCOMPRESSED, [0, 0]);
        assert_eq!(decode_picture(&layered).unwrap().pixels[6], [12.0; 3]);
    }

    #[test]
    fn pixels_of_a_data_window_lie_where_the_display_window_has_them() {
        let cut = vec![channel("Y", &[1.0, 2.0, 3.0, 4.0])];
        let picture = decode_picture(&exr(cut, (2, 2), Encoding::UNCOMPRESSED, [3, -1])).unwrap();
        let mut expected = vec![[0.0; 3]; 8];
        expected[3] = [3.0; 3];
        assert_eq!((picture.size, picture.pixels), ([4, 2], expected));
    }

    #[test]
    fn files_without_a_picture_that_can_be_used_are_refused_in_words() {
        let chroma = exr(vec![channel("Y", &RAMP), channel("RY", &RAMP)], (4, 2), Encoding::UNCOMPRESSED, [0, 0]);
        let depth = exr(vec![channel("Z", &RAMP)], (4, 2), Encoding::UNCOMPRESSED, [0, 0]);
        let gray = exr(vec![channel("Y", &RAMP)], (4, 2), Encoding::UNCOMPRESSED, [0, 0]);
        let cases: [(&[u8], &str); 4] = [
            (&chroma, "luminance and chroma"),
            (&depth, "but Z"),
            (&gray[..gray.len() - 9], "it is cut off"),
            (&gray[..60], "it is cut off"),
        ];
        for (bytes, words) in cases {
            let said = decode_picture(bytes).expect_err(words);
            assert!(said.contains(words), "{said} should say {words:?}");
        }
    }
}
