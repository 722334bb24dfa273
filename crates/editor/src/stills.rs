//! Pictures of a bake under one look after the other, each complete: thumbnails, comparisons, frames of a sequence.

use std::sync::Arc;

use anyhow::Result;
use clerestory_relight::{Gpu, Radiance};
use clerestory_transport::bake::Bake;
use clerestory_transport::camera::Film;
use clerestory_transport::sky::Backdrop;

use crate::cli::relight::{Relighter, irradiance_of};
use crate::look::Look;
use crate::session::lamps::{LampView, StillLamps};

/// What is pictured.
pub struct Subject {
    /// The matrix.
    pub bake: Bake,
    /// Where free lamps shine, if the scene is there.
    pub view: Option<LampView>,
}

/// How large a picture is to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Size {
    /// As it was baked.
    Whole,
    /// At most so many pixels wide.
    Within(u32),
}

/// Makes pictures of a subject. What two looks share is done once.
pub struct Stills {
    subject: Arc<Subject>,
    gpu: Option<Gpu>,
    relighter: Option<Relighter>,
    /// The sky that the relighter has behind its picture.
    backdrop: Option<Backdrop>,
    /// The lamps at the size of the last picture.
    lamps: Option<(Film, StillLamps)>,
}

impl Stills {
    /// On a graphics device, else on the CPU.
    pub fn new(subject: Arc<Subject>, gpu: Option<Gpu>) -> Stills {
        Stills { subject, gpu, relighter: None, backdrop: None, lamps: None }
    }

    /// What multiplies.
    pub(crate) fn relighter(&self) -> Option<&Relighter> {
        self.relighter.as_ref()
    }

    /// The picture under a look, nit; where the look shows illuminance and the bake has it, the light that arrives, lux. `None`
    /// if it was stopped. Lamps of the look stay dark without a scene.
    ///
    /// # Errors
    /// A failing device.
    pub fn picture(&mut self, look: &Look, size: Size, stop: &(dyn Fn() -> bool + Sync)) -> Result<Option<Radiance>> {
        let subject = self.subject.clone();
        let header = &subject.bake.header;
        let film = fitting(Film { width: header.width, height: header.height }, size);
        let backdrop = Backdrop::new(header, &look.lights);
        let is_same_sky = match (&self.backdrop, &backdrop) {
            (None, None) => true,
            (Some(own), Some(new)) => own.shows_the_same(new),
            _ => false,
        };
        let kept = self.relighter.take().filter(|_| is_same_sky);
        let relighter = match kept {
            Some(kept) => self.relighter.insert(kept),
            None => self.relighter.insert(Relighter::new(&subject.bake, &look.lights, self.gpu.as_ref())?),
        };
        self.backdrop = backdrop;
        let light = match (&subject.view, look.lights.lamps.iter().any(|lamp| !lamp.setting.muted)) {
            (Some(view), true) => {
                let (_, lamps) = match self.lamps.take().filter(|(of, _)| *of == film) {
                    Some(kept) => self.lamps.insert(kept),
                    None => self.lamps.insert((film, StillLamps::new(Arc::new(LampView { film, ..view.clone() })))),
                };
                let Some(light) = lamps.light(&look.lights.lamps, stop) else { return Ok(None) };
                Some(light)
            }
            _ => None,
        };
        let mut coefficients = header.coefficients(&look.lights);
        if let Some(light) = &light {
            light.light_patches(header, &mut coefficients);
        }
        let mut radiance = smaller(relighter.relight(&coefficients)?, film);
        for (pixel, more) in radiance.pixels.iter_mut().zip(light.iter().flat_map(|light| &light.direct.pixels)) {
            (0..3).for_each(|c| pixel[c] += more[c]);
        }
        Ok(Some(radiance))
    }

    /// The light that arrives at what is seen under a look, lux per channel; `None` where it was not baked.
    ///
    /// # Errors
    /// A failing device.
    pub fn irradiance(&self, look: &Look, size: Size) -> Result<Option<Radiance>> {
        let bake = &self.subject.bake;
        let Some(set) = bake.pixel_irradiance() else { return Ok(None) };
        let film = fitting(Film { width: bake.header.width, height: bake.header.height }, size);
        Ok(Some(smaller(irradiance_of(bake, set, &look.lights)?, film)))
    }
}

fn fitting(film: Film, size: Size) -> Film {
    match size {
        Size::Within(width) if width < film.width => {
            let height = (u64::from(film.height) * u64::from(width)).div_ceil(u64::from(film.width));
            Film { width, height: height as u32 }
        }
        _ => film,
    }
}

/// The mean of the pixels that each pixel of a smaller film touches.
fn smaller(picture: Radiance, film: Film) -> Radiance {
    if (picture.width, picture.height) == (film.width, film.height) {
        return picture;
    }
    let span = |n: u32, to: u32, of: u32| {
        let scaled = |n: u32| u64::from(n) * u64::from(of);
        (scaled(n) / u64::from(to)) as usize..scaled(n + 1).div_ceil(u64::from(to)) as usize
    };
    let mut small = Radiance::new(film.width, film.height);
    for y in 0..film.height {
        let rows = span(y, film.height, picture.height);
        for x in 0..film.width {
            let (columns, mut sum) = (span(x, film.width, picture.width), [0.0; 3]);
            for row in rows.clone() {
                let start = row * picture.width as usize;
                for pixel in &picture.pixels[start + columns.start..start + columns.end] {
                    (0..3).for_each(|c| sum[c] += pixel[c]);
                }
            }
            let n_pixels = (rows.len() * columns.len()) as f32;
            small.pixels[(y * film.width + x) as usize] = sum.map(|sum| sum / n_pixels);
        }
    }
    small
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_smaller_picture_has_the_same_mean() {
        let pixels = (0..12 * 6).map(|i| [i as f32, 1.0, (i % 12) as f32]).collect();
        let picture = Radiance { width: 12, height: 6, pixels };
        let film = fitting(Film { width: 12, height: 6 }, Size::Within(4));
        assert_eq!((film.width, film.height), (4, 2));
        let small = smaller(picture.clone(), film);
        let mean = |of: &Radiance, c: usize| of.pixels.iter().map(|p| p[c]).sum::<f32>() / of.pixels.len() as f32;
        assert!((0..3).all(|c| (mean(&small, c) - mean(&picture, c)).abs() < 1e-3), "{small:?}");
        assert_eq!(small.pixels[0], [13.0, 1.0, 1.0]);
        assert_eq!(fitting(film, Size::Within(9)), film);
        // Sides that do not divide.
        assert!(smaller(picture, Film { width: 5, height: 4 }).pixels.iter().all(|p| p[1] == 1.0));
    }
}
