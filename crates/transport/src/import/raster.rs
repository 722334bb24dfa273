//! What takes the pixels of a picture as they are decoded.

use crate::sky::Averaged;

/// Takes pixels, each at most once; those that never come are black.
pub(super) trait Raster {
    /// Takes the pixel of a column and a row, linear Rec. 709.
    fn put(&mut self, x: usize, y: usize, rgb: [f32; 3]);
}

/// A picture that was decoded.
#[derive(Debug)]
pub(super) struct Decoded<R> {
    /// Width and height of the picture of the file.
    pub size: [u32; 2],
    /// What took its pixels.
    pub raster: R,
    /// Whether the file states other primaries, from which the colors were converted.
    pub is_converted: bool,
    /// What is odd about it and was passed over, in words.
    pub remark: Option<String>,
}

/// Remarks as one, if there are any.
pub(super) fn joined(remarks: &[String]) -> Option<String> {
    (!remarks.is_empty()).then(|| remarks.join("; "))
}

/// All pixels as they are.
#[derive(Debug)]
pub(super) struct Whole {
    width: usize,
    /// Row by row from the top left.
    pub pixels: Vec<[f32; 3]>,
}

impl Whole {
    /// Black, of a width and a height.
    #[expect(clippy::arithmetic_side_effects, reason = "checks of sizes have multiplied them")]
    pub fn new([width, height]: [u32; 2]) -> Whole {
        let (width, height) = (width as usize, height as usize);
        Whole { width, pixels: vec![[0.0; 3]; width * height] }
    }
}

impl Raster for Whole {
    #[expect(clippy::arithmetic_side_effects, reason = "a place within a picture in memory")]
    fn put(&mut self, x: usize, y: usize, rgb: [f32; 3]) {
        self.pixels[y * self.width + x] = rgb;
    }
}

impl Raster for Averaged {
    fn put(&mut self, x: usize, y: usize, rgb: [f32; 3]) {
        Averaged::put(self, x, y, rgb);
    }
}
