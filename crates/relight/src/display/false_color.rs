//! False color: luminance or illuminance read off a scale of colors.
//!
//! The colors are Turbo \[Mikhailov2019\], in the polynomial form by R. Du: an order that people know from falsecolor pictures
//! of light, without their false edges. What lies outside of the scale takes the color of its end.

use rayon::prelude::*;

use super::curves::log2;
use super::quantile::quantile;
use super::{finite, finite_luminance};
use crate::frame::Radiance;

/// How values are spread over a scale; by these names in files.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Spacing {
    /// Equal ratios, as eyes judge light.
    #[default]
    Log,
    /// Equal differences.
    Linear,
}

/// Which value has which color.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColorScale {
    /// How values are spread.
    pub spacing: Spacing,
    /// Value of the first color, in the unit of the picture; above 0 for [`Spacing::Log`].
    pub low: f32,
    /// Value of the last color; above `low`.
    pub high: f32,
}

/// Most decades of a scale that fits itself.
const MOST_DECADES: f32 = 1e4;

/// Steps of a decade at which scales begin and end.
const STEPS: [f32; 3] = [1.0, 2.0, 5.0];

impl ColorScale {
    /// A scale for a picture: from its 0.5 percentile (from 0 if linear, from a ten-thousandth of the end at least if not)
    /// to its 99.5 percentile, widened to 1, 2 or 5 times a power of ten.
    pub fn fitting(picture: &Radiance, spacing: Spacing) -> Self {
        let mut values: Vec<f32> = picture.pixels.par_iter().map(finite_luminance).collect();
        values.retain(|v| *v > 0.0);
        if values.is_empty() {
            return Self { spacing, low: if spacing == Spacing::Log { 0.1 } else { 0.0 }, high: 1.0 };
        }
        let quantile = |q| quantile(&values, |value| *value, q);
        // Bounds that f32 can hold with room on both sides.
        let high = step_above(quantile(0.995).clamp(1e-20, 1e20));
        let low = match spacing {
            Spacing::Linear => 0.0,
            Spacing::Log => step_below(quantile(0.005).max(high / MOST_DECADES)).min(high / 10.0),
        };
        Self { spacing, low, high }
    }

    /// Place of a value on the scale, 0 … 1.
    pub fn position(&self, value: f32) -> f32 {
        let (start, per_unit) = self.line();
        ((self.bent(finite(value)) - start) * per_unit).clamp(0.0, 1.0)
    }

    /// Values with a mark, from low to high: round ones, or else the ends; at most `most`.
    pub fn ticks(&self, most: usize) -> Vec<f32> {
        let near = |end: f32| 1e-4 * end.abs();
        let inside = |v: &f32| *v >= self.low - near(self.low) && *v <= self.high + near(self.high);
        let round: Vec<f32> = match self.spacing {
            Spacing::Linear => {
                let step = step_above((self.high - self.low) / most.max(1) as f32);
                let first = (self.low / step).ceil();
                (0..=most).map(|i| (first + i as f32) * step).filter(inside).collect()
            }
            Spacing::Log => {
                let decades = (self.low.log10().floor() as i32)..=(self.high.log10().ceil() as i32);
                let values = |steps: &'static [f32]| -> Vec<f32> {
                    let values = decades.clone().flat_map(|d| steps.iter().map(move |s| s * 10f32.powi(d)));
                    values.filter(inside).collect()
                };
                let (coarse, fine) = (values(&STEPS[..1]), values(&STEPS));
                if fine.len() <= most || coarse.is_empty() { fine } else { coarse }
            }
        };
        let marks = if round.is_empty() { vec![self.low, self.high] } else { round };
        let stride = marks.len().div_ceil(most.max(1)).max(1);
        marks.into_iter().step_by(stride).collect()
    }

    /// Start, and reciprocal of the length, of the scale in the measure of its spacing.
    pub(crate) fn line(&self) -> (f32, f32) {
        let (start, end) = (self.bent(self.low), self.bent(self.high));
        (start, 1.0 / (end - start).max(f32::MIN_POSITIVE))
    }

    fn bent(&self, value: f32) -> f32 {
        match self.spacing {
            Spacing::Log => log2(value.max(f32::MIN_POSITIVE)),
            Spacing::Linear => value,
        }
    }
}

/// The least of 1, 2, 5 times a power of ten that is not below a positive value.
fn step_above(value: f32) -> f32 {
    steps_near(value).into_iter().find(|step| *step >= value * 0.9999).unwrap_or(value)
}

/// The largest of 1, 2, 5 times a power of ten that is not above a positive value.
fn step_below(value: f32) -> f32 {
    steps_near(value).into_iter().rev().find(|step| *step <= value * 1.0001).unwrap_or(value)
}

fn steps_near(value: f32) -> [f32; 5] {
    let decade = 10f32.powi(value.log10().floor() as i32);
    [0.5, 1.0, 2.0, 5.0, 10.0].map(|step| step * decade)
}

