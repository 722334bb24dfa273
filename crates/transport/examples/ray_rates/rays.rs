//! Rays as a renderer follows them through a room: from the camera, on from where they met something, and towards a panel
//! of light under the ceiling.

use clerestory_transport::bvh::Ray;
use clerestory_transport::camera::{Camera, Film};
use clerestory_transport::clearance::offset_origin;
use clerestory_transport::sampler::Sampler;
use glam::{Vec2, Vec3};

use crate::exact;
use crate::trees::{Ours, Tree};

/// Segments end just before the panel.
const SEGMENT_END: f32 = 0.999;
/// Texels along each side of the panel; sixteen of a tile of 4 × 4 make a fan.
const TEXELS: usize = 8;
const TILE: usize = 4;

/// Pixels along each side of a square whose rays make a packet.
const SQUARE: u32 = 4;

/// Rays of one kind.
pub enum Question<'a> {
    Closest(&'a [Ray]),
    Packets(&'a [Packet]),
    Free(&'a [Ray]),
    Fans(&'a [Vec3], &'a [[Vec3; 16]]),
}

/// Rays of neighboring pixels.
pub struct Packet {
    origin: Vec3,
    directions: [Vec3; 16],
    /// So many of them.
    n: usize,
}

impl Packet {
    fn closest(&self, tree: &impl Tree) -> [f32; 16] {
        tree.closest16(self.origin, &self.directions, self.n)
    }

    /// The rays, one by one.
    fn rays(&self) -> impl Iterator<Item = Ray> {
        self.directions.iter().take(self.n).map(move |&direction| endless(self.origin, direction))
    }
}

impl Question<'_> {
    pub fn n_rays(&self) -> usize {
        match self {
            Question::Closest(rays) | Question::Free(rays) => rays.len(),
            Question::Packets(packets) => packets.iter().map(|packet| packet.n).sum(),
            Question::Fans(origins, tiles) => origins.len() * tiles.len() * 16,
        }
    }

    /// Asks for all of them; a digest of the answers, so that none is left out.
    pub fn ask(&self, tree: &impl Tree) -> f64 {
        match self {
            Question::Closest(rays) => {
                rays.iter().map(|ray| tree.closest(ray)).filter(|t| t.is_finite()).map(f64::from).sum()
            }
            Question::Packets(packets) => {
                let sum = |found: [f32; 16]| found.into_iter().filter(|t| t.is_finite()).map(f64::from).sum::<f64>();
                packets.iter().map(|packet| sum(packet.closest(tree))).sum()
            }
            Question::Free(rays) => rays.iter().filter(|ray| tree.is_free(ray)).count() as f64,
            Question::Fans(origins, tiles) => {
                let free = |origin: &Vec3, tile: &[Vec3; 16]| tree.free16(*origin, tile, SEGMENT_END).count_ones();
                origins
                    .iter()
                    .map(|origin| tiles.iter().map(|tile| free(origin, tile)).sum::<u32>())
                    .sum::<u32>()
                    .into()
            }
        }
    }

    /// What two trees answer otherwise, and who is right.
    pub fn settled(&self, one: &impl Tree, other: &impl Tree, triangles: &[[Vec3; 3]]) -> Settled {
        let mut settled = Settled::default();
        let is_free = |ray: &Ray| exact::closest(triangles, ray).is_infinite();
        let apart = rounding(triangles);
        // A hit and none are not the same, so the smaller counts.
        let same = |a: f64, b: f64| a == b || (a - b).abs() <= 1e-3 * a.min(b) + apart;
        match self {
            Question::Closest(rays) => {
                for ray in rays.iter() {
                    let told = [one.closest(ray), other.closest(ray)].map(f64::from);
                    settled.add(told, same, || exact::closest(triangles, ray));
                }
            }
            Question::Packets(packets) => {
                for packet in packets.iter() {
                    let [ones, others] = [packet.closest(one), packet.closest(other)];
                    for (ray, told) in packet.rays().zip(ones.into_iter().zip(others)) {
                        let told = [told.0, told.1].map(f64::from);
                        settled.add(told, same, || exact::closest(triangles, &ray));
                    }
                }
            }
            Question::Free(rays) => {
                for ray in rays.iter() {
                    settled.add([one.is_free(ray), other.is_free(ray)], |a, b| a == b, || is_free(ray));
                }
            }
            Question::Fans(origins, tiles) => {
                for (&origin, tile) in origins.iter().flat_map(|origin| tiles.iter().map(move |tile| (origin, tile))) {
                    let told = [one.free16(origin, tile, SEGMENT_END), other.free16(origin, tile, SEGMENT_END)];
                    for (nth, &target) in tile.iter().enumerate() {
                        let ray = Ray { t_max: SEGMENT_END, ..endless(origin, target - origin) };
                        settled.add(told.map(|bits| bits >> nth & 1 == 1), |a, b| a == b, || is_free(&ray));
                    }
                }
            }
        }
        settled
    }

    /// Rays that our tree answers otherwise in a packet than one by one, by a bit or more; `None` where there are no packets.
    pub fn n_other_than_single(&self, tree: &Ours) -> Option<usize> {
        let Question::Packets(packets) = self else { return None };
        let differ = |packet: &Packet| {
            let together = tree.0.closest16(packet.origin, &packet.directions, packet.n, 0.0, &[f32::INFINITY; 16]);
            packet.rays().zip(together).filter(|(ray, hit)| tree.0.closest(ray) != *hit).count()
        };
        Some(packets.iter().map(differ).sum())
    }
}

/// Steps of single precision at the corner farthest out that a hit may be off.
const ROUNDINGS: f32 = 8.0;

/// How far hits may lie apart because corners and origins are in single precision.
fn rounding(triangles: &[[Vec3; 3]]) -> f64 {
    let farthest = triangles.iter().flatten().map(|corner| corner.abs().max_element()).fold(0.0, f32::max);
    f64::from(ROUNDINGS * f32::EPSILON * farthest)
}

/// Rays that two trees answer otherwise, hits a thousandth apart, or within rounding, being the same.
#[derive(Default)]
pub struct Settled {
    pub n_differ: usize,
    /// Of these, what each tree answers other than all triangles do in double precision.
    pub n_wrong: [usize; 2],
}

impl Settled {
    fn add<T: Copy>(&mut self, told: [T; 2], same: impl Fn(T, T) -> bool, right: impl FnOnce() -> T) {
        if same(told[0], told[1]) {
            return;
        }
        self.n_differ += 1;
        let right = right();
        self.n_wrong.iter_mut().zip(told).for_each(|(wrong, told)| *wrong += usize::from(!same(told, right)));
    }
}

/// All rays that are asked for in one scene.
pub struct Rays {
    primary: Vec<Ray>,
    /// The same, in squares of pixels.
    packets: Vec<Packet>,
    bounce: Vec<Ray>,
    shadow: Vec<Ray>,
    fan_origins: Vec<Vec3>,
    tiles: Vec<[Vec3; 16]>,
}

/// A point that the camera sees, a little off its surface, and the normal towards the camera.
struct Seen {
    origin: Vec3,
    normal: Vec3,
}

impl Rays {
    /// About `n` of each kind. `tree` finds where they start.
    pub fn new(triangles: &[[Vec3; 3]], tree: &Ours, camera: &Camera, n: usize) -> Rays {
        let height = ((n as f64 * 0.75).sqrt() as u32).max(1);
        let film = Film { width: (n as u32 / height).max(1), height };
        let primary: Vec<Ray> = (0..film.n_pixels() as u32)
            .map(|index| {
                let pixel = Vec2::new((index % film.width) as f32, (index / film.width) as f32);
                let jitter = Vec2::from(Sampler::new(1, index.into(), 0).next_2d());
                endless(camera.position(), camera.direction(film, pixel + jitter))
            })
            .collect();
        let seen: Vec<Seen> = primary.iter().filter_map(|ray| seen(triangles, tree, ray)).collect();
        let bounce = seen.iter().enumerate().map(|(i, seen)| endless(seen.origin, scattered(seen.normal, i))).collect();
        let panel = panel(tree, camera, &seen);
        let corner = panel - Vec3::new(0.5, 0.0, 0.5);
        let faces_panel = |seen: &&Seen| seen.origin.y < panel.y && seen.normal.dot(panel - seen.origin) > 0.0;
        let facing: Vec<&Seen> = seen.iter().filter(faces_panel).collect();
        let shadow = facing.iter().enumerate().map(|(i, seen)| {
            let [u, v] = Sampler::new(3, i as u64, 0).next_2d();
            let direction = corner + Vec3::new(u, 0.0, v) - seen.origin;
            Ray { t_max: SEGMENT_END, ..endless(seen.origin, direction) }
        });
        let shadow = shadow.collect();
        let fan_origins = facing.iter().step_by(TEXELS * TEXELS).map(|seen| seen.origin).collect();
        let packets = packets(&primary, film);
        Rays { primary, packets, bounce, shadow, fan_origins, tiles: tiles(corner) }
    }

    pub fn kinds(&self) -> impl Iterator<Item = (&'static str, Question<'_>)> {
        let kinds = [
            ("primary", Question::Closest(&self.primary)),
            ("primary16", Question::Packets(&self.packets)),
            ("bounce", Question::Closest(&self.bounce)),
            ("shadow", Question::Free(&self.shadow)),
            ("fan16", Question::Fans(&self.fan_origins, &self.tiles)),
        ];
        kinds.into_iter()
    }
}

fn endless(origin: Vec3, direction: Vec3) -> Ray {
    Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY }
}

