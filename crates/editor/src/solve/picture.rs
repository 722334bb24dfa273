//! A picture to be matched: any size, linear or display-encoded, exposed somehow.

use std::path::Path;

use anyhow::{Context, Result, anyhow};
use clerestory_relight::display::{Dither, radiance_of};
use clerestory_relight::{DisplayParams, Tone};
use clerestory_transport::camera::Film;
use clerestory_transport::import::stack::{Picture, decode_picture};

use crate::export::shown_by;

/// A picture of which nothing is known but its sRGB encoding.
const PLAIN: DisplayParams =
    DisplayParams { tone: Tone::Linear, exposure_ev: 0.0, white: None, dither: Dither::Off, false_color: None };
/// Longest file that is read.
const MAX_BYTES: u64 = 1 << 30;
/// Linear value of an encoded picture from which on it may have been cut off.
const CLIPPED: f32 = 0.97;
/// Difference of aspects, as a ratio, that is passed over.
const SAME_SHAPE: f32 = 1.02;

/// A picture to be matched.
#[derive(Clone, Debug, PartialEq)]
pub struct TargetPicture {
    /// For people.
    pub name: String,
    /// How it was shown: what is taken off an encoded picture after its sRGB encoding.
    pub display: DisplayParams,
    picture: Picture,
    /// Whether the file says how it was shown.
    is_told: bool,
}

/// A mean over a cell of the film.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Mean {
    /// Linear.
    pub rgb: [f64; 3],
    /// Whether a channel may have been brighter than the file could say.
    pub is_clipped: [bool; 3],
}

impl TargetPicture {
    /// Reads an EXR, HDR, PNG or JPEG file; encoded ones are taken as sRGB and made linear, and a PNG that this program wrote is
    /// taken back to nit.
    ///
    /// # Errors
    /// If it cannot be read, is no picture, or has pixels that are no numbers.
    pub fn read(path: &Path) -> Result<TargetPicture> {
        let name = path.display();
        let found = std::fs::metadata(path).with_context(|| format!("cannot read {name}: check the path"))?;
        // A device has no length and no end.
        anyhow::ensure!(found.is_file(), "{name} is no file; give a picture");
        anyhow::ensure!(found.len() <= MAX_BYTES, "{name} is too large; give a smaller picture");
        let bytes = std::fs::read(path).with_context(|| format!("cannot read {name}"))?;
        let refuse = |why: String| anyhow!("cannot use {name}: {why}");
        let picture = decode_picture(&bytes).map_err(refuse)?;
        picture.check_finite().map_err(refuse)?;
        let file_name = path.file_name().map_or_else(|| name.to_string(), |n| n.to_string_lossy().into_owned());
        let told = shown_by(&bytes);
        Ok(TargetPicture { name: file_name, display: told.unwrap_or(PLAIN), picture, is_told: told.is_some() })
    }

    /// From linear pixels.
    pub fn of(name: &str, size: [u32; 2], pixels: Vec<[f32; 3]>) -> TargetPicture {
        let picture = Picture { size, pixels, was_encoded: false, remark: None };
        TargetPicture { name: name.into(), display: PLAIN, picture, is_told: false }
    }

    /// Whether it was display-encoded, so that nothing tells how it was exposed.
    pub fn was_encoded(&self) -> bool {
        self.picture.was_encoded && !self.is_told
    }

    /// What had to be done to fit it to a film, in words.
    pub(super) fn remark(&self, film: Film) -> Option<String> {
        let [width, height] = self.picture.size;
        let ratio = (width as f32 * film.height as f32) / (height as f32 * film.width as f32);
        let is_same = (1.0 / SAME_SHAPE..=SAME_SHAPE).contains(&ratio);
        (!is_same).then(|| {
            format!("{} is {width} × {height}, of another shape than the picture: its middle is matched", self.name)
        })
    }

