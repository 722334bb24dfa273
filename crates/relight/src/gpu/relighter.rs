//! Relighting on a device: factors live there, coefficients go in, a texture (or radiance) comes out.

use rayon::prelude::*;

use super::chunk::{Chunk, ChunkLimits, storage};
use super::stages::{Stages, bind};
use crate::display::DisplayParams;
use crate::frame::{Frame, Radiance};
use crate::gpu::Gpu;
use crate::layout::{Display, Group};
use crate::relight::{Relight, RelightError, RelightStats, check_coefficients, is_dark};

/// Relights on a device.
#[derive(Debug)]
pub struct GpuRelighter {
    gpu: Gpu,
    limits: ChunkLimits,
    stages: Stages,
    frame: Frame,
    groups: Vec<GroupBuffers>,
    output: Output,
    /// Whether `output.radiance` shows the coefficients of the groups.
    state: OutputState,
    stats: RelightStats,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum OutputState {
    Stale,
    Current,
}

/// One group of columns on the device.
#[derive(Debug)]
struct GroupBuffers {
    chunks: Vec<Chunk>,
    coefficients: wgpu::Buffer,
    project: wgpu::BindGroup,
    expand: wgpu::BindGroup,
    /// What `z` stands for; none where it must be projected.
    projected: Option<Vec<[f32; 3]>>,
    /// Whether the radiance holds this group; a dark group adds nothing.
    lit: Lit,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Lit {
    Dark,
    Shining,
}

/// What the stages write.
#[derive(Debug)]
struct Output {
    /// RGB and a fourth float, row by row.
    radiance: wgpu::Buffer,
    texture: wgpu::Texture,
    view: wgpu::TextureView,
    display_params: wgpu::Buffer,
    display: wgpu::BindGroup,
}

impl GpuRelighter {
    /// Uploads a frame.
    ///
    /// # Errors
    /// A frame that does not fit together or is too large for the device; a failing device.
    pub fn new(gpu: &Gpu, frame: &Frame) -> Result<Self, RelightError> {
        Self::with_limits(gpu, frame, ChunkLimits::of(gpu))
    }

    pub(super) fn with_limits(gpu: &Gpu, frame: &Frame, limits: ChunkLimits) -> Result<Self, RelightError> {
        frame.check()?;
        check_size(gpu, frame)?;
        gpu.guarded(|| {
            let stages = Stages::new(gpu);
            let output = Output::new(gpu, &stages, frame);
            let mut groups = Vec::new();
            for group in 0..frame.groups.len() {
                groups.push(GroupBuffers::new(gpu, &stages, limits, frame, group, &output.radiance)?);
            }
            gpu.queue.submit([]);
            let (gpu, frame, state) = (gpu.clone(), frame.clone(), OutputState::Stale);
            Ok(Self { gpu, limits, stages, frame, groups, output, state, stats: RelightStats::default() })
        })
    }

    /// Relights and encodes for the display, without waiting for the device or reading anything back. The view stays the
    /// same until [`Relight::update`] brings a frame of another shape.
    ///
    /// # Errors
    /// Wrong lengths, coefficients that are not finite, a failing device.
    pub fn relight_to_texture(
        &mut self,
        coefficients: &[Vec<[f32; 3]>],
        display: &DisplayParams,
    ) -> Result<&wgpu::TextureView, RelightError> {
        check_coefficients(&self.frame, coefficients)?;
        self.submit(coefficients, Some(display))?;
        Ok(&self.output.view)
    }

    /// The display-encoded picture that [`Self::relight_to_texture`] writes: rgba8unorm, width × height.
    pub fn texture(&self) -> &wgpu::Texture {
        &self.output.texture
    }

    /// Reads the display-encoded picture back: RGBA, 4 bytes per pixel, row by row.
    ///
    /// # Errors
    /// A failing device.
    pub fn read_texture(&self) -> Result<Vec<u8>, RelightError> {
        let (width, height) = (self.frame.width, self.frame.height);
        let stride = (4 * width).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let bytes = self.read_back(u64::from(stride) * u64::from(height), |encoder, buffer| {
            let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(stride), rows_per_image: None };
            let target = wgpu::TexelCopyBufferInfo { buffer, layout };
            encoder.copy_texture_to_buffer(self.output.texture.as_image_copy(), target, self.output.texture.size());
        })?;
        Ok(bytes.chunks_exact(stride as usize).flat_map(|row| &row[..4 * width as usize]).copied().collect())
    }

    /// Submits all stages that are due, and display where asked for; after a failure everything is due again.
    fn submit(&mut self, coefficients: &[Vec<[f32; 3]>], display: Option<&DisplayParams>) -> Result<(), RelightError> {
        let gpu = self.gpu.clone();
        let result = gpu.guarded(|| {
            let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            self.record(&mut encoder, coefficients);
            if let Some(display) = display {
                self.record_display(&mut encoder, display);
            }
            gpu.queue.submit([encoder.finish()]);
            Ok(())
        });
        if result.is_err() {
            self.state = OutputState::Stale;
            self.groups.iter_mut().for_each(|group| group.projected = None);
        }
        result
    }

