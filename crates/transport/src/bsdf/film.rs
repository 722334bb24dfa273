//! A thin film on the interface, whose two reflections interfere: KHR_materials_iridescence. \[Belcour2017\]
//!
//! Colors are integrated over the spectrum as the extension's appendix does it, with two interference terms. What that
//! integration leaves outside 0…1 is clamped, so that no color reflects more than it got.

use std::f32::consts::PI;

use glam::Vec3;

use crate::light::REC709_FROM_XYZ;

use super::fresnel::{Schlick, grazing};

/// Whether an interface may carry a film, known at compile time where it carries none.
pub(super) trait Film: Copy {
    /// The film, if there is one.
    fn film(&self) -> Option<&ThinFilm>;
}

/// An interface without film.
#[derive(Clone, Copy, Debug)]
pub(super) struct NoFilm;

impl Film for NoFilm {
    #[inline(always)]
    fn film(&self) -> Option<&ThinFilm> {
        None
    }
}

impl Film for Option<ThinFilm> {
    #[inline]
    fn film(&self) -> Option<&ThinFilm> {
        self.as_ref()
    }
}

/// A film over a dielectric and over a metal.
#[derive(Clone, Copy, Debug)]
pub(super) struct ThinFilm {
    /// Share of the surface that the film covers, 0…1.
    weight: f32,
    coating: Coating,
    dielectric: Schlick,
    metal: Schlick,
}

/// Index and thickness of a film in air.
#[derive(Clone, Copy, Debug)]
struct Coating {
    ior: f32,
    thickness_nm: f32,
}

/// Below this thickness in nanometers the film's index fades to that of air.
const FADE_NM: f32 = 0.03;
/// Angles at which the greatest reflectance is looked for.
const N_ANGLES: usize = 16;
/// Meters in a nanometer.
const NM: f32 = 1e-9;

impl ThinFilm {
    /// `weight` in 0…1, `ior` of the film, its thickness in nanometers, and what it lies on.
    pub(super) fn new(weight: f32, ior: f32, thickness_nm: f32, dielectric: Schlick, metal: Vec3) -> ThinFilm {
        let x = (thickness_nm / FADE_NM).clamp(0.0, 1.0);
        let fade = x * x * (3.0 - 2.0 * x);
        let coating = Coating { ior: 1.0 + (ior.max(1.0) - 1.0) * fade, thickness_nm };
        ThinFilm { weight, coating, dielectric, metal: Schlick { f0: metal, f90: 1.0 } }
    }

    /// Reflectance over a dielectric; `cos` outside.
    pub(super) fn dielectric(&self, cos: f32) -> Vec3 {
        self.over(self.dielectric, cos)
    }

    /// Reflectance over a metal.
    pub(super) fn metal(&self, cos: f32) -> Vec3 {
        self.over(self.metal, cos)
    }

    /// Reflectance over a solid of another index that without it reflects `plain`, from either side: `eta` is the index behind over the
    /// one in front.
    pub(super) fn solid(&self, cos: f32, eta: f32, plain: Vec3) -> Vec3 {
        let sin2_behind = (1.0 - cos * cos).max(0.0) / (eta * eta);
        if sin2_behind >= 1.0 {
            return plain;
        }
        // The same ray in both directions is reflected alike.
        let outside = if eta < 1.0 { (1.0 - sin2_behind).sqrt() } else { cos };
        plain.lerp(self.coating.reflectance(outside, self.dielectric.f0), self.weight)
    }

    fn over(&self, base: Schlick, cos: f32) -> Vec3 {
        base.at(grazing(cos)).lerp(self.coating.reflectance(cos, base.f0), self.weight)
    }

    /// A reflectance after Schlick that is nowhere less than that over the dielectric in its strongest channel.
    pub(super) fn bound(&self) -> Schlick {
        let f0 = (1..=N_ANGLES).map(|nth| {
            let cos = nth as f32 / N_ANGLES as f32;
            let grazing = grazing(cos);
            (self.dielectric(cos).max_element() - grazing) / (1.0 - grazing)
        });
        Schlick { f0: Vec3::splat(f0.fold(0.0, f32::max)), f90: 1.0 }
    }
}

impl Coating {
    /// Reflectance of the film over a base that alone reflects `base_f0` at normal incidence in air.
    fn reflectance(self, cos: f32, base_f0: Vec3) -> Vec3 {
        let cos = cos.clamp(0.0, 1.0);
        let cos_film = (1.0 - (1.0 - cos * cos) / (self.ior * self.ior)).max(0.0).sqrt();
        let outer = at_normal(self.ior);
        let outer = outer + (1.0 - outer) * grazing(cos);
        let passed = 1.0 - outer;
        let root = base_f0.clamp(Vec3::ZERO, Vec3::splat(0.9999)).map(f32::sqrt);
        let base_ior = (Vec3::ONE + root) / (Vec3::ONE - root);
        let inner = (base_ior / self.ior).map(at_normal);
        let inner = inner + (Vec3::ONE - inner) * grazing(cos_film);
        // The outer interface turns the phase by π, the inner one where the base is the thinner medium.
        let shift = base_ior.map(|ior| if ior < self.ior { 2.0 * PI } else { PI });
        let path_m = 2.0 * self.ior * self.thickness_nm * NM * cos_film;
        let once = (inner * outer).clamp(Vec3::splat(1e-5), Vec3::splat(0.9999));
        let echoes = inner * (passed * passed) / (Vec3::ONE - once);
        let mut amplitude = echoes - Vec3::splat(passed);
        let mut sum = echoes + Vec3::splat(outer);
        for order in [1.0, 2.0] {
            amplitude *= once.map(f32::sqrt);
            sum += amplitude * sensitivity(order * path_m, shift * order) * 2.0;
        }
        sum.clamp(Vec3::ZERO, Vec3::ONE)
    }
}

