//! The four compute pipelines.

use crate::gpu::Gpu;
use crate::layout::SHADERS;

/// One pipeline per stage, named as its shader.
#[derive(Debug)]
pub(super) struct Stages {
    pub project: wgpu::ComputePipeline,
    pub gather: wgpu::ComputePipeline,
    pub expand: wgpu::ComputePipeline,
    pub display: wgpu::ComputePipeline,
}

impl Stages {
    pub(super) fn new(gpu: &Gpu) -> Self {
        let [project, gather, expand, display] = SHADERS.map(|(name, source)| pipeline(gpu, name, source, &[]));
        Self { project, gather, expand, display }
    }
}

/// A shader with one entry point of its own name, and values of constants that it leaves open.
pub(super) fn pipeline(gpu: &Gpu, name: &str, source: &str, constants: &[(&str, f64)]) -> wgpu::ComputePipeline {
    let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(name),
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(name),
        layout: None,
        module: &module,
        entry_point: Some(name),
        compilation_options: wgpu::PipelineCompilationOptions { constants, ..Default::default() },
        cache: None,
    })
}

/// Binds resources to numbers 0, 1, … of group `index` of a stage.
pub(super) fn bind(
    gpu: &Gpu,
    stage: &wgpu::ComputePipeline,
    index: u32,
    resources: &[wgpu::BindingResource<'_>],
) -> wgpu::BindGroup {
    let entries: Vec<_> = (0..)
        .zip(resources)
        .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource: resource.clone() })
        .collect();
    let layout = stage.get_bind_group_layout(index);
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout: &layout, entries: &entries })
}
