//! Which device relights, and how it is told.

use clerestory_relight::Gpu;
use eframe::egui_wgpu::RenderState;

use super::super::rest::Rest;
use super::Follower;
use crate::picture::{DeviceWish, GpuPainter};

impl Follower {
    pub fn wish(&self) -> DeviceWish {
        self.wish
    }

    /// What multiplies, for people.
    pub fn device(&self) -> String {
        match self.painter().map(GpuPainter::description) {
            Some(name) => name,
            None => match rayon::current_num_threads() {
                1 => "CPU (1 thread)".into(),
                n => format!("CPU ({n} threads)"),
            },
        }
    }

    /// Memory of the graphics device that the picture takes, bytes; none where the CPU multiplies.
    pub fn device_bytes(&self) -> Option<u64> {
        self.painter()?.device_bytes()
    }

    /// The window's graphics device, whether it relights or not.
    pub fn graphics(&self) -> Option<&Gpu> {
        self.gpu.as_ref().map(GpuPainter::gpu)
    }

    /// Whether the graphics device works again after it had failed; tells it once.
    pub fn take_return(&mut self) -> bool {
        std::mem::take(&mut self.is_back)
    }

    fn painter(&self) -> Option<&GpuPainter> {
        self.gpu.as_ref().filter(|_| self.uses_gpu())
    }

    pub(super) fn uses_gpu(&self) -> bool {
        let Some(gpu) = self.gpu.as_ref().filter(|_| !self.rest.lasts()) else { return false };
        match self.wish {
            DeviceWish::Auto => gpu.is_hardware(),
            DeviceWish::Cpu => false,
            DeviceWish::Gpu => true,
        }
    }

    /// Changes the device; the next picture comes from there.
    pub fn use_device(&mut self, wish: DeviceWish) {
        (self.wish, self.rest) = (wish, Rest::default());
        self.start_over();
    }

    /// Whether the window's device is gone, and with it all that it draws.
    pub fn is_device_lost(&self) -> bool {
        self.gpu.as_ref().is_some_and(GpuPainter::is_lost)
    }

    /// Goes on in a window with another device.
    pub fn move_to(&mut self, state: Option<&RenderState>) {
        self.gpu = state.map(GpuPainter::new);
        self.forget();
    }
}
