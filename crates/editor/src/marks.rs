//! Marked pixels of a picture: a rectangle, a stroke of a brush, or the surface that is seen there, with the area that each
//! pixel stands for.

use std::sync::Arc;

use clerestory_transport::bvh::Ray;
use clerestory_transport::camera::{Camera, Film};
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::sampler::Sampler;
use clerestory_transport::scene::SceneNode;
use glam::UVec2;
use rayon::prelude::*;

use crate::session::views::sees_alike;

/// Clear panes that a pixel looks through.
const MOST_PANES: usize = 16;
/// Least cosine between a surface and the view; flatter ones count as this steep.
const LEAST_COSINE: f32 = 0.02;
/// Where a pixel sees no surface.
const NOTHING: u32 = u32::MAX;

/// The picture that something was marked in: its size, and where it is seen from. Pictures that were taken have no camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Framing {
    /// Size of the picture.
    pub film: Film,
    /// Where it is seen from, as far as that is known.
    pub camera: Option<Camera>,
}

impl Framing {
    /// Whether what was marked here means the same there: in the same view, at whatever size it is baked.
    pub fn fits(&self, shown: &Framing) -> bool {
        let height = shown.film.width as f32 * self.film.height as f32 / self.film.width.max(1) as f32;
        let cameras = self.camera.as_ref().zip(shown.camera.as_ref());
        cameras.is_none_or(|(own, other)| sees_alike(own, other)) && (height - shown.film.height as f32).abs() <= 1.0
    }
}

/// Marks of one picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Marked {
    /// The picture.
    pub framing: Framing,
    /// What is marked in it.
    pub marks: Arc<Marks>,
}

impl Marked {
    /// The same marks in the picture that is shown; none if that is of another view.
    pub fn on(&self, shown: &Framing) -> Option<Arc<Marks>> {
        let is_same = self.marks.film == shown.film;
        let resized = || if is_same { self.marks.clone() } else { Arc::new(self.marks.resized(shown.film)) };
        self.framing.fits(shown).then(resized)
    }
}

/// Probes that stay in one picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Probed {
    /// The picture.
    pub framing: Framing,
    /// Pixels from its top left corner.
    pub pixels: Vec<[u32; 2]>,
}

impl Probed {
    /// The same places in the picture that is shown; none if that is of another view.
    pub fn on(&self, shown: &Framing) -> Option<Vec<[u32; 2]>> {
        let (own, other) = (self.framing.film, shown.film);
        let moved = |at: u32, from: u32, to: u32| {
            let at = (2 * u64::from(at) + 1) * u64::from(to) / (2 * u64::from(from.max(1)));
            at.min(u64::from(to.saturating_sub(1))) as u32
        };
        let move_all = |[x, y]: &[u32; 2]| [moved(*x, own.width, other.width), moved(*y, own.height, other.height)];
        self.framing.fits(shown).then(|| self.pixels.iter().map(move_all).collect())
    }
}

/// Pixels of a film, ascending, each once.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Marks {
    /// Size of the picture.
    pub film: Film,
    pixels: Vec<u32>,
}

impl Marks {
    /// None yet.
    pub fn new(film: Film) -> Marks {
        Marks { film, pixels: Vec::new() }
    }

    /// The pixels with their middles between two corners, in pixels from the top left, whichever is which.
    pub fn rect(film: Film, [a, b]: [[f32; 2]; 2]) -> Marks {
        let range = |axis: usize, side: u32| {
            let (low, high) = (a[axis].min(b[axis]), a[axis].max(b[axis]));
            let clamped = |edge: f32| (edge - 0.5).ceil().clamp(0.0, side as f32) as u32;
            clamped(low)..clamped(high)
        };
        let (across, down) = (range(0, film.width), range(1, film.height));
        let pixels = down.flat_map(|y| across.clone().map(move |x| y * film.width + x)).collect();
        Marks { film, pixels }
    }

    /// The pixels within a radius of a segment, in pixels from the top left.
    pub fn stroke(film: Film, [a, b]: [[f32; 2]; 2], radius: f32) -> Marks {
        let (a, b) = (glam::Vec2::from(a), glam::Vec2::from(b));
        let reach = glam::Vec2::splat(radius + 1.0);
        let mut marks = Marks::rect(film, [(a.min(b) - reach).to_array(), (a.max(b) + reach).to_array()]);
        let along = b - a;
        let is_near = |pixel: &u32| {
            let middle = glam::Vec2::new((pixel % film.width) as f32, (pixel / film.width) as f32) + 0.5;
            let t = ((middle - a).dot(along) / along.length_squared().max(1e-12)).clamp(0.0, 1.0);
            middle.distance(a + along * t) <= radius
        };
        marks.pixels.retain(is_near);
        marks
    }

