//! Surfaces that only reflect, toward sixteen directions at a time.
//!
//! The same arithmetic as in `layers` and `matte`, lane by lane and without a branch, so that the compiler can use vectors.
//! Tables by the cosine of the light are mixed once for a surface, as roughness and reflectance are the same for all lanes.

use std::f32::consts::{FRAC_1_PI, PI};

use glam::Vec3;

use super::energy::N_COS;
use super::matte::{Coupling, Rest};
use super::{Bsdf, Lobes, fresnel};

/// Directions that are looked at together.
pub(crate) const LANES: usize = 16;

/// A number of each lane.
pub(crate) type Lanes = [f32; LANES];

/// Three numbers of each lane: coordinates, or red, green and blue.
pub(crate) type Vectors = [Lanes; 3];

/// A number of each channel.
type Color = [f32; 3];

/// A surface as one viewer sees it.
#[expect(clippy::large_enum_variant, reason = "it lives on the stack while one surface is lit")]
pub(crate) enum BsdfLanes {
    /// A diffuse base alone.
    Matte(Matte),
    /// With facets on it, or metal.
    Layered(Layered),
}

/// A diffuse base, and what a coat that is not there takes of the light on its way in.
pub(crate) struct Matte {
    ng: Vec3,
    ns: Vec3,
    /// Albedo over π.
    pub lambert: Vec3,
    coupling: Option<CouplingTable>,
}

/// Facets over a diffuse base, or of metal.
pub(crate) struct Layered {
    pub ng: Vec3,
    pub frame: [Vec3; 3],
    /// Towards the viewer, in that frame.
    pub wo: Vec3,
    /// Albedo of the base over π.
    pub lambert: Vec3,
    /// What the coat leaves of light for the base.
    pub table: CouplingTable,
    pub allowance_o: f32,
    /// Widths along tangent and bitangent; 1 where there are no broad facets.
    pub alpha: [f32; 2],
    /// 1, or 0 where there are no broad facets.
    pub facets: f32,
    pub lambda_o: f32,
    /// Reflectance of the facets: `coat.0 + coat.1·grazing`, and of the metal, which is compensated.
    pub coat: [Color; 2],
    pub metal: [Color; 2],
    /// Mean reflectance of the metal, and what facets that absorb nothing gain by √cosθ, this viewer's factor included.
    pub compensation: Option<(Color, [f32; N_COS])>,
    /// Probabilities of choosing the facets and the base.
    pub choice: [f32; 2],
    /// What is missing of the base, see [`Rest`]: the viewer's share, if any is.
    pub missing: f32,
}

/// What passes a coat by the cosine of the light.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CouplingTable {
    /// Mean of `1 − F(V·H)` over the diffuse lobe, by √cosθ.
    pub passed: [f32; N_COS],
    /// What the coat's own reflection leaves, by √cosθ.
    pub left: [f32; N_COS],
    /// Largest channel of the reflectance at normal incidence, and at grazing angles.
    pub f0: f32,
    pub f90: f32,
}

/// What reaches the viewer from each direction.
pub(crate) struct Scattered {
    /// `f·|cosθ|` of the diffuse base over its albedo over π.
    pub base: Lanes,
    /// `f·|cosθ|` of everything else.
    pub coat: Vectors,
    /// Densities of the two.
    pub base_pdf: Lanes,
    pub coat_pdf: Lanes,
}

impl Bsdf {
    /// The surface for [`LANES`] directions at a time; `None` if it does more than to reflect in lobes of some breadth, or has a
    /// finish. As [`Bsdf::eval_parts`], with the base of a surface without its shared part among the rest.
    pub(crate) fn lanes(&self) -> Option<BsdfLanes> {
        match &self.lobes {
            Lobes::None => Some(BsdfLanes::Matte(self.matte_lanes(None))),
            Lobes::Coupled(coupling) => Some(BsdfLanes::Matte(self.matte_lanes(Some(coupling)))),
            Lobes::Layers(layers) => layers.lanes(self.ng, self.lambert).map(BsdfLanes::Layered),
            Lobes::Rest(rest) => rest.lanes().map(BsdfLanes::Layered),
            Lobes::Stack(_) => None,
        }
    }

