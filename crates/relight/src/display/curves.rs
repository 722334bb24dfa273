//! Tone curves: linear Rec. 709 from 0 up to linear Rec. 709 between 0 and 1 (or above, where the caller clips).

/// Row-major; into the space in which AgX bends each channel \[Wrensch2023\].
pub(super) const AGX_INSET: [[f32; 3]; 3] = [
    [0.842_479_06, 0.078_433_6, 0.079_223_745],
    [0.042_328_242, 0.878_468_64, 0.079_166_13],
    [0.042_375_655, 0.078_433_6, 0.879_143],
];

/// Row-major; out of it again \[Wrensch2023\].
pub(super) const AGX_OUTSET: [[f32; 3]; 3] = [
    [1.196_879, -0.098_020_88, -0.099_029_74],
    [-0.052_896_85, 1.151_903_1, -0.098_961_18],
    [-0.052_971_635, -0.098_043_45, 1.151_073_7],
];

/// The range that AgX covers, in stops.
pub(super) const AGX_EV: [f32; 2] = [-12.473_93, 4.026_069];

/// The same range in display-linear values.
const AGX_RANGE: [f32; 2] = [1.757_812e-4, 16.291_74];

/// AgX answers in values for a display of this gamma.
pub(super) const AGX_GAMMA: f32 = 2.2;

/// Row-major; into the space in which the fit bends each channel: sRGB to AP1 with the saturation of the RRT \[Hill2016\].
pub(super) const ACES_IN: [[f32; 3]; 3] =
    [[0.597_19, 0.354_58, 0.048_23], [0.076, 0.908_34, 0.015_66], [0.028_4, 0.133_83, 0.837_77]];

/// Row-major; out of it again, with the saturation of the ODT \[Hill2016\].
pub(super) const ACES_OUT: [[f32; 3]; 3] =
    [[1.604_75, -0.531_08, -0.073_67], [-0.102_08, 1.108_13, -0.006_05], [-0.003_27, -0.072_76, 1.076_02]];

/// Luminance that the Reinhard curve shows as 1: two stops above what exposure shows as 1.
pub(super) const REINHARD_WHITE: f32 = 4.0;

/// Brightest channel up to which the neutral curve compresses nothing, and how fast what is brighter goes to white
/// \[Khronos2024\].
pub(super) const NEUTRAL_START: f32 = 0.8 - 0.04;
pub(super) const NEUTRAL_DESATURATION: f32 = 0.15;

/// AgX up to the encoding for its own display, gamma [`AGX_GAMMA`]; the table of bytes goes on from there.
#[inline(always)]
pub(super) fn agx(rgb: [f32; 3]) -> [f32; 3] {
    let [r, g, b] = mul(&AGX_INSET, rgb);
    mul(&AGX_OUTSET, [agx_bent(r), agx_bent(g), agx_bent(b)])
}

#[inline(always)]
pub(super) fn agx_bent(v: f32) -> f32 {
    let stops = log2(v.clamp(AGX_RANGE[0], AGX_RANGE[1]));
    agx_contrast((stops - AGX_EV[0]) * (1.0 / (AGX_EV[1] - AGX_EV[0])))
}

/// The contrast curve, sixth order: of the two that are published, the one that reaches black and white \[Wrensch2023\].
#[inline(always)]
fn agx_contrast(x: f32) -> f32 {
    (((((15.5 * x - 40.14) * x + 31.96) * x - 6.868) * x + 0.4298) * x + 0.1191) * x - 0.002_32
}

/// The fit to reference rendering and output transform of ACES \[Hill2016\], without an exposure of its own.
#[inline(always)]
pub(super) fn aces(rgb: [f32; 3]) -> [f32; 3] {
    let [r, g, b] = mul(&ACES_IN, rgb);
    mul(&ACES_OUT, [aces_bent(r), aces_bent(g), aces_bent(b)])
}

#[inline(always)]
pub(super) fn aces_bent(v: f32) -> f32 {
    (v * (v + 0.024_578_6) - 0.000_090_537) / (v * (0.983_729 * v + 0.432_951) + 0.238_081)
}

/// The Khronos PBR neutral curve \[Khronos2024\].
#[inline(always)]
pub(super) fn neutral([r, g, b]: [f32; 3]) -> [f32; 3] {
    // Take off what a dielectric reflects at normal incidence, so that base colors come out as they were authored.
    let least = r.min(g).min(b);
    let offset = if least < 0.08 { least - 6.25 * least * least } else { 0.04 };
    let rgb = [r - offset, g - offset, b - offset];

    // Compress what is brighter, and let it go to white.
    let peak = rgb[0].max(rgb[1]).max(rgb[2]);
    if peak < NEUTRAL_START {
        return rgb;
    }
    let room = 1.0 - NEUTRAL_START;
    let new_peak = 1.0 - room * room / (peak + room - NEUTRAL_START);
    let white = 1.0 - 1.0 / (NEUTRAL_DESATURATION * (peak - new_peak) + 1.0);
    rgb.map(|v| v * new_peak / peak * (1.0 - white) + new_peak * white)
}

