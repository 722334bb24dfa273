//! Microfacets after Trowbridge and Reitz ("GGX"), isotropic, in the frame whose z axis is the shading normal.

use std::f32::consts::{PI, TAU};

use glam::Vec3;

/// Distribution of microfacet normals of width α.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ggx {
    alpha2: f32,
    alpha: f32,
}

impl Ggx {
    pub(super) fn new(alpha: f32) -> Ggx {
        Ggx { alpha2: alpha * alpha, alpha }
    }

    /// Density of microfacet area per solid angle. Written with sin² so that it stays exact for narrow lobes.
    #[inline]
    pub(super) fn d(self, wm: Vec3) -> f32 {
        let spread = wm.x * wm.x + wm.y * wm.y + self.alpha2 * wm.z * wm.z;
        self.alpha2 / (PI * spread * spread)
    }

    /// Smith's Λ at a direction with cosine `cos` ≠ 0.
    #[inline]
    pub(super) fn lambda(self, cos: f32) -> f32 {
        let cos2 = cos * cos;
        0.5 * ((1.0 + self.alpha2 * (1.0 - cos2).max(0.0) / cos2).sqrt() - 1.0)
    }

    /// A microfacet normal as visible from `wo` (`wo.z` > 0): density `d·(wo·wm)/wo.z/(1 + Λ)`. [Heitz2018; Dupuy2023]
    #[inline]
    pub(super) fn sample(self, wo: Vec3, u: [f32; 2]) -> Vec3 {
        let stretched = Vec3::new(self.alpha * wo.x, self.alpha * wo.y, wo.z).normalize();
        let z = (1.0 - u[1]) * (1.0 + stretched.z) - stretched.z;
        let radius = (1.0 - z * z).max(0.0).sqrt();
        let (sin, cos) = (TAU * u[0]).sin_cos();
        let half = Vec3::new(radius * cos, radius * sin, z) + stretched;
        Vec3::new(self.alpha * half.x, self.alpha * half.y, half.z.max(1e-8)).normalize()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn projected_microfacet_area_is_one() {
        for alpha in [0.1, 0.3, 1.0] {
            let ggx = Ggx::new(alpha);
            let n = 20_000;
            let integral: f64 = (0..n)
                .map(|i| {
                    let theta = (i as f32 + 0.5) / n as f32 * std::f32::consts::FRAC_PI_2;
                    let (sin, cos) = theta.sin_cos();
                    f64::from(ggx.d(Vec3::new(sin, 0.0, cos)) * cos * sin * TAU) * f64::from(PI) / 2.0 / n as f64
                })
                .sum();
            assert!((integral - 1.0).abs() < 1e-3, "alpha {alpha}: {integral}");
        }
    }

    #[test]
    fn every_sampled_normal_is_seen_from_outside() {
        for cos in [1.0f32, 0.5, 0.01, 1e-4] {
            let wo = Vec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
            for i in 0..256 {
                let u = [i % 16, i / 16].map(|axis| (axis as f32 + 0.5) / 16.0);
                let wm = Ggx::new(0.4).sample(wo, u);
                assert!(wm.z > 0.0 && wo.dot(wm) > -1e-6 && wm.is_normalized(), "{wo} sees {wm}, {}", wo.dot(wm));
            }
        }
    }
}
