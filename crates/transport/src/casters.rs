//! Mirrors and clear bodies that throw the light of lamps on other surfaces, and where they do: walks that leave such a place
//! are sent toward them as well. \[Jensen1995\]
//!
//! What a walk brings by way of casters alone is the light of a caustic. By chance few walks find it, as a body is small
//! seen from the surface, and each of them is bright. So beforehand some walks set out from points of the casters: where one
//! meets a surface, another goes back from there and by way of the casters to a lamp, if there is one. Cells of space keep
//! which part of which caster brought how much, and guided walks aim at those parts. What chance would have found and what
//! guides find are weighed against each other by their densities \[Veach1995\], so that no guide has to be right.

mod clusters;

use std::collections::HashMap;

use glam::{IVec3, Vec3};
use rayon::prelude::*;

use self::clusters::Clusters;
use crate::bsdf::cosine_direction;
use crate::bvh::Ray;
use crate::emitters::Emitter;
use crate::light::luminance;
use crate::prepared::{PreparedScene, SurfaceHit};
use crate::sampler::Sampler;
use crate::scene::{AlphaMode, Material};
use crate::stop::{Stop, Stopped};
use crate::streams::Stream;

/// Casters of a scene, and the light that they throw.
#[derive(Debug)]
pub(crate) struct Casters {
    /// By triangle.
    kinds: Vec<Kind>,
    clusters: Clusters,
    /// Light in cells, by their size: of fine parts, and of coarse ones in large cells and anywhere.
    grids: [Grid; 3],
}

/// Light of caustics by cells of space.
#[derive(Debug, Default)]
struct Grid {
    /// Side of a cell, m.
    side: f32,
    cells: HashMap<IVec3, Cell>,
    /// One cell after the other: a cluster and the sum of the shares up to it.
    parts: Vec<(u32, f32)>,
}

/// Light that casters throw into a part of space.
#[derive(Clone, Copy, Debug)]
struct Cell {
    /// First of its parts and the one after the last.
    parts: [u32; 2],
    /// About the light that arrives there beside that of a white sky, all lamps of radiance 1.
    light: f32,
}

/// What a triangle is for the light of a caustic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// It ends there, or is emitted there.
    Other,
    /// It goes straight on.
    Pane,
    /// It is thrown on.
    Caster,
}

/// Directions toward what throws light on a place: to fine parts, then to coarse ones, in case that the fine ones miss some.
#[derive(Clone, Copy)]
pub(crate) struct Guide<'a> {
    casters: &'a Casters,
    lists: [&'a [(u32, f32)]; 2],
    /// Share of the first.
    fine: f32,
    position: Vec3,
    light: f32,
}

/// Clusters that throw light on a place.
struct Finding {
    position: Vec3,
    /// Fine and coarse.
    clusters: [u32; 2],
    light: f32,
}

/// Perceptual roughness up to which metal and glass throw light on in about one direction.
const MOST_ROUGHNESS: f32 = 0.3;
/// Walks that look for light, and those after which it is asked whether they are still wanted.
const WALKS: u32 = 1 << 17;
const PART: u32 = 1 << 12;
/// Surfaces of casters on the way.
const SURFACES: u32 = 16;
/// Cells along the diagonal of the scene.
const CELLS: [f32; 3] = [128.0, 16.0, 0.25];
/// Parts of a cell at most.
const PARTS: usize = 64;
/// Share of the guided walks that aim at fine parts where they are known.
const FINE: f32 = 0.75;
/// Share of the light of a cell that its neighbors expect as well, each.
const SPILL: f32 = 0.05;
/// Stream of random numbers that nobody else uses.
const STREAM: u64 = Stream::Casters.first();

impl Casters {
    /// Finds them; `None` where there are none, or no light that they throw.
    pub(crate) fn find(scene: &PreparedScene, stop: &Stop) -> Result<Option<Casters>, Stopped> {
        if !scene.scene.materials.iter().any(throws_light) || !has_wide_lights(scene) {
            return Ok(None);
        }
        let kinds: Vec<Kind> = (0..scene.scene.mesh.triangles.len() as u32).map(|t| kind(scene, t)).collect();
        let triangles: Vec<u32> = (0..kinds.len() as u32).filter(|&t| kinds[t as usize] == Kind::Caster).collect();
        let clusters = Clusters::of(&scene.scene.mesh, &triangles);
        if clusters.n_fine() == 0 {
            return Ok(None);
        }
        let grids = CELLS.map(|cells| Grid { side: scene.extent() / cells, ..Grid::default() });
        let mut casters = Casters { kinds, clusters, grids };
        let mut findings = Vec::new();
        for first in (0..WALKS).step_by(PART as usize) {
            stop.check()?;
            findings.par_extend((first..first + PART).into_par_iter().filter_map(|walk| casters.look(scene, walk)));
        }
        for (grid, level) in casters.grids.iter_mut().zip([0, 1, 1]) {
            grid.keep(&findings, level);
        }
        casters.clusters.forget_pieces();
        Ok((!findings.is_empty()).then_some(casters))
    }

