//! Indirect light on a coarse grid over the picture, shared between neighboring pixels.
//!
//! At each node a few walks gather the light that arrives from other surfaces, for all columns. A pixel takes the light of
//! the nodes around it that lie on the same surface. Both halves have nodes of their own, so that their noise is seen.

use std::ops::ControlFlow;

use clerestory_nystrom::Half;
use glam::{UVec2, Vec2, Vec3};
use rayon::prelude::*;

use crate::cache::{CachePlan, CachedDeposit, LightCache, Place};
use crate::camera::Film;
use crate::matrix::{CHANNELS, RowDeposit, TransportMatrix, add_weighted, median, scale_columns};
use crate::path::{Gathering, Onto, Scratch};
use crate::sampler::Sampler;
use crate::streams::Stream;

/// Distance between nodes in pixels, of a picture that is at least [`FULL_WIDTH`] wide; less in smaller ones.
const SPACING: u32 = 4;
const FULL_WIDTH: u32 = 384;
/// Most memory that nodes may take.
const MOST_BYTES: usize = 1 << 30;
/// Stream of random numbers that no pixel uses.
const STREAM: u64 = Stream::Nodes.first();
/// Parts of the grid after which it is asked whether to go on.
const PARTS: usize = 32;

/// How nodes gather.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct NodePlan {
    /// Walks at each node, for each half.
    pub walks: u32,
    /// Times the median of its neighbors that a node may shine: a rare bright walk would show as a spot as wide as a node.
    pub outshines: f32,
    /// How the light behind the nodes is found.
    pub cache: CachePlan,
}

/// Indirect light on a coarse grid.
pub(crate) struct Nodes {
    spacing: u32,
    size: UVec2,
    /// Point and unit normal of each node, `None` where nothing is seen that scatters diffusely.
    surfaces: Vec<Option<(Vec3, Vec3)>>,
    /// Node by node: half A, then half B, each three rows of all columns.
    light: Vec<f32>,
    /// Whether the light of caustics is part of it, so that pixels must not look for that themselves.
    pub(crate) holds_caustics: bool,
    /// Where the walks of nodes ended; those of pixels may end there, too.
    pub(crate) cache: LightCache,
}

/// Distance between nodes in pixels and their number across and down, given the numbers of a node.
fn grid(film: Film, node_len: usize) -> (u32, UVec2) {
    let size_at = |spacing: u32| UVec2::new(film.width.div_ceil(spacing), film.height.div_ceil(spacing));
    let bytes_at = |spacing: u32| size_at(spacing).as_u64vec2().element_product() as usize * node_len * 4;
    let mut spacing = (film.width.max(film.height) * SPACING / FULL_WIDTH).clamp(1, SPACING);
    while bytes_at(spacing) > MOST_BYTES && spacing < 64 {
        spacing *= 2;
    }
    (spacing, size_at(spacing))
}

impl Nodes {
    /// Memory of the nodes of a picture, bytes; how many cells lie behind them is not known before.
    pub(crate) fn bytes_for(film: Film, n_columns: usize) -> usize {
        let node_len = 2 * CHANNELS * n_columns;
        grid(film, node_len).1.element_product() as usize * node_len * size_of::<f32>()
    }

    /// Memory of the nodes and of the cells behind them, bytes.
    pub(crate) fn n_bytes(&self) -> usize {
        size_of_val(self.light.as_slice()) + self.cache.n_bytes()
    }

    /// Follows the walks of all nodes; `None` if `on_part` says stop.
    pub(crate) fn gather(
        matrix: &TransportMatrix<'_>,
        plan: NodePlan,
        mut on_part: impl FnMut() -> ControlFlow<()>,
    ) -> Option<Nodes> {
        let (film, node_len) = (matrix.film, 2 * CHANNELS * matrix.column_scale().len());
        let (spacing, size) = grid(film, node_len);
        let n_nodes = size.element_product() as usize;
        let hits: Vec<Option<Place>> = (0..n_nodes as u32)
            .into_par_iter()
            .map(|node| {
                let center = (Vec2::new((node % size.x) as f32, (node / size.x) as f32) + 0.5) * spacing as f32;
                let film_px = center.min(Vec2::new(film.width as f32, film.height as f32) - 0.5);
                matrix
                    .integrator
                    .gathering_surface(matrix.ray(film_px), &mut Sampler::new(matrix.seed, stream_of(node) + 2, 0))
            })
            .collect();
        let places: Vec<Place> = hits.iter().copied().flatten().collect();
        if on_part().is_break() {
            return None;
        }
        let cache = LightCache::fill(matrix, &places, plan.cache, &mut on_part)?;
        let mut light = vec![0.0; n_nodes * node_len];
        let part = n_nodes.div_ceil(PARTS).max(1);
        for (nth, light) in light.chunks_mut(part * node_len).enumerate() {
            light.par_chunks_mut(node_len).enumerate().for_each_init(Scratch::default, |scratch, (i, light)| {
                let node = nth * part + i;
                if let Some(place) = &hits[node] {
                    gather_node((matrix, &cache), (node as u32, plan.walks), place, light, scratch);
                }
            });
            if on_part().is_break() {
                return None;
            }
        }
        let surfaces = hits.into_iter().map(|hit| hit.map(|(hit, normal)| (hit.position, normal))).collect();
        if matrix.integrator.scene().nodes_are_calmed {
            calm(&mut light, size, node_len, plan.outshines);
        }
        let holds_caustics = !matrix.integrator.is_guided();
        Some(Nodes { spacing, size, surfaces, light, holds_caustics, cache })
    }

    /// The same light for a matrix whose columns have other scales, given the ratios of its scales to those of this one.
    pub(crate) fn scaled(mut self, ratios: &[f32]) -> Nodes {
        scale_columns(&mut self.light, ratios);
        self.cache.scale(ratios);
        self
    }

