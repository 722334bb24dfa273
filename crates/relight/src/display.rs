//! From linear radiance to display-encoded pixels: exposure, tone curve, sRGB.
//!
//! Exposure 0 EV shows a radiance of 1 nit as 1.0 before the tone curve; each EV doubles it. The curves map linear
//! Rec. 709 to linear Rec. 709 between 0 and 1: AgX is Troy Sobotka's \[Sobotka2022\] in the small form with a polynomial
//! contrast curve \[Wrensch2023\]; neutral is the Khronos PBR neutral curve \[Khronos2024\]; linear clips.
//! `shaders/display.wgsl` is the twin and agrees within one step of 255.

use rayon::prelude::*;

use crate::frame::Radiance;

/// A tone curve; by these names in files.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Tone {
    /// AgX: a long shoulder, bright colors go to white.
    #[default]
    Agx,
    /// Khronos PBR neutral: true colors up to 0.8, a short shoulder.
    Neutral,
    /// Nothing; what is above 1 clips.
    Linear,
}

/// How radiance is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct DisplayParams {
    /// Tone curve.
    pub tone: Tone,
    /// Exposure in EV: 0 shows 1 nit as 1.0 before the tone curve.
    pub exposure_ev: f32,
}

impl DisplayParams {
    /// Display-linear value per nit, before the tone curve.
    pub fn gain(&self) -> f32 {
        self.exposure_ev.exp2()
    }
}

/// Rec. 709 luminance of a linear color, in the unit of the color.
pub fn luminance([r, g, b]: [f32; 3]) -> f32 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// Exposure in EV that shows four times the median luminance as 1.0; the brightest 0.5 % of a picture that is mostly
/// black, and 0 EV for one that is black altogether.
pub fn auto_exposure_ev(radiance: &Radiance) -> f32 {
    let mut values: Vec<f32> = radiance.pixels.par_iter().map(|rgb| luminance(rgb.map(finite))).collect();
    if values.is_empty() {
        return 0.0;
    }
    let last = values.len() - 1;
    let mut quantile = |q: f32| *values.select_nth_unstable_by((q * last as f32).round() as usize, f32::total_cmp).1;
    let white = [4.0 * quantile(0.5), quantile(0.995), quantile(1.0)].into_iter().find(|white| *white > 0.0);
    white.map_or(0.0, |white| -white.log2())
}

/// Display-encoded sRGB with opaque alpha, 4 bytes per pixel, row by row.
pub fn encode(radiance: &Radiance, params: &DisplayParams) -> Vec<u8> {
    let (table, gain) = (byte_table(params.tone), params.gain());
    let mut bytes = vec![0; 4 * radiance.pixels.len()];
    let runs = bytes.par_chunks_mut(4 * RUN).zip(radiance.pixels.par_chunks(RUN));
    match params.tone {
        Tone::Agx => runs.for_each(|(bytes, pixels)| encode_run(agx, gain, &table, pixels, bytes)),
        Tone::Neutral => runs.for_each(|(bytes, pixels)| encode_run(neutral, gain, &table, pixels, bytes)),
        Tone::Linear => runs.for_each(|(bytes, pixels)| encode_run(|rgb| rgb, gain, &table, pixels, bytes)),
    }
    bytes
}

/// Pixels per unit of parallel work.
const RUN: usize = 4096;

/// Pixels whose colors go through a curve together, so that the compiler can use vector registers.
const LANES: usize = 8;

/// Steps of the encoding table: fine enough that near black, where sRGB is steepest, a step is a fifth of a byte.
const TABLE_LEN: usize = 1 << 14;

/// The byte for each output of a tone curve between 0 and 1.
fn byte_table(tone: Tone) -> Vec<u8> {
    let byte = |i: usize| {
        let value = i as f32 / (TABLE_LEN - 1) as f32;
        let linear = if tone == Tone::Agx { value.powf(AGX_GAMMA) } else { value };
        (255.0 * srgb_from_linear(linear) + 0.5) as u8
    };
    (0..TABLE_LEN).into_par_iter().with_min_len(1024).map(byte).collect()
}

