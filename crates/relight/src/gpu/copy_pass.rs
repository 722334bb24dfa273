//! A kernel that copies, to measure what memory of a device can do.

use super::buffers::storage;
use super::clock::Stamps;
use super::stages::{bind, pipeline};
use crate::gpu::Gpu;
use crate::layout::COPY;

/// Elements of a workgroup, and workgroups of a row of the grid, as in `copy.wgsl`.
const ELEMENTS: u64 = 4 * 256;
const ROW: u64 = 32_768;

/// Both buffers, filled, and the kernel; with the bytes of each.
pub(crate) fn prepare(gpu: &Gpu, n_bytes: u64) -> (u64, [wgpu::Buffer; 2], wgpu::ComputePipeline) {
    let n_bytes = n_bytes.min(gpu.largest_storage()) / 1024 * 1024;
    let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
    let buffers = ["from", "to"].map(|name| storage(gpu, name, n_bytes, usage));
    gpu.queue.write_buffer(&buffers[0], 0, &content(n_bytes));
    (n_bytes, buffers, pipeline(gpu, COPY.0, COPY.1, &[]))
}

/// Any bytes that are finite numbers.
pub(crate) fn content(n_bytes: u64) -> Vec<u8> {
    (0..n_bytes / 4).flat_map(|i| (i as f32).to_le_bytes()).collect()
}

/// Copies the first buffer into the second, so many times, and notes when, where there are stamps for as many.
pub(crate) fn run(
    gpu: &Gpu,
    stage: &wgpu::ComputePipeline,
    buffers: &[wgpu::Buffer; 2],
    (n_times, stamps): (u32, Option<&Stamps>),
) {
    let resources = [&buffers[0], &buffers[1]].map(|buffer| buffer.as_entire_binding());
    let group = bind(gpu, stage, 0, &resources);
    let n_groups = buffers[1].size().div_ceil(16 * ELEMENTS);
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    for turn in 0..n_times {
        let timestamp_writes = stamps.map(|stamps| stamps.around(turn));
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: None, timestamp_writes });
        pass.set_pipeline(stage);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(n_groups.min(ROW) as u32, n_groups.div_ceil(ROW) as u32, 1);
    }
    if let Some(stamps) = stamps {
        stamps.resolve(&mut encoder, n_times);
    }
    gpu.queue.submit([encoder.finish()]);
}
