//! How a surface scatters light: glTF 2.0 Appendix B with its transmission, volume, ior and specular extensions, and those
//! of a [`crate::scene::Finish`].
//!
//! A metal is a GGX lobe with the base color as its reflectance. Rough metal and rough facets that let light pass also return
//! what they scatter more than once (see `compensation`). A dielectric is a GGX coat over a diffuse base that sees
//! `1 − F(V·H)` of the light (and no more than energy allows, see `energy`). Transmission takes a share of the diffuse
//! base and lets it pass instead: straight through a thin wall, bent by a solid. The coat of a thin wall is Schlick's as
//! in the opaque case; a solid has the exact reflectance of its index, so that total reflection is right, scaled by specular
//! strength and color below it. Without coat, metal and transmission the model is exactly Lambert's.
//!
//! Stretched highlights are the same layers in a turned frame. Clear coat, sheen, thin films and diffuse transmission live
//! in a `Stack` around them, which only surfaces that have one of these pay for.
//!
//! Directions are unit vectors in world space that point away from the surface. Surfaces scatter on both sides.

mod clearcoat;
mod compensation;
mod delta;
mod energy;
mod film;
mod finish;
mod fresnel;
mod furnace;
mod ggx;
mod lanes;
mod layers;
mod matte;
mod narrow;
mod params;
mod pose;
mod sheen;
mod stack;
#[cfg(test)]
pub(crate) mod tests;

use std::f32::consts::{FRAC_1_PI, PI, TAU};

use glam::Vec3;

pub use self::finish::{FinishParams, Frame, finish_params};
pub use self::furnace::{FurnaceLoss, furnace_loss};
pub(crate) use self::params::least_roughness;
pub use self::params::{SurfaceParams, alpha, shading_normal, surface_params};

pub(crate) use self::fresnel::{Schlick, is_matched};
pub(crate) use self::lanes::{BsdfLanes, LANES, Lanes, Scattered, Vectors};
pub(crate) use self::layers::is_mirror;

use self::film::NoFilm;
use self::layers::{Layers, mean};
use self::matte::{Coupling, Rest};
use self::pose::{Facing, Pose, turned_to_viewer};
use self::stack::{Drawn, Stack};
use crate::scene::FacetScattering;

/// Scattering at one point towards one viewer.
#[derive(Clone, Debug)]
pub struct Bsdf {
    /// Geometric normal on the viewer's side.
    ng: Vec3,
    /// Shading normal on the viewer's side.
    ns: Vec3,
    /// Diffuse albedo over π.
    lambert: Vec3,
    lobes: Lobes,
}

/// What there is besides a diffuse base.
#[derive(Clone, Debug)]
#[expect(clippy::large_enum_variant, reason = "each hit makes one and keeps it; a box would be one allocation a hit")]
enum Lobes {
    /// Nothing.
    None,
    /// Metal, coat and transmission.
    Layers(Layers),
    /// These and more.
    Stack(Box<Stack>),
    /// A diffuse base that a coat keeps some light from, and no coat: see [`Bsdf::matte`].
    Coupled(Coupling),
    /// A surface without that.
    Rest(Box<Rest>),
}

/// Whether a sampled direction came from a lobe with a density.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScatterKind {
    /// From a lobe that `eval` knows.
    Smooth,
    /// From a mirror or a smooth solid: a single direction, which `eval` never returns.
    Delta,
    /// Straight on through a thin wall, as if it only took some of the light away.
    Through,
}

/// A sampled direction.
#[derive(Clone, Copy, Debug)]
pub struct BsdfSample {
    /// Towards the light.
    pub wi: Vec3,
    /// `f·|cosθ| / pdf`, for the others the fraction itself over the probability of choosing it.
    pub weight: Vec3,
    /// Density per solid angle, 0 for all but `Smooth`.
    pub pdf: f32,
    /// Which kind of lobe it came from.
    pub kind: ScatterKind,
    /// Whether `wi` is on the other side of the surface than the viewer.
    pub transmitted: bool,
}

/// The value of a surface in a direction, its diffuse base apart.
#[derive(Clone, Copy, Debug, Default)]
pub struct Parts {
    /// `f·|cosθ|` of the diffuse base.
    pub base: Vec3,
    /// Density per solid angle with which [`Bsdf::sample_base`] chooses the direction.
    pub base_pdf: f32,
    /// `f·|cosθ|` of all other lobes that have a density.
    pub coat: Vec3,
    /// Density per solid angle with which [`Bsdf::sample_coat`] chooses the direction.
    pub coat_pdf: f32,
}