    /// The mean over a cell, `[left, top, right, bottom]` in pixels of a film that the picture covers; a picture of another shape
    /// loses what stands over.
    pub(super) fn mean(&self, film: Film, cell: [f32; 4]) -> Mean {
        let [width, height] = self.picture.size.map(|side| side as f32);
        let scale = (width / film.width as f32).min(height / film.height as f32);
        let margin = [0.5 * (width - film.width as f32 * scale), 0.5 * (height - film.height as f32 * scale)];
        let edges = |axis: usize, side: f32| {
            let edge = |at: f32| (margin[axis] + at * scale).clamp(0.0, side);
            let (low, high) = (edge(cell[axis]), edge(cell[axis + 2]));
            (low, high.max(low + 1e-3))
        };
        let ((left, right), (top, bottom)) = (edges(0, width), edges(1, height));
        let (mut sum, mut area, mut clipped) = ([0.0f64; 3], 0.0f64, [false; 3]);
        for y in top.floor() as u32..(bottom.ceil() as u32).min(self.picture.size[1]) {
            let tall = bottom.min(y as f32 + 1.0) - top.max(y as f32);
            for x in left.floor() as u32..(right.ceil() as u32).min(self.picture.size[0]) {
                let weight = f64::from(tall * (right.min(x as f32 + 1.0) - left.max(x as f32)));
                let shown = self.picture.pixels[y as usize * self.picture.size[0] as usize + x as usize];
                let rgb = if self.picture.was_encoded { radiance_of(&self.display, shown) } else { shown };
                for c in 0..3 {
                    sum[c] += weight * f64::from(rgb[c]);
                    clipped[c] |= self.picture.was_encoded && shown[c] >= CLIPPED;
                }
                area += weight;
            }
        }
        Mean { rgb: sum.map(|sum| sum / area.max(1e-12)), is_clipped: clipped }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_means_whatever_the_size() {
        let pixels = (0..8).flat_map(|y| (0..8).map(move |x| [x as f32, y as f32, 1.0])).collect();
        let picture = TargetPicture::of("ramp", [8, 8], pixels);
        for film in [Film { width: 4, height: 4 }, Film { width: 8, height: 8 }, Film { width: 16, height: 16 }] {
            let half = 0.5 * film.width as f32;
            let mean = picture.mean(film, [0.0, 0.0, half, half]);
            assert!((mean.rgb[0] - 1.5).abs() < 1e-6 && (mean.rgb[1] - 1.5).abs() < 1e-6, "{film:?} {mean:?}");
            let right = picture.mean(film, [half, 0.0, 2.0 * half, 2.0 * half]);
            assert!((right.rgb[0] - 5.5).abs() < 1e-6 && (right.rgb[1] - 3.5).abs() < 1e-6, "{film:?} {right:?}");
            assert_eq!(picture.remark(film), None);
        }
        // A wide film sees the middle rows.
        let wide = Film { width: 8, height: 4 };
        assert!((picture.mean(wide, [0.0, 0.0, 8.0, 4.0]).rgb[1] - 3.5).abs() < 1e-6);
        assert!((picture.mean(wide, [0.0, 0.0, 8.0, 1.0]).rgb[1] - 2.0).abs() < 1e-6);
        assert!(picture.remark(wide).is_some());
    }

    #[test]
    fn pixels_that_are_no_numbers_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mood.exr");
        let with = |bad: f32| {
            let color = |x: usize, y: usize| if (x, y) == (2, 1) { (1.0, bad, 1.0) } else { (1.0, 1.0, 1.0) };
            exr::prelude::write_rgb_file(&path, 4, 3, color).unwrap();
            TargetPicture::read(&path)
        };
        for bad in [f32::INFINITY, f32::NAN] {
            let said = with(bad).unwrap_err().to_string();
            let words = ["mood.exr", "1 of its pixels", "(2, 1) from the top left"];
            assert!(words.iter().all(|word| said.contains(word)), "{said}");
        }
        assert!(with(-1.0).is_ok());
    }

    #[test]
    fn what_an_encoded_picture_cut_off_is_known() {
        let mut picture = TargetPicture::of("photo", [2, 1], vec![[1.0, 0.5, 0.2], [0.1; 3]]);
        picture.picture.was_encoded = true;
        let film = Film { width: 2, height: 1 };
        assert_eq!(picture.mean(film, [0.0, 0.0, 1.0, 1.0]).is_clipped, [true, false, false]);
        assert_eq!(picture.mean(film, [1.0, 0.0, 2.0, 1.0]).is_clipped, [false; 3]);
    }
}
