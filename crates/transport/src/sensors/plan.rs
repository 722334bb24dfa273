//! From what a designer asks for to the rows of a bake.

use std::collections::BTreeMap;

use glam::{Vec2, Vec3};

use super::inside::points_inside;
use super::{SensorError, SensorGrid};
use crate::basis::KeyMaker;
use crate::bvh::Ray;
use crate::irradiance::IrradianceRows;
use crate::prepared::PreparedScene;
use crate::sampler::Sampler;
use crate::scene::{Mesh, Scene, SceneNode};

/// Irradiance that a designer asks for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct IrradianceRequest {
    /// Which rows come without being named.
    pub of_file: OfFile,
    /// Grids on nodes.
    pub nodes: Vec<NodeGrid>,
    /// Level grids over the whole plan.
    pub work_planes: Vec<WorkPlane>,
}

/// What is measured without a name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OfFile {
    /// Nothing.
    #[default]
    Nothing,
    /// The pixels, and the grids that the file asks for.
    All,
}

/// A grid on the rectangle of a node.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NodeGrid {
    /// Name of the node, or `node:INDEX`.
    pub node: String,
    /// Points along u and v.
    pub size: [u32; 2],
}

/// A level grid that looks up, over the plan of the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorkPlane {
    /// Meters above the floor.
    pub height_m: f32,
    /// Meters between points; `None` is as \[EN12464\] spaces them.
    pub spacing_m: Option<f32>,
    /// Index of the node in the scene whose surface is the floor; `None` is the floor of the whole scene, over all of its plan.
    pub floor: Option<u32>,
}

impl IrradianceRequest {
    /// The rows of a bake, pixels first.
    ///
    /// # Errors
    /// A grid that the scene cannot carry, or more points than anybody can want.
    pub fn rows(&self, scene: &PreparedScene) -> Result<Vec<IrradianceRows>, SensorError> {
        let mut grids = Vec::new();
        for (nth, request) in self.nodes.iter().enumerate() {
            if self.nodes[..nth].iter().any(|other| other.node == request.node) {
                return Err(SensorError::Twice { node: request.node.clone() });
            }
            grids.push(node_grid(&scene.scene, request)?);
        }
        if self.of_file == OfFile::All {
            let named = |grid: &&SensorGrid| self.nodes.iter().any(|request| request.node == grid.name);
            grids.extend(scene.scene.sensors.iter().filter(|grid| !named(grid)).cloned());
        }
        for plane in &self.work_planes {
            grids.push(work_plane(scene, *plane)?);
        }
        let mut keys = KeyMaker::default();
        for grid in &mut grids {
            grid.name = keys.key(Some(&grid.name), 0);
            grid.check()?;
        }
        let n_points = grids.iter().map(SensorGrid::n_points).sum();
        if n_points > SensorGrid::MAX_POINTS {
            return Err(SensorError::TooMany { n_points });
        }
        let pixels = (self.of_file == OfFile::All).then_some(IrradianceRows::Pixels);
        Ok(pixels.into_iter().chain(grids.into_iter().map(IrradianceRows::Grid)).collect())
    }
}

/// A grid that the file marks takes another size; any other node stays the surface that it is.
fn node_grid(scene: &Scene, request: &NodeGrid) -> Result<SensorGrid, SensorError> {
    if let Some(grid) = scene.sensors.iter().find(|grid| grid.name == request.node) {
        return Ok(SensorGrid { size: request.size, ..grid.clone() });
    }
    let mut of_node: BTreeMap<u32, Vec<[Vec3; 3]>> = BTreeMap::new();
    for (triangle, &node) in (0u32..).zip(&scene.mesh.triangle_node) {
        of_node.entry(node).or_default().push(scene.mesh.corners(triangle));
    }
    let is_asked = |node: u32| scene.nodes[node as usize].is_named(&request.node);
    let Some(triangles) = of_node.iter().find(|(node, _)| is_asked(**node)) else {
        let nodes = of_node.keys().map(|&node| scene.nodes[node as usize].key());
        let known: Vec<String> = scene.sensors.iter().map(|grid| grid.name.clone()).chain(nodes).take(20).collect();
        let known = if known.is_empty() { "none".into() } else { known.join(", ") };
        return Err(SensorError::UnknownNode { node: request.node.clone(), known });
    };
    let not_a_quad = |reason| SensorError::NotAQuad { node: request.node.clone(), reason };
    SensorGrid::on_quad(&request.node, triangles.1, request.size).map_err(not_a_quad)
}