    /// Records project and expand where the coefficients, or blocks, are others than those shown.
    fn record(&mut self, encoder: &mut wgpu::CommandEncoder, coefficients: &[Vec<[f32; 3]>]) {
        self.stats = RelightStats::default();
        self.project(encoder, coefficients);
        let n_blocks = self.frame.partition().n_blocks();
        if self.state == OutputState::Current {
            self.stats.n_skipped = self.groups.len() * n_blocks;
            return;
        }

        // Groups add up in the radiance buffer, one after the other.
        encoder.clear_buffer(&self.output.radiance, 0, None);
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&self.stages.expand);
        for group in self.groups.iter().filter(|group| group.lit == Lit::Shining) {
            pass.set_bind_group(0, &group.expand, &[]);
            for chunk in &group.chunks {
                chunk.expand(&mut pass);
                self.stats.n_expanded += chunk.n_blocks as usize;
                self.stats.n_bytes += chunk.n_bytes;
            }
        }
        self.stats.n_skipped = self.groups.len() * n_blocks - self.stats.n_expanded;
        self.state = OutputState::Current;
    }

    /// Records project for the groups whose coefficients are new, and notes which are lit.
    fn project(&mut self, encoder: &mut wgpu::CommandEncoder, coefficients: &[Vec<[f32; 3]>]) {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&self.stages.project);
        for (group, x) in self.groups.iter_mut().zip(coefficients) {
            let lit = if is_dark(x) { Lit::Dark } else { Lit::Shining };
            if group.lit != lit {
                group.lit = lit;
                self.state = OutputState::Stale;
            }
            if lit == Lit::Dark {
                self.stats.n_dark_groups += 1;
            } else if group.projected.as_ref() != Some(x) {
                group.write_coefficients(&self.gpu, x);
                pass.set_bind_group(0, &group.project, &[]);
                group.chunks.iter().for_each(|chunk| chunk.project(&mut pass));
                self.state = OutputState::Stale;
            }
        }
    }

    fn record_display(&self, encoder: &mut wgpu::CommandEncoder, display: &DisplayParams) {
        let params = Display::new(self.frame.width, self.frame.height, display);
        self.gpu.queue.write_buffer(&self.output.display_params, 0, bytemuck::bytes_of(&params));
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&self.stages.display);
        pass.set_bind_group(0, &self.output.display, &[]);
        pass.dispatch_workgroups(self.frame.width.div_ceil(8), self.frame.height.div_ceil(8), 1);
    }

    /// Copies into a buffer that the CPU can read, waits, and hands out the bytes.
    fn read_back(
        &self,
        n_bytes: u64,
        copy: impl FnOnce(&mut wgpu::CommandEncoder, &wgpu::Buffer),
    ) -> Result<Vec<u8>, RelightError> {
        let gpu = &self.gpu;
        gpu.guarded(|| {
            let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("read back"),
                size: n_bytes,
                usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
                mapped_at_creation: false,
            });
            let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            copy(&mut encoder, &buffer);
            gpu.queue.submit([encoder.finish()]);
            let (sender, receiver) = std::sync::mpsc::channel();
            // Nobody listens only if waiting failed, and then that error is reported.
            buffer.map_async(wgpu::MapMode::Read, .., move |result| drop(sender.send(result)));
            gpu.wait()?;
            let failed = |words: String| RelightError::Device(format!("reading back: {words}"));
            let mapped = receiver.recv().map_err(|error| failed(error.to_string()))?;
            mapped.map_err(|error| failed(error.to_string()))?;
            let view = buffer.get_mapped_range(..).map_err(|error| failed(error.to_string()))?;
            Ok(view.to_vec())
        })
    }
}

impl Relight for GpuRelighter {
    fn update(&mut self, frame: &Frame, changed: &[(usize, usize)]) -> Result<(), RelightError> {
        if !self.frame.same_shape(frame) {
            *self = Self::with_limits(&self.gpu, frame, self.limits)?;
            return Ok(());
        }
        self.frame.take_blocks(frame, changed)?;
        let gpu = self.gpu.clone();
        gpu.guarded(|| {
            for (group_idx, group) in self.groups.iter_mut().enumerate() {
                let mut blocks = changed.iter().filter(|c| c.0 == group_idx).map(|c| c.1).peekable();
                if blocks.peek().is_some() {
                    let blocks: Vec<_> = blocks.collect();
                    group.upload_again(&gpu, &self.stages, self.limits, &self.frame.groups[group_idx], &blocks)?;
                    self.state = OutputState::Stale;
                }
            }
            gpu.queue.submit([]);
            Ok(())
        })
    }

