//! Relighting on a device: factors live there, coefficients go in, a texture (or radiance) comes out.
//!
//! While some groups move, the others are summed once and kept; on top of that sum the moving groups are expanded in those
//! tiles alone in which the `z` of any of them moved, and for a display only where all together moved by more than is seen. Where nothing
//! changed nothing is submitted.

use std::sync::Arc;

use rayon::prelude::*;

use super::buffers::check_storage;
use super::chunk::ChunkLimits;
use super::clock::{Clock, Stage, StageSecs, begin_pass};
use super::group::{GroupBuffers, Lit, WHATEVER};
use super::output::{Output, radiance_bytes};
use super::pack::group_bytes;
use super::stages::Stages;
use crate::display::DisplayParams;
use crate::frame::{Frame, Radiance};
use crate::gpu::Gpu;
use crate::layout::{Display, ExpandMode, Layered, SEGMENT, SHOWN};
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
    /// The groups that `output.settled` leaves out, where it holds all others that shine.
    moving: Vec<usize>,
    /// Those of them that moved last.
    moved: Vec<usize>,
    /// Nit by which the radiance may miss what was projected.
    behind: f32,
    /// How the texture shows the radiance; none where it shows an older one.
    shown: Option<DisplayParams>,
    /// Added to every picture: on the device by display, to radiance that is read back on the CPU.
    layer: Option<Arc<Radiance>>,
    clock: Option<Clock>,
    stats: RelightStats,
}

/// What becomes of one group in one submission.
#[derive(Clone, Copy, Debug)]
struct Planned {
    group: usize,
    mode: ExpandMode,
    /// Nit by which tiles may miss the exact answer, or [`WHATEVER`].
    unseen: f32,
}

