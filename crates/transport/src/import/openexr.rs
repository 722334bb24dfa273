//! OpenEXR: the layer of a file that is its picture, as it is shown or as it is stored, in linear Rec. 709.

use std::collections::HashSet;
use std::io::{BufRead, Cursor, Seek};
use std::path::Path;

use exr::image::read::specific_channels::ReadSpecificChannel;
use exr::meta::header::Header;
use exr::prelude::{MetaData, ReadChannels, ReadLayers, Vec2};
use glam::{DMat3, Mat3};

use super::channels::{self, Channels};
use super::files::{check_pixels, guarded, of_file, read_at_most};
use super::primaries::{converted, into_rec709};
use super::raster::{Decoded, Raster, Whole, joined};
use crate::camera::Film;
use crate::light::REC709_FROM_XYZ;

/// Largest file that is read.
const MAX_FILE_BYTES: u64 = 4 << 30;

/// The picture of an OpenEXR file.
#[derive(Clone, Debug, PartialEq)]
pub struct ExrPicture {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Linear Rec. 709, row by row from the top left.
    pub pixels: Vec<[f32; 3]>,
    /// Width and height of the display window in pixels.
    pub shown: [u32; 2],
    /// Where the stored pixels begin in it.
    pub offset: [i64; 2],
    /// Whether the file states other primaries, from which the colors were converted.
    pub is_converted: bool,
    /// What is odd about it and was passed over, in words.
    pub remark: Option<String>,
}

/// Which pixels are wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wanted {
    /// Those of the display window; what is not stored is black.
    Shown,
    /// Those of the data window.
    Stored,
}

/// How many threads decode a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Threads {
    /// All of them: it is read alone. Its pixels come in any order.
    Many,
    /// One: others are read beside it, or its pixels are wanted in one and the same order each time.
    One,
}

/// Whether a picture of that width and height may be read.
pub(super) type Check<'a> = &'a dyn Fn([u32; 2]) -> Result<(), String>;

/// Reads what a file stores, its data window, whatever is shown around it.
///
/// # Errors
/// Why it cannot be had, in words.
pub fn read_exr(path: &Path) -> Result<ExrPicture, String> {
    let bytes = read_at_most(path, MAX_FILE_BYTES).map_err(|error| of_file(&error))?;
    let check = |[width, height]: [u32; 2]| {
        if width.max(height) > Film::MAX_SIDE {
            return Err(format!("its {width} × {height} pixels are too many, at most {} to a side", Film::MAX_SIDE));
        }
        check_pixels([width, height], bytes.len() as u64)
    };
    guarded(|| decode(&bytes, Wanted::Stored, Threads::Many, &check))
}

/// Where what a file shows lies, from its head.
pub(super) fn windows(file: impl BufRead + Seek, check: Check) -> Result<Windows, String> {
    Ok(layer(&headers(file)?, Wanted::Shown, check)?.0)
}

fn headers(file: impl BufRead + Seek) -> Result<Vec<Header>, String> {
    Ok(MetaData::read_from_buffered(file, false).map_err(of_exr)?.headers.into_vec())
}

/// Where the picture of a file lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Windows {
    /// Size of the data window.
    pub stored: [u32; 2],
    /// Size of the display window.
    pub shown: [u32; 2],
    /// Where the data window begins in the display window.
    pub offset: [i64; 2],
    /// Size of what is decoded at once, at most.
    pub block: [u32; 2],
}

impl Windows {
    /// Whether any of what is stored is shown.
    #[expect(clippy::arithmetic_side_effects, reason = "sides and offsets are below 2^33")]
    fn overlap(&self) -> bool {
        (0..2).all(|axis| {
            let begin = self.offset[axis];
            begin < i64::from(self.shown[axis]) && begin + i64::from(self.stored[axis]) > 0
        })
    }
}

/// What makes colors those of Rec. 709, `None` where they are that already; and what is odd about its values and passed over, in words.
type Values = (Option<DMat3>, Vec<String>);

