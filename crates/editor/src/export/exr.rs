//! Linear OpenEXR: one part, plain R, G, B for every viewer, and dotted names for layers.

use std::collections::HashSet;
use std::fs::File;
use std::io::BufWriter;

use anyhow::{Context, Result, bail};
use clerestory_relight::Radiance;
use exr::meta::attribute::{Chromaticities, IntegerBounds};
use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Compression, Encoding, FlatSamples, Image, Layer, LayerAttributes, Text,
    Vec2, WritableImage, f16,
};

use super::options::{ExportOptions, ExrCompression, ExrSamples, Region};

/// A picture of one part, ready to be written.
pub(super) struct ExrPicture<'a> {
    /// Name of each layer and its light; the first one is the picture itself, without a name.
    pub layers: Vec<(&'a str, Radiance)>,
    /// What stands beside light: names that are not those of lights.
    pub extra: Vec<(&'static str, Radiance)>,
    /// The look, as JSON.
    pub look: String,
    /// Size of the whole picture, of which a part is written.
    pub whole: [u32; 2],
    /// That part.
    pub window: Region,
}

/// Name and version of this program.
const SOFTWARE: &str = concat!("clerestory ", env!("CARGO_PKG_VERSION"));
/// Bytes of a channel name that are left for the light's key.
const MAX_KEY_BYTES: usize = 240;

/// Primaries and white point of Rec. 709.
const REC709: Chromaticities = Chromaticities {
    red: Vec2(0.64, 0.33),
    green: Vec2(0.30, 0.60),
    blue: Vec2(0.15, 0.06),
    white: Vec2(0.3127, 0.3290),
};

impl ExrPicture<'_> {
    /// Writes it.
    ///
    /// # Errors
    /// If a value is too large for halves, or the disk is full.
    pub fn write(&self, options: &ExportOptions, writer: &mut BufWriter<File>) -> Result<()> {
        let samples = options.exr_samples();
        if samples == ExrSamples::Half {
            self.check_halves()?;
        }
        let mut channels = Vec::new();
        for (name, radiance) in &self.extra {
            channels.extend(rgb_channels(&format!("{name}."), radiance, samples));
        }
        // The picture itself comes first; a light may be called by an empty name.
        let taken: Vec<&str> = self.extra.iter().map(|(name, _)| *name).collect();
        let keys: Vec<&str> = self.layers.iter().skip(1).map(|(key, _)| *key).collect();
        let of_lights = layer_names(&taken, &keys).into_iter().map(|name| format!("{name}."));
        for ((_, radiance), prefix) in self.layers.iter().zip(std::iter::once(String::new()).chain(of_lights)) {
            channels.extend(rgb_channels(&prefix, radiance, samples));
        }
        let mut attributes = LayerAttributes { software_name: Some(text(SOFTWARE)), ..LayerAttributes::default() };
        attributes.other.insert(text("clerestory.look"), AttributeValue::Text(text(&self.look)));
        let Region { x, y, width, height } = self.window;
        attributes.layer_position = Vec2(x as i32, y as i32);
        let encoding = Encoding { compression: compression(options.compression), ..Encoding::SMALL_LOSSLESS };
        let channels = AnyChannels::sort(channels.into_iter().collect());
        let size = (width as usize, height as usize);
        let mut image = Image::from_layer(Layer::new(size, attributes, encoding, channels));
        let [width, height] = self.whole.map(|side| side as usize);
        image.attributes.display_window = IntegerBounds::new(Vec2(0, 0), Vec2(width, height));
        image.attributes.chromaticities = Some(REC709);
        image.attributes.other.insert(text("colorInteropID"), AttributeValue::Text(text("lin_rec709_scene")));
        image.write().to_buffered(writer).context("the EXR could not be written")
    }

    fn check_halves(&self) -> Result<()> {
        let all = self.layers.iter().map(|(_, layer)| layer).chain(self.extra.iter().map(|(_, layer)| layer));
        let most = f16::MAX.to_f32();
        let n_bright = all.flat_map(|layer| &layer.pixels).filter(|rgb| rgb.iter().any(|v| v.abs() > most)).count();
        if n_bright > 0 {
            bail!(
                "{n_bright} pixels are brighter than halves can tell ({most} nit), so no picture was written; write floats of 32 bits, \
                 and not DWAA"
            );
        }
        Ok(())
    }
}

fn compression(asked: ExrCompression) -> Compression {
    match asked {
        ExrCompression::None => Compression::Uncompressed,
        ExrCompression::Zip => Compression::ZIP16,
        ExrCompression::Piz => Compression::PIZ,
        ExrCompression::Dwaa => Compression::DWAA(Some(DWAA_LEVEL)),
    }
}

/// What other programs write if nobody asks for more or less.
const DWAA_LEVEL: f32 = 45.0;

/// EXR names and texts are UTF-8 without a zero byte.
fn text(words: &str) -> Text {
    Text::from_slice_unchecked(words.replace('\0', "").as_bytes())
}

fn rgb_channels(prefix: &str, radiance: &Radiance, samples: ExrSamples) -> Vec<AnyChannel<FlatSamples>> {
    let channel = |(idx, name): (usize, &&str)| {
        let values = radiance.pixels.iter().map(|rgb| rgb[idx]);
        let samples = match samples {
            ExrSamples::Half => FlatSamples::F16(values.map(f16::from_f32).collect()),
            ExrSamples::Float => FlatSamples::F32(values.collect()),
        };
        AnyChannel::new(text(&format!("{prefix}{name}")), samples)
    };
    ["R", "G", "B"].iter().enumerate().map(channel).collect()
}

/// Names for the channels of lights beside others that are taken, all of them different. Who can be called by the own name is.
pub(super) fn layer_names(taken: &[&str], keys: &[&str]) -> Vec<String> {
    let mut taken: HashSet<String> = taken.iter().map(|name| (*name).to_owned()).collect();
    let own = |key: &&str| Some(plain_name(key)).filter(|name| name.as_str() == *key && taken.insert(name.clone()));
    let names: Vec<Option<String>> = keys.iter().map(own).collect();
    let named = |(name, key): (Option<String>, &&str)| name.unwrap_or_else(|| free_name(plain_name(key), &mut taken));
    names.into_iter().zip(keys).map(named).collect()
}

/// A light's name as channels may have it: dots would nest, and long or empty names would be lost.
fn plain_name(key: &str) -> String {
    let mut name: String = key.replace('.', "_").replace('\0', "");
    while name.len() > MAX_KEY_BYTES {
        name.pop();
    }
    if name.is_empty() { "_".to_string() } else { name }
}

/// A name, or that with a number where it is taken.
fn free_name(base: String, taken: &mut HashSet<String>) -> String {
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
    use super::*;

    #[test]
    fn layer_names_stay_apart_and_short() {
        let long = "ü".repeat(300);
        let names = layer_names(&[], &["a.b", "c", "", &long]);
        assert_eq!(names[..3], ["a_b", "c", "_"]);
        assert!(names[3].len() <= MAX_KEY_BYTES);
    }

    #[test]
    fn a_light_whose_name_can_stay_keeps_it() {
        assert_eq!(layer_names(&[], &["a.b", "a_b", "a_b#2"]), ["a_b#3", "a_b", "a_b#2"]);
        assert_eq!(layer_names(&["irradiance"], &["irradiance", "a"]), ["irradiance#2", "a"]);
    }
}
