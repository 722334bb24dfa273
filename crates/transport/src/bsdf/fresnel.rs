//! How much an interface reflects, and where the rest goes.

use glam::Vec3;

use super::pose::MIN_IOR;

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
        Schlick { f0: tinted(root_of_f0(ior), specular_color) * specular, f90: specular }
    }

    #[inline]
    pub(super) fn at(self, grazing: f32) -> Vec3 {
        self.f0 + (Vec3::splat(self.f90) - self.f0) * grazing
    }
}

/// The interface of a solid: the exact reflectance of its index, scaled by what KHR_materials_specular asks for. Reflectance head on is
/// that of [`Schlick::dielectric`], and as much of what is left there is added at other angles; what is reflected totally stays so.
#[derive(Clone, Copy, Debug)]
pub(super) struct Solid {
    /// Factor of all reflection but the total one, 0…1.
    weight: f32,
    /// Share of what the index lets pass that a color reflects besides; below 0 where it reflects less.
    added: Vec3,
}

impl Solid {
    /// As its index alone has it, with nothing but total reflection, and with all reflected: what reflects between them is their sum in
    /// [`Solid::parts`].
    pub(super) const BASES: [Solid; 3] = [
        Solid { weight: 1.0, added: Vec3::ZERO },
        Solid { weight: 0.0, added: Vec3::ZERO },
        Solid { weight: 1.0, added: Vec3::ONE },
    ];

    pub(super) fn new(ior: f32, specular: f32, specular_color: Vec3) -> Solid {
        let root = root_of_f0(ior.max(MIN_IOR));
        let f0 = root * root;
        let added = (tinted(root, specular_color) - Vec3::splat(f0)) / (1.0 - f0).max(1e-6);
        // Beyond an index of 5.8 a dark color is brighter than it says: the little that passes there tells nothing of what to take away.
        Solid { weight: specular, added: added.max(Vec3::NEG_ONE) }
    }

    /// Share of light that it reflects; `cos` and `eta` as in [`dielectric`]. The same for a ray both ways.
    #[inline]
    pub(super) fn reflectance(self, cos: f32, eta: f32) -> Vec3 {
        let exact = dielectric(cos, eta);
        if sin2_behind(cos, eta) >= 1.0 {
            return Vec3::ONE;
        }
        (Vec3::splat(exact) + self.added * (1.0 - exact)).max(Vec3::ZERO) * self.weight
    }

    /// Of which parts of [`Solid::BASES`] the reflectance of its strongest channel is the sum; they add up to 1.
    pub(super) fn parts(self) -> [f32; 3] {
        let all = self.weight * self.added.max_element();
        [self.weight - all, 1.0 - self.weight, all]
    }
}

/// Square root of the reflectance of an index head on.
fn root_of_f0(ior: f32) -> f32 {
    (ior - 1.0) / (ior + 1.0)
}

/// Reflectance head on with the color of KHR_materials_specular.
fn tinted(root_of_f0: f32, specular_color: Vec3) -> Vec3 {
    (specular_color.max(Vec3::ZERO) * root_of_f0 * root_of_f0).min(Vec3::ONE)
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
    let sin2_behind = sin2_behind(cos, eta);
    if sin2_behind >= 1.0 {
        return 1.0;
    }
    let cos_behind = (1.0 - sin2_behind).sqrt();
    let parallel = (eta * cos - cos_behind) / (eta * cos + cos_behind);
    let perpendicular = (cos - eta * cos_behind) / (cos + eta * cos_behind);
    0.5 * (parallel * parallel + perpendicular * perpendicular)
}

/// Squared sine of the angle behind the interface: 1 and more where all is reflected.
fn sin2_behind(cos: f32, eta: f32) -> f32 {
    let cos = cos.clamp(0.0, 1.0);
    (1.0 - cos * cos) / (eta * eta)
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
    fn solids_reflect_as_much_as_their_specular_factor_and_color_say() {
        let inside = |cos: f32| (1.0 - (1.0 - cos * cos) / (1.5 * 1.5)).sqrt();
        let color = Vec3::new(2.0, 1.0, 0.0);
        for cos in [1.0f32, 0.9, 0.5, 0.2] {
            let exact = Vec3::splat(dielectric(cos, 1.5));
            assert_eq!(Solid::new(1.5, 1.0, Vec3::ONE).reflectance(cos, 1.5), exact);
            assert_eq!(Solid::new(1.5, 0.0, color).reflectance(cos, 1.5), Vec3::ZERO);
            let half = Solid::new(1.5, 0.5, color);
            let [outside, back] = [half.reflectance(cos, 1.5), half.reflectance(inside(cos), 1.0 / 1.5)];
            assert!((outside - back).abs().max_element() < 1e-4, "{cos}: {outside} and back {back}");
            assert!((outside.y - 0.5 * exact.y).abs() < 1e-6 && outside.x > outside.y && outside.z < outside.y);
            let [own, _, all] = half.parts();
            assert!((own * exact.x + all - outside.x).abs() < 1e-6, "{cos}: {outside}");
        }
        let head_on = Solid::new(1.5, 0.5, color).reflectance(1.0, 1.5);
        assert!((head_on - Vec3::new(0.04, 0.02, 0.0)).abs().max_element() < 1e-6, "{head_on}");
        for specular in [0.0, 0.5, 1.0] {
            assert_eq!(Solid::new(1.5, specular, color).reflectance(0.5, 1.0 / 1.5), Vec3::ONE);
        }
        assert_eq!(Solid::new(1.5, 1.0, Vec3::ONE).parts(), [1.0, 0.0, 0.0]);
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
