//! Isolux lines and their labels on pictures that are written to files.

use image::{ImageBuffer, Pixel, Rgb, RgbImage, RgbaImage};

use super::{Isoline, Label, place_labels};
use crate::lettering::Lettering;

/// Half the width of a line and of the dark rim around it, and the size of letters, pixels at a scale of one.
const CORE: f32 = 0.75;
const RIM: f32 = 1.5;
const LETTER: f32 = 11.0;
/// Room around the words of a label, pixels at a scale of one.
const AIR: f32 = 2.0;
/// Colors of lines and words, and of what sets them off from the picture, with how much of the picture that hides.
const LIGHT: u8 = 245;
const DARK: u8 = 12;
const RIM_ALPHA: f32 = 150.0;
const PLATE_ALPHA: u8 = 225;

/// A sheet of the size of a picture with nothing on it but lines and labels, `scale` times as large as the least.
pub fn draw(lines: &[Isoline], [width, height]: [u32; 2], scale: u32) -> RgbaImage {
    let mut sheet = RgbaImage::new(width, height);
    let scale = scale as f32;
    for (radius, gray, alpha) in [(RIM, DARK, RIM_ALPHA), (CORE, LIGHT, 255.0)] {
        let mut covered = vec![0u8; width as usize * height as usize];
        for line in lines {
            for ends in line.points.windows(2) {
                cover(&mut covered, [width, height], [ends[0], ends[1]], (radius * scale, alpha));
            }
        }
        for (pixel, alpha) in sheet.pixels_mut().zip(covered) {
            pixel.blend(&image::Rgba([gray, gray, gray, alpha]));
        }
    }
    let mut letters = Lettering::new(LETTER * scale);
    let bounds = [0.0, 0.0, width as f32, height as f32];
    let size_of = |words: &str| letters.size(words).map(|side| side as f32 + 2.0 * AIR * scale);
    for label in place_labels(lines, |point| point, bounds, size_of) {
        write(&mut sheet, &mut letters, &label, (AIR * scale) as u32);
    }
    sheet
}

/// Lays a sheet over a picture of its size.
pub fn lay_over(sheet: &RgbaImage, picture: &mut RgbImage) {
    for (below, above) in picture.pixels_mut().zip(sheet.pixels()) {
        let alpha = u32::from(above.0[3]);
        let mixed = |c: usize| (u32::from(below.0[c]) * (255 - alpha) + u32::from(above.0[c]) * alpha + 127) / 255;
        below.0 = [0, 1, 2].map(|c| mixed(c) as u8);
    }
}

/// The same over a picture of sixteen bits.
pub fn lay_over_deep(sheet: &RgbaImage, picture: &mut ImageBuffer<Rgb<u16>, Vec<u16>>) {
    for (below, above) in picture.pixels_mut().zip(sheet.pixels()) {
        let alpha = u32::from(above.0[3]);
        let mixed =
            |c: usize| (u32::from(below.0[c]) * (255 - alpha) + u32::from(above.0[c]) * 257 * alpha + 127) / 255;
        below.0 = [0, 1, 2].map(|c| mixed(c) as u16);
    }
}

/// Notes how much of each pixel a piece of a line covers, of 255; what covers more counts.
fn cover(covered: &mut [u8], [width, height]: [u32; 2], [a, b]: [[f32; 2]; 2], (radius, alpha): (f32, f32)) {
    let reach = radius + 1.0;
    let range = |axis: usize, side: u32| {
        let (low, high) = (a[axis].min(b[axis]) - reach, a[axis].max(b[axis]) + reach);
        (low.max(0.0) as u32)..(high.max(0.0) as u32 + 1).min(side)
    };
    for y in range(1, height) {
        for x in range(0, width) {
            let share = (radius + 0.5 - distance([x as f32 + 0.5, y as f32 + 0.5], a, b)).clamp(0.0, 1.0);
            let pixel = &mut covered[(y * width + x) as usize];
            *pixel = (*pixel).max((alpha * share) as u8);
        }
    }
}

/// Distance of a point from a piece of a line.
fn distance(p: [f32; 2], a: [f32; 2], b: [f32; 2]) -> f32 {
    let (along, from) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
    let squared = along[0] * along[0] + along[1] * along[1];
    let share = if squared > 0.0 { (from[0] * along[0] + from[1] * along[1]) / squared } else { 0.0 }.clamp(0.0, 1.0);
    (from[0] - share * along[0]).hypot(from[1] - share * along[1])
}

/// Sets the words of a label on a plate of their own.
fn write(sheet: &mut RgbaImage, letters: &mut Lettering, label: &Label, air: u32) {
    let [width, height] = label.size.map(|side| side as u32);
    let mut plate = RgbImage::from_pixel(width, height, Rgb([DARK; 3]));
    letters.write(&mut plate, label.words, [air, air], Rgb([LIGHT; 3]));
    let [left, top] = [0, 1].map(|axis| (label.middle[axis] - label.size[axis] / 2.0).round().max(0.0) as u32);
    for (x, y, pixel) in plate.enumerate_pixels() {
        if let Some(below) = sheet.get_pixel_mut_checked(left + x, top + y) {
            let [r, g, b] = pixel.0;
            *below = image::Rgba([r, g, b, PLATE_ALPHA.max(r)]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_bright_with_a_dark_rim_and_its_label_lies_on_it() {
        let line = Isoline { lux: 500.0, words: "500 lx".into(), points: vec![[0.0, 40.5], [200.0, 40.5]] };
        let sheet = draw(&[line], [200, 80], 1);
        let at = |x: u32, y: u32| sheet.get_pixel(x, y).0;
        assert_eq!((at(5, 40)[0], at(5, 40)[3]), (LIGHT, 255));
        assert!(at(5, 41)[0] < 120 && at(5, 41)[3] > 120, "{:?}", at(5, 41));
        assert_eq!((at(5, 35)[3], at(195, 60)[3]), (0, 0), "nothing beside it");
        let plate: Vec<(u32, u32)> = (0..200)
            .flat_map(|x| (30..51).map(move |y| (x, y)))
            .filter(|&(x, y)| at(x, y)[3] >= PLATE_ALPHA && y != 40)
            .collect();
        let (left, right) = (plate.iter().map(|p| p.0).min().unwrap(), plate.iter().map(|p| p.0).max().unwrap());
        assert!(left.abs_diff(200 - right) < 3 && right - left > 25, "{left} to {right}");
    }

    #[test]
    fn a_sheet_hides_as_much_at_either_depth() {
        let sheet = RgbaImage::from_fn(2, 1, |x, _| image::Rgba([200, 100, 0, if x == 0 { 255 } else { 51 }]));
        let mut picture = RgbImage::from_pixel(2, 1, Rgb([100, 100, 100]));
        lay_over(&sheet, &mut picture);
        assert_eq!([picture.get_pixel(0, 0).0, picture.get_pixel(1, 0).0], [[200, 100, 0], [120, 100, 80]]);
        let mut deep = ImageBuffer::from_pixel(2, 1, Rgb([100 * 257u16; 3]));
        lay_over_deep(&sheet, &mut deep);
        assert_eq!(deep.get_pixel(1, 0).0, [120, 100, 80].map(|byte: u16| byte * 257));
    }
}
