//! Several pictures on one sheet, each with its name under it.

use std::io::Write;

use anyhow::{Result, ensure};
use image::RgbImage;

use crate::export::png_bytes;
use crate::legend::{INK, PAPER};
use crate::lettering::Lettering;
use crate::output::PendingFile;

/// A picture and its name.
pub struct Print {
    /// For people; what does not fit under the picture is left out.
    pub name: String,
    /// As it is shown.
    pub picture: RgbImage,
}

/// Rows of a picture per pixel of the letters under it, and their least size in pixels.
const ROWS_PER_LETTER_PX: u32 = 24;
const LEAST_LETTER_PX: u32 = 12;
/// Most pixels of all pictures of a sheet, which are in memory at once, three times.
const MOST_PX: u64 = 1 << 28;

/// Refuses so many pictures of so many pixels across and down as no sheet holds, before they are made.
///
/// # Errors
/// Says how many pixels there would be.
pub fn check_size(n_pictures: usize, [width, height]: [u32; 2]) -> Result<()> {
    let n_px = u64::from(width).saturating_mul(u64::from(height)).saturating_mul(n_pictures as u64);
    ensure!(
        n_px <= MOST_PX,
        "a sheet of {n_pictures} pictures of {width} × {height} pixels would be too large; take fewer looks, or make the pictures smaller"
    );
    Ok(())
}

/// Pictures row by row, about as many across as down; empty without any. Pictures of several sizes get cells of the largest.
pub fn contact_sheet(prints: &[Print]) -> RgbImage {
    let most = |side: fn(&RgbImage) -> u32| prints.iter().map(|print| side(&print.picture)).max().unwrap_or(0);
    let (width, height) = (most(RgbImage::width), most(RgbImage::height));
    let mut letters = Lettering::new((height / ROWS_PER_LETTER_PX).max(LEAST_LETTER_PX) as f32);
    let line = letters.size("Name")[1];
    let gap = line;
    let n_across = (1..).find(|n| n * n >= prints.len() as u32).unwrap_or(1);
    let n_down = (prints.len() as u32).div_ceil(n_across.max(1));
    let cell = [width + gap, height + line + line / 2 + gap];
    let mut sheet = RgbImage::from_pixel(n_across * cell[0] + gap, n_down * cell[1] + gap, PAPER);
    for (nth, print) in (0..).zip(prints) {
        let (left, top) = (gap + nth % n_across * cell[0], gap + nth / n_across * cell[1]);
        image::imageops::replace(&mut sheet, &print.picture, i64::from(left), i64::from(top));
        let name = letters.shortened(&print.name, width);
        letters.write(&mut sheet, &name, [left, top + print.picture.height() + line / 4], INK);
    }
    sheet
}

/// Writes the sheet of the pictures as PNG; answers its width and height in pixels.
///
/// # Errors
/// If the file cannot be written.
pub fn write_sheet(prints: &[Print], place: PendingFile) -> Result<(u32, u32)> {
    let sheet = contact_sheet(prints);
    let size = sheet.dimensions();
    let bytes = png_bytes(&sheet.into(), None)?;
    place.commit(|writer| Ok(writer.write_all(&bytes)?))?;
    Ok(size)
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    fn print(name: &str, gray: u8) -> Print {
        Print { name: name.into(), picture: RgbImage::from_pixel(60, 40, Rgb([gray; 3])) }
    }

    #[test]
    fn every_picture_is_on_the_sheet_once_with_words_under_it() {
        let prints: Vec<Print> = (0..5).map(|i| print("Evening light", 100 + i)).collect();
        let sheet = contact_sheet(&prints);
        for i in 0..5 {
            let n = sheet.pixels().filter(|pixel| pixel.0 == [100 + i; 3]).count();
            // Some edge of a letter may have the same gray.
            assert!((60 * 40..60 * 40 + 200).contains(&n), "{n} pixels of picture {i}");
        }
        assert!(sheet.pixels().any(|pixel| pixel.0[0] > 200), "words are bright");
        let columns = |y: u32| (0..sheet.width()).filter(|&x| sheet.get_pixel(x, y).0[0] >= 100).count();
        assert_eq!((columns(20), columns(sheet.height() - 70)), (180, 120), "three across, two below");
    }

    #[test]
    fn a_sheet_that_no_memory_holds_is_refused_before_it_is_made() {
        assert!(check_size(100, [1920, 1080]).is_ok());
        let said = check_size(400, [16_384, 16_384]).unwrap_err().to_string();
        assert!(said.contains("400 pictures of 16384 × 16384"), "{said}");
        assert!(check_size(usize::MAX, [u32::MAX; 2]).is_err());
    }

    #[test]
    fn a_sheet_of_nothing_is_blank_and_long_names_are_shortened() {
        assert!(contact_sheet(&[]).pixels().all(|pixel| *pixel == PAPER));
        let long = contact_sheet(&[print(&"word ".repeat(40), 90)]);
        assert_eq!(long.width(), contact_sheet(&[print("", 90)]).width());
    }
}
