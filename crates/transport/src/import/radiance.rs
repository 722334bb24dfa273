//! Radiance pictures in the unit that their heads tell.

use std::borrow::Cow;
use std::io::Read;

use glam::DMat3;
use image::ImageDecoder;
use image::codecs::hdr::{HdrDecoder, HdrMetadata};

use super::files::{of_file, of_image};
use super::primaries::{converted, into_rec709_from};
use super::raster::{Decoded, Raster, Whole, joined};
use crate::light::REC709_FROM_XYZ;

/// Where the head of a picture ends, at the latest: one that was put together of many tells of each.
const MOST_HEAD_BYTES: usize = 1 << 20;

/// Which of rows and columns do not run from the top left, and whether the file holds one column after the other.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Turned {
    rows: bool,
    columns: bool,
    by_columns: bool,
}

/// A picture of linear pixels.
#[derive(Debug)]
pub(super) struct RadiancePicture {
    /// Width and height.
    pub size: [u32; 2],
    /// Row by row from the top left.
    pub pixels: Vec<[f32; 3]>,
    /// What is odd about it, in words.
    pub remark: Option<String>,
}

/// The picture of a file. Values are stored times all `EXPOSURE` and `COLORCORR` of the head, and divided by them here; colors of other
/// `PRIMARIES`, and X, Y and Z of CIE 1931, become those of Rec. 709. Nothing is allocated before the size was checked.
///
/// # Errors
/// What is wrong with it, in words.
pub(super) fn decode(
    bytes: &[u8],
    check: impl FnOnce([u32; 2]) -> Result<(), String>,
) -> Result<RadiancePicture, String> {
    let Decoded { size, raster, remark, .. } = decode_into(bytes, check, Whole::new)?;
    Ok(RadiancePicture { size, pixels: raster.pixels, remark })
}

/// The same into what is made for pixels of that width and height, line by line: no more than one of them is held beside it.
///
/// # Errors
/// As [`decode`].
#[expect(clippy::arithmetic_side_effects, reason = "rows and columns of a picture")]
pub(super) fn decode_into<R: Raster>(
    bytes: &[u8],
    check: impl FnOnce([u32; 2]) -> Result<(), String>,
    raster: impl FnOnce([u32; 2]) -> R,
) -> Result<Decoded<R>, String> {
    let head = Head::of(bytes);
    let (mut rest, turned, is_xyz) = (&bytes[head.n_bytes..], head.turned, head.is_xyz);
    let (size, head) = head.told()?;
    check(size)?;
    let (exposure, (red, green, blue)) =
        (head.exposure.unwrap_or(1.0), head.color_correction.unwrap_or((1.0, 1.0, 1.0)));
    let factors = [exposure * red, exposure * green, exposure * blue];
    if !factors.iter().all(|factor| factor.is_finite() && *factor > 0.0) {
        return Err(format!(
            "its head tells an exposure of {exposure} and a color correction of {red} {green} {blue}, by which nothing can be divided"
        ));
    }
    let colors = if is_xyz { Ok(Some(REC709_FROM_XYZ)) } else { colors(&head.custom_attributes) };
    let into_rec709 = colors.as_ref().ok().copied().flatten().map(|matrix| matrix.as_mat3());
    let remarks: Vec<String> = colors.err().into_iter().chain(passed_over(&head.custom_attributes)).collect();
    let mut raster = raster(size);
    let [width, height] = size.map(|side| side as usize);
    let (n_lines, n_pixels) = if turned.by_columns { (width, size[1]) } else { (height, size[0]) };
    let mut line = Vec::new();
    for nth in 0..n_lines {
        read_line(&mut rest, n_pixels, &mut line)?;
        for (along, pixel) in line.iter().enumerate() {
            let (x, y) = if turned.by_columns { (nth, along) } else { (along, nth) };
            let x = if turned.columns { width - 1 - x } else { x };
            let y = if turned.rows { height - 1 - y } else { y };
            let pixel: [f32; 3] = std::array::from_fn(|c| pixel[c] / factors[c]);
            raster.put(x, y, into_rec709.as_ref().map_or(pixel, |matrix| converted(matrix, pixel)));
        }
    }
    Ok(Decoded { size, raster, is_converted: into_rec709.is_some(), remark: joined(&remarks) })
}

/// The head of a file as the decoder takes it.
struct Head {
    /// Its own lines, each with a line feed behind it; the last one tells the size.
    text: Vec<u8>,
    /// Where the first row begins in the file.
    n_bytes: usize,
    turned: Turned,
    /// Whether pixels are X, Y and Z of CIE 1931.
    is_xyz: bool,
}

