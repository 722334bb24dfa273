//! Metal, coat and transmission in the frame whose z axis is the shading normal on the viewer's side.

mod passing;

use std::f32::consts::{FRAC_1_PI, PI};

use glam::Vec3;

use super::compensation::{Compensation, Repeated};
use super::energy::Coat;
use super::film::{Film, NoFilm, ThinFilm};
use super::fresnel::{self, Schlick, Solid, grazing};
use super::ggx::Ggx;
use super::lanes::Layered;
use super::matte::Coupling;
use super::pose::Pose;
use super::{Parts, SurfaceParams, cosine_direction};
use crate::scene::FacetScattering;

/// Below this α a lobe is a mirror.
pub(super) const MIRROR_ALPHA: f32 = 1e-3;
/// Least share of the samples that goes to a broad coat: its reflectance away from the mirror direction can be far higher
/// than the one that the choice of lobes looks at.
pub(super) const MIN_COAT_SHARE: f32 = 0.1;

/// What lies behind the interface.
#[derive(Clone, Copy, Debug)]
enum Behind {
    /// The same medium as in front.
    ThinWall,
    /// Another medium, with its index over the one in front.
    Solid { eta: f32, solid: Solid },
}

/// Probabilities of choosing a lobe, adding up to 1 (or 0 where everything is absorbed).
#[derive(Clone, Copy, Debug)]
struct Choice {
    diffuse: f32,
    /// Microfacets: reflection, and transmission where that is broad too.
    facets: f32,
    mirror: f32,
    /// What the facets of a rough solid scatter repeatedly.
    repeated: f32,
    /// Clear transmission; what is left.
    clear: f32,
}

impl Choice {
    const NONE: Choice = Choice { diffuse: 0.0, facets: 0.0, mirror: 0.0, repeated: 0.0, clear: 0.0 };
}

/// All lobes of a surface that is more than diffuse.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layers<F = NoFilm> {
    frame: [Vec3; 3],
    wo: Vec3,
    base_color: Vec3,
    /// Reflection over the diffuse base; under a film a bound of it, and the film knows the rest.
    dielectric: Schlick,
    film: F,
    /// Shares of metal, of dielectric over a diffuse base, and of dielectric that lets light pass. They add up to 1.
    metal: f32,
    opaque: f32,
    passing: f32,
    behind: Behind,
    ggx: Ggx,
    lambda_o: f32,
    rough_coat: bool,
    rough_pass: bool,
    coat: Coat,
    allowance_o: f32,
    /// Of rough metal and rough thin walls.
    compensation: Option<Compensation>,
    /// Of rough solids.
    repeated: Option<Repeated>,
    choice: Choice,
}

impl<F: Film> Layers<F> {
    /// `lambert` is the albedo of the diffuse base over π.
    pub(super) fn new(params: &SurfaceParams, pose: &Pose, lambert: Vec3, film: F) -> Layers<F> {
        let mut layers = Layers::unchosen(params, pose, film);
        layers.choice = layers.choose(lambert);
        layers
    }

    /// The same to be evaluated alone: it takes less, and knows no densities.
    pub(super) fn unchosen(params: &SurfaceParams, pose: &Pose, film: F) -> Layers<F> {
        let [tangent, bitangent, ns] = pose.frame;
        let plain = Schlick::dielectric(params.ior, params.specular, params.specular_color);
        let dielectric = film.film().map_or(plain, ThinFilm::bound);
        let rough_coat = pose.alpha[0] >= MIRROR_ALPHA;
        let matched = fresnel::is_matched(params.ior);
        let bends = params.thickness > 0.0 && !matched;
        let ggx = Ggx::new(pose.alpha);
        // The narrower width has the higher albedo.
        let coat_alpha = if rough_coat { pose.alpha[0].min(pose.alpha[1]) } else { 0.0 };
        let coat = Coat::new(coat_alpha, dielectric.f0.max_element(), dielectric.f90);
        let wo = Vec3::new(pose.wo.dot(tangent), pose.wo.dot(bitangent), pose.wo.dot(ns));
        let passing = (1.0 - params.metallic) * params.transmission;
        let follows = rough_coat && params.facet_scattering == FacetScattering::Multiple;
        let is_wall = passing > 0.0 && !bends && !matched;
        let compensation = (follows && (params.metallic > 0.0 || is_wall))
            .then(|| Compensation::new(coat_alpha, wo.z, params.base_color));
        let solid = bends.then(|| Solid::new(params.ior, params.specular, params.specular_color));
        let repeating = solid.filter(|_| follows && passing > 0.0);
        let repeated = repeating.map(|solid| Repeated::new(coat_alpha, wo.z, pose.eta, solid));
        Layers {
            frame: pose.frame,
            wo,
            base_color: params.base_color,
            dielectric,
            film,
            metal: params.metallic,
            opaque: (1.0 - params.metallic) * (1.0 - params.transmission),
            passing,
            behind: solid.map_or(Behind::ThinWall, |solid| Behind::Solid { eta: pose.eta, solid }),
            ggx,
            lambda_o: ggx.lambda(wo),
            rough_coat,
            rough_pass: rough_coat && !matched,
            coat,
            allowance_o: coat.allowance(wo.z),
            compensation,
            repeated,
            choice: Choice::NONE,
        }
    }