/// What a surface sends back towards its viewer per unit of the mean radiance that arrives.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shares {
    /// Of all light: by the diffuse base, or by all lobes where each of them is broad.
    pub base: Vec3,
    /// By other rough lobes that reflect, as if they were broad.
    pub narrow: Vec3,
    /// By diffuse transmission, of what arrives on the other side.
    pub behind: Vec3,
    /// Whether `base` is all there is.
    pub is_all: bool,
}

impl Bsdf {
    /// `ng` is the geometric normal of the front side, `ns` a shading normal on the same side; `wo` may be on either side,
    /// and decides whether a solid is entered or left.
    pub fn new(params: &SurfaceParams, ng: Vec3, ns: Vec3, wo: Vec3) -> Bsdf {
        let is_lambert = params.metallic <= 0.0
            && params.transmission <= 0.0
            && (params.specular <= 0.0 || fresnel::is_matched(params.ior));
        if is_lambert {
            let Facing { ng, ns, .. } = Facing::new(params, ng, ns, wo);
            return Bsdf { ng, ns, lambert: params.base_color * FRAC_1_PI, lobes: Lobes::None };
        }
        Bsdf::layered(params, ng, ns, wo)
    }

    /// The same with all lobes of the model, also where they reflect and let pass nothing.
    pub fn layered(params: &SurfaceParams, ng: Vec3, ns: Vec3, wo: Vec3) -> Bsdf {
        let Facing { ng, ns, eta } = Facing::new(params, ng, ns, wo);
        let opaque = (1.0 - params.metallic) * (1.0 - params.transmission);
        let lambert = params.base_color * (opaque * FRAC_1_PI);
        let pose = Pose::round(turned_to_viewer(ns, wo), wo, eta, params.roughness);
        let layers = Layers::new(params, &pose, lambert, NoFilm);
        Bsdf { ng, ns: pose.frame[2], lambert, lobes: Lobes::Layers(layers) }
    }

    /// [`Bsdf::new`] for nothing but the first answer of [`Bsdf::eval`] and [`Bsdf::transmits`]: it takes less.
    #[inline]
    pub(crate) fn to_be_lit(params: &SurfaceParams, ng: Vec3, ns: Vec3, wo: Vec3) -> Bsdf {
        let Facing { ng, ns, eta } = Facing::new(params, ng, ns, wo);
        let has_coat = params.specular > 0.0 && !fresnel::is_matched(params.ior);
        if params.metallic <= 0.0 && params.transmission <= 0.0 && !has_coat {
            return Bsdf { ng, ns, lambert: params.base_color * FRAC_1_PI, lobes: Lobes::None };
        }
        let opaque = (1.0 - params.metallic) * (1.0 - params.transmission);
        let pose = Pose::round(turned_to_viewer(ns, wo), wo, eta, params.roughness);
        let lobes = Lobes::Layers(Layers::unchosen(params, &pose, NoFilm));
        Bsdf { ng, ns: pose.frame[2], lambert: params.base_color * (opaque * FRAC_1_PI), lobes }
    }

    /// [`Bsdf::new`] of a surface with a finish, which costs more.
    pub fn finished(params: &SurfaceParams, finish: &FinishParams, ng: Vec3, ns: Vec3, wo: Vec3) -> Bsdf {
        let (stretched, stacked) = (finish.anisotropy > 0.0, finish.is_stacked());
        if !stretched && !stacked {
            return Bsdf::new(params, ng, ns, wo);
        }
        let front = ng;
        let Facing { ng, ns, eta } = Facing::new(params, ng, ns, wo);
        let mut pose = Pose::round(turned_to_viewer(ns, wo), wo, eta, params.roughness);
        if stretched {
            pose = pose.stretched(finish.anisotropy_direction, finish.anisotropy.min(1.0));
        }
        let opaque = (1.0 - params.metallic) * (1.0 - params.transmission) * FRAC_1_PI;
        let passing = finish.diffuse_transmission.clamp(0.0, 1.0);
        let lambert = params.base_color * (opaque * (1.0 - passing));
        let lobes = if stacked {
            let color = finish.diffuse_transmission_color.clamp(Vec3::ZERO, Vec3::ONE);
            let coat_normal = if front == ng { finish.clearcoat_normal } else { -finish.clearcoat_normal };
            let coat_normal = if coat_normal.dot(ng) > 0.0 { coat_normal } else { ng };
            let albedos = [lambert, color * (opaque * passing)];
            Lobes::Stack(Box::new(Stack::new(params, finish, &pose, albedos, coat_normal)))
        } else {
            Lobes::Layers(Layers::new(params, &pose, lambert, NoFilm))
        };
        Bsdf { ng, ns: pose.frame[2], lambert, lobes }
    }

