//! Pictures as files: linear OpenEXR with layers of light if wanted, or display-encoded PNG.

mod cut;
mod exr;
pub mod layers;
pub mod options;
mod png;
#[cfg(test)]
mod tests;

use std::io::Write;
use std::path::Path;

use anyhow::{Context, Result, anyhow, bail};
use clerestory_relight::{DisplayParams, Radiance};
use image::RgbImage;
use serde::{Deserialize, Serialize};

use self::exr::{ExrPicture, layer_names};
use crate::legend::Legend;
use crate::look::{Look, Quantity, Units};
use crate::output::PendingFile;
pub(crate) use cut::{height_of, shrunk};
pub use layers::LightLayer;
pub use options::ExportOptions;
pub use png::{png_bytes, shown_by};

/// Kind of picture file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ImageFormat {
    /// Linear Rec. 709 in nit.
    Exr,
    /// Display-encoded sRGB.
    #[default]
    Png,
}

impl ImageFormat {
    /// The format that a file name asks for.
    ///
    /// # Errors
    /// If it ends in neither `.exr` nor `.png`.
    pub fn of(path: &Path) -> Result<ImageFormat> {
        let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        match extension.as_deref() {
            Some("exr") => Ok(ImageFormat::Exr),
            Some("png") => Ok(ImageFormat::Png),
            _ => Err(anyhow!("cannot write {}: end the name in .exr or .png", path.display())),
        }
    }

    /// What its names end in.
    pub fn ending(self) -> &'static str {
        match self {
            ImageFormat::Exr => ".exr",
            ImageFormat::Png => ".png",
        }
    }
}

/// A picture on its way to a file.
#[derive(Clone, Copy, Debug)]
pub struct Picture<'a> {
    /// Linear Rec. 709 radiance in nit.
    pub radiance: &'a Radiance,
    /// The light in parts, or none; their sum is `radiance`.
    pub layers: &'a [LightLayer],
    /// Light that arrives at what is seen, lux per channel; a layer of its own in an EXR, false color in a PNG if the look says so.
    pub irradiance: Option<&'a Radiance>,
    /// What it is lit by; goes along in an EXR, and says how a PNG is shown.
    pub look: &'a Look,
    /// What its numbers count.
    pub units: Units,
}

/// How a picture was shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shown {
    /// Exposure in EV: the look's own, else one that suits the picture.
    pub exposure_ev: f32,
    /// What the colors mean, in a PNG in false color.
    pub legend: Option<Legend>,
    /// Width and height of the file in pixels, with its legend.
    pub size_px: [u32; 2],
}

impl Look {
    /// Whether a file of this format shows the light that arrives, which not every bake holds.
    pub fn shows_irradiance(&self, format: ImageFormat) -> bool {
        format == ImageFormat::Png && self.display.quantity() == Some(Quantity::Illuminance)
    }
}

/// What the layer of arriving light is called in an EXR.
const IRRADIANCE: &str = "irradiance";
/// Share of the picture by which the sum of its layers may miss it.
const LAYER_TOLERANCE: f64 = 1e-3;