/// Rays through the pixels of a film, row by row, as packets.
fn packets(rays: &[Ray], film: Film) -> Vec<Packet> {
    let corners = |side: u32| (0..side).step_by(SQUARE as usize);
    let packet = |[left, top]: [u32; 2]| {
        let mut packet = Packet { origin: Vec3::ZERO, directions: [Vec3::ZERO; 16], n: 0 };
        for y in top..(top + SQUARE).min(film.height) {
            for x in left..(left + SQUARE).min(film.width) {
                let ray = &rays[(y * film.width + x) as usize];
                packet.origin = ray.origin;
                packet.directions[packet.n] = ray.direction;
                packet.n += 1;
            }
        }
        packet
    };
    corners(film.height).flat_map(|top| corners(film.width).map(move |left| [left, top])).map(packet).collect()
}

fn seen(triangles: &[[Vec3; 3]], tree: &Ours, ray: &Ray) -> Option<Seen> {
    let hit = tree.0.closest(ray)?;
    let [a, b, c] = triangles[hit.triangle as usize];
    let normal = (b - a).cross(c - a).normalize();
    let normal = if normal.dot(ray.direction) > 0.0 { -normal } else { normal };
    Some(Seen { origin: offset_origin(ray.origin + ray.direction * hit.t, normal, f32::INFINITY), normal })
}