fn work_plane(scene: &PreparedScene, plane: WorkPlane) -> Result<SensorGrid, SensorError> {
    let mesh = &scene.scene.mesh;
    let Site { low, plan, floor_m, triangles } = match plane.floor {
        Some(node) => Site::on(&scene.scene, node)?,
        None => Site::of_scene(mesh)?,
    };
    let spacing_m = plane.spacing_m.unwrap_or_else(|| standard_spacing(plan));
    // As many as the standard counts, the nearest whole number; far too many are refused by the check of the grid.
    let size = plan.to_array().map(|side| ((side / spacing_m).round() as u32).max(1));
    let mut grid = SensorGrid {
        name: name(&scene.scene, plane),
        origin: Vec3::new(low.x, floor_m + plane.height_m, low.y),
        u_edge: Vec3::X * plan.x,
        v_edge: Vec3::Z * plan.y,
        normal: Vec3::Y,
        size,
        left_out: Vec::new(),
    };
    grid.check()?;
    let all = 0..grid.n_points() as u32;
    // Asked where rays begin: of a plane on the floor itself rounding brings points below it.
    let is_over = |point: Vec3| triangles.is_empty() || triangles.iter().any(|corners| is_below(corners, point));
    let stands = |point: Vec3| is_over(point) && stands_on_a_floor(scene, point);
    let inside = points_inside(scene, &grid);
    let hangs =
        |number: &u32| inside.contains(number) || grid.lifted(scene, *number).is_some_and(|point| !stands(point));
    let left_out: Vec<u32> = all.filter(hangs).collect();
    // A scene whose floor is missing or turned round is measured all over.
    if left_out.len() < grid.n_points() {
        grid.left_out = left_out;
    }
    Ok(grid)
}

/// Where a work plane stands.
struct Site {
    /// Least x and z in meters.
    low: Vec2,
    /// Extent along x and z in meters; more than 0.
    plan: Vec2,
    /// Height of the floor in meters.
    floor_m: f32,
    /// Corners of the triangles that are the floor; none where every surface below is one.
    triangles: Vec<[Vec3; 3]>,
}

impl Site {
    /// The plan of all surfaces.
    fn of_scene(mesh: &Mesh) -> Result<Site, SensorError> {
        let (low, high) = mesh.bounds().ok_or(SensorError::NoPlan)?;
        let plan = Vec2::new(high.x - low.x, high.z - low.z);
        if plan.min_element() <= 0.0 {
            return Err(SensorError::NoPlan);
        }
        let floor_m = floor(mesh, |_| true).map_or(low.y, |level| level.height_m());
        Ok(Site { low: Vec2::new(low.x, low.z), plan, floor_m, triangles: Vec::new() })
    }

    /// The floor among the surfaces of a node.
    fn on(scene: &Scene, node: u32) -> Result<Site, SensorError> {
        let mesh = &scene.mesh;
        let no_floor = || SensorError::NoFloor {
            node: scene.nodes.get(node as usize).map_or_else(|| format!("node:{node}"), SceneNode::key),
        };
        let level = floor(mesh, |triangle| mesh.triangle_node[triangle as usize] == node).ok_or_else(no_floor)?;
        let triangles: Vec<[Vec3; 3]> = level.triangles.iter().map(|triangle| mesh.corners(*triangle)).collect();
        let corners = || triangles.iter().flatten().map(|corner| Vec2::new(corner.x, corner.z));
        let low = corners().fold(Vec2::INFINITY, Vec2::min);
        let plan = corners().fold(Vec2::NEG_INFINITY, Vec2::max) - low;
        if plan.min_element() <= 0.0 {
            return Err(no_floor());
        }
        Ok(Site { low, plan, floor_m: level.height_m(), triangles })
    }
}

/// Whether a triangle that faces up lies straight below or above a point.
pub(super) fn is_below(corners: &[Vec3; 3], point: Vec3) -> bool {
    let [a, b, c] = corners.map(|corner| Vec2::new(corner.x, corner.z));
    let p = Vec2::new(point.x, point.z);
    let sides = [(a, b), (b, c), (c, a)].map(|(from, to)| (to - from).perp_dot(p - from));
    sides.iter().all(|side| *side <= 0.0) || sides.iter().all(|side| *side >= 0.0)
}

fn name(scene: &Scene, plane: WorkPlane) -> String {
    let node = plane.floor.and_then(|node| scene.nodes.get(node as usize));
    let over = node.map_or(String::new(), |node| format!(" over {}", node.key()));
    format!("work plane {} m{over}", plane.height_m)
}

/// Directions of six in which a point inside of something looks at backs: a cupboard in a corner may share its bottom, its
/// back, and a side with the room.
const BACKS_INSIDE: usize = 3;

/// Whether there is a surface below a point, and no single-sided wall or block around it.
fn stands_on_a_floor(scene: &PreparedScene, point: Vec3) -> bool {
    let first = |direction: Vec3| {
        let ray = Ray { origin: point, direction, t_min: 0.0, t_max: f32::INFINITY };
        scene.closest(&ray, &mut Sampler::new(0, 0, 0))
    };
    let shows_its_back = |direction: &Vec3| {
        let hit = first(*direction).filter(|hit| !scene.material(hit.triangle).double_sided);
        hit.is_some_and(|hit| hit.normal.dot(*direction) > 0.0)
    };
    let axes = Vec3::AXES.into_iter().flat_map(|axis| [axis, -axis]);
    first(Vec3::NEG_Y).is_some() && axes.filter(shows_its_back).count() < BACKS_INSIDE
}

