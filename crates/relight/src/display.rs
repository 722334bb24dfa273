//! From linear radiance to display-encoded pixels: exposure, white balance, tone curve, sRGB; or false color.
//!
//! Exposure 0 EV shows a radiance of 1 nit as 1.0 before the tone curve; each EV doubles it. White balance comes between
//! exposure and curve, and is left out where no white point is set. The curves map linear Rec. 709 to linear Rec. 709 between
//! 0 and 1; what they leave above 1 clips. Then comes the sRGB encoding, rounded or dithered to bytes.
//! `shaders/display.wgsl` is the twin and agrees within one step of 255.

mod curves;
mod dither;
pub(crate) mod exact;
mod false_color;
mod inverse;
mod metering;
mod quantile;
mod run;
mod unseen;
mod white;

use std::sync::OnceLock;

use rayon::prelude::*;
use run::encode_run;

use crate::frame::Radiance;
pub use exact::encode16;
pub use false_color::{ColorScale, Spacing, turbo, turbo_bytes};
pub use inverse::radiance_of;
pub use metering::{Metering, auto_exposure_ev};
pub use white::WhitePoint;

/// A tone curve; by these names in files.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Tone {
    /// Troy Sobotka's AgX \[Sobotka2022\], base contrast without a look on top, for Rec. 709, in the small form with a contrast
    /// polynomial of sixth order \[Wrensch2023\]: a long shoulder, bright colors go to white. Not Blender's AgX, which bends
    /// in Rec. 2020.
    #[default]
    Agx,
    /// Stephen Hill's fit to the reference rendering and output transform of ACES \[Hill2016\], without an exposure of its own:
    /// 0.18 comes out as 0.106, as ACES has it.
    Aces,
    /// Khronos PBR neutral \[Khronos2024\]: true colors up to 0.8, a short shoulder.
    Neutral,
    /// Reinhard's extended curve by luminance, 4.0 is white \[Reinhard2002\]: hues stay, bright colors clip.
    Reinhard,
    /// Nothing; what is above 1 clips.
    Linear,
}

impl Tone {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Agx, Self::Aces, Self::Neutral, Self::Reinhard, Self::Linear];
}

/// How values between two bytes are rounded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Dither {
    /// To the nearest.
    #[default]
    Off,
    /// Up or down by a threshold that depends on the pixel's place alone, so that smooth shades show no bands.
    Ordered,
}

/// How radiance is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DisplayParams {
    /// Tone curve.
    pub tone: Tone,
    /// Exposure in EV: 0 shows 1 nit as 1.0 before the tone curve.
    pub exposure_ev: f32,
    /// Light that is shown as neutral; without it colors stay exactly as they are.
    pub white: Option<WhitePoint>,
    /// Rounding to bytes; false color is always rounded to the nearest.
    pub dither: Dither,
    /// Shows the luminance of the picture (lux, where its channels are irradiance) on this scale, instead of all of the above.
    pub false_color: Option<ColorScale>,
}

impl DisplayParams {
    /// Display-linear value per nit, before the tone curve.
    pub fn gain(&self) -> f32 {
        self.exposure_ev.exp2()
    }
}

/// Rec. 709 luminance of a linear color, in the unit of the color.
#[inline(always)]
pub fn luminance([r, g, b]: [f32; 3]) -> f32 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// Display-encoded sRGB with opaque alpha, 4 bytes per pixel, row by row.
pub fn encode(radiance: &Radiance, params: &DisplayParams) -> Vec<u8> {
    encode_as(|[r, g, b]| [r, g, b, 255], radiance, params).into_flattened()
}

/// The same as whatever `pixel` makes of the three bytes of a pixel, row by row: a picture in the form in which it is wanted is
/// written but once.
pub fn encode_as<P: Copy + Default + Send>(
    pixel: impl Fn([u8; 3]) -> P + Sync + Copy,
    radiance: &Radiance,
    params: &DisplayParams,
) -> Vec<P> {
    let mut out = vec![P::default(); radiance.pixels.len()];
    encode_into(pixel, radiance, params, &mut out);
    out
}

