//! Equirectangular .hdr and .exr files into maps of the sky.

use std::io::Cursor;
use std::path::Path;

use super::files::{check_pixels, guarded, read_at_most};
use super::openexr::{self, Threads, Wanted, Windows};
use super::radiance;
use super::raster::Decoded;
use crate::sky::{Averaged, Cleaned, Environment, SkyError, size_within};

/// Largest file that is read: 16384 × 8192 pixels in single precision take 1.5 GiB where nothing is compressed.
const MAX_FILE_BYTES: u64 = 2 << 30;
/// Most pixels that are averaged down to those of a map.
const MAX_PIXELS: u64 = 1 << 29;
/// Most pixels of a side: something is kept of each column and each row, so that a small file with a single row would ask for much.
const MAX_SIDE: u32 = 1 << 16;

/// Reads a map of the sky, and says in words what is odd about it. One of more than [`Environment::MAX_PIXELS`] is averaged down while it
/// is read.
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
    decode_within(name, bytes, Environment::MAX_PIXELS)
}

/// The same with so many pixels at most.
fn decode_within(name: &str, bytes: &[u8], max_pixels: usize) -> Result<(Environment, Vec<String>), SkyError> {
    let check = |size| check_size(size, bytes.len());
    let empty = |size: [u32; 2]| {
        let size = size.map(|side| side as usize);
        Averaged::new(size, size_within(size, max_pixels))
    };
    let decoded = match () {
        () if bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]) => guarded(|| {
            let windows = openexr::windows(Cursor::new(bytes), &check)?;
            let threads = threads_for(windows, max_pixels)?;
            Ok(openexr::decode_into::<Averaged>(bytes, Wanted::Shown, threads, &check, &empty)?.0)
        }),
        () if bytes.starts_with(b"#?") => guarded(|| radiance::decode_into(bytes, check, empty)),
        () => Err("it is neither Radiance nor OpenEXR".into()),
    };
    let decoded = decoded.map_err(|reason| SkyError::Decode { path: name.into(), reason })?;
    let Decoded { size: [width, height], raster, is_converted, remark } = decoded;
    let (map, Cleaned { n_black, n_capped }) = raster.finish();
    let mut warnings: Vec<String> = remark.iter().map(|remark| format!("{name}: {remark}")).collect();
    if [map.width(), map.height()] != [width, height].map(|side| side as usize) {
        warnings.push(format!(
            "{name}: its {width}×{height} pixels are more than a sky keeps and were averaged to {}×{}; its light stays the same, but \
             a sun and other details are softer",
            map.width(),
            map.height()
        ));
    }
    if n_black > 0 {
        let odd = match is_converted {
            true => {
                "have colors beyond Rec. 709, as the file has other primaries, or are no numbers; their channels end at 0"
            }
            false => "were negative or no numbers; they are black there",
        };
        warnings.push(format!("{name}: {n_black} pixels {odd}"));
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

/// By how many threads an OpenEXR is decoded: means rest on the order of their sums, which many do not keep.
///
/// # Errors
/// Pieces that are larger than a map, in words.
fn threads_for(Windows { shown, block, .. }: Windows, max_pixels: usize) -> Result<Threads, String> {
    if n_pixels(block) > Environment::MAX_PIXELS as u64 {
        let [width, height] = block;
        return Err(format!(
            "it stores pieces of {width} × {height} pixels, which are too large to be read; save it in lines or in smaller tiles"
        ));
    }
    Ok(if n_pixels(shown) > max_pixels as u64 { Threads::One } else { Threads::Many })
}

#[expect(clippy::arithmetic_side_effects, reason = "a product of two 32-bit numbers")]
fn n_pixels([width, height]: [u32; 2]) -> u64 {
    u64::from(width) * u64::from(height)
}

/// Within what is read of a sky, and what so many bytes may hold.
fn check_size(size: [u32; 2], n_bytes: usize) -> Result<(), String> {
    let [width, height] = size;
    match n_pixels(size) {
        0 => Err(format!("it is empty: {width} × {height} pixels")),
        n if n > MAX_PIXELS || width.max(height) > MAX_SIDE => Err(format!(
            "its {width} × {height} pixels are too many, at most {MAX_SIDE} to a side and {MAX_PIXELS} in all, such as 32768 × 16384; \
             make it smaller first"
        )),
        _ => check_pixels(size, n_bytes as u64),
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use exr::meta::attribute::Chromaticities;
    use exr::prelude::{
        AnyChannel, AnyChannels, Blocks, Encoding, FlatSamples, Image, IntegerBounds, Layer, LayerAttributes, Vec2,
        WritableImage,
    };

    use super::*;

    /// Pixels of 1, 2 and 4 nit in flat Radiance encoding: mantissa · 2^(exponent − 136).
    fn hdr() -> Vec<u8> {
        let mut bytes = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n".to_vec();
        for _ in 0..8 {
            bytes.extend([32, 64, 128, 131]);
        }
        bytes
    }

    /// The same with lines of its own in the head.
    fn with_line(line: &str) -> Vec<u8> {
        let (first, rest) = ("#?RADIANCE", hdr());
        [first.as_bytes(), b"\n", line.as_bytes(), &rest[first.len()..]].concat()
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
        let value = |x: usize, y: usize| if (x, y) == (1, 1) { f32::NAN } else { (x + 10 * y) as f32 };
        let channels = exr::prelude::SpecificChannels::rgb(|at: Vec2<usize>| {
            let v = value(at.x(), at.y());
            (v, 2.0 * v, 4.0 * v)
        });
        let mut bytes = Cursor::new(Vec::new());
        Image::from_channels((4, 2), channels).write().to_buffered(&mut bytes).unwrap();
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
            (&[("r", [1.0; 2]), ("g", [2.0; 2]), ("b", [4.0; 2])][..], [1.0, 2.0, 4.0]),
            (&[("sky.r", [1.0; 2]), ("sky.g", [2.0; 2]), ("sky.b", [4.0; 2])][..], [1.0, 2.0, 4.0]),
        ] {
            let (map, _) = decode_sky("a.exr", &exr(channels)).unwrap();
            assert_eq!(map.pixels(), [expected; 2], "{channels:?}");
        }
        let error = decode_sky("a.exr", &exr(&[("Z", [1.0; 2])])).unwrap_err().to_string();
        assert!(error.contains("but Z"), "{error}");
    }

    #[test]
    fn a_sky_in_xyz_becomes_rec_709() {
        for (xyz, expected) in
            [([0.950_47, 1.0, 1.088_83], [1.0; 3]), ([0.357_576, 0.715_152, 0.119_192], [0.0, 1.0, 0.0])]
        {
            let channels: Vec<_> = ["X", "Y", "Z"].into_iter().zip(xyz.map(|value| [value; 2])).collect();
            let (map, _) = decode_sky("a.exr", &exr(&channels)).unwrap();
            for (value, expected) in map.pixels()[0].into_iter().zip(expected) {
                assert!((value - expected).abs() < 1e-3, "{xyz:?}: {:?}", map.pixels()[0]);
            }
        }
    }

    /// A map of 4 × 2 pixels whose head says more, with its data window at a place.
    fn exr_of(at: (i32, i32), size: (usize, usize), values: [f32; 3], stated: Option<Chromaticities>) -> Vec<u8> {
        let channel =
            |(name, value): (&str, f32)| AnyChannel::new(name, FlatSamples::F32(vec![value; size.0 * size.1]));
        let channels = AnyChannels::sort(["R", "G", "B"].into_iter().zip(values).map(channel).collect());
        let attributes = LayerAttributes { layer_position: at.into(), ..LayerAttributes::default() };
        let mut image = Image::from_layer(Layer::new(size, attributes, Encoding::FAST_LOSSLESS, channels));
        image.attributes.display_window = IntegerBounds::new((0, 0), (4, 2));
        image.attributes.chromaticities = stated;
        let mut bytes = Cursor::new(Vec::new());
        image.write().to_buffered(&mut bytes).unwrap();
        bytes.into_inner()
    }

    #[test]
    fn a_sky_that_was_cropped_or_written_beyond_its_edge_lies_in_its_display_window() {
        let ([zero, one], white) = ([[0.0; 3], [1.0; 3]], [1.0; 3]);
        let cropped = [zero, zero, zero, zero, one, one, one, one];
        for (at, size, expected) in [((0, 1), (4, 1), cropped), ((-1, -2), (6, 8), [one; 8])] {
            let (map, warnings) = decode_sky("a.exr", &exr_of(at, size, white, None)).unwrap();
            assert_eq!((map.width(), map.height(), map.pixels()), (4, 2, &expected[..]));
            assert!(warnings.is_empty(), "{warnings:?}");
        }
    }

    #[test]
    fn a_sky_of_other_primaries_becomes_rec_709() {
        let [red, green, blue, white] =
            [Vec2(0.7347, 0.2653), Vec2(0.0, 1.0), Vec2(0.0001, -0.077), Vec2(0.32168, 0.33767)];
        let aces = Some(Chromaticities { red, green, blue, white });
        for (stored, expected, n_warnings) in [
            ([1.0; 3], [1.0; 3], 0),
            ([0.5, 0.4, 0.3], [0.690_956, 0.382_008, 0.281_624], 0),
            ([0.0, 1.0, 0.0], [0.0, 1.372_72, 0.0], 1),
        ] {
            let (map, warnings) = decode_sky("a.exr", &exr_of((0, 0), (4, 2), stored, aces)).unwrap();
            for (value, expected) in map.pixels()[3].into_iter().zip(expected) {
                assert!((value - expected).abs() < 1e-3, "{stored:?}: {:?}", map.pixels()[3]);
            }
            assert_eq!(warnings.len(), n_warnings, "{warnings:?}");
            assert!(warnings.iter().all(|line| line.contains("8 pixels have colors beyond Rec. 709")), "{warnings:?}");
        }
    }

    #[test]
    fn a_sky_whose_primaries_are_none_is_taken_as_rec_709_and_told_of() {
        let zero = Vec2(0.0, 0.0);
        let nonsense = Some(Chromaticities { red: zero, green: zero, blue: zero, white: zero });
        let (map, warnings) = decode_sky("a.exr", &exr_of((0, 0), (4, 2), [0.5, 0.4, 0.3], nonsense)).unwrap();
        assert_eq!(map.pixels()[3], [0.5, 0.4, 0.3]);
        assert!(warnings.len() == 1 && warnings[0].contains("`chromaticities`"), "{warnings:?}");
    }

    #[test]
    fn a_sky_of_which_nothing_is_shown_is_refused_in_words() {
        let why = decode_sky("a.exr", &exr_of((0, 2), (4, 2), [1.0; 3], None)).unwrap_err().to_string();
        assert!(why.contains("outside of its display window"), "{why}");
    }

    #[test]
    fn a_radiance_sky_is_divided_by_its_exposure_and_color_correction() {
        let (plain, _) = decode_sky("a.hdr", &hdr()).unwrap();
        let exposed = with_line("EXPOSURE=2\nEXPOSURE= 4\nCOLORCORR=1 2 0.5");
        let (map, _) = decode_sky("a.hdr", &exposed).unwrap();
        let expected = plain.pixels().iter().map(|[r, g, b]| [r / 8.0, g / 16.0, b / 4.0]).collect::<Vec<_>>();
        assert_eq!(map.pixels(), expected);
        let error = decode_sky("a.hdr", &with_line("EXPOSURE=0")).unwrap_err().to_string();
        assert!(error.contains("exposure of 0"), "{error}");
    }

    #[test]
    fn what_the_head_of_a_radiance_sky_tells_of_pictures_that_it_was_made_of_does_not_count() {
        let of = |lines: &str| decode_sky("a.hdr", &with_line(lines)).unwrap();
        let parts = "a.hdr:\n\tEXPOSURE=4\n\tCOLORCORR=1 2 3\nb.hdr:\n\tGAMMA=2.2\n\tPRIMARIES=red\npcomb a.hdr b.hdr";
        assert!(of(parts) == of("pcomb"));
        assert!(of(&format!("{parts}\nEXPOSURE=2")) == of("EXPOSURE=2"));
    }

    #[test]
    fn a_radiance_sky_of_other_primaries_becomes_rec_709() {
        let of = |primaries: &str| decode_sky("a.hdr", &with_line(&format!("PRIMARIES={primaries}"))).unwrap();
        let (plain, _) = decode_sky("a.hdr", &hdr()).unwrap();
        assert!(of(" 0.640 0.330 0.300 0.600 0.150 0.060 0.3127 0.3290") == (plain.clone(), Vec::new()));
        // P3 with D65.
        let (map, warnings) = of("0.68 0.32 0.265 0.69 0.15 0.06 0.3127 0.329");
        for (value, expected) in map.pixels()[5].into_iter().zip([0.7755, 2.0418, 4.2147]) {
            assert!((value - expected).abs() < 0.01, "{:?}", map.pixels()[5]);
        }
        assert!(warnings.is_empty(), "{warnings:?}");
        for odd in ["0.64 0.33", "0 0 0 0 0 0 0 0", "red"] {
            let (map, warnings) = of(odd);
            assert!(map == plain && warnings.len() == 1 && warnings[0].contains("`PRIMARIES`"), "{warnings:?}");
        }
    }

    #[test]
    fn what_a_head_says_of_its_values_and_is_passed_over_is_told() {
        let of = |line: &str| decode_sky("a.hdr", &with_line(line)).unwrap();
        let (plain, _) = decode_sky("a.hdr", &hdr()).unwrap();
        for line in ["GAMMA=1", "GAMMA= 1.000", "EXPOSURE=          1.0000000000000", "COLORCORR=1 1 1"] {
            assert!(of(line) == (plain.clone(), Vec::new()), "{line}");
        }
        for (line, key) in [("GAMMA=2.2", "`GAMMA`"), ("EXPOSURE=1,5", "`EXPOSURE`"), ("COLORCORR=2", "`COLORCORR`")] {
            let (map, warnings) = of(line);
            assert!(map == plain && warnings.len() == 1 && warnings[0].contains(key), "{line}: {warnings:?}");
        }
        for (luminance, n_told) in [(None, 0), (Some(1.0), 0), (Some(0.0), 0), (Some(179.0), 1)] {
            let channel = AnyChannel::new("Y", FlatSamples::F32(vec![3.0; 2]));
            let attributes = LayerAttributes { white_luminance: luminance, ..LayerAttributes::default() };
            let channels = AnyChannels::sort([channel].into_iter().collect());
            let image = Image::from_layer(Layer::new((2, 1), attributes, Encoding::FAST_LOSSLESS, channels));
            let mut bytes = Cursor::new(Vec::new());
            image.write().to_buffered(&mut bytes).unwrap();
            let (map, warnings) = decode_sky("a.exr", bytes.get_ref()).unwrap();
            assert_eq!(map.pixels(), [[3.0; 3]; 2]);
            let told = warnings.iter().filter(|line| line.contains("`whiteLuminance`")).count();
            assert_eq!((told, warnings.len()), (n_told, n_told), "{warnings:?}");
        }
    }

    #[test]
    fn a_sun_that_overflowed_is_bright_and_told_of() {
        let (map, warnings) = decode_sky("a.exr", &exr(&[("Y", [1.0, f32::INFINITY])])).unwrap();
        assert_eq!(map.pixels(), [[1.0; 3], [65504.0; 3]]);
        assert!(warnings.len() == 1 && warnings[0].contains("1 pixels were brighter"), "{warnings:?}");
    }

    /// Red, green, blue and exponent of each pixel of a row.
    type Row = [[u8; 4]; 8];

    /// Rows of one color between rows of many.
    fn rows() -> [Row; 4] {
        let pixel = |x: u8, y: u8| match y % 2 {
            0 => [40 + 10 * y, 80, 120, 130],
            _ => [16 + 20 * x, 200 - 20 * x, 99, 128 + x % 3],
        };
        std::array::from_fn(|y| std::array::from_fn(|x| pixel(x as u8, y as u8)))
    }

    fn flat(row: &Row) -> Vec<u8> {
        row.as_flattened().to_vec()
    }

    /// Channel after channel, each in runs.
    fn in_runs(row: &Row) -> Vec<u8> {
        let mut bytes = vec![2, 2, 0, 8];
        for channel in 0..4 {
            let values = row.map(|pixel| pixel[channel]);
            if values == [values[0]; 8] {
                bytes.extend([128 + 8, values[0]]);
            } else {
                bytes.push(8);
                bytes.extend(values);
            }
        }
        bytes
    }

    /// Pixels, the same ones but once, as it was done before there were runs of channels.
    fn repeated(row: &Row) -> Vec<u8> {
        let same = [&row[0][..], &[1, 1, 1, 7]].concat();
        if *row == [row[0]; 8] { same } else { flat(row) }
    }

    fn hdr_of(line: &str, rows: &[Row], encode: fn(&Row) -> Vec<u8>) -> Vec<u8> {
        let head = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n{line}\n").into_bytes();
        [head, rows.iter().flat_map(encode).collect()].concat()
    }

    /// Reads a sky of 8 × 4 pixels whole and with 8 pixels at most, and holds the two against each other.
    fn whole_and_averaged(name: &str, bytes: &[u8]) -> [Environment; 2] {
        let (whole, warnings) = decode_sky(name, bytes).unwrap();
        assert!(warnings.is_empty(), "{warnings:?}");
        let (small, warnings) = decode_within(name, bytes, 8).unwrap();
        assert_eq!([whole.width(), whole.height(), small.width(), small.height()], [8, 4, 4, 2]);
        assert!(warnings.len() == 1 && warnings[0].contains("8×4 pixels"), "{warnings:?}");
        assert!(warnings[0].contains("averaged to 4×2"), "{warnings:?}");
        for (small, whole) in small.light().into_iter().zip(whole.light()) {
            assert!((small / whole - 1.0).abs() < 1e-5, "{name}: {small} of {whole}");
        }
        [whole, small]
    }

    #[test]
    fn a_radiance_sky_of_too_many_pixels_is_averaged_while_it_is_read() {
        let encodings: [fn(&Row) -> Vec<u8>; 3] = [flat, in_runs, repeated];
        let read = |encode: fn(&Row) -> Vec<u8>| whole_and_averaged("a.hdr", &hdr_of("-Y 4 +X 8", &rows(), encode));
        let [whole, small] = read(flat);
        assert_eq!(whole.pixels()[9], [36.0, 180.0, 99.0].map(|mantissa: f32| mantissa / 128.0));
        for encode in encodings {
            assert!(read(encode) == [whole.clone(), small.clone()]);
            let bytes = hdr_of("-Y 4 +X 8", &rows(), encode);
            for cut in [1, 10, 30] {
                let error = decode_within("a.hdr", &bytes[..bytes.len() - cut], 8).unwrap_err().to_string();
                assert!(error.contains("it is cut off"), "{error}");
            }
        }
        let mut turned = rows();
        turned.reverse();
        turned.iter_mut().for_each(|row| row.reverse());
        let [turned_whole, turned_small] = whole_and_averaged("a.hdr", &hdr_of("+Y 4 -X 8", &turned, flat));
        assert!(turned_whole == whole);
        // Sums in another order.
        let mut pairs = turned_small.pixels().as_flattened().iter().zip(small.pixels().as_flattened());
        assert!(pairs.all(|(turned, usual)| (turned / usual - 1.0).abs() < 1e-6), "{turned_small:?} {small:?}");
    }

    #[test]
    fn an_exr_sky_of_too_many_pixels_is_averaged_while_it_is_read() {
        let tiles = Encoding { blocks: Blocks::Tiles(Vec2(3, 3)), ..Encoding::UNCOMPRESSED };
        let mut first = None;
        for encoding in [Encoding::UNCOMPRESSED, Encoding::FAST_LOSSLESS, Encoding::SMALL_LOSSLESS, tiles] {
            let channel = |(nth, name): (u32, &'static str)| {
                let values = (0..32).map(|idx| ((idx + nth) * 37 % 101) as f32).collect();
                AnyChannel::new(name, FlatSamples::F32(values))
            };
            let channels = AnyChannels::sort((0..).zip(["R", "G", "B"]).map(channel).collect());
            let layer = Layer::new((8, 4), LayerAttributes::default(), encoding, channels);
            let mut bytes = Cursor::new(Vec::new());
            Image::from_layer(layer).write().to_buffered(&mut bytes).unwrap();
            let bytes = bytes.into_inner();
            let read = whole_and_averaged("a.exr", &bytes);
            for (value, expected) in read[1].pixels().iter().zip(first.get_or_insert(read.clone())[1].pixels()) {
                assert!((0..3).all(|c| (value[c] - expected[c]).abs() < 1e-4), "{value:?} {expected:?}");
            }
            let error = decode_within("a.exr", &bytes[..bytes.len() - 9], 8).unwrap_err().to_string();
            assert!(error.contains("it is cut off"), "{error}");
        }
    }

    #[test]
    fn an_exr_is_averaged_in_one_order_and_never_read_in_huge_pieces() {
        let of = |shown, block| Windows { stored: shown, shown, offset: [0; 2], block };
        let most = Environment::MAX_PIXELS;
        assert_eq!(threads_for(of([8192, 4096], [8192, 16]), most), Ok(Threads::Many));
        assert_eq!(threads_for(of([16384, 8192], [16384, 16]), most), Ok(Threads::One));
        let why = threads_for(of([16384, 8192], [16384, 8192]), most).expect_err("one piece");
        assert!(why.contains("pieces of 16384 × 8192"), "{why}");
    }

    #[test]
    fn a_small_file_with_a_row_without_end_is_refused() {
        for size in [[1 << 29, 1], [1, 1 << 29], [(1 << 16) + 1, 16]] {
            let why = check_size(size, 1 << 20).expect_err("as many columns or rows would be kept in mind");
            assert!(why.contains("at most 65536 to a side"), "{why}");
        }
        assert_eq!(check_size([1 << 16, 1 << 13], 1 << 20), Ok(()));
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