    fn relight(&mut self, coefficients: &[Vec<[f32; 3]>], out: &mut Radiance) -> Result<(), RelightError> {
        check_coefficients(&self.frame, coefficients)?;
        self.submit(coefficients, None)?;
        out.resize(self.frame.width, self.frame.height);
        let n_bytes = 16 * out.pixels.len() as u64;
        let copy = |encoder: &mut wgpu::CommandEncoder, buffer: &wgpu::Buffer| {
            encoder.copy_buffer_to_buffer(&self.output.radiance, 0, buffer, 0, n_bytes);
        };
        let bytes = self.read_back(n_bytes, copy)?;
        out.pixels.par_iter_mut().zip(bytes.par_chunks_exact(16)).for_each(|(rgb, texel)| {
            let [r, g, b, _]: [f32; 4] = bytemuck::pod_read_unaligned(texel);
            *rgb = [r, g, b];
        });
        Ok(())
    }

    fn stats(&self) -> RelightStats {
        self.stats
    }
}

impl GroupBuffers {
    fn new(
        gpu: &Gpu,
        stages: &Stages,
        limits: ChunkLimits,
        frame: &Frame,
        group: usize,
        radiance: &wgpu::Buffer,
    ) -> Result<Self, RelightError> {
        let low_rank = &frame.groups[group];
        let params = uniform(gpu, "group", size_of::<Group>());
        let content = Group { n_cols: low_rank.n_cols, frame_width: frame.width, ..Group::default() };
        gpu.queue.write_buffer(&params, 0, bytemuck::bytes_of(&content));
        let n_bytes = 16 * u64::from(low_rank.n_cols).next_multiple_of(2);
        let coefficients = storage(gpu, "coefficients", n_bytes, wgpu::BufferUsages::COPY_DST);
        let resources = [&params, &coefficients, radiance].map(|buffer| buffer.as_entire_binding());
        let project = bind(gpu, &stages.project, 0, &resources[..2]);
        let expand = bind(gpu, &stages.expand, 0, &resources);
        let mut chunks = Vec::new();
        Chunk::upload(gpu, stages, limits, low_rank, 0..low_rank.blocks.len(), &mut chunks)?;
        Ok(Self { chunks, coefficients, project, expand, projected: None, lit: Lit::Dark })
    }

    /// Uploads the chunks that hold any of `blocks`.
    fn upload_again(
        &mut self,
        gpu: &Gpu,
        stages: &Stages,
        limits: ChunkLimits,
        low_rank: &clerestory_nystrom::BlockLowRank,
        blocks: &[usize],
    ) -> Result<(), RelightError> {
        self.projected = None;
        for chunk in std::mem::take(&mut self.chunks) {
            if blocks.iter().any(|block| chunk.run.contains(block)) {
                Chunk::upload(gpu, stages, limits, low_rank, chunk.run, &mut self.chunks)?;
            } else {
                self.chunks.push(chunk);
            }
        }
        Ok(())
    }

    fn write_coefficients(&mut self, gpu: &Gpu, x: &[[f32; 3]]) {
        let padded: Vec<[f32; 4]> = x.iter().map(|&[r, g, b]| [r, g, b, 0.0]).collect();
        gpu.queue.write_buffer(&self.coefficients, 0, bytemuck::cast_slice(&padded));
        self.projected = Some(x.to_vec());
    }
}

impl Output {
    fn new(gpu: &Gpu, stages: &Stages, frame: &Frame) -> Self {
        let n_bytes = radiance_bytes(frame);
        let usage = wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
        let radiance = storage(gpu, "radiance", n_bytes, usage);
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("display"),
            size: wgpu::Extent3d { width: frame.width, height: frame.height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba8Unorm,
            usage: wgpu::TextureUsages::STORAGE_BINDING
                | wgpu::TextureUsages::TEXTURE_BINDING
                | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        let display_params = uniform(gpu, "display", size_of::<Display>());
        let resources = [
            display_params.as_entire_binding(),
            radiance.as_entire_binding(),
            wgpu::BindingResource::TextureView(&view),
        ];
        let display = bind(gpu, &stages.display, 0, &resources);
        Self { radiance, texture, view, display_params, display }
    }
}

fn radiance_bytes(frame: &Frame) -> u64 {
    16 * u64::from(frame.width) * u64::from(frame.height)
}

fn check_size(gpu: &Gpu, frame: &Frame) -> Result<(), RelightError> {
    let limits = gpu.device.limits();
    let (side, most) = (frame.width.max(frame.height), limits.max_texture_dimension_2d);
    if side > most {
        return Err(RelightError::TooLarge {
            what: "the longer side of the frame",
            size: side.into(),
            limit: most.into(),
        });
    }
    let (size, limit) = (radiance_bytes(frame), limits.max_storage_buffer_binding_size.min(limits.max_buffer_size));
    if size > limit {
        return Err(RelightError::TooLarge { what: "the frame's radiance", size, limit });
    }
    Ok(())
}

fn uniform(gpu: &Gpu, name: &str, n_bytes: usize) -> wgpu::Buffer {
    gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(name),
        size: n_bytes as u64,
        usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}