    /// From numbers of pixels that are passed over and marked, in turns, row by row from the top left; none where they leave
    /// the film.
    pub fn of_runs(film: Film, runs: &[u32]) -> Option<Marks> {
        let (mut pixels, mut at) = (Vec::new(), 0u32);
        let n_pixels = u32::try_from(film.n_pixels()).ok()?;
        for (nth, run) in runs.iter().enumerate() {
            let end = at.checked_add(*run).filter(|end| *end <= n_pixels)?;
            if nth % 2 == 1 {
                pixels.extend(at..end);
            }
            at = end;
        }
        Some(Marks { film, pixels })
    }

    /// The same as numbers of pixels that are passed over and marked, in turns.
    pub fn runs(&self) -> Vec<u32> {
        let (mut runs, mut at) = (Vec::new(), 0);
        for run in self.pixels.chunk_by(|a, b| a + 1 == *b) {
            runs.extend([run[0] - at, run.len() as u32]);
            at = run[0] + run.len() as u32;
        }
        runs
    }

    /// The same parts of the picture at another size.
    pub fn resized(&self, film: Film) -> Marks {
        let mut is_marked = vec![false; self.film.n_pixels()];
        self.pixels.iter().for_each(|pixel| is_marked[*pixel as usize] = true);
        let from = |at: u32, own: u32, other: u32| (2 * u64::from(at) + 1) * u64::from(own) / (2 * u64::from(other));
        let marked = |pixel: &u32| {
            let x = from(pixel % film.width, self.film.width, film.width);
            let y = from(pixel / film.width, self.film.height, film.height);
            is_marked[(y * u64::from(self.film.width) + x) as usize]
        };
        Marks { film, pixels: (0..film.n_pixels() as u32).filter(marked).collect() }
    }

    /// All pixels that another set has are marked as well.
    pub fn add(&mut self, other: &Marks) {
        self.pixels.extend(&other.pixels);
        self.pixels.sort_unstable();
        self.pixels.dedup();
    }

    /// No pixel that another set has stays marked.
    pub fn remove(&mut self, other: &Marks) {
        self.pixels.retain(|pixel| other.pixels.binary_search(pixel).is_err());
    }

    /// The pixels.
    pub fn pixels(&self) -> &[u32] {
        &self.pixels
    }

    /// The corners between which they lie, as shares of the picture's width and height; none if none is marked.
    pub fn corners(&self) -> Option<[[f32; 2]; 2]> {
        let places = self.pixels.iter().map(|pixel| UVec2::new(pixel % self.film.width, pixel / self.film.width));
        let (low, high) = places.map(|at| (at, at)).reduce(|(low, high), (at, _)| (low.min(at), high.max(at)))?;
        let share = |at: UVec2| (at.as_vec2() / UVec2::new(self.film.width, self.film.height).as_vec2()).to_array();
        Some([share(low), share(high + 1)])
    }

    /// Whether none is marked.
    pub fn is_empty(&self) -> bool {
        self.pixels.is_empty()
    }

    /// Whether a pixel is marked.
    pub fn holds(&self, pixel: u32) -> bool {
        self.pixels.binary_search(&pixel).is_ok()
    }
}

/// By what pixels of one surface belong together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kin {
    /// They see the same node of the scene.
    #[default]
    Node,
    /// They see the same material, wherever it is.
    Material,
}

/// What the middle of each pixel sees: straight on through clear panes, not in mirrors.
pub struct Seen {
    film: Film,
    nodes: Vec<u32>,
    materials: Vec<u32>,
    areas_m2: Vec<f32>,
}

