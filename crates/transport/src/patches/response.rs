//! How much of light from some height a surface scatters on, beside what it does with light from everywhere.
//!
//! Patches know how much light they receive, not from where. A coat reflects more of what grazes it, so that a dark glossy
//! surface under light from above would come out too bright by its mean albedo. By reciprocity its share of light from a direction
//! is its albedo towards it; that over the mean is fitted with Schlick's power of the cosine \[Schlick1994\].

use glam::Vec3;

use super::PatchSample;
use crate::light::luminance;
use crate::prepared::{PreparedScene, SurfaceHit};

/// Mean of [`rise`] over all directions, weighed by the cosine.
const MEAN_RISE: f32 = 1.0 / 21.0;
/// Directions that a surface is asked for.
const DIRECTIONS: u32 = 8;
/// Least and greatest factor: no response is negative.
const GRAZING: [f32; 2] = [-1.0, 10.0];

fn rise(cos: f32) -> f32 {
    (1.0 - cos).clamp(0.0, 1.0).powi(5)
}

pub(super) fn response(grazing: f32, cos: f32) -> f32 {
    1.0 + grazing * (rise(cos) - MEAN_RISE)
}

impl PatchSample {
    /// What its surface scatters of light whose direction has this cosine with its normal, over what it scatters of light from
    /// everywhere. The mean over all directions, weighed by the cosine, is 1.
    pub fn response(&self, cos: f32) -> f32 {
        response(self.grazing, cos)
    }
}

/// The factor of a surface by least squares; 0 where it scatters nothing, or light from all directions alike.
pub(super) fn grazing(scene: &PreparedScene, hit: &SurfaceHit, normal: Vec3) -> f32 {
    let tangent = normal.any_orthonormal_vector();
    let albedo = |nth: u32| {
        let cos = ((nth as f32 + 0.5) / DIRECTIONS as f32).sqrt();
        let wo = normal * cos + tangent * (1.0 - cos * cos).sqrt();
        (rise(cos) - MEAN_RISE, luminance(scene.bsdf(hit, wo).albedo_estimate()))
    };
    let albedos: Vec<(f32, f32)> = (0..DIRECTIONS).map(albedo).collect();
    let mean = albedos.iter().map(|(_, albedo)| albedo).sum::<f32>() / DIRECTIONS as f32;
    if mean <= 0.0 {
        return 0.0;
    }
    let along: f32 = albedos.iter().map(|(rise, albedo)| rise * (albedo / mean - 1.0)).sum();
    let square: f32 = albedos.iter().map(|(rise, _)| rise * rise).sum();
    (along / square).clamp(GRAZING[0], GRAZING[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_from_everywhere_is_scattered_as_ever() {
        for grazing in [-1.0, 0.0, 2.0, 10.0] {
            let n = 4096;
            let at = |nth: u32| response(grazing, ((nth as f32 + 0.5) / n as f32).sqrt());
            let mean = (0..n).map(|nth| f64::from(at(nth))).sum::<f64>() / f64::from(n);
            assert!((mean - 1.0).abs() < 1e-4, "grazing {grazing}: {mean}");
            assert!((0..n).all(|nth| at(nth) >= 0.0), "grazing {grazing}");
        }
    }
}