impl Picture<'_> {
    /// Writes the file that the name asks for and returns how it was shown.
    ///
    /// # Errors
    /// As [`Picture::write`], and if the place cannot be written.
    pub fn save(&self, path: &Path, options: &ExportOptions) -> Result<Shown> {
        let format = ImageFormat::of(path)?;
        self.write(PendingFile::create(path)?, format, options)
    }

    /// Writes a reserved file and returns how it was shown. Exposure and scale are those of the whole picture as it was baked,
    /// however much of it is written.
    ///
    /// # Errors
    /// If a pixel is not finite, the layers do not add up to the picture, irradiance is shown that is not there, the options do
    /// not fit the picture, or the disk is full.
    pub fn write(&self, place: PendingFile, format: ImageFormat, options: &ExportOptions) -> Result<Shown> {
        self.check()?;
        match format {
            ImageFormat::Exr => {
                let exr = self.exr(options)?;
                place.commit(|writer| exr.write(options, writer))?;
                let exposure_ev = self.look.display.metered(self.radiance).exposure_ev;
                Ok(Shown { exposure_ev, legend: None, size_px: [exr.window.width, exr.window.height] })
            }
            ImageFormat::Png => {
                let (radiance, params, exposure_ev) = self.displayed()?;
                let legend = self.legend(&params);
                let picture = png::shown_at(options.depth, &options.cut(radiance)?, &params, legend);
                let bytes = png_bytes(&picture, legend.is_none().then_some(&params))?;
                place.commit(|writer| Ok(writer.write_all(&bytes)?))?;
                Ok(Shown { exposure_ev, legend, size_px: [picture.width(), picture.height()] })
            }
        }
    }

    /// Which layers an EXR cannot call by their own names, in words; that dots become `_` is no news.
    pub fn layer_remarks(&self) -> Vec<String> {
        let taken: Vec<&str> = self.irradiance.iter().map(|_| IRRADIANCE).collect();
        let keys: Vec<&str> = self.layers.iter().map(|layer| layer.key.as_str()).collect();
        let renamed =
            layer_names(&taken, &keys).into_iter().zip(keys).filter(|(name, key)| *name != key.replace('.', "_"));
        let words = |(name, key)| {
            format!("the layer of `{key}` is called `{name}` in the EXR: its own name is taken, empty or too long")
        };
        renamed.map(words).collect()
    }

    /// The picture as a PNG of 8 bits shows it.
    ///
    /// # Errors
    /// As [`Picture::write`].
    pub fn developed(&self, options: &ExportOptions) -> Result<(RgbImage, Shown)> {
        self.check()?;
        let (radiance, params, exposure_ev) = self.displayed()?;
        let legend = self.legend(&params);
        let picture = png::shown(&options.cut(radiance)?, &params, legend);
        let size_px = picture.dimensions().into();
        Ok((picture, Shown { exposure_ev, legend, size_px }))
    }

    /// What its colors mean where it is shown so, if they are false.
    fn legend(&self, params: &DisplayParams) -> Option<Legend> {
        Legend::of(&self.look.display, params, self.units)
    }

    /// What is shown, how, and the exposure in EV that suits the light that is seen.
    fn displayed(&self) -> Result<(&Radiance, DisplayParams, f32)> {
        let display = &self.look.display;
        let exposed = display.metered(self.radiance);
        let (shown, params) = match display.quantity() {
            Some(Quantity::Illuminance) => {
                let irradiance =
                    self.irradiance.context("false color of illuminance needs a bake made with --irradiance")?;
                (irradiance, display.metered(irradiance))
            }
            _ => (self.radiance, exposed),
        };
        Ok((shown, params, exposed.exposure_ev))
    }

    fn exr(&self, options: &ExportOptions) -> Result<ExrPicture<'_>> {
        let baked = [self.radiance.width, self.radiance.height];
        let mut layers = vec![("", options.cut(self.radiance)?)];
        for layer in self.layers {
            layers.push((&layer.key, options.cut(&layer.radiance)?));
        }
        let extra = self.irradiance.map(|irradiance| Ok((IRRADIANCE, options.cut(irradiance)?)));
        let extra: Vec<_> = extra.into_iter().collect::<Result<_>>()?;
        let (whole, window) = (options.whole(baked)?, options.window(baked)?);
        Ok(ExrPicture { layers, extra, look: self.look.to_json(), whole, window })
    }

    fn check(&self) -> Result<()> {
        let pixels = self.radiance.pixels.iter().chain(self.irradiance.iter().flat_map(|layer| &layer.pixels));
        let n_bad = pixels.filter(|rgb| !rgb.iter().all(|v| v.is_finite())).count();
        if n_bad > 0 {
            bail!(
                "{n_bad} pixels are not finite numbers, so no picture was written; check the intensities of the look"
            );
        }
        if self.layers.is_empty() {
            return Ok(());
        }
        let (mut missed, mut whole) = (0.0, 0.0);
        for (idx, pixel) in self.radiance.pixels.iter().enumerate() {
            for (channel, value) in pixel.iter().enumerate() {
                let sum: f64 = self.layers.iter().map(|layer| f64::from(layer.radiance.pixels[idx][channel])).sum();
                missed += (sum - f64::from(*value)).powi(2);
                whole += f64::from(*value).powi(2);
            }
        }
        // Sums that are no number are not those of the picture either.
        let is_same = missed.sqrt() <= LAYER_TOLERANCE * whole.sqrt();
        if !is_same {
            bail!(
                "the layers of light add up to another picture ({missed:.3e} against {whole:.3e}); write it without layers"
            );
        }
        Ok(())
    }
}
