//! Where the faces of a slab are in their planes.

use glam::{Vec2, Vec3};

use super::Face;
use crate::scene::Mesh;

/// Edges that the sides of the rectangle are tried along: those of panes with many triangles are alike.
const MOST_EDGES: usize = 96;
/// Share of the rectangle up to which a face does not fill it.
const FILLED: f32 = 1.0 - 1e-4;

/// The smallest rectangle around both faces that has a side along one of their edges, and what they leave free of it.
#[derive(Debug)]
pub(super) struct Outline {
    /// Unit vectors along its sides.
    pub axes: [Vec3; 2],
    /// Half of its sides, m.
    pub half: Vec2,
    /// Triangles of back and front, from the middle along the axes; none where they fill the rectangle.
    triangles: [Vec<[Vec2; 3]>; 2],
}

impl Outline {
    /// Of back and front with their unit normal, and the middle of the rectangle in the plane through `origin`.
    pub(super) fn new(mesh: &Mesh, normal: Vec3, faces: &[Vec<u32>; 2], origin: Vec3) -> Option<(Outline, Vec3)> {
        let corners = |faces: &[u32]| -> Vec<[Vec3; 3]> {
            faces.iter().map(|&triangle| mesh.corners(triangle).map(|corner| corner - origin)).collect()
        };
        let faces = faces.each_ref().map(|face| corners(face));
        let all = || faces.iter().flatten();
        let edges = all().flat_map(|[a, b, c]| [*b - *a, *c - *b, *a - *c]).take(MOST_EDGES);
        let along = edges.filter_map(|edge| (edge - normal * edge.dot(normal)).try_normalize());
        let rectangles = along.map(|x| {
            let axes = [x, normal.cross(x)];
            let places = all().flatten().map(|&corner| on(&axes, corner));
            (axes, places.fold([Vec2::INFINITY, Vec2::NEG_INFINITY], |[lo, hi], at| [lo.min(at), hi.max(at)]))
        });
        let area = |[lo, hi]: [Vec2; 2]| (hi - lo).element_product();
        let (axes, [lo, hi]) = rectangles.min_by(|a, b| area(a.1).total_cmp(&area(b.1)))?;
        let middle = 0.5 * (lo + hi);
        let triangles = faces.map(|face| {
            let flat: Vec<[Vec2; 3]> = face.iter().map(|corners| corners.map(|at| on(&axes, at) - middle)).collect();
            let filled: f32 = flat.iter().map(|[a, b, c]| 0.5 * (*b - *a).perp_dot(*c - *a).abs()).sum();
            if filled >= FILLED * area([lo, hi]) { Vec::new() } else { flat }
        });
        let center = origin + axes[0] * middle.x + axes[1] * middle.y;
        Some((Outline { axes, half: 0.5 * (hi - lo), triangles }, center))
    }

    /// Along the axes, of what lies aside from the middle.
    #[inline]
    pub(super) fn place(&self, aside: Vec3) -> Vec2 {
        on(&self.axes, aside)
    }

    /// How far a place is beside the rectangle, m; not more than 0 within.
    #[inline]
    pub(super) fn excess(&self, place: Vec2) -> f32 {
        (place.abs() - self.half).max_element()
    }

    /// Whether a face has a place.
    #[inline]
    pub(super) fn has(&self, face: Face, place: Vec2) -> bool {
        let triangles = &self.triangles[face as usize];
        self.excess(place) <= 0.0 && (triangles.is_empty() || triangles.iter().any(|corners| holds(corners, place)))
    }
}

fn on([x, y]: &[Vec3; 2], aside: Vec3) -> Vec2 {
    Vec2::new(aside.dot(*x), aside.dot(*y))
}

fn holds(&[a, b, c]: &[Vec2; 3], place: Vec2) -> bool {
    let (ab, ac, ap) = (b - a, c - a, place - a);
    let per_area = 1.0 / ab.perp_dot(ac);
    let (u, v) = (ap.perp_dot(ac) * per_area, ab.perp_dot(ap) * per_area);
    u >= 0.0 && v >= 0.0 && u + v <= 1.0
}

#[cfg(test)]
mod tests {
    use glam::Quat;

    use super::*;
    use crate::camera::Camera;
    use crate::laws::slabs::{block, glass};
    use crate::laws::stage::Stage;
    use crate::scene::Scene;

    fn scene(corners: &[Vec3]) -> Scene {
        let camera = Camera::look_at("eye", Vec3::Y, Vec3::ZERO, 1.0, 1.0);
        Stage::new(camera).surface("face", corners, glass()).into_scene()
    }

    #[test]
    fn a_turned_pane_fills_its_rectangle() {
        let turn = Quat::from_rotation_y(0.6) * Quat::from_rotation_x(0.3);
        let (center, half) = (Vec3::new(3.0, 1.0, -2.0), Vec3::new(0.5, 0.01, 0.8));
        let scene = scene(&block(center, half, turn));
        let normal = turn * Vec3::Y;
        let upright = |t: &u32| scene.mesh.area_normal(*t).normalize().dot(normal);
        let of = |side: f32| (0..12).filter(|t| upright(t) * side > 0.9).collect();
        let (outline, middle) = Outline::new(&scene.mesh, normal, &[of(-1.0), of(1.0)], center).unwrap();
        let (x, y) = (outline.half.min_element(), outline.half.max_element());
        assert!((x - 0.5).abs() < 1e-5 && (y - 0.8).abs() < 1e-5 && middle.distance(center) < 1e-5, "{outline:?}");
        assert!(outline.triangles.iter().all(Vec::is_empty));
        let at = |x: f32, z: f32| outline.place(turn * Vec3::new(x, 0.0, z));
        assert!(outline.has(Face::Front, at(0.49, -0.79)) && !outline.has(Face::Back, at(0.51, 0.0)));
        assert!((outline.excess(at(0.7, 0.0)) - 0.2).abs() < 1e-5);
    }

    #[test]
    fn a_face_of_another_shape_has_what_its_triangles_have() {
        let corners = [Vec3::ZERO, Vec3::Z, Vec3::X];
        let scene = scene(&corners);
        let (outline, middle) = Outline::new(&scene.mesh, Vec3::Y, &[vec![0], vec![0]], Vec3::ZERO).unwrap();
        let has = |x: f32, z: f32| outline.has(Face::Front, outline.place(Vec3::new(x, 0.0, z) - middle));
        assert!(has(0.2, 0.2) && has(0.6, 0.3) && !has(0.6, 0.6) && !has(-0.1, 0.5));
    }
}
