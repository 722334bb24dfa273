//! What can be chosen about a picture file, beside its look.

use anyhow::{Result, bail};
use clap::ValueEnum;
use clerestory_relight::Radiance;
use serde::{Deserialize, Serialize};

use super::ImageFormat;
use super::cut;
use super::layers::LayerSet;

/// Bits of a channel in a PNG.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PngDepth {
    /// Eight.
    #[default]
    Eight,
    /// Sixteen.
    Sixteen,
}

/// Numbers in an EXR.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ExrSamples {
    /// 16-bit floats, up to 65504 nit.
    Half,
    /// 32-bit floats.
    #[default]
    Float,
}

/// How an EXR is packed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum ExrCompression {
    /// Not at all.
    None,
    /// Sixteen lines at a time, lossless.
    #[default]
    Zip,
    /// Wavelets, lossless: smallest where a picture is noisy.
    Piz,
    /// Cosines of halves, lossy: a third of the others; layers add up to the picture only nearly.
    Dwaa,
}

impl ExrCompression {
    /// All of them, with their names.
    pub const ALL: [(ExrCompression, &'static str); 4] = [
        (ExrCompression::None, "None"),
        (ExrCompression::Zip, "ZIP"),
        (ExrCompression::Piz, "PIZ"),
        (ExrCompression::Dwaa, "DWAA (lossy)"),
    ];
}

/// A part of a picture in pixels, from its top left corner.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Region {
    /// Pixels left of it.
    pub x: u32,
    /// Pixels above it.
    pub y: u32,
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
}

impl Region {
    /// The same part of a picture of another size, by whole pixels; something always stays.
    fn scaled(self, before: [u32; 2], after: [u32; 2]) -> Region {
        let part = |from: u32, length: u32, axis: usize| {
            let scale = f64::from(after[axis]) / f64::from(before[axis]);
            let [from, to] = [from, from.saturating_add(length)].map(|px| (f64::from(px) * scale).round() as u32);
            let from = from.min(after[axis].saturating_sub(1));
            (from, to.saturating_sub(from).max(1))
        };
        let ((x, width), (y, height)) = (part(self.x, self.width, 0), part(self.y, self.height, 1));
        Region { x, y, width, height }
    }

    /// Between two corners, in shares of width and height of a picture of some size in pixels; at least a pixel.
    pub fn between([low, high]: [[f32; 2]; 2], [width, height]: [u32; 2]) -> Region {
        let along = |axis: usize, side: u32| {
            let px = |share: f32| (share * side as f32).round().clamp(0.0, side as f32) as u32;
            let start = px(low[axis]).min(side.saturating_sub(1));
            (start, px(high[axis]).max(start + 1) - start)
        };
        let ((x, width), (y, height)) = (along(0, width), along(1, height));
        Region { x, y, width, height }
    }
}

/// How a picture becomes a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ExportOptions {
    /// Kind of the picture that was written last, and is suggested for the next one.
    pub format: ImageFormat,
    /// Of a PNG.
    pub depth: PngDepth,
    /// Of an EXR.
    pub samples: ExrSamples,
    /// Of an EXR.
    pub compression: ExrCompression,
    /// Which parts of the light an EXR holds beside the picture.
    pub layers: LayerSet,
    /// Whether an EXR holds the light that arrives as well.
    pub irradiance: bool,
    /// Pixels across the whole picture, at most as many as it was baked with; the height follows.
    pub width_px: Option<u32>,
    /// The part that is written, in pixels of the picture of that width; all of it if left out.
    pub region: Option<Region>,
}

impl ExportOptions {
    /// Numbers of an EXR: DWAA knows halves alone.
    pub fn exr_samples(&self) -> ExrSamples {
        if self.compression == ExrCompression::Dwaa { ExrSamples::Half } else { self.samples }
    }

    /// Size of the whole picture in pixels, given that of the bake.
    ///
    /// # Errors
    /// If it would be larger than it was baked, or nothing.
    pub fn whole(&self, baked: [u32; 2]) -> Result<[u32; 2]> {
        match self.width_px {
            None => Ok(baked),
            Some(width) if width == 0 || width > baked[0] => bail!(
                "a picture of {} × {} pixels can be written 1 to {0} pixels wide, not {width}; bake it larger",
                baked[0],
                baked[1]
            ),
            Some(width) => Ok([width, cut::height_of(width, baked)]),
        }
    }

    /// The same for a picture of another width; the region keeps its part of the picture.
    pub(crate) fn of_width(self, width: u32, baked: [u32; 2]) -> ExportOptions {
        let width_px = (width < baked[0]).then_some(width);
        let scaled = ExportOptions { width_px, ..self };
        let region = self.region.zip(self.whole(baked).ok()).zip(scaled.whole(baked).ok());
        let region = region.map(|((region, before), after)| region.scaled(before, after));
        ExportOptions { region: region.or(self.region), ..scaled }
    }

