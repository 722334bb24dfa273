//! Closed surfaces of opaque triangles: what is inside of one and what is outside see nothing of each other.
//!
//! Triangles whose every edge is shared by an even number of them have no border, so that a path from a point to another
//! crosses them as often, modulo two, as any other path between the same points: if a straight one crosses them an odd
//! number of times, every path crosses them at least once. Corners belong together where their coordinates are the same
//! to the last bit; walls that only nearly meet are not closed.

use std::collections::HashMap;

use glam::{DVec3, Vec3};

use crate::prepared::PreparedScene;
use crate::scene::Mesh;

/// Closed surfaces, and the side of each on which the eye is.
pub(super) struct Walls {
    shells: Vec<Shell>,
    eye: DVec3,
}

/// A closed surface.
struct Shell {
    triangles: Vec<[DVec3; 3]>,
    low: DVec3,
    high: DVec3,
    holds_eye: Option<bool>,
}

/// Directions that are tried until one meets no edge.
const DIRECTIONS: [DVec3; 4] = [
    DVec3::new(0.538_421, 0.692_117, 0.480_733),
    DVec3::new(-0.317_911, 0.843_377, -0.433_219),
    DVec3::new(0.281_773, -0.614_937, 0.736_511),
    DVec3::new(-0.771_523, -0.219_373, 0.597_151),
];
/// Distance from an edge, over the size of the triangle, below which a crossing says nothing.
const UNSURE: f64 = 1e-7;
/// Share of its size and of its coordinates by which a triangle lies beyond a room that no rounding brings in.
const ASIDE: f64 = 1e-3;
/// Shells that may be looked at; buildings have few, dishes on a table many.
const MOST_SHELLS: usize = 4096;

impl Walls {
    /// The closed surfaces of a scene.
    pub(super) fn around(scene: &PreparedScene, eye: Vec3) -> Walls {
        let mesh = &scene.scene.mesh;
        let (mut index, mut places) = (HashMap::new(), Vec::new());
        let mut weld = |vertex: u32| {
            let position = mesh.positions[vertex as usize];
            *index.entry(Mesh::place(position)).or_insert_with(|| {
                places.push(position.as_dvec3());
                places.len() as u32 - 1
            })
        };
        let walls = (0..mesh.triangles.len() as u32).filter(|&triangle| scene.is_wall(triangle));
        let mut triangles: Vec<[u32; 3]> = walls
            .map(|triangle| {
                let mut corners = mesh.triangles[triangle as usize].map(&mut weld);
                corners.sort_unstable();
                corners
            })
            .filter(|[a, b, c]| a != b && b != c)
            .collect();
        // A triangle that is there twice would be crossed twice.
        triangles.sort_unstable();
        triangles.dedup();
        let eye = eye.as_dvec3();
        let shell = |triangles: Vec<usize>, all: &[[u32; 3]]| {
            let corners = triangles.iter().map(|&t| all[t].map(|place| places[place as usize])).collect();
            Shell::new(corners, eye)
        };
        let shells = closed_parts(&triangles).into_iter().take(MOST_SHELLS).map(|part| shell(part, &triangles));
        Walls { shells: shells.collect(), eye }
    }

    /// Whether the eye is inside of one.
    pub(super) fn are_closed(&self) -> bool {
        self.shells.iter().any(|shell| shell.holds_eye == Some(true))
    }

    /// Of each triangle of a mesh, whether it lies beyond one that the eye is inside of.
    pub(super) fn shut_out(&self, mesh: &Mesh) -> Vec<bool> {
        let rooms = self.shells.iter().filter(|shell| shell.holds_eye == Some(true));
        let rooms: Vec<[DVec3; 2]> = rooms.map(|shell| [shell.low, shell.high]).collect();
        let is_out = |triangle: u32| rooms.iter().any(|room| is_clear_of_box(mesh.corners(triangle), *room));
        (0..mesh.triangles.len() as u32).map(is_out).collect()
    }

    /// Whether a ball and the eye are on two sides of one.
    pub(super) fn keep_apart(&self, center: DVec3, radius: f64) -> bool {
        let radius = 1.0001 * radius + 1e-6 * (center - self.eye).length();
        self.shells.iter().any(|shell| {
            let inside = if shell.is_clear_of(center, radius) { shell.holds(center) } else { None };
            inside.zip(shell.holds_eye).is_some_and(|(ball, eye)| ball != eye)
        })
    }
}

impl Shell {
    fn new(triangles: Vec<[DVec3; 3]>, eye: DVec3) -> Shell {
        let corners = || triangles.iter().flatten().copied();
        let low = corners().fold(DVec3::INFINITY, DVec3::min);
        let high = corners().fold(DVec3::NEG_INFINITY, DVec3::max);
        let mut shell = Shell { triangles, low, high, holds_eye: None };
        shell.holds_eye = shell.holds(eye);
        shell
    }

    /// Whether a point is inside; `None` where rounding could decide.
    fn holds(&self, point: DVec3) -> Option<bool> {
        let margin = DVec3::splat(UNSURE * (self.high - self.low).max_element());
        if point.cmplt(self.low - margin).any() || point.cmpgt(self.high + margin).any() {
            return Some(false);
        }
        DIRECTIONS.into_iter().find_map(|direction| {
            let crossings = self.triangles.iter().map(|corners| crosses(corners, point, direction));
            crossings.sum::<Option<u32>>().map(|n| n % 2 == 1)
        })
    }

