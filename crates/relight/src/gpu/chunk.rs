//! A run of blocks that shares its buffers: small enough for one binding, and for uploading again when a block changes.

use bytemuck::Pod;
use clerestory_nystrom::BlockLowRank;
use std::ops::Range;

use super::pack::{Packed, largest_buffer, pack};
use super::stages::{Stages, bind};
use crate::gpu::Gpu;
use crate::layout::{SEGMENT, THREADS};
use crate::relight::RelightError;

/// How much a chunk may hold.
#[derive(Clone, Copy, Debug)]
pub(super) struct ChunkLimits {
    pub n_blocks: usize,
    /// Largest buffer in bytes.
    pub n_bytes: u64,
}

impl ChunkLimits {
    pub(super) fn of(gpu: &Gpu) -> Self {
        let limits = gpu.device.limits();
        let most = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size).min(128 << 20);
        Self { n_blocks: 128, n_bytes: most - most % 16 }
    }
}

/// A run of blocks on the device.
#[derive(Debug)]
pub(super) struct Chunk {
    /// Blocks of the partition.
    pub run: Range<usize>,
    /// Bytes of right factors, which project reads.
    pub n_right_bytes: u64,
    /// Bytes of left factors and sparse terms, which expand reads.
    pub n_left_bytes: u64,
    /// Blocks with content.
    pub n_blocks: u32,
    /// None where no block has content.
    bindings: Option<Bindings>,
}

#[derive(Debug)]
struct Bindings {
    project: wgpu::BindGroup,
    gather: wgpu::BindGroup,
    expand: wgpu::BindGroup,
    /// Largest rank, rounded up to a pair.
    most_components: u32,
    most_pixels: u32,
}

impl Chunk {
    /// Uploads a run of blocks, in as many chunks as the limits ask for.
    pub(super) fn upload(
        gpu: &Gpu,
        stages: &Stages,
        limits: ChunkLimits,
        low_rank: &BlockLowRank,
        run: Range<usize>,
        chunks: &mut Vec<Self>,
    ) -> Result<(), RelightError> {
        let size = largest_buffer(low_rank, run.clone());
        if run.len() > limits.n_blocks {
            let cut = run.start + limits.n_blocks;
            Self::upload(gpu, stages, limits, low_rank, run.start..cut, chunks)?;
            return Self::upload(gpu, stages, limits, low_rank, cut..run.end, chunks);
        }
        if size > limits.n_bytes {
            if run.len() == 1 {
                return Err(RelightError::TooLarge { what: "one block of the frame", size, limit: limits.n_bytes });
            }
            let cut = run.start + run.len() / 2;
            Self::upload(gpu, stages, limits, low_rank, run.start..cut, chunks)?;
            return Self::upload(gpu, stages, limits, low_rank, cut..run.end, chunks);
        }
        let n_segments = low_rank.n_cols.div_ceil(SEGMENT);
        chunks.push(Self::new(gpu, stages, run.clone(), &pack(low_rank, run), n_segments));
        Ok(())
    }

    fn new(gpu: &Gpu, stages: &Stages, run: Range<usize>, packed: &Packed, n_segments: u32) -> Self {
        let n_right_bytes = 4 * (packed.right.len() + 4 * packed.components.len()) as u64;
        let n_left_bytes = 4 * (packed.left.len() + 2 * packed.sparse_terms.len()) as u64;
        let n_blocks = packed.blocks.len() as u32;
        let bindings = (n_blocks > 0).then(|| Bindings::new(gpu, stages, packed, n_segments));
        Self { run, n_right_bytes, n_left_bytes, n_blocks, bindings }
    }

    /// Records `right · x` for all blocks, over as many segments as the group names.
    pub(super) fn project(&self, pass: &mut wgpu::ComputePass<'_>, n_segments: u32) {
        if let Some(bindings) = self.bindings.as_ref().filter(|b| b.most_components > 0) {
            pass.set_bind_group(1, &bindings.project, &[]);
            pass.dispatch_workgroups(bindings.most_components, self.n_blocks, n_segments);
        }
    }

    /// Records `z = scale · sum of the segments` for all blocks where that is seen.
    pub(super) fn gather(&self, pass: &mut wgpu::ComputePass<'_>) {
        if let Some(bindings) = self.bindings.as_ref().filter(|b| b.most_components > 0) {
            pass.set_bind_group(1, &bindings.gather, &[]);
            pass.dispatch_workgroups(self.n_blocks, 1, 1);
        }
    }

    /// Records `left · z + sparse · x` for all blocks.
    pub(super) fn expand(&self, pass: &mut wgpu::ComputePass<'_>) {
        if let Some(bindings) = &self.bindings {
            pass.set_bind_group(1, &bindings.expand, &[]);
            pass.dispatch_workgroups(bindings.most_pixels.div_ceil(THREADS), self.n_blocks, 1);
        }
    }
}

impl Bindings {
    fn new(gpu: &Gpu, stages: &Stages, packed: &Packed, n_segments: u32) -> Self {
        let blocks = filled(gpu, "blocks", &packed.blocks);
        let [left, right] =
            [("left", &packed.left), ("right", &packed.right)].map(|(name, words)| filled(gpu, name, words));
        let components = filled(gpu, "components", &packed.components);
        let n_components = packed.components.len() as u64;
        let z = working(gpu, "z", 16 * n_components, wgpu::BufferUsages::empty());
        let n_partials = n_components * u64::from(n_segments);
        let partials = working(gpu, "partials", 16 * n_partials, wgpu::BufferUsages::empty());
        let starts = filled(gpu, "sparse_starts", &packed.sparse_starts);
        let terms = filled(gpu, "sparse_terms", &packed.sparse_terms);
        let project = [&blocks, &right, &partials].map(|buffer| buffer.as_entire_binding());
        let gather = [&blocks, &components, &partials, &z].map(|buffer| buffer.as_entire_binding());
        let expand = [&blocks, &left, &z, &starts, &terms].map(|buffer| buffer.as_entire_binding());
        Self {
            project: bind(gpu, &stages.project, 1, &project),
            gather: bind(gpu, &stages.gather, 1, &gather),
            expand: bind(gpu, &stages.expand, 1, &expand),
            most_components: packed.blocks.iter().map(|b| b.rank.next_multiple_of(2)).max().unwrap_or(0),
            most_pixels: packed.blocks.iter().map(|b| b.n_pixels).max().unwrap_or(0),
        }
    }
}

/// A storage buffer that stages write before others read it; in tests it holds no numbers until then.
pub(super) fn working(gpu: &Gpu, name: &str, n_bytes: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    let buffer = storage(gpu, name, n_bytes, usage | wgpu::BufferUsages::COPY_DST);
    if cfg!(test) {
        gpu.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(&vec![f32::NAN; buffer.size() as usize / 4]));
    }
    buffer
}

/// A storage buffer; an empty one still gets one element, since nothing cannot be bound.
pub(super) fn storage(gpu: &Gpu, name: &str, n_bytes: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(name),
        size: n_bytes.next_multiple_of(16).max(64),
        usage: usage | wgpu::BufferUsages::STORAGE,
        mapped_at_creation: false,
    })
}

fn filled<T: Pod>(gpu: &Gpu, name: &str, content: &[T]) -> wgpu::Buffer {
    let bytes: &[u8] = bytemuck::cast_slice(content);
    let buffer = storage(gpu, name, bytes.len() as u64, wgpu::BufferUsages::COPY_DST);
    if !bytes.is_empty() {
        gpu.queue.write_buffer(&buffer, 0, bytes);
    }
    buffer
}
