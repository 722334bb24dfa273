//! The diffuse base of a coated surface in two parts: one that all viewers see alike but for a factor of their own, and the
//! little that is left.
//!
//! A base that sees `1 − F(V·H)` of the light is not the same for two viewers. But the half vector is at most as grazing as
//! the middle of both directions, and log(1 − F) falls faster and faster toward grazing angles; so the factor is at least
//! `√(1 − F(cosθₒ)) · √(1 − F(cosθᵢ))`, a product of what only the viewer and only the light know. Light on that part is
//! found once for all viewers. The rest, with the coat itself, is a surface of its own that never takes light away.

use std::f32::consts::{FRAC_1_PI, PI};

use glam::Vec3;

use super::energy::Coat;
use super::fresnel::{Schlick, grazing};
use super::lanes::CouplingTable;
use super::{Bsdf, BsdfSample, Lobes, ScatterKind, mean};

/// What light passes on its way into a base or out of it, by its cosine alone.
#[derive(Clone, Copy, Debug)]
pub(super) struct Coupling {
    coat: Coat,
    dielectric: Schlick,
}

/// A surface without the part that is the same for all viewers.
#[derive(Clone, Debug)]
pub(super) struct Rest {
    pub(super) whole: Bsdf,
    coupling: Coupling,
    lambert: Vec3,
    /// What its viewer sees of the part that is missing.
    pub(super) outgoing: f32,
}

/// Least cosine under which the part for all viewers is seen: below it a shading normal may be turned.
const MIN_VIEW_COS: f32 = 0.05;

impl Coupling {
    pub(super) fn new(coat: Coat, dielectric: Schlick) -> Coupling {
        Coupling { coat, dielectric }
    }

    pub(super) fn table(&self) -> CouplingTable {
        self.coat.table()
    }

    #[inline]
    pub(super) fn share(self, cos: f32) -> f32 {
        let passed = 1.0 - self.dielectric.at(grazing(cos)).max_element();
        passed.max(0.0).sqrt() * self.coat.allowance(cos)
    }
}

impl Rest {
    /// `f·|cosθ|` and the density of the whole surface.
    #[inline]
    pub(super) fn eval(&self, wi: Vec3) -> (Vec3, f32) {
        let (f_cos, pdf) = self.whole.eval(wi);
        let cos = wi.dot(self.whole.ns);
        if cos <= 0.0 || wi.dot(self.whole.ng) <= 0.0 {
            return (f_cos, pdf);
        }
        // But for rounding it is never more than there is.
        let missing = self.lambert * (self.outgoing * self.coupling.share(cos) * cos);
        ((f_cos - missing).max(Vec3::ZERO), pdf)
    }

    pub(super) fn sample(&self, u_lobe: f32, u: [f32; 2]) -> Option<BsdfSample> {
        let sample = self.whole.sample(u_lobe, u)?;
        if sample.kind != ScatterKind::Smooth {
            return Some(sample);
        }
        let (f_cos, pdf) = self.eval(sample.wi);
        (pdf > 0.0).then(|| BsdfSample { weight: f_cos / pdf, ..sample })
    }
}

impl Bsdf {
    /// The part that all viewers see alike, seen by nobody yet: a diffuse surface with the light that passes on its way in.
    /// `None` where that is not most of the surface.
    pub(crate) fn matte(&self) -> Option<Bsdf> {
        let Bsdf { ng, ns, lambert, .. } = *self;
        let lobes = match &self.lobes {
            Lobes::None if lambert != Vec3::ZERO => Lobes::None,
            Lobes::Layers(layers) if mean(lambert) * PI > layers.reflectance_head_on() => {
                Lobes::Coupled(layers.base_coupling())
            }
            _ => return None,
        };
        Some(Bsdf { ng, ns, lambert, lobes })
    }

    /// Of a part that [`Bsdf::matte`] gave: what a viewer in a direction sees of it; 0 where it is not asked.
    #[inline]
    pub(crate) fn seen_share(&self, wo: Vec3) -> f32 {
        match &self.lobes {
            Lobes::Coupled(coupling) => {
                let cos = wo.dot(self.ns);
                if cos < MIN_VIEW_COS { 0.0 } else { coupling.share(cos) }
            }
            _ => 1.0,
        }
    }

    /// What is left of a surface without that part; `None` where nothing is.
    pub(crate) fn without(&self, matte: &Bsdf, wo: Vec3) -> Option<Bsdf> {
        let Lobes::Coupled(coupling) = matte.lobes else { return None };
        let (outgoing, whole) = (matte.seen_share(wo), self.clone());
        let lobes = Lobes::Rest(Box::new(Rest { whole, coupling, lambert: self.lambert, outgoing }));
        Some(Bsdf { ng: self.ng, ns: self.ns, lambert: Vec3::ZERO, lobes })
    }

