//! Direct light of lamps on the device: rays through a tree that the host gives as plain words.

use bytemuck::Pod;

use super::buffers::{self, check_storage, storage, uniform, working};
use super::clock::Stamps;
use super::stages::{bind, pipeline};
use crate::gpu::Gpu;
use crate::layout::{LAMPLIGHT, LampRecord};
use crate::relight::RelightError;

/// What rays meet, as `lamplight.wgsl` reads it.
#[derive(Clone, Copy, Debug)]
pub struct TreeWords<'a> {
    /// Eight boxes and what is in them: 56 words each.
    pub nodes: &'a [[u32; 4]],
    /// Four triangles: 40 words each.
    pub blocks: &'a [[u32; 4]],
    /// First node of what lets some light pass, if there is any.
    pub sheer: Option<u32>,
    /// Solid panes that bend light, and a tree around them; the last word of the first row is 0 where there are none.
    pub slabs: &'a [[u32; 4]],
    /// Table of what coats leave to what is below them.
    pub coats: &'a [f32],
}

/// A lamp as `lamplight.wgsl` reads it; width, height, `sheer` and `distribution` are filled in here.
pub type LampWords = [u32; 28];

/// A scene on the device, to be lit by lamps.
#[derive(Debug)]
pub struct Lamplight {
    gpu: Gpu,
    stage: wgpu::ComputePipeline,
    nodes: wgpu::Buffer,
    blocks: wgpu::Buffer,
    /// The table of coats, and behind it room for the measured distribution of a lamp.
    coats: wgpu::Buffer,
    n_coats: u32,
    slabs: wgpu::Buffer,
    sheer: Option<u32>,
    /// Of the last pass, where the device takes time.
    stamps: Option<Stamps>,
}

/// What the pixels see in one of their samples, on the device.
#[derive(Debug)]
pub struct LitSample {
    width: u32,
    height: u32,
    lamp: wgpu::Buffer,
    shifts: wgpu::Buffer,
    lit: wgpu::Buffer,
    /// Where the CPU reads that.
    seen: wgpu::Buffer,
    bindings: wgpu::BindGroup,
}

/// Pixels along a side of a workgroup.
const SIDE: u32 = 8;
/// Pixels along a side of a tile, which shares a random offset.
const TILE: u32 = 16;

impl Lamplight {
    /// Numbers of the longest measured distribution that is taken.
    pub const LONGEST_DISTRIBUTION: usize = 1 << 18;

    /// Takes the scene to the device.
    ///
    /// # Errors
    /// [`RelightError::TooLarge`] where the device does not take buffers of that size, [`RelightError::Device`] where it fails.
    pub fn new(gpu: &Gpu, tree: TreeWords<'_>) -> Result<Self, RelightError> {
        gpu.guarded(|| {
            let nodes = filled(gpu, "the tree of the scene", tree.nodes)?;
            let blocks = filled(gpu, "the triangles of the scene", tree.blocks)?;
            let coats = with_room(gpu, tree.coats)?;
            let slabs = filled(gpu, "the panes of the scene", tree.slabs)?;
            let (name, source) = LAMPLIGHT;
            // Without panes nothing of theirs is compiled.
            let has_slabs = tree.slabs.first().is_some_and(|[.., first_slab]| *first_slab > 0);
            let stage = pipeline(gpu, name, source, &[("HAS_SLABS", f64::from(has_slabs))]);
            let stamps = Stamps::new(gpu, 1);
            let (gpu, n_coats, sheer) = (gpu.clone(), tree.coats.len() as u32, tree.sheer);
            Ok(Self { gpu, stage, nodes, blocks, coats, n_coats, slabs, sheer, stamps })
        })
    }

    /// Takes what pixels see to the device: `starts` says where the points of each pixel begin, row by row, and how many there are; a point
    /// has 16 words.
    ///
    /// # Errors
    /// As [`Lamplight::new`].
    pub fn sample(
        &self,
        [width, height]: [u32; 2],
        starts: &[u32],
        points: &[[u32; 4]],
    ) -> Result<LitSample, RelightError> {
        let gpu = &self.gpu;
        gpu.guarded(|| {
            let points = filled(gpu, "what the pixels see", points)?;
            let starts = filled(gpu, "the list of pixels", starts)?;
            let n_pixels = u64::from(width) * u64::from(height);
            check_storage(gpu, "the light of the pixels", 16 * n_pixels)?;
            let n_tiles = u64::from(width.div_ceil(TILE)) * u64::from(height.div_ceil(TILE));
            let shifts = storage(gpu, "shifts", 8 * n_tiles, wgpu::BufferUsages::COPY_DST);
            let lit = working(gpu, "lit", 16 * n_pixels, wgpu::BufferUsages::COPY_SRC);
            let lamp = uniform(gpu, "lamp", size_of::<LampRecord>());
            let Self { nodes, blocks, coats, slabs, .. } = self;
            let buffers = [&lamp, nodes, blocks, &points, &starts, coats, &shifts, &lit, slabs];
            let bindings = bind(gpu, &self.stage, 0, &buffers.map(|buffer| buffer.as_entire_binding()));
            Ok(LitSample { width, height, lamp, shifts, lit, seen: gpu.readable(16 * n_pixels), bindings })
        })
    }