    /// `f·|cosθ|` of all lobes with a density, and the density with which [`Bsdf::sample`] chooses `wi`.
    #[inline]
    pub fn eval(&self, wi: Vec3) -> (Vec3, f32) {
        match &self.lobes {
            Lobes::None => self.eval_diffuse(wi),
            Lobes::Layers(layers) => layers.eval(layers.local_from_world(wi), wi.dot(self.ng), self.lambert),
            Lobes::Stack(stack) => stack.eval(wi, wi.dot(self.ng), self.lambert),
            Lobes::Coupled(coupling) => self.eval_coupled(coupling, wi),
            Lobes::Rest(rest) => rest.eval(wi),
        }
    }

    /// [`Bsdf::eval`] of a surface that [`Bsdf::is_diffuse`]: nothing but a cosine.
    #[inline]
    pub fn eval_diffuse(&self, wi: Vec3) -> (Vec3, f32) {
        let cos = wi.dot(self.ns);
        if cos <= 0.0 || wi.dot(self.ng) <= 0.0 {
            return (Vec3::ZERO, 0.0);
        }
        (self.lambert * cos, cos * FRAC_1_PI)
    }

    /// Whether there is nothing but a diffuse lobe without coat.
    #[inline]
    pub fn is_diffuse(&self) -> bool {
        matches!(self.lobes, Lobes::None)
    }

    /// Chooses a lobe by `u_lobe` and a direction in it by `u`, all uniform in [0, 1). `None` where the light is absorbed:
    /// directions on the wrong side of the geometry are, and `eval` is 0 there as well.
    pub fn sample(&self, u_lobe: f32, u: [f32; 2]) -> Option<BsdfSample> {
        let layers = match &self.lobes {
            Lobes::None => return self.sample_diffuse(u),
            Lobes::Layers(layers) => layers,
            Lobes::Stack(stack) => return self.sample_stack(stack, u_lobe, u),
            Lobes::Coupled(coupling) => return self.sample_coupled(coupling, u),
            Lobes::Rest(rest) => return rest.sample(u_lobe, u),
        };
        let (local, delta) = layers.sample(u_lobe, u)?;
        let wi = layers.world_from_local(local);
        let cos_g = wi.dot(self.ng);
        let transmitted = local.z < 0.0;
        if transmitted != (cos_g < 0.0) || cos_g == 0.0 {
            return None;
        }
        if let Some(weight) = delta {
            let kind = if local == -layers.viewer() { ScatterKind::Through } else { ScatterKind::Delta };
            return Some(BsdfSample { wi, weight, pdf: 0.0, kind, transmitted });
        }
        let (f_cos, pdf) = layers.eval(local, cos_g, self.lambert);
        (pdf > 0.0).then(|| BsdfSample { wi, weight: f_cos / pdf, pdf, kind: ScatterKind::Smooth, transmitted })
    }

    /// [`Bsdf::eval`] with the diffuse base apart.
    #[inline]
    pub fn eval_parts(&self, wi: Vec3) -> Parts {
        match &self.lobes {
            Lobes::None => {
                let (base, base_pdf) = self.eval_diffuse(wi);
                Parts { base, base_pdf, ..Parts::default() }
            }
            Lobes::Layers(layers) => layers.eval_parts(layers.local_from_world(wi), wi.dot(self.ng), self.lambert),
            Lobes::Stack(stack) => stack.eval_parts(wi, wi.dot(self.ng), self.lambert),
            Lobes::Coupled(_) => {
                let (base, base_pdf) = self.eval(wi);
                Parts { base, base_pdf, ..Parts::default() }
            }
            Lobes::Rest(_) => {
                let (coat, coat_pdf) = self.eval(wi);
                Parts { coat, coat_pdf, ..Parts::default() }
            }
        }
    }

    /// Probability that [`Bsdf::sample`] chooses the diffuse base: for numbers below it.
    fn base_probability(&self) -> f32 {
        match &self.lobes {
            Lobes::None | Lobes::Coupled(_) => 1.0,
            Lobes::Layers(layers) => layers.base_probability(),
            Lobes::Stack(stack) => stack.base_probability(),
            Lobes::Rest(_) => 0.0,
        }
    }