/// The first group takes the place of what was there, on whichever base, and the others add.
fn modes(groups: &[usize], base: ExpandMode, unseen: f32) -> Vec<Planned> {
    let mode = |i: usize| if i == 0 { base } else { ExpandMode::Add };
    groups.iter().enumerate().map(|(i, group)| Planned { group: *group, mode: mode(i), unseen }).collect()
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
                groups.push(GroupBuffers::new(gpu, &stages, (limits, precision), frame, group, &output)?);
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
                moving: Vec::new(),
                moved: Vec::new(),
                behind: 0.0,
                shown: None,
                layer: None,
                clock: None,
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

    /// Has the device take the time of the stages of all pictures to come, where it can.
    pub fn start_clock(&mut self) {
        self.clock = Clock::new(&self.gpu);
    }

    /// Takes no time any more.
    pub fn stop_clock(&mut self) {
        self.clock = None;
    }

    /// Waits, and tells how long the stages of the last picture took; none where no clock runs.
    ///
    /// # Errors
    /// A failing device.
    pub fn stage_secs(&self) -> Result<Option<StageSecs>, RelightError> {
        self.clock.as_ref().map(|clock| clock.read(&self.gpu)).transpose()
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
            && self.behind <= unseen
            && self.groups.iter().zip(coefficients).all(|(group, x)| group.has(x));
        let shown = display.is_none_or(|display| self.shown.as_ref() == Some(display));
        let gpu = self.gpu.clone();
        self.clock.iter_mut().for_each(Clock::reset);
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
                self.clock.iter().for_each(|clock| clock.resolve(&mut encoder));
                gpu.queue.submit([encoder.finish()]);
                Ok(())
            })
        };
        if result.is_err() {
            (self.state, self.shown) = (OutputState::Stale, None);
            self.output.forget();
            self.groups.iter_mut().for_each(GroupBuffers::forget);
        }
        self.stats.n_dark_groups = self.groups.iter().filter(|group| !group.is_shining()).count();
        self.stats.n_skipped = self.groups.len() * self.frame.partition().n_blocks() - self.stats.n_expanded;
        result
    }

    /// Records project, gather and expand where the coefficients, or blocks, are others than those shown.
    fn record(&mut self, encoder: &mut wgpu::CommandEncoder, coefficients: &[Vec<[f32; 3]>], unseen: f32) {
        let is_other = |(idx, x): (usize, &Vec<[f32; 3]>)| (!self.groups[idx].has(x)).then_some(idx);
        let moved: Vec<usize> = coefficients.iter().enumerate().filter_map(is_other).collect();
        if self.moves_on(&moved, coefficients) {
            encoder.clear_buffer(&self.output.behind, 0, None);
            // Where nothing moves any more, all that is behind is made up for, so that more exposure finds nothing left.
            let unseen = if moved.is_empty() { 0.0 } else { unseen };
            let shining = |idx: &usize| self.groups[*idx].is_shining();
            let is_alone = (0..self.groups.len()).filter(shining).all(|idx| self.moving.contains(&idx));
            let base = if is_alone { ExpandMode::Put } else { ExpandMode::Set };
            let plan = modes(&self.moving, base, unseen);
            self.gather(encoder, coefficients, &plan);
            self.expand(encoder, &plan);
            self.behind = unseen;
        } else {
            self.sum(encoder, coefficients, &moved);
            self.behind = 0.0;
        }
        if !moved.is_empty() {
            self.moved = moved;
        }
        self.state = OutputState::Current;
    }

    /// Whether the groups that move now are among those that moved. Where some of these have stopped to, the others are better off
    /// without them.
    fn moves_on(&self, moved: &[usize], coefficients: &[Vec<[f32; 3]>]) -> bool {
        let shines_on = |idx: &usize| self.groups[*idx].is_shining() && Lit::of(&coefficients[*idx]) == Lit::Shining;
        let is_among = moved.iter().all(|idx| self.moving.contains(idx) && shines_on(idx));
        let have_others_stopped = !moved.is_empty() && moved == self.moved && moved.len() < self.moving.len();
        self.state == OutputState::Current && is_among && !have_others_stopped
    }

    /// Records the sum of all groups that shine: first of those that stay, which is kept, then of those that move.
    fn sum(&mut self, encoder: &mut wgpu::CommandEncoder, coefficients: &[Vec<[f32; 3]>], moved: &[usize]) {
        let shines = |idx: &usize| Lit::of(&coefficients[*idx]) == Lit::Shining;
        let shining: Vec<usize> = (0..self.groups.len()).filter(shines).collect();
        self.moving = moved.iter().copied().filter(shines).collect();
        // Nobody knows yet what moves where there was no picture.
        if self.state == OutputState::Stale && self.moving.len() > 1 {
            self.moving.clear();
        }
        let staying: Vec<usize> = shining.into_iter().filter(|idx| !self.moving.contains(idx)).collect();
        let stay = modes(&staying, ExpandMode::Put, WHATEVER);
        let base = if stay.is_empty() { ExpandMode::Put } else { ExpandMode::Set };
        let plan = [stay, modes(&self.moving, base, WHATEVER)];
        self.gather(encoder, coefficients, &plan.concat());
        let [stay, moving] = plan;
        if stay.is_empty() && moving.is_empty() {
            encoder.clear_buffer(&self.output.radiance, 0, None);
        }
        self.expand(encoder, &stay);
        if !stay.is_empty() && !moving.is_empty() {
            let n_bytes = radiance_bytes(&self.frame);
            encoder.copy_buffer_to_buffer(&self.output.radiance, 0, &self.output.settled, 0, n_bytes);
        }
        self.expand(encoder, &moving);
    }

    /// Records all that comes before expand for the groups of a plan.
    fn gather(&mut self, encoder: &mut wgpu::CommandEncoder, coefficients: &[Vec<[f32; 3]>], plan: &[Planned]) {
        plan.iter().for_each(|planned| self.groups[planned.group].set(&self.gpu, planned.mode, planned.unseen));
        let mut pass = begin_pass(encoder, &mut self.clock, Stage::Project);
        for (group, x) in self.groups.iter_mut().zip(coefficients).filter(|(group, x)| !group.is_done(x)) {
            group.project(&self.gpu, &self.stages, &mut pass, x, &mut self.stats);
        }
        drop(pass);
        // How far a tile is behind counts all groups, so it is known before any of them is expanded.
        let mut pass = begin_pass(encoder, &mut self.clock, Stage::Gather);
        plan.iter().for_each(|planned| self.groups[planned.group].gather(&self.stages, &mut pass));
    }

    /// Records expand of the groups of a plan, one after the other.
    fn expand(&mut self, encoder: &mut wgpu::CommandEncoder, plan: &[Planned]) {
        if plan.is_empty() {
            return;
        }
        let mut pass = begin_pass(encoder, &mut self.clock, Stage::Expand);
        for &Planned { group, mode, .. } in plan {
            self.groups[group].expand(&self.stages, &mut pass, mode, &mut self.stats);
        }
    }

    fn record_display(&mut self, encoder: &mut wgpu::CommandEncoder, display: &DisplayParams) {
        let layered = if self.layer.is_some() { Layered::Yes } else { Layered::No };
        let params = Display::new(self.frame.width, self.frame.height, display, layered);
        self.output.write_params(&self.gpu, params);
        let mut pass = begin_pass(encoder, &mut self.clock, Stage::Display);
        pass.set_pipeline(&self.stages.display);
        pass.set_bind_group(0, &self.output.display, &[]);
        pass.dispatch_workgroups(self.frame.width.div_ceil(SHOWN), self.frame.height.div_ceil(SHOWN), 1);
        self.shown = Some(*display);
    }

    /// What the texture shows, without the layer.
    #[cfg(test)]
    pub(super) fn radiance(&self) -> &wgpu::Buffer {
        &self.output.radiance
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
        + 4 * (n_pixels + frame.partition().n_blocks() as u64)
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