/// Reflectance at normal incidence of a ratio of indices.
fn at_normal(ratio: f32) -> f32 {
    let root = (ratio - 1.0) / (ratio + 1.0);
    root * root
}

/// Fourier transform of the color matching functions at an optical path difference in meters, as Gaussians.
fn sensitivity(path_m: f32, shift: Vec3) -> Vec3 {
    const WHITE: f32 = 1.0685e-7;
    let phase = 2.0 * PI * path_m;
    let lobe = |value: f32, at: f32, variance: f32, shift: f32| {
        let height = value / WHITE * (2.0 * PI * variance).sqrt();
        height * (at * phase + shift).cos() * (-variance * phase * phase).exp()
    };
    let x = lobe(5.4856e-13, 1.6810e6, 4.3278e9, shift.x) + lobe(9.7470e-14, 2.2399e6, 4.5282e9, shift.x);
    let y = lobe(4.4201e-13, 1.7953e6, 9.3046e9, shift.y);
    let z = lobe(5.2481e-13, 2.2084e6, 6.6121e9, shift.z);
    REC709_FROM_XYZ.as_mat3() * Vec3::new(x, y, z)
}

#[cfg(test)]
mod tests {
    use super::super::fresnel;
    use super::*;

    const GLASS: Schlick = Schlick { f0: Vec3::splat(0.04), f90: 1.0 };

    fn film(ior: f32, thickness_nm: f32) -> ThinFilm {
        ThinFilm::new(1.0, ior, thickness_nm, GLASS, Vec3::new(1.0, 0.8, 0.3))
    }

    fn over_solid(film: ThinFilm, cos: f32, eta: f32) -> Vec3 {
        film.solid(cos, eta, Vec3::splat(fresnel::dielectric(cos, eta)))
    }

    #[test]
    fn no_film_at_all_reflects_as_the_bare_base() {
        // At grazing angles the first interface reflects whatever its index is. [Schlick1994]
        for cos in [1.0, 0.9, 0.8] {
            let (bare, filmed) = (GLASS.at(grazing(cos)), film(1.8, 0.0).dielectric(cos));
            // The extension lets the interfering beams have no less than 10⁻⁵.
            assert!((bare - filmed).abs().max_element() < 1e-2, "{cos}: {bare} against {filmed}");
            let nothing = ThinFilm { weight: 0.0, ..film(1.8, 300.0) };
            assert_eq!(nothing.dielectric(cos), bare);
        }
    }

    #[test]
    fn a_quarter_wave_of_the_geometric_mean_index_takes_the_reflection_away() {
        // 550 nm / 4 / √1.5: red and blue are still reflected a little, green least.
        let coated = film(1.5f32.sqrt(), 550.0 / 4.0 / 1.5f32.sqrt()).dielectric(1.0);
        assert!(coated.y < 0.006 && coated.y < coated.z, "{coated}");
        // Half a wave of a denser film over air-like glass reflects as if it were not there at that wavelength.
        let thick = film(1.8, 550.0 / 4.0 / 1.8).dielectric(1.0);
        assert!(thick.y > 0.1, "a denser quarter wave reflects more: {thick}");
    }

    #[test]
    fn films_reflect_between_nothing_and_all_and_stay_below_their_bound() {
        for ior in [1.0, 1.3, 1.8, 2.5] {
            for thickness in [0.0, 0.01, 100.0, 350.0, 900.0, 4000.0] {
                let film = film(ior, thickness);
                let bound = film.bound();
                for nth in 0..=50 {
                    let cos = nth as f32 / 50.0;
                    let solids = [1.5, 0.7].map(|eta| over_solid(film, cos, eta));
                    for value in [film.dielectric(cos), film.metal(cos), solids[0], solids[1]] {
                        assert!(value.min_element() >= 0.0 && value.max_element() <= 1.0, "{ior} {thickness} {cos}");
                    }
                    let above = film.dielectric(cos).max_element() - bound.at(grazing(cos)).x;
                    assert!(above < 0.02, "{ior} {thickness} {cos}: {above}");
                }
            }
        }
    }

    #[test]
    fn a_film_over_a_solid_reflects_alike_from_both_sides() {
        let film = film(1.6, 400.0);
        for cos in [0.2f32, 0.5, 0.9] {
            let inside = (1.0 - (1.0 - cos * cos) / (1.5 * 1.5)).sqrt();
            let [outward, back] = [over_solid(film, cos, 1.5), over_solid(film, inside, 1.0 / 1.5)];
            assert!((outward - back).abs().max_element() < 1e-3);
        }
    }
}