/// Largest change of a channel of [`turbo`] per change of the place: that of blue at 0, 12.642, and a little more.
pub(super) const STEEPEST_TURBO: f32 = 12.8;

/// Display-encoded color of a place on the scale, 0 … 1 \[Mikhailov2019\].
pub fn turbo(x: f32) -> [f32; 3] {
    const R: [f32; 6] = [0.135_721_38, 4.615_392_6, -42.660_323, 132.131_08, -152.942_39, 59.286_38];
    const G: [f32; 6] = [0.091_402_61, 2.194_188_4, 4.842_966_6, -14.185_033, 4.277_298_6, 2.829_566];
    const B: [f32; 6] = [0.106_673_3, 12.641_946, -60.582_05, 110.362_77, -89.903_11, 27.348_25];
    [R, G, B].map(|c| ((((c[5] * x + c[4]) * x + c[3]) * x + c[2]) * x + c[1]) * x + c[0]).map(|v| v.clamp(0.0, 1.0))
}

/// Byte per channel of a place on the scale.
pub fn turbo_bytes(x: f32) -> [u8; 3] {
    turbo(x).map(|v| (255.0 * v + 0.5) as u8)
}

/// Writes RGBA, 4 bytes per pixel.
pub(super) fn encode_run<P>(scale: &ColorScale, pixel: impl Fn([u8; 3]) -> P, pixels: &[[f32; 3]], out: &mut [P]) {
    for (out, rgb) in out.iter_mut().zip(pixels) {
        *out = pixel(turbo_bytes(scale.position(finite_luminance(rgb))));
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::gray;
    use super::*;

    #[test]
    fn turbo_has_its_published_colors() {
        // The polynomials, worked out in double precision from the published coefficients.
        let expected = [
            (0.0, [0.135_72, 0.091_4, 0.106_67]),
            (0.25, [0.148_31, 0.740_47, 0.880_72]),
            (0.5, [0.588_52, 0.981_86, 0.313_17]),
            (0.75, [1.0, 0.501_73, 0.113_99]),
            (1.0, [0.565_86, 0.050_39, 0.0]),
        ];
        for (x, color) in expected {
            let near = turbo(x).iter().zip(color).all(|(a, b)| (a - b).abs() < 1e-3);
            assert!(near, "{x}: {:?}", turbo(x));
        }
    }

    #[test]
    fn a_scale_places_values_by_ratio_or_by_difference() {
        let log = ColorScale { spacing: Spacing::Log, low: 1.0, high: 1000.0 };
        for (value, place) in [(1.0, 0.0), (10.0, 1.0 / 3.0), (1000.0, 1.0), (0.0, 0.0), (-5.0, 0.0), (1e9, 1.0)] {
            assert!((log.position(value) - place).abs() < 1e-5, "{value}");
        }
        let linear = ColorScale { spacing: Spacing::Linear, low: 100.0, high: 500.0 };
        for (value, place) in [(100.0, 0.0), (300.0, 0.5), (500.0, 1.0), (f32::NAN, 0.0)] {
            assert!((linear.position(value) - place).abs() < 1e-6, "{value}");
        }
    }

    #[test]
    fn a_fitting_scale_ends_at_round_numbers() {
        let values: Vec<f32> = (1..=1000).map(|i| 0.37 * i as f32).collect();
        let log = ColorScale::fitting(&gray(&values), Spacing::Log);
        assert_eq!((log.low, log.high), (2.0, 500.0));
        let linear = ColorScale::fitting(&gray(&values), Spacing::Linear);
        assert_eq!((linear.low, linear.high), (0.0, 500.0));
        let even = ColorScale::fitting(&gray(&[30.0; 9]), Spacing::Log);
        assert_eq!((even.low, even.high), (5.0, 50.0));
        for black in
            [ColorScale::fitting(&gray(&[0.0; 4]), Spacing::Log), ColorScale::fitting(&gray(&[]), Spacing::Log)]
        {
            assert!(black.low > 0.0 && black.high > black.low);
        }
    }

    #[test]
    fn ticks_are_round_ordered_and_not_too_many() {
        let log = ColorScale { spacing: Spacing::Log, low: 2.0, high: 500.0 };
        assert_eq!(log.ticks(9), [2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0]);
        assert_eq!(log.ticks(4), [10.0, 100.0]);
        let linear = ColorScale { spacing: Spacing::Linear, low: 0.0, high: 500.0 };
        assert_eq!(linear.ticks(6), [0.0, 100.0, 200.0, 300.0, 400.0, 500.0]);
        let below = ColorScale { spacing: Spacing::Linear, low: -60.0, high: -20.0 };
        assert_eq!(below.ticks(5), [-60.0, -50.0, -40.0, -30.0, -20.0]);
        for scale in [log, linear, below] {
            for most in 1..20 {
                let ticks = scale.ticks(most);
                assert!(!ticks.is_empty() && ticks.len() <= most && ticks.is_sorted(), "{most}: {ticks:?}");
            }
        }
    }
}
