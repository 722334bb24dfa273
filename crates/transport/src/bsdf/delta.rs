//! The lobes without density, all of them at once: what a viewer sees in mirrors and through clear glass.

use glam::Vec3;

use super::{Bsdf, Lobes};

/// A single direction that a surface shows its viewer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DeltaLobe {
    /// Unit direction away from the surface, in world space.
    pub wi: Vec3,
    /// Share of the radiance from there that goes to the viewer.
    pub share: Vec3,
    /// Whether it is on the other side of the surface than the viewer.
    pub transmitted: bool,
}

impl Bsdf {
    /// Mirrors and clear transmission: what [`Bsdf::sample`] chooses from without a density.
    pub(crate) fn deltas(&self) -> impl Iterator<Item = DeltaLobe> {
        let lobes = match &self.lobes {
            Lobes::None | Lobes::Coupled(_) | Lobes::Rest(_) => [None; 3],
            Lobes::Layers(layers) => {
                let world =
                    |delta: Option<(Vec3, Vec3)>| delta.map(|(local, share)| (layers.world_from_local(local), share));
                let [mirror, clear] = layers.deltas();
                [world(mirror), world(clear), None]
            }
            Lobes::Stack(stack) => stack.deltas(),
        };
        let (ng, ns) = (self.ng, self.ns);
        // A direction that is on different sides of geometry and shading goes nowhere, as in `sample`.
        let lobe = move |(wi, share): (Vec3, Vec3)| {
            let (transmitted, below) = (wi.dot(ns) < 0.0, wi.dot(ng));
            let goes = transmitted == (below < 0.0) && below != 0.0 && share != Vec3::ZERO;
            goes.then_some(DeltaLobe { wi, share, transmitted })
        };
        lobes.into_iter().flatten().filter_map(lobe)
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use crate::bsdf::{Bsdf, ScatterKind, SurfaceParams};
    use crate::sampler::{Sampler, uniform_sphere};
    use crate::scene::FacetScattering;

    #[test]
    fn all_lobes_without_density_are_those_that_sampling_finds() {
        let mut n_lobes = 0;
        for case in 0..300 {
            let mut sampler = Sampler::new(11, case, 0);
            let params = SurfaceParams {
                base_color: Vec3::new(0.9, 0.7, 0.5),
                metallic: [0.0, 1.0, 0.3][case as usize % 3],
                roughness: 0.0,
                transmission: [0.0, 1.0, 0.6][case as usize / 3 % 3],
                ior: 1.5,
                specular: 1.0,
                specular_color: Vec3::ONE,
                thickness: [0.0, 0.1][case as usize / 9 % 2],
                facet_scattering: FacetScattering::Multiple,
            };
            let wo = uniform_sphere(sampler.next_2d());
            let bsdf = Bsdf::new(&params, Vec3::Y, Vec3::Y, wo);
            // Sampled shares: the mean of the weights of each direction.
            let n = 4000;
            let mut found: Vec<(Vec3, Vec3)> = Vec::new();
            for i in 0..n {
                let Some(sample) = bsdf.sample((i as f32 + 0.5) / n as f32, sampler.next_2d()) else { continue };
                if sample.kind == ScatterKind::Smooth {
                    continue;
                }
                let share = sample.weight / n as f32;
                match found.iter_mut().find(|(wi, _)| wi.distance(sample.wi) < 1e-4) {
                    Some((_, sum)) => *sum += share,
                    None => found.push((sample.wi, share)),
                }
            }
            let lobes: Vec<_> = bsdf.deltas().collect();
            assert_eq!(lobes.len(), found.len(), "case {case}: {lobes:?} {found:?}");
            for lobe in lobes {
                let (_, share) = found.iter().find(|(wi, _)| wi.distance(lobe.wi) < 1e-4).expect("the same direction");
                assert!((lobe.share - *share).abs().max_element() < 5e-3, "case {case}: {lobe:?} {share}");
                n_lobes += 1;
            }
        }
        assert!(n_lobes > 200, "{n_lobes}");
    }
}
