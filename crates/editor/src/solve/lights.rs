//! The lights that may change, and what each of them is now.

use std::sync::Arc;

use anyhow::{Result, bail};
use clerestory_transport::basis::{LightBasis, LightSource, SourceKind};
use clerestory_transport::lamps::PreparedLamps;
use clerestory_transport::light::{LightRig, LightSetting, luminance};
use clerestory_transport::prepared::PreparedScene;
use glam::Vec3;

use super::{Freedom, Request, Scene, rows};

/// Light at a pixel.
pub type AtPixel = Arc<dyn Fn(u32) -> Vec3 + Send + Sync>;

/// What arrives straight at a point of a surface with a normal, lux per channel.
pub type AtPoint = Arc<dyn Fn(Vec3, Vec3) -> Vec3 + Send + Sync>;

/// What lamps send to any point of their scene with so many bounces, of which there is no limit by `None`.
pub fn at_point(scene: Arc<PreparedScene>, lamps: PreparedLamps, bounces: Option<u32>) -> AtPoint {
    Arc::new(move |point, normal| lamps.irradiance(&scene, point, normal, bounces))
}

/// The light of a free lamp as it is set.
#[derive(Clone)]
pub struct LampColumn {
    /// Name of the lamp.
    pub key: String,
    /// Its direct light at a pixel, nit.
    pub direct: AtPixel,
    /// What of it arrives straight at what a pixel sees, lux, where that is known.
    pub arriving: Option<AtPixel>,
    /// The same at any point.
    pub at_point: AtPoint,
    /// Its coefficients of the columns of patches; empty without patches.
    pub of_patches: Vec<Vec3>,
}

/// A light that may change.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Unknown {
    /// Its key.
    pub key: String,
    /// What it is set to.
    pub own: LightSetting,
    /// Its emission at intensity 1 over that of a white lamp: what the solution multiplies where its color stays.
    pub color: Vec3,
    /// Whether the channels are found apart.
    pub is_colored: bool,
}

impl Unknown {
    /// What is sought is now: the intensity, else intensity times color.
    pub fn present(&self) -> Vec<f64> {
        let intensity = f64::from(self.own.intensity);
        if self.is_colored { self.color.to_array().map(|c| f64::from(c) * intensity).to_vec() } else { vec![intensity] }
    }

    /// Luminance at intensity 1, where the channels are found apart: over that of a white lamp; else 1.
    pub fn luminance(&self) -> f64 {
        if self.is_colored { rows::luminance(self.color.to_array().map(f64::from)) } else { 1.0 }
    }

    /// The intensity of what was found.
    pub fn intensity(&self, found: &[f64]) -> f64 {
        match *found {
            [r, g, b] => rows::luminance([r, g, b]) / self.luminance(),
            _ => found[0],
        }
    }

    /// The setting for what was found.
    pub fn set_to(&self, found: &[f64]) -> LightSetting {
        let found: Vec<f32> = found.iter().map(|x| *x as f32).collect();
        match found[..] {
            [r, g, b] => {
                let (light, own) = (Vec3::new(r, g, b), luminance(self.color));
                let intensity = luminance(light) / own;
                let is_alike = (light - self.color * intensity).abs().max_element() <= 1e-4 * light.max_element();
                if intensity <= 0.0 || is_alike {
                    return LightSetting { intensity, ..self.own };
                }
                LightSetting { intensity, color: Some((light / intensity).to_array()), kelvin: None, ..self.own }
            }
            _ => LightSetting { intensity: found[0], ..self.own },
        }
    }
}

/// Keys of all lights that shine and may be changed; of free lamps those of which it is known what they bring.
pub fn may_change(basis: &LightBasis, rig: &LightRig, is_known: impl Fn(&str) -> bool) -> Vec<String> {
    let is_muted = |key: &str| rig.setting(key).muted;
    let sources = basis.sources.iter().filter(|source| source.kind != SourceKind::Constant && !is_muted(&source.key));
    let lamps = rig.shining_lamps().into_iter().filter(|lamp| lamp.setting.intensity > 0.0 && is_known(&lamp.key));
    sources.map(|source| source.key.clone()).chain(lamps.map(|lamp| lamp.key)).collect()
}

