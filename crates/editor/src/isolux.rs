//! Isolux lines: where equal light arrives, at the values that standards name, with their labels.

mod contour;
mod labels;
mod sheet;
mod smooth;

use clerestory_relight::Radiance;
use clerestory_relight::display::luminance;
use rayon::prelude::*;

use crate::illuminance::FOOT_CANDLE_LX;
use crate::legend::number_words;

use contour::{Field, contours};
pub use labels::{Label, place_labels};
pub use sheet::{draw, lay_over, lay_over_deep};
use smooth::smoothed;

/// Which lines are drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Isolux {
    /// None.
    #[default]
    Off,
    /// At values in lux.
    Lux,
    /// At values in foot-candles.
    FootCandles,
}

/// A line along which the same light arrives.
#[derive(Clone, Debug, PartialEq)]
pub struct Isoline {
    /// Illuminance, lux.
    pub lux: f64,
    /// What its label says.
    pub words: String,
    /// Places in the picture one after the other, pixels from its upper left corner; the middle of the first pixel is at ½, ½. The
    /// first and the last place of a closed line are the same.
    pub points: Vec<[f32; 2]>,
}

/// Steps of illuminance of EN 12464-1, rounded to those that plans show, lux; and those of lighting handbooks in foot-candles.
const LUX: [f64; 21] = [
    1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 300.0, 500.0, 750.0, 1e3, 1500.0, 2e3, 3e3, 5e3, 7500.0, 1e4, 2e4,
    5e4, 1e5,
];
const FOOT_CANDLES: [f64; 18] =
    [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 50.0, 75.0, 100.0, 200.0, 500.0, 1e3, 2e3, 5e3, 1e4];
/// Lines shorter than this share of width and height together are grains of noise.
const GRAIN: f32 = 0.04;
/// Where the light of neighboring pixels differs by this factor, at outlines and at hard shadows, lines end: all of them would run
/// there side by side.
const JUMP: f32 = 1.6;

impl Isolux {
    /// All choices.
    pub const ALL: [Isolux; 3] = [Isolux::Off, Isolux::Lux, Isolux::FootCandles];

    /// Name in files.
    pub fn name(self) -> &'static str {
        match self {
            Isolux::Off => "off",
            Isolux::Lux => "lux",
            Isolux::FootCandles => "foot_candles",
        }
    }

    /// Values that get a line, in lux, and their labels.
    fn levels(self) -> Vec<(f64, String)> {
        let words = |value: f64, unit: &str| format!("{} {unit}", number_words(value as f32));
        match self {
            Isolux::Off => Vec::new(),
            Isolux::Lux => LUX.map(|lux| (lux, words(lux, "lx"))).into(),
            Isolux::FootCandles => FOOT_CANDLES.map(|fc| (fc * FOOT_CANDLE_LX, words(fc, "fc"))).into(),
        }
    }

    /// The lines of a picture of irradiance, lux per channel; those of one value come one after the other.
    pub fn lines(self, irradiance: &Radiance) -> Vec<Isoline> {
        let lux = irradiance.pixels.iter().map(|rgb| luminance(*rgb)).collect();
        let (width, height) = (irradiance.width as usize, irradiance.height as usize);
        let field = smoothed(&Field { width, height, values: lux, jump: JUMP });
        let least = GRAIN * (irradiance.width + irradiance.height) as f32;
        let of_level = |(lux, words): (f64, String)| {
            let lines = contours(&field, lux as f32).into_iter().filter(move |points| length(points) >= least);
            lines.map(|points| Isoline { lux, words: words.clone(), points }).collect::<Vec<_>>()
        };
        self.levels().into_par_iter().flat_map_iter(of_level).collect()
    }
}

/// Length of a line in pixels.
fn length(points: &[[f32; 2]]) -> f32 {
    points.windows(2).map(|ends| distance(ends[0], ends[1])).sum()
}

fn distance(a: [f32; 2], b: [f32; 2]) -> f32 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A floor seen from straight above, a pixel a centimeter, under a point lamp of so many candela: E = I·h / (h² + r²)^1.5.
    fn floor(candela: f32, height_m: f32, side: u32) -> Radiance {
        let lux = |nth: u32| {
            let meters = |px: u32| (px as f32 + 0.5 - side as f32 / 2.0) * 0.01;
            let (x, y) = (meters(nth % side), meters(nth / side));
            [candela * height_m / (height_m * height_m + x * x + y * y).powf(1.5); 3]
        };
        Radiance { width: side, height: side, pixels: (0..side * side).map(lux).collect() }
    }

    #[test]
    fn lines_under_a_lamp_are_circles_of_the_radius_that_the_inverse_square_law_gives() {
        let (candela, height) = (1000.0f32, 1.2f32);
        let lines = Isolux::Lux.lines(&floor(candela, height, 401));
        // 1000 / 1.2² is 694 lx below the lamp, and the corners are 2.83 m away.
        let told: Vec<(f64, &str)> = lines.iter().map(|line| (line.lux, line.words.as_str())).collect();
        let middle = |line: &Isoline| line.points.first() == line.points.last();
        assert_eq!(
            told[told.len() - 4..],
            [(100.0, "100 lx"), (200.0, "200 lx"), (300.0, "300 lx"), (500.0, "500 lx")]
        );
        for line in &lines[lines.len() - 4..] {
            assert!(middle(line), "{} lx is closed", line.lux);
            // r = √((I·h / E)^⅔ − h²)
            let radius_m = ((candela * height / line.lux as f32).powf(2.0 / 3.0) - height * height).sqrt();
            for [x, y] in &line.points {
                let r = (x - 200.5).hypot(y - 200.5) * 0.01;
                assert!((r - radius_m).abs() < 5e-4, "{} lx at {r} m, not {radius_m} m", line.lux);
            }
        }
    }

    #[test]
    fn foot_candles_are_lines_of_their_own() {
        let lines = Isolux::FootCandles.lines(&floor(1000.0, 1.2, 401));
        let radius_m = ((1000.0f32 * 1.2 / (20.0 * 10.763_91)).powf(2.0 / 3.0) - 1.44).sqrt();
        let line = lines.iter().find(|line| line.words == "20 fc").unwrap();
        let r = (line.points[0][0] - 200.5).hypot(line.points[0][1] - 200.5) * 0.01;
        assert!((r - radius_m).abs() < 5e-4, "{r} m, not {radius_m} m");
        assert!(lines.iter().all(|line| line.words.ends_with(" fc")));
        assert!(Isolux::Off.lines(&floor(1000.0, 1.2, 41)).is_empty());
    }

    #[test]
    fn grains_get_no_line() {
        let mut grain = Radiance { width: 200, height: 200, pixels: vec![[90.0; 3]; 40_000] };
        for pixel in [20_100, 20_101, 20_300, 20_301] {
            grain.pixels[pixel] = [140.0; 3];
        }
        assert!(Isolux::Lux.lines(&grain).is_empty());
        assert!(Isolux::Lux.lines(&Radiance::default()).is_empty());
    }
}
