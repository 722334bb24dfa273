//! Where the picture is multiplied: on the host's graphics device without a detour, or by the worker on the CPU.

use std::sync::Arc;

use clerestory_relight::{
    DisplayParams, Frame, Gpu, GpuRelighter, Precision, Radiance, Relight, RelightError, encode_as, encode_into,
};
use eframe::egui::{Color32, ColorImage, TextureId};
use eframe::egui_wgpu::RenderState;
use eframe::wgpu;
use serde::{Deserialize, Serialize};

/// Which device a person wants.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DeviceWish {
    /// The graphics device if it is a real one, else the CPU.
    #[default]
    Auto,
    /// The CPU.
    Cpu,
    /// The graphics device, a software one too.
    Gpu,
}

impl DeviceWish {
    /// All of them, with their names.
    pub const ALL: [(DeviceWish, &'static str); 3] =
        [(DeviceWish::Auto, "Automatic"), (DeviceWish::Cpu, "CPU"), (DeviceWish::Gpu, "Graphics device")];
}

/// Which blocks of a frame are new.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Changed {
    /// The whole frame.
    All,
    /// Group and block of each.
    Blocks(Vec<(usize, usize)>),
}

/// A picture as it is shown.
pub fn color_image(radiance: &Radiance, display: &DisplayParams) -> ColorImage {
    ColorImage::new(size_of(radiance), encode_as(opaque, radiance, display))
}

fn opaque([r, g, b]: [u8; 3]) -> Color32 {
    Color32::from_rgb(r, g, b)
}

fn size_of(radiance: &Radiance) -> [usize; 2] {
    [radiance.width as usize, radiance.height as usize]
}

/// Pictures one after the other, in the memory of those that nobody draws any more: fresh memory costs as much as a tone curve.
#[derive(Default)]
pub struct Pictures(Vec<Arc<ColorImage>>);

impl Pictures {
    /// One is made, one waits for the window, one is drawn.
    const MOST: usize = 3;

    /// A picture as it is shown.
    pub fn next(&mut self, radiance: &Radiance, display: &DisplayParams) -> Arc<ColorImage> {
        let size = size_of(radiance);
        self.0.retain(|image| image.size == size);
        let free = self.0.iter().position(|image| Arc::strong_count(image) == 1);
        let fresh = || Arc::new(ColorImage::filled(size, Color32::BLACK));
        let mut image = free.map_or_else(fresh, |at| self.0.swap_remove(at));
        encode_into(opaque, radiance, display, &mut Arc::make_mut(&mut image).pixels);
        self.0.truncate(Self::MOST - 1);
        self.0.push(image.clone());
        image
    }
}

impl Default for Changed {
    fn default() -> Self {
        Changed::Blocks(Vec::new())
    }
}

impl Changed {
    /// Whether nothing is new.
    pub fn is_empty(&self) -> bool {
        matches!(self, Changed::Blocks(blocks) if blocks.is_empty())
    }

    /// Takes over what is newer.
    pub fn absorb(&mut self, newer: Changed) {
        match (&mut *self, newer) {
            (Changed::All, _) => {}
            (_, Changed::All) => *self = Changed::All,
            (Changed::Blocks(own), Changed::Blocks(newer)) => own.extend(newer),
        }
    }
}

/// Relights on the window's own device, into a texture that the window draws.
pub struct GpuPainter {
    state: RenderState,
    gpu: Gpu,
    relighter: Option<GpuRelighter>,
    texture: Option<TextureId>,
    /// Blocks that are not on the device yet: whole chunks are uploaded, so they wait for company.
    waiting: Changed,
    uploaded_at: f64,
}

/// Seconds between two uploads of new blocks.
const UPLOAD_EVERY_SECS: f64 = 0.4;

impl GpuPainter {
    /// Borrows the window's device.
    pub fn new(state: &RenderState) -> GpuPainter {
        let gpu = Gpu::from_host(state.device.clone(), state.queue.clone());
        GpuPainter {
            state: state.clone(),
            gpu,
            relighter: None,
            texture: None,
            waiting: Changed::All,
            uploaded_at: f64::MIN,
        }
    }

    /// The device.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Whether it is a real graphics device.
    pub fn is_hardware(&self) -> bool {
        !self.gpu.is_software()
    }