    /// Looks at the light of a lamp at each pixel, RGB and a fourth number: 1 where the CPU has to find it, else 0. `distribution` is what
    /// is measured of the lamp, empty where nothing is; all samples share the room for it. `shifts` are offsets of the points on the lamp,
    /// one for each tile of 16 × 16 pixels.
    ///
    /// # Errors
    /// [`RelightError::TooLarge`] for a distribution beyond [`Lamplight::LONGEST_DISTRIBUTION`], [`RelightError::Device`] where the device
    /// fails.
    pub fn light<T>(
        &mut self,
        sample: &LitSample,
        (lamp, distribution): (&LampWords, &[f32]),
        shifts: &[[f32; 2]],
        look: impl FnOnce(&[[f32; 4]]) -> T,
    ) -> Result<T, RelightError> {
        let (gpu, width, height) = (&self.gpu, sample.width, sample.height);
        let sheer = self.sheer.unwrap_or(u32::MAX);
        check_distribution(distribution)?;
        let record = LampRecord { width, height, sheer, distribution: self.n_coats, ..bytemuck::cast(*lamp) };
        let n_bytes = 16 * u64::from(width) * u64::from(height);
        let copy = |encoder: &mut wgpu::CommandEncoder, buffer: &wgpu::Buffer| {
            gpu.queue.write_buffer(&sample.lamp, 0, bytemuck::bytes_of(&record));
            gpu.queue.write_buffer(&sample.shifts, 0, bytemuck::cast_slice(shifts));
            if !distribution.is_empty() {
                gpu.queue.write_buffer(&self.coats, 4 * u64::from(self.n_coats), bytemuck::cast_slice(distribution));
            }
            let timestamp_writes = self.stamps.as_ref().map(|stamps| stamps.around(0));
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: None, timestamp_writes });
            pass.set_pipeline(&self.stage);
            pass.set_bind_group(0, &sample.bindings, &[]);
            pass.dispatch_workgroups(width.div_ceil(SIDE), height.div_ceil(SIDE), 1);
            drop(pass);
            self.stamps.iter().for_each(|stamps| stamps.resolve(encoder, 1));
            encoder.copy_buffer_to_buffer(&sample.lit, 0, buffer, 0, n_bytes);
        };
        gpu.guarded(|| gpu.read_through(&sample.seen, copy, |bytes| look(bytemuck::cast_slice(bytes))))
    }

    /// Seconds that the kernel took on the device when lamps were looked at last, by the device's own clock; `None` where it has none.
    ///
    /// # Errors
    /// [`RelightError::Device`] where the device fails.
    pub fn kernel_secs(&self) -> Result<Option<f64>, RelightError> {
        let Some(stamps) = &self.stamps else { return Ok(None) };
        Ok(stamps.spans(&self.gpu, 1)?.first().copied())
    }

    /// The device.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }
}

/// Whether there is room for the distribution of a lamp.
fn check_distribution(distribution: &[f32]) -> Result<(), RelightError> {
    let (what, limit) = ("the distribution of a lamp", 4 * Lamplight::LONGEST_DISTRIBUTION as u64);
    let size = size_of_val(distribution) as u64;
    if size > limit { Err(RelightError::TooLarge { what, size, limit }) } else { Ok(()) }
}

/// A table with room for a distribution behind it: a buffer of its own would be one more than devices have to take.
fn with_room(gpu: &Gpu, table: &[f32]) -> Result<wgpu::Buffer, RelightError> {
    let n_bytes = 4 * (table.len() + Lamplight::LONGEST_DISTRIBUTION) as u64;
    check_storage(gpu, "the table of coats", n_bytes)?;
    let buffer = storage(gpu, "coats", n_bytes, wgpu::BufferUsages::COPY_DST);
    gpu.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(table));
    Ok(buffer)
}

fn filled<T: Pod>(gpu: &Gpu, what: &'static str, content: &[T]) -> Result<wgpu::Buffer, RelightError> {
    check_storage(gpu, what, size_of_val(content) as u64)?;
    Ok(buffers::filled(gpu, what, content))
}
