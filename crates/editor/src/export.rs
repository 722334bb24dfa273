//! Pictures as files: linear OpenEXR with one layer per light if wanted, or display-encoded PNG.

use std::collections::HashSet;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use anyhow::{Context, Result, anyhow, bail};
use clerestory_relight::{DisplayParams, Radiance, encode};
use exr::meta::attribute::Chromaticities;
use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Encoding, FlatSamples, Image, Layer, LayerAttributes, Text, Vec2,
    WritableImage,
};
use image::{ImageEncoder, RgbImage};

use crate::legend::Legend;
use crate::look::{Look, Quantity};
use crate::output::PendingFile;

/// Kind of picture file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImageFormat {
    /// Linear Rec. 709, 32-bit floats in nit.
    Exr,
    /// Display-encoded sRGB, 8 bits per channel.
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
}

/// What one light adds to a picture.
#[derive(Clone, Debug)]
pub struct LightLayer {
    /// Key of the light.
    pub key: String,
    /// Its part of the picture.
    pub radiance: Radiance,
}

/// A picture on its way to a file.
#[derive(Clone, Copy, Debug)]
pub struct Picture<'a> {
    /// Linear Rec. 709 radiance in nit.
    pub radiance: &'a Radiance,
    /// One per light, or none; their sum is `radiance`.
    pub layers: &'a [LightLayer],
    /// Light that arrives at what is seen, lux per channel; a layer of its own in an EXR, false color in a PNG if the look says so.
    pub irradiance: Option<&'a Radiance>,
    /// What it is lit by; goes along in an EXR, and says how a PNG is shown.
    pub look: &'a Look,
}

/// How a picture was shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shown {
    /// Exposure in EV: the look's own, else one that suits the picture.
    pub exposure_ev: f32,
    /// What the colors mean, in a PNG in false color.
    pub legend: Option<Legend>,
}

impl Look {
    /// Whether a file of this format shows the light that arrives, which not every bake holds.
    pub fn shows_irradiance(&self, format: ImageFormat) -> bool {
        format == ImageFormat::Png && self.display.quantity() == Some(Quantity::Illuminance)
    }
}

/// sRGB chunk (perceptual intent) and the gAMA chunk that goes with it, both with their checksums [PNG3, 11.3.2].
const PNG_SRGB_CHUNKS: [u8; 29] = [
    0, 0, 0, 1, b's', b'R', b'G', b'B', 0, 0xAE, 0xCE, 0x1C, 0xE9, //
    0, 0, 0, 4, b'g', b'A', b'M', b'A', 0, 0, 0xB1, 0x8F, 0x0B, 0xFC, 0x61, 0x05,
];
/// Bytes of the signature and the IHDR chunk.
const PNG_HEADER_LEN: usize = 33;
/// Share of the picture by which the sum of its layers may miss it.
const LAYER_TOLERANCE: f64 = 1e-3;
/// Bytes of a channel name that are left for the light's key.
const MAX_KEY_BYTES: usize = 240;

impl Picture<'_> {
    /// Writes the file that the name asks for and returns how it was shown.
    ///
    /// # Errors
    /// As [`Picture::write`], and if the place cannot be written.
    pub fn save(&self, path: &Path) -> Result<Shown> {
        let format = ImageFormat::of(path)?;
        self.write(PendingFile::create(path)?, format)
    }

    /// Writes a reserved file and returns how it was shown.
    ///
    /// # Errors
    /// If a pixel is not finite, the layers do not add up to the picture, irradiance is shown that is not there, or the disk
    /// is full.
    pub fn write(&self, place: PendingFile, format: ImageFormat) -> Result<Shown> {
        self.check()?;
        let display = &self.look.display;
        let exposed = display.metered(self.radiance);
        if format == ImageFormat::Exr {
            place.commit(|writer| self.write_exr(writer))?;
            return Ok(Shown { exposure_ev: exposed.exposure_ev, legend: None });
        }
        let (shown, params) = match display.quantity() {
            Some(Quantity::Illuminance) => {
                let irradiance =
                    self.irradiance.context("false color of illuminance needs a bake made with --irradiance")?;
                (irradiance, display.metered(irradiance))
            }
            _ => (self.radiance, exposed),
        };
        let legend = display.quantity().zip(params.false_color).map(|(quantity, scale)| Legend { quantity, scale });
        place.commit(|writer| write_png(shown, &params, legend, writer))?;
        Ok(Shown { exposure_ev: exposed.exposure_ev, legend })
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
        if missed.sqrt() > LAYER_TOLERANCE * whole.sqrt() {
            bail!(
                "the layers of the lights add up to another picture ({missed:.3e} against {whole:.3e}); leave out --layers"
            );
        }
        Ok(())
    }

    fn write_exr(&self, writer: &mut BufWriter<File>) -> Result<()> {
        let mut channels = rgb_channels("", self.radiance);
        let mut taken = HashSet::new();
        for layer in self.layers {
            let name = layer_name(&layer.key, &mut taken);
            channels.extend(rgb_channels(&format!("{name}."), &layer.radiance));
        }
        if let Some(irradiance) = self.irradiance {
            channels.extend(rgb_channels("irradiance.", irradiance));
        }
        let mut attributes = LayerAttributes { software_name: Some(text(SOFTWARE)), ..LayerAttributes::default() };
        attributes.other.insert(text("clerestory.look"), AttributeValue::Text(text(&self.look.to_json())));
        let size = (self.radiance.width as usize, self.radiance.height as usize);
        let channels = AnyChannels::sort(channels.into_iter().collect());
        let mut image = Image::from_layer(Layer::new(size, attributes, Encoding::SMALL_LOSSLESS, channels));
        image.attributes.chromaticities = Some(REC709);
        image.attributes.other.insert(text("colorInteropID"), AttributeValue::Text(text("lin_rec709_scene")));
        image.write().to_buffered(writer).context("the EXR could not be written")
    }
}

