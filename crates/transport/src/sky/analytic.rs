//! Daylight of a clear sky by \[Preetham1999\], and the sun beside it.
//!
//! The sky's luminance is the paper's, in absolute units. Below the horizon lies a ground that reflects a fifth of what
//! reaches it. After sunset the sky of the horizon is dimmed tenfold for each 2.9°, as twilight is.

use std::f64::consts::PI;

use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;

use super::Environment;
use super::environment::{direction_at, level_irradiance, row_sines};
use crate::light::rgb_of_xyz;

/// Haze of a clear day.
pub const DEFAULT_TURBIDITY: f32 = 3.0;

/// Pixels of the map: smooth but for the glow around the sun.
const SIZE: [usize; 2] = [512, 256];
/// Reflectance of the ground below the horizon.
const GROUND_ALBEDO: f64 = 0.2;
/// Degrees of depression that dim twilight tenfold.
const TWILIGHT_DEG: f64 = 2.9;
/// Illuminance by the sun outside the atmosphere in lux.
const EXTRATERRESTRIAL_LX: f64 = 133_800.0;

/// The sky with its sun at a unit direction; turbidity 2 (very clear) to 10 (hazy).
pub fn analytic_sky(sun: Vec3, turbidity: f32) -> Environment {
    let model = Preetham::new(sun, f64::from(turbidity));
    let [width, height] = SIZE;
    let mut pixels = vec![[0.0; 3]; width * height];
    let (above, below) = pixels.split_at_mut(width * height / 2);
    let around: Vec<Vec3> = (0..width).map(|x| direction_at(Vec2::new((x as f32 + 0.5) / width as f32, 0.5))).collect();
    above.par_chunks_exact_mut(width).enumerate().for_each(|(y, row)| {
        // Half across the map lies +X, where a direction is its sine and its cosine.
        let up = direction_at(Vec2::new(0.5, y as f32 / (height - 1) as f32));
        let circle = model.circle(f64::from(up.y));
        for (pixel, side) in row.iter_mut().zip(&around) {
            *pixel = model.radiance(&circle, Vec3::new(side.x * up.x, up.y, side.z * up.x)).to_array();
        }
    });
    let rows = above.chunks_exact(width).enumerate().map(|(y, row)| (row_sines(height, y), row));
    let direct = sun_tint(sun, turbidity) * sun_illuminance(sun, turbidity) * sun.y.max(0.0);
    let ground = (level_irradiance(rows) + direct) * (GROUND_ALBEDO / PI) as f32;
    below.fill(ground.to_array());
    Environment::of_clean(width, height, pixels)
}

/// Illuminance in lux by the sun on a surface that faces it: \[Navvab1984\] with the air mass of \[Kasten1989\].
pub fn sun_illuminance(sun: Vec3, turbidity: f32) -> f32 {
    let Some(mass) = air_mass(sun) else { return 0.0 };
    let extinction = 0.1 / (1.0 + 0.0045 * mass);
    (EXTRATERRESTRIAL_LX * (-extinction * mass * f64::from(turbidity)).exp()) as f32
}

/// Color of the sun at luminance 1: what Rayleigh scattering and haze leave at the wavelengths of the primaries.
/// \[Preetham1999, A.1\]
pub fn sun_tint(sun: Vec3, turbidity: f32) -> Vec3 {
    let mass = air_mass(sun).unwrap_or(38.0);
    let haze = 0.046_08 * f64::from(turbidity) - 0.045_86;
    let left = [0.610, 0.549, 0.468].map(|micrometers: f64| {
        let depth = 0.008_735 * micrometers.powf(-4.08) + haze * micrometers.powf(-1.3);
        (-depth * mass).exp()
    });
    let tint = DVec3::from(left).as_vec3();
    tint / crate::light::luminance(tint).max(f32::MIN_POSITIVE)
}

