//! Sensor grids: points on a plane where a designer wants to know the light that arrives.
//!
//! A grid is laid on a rectangle of the scene, or level over its plan as a work plane. Points lie in the middle of the cells
//! of the grid, as \[EN12464\] asks, and look to the front of the plane.

mod inside;
mod plan;

use glam::Vec3;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::clearance::clearance;
use crate::path::Receiver;
use crate::prepared::PreparedScene;

pub use plan::{IrradianceRequest, NodeGrid, OfFile, WorkPlane, floor_area_m2, node_floor_area_m2};

/// Points of a rectangle, row by row: point (i, j), i along u, is number `j · size[0] + i`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SensorGrid {
    /// Name of the node, or of the work plane.
    pub name: String,
    /// Corner at the first point, world space in meters.
    pub origin: Vec3,
    /// Side along u in meters.
    pub u_edge: Vec3,
    /// Side along v in meters.
    pub v_edge: Vec3,
    /// Unit normal of the front, from where light counts.
    pub normal: Vec3,
    /// Points along u and v.
    pub size: [u32; 2],
    /// Numbers of points that are not measured, ascending: those of a work plane that stand on no floor.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub left_out: Vec<u32>,
}

/// Why no grid can be laid as asked.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SensorError {
    /// A grid was asked for on a node that does not exist.
    #[error("no node with a surface is named `{node}`; there are: {known}")]
    UnknownNode {
        /// Name asked for.
        node: String,
        /// Names that exist.
        known: String,
    },
    /// A grid was asked for on something that is not a rectangle.
    #[error("node `{node}` cannot carry sensors: {reason}; model it as one planar quad")]
    NotAQuad {
        /// Name of the node.
        node: String,
        /// What is wrong with its shape.
        reason: &'static str,
    },
    /// A node was named twice.
    #[error("sensors are asked for twice on the node `{node}`; give it one size")]
    Twice {
        /// Name asked for.
        node: String,
    },
    /// The grid would be empty or absurdly large.
    #[error("the sensors of `{name}` cannot be {} × {}; give 1 to {max} points a side, {all} in all", size[0], size[1],
        max = SensorGrid::MAX_SIDE, all = SensorGrid::MAX_POINTS)]
    Size {
        /// Name of the grid.
        name: String,
        /// Points a side.
        size: [u32; 2],
    },
    /// All grids together would be absurdly large.
    #[error("{n_points} sensor points are too many; ask for at most {max} in all", max = SensorGrid::MAX_POINTS)]
    TooMany {
        /// Points of all grids together.
        n_points: usize,
    },
    /// A work plane was asked for over something that nobody can stand on.
    #[error("`{node}` has no surface that faces up, so no work plane stands on it; choose another floor")]
    NoFloor {
        /// Name of the node.
        node: String,
    },
    /// The scene is upright and thin.
    #[error("the scene covers no ground, so it has no work plane; lay sensors on a node instead")]
    NoPlan,
}

impl SensorGrid {
    /// Most points along a side.
    pub const MAX_SIDE: u32 = 4096;
    /// Most points of all grids of a bake together.
    pub const MAX_POINTS: usize = 1 << 20;

