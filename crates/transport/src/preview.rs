//! The first picture: direct light per pixel, indirect light shared between neighbors.
//!
//! On a coarse grid of nodes, a few walks each gather the light that arrives from other surfaces, for all columns. A
//! pixel adds its own direct light and takes the indirect light of the nodes around it that lie on the same surface;
//! where there are none, and on surfaces that mirror, it follows walks of its own. This is biased at contacts and where few walks
//! carry much, and so it is only the preview: the passes after it share nothing.

use std::ops::ControlFlow;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use clerestory_nystrom::{
    BlockFactors, BlockSamples, CompressConfig, CompressError, Half, Partition, SampledMatrix, SparseEntry,
    compress_block,
};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::matrix::{CHANNELS, RowDeposit, TransportMatrix};
use crate::path::{Deposit, Scratch};
use crate::sampler::Sampler;

/// Smallest distance between nodes in pixels.
const NODE_SPACING: u32 = 4;
/// Walks that gather at each node, for each half.
const NODE_WALKS: u32 = 8;
/// Most memory that nodes may take.
const NODE_BYTES: usize = 256 << 20;
/// Times the median of its neighbors that a node may shine.
const OUTSHINES: f32 = 2.0;
/// Streams of random numbers that no other pass uses.
const NODE_STREAM: u64 = 1 << 62;
const PIXEL_STREAM: u64 = 1 << 61;

/// Indirect light on a coarse grid.
struct Nodes {
    spacing: u32,
    nx: u32,
    ny: u32,
    /// Point and unit normal of each node, `None` where nothing broad is seen.
    surfaces: Vec<Option<(Vec3, Vec3)>>,
    /// Node by node: half A, then half B, each three rows of all columns.
    light: Vec<f32>,
}

