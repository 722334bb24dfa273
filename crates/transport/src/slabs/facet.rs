//! The triangles of a slab's faces, ready for connections that go through them.

use glam::{Vec2, Vec3};

use crate::clearance::{clearance, offset_origin, rounding};
use crate::scene::Mesh;

/// A triangle of a face.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Facet {
    /// Its number in the mesh.
    pub(crate) triangle: u32,
    corner: Vec3,
    /// From the corner to the second and the third one.
    edges: [Vec3; 2],
    /// Their products with the way from the corner to a point are the point's weights of these two.
    weights: [Vec3; 2],
    /// Unit geometric normal, out of the glass.
    pub(crate) normal: Vec3,
    /// Distance within which rays may meet it again that leave it, within the extent of the scene, m.
    clearance: f32,
}

impl Facet {
    pub(super) fn new(mesh: &Mesh, triangle: u32) -> Facet {
        let [corner, second, third] = mesh.corners(triangle);
        let edges = [second - corner, third - corner];
        let across = edges[0].cross(edges[1]);
        let per_area = 1.0 / across.length_squared();
        let weights = [edges[1].cross(across) * per_area, across.cross(edges[0]) * per_area];
        let (normal, clearance) = (across.normalize_or(Vec3::Y), clearance(edges[0], edges[1], across));
        Facet { triangle, corner, edges, weights, normal, clearance }
    }

    /// The first of some in whose plane a point lies that has it, and the weights of its second and third corner there.
    pub(crate) fn with(facets: &[Facet], point: Vec3) -> Option<(&Facet, Vec2)> {
        facets.iter().find_map(|facet| {
            let way = point - facet.corner;
            let uv = Vec2::from(facet.weights.map(|weight| way.dot(weight)));
            (uv.x >= 0.0 && uv.y >= 0.0 && uv.x + uv.y <= 1.0).then_some((facet, uv))
        })
    }

    /// The point with some weights.
    pub(crate) fn point(&self, uv: Vec2) -> Vec3 {
        self.corner + self.edges[0] * uv.x + self.edges[1] * uv.y
    }

    /// Where a ray begins that leaves a point of it in a direction, in a scene with a diagonal of `extent` meters.
    pub(crate) fn origin(&self, point: Vec3, direction: Vec3, extent: f32) -> Vec3 {
        let normal = if self.normal.dot(direction) < 0.0 { -self.normal } else { self.normal };
        let clearance = self.clearance + rounding(point, normal, extent);
        offset_origin(point + normal * clearance, normal, extent)
    }

    /// A corner and the clearance, and the edges from there, for a device.
    pub(super) fn words(&self) -> [(Vec3, u32); 3] {
        [(self.corner, self.clearance.to_bits()), (self.edges[0], 0), (self.edges[1], 0)]
    }
}
