//! A layer of lacquer over everything else: KHR_materials_clearcoat.
//!
//! A GGX lobe of index 1.5 with a normal of its own. What lies below is multiplied by what the coat's own reflection
//! leaves of the light, in the direction where that is less: so no light is made, and reciprocity holds. The extension
//! multiplies by `1 − c·F(N·V)`, of which this is the mean over the coat's facets.

use glam::Vec3;

use super::energy::Coat;
use super::fresnel::{Schlick, grazing};
use super::ggx::Ggx;
use super::layers::is_mirror;
use super::pose::turned_to_viewer;

/// Reflectance of index 1.5.
const LACQUER: Schlick = Schlick { f0: Vec3::splat(0.04), f90: 1.0 };

/// A clear coat as one viewer sees it.
#[derive(Clone, Copy, Debug)]
pub(super) struct ClearCoat {
    /// 0 … 1.
    strength: f32,
    frame: [Vec3; 3],
    wo: Vec3,
    /// `None` for a mirror.
    facets: Option<Ggx>,
    lambda_o: f32,
    coat: Coat,
    albedo_o: f32,
}

impl ClearCoat {
    /// `normal` is the coat's own, on the viewer's side.
    pub(super) fn new(strength: f32, roughness: f32, normal: Vec3, wo: Vec3) -> ClearCoat {
        let normal = turned_to_viewer(normal, wo);
        let (tangent, bitangent) = normal.any_orthonormal_pair();
        let alpha = if is_mirror(roughness) { 0.0 } else { roughness * roughness };
        let facets = (alpha > 0.0).then(|| Ggx::round(alpha));
        let wo = Vec3::new(wo.dot(tangent), wo.dot(bitangent), wo.dot(normal));
        let coat = Coat::new(alpha, LACQUER.f0.x, LACQUER.f90);
        let mut clear = ClearCoat {
            strength,
            frame: [tangent, bitangent, normal],
            wo,
            facets,
            lambda_o: facets.map_or(0.0, |ggx| ggx.lambda(wo)),
            coat,
            albedo_o: 0.0,
        };
        clear.albedo_o = clear.full_albedo(wo.z);
        clear
    }

    /// `f·|cosθ|` and density of a world direction on the viewer's side of the geometry.
    pub(super) fn eval(&self, wi: Vec3) -> (f32, f32) {
        let [x, y, z] = self.frame;
        let wi = Vec3::new(wi.dot(x), wi.dot(y), wi.dot(z));
        let Some(ggx) = self.facets.filter(|_| wi.z > 0.0) else { return (0.0, 0.0) };
        let wm = (wi + self.wo).normalize();
        let quarter = ggx.d(wm) / (4.0 * self.wo.z);
        let shadowed = quarter / (1.0 + self.lambda_o + ggx.lambda(wi));
        (self.reflectance(self.wo.dot(wm)) * shadowed, quarter / (1.0 + self.lambda_o))
    }

    /// The mirrored world direction and the share that it carries, if the coat is a mirror.
    pub(super) fn delta(&self) -> Option<(Vec3, f32)> {
        if self.facets.is_some() {
            return None;
        }
        self.sample([0.0; 2]).and_then(|(wi, share)| Some((wi, share?)))
    }

    /// A world direction, with the share that it reflects if the coat is a mirror.
    pub(super) fn sample(&self, u: [f32; 2]) -> Option<(Vec3, Option<f32>)> {
        let [x, y, z] = self.frame;
        let world = |w: Vec3| x * w.x + y * w.y + z * w.z;
        let Some(ggx) = self.facets else {
            let mirrored = Vec3::new(-self.wo.x, -self.wo.y, self.wo.z);
            return Some((world(mirrored), Some(self.reflectance(self.wo.z))));
        };
        let wm = ggx.sample(self.wo, u);
        let wi = wm * (2.0 * self.wo.dot(wm)) - self.wo;
        (wi.z > 0.0).then(|| (world(wi), None))
    }

    /// Share of uniform light that the coat sends to the viewer.
    pub(super) fn albedo(&self) -> f32 {
        self.strength * self.albedo_o
    }

    /// Share of the light from a world direction, of either side, that gets to what lies below and from there to the
    /// viewer.
    pub(super) fn passed(&self, wi: Vec3) -> f32 {
        1.0 - self.strength * self.albedo_o.max(self.full_albedo(wi.dot(self.frame[2]).abs()))
    }

    /// Whether it has a density.
    pub(super) fn is_rough(&self) -> bool {
        self.facets.is_some()
    }

    /// Whether it has a density, of a width of at most `alpha`.
    pub(super) fn is_narrow(&self, alpha: f32) -> bool {
        self.facets.is_some_and(|ggx| ggx.widest() <= alpha)
    }

    /// About the greatest `f·|cosθ|`.
    pub(super) fn peak(&self) -> f32 {
        let facing = |ggx: Ggx| ggx.d(Vec3::Z) / (4.0 * self.wo.z * (1.0 + 2.0 * self.lambda_o));
        self.reflectance(self.wo.z) * self.facets.map_or(0.0, facing)
    }

    fn reflectance(&self, cos: f32) -> f32 {
        self.strength * LACQUER.at(grazing(cos)).x
    }

    fn full_albedo(&self, cos: f32) -> f32 {
        let [per_f0, per_f90] = self.coat.albedo(cos);
        LACQUER.f0.x * per_f0 + LACQUER.f90 * per_f90
    }
}
