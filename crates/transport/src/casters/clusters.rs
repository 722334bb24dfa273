//! Casters in pieces of about one size, each as a ball that a guided walk can aim at.

use std::ops::Index;

use glam::{Vec2, Vec3};

use crate::scene::Mesh;

/// The pieces of all casters in balls of two sizes: fine ones, and coarse ones around them.
#[derive(Debug, Default)]
pub(super) struct Clusters {
    /// The fine ones, then the coarse ones.
    balls: Vec<Cluster>,
    /// For each fine one the number of the coarse one around it.
    around: Vec<u32>,
}

/// Some neighboring pieces of triangles within a ball.
#[derive(Debug)]
pub(super) struct Cluster {
    center: Vec3,
    radius: f32,
    /// In m².
    pub(super) area: f32,
    /// With the sum of their shares of the area up to each.
    pieces: Vec<(Piece, f32)>,
}

/// A part of a triangle.
#[derive(Clone, Copy, Debug)]
struct Piece {
    triangle: u32,
    /// Barycentric coordinates of its corners, those of the triangle's second and third vertex.
    corners: [Vec2; 3],
    /// In m.
    center: Vec3,
    radius: f32,
    /// In m².
    area: f32,
}

/// Clusters, about: fine and coarse ones.
const FINE: f32 = 4096.0;
const COARSE: f32 = 64.0;
/// Pieces at most; then they stay as large as they are.
const MOST_PIECES: usize = 1 << 20;
/// Distance from the middle of a ball, in radii, from which on it has an outline to aim at.
const OUTSIDE: f32 = 1.02;

impl Cluster {
    /// A point, as a triangle and two of its barycentric coordinates.
    pub(super) fn point(&self, u_piece: f32, [u, v]: [f32; 2]) -> (u32, Vec2) {
        let nth = self.pieces.partition_point(|(_, sum)| *sum <= u_piece).min(self.pieces.len() - 1);
        let Piece { triangle, corners: [a, b, c], .. } = self.pieces[nth].0;
        let root = u.sqrt();
        (triangle, a * (1.0 - root) + b * (root * (1.0 - v)) + c * (root * v))
    }

    /// A direction from a place into the cone around the ball, all of them alike; `None` from within, and where rounding carries it
    /// over the rim: what has no density there must not be drawn, or it would count as if chance alone had found it.
    pub(super) fn direction(&self, from: Vec3, [u, v]: [f32; 2]) -> Option<Vec3> {
        let (axis, one_minus_cos) = self.cone(from)?;
        let below = u * one_minus_cos;
        let sin = (below * (2.0 - below)).max(0.0).sqrt();
        let (tangent, bitangent) = axis.any_orthonormal_pair();
        let (y, x) = (std::f32::consts::TAU * v).sin_cos();
        let direction = ((tangent * x + bitangent * y) * sin + axis * (1.0 - below)).normalize();
        (self.pdf(from, direction) > 0.0).then_some(direction)
    }

    /// Density per solid angle of that.
    #[inline]
    pub(super) fn pdf(&self, from: Vec3, direction: Vec3) -> f32 {
        let toward = self.center - from;
        let within = toward.cross(direction).length_squared() <= self.radius * self.radius;
        if !within || toward.dot(direction) <= 0.0 {
            return 0.0;
        }
        self.cone(from).map_or(0.0, |(_, one_minus_cos)| 1.0 / (std::f32::consts::TAU * one_minus_cos))
    }

    /// Unit axis of the cone around the ball, and one minus the cosine of half its angle.
    #[inline]
    fn cone(&self, from: Vec3) -> Option<(Vec3, f32)> {
        let toward = self.center - from;
        let distance = toward.length();
        let sin = self.radius / distance;
        let sin_squared = sin * sin;
        let one_minus_cos = sin_squared / (1.0 + (1.0 - sin_squared).max(0.0).sqrt());
        (distance > OUTSIDE * self.radius && one_minus_cos > 0.0).then(|| (toward / distance, one_minus_cos))
    }
}