impl Seen {
    /// Looks once along the middle of every pixel.
    pub fn new(scene: &PreparedScene, camera: &Camera, film: Film) -> Seen {
        // Side of a pixel on the plane at a distance of one.
        let side = 2.0 * (0.5 * camera.yfov_rad).tan() / film.height as f32;
        let forward = -camera.world_from_camera.z_axis.truncate();
        let look = |pixel: u32| {
            let middle = glam::Vec2::new((pixel % film.width) as f32, (pixel / film.width) as f32) + 0.5;
            let direction = camera.direction(film, middle);
            let solid_angle = side * side * direction.dot(forward).max(0.0).powi(3);
            let mut ray = Ray { origin: camera.position(), direction, t_min: 0.0, t_max: f32::INFINITY };
            for _ in 0..MOST_PANES {
                let Some(hit) = scene.closest_seen(&ray, &mut Sampler::new(0, u64::from(pixel), 0)) else { break };
                if scene.is_clear_pane(hit.triangle) {
                    ray.t_min = hit.t * (1.0 + 1e-5) + 1e-6;
                    continue;
                }
                let mesh = &scene.scene.mesh;
                let (node, material) =
                    (mesh.triangle_node[hit.triangle as usize], mesh.triangle_material[hit.triangle as usize]);
                let cosine = hit.normal.dot(direction).abs().max(LEAST_COSINE);
                return (node, (material, solid_angle * hit.t * hit.t / cosine));
            }
            (NOTHING, (NOTHING, 0.0))
        };
        let seen = (0..film.n_pixels() as u32).into_par_iter().map(look);
        let (nodes, (materials, areas_m2)) = seen.unzip();
        Seen { film, nodes, materials, areas_m2 }
    }

    /// The pixels that see the same as one does; none where it sees nothing.
    pub fn like(&self, pixel: u32, kin: Kin) -> Marks {
        let of = self.of(kin);
        match of.get(pixel as usize) {
            Some(&one) if one != NOTHING => self.of_number(one, kin),
            _ => Marks::new(self.film),
        }
    }

    /// The pixels that see nodes, or materials, of a name.
    pub fn named(&self, scene: &PreparedScene, name: &str, kin: Kin) -> Marks {
        let is_named = |number: u32| match kin {
            Kin::Node => scene.scene.nodes.get(number as usize).is_some_and(|node| node.is_named(name)),
            Kin::Material => scene.scene.materials.get(number as usize).is_some_and(|m| m.name == name),
        };
        let of = self.of(kin);
        let pixels = (0..of.len() as u32).filter(|&pixel| is_named(of[pixel as usize])).collect();
        Marks { film: self.film, pixels }
    }

    /// What a pixel sees, for people.
    pub fn name(&self, scene: &PreparedScene, pixel: u32, kin: Kin) -> Option<String> {
        let number = *self.of(kin).get(pixel as usize).filter(|number| **number != NOTHING)? as usize;
        match kin {
            Kin::Node => scene.scene.nodes.get(number).map(SceneNode::key),
            Kin::Material => scene.scene.materials.get(number).map(|material| material.name.clone()),
        }
    }

    /// Index in the scene of the node that a pixel sees.
    pub fn node(&self, pixel: u32) -> Option<u32> {
        self.nodes.get(pixel as usize).copied().filter(|node| *node != NOTHING)
    }

    /// Area of the surface that a pixel sees, m².
    pub fn area_m2(&self, pixel: u32) -> f32 {
        self.areas_m2.get(pixel as usize).copied().unwrap_or(0.0)
    }

    fn of(&self, kin: Kin) -> &[u32] {
        match kin {
            Kin::Node => &self.nodes,
            Kin::Material => &self.materials,
        }
    }

    fn of_number(&self, number: u32, kin: Kin) -> Marks {
        let of = self.of(kin);
        let pixels = (0..of.len() as u32).filter(|&pixel| of[pixel as usize] == number).collect();
        Marks { film: self.film, pixels }
    }
}