    /// On the rectangle that two triangles form; it starts at the first corner of the first one, and v follows u as seen
    /// from the front.
    ///
    /// # Errors
    /// What is wrong with the shape, in words.
    pub fn on_quad(name: &str, triangles: &[[Vec3; 3]], size: [u32; 2]) -> Result<SensorGrid, &'static str> {
        let &[first, second] = triangles else { return Err("its surface is not a single quad") };
        let (opposite, fourth) = parallelogram(first, second)?;
        let [a, b, c] = first;
        let (u_end, v_end) = match opposite {
            0 => (b, c),
            1 => (b, fourth),
            _ => (fourth, c),
        };
        let (u_edge, v_edge) = (u_end - a, v_end - a);
        if u_edge.dot(v_edge).abs() > 1e-2 * u_edge.length() * v_edge.length() {
            return Err("its quad is not a rectangle");
        }
        let normal = u_edge.cross(v_edge).try_normalize().ok_or("its quad has no area")?;
        Ok(SensorGrid { name: name.into(), origin: a, u_edge, v_edge, normal, size, left_out: Vec::new() })
    }

    /// Points of the grid, measured or not.
    pub fn n_points(&self) -> usize {
        self.size[0] as usize * self.size[1] as usize
    }

    /// Where a point is, world space in meters; `None` if it is not measured.
    pub fn point(&self, number: u32) -> Option<Vec3> {
        let [nu, nv] = self.size;
        let measured = number < nu * nv && self.left_out.binary_search(&number).is_err();
        let along = |nth: u32, n: u32| (nth as f32 + 0.5) / n as f32;
        measured.then(|| self.origin + self.u_edge * along(number % nu, nu) + self.v_edge * along(number / nu, nv))
    }

    /// What light arrives at there; `None` if it is not measured. A surface as large as the grid may lie in its plane.
    pub(crate) fn receiver(&self, number: u32) -> Option<Receiver> {
        let clearance = clearance(self.u_edge, self.v_edge, self.u_edge.cross(self.v_edge));
        self.point(number).map(|position| Receiver::on_plane(position, self.normal, clearance))
    }

    /// Where rays to the front of a point begin, off a surface that it lies on; `None` if it is not measured.
    fn lifted(&self, scene: &PreparedScene, number: u32) -> Option<Vec3> {
        self.receiver(number).map(|receiver| receiver.origin(scene))
    }

    /// Whether the rest of the program can trust it.
    pub(crate) fn check(&self) -> Result<(), SensorError> {
        let fits = self.size.iter().all(|side| (1..=SensorGrid::MAX_SIDE).contains(side));
        if !fits || self.n_points() > SensorGrid::MAX_POINTS {
            return Err(SensorError::Size { name: self.name.clone(), size: self.size });
        }
        let finite = [self.origin, self.u_edge, self.v_edge].iter().all(|v| v.is_finite());
        if !finite || (self.normal.length() - 1.0).abs() > 1e-3 || !self.left_out.is_sorted() {
            return Err(SensorError::NotAQuad { node: self.name.clone(), reason: "its numbers make no plane" });
        }
        Ok(())
    }
}

/// The corner of the first triangle that lies opposite the fourth corner of the parallelogram which two triangles form, and
/// that fourth corner.
pub(crate) fn parallelogram(first: [Vec3; 3], second: [Vec3; 3]) -> Result<(usize, Vec3), &'static str> {
    let scale = (first[1] - first[0]).length().max((first[2] - first[0]).length());
    let near = |a: Vec3, b: Vec3| (a - b).length() <= 1e-4 * scale;
    // The corner of the second triangle that the first does not have lies opposite the corner that is not shared.
    let fourth = second.into_iter().find(|q| !first.iter().any(|p| near(*q, *p)));
    let fourth = fourth.ok_or("its two triangles do not form a quad")?;
    let opposite = (0..3).find(|&i| near(first[(i + 1) % 3] + first[(i + 2) % 3] - first[i], fourth));
    Ok((opposite.ok_or("its quad is not a parallelogram")?, fourth))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_grid_starts_at_the_first_corner_and_looks_to_the_front() {
        let [a, b, c, d] = [Vec3::ZERO, Vec3::X * 4.0, Vec3::new(4.0, 0.0, -2.0), Vec3::NEG_Z * 2.0];
        for triangles in [[[a, b, c], [a, c, d]], [[a, b, d], [b, c, d]], [[a, c, d], [c, a, b]]] {
            let grid = SensorGrid::on_quad("table", &triangles, [4, 2]).unwrap();
            assert_eq!((grid.origin, grid.normal), (a, Vec3::Y));
            assert_eq!((grid.u_edge, grid.v_edge), (b - a, d - a));
            assert_eq!(grid.point(0), Some(Vec3::new(0.5, 0.0, -0.5)));
            assert_eq!(grid.point(7), Some(Vec3::new(3.5, 0.0, -1.5)));
            assert_eq!(grid.point(8), None);
        }
        let turned = SensorGrid::on_quad("table", &[[a, c, b], [a, d, c]], [4, 2]).unwrap();
        assert_eq!(turned.normal, Vec3::NEG_Y);
    }

    #[test]
    fn what_is_no_rectangle_carries_no_sensors() {
        let [a, b, c] = [Vec3::ZERO, Vec3::X, Vec3::Y];
        let asked = |triangles: &[[Vec3; 3]]| SensorGrid::on_quad("x", triangles, [2, 2]).unwrap_err();
        assert!(asked(&[[a, b, c]]).contains("single quad"));
        assert!(asked(&[[a, b, c], [b, Vec3::new(3.0, 1.0, 0.0), c]]).contains("parallelogram"));
        let slanted = b + Vec3::new(0.5, 1.0, 0.0);
        assert!(asked(&[[a, b, slanted], [a, slanted, slanted - b]]).contains("rectangle"));
    }
}
