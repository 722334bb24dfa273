//! Everything that lies on or behind the plain layers: clear coat, sheen, a thin film, and diffuse transmission.
//!
//! From the top: the clear coat, the sheen, then metal, coat and base under the film. Each layer multiplies what lies
//! below it by what its own albedo leaves, the lesser of the two directions, which keeps the sum below what came and the
//! same both ways. Diffuse transmission is a share of the base that scatters to the other side instead, through the same
//! coats.

use std::f32::consts::{FRAC_1_PI, PI};

use glam::Vec3;

use super::clearcoat::ClearCoat;
use super::film::ThinFilm;
use super::finish::FinishParams;
use super::fresnel::Schlick;
use super::layers::{Layers, MIN_COAT_SHARE, mean};
use super::pose::Pose;
use super::sheen::Sheen;
use super::{Parts, ScatterKind, SurfaceParams, cosine_direction};

/// Directions in which the light for the base is averaged.
const N_RINGS: usize = 8;

/// Probabilities of choosing a layer, adding up to 1 (or 0 where everything is absorbed).
#[derive(Clone, Copy, Debug, Default)]
struct Choice {
    inner: f32,
    through: f32,
    sheen: f32,
    coat: f32,
}

/// All layers of a finished surface as one viewer sees them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stack {
    layers: Layers<Option<ThinFilm>>,
    coat: Option<ClearCoat>,
    sheen: Option<Sheen>,
    /// Albedo of the diffuse transmission over π. It is not bent, so its radiance is not squeezed either.
    through: Vec3,
    choice: Choice,
}

/// A direction that was drawn, in world space.
pub(super) struct Drawn {
    pub(super) wi: Vec3,
    pub(super) transmitted: bool,
    /// Weight and kind if it came from a lobe without density.
    pub(super) delta: Option<(Vec3, ScatterKind)>,
}

impl Stack {
    /// `lambert` is the albedo of the diffuse base over π, `through` that of what it sends to the other side.
    pub(super) fn new(
        params: &SurfaceParams,
        finish: &FinishParams,
        pose: &Pose,
        [lambert, through]: [Vec3; 2],
        coat_normal: Vec3,
    ) -> Stack {
        let dielectric = Schlick::dielectric(params.ior, params.specular, params.specular_color);
        let (ior, thickness_nm) = (finish.film_ior, finish.film_thickness_nm);
        let film = finish
            .has_film()
            .then(|| ThinFilm::new(finish.iridescence.min(1.0), ior, thickness_nm, dielectric, params.base_color));
        let layers = Layers::new(params, pose, lambert, film);
        let coat = (finish.clearcoat > 0.0)
            .then(|| ClearCoat::new(finish.clearcoat.min(1.0), finish.clearcoat_roughness, coat_normal, pose.wo));
        let color = finish.sheen_color.clamp(Vec3::ZERO, Vec3::ONE);
        let sheen = (color != Vec3::ZERO).then(|| Sheen::new(color, finish.sheen_roughness, layers.viewer().z));
        let mut stack = Stack { layers, coat, sheen, through, choice: Choice::default() };
        stack.choice = stack.choose(pose.wo, lambert);
        stack
    }

    fn choose(&self, wo: Vec3, lambert: Vec3) -> Choice {
        let under_coat = self.coat.as_ref().map_or(1.0, |coat| coat.passed(wo));
        let under_all = under_coat * self.sheen.as_ref().map_or(1.0, |sheen| sheen.passed(self.layers.viewer().z));
        let inner = mean(self.layers.albedo(lambert * PI)) * under_all;
        let through = mean(self.through) * PI * self.layers.base_share() * under_all;
        let mut sheen = self.sheen.as_ref().map_or(0.0, |sheen| mean(sheen.albedo()) * under_coat);
        let mut coat = self.coat.as_ref().map_or(0.0, ClearCoat::albedo);
        let total = inner + through + sheen + coat;
        if total <= 0.0 {
            return Choice::default();
        }
        if self.sheen.is_some() {
            sheen = sheen.max(MIN_COAT_SHARE * total);
        }
        if self.coat.as_ref().is_some_and(ClearCoat::is_rough) {
            coat = coat.max(MIN_COAT_SHARE * total);
        }
        let scale = 1.0 / (inner + through + sheen + coat);
        Choice { inner: inner * scale, through: through * scale, sheen: sheen * scale, coat: coat * scale }
    }

