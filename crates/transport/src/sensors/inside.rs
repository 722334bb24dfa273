//! Which points of a level plane lie inside of closed bodies, whichever sides of their surfaces are drawn.
//!
//! Files of many programs are double-sided all over, and then no surface shows its back. A level plane cuts a closed body along
//! contours: a point is inside where they run round it, and the body is above it as well. Single sheets are cut along lines that end,
//! and tubs have nothing above.

use std::collections::{BTreeMap, BTreeSet};

use glam::{Vec2, Vec3};

use super::SensorGrid;
use super::plan::is_below;
use crate::prepared::PreparedScene;
use crate::scene::{AlphaMode, Material, Mesh};

/// Numbers of the points of a level grid that lie inside of opaque bodies. A body around a camera or a lamp is a room, and none of
/// them.
pub(super) fn points_inside(scene: &PreparedScene, grid: &SensorGrid) -> BTreeSet<u32> {
    let mesh = &scene.scene.mesh;
    let mut of_nodes: BTreeMap<u32, Vec<[Vec3; 3]>> = BTreeMap::new();
    for (triangle, &node) in (0u32..).zip(&mesh.triangle_node) {
        if is_opaque(scene.material(triangle)) {
            of_nodes.entry(node).or_default().push(mesh.corners(triangle));
        }
    }
    let cameras = scene.scene.cameras.iter().map(|camera| camera.position());
    let inhabitants: Vec<Vec3> = cameras.chain(scene.scene.punctual.iter().map(|lamp| lamp.position)).collect();
    let mut inside = BTreeSet::new();
    // A level plane on a floor is cut above the bottoms of what stands there.
    let Some(Vec3 { y: height_m, .. }) = grid.lifted(scene, 0) else { return inside };
    for triangles in of_nodes.values() {
        let cut = Cut::new(triangles, height_m);
        if cut.contours.is_empty() {
            continue;
        }
        let is_in = |number: &u32| grid.lifted(scene, *number).is_some_and(|point| cut.surrounds(point));
        let of_node: Vec<u32> = (0..grid.n_points() as u32).filter(is_in).collect();
        let is_room = || inhabitants.iter().any(|position| Cut::new(triangles, position.y).surrounds(*position));
        if !of_node.is_empty() && !is_room() {
            inside.extend(of_node);
        }
    }
    inside
}

fn is_opaque(material: &Material) -> bool {
    !material.unlit && material.transmission <= 0.0 && material.alpha == AlphaMode::Opaque
}

/// What a level plane cuts of the surfaces of a node.
struct Cut {
    /// Lines along x and z, in closed contours: counterclockwise around what they hold, where the surfaces face outward.
    contours: Vec<[Vec2; 2]>,
    /// Corner of the contours of least x and z.
    low: Vec2,
    /// The one of greatest.
    high: Vec2,
    /// Corners of the triangles that reach above the plane.
    above: Vec<[Vec3; 3]>,
}

impl Cut {
    fn new(triangles: &[[Vec3; 3]], height_m: f32) -> Cut {
        let lines: Vec<Line> = triangles.iter().filter_map(|corners| Line::new(corners, height_m)).collect();
        let contours = closed(&lines);
        let low = contours.iter().flatten().copied().fold(Vec2::INFINITY, Vec2::min);
        let high = contours.iter().flatten().copied().fold(Vec2::NEG_INFINITY, Vec2::max);
        let reaches_above = |corners: &&[Vec3; 3]| corners.iter().any(|corner| corner.y > height_m);
        let above =
            if contours.is_empty() { Vec::new() } else { triangles.iter().filter(reaches_above).copied().collect() };
        Cut { contours, low, high, above }
    }

    /// Whether a point of the plane is inside.
    fn surrounds(&self, point: Vec3) -> bool {
        let at = Vec2::new(point.x, point.z);
        if at.cmplt(self.low).any() || at.cmpgt(self.high).any() {
            return false;
        }
        let n_turns: i32 = self.contours.iter().map(|ends| crossing(ends.map(|end| end - at))).sum();
        n_turns > 0 && self.above.iter().any(|corners| is_above(corners, point))
    }
}

/// How a line crosses the axis from the origin along x: 1 to the left of who walks along it, −1 to the right, 0 where it does not.
fn crossing([from, to]: [Vec2; 2]) -> i32 {
    match (from.y > 0.0, to.y > 0.0) {
        (false, true) => i32::from(from.perp_dot(to) > 0.0),
        (true, false) => -i32::from(from.perp_dot(to) < 0.0),
        _ => 0,
    }
}

/// Whether a triangle is straight above a point.
fn is_above(corners: &[Vec3; 3], point: Vec3) -> bool {
    let [a, b, c] = *corners;
    let normal = (b - a).cross(c - a);
    is_below(corners, point) && normal.dot(point - a) * normal.y < 0.0
}

/// The places of both ends of an edge, the lower one first.
type Edge = [[u32; 3]; 2];

/// Where a plane cuts a triangle: from the edge that rises through it, as the triangle is walked round, to the one that falls.
struct Line {
    edges: [Edge; 2],
    /// Along x and z.
    ends: [Vec2; 2],
}

impl Line {
    fn new(corners: &[Vec3; 3], height_m: f32) -> Option<Line> {
        let next = |nth: usize| (nth + 1) % 3;
        let is_above = corners.map(|corner| corner.y > height_m);
        let leaves = |side: bool| (0..3).find(|&nth| is_above[nth] == side && is_above[next(nth)] != side);
        let (rising, falling) = (leaves(false)?, leaves(true)?);
        // Low and high alike in both triangles of an edge, so that their lines meet to the last bit.
        let edges = [[rising, next(rising)], [next(falling), falling]].map(|edge| edge.map(|nth| corners[nth]));
        let ends = edges.map(|[low, high]| {
            let end = low + (high - low) * ((height_m - low.y) / (high.y - low.y));
            Vec2::new(end.x, end.z)
        });
        Some(Line { edges: edges.map(|edge| edge.map(Mesh::place)), ends })
    }
}

/// Those of some lines that lead on into one another, and back to where they began.
fn closed(lines: &[Line]) -> Vec<[Vec2; 2]> {
    let mut beginning: BTreeMap<Edge, Vec<usize>> = BTreeMap::new();
    for (nth, line) in lines.iter().enumerate() {
        beginning.entry(line.edges[0]).or_default().push(nth);
    }
    let next: Vec<Option<usize>> =
        lines.iter().map(|line| beginning.get_mut(&line.edges[1]).and_then(Vec::pop)).collect();
    let mut is_first = vec![true; lines.len()];
    next.iter().flatten().for_each(|&nth| is_first[nth] = false);
    // What begins somewhere ends somewhere, as no line comes after two.
    let mut is_open = vec![false; lines.len()];
    for first in (0..lines.len()).filter(|&nth| is_first[nth]) {
        let mut at = Some(first);
        while let Some(nth) = at {
            is_open[nth] = true;
            at = next[nth];
        }
    }
    lines.iter().zip(is_open).filter(|(_, is_open)| !is_open).map(|(line, _)| line.ends).collect()
}