    #[inline]
    pub(super) fn eval_coupled(&self, coupling: &Coupling, wi: Vec3) -> (Vec3, f32) {
        let cos = wi.dot(self.ns);
        if cos <= 0.0 || wi.dot(self.ng) <= 0.0 {
            return (Vec3::ZERO, 0.0);
        }
        (self.lambert * (cos * coupling.share(cos)), cos * FRAC_1_PI)
    }

    pub(super) fn sample_coupled(&self, coupling: &Coupling, u: [f32; 2]) -> Option<BsdfSample> {
        let sample = self.sample_diffuse(u)?;
        Some(BsdfSample { weight: sample.weight * coupling.share(sample.wi.dot(self.ns)), ..sample })
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use crate::bsdf::{Bsdf, SurfaceParams};
    use crate::sampler::{Sampler, uniform_sphere};
    use crate::scene::FacetScattering;

    fn coated(case: u64, wo: Vec3) -> Bsdf {
        let params = SurfaceParams {
            base_color: Vec3::new(0.9, 0.7, 0.5),
            metallic: [0.0, 0.2][case as usize % 2],
            roughness: [0.0, 0.1, 0.4, 1.0][case as usize / 2 % 4],
            transmission: [0.0, 0.0, 0.3][case as usize / 8 % 3],
            ior: [1.5, 1.2, 2.4][case as usize / 24 % 3],
            specular: [1.0, 0.4][case as usize / 72 % 2],
            specular_color: Vec3::new(1.0, 0.8, 0.6),
            thickness: 0.0,
            facet_scattering: FacetScattering::Multiple,
        };
        Bsdf::new(&params, Vec3::Y, Vec3::new(0.2, 1.0, 0.1).normalize(), wo)
    }

    fn upper(sampler: &mut Sampler) -> Vec3 {
        let direction = uniform_sphere(sampler.next_2d());
        Vec3::new(direction.x, direction.y.abs(), direction.z)
    }

    #[test]
    fn what_all_viewers_see_is_never_more_than_the_base_and_most_of_it() {
        let (mut n, mut shares) = (0, 0.0);
        for case in 0..144 {
            let mut sampler = Sampler::new(3, case, 0);
            for _ in 0..400 {
                let (wo, wi) = (upper(&mut sampler), upper(&mut sampler));
                let whole = coated(case, wo);
                let Some(matte) = whole.matte() else { continue };
                let seen = matte.eval(wi).0 * matte.seen_share(wo);
                let base = whole.eval_parts(wi).base;
                assert!(seen.max_element() <= base.max_element() * 1.0001 + 1e-7, "case {case}: {seen} of {base}");
                if wo.y > 0.5 && wi.y > 0.5 {
                    n += 1;
                    shares += f64::from(seen.x / base.x);
                }
            }
        }
        let share = shares / f64::from(n);
        assert!(n > 5000 && share > 0.97, "{share} of the base, of {n}");
    }

    #[test]
    fn both_parts_together_are_the_surface_and_sampled_as_evaluated() {
        for case in 0..144 {
            let mut sampler = Sampler::new(4, case, 0);
            let wo = upper(&mut sampler);
            let whole = coated(case, wo);
            let Some(matte) = whole.matte().filter(|matte| matte.seen_share(wo) > 0.0) else { continue };
            let rest = whole.without(&matte, wo).expect("there is a coat");
            for _ in 0..64 {
                let wi = upper(&mut sampler);
                let (f_cos, pdf) = whole.eval(wi);
                let (left, density) = rest.eval(wi);
                let sum = left + matte.eval(wi).0 * matte.seen_share(wo);
                assert!((sum - f_cos).abs().max_element() <= 1e-4 * (f_cos.max_element() + 1e-3), "{sum}, {f_cos}");
                assert_eq!(pdf, density);
            }
            for part in [&matte, &rest] {
                let Some(sample) = part.sample(sampler.next_1d(), sampler.next_2d()) else { continue };
                if sample.pdf > 0.0 {
                    let (f_cos, pdf) = part.eval(sample.wi);
                    let off = (sample.weight * sample.pdf - f_cos).abs().max_element();
                    assert!(off <= 1e-4 * f_cos.max_element().max(1e-3), "case {case}: {sample:?} is {f_cos}");
                    assert!((sample.pdf / pdf - 1.0).abs() < 1e-3);
                }
            }
        }
    }
}
