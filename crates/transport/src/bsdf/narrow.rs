//! The lobes that show a picture of what they reflect: facets and lacquer of little roughness.

use glam::Vec3;

use super::{Bsdf, BsdfSample, Lobes, ScatterKind};

impl Bsdf {
    /// Whether a lobe with a density has a width α of at most `alpha` along both axes.
    pub(crate) fn has_narrow_lobe(&self, alpha: f32) -> bool {
        match &self.lobes {
            Lobes::None | Lobes::Coupled(_) | Lobes::Rest(_) => false,
            Lobes::Layers(layers) => layers.is_narrow(alpha),
            Lobes::Stack(stack) => stack.has_narrow_lobe(alpha),
        }
    }

    /// `f·|cosθ|` of these lobes alone.
    pub(crate) fn eval_narrow(&self, wi: Vec3, alpha: f32) -> Vec3 {
        match &self.lobes {
            Lobes::Layers(layers) if layers.is_narrow(alpha) => {
                layers.eval_parts(layers.local_from_world(wi), wi.dot(self.ng), self.lambert).coat
            }
            Lobes::Stack(stack) => stack.eval_narrow(wi, wi.dot(self.ng), alpha),
            _ => Vec3::ZERO,
        }
    }

    /// A direction of these lobes: as [`Bsdf::sample_coat`], but no number is spent on the diffuse base.
    pub(crate) fn sample_narrow(&self, u_lobe: f32, u: [f32; 2], alpha: f32) -> Option<BsdfSample> {
        let base = match &self.lobes {
            Lobes::None | Lobes::Coupled(_) | Lobes::Rest(_) => return None,
            Lobes::Layers(layers) => layers.base_probability(),
            Lobes::Stack(stack) => stack.base_probability(),
        };
        let others = 1.0 - base;
        let sample = self.sample_coat((base + u_lobe * others).min(1.0 - f32::EPSILON), u)?;
        let pdf = sample.pdf / others;
        let weight = self.eval_narrow(sample.wi, alpha) / pdf;
        (sample.kind == ScatterKind::Smooth && weight.max_element() > 0.0 && weight.is_finite()).then_some(BsdfSample {
            weight,
            pdf,
            ..sample
        })
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use crate::bsdf::{Bsdf, FinishParams, SurfaceParams};
    use crate::sampler::{Sampler, uniform_sphere};
    use crate::scene::FacetScattering;

    const ALPHA: f32 = 0.2;

    fn bsdf(case: u64, sampler: &mut Sampler) -> Bsdf {
        let params = SurfaceParams {
            base_color: Vec3::new(0.9, 0.7, 0.5),
            metallic: [0.0, 1.0, 0.3][case as usize % 3],
            roughness: [0.4, 0.3, 0.9][case as usize / 3 % 3],
            transmission: [0.0, 0.0, 0.6][case as usize / 9 % 3],
            ior: 1.5,
            specular: 1.0,
            specular_color: Vec3::ONE,
            thickness: [0.0, 0.1][case as usize / 27 % 2],
            facet_scattering: FacetScattering::Multiple,
        };
        let wo = (uniform_sphere(sampler.next_2d()) + Vec3::Y * 1.2).normalize();
        let finish = FinishParams { clearcoat: 0.8, clearcoat_roughness: 0.35, ..FinishParams::default() };
        match case % 2 {
            0 => Bsdf::new(&params, Vec3::Y, Vec3::Y, wo),
            _ => Bsdf::finished(&params, &finish, Vec3::Y, Vec3::Y, wo),
        }
    }

    #[test]
    fn narrow_directions_stand_for_the_narrow_part_of_what_a_surface_sends() {
        // A lamp that is brighter to one side, by directions of narrow lobes and by those of all lobes.
        let light = |wi: Vec3| 1.0 + wi.x + 0.5 * wi.z;
        let mut n_narrow = 0;
        for case in 0..54 {
            let mut sampler = Sampler::new(17, case, 0);
            let bsdf = bsdf(case, &mut sampler);
            if !bsdf.has_narrow_lobe(ALPHA) {
                assert!(bsdf.sample_narrow(0.5, [0.5; 2], ALPHA).is_none(), "case {case}");
                continue;
            }
            n_narrow += 1;
            let n = 1 << 15;
            let [mut own, mut of_all] = [Vec3::ZERO; 2];
            for nth in 0..n {
                let mut sampler = Sampler::new(18, case, nth);
                let (u_lobe, u) = (sampler.next_1d(), sampler.next_2d());
                if let Some(sample) = bsdf.sample_narrow(u_lobe, u, ALPHA) {
                    own += sample.weight * light(sample.wi);
                }
                if let Some(sample) = bsdf.sample(u_lobe, u).filter(|sample| sample.pdf > 0.0) {
                    of_all += bsdf.eval_narrow(sample.wi, ALPHA) / sample.pdf * light(sample.wi);
                }
            }
            let off = (own - of_all).abs().max_element() / own.max_element().max(of_all.max_element());
            assert!(off < 0.03, "case {case}: {own} by narrow directions, {of_all} by all, of {n}");
        }
        assert!(n_narrow > 20, "{n_narrow} surfaces with a narrow lobe");
    }
}