    /// Whether a triangle throws light on.
    #[inline]
    pub(crate) fn has(&self, triangle: u32) -> bool {
        self.kinds.get(triangle as usize) == Some(&Kind::Caster)
    }

    /// Whether a caustic's light goes on at a triangle: it is thrown on, or passes straight.
    #[inline]
    pub(crate) fn is_on_the_way(&self, triangle: u32) -> bool {
        self.kinds.get(triangle as usize).is_some_and(|kind| *kind != Kind::Other)
    }

    /// Where light comes from that casters throw on a place.
    #[inline]
    pub(crate) fn guide(&self, position: Vec3) -> Guide<'_> {
        let [fine, coarse, anywhere] = self.grids.each_ref().map(|grid| grid.at(position));
        let (of_coarse, coarse_light) = coarse.or(anywhere).unwrap_or((&[], 0.0));
        let (of_fine, light) = fine.unwrap_or((&[], coarse_light));
        let share = if of_fine.is_empty() { 0.0 } else { FINE };
        Guide { casters: self, lists: [of_fine, of_coarse], fine: share, position, light }
    }

    /// One walk from a caster to a surface, and back by way of the casters to a light.
    fn look(&self, scene: &PreparedScene, walk: u32) -> Option<Finding> {
        let mut sampler = Sampler::new(0, STREAM, walk);
        let n = self.clusters.n_fine();
        let number = ((sampler.next_1d() * n as f32) as u32).min(n - 1);
        let (triangle, uv) = self.clusters[number].point(sampler.next_1d(), sampler.next_2d());
        let start = scene.point_of(triangle, uv);
        let material = scene.material(triangle);
        // The inside of a clear body sees nothing but itself.
        let faces_back = material.transmission <= 0.0 && sampler.next_1d() < 0.5;
        let normal = if faces_back { -start.normal } else { start.normal };
        let (tangent, bitangent) = normal.any_orthonormal_pair();
        let local = cosine_direction(sampler.next_2d());
        let away = tangent * local.x + bitangent * local.y + normal * local.z;
        let met = scene.closest(&ray(start.origin(normal), away), &mut sampler)?;
        if self.is_on_the_way(met.triangle) || scene.material(met.triangle).unlit {
            return None;
        }
        let origin = met.origin(met.outward(-away));
        let light = self.light_along(scene, (origin, (start.position - origin).normalize_or_zero()), &mut sampler)?;
        let light = light * self.clusters[number].area * n as f32 / WALKS as f32
            * if material.transmission > 0.0 { 1.0 } else { 2.0 };
        let clusters = [number, self.clusters.around(number)];
        (light > 0.0 && light.is_finite()).then_some(Finding { position: met.position, clusters, light })
    }

    /// About how bright a walk finds what casters alone show along a ray, the light of each column being 1.
    fn light_along(
        &self,
        scene: &PreparedScene,
        (mut origin, mut direction): (Vec3, Vec3),
        sampler: &mut Sampler,
    ) -> Option<f32> {
        let mut throughput = Vec3::ONE;
        for nth in 0..SURFACES {
            let Some(hit) = scene.closest(&ray(origin, direction), sampler) else {
                return (nth > 0).then(|| luminance(throughput * beyond(scene, direction)));
            };
            if nth == 0 && !self.has(hit.triangle) {
                return None;
            }
            if let Some(radiance) = shining(scene, &hit, -direction) {
                return Some(luminance(throughput * radiance));
            }
            if !self.is_on_the_way(hit.triangle) {
                return None;
            }
            let bsdf = scene.bsdf(&hit, -direction);
            let sample = bsdf.sample(sampler.next_1d(), sampler.next_2d())?;
            throughput *= sample.weight;
            direction = sample.wi;
            origin = hit.origin(hit.outward(direction));
        }
        None
    }
}

impl Grid {
    fn cell(&self, position: Vec3) -> IVec3 {
        (position / self.side).floor().as_ivec3()
    }

    /// The parts of a cell, and its light.
    #[inline]
    fn at(&self, position: Vec3) -> Option<(&[(u32, f32)], f32)> {
        let &Cell { parts: [first, end], light } = self.cells.get(&self.cell(position))?;
        Some((&self.parts[first as usize..end as usize], light))
    }

