//! A run of blocks that shares its buffers: as long as the device's limits let it be.

use clerestory_nystrom::BlockLowRank;
use std::ops::Range;

use super::buffers::{filled, largest_storage, storage, working};
use super::pack::{Packed, cut, items, pack};
use super::stages::{Stages, bind};
use crate::gpu::Gpu;
use crate::layout::{COMPONENTS, ExpandMode, PER_BLOCK, PIXELS, ROW, SEGMENT, THREADS};
use crate::packing::Precision;
use crate::relight::RelightError;

/// How much a chunk may hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ChunkLimits {
    pub n_blocks: usize,
    /// Largest buffer in bytes.
    pub n_bytes: u64,
}

/// Blocks that are uploaded with one that changed.
const COMPANY: usize = 128;
/// Bytes in which 32 bits find every word.
const ADDRESSED: u64 = 4 << 32;

impl ChunkLimits {
    /// What a device takes.
    pub(super) fn of(limits: &wgpu::Limits) -> Self {
        let n_blocks = limits.max_compute_workgroups_per_dimension as usize;
        Self { n_blocks, n_bytes: largest_storage(limits).min(ADDRESSED) }
    }

    /// Shorter runs, for blocks that change again and again while they are baked.
    pub(super) fn of_changing(self) -> Self {
        Self { n_blocks: self.n_blocks.min(COMPANY), ..self }
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
    /// Bytes of all its buffers.
    pub n_bytes: u64,
    /// Blocks with content.
    pub n_blocks: u32,
    bindings: Bindings,
    /// Workgroups of project: a band of components each.
    n_bands: u32,
    /// Workgroups of expand side by side.
    n_runs: u32,
}

#[derive(Debug)]
struct Bindings {
    project: wgpu::BindGroup,
    gather: wgpu::BindGroup,
    expand: wgpu::BindGroup,
}

impl Chunk {
    /// Uploads a run of blocks, in as many chunks as the limits ask for.
    pub(super) fn upload(
        gpu: &Gpu,
        stages: &Stages,
        (limits, precision): (ChunkLimits, Precision),
        low_rank: &BlockLowRank,
        run: Range<usize>,
        chunks: &mut Vec<Self>,
    ) -> Result<(), RelightError> {
        let (items, first) = (items(low_rank, run.clone(), precision), run.start);
        for run in cut(&items, run, limits)? {
            let packed = pack(low_rank, run.clone(), &items[run.start - first..run.end - first]);
            chunks.push(Self::new(gpu, stages, run, &packed, low_rank.n_cols));
        }
        Ok(())
    }

    fn new(gpu: &Gpu, stages: &Stages, run: Range<usize>, packed: &Packed<'_>, n_cols: u32) -> Self {
        let n_right_bytes = 4 * packed.n_right_words() + 16 * packed.components.len() as u64;
        let n_left_bytes = 4 * (packed.n_left + packed.sparse.len() as u64);
        let n_segments = n_cols.div_ceil(SEGMENT);
        let (bindings, n_bytes) = Bindings::new(gpu, stages, packed, n_segments);
        let most_pixels = packed.blocks.iter().map(|b| b.n_pixels).max().unwrap_or(0);
        Self {
            run,
            n_right_bytes,
            n_left_bytes,
            n_bytes,
            n_blocks: packed.n_items() as u32,
            bindings,
            n_bands: packed.n_right().into_iter().map(|n| n.div_ceil(COMPONENTS * THREADS)).sum(),
            n_runs: most_pixels.div_ceil(PIXELS * THREADS).min(ROW),
        }
    }

    /// Records `right · x` for all blocks, over as many segments as the group names.
    pub(super) fn project(&self, pass: &mut wgpu::ComputePass<'_>, n_segments: u32) {
        let n = self.n_bands;
        if n > 0 {
            pass.set_bind_group(1, &self.bindings.project, &[]);
            pass.dispatch_workgroups(n.min(ROW), n.div_ceil(ROW), n_segments);
        }
    }

    /// Records `scale · sum of the segments` for all blocks, and how far each tile is behind.
    pub(super) fn gather(&self, pass: &mut wgpu::ComputePass<'_>) {
        if self.n_blocks > 0 {
            pass.set_bind_group(1, &self.bindings.gather, &[]);
            pass.dispatch_workgroups((self.run.len() as u32).div_ceil(THREADS / PER_BLOCK), 1, 1);
        }
    }