/// The same over what is there: as many as the picture has pixels.
pub fn encode_into<P: Copy + Send>(
    pixel: impl Fn([u8; 3]) -> P + Sync + Copy,
    radiance: &Radiance,
    params: &DisplayParams,
    out: &mut [P],
) {
    assert_eq!(out.len(), radiance.pixels.len(), "pictures of one size");
    if let Some(scale) = &params.false_color {
        let runs = out.par_chunks_mut(RUN).zip(radiance.pixels.par_chunks(RUN));
        return runs.for_each(|(out, pixels)| false_color::encode_run(scale, pixel, pixels, out));
    }
    match params.tone {
        Tone::Agx => encode_with(curves::agx, pixel, radiance, params, out),
        Tone::Aces => encode_with(curves::aces, pixel, radiance, params, out),
        Tone::Neutral => encode_with(curves::neutral, pixel, radiance, params, out),
        Tone::Reinhard => encode_with(curves::reinhard, pixel, radiance, params, out),
        Tone::Linear => encode_with(|rgb| rgb, pixel, radiance, params, out),
    }
}

/// Pixels per unit of parallel work.
const RUN: usize = 4096;

/// Steps of the encoding table: fine enough that near black, where sRGB is steepest, a step is a fifth of a byte.
const TABLE_LEN: usize = 1 << 14;

/// Largest display-linear value before a curve: what curves can square.
const MOST: f32 = 1e6;

fn encode_with<P: Copy + Send>(
    tone: impl Fn([f32; 3]) -> [f32; 3] + Sync + Copy,
    pixel: impl Fn([u8; 3]) -> P + Sync + Copy,
    radiance: &Radiance,
    params: &DisplayParams,
    out: &mut [P],
) {
    match params.white.map(WhitePoint::matrix) {
        None => encode_curved(tone, pixel, radiance, params, out),
        Some(matrix) => encode_curved(move |rgb| tone(white::balanced(&matrix, rgb)), pixel, radiance, params, out),
    }
}

fn encode_curved<P: Copy + Send>(
    tone: impl Fn([f32; 3]) -> [f32; 3] + Sync + Copy,
    pixel: impl Fn([u8; 3]) -> P + Sync + Copy,
    radiance: &Radiance,
    params: &DisplayParams,
    out: &mut [P],
) {
    let gain = params.gain();
    let runs = out.par_chunks_mut(RUN).zip(radiance.pixels.par_chunks(RUN)).enumerate();
    let tables = Tables::of(params.tone);
    match params.dither {
        Dither::Off => {
            let at = |step: i32| tables.bytes[step as usize % TABLE_LEN];
            let pixel = |_, [r, g, b]: [i32; 3]| pixel([at(r), at(g), at(b)]);
            runs.for_each(|(_, (out, pixels))| encode_run(tone, gain, pixel, pixels, out));
        }
        Dither::Ordered => {
            let width = radiance.width.max(1) as usize;
            runs.for_each(|(run, (out, pixels))| {
                let pixel = |place: usize, steps: [i32; 3]| {
                    let place = run * RUN + place;
                    let threshold = dither::threshold((place % width) as u32, (place / width) as u32);
                    pixel(steps.map(|step| ((tables.fractions[step as usize % TABLE_LEN] + threshold) >> 8) as u8))
                };
                encode_run(tone, gain, pixel, pixels, out);
            });
        }
    }
}

/// The sRGB value for each output of a tone curve between 0 and 1.
struct Tables {
    /// Rounded to the nearest.
    bytes: [u8; TABLE_LEN],
    /// In 1/256 of a byte, to which a threshold below 256 is added before the fraction is cut off.
    fractions: [u32; TABLE_LEN],
}

