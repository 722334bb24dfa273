//! Lights on a panel, and the mean of their pictures' PSNR.

use anyhow::Result;
use clerestory::compare::compare;
use clerestory_relight::Radiance;
use clerestory_transport::basis::{LightBasis, LightSource, SourceKind};
use clerestory_transport::light::{LightRig, PanelSpot};

use crate::errors::{BEST_DB, has_nan};
use crate::methods::dense::Picture;

const POSITIONS: [[f32; 2]; 4] = [[0.5, 0.5], [0.2, 0.3], [0.8, 0.7], [0.15, 0.85]];
/// In sides of the panel.
const RADII: [f32; 3] = [0.06, 0.15, 0.4];
const COLORS: [[f32; 3]; 3] = [[1.0, 1.0, 1.0], [1.0, 0.6, 0.25], [0.35, 0.6, 1.0]];

/// How many there are.
pub(super) fn count() -> usize {
    POSITIONS.len() * RADII.len()
}

/// A coefficient per texel and channel, of each light on a panel of `side` × `side` texels.
pub(super) fn lights(side: usize) -> Vec<Vec<[f32; 3]>> {
    let resolution = side as u32;
    let panel =
        LightSource::plain("panel", SourceKind::Panel { resolution, size_m: [1.0; 2] }, 0..resolution * resolution);
    let basis = LightBasis::new(vec![panel]);
    let light = |nth: usize| {
        let (position, radius) = (POSITIONS[nth % POSITIONS.len()], RADII[nth / POSITIONS.len()]);
        let spot = PanelSpot { position, radius, color: Some(COLORS[nth % COLORS.len()]), intensity: 1.0 };
        let panels = [("panel".to_string(), vec![spot])].into_iter().collect();
        basis.project(&LightRig { panels, ..LightRig::default() })
    };
    (0..count()).map(light).collect()
}

/// Mean PSNR over all lights in dB.
pub(super) fn psnr_db(truth: &Picture, found: &Picture) -> f64 {
    let lights = lights(truth.n_cols.isqrt());
    let psnr = |light: &Vec<[f32; 3]>| {
        told_psnr_db(&found.relit(light), &truth.relit(light)).expect("both matrices are of one picture")
    };
    lights.iter().map(psnr).sum::<f64>() / lights.len() as f64
}

/// PSNR of a picture against another one in dB, no better than the best that is told; 0, the worst, of one with values that are no numbers.
///
/// # Errors
/// If their sizes differ.
pub(super) fn told_psnr_db(found: &Radiance, truth: &Radiance) -> Result<f64> {
    let told = compare(found, truth)?.psnr_db.map_or(BEST_DB, |db| db.min(BEST_DB));
    Ok(if has_nan(found) { 0.0 } else { told })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lights_are_lit_whatever_the_number_of_texels_and_a_picture_equals_itself() {
        for side in [4, 16, 64] {
            assert!(lights(side).iter().all(|light| light.iter().flatten().any(|x| *x > 0.0)), "{side}");
        }
        let values = (0..48 * 16).map(|i| (i % 37) as f32).collect();
        let picture = Picture { width: 16, height: 1, n_cols: 16, values };
        assert_eq!(psnr_db(&picture, &picture), BEST_DB);
        let darker = Picture { values: picture.values.iter().map(|x| 0.9 * x).collect(), ..picture };
        assert!(psnr_db(&picture, &darker) < 40.0);
    }

    #[test]
    fn nothing_is_told_as_better_than_the_best_and_no_number_as_the_worst() {
        let picture = |value: f32| Radiance { width: 2, height: 1, pixels: vec![[value; 3]; 2] };
        // 6e-8 off, below four times the median: 156 dB.
        let nearly = told_psnr_db(&picture(1.0 - 0.5 * f32::EPSILON), &picture(1.0)).unwrap();
        assert_eq!((nearly, told_psnr_db(&picture(1.0), &picture(1.0)).unwrap()), (BEST_DB, BEST_DB));
        assert_eq!(told_psnr_db(&picture(f32::NAN), &picture(1.0)).unwrap(), 0.0);
        assert!(told_psnr_db(&picture(1.0), &Radiance::default()).is_err());
    }
}
