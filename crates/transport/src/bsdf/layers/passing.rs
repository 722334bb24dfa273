//! What passes: thin walls, refraction by facets and by smooth solids, and what rough solids scatter repeatedly.

use std::f32::consts::FRAC_1_PI;

use glam::Vec3;

use super::super::compensation::Side;
use super::super::cosine_direction;
use super::super::film::Film;
use super::{Behind, Layers, mean};

impl<F: Film> Layers<F> {
    /// Share of light that a facet lets pass.
    #[inline]
    pub(super) fn transmittance(&self, cos: f32) -> Vec3 {
        if self.passing <= 0.0 {
            return Vec3::ZERO;
        }
        self.base_color * (self.passing * (1.0 - self.passing_reflectance(cos).max_element()))
    }

    /// Share of light that goes straight on, through a thin wall that is smooth.
    pub(in super::super) fn straight_through(&self) -> Vec3 {
        let clear = matches!(self.behind, Behind::ThinWall) && self.choice.clear > 0.0;
        if clear { self.transmittance(self.wo.z) } else { Vec3::ZERO }
    }

    /// A thin wall lets a facet's light out as if mirrored to the other side.
    pub(super) fn eval_thin(&self, wi: Vec3) -> (Vec3, f32) {
        let mirrored = Vec3::new(wi.x, wi.y, -wi.z);
        let wm = (mirrored + self.wo).normalize();
        let cos_half = self.wo.dot(wm);
        let quarter = self.ggx.d(wm) / (4.0 * self.wo.z);
        let more = self.compensation.map_or(1.0, |more| more.lossless(mirrored.z));
        let value = self.transmittance(cos_half) * (quarter * self.g2(mirrored) * more);
        let passed = 1.0 - self.reflect_probability(cos_half);
        (value, self.choice.facets * passed * quarter * self.g1())
    }

    /// Refraction by facets \[Walter2007, eq. 21\], as radiance: squeezed by η² where it entered the denser side.
    pub(super) fn eval_refraction(&self, wi: Vec3, eta: f32) -> (Vec3, f32) {
        let Some(wm) = (wi * eta + self.wo).try_normalize() else { return (Vec3::ZERO, 0.0) };
        let wm = if wm.z < 0.0 { -wm } else { wm };
        let (cos_o, cos_i) = (self.wo.dot(wm), wi.dot(wm));
        // A facet refracts from its front to its back.
        if cos_o <= 0.0 || cos_i >= 0.0 {
            return (Vec3::ZERO, 0.0);
        }
        let root = cos_i + cos_o / eta;
        let jacobian = -cos_i / (root * root);
        let density = self.ggx.d(wm) * cos_o / self.wo.z * jacobian;
        let value = self.transmittance(cos_o) * (density * self.g2(wi) / (eta * eta));
        let passed = 1.0 - self.reflect_probability(cos_o);
        (value, self.choice.facets * passed * density * self.g1())
    }

    /// What the facets of a rough solid scatter repeatedly, of light from either side.
    pub(super) fn eval_repeated(&self, wi: Vec3) -> (Vec3, f32) {
        let (Some(repeated), Behind::Solid { eta, .. }) = (&self.repeated, self.behind) else {
            return (Vec3::ZERO, 0.0);
        };
        let pdf = self.choice.repeated * wi.z.abs() * FRAC_1_PI;
        let near = self.repeated_near_probability();
        if wi.z > 0.0 {
            return (Vec3::splat(self.passing * repeated.eval(wi.z, Side::Near)), pdf * near);
        }
        let value = self.base_color * (self.passing * repeated.eval(-wi.z, Side::Far) / (eta * eta));
        (value, pdf * (1.0 - near))
    }

    pub(super) fn sample_repeated(&self, u_side: f32, u: [f32; 2]) -> Option<Vec3> {
        let wi = cosine_direction(u);
        let wi = if u_side < self.repeated_near_probability() { wi } else { -wi };
        (wi.z != 0.0).then_some(wi)
    }

    /// Mean share of light from everywhere that comes back in this way.
    pub(super) fn repeated_albedo(&self) -> f32 {
        let Some(repeated) = &self.repeated else { return 0.0 };
        let tinted = repeated.share(Side::Near) + repeated.share(Side::Far) * mean(self.base_color);
        self.passing * repeated.albedo() * tinted
    }

    /// Probability that a repeatedly scattered direction is looked for on the viewer's side.
    fn repeated_near_probability(&self) -> f32 {
        let Some(repeated) = &self.repeated else { return 1.0 };
        let [near, far] = [repeated.share(Side::Near), repeated.share(Side::Far) * mean(self.base_color)];
        if near + far > 0.0 { near / (near + far) } else { 1.0 }
    }
}