    /// Towards the viewer, in the local frame.
    pub(super) fn viewer(&self) -> Vec3 {
        self.wo
    }

    /// Tangent, bitangent and normal in world space.
    pub(super) fn frame(&self) -> [Vec3; 3] {
        self.frame
    }

    #[inline]
    pub(super) fn local_from_world(&self, w: Vec3) -> Vec3 {
        let [x, y, z] = self.frame;
        Vec3::new(w.dot(x), w.dot(y), w.dot(z))
    }

    #[inline]
    pub(super) fn world_from_local(&self, w: Vec3) -> Vec3 {
        let [x, y, z] = self.frame;
        x * w.x + y * w.y + z * w.z
    }

    pub(super) fn reflects_broadly(&self) -> bool {
        self.rough_coat && self.choice.facets > 0.0
    }

    /// Neither a mirror nor anything that lets light pass.
    pub(super) fn reflects_only(&self) -> bool {
        self.rough_coat && self.passing <= 0.0
    }

    /// Whether its facets have a width of at most `alpha` along both axes, and none of a mirror.
    pub(super) fn is_narrow(&self, alpha: f32) -> bool {
        self.reflects_broadly() && self.ggx.widest() <= alpha
    }

    pub(super) fn transmits_broadly(&self) -> bool {
        self.rough_pass && self.passing > 0.0 && self.base_color != Vec3::ZERO
    }

    /// Share of light that a facet reflects.
    #[inline]
    fn reflectance(&self, cos: f32) -> Vec3 {
        self.reflectance_times(cos, 1.0, Vec3::ONE)
    }

    /// The same with what other facets add to it, of light from `wi`.
    #[inline]
    fn compensated_reflectance(&self, cos: f32, wi: Vec3) -> Vec3 {
        let Some(more) = &self.compensation else { return self.reflectance(cos) };
        let lossless = more.lossless(wi.z);
        let passing = if self.repeated.is_some() { 1.0 } else { lossless };
        self.reflectance_times(cos, passing, more.metal(lossless))
    }

    /// Share of light that a facet reflects: where it lets the rest pass times `passing`, as a metal times `metal`.
    #[inline]
    fn reflectance_times(&self, cos: f32, passing: f32, metal: Vec3) -> Vec3 {
        let mut sum = self.passing_reflectance(cos) * (self.passing * passing);
        let grazing = grazing(cos);
        if self.film.film().is_none() || self.opaque > 0.0 {
            sum += self.dielectric_reflectance(cos, grazing) * self.opaque;
        }
        match self.film.film() {
            None => sum += (self.base_color + (Vec3::ONE - self.base_color) * grazing) * metal * self.metal,
            Some(film) if self.metal > 0.0 => sum += film.metal(cos) * metal * self.metal,
            Some(_) => {}
        }
        sum
    }

    #[inline]
    fn dielectric_reflectance(&self, cos: f32, grazing: f32) -> Vec3 {
        self.film.film().map_or_else(|| self.dielectric.at(grazing), |film| film.dielectric(cos))
    }

    /// Share of light that a facet reflects where it lets the rest pass.
    #[inline]
    fn passing_reflectance(&self, cos: f32) -> Vec3 {
        match (self.behind, self.film.film()) {
            _ if self.passing <= 0.0 => Vec3::ZERO,
            (Behind::ThinWall, _) => self.dielectric_reflectance(cos, grazing(cos)),
            (Behind::Solid { eta, solid }, None) => solid.reflectance(cos, eta),
            (Behind::Solid { eta, solid }, Some(film)) => film.solid(cos, eta, solid.reflectance(cos, eta)),
        }
    }

