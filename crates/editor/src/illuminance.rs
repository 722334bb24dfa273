//! Illuminance of a surface in the figures of lighting standards: average, minimum, maximum and uniformity, in lux and foot-candles.

use anyhow::{Result, bail};
use clerestory_relight::display::luminance;
use clerestory_relight::{CpuRelighter, Frame, Radiance, Relight};
use clerestory_transport::bake::Bake;
use clerestory_transport::light::LightRig;
use clerestory_transport::sensors::SensorGrid;
use glam::Vec3;

use crate::cli::relight::irradiance_of;
use crate::marks::{Marks, Seen, weighed};

/// Lux of a foot-candle, a lumen per square foot.
pub const FOOT_CANDLE_LX: f64 = 10.763_910_416_709_722;

/// Illuminance of some points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LuxFigures {
    /// Points that count.
    pub points: usize,
    /// Mean in lux.
    pub average: f64,
    /// Least in lux.
    pub minimum: f64,
    /// Largest in lux.
    pub maximum: f64,
    /// Area of surface in m², where it is known.
    pub area_m2: Option<f64>,
}

impl LuxFigures {
    /// Of values in lux, each with its weight; the weights need not sum to anything. Dark without values.
    pub fn of(values: impl IntoIterator<Item = (f64, f64)>) -> LuxFigures {
        let (mut points, mut sum, mut weights) = (0, 0.0, 0.0);
        let (mut minimum, mut maximum) = (f64::INFINITY, 0.0f64);
        for (lux, weight) in values {
            // Ranks that are left out may take a dark point a little below nothing.
            let lux = lux.max(0.0);
            points += 1;
            sum += weight * lux;
            weights += weight;
            (minimum, maximum) = (minimum.min(lux), maximum.max(lux));
        }
        let average = if weights > 0.0 { sum / weights } else { 0.0 };
        let minimum = if points > 0 { minimum } else { 0.0 };
        LuxFigures { points, average, minimum, maximum, area_m2: None }
    }

    /// U0, minimum over average; `None` in the dark.
    pub fn uniformity(&self) -> Option<f64> {
        (self.average > 0.0).then(|| self.minimum / self.average)
    }

    /// Ud, minimum over maximum; `None` in the dark.
    pub fn diversity(&self) -> Option<f64> {
        (self.maximum > 0.0).then(|| self.minimum / self.maximum)
    }
}

/// Illuminance with three digits or more, without a unit.
pub fn lux_words(lux: f64) -> String {
    match lux {
        lux if lux >= 100.0 => format!("{lux:.0}"),
        lux if lux >= 1.0 => format!("{lux:.1}"),
        lux => format!("{lux:.3}"),
    }
}

/// A share with two digits.
pub fn share_words(share: Option<f64>) -> String {
    share.map_or("undefined".into(), |share| format!("{share:.2}"))
}

/// Measured points of a grid, meters, and their illuminance in lux.
///
/// # Errors
/// If the light is too strong for finite numbers.
pub fn of_grid(bake: &Bake, (set, grid): (usize, &SensorGrid), rig: &LightRig) -> Result<Vec<(Vec3, f32)>> {
    let irradiance = irradiance_of(bake, set, rig)?;
    let lux = |rgb: &[f32; 3]| luminance(*rgb).max(0.0);
    let points = (0..).zip(&irradiance.pixels).filter_map(|(number, rgb)| Some((grid.point(number)?, lux(rgb))));
    let points: Vec<(Vec3, f32)> = points.collect();
    if points.iter().any(|(_, lux)| !lux.is_finite()) {
        bail!("some sensors of `{}` read no finite number; check the intensities of the look", grid.name);
    }
    Ok(points)
}

/// Illuminance of the marked pixels, by area where it is known what they see.
///
/// # Errors
/// If the bake holds no irradiance of its pixels.
pub fn of_marks(bake: &Bake, rig: &LightRig, marks: &Marks, seen: Option<&Seen>) -> Result<LuxFigures> {
    let Some(set) = bake.pixel_irradiance() else {
        bail!("the bake holds no irradiance of its pixels; bake it again with --irradiance, in the window with Illuminance");
    };
    // Blocks without a mark are left out of the work.
    let mut groups = bake.irradiance[set].clone();
    let mut bundles = Vec::new();
    for block in 0..groups.first().map_or(0, |group| group.blocks.len()) {
        groups[0].partition.bundles(block, &mut bundles);
        if !bundles.iter().any(|pixel| marks.holds(*pixel)) {
            groups.iter_mut().for_each(|group| group.blocks[block] = None);
        }
    }
    let frame = Frame { width: marks.film.width, height: marks.film.height, groups };
    let mut picture = Radiance::default();
    CpuRelighter::new(&frame)?.relight(&bake.header.irradiance_coefficients(set, rig), &mut picture)?;
    let values = weighed(marks.pixels(), seen).into_iter();
    let values = values.map(|(pixel, weight)| (f64::from(luminance(picture.pixels[pixel as usize])), f64::from(weight)));
    let area = seen.map(|seen| marks.pixels().iter().map(|pixel| f64::from(seen.area_m2(*pixel))).sum());
    Ok(LuxFigures { area_m2: area, ..LuxFigures::of(values) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_those_of_the_standards() {
        let told = LuxFigures::of([(100.0, 1.0), (500.0, 2.0), (300.0, 1.0)]);
        assert_eq!((told.points, told.average, told.minimum, told.maximum), (3, 350.0, 100.0, 500.0));
        assert!((told.uniformity().unwrap() - 100.0 / 350.0).abs() < 1e-12 && told.diversity() == Some(0.2));
        let dark = LuxFigures::of([(-1e-3, 1.0)]);
        assert_eq!((dark.average, dark.uniformity(), dark.diversity()), (0.0, None, None));
        assert_eq!(LuxFigures::of([]).minimum, 0.0);
    }

    #[test]
    fn a_foot_candle_is_a_lumen_per_square_foot() {
        assert!((FOOT_CANDLE_LX * 0.3048f64.powi(2) - 1.0).abs() < 1e-12);
    }
}
