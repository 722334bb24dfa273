//! The device, borrowed from the host or opened without a window, and relighting on it.

mod buffers;
mod chunk;
pub(crate) mod clock;
pub(crate) mod copy_pass;
mod group;
mod lamplight;
mod output;
mod pack;
mod relighter;
mod stages;

pub use buffers::DeviceMemory;
pub use clock::StageSecs;
pub use lamplight::{LampWords, Lamplight, LitSample, TreeWords};
pub use relighter::{GpuRelighter, device_bytes};

use std::sync::{Arc, OnceLock};

use crate::relight::RelightError;
use buffers::Refusals;
use relighter::STORAGE_BUFFERS;

/// A device and its queue; clones share both.
#[derive(Clone, Debug)]
pub struct Gpu {
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    /// Why the device was lost, once it was: commands for such a device vanish without an error.
    lost: Arc<OnceLock<String>>,
    refusals: Arc<Refusals>,
}

/// Which adapter a device without a window may come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DeviceChoice {
    /// The fastest there is, a software rasterizer where there is nothing else.
    #[default]
    Any,
    /// A real GPU.
    Hardware,
    /// A software rasterizer.
    Software,
}

impl DeviceChoice {
    /// Whether it is one of these.
    pub fn takes(self, device_type: wgpu::DeviceType) -> bool {
        match self {
            Self::Any => true,
            Self::Hardware => device_type != wgpu::DeviceType::Cpu,
            Self::Software => device_type == wgpu::DeviceType::Cpu,
        }
    }

    fn words(self) -> &'static str {
        match self {
            Self::Any => "usable",
            Self::Hardware => "hardware",
            Self::Software => "software",
        }
    }
}

impl Gpu {
    /// Shares the device of a host, such as a window, and listens for its loss, which the host must not do itself.
    pub fn from_host(device: wgpu::Device, queue: wgpu::Queue) -> Self {
        let lost = Arc::<OnceLock<String>>::default();
        let told = lost.clone();
        device.set_device_lost_callback(move |reason, words| {
            // Lost is lost: the first reason stays.
            let _ = told.set(format!("it was lost, {reason:?}: {words}"));
        });
        Self { device, queue, lost, refusals: Arc::default() }
    }

    /// Opens a device without a window, for tests and the command line.
    ///
    /// # Errors
    /// [`RelightError::NoAdapter`] where nothing suitable is installed, [`RelightError::NoDevice`] where the driver refuses.
    pub fn headless(choice: DeviceChoice) -> Result<Self, RelightError> {
        let adapters = adapters(choice);
        Self::open(adapters.first().ok_or(RelightError::NoAdapter { wanted: choice.words() })?)
    }

    /// Opens every device there is, the fastest first; those that the driver refuses are left out.
    pub fn all_headless(choice: DeviceChoice) -> Vec<Self> {
        adapters(choice).iter().filter_map(|adapter| Self::open(adapter).ok()).collect()
    }

    fn open(adapter: &wgpu::Adapter) -> Result<Self, RelightError> {
        Self::open_within(adapter, adapter.limits())
    }