    /// The part that is written, given the size of the bake.
    ///
    /// # Errors
    /// As [`ExportOptions::whole`], and if the region is empty or not within the picture.
    pub fn window(&self, baked: [u32; 2]) -> Result<Region> {
        let [width, height] = self.whole(baked)?;
        let Some(region) = self.region else { return Ok(Region { x: 0, y: 0, width, height }) };
        let ends = [region.x.saturating_add(region.width), region.y.saturating_add(region.height)];
        if region.width == 0 || region.height == 0 || ends[0] > width || ends[1] > height {
            bail!(
                "the region of {} × {} pixels at {}, {} does not lie within the picture of {width} × {height}",
                region.width,
                region.height,
                region.x,
                region.y
            );
        }
        Ok(region)
    }

    /// The picture as large as it is written, cut to the region.
    pub(super) fn cut(&self, picture: &Radiance) -> Result<Radiance> {
        let baked = [picture.width, picture.height];
        let (whole, window) = (self.whole(baked)?, self.window(baked)?);
        Ok(cut::cropped(&cut::shrunk(picture, whole), window))
    }

    /// Whether such a file needs layers of light.
    pub fn asks_layers(&self, format: ImageFormat) -> bool {
        format == ImageFormat::Exr && self.layers != LayerSet::None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regions_and_widths_that_make_no_sense_are_refused_in_words() {
        let region = |x, y, width, height| Some(Region { x, y, width, height });
        let words = |options: ExportOptions| options.window([640, 480]).unwrap_err().to_string();
        for width_px in [0, 641] {
            let said = words(ExportOptions { width_px: Some(width_px), ..ExportOptions::default() });
            assert!(said.contains("1 to 640"), "{said}");
        }
        for bad in [region(0, 0, 0, 4), region(600, 0, 41, 4), region(0, 480, 1, 1), region(u32::MAX, 0, 2, 2)] {
            let said = words(ExportOptions { region: bad, ..ExportOptions::default() });
            assert!(said.contains("640 × 480"), "{said}");
        }
        let half = ExportOptions { width_px: Some(320), region: region(300, 0, 20, 240), ..ExportOptions::default() };
        assert_eq!(half.window([640, 480]).unwrap(), region(300, 0, 20, 240).unwrap());
        assert_eq!(half.whole([641, 480]).unwrap(), [320, 240]);
    }

    #[test]
    fn a_region_keeps_its_part_of_a_picture_of_another_width() {
        let baked = [640, 480];
        let whole =
            ExportOptions { region: Some(Region { x: 100, y: 60, width: 400, height: 300 }), ..Default::default() };
        let half = whole.of_width(320, baked);
        assert_eq!((half.width_px, half.region), (Some(320), Some(Region { x: 50, y: 30, width: 200, height: 150 })));
        assert_eq!(half.of_width(640, baked), whole);
        let dot = whole.of_width(1, baked);
        assert_eq!(dot.window(baked).unwrap(), Region { x: 0, y: 0, width: 1, height: 1 });
        let corner = ExportOptions { region: Some(Region { x: 639, y: 479, width: 1, height: 1 }), ..whole };
        assert!((1..640).all(|width| corner.of_width(width, baked).window(baked).is_ok()));
        // One that does not fit stays one that does not.
        let far = ExportOptions { region: Some(Region { x: 700, y: 0, width: u32::MAX, height: 9 }), ..whole };
        assert!(far.of_width(320, baked).window(baked).is_err());
    }

    #[test]
    fn a_region_between_corners_lies_within_the_picture_and_is_not_empty() {
        let whole = [64, 48];
        assert_eq!(Region::between([[0.25, 0.5], [0.75, 1.0]], whole), Region { x: 16, y: 24, width: 32, height: 24 });
        for corners in [[[-0.5, -0.1], [1.5, 1.2]], [[1.0, 1.0], [1.0, 1.0]], [[0.3, 0.3], [0.3, 0.3]]] {
            let region = Some(Region::between(corners, whole));
            assert!(ExportOptions { region, ..ExportOptions::default() }.window(whole).is_ok(), "{region:?}");
        }
    }

    #[test]
    fn dwaa_is_written_in_halves() {
        let options = ExportOptions { compression: ExrCompression::Dwaa, ..ExportOptions::default() };
        assert_eq!((options.samples, options.exr_samples()), (ExrSamples::Float, ExrSamples::Half));
    }
}