    /// [`Stack::eval`] with the diffuse base apart; `cos_g` is the cosine with the geometric normal.
    pub(super) fn eval_parts(&self, wi: Vec3, cos_g: f32, lambert: Vec3) -> Parts {
        let local = self.layers.local_from_world(wi);
        let mut parts = self.layers.eval_parts(local, cos_g, lambert);
        parts.base_pdf *= self.choice.inner;
        parts.coat_pdf *= self.choice.inner;
        if local.z < 0.0 && cos_g < 0.0 && self.through != Vec3::ZERO {
            parts.coat += self.layers.eval_diffuse_through(local, self.through);
            parts.coat_pdf += self.choice.through * -local.z * FRAC_1_PI;
        }
        if let Some(sheen) = &self.sheen {
            let passed = sheen.passed(local.z);
            parts.base *= passed;
            parts.coat *= passed;
            if local.z > 0.0 && cos_g > 0.0 {
                parts.coat += sheen.eval(self.layers.viewer(), local);
                parts.coat_pdf += self.choice.sheen * Sheen::pdf();
            }
        }
        if let Some(coat) = &self.coat {
            let passed = coat.passed(wi);
            parts.base *= passed;
            parts.coat *= passed;
            if cos_g > 0.0 {
                let (f_cos, pdf) = coat.eval(wi);
                parts.coat += Vec3::splat(f_cos);
                parts.coat_pdf += self.choice.coat * pdf;
            }
        }
        parts
    }

    /// `f·|cosθ|` and density of a direction.
    pub(super) fn eval(&self, wi: Vec3, cos_g: f32, lambert: Vec3) -> (Vec3, f32) {
        let Parts { base, base_pdf, coat, coat_pdf } = self.eval_parts(wi, cos_g, lambert);
        (base + coat, coat_pdf + base_pdf)
    }

    /// `f·|cosθ|` of facets and coat whose widths are at most `alpha`.
    pub(super) fn eval_narrow(&self, wi: Vec3, cos_g: f32, alpha: f32) -> Vec3 {
        let mut sum = Vec3::ZERO;
        if self.layers.is_narrow(alpha) {
            let local = self.layers.local_from_world(wi);
            // No diffuse base is asked for.
            sum += self.layers.eval_parts(local, cos_g, Vec3::ZERO).coat * self.passed(wi, local.z);
        }
        match &self.coat {
            Some(coat) if cos_g > 0.0 && coat.is_narrow(alpha) => sum + Vec3::splat(coat.eval(wi).0),
            _ => sum,
        }
    }

    /// Whether facets or coat have a density and a width of at most `alpha`.
    pub(super) fn has_narrow_lobe(&self, alpha: f32) -> bool {
        self.layers.is_narrow(alpha) || self.coat.as_ref().is_some_and(|coat| coat.is_narrow(alpha))
    }

    /// Draws a direction of one of the layers.
    pub(super) fn sample(&self, u_lobe: f32, u: [f32; 2]) -> Option<Drawn> {
        let choice = &self.choice;
        let mut u_lobe = u_lobe;
        if u_lobe < choice.inner {
            return self.sample_inner(u_lobe / choice.inner, u);
        }
        u_lobe -= choice.inner;
        if u_lobe < choice.through {
            let wi = self.layers.world_from_local(-cosine_direction(u));
            return Some(Drawn { wi, transmitted: true, delta: None });
        }
        u_lobe -= choice.through;
        let coat = self.coat.as_ref().filter(|_| u_lobe >= choice.sheen && choice.coat > 0.0);
        let Some(coat) = coat else {
            let wi = self.layers.world_from_local(Sheen::sample(u));
            return (choice.sheen > 0.0).then_some(Drawn { wi, transmitted: false, delta: None });
        };
        let (wi, reflected) = coat.sample(u)?;
        let delta = reflected.map(|share| (Vec3::splat(share / choice.coat), ScatterKind::Delta));
        Some(Drawn { wi, transmitted: false, delta })
    }