impl Head {
    /// From the first bytes of a file; a head that is cut off is cut off here, too.
    #[expect(clippy::arithmetic_side_effects, reason = "lengths of lines within the bytes")]
    fn of(bytes: &[u8]) -> Head {
        let mut head = Head { text: Vec::new(), n_bytes: 0, turned: Turned::default(), is_xyz: false };
        let mut is_size = false;
        for line in bytes[..bytes.len().min(MOST_HEAD_BYTES)].split_inclusive(|byte| *byte == b'\n') {
            head.n_bytes += line.len();
            // On Windows a carriage return stands before the line feed.
            let line = line.strip_suffix(b"\n").unwrap_or(line);
            let line = line.strip_suffix(b"\r").unwrap_or(line);
            if is_size {
                let (line, turned) = straightened(line);
                head.turned = turned;
                head.text.extend_from_slice(&line);
                head.text.push(b'\n');
                break;
            }
            is_size = line.is_empty();
            // What a tab sets in stood in the heads of pictures that this one was made of. The decoder reads pixels of X, Y and Z as any
            // others where it is not told.
            if tells_xyz(line) {
                head.is_xyz = true;
            } else if !line.starts_with(b"\t") {
                head.text.extend_from_slice(line);
                head.text.push(b'\n');
            }
        }
        head
    }

    /// Width, height and what else it tells.
    fn told(&self) -> Result<([u32; 2], HdrMetadata), String> {
        // Strictly a head would begin with `#?RADIANCE`; `#?RGBE` is as common.
        let decoder = HdrDecoder::new_nonstrict(self.text.as_slice()).map_err(of_image)?;
        Ok((decoder.dimensions().into(), decoder.metadata()))
    }
}

/// Whether a line of a head says that pixels are X, Y and Z in place of red, green and blue.
fn tells_xyz(line: &[u8]) -> bool {
    line.strip_prefix(b"FORMAT=").is_some_and(|format| format.trim_ascii() == b"32-bit_rle_xyze")
}

/// The line that tells the size, as if rows came one after the other from the top and ran from the left, where the decoder knows no
/// other way.
fn straightened(line: &[u8]) -> (Cow<'_, [u8]>, Turned) {
    let words: Vec<&str> = std::str::from_utf8(line).unwrap_or_default().split_whitespace().collect();
    let (y, height, x, width, by_columns) = match *words.as_slice() {
        [y @ ("+Y" | "-Y"), height, x @ ("+X" | "-X"), width] => (y, height, x, width, false),
        [x @ ("+X" | "-X"), width, y @ ("+Y" | "-Y"), height] => (y, height, x, width, true),
        _ => return (Cow::Borrowed(line), Turned::default()),
    };
    let turned = Turned { rows: y == "+Y", columns: x == "-X", by_columns };
    (Cow::Owned(format!("-Y {height} +X {width}").into_bytes()), turned)
}

/// Reads the next row or column: the decoder reads all rows of its file, so each is handed to it as a file of one.
fn read_line(rest: &mut &[u8], n_pixels: u32, line: &mut Vec<[f32; 3]>) -> Result<(), String> {
    let head = format!("\n-Y 1 +X {n_pixels}\n");
    let decoder = HdrDecoder::new_nonstrict(head.as_bytes().chain(rest)).map_err(of_image)?;
    line.resize(n_pixels as usize, [0.0; 3]);
    decoder.read_image(bytemuck::cast_slice_mut(line)).map_err(of_image)
}

/// What makes its colors those of Rec. 709, or why what its head says of them is passed over, in words.
fn colors(head: &[(String, String)]) -> Result<Option<DMat3>, String> {
    let Some((_, words)) = head.iter().rev().find(|(key, _)| key == "PRIMARIES") else { return Ok(None) };
    let numbers: Option<Vec<f32>> = words.split_whitespace().map(|word| word.parse().ok()).collect();
    let Some(&[red_x, red_y, green_x, green_y, blue_x, blue_y, white_x, white_y]) = numbers.as_deref() else {
        return Err("its `PRIMARIES` are not eight numbers: its colors are taken as those of Rec. 709".into());
    };
    into_rec709_from([[red_x, red_y], [green_x, green_y], [blue_x, blue_y], [white_x, white_y]], "PRIMARIES")
}

/// What the head tells of its values and cannot be heeded, in words. Some programs write that their gamma is 1, which is no news.
fn passed_over(head: &[(String, String)]) -> impl Iterator<Item = String> {
    let n_numbers = |words: &str| words.split_whitespace().map_while(|word| word.parse::<f32>().ok()).count();
    head.iter().filter_map(move |(key, words)| match key.as_str() {
        "GAMMA" if words.trim().parse::<f32>() != Ok(1.0) => {
            Some(format!("its `GAMMA` of {} is passed over: its values are taken as linear", shortened(words)))
        }
        "EXPOSURE" if words.trim().parse::<f32>().is_err() => {
            Some(format!("its `EXPOSURE` of {} is no number and passed over", shortened(words)))
        }
        "COLORCORR" if n_numbers(words) < 3 => {
            Some(format!("its `COLORCORR` of {} are not three numbers and passed over", shortened(words)))
        }
        _ => None,
    })
}