fn encode_run(tone: impl Fn([f32; 3]) -> [f32; 3], gain: f32, table: &[u8], pixels: &[[f32; 3]], bytes: &mut [u8]) {
    let table: &[u8; TABLE_LEN] = table.try_into().expect("the table was made with this length");
    for (bytes, pixels) in bytes.chunks_mut(4 * LANES).zip(pixels.chunks(LANES)) {
        let mut steps = [[0; 3]; LANES];
        let mut rgb = [[0.0; 3]; LANES];
        rgb[..pixels.len()].copy_from_slice(pixels);
        for (steps, rgb) in steps.iter_mut().zip(rgb) {
            let curved = tone(rgb.map(|v| exposed(v, gain)));
            *steps = curved.map(|v| (v.clamp(0.0, 1.0) * (TABLE_LEN - 1) as f32 + 0.5) as i32);
        }
        for (rgba, steps) in bytes.as_chunks_mut::<4>().0.iter_mut().zip(steps) {
            let [r, g, b] = steps.map(|step| table[step as usize % TABLE_LEN]);
            *rgba = [r, g, b, 255];
        }
    }
}

/// Display-linear value before the tone curve: not negative, and within what the curves can square.
fn exposed(radiance: f32, gain: f32) -> f32 {
    (finite(radiance) * gain).clamp(0.0, 1e6)
}

fn finite(v: f32) -> f32 {
    if v.is_finite() { v } else { 0.0 }
}

