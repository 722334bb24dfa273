//! One picture against its reference: relative error, bias per channel, and signal to noise.

use std::path::Path;

use anyhow::{Context, Result, bail};
use clerestory_relight::Radiance;
use exr::prelude::{AnyChannel, FlatSamples, ReadChannels, ReadLayers};
use serde::Serialize;

/// How a picture A differs from the reference B.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// ‖A − B‖ / ‖B‖ over all pixels and channels; `None` if B is black and A is not.
    pub relative_l2: Option<f64>,
    /// mean(A) / mean(B) − 1 of red, green and blue; `None` where B has none of a color and A has.
    pub mean_bias: [Option<f64>; 3],
    /// Peak signal to noise in dB; `None` (infinite) if nothing differs.
    pub psnr_db: Option<f64>,
}

/// Holds picture `a` against the reference `b`.
///
/// # Errors
/// If the sizes differ.
pub fn compare(a: &Radiance, b: &Radiance) -> Result<Comparison> {
    if (a.width, a.height) != (b.width, b.height) {
        bail!("sizes differ: {}×{} against {}×{}; render both at one size", a.width, a.height, b.width, b.height);
    }
    let pairs =
        || a.pixels.iter().flatten().zip(b.pixels.iter().flatten()).map(|(a, b)| (f64::from(*a), f64::from(*b)));
    let difference: f64 = pairs().map(|(a, b)| (a - b) * (a - b)).sum();
    let reference: f64 = pairs().map(|(_, b)| b * b).sum();
    let scale = 1.0 / white_level(b);
    let shown = |v: f64| (v * scale).clamp(0.0, 1.0);
    let squares: f64 = pairs().map(|(a, b)| (shown(a) - shown(b)).powi(2)).sum();
    let mse = squares / (3 * a.pixels.len()).max(1) as f64;
    Ok(Comparison {
        relative_l2: ratio(difference.sqrt(), reference.sqrt()),
        mean_bias: std::array::from_fn(|c| ratio(channel_sum(a, c) - channel_sum(b, c), channel_sum(b, c))),
        // Without the sum a mean square of 1 is minus zero decibels.
        psnr_db: (mse > 0.0).then(|| 0.0 - 10.0 * mse.log10()),
    })
}

/// `None` where nothing is divided by nothing but zero.
fn ratio(numerator: f64, denominator: f64) -> Option<f64> {
    match (numerator == 0.0, denominator == 0.0) {
        (true, _) => Some(0.0),
        (false, true) => None,
        (false, false) => Some(numerator / denominator),
    }
}

fn channel_sum(picture: &Radiance, channel: usize) -> f64 {
    picture.pixels.iter().map(|rgb| f64::from(rgb[channel])).sum()
}

/// Luminance that counts as 1: four times the median; the 99.5 percentile where most of the picture is black.
pub fn white_level(picture: &Radiance) -> f64 {
    let luminance =
        |rgb: &[f32; 3]| 0.2126 * f64::from(rgb[0]) + 0.7152 * f64::from(rgb[1]) + 0.0722 * f64::from(rgb[2]);
    let mut luminances: Vec<f64> = picture.pixels.iter().map(luminance).collect();
    luminances.sort_by(f64::total_cmp);
    let candidates = [4.0 * quantile(&luminances, 0.5), quantile(&luminances, 0.995), quantile(&luminances, 1.0)];
    candidates.into_iter().find(|level| *level > 0.0).unwrap_or(1.0)
}

/// Quantile of sorted values, linear between neighbors; 0 without values.
fn quantile(sorted: &[f64], q: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else {
        return 0.0;
    };
    let at = q * last as f64;
    let (low, high) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
    low + (high - low) * at.fract()
}