/// As much as a line of a report holds.
fn shortened(words: &str) -> String {
    words.trim().chars().take(40).collect()
}

/// Width and height from the head of a file.
///
/// # Errors
/// As [`decode`].
pub(super) fn size(file: impl Read) -> Result<[u32; 2], String> {
    let mut bytes = Vec::new();
    file.take(MOST_HEAD_BYTES as u64).read_to_end(&mut bytes).map_err(|e| of_file(&e))?;
    Ok(Head::of(&bytes).told()?.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::luminance;

    /// Gray pixels from 1 to 6, as they lie in the file.
    fn picture(line: &str) -> Vec<u8> {
        let mut bytes = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n{line}\n").into_bytes();
        // A mantissa of 16 times 2^(132 − 136).
        (1..=6).for_each(|value: u8| bytes.extend([16 * value, 16 * value, 16 * value, 132]));
        bytes
    }

    #[test]
    fn rows_and_columns_come_from_any_corner_and_either_of_them_first() {
        for (line, expected) in [
            ("-Y 2 +X 3", [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]),
            ("+Y 2 +X 3", [4.0, 5.0, 6.0, 1.0, 2.0, 3.0]),
            ("-Y 2 -X 3", [3.0, 2.0, 1.0, 6.0, 5.0, 4.0]),
            ("+Y 2 -X 3", [6.0, 5.0, 4.0, 3.0, 2.0, 1.0]),
            ("+X 3 -Y 2", [1.0, 3.0, 5.0, 2.0, 4.0, 6.0]),
            ("+X 3 +Y 2", [2.0, 4.0, 6.0, 1.0, 3.0, 5.0]),
            ("-X 3 -Y 2", [5.0, 3.0, 1.0, 6.0, 4.0, 2.0]),
            ("-X 3 +Y 2", [6.0, 4.0, 2.0, 5.0, 3.0, 1.0]),
        ] {
            let bytes = picture(line);
            let RadiancePicture { size: told, pixels, .. } = decode(&bytes, |_| Ok(())).expect(line);
            assert_eq!((told, size(bytes.as_slice())), ([3, 2], Ok([3, 2])), "{line}");
            assert_eq!(pixels, expected.map(|value: f32| [value; 3]), "{line}");
        }
        let twice = picture("+X 3 -X 2");
        assert!(size(twice.as_slice()).expect_err("no rows").contains("Orientation"));
        assert!(decode(&twice, |_| Ok(())).expect_err("no rows").contains("Orientation"));
    }

    #[test]
    fn pixels_of_x_y_and_z_become_rec_709() {
        let read = |bytes: &[u8]| decode(bytes, |_| Ok(())).expect("a picture").pixels;
        let plain = picture("-Y 2 +X 3");
        let xyz = String::from_utf8_lossy(&plain[..plain.len() - 4 * 6]).replace("rgbe", "xyze ");
        let read_xyz = read(&[xyz.as_bytes(), &plain[plain.len() - 4 * 6..]].concat());
        for (pixel, found) in read(&plain).into_iter().zip(read_xyz) {
            // X = Y = Z is the white of equal energy, which is reddish beside D65; its luminance is Y.
            let expected = [1.2048, 0.9483, 0.9089].map(|channel| channel * pixel[1]);
            assert!((0..3).all(|c| (found[c] - expected[c]).abs() < 1e-3 * pixel[1]), "{found:?}, not {expected:?}");
            assert!((luminance(found.into()) - pixel[1]).abs() < 1e-3 * pixel[1], "{found:?}");
        }
        // One of which it was made of had X, Y and Z.
        let of_other = [&b"#?RADIANCE\n\tFORMAT=32-bit_rle_xyze\n"[..], &plain["#?RADIANCE\n".len()..]].concat();
        assert_eq!(read(&of_other), read(&plain));
    }

    #[test]
    fn lines_of_a_head_may_end_as_on_windows() {
        for line in ["-Y 2 +X 3", "+Y 2 -X 3"] {
            let plain = picture(line);
            let (head, rows) = plain.split_at(plain.len() - 4 * 6);
            let head = String::from_utf8_lossy(head).replace('\n', "\r\n");
            let bytes = [head.as_bytes(), rows].concat();
            let pixels = |bytes: &[u8]| decode(bytes, |_| Ok(())).expect(line).pixels;
            assert_eq!((pixels(&bytes), size(bytes.as_slice())), (pixels(&plain), Ok([3, 2])), "{line}");
        }
    }
}