    fn matte_lanes(&self, coupling: Option<&Coupling>) -> Matte {
        Matte { ng: self.ng, ns: self.ns, lambert: self.lambert, coupling: coupling.map(|coupling| coupling.table()) }
    }
}

impl Rest {
    fn lanes(&self) -> Option<Layered> {
        let Lobes::Layers(layers) = &self.whole.lobes else { return None };
        let lanes = layers.lanes(self.whole.ng, self.whole.lambert)?;
        Some(Layered { missing: self.outgoing, ..lanes })
    }
}

impl Matte {
    /// `f·|cosθ|` over the albedo over π, and the cosine, 0 from behind; directions are unit vectors in world space.
    #[inline(always)]
    pub(crate) fn scattered(&self, toward: &Vectors) -> [Lanes; 2] {
        let (mut value, mut cosines) = ([0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            let cos = dot(toward, i, self.ns);
            let faces = (cos > 0.0) & (dot(toward, i, self.ng) > 0.0);
            cosines[i] = if faces { cos } else { 0.0 };
            value[i] = cosines[i];
        }
        if let Some(table) = &self.coupling {
            let [allowance, root] = table.both(&cosines);
            for i in 0..LANES {
                value[i] *= allowance[i] * root[i];
            }
        }
        [value, cosines]
    }
}

impl Layered {
    /// All lobes from each direction, unit vectors in world space.
    #[inline(always)]
    pub(crate) fn scattered(&self, toward: &Vectors) -> Scattered {
        let mut out =
            Scattered { base: [0.0; LANES], coat: [[0.0; LANES]; 3], base_pdf: [0.0; LANES], coat_pdf: [0.0; LANES] };
        let (mut up, mut grazing, mut quarter_g2) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
        let [alpha_x, alpha_y] = self.alpha;
        let (area, per_view) = (alpha_x * alpha_y, self.facets / (4.0 * self.wo.z));
        let g1 = self.choice[0] / (1.0 + self.lambda_o);
        for i in 0..LANES {
            let [x, y, z] =
                [dot(toward, i, self.frame[0]), dot(toward, i, self.frame[1]), dot(toward, i, self.frame[2])];
            let faces = (z > 0.0) & (dot(toward, i, self.ng) > 0.0);
            let (hx, hy, hz) = (x + self.wo.x, y + self.wo.y, z + self.wo.z);
            let per_length = 1.0 / (hx * hx + hy * hy + hz * hz).sqrt();
            let (hx, hy, hz) = (hx * per_length, hy * per_length, hz * per_length);
            let cos_half = self.wo.x * hx + self.wo.y * hy + self.wo.z * hz;
            let (across, along, above) = (alpha_y * hx, alpha_x * hy, area * hz);
            let spread = across * across + along * along + above * above;
            let quarter = area * area * area / (PI * spread * spread) * per_view;
            let (wide_x, wide_y) = (alpha_x * x, alpha_y * y);
            let lambda_i = 0.5 * ((1.0 + (wide_x * wide_x + wide_y * wide_y) / (z * z)).sqrt() - 1.0);
            grazing[i] = fresnel::grazing(cos_half);
            up[i] = if faces { z } else { 0.0 };
            quarter_g2[i] = if faces { quarter / (1.0 + self.lambda_o + lambda_i) } else { 0.0 };
            out.coat_pdf[i] = if faces { quarter * g1 } else { 0.0 };
            out.base_pdf[i] = up[i] * (self.choice[1] * FRAC_1_PI);
        }
        self.add_coat(&grazing, &up, &quarter_g2, &mut out.coat);
        if self.lambert != Vec3::ZERO {
            let [allowance, root] = self.table.both(&up);
            for i in 0..LANES {
                let passed = 1.0 - self.table.reflectance(grazing[i]);
                let allowed = if up[i] < self.wo.z { allowance[i] } else { self.allowance_o };
                // But for rounding what is missing is never more than there is.
                let left = passed * allowed - self.missing * allowance[i] * root[i];
                out.base[i] = if self.missing > 0.0 { left.max(0.0) } else { left } * up[i];
            }
        }
        out
    }