/// Reads the plain R, G and B channels of an EXR file, whatever else it holds.
///
/// # Errors
/// If the file cannot be read, has no such channels, or pixels that are not finite.
pub fn read_exr(path: &Path) -> Result<Radiance> {
    let name = path.display();
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .from_file(path)
        .with_context(|| format!("cannot read {name}: give an OpenEXR picture"))?;
    for layer in &image.layer_data {
        let channels = ["R", "G", "B"].map(|n| layer.channel_data.list.iter().find(|c| c.name == *n));
        if let [Some(r), Some(g), Some(b)] = channels {
            let picture = interleave(layer.size.0, layer.size.1, [r, g, b]);
            let picture = picture.with_context(|| format!("cannot use {name}"))?;
            let n_bad = picture.pixels.iter().filter(|rgb| !rgb.iter().all(|v| v.is_finite())).count();
            if n_bad > 0 {
                bail!("cannot use {name}: {n_bad} of its pixels are not finite numbers");
            }
            return Ok(picture);
        }
    }
    bail!("cannot use {name}: it has no plain R, G and B channels")
}

fn interleave(width: usize, height: usize, channels: [&AnyChannel<FlatSamples>; 3]) -> Result<Radiance> {
    if channels.iter().any(|c| c.sample_data.len() != width * height) {
        bail!("its channels are subsampled; save it without chroma subsampling");
    }
    let mut pixels = vec![[0.0; 3]; width * height];
    for (idx, channel) in channels.into_iter().enumerate() {
        for (pixel, value) in pixels.iter_mut().zip(channel.sample_data.values_as_f32()) {
            pixel[idx] = value;
        }
    }
    Ok(Radiance { width: width as u32, height: height as u32, pixels })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(pixels: Vec<[f32; 3]>) -> Radiance {
        Radiance { width: pixels.len() as u32, height: 1, pixels }
    }

    #[test]
    fn a_picture_equals_itself() {
        let a = picture(vec![[1.0, 2.0, 3.0], [0.0, 1.0, 5.0]]);
        let same = Comparison { relative_l2: Some(0.0), mean_bias: [Some(0.0); 3], psnr_db: None };
        assert_eq!(compare(&a, &a).unwrap(), same);
    }

    #[test]
    fn figures_match_a_hand_calculation() {
        // B is 1 everywhere, so white is 4; A is brighter by a tenth.
        let (a, b) = (picture(vec![[1.1; 3]; 4]), picture(vec![[1.0; 3]; 4]));
        let c = compare(&a, &b).unwrap();
        assert!((c.relative_l2.unwrap() - 0.1).abs() < 1e-6);
        assert!(c.mean_bias.iter().all(|bias| (bias.unwrap() - 0.1).abs() < 1e-6));
        assert!((c.psnr_db.unwrap() - -20.0 * (0.1f64 / 4.0).log10()).abs() < 1e-4, "{c:?}");
    }

    #[test]
    fn a_mostly_black_reference_is_scaled_by_its_bright_end() {
        let mut pixels = vec![[0.0; 3]; 1000];
        pixels[..20].fill([8.0; 3]);
        let b = picture(pixels.clone());
        pixels[0] = [4.0; 3];
        // Half of white at one pixel of a thousand.
        let expected = -10.0 * (0.25f64 / 1000.0).log10();
        assert!((compare(&picture(pixels), &b).unwrap().psnr_db.unwrap() - expected).abs() < 1e-6);
    }

    #[test]
    fn the_worst_that_can_be_is_zero_decibels() {
        let (white, black) = (picture(vec![[9.0; 3]; 2]), picture(vec![[0.0; 3]; 2]));
        let psnr_db = compare(&black, &white).unwrap().psnr_db;
        // Four times the median is white: a quarter is lost everywhere.
        assert!((psnr_db.unwrap() - 12.04).abs() < 0.01);
        assert_eq!(compare(&white, &black).unwrap().psnr_db.map(f64::to_bits), Some(0.0f64.to_bits()));
    }

    #[test]
    fn black_references_and_other_sizes_are_answered() {
        let black = picture(vec![[0.0; 3]; 2]);
        let lit = picture(vec![[1.0, 0.0, 0.0]; 2]);
        let c = compare(&lit, &black).unwrap();
        assert_eq!((c.relative_l2, c.mean_bias), (None, [None, Some(0.0), Some(0.0)]));
        assert!(compare(&lit, &picture(vec![[0.0; 3]])).is_err());
    }
}
