//! One group of columns on the device: its chunks, its coefficients, and what its `z` stands for.

use clerestory_nystrom::BlockLowRank;

use super::buffers::{storage, uniform};
use super::chunk::{Chunk, ChunkLimits};
use super::stages::{Stages, bind};
use crate::frame::Frame;
use crate::gpu::Gpu;
use crate::layout::{ExpandMode, Group, SEGMENT};
use crate::packing::Precision;
use crate::relight::{RelightError, RelightStats, is_dark};

/// One group of columns on the device.
#[derive(Debug)]
pub(super) struct GroupBuffers {
    chunks: Vec<Chunk>,
    params: wgpu::Buffer,
    content: Group,
    coefficients: wgpu::Buffer,
    /// Numbers of the segments to project.
    segments: wgpu::Buffer,
    project: wgpu::BindGroup,
    gather: wgpu::BindGroup,
    expand: wgpu::BindGroup,
    /// What `z` stands for; none where all of it must be projected.
    projected: Option<Vec<[f32; 3]>>,
    /// Nit by which its radiance may miss what was projected.
    behind: f32,
    /// Whether the radiance holds this group; a dark group adds nothing.
    lit: Lit,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Lit {
    Dark,
    Shining,
}

/// Brings every block up to date, however little it changes.
pub(super) const WHATEVER: f32 = -1.0;

impl Lit {
    pub(super) fn of(x: &[[f32; 3]]) -> Self {
        if is_dark(x) { Self::Dark } else { Self::Shining }
    }
}

impl GroupBuffers {
    /// `[radiance, settled]` are those of the output.
    pub(super) fn new(
        gpu: &Gpu,
        stages: &Stages,
        limits: (ChunkLimits, Precision),
        frame: &Frame,
        group: usize,
        [radiance, settled]: [&wgpu::Buffer; 2],
    ) -> Result<Self, RelightError> {
        let low_rank = &frame.groups[group];
        let n_segments = low_rank.n_cols.div_ceil(SEGMENT);
        let params = uniform(gpu, "group", size_of::<Group>());
        let content =
            Group { n_cols: low_rank.n_cols, frame_width: frame.width, n_segments, mode: 0, unseen: WHATEVER };
        gpu.queue.write_buffer(&params, 0, bytemuck::bytes_of(&content));
        let n_bytes = 16 * u64::from(low_rank.n_cols).next_multiple_of(2);
        let coefficients = storage(gpu, "coefficients", n_bytes, wgpu::BufferUsages::COPY_DST);
        let segments = storage(gpu, "segments", 4 * u64::from(n_segments), wgpu::BufferUsages::COPY_DST);
        let resources = [&params, &coefficients, &segments].map(|buffer| buffer.as_entire_binding());
        let project = bind(gpu, &stages.project, 0, &resources);
        let gather = bind(gpu, &stages.gather, 0, &resources[..1]);
        let resources = [&params, &coefficients, radiance, settled].map(|buffer| buffer.as_entire_binding());
        let expand = bind(gpu, &stages.expand, 0, &resources);
        let mut chunks = Vec::new();
        Chunk::upload(gpu, stages, limits, low_rank, 0..low_rank.blocks.len(), &mut chunks)?;
        let (projected, behind, lit) = (None, 0.0, Lit::Dark);
        Ok(Self { chunks, params, content, coefficients, segments, project, gather, expand, projected, behind, lit })
    }

    /// Uploads the chunks that hold any of `blocks`, as shorter ones where they were long.
    pub(super) fn upload_again(
        &mut self,
        gpu: &Gpu,
        stages: &Stages,
        (limits, precision): (ChunkLimits, Precision),
        low_rank: &BlockLowRank,
        blocks: &[usize],
    ) -> Result<(), RelightError> {
        self.forget();
        for chunk in std::mem::take(&mut self.chunks) {
            if blocks.iter().any(|block| chunk.run.contains(block)) {
                let limits = (limits.of_changing(), precision);
                Chunk::upload(gpu, stages, limits, low_rank, chunk.run, &mut self.chunks)?;
            } else {
                self.chunks.push(chunk);
            }
        }
        Ok(())
    }