    /// About the greatest `f·|cosθ|` of the facets' reflection.
    pub(super) fn facet_peak(&self) -> f32 {
        if !self.rough_coat {
            return 0.0;
        }
        let facing = self.ggx.d(Vec3::Z) / (4.0 * self.wo.z) * self.g2(self.wo);
        self.compensated_reflectance(self.wo.z, self.wo).max_element() * facing
    }

    fn choose(&self, lambert: Vec3) -> Choice {
        let cos = self.wo.z;
        let diffuse = mean(lambert) * PI * self.coat.base_share(cos);
        let (reflected, passed) = (mean(self.reflectance(cos)), mean(self.transmittance(cos)));
        let (mirror, mut facets) = if self.rough_coat { (0.0, reflected) } else { (reflected, 0.0) };
        let mut clear = passed;
        if self.rough_pass {
            facets += passed;
            clear = 0.0;
        }
        let repeated = self.repeated_albedo();
        let total = diffuse + facets + mirror + repeated + clear;
        if total <= 0.0 {
            return Choice::NONE;
        }
        if facets > 0.0 {
            facets = facets.max(MIN_COAT_SHARE * total);
        }
        let scale = 1.0 / (diffuse + facets + mirror + repeated + clear);
        let [diffuse, facets, mirror, repeated, clear] =
            [diffuse, facets, mirror, repeated, clear].map(|share| share * scale);
        Choice { diffuse, facets, mirror, repeated, clear }
    }

    /// Probability that a facet sampled as visible is asked to reflect.
    #[inline]
    fn reflect_probability(&self, cos: f32) -> f32 {
        if !self.transmits_broadly() {
            return 1.0;
        }
        let (reflected, passed) = (mean(self.reflectance(cos)), mean(self.transmittance(cos)));
        if reflected + passed > 0.0 { reflected / (reflected + passed) } else { 1.0 }
    }

    /// Share of the facets that the viewer sees.
    #[inline]
    fn g1(&self) -> f32 {
        1.0 / (1.0 + self.lambda_o)
    }

    /// Share of the facets seen by the viewer and from another direction, correlated by height. \[Heitz2014\]
    #[inline]
    fn g2(&self, wi: Vec3) -> f32 {
        1.0 / (1.0 + self.lambda_o + self.ggx.lambda(wi))
    }

    /// `f·|cosθ|` and density of a local direction; `cos_g` is its cosine with the geometric normal.
    pub(super) fn eval(&self, wi: Vec3, cos_g: f32, lambert: Vec3) -> (Vec3, f32) {
        if wi.z > 0.0 && cos_g > 0.0 {
            self.eval_reflection(wi, lambert)
        } else if wi.z < 0.0 && cos_g < 0.0 && self.transmits_broadly() {
            match self.behind {
                Behind::ThinWall => self.eval_thin(wi),
                Behind::Solid { eta, .. } => {
                    let ((facets, facets_pdf), (more, more_pdf)) =
                        (self.eval_refraction(wi, eta), self.eval_repeated(wi));
                    (facets + more, facets_pdf + more_pdf)
                }
            }
        } else {
            (Vec3::ZERO, 0.0)
        }
    }

    fn eval_reflection(&self, wi: Vec3, lambert: Vec3) -> (Vec3, f32) {
        let Parts { base, base_pdf, coat, coat_pdf } = self.parts(wi, lambert);
        (base + coat, coat_pdf + base_pdf)
    }

    /// Reflection of the diffuse base and of the facets over it.
    #[inline]
    fn parts(&self, wi: Vec3, lambert: Vec3) -> Parts {
        let wm = (wi + self.wo).normalize();
        let cos_half = self.wo.dot(wm);
        let mut parts = Parts { base_pdf: self.choice.diffuse * wi.z * FRAC_1_PI, ..Parts::default() };
        if lambert != Vec3::ZERO {
            parts.base = lambert * (self.coupling(cos_half, wi.z) * wi.z);
        }
        if self.rough_coat {
            let quarter = self.ggx.d(wm) / (4.0 * self.wo.z);
            parts.coat = self.compensated_reflectance(cos_half, wi) * (quarter * self.g2(wi));
            parts.coat_pdf = self.choice.facets * self.reflect_probability(cos_half) * quarter * self.g1();
            if self.repeated.is_some() {
                let (value, pdf) = self.eval_repeated(wi);
                parts.coat += value;
                parts.coat_pdf += pdf;
            }
        }
        parts
    }