    /// As [`Bsdf::sample`], but of the diffuse base alone: `None` also where another lobe would have been chosen.
    pub fn sample_base(&self, u_lobe: f32, u: [f32; 2]) -> Option<BsdfSample> {
        if u_lobe >= self.base_probability() {
            return None;
        }
        let sample = self.sample(u_lobe, u)?;
        let Parts { base, base_pdf, .. } = self.eval_parts(sample.wi);
        (base_pdf > 0.0).then_some(BsdfSample { weight: base / base_pdf, pdf: base_pdf, ..sample })
    }

    /// As [`Bsdf::sample`], but of all lobes except the diffuse base: `None` also where that would have been chosen.
    pub fn sample_coat(&self, u_lobe: f32, u: [f32; 2]) -> Option<BsdfSample> {
        if u_lobe < self.base_probability() {
            return None;
        }
        let sample = self.sample(u_lobe, u)?;
        if sample.kind != ScatterKind::Smooth {
            return Some(sample);
        }
        let parts = self.eval_parts(sample.wi);
        let (weight, pdf) = (parts.coat / parts.coat_pdf, parts.coat_pdf);
        (pdf > 0.0).then_some(BsdfSample { weight, pdf, ..sample })
    }

    /// Share of uniform light that the diffuse base alone scatters towards the viewer.
    pub fn base_albedo(&self) -> Vec3 {
        let share = match &self.lobes {
            Lobes::None | Lobes::Coupled(_) | Lobes::Rest(_) => 1.0,
            Lobes::Layers(layers) => layers.base_share(),
            Lobes::Stack(stack) => stack.base_share(),
        };
        self.lambert * PI * share
    }

    fn sample_stack(&self, stack: &Stack, u_lobe: f32, u: [f32; 2]) -> Option<BsdfSample> {
        let Drawn { wi, transmitted, delta } = stack.sample(u_lobe, u)?;
        let cos_g = wi.dot(self.ng);
        if transmitted != (cos_g < 0.0) || cos_g == 0.0 {
            return None;
        }
        if let Some((weight, kind)) = delta {
            return Some(BsdfSample { wi, weight, pdf: 0.0, kind, transmitted });
        }
        let (f_cos, pdf) = stack.eval(wi, cos_g, self.lambert);
        (pdf > 0.0).then(|| BsdfSample { wi, weight: f_cos / pdf, pdf, kind: ScatterKind::Smooth, transmitted })
    }

    /// A matt white surface, both normals on the viewer's side.
    pub(crate) fn white(ng: Vec3, ns: Vec3) -> Bsdf {
        Bsdf { ng, ns, lambert: Vec3::splat(FRAC_1_PI), lobes: Lobes::None }
    }

    /// Share of uniform light that all lobes together scatter towards the viewer, if each of them is broad: then it takes
    /// little to know how much light arrives, and not from where.
    pub(crate) fn broad_albedo(&self) -> Option<Vec3> {
        let broad = match &self.lobes {
            Lobes::None => true,
            Lobes::Layers(layers) => layers.reflects_only() && layers.facet_peak() < NARROW_PEAK,
            Lobes::Stack(_) | Lobes::Coupled(_) | Lobes::Rest(_) => false,
        };
        broad.then(|| self.albedo_estimate())
    }

    /// What is sent back of light whose direction is not known.
    pub(crate) fn shares(&self) -> Shares {
        if let Some(base) = self.broad_albedo() {
            return Shares { base, narrow: Vec3::ZERO, behind: Vec3::ZERO, is_all: true };
        }
        let [narrow, behind] = match &self.lobes {
            Lobes::None | Lobes::Coupled(_) | Lobes::Rest(_) => [Vec3::ZERO; 2],
            Lobes::Layers(layers) if layers.reflects_only() => [layers.albedo(Vec3::ZERO), Vec3::ZERO],
            Lobes::Layers(_) => [Vec3::ZERO; 2],
            Lobes::Stack(stack) => stack.shares(),
        };
        Shares { base: self.base_albedo(), narrow, behind, is_all: false }
    }

    fn sample_diffuse(&self, u: [f32; 2]) -> Option<BsdfSample> {
        if self.lambert == Vec3::ZERO {
            return None;
        }
        let (tangent, bitangent) = self.ns.any_orthonormal_pair();
        let local = cosine_direction(u);
        let wi = tangent * local.x + bitangent * local.y + self.ns * local.z;
        if local.z <= 0.0 || wi.dot(self.ng) <= 0.0 {
            return None;
        }
        let (weight, pdf) = (self.lambert * PI, local.z * FRAC_1_PI);
        Some(BsdfSample { wi, weight, pdf, kind: ScatterKind::Smooth, transmitted: false })
    }