fn write_png(
    shown: &Radiance,
    params: &DisplayParams,
    legend: Option<Legend>,
    writer: &mut BufWriter<File>,
) -> Result<()> {
    let rgb = encode(shown, params).chunks_exact(4).flat_map(|rgba| [rgba[0], rgba[1], rgba[2]]).collect();
    let picture = RgbImage::from_raw(shown.width, shown.height, rgb).expect("three bytes per pixel");
    let picture = match legend {
        Some(legend) => legend.beside(&picture),
        None => picture,
    };
    let mut png = Vec::new();
    image::codecs::png::PngEncoder::new(&mut png).write_image(
        &picture,
        picture.width(),
        picture.height(),
        image::ExtendedColorType::Rgb8,
    )?;
    let (header, rest) = png.split_at(PNG_HEADER_LEN);
    for part in [header, &PNG_SRGB_CHUNKS, rest] {
        writer.write_all(part)?;
    }
    Ok(())
}

/// Name and version of this program.
const SOFTWARE: &str = concat!("clerestory ", env!("CARGO_PKG_VERSION"));

/// Primaries and white point of Rec. 709.
const REC709: Chromaticities = Chromaticities {
    red: Vec2(0.64, 0.33),
    green: Vec2(0.30, 0.60),
    blue: Vec2(0.15, 0.06),
    white: Vec2(0.3127, 0.3290),
};

/// EXR names and texts are UTF-8 without a zero byte.
fn text(words: &str) -> Text {
    Text::from_slice_unchecked(words.replace('\0', "").as_bytes())
}

fn rgb_channels(prefix: &str, radiance: &Radiance) -> Vec<AnyChannel<FlatSamples>> {
    let channel = |(idx, name): (usize, &&str)| {
        let samples = radiance.pixels.iter().map(|rgb| rgb[idx]).collect();
        AnyChannel::new(text(&format!("{prefix}{name}")), FlatSamples::F32(samples))
    };
    ["R", "G", "B"].iter().enumerate().map(channel).collect()
}

/// A name for a light's channels: dots would nest, and long or equal names would be lost.
fn layer_name(key: &str, taken: &mut HashSet<String>) -> String {
    let mut name: String = key.replace('.', "_").replace('\0', "");
    while name.len() > MAX_KEY_BYTES {
        name.pop();
    }
    let base = if name.is_empty() { "_".to_string() } else { name };
    let mut name = base.clone();
    let mut repeat = 1;
    while !taken.insert(name.clone()) {
        repeat += 1;
        name = format!("{base}#{repeat}");
    }
    name
}

#[cfg(test)]
mod tests {
    use clerestory_relight::display::turbo_bytes;

    use super::*;
    use crate::compare::read_exr;
    use crate::look::FalseColor;

    fn gradient(scale: f32) -> Radiance {
        let pixels = (0..12).map(|i| [i as f32 * scale, 1.0 * scale, 0.25 * scale]).collect();
        Radiance { width: 4, height: 3, pixels }
    }