    /// Makes cells of what was found of one of the levels of clusters.
    fn keep(&mut self, findings: &[Finding], level: usize) {
        let mut shares: Vec<((i32, i32, i32), u32, f32)> = Vec::with_capacity(27 * findings.len());
        for Finding { position, clusters, light } in findings {
            let (cell, cluster) = (self.cell(*position), clusters[level]);
            let steps = (0..27).map(|i| IVec3::new(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1));
            shares.extend(steps.map(|step| {
                let share = if step == IVec3::ZERO { 1.0 } else { SPILL };
                (cell.wrapping_add(step).into(), cluster, share * light)
            }));
        }
        shares.sort_by_key(|(cell, cluster, _)| (*cell, *cluster));
        for of_cell in shares.chunk_by(|a, b| a.0 == b.0) {
            let same = of_cell.chunk_by(|a, b| a.1 == b.1);
            let mut parts: Vec<(u32, f32)> = same.map(|same| (same[0].1, same.iter().map(|s| s.2).sum())).collect();
            parts.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
            parts.truncate(PARTS);
            let total: f32 = parts.iter().map(|(_, light)| light).sum();
            let first = self.parts.len() as u32;
            let mut sum = 0.0;
            self.parts.extend(parts.iter().map(|(cluster, light)| {
                sum += light / total;
                (*cluster, sum)
            }));
            // A surface that passes through a cell has about the area of one of its sides.
            let cell = Cell { parts: [first, self.parts.len() as u32], light: total / (self.side * self.side) };
            self.cells.insert(of_cell[0].0.into(), cell);
        }
    }
}

impl Guide<'_> {
    /// A direction for numbers in [0, 1); `None` from within the part that was drawn.
    pub(crate) fn sample(&self, u_part: f32, u: [f32; 2]) -> Option<Vec3> {
        let (list, u_part) = if u_part < self.fine {
            (self.lists[0], u_part / self.fine)
        } else {
            (self.lists[1], (u_part - self.fine) / (1.0 - self.fine))
        };
        let nth = list.partition_point(|(_, sum)| *sum <= u_part).min(list.len().checked_sub(1)?);
        self.casters.clusters[list[nth].0].direction(self.position, u)
    }

    /// Density per solid angle with which [`Guide::sample`] draws a direction.
    pub(crate) fn pdf(&self, direction: Vec3) -> f32 {
        let of_list = |list: &[(u32, f32)]| {
            let mut before = 0.0;
            let of_part = |&(cluster, sum): &(u32, f32)| {
                let share = sum - before;
                before = sum;
                share * self.casters.clusters[cluster].pdf(self.position, direction)
            };
            list.iter().map(of_part).sum::<f32>()
        };
        self.fine * of_list(self.lists[0]) + (1.0 - self.fine) * of_list(self.lists[1])
    }

    /// About how much light casters throw there beside a white sky, all lamps of radiance 1.
    pub(crate) fn light(&self) -> f32 {
        self.light
    }
}

fn ray(origin: Vec3, direction: Vec3) -> Ray {
    Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY }
}

/// Whether metal or glass of a material shows about what is reflected or bent.
fn throws_light(material: &Material) -> bool {
    material.turns_light() && material.roughness <= MOST_ROUGHNESS && material.alpha == AlphaMode::Opaque
}

fn kind(scene: &PreparedScene, triangle: u32) -> Kind {
    let material = scene.material(triangle);
    if material.is_emitter() {
        Kind::Other
    } else if scene.is_clear_pane(triangle) || scene.slabs.has(triangle) {
        Kind::Pane
    } else if throws_light(material) {
        Kind::Caster
    } else {
        Kind::Other
    }
}

/// Whether the scene has lights that a walk can meet by itself.
fn has_wide_lights(scene: &PreparedScene) -> bool {
    let wide = |emitter: &Emitter| !matches!(emitter, Emitter::Punctual(_) | Emitter::Constant | Emitter::Lamp(_));
    scene.lighting.emitters.iter().any(wide)
}

/// Radiance per unit of its column that a surface sends toward `wo`.
fn shining(scene: &PreparedScene, hit: &SurfaceHit, wo: Vec3) -> Option<Vec3> {
    let (_, radiance) = scene.emitted(hit, wo)?;
    let emitter = &scene.lighting.emitters[scene.lighting.triangle_source[hit.triangle as usize] as usize];
    (!matches!(emitter, Emitter::Constant)).then_some(radiance)
}

/// About the same of what shines beyond all surfaces.
fn beyond(scene: &PreparedScene, direction: Vec3) -> Vec3 {
    let of = |emitter: &Emitter| match emitter {
        Emitter::Sky | Emitter::Dome(_) => Vec3::ONE,
        Emitter::Environment(map) => map.radiance(direction) / map.mean_luminance().max(f32::MIN_POSITIVE),
        _ => Vec3::ZERO,
    };
    scene.lighting.emitters.iter().map(of).sum()
}
