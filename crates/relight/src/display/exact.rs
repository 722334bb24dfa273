//! The display of a pixel by the functions as they are published: no table, no lanes. Files of 16 bits are made with it, and the
//! fast ways to bytes are held against it.

use rayon::prelude::*;

use super::{DisplayParams, Tone, curves, exposed, finite_luminance, srgb_from_linear, turbo, white};
use crate::frame::Radiance;

/// Display-encoded sRGB of a color in nit, each 0…1.
pub(crate) fn encoded(params: &DisplayParams, rgb: [f32; 3]) -> [f32; 3] {
    if let Some(scale) = &params.false_color {
        return turbo(scale.position(finite_luminance(&rgb)));
    }
    let exposed = rgb.map(|v| exposed(v, params.gain()));
    let balanced = params.white.map_or(exposed, |white| white::balanced(&white.matrix(), exposed));
    let curved = match params.tone {
        Tone::Agx => curves::agx(balanced).map(|v| v.max(0.0).powf(curves::AGX_GAMMA)),
        Tone::Aces => curves::aces(balanced),
        Tone::Neutral => curves::neutral(balanced),
        Tone::Reinhard => curves::reinhard(balanced),
        Tone::Linear => balanced,
    };
    curved.map(|v| srgb_from_linear(v.clamp(0.0, 1.0)))
}

/// Display-encoded sRGB, three numbers of 16 bits per pixel, row by row; rounded to the nearest, never dithered.
pub fn encode16(radiance: &Radiance, params: &DisplayParams) -> Vec<u16> {
    let pixel = |rgb: &[f32; 3]| encoded(params, *rgb).map(|v| (v.clamp(0.0, 1.0) * 65535.0).round() as u16);
    let pixels: Vec<[u16; 3]> = radiance.pixels.par_iter().map(pixel).collect();
    pixels.into_flattened()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::display::{ColorScale, Spacing, encode};

    #[test]
    fn sixteen_bits_lie_within_half_a_byte_of_eight_and_tell_more_apart() {
        let pixels: Vec<[f32; 3]> = (0..4000).map(|i| [i as f32 * 5e-4, 0.3, i as f32 * 1e-3]).collect();
        let radiance = Radiance { width: 4000, height: 1, pixels };
        let scale = ColorScale { spacing: Spacing::Log, low: 0.1, high: 10.0 };
        let plain = Tone::ALL.map(|tone| DisplayParams { tone, ..DisplayParams::default() });
        for params in plain.into_iter().chain([DisplayParams { false_color: Some(scale), ..plain[0] }]) {
            let (bytes, deep) = (encode(&radiance, &params), encode16(&radiance, &params));
            for (rgba, rgb) in bytes.as_chunks::<4>().0.iter().zip(deep.as_chunks::<3>().0) {
                let off = |c: usize| (f32::from(rgb[c]) / 257.0 - f32::from(rgba[c])).abs();
                assert!((0..3).all(|c| off(c) < 0.8), "{params:?}: {rgba:?} {rgb:?}");
            }
        }
        let red = |deep: &[u16]| deep.iter().step_by(3).collect::<std::collections::BTreeSet<_>>().len();
        assert!(red(&encode16(&radiance, &plain[4])) > 1000, "more than a byte tells");
    }
}