    /// Records `left · z + sparse · x` for all tiles; those without content matter only where radiance is set.
    pub(super) fn expand(&self, pass: &mut wgpu::ComputePass<'_>, mode: ExpandMode) {
        if self.n_blocks > 0 || mode != ExpandMode::Add {
            pass.set_bind_group(1, &self.bindings.expand, &[]);
            pass.dispatch_workgroups(self.n_runs, self.run.len() as u32, 1);
        }
    }
}

impl Bindings {
    /// With the bytes of all buffers.
    fn new(gpu: &Gpu, stages: &Stages, packed: &Packed<'_>, n_segments: u32) -> (Self, u64) {
        let blocks = filled(gpu, "blocks", &packed.blocks);
        let left = filled_in_parts(gpu, "left", packed.n_left, packed.left_parts());
        let right = filled_in_parts(gpu, "right", packed.n_right_words(), packed.right_parts());
        let components = filled(gpu, "components", &packed.components);
        let components_of = filled(gpu, "components_of", &packed.components_of());
        let n_components = packed.components.len() as u64;
        let n_partials = n_components * (u64::from(n_segments) + 2);
        let partials = working(gpu, "partials", 16 * n_partials, wgpu::BufferUsages::empty());
        let sparse = filled(gpu, "sparse", &packed.sparse);
        let all = [&blocks, &left, &right, &components, &components_of, &partials, &sparse];
        let project = [&right, &partials, &components_of].map(|buffer| buffer.as_entire_binding());
        let gather = [&blocks, &components, &partials, &sparse].map(|buffer| buffer.as_entire_binding());
        let expand = [&blocks, &left, &partials, &sparse].map(|buffer| buffer.as_entire_binding());
        let bindings = Self {
            project: bind(gpu, &stages.project, 1, &project),
            gather: bind(gpu, &stages.gather, 1, &gather),
            expand: bind(gpu, &stages.expand, 1, &expand),
        };
        (bindings, all.iter().map(|buffer| buffer.size()).sum())
    }
}

/// A storage buffer of words, written part after part, each with its position.
fn filled_in_parts(gpu: &Gpu, name: &str, n_words: u64, parts: impl Iterator<Item = (u64, Vec<u32>)>) -> wgpu::Buffer {
    let buffer = storage(gpu, name, 4 * n_words, wgpu::BufferUsages::COPY_DST);
    for (position, words) in parts.filter(|(_, words)| !words.is_empty()) {
        gpu.queue.write_buffer(&buffer, 4 * position, bytemuck::cast_slice(&words));
        // What was written is on its way before more of it is packed.
        gpu.queue.submit([]);
    }
    buffer
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{Ranks, Recipe};

    #[test]
    fn limits_of_an_adapter_are_those_of_its_chunks() {
        let limits = |binding, buffer| wgpu::Limits {
            max_storage_buffer_binding_size: binding,
            max_buffer_size: buffer,
            max_compute_workgroups_per_dimension: 700,
            ..wgpu::Limits::default()
        };
        for (limits, n_bytes) in [
            (limits(1 << 20, 3 << 20), 1 << 20),
            (limits(2 << 30, (1 << 20) + 7), 1 << 20),
            (limits(3 << 30, 5 << 30), 3 << 30),
            (limits(1 << 40, 1 << 41), ADDRESSED),
        ] {
            assert_eq!(ChunkLimits::of(&limits), ChunkLimits { n_blocks: 700, n_bytes });
        }
    }

    #[test]
    fn runs_hold_every_block_once_and_no_buffer_more_than_it_may() {
        let recipe = Recipe { width: 97, height: 61, n_cols: vec![300], rank: Ranks::Mixed(24), ..Recipe::default() };
        let low_rank = &recipe.frame().groups[0];
        let n_blocks = low_rank.blocks.len();
        let whole = ChunkLimits { n_blocks: 1 << 20, n_bytes: 1 << 40 };
        let items = |run| items(low_rank, run, Precision::Halves);
        assert_eq!(cut(&items(0..n_blocks), 0..n_blocks, whole).unwrap().len(), 1);
        for limits in [ChunkLimits { n_blocks: 7, ..whole }, ChunkLimits { n_bytes: 40_000, ..whole }] {
            let runs = cut(&items(3..n_blocks), 3..n_blocks, limits).unwrap();
            assert!(runs.iter().flat_map(Clone::clone).eq(3..n_blocks), "{runs:?}");
            assert!(runs.len() > 3 && runs.iter().all(|run| run.len() <= limits.n_blocks), "{runs:?}");
            for run in runs {
                let items = items(run.clone());
                let packed = pack(low_rank, run, &items);
                let partials = 16 * 5 * packed.components.len() as u64;
                assert!((4 * packed.n_left.max(packed.n_right_words())).max(partials) <= limits.n_bytes);
            }
        }
        let narrow = cut(&items(0..n_blocks), 0..n_blocks, ChunkLimits { n_bytes: 4000, ..whole });
        assert!(matches!(narrow, Err(RelightError::TooLarge { limit: 4000, .. })), "{narrow:?}");
    }
}
