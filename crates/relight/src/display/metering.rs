//! Rules that find an exposure for a picture. All answer twice the light with one stop less.

use rayon::prelude::*;

use super::finite_luminance;
use super::quantile::quantile;
use crate::frame::Radiance;

/// Shown brightness of the log-average luminance, before the tone curve: middle gray \[Reinhard2002\].
const MIDDLE_GRAY: f64 = 0.18;

/// Share of the mean below which a pixel counts as that dark in the log-average: black has no logarithm.
const DARKEST: f64 = 1e-5;

/// How the exposure of a picture is found where none is set.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Metering {
    /// Four times the median luminance is shown as 1.
    #[default]
    Auto,
    /// The log-average luminance is shown as 0.18 \[Reinhard2002\].
    LogAverage,
    /// The luminance that this percentage of the pixels stays below is shown as 1; 0 … 100.
    Percentile(f32),
}

impl Metering {
    /// Exposure in EV for a picture; 0 for one that is black altogether.
    pub fn exposure_ev(self, radiance: &Radiance) -> f32 {
        if radiance.pixels.is_empty() {
            return 0.0;
        }
        let quantile = |q| quantile(&radiance.pixels, finite_luminance, q);
        let first = match self {
            Self::Auto => 4.0 * quantile(0.5),
            Self::Percentile(percent) => quantile(0.01 * percent),
            Self::LogAverage => return log_average_ev(radiance),
        };
        // Else the brightest 0.5 % of a picture that is mostly black, or the brightest of all.
        let mut candidates = std::iter::once(first).chain([0.995, 1.0].into_iter().map(quantile));
        candidates.find(|white| *white > 0.0).map_or(0.0, |white| -white.log2())
    }
}

/// Exposure in EV by the rule [`Metering::Auto`].
pub fn auto_exposure_ev(radiance: &Radiance) -> f32 {
    Metering::Auto.exposure_ev(radiance)
}

/// Sums in f64 and in the order of the pixels, so that the answer does not depend on the number of threads.
fn log_average_ev(radiance: &Radiance) -> f32 {
    let values: Vec<f32> = radiance.pixels.par_iter().map(finite_luminance).collect();
    let n = values.len() as f64;
    let mean = values.iter().map(|v| f64::from(v.max(0.0))).sum::<f64>() / n;
    if mean <= 0.0 {
        return 0.0;
    }
    let darkest = DARKEST * mean;
    let log_average = values.iter().map(|v| f64::from(*v).max(darkest).log2()).sum::<f64>() / n;
    (MIDDLE_GRAY.log2() - log_average) as f32
}

#[cfg(test)]
mod tests {
    use super::super::tests::gray;
    use super::*;

    #[test]
    fn auto_exposure_shows_four_medians_as_one() {
        let ev = auto_exposure_ev(&gray(&[1.0, 2.0, 3.0]));
        assert!((8.0 * ev.exp2() - 1.0).abs() < 1e-6);
        assert_eq!(auto_exposure_ev(&gray(&[0.0; 9])), 0.0);
        let mut mostly_black = [0.0; 1000];
        mostly_black[..10].fill(16.0);
        assert_eq!(auto_exposure_ev(&gray(&mostly_black)), -4.0);
        assert_eq!(auto_exposure_ev(&gray(&[0.0, 0.0, f32::NAN])), 0.0);
        assert_eq!(auto_exposure_ev(&Radiance::default()), 0.0);
    }

    #[test]
    fn the_log_average_is_the_geometric_mean_and_is_shown_as_middle_gray() {
        // The geometric mean of 1, 4 and 16 is 4.
        let ev = Metering::LogAverage.exposure_ev(&gray(&[1.0, 16.0, 4.0]));
        assert!((4.0 * ev.exp2() - 0.18).abs() < 1e-6, "{ev}");
        // Half of the pixels black: they count as 1e-5 of the mean, which is 1.
        let ev = Metering::LogAverage.exposure_ev(&gray(&[0.0, 2.0]));
        assert!(((2e-5f32).sqrt() * ev.exp2() - 0.18).abs() < 1e-5, "{ev}");
        assert_eq!(Metering::LogAverage.exposure_ev(&gray(&[0.0, -1.0, f32::NAN])), 0.0);
    }

    #[test]
    fn a_percentile_is_shown_as_one() {
        let values: Vec<f32> = (0..=100).rev().map(|i| i as f32).collect();
        for percent in [90.0, 99.0, 100.0] {
            let ev = Metering::Percentile(percent).exposure_ev(&gray(&values));
            assert!((percent * ev.exp2() - 1.0).abs() < 1e-6, "{percent}: {ev}");
        }
        assert!(Metering::Percentile(0.0).exposure_ev(&gray(&values)) < -6.0, "0 is black, so the brightest counts");
    }

    #[test]
    fn twice_the_light_is_one_stop_less_by_every_rule() {
        let values: Vec<f32> = (0..500).map(|i| (i * i % 97) as f32 * 0.3).collect();
        let doubled: Vec<f32> = values.iter().map(|v| 2.0 * v).collect();
        for rule in [Metering::Auto, Metering::LogAverage, Metering::Percentile(95.0)] {
            let difference = rule.exposure_ev(&gray(&values)) - rule.exposure_ev(&gray(&doubled));
            assert!((difference - 1.0).abs() < 1e-5, "{rule:?}: {difference}");
        }
    }
}