    /// Share of the light from a cosine that gets through the coat to the diffuse base and out again.
    #[inline]
    fn coupling(&self, cos_half: f32, cos_i: f32) -> f32 {
        let coat = self.dielectric.at(grazing(cos_half)).max_element();
        let allowance = if cos_i < self.wo.z { self.coat.allowance(cos_i) } else { self.allowance_o };
        (1.0 - coat) * allowance
    }

    /// `f·|cosθ|` of a diffuse base of this albedo over π that sends its light to the other side; `wi.z` < 0.
    pub(super) fn eval_diffuse_through(&self, wi: Vec3, through: Vec3) -> Vec3 {
        let mirrored = Vec3::new(wi.x, wi.y, -wi.z);
        let cos_half = self.wo.dot((mirrored + self.wo).normalize());
        through * (self.coupling(cos_half, mirrored.z) * mirrored.z)
    }

    /// [`Layers::eval`] with the diffuse base apart.
    pub(super) fn eval_parts(&self, wi: Vec3, cos_g: f32, lambert: Vec3) -> Parts {
        if wi.z > 0.0 && cos_g > 0.0 {
            return self.parts(wi, lambert);
        }
        let (coat, coat_pdf) = self.eval(wi, cos_g, lambert);
        Parts { coat, coat_pdf, ..Parts::default() }
    }

    /// What the coat leaves of light on its way into the diffuse base or out of it.
    pub(super) fn base_coupling(&self) -> Coupling {
        Coupling::new(self.coat, self.dielectric)
    }

    /// The surface for many directions at once: `ng` is its geometric normal, `lambert` the albedo of its base over π. `None`
    /// where it lets light pass or lies under a film.
    pub(super) fn lanes(&self, ng: Vec3, lambert: Vec3) -> Option<Layered> {
        if self.passing > 0.0 || self.film.film().is_some() {
            return None;
        }
        let Schlick { f0, f90 } = self.dielectric;
        let coat = [f0 * self.opaque, (Vec3::splat(f90) - f0) * self.opaque];
        let metal = [self.base_color * self.metal, (Vec3::ONE - self.base_color) * self.metal];
        Some(Layered {
            ng,
            frame: self.frame,
            wo: self.wo,
            lambert,
            table: self.base_coupling().table(),
            allowance_o: self.allowance_o,
            alpha: if self.rough_coat { self.ggx.alpha() } else { [1.0; 2] },
            facets: f32::from(u8::from(self.rough_coat)),
            lambda_o: self.lambda_o,
            coat: coat.map(Into::into),
            metal: metal.map(Into::into),
            compensation: self.compensation.map(|more| more.table()),
            choice: [self.choice.facets, self.choice.diffuse],
            missing: 0.0,
        })
    }

    /// About the share of light from ahead that all but the diffuse base scatters.
    pub(super) fn reflectance_head_on(&self) -> f32 {
        mean(self.dielectric.f0) + mean(self.base_color) * self.metal + self.passing
    }

    /// Probability that [`Layers::sample`] chooses the diffuse base: for numbers below it.
    pub(super) fn base_probability(&self) -> f32 {
        self.choice.diffuse
    }

    /// Share of the light on the diffuse base that gets in and out of the coat.
    pub(super) fn base_share(&self) -> f32 {
        self.coat.base_share(self.wo.z)
    }