/// The layer that is the picture, its channels, and what its colors become. Sizes that are wanted are checked.
fn layer(headers: &[Header], wanted: Wanted, check: Check) -> Result<(Windows, Channels, Values), String> {
    let (header, channels) = channels::of_picture(headers)?;
    let display = header.shared_attributes.display_window;
    let side = |side: usize| u32::try_from(side).unwrap_or(u32::MAX);
    let [stored, shown] = [header.layer_size, display.size].map(|size| [side(size.width()), side(size.height())]);
    check(stored)?;
    if wanted == Wanted::Shown {
        check(shown)?;
    }
    let at = header.own_attributes.layer_position;
    #[expect(clippy::arithmetic_side_effects, reason = "a difference of two 32-bit numbers")]
    let offset = |stored: i32, shown: i32| i64::from(stored) - i64::from(shown);
    let offset = [offset(at.x(), display.position.x()), offset(at.y(), display.position.y())];
    let block = header.max_block_pixel_size();
    let block = [side(block.width()).min(stored[0]), side(block.height()).min(stored[1])];
    let windows = Windows { stored, shown, offset, block };
    if wanted == Wanted::Shown && !windows.overlap() {
        return Err(format!(
            "its data window of {} × {} pixels at ({}, {}) lies outside of its display window of {} × {}, so that nothing of it is \
             shown; write it with a display window around what it stores",
            stored[0], stored[1], offset[0], offset[1], shown[0], shown[1]
        ));
    }
    // Gray is white, whatever the primaries.
    let colors = match channels {
        Channels::Gray(_) => Ok(None),
        Channels::Xyz(_) => Ok(Some(REC709_FROM_XYZ)),
        Channels::Color(_) => header.shared_attributes.chromaticities.map_or(Ok(None), |stated| into_rec709(&stated)),
    };
    let (into_rec709, why_not) = colors.map_or_else(|why| (None, Some(why)), |matrix| (matrix, None));
    let remarks = why_not.into_iter().chain(header.own_attributes.white_luminance.and_then(of_white)).collect();
    Ok((windows, channels, (into_rec709, remarks)))
}

/// What is said of a file that states how bright its 1 is, cd/m²: many mean a display by that, so nothing is multiplied.
fn of_white(luminance: f32) -> Option<String> {
    let is_news = luminance > 0.0 && luminance != 1.0;
    is_news.then(|| {
        format!("it states that its 1 is {luminance} cd/m² (`whiteLuminance`), which is passed over: its numbers are taken as they are")
    })
}

/// Takes the pixels of a file, and hands on those that are wanted.
struct Canvas<R> {
    size: [u32; 2],
    /// Where the stored pixels begin.
    offset: [i64; 2],
    into_rec709: Option<Mat3>,
    raster: R,
    blocks: Blocks,
}

/// Which blocks of a file have come. The pixels of each come together, its first one before the others.
struct Blocks {
    /// Size of all but the last ones.
    size: [usize; 2],
    /// First pixel of the one that comes.
    coming: Option<[usize; 2]>,
    /// First pixels of all that came.
    come: HashSet<[usize; 2]>,
    /// Whether one came again: then another one is missing, as a file has only so many.
    came_twice: bool,
}

impl Blocks {
    /// None yet.
    fn new(size: [u32; 2]) -> Blocks {
        Blocks { size: size.map(|side| side as usize), coming: None, come: HashSet::new(), came_twice: false }
    }

    /// Takes note of a stored pixel.
    fn note(&mut self, at: [usize; 2]) {
        let is_beside = |first: [usize; 2]| {
            at != first && at.iter().zip(first).zip(self.size).all(|((at, first), size)| at.wrapping_sub(first) < size)
        };
        if !self.coming.is_some_and(is_beside) {
            self.coming = Some(at);
            self.came_twice |= !self.come.insert(at);
        }
    }
}

impl<R: Raster> Canvas<R> {
    #[expect(clippy::arithmetic_side_effects, reason = "places and offsets are below 2^33")]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "places within a picture whose size was checked"
    )]
    fn set(&mut self, at: Vec2<usize>, pixel: [f32; 3]) {
        self.blocks.note([at.x(), at.y()]);
        let ([width, height], offset) = (self.size, self.offset);
        let (x, y) = (at.x() as i64 + offset[0], at.y() as i64 + offset[1]);
        if (0..i64::from(width)).contains(&x) && (0..i64::from(height)).contains(&y) {
            let pixel = self.into_rec709.as_ref().map_or(pixel, |matrix| converted(matrix, pixel));
            self.raster.put(x as usize, y as usize, pixel);
        }
    }
}

/// The picture of a file; sizes are checked before anything is allocated for them.
///
/// # Errors
/// What is wrong with it, in words.
pub(super) fn decode(bytes: &[u8], wanted: Wanted, threads: Threads, check: Check) -> Result<ExrPicture, String> {
    let (decoded, Windows { shown, offset, .. }) = decode_into::<Whole>(bytes, wanted, threads, check, &Whole::new)?;
    let Decoded { size, raster, is_converted, remark } = decoded;
    Ok(ExrPicture { size, pixels: raster.pixels, shown, offset, is_converted, remark })
}

