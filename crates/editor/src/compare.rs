//! One picture against its reference: relative error, bias per channel, and signal to noise.

use std::path::Path;

use anyhow::{Result, anyhow, bail};
use clerestory_relight::Radiance;
use clerestory_transport::import::{self, ExrPicture};
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

/// Which part of a whole picture a file stores.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    /// Its top left corner in pixels of the whole.
    pub at: [i64; 2],
    /// Width and height of the whole in pixels.
    pub whole: [u32; 2],
}

/// Reads what an EXR file stores of its picture: R, G and B, else Y, else a layer in color, in linear Rec. 709.
///
/// # Errors
/// If the file cannot be read, has no such channels, or pixels that are not finite.
pub fn read_exr(path: &Path) -> Result<Radiance> {
    read_part(path).map(|(picture, _)| picture)
}

/// The same, and which part it is if that is not the whole picture.
///
/// # Errors
/// As [`read_exr`].
pub fn read_part(path: &Path) -> Result<(Radiance, Option<Part>)> {
    let name = path.display();
    let read = import::read_exr(path).map_err(|why| anyhow!("cannot read {name}: {why}; give an OpenEXR picture"))?;
    let ExrPicture { size: [width, height], pixels, shown: whole, offset: at, .. } = read;
    let n_bad = pixels.iter().filter(|rgb| !rgb.iter().all(|v| v.is_finite())).count();
    if n_bad > 0 {
        bail!("cannot use {name}: {n_bad} of its pixels are not finite numbers");
    }
    let part = Some(Part { at, whole }).filter(|_| at != [0; 2] || whole != [width, height]);
    Ok((Radiance { width, height, pixels }, part))
}

/// Refuses two parts that are not the same of pictures of one size; a whole picture may be what another one is a part of.
///
/// # Errors
/// If they are not.
pub fn check_parts(a: Option<Part>, b: Option<Part>) -> Result<()> {
    let words = |Part { at: [x, y], whole: [width, height] }: Part| format!("at ({x}, {y}) of {width}×{height}");
    match (a, b) {
        (Some(a), Some(b)) if a != b => {
            bail!("they show different regions: one {}, the other {}; write the same of both", words(a), words(b))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use exr::prelude::{
        AnyChannel, AnyChannels, Encoding, FlatSamples, Image, IntegerBounds, Layer, LayerAttributes, Vec2,
        WritableImage,
    };

    use super::*;

    /// An EXR of 2 × 1 pixels at a place of a picture of 8 × 4.
    fn exr(layer: &str, at: (i32, i32)) -> Vec<u8> {
        let channel = |name: &str| AnyChannel::new(format!("{layer}{name}").as_str(), FlatSamples::F32(vec![1.0, 2.0]));
        let channels = AnyChannels::sort(["R", "G", "B"].into_iter().map(channel).collect());
        let attributes = LayerAttributes { layer_position: at.into(), ..LayerAttributes::default() };
        let mut image = Image::from_layer(Layer::new((2, 1), attributes, Encoding::UNCOMPRESSED, channels));
        image.attributes.display_window = IntegerBounds::new(Vec2(0, 0), (8, 4));
        let mut bytes = std::io::Cursor::new(Vec::new());
        image.write().to_buffered(&mut bytes).unwrap();
        bytes.into_inner()
    }

    #[test]
    fn parts_are_read_as_they_are_stored_and_must_be_the_same() {
        let folder = tempfile::tempdir().unwrap();
        let read = |bytes: &[u8]| {
            let path = folder.path().join("a.exr");
            std::fs::write(&path, bytes).unwrap();
            read_part(&path)
        };
        let (first, second) = (read(&exr("", (0, 0))).unwrap(), read(&exr("View.Combined.", (3, 2))).unwrap());
        assert_eq!(first.0.pixels, [[1.0; 3], [2.0; 3]]);
        assert_eq!(second.0, first.0, "a layer as Blender names it");
        assert_eq!(second.1, Some(Part { at: [3, 2], whole: [8, 4] }));
        let why = check_parts(first.1, second.1).unwrap_err().to_string();
        assert!(why.contains("different regions") && why.contains("(3, 2) of 8×4"), "{why}");
        assert!(check_parts(first.1, first.1).is_ok() && check_parts(None, second.1).is_ok());
    }

    #[test]
    fn a_head_that_claims_too_much_is_refused_before_memory_is_asked_for() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("huge.exr");
        let mut bytes = exr("", (0, 0));
        let window = bytes.windows(16).position(|part| part == b"dataWindow\0box2i").expect("a data window");
        // Behind the name, the type and the length: left, top, right and bottom.
        let right = window + b"dataWindow\0box2i\0".len() + 4 + 8;
        for side in [16_383_i32, 399_999] {
            bytes[right..right + 4].copy_from_slice(&side.to_le_bytes());
            bytes[right + 4..right + 8].copy_from_slice(&side.to_le_bytes());
            std::fs::write(&path, &bytes).unwrap();
            let why = read_exr(&path).unwrap_err().to_string();
            assert!(why.contains("too many") || why.contains("cannot be in"), "{why}");
        }
    }

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
