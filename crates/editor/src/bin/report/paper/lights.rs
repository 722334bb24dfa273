//! Lights on a panel, and the mean of their pictures' PSNR.

use clerestory::compare::compare;
use clerestory_transport::basis::{LightBasis, LightSource, SourceKind};
use clerestory_transport::light::{LightRig, PanelSpot};

use crate::errors::BEST_DB;
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
        let compared = compare(&found.relit(light), &truth.relit(light)).ok();
        compared.map_or(f64::NAN, |compared| compared.psnr_db.unwrap_or(BEST_DB))
    };
    lights.iter().map(psnr).sum::<f64>() / lights.len() as f64
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
}
