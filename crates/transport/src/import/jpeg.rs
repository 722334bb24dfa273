//! Whether a JPEG is whole: its decoder makes gray of what is missing and says nothing.

/// Refuses a JPEG without the marker that ends it. Bytes behind that marker are no fault, and other files are not looked at.
pub(super) fn check_whole(bytes: &[u8]) -> Result<(), String> {
    let is_jpeg = bytes.starts_with(&[0xff, 0xd8, 0xff]);
    if is_jpeg && !is_ended(bytes) { Err("it is cut off".into()) } else { Ok(()) }
}

/// Goes from marker to marker \[ITU-T81, B.1.1\]: over the segment that each heads, so that a picture inside of one does not count, and
/// then over the bytes of a scan, in which no marker stands.
fn is_ended(bytes: &[u8]) -> bool {
    let mut rest = bytes;
    loop {
        let Some(at) = rest.windows(2).position(|pair| pair[0] == 0xff && ends_or_heads(pair[1])) else { return false };
        let [_, marker, segment @ ..] = &rest[at..] else { return false };
        if *marker == END {
            return true;
        }
        let [high, low, ..] = segment else { return false };
        let length = usize::from(u16::from_be_bytes([*high, *low]));
        let Some(behind) = segment.get(length..) else { return false };
        rest = behind;
    }
}

/// The marker that ends a picture.
const END: u8 = 0xd9;

/// Whether a byte behind 0xff makes a marker that ends the picture or heads a segment: no escaped 0xff, no filling, no restart and no
/// start of a picture.
fn ends_or_heads(byte: u8) -> bool {
    !matches!(byte, 0x00 | 0x01 | 0xd0..=0xd8 | 0xff)
}

#[cfg(test)]
mod tests {
    use image::{ImageBuffer, ImageFormat, Rgb};

    use super::*;

    fn jpeg() -> Vec<u8> {
        let picture = ImageBuffer::from_fn(32, 32, |x, y| Rgb([(x * 8) as u8, (y * 8) as u8, (x * y % 251) as u8]));
        let mut bytes = std::io::Cursor::new(Vec::new());
        picture.write_to(&mut bytes, ImageFormat::Jpeg).unwrap();
        bytes.into_inner()
    }

    #[test]
    fn a_jpeg_is_cut_off_wherever_it_ends_before_its_marker() {
        let whole = jpeg();
        assert!(whole.len() > 300, "{}", whole.len());
        check_whole(&whole).unwrap();
        for length in 3..whole.len() {
            assert_eq!(check_whole(&whole[..length]), Err("it is cut off".into()), "{length}");
        }
        check_whole(&[&whole[..], b"what a camera adds"].concat()).unwrap();
        check_whole(&whole[1..]).unwrap();
    }

    #[test]
    fn a_picture_inside_of_a_segment_ends_no_other() {
        let whole = jpeg();
        let length = u16::try_from(whole.len() + 2).unwrap().to_be_bytes();
        let with_inner = [&whole[..2], &[0xff, 0xe1][..], &length[..], &whole[..], &whole[2..]].concat();
        check_whole(&with_inner).unwrap();
        assert!(check_whole(&with_inner[..with_inner.len() - 20]).is_err());
    }
}
