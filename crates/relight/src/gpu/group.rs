//! One group of columns on the device: its chunks, its coefficients, and what was projected.

use clerestory_nystrom::BlockLowRank;

use super::buffers::{storage, uniform};
use super::chunk::{Chunk, ChunkLimits};
use super::output::Output;
use super::stages::{Stages, bind};
use crate::frame::Frame;
use crate::gpu::Gpu;
use crate::layout::{AT_A_TIME, ExpandMode, Group, SEGMENT};
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
    /// What was projected; none where all of it must be.
    projected: Option<Vec<[f32; 3]>>,
    /// Whether every tile is expanded from what was projected.
    is_settled: bool,
    /// Whether the radiance holds this group; a dark group adds nothing.
    lit: Lit,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Lit {
    Dark,
    Shining,
}

/// Brings every tile up to date, however little it changes.
pub(super) const WHATEVER: f32 = -1.0;

impl Lit {
    pub(super) fn of(x: &[[f32; 3]]) -> Self {
        if is_dark(x) { Self::Dark } else { Self::Shining }
    }
}

impl GroupBuffers {
    pub(super) fn new(
        gpu: &Gpu,
        stages: &Stages,
        limits: (ChunkLimits, Precision),
        frame: &Frame,
        group: usize,
        output: &Output,
    ) -> Result<Self, RelightError> {
        let low_rank = &frame.groups[group];
        let n_segments = low_rank.n_cols.div_ceil(SEGMENT);
        let params = uniform(gpu, "group", size_of::<Group>());
        let content =
            Group { n_cols: low_rank.n_cols, frame_width: frame.width, n_segments, mode: 0, unseen: WHATEVER };
        gpu.queue.write_buffer(&params, 0, bytemuck::bytes_of(&content));
        let n_bytes = 16 * u64::from(low_rank.n_cols.next_multiple_of(AT_A_TIME[1]));
        let coefficients = storage(gpu, "coefficients", n_bytes, wgpu::BufferUsages::COPY_DST);
        let segments = storage(gpu, "segments", 4 * u64::from(n_segments), wgpu::BufferUsages::COPY_DST);
        let Output { radiance, settled, behind, .. } = output;
        let resources = [&params, &coefficients, &segments].map(|buffer| buffer.as_entire_binding());
        let project = bind(gpu, &stages.project, 0, &resources);
        let resources = [&params, &coefficients, behind].map(|buffer| buffer.as_entire_binding());
        let gather = bind(gpu, &stages.gather, 0, &resources);
        let resources = [&params, &coefficients, radiance, settled, behind].map(|buffer| buffer.as_entire_binding());
        let expand = bind(gpu, &stages.expand, 0, &resources);
        let mut chunks = Vec::new();
        Chunk::upload(gpu, stages, limits, low_rank, 0..low_rank.blocks.len(), &mut chunks)?;
        Ok(Self {
            chunks,
            params,
            content,
            coefficients,
            segments,
            project,
            gather,
            expand,
            projected: None,
            is_settled: false,
            lit: Lit::Dark,
        })
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
        (self.projected, self.is_settled) = (None, false);
    }

    pub(super) fn is_shining(&self) -> bool {
        self.lit == Lit::Shining
    }

    /// Whether these coefficients are those that it was told last, or both are dark.
    pub(super) fn has(&self, x: &[[f32; 3]]) -> bool {
        let lit = Lit::of(x);
        self.lit == lit && (lit == Lit::Dark || self.projected.as_deref() == Some(x))
    }

    /// Whether these coefficients are those that it was told last, and every tile is what they make of it.
    pub(super) fn is_done(&self, x: &[[f32; 3]]) -> bool {
        self.has(x) && (self.is_settled || self.lit == Lit::Dark)
    }

    /// Takes over coefficients, and records project over the segments where they are others.
    pub(super) fn project(
        &mut self,
        gpu: &Gpu,
        stages: &Stages,
        pass: &mut wgpu::ComputePass<'_>,
        x: &[[f32; 3]],
        stats: &mut RelightStats,
    ) {
        self.lit = Lit::of(x);
        if self.lit == Lit::Dark {
            return;
        }
        let before = self.projected.replace(x.to_vec());
        let is_other = |col: usize| before.as_ref().is_none_or(|before| before[col] != x[col]);
        let of_col = |(col, [r, g, b]): (usize, &[f32; 3])| [*r, *g, *b, if is_other(col) { 1.0 } else { 0.0 }];
        let content: Vec<[f32; 4]> = x.iter().enumerate().map(of_col).collect();
        let segments = (0..).zip(content.chunks(SEGMENT as usize));
        let changed: Vec<u32> =
            segments.filter(|(_, cols)| cols.iter().any(|col| col[3] != 0.0)).map(|(segment, _)| segment).collect();
        // What nothing changed in is written, too, so that nothing counts as changed any more.
        gpu.queue.write_buffer(&self.coefficients, 0, bytemuck::cast_slice(&content));
        if changed.is_empty() {
            return;
        }
        gpu.queue.write_buffer(&self.segments, 0, bytemuck::cast_slice(&changed));
        self.is_settled = false;
        pass.set_pipeline(&stages.project);
        pass.set_bind_group(0, &self.project, &[]);
        for chunk in &self.chunks {
            chunk.project(pass, changed.len() as u32);
            stats.n_bytes += chunk.n_right_bytes * changed.len() as u64 / u64::from(self.content.n_segments.max(1));
        }
    }

    /// Records gather, unless every tile is what was projected; expand is to follow in the same submission.
    pub(super) fn gather(&mut self, stages: &Stages, pass: &mut wgpu::ComputePass<'_>) {
        if !self.is_settled {
            pass.set_pipeline(&stages.gather);
            pass.set_bind_group(0, &self.gather, &[]);
            self.chunks.iter().for_each(|chunk| chunk.gather(pass));
            self.is_settled = self.content.unseen <= 0.0;
        }
    }

    /// What the stages of this submission do, once for each.
    pub(super) fn set(&mut self, gpu: &Gpu, mode: ExpandMode, unseen: f32) {
        let content = Group { mode: mode as u32, unseen, ..self.content };
        if self.content != content {
            self.content = content;
            gpu.queue.write_buffer(&self.params, 0, bytemuck::bytes_of(&content));
        }
    }

    /// Records expand.
    pub(super) fn expand(
        &self,
        stages: &Stages,
        pass: &mut wgpu::ComputePass<'_>,
        mode: ExpandMode,
        stats: &mut RelightStats,
    ) {
        pass.set_pipeline(&stages.expand);
        pass.set_bind_group(0, &self.expand, &[]);
        for chunk in &self.chunks {
            chunk.expand(pass, mode);
            stats.n_expanded += chunk.n_blocks as usize;
            stats.n_bytes += chunk.n_left_bytes;
        }
    }
}
