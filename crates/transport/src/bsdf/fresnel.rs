//! How much an interface reflects, and where the rest goes.

use glam::Vec3;

/// Reflectance of a layer after Schlick: `f0` at normal incidence, `f90` at grazing. \[Schlick1994\]
#[derive(Clone, Copy, Debug)]
pub(crate) struct Schlick {
    pub(crate) f0: Vec3,
    pub(crate) f90: f32,
}

impl Schlick {
    /// Reflectance of a dielectric as KHR_materials_specular and KHR_materials_ior define it. An index of exactly 1 is no
    /// interface at all, also not at grazing angles.
    pub(crate) fn dielectric(ior: f32, specular: f32, specular_color: Vec3) -> Schlick {
        if is_matched(ior) {
            return Schlick { f0: Vec3::ZERO, f90: 0.0 };
        }
        let ratio = (ior - 1.0) / (ior + 1.0);
        let f0 = (specular_color.max(Vec3::ZERO) * ratio * ratio).min(Vec3::ONE) * specular;
        Schlick { f0, f90: specular }
    }

    #[inline]
    pub(super) fn at(self, grazing: f32) -> Vec3 {
        self.f0 + (Vec3::splat(self.f90) - self.f0) * grazing
    }
}

/// `(1 − cosθ)⁵`.
#[inline]
pub(super) fn grazing(cos: f32) -> f32 {
    let x = (1.0 - cos).clamp(0.0, 1.0);
    let x2 = x * x;
    x2 * x2 * x
}

/// Whether an index of refraction leaves no interface.
pub(crate) fn is_matched(ior: f32) -> bool {
    (ior - 1.0).abs() < 1e-4
}

/// Exact unpolarized reflectance; `eta` is the index behind the interface over the one in front, `cos` ≥ 0 in front.
pub(super) fn dielectric(cos: f32, eta: f32) -> f32 {
    let cos = cos.clamp(0.0, 1.0);
    let sin2_behind = (1.0 - cos * cos) / (eta * eta);
    if sin2_behind >= 1.0 {
        return 1.0;
    }
    let cos_behind = (1.0 - sin2_behind).sqrt();
    let parallel = (eta * cos - cos_behind) / (eta * cos + cos_behind);
    let perpendicular = (cos - eta * cos_behind) / (cos + eta * cos_behind);
    0.5 * (parallel * parallel + perpendicular * perpendicular)
}

/// Direction behind the interface for `w` in front, both pointing away from it; `None` at total internal reflection.
pub(super) fn refract(w: Vec3, normal: Vec3, eta: f32) -> Option<Vec3> {
    let cos = w.dot(normal);
    let sin2_behind = (1.0 - cos * cos).max(0.0) / (eta * eta);
    if sin2_behind >= 1.0 {
        return None;
    }
    Some(-w / eta + normal * (cos / eta - (1.0 - sin2_behind).sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn glass_reflects_four_percent_head_on_and_all_beyond_the_critical_angle() {
        assert!((dielectric(1.0, 1.5) - 0.04).abs() < 1e-6);
        assert!((dielectric(1.0, 1.0 / 1.5) - 0.04).abs() < 1e-6);
        assert_eq!(dielectric((1.0f32 - 0.68 * 0.68).sqrt(), 1.0 / 1.5), 1.0);
        assert!(dielectric((1.0f32 - 0.66 * 0.66).sqrt(), 1.0 / 1.5) < 1.0);
        assert!(dielectric(0.3, 1.0) < 1e-12);
    }

    #[test]
    fn no_light_is_polarized_away_at_brewsters_angle() {
        let cos = 1.0 / (1.0f32 + 1.5 * 1.5).sqrt();
        let perpendicular = ((1.5f32 * 1.5 - 1.0) / (1.5 * 1.5 + 1.0)).powi(2);
        assert!((dielectric(cos, 1.5) - 0.5 * perpendicular).abs() < 1e-5);
    }

    #[test]
    fn refraction_obeys_snell_and_is_reversible() {
        for eta in [1.5, 1.0 / 1.5, 1.33] {
            let w = Vec3::new(0.4, -0.3, 0.9).normalize();
            let behind = refract(w, Vec3::Z, eta).expect("this angle is below the critical one");
            assert!((behind.length() - 1.0).abs() < 1e-6 && behind.z < 0.0);
            assert!((behind.truncate() * eta + w.truncate()).length() < 1e-6);
            let back = refract(behind, -Vec3::Z, 1.0 / eta).expect("the way back exists");
            assert!((back - w).length() < 1e-5);
        }
    }
}
