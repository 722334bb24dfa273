//! Relighting on a device: factors live there, coefficients go in, a texture (or radiance) comes out.
//!
//! While one group moves, the others are summed once and kept; on top of that sum only those blocks of the moving group are
//! expanded whose `z` moved, and for a display only those that it moved by more than is seen. Where nothing changed nothing is
//! submitted.

use std::sync::Arc;

use rayon::prelude::*;

use super::buffers::check_storage;
use super::chunk::ChunkLimits;
use super::group::{GroupBuffers, Lit, WHATEVER};
use super::output::{Output, radiance_bytes};
use super::pack::group_bytes;
use super::stages::Stages;
use crate::display::DisplayParams;
use crate::frame::{Frame, Radiance};
use crate::gpu::Gpu;
use crate::layout::{Display, ExpandMode, Layered, SEGMENT};
use crate::packing::Precision;
use crate::relight::{Relight, RelightError, RelightStats, check_coefficients, check_layer, is_same_layer};

/// Relights on a device.
#[derive(Debug)]
pub struct GpuRelighter {
    gpu: Gpu,
    limits: ChunkLimits,
    precision: Precision,
    stages: Stages,
    frame: Frame,
    groups: Vec<GroupBuffers>,
    output: Output,
    /// Whether `output.radiance` shows the coefficients of the groups.
    state: OutputState,
    /// The group that `output.settled` leaves out, where it holds all others that shine.
    moving: Option<usize>,
    /// How the texture shows the radiance; none where it shows an older one.
    shown: Option<DisplayParams>,
    /// Added to every picture: on the device by display, to radiance that is read back on the CPU.
    layer: Option<Arc<Radiance>>,
    stats: RelightStats,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum OutputState {
    Stale,
    Current,
}

impl GpuRelighter {
    /// Uploads a frame.
    ///
    /// # Errors
    /// A frame that does not fit together or is too large for the device; a failing device.
    pub fn new(gpu: &Gpu, frame: &Frame) -> Result<Self, RelightError> {
        Self::with_precision(gpu, frame, Precision::Halves)
    }

    /// The same, with factors of a precision.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_precision(gpu: &Gpu, frame: &Frame, precision: Precision) -> Result<Self, RelightError> {
        Self::with_limits(gpu, frame, (ChunkLimits::of(&gpu.device.limits()), precision))
    }

    pub(super) fn with_limits(
        gpu: &Gpu,
        frame: &Frame,
        (limits, precision): (ChunkLimits, Precision),
    ) -> Result<Self, RelightError> {
        frame.check()?;
        check_size(gpu, frame)?;
        gpu.guarded(|| {
            let stages = Stages::new(gpu);
            let output = Output::new(gpu, &stages, frame);
            let mut groups = Vec::new();
            for group in 0..frame.groups.len() {
                let buffers = [&output.radiance, &output.settled];
                groups.push(GroupBuffers::new(gpu, &stages, (limits, precision), frame, group, buffers)?);
            }
            gpu.queue.submit([]);
            Ok(Self {
                gpu: gpu.clone(),
                limits,
                precision,
                stages,
                frame: frame.clone(),
                groups,
                output,
                state: OutputState::Stale,
                moving: None,
                shown: None,
                layer: None,
                stats: RelightStats::default(),
            })
        })
    }

    /// Relights and encodes for the display, without waiting for the device or reading anything back. The view stays the
    /// same until [`Relight::update`] brings a frame of another shape. What would change by less than half a step of the display is
    /// left as it is, see [`DisplayParams::unseen`].
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

    /// Memory of the device that the frame and its picture take, bytes.
    pub fn device_bytes(&self) -> u64 {
        self.output.n_bytes() + self.groups.iter().map(GroupBuffers::n_bytes).sum::<u64>()
    }

