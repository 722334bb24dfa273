//! What lies in the glass of slabs: where nothing does, light that came in by one face meets nothing before the other one, and no ray
//! has to look.

use glam::{DVec3, Vec3};

use super::find::ROUNDING;
use super::{Bounds, Slab, Slabs};
use crate::scene::Mesh;

/// Rounding of places over half of a side of the room, beyond which it is not told what lies in the glass.
const COARSE: f64 = 1.0 / 64.0;

/// Around all that lies between two faces, along their normal and the sides of the rectangle around them.
struct Room {
    center: DVec3,
    /// Unit vectors.
    axes: [DVec3; 3],
    /// How far it reaches from the center along each, m, without what rounding alone keeps apart from its sides.
    half: DVec3,
}

impl Slabs {
    /// Finds out in which slabs nothing lies but their glass. Needs their tree.
    pub(super) fn look_inside(&mut self, mesh: &Mesh) {
        if self.is_empty() {
            return;
        }
        // None where something lies in it, or may.
        let mut rooms: Vec<Option<Room>> = self.slabs.iter().map(|slab| Room::of(slab, mesh)).collect();
        for triangle in 0..mesh.triangles.len() as u32 {
            let corners = mesh.corners(triangle);
            let span = corners.into_iter().fold(Bounds::default(), Bounds::with);
            // Faces are level: what crosses the glass meets each of them once.
            let own = self.face_of(triangle).map(|(slab, _)| slab);
            let visit = |idx: u32| {
                let at = idx as usize;
                let may_hold = own != Some(idx) && self.slabs[at].bounds.overlaps(&span);
                if may_hold && rooms[at].as_ref().is_some_and(|room| room.has_some_of(corners)) {
                    rooms[at] = None;
                }
            };
            self.tree.each(|bounds| bounds.overlaps(&span), visit);
        }
        for (slab, room) in self.slabs.iter_mut().zip(&rooms) {
            slab.is_free = room.is_some();
        }
    }
}

impl Room {
    /// Of a slab; `None` where places are too coarse to tell what lies in its glass.
    fn of(slab: &Slab, mesh: &Mesh) -> Option<Room> {
        let [x, y] = slab.outline.axes;
        let axes = [x, y, slab.normal].map(|axis| axis.as_dvec3());
        let mut room = Room { center: slab.center.as_dvec3(), axes, half: DVec3::ZERO };
        let mut rounding = DVec3::ZERO;
        for corner in slab.facets.iter().flatten().flat_map(|facet| mesh.corners(facet.triangle)) {
            room.half = room.half.max(room.place(corner).abs());
            let coordinates = DVec3::from(axes.map(|axis| axis.abs().dot(corner.as_dvec3().abs())));
            rounding = rounding.max(coordinates * f64::from(ROUNDING));
        }
        let is_fine = rounding.cmple(COARSE * room.half).all();
        room.half -= rounding;
        is_fine.then_some(room)
    }

    /// Along its axes, from its center.
    fn place(&self, position: Vec3) -> DVec3 {
        let from_center = position.as_dvec3() - self.center;
        DVec3::from(self.axes.map(|axis| axis.dot(from_center)))
    }

    /// Whether a part of a triangle lies in it.
    fn has_some_of(&self, corners: [Vec3; 3]) -> bool {
        let mut part = corners.map(|corner| self.place(corner)).to_vec();
        for (axis, half) in self.half.to_array().into_iter().enumerate() {
            part = above(&part, |place| half - place[axis]);
            part = above(&part, |place| half + place[axis]);
        }
        !part.is_empty()
    }
}