impl Tables {
    /// Those of a tone curve; made once.
    fn of(tone: Tone) -> &'static Self {
        static OF_LINEAR: OnceLock<Box<Tables>> = OnceLock::new();
        static OF_AGX: OnceLock<Box<Tables>> = OnceLock::new();
        match tone {
            Tone::Agx => OF_AGX.get_or_init(|| Self::new(|value| value.powf(curves::AGX_GAMMA))),
            _ => OF_LINEAR.get_or_init(|| Self::new(|value| value)),
        }
    }

    fn new(linear: impl Fn(f32) -> f32) -> Box<Self> {
        let mut tables = Box::new(Self { bytes: [0; TABLE_LEN], fractions: [0; TABLE_LEN] });
        for i in 0..TABLE_LEN {
            let encoded = srgb_from_linear(linear(i as f32 / (TABLE_LEN - 1) as f32));
            tables.bytes[i] = (255.0 * encoded + 0.5) as u8;
            tables.fractions[i] = (255.0 * 256.0 * encoded + 0.5) as u32;
        }
        tables
    }
}

/// Display-linear value before the tone curve: not negative, and within what the curves can square.
#[inline(always)]
fn exposed(radiance: f32, gain: f32) -> f32 {
    // What is no number is black, what is beyond all numbers is white.
    let exposed = radiance * gain;
    if exposed > 0.0 { exposed.min(MOST) } else { 0.0 }
}

/// More than any light, and little enough for sums.
const MOST_NIT: f32 = 1e30;

/// 0 for what is no number; what is beyond all numbers is the most that there is.
#[inline(always)]
fn finite(v: f32) -> f32 {
    if v.is_nan() { 0.0 } else { v.clamp(-MOST_NIT, MOST_NIT) }
}

/// Luminance of a color, of channels as [`finite`] has them.
fn finite_luminance(rgb: &[f32; 3]) -> f32 {
    luminance(rgb.map(finite))
}