    /// Reads the display-encoded picture back: RGBA, 4 bytes per pixel, row by row.
    ///
    /// # Errors
    /// A failing device.
    pub fn read_texture(&self) -> Result<Vec<u8>, RelightError> {
        let (width, height) = (self.frame.width, self.frame.height);
        let stride = (4 * width).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let bytes = self.gpu.read_back(u64::from(stride) * u64::from(height), |encoder, buffer| {
            let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(stride), rows_per_image: None };
            let target = wgpu::TexelCopyBufferInfo { buffer, layout };
            encoder.copy_texture_to_buffer(self.output.texture.as_image_copy(), target, self.output.texture.size());
        })?;
        Ok(bytes.chunks_exact(stride as usize).flat_map(|row| &row[..4 * width as usize]).copied().collect())
    }

    /// Submits all stages that are due, and display where asked for; after a failure everything is due again.
    fn submit(&mut self, coefficients: &[Vec<[f32; 3]>], display: Option<&DisplayParams>) -> Result<(), RelightError> {
        self.stats = RelightStats::default();
        let unseen = display.map_or(0.0, DisplayParams::unseen);
        let lit = self.state == OutputState::Current
            && self.groups.iter().zip(coefficients).all(|(group, x)| group.shows(x, unseen));
        let shown = display.is_none_or(|display| self.shown.as_ref() == Some(display));
        let gpu = self.gpu.clone();
        let result = if lit && shown {
            // A picture that is there already vanished with its device.
            gpu.alive()
        } else {
            self.stats.n_submitted = 1;
            gpu.guarded(|| {
                let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
                if !lit {
                    self.shown = None;
                    self.record(&mut encoder, coefficients, unseen);
                }
                if let Some(display) = display {
                    self.record_display(&mut encoder, display);
                }
                gpu.queue.submit([encoder.finish()]);
                Ok(())
            })
        };
        if result.is_err() {
            (self.state, self.moving, self.shown) = (OutputState::Stale, None, None);
            self.groups.iter_mut().for_each(GroupBuffers::forget);
        }
        self.stats.n_dark_groups = self.groups.iter().filter(|group| !group.is_shining()).count();
        self.stats.n_skipped = self.groups.len() * self.frame.partition().n_blocks() - self.stats.n_expanded;
        result
    }

    /// Records project, gather and expand where the coefficients, or blocks, are others than those shown.
    fn record(&mut self, encoder: &mut wgpu::CommandEncoder, coefficients: &[Vec<[f32; 3]>], unseen: f32) {
        let is_other = |(idx, x): (usize, &Vec<[f32; 3]>)| (!self.groups[idx].shows(x, unseen)).then_some(idx);
        let moved: Vec<usize> = coefficients.iter().enumerate().filter_map(is_other).collect();
        let is_settled = self.state == OutputState::Current && moved.iter().all(|idx| self.moving == Some(*idx));
        let mut shining = moved.into_iter().filter(|idx| Lit::of(&coefficients[*idx]) == Lit::Shining);
        let alone = shining.next().filter(|_| shining.next().is_none());
        let skips = alone.filter(|_| is_settled);
        for (idx, (group, x)) in self.groups.iter_mut().zip(coefficients).enumerate() {
            // Whatever is summed anew is summed as it is.
            let unseen = if skips.is_some() { unseen } else { WHATEVER };
            if skips.is_none_or(|moving| moving == idx) {
                group.take(&self.gpu, &self.stages, encoder, (x, unseen), &mut self.stats);
            }
        }
        match alone {
            Some(idx) if is_settled => self.expand(encoder, idx, ExpandMode::SetMoved),
            Some(idx) => {
                self.sum(encoder, Some(idx));
                let n_bytes = radiance_bytes(&self.frame);
                encoder.copy_buffer_to_buffer(&self.output.radiance, 0, &self.output.settled, 0, n_bytes);
                self.expand(encoder, idx, ExpandMode::Set);
                self.moving = Some(idx);
            }
            None => {
                self.sum(encoder, None);
                self.moving = None;
            }
        }
        self.state = OutputState::Current;
    }

    /// Records the sum of all groups that shine, but one, one after the other.
    fn sum(&mut self, encoder: &mut wgpu::CommandEncoder, but: Option<usize>) {
        encoder.clear_buffer(&self.output.radiance, 0, None);
        for idx in (0..self.groups.len()).filter(|idx| but != Some(*idx)) {
            if self.groups[idx].is_shining() {
                self.expand(encoder, idx, ExpandMode::Add);
            }
        }
    }

    fn expand(&mut self, encoder: &mut wgpu::CommandEncoder, group: usize, mode: ExpandMode) {
        self.groups[group].expand(&self.gpu, &self.stages, encoder, mode, &mut self.stats);
    }

    fn record_display(&mut self, encoder: &mut wgpu::CommandEncoder, display: &DisplayParams) {
        let layered = if self.layer.is_some() { Layered::Yes } else { Layered::No };
        let params = Display::new(self.frame.width, self.frame.height, display, layered);
        self.gpu.queue.write_buffer(&self.output.display_params, 0, bytemuck::bytes_of(&params));
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&self.stages.display);
        pass.set_bind_group(0, &self.output.display, &[]);
        pass.dispatch_workgroups(self.frame.width.div_ceil(8), self.frame.height.div_ceil(8), 1);
        self.shown = Some(*display);
    }

    /// Reads back what the texture shows, without the layer.
    pub(super) fn read_radiance(&self, out: &mut Radiance) -> Result<(), RelightError> {
        out.resize(self.frame.width, self.frame.height);
        let n_bytes = 16 * out.pixels.len() as u64;
        let copy = |encoder: &mut wgpu::CommandEncoder, buffer: &wgpu::Buffer| {
            encoder.copy_buffer_to_buffer(&self.output.radiance, 0, buffer, 0, n_bytes);
        };
        let bytes = self.gpu.read_back(n_bytes, copy)?;
        out.pixels.par_iter_mut().zip(bytes.par_chunks_exact(16)).for_each(|(rgb, texel)| {
            let [r, g, b, _]: [f32; 4] = bytemuck::pod_read_unaligned(texel);
            *rgb = [r, g, b];
        });
        Ok(())
    }
}

