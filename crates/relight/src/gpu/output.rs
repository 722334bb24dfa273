//! What the stages write: radiance, and the picture for the display.

use super::buffers::{storage, uniform, working};
use super::stages::{Stages, bind};
use crate::frame::Frame;
use crate::gpu::Gpu;
use crate::layout::Display;

/// What the stages write.
#[derive(Debug)]
pub(super) struct Output {
    /// RGB and a fourth float, row by row.
    pub radiance: wgpu::Buffer,
    /// The same of all groups but those that move.
    pub settled: wgpu::Buffer,
    /// One float per tile: by how many nit it would miss what was projected if it stayed as it is.
    pub behind: wgpu::Buffer,
    pub texture: wgpu::Texture,
    pub view: wgpu::TextureView,
    display_params: wgpu::Buffer,
    /// What is in there; none where nobody knows.
    params: Option<Display>,
    pub display: wgpu::BindGroup,
    /// Red, green and blue of a layer; smaller until there is the first one.
    layer: wgpu::Buffer,
}

impl Output {
    pub(super) fn new(gpu: &Gpu, stages: &Stages, frame: &Frame) -> Self {
        let n_bytes = radiance_bytes(frame);
        let usage = wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
        let [radiance, settled] = ["radiance", "settled"].map(|name| working(gpu, name, n_bytes, usage));
        let behind = working(gpu, "behind", 4 * frame.partition().n_blocks() as u64, wgpu::BufferUsages::empty());
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
        let layer = storage(gpu, "layer", size_of::<f32>() as u64, wgpu::BufferUsages::COPY_DST);
        let display = bind_display(gpu, stages, &display_params, &radiance, &view, &layer);
        Self { radiance, settled, behind, texture, view, display_params, params: None, display, layer }
    }

    /// Bytes of its buffers and of the texture.
    pub(super) fn n_bytes(&self) -> u64 {
        let buffers = [&self.radiance, &self.settled, &self.behind, &self.display_params, &self.layer];
        let buffers = buffers.map(|buffer| buffer.size());
        let size = self.texture.size();
        buffers.iter().sum::<u64>() + 4 * u64::from(size.width) * u64::from(size.height)
    }

    /// Takes over how radiance is shown.
    pub(super) fn write_params(&mut self, gpu: &Gpu, params: Display) {
        if self.params.replace(params) != Some(params) {
            gpu.queue.write_buffer(&self.display_params, 0, bytemuck::bytes_of(&params));
        }
    }

    /// What was written may not have arrived.
    pub(super) fn forget(&mut self) {
        self.params = None;
    }

    /// Uploads a layer; the display takes it from then on.
    pub(super) fn write_layer(&mut self, gpu: &Gpu, stages: &Stages, pixels: &[[f32; 3]]) {
        let bytes: &[u8] = bytemuck::cast_slice(pixels);
        if self.layer.size() < bytes.len() as u64 {
            self.layer = storage(gpu, "layer", bytes.len() as u64, wgpu::BufferUsages::COPY_DST);
            self.display = bind_display(gpu, stages, &self.display_params, &self.radiance, &self.view, &self.layer);
        }
        gpu.queue.write_buffer(&self.layer, 0, bytes);
    }
}

fn bind_display(
    gpu: &Gpu,
    stages: &Stages,
    params: &wgpu::Buffer,
    radiance: &wgpu::Buffer,
    view: &wgpu::TextureView,
    layer: &wgpu::Buffer,
) -> wgpu::BindGroup {
    let resources = [
        params.as_entire_binding(),
        radiance.as_entire_binding(),
        wgpu::BindingResource::TextureView(view),
        layer.as_entire_binding(),
    ];
    bind(gpu, &stages.display, 0, &resources)
}

pub(super) fn radiance_bytes(frame: &Frame) -> u64 {
    16 * u64::from(frame.width) * u64::from(frame.height)
}