/// A direction as a diffuse surface sends it.
fn scattered(normal: Vec3, index: usize) -> Vec3 {
    let [u, v] = Sampler::new(2, index as u64, 0).next_2d();
    let (tangent, bitangent) = normal.any_orthonormal_pair();
    let (sin, cos) = (std::f32::consts::TAU * v).sin_cos();
    tangent * (u.sqrt() * cos) + bitangent * (u.sqrt() * sin) + normal * (1.0 - u).sqrt()
}

/// The middle of a panel of 1 m², a twentieth of the way under what lies above the point between camera and what it sees.
fn panel(tree: &Ours, camera: &Camera, seen: &[Seen]) -> Vec3 {
    let eye = camera.position();
    let mean = seen.iter().map(|seen| seen.origin).sum::<Vec3>() / seen.len().max(1) as f32;
    let below = Vec3::new(0.5 * (eye.x + mean.x), eye.y, 0.5 * (eye.z + mean.z));
    let above = tree.closest(&endless(below, Vec3::Y));
    below + Vec3::Y * if above.is_finite() { 0.95 * above } else { 2.0 }
}

/// The middles of the texels of the panel, tile by tile.
fn tiles(corner: Vec3) -> Vec<[Vec3; 16]> {
    let side = 1.0 / TEXELS as f32;
    let middle = |x: usize, z: usize| corner + Vec3::new(x as f32 + 0.5, 0.0, z as f32 + 0.5) * side;
    let tile = |nth: usize| {
        let (x, z) = (nth % (TEXELS / TILE) * TILE, nth / (TEXELS / TILE) * TILE);
        std::array::from_fn(|i| middle(x + i % TILE, z + i / TILE))
    };
    (0..(TEXELS / TILE).pow(2)).map(tile).collect()
}
