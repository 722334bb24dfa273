//! Draws the interface on a device as a window does, but into a picture.

use std::pin::pin;
use std::sync::Arc;
use std::task::{Context, Poll, Waker};

use anyhow::Result;
use clerestory_relight::{DeviceChoice, Gpu};
use eframe::egui::{ClippedPrimitive, TexturesDelta, mutex::RwLock};
use eframe::egui_wgpu::{RenderState, Renderer, RendererOptions, ScreenDescriptor};
use eframe::wgpu;

/// What a window has of a device.
pub(super) struct Painter {
    pub state: RenderState,
    gpu: Gpu,
}

impl Painter {
    /// One for each adapter of a kind that can relight; those that the driver refuses are left out.
    pub fn all(choice: DeviceChoice) -> Vec<Painter> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let mut adapters = ready(instance.enumerate_adapters(wgpu::Backends::all()));
        let computes = wgpu::DownlevelFlags::COMPUTE_SHADERS;
        adapters.retain(|adapter| {
            adapter.get_downlevel_capabilities().flags.contains(computes)
                && choice.takes(adapter.get_info().device_type)
        });
        adapters.iter().filter_map(|adapter| Painter::new(&instance, adapter).ok()).collect()
    }

    fn new(instance: &wgpu::Instance, adapter: &wgpu::Adapter) -> Result<Painter> {
        let wanted = wgpu::DeviceDescriptor { required_limits: adapter.limits(), ..Default::default() };
        let (device, queue) = ready(adapter.request_device(&wanted))?;
        let target_format = wgpu::TextureFormat::Rgba8Unorm;
        let renderer = Renderer::new(&device, target_format, RendererOptions::default());
        let gpu = Gpu::from_host(device.clone(), queue.clone());
        let (adapter, instance, renderer) = (adapter.clone(), instance.clone(), Arc::new(RwLock::new(renderer)));
        let available_adapters = Vec::new();
        let state = RenderState { adapter, available_adapters, instance, device, queue, target_format, renderer };
        Ok(Painter { state, gpu })
    }

    /// The device.
    pub fn gpu(&self) -> Gpu {
        self.gpu.clone()
    }

    /// The device, for people.
    pub fn name(&self) -> String {
        self.gpu.description()
    }

    /// Hands the device all that draws a frame.
    pub fn paint(&self, triangles: &[ClippedPrimitive], textures: &TexturesDelta, size_in_pixels: [u32; 2]) {
        let (device, queue) = (&self.state.device, &self.state.queue);
        let mut renderer = self.state.renderer.write();
        for (id, images) in &textures.set {
            images.iter().for_each(|image| renderer.update_texture(device, queue, *id, image));
        }
        let screen = ScreenDescriptor { size_in_pixels, pixels_per_point: 1.0 };
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let first = renderer.update_buffers(device, queue, &mut encoder, triangles, &screen);
        let view = self.target(size_in_pixels);
        let attachment = wgpu::RenderPassColorAttachment {
            view: &view,
            resolve_target: None,
            ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::BLACK), store: wgpu::StoreOp::Store },
            depth_slice: None,
        };
        let pass = wgpu::RenderPassDescriptor { color_attachments: &[Some(attachment)], ..Default::default() };
        let mut pass = encoder.begin_render_pass(&pass).forget_lifetime();
        renderer.render(&mut pass, triangles, &screen);
        drop(pass);
        queue.submit(first.into_iter().chain([encoder.finish()]));
        textures.free.iter().for_each(|id| renderer.free_texture(id));
    }

    /// A new picture for each frame, as screens give one.
    fn target(&self, [width, height]: [u32; 2]) -> wgpu::TextureView {
        let texture = self.state.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("window"),
            size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: self.state.target_format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
            view_formats: &[],
        });
        texture.create_view(&wgpu::TextureViewDescriptor::default())
    }
}

/// What is there at once, as devices of systems with files are.
fn ready<T>(future: impl Future<Output = T>) -> T {
    let mut future = pin!(future);
    loop {
        if let Poll::Ready(value) = future.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
            return value;
        }
        std::thread::yield_now();
    }
}