/// sRGB encoding of a linear value between 0 and 1 \[IEC61966-2-1\].
pub fn srgb_from_linear(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// Row-major; into the space in which AgX bends each channel \[Wrensch2023\].
const AGX_INSET: [[f32; 3]; 3] = [
    [0.842_479_06, 0.078_433_6, 0.079_223_745],
    [0.042_328_242, 0.878_468_64, 0.079_166_13],
    [0.042_375_655, 0.078_433_6, 0.879_143],
];

/// Row-major; out of it again \[Wrensch2023\].
const AGX_OUTSET: [[f32; 3]; 3] = [
    [1.196_879, -0.098_020_88, -0.099_029_74],
    [-0.052_896_85, 1.151_903_1, -0.098_961_18],
    [-0.052_971_635, -0.098_043_45, 1.151_073_7],
];

/// The range that AgX covers, in stops.
const AGX_EV: [f32; 2] = [-12.473_93, 4.026_069];

/// The same range in display-linear values.
const AGX_RANGE: [f32; 2] = [1.757_812e-4, 16.291_74];

/// AgX answers in values for a display of this gamma.
const AGX_GAMMA: f32 = 2.2;

/// AgX up to the encoding for its own display; [`byte_table`] goes on from there.
fn agx(rgb: [f32; 3]) -> [f32; 3] {
    let bent = mul(&AGX_INSET, rgb).map(|v| {
        let stops = log2(v.clamp(AGX_RANGE[0], AGX_RANGE[1]));
        agx_contrast((stops - AGX_EV[0]) * (1.0 / (AGX_EV[1] - AGX_EV[0])))
    });
    mul(&AGX_OUTSET, bent)
}

/// The contrast curve, sixth order: of the two that are published, the one that reaches black and white \[Wrensch2023\].
fn agx_contrast(x: f32) -> f32 {
    (((((15.5 * x - 40.14) * x + 31.96) * x - 6.868) * x + 0.4298) * x + 0.1191) * x - 0.002_32
}

/// The Khronos PBR neutral curve \[Khronos2024\].
fn neutral([r, g, b]: [f32; 3]) -> [f32; 3] {
    const START: f32 = 0.8 - 0.04;
    const DESATURATION: f32 = 0.15;

    // Take off what a dielectric reflects at normal incidence, so that base colors come out as they were authored.
    let least = r.min(g).min(b);
    let offset = if least < 0.08 { least - 6.25 * least * least } else { 0.04 };
    let rgb = [r - offset, g - offset, b - offset];

    // Compress what is brighter, and let it go to white.
    let peak = rgb[0].max(rgb[1]).max(rgb[2]);
    if peak < START {
        return rgb;
    }
    let room = 1.0 - START;
    let new_peak = 1.0 - room * room / (peak + room - START);
    let white = 1.0 - 1.0 / (DESATURATION * (peak - new_peak) + 1.0);
    rgb.map(|v| v * new_peak / peak * (1.0 - white) + new_peak * white)
}

fn mul(m: &[[f32; 3]; 3], [r, g, b]: [f32; 3]) -> [f32; 3] {
    m.map(|row| row[0] * r + row[1] * g + row[2] * b)
}

/// Logarithm of a positive normal number, within 1e-6: atanh series on a mantissa around 1. Unlike the library's it is
/// inlined, which makes encoding several times faster.
fn log2(x: f32) -> f32 {
    const SQRT_HALF_BITS: u32 = 0x3f35_04f3;
    let shifted = x.to_bits().wrapping_sub(SQRT_HALF_BITS);
    let exponent = (shifted as i32 >> 23) as f32;
    let mantissa = f32::from_bits((shifted & 0x007f_ffff) + SQRT_HALF_BITS);
    let s = (mantissa - 1.0) / (mantissa + 1.0);
    let s2 = s * s;
    exponent + s * (2.885_39 + s2 * (0.961_796_7 + s2 * (0.577_078 + s2 * 0.412_199)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gray(values: &[f32]) -> Radiance {
        Radiance { width: values.len() as u32, height: 1, pixels: values.iter().map(|v| [*v; 3]).collect() }
    }

    #[test]
    fn the_inlined_logarithm_agrees_with_the_library() {
        for i in -4000..4000 {
            let x = (i as f32 * 0.01).exp2() * 1.37;
            assert!((log2(x) - x.log2()).abs() < 1e-6 * x.log2().abs().max(1.0), "log2({x})");
        }
        AGX_EV.iter().zip(AGX_RANGE).for_each(|(ev, v)| assert!((ev.exp2() / v - 1.0).abs() < 1e-5, "{ev} {v}"));
    }

    #[test]
    fn every_curve_is_monotonic_and_ends_at_white() {
        for tone in [agx, neutral] {
            let mut last = -1.0;
            for i in 0..2000 {
                let v = tone([(i as f32 / 100.0 - 10.0).exp2(); 3])[1];
                assert!(v >= last - 1e-4, "step {i}: {v} after {last}");
                last = v;
            }
            assert!(last > 0.99, "ends at {last}");
        }
    }

    #[test]
    fn agx_shows_middle_gray_in_the_middle_and_neutral_keeps_base_color() {
        let gray = agx([0.18; 3]);
        assert!(gray.iter().all(|v| (v - 0.5).abs() < 0.01), "{gray:?}");
        let base = neutral([0.5 + 0.04, 0.3 + 0.04, 0.2 + 0.04]);
        for (found, expected) in base.iter().zip([0.5, 0.3, 0.2]) {
            assert!((found - expected).abs() < 1e-6);
        }
    }

    #[test]
    fn linear_tone_encodes_within_one_step_of_srgb() {
        let values: Vec<f32> = (0..3000).map(|i| i as f32 / 2900.0).collect();
        let bytes = encode(&gray(&values), &DisplayParams { tone: Tone::Linear, exposure_ev: 0.0 });
        for (v, rgba) in values.iter().zip(bytes.as_chunks::<4>().0) {
            let exact = 255.0 * srgb_from_linear(v.min(1.0));
            assert!((f32::from(rgba[0]) - exact).abs() < 0.75 && rgba[3] == 255, "{v}: {rgba:?} against {exact}");
        }
        assert_eq!(encode(&gray(&[f32::NAN, -1.0]), &DisplayParams::default())[..3], [0, 0, 0]);
    }

    #[test]
    fn one_ev_doubles() {
        let picture = |v: f32, exposure_ev: f32| encode(&gray(&[v]), &DisplayParams { tone: Tone::Agx, exposure_ev });
        assert_eq!(picture(0.2, 1.0), picture(0.4, 0.0));
        assert_ne!(picture(0.2, 0.0), picture(0.4, 0.0));
    }

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
    fn names_in_files_stay() {
        let text = serde_json::to_string(&[Tone::Agx, Tone::Neutral, Tone::Linear]).unwrap();
        assert_eq!(text, r#"["agx","neutral","linear"]"#);
    }
}
