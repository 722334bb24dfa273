//! A point that a pixel sees, in 64 bytes.

use glam::{Vec2, Vec3};
use half::f16;

use crate::bsdf::{Bsdf, Schlick, SurfaceParams};
use crate::clearance::{offset_origin, shortening};
use crate::prepared::{Appearance, PreparedScene, SurfaceHit};
use crate::scene::Material;

/// Where the light of a pixel, or of a share of it, was scattered last.
#[derive(Clone, Copy, Debug)]
pub(super) struct Point {
    pub position: Vec3,
    /// See [`SurfaceHit::clearance`].
    clearance: f32,
    /// What multiplies the radiance that leaves it towards the viewer.
    pub throughput: Vec3,
    /// Place in the film, row-major.
    pub pixel: u32,
    /// Towards the viewer.
    wo: Octahedral,
    /// Geometric and shading normals on the viewer's side.
    ng: Octahedral,
    ns: Octahedral,
    /// Base color, metallic, roughness, transmission and specular strength, each of 65535; [`INSIDE`], and from the next bit on how many
    /// slabs light from a lamp may pass.
    surface: [u16; 8],
    /// Index of a material, or of a [`Special`] from [`SPECIAL`] on.
    material: u32,
}

/// What does not fit into a point.
#[derive(Clone, Debug)]
pub(super) struct Special {
    /// Scattering as a whole.
    bsdf: Bsdf,
    /// Extinction on the viewer's side and on the other one, 1/m.
    extinction: [Vec3; 2],
}

impl Special {
    /// Extinction on the way in a direction, given the normal on the viewer's side, 1/m.
    pub fn extinction_towards(&self, ng: Vec3, wi: Vec3) -> Vec3 {
        self.extinction[usize::from(wi.dot(ng) <= 0.0)]
    }
}

/// Seen from the back of its triangle.
const INSIDE: u16 = 1;
/// First number that means a special.
const SPECIAL: u32 = 1 << 31;

impl Point {
    /// `extinction` as in [`Special`].
    pub fn new(
        scene: &PreparedScene,
        (hit, looks, bsdf): (&SurfaceHit, &Appearance, &Bsdf),
        wo: Vec3,
        (pixel, throughput, most_slabs): (u32, Vec3, usize),
        extinction: [Vec3; 2],
        specials: &mut Vec<Special>,
    ) -> Point {
        let params = &looks.params;
        let material_idx = scene.scene.mesh.triangle_material[hit.triangle as usize];
        let material = &scene.scene.materials[material_idx as usize];
        let fits = looks.finish.is_none() && material.specular_color_texture.is_none() && extinction == [Vec3::ZERO; 2];
        let material = if fits {
            material_idx
        } else {
            specials.push(Special { bsdf: bsdf.clone(), extinction });
            SPECIAL + specials.len() as u32 - 1
        };
        let inside = hit.normal.dot(wo) < 0.0;
        let side = |normal: Vec3| Octahedral::new(if inside { -normal } else { normal });
        let [r, g, b] = params.base_color.to_array().map(unit_u16);
        let [metallic, roughness, transmission, specular] =
            [params.metallic, params.roughness, params.transmission, params.specular].map(unit_u16);
        let more = (most_slabs as u16) << 1 | if inside { INSIDE } else { 0 };
        Point {
            position: hit.position,
            clearance: hit.clearance,
            throughput,
            pixel,
            wo: Octahedral::new(wo),
            ng: side(hit.normal),
            ns: side(looks.ns),
            surface: [r, g, b, metallic, roughness, transmission, specular, more],
            material,
        }
    }