    /// What the facets reflect, given the rest of their lobe.
    #[inline(always)]
    fn add_coat(&self, grazing: &Lanes, up: &Lanes, quarter_g2: &Lanes, coat: &mut Vectors) {
        let mut lossless = [1.0; LANES];
        if let Some((_, factors)) = &self.compensation {
            lossless = looked_up(factors, up);
        }
        let mean = self.compensation.as_ref().map_or([0.0; 3], |(mean, _)| *mean);
        for (channel, coat) in coat.iter_mut().enumerate() {
            let [coat_0, coat_1] = [self.coat[0][channel], self.coat[1][channel]];
            let [metal_0, metal_1] = [self.metal[0][channel], self.metal[1][channel]];
            for i in 0..LANES {
                let gain = lossless[i] / (lossless[i] - mean[channel] * (lossless[i] - 1.0));
                let reflectance = coat_0 + coat_1 * grazing[i] + (metal_0 + metal_1 * grazing[i]) * gain;
                coat[i] = reflectance * quarter_g2[i];
            }
        }
    }
}

impl CouplingTable {
    /// Largest channel of what the coat reflects.
    #[inline(always)]
    fn reflectance(&self, grazing: f32) -> f32 {
        self.f0 + (self.f90 - self.f0) * grazing
    }