/// The extended curve by luminance, which keeps hue and saturation \[Reinhard2002, eq. 4\].
#[inline(always)]
pub(super) fn reinhard(rgb: [f32; 3]) -> [f32; 3] {
    let luminance = super::luminance(rgb);
    let scale = (1.0 + luminance * (1.0 / (REINHARD_WHITE * REINHARD_WHITE))) / (1.0 + luminance);
    [rgb[0] * scale, rgb[1] * scale, rgb[2] * scale]
}

/// Row-major matrix times column.
#[inline(always)]
pub(super) fn mul(m: &[[f32; 3]; 3], [r, g, b]: [f32; 3]) -> [f32; 3] {
    // Spelled out: what maps over arrays is not always inlined, and then no vector register is filled.
    let row = |i: usize| m[i][0] * r + m[i][1] * g + m[i][2] * b;
    [row(0), row(1), row(2)]
}

/// Logarithm of a positive normal number, within 1e-6: atanh series on a mantissa around 1. Unlike the library's it is
/// inlined, which makes encoding several times faster.
#[inline(always)]
pub(super) fn log2(x: f32) -> f32 {
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

    /// Inputs of the reference values.
    const COLORS: [[f32; 3]; 5] = [[0.18; 3], [1.0; 3], [0.9, 0.2, 0.05], [4.0, 2.0, 1.0], [0.02, 0.03, 0.05]];

    fn assert_near(name: &str, curve: impl Fn([f32; 3]) -> [f32; 3], expected: [[f32; 3]; 5]) {
        for (color, expected) in COLORS.into_iter().zip(expected) {
            let found = curve(color);
            let near = found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-3);
            assert!(near, "{name} of {color:?}: {found:?} instead of {expected:?}");
        }
    }

    /// Expected values come from the formulas as published (with all their digits), evaluated in double precision by a
    /// program that shares nothing with this one; of Reinhard's and the neutral curve those of grays were worked out on paper:
    /// 0.18 − 0.04, and 0.18 · (1 + 0.18 / 16) / 1.18.
    #[test]
    fn curves_give_their_published_values() {
        let agx_linear = |rgb| agx(rgb).map(|v| v.max(0.0).powf(AGX_GAMMA));
        assert_near(
            "AgX",
            agx_linear,
            [
                [0.214_47, 0.214_53, 0.214_54],
                [0.589_98, 0.590_21, 0.590_22],
                [0.622_98, 0.251_07, 0.103_24],
                [0.879_22, 0.750_09, 0.613_35],
                [0.019_15, 0.032_71, 0.062_31],
            ],
        );
        assert_near(
            "ACES",
            aces,
            [
                [0.105_59; 3],
                [0.619_12; 3],
                [0.623_53, 0.141_35, 0.027_79],
                [0.928_13, 0.811_04, 0.669_91],
                [0.003_29, 0.006_1, 0.012_82],
            ],
        );
        assert_near(
            "neutral",
            neutral,
            [
                [0.14; 3],
                [0.869_09; 3],
                [0.833_35, 0.162_7, 0.018_99],
                [0.983_26, 0.639_95, 0.468_3],
                [0.002_5, 0.012_5, 0.032_5],
            ],
        );
        assert_near(
            "Reinhard",
            reinhard,
            [
                [0.154_26; 3],
                [0.531_25; 3],
                [0.686_86, 0.152_64, 0.038_16],
                [1.368_4, 0.684_2, 0.342_1],
                [0.019_47, 0.029_2, 0.048_66],
            ],
        );
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
        for tone in [agx, aces, neutral, reinhard] {
            let mut last = -1.0;
            for i in 0..2000 {
                let v = tone([(i as f32 / 100.0 - 10.0).exp2(); 3])[1].clamp(0.0, 1.0);
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
    fn reinhard_keeps_hue_and_shows_its_white_as_one() {
        let [r, g, b] = reinhard([0.8, 0.4, 0.2]);
        assert!((r / g - 2.0).abs() < 1e-5 && (g / b - 2.0).abs() < 1e-5);
        assert!(reinhard([REINHARD_WHITE; 3]).iter().all(|v| (v - 1.0).abs() < 1e-6));
    }
}