/// Atmosphere on the way relative to the zenith; `None` below the horizon.
fn air_mass(sun: Vec3) -> Option<f64> {
    let elevation_deg = f64::from(sun.y).clamp(-1.0, 1.0).asin().to_degrees();
    (elevation_deg >= 0.0)
        .then(|| 1.0 / (elevation_deg.to_radians().sin() + 0.505_72 * (elevation_deg + 6.079_95).powf(-1.6364)))
}

/// Perez coefficients A…E.
type Perez = [f64; 5];

/// The model for one sun.
struct Preetham {
    sun: DVec3,
    /// For luminance and both chromaticities.
    perez: [Perez; 3],
    /// Values at the zenith over those of the coefficients there: luminance in nit, then chromaticities.
    zenith: [f64; 3],
}

impl Preetham {
    fn new(sun: Vec3, turbidity: f64) -> Preetham {
        let t = turbidity.clamp(1.7, 10.0);
        let above = DVec3::new(f64::from(sun.x), f64::from(sun.y).max(0.0), f64::from(sun.z));
        let sun_up = above.normalize_or(DVec3::X);
        let theta = sun_up.y.clamp(-1.0, 1.0).acos();
        let line = |slope: f64, offset: f64| slope * t + offset;
        let perez = [
            [
                line(0.1787, -1.4630),
                line(-0.3554, 0.4275),
                line(-0.0227, 5.3251),
                line(0.1206, -2.5771),
                line(-0.0670, 0.3703),
            ],
            [
                line(-0.0193, -0.2592),
                line(-0.0665, 0.0008),
                line(-0.0004, 0.2125),
                line(-0.0641, -0.8989),
                line(-0.0033, 0.0452),
            ],
            [
                line(-0.0167, -0.2608),
                line(-0.0950, 0.0092),
                line(-0.0079, 0.2102),
                line(-0.0441, -1.6537),
                line(-0.0109, 0.0529),
            ],
        ];
        let chi = (4.0 / 9.0 - t / 120.0) * (PI - 2.0 * theta);
        let depression_deg = -f64::from(sun.y).clamp(-1.0, 0.0).asin().to_degrees();
        let twilight = 10f64.powf(-depression_deg / TWILIGHT_DEG);
        let luminance = 1000.0 * ((4.0453 * t - 4.9710) * chi.tan() - 0.2155 * t + 2.4192).max(0.0) * twilight;
        let cubic = |c: [f64; 4]| ((c[0] * theta + c[1]) * theta + c[2]) * theta + c[3];
        let zenith_x = t * t * cubic([0.001_66, -0.003_75, 0.002_09, 0.0])
            + t * cubic([-0.029_03, 0.063_77, -0.032_02, 0.003_94])
            + cubic([0.116_93, -0.211_96, 0.060_52, 0.258_86]);
        let zenith_y = t * t * cubic([0.002_75, -0.006_10, 0.003_17, 0.0])
            + t * cubic([-0.042_14, 0.089_70, -0.041_53, 0.005_16])
            + cubic([0.153_46, -0.267_56, 0.066_70, 0.266_88]);
        let values = [luminance, zenith_x, zenith_y];
        let zenith = std::array::from_fn(|i| values[i] / perez_of(&perez[i], 1.0, theta));
        Preetham { sun: sun_up, perez, zenith }
    }

    /// What is the same along a circle of elevation: zenith values times the factors of the elevation alone.
    fn circle(&self, sine: f64) -> [f64; 3] {
        std::array::from_fn(|i| self.zenith[i] * of_elevation(&self.perez[i], sine))
    }

    /// Linear Rec. 709 in nit in a direction on a circle; colors outside the gamut are clipped.
    fn radiance(&self, circle: &[f64; 3], d: Vec3) -> Vec3 {
        let cosine = d.as_dvec3().dot(self.sun).clamp(-1.0, 1.0);
        let gamma = cosine.acos();
        let [luminance, x, y]: [f64; 3] =
            std::array::from_fn(|i| circle[i] * around_the_sun(&self.perez[i], gamma, cosine));
        let luminance = luminance.max(0.0);
        let y = y.max(1e-3);
        rgb_of_xyz(DVec3::new(x / y, 1.0, (1.0 - x - y) / y) * luminance).max(DVec3::ZERO).as_vec3()
    }
}