/// The lights that a request lets change.
///
/// # Errors
/// Names a light that is asked for and cannot change.
pub(super) fn unknowns(scene: &Scene, request: &Request) -> Result<Vec<Unknown>> {
    let basis = &scene.bake.header.basis;
    let mut found: Vec<Unknown> = Vec::new();
    let candidates = basis.sources.iter().filter(|source| source.kind != SourceKind::Constant);
    for source in candidates {
        let own = scene.rig.own_setting(&source.key);
        let is_chosen = request.lights.as_ref().is_none_or(|keys| keys.contains(&source.key));
        if is_chosen && !scene.rig.setting(&source.key).muted {
            found.push(unknown(source, own, scene, request.freedom));
        }
    }
    for lamp in &scene.lamps {
        let is_chosen = request.lights.as_ref().is_none_or(|keys| keys.contains(&lamp.key));
        let Some(free) = scene.rig.lamps.iter().find(|free| free.key == lamp.key) else { continue };
        // What is dark now tells nothing of its light.
        let lit = scene.rig.setting(&lamp.key);
        if is_chosen && !lit.muted && lit.intensity > 0.0 {
            let color = free.setting.tint(Vec3::ONE);
            let is_colored = request.freedom != Freedom::Intensity && color.min_element() > 0.0;
            found.push(Unknown { key: lamp.key.clone(), own: free.setting, color, is_colored });
        }
    }
    for key in request.lights.iter().flatten() {
        if found.iter().any(|unknown| unknown.key == *key) {
            continue;
        }
        let is_light = basis.source(key).is_some() || scene.rig.lamps.iter().any(|lamp| lamp.key == *key);
        match is_light {
            true => bail!(
                "`{key}` may not change: it is muted, dark, or its light is not known; unmute it, or leave it out"
            ),
            false => bail!("no light is called `{key}`; `info` lists the lights of a bake"),
        }
    }
    Ok(found)
}

fn unknown(source: &LightSource, own: LightSetting, scene: &Scene, freedom: Freedom) -> Unknown {
    let color = own.tint(source.color);
    // A sky keeps its colors, and so do spots that have one of their own.
    let is_sky = matches!(source.kind, SourceKind::Sky | SourceKind::Dome { .. } | SourceKind::Sun { .. });
    let spots = scene.bake.header.basis.spots_of(&scene.rig, &source.key);
    let has_own = spots.is_some_and(|spots| spots.iter().any(|spot| spot.color.is_some()));
    let is_colored = freedom != Freedom::Intensity && !is_sky && !has_own && luminance(color) > 0.0;
    Unknown { key: source.key.clone(), own, color, is_colored }
}

/// The lighting with every unknown at what a solution multiplies: intensity 1, white where its color is sought.
pub(super) fn unit_rig(rig: &LightRig, unknowns: &[Unknown]) -> LightRig {
    let mut unit = rig.clone();
    for unknown in unknowns {
        let white = unknown.is_colored.then_some([1.0; 3]);
        let kelvin = if unknown.is_colored { None } else { unknown.own.kelvin };
        let setting = LightSetting { intensity: 1.0, color: white.or(unknown.own.color), kelvin, ..unknown.own };
        // Lamps have no columns: what they bring is known as they shine.
        if !unit.lamps.iter().any(|lamp| lamp.key == unknown.key) {
            unit.set(&unknown.key, setting);
        }
    }
    unit
}

/// The lighting with what was found.
pub(super) fn with(rig: &LightRig, unknowns: &[Unknown], settings: &[LightSetting]) -> LightRig {
    let mut solved = rig.clone();
    unknowns.iter().zip(settings).for_each(|(unknown, setting)| solved.set(&unknown.key, *setting));
    solved
}