    #[test]
    fn an_exr_gives_back_every_bit_and_carries_look_and_layers() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let (whole, a, b) = (gradient(1.0), gradient(0.25), gradient(0.75));
        let layers = [LightLayer { key: "a.b".into(), radiance: a }, LightLayer { key: "ä_b".into(), radiance: b }];
        let look = Look::default();
        Picture { radiance: &whole, layers: &layers, irradiance: None, look: &look }.save(&path).unwrap();
        assert_eq!(read_exr(&path).unwrap(), whole);

        let meta = exr::meta::MetaData::read_from_file(&path, true).unwrap();
        let header = &meta.headers[0];
        let names: Vec<String> = header.channels.list.iter().map(|c| c.name.to_string()).collect();
        assert!(names.contains(&"a_b.R".to_string()), "{names:?}");
        let attribute = &header.own_attributes.other[&text("clerestory.look")];
        let AttributeValue::Text(json) = attribute else { panic!("the look is a text") };
        assert_eq!(Look::from_json(&json.to_string()).unwrap().0, look);
    }

    #[test]
    fn the_same_picture_gives_the_same_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let paths = ["a.exr", "b.exr"].map(|name| folder.path().join(name));
        for path in &paths {
            Picture { radiance: &gradient(1.0), layers: &[], irradiance: None, look: &Look::default() }
                .save(path)
                .unwrap();
        }
        assert!(std::fs::read(&paths[0]).unwrap() == std::fs::read(&paths[1]).unwrap());
    }

    #[test]
    fn a_png_is_what_the_display_shows_and_says_srgb() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let radiance = gradient(1.0);
        let shown =
            Picture { radiance: &radiance, layers: &[], irradiance: None, look: &Look::default() }.save(&path).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(&bytes[37..41], b"sRGB");
        let expected = encode(&radiance, &DisplayParams { exposure_ev: shown.exposure_ev, ..DisplayParams::default() });
        let decoded = image::load_from_memory(&bytes).unwrap().to_rgba8();
        assert_eq!(decoded.dimensions(), (4, 3));
        assert_eq!(decoded.into_raw(), expected);
    }

    #[test]
    fn false_color_of_illuminance_shows_irradiance_with_a_legend_or_says_what_is_missing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let mut look = Look::default();
        let range = Some([1.0, 100.0]);
        look.display.false_color = Some(FalseColor { quantity: Quantity::Illuminance, range, ..FalseColor::default() });
        let (radiance, lux) = (gradient(1.0), Radiance { width: 4, height: 3, pixels: vec![[10.0; 3]; 12] });
        let picture = Picture { radiance: &radiance, layers: &[], irradiance: None, look: &look };
        let error = picture.save(&path).unwrap_err().to_string();
        assert!(error.contains("--irradiance") && !path.exists(), "{error}");

        let shown = Picture { irradiance: Some(&lux), ..picture }.save(&path).unwrap();
        assert_eq!(shown.legend.unwrap().json()["high"], 100.0);
        let png = image::open(&path).unwrap().to_rgb8();
        assert_eq!(png.get_pixel(2, 1).0, turbo_bytes(0.5), "10 lies halfway from 1 to 100");
        assert!(png.width() > 4 + 8 && png.height() >= 48, "the legend is beside the picture");
        let exr = folder.path().join("a.exr");
        assert_eq!(picture.save(&exr).unwrap().legend, None);
        assert_eq!(read_exr(&exr).unwrap(), radiance, "an EXR stays linear");
    }

    #[test]
    fn pixels_that_are_no_numbers_and_layers_that_do_not_add_up_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let look = Look::default();
        let mut bad = gradient(1.0);
        bad.pixels[3][1] = f32::NAN;
        let error =
            Picture { radiance: &bad, layers: &[], irradiance: None, look: &look }.save(&path).unwrap_err().to_string();
        assert!(error.contains("1 pixels"), "{error}");
        let layers = [LightLayer { key: "half".into(), radiance: gradient(0.5) }];
        assert!(
            Picture { radiance: &gradient(1.0), layers: &layers, irradiance: None, look: &look }.save(&path).is_err()
        );
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn layer_names_stay_apart_and_short() {
        let mut taken = HashSet::new();
        let long = "ü".repeat(300);
        let names: Vec<String> = ["a.b", "a_b", "", &long].map(|key| layer_name(key, &mut taken)).into();
        assert_eq!(names[..3], ["a_b", "a_b#2", "_"]);
        assert!(names[3].len() <= MAX_KEY_BYTES);
    }
}
