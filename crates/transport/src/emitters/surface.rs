//! Emissive triangles as a light to connect to: a point of them, its normal and its radiance.

use glam::{Vec2, Vec3};

use super::share_of;
use crate::scene::{Material, Scene};

/// Emissive triangles of one node.
#[derive(Clone, Debug)]
pub struct SurfaceEmitter {
    /// Its triangles.
    pub triangles: Vec<ShiningTriangle>,
    /// Total area, m².
    pub area: f32,
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
    /// The white column's radiance, but for its texture.
    white: Vec3,
    textured: bool,
    /// Area of all triangles before it, m².
    area_before: f32,
    /// One over its own area, 1/m².
    per_area: f32,
}

/// A point of a surface that shines.
pub(crate) struct SurfacePoint {
    pub position: Vec3,
    /// Unit normal of the front side.
    pub normal: Vec3,
    pub double_sided: bool,
    /// The white column's radiance, but for the texture.
    pub white: Vec3,
    /// Whether a texture multiplies it: see `triangle` and `barycentric`.
    pub textured: bool,
    pub triangle: u32,
    pub barycentric: Vec3,
}

impl SurfaceEmitter {
    /// `brightest` as the field says.
    pub(crate) fn new(scene: &Scene, triangles: &[u32], brightest: Vec3) -> SurfaceEmitter {
        let mut area = 0.0;
        let shining = |&triangle: &u32| {
            let [a, b, c] = scene.mesh.corners(triangle);
            let normal = (b - a).cross(c - a);
            let (area_before, own) = (area, 0.5 * normal.length());
            area += own;
            let material: &Material = &scene.materials[scene.mesh.triangle_material[triangle as usize] as usize];
            ShiningTriangle {
                triangle,
                corner: a,
                edges: [b - a, c - a],
                normal: normal.normalize_or(Vec3::Y),
                double_sided: material.double_sided,
                white: share_of(material.emitted_radiance(), brightest),
                textured: material.emissive_texture.is_some(),
                area_before,
                per_area: 1.0 / own.max(f32::MIN_POSITIVE),
            }
        };
        let triangles = triangles.iter().map(shining).collect();
        SurfaceEmitter { triangles, area, brightest }
    }

    /// The white column's radiance from one of its materials, but for the texture.
    pub(crate) fn white(&self, material: &Material) -> Vec3 {
        share_of(material.emitted_radiance(), self.brightest)
    }

    /// A point with uniform density over the area, for `u` uniform in [0, 1)².
    #[inline]
    pub(crate) fn sample(&self, u: Vec2) -> SurfacePoint {
        let at = u.x * self.area;
        let nth = self.triangles.partition_point(|t| t.area_before <= at).max(1) - 1;
        let chosen = &self.triangles[nth];
        let barycentric = barycentric_of([((at - chosen.area_before) * chosen.per_area).clamp(0.0, 1.0), u.y]);
        SurfacePoint {
            position: chosen.corner + chosen.edges[0] * barycentric.y + chosen.edges[1] * barycentric.z,
            normal: chosen.normal,
            double_sided: chosen.double_sided,
            white: chosen.white,
            textured: chosen.textured,
            triangle: chosen.triangle,
            barycentric,
        }
    }

    /// Whether something holds of a corner, the unit normal and the double-sidedness of each of its triangles.
    pub(crate) fn all_triangles(&self, mut holds: impl FnMut(Vec3, Vec3, bool) -> bool) -> bool {
        self.triangles.iter().all(|t| holds(t.corner, t.normal, t.double_sided))
    }

    /// All corners of its triangles.
    pub(crate) fn corners(&self) -> impl Iterator<Item = Vec3> {
        self.triangles.iter().flat_map(|t| [t.corner, t.corner + t.edges[0], t.corner + t.edges[1]])
    }

    /// The middle of its triangles, each weighed by its area.
    pub(crate) fn center(&self) -> Vec3 {
        let weighed = |t: &ShiningTriangle| (t.corner + (t.edges[0] + t.edges[1]) / 3.0) / t.per_area;
        self.triangles.iter().map(weighed).sum::<Vec3>() / self.area.max(f32::MIN_POSITIVE)
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
    use super::*;
    use crate::sampler::Sampler;

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