    /// Bytes of its buffers.
    pub(super) fn n_bytes(&self) -> u64 {
        let own = [&self.params, &self.coefficients, &self.segments].map(|buffer| buffer.size());
        own.iter().sum::<u64>() + self.chunks.iter().map(|chunk| chunk.n_bytes).sum::<u64>()
    }

    /// All of `z` must be projected.
    pub(super) fn forget(&mut self) {
        self.projected = None;
    }

    pub(super) fn is_shining(&self) -> bool {
        self.lit == Lit::Shining
    }

    /// Whether the radiance holds the group under these coefficients, but for what is unseen, nit.
    pub(super) fn shows(&self, x: &[[f32; 3]], unseen: f32) -> bool {
        let lit = Lit::of(x);
        self.lit == lit && (lit == Lit::Dark || (self.projected.as_deref() == Some(x) && self.behind <= unseen))
    }

    /// Takes over coefficients, records project over the segments where they are others, and gather where `z` may miss what
    /// it should be by more than `unseen`, nit, which is [`WHATEVER`] where all blocks are expanded anyway.
    pub(super) fn take(
        &mut self,
        gpu: &Gpu,
        stages: &Stages,
        encoder: &mut wgpu::CommandEncoder,
        (x, unseen): (&[[f32; 3]], f32),
        stats: &mut RelightStats,
    ) {
        self.lit = Lit::of(x);
        let is_projected = self.projected.as_deref() == Some(x);
        if self.lit == Lit::Dark || (is_projected && self.behind <= unseen.max(0.0)) {
            return;
        }
        if self.content.unseen != unseen {
            self.content.unseen = unseen;
            gpu.queue.write_buffer(&self.params, 0, bytemuck::bytes_of(&self.content));
        }
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        if !is_projected {
            self.project(gpu, stages, &mut pass, x, stats);
        }
        pass.set_pipeline(&stages.gather);
        pass.set_bind_group(0, &self.gather, &[]);
        self.chunks.iter().for_each(|chunk| chunk.gather(&mut pass));
        self.behind = unseen.max(0.0);
    }

    fn project(
        &mut self,
        gpu: &Gpu,
        stages: &Stages,
        pass: &mut wgpu::ComputePass<'_>,
        x: &[[f32; 3]],
        stats: &mut RelightStats,
    ) {
        let before = self.projected.as_deref();
        let size = SEGMENT as usize;
        let is_other = |(i, new): &(u32, &[[f32; 3]])| {
            before.is_none_or(|before| before[*i as usize * size..].chunks(size).next() != Some(new))
        };
        let changed: Vec<u32> = (0..).zip(x.chunks(size)).filter(is_other).map(|(i, _)| i).collect();
        let padded: Vec<[f32; 4]> = x.iter().map(|&[r, g, b]| [r, g, b, 0.0]).collect();
        gpu.queue.write_buffer(&self.coefficients, 0, bytemuck::cast_slice(&padded));
        gpu.queue.write_buffer(&self.segments, 0, bytemuck::cast_slice(&changed));
        self.projected = Some(x.to_vec());

        pass.set_pipeline(&stages.project);
        pass.set_bind_group(0, &self.project, &[]);
        for chunk in &self.chunks {
            chunk.project(pass, changed.len() as u32);
            stats.n_bytes += chunk.n_right_bytes * changed.len() as u64 / u64::from(self.content.n_segments.max(1));
        }
    }

    /// Records expand; one mode per submission.
    pub(super) fn expand(
        &mut self,
        gpu: &Gpu,
        stages: &Stages,
        encoder: &mut wgpu::CommandEncoder,
        mode: ExpandMode,
        stats: &mut RelightStats,
    ) {
        if self.content.mode != mode as u32 {
            self.content.mode = mode as u32;
            gpu.queue.write_buffer(&self.params, 0, bytemuck::bytes_of(&self.content));
        }
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&stages.expand);
        pass.set_bind_group(0, &self.expand, &[]);
        for chunk in &self.chunks {
            chunk.expand(&mut pass);
            stats.n_expanded += chunk.n_blocks as usize;
            stats.n_bytes += chunk.n_left_bytes;
        }
    }
}