    /// Its special, if it has one.
    pub fn special<'a>(&self, specials: &'a [Special]) -> Option<&'a Special> {
        self.material.checked_sub(SPECIAL).map(|nth| &specials[nth as usize])
    }

    /// Unit geometric normal on the viewer's side.
    #[inline]
    pub fn normal(&self) -> Vec3 {
        self.ng.unit()
    }

    /// Whether light from behind the surface may come through.
    #[inline]
    pub fn may_transmit(&self) -> bool {
        self.surface[5] != 0 || self.material >= SPECIAL
    }

    /// Most slabs that light from a lamp may pass, which count as bounces.
    #[inline]
    pub fn most_slabs(&self) -> usize {
        usize::from(self.surface[7] >> 1)
    }

    /// Whether light from a direction may come to the viewer, given its normal.
    #[inline]
    pub fn may_send(&self, ng: Vec3, wi: Vec3) -> bool {
        wi.dot(ng) > 0.0 || self.may_transmit()
    }

    /// Share of the light from a direction that the viewer gets, `f·|cosθ|`, given its normal.
    #[inline]
    pub fn lit(&self, scene: &PreparedScene, specials: &[Special], ng: Vec3, wi: Vec3) -> Vec3 {
        if let Some(special) = self.special(specials) {
            return special.bsdf.eval(wi).0;
        }
        let params = self.params(&scene.scene.materials[self.material as usize]);
        let mut wo = self.wo.unit();
        // Rounding must not bring the viewer to the other side.
        let above = wo.dot(ng);
        if above <= GRAZING {
            wo = (wo + ng * (GRAZING - above)).normalize();
        }
        let inside = if self.surface[7] & INSIDE == 0 { 1.0 } else { -1.0 };
        Bsdf::to_be_lit(&params, ng * inside, self.ns.unit() * inside, wo).eval(wi).0
    }

    /// Where rays begin that leave to the side of a normal.
    #[inline]
    pub fn origin(&self, scene: &PreparedScene, normal: Vec3) -> Vec3 {
        offset_origin(self.position + normal * self.clearance, normal, scene.extent())
    }

    /// For a device: `group` and `nth` tell which point of a lamp it is lit from. Points of which a device knows too little are marked as
    /// the CPU's.
    pub fn words(&self, scene: &PreparedScene, group: u32, nth: u32) -> [[u32; 4]; 4] {
        let ng = self.normal();
        let origin = self.origin(scene, ng);
        let is_left = self.may_transmit() || shortening(origin, scene.extent()) > 0.0;
        let number = (self.most_slabs() as u32) << 12 | (group & 15) << 8 | (nth & 15) << 4 | u32::from(is_left);
        let Vec3 { x, y, z } = self.throughput;
        let [x, y, z] = [x, y, z].map(f32::to_bits);
        let mut looks = [[0; 4]; 2];
        if !is_left {
            let material = &scene.scene.materials[self.material as usize];
            let params = self.params(material);
            let coat = Schlick::dielectric(params.ior, params.specular, params.specular_color);
            let [r, g, b, metallic, roughness, ..] = self.surface;
            looks = [
                [self.wo.word(), pair([r, g]), pair([b, metallic]), u32::from(roughness)],
                [halves([coat.f0.x, coat.f0.y]), halves([coat.f0.z, coat.f90]), 0, self.ns.word()],
            ];
        }
        let place = origin.to_array().map(f32::to_bits);
        [[place[0], place[1], place[2], x], [y, z, number, self.ng.word()], looks[0], looks[1]]
    }

    fn params(&self, material: &Material) -> SurfaceParams {
        let [r, g, b, metallic, roughness, transmission, specular, _] = self.surface.map(|x| f32::from(x) / 65_535.0);
        SurfaceParams {
            base_color: Vec3::new(r, g, b),
            metallic,
            roughness,
            transmission,
            ior: material.ior,
            specular,
            specular_color: material.specular_color,
            thickness: material.thickness,
            facet_scattering: material.facet_scattering,
        }
    }
}

/// Least cosine of a viewer that is kept.
const GRAZING: f32 = 1e-4;

/// Two numbers in one word, the first one low.
fn pair([low, high]: [u16; 2]) -> u32 {
    u32::from(low) | u32::from(high) << 16
}

fn halves(numbers: [f32; 2]) -> u32 {
    pair(numbers.map(|number| f16::from_f32(number).to_bits()))
}

fn unit_u16(x: f32) -> u16 {
    (x.clamp(0.0, 1.0) * 65_535.0).round() as u16
}

/// A unit vector as a point of an octahedron that is folded onto a square. \[Cigolle2014\]
#[derive(Clone, Copy, Debug)]
struct Octahedral([i16; 2]);

impl Octahedral {
    /// Both coordinates in one word, the first one low.
    fn word(self) -> u32 {
        pair(self.0.map(|coordinate| coordinate as u16))
    }

    fn new(v: Vec3) -> Octahedral {
        let p = Vec2::new(v.x, v.y) / (v.x.abs() + v.y.abs() + v.z.abs());
        let p = if v.z < 0.0 { fold(p) } else { p };
        Octahedral([p.x, p.y].map(|x| (x.clamp(-1.0, 1.0) * 32_767.0).round() as i16))
    }

    #[inline]
    fn unit(self) -> Vec3 {
        let p = Vec2::new(f32::from(self.0[0]), f32::from(self.0[1])) / 32_767.0;
        let z = 1.0 - p.x.abs() - p.y.abs();
        let p = if z < 0.0 { fold(p) } else { p };
        Vec3::new(p.x, p.y, z).normalize()
    }
}

/// Turns the outer triangles of the square in, and back out.
#[inline]
fn fold(p: Vec2) -> Vec2 {
    Vec2::new((1.0 - p.y.abs()).copysign(p.x), (1.0 - p.x.abs()).copysign(p.y))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampler::{Sampler, uniform_sphere};

    #[test]
    fn a_point_takes_64_bytes() {
        assert_eq!(size_of::<Point>(), 64);
    }

    #[test]
    fn unit_vectors_come_back_within_a_few_hundred_thousandths() {
        let axes = Vec3::AXES.into_iter().flat_map(|axis| [axis, -axis]);
        let random = (0..5000).map(|i| uniform_sphere(Sampler::new(1, i, 0).next_2d()));
        for v in axes.chain(random) {
            let back = Octahedral::new(v).unit();
            assert!(back.distance(v) < 7e-5, "{v} came back as {back}");
        }
    }
}