    /// Adds the indirect light at a point to the rows of a pixel; false where no node lies on the same surface.
    pub(crate) fn add(&self, film_px: Vec2, at: &Gathering, half: Half, rows: &mut [f32]) -> bool {
        let place = film_px / self.spacing as f32 - 0.5;
        let base = place.floor();
        let fraction = place - base;
        let mut weights = [(0usize, 0.0f32); 4];
        for (i, slot) in weights.iter_mut().enumerate() {
            let step = Vec2::new((i & 1) as f32, (i >> 1) as f32);
            let node = (base + step).max(Vec2::ZERO).as_uvec2().min(self.size - 1);
            let idx = (node.y * self.size.x + node.x) as usize;
            let bilinear = (1.0 - (step - fraction).abs()).max(Vec2::splat(0.02));
            *slot = (idx, bilinear.x * bilinear.y * self.similarity(idx, at.hit.position, at.normal));
        }
        let total: f32 = weights.iter().map(|(_, w)| w).sum();
        if total < 1e-3 {
            return false;
        }
        let half_len = rows.len();
        for (idx, weight) in weights.into_iter().filter(|(_, w)| *w > 0.0) {
            let start = idx * 2 * half_len + if half == Half::B { half_len } else { 0 };
            add_weighted(rows, &self.light[start..start + half_len], at.albedo * weight / total);
        }
        true
    }

    /// 1 for a node on the same plane, towards 0 for one that faces or lies elsewhere.
    fn similarity(&self, node: usize, position: Vec3, normal: Vec3) -> f32 {
        let Some((at, facing)) = self.surfaces[node] else { return 0.0 };
        let apart = at - position;
        let off_plane = apart.dot(normal).abs() / apart.length().max(1e-6);
        let alike = normal.dot(facing).max(0.0).powi(8);
        if off_plane > 0.3 { 0.0 } else { alike * (1.0 - off_plane / 0.3) }
    }
}

/// Dims nodes of a grid that outshine the median of those around them and themselves by more than so many times: to that, all columns alike.
fn calm(light: &mut [f32], size: UVec2, node_len: usize, outshines: f32) {
    let total = |light: &[f32]| light.iter().sum::<f32>();
    let totals: Vec<f32> = light.par_chunks(node_len).map(total).collect();
    let (nx, ny) = (size.x as usize, size.y as usize);
    light.par_chunks_mut(node_len).enumerate().for_each(|(node, light)| {
        let (x, y) = (node % nx, node / nx);
        let rows = y.saturating_sub(1)..(y + 2).min(ny);
        let around = rows.flat_map(|y| (x.saturating_sub(1)..(x + 2).min(nx)).map(move |x| y * nx + x));
        let Some(median) = median(around.map(|n| totals[n]).filter(|t| *t > 0.0)) else { return };
        let limit = outshines * median;
        if totals[node] > limit {
            light.iter_mut().for_each(|x| *x *= limit / totals[node]);
        }
    });
}

fn stream_of(node: u32) -> u64 {
    STREAM + u64::from(node) * 4
}

fn gather_node(
    (matrix, cache): (&TransportMatrix<'_>, &LightCache),
    (node, walks): (u32, u32),
    (hit, normal): &Place,
    light: &mut [f32],
    scratch: &mut Scratch,
) {
    let n_cols = matrix.column_scale().len();
    for (half, light) in [Half::A, Half::B].into_iter().zip(light.chunks_exact_mut(CHANNELS * n_cols)) {
        let inner = RowDeposit::new(light, n_cols, matrix.column_scale());
        let mut deposit = CachedDeposit { inner, cache, half };
        for walk in 0..walks {
            let mut sampler = Sampler::new(matrix.seed, stream_of(node) + u64::from(half == Half::B), walk);
            matrix.integrator.gather_indirect((hit, *normal, Onto::Pixel), &mut sampler, scratch, &mut deposit);
        }
        light.iter_mut().for_each(|x| *x /= walks as f32);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three by three nodes of two values each, those around the one in the middle alike.
    fn calmed(around: [f32; 2], middle: [f32; 2], outshines: f32) -> Vec<[f32; 2]> {
        let mut nodes = [around; 9];
        nodes[4] = middle;
        let mut light = nodes.concat();
        calm(&mut light, UVec2::splat(3), 2, outshines);
        light.chunks_exact(2).map(|node| [node[0], node[1]]).collect()
    }

    #[test]
    fn a_node_that_outshines_those_around_it_is_dimmed_to_the_limit_and_no_other_one() {
        let mut expected = [[1.0f32, 1.0]; 9];
        // Of 16 beside a median of 2, 8 are left: half of each value.
        expected[4] = [6.0, 2.0];
        assert_eq!(calmed([1.0, 1.0], [12.0, 4.0], 4.0), expected);
        assert_eq!(calmed([1.0, 1.0], [6.0, 2.0], 4.0), expected, "at the limit it stays as it is");
        expected[4] = [12.0, 4.0];
        assert_eq!(calmed([1.0, 1.0], [12.0, 4.0], f32::INFINITY), expected, "without a limit, too");
    }

    #[test]
    fn darkness_is_no_measure_of_a_node() {
        let mut expected = [[0.0f32, 0.0]; 9];
        assert_eq!(calmed([0.0, 0.0], [0.0, 0.0], 4.0), expected);
        assert_eq!(calmed([0.0, 0.0], [0.0, 0.0], f32::INFINITY), expected);
        expected[4] = [12.0, 4.0];
        assert_eq!(calmed([0.0, 0.0], [12.0, 4.0], 4.0), expected, "a lone one has nothing to outshine");
    }
}
