//! Emissive triangles as a light to connect to: a point of them, its normal and its radiance.

use glam::{DVec3, Vec2, Vec3};

use super::{Plate, share_of};
use crate::scene::{AlphaMode, Material, Scene};

/// Emissive triangles of one node.
#[derive(Clone, Debug)]
pub struct SurfaceEmitter {
    /// Its triangles.
    pub triangles: Vec<ShiningTriangle>,
    /// Total area, m².
    pub area: f32,
    /// The same, as summed.
    total: f64,
    /// Radiance without texture of its brightest material, channel by channel.
    brightest: Vec3,
}

/// A triangle that shines, with what sampling it takes.
#[derive(Clone, Debug)]
pub struct ShiningTriangle {
    /// Triangle of the mesh.
    pub triangle: u32,
    corner: Vec3,
    edges: [Vec3; 2],
    /// Unit normal of the front side.
    normal: Vec3,
    double_sided: bool,
    /// The white column's radiance, but for its texture and alpha.
    white: Vec3,
    /// Whether it has one of them.
    varies: bool,
    /// Area of all triangles before it, m². In single precision small ones would round away beside a large one.
    area_before: f64,
    /// One over its own area, 1/m².
    per_area: f32,
}

/// Squared distance over the area, and of unit normals, up to which two triangles are taken for the halves of a
/// parallelogram: what rounding does to their corners.
const FLAT: f32 = 1e-10;

impl ShiningTriangle {
    /// Its share of the white column's radiance, but for its texture.
    pub(crate) fn white(&self) -> Vec3 {
        self.white
    }

    fn corners(&self) -> [Vec3; 3] {
        [self.corner, self.corner + self.edges[0], self.corner + self.edges[1]]
    }
}

/// A point of a surface that shines.
pub(crate) struct SurfacePoint {
    pub position: Vec3,
    /// Unit normal of the front side.
    pub normal: Vec3,
    pub double_sided: bool,
    /// The white column's radiance, but for texture and alpha.
    pub white: Vec3,
    /// Whether texture or alpha multiplies it: [`crate::prepared::PreparedScene::shown`] of `triangle` and `barycentric`.
    pub varies: bool,
    pub triangle: u32,
    pub barycentric: Vec3,
}

impl SurfaceEmitter {
    /// `brightest` as the field says.
    pub(crate) fn new(scene: &Scene, triangles: &[u32], brightest: Vec3) -> SurfaceEmitter {
        let mut total = 0.0;
        let shining = |&triangle: &u32| {
            let [a, b, c] = scene.mesh.corners(triangle);
            let normal = (b - a).cross(c - a);
            let (area_before, own) = (total, 0.5 * normal.length());
            total += f64::from(own);
            let material: &Material = &scene.materials[scene.mesh.triangle_material[triangle as usize] as usize];
            ShiningTriangle {
                triangle,
                corner: a,
                edges: [b - a, c - a],
                normal: normal.normalize_or(Vec3::Y),
                double_sided: material.double_sided,
                white: share_of(material.emitted_radiance(), brightest),
                varies: material.emissive_texture.is_some() || material.alpha != AlphaMode::Opaque,
                area_before,
                per_area: 1.0 / own.max(f32::MIN_POSITIVE),
            }
        };
        let triangles = triangles.iter().map(shining).collect();
        SurfaceEmitter { triangles, area: total as f32, total, brightest }
    }

    /// The white column's radiance from one of its materials, but for the texture.
    pub(crate) fn white(&self, material: &Material) -> Vec3 {
        share_of(material.emitted_radiance(), self.brightest)
    }

    /// A point with uniform density over the area, for `u` uniform in [0, 1)².
    #[inline]
    pub(crate) fn sample(&self, u: Vec2) -> SurfacePoint {
        let at = f64::from(u.x) * self.total;
        let nth = self.triangles.partition_point(|t| t.area_before <= at).max(1) - 1;
        let chosen = &self.triangles[nth];
        let along = (at - chosen.area_before) as f32 * chosen.per_area;
        let barycentric = barycentric_of([along.clamp(0.0, 1.0), u.y]);
        SurfacePoint {
            position: chosen.corner + chosen.edges[0] * barycentric.y + chosen.edges[1] * barycentric.z,
            normal: chosen.normal,
            double_sided: chosen.double_sided,
            white: chosen.white,
            varies: chosen.varies,
            triangle: chosen.triangle,
            barycentric,
        }
    }

    /// All of it, if it is one flat parallelogram without texture and alpha.
    pub(crate) fn plate(&self) -> Option<Plate> {
        let [first, second] = self.triangles.as_slice() else { return None };
        let alike = first.white == second.white && first.double_sided == second.double_sided;
        if !alike || first.varies || second.varies || first.normal.distance_squared(second.normal) > FLAT {
            return None;
        }
        let (corners, others) = (first.corners(), second.corners());
        let near = |a: Vec3, b: Vec3| a.distance_squared(b) <= FLAT * self.area;
        // The corner that the second triangle does not have, and the two beside it.
        let alone = (0..3).find(|&i| !others.iter().any(|&other| near(corners[i], other)))?;
        let [corner, next, last] = [0, 1, 2].map(|step| corners[(alone + step) % 3]);
        let edges = [next - corner, last - corner];
        let is_whole = [next, last, next + edges[1]].iter().all(|&c| others.iter().any(|&other| near(c, other)));
        let (normal, double_sided) = (first.normal, first.double_sided);
        is_whole.then_some(Plate { corner, edges, normal, area: self.area, double_sided, white: first.white })
    }