/// sRGB encoding of a linear value between 0 and 1 \[IEC61966-2-1\].
pub fn srgb_from_linear(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(super) fn gray(values: &[f32]) -> Radiance {
        Radiance { width: values.len() as u32, height: 1, pixels: values.iter().map(|v| [*v; 3]).collect() }
    }

    fn linear() -> DisplayParams {
        DisplayParams { tone: Tone::Linear, ..DisplayParams::default() }
    }

    #[test]
    fn linear_tone_encodes_within_one_step_of_srgb() {
        let values: Vec<f32> = (0..3000).map(|i| i as f32 / 2900.0).collect();
        let bytes = encode(&gray(&values), &linear());
        for (v, rgba) in values.iter().zip(bytes.as_chunks::<4>().0) {
            let exact = 255.0 * srgb_from_linear(v.min(1.0));
            assert!((f32::from(rgba[0]) - exact).abs() < 0.75 && rgba[3] == 255, "{v}: {rgba:?} against {exact}");
        }
        let bytes = encode(&gray(&[f32::NAN, -1.0, f32::NEG_INFINITY, f32::INFINITY]), &DisplayParams::default());
        assert_eq!([&bytes[..3], &bytes[4..7], &bytes[8..11]], [[0, 0, 0]; 3]);
        let bright = encode(&gray(&[1e9]), &DisplayParams::default());
        assert_eq!(bytes[12..15], bright[..3], "too much light is not dark");
    }

    #[test]
    fn linear_tone_is_the_srgb_encoding_and_nothing_else() {
        // Worked out on paper from the standard's two pieces, in double precision.
        let cases = [
            ([0.0, 0.001, 0.003_130_8], [0.0, 0.012_92, 0.040_45]),
            ([0.02, 0.18, 0.5], [0.151_97, 0.461_36, 0.735_36]),
            ([0.9, 1.0, 4.0], [0.954_69, 1.0, 1.0]),
        ];
        for (rgb, expected) in cases {
            let found = exact::encoded(&linear(), rgb);
            assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-3), "{rgb:?}: {found:?}");
        }
    }

    #[test]
    fn srgb_has_its_published_values() {
        // The ends, the join of both pieces, and middle gray: 0.18 is 117.6 of 255, 0.5 is 187.5.
        for (linear, encoded) in [(0.0, 0.0), (1.0, 1.0), (0.003_130_8, 0.040_45), (0.18, 0.461_36), (0.5, 0.735_36)] {
            assert!((srgb_from_linear(linear) - encoded).abs() < 1e-4, "{linear}");
        }
    }

    #[test]
    fn one_ev_doubles_under_every_curve() {
        for tone in Tone::ALL {
            let picture = |v: f32, exposure_ev: f32| {
                encode(&gray(&[v]), &DisplayParams { tone, exposure_ev, ..DisplayParams::default() })
            };
            assert_eq!(picture(0.2, 1.0), picture(0.4, 0.0));
            assert_ne!(picture(0.2, 0.0), picture(0.4, 0.0));
        }
    }

    #[test]
    fn dithered_bytes_average_to_what_lies_between_them() {
        // A flat picture of a value between the bytes 128 and 129.
        let wanted = 128.3f32;
        let linear_value = ((wanted / 255.0 + 0.055) / 1.055).powf(2.4);
        let flat = Radiance { width: 128, height: 64, pixels: vec![[linear_value; 3]; 128 * 64] };
        let bytes = encode(&flat, &DisplayParams { dither: Dither::Ordered, ..linear() });
        let mean = bytes.as_chunks::<4>().0.iter().map(|p| f32::from(p[1])).sum::<f32>() / (128.0 * 64.0);
        assert!((mean - wanted).abs() < 0.02, "{mean}");
        let rounded = encode(&flat, &linear());
        assert!(bytes.iter().zip(&rounded).all(|(a, b)| a.abs_diff(*b) <= 1) && bytes != rounded);
        for v in [0.0, 1.0] {
            let params = DisplayParams { dither: Dither::Ordered, ..linear() };
            assert_eq!(encode(&gray(&[v; 600]), &params), encode(&gray(&[v; 600]), &linear()), "black and white stay");
        }
    }

    #[test]
    fn light_of_the_white_point_is_shown_gray_and_no_white_point_changes_nothing() {
        // A white wall under 3000 K, in linear Rec. 709: xyY of the Planckian locus [Kim2002].
        let warm = WhitePoint { kelvin: 3000.0, duv: 0.0 };
        let wall = Radiance { width: 1, height: 1, pixels: vec![[1.767, 0.845, 0.273].map(|v| 0.4 * v)] };
        let [r, g, b, _] = encode(&wall, &DisplayParams { white: Some(warm), ..linear() })[..] else { panic!() };
        assert!(r.abs_diff(g) <= 2 && g.abs_diff(b) <= 2, "{r} {g} {b}");
        let [r, _, b, _] = encode(&wall, &linear())[..] else { panic!() };
        assert!(r > b + 60, "{r} {b}");
    }

    #[test]
    fn false_color_tells_luminance_alone() {
        let scale = ColorScale { spacing: Spacing::Log, low: 1.0, high: 100.0 };
        let params = DisplayParams { false_color: Some(scale), exposure_ev: 3.0, ..DisplayParams::default() };
        let green = Radiance { width: 1, height: 1, pixels: vec![[0.0, 10.0 / 0.7152, 0.0]] };
        let expected = turbo_bytes(0.5);
        assert_eq!(encode(&green, &params)[..3], expected);
        assert_eq!(encode(&gray(&[10.0]), &params)[..3], expected);
    }

    #[test]
    fn names_in_files_stay() {
        let text = serde_json::to_string(&Tone::ALL).unwrap();
        assert_eq!(text, r#"["agx","aces","neutral","reinhard","linear"]"#);
    }
}