impl Relight for GpuRelighter {
    fn update(&mut self, frame: &Frame, changed: &[(usize, usize)]) -> Result<(), RelightError> {
        if !self.frame.same_shape(frame) {
            *self = Self::with_limits(&self.gpu, frame, (self.limits, self.precision))?;
            return Ok(());
        }
        self.frame.take_blocks(frame, changed)?;
        let gpu = self.gpu.clone();
        gpu.guarded(|| {
            for (group_idx, group) in self.groups.iter_mut().enumerate() {
                let mut blocks = changed.iter().filter(|c| c.0 == group_idx).map(|c| c.1).peekable();
                if blocks.peek().is_some() {
                    let blocks: Vec<_> = blocks.collect();
                    let limits = (self.limits, self.precision);
                    group.upload_again(&gpu, &self.stages, limits, &self.frame.groups[group_idx], &blocks)?;
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
        self.read_radiance(out)?;
        if let Some(layer) = &self.layer {
            out.add(layer);
        }
        Ok(())
    }

    fn set_layer(&mut self, layer: Option<&Arc<Radiance>>) -> Result<(), RelightError> {
        if is_same_layer(layer, self.layer.as_ref()) {
            return Ok(());
        }
        if let Some(layer) = layer {
            check_layer(&self.frame, layer)?;
            let gpu = self.gpu.clone();
            gpu.guarded(|| {
                self.output.write_layer(&gpu, &self.stages, &layer.pixels);
                Ok(())
            })?;
        }
        (self.layer, self.shown) = (layer.cloned(), None);
        Ok(())
    }

    fn stats(&self) -> RelightStats {
        self.stats
    }
}

/// Memory that a device needs to relight a frame and show its picture, bytes: factors, sums of columns, radiance twice and the
/// picture, but neither layers nor what the driver rounds up.
pub fn device_bytes(frame: &Frame, precision: Precision) -> u64 {
    let n_pixels = u64::from(frame.width) * u64::from(frame.height);
    2 * radiance_bytes(frame)
        + 4 * n_pixels
        + frame.groups.iter().map(|group| group_bytes(group, precision)).sum::<u64>()
}

/// Storage buffers that expand and display bind, of which expand needs more.
pub(super) const STORAGE_BUFFERS: u32 = 8;

/// Whether the device takes a frame, as far as its size says.
fn check_size(gpu: &Gpu, frame: &Frame) -> Result<(), RelightError> {
    let limits = gpu.device.limits();
    let n_buffers = limits.max_storage_buffers_per_shader_stage;
    if n_buffers < STORAGE_BUFFERS {
        let (size, limit) = (STORAGE_BUFFERS.into(), n_buffers.into());
        return Err(RelightError::TooLarge { what: "the number of buffers of a kernel", size, limit });
    }
    let (side, most) = (frame.width.max(frame.height), limits.max_texture_dimension_2d);
    if side > most {
        return Err(RelightError::TooLarge {
            what: "the longer side of the frame",
            size: side.into(),
            limit: most.into(),
        });
    }
    let n_segments = frame.groups.iter().map(|group| group.n_cols.div_ceil(SEGMENT)).max().unwrap_or(0);
    let most = limits.max_compute_workgroups_per_dimension;
    if n_segments > most {
        let (size, limit) = [n_segments, most].map(|n| u64::from(n) * u64::from(SEGMENT)).into();
        return Err(RelightError::TooLarge { what: "the number of columns of a group", size, limit });
    }
    check_storage(gpu, "the frame's radiance", radiance_bytes(frame))
}