/// The part of a convex polygon where a height is above 0. \[Sutherland1974\]
fn above(polygon: &[DVec3], height: impl Fn(DVec3) -> f64) -> Vec<DVec3> {
    let mut part = Vec::new();
    for (nth, &a) in polygon.iter().enumerate() {
        let b = polygon[(nth + 1) % polygon.len()];
        let (from, to) = (height(a), height(b));
        if from > 0.0 {
            part.push(a);
        }
        if (from > 0.0) != (to > 0.0) {
            part.push(a + (b - a) * (from / (from - to)));
        }
    }
    part
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::Quat;

    use super::*;
    use crate::camera::Camera;
    use crate::lamps::tests::lamp;
    use crate::lamps::{FreeLamp, LampShape, PreparedLamps};
    use crate::laws::slabs::{block, glass};
    use crate::laws::stage::{Stage, lambert, quad};
    use crate::prepared::PreparedScene;

    const CENTER: Vec3 = Vec3::new(0.25, 1.0, 0.0);
    const HALF: Vec3 = Vec3::new(2.0, 0.125, 1.0);

    /// A level pane that is turned about its center, and some triangles that turn with it.
    fn pane_with(turn: Quat, triangles: &[Vec3]) -> Stage {
        let camera = Camera::look_at("eye", Vec3::new(0.0, 0.4, 0.6), Vec3::ZERO, 1.0, 1.0);
        let turned: Vec<Vec3> = triangles.iter().map(|&corner| CENTER + turn * corner).collect();
        let stage = Stage::new(camera).surface("thing", &turned, lambert(0.0, 0.0));
        stage.surface("pane", &block(CENTER, HALF, turn), glass())
    }

    /// A piece of wire, at a height over the middle of the glass.
    fn wire(height: f32) -> [Vec3; 3] {
        [(-0.05, -0.05), (-0.05, 0.05), (0.05, 0.0)].map(|(x, z)| Vec3::new(x, height, z))
    }

    /// The same scene, with a ray from face to face or without one.
    fn said_to_be_free(mut scene: PreparedScene, is_free: bool) -> PreparedScene {
        let slabs = Arc::get_mut(&mut scene.slabs).expect("the scene alone has them");
        slabs.slabs.iter_mut().for_each(|slab| slab.is_free = is_free);
        scene
    }

    /// Light of a lamp over the pane at a place below it.
    fn light(scene: &PreparedScene, place: Vec3) -> Vec3 {
        let above = FreeLamp { position: CENTER + Vec3::Y, aim: CENTER, ..lamp(LampShape::Point) };
        PreparedLamps::new(&[above], None).expect("a lamp").0.irradiance(scene, place, Vec3::Y, None)
    }

    #[test]
    fn glass_is_free_where_nothing_reaches_into_it() {
        let (x, z) = (Vec3::X * 8.0, Vec3::Z * 8.0);
        let level = |height: f32| quad(Vec3::new(-4.0, height, -4.0), z, x);
        let upright = |at: f32, low: f32| quad(Vec3::new(at, low, -4.0), z, Vec3::Y * 3.0);
        // All across the glass, and corners far off.
        let aslant = quad(Vec3::new(-4.0, -2.0, -4.0), z, Vec3::new(8.0, 4.0, 0.0));
        let cases = [
            ("a wire", wire(0.0).to_vec(), false),
            ("a wire close to a face", wire(0.1249).to_vec(), false),
            ("a wire beyond it", wire(0.126).to_vec(), true),
            ("a film on a face", level(0.125), true),
            ("a film under the other one", level(-0.125), true),
            ("a film in the glass", level(0.01), false),
            ("a frame around the rim", upright(2.0, -1.0), true),
            ("a frame into the rim", upright(1.99, -1.0), false),
            ("a wall that ends at a face", upright(0.5, 0.125), true),
            ("a sheet aslant", aslant, false),
        ];
        for (what, triangles, expected) in cases {
            let slabs = pane_with(Quat::IDENTITY, &triangles).prepared().slabs;
            assert_eq!(slabs.slabs.len(), 1, "{what}");
            assert_eq!(slabs.slabs[0].is_free, expected, "{what}");
        }
    }

    #[test]
    fn a_small_pane_far_along_one_of_its_sides_is_not_called_free() {
        let is_free = |along: f32, height: f32| {
            let center = Vec3::new(along, 1.0, 0.0);
            // Nearer to the end of the glass than far places are exact, and all of it at places that exist there.
            let wire = [(12.0, -0.5), (14.0, -0.5), (13.0, 0.5)];
            let wire = wire.map(|(nth, z)| center + Vec3::new(nth / 128.0, height, z));
            let camera = Camera::look_at("eye", Vec3::new(0.0, 0.4, 0.6), Vec3::ZERO, 1.0, 1.0);
            let stage = Stage::new(camera).surface("wire", &wire, lambert(0.0, 0.0));
            let pane = block(center, Vec3::new(0.125, 0.03125, 1.0), Quat::IDENTITY);
            let slabs = Slabs::find(&stage.surface("pane", &pane, glass()).into_scene());
            assert_eq!(slabs.slabs.len(), 1, "{along}");
            slabs.slabs[0].is_free
        };
        assert!(is_free(0.0, 0.5) && !is_free(0.0, 0.0));
        assert!(!is_free(1e5, 0.0));
    }

    #[test]
    fn turned_glass_holds_what_is_in_it_and_not_what_is_beside_it() {
        for angle in [0.3, 0.9, 2.1] {
            let turn = Quat::from_rotation_z(angle) * Quat::from_rotation_x(0.4);
            for (height, expected) in [(0.0, false), (0.124, false), (0.13, true), (0.4, true), (-0.124, false)] {
                let slabs = pane_with(turn, &wire(height)).prepared().slabs;
                assert_eq!(slabs.slabs.len(), 1, "{angle}");
                assert_eq!(slabs.slabs[0].is_free, expected, "{height} in glass turned by {angle}");
            }
        }
    }

    #[test]
    fn free_glass_passes_what_it_passes_with_a_ray_from_face_to_face() {
        for angle in [0.0, 0.2] {
            let beside = wire(0.6).map(|corner| corner + Vec3::X * 1.5);
            let scene = || pane_with(Quat::from_rotation_z(angle), &beside).prepared();
            let (found, traced) = (scene(), said_to_be_free(scene(), false));
            assert!(found.slabs.slabs[0].is_free, "{angle}");
            for place in [-1.2, -0.4, 0.1, 0.6, 1.3].map(|x| Vec3::new(x, 0.0, 0.1)) {
                let passed = light(&found, place);
                assert!(passed.min_element() > 0.0, "{place}, {angle}");
                assert_eq!(passed, light(&traced, place), "{place}, {angle}");
            }
        }
    }

    #[test]
    fn a_wire_in_glass_throws_its_shadow() {
        let scene = pane_with(Quat::IDENTITY, &wire(0.0)).prepared();
        let [below, beside] = [0.0, 0.5].map(|aside| CENTER * Vec3::X + Vec3::X * aside);
        assert_eq!(light(&scene, below), Vec3::ZERO);
        assert!(light(&scene, beside).min_element() > 0.0);
        // The ray from face to face alone meets it.
        assert!(light(&said_to_be_free(scene, true), below).min_element() > 0.0);
    }
}