    /// A device that keeps to limits, which the adapter may exceed.
    fn open_within(adapter: &wgpu::Adapter, required_limits: wgpu::Limits) -> Result<Self, RelightError> {
        let request = adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("relight"),
            required_limits,
            required_features: adapter.features() & wgpu::Features::TIMESTAMP_QUERY,
            ..Default::default()
        });
        let (device, queue) = pollster::block_on(request).map_err(|error| RelightError::NoDevice {
            adapter: describe(&adapter.get_info()),
            reason: error.to_string(),
        })?;
        Ok(Self::from_host(device, queue))
    }

    /// Name, kind and driver of the adapter, for people.
    pub fn description(&self) -> String {
        describe(&self.device.adapter_info())
    }

    /// The interface that its driver speaks, in a word.
    pub fn api(&self) -> String {
        format!("{:?}", self.device.adapter_info().backend).to_lowercase()
    }

    /// Whether the adapter runs on the CPU, where [`CpuRelighter`](crate::CpuRelighter) is several times faster.
    pub fn is_software(&self) -> bool {
        self.device.adapter_info().device_type == wgpu::DeviceType::Cpu
    }

    /// Whether the device notes when a stage begins and ends.
    pub fn takes_time(&self) -> bool {
        self.device.features().contains(wgpu::Features::TIMESTAMP_QUERY)
    }

    /// Waits until everything submitted is done.
    ///
    /// # Errors
    /// [`RelightError::Device`] if the device was lost meanwhile.
    pub fn wait(&self) -> Result<(), RelightError> {
        let done = self.device.poll(wgpu::PollType::wait_indefinitely());
        done.map(|_| ()).map_err(|error| RelightError::Device(error.to_string()))
    }

    /// Copies into a buffer that the CPU can read, waits, and hands out the bytes.
    pub(crate) fn read_back(
        &self,
        n_bytes: u64,
        copy: impl FnOnce(&mut wgpu::CommandEncoder, &wgpu::Buffer),
    ) -> Result<Vec<u8>, RelightError> {
        self.guarded(|| self.read_through(&self.readable(n_bytes), copy, <[u8]>::to_vec))
    }

    /// A buffer that the CPU can read.
    pub(crate) fn readable(&self, n_bytes: u64) -> wgpu::Buffer {
        self.buffer("read back", n_bytes, wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ)
    }

    /// Copies into such a buffer, waits, and looks at its bytes where they lie; to be guarded.
    pub(crate) fn read_through<T>(
        &self,
        buffer: &wgpu::Buffer,
        copy: impl FnOnce(&mut wgpu::CommandEncoder, &wgpu::Buffer),
        look: impl FnOnce(&[u8]) -> T,
    ) -> Result<T, RelightError> {
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        copy(&mut encoder, buffer);
        self.queue.submit([encoder.finish()]);
        let (sender, receiver) = std::sync::mpsc::channel();
        // Nobody listens only if waiting failed, and then that error is reported.
        buffer.map_async(wgpu::MapMode::Read, .., move |result| drop(sender.send(result)));
        self.wait()?;
        let failed = |words: String| RelightError::Device(format!("reading back: {words}"));
        let mapped = receiver.recv().map_err(|error| failed(error.to_string()))?;
        mapped.map_err(|error| failed(error.to_string()))?;
        let view = buffer.get_mapped_range(..).map_err(|error| failed(error.to_string()))?;
        let seen = look(&view);
        drop(view);
        buffer.unmap();
        Ok(seen)
    }

    /// Whether the device is gone. It may say so only once it has given up what was submitted before.
    pub fn is_lost(&self) -> bool {
        self.loss().is_some()
    }

    fn loss(&self) -> Option<&String> {
        // A lost device says so when it is polled; one that cannot be polled is reported by whoever waits for it.
        let _ = self.device.poll(wgpu::PollType::Poll);
        self.lost.get()
    }

    /// An error once the device is gone.
    pub(crate) fn alive(&self) -> Result<(), RelightError> {
        self.loss().map_or(Ok(()), |reason| Err(RelightError::Device(reason.clone())))
    }

    /// Runs `job` and turns whatever the device reports meanwhile into an error.
    pub(crate) fn guarded<T>(&self, job: impl FnOnce() -> Result<T, RelightError>) -> Result<T, RelightError> {
        use wgpu::ErrorFilter::{Internal, OutOfMemory, Validation};
        let scopes = [Internal, OutOfMemory, Validation].map(|filter| self.device.push_error_scope(filter));
        let result = job();
        let [internal, memory, validation] = scopes;
        let reports = [validation, memory, internal].map(|scope| pollster::block_on(scope.pop()));
        let [validation, memory, internal] = reports;
        // A buffer that is not there is misused by all that follows, which is reported as well.
        if memory.is_some() || self.refusals.take() {
            return Err(RelightError::OutOfMemory);
        }
        match validation.or(internal) {
            Some(error) => Err(RelightError::Device(error.to_string())),
            None => self.alive().and(result),
        }
    }
}

/// Those that can run our stages, the fastest first.
fn adapters(choice: DeviceChoice) -> Vec<wgpu::Adapter> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let mut adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
    adapters.retain(|a| choice.takes(a.get_info().device_type) && computes(a));
    adapters.sort_by_key(|a| slowness(&a.get_info()));
    adapters
}

fn computes(adapter: &wgpu::Adapter) -> bool {
    let needed = wgpu::DownlevelFlags::COMPUTE_SHADERS | wgpu::DownlevelFlags::SHADER_F16_IN_F32;
    adapter.get_downlevel_capabilities().flags.contains(needed)
        && adapter.limits().max_storage_buffers_per_shader_stage >= STORAGE_BUFFERS
}

/// Order of preference; OpenGL last within its kind.
fn slowness(info: &wgpu::AdapterInfo) -> (u8, bool) {
    let kind = match info.device_type {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    };
    (kind, info.backend == wgpu::Backend::Gl)
}

fn describe(info: &wgpu::AdapterInfo) -> String {
    let kind = match info.device_type {
        wgpu::DeviceType::DiscreteGpu => "discrete GPU",
        wgpu::DeviceType::IntegratedGpu => "integrated GPU",
        wgpu::DeviceType::VirtualGpu => "virtual GPU",
        wgpu::DeviceType::Cpu => "software",
        wgpu::DeviceType::Other => "other",
    };
    format!("{} ({kind}, {:?}, {} {})", info.name, info.backend, info.driver, info.driver_info)
}

#[cfg(test)]
mod refusal_tests;
#[cfg(test)]
pub(crate) mod tests;
#[cfg(test)]
mod twin_tests;
#[cfg(test)]
mod unseen_tests;