/// Meters between points for an area of two sides: 0.2 · 5^lg d, at most 10 m; d is the longer side, the shorter one of an
/// area twice as long as wide. \[EN12464\]
fn standard_spacing(sides: Vec2) -> f32 {
    let (longer, shorter) = (sides.max_element(), sides.min_element());
    let side = if longer >= 2.0 * shorter { shorter } else { longer };
    (0.2 * 5f32.powf(side.log10())).min(10.0)
}

/// Area of the floor in m², as far as it is one level.
pub fn floor_area_m2(scene: &Scene) -> Option<f32> {
    floor(&scene.mesh, |_| true).map(|level| level.area_m2())
}

/// The same of a node alone; none where nothing of it faces up.
pub fn node_floor_area_m2(scene: &Scene, node: u32) -> Option<f32> {
    let is_of_node = |triangle: u32| scene.mesh.triangle_node[triangle as usize] == node;
    floor(&scene.mesh, is_of_node).map(|level| level.area_m2())
}

/// Surfaces of one height that face up.
#[derive(Default)]
struct Level {
    /// Twice the area in m².
    twice_m2: f64,
    /// That times the height in meters.
    moment: f64,
    triangles: Vec<u32>,
}

impl Level {
    fn area_m2(&self) -> f32 {
        (0.5 * self.twice_m2) as f32
    }

    fn height_m(&self) -> f32 {
        (self.moment / self.twice_m2) as f32
    }
}

/// Heights that are one level, m, and over the diagonal of the scene: in a model of centimeters tables are less than one high.
const LEVEL_M: f64 = 0.01;
const LEVEL_OF_EXTENT: f64 = 4e-3;

/// The floor among some triangles: the lowest level of surfaces that face up with at least half the area of the largest level.
fn floor(mesh: &Mesh, is_of: impl Fn(u32) -> bool) -> Option<Level> {
    let (low, high) = mesh.bounds()?;
    let level_m = LEVEL_M.min(LEVEL_OF_EXTENT * f64::from(low.distance(high)));
    let mut levels: BTreeMap<i64, Level> = BTreeMap::new();
    for triangle in (0..mesh.triangles.len() as u32).filter(|triangle| is_of(*triangle)) {
        let normal = mesh.area_normal(triangle);
        if normal.y > 0.99 * normal.length() {
            let height = mesh.corners(triangle).iter().map(|corner| f64::from(corner.y)).sum::<f64>() / 3.0;
            let level = levels.entry((height / level_m).round() as i64).or_default();
            level.twice_m2 += f64::from(normal.y);
            level.moment += f64::from(normal.y) * height;
            level.triangles.push(triangle);
        }
    }
    let largest = levels.values().map(|level| level.twice_m2).fold(0.0, f64::max);
    levels.into_values().find(|level| level.twice_m2 >= 0.5 * largest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_spaced_as_the_standard_asks() {
        // The table of the standard: 1 m every 0.2 m, 10 m every meter, 100 m every 5 m.
        for (sides, spacing) in [([1.0, 0.9], 0.2), ([10.0, 8.0], 1.0), ([100.0, 60.0], 5.0), ([100.0, 10.0], 1.0)] {
            let asked = standard_spacing(Vec2::from(sides));
            assert!((asked - spacing).abs() < 1e-4, "{asked} m for {sides:?}");
        }
        assert_eq!(standard_spacing(Vec2::splat(5000.0)), 10.0);
    }

    #[test]
    fn in_a_model_of_centimeters_a_table_is_no_floor() {
        let quad =
            |side: f32, y: f32| [[0.0, 0.0], [0.0, side], [side; 2], [side, 0.0]].map(|[x, z]| Vec3::new(x, y, z));
        for scale in [0.01, 1.0] {
            let mesh = Mesh {
                positions: [quad(4.0, 0.0), quad(3.0, 0.45)]
                    .concat()
                    .into_iter()
                    .map(|corner| corner * scale)
                    .collect(),
                normals: vec![Vec3::Y; 8],
                triangles: vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]],
                triangle_material: vec![0; 4],
                triangle_node: vec![0; 4],
                ..Mesh::default()
            };
            let scene = Scene { mesh, ..Scene::default() };
            let area_m2 = floor_area_m2(&scene).expect("a floor");
            assert!((area_m2 / (16.0 * scale * scale) - 1.0).abs() < 1e-4, "{area_m2} m² at {scale}");
        }
    }

    #[test]
    fn the_floor_of_a_room_is_as_large_as_it_is() {
        let room = include_str!("../../../editor/tests/room.gltf");
        let scene = crate::import::load_bytes("room", room.as_bytes()).expect("a scene").scene;
        // Two meters a side.
        let is_floor = |area: Option<f32>| area.is_some_and(|area| (area - 4.0).abs() < 1e-4);
        assert!(is_floor(floor_area_m2(&scene)));
        let room = scene.nodes.iter().position(|node| node.name.as_deref() == Some("room")).expect("the room") as u32;
        assert!(is_floor(node_floor_area_m2(&scene, room)));
        assert_eq!(node_floor_area_m2(&scene, scene.nodes.len() as u32), None);
    }
}
