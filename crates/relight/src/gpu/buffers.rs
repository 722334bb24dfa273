//! Buffers on the device. All of them are made here, so that what a device refuses is met in one place.

use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use bytemuck::Pod;

use crate::gpu::Gpu;
use crate::relight::RelightError;

/// Whether a device gives memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DeviceMemory {
    /// As much as it has.
    Available,
    /// None any more, as if other programs had taken the rest.
    Exhausted,
}

/// Whether memory is refused, and was.
#[derive(Debug, Default)]
pub(super) struct Refusals {
    is_exhausted: AtomicBool,
    has_refused: AtomicBool,
}

impl Refusals {
    /// Whether a buffer was refused since the last call.
    pub(super) fn take(&self) -> bool {
        self.has_refused.swap(false, Relaxed)
    }
}

impl Gpu {
    /// Has the device refuse all new buffers, or give them again: for tests of what a host does when the memory of its device is full.
    pub fn set_memory(&self, memory: DeviceMemory) {
        self.refusals.is_exhausted.store(memory == DeviceMemory::Exhausted, Relaxed);
    }

    /// A buffer; one that is refused is too small for anything, and [`Gpu::guarded`] tells why.
    pub(super) fn buffer(&self, name: &str, n_bytes: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
        let is_refused = self.refusals.is_exhausted.load(Relaxed);
        if is_refused {
            self.refusals.has_refused.store(true, Relaxed);
        }
        self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(name),
            size: if is_refused { size_of::<u32>() as u64 } else { n_bytes },
            usage,
            mapped_at_creation: false,
        })
    }

    /// The largest storage buffer that the device takes, bytes.
    pub(super) fn largest_storage(&self) -> u64 {
        largest_storage(&self.device.limits())
    }
}

/// The largest storage buffer under some limits, bytes: a multiple of the largest element.
pub(super) fn largest_storage(limits: &wgpu::Limits) -> u64 {
    let most = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
    most - most % 16
}

/// Whether the device takes a storage buffer of that size, bytes.
///
/// # Errors
/// [`RelightError::TooLarge`] where it does not.
pub(super) fn check_storage(gpu: &Gpu, what: &'static str, size: u64) -> Result<(), RelightError> {
    let limit = gpu.largest_storage();
    if size > limit { Err(RelightError::TooLarge { what, size, limit }) } else { Ok(()) }
}

/// A storage buffer; an empty one still gets one element, since nothing cannot be bound.
pub(super) fn storage(gpu: &Gpu, name: &str, n_bytes: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    gpu.buffer(name, n_bytes.next_multiple_of(16).max(64), usage | wgpu::BufferUsages::STORAGE)
}

/// A storage buffer that stages write before others read it; in tests it holds no numbers until then.
pub(super) fn working(gpu: &Gpu, name: &str, n_bytes: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    let buffer = storage(gpu, name, n_bytes, usage | wgpu::BufferUsages::COPY_DST);
    if cfg!(test) {
        gpu.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(&vec![f32::NAN; buffer.size() as usize / 4]));
    }
    buffer
}

/// A storage buffer with content.
pub(super) fn filled<T: Pod>(gpu: &Gpu, name: &str, content: &[T]) -> wgpu::Buffer {
    let bytes: &[u8] = bytemuck::cast_slice(content);
    let buffer = storage(gpu, name, bytes.len() as u64, wgpu::BufferUsages::COPY_DST);
    if !bytes.is_empty() {
        gpu.queue.write_buffer(&buffer, 0, bytes);
    }
    buffer
}

/// A buffer of parameters.
pub(super) fn uniform(gpu: &Gpu, name: &str, n_bytes: usize) -> wgpu::Buffer {
    gpu.buffer(name, n_bytes as u64, wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST)
}