/// Relative distribution at a sine of the elevation and an angle from the sun. \[Preetham1999, eq. 3\]
fn perez_of(perez: &Perez, sine: f64, gamma: f64) -> f64 {
    of_elevation(perez, sine) * around_the_sun(perez, gamma, gamma.cos())
}

fn of_elevation([a, b, ..]: &Perez, sine: f64) -> f64 {
    1.0 + a * (b / sine.max(1e-3)).exp()
}

fn around_the_sun([_, _, c, d, e]: &Perez, gamma: f64, cosine: f64) -> f64 {
    1.0 + c * (d * gamma).exp() + e * cosine * cosine
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::luminance;
    use crate::sky::{SunPosition, sun_direction};

    fn sun(elevation_deg: f64) -> Vec3 {
        sun_direction(SunPosition { azimuth_deg: 70.0, elevation_deg })
    }

    #[test]
    fn the_zenith_has_the_luminance_of_the_model() {
        // Turbidity 3, the sun 60° from the zenith: χ = (4/9 − 1/40)(π − 2π/3), and 7.1649 tan χ + 1.7727 kcd/m².
        let expected = 1000.0 * (7.1649 * ((4.0f64 / 9.0 - 0.025) * PI / 3.0).tan() + 1.7727);
        let map = analytic_sky(sun(30.0), 3.0);
        let zenith = f64::from(luminance(map.radiance(Vec3::Y)));
        assert!((zenith / expected - 1.0).abs() < 0.02, "{zenith} nit instead of {expected}");
    }

    #[test]
    fn the_sky_is_blue_up_high_and_brightest_around_the_sun() {
        let map = analytic_sky(sun(40.0), 3.0);
        let away = Vec3::new(-sun(40.0).x, 1.5, -sun(40.0).z).normalize();
        let blue = map.radiance(away);
        assert!(blue.z > blue.y && blue.y > blue.x, "{blue}");
        assert!(luminance(map.radiance(sun(40.0))) > 3.0 * luminance(blue));
    }

    #[test]
    fn daylight_has_the_illuminance_of_a_clear_day() {
        // Clear skies are measured at 10 to 25 klx without the sun, and the model is known to be bright around it; the
        // sun at 60° gives about 95 klx more.
        let map = analytic_sky(sun(60.0), 3.0);
        let sky = luminance(map.level_irradiance());
        assert!((8_000.0..35_000.0).contains(&sky), "{sky} lx");
        let direct = sun_illuminance(sun(60.0), 3.0);
        assert!((90_000.0..100_000.0).contains(&direct), "{direct} lx");
        let ground = luminance(map.radiance(Vec3::NEG_Y));
        let expected = 0.2 / std::f32::consts::PI * (sky + direct * sun(60.0).y);
        assert!((ground / expected - 1.0).abs() < 1e-3, "{ground} {expected}");
    }

    #[test]
    fn the_sun_reddens_and_fades_towards_the_horizon_and_is_gone_below() {
        let (high, low) = (sun_tint(sun(60.0), 3.0), sun_tint(sun(3.0), 3.0));
        assert!(low.x / low.z > 2.0 * high.x / high.z, "{high} {low}");
        assert!((luminance(low) - 1.0).abs() < 1e-4);
        assert!(sun_illuminance(sun(3.0), 3.0) < 0.3 * sun_illuminance(sun(60.0), 3.0));
        assert_eq!(sun_illuminance(sun(-1.0), 3.0), 0.0);
        let (dusk, night) = (analytic_sky(sun(0.5), 3.0), analytic_sky(sun(-12.0), 3.0));
        assert!(luminance(night.radiance(Vec3::Y)) < 1e-3 * luminance(dusk.radiance(Vec3::Y)));
        assert!(night.pixels().iter().flatten().all(|v| v.is_finite()));
    }
}