    /// Whether something holds of a corner, the unit normal and the double-sidedness of each of its triangles.
    pub(crate) fn all_triangles(&self, mut holds: impl FnMut(Vec3, Vec3, bool) -> bool) -> bool {
        self.triangles.iter().all(|t| holds(t.corner, t.normal, t.double_sided))
    }

    /// All corners of its triangles.
    pub(crate) fn corners(&self) -> impl Iterator<Item = Vec3> {
        self.triangles.iter().flat_map(ShiningTriangle::corners)
    }

    /// The middle of its triangles, each weighed by its area.
    pub(crate) fn center(&self) -> Vec3 {
        let weighed = |t: &ShiningTriangle| ((t.corner + (t.edges[0] + t.edges[1]) / 3.0) / t.per_area).as_dvec3();
        (self.triangles.iter().map(weighed).sum::<DVec3>() / self.total.max(f64::MIN_POSITIVE)).as_vec3()
    }
}

/// The unit square folded onto a triangle, evenly. \[Heitz2019\]
#[inline]
fn barycentric_of([x, y]: [f32; 2]) -> Vec3 {
    let [x, y] = if y > x { [0.5 * x, y - 0.5 * x] } else { [x - 0.5 * y, 0.5 * y] };
    Vec3::new(1.0 - x - y, x, y)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::sampler::Sampler;
    use crate::scene::Mesh;

    fn emitter(corners: &[[Vec3; 3]]) -> SurfaceEmitter {
        let mesh = Mesh {
            positions: corners.concat(),
            triangles: (0..corners.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
            triangle_material: vec![0; corners.len()],
            ..Mesh::default()
        };
        let material = Material { emissive: Vec3::ONE, ..Material::default() };
        let scene = Scene { mesh, materials: vec![material], ..Scene::default() };
        let triangles: Vec<u32> = (0..corners.len() as u32).collect();
        SurfaceEmitter::new(&scene, &triangles, Vec3::ONE)
    }

    #[test]
    fn two_halves_of_a_parallelogram_are_a_plate_and_nothing_else_is() {
        let [a, b, c, d] = [Vec3::ZERO, Vec3::X * 2.0, Vec3::new(3.0, 0.0, 1.0), Vec3::new(1.0, 0.0, 1.0)];
        for halves in [[[a, b, c], [a, c, d]], [[c, a, b], [d, a, c]], [[b, d, a], [d, b, c]], [[d, a, b], [c, d, b]]] {
            let plate = emitter(&halves).plate().expect("a parallelogram");
            let corner = |u, v| plate.corner + plate.edges[0] * u + plate.edges[1] * v;
            let corners = [corner(0.0, 0.0), corner(1.0, 0.0), corner(0.0, 1.0), corner(1.0, 1.0)];
            assert!([a, b, c, d].iter().all(|p| corners.iter().any(|q| p.distance(*q) < 1e-6)), "{plate:?}");
            assert!((plate.area - 2.0).abs() < 1e-6 && plate.normal.y.abs() > 0.999, "{plate:?}");
        }
        let (lifted, far) = (d + Vec3::Y * 0.1, d + Vec3::X * 0.1);
        assert!(emitter(&[[a, b, c], [a, c, lifted]]).plate().is_none(), "bent");
        assert!(emitter(&[[a, b, c], [a, c, far]]).plate().is_none(), "no parallelogram");
        assert!(emitter(&[[a, b, c], [a, b, c]]).plate().is_none(), "the same triangle twice");
        assert!(emitter(&[[a, b, c]]).plate().is_none(), "a single triangle");
    }

    #[test]
    fn a_million_small_triangles_are_as_large_as_all_of_them() {
        let (n, side) = (1 << 20, 4.4721e-4);
        let own = [Vec3::ZERO, Vec3::X * side, Vec3::Y * side];
        let mut corners = vec![own; n];
        let all = n as f32 * 0.5 * side * side;
        let area = emitter(&corners).area;
        assert!((area / all - 1.0).abs() < 1e-4, "{area} of {all}");
        // Behind a large one each random number finds one of its own.
        corners[0] = own.map(|corner| corner * 1e4);
        let behind = emitter(&corners);
        let sample = |i: u32| behind.sample(Vec2::new(1.0 - i as f32 / (1 << 24) as f32, 0.5)).triangle;
        let found: BTreeSet<u32> = (0..1 << 14).map(sample).collect();
        assert!(found.len() > 16_000, "{} of 16384", found.len());
    }

    #[test]
    fn points_fill_the_parts_of_a_triangle_by_their_area() {
        let n = 4096;
        let points = || (0..n).map(|i| barycentric_of(Sampler::new(4, 2, i).next_2d()));
        assert!(points().all(|w| w.min_element() >= -1e-6 && (w.element_sum() - 1.0).abs() < 1e-6));
        // Each corner's own quarter, where its weight is above a half.
        for corner in 0..3 {
            let count = points().filter(|w| w[corner] > 0.5).count();
            assert!((count as f32 / n as f32 - 0.25).abs() < 0.01, "corner {corner}: {count} of {n}");
        }
        let mean: Vec3 = points().sum::<Vec3>() / n as f32;
        assert!((mean - Vec3::splat(1.0 / 3.0)).abs().max_element() < 2e-3, "{mean}");
    }
}