/// Samples and compresses every block once, coarsely, in the order of `blocks`.
pub(crate) fn preview(
    matrix: &TransportMatrix<'_>,
    partition: &Partition,
    blocks: &[u32],
    config: &CompressConfig,
    on_block: impl FnMut(u32, Vec<BlockFactors>) -> ControlFlow<()> + Send,
) -> Result<ControlFlow<()>, CompressError> {
    let stopped = AtomicBool::new(false);
    let on_block = Mutex::new(on_block);
    let nodes = Nodes::gather(matrix);
    blocks.par_iter().try_for_each_init(BlockSums::default, |sums, &block| {
        if stopped.load(Ordering::Relaxed) {
            return Ok(());
        }
        sums.sample(matrix, &nodes, partition, block);
        let samples = BlockSamples {
            halves: [&sums.halves[0], &sums.halves[1]],
            sparse: &sums.sparse,
            n_cols: matrix.n_cols(),
            bundle_len: CHANNELS,
            n_samples: 1,
        };
        let factors = compress_block(&samples, config, block)?;
        let mut on_block = on_block.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if !stopped.load(Ordering::Relaxed) && on_block(block, factors).is_break() {
            stopped.store(true, Ordering::Relaxed);
        }
        Ok(())
    })?;
    Ok(if stopped.into_inner() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
}

impl Nodes {
    fn gather(matrix: &TransportMatrix<'_>) -> Nodes {
        let (film, n_cols) = (matrix.film, matrix.n_cols());
        let node_len = 2 * CHANNELS * n_cols;
        let mut spacing = NODE_SPACING;
        while film.width.div_ceil(spacing) as usize * film.height.div_ceil(spacing) as usize * node_len * 4 > NODE_BYTES
            && spacing < 64
        {
            spacing *= 2;
        }
        let (nx, ny) = (film.width.div_ceil(spacing), film.height.div_ceil(spacing));
        let mut light = vec![0.0; nx as usize * ny as usize * node_len];
        let surfaces = light
            .par_chunks_mut(node_len)
            .enumerate()
            .map_init(Scratch::default, |scratch, (node, light)| {
                let center = (Vec2::new((node as u32 % nx) as f32, (node as u32 / nx) as f32) + 0.5) * spacing as f32;
                let size = Vec2::new(film.width as f32, film.height as f32);
                gather_node(matrix, node as u64, center.min(size - 0.5), light, scratch)
            })
            .collect();
        let mut nodes = Nodes { spacing, nx, ny, surfaces, light };
        nodes.calm(node_len);
        nodes
    }

    /// Dims nodes that outshine their neighbors by far: a rare bright walk would show as a spot as wide as its node. The
    /// passes after the preview clamp nothing.
    fn calm(&mut self, node_len: usize) {
        let total = |light: &[f32]| light.iter().sum::<f32>();
        let totals: Vec<f32> = self.light.par_chunks(node_len).map(total).collect();
        let (nx, ny) = (self.nx as usize, self.ny as usize);
        self.light.par_chunks_mut(node_len).enumerate().for_each(|(node, light)| {
            let (x, y) = (node % nx, node / nx);
            let rows = y.saturating_sub(1)..(y + 2).min(ny);
            let around = rows.flat_map(|y| (x.saturating_sub(1)..(x + 2).min(nx)).map(move |x| y * nx + x));
            let mut around: Vec<f32> = around.map(|n| totals[n]).filter(|t| *t > 0.0).collect();
            if around.is_empty() {
                return;
            }
            let middle = around.len() / 2;
            let limit = OUTSHINES * *around.select_nth_unstable_by(middle, f32::total_cmp).1;
            if totals[node] > limit {
                light.iter_mut().for_each(|x| *x *= limit / totals[node]);
            }
        });
    }

    /// Adds the indirect light at a point of a surface, times `albedo`; false where no node lies on the same surface.
    fn add_indirect(
        &self,
        film_px: Vec2,
        (position, normal): (Vec3, Vec3),
        half: Half,
        albedo: Vec3,
        rows: &mut [f32],
    ) -> bool {
        let at = film_px / self.spacing as f32 - 0.5;
        let base = at.floor();
        let fraction = at - base;
        let mut weights = [(0usize, 0.0f32); 4];
        for (i, slot) in weights.iter_mut().enumerate() {
            let step = Vec2::new((i & 1) as f32, (i >> 1) as f32);
            let node = (base + step).max(Vec2::ZERO).as_uvec2().min(glam::UVec2::new(self.nx - 1, self.ny - 1));
            let idx = node.y as usize * self.nx as usize + node.x as usize;
            let bilinear = (1.0 - (step - fraction).abs()).max(Vec2::splat(0.02));
            *slot = (idx, bilinear.x * bilinear.y * self.similarity(idx, position, normal));
        }
        let total: f32 = weights.iter().map(|(_, w)| w).sum();
        if total < 1e-3 {
            return false;
        }
        let row_len = rows.len() / CHANNELS;
        let half_len = CHANNELS * row_len;
        for (idx, weight) in weights.into_iter().filter(|(_, w)| *w > 0.0) {
            let start = idx * 2 * half_len + if half == Half::B { half_len } else { 0 };
            let light = &self.light[start..start + half_len];
            for (channel, albedo) in albedo.to_array().into_iter().enumerate() {
                let factor = albedo * weight / total;
                let range = channel * row_len..(channel + 1) * row_len;
                for (out, light) in rows[range.clone()].iter_mut().zip(&light[range]) {
                    *out += factor * light;
                }
            }
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

fn gather_node(
    matrix: &TransportMatrix<'_>,
    node: u64,
    film_px: Vec2,
    light: &mut [f32],
    scratch: &mut Scratch,
) -> Option<(Vec3, Vec3)> {
    let n_cols = matrix.n_cols();
    let half_len = CHANNELS * n_cols;
    let direction = matrix.camera.direction(matrix.film, film_px);
    let mut sampler = Sampler::new(matrix.seed, NODE_STREAM + node * 4 + 2, 0);
    let (hit, normal) = matrix.integrator.broad_surface(matrix.camera.position(), direction, &mut sampler)?;
    for (half, light) in light.chunks_exact_mut(half_len).enumerate() {
        let mut deposit = RowDeposit::new(light, n_cols, matrix.column_scale());
        for walk in 0..NODE_WALKS {
            let mut sampler = Sampler::new(matrix.seed, NODE_STREAM + node * 4 + half as u64, walk);
            matrix.integrator.gather_indirect((&hit, normal), &mut sampler, scratch, &mut deposit);
        }
        light.iter_mut().for_each(|x| *x /= NODE_WALKS as f32);
    }
    Some((hit.position, normal))
}

/// Sums of one sample per pixel and half, reused from block to block.
#[derive(Default)]
struct BlockSums {
    pixels: Vec<u32>,
    halves: [Vec<f32>; 2],
    sparse: Vec<SparseEntry>,
    scratch: Scratch,
}

impl BlockSums {
    fn sample(&mut self, matrix: &TransportMatrix<'_>, nodes: &Nodes, partition: &Partition, block: u32) {
        let n_cols = matrix.n_cols();
        partition.bundles(block as usize, &mut self.pixels);
        self.sparse.clear();
        for (half, sums) in [Half::A, Half::B].into_iter().zip(&mut self.halves) {
            sums.clear();
            sums.resize(self.pixels.len() * CHANNELS * n_cols, 0.0);
            for (nth, (&pixel, rows)) in self.pixels.iter().zip(sums.chunks_exact_mut(CHANNELS * n_cols)).enumerate() {
                let first_row = (nth * CHANNELS) as u32;
                self.sparse.append(&mut sample_pixel(matrix, nodes, (pixel, half), rows, first_row, &mut self.scratch));
            }
        }
    }
}

fn sample_pixel(
    matrix: &TransportMatrix<'_>,
    nodes: &Nodes,
    (pixel, half): (u32, Half),
    rows: &mut [f32],
    first_row: u32,
    scratch: &mut Scratch,
) -> Vec<SparseEntry> {
    let (n_cols, integrator) = (matrix.n_cols(), &matrix.integrator);
    let stream = PIXEL_STREAM + u64::from(pixel) * 2 + u64::from(half == Half::B);
    let mut sampler = Sampler::new(matrix.seed, stream, 0);
    let corner = Vec2::new((pixel % matrix.film.width) as f32, (pixel / matrix.film.width) as f32);
    let film_px = corner + Vec2::from(sampler.next_2d());
    let ray = (matrix.camera.position(), matrix.camera.direction(matrix.film, film_px));
    let mut deposit = RowDeposit::new(rows, n_cols, matrix.column_scale()).with_first_row(first_row);
    let broad = integrator.sample_direct(ray, &mut sampler, scratch, &mut deposit);
    let sparse = deposit.into_sparse();
    if let Some((hit, albedo)) = broad {
        let normal = if hit.normal.dot(ray.1) > 0.0 { -hit.normal } else { hit.normal };
        if !nodes.add_indirect(film_px, (hit.position, normal), half, albedo, rows) {
            let mut deposit = Weighted { inner: RowDeposit::new(rows, n_cols, matrix.column_scale()), weight: albedo };
            integrator.gather_indirect((&hit, normal), &mut sampler, scratch, &mut deposit);
        }
    }
    sparse
}

/// Multiplies everything by a color.
struct Weighted<'a> {
    inner: RowDeposit<'a>,
    weight: Vec3,
}

impl Deposit for Weighted<'_> {
    fn scattered(&mut self, column: u32, value: Vec3) {
        self.inner.scattered(column, value * self.weight);
    }

    fn seen(&mut self, column: u32, value: Vec3) {
        self.inner.seen(column, value * self.weight);
    }
}