    /// Whether the device is gone.
    pub fn is_lost(&self) -> bool {
        self.gpu.is_lost()
    }

    /// Name of the device, for people.
    pub fn description(&self) -> String {
        self.gpu.description()
    }

    /// Memory of the device that the picture takes, bytes; none before the first frame.
    pub fn device_bytes(&self) -> Option<u64> {
        self.relighter.as_ref().map(GpuRelighter::device_bytes)
    }

    /// Starts over with the next frame.
    pub fn forget(&mut self) {
        self.relighter = None;
        self.waiting = Changed::All;
    }

    /// Relights, adds a layer, and returns the texture to draw. `now` in seconds.
    ///
    /// # Errors
    /// A frame or coefficients that do not fit, or a failing device.
    pub fn show(
        &mut self,
        frame: &Frame,
        changed: Changed,
        (coefficients, layer): (&[Vec<[f32; 3]>], Option<&Arc<Radiance>>),
        display: &DisplayParams,
        now: f64,
    ) -> Result<TextureId, RelightError> {
        self.waiting.absorb(changed);
        let due = self.waiting == Changed::All || now - self.uploaded_at > UPLOAD_EVERY_SECS;
        if due && !self.waiting.is_empty() {
            self.upload(frame)?;
            self.uploaded_at = now;
        }
        let Some(relighter) = &mut self.relighter else {
            return Err(RelightError::Device("no frame was uploaded".into()));
        };
        relighter.set_layer(layer)?;
        let view = relighter.relight_to_texture(coefficients, display)?.clone();
        let mut renderer = self.state.renderer.write();
        let device = &self.state.device;
        match self.texture {
            Some(id) => renderer.update_egui_texture_from_wgpu_texture(device, &view, wgpu::FilterMode::Linear, id),
            None => self.texture = Some(renderer.register_native_texture(device, &view, wgpu::FilterMode::Linear)),
        }
        Ok(self.texture.expect("registered just above"))
    }

    /// Whether blocks wait for an upload, so that another frame is due.
    pub fn has_waiting(&self) -> bool {
        !self.waiting.is_empty()
    }

    fn upload(&mut self, frame: &Frame) -> Result<(), RelightError> {
        match (&mut self.relighter, std::mem::take(&mut self.waiting)) {
            (Some(relighter), Changed::Blocks(blocks)) => relighter.update(frame, &blocks),
            _ => {
                self.relighter = None;
                self.relighter = Some(GpuRelighter::with_precision(&self.gpu, frame, Precision::ByError)?);
                Ok(())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_lie_in_memory_that_nobody_reads_any_more() {
        let (display, mut pictures) = (DisplayParams::default(), Pictures::default());
        let picture = |value: f32| Radiance { width: 5, height: 3, pixels: vec![[value; 3]; 15] };
        let (first, second) = (pictures.next(&picture(0.1), &display), pictures.next(&picture(0.3), &display));
        assert_eq!(*first, color_image(&picture(0.1), &display), "it is still drawn");
        let place = first.pixels.as_ptr();
        drop(first);
        let third = pictures.next(&picture(0.5), &display);
        assert_eq!(third.pixels.as_ptr(), place);
        assert_eq!(*third, color_image(&picture(0.5), &display));
        assert_eq!(*second, color_image(&picture(0.3), &display));
        let wide = Radiance { width: 15, height: 1, ..picture(0.2) };
        assert_eq!(*pictures.next(&wide, &display), color_image(&wide, &display), "of another size");
        let kept: Vec<_> = (0..9).map(|_| pictures.next(&wide, &display)).collect();
        assert!(pictures.0.len() <= Pictures::MOST, "{}", kept.len());
    }

    #[test]
    fn a_whole_frame_swallows_single_blocks() {
        let mut changed = Changed::default();
        assert!(changed.is_empty());
        changed.absorb(Changed::Blocks(vec![(0, 1)]));
        changed.absorb(Changed::Blocks(vec![(1, 2)]));
        assert_eq!(changed, Changed::Blocks(vec![(0, 1), (1, 2)]));
        changed.absorb(Changed::All);
        changed.absorb(Changed::Blocks(vec![(0, 0)]));
        assert_eq!(changed, Changed::All);
    }
}