    fn sample_inner(&self, u_lobe: f32, u: [f32; 2]) -> Option<Drawn> {
        let (local, delta) = self.layers.sample(u_lobe, u)?;
        let wi = self.layers.world_from_local(local);
        let through = local == -self.layers.viewer();
        let kind = if through { ScatterKind::Through } else { ScatterKind::Delta };
        let delta = delta.map(|weight| (weight * (self.passed(wi, local.z) / self.choice.inner), kind));
        Some(Drawn { wi, transmitted: local.z < 0.0, delta })
    }

    /// World directions of mirrors and of clear transmission, each with the share of radiance that it carries.
    pub(super) fn deltas(&self) -> [Option<(Vec3, Vec3)>; 3] {
        let inner = self.layers.deltas().map(|delta| {
            let (local, share) = delta?;
            let wi = self.layers.world_from_local(local);
            Some((wi, share * self.passed(wi, local.z)))
        });
        let coat = self.coat.as_ref().and_then(ClearCoat::delta).map(|(wi, share)| (wi, Vec3::splat(share)));
        [inner[0], inner[1], coat]
    }

    /// Share of the light from a direction that gets below coat and sheen and from there to the viewer.
    fn passed(&self, wi: Vec3, cos: f32) -> f32 {
        self.coat.as_ref().map_or(1.0, |coat| coat.passed(wi))
            * self.sheen.as_ref().map_or(1.0, |sheen| sheen.passed(cos))
    }

    /// Probability that [`Stack::sample`] chooses the diffuse base: for numbers below it.
    pub(super) fn base_probability(&self) -> f32 {
        self.choice.inner * self.layers.base_probability()
    }

    /// Share of the light on the diffuse base that gets in and out of everything above it.
    pub(super) fn base_share(&self) -> f32 {
        self.layers.base_share() * self.mean_passed()
    }

    /// Mean of [`Stack::passed`] over a diffuse lobe, as if the coat had the normal of the base.
    fn mean_passed(&self) -> f32 {
        let ring = |nth: usize| {
            let cos = ((nth as f32 + 0.5) / N_RINGS as f32).sqrt();
            let [tangent, _, normal] = self.layers.frame();
            self.passed(normal * cos + tangent * (1.0 - cos * cos).sqrt(), cos)
        };
        (0..N_RINGS).map(ring).sum::<f32>() / N_RINGS as f32
    }

    /// Share of uniform light that comes back to the viewer, about.
    pub(super) fn albedo(&self, diffuse: Vec3) -> Vec3 {
        let coat = self.coat.as_ref().map_or(0.0, ClearCoat::albedo);
        let sheen = self.sheen.as_ref().map_or(Vec3::ZERO, Sheen::albedo);
        let scattered = diffuse + self.through * PI;
        self.layers.albedo(scattered) * self.mean_passed() + sheen * (1.0 - coat) + Vec3::splat(coat)
    }

    /// Shares of uniform light by rough layers below the coat, and by diffuse transmission of what arrives behind.
    pub(super) fn shares(&self) -> [Vec3; 2] {
        let narrow = if self.layers.reflects_only() { self.layers.albedo(Vec3::ZERO) } else { Vec3::ZERO };
        [narrow * self.mean_passed(), self.through * (PI * self.base_share())]
    }

    /// About the greatest value of `f·|cosθ|` apart from the diffuse base, 1/sr.
    pub(super) fn peak(&self) -> f32 {
        let wo = self.layers.viewer();
        let sheen = self.sheen.as_ref().map_or(0.0, |sheen| sheen.eval(wo, wo).max_element());
        let coat = self.coat.as_ref().map_or(0.0, ClearCoat::peak);
        self.layers.facet_peak() + self.through.max_element() + sheen + coat
    }

    /// Share of light that goes straight on, through a thin wall that is smooth.
    pub(super) fn straight_through(&self) -> Vec3 {
        let cos = self.layers.viewer().z;
        let wo = self.layers.world_from_local(self.layers.viewer());
        self.layers.straight_through() * self.passed(wo, cos)
    }

    /// Whether something but the diffuse base has a density on the viewer's side.
    pub(super) fn reflects_broadly(&self) -> bool {
        self.layers.reflects_broadly() || self.sheen.is_some() || self.coat.as_ref().is_some_and(ClearCoat::is_rough)
    }

    /// Whether something has a density on the other side.
    pub(super) fn transmits_broadly(&self) -> bool {
        self.layers.transmits_broadly() || self.through != Vec3::ZERO
    }
}