    /// Whether no triangle touches a ball.
    fn is_clear_of(&self, center: DVec3, radius: f64) -> bool {
        let outside = (self.low - center).max(center - self.high).max(DVec3::ZERO);
        outside.length_squared() > radius * radius
            || self.triangles.iter().all(|corners| distance(corners, center) > radius)
    }
}

/// Whether a triangle lies clear of a box, beyond one of its sides.
pub(super) fn is_clear_of_box(corners: [Vec3; 3], [low, high]: [DVec3; 2]) -> bool {
    let margin = DVec3::splat(ASIDE * low.abs().max(high.abs()).max(high - low).max_element());
    let [a, b, c] = corners.map(Vec3::as_dvec3);
    a.max(b).max(c).cmplt(low - margin).any() || a.min(b).min(c).cmpgt(high + margin).any()
}

/// 1 where a ray crosses a triangle, 0 where it does not, `None` where it passes an edge or the point lies on the triangle.
fn crosses([a, b, c]: &[DVec3; 3], origin: DVec3, direction: DVec3) -> Option<u32> {
    let (ab, ac, from_a) = (b - a, c - a, origin - a);
    let size = ab.length().max(ac.length());
    let across = direction.cross(ac);
    let determinant = ab.dot(across);
    let normal = ab.cross(ac);
    if determinant.abs() <= UNSURE * normal.length().max(f64::MIN_POSITIVE) {
        // Along the plane: a ray that stays off it by more than the triangle is large does not cross it.
        let off_plane = from_a.dot(normal.normalize_or_zero()).abs();
        return (off_plane > size).then_some(0);
    }
    let u = from_a.dot(across) / determinant;
    let along = from_a.cross(ab);
    let v = direction.dot(along) / determinant;
    let t = ac.dot(along) / determinant;
    let inside = u.min(v).min(1.0 - u - v);
    match () {
        () if inside < -UNSURE || t < -UNSURE * size => Some(0),
        () if inside < UNSURE || t < UNSURE * size => None,
        () => Some(1),
    }
}

/// Distance from a triangle.
fn distance([a, b, c]: &[DVec3; 3], point: DVec3) -> f64 {
    let to_edge = |from: DVec3, to: DVec3| {
        let edge = to - from;
        let along = ((point - from).dot(edge) / edge.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        point.distance(from + edge * along)
    };
    let edges = to_edge(*a, *b).min(to_edge(*b, *c)).min(to_edge(*c, *a));
    let Some(normal) = (b - a).cross(c - a).try_normalize() else { return edges };
    let beside = |from: &DVec3, to: &DVec3| (to - from).cross(point - from).dot(normal) < 0.0;
    if beside(a, b) || beside(b, c) || beside(c, a) { edges } else { (point - a).dot(normal).abs().min(edges) }
}

/// The triangles of each part that hangs together by its edges and has no border.
fn closed_parts(triangles: &[[u32; 3]]) -> Vec<Vec<usize>> {
    let mut index: HashMap<(u32, u32), usize> = HashMap::new();
    let mut of_edge: Vec<Vec<u32>> = Vec::new();
    let mut edge = |a: u32, b: u32, triangle: usize| {
        let at = *index.entry((a, b)).or_insert_with(|| {
            of_edge.push(Vec::new());
            of_edge.len() - 1
        });
        of_edge[at].push(triangle as u32);
        at
    };
    let edges: Vec<[usize; 3]> = triangles
        .iter()
        .enumerate()
        .map(|(nth, &[a, b, c])| [edge(a, b, nth), edge(a, c, nth), edge(b, c, nth)])
        .collect();

    // What hangs on by a part of its edges only closes nothing: pictures, shelves, open sheets.
    let mut count: Vec<usize> = of_edge.iter().map(Vec::len).collect();
    let mut is_there = vec![true; triangles.len()];
    let mut loose: Vec<usize> = (0..triangles.len()).filter(|&t| edges[t].iter().any(|&e| count[e] == 1)).collect();
    while let Some(triangle) = loose.pop() {
        if !std::mem::replace(&mut is_there[triangle], false) {
            continue;
        }
        for &e in &edges[triangle] {
            count[e] -= 1;
            if count[e] == 1 {
                loose.extend(of_edge[e].iter().map(|&t| t as usize).filter(|&t| is_there[t]));
            }
        }
    }

    let mut parts = Vec::new();
    for start in 0..triangles.len() {
        if !is_there[start] {
            continue;
        }
        let (mut part, mut next, mut is_closed) = (Vec::new(), vec![start], true);
        is_there[start] = false;
        while let Some(triangle) = next.pop() {
            part.push(triangle);
            for &e in &edges[triangle] {
                is_closed &= count[e].is_multiple_of(2);
                for neighbor in of_edge[e].iter().map(|&t| t as usize) {
                    if std::mem::replace(&mut is_there[neighbor], false) {
                        next.push(neighbor);
                    }
                }
            }
        }
        if is_closed {
            parts.push(part);
        }
    }
    parts
}
