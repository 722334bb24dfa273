//! Words in pictures that are written to files: the letters of the window, drawn without one.

use eframe::egui::{Color32, FontDefinitions, FontId, Galley, epaint::text::Fonts, epaint::text::TextOptions};
use image::{Rgb, RgbImage};

/// Letters of one size.
pub struct Lettering {
    fonts: Fonts,
    font: FontId,
}

impl Lettering {
    /// Letters of some size in pixels, from the top of one line to the top of the next about 1.2 of it.
    pub fn new(size_px: f32) -> Lettering {
        let fonts = Fonts::new(TextOptions::default(), FontDefinitions::default());
        Lettering { fonts, font: FontId::proportional(size_px) }
    }

    /// Width and height of a line in pixels.
    pub fn size(&mut self, words: &str) -> [u32; 2] {
        let size = self.lay_out(words).size();
        [size.x.ceil() as u32, size.y.ceil() as u32]
    }

    /// The words, or as many of their first letters as fit into a width, and an ellipsis.
    pub fn shortened(&mut self, words: &str, width: u32) -> String {
        if words.chars().nth(width as usize).is_none() && self.size(words)[0] <= width {
            return words.into();
        }
        // A letter takes a pixel at least: of a word without end the rest is not looked at.
        let mut letters: Vec<char> = words.chars().take(width as usize).collect();
        while letters.pop().is_some() {
            let short = format!("{}…", letters.iter().collect::<String>().trim_end());
            if self.size(&short)[0] <= width {
                return short;
            }
        }
        String::new()
    }

    /// Writes a line from its upper left corner on; what lies outside of the sheet is cut off.
    pub fn write(&mut self, sheet: &mut RgbImage, words: &str, [left, top]: [u32; 2], ink: Rgb<u8>) {
        let galley = self.lay_out(words);
        let atlas = self.fonts.texture_atlas().image();
        for row in &galley.rows {
            for glyph in row.row.glyphs.iter().filter(|glyph| !glyph.uv_rect.is_nothing()) {
                let place = row.pos + glyph.pos.to_vec2() + glyph.uv_rect.offset;
                let (x, y) = (i64::from(left) + place.x.round() as i64, i64::from(top) + place.y.round() as i64);
                let ([u, v], [u_end, v_end]) = (glyph.uv_rect.min, glyph.uv_rect.max);
                for (dv, du) in (v..v_end).flat_map(|v| (u..u_end).map(move |u| (v, u))) {
                    let (x, y) = (x + i64::from(du - u), y + i64::from(dv - v));
                    let covered = atlas[(usize::from(du), usize::from(dv))].a();
                    if let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y))
                        && let Some(pixel) = sheet.get_pixel_mut_checked(x, y)
                    {
                        (0..3).for_each(|c| pixel.0[c] = mixed(pixel.0[c], ink.0[c], covered));
                    }
                }
            }
        }
    }

    /// One line, whatever the words hold.
    fn lay_out(&mut self, words: &str) -> std::sync::Arc<Galley> {
        let mut fonts = self.fonts.with_pixels_per_point(1.0);
        fonts.layout_no_wrap(words.replace(char::is_control, " "), self.font.clone(), Color32::WHITE)
    }
}

/// Of two bytes the second in some share of 255.
fn mixed(below: u8, above: u8, share: u8) -> u8 {
    let (below, above, share) = (u32::from(below), u32::from(above), u32::from(share));
    ((below * (255 - share) + above * share + 127) / 255) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    const INK: Rgb<u8> = Rgb([230; 3]);

    fn inked(words: &str) -> Vec<(u32, u32)> {
        let mut sheet = RgbImage::new(200, 30);
        Lettering::new(16.0).write(&mut sheet, words, [3, 2], INK);
        sheet.enumerate_pixels().filter(|(_, _, pixel)| pixel.0[0] > 60).map(|(x, y, _)| (x, y)).collect()
    }

    #[test]
    fn letters_are_drawn_within_their_size_and_differ() {
        let [width, height] = Lettering::new(16.0).size("Evening");
        let (evening, dusk) = (inked("Evening"), inked("Dusk"));
        assert!(evening.len() > 60 && dusk.len() > 40 && evening != dusk);
        assert!(evening.iter().all(|&(x, y)| (3..=3 + width).contains(&x) && (2..=2 + height).contains(&y)));
        assert!(evening.iter().any(|&(x, _)| x + 6 > width), "the last letter is there");
        assert!(inked(" ").is_empty());
    }

    #[test]
    fn what_does_not_fit_is_cut_off_or_shortened() {
        let mut sheet = RgbImage::new(9, 7);
        let mut lettering = Lettering::new(40.0);
        lettering.write(&mut sheet, "Wide", [2, 0], INK);
        let full = lettering.size("A long name")[0];
        assert_eq!(lettering.shortened("A long name", full), "A long name");
        let short = lettering.shortened("A long name", full / 2);
        assert!(short.starts_with('A') && short.ends_with('…') && lettering.size(&short)[0] <= full / 2, "{short}");
        assert_eq!(lettering.shortened("A", 0), "");
    }

    #[test]
    fn words_are_one_line_and_soon_cut_whatever_they_hold() {
        let mut lettering = Lettering::new(16.0);
        assert_eq!(lettering.size("one\ntwo\r\u{85}three")[1], lettering.size("one")[1]);
        let without_end = "w".repeat(1 << 20);
        let short = lettering.shortened(&without_end, 200);
        assert!(short.ends_with('…') && short.len() < 100, "{short}");
    }

    #[test]
    fn the_same_words_give_the_same_pixels() {
        assert_eq!(inked("1000 cd/m² ä"), inked("1000 cd/m² ä"));
    }
}
