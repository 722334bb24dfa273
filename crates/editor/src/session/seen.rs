//! The picture that is seen, made once more for a file or the clipboard.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Result, ensure};
use clerestory_relight::{CpuRelighter, Radiance, Relight};
use clerestory_transport::bake::Bake;
use eframe::egui::{Color32, ColorImage};
use glam::Vec3;

use super::lamps::{LampLight, LampPart, StillLamps};
use crate::black::{black_words, is_black};
use crate::cli::relight::{frame_of, irradiance_for};
use crate::export::layers::LayerSet;
use crate::export::{ExportOptions, ImageFormat, LightLayer, Picture};
use crate::illuminance::AddedLux;
use crate::look::{Look, Units};
use crate::stills::Subject;

/// A bake under a look, with the light of its free lamps.
pub(super) struct Seen {
    bake: Bake,
    coefficients: Vec<Vec<[f32; 3]>>,
    look: Look,
    light: Option<LampLight>,
}

impl Seen {
    /// Of the matrix that is shown. Without `light`, its free lamps are traced as finely as the window does while they stand still.
    pub fn of(subject: Subject, look: Look, light: Option<LampLight>) -> Seen {
        let Subject { bake, view } = subject;
        let lamps = look.lights.lit_lamps();
        let shines = lamps.iter().any(|lamp| !lamp.setting.muted);
        // Who asked for a file waits for it, a window that is being closed too.
        let traced = || StillLamps::fine(Arc::new(view.filter(|_| shines)?)).light(&lamps, &|| false);
        let light = light.or_else(traced);
        let mut coefficients = bake.header.coefficients(&look.lights);
        if let Some(light) = &light {
            bake.header.add_of_patches(&mut coefficients, &light.of_patches);
        }
        Seen { bake, coefficients, look, light }
    }

    /// Writes it. Answers with what is said where it is black although lights are on, and of layers that are called otherwise.
    pub fn save(&self, path: &Path, options: &ExportOptions) -> Result<Option<String>> {
        let format = ImageFormat::of(path)?;
        let (mut relighter, radiance) = self.relit()?;
        let set = if options.asks_layers(format) { options.layers } else { LayerSet::None };
        let layers = self.layers(&mut relighter, set)?;
        let wanted = ExportOptions { irradiance: options.irradiance && format == ImageFormat::Exr, ..*options };
        let irradiance = irradiance_for(&self.bake, &self.look, &self.added(), format, &wanted)?;
        let picture = Picture {
            radiance: &radiance,
            layers: &layers,
            irradiance: irradiance.as_ref(),
            look: &self.look,
            units: Units::of(&self.bake.header.basis),
        };
        picture.save(path, options)?;
        let is_black = is_black(&radiance, &self.bake.header.basis, &self.look.lights);
        let black = is_black.then(|| black_words("the picture is", &self.bake.header.basis));
        let words: Vec<String> = black.into_iter().chain(picture.layer_remarks()).collect();
        Ok((!words.is_empty()).then(|| words.join("; ")))
    }

    /// The picture as it is shown, for the clipboard.
    pub fn develop(&self) -> Result<ColorImage> {
        let (_, radiance) = self.relit()?;
        let options = ExportOptions::default();
        let irradiance = irradiance_for(&self.bake, &self.look, &self.added(), ImageFormat::Png, &options)?;
        let picture = Picture {
            radiance: &radiance,
            layers: &[],
            irradiance: irradiance.as_ref(),
            look: &self.look,
            units: Units::of(&self.bake.header.basis),
        };
        let (picture, _) = picture.developed(&options)?;
        let pixels = picture.pixels().map(|pixel| Color32::from_rgb(pixel.0[0], pixel.0[1], pixel.0[2])).collect();
        Ok(ColorImage::new([picture.width() as usize, picture.height() as usize], pixels))
    }

    fn added(&self) -> AddedLux {
        self.light.as_ref().map_or_else(AddedLux::default, LampLight::added_lux)
    }

    fn relit(&self) -> Result<(CpuRelighter, Radiance)> {
        let mut relighter = CpuRelighter::new(&frame_of(&self.bake, &self.look.lights))?;
        let mut radiance = Radiance::default();
        relighter.set_layer(self.light.as_ref().map(|light| &light.direct))?;
        relighter.relight(&self.coefficients, &mut radiance)?;
        ensure!(!radiance.pixels.is_empty(), "there is no picture yet; wait for the preview");
        Ok((relighter, radiance))
    }

    /// Its light in parts, free lamps with it.
    fn layers(&self, relighter: &mut CpuRelighter, set: LayerSet) -> Result<Vec<LightLayer>> {
        if set == LayerSet::None {
            return Ok(Vec::new());
        }
        relighter.set_layer(None)?;
        let mut relight = |coefficients: &[Vec<[f32; 3]>]| {
            let mut radiance = Radiance::default();
            relighter.relight(coefficients, &mut radiance)?;
            Ok(radiance)
        };
        let basis = &self.bake.header.basis;
        let mut layers = match basis.sun_apart(&self.look.lights) {
            Some(sun) => set.layers_with_sun(&self.bake, &self.look, &sun)?,
            None => set.layers(basis, &self.look, &self.coefficients, &mut relight)?,
        };
        let Some(light) = &self.light else { return Ok(layers) };
        let keys: Vec<&str> = light.parts.iter().map(|part| part.key.as_str()).collect();
        for (key, members) in set.lamp_parts(&keys, &self.look) {
            let lamps: Vec<&LampPart> = members.into_iter().map(|idx| &light.parts[idx]).collect();
            let radiance = self.light_of(&lamps, &mut relight)?;
            set.take_in(&mut layers, LightLayer { key, radiance });
        }
        Ok(layers)
    }

    /// What free lamps add: their direct light, and what becomes of it by way of the patches.
    fn light_of(
        &self,
        lamps: &[&LampPart],
        relight: impl FnOnce(&[Vec<[f32; 3]>]) -> Result<Radiance>,
    ) -> Result<Radiance> {
        let mut coefficients: Vec<Vec<[f32; 3]>> =
            self.coefficients.iter().map(|group| vec![[0.0; 3]; group.len()]).collect();
        for lamp in lamps {
            let of_patches: Vec<[f32; 3]> = lamp.of_patches().map(|light| light.to_array()).collect();
            self.bake.header.add_of_patches(&mut coefficients, &of_patches);
        }
        let mut radiance = relight(&coefficients)?;
        for (pixel, rgb) in (0..).zip(&mut radiance.pixels) {
            let direct: Vec3 = lamps.iter().map(|lamp| lamp.direct(pixel)).sum();
            *rgb = (Vec3::from(*rgb) + direct).to_array();
        }
        Ok(radiance)
    }
}