    /// Share of light that goes straight on, through a thin wall that is smooth: what a shadow ray keeps.
    pub fn straight_through(&self) -> Vec3 {
        match &self.lobes {
            Lobes::None | Lobes::Coupled(_) => Vec3::ZERO,
            Lobes::Layers(layers) => layers.straight_through(),
            Lobes::Stack(stack) => stack.straight_through(),
            Lobes::Rest(rest) => rest.whole.straight_through(),
        }
    }

    /// Share of radiance that smooth solid glass without finish lets go on in the one direction of its refraction: all other lobes
    /// are left alone.
    pub(crate) fn refracted(params: &SurfaceParams, ng: Vec3, ns: Vec3, wo: Vec3) -> Vec3 {
        let Facing { ns, eta, .. } = Facing::new(params, ng, ns, wo);
        let passing = (1.0 - params.metallic) * params.transmission;
        let solid = fresnel::Solid::new(params.ior, params.specular, params.specular_color);
        let reflected = solid.reflectance(wo.dot(turned_to_viewer(ns, wo)), eta).max_element();
        params.base_color * (passing * (1.0 - reflected)) / (eta * eta)
    }

    /// About the greatest value of `f·|cosθ|`, 1/sr: where connections may carry much.
    pub fn peak_estimate(&self) -> f32 {
        let more = match &self.lobes {
            Lobes::None | Lobes::Coupled(_) => 0.0,
            Lobes::Layers(layers) => layers.facet_peak(),
            Lobes::Stack(stack) => stack.peak(),
            Lobes::Rest(rest) => rest.whole.peak_estimate(),
        };
        self.lambert.max_element() + more
    }

    /// Whether connecting to light sources can find anything: some lobe has a density.
    #[inline]
    pub fn has_smooth_lobes(&self) -> bool {
        self.reflects() || self.transmits()
    }

    /// Whether `eval` can be nonzero on the viewer's side.
    #[inline]
    pub fn reflects(&self) -> bool {
        let more = match &self.lobes {
            Lobes::None | Lobes::Coupled(_) => false,
            Lobes::Layers(layers) => layers.reflects_broadly(),
            Lobes::Stack(stack) => stack.reflects_broadly(),
            Lobes::Rest(rest) => rest.whole.reflects(),
        };
        more || self.lambert != Vec3::ZERO
    }

    /// Whether `eval` can be nonzero on the other side.
    #[inline]
    pub fn transmits(&self) -> bool {
        match &self.lobes {
            Lobes::None | Lobes::Coupled(_) => false,
            Lobes::Layers(layers) => layers.transmits_broadly(),
            Lobes::Stack(stack) => stack.transmits_broadly(),
            Lobes::Rest(rest) => rest.whole.transmits(),
        }
    }

    /// Share of the light that is scattered towards the viewer under uniform light from everywhere: exact for a plain
    /// diffuse surface, else close.
    pub fn albedo_estimate(&self) -> Vec3 {
        let diffuse = self.lambert * PI;
        match &self.lobes {
            Lobes::None | Lobes::Coupled(_) => diffuse,
            Lobes::Layers(layers) => layers.albedo(diffuse),
            Lobes::Stack(stack) => stack.albedo(diffuse),
            Lobes::Rest(rest) => rest.whole.albedo_estimate(),
        }
    }

    /// Unit geometric normal on the viewer's side.
    #[inline]
    pub fn geometric_normal(&self) -> Vec3 {
        self.ng
    }

    /// Unit shading normal on the viewer's side.
    #[inline]
    pub fn shading_normal(&self) -> Vec3 {
        self.ns
    }
}

/// What a device looks up of coats and facets, in plain numbers: see [`energy::table`], then the factors of facets that scatter
/// light repeatedly, by roughness (24) and by cosine (32): 1 where light is scattered once.
pub(crate) fn coat_table(scattering: FacetScattering) -> Vec<f32> {
    let mut table = energy::table();
    match scattering {
        FacetScattering::Multiple => table.extend(compensation::table()),
        FacetScattering::Single => table.extend([1.0; energy::N_COS * energy::N_ROUGHNESS]),
    }
    table
}

/// Value of `f·|cosθ|`, 1/sr, from which a lobe shows a picture of what it reflects.
const NARROW_PEAK: f32 = 0.5;

/// A direction around +z with density cosθ/π.
#[inline]
pub(crate) fn cosine_direction(u: [f32; 2]) -> Vec3 {
    let (sin, cos) = (TAU * u[0]).sin_cos();
    let radius = u[1].sqrt();
    Vec3::new(radius * cos, radius * sin, (1.0 - u[1]).sqrt())
}