impl Clusters {
    /// Of all triangles that have an area.
    pub(super) fn of(mesh: &Mesh, triangles: &[u32]) -> Clusters {
        let total: f32 = triangles.iter().map(|&t| mesh.area_m2(t)).sum();
        if total.is_nan() || total <= 0.0 || !total.is_finite() {
            return Clusters::default();
        }
        let [fine, coarse] = [FINE, COARSE].map(|n| (total / n).sqrt());
        let mut pieces = Vec::with_capacity(triangles.len());
        for &triangle in triangles {
            cut(mesh, (triangle, [Vec2::ZERO, Vec2::X, Vec2::Y]), fine, &mut pieces);
        }
        let (mut balls, mut around, mut large) = (Vec::new(), Vec::new(), Vec::new());
        gather(&mut pieces, coarse, &mut large);
        for (number, ball) in large.iter_mut().enumerate() {
            let mut pieces: Vec<Piece> = std::mem::take(&mut ball.pieces).into_iter().map(|(piece, _)| piece).collect();
            gather(&mut pieces, fine, &mut balls);
            around.resize(balls.len(), number as u32);
        }
        around.iter_mut().for_each(|number| *number += balls.len() as u32);
        balls.append(&mut large);
        Clusters { balls, around }
    }

    /// How many fine ones there are; theirs are the first numbers.
    pub(super) fn n_fine(&self) -> u32 {
        self.around.len() as u32
    }

    /// The number of the coarse one around a fine one.
    pub(super) fn around(&self, fine: u32) -> u32 {
        self.around[fine as usize]
    }

    /// From now on no points are asked for.
    pub(super) fn forget_pieces(&mut self) {
        self.balls.iter_mut().for_each(|ball| ball.pieces = Vec::new());
    }
}

impl Index<u32> for Clusters {
    type Output = Cluster;

    #[inline]
    fn index(&self, number: u32) -> &Cluster {
        &self.balls[number as usize]
    }
}

/// Cuts a piece into quarters until they fit into balls of a radius.
fn cut(mesh: &Mesh, (triangle, corners): (u32, [Vec2; 3]), most: f32, pieces: &mut Vec<Piece>) {
    let [origin, b, c] = mesh.corners(triangle);
    let at = |uv: Vec2| origin + (b - origin) * uv.x + (c - origin) * uv.y;
    let points = corners.map(at);
    let center = (points[0] + points[1] + points[2]) / 3.0;
    let radius = points.iter().map(|p| p.distance(center)).fold(0.0, f32::max);
    let area = 0.5 * (points[1] - points[0]).cross(points[2] - points[0]).length();
    if radius > most && pieces.len() < MOST_PIECES {
        let [a, b, c] = corners;
        let [ab, bc, ca] = [(a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5];
        for corners in [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]] {
            cut(mesh, (triangle, corners), most, pieces);
        }
    } else if area > 0.0 && radius.is_finite() {
        pieces.push(Piece { triangle, corners, center, radius, area });
    }
}