/// What each pixel counts in a mean, all together 1: by the area of surface that it sees where that is known, else alike.
pub fn weighed(pixels: &[u32], seen: Option<&Seen>) -> Vec<(u32, f32)> {
    let area = |pixel: u32| f64::from(seen.map_or(1.0, |seen| seen.area_m2(pixel)));
    // In double precision: beside the sum of millions of pixels the next one is nothing in single precision.
    let sum: f64 = pixels.iter().map(|pixel| area(*pixel)).sum();
    let alike = 1.0 / pixels.len().max(1) as f32;
    pixels.iter().map(|&pixel| (pixel, if sum > 0.0 { (area(pixel) / sum) as f32 } else { alike })).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILM: Film = Film { width: 10, height: 8 };

    #[test]
    fn rectangles_hold_the_pixels_whose_middles_they_hold() {
        let marks = Marks::rect(FILM, [[3.2, 1.0], [1.0, 2.6]]);
        assert_eq!(marks.pixels(), [11, 12, 21, 22]);
        assert_eq!(Marks::rect(FILM, [[-5.0, -5.0], [99.0, 99.0]]).pixels().len(), 80);
        assert!(Marks::rect(FILM, [[2.0, 2.0], [2.0, 5.0]]).is_empty());
    }

    #[test]
    fn strokes_add_and_take_away() {
        let mut marks = Marks::stroke(FILM, [[2.5, 3.5], [6.5, 3.5]], 1.0);
        let row: Vec<u32> = (31..=37).collect();
        assert!(row.iter().all(|pixel| marks.holds(*pixel)) && marks.holds(22) && !marks.holds(11));
        let n = marks.pixels().len();
        marks.add(&Marks::stroke(FILM, [[2.5, 3.5]; 2], 1.0));
        assert_eq!(marks.pixels().len(), n, "each pixel is there once");
        marks.remove(&Marks::rect(FILM, [[0.0, 0.0], [10.0, 8.0]]));
        assert!(marks.is_empty());
    }

    #[test]
    fn runs_come_back_as_the_same_pixels_and_never_leave_the_film() {
        for marks in [
            Marks::new(FILM),
            Marks::rect(FILM, [[0.0, 0.0], [10.0, 8.0]]),
            Marks::stroke(FILM, [[2.5, 3.5], [6.5, 6.5]], 1.5),
        ] {
            assert_eq!(Marks::of_runs(FILM, &marks.runs()), Some(marks));
        }
        assert_eq!(Marks::of_runs(FILM, &[70, 11]), None);
        assert_eq!(Marks::of_runs(FILM, &[u32::MAX, 3]), None);
    }

    #[test]
    fn marks_and_probes_fit_the_same_view_at_every_size_and_no_other() {
        let camera = |x: f32| Some(Camera::look_at("a", glam::Vec3::X * x, glam::Vec3::ZERO, 1.0, 1.25));
        let framing = |width, height, x| Framing { film: Film { width, height }, camera: camera(x) };
        let own = framing(10, 8, 1.0);
        let marked = Marked { framing: own.clone(), marks: Arc::new(Marks::rect(FILM, [[2.0, 2.0], [5.0, 4.0]])) };
        let twice = Film { width: 20, height: 16 };
        let larger = Marks::rect(twice, [[4.0, 4.0], [10.0, 8.0]]);
        assert_eq!(marked.on(&framing(20, 16, 1.0)).as_deref(), Some(&larger));
        assert_eq!(larger.resized(FILM), *marked.marks, "and back");
        let probed = Probed { framing: own, pixels: vec![[9, 7], [0, 3]] };
        assert_eq!(probed.on(&framing(20, 16, 1.0)), Some(vec![[19, 15], [1, 7]]));
        for other in [framing(10, 8, 2.0), framing(10, 5, 1.0)] {
            assert_eq!((marked.on(&other), probed.on(&other)), (None, None));
        }
        // Pictures that were taken, and bakes whose scene is not at hand, know no camera.
        assert!(marked.on(&Framing { film: FILM, camera: None }).is_some());
    }

    #[test]
    fn weights_are_shares_of_the_whole() {
        let seen = Seen {
            film: FILM,
            nodes: vec![0; 80],
            materials: vec![0; 80],
            areas_m2: (0..80).map(|i| i as f32).collect(),
        };
        assert_eq!(weighed(&[1, 3], Some(&seen)), [(1, 0.25), (3, 0.75)]);
        assert_eq!(weighed(&[0], Some(&seen)), [(0, 1.0)]);
        assert_eq!(weighed(&[1, 3], None), [(1, 0.5), (3, 0.5)]);
    }

    #[test]
    fn what_many_small_pixels_see_counts_beside_a_large_one() {
        // Together they see a 64th of what the first one does; each of them is lost beside that in single precision.
        let n_small = 400_000_usize;
        let small = 1.0 / (64.0 * n_small as f32);
        let areas_m2 = std::iter::once(1.0).chain(std::iter::repeat_n(small, n_small)).collect();
        let seen = Seen { film: FILM, nodes: Vec::new(), materials: Vec::new(), areas_m2 };
        let pixels: Vec<u32> = (0..=n_small as u32).collect();
        let weights = weighed(&pixels, Some(&seen));
        let all: f64 = weights.iter().map(|(_, weight)| f64::from(*weight)).sum();
        assert!((all - 1.0).abs() < 1e-4, "{all}");
        assert!((f64::from(weights[0].1) - 64.0 / 65.0).abs() < 1e-4, "{}", weights[0].1);
    }
}
