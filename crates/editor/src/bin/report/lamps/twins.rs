//! Lamps of the file that are exchanged for free ones, as *Make movable* does.

use anyhow::{Context, Result};
use clerestory_transport::bake::Bake;
use clerestory_transport::lamps::{FreeLamp, PreparedLamps};
use clerestory_transport::light::{LightRig, LightSetting};
use clerestory_transport::prepared::PreparedScene;

use super::of_patches;
use crate::errors::{Sum, decibels, quantile};
use crate::rendered::relit;

/// A lamp of the file, and the free one that takes its place.
pub struct Twin {
    key: String,
    pub free: PreparedLamps,
}

/// Those that a scene has.
///
/// # Errors
/// A lamp that cannot shine.
pub fn find(scene: &PreparedScene) -> Result<Vec<Twin>> {
    let mut twins = Vec::new();
    for source in &scene.lighting.basis.sources {
        let Some(light) = scene.scene.lamp_called(&source.key) else { continue };
        let Some(free) = FreeLamp::from_source("movable", source, light, LightSetting::default()) else { continue };
        let free = PreparedLamps::new(&[free], None)?.0;
        if !free.is_empty() {
            twins.push(Twin { key: source.key.clone(), free });
        }
    }
    Ok(twins)
}

impl Twin {
    /// The picture of the file with it against that of its baked column, given two of its live light, dB below the 99.5 percentile
    /// of the picture.
    ///
    /// # Errors
    /// A bake without patches.
    pub fn db(&self, scene: &PreparedScene, bake: &Bake, live: [&[f32]; 2]) -> Result<f64> {
        let mut without = LightRig::default();
        without.lights.entry(self.key.clone()).or_default().muted = true;
        let [whole, without] = [LightRig::default(), without].map(|rig| relit(bake, &bake.header.coefficients(&rig)));
        let patches = bake.header.patches.as_ref().context("no patches")?;
        let free = relit(bake, &of_patches(bake, self.free.light_on_patches(scene, patches)));
        Ok(difference_db(&whole, &without, &free, live))
    }
}

/// Of a picture and the same without a lamp, with what is indirect and live of another one: noise of the live light is no difference.
fn difference_db(whole: &[f32], without: &[f32], free: &[f32], live: [&[f32]; 2]) -> f64 {
    let square = |at: usize| {
        let [a, b] = live.map(|live| f64::from(without[at] + free[at]) + f64::from(live[at]) - f64::from(whole[at]));
        a * b
    };
    let sum = Sum::of_pixels(whole.len(), square);
    decibels(quantile(whole.iter().map(|value| f64::from(*value)).collect()), sum.mean_at_least_known())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_twin_that_is_a_tenth_too_bright_is_twenty_decibels_off() {
        let (whole, without, free) = ([10.0; 6], [6.0; 6], [3.0; 6]);
        let db = |live: [[f32; 6]; 2]| difference_db(&whole, &without, &free, [&live[0], &live[1]]);
        assert!((db([[2.0; 6]; 2]) - 20.0).abs() < 1e-6);
        // One in one pixel, less than nothing by as much in the other: known to their standard error, √½.
        let known = decibels(10.0, 0.5f64.sqrt());
        assert!((db([[2.0, 2.0, 2.0, 0.0, 0.0, 0.0], [2.0; 6]]) - known).abs() < 1e-6);
        // Noise around what is right.
        assert!(db([[1.5, 0.5, 1.0, 1.0, 1.5, 0.5], [1.0; 6]]) > 100.0);
    }
}
