//! The way back: what a picture that was shown was before, as far as nothing was cut off.

use super::curves::{self, REINHARD_WHITE, mul};
use super::{DisplayParams, Tone};

type Matrix = [[f32; 3]; 3];

/// Halvings that find where a curve has a value: all bits of a 32-bit float.
const HALVINGS: u32 = 40;

/// Radiance in nit of a color that a display shows, linear Rec. 709 between 0 and 1 (the sRGB encoding is taken off already). What
/// was brighter than the display, or out of its colors, comes back at its limits. Of false color nothing can be told but its
/// luminance, and that is not tried: the color is taken as one of the tone curve.
pub fn radiance_of(params: &DisplayParams, shown: [f32; 3]) -> [f32; 3] {
    let balanced = before_curve(params.tone, shown);
    let exposed = params.white.map_or(balanced, |white| mul(&inverse(&white.matrix()), balanced));
    exposed.map(|v| v.max(0.0) / params.gain())
}

/// What a tone curve made a color of.
fn before_curve(tone: Tone, shown: [f32; 3]) -> [f32; 3] {
    match tone {
        Tone::Agx => {
            let bent = mul(&inverse(&curves::AGX_OUTSET), shown.map(|v| v.max(0.0).powf(1.0 / curves::AGX_GAMMA)));
            let stops = |v: f32| crossing(curves::AGX_EV, |ev| curves::agx_bent(ev.exp2()) - v).exp2();
            mul(&inverse(&curves::AGX_INSET), bent.map(stops))
        }
        Tone::Aces => {
            let bent = mul(&inverse(&curves::ACES_OUT), shown);
            let value = |v: f32| crossing([-20.0, 20.0], |ev| curves::aces_bent(ev.exp2()) - v).exp2();
            mul(&inverse(&curves::ACES_IN), bent.map(value))
        }
        Tone::Neutral => before_neutral(shown),
        Tone::Reinhard => before_reinhard(shown),
        Tone::Linear => shown,
    }
}

/// Where a growing function is 0, or the nearer end.
fn crossing([mut low, mut high]: [f32; 2], of: impl Fn(f32) -> f32) -> f32 {
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if of(middle) < 0.0 { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

fn before_neutral(shown: [f32; 3]) -> [f32; 3] {
    let room = 1.0 - curves::NEUTRAL_START;
    let new_peak = shown[0].max(shown[1]).max(shown[2]);
    let mut rgb = shown;
    if new_peak >= curves::NEUTRAL_START {
        let peak = room * room / (1.0 - new_peak).max(1e-4) - room + curves::NEUTRAL_START;
        let white = 1.0 - 1.0 / (curves::NEUTRAL_DESATURATION * (peak - new_peak) + 1.0);
        rgb = shown.map(|v| (v - new_peak * white) / (1.0 - white) * peak / new_peak);
    }
    // What was taken off at normal incidence: of the least channel 6.25 times its square is left, or 0.04 less.
    let left = rgb[0].min(rgb[1]).min(rgb[2]).max(0.0);
    let offset = if left < 0.04 { (left / 6.25).sqrt() - left } else { 0.04 };
    rgb.map(|v| v + offset)
}

fn before_reinhard(shown: [f32; 3]) -> [f32; 3] {
    let luminance = super::luminance(shown);
    if luminance <= 0.0 {
        return [0.0; 3];
    }
    // L (1 + L / w²) = L' (1 + L), for L.
    let (square, b) = (REINHARD_WHITE * REINHARD_WHITE, 1.0 - luminance);
    let before = 0.5 * square * ((b * b + 4.0 * luminance / square).sqrt() - b);
    shown.map(|v| v * before / luminance)
}

/// By cofactors, in double precision.
fn inverse(m: &Matrix) -> Matrix {
    let at = |i: usize, j: usize| f64::from(m[i % 3][j % 3]);
    // The rows and columns that follow, turned round: signs come by themselves.
    let cofactor = |i: usize, j: usize| at(i + 1, j + 1) * at(i + 2, j + 2) - at(i + 1, j + 2) * at(i + 2, j + 1);
    let determinant: f64 = (0..3).map(|j| at(0, j) * cofactor(0, j)).sum();
    std::array::from_fn(|i| std::array::from_fn(|j| (cofactor(j, i) / determinant) as f32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::display::WhitePoint;
    use crate::display::exact::encoded;

    fn linear(encoded: f32) -> f32 {
        if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
    }

    #[test]
    fn what_was_shown_comes_back_under_every_curve() {
        let colors = [[0.18; 3], [0.5, 0.4, 0.3], [0.02, 0.03, 0.05], [0.6, 0.5, 0.2], [0.3, 0.35, 0.5], [0.004; 3]];
        let white = WhitePoint { kelvin: 3800.0, duv: 0.003 };
        let mut n_cut = 0;
        for tone in Tone::ALL {
            for white in [None, Some(white)] {
                let params = DisplayParams { tone, exposure_ev: -3.0, white, ..DisplayParams::default() };
                for color in colors {
                    let nit = color.map(|v| v * 8.0);
                    let shown = encoded(&params, nit);
                    // What was cut off is gone.
                    if shown.iter().any(|v| !(1e-6..0.9999).contains(v)) {
                        n_cut += 1;
                        continue;
                    }
                    let found = radiance_of(&params, shown.map(linear));
                    let near = found.iter().zip(nit).all(|(a, b)| (a - b).abs() <= 0.01 * b + 0.004);
                    assert!(near, "{tone:?}: {nit:?} came back as {found:?}");
                }
            }
        }
        assert!(n_cut < 6, "{n_cut} of 60 are cut off");
    }
}
