//! Microfacets after Trowbridge and Reitz ("GGX") in the frame whose z axis is the shading normal, of a width along x and
//! another along y.

use std::f32::consts::{PI, TAU};

use glam::Vec3;

/// Distribution of microfacet normals of width α along x and y.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ggx {
    alpha: [f32; 2],
}

impl Ggx {
    pub(super) fn new(alpha: [f32; 2]) -> Ggx {
        Ggx { alpha }
    }

    pub(super) fn round(alpha: f32) -> Ggx {
        Ggx::new([alpha; 2])
    }

    /// Widths along x and y.
    pub(super) fn alpha(self) -> [f32; 2] {
        self.alpha
    }

    /// The greater width.
    pub(super) fn widest(self) -> f32 {
        self.alpha[0].max(self.alpha[1])
    }

    /// Density of microfacet area per solid angle. Written with sin² so that it stays exact for narrow lobes.
    #[inline]
    pub(super) fn d(self, wm: Vec3) -> f32 {
        let [x, y] = self.alpha;
        let (across, along, up) = (y * wm.x, x * wm.y, x * y * wm.z);
        let (spread, area) = (across * across + along * along + up * up, x * y);
        area * area * area / (PI * spread * spread)
    }

    /// Smith's Λ at a unit direction that does not graze the surface.
    #[inline]
    pub(super) fn lambda(self, w: Vec3) -> f32 {
        let (x, y) = (self.alpha[0] * w.x, self.alpha[1] * w.y);
        0.5 * ((1.0 + (x * x + y * y) / (w.z * w.z)).sqrt() - 1.0)
    }

    /// A microfacet normal as visible from `wo` (`wo.z` > 0): density `d·(wo·wm)/wo.z/(1 + Λ)`. [Heitz2018; Dupuy2023]
    #[inline]
    pub(super) fn sample(self, wo: Vec3, u: [f32; 2]) -> Vec3 {
        let stretched = Vec3::new(self.alpha[0] * wo.x, self.alpha[1] * wo.y, wo.z).normalize();
        let z = (1.0 - u[1]) * (1.0 + stretched.z) - stretched.z;
        let radius = (1.0 - z * z).max(0.0).sqrt();
        let (sin, cos) = (TAU * u[0]).sin_cos();
        let half = Vec3::new(radius * cos, radius * sin, z) + stretched;
        Vec3::new(self.alpha[0] * half.x, self.alpha[1] * half.y, half.z.max(1e-8)).normalize()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn projected_microfacet_area_is_one() {
        for alpha in [[0.1, 0.1], [0.3, 0.3], [1.0, 1.0], [0.1, 0.4], [1.0, 0.2]] {
            let (ggx, n_theta, n_phi) = (Ggx::new(alpha), 2000, 64);
            let mut integral = 0.0;
            for (i, j) in (0..n_theta).flat_map(|i| (0..n_phi).map(move |j| (i, j))) {
                let theta = (i as f32 + 0.5) / n_theta as f32 * std::f32::consts::FRAC_PI_2;
                let (sin, cos) = theta.sin_cos();
                let (sin_phi, cos_phi) = ((j as f32 + 0.5) / n_phi as f32 * TAU).sin_cos();
                integral += f64::from(ggx.d(Vec3::new(sin * cos_phi, sin * sin_phi, cos)) * cos * sin);
            }
            integral *= f64::from(PI) * f64::from(PI) / f64::from(n_theta * n_phi);
            assert!((integral - 1.0).abs() < 1e-3, "alpha {alpha:?}: {integral}");
        }
    }

    #[test]
    fn every_sampled_normal_is_seen_from_outside() {
        for cos in [1.0f32, 0.5, 0.01, 1e-4] {
            let wo = Vec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
            for i in 0..256 {
                let u = [i % 16, i / 16].map(|axis| (axis as f32 + 0.5) / 16.0);
                let wm = Ggx::new([0.4, 0.2]).sample(wo, u);
                assert!(wm.z > 0.0 && wo.dot(wm) > -1e-6 && wm.is_normalized(), "{wo} sees {wm}, {}", wo.dot(wm));
            }
        }
    }
}