/// Halves pieces across the longest side of their box until each half fits into a ball of a radius.
fn gather(pieces: &mut [Piece], most: f32, clusters: &mut Vec<Cluster>) {
    if pieces.is_empty() {
        return;
    }
    let low = pieces.iter().map(|piece| piece.center).fold(Vec3::INFINITY, Vec3::min);
    let high = pieces.iter().map(|piece| piece.center).fold(Vec3::NEG_INFINITY, Vec3::max);
    let center = (low + high) * 0.5;
    let radius = pieces.iter().map(|piece| piece.center.distance(center) + piece.radius).fold(0.0, f32::max);
    if pieces.len() > 1 && radius > most && low != high {
        let sides = high - low;
        let axis = (0..3).fold(0, |longest, axis| if sides[axis] > sides[longest] { axis } else { longest });
        let middle = pieces.len() / 2;
        pieces.select_nth_unstable_by(middle, |a, b| {
            a.center[axis].total_cmp(&b.center[axis]).then(a.triangle.cmp(&b.triangle))
        });
        let (left, right) = pieces.split_at_mut(middle);
        gather(left, most, clusters);
        gather(right, most, clusters);
        return;
    }
    let area: f32 = pieces.iter().map(|piece| piece.area).sum();
    let mut sum = 0.0;
    let with_sum = |piece: &Piece| {
        sum += piece.area / area;
        (*piece, sum)
    };
    clusters.push(Cluster { center, radius, area, pieces: pieces.iter().map(with_sum).collect() });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampler::uniform_hash;

    /// A square of a meter in 2·n² triangles.
    fn square(n: u32) -> Mesh {
        let at = |i: u32| i as f32 / n as f32;
        let corner = |i: u32, j: u32| j * (n + 1) + i;
        let positions = (0..=n).flat_map(|j| (0..=n).map(move |i| Vec3::new(at(i), at(j), 0.0))).collect();
        let halves = |(i, j): (u32, u32)| {
            let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
            [[a, b, c], [a, c, d]]
        };
        let triangles = (0..n).flat_map(|j| (0..n).map(move |i| (i, j))).flat_map(halves).collect();
        Mesh { positions, triangles, ..Mesh::default() }
    }

    #[test]
    fn clusters_are_of_about_one_size_however_fine_the_mesh_and_cover_its_area() {
        for n in [1, 7, 64] {
            let mesh = square(n);
            let all: Vec<u32> = (0..mesh.triangles.len() as u32).collect();
            let clusters = Clusters::of(&mesh, &all);
            let (fine, coarse) = clusters.balls.split_at(clusters.n_fine() as usize);
            assert!((2048..32768).contains(&fine.len()), "{n}: {}", fine.len());
            assert!((32..512).contains(&coarse.len()), "{n}: {}", coarse.len());
            for level in [fine, coarse] {
                let area: f32 = level.iter().map(|cluster| cluster.area).sum();
                assert!((area - 1.0).abs() < 1e-3, "{n}: {area} m²");
            }
            for (number, cluster) in fine.iter().enumerate().step_by(64) {
                let around = &clusters[clusters.around(number as u32)];
                assert!(cluster.center.distance(around.center) <= around.radius);
                for i in 0..16 {
                    let (triangle, uv) = cluster.point(uniform_hash(3 * i), [1, 2].map(|k| uniform_hash(3 * i + k)));
                    let [a, b, c] = mesh.corners(triangle);
                    let point = a + (b - a) * uv.x + (c - a) * uv.y;
                    assert!(point.distance(cluster.center) <= cluster.radius * 1.0001, "{point} of {cluster:?}");
                }
            }
        }
    }

    #[test]
    fn surfaces_without_an_area_make_no_cluster() {
        let mesh = Mesh { positions: vec![Vec3::ZERO; 3], triangles: vec![[0, 1, 2]], ..Mesh::default() };
        assert_eq!(Clusters::of(&mesh, &[0]).n_fine(), 0);
        assert_eq!(Clusters::of(&mesh, &[]).n_fine(), 0);
    }

    #[test]
    fn directions_stay_in_the_cone_with_the_density_that_is_told() {
        let ball = |radius| Cluster { center: Vec3::new(0.0, 0.0, 2.0), radius, area: 1.0, pieces: Vec::new() };
        for radius in [1e-3, 0.3, 1.9] {
            let cluster = ball(radius);
            let drawn = |i: u64| cluster.direction(Vec3::ZERO, [uniform_hash(2 * i), uniform_hash(2 * i + 1)]);
            let directions: Vec<Vec3> = (0..4096).filter_map(drawn).collect();
            assert!(directions.len() > 4088, "{radius}: but for rounding all directions are in the cone");
            assert!(directions.iter().all(|direction| (direction.length() - 1.0).abs() < 1e-5));
            // The density is one over the solid angle of the cap.
            let cos = (1.0 - f64::from(radius).powi(2) / 4.0).sqrt();
            let solid_angle = std::f64::consts::TAU * (1.0 - cos);
            let told = 1.0 / f64::from(cluster.pdf(Vec3::ZERO, Vec3::Z));
            assert!((told / solid_angle - 1.0).abs() < 1e-3, "{radius}: {told} sr are {solid_angle}");
        }
        assert_eq!(ball(3.0).direction(Vec3::ZERO, [0.5; 2]), None);
        assert_eq!(ball(3.0).pdf(Vec3::ZERO, Vec3::Z), 0.0);
    }

    #[test]
    fn every_direction_to_a_small_ball_far_away_has_a_density() {
        let toward = Vec3::new(0.5, 0.3, 0.8).normalize();
        for (distance, radius) in [(10.0, 1e-3), (100.0, 1e-3), (1000.0, 0.01)] {
            let cluster = Cluster { center: toward * distance, radius, area: 1.0, pieces: Vec::new() };
            let drawn = |i: u64| cluster.direction(Vec3::ZERO, [uniform_hash(2 * i), uniform_hash(2 * i + 1)]);
            let directions: Vec<Vec3> = (0..4096).filter_map(drawn).collect();
            assert!(directions.len() > 4000, "{distance} m away {} of 4096 are in the cone", directions.len());
            let has_density = |direction: &Vec3| cluster.pdf(Vec3::ZERO, *direction) > 0.0;
            assert!(directions.iter().all(has_density), "{distance} m away");
        }
    }
}