    /// A local direction, with its weight if it came from a lobe without density.
    pub(super) fn sample(&self, u_lobe: f32, u: [f32; 2]) -> Option<(Vec3, Option<Vec3>)> {
        let choice = &self.choice;
        let mut u_lobe = u_lobe;
        if u_lobe < choice.diffuse {
            let wi = cosine_direction(u);
            return (wi.z > 0.0).then_some((wi, None));
        }
        u_lobe -= choice.diffuse;
        if u_lobe < choice.facets {
            return Some((self.sample_facet(u_lobe / choice.facets, u)?, None));
        }
        u_lobe -= choice.facets;
        if u_lobe < choice.repeated {
            return Some((self.sample_repeated(u_lobe / choice.repeated, u)?, None));
        }
        u_lobe -= choice.repeated;
        if u_lobe < choice.mirror || (choice.clear <= 0.0 && choice.mirror > 0.0) {
            let wi = Vec3::new(-self.wo.x, -self.wo.y, self.wo.z);
            return Some((wi, Some(self.reflectance(self.wo.z) / choice.mirror)));
        }
        if choice.clear <= 0.0 {
            return None;
        }
        let weight = self.transmittance(self.wo.z) / choice.clear;
        match self.behind {
            Behind::ThinWall => Some((-self.wo, Some(weight))),
            Behind::Solid { eta, .. } => Some((fresnel::refract(self.wo, Vec3::Z, eta)?, Some(weight / (eta * eta)))),
        }
    }

    /// Local directions of the mirror and of clear transmission, each with the share of radiance that it carries.
    pub(super) fn deltas(&self) -> [Option<(Vec3, Vec3)>; 2] {
        let wo = self.wo;
        let mirror = (self.choice.mirror > 0.0).then(|| (Vec3::new(-wo.x, -wo.y, wo.z), self.reflectance(wo.z)));
        let clear = || match self.behind {
            Behind::ThinWall => Some((-wo, self.transmittance(wo.z))),
            Behind::Solid { eta, .. } => {
                Some((fresnel::refract(wo, Vec3::Z, eta)?, self.transmittance(wo.z) / (eta * eta)))
            }
        };
        [mirror, if self.choice.clear > 0.0 { clear() } else { None }]
    }

    fn sample_facet(&self, u_side: f32, u: [f32; 2]) -> Option<Vec3> {
        let wm = self.ggx.sample(self.wo, u);
        let cos_half = self.wo.dot(wm);
        if cos_half <= 0.0 {
            return None;
        }
        let reflects = u_side < self.reflect_probability(cos_half);
        match self.behind {
            Behind::Solid { eta, .. } if !reflects => fresnel::refract(self.wo, wm, eta).filter(|wi| wi.z < 0.0),
            _ => {
                let mirrored = wm * (2.0 * cos_half) - self.wo;
                let side = if reflects { 1.0 } else { -1.0 };
                (mirrored.z > 0.0).then_some(Vec3::new(mirrored.x, mirrored.y, side * mirrored.z))
            }
        }
    }

    /// Share of uniform light that comes back to the viewer, given the albedo of the diffuse base.
    pub(super) fn albedo(&self, diffuse: Vec3) -> Vec3 {
        let cos = self.wo.z;
        let [per_f0, per_f90] = self.coat.albedo(cos);
        let [coated, metal] = match self.film.film() {
            Some(film) => [film.dielectric(cos), film.metal(cos)].map(|reflected| {
                let grazing = grazing(cos).min(0.999);
                let f0 = (reflected - Vec3::splat(grazing)) / (1.0 - grazing);
                f0.clamp(Vec3::ZERO, Vec3::ONE) * per_f0 + Vec3::splat(per_f90)
            }),
            None => [
                self.dielectric.f0 * per_f0 + Vec3::splat(self.dielectric.f90 * per_f90),
                self.base_color * per_f0 + Vec3::splat(per_f90),
            ],
        };
        let metal = self.compensation.map_or(metal, |more| metal * more.metal_of_albedo(per_f0 + per_f90));
        let passing = self.passing_reflectance(cos) * self.passing + self.transmittance(cos);
        let unshadowed = match self.behind {
            Behind::ThinWall if self.compensation.is_none() => per_f0 + per_f90,
            Behind::ThinWall => 1.0,
            // What a facet of glass shadows of its reflection mostly refracts, or comes back later.
            Behind::Solid { .. } => 1.0,
        };
        diffuse * self.coat.base_share(cos) + coated * self.opaque + metal * self.metal + passing * unshadowed
    }
}

/// Whether a roughness is taken for perfectly smooth.
pub(crate) fn is_mirror(roughness: f32) -> bool {
    roughness * roughness < MIRROR_ALPHA
}

pub(super) fn mean(color: Vec3) -> f32 {
    (color.x + color.y + color.z) * (1.0 / 3.0)
}