/// The same into what is made for pixels of that width and height.
///
/// # Errors
/// As [`decode`].
pub(super) fn decode_into<R: Raster>(
    bytes: &[u8],
    wanted: Wanted,
    threads: Threads,
    check: Check,
    raster: &dyn Fn([u32; 2]) -> R,
) -> Result<(Decoded<R>, Windows), String> {
    let (windows, channels, (matrix, remarks)) = layer(&headers(Cursor::new(bytes))?, wanted, check)?;
    let remark = joined(&remarks);
    let Windows { stored, shown, offset, block } = windows;
    let (size, offset) = match wanted {
        Wanted::Shown => (shown, offset),
        Wanted::Stored => (stored, [0; 2]),
    };
    let into_rec709 = matrix.map(|matrix| matrix.as_mat3());
    let empty = || Canvas { size, offset, into_rec709, raster: raster(size), blocks: Blocks::new(block) };
    let levels = exr::prelude::read().no_deep_data().largest_resolution_level().specific_channels();
    // Other channels are passed over, however many there are.
    let canvas = match channels {
        Channels::Gray(y) => {
            let gray = |canvas: &mut Canvas<R>, at: Vec2<usize>, (y,): (f32,)| canvas.set(at, [y; 3]);
            let channels = levels.required(y).collect_pixels(|_, _| empty(), gray);
            let image = channels.first_valid_layer().all_attributes();
            let image = if threads == Threads::One { image.non_parallel() } else { image };
            image.from_buffered(Cursor::new(bytes)).map_err(of_exr)?.layer_data.channel_data.pixels
        }
        Channels::Color([r, g, b]) | Channels::Xyz([r, g, b]) => {
            let color = |canvas: &mut Canvas<R>, at: Vec2<usize>, (r, g, b): (f32, f32, f32)| canvas.set(at, [r, g, b]);
            let channels = levels.required(r).required(g).required(b);
            let channels = channels.collect_pixels(|_, _| empty(), color);
            let image = channels.first_valid_layer().all_attributes();
            let image = if threads == Threads::One { image.non_parallel() } else { image };
            image.from_buffered(Cursor::new(bytes)).map_err(of_exr)?.layer_data.channel_data.pixels
        }
    };
    if canvas.blocks.came_twice {
        return Err("it holds a part of its pixels twice in place of another one; write it anew".into());
    }
    Ok((Decoded { size, raster: canvas.raster, is_converted: matrix.is_some(), remark }, windows))
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

    use super::*;
    use crate::import::stack::decode_picture;

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
    fn a_data_window_beside_the_display_window_is_refused_where_that_is_wanted() {
        for at in [[4, 0], [-2, 0], [0, 2], [1, -2]] {
            let beside = exr(vec![channel("Y", &[1.0, 2.0, 3.0, 4.0])], (2, 2), Encoding::UNCOMPRESSED, at);
            let why = decode_picture(&beside).expect_err("nothing is shown");
            assert!(why.contains("outside of its display window of 4 × 2"), "{why}");
            let stored = decode(&beside, Wanted::Stored, Threads::Many, &|_| Ok(())).unwrap();
            assert_eq!(stored.pixels, [1.0, 2.0, 3.0, 4.0].map(|value| [value; 3]));
        }
    }

    #[test]
    fn a_part_that_comes_twice_in_place_of_another_is_refused() {
        let whole = exr(vec![channel("Y", &RAMP)], (4, 2), Encoding::UNCOMPRESSED, [0, 0]);
        // Two lines end the file, each four numbers behind its height and its length; before them stands where they begin.
        let first = whole.len() - 2 * (8 + 4 * 4);
        let [mut same_place, mut same_height] = [whole.clone(), whole.clone()];
        same_place.copy_within(first - 16..first - 8, first - 8);
        same_height.copy_within(first..first + 4, first + 24);
        for threads in [Threads::One, Threads::Many] {
            assert!(decode(&whole, Wanted::Stored, threads, &|_| Ok(())).is_ok());
            for twice in [&same_place, &same_height] {
                let why = decode(twice, Wanted::Stored, threads, &|_| Ok(())).expect_err("a line is missing");
                assert!(why.contains("twice"), "{why}");
            }
        }
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

    #[test]
    fn a_deep_picture_is_told_to_be_one() {
        let colors = ["R", "G", "B"].map(|name| channel(name, &RAMP));
        let flat = exr(Vec::from(colors), (4, 2), Encoding::UNCOMPRESSED, [0, 0]);
        let mut parts = headers(Cursor::new(&flat)).unwrap();
        assert!(channels::of_picture(&parts).is_ok());
        parts[0].deep = true;
        let why = channels::of_picture(&parts).expect_err("it is not flat");
        assert!(why.contains("it is deep"), "{why}");
    }
}