    /// Share of the diffuse lobe that energy allows, and what light alone knows of the rest: see [`Coupling::share`], their product.
    #[inline(always)]
    fn both(&self, cosines: &Lanes) -> [Lanes; 2] {
        let (passed, left) = (looked_up(&self.passed, cosines), looked_up(&self.left, cosines));
        let (mut allowance, mut root) = ([0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            allowance[i] = (left[i].max(0.0) / passed[i].max(1e-6)).min(1.0);
            root[i] = (1.0 - self.reflectance(fresnel::grazing(cosines[i]))).max(0.0).sqrt();
        }
        [allowance, root]
    }
}

/// A table by √cosθ at cosines from 0 to 1.
#[inline(always)]
fn looked_up(table: &[f32; N_COS], cosines: &Lanes) -> Lanes {
    let mut at = [0.0; LANES];
    for i in 0..LANES {
        at[i] = cosines[i].clamp(0.0, 1.0).sqrt() * (N_COS - 1) as f32;
    }
    let mut found = [0.0; LANES];
    for i in 0..LANES {
        let column = (at[i] as i32 as usize).min(N_COS - 2);
        found[i] = table[column] + (table[column + 1] - table[column]) * (at[i] - column as f32);
    }
    found
}

/// Of one lane with a vector.
#[inline(always)]
fn dot(vectors: &Vectors, lane: usize, other: Vec3) -> f32 {
    vectors[0][lane] * other.x + vectors[1][lane] * other.y + vectors[2][lane] * other.z
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsdf::tests::WHITE;
    use crate::bsdf::{FinishParams, SurfaceParams};
    use crate::sampler::{Sampler, uniform_sphere};
    use crate::scene::FacetScattering;

    fn surface(case: u64, wo: Vec3) -> Bsdf {
        let nth = |divisor: u64, n: u64| (case / divisor % n) as usize;
        let params = SurfaceParams {
            base_color: Vec3::new(0.9, 0.7, 0.5),
            metallic: [0.0, 1.0, 0.3][nth(1, 3)],
            roughness: [0.0, 0.2, 0.6, 1.0][nth(3, 4)],
            ior: [1.5, 2.4][nth(12, 2)],
            specular: [1.0, 0.4][nth(24, 2)],
            specular_color: Vec3::new(1.0, 0.8, 0.6),
            facet_scattering: [FacetScattering::Multiple, FacetScattering::Single][nth(48, 2)],
            ..WHITE
        };
        let anisotropy_direction = Vec3::new(1.0, 0.0, 0.3).normalize();
        let finish =
            FinishParams { anisotropy: [0.0, 0.7][nth(96, 2)], anisotropy_direction, ..FinishParams::default() };
        Bsdf::finished(&params, &finish, Vec3::Y, Vec3::new(0.2, 1.0, 0.1).normalize(), wo)
    }

    fn upper(sampler: &mut Sampler) -> Vec3 {
        let direction = uniform_sphere(sampler.next_2d());
        Vec3::new(direction.x, direction.y.abs(), direction.z)
    }

    /// Of one surface toward some directions: value and densities are those of single directions.
    fn check(bsdf: &Bsdf, directions: &[Vec3; LANES], what: &str) {
        let toward = [0, 1, 2].map(|axis| directions.map(|direction| direction[axis]));
        let lanes = bsdf.lanes().expect("it only reflects");
        for (lane, wi) in directions.iter().enumerate() {
            let (f_cos, pdf) = bsdf.eval(*wi);
            let (value, coat, densities) = match &lanes {
                BsdfLanes::Matte(matte) => {
                    let [value, cosines] = matte.scattered(&toward);
                    (matte.lambert * value[lane], Vec3::ZERO, [cosines[lane] * FRAC_1_PI, 0.0])
                }
                BsdfLanes::Layered(layered) => {
                    let Scattered { base, coat, base_pdf, coat_pdf } = layered.scattered(&toward);
                    let coat = Vec3::from(coat.map(|channel| channel[lane]));
                    (layered.lambert * base[lane] + coat, coat, [base_pdf[lane], coat_pdf[lane]])
                }
            };
            let close = |a: f32, b: f32| (a - b).abs() <= 2e-4 * a.abs().max(b.abs()) + 1e-6;
            let all_close = |a: Vec3, b: Vec3| (0..3).all(|channel| close(a[channel], b[channel]));
            assert!(all_close(value, f_cos), "{what}, {wi}: {value} is not {f_cos}");
            assert!(close(densities[0] + densities[1], pdf), "{what}, {wi}: {densities:?} is not {pdf}");
            if !matches!(bsdf.lobes, Lobes::Rest(_)) {
                let parts = bsdf.eval_parts(*wi);
                assert!(all_close(coat, parts.coat) && close(densities[1], parts.coat_pdf), "{what}, {wi}");
            }
        }
    }

    #[test]
    fn many_directions_at_once_are_as_single_ones() {
        let mut n_parts = 0;
        for case in 0..192 {
            for turn in 0..8 {
                let mut sampler = Sampler::new(5, case, turn);
                let wo = upper(&mut sampler);
                let whole = surface(case, wo);
                // Some from below, and some near the mirror direction, where narrow lobes are.
                let mirror = whole.shading_normal() * (2.0 * whole.shading_normal().dot(wo)) - wo;
                let directions = std::array::from_fn(|lane| match lane % 4 {
                    0 => uniform_sphere(sampler.next_2d()),
                    1 => (mirror + uniform_sphere(sampler.next_2d()) * 0.1).normalize(),
                    _ => upper(&mut sampler),
                });
                check(&whole, &directions, &format!("case {case}"));
                let Some(matte) = whole.matte() else { continue };
                check(&matte, &directions, &format!("matte part of case {case}"));
                if let Some(rest) = whole.without(&matte, wo).filter(|_| matte.seen_share(wo) > 0.0) {
                    check(&rest, &directions, &format!("rest of case {case}"));
                    n_parts += 1;
                }
            }
        }
        assert!(n_parts > 100, "only {n_parts} surfaces had a part for all viewers");
    }

    #[test]
    fn what_lets_light_pass_is_looked_at_from_one_direction_at_a_time() {
        let glass = SurfaceParams { roughness: 0.3, transmission: 1.0, thickness: 1.0, ..WHITE };
        assert!(Bsdf::new(&glass, Vec3::Y, Vec3::Y, Vec3::Y).lanes().is_none());
    }
}
